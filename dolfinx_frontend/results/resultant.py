"""What a user wants to know of an assembly: the number whose error is asked about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_known, checked_name, is_whole
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Interest", "Resultant", "interest"]

Of = Literal["force", "jump"]
_COMPONENTS = ("normal", "shear1", "shear2")


@dataclass(frozen=True)
class Resultant:
    """A number of one interface: its total force, or its mean jump, in one local direction.

    Attributes
    ----------
    interface
        Name.
    of
        ``"force"``: integral of the force per area on side 1 (force), or ``"jump"``: mean of
        w2 - w1 (length).
    component
        0 is normal (tension > 0), 1 and 2 are tangential, in the local frames of the points.

    Raises
    ------
    SceneError
        A word or component that is not known.
    """

    interface: str
    of: Of = "force"
    component: int = 0

    def __post_init__(self) -> None:
        checked_name("Resultant", self.interface)
        if not isinstance(self.of, str) or self.of not in get_args(Of):
            raise SceneError(
                f"interface {self.interface!r}: of={self.of!r} is not known, use 'force' or 'jump'"
            )
        if not is_whole(self.component) or self.component not in (0, 1, 2):
            raise SceneError(
                f"interface {self.interface!r}: component {self.component!r} must be 0 (normal), 1 or 2"
            )

    def __str__(self) -> str:
        what = "force" if self.of == "force" else "mean jump"
        return f"{_COMPONENTS[self.component]} {what} of {self.interface}"

    def field(self, source: Any) -> Array:
        """The field that is summed, (..., points, components): force or jump of a result or of samples."""
        read = source.force if self.of == "force" else source.jump
        return np.asarray(read(self.interface))

    def total(self, field: Array, weights: Array) -> Array:
        """The number from such a field, for each of its leading axes; `weights` are the areas (points,)."""
        if self.component >= field.shape[-1]:
            raise SceneError(
                f"interface {self.interface!r} carries {field.shape[-1]} component(s), not component "
                f"{self.component}"
            )
        total = field[..., self.component] @ weights
        return np.asarray(total if self.of == "force" else total / weights.sum())

    def at_end(self, answer: Any, fields: Any) -> Array:
        """The number (N,) in samples of an answer, of a history at its end; collective."""

        def read() -> Array:
            values = self.total(self.field(fields), answer.problem.interfaces[self.interface].weights)
            return values if answer.times is None else values[..., -1]

        found: Array = answer.everywhere(self.interface, read)
        return found

    def value(self, result: Any) -> Array:
        """The number in a result: (), (T,) of a history, (N,) of samples.

        Parameters
        ----------
        result
            Anything with ``problem``, ``force(interface)`` and ``jump(interface)``.
        """
        interfaces = result.problem.interfaces
        check_known("interface", self.interface, interfaces, "problem")
        weights = interfaces[self.interface].weights
        return self.total(self.field(result), weights)


Interest = Resultant | str | None
"""A quantity of interest as users give it; a name: the normal force of that interface."""


def interest(interfaces: Mapping[str, Any], quantity: Interest) -> Resultant | None:
    """The quantity that is meant; None: the energy norm.

    Raises
    ------
    SceneError
        There is no such interface.
    """
    if quantity is None or (isinstance(quantity, str) and quantity == "energy"):
        return None
    wanted = "give a Resultant, the name of an interface, or 'energy'"
    check_kind("quantity of interest", "quantity", quantity, (Resultant, str), wanted)
    if isinstance(quantity, str):
        check_known("interface", quantity, interfaces, "quantity of interest")
        return Resultant(quantity)
    check_known("interface", quantity.interface, interfaces, "quantity of interest")
    return quantity
