"""The bolted vessel over ranks, for ``scaling.py``: its parts on one rank, and shared by two.

Cover and head go to the second one, so that joint and screw lie between them. Order-3 chaos of
both by factors, from the matrices of the parts to the coefficients. Of each number of ``ranks``:
``seconds`` of the slowest rank (wall, without meshes and matrices of the parts); ``bodies_s``, those of
the bodies (order, factor, condensed block) on the rank that has most of them, and ``bodies_ratio``, all
of them over those: what the speed-up of bodies can be at most; ``peak_gb``, the largest resident memory
of a rank; ``error``, estimated; ``iterations``; and the ``difference`` of the coefficients between the
numbers of ranks, relative to the largest one.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import common
import numpy as np
from mpi4py import MPI

from dolfinx_frontend import Chaos, Options, assemble, solve

RANKS = (1, 2)
RTOL = 4e-5
CUBE = 1.02e7
"""Unknowns of the vessel times the cube of the size of its cells, mm^3."""


def work(unknowns: float, folder: Path) -> None:
    """What every rank of a launch does."""
    world = MPI.COMM_WORLD
    demo = common.demo("bolted_vessel")
    vessel, _ = demo.build_scene(common.size(f"{(CUBE / unknowns) ** (1.0 / 3.0):.4g}"))
    scene = demo.random_scene(vessel)
    problem = assemble(scene, comm=world)
    chaos, options = Chaos(order=3, check_points=0), Options(rtol=RTOL, backend="cholmod")
    world.barrier()
    began = perf_counter()
    result = solve(problem, chaos=chaos, options=options, progress=False)
    fields = {name: result.coefficients(name) for name in problem.substructures}
    seconds = world.allgather(perf_counter() - began)
    peak = world.allgather(1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    bodies = world.allgather([cost["factorise_s"] + cost["condense_s"] for cost in result.solver.costs])
    np.savez(folder / f"rank{world.rank}.npz", **fields)
    if world.rank == 0:
        record = {
            "unknowns": problem.size,
            "seconds": max(seconds),
            "bodies": bodies,
            "peak_gb": max(peak),
            "error": result.error,
            "iterations": result.iterations,
            "converged": result.converged,
        }
        (folder / "times.json").write_text(json.dumps(record), encoding="utf-8")


def measured(unknowns: float) -> dict[str, Any]:
    """One rank, then two."""
    found, fields = [], []
    for ranks in RANKS:
        with tempfile.TemporaryDirectory() as folder:
            common.launch(__file__, ranks, str(unknowns), folder)
            found.append(json.loads((Path(folder) / "times.json").read_text(encoding="utf-8")))
            of_ranks = [np.load(Path(folder) / f"rank{rank}.npz") for rank in range(ranks)]
            fields.append({name: values for each in of_ranks for name, values in each.items()})
    one, two = fields
    largest = max(float(np.abs(u).max()) for u in one.values())
    off = max(float(np.abs(u - two[name]).max()) for name, u in one.items())
    bodies = [[sum(of_rank) for of_rank in each["bodies"]] for each in found]
    return {
        "case": "order-3 chaos of the vessel",
        "ranks": list(RANKS),
        "unknowns": found[0]["unknowns"],
        "converged": all(each["converged"] for each in found),
        **{key: [each[key] for each in found] for key in ("seconds", "peak_gb", "error", "iterations")},
        "bodies_s": [max(each) for each in bodies],
        "bodies_ratio": [sum(each) / max(each) for each in bodies],
        "speedup": [found[0]["seconds"] / each["seconds"] for each in found],
        "difference": off / largest,
    }


if __name__ == "__main__":
    work(float(sys.argv[2]), Path(sys.argv[3]))
