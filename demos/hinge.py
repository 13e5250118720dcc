"""A hinge with a pin that has play: who carries, where it slips, and how far it turns freely.

    ./run python demos/hinge.py      three parts, 16 000 unknowns, ten seconds

Problem (N, mm, MPa)
    A fork with two lugs, an eye between them and a pin of 20 mm, all steel, in a STEP file of nominal sizes.
    The pin is smaller than its holes: the radial play is between 0.01 and 0.05 mm. Friction is 0.15. The fork
    is held, and the eye is pulled with 20 kN.

Checks
    Each lug takes half of the pull; the pin is in balance; the more play, the less of the eye touches.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from parts.step_file import write_step

import dolfinx_frontend as lf

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "hinge"
PULL, RADIUS = 20e3, 10.0


def solids(occ: Any) -> dict[str, int]:
    """Fork, eye and pin; a CAD system writes such a file."""

    def round_(low: float, high: float, radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(0, 0, low, 0, 0, high - low, radius)

    def lug(low: float, high: float, start: float) -> list[tuple[int, int]]:
        bar = 3, occ.addBox(start, -20, low, 60, 40, high - low)
        return list(occ.fuse([bar], [round_(low, high, 20)])[0])

    web = 3, occ.addBox(-60, -20, 0, 20, 40, 32)
    fork = occ.fuse(lug(0, 8, -60), [*lug(24, 32, -60), web])[0]
    fork = occ.cut(fork, [round_(-1, 33, RADIUS)])[0][0][1]
    eye = occ.cut(lug(9, 23, 0), [round_(8, 24, RADIUS)])[0][0][1]
    return {"fork": fork, "eye": eye, "pin": round_(-2, 34, RADIUS)[1]}


def assembled(file: Path) -> lf.Problem:
    """The parts, the play and the pull."""
    step = lf.read_step(file)
    step.material("*", lf.LinearElastic(E=210e3, nu=0.3))
    step.size("*", 8.0)
    step.size("pin", 5.0)
    play = lf.Uniform("play", 0.01, 0.05)                  # radial, the same on both lugs and the eye
    step.join("*", lf.Contact(gap=play, friction=0.15))
    step.face("fork:wall", normal=(-1, 0, 0), at=(-60, None, None))
    step.face("eye:end", normal=(1, 0, 0), at=(60, None, None))
    scene = step.scene()
    scene.fix("fork:wall")
    scene.force("eye:end", (PULL, 0, 0), name="pull")
    return lf.assemble(scene)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=int, default=16, help="a power of two")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    arguments = parser.parse_args()
    folder: Path = arguments.output
    problem = assembled(write_step(folder / "hinge.step", solids))

    result = lf.solve(problem)
    table = result.table("*pin*")
    print(table)
    picture = folder / "hinge.png"
    lf.figures.interface_figure(result, "eye|pin", picture, hide=["fork", "pin"], view=(-1, -1, 1))
    lf.report(result, folder / "sheet.html", units=("mm", "N"))
    lugs = [table.value("force_x", name) for name in ("fork|pin", "fork|pin#2")]
    assert np.allclose(lugs, 0.5 * PULL, rtol=1e-3)
    assert abs(table.value("force_x", "eye|pin") + PULL) < 1e-3 * PULL

    answer = lf.quasi_monte_carlo(problem, arguments.samples)
    touches = 1.0 - answer.quantity("eye|pin.open_area").values / table.value("area", "eye|pin")
    presses, slip = (answer.quantity(f"eye|pin.{each}") for each in ("pressure_max", "slip"))
    print(answer)
    print(f"of the eye {touches.min():.0%} to {touches.max():.0%} touch; pressure up to "
          f"{presses.values.min():.0f} to {presses.values.max():.0f} MPa")
    print("P(slip > 0.02 mm) =", slip.probability(above=0.02))
    assert np.all(np.diff(touches[np.argsort(answer.germs[:, 0])]) <= 0.0)
    print("all checks passed")


if __name__ == "__main__":
    main()
