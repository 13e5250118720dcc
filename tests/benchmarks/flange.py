"""A flange of 35 parts with a million unknowns: contact, friction and preload beside one linear solution.

``./run bench flange --unknowns N --json FILE`` meshes ``demos/flange_from_step.py`` with about N unknowns. Its
upper nuts rub on the flange (rigid contact), the gasket is pressed through its filler; the bolts are tightened
in one step, the pressure acts in a second one. It writes

* ``unknowns``, ``parts``, ``active_unknowns`` (on the faces that are kept);
* ``unit_s``: seconds of one solution of the assembled structure, with springs in its contacts, by the fastest
  of CHOLMOD, MUMPS and conjugate gradients with GAMG (to a residual of 1e-6), and ``unit_solver``;
  ``solvers``: all of them, with the peak memory beyond the assembled matrix, or why there is none;
* ``latin``: both steps from the matrices of the parts to all displacements: ``seconds``, ``units``,
  ``iterations``, ``status``, ``error`` (estimated) and ``true_error`` in the energy norm, against the same
  iteration carried on to ``RTOL / 1000``; ``setup_s``; ``slipping`` and ``open`` shares of the contacts;
  with ``--threads`` the same on so many threads, too, and ``speedup``, of both clocks;
* ``peak_gb``: largest resident memory of the process of ``latin``, with its meshes and matrices.

Every line is made in a process of its own. Seconds are those of the clock; ``cpu_s`` those of the processor.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import common
import numpy as np
from performance import Memory

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
from dolfinx_frontend.reference.multigrid import Aggregation

SOLVERS = ("cholmod", "mumps", "gamg")
RTOL = 1e-4
FRICTION = 0.12
NUTS = "upper flange|upper nut *"
CUBE = 9.4e4 * 17.0**3
"""Unknowns of the flange times the cube of the size of its cells, mm^3, of fine meshes."""
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


def linear(problem: Problem) -> Problem:
    """Springs for the contacts, closed sections for the preloads: what a linear solver would solve."""
    laws = {name: each.law.at(TIMES[-1]) for name, each in problem.interfaces.items()}
    springs = Elastic(normal=1e4, tangential=1e4)
    for name, law in laws.items():
        if isinstance(law, (Contact, Preload)):
            laws[name] = springs if isinstance(law, Contact) else Perfect()
    return problem.with_laws(laws)


def one(method: str, size: float, rtol: float) -> dict[str, Any]:
    """One line."""
    problem = flange(size)
    record: dict[str, Any] = {"method": method, "unknowns": problem.size, "parts": len(problem.substructures)}
    if method in SOLVERS:
        fixed = linear(problem)
        [(body, only, load)] = reference.Monolithic(fixed).systems(fixed.laws())
        only.eliminate_zeros()
        for part in (*fixed.substructures.values(), *problem.substructures.values()):
            part.__dict__.pop("matrix", None)  # a copy that is not needed any more
        once = [only]
        del only

        def call() -> Any:
            matrix = once.pop()
            if method == "gamg":
                return Aggregation(fixed, body, matrix).solve(load)
            return reference.Cholesky(matrix, method).solve(load, refine=False)

    else:
        options = Options(rtol=rtol, max_iterations=1000)

        def call() -> Any:
            result = solve(problem, times=np.array(TIMES), options=options, progress=False)
            return result, result.displacements

    memory, began = Memory(), process_time()
    found = common.timed(call, 1)
    record |= {"seconds": found.seconds, "cpu_s": process_time() - began, "peak_gb": 1e-9 * memory.peak()}
    record["whole_peak_gb"] = 1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if method == "latin":
        result = found.value[0]
        record |= {"status": result.status, "iterations": result.iterations, "error": result.error}
        record |= {"setup_s": result.seconds["setup"], "spent": result.spent()}
        record["active_unknowns"] = result.solver.active_unknowns
        exact = result.tightened(1e-3 * rtol)
        record |= {"reference_status": exact.status, "reference_error": exact.error}
        record["true_error"] = reference.energy_difference(problem, result, exact)
    return record


def in_process(threads: int, *arguments: str) -> dict[str, Any]:
    """What this file says when it is run with these arguments; a record of its failure if it fails."""
    threaded = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
    command = [sys.executable, __file__, *arguments]
    run = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=os.environ | threaded)
    if run.returncode:
        return {"method": arguments[1], "failed": f"ended with {run.returncode}"}
    return dict(json.loads(run.stdout.splitlines()[-1]))


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("flange", __doc__)
    parser.add_argument("--unknowns", type=float, default=100_000, help="about so many")
    parser.add_argument("--rtol", type=float, default=RTOL, help="tolerance of the iteration")
    parser.add_argument("--only", nargs="*", default=[*SOLVERS, "latin"], help="what is run")
    parser.add_argument("--threads", type=int, default=1, help="of a second run of the iteration")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(given.one[0], float(given.one[1]), given.rtol), default=float))
        return
    size = f"{(CUBE / given.unknowns) ** (1.0 / 3.0):.4g}"
    record: dict[str, Any] = {"benchmark": "flange", "size": size, "commit": common.commit(), "solvers": {}}
    runs = [(method, 1) for method in given.only]
    if given.threads > 1:
        runs.append(("latin", given.threads))
    for method, threads in runs:
        found = in_process(threads, "--one", method, size, "--rtol", str(given.rtol))
        record["solvers"][method if threads == 1 else f"{method}, {threads} threads"] = found
        print(json.dumps(found), flush=True)
    done = {name: each for name, each in record["solvers"].items() if "seconds" in each}
    units = {name: done[name]["seconds"] for name in SOLVERS if name in done}
    if units:
        record["unit_solver"] = min(units, key=lambda name: units[name])
        record["unit_s"] = units[record["unit_solver"]]
    latin = done.get("latin", {})
    for key in ("unknowns", "parts", "active_unknowns", "iterations", "status", "error", "true_error"):
        record[key] = latin.get(key)
    record["peak_gb"] = latin.get("whole_peak_gb")
    if latin and units:
        record["units"] = latin["seconds"] / record["unit_s"]
    both = done.get(f"latin, {given.threads} threads")
    if latin and both and given.threads > 1:
        record["speedup"] = latin["seconds"] / both["seconds"]
    record["environment"] = common.environment()
    shown = ("unknowns", "unit_solver", "unit_s", "units", "iterations", "error", "true_error", "peak_gb", "speedup")
    print(", ".join(f"{key} {record[key]}" for key in shown if key in record))
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
