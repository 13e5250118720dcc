"""Springs between the sides, or to the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points, resolve
from dolfinx_frontend.scene.values import is_zero

__all__ = ["Elastic"]


@dataclass(frozen=True, repr=False)
class Elastic(Law):
    """Springs between the sides: f_1 = kappa (j - Delta) = -f_2; one-sided: springs to the ground.

    kappa is diagonal in the local frame: ``normal`` along n, ``tangential`` along the others.  A
    bolt that was shortened by 0.2 mm has jump = -0.2.

    Parameters
    ----------
    normal, tangential
        Stiffness per area, force / length^3, >= 0 (of the whole interface, force / length, if
        ``total``).  None leaves the direction free.
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    total
        Whether the stiffness is that of the whole interface as it is modelled (a half bolt has half
        the stiffness).
    """

    normal: Any = None
    tangential: Any = None
    jump: Any = 0.0
    total: bool = False
    loading: ClassVar[tuple[str, ...]] = ("jump",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.SPRINGS
    not_negative: ClassVar[tuple[str, ...]] = ("normal", "tangential")
    spans: ClassVar[Mapping[str, slice]] = ReadOnlyDict({"normal": slice(0, 1), "tangential": slice(1, None)})
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "springs"

    def validate(self) -> None:
        if self.normal is None and self.tangential is None:
            raise SceneError("Elastic: neither normal nor tangential stiffness is given; give one")
        for name in ("normal", "tangential"):
            value = getattr(self, name)
            if value is not None:
                remedy = "stiffness is >= 0 and finite (Perfect() is the infinitely stiff one)"
                self.check_value(name, value, 0.0, remedy)
        self.check_value("jump", self.jump)

    @property
    def bolt(self) -> bool:
        return not is_zero(self.jump)

    def parameters(self) -> dict[str, Any]:
        return self.given("normal", "tangential", "jump")

    def matters(self, parameter: str) -> bool:
        return parameter != "jump" or any(self.holds(3))

    def per_area(self, parameter: str, area: float) -> float:
        return 1.0 / area if self.total and parameter in self.spans else 1.0

    def count(self, dim: int) -> int:
        return 1 if self.tangential is None else dim

    def stiffnesses(self, points: Points) -> Array:
        out = np.zeros((points.num_points, points.dim))
        for name, where in self.spans.items():
            value = getattr(self, name)
            if value is None:
                continue
            kappa = resolve(value, points, 1, name=name)
            if kappa.min() < 0.0:
                raise SceneError(
                    f"interface {points.name!r}: {name} stiffness {kappa.min():g} is negative; "
                    "stiffness is >= 0"
                )
            out[:, where] = kappa / points.area if self.total else kappa
        return out

    def jumps(self, points: Points) -> Array:
        return resolve(self.jump, points, points.dim, "first", "jump")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        kappa = self.stiffnesses(points)
        parameters = {
            "normal": kappa[:, :1],
            "tangential": kappa[:, 1:2],
            "jump": self.imposed(points),
        }
        return Fields("elastic", self.count(points.dim), self.rows(points), parameters)

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (not is_zero(self.normal),) + (not is_zero(self.tangential),) * (dim - 1)

    def held_rows(self, points: Points) -> Array:
        kappa = self.stiffnesses(points)[:, list(np.flatnonzero(self.holds(points.dim)))]
        rows: Array = super().held_rows(points) * (kappa[:, :, None] > 0.0)
        return rows
