"""Long runs that are ended and go on: the same digits, and no file of another run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import Response, SceneError, calibrate, reliability
from dolfinx_frontend.kernel.solver import Solver
from tests.inference.joints import LESS_RARE, RARE, joints


class Ended(Exception):
    """What ends a run."""


def ended_after(monkeypatch: pytest.MonkeyPatch, walks: int) -> None:
    """The kernel is called so many times."""
    count, walk = 0, Solver.walk

    def counted(*given: Any, **named: Any) -> Any:
        nonlocal count
        count += 1
        if count > walks:
            raise Ended
        return walk(*given, **named)

    monkeypatch.setattr(Solver, "walk", counted)


@pytest.fixture(scope="module")
def problem() -> lf.Problem:
    return joints(LESS_RARE)


@pytest.mark.parametrize("walks", [1, 12])
def test_reliability_goes_on(
    problem: lf.Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, walks: int
) -> None:
    event = Response.opening("joint") > 0.0
    whole = reliability(problem, event, cov=0.15, checkpoint=tmp_path / "whole")
    without = reliability(problem, event, cov=0.15)
    # other starts: the design point within the tolerance of its search, and with it the samples around it
    assert without.probability.value == pytest.approx(whole.probability.value, rel=whole.cov)
    file = tmp_path / "run"
    with monkeypatch.context() as patch:
        ended_after(patch, walks)
        with pytest.raises(Ended):
            reliability(problem, event, cov=0.15, checkpoint=file)
    again = reliability(problem, event, cov=0.15, checkpoint=file)
    assert again.probability == whole.probability and again.cov == whole.cov
    assert again.design_points == whole.design_points and again.runs == whole.runs
    with monkeypatch.context() as patch:
        ended_after(patch, 0)
        assert reliability(problem, event, cov=0.15, checkpoint=file).probability == whole.probability
        with pytest.raises(Ended):  # it goes on from there
            reliability(problem, event, cov=0.05, checkpoint=file)


def test_calibration_goes_on(
    problem: lf.Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = {"data": [9500.0], "noise": 100.0, "samples": 512, "checkpoint": tmp_path / "fit"}
    with monkeypatch.context() as patch:
        ended_after(patch, 3)
        with pytest.raises(Ended):
            calibrate(problem, "bolt", **call)  # type: ignore[arg-type]
    first = calibrate(problem, "bolt", **call)  # type: ignore[arg-type]
    with monkeypatch.context() as patch:
        ended_after(patch, 0)
        again = calibrate(problem, "bolt", **call)  # type: ignore[arg-type]
    assert np.array_equal(first.samples, again.samples)  # type: ignore[union-attr]
    assert np.array_equal(first.weights, again.weights)  # type: ignore[union-attr]


def test_a_file_of_another_run_is_refused(problem: lf.Problem, tmp_path: Path) -> None:
    x = problem.function("joint").nominal
    f = problem.function("joint", checkpoint=tmp_path / "f")
    value = f(x)
    with pytest.raises(SceneError, match="in use by another run"):
        problem.function("joint", checkpoint=tmp_path / "f")
    f.close()
    for other, what in ((joints(RARE), "values"), (problem, "quantities")):
        with pytest.raises(SceneError, match=f"another run.*{what}"):
            other.function("bolt" if other is problem else "joint", checkpoint=tmp_path / "f")
    strength = [lf.LogNormal("strength", mean, cov=0.1) for mean in (12e3, 13e3)]
    bolt = Response("bolt")
    pairs = [(bolt - strength[0], bolt - strength[1]), (bolt - 1.0, bolt - (1.0 + 1e-9))]
    for number, (one, other) in enumerate(pairs):
        problem.function(one, checkpoint=tmp_path / f"r{number}").close()
        with pytest.raises(SceneError, match="another run"):
            problem.function(other, checkpoint=tmp_path / f"r{number}")
    again = problem.function("joint", checkpoint=tmp_path / "f")
    assert np.array_equal(again(x), value)
    again.close()
    with pytest.raises(SceneError, match="checkpoint"):
        problem.function("joint", checkpoint=tmp_path / "no" / "f")


def test_points_without_an_answer_are_known_from_the_file(problem: lf.Problem, tmp_path: Path) -> None:
    """A batch of which no state is kept."""
    few = lf.Options(max_iterations=1, newton=0)
    found = []
    for _ in range(2):
        f = problem.function("joint", options=few, checkpoint=tmp_path / "f")
        found.append(f.evaluate(f.nominal))
        f.close()
    first, again = found
    assert not first.converged.any() and list(again.statuses) == list(first.statuses)
    assert np.array_equal(again.error, first.error)
