"""Parts that are given as a matrix, made to look like the others to all that follows.

Nodes have displacements only, as those of a mesh have.  A point with rotations is a rigid frame of three
nodes (in 2D two): the point, and one at the end of an arm along x and y each.  Six of the nine numbers are
the motion of the point; the other three strain the frame, and springs between its nodes resist them.  Forces
on a point, and moments, act on the six only, so that the frame is never strained: its springs have no
influence.

A face is a set of points.  Where it is joined to the face of a mesh, its points are nodes of that face, which
lends it its facets, seen from behind.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import basix
import numpy as np

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap, face_copy
from dolfinx_frontend.assembly.interface import Interface, Side
from dolfinx_frontend.assembly.ranks import PartSummary
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import sp, spatial
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.scene.laws import Displacement, Elimination
from dolfinx_frontend.scene.matrix import Matrix
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import InterfaceSpec, SubstructureSpec

__all__ = [
    "Frames",
    "LentFace",
    "Motion",
    "PointSet",
    "PointsOf",
    "at_points",
    "check_units",
    "copy_of",
    "discretised_matrix",
    "facing",
    "frames_of",
    "has_mesh",
    "lent_faces",
    "motion_of",
]

_NEAR = 1e-6
"""Distance of a point from a node, relative to the smallest facet, within which they are one."""

_ARM = 0.5
"""Arms of frames relative to the size of the part."""


@dataclass(frozen=True, repr=False)
class Motion:
    """Displacement of a part that is a matrix, at its points.

    Attributes
    ----------
    points
        (m, d), length.
    displacements
        (m, d), length.
    rotations
        (m, 3), in 2D (m, 1), radians, NaN at points that have none; None: no point has any, or the numbers
        are deviations.
    """

    points: Array
    displacements: Array
    rotations: Array | None = None

    def __repr__(self) -> str:
        largest = float(np.linalg.norm(self.displacements, axis=1).max())
        return f"Motion({len(self.points)} points, displacements up to {largest:.4g})"


class Frames:
    """A matrix as the part (:class:`PartLike`) of a substructure.

    Attributes
    ----------
    given
        As the scene has it.
    motions
        (n of the matrix, n): displacements and rotations of the points from the unknowns of the nodes.
    strains
        (k, n): what strains the frames.
    nodes
        (n / d, d), the points first.
    held
        As :attr:`Matrix.held`; None: it is free.
    surface
        Nodes that others may meet: all.
    """

    def __init__(self, given: Matrix) -> None:
        self.given, self.names = given, given.names
        m, d = given.points.shape
        self.nodes = _nodes(given.points, given.turning, _ARM * given.length)
        motions, self.strains = _frames(m, d, given.turning, _ARM * given.length)
        self.motions = motions[given.unknowns @ [given.components, 1]]
        self.held = given.held if given.held.any() else None
        self.surface = self.motions.shape[1] // given.dim

    @property
    def mesh(self) -> Any:
        """Refused as :attr:`Matrix.mesh`."""
        return self.given.mesh

    facet_tags = mesh

    def loads(self, name: str, where: str) -> Array:
        """Forces (n,) on the nodes of one of the loads of the matrix."""
        check_known("load of the matrix", name, self.given.loads, where)
        return np.asarray(self.motions.T @ self.given.loads[name])


def motion_of(nodes: Array, points: int, turning: Ints, unknowns: Array, linear: bool = True) -> Motion:
    """What unknowns (n,) at nodes (n / d, d), the points first, are at the points, of which some turn;
    `linear`: they are displacements, and no deviations."""
    d, values = nodes.shape[1], np.asarray(unknowns).reshape(nodes.shape)
    rotations = None
    if len(turning) and linear:
        motions, _ = _frames(points, d, turning, float(np.linalg.norm(nodes[points] - nodes[turning[0]])))
        every = (motions @ values.ravel()).reshape(points, -1)[:, d:]
        rotations = np.full_like(every, np.nan)
        rotations[turning] = every[turning]
    return Motion(nodes[:points], values[:points], rotations)


def frames_of(s: object) -> Frames | None:
    """The matrix that a substructure is; None: it has a mesh."""
    part = getattr(s, "part", None)
    return part if isinstance(part, Frames) else None


def discretised_matrix(spec: SubstructureSpec) -> Substructure:
    """The part of a scene."""
    given = spec.matrix
    assert given is not None
    part = Frames(given)
    x, d = part.nodes, given.dim
    stiffness = part.motions.T @ given.stiffness @ part.motions
    stiffness = stiffness + given.springs * (part.strains.T @ part.strains)
    centre = given.centre
    return Substructure(
        name=spec.name,
        part=part,
        space=None,
        stiffness=petsc_matrix(stiffness.tocsr()),
        load=np.zeros(x.size),
        rigid_modes=rigid_modes(x, centre, given.length).reshape(x.size, -1),
        modulus=given.modulus(),
        length=given.length,
        volume=given.length**d,
        centre=centre,
        dof_coordinates=x,
        factor=spec.stiffness,
    )


def has_mesh(s: Any) -> bool:
    """Whether a part of a problem, or of a file, has a mesh."""
    return bool(getattr(type(s), "meshed", True)) and frames_of(s) is None


def _nodes(points: Array, turning: Ints, arm: float) -> Array:
    """(n / d, d): the points, and the ends of the arms along x and y of those that turn."""
    d = points.shape[1]
    return np.concatenate([points, *(points[turning] + each for each in arm * np.eye(d)[: d - 1])])


def _frames(m: int, d: int, turning: Ints, arm: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """From the unknowns of the nodes: displacements (and rotations, 0 of points that do not turn) of points
    (m * components, n), and strains of their frames."""
    k, count = len(turning), d + (2 * d - 3 if len(turning) else 0)
    rows: list[Ints] = [(count * np.arange(m)[:, None] + np.arange(d)).ravel()]
    columns: list[Ints] = [np.arange(d * m)]
    values: list[Array] = [np.ones(d * m)]

    def add(row: Ints, terms: list[tuple[int, int, float]], factor: float) -> None:
        """How far ends move from their points along axes, (end, axis, weight)."""
        for end, axis, value in terms:
            for node, sign in ((m + end * k + np.arange(k), 1.0), (turning, -1.0)):
                rows.append(row)
                columns.append(d * node + axis)
                values.append(np.full(k, sign * value * factor))

    def made(size: int) -> sp.csr_matrix:
        at = (np.concatenate(rows), np.concatenate(columns))
        return sp.csr_matrix((np.concatenate(values), at), shape=(size, d * (m + (d - 1) * k)))

    if d == 3:
        turns = [[(1, 2, 1.0)], [(0, 2, -1.0)], [(0, 1, 0.5), (1, 0, -0.5)]]
        strained = [[(0, 0, 1.0)], [(1, 1, 1.0)], [(0, 1, 0.5**0.5), (1, 0, 0.5**0.5)]]
    else:
        turns, strained = [[(0, 1, 1.0)]], [[(0, 0, 1.0)]]
    for component, terms in enumerate(turns):
        add(count * turning + d + component, terms, 1.0 / arm)
    motions = made(count * m)
    rows, columns, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for number, terms in enumerate(strained):
        add(len(strained) * np.arange(k) + number, terms, 1.0)
    return motions, made(len(strained) * k)


def _points_of(given: Matrix, face: str, where: str) -> Ints:
    check_known("face", face, given.faces, where)
    return given.faces[face]


class PointsOf:
    """Points of a part that is a matrix in the place of a face: resultants of forces on them.

    Forces are spread over the points evenly and linearly; where that cannot carry a moment (a single point,
    or points on a line), their rotations take part.
    """

    around = False

    def __init__(self, s: Substructure, face: str, where: str) -> None:
        frames = frames_of(s)
        assert frames is not None
        self.given, self.where, self.dim = frames.given, f"{where}, {s.name}:{face}", s.dim
        self._motions = frames.motions
        self.some = _points_of(frames.given, face, where)
        self.x = frames.given.points[self.some]
        self.centre: Array = np.asarray(self.x.mean(axis=0), dtype=np.float64)
        self.area = s.length ** (s.dim - 1) * len(self.some) / len(frames.given.points)

    def nodal(self, forces: Array) -> Array:
        """Forces (n,) on the nodes, of forces and moments (k, components) on the points."""
        every = np.zeros((len(self.given.points), self.given.components))
        every[self.some] = forces
        return np.asarray(self._motions.T @ self.given.rows(every))

    def spread(self, force: Array, moment: Array) -> Array:
        """Forces and moments on the points (k, components) with a resultant: a force and a moment about their
        centre.

        Raises
        ------
        SceneError
            The points cannot carry it.
        """
        d, length = self.dim, self.given.length
        wanted = np.concatenate([force, np.asarray(moment) / length])
        motions = self.given.motions(self.centre)[self.some]
        weights = np.ones(self.given.components)
        weights[d:] = 0.0
        if np.linalg.matrix_rank(motions[:, :d].reshape(-1, motions.shape[2]), tol=1e-6) < motions.shape[2]:
            weights[d:] = length
        scaled = (motions * weights[:, None]).reshape(-1, motions.shape[2])
        found = np.linalg.lstsq(scaled.T, wanted, rcond=1e-9)[0]
        if np.abs(scaled.T @ found - wanted).max() > 1e-9 * np.abs(wanted).max():
            raise SceneError(
                f"{self.where}: its {len(self.some)} points cannot carry this moment: give points that are "
                "not on a line, or a matrix with rotations"
            )
        return np.asarray(found.reshape(len(self.some), -1) * weights)


@dataclass(frozen=True)
class PointSet:
    """A face of a part that is a matrix, as others see it. Plain data.

    Attributes
    ----------
    x, nodes
        (k, d) coordinates and (k,) numbers of its points.
    every
        (nodes of the part, d).
    what
        Its name, for messages.
    """

    x: Array
    nodes: Ints
    every: Array
    what: str

    @classmethod
    def of(cls, s: Substructure, face: str, where: str) -> PointSet:
        """A face of a part of this rank."""
        frames = frames_of(s)
        assert frames is not None
        some = _points_of(frames.given, face, where)
        return cls(frames.given.points[some], some, np.array(s.dof_coordinates), f"{s.name}:{face}")


@dataclass(frozen=True)
class LentFace(FaceCopy):
    """The face of a matrix.

    Attributes
    ----------
    facets
        (k,), which of the facets of the other face its facets are.
    """

    facets: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def drawn(self, interface: Interface) -> Interface:
        """An interface whose points are on these facets, told by those of the other face, which has a
        mesh."""
        side = interface.carrier
        return replace(interface, carrier=1 - side, facets=self.facets[interface.facets])


def facing(points: PointSet, other: FaceCopy, name: str, where: str) -> LentFace:
    """The face that points are, with the facets of a face that is at the same place, from the other side.

    Parameters
    ----------
    points
        They are nodes of the other face: all that its displacements have there, or those at the vertices.
    other, name
        The other face, and its name.
    where
        Prefix of error messages.

    Raises
    ------
    SceneError
        Points that are no nodes of the other face, or facets of which only some nodes are points.
    """
    d = points.x.shape[1]
    facets = FacetMap(other, "", where)
    least = _NEAR * float(facets.sizes.min())
    tree = spatial.cKDTree(points.x)
    nearest = spatial.cKDTree(other.coordinates[:, :d]).query(points.x)[0]
    for degree in dict.fromkeys((other.degree, 1)):
        cell, lagrange = basix.CellType[other.cell], basix.LagrangeVariant(other.lagrange)
        element = basix.create_element(basix.ElementFamily.P, cell, degree, lagrange)
        closure = np.array(element.entity_closure_dofs[d - 1])[other.local]
        if degree == other.degree:
            x = other.coordinates[other.dofs][:, :, :d]
        elif other.order == 1:  # on curved facets a rotation is not linear
            x = other.nodes
        else:
            continue
        off, at = tree.query(np.take_along_axis(x, closure[:, :, None], axis=1))
        whole = (off < least).all(axis=1)
        if len(np.unique(at[whole])) == len(points.x):
            dofs = np.full((int(whole.sum()), element.dim), points.nodes[0])
            np.put_along_axis(dofs, closure[whole], points.nodes[at[whole]], axis=1)
            return LentFace(
                cell=other.cell,
                order=other.order,
                variant=other.variant,
                nodes=_from_behind(other, whole),
                local=other.local[whole],
                degree=degree,
                lagrange=other.lagrange,
                dofs=dofs,
                coordinates=np.pad(points.every, ((0, 0), (0, 3 - d))),
                around=other.around,
                facets=np.flatnonzero(whole),
            )
    raise _unlike(points, nearest, least, name, where)


def _unlike(points: PointSet, nearest: Array, least: float, name: str, where: str) -> SceneError:
    """Why points are not those of a face; `nearest`: how far they are from its nodes."""
    beside = int(np.count_nonzero(nearest >= least))
    if beside:
        worst = int(np.argmax(nearest))
        place = ", ".join(f"{v:.6g}" for v in points.x[worst])
        return SceneError(
            f"{where}: {beside} of {len(points.x)} points of {points.what} are no nodes of {name}; the one "
            f"at ({place}) is {nearest[worst]:.4g} away: reduce the part to the nodes of {name}, or use "
            "scene.rigid or scene.beam"
        )
    return SceneError(
        f"{where}: the points of {points.what} are some of the nodes of facets of {name}: give all nodes of "
        "its displacements there (with degree 2 also those in the middle of edges), or use scene.rigid"
    )


def _from_behind(other: FaceCopy, whole: Array) -> Array:
    """(k, nodes per cell, d): cells on the other side of their facets, which stay where they are."""
    cell = basix.CellType[other.cell]
    variant = basix.LagrangeVariant(other.variant)
    element = basix.create_element(basix.ElementFamily.P, cell, other.order, variant)
    d = other.nodes.shape[2]
    closures = element.entity_closure_dofs[d - 1]
    corners = np.array(basix.topology(cell)[d - 1])
    out: Array = other.nodes[whole].copy()
    for number in np.unique(other.local[whole]):
        here = other.local[whole] == number
        beside = np.setdiff1d(np.arange(out.shape[1]), closures[number])
        middle = out[here][:, corners[number]].mean(axis=1, keepdims=True)
        out[np.ix_(here, beside)] = 2.0 * middle - out[np.ix_(here, beside)]
    return out


def at_points(spec: InterfaceSpec, s: Substructure) -> Interface:
    """A support, or a rigid group, of points; a support of all components holds their rotations as well.

    Raises
    ------
    SceneError
        Another law, which needs a face with an area.
    """
    where, face, law = f"interface {spec.name!r}", spec.faces[0], spec.law
    on = PointsOf(s, face.face, where)
    clamped = law.elimination is Elimination.TIED and not getattr(law, "plane", False)
    if isinstance(law, Displacement):
        clamped = law.components is None or len(law.components) == s.dim
    elif not clamped:
        raise SceneError(
            f"{where}: {law.title} needs a face with an area, and {face} are points of a matrix: fix them, "
            "join them to the nodes of a part with a mesh, or use scene.force, scene.springs, scene.beam"
        )
    nodes, m, d = on.some, len(on.given.points), s.dim
    if clamped:
        turning = np.flatnonzero(np.isin(on.given.turning, on.some))
        ends = [m + k * len(on.given.turning) + turning for k in range(d - 1)]
        nodes = np.concatenate([on.some, *ends])
    x, k = s.dof_coordinates[nodes], len(nodes)
    shape = sp.csr_matrix((np.ones(k), (np.arange(k), nodes)), shape=(k, s.size // d))
    normals = np.tile(np.eye(d)[0], (k, 1))
    side = Side(
        s.name,
        face.face,
        petsc_matrix(sp.kron(shape, sp.identity(d), "csr")),
        shape,
        nodes,
        normals,
        0.0,
        np.eye(d)[0],
        on.area,
    )
    return Interface(
        name=spec.name,
        law=law,
        points=read_only(x.copy()),
        weights=np.full(k, on.area / k),
        frames=np.tile(np.eye(d), (k, 1, 1)),
        gap=np.zeros(k),
        sides=(side,),
        matching=None,
        tangent_axis=1 % d,
        areas=sp.csr_matrix((0, k)),
        sag=np.zeros(k),
        chords=np.zeros(k),
        why="points of a matrix",
    )


def copy_of(s: Substructure, face: str, where: str) -> FaceCopy | PointSet:
    """What others need of a face."""
    return face_copy(s.part, face, s.space, where) if frames_of(s) is None else PointSet.of(s, face, where)


def lent_faces(
    scene: Scene,
    substructures: Mapping[str, Substructure],
    elsewhere: Mapping[tuple[str, int], FaceCopy | PointSet],
) -> dict[tuple[str, int], FaceCopy]:
    """Faces that are on other ranks, and faces of matrices, with the facets of the faces opposite."""
    out = {where: face for where, face in elsewhere.items() if isinstance(face, FaceCopy)}
    for name, joint in scene.interfaces.items():
        if len(joint.faces) == 1 or joint.remote is not None:
            continue
        where = f"interface {name!r}"
        both: list[FaceCopy | PointSet | None] = []
        for number, face in enumerate(joint.faces):
            there, s = elsewhere.get((name, number)), substructures.get(face.substructure)
            if there is None and s is not None:
                there = PointSet.of(s, face.face, where) if frames_of(s) is not None else None
            both.append(there)
        for number, points in enumerate(both):
            if not isinstance(points, PointSet):
                continue
            other, face = both[1 - number], joint.faces[1 - number]
            if isinstance(other, PointSet):
                raise SceneError(
                    f"{where}: {points.what} and {other.what} are both points of a matrix, between which "
                    "there is no face: join them by scene.rigid or scene.beam"
                )
            if other is None:
                meshed = substructures[face.substructure]
                other = face_copy(meshed.part, face.face, meshed.space, where)
            out[name, number] = facing(points, other, str(face), where)
    return out


_ABSURD = (1e-6, 1e3)
"""Stiffness of a matrix relative to that of a body of its size of a neighbour's material: a frame of thin
bars is that soft, and nothing is that stiff."""


def check_units(
    scene: Scene, substructures: Mapping[str, Substructure], parts: Mapping[str, PartSummary]
) -> None:
    """Warn of matrices beside which the parts that they are joined to have no stiffness, or all of it."""
    for joint in scene.interfaces.values():
        names = [face.substructure for face in joint.faces]
        for name, other in zip(names, names[::-1], strict=True):
            if name == other or frames_of(substructures.get(name)) is None:
                continue
            ratio = parts[name].modulus / parts[other].modulus
            if not _ABSURD[0] < ratio < _ABSURD[1]:
                warn(
                    f"interface {joint.name!r}: {name!r}, a matrix, is {ratio:.2g} times as stiff as a body "
                    f"of its size of the material of {other!r}: are both in the same units of force and "
                    "length?",
                    SceneWarning,
                )
