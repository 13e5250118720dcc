"""From CAD to ParaView: an L-bracket on two bolts, and the probability that it slips.

    ./run python demos/bracket_from_step.py
    ./run python demos/bracket_from_step.py --quick     a coarse mesh, 16 samples

The tutorial ``docs/tutorials/bracket.md`` goes through it step by step.

Problem
    A bracket of steel is clamped on a base plate by two M8 bolts of 15 kN each. A force of 1.5 kN along
    y and 0.4 kN upwards pulls at its wall: it pushes the foot aside, turns it, and lifts it. The STEP
    file has four solids; each bolt is cut in two for its pretension section.

Laws (N, mm, MPa)
    foot on base           Contact, friction 0.15
    bolt heads on foot     glued: they are rough and pressed hardest
    threads                glued
    shanks in their holes  0.5 mm of clearance, no interface
    bolts                  Preload: 15 kN until t = 1, constant length after that; load from t = 1 to t = 2

Random variables
    Both preloads (normal, 12 %, independent) and the friction of the foot (lognormal, 15 %). The bracket
    slips where the whole contact is at its friction limit: the use of friction reaches 1.

Checks
    balance of load and reaction; the preload that was asked for; the use of friction, summed up by hand.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np
from make_bracket_step import HEIGHT, make_bracket

import dolfinx_frontend as lf

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "bracket_from_step"

# [read]
PRELOAD, FRICTION, LOAD = 15e3, 0.15, (0.0, 1500.0, 400.0)
BOLTS = ("bolt 1-|bolt 1+", "bolt 2-|bolt 2+")
FOOT = "bracket|base"


def read(file: Path, size: float) -> lf.StepAssembly:
    """The STEP file with its materials, mesh sizes and laws."""
    step = lf.read_step(file, cuts=lf.Cut("bolt *", normal=(0, 0, 1), through=(0, 0, 4)))
    step.material("*", lf.LinearElastic(E=210e3, nu=0.3))
    step.size("*", size)
    step.size("bolt *", 0.5 * size)
    step.size(FOOT, 0.7 * size)
    step.face("base:below", normal=(0, 0, -1), at=(None, None, -20))
    step.face("bracket:back", normal=(-1, 0, 0))
    step.join("*", lf.Perfect())
    step.join(FOOT, lf.Contact(gap=0.0, friction=FRICTION))
    step.join("bolt *-|bolt *+", lf.Preload(PRELOAD, until=1.0))
    return step


# [scene]
def assembled(step: lf.StepAssembly) -> lf.Problem:
    """Meshed, held from below, pulled at the back of its wall after the tightening."""
    scene = step.scene()
    scene.fix("base:below", name="support")
    later = lf.Amplitude([1, 2], [0, 1])
    scene.force("bracket:back", tuple(later * each if each else 0.0 for each in LOAD), name="pull")
    return lf.assemble(scene)


# [uncertain]
def uncertain(problem: lf.Problem) -> lf.Problem:
    """The same meshes and factors with laws that scatter."""
    mu = lf.LogNormal("mu", mean=FRICTION, cov=0.15)
    laws: dict[str, lf.Law] = {FOOT: lf.Contact(gap=0.0, friction=mu)}
    for k, name in enumerate(BOLTS, start=1):
        laws[name] = lf.Preload(lf.Normal(f"F{k}", mean=PRELOAD, cov=0.12), until=1.0)
    return problem.with_laws(laws)


# [end]
def balance(result: lf.HistoryResult) -> float:
    """What the support and the pull leave over, relative to the pull."""
    table = result.table("support")
    held = [table.value(f"force_{axis}", "support") for axis in "xyz"]
    return float(np.abs(np.add(held, LOAD)).max() / np.linalg.norm(LOAD))


def used(problem: lf.Problem, result: lf.HistoryResult) -> float:
    """Tangential force over friction limit, summed over the points of the foot at the end."""
    force, area = result.force(FOOT)[-1], problem.interfaces[FOOT].weights
    return float(area @ np.linalg.norm(force[:, 1:], axis=1) / (FRICTION * area @ -force[:, 0]))


def main() -> None:
    """Read, mesh, solve, sample, draw, write, check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="coarse, 16 samples")
    parser.add_argument("--size", type=float, default=None, help="cells in mm")
    parser.add_argument("--samples", type=int, default=None, help="a power of two")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true")
    given = parser.parse_args()
    size = given.size or (15.0 if given.quick else 9.0)
    samples = given.samples or (16 if given.quick else 128)
    out, began = given.output, perf_counter()

    step = read(make_bracket(out / "bracket.step"), size)
    print(step)
    problem = assembled(step)
    unknowns = sum(len(s.load) for s in problem.substructures.values())
    print(f"\n{len(problem.substructures)} parts, {unknowns} unknowns")

    result = lf.solve(problem, times=[1.0, 1.25, 1.5, 1.75, 2.0])
    print(f"{result.status} after {result.iterations} iterations, estimated error {result.error:.0e}\n")
    print(result.table(FOOT, step=None))
    print(result.bolts())
    bolt = lf.Resultant(BOLTS[0])
    accurate = lf.solve(problem, times=[1.0, 2.0], accuracy=1e-2, quantity=bolt)
    print(f"\n{result.errors()}\n\n{accurate.errors(bolt)}\nsolved after {perf_counter() - began:.0f} s")

    answer = lf.quasi_monte_carlo(uncertain(problem), samples, times=[1.0, 2.0], progress=False)
    use = answer.quantity(f"{FOOT}.slip_use", "use of friction")
    slips = use.probability(above=0.999)
    print(f"\n{use}\nP(slip) = {slips}\nsampled after {perf_counter() - began:.0f} s\n")

    sheet = lf.report(
        answer, out / "bracket.html", units=("mm", "N"), stress_area=36.6, pictures=not given.no_figures
    )
    print("\n".join(sheet.sentences))
    paths = [*lf.io.write(result, out), out / "bracket.html"]
    if not given.no_figures:
        figures = lf.figures
        shown = {"bracket": 25.0, "bolt 1-": 45.0, "bolt 2-": 45.0, "bolt 1+": 60.0, "bolt 2+": 60.0}
        meshes = step.mesh(progress=False)
        start = np.array([-3.0, 0.0, HEIGHT / 2])  # beside the wall's back
        pull = [(start, start + 40.0 * np.array(LOAD) / np.linalg.norm(LOAD))]
        paths.append(figures.assembly_figure(meshes, out / "parts.png", lift=shown, arrows=pull))
        label, limits = "von Mises stress (MPa)", (0.0, 200.0)
        paths.append(
            figures.stress_figure(result, out / "mises.png", label=label, limits=limits, arrows=pull)
        )
        paths.append(figures.interface_figure(result, FOOT, out / "pressure.png", label="pressure (MPa)"))
        paths.append(figures.interface_figure(result, FOOT, out / "state.png", quantity="state"))
        paths.append(
            figures.density_figure(
                {}, out / "use.png", "use of friction of the foot", samples=use.values, threshold=0.999
            )
        )
    print("\n" + "\n".join(f"wrote {path.name}" for path in paths))
    print(f"they are in {out}; {perf_counter() - began:.0f} s in all")

    told = result.table(FOOT).value("slip_use", FOOT)
    bolts = result.bolts()
    assert result.converged and accurate.converged and answer.converged
    assert balance(result) < 1e-6, f"support and pull: {balance(result):.1e}"
    assert all(abs(bolts.value("before", name) / PRELOAD - 1.0) < 1e-4 for name in BOLTS)
    assert abs(used(problem, result) / told - 1.0) < 1e-6, "no point is open and pulls"
    assert 0.0 < slips.value < 1.0
    print("all checks passed")


if __name__ == "__main__":
    main()
