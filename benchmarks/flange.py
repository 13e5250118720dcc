"""A flange of 35 parts with a million unknowns: contact, friction and preload beside one linear solution.

``./run bench flange --unknowns N --json FILE`` meshes ``demos/flange_from_step.py`` with about N unknowns
(60 000 at least). Its upper nuts rub on the flange (rigid contact), the gasket is pressed through its filler;
the bolts are tightened in one step, the pressure acts in a second one. It writes

* ``unknowns``, ``parts``, ``active_unknowns`` (on the faces that are kept);
* ``unit_s``: seconds of one solution of the assembled structure, with springs in its contacts, by the fastest
  of CHOLMOD, MUMPS and conjugate gradients with GAMG (to a residual of 1e-6), and ``unit_solver``;
  ``solvers``: all of them, with the peak memory beyond the assembled matrix, or why there is none;
* ``latin``: both steps from the matrices of the parts to all displacements: ``seconds``, ``iterations``,
  ``status``, ``error`` (estimated), ``setup_s``; up to ``--exact`` unknowns ``true_error`` in the energy
  norm, against the same iteration carried on to a thousandth of the tolerance; ``units``, its seconds in
  units;
* ``peak_gb``: largest resident memory of the process of ``latin``, with its meshes and matrices.

Every line is made in a process of its own, on one thread. Seconds are those of the processor, which on a
quiet machine are those of the clock (``wall_s``). A direct solver that is predicted to need more than
``--memory`` GB is left out, and the record says so.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import common
import numpy as np
from _units import SOLVERS, of_unit, one_each, parser, solution, spent
from scipy.optimize import brentq

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    Options,
    Perfect,
    Preload,
    Problem,
    assemble,
    reference,
    solve,
)

RTOL = 1e-4
FRICTION = 0.12
NUTS = "upper flange|upper nut *"
COARSE, FINER = 24.0, 14.0
"""Cells of the meshes that tell how unknowns grow, mm."""
TIMES = (1.0, 2.0)


def flange(size: float) -> Problem:
    """The flange of the demo with nuts that rub, and a preload that is reached at once."""
    demo = common.demo("flange_from_step")
    shape = demo.FlangeShape()
    with tempfile.TemporaryDirectory() as folder:
        step = demo.read(demo.make_flange(Path(folder) / "flange.step", shape), shape, size)
        step.join(NUTS, Contact(friction=FRICTION))
        problem = assemble(demo.loaded(step, step.mesh(), shape, Amplitude(TIMES, [0.0, 1.0])))
    return problem.with_laws({name: Preload(demo.FORCE, until=TIMES[0]) for name in demo.BOLTS})


def size_for(unknowns: float) -> float:
    """Size of cells, mm, for about so many unknowns.

    Bolts and fillets have some however coarse the rest is, faces as many as 1 / size^2, volumes 1 / size^3:
    two coarse meshes tell the first, and the sum of the others at a power between.
    """
    counts = [flange(size).size for size in (COARSE, FINER)]
    power = 2.75
    growth = (counts[1] - counts[0]) / (FINER**-power - COARSE**-power)
    least = counts[0] - growth * COARSE**-power
    if unknowns < 1.05 * least:
        raise SystemExit(f"flange: --unknowns {unknowns:g}: give {1.05 * least:.0f} or more")
    return float(brentq(lambda size: least + growth * size**-power - unknowns, 1.0, 100.0))


def linear(problem: Problem) -> Problem:
    """Springs for the contacts, closed sections for the preloads: what a linear solver would solve."""
    laws = {name: each.law.at(TIMES[-1]) for name, each in problem.interfaces.items()}
    springs = Elastic(normal=1e4, tangential=1e4)
    for name, law in laws.items():
        if isinstance(law, (Contact, Preload)):
            laws[name] = springs if isinstance(law, Contact) else Perfect()
    return problem.with_laws(laws)


def one(method: str, size: float, options: Options, exact_up_to: float) -> dict[str, Any]:
    """One line."""
    problem = flange(size)
    record: dict[str, Any] = {"method": method, "unknowns": problem.size, "parts": len(problem.substructures)}
    if method in SOLVERS:
        return record | spent(solution(linear(problem), method))[1]

    def call() -> Any:
        result = solve(problem, times=np.array(TIMES), options=options, progress=False)
        return result, result.displacements

    (result, _), times = spent(call)
    record |= times | {"status": result.status, "iterations": result.iterations, "error": result.error}
    record |= {"setup_s": result.seconds["setup"], "spent": result.spent()}
    record["active_unknowns"] = result.solver.active_unknowns
    record["newton"] = [decision for decision in result.plan.decisions if "Newton" in decision.what]
    if problem.size <= exact_up_to:
        exact = result.tightened(1e-3 * options.rtol)
        record |= {"reference_status": exact.status, "reference_error": exact.error}
        record["true_error"] = reference.energy_difference(problem, result, exact)
    return record


def main() -> None:
    """Measure, print and write."""
    wanted = parser("flange", __doc__, RTOL, ["latin"])
    wanted.add_argument("--newton", type=int, help="0: without Newton's steps; 1: from the first steps")
    wanted.add_argument("--exact", type=float, default=1.2e6, help="unknowns up to which errors are known")
    given = wanted.parse_args()
    if given.one:
        options = Options(rtol=given.rtol, max_iterations=1000)
        if given.newton is not None:
            options = options.with_(newton=given.newton)
        print(json.dumps(one(given.one, given.size, options, given.exact), default=float))
        return
    size = f"{given.size or size_for(given.unknowns):.4g}"
    record: dict[str, Any] = {"benchmark": "flange", "size": size, "commit": common.commit()}
    settings = {"--size": size, "--rtol": str(given.rtol), "--exact": str(given.exact)}
    if given.newton is not None:
        settings["--newton"] = str(given.newton)
    solvers = one_each(__file__, given.only, settings, given.unknowns, given.memory)
    record |= {"solvers": solvers} | of_unit(solvers)
    latin = solvers.get("latin", {})
    kept = ("unknowns", "parts", "active_unknowns", "iterations", "status", "error", "true_error")
    record |= {key: latin[key] for key in kept if key in latin}
    if "seconds" in latin:
        record["peak_gb"] = latin["whole_peak_gb"]
    if "seconds" in latin and "unit_s" in record:
        record["units"] = latin["seconds"] / record["unit_s"]
    record["environment"] = common.environment()
    shown = ("unknowns", "unit_solver", "unit_s", "units", "iterations", "error", "true_error", "peak_gb")
    print(", ".join(f"{key} {record[key]}" for key in shown if key in record))
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
