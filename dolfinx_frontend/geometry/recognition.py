"""What a part is taken for, and why: bolts, studs, nuts, washers, dowels, gaskets and thin sheets.

The shape decides: what a part is turned of, in ratios to the diameter of its thread, and what goes through
it; so neither the size nor the place of an assembly matters. A name decides among kinds that the shape
allows, and stands for a neighbour that is not there; it makes no bolt of a plate. No shape tells a material:
a thin flat part is a sheet, and a gasket where its name or the user says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dolfinx_frontend.geometry.findings import FLAT, SETTINGS, UNTOLD, Finding, Passage, Shank, Span
from dolfinx_frontend.geometry.naming import named_kind, named_size
from dolfinx_frontend.geometry.shapes import Body, Face, Station, Turned, turned
from dolfinx_frontend.geometry.threads import SIZES, Size, nearest_size
from dolfinx_frontend.geometry.touching import Touch

__all__ = ["forced", "recognised"]


@dataclass(frozen=True)
class _View:
    """A part, as the tests of all kinds see it."""

    body: Body
    turned: Turned | None
    shank: Shank | None
    named: str
    around: Mapping[str, _View] = field(default_factory=dict, repr=False)
    passages: tuple[Passage, ...] = ()
    through: tuple[tuple[_View, float], ...] = ()
    """Bolts and studs in the hole around its axis, with the ratio of the hole to them."""


def recognised(bodies: Mapping[str, Body], touches: Iterable[Touch]) -> dict[str, Finding]:
    """What each part is taken for."""
    views = _views(bodies, bodies)
    views = {n: replace(v, around=views) for n, v in views.items()}
    inside: dict[str, list[tuple[_View, float]]] = {}
    for view in views.values():
        if _bolt(view).kind or _stud(view).kind:
            for each in view.passages:
                own = views[each.part].turned
                if own is not None and any(each.tags & f.tags for s in own.inside for f in s.faces):
                    inside.setdefault(each.part, []).append((view, each.ratio))
    views = {n: replace(v, through=tuple(inside.get(n, ()))) for n, v in views.items()}
    sides = _covers(bodies, list(touches))
    out = {}
    for name, view in views.items():
        tried = [kind(view) for kind in (_bolt, _stud, _nut, _washer, _dowel)] + [_flat_part(view, sides)]
        kinds = [f for f in tried if f.kind]
        by_name = [f for f in kinds if f.kind == view.named]
        best = (by_name or kinds or [f for f in tried if f.missing] or [Finding(name)])[0]
        if by_name:
            best = replace(best, reasons=(*best.reasons, f"named so ({view.body.label!r})"))
        out[name] = best
    return out


def forced(bodies: Mapping[str, Body], name: str, kind: str, size: Size | None) -> Finding:
    """A part that is of a kind because a user says so."""
    view = _views(bodies, (name,))[name]
    around = {p.part: _seen(bodies[p.part]) for p in view.passages}
    base = _of_shank(replace(view, around=around), kind) if view.shank is not None else Finding(name, kind)
    return replace(base, size=size or base.size, reasons=("said so",))


def _views(bodies: Mapping[str, Body], names: Iterable[str]) -> dict[str, _View]:
    """Parts with the holes that their shanks go through."""
    holes = [(n, f) for n, b in bodies.items() for f in b.faces if f.kind == "cylinder" and f.first.hollow]
    views = ((n, _seen(bodies[n])) for n in names)
    return {n: v if v.shank is None else replace(v, passages=_passages(v, holes)) for n, v in views}


def _seen(body: Body) -> _View:
    seen = turned(body)
    shank = None if seen is None or seen.share < SETTINGS.share else _shank(seen)
    return _View(body, seen, shank, named_kind(body.label))


# -- shapes --------------------------------------------------------------------------------------
def _shank(seen: Turned) -> Shank | None:
    """The shank of a bolt, stud or pin: of all ways to see one, that with the longest."""
    if seen.hole is not None:
        return None
    widths = {s.width for s in seen.outside if not s.hexagon and not s.cone}
    tried = [s for d in widths if (s := _as_shank(seen, d)) is not None]
    return max(tried, key=lambda s: (s.high - s.low, s.d)) if tried else None


def _as_shank(seen: Turned, d: float) -> Shank | None:
    """Seen as a shank of this diameter with heads at its ends; None: it is not."""
    wide = [s for s in seen.outside if s.hexagon or s.width > d / SETTINGS.thread.low]
    rest = [s for s in seen.outside if s not in wide]
    if any(s.width > SETTINGS.thread.high * d for s in rest):
        return None
    like = [s.length for s in rest if s.width >= SETTINGS.thread.low * d or s.cone]
    if sum(like) < SETTINGS.plain * sum(s.length for s in rest):
        return None
    end = SETTINGS.end * d
    clusters = _clusters(wide, end)
    if len(clusters) > 2:
        return None
    below = next((c for c in clusters if c[0].low <= seen.low + end), None)
    above = next((c for c in clusters if max(s.high for s in c) >= seen.high - end and c is not below), None)
    inner = [c for c in clusters if c is not below and c is not above]
    if clusters and below is None and above is None:
        return None
    if inner and above is None:  # a nut that is a part of it, from which the tip of the thread looks out
        above = inner[0]
    elif inner:
        below = inner[0]
    heads = tuple(side for side, each in ((-1, below), (1, above)) if each)
    low = max(s.high for s in below) if below else seen.low
    high = min(s.low for s in above) if above else seen.high
    if not low < high:
        return None
    head = below if below and below not in inner else above
    if head is None:
        return Shank(d, low, high, drive=_recess(seen, seen.low, seen.high, d))
    width = max([s.width for s in head if s.hexagon] or [s.width for s in head])
    top, bottom = min(s.low for s in head), max(s.high for s in head)
    hexagon = any(s.hexagon for s in wide)
    drive = "hexagon" if hexagon else _recess(seen, top, bottom, d)
    return Shank(d, low, high, heads, width, bottom - top, drive)


def _clusters(stations: Iterable[Station], slack: float) -> list[list[Station]]:
    """Stations that follow one another without a gap."""
    out: list[list[Station]] = []
    for each in stations:
        if out and each.low <= max(s.high for s in out[-1]) + slack:
            out[-1].append(each)
        else:
            out.append([each])
    return out


def _recess(seen: Turned, low: float, high: float, d: float) -> str:
    """A socket or slot at the end of a part."""
    end, deep = SETTINGS.end * d, SETTINGS.recess * d

    def at_end(least: float, most: float) -> bool:
        within = least >= low - end and most <= high + deep
        return within and min(least - seen.low, seen.high - most) < 0.5 * end

    ends = [s for s in seen.inside if at_end(s.low, s.high)]
    walls = ((f.rim - seen.origin) @ seen.axis for f in seen.walls)
    slot = (True for along in walls if at_end(float(along.min()), float(along.max())))
    return "hexagon socket" if any(s.hexagon for s in ends) else "recess" if ends or any(slot) else ""


def _of_head(shank: Shank) -> Size | None:
    """The thread by shank and head: a hexagon, or a cap with a socket, as high as the thread is wide."""
    if not shank.heads or shank.drive not in ("hexagon", "hexagon socket"):
        return None
    size = nearest_size(shank.d, shank.width, shank.drive != "hexagon")
    cap = size is None or shank.drive == "hexagon" or abs(shank.height / size.d - 1.0) < SETTINGS.off
    return size if cap else None


def _nominal(shank: Shank) -> float:
    """Nominal diameter, also of a shank that is drawn at its pitch or core diameter."""
    size = _of_head(shank)
    if size is None or not size.core_diameter / SETTINGS.fit < shank.d < SETTINGS.fit * size.pitch_diameter:
        return shank.d
    return size.d


def _passages(view: _View, holes: Iterable[tuple[str, Face]]) -> tuple[Passage, ...]:
    """Holes of other parts that a shank goes through; of a slot its round ends."""
    seen, shank = view.turned, view.shank
    assert seen is not None and shank is not None
    r, out = 0.5 * shank.d, list[Passage]()
    nominal = 0.5 * _nominal(shank)
    for part, face in holes:
        first = face.first
        radius = first.radius or 0.0
        if part == view.body.name or not SETTINGS.thread.low * r <= radius <= SETTINGS.loose * r:
            continue
        if float(np.linalg.norm(np.cross(first.axis, seen.axis))) > SETTINGS.skew:
            continue
        offset = first.origin - seen.origin
        apart = float(np.linalg.norm(offset - (offset @ seen.axis) * seen.axis))
        along = (face.rim - seen.origin) @ seen.axis
        low, high = max(float(along.min()), shank.low), min(float(along.max()), shank.high)
        whole = face.area > 0.9 * 2.0 * math.pi * radius * float(np.ptp(along))
        aside = max(radius - r, 0.0) + SETTINGS.aside * r
        if apart <= (aside if whole else SETTINGS.slot * r) and high - low > SETTINGS.engaged * shank.d:
            centred = whole or apart <= aside
            ratio = radius / nominal if centred else max(radius / nominal, 1.01 * SETTINGS.fit)
            out.append(Passage(part, face.tags, ratio, 2.0 * radius, low, high))
    return tuple(sorted(out, key=lambda p: p.low))


# -- kinds ---------------------------------------------------------------------------------------
def _judged(view: _View, kind: str, tests: Iterable[tuple[bool, str]], found: Finding) -> Finding:
    """Found if no test fails; if only one does, what is missing."""
    failed = [text for passed, text in tests if not passed]
    if not failed:
        return found
    if len(failed) == 1:
        return Finding(view.body.name, missing=f"looks like a {kind} but {failed[0]}")
    return Finding(view.body.name)


def _of_shank(view: _View, kind: str) -> Finding:
    seen, shank = view.turned, view.shank
    assert seen is not None and shank is not None
    rings = [_ring(view.around[p.part]) for p in view.passages if p.fits]
    nuts = [ring[1] for ring in rings if ring is not None and ring[3]]
    size = _sized(view, shank.d, min(nuts, default=None), _of_head(shank))
    reasons = [f"shank of {shank.d:.4g} mm, {shank.high - shank.low:.4g} mm long"]
    if shank.heads:
        head = f"{shank.drive or 'round'} head of {shank.width:.4g} x {shank.height:.4g} mm"
        reasons.append(head + ("" if len(shank.heads) == 1 else ", at both ends: its nut is a part of it"))
    return Finding(view.body.name, kind, size, tuple(reasons), "", shank, seen.axis, seen.origin,
                   view.passages)


def _sized(view: _View, d: float, across: float | None, head: Size | None = None) -> Size | None:
    """The thread: that of the name, where the diameter is near it, or of the head, or by the nut."""
    named = named_size(view.body.label)
    if named is not None and d / named.d in SETTINGS.named:
        return named
    return head or nearest_size(d, across) or nearest_size(d)


def _clamped(view: _View) -> tuple[list[Passage], list[Passage]]:
    """Holes that a shank passes with clearance, and those of other parts further on that hold it."""
    shank = view.shank
    assert shank is not None
    loose = [p for p in view.passages if not p.fits]
    way = -shank.heads[0] if shank.heads else 0
    held = [
        p for p in view.passages
        if p.fits and any(q.part != p.part and way * (p.low + p.high - q.low - q.high) >= 0.0 for q in loose)
    ]
    return loose, held


def _bolt(view: _View) -> Finding:
    """A shank with a head that a key fits, or that clamps something between head and thread."""
    shank = view.shank
    if shank is None or not shank.heads:
        return Finding(view.body.name)
    d, long = shank.d, (shank.high - shank.low) / shank.d
    loose, held = _clamped(view)
    grip = bool(shank.drive or held or len(shank.heads) == 2 and loose or view.named in ("bolt", "stud"))
    tests = (
        (shank.width / d in SETTINGS.head, f"its head is {shank.width / d:.2f} diameters wide"),
        (shank.height / d in SETTINGS.head_height, f"its head is {shank.height / d:.2f} diameters high"),
        (long in SETTINGS.shank, f"it is {long:.2f} diameters long"),
        (grip, "its head has no hexagon and no socket, and no nut or thread holds its shank"),
    )
    found = _of_shank(view, "bolt")
    if loose:
        found = replace(found, reasons=(*found.reasons, f"goes through {_named(p.part for p in loose)}"))
    if held:
        found = replace(found, reasons=(*found.reasons, f"is held by {_named(p.part for p in held)}"))
    return _judged(view, "bolt", tests, found)


def _stud(view: _View) -> Finding:
    """A shank without a head that has a nut."""
    shank = view.shank
    if shank is None or shank.heads:
        return Finding(view.body.name)
    loose, _ = _clamped(view)
    nuts = [p.part for p in view.passages if p.fits and _like_nut(view.around[p.part])]
    enough = bool(nuts and loose) or len(set(nuts)) >= 2 or view.named in ("stud", "bolt")
    tests = (
        ((shank.high - shank.low) / shank.d in Span(SETTINGS.stud, SETTINGS.shank.high), "is too short"),
        (enough, "no nut is on it"),
    )
    found = _of_shank(view, "stud")
    if nuts:
        found = replace(found, reasons=(*found.reasons, f"has the nuts {_named(nuts)}"))
    judged = _judged(view, "stud", tests, found)
    return judged if judged.kind or nuts else Finding(view.body.name)  # each pin lacks a nut


def _ring(view: _View) -> tuple[float, float, float, bool] | None:
    """Of a part with a hole through it: its diameter, width, height, and whether there is a hexagon."""
    seen = view.turned
    if seen is None or seen.share < SETTINGS.share or seen.hole is None:
        return None
    outside = [s for s in seen.outside if s.hexagon] or [s for s in seen.outside if not s.cone]
    if not outside:
        return None
    widest = max(outside, key=lambda s: s.width)
    hexagon = widest.hexagon and widest.length > SETTINGS.hexagon * seen.length
    return seen.hole.width, widest.width, seen.length, hexagon


def _like_nut(view: _View) -> bool:
    """By its shape, or because a part with a hole is named so: some are square."""
    ring = _ring(view)
    if ring is None:
        return view.named == "nut" and _small_block(view)
    d, width, height, hexagon = ring
    return width / d in SETTINGS.across and height / d in (SETTINGS.nut if hexagon else SETTINGS.ring_nut)


def _small_block(view: _View) -> bool:
    """Whether a part is as wide as a square nut on its hole."""
    seen = view.turned
    if seen is None or seen.hole is None:
        return False
    rims = np.concatenate([f.rim for f in view.body.faces if len(f.rim)])
    reach = np.linalg.norm(np.cross(rims - seen.origin, seen.axis), axis=1).max()
    return float(reach) < SETTINGS.across.high * seen.hole.width / math.sqrt(2.0)


def _nut(view: _View) -> Finding:
    """A hexagon with a hole, or a ring that fits a shank which goes on through a wider hole."""
    ring, threaded = _ring(view), [v for v, ratio in view.through if ratio <= SETTINGS.fit]
    on = tuple(f"on {v.body.name!r}" for v in threaded)
    if ring is None:
        named = bool(threaded) and _like_nut(view)
        size = _of_shank(threaded[0], "bolt").size if named else None
        return Finding(view.body.name, "nut" if named else "", size, on)
    d, width, height, hexagon = ring
    clamps = any(not p.fits for v in threaded for p in v.passages)
    fits = all(ratio <= SETTINGS.fit for _, ratio in view.through)
    heights = SETTINGS.nut if hexagon else SETTINGS.ring_nut
    tests = (
        (width / d in SETTINGS.across, f"is {width / d:.2f} diameters of its hole wide"),
        (height / d in heights, f"is {height / d:.2f} diameters of its hole high"),
        (fits, "its hole is wider than the shank in it"),
        (hexagon or clamps or view.named == "nut", "is round, and on no thread"),
    )
    shank = min((v.shank.d for v, _ in view.through if v.shank is not None), default=0.0)
    size = _sized(view, shank or d, width if hexagon else None)
    words = f"{'hexagon' if hexagon else 'ring'} of {width:.4g} x {height:.4g} mm, hole of {d:.4g} mm"
    judged = _judged(view, "nut", tests, Finding(view.body.name, "nut", size, (words, *on)))
    return judged if judged.kind or hexagon else Finding(view.body.name)


def _washer(view: _View) -> Finding:
    """A low ring that a bolt goes through, or of a size of ISO 7089."""
    ring = _ring(view)
    if ring is None or ring[3]:
        return Finding(view.body.name)
    d, width, height, _ = ring
    shanks = [v for v, ratio in view.through if ratio < SETTINGS.loose]
    size = _of_shank(shanks[0], "bolt").size if shanks else _washer_size(d, width, height)
    tests = (
        (width / d in SETTINGS.washer, f"is {width / d:.2f} diameters of its hole wide"),
        (height / d <= SETTINGS.washer_height, f"is {height / d:.2f} diameters of its hole high"),
        (bool(shanks) or size is not None or view.named == "washer", "no bolt goes through it"),
    )
    if not shanks and size is None and named_size(view.body.label) is not None:
        size = named_size(view.body.label)
    words = f"ring of {d:.4g} x {width:.4g} x {height:.4g} mm"
    reasons = (words, *(f"around {v.body.name!r}" for v in shanks))
    judged = _judged(view, "washer", tests, Finding(view.body.name, "washer", size, reasons))
    return judged if judged.kind or shanks else Finding(view.body.name)


def _washer_size(d: float, width: float, height: float) -> Size | None:
    """The size of ISO 7089 that these are near to."""
    def off(size: Size) -> float:
        return max(abs(a / b - 1.0) for a, b in zip((d, width, height), size.washer, strict=True))

    size = min(SIZES.values(), key=off)
    return size if off(size) < SETTINGS.off else None


def _dowel(view: _View) -> Finding:
    """A plain pin that fits holes of two parts, and ends there."""
    shank = view.shank
    if shank is None or shank.heads:
        return Finding(view.body.name)
    held = [p for p in view.passages if p.fits]
    length = shank.high - shank.low
    parts = {p.part for p in held}
    inside = sum(p.high - p.low for p in held) > SETTINGS.dowel_held * length
    named = view.named == "dowel" and bool(parts)
    tests = (
        (length / shank.d in SETTINGS.dowel, f"is {length / shank.d:.2f} diameters long"),
        (named or len(parts) >= 2, "no two parts have holes that it fits"),
        (named or inside, "most of it is in no hole"),
    )
    found = replace(_of_shank(view, "dowel"), size=None)
    found = replace(found, reasons=(*found.reasons, f"fits holes of {_named(sorted(parts))}"))
    judged = _judged(view, "dowel", tests, found)
    return judged if judged.kind else Finding(view.body.name)


@dataclass(frozen=True)
class _Flat:
    """A part between two parallel planes."""

    sides: tuple[Face, Face]
    thickness: float


def _flat(body: Body) -> _Flat | None:
    """Two planes make up most of it, and all between them is as thick."""
    planes = sorted((f for f in body.faces if f.kind == "plane"), key=lambda f: -f.area)[:2]
    if len(planes) < 2:
        return None
    a, b = planes
    thickness = abs(float((b.centre - a.centre) @ a.first.normal))
    opposed = float(a.first.normal @ b.first.normal) < SETTINGS.skew - 1.0
    full = 0.5 * (a.area + b.area) * thickness
    prism = full > 0.0 and abs(body.volume / full - 1.0) < SETTINGS.prism
    if not opposed or not prism or thickness > SETTINGS.thin * body.size:
        return None
    return _Flat((a, b), thickness)


Sides = Mapping[str, list[tuple[int, str, float, float]]]
"""Part -> (number of a face of it, other part, its thickness, area) of all faces on which others lie."""


def _covers(bodies: Mapping[str, Body], touches: Iterable[Touch]) -> Sides:
    """Which faces lie on other parts."""
    of = {part: name for name, body in bodies.items() for part in body.parts}
    out: dict[str, list[tuple[int, str, float, float]]] = {}
    for touch in touches:
        if touch.kind == "cut":
            continue
        for k in (0, 1):
            other = of[touch.parts[1 - k]]
            for tag in touch.surfaces[k]:
                share = touch.area / len(touch.surfaces[k])
                out.setdefault(of[touch.parts[k]], []).append((tag, other, bodies[other].thickness, share))
    return out


def _flat_part(view: _View, sides: Sides) -> Finding:
    """A thin flat part: shape tells that it lies between two that are thicker, a name that it seals."""
    flat, name = _flat(view.body), view.body.name
    if flat is None:
        return Finding(name)
    covered, beside = [], set()
    for side in flat.sides:
        on = [each for each in sides.get(name, ()) if each[0] in side.tags and each[2] > flat.thickness]
        covered.append(sum(each[3] for each in on) / side.area)
        beside |= {each[1] for each in on}
    inner = min(covered) > SETTINGS.covered
    between = tuple(sorted(beside)) if inner else ()
    reasons = [f"flat, {flat.thickness:.4g} mm thick"] + [f"between {_named(between)}"] * inner
    kind = "gasket" if view.named == "gasket" else "sheet"
    open_ = UNTOLD if inner and view.named not in FLAT else ""
    return Finding(name, kind, None, tuple(reasons), open_, between=between)


def _named(names: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(repr(n) for n in names))
