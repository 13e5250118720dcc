"""The bolted vessel: LATIN against one monolithic Cholesky solution, from the assembled matrices.

``./run bench vessel --json FILE`` writes

* ``dof`` unknowns of all parts, ``unit_s`` seconds of one analysis, factorisation and solve of the
  assembled structure by the faster of PETSc's Cholesky solvers (``unit_solver``);
* ``latin_plain`` (iteration of 2004, all interfaces), ``latin_all`` (accelerated, all interfaces),
  ``latin`` (accelerated, joint and screw only) and ``direct`` (what the plan chooses):
  ``iterations``, ``seconds``, ``units`` = seconds / unit_s, ``energy_error`` against the monolithic
  solution, ``error_estimate``, ``criterion`` and ``rtol`` at which it stopped. The seconds begin
  with the matrices of the parts and end with all displacements: they include elimination,
  factorisation and condensation;
* ``sweep``, ``sweep_plain``: 13 x 7 parameter sets, ``seconds`` from the matrices to the interface
  fields of all; ``max_energy_error`` at a sample of points that are also solved directly.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import common
import numpy as np

from dolfinx_frontend import (
    Options,
    Plan,
    Problem,
    Result,
    SweepResult,
    assemble,
    bridge,
    make_plan,
    reference,
    solve,
    sweep,
)
from latin_core import State, SweptParameter, snake_order
from latin_core import sweep as kernel_sweep

RTOL = 1e-4
SWEEP_RTOL = 1e-6
PLAIN_SWEEP_RTOL = 1e-5


def solved(problem: Problem, plan: Plan) -> Result:
    """From the matrices to the displacements of all parts."""
    result = solve(problem, plan=plan)
    result.displacements  # noqa: B018  interior fields are computed when asked for
    return result


def one_solve(
    problem: Problem,
    plan: Plan,
    exact: reference.ReferenceSolution,
    unit: reference.Unit,
    repeats: int,
) -> dict[str, Any]:
    """Time and accuracy of one way to solve the mean parameters."""
    run = common.timed(lambda: solved(problem, plan), repeats)
    result = run.value
    return {
        "iterations": result.iterations,
        "seconds": run.seconds,
        "units": run.seconds / unit.seconds,
        "energy_error": reference.energy_error(problem, result.displacements, exact),
        "error_estimate": result.error,
        "status": result.status,
        "criterion": plan.options.criterion if plan.active else "none",
        "rtol": plan.options.rtol if plan.active else 0.0,
        "interfaces": len(plan.active),
        "repeats": run.repeats,
    }


def sweep_energy_errors(vessel: Any, problem: Problem, surface: SweepResult) -> list[float]:
    """Energy errors at a sample of points, from the states that the same sweep leaves again."""
    plan = surface.plan
    xi = (vessel.XI_SCREW, vessel.XI_JOINT)
    core = bridge.build(problem, plan)
    mesh = np.meshgrid(*surface.axes.values(), indexing="ij")
    swept = []
    for names, values in zip(vessel.stiffnesses(*xi), mesh, strict=True):
        for name in names:
            interface, parameter = name.split(".")
            kernel_name, pattern = bridge.kernel_parameter(problem.interfaces[interface], parameter)
            swept.append(SweptParameter(interface, kernel_name, pattern, values.reshape(1, -1)))
    order = snake_order([len(values) for values in xi])
    points = kernel_sweep(
        core, np.ones((1, 1)), swept, order, plan.active, plan.options, keep_states=True
    )
    assert points.states is not None
    assert np.array_equal(points.iterations, surface.points.iterations), "not repeatable"
    solver = reference.Monolithic(problem)
    errors = []
    for i, j in vessel.sample(xi):
        values = vessel.parameters(xi[0][i], xi[1][j])
        data, traces = points.states[np.ravel_multi_index((i, j), surface.shape)]
        fields = core.displacements(State(data[:, None], traces[:, None]), np.ones((1, 1)))
        u = {name: fields[name][:, 0] for name in problem.substructures}
        exact = solver.solve(values=values)
        errors.append(reference.energy_error(problem, u, exact, values=values))
    return errors


def one_sweep(
    vessel: Any, problem: Problem, plan: Plan, unit: reference.Unit, repeats: int
) -> dict[str, Any]:
    """Time and accuracy of a sweep over 13 x 7 parameter sets."""
    grid = vessel.stiffnesses(vessel.XI_SCREW, vessel.XI_JOINT)
    run = common.timed(lambda: sweep(problem, grid, plan=plan, progress=False), repeats)
    points = run.value.points
    counts = points.iterations[points.order]
    errors = sweep_energy_errors(vessel, problem, run.value)
    return {
        "points": len(counts),
        "iterations_first": int(counts[0]),
        "iterations_rest": int(counts[1:].sum()),
        "iterations_median": float(np.median(counts[1:])),
        "seconds": run.seconds,
        "units": run.seconds / unit.seconds,
        "max_energy_error": max(errors),
        "sample": len(errors),
        "converged": int(run.value.converged.sum()),
        "criterion": plan.options.criterion,
        "rtol": plan.options.rtol,
        "repeats": run.repeats,
    }


def report(record: Mapping[str, Any]) -> None:
    """The record as tables."""
    print(
        f"{record['dof']} unknowns ({record['unit_dof']} assembled). Unit: "
        f"{record['unit_s']:.3f} s, {record['unit_solver'].upper()}, the faster of\nPETSc's "
        f"Cholesky solvers; {record['environment']['threads']} thread(s)\n"
    )
    names = ("direct", "latin_plain", "latin_all", "latin")
    rows = [record[name] for name in names]
    common.table(
        ["", "interfaces", "iterations", "seconds", "units", "energy error", "stopped at"],
        [
            [
                name,
                row["interfaces"],
                row["iterations"],
                f"{row['seconds']:.3f}",
                f"{row['units']:.2f}",
                f"{row['energy_error']:.1e}",
                f"{row['criterion']} {row['rtol']:.0e}" if row["interfaces"] else "-",
            ]
            for name, row in zip(names, rows)
        ],
    )
    print()
    common.table(
        ["", "points", "first", "others", "median", "seconds", "units", "max error", "stopped at"],
        [
            [
                name,
                row["points"],
                row["iterations_first"],
                row["iterations_rest"],
                f"{row['iterations_median']:.0f}",
                f"{row['seconds']:.2f}",
                f"{row['units']:.2f}",
                f"{row['max_energy_error']:.1e}",
                f"{row['criterion']} {row['rtol']:.0e}",
            ]
            for name, row in ((n, record[n]) for n in ("sweep_plain", "sweep") if n in record)
        ],
    )


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("vessel", "The bolted vessel: LATIN against one monolithic solution.")
    parser.add_argument("--size", type=common.size, default="paper", help="coarse, paper or mm")
    parser.add_argument("--no-plain-sweep", action="store_true", help="leave out the slow sweep")
    options = parser.parse_args()

    vessel = common.demo("bolted_vessel")
    _, scene = vessel.build_scene(options.size)
    problem = assemble(scene)
    unit = common.unit(problem, options.repeats)
    exact = reference.monolithic(problem, solver=unit.solver)
    record: dict[str, Any] = {
        "benchmark": "vessel",
        "size": options.size,
        "dof": problem.size,
        "unit_dof": unit.dof,
        "unit_s": unit.seconds,
        "unit_solver": unit.solver,
        "environment": common.environment(),
    }
    keep_all = vessel.KEEP_ALL.with_(rtol=RTOL)
    plans = {
        "direct": make_plan(problem),
        "latin": make_plan(problem, "accelerated", options=Options(rtol=RTOL)),
        "latin_all": make_plan(problem, active="all", options=keep_all),
        "latin_plain": make_plan(problem, "latin", options=vessel.PLAIN.with_(rtol=RTOL)),
    }
    for name, plan in plans.items():
        record[name] = one_solve(problem, plan, exact, unit, options.repeats)
        if name == "latin_plain":
            result = solve(
                problem,
                "latin",
                options=vessel.PLAIN.with_(rtol=PLAIN_SWEEP_RTOL, criterion="indicator"),
            )
            record[name]["indicator_1e-5"] = {
                "iterations": result.iterations,
                "energy_error": reference.energy_error(problem, result.displacements, exact),
            }
    grid = vessel.stiffnesses(vessel.XI_SCREW, vessel.XI_JOINT)
    interfaces = {name.split(".")[0] for names in grid for name in names}
    plan = make_plan(problem, vary=interfaces, options=Options(rtol=SWEEP_RTOL))
    record["sweep"] = one_sweep(vessel, problem, plan, unit, options.repeats)
    if not options.no_plain_sweep:
        slow = vessel.PLAIN.with_(rtol=PLAIN_SWEEP_RTOL, criterion="indicator")
        plan = make_plan(problem, "latin", options=slow)
        record["sweep_plain"] = one_sweep(vessel, problem, plan, unit, 1)
    report(record)
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
