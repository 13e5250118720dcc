"""Short descriptions of records for ``repr``, one line whatever they contain, and aligned columns of text."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["columns", "record", "short", "shown_error"]

FEW = 6
"""Numbers that are shown one by one."""


def short(value: Any) -> str:
    """A value in a few words: long arrays by shape and range, functions by name."""
    if isinstance(value, (bool, str)) or value is None:
        return repr(value)
    if isinstance(value, int) and value.bit_length() > 1000:  # beyond the range of floats
        return f"<integer of {value.bit_length()} bits>"
    if isinstance(value, (int, float, np.number)):
        return f"{value:g}"
    if isinstance(value, np.ndarray):
        if value.size <= FEW:
            return f"array({np.array2string(value, separator=', ', precision=6)})"
        if value.dtype.kind in "fiu":
            return f"<array {value.shape} of {value.min():g} to {value.max():g}>"
        return f"<array {value.shape}>"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k!r}: {short(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence) and type(value) in (tuple, list):
        shown = ", ".join(short(v) for v in value[:FEW])
        if len(value) > FEW:
            shown += f", ... {len(value)} in all"
        if isinstance(value, list):
            return f"[{shown}]"
        return f"({shown},)" if len(value) == 1 else f"({shown})"
    if callable(value) and hasattr(value, "__name__"):
        return f"<function {value.__name__}>"
    if repr(value) == object.__repr__(value):  # an address
        return f"<{type(value).__name__}>"
    return repr(value)


def shown_error(error: float) -> str:
    """An estimated error; one that is not known is not a number."""
    return f"{error:.1e}" if np.isfinite(error) else "not known"


def record(self: Any) -> str:
    """``repr`` of a dataclass: its name and the fields that differ from their defaults."""
    shown = []
    for field in dataclasses.fields(self):
        if not field.repr:
            continue
        value, default = getattr(self, field.name), field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        if value is default or (type(value) is type(default) and not _differ(value, default)):
            continue
        shown.append(f"{field.name}={short(value)}")
    return f"{type(self).__name__}({', '.join(shown)})"


def columns(rows: Sequence[Sequence[str]], sides: str) -> list[str]:
    """Lines of cells, aligned: `sides` has ``<`` (left) or ``>`` (right) for each column."""
    widths = [max((len(row[i]) for row in rows), default=0) for i in range(len(sides))]
    forms = [f"{side}{width}" for side, width in zip(sides, widths, strict=True)]
    return [
        "  ".join(f"{cell:{form}}" for cell, form in zip(row, forms, strict=True)).rstrip() for row in rows
    ]


def _differ(value: Any, default: Any) -> bool:
    try:
        return bool(value != default)
    except ValueError:  # arrays
        return True
