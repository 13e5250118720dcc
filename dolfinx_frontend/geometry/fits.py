"""What does not fit in an assembly, each with a remedy: holes, threads, gaps, parts that nothing holds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from dolfinx_frontend.geometry.findings import SETTINGS, Finding, threads
from dolfinx_frontend.geometry.touching import Touch

__all__ = ["misfits"]


def misfits(found: Mapping[str, Finding], touches: Iterable[Touch], close: Sequence[Touch]) -> list[str]:
    """Sentences, one for each thing that does not fit.

    Parameters
    ----------
    found
        What parts are taken for.
    touches, close
        Faces that touch, or are within the gap that was asked for; and those that are nearly so.
    """
    alike = 'say step.is_bolt({0!r}), step.is_a({0!r}, "dowel"), or leave it'
    untold = "give step.material({0!r}, ...), or say step.is_gasket({0!r}); steel is assumed"
    out = [
        f"{name!r} {f.missing}: {(untold if f.kind else alike).format(name)}"
        for name, f in found.items() if f.missing
    ]
    bolts = [f for f in found.values() if f.kind in ("bolt", "stud") and f.shank is not None]
    for bolt in bolts:
        out += _of_bolt(bolt)
    out += _loose(found, bolts, touches)
    out += [_of_gap(touch) for touch in close]
    return out


def _of_bolt(bolt: Finding) -> Iterator[str]:
    """Of its holes and its thread."""
    shank, size = bolt.shank, bolt.size
    assert shank is not None
    held = threads(bolt)
    if size is not None and min(abs(shank.d / each - 1.0) for each in size.drawn) > SETTINGS.drawn:
        yield (
            f"{bolt.part!r} has {shank.d:.4g} mm, which is taken for {size.name}; give another size, "
            f"step.is_bolt({bolt.part!r}, ...), or its own Preload"
        )
    for p in bolt.passages:
        hole = p.width
        if size is None or p.fits:
            continue
        if hole < SETTINGS.fine * size.holes[0] * min(1.0, shank.d / size.d):
            yield (
                f"the hole of {p.part!r} for {bolt.part!r} has {hole:.4g} mm: "
                f"{'ASME B18.2.8' if size.unified else 'ISO 273'} has "
                f"{size.holes[0]:g} mm (fine) to {size.holes[2]:g} mm for {size.name}; bore it, or give "
                f"another size, step.is_bolt({bolt.part!r}, ...)"
            )
    for end in {-1, 1} - set(shank.heads):
        length = sum(p.high - p.low for p in held[end])
        if not held[end]:
            remedy = f"add one, or step.is_not({bolt.part!r})"
            yield f"{bolt.part!r} has neither nut nor thread at its end: {remedy}"
        elif length < SETTINGS.thread_length * shank.d:
            yield (
                f"{bolt.part!r} is {length:.3g} mm in the thread of {held[end][0].part!r}, "
                f"{length / shank.d:.2f} diameters: it is too short for its grip; take a longer one"
            )


def _loose(found: Mapping[str, Finding], bolts: Sequence[Finding], touches: Iterable[Touch]) -> Iterator[str]:
    """Parts that touch others, but that no fastener holds."""
    held = {p.part for f in found.values() if f.kind in ("bolt", "stud", "dowel") for p in f.passages}
    beside: dict[str, list[str]] = {}
    for touch in touches:
        for part, other in (touch.parts, touch.parts[::-1]):
            beside.setdefault(part, []).append(other)
    for name, f in found.items():
        if bolts and not f.kind and name not in held and name in beside:
            others = ", ".join(repr(n) for n in dict.fromkeys(beside[name]))
            yield f"no fastener holds {name!r}, which lies on {others}: it is tied, or give its joints"


def _of_gap(touch: Touch) -> str:
    a, b = touch.parts
    return (
        f"{a!r} and {b!r} face each other over {touch.area:.4g} mm^2, {touch.gap:.3g} mm apart: read the "
        f"file with gap={1.2 * touch.widest:.2g} to join them; Contact(gap=0.0) then closes it, "
        "Contact() keeps it"
    )
