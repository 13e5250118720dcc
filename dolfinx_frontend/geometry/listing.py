"""Tables of what is in a STEP file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.geometry.findings import Finding
from dolfinx_frontend.geometry.solids import Solid, Surface, vector
from dolfinx_frontend.geometry.touching import Touch

__all__ = ["finding_table", "interface_table", "part_table", "surface_table"]


def part_table(
    solids: Mapping[str, Solid], cells: Mapping[str, tuple[float, float, float]], materials: Mapping[str, str]
) -> list[str]:
    """Lines: volume, material, and size and expected number of cells, and of unknowns, of each part."""
    heads = ("part", "volume mm^3", "faces", "cells mm", "cells", "unknowns", "material")
    rows: list[tuple[str, ...]] = [heads]
    for n, solid in solids.items():
        size, *counts = cells[n]
        row = (f"{solid.volume:.5g}", str(len(solid.surfaces)), f"{size:.3g}", *map(_about, counts))
        rows.append((n, *row, materials.get(n, "-")))
    rows = _merged(rows)
    total = (_about(sum(each[k] for each in cells.values())) for k in (1, 2))
    return columns([*rows, ("all, about", "", "", "", *total, "")], "<>>>>><")


def _about(count: float) -> str:
    """Two digits of a count."""
    return f"{float(f'{count:.2g}'):.0f}"


def interface_table(touches: Mapping[str, Touch], laws: Mapping[str, str]) -> list[str]:
    """Lines: what touches, and by which law; empty if nothing does."""
    rows: list[tuple[str, ...]] = [("interface", "kind", "area mm^2", "gap mm", "face", "law")]
    for n, t in touches.items():
        shape = f"normal {vector(t.normal)}" if np.any(t.normal) else t.shape
        rows.append((n, t.kind, f"{t.area:.5g}", f"{t.gap:.3g}", shape, laws.get(n, "-")))
    return ["", *columns(_merged(rows), "<<>><<")] if touches else []


def finding_table(found: Mapping[str, Finding]) -> list[str]:
    """Lines: what parts are taken for, and why."""
    rows: list[tuple[str, ...]] = [("part", "taken for", "why")]
    rows += [(n, f.title, "; ".join(f.reasons)) for n, f in found.items() if f.kind]
    return ["", *columns(_merged(rows), "<<<")] if len(rows) > 1 else []


def _merged(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows that differ only in the number of ``nut 1``, ``nut 2``, ... as one row, ``nut 1 .. 8``."""
    out: list[tuple[str, ...]] = []
    counts: list[int] = []
    for row in rows:
        stem = _stem(row[0])
        same = [
            k for k, other in enumerate(out) if other[1:] == row[1:] and _stem(other[0]) == stem
        ]
        if same and stem != row[0]:
            counts[same[0]] += 1
        else:
            out.append(row)
            counts.append(1)
    return [
        (row[0] if count == 1 else f"{_stem(row[0])}  ({count})", *row[1:])
        for row, count in zip(out, counts, strict=True)
    ]


def _stem(name: str) -> str:
    """A name without its numbers."""
    return re.sub(r"\d+", "*", name)


def surface_table(surfaces: Sequence[Surface], names: Mapping[int, str] | None = None) -> str:
    rows = [("tag", "area mm^2", "centre mm", "face", "name")]
    for s in surfaces:
        centre = vector(np.round(s.centre, 2))
        rows.append((str(s.tag), f"{s.area:.5g}", centre, s.shape, (names or {}).get(s.tag, "")))
    return "\n".join("  " + line for line in columns(rows, ">>><<"))
