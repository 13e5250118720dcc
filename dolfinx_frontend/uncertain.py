"""What every stochastic answer offers, however it was computed: by chaos or by samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from dolfinx_frontend.assembly import Problem
from dolfinx_frontend.errors import SceneError, unknown_name
from dolfinx_frontend.quantities import Quantity
from dolfinx_frontend.random import RandomSpace

__all__ = ["StochasticResult", "Samples", "one_number_a_sample"]

Array = npt.NDArray[np.float64]


class Samples(Protocol):
    """Interface fields at N points of the germs: what a quantity of interest is computed from."""

    @property
    def germs(self) -> Array:
        """(N, L) points."""

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (N, m, components), local frame: component 0 is normal."""

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (N, m, components), local frame."""


class StochasticResult(ABC):
    """A random answer: moments of fields, and quantities of interest sample by sample."""

    problem: Problem
    seconds: dict[str, float]

    @property
    @abstractmethod
    def space(self) -> RandomSpace:
        """The germs."""

    @property
    @abstractmethod
    def converged(self) -> bool:
        """Whether every iteration reached its tolerance."""

    @abstractmethod
    def field_moments(self, substructure: str) -> tuple[Array, Array]:
        """Mean and standard deviation (n,) of the unknowns of a substructure, length."""

    @abstractmethod
    def force_moments(self, interface: str) -> tuple[Array, Array]:
        """Mean and standard deviation (m, components) of the force per area on side 1."""

    @abstractmethod
    def quantity(
        self, function: Callable[[Any], npt.ArrayLike], name: str = "quantity", unit: str = ""
    ) -> Quantity:
        """A scalar quantity of interest: `function` takes :class:`Samples`, returns (N,) values."""

    def mean(self, substructure: str) -> fem.Function:
        """Mean displacement."""
        return self._function(substructure, self.field_moments(substructure)[0], "mean")

    def std(self, substructure: str) -> fem.Function:
        """Standard deviation of each displacement component."""
        return self._function(substructure, self.field_moments(substructure)[1], "deviation")

    def _function(self, substructure: str, values: Array, name: str) -> fem.Function:
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        function = fem.Function(self.problem.substructures[substructure].V, name=name)
        function.x.array[:] = values
        return function


def one_number_a_sample(values: npt.ArrayLike, count: int, name: str) -> Array:
    """Values (N,) of a quantity of interest, or an error that says what its function returned."""
    data = np.asarray(values, dtype=np.float64)
    if data.shape != (count,):
        raise SceneError(
            f"quantity {name!r}: the function returned shape {data.shape} for {count} samples; "
            "return one number a sample"
        )
    return data
