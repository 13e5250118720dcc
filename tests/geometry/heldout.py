"""Assemblies of families that the recognition has not seen, drawn in ways of their own.

Hinges, rails under double nuts, motors on slotted feet, split pumps, laminated stacks and pillow blocks: cap,
button, countersunk, cheese and flanged heads, nuts with collars of plastic or a flange, chamfered, wide and
split washers, gaskets with lobes, thin insulation; beside them hinge pins, keys, hubs, covers, sleeves,
bearing rings, spacers, shims. Some files have all faces as splines.

Nobody tunes anything on these: who changes the recognition because of one of them moves its family to
``families.py`` and writes another. ``made(seed)`` makes one; the family is seed modulo six.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tests.geometry.assemblies import Assembly, Make, Maker, cut, cylinder, finished, fuse, hexagon, one

Sites = list[tuple[float, float]]

_NAMES = {
    "bolt": ("M{d} x {l} Screw", "Flachkopfschraube M{d}", "Vis FHC M{d}x{l}", "cap_screw.{n}",
             "Hex Bolt {n}", "Vite a brugola M{d}", "TORNILLO ALLEN {n}",
             "ISO 10642 M{d}x{l}", "DIN 931-M{d}x{l}"),
    "stud": ("Stud M{d}", "goujon filete {n}", "Gewindestange M{d}-{l}", "barra roscada {n}", "DIN 976 M{d}"),
    "nut": ("Nylon insert lock nut {n}", "DIN 985 M{d}", "Sicherungsmutter {n}", "ecrou frein {n}", "Nut.{n}",
            "tuerca autoblocante {n}", "Dado flangiato M{d}"),
    "washer": ("Fender washer {n}", "Federscheibe-{n}", "rondelle large {n}", "rosetta {n}", "DIN 127 - {d}"),
    "gasket": ("Papierdichtung {n}", "rubber pad {n}", "joint de culasse {n}", "GASKET.{n}",
               "junta plana {n}"),
    "dowel": ("Zylinderstift {n}", "dowel.{n}", "spina cilindrica {n}", "goupille {n}"),
    "sheet": ("Passblech {n}", "shim {n}", "part.{n}", "Unterlage {n}", "cale d'epaisseur {n}"),
    "": ("motor {n}", "Gehaeuseoberteil {n}", "leaf.{n}", "Rippe {n}", "volute {n}", "Scharnier {n}",
         "Part{n}", "nutplate carrier {n}", "Boltzmann jig {n}", "key {n}", "Deckplatte {n}"),
}


class _HeldOut(Maker):
    """Draws an assembly of a family; all lengths in mm, along z."""

    names = _NAMES

    def __init__(self, seed: int, off: bool) -> None:
        super().__init__(seed, off)
        self.way = str(self.rng.choice(["nominal", "core", "overlap"], p=[0.4, 0.25, 0.35]))
        core = self.d * float(self.rng.uniform(0.82, 0.86))
        widths = {"nominal": (self.d, self.d), "core": (core, core), "overlap": (self.d, core)}
        self.tip, self.bore = widths[self.way]

    # --- fasteners --------------------------------------------------------------------------------
    def screw(self, x: float, y: float, seat: float, way: int, length: float, thread: float,
              head: str) -> Make:
        """A screw whose head lies on (countersunk: ends at) `seat`, towards `way`."""
        d, w, k, dk, tip = self.d, self.across, self.head, self.socket, self.tip
        turn, pointed = float(self.rng.uniform(0, 1)), self.chance(0.6)
        full = min(thread + 0.7 * d, 0.95 * length)

        def make(occ: Any) -> tuple[int, int]:
            def rod(low: float, high: float, width: float) -> tuple[int, int]:
                return 3, occ.addCylinder(x, y, seat + way * low, 0, 0, way * (high - low), 0.5 * width)

            def cone(low: float, high: float, a: float, b: float) -> tuple[int, int]:
                return 3, occ.addCone(x, y, seat + way * low, 0, 0, way * (high - low), 0.5 * a, 0.5 * b)

            s = 0.07 * d if pointed else 0.0
            rods = [cone(-length, -length + s, tip - 2 * s, tip)] if s else []
            rods.append(rod(-length + s, -full, tip))
            top = 0.0
            if head == "countersunk":
                rods += [rod(-full, -0.5 * d, d), cone(-0.5 * d, 0.0, d, 2.0 * d)]  # as ISO 10642, M20
            elif head == "hexagon":
                face = rod(0.0, 0.05 * d, 0.95 * w)
                top = k
                block = hexagon(occ, x, y, seat + way * 0.05 * d, seat + way * k, w, turn)
                limit = (3, occ.addCone(x, y, seat, 0, 0, way * k, 0.485 * w + 1.732 * k, 0.485 * w))
                rods += [rod(-full, 0.0, d), face, (3, one(occ.intersect([block], [limit])[0]))]
            elif head == "flanged":
                top = 1.1 * k
                rods += [rod(-full, 0.0, d), rod(0.0, 0.08 * d, 2.15 * d),
                         cone(0.08 * d, 0.3 * d, 2.15 * d, w),
                         hexagon(occ, x, y, seat, seat + way * top, w, turn)]
            elif head == "button":
                top = 0.55 * d
                ball = (3, occ.addSphere(x, y, seat + way * (top - 0.95 * d), 0.95 * d))
                dome = (3, one(occ.intersect([rod(0.0, top, 1.7 * d)], [ball])[0]))
                rods += [rod(-full, 0.0, d), dome]
            else:  # socket or cheese
                top = d if head == "socket" else 0.65 * d
                rods += [rod(-full, 0.0, d), rod(0.0, 0.92 * top, dk),
                         cone(0.92 * top, top, dk, dk - 0.12 * top)]
            body = fuse(occ, rods[::-1])
            if head == "cheese":
                low = seat + way * 0.35 * d - (0 if way > 0 else d)
                slot = occ.addBox(x - 2 * d, y - 0.12 * d, low, 4 * d, 0.24 * d, d)
                return cut(occ, body, [(3, slot)])
            if head in ("socket", "button", "countersunk"):
                low = top - (0.5 * d if head == "socket" else 0.3 * d)
                key = hexagon(occ, x, y, seat + way * low, seat + way * (top + 0.1 * d),
                              (0.8 if head == "socket" else 0.6) * d, turn)
                body = cut(occ, body, [key])
            return body

        return make

    def nut_on(self, x: float, y: float, low: float, way: int, form: str) -> tuple[Make, float]:
        """A nut whose seat is at `low` and that goes towards `way`, and how high it is."""
        d, w, m, bore, turn = self.d, self.across, self.nut, self.bore, float(self.rng.uniform(0, 1))
        high = m * {"plain": 1.0, "locking": 1.25, "flanged": 1.1, "thin": 0.6}[form]

        def make(occ: Any) -> tuple[int, int]:
            body = hexagon(occ, x, y, low, low + way * (m if form == "locking" else high), w, turn)
            if form == "locking":
                collar = (3, occ.addCylinder(x, y, low + way * m, 0, 0, way * 0.25 * m, 0.42 * w))
                body = fuse(occ, [body, collar])
            elif form == "flanged":
                disc = (3, occ.addCylinder(x, y, low, 0, 0, way * 0.2 * m, 1.05 * d))
                body = fuse(occ, [body, disc])
            else:
                limit = occ.addCone(x, y, low, 0, 0, way * high, 0.485 * w + 1.732 * high, 0.485 * w)
                body = (3, one(occ.intersect([body], [(3, limit)])[0]))
            return cut(occ, body, [cylinder(occ, x, y, low - 9 * d, low + 9 * d, bore)])

        return make, high

    def ring_on(self, x: float, y: float, low: float, way: int, form: str) -> tuple[Make, float]:
        """A washer on `low` towards `way`, and its thickness."""
        inner, outer, t = self.washer
        if form == "wide":
            outer, t = 2.9 * self.d, 0.22 * self.d
        elif form == "split":
            inner, outer, t = 1.03 * self.d, 1.7 * self.d, 0.23 * self.d
        bottom = low if way > 0 else low - t

        def make(occ: Any) -> tuple[int, int]:
            body = cylinder(occ, x, y, bottom, bottom + t, outer)
            if form == "chamfered":
                s = 0.25 * t
                edge = occ.addCone(x, y, bottom + t - s, 0, 0, s, 0.5 * outer, 0.5 * outer - s)
                body = fuse(occ, [cylinder(occ, x, y, bottom, bottom + t - s, outer), (3, edge)])
            tools = [cylinder(occ, x, y, bottom - 1, bottom + t + 1, inner)]
            if form == "split":
                wide = 0.08 * self.d
                tools.append((3, occ.addBox(x, y - 0.5 * wide, bottom - 1, 2 * self.d, wide, t + 2)))
            return cut(occ, body, tools)

        return make, t

    def washer_at(self, x: float, y: float, low: float, way: int, form: str) -> float:
        """Added if there is a form; where it ends."""
        if not form:
            return low
        make, t = self.ring_on(x, y, low, way, form)
        self.add("washer", make, form)
        return low + way * t

    def nut_at_end(self, x: float, y: float, low: float, way: int, form: str) -> float:
        make, high = self.nut_on(x, y, low, way, form)
        self.add("nut", make, form)
        return low + way * high

    def bolted(self, x: float, y: float, bottom: float, top: float, head: str, nut: str,
               rings: tuple[str, str], way: int = 1) -> None:
        """Head on top (way 1) or below, washers at both ends, a nut."""
        ends = (top, bottom) if way > 0 else (bottom, top)
        seat = self.washer_at(x, y, ends[0], way, rings[0])
        other = self.washer_at(x, y, ends[1], -way, rings[1])
        end = self.nut_at_end(x, y, other, -way, nut)
        past = float(self.rng.uniform(0.15, 0.7)) * self.d
        long = abs(seat - end) + past
        self.add("bolt", self.screw(x, y, seat, way, long, abs(end - other) + past, head), head)

    def tapped(self, x: float, y: float, face: float, top: float, head: str, ring: str = "") -> None:
        """Into a thread below `face`."""
        seat = self.washer_at(x, y, top, 1, ring)
        deep = float(self.rng.uniform(1.0, 1.5)) * self.d
        self.add("bolt", self.screw(x, y, seat, 1, seat - face + deep, deep, head), head)

    def tool(self, occ: Any, sites: Sites, low: float, high: float, width: float,
             slot: float = 0.0) -> list[tuple[int, int]]:
        """Holes, or slots along y whose ends are 2 `slot` apart."""
        out = []
        for x, y in sites:
            out += [cylinder(occ, x, y + s * slot, low, high, width) for s in ((-1, 1) if slot else (0,))]
            if slot:
                out.append((3, occ.addBox(x - 0.5 * width, y - slot, low, width, 2 * slot, high - low)))
        return out

    def sunk(self, occ: Any, sites: Sites, top: float) -> list[tuple[int, int]]:
        """For countersunk heads."""
        deep, wide = 0.55 * self.d, 1.05 * self.d
        return [(3, occ.addCone(x, y, top, 0, 0, -deep, wide, wide - deep)) for x, y in sites]

    def room(self) -> float:
        """Diameter of a clearance hole."""
        return max(self.near(self.d * float(self.rng.choice([1.06, 1.1, 1.16]))), 1.04 * self.d)

    def slab(self, half: tuple[float, float], low: float, high: float, sites: Sites, width: float,
             slot: float = 0.0, at: tuple[float, float] = (0.0, 0.0)) -> Make:
        (a, b), (x, y) = half, at

        def make(occ: Any) -> tuple[int, int]:
            body = (3, occ.addBox(x - a, y - b, low, 2 * a, 2 * b, high - low))
            return cut(occ, body, self.tool(occ, sites, low - 1, high + 1, width, slot)) if sites else body

        return make

    # --- families ---------------------------------------------------------------------------------
    def hinge(self) -> None:
        """Two leaves with knuckles on a pin, screwed to two boards, with a packer perhaps."""
        d, rng = self.d, self.rng
        rows, t = int(rng.integers(1, 4)), float(rng.uniform(0.8, 1.2)) * d
        wide = float(rng.uniform(4.0, 6.0)) * d
        pitch, pin = float(rng.uniform(3.5, 5.0)) * d, float(rng.uniform(0.9, 1.6)) * d
        half, board, hole = 0.5 * pitch * rows + d, float(rng.uniform(2.2, 3.0)) * d, self.room()
        pack = 0.12 * d if self.chance(0.5) else 0.0
        head = str(rng.choice(["countersunk", "button", "cheese", "socket"], p=[0.4, 0.2, 0.2, 0.2]))
        through = self.chance(0.4)
        knuckle, gap = 0.5 * pin + 0.6 * d, 0.05 * d
        for side in (-1, 1):
            at = side * (knuckle + 0.5 * d + 0.5 * wide)
            sites = [(at, pitch * (k - 0.5 * (rows - 1))) for k in range(rows)]

            def leaf(occ: Any, side: int = side, at: float = at, sites: Sites = sites) -> tuple[int, int]:
                body = [(3, occ.addBox(at - 0.5 * wide, -half, 0, wide, 2 * half, t))]
                low, high = (-half, -gap) if side < 0 else (gap, half)
                length = knuckle + 0.5 * d
                body.append((3, occ.addBox(min(0.0, side * length), low, 0, length, high - low, t)))
                body.append((3, occ.addCylinder(0, low, knuckle, 0, high - low, 0, knuckle)))
                whole = fuse(occ, body)
                tools = self.tool(occ, sites, -1, t + 1, hole)
                if head == "countersunk":
                    tools += self.sunk(occ, sites, t)
                return cut(occ, whole, [*tools, (3, occ.addCylinder(0, -9 * half, knuckle, 0, 18 * half, 0,
                                                                    0.5 * pin))])

            self.add("", leaf, "leaf")
            area = (0.5 * wide, half)
            low = -pack
            if pack:
                self.add("sheet", self.slab(area, -pack, 0.0, sites, hole, at=(at, 0.0)), "packer")
            bore = hole if through else self.bore
            self.add("", self.slab(area, low - board, low, sites, bore, at=(at, 0.0)), "board")
            for x, y in sites:
                if through:
                    nut = str(rng.choice(["plain", "locking", "flanged"]))
                    self.bolted(x, y, low - board, t, head, nut, ("", "plain" if self.chance(0.5) else ""))
                else:
                    self.tapped(x, y, low, t, head)

        def make_pin(occ: Any) -> tuple[int, int]:
            body = (3, occ.addCylinder(0, -half - 0.2 * d, knuckle, 0, 2 * half + 0.4 * d, 0, 0.5 * pin))
            return fuse(occ, [body, (3, occ.addCylinder(0, half, knuckle, 0, 0.4 * pin, 0, 0.8 * pin))])

        self.add("", make_pin, "hinge pin")

    def rails(self) -> None:
        """Rails across each other under studs with two nuts, slots, wide washers."""
        d, rng = self.d, self.rng
        count, pitch = int(rng.integers(1, 4)), float(rng.uniform(5.0, 9.0)) * d
        sites = [(0.0, pitch * (k - 0.5 * (count - 1))) for k in range(count)]
        long, hole = pitch * count + 4 * d, self.room()
        slot = 0.6 * d if self.chance(0.5) else 0.0
        t, s = float(rng.uniform(1.0, 2.0)) * d, float(rng.uniform(1.0, 2.0)) * d
        self.add("", self.slab((2.5 * d, 0.5 * long), 0.0, t, sites, hole, slot), "rail")
        for x, y in sites:
            self.add("", self.slab((6 * d, 1.6 * d), -s, 0.0, [(x, y)], hole, at=(x, y)), "cross rail")
            form = "wide" if slot else str(rng.choice(["plain", "chamfered", "wide"]))
            low = self.washer_at(x, y, -s, -1, form if self.chance(0.6) else "")
            high = self.washer_at(x, y, t, 1, form)
            double = str(rng.choice(["thin", "plain"]))
            for _ in range(2):
                high = self.nut_at_end(x, y, high, 1, double)
            low = self.nut_at_end(x, y, low, -1, str(rng.choice(["plain", "locking"])))
            if self.chance(0.5):
                low = self.nut_at_end(x, y, low, -1, double)
            past = float(rng.uniform(0.1, 0.8)) * d
            wide, pointed = (self.d if self.way == "overlap" else self.bore), 0.07 * d

            def rod(occ: Any, x: float = x, y: float = y, low: float = low - past,
                    high: float = high + past) -> tuple[int, int]:
                r = 0.5 * wide
                return fuse(occ, [
                    cylinder(occ, x, y, low + pointed, high - pointed, wide),
                    (3, occ.addCone(x, y, high - pointed, 0, 0, pointed, r, r - pointed)),
                    (3, occ.addCone(x, y, low, 0, 0, pointed, r - pointed, r))])

            self.add("stud", rod)
        self.add("", self.slab((d, d), t + 20 * d, t + 24 * d, [], 0.0), "stop")

    def motor(self) -> None:
        """A motor with a foot in slots on a plate over a pad; its shaft with a key and a hub."""
        d, rng = self.d, self.rng
        x0, y0 = float(rng.uniform(4.0, 6.0)) * d, float(rng.uniform(3.0, 5.0)) * d
        sites = [(sx * x0, sy * y0) for sx in (-1, 1) for sy in (-1, 1)]
        half, t = (x0 + 2.5 * d, y0 + 2.5 * d), float(rng.uniform(0.8, 1.4)) * d
        base = float(rng.uniform(1.5, 3)) * d
        hole, slot = self.room(), 0.4 * d if self.chance(0.6) else 0.0
        pad = min(float(rng.uniform(1.0, 4.0)), 0.035 * math.hypot(*half)) if self.chance(0.6) else 0.0
        r = float(rng.uniform(0.5, 0.7)) * y0
        tapped = self.chance(0.5)

        def housing(occ: Any) -> tuple[int, int]:
            z = pad + t + r
            body = fuse(occ, [(3, occ.addBox(-half[0], -half[1], pad, 2 * half[0], 2 * half[1], t)),
                              (3, occ.addBox(-x0 + 2.4 * d, -0.5 * r, pad, 2 * x0 - 4.8 * d, r, t + 0.7 * r)),
                              (3, occ.addCylinder(-x0 + 2.4 * d, 0, z, 2 * x0 - 4.8 * d, 0, 0, r))])
            return cut(occ, body, [(3, occ.addCylinder(-2 * x0, 0, z, 4 * x0, 0, 0, 0.4 * r)),
                                   *self.tool(occ, sites, pad - 1, pad + t + 1, hole, slot)])

        self.add("", housing, "motor")
        self.add("", self.slab(half, -base, 0.0, sites, self.bore if tapped else hole), "plate")
        if pad:
            self.add("gasket", self.slab(half, 0.0, pad, sites, hole), "pad")
        ring = "wide" if slot else str(rng.choice(["", "plain", "split"]))
        head = str(rng.choice(["hexagon", "socket", "flanged"]))
        for x, y in sites:
            if tapped:
                self.tapped(x, y, 0.0, pad + t, head, ring)
            else:
                self.bolted(x, y, -base, pad + t, head, str(rng.choice(["plain", "locking"])),
                            (ring, "plain" if self.chance(0.5) else ""))
        z, end, w = pad + t + r, 2.5 * x0, 0.16 * r

        def shaft(occ: Any) -> tuple[int, int]:
            body = (3, occ.addCylinder(-1.2 * x0, 0, z, 1.2 * x0 + end, 0, 0, 0.4 * r))
            return cut(occ, body, [(3, occ.addBox(end - 1.5 * r, -0.5 * w, z + 0.25 * r, 1.2 * r, w, r))])

        self.add("", shaft, "shaft")
        self.add("", lambda occ: (3, occ.addBox(end - 1.5 * r, -0.5 * w, z + 0.25 * r, 1.2 * r, w, 0.14 * r)),
                 "key")
        wide = float(rng.uniform(0.4, 1.5)) * r
        self.add("", lambda occ: cut(occ, (3, occ.addCylinder(end - wide, 0, z, wide, 0, 0, 0.8 * r)),
                                     [(3, occ.addCylinder(end - 2 * wide, 0, z, 3 * wide, 0, 0, 0.4 * r))]),
                 "hub")

    def pump(self) -> None:
        """Two halves with lobes around their bolts, a gasket of the same outline, dowels."""
        d, rng = self.d, self.rng
        count = int(rng.integers(3, 8))
        circle = max(4.0 * d, 3.4 * d * count / (2 * math.pi)) * float(rng.uniform(1.0, 1.3))
        turns = 2 * math.pi * (np.arange(count) + float(rng.uniform())) / count
        sites = [(circle * math.cos(a), circle * math.sin(a)) for a in turns]
        bore, t, hole = 2 * circle - 3.4 * d, float(rng.uniform(1.2, 2.2)) * d, self.room()
        seal = min(float(rng.choice([0.5, 1.0, 2.0])), 0.03 * circle) if self.chance(0.75) else 0.0
        pins = [(circle * math.cos(a), circle * math.sin(a)) for a in (turns[:2] + math.pi / count)]
        pins = pins if not seal and count < 7 and self.chance(0.6) else []
        tapped = self.chance(0.5)

        def outline(occ: Any, low: float, high: float) -> tuple[int, int]:
            disc = cylinder(occ, 0, 0, low, high, 2 * circle)
            return fuse(occ, [disc, *(cylinder(occ, x, y, low, high, 3 * d) for x, y in sites)])

        def half(low: float, high: float, way: int, width: float) -> Make:
            def make(occ: Any) -> tuple[int, int]:
                face = low if way > 0 else high
                neck = cylinder(occ, 0, 0, low - 3 * d * (way < 0), high + 3 * d * (way > 0), bore)
                body = fuse(occ, [outline(occ, low, high), neck])
                cup = cylinder(occ, 0, 0, face - 2 * d * (way < 0), face + 2 * d * (way > 0), bore - d)
                tools = [cup, *self.tool(occ, sites, low - 1, high + 1, width)]
                tools += [cylinder(occ, x, y, -0.6 * d, 0.6 * d, 0.5 * d) for x, y in pins]
                return cut(occ, body, tools)

            return make

        self.add("", half(seal, seal + t, 1, hole), "volute")
        deep = 2 * d if tapped else t
        self.add("", half(-deep, 0.0, -1, self.bore if tapped else hole), "back")
        if seal:
            self.add("gasket", lambda occ: cut(occ, outline(occ, 0.0, seal), [
                cylinder(occ, 0, 0, -1, seal + 1, bore - d), *self.tool(occ, sites, -1, seal + 1, hole)]),
                "lobes")
        for x, y in pins:
            self.add("dowel", lambda occ, x=x, y=y: cylinder(occ, x, y, -0.55 * d, 0.55 * d, 0.5 * d))
        head = str(rng.choice(["hexagon", "socket", "button", "cheese"]))
        ring = str(rng.choice(["", "plain", "split", "chamfered"]))
        for x, y in sites:
            if tapped:
                self.tapped(x, y, 0.0, seal + t, head, ring)
            else:
                self.bolted(x, y, -deep, seal + t, head, "plain", (ring, ring), way=int(rng.choice([-1, 1])))

    def laminate(self) -> None:
        """Blocks with thin insulation between them under bolts in sleeves."""
        d, rng = self.d, self.rng
        count, radius = int(rng.integers(2, 5)), float(rng.uniform(3.5, 6.0)) * d
        sites = [(radius * math.cos(2 * math.pi * k / count), radius * math.sin(2 * math.pi * k / count))
                 for k in range(count)]
        half, hole, sleeve = (radius + 2.5 * d, radius + 2.0 * d), self.room(), self.chance(0.5)
        wide = 1.7 * d if sleeve else hole
        layers, z = int(rng.integers(2, 5)), 0.0
        for k in range(layers):
            t = float(rng.uniform(1.0, 2.5)) * d
            self.add("", self.slab(half, z, z + t, sites, wide), "block")
            z += t
            if k + 1 < layers and self.chance(0.6):
                thin = min(float(rng.uniform(0.3, 2.0)), 0.02 * radius)
                self.add("gasket", self.slab(half, z, z + thin, sites, wide), "insulation")
                z += thin
        head = str(rng.choice(["hexagon", "socket", "flanged"]))
        nut = str(rng.choice(["plain", "locking", "flanged"]))
        for x, y in sites:
            if sleeve:
                self.add("", lambda occ, x=x, y=y: cut(occ, cylinder(occ, x, y, 0, z, 1.7 * d),
                                                       [cylinder(occ, x, y, -1, z + 1, 1.1 * d)]), "sleeve")
            ring = "wide" if sleeve else str(rng.choice(["", "plain", "chamfered"]))
            self.bolted(x, y, 0.0, z, head, nut, (ring, ring))
        self.add("", self.slab((d, 2 * d), z + 15 * d, z + 15.4 * d, [], 0.0), "label plate")

    def block(self) -> None:
        """A pillow block on a base over shims, its cover over a seal, a shaft in bearing rings."""
        d, rng = self.d, self.rng
        bar, high = float(rng.uniform(2.0, 4.0)) * d, float(rng.uniform(4.0, 6.0)) * d
        x0 = 0.9 * bar + 3.2 * d
        sites = [(s * x0, 0.0) for s in (-1, 1)]
        deep, base, t = 3.0 * d, float(rng.uniform(2.0, 3.5)) * d, float(rng.uniform(1.2, 2.0)) * d
        shim, hole = 0.12 * d if self.chance(0.5) else 0.0, self.room()
        slot = 0.35 * d if self.chance(0.4) else 0.0
        half = (x0 + 2.2 * d, 1.0 * deep)
        z = shim + high

        def house(occ: Any) -> tuple[int, int]:
            body = fuse(occ, [(3, occ.addBox(-half[0], -half[1], shim, 2 * half[0], 2 * half[1], t)),
                              (3, occ.addBox(-0.9 * bar - d, -half[1], shim, 1.8 * bar + 2 * d, 2 * half[1],
                                             high + bar))])
            tools = self.tool(occ, sites, shim - 1, shim + t + 1, hole, slot)
            return cut(occ, body, [(3, occ.addCylinder(0, -9 * deep, z, 0, 18 * deep, 0, 0.9 * bar)), *tools])

        def around(low: float, length: float, inner: float, outer: float) -> Make:
            return lambda occ: cut(occ, (3, occ.addCylinder(0, low, z, 0, length, 0, outer)),
                                   [(3, occ.addCylinder(0, low - 1, z, 0, length + 2, 0, inner))])

        self.add("", house, "pillow block")
        for x, y in sites if shim else ():
            area = (1.9 * d, half[1])
            self.add("sheet", self.slab(area, 0.0, shim, [(x, y)], hole, at=(x, y)), "shim")
        tapped = self.chance(0.6)
        bore = self.bore if tapped else hole
        self.add("", self.slab((half[0] + d, half[1] + d), -base, 0.0, sites, bore), "base")
        ring = "wide" if slot else str(rng.choice(["plain", "split", ""]))
        head = str(rng.choice(["hexagon", "socket"]))
        for x, y in sites:
            if tapped:
                self.tapped(x, y, 0.0, shim + t, head, ring)
            else:
                self.bolted(x, y, -base, shim + t, head, "plain", (ring, ""))
        wide = float(rng.uniform(0.5, 1.2)) * bar
        self.add("", lambda occ: (3, occ.addCylinder(0, -3 * deep, z, 0, 6 * deep, 0, 0.5 * bar)), "shaft")
        self.add("", around(-0.5 * wide, wide, 0.5 * bar, 0.62 * bar), "inner ring")
        self.add("", around(-0.5 * wide, wide, 0.78 * bar, 0.9 * bar), "outer ring")
        thin = float(rng.uniform(0.08, 0.4)) * bar
        self.add("", around(0.5 * wide, thin, 0.5 * bar, 0.68 * bar), "spacer")
        self.add("", around(-1.2 * deep - thin, thin, 0.5 * bar, 0.85 * bar), "thrower")


def made(seed: int, off: bool = False) -> Assembly:
    """An assembly; `off`: sizes of fasteners and holes are up to 5 % off."""
    maker = _HeldOut(seed + 900_000, off)
    families = (maker.hinge, maker.rails, maker.motor, maker.pump, maker.laminate, maker.block)
    families[seed % 6]()
    found = finished(maker)
    found.splines = len(found.parts) < 12 and maker.chance(0.15)  # dividing them takes ten times as long
    return found
