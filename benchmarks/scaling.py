"""Ranks: the iteration on a chain of 16 equal parts over one MPI rank and over two.

``./run bench scaling --json FILE`` writes ``chain``, a row for one column (deterministic) and one for a chaos
of 10 modes: ``parts``; ``unknowns`` of all parts; ``rows``, the interface unknowns; ``columns``; for each
number of ``ranks``: ``iterations``; ``iteration_s``, the median time of an iteration in the fastest of
some solves; ``fastest_iteration_s``, the fastest iteration of all; ``global_cpu_s``, processor time of
a global stage on the slowest rank (no communication is in it); ``setup_s`` (factorisation and
condensation, slowest rank); of each ``..._ratio`` of one rank to two, ``ratio`` being that of the
iteration; ``max_difference`` of the displacements, relative to the largest one. ``ratio`` and
``max_difference`` at the top level are the least and the largest of the rows. ``cases`` has of this chain and
of points over ranks (see ``_points.py``) and of parts over ranks (``_parts.py``, ``--vessel N`` unknowns,
``--lap S`` mm; 0: it is left out) what was measured: ``ranks``, ``speedup`` (wall), ``difference``.

One thread a rank. Other work on the machine slows two ranks more than one, because they wait for each
other in every iteration: ``load`` of the machine before the first run stands in ``environment``. Processor
times say what a loaded machine hides.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from time import thread_time
from typing import Any

import _parts
import _points
import common
import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend import Chaos, Elastic, LinearElastic, LogNormal, Options, Scene, assemble, solve
from dolfinx_frontend.geometry.parts import Part

PARTS = 16
RANKS = (1, 2)
E = 1000.0
# several ranks have no coarse problem and no matrix directions: one rank goes without here
SAME_STEPS = Options(rtol=1e-10, newton=0, macro="none", directions="diagonal")
TIMES = ("iteration_s", "fastest_iteration_s", "global_cpu_s", "setup_s")
FACES = {"x0": (0, 0), "x1": (0, 1), "z0": (2, 0)}  # axis, end


def block(k: int, cells: int, comm: Any = MPI.COMM_SELF) -> Part:
    """Unit cube number k of the chain along x."""
    low = np.array([k, 0.0, 0.0])
    mesh = dmesh.create_box(
        comm, [low, low + 1.0], [cells] * 3, dmesh.CellType.hexahedron
    )
    facets, tags = [], []
    for number, (axis, end) in enumerate(FACES.values(), start=1):
        at = low[axis] + end
        found = dmesh.locate_entities_boundary(
            mesh, 2, lambda x, axis=axis, at=at: np.isclose(x[axis], at)
        )
        facets.append(found)
        tags.append(np.full(len(found), number, dtype=np.int32))
    all_facets = np.concatenate(facets)
    order = np.argsort(all_facets)
    marks = dmesh.meshtags(mesh, 2, all_facets[order], np.concatenate(tags)[order])
    return Part(mesh, marks, {name: n for n, name in enumerate(FACES, start=1)})


def chain(cells: int, random: bool) -> Scene:
    """Parts on a soft bed, joined by springs, pulled at the end; one of the springs may be random."""
    scene = Scene()
    for k in range(PARTS):
        scene.substructure(
            f"b{k}", lambda k=k: block(k, cells), LinearElastic(E=E, nu=0.3), degree=2
        )
        scene.interface(f"bed{k}", f"b{k}:z0", Elastic(normal=0.2 * E, tangential=0.2 * E))
    scene.fix("b0:x0", name="wall")
    for k in range(PARTS - 1):
        stiffness: Any = 2.0 * E
        if random and k in (PARTS // 2 - 1, PARTS // 2):
            stiffness = LogNormal(f"k{k}", 2.0 * E, cov=0.2)
        scene.interface(
            f"joint{k}", f"b{k}:x1", f"b{k + 1}:x0", Elastic(normal=stiffness, tangential=E)
        )
    scene.traction(f"b{PARTS - 1}:x1", (1.0, 0.1, 0.0), name="pull")
    return scene


def work(cells: int, random: bool, repeats: int, folder: Path) -> None:
    """What every rank of a launch does: solve, write times and displacements."""
    world = MPI.COMM_WORLD
    problem = assemble(chain(cells, random), comm=world)
    joints = [f"joint{k}" for k in range(PARTS - 1)]
    best: dict[str, Any] = {}
    fastest = np.inf
    for _ in range(repeats):
        settings: dict[str, Any] = {"active": joints, "options": SAME_STEPS}
        if random:
            settings["chaos"] = Chaos(order=3)
        result = solve(problem, **settings)
        steps = np.diff([each.seconds for each in result.summary.history])
        fastest = min(fastest, float(steps.min()))
        found = {
            "unknowns": problem.size,
            "rows": result.solver.total_rows,
            "columns": result.state.data.shape[1],
            "converged": result.converged,
            "iterations": result.iterations,
            "iteration_s": float(np.median(steps)),
            "setup_s": max(world.allgather(result.seconds["setup"])),
        }
        better = not best or found["iteration_s"] < best["iteration_s"]
        if world.bcast(better):
            best = found
    best["fastest_iteration_s"] = fastest
    amplitudes = np.asfortranarray(np.eye(result.solver.loads, best["columns"]))
    cpu = []
    for _ in range(20):
        start = thread_time()
        result.solver.global_stage(result.laws, result.state.data, amplitudes)
        cpu.append(thread_time() - start)
    best["global_cpu_s"] = max(world.allgather(float(np.median(cpu))))
    fields = {
        name: result.coefficients(name) if random else result.displacements[name]
        for name in problem.substructures
    }
    np.savez(folder / f"rank{world.rank}.npz", **fields)
    if world.rank == 0:
        (folder / "times.json").write_text(json.dumps(best), encoding="utf-8")


def row(cells: int, random: bool, repeats: int, launches: int) -> dict[str, Any]:
    """One rank and two in turn, some times; the best of each."""
    found: dict[int, dict[str, Any]] = {}
    fields: dict[int, dict[str, Any]] = {}
    for _ in range(launches):
        for ranks in RANKS:
            with tempfile.TemporaryDirectory() as folder:
                common.launch(__file__, ranks, str(cells), str(int(random)), str(repeats), folder)
                times = json.loads((Path(folder) / "times.json").read_text(encoding="utf-8"))
                known = found.setdefault(ranks, times)
                for key in TIMES:
                    known[key] = min(known[key], times[key])
                fields[ranks] = {
                    name: values
                    for rank in range(ranks)
                    for name, values in np.load(Path(folder) / f"rank{rank}.npz").items()
                }
    one, two = (found[r] for r in RANKS)
    largest = max(np.abs(u).max() for u in fields[1].values())
    off = max(np.abs(u - fields[2][name]).max() for name, u in fields[1].items())
    record: dict[str, Any] = {"parts": PARTS, "ranks": list(RANKS)}
    record |= {key: one[key] for key in ("unknowns", "rows", "columns")}
    record["converged"] = one["converged"] and two["converged"]
    for key in ("iterations", *TIMES):
        record[key] = [one[key], two[key]]
    record["ratio"] = one["iteration_s"] / two["iteration_s"]
    for key in TIMES[1:]:
        record[key.removesuffix("_s") + "_ratio"] = one[key] / two[key]
    record["max_difference"] = float(off / largest)
    return record


def main() -> None:
    """Measure and write."""
    if sys.argv[1:2] == ["--work"]:
        cells, random, repeats, folder = sys.argv[2:6]
        work(int(cells), bool(int(random)), int(repeats), Path(folder))
        return
    parser = common.parser("scaling", __doc__)
    parser.add_argument("--cells", type=int, default=5, help="cells along an edge of a part")
    parser.add_argument("--samples", type=int, default=10_000, help="of the vessel, over ranks")
    parser.add_argument("--sets", type=int, default=10, help="friction sets of the lap joint: to the power 3")
    parser.add_argument("--launches", type=int, default=3, help="launches of one and of two ranks in turn")
    parser.add_argument("--vessel", type=float, default=500_000, help="unknowns of the large one; 0: none")
    parser.add_argument("--lap", type=float, default=4.0, help="size of cells of the lap joint, mm; 0: none")
    parser.add_argument("--only", choices=("parts",), help="these cases alone")
    arguments = parser.parse_args()
    environment = common.environment() | {"threads": "1 a rank"}
    sizes = zip(_parts.SCENES, (arguments.vessel, arguments.lap), strict=True)
    of_parts = [_parts.measured(case, size) for case, size in sizes if size]
    for each in of_parts:
        print(
            f"{each['unknowns']} unknowns, {each['case']}: {each['seconds'][0]:.1f} s on one rank, "
            f"{each['seconds'][-1]:.1f} s on two, {each['speedup'][-1]:.2f} times faster (bodies alone at "
            f"most {each['bodies_ratio'][-1]:.2f}), difference {each['difference']:.1e}, peak of a rank "
            f"{each['peak_gb'][0]:.2f} and {each['peak_gb'][-1]:.2f} GB",
            flush=True,
        )
    if arguments.only:
        common.write_json({"environment": environment, "cases": of_parts}, arguments.json)
        return
    rows = []
    for random in (False, True):
        rows.append(row(arguments.cells, random, arguments.repeats, arguments.launches))
        one, two = rows[-1]["iteration_s"]
        last = rows[-1]
        print(
            f"{last['unknowns']} unknowns, {last['columns']} columns: {1e3 * one:.2f} ms an iteration "
            f"on one rank, {1e3 * two:.2f} ms on two, {last['ratio']:.2f} times faster (fastest "
            f"iterations {last['fastest_iteration_ratio']:.2f}, processor time of the global stage "
            f"{last['global_cpu_ratio']:.2f}), largest difference {last['max_difference']:.1e}"
        )
    cases = [
        {
            "case": f"iteration of a chain, {each['columns']} columns",
            "ranks": each["ranks"],
            "speedup": [1.0, each["ratio"]],
            "difference": each["max_difference"],
        }
        for each in rows
    ]
    cases += of_parts
    cases += _points.cases(arguments.samples, arguments.sets, arguments.launches, arguments.repeats)
    record = {
        "environment": environment,
        "cases": cases,
        "chain": rows,
        "ratio": min(each["ratio"] for each in rows),
        "max_difference": max(each["max_difference"] for each in rows),
    }
    common.write_json(record, arguments.json)


if __name__ == "__main__":
    main()
