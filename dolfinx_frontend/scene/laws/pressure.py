"""Pressure on a face."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points, resolve

__all__ = ["Pressure"]


@dataclass(frozen=True, repr=False)
class Pressure(Law):
    """Pressure on a face: f_1 = -p n, force / area."""

    p: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("p",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.LOAD
    kernel_names: ClassVar[Mapping[str, str]] = ReadOnlyDict({"p": "force"})
    drawn: ClassVar[str] = "pressure"

    def validate(self) -> None:
        self.check_value("p", self.p)

    def parameters(self) -> dict[str, Any]:
        return {"p": self.p}

    def count(self, dim: int) -> int:
        return 1

    def load(self, points: Points, time: float | None = None) -> Array:
        out = np.zeros((points.num_points, points.dim))
        out[:, :1] = -resolve(self.p, points, 1, name="p")
        return out

    def fields(self, points: Points, time: float | None = None) -> Fields:
        return Fields("force", 1, points.normals, {"force": self.load(points)[:, :1]})

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (False,) * dim
