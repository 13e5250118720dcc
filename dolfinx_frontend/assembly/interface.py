"""An interface and its two sides, in the frames of its points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, SupportsIndex

import numpy as np

from dolfinx_frontend.assembly.elements import check_unchanged, csr, noted
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.common.model_limits import LIMITS
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.specs import Space

__all__ = ["Elasticity", "Interface", "PointFrames", "Side", "Vertices", "frames"]


class Elasticity(Protocol):
    """What a stiffness of a part is told by."""

    @property
    def modulus(self) -> float:
        """Force / area."""

    @property
    def length(self) -> float:
        """Length."""

    @property
    def around(self) -> bool:
        """Whether it is the section of a body of revolution."""


@dataclass(frozen=True, repr=False)
class Side:
    """One side of an interface.

    Attributes
    ----------
    substructure, face
        Names.
    trace
        T (d*m, n), petsc4py seqaij, no unit: w = T u in global components, row d*point + component,
        column d*node + component. To be read: an interface whose trace was written to is refused.
    shape
        The same for one component, (m, nodes of the substructure), SciPy. In the space ``"mortar"`` `trace`
        differs from it on curved faces along the normal: it has that of the place.
    nodes
        Nodes (blocks of unknowns) on the face, sorted.
    node_normals
        (len(nodes), d), area-weighted unit normals out of this side at those nodes.
    flatness
        Largest difference between a facet normal and their mean; 0 for a plane face.
    normal
        (d,), area-weighted mean unit normal out of this side (0 if the face is closed).
    area
        Area of the whole face; of a node, of a face as large as the cells.
    lever
        Displacement of the point where those of the face are 1 at most: 1, and 1 / length of a rotation.
    """

    substructure: str
    face: str
    trace: Any = field(repr=False)
    shape: sp.csr_matrix = field(repr=False)
    nodes: Ints = field(repr=False)
    node_normals: Array = field(repr=False)
    flatness: float
    normal: Array
    area: float
    lever: float = 1.0

    def __post_init__(self) -> None:
        locked(self)
        noted(self.trace)

    def __deepcopy__(self, memo: dict[int, Any]) -> Side:
        return self  # nothing in it changes

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        if self.trace is not None:
            raise TypeError(
                f"the side {self.substructure}:{self.face} of an interface cannot be pickled: its matrices "
                "live in this process; assemble its scene where it is needed"
            )
        return super().__reduce_ex__(protocol)

    def __repr__(self) -> str:
        return f"Side({self.substructure}:{self.face}, area {self.area:.6g}, {len(self.nodes)} nodes)"


_ONE_FACE = 0.5
"""Distance of two meshes of one face of curved cells, relative to their estimated sag, at most."""


@dataclass(frozen=True, repr=False)
class Vertices:
    """Values of points as a field that is linear (bilinear) on facets and continuous.

    Attributes
    ----------
    corners
        (k, vertices of a facet), numbers of vertices, of the covered facets.
    nodal
        (vertices, m), values at the vertices from those at the points.
    """

    corners: Ints
    nodal: sp.csr_matrix

    def __post_init__(self) -> None:
        locked(self)


class PointFrames:
    """What follows from the points (m, d), weights (m,) and frames (m, d, d) of an interface."""

    points: Array
    weights: Array
    frames: Array

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.points.shape[1])

    @property
    def num_points(self) -> int:
        """Number of interface points m."""
        return len(self.weights)

    @property
    def area(self) -> float:
        """Area of side 1, of its covered part if the sides overlap partly."""
        return float(self.weights.sum())

    @property
    def normals(self) -> Array:
        """(m, d), unit normals out of side 1."""
        return self.frames[:, 0, :]


@dataclass(frozen=True, repr=False)
class Interface(PointFrames):
    """One or two sides with a law, discretised.

    Attributes
    ----------
    points
        (m, d), on side 1, length.
    weights
        (m,), areas > 0; their sum is the area of side 1.
    frames
        (m, d, d), rows n (out of side 1), t1[, t2]; right-handed.
    gap
        (m,), distance from side 1 to side 2 along n as meshed, length; zeros for one side.
    sag
        (m,), how far the meshed faces may be from the smooth ones, length: an estimate from the kinks
        between facets, see :meth:`FacetMap.sags`.
    chords
        (m,), the same where facets are straight and the face is not; 0 elsewhere.
    one_point
        Whether it joins a node or the mean motions of faces: its weight is 1, its forces and jumps are those
        of the whole, and a jump may be a rotation.
    apart
        Distance of faces of curved cells that are taken as touching (:attr:`fits`), where their vertices tell
        one, length; negative: they are inside each other.
    matching
        None, or (nn, 2) nodes of side 1 and 2 at the same place, if the traces agree columnwise.
    tangent_axis
        Global axis whose projection is t1 (3D).
    space
        ``"points"``: values at quadrature points; ``"facets"``: means over the facets of side 1;
        ``"mortar"``: values at the vertices of the side that carries the multipliers.
    why
        Why it has this space, and this side carries it; empty if it was asked for.
    carrier
        Side whose facets the points are on, 0 or 1.
    facets
        (k,), facets of that side that are covered, ascending, numbered as in its :class:`FacetMap`.
    areas
        (k, m), area of each facet that belongs to each point.
    covered
        Fraction of side 1 that side 2 covers.
    wrench
        Of an interface that joins mean motions of faces by one point: the force (d,) and the moment about the
        point, (3,) or in 2D (1,), on side 1 that a force 1 stands for, one after the other; None: it has
        points.
    places, mean_normals
        (m, d), of ``"mortar"``: the mean place of each point's force, and the mean of the normal there, which
        is shorter than 1 on a curved face: what resultants are made of. None: the points, and their normals.
    vertices
        Of ``"mortar"``: the field of the points as one that is continuous; None: there is none.
    """

    name: str
    law: Law
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    frames: Array = field(repr=False)
    gap: Array = field(repr=False)
    sides: tuple[Side, ...]
    matching: Ints | None = field(repr=False)
    tangent_axis: int = field(repr=False)
    space: Space = "points"
    sag: Array = field(default_factory=lambda: np.zeros(1), repr=False)
    chords: Array = field(default_factory=lambda: np.zeros(1), repr=False)
    one_point: bool = False
    apart: float = field(default=0.0, repr=False)
    why: str = field(default="", repr=False)
    carrier: int = 0
    facets: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)
    areas: sp.csr_matrix = field(default_factory=lambda: sp.csr_matrix((0, 0)), repr=False)
    vertices: Vertices | None = field(default=None, repr=False)
    covered: float = 1.0
    wrench: Array | None = field(default=None, repr=False)
    places: Array | None = field(default=None, repr=False)
    mean_normals: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        locked(self)

    @property
    def cell_sizes(self) -> Array:
        """(m,), length: of the facets that the points are on."""
        sizes = np.asarray(self.areas.sum(axis=1)).ravel() ** (1.0 / max(self.dim - 1, 1))
        of_points = np.asarray(self.areas.sum(axis=0)).ravel()
        return np.asarray(self.areas.T @ sizes / np.maximum(of_points, np.finfo(float).tiny))

    @property
    def reach(self) -> Array:
        """(m,), length: how far each point may slide, a facet or 5 % of the face; pressures stay there."""
        face = float(np.linalg.norm(np.ptp(self.points, axis=0)))
        return np.minimum(self.cell_sizes, LIMITS.sliding * face if face > 0.0 else np.inf)

    def stiffness_unit(self, parts: Mapping[str, Elasticity], modulus: float | None = None) -> float:
        """Stiffness of the softer part in the unit of a spring of this interface.

        That is modulus / length per area. A point yields where it is: a face of size a takes a force with
        modulus * a (in 2D modulus), and a moment with a^2 times that (Boussinesq, but for a factor near 1).

        Parameters
        ----------
        parts
            Part -> its modulus and length.
        modulus
            Instead of those of the parts.
        """
        found = []
        for side in self.sides:
            part = parts[side.substructure]
            unit = part.modulus if modulus is None else modulus
            if self.one_point:
                d = 3 if part.around else self.dim
                unit *= float(side.area ** ((d - 2.0) / (d - 1.0)) / side.lever**2)
            else:
                unit /= part.length
            found.append(unit)
        return min(found)

    def check_unchanged(self) -> None:
        """Raise SceneError if somebody has written to a trace."""
        for side in self.sides:
            where = f"{side.substructure}:{side.face}"
            check_unchanged(side.trace, f"interface {self.name!r}: the trace of {where}")

    def __repr__(self) -> str:
        sides = " | ".join(f"{s.substructure}:{s.face}" for s in self.sides)
        return (
            f"Interface({self.name!r}, {sides}, {self.law!r}, {self.num_points} {self.space}, "
            f"area {self.area:.6g})"
        )

    @property
    def fits(self) -> bool:
        """Whether faces of curved cells are as near each other everywhere as meshes of one face would be.

        Measured (cylinders, spheres, tori, facets of 1 : 12): these are apart by up to 0.41 of the sag.
        """
        return not self.chords.any() and bool(np.all(np.abs(self.gap) <= _ONE_FACE * self.sag))

    @property
    def clearance(self) -> Array:
        """The gap without that of two meshes of one face, (m,), length.

        Two meshes of one round face have different chords, which cross: an interpenetration of their size is
        none. Where curved cells are nowhere farther apart than that, the faces touch: the distances between
        two meshes of one face, small as they are, would be contact pressures of a light load.
        """
        if self.fits:
            return np.zeros_like(self.gap)
        crossing = (self.gap < 0.0) & (self.gap >= -self.sag)
        return np.where(crossing, 0.0, self.gap)

    def local_trace(self, side: int) -> sp.csr_matrix:
        """T of side 0 or 1 in the local frame of side 1, (d*m, n).

        Raises
        ------
        SceneError
            No such side.
        """
        if side not in range(len(self.sides)):
            raise SceneError(f"interface {self.name!r}: side = {side!r} of {len(self.sides)}, from 0")
        d, m = self.dim, self.num_points
        turned = sp.bsr_matrix((self.frames, np.arange(m), np.arange(m + 1)), shape=(d * m, d * m))
        return (turned.tocsr() @ csr(self.sides[side].trace)).tocsr()


def frames(normals: Array, axis: int | None = None) -> tuple[Array, int]:
    """Orthonormal frames, rows n, t1[, t2].

    In 2D t1 is n turned by +90 degrees.  In 3D t1 is the projection of one global axis, the same
    for all points: the one that stays farthest from the normals, so that frames vary smoothly on
    planes, cylinders and cones.  Where the normal comes close to that axis (spheres) the next one
    is used.

    Parameters
    ----------
    normals
        (m, d), unit.
    axis
        Global axis for t1; None: chosen.

    Returns
    -------
    frames, axis
        (m, d, d), and the axis that was used.
    """
    m, d = normals.shape
    out = np.empty((m, d, d))
    out[:, 0] = normals
    if d == 2:
        out[:, 1] = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        return out, 0
    if axis is None:
        axis = int(np.argmin(np.round(np.abs(normals).max(axis=0), 6)))
    use = np.full(m, axis)
    use[np.abs(normals[:, axis]) > 0.99] = (axis + 1) % 3
    e = np.eye(3)[use]
    t = e - np.einsum("pi,pi->p", e, normals)[:, None] * normals
    out[:, 1] = t / np.linalg.norm(t, axis=1)[:, None]
    out[:, 2] = np.cross(normals, out[:, 1])
    return out, axis
