"""Slip over load cycles: a block on a frictional ground in closed form, and the bolted lap joint."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LinearElastic,
    Options,
    Scene,
    SceneError,
    assemble,
    geometry,
    solve,
)
from dolfinx_frontend.geometry.finer import cell_sizes, size_field
from parts.lap_joint import LapJoint, lap_joint
from tests.verification import scenes

TIGHT = 1e-6  # tolerance of the iteration; sums over interfaces are held to 100 times that


# A block of 10 x 10 x 2 mm on rigid ground, pressed with 5 MPa and drawn by a spring of 1 000 N/mm: a Jenkins
# element. Slip begins at mu N = 100 N, when the spring has been drawn by 0.1 mm.
PRESSURE, MU, SPRING, AREA = 5.0, 0.2, 1000.0, 100.0
BOUND = MU * PRESSURE * AREA
MODULUS = 2e6  # MPa
GIVE = SPRING * 10.0 / (MODULUS * 20.0)  # what the block gives way, relative to the spring: 2.5e-4


def drawn_block(ends: list[float], steps: int):
    """The block over a polygon of spring displacements, with `steps` steps per side."""
    block = geometry.box((10.0, 10.0, 2.0), (2, 2, 1), cell="hexahedron")
    corners = np.arange(len(ends) + 1.0) + 1.0
    draw = Amplitude(corners, [0.0, *ends])
    scene = Scene()
    scene.substructure("block", block, LinearElastic(E=MODULUS, nu=0.0), degree=1)
    scene.interface("ground", "block:z0", Contact(gap=0.0, friction=MU))
    scene.pressure("block:z1", Amplitude([0.0, 1.0], [0.0, 1.0]) * PRESSURE)
    # the jump of a spring to the ground is -w: drawing the block along +x is a negative one
    spring = Elastic(normal=SPRING, total=True, jump=draw * -1.0)
    scene.interface("spring", "block:x1", spring)
    times = np.linspace(1.0, corners[-1], len(ends) * steps + 1)
    result = solve(
        assemble(scene), times=times, options=Options(rtol=1e-9, max_iterations=5000)
    )
    assert result.converged
    return result, np.array([draw(t) for t in times])


def jenkins(drawn):
    """Force and slip of a spring in series with a slider."""
    force, slip = np.zeros(len(drawn)), np.zeros(len(drawn))
    for k in range(1, len(drawn)):
        trial = SPRING * (drawn[k] - slip[k - 1])
        force[k] = np.clip(trial, -BOUND, BOUND)
        slip[k] = drawn[k] - force[k] / SPRING
    return force, slip


@pytest.mark.parametrize("steps", [3, 4])
def test_a_drawn_block_is_a_jenkins_element(steps):
    reach = 0.25
    result, drawn = drawn_block([reach, -reach, reach], steps)
    force, slip = jenkins(drawn)
    ground, spring = (result.problem.interfaces[name] for name in ("ground", "spring"))
    friction = np.einsum("p,pc,tpc->t", ground.weights, ground.frames[:, :, 0], result.force("ground"))
    moved = -np.einsum("p,pc,tpc->t", ground.weights, ground.frames[:, :, 0], result.jump("ground"))
    assert np.allclose(friction, -force, atol=GIVE * BOUND)
    assert np.allclose(moved / AREA, slip, atol=GIVE * reach)
    assert np.allclose(
        result.force("spring")[..., 0] @ spring.weights, force, atol=GIVE * BOUND
    )
    # one cycle, from the first reversal back to it: the parallelogram
    heat = result.dissipation("ground")
    cycle = 4.0 * BOUND * (reach - BOUND / SPRING)
    assert abs(heat[-1] - heat[steps] - cycle) < GIVE * cycle
    assert np.all(np.diff(heat) > -1e-6 * cycle)


def test_below_the_bound_nothing_slips():
    reach = 0.9 * BOUND / SPRING
    result, drawn = drawn_block([reach, -reach], 3)
    force = result.force("spring")[..., 0] @ result.problem.interfaces["spring"].weights
    assert np.allclose(force, SPRING * drawn, atol=GIVE * BOUND)
    assert abs(result.dissipation("ground")[-1]) < GIVE * BOUND * reach


# ---------------------------------------------------------------------------------------------
# The bolted lap joint
# ---------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def demo() -> ModuleType:
    return scenes.demo("bolted_lap_joint")


@pytest.fixture(scope="module")
def joint() -> LapJoint:
    return lap_joint("coarse")


def test_parts_have_the_sizes_of_the_drawing(joint):
    half_ring = 0.5 * np.pi * (11.0**2 - 7.0**2)
    volumes = {
        "lower": 10.0 * (110.0 * 20.0 - 2 * 0.5 * np.pi * 7.0**2),
        "head1": 8.0 * 0.5 * np.pi * 11.0**2,
        "nut2": 8.0 * 0.5 * np.pi * (11.0**2 - 6.0**2),
        "shank1": 28.0 * 0.5 * np.pi * 6.0**2,
    }
    for name, volume in volumes.items():
        assert joint.parts[name].volume() == pytest.approx(volume, rel=2e-3)
    for name in ("upper:seat1", "lower:seat2"):
        part, face = joint.face(name)
        assert part.face_area(face) == pytest.approx(half_ring, rel=2e-3)
    for name in ("lower:lap", "upper:lap"):
        part, face = joint.face(name)
        assert part.face_area(face) == pytest.approx(80.0 * 20.0 - np.pi * 7.0**2, rel=2e-3)
    assert joint.clearance == 1.0
    for each in joint.interfaces:
        for face in filter(None, (each.face1, each.face2)):
            joint.face(face)


@pytest.mark.parametrize(
    ("name", "volume"), [("shank1", 28.0 * 0.5 * np.pi * 6.0**2), ("nut2", 4.0 * np.pi * (11.0**2 - 6.0**2))]
)
def test_parts_are_meshed_again_on_the_true_cylinders(joint, name, volume):
    """Parabolas miss R phi^4 / 960: half the size leaves a sixteenth, a quarter where sizes vary."""
    part = joint.parts[name]
    again = part.again(size_field(part.mesh, 0.5 * cell_sizes(part.mesh)))
    assert set(again.names) == set(part.names)
    assert abs(again.volume() - volume) < 0.25 * abs(part.volume() - volume)


def test_mistakes_in_the_drawing_are_named():
    with pytest.raises(SceneError, match=r"radii.*must grow"):
        lap_joint(hole_radius=5.0)
    with pytest.raises(SceneError, match="head_radius = 30"):
        lap_joint(head_radius=30.0)
    with pytest.raises(SceneError, match="thicknes"):
        lap_joint(thicknes=3.0)
    with pytest.raises(SceneError, match="fine"):
        lap_joint("fine")
    with pytest.raises(SceneError, match="size = -1"):
        lap_joint(-1.0)
    with pytest.raises(SceneError, match="geometry_order"):
        lap_joint(geometry_order=3)


@pytest.fixture(scope="module")
def loop(demo, joint):
    """The cycle of the demo with four steps a quarter."""
    loop = demo.hysteresis(joint, 4, rtol=TIGHT)
    assert loop.result.converged
    return loop


def total(problem, name, field, step):
    """Resultant (3,) of an interface at a step, in the local frame, which is the same at all points."""
    weights, frames = problem.interfaces[name].weights, problem.interfaces[name].frames
    return np.einsum("p,pci,pc->i", weights, frames, field[step])


def test_the_load_goes_through_the_clamp(demo, joint):
    """Load from the contacts against the reaction of the clamp, from the matrix of the lower plate."""
    problem = demo.study_problem(joint)
    options = demo.SETTINGS.with_(rtol=TIGHT)
    result = solve(problem, times=demo.TIMES, options=options)
    assert result.converged
    lower = problem.substructures["lower"]
    u = result.displacements["lower"]
    carried = demo.load(problem, result)
    pull = np.zeros(lower.size)
    pull[::3] = 1.0  # the work of all forces on a unit displacement along x
    for step, expected in enumerate(carried):
        x, y = lower.stiffness.createVecs()
        x.setArray(u[step])
        lower.stiffness.mult(x, y)
        inner = y.getArray().reshape(-1, 3)[:, 0]
        at = lower.V.tabulate_dof_coordinates()[:, 0]
        clamp = inner[at < at.min() + 1e-9].sum()
        assert demo.HALVES * clamp == pytest.approx(-expected, rel=1e-4)
        assert abs(pull @ y.getArray()) < 1e-9 * abs(clamp) * len(inner)  # a rigid motion does no work
    # friction on the plates and under the nuts is all that holds
    pressed = [
        problem.interfaces[name].weights @ result.force(name)[-1, :, 0] for name in demo.ON_LOWER
    ]
    assert carried[-1] <= demo.HALVES * demo.FRICTION * abs(np.array(pressed)).sum()
    assert carried[-1] > demo.HALVES * demo.FRICTION * abs(pressed[0]) * 0.9  # the plates slip


def test_every_part_of_a_bolt_is_in_balance(demo, loop):
    """Head, and shank with nut, touch nothing but a seat and the cut: the two forces cancel."""
    result, problem = loop.result, loop.result.problem
    size = demo.BOLT * demo.SHORTENING / 2.0  # of half a bolt between rigid plates
    for n in (1, 2):
        for step in (0, loop.first, len(result.times) - 1):
            # forces on side 1: the upper plate, the lower plate, the shank
            head = -total(problem, f"head{n}", result.force(f"head{n}"), step)
            nut = -total(problem, f"nut{n}", result.force(f"nut{n}"), step)
            cut = total(problem, f"cut{n}", result.force(f"cut{n}"), step)
            off = np.array([1.0, 0.0, 1.0])  # the plane of symmetry carries forces along y
            assert np.allclose(off * (head - cut), 0.0, atol=100 * TIGHT * size)
            assert np.allclose(off * (nut + cut), 0.0, atol=100 * TIGHT * size)
            # clamped between elastic plates: in tension, by less than between rigid ones
            assert 0.5 * size < cut[2] < size


def test_friction_holds_its_bound_everywhere(demo, loop):
    for name in demo.CONTACTS:
        force, jump = loop.result.force(name), loop.result.jump(name)
        largest = np.abs(force[..., 0]).max()
        assert force[..., 0].max() <= 1e-12 * largest
        sheared = np.linalg.norm(force[..., 1:], axis=2)
        assert np.all(sheared <= demo.FRICTION * np.abs(force[..., 0]) + 1e-9 * largest)
        # below its bound a closed facet sticks; it loses no energy by slipping, ever
        slipped = np.diff(jump[..., 1:], axis=0)
        sticks = (sheared < 0.99 * demo.FRICTION * np.abs(force[..., 0]))[1:]
        assert np.linalg.norm(slipped[sticks], axis=-1).max() <= 100 * TIGHT * demo.REACH
    assert np.all(np.diff(loop.heat) >= -100 * TIGHT * loop.heat[-1])


def test_the_plates_slip_at_friction_times_pressing_force(demo, loop):
    """One surface between the plates; slip that is not along x everywhere takes a little of it."""
    sliding = np.abs(loop.plates) / (demo.FRICTION * loop.pressed)
    assert sliding.max() <= 1.0 + 1e-9
    moving = np.abs(np.diff(loop.slip, prepend=0.0)) > 0.2 * demo.REACH / 4
    assert moving.sum() >= 10
    assert sliding[moving].min() > 0.995


def test_without_shear_in_the_bolts_the_joint_slips_at_friction_times_clamping(demo, joint):
    """Bolts cut by a smooth plane: mu N on one surface is all that the joint carries."""
    problem = demo.study_problem(joint)
    laws = {n: problem.interfaces[n].law.with_(tangential=None) for n in demo.CUTS}
    smooth = problem.with_laws(laws)
    options = demo.SETTINGS.with_(rtol=TIGHT)
    result = solve(smooth, times=[1.0, 1.5, 2.0], options=options)
    assert result.converged
    carried = demo.load(smooth, result)
    pressed = -demo.HALVES * result.force("plates")[..., 0] @ smooth.interfaces["plates"].weights
    bound = demo.FRICTION * pressed
    for name in ("nut1", "nut2"):
        sheared = demo.along_x(smooth, name, result.force(name))
        assert np.abs(sheared).max() <= 100 * TIGHT * bound.max()
    # the end is drawn by 40 and by 80 um: both times they slip
    assert np.allclose(carried[1:], bound[1:], rtol=5e-3)
    assert np.all(carried[1:] <= bound[1:] * (1.0 + 100 * TIGHT))


def test_the_loop_balances_its_energies(demo, joint, loop):
    """Work of the end = work taken up by the contacts + stored energy, exactly; the heat for small steps."""
    assert loop.moved[-1] == loop.moved[loop.first]
    balance = loop.area - loop.cycle(loop.work) - loop.cycle(loop.stored)
    assert abs(balance) <= 100 * TIGHT * loop.area
    assert abs(loop.cycle(loop.stored)) < 0.02 * loop.area  # nearly a closed loop
    # the force at the end of a step instead of its mean: an error of the order of the step
    fine = demo.hysteresis(joint, 8, rtol=TIGHT)
    apart = [abs(each.cycle(each.heat) / each.cycle(each.work) - 1.0) for each in (loop, fine)]
    assert apart[0] < 0.04
    assert apart[1] < 0.6 * apart[0]
    assert fine.area == pytest.approx(loop.area, rel=0.05)
