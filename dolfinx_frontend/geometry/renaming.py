"""New names of the parts of a STEP file, in what holds the old ones."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from dolfinx_frontend.common.checks import check_known, checked_name
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.findings import Finding
from dolfinx_frontend.geometry.shapes import Body
from dolfinx_frontend.geometry.solids import Solid
from dolfinx_frontend.geometry.touching import Touch

__all__ = ["in_words", "new_names", "renamed_finding", "renamed_solid", "renamed_touch"]


def new_names(
    part: str | Mapping[str, str], name: str | None, bodies: Mapping[str, Body]
) -> tuple[dict[str, str], dict[str, str]]:
    """Name of every part -> its new name, and the same of the pieces of those that were cut.

    Raises
    ------
    SceneError
        A part that there is not, a name that is none, or that two would have.
    """
    asked: dict[str, str | None] = dict(part) if isinstance(part, Mapping) else {part: name}
    if isinstance(part, Mapping) and name is not None:
        raise SceneError(f"rename: name = {short(name)} beside several parts; give {{old: new}} alone")
    for old, new in asked.items():
        check_known("part", old, bodies, "rename")
        where = f"rename {old!r}"
        if "|" in checked_name(where, new, colon=False):
            raise SceneError(f"{where}: {new!r} has a bar, which stands between parts; leave it out")
    whole = {n: str(asked.get(n, n)) for n in bodies}
    pieces = {p: whole[n] + p[len(n) :] for n, body in bodies.items() for p in body.parts}
    for names in (whole, pieces):
        owner: dict[str, str] = {}
        for old, new in names.items():
            if owner.setdefault(new, old) != old:
                raise SceneError(f"rename: {owner[new]!r} and {old!r} would both be {new!r}")
    return whole, pieces


def renamed_solid(solid: Solid, names: Mapping[str, str], label: str) -> Solid:
    """A solid by its new name; `label` is that in the file."""
    name = names[solid.name]
    surfaces = tuple(replace(surface, part=name) for surface in solid.surfaces)
    return replace(solid, name=name, label=label, surfaces=surfaces)


def renamed_touch(touch: Touch, names: Mapping[str, str]) -> Touch:
    """An interface between parts by their new names."""
    a, b = (names[part] for part in touch.parts)
    return replace(touch, name=f"{a}|{b}{touch.name[len('|'.join(touch.parts)) :]}", parts=(a, b))


def renamed_finding(found: Finding, names: Mapping[str, str]) -> Finding:
    """What a part is taken for, with the new names; its own, if it is a reason, is that in the file."""
    others = {old: new for old, new in names.items() if old != found.part}
    return replace(
        found,
        part=names[found.part],
        reasons=tuple(in_words(each, others) for each in found.reasons),
        passages=tuple(replace(each, part=names[each.part]) for each in found.passages),
        between=tuple(names[each] for each in found.between),
    )


def in_words(text: str, names: Mapping[str, str]) -> str:
    """A sentence with new names in place of the old ones, which stand in quotes."""
    quoted = {repr(old): repr(new) for old, new in names.items()}
    found = sorted(map(re.escape, quoted), key=len, reverse=True)
    return re.sub("|".join(found), lambda m: quoted[m[0]], text) if found else text
