"""Sampling: many deterministic solves at points of the germs, each warm-started from its neighbours.

A reference for chaos, and a replacement where it does not converge: Monte Carlo, quasi-Monte Carlo, tensor
and sparse quadrature are the same run over different points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import Iteration, Options, State, SweepPoints, SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_number, checked_numbers
from dolfinx_frontend.common.deferred import sp, spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.evaluate.evaluator import Design, Evaluator, Names, Spent, checkpoint_path
from dolfinx_frontend.evaluate.support import acts
from dolfinx_frontend.kernel.fitting import solver_of
from dolfinx_frontend.kernel.running import check_running
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.kernel.spread import PointRanks, agreed_over, point_ranks
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, check_settings, plan_of_random
from dolfinx_frontend.plan.price import Way
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.acting import stiffness_factors, swept_loads
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Estimator, not_measured
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.scene.loads import OF_STIFFNESS
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = [
    "problem_at",
    "sample",
    "sample_chaos",
    "sample_on",
    "sampled_values",
    "short_steps",
]

SAMPLING = Names("sampling", "sample")

STARTS = 256
"""Samples at most for which a chaos predicts a start."""


def short_steps(germs: Array) -> list[int]:
    """An order in which every point comes after a near neighbour: a walk over the spanning tree.

    The tree is that of the nearest-neighbour graph; what it does not reach follows in the given order.
    """
    count = len(germs)
    if count < 3:
        return list(range(count))
    first = int(np.argmin(np.sum(germs**2, axis=1)))
    neighbours = min(8, count - 1)
    distances, columns = spatial.cKDTree(germs).query(germs, k=neighbours + 1)
    rows = np.repeat(np.arange(count), neighbours)
    # a zero distance would be no edge
    edges = np.maximum(distances[:, 1:].ravel(), 1e-300)
    matrix = sp.csr_matrix((edges, (rows, columns[:, 1:].ravel())), shape=(count, count))
    tree = sp.csgraph.minimum_spanning_tree(matrix)
    walk = sp.csgraph.depth_first_order(tree, first, directed=False, return_predecessors=False)
    seen = np.zeros(count, dtype=bool)
    seen[walk] = True
    return [int(i) for i in walk] + [int(i) for i in np.flatnonzero(~seen)]


def sampled_values(random: RandomLaws, plan: Plan, germs: Array) -> list[SweptParameter]:
    """What is random at points (N, L) of the germs, as the kernel takes it."""
    parameters = []
    for name, parameter in random.sources:
        random.check_drawn(name, parameter, germs)
        each = random.sampled(name, parameter, germs)
        pattern, columns = each.pattern, 1
        amplitude = random.amplitude(name, parameter)
        if amplitude is not None and plan.times is not None:
            in_time = plan.column_factors(amplitude)[:, None]
            pattern = np.asarray(np.kron(in_time, pattern), dtype=np.float64)
            columns = len(in_time)
        elif plan.history == "patterns" and parameter in random.problem.interfaces[name].law.loading:
            # a random value does not change in time: it belongs to the constant load pattern
            constant = np.array([[float(a is None)] for a in plan.patterns])
            pattern, columns = np.kron(constant, pattern), len(constant)
        parameters.append(SweptParameter(name, each.name, np.asfortranarray(pattern), each.values, columns))
    parameters += stiffness_factors({part: random.factors(part, germs) for part in random.parts})
    return [*parameters, *swept_loads(plan, {term: random.load_values(term, germs) for term in random.loads})]


@together("sample")
def sample(
    problem: Problem,
    germs: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    kind: Kind = "random",
    *,
    method: Method = "auto",
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    times: npt.ArrayLike | None = None,
    keep_states: bool = False,
    checkpoint: str | Path | None = None,
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    points_comm: Any = None,
    estimator: Estimator = not_measured,
) -> SampleResult:
    """As :func:`dolfinx_frontend.sample`, which has the parameters."""
    settings: dict[str, Any] = {"active": active, "direction": direction, "options": options, "times": times}
    check_problem("sampling", problem, plan)
    check_settings("sampling", plan, method, **settings)
    check_running("sampling", callback, progress, keep_states=keep_states)
    checkpoint_path("sampling", checkpoint)
    random = RandomLaws.of(problem)
    if not random.every:
        raise SceneError("sampling: nothing is random: give a law or a load a random parameter")
    _checked_rule(random, germs, weights, kind)
    problem.check_alike("sampling", laws=True, method=method, plan=plan is None, **settings)
    ranks = point_ranks("sampling", problem, points_comm)
    if ranks is not None:
        told = {"plan": plan is None, "checkpoint": checkpoint is None}
        ranks.check_alike("sampling", germs=germs, weights=weights, method=method, **told, **settings)
    with agreed_over(ranks):
        plan = plan_of_random(
            "sampling",
            random,
            plan,
            Way(points=len(np.atleast_1d(germs))),
            method=method,
            active=active,
            direction=direction,
            options=options,
            times=times,
        )
        began = perf_counter()
        solver = solver_of(problem, plan)
    return sample_on(
        solver, random, plan, germs, weights, kind,
        keep_states=keep_states, checkpoint=checkpoint, progress=progress, setup=perf_counter() - began,
        callback=callback, estimator=estimator, ranks=ranks, checked=True,
    )  # fmt: skip


@together("sample")
def sample_chaos(
    result: ChaosResult,
    germs: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    kind: Kind = "random",
    *,
    keep_states: bool = False,
    progress: bool = False,
    rtol: float | None = None,
) -> SampleResult:
    """As :meth:`ChaosResult.sample`, which calls it."""
    points = result.space.checked_points(germs, "sampling")
    every = -(-len(points) // STARTS)
    psi = result.basis.evaluate(points[::every])
    columns = np.kron(psi.T, np.eye(result.steps))  # modes to one point's time steps each
    start = {
        every * i: State(
            np.asfortranarray(result.state.data @ one), np.asfortranarray(result.state.traces @ one)
        )
        for i, one in enumerate(np.split(columns, len(psi), axis=1))
    }
    plan = result.plan
    if rtol is not None:
        checked_number("sampling", "rtol", rtol, above=0.0, below=1.0)
        plan = replace(plan, options=plan.options.with_(rtol=rtol))
    return sample_on(
        result.solver,
        result.random,
        plan,
        points,
        weights,
        kind,
        keep_states=keep_states,
        progress=progress,
        start=start,
        estimator=result.estimator,
    )


@together("sample")
def sample_on(
    solver: Solver,
    random: RandomLaws,
    plan: Plan,
    germs: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    kind: Kind = "random",
    *,
    keep_states: bool = False,
    checkpoint: str | Path | None = None,
    progress: bool = False,
    callback: Callable[[Iteration], None] | None = None,
    start: Mapping[int, State] | None = None,
    setup: float = 0.0,
    estimator: Estimator = not_measured,
    scatter: bool = True,
    told: Literal["all", "failed", "none"] = "all",
    checked: bool = False,
    ranks: PointRanks | None = None,
) -> SampleResult:
    """As :func:`sample`, on a solver that is factorised already.

    Parameters
    ----------
    start
        Guesses of the states of some points.
    setup
        Seconds that the solver took.
    scatter
        Hold the tolerance by what every part scatters by, too, however little that is.
    told, checked
        As of :meth:`Evaluator.answers`.
    ranks
        That solve the points together.
    """
    problem = random.problem
    check_running("sampling", callback, progress, keep_states=keep_states)
    points, of_rule = _checked_rule(random, germs, weights, kind)
    file = checkpoint_path("sampling", checkpoint)
    problem.check_alike(
        "sample",
        germs=germs,
        weights=weights,
        kind=kind,
        rtol=plan.options.rtol,
        states=keep_states,
        checkpoint=file is not None,
    )
    with agreed_over(ranks), agreement(problem.comm):
        parameters = sampled_values(random, plan, points)
    evaluator = Evaluator(SAMPLING, problem, plan, solver=solver, ranks=ranks)

    def answer(swept: SweepPoints, spent: Spent) -> SampleResult:
        return SampleResult(
            problem,
            plan,
            random,
            points,
            of_rule,
            kind,
            swept,
            {"setup": setup, "solve": spent.every},
            evaluator.solver,
            evaluator.solver.laws,
            estimator=estimator,
        )

    acting = acts(problem, {name for name, _ in random.sources}, random.loads)
    result = evaluator.answers(
        Design(parameters, short_steps(points), lambda point: problem_at(random, points[point]), acting),
        answer,
        options=plan.options.with_(scatter=scatter),
        checkpoint=file,
        facts={},
        told=told,
        progress=progress,
        callback=callback,
        checked=checked,
        keep_states=keep_states,
        start=start,
    )
    if ranks is not None:
        ranks.close()
    return result


def problem_at(random: RandomLaws, germs: Array) -> Problem:
    """The problem at a point (L,) of the germs, with laws and loads that are no more random."""
    loads: dict[str, Any] = {}
    for term in random.loads:
        if term.load != OF_STIFFNESS:  # what follows a stiffness is balanced in its part
            value: Any = float(random.load_values(term, germs[None])[0])
            value = value if term.amplitude is None else term.amplitude * value
            name = f"{term.load}.{term.parameter}"
            loads[name] = loads[name] + value if name in loads else value
    return random.problem.with_laws(random.at(germs), loads)


def _checked_rule(
    random: RandomLaws, germs: npt.ArrayLike, weights: npt.ArrayLike | None, kind: Kind
) -> tuple[Array, Array | None]:
    """Copies of the points (N, L) of the germs and their weights (N,), which fit each other and the kind."""
    points = frozen(random.space.checked_points(germs, "sampling"))
    if not len(points):
        raise SceneError("sampling: germs = []: give one point at least")
    check_known("kind", kind, ("random", "qmc", "quadrature"), "sampling")
    of_rule = None
    if weights is not None:
        of_rule = frozen(checked_numbers("sampling", "weights", weights, "give one finite number per point"))
        if of_rule.shape != (len(points),):
            raise SceneError(f"sampling: weights of shape {of_rule.shape} for {len(points)} points; one each")
    if (of_rule is None) == (kind == "quadrature"):
        raise SceneError(
            f"sampling: kind = {kind!r} {'without' if of_rule is None else 'with'} weights; a quadrature has "
            "weights, samples have none"
        )
    return points, of_rule


def frozen(values: Array) -> Array:
    """A copy that cannot be written."""
    return read_only(values.copy())
