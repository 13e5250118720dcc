"""The bolted vessel with a joint whose stiffness varies at random from place to place.

    ./run python demos/random_field_joint.py [--size paper] [--order 2] [--output DIR]

A glued or gasketed joint is not equally stiff everywhere. Here the joint's stiffness per area is a lognormal
random field of mean 100 N/mm^3 and coefficient of variation 0.3, with an exponential covariance of length 20
mm, which is shorter than the modelled sector of 39 mm by 20 mm. The Karhunen-Loeve modes of the field are
computed at the interface points and truncated at 80 % of the variance; the amplitude of each mode is a random
variable (germ). (Symmetry about the sector's planes makes the field periodic around the vessel; this is an
example, not a statement about real gaskets.)

Every point of the interface has its own Galerkin matrix of size P + 1, which is diagonalised once. In its
eigenbasis the modes decouple, and the local stage is that of P + 1 deterministic springs. At its end the
script compares the answer with monolithic SSFEM.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

from dolfinx_frontend import Chaos, Options, RandomField, assemble, figures, reference, solve
from parts.vessel import bolted_vessel

from bolted_vessel import vessel_scene

ROOT = Path(__file__).resolve().parents[1]

parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("--size", default="coarse", help="coarse, paper, or a cell size in mm")
parser.add_argument("--order", type=int, default=2, help="order of the chaos")
parser.add_argument("--output", type=Path, default=ROOT / "build" / "demo" / "random_field_joint")
parser.add_argument("--no-figures", action="store_true")
given = parser.parse_args()
size = given.size if given.size in ("coarse", "paper") else float(given.size)

# --- scene -------------------------------------------------------------------------------------------
vessel = bolted_vessel(size)
field = RandomField(
    "joint",
    mean=100.0,  # N/mm^3
    cov=0.3,
    covariance="exponential",
    length=20.0,  # mm
    variance_captured=0.8,
    distribution="lognormal",
)
problem = assemble(vessel_scene(vessel, joint=field))

# --- LATIN-PCE ---------------------------------------------------------------------------------------
chaos = Chaos(given.order)
result = solve(problem, chaos=chaos, options=Options(rtol=1e-9))
print(result.plan)
modes = result.random.sources["joint", "normal"]
print(f"\n{len(modes.eigenvalues)} Karhunen-Loeve modes hold {100 * modes.captured:.1f} % of the variance")
print(result)

# --- monolithic SSFEM --------------------------------------------------------------------------------
began = perf_counter()
exact = reference.ssfem(problem, chaos)
print(f"monolithic SSFEM: {exact.iterations} CG iterations, {perf_counter() - began:.2f} s")
blocks = {name: result.coefficients(name) for name in problem.substructures}
error = reference.energy_error(problem, blocks, exact.coefficients)

# --- answers -----------------------------------------------------------------------------------------
largest = result.quantity(
    lambda fields: fields.force("joint")[..., 0].max(axis=1),
    "largest normal stress on the joint",
    "MPa",
    samples=20_000,
)
truncation = result.truncation("joint", points=8)
stress, deviation = (moment[:, 0] for moment in result.moments("joint"))
print(f"""
mean normal stress on the joint     {stress.min():8.3f} to {stress.max():8.3f} MPa
its standard deviation              {deviation.min():8.3f} to {deviation.max():8.3f} MPa
largest normal stress, mean         {largest.mean()} MPa
largest normal stress, deviation    {largest.std()} MPa
probability of traction somewhere   {largest.probability(above=0.0)}
truncation error of the joint force {100 * truncation.sample:.2f} % of its deviation
difference to monolithic SSFEM      {error:.1e} (energy norm, all coefficients)""")

if not given.no_figures:
    points, corners = problem.interfaces["joint"].points, figures.facet_corners(problem, "joint")
    given.output.mkdir(parents=True, exist_ok=True)
    for index in range(2):
        path = figures.interface_map(
            points,
            modes.functions[:, index] * np.sqrt(modes.eigenvalues[index]),
            given.output / f"mode{index + 1}.png",
            f"Karhunen-Loeve mode {index + 1} (-)",
            facets=corners,
        )
        print(f"wrote {path.name}")
    for values, name, label in (
        (stress, "mean", "mean normal stress (MPa)"),
        (deviation, "deviation", "standard deviation of the normal stress (MPa)"),
    ):
        path = figures.interface_map(points, values, given.output / f"{name}.png", label, facets=corners)
        print(f"wrote {path.name}")
    x, density = largest.density()
    path = figures.density_figure(
        {f"LATIN-PCE, order {given.order}": (x, density)},
        given.output / "density.png",
        "largest normal stress on the joint (MPa)",
        threshold=0.0,
        title=f"P(traction somewhere) = {largest.probability(above=0.0)}",
    )
    print(f"wrote {path.name}; figures are in {given.output}")

assert result.converged
assert error < 1e-8, f"LATIN-PCE and SSFEM differ by {error:.1e}"
print("check passed: LATIN-PCE equals monolithic SSFEM to 1e-8")
