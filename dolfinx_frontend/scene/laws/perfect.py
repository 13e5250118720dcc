"""Glue, with or without an imposed jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points, resolve
from dolfinx_frontend.scene.values import evaluate, is_zero

__all__ = ["Perfect"]


@dataclass(frozen=True, repr=False)
class Perfect(Law):
    """Glue: j = Delta, f_2 = -f_1.

    Parameters
    ----------
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    """

    jump: Any = 0.0
    sides: ClassVar[tuple[int, ...]] = (2,)
    loading: ClassVar[tuple[str, ...]] = ("jump",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.GLUED
    drawn: ClassVar[str] = "perfect"

    def validate(self) -> None:
        self.check_value("jump", self.jump)

    def parameters(self) -> dict[str, Any]:
        return {"jump": self.jump}

    def jumps(self, points: Points) -> Array:
        return resolve(self.jump, points, points.dim, "first", "jump")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        return Fields("perfect", points.dim, self.rows(points), {"jump": self.imposed(points)})

    def eliminated(self, matching: bool) -> Elimination | None:
        # nodes with a jump between them are no node
        return Elimination.GLUED if matching and is_zero(self.jump) else None

    def removed(self, dim: int) -> int:
        return dim

    def nodal_jumps(self, name: str, nodes: Array) -> Array:
        what = f"interface {name!r}, parameter 'jump'"
        return evaluate(self.jump, nodes, nodes.shape[1], what, "first", arrays=False)
