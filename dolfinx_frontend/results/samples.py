"""Answers at points of the germs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from latin_core import Laws, SweepPoints, SweptParameter, stochastic

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, largest_of
from dolfinx_frontend.common.checks import check_kind
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.random_laws import RandomLaws, sampled_parameters
from dolfinx_frontend.results.acting import load_factors, stiffness_factors, swept_loads
from dolfinx_frontend.results.answer import AnswerKind, Block
from dolfinx_frontend.results.contact import BondValues, ContactValues
from dolfinx_frontend.results.errors import Errors, Estimator, not_measured
from dolfinx_frontend.results.moments import Accumulator
from dolfinx_frontend.results.resultant import Interest, asked
from dolfinx_frontend.results.surfaces import law_values
from dolfinx_frontend.results.sweep import PointResults
from dolfinx_frontend.results.uncertain import StochasticResult
from dolfinx_frontend.results.value import Value
from dolfinx_frontend.scene.laws import Fields
from dolfinx_frontend.scene.loads import LoadTerm
from dolfinx_frontend.uncertainty.quantities import Inputs, Kind
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import MeanStd

__all__ = ["SampleResult"]


@dataclass(frozen=True, eq=False, repr=False)
class SampleResult(Value, PointResults, StochasticResult):
    """Answers at points of the germs.

    Attributes
    ----------
    germs
        (N, L) points.
    weights
        (N,) quadrature weights, or None: all points count the same.
    sampling
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
    sampling: Kind
    points: SweepPoints
    seconds: Mapping[str, float]
    solver: Solver
    laws: Laws
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

    def joined(self, other: SampleResult) -> SampleResult:
        """The points of both in this order, all with the same weight, of sum 1."""
        germs = np.concatenate([self.germs, other.germs])
        seconds = {k: self.seconds[k] + other.seconds[k] for k in self.seconds}
        alike, points = np.full(len(germs), 1.0 / len(germs)), self.points.joined(other.points)
        return replace(self, germs=germs, weights=alike, points=points, seconds=seconds)

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
    def scatter_error(self) -> float:
        """Largest relative error of the fluctuation of a part's displacements: that of the samples, relative
        to what they scatter by."""
        return float(np.nanmax(self.points.error) / self.points.scatter)

    @property
    def probabilities(self) -> Array:
        """(N,) weights of the points, of sum 1."""
        self.check_complete()
        count = len(self.germs)
        if self.weights is None:
            return np.full(count, 1.0 / count)
        return np.asarray(self.weights / self.weights.sum(), dtype=np.float64)

    @property
    def kind(self) -> AnswerKind:
        """``"samples"``."""
        return "samples"

    @property
    def statistics(self) -> Kind:
        """``"random"``, ``"qmc"`` or ``"quadrature"``."""
        return self.sampling

    def extra_content(self, parts: Sequence[str], samples: int | None, seed: int) -> dict[str, Any]:
        """What a file has of samples beside what it has of all."""
        weights = {} if self.weights is None else {"weights": self.weights}
        return {**super().extra_content(parts, samples, seed), "germs": self.germs, **weights}

    def _contact_at(self, name: str, part: slice) -> ContactValues | BondValues | None:
        germs = self.germs[part]

        def sampled(fields: Fields) -> dict[str, Array]:
            return sampled_parameters(self.random, name, germs, fields, self.plan.steps)

        return law_values(self.problem, self.plan, name, len(germs), sampled)

    def _swept_loads(self) -> Sequence[SweptParameter]:
        random, germs = self.random, self.germs
        loads = swept_loads(self.plan, {term: random.load_values(term, germs) for term in random.loads})
        return [*loads, *stiffness_factors({part: random.factors(part, germs) for part in random.parts})]

    def _load_at(self, term: LoadTerm, part: slice) -> Array:
        return self.random.load_values(term, self.germs[part])

    def load_number(self, load: str, parameter: str) -> Array:
        """Mean ([T]) of what a shape of a load of a part is multiplied with."""
        of = partial(self._load_at, part=slice(None))
        number: Array = self.probabilities @ load_factors(self.problem, self.times, load, parameter, of)
        return number

    def _block(self, part: slice, states: Array | None = None) -> Block:
        weights = None if self.weights is None else self.weights[part]
        return replace(super()._block(part, states), germs=self.germs[part], weights=weights)

    def inputs(self, number: Callable[[Block], Array], germs: Array) -> Inputs:
        """The germs: nothing more is known than the values."""
        return Inputs(self.space, germs, largest_of(np.ravel(self.error)))

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The samples, some at a time."""
        self.check_complete()
        yield from super().blocks()

    def unknowns(self, part: str) -> Array:
        """Mean ([T,] n) of the unknowns of a part, length."""
        return self._displacement_moments(part)[0]

    def deviation(self, part: str) -> Array:
        """Standard deviation ([T,] n) of the unknowns of a part, length."""
        return self._displacement_moments(part)[1]

    def _displacement_moments(self, part: str) -> tuple[Array, Array]:
        self._check_part(part)
        return self._moments[part]

    @cached_property
    def _moments(self) -> dict[str, tuple[Array, Array]]:
        sums = Accumulator(self.statistics != "qmc")
        for block in self.blocks():
            sums.add({n: block.displacement(n) for n in self.problem.substructures}, block.weights)
        return {name: (read_only(m), read_only(s)) for name, (m, s) in sums.found().items()}

    def coefficients(self, basis: stochastic.ChaosBasis) -> dict[str, Array]:
        """Non-intrusive chaos: coefficients ([T,] n, P + 1) of the unknowns, projected with the weights."""
        wanted = "give the basis of a chaos, e.g. result.basis"
        check_kind("coefficients", "basis", basis, stochastic.ChaosBasis, wanted)
        probabilities = self.probabilities
        out: dict[str, Array] = {}
        first = 0
        for block in self.blocks():
            share = probabilities[first : first + len(block)]
            first += len(block)
            weighted = basis.evaluate(self.germs[first - len(block) : first]) * share[:, None]
            for name in self.problem.substructures:
                out[name] = out.get(name, 0.0) + np.moveaxis(block.displacement(name), 0, -1) @ weighted
        return out

    def mean_std(self, quantity: Interest) -> MeanStd:
        """A total force or mean jump, of a history at its end, or what a function makes of the fields;
        collective."""
        what = asked("mean_std", self.problem.interfaces, quantity)
        values = what.at_end(self, self)
        mean, std = what.statistic.value(values, self.probabilities)
        if std is not None and self.statistics == "random" and len(values) > 1:
            std *= float(np.sqrt(len(values) / (len(values) - 1.0)))  # unbiased: independent samples
        return MeanStd(mean, std)

    def errors(self, quantity: Interest = None) -> Errors:
        """As :meth:`Result.errors`; the error of the sampling from the spread over parts of it."""
        return self.estimator(self, quantity)

    def _count(self) -> str:
        count = str(len(self.germs))
        return count if self.complete else f"{int(self.finished.sum())} of {count} (INTERRUPTED)"

    def __repr__(self) -> str:
        lost = "; ".join(self.unsolved)
        worst = f"; {lost}; the worst in {self.place}" if lost else ""
        error = shown_error(largest_of(self.error[self.finished]))
        return (
            f"SampleResult({self.sampling}, {self._count()} points, "
            f"{int(self.iterations[self.finished].sum())} iterations, largest estimated error "
            f"{error}{worst}, {sum(self.seconds.values()):.2f} s)"
        )
