"""The bolted lap joint of ``demos/bolted_lap_joint.py`` by us and by CalculiX, on the same nodes.

Straight tetrahedra with quadratic displacements. Bolts are cut between shank and head and shortened there by
an imposed jump, without the spring of the demo; everything else is that of the demo: tightening, then a pull;
friction in five contacts. The discretisation of the contact is each program's own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import common
import numpy as np
import numpy.typing as npt
from peers import calculix

from dolfinx_frontend import Options, Perfect, Problem, Scene, assemble, solve, sweep
from parts.lap_joint import LapJoint, lap_joint

Array = npt.NDArray[np.float64]
RTOL = 1e-5


def scene_of(demo: ModuleType, joint: LapJoint) -> Scene:
    """The scene of the demo, with bolts that are shortened by a jump between nodes."""
    scene: Scene = demo.build_scene(joint, demo.SHEAR * (demo.PULL, 0.0, 0.0))
    cut = Perfect(jump=demo.TIGHTEN * -demo.SHORTENING)
    for name in demo.CUTS:
        scene.interfaces[name] = replace(scene.interfaces[name], law=cut, space="auto")
    return scene


def sets_of(demo: ModuleType, n: int) -> dict[Any, Any]:
    """n values of friction between the plates, of friction under heads and nuts, and of the shortening."""
    return {
        "plates.friction": np.linspace(0.1, 0.3, n),
        tuple(f"{name}.friction" for name in demo.CONTACTS[1:]): np.linspace(0.1, 0.3, n),
        tuple(f"{name}.jump" for name in demo.CUTS): -np.linspace(0.1, 0.2, n),
    }


def ours(demo: ModuleType, problem: Problem, rtol: float) -> tuple[dict[str, Array], float, Any]:
    """Displacements (nodes, 3) at the end, the load of the modelled half, and the result."""
    options = Options(rtol=rtol, max_iterations=10000)
    result = solve(problem, times=demo.TIMES, options=options)
    u = {name: field[-1].reshape(-1, 3) for name, field in result.displacements.items()}
    return u, float(demo.load(problem, result)[-1]) / demo.HALVES, result


def joint_part(
    demo: ModuleType, size: str | float, n: int, folder: Path, theirs_too: bool = True
) -> dict[str, Any]:
    """One run, n^3 sets, and the same in CalculiX: one run, whose time counts as often as there are sets."""
    joint = lap_joint(size, geometry_order=1)
    began = perf_counter()
    problem = assemble(scene_of(demo, joint))
    setup = perf_counter() - began
    began = perf_counter()
    u, load, result = ours(demo, problem, RTOL)
    run = perf_counter() - began
    exact_u, exact_load, exact = ours(demo, problem, 1e-9)
    largest = max(float(np.abs(field).max()) for field in exact_u.values())
    apart = max(float(np.abs(u[name] - field).max()) for name, field in exact_u.items())
    began = perf_counter()
    swept = sweep(
        problem,
        sets_of(demo, n),
        times=demo.TIMES,
        options=demo.SETTINGS.with_(rtol=demo.RTOL),
        keep_fields=False,
        outputs={"load": lambda point: demo.load(problem, point)[..., -1]},
    )
    many = perf_counter() - began
    record: dict[str, Any] = {
        "size": size,
        "dof": problem.size,
        "status": [result.status, exact.status],
        "iterations": result.iterations,
        "seconds": setup + run,
        "error_displacement": apart / largest,
        "error_load": abs(load / exact_load - 1.0),
        "load": load,
        "sets": int(swept.converged.size),
        "converged": int(swept.converged.sum()),
        "seconds_of_sets": setup + many,
        "calculix": None,
    }
    found = calculix.run(problem, demo.TIMES, folder / "lap.inp") if theirs_too else None
    if found is None:
        return record
    away = max(float(np.abs(found.u[name] - field).max()) for name, field in exact_u.items())
    load_there = float(found.forces[calculix.set_of("grip")][0])
    record["calculix"] = {
        "seconds": found.seconds,
        "iterations": found.iterations,
        "max_difference": away / largest,
        "load_difference": abs(load_there / exact_load - 1.0),
        "seconds_of_sets": swept.converged.size * found.seconds,
    }
    return record


def report(record: dict[str, Any]) -> str:
    """A table for a page."""
    def seconds(value: float) -> str:
        return f"{value:.1f} s" if value < 600.0 else f"{value / 3600.0:.1f} h"

    sets = record["sets"]
    rows = [
        [
            "latin-core",
            f"{record['error_displacement']:.0e} (true)",
            f"{record['error_load']:.0e} (true)",
            seconds(record["seconds"]),
            seconds(record["seconds_of_sets"]) + ("" if record["converged"] == sets else " (not all)"),
        ]
    ]
    if (other := record["calculix"]) is not None:
        rows.append(
            [
                "CalculiX 2.20",
                f"{100 * other['max_difference']:.1f} % away",
                f"{100 * other['load_difference']:.1f} % away",
                seconds(other["seconds"]),
                seconds(other["seconds_of_sets"]) + " (times one run)",
            ]
        )
    header = ["lap joint", "displacement", "load", "one run", f"{sets} sets"]
    table: str = common.markdown_table(header, rows)
    return table
