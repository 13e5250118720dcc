"""Laws of users: the documentation as it stands, equality with built-in laws, and every mistake named."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import latin_core
import numpy as np
import numpy.typing as npt
import pytest
from latin_core import InputError, Options

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.evaluate.sweep import sweep
from dolfinx_frontend.kernel.user_laws import batched
from dolfinx_frontend.plan.plan import Direction, make_plan
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Debonding, Elastic, Law, Preload, UserLaw
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import monte_carlo
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import LogNormal

pytestmark = pytest.mark.sanitize

Array = npt.NDArray[np.float64]
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "laws.md"
TIGHT = Options(rtol=1e-11, max_iterations=1000)
E, LENGTH, AREA = 200e3, 40.0, 100.0


def blocks(law: Law, load: Any = (-5.0, 1.0, 0.5), pulled: Any = None) -> Problem:
    """Two blocks end to end, the left one held, the right one loaded or pulled at its end."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (2, 2, 2), origin=(x0, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(E=E, nu=0.0), degree=1)
    scene.interface("joint", "left:x1", "right:x0", law)
    scene.fix("left:x0")
    if pulled is None:
        scene.traction("right:x1", load)
        if not law.holds(3)[1]:
            scene.fix("right:x1", components=(1, 2))
    elif isinstance(pulled, float):
        scene.fix("right:x1", (pulled, 0.0, 0.0))
    else:
        scene.fix("right:x1", pulled)
    return assemble(scene)


def with_law(problem: Problem, law: Law) -> Problem:
    interfaces = problem.interfaces | {"joint": replace(problem.interfaces["joint"], law=law)}
    return Problem(problem.substructures, interfaces)


def linear(jump: Array, *, stiffness: Array) -> Array:
    return stiffness[:, None] * jump


def stop(jump: Array, flexibility: Array, *, gap: Array) -> Array:
    force = np.zeros_like(jump)
    force[:, 0] = np.minimum(0.0, (jump[:, 0] + gap) / flexibility[:, 0])
    return force


# --- the documentation ------------------------------------------------------------------------------


def test_the_documentation_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = re.findall(r"^```(\w+)\n(.*?)^```", DOCUMENT.read_text(), flags=re.S | re.M)
    kinds = [kind for kind, _ in found]
    assert kinds.count("cpp") == kinds.count("sh") == 1 and kinds.count("python") >= 4
    compiler = shutil.which("c++") and shutil.which("pkg-config")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    names: dict[str, Any] = {}
    for kind, text in found:
        if kind == "python" and (compiler or "import pad" not in text):
            exec(compile(text, str(DOCUMENT), "exec"), names)
        elif kind == "cpp":
            (tmp_path / "pad.cpp").write_text(text)
        elif kind == "sh" and compiler:
            done = subprocess.run(["bash", "-ec", text], capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
    if not compiler:
        pytest.skip("no C++ compiler: the compiled law was not tried")
    law: UserLaw = names["law"]
    assert law.compiled is not None
    problem = names["block_pair"](law, moved=0.1)
    for bad, message in (
        ({"values": {"stiffness": 1.0}}, "takes the values limit, stiffness, got stiffness"),
        ({"history": False}, "give history=True"),
    ):
        with pytest.raises(SceneError, match=f"'pad'.*{message}"):
            solve(problem.with_laws({"pad": replace(law, **bad)}))
    with pytest.raises(InputError, match=r"interface 'pad'.*'stiffness'.*at least 0"):
        solve(problem.with_laws({"pad": law.with_(stiffness=-1.0)}))
    sys.modules.pop("pad", None)


def test_capsules_of_others_are_refused() -> None:
    from datetime import datetime_CAPI  # type: ignore[attr-defined]

    with pytest.raises(InputError, match="LawFactory"):
        solve(blocks(UserLaw(compiled=datetime_CAPI, name="date")))
    assert (Path(latin_core.get_include()) / "latin" / "interface" / "pointwise.hpp").is_file()


# --- equal to built-in laws -------------------------------------------------------------------------


def test_an_elastic_law_by_its_force_equals_the_built_in_one() -> None:
    elastic = Elastic(normal=60.0, tangential=60.0, jump=(-0.02, 0.01, 0.0))
    problem = blocks(elastic)
    law = UserLaw(force=linear, values={"stiffness": 60.0}, jump=elastic.jump)
    built = solve(problem, active=["joint"], options=TIGHT)
    # that it is linear is not known of it: what the built-in one profits from is left out for both
    plain = TIGHT.with_(newton=0, directions="diagonal")
    own = solve(with_law(problem, law), options=plain, direction=Direction(given={"joint": 120.0}))
    again = solve(
        problem, active=["joint"], options=plain, direction=Direction(given={"joint": 120.0})
    )
    assert abs(own.iterations - again.iterations) <= 1  # a law of a user is not known to be linear
    for name in ("force", "jump"):
        expected = getattr(again, name)("joint")
        assert np.allclose(
            getattr(own, name)("joint"), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
        )
    assert np.allclose(own.force("joint"), built.force("joint"), atol=1e-8)


@pytest.mark.parametrize("gap", [0.0, 0.001])
def test_contact_by_its_resolvent_equals_the_built_in_one(gap: float) -> None:
    problem = blocks(Contact(gap=gap), load=(-5.0, 0.0, 0.0))
    law = UserLaw(resolve=stop, values={"gap": gap}, components="normal")
    plain = TIGHT.with_(newton=0)  # Newton's method asks the two at different flexibilities
    built = solve(problem, options=plain)
    own = solve(with_law(problem, law), options=plain)
    assert own.iterations == built.iterations
    expected = built.force("joint")
    assert np.allclose(own.force("joint"), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert not own.problem.interfaces["joint"].law.history


def question(
    law: UserLaw, points: int = 40, columns: int = 3, seed: int = 0, size: float = 1.0
) -> tuple[Array, Array, dict[str, Array], Callable[..., Array]]:
    """A question of the kernel to a law: free jumps, flexibility, values, and who answers."""
    rng = np.random.default_rng(seed)
    problem = blocks(Contact())
    interface = replace(problem.interfaces["joint"], points=rng.random((points, 3)))
    components = 1 if law.components == "normal" else 3
    jump = size * rng.standard_normal((points, components, columns))
    flexibility = 10.0 ** rng.uniform(-3, 3, (points, components, 1))
    values = {k: np.full((points, columns), float(v)) for k, v in law.values.items()}
    return jump, flexibility, values, batched(law, interface)


def cube(jump: Array) -> Array:
    return jump**3 * 1e4


def kinked(jump: Array) -> Array:
    return np.where(jump < 0.0, 1e6 * jump, 0.01 * jump)


def hard(jump: Array) -> Array:
    return np.sinh(20.0 * jump)


def rotating(jump: Array) -> Array:
    # monotone, but no gradient of an energy: its tangent is not symmetric
    turned = np.stack([-jump[:, 1], jump[:, 0], 0.0 * jump[:, 2]], axis=1)
    return 3.0 * turned + np.sum(jump**2, axis=1)[:, None] * jump


def yielding(jump: Array) -> Array:
    return 5.0 * np.clip(100.0 * jump, -1.0, 1.0)


def rigid_plastic(jump: Array) -> Array:
    return 3.0 * np.sign(jump)  # a graph with a step, which is filled in


def coupled(jump: Array) -> Array:
    # the gradient of cosh |j|: stiff far away
    size = np.maximum(np.linalg.norm(jump, axis=1), 1e-300)[:, None]
    return np.sinh(8.0 * size) / size * jump


@pytest.mark.parametrize("force", [cube, hard, rotating, coupled])
def test_newton_finds_the_resolvent_of_any_monotone_law(force: Callable[[Array], Array]) -> None:
    jump, flexibility, values, answer = question(UserLaw(force=force))
    got = answer(jump, flexibility, values, 1)
    # the graph is met: f = R(j0 - c f), in the metric in which G is strongly monotone
    root = np.sqrt(flexibility)
    left = jump - flexibility * got
    off = np.abs(root * (force(left) - got)).max(axis=1)
    size = (np.abs(jump) / root + np.abs(root * got)).max(axis=1)
    # what rounding of j0 does to R(j)
    blur = np.abs(root * (force(left + 1e-14 * np.abs(jump)) - force(left))).max(axis=1)
    assert np.all(off <= 1e-10 * size + 10 * blur)


def test_kinks_and_steps_are_found_too() -> None:
    for force, exact in (
        (kinked, lambda j, c: np.where(j < 0, j / (c + 1e-6), j / (c + 100.0))),
        (yielding, lambda j, c: np.clip(j / (c + 1 / 500.0), -5.0, 5.0)),
        (rigid_plastic, lambda j, c: np.clip(j / c, -3.0, 3.0)),
    ):
        jump, flexibility, values, answer = question(UserLaw(force=force))
        expected = exact(jump, flexibility)
        got = answer(jump, flexibility, values, 1)
        assert np.all(np.abs(got - expected) <= 1e-13 * np.abs(jump) / flexibility + 1e-12), force


def test_a_tangent_saves_calls_and_changes_nothing() -> None:
    calls = []

    def force(jump: Array) -> Array:
        calls.append(1)
        return jump**3 + jump

    def tangent(jump: Array) -> Array:
        out = np.zeros((*jump.shape[:2], *jump.shape[1:]))
        for a in range(jump.shape[1]):
            out[:, a, a] = 3.0 * jump[:, a] ** 2 + 1.0
        return out

    jump, flexibility, values, answer = question(UserLaw(force=force))
    by_differences = answer(jump, flexibility, values, 1)
    first = len(calls)
    *_, answer = question(UserLaw(force=force, tangent=tangent))
    with_tangent = answer(jump, flexibility, values, 1)
    assert len(calls) - first < first / 2
    assert np.allclose(by_differences, with_tangent, rtol=1e-12, atol=0.0)


# --- values that vary -------------------------------------------------------------------------------


def test_values_are_swept_sampled_and_fields() -> None:
    def springy(x: Array) -> Array:
        return 40.0 + x[:, 1]

    law = UserLaw(force=linear, values={"stiffness": springy})
    problem = blocks(law, load=(-5.0, 0.0, 0.0))
    assert problem.interfaces["joint"].law.parameters()["stiffness"] is springy
    y = problem.interfaces["joint"].points[:, 1]
    result = solve(problem, options=TIGHT)
    assert np.allclose(result.force("joint"), (40.0 + y)[:, None] * result.jump("joint"), rtol=1e-10)

    surface = sweep(problem, {"joint.stiffness": [20.0, 50.0]}, options=TIGHT, progress=False)
    jump = surface.jump("joint")[..., 0]
    assert np.allclose(jump.T, [-5.0 / 20.0, -5.0 / 50.0], rtol=1e-8)

    random = with_law(problem, law.with_(stiffness=LogNormal("k", mean=50.0, cov=0.2)))
    samples = monte_carlo(random, 8, progress=False, options=TIGHT)
    drawn = samples.random.space.values(samples.random.source("joint", "stiffness"), samples.germs)
    jumps = samples.jump("joint")[..., 0]
    assert np.allclose(jumps, -5.0 / np.reshape(drawn, (8, 1)), rtol=1e-8)
    # chaos evaluates the law at quadrature points; E[1 / k] of a lognormal k is (1 + cov^2) / mean
    chaos = solve(random, chaos=4, options=Options(rtol=1e-9))
    mean = chaos.jump_coefficients("joint")[:, 0, 0]
    assert np.allclose(mean, -5.0 * 1.04 / 50.0, rtol=1e-4)


def test_the_stiffness_of_a_contact_is_swept_and_sampled() -> None:
    problem = blocks(Contact(stiffness=50.0), load=(-5.0, 0.0, 0.0))
    stiffness = [10.0, 40.0, 90.0]
    surface = sweep(problem, {"joint.stiffness": stiffness}, options=TIGHT, progress=False)
    jump = surface.jump("joint")[..., 0]
    assert np.allclose(jump.T, -5.0 / np.array(stiffness), rtol=1e-8)
    with pytest.raises(SceneError, match=r"'joint': contact stiffness 0: it must be > 0"):
        sweep(problem, {"joint.stiffness": [0.0, 2.0]}, progress=False)

    k = LogNormal("k", mean=50.0, cov=0.2)
    field = RandomField("k", 50.0, cov=0.2, length=20.0, modes=3, distribution="lognormal")
    for value in (k, field):
        random = with_law(problem, Contact(stiffness=value))
        samples = monte_carlo(random, 6, progress=False, options=TIGHT)
        drawn = samples.random.space.values(
            samples.random.source("joint", "stiffness"), samples.germs
        )
        force, jump = samples.force("joint")[..., 0], samples.jump("joint")[..., 0]
        drawn = np.atleast_2d(drawn).T if drawn.ndim == 1 else drawn.T
        assert np.allclose(force, np.broadcast_to(drawn, force.shape) * jump, rtol=1e-10)


# --- debonding and preload --------------------------------------------------------------------------

BOND = Debonding(normal=500.0, tangential=300.0, strength=5.0, opening=0.05)


@pytest.mark.parametrize("pulled", [0.005, 0.0115, 0.02, 0.04, 0.06, -0.01])
@pytest.mark.parametrize("by_energy", [False, True])
def test_a_bond_between_two_bars_follows_the_closed_form(pulled: float, by_energy: bool) -> None:
    # in series with a bar of stiffness E / L per area: u = f L / E + j
    law = replace(BOND, opening=None, energy=0.125) if by_energy else BOND
    # once it is apart nothing is strained, and a relative error has little to relate to
    result = solve(blocks(law, pulled=pulled), options=Options(rtol=1e-8))
    assert result.converged
    bar, first, last = E / LENGTH, 5.0 / 500.0, 0.05
    elastic = pulled / (1 / bar + 1 / 500.0)
    slope = 5.0 / (last - first)
    if elastic <= 5.0:
        expected = elastic
    elif pulled < last:
        # f = slope (last - j), u = f / bar + j
        expected = slope * (last - pulled) / (1.0 - slope / bar)
    else:
        expected = 0.0
    assert np.allclose(result.force("joint")[:, 0], expected, atol=1e-6)
    # the smallest direction with one answer, for two sides, with the margin
    joint = result.problem.interfaces["joint"]
    fields = joint.law.fields(joint)
    assert fields.softest is not None
    assert np.allclose(fields.softest, np.array([1.0, 0.6, 0.6]) * 2.0 * 2.0 * slope)


def test_a_bond_raises_the_search_direction_or_says_so() -> None:
    brittle = Debonding(normal=2e5, tangential=2e5, strength=50.0, energy=0.02)
    problem = blocks(brittle, pulled=0.001)
    low = Direction(factor=1e-3)
    assert solve(problem, direction=low, options=TIGHT).converged
    with pytest.raises(InputError, match=r"'joint', law 'debonding'.*search direction is too small"):
        solve(problem, direction=Direction(given={"joint": 10.0}))


def test_damage_stays_after_the_load_is_gone() -> None:
    # loaded, unloaded to a quarter, pushed, and loaded as before
    u = 0.02
    cycle = Amplitude([0, 1, 2, 3], [1.0, 0.25, -0.5, 1.0])
    result = solve(blocks(BOND, pulled=cycle * (u, 0.0, 0.0)), options=TIGHT, times=[0, 1, 2, 3])
    assert result.converged
    force, jump = result.force("joint")[..., 0], result.jump("joint")[..., 0]
    bar, slope = E / LENGTH, 5.0 / 0.04
    f = slope * (0.05 - u) / (1.0 - slope / bar)
    secant = f / (u - f / bar)
    expected = np.array([f, 0.25 * f, -0.5 * u / (1 / bar + 1 / 500.0), f])
    assert np.allclose(force, expected[:, None], atol=1e-7)
    assert np.allclose(force[1], secant * jump[1], atol=1e-7)
    assert BOND.history and not Elastic(normal=1.0).history
    assert Contact(friction=0.1).history and not Contact(friction=0.0).history


def test_a_bond_of_uncertain_strength() -> None:
    problem = blocks(BOND, pulled=0.02)
    slope = E / LENGTH

    def exact(strength: Array, opening: float) -> Array:
        soft = strength / (opening - strength / 500.0)
        return np.minimum(
            0.02 / (1 / slope + 1 / 500.0), soft * (opening - 0.02) / (1.0 - soft / slope)
        )

    strength = np.array([4.0, 5.0, 6.0])
    surface = sweep(problem, {"joint.strength": strength}, options=TIGHT, progress=False)
    assert np.allclose(surface.force("joint")[..., 0].T, exact(strength, 0.05), atol=1e-7)
    # with an energy the opening follows the strength
    by_energy = with_law(problem, replace(BOND, opening=None, energy=0.125))
    surface = sweep(by_energy, {"joint.strength": strength}, options=TIGHT, progress=False)
    expected = [float(exact(np.array(s), 0.25 / s)) for s in strength]
    assert np.allclose(surface.force("joint")[..., 0].T, expected, atol=1e-7)
    uncertain = with_law(problem, replace(BOND, strength=LogNormal("s", mean=5.0, cov=0.1)))
    samples = monte_carlo(uncertain, 6, progress=False, options=TIGHT)
    drawn = samples.random.space.values(samples.random.source("joint", "strength"), samples.germs)
    assert np.allclose(samples.force("joint")[..., 0].T, exact(np.ravel(drawn), 0.05), atol=1e-7)
    with pytest.raises(SceneError, match=r"'joint.strength' takes the value -1: it must be >= 0"):
        sweep(problem, {"joint.strength": [-1.0]}, progress=False)


def test_a_preload_by_force_is_found_again_in_the_result() -> None:
    problem = blocks(Preload(force=300.0), pulled=0.0)
    result = solve(problem, options=TIGHT)
    weights = problem.interfaces["joint"].weights
    assert abs(weights @ result.force("joint")[:, 0] - 300.0) < 1e-8
    # the bars of 40 mm are stretched by 3 MPa, and the section has closed by as much
    assert np.allclose(result.jump("joint")[:, 0], -3.0 * LENGTH / E, rtol=1e-7)
    assert np.allclose(result.jump("joint")[:, 1:], 0.0, atol=1e-12)

    per_area = solve(with_law(problem, Preload(force=3.0, total=False)), options=TIGHT)
    assert np.allclose(per_area.force("joint"), result.force("joint"))
    surface = sweep(problem, {"joint.force": [100.0, 200.0]}, options=TIGHT, progress=False)
    assert np.allclose(surface.force("joint")[..., 0].T, [1.0, 2.0], rtol=1e-8)


def test_a_preload_is_locked_after_its_time() -> None:
    law = Preload(force=300.0, until=1.0)
    interface = blocks(law, pulled=0.0).interfaces["joint"]
    assert law.history and not Preload(force=1.0).history
    times = (None, 0.5, 1.0, 1.0 + 1e-12, 1.1)
    locked = [law.fields(interface, t).parameters["locked"].max() for t in times]
    assert locked == [0.0, 0.0, 0.0, 0.0, 1.0]

    # tightened between two walls, locked, then one wall moves
    wall = Amplitude([1, 2], [0, 1]) * (0.001, 0.0, 0.0)
    for force in (300.0, Amplitude([0, 0.5], [0, 1]) * 300.0):
        problem = blocks(replace(law, force=force), pulled=wall)
        result = solve(problem, options=TIGHT, times=[0.5, 1.0, 1.5, 2.0])
        assert result.converged
        # once it is locked, the bars take 0.001 mm over 40 mm: 5 MPa more
        expected = np.array([3.0, 3.0, 5.5, 8.0])
        # of pressures that move nothing rounding leaves 8 eps over the softening of the preconditioner, 1e-5
        assert np.allclose(result.force("joint")[..., 0], expected[:, None], rtol=0.0, atol=1e-8)
        assert np.allclose(result.jump("joint")[..., 0], -3.0 * LENGTH / E, atol=1e-12)
        weights = problem.interfaces["joint"].weights
        assert abs(weights @ result.force("joint")[1, :, 0] - 300.0) < 1e-8


@pytest.mark.parametrize("active", [None, "all"])
def test_a_rigid_contact_beside_a_locked_preload(active: Any) -> None:
    """Only the sum of what both carry is determined, until one of them has a stiffness: 300 N and -300 N."""
    sides = "left:x1", "right:x0"
    times = [1.0, 2.0]

    def with_contact(law: Law, contact: Contact) -> Problem:
        scene = Scene()
        for name, x0 in (("left", 0.0), ("right", 20.0)):
            box = geometry.box((20.0, 10.0, 10.0), (2, 2, 2), origin=(x0, 0.0, 0.0), cell="hexahedron")
            scene.substructure(name, box, LinearElastic(E=E, nu=0.0), degree=1)
        scene.fix("left:x0")
        scene.interface("joint", *sides, law)
        scene.interface("face", *sides, contact)
        return assemble(scene)

    for law in (Preload(force=300.0, until=1.0), Preload(shortening=0.001)):
        with pytest.warns(SceneWarning, match="'joint' and 'face' are rigid .* not determined; give Preload"):
            make_plan(with_contact(law, Contact()), times=times, active=active)
    for law, contact in (
        (Preload(force=300.0, until=1.0, stiffness=2e5), Contact()),
        (Preload(force=300.0, until=1.0), Contact(stiffness=1e5)),
    ):
        result = solve(with_contact(law, contact), options=TIGHT, times=times, active=active)
        for name, force in (("joint", 300.0), ("face", -300.0)):
            weights = result.problem.interfaces[name].weights
            assert result.force(name)[..., 0] @ weights == pytest.approx([force, force], rel=1e-8)


def test_a_preload_in_intervals() -> None:
    """Nothing before its turn, tightened, locked, and tightened again while a wall moves."""
    law = Preload(force=Amplitude([1, 2], [1, 2]) * 300.0, during=((0.0, 1.0), (3.0, 4.0)))
    assert law.history
    assert [law.controlled(t) for t in (0.0, 0.5, 1.0 + 1e-12, 2.0, 3.0, 4.0, 5.0)] == [
        True, True, True, False, False, True, False
    ]
    assert [law.waits(t) for t in (0.0, 0.5, 2.0)] == [True, False, False]
    wall = Amplitude([-1, 0, 1, 2, 3, 4, 5], [1, 1, 0, 0, 1, 1, 0]) * (0.001, 0.0, 0.0)
    result = solve(blocks(law, pulled=wall), options=TIGHT, times=[0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert result.converged
    # 0.001 mm over 40 mm are 5 MPa
    expected = np.array([0.0, 3.0, 3.0, 8.0, 6.0, 1.0])
    assert np.allclose(result.force("joint")[..., 0], expected[:, None], atol=1e-8)
    with pytest.raises(SceneError, match="until and during are given: give one"):
        Preload(force=1.0, until=1.0, during=((0.0, 1.0),))
    with pytest.raises(SceneError, match=r"give intervals \(\(start, end\), ...\)"):
        Preload(force=1.0, during=(0.0, 1.0))  # type: ignore[arg-type]
    for spans in ((), ((1.0, 1.0),), ((0.0, 2.0), (1.0, 3.0)), ((0.0, np.inf),)):
        with pytest.raises(SceneError, match="intervals"):
            Preload(force=1.0, during=spans)


def test_a_history_of_a_user_law_equals_friction() -> None:
    def rub(jump: Array, flexibility: Array, *, friction: Array, steps: int) -> Array:
        force = np.zeros_like(jump)
        force[:, 0] = np.minimum(0.0, jump[:, 0] / flexibility[:, 0])
        for column in range(jump.shape[-1]):
            if column % steps == 0:
                before = np.zeros_like(jump[:, 1:, 0])
            trial = (jump[:, 1:, column] - before) / flexibility[:, 1:, 0]
            size = np.linalg.norm(trial, axis=1)
            bound = -friction[:, column] * force[:, 0, column]
            share = np.where(size > bound, bound / np.where(size > 0.0, size, 1.0), 1.0)
            force[:, 1:, column] = share[:, None] * trial
            before = jump[:, 1:, column] - flexibility[:, 1:, 0] * force[:, 1:, column]
        return force

    load = Amplitude([0, 1, 2], [0, 1, -1]) * (0.0, 0.005, 0.0) + (-0.001, 0.0, 0.0)
    built = blocks(Contact(friction=0.3), pulled=load)
    own = with_law(built, UserLaw(resolve=rub, values={"friction": 0.3}, history=True))
    times = [0.0, 0.5, 1.0, 1.5, 2.0]
    expected = solve(built, options=TIGHT, times=times)
    result = solve(own, options=TIGHT, times=times)
    force = expected.force("joint")
    slipping = np.linalg.norm(force[..., 1:], axis=-1) > 0.3 * -force[..., 0] * (1 - 1e-9)
    assert slipping.any() and not slipping.all()
    assert expected.converged and result.converged
    # the displacements determine the forces on the nodes only, and there are more points than nodes:
    # two ways to the answer end in forces of the points that differ by some that move nothing
    for name, u in expected.displacements.items():
        assert np.allclose(result.displacements[name], u, rtol=0.0, atol=1e-9 * np.abs(u).max())
    weights = built.interfaces["joint"].weights
    assert np.allclose(
        np.einsum("p,tpc->tc", weights, result.force("joint") - force),
        0.0,
        atol=1e-7 * np.abs(force).max() * weights.sum(),
    )


# --- mistakes ---------------------------------------------------------------------------------------


class Broken(Exception):
    pass


def test_an_exception_of_a_law_arrives_with_the_interface_named() -> None:
    def law(jump: Array) -> Array:
        raise Broken("out of rubber")

    with pytest.raises(SceneError, match=r"'joint', law 'law': its force raised Broken: out of rub") as e:
        solve(blocks(UserLaw(force=law)))
    assert isinstance(e.value.__cause__, Broken)


def test_shapes_that_do_not_fit_come_with_a_hint() -> None:
    law = UserLaw(force=lambda jump, *, k: k * jump, values={"k": 50.0})
    with pytest.raises(SceneError, match=r"ValueError: .*; values are .*: k \(\d+, 1\); write value"):
        solve(blocks(law))


def test_an_interrupt_is_not_swallowed() -> None:
    def law(jump: Array, flexibility: Array) -> Array:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(blocks(UserLaw(resolve=law)))


@pytest.mark.parametrize("way", ["force", "resolve"])
def test_what_a_law_returns_is_checked(way: str) -> None:
    def ask(function: Callable[[Array], Any]) -> None:
        given: dict[str, Any] = {way: function if way == "force" else lambda j, c: function(j)}
        solve(blocks(UserLaw(**given, name="pad")))

    points = len(blocks(UserLaw(force=lambda j: j)).interfaces["joint"].weights)
    with pytest.raises(SceneError, match=rf"'joint', law 'pad'.*\({points}, 3\).*\({points}, 3, 1\)"):
        ask(lambda j: j[..., 0])
    for wrong in (lambda j: "soft", lambda j: 1j * j, lambda j: (j + 0j).astype(object), lambda j: None):
        with pytest.raises(SceneError, match=f"'joint', law 'pad': what its {way} returned.*real numbers"):
            ask(wrong)

    def nan(j: Array) -> Array:
        out = 0.0 * j
        out[3, 1] = np.nan
        return out

    with pytest.raises(SceneError, match=r"returned \(0, nan, 0\) at point 3 \(20, .* for the jump"):
        ask(nan)
    with pytest.raises(SceneError, match=r"'pad'.*inf"):
        ask(lambda j: j + np.inf)


def test_a_force_without_a_resolvent_is_named() -> None:
    rng = np.random.default_rng(0)

    def noise(jump: Array) -> Array:
        return 100.0 * rng.standard_normal(jump.shape)

    with pytest.raises(SceneError, match=r"'joint', law 'noise': no jump was found.*resolve="):
        solve(blocks(UserLaw(force=noise)))


def test_mistakes_in_records_are_named() -> None:
    for given, message in (
        ({}, "nothing given"),
        ({"force": linear, "resolve": stop}, "force and resolve given"),
        ({"force": 3.0}, "cannot be called"),
        ({"resolve": stop, "tangent": linear}, "tangent"),
        ({"force": linear, "history": True}, "remembers"),
        ({"force": linear, "components": "x"}, "components"),
        ({"force": linear, "values": {"jump": 1.0}}, "'jump'"),
        ({"force": linear, "values": {"k": float("nan")}}, "k = nan"),
        ({"force": linear, "values": {"k": "x"}}, "k = 'x'"),
    ):
        with pytest.raises(SceneError, match=message):
            UserLaw(**given)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="no parameter 'k'"):
        UserLaw(force=linear).with_(k=2.0)
    for given, message in (
        ({"normal": 1.0, "strength": 1.0}, "final opening or its energy"),
        ({"normal": 1.0, "strength": 1.0, "opening": 1.0, "energy": 1.0}, "final opening or its"),
        ({"normal": -1.0, "strength": 1.0, "opening": 2.0}, "normal = -1 is negative"),
        ({"normal": 1.0, "strength": -1.0, "opening": 2.0}, "strength = -1 is negative"),
        ({"normal": 1.0, "tangential": -2.0, "strength": 1.0, "opening": 2.0}, "tangential = -2"),
    ):
        with pytest.raises(SceneError, match=message):
            Debonding(**given)
    with pytest.raises(SceneError, match=r"'joint'.*ends at an opening of 0\.005.*0\.01"):
        solve(blocks(replace(BOND, opening=0.005)))
    with pytest.raises(SceneError, match="'joint': strength 0: it must be > 0"):
        solve(blocks(replace(BOND, strength=0.0)))
    with pytest.raises(SceneError, match="until"):
        Preload(force=1.0, until="later")  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="force = nan"):
        Preload(force=float("nan"))
    for name in ("friction", "threshold", "stiffness", "tangential_stiffness"):
        with pytest.raises(SceneError, match=f"{name} = -0.1 is negative"):
            Contact(**{name: -0.1})
    with pytest.raises(SceneError, match="tangential_stiffness = 100 without friction.*friction="):
        Contact(tangential_stiffness=100.0)


@pytest.mark.parametrize("far", [1.0, 1e4, 1e8, 1e12])
def test_the_root_of_a_law_that_stiffens_far_away(far: float) -> None:
    """y + c h |y|^2 y = d has one root, along d, whatever the size of the free jump d."""
    hardening, compliance = 1e9, 1e-2
    free = far * np.array([[-0.6, 1.0, -2.3]])

    def force(jump: Array, _: int) -> Array:
        return hardening * np.sum(jump**2, axis=1)[:, None] * jump

    found, bad, _ = latin_core.find_roots(force, None, free, np.full((1, 3), compliance))
    assert not any(bad)
    jump = free - compliance * found
    length, size = float(np.linalg.norm(jump)), float(np.linalg.norm(free))
    # of the force all digits are known, of a jump that is the difference of larger numbers less
    pull = float(np.linalg.norm(found))
    assert pull * compliance + (pull / hardening) ** (1 / 3) == pytest.approx(size, rel=1e-9)
    assert length <= size
