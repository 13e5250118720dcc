"""One linear solution by every solver, each in a process of its own: for ``large.py`` and ``flange.py``."""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from time import process_time
from typing import Any

import common
from performance import Memory

from dolfinx_frontend import LinearElastic, Problem, Scene, assemble, geometry, reference
from dolfinx_frontend.reference.multigrid import Aggregation

SOLVERS = ("cholmod", "mumps", "gamg")


def parser(name: str, description: str | None, rtol: float, runs: Sequence[str]) -> argparse.ArgumentParser:
    """Options of a benchmark that runs the SOLVERS and `runs` of its own, each by ``--one``."""
    made = common.parser(name, description)
    made.add_argument("--unknowns", type=float, default=100_000, help="about so many")
    made.add_argument("--memory", type=float, default=14.0, help="GB that a direct solver may need")
    made.add_argument("--rtol", type=float, default=rtol, help="tolerance of the iteration")
    made.add_argument("--only", nargs="*", default=[*SOLVERS, *runs], help="what is run")
    made.add_argument("--one", metavar="METHOD", help="in this process, with --size")
    made.add_argument("--size", type=float, help="of the cells, mm, instead of --unknowns")
    return made


def solution(fixed: Problem, method: str) -> Callable[[], Any]:
    """One solution of the assembled structure by one of SOLVERS, to be called once.

    The matrices of the parts are given back: only the assembled one is in memory when it is called.
    """
    [(body, only, load)] = reference.Monolithic(fixed).systems(fixed.laws())
    only.eliminate_zeros()
    for part in fixed.substructures.values():
        part.__dict__.pop("matrix", None)  # a copy that is not needed any more
    once = [only]
    del only

    def call() -> Any:
        matrix = once.pop()
        if method == "gamg":
            return Aggregation(fixed, body, matrix).solve(load)
        return reference.Cholesky(matrix, method).solve(load, refine=False)

    return call


def spent(call: Callable[[], Any]) -> tuple[Any, dict[str, Any]]:
    """What a call returns, with ``seconds`` of the processor, ``wall_s``, ``peak_gb`` beyond what was there
    before, and ``whole_peak_gb`` of the process so far."""
    scene = Scene()
    scene.substructure("box", geometry.box((1.0, 1.0, 1.0), (2, 2, 2)), LinearElastic(E=1.0, nu=0.3))
    scene.fix("box:x0")
    scene.traction("box:x1", (1.0, 0.0, 0.0))
    reference.monolithic(assemble(scene))  # libraries are loaded
    memory, began = Memory(), process_time()
    found = common.timed(call, 1)
    record = {"seconds": process_time() - began, "wall_s": found.seconds, "peak_gb": 1e-9 * memory.peak()}
    record["whole_peak_gb"] = 1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return found.value, record


def one_each(
    script: str, only: list[str], arguments: Mapping[str, str], unknowns: float, memory: float
) -> dict[str, dict[str, Any]]:
    """What a script says of each method, run with ``--one METHOD`` and `arguments`, printed and by its name.

    A direct solver that is predicted to need more than `memory` GB is left out, and its record says so, as
    that of a process which fails.
    """
    predicted = 1.3 * 8e-9 * 15.0 * unknowns ** (4.0 / 3.0)
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    records = {}
    for method in only:
        if method in ("cholmod", "mumps") and predicted > memory:
            found: dict[str, Any] = {"method": method, "failed": f"needs about {predicted:.3g} GB"}
        else:
            command = [sys.executable, script, "--one", method]
            command += [text for pair in arguments.items() for text in pair]
            run = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=os.environ | threads)
            found = {"method": method, "failed": f"ended with {run.returncode}"}
            if not run.returncode:
                found = json.loads(run.stdout.splitlines()[-1])
        records[method] = found
        print(json.dumps(found), flush=True)
    return records


def of_unit(records: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """``unit_s`` and ``unit_solver``: the fastest of the solvers that came to an end; nothing if none did."""
    seconds = {name: records[name]["seconds"] for name in SOLVERS if "seconds" in records.get(name, {})}
    if not seconds:
        return {}
    best = min(seconds, key=lambda name: float(seconds[name]))
    return {"unit_solver": best, "unit_s": seconds[best]}
