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
  fields of all; ``max_energy_error`` at a sample of points that are also solved directly;
* both stiffnesses normal, chaos of order 3: ``latin_pce`` (as planned), ``latin_pce_plain``
  (iteration of 2004) and ``ssfem_cg`` (monolithic, conjugate gradients on the mean block):
  ``unknowns``, ``iterations``, ``seconds``, ``units``, and the energy error of all coefficients against
  SSFEM converged to 1e-12 (``error_vs_ssfem``, ``error``). The seconds end with the coefficients of all
  displacements. ``latin_pce`` has the error of the truncation too;
* ``field``: the same stiffnesses, and the modulus of the cylinder a lognormal random field, chaos of order 2:
  ``latin_pce`` and ``ssfem_cg`` with the same numbers, and what the modes of the field lose of its variance;
* ``quadrature``: 4 x 4 warm-started solves; errors of mean and deviation of the largest normal
  stress on the joint against those of the chaos, by a 60 x 60 rule, relative to the deviation;
* ``monte_carlo``: warm-started samples; ``half_width`` of the 95 % interval of P(traction) reached;
* ``end_to_end``: seconds that a person waits for: ``import_s`` (of the package), ``mesh_s``, ``assemble_s``,
  ``solve_s`` (the chaos, with the factorisation) and ``probability_s`` (of 100 000 samples of the largest
  normal stress);
* ``p_traction``: probability of a positive largest stress by method, with its 95 % interval.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import common
import numpy as np

from dolfinx_frontend import (
    Chaos,
    ChaosResult,
    Options,
    Plan,
    Problem,
    Quantity,
    RandomField,
    Result,
    SampleResult,
    SweepResult,
    assemble,
    make_plan,
    monte_carlo,
    reference,
    solve,
    sweep,
    tensor_quadrature,
)
from parts.unit import Unit

RTOL = 1e-4
SWEEP_RTOL = 1e-6
PLAIN_SWEEP_RTOL = 1e-5
SAMPLES_RTOL = 1e-6
SAMPLES = 100_000
"""Of the chaos, for a probability."""


def solved(problem: Problem, plan: Plan) -> Result:
    """From the matrices to the displacements of all parts."""
    result = solve(problem, plan=plan)
    result.displacements  # noqa: B018  interior fields are computed when asked for
    return result


def one_solve(
    problem: Problem,
    plan: Plan,
    exact: reference.ReferenceSolution,
    unit: Unit,
    repeats: int,
) -> dict[str, Any]:
    """Time and accuracy of one way to solve the mean parameters."""
    run = common.timed(lambda: solved(problem, plan), repeats)
    result = run.value
    return {
        "iterations": result.iterations,
        "seconds": run.seconds,
        "units": run.seconds / unit.seconds,
        "energy_error": reference.energy_error(problem, result.displacements, exact.u),
        "error_estimate": result.error,
        "status": result.status,
        "criterion": plan.options.criterion if plan.active else "none",
        "rtol": plan.options.rtol if plan.active else 0.0,
        "interfaces": len(plan.active),
        "repeats": run.repeats,
    }


def sweep_energy_errors(
    vessel: Any, problem: Problem, grid: Mapping[Any, Any], surface: SweepResult
) -> list[float]:
    """Energy errors at a sample of points, from the states that the same sweep leaves again."""
    xi = (vessel.XI_SCREW, vessel.XI_JOINT)
    again = sweep(problem, grid, plan=surface.plan, progress=False, keep_states=True)
    assert np.array_equal(again.iterations, surface.iterations), "not repeatable"
    solver = reference.Monolithic(problem)
    errors = []
    for i, j in vessel.sample(xi):
        values = vessel.parameters(xi[0][i], xi[1][j])
        exact = solver.solve(values=values)
        u = again.point(i, j).displacements
        errors.append(reference.energy_error(problem, u, exact.u, values=values))
    return errors


def one_sweep(
    vessel: Any, problem: Problem, plan: Plan, unit: Unit, repeats: int
) -> tuple[dict[str, Any], SweepResult]:
    """Time and accuracy of a sweep over 13 x 7 parameter sets, and its answer."""
    grid = vessel.stiffnesses(vessel.XI_SCREW, vessel.XI_JOINT)
    run = common.timed(lambda: sweep(problem, grid, plan=plan, progress=False), repeats)
    points = run.value.points
    counts = points.iterations[points.order]
    errors = sweep_energy_errors(vessel, problem, grid, run.value)
    record = {
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
    return record, run.value


def uncertain_part(
    vessel: Any,
    problem: Problem,
    surface: Quantity,
    unit: Unit,
    repeats: int,
    samples: int,
    plain: bool,
) -> dict[str, Any]:
    """Time and accuracy of the random problem by every method; `surface`: from the sweep."""
    order = Chaos(vessel.ORDER)
    sampling = Options(rtol=SAMPLES_RTOL)

    def chaos(**settings: Any) -> ChaosResult:
        result = solve(problem, chaos=order, **settings)
        vessel.all_modes(result)
        return result

    def measured(call: Callable[[], Any], times: int = repeats) -> tuple[dict[str, Any], Any]:
        run = common.timed(call, times)
        cost = {"seconds": run.seconds, "units": run.seconds / unit.seconds, "repeats": run.repeats}
        return cost, run.value

    exact = reference.ssfem(problem, order, rtol=1e-12)

    def pce(cost: dict[str, Any], result: ChaosResult) -> dict[str, Any]:
        error = reference.energy_error(problem, vessel.all_modes(result), exact.coefficients)
        return {
            "modes": result.modes,
            "unknowns": result.modes * problem.size,
            "iterations": result.iterations,
            **cost,
            "error_vs_ssfem": error,
            "error_estimate": result.error,
            "status": result.status,
            "criterion": result.plan.options.criterion,
            "rtol": result.plan.options.rtol,
            "interfaces": len(result.plan.active),
        }

    def points(cost: dict[str, Any], result: SampleResult) -> dict[str, Any]:
        return {
            "points": len(result.germs),
            "iterations": int(result.iterations.sum()),
            **cost,
            "rtol": SAMPLES_RTOL,
        }

    record: dict[str, Any] = {}
    cost, best = measured(lambda: chaos(options=Options(rtol=vessel.CHAOS_RTOL)))
    truncation = best.truncation("joint")
    record["latin_pce"] = pce(cost, best) | {
        "truncation": truncation.sample,
        "truncation_decay": truncation.decay,
    }
    if plain:
        slow = vessel.PLAIN.with_(rtol=PLAIN_SWEEP_RTOL, criterion="indicator")
        record["latin_pce_plain"] = pce(*measured(lambda: chaos(method="latin", options=slow), 1))
    cost, galerkin = measured(lambda: reference.ssfem(problem, order, rtol=vessel.CHAOS_RTOL))
    record["ssfem_cg"] = {
        "modes": len(galerkin.basis),
        "unknowns": galerkin.unknowns,
        "iterations": galerkin.iterations,
        **cost,
        "error": reference.energy_error(problem, galerkin.coefficients, exact.coefficients),
        "rtol": vessel.CHAOS_RTOL,
    }
    cost, rule = measured(
        lambda: tensor_quadrature(
            problem, vessel.ORDER + 1, options=sampling, progress=False
        )
    )
    fine = best.space.tensor_gauss(60)
    stress = Quantity(
        vessel.QUANTITY,
        "MPa",
        values=vessel.largest_stress(best.at(fine.points)),
        weights=fine.weights,
        kind="quadrature",
    )
    found, deviation = rule.quantity(vessel.largest_stress), stress.std().value
    record["quadrature"] = points(cost, rule) | {
        "error_mean": abs(found.mean().value - stress.mean().value) / deviation,
        "error_std": abs(found.std().value - deviation) / deviation,
    }
    cost, drawn = measured(
        lambda: monte_carlo(problem, samples, seed=1, options=sampling, progress=False), 1
    )
    all_of_them = vessel.Uncertain(best, None, galerkin, exact, rule, drawn, {})
    record["p_traction"] = {}
    names = ("multiresolution", "latin_pce", "ssfem_cg", "quadrature", "monte_carlo")
    stresses = vessel.answers(all_of_them, surface).values()
    for name, quantity in zip(names, stresses, strict=True):
        if quantity.weights is None:
            value, low, high, _ = quantity.probability(above=0.0)
            record["p_traction"][name] = {
                "value": value,
                "low": low,
                "high": high,
                "evaluated": len(quantity),
            }
    reached = record["p_traction"]["monte_carlo"]
    record["monte_carlo"] = points(cost, drawn) | {
        "samples": samples,
        "half_width": 0.5 * (reached["high"] - reached["low"]),
    }
    return record


def field_part(vessel: Any, problem: Problem, unit: Unit, repeats: int) -> dict[str, Any]:
    """A random field inside a part, by LATIN-PCE and by monolithic SSFEM; what both need of it is made."""
    field = RandomField("E", 200e3, cov=0.2, length=60.0, modes=2, distribution="lognormal")
    problem = problem.with_laws(values={"cylinder.E": field})
    problem.stretch("cylinder")
    order, options = Chaos(2), Options(rtol=vessel.CHAOS_RTOL)
    exact = reference.ssfem(problem, order, rtol=1e-12)

    def latin() -> tuple[ChaosResult, dict[str, Any]]:
        result = solve(problem, chaos=order, options=options)
        return result, vessel.all_modes(result)

    def cost(run: Any) -> dict[str, Any]:
        return {"seconds": run.seconds, "units": run.seconds / unit.seconds, "repeats": run.repeats}

    run = common.timed(latin, repeats)
    result, modes = run.value
    error = reference.energy_error(problem, modes, exact.coefficients)
    found: dict[str, Any] = {
        "lost_variance": result.random.lost["E"],
        "modes": result.modes,
        "latin_pce": {"iterations": result.iterations, **cost(run), "error_vs_ssfem": error},
    }
    run = common.timed(lambda: reference.ssfem(problem, order, rtol=vessel.CHAOS_RTOL), repeats)
    error = reference.energy_error(problem, run.value.coefficients, exact.coefficients)
    found["ssfem_cg"] = {"iterations": run.value.iterations, **cost(run), "error": error}
    return found


def end_to_end(vessel: Any, size: Any, repeats: int) -> dict[str, Any]:
    """Seconds that a person waits for, from the import to the probability of a leak."""
    started = [sys.executable, "-c", "import dolfinx_frontend"]
    imported = common.timed(lambda: subprocess.run(started, check=True), repeats)
    bare = common.timed(lambda: subprocess.run([sys.executable, "-c", "pass"], check=True), repeats)
    meshed = common.timed(lambda: vessel.build_scene(size), repeats)
    scene = vessel.random_scene(meshed.value[0])
    assembled = common.timed(lambda: assemble(scene), repeats)
    options = Options(rtol=vessel.CHAOS_RTOL)
    chaos = common.timed(lambda: solve(assembled.value, chaos=Chaos(vessel.ORDER), options=options), repeats)

    def probability() -> float:
        stress = chaos.value.quantity(vessel.largest_stress, samples=SAMPLES)
        return float(stress.probability(above=0.0).value)

    asked = common.timed(probability, repeats)
    return {
        "import_s": imported.seconds - bare.seconds,
        "mesh_s": meshed.seconds,
        "assemble_s": assembled.seconds,
        "solve_s": chaos.seconds,
        "probability_s": asked.seconds,
        "samples": SAMPLES,
        "probability": asked.value,
    }


def report_uncertain(record: Mapping[str, Any]) -> None:
    """The random part of the record as tables."""
    rows = []
    for name in ("latin_pce", "latin_pce_plain", "ssfem_cg", "quadrature", "monte_carlo"):
        if name not in record:
            continue
        row = record[name]
        if name == "quadrature":
            error = f"{row['error_mean']:.1e}, {row['error_std']:.1e} (mean, deviation)"
        elif name == "monte_carlo":
            error = f"P +- {100 * row['half_width']:.2f} %"
        else:
            error = f"{row.get('error_vs_ssfem', row.get('error')):.1e} (energy)"
        rows.append(
            [
                name,
                f"{row['modes']} modes" if "modes" in row else f"{row['points']} points",
                row["iterations"],
                f"{row['seconds']:.3f}",
                f"{row['units']:.2f}",
                error,
            ]
        )
    print()
    common.table(["", "solved for", "iterations", "seconds", "units", "error"], rows)
    print()
    common.table(
        ["P(traction)", "evaluated", "value", "95 % interval"],
        [
            [
                name,
                each["evaluated"],
                f"{each['value']:.4f}",
                f"{each['low']:.4f} to {each['high']:.4f}",
            ]
            for name, each in record["p_traction"].items()
        ],
    )


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
    parser.add_argument(
        "--no-plain-sweep", action="store_true", help="leave out the slow sweep and the slow chaos"
    )
    parser.add_argument("--samples", type=int, default=2000, help="Monte Carlo samples")
    options = parser.parse_args()

    vessel = common.demo("bolted_vessel")
    geometry, scene = vessel.build_scene(options.size)
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
                "energy_error": reference.energy_error(problem, result.displacements, exact.u),
            }
    grid = vessel.stiffnesses(vessel.XI_SCREW, vessel.XI_JOINT)
    interfaces = {name.split(".")[0] for names in grid for name in names}
    plan = make_plan(problem, vary=interfaces, options=Options(rtol=SWEEP_RTOL))
    record["sweep"], points = one_sweep(vessel, problem, plan, unit, options.repeats)
    if not options.no_plain_sweep:
        slow = vessel.PLAIN.with_(rtol=PLAIN_SWEEP_RTOL, criterion="indicator")
        plan = make_plan(problem, "latin", options=slow)
        record["sweep_plain"], _ = one_sweep(vessel, problem, plan, unit, 1)
    largest = points.force("joint")[..., 0].max(axis=-1)
    uncertain = assemble(vessel.random_scene(geometry))
    record |= uncertain_part(
        vessel,
        uncertain,
        vessel.from_surface((vessel.XI_SCREW, vessel.XI_JOINT), largest),
        unit,
        options.repeats,
        options.samples,
        not options.no_plain_sweep,
    )
    record["field"] = field_part(vessel, uncertain, unit, options.repeats)
    record["end_to_end"] = end_to_end(vessel, options.size, options.repeats)
    report(record)
    report_uncertain(record)
    inside = record["field"]
    print(f"\nA random field in the cylinder, {inside['modes']} modes:")
    for name in ("latin_pce", "ssfem_cg"):
        each = inside[name]
        cost = f"{each['iterations']:4d} iterations, {each['units']:6.1f} units"
        print(f"  {name:<10} {cost}, error {each.get('error', each.get('error_vs_ssfem')):.1e}")
    waited = ("import_s", "mesh_s", "assemble_s", "solve_s", "probability_s")
    print("\nA person waits: " + ", ".join(f"{n[:-2]} {record['end_to_end'][n]:.3f} s" for n in waited))
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
