"""Points over ranks, for ``scaling.py``: samples of the bolted vessel, friction sets of the lap joint.

Of each case: one rank without ``points_comm`` (``plain``), and 1 and 2 ``ranks`` with it, in turn.
``seconds`` of the call (factorisation included), the median of some calls in the fastest of some launches;
``cpu_s``, processor time of the slowest rank, which says on a loaded machine what wall time does not (waiting
for others is in it); ``speedup`` over one rank, ``speedup_of_plain`` and ``cpu_speedup`` over the plain call;
``iterations`` of all points; ``difference`` from one rank and ``difference_of_plain`` from the plain call,
relative to the largest value.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import common
import numpy as np
from mpi4py import MPI

from dolfinx_frontend import Options, assemble, monte_carlo
from parts.lap_joint import lap_joint

RANKS = (1, 2)
SAMPLES_RTOL = 3e-5
SIZES = {"samples": "paper", "friction": "coarse"}
NAMES = {"samples": "samples of the vessel", "friction": "friction sets of the lap joint"}


def samples(count: int, more: dict[str, Any]) -> Callable[[], tuple[Any, dict[str, Any]]]:
    """Monte Carlo on the vessel: the call, which returns the answer and what is compared."""
    demo = common.demo("bolted_vessel")
    vessel, _ = demo.build_scene(common.size(SIZES["samples"]))
    problem = assemble(demo.random_scene(vessel), comm=MPI.COMM_SELF)
    options = Options(rtol=SAMPLES_RTOL)

    def call() -> tuple[Any, dict[str, Any]]:
        result = monte_carlo(problem, count, options=options, progress=False, **more)
        return result, {"joint": result.force("joint")[:, ::7]}

    return call


def friction(count: int, more: dict[str, Any]) -> Callable[[], tuple[Any, dict[str, Any]]]:
    """The study of the lap joint over count^3 sets."""
    demo = common.demo("bolted_lap_joint")
    problem = demo.study_problem(lap_joint(SIZES["friction"]), comm=MPI.COMM_SELF)

    def call() -> tuple[Any, dict[str, Any]]:
        result = demo.study(problem, count, progress=False, **more)
        return result, {name: result.output(name) for name in ("load", "slip")}

    return call


def work(case: str, way: str, count: int, repeats: int, folder: Path) -> None:
    """What every rank of a launch does."""
    world = MPI.COMM_WORLD
    more = {} if way == "plain" else {"points_comm": world}
    call = {"samples": samples, "friction": friction}[case](count, more)
    seconds, spent = [], []
    for _ in range(repeats):
        world.barrier()
        began, cpu = perf_counter(), process_time()
        result, values = call()
        seconds.append(max(world.allgather(perf_counter() - began)))
        spent.append(max(world.allgather(process_time() - cpu)))
    if world.rank == 0:
        numbers = result.points.iterations
        record = {
            "seconds": statistics.median(seconds),
            "cpu_s": statistics.median(spent),
            "points": len(numbers),
            "unknowns": result.problem.size,
            "iterations": int(numbers.sum()),
            "converged": bool(np.all(result.points.status == "converged")),
        }
        (folder / "times.json").write_text(json.dumps(record), encoding="utf-8")
        np.savez(folder / "values.npz", **values)


def measured(case: str, count: int, launches: int, repeats: int) -> dict[str, Any]:
    """One case, its ways in turn."""
    ways = {"plain": 1, **{f"{ranks} ranks": ranks for ranks in RANKS}}
    best: dict[str, Any] = {}
    values: dict[str, dict[str, Any]] = {}
    for _ in range(launches):
        for way, ranks in ways.items():
            with tempfile.TemporaryDirectory() as folder:
                common.launch(__file__, ranks, case, way.split()[-1], str(count), str(repeats), folder)
                found = json.loads((Path(folder) / "times.json").read_text(encoding="utf-8"))
                values[way] = dict(np.load(Path(folder) / "values.npz"))
            known = best.setdefault(way, found)
            for key in ("seconds", "cpu_s"):
                known[key] = min(known[key], found[key])
    plain, *spread = (best[way] for way in ways)

    def apart(one: str, other: str) -> float:
        pairs = ((each, values[other][name]) for name, each in values[one].items())
        return max(float(np.abs(a - b).max() / np.abs(a).max()) for a, b in pairs)

    last = f"{RANKS[-1]} ranks"
    return {
        "case": NAMES[case],
        "ranks": list(RANKS),
        "points": plain["points"],
        "unknowns": plain["unknowns"],
        "converged": all(each["converged"] for each in best.values()),
        "plain": {key: plain[key] for key in ("seconds", "cpu_s", "iterations")},
        "seconds": [each["seconds"] for each in spread],
        "cpu_s": [each["cpu_s"] for each in spread],
        "iterations": [each["iterations"] for each in spread],
        "speedup": [spread[0]["seconds"] / each["seconds"] for each in spread],
        "speedup_of_plain": [plain["seconds"] / each["seconds"] for each in spread],
        "cpu_speedup": [plain["cpu_s"] / each["cpu_s"] for each in spread],
        "difference": apart("1 ranks", last),
        "difference_of_plain": apart("plain", last),
    }


def cases(samples: int, sets: int, launches: int, repeats: int) -> list[dict[str, Any]]:
    """All cases, measured and told."""
    found = []
    for case, count in (("samples", samples), ("friction", sets)):
        found.append(measured(case, count, launches, repeats))
        each = found[-1]
        print(
            f"{each['points']} {each['case']} ({each['unknowns']} unknowns): "
            f"{each['plain']['seconds']:.1f} s plain, {each['seconds'][0]:.1f} s on 1 rank, "
            f"{each['seconds'][-1]:.1f} s on {RANKS[-1]}: "
            f"{each['speedup'][-1]:.2f} times faster (than plain {each['speedup_of_plain'][-1]:.2f}, by "
            f"processor time {each['cpu_speedup'][-1]:.2f}), differences {each['difference']:.1e} and "
            f"{each['difference_of_plain']:.1e}",
            flush=True,
        )
    return found


if __name__ == "__main__":
    kind, way, count, repeats, folder = sys.argv[2:7]
    work(kind, way, int(count), int(repeats), Path(folder))
