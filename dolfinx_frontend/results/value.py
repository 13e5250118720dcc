"""What it means that a result is a value.

A result keeps what it was computed with: the factorised structure (shared, constant) and its laws. What is
recovered from it later, such as displacements, are cached pure functions of it.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Self

from dolfinx_frontend.common.frozen import OneProcess, locked

__all__ = ["Value"]


class Value(OneProcess):
    """A frozen dataclass that shares its factorised structure with others."""

    _notes: frozenset[str] = frozenset({"seconds", "found", "verdict"})
    """Fields that say something about the answer and change nothing in it."""

    def __post_init__(self) -> None:
        locked(self)

    def with_notes(self, **notes: Any) -> Self:
        """The same answer with other notes; what was recovered already is shared."""
        unknown = set(notes) - self._notes
        if unknown:
            raise TypeError(f"{', '.join(sorted(unknown))} would make it another answer")
        other: Self = replace(self, **notes)  # type: ignore[type-var]
        own = {each.name for each in fields(self)}  # type: ignore[arg-type]
        vars(other).update({k: v for k, v in vars(self).items() if k not in own})
        return other

    @property
    def _instead(self) -> str:
        how = "result.save(path) writes it, dolfinx_frontend.load(path) reads it in any process"
        if not hasattr(self, "save"):
            how = "take its arrays, or solve in the process that needs it"
        return f"it holds factorised matrices, which live in this process; {how}"
