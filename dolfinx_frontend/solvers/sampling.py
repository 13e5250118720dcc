"""Sampling: many deterministic solves at points of the germs, each warm-started from its neighbours.

The comparison for chaos, and the way out where it does not converge: Monte Carlo, quasi-Monte Carlo,
tensor and sparse quadrature are the same run over different points.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from latin_core import Options, Problem as Kernel, State, SweptParameter, sweep as kernel_sweep
from scipy.sparse.csgraph import depth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.running import Interrupt, report_points
from dolfinx_frontend.plan.plan import Plan, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.uncertainty.quantities import Kind
from dolfinx_frontend.solvers.sweep import fingerprint, warn_unconverged

__all__ = [
    "monte_carlo",
    "quasi_monte_carlo",
    "sample",
    "sample_on",
    "sparse_quadrature",
    "tensor_quadrature",
]


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
