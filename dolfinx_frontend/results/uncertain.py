"""What every stochastic answer offers, however it was computed: by chaos or by samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.uncertainty.quantities import Quantity
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["Samples", "StochasticResult", "one_number_a_sample", "timed"]


def timed(plan: Plan, block: Array) -> Array:
    """Fields (..., columns of a history) as ([T,] ...): T only where the plan has times."""
    return block[..., 0] if plan.times is None else plan.in_time(block)


class Samples(Protocol):
    """Interface fields at N points of the germs: what a quantity of interest is computed from.

    Over a load history they have the T time steps after the samples.
    """

    @property
    def germs(self) -> Array:
        """(N, L) points."""

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (N, [T,] m, components), local frame: component 0 is normal."""

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (N, [T,] m, components), local frame."""


class StochasticResult(ABC):
    """A random answer: moments of fields, and quantities of interest sample by sample."""

    problem: Problem
    seconds: Mapping[str, float]

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
        """Mean and standard deviation ([T,] n) of the unknowns of a substructure, length."""

    @abstractmethod
    def force_moments(self, interface: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] m, components) of the force per area on side 1."""

    @abstractmethod
    def quantity(
        self, function: Callable[[Any], npt.ArrayLike], name: str = "quantity", unit: str = ""
    ) -> Quantity:
        """A scalar quantity of interest: `function` takes :class:`Samples`, returns (N,) values."""

    def mean(self, substructure: str, step: int = -1) -> fem.Function:
        """Mean displacement; of a load history at a time step, the last by default."""
        return self._function(substructure, self.field_moments(substructure)[0], "mean", step)

    def std(self, substructure: str, step: int = -1) -> fem.Function:
        """Standard deviation of each displacement component; of a load history at a time step."""
        return self._function(substructure, self.field_moments(substructure)[1], "deviation", step)

    def _function(
        self, substructure: str, values: Array, name: str, step: int = -1
    ) -> fem.Function:
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        function = fem.Function(self.problem.substructures[substructure].V, name=name)
        function.x.array[:] = values[step] if values.ndim > 1 else values
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
