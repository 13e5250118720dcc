"""Force per area on a face."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points, resolve

__all__ = ["Traction"]


@dataclass(frozen=True, repr=False)
class Traction(Law):
    """Force per area on a face: f_1 = t, a vector of d global components or x (m, d) -> (m, d)."""

    t: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("t",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.LOAD
    kernel_names: ClassVar[Mapping[str, str]] = ReadOnlyDict({"t": "force"})
    drawn: ClassVar[str] = "pressure"

    def validate(self) -> None:
        self.check_value("t", self.t)

    def parameters(self) -> dict[str, Any]:
        return {"t": self.t}

    def load(self, points: Points, time: float | None = None) -> Array:
        vector = resolve(self.t, points, points.dim, "zero", "t")
        local: Array = np.einsum("pij,pj->pi", points.frames, vector)
        return local

    def fields(self, points: Points, time: float | None = None) -> Fields:
        force = {"force": self.load(points).reshape(-1, 1)}
        return Fields("force", points.dim, self.rows(points), force)

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (False,) * dim
