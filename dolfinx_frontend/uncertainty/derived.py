"""Random numbers that follow from others: a bolt's force from its torque and the friction in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.uncertainty.parameters import RandomParameter

__all__ = ["DerivedParameter"]


@dataclass(frozen=True, eq=False, repr=False)
class DerivedParameter:
    """A function of random parameters. It has no germ of its own.

    Attributes
    ----------
    name
        For messages.
    function
        Arrays (N,) of the parameters, by name -> (N,).
    of
        Name in the function -> random parameter.
    """

    name: str
    function: Callable[[Mapping[str, Array]], Array] = field(repr=False)
    of: Mapping[str, RandomParameter]

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", ReadOnlyDict(self.of))

    def __repr__(self) -> str:
        return f"{self.name}({', '.join(map(repr, self.of.values()))})"

    @property
    def affine(self) -> bool:
        """Whether it is a linear function of its germs: not known, so no."""
        return False

    @property
    def mean(self) -> float:
        """Its value where all parameters are at their means."""
        return float(self.value({key: np.array([each.mean]) for key, each in self.of.items()})[0])

    def value(self, values: Mapping[str, Array]) -> Array:
        """At values (N,) of the parameters: (N,)."""
        return np.asarray(self.function(values), dtype=np.float64)
