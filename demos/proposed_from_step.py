"""STEP files to tables in a few lines: bracket, pipe flange and motor mount with laws as proposed.

    ./run python demos/proposed_from_step.py             the bracket; or: flange, mount

Supports and loads are the only things that are said: what is a bolt, a nut or a gasket is recognised, and
its material, law, preload and mesh are proposed (``docs/step.md``). Checked: the balance of loads, reactions
and bolts.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from make_bracket_step import make_bracket
from make_flange_step import FlangeShape, make_flange
from make_mount_step import make_mount

import dolfinx_frontend as lf

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "proposed_from_step"
LATER = lf.Amplitude([1, 2], [0, 1])
"""Loads come after the tightening, which ends at t = 1."""
PRESSURE = 4.0


# [bracket]
def bracket(file: Path) -> lf.Scene:
    """Held from below, pulled at the back of its wall."""
    step = lf.read_step(file)
    step.face("base:below", normal=(0, 0, -1), near=(30, 0, -20))
    step.face("bracket:back", normal=(-1, 0, 0))
    scene = step.propose(scatter=False)
    scene.fix("base:below", name="support")
    scene.force("bracket:back", (0.0, LATER * 1500.0, LATER * 400.0), name="pull")
    return scene


# [flange]
def flange(file: Path) -> lf.Scene:
    """Held at its lower pipe; pressure inside, and its thrust on the end of the upper pipe."""
    shape = FlangeShape()
    step = lf.read_step(file)
    step.face("lower flange:end", normal=(0, 0, -1), near=(0, 0, -99))
    step.face("upper flange:end", normal=(0, 0, 1), near=(0, 0, 99))
    step.face("* flange:inside", radius=shape.bore)
    scene = step.propose(scatter=False)
    scene.fix("lower flange:end", name="support")
    for part in ("upper flange", "lower flange"):
        scene.pressure(f"{part}:inside", LATER * PRESSURE)
    scene.force("upper flange:end", (0.0, 0.0, LATER * PRESSURE * np.pi * shape.bore**2), name="thrust")
    return scene


# [mount]
def mount(file: Path) -> lf.Scene:
    """Held at the ends of its base, pushed sideways at a wall."""
    step = lf.read_step(file)
    step.material("foot", lf.LinearElastic(E=70e3, nu=0.33))
    step.material("gasket", lf.LinearElastic(E=200.0, nu=0.4))
    step.face("base:ends", where=lambda s: abs(abs(s.centre[0]) - 100.0) < 1e-6)
    step.face("foot:wall", normal=(-1, 0, 0), near=(-50, 0, 60))
    scene = step.propose(scatter=False)
    scene.fix("base:ends", name="support")
    scene.force("foot:wall", (LATER * 3000.0, 0.0, 0.0), point=(-50, 0, 60), name="side")
    return scene


# [end]
THRUST = PRESSURE * np.pi * FlangeShape().bore ** 2
Vector = tuple[float, float, float]
CASES: dict[str, tuple[Callable[[Path], Path], Callable[[Path], lf.Scene], Vector, str]] = {
    "bracket": (make_bracket, bracket, (0.0, 1500.0, 400.0), "bracket|base"),
    "flange": (make_flange, flange, (0.0, 0.0, THRUST), "upper flange|gasket"),
    "mount": (make_mount, mount, (3000.0, 0.0, 0.0), "gasket|foot"),
}
"""Name -> file, scene, load, and the joint that the bolts clamp."""


def balances(result: lf.HistoryResult, load: Vector, joint: str) -> Vector:
    """What support and load leave over; what bolts and joint leave over of the load; the mean bolt, N."""
    held = [result.table("support").value(f"force_{axis}", "support") for axis in "xyz"]
    rest = float(np.abs(np.add(held, load)).max() / np.linalg.norm(load))
    cuts = [name for name in result.problem.interfaces if "-|" in name and name.endswith("+")]
    bolts = sum(result.bolts().value("after", name) for name in cuts)
    interface = result.problem.interfaces[joint]
    pressed = float(interface.weights @ -result.force(joint)[-1][:, 0])
    return rest, (bolts - pressed - load[2]) / bolts, bolts / len(cuts)


def main() -> None:
    """Read, solve, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("case", nargs="?", choices=sorted(CASES), default="bracket")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    given = parser.parse_args()
    make, build, load, joint = CASES[given.case]
    given.output.mkdir(parents=True, exist_ok=True)
    file = make(given.output / f"{given.case}.step")
    began, spent = perf_counter(), process_time()
    problem = lf.assemble(build(file))
    result = lf.solve(problem, times=[1.0, 2.0])
    print(result.bolts())
    print(result.table(joint))
    rest, shared, bolt = balances(result, load, joint)
    print(f"{len(problem.substructures)} parts from file to tables in {perf_counter() - began:.0f} s, "
          f"{process_time() - spent:.0f} s of the processor beside those of gmsh")
    print(f"support and load: {rest:.1e}; bolts, joint and load: {shared:.1e}")
    print(f"mean bolt {1e-3 * bolt:.2f} kN")
    assert result.converged
    assert rest < 1e-6 and abs(shared) < 1e-6
    print("all checks passed")


if __name__ == "__main__":
    main()
