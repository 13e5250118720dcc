"""A hub pressed onto a shaft, then turned: does it slip, and with what probability?

    ./run python demos/press_fit.py      two parts, 12 000 unknowns, half a minute

Problem (N, mm, MPa)
    A shaft of 40 mm and a hub of 80 mm, 30 mm long, both steel, in a STEP file of nominal sizes: the solids
    touch. The shaft is 0.02 mm too large in radius, which scatters by 10 %; friction is 0.12 and scatters by
    15 %. The shaft is held at one end, and a torque of 600 Nm acts on the rim of the hub after the pressing.

Checks
    The mean pressure against Lame's of two thick cylinders, which have no ends; the safety against slip of
    the tables against mu p 2 pi b^2 L over the torque; P(slip) against that of the same formula.
"""

from __future__ import annotations

import argparse
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from parts.step_file import write_step

import dolfinx_frontend as lf

# a sample that slips turns far, and that it slips is all that is asked of it
warnings.filterwarnings("ignore", "interface 'shaft.hub': its faces slide")

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "press_fit"
E, RADIUS, OUTER, LENGTH, TORQUE = 210e3, 20.0, 40.0, 30.0, 600e3


def solids(occ: Any) -> dict[str, int]:
    """Shaft and hub; a CAD system writes such a file."""
    shaft = occ.addCylinder(0, 0, -20, 0, 0, 70, RADIUS)
    bore = (3, occ.addCylinder(0, 0, -1, 0, 0, LENGTH + 2, RADIUS))
    hub = occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, LENGTH, OUTER))], [bore])[0][0][1]
    return {"shaft": shaft, "hub": hub}


def assembled(file: Path) -> lf.Problem:
    """The parts, their fit and the torque."""
    step = lf.read_step(file)
    step.material("*", lf.LinearElastic(E=E, nu=0.3, yield_stress=355.0))
    step.size("*", 8.0)
    oversize = lf.Normal("oversize", 0.02, cov=0.1)        # of the radius
    friction = lf.LogNormal("friction", 0.12, cov=0.15)
    step.join("shaft|hub", lf.Contact(gap=-oversize, friction=friction))
    step.face("shaft:end", normal=(0, 0, -1), at=(None, None, -20))
    step.face("hub:rim", radius=OUTER)
    scene = step.scene()
    scene.fix("shaft:end")
    turning = lf.Amplitude([1, 2], [0, 1])                 # pressed at t = 1, turned from there on
    scene.force("hub:rim", moment=(0, 0, TORQUE * turning), name="torque")
    return lf.assemble(scene)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=int, default=256, help="a power of two")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    arguments = parser.parse_args()
    folder: Path = arguments.output
    problem = assembled(write_step(folder / "fit.step", solids))

    result = lf.solve(problem, times=[1.0, 1.5, 2.0])
    table = result.table("shaft|hub", step=None)
    print(table)
    lf.figures.interface_figure(
        result, "shaft|hub", folder / "press_fit.png", label="pressure (MPa)", view=(1, -1, 1.5)
    )
    lf.report(result, folder / "sheet.html", units=("mm", "N"))

    lame = E * 0.02 / (RADIUS * ((OUTER**2 + RADIUS**2) / (OUTER**2 - RADIUS**2) + 1.0))
    carries = 2.0 * math.pi * RADIUS**2 * LENGTH           # torque of a shear of 1
    pressure, safety = (table.value(each, "shaft|hub", time=2.0) for each in ("pressure_mean", "slip_safety"))
    print(f"mean pressure {pressure:.1f} MPa, Lame's {lame:.1f}; safety {safety:.2f}, by hand "
          f"{0.12 * lame * carries / TORQUE:.2f}")
    assert abs(pressure / lame - 1.0) < 0.08               # the ends of the hub press harder
    assert abs(safety / (0.12 * pressure * carries / TORQUE) - 1.0) < 0.03

    answer = lf.quasi_monte_carlo(problem, arguments.samples, times=[1.0, 2.0])
    slips = answer.quantity("shaft|hub.slip_safety").probability(below=1.01)
    print(answer)
    print("P(slip) =", slips)
    germs = np.random.default_rng(1).standard_normal((2, 100_000))
    friction = 0.12 / math.sqrt(1.0 + 0.15**2) * np.exp(math.sqrt(math.log(1.0 + 0.15**2)) * germs[1])
    by_hand = np.mean(friction * pressure * (1.0 + 0.1 * germs[0]) * carries < TORQUE)
    print(f"by hand {by_hand:.3f}")
    assert slips.low < by_hand < slips.high
    print("all checks passed")


if __name__ == "__main__":
    main()
