"""A large part over ranks, and over threads: time, memory and digits against the same part on one.

``./run bench spread --cells N --json FILE``. Ranks: a cube of N^3 hexahedra of degree 2, held at one end and
pulled through a joint with springs by a smaller cube at the other. Of each number of ranks (1: the mesh is on
COMM_SELF) ``unknowns`` of the cube, ``size`` of what its owner has of it, and of the slowest or largest rank
``cpu_s`` (processor time of assembly and solution) and ``peak_gb`` (of the whole process); ``difference`` of
the force on the joint from one rank, relative to the largest. Threads: of the large cube alone on one
process, held and pulled, ``busy_s``, the processor time of the busiest thread while it is solved
(factorised), and ``process_s``, that of all; ``difference`` of the displacements.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time, thread_time
from typing import Any

import common
import numpy as np
import scaling
from mpi4py import MPI

from dolfinx_frontend import Elastic, LinearElastic, Options, Scene, assemble, solve


def work(cells: int, folder: Path) -> None:
    """What every rank of a launch does."""
    world = MPI.COMM_WORLD
    comm = world if world.size > 1 else MPI.COMM_SELF
    began = process_time()
    steel = LinearElastic(E=200e3, nu=0.3)
    scene = Scene()
    scene.substructure("small", scaling.block(1, 2), steel, degree=2)
    scene.substructure("large", scaling.block(0, cells, comm), steel, degree=2, rank=0)
    law = Elastic(normal=1e5, tangential=4e4)
    scene.interface("joint", "small:x0", "large:x1", law, space="points")
    scene.fix("large:x0")
    scene.traction("small:x1", (100.0, 10.0, 0.0))
    problem = assemble(scene, comm=world)
    result = solve(problem, active=["joint"], options=Options(rtol=1e-12))
    force, _ = result.gathered("joint")
    spent = max(world.allgather(process_time() - began))
    peak = max(world.allgather(1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))
    if world.rank == 0:
        np.save(folder / "force.npy", force)
        found = {"cpu_s": spent, "peak_gb": peak, "size": problem.parts["large"].size}
        (folder / "found.json").write_text(json.dumps(found), encoding="utf-8")


def body(cells: int, folder: Path) -> None:
    """What the process of a number of threads does."""
    scene = Scene()
    steel = LinearElastic(E=200e3, nu=0.3)
    scene.substructure("large", scaling.block(0, cells), steel, degree=2)
    scene.fix("large:x0")
    scene.traction("large:x1", (100.0, 10.0, 0.0))
    problem = assemble(scene)
    began, own = process_time(), thread_time()
    result = solve(problem)
    spent, own = process_time() - began, thread_time() - own
    np.save(folder / "u.npy", result.displacements["large"])
    found = {"busy_s": max(own, spent - own), "process_s": spent, "unknowns": problem.size}
    (folder / "found.json").write_text(json.dumps(found), encoding="utf-8")


def of_threads(cells: int, counts: list[int]) -> list[dict[str, Any]]:
    """A row for each number of threads."""
    rows, exact = [], None
    for threads in counts:
        with tempfile.TemporaryDirectory() as folder:
            number = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
            call = [sys.executable, __file__, "--body", str(cells), folder]
            subprocess.run(call, env={**os.environ, **number}, check=True)
            found = json.loads((Path(folder) / "found.json").read_text(encoding="utf-8"))
            u = np.load(Path(folder) / "u.npy")
        exact = u if exact is None else exact
        found["difference"] = float(np.abs(u - exact).max() / np.abs(exact).max())
        rows.append({"threads": threads} | found)
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, print and write."""
    if sys.argv[1:2] in (["--work"], ["--body"]):
        (work if sys.argv[1] == "--work" else body)(int(sys.argv[2]), Path(sys.argv[3]))
        return
    parser = common.parser("spread", __doc__)
    parser.add_argument("--cells", type=int, default=16)
    parser.add_argument("--ranks", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    exact: Any = None
    for ranks in given.ranks:
        with tempfile.TemporaryDirectory() as folder:
            common.launch(__file__, ranks, str(given.cells), folder)
            found = json.loads((Path(folder) / "found.json").read_text(encoding="utf-8"))
            force = np.load(Path(folder) / "force.npy")
        exact = force if exact is None else exact
        found["difference"] = float(np.abs(force - exact).max() / np.abs(exact).max())
        rows.append({"ranks": ranks, "unknowns": 3 * (2 * given.cells + 1) ** 3} | found)
        print(rows[-1], flush=True)
    record = {"benchmark": "spread", "rows": rows, "threads": of_threads(given.cells, given.threads)}
    common.write_json(record | {"environment": common.environment()}, given.json)


if __name__ == "__main__":
    main()
