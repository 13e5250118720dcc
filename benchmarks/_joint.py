"""The bolted lap joint of ``demos/bolted_lap_joint.py`` by us and by CalculiX, on the same nodes.

Straight tetrahedra with quadratic displacements. Bolts are cut between shank and head and shortened there by
an imposed jump, without the spring of the demo; everything else is that of the demo: tightening, then a pull;
friction in five contacts. The discretisation of the contact is each program's own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import common
import numpy as np
import numpy.typing as npt
from peers import exchange
from scipy.spatial import cKDTree

from dolfinx_frontend import Options, Perfect, Problem, Scene, assemble, solve, sweep
from parts.lap_joint import LapJoint, lap_joint

Array = npt.NDArray[np.float64]
Solids = dict[str, exchange.Solid]

MISSING = 3
RTOL = 1e-5


def scene_of(demo: ModuleType, joint: LapJoint) -> Scene:
    """The scene of the demo, with bolts that are shortened by a jump between nodes."""
    scene: Scene = demo.build_scene(joint, demo.SHEAR * (demo.PULL, 0.0, 0.0))
    cut = Perfect(jump=demo.TIGHTEN * -demo.SHORTENING)
    for name in demo.CUTS:
        scene.interfaces[name] = replace(scene.interfaces[name], law=cut, space="auto")
    return scene


def what(demo: ModuleType, joint: LapJoint) -> dict[str, Any]:
    """The same in words, for another program."""
    kinds = ("contact", "perfect", "elastic", "symmetry")
    faces = {k: [(i.face1, i.face2) for i in joint.interfaces if i.kind == k] for k in kinds}
    return {
        "contacts": faces["contact"],
        "glued": faces["perfect"],
        "cuts": faces["elastic"],
        "friction": demo.FRICTION,
        "shortening": demo.SHORTENING,
        "planes": [face for face, _ in faces["symmetry"]],
        "held": ["lower:end"],
        "pulled": "upper:end",
        "pull": demo.PULL,
    }


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


def theirs(scene: Path) -> Any:
    """The answer of CalculiX; None if it is not there."""
    script = Path(__file__).parent / "peers" / "calculix_lap.py"
    file = scene.with_name(f"{scene.stem}_ccx.npz")
    command = [sys.executable, str(script), str(scene), str(file)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode == MISSING:
        return None
    if done.returncode:
        raise RuntimeError(f"calculix_lap.py failed:\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
    return np.load(file)


def joint_part(
    demo: ModuleType, size: str | float, n: int, solid: Any, folder: Path, theirs_too: bool = True
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
    scene = folder / "lap_scene.npz"
    bodies = {name: solid(part, (200e3, 0.3)) for name, part in joint.parts.items()}
    np.savez(scene, joint=json.dumps(what(demo, joint)), **exchange.arrays_of(bodies))
    found = theirs(scene) if theirs_too else None
    if found is None:
        return record
    away = 0.0
    for name, field in exact_u.items():
        nodes = problem.substructures[name].V.tabulate_dof_coordinates()
        near, place = cKDTree(found[f"{name}_points"]).query(nodes)
        assert near.max() < 1e-6, "other nodes"
        away = max(away, float(np.abs(found[f"{name}_u"][place] - field).max()))
    record["calculix"] = {
        "seconds": float(found["seconds"]),
        "iterations": int(found["iterations"]),
        "max_difference": away / largest,
        "load_difference": abs(float(found["load"]) / exact_load - 1.0),
        "seconds_of_sets": swept.converged.size * float(found["seconds"]),
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
