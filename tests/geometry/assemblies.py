"""Assemblies with fasteners as a STEP file would have them, and what each of their parts is.

Plates, brackets and rings held by bolts, screws and studs of M4 to M64 with nuts and washers, over gaskets,
with dowels, and between them what looks alike and is none: bushings, spacers, collars, flanged pins, shafts
with a collar, hexagon bars, covers. Clearance holes of all series and slots; hexagon and socket heads, heads
and nuts that are plain discs; chamfers, cores; threads that overlap; parts that are one. Turned, mirrored, in
mm, m or inches.
``made(seed)`` makes one, ``write(assembly, path)`` a file. Nothing here knows how parts are recognised.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.geometry.session import gmsh_session

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from parts.step_file import silent  # noqa: E402

Make = Callable[[Any], tuple[int, int]]
"""Draws a solid with ``gmsh.model.occ``."""

# d, across flats, head, nut, socket head, washer: ISO 4014, 4032, 4762, 7089
_TABLE = {
    4: (7, 2.8, 3.2, 7, (4.3, 9, 0.8)), 5: (8, 3.5, 4.7, 8.5, (5.3, 10, 1)), 6: (10, 4, 5.2, 10,
                                                                                 (6.4, 12, 1.6)),
    8: (13, 5.3, 6.8, 13, (8.4, 16, 1.6)), 10: (16, 6.4, 8.4, 16, (10.5, 20, 2)),
    12: (18, 7.5, 10.8, 18, (13, 24, 2.5)), 16: (24, 10, 14.8, 24, (17, 30, 3)),
    20: (30, 12.5, 18, 30, (21, 37, 3)), 24: (36, 15, 21.5, 36, (25, 44, 4)), 30: (46, 18.7, 25.6, 45,
                                                                                   (31, 56, 4)),
    36: (55, 22.5, 31, 54, (37, 66, 5)), 42: (65, 26, 34, 63, (45, 78, 8)), 48: (75, 30, 38, 72, (52, 92, 8)),
    56: (85, 35, 45, 84, (62, 105, 10)), 64: (95, 40, 51, 96, (70, 115, 10)),
}
_NAMES = {
    "bolt": ("Hexagon bolt ISO 4014 M{d}x{l}", "Sechskantschraube M{d}x{l}", "Vis H M{d}-{l}",
             "tornillo_{n}", "Vite TE M{d}",
             "DIN 933 - M{d} x {l}", "bolt {n}", "Screw-{n}",
             "DIN 912 M{d}x{l}", "Zylinderschraube_{n}", "boulon {n}"),
    "stud": ("stud bolt M{d}x{l}", "Stiftschraube DIN 939 M{d}", "goujon {n}", "esparrago_{n}",
             "prigioniero M{d}"),
    "nut": ("Hex nut ISO 4032 M{d}", "Sechskantmutter_{n}", "Écrou H M{d}", "tuerca {n}", "dado_{n}",
            "DIN 934 M{d}", "nut_{n}"),
    "washer": ("washer ISO 7089 - {d}", "Unterlegscheibe {n}", "rondelle_{n}", "arandela {n}",
               "DIN 125 - A {d}", "Washer{n}"),
    "gasket": ("gasket {n}", "Flachdichtung_{n}", "joint plat {n}", "junta {n}", "guarnizione_{n}"),
    "dowel": ("dowel pin {n}", "Zylinderstift ISO 8734 {d}", "goupille {n}", "pasador_{n}", "spina {n}"),
    "": ("plate {n}", "Gehaeuse_{n}", "support {n}", "pieza {n}", "piastra_{n}", "Bracket-{n}",
         "housing {n}", "arm {n}"),
}


@dataclass
class Part:
    """A solid: what it is ("" if no fastener), and how OpenCASCADE makes it."""

    kind: str
    make: Callable[[Any], int]
    name: str = ""
    look: str = ""


@dataclass
class Assembly:
    """Parts, and how they are written: `unit` of the file, turned around an axis, mirrored, as splines."""

    d: float
    parts: list[Part] = field(default_factory=list)
    unit: str = "mm"
    turn: tuple[float, tuple[float, ...], bool] = (0.0, (0.0, 0.0, 1.0), False)
    splines: bool = False


def cylinder(occ: Any, x: float, y: float, low: float, high: float, d: float) -> tuple[int, int]:
    return 3, occ.addCylinder(x, y, low, 0, 0, high - low, 0.5 * d)


def hexagon(
    occ: Any, x: float, y: float, low: float, high: float, across: float, angle: float
) -> tuple[int, int]:
    r = across / math.sqrt(3.0)
    turns = [angle + k * math.pi / 3 for k in range(6)]
    points = [occ.addPoint(x + r * math.cos(a), y + r * math.sin(a), low) for a in turns]
    lines = [occ.addLine(points[k], points[(k + 1) % 6]) for k in range(6)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return next(e for e in occ.extrude([(2, face)], 0, 0, high - low) if e[0] == 3)


def one(pairs: list[tuple[int, int]]) -> int:
    (found,) = [tag for dim, tag in pairs if dim == 3]
    return int(found)


def cut(occ: Any, body: tuple[int, int], tools: list[tuple[int, int]]) -> tuple[int, int]:
    return 3, one(occ.cut([body], tools)[0])


def fuse(occ: Any, bodies: list[tuple[int, int]]) -> tuple[int, int]:
    whole = bodies[0]
    for each in bodies[1:]:  # one by one: of several tools some stay behind
        whole = (3, one(occ.fuse([whole], [each])[0]))
    return whole


class Maker:
    """Draws an assembly; all lengths in mm, along z."""

    names = _NAMES

    def __init__(self, seed: int, off: bool) -> None:
        self.rng = np.random.default_rng(seed)
        self.off = np.random.default_rng([seed, 5]) if off else None
        self.d0 = int(self.rng.choice(list(_TABLE)))
        across, head, nut, socket, washer = _TABLE[self.d0]
        self.d = self.near(self.d0)
        own = np.random.default_rng([seed, 7])
        self.bore = self.d * (0.85 if own.uniform() < 0.25 else 1.0)
        """Of nuts and tapped holes; the narrow ones are as wide as the core and overlap with their bolts."""
        self.across, self.head, self.nut, self.socket = map(self.near, (across, head, nut, socket))
        # what is off still has to go over its bolt
        inner = max(self.near(washer[0]), 1.02 * self.d)
        self.washer = (inner, self.near(washer[1]), self.near(washer[2]))
        self.found = Assembly(self.d0)
        self.number = 0

    def near(self, value: float) -> float:
        """A size, or up to 5 % off."""
        return float(value) * (1.0 if self.off is None else float(self.off.uniform(0.95, 1.05)))

    def chance(self, p: float) -> bool:
        return bool(self.rng.uniform() < p)

    def add(self, kind: str, make: Make, look: str = "") -> None:
        self.number += 1
        words = self.names[kind][int(self.rng.integers(len(self.names[kind])))]
        name = words.format(d=self.d0, l=int(self.rng.integers(2, 9)) * 10, n=self.number)
        self.found.parts.append(Part(kind, lambda occ: make(occ)[1], f"{name} #{self.number}", look))

    # --- fasteners --------------------------------------------------------------------------------
    def headed(self, x: float, y: float, low: float, seat: float, style: str, whole: bool = False) -> Make:
        """A bolt from its tip `low` to the face under its head."""
        angle, chamfer, recess = self.rng.uniform(0, 1), self.chance(0.5), self.chance(0.7)
        core, tip, collar = self.chance(0.25) and not whole, self.chance(0.5), self.chance(0.2)
        d, w, k = self.d, self.across, self.head
        if style == "socket":
            w, k = self.socket, self.d
        elif style == "disc":
            k = self.head if self.chance(0.5) else self.d

        def make(occ: Any) -> tuple[int, int]:
            length = seat - low
            start = low + (0.1 * d if tip else 0.0)
            shank = [cylinder(occ, x, y, start, seat, d)]
            if core:  # threads are often drawn at their core
                middle = low + 0.4 * length
                shank = [cylinder(occ, x, y, middle, seat, d), cylinder(occ, x, y, start, middle, 0.85 * d)]
            if tip:
                inner = 0.5 * d * (0.85 if core else 1.0)
                shank.append((3, occ.addCone(x, y, low, 0, 0, start - low, inner - 0.1 * d, inner)))
            if style == "hex":
                top = hexagon(occ, x, y, seat, seat + k, w, angle)
                if chamfer:
                    cone = (3, occ.addCone(x, y, seat, 0, 0, k, 0.475 * w + 1.732 * k, 0.475 * w))
                    top = (3, one(occ.intersect([top], [cone])[0]))
            else:
                top = cylinder(occ, x, y, seat, seat + k, w)
            if collar and style == "hex":  # the face of a washer on the head, as ISO 4014 has it
                ring = cut(occ, cylinder(occ, x, y, seat, seat + 0.05 * d, 2.0 * w),
                           [cylinder(occ, x, y, seat, seat + 0.05 * d, 0.95 * w)])
                top = cut(occ, top, [ring])
            body = fuse(occ, [top, *shank])
            if style == "socket" and recess:
                body = cut(occ, body, [hexagon(occ, x, y, seat + 0.45 * k, seat + k, 0.8 * d, angle)])
            return body

        return make

    def nut_at(self, x: float, y: float, low: float, style: str, washer: bool) -> Make:
        angle, chamfer = self.rng.uniform(0, 1), self.chance(0.4)
        d, w, m = self.d, self.across, self.nut
        ring = self.washer

        def make(occ: Any) -> tuple[int, int]:
            if style == "disc":
                body = cylinder(occ, x, y, low, low + m, w)
            else:
                body = hexagon(occ, x, y, low, low + m, w, angle)
                if chamfer:
                    cone = (3, occ.addCone(x, y, low, 0, 0, m, 0.475 * w + 1.732 * m, 0.475 * w))
                    body = (3, one(occ.intersect([body], [cone])[0]))
            if washer:
                body = fuse(occ, [body, cylinder(occ, x, y, low, low + ring[2], ring[1])])
            return cut(occ, body, [cylinder(occ, x, y, low - d, low + m + d, self.bore)])

        return make

    def ring_at(self, x: float, y: float, low: float, ring: tuple[float, float, float]) -> Make:
        inner, outer, height = ring

        def make(occ: Any) -> tuple[int, int]:
            body = cylinder(occ, x, y, low, low + height, outer)
            return cut(occ, body, [cylinder(occ, x, y, low - 1, low + height + 1, inner)])

        return make

    def joint(self, x: float, y: float, bottom: float, top: float, way: str) -> None:
        """One bolt with what belongs to it, between two faces."""
        d = self.d
        above = self.washer[2] if self.chance(0.5) else 0.0
        below = self.washer[2] if self.chance(0.5) else 0.0
        fused = self.chance(0.12)
        if above and self.chance(0.1):  # a bushing, longer than any washer
            above = float(self.rng.uniform(0.5, 1.5)) * d
            self.add("", self.ring_at(x, y, top, (1.1 * d, 1.8 * d, above)), "bushing on its bolt")
        elif above:
            self.add("washer", self.ring_at(x, y, top, self.washer))
        if way == "tapped":
            depth = 1.3 * d
            style = str(self.rng.choice(["hex", "socket", "disc"], p=[0.45, 0.4, 0.15]))
            self.add("bolt", self.headed(x, y, bottom - depth, top + above, style), style)
            return
        style = "disc" if self.chance(0.15) else "hex"
        low = bottom - below - self.nut - 0.2 * d
        if way == "bolt":
            head = str(self.rng.choice(["hex", "socket", "disc"], p=[0.6, 0.25, 0.15]))
            bolt = self.headed(x, y, low, top + above, head, fused and not below)
            nut = self.nut_at(x, y, bottom - below - self.nut, style, False)
            if fused and not below:
                self.add("bolt", lambda occ: fuse(occ, [bolt(occ), nut(occ)]), "bolt and nut are one")
                return
            self.add("bolt", bolt, head)
        else:
            long = top + above + self.nut + 0.2 * d
            tapped = way == "screwed stud"
            start = bottom - 1.3 * d if tapped else low
            self.add("stud", lambda occ: cylinder(occ, x, y, start, long, d))
            self.add("nut", self.nut_at(x, y, top + above, style, fused and style == "hex"), style)
            if tapped:
                return
        if below:
            self.add("washer", self.ring_at(x, y, bottom - below, self.washer))
        self.add("nut", self.nut_at(x, y, bottom - below - self.nut, style, False), style)

    # --- what they hold ---------------------------------------------------------------------------
    def plates(self, sites: list[tuple[float, float]], way: str, series: float,
               dowels: list[tuple[float, float]], middle: float) -> tuple[float, float]:
        """Two or three plates with a gasket perhaps; lowest and highest face of what is clamped."""
        d = self.d
        reach = max(max(abs(x), abs(y)) for x, y in sites) + 2.2 * d
        shape = str(self.rng.choice(["box", "disc", "ring", "bracket"]))
        tapped = way in ("tapped", "screwed stud")
        levels = [("", self.rng.uniform(0.8, 2.5) * d) for _ in range(int(self.rng.integers(2, 4)) - tapped)]
        if self.chance(0.4):
            self.gasket_thickness = min(self.rng.uniform(0.5, 3.0), 0.03 * reach)
            levels.insert(1 if len(levels) > 1 else 0, ("gasket", self.gasket_thickness))
        if tapped:
            levels.insert(0, ("tapped", self.rng.uniform(2.0, 3.0) * d))
        clamped = levels[1:] if tapped else levels
        slot = self.chance(0.25)
        if sum(t for _, t in clamped) < 1.2 * d:
            clamped[-1] = (clamped[-1][0], clamped[-1][1] + 1.2 * d)
            levels = [*levels[:1], *clamped] if tapped else clamped
        z = -levels[0][1] if tapped else 0.0
        dry = "gasket" not in (levels[0][0], levels[1][0])
        for number, (kind, t) in enumerate(levels):
            last = number == len(levels) - 1
            outline = "box" if shape == "bracket" and not last else shape
            pins = dowels if number < 2 and dry else []
            self.plate(kind, outline, reach, z, t, sites, series, slot and last, pins, middle)
            z += t
        if dowels and dry:
            bottom = -levels[0][1] if tapped else 0.0
            low, high = bottom + 0.3 * levels[0][1], bottom + levels[0][1] + 0.7 * levels[1][1]
            for x, y in dowels:
                self.add("dowel", lambda occ, x=x, y=y: cylinder(occ, x, y, low, high, 0.6 * d))
        if middle:
            self.pin(-levels[0][1] if tapped else 0.0, z)
        return 0.0, z

    def pin(self, bottom: float, top: float) -> None:
        """In the middle a pin, with a flange perhaps, that is no bolt: nothing holds its end."""
        d, flange, past = self.d, self.chance(0.7), float(self.rng.uniform(-0.2, 3.0)) * self.d

        def make(occ: Any) -> tuple[int, int]:
            pin = cylinder(occ, 0, 0, bottom - past, top + (0.0 if flange else past), d)
            return fuse(occ, [pin, cylinder(occ, 0, 0, top, top + 0.7 * d, 1.6 * d)]) if flange else pin

        self.add("", make, "pin with a flange" if flange else "pin")

    def plate(self, kind: str, shape: str, reach: float, z: float, t: float,
              sites: list[tuple[float, float]], series: float, slot: bool,
              dowels: list[tuple[float, float]], middle: float) -> None:
        d, hole = self.d, self.bore if kind == "tapped" else max(self.near(self.d * series), 1.02 * self.d)
        depth = 1.5 * d if kind == "tapped" else t
        inner = 0.5 * min(math.hypot(x, y) for x, y in sites)
        pocket = kind == "" and self.chance(0.3)

        def make(occ: Any) -> tuple[int, int]:
            if shape in ("disc", "ring"):
                body = cylinder(occ, 0, 0, z, z + t, 2.0 * 1.4 * reach)
            else:
                body = (3, occ.addBox(-reach, -reach, z, 2 * reach, 2 * reach, t))
            if shape == "bracket":
                wall = (3, occ.addBox(-reach - d, -reach, z, 1.0 * d, 2 * reach, t + 4 * d))
                body = fuse(occ, [body, wall])
            tools = []
            if shape == "ring" and inner > 1.5 * d and not middle and not dowels:
                tools.append(cylinder(occ, 0, 0, z - 1, z + t + 1, 1.2 * inner))
            for x, y in sites:
                tools.append(cylinder(occ, x, y, z + t - depth, z + t, hole))
                if slot:
                    length = 0.3 * d
                    tools += [cylinder(occ, x + s * length, y, z, z + t, hole) for s in (-1, 1)]
                    tools.append((3, occ.addBox(x - length, y - 0.5 * hole, z, 2 * length, hole, t)))
            tools += [cylinder(occ, x, y, z - 1, z + t + 1, 0.6 * d) for x, y in dowels]
            if middle:
                tools.append(cylinder(occ, 0, 0, z - 1, z + t + 1, middle))
            if pocket:
                tools.append((3, occ.addBox(-0.3 * d, reach - 0.5 * d, z - 1, 0.6 * d, 2 * reach, t + 2)))
            return cut(occ, body, tools)

        self.add("gasket" if kind == "gasket" else "", make, shape)

    # --- what looks alike ---------------------------------------------------------------------------
    def decoy(self, x: float, y: float, z: float) -> None:
        """A part beside the joint that is no fastener."""
        d, rng = self.d, self.rng
        a, b = float(rng.uniform(0.3, 2.0)), float(rng.uniform(2.0, 6.0))
        which = int(rng.integers(10))

        def make(occ: Any) -> tuple[int, int]:
            def pin(low: float, high: float, width: float) -> tuple[int, int]:
                return cylinder(occ, x, y, z + low * d, z + high * d, width * d)

            if which == 0:  # a bushing
                return cut(occ, pin(0, 0.5 + a, 1.7), [pin(-1, 9, 1.1)])
            if which == 1:  # a shaft with a collar
                return fuse(occ, [pin(0, b, 1), pin(0.5, 0.5 + 0.5 * a, 1.6)])
            if which == 2:  # a pin with a flange
                return fuse(occ, [pin(0, b, 1), pin(0, 0.6, 1.6)])
            if which == 3:  # a hexagon bar
                return hexagon(occ, x, y, z, z + b * d, 1.6 * d, a)
            if which == 4:  # a hexagon spacer with a thread
                return cut(occ, hexagon(occ, x, y, z, z + b * d, 1.6 * d, a), [pin(-1, 9, 1)])
            if which == 5:  # a cover
                return 3, occ.addBox(x - b * d, y - b * d, z, 2 * b * d, 2 * b * d, 0.1 * d)
            if which == 6:  # a plain pin
                return pin(0, b, 1)
            if which == 7:  # a stepped shaft with a hole through it
                return cut(occ, fuse(occ, [pin(0, b, 1), pin(0, 0.6, 1.6)]), [pin(-1, 9, 0.5)])
            if which == 8:  # a ball on a foot
                return fuse(occ, [(3, occ.addSphere(x, y, z + 2 * d, d)), pin(0, 2, 1)])
            body = 3, occ.addBox(x - d, y - d, z, 2 * d, 2 * d, b * d)  # a block with a cross hole
            return cut(occ, body, [(3, occ.addCylinder(x - 2 * d, y, z + d, 4 * d, 0, 0, 0.5 * d))])

        self.add("", make, f"decoy {which}")


def made(seed: int, off: bool = False) -> Assembly:
    """An assembly of 3 to some 30 parts; `off`: sizes of fasteners and holes are up to 5 % off."""
    maker = Maker(seed, off)
    rng, d = maker.rng, maker.d
    way = str(rng.choice(["bolt", "tapped", "stud", "screwed stud"], p=[0.4, 0.3, 0.2, 0.1]))
    count = int(rng.choice([1, 2, 3, 4, 6, 8], p=[0.15, 0.25, 0.15, 0.3, 0.08, 0.07]))
    radius = max(2.0, 4.2 * count / (2.0 * math.pi)) * d * float(rng.uniform(1.2, 2.0))
    turns = 2.0 * math.pi * (np.arange(count) / count + rng.uniform())
    sites = [(radius * math.cos(a), radius * math.sin(a)) for a in turns]
    series = float(rng.choice([1.06, 1.1, 1.18]))
    dowels = [(-d, 0.0), (d, 0.0)] if count > 1 and radius > 4 * d and maker.chance(0.3) else []
    middle = float(rng.choice([0.0, 1.0, 1.1])) * d if count > 1 and not dowels and radius > 5 * d else 0.0
    bottom, top = maker.plates(sites, way, series, dowels, middle)
    for x, y in sites:
        maker.joint(x, y, bottom, top, way)
    reach = max(max(abs(x), abs(y)) for x, y in sites)
    for k in range(int(rng.integers(0, 5))):
        maker.decoy((3 * reach + 20 * d) + 14 * d * k, 0.0, float(rng.uniform(-d, d)))
    return finished(maker)


def finished(maker: Maker) -> Assembly:
    """What a maker has drawn, in some unit, turned and mirrored, its parts in some order."""
    rng, found = maker.rng, maker.found
    found.unit = str(rng.choice(["mm", "m", "inch"], p=[0.6, 0.2, 0.2]))
    axis = rng.normal(size=3)
    if maker.chance(0.6):
        found.turn = (float(rng.uniform(0.0, 6.0)), tuple(axis / np.linalg.norm(axis)), maker.chance(0.5))
    order = rng.permutation(len(found.parts))
    found.parts = [found.parts[k] for k in order]
    return found


class _Scaled:
    """OpenCASCADE in another unit, and mirrored in x: its own way makes splines of cylinders."""

    def __init__(self, occ: Any, scale: float, mirrored: bool) -> None:
        self.occ, self.scale, self.mirrored = occ, scale, mirrored

    def __getattr__(self, name: str) -> Any:
        function = getattr(self.occ, name)
        if name not in ("addPoint", "addBox", "addCylinder", "addCone", "addSphere", "extrude"):
            return function

        def scaled(*given: Any) -> Any:
            values = [g if isinstance(g, list) else self.scale * g for g in given]
            if self.mirrored and name == "addBox":
                values[0] = -values[0] - values[3]
            elif self.mirrored and name != "extrude":
                values[0] *= -1.0
                if name in ("addCylinder", "addCone"):
                    values[3] *= -1.0
            return function(*values)

        return scaled


_UNITS = {"mm": 1.0, "m": 1e-3, "inch": 1.0 / 25.4}


def write(assembly: Assembly, path: Path) -> Path:
    """The STEP file, its products named."""
    with gmsh_session("assembly") as gmsh, silent():
        angle, axis, mirrored = assembly.turn
        occ = _Scaled(gmsh.model.occ, _UNITS[assembly.unit], mirrored)
        tags = []
        for part in assembly.parts:
            tags.append(part.make(occ))
            left = [each for each in gmsh.model.occ.getEntities(3) if each[1] not in tags]
            gmsh.model.occ.remove(left, recursive=True)  # what a fuse has left of its tools
        solids = [(3, t) for t in tags]
        if assembly.splines:  # an affine map makes splines of all faces: here a mirror
            gmsh.model.occ.affineTransform(solids, [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
        gmsh.model.occ.rotate(solids, 0, 0, 0, *axis, angle)
        gmsh.model.occ.synchronize()
        order = [tag for _, tag in gmsh.model.occ.getEntities(3)]
        gmsh.write(str(path))
    names = [assembly.parts[tags.index(t)].name for t in order]
    text = path.read_text(encoding="latin-1")
    pattern = re.compile(r"PRODUCT\('Open CASCADE STEP translator [\d.]+ \d+\.(\d+)',\s*'[^']*'")
    plain = [n.encode("ascii", "ignore").decode() for n in names]
    quoted = [n.replace("'", "''") for n in plain]  # as ISO 10303-21 has it
    text = pattern.sub(lambda m: "PRODUCT('{0}','{0}'".format(quoted[int(m[1]) - 1]), text)
    millimetre = r"\( LENGTH_UNIT\(\) NAMED_UNIT\(\*\) SI_UNIT\(\.MILLI\.,\.METRE\.\) \)"
    if assembly.unit == "m":
        text = re.sub(millimetre, "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) )", text)
    elif assembly.unit == "inch":
        inch = "( CONVERSION_BASED_UNIT('INCH',#{b}) LENGTH_UNIT() NAMED_UNIT(#{c}) )"
        more, last = [], max(map(int, re.findall(r"^#(\d+) *=", text, re.MULTILINE)))
        a, b, c = last + 1, last + 2, last + 3
        text = re.sub(millimetre, inch.format(b=b, c=c), text)
        more.append(f"#{a} = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );")
        more.append(f"#{b} = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{a});")
        more.append(f"#{c} = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);")
        text = text.replace("ENDSEC;\nEND-ISO", "\n".join(more) + "\nENDSEC;\nEND-ISO")
    path.write_text(text, encoding="latin-1")
    return path
