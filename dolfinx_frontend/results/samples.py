"""Answers at points of the germs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from latin_core import State, SweepPoints, stochastic

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.kernel.bridge import KernelLaws, read_only
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.errors import Errors, Estimator, not_measured
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.results.surfaces import Moments
from dolfinx_frontend.results.sweep import PointResults
from dolfinx_frontend.results.uncertain import StochasticResult, one_number_a_sample, timed
from dolfinx_frontend.results.value import Value
from dolfinx_frontend.uncertainty.quantities import Quantity
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["Kind", "SampleFields", "SampleResult"]

Kind = Literal["random", "qmc", "quadrature"]


@dataclass(frozen=True, repr=False)
class SampleFields:
    """Interface fields at all points; what a quantity of interest is computed from."""

    germs: Array
    _result: SampleResult = field(repr=False)

    def __repr__(self) -> str:
        return f"SampleFields({len(self.germs)} points in {self.germs.shape[1]} germs)"

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (N, [T,] m, components), local frame: component 0 is normal."""
        return self._result.force(interface)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (N, [T,] m, components), local frame."""
        return self._result.jump(interface)


@dataclass(frozen=True, eq=False, repr=False)
class SampleResult(Value, PointResults, StochasticResult):
    """Answers at points of the germs.

    Attributes
    ----------
    germs
        (N, L) points.
    weights
        (N,) quadrature weights, or None: all points count the same.
    kind
        ``"random"``, ``"qmc"`` or ``"quadrature"``.
    points
        Iterations, estimated errors, statuses and interface fields of every point.
    seconds
        Wall time: ``setup``, ``solve``.
    solver, laws
        The factorised structure, which other results may share, and the laws where nothing is random.
    found
        Errors that ``solve(accuracy=...)`` has measured on its way.
    """

    problem: Problem
    plan: Plan
    random: RandomLaws
    germs: Array
    weights: Array | None
    kind: Kind
    points: SweepPoints
    seconds: Mapping[str, float]
    solver: Solver
    laws: KernelLaws
    found: Errors | None = field(default=None, kw_only=True)
    estimator: Estimator = field(default=not_measured, kw_only=True)

    @property
    def shape(self) -> tuple[int, ...]:
        """(N,)."""
        return (len(self.germs),)

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    def check_complete(self) -> None:
        """Refuse statistics of an interrupted sampling.

        Raises
        ------
        SceneError
            Points are missing. They are solved from neighbour to neighbour, so the first ones are no sample.
        """
        if not self.complete:
            raise SceneError(
                f"sampling: interrupted after {int(self.finished.sum())} of {len(self.germs)} points, which "
                "are neighbours and no fair sample: their force and jump are there, statistics are not; run "
                "it again (with checkpoint=, what is finished is not solved twice)"
            )

    @property
    def converged(self) -> bool:
        """Whether all points reached the tolerance."""
        return self.status == "converged"

    @property
    def probabilities(self) -> Array:
        """(N,) weights of the points, of sum 1."""
        self.check_complete()
        count = len(self.germs)
        if self.weights is None:
            return np.full(count, 1.0 / count)
        return np.asarray(self.weights / self.weights.sum(), dtype=np.float64)

    def displacements(self, chunk: int = 64) -> Iterator[tuple[slice, dict[str, Array]]]:
        """Unknowns of all substructures, some points at a time: (points, substructure -> ([T,] n, points)).

        Interior fields are recovered here, one solve a point.
        """
        if self.points.states is None:
            raise SceneError("the states of the points were not kept: sample with keep_states=True")
        for start in range(0, len(self.germs), chunk):
            part = slice(start, min(start + chunk, len(self.germs)))
            states = self.points.states[part]  # (points, 2, rows, columns)
            data, traces = np.moveaxis(states, 0, 2).reshape(2, states.shape[2], -1)
            state = State(np.asfortranarray(data), np.asfortranarray(traces))
            amplitudes = np.asfortranarray(np.tile(self.plan.amplitudes, (1, len(states))))
            fields = self.solver.displacements(self.laws, state, amplitudes)
            yield part, {
                name: timed(self.plan, values.reshape(len(values), len(states), -1))
                for name, values in fields.items()
            }

    def field_moments(self, substructure: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] n) of the unknowns of a substructure, length."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "samples")
        return self._moments[substructure]

    @cached_property
    def _moments(self) -> dict[str, tuple[Array, Array]]:
        self.check_complete()
        moments = Moments()
        for part, fields in self.displacements():
            samples = {name: np.moveaxis(values, -1, 0) for name, values in fields.items()}
            moments.add(samples, None if self.weights is None else self.weights[part])
        return {name: (read_only(m), read_only(s)) for name, (m, s) in moments.found().items()}

    def force_moments(self, interface: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] m, components) of the force per area on side 1."""
        self.check_complete()
        moments = Moments()
        moments.add({interface: self.force(interface)}, self.weights)
        return moments.found()[interface]

    def coefficients(self, basis: stochastic.ChaosBasis) -> dict[str, Array]:
        """Non-intrusive chaos: coefficients ([T,] n, P + 1) of the unknowns, projected with the weights."""
        weighted = basis.evaluate(self.germs) * self.probabilities[:, None]
        out: dict[str, Array] = {}
        for part, fields in self.displacements():
            for name, values in fields.items():
                out[name] = out.get(name, 0.0) + values @ weighted[part]
        return out

    def quantity(
        self,
        function: Callable[[SampleFields], npt.ArrayLike],
        name: str = "quantity",
        unit: str = "",
    ) -> Quantity:
        """A scalar quantity of interest; `function` takes the fields and returns (N,) values."""
        self.check_complete()
        values = one_number_a_sample(
            function(SampleFields(self.germs, self)), len(self.germs), name
        )
        return Quantity(name=name, unit=unit, values=values, weights=self.weights, kind=self.kind)

    def errors(self, quantity: Resultant | str | None = None) -> Errors:
        """As :meth:`Result.errors`; the error of the sampling by the spread of parts of the sample."""
        return self.estimator(self, quantity)

    def table(
        self,
        interfaces: Sequence[str] | str | None = None,
        step: int | None = -1,
        about: npt.ArrayLike | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
    ) -> tables.Table:
        """As :meth:`dolfinx_frontend.Result.table`, with mean, standard deviation and quantiles.

        A quadrature has no quantiles.
        """
        return tables.summarise(tables.read_samples(self).select(interfaces), step, about, quantiles)

    def bolts(
        self,
        interfaces: Sequence[str] | str | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
    ) -> tables.Table:
        """As :meth:`dolfinx_frontend.Result.bolts`, with mean, standard deviation and quantiles."""
        return tables.bolts(tables.read_samples(self).select(interfaces), quantiles)

    def save(self, path: str | Path, fields: bool = True) -> None:
        """As :meth:`dolfinx_frontend.Result.save`; fields: force and jump of every sample."""
        from dolfinx_frontend.io import saved

        saved.save_samples(path, self, tables.read_samples(self), fields)

    def _count(self) -> str:
        count = str(len(self.germs))
        return count if self.complete else f"{int(self.finished.sum())} of {count} (INTERRUPTED)"

    def __repr__(self) -> str:
        return (
            f"SampleResult({self.kind}, {self._count()} points, "
            f"{int(self.iterations[self.finished].sum())} iterations, largest estimated error "
            f"{np.max(self.error[self.finished], initial=0.0):.1e}, {sum(self.seconds.values()):.2f} s)"
        )
