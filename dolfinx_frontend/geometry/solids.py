"""Solids of a model that is open in gmsh (OpenCASCADE), and their faces. Lengths are millimetres."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_numbers
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.vectors import unit

__all__ = ["Cut", "Loaded", "Solid", "Surface", "box_of", "faces_of", "matching", "near_pairs", "nearest",
           "solids_of", "surface_of", "vector"]

ROUNDING = 1e-9
"""Distance, relative to the size of a face, that counts as rounding."""

_SHARES = np.array([[u, v] for u in (0.05, 0.3, 0.6, 0.95) for v in (0.1, 0.4, 0.7, 0.9)])
"""Where a round face is looked at, in the range of its parameters."""

_FITTED = 1e-5
"""By as much a spline may be off the plane, cylinder or cone that it is, relative: rounding of files."""

POINTS_OF_EDGES = 5
"""Of each edge in a rim."""


@dataclass(frozen=True)
class Cut:
    """A plane that cuts solids in two, for a pretension section.

    The halves of ``"stud"`` are ``"stud-"`` and ``"stud+"``; the normal points from the first to the second.

    Attributes
    ----------
    parts
        Name or glob pattern of the solids.
    normal
        Of the plane.
    through
        A point of the plane; None: the middle of the bounding box of each solid.
    """

    parts: str
    normal: tuple[float, float, float]
    through: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.parts, str) or not self.parts:
            raise SceneError(f"Cut: parts = {short(self.parts)}; give the name of a part or a glob pattern")
        for name in ("normal", "through"):
            value = getattr(self, name)
            if value is None and name == "through":
                continue
            wanted = "give three coordinates"
            vector = checked_numbers("Cut", name, value, wanted, dimensions=1)
            if vector.shape != (3,) or (name == "normal" and not vector.any()):
                raise SceneError(f"Cut: {name} = {short(value)}: {wanted}, not all 0")
            object.__setattr__(self, name, tuple(float(x) for x in vector))


@dataclass(frozen=True)
class Surface:
    """One face of a solid.

    Attributes
    ----------
    part, tag
        Solid, and number of the face in gmsh.
    kind
        ``"plane"``, ``"cylinder"``, ``"cone"``, ``"sphere"``, ``"torus"`` or what gmsh calls it.
    area, centre
        Area and centre of gravity.
    low, high
        Corners of the bounding box.
    normal
        Unit normal out of the part; zero if the face is not plane.
    axis, radius
        Of a cylinder, the axis also of a cone; otherwise zero and None.
    origin
        A point of this axis.
    hollow
        Whether the material is outside of the cylinder or cone, as around a hole.
    rim
        (k, 3), points of its edges, their ends among them.
    points, normals
        (k, 3), points and outward normals of a face that is no plane, cylinder or cone.
    """

    part: str
    tag: int
    kind: str
    area: float
    centre: Array = field(repr=False)
    low: Array = field(repr=False)
    high: Array = field(repr=False)
    normal: Array = field(repr=False)
    axis: Array = field(repr=False)
    radius: float | None = None
    origin: Array = field(default_factory=lambda: np.zeros(3), repr=False)
    hollow: bool = False
    rim: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    points: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    normals: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)

    @property
    def shape(self) -> str:
        """What it looks like, in words."""
        if self.kind == "plane":
            return f"plane, normal {vector(self.normal)}"
        if self.kind == "cylinder":
            return f"cylinder, radius {self.radius:.4g}, axis {vector(self.axis)}"
        return self.kind


@dataclass(frozen=True)
class Solid:
    """One part: a solid, or one piece of a solid that was cut.

    Attributes
    ----------
    volume, area
        Volume, and area of all faces.
    low, high
        Corners of the bounding box.
    surfaces
        Its faces.
    label
        Name in the file of what it is (a piece of), if it was renamed; empty: it was not.
    """

    name: str
    volume: float
    area: float
    low: Array = field(repr=False)
    high: Array = field(repr=False)
    surfaces: tuple[Surface, ...] = field(repr=False)
    label: str = ""

    @property
    def thickness(self) -> float:
        """2 volume / area: the thickness of a plate, the radius of a bar."""
        return 2.0 * self.volume / self.area


@dataclass(frozen=True)
class Loaded:
    """Solids of a model that is open in gmsh.

    Attributes
    ----------
    volumes
        Name -> volumes.
    halves
        Pairs that were one solid.
    lost
        Solids that were not read, or not in full, in words.
    outside
        Names of other files that the file refers to; they were not read.
    threads
        Screw and the part with its thread -> depth to which they are drawn into each other, length.
    """

    volumes: dict[str, list[int]]
    halves: frozenset[tuple[str, str]]
    lost: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    threads: Mapping[tuple[str, str], float] = field(default_factory=dict)


def vector(v: Array) -> str:
    """A vector in few characters."""
    return "(" + ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in v) + ")"


def matching(pattern: str, names: Iterable[str], kind: str, where: str) -> list[str]:
    """Names that match a name or glob pattern.

    Raises
    ------
    SceneError
        None of them.
    """
    known = list(names)
    if not isinstance(pattern, str):
        raise unknown_name(kind, pattern, known, where)
    found = [pattern] if pattern in known else [n for n in known if fnmatch.fnmatchcase(n, pattern)]
    if not found:
        raise unknown_name(kind, pattern, known, where)
    return found


def box_of(occ: Any, dim: int, tag: int) -> tuple[Array, Array]:
    """Corners of the bounding box of a point, curve, face or solid."""
    box = np.asarray(occ.getBoundingBox(dim, tag))
    return box[:3], box[3:]


def near_pairs(boxes: Sequence[tuple[Array, Array]], reach: float) -> Iterator[tuple[int, int]]:
    """Pairs of boxes that are not further apart than `reach`."""
    low, high = (np.array(side) for side in zip(*boxes, strict=True))
    for i in range(len(boxes)):
        apart = np.maximum(low[i] - high[i + 1 :], low[i + 1 :] - high[i]).max(axis=1)
        for j in np.flatnonzero(apart <= reach):
            yield i, int(i + 1 + j)


def faces_of(model: Any, tags: Sequence[int]) -> list[int]:
    """Outer faces of some volumes that are one part."""
    return [abs(t) for _, t in model.getBoundary([(3, tag) for tag in tags], oriented=False)]


def parameters_of(model: Any, surface: int) -> Array:
    """Parameters (2,) of a point of a face, away from its rim if possible."""
    low, high = (np.asarray(v) for v in model.getParametrizationBounds(2, surface))
    for k in range(1, 400):
        # a sequence of points that fills the square evenly (Roberts' R2)
        share = np.mod(0.5 + k * np.array([0.7548776662466927, 0.5698402909980532]), 1.0)
        at = low + share * (high - low)
        if model.isInside(2, surface, at.tolist(), True):
            return np.asarray(at)
    return np.asarray(0.5 * (low + high))


def outward(model: Any, volumes: Sequence[int], surface: int) -> float:
    """1 if the normal of the surface points out of the part, otherwise -1.

    gmsh's normal of a face points out of the first solid that it was read with: only of a shared one this is
    not known.
    """
    if len(model.getAdjacencies(2, surface)[0]) == 1:
        return 1.0
    at = parameters_of(model, surface)
    x = np.asarray(model.getValue(2, surface, at.tolist()))
    n = np.asarray(model.getNormal(surface, at.tolist()))
    small = 1e-4 * math.sqrt(model.occ.getMass(2, surface))
    inside = any(model.isInside(3, v, (x + small * n).tolist()) for v in volumes)
    return -1.0 if inside else 1.0


def surface_of(model: Any, name: str, volumes: Sequence[int], tag: int) -> Surface:
    """A face of a part, measured; a spline that is a plane, cylinder or cone is one."""
    occ = model.occ
    kind = str(model.getType(2, tag)).lower()
    sign = outward(model, volumes, tag)
    low, high = box_of(occ, 2, tag)
    centre = np.asarray(occ.getCenterOfMass(2, tag))
    found = Surface(name, tag, kind, float(occ.getMass(2, tag)), centre, low, high, np.zeros(3), np.zeros(3))
    if kind == "plane":
        at = [0.0, 0.0]  # its normal is the same everywhere
        found = replace(found, normal=unit(sign * np.asarray(model.getNormal(tag, at))))
    else:
        least, most = (np.asarray(v) for v in model.getParametrizationBounds(2, tag))
        points = (least + _SHARES * (most - least)).ravel().tolist()
        x = np.asarray(model.getValue(2, tag, points)).reshape(-1, 3)
        n = sign * np.asarray(model.getNormal(tag, points)).reshape(-1, 3)
        tried = {"cylinder": _as_cylinder, "cone": _as_cone}
        ways = [tried[kind]] if kind in tried else [_as_plane, *tried.values()]
        fits = (fit for way in ways if (fit := way(found, x, n)) is not None)
        found = next(fits, replace(found, points=x, normals=n))
    return replace(found, rim=_rim(model, tag))


def _as_plane(surface: Surface, x: Array, n: Array) -> Surface | None:
    """All normals are one."""
    flat = float(np.ptp(n, axis=0).max()) < _FITTED
    flat = flat and float(np.ptp((x - x[0]) @ n[0])) < _FITTED * float(np.ptp(x, axis=0).max())
    return replace(surface, kind="plane", normal=unit(n.mean(axis=0))) if flat else None


def _as_cylinder(surface: Surface, x: Array, n: Array) -> Surface | None:
    """All normals are across an axis, and meet on it."""
    _, sizes, axes = np.linalg.svd(n)
    if sizes[2] > _FITTED * sizes[0]:
        return None
    axis = axes[2] * (1.0 if axes[2][np.argmax(np.abs(axes[2]))] > 0.0 else -1.0)
    across = x - np.outer((x - x[0]) @ axis, axis)
    # the centre c of x = c + r n, where r is negative in a hole
    middle, normal = across.mean(axis=0), n.mean(axis=0)
    r = float(np.vdot(across - middle, n - normal) / np.vdot(n - normal, n - normal))
    origin = middle - r * normal
    if float(np.linalg.norm(across - origin - r * n, axis=1).max()) > _FITTED * abs(r):
        return None
    return replace(surface, kind="cylinder", axis=axis, radius=abs(r), origin=origin, hollow=r < 0.0)


def _as_cone(surface: Surface, x: Array, n: Array) -> Surface | None:
    """All normals make one angle with an axis, and all tangent planes meet in its apex."""
    _, sizes, rows = np.linalg.svd(np.column_stack([n, np.ones(len(n))]))
    length = float(np.linalg.norm(rows[3][:3]))
    if sizes[3] > _FITTED * sizes[0] or not length:
        return None
    axis = rows[3][:3] / length
    apex = np.linalg.lstsq(n, np.einsum("ij,ij->i", n, x), rcond=None)[0]
    if float(np.abs(np.einsum("ij,ij->i", n, x - apex)).max()) > _FITTED * float(np.ptp(x, axis=0).max()):
        return None
    across = x[0] - apex - ((x[0] - apex) @ axis) * axis
    return replace(surface, kind="cone", axis=axis, origin=apex, hollow=bool(n[0] @ across < 0.0))


def _rim(model: Any, tag: int) -> Array:
    """Points of the edges of a face."""
    found = []
    for _, curve in model.getBoundary([(2, tag)], combined=False, oriented=False):
        low, high = (float(v[0]) for v in model.getParametrizationBounds(1, abs(curve)))
        at = np.linspace(low, high, POINTS_OF_EDGES)
        found.append(np.asarray(model.getValue(1, abs(curve), at.tolist())).reshape(-1, 3))
    return np.concatenate(found) if found else np.zeros((0, 3))


def solids_of(model: Any, loaded: Loaded) -> dict[str, Solid]:
    """Every part of a loaded model with its faces."""
    out, known = {}, dict[int, Surface]()
    for name, tags in loaded.volumes.items():
        surfaces = tuple(
            _other_side(known[tag], name) if tag in known else surface_of(model, name, tags, tag)
            for tag in sorted(faces_of(model, tags))
        )
        known |= {s.tag: s for s in surfaces}
        boxes = [box_of(model.occ, 3, tag) for tag in tags]
        out[name] = Solid(
            name,
            float(sum(model.occ.getMass(3, tag) for tag in tags)),
            sum(s.area for s in surfaces),
            np.min([b[0] for b in boxes], axis=0),
            np.max([b[1] for b in boxes], axis=0),
            surfaces,
        )
    return out


def _other_side(surface: Surface, name: str) -> Surface:
    """A face that two parts share, as the second one has it."""
    hollow = surface.kind in ("cylinder", "cone") and not surface.hollow
    return replace(surface, part=name, normal=-surface.normal, normals=-surface.normals, hollow=hollow)


def nearest(
    model: Any, loaded: Loaded, solids: Mapping[str, Solid], names: Sequence[str], gap: float, most: int = 5
) -> list[str]:
    """Sentences that name the parts that are nearest to each other, by exact distances.

    What is within `gap`, but was not found to face each other, meets in a point or along a line.
    """
    everyone = list(solids)
    low = np.array([s.low for s in solids.values()])
    high = np.array([s.high for s in solids.values()])
    found: dict[tuple[str, str], float] = {}
    for name in names:
        i = everyone.index(name)
        apart = np.linalg.norm(np.maximum(np.maximum(low[i] - high, low - high[i]), 0.0), axis=1)
        apart[i] = np.inf
        for j in np.argsort(apart)[: min(most, len(everyone) - 1)]:
            a, b = sorted((i, int(j)))
            key = (everyone[a], everyone[b])
            if key not in found:
                found[key] = min(
                    float(model.occ.getDistance(3, v, 3, w)[0])
                    for v in loaded.volumes[key[0]]
                    for w in loaded.volumes[key[1]]
                )
    ranked = sorted(found.items(), key=lambda item: item[1])[:most]
    return [
        f"{a!r} and {b!r} are {d:.4g} apart" + (", in a point or along a line only" if d <= gap else "")
        for (a, b), d in ranked
    ]
