"""A bonded lap joint and measured data: what do the data say, and does the joint hold?

    ./run python demos/bonded_lap_joint.py

Problem
    Half of a double lap joint: two strips of aluminium, 1.6 mm thick, overlap by 12.5 mm, with 0.2 mm of
    adhesive between them. An extensometer over the overlap measured 12 specimens at 2 kN. The table in this
    file is made up: drawn with G = 700 MPa and a noise of 0.2 micrometres, so that the answer is known.

Laws (N, mm, MPa; plane stress, forces per mm of the width of 25 mm)
    strips       E = 70 000 MPa, nu = 0 (as in the closed form)
    adhesive     Elastic: G / t in shear, 2.6 G / t across, with t = 0.2 mm

Random variable
    G / t, lognormal with mean 4 500 N/mm^3 and 30 % before the measurements: what data sheets allow. After
    them the posterior, which goes into the next scene as it is.

Checks
    The posterior holds the value that the data were drawn with; the shear along the overlap is Volkersen's.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import dolfinx_frontend as lf
from dolfinx_frontend.figures.canvas import save, sheet

Array = npt.NDArray[np.float64]
OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "bonded_lap_joint"
E, THICK, LENGTH, OVERLAP, WIDTH = 70e3, 1.6, 50.0, 12.5, 25.0
FORCE, SERVICE = 2000.0, 6000.0  # N, of the test and in service
GAUGE = 5.0  # mm, the extensometer's ends beyond the overlap
NOISE = 2e-4  # mm
TRUE = 3500.0  # N/mm^3, of which a user would not know
STRENGTH = 30.0  # MPa, in shear

# [data]
ELONGATION = [  # mm, between the ends of the extensometer, 12 specimens
    0.014979, 0.015039, 0.014924, 0.014801, 0.014888, 0.014780,
    0.014991, 0.015247, 0.014880, 0.014855, 0.015077, 0.015050,
]  # fmt: skip


# [scene]
def bonded(stiffness: Any, force: float) -> lf.Problem:
    """Two strips, their outer faces guided (the middle planes of a double lap joint), pulled by a force."""
    scene = lf.Scene()
    start = LENGTH - OVERLAP
    cells = (80, 4)
    for name, at in (("lower", (0.0, 0.0)), ("upper", (start, THICK))):
        strip = lf.geometry.box((LENGTH, THICK), cells, origin=at, cell="quadrilateral")
        scene.substructure(name, strip, lf.LinearElastic(E=E, nu=0.0, plane="stress"), degree=2)
    adhesive = lf.Elastic(normal=2.6 * TRUE, tangential=stiffness)
    scene.interface("adhesive", "lower:y1", "upper:y0", adhesive, overlap="partial")
    scene.fix("lower:x0", components=0)
    scene.fix("lower:y0", components=1)
    scene.fix("upper:y1", components=1)
    scene.force("upper:x1", (force / WIDTH, 0.0), name="pull")
    return lf.assemble(scene)


def elongation(problem: lf.Problem) -> Any:
    """What the extensometer reads, as a quantity."""
    start = LENGTH - OVERLAP
    left = lf.AtPoint(problem, "lower", (start - GAUGE, 0.5 * THICK), component="x")
    right = lf.AtPoint(problem, "upper", (LENGTH + GAUGE, 1.5 * THICK), component="x")
    return lambda fields: right(fields) - left(fields)


def shear_along(problem: lf.Problem, fields: Any) -> tuple[Array, Array]:
    """Places along the overlap from its middle (m,), and the shear there (..., m)."""
    interface = problem.interfaces["adhesive"]
    x = interface.points[:, 0] - (LENGTH - 0.5 * OVERLAP)
    order = np.argsort(x)
    return x[order], np.abs(fields.force("adhesive")[..., order, 1])


def volkersen(x: Array, k: float, force: float) -> Array:
    """Shear of two equal strips that only stretch, joined by springs k per area."""
    w = np.sqrt(2.0 * k / (E * THICK))
    return np.asarray(0.5 * force / WIDTH * w * np.cosh(w * x) / np.sinh(0.5 * w * OVERLAP))


# [end]
def main() -> None:
    """Calibrate, predict, draw, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    given = parser.parse_args()

    before = lf.LogNormal("k", mean=4500.0, cov=0.3)
    rig = bonded(before, FORCE)
    posterior = lf.calibrate(rig, elongation(rig), ELONGATION, NOISE, samples=256)
    print(posterior)
    after = posterior.random()["k"]

    joint = bonded(after, SERVICE)
    answer = lf.quasi_monte_carlo(joint, 256, progress=False)
    peak = answer.quantity(lambda f: shear_along(joint, f)[1].max(axis=-1), "largest shear", "MPa")
    print(f"\nin service, {SERVICE:g} N\n{peak}")
    print(f"P(shear > {STRENGTH:g} MPa) = {peak.probability(above=STRENGTH)}")
    prior = lf.quasi_monte_carlo(bonded(before, SERVICE), 256, progress=False)
    unmeasured = prior.quantity(lambda f: shear_along(joint, f)[1].max(axis=-1), "largest shear", "MPa")
    print(f"without the measurements   {unmeasured.probability(above=STRENGTH)}")

    nominal = lf.solve(bonded(TRUE, FORCE))
    x, tau = shear_along(nominal.problem, nominal)
    closed = volkersen(x, TRUE, FORCE)
    figure = sheet(9.6, 4.0)
    left, right = figure.subplots(1, 2)
    drawn = ((unmeasured, "before the measurements", "#d55e00"), (peak, "after", "#0072b2"))
    for values, name, colour in drawn:
        abscissae, density = values.density()
        left.plot(abscissae, density, color=colour, lw=2.0, label=name)
    left.axvline(STRENGTH, color="black", ls="--", lw=1.0, label="strength")
    left.set_xlabel(f"largest shear at {SERVICE:g} N (MPa)")
    left.set_ylabel("density (1/MPa)")
    right.plot(x, tau, color="#0072b2", lw=2.0, label="computed")
    right.plot(x, closed, color="black", ls="--", lw=1.2, label="Volkersen")
    right.set_xlabel("along the overlap (mm)")
    right.set_ylabel(f"shear of the adhesive at {FORCE:g} N (MPa)")
    for axis in (left, right):
        axis.grid(alpha=0.25)
        axis.set_ylim(bottom=0.0)
        axis.legend()
    path = save(figure, given.output / "bonded.png")
    print(f"\nwrote {path.name}, in {path.parent}")

    mean, deviation = posterior.mean("k").value, posterior.std("k")
    assert abs(mean - TRUE) < 3.0 * deviation, f"{mean:.0f} +- {deviation:.0f}, drawn with {TRUE:g}"
    middle = np.abs(x) < 0.4 * OVERLAP
    off = float(np.abs(tau[middle] / closed[middle] - 1.0).max())
    print(f"Volkersen within {off:.1%} over the middle 80 % of the overlap")
    assert off < 0.1, "strips that also shear: some percent"


if __name__ == "__main__":
    main()
