"""Asked, got, cost, what decided: ten scenes solved to 10 %, 1 % and 0.1 %.

``./run bench asked [--json FILE] [--markdown benchmarks/measured/asked.md] [--only NUMBER ...]``

Six scenes have exact meshes and moments in closed form (of ``promise``): what is random decides. In the
other four meshes decide; their references are a closed form, carried-on uniform meshes, or the finest meshes
of ``tradeoff``. *Got* is the true error, the larger of mean and deviation; a *unit* is assembling and solving
the first mesh once.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import common
import numpy as np
import promise

from dolfinx_frontend import Problem, Scene, assemble, solve
from dolfinx_frontend.uncertainty.statistics import MeanStd
from benchmarks import tradeoff
from tests.verification import test_meshes as plane

ACCURACIES = (1e-1, 1e-2, 1e-3)
SECONDS, UNKNOWNS = 40.0, 120_000
NUMBERS = {"series": 6, "gripped": 7, "parallel": 8, "stop": 3, "bolt": 4, "field": 5}
"""The scene of each family of ``promise`` with seed 0."""


@dataclass(frozen=True)
class Task:
    """A scene or problem, what is asked of it, and what that is."""

    title: str
    make: Callable[[], Scene | Problem]
    quantity: Any
    exact: MeanStd


def tasks() -> list[Task]:
    """The ten."""
    vessel = tradeoff.scenes(True)["vessel"]
    mesh = replace(vessel.base, size="coarse")
    found = [
        Task("L, re-entrant corner", plane.corner_scene, "joint", MeanStd(plane.CORNER, None)),
        Task(
            "rings shrunk together, straight cells",
            lambda: plane.pressed(1, 2e3, 1e-3)[0],
            "fit",
            MeanStd(plane.pressed(1, 2e3, 1e-3)[1], None),
        ),
        Task(
            "rings shrunk together, curved cells",
            lambda: plane.pressed(2, 2e3, 1e-3)[0],
            "fit",
            MeanStd(plane.pressed(2, 2e3, 1e-3)[1], None),
        ),
        # the reference of `tradeoff`: 6.2 mm, degree 3, which differs from 9.6 mm by 9e-4
        Task(
            "bolted vessel, two random stiffnesses",
            lambda: tradeoff.uncertain(vessel, mesh),
            vessel.quantity,
            MeanStd(-1083.67, 239.36),
        ),
    ]
    for family, number in NUMBERS.items():
        case = promise.FAMILIES[family](np.random.default_rng([0, number]))
        germs = len(solve(case.problem, chaos=1, progress=False).space.germs)
        title = f"{TITLES[family]}, {germs} germ(s)"
        found.append(Task(title, lambda case=case: case.problem, case.quantity, case.exact))
    return found


TITLES = {
    "series": "random layers in series",
    "gripped": "random layers, gripped",
    "parallel": "random springs side by side",
    "stop": "a random gap that may close",
    "bolt": "preloaded bolt, joint that may open",
    "field": "layer of random stiffness (field)",
}


def first_mesh(task: Task) -> float:
    """Seconds of a unit."""
    problem = task.make()

    def once() -> None:
        made = assemble(task.make()) if isinstance(problem, Scene) else problem
        solve(tradeoff.nominal(made), progress=False)

    once()
    return common.timed(once, 3).seconds


def run(task: Task, accuracy: float, unit: float) -> dict[str, Any]:
    """One row."""
    given = task.make()
    budget: dict[str, Any] = {"meshes": False}
    if isinstance(given, Scene):
        budget = {"max_seconds": SECONDS, "max_unknowns": UNKNOWNS, "progress": False}
    began = perf_counter()
    result = solve(given, accuracy=accuracy, quantity=task.quantity, **budget)
    seconds = perf_counter() - began
    made = result.errors()
    value = result.mean_std(task.quantity)
    off = abs(value.mean / task.exact.mean - 1.0)
    if task.exact.std is not None and value.std is not None:
        off = max(off, abs(value.std / task.exact.std - 1.0))
    share = getattr(made, made.dominating)
    return {
        "scene": task.title,
        "asked": accuracy,
        "got": off,
        "said": made.in_all,
        "reached": bool(made.reached),
        "units": seconds / unit,
        "seconds": seconds,
        "decided": f"{made.dominating}: {share.how}",
        "unknowns": result.problem.size,
        "meshes": len(made.steps),
    }


HEADER = ("scene", "asked", "got", "said", "units", "seconds", "what decided")


def shown(row: dict[str, Any]) -> list[str]:
    """A row of the table."""
    meshes = f"; {row['meshes']} mesh(es), {row['unknowns']} unknowns"
    what = row["decided"] + (meshes if row["meshes"] else "")
    said = f"{row['said']:.1e}" + ("" if row["reached"] else ", not reached")
    return [
        row["scene"], f"{100.0 * row['asked']:g} %", f"{row['got']:.1e}", said, f"{row['units']:.3g}",
        f"{row['seconds']:.2g}", what,
    ]  # fmt: skip


def main() -> None:
    """Measure and report."""
    parser = common.parser("asked", __doc__)
    parser.add_argument("--markdown", type=common.Path, help="page whose section `asked` is written anew")
    parser.add_argument("--only", nargs="*", type=int, help="numbers of scenes, from 0")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for number, task in enumerate(tasks()):
        if given.only is not None and number not in given.only:
            continue
        unit = first_mesh(task)
        for accuracy in ACCURACIES:
            rows.append(run(task, accuracy, unit))
            print(" | ".join(shown(rows[-1])), flush=True)
    units = {a: [r["units"] for r in rows if r["asked"] == a] for a in ACCURACIES}
    medians = {f"{100.0 * a:g} %": float(np.median(each)) for a, each in units.items()}
    print("median units", medians)
    common.write_json({"rows": rows, "medians": medians, "environment": common.environment()}, given.json)
    if given.markdown is not None:
        text = common.markdown_table(HEADER, [shown(row) for row in rows])
        common.between_marks(given.markdown, "asked", text)


if __name__ == "__main__":
    main()
