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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = ["Cut", "Loaded", "Solid", "Surface", "load", "matching", "nearest", "solids_of", "vector"]

ROUNDING = 1e-9
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
class Loaded:
    """Solids of a model that is open in gmsh: name -> volumes, and the pairs that were one solid."""

    volumes: dict[str, list[int]]
    halves: frozenset[tuple[str, str]]


def vector(v: Array) -> str:
    """A vector in few characters."""
    return "(" + ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in v) + ")"


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
        low, high = box_of(occ, 3, tag)
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


def box_of(occ: Any, dim: int, tag: int) -> tuple[Array, Array]:
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


def near_pairs(boxes: Sequence[tuple[Array, Array]], reach: float) -> Iterator[tuple[int, int]]:
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
    for i, j in near_pairs([box_of(occ, 3, tag) for tag in tags], 0.0):
        common, _ = occ.intersect([(3, tags[i])], [(3, tags[j])], removeObject=False, removeTool=False)
        volume = sum(occ.getMass(3, tag) for dim, tag in common if dim == 3)
        if volume > 0.0:
            overlaps[names[i], names[j]] = volume
        if common:
            occ.remove(common, recursive=True)
    if overlaps:
        raise _overlapping(overlaps, {n: occ.getMass(3, t) for n, t in volumes.items()})
    occ.synchronize()


def _faces(model: Any, tags: Sequence[int]) -> list[int]:
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


def outward(model: Any, volumes: Sequence[int], surface: int, at: Array) -> float:
    """1 if the normal of the surface points out of the part, otherwise -1."""
    x = np.asarray(model.getValue(2, surface, at.tolist()))
    n = np.asarray(model.getNormal(surface, at.tolist()))
    small = 1e-4 * math.sqrt(model.occ.getMass(2, surface))
    inside = any(model.isInside(3, v, (x + small * n).tolist()) for v in volumes)
    return -1.0 if inside else 1.0


def _surface(model: Any, name: str, volumes: Sequence[int], tag: int) -> Surface:
    occ = model.occ
    kind = str(model.getType(2, tag)).lower()
    at = parameters_of(model, tag)
    normal: Array = np.zeros(3)
    axis: Array = np.zeros(3)
    radius: float | None = None
    if kind == "plane":
        n = np.asarray(model.getNormal(tag, at.tolist()))
        normal = tidy(outward(model, volumes, tag, at) * n)
    elif kind == "cylinder":
        largest, smallest, across, along = model.getPrincipalCurvatures(tag, at.tolist())
        curved = abs(largest[0]) > abs(smallest[0])
        radius = 1.0 / max(abs(largest[0]), abs(smallest[0]))
        axis = tidy(np.asarray(along if curved else across))
        axis = axis * (1.0 if axis[np.argmax(np.abs(axis))] > 0.0 else -1.0)
    low, high = box_of(occ, 2, tag)
    centre = np.asarray(occ.getCenterOfMass(2, tag))
    return Surface(name, tag, kind, float(occ.getMass(2, tag)), centre, low, high, normal, axis, radius)


def tidy(v: Array) -> Array:
    """A unit vector without rounding."""
    unit = v / np.linalg.norm(v)
    rounded = np.round(unit)
    return np.asarray(rounded + 0.0 if np.abs(unit - rounded).max() < 1e-9 else unit, dtype=np.float64)


def solids_of(model: Any, loaded: Loaded) -> dict[str, Solid]:
    """Every part of a loaded model with its faces."""
    out = {}
    for name, tags in loaded.volumes.items():
        surfaces = tuple(_surface(model, name, tags, tag) for tag in sorted(_faces(model, tags)))
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
