"""The flange sector of the bolted vessel by us and by CalculiX, on the same nodes.

1/16 of a vessel with a screwed cover: six parts, true contact with friction between ring and cover. Straight
tetrahedra with quadratic displacements. The half screw is shortened by an imposed jump, without the spring of
the demo; then the pressure comes. The discretisation of the contact is each program's own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import common
import numpy as np
from _joint import Array
from peers import calculix

from dolfinx_frontend import Amplitude, Contact, Options, Perfect, Problem, assemble, solve, sweep
from parts.vessel import BoltedVessel, bolted_vessel

FRICTION, SHORTENING, PRESSURE = 0.2, 0.04, 0.8  # mm, MPa
TIMES = (1.0, 2.0)
RTOL = 1e-5


def problem_of(demo: ModuleType, vessel: BoltedVessel) -> Problem:
    """The scene of the demo with contact under the cover, and a screw that is shortened by a jump."""
    pressure = Amplitude([1, 2], [0, 1]) * PRESSURE
    scene = demo.vessel_scene(vessel, joint=Contact(friction=FRICTION), pressure=pressure)
    cut = Perfect(jump=-SHORTENING)
    scene.interfaces["screw"] = replace(scene.interfaces["screw"], law=cut, space="auto")
    scene.interfaces["joint"] = replace(scene.interfaces["joint"], space="auto")
    return assemble(scene)


def bolt(problem: Problem, answer: Any) -> Array:
    """Force of the half screw, N, at every time (or point and time)."""
    return np.asarray(answer.force("screw")[..., 0] @ problem.interfaces["screw"].weights)


def ours(problem: Problem, rtol: float) -> tuple[dict[str, Array], float, Any]:
    """Displacements (nodes, 3) with pressure, force of the half screw, and the result."""
    options = Options(rtol=rtol, max_iterations=10000)
    result = solve(problem, times=TIMES, active=["screw"], options=options)
    u = {name: field[-1].reshape(-1, 3) for name, field in result.displacements.items()}
    return u, float(bolt(problem, result)[-1]), result


def sector_part(demo: ModuleType, size: str | float, n: int, folder: Path) -> dict[str, Any]:
    """One run, n^2 sets of friction and shortening, and one run of CalculiX."""
    vessel = bolted_vessel(size, geometry_order=1)
    began = perf_counter()
    problem = problem_of(demo, vessel)
    setup = perf_counter() - began
    began = perf_counter()
    u, force, result = ours(problem, RTOL)
    run = perf_counter() - began
    exact_u, exact_force, exact = ours(problem, 1e-9)
    largest = max(float(np.abs(field).max()) for field in exact_u.values())
    began = perf_counter()
    sets = {"joint.friction": np.linspace(0.1, 0.3, n), "screw.jump": -SHORTENING * np.linspace(0.5, 1.5, n)}
    loose = Options(rtol=5e-5, max_iterations=10000)
    swept = sweep(problem, sets, times=TIMES, options=loose, keep_fields=False)
    many = perf_counter() - began
    record: dict[str, Any] = {
        "size": size,
        "dof": problem.size,
        "status": [result.status, exact.status],
        "iterations": result.iterations,
        "seconds": setup + run,
        "error_displacement": max(float(np.abs(u[k] - f).max()) for k, f in exact_u.items()) / largest,
        "error_bolt": abs(force / exact_force - 1.0),
        "bolt": force,
        "open": result.table("joint").value("open_area", "joint") / problem.interfaces["joint"].area,
        "sets": int(swept.converged.size),
        "converged": int(swept.converged.sum()),
        "seconds_of_sets": setup + many,
        "calculix": None,
    }
    found = calculix.run(problem, TIMES, folder / "sector.inp")
    if found is None:
        return record
    away = max(float(np.abs(found.u[name] - field).max()) for name, field in exact_u.items())
    there = float(np.linalg.norm(found.forces[calculix.set_of("screw")]))
    record["calculix"] = {
        "seconds": found.seconds,
        "iterations": found.iterations,
        "max_difference": away / largest,
        "bolt_difference": abs(there / exact_force - 1.0),
    }
    return record


def report(record: dict[str, Any]) -> str:
    """A table for a page."""
    many = f"{record['seconds_of_sets']:.1f} s, {record['converged']} of {record['sets']} converged"
    rows = [
        [
            "latin-core",
            f"{record['error_displacement']:.0e} (true)",
            f"{record['error_bolt']:.0e} (true)",
            f"{record['seconds']:.1f} s, {record['iterations']} iterations",
            many,
        ]
    ]
    if (other := record["calculix"]) is not None:
        rows.append(
            [
                "CalculiX 2.20",
                f"{100 * other['max_difference']:.2f} % away",
                f"{100 * other['bolt_difference']:.2f} % away",
                f"{other['seconds']:.1f} s, {other['iterations']} iterations",
                f"{other['seconds'] * record['sets'] / 3600.0:.1f} h (times one run)",
            ]
        )
    title = f"flange sector, {record['dof']} unknowns"
    header = [title, "displacement", "force of the screw", "one run", f"{record['sets']} sets"]
    table: str = common.markdown_table(header, rows)
    return table
