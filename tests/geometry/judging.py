"""What the parts of drawn assemblies are taken for, against what they are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import dolfinx_frontend as lf
from tests.geometry.assemblies import Assembly, Part

COUNTED = ("bolt", "nut", "washer", "gasket")
"""What must be found; of the others, studs and dowels are looked at as well.

Without its name a gasket is found if it is taken for a sheet between two parts: its joints are then proposed
as with its name, only its material is asked for. So any other part that is taken for such a sheet is wrong.
"""


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
            _compare(verdict, assembly, part, taken[name], named=names == "with names")
    return out


def _compare(verdict: Verdict, assembly: Assembly, part: Part, taken: Any, named: bool) -> None:
    kind, counts = part.kind, verdict.counts
    sheet = taken.kind == "sheet" and bool(taken.between)
    as_one = taken.kind in COUNTED or sheet
    right = taken.kind == kind or kind == "gasket" and sheet and not named
    if kind in COUNTED:
        counts[kind, "there"] += 1
        counts[kind, "found"] += right
        if right and kind != "gasket":
            counts["sized"] += 1
            fits = taken.size is not None and taken.size.d == assembly.d
            counts["sizes"] += fits
            right = right and fits
    else:
        counts["others"] += 1
        wrong = as_one and not (sheet and kind == "sheet")
        counts["false"] += wrong
        if kind in ("stud", "dowel"):
            counts["more there"] += 1
            counts["more found"] += right
        else:
            right = not wrong
    if not right:
        words = f"{part.name!r}, a {kind or 'part'} ({part.look}), is taken for {taken.title or 'a part'}"
        verdict.wrong.append(f"{words}: {'; '.join(taken.reasons) or taken.missing}")
