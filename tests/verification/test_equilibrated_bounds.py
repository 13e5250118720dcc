"""Estimated errors of meshes beside bounds that nothing can exceed: stresses in equilibrium, ten cases."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.estimate.mesh_error import discretisation_error
from dolfinx_frontend.geometry.parts import Part, located
from dolfinx_frontend.results.errors import EnergyBound
from dolfinx_frontend.scene.laws import Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from tests.verification.airy import Rectangle, loads


class Case(NamedTuple):
    """A rectangle and its mesh: n cells along the height."""

    shape: Rectangle
    cell: str
    degree: int
    n: int


SEAM = Rectangle(2.0, 1.0, top=(1.0, 0.0), shear=0.5, seam=0.5, springs=(1e3, 4e2), young=(1e3, 3e3))
TEN = {
    "pressed": Case(Rectangle(2.0, 1.0, top=(1.0, 1.0)), "triangle", 1, 6),
    "pressed, quadratic": Case(Rectangle(2.0, 1.0, top=(1.0, 1.0)), "triangle", 2, 4),
    "sheared": Case(Rectangle(1.0, 1.0, shear=1.0), "quadrilateral", 1, 8),
    "sheared, quadratic": Case(Rectangle(1.0, 1.0, shear=1.0), "quadrilateral", 2, 4),
    "tower": Case(Rectangle(1.0, 3.0, top=(0.5, -0.5), shear=0.3), "triangle", 2, 12),
    "pulled": Case(Rectangle(2.0, 1.0, pull=1.0), "triangle", 1, 8),
    "nearly incompressible": Case(Rectangle(1.5, 1.0, top=(1.0, 0.2), nu=0.45), "quadrilateral", 2, 4),
    # where what is held ends in the middle of a face stresses are as singular as at a crack
    "half held": Case(Rectangle(2.0, 1.0, held=0.5, top=(0.0, 1.0), pull=0.5), "triangle", 2, 6),
    "seam": Case(SEAM, "triangle", 1, 6),
    "seam, quadratic": Case(SEAM, "quadrilateral", 2, 4),
}
FINE = 48
"""Cells of the stresses in equilibrium along the height."""


def block(case: Case, low: float, high: float) -> Part:
    """Part of the rectangle."""
    shape, n = case.shape, case.n
    counts = (round(n * shape.length / shape.height), round(n * (high - low) / shape.height))
    mesh = geometry.box((shape.length, high - low), counts, (0.0, low), case.cell).mesh
    end = shape.held * shape.length
    return located(
        mesh,
        {
            "base": lambda x: np.isclose(x[1], low) & (x[0] < end + 1e-9 if low == 0.0 else True),
            "right": lambda x: np.isclose(x[0], shape.length),
            "top": lambda x: np.isclose(x[1], high),
        },
    )


def energies(case: Case) -> tuple[float, float, EnergyBound | None]:
    """a(u_h) with the springs, the estimated error, and its bound; None: there is none on such cells."""
    shape, scene = case.shape, Scene()
    heights = [0.0, *([] if shape.seam is None else [shape.seam]), shape.height]
    names = [f"p{k}" for k in range(len(heights) - 1)]
    for k, name in enumerate(names):
        part = block(case, heights[k], heights[k + 1])
        scene.substructure(name, part, LinearElastic(shape.young[k], shape.nu), degree=case.degree)
        scene.traction(f"{name}:right", (shape.pull, 0.0))
    scene.fix("p0:base")
    scene.traction(f"{names[-1]}:top", loads(shape))
    active = []
    if shape.seam is not None:
        springs = Elastic(normal=shape.springs[0], tangential=shape.springs[1])
        scene.interface("seam", "p0:top", "p1:base", springs, space="points")
        active = ["seam"]
    result = solve(assemble(scene), active=active)
    if active:
        result = result.tightened(1e-10)
    found = discretisation_error(result)
    whole = found.norm**2
    for name in active:
        weights = result.problem.interfaces[name].weights
        whole += float(np.sum(weights[:, None] * result.force(name) * result.jump(name)))
    bound = result.errors(kind="bound") if case.cell == "triangle" and case.degree < 3 else None
    return whole, found.energy * found.norm, bound


@pytest.mark.parametrize("name", TEN)
def test_estimates_beside_bounds(name: str) -> None:
    """The estimate is between half of what no error exceeds and three times what every error exceeds."""
    case = TEN[name]
    energy, estimated, bound = energies(case)
    above = np.sqrt(case.shape.twice_the_complementary_energy(FINE) - energy)
    # a(u) is above that of any displacements: of better ones here
    better, _, _ = energies(case._replace(cell="triangle", degree=3, n=3 * case.n))
    below = np.sqrt(better - energy)
    assert below <= above  # as Prager and Synge have it
    assert below > 0.7 * above  # so that both tell something
    assert 0.5 * above <= estimated <= 3.0 * below, (estimated / above, estimated / below)
    if bound is not None:  # above what every error exceeds; the loads are functions that are polynomials
        assert below <= bound.total <= 2.0 * above, (bound.total / below, bound.total / above)
