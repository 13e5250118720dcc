"""A plane of symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws.base import Elimination, Face, Fields, Law, Points

__all__ = ["Symmetry"]


FLATNESS = 1e-5
"""Largest difference of unit normals on a symmetry plane."""


@dataclass(frozen=True, repr=False)
class Symmetry(Law):
    """Frictionless symmetry plane: w_1 . n = 0, no tangential force."""

    sides: ClassVar[tuple[int, ...]] = (1,)
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.REMOVED
    drawn: ClassVar[str] = "symmetry"

    def count(self, dim: int) -> int:
        return 1

    def fields(self, points: Points, time: float | None = None) -> Fields:
        return Fields("perfect", 1, points.normals, {"jump": np.zeros((points.num_points, 1))})

    def removed(self, dim: int) -> int:
        return 1

    def constraint(self, name: str, face: Face, nodes: Array) -> tuple[Array, Array]:
        if face.flatness > FLATNESS:
            raise SceneError(
                f"interface {name!r}: the symmetry face {face.substructure}:{face.face} "
                f"is not flat (normals differ by {face.flatness:.3g}); name each plane as a face "
                "of its own"
            )
        return face.normal[None, :], np.zeros((len(nodes), 1))

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (False,) * (dim - 1)
