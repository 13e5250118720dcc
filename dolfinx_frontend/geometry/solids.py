"""Solids of a STEP file: their names, the faces where they touch, how near others are (gmsh's OpenCASCADE).

Touching faces are found by the general fuse of all solids (``occ.fragment``): it leaves one face where two
solids meet, so that areas and normals are exact and the meshes of both match node for node. Faces that
nearly touch are triangulated; the triangles of one are clipped against those of the other, and the
distances are taken between the exact surfaces.

Lengths are millimetres, whatever the unit of the file: OpenCASCADE converts.
"""

from __future__ import annotations

import fnmatch
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.clipping import clip
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = [
    "Cut",
    "Kind",
    "Loaded",
    "Solid",
    "Surface",
    "Touch",
    "load",
    "matching",
    "nearest",
    "solids_of",
    "touching",
    "vector",
]

Kind = Literal["touching", "near", "cut"]

_OPPOSED = -0.5
"""Two faces face each other where the product of their outward normals is below this."""

_SLIVER = 1e-6
"""Share of a face below which a pair of faces is not worth an interface."""

_ROUNDING = 1e-9
"""Distance, as a share of the size of a face, that is rounding."""

_GENERIC = re.compile(r"open cascade.*|shapes?|(solid|compound|part)?[ _]?\d*", re.IGNORECASE)
"""Labels that are no names that anyone gave."""


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
        Of a cylinder; otherwise zero and None.
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
    """One part: a solid, or what a cut left of it.

    Attributes
    ----------
    volume, area
        Volume, and area of all faces.
    low, high
        Corners of the bounding box.
    surfaces
        Its faces.
    """

    name: str
    volume: float
    area: float
    low: Array = field(repr=False)
    high: Array = field(repr=False)
    surfaces: tuple[Surface, ...] = field(repr=False)

    @property
    def thickness(self) -> float:
        """2 volume / area: the thickness of a plate, the radius of a bar."""
        return 2.0 * self.volume / self.area


@dataclass(frozen=True)
class Touch:
    """Faces of two parts that touch or nearly do.

    Attributes
    ----------
    name
        ``"first|second"``; ``"first|second#2"`` for a second group of faces of the same two parts.
    parts
        The two parts; the normal points out of the first.
    kind
        ``"touching"``, ``"near"``, or ``"cut"`` for the two halves of a solid.
    surfaces
        Numbers of the faces of each.
    area
        Area on which they face each other.
    gap, widest
        Mean and largest distance there, length.
    normal
        Mean unit normal; zero if the face closes on itself.
    shape
        Kind of face, in words.
    """

    name: str
    parts: tuple[str, str]
    kind: Kind
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    area: float
    gap: float
    widest: float
    normal: Array = field(repr=False)
    shape: str = ""


@dataclass(frozen=True)
class Loaded:
    """Solids of a model that is open in gmsh: name -> volumes, and the pairs that were one solid."""

    volumes: dict[str, list[int]]
    halves: frozenset[tuple[str, str]]


def vector(v: Array) -> str:
    """A vector in few characters."""
    return "(" + ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in v) + ")"


# ---------------------------------------------------------------------------------------------
# Reading
# ---------------------------------------------------------------------------------------------
def load(
    gmsh: Any, path: Path, cuts: Sequence[Cut], imprint: bool, tolerance: float | None
) -> Loaded:
    """Import a STEP file into the current model, cut solids, and fuse those that touch.

    Raises
    ------
    SceneError
        No such file, not STEP, no solids in it, a cut that does not cut in two, solids that overlap.
    """
    if not path.is_file():
        raise SceneError(f"there is no STEP file {str(path)!r}")
    occ, model = gmsh.model.occ, gmsh.model
    with path.open("rb") as file:
        start = file.read(4096)
    if b"ISO-10303-21" not in start:
        raise SceneError(
            f"{path.name!r} cannot be read as STEP: it does not begin with ISO-10303-21 (an exchange file "
            "of ISO 10303-21 does); export it as STEP AP203, AP214 or AP242"
        )
    try:
        shapes = occ.importShapes(str(path), highestDimOnly=True, format="step")
        occ.synchronize()
    except Exception as failure:  # gmsh raises nothing more specific
        raise SceneError(f"{path.name!r} cannot be read as STEP ({failure}); export it again") from failure
    tags = [tag for dim, tag in shapes if dim == 3]
    if not tags:
        found = f"{len(shapes)} faces or curves" if shapes else "nothing"
        raise SceneError(
            f"{path.name!r} cannot be modelled: it holds no solid, but {found}; export solids, not surfaces"
        )
    names = _names([model.getEntityName(3, tag) for tag in tags])
    volumes = dict(zip(names, tags, strict=True))
    volumes, halves = _cut(gmsh, volumes, cuts)
    if tolerance is not None:
        gmsh.option.setNumber("Geometry.ToleranceBoolean", tolerance)
    if not imprint or len(volumes) == 1:
        _refuse_intersections(gmsh, volumes)
        return Loaded({name: [tag] for name, tag in volumes.items()}, halves)
    return Loaded(_fuse(gmsh, volumes), halves)


def _names(labels: Sequence[str]) -> list[str]:
    """Names from labels of the form ``Shapes/assembly/instance/product``; numbered where they repeat."""
    found = []
    for label in labels:
        levels = [level.strip() for level in label.split("/")]
        name = "" if _GENERIC.fullmatch(levels[-1]) else levels[-1]
        # a colon and a bar separate parts and faces in the names of this package
        found.append(name.replace(":", ".").replace("|", "-") or "part")
    counts = {name: found.count(name) for name in found}
    taken = {name for name in found if counts[name] == 1}
    numbers = dict.fromkeys(found, 0)
    out = []
    for name in found:
        unique = name
        while counts[name] > 1 and (unique == name or unique in taken):
            numbers[name] += 1
            unique = f"{name} {numbers[name]}"
        taken.add(unique)
        out.append(unique)
    return out


def matching(pattern: str, names: Iterable[str], kind: str, where: str) -> list[str]:
    """Names that a name or glob pattern stands for.

    Raises
    ------
    SceneError
        None of them.
    """
    known = list(names)
    found = [pattern] if pattern in known else [n for n in known if fnmatch.fnmatchcase(n, pattern)]
    if not found:
        raise unknown_name(kind, pattern, known, where)
    return found


def _cut(
    gmsh: Any, volumes: Mapping[str, int], cuts: Sequence[Cut]
) -> tuple[dict[str, int], frozenset[tuple[str, str]]]:
    """Solids with some of them cut in two."""
    occ = gmsh.model.occ
    chosen: dict[str, Cut] = {}
    for cut in cuts:
        for name in matching(cut.parts, volumes, "part", "cut"):
            chosen[name] = cut
    out: dict[str, int] = {}
    halves = set()
    for name, tag in volumes.items():
        if name not in chosen:
            out[name] = tag
            continue
        normal = np.asarray(chosen[name].normal, dtype=np.float64)
        length = float(np.linalg.norm(normal)) if normal.shape == (3,) else 0.0
        if not length > 0.0:
            raise SceneError(f"cut of {name!r}: normal = {chosen[name].normal!r}; give three numbers")
        normal /= length
        low, high = _box(occ, 3, tag)
        point = chosen[name].through
        centre = 0.5 * (low + high) if point is None else np.asarray(point, dtype=np.float64)
        radius = float(np.linalg.norm(high - low) + np.linalg.norm(centre - 0.5 * (low + high)))
        disc = occ.addDisk(*centre, radius, radius, zAxis=normal.tolist())
        _, pieces = occ.fragment([(3, tag)], [(2, disc)])
        solids = [t for d, t in pieces[0] if d == 3]
        if len(solids) != 2:
            raise SceneError(
                f"cut of {name!r}: the plane through {vector(centre)} with normal {vector(normal)} leaves "
                f"{len(solids)} pieces, not two; move it"
            )
        solids.sort(key=lambda t: float(np.dot(occ.getCenterOfMass(3, t), normal)))
        inside = {f for t in solids for _, f in _boundary(occ, gmsh.model, t)}
        rest = [(d, t) for d, t in pieces[1] if d == 2 and t not in inside]
        occ.remove(rest, recursive=True)
        out[f"{name}-"], out[f"{name}+"] = solids
        halves.add((f"{name}-", f"{name}+"))
    occ.synchronize()
    return out, frozenset(halves)


def _boundary(occ: Any, model: Any, volume: int) -> list[tuple[int, int]]:
    occ.synchronize()
    return [(2, abs(t)) for _, t in model.getBoundary([(3, volume)], oriented=False)]


def _box(occ: Any, dim: int, tag: int) -> tuple[Array, Array]:
    box = np.asarray(occ.getBoundingBox(dim, tag))
    return box[:3], box[3:]


def _overlapping(overlaps: Mapping[tuple[str, str], float], volumes: Mapping[str, float]) -> SceneError:
    """The error for solids that overlap: which, and how much."""
    worst = sorted(overlaps.items(), key=lambda item: -item[1])
    lines = [
        f"{a!r} and {b!r} by {v:.4g} ({100 * v / min(volumes[a], volumes[b]):.3g} % of the smaller one)"
        for (a, b), v in worst[:6]
    ]
    more = f", and {len(worst) - 6} pairs more" if len(worst) > 6 else ""
    return SceneError(
        f"solids overlap: {'; '.join(lines)}{more} (volumes in mm^3); mend the geometry, and give an "
        "interference as the gap of a contact"
    )


def _fuse(gmsh: Any, volumes: Mapping[str, int]) -> dict[str, list[int]]:
    """General fuse: solids that touch share a face afterwards."""
    occ = gmsh.model.occ
    sizes = {name: occ.getMass(3, tag) for name, tag in volumes.items()}
    bodies = [(3, tag) for tag in volumes.values()]
    try:
        _, pieces = occ.fragment(bodies[:1], bodies[1:])
        occ.synchronize()
    except Exception as failure:  # gmsh raises nothing more specific
        raise SceneError(
            f"OpenCASCADE cannot join the touching faces of {', '.join(volumes)} ({failure}); give "
            "imprint=False, or a tolerance"
        ) from failure
    owners: dict[int, list[str]] = {}
    for name, piece in zip(volumes, pieces, strict=True):
        for dim, tag in piece:
            if dim == 3:
                owners.setdefault(tag, []).append(name)
    overlaps: dict[tuple[str, str], float] = {}
    for tag, names in owners.items():
        for i, a in enumerate(names):
            for b in names[i + 1 :]:
                overlaps[a, b] = overlaps.get((a, b), 0.0) + occ.getMass(3, tag)
    if overlaps:
        raise _overlapping(overlaps, sizes)
    out: dict[str, list[int]] = {name: [] for name in volumes}
    for tag, names in owners.items():
        out[names[0]].append(tag)
    return out


def _near_pairs(boxes: Sequence[tuple[Array, Array]], reach: float) -> Iterator[tuple[int, int]]:
    """Pairs of boxes that are not further apart than `reach`."""
    low, high = (np.array(side) for side in zip(*boxes, strict=True))
    for i in range(len(boxes)):
        apart = np.maximum(low[i] - high[i + 1 :], low[i + 1 :] - high[i]).max(axis=1)
        for j in np.flatnonzero(apart <= reach):
            yield i, int(i + 1 + j)


def _refuse_intersections(gmsh: Any, volumes: Mapping[str, int]) -> None:
    """Raise if solids that stay as they are overlap."""
    occ = gmsh.model.occ
    names, tags = list(volumes), list(volumes.values())
    overlaps = {}
    for i, j in _near_pairs([_box(occ, 3, tag) for tag in tags], 0.0):
        common, _ = occ.intersect([(3, tags[i])], [(3, tags[j])], removeObject=False, removeTool=False)
        volume = sum(occ.getMass(3, tag) for dim, tag in common if dim == 3)
        if volume > 0.0:
            overlaps[names[i], names[j]] = volume
        if common:
            occ.remove(common, recursive=True)
    if overlaps:
        raise _overlapping(overlaps, {n: occ.getMass(3, t) for n, t in volumes.items()})
    occ.synchronize()


# ---------------------------------------------------------------------------------------------
# Faces
# ---------------------------------------------------------------------------------------------
def _faces(model: Any, tags: Sequence[int]) -> list[int]:
    """Outer faces of some volumes that are one part."""
    return [abs(t) for _, t in model.getBoundary([(3, tag) for tag in tags], oriented=False)]


def _parameters(model: Any, surface: int) -> Array:
    """Parameters (2,) of a point of a face, away from its rim if possible."""
    low, high = (np.asarray(v) for v in model.getParametrizationBounds(2, surface))
    for k in range(1, 400):
        # a sequence of points that fills the square evenly (Roberts' R2)
        share = np.mod(0.5 + k * np.array([0.7548776662466927, 0.5698402909980532]), 1.0)
        at = low + share * (high - low)
        if model.isInside(2, surface, at.tolist(), True):
            return np.asarray(at)
    return np.asarray(0.5 * (low + high))


def _outward(model: Any, volumes: Sequence[int], surface: int, at: Array) -> float:
    """1 if the normal of the surface points out of the part, otherwise -1."""
    x = np.asarray(model.getValue(2, surface, at.tolist()))
    n = np.asarray(model.getNormal(surface, at.tolist()))
    small = 1e-4 * math.sqrt(model.occ.getMass(2, surface))
    inside = any(model.isInside(3, v, (x + small * n).tolist()) for v in volumes)
    return -1.0 if inside else 1.0


def _surface(model: Any, name: str, volumes: Sequence[int], tag: int) -> Surface:
    occ = model.occ
    kind = str(model.getType(2, tag)).lower()
    at = _parameters(model, tag)
    normal: Array = np.zeros(3)
    axis: Array = np.zeros(3)
    radius: float | None = None
    if kind == "plane":
        n = np.asarray(model.getNormal(tag, at.tolist()))
        normal = _tidy(_outward(model, volumes, tag, at) * n)
    elif kind == "cylinder":
        largest, smallest, across, along = model.getPrincipalCurvatures(tag, at.tolist())
        curved = abs(largest[0]) > abs(smallest[0])
        radius = 1.0 / max(abs(largest[0]), abs(smallest[0]))
        axis = _tidy(np.asarray(along if curved else across))
        axis = axis * (1.0 if axis[np.argmax(np.abs(axis))] > 0.0 else -1.0)
    low, high = _box(occ, 2, tag)
    centre = np.asarray(occ.getCenterOfMass(2, tag))
    return Surface(name, tag, kind, float(occ.getMass(2, tag)), centre, low, high, normal, axis, radius)


def _tidy(v: Array) -> Array:
    """A unit vector without rounding."""
    unit = v / np.linalg.norm(v)
    rounded = np.round(unit)
    return np.asarray(rounded + 0.0 if np.abs(unit - rounded).max() < 1e-9 else unit, dtype=np.float64)


def solids_of(model: Any, loaded: Loaded) -> dict[str, Solid]:
    """Every part of a loaded model with its faces."""
    out = {}
    for name, tags in loaded.volumes.items():
        surfaces = tuple(_surface(model, name, tags, tag) for tag in sorted(_faces(model, tags)))
        boxes = [_box(model.occ, 3, tag) for tag in tags]
        out[name] = Solid(
            name,
            float(sum(model.occ.getMass(3, tag) for tag in tags)),
            sum(s.area for s in surfaces),
            np.min([b[0] for b in boxes], axis=0),
            np.max([b[1] for b in boxes], axis=0),
            surfaces,
        )
    return out


# ---------------------------------------------------------------------------------------------
# Which faces touch
# ---------------------------------------------------------------------------------------------
def touching(gmsh: Any, loaded: Loaded, solids: Mapping[str, Solid], gap: float) -> list[Touch]:
    """Groups of faces of two parts that touch, or come nearer than `gap`.

    Raises
    ------
    SceneError
        Several parts, and none touches another one.
    """
    model = gmsh.model
    names = list(solids)
    pairs: dict[tuple[str, str], list[Touch]] = {}
    where: dict[int, list[Surface]] = {}
    for solid in solids.values():
        for surface in solid.surfaces:
            where.setdefault(surface.tag, []).append(surface)
    shared: dict[tuple[str, str], list[Surface]] = {}
    for both in where.values():
        if len(both) == 2:
            shared.setdefault((both[0].part, both[1].part), []).append(both[0])
    for (a, b), surfaces in shared.items():
        kind: Kind = "cut" if (a, b) in loaded.halves else "touching"
        for group in _groups(model, surfaces):
            pairs.setdefault((a, b), []).append(_shared_touch(model, loaded, a, b, kind, group))
    for touch in _near(gmsh, loaded, solids, where, gap):
        key = touch.parts if touch.parts in pairs else touch.parts[::-1]
        pairs.setdefault(key, []).append(touch)
    if not pairs and len(solids) > 1:
        raise SceneError(
            f"no faces touch or come nearer than gap = {gap:.3g}; the nearest parts: "
            f"{'; '.join(nearest(model, loaded, solids, names))}; raise gap, or mend the geometry"
        )
    out = []
    for touches in pairs.values():
        ordered = sorted(touches, key=lambda t: (t.kind == "near", -t.area))
        for number, touch in enumerate(ordered, start=1):
            name = f"{touch.name}#{number}" if number > 1 else touch.name
            out.append(Touch(**{**vars(touch), "name": name}))
    place = {name: i for i, name in enumerate(names)}
    return sorted(out, key=lambda t: (place[t.parts[0]], place[t.parts[1]], t.name))


def nearest(
    model: Any, loaded: Loaded, solids: Mapping[str, Solid], names: Sequence[str], most: int = 5
) -> list[str]:
    """Sentences: which parts are nearest to each other, by exact distances."""
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
    return [f"{a!r} and {b!r} are {d:.4g} apart" for (a, b), d in ranked]


class _Union:
    """Disjoint sets."""

    def __init__(self, keys: Iterable[Any]) -> None:
        self._parent = {key: key for key in keys}

    def find(self, key: Any) -> Any:
        while self._parent[key] != key:
            key = self._parent[key]
        return key

    def join(self, a: Any, b: Any) -> None:
        self._parent[self.find(a)] = self.find(b)


def _continue(model: Any, a: Surface, b: Surface, edges: Mapping[int, set[int]]) -> bool:
    """Whether two faces of a part are one face to an engineer."""
    if a.kind != b.kind:
        return False
    if a.kind == "plane":
        size = math.sqrt(a.area + b.area)
        offset = float(np.dot(a.centre - b.centre, a.normal))
        return float(np.dot(a.normal, b.normal)) > 1.0 - 1e-9 and abs(offset) < 1e-6 * size
    if a.kind == "cylinder" and abs((a.radius or 0.0) - (b.radius or 0.0)) > 1e-6 * (a.radius or 1.0):
        return False
    return bool(edges[a.tag] & edges[b.tag])


def _groups(model: Any, surfaces: Sequence[Surface]) -> list[list[Surface]]:
    """Faces of one part, grouped into those that continue each other."""
    edges = {
        s.tag: {abs(t) for _, t in model.getBoundary([(2, s.tag)], oriented=False)} for s in surfaces
    }
    union = _Union(s.tag for s in surfaces)
    for i, a in enumerate(surfaces):
        for b in surfaces[i + 1 :]:
            if _continue(model, a, b, edges):
                union.join(a.tag, b.tag)
    found: dict[int, list[Surface]] = {}
    for s in surfaces:
        found.setdefault(union.find(s.tag), []).append(s)
    return list(found.values())


def _shared_touch(
    model: Any, loaded: Loaded, a: str, b: str, kind: Kind, group: Sequence[Surface]
) -> Touch:
    area = sum(s.area for s in group)
    mean = np.asarray(sum(s.area * s.normal for s in group)) / area
    length = float(np.linalg.norm(mean))
    normal = _tidy(mean) if length > 0.1 else np.zeros(3)
    tags = tuple(s.tag for s in group)
    return Touch(f"{a}|{b}", (a, b), kind, (tags, tags), area, 0.0, 0.0, normal, group[0].shape)


# ---------------------------------------------------------------------------------------------
# Faces that nearly touch
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class _Facing:
    """What two faces have in common."""

    area: float
    gap: float
    widest: float
    normal: Array


def _near(
    gmsh: Any,
    loaded: Loaded,
    solids: Mapping[str, Solid],
    where: Mapping[int, Sequence[Surface]],
    gap: float,
) -> list[Touch]:
    """Pairs of parts with faces that are not the same, but nearer than `gap`."""
    model = gmsh.model
    listed = list(solids.values())
    candidates: dict[tuple[str, str], list[tuple[Surface, Surface]]] = {}
    for i, j in _near_pairs([(s.low, s.high) for s in listed], gap):
        a, b = listed[i], listed[j]
        # faces that a third part has already been found on are taken
        own = [s for s in a.surfaces if len(where[s.tag]) == 1]
        other = [s for s in b.surfaces if len(where[s.tag]) == 1]
        boxes = [(s.low, s.high) for s in own + other]
        for k, m in _near_pairs(boxes, gap) if own and other else ():
            if k < len(own) <= m:
                first, second = own[k], other[m - len(own)]
                if not _may_face(first, second, gap):
                    continue
                if model.occ.getDistance(2, first.tag, 2, second.tag)[0] > gap + _ROUNDING * first.area**0.5:
                    continue
                candidates.setdefault((a.name, b.name), []).append((first, second))
    if not candidates:
        return []
    tags = sorted({s.tag for pairs in candidates.values() for pair in pairs for s in pair})
    triangles = _triangulate(gmsh, solids, tags)
    found = []
    for names, pairs in candidates.items():
        facing = {}
        for first, second in pairs:
            each = _facing(model, loaded, first, second, triangles, gap)
            if each is not None:
                facing[first.tag, second.tag] = each
        found += _near_touches(
            model,
            solids,
            names,
            facing,
            lambda first, second: _facing(model, loaded, first, second, triangles, gap),
        )
    return found


def _may_face(first: Surface, second: Surface, gap: float) -> bool:
    """False if two faces cannot face each other nearer than the gap: a cheap test of planes and cylinders."""
    kinds = (first.kind, second.kind)
    small = 1e-9 * (1.0 + float(np.abs(first.centre).max()))
    if kinds == ("plane", "plane"):
        opposed = float(first.normal @ second.normal) < _OPPOSED
        return opposed and _within(first, second, gap)
    if kinds == ("cylinder", "cylinder"):
        assert first.radius is not None and second.radius is not None
        if np.linalg.norm(np.cross(first.axis, second.axis)) > 1e-9:
            return True
        offset = second.centre - first.centre
        # centres of whole cylinders are on the axis, those of sectors are not
        apart = float(np.linalg.norm(offset - (offset @ first.axis) * first.axis))
        if apart > 1e-6 * first.radius:
            return True
        return abs(first.radius - second.radius) <= gap + small
    if set(kinds) == {"plane", "cylinder"}:
        plane, round_ = (first, second) if first.kind == "plane" else (second, first)
        along = float(plane.normal @ round_.axis)
        # normals of a cylinder are across its axis
        return math.sqrt(max(0.0, 1.0 - along**2)) > -_OPPOSED and _within(plane, round_, gap)
    return True


def _within(first: Surface, second: Surface, gap: float) -> bool:
    """Whether some corner of the box of a plane face is within the gap of the plane of the other."""
    corners = np.array(np.meshgrid(*zip(second.low, second.high, strict=True))).reshape(3, -1).T
    distance = (corners - first.centre) @ first.normal
    return bool(distance.min() <= 1.1 * gap + 1e-9 and distance.max() >= -1.1 * gap - 1e-9)


def _triangulate(gmsh: Any, solids: Mapping[str, Solid], tags: Sequence[int]) -> dict[int, Array]:
    """Face -> triangles (k, 3, 3), fine enough for areas."""
    model = gmsh.model
    low = np.min([s.low for s in solids.values()], axis=0)
    high = np.max([s.high for s in solids.values()], axis=0)
    options = {
        "Mesh.MeshOnlyVisible": 1.0,
        "Mesh.MeshSizeFromCurvature": 32.0,
        "Mesh.MeshSizeMax": float(np.linalg.norm(high - low)) / 30.0,
    }
    before = {key: gmsh.option.getNumber(key) for key in options}
    try:
        for key, value in options.items():
            gmsh.option.setNumber(key, value)
        model.setVisibility(model.getEntities(), 0)
        model.setVisibility([(2, tag) for tag in tags], 1, recursive=True)
        model.mesh.generate(2)
        out = {}
        for tag in tags:
            nodes, x, _ = model.mesh.getNodes(2, tag, True, False)
            row = dict(zip(nodes.tolist(), range(len(nodes)), strict=True))
            _, corners = model.mesh.getElementsByType(2, tag)
            at = np.array([row[t] for t in corners.tolist()], dtype=int)
            out[tag] = x.reshape(-1, 3)[at].reshape(-1, 3, 3)
    finally:
        model.mesh.clear()
        model.setVisibility(model.getEntities(), 1)
        for key, value in before.items():
            gmsh.option.setNumber(key, value)
    return out


def _facing(
    model: Any,
    loaded: Loaded,
    first: Surface,
    second: Surface,
    triangles: Mapping[int, Array],
    gap: float,
) -> _Facing | None:
    """Common area and distance of two faces; None if they have none."""
    one, two = triangles[first.tag], triangles[second.tag]
    if not len(one) or not len(two):
        return None
    c1, c2 = one.mean(axis=1), two.mean(axis=1)
    r1, r2 = (
        np.linalg.norm(t - c[:, None], axis=2).max(axis=1) for t, c in ((one, c1), (two, c2))
    )
    near = cKDTree(c2).query_ball_point(c1, r1 + r2.max() + gap)
    i = np.repeat(np.arange(len(one)), [len(n) for n in near])
    if not i.size:
        return None
    j = np.concatenate([np.asarray(n, dtype=np.int64) for n in near if len(n)])
    cross = np.cross(one[i, 1] - one[i, 0], one[i, 2] - one[i, 0])
    plane = cross / np.linalg.norm(cross, axis=1)[:, None]
    e1 = one[i, 1] - one[i, 0]
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    e2 = np.cross(plane, e1)
    axes = np.stack([e1, e2], axis=1)
    origin = one[i, 0][:, None]
    window, subject = (np.einsum("kab,kvb->kva", axes, t - origin) for t in (one[i], two[j]))
    common = clip(subject, window)
    ahead = np.roll(common, -1, axis=1)
    parts = common[..., 0] * ahead[..., 1] - common[..., 1] * ahead[..., 0]
    area = 0.5 * parts.sum(axis=1)
    keep = np.abs(area) > 1e-12 * first.area
    if not keep.any():
        return None
    flat = ((common + ahead) * parts[..., None]).sum(axis=1)[keep] / (6.0 * area[keep])[:, None]
    x = one[i[keep], 0] + np.einsum("kab,ka->kb", axes[keep], flat)
    size = np.abs(area[keep]) * first.area / np.linalg.norm(
        np.cross(one[:, 1] - one[:, 0], one[:, 2] - one[:, 0]), axis=1
    ).sum() * 2.0
    x1, n1 = _on(model, loaded, first, x)
    x2, n2 = _on(model, loaded, second, x1)
    offset = x2 - x1
    distance = np.einsum("ki,ki->k", offset, n1)
    good = (np.einsum("ki,ki->k", n1, n2) < _OPPOSED) & (np.linalg.norm(offset, axis=1) <= gap)
    if size[good].sum() <= _SLIVER * min(first.area, second.area):
        return None
    weights = size[good]
    mean = (weights[:, None] * n1[good]).sum(axis=0) / weights.sum()
    return _Facing(
        float(weights.sum()),
        float(weights @ distance[good] / weights.sum()),
        float(np.abs(distance[good]).max()),
        mean,
    )


def _on(model: Any, loaded: Loaded, surface: Surface, x: Array) -> tuple[Array, Array]:
    """Closest points (k, 3) of a face and the normals out of its part there."""
    closest, _ = model.getClosestPoint(2, surface.tag, x.ravel().tolist())
    # the parameters that come with the points are zero in gmsh 4.13
    at = model.getParametrization(2, surface.tag, closest)
    normals = np.asarray(model.getNormal(surface.tag, at)).reshape(-1, 3)
    volumes = loaded.volumes[surface.part]
    sign = _outward(model, volumes, surface.tag, _parameters(model, surface.tag))
    return np.asarray(closest).reshape(-1, 3), sign * normals


def _near_touches(
    model: Any,
    solids: Mapping[str, Solid],
    names: tuple[str, str],
    facing: Mapping[tuple[int, int], _Facing],
    measure: Callable[[Surface, Surface], _Facing | None],
) -> list[Touch]:
    """Face pairs of two parts, grouped; `measure` says what a face has in common with another one."""
    if not facing:
        return []
    by_tag = [{s.tag: s for s in solids[name].surfaces} for name in names]
    sides = [[by_tag[k][t] for t in dict.fromkeys(pair[k] for pair in facing)] for k in (0, 1)]
    union = _Union([(k, s.tag) for k in (0, 1) for s in sides[k]])
    for k in (0, 1):
        for group in _groups(model, sides[k]):
            for s in group[1:]:
                union.join((k, group[0].tag), (k, s.tag))
    for one, two in facing:
        union.join((0, one), (1, two))
    groups: dict[Any, list[tuple[int, int]]] = {}
    for pair in facing:
        groups.setdefault(union.find((0, pair[0])), []).append(pair)
    out = []
    for pairs in groups.values():
        tags = [tuple(dict.fromkeys(p[k] for p in pairs)) for k in (0, 1)]
        # the first side is the one that the other covers better
        own = [sum(by_tag[k][t].area for t in tags[k]) for k in (0, 1)]
        order = (0, 1) if own[0] <= own[1] * (1.0 + 1e-9) else (1, 0)
        each = [facing[p] for p in pairs]
        if order == (1, 0):
            turned = (measure(by_tag[1][two], by_tag[0][one]) for one, two in pairs)
            each = [f for f in turned if f is not None]
        area = sum(f.area for f in each)
        mean = np.asarray(sum(f.area * f.normal for f in each)) / area
        normal = _tidy(mean) if np.linalg.norm(mean) > 0.1 else np.zeros(3)
        parts = (names[order[0]], names[order[1]])
        out.append(
            Touch(
                f"{parts[0]}|{parts[1]}",
                parts,
                "near",
                (tags[order[0]], tags[order[1]]),
                area,
                sum(f.area * f.gap for f in each) / area,
                max(f.widest for f in each),
                normal,
                by_tag[order[0]][tags[order[0]][0]].shape,
            )
        )
    return out
