"""Unilateral contact and friction against closed forms and an independent active-set solver."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from latin_core import Options

from dolfinx_frontend import geometry, reference
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.sweep import sweep
from dolfinx_frontend.scene.laws import Contact, Elastic, Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import quasi_monte_carlo
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.parameters import Normal

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-11, max_iterations=1000)
AREA = 100.0  # mm^2


def blocks(gap: float = 0.0, traction: Any = (-5.0, 0.0, 0.0), nu: float = 0.0) -> Scene:
    """Two blocks end to end, the left one held, the right one loaded at its end."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0 + gap)):
        box = geometry.box((20.0, 10.0, 10.0), (2, 2, 2), origin=(x0, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(E=200e3, nu=nu), degree=1)
    scene.fix("left:x0")
    scene.traction("right:x1", traction, name="load")
    return scene


def bolted(force: float, preload: float = 0.02, bolt: float = 4e5, joint: float = 50.0) -> Problem:
    """A joint in contact and a preloaded bolt, both between the same faces (TARGETS 2.6)."""
    scene = blocks(traction=(force / AREA, 0.0, 0.0))
    scene.interface("joint", "left:x1", "right:x0", Contact(stiffness=joint))
    bolt_law = Elastic(normal=bolt, tangential=bolt, total=True, jump=-preload)
    scene.interface("bolt", "left:x1", "right:x0", bolt_law)
    return assemble(scene)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99, 1.0, 1.01, 1.5])
def test_bolted_joint_opens_when_the_load_exceeds_the_preload(share: float) -> None:
    stiffness, preload, joint = 4e5, 0.02, 50.0 * AREA
    force = share * stiffness * preload
    result = solve(bolted(force), active=["bolt"], options=TIGHT)
    assert result.converged
    closed = max(0.0, joint * (stiffness * preload - force) / (stiffness + joint))
    joint_force, bolt_force = (
        result.problem.interfaces[name].weights @ result.force(name)[:, 0] for name in ("joint", "bolt")
    )
    size = stiffness * preload
    assert abs(joint_force + closed) < 1e-7 * size  # compression is negative
    assert abs(bolt_force - (closed + force)) < 1e-7 * size
    assert result.force("joint")[:, 0].max() <= 0.0


def test_gap_closes_before_anything_is_carried() -> None:
    # the support carries nothing until the end has moved by the gap
    scene = blocks(traction=(0.0, 0.0, 0.0))
    scene.interface("joint", "left:x1", "right:x0", Perfect())
    scene.interface("stop", "right:x1", Contact(gap=0.01))
    for pull in (25.0, 50.0, 100.0):
        load = replace(scene.interfaces["load"].law, t=(pull, 0.0, 0.0))
        problem = assemble(scene).with_laws({"load": load})
        # free, the end moves by t L / E = t 40 / 2e5; the stop acts in series
        result = solve(problem, options=TIGHT)
        moved = max(0.0, pull * 40.0 / 200e3 - 0.01)
        stop = -moved * 200e3 / 40.0
        assert np.allclose(result.force("stop")[:, 0], stop, atol=1e-6 * pull)


@pytest.mark.parametrize("factor", [1.0, 3.0, 10.0])
def test_vessel_equals_an_active_set_solver(vessel: Problem, factor: float) -> None:
    stiffness = 1000.0
    screw = Elastic(normal=2.5e4, tangential=2.5e4, total=True, jump=-0.2)
    problem = vessel.with_laws({"joint": Contact(stiffness=stiffness), "screw": screw})
    result = solve(problem, direction=factor, options=Options(rtol=1e-9, max_iterations=500))
    assert result.converged

    # semi-smooth Newton: springs where the joint is closed, none elsewhere, until the set stands
    closed = np.ones(problem.interfaces["joint"].num_points)
    for _ in range(30):
        linear = vessel.with_laws({"joint": Elastic(normal=stiffness * closed), "screw": screw})
        exact = reference.monolithic(linear)
        traces = exact.traces["joint"]
        again = (traces[1][:, 0] - traces[0][:, 0] < 0.0).astype(float)
        if np.array_equal(again, closed):
            break
        closed = again
    assert 0.0 < closed.mean() < 1.0  # it opens partly, or nothing is tested
    assert np.array_equal(result.force("joint")[:, 0] < 0.0, closed > 0.0)
    assert reference.energy_error(linear, result.displacements, exact.u) < 1e-8


def test_friction_beyond_need_is_perfect_adhesion() -> None:
    # pressed and sheared below the bound everywhere: the joint sticks, as if glued
    scene = blocks(traction=(-100.0, 1.0, 0.0), nu=0.3)
    scene.interface("joint", "left:x1", "right:x0", Contact(friction=10.0))
    problem = assemble(scene)
    result = solve(problem, options=Options(rtol=1e-10, max_iterations=2000))
    glued = problem.with_laws({"joint": Perfect()})
    exact = reference.monolithic(glued)
    assert result.converged
    assert reference.energy_error(glued, result.displacements, exact.u) < 1e-8


def test_friction_slips_at_its_bound() -> None:
    # a spring to the ground takes what friction cannot: |f_t| = mu p everywhere, the rest in the spring
    scene = blocks(traction=(-10.0, 4.0, 0.0))
    scene.interface("joint", "left:x1", "right:x0", Contact(friction=0.2))
    scene.interface("guide", "right:x1", Elastic(normal=0.0, tangential=200.0))
    result = solve(assemble(scene), active=["guide"], options=Options(rtol=1e-9, max_iterations=3000))
    assert result.converged
    weights = result.problem.interfaces["joint"].weights
    force = result.force("joint")
    shear = np.linalg.norm(force[:, 1:], axis=1)
    assert np.all(shear <= 0.2 * np.abs(force[:, 0]) * (1 + 1e-12))
    slipping = shear > 0.2 * np.abs(force[:, 0]) * (1 - 1e-9)
    assert slipping.any()
    total = weights @ force[:, 1:]
    guide = result.problem.interfaces["guide"].weights @ result.force("guide")[:, 1:]
    assert np.linalg.norm(total) <= 0.2 * 10.0 * AREA * (1 + 1e-6)
    assert np.linalg.norm(total) + np.linalg.norm(guide) > 4.0 * AREA * (1 - 1e-6)


def test_the_answer_does_not_depend_on_the_direction(vessel: Problem) -> None:
    law = Contact(friction=0.3)
    screw = Elastic(normal=2.5e4, tangential=2.5e4, total=True, jump=-0.2)
    problem = vessel.with_laws({"joint": law, "screw": screw})
    weights = problem.interfaces["joint"].weights
    forces = []
    for factor in (3.0, 10.0):
        result = solve(problem, direction=factor, options=Options(rtol=1e-8, max_iterations=500))
        assert result.converged
        forces.append(weights @ result.force("joint")[:, 0])
    assert abs(forces[0] - forces[1]) < 1e-6 * abs(forces[0])


def test_contact_without_friction_has_no_tangential_unknowns() -> None:
    scene = blocks()
    scene.interface("joint", "left:x1", "right:x0", Contact())
    scene.fix("right:x1", components=(1, 2))
    result = solve(assemble(scene), options=TIGHT)
    assert result.force("joint").shape[1] == 1
    # the points outnumber the nodes: what no mesh sees of their forces is not determined
    assert np.allclose(result.force("joint"), -5.0, rtol=1e-3)
    pressed = result.problem.interfaces["joint"].weights @ result.force("joint")[:, 0]
    assert pressed == pytest.approx(-5.0 * AREA, rel=1e-9)
    assert "nonlinear" in str(result.plan)


def test_mistakes_are_named() -> None:
    with pytest.raises(SceneError, match="friction"):
        Contact(friction=-0.1)
    with pytest.raises(SceneError, match="stiffness"):
        Contact(stiffness=float("nan"))
    scene = blocks(gap=-0.05)
    scene.interface("joint", "left:x1", "right:x0", Contact())
    scene.fix("right:x1", components=(1, 2))
    with pytest.raises(SceneError, match=r"inside each other.*0\.05"):
        solve(assemble(scene))
    scene = blocks(gap=-0.05, traction=(0.0, 0.0, 0.0))
    scene.interface("joint", "left:x1", "right:x0", Contact(interference=True))
    scene.fix("right:x1")
    result = solve(assemble(scene), options=TIGHT)
    # 40 mm of bar, held at both ends, shortened by 0.05 mm
    # points outnumber nodes: only resultants are determined
    joint = result.problem.interfaces["joint"]
    mean = joint.weights @ result.force("joint")[:, 0] / joint.area
    assert mean == pytest.approx(-200e3 * 0.05 / 40.0, rel=1e-7)


def test_uncertain_preload_over_a_contact_is_sampled() -> None:
    # Q = 0.8 K D: opens with the probability of TARGETS 2.6, Phi((0.8 - 1) / 0.1) = 0.0227501
    stiffness, preload = 4e5, 0.02
    problem = bolted(0.8 * stiffness * preload)
    bolt = Elastic(
        normal=Normal("K", mean=stiffness, cov=0.1), tangential=stiffness, total=True, jump=-preload
    )
    problem = problem.with_laws({"bolt": bolt})
    samples = quasi_monte_carlo(
        problem, 1024, options=Options(rtol=1e-8, max_iterations=500), progress=False
    )
    assert samples.converged
    opening = samples.quantity(lambda f: f.force("joint")[..., 0].mean(axis=1), "joint", "MPa")
    # every sample is exact, so the count is that of the points below the threshold
    stiffnesses = samples.random.space.values(samples.random.source("bolt", "normal"), samples.germs)
    assert np.array_equal(opening.values > -1e-6, stiffnesses < 0.8 * stiffness)
    chance = opening.probability(above=-1e-6)
    assert chance.low < 0.0227501 < chance.high


def test_a_swept_contact() -> None:
    scene = blocks(traction=(-10.0, 0.0, 0.0))
    scene.interface("joint", "left:x1", "right:x0", Contact(gap=0.0))
    scene.interface("back", "right:x1", Elastic(normal=100.0, tangential=100.0))
    gaps = [0.0, 0.05, 0.1, 0.15]
    result = sweep(assemble(scene), {"joint.gap": gaps}, options=TIGHT, progress=False)
    # the spring alone holds 10 MPa at 0.1 mm: beyond that gap the joint stays open
    force = result.force("joint")[..., 0].mean(axis=-1)
    assert force[3] == 0.0 and np.all(np.diff(force) >= -1e-9) and force[0] < -9.0
    # a finite stiffness in compression: 10 MPa are shared by the spring and the contact
    soft = assemble(scene).with_laws({"joint": Contact(gap=0.0, stiffness=10.0)})
    stiffness = np.array([50.0, 200.0])
    shared = sweep(soft, {"joint.stiffness": stiffness}, options=TIGHT, progress=False)
    jump = shared.jump("joint")[..., 0]
    assert np.allclose(shared.force("joint")[..., 0], stiffness[:, None] * jump, rtol=1e-9)
    assert jump.max() < 0.0
