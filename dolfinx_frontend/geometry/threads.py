"""Threads and what goes with them: sizes of ISO and ASME, preloads and scatter of VDI 2230.

Sizes in mm: ISO 261 and 262 (coarse pitch), ISO 4014 (hexagon head), ISO 4762 (socket head), ISO 4032 (nut),
ISO 7089 (washer), ISO 273 (clearance holes); of inches ASME B1.1, B18.2.1, B18.3, B18.2.2, B18.21.1 (SAE) and
B18.2.8. Preload, friction and scatter: VDI 2230 part 1 (2015), the table
of assembly preloads at 90 % of the yield point (A1), friction classes (A5, A6), tightening factors (A8).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = ["GRADES", "HEAD", "INCHES", "JOINT", "SIZES", "TIGHTENING", "Size", "Span", "nearest_size",
           "preload", "size_of"]


class Size(NamedTuple):
    """A thread, mm.

    Attributes
    ----------
    d, pitch
        Nominal diameter and coarse pitch.
    across, head, nut
        Width across flats of head and nut, height of the hexagon head, of the nut.
    socket
        Diameter of a socket head (its height is d); 1.5 d where ISO 4762 has none.
    washer
        Inner and outer diameter and thickness of the washer.
    holes
        Diameters of clearance holes: fine, medium, coarse.
    unified
        Name of a thread of inches; empty: it is metric.
    """

    d: float
    pitch: float
    across: float
    head: float
    nut: float
    socket: float
    washer: tuple[float, float, float]
    holes: tuple[float, float, float]
    unified: str = ""

    @property
    def name(self) -> str:
        """``"M12"``, ``"3/8-16 UNC"``."""
        return self.unified or f"M{self.d:g}"

    @property
    def pitch_diameter(self) -> float:
        """d2 of ISO 724."""
        return self.d - 0.6495 * self.pitch

    @property
    def core_diameter(self) -> float:
        """d3 of ISO 724."""
        return self.d - 1.2269 * self.pitch

    @property
    def drawn(self) -> tuple[float, float, float]:
        """Diameters that it is drawn with."""
        return self.d, self.pitch_diameter, self.core_diameter

    @property
    def stressed_diameter(self) -> float:
        """Of the stress area: (d2 + d3) / 2, of inches d - 0.9743 p (ASME B1.1)."""
        if self.unified:
            return self.d - 0.9743 * self.pitch
        return 0.5 * (self.pitch_diameter + self.core_diameter)


SIZES: dict[str, Size] = {
    each.name: each
    for each in (
        Size(3, 0.5, 5.5, 2, 2.4, 5.5, (3.2, 7, 0.5), (3.2, 3.4, 3.6)),
        Size(4, 0.7, 7, 2.8, 3.2, 7, (4.3, 9, 0.8), (4.3, 4.5, 4.8)),
        Size(5, 0.8, 8, 3.5, 4.7, 8.5, (5.3, 10, 1), (5.3, 5.5, 5.8)),
        Size(6, 1, 10, 4, 5.2, 10, (6.4, 12, 1.6), (6.4, 6.6, 7)),
        Size(8, 1.25, 13, 5.3, 6.8, 13, (8.4, 16, 1.6), (8.4, 9, 10)),
        Size(10, 1.5, 16, 6.4, 8.4, 16, (10.5, 20, 2), (10.5, 11, 12)),
        Size(12, 1.75, 18, 7.5, 10.8, 18, (13, 24, 2.5), (13, 13.5, 14.5)),
        Size(14, 2, 21, 8.8, 12.8, 21, (15, 28, 2.5), (15, 15.5, 16.5)),
        Size(16, 2, 24, 10, 14.8, 24, (17, 30, 3), (17, 17.5, 18.5)),
        Size(18, 2.5, 27, 11.5, 15.8, 27, (19, 34, 3), (19, 20, 21)),
        Size(20, 2.5, 30, 12.5, 18, 30, (21, 37, 3), (21, 22, 24)),
        Size(22, 2.5, 34, 14, 19.4, 33, (23, 39, 3), (23, 24, 26)),
        Size(24, 3, 36, 15, 21.5, 36, (25, 44, 4), (25, 26, 28)),
        Size(27, 3, 41, 17, 23.8, 40.5, (28, 50, 4), (28, 30, 32)),
        Size(30, 3.5, 46, 18.7, 25.6, 45, (31, 56, 4), (31, 33, 35)),
        Size(33, 3.5, 50, 21, 28.7, 49.5, (34, 60, 5), (34, 36, 38)),
        Size(36, 4, 55, 22.5, 31, 54, (37, 66, 5), (37, 39, 42)),
        Size(39, 4, 60, 25, 33.4, 58.5, (42, 72, 6), (40, 42, 45)),
        Size(42, 4.5, 65, 26, 34, 63, (45, 78, 8), (43, 45, 48)),
        Size(45, 4.5, 70, 28, 36, 67.5, (48, 85, 8), (46, 48, 52)),
        Size(48, 5, 75, 30, 38, 72, (52, 92, 8), (50, 52, 56)),
        Size(52, 5, 80, 33, 42, 78, (56, 98, 8), (54, 56, 62)),
        Size(56, 5.5, 85, 35, 45, 84, (62, 105, 10), (58, 62, 66)),
        Size(60, 5.5, 90, 38, 48, 90, (66, 110, 10), (62, 66, 70)),
        Size(64, 6, 95, 40, 51, 96, (70, 115, 10), (66, 70, 74)),
    )
}

_INCHES = """
1/4   20 28 28  10 14  40 18   17 18 19     5/16  18 24 32  13 17  44 22    21 22 23
3/8   16 24 36  15 21  52 26   25 26 27     7/16  14 20 40  18 24  59 30    29 30 31
1/2   13 20 48  20 28  68 34   34 36 39     5/8   11 18 60  25 35  84 42    42 44 47
3/4   10 16 72  30 41  94 52   50 52 58     7/8   9  14 84  35 48  112 60   58 60 66
1     8  12 96  39 55  128 68  66 70 74     1-1/8 7  12 108 44 62  144 80   74 78 84
1-1/4 7  12 120 50 68  160 88  82 86 92     1-3/8 6  12 132 54 75  176 96   90 96 103
1-1/2 6  12 144 60 82  192 104 98 104 111
"""
"""Name, threads per inch UNC and UNF, then in inches / 64: width across flats, height of head and nut, washer
(outer and inner diameter), holes (close, normal, loose)."""

_SAE = {0.5: 0.065, 0.7: 0.095, 1.2: 0.134, 2.0: 0.165}
"""Thickness of washers up to a nominal diameter, inches; 1/2 itself has that of 5/8."""


def _inches() -> dict[str, Size]:
    """Sizes of inches; UNC of each diameter before UNF."""
    out, words = dict[str, Size](), _INCHES.split()
    for row in (words[k : k + 11] for k in range(0, len(words), 11)):
        whole, _, rest = row[0].rpartition("-")
        d = float(whole or 0) + float(Fraction(rest))
        flats, head, nut, outer, inner, *holes = (25.4 / 64.0 * float(each) for each in row[3:])
        thick = 25.4 * next(t for most, t in _SAE.items() if d < most)
        for turns, series in ((row[1], "UNC"), (row[2], "UNF")):
            name, of_holes = f"{row[0]}-{turns} {series}", (holes[0], holes[1], holes[2])
            each = Size(25.4 * d, 25.4 / float(turns), flats, head, nut, 38.1 * d, (inner, outer, thick),
                        of_holes, name)
            out[each.name] = each
    return out


INCHES = _inches()

_EXACT = 2e-3
"""By as much a diameter and a width may be off those of a thread of inches, relative: metric sizes are within
1 % of some of them, so that only what is drawn exactly is one."""

_SECOND = ("M14", "M18", "M22", "M27", "M33", "M39", "M45", "M52", "M60")
"""Sizes of the second choice of ISO 261: what is between two sizes is rather of the first."""

_INNER = 0.02
"""As far as this off the nominal diameter, a thread is drawn with it rather than with another one."""

_OFF = 0.09
"""A diameter this far from a nominal one, relative, still has its size: half of the widest step is more."""


class Span(NamedTuple):
    """Least and greatest value that a table gives, taken as two deviations below and above the mean."""

    low: float
    high: float

    @property
    def mean(self) -> float:
        """In the middle."""
        return 0.5 * (self.low + self.high)

    @property
    def cov(self) -> float:
        """Deviation over mean."""
        return (self.high - self.low) / (2.0 * (self.high + self.low))


HEAD, JOINT = Span(0.08, 0.16), Span(0.10, 0.23)
"""Friction of heads, nuts and threads (A5, class B), and of joints of steel on steel, dry (A6)."""

TIGHTENING: dict[str, tuple[float, str]] = {
    "yield": (1.4, "to the yield point, 1.2 to 1.4"),
    "angle": (1.4, "by angle, 1.2 to 1.4"),
    "hydraulic": (1.6, "hydraulic, 1.2 to 1.6"),
    "torque, tested": (1.6, "torque wrench, torque from tests, 1.4 to 1.6"),
    "torque": (2.0, "torque wrench, friction estimated (class B), 1.6 to 2.0"),
    "impact": (4.0, "impact wrench, 2.5 to 4"),
}
"""Way of tightening -> the larger tightening factor alpha_A = F_max / F_min of its row in table A8."""

GRADES: dict[str, tuple[float, float]] = {
    "4.6": (240.0, 240.0), "5.6": (300.0, 300.0), "6.8": (480.0, 480.0), "8.8": (640.0, 660.0),
    "10.9": (940.0, 940.0), "12.9": (1100.0, 1100.0),
}
"""Property class of ISO 898-1 -> least yield point, MPa, up to M16 and above."""


def size_of(name: str, where: str = "") -> Size:
    """The size of a name, ``"M12"``.

    Raises
    ------
    SceneError
        There is none; with near ones.
    """
    known = {**SIZES, **INCHES}
    found = known.get(name.strip().upper()) if isinstance(name, str) else None
    if found is None:
        raise unknown_name("size", name, known, where)
    return found


def nearest_size(d: float, width: float | None = None, socket: bool = False) -> Size | None:
    """The thread that is nearest, mm; None: none is near.

    Parameters
    ----------
    d
        Diameter of a shank or of the hole of a nut.
    width
        Across flats of a head or nut. With it `d` may also be the pitch or core diameter, as threads are
        often drawn.
    socket
        The width is the diameter of a socket head.
    """
    def off(size: Size) -> float:
        rare = 2.0 if size.name in _SECOND else 1.0
        if width is None:
            return rare * abs(math.log(d / size.d))
        inner = min(abs(math.log(d / each)) for each in (size.pitch_diameter, size.core_diameter))
        head = abs(math.log(width / (size.socket if socket else size.across)))
        return rare * (head + min(abs(math.log(d / size.d)), inner + _INNER))

    for size in INCHES.values() if width is not None else ():
        wide = size.socket if socket else size.across
        if max(abs(d / size.d - 1.0), abs((width or 0.0) / wide - 1.0)) < _EXACT:
            return size
    near = min(SIZES.values(), key=off)
    return near if off(near) <= _OFF * (1 if width is None else 2) else None


def preload(size: Size, grade: str = "8.8", method: str = "torque", friction: float = HEAD.mean) -> Span:
    """Assembly preload, N: at its greatest 90 % of the yield point are used by tension and torsion together.

    Parameters
    ----------
    grade, method
        Property class, and way of tightening (a key of `TIGHTENING`).
    friction
        Of the thread.

    Raises
    ------
    SceneError
        A class or way that is not in the tables.
    """
    if grade not in GRADES:
        raise unknown_name("property class", grade, GRADES, "preload")
    if method not in TIGHTENING:
        raise unknown_name("way of tightening", method, TIGHTENING, "preload")
    if not friction >= 0.0:
        raise SceneError(f"preload: friction = {friction!r} must be >= 0")
    yields = GRADES[grade][size.d > SIZES["M16"].d]
    d0, d2 = size.stressed_diameter, size.pitch_diameter
    turn = size.pitch / (math.pi * d2) + friction / math.cos(math.radians(30.0))
    torsion = 1.5 * d2 / d0 * turn
    most = 0.25 * math.pi * d0**2 * 0.9 * yields / math.sqrt(1.0 + 3.0 * torsion**2)
    return Span(most / TIGHTENING[method][0], most)
