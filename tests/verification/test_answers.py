"""LATIN gives the monolithic answer and the closed forms, for every search direction and unit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.plan.plan import Direction
from dolfinx_frontend.reference.direct import ReferenceSolution, monolithic
from dolfinx_frontend.reference.energy import energy_error
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.scene.laws import Elastic, Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from latin_core import Options
from parts.rings import annulus
from tests.helpers import DIMENSION, block, wavy
from tests.verification import scenes

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-10, max_iterations=3000, stagnation_window=1000)
PATIENT = TIGHT.with_(acceleration=100)
"""Deep enough a history for a direction that is a hundred times off."""
BOUND = 1e-8
"""Demanded of the energy error: a hundred times the tolerance."""


def latin(problem: Problem, **how: Any) -> Result:
    """An accelerated run that converged."""
    how = {"method": "accelerated", "options": TIGHT} | how
    result = solve(problem, **how)
    assert result.status == "converged", result
    return result


def check(problem: Problem, result: Result, reference: ReferenceSolution | None = None) -> None:
    """Displacements, and forces on elastic interfaces, are those of the monolithic solution."""
    reference = reference or monolithic(problem)
    assert energy_error(problem, result.displacements, reference.u) < BOUND
    for name, interface in problem.interfaces.items():
        if isinstance(interface.law, Elastic):
            exact = reference.forces[name][:, : result.force(name).shape[1]]
            # the error of a force follows that of the energy, times the stiffness of its springs
            assert np.abs(result.force(name) - exact).max() < 1e2 * BOUND * np.abs(exact).max()


# ---------------------------------------------------------------------------------------------
# Against the monolithic solution
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "active, kept", [(None, 2), ("all", 20), (["joint"], 1), (["weld", "support"], 2)]
)
def test_vessel(vessel, vessel_reference, active, kept):
    """Elastic interfaces kept, all twenty kept, one kept, and only linear ones kept."""
    result = latin(vessel, active=active)
    check(vessel, result, vessel_reference)
    assert len(result.plan.active) == kept


def test_single_precision_is_corrected(vessel, vessel_reference):
    """Ten digits by stages of seven digits, with no more than two corrections; also after an early end."""
    single = TIGHT.with_(precision="single")
    result = latin(vessel, options=single)
    check(vessel, result, vessel_reference)
    assert result.iterations <= latin(vessel).iterations + 6
    few = solve(vessel, "accelerated", options=single.with_(max_iterations=4))
    full = solve(vessel, "accelerated", options=TIGHT.with_(max_iterations=4))
    # both are exact answers to their own interface data, which differ by single precision
    assert energy_error(vessel, few.displacements, vessel_reference.u) == pytest.approx(
        energy_error(vessel, full.displacements, vessel_reference.u), rel=1e-2
    )


@pytest.mark.parametrize("active", [None, "all"])
def test_chain(active):
    problem = scenes.chain()
    check(problem, latin(problem, active=active))


@pytest.mark.parametrize("active", [None, "all"])
def test_split_ring(active):
    """Also the closed form: p_c at the joint and the jump p_c / k, as accurately as the mesh allows."""
    ring = scenes.SplitRing()
    problem = ring.problem()
    result = latin(problem, active=active)
    check(problem, result)
    joint = problem.interfaces["joint"]
    contact = ring.pressure()
    force, jump = result.force("joint"), result.jump("joint")
    assert joint.weights @ -force[:, 0] / joint.area == pytest.approx(contact, rel=2e-5)
    assert joint.weights @ jump[:, 0] / joint.area == pytest.approx(-contact / ring.k, rel=2e-5)


@pytest.mark.parametrize("active", ["all", None])
def test_plain_iteration_has_the_same_fixed_point(active):
    problem = scenes.SplitRing().problem((4, 8))
    plain = Options.plain(rtol=1e-9, stagnation_window=5000)
    result = solve(problem, "latin", active=active, direction=10.0, options=plain)
    assert result.status == "converged" and result.plan.options.acceleration == 0
    assert energy_error(problem, result.displacements, monolithic(problem).u) < BOUND


# ---------------------------------------------------------------------------------------------
# Patches: uniform stress
# ---------------------------------------------------------------------------------------------
E, NU, PULL = 2e5, 0.3, 10.0
NORMAL, SHIFT = 3e3, -0.002


def patch(cell: str, law: Perfect | Elastic, upper_divisions: int = 2, degree: int = 1) -> Problem:
    """Two blocks on distorted meshes, one on the other, pulled along their common axis."""
    d = DIMENSION[cell]
    axis = d - 1
    end = "xyz"[axis]
    low, high = np.zeros(d), np.ones(d)
    low[axis], high[axis] = 1.0, 2.0
    # the finer side is side 1: no facet of it crosses an edge of side 2
    matching = upper_divisions == 2
    mapping = wavy(0.08, axis) if matching else None
    upper = block(cell, [upper_divisions] * d, low, high, mapping=mapping, seed=1)
    lower = block(cell, [2] * d, mapping=mapping, seed=2)
    scene = Scene()
    for name, part in (("upper", upper), ("lower", lower)):
        scene.substructure(name, part, LinearElastic(E, NU), degree=degree)
    scene.interface("joint", f"upper:{end}0", f"lower:{end}1", law)
    sides = [f"{name}:{'xyz'[k]}0" for name in ("lower", "upper") for k in range(axis)]
    scene.symmetry([*sides, f"lower:{end}0"])
    pull = np.zeros(d)
    pull[axis] = PULL
    scene.traction(f"upper:{end}1", pull, name="pull")
    return assemble(scene)


def uniform(problem: Problem, opening: float) -> dict[str, np.ndarray]:
    """Displacements (n,) under uniaxial stress (plane strain in 2D), with an opened joint."""
    d = problem.dim
    along, across = (1.0, -NU) if d == 3 else (1.0 - NU**2, -NU * (1.0 + NU))
    strain = PULL / E * np.array([across] * (d - 1) + [along])
    fields = {}
    for name, part in problem.substructures.items():
        u = part.dof_coordinates * strain
        if name == "upper":
            u[:, -1] += opening
        fields[name] = u.ravel()
    return fields


@pytest.mark.parametrize("cell", list(DIMENSION))
@pytest.mark.parametrize("kind", ["perfect", "elastic", "nested"])
def test_patch(cell, kind):
    """Uniform stress passes glue, springs, and springs between meshes that do not match."""
    springs = Elastic(normal=NORMAL, tangential=NORMAL, jump=SHIFT)
    law = Perfect() if kind == "perfect" else springs
    problem = patch(cell, law, 4 if kind == "nested" else 2)
    joint = problem.interfaces["joint"]
    assert (joint.matching is None) == (kind == "nested")
    # n points from the upper block down: an opening is a positive jump, a tension a positive force
    opening = 0.0 if kind == "perfect" else PULL / NORMAL + SHIFT
    exact = uniform(problem, opening)
    # two rigid interfaces that meet share the forces of the nodes where they do in any way: matrix
    # directions find another way than the smooth one
    rigid = {"macro": "none", "directions": "diagonal"} if kind == "perfect" else {}
    result = latin(problem, active="all", options=TIGHT.with_(rtol=1e-12, **rigid))
    size = max(np.abs(u).max() for u in exact.values())
    for name, u in result.displacements.items():
        assert np.abs(u - exact[name]).max() < 1e-10 * size
    normal = np.zeros(problem.dim)
    normal[0] = 1.0
    assert np.abs(result.force("joint") - PULL * normal).max() < 1e-9 * PULL
    assert np.abs(result.jump("joint") - opening * normal).max() < 1e-10 * size


def test_springs_between_meshes_that_cross():
    """3 facets against 2: the quadrature of side 1 is not exact, but all methods give the same answer."""
    problem = patch("hexahedron", Elastic(normal=NORMAL, tangential=NORMAL), 3, degree=2)
    check(problem, latin(problem, active="all"))


# ---------------------------------------------------------------------------------------------
# What must not matter
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("factor", [1e-2, 1.0, 1e2])
def test_direction_of_elastic_interfaces(vessel, vessel_reference, factor):
    given = {"joint": 2.0 * scenes.JOINT, "screw": 2.0 * scenes.SCREW}
    given["screw"] /= vessel.interfaces["screw"].area
    direction = Direction(given={name: factor * k for name, k in given.items()})
    result = latin(vessel, direction=direction)
    assert result.solver.directions.min() == pytest.approx(factor * min(given.values()))
    check(vessel, result, vessel_reference)


@pytest.mark.parametrize("scene", ["chain", "ring"])
@pytest.mark.parametrize("factor", [1e-2, 1.0, 1e2])
def test_direction_of_all_interfaces(scene, factor):
    problem = scenes.chain(3) if scene == "chain" else scenes.SplitRing().problem()
    result = latin(problem, active="all", direction=3.0 * factor, options=PATIENT)
    check(problem, result)


@pytest.mark.parametrize("active", [None, "all"])
def test_units(vessel_shape, active):
    """The same digits after the same number of iterations in N-mm, N-m and kN-m."""
    runs = {}
    for name, units in scenes.UNITS.items():
        problem = scenes.vessel(vessel_shape, units)
        result = latin(problem, active=active)
        u = np.concatenate(list(result.displacements.values())) / units.length
        force = result.force("joint") / units(1.0, -2)
        runs[name] = (result.iterations, u, force, result.summary.energy / units(1.0, 1))
    iterations, u, force, energy = runs["N-mm"]
    for other in runs.values():
        assert abs(other[0] - iterations) <= 1
        assert np.linalg.norm(other[1] - u) < BOUND * np.linalg.norm(u)
        assert np.linalg.norm(other[2] - force) < BOUND * np.linalg.norm(force)
        assert other[3] == pytest.approx(energy, rel=BOUND)


def test_operators_agree(vessel):
    """Condensed or sparse, CHOLMOD or MUMPS: one iteration, rounded differently."""
    runs = [
        latin(vessel, active="all", options=Options(operator=operator, backend=backend))
        for operator, backend in (
            ("condensed", "cholmod"),
            ("factored", "cholmod"),
            ("factored", "mumps"),
            ("automatic", "automatic"),
        )
    ]
    first = np.concatenate(list(runs[0].displacements.values()))
    for run in runs[1:]:
        assert run.iterations == runs[0].iterations
        other = np.concatenate(list(run.displacements.values()))
        assert np.linalg.norm(other - first) < 1e-10 * np.linalg.norm(first)


# ---------------------------------------------------------------------------------------------
# Closed forms
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("load", [6.0, 9.0, 10.0, 12.0])
def test_bolt_and_joint(load):
    """Joint force k (K D - Q) / (K + k), bolt tension N + Q; the joint opens at Q = K D."""
    K, k, D = 50.0, 400.0, 0.2
    scene = Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((2.0, 3.0, 1.0), (2, 2, 1), (0, 0, level))
        scene.substructure(name, part, LinearElastic(30.0, 0.0), degree=1)
    scene.fix("base:z0")
    scene.symmetry(["cover:x0", "cover:y0"])
    scene.interface("joint", "base:z1", "cover:z0", Elastic(normal=k, total=True))
    scene.interface("bolt", "base:z1", "cover:z0", Elastic(normal=K, jump=-D, total=True))
    scene.traction("cover:z1", (0.0, 0.0, load / 6.0))
    problem = assemble(scene)
    result = latin(problem)
    weights = problem.interfaces["joint"].weights
    compression = -weights @ result.force("joint")[:, 0]
    tension = weights @ result.force("bolt")[:, 0]
    exact = k * (K * D - load) / (K + k)
    scale = 10.0 * TIGHT.rtol * K * D
    assert compression == pytest.approx(exact, abs=scale)
    assert tension == pytest.approx(exact + load, abs=scale)


def test_lame_ring_converges():
    """u(a), u(b) and the energy of the ring; all conditions are interfaces; the rate is 2 degree."""
    ring = scenes.SplitRing()
    inside, outside = (ring.displacement(r, ring.a, ring.b, ring.p, 0.0) for r in (ring.a, ring.b))
    assert inside == pytest.approx(1.525333e-3, abs=5e-10)
    assert outside == pytest.approx(9.706667e-4, abs=5e-11)
    energy = ring.p * inside * np.pi / 2.0 * ring.a  # work of the pressure = u^T K u
    errors = []
    for n in (2, 4, 8):
        scene = Scene()
        part = annulus(ring.a, ring.b, divisions=(n, 2 * n))
        scene.substructure("ring", part, LinearElastic(ring.E, ring.nu), degree=2)
        scene.symmetry(["ring:theta0", "ring:theta1"])
        scene.pressure("ring:inner", ring.p, name="bore")
        problem = assemble(scene)
        result = latin(problem, active="all")
        errors.append(abs(result.summary.energy / energy - 1.0))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(4.0, abs=0.1)
    x = problem.substructures["ring"].dof_coordinates
    r = np.linalg.norm(x, axis=1)
    radial = np.einsum("ni,ni->n", result.displacements["ring"].reshape(-1, 2), x) / r
    assert radial[r < ring.a + 1e-3] == pytest.approx(inside, rel=10.0 * errors[-1])
    assert radial[r > ring.b - 1e-3] == pytest.approx(outside, rel=10.0 * errors[-1])
