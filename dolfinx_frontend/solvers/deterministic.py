"""Solve one planned problem: one column, or those of a load history."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import cast

import numpy as np
from latin_core import Iteration, NumericalError, State

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.checks import check_kind
from dolfinx_frontend.common.errors import BalanceError, SceneError
from dolfinx_frontend.common.statuses import INEXACT, NO_EQUILIBRIUM, SLIDES, STOPPED, UNDECIDED
from dolfinx_frontend.evaluate.model_limits import check_model
from dolfinx_frontend.evaluate.support import Support, check_support
from dolfinx_frontend.kernel.carry import carried
from dolfinx_frontend.kernel.fitting import SHARE, fitted
from dolfinx_frontend.kernel.running import within
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.accuracy import Accuracy, Corrected, accuracy_of_run
from dolfinx_frontend.results.errors import Estimator, not_measured
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.solvers.refinement import corrected

__all__ = ["check_start", "solve_on", "solve_once", "start_states"]

_log = logging.getLogger(__name__)


def solve_once(
    problem: Problem,
    plan: Plan,
    start: Result | State | None = None,
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    estimator: Estimator = not_measured,
    others: Iterable[Plan] = (),
    before: Result | None = None,
) -> Result:
    """Build what a plan says and run its iteration; arguments as for :func:`dolfinx_frontend.solve`.

    `before` is a result of the same scene on other meshes: parts that kept theirs keep their factors, and the
    iteration starts from its fields.

    A run that gives up is made again from nothing by the other plans, one after the other until one of them
    converges.
    """
    began = perf_counter()
    given = start_states(start)
    if plan.options.backend == "multigrid":
        solver, given = fitted(problem, plan, lambda laws: laws, plan.amplitudes, plan.columns)
    else:
        solver = Solver(problem, plan, None if before is None else before.solver)
    if before is not None and not given:
        given = carried(before.solver, before.state, solver)
    setup = perf_counter() - began
    check_start(given, solver, plan.columns)
    support = Support(problem, plan.times)
    result = _run(solver, plan, given, setup, callback, progress, estimator, support.balances)
    if result.status in _WORTH_ANOTHER and plan.active and support.balances_all():
        result = _by_another(result, others, callback, progress)
    if not result.converged and problem.rank == 0:
        # logged as for the points of a sweep: the answer is there, with its estimated error
        _log.warning("the %s ended as %s", "iteration" if plan.active else "direct solution", result.ended)
    if result.status in STOPPED:  # which is returned, whatever it is
        return result
    try:
        slips = check_support(result, support)
    except BalanceError as lost:
        if result.statuses[0] == "converged" and result.statuses[lost.step] != "converged":
            lost.answer = result
            check_model(result)
        raise
    if slips and result.status == SLIDES:
        result = result.with_notes(verdict=NO_EQUILIBRIUM)
    check_model(result)
    return result


_WORTH_ANOTHER = (UNDECIDED, INEXACT, "max_iterations")


def _by_another(
    first: Result,
    others: Iterable[Plan],
    callback: Callable[[Iteration], None] | None,
    progress: bool,
) -> Result:
    """The first answer of other plans that converges, else the one there is."""
    spent = first.seconds
    for plan in others:
        began = perf_counter()
        try:
            solver = Solver(first.problem, plan)
            setup = perf_counter() - began
            before = sum(spent.values())
            again = _run(solver, plan, (), setup, callback, progress, first.estimator, before=before)
        except (SceneError, NumericalError):
            continue  # there is an answer of some kind, and this is no way to a better one
        spent = {name: spent[name] + seconds for name, seconds in again.seconds.items()}
        if again.status in STOPPED:
            break
        if again.converged:
            if first.problem.rank == 0:
                _log.warning(
                    "the iteration ended as %s; it converged after %d iterations with %s",
                    first.ended,
                    again.iterations,
                    f"direction={plan.direction.factor:g}" if plan.direction.factor else "default settings",
                )
            return again.with_notes(seconds=spent)
    return first.with_notes(seconds=spent)


def solve_on(result: Result, rtol: float) -> Result:
    """The run of a result carried on to another tolerance, on the same factors."""
    plan = replace(result.plan, options=result.plan.options.with_(rtol=rtol))
    if result.solver.space is not None:  # the basis is as good as the answer that it was made for
        return solve_once(result.problem, plan, estimator=result.estimator)
    more = _run(result.solver, plan, [result.state], result.seconds["setup"], None, True, result.estimator)
    before = result.seconds["solve"]
    return more.with_notes(seconds={**more.seconds, "solve": before + more.seconds["solve"]})


def _run(
    solver: Solver,
    plan: Plan,
    start: Sequence[State],
    setup: float,
    callback: Callable[[Iteration], None] | None,
    progress: bool,
    estimator: Estimator,
    balanced: Callable[[int], bool] | None = None,
    before: float = 0.0,
) -> Result:
    began = perf_counter()
    laws = solver.laws
    options = within(plan.options, setup + before)
    if solver.space is not None:
        options = options.with_(rtol=(1.0 - SHARE) * options.rtol)
    summary, state = solver.run(laws, options, plan.amplitudes, start, callback, progress, balanced)
    cuts = solver.fields_of_cuts(laws, state)
    if plan.method != "direct":
        checked = None
    elif solver.space is None:
        checked = corrected(solver)
    else:
        checked = Corrected(
            Accuracy(np.array([[solver.left]]), ("",), ("all parts",)),
            solver.displacements(laws, state, plan.amplitudes),
            {},
        )
    if checked is not None:
        accuracy: Accuracy | None = checked.accuracy
    else:
        accuracy = accuracy_of_run(summary, plan, solver.bodies, solver.problem.comm, solver.left)
    seconds = {"setup": setup, "solve": perf_counter() - began}
    kind = Result if plan.times is None else HistoryResult
    return kind(
        solver.problem,
        plan,
        summary,
        state,
        seconds,
        solver,
        laws,
        cuts,
        accuracy=accuracy,
        corrected=checked,
        estimator=estimator,
        continuation=solve_on,
    )


def start_states(start: Result | State | None) -> list[State]:
    """Start states for the kernel."""
    if start is None:
        return []
    state = start if isinstance(start, State) else getattr(start, "state", None)
    wanted = "give a result of the same plan, or its state"
    if state is None:
        check_kind("solve", "start", start, State, wanted)
    check_kind("solve", "start.state", state, State, wanted)
    return [cast(State, state)]


def check_start(states: Sequence[State], solver: Solver, columns: int) -> None:
    """Refuse start states of another plan: of other rows or columns."""
    with agreement(solver.problem.comm):
        for state in states:
            if state.data.shape != (solver.rows, columns):
                raise SceneError(
                    f"solve: start has a state of shape {state.data.shape}, this plan has ({solver.rows}, "
                    f"{columns}): active interface points and columns; give a result of the same plan"
                )
