"""Coarse problem and matrix search directions: iterations do not depend on the number of parts, on nu, on k.

All interfaces are kept as cuts, which is what parallel parts or a small memory ask for; the answer is
compared with the monolithic solve, which knows no interfaces.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.plan.plan import make_plan
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.reference.energy import energy_difference, energy_error
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.scene.laws import Contact, Perfect, Pressure
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from latin_core import Options
from parts.blocks import block_chain
from tests.verification import scenes

SIZE = 20.0
DIAGONAL = {"macro": "none", "directions": "diagonal"}


def blocks(
    parts: int,
    divisions: tuple[int, int, int] = (2, 2, 2),
    nu: float = 0.3,
    traction: tuple[float, float, float] = (10.0, 0.0, -2.0),
) -> Problem:
    """Cubes of 20 mm end to end, one end fixed, the other one pulled and bent; every joint is perfect."""
    chain = block_chain(parts, (SIZE,) * 3, divisions)
    scene = Scene()
    for name, part in chain.parts.items():
        scene.substructure(name, part, LinearElastic(E=200e3, nu=nu), degree=2)
    for c in chain.interfaces:
        scene.interface(c.name, c.face1, c.face2, Perfect())
    scene.fix("block0:x0", name="wall")
    scene.traction(f"block{parts - 1}:x1", traction, name="pull")
    return assemble(scene)


@cache
def chain(parts: int, nu: float = 0.3) -> Problem:
    """The chain, assembled once."""
    return blocks(parts, nu=nu)


def rubbing(parts: int) -> Problem:
    """The chain under pressure; every fourth joint rubs, opens at its edges and slips.

    The faces of these joints are ground 2 um higher in the middle (so they touch in part), and the blocks
    behind them are softer (so they slide on each other when they widen).
    """
    chain = block_chain(parts, (SIZE,) * 3, (2, 2, 2))
    scene = Scene()
    for k, (name, part) in enumerate(chain.parts.items()):
        modulus = 200e3 if (k // 4) % 2 == 0 else 100e3
        scene.substructure(name, part, LinearElastic(E=modulus, nu=0.3), degree=2)
    for k, c in enumerate(chain.interfaces):
        contact = Contact(friction=0.1, gap=lambda x: 2e-3 * ((x[:, 1] - 10.0) / 10.0) ** 2)
        # at the vertices of so few facets they would touch along a line, and could roll on it
        scene.interface(c.name, c.face1, c.face2, contact if k % 4 == 3 else Perfect(), space="points")
    scene.fix("block0:x0", name="wall")
    scene.interface("press", f"block{parts - 1}:x1", Pressure(10.0))
    return assemble(scene)


def cut(problem: Problem, direction: float | None = None, **options: object) -> Result:
    """Solve with every interface kept."""
    settings = Options(newton=0, max_iterations=200).with_(**options)
    return solve(problem, "accelerated", active="all", direction=direction, options=settings)


# ---------------------------------------------------------------------------------------------
# Number of parts
# ---------------------------------------------------------------------------------------------
@pytest.mark.sanitize
@pytest.mark.parametrize("parts", [2, 4, 8, 32])
def test_number_of_parts_does_not_matter(parts: int) -> None:
    problem = chain(parts)
    result = cut(problem)
    assert result.converged and result.iterations <= 8  # MEASURED: 12 to 22 with a coarse problem alone
    assert energy_error(problem, result.displacements, monolithic(problem).u) < 1e-6


def test_many_parts() -> None:
    """Pulled only: in bending, a chain this slender reaches the rounding of its own stiffness (N^4)."""
    problem = blocks(128, (1, 1, 1), traction=(10.0, 0.0, 0.0))
    result = cut(problem)
    assert result.converged and result.iterations <= 8
    assert energy_error(problem, result.displacements, monolithic(problem).u) < 1e-6


def test_each_helps_alone() -> None:
    problem = chain(8)
    reference = monolithic(problem)
    count = {}
    for macro in ("none", "resultants", "linear"):
        for directions in ("diagonal", "matrix"):
            result = cut(problem, macro=macro, directions=directions)
            assert result.converged
            # the estimate is within a factor of three of the error
            assert energy_error(problem, result.displacements, reference.u) < 3e-6
            count[macro, directions] = result.iterations
    assert count["linear", "matrix"] <= 8 < count["linear", "diagonal"] <= 35
    assert count["none", "matrix"] < count["none", "diagonal"] / 2
    assert count["linear", "matrix"] < count["resultants", "matrix"] < count["none", "matrix"]


@pytest.mark.parametrize("parts", [8, 24])
def test_friction_at_every_fourth_joint(parts: int) -> None:
    problem = rubbing(parts)
    result = cut(problem, rtol=3e-7)
    assert result.converged and result.iterations <= 45  # wanted: 60
    exact = solve(problem, options=Options(rtol=1e-10, max_iterations=2000))
    assert exact.plan.active != result.plan.active
    assert energy_difference(problem, result, exact) < 1e-6
    for name in exact.plan.active:
        force = exact.force(name).reshape(-1, 3)
        rubs = np.hypot(force[:, 1], force[:, 2])
        assert np.any(force[:, 0] == 0.0) and np.any((force[:, 0] < 0.0) & (rubs > 0.0999 * -force[:, 0]))


# ---------------------------------------------------------------------------------------------
# Material, search direction, units
# ---------------------------------------------------------------------------------------------
def test_nearly_incompressible_chain() -> None:
    problem = chain(8, 0.4999)
    result = cut(problem)
    assert result.converged and result.iterations <= 25
    assert energy_error(problem, result.displacements, monolithic(problem).u) < 1e-6


@pytest.mark.parametrize("factor", [0.1, 1.0, 100.0, 1000.0])
def test_search_direction_does_not_matter(factor: float) -> None:
    """1e-2 to 1e2 times the default, which is 10."""
    problem = chain(8)
    result = cut(problem, direction=factor, rtol=1e-9)
    assert result.converged and result.iterations <= 25
    assert energy_error(problem, result.displacements, monolithic(problem).u) < 1e-8


def test_vessel_with_all_interfaces(vessel, vessel_reference) -> None:
    """Twenty interfaces, two of them elastic: 95 iterations to 1e-4 with diagonal directions."""
    few = cut(vessel, rtol=1e-4)
    assert few.converged and few.iterations <= 15
    assert energy_error(vessel, few.displacements, vessel_reference.u) < 1e-4
    tight = cut(vessel, rtol=1e-9)
    assert tight.converged and tight.iterations <= 30
    assert energy_error(vessel, tight.displacements, vessel_reference.u) < 1e-8


@pytest.mark.parametrize("units", ["N-m", "kN-m"])
def test_units_do_not_matter(vessel, vessel_shape, units: str) -> None:
    ours = cut(vessel)
    others = cut(scenes.vessel(vessel_shape, scenes.UNITS[units]))
    assert others.iterations == ours.iterations
    length = scenes.UNITS[units].length
    for name, u in ours.displacements.items():
        assert np.allclose(others.displacements[name] / length, u, rtol=0.0, atol=1e-8 * np.abs(u).max())


# ---------------------------------------------------------------------------------------------
# The plan
# ---------------------------------------------------------------------------------------------
def test_plan_takes_them_where_they_pay(vessel) -> None:
    every = make_plan(vessel, "accelerated", active="all")
    assert set(every.paired) == set(every.active)
    assert {"joint", "weld", "pressure cover"} < set(every.macro)
    assert "coarse problem" in str(every) and "matrix directions" in str(every)
    # not for what is iterated on because it varies, nor for one solve, nor in the paper's iteration
    for plan in (
        make_plan(vessel, "accelerated"),
        make_plan(vessel, vary=["joint"]),
        make_plan(vessel),
        make_plan(vessel, "latin"),
        make_plan(vessel, "accelerated", active="all", options=Options().with_(**DIAGONAL)),
    ):
        assert plan.paired == () and plan.macro == ()
    part = make_plan(vessel, "accelerated", active="all", vary=["joint"])
    assert "joint" not in part.paired and "joint" in part.macro
