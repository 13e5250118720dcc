"""The first bolt: two plates, an M12 that clamps them, a load that pulls them apart.

    ./run python demos/first_bolt.py

Problem
    Two steel plates of 30 x 30 x 20 mm lie on each other. A bolt, a beam between the face under its head
    and the face under its nut, is tightened to 20 kN; then a force on the upper plate pulls them apart.
    While the joint is closed the bolt takes only a small share of the load: its own stiffness over that
    of bolt and plates together. Once it is open, the bolt takes all.

Choices
    nu = 0 and a load spread over the face under the head: the plates are in uniaxial stress, and the
    diagram of the joint is known in closed form, VDI 2230's with load introduction factor 1.

Random variable
    The preload, normal, coefficient of variation 15 % (a torque wrench). The joint opens where the load is
    more than it can carry: P = Phi(((1 - phi) F - 20 kN) / 3 kN).

Pulled from the side
    The same joint with nu = 0.3, a finer mesh and the load on a side face: it opens at one edge first,
    and the bolt takes more of the load than the diagram says. Pictures of the von Mises stress and of
    the state.

Checks
    Bolt force against load, closed and open; the probability of an opening against its closed form.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

import dolfinx_frontend as lf

AREA, THICK, E = 30.0 * 30.0, 20.0, 200e3  # mm^2, mm, MPa
PRELOAD, SCATTER = 20e3, 0.15  # N
LOAD = 16e3  # N, for the probability
SIDE_LOAD = 8e3  # N
BOLT = lf.BoltStiffness.vdi2230(d=12.0, pitch=1.75, shank=25.0, thread=15.0, E=205e3)
OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "first_bolt"


def joint(preload: Any, load: float, side: bool = False) -> lf.Problem:
    """The plates, tightened until t = 1, loaded from t = 1 to 2, on the side or on top."""
    cells, degree, nu = ((8, 8, 4), 2, 0.3) if side else ((2, 2, 2), 1, 0.0)
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", THICK)):
        plate = lf.geometry.box((30.0, 30.0, THICK), cells, origin=(0.0, 0.0, z), cell="hexahedron")
        scene.substructure(name, plate, lf.LinearElastic(E=E, nu=nu), degree=degree)
    scene.interface("joint", "lower:z1", "upper:z0", lf.Contact(friction=0.2))
    scene.beam("bolt", "lower:z0", "upper:z1", BOLT, lf.Preload(preload, until=1.0))
    scene.fix("lower:z0")
    face, area = ("upper:x1", 30.0 * THICK) if side else ("upper:z1", AREA)
    scene.traction(face, lf.Amplitude([1, 2], [0, 1]) * (0.0, 0.0, load / area))
    return lf.assemble(scene)


def forces(problem: lf.Problem, fields: Any) -> tuple[Any, Any]:
    """Of the bolt and between the plates, N, (..., times)."""
    weights = problem.interfaces["joint"].weights
    return fields.force("bolt.axial")[..., 0, 0], -fields.force("joint")[..., 0] @ weights


def main() -> None:
    """Load, draw, sample, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true", help="no pictures of solids")
    given = parser.parse_args()
    plates = E * AREA / (2.0 * THICK)
    share = BOLT.axial / (BOLT.axial + plates)

    load = np.sort(np.append(np.linspace(0.0, 30e3, 13), PRELOAD / (1.0 - share)))  # and where it opens
    problem = joint(PRELOAD, load[-1])
    result = lf.solve(problem, times=1.0 + load / load[-1], options=lf.Options(rtol=1e-9))
    bolt, clamping = forces(problem, result)
    closed = (1.0 - share) * load <= PRELOAD
    exact = np.where(closed, PRELOAD + share * load, load)
    print(f"stiffness of the bolt {BOLT.axial:.4g} N/mm, of the plates {plates:.4g} N/mm: the bolt takes")
    print(f"{share:.4f} of the load until {1e-3 * PRELOAD / (1.0 - share):.2f} kN, and all of it above\n")
    print("   load    bolt   exact   between the plates    kN")
    for row in zip(load, bolt, exact, clamping, strict=True):
        print(" {:6.2f}  {:6.3f}  {:6.3f}  {:6.3f}".format(*(1e-3 * x for x in row)))

    uncertain = joint(lf.Normal("F_V", PRELOAD, cov=SCATTER), LOAD)
    answer = lf.quasi_monte_carlo(uncertain, 1024, times=[1.0, 2.0], progress=False)
    chance = answer.quantity("joint.open_area", unit="mm^2").probability(above=0.0)
    law = float(norm.cdf(((1.0 - share) * LOAD - PRELOAD) / (SCATTER * PRELOAD)))
    print(f"\nload {LOAD:g} N, preload scatters by {SCATTER:.0%}: P(open) = {chance}, exact {law:.4f}")

    gaping = joint(PRELOAD, SIDE_LOAD, side=True)
    from_side = lf.solve(gaping, times=[1.0, 1.5, 2.0])
    print(f"\npulled from the side with {SIDE_LOAD:g} N")
    print(from_side.table(["joint", "bolt.axial"], step=None))

    figures, out = lf.figures, given.output
    figures.joint_diagram(load, bolt, clamping, out / "joint_diagram.png", stiffness=BOLT.axial)
    if not given.no_figures:
        figures.stress_figure(from_side, out / "plates_mises.png", label="von Mises stress (MPa)")
        figures.interface_figure(from_side, "joint", out / "plates_state.png", quantity="state")
    print(f"figures are in {out}")
    assert result.converged and answer.converged and from_side.converged
    assert np.allclose(bolt, exact, rtol=1e-6) and np.allclose(bolt - clamping, load, atol=1e-6 * PRELOAD)
    assert abs(chance.value - law) < 2.0 / 1024, "the points of Sobol in one dimension miss by 1 / N"


if __name__ == "__main__":
    main()
