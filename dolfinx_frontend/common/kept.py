"""What is found once, and kept on an object that is frozen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["kept"]

T = TypeVar("T")


def kept(owner: Any, name: str, make: Callable[[], T]) -> T:
    """What `make` finds when first asked for, as :class:`functools.cached_property` keeps it."""
    known = vars(owner)
    if name not in known:
        known[name] = make()
    found: T = known[name]
    return found
