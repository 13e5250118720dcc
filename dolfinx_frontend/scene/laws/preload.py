"""Pretension section of a bolt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_number, checked_reals
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws.base import Fields, Law, Points, resolve, settled
from dolfinx_frontend.scene.laws.perfect import Perfect

__all__ = ["Preload"]


SAME_TIME = 1e-9
"""Times that differ by less than this share are the same."""


@dataclass(frozen=True, repr=False)
class Preload(Law):
    """Pretension section of a bolt: by force, then fixed at its length; tied in the tangential directions.

    In the time steps up to `until` the normal force is the given one; afterwards the normal jump of every
    point stays what it was, and the force follows from the structure. Without `until` the force is
    given throughout. With `during` it is given in some intervals only, as where bolts are tightened one after
    another, and again: before the first one the section has its original length (a bolt that just fits). (A
    shortening that is known is ``Elastic(jump=...)`` or ``Contact(jump=...)``.)

    Parameters
    ----------
    force
        Force on the whole section as it is modelled (half of it on half a bolt), > 0 in tension.
    until
        Last time of force control; None: all times.
    total
        False: `force` is per area.
    during
        Intervals (start, end] of force control, in order; instead of `until`.
    """

    force: Any
    until: float | None = None
    total: bool = True
    during: tuple[tuple[float, float], ...] | None = None
    drawn: ClassVar[str] = "preload"

    def validate(self) -> None:
        self.check_value("force", self.force)
        if self.until is not None:
            checked_number("Preload", "until", self.until)
        if self.during is None:
            return
        if self.until is not None:
            raise SceneError("Preload: until and during are given: give one")
        wanted = "give intervals ((start, end), ...)"
        table = checked_reals("Preload", "during", self.during, wanted)
        if table.ndim != 2 or table.shape[1] != 2:
            raise SceneError(f"Preload: during = {self.during!r}: {wanted}")
        spans = tuple((float(start), float(end)) for start, end in table)
        ends = [t for span in spans for t in span]
        if not ends or not all(map(math.isfinite, ends)) or any(
            b < a or (b == a and k % 2 == 0) for k, (a, b) in enumerate(zip(ends, ends[1:]))
        ):
            raise SceneError(f"Preload: during = {self.during!r}; intervals increase and do not overlap")
        object.__setattr__(self, "during", spans)

    def controlled(self, time: float | None) -> bool:
        if time is None:
            return True
        now = time

        def after(moment: float) -> bool:
            # a step that should end the tightening may miss its time by rounding
            return now > moment and not math.isclose(now, moment, rel_tol=SAME_TIME)

        if self.during is not None:
            return any(after(start) and not after(end) for start, end in self.during)
        return self.until is None or not after(self.until)

    @property
    def history(self) -> bool:
        return self.until is not None or self.during is not None

    @property
    def bolt(self) -> bool:
        return True

    @property
    def rigid(self) -> bool:
        return True

    def parameters(self) -> dict[str, Any]:
        return {"force": self.force}

    def fields(self, points: Points, time: float | None = None) -> Fields:
        parameters = {
            "force": self._normal_force(points),
            "locked": np.full((points.num_points, 1), float(not self.controlled(time))),
        }
        return Fields("preload", points.dim, self.rows(points), parameters)

    def _normal_force(self, points: Points) -> Array:
        """f_n (m, 1), force / area."""
        area = points.area if self.total else 1.0
        return np.divide(resolve(self.force, points, 1, name="force"), area)

    def load(self, points: Points, time: float | None = None) -> Array | None:
        if not self.controlled(time):
            return None
        out = np.zeros((points.num_points, points.dim))
        out[:, :1] = self._normal_force(points)
        return out

    def holds(self, dim: int) -> tuple[bool, ...]:
        # while it is tightened, something else must hold the two ends
        return (False,) + (True,) * (dim - 1)

    @property
    def locked(self) -> Law:
        return Perfect()

    def tightened(self, points: Points, times: Array) -> int | None:
        if self.until is None and self.during is None:
            return settled([resolve(self.at(t).force, points, 1, name="force") for t in times])
        return max((k for k, t in enumerate(times) if self.controlled(t)), default=0)
