"""A vessel too large for a factor: one linear solution by every solver, and the whole random answer.

``./run bench large --unknowns N --json FILE`` meshes the bolted vessel with about N unknowns and writes

* ``unknowns``, ``unit_s``: seconds of one solution of the assembled structure by the fastest of CHOLMOD,
  MUMPS and conjugate gradients with GAMG (to a residual of 1e-6), and ``unit_solver``; ``solvers``: all of
  them, with the peak memory beyond the assembled matrix, or why there is none;
* ``pce_units``, ``pce_s``: order-3 chaos of joint and screw in units, from the matrices of the parts to the
  coefficients of all displacements, by the backend that the plan takes (``pce_backend``), to an energy error
  of ``error`` (estimated; up to 250 000 unknowns ``true_error``, against SSFEM converged to 1e-11);
* ``sweep_units``, ``sweep_s``: the 13 x 7 parameter sets, by the backend that the plan takes
  (``sweep_backend``), to an energy error of ``sweep_error`` at the worst point (estimated; up to 250 000
  unknowns ``sweep_true_error``, against factors and an iteration to 1e-9);
* ``peak_gb``: largest resident memory of the process of the chaos, with its mesh and matrices.

Every solver runs once, in a process of its own. Seconds are those of the processor, which on one thread of a
quiet machine are those of the clock (``wall_s``); on a machine that others work on they vary less. A direct
solver that is predicted to need more than ``--memory`` GB is left out, and the record says so.
"""

from __future__ import annotations

import json
from typing import Any

import common
import numpy as np
import performance
from _units import SOLVERS, of_unit, one_each, parser, solution, spent
from performance import deterministic, vessel_problem

from dolfinx_frontend import Chaos, Options, reference, solve, sweep

RTOL = 4e-5
CUBE = 1.02e7
"""Unknowns of the vessel times the cube of the size of its cells, mm^3."""


def one(method: str, size: float, rtol: float, backend: str) -> dict[str, Any]:
    """One solver on one mesh, in a process that does nothing else."""
    demo, problem = vessel_problem(str(size))
    record: dict[str, Any] = {"method": method, "unknowns": problem.size}
    chaos = Chaos(performance.ORDER, check_points=0)
    if method in SOLVERS:
        return record | spent(solution(deterministic(demo, problem), method))[1]
    if method == "pce":

        def call() -> Any:
            options = Options(rtol=rtol, backend=backend)
            result = solve(problem, chaos=chaos, options=options)
            return result, demo.all_modes(result)

    else:
        fixed = deterministic(demo, problem)
        grid = demo.stiffnesses(demo.XI_SCREW, demo.XI_JOINT)

        def call() -> Any:
            options = Options(rtol=performance.SWEEP_RTOL, backend=backend)
            return sweep(fixed, grid, options=options, progress=False, keep_states=True)

    answer, times = spent(call)
    record |= times
    if method == "pce":
        result, modes = answer
        record |= {"error": result.error, "iterations": result.iterations, "spent": result.spent()}
        record["backend"] = result.plan.options.backend
        record["setup_s"] = result.seconds["setup"]
        if result.solver.space is not None:
            record["fields"] = result.solver.space.count
        if problem.size <= performance.EXACT_UP_TO:
            exact = reference.ssfem(problem, chaos, rtol=1e-11)
            record["true_error"] = float(reference.energy_error(problem, modes, exact.coefficients))
    if method == "sweep":
        result = answer
        record |= {"error": float(result.error.max()), "iterations": int(result.points.iterations.sum())}
        record |= {"backend": result.plan.options.backend, "points": result.points.status.size}
        record["converged"] = bool(result.converged.all())
        record["price"] = str(result.plan.price)
        record["setup_s"] = result.seconds["setup"]
        if result.solver.space is not None:
            record["fields"] = result.solver.space.count
        if problem.size <= performance.EXACT_UP_TO:
            tight = Options(rtol=1e-9, backend="cholmod")
            exact = sweep(fixed, grid, options=tight, progress=False, keep_states=True)
            errors = [
                reference.energy_error(
                    fixed, result.point(*at).displacements, exact.point(*at).displacements, springs=False
                )
                for at in np.ndindex(*result.shape)
            ]
            record["true_error"] = float(max(errors))
            record["most_optimistic"] = float(np.max(np.array(errors) / result.error.ravel()))
    return record


def main() -> None:
    """Measure, print and write."""
    wanted = parser("large", __doc__, RTOL, ["pce", "sweep"])
    wanted.add_argument("--backend", default="automatic", help="of chaos and sweep")
    options = wanted.parse_args()
    if options.one:
        print(json.dumps(one(options.one, options.size, options.rtol, options.backend)))
        return
    size = f"{options.size or (CUBE / options.unknowns) ** (1.0 / 3.0):.4g}"
    record: dict[str, Any] = {"benchmark": "large", "size": size, "commit": common.commit()}
    settings = {"--size": size, "--rtol": str(options.rtol), "--backend": options.backend}
    solvers = one_each(__file__, options.only, settings, options.unknowns, options.memory)
    record |= {"solvers": solvers} | of_unit(solvers)
    done = {name: each for name, each in solvers.items() if "seconds" in each}
    for name in ("pce", "sweep"):
        seconds = done[name]["seconds"] if name in done else None
        record[f"{name}_s"] = seconds
        record[f"{name}_units"] = seconds / record["unit_s"] if "unit_s" in record and seconds else None
    if "pce" in done:
        pce = done["pce"]
        record |= {key: pce[key] for key in ("unknowns", "error", "true_error") if key in pce}
        record |= {"peak_gb": pce["whole_peak_gb"], "pce_backend": pce["backend"]}
    if "sweep" in done:
        swept = done["sweep"]
        kept = ("backend", "error", "true_error", "fields")
        record |= {f"sweep_{key}": swept[key] for key in kept if key in swept}
        record["sweep_peak_gb"] = swept["whole_peak_gb"]
    record["environment"] = common.environment()
    shown = ("unknowns", "unit_solver", "unit_s", "pce_units", "sweep_units", "peak_gb", "error")
    print(", ".join(f"{key} {record[key]}" for key in shown if key in record))
    common.write_json(record, options.json)


if __name__ == "__main__":
    main()
