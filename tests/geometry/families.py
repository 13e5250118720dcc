"""Assemblies of six families, drawn in other ways than those of ``assemblies.py``.

Pipe flanges, housings with covers, steel frames, shaft clamps, stacks on tie rods and mounts: shanks with
runouts and waists, threads drawn at their core or with an overlap, flanged and low heads, chamfers on both
sides of nuts, wide, split and fused washers, gaskets inside of the bolts, counterbores, and beside them
bearing rings, circlips, sleeves, plugs, shims, and parts whose names have words of fasteners in them.

The first trial of the recognition was made with these, and it has learned from them since. ``made(seed)``
makes one; the family is seed modulo six.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tests.geometry.assemblies import Assembly, Make, Maker, cut, cylinder, finished, fuse, hexagon, one

_NAMES = {
    "bolt": ("ISO4017-M{d}x{l}-8.8", "Inbusschraube M{d}", "hex head cap screw {n}", "Vis CHC M{d}x{l}",
             "SHCS M{d}x{l}", "Perno hexagonal {n}", "Schraube-{n}", "Bullone M{d}", "BOLT_M{d}X{l}_{n}",
             "ISO 4762 - M{d} x {l}"),
    "stud": ("Gewindebolzen M{d}x{l}", "Stud_M{d}_{n}", "threaded rod M{d}", "Tige filetee {n}",
             "Stehbolzen-{n}"),
    "nut": ("ISO4032-M{d}", "Mutter-{n}", "heavy hex nut {n}", "Ecrou_{n}", "Tuerca M{d}", "NUT {n}"),
    "washer": ("ISO 7090-{d}", "Scheibe_{n}", "flat washer M{d}", "Rondelle plate {n}", "DIN 9021 - {d}"),
    "gasket": ("Dichtung-{n}", "GASKET {n}", "Joint_{n}", "Seal, flat {n}", "DIN 2690 {n}"),
    "dowel": ("Passstift {n}", "ISO 2338 - {d}", "Dowel_{n}", "Goupille cylindrique {n}"),
    "sheet": ("Beilage {n}", "spacer plate {n}", "SOLID {n}", "cale {n}", "spessore-{n}", "packer {n}"),
    "": ("Deckel {n}", "base plate {n}", "corps {n}", "Dichtungstraeger {n}", "bolt plate {n}", "carter {n}",
         "Schraubstock {n}", "Welle {n}", "SOLID {n}", "nut housing {n}", "joint cover {n}", "Rahmen-{n}",
         "Lagerring {n}", "jig{n}"),
}


class Families(Maker):
    """Draws an assembly of a family; all lengths in mm, along z."""

    names = _NAMES

    def __init__(self, seed: int, off: bool) -> None:
        super().__init__(seed, off)
        self.drawn = str(self.rng.choice(["nominal", "core", "overlap"], p=[0.5, 0.2, 0.3]))
        self.core = self.d * float(self.rng.uniform(0.83, 0.87))
        """Diameter of the thread where it is drawn at its core, or of the hole that it overlaps."""
        self.bore = self.d if self.drawn == "nominal" else self.core

    # --- fasteners --------------------------------------------------------------------------------
    def bolt(self, x: float, y: float, seat: float, way: int, length: float, head: str, tip: float,
             washer: bool = False) -> Make:
        """A bolt whose head lies on `seat`, towards `way`; `tip`: length that is in its thread at least."""
        d, angle, d_tip = self.d, self.rng.uniform(0, 1), self.core if self.drawn == "core" else self.d
        form = str(self.rng.choice(["plain", "runout", "waist"], p=[0.6, 0.25, 0.15]))
        thread = min(max(tip + 0.5 * d, 2.0 * d), 0.9 * length)
        sharp, rounded = self.chance(0.3), self.chance(0.6)
        w, k, dk = self.across, self.head, self.socket

        def make(occ: Any) -> tuple[int, int]:
            def rod(low: float, high: float, width: float) -> tuple[int, int]:
                return 3, occ.addCylinder(x, y, seat + way * low, 0, 0, way * (high - low), 0.5 * width)

            def cone(low: float, high: float, a: float, b: float) -> tuple[int, int]:
                at = seat + way * low
                return 3, occ.addCone(x, y, at, 0, 0, way * (high - low), 0.5 * a, 0.5 * b)

            start = 0.0 if sharp else 0.08 * d
            body = [cone(-length, -length + start, d_tip - 2.0 * start, d_tip)] if start else []
            body.append(rod(-length + start, -thread, d_tip))
            neck = 0.85 * d if form == "waist" else d
            if form == "runout" and d_tip == d:
                neck, at = 0.86 * d, -thread
                body += [cone(at, at + 0.1 * d, d, neck), rod(at + 0.1 * d, at + 0.3 * d, neck)]
                body += [cone(at + 0.3 * d, at + 0.4 * d, neck, d), rod(at + 0.4 * d, 0, d)]
            else:
                body.append(rod(-thread, 0.0, neck if thread < 0.8 * length else d_tip))
            if head == "hexagon" or head == "flange":
                high = k if head == "hexagon" else 1.2 * k
                top = hexagon(occ, x, y, seat, seat + way * high, w, angle)
                if rounded:
                    limit = (3, occ.addCone(x, y, seat, 0, 0, way * high, 0.49 * w + 1.732 * high, 0.49 * w))
                    top = (3, one(occ.intersect([top], [limit])[0]))
                if head == "flange":
                    top = fuse(occ, [top, rod(0.0, 0.25 * k, 2.1 * d)])
            else:
                high = d if head == "socket" else 0.65 * d
                top = rod(0.0, 0.9 * high, dk)
                top = fuse(occ, [top, cone(0.9 * high, high, dk, dk - 0.2 * high)]) if rounded else \
                    fuse(occ, [top, rod(0.9 * high, high, dk)])
            body = [fuse(occ, [top, *body[::-1]])]
            if head in ("socket", "low"):
                deep = hexagon(occ, x, y, seat + way * 0.5 * high, seat + way * high, 0.78 * d, angle)
                body = [cut(occ, body[0], [deep])]
            if washer:
                body = [fuse(occ, [body[0], rod(-self.washer[2], 0.0, self.washer[1])])]
            return body[0]

        return make

    def hex_nut(self, x: float, y: float, low: float, height: float, flange: int = 0) -> Make:
        """A nut between `low` and `low + height`; flange: at its lower (-1) or upper (1) side."""
        angle, both, sunk = self.rng.uniform(0, 1), self.chance(0.5), self.chance(0.5)
        d, w, bore = self.d, self.across, self.bore

        def make(occ: Any) -> tuple[int, int]:
            body = hexagon(occ, x, y, low, low + height, w, angle)
            for begin, way in ((low, 1), (low + height, -1)) if both else ():
                limit = occ.addCone(x, y, begin, 0, 0, way * height, 0.49 * w, 0.49 * w + 1.732 * height)
                body = (3, one(occ.intersect([body], [(3, limit)])[0]))
            if flange:
                at = low if flange < 0 else low + 0.75 * height
                body = fuse(occ, [body, cylinder(occ, x, y, at, at + 0.25 * height, 2.1 * d)])
            tools = [cylinder(occ, x, y, low - d, low + height + d, bore)]
            if sunk:
                s = 0.06 * d
                tools += [(3, occ.addCone(x, y, low, 0, 0, s, 0.5 * bore + s, 0.5 * bore)),
                          (3, occ.addCone(x, y, low + height - s, 0, 0, s, 0.5 * bore, 0.5 * bore + s))]
            return cut(occ, body, tools)

        return make

    def plain_washer(self, x: float, y: float, low: float, form: str) -> tuple[Make, float]:
        """A ring of a form, and its thickness."""
        inner, outer, t = self.washer
        if form == "wide":
            outer, t = 2.9 * self.d, 0.24 * self.d
        elif form == "split":
            inner, outer, t = 1.03 * self.d, 1.75 * self.d, 0.22 * self.d

        def make(occ: Any) -> tuple[int, int]:
            body = cut(occ, cylinder(occ, x, y, low, low + t, outer),
                       [cylinder(occ, x, y, low - 1, low + t + 1, inner)])
            if form == "split":
                gap = (3, occ.addBox(x, y - 0.05 * self.d, low - 1, self.d, 0.1 * self.d, t + 2))
                body = cut(occ, body, [gap])
            return body

        return make, t

    def ring(self, x: float, y: float, low: float, high: float, inner: float, outer: float) -> Make:
        return lambda occ: cut(occ, cylinder(occ, x, y, low, high, outer),
                               [cylinder(occ, x, y, low - 1, high + 1, inner)])

    def screwed(self, x: float, y: float, bottom: float, top: float, head: str, washer: str = "") -> None:
        """A screw from above into a thread below `bottom`."""
        if washer:
            make, t = self.plain_washer(x, y, top, washer)
            self.add("washer", make, washer)
            top += t
        depth = float(self.rng.uniform(1.0, 1.4)) * self.d
        self.add("bolt", self.bolt(x, y, top, 1, top - bottom + depth, head, depth), head)

    def through(self, x: float, y: float, bottom: float, top: float, head: str, above: str = "",
                below: str = "", flange: bool = False, way: int = 1, fused: bool = False) -> None:
        """A bolt through everything with a nut; way -1: its head is below."""
        faces = [bottom, top]
        for side, form in ((1, above), (0, below)):
            if form:
                t = self.plain_washer(x, y, 0.0, form)[1]
                low = faces[1] if side else faces[0] - t
                self.add("washer", self.plain_washer(x, y, low, form)[0], form)
                faces[side] += t if side else -t
        seat, other = (faces[1], faces[0]) if way > 0 else (faces[0], faces[1])
        past, m = float(self.rng.uniform(0.1, 0.8)) * self.d, self.nut
        thick = self.washer[2] if fused else 0.0
        seat += way * thick
        length = abs(seat - other) + m + past
        self.add("bolt", self.bolt(x, y, seat, way, length, head, m + past, fused),
                 head + (" with washer" if fused else ""))
        low = other - m if way > 0 else other
        self.add("nut", self.hex_nut(x, y, low, m, way if flange else 0), "flanged" if flange else "nut")

    def rod(self, x: float, y: float, bottom: float, top: float, double: bool, washer: str) -> None:
        """A stud with nuts on both ends, two of them perhaps."""
        low, high, m = bottom, top, self.nut
        if washer:
            make, t = self.plain_washer(x, y, top, washer)
            self.add("washer", make, washer)
            self.add("washer", self.plain_washer(x, y, bottom - t, washer)[0], washer)
            low, high = bottom - t, top + t
        for k in range(1 + double):
            self.add("nut", self.hex_nut(x, y, high + k * m, m))
            self.add("nut", self.hex_nut(x, y, low - (k + 1) * m, m))
        past = (1 + double) * m + float(self.rng.uniform(0.1, 0.6)) * self.d
        d = self.d if self.drawn == "overlap" else self.bore
        pointed = self.chance(0.5)

        def make_rod(occ: Any) -> tuple[int, int]:
            s = 0.08 * d if pointed else 0.0
            body = cylinder(occ, x, y, low - past + s, high + past - s, d)
            if not pointed:
                return body
            ends = [(3, occ.addCone(x, y, high + past - s, 0, 0, s, 0.5 * d, 0.5 * d - s)),
                    (3, occ.addCone(x, y, low - past, 0, 0, s, 0.5 * d - s, 0.5 * d))]
            return fuse(occ, [body, *ends])

        self.add("stud", make_rod)

    def holes(self, occ: Any, sites: list[tuple[float, float]], low: float, high: float, d: float,
              slot: float = 0.0) -> list[tuple[int, int]]:
        """Tools for holes; `slot`: half of the distance of the two ends of slots."""
        out = []
        for x, y in sites:
            out += [cylinder(occ, x + s * slot, y, low, high, d) for s in ((-1, 1) if slot else (0,))]
            if slot:
                out.append((3, occ.addBox(x - slot, y - 0.5 * d, low, 2 * slot, d, high - low)))
        return out

    def clear(self, series: float) -> float:
        """Diameter of a clearance hole."""
        return max(self.near(self.d * series), 1.03 * self.d)

    # --- families ---------------------------------------------------------------------------------
    def pipes(self) -> None:
        """Two flanges with necks, a gasket inside of the bolts or under all of the face."""
        d, rng = self.d, self.rng
        count = int(rng.choice([4, 8, 12], p=[0.5, 0.4, 0.1]))
        circle = max(3.5 * d, 3.2 * d * count / math.pi) * float(rng.uniform(1.0, 1.4))
        outer, bore, neck = 2 * circle + 4.5 * d, 2 * circle - 6 * d + 2 * d, 0.0
        bore = max(0.9 * circle, 2 * circle - 5.5 * d)
        neck = bore + 1.2 * d
        t, hole = float(rng.uniform(0.9, 1.6)) * d, self.clear(float(rng.choice([1.08, 1.12])))
        turns = 2 * math.pi * (np.arange(count) + 0.5) / count
        sites = [(circle * math.cos(a), circle * math.sin(a)) for a in turns]
        seal = float(rng.choice([1.5, 2.0, 3.0])) * max(1.0, self.d / 20.0)
        seal = min(seal, 0.02 * outer)
        inside, blind = self.chance(0.6), self.chance(0.3)
        reach = 2 * circle - hole - 0.2 * d if inside else outer

        def flange(way: int, closed: bool) -> Make:
            def make(occ: Any) -> tuple[int, int]:
                z = way * 0.5 * seal

                def disc(low: float, high: float, width: float) -> tuple[int, int]:
                    return 3, occ.addCylinder(0, 0, z + way * low, 0, 0, way * (high - low), 0.5 * width)

                body = disc(0.0, t, outer)
                if inside:  # a raised face
                    low = disc(0.0, 0.1 * d, 2 * outer)
                    body = cut(occ, body, [cut(occ, low, [disc(0.0, 0.1 * d, reach)])])
                if not closed:
                    r = 0.5 * neck
                    hub = (3, occ.addCone(0, 0, z + way * t, 0, 0, way * 1.2 * d, r + 0.4 * d, r))
                    body = fuse(occ, [body, hub, disc(t + 1.2 * d, t + 3.0 * d, neck)])
                tools = [] if closed else [disc(-1.0, t + 4 * d, bore)]
                return cut(occ, body, [*tools, *self.holes(occ, sites, z - 9 * t, z + 9 * t, hole)])

            return make

        self.add("", flange(1, blind), "blind flange" if blind else "flange")
        self.add("", flange(-1, False), "flange")

        def gasket(occ: Any) -> tuple[int, int]:
            body = cut(occ, cylinder(occ, 0, 0, -0.5 * seal, 0.5 * seal, reach),
                       [cylinder(occ, 0, 0, -seal, seal, bore)])
            return body if inside else cut(occ, body, self.holes(occ, sites, -seal, seal, hole))

        self.add("gasket", gasket, "inside of the bolts" if inside else "full face")
        studs, washer = self.chance(0.5), "plain" if self.chance(0.4) else ""
        for x, y in sites:
            if studs:
                self.rod(x, y, -0.5 * seal - t, 0.5 * seal + t, False, washer)
            else:
                self.through(x, y, -0.5 * seal - t, 0.5 * seal + t, "hexagon", washer, washer, way=1)
        if self.chance(0.5):  # a pipe that goes on, and a plug
            low = -0.5 * seal - t - 3.0 * d
            self.add("", self.ring(0, 0, low - 2 * d, low, bore, neck), "pipe")

    def cover(self) -> None:
        """A housing with a cover, cap screws in counterbores, a frame as gasket, a shaft in bearing rings."""
        d, rng = self.d, self.rng
        nx, ny = int(rng.integers(2, 4)), int(rng.integers(2, 4))
        pitch = float(rng.uniform(5.0, 8.0)) * d
        xs, ys = pitch * (np.arange(nx) - 0.5 * (nx - 1)), pitch * (np.arange(ny) - 0.5 * (ny - 1))
        edge = [(float(x), float(y)) for x in xs for y in ys
                if x in (xs[0], xs[-1]) or y in (ys[0], ys[-1])]
        a, b = float(xs[-1]) + 1.8 * d, float(ys[-1]) + 1.8 * d
        ia, ib = a - 3.6 * d, b - 3.6 * d
        deep, t = float(rng.uniform(4.0, 6.0)) * d, float(rng.uniform(1.8, 2.5)) * d
        seal = min(float(rng.uniform(0.5, 2.0)), 0.02 * math.hypot(2 * a, 2 * b)) if self.chance(0.6) else 0.0
        sunk = self.chance(0.5)
        hole, head_room = self.clear(1.1), 1.12 * max(self.socket, 1.75 * d)
        shaft = float(rng.choice([0.0, 1.4 * d, 2.0 * d])) if min(ia, ib) > 2.5 * d else 0.0
        split = "" if self.chance(0.6) else str(rng.choice(["plain", "split"]))
        pins = [(0.5 * (edge[0][0] + edge[1][0]), edge[0][1] - (1e-9 if edge[0][0] != edge[1][0] else 0))] \
            if not seal and self.chance(0.5) and edge[0][0] != edge[1][0] else []
        if not seal and self.chance(0.5) and not pins:
            pins = [(edge[0][0], 0.5 * (edge[0][1] + edge[1][1]))]

        def housing(occ: Any) -> tuple[int, int]:
            body = cut(occ, (3, occ.addBox(-a, -b, -deep, 2 * a, 2 * b, deep)),
                       [(3, occ.addBox(-ia, -ib, -deep + d, 2 * ia, 2 * ib, deep))])
            tools = [cylinder(occ, x, y, -1.8 * d, 0.0, self.bore) for x, y in edge]
            tools += [cylinder(occ, x, y, -d, 0.0, 0.5 * d) for x, y in pins]
            if shaft:
                tools.append(cylinder(occ, 0, 0, -deep - 1, -deep + 2 * d, 1.9 * shaft))
            return cut(occ, body, tools)

        def lid(occ: Any) -> tuple[int, int]:
            body = (3, occ.addBox(-a, -b, seal, 2 * a, 2 * b, t))
            tools = self.holes(occ, edge, seal - 1, seal + t + 1, hole)
            if sunk:
                tools += self.holes(occ, edge, seal + t - 0.6 * d, seal + t + 1, head_room)
            tools += [cylinder(occ, x, y, seal - 1, seal + 0.8 * d, 0.5 * d) for x, y in pins]
            if shaft:
                tools.append(cylinder(occ, 0, 0, seal - 1, seal + t + 1, 1.9 * shaft))
            return cut(occ, body, tools)

        self.add("", housing, "housing")
        self.add("", lid, "cover")
        if seal:
            def frame(occ: Any) -> tuple[int, int]:
                body = cut(occ, (3, occ.addBox(-a, -b, 0, 2 * a, 2 * b, seal)),
                           [(3, occ.addBox(-ia, -ib, -1, 2 * ia, 2 * ib, seal + 2))])
                return cut(occ, body, self.holes(occ, edge, -1, seal + 1, hole))

            self.add("gasket", frame, "frame")
        for x, y in pins:
            self.add("dowel", lambda occ, x=x, y=y: cylinder(occ, x, y, -0.9 * d, 0.7 * d, 0.5 * d))
        head = str(rng.choice(["socket", "low", "hexagon"], p=[0.6, 0.2, 0.2]))
        if sunk and head == "hexagon":
            head = "socket"
        for x, y in edge:
            self.screwed(x, y, 0.0, seal + t - (0.6 * d if sunk else 0.0), head, split)
        if shaft:
            z = seal + 0.3 * t
            self.add("", lambda occ: fuse(occ, [
                cylinder(occ, 0, 0, -deep - 2 * d, seal + t + 3 * d, shaft),
                cylinder(occ, 0, 0, -deep + 1.5 * d, -deep + 2.5 * d, 1.5 * shaft)]), "shaft")
            wide = float(rng.uniform(0.25, 0.6)) * shaft
            self.add("", self.ring(0, 0, z, z + wide, shaft, 1.3 * shaft), "inner bearing ring")
            self.add("", self.ring(0, 0, z, z + wide, 1.55 * shaft, 1.9 * shaft), "outer bearing ring")
            if self.chance(0.5):
                z += wide
                self.add("", self.ring(0, 0, z, z + 0.08 * shaft, shaft, 1.28 * shaft), "circlip")

    def frame(self) -> None:
        """A hollow section with plates on both sides, bolts through all of it, slots, shims and sleeves."""
        d, rng = self.d, self.rng
        count, pitch = int(rng.integers(1, 5)), float(rng.uniform(4.0, 7.0)) * d
        sites = [(pitch * (k - 0.5 * (count - 1)), 0.0) for k in range(count)]
        long, wide = pitch * count + 4 * d, float(rng.uniform(5.0, 7.0)) * d
        wall = float(rng.uniform(0.5, 0.9)) * d
        high, t = float(rng.uniform(4.0, 7.0)) * d, float(rng.uniform(0.6, 1.5)) * d
        hole, slot = self.clear(1.12), 0.5 * d if self.chance(0.5) else 0.0
        shim = float(rng.uniform(0.05, 0.2)) * d if self.chance(0.4) else 0.0
        sleeve = self.chance(0.5)

        def tube(occ: Any) -> tuple[int, int]:
            w, h = wide - 2 * wall, high - 2 * wall
            body = cut(occ, (3, occ.addBox(-0.5 * long, -0.5 * wide, 0, long, wide, high)),
                       [(3, occ.addBox(-long, -0.5 * w, wall, 2 * long, w, h))])
            return cut(occ, body, self.holes(occ, sites, -1, high + 1, hole))

        def plate(z: float, thick: float, extra: float, stem: bool, slotted: float) -> Make:
            def make(occ: Any) -> tuple[int, int]:
                body = (3, occ.addBox(-0.5 * long, -0.5 * wide, z, long, wide + extra, thick))
                if stem:  # an angle
                    wing = (3, occ.addBox(-0.5 * long, 0.5 * wide + extra - t, z, long, t, 5 * d))
                    body = fuse(occ, [body, wing])
                return cut(occ, body, self.holes(occ, sites, z - 1, z + thick + 1, hole, slotted))

            return make

        self.add("", tube, "hollow section")
        top = high
        if shim:
            self.add("sheet", plate(top, shim, 0.0, False, 0.0), "shim")
            top += shim
        self.add("", plate(top, t, 3.5 * d, True, slot), "angle")
        self.add("", plate(-t, t, 0.0, False, 0.0), "backing plate")
        form = str(rng.choice(["", "plain", "wide"], p=[0.2, 0.5, 0.3]))
        form = "wide" if slot and form else form
        way = int(rng.choice([-1, 1]))
        for x, y in sites:
            if sleeve:
                self.add("", self.ring(x, y, wall, high - wall, 1.12 * d, 1.7 * d), "spacer tube")
            self.through(x, y, -t, top + t, "hexagon", form, "plain" if self.chance(0.5) else "", way=way)

    def clamp(self) -> None:
        """Two halves around a shaft, screwed together, with dowels perhaps."""
        d, rng = self.d, self.rng
        bar, long = float(rng.uniform(2.5, 6.0)) * d, float(rng.uniform(3.5, 8.0)) * d
        x0 = 0.5 * bar + 1.8 * d
        rows = int(rng.integers(1, 3))
        ys = [0.0] if rows == 1 else [-0.25 * long, 0.25 * long]
        sites = [(s * x0, y) for s in (-1, 1) for y in ys]
        high, a = 0.5 * bar + float(rng.uniform(1.0, 2.0)) * d, x0 + 1.8 * d
        hole, sunk, shim = self.clear(1.1), self.chance(0.5), 0.15 * d if self.chance(0.3) else 0.0
        pinned = rows == 1 and not shim and self.chance(0.5)
        pins = [(s * (x0 + 0.9 * d), 0.4 * long) for s in (-1, 1)] if pinned else []
        deep = high + (d if self.chance(0.5) else 0.0)
        seat = shim + high - (d if sunk else 0.0)

        def half(low: float, height: float, upper: bool) -> Make:
            def make(occ: Any) -> tuple[int, int]:
                body = (3, occ.addBox(-a, -0.5 * long, low, 2 * a, long, height))
                tools = [(3, occ.addCylinder(0, -long, 0.5 * shim, 0, 2 * long, 0, 0.5 * bar))]
                if upper:
                    tools += self.holes(occ, sites, low - 1, low + height + 1, hole)
                    if sunk:
                        tools += self.holes(occ, sites, seat, low + height + 1, 1.15 * self.socket)
                else:
                    tools += self.holes(occ, sites, -1.6 * d, 0.0, self.bore)
                tools += [cylinder(occ, x, y, -0.8 * d, shim + 0.8 * d, 0.45 * d) for x, y in pins]
                return cut(occ, body, tools)

            return make

        self.add("", half(-deep, deep, False), "lower half")
        self.add("", half(shim, high, True), "upper half")
        if shim:
            for s in (-1, 1):
                left = min(s * (0.5 * bar + 0.1 * d), s * a)

                def strip(occ: Any, left: float = left) -> tuple[int, int]:
                    body = (3, occ.addBox(left, -0.5 * long, 0, a - 0.5 * bar - 0.1 * d, long, shim))
                    return cut(occ, body, self.holes(occ, sites, -1, shim + 1, hole))

                self.add("sheet", strip, "shim")
        head = "socket" if sunk else str(rng.choice(["socket", "hexagon", "flange"]))
        for x, y in sites:
            self.screwed(x, y, 0.0, seat, head, "" if sunk or self.chance(0.5) else "plain")
        for x, y in pins:
            z = shim + 0.75 * d
            self.add("dowel", lambda occ, x=x, y=y, z=z: cylinder(occ, x, y, -0.75 * d, z, 0.45 * d))
        stepped = self.chance(0.5)

        def shaft(occ: Any) -> tuple[int, int]:
            body = (3, occ.addCylinder(0, -2 * long, 0.5 * shim, 0, 4 * long, 0, 0.5 * bar))
            if not stepped:
                return body
            return fuse(occ, [body, (3, occ.addCylinder(0, long, 0.5 * shim, 0, d, 0, 0.8 * bar))])

        self.add("", shaft, "shaft with a shoulder" if stepped else "shaft")
        if self.chance(0.5):
            r = 0.5 * bar
            self.add("", lambda occ: cut(
                occ, (3, occ.addCylinder(0, -1.5 * long, 0.5 * shim, 0, 0.3 * bar, 0, 1.6 * r)),
                [(3, occ.addCylinder(0, -3 * long, 0.5 * shim, 0, 3 * long, 0, r))]), "collar on the shaft")

    def stack(self) -> None:
        """Plates on long tie rods, with tubes between."""
        d, rng = self.d, self.rng
        count, radius = int(rng.integers(2, 5)), float(rng.uniform(3.0, 6.0)) * d
        sites = [(radius * math.cos(2 * math.pi * k / count), radius * math.sin(2 * math.pi * k / count))
                 for k in range(count)]
        levels, t = int(rng.integers(2, 4)), float(rng.uniform(0.8, 1.5)) * d
        gap, a, hole = float(rng.uniform(3.0, 8.0)) * d, radius + 2.2 * d, self.clear(1.1)
        outer = float(rng.uniform(1.6, 2.2))
        for k in range(levels):
            z = k * (t + gap)

            def plate(occ: Any, z: float = z) -> tuple[int, int]:
                tools = self.holes(occ, sites, z - 1, z + t + 1, hole)
                return cut(occ, cylinder(occ, 0, 0, z, z + t, 2 * a), tools)

            self.add("", plate, "plate")
            for x, y in sites if k + 1 < levels else ():
                self.add("", self.ring(x, y, z + t, z + t + gap, hole, outer * d), "tube")
        washer = "plain" if self.chance(0.5) else ""
        for x, y in sites:
            self.rod(x, y, 0.0, levels * t + (levels - 1) * gap, self.chance(0.3), washer)

    def mount(self) -> None:
        """A foot with ribs and slots on a pad, bolts and nuts with flanges, or bolts with washers on them."""
        d, rng = self.d, self.rng
        x0, y0 = float(rng.uniform(4.0, 6.0)) * d, float(rng.uniform(2.0, 4.0)) * d
        sites = [(sx * x0, sy * y0) for sx in (-1, 1) for sy in ((-1, 1) if self.chance(0.6) else (0,))]
        a, b = x0 + 2.5 * d, y0 + 2.5 * d
        t, base = float(rng.uniform(0.8, 1.4)) * d, float(rng.uniform(1.0, 2.0)) * d
        pad = min(0.02 * math.hypot(2 * a, 2 * b), float(rng.uniform(1.0, 4.0))) if self.chance(0.5) else 0.0
        hole, slot = self.clear(1.12), 0.4 * d if self.chance(0.5) else 0.0
        bush = self.chance(0.3) and not slot
        foot_hole = 1.8 * d if bush else hole

        def slab(low: float, high: float, width: float, slotted: float) -> Make:
            return lambda occ: cut(occ, (3, occ.addBox(-a, -b, low, 2 * a, 2 * b, high - low)),
                                   self.holes(occ, sites, low - 1, high + 1, width, slotted))

        def foot(occ: Any) -> tuple[int, int]:
            body = [(3, occ.addBox(-a, -b, pad, 2 * a, 2 * b, t)),
                    (3, occ.addBox(-0.8 * d, -b, pad, 1.6 * d, 2 * b, t + 5 * d))]
            for s in (-1, 1):
                x = s * 0.35 * x0 - 0.2 * x0
                body.append((3, occ.addBox(x, -0.3 * d, pad, 0.4 * x0, 0.6 * d, t + 2 * d)))
            across = (3, occ.addCylinder(-d, 0, pad + t + 3.5 * d, 2 * d, 0, 0, 0.9 * d))
            tools = self.holes(occ, sites, pad - 1, pad + t + 1, foot_hole, slot)
            return cut(occ, fuse(occ, body), [across, *tools])

        self.add("", slab(-base, 0.0, hole, 0.0), "base")
        self.add("", foot, "foot")
        if pad:
            self.add("gasket", slab(0.0, pad, hole, 0.0), "pad")
        way = str(rng.choice(["flange", "fused", "plain"]))
        for x, y in sites:
            if bush:
                self.add("", self.ring(x, y, pad, pad + t, 1.1 * d, 1.8 * d), "bush")
            washer = "wide" if slot or bush else "plain"
            if way == "plain" or slot or bush:
                self.through(x, y, -base, pad + t, "hexagon", washer, "")
            else:
                self.through(x, y, -base, pad + t, "flange" if way == "flange" else "hexagon",
                             flange=way == "flange", fused=way == "fused")
        self.add("", self.ring(0, 0, 20 * d, 20 * d + 3 * d, 1.2 * d, 2.5 * d), "rubber bush")


def made(seed: int, off: bool = False) -> Assembly:
    """An assembly; `off`: sizes of fasteners and holes are up to 5 % off."""
    maker = Families(seed + 50_000, off)
    (maker.pipes, maker.cover, maker.frame, maker.clamp, maker.stack, maker.mount)[seed % 6]()
    return finished(maker)
