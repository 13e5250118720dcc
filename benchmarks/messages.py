"""What ranks send in an iteration, counted, and a model of it.

``./run bench messages --json FILE``: the chain of 16 cubes of ``scaling.py`` on 1, 2, 4, 8 and 16 ranks (more
than there are cores: no times are taken but on one rank), plain and with coarse problem and matrix
directions. A library that is preloaded counts the calls of MPI; those of 20 iterations less those of 10, by
10, are those of one. Of each number of ``ranks``: ``messages`` and ``bytes`` that the busiest rank sends to
neighbours in an iteration, ``sums`` and ``sum_bytes`` of its reductions; ``model_messages`` and
``model_bytes``: one message to each neighbour, with 8 bytes for each row of a cut; ``difference`` of the
displacements from one rank, relative to the largest.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import common
import numpy as np
import scaling
from mpi4py import MPI

from dolfinx_frontend import Options, assemble, solve

RANKS = (1, 2, 4, 8, 16)
BARE = {"macro": "none", "directions": "diagonal"}
KINDS: dict[str, dict[str, Any]] = {"plain": BARE, "coarse": {}}
FEW, MANY = 10, 20


def work(kind: str, iterations: int, folder: Path) -> None:
    """What every rank of a launch does."""
    warnings.simplefilter("ignore")
    world = MPI.COMM_WORLD
    problem = assemble(scaling.chain(2, False), comm=world)
    joints = [f"joint{k}" for k in range(scaling.PARTS - 1)]
    last = iterations > MANY
    options = Options(rtol=1e-11 if last else 1e-15, max_iterations=iterations, newton=0, **KINDS[kind])
    result = solve(problem, active=joints, options=options, progress=False)
    if last:
        np.savez(folder / f"rank{world.rank}.npz", **result.displacements)
    mine = [name for name in problem.cuts if name in problem.own.interfaces]
    rows = [3 * problem.interfaces[name].num_points for name in mine]
    facts = {
        "iterations": result.iterations,
        "model_messages": max(world.allgather(len(mine))),
        "model_bytes": max(world.allgather(8 * sum(rows))),
        "iteration_s": float(np.median(np.diff([each.seconds for each in result.summary.history]))),
    }
    if world.rank == 0:
        (folder / "facts.json").write_text(json.dumps(facts), encoding="utf-8")


def launched(
    kind: str, ranks: int, iterations: int, counter: Path, folder: Path
) -> tuple[Any, dict[str, Any]]:
    """Counts (ranks, 4) of a run, and what it told."""
    counts = folder / "counts"
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PMIX_", "OMPI_COMM_"))}
    command = [str(shutil.which("mpirun")), "--allow-run-as-root", "--oversubscribe", "-n", str(ranks)]
    command += ["-x", f"LD_PRELOAD={counter}", "-x", f"LATIN_COUNTS={counts}"]
    command += [sys.executable, __file__, "--work", kind, str(iterations), str(folder)]
    environment = inherited | {"OMP_NUM_THREADS": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
    subprocess.run(command, env=environment, check=True, capture_output=True)
    found = np.array([np.loadtxt(f"{counts}.{rank}") for rank in range(ranks)])
    return found, json.loads((folder / "facts.json").read_text(encoding="utf-8"))


def row(kind: str, ranks: int, counter: Path, exact: dict[str, Any]) -> dict[str, Any]:
    """A line of the table; the displacements of one rank are kept for the others."""
    record: dict[str, Any] = {"kind": kind, "ranks": ranks}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        few, facts = launched(kind, ranks, FEW, counter, folder)
        many, told = launched(kind, ranks, MANY, counter, folder)
        each = (many - few) / (told["iterations"] - facts["iterations"])
        for column, what in enumerate(("messages", "bytes", "sums", "sum_bytes")):
            record[what] = float(each[:, column].max())
        record |= {key: told[key] for key in ("model_messages", "model_bytes")}
        if ranks == 1:
            record["iteration_s"] = told["iteration_s"]
        launched(kind, ranks, 3000, counter, folder)
        fields = {n: u for rank in range(ranks) for n, u in np.load(folder / f"rank{rank}.npz").items()}
    if ranks == 1:
        exact.update(fields)
    size = max(np.abs(u).max() for u in exact.values())
    record["difference"] = float(max(np.abs(fields[n] - u).max() for n, u in exact.items()) / size)
    return record


def main() -> None:
    """Measure, print and write."""
    if sys.argv[1:2] == ["--work"]:
        work(sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]))
        return
    parser = common.parser("messages", __doc__)
    parser.add_argument("--ranks", type=int, nargs="*", default=list(RANKS))
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        counter = Path(folder) / "counter.so"
        source = Path(__file__).with_name("_messages.c")
        subprocess.run(["mpicc", "-shared", "-fPIC", "-O1", "-o", str(counter), str(source)], check=True)
        for kind in KINDS:
            exact: dict[str, Any] = {}
            for ranks in given.ranks:
                rows.append(row(kind, ranks, counter, exact))
                print(rows[-1], flush=True)
    record = {"benchmark": "messages", "rows": rows, "commit": common.commit()}
    common.write_json(record | {"environment": common.environment()}, given.json)


if __name__ == "__main__":
    main()
