"""What a part may be taken for: kinds, their sizes in ratios, and what is found of a part."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.geometry.threads import Size

__all__ = ["CLAMPING", "FLAT", "KINDS", "SETTINGS", "UNTOLD", "Finding", "Passage", "Settings", "Shank",
           "Span", "play", "threads"]

KINDS = ("bolt", "stud", "nut", "washer", "dowel", "gasket", "sheet")
CLAMPING = ("bolt", "stud", "nut", "washer")
"""Kinds whose plane faces press on others."""
FLAT = ("gasket", "sheet")
"""Kinds that are thin and flat."""
UNTOLD = "is a thin sheet between two parts, and no shape tells its material"
"""What is missing of a sheet that may be a gasket."""


@dataclass(frozen=True)
class Span:
    """Least and greatest ratio of what a kind has."""

    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Settings:
    """What decides between kinds; in diameters of the thread if no other unit is given.

    Spans are those of the tables in :mod:`threads` and of what is named, with room for sizes 5 % off.
    """

    fit: float = 1.01
    """Hole over shank up to which they are a thread or a fit; the fine series of ISO 273 begins at 1.03."""
    loose: float = 1.4
    """Up to which a shank goes through a hole; the coarse series of ISO 273 ends at 1.2, others bore more."""
    slot: float = 5.0
    """Distance of the end of a slot from the shank in it, radii."""
    share: float = 0.85
    """Fraction of a fastener's area around its axis; wrench flats of other forms and dents are the rest."""
    head: Span = Span(1.3, 2.4)
    """Width of a head: 1.5 (ISO 4762) to 1.83 (ISO 4014, M3), flanges of ISO 4162 to 2.37."""
    head_height: Span = Span(0.25, 1.7)
    """0.35 (ISO 14580) to 1 (ISO 4762); a socket in a stack of washers that are a part of it has more."""
    shank: Span = Span(0.6, 60.0)
    """Length of a shank: the shortest screws of ISO 4762, and tie rods."""
    stud: float = 1.5
    """Least length of a stud: two nuts of ISO 4035 are 1 high."""
    across: Span = Span(1.35, 2.4)
    """Width of a nut over its hole: 1.5 to 1.83, at the core 1.9, its flange 2.37."""
    nut: Span = Span(0.3, 1.7)
    """Height of a hexagon nut over its hole: 0.5 (ISO 4035) to 1.5 (DIN 6330)."""
    ring_nut: Span = Span(0.4, 1.5)
    """The same of a round one, which is told from a washer by it."""
    washer: Span = Span(1.25, 4.0)
    """Width of a washer over its hole: 1.6 (ISO 7089) to 3.1 (ISO 7093)."""
    washer_height: float = 0.3
    """Greatest height of a washer over its hole: 0.25 (ISO 7089, M6), spring washers 0.27."""
    off: float = 0.08
    """By as much a size of a washer on no bolt may be off ISO 7089, and the height of a cap off ISO 4762."""
    named: Span = Span(0.77, 1.2)
    """Diameter over that in the name, for it to be its thread: cores, and the holes of washers."""
    thread: Span = Span(0.77, 1.02)
    """Diameters along a shank over the largest: the core of M3 has 0.8. What is wider is a head."""
    plain: float = 0.8
    """Least fraction of a shank's length that has such a diameter; grooves and necks are the rest."""
    end: float = 0.1
    """Up to which something is at the end of a bolt, or follows on it: a chamfer."""
    recess: float = 0.8
    """Depth of a socket below the head: ISO 4762 has 0.5, drawn from its top."""
    engaged: float = 0.02
    """Length on which a hole is around a shank: what is less is rounding."""
    aside: float = 0.05
    """Distance of a shank from the middle of its hole beyond what there is room for, radii."""
    hexagon: float = 0.4
    """Fraction of a nut's length that is a hexagon; a flange and washers are the rest."""
    dowel: Span = Span(0.7, 12.0)
    """Length of a dowel: ISO 8734 has 1.6 to 10."""
    dowel_held: float = 0.7
    """Fraction of a dowel that is in holes."""
    thin: float = 0.05
    """Thickness of a sheet over its extent."""
    covered: float = 0.4
    """Fraction of each side of a sheet on which thicker parts lie, for it to be between them."""
    prism: float = 0.1
    """By as much the volume of a sheet may differ from area times thickness, relative."""
    lead: float = 0.07
    """Lead of a thread over its circumference: M3 has 0.06."""
    drawn: float = 0.02
    """By as much a shank may be off the diameters of its thread, relative, before this is said."""
    fine: float = 0.995
    """Hole over that of the fine series from which it is no narrower: rounding of inches."""
    thread_length: float = 0.5
    """Length of a thread that holds a bolt; nuts of ISO 4032 have 0.8."""
    skew: float = 1e-3
    """Sine of an angle that is none, of an axis in its hole; the cosine of one between sides is 1 - it."""


SETTINGS = Settings()


@dataclass(frozen=True)
class Shank:
    """Of a bolt or stud, along its axis.

    Attributes
    ----------
    d
        Diameter.
    low, high
        Where it begins and ends; at a head it begins under it.
    heads
        Ends (-1: the lower one, 1) at which there is a head.
    width, height
        Of the head, across flats or its diameter; 0: none.
    drive
        Outer hexagon or a recess, in words; empty: neither.
    """

    d: float
    low: float
    high: float
    heads: tuple[int, ...] = ()
    width: float = 0.0
    height: float = 0.0
    drive: str = ""


@dataclass(frozen=True)
class Passage:
    """A hole of another part that a shank goes through.

    Attributes
    ----------
    part
        The other part.
    tags
        Numbers of the faces of the hole.
    ratio
        Diameter of the hole over the nominal one of the shank, which may be drawn at its core.
    width
        Diameter of the hole.
    low, high
        Where, along the axis of the shank.
    """

    part: str
    tags: frozenset[int]
    ratio: float
    width: float
    low: float
    high: float

    @property
    def fits(self) -> bool:
        """Whether they touch all around: a thread or a fit."""
        return self.ratio <= SETTINGS.fit


@dataclass(frozen=True)
class Finding:
    """What a part is taken for.

    Attributes
    ----------
    kind
        One of `KINDS`; empty: an ordinary part.
    size
        Of its thread, or of the one that it belongs to; None: not known.
    reasons
        Why, in words.
    missing
        What it lacks, if it looks like a fastener but for one thing; of a sheet, what is not known.
    shank, axis, origin, passages
        Of bolts, studs and dowels.
    between
        Parts that a sheet or gasket lies between; empty: there are none on one of its sides.
    """

    part: str
    kind: str = ""
    size: Size | None = None
    reasons: tuple[str, ...] = ()
    missing: str = ""
    shank: Shank | None = None
    axis: Array = field(default_factory=lambda: np.zeros(3), repr=False)
    origin: Array = field(default_factory=lambda: np.zeros(3), repr=False)
    passages: tuple[Passage, ...] = ()
    between: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """``"bolt M12"``."""
        return " ".join(filter(None, (self.kind, self.size.name if self.size else "")))


def play(found: Finding, part: str = "") -> float:
    """Greatest room around a thread of one that holds it: drawn at its core in a hole as it is bored."""
    if found.kind not in ("bolt", "stud") or found.shank is None:
        return 0.0
    held = [p for each in threads(found).values() for p in each if part in ("", p.part)]
    return max([0.0, *(0.5 * (p.width - found.shank.d) for p in held)])


def threads(found: Finding) -> dict[int, list[Passage]]:
    """End of a shank without a head (-1: the lower one, 1) -> holes of the part that holds it there.

    Other holes that it fits are fits.
    """
    out: dict[int, list[Passage]] = {-1: [], 1: []}
    fits = [p for p in found.passages if p.fits]
    if found.shank is None or not fits:
        return out
    for end in {-1, 1} - set(found.shank.heads):
        last = max(fits, key=lambda p: end * (p.low + p.high))
        out[end] = [p for p in fits if p.part == last.part]
    return out
