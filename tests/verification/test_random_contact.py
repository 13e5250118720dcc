"""Uncertain contact and friction: chaos through laws with kinks, against closed forms and sampling."""

from __future__ import annotations

import subprocess
import sys
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from latin_core import InputError, Options
from scipy import stats

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.solvers.galerkin import TruncationWarning
from dolfinx_frontend.solvers.collocation import MOST_TENSOR, collocation
from dolfinx_frontend.solving import sample
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import FromSamples, LogNormal, Normal, TruncatedNormal, Uniform
from dolfinx_frontend.uncertainty.quantities import Quantity

Array = npt.NDArray[np.float64]

TIGHT = Options(rtol=1e-9, max_iterations=1000)
AREA = 100.0  # mm^2
SEED = 11
BOLT, PRELOAD, JOINT = 4e5, 0.02, 50.0 * AREA  # N/mm, mm, N/mm
SCREW = Elastic(normal=2.5e4, tangential=2.5e4, total=True, jump=Normal("D", -0.2, cov=0.1))


def bolted(share: float, bolt: Elastic, joint: Contact | Elastic, at: float = 0.0) -> Problem:
    """A joint and a preloaded bolt between the same faces, pulled by a fraction of the preload."""
    scene = Scene()
    add_bolted(scene, share, bolt, joint, "", at)
    return assemble(scene)


def add_bolted(
    scene: Scene, share: float, bolt: Elastic, joint: Contact | Elastic, tag: str, at: float = 0.0
) -> None:
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (1, 1, 1), origin=(x0, at, 0.0), cell="hexahedron")
        scene.substructure(name + tag, box, LinearElastic(E=200e3, nu=0.0), degree=1)
    left, right = f"left{tag}:x1", f"right{tag}:x0"
    scene.fix(f"left{tag}:x0")
    scene.traction(f"right{tag}:x1", (share * BOLT * PRELOAD / AREA, 0.0, 0.0), name="load" + tag)
    scene.interface("joint" + tag, left, right, joint)
    scene.interface("bolt" + tag, left, right, bolt)


def bolt_law(normal: Any, jump: Any = -PRELOAD) -> Elastic:
    return Elastic(normal=normal, tangential=BOLT, total=True, jump=jump)


def closed_form(result: ChaosResult, share: float) -> tuple[Array, Array]:
    """Forces of joint and bolt, 1e5 samples: N = k (K (D - g) - Q) / (K + k) if positive, and N + Q."""
    count = 100_000
    germs = result.space.sample(count, SEED)

    def value(interface: str, parameter: str, fixed: float) -> Array:
        source = result.random.source(interface, parameter)
        return np.full(count, fixed) if source is None else result.space.values(source, germs)

    stiffness = value("bolt", "normal", BOLT)
    shortened = -value("bolt", "jump", -PRELOAD) - value("joint", "gap", 0.0)
    load = share * BOLT * PRELOAD
    closed = np.maximum(0.0, JOINT * (stiffness * shortened - load) / (stiffness + JOINT))
    return -closed, closed + load


def total(result: ChaosResult, name: str) -> Quantity:
    weights = result.problem.interfaces[name].weights
    # the points of the closed form: only the error of the chaos is left
    return result.quantity(lambda f: f.force(name)[..., 0] @ weights, name, "N", seed=SEED)


def in_norm(problem: Problem, name: str, values: Array) -> float:
    weights = problem.interfaces[name].weights
    return float(np.sqrt(np.einsum("p,pc->", weights, values**2)))


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.solvers.galerkin.TruncationWarning")
@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
@pytest.mark.parametrize("kind", ["stiffness and preload", "gap and preload"])
def test_preloaded_springs_against_1e5_samples(share: float, kind: str) -> None:
    bolt = bolt_law(BOLT, Normal("D", -PRELOAD, cov=0.05))
    joint = Contact(stiffness=JOINT / AREA)
    if kind == "stiffness and preload":
        bolt = bolt.with_(normal=LogNormal("K", BOLT, cov=0.1))
    else:
        joint = joint.with_(gap=Normal("g", 0.0, std=0.002))
    result = solve(bolted(share, bolt, joint), chaos=3, options=TIGHT)
    assert result.converged
    exact = dict(zip(("joint", "bolt"), closed_form(result, share), strict=True))
    found = total(result, "joint")
    assert found.mean().value == pytest.approx(exact["joint"].mean(), rel=0.01)
    assert found.std().value == pytest.approx(exact["joint"].std(), rel=0.01)
    assert found.values.max() <= 0.0  # a contact never pulls
    found = total(result, "bolt")
    assert found.mean().value == pytest.approx(exact["bolt"].mean(), rel=0.01)
    if result.trusted:  # or a result that says that it is not converged
        assert found.std().value == pytest.approx(exact["bolt"].std(), rel=0.01)
    assert result.trusted == (share == 0.5)
    assert ("NOT TRUSTED" in repr(result)) != result.trusted


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.solvers.galerkin.TruncationWarning")
def test_chance_that_the_joint_opens() -> None:
    # TARGETS 2.6: P = Phi((Q / (K D) - 1) / d1), whatever the stiffness of the joint
    bolt = bolt_law(Normal("K", BOLT, cov=0.1))
    result = solve(bolted(0.8, bolt, Contact(stiffness=JOINT / AREA)), chaos=3, options=TIGHT)
    chance = total(result, "joint").probability(above=-1e-9 * BOLT * PRELOAD, level=0.999)
    exact = stats.norm.cdf((0.8 - 1.0) / 0.1)
    assert chance.low < exact < chance.high
    assert result.checks["joint"].error < 0.01


def test_a_check_is_at_least_as_large_as_the_error() -> None:
    bolt = bolt_law(Normal("K", BOLT, cov=0.1), Normal("D", -PRELOAD, cov=0.05))
    problem = bolted(0.9, bolt, Contact(stiffness=JOINT / AREA))
    bounds, errors = [], []
    for order in (1, 2, 4):
        with pytest.warns(TruncationWarning, match="quasi_monte_carlo"):
            result = solve(problem, chaos=order, options=TIGHT)
        exact = closed_form(result, 0.9)[1]
        found = total(result, "bolt").values
        errors.append(abs(found.std() / exact.std() - 1.0))
        bounds.append(result.checks["bolt"].resultant_std)
    assert np.all(np.array(errors) < np.array(bounds))
    assert bounds[-1] < bounds[0]


def test_a_joint_that_never_opens_has_the_galerkin_solution() -> None:
    # then contact is a spring, and its chaos that of the linear scene: the elastic bolt is as exact as ever
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1), Normal("D", -PRELOAD, cov=0.05))
    linear = solve(bolted(0.1, bolt, Elastic(normal=JOINT / AREA)), chaos=3, active=["joint"], options=TIGHT)
    joint = Contact(stiffness=JOINT / AREA)
    for settings in ({}, {"quadrature": 6}, {"quadrature": {"K": 4}}, {"sobol_points": 2048}):
        chaos = Chaos(3, **settings)  # type: ignore[arg-type]
        result = solve(bolted(0.1, bolt, joint), chaos=chaos, options=TIGHT)
        assert result.trusted
        for name in ("joint", "bolt"):
            expected = linear.force_coefficients(name)[:, :1]
            found = result.force_coefficients(name)[:, :1]
            assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.solvers.galerkin.TruncationWarning")
@pytest.mark.parametrize(
    ("joint", "screw", "trusted"),
    [
        (Contact(stiffness=1000.0, gap=Normal("g", 0.0, std=0.002)), SCREW, True),
        (Contact(stiffness=1000.0, friction=Uniform("mu", 0.1, 0.5)), SCREW, True),
        (Contact(stiffness=1000.0, friction=0.3), SCREW, True),
        # no stiffness: pressures of single points jump when their neighbours open
        (Contact(), SCREW.with_(normal=Normal("K", 2.5e4, cov=0.1)), False),
    ],
    ids=["gap and preload", "friction and preload", "preload", "rigid"],
)
def test_vessel_against_512_samples(
    vessel: Problem, joint: Contact, screw: Elastic, trusted: bool
) -> None:
    problem = vessel.with_laws({"joint": joint, "screw": screw})
    result = solve(problem, chaos=3)
    samples = result.quasi_monte_carlo(512, 3)
    assert result.converged and samples.converged
    assert result.trusted == trusted

    exact = samples.force("joint")
    own = result.at(samples.germs).force("joint")
    assert own[..., 0].max() <= 0.0
    assert np.array_equal(own[..., 0] < 0.0, exact[..., 0] < 0.0) or np.mean(
        (own[..., 0] < 0.0) != (exact[..., 0] < 0.0)
    ) < (0.01 if trusted else 0.05)
    local = 0.01 if trusted else 0.1
    for moment in (np.mean, np.std):
        size = moment(exact, axis=0)
        difference = moment(own, axis=0) - size
        assert in_norm(problem, "joint", difference) < local * in_norm(problem, "joint", size)
        weights = problem.interfaces["joint"].weights
        ratio = moment(own[..., 0] @ weights) / moment(exact[..., 0] @ weights)
        assert ratio == pytest.approx(1.0, rel=0.005)
    mean, deviation = result.moments("joint")
    # 512 Sobol points: deviations to a per cent
    assert in_norm(problem, "joint", mean - exact.mean(axis=0)) < local * in_norm(problem, "joint", mean)
    difference = deviation - exact.std(axis=0)
    assert in_norm(problem, "joint", difference) < local * in_norm(problem, "joint", deviation)


def test_every_parameter_of_contact_may_be_random() -> None:
    # sampled, and by chaos, against one deterministic solve each
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (2, 1, 1), origin=(x0, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(E=200e3, nu=0.3), degree=1)
    scene.fix("left:x0")
    scene.traction("right:x1", (-10.0, 4.0, 0.0), name="load")
    scene.interface("guide", "right:x1", Elastic(normal=1.0, tangential=200.0))
    law = Contact(
        gap=Uniform("g", -1e-3, 1e-3),
        friction=Uniform("mu", 0.1, 0.3),
        threshold=TruncatedNormal("tau", 0.2, cov=0.3, lower=0.0),
        stiffness=LogNormal("s", 2000.0, cov=0.3),
        jump=Normal("j", 0.0, std=1e-3),
    )
    scene.interface("joint", "left:x1", "right:x0", law)
    problem = assemble(scene)
    random = RandomLaws.of(problem)
    assert random.space.dimension == 5
    germs = random.space.sample(5, 3)
    options = Options(rtol=1e-8, max_iterations=3000)
    samples = sample(problem, germs, options=options, progress=False)
    assert samples.converged
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncationWarning)
        result = solve(problem, chaos=Chaos(2, check_points=8), options=Options(max_iterations=3000))
    assert result.converged
    assert len(result.collocations["joint"]) <= MOST_TENSOR
    own = result.at(germs).force("joint")
    for i, point in enumerate(germs):
        fixed = problem.with_laws(random.at(point))
        exact = solve(fixed, options=options).force("joint")
        size = in_norm(problem, "joint", exact)
        assert in_norm(problem, "joint", samples.force("joint")[i] - exact) < 1e-5 * size
        assert in_norm(problem, "joint", own[i] - exact) < 0.02 * size
        values = {k: random.space.values(s, germs[i : i + 1])[0] for (_, k), s in random.sources.items()}
        shear = np.linalg.norm(own[i, :, 1:], axis=1)
        bound = values["friction"] * np.abs(own[i, :, 0]) + values["threshold"]
        assert np.all(shear <= bound * (1.0 + 1e-12))


def test_a_gap_that_varies_from_place_to_place(vessel: Problem) -> None:
    gap = RandomField("gap", 0.0, std=0.002, length=60.0, modes=3)
    problem = vessel.with_laws({"joint": Contact(stiffness=1000.0, gap=gap), "screw": SCREW.with_(jump=-0.2)})
    result = solve(problem, chaos=Chaos(2, tolerance=0.05))
    assert result.trusted
    germs = result.space.sample(4, 1)
    exact = result.sample(germs).force("joint")
    difference = result.at(germs).force("joint") - exact
    for each, whole in zip(difference, exact, strict=True):
        assert in_norm(problem, "joint", each) < 0.01 * in_norm(problem, "joint", whole)


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.solvers.galerkin.TruncationWarning")
def test_only_germs_that_reach_an_interface_are_paid_for() -> None:
    scene = Scene()
    joint = Contact(stiffness=JOINT / AREA)
    bolts = [bolt_law(Normal(f"K{i}", BOLT, cov=0.1)) for i in range(2)]
    for i, tag in enumerate("ab"):
        add_bolted(scene, 0.8, bolts[i], joint, tag, at=50.0 * i)
    problem = assemble(scene)
    result = solve(problem, chaos=3, options=TIGHT)
    assert [len(result.collocations["joint" + tag]) for tag in "ab"] == [16, 16]
    alone = solve(bolted(0.8, bolts[0], joint), chaos=3, options=TIGHT)
    rows = [i for i, (_, other) in enumerate(result.basis.indices.table) if other == 0]
    both = result.force_coefficients("jointa")
    expected = alone.force_coefficients("joint")
    assert np.abs(both[..., rows] - expected).max() < 1e-4 * np.abs(expected).max()
    others = np.delete(np.arange(result.modes), rows)
    assert np.abs(both[..., others]).max() < 1e-12 * np.abs(expected).max()

    # a germ without modes takes one point where the law does not depend on it
    bolt = bolt_law(Normal("K", BOLT, cov=0.1), Normal("D", -PRELOAD, cov=0.05))
    random = RandomLaws.of(bolted(0.8, bolt, joint.with_(gap=FromSamples("g", [0.0, 1e-4, 2e-4]))))
    chaos = Chaos(2, weights={"D": 3.0})
    names = random.space.germ_names
    found = collocation(random, random.space.basis(chaos), chaos, "joint")
    points = [len(np.unique(found.points[:, names.index(n)])) for n in ("K", "D", "g")]
    assert points == [16, 1, 3]  # atoms are all taken, and no more
    assert np.allclose(found.forward @ found.backward, np.eye(len(found.forward)), atol=1e-12)


def test_many_germs_take_sobol_points() -> None:
    bolt = bolt_law(Normal("K", BOLT, cov=0.1))
    gap = RandomField("gap", 0.0, std=1e-4, length=5.0, modes=3)
    random = RandomLaws.of(bolted(0.5, bolt, Contact(stiffness=JOINT / AREA, gap=gap)))
    chaos = Chaos(4)
    found = collocation(random, random.space.basis(chaos), chaos, "joint")
    assert "Sobol" in found.rule and found.weights.min() > 0.0
    identity = np.eye(len(found.forward))
    assert np.allclose(found.forward @ found.backward, identity, atol=1e-10)


def test_the_answer_stays_after_sampling() -> None:
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1))
    chaos = Chaos(3, check_points=0)
    result = solve(bolted(0.8, bolt, Contact(stiffness=JOINT / AREA)), chaos=chaos, options=TIGHT)
    assert not result.trusted and "not checked" in repr(result)
    assert "none: not asked for" in str(result.plan)
    before = [result.force_coefficients(name) for name in ("joint", "bolt")]
    samples = result.monte_carlo(50, keep_states=True)
    error = result.truncation("bolt", points=20)
    after = [result.force_coefficients(name) for name in ("joint", "bolt")]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert error.points == 20 and 0.0 < error.std < 0.5
    # the chaos predicts good starts
    cold = sample(result.problem, samples.germs, options=TIGHT, progress=False)
    assert np.allclose(samples.force("joint"), cold.force("joint"), atol=1e-5)
    assert np.median(samples.iterations) <= np.median(cold.iterations)
    with pytest.raises(SceneError, match="unknown interface"):
        result.truncation("nowhere")


def test_history_of_preloaded_springs() -> None:
    # pulled beyond opening and let go again: the closed form holds at every time
    times = [0.0, 1.0, 2.0, 3.0]
    pull = Amplitude([0.0, 2.0, 4.0], [0.0, 1.2, 0.0])
    scene = Scene()
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1), Normal("D", -PRELOAD, cov=0.05))
    add_bolted(scene, 0.0, bolt, Contact(stiffness=JOINT / AREA), "")
    problem = assemble(scene)
    load = pull * (BOLT * PRELOAD / AREA, 0.0, 0.0)
    problem = problem.with_laws({"load": replace(problem.interfaces["load"].law, t=load)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncationWarning)
        result = solve(problem, chaos=3, times=times, options=TIGHT)
    assert result.converged and result.state.data.shape[1] == 10 * 4
    assert "10 chaos modes x 4 time steps" in str(result.plan)
    germs = result.space.sample(1000, 5)
    samples = result.at(germs)
    weights = problem.interfaces["joint"].weights
    found = samples.force("joint")[..., 0] @ weights
    assert found.shape == (1000, 4)
    stiffness, jump = (
        result.space.values(result.random.sources["bolt", p], germs) for p in ("normal", "jump")
    )
    for k, time in enumerate(times):
        free = -stiffness * jump - pull(time) * BOLT * PRELOAD
        closed = np.maximum(0.0, JOINT * free / (stiffness + JOINT))
        error = np.sqrt(np.mean((found[:, k] + closed) ** 2))
        assert error < 0.02 * BOLT * PRELOAD * JOINT / (BOLT + JOINT)
    assert np.mean(found[:, 2] == 0.0) > 0.9 and np.all(found[:, 0] < 0.0)
    mean, deviation = result.moments("joint")
    assert mean.shape == deviation.shape == (4, len(weights), 1)
    assert result.displacements["right"].shape[0] == 4
    assert result.mean("right", 1).x.array == pytest.approx(result.displacements["right"][1])
    assert samples.displacement("right").shape[:2] == (1000, 4)
    drawn = result.monte_carlo(20, keep_states=True)
    assert drawn.force("joint").shape == (20, 4, len(weights), 1)
    assert drawn.moments("right")[0].shape[0] == 4
    quantity = result.quantity(lambda f: f.force("joint")[:, 2, :, 0].min(axis=1), samples=100)
    assert len(quantity.values) == 100


def test_friction_over_a_load_cycle() -> None:
    # the slip that is left depends on the way: chaos and samples against one deterministic history each
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (1, 1, 1), origin=(x0, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, LinearElastic(E=200e3, nu=0.3), degree=1)
    scene.fix("left:x0")
    shear = Amplitude([0.0, 1.0, 3.0, 4.0], [0.0, 1.0, -1.0, 0.0])
    press = Amplitude([0.0, 1e-3], [0.0, 1.0])
    scene.traction("right:x1", press * (-10.0, 0.0, 0.0) + shear * (0.0, 4.0, 0.0), name="load")
    scene.interface("guide", "right:x1", Elastic(normal=1.0, tangential=200.0))
    law = Contact(friction=Uniform("mu", 0.25, 0.3), stiffness=2000.0)
    scene.interface("joint", "left:x1", "right:x0", law)
    problem = assemble(scene)
    times = np.array([1e-3, 0.5, 1.0, 2.0, 3.0, 4.0])
    options = Options(rtol=1e-7, max_iterations=3000)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncationWarning)
        result = solve(problem, chaos=Chaos(3, check_points=8), times=times, options=options)
    assert result.converged
    germs = result.space.sample(3, 2)
    drawn = sample(problem, germs, options=options, times=times, progress=False)
    own = result.at(germs).force("joint")
    left = []
    for i, point in enumerate(germs):
        fixed = problem.with_laws(result.random.at(point))
        exact = solve(fixed, times=times, options=options)
        size = np.linalg.norm(exact.force("joint"))
        assert np.linalg.norm(drawn.force("joint")[i] - exact.force("joint")) < 1e-4 * size
        assert np.linalg.norm(own[i] - exact.force("joint")) < 0.01 * size
        left.append(np.abs(exact.jump("joint")[-1, :, 1]).max())
    assert min(left) > 1e-5  # something slipped and stayed


def test_linear_histories_are_superposed_with_chaos_too() -> None:
    pull = Amplitude([0.0, 1.0], [0.0, 1.0])
    jump = pull * -PRELOAD
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1), jump)
    joint = Elastic(normal=JOINT / AREA, jump=Normal("g", 0.0, std=0.002))
    scene = Scene()
    add_bolted(scene, 0.0, bolt, joint, "")
    problem = assemble(scene)
    load = Amplitude([0.0, 1.0, 2.0], [0.0, 0.0, 1.0]) * (20.0, 0.0, 0.0) + (1.0, 0.0, 0.0)
    problem = problem.with_laws({"load": replace(problem.interfaces["load"].law, t=load)})
    times = np.linspace(0.0, 2.0, 9)
    result = solve(problem, chaos=3, times=times, options=TIGHT)
    assert result.plan.history == "patterns" and result.state.data.shape[1] == 10 * 3
    assert result.force_coefficients("bolt").shape[0] == 9
    for k in (0, 3, 8):
        still = solve(problem.at(times[k]), chaos=3, options=TIGHT)
        for name in ("joint", "bolt"):
            expected = still.force_coefficients(name)
            found = result.force_coefficients(name)[k]
            assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
        expected = still.coefficients("right")
        assert np.abs(result.coefficients("right")[k] - expected).max() < 1e-6 * np.abs(expected).max()
    drawn = sample(problem, result.space.sample(2, 0), times=times, options=TIGHT, progress=False)
    own = result.at(drawn.germs).force("bolt")
    assert np.abs(own - drawn.force("bolt")).max() < 1e-3 * np.abs(own).max()
    assert result.truncation("bolt").error < 0.01


def test_the_plan_says_what_it_costs() -> None:
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1), Normal("D", -PRELOAD, cov=0.01))
    result = solve(bolted(0.5, bolt, Contact(stiffness=JOINT / AREA)), chaos=Chaos(2, quadrature=5))
    text = str(result.plan)
    assert "law of joint" in text and "25 points in 2 germs (tensor Gauss, 5 x 5)" in text and "MB" in text
    assert "deterministic solves" in text


def test_mistakes_are_named() -> None:
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1))

    def run(joint: Contact, chaos: Chaos) -> None:
        solve(bolted(0.5, bolt, joint), chaos=chaos)

    joint = Contact(stiffness=JOINT / AREA)
    with pytest.raises(SceneError, match=r"'joint'.*negative friction.*Normal\('mu'.*LogNormal"):
        run(joint.with_(friction=Normal("mu", 0.2, cov=0.4)), Chaos(3))
    with pytest.raises(SceneError, match="negative threshold"):
        run(joint.with_(threshold=Normal("tau", 0.2, cov=0.4)), Chaos(3))
    with pytest.raises(SceneError, match="negative stiffness"):
        run(joint.with_(stiffness=Normal("s", 50.0, cov=0.4)), Chaos(3))
    problem = bolted(0.5, bolt, joint.with_(friction=Normal("mu", 0.2, cov=0.4)))
    with pytest.raises(SceneError, match="negative friction"):
        sample(problem, [[-3.0, 0.0]], progress=False)
    with pytest.raises(SceneError, match="cannot tell its modes"):
        run(joint, Chaos(3, quadrature=3))
    with pytest.raises(SceneError, match="too few for 7 modes"):
        run(joint, Chaos(6, sobol_points=8))
    with pytest.raises(SceneError, match="unknown random parameter 'L'|'L'"):
        run(joint, Chaos(3, quadrature={"L": 4}))
    for settings, text in (
        ({"quadrature": 0}, "quadrature = 0"),
        ({"sobol_points": 100}, "power of two"),
        ({"sobol_points": 64, "quadrature": 4}, "give one"),
        ({"check_points": 1}, "check_points = 1"),
        ({"tolerance": 0.0}, "tolerance"),
    ):
        with pytest.raises(SceneError, match=text):
            Chaos(3, **settings)  # type: ignore[arg-type]


def test_the_kernel_checks_what_it_resolves() -> None:
    bolt = bolt_law(LogNormal("K", BOLT, cov=0.1))
    chaos = Chaos(1, check_points=0)
    result = solve(bolted(0.5, bolt, Contact(stiffness=JOINT / AREA)), chaos=chaos)
    rows = len(result.solver.local_fields(result.laws, "joint", result.state)[0])

    def resolve(free: Array, **parameters: Array) -> tuple[Array, Array]:
        return result.solver.resolve_samples(result.laws, "joint", free, parameters)

    free = np.linspace(-1.0, 1.0, 3 * rows).reshape(rows, 3, order="F")
    force, jump = resolve(free, gap=np.zeros((1, 3)))
    assert np.all(force <= 0.0) and np.array_equal(force < 0.0, free < 0.0)
    assert np.array_equal(jump[free >= 0.0], free[free >= 0.0])
    with pytest.raises(InputError, match="'joint'.*free jump of 1 rows"):
        resolve(free[:1])
    with pytest.raises(InputError, match="'joint'.*'gap' is 1 x 2"):
        resolve(free, gap=np.zeros((1, 2)))
    with pytest.raises(InputError, match="'joint'.*no parameter 'slip'"):
        resolve(free, slip=np.zeros((1, 1)))
    with pytest.raises(InputError, match="'joint'.*at least"):
        resolve(free, compliance=np.full((1, 1), -1.0))


def test_warnings_are_shown() -> None:
    # ffcx sends them to a logger without a handler; a process of its own, as pytest replaces hooks
    code = "import warnings, dolfinx_frontend; warnings.warn('truncated here', UserWarning)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "truncated here" in shown.stderr
