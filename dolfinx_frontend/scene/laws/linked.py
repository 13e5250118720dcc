"""A sum of displacements of nodes that is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.scene.laws.base import Fields, Law, Points, resolve

__all__ = ["Linked"]


@dataclass(frozen=True, repr=False)
class Linked(Law):
    """A sum of displacements of nodes is `value`, length; made by ``scene.link``, whose sum is the jump."""

    value: Any = 0.0
    loading: ClassVar[tuple[str, ...]] = ("value",)
    linear: ClassVar[bool] = True
    drawn: ClassVar[str] = "support"

    def validate(self) -> None:
        self.check_value("value", self.value)

    @property
    def prescribes(self) -> Literal["jump", "force"] | None:
        return "jump"

    def parameters(self) -> dict[str, Any]:
        return {"value": self.value}

    def kernel_name(self, parameter: str) -> str:
        return "jump"

    def count(self, dim: int) -> int:
        return 1

    def jumps(self, points: Points) -> Array:
        return resolve(self.value, points, points.dim, "first", "value")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        return Fields("perfect", 1, self.rows(points), {"jump": self.imposed(points)})

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (False,) * (dim - 1)
