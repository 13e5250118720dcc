"""The assembly as a function: values and derivatives against closed forms and solves, OpenTURNS."""

from __future__ import annotations

import signal
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import KinkWarning, ProblemFunction, Response, SceneError, geometry
from dolfinx_frontend.common import interrupts
from dolfinx_frontend.evaluate import evaluator
from tests.inference.joints import JOINT, K, RARE, D, joints

Array = npt.NDArray[np.float64]

TIGHT = lf.Options(rtol=1e-11, max_iterations=4000)
STEP = 3e-5
"""Relative step of the differences of solves, whose error is about rtol / STEP = 3e-7."""


@pytest.fixture(scope="module")
def problem() -> lf.Problem:
    return joints(RARE)


@pytest.fixture(scope="module")
def function(problem: lf.Problem) -> ProblemFunction:
    quantities = {"joint": "joint", "bolt": "bolt", "opening": Response.opening("joint")}
    return problem.function(quantities, options=TIGHT)


def closed(x: Array) -> Array:
    """Force of joint and bolt: the joint bears k (K D - Q) / (K + k), nothing once it is open."""
    stiffness, short, pull = x.T
    bears = np.maximum(JOINT * (stiffness * short - pull) / (stiffness + JOINT), 0.0)
    return np.column_stack([-bears, bears + pull])


def test_values_are_those_of_solves(function: ProblemFunction) -> None:
    assert function.inputs == ("K", "D", "Q") and function.outputs == ("joint", "bolt", "opening")
    rng = np.random.default_rng(0)
    x = function.nominal * rng.uniform(0.6, 1.4, (50, 3))
    x[::5, 2] = 1.5 * x[::5, 0] * x[::5, 1]  # some open
    found = function(x)
    assert found.shape == (50, 3)
    scale = np.abs(closed(x)).max()
    assert np.abs(found[:, :2] - closed(x)).max() < 1e-8 * scale
    assert np.all((found[:, 2] > 0.0) == (x[:, 2] > x[:, 0] * x[:, 1]))
    before = function.solves
    one = function(x[-1])
    assert one.shape == (3,) and one == pytest.approx(found[-1])
    assert function.solves == before  # it was known


def test_derivatives_of_the_closed_form(function: ProblemFunction) -> None:
    """f = -k (K D - Q) / (K + k), with respect to K, D and Q."""
    x = np.array([0.9 * K, D, RARE])
    bears = JOINT * (x[0] * x[1] - x[2]) / (x[0] + JOINT)
    by_k = JOINT * x[1] / (x[0] + JOINT) - bears / (x[0] + JOINT)
    exact = [by_k, JOINT * x[0] / (x[0] + JOINT), -JOINT / (x[0] + JOINT)]
    assert -function.gradient(x)[0] == pytest.approx(exact, rel=1e-7)
    several = function.gradient(np.array([x, 1.1 * x]))
    assert several.shape == (2, 3, 3)


def test_a_kink_is_flagged(function: ProblemFunction) -> None:
    at = np.array([K, D, K * D])
    with pytest.warns(KinkWarning, match="point 0 along K .joint., point 0 along D"):
        function.gradient(at)
    for factor in (0.999, 1.001):
        assert not function.derivatives(at * [1.0, 1.0, factor]).kinks.any()


def blocks(law: Any, foot: bool = True) -> lf.Scene:
    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((20.0, 30.0, 10.0), (3, 3, 2), (0.0, 0.0, 10.0 * level))
        scene.substructure(name, part, lf.LinearElastic(200e3, 0.3, alpha=1e-5), degree=1)
    scene.fix("base:z0")
    scene.interface("joint", "base:z1", "cover:z0", law)
    scene.interface("spring", "base:z1", "cover:z0", lf.Elastic(normal=1.0, tangential=5.0))
    return scene


def corner(problem: lf.Problem, component: str) -> lf.AtPoint:
    return lf.AtPoint(problem, "cover", (20.0, 30.0, 20.0), component=component)


def friction() -> ProblemFunction:
    """Partial slip."""
    scene = blocks(lf.Contact(friction=0.3, stiffness=1e4))
    scene.force("cover:z1", (300.0, 0.0, -1500.0), name="push")
    problem = lf.assemble(scene)
    slip = lf.Resultant("joint", "jump", 1)
    quantities = {"u": corner(problem, "x"), "w": corner(problem, "z"), "slip": slip}
    inputs = ["joint.friction", "joint.stiffness", "spring.tangential", "push.x", "cover.E"]
    return problem.function(quantities, inputs, options=TIGHT)


def history() -> ProblemFunction:
    """Slip there and back: every time step sees those before it."""
    scene = blocks(lf.Contact(friction=0.15, stiffness=1e4))
    cycle = lf.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, -0.5])
    scene.force("cover:z1", (0.0, 0.0, -1500.0), name="press")
    scene.force("cover:z1", (cycle * 270.0, 0.0, 0.0), name="shear")  # slips, between two kinks
    problem = lf.assemble(scene)
    inputs = ["joint.friction", "press.z", "shear.x", "joint.stiffness"]

    def slip(block: Any) -> Array:
        return np.asarray(np.linalg.norm(block.jump("joint")[:, -1, :, 1:], axis=(1, 2)))

    return problem.function({"slip": slip}, inputs, times=[0.5, 1.0, 1.5, 2.0], options=TIGHT)


def heat_and_moduli() -> ProblemFunction:
    scene = blocks(lf.Contact(stiffness=1e4))
    scene.force("cover:z1", (0.0, 0.0, -1500.0), name="press")
    scene.temperature("cover", 40.0, name="heat")
    problem = lf.assemble(scene)
    return problem.function({"w": corner(problem, "z")}, ["cover.E", "base.E", "heat.dT"], options=TIGHT)


def field() -> ProblemFunction:
    gap = lf.RandomField("g", mean=0.0, std=1e-3, length=10.0, modes=4)
    scene = blocks(lf.Contact(stiffness=1e4, gap=gap))
    scene.force("cover:z1", (0.0, 0.0, -1500.0), name="press")
    problem = lf.assemble(scene)
    return problem.function({"u": corner(problem, "x"), "w": corner(problem, "z")}, options=TIGHT)


def scores() -> ProblemFunction:
    scene = blocks(lf.Elastic(normal=lf.LogNormal("k", 100.0, cov=0.2), tangential=50.0))
    scene.force("cover:z1", (lf.Gamma("F", 300.0, cov=0.3), 0.0, -1500.0), name="push")
    problem = lf.assemble(scene)
    return problem.function({"u": corner(problem, "x")}, coordinates="normal", options=TIGHT)


@pytest.mark.parametrize("made", [friction, history, heat_and_moduli, field, scores])
def test_derivatives_are_those_of_solves(made: Callable[[], ProblemFunction]) -> None:
    """Central differences of solves to 1e-6 of the quantity, away from kinks."""
    function = made()
    x = function.nominal
    x = np.where(x == 0.0, 0.3, x)
    found = function.derivatives(x)
    assert not found.kinks.any() and found.residual < 3e-7  # what is aimed at, of the slopes themselves
    value = np.abs(function(x))
    for k, size in enumerate(np.abs(x)):
        away = STEP * size * np.eye(len(x))[k]
        slope = (function(x + away) - function(x - away)) / (2.0 * STEP * size)
        error = np.abs(found.values[:, k] - slope) * size
        assert np.all(error <= 1e-6 * np.maximum(value, np.abs(found.values * x).max(axis=1)))


def test_points_that_do_not_converge_are_named(problem: lf.Problem) -> None:
    function = problem.function("joint", options=lf.Options(max_iterations=1, rtol=1e-12))
    x = function.nominal
    with pytest.warns(lf.SceneWarning, match=r"2 of 2 points did not converge: point 0 max_iterations"):
        assert np.isnan(function(np.array([x, 1.1 * x]))).all()
    strict = problem.function("joint", options=lf.Options(max_iterations=1, rtol=1e-12), on_failure="raise")
    with pytest.raises(SceneError, match="1 of 1 points did not converge"):
        strict(x)
    with pytest.raises(SceneError, match="did not converge"):
        function.gradient(x)


def test_bad_input(problem: lf.Problem, function: ProblemFunction) -> None:
    for call, words in (
        (lambda: problem.function("joints"), "joints"),
        (lambda: problem.function("joint", ["bolt.normla"]), "unknown input 'bolt.normla'"),
        (lambda: problem.function("joint", ["K", "K"]), "'K' is there twice"),
        (lambda: problem.function("joint", []), "name one at least"),
        (lambda: problem.function([]), "give one at least"),
        (lambda: problem.function(["joint", "joint"]), "is there twice"),
        (lambda: problem.function("joint", coordinates="unit"), "coordinates"),
        (lambda: problem.function("joint", on_failure="ignore"), "on_failure"),
        (lambda: function([1.0, 2.0]), "there are 3 inputs: K, D, Q"),
        (lambda: function([K, D, np.nan]), "'Q' is nan at point 0"),
        (lambda: function([-K, D, RARE]), "K"),
    ):
        with pytest.raises(SceneError, match=words):
            call()  # type: ignore[no-untyped-call]
    fixed = lf.assemble(plain_scene())
    with pytest.raises(SceneError, match="nothing is random: give a law.*or name the inputs"):
        fixed.function("joint")


def plain_scene() -> lf.Scene:
    scene = blocks(lf.Contact(stiffness=1e4))
    scene.force("cover:z1", (0.0, 0.0, -1500.0), name="press")
    return scene


def test_a_random_number_can_be_given_by_the_parameter_that_it_is(problem: lf.Problem) -> None:
    """`load.z` instead of Q, which then is no germ."""
    function = problem.function("joint", ["load.z", "K"], options=TIGHT)
    x = np.array([[RARE, K], [2.0 * RARE, 0.9 * K]])
    exact = closed(np.column_stack([x[:, 1], np.full(2, D), x[:, 0]]))[:, 0]
    assert function(x)[:, 0] == pytest.approx(exact, rel=1e-8)


def test_nominal_is_the_scene() -> None:
    """Beside its amplitude what changes in time, the mean of what differs from point to point."""
    on = lf.Amplitude([0.0, 1.0], [0.0, 1.0])
    scene = blocks(lf.Contact(stiffness=lambda x: 1e4 + 0.0 * x[:, 0]))
    scene.force("cover:z1", (0.0, 0.0, on * -1500.0), name="press")
    scene.interface("shim", "base:z1", "cover:z0", lf.Elastic(normal=2.0, tangential=1.0, jump=on * -1e-3))
    problem = lf.assemble(scene)
    inputs = ["joint.stiffness", "press.z", "shim.jump", "cover.E"]
    function = problem.function("joint", inputs, times=[0.5, 1.0], options=TIGHT)
    assert function.nominal == pytest.approx([1e4, -1500.0, -1e-3, 200e3])
    result = lf.solve(problem, times=[0.5, 1.0], options=TIGHT, progress=False)
    assert function(function.nominal)[0] == pytest.approx(float(Response("joint").read(result)), rel=1e-8)


@pytest.mark.skipif(find_spec("openturns") is None, reason="no OpenTURNS")
def test_openturns_sees_values_and_gradient(
    function: ProblemFunction, caplog: pytest.LogCaptureFixture
) -> None:
    import openturns as ot

    own = function.openturns()
    x = function.nominal
    assert np.array(own(x)) == pytest.approx(function(x))
    assert np.array(own.gradient(x)).T == pytest.approx(function.gradient(x), rel=1e-9)
    assert list(own.getInputDescription()) == ["K", "D", "Q"]
    sample = ot.Sample([x, 1.1 * x])
    assert np.array(own(sample)) == pytest.approx(function(np.array([x, 1.1 * x])))
    with pytest.raises(RuntimeError):
        own(-x)
    assert "cannot take the value -50000" in caplog.text  # what OpenTURNS drops


def test_without_openturns_it_says_how_to_get_it(
    function: ProblemFunction, monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(SceneError, match="needs OpenTURNS.*pip install openturns"):
        function.openturns()


@pytest.mark.parametrize("kept", [False, True])
def test_ctrl_c_when_all_points_are_done_is_not_lost(
    problem: lf.Problem, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kept: bool
) -> None:
    """It would be noted by a context that ends, and a search go on; what was solved is in the file."""
    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(interrupts, "_last_press", float("-inf"))  # two within seconds would raise at once
    walk = evaluator.walked

    def walked(*args: Any, **settings: Any) -> Any:
        found = walk(*args, **settings)
        signal.raise_signal(signal.SIGINT)
        return found

    checkpoint = tmp_path / "points.npz" if kept else None
    try:
        function = problem.function("joint", options=TIGHT, checkpoint=checkpoint)
        x = np.array([function.nominal, 0.9 * function.nominal])
        monkeypatch.setattr(evaluator, "walked", walked)
        with pytest.raises(KeyboardInterrupt, match="2 of 2 points"):
            function(x)
    finally:
        signal.signal(signal.SIGINT, before)
    function.close()
    if not kept:
        return
    monkeypatch.setattr(evaluator, "walked", lambda *args, **settings: pytest.fail("solved again"))
    again = problem.function("joint", options=TIGHT, checkpoint=checkpoint)
    assert again(x)[:, 0] == pytest.approx(closed(x)[:, 0], rel=1e-8)
    again.close()
