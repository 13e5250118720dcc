"""Interfaces without facets: a node of a part, a sum of displacements of nodes, the mean rigid motions of
one or two faces (RBE3), or points of a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.interface import Interface, Side
from dolfinx_frontend.assembly.matrix_part import PointsOf, at_points, frames_of
from dolfinx_frontend.assembly.part_loads import FaceOf, cross, face_of, fitting
from dolfinx_frontend.assembly.substructure import NEAR, Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.model_limits import LIMITS, beyond
from dolfinx_frontend.scene.laws import Preload
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import Face, InterfaceSpec, Remote

__all__ = ["check_cold", "remote_interface"]

FLAT, OBLIQUE = 0.95, 0.94
"""Size of the mean normal of a face below which it is a hole or a bend, and its cosine with the axis of a
bolt below which no washer makes up for it: 20 degrees."""

FAR = 2.0
"""Factor between clamped length and distance of the faces: with thread in a tapped hole it is below."""


def remote_interface(spec: InterfaceSpec, parts: tuple[Substructure, ...]) -> Interface:
    """The interface, of parts on this rank.

    Raises
    ------
    SceneError
        No node at the point, or vectors of another dimension.
    """
    remote = spec.remote
    if remote is None:
        return at_points(spec, parts[0])
    if remote.node is not None:
        return _at_node(spec, parts[0], remote.node, remote.nearest)
    if remote.sums:
        return _of_sums(spec, parts, remote)
    d = parts[0].dim
    sides: list[Side] = []
    wrench: Array = np.zeros(0)
    where: Array = np.zeros(d)
    if remote.beam:
        remote = _of_beam(spec, remote.beam, parts)
    for number, (face, s) in enumerate(zip(spec.faces, parts, strict=True)):
        side, of_side, point = _mean_motion(spec, s, face, remote, number)
        sides.append(side)
        if number == 0:
            wrench, where = of_side, point
            if not remote.beam and len(parts) == 2:  # springs are at one place, or they would turn the parts
                remote = replace(remote, points=(tuple(point), tuple(point)))
    return _made(spec, tuple(sides), where, wrench)


def check_cold(scene: Scene) -> None:
    """Warn of bolts that are beams, which have no temperature, between parts that have one."""
    warm = {load.part for load in scene.loads.values() if load.kind == "temperature"}
    cold = [
        name.removesuffix(".axial")
        for name, spec in scene.interfaces.items()
        if spec.remote is not None and spec.remote.beam == "axial"
        and spec.law.bolt and not spec.law.given("shortening")
        and all(face.substructure in warm for face in spec.faces)
    ]  # fmt: skip
    if cold:
        more = f" and {len(cold) - 1} more" if cold[1:] else ""
        warn(
            f"beam {cold[0]!r}{more}: its parts get warm, a beam has no temperature and keeps its length: "
            "what it would grow is Preload(..., shortening=-alpha * dT * L), times the Amplitude of dT; 0.0 "
            "says that it stays cold",
            SceneWarning,
        )


def _oblique(where: str, along: Array, faces: Sequence[FaceOf | PointsOf], names: Sequence[Face]) -> None:
    """Warn of a bolt that is not square to the faces under its head and nut."""
    cosines = []
    for face in faces:
        normal = face.weights @ face.normals / face.area if isinstance(face, FaceOf) else along
        size = float(np.linalg.norm(normal))
        cosines.append(abs(float(normal @ along)) / size if size > FLAT else 1.0)
    worst = int(np.argmin(cosines))
    if cosines[worst] < OBLIQUE:
        warn(
            f"{where}: the bolt is {np.degrees(np.arccos(cosines[worst])):.0f} degrees off the normal of "
            f"'{names[worst]}', on which its head or nut lies: is that the face, and at its place?",
            SceneWarning,
        )


def _check_stretch(where: str, law: Preload, length: float) -> None:
    """Warn of a preload that no bolt has, in strain: a unit is wrong."""
    force = law.given_force()
    if force is None or law.stiffness is None or not is_real(law.stiffness):
        return
    strain = force / (float(law.stiffness) * length)
    said = f"{where}: tightened to {force:.4g} the bolt is {strain:.2g} of its length {length:.4g} longer"
    if strain > LIMITS.strain:
        beyond(f"{said}, more than {LIMITS.strain:.0%}: are force or torque, stiffness and mesh in one unit?")
    elif law.torque is not None and 0.0 < strain < LIMITS.slack:
        beyond(f"{said}: is the torque in N m, with a mesh in mm? Then it is 1000 times as large")


def _of_beam(spec: InterfaceSpec, way: str, parts: tuple[Substructure, ...]) -> Remote:
    """Forces and moments at both ends of one deformation of a beam.

    Its bending energy is E I / 2 L (theta2 - theta1)^2 + 6 E I / L ((theta1 + theta2) / 2 - dv / L)^2.
    """
    where, d = f"interface {spec.name!r}", parts[0].dim
    faces = [face_of(s, face.face, where) for face, s in zip(spec.faces, parts, strict=True)]
    ends = [face.centre for face in faces]
    length = float(np.linalg.norm(ends[1] - ends[0]))
    size = max(s.length for s in parts)
    if length < 1e-6 * size:
        raise SceneError(f"{where}: the centroids of its faces coincide; a beam has a length > 0")
    along = np.zeros(3)
    along[:d] = (ends[1] - ends[0]) / length
    clamped = None if spec.remote is None else spec.remote.clamped
    if way == "axial" and clamped is not None and not clamped / FAR < length < clamped * FAR:
        beyond(
            f"{where}: its stiffness is that of a bolt that clamps {clamped:.4g}, its faces are {length:.4g} "
            "apart: give shank= and thread= of this one, in the unit of the mesh"
        )
    if way == "axial" and spec.law.bolt:
        _oblique(where, along[:d], faces, spec.faces)
        if isinstance(spec.law, Preload):
            _check_stretch(where, spec.law, length)
    # rounding must not choose between axes that are alike
    helper = np.eye(3)[2 if d == 2 else int(np.argmin(np.round(np.abs(along), 6)))]
    first = helper - (helper @ along) * along
    first /= np.linalg.norm(first)
    about = {"1": first, "2": np.cross(along, first)}.get(way[-1], along)
    nothing: Array = np.zeros(3)
    rows: tuple[tuple[Array, Array], ...]
    if way == "axial":
        rows = ((along, nothing), (along, nothing))
    elif way == "torsion" or way.startswith("bending"):
        rows = ((nothing, about), (nothing, about))
    else:
        slope = -np.cross(about, along) / length
        rows = ((slope, -0.5 * about), (slope, 0.5 * about))
    return Remote(
        points=(None, None),
        forces=tuple(tuple(map(float, force)) for force, _ in rows),
        moments=tuple(tuple(map(float, moment)) for _, moment in rows),
        beam=way,
    )


def _made(
    spec: InterfaceSpec, sides: tuple[Side, ...], point: Array, wrench: Array | None, why: str = ""
) -> Interface:
    d = len(point)
    return Interface(
        name=spec.name,
        law=spec.law,
        points=point[None].copy(),
        weights=np.ones(1),
        frames=np.eye(d)[None].copy(),
        gap=np.zeros(1),
        sides=sides,
        matching=None,
        tangent_axis=1 % d,
        areas=sp.csr_matrix((0, 1)),
        one_point=True,
        why=why or _why(spec),
        wrench=wrench,
    )


def _why(spec: InterfaceSpec) -> str:
    assert spec.remote is not None
    if spec.remote.beam:
        return "a beam between the mean motions of two faces"
    if spec.remote.sums:
        return "a sum of displacements of nodes"
    return "the mean motion of a face"


def _node(
    where: str, s: Substructure, place: tuple[float, ...], nearest: bool | None = None
) -> tuple[int, float]:
    """A node at a place, or the nearest one within the size of its cells; and how far it is.

    `nearest` is None where that is no choice.
    """
    point = fitting(where, "point", place, s.dim)
    away = np.linalg.norm(s.dof_coordinates - point, axis=1)
    node = int(np.argmin(away))
    size = float(np.ptp(s.dof_coordinates, axis=0).max())
    wide = _wide(s, node) if nearest else 0.0
    if away[node] > max(NEAR * size, wide):
        near = ", ".join(f"{v:.6g}" for v in s.dof_coordinates[node])
        beyond = f", more than its cells are large ({wide:.4g})" if wide else ""
        remedy = "give that, nearest=True, or fix a face" if nearest is False else "give that, or fix a face"
        raise SceneError(
            f"{where}: there is no node of {s.name!r} at ({', '.join(f'{v:.6g}' for v in point)}); the "
            f"nearest one is at ({near}), {away[node]:.4g} away{beyond}: {remedy}"
        )
    return node, float(away[node])


def _wide(s: Substructure, node: int) -> float:
    """How large the cells around a node are; 0 in a matrix, which has none."""
    if frames_of(s) is not None:
        return 0.0
    cells = np.asarray(s.space.dofmap.list)
    around = cells[(cells == node).any(axis=1)]
    return float(np.linalg.norm(np.ptp(s.dof_coordinates[around], axis=1), axis=1).max())


def _of_cells(s: Substructure) -> float:
    """Area of a face as large as the cells."""
    d = 3 if s.around else s.dim
    return float((s.volume / (s.size // s.dim)) ** ((d - 1.0) / d))


def _at_node(spec: InterfaceSpec, s: Substructure, place: tuple[float, ...], nearest: bool) -> Interface:
    node, away = _node(f"interface {spec.name!r}", s, place, nearest)
    count = s.size // s.dim
    shape = sp.csr_matrix((np.ones(1), (np.zeros(1, dtype=int), np.array([node]))), shape=(1, count))
    trace = sp.kron(shape, sp.identity(s.dim), "csr")
    side = _side(s, spec.faces[0], trace, shape, np.array([node]), _of_cells(s))
    x = s.dof_coordinates[node].copy()
    at = ", ".join(f"{v:.6g}" for v in x)
    why = f"the node at ({at}), {away:.4g} from its point" if nearest else "a node"
    return _made(spec, (side,), x, None, why)


def _of_sums(spec: InterfaceSpec, parts: tuple[Substructure, ...], remote: Remote) -> Interface:
    """Its jump is the sum: side 1 enters it with the opposite sign."""
    d, where = parts[0].dim, f"interface {spec.name!r}"
    sides, place, wrench = [], np.zeros(d), np.zeros(0)
    for number, (face, s, terms) in enumerate(zip(spec.faces, parts, remote.sums, strict=True)):
        row = np.zeros((s.size // d, d))
        vectors = (2.0 * number - 1.0) * np.array([fitting(where, "direction", v, d) for _, v in terms])
        np.add.at(row, [_node(where, s, x)[0] for x, _ in terms], vectors)
        x = np.array([x for x, _ in terms])
        if number == 0:
            place = x.mean(axis=0)
            moment = cross(x - place, vectors).reshape(len(x), -1).sum(axis=0)
            wrench = np.concatenate([vectors.sum(axis=0), moment])
        sides.append(_row(s, face, _of_cells(s), row.ravel(), wrench, place)[0])
    return _made(spec, tuple(sides), place, wrench)


def _side(s: Substructure, face: Face, trace: Any, shape: sp.csr_matrix, nodes: Any, area: float) -> Side:
    d = s.dim
    normals = np.tile(np.eye(d)[0], (len(nodes), 1))
    lever = float(abs(trace).sum(axis=1).max())
    normal = np.eye(d)[0].copy()
    return Side(s.name, face.face, petsc_matrix(trace), shape, nodes, normals, 0.0, normal, area, lever)


def _mean_motion(
    spec: InterfaceSpec, s: Substructure, face: Face, remote: Remote, number: int
) -> tuple[Side, Array, Array]:
    """A side, its force and moment (about the point), and the point."""
    where, d = f"interface {spec.name!r}", s.dim
    own = face_of(s, face.face, where)
    if s.around:
        force, moment = np.array(remote.forces[number]), np.array(remote.moments[number])
        if moment.any() or force[[0, 2]].any():
            raise SceneError(f"{where}: an axisymmetric part has springs along y (its axis) only")
        row = own.nodal(np.tile([0.0, force[1] / own.area], (len(own.x), 1)))
        return _row(s, face, own.area, row, np.array([0.0, force[1], 0.0]), own.centre)
    given = remote.points[number]
    point = own.centre if given is None else fitting(where, "point", given, d)
    force, moment = np.array(remote.forces[number]), np.array(remote.moments[number])
    if d == 2:
        if force[2:].any() or moment[:2].any():
            raise SceneError(f"{where}: a part in two dimensions has the motions x, y and rz")
        force, moment = force[:2], moment[2:]
    about = moment + np.reshape(cross(point - own.centre, force), -1)
    row = own.nodal(own.spread(force, about))
    return _row(s, face, own.area, row, np.concatenate([force, moment]), np.array(point))


def _row(
    s: Substructure, face: Face, area: float, row: Array, wrench: Array, point: Array
) -> tuple[Side, Array, Array]:
    """A side whose displacement is a row (n,) times the unknowns, its wrench, and the point."""
    d = s.dim
    touched = np.flatnonzero(np.any(row.reshape(-1, d) != 0.0, axis=1))
    columns = np.flatnonzero(row)
    trace = sp.csr_matrix((row[columns], (np.zeros(len(columns), dtype=int), columns)), shape=(d, s.size))
    nothing = sp.csr_matrix((1, s.size // d))
    return _side(s, face, trace, nothing, touched, area), wrench, point
