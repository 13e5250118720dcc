"""Laws, loads and answers at given points, without solving."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from latin_core import Laws, State, SweepPoints, SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.acting import STIFFNESS, factors_of, with_loads
from dolfinx_frontend.results.sweep import SweepResult

__all__ = ["amplitudes_at", "answer_at", "answer_of", "is_field", "laws_at", "states_at"]


def is_field(parameter: SweptParameter) -> bool:
    """Whether it is a stiffness with a factor in each cell."""
    return parameter.parameter == STIFFNESS and len(parameter.values) > 1


def laws_at(solver: Solver, laws: Laws, parameters: Sequence[SweptParameter]) -> Laws:
    """The laws at all points side by side: their columns are those of one point after the other."""
    columns = solver.plan.amplitudes.shape[1]
    count = parameters[0].values.shape[1] if parameters else 1
    given: dict[str, dict[str, Array]] = {}
    for each in parameters:
        if not each.interface or each.parameter == STIFFNESS or each.interface not in laws.interfaces:
            continue  # no law, or one of other ranks
        at: Array = (each.pattern @ each.values).reshape(each.columns, -1, count).transpose(1, 2, 0)
        at = np.repeat(at, columns // each.columns, axis=2) if columns > 1 else at
        given.setdefault(each.interface, {})[each.parameter] = np.asfortranarray(at.reshape(len(at), -1))
    if columns > 1 and count > 1:
        for name in laws.interfaces:
            for parameter in _names_of(solver, name):
                if parameter in given.get(name, {}):
                    continue
                block = laws.parameter(name, parameter)
                if block.shape[1] > 1:
                    given.setdefault(name, {})[parameter] = np.asfortranarray(np.tile(block, (1, count)))
    factors = factors_of(solver.problem, parameters, slice(None))
    return laws.with_(parameters=given, stiffness=factors or None)


def _names_of(solver: Solver, interface: str) -> list[str]:
    """Parameters of the law of an interface in the kernel's terms."""
    problem = solver.problem
    return list(active_fields(problem.interfaces[interface], solver.plan).parameters)


def amplitudes_at(plan: Plan, parameters: Sequence[SweptParameter]) -> Array:
    """Amplitudes (loads, points * columns) of all points side by side."""
    loads = [each for each in parameters if not each.interface]
    count = parameters[0].values.shape[1] if parameters else 1
    found = with_loads(plan, loads, slice(None))
    if found.shape[1] != count * plan.amplitudes.shape[1]:
        found = np.asfortranarray(np.tile(found, (1, count)))
    return found


def answer_of(
    problem: Problem, plan: Plan, solver: Solver, points: SweepPoints, parameters: Sequence[SweptParameter]
) -> SweepResult:
    """Points that were solved, as an answer."""
    count = len(points.status)
    axes = {"point": np.arange(count, dtype=np.float64)}
    return SweepResult(problem, plan, axes, points, {}, solver, solver.laws, tuple(parameters))


def states_at(points: SweepPoints, number: int) -> State:
    """The state of a point."""
    assert points.states is not None  # they are kept
    data, traces = points.states[number]
    return State(np.asfortranarray(data), np.asfortranarray(traces))


def answer_at(
    problem: Problem,
    solver: Solver,
    laws: Laws,
    data: Array,
    traces: Array,
    parameters: Sequence[SweptParameter],
) -> SweepResult:
    """States (rows, points * columns) that were not iterated on, as an answer at these points.

    Parameters
    ----------
    laws
        Of all points side by side.
    """
    plan = solver.plan
    columns = plan.amplitudes.shape[1]
    count = data.shape[1] // columns
    own = problem.own.interfaces
    fields = {n: solver.local_fields(laws, n, State(data, traces)) for n in plan.active if n in own}

    def by_point(block: Array) -> Array:
        """(rows, points * columns) -> (points, columns, rows)."""
        return np.ascontiguousarray(block.T).reshape(count, columns, -1)

    states = np.stack([each.reshape(len(each), count, columns) for each in (data, traces)])
    points = SweepPoints.known(
        {n: by_point(force) for n, (force, _) in fields.items()},
        {n: by_point(jump) for n, (_, jump) in fields.items()},
        np.ascontiguousarray(states.transpose(2, 0, 1, 3)),
    )
    return answer_of(problem, plan, solver, points, parameters)
