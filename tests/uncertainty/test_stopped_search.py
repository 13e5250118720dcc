"""Ctrl-C in a search for an accuracy: the best answer so far comes back, wherever it is pressed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from dolfinx_frontend import (
    ChaosResult,
    Contact,
    Elastic,
    Errors,
    LinearElastic,
    LogNormal,
    Normal,
    Problem,
    Quantile,
    Scene,
    Uniform,
    assemble,
    geometry,
    solve,
)
from dolfinx_frontend.common import interrupts
from dolfinx_frontend.common.interrupts import Interrupt, Interrupted, late, pressed, stop_if_pressed
from dolfinx_frontend.estimate import adaptive, judged
from dolfinx_frontend.estimate.errors import INTERRUPTED, LATE, why_stopped
from dolfinx_frontend.evaluate import model
from dolfinx_frontend.moments import hinges
from dolfinx_frontend.moments import samples as by_points
from dolfinx_frontend.results.samples import SampleResult


@pytest.fixture(autouse=True)
def handler() -> Iterator[None]:
    """Ctrl-C is Python's again, whatever another test left, and was not pressed."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    interrupts._last_press = -np.inf
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler and not interrupts._open


def pressed_in(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, call: int = 1) -> list[int]:
    """SIGINT at the beginning of one call of a function of a module, counted from 1."""
    before, calls = getattr(module, name), [0]

    def pressing(*given: Any, **named: Any) -> Any:
        calls[0] += 1
        if calls[0] == call:
            signal.raise_signal(signal.SIGINT)
        return before(*given, **named)

    monkeypatch.setattr(module, name, pressing)
    return calls


def rods(*springs: Any, force: float = -0.02) -> Scene:
    """Unit squares in a row with springs between them, the last one pushed."""
    scene = Scene()
    for k in range(len(springs) + 1):
        part = geometry.box((1.0, 1.0), (1, 1), (float(k), 0.0), cell="quadrilateral")
        scene.substructure(f"r{k}", part, LinearElastic(1e5, 0.0), degree=1)
    scene.fix("r0:x0")
    for k, law in enumerate(springs):
        scene.interface(f"j{k}", f"r{k}:x1", f"r{k + 1}:x0", law)
        scene.symmetry(f"r{k + 1}:y0")
    scene.fix(f"r{len(springs)}:x1", force, components=0)
    return scene


SPRING, SPREAD, BEHIND, GAP, SCATTER, PUSHED = 1e3, 0.5, 5e3, 0.015, 0.01, 0.02


def chain(springs: int) -> Scene:
    """Springs in a row with a gap that is open in a part of the samples."""
    laws = [Elastic(normal=LogNormal(f"k{i}", SPRING, cov=SPREAD), tangential=1e3) for i in range(springs)]
    gap = Contact(gap=Normal("g", GAP, std=SCATTER), stiffness=BEHIND)
    return rods(*laws, gap, force=-PUSHED)


def exact(springs: int) -> tuple[float, float]:
    """Mean and deviation of the force in the gap: displacement that closes it, over the compliance."""
    t = (PUSHED - GAP) / SCATTER
    closed = SCATTER * (t * norm.cdf(t) + norm.pdf(t))
    square = SCATTER**2 * ((t**2 + 1.0) * norm.cdf(t) + t * norm.pdf(t))
    z, w = np.polynomial.hermite_e.hermegauss(48)
    s = np.sqrt(np.log1p(SPREAD**2))
    soft = np.exp(0.5 * s**2 - s * z) / SPRING
    compliance, weight = np.array([1.0 / BEHIND + (springs + 2) / 1e5]), np.array([1.0])
    for _ in range(springs):
        compliance = np.add.outer(compliance, soft).ravel()
        weight = np.multiply.outer(weight, w / w.sum()).ravel()
    mean = -closed * float(weight @ (1.0 / compliance))
    return mean, float(np.sqrt(square * (weight @ compliance**-2) - mean**2))


@pytest.fixture(scope="module")
def kinked() -> Problem:
    """Four germs: answered by samples."""
    return assemble(chain(3))


def judge(made: Errors, springs: int) -> None:
    """Whether the errors hold."""
    mean, std = exact(springs)
    assert made.moments is not None and made.moments.std is not None
    assert abs(made.moments.mean - mean) <= made.in_all * abs(mean)
    assert abs(made.moments.std - std) <= made.in_all * std


def test_what_is_held_back_and_when() -> None:
    with pytest.raises(KeyboardInterrupt), Interrupt(holds=False):
        signal.raise_signal(signal.SIGINT)  # nothing to return yet
    interrupts._last_press = -np.inf
    with Interrupt(holds=False) as search:
        search.hold()
        with Interrupt() as run:
            signal.raise_signal(signal.SIGINT)
            assert run.pressed and search.pressed and search.told and not run.told
        with Interrupt() as later:
            assert later.pressed
        with pytest.raises(Interrupted):
            stop_if_pressed()
        with pytest.raises(KeyboardInterrupt) as second:
            signal.raise_signal(signal.SIGINT)
        assert second.type is KeyboardInterrupt
    stop_if_pressed()  # of nothing
    with Interrupt(alone=False):
        stop_if_pressed()


def test_a_budget_of_time_is_as_ctrl_c() -> None:
    with Interrupt(holds=False) as search:
        assert not pressed()
        search.hold()
        search.limit(-1.0)
        with Interrupt() as run:
            assert run.pressed and late() and why_stopped() == LATE and not run.told
            with pytest.raises(Interrupted):
                stop_if_pressed()
            signal.raise_signal(signal.SIGINT)  # the first one: noted
            assert run.pressed and not late() and why_stopped() == INTERRUPTED
    interrupts._last_press = -np.inf
    with Interrupt() as search:
        search.limit(3600.0)
        assert not pressed()


def test_the_search_for_points_ends_with_its_budget(kinked: Problem) -> None:
    """It ended that for meshes only."""
    found = solve(kinked, accuracy=2e-3, quantity="j3", max_seconds=1e-9)
    made = found.errors()
    assert isinstance(found, ChaosResult) and LATE in made.notes and not made.reached
    whole = solve(kinked, accuracy=2e-1, quantity="j3", max_seconds=3600.0).errors()
    assert whole.reached and LATE not in whole.notes


STAGES: dict[str, tuple[Any, str, int, float]] = {
    "a fit of hinges": (hinges, "_fitted", 40, 2e-3),
    "the fits without a set": (hinges, "without_each", 2, 2e-3),
    "the integration over many points": (by_points, "wide_points", 30, 2e-3),
    "the weights of the sets": (by_points, "calibrated", 12, 2e-3),
    "points far out": (by_points, "far_out", 1, 2e-2),
    "points solved again": (model, "sample_on", 6, 2e-2),
}


@pytest.mark.parametrize("stage", STAGES)
def test_points_that_are_finished_come_back(
    monkeypatch: pytest.MonkeyPatch, kinked: Problem, stage: str
) -> None:
    module, name, call, accuracy = STAGES[stage]
    calls = pressed_in(monkeypatch, module, name, call)
    found = solve(kinked, accuracy=accuracy, quantity="j3")
    assert calls[0] >= call
    assert isinstance(found, SampleResult) and found.complete
    made = found.errors()
    assert any("Ctrl-C" in note for note in made.notes) and np.isfinite(made.in_all)
    judge(made, 3)


def test_before_the_first_points_the_chaos_comes_back(
    monkeypatch: pytest.MonkeyPatch, kinked: Problem
) -> None:
    pressed_in(monkeypatch, by_points, "calibrated", 1)
    found = solve(kinked, accuracy=2e-3, quantity="j3")
    assert isinstance(found, ChaosResult)
    made = found.errors()
    assert np.isnan(made.relative("truncation")) and not np.isnan(made.relative("algebraic"))
    assert "not known" in str(made) and not made.reached


def test_before_there_is_an_answer_it_raises(monkeypatch: pytest.MonkeyPatch, kinked: Problem) -> None:
    pressed_in(monkeypatch, adaptive, "solve_chaos")
    with pytest.raises(KeyboardInterrupt):
        solve(kinked, accuracy=2e-3, quantity="j3")


def test_the_second_raises(monkeypatch: pytest.MonkeyPatch, kinked: Problem) -> None:
    pressed_in(monkeypatch, by_points, "hinged")
    pressed_in(monkeypatch, by_points, "sides_of")
    with pytest.raises(KeyboardInterrupt) as second:
        solve(kinked, accuracy=2e-3, quantity="j3")
    assert second.type is KeyboardInterrupt


def test_a_quantile_comes_back(monkeypatch: pytest.MonkeyPatch, kinked: Problem) -> None:
    pressed_in(monkeypatch, by_points, "hinged")
    made = solve(kinked, accuracy=2e-3, quantity=Quantile("j3", 0.3)).errors()
    assert made.moments is not None and np.isfinite(made.in_all) and not made.reached


@pytest.mark.parametrize(("springs", "accuracy"), [(0, 1e-6), (1, 1e-2)])
def test_all_that_is_kept_on_the_way_is_an_answer(
    monkeypatch: pytest.MonkeyPatch, springs: int, accuracy: float
) -> None:
    """Rules, pieces of a germ, samples: each with its weights, and with errors that hold."""
    kept: list[tuple[SampleResult, Errors]] = []
    keep = lambda search, found: kept.append(search._of_moments(found))  # noqa: E731
    monkeypatch.setattr(adaptive._Search, "keep", keep)
    name = f"j{springs}"
    solve(assemble(chain(springs)), accuracy=accuracy, quantity=name)
    words = ("points per germ", "pieces of the germ", "sets of")
    told = [made.truncation.how for _, made in kept if made.truncation is not None]
    ways = {word for word in words if any(word in how for how in told)}
    assert len(kept) >= 3 and len(ways) >= 2, ways
    for samples, made in kept:
        own = samples.mean_std(name)
        assert made.moments is not None and own.std is not None and made.moments.std is not None
        assert own == pytest.approx(made.moments, rel=1e-9)
        judge(made, springs)


def test_a_linear_chaos_comes_back_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = assemble(rods(Elastic(normal=LogNormal("k", 1e3, cov=0.1), tangential=1e3)))
    calls = pressed_in(monkeypatch, adaptive, "carry_on", 4)
    found = solve(problem, accuracy=1e-8, quantity="j0")
    made = found.errors()
    assert calls[0] >= 4 and isinstance(found, ChaosResult) and found.converged
    assert np.isfinite(made.in_all) and not made.reached


def plates(law: Any) -> Scene:
    """Two plates, one pressed onto the other and pushed along it."""
    scene = Scene()
    for i in range(2):
        part = geometry.box((2.0, 1.0), (2, 1), (2.0 * i, 0.0), cell="triangle")
        scene.substructure(f"b{i}", part, LinearElastic(2e5, 0.3), degree=2)
    scene.fix("b0:x0")
    scene.interface("j", "b0:x1", "b1:x0", law)
    scene.fix("b1:x1", (-1e-3, 6e-4))
    return scene


def test_a_scene_without_its_scatter_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    pressed_in(monkeypatch, judged, "solve_chaos")
    monkeypatch.setattr(judged, "chaos_on", lambda *given, **named: None)
    scene = plates(Contact(friction=Uniform("mu", 0.1, 0.5)))
    found = solve(scene, accuracy=1e-2, quantity="j", progress=False)
    made = found.errors()
    assert made.truncation is not None and np.isnan(made.relative("truncation")) and np.isnan(made.in_all)
    assert any("scatter is not computed" in note for note in made.notes)
    assert np.isfinite(made.relative("discretisation")) and np.isfinite(made.relative("algebraic"))
    assert "means of what is random" in str(made)


@pytest.mark.parametrize(("stage", "meshes"), [("finer", 1), ("discretisation_error", 1)])
def test_a_scene_comes_back_on_its_last_mesh(
    monkeypatch: pytest.MonkeyPatch, stage: str, meshes: int
) -> None:
    from dolfinx_frontend.estimate import meshes as search

    module, call = (search, 1) if stage == "finer" else (judged, 2)
    pressed_in(monkeypatch, module, stage, call)
    found = solve(plates(Contact(friction=0.3)), accuracy=1e-4, quantity="j", progress=False)
    made = found.errors()
    assert len(made.steps) == meshes and made.discretisation is not None
    assert made.relative("discretisation") == pytest.approx(made.steps[-1].error)
    assert np.isfinite(made.in_all) and not made.reached
    assert made.moments is not None and made.moments.mean == pytest.approx(made.steps[-1].value)


@pytest.mark.parametrize("call", [2, 5, 9])
def test_ctrl_c_before_a_point_has_begun(monkeypatch: pytest.MonkeyPatch, call: int) -> None:
    """Points that are solved on their own: the one that it falls on has no fields, the others keep theirs."""
    kinked = rods(Contact(gap=Normal("gap", 0.01, std=0.004)))
    pressed_in(monkeypatch, model, "sample_on", call)
    answer = solve(assemble(kinked), accuracy=1e-3, quantity="j0", meshes=False)
    assert not answer.errors().reached


def test_a_press_in_a_piece_that_ends_just_then_is_not_lost() -> None:
    """Of a first solution that converges before it looks."""
    with Interrupt(holds=False) as search:
        with Interrupt():
            signal.raise_signal(signal.SIGINT)
        assert search.pressed and pressed()
