"""Sampling: many deterministic solves at points of the germs, each warm-started from its neighbours.

The comparison for chaos, and the way out where it does not converge: Monte Carlo, quasi-Monte Carlo,
tensor and sparse quadrature are the same run over different points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from latin_core import Options, State, SweepPoints, SweptParameter, stochastic
from latin_core import Problem as Kernel
from latin_core import sweep as kernel_sweep
from scipy.sparse.csgraph import depth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.fingerprint import fingerprint
from dolfinx_frontend.kernel.running import Interrupt, report_points
from dolfinx_frontend.plan.plan import Plan, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.results.surfaces import Moments
from dolfinx_frontend.results.uncertain import StochasticResult, one_number_a_sample, timed
from dolfinx_frontend.solvers.sweep import PointResults, warn_unconverged
from dolfinx_frontend.uncertainty.quantities import Quantity
from dolfinx_frontend.uncertainty.space import RandomSpace

if TYPE_CHECKING:
    from dolfinx_frontend.estimate.errors import Errors

__all__ = [
    "SampleFields",
    "SampleResult",
    "monte_carlo",
    "quasi_monte_carlo",
    "sample",
    "sample_on",
    "sparse_quadrature",
    "tensor_quadrature",
]

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


@dataclass
class SampleResult(PointResults, StochasticResult):
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
    """

    problem: Problem
    plan: Plan
    random: RandomLaws = field(repr=False)
    germs: Array = field(repr=False)
    weights: Array | None = field(repr=False)
    kind: Kind
    points: SweepPoints = field(repr=False)
    seconds: dict[str, float]
    core: Any = field(repr=False)
    _moments: dict[str, tuple[Array, Array]] | None = field(default=None, repr=False)
    _errors: Errors | None = field(default=None, repr=False)

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
            fields = self.core.displacements(state, amplitudes)
            yield part, {
                name: timed(self.plan, values.reshape(len(values), len(states), -1))
                for name, values in fields.items()
            }

    def field_moments(self, substructure: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] n) of the unknowns of a substructure, length."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "samples")
        if self._moments is None:
            self.check_complete()
            moments = Moments()
            for part, fields in self.displacements():
                samples = {name: np.moveaxis(values, -1, 0) for name, values in fields.items()}
                moments.add(samples, None if self.weights is None else self.weights[part])
            self._moments = moments.found()
        return self._moments[substructure]

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
        from dolfinx_frontend.estimate.errors import errors  # which builds on this module

        return errors(self, quantity)

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


def _short_steps(germs: Array) -> list[int]:
    """An order in which every point comes after a near neighbour: a walk over the spanning tree.

    The tree is that of the nearest-neighbour graph; what it does not reach follows in the given order.
    """
    count = len(germs)
    if count < 3:
        return list(range(count))
    first = int(np.argmin(np.sum(germs**2, axis=1)))
    neighbours = min(8, count - 1)
    distances, columns = cKDTree(germs).query(germs, k=neighbours + 1)
    rows = np.repeat(np.arange(count), neighbours)
    # a zero distance would be no edge
    edges = np.maximum(distances[:, 1:].ravel(), 1e-300)
    matrix = sp.csr_matrix((edges, (rows, columns[:, 1:].ravel())), shape=(count, count))
    tree = minimum_spanning_tree(matrix)
    walk = depth_first_order(tree, first, directed=False, return_predecessors=False)
    seen = np.zeros(count, dtype=bool)
    seen[walk] = True
    return [int(i) for i in walk] + [int(i) for i in np.flatnonzero(~seen)]


def _swept(random: RandomLaws, plan: Plan, germs: Array) -> list[SweptParameter]:
    parameters = []
    for name, parameter in random.sources:
        each = random.sampled(name, parameter, germs)
        pattern, columns = each.pattern, 1
        if plan.history == "patterns" and parameter in random.problem.interfaces[name].law.loading:
            # a random value does not change in time: it belongs to the constant load pattern
            constant = np.array([[float(a is None)] for a in plan.patterns])
            pattern, columns = np.kron(constant, pattern), len(constant)
        parameters.append(
            SweptParameter(name, each.name, np.asfortranarray(pattern), each.values, columns)
        )
    return parameters


def sample(
    problem: Problem,
    germs: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    kind: Kind = "random",
    *,
    plan: Plan | None = None,
    plan_options: Options | None = None,
    times: npt.ArrayLike | None = None,
    keep_states: bool = False,
    checkpoint: str | Path | None = None,
    progress: bool = True,
) -> SampleResult:
    """Solve at given points of the germs.

    Parameters
    ----------
    germs
        (N, L) points.
    weights
        (N,) quadrature weights; None: equal.
    plan, plan_options
        A plan, or the settings for one.
    times
        Times (T,) of a load history; random values do not change in it.
    keep_states
        Keep the interface states, from which displacements can be recovered.
    checkpoint
        As for :func:`dolfinx_frontend.sweep`.
    progress
        A progress bar if on a terminal.

    Raises
    ------
    KeyboardInterrupt
        At a second Ctrl-C. The first one returns the points that are finished, ``complete`` is False then.
    SceneError
        Nothing is random, or a sample is no admissible law (a negative stiffness).
    """
    random = RandomLaws.of(problem)
    if not random.sources:
        raise SceneError("sampling: nothing is random: give a law a random parameter")
    if plan is None:
        plan = make_plan(problem, "auto", None, random.interfaces, None, plan_options, times=times)
    began = perf_counter()
    core = bridge.build(problem, plan)
    built = perf_counter()
    result = sample_on(
        core,
        random,
        plan,
        np.atleast_2d(np.asarray(germs, dtype=np.float64)),
        None if weights is None else np.asarray(weights, dtype=np.float64),
        kind,
        keep_states=keep_states,
        checkpoint=checkpoint,
        progress=progress,
    )
    result.seconds["setup"] = built - began
    return result


def sample_on(
    core: Kernel,
    random: RandomLaws,
    plan: Plan,
    points: Array,
    weights: Array | None = None,
    kind: Kind = "random",
    *,
    keep_states: bool = False,
    checkpoint: str | Path | None = None,
    progress: bool = False,
    start: Mapping[int, State] | None = None,
) -> SampleResult:
    """As :func:`sample`, on a kernel problem that is factorised already and has its deterministic laws.

    Parameters
    ----------
    start
        Guesses of the states of some points.
    """
    problem = random.problem
    if points.shape[1] != random.space.dimension:
        raise SceneError(
            f"sampling: points of {points.shape[1]} germs, the problem has "
            f"{random.space.dimension}: {', '.join(random.space.germ_names)}"
        )
    if weights is not None and weights.shape != (len(points),):
        raise SceneError(f"sampling: weights of shape {weights.shape} for {len(points)} points; one each")
    if not np.all(np.isfinite(points)):
        raise SceneError("sampling: points of the germs are finite numbers")
    parameters = _swept(random, plan, points)
    header = None
    if checkpoint is not None:
        problem.on_one_rank("a checkpoint")
        header = {
            "fingerprint": fingerprint(problem, plan, parameters),
            "criterion": plan.options.criterion,
            "rtol": plan.options.rtol,
        }
    iterations = 0
    shown = progress and problem.rank == 0

    def done(point: int, summary: Any) -> None:
        nonlocal iterations
        iterations += summary.iterations
        warn_unconverged("sample", point, summary)
        bar.step(iterations=iterations)

    began = perf_counter()
    with Interrupt() as interrupt, Bar(len(points), "samples", "point", shown, stays=True) as bar:
        swept = kernel_sweep(
            core,
            plan.amplitudes,
            parameters,
            _short_steps(points),
            [name for name in plan.active if name in problem.own.interfaces],
            plan.options,
            checkpoint,
            header,
            done,
            interrupt.watch(),
            keep_states=keep_states,
            start=start,
        )
    report_points("sampling", interrupt, swept, checkpoint)
    seconds = {"setup": 0.0, "solve": perf_counter() - began}
    return SampleResult(problem, plan, random, points, weights, kind, swept, seconds, core)


def monte_carlo(problem: Problem, samples: int, seed: int = 0, **settings: Any) -> SampleResult:
    """Monte Carlo with `samples` independent points; `settings` as for :func:`sample`."""
    space = RandomLaws.of(problem).space
    return sample(problem, space.sample(samples, seed), kind="random", **settings)


def quasi_monte_carlo(
    problem: Problem, samples: int, seed: int = 0, **settings: Any
) -> SampleResult:
    """Scrambled Sobol points, a power of two of them; `settings` as for :func:`sample`."""
    space = RandomLaws.of(problem).space
    return sample(problem, space.sample_sobol(samples, seed), kind="qmc", **settings)


def tensor_quadrature(problem: Problem, points: int, **settings: Any) -> SampleResult:
    """Tensor Gauss rule with `points` in each germ; `settings` as for :func:`sample`."""
    rule = RandomLaws.of(problem).space.tensor_gauss(points)
    return sample(problem, rule.points, rule.weights, "quadrature", **settings)


def sparse_quadrature(problem: Problem, level: int, **settings: Any) -> SampleResult:
    """Smolyak rule, exact for total degree 2 level + 1; `settings` as for :func:`sample`."""
    rule = RandomLaws.of(problem).space.sparse_gauss(level)
    return sample(problem, rule.points, rule.weights, "quadrature", **settings)
