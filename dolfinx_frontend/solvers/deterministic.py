"""One solve of a planned problem."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Literal

import numpy.typing as npt
from latin_core import Iteration, Options, Problem as Kernel, State

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.running import iterate
from dolfinx_frontend.plan.plan import Direction, Method, Plan, make_plan
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.solvers.support import check_support


__all__ = ["fields_of_cuts", "solve_deterministic", "start_states"]

_log = logging.getLogger(__name__)


def solve_deterministic(
    problem: Problem,
    method: Method = "auto",
    *,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    callback: Callable[[Iteration], None] | None = None,
) -> Result:
    """One solve, random parameters at their mean; arguments and errors of :func:`dolfinx_frontend.solve`."""
    plan = plan or make_plan(problem, method, active, (), direction, options, times=times)
    began = perf_counter()
    core = bridge.build(problem, plan)
    built = perf_counter()
    summary, state = iterate(problem, plan, core, plan.amplitudes, start_states(start), callback)
    seconds = {"setup": built - began, "solve": perf_counter() - built}
    cuts = fields_of_cuts(problem, core, state)
    kind = Result if plan.times is None else HistoryResult
    result = kind(problem, plan, summary, state, seconds, core, _cuts=cuts)
    if not result.converged:
        # logged as for the points of a sweep: the answer is there, with its estimated error
        _log.warning(
            "the iteration ended as %s after %d iterations (estimated error %.1e)",
            summary.status,
            summary.iterations,
            result.error,
        )
    if result.status != "interrupted":  # which is returned, whatever it is
        check_support(result)
    return result


def fields_of_cuts(problem: Problem, core: Kernel, state: State) -> dict[str, tuple[Array, Array]]:
    """Fields of the interfaces between this rank and others, which both work out together: collective."""
    return {n: core.local_fields(n, state) for n in problem.cuts if n in problem.own.interfaces}


def start_states(start: Result | State | None) -> list[State]:
    """Start states for the kernel."""
    if start is None:
        return []
    return [start.state if isinstance(start, Result) else start]
