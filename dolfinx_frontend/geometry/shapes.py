"""What a solid is made of, whatever divided its faces: planes and cylinders, and what lies around an axis.

A face that touches another one is divided where that ends (:mod:`solids`). Here the pieces are one again. All
comparisons are relative to the size of the solid, and none depends on how it is turned or in which order its
faces come.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.groups import grouped
from dolfinx_frontend.geometry.findings import SETTINGS
from dolfinx_frontend.geometry.solids import Solid, Surface
from dolfinx_frontend.geometry.touching import Touch

__all__ = ["Body", "Face", "Station", "Turned", "bodies", "turned"]

_SAME = 1e-4
"""Distance that is none, relative to the size of a solid."""
_PARALLEL = 1e-4
"""Sine of an angle that is none."""


@dataclass(frozen=True)
class Face:
    """A plane, cylinder or cone of a solid, with all its pieces that hang together.

    Attributes
    ----------
    first
        One of the pieces, which has normal, axis and radius.
    tags
        Numbers of all of them.
    area, centre, rim
        Of all.
    """

    first: Surface = field(repr=False)
    tags: frozenset[int]
    area: float
    centre: Array = field(repr=False)
    rim: Array = field(repr=False)

    @property
    def kind(self) -> str:
        """``"plane"``, ``"cylinder"``, ..."""
        return self.first.kind


@dataclass(frozen=True)
class Body:
    """A part; one that was cut is whole again.

    Attributes
    ----------
    name, parts
        Its name, and those of its pieces.
    volume, area, size
        Volume, area of all faces, and the largest distance of points of its edges.
    faces
        Its faces.
    label
        Its name in the file.
    """

    name: str
    parts: tuple[str, ...]
    volume: float
    area: float
    size: float
    faces: tuple[Face, ...] = field(repr=False)
    label: str

    @property
    def thickness(self) -> float:
        """2 volume / area: the thickness of a plate."""
        return 2.0 * self.volume / self.area


@dataclass(frozen=True)
class Station:
    """A piece around an axis: a cylinder, a cone (or what else tapers: a sphere, a fillet) or a hexagon.

    Attributes
    ----------
    width
        Diameter (of a cone the largest), or width across flats.
    low, high
        Where it begins and ends along the axis.
    hollow, hexagon, cone
        Whether it is a hole, has six flats, tapers.
    faces
        What it is made of.
    """

    width: float
    low: float
    high: float
    hollow: bool
    hexagon: bool = False
    cone: bool = False
    faces: tuple[Face, ...] = field(default=(), repr=False)

    @property
    def length(self) -> float:
        return self.high - self.low


@dataclass(frozen=True)
class Turned:
    """A body seen from one axis.

    Attributes
    ----------
    origin, axis
        The axis.
    low, high
        Where the body begins and ends along it.
    stations
        Prisms around it, as they follow one another.
    share
        Fraction of the body's area that they and planes across the axis make up.
    walls
        Planes along the axis that look towards it, as those of a slot.
    """

    body: Body
    origin: Array = field(repr=False)
    axis: Array = field(repr=False)
    low: float
    high: float
    stations: tuple[Station, ...]
    share: float
    walls: tuple[Face, ...] = field(default=(), repr=False)

    @property
    def length(self) -> float:
        return self.high - self.low

    @property
    def outside(self) -> tuple[Station, ...]:
        """Shafts and hexagons."""
        return tuple(s for s in self.stations if not s.hollow)

    @property
    def inside(self) -> tuple[Station, ...]:
        """Holes and hexagon sockets."""
        return tuple(s for s in self.stations if s.hollow)

    @property
    def hole(self) -> Station | None:
        """The narrowest round hole, if holes go through all of it (chamfers may end them)."""
        inside = [s for s in self.inside if not s.hexagon]
        if not inside:
            return None
        low, high = min(s.low for s in inside), max(s.high for s in inside)
        slack = _SAME * self.body.size
        if low > self.low + slack or high < self.high - slack:
            return None
        rounds = [s for s in inside if not s.cone]
        return min(rounds, key=lambda s: s.width) if rounds else None


def bodies(solids: Mapping[str, Solid], touches: Iterable[Touch]) -> dict[str, Body]:
    """The parts by name; the halves of what was cut are one."""
    cut = [t for t in touches if t.kind == "cut"]
    sections = {tag for t in cut for side in t.surfaces for tag in side}
    out = {}
    for group in grouped(list(solids), [t.parts for t in cut]):
        each = [solids[n] for n in group]
        surfaces = [s for solid in each for s in solid.surfaces if s.tag not in sections]
        name = group[0] if len(group) == 1 else group[0][:-1]
        rims = np.concatenate([s.rim for s in surfaces if len(s.rim)] or [np.zeros((1, 3))])
        size = float(np.linalg.norm(np.ptp(rims,
                                           axis=0))) or float(np.linalg.norm(each[0].high - each[0].low))
        area, volume = sum(s.area for s in surfaces), sum(s.volume for s in each)
        faces = _joined(surfaces, _SAME * size)
        out[name] = Body(name, tuple(group), volume, area, size, faces, each[0].label or name)
    return out


def _joined(surfaces: Sequence[Surface], slack: float) -> tuple[Face, ...]:
    """Faces of pieces that hang together on one plane, cylinder or cone."""
    along = np.array([s.normal if s.kind == "plane" else s.axis for s in surfaces])
    radii = np.array([s.radius or 0.0 for s in surfaces])
    alike = np.abs(along @ along.T) > 1.0 - _PARALLEL**2
    alike &= np.abs(radii[:, None] - radii) < slack
    pairs = [
        (a.tag, b.tag)
        for a, b in ((surfaces[i], surfaces[j]) for i, j in np.argwhere(np.triu(alike, 1)))
        if _same(a, b, slack) and _meet(a, b, slack)
    ]
    by_tag = {s.tag: s for s in surfaces}
    out = []
    for group in grouped(list(by_tag), pairs):
        each = [by_tag[t] for t in group]
        area = sum(s.area for s in each)
        centre = np.asarray(sum(s.area * s.centre for s in each)) / area
        out.append(Face(each[0], frozenset(group), area, centre, np.concatenate([s.rim for s in each])))
    return tuple(out)


def _same(a: Surface, b: Surface, slack: float) -> bool:
    """Whether two faces lie on one surface."""
    if a.kind != b.kind or a.hollow != b.hollow:
        return False
    if a.kind == "plane":
        across = float(np.linalg.norm(np.cross(a.normal, b.normal)))
        facing = float(a.normal @ b.normal) > 0.0
        return facing and across < _PARALLEL and abs(float((b.centre - a.centre) @ a.normal)) < slack
    if a.kind == "cylinder":
        return abs((a.radius or 0.0) - (b.radius or 0.0)) < slack and _on_axis(b, a.origin, a.axis, slack)
    if a.kind == "cone":  # of the same apex
        return _on_axis(b, a.origin, a.axis, slack) and float(np.linalg.norm(a.origin - b.origin)) < slack
    return False


def _meet(a: Surface, b: Surface, slack: float) -> bool:
    if not len(a.rim) or not len(b.rim):
        return False
    apart = np.maximum(a.rim.min(axis=0) - b.rim.max(axis=0), b.rim.min(axis=0) - a.rim.max(axis=0)).max()
    if apart > slack:
        return False
    return bool(np.linalg.norm(a.rim[:, None] - b.rim[None], axis=2).min() < slack)


def _on_axis(surface: Surface, origin: Array, axis: Array, slack: float) -> bool:
    """Whether a cylinder or cone is around an axis."""
    if float(np.linalg.norm(np.cross(surface.axis, axis))) > _PARALLEL:
        return False
    offset = surface.origin - origin
    return float(np.linalg.norm(offset - (offset @ axis) * axis)) < slack


def turned(body: Body) -> Turned | None:
    """A body seen from the axis that most of its area is around; None: it has no cylinders."""
    slack = 10.0 * _SAME * body.size
    lines: list[tuple[Array, Array]] = []
    for face in body.faces:
        s = face.first
        if s.kind == "cylinder" and not any(_on_axis(s, *line, slack) for line in lines):
            lines.append((s.origin, s.axis))
    if not lines or len(lines) > _MOST_LINES:
        return None
    return max((_around(body, *line, slack) for line in lines), key=lambda each: each.share)


_MOST_LINES = 12
"""What has more axes than this is no fastener."""


def _around(body: Body, origin: Array, axis: Array, slack: float) -> Turned:
    """A body seen from an axis, whose direction is that in which most of the body lies."""
    points = np.concatenate([f.rim for f in body.faces if len(f.rim)])
    along = (points - origin) @ axis
    stations = []
    share = 0.0
    sides = []
    for face in body.faces:
        first = face.first
        turned = _revolved(first, origin, axis, slack) if len(face.rim) else ""
        if turned:
            t = (face.rim - origin) @ axis
            across = np.linalg.norm(face.rim - origin - t[:, None] * axis, axis=1)
            width = 2.0 * (first.radius or float(across.max()))
            hollow = first.hollow or bool(len(first.points) and _inwards(first, origin, axis))
            cone = turned == "tapers"
            stations.append(Station(width, float(t.min()), float(t.max()), hollow, cone=cone, faces=(face,)))
            share += face.area
        elif first.kind == "plane" and abs(float(first.normal @ axis)) > 1.0 - _PARALLEL:
            share += face.area
        elif first.kind == "plane" and abs(float(first.normal @ axis)) < _PARALLEL:
            sides.append(face)
    hexagons = _hexagons(sides, origin, axis)
    stations += hexagons
    share += sum(f.area for s in hexagons for f in s.faces)
    ordered = tuple(sorted(stations, key=lambda s: (s.low, s.high, s.width)))
    walls = tuple(f for f in sides if float((f.centre - origin) @ f.first.normal) < 0.0)
    low, high = float(along.min()), float(along.max())
    return Turned(body, origin, axis, low, high, ordered, share / body.area, walls)


def _revolved(surface: Surface, origin: Array, axis: Array, slack: float) -> str:
    """Whether a face is turned around an axis, which all of its normals meet: as "round", or it "tapers".

    The normals of the flanks of a thread pass the axis by its lead over a turn: they are round as well.
    """
    if surface.kind in ("cylinder", "cone"):
        return {"cylinder": "round", "cone": "tapers"}[surface.kind] * _on_axis(surface, origin, axis, slack)
    if not len(surface.points):
        return ""
    offset = surface.points - origin
    lever = np.abs(np.einsum("ij,ij->i", np.cross(offset, axis), surface.normals)).max()
    if lever < slack:
        return "tapers"
    reach = np.linalg.norm(np.cross(offset, axis), axis=1).max()
    return "round" if lever < SETTINGS.lead * reach else ""


def _inwards(surface: Surface, origin: Array, axis: Array) -> bool:
    """Whether its normals point to the axis, as in a hole."""
    offset = surface.points - origin
    across = offset - np.outer(offset @ axis, axis)
    return float(np.einsum("ij,ij->", across, surface.normals)) < 0.0


def _hexagons(sides: Sequence[Face], origin: Array, axis: Array) -> list[Station]:
    """Six flats around an axis, at one distance from it and a sixth of a turn apart."""
    out = []
    reach = [float((f.centre - origin) @ f.first.normal) for f in sides]
    rest = list(range(len(sides)))
    while rest:
        ends = {k: _span(sides[k], origin, axis) for k in rest}
        one = rest[0]
        alike = [
            k for k in rest
            if abs(reach[k] - reach[one]) < 0.01 * abs(reach[one])
            and min(ends[k][1], ends[one][1]) - max(ends[k][0], ends[one][0]) > 0.0
        ]
        rest = [k for k in rest if k != one and k not in alike]  # a plane through the axis is like none
        turns = {round(_angle(sides[k].first.normal, sides[one].first.normal, axis) / 60.0, 2) % 6.0
                 for k in alike}
        if turns == {0.0, 1.0, 2.0, 3.0, 4.0, 5.0}:
            low, high = min(ends[k][0] for k in alike), max(ends[k][1] for k in alike)
            faces = tuple(sides[k] for k in alike)
            out.append(Station(2.0 * abs(reach[one]), low, high, reach[one] < 0.0, hexagon=True, faces=faces))
    return out


def _span(face: Face, origin: Array, axis: Array) -> tuple[float, float]:
    along = (face.rim - origin) @ axis
    return float(along.min()), float(along.max())


def _angle(a: Array, b: Array, axis: Array) -> float:
    """Degrees from one normal to another around an axis."""
    return math.degrees(math.atan2(float(np.cross(b, a) @ axis), float(a @ b)))
