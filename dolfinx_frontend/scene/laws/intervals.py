"""Intervals of time in which a law acts: after their start, up to their end."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_reals
from dolfinx_frontend.common.errors import SceneError

__all__ = ["SAME_TIME", "Interval", "after", "checked_intervals", "missed", "within"]

Interval = tuple[float, float]

SAME_TIME = 1e-9
"""Times that differ by less than this share are the same."""


def after(time: float, moment: float) -> bool:
    """Whether a time is later; a step that should end an interval may miss its moment by rounding."""
    return time > moment and not math.isclose(time, moment, rel_tol=SAME_TIME)


def within(time: float, during: Iterable[Interval]) -> bool:
    """Whether a time is in one of some intervals."""
    return any(after(time, start) and not after(time, end) for start, end in during)


def missed(times: Array, during: Iterable[Interval]) -> Interval | None:
    """The first interval without a time, of those that end before the last one; None: there is none."""
    over = (span for span in during if after(float(times.max()), span[1]))
    return next((span for span in over if not any(within(float(t), [span]) for t in times)), None)


def checked_intervals(what: str, during: Any) -> tuple[Interval, ...]:
    """Intervals as a user gives them.

    Raises
    ------
    SceneError
        They are none, not in order, or overlap.
    """
    wanted = "give intervals ((start, end), ...)"
    table = checked_reals(what, "during", during, wanted)
    if table.ndim != 2 or table.shape[1] != 2:
        raise SceneError(f"{what}: during = {during!r}: {wanted}")
    ends = [float(t) for t in table.ravel()]
    if not ends or not all(map(math.isfinite, ends)) or any(
        b < a or (b == a and k % 2 == 0) for k, (a, b) in enumerate(zip(ends, ends[1:]))
    ):
        raise SceneError(f"{what}: during = {during!r}; intervals increase and do not overlap")
    return tuple(zip(ends[::2], ends[1::2], strict=True))
