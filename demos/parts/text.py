"""Tables on the screen, for the demos and the benchmarks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dolfinx_frontend.common.describe import columns

__all__ = ["table"]


def table(header: Sequence[Any], rows: Sequence[Sequence[Any]]) -> None:
    """Print columns, the first to the left, the others to the right; None is a dash."""
    cells = [["-" if c is None else str(c) for c in row] for row in (header, *rows)]
    first, *others = columns(cells, "<" + ">" * (len(header) - 1))
    rule = "-" * max(map(len, [first, *others]))
    print(*(f"  {line}" for line in (first, rule, *others)), sep="\n")
