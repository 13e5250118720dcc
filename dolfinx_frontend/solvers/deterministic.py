"""Solve one planned problem: one column, or those of a load history."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import cast

from latin_core import Iteration, State

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.checks import check_kind
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.accuracy import Accuracy, accuracy_of_run
from dolfinx_frontend.results.errors import Estimator, not_measured
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.solvers.refinement import corrected
from dolfinx_frontend.solvers.support import check_support

__all__ = ["check_start", "solve_on", "solve_once", "start_states"]

_log = logging.getLogger(__name__)


def solve_once(
    problem: Problem,
    plan: Plan,
    start: Result | State | None = None,
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    estimator: Estimator = not_measured,
) -> Result:
    """Build what a plan says and run its iteration; arguments as for :func:`dolfinx_frontend.solve`."""
    began = perf_counter()
    given = start_states(start)
    solver = Solver(problem, plan)
    setup = perf_counter() - began
    check_start(given, solver, plan.columns)
    result = _run(solver, plan, given, setup, callback, progress, estimator)
    if not result.converged and problem.rank == 0:
        # logged as for the points of a sweep: the answer is there, with its estimated error
        _log.warning("the %s ended as %s", "iteration" if plan.active else "direct solution", result.ended)
    if result.status != "interrupted":  # which is returned, whatever it is
        check_support(result)
    return result


def solve_on(result: Result, rtol: float) -> Result:
    """The run of a result carried on to another tolerance, on the same factors."""
    plan = replace(result.plan, options=result.plan.options.with_(rtol=rtol))
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
) -> Result:
    began = perf_counter()
    laws = solver.laws
    summary, state = solver.run(laws, plan.options, plan.amplitudes, start, callback, progress)
    cuts = solver.fields_of_cuts(laws, state)
    checked = corrected(solver) if plan.method == "direct" else None
    if checked is not None:
        accuracy: Accuracy | None = checked.accuracy
    else:
        accuracy = accuracy_of_run(summary, plan, solver.bodies, solver.problem.comm)
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
