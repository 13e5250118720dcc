"""Parts over ranks, for ``scaling.py``: on one rank, and shared by two.

Order-3 chaos of the bolted vessel by factors (cover and head go to the second rank, so that joint and screw
lie between them), and the bolted lap joint with contact and friction, tightened and pulled (all interfaces
active on one rank, too), from the matrices of the parts to the displacements. Of each number of ``ranks``:
``seconds`` of the slowest rank (wall, without meshes and matrices of the parts); ``bodies_s``, those of
the bodies (order, factor, condensed block) on the rank that has most of them, and ``bodies_ratio``, all
of them over those: what the speed-up of bodies can be at most; ``peak_gb``, the largest resident memory
of a rank; ``error``, estimated; ``iterations``; and the ``difference`` of the coefficients, or displacements,
between the numbers of ranks, relative to the largest one.
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

from dolfinx_frontend import Chaos, ChaosResult, Options, Scene, assemble, solve
from parts.lap_joint import lap_joint

RANKS = (1, 2)
RTOL, RTOL_LAP = 4e-5, 1e-6
CUBE = 1.02e7
"""Unknowns of the vessel times the cube of the size of its cells, mm^3."""


def vessel(unknowns: float) -> tuple[Scene, dict[str, Any]]:
    """The scene of about so many unknowns, and how it is solved."""
    demo = common.demo("bolted_vessel")
    parts, _ = demo.build_scene(common.size(f"{(CUBE / unknowns) ** (1.0 / 3.0):.4g}"))
    options = Options(rtol=RTOL, backend="cholmod")
    return demo.random_scene(parts), {"chaos": Chaos(order=3, check_points=0), "options": options}


def lap(size: float) -> tuple[Scene, dict[str, Any]]:
    """The same of the lap joint, with cells of a size (mm)."""
    demo = common.demo("bolted_lap_joint")
    scene = demo.build_scene(lap_joint(size), demo.SHEAR * (demo.PULL, 0.0, 0.0), degree=2)
    return scene, {"times": (1.0, 2.0), "options": Options(rtol=RTOL_LAP), "active": "all"}


SCENES = {"order-3 chaos of the vessel": vessel, "lap joint, contact and friction": lap}


def work(case: str, size: float, folder: Path) -> None:
    """What every rank of a launch does."""
    world = MPI.COMM_WORLD
    scene, settings = SCENES[case](size)
    problem = assemble(scene, comm=world)
    world.barrier()
    began = perf_counter()
    result = solve(problem, **settings, progress=False)
    read = result.coefficients if isinstance(result, ChaosResult) else result.unknowns
    fields = {name: read(name) for name in problem.substructures}
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


def measured(case: str, size: float) -> dict[str, Any]:
    """One rank, then two."""
    found, fields = [], []
    for ranks in RANKS:
        with tempfile.TemporaryDirectory() as folder:
            common.launch(__file__, ranks, case, str(size), folder)
            found.append(json.loads((Path(folder) / "times.json").read_text(encoding="utf-8")))
            of_ranks = [np.load(Path(folder) / f"rank{rank}.npz") for rank in range(ranks)]
            fields.append({name: values for each in of_ranks for name, values in each.items()})
    one, two = fields
    largest = max(float(np.abs(u).max()) for u in one.values())
    off = max(float(np.abs(u - two[name]).max()) for name, u in one.items())
    bodies = [[sum(of_rank) for of_rank in each["bodies"]] for each in found]
    return {
        "case": case,
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
    work(sys.argv[2], float(sys.argv[3]), Path(sys.argv[4]))
