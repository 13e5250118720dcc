"""Prescribed displacement of a face."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_axes, is_whole
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.scene.laws.base import Elimination, Face, Fields, Law, Points, resolve
from dolfinx_frontend.scene.values import evaluate

__all__ = ["Displacement"]


@dataclass(frozen=True, repr=False)
class Displacement(Law):
    """Prescribed displacement of a face: w_1 = value in the named components.

    Parameters
    ----------
    value
        Length.  A vector of d components (those that are not named are ignored), a callable
        x (m, d) -> (m, d), or a number for all named components.
    components
        Axes (0 = x) that are prescribed; None: all.
    frame
        Rows: its own axes in global components, (d, d), orthonormal; None: the global axes.
    """

    value: Any = 0.0
    components: tuple[int, ...] | None = None
    frame: Any = None
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = ("value",)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.REMOVED
    kernel_names: ClassVar[Mapping[str, str]] = ReadOnlyDict({"value": "jump"})
    drawn: ClassVar[str] = "support"

    def validate(self) -> None:
        self.check_value("value", self.value)
        if self.components is not None:
            given = self.components
            several = isinstance(given, (list, tuple, range, np.ndarray)) and np.ndim(given) == 1
            components: tuple[Any, ...] = tuple(cast(Any, given)) if several else (given,)
            known = bool(components) and all(is_whole(c) and c >= 0 for c in components)
            if not known or len(set(components)) < len(components):
                raise SceneError(
                    f"Displacement: components = {self.components!r}; name different axes, 0 = x"
                )
            object.__setattr__(self, "components", tuple(int(c) for c in components))
        if self.frame is not None:
            checked_axes("Displacement", "frame", self.frame)

    def check_dimension(self, dim: int, where: str) -> None:
        if self.components is not None and max(self.components) >= dim:
            raise SceneError(f"{where}: components = {self.components} in {dim} dimensions; 0 is x")
        if self.frame is not None and len(self.frame) != dim:
            raise SceneError(f"{where}: frame has {len(self.frame)} axes in {dim} dimensions; give {dim}")

    def parameters(self) -> dict[str, Any]:
        return {"value": self.value}

    def _axes(self, dim: int) -> list[int]:
        """The prescribed components in `dim` dimensions."""
        return list(range(dim) if self.components is None else self.components)

    def directions(self, dim: int) -> Array:
        own: Array = np.eye(dim) if self.frame is None else np.asarray(self.frame, dtype=np.float64)
        return np.asarray(own[self._axes(dim)])

    def count(self, dim: int) -> int:
        return len(self._axes(dim))

    def rows(self, points: Points) -> Array:
        return np.tile(self.directions(points.dim), (points.num_points, 1))

    def fields(self, points: Points, time: float | None = None) -> Fields:
        value = resolve(self.value, points, points.dim, "all", "value")[:, self._axes(points.dim)]
        # the ground is side 2: j = -w_1
        jump = {"jump": -value.reshape(-1, 1)}
        return Fields("perfect", self.count(points.dim), self.rows(points), jump)

    def removed(self, dim: int) -> int:
        return self.count(dim)

    def constraint(self, name: str, face: Face, nodes: Array) -> tuple[Array, Array]:
        d = nodes.shape[1]
        what = f"interface {name!r}, parameter 'value'"
        value = evaluate(self.value, nodes, d, what, "all", arrays=False)
        return self.directions(d), value[:, self._axes(d)]

    def held_rows(self, points: Points) -> Array:
        return np.tile(self.directions(points.dim), (points.num_points, 1, 1))
