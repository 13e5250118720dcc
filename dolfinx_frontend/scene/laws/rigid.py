"""Faces that move as rigid bodies or stay plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.scene.amplitudes import Combination, Varying
from dolfinx_frontend.scene.laws.base import Elimination, Fields, Law, Points
from dolfinx_frontend.scene.values import Parameter, evaluate, is_plain

__all__ = ["MOTIONS", "Rigid"]

MOTIONS = ("x", "y", "z", "rx", "ry", "rz", "n")


@dataclass(frozen=True, repr=False)
class Rigid(Law):
    """A face that moves as a rigid body, alone or with others of its group, or that stays plane.

    Its nodes are taken out of the unknowns of the parts (condensation): what is left are the motions of the
    group, so nothing is iterated on and no multiplier is added. Made by ``scene.rigid`` and ``scene.plane``.

    Parameters
    ----------
    group, anchor, leads
        Name of the group, the part of its first face, and whether this is that face, which has the motions
        that are given.
    plane
        Only displacements along the normal are tied: the face stays plane.
    tilts
        With `plane`: whether it may turn about axes in the plane.
    point
        Point of the rigid body of which x, y, z are the displacement; None: the centroid of the faces.
    x, y, z, rx, ry, rz
        Given displacements of the point (length) and rotations (radians) along global axes; None: free.
    n
        With `plane` and without `tilts`: the given displacement along the normal.
    """

    group: str
    anchor: str
    leads: bool = True
    plane: bool = False
    tilts: bool = True
    point: Any = None
    x: Any = None
    y: Any = None
    z: Any = None
    rx: Any = None
    ry: Any = None
    rz: Any = None
    n: Any = None
    sides: ClassVar[tuple[int, ...]] = (1,)
    loading: ClassVar[tuple[str, ...]] = MOTIONS
    linear: ClassVar[bool] = True
    elimination: ClassVar[Elimination | None] = Elimination.TIED
    drawn: ClassVar[str] = "support"

    def validate(self) -> None:
        for name, value in self.parameters().items():
            numbers = [v for _, v in value.terms] if isinstance(value, (Varying, Combination)) else [value]
            for number in numbers:
                if isinstance(number, Parameter) and not is_plain(number):
                    raise SceneError(
                        f"rigid face {self.group!r}: {name} = {number!r} is random; its motion is given by "
                        "numbers: give the random force by scene.force, or a spring with a random jump"
                    )
                if not is_plain(number) or np.ndim(number) != 0:
                    raise SceneError(f"rigid face {self.group!r}: {name} = {number!r}; give a number")
            self.check_value(name, value)
        given = self.parameters()
        if self.plane and set(given) - ({"n"} if not self.tilts else set()):
            raise SceneError(
                f"plane face {self.group!r}: {', '.join(given)} is given; a face that is kept plane takes n, "
                "and "
                "with tilts=False only: use scene.rigid for more"
            )
        if not self.plane and "n" in given:
            raise SceneError(f"rigid face {self.group!r}: n is given; give x, y, z, rx, ry, rz")

    def check_dimension(self, dim: int, where: str) -> None:
        if dim == 2 and {"z", "rx", "ry"} & set(self.parameters()):
            raise SceneError(f"{where}: a rigid face in two dimensions has the motions x, y and rz")

    def parameters(self) -> dict[str, Any]:
        return self.given(*MOTIONS)

    @property
    def title(self) -> str:
        return "Plane" if self.plane else "Rigid"

    @property
    def rigid(self) -> bool:
        return False  # what it ties may still be held

    @property
    def partners(self) -> tuple[str, ...]:
        return (self.anchor,)

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (False,) * dim

    def motions(self) -> dict[str, float]:
        """The motions that are given, by name."""
        nowhere = np.zeros((1, 1))
        return {
            name: float(evaluate(value, nowhere, 1, f"rigid face {self.group!r}, {name}")[0, 0])
            for name, value in self.parameters().items()
        }

    def count(self, dim: int) -> int:
        return 1 if self.plane else dim

    def removed(self, dim: int) -> int:
        return 1 if self.plane else dim

    def fields(self, points: Points, time: float | None = None) -> Fields:
        motions: Array = np.reshape([*self.motions().values()], (-1, 1))
        rows = self.rows(points)
        parameters = {"jump": np.zeros((len(rows), 1)), "motions": motions}
        return Fields("perfect", self.count(points.dim), rows, parameters)
