"""A law of your own: a gasket that stiffens as it is squeezed, between two bolted plates.

    ./run python demos/own_law.py

Problem
    The plates and the bolt of ``first_bolt.py`` with a soft gasket between them: its pressure grows
    exponentially with how far it is closed, and it does not hold when it is pulled. No built-in law does
    that.

Laws (N, mm, MPa)
    gasket   p = p0 (exp(c / h) - 1) for a closing c > 0, else 0; p0 = 4 MPa, h = 0.02 mm
    bolt     tightened to 20 kN until t = 1, then its length is kept; the load pulls from t = 1 to 2

Random variable
    h, lognormal, 20 %: gaskets of one delivery. The joint leaks where less than 10 kN press on the gasket.

Checks
    Forces of bolt and gasket against the scalar equation of the joint; the probability against the point at
    which that equation says 10 kN.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import norm

import dolfinx_frontend as lf

Array = npt.NDArray[np.float64]
OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "own_law"
AREA, THICK, E = 900.0, 20.0, 200e3
PRELOAD, LOAD, LEAK = 20e3, 14e3, 10e3
P0, SOFT, COV = 4.0, 0.02, 0.2
BOLT = lf.BoltStiffness.vdi2230(d=12.0, pitch=1.75, shank=25.0, thread=15.0, E=205e3)


# [law]
def gasket(jump: Array, *, pressure: Array, depth: Array) -> Array:
    """Force on side 1, (points, 1, columns): closing is a negative jump, pressing a negative force."""
    closing = np.maximum(-jump, 0.0)
    return -pressure[:, None] * np.expm1(closing / depth[:, None])


# [scene]
def joint(depth: Any, load: float) -> lf.Problem:
    """Two plates, the gasket between them, the bolt in parallel."""
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", THICK)):
        plate = lf.geometry.box((30.0, 30.0, THICK), (2, 2, 1), origin=(0.0, 0.0, z), cell="hexahedron")
        scene.substructure(name, plate, lf.LinearElastic(E=E, nu=0.0), degree=1)
    law = lf.UserLaw(force=gasket, values={"pressure": P0, "depth": depth}, components="normal")
    scene.interface("gasket", "lower:z1", "upper:z0", law)
    scene.beam("bolt", "lower:z0", "upper:z1", BOLT, lf.Preload(PRELOAD, until=1.0))
    scene.fix("lower:z0")
    scene.traction("upper:z1", lf.Amplitude([1, 2], [0, 1]) * (0.0, 0.0, load / AREA))
    return lf.assemble(scene)


# [end]
def by_hand(load: float, depth: float) -> float:
    """Force on the gasket: the change of the bolt's length is that of plates and gasket."""
    plates = E * AREA / (2.0 * THICK)

    def closing(force: float) -> float:
        return depth * float(np.log1p(force / (AREA * P0)))

    def off(force: float) -> float:
        bolt = (force + load - PRELOAD) / BOLT.axial
        return bolt - (PRELOAD - force) / plates - (closing(PRELOAD) - closing(force))

    return max(0.0, float(brentq(off, -0.9 * AREA * P0, PRELOAD, xtol=1e-9)))


def main() -> None:
    """Load, draw, sample, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    given = parser.parse_args()

    load = np.linspace(0.0, LOAD, 8)
    problem = joint(SOFT, LOAD)
    result = lf.solve(problem, times=1.0 + load / LOAD, options=lf.Options(rtol=1e-9))
    bolt = result.force("bolt.axial")[:, 0, 0]
    pressing = -result.force("gasket")[..., 0] @ problem.interfaces["gasket"].weights
    exact = np.array([by_hand(each, SOFT) for each in load])
    print("   load    bolt  gasket  by hand    kN")
    for row in zip(load, bolt, pressing, exact, strict=True):
        print(" {:6.2f}  {:6.3f}  {:6.3f}  {:6.3f}".format(*(1e-3 * x for x in row)))

    scatter = joint(lf.LogNormal("h", mean=SOFT, cov=COV), LOAD)
    answer = lf.quasi_monte_carlo(scatter, 512, times=[1.0, 2.0], progress=False)
    left = answer.quantity("gasket.normal", "force across the gasket", "N")
    leaks = left.probability(above=-LEAK)
    # the force grows with h: the joint leaks below the one that gives 10 kN
    limit = float(brentq(lambda h: by_hand(LOAD, h) - LEAK, 0.2 * SOFT, 5.0 * SOFT))
    spread = np.sqrt(np.log1p(COV**2))
    law = float(norm.cdf((np.log(limit / SOFT) + 0.5 * spread**2) / spread))
    print(f"\nP(less than {LEAK:g} N) = {leaks}, exact {law:.4f}")

    path = given.output / "own_law.png"
    lf.figures.joint_diagram(load, bolt, pressing, path, stiffness=BOLT.axial)
    print(f"wrote {path.name}, in {given.output}")
    assert result.converged and answer.converged
    assert np.allclose(pressing, exact, rtol=1e-5) and np.allclose(bolt - pressing, load, atol=1e-4 * PRELOAD)
    assert abs(leaks.value - law) < 2.0 / 512, "the points of Sobol in one dimension miss by 1 / N"


if __name__ == "__main__":
    main()
