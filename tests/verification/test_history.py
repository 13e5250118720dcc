"""Load histories: superposition, friction over cycles, what a history costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from latin_core import Options

from dolfinx_frontend import geometry, reference
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.sweep import sweep
from dolfinx_frontend.plan.plan import Direction, make_plan
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic, Perfect, Pressure
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.parameters import Normal

pytestmark = pytest.mark.sanitize

TIGHT = Options(rtol=1e-11, max_iterations=2000)
TIMES = np.linspace(0.25, 3.0, 12)


def loaded_everywhere() -> Problem:
    """Every kind of loading changes in time: traction, displacement, jump, pressure, body force."""
    up, cycle = Amplitude([0, 1], [0, 1]), Amplitude([1, 2, 3], [0, 1, -1])
    square = Amplitude(lambda t: t * t)
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (2, 2, 2), origin=(x0, 0.0, 0.0), cell="hexahedron")
        weight = square * (0.0, 0.0, -1e-3) + (0.0, 1e-3, 0.0)
        scene.substructure(name, box, LinearElastic(E=200e3, nu=0.3), degree=1, body_force=weight)
    scene.fix("left:x0", value=up * (0.0, 0.01, 0.0))
    scene.traction("right:x1", cycle * (20.0, 0.0, -1.0) + (0.0, 1.0, 0.0), name="load")
    scene.pressure("left:z1", cycle * 3.0, name="pressure")
    scene.interface(
        "layer", "left:x1", "right:x0", Elastic(normal=500.0, tangential=200.0, jump=up * -0.02 + 0.001)
    )
    return assemble(scene)


@pytest.mark.parametrize("active", [(), ("layer",), "all"])
def test_linear_histories_equal_the_monolithic_solution_at_every_time(active: Any) -> None:
    problem = loaded_everywhere()
    # of two patterns that are all but rigid motions rounding leaves 1e-7 where everything is iterated on
    options = Options(rtol=1e-6 if active == "all" else 1e-9, max_iterations=5000, acceleration=40)
    result = solve(problem, times=TIMES, active=active, options=options)
    assert result.converged and result.plan.history == "patterns"
    assert result.plan.columns == 4  # constant part, up, cycle, t^2
    for k, time in enumerate(TIMES):
        now = problem.at(time)
        exact = reference.monolithic(now)
        fields = {name: u[k] for name, u in result.displacements.items()}
        # an error is relative to the history, not to a moment that may be nearly unloaded
        for name, u in exact.u.items():
            size = np.abs(result.displacements[name]).max()
            assert np.abs(fields[name] - u).max() < 1e-7 * size
        assert np.allclose(result.force("layer")[k], exact.forces["layer"], atol=1e-5)
        assert np.allclose(result.force("load")[k], exact.forces["load"], atol=1e-9)


@pytest.mark.parametrize("steps", [1, 2, 4, 5])
@pytest.mark.parametrize("active", [(), ("layer",)])
def test_histories_with_no_more_steps_than_load_patterns(active: Any, steps: int) -> None:
    """Four patterns: with four steps and nothing active, patterns were once taken for steps."""
    problem = loaded_everywhere()
    times = TIMES[3 : 3 + steps]
    result = solve(problem, times=times, active=active, options=TIGHT)
    assert result.converged
    for k, time in enumerate(times):
        now = problem.at(time)
        exact = reference.monolithic(now)
        fields = {name: u[k] for name, u in result.displacements.items()}
        assert reference.energy_error(now, fields, exact.u) < 1e-8


def test_a_history_without_memory_costs_nothing() -> None:
    scene = Scene()
    box = geometry.box((20.0, 10.0, 10.0), (2, 2, 2), cell="hexahedron")
    scene.substructure("block", box, LinearElastic(E=200e3, nu=0.3), degree=1)
    scene.fix("block:x0")
    scene.pressure("block:x1", 5.0)
    problem = assemble(scene)
    plain, timed = solve(problem), solve(problem, times=TIMES)
    assert timed.plan.columns == 1 and "nothing changes in time" in str(timed.plan)
    assert timed.displacements["block"].shape == (len(TIMES), problem.size)
    assert np.array_equal(timed.displacements["block"][5], plain.displacements["block"])


def jenkins(law: Contact) -> Scene:
    """A block pressed on the ground (p = 10 MPa), where springs move it back and forth: no moment arises."""
    scene = Scene()
    box = geometry.box((10.0, 10.0, 10.0), (1, 1, 1), cell="hexahedron")
    scene.substructure("block", box, LinearElastic(E=200e5, nu=0.0), degree=1)
    scene.pressure("block:z1", 10.0)
    scene.interface("ground", "block:z0", law)
    return scene


AMPLITUDE, SPRING, AREA = 0.05, 100.0, 100.0
CYCLE = Amplitude([0, 1, 3, 5], [0, 1, -1, 1])
STEPS = np.arange(0.125, 5.01, 0.125)


@pytest.mark.parametrize("friction", [0.3, 0.1])
def test_a_sliding_block_follows_the_loop_of_jenkins(friction: float) -> None:
    # spring k in series with a slider: F = k (u - s), |F| <= mu p; a rigid block on a spring
    scene = jenkins(Contact(friction=friction))
    drive = Elastic(normal=0.0, tangential=SPRING, jump=CYCLE * (0.0, AMPLITUDE, 0.0))
    scene.interface("drive", "block:z0", drive)
    scene.symmetry("block:y0")
    # nearly rigid on soft springs: E / L, which the default direction follows, is not what the ground sees
    result = solve(
        assemble(scene),
        times=STEPS,
        direction=Direction(given={"ground": 1e3}),
        options=Options(rtol=1e-10, max_iterations=2000),
    )
    assert result.converged and result.plan.history == "steps"
    weights = result.problem.interfaces["ground"].weights
    shear = np.einsum("p,tpc->tc", weights, result.force("ground"))[:, 1:] / AREA
    axis = int(np.argmax(np.abs(shear).max(axis=0)))
    # the component that is driven, whichever frame the faces have; the driven jump has the sign of its frame
    slip, exact, heat = 0.0, [], [0.0]
    for time in STEPS:
        pull = AMPLITUDE * CYCLE(time)
        trial = SPRING * (pull - slip)
        force = np.clip(trial, -friction * 10.0, friction * 10.0)
        heat.append(heat[-1] + abs(force * (pull - force / SPRING - slip)) * AREA)
        slip = pull - force / SPRING
        exact.append(force)
    sign = np.sign(shear[3, axis] * exact[3])
    # the block itself is elastic: G / h = 1e6 against a spring of 100
    assert np.allclose(sign * shear[:, axis], exact, atol=3e-4 * friction * 10.0)
    assert np.allclose(result.dissipation("ground"), heat[1:], atol=3e-4 * max(heat[-1], 1e-3))
    bound = friction * 10.0
    if bound < SPRING * AMPLITUDE:  # steady loop: 4 F (u - F / k) a cycle
        loop = 4.0 * bound * (AMPLITUDE - bound / SPRING) * AREA
        cycle = result.dissipation("ground")[STEPS >= 1.0]
        assert np.isclose(cycle[-1] - cycle[0], loop, rtol=2e-3)


def test_frictionless_histories_are_as_many_problems() -> None:
    opening = Amplitude([0, 1, 2], [0, 1, -1])
    scene = jenkins(Contact())
    scene.fix("block:x0", components=(0, 1))
    scene.traction("block:x1", opening * (0.0, 0.0, 3.0), name="pull")
    problem = assemble(scene)
    times = [0.5, 1.0, 1.5, 2.0]
    result = solve(problem, times=times, options=TIGHT)
    for k, time in enumerate(times):
        alone = solve(problem.at(time), options=TIGHT)
        assert np.allclose(result.force("ground")[k], alone.force("ground"), atol=1e-7)


def test_sweeps_over_histories() -> None:
    scene = jenkins(Contact(friction=0.3))
    drive = Elastic(normal=0.0, tangential=SPRING, jump=CYCLE * (0.0, AMPLITUDE, 0.0))
    scene.interface("drive", "block:z0", drive)
    problem = assemble(scene)
    options = Options(rtol=1e-10, max_iterations=2000)
    frictions, pulls = [0.1, 0.3], [0.02, 0.05]
    grid = sweep(
        problem,
        {"ground.friction": frictions},
        times=STEPS,
        options=options,
        progress=False,
        keep_states=True,
        outputs={"shear": lambda f: f.force("ground")[..., 1:].mean(axis=2)},
    )
    assert grid.force("ground").shape[:2] == (2, len(STEPS))
    assert grid.output("shear").shape == (2, len(STEPS), 2)
    for k, friction in enumerate(frictions):
        alone = solve(
            assemble(_with(scene, Contact(friction=friction))), times=STEPS, options=options
        )
        # nine points for four nodes: single forces are not unique, resultants and displacements are
        weights = problem.interfaces["ground"].weights
        both = (np.tensordot(f, weights, (1, 0)) for f in (grid.force("ground")[k], alone.force("ground")))
        assert np.allclose(*both, atol=1e-6 * AREA)
        assert np.allclose(grid.point(k).displacements["block"], alone.displacements["block"], atol=1e-9)
    # a swept value keeps its amplitude
    swept = sweep(problem, {"drive.jump": pulls}, times=STEPS, options=options, progress=False)
    assert swept.force("ground").shape == (2, len(STEPS), problem.interfaces["ground"].num_points, 3)


def _with(scene: Scene, law: Contact) -> Scene:
    from dataclasses import replace

    scene.interfaces["ground"] = replace(scene.interfaces["ground"], law=law)
    return scene


def test_mistakes_are_named() -> None:
    problem = loaded_everywhere()
    with pytest.raises(SceneError, match=r"'layer'.*change in time: solve with times"):
        solve(problem)
    with pytest.raises(SceneError, match="times increase"):
        solve(problem, times=[0.0, 1.0, 1.0])
    with pytest.raises(SceneError, match="increasing numbers"):
        solve(problem, times=[])
    with pytest.raises(SceneError, match="times increase, but 1 is followed by 0"):
        Amplitude([1, 0], [0, 1])
    with pytest.raises(SceneError, match="2 times and 1 values"):
        Amplitude([0, 1], [0])
    with pytest.raises(SceneError, match="is an amplitude"):
        Pressure(Amplitude([0, 1], [0, 1]))
    with pytest.raises(SceneError, match="random and changes in time"):
        Elastic(normal=Amplitude([0, 1], [0, 1]) * Normal("D", mean=1.0, cov=0.1))
    scene = jenkins(Contact(friction=Amplitude([0, 1], [0, 1]) * -0.3))
    with pytest.raises(SceneError, match=r"'ground': friction -0.3 is negative"):
        solve(assemble(scene), times=[1.0])


def test_laws_that_change_in_time_stay_active() -> None:
    scene = Scene()
    box = geometry.box((20.0, 10.0, 10.0), (1, 1, 1), cell="hexahedron")
    scene.substructure("block", box, LinearElastic(E=200e3, nu=0.0), degree=1)
    hardening = Amplitude([0, 1], [1, 2])
    scene.interface("spring", "block:x0", Elastic(normal=hardening * 50.0, tangential=50.0))
    scene.traction("block:x1", (10.0, 0.0, 0.0))
    problem = assemble(scene)
    plan = make_plan(problem, times=[0.0, 1.0])
    assert plan.active == ("spring",) and plan.history == "steps"
    result = solve(problem, times=[0.0, 1.0], options=TIGHT)
    opening = np.abs(result.jump("spring")[..., 0])
    assert np.allclose(opening[0], 10.0 / 50.0) and np.allclose(opening[1], 10.0 / 100.0)
    assert isinstance(problem.interfaces["spring"].law, Elastic)
    assert Perfect().varying == {}
