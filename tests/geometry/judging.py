"""What the parts of drawn assemblies are taken for, against what they are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import dolfinx_frontend as lf
from tests.geometry.assemblies import Assembly, Part

COUNTED = ("bolt", "nut", "washer", "gasket")
"""What must be found; of the others, studs and dowels are looked at as well."""


@dataclass
class Verdict:
    """Counts, and what is wrong in words."""

    counts: Counter[Any] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def judged(assembly: Assembly, file: Path) -> dict[str, Verdict]:
    """What a file's parts are taken for, with their names and without, against what they are."""
    step = lf.read_step(file)
    truth = {part.name.encode("ascii", "ignore").decode(): part for part in assembly.parts}
    assert set(truth) == set(step.solids)
    plain = {name: f"part {k}" for k, name in enumerate(step.solids)}
    solids = {plain[n]: replace(s, name=plain[n]) for n, s in step.solids.items()}
    touches = {}
    for touch in step.touches.values():
        parts = (plain[touch.parts[0]], plain[touch.parts[1]])
        touches[touch.name] = replace(touch, parts=parts)
    nameless = replace(step, solids=solids, touches=touches)
    without = nameless.found
    found = {"with names": step.found, "without names": {n: without[plain[n]] for n in step.solids}}
    out = {}
    for names, taken in found.items():
        verdict = out[names] = Verdict()
        for name, part in truth.items():
            _compare(verdict, assembly, part, taken[name])
    return out


def _compare(verdict: Verdict, assembly: Assembly, part: Part, taken: Any) -> None:
    kind, counts = part.kind, verdict.counts
    right = taken.kind == kind
    if kind in COUNTED:
        counts[kind, "there"] += 1
        counts[kind, "found"] += right
        if right and kind != "gasket":
            counts["sized"] += 1
            fits = taken.size is not None and taken.size.d == assembly.d
            counts["sizes"] += fits
            right = right and fits
    elif kind:
        counts["more there"] += 1
        counts["more found"] += right
        counts["others"] += 1
    else:
        counts["others"] += 1
        right = taken.kind not in COUNTED
        counts["false"] += not right
    if kind and taken.kind in COUNTED and taken.kind != kind:  # a washer taken for a nut
        counts["false"] += kind not in COUNTED
    if not right:
        words = f"{part.name!r}, a {kind or 'part'} ({part.look}), is taken for {taken.title or 'a part'}"
        verdict.wrong.append(f"{words}: {'; '.join(taken.reasons) or taken.missing}")
