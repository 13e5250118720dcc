"""Copies of what a user gives that no later change of it can reach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["frozen"]


def frozen(value: Any) -> Any:
    """A value with its arrays copied and read-only, its lists turned into tuples; all else as it is."""
    if isinstance(value, np.ndarray):
        if value.base is None and not value.flags.writeable:
            return value  # one of our own copies
        copy = value.copy()
        copy.setflags(write=False)
        return copy
    if type(value) in (list, tuple):
        return tuple(frozen(each) for each in value)
    if isinstance(value, Mapping):
        return {key: frozen(each) for key, each in value.items()}
    return value
