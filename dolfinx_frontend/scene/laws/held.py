"""Prescribed displacement of a face in some intervals of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points, resolve
from dolfinx_frontend.scene.laws.displacement import Displacement
from dolfinx_frontend.scene.laws.intervals import checked_intervals, missed, within
from dolfinx_frontend.scene.laws.traction import Traction
from dolfinx_frontend.scene.values import evaluate

__all__ = ["Held"]


@dataclass(frozen=True, repr=False)
class Held(Displacement):
    """A support that comes and goes; made by ``scene.fix(..., during=)``.

    Parameters
    ----------
    during
        Intervals (start, end] in which it holds, in order; in between it carries nothing.
    kept
        Share of the distance from its value, at the last step before an interval, that is left: 0 holds the
        face at its value, 1 where it was. A number, or an Amplitude times one.
    """

    during: tuple[tuple[float, float], ...] = ()
    kept: Any = 0.0
    linear: ClassVar[bool] = False
    elimination: ClassVar[Elimination | None] = None

    def validate(self) -> None:
        super().validate()
        self.check_value("kept", self.kept)
        object.__setattr__(self, "during", checked_intervals("fix", self.during))

    @property
    def history(self) -> bool:
        return True

    @property
    def timed(self) -> bool:
        return True

    @property
    def rigid(self) -> bool:
        return True

    @property
    def prescribes(self) -> Literal["jump", "force"] | None:
        return None  # not at all times

    def parameters(self) -> dict[str, Any]:
        return {"value": self.value, "kept": self.kept}

    def controlled(self, time: float | None) -> bool:
        return time is not None and not within(time, self.during)

    def skipped(self, times: Array) -> str:
        span = missed(times, self.during)
        return "" if span is None else f"it holds after {span[0]:g} up to {span[1]:g}, and no step is there"

    def prescribed(self, time: float) -> Law | None:
        kept = evaluate(self.at(time).kept, np.zeros((1, 1)), 1, "fix: kept")
        return None if self.controlled(time) or np.any(kept) else self.locked

    @property
    def locked(self) -> Law:
        return Displacement(self.value, self.components, self.frame)

    @property
    def released(self) -> Law:
        return Traction()

    def fields(self, points: Points, time: float | None = None) -> Fields:
        found = super().fields(points, time)
        more = {
            "held": np.full((points.num_points, 1), float(not self.controlled(time))),
            "kept": resolve(self.kept, points, 1, name="kept"),
        }
        return Fields("held", found.components, found.frames, {**found.parameters, **more})
