"""A large part over ranks: time, memory and digits against the same part on one.

``./run bench spread --cells N --json FILE``. Ranks: a cube of N^3 hexahedra of degree 2, held at one end and
pulled through a joint with springs by a smaller cube at the other. Of each number of ranks (1: the mesh is on
COMM_SELF) ``unknowns`` of the cube, ``size`` of what its owner has of it, and of the slowest or largest rank
``cpu_s`` (processor time of assembly and solution) and ``peak_gb`` (of the whole process); ``difference`` of
the force on the joint from one rank, relative to the largest.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
from pathlib import Path
from time import process_time
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


def main() -> None:
    """Measure, print and write."""
    if sys.argv[1:2] == ["--work"]:
        work(int(sys.argv[2]), Path(sys.argv[3]))
        return
    parser = common.parser("spread", __doc__)
    parser.add_argument("--cells", type=int, default=16)
    parser.add_argument("--ranks", type=int, nargs="*", default=[1, 2])
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
    record = {"benchmark": "spread", "rows": rows}
    common.write_json(record | {"environment": common.environment()}, given.json)


if __name__ == "__main__":
    main()
