"""Where an answer is how wrong: the kernel's errors in words, statuses by step and by point."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Scene,
    assemble,
    geometry,
    load,
    solve,
    sweep,
)
from dolfinx_frontend.common.arrays import largest_of
from dolfinx_frontend.estimate.errors import next_halving, not_known
from dolfinx_frontend.results.accuracy import Accuracy, accuracy_of_run, ended, place_of

# by the indicator: before it gives up, a run that is stopped by its error is carried on by other means
SHORT = Options(rtol=1e-12, max_iterations=3, newton=0, criterion="indicator")
CONTACT = Contact(friction=0.3)
BODIES = (("plate", "bolt"), ("mount",))


def plan(history="none", patterns=(None,), steps=1, in_time=None):
    """The facts of a plan that rows depend on."""
    columns = steps if history == "steps" else len(patterns)
    amplitudes = np.zeros((len(patterns), columns))
    return SimpleNamespace(
        history=history,
        patterns=patterns,
        amplitudes=amplitudes,
        measured_in_time=in_time,
        measured_by_step=history == "steps" or in_time is not None,
    )


def summary(values):
    return SimpleNamespace(errors=np.asarray(values, dtype=float))


def test_places_of_steps_and_fluctuations():
    values = np.full((16, 2), 1e-9)
    values[15, 1] = 1e-3
    found = accuracy_of_run(summary(values), plan("steps", steps=8), BODIES)
    assert found.largest == 1e-3 and found.place == "part mount, step 7, fluctuation"
    assert found.groups[0] == "step 0, mean" and found.places == ("part plate + bolt", "part mount")
    by_step = found.by_step(8)
    assert by_step[7] == 1e-3 and np.all(by_step[:7] == 1e-9)


def test_places_without_chaos():
    """Nothing fluctuates: a row for every step or load pattern."""
    values = [[1e-9, 1e-8]]
    found = accuracy_of_run(summary(values), plan(), BODIES)
    assert found.largest == 1e-8 and found.place == "part mount"
    patterned = accuracy_of_run(summary(values * 2), plan("patterns", (None, "a")), BODIES)
    assert patterned.place == "part mount, load pattern 0" and patterned.by_step(3) == pytest.approx(1e-8)
    in_time = plan("patterns", (None, "a"), in_time=np.ones((2, 3)))
    timed = accuracy_of_run(summary([[1e-9, 1e-9], [1e-9, 1e-7], [1e-9, 1e-8]]), in_time, BODIES)
    assert timed.place == "part mount, step 1" and timed.by_step(3)[2] == pytest.approx(1e-8)


def test_what_is_not_known_is_largest_and_has_no_number():
    found = accuracy_of_run(summary([[1e-9, np.inf]]), plan(), BODIES)
    assert np.isnan(found.largest) and found.place == "part mount" and np.isnan(found.by_step(1)[0])
    text = ended("undecided", float("inf"), found.place, 1e-6, 120)
    assert "not known in part mount" in text and "inf" not in text and "after 120 iterations" in text
    assert np.isnan(largest_of(np.array([1.0, np.nan]))) and largest_of(np.zeros(0)) == 0.0
    assert accuracy_of_run(summary(np.zeros((0, 0))), plan(), BODIES) is None


def test_places_of_points():
    assert place_of(plan("steps", steps=8), BODIES, (3, 1)) == "part mount, step 3"
    assert place_of(plan(), BODIES, (-1, -1)) == ""


def test_a_step_converged_if_those_before_it_did():
    values = np.array([[1e-9], [1e-3], [1e-9]])
    accuracy = Accuracy(values, ("step 0", "step 1", "step 2"), ("part a",), (0, 1, 2))
    assert accuracy.place == "part a, step 1" and list(accuracy.by_step(3)) == [1e-9, 1e-3, 1e-9]


def block(push=2.0, history=False, ground=CONTACT):
    """A block on a plane with friction; `push` may be more than it bears at first."""
    scene = Scene()
    scene.substructure("block", geometry.box((1.0, 1.0), (3, 3)), LinearElastic(100.0, 0.3), degree=1)
    scene.interface("ground", "block:y0", ground)
    scene.interface("guide", "block:y1", Elastic(1.0, 1.0))
    scene.pressure("block:y1", 10.0, name="press")
    load = Amplitude([0.0, 1.0], [0.0, 1.0]) * (push, 0.0) if history else (push, 0.0)
    scene.traction("block:x0", load, name="push")
    return assemble(scene)


@pytest.mark.parametrize("history", [False, True])
def test_runs_that_are_cut_short(history, tmp_path, caplog):
    times = [0.0, 0.5, 1.0] if history else None
    result = solve(block(history=history), times=times, options=SHORT)
    count = 3 if history else 1
    assert result.status == "max_iterations" and len(result.statuses) == len(result.step_errors) == count
    assert result.statuses[-1] == "max_iterations"
    assert result.accuracy.values.shape == (count, 1)
    assert result.place.startswith("part block, step " if history else "part block")
    for text in (repr(result), result.ended, caplog.text):
        assert "max_iterations" in text and " inf" not in text
    assert "Options(max_iterations=...)" in result.ended
    result.save(tmp_path / "cut.h5")
    saved = load(tmp_path / "cut.h5")
    assert saved.status == "max_iterations" and saved.statuses == result.statuses
    assert saved.place == result.place and "inf" not in repr(saved)
    assert saved.error == pytest.approx(result.error, nan_ok=True)


@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_points_that_are_cut_short():
    result = sweep(block(), {"ground.friction": [0.1, 0.2]}, options=SHORT, progress=False)
    assert list(result.statuses) == ["max_iterations"] * 2 and result.places.shape == (2,)
    assert list(result.places) == ["part block"] * 2 and result.place.endswith(", part block")
    assert "2 of 2 points did not converge" in result.ended and "inf" not in repr(result)
    point = result.point(1)
    assert point.statuses == ("max_iterations",) and "inf" not in repr(point)


def test_rows_of_a_chaos_are_mean_and_fluctuation_of_its_steps():
    """As many rows as the kernel says, of a static chaos and of one over time; a single mode is all mean."""
    kinds = {0: [""], 2: ["mean", "fluctuation"]}
    for order, words in kinds.items():
        for history in (False, True):
            times = [0.0, 0.5, 1.0] if history else None
            problem = block(1.0, history, Contact(friction=LogNormal("mu", 0.3, cov=0.1)))
            result = solve(problem, chaos=Chaos(order, check_points=0), times=times)
            steps = [f"step {k}" for k in range(3)] if history else [""]
            rows = [", ".join(w for w in (step, word) if w) for step in steps for word in words]
            assert result.accuracy.groups == tuple(rows)
            assert result.accuracy.largest == pytest.approx(result.error, nan_ok=True)
            assert result.accuracy.by_step(len(steps)).shape == (len(steps),)


def test_bodies_are_the_parts_that_are_glued():
    scene = Scene()
    for k in range(3):
        box = geometry.box((1.0, 1.0), (2, 2), origin=(float(k), 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(100.0, 0.3), degree=1)
    scene.fix("b0:x0", name="wall")
    scene.interface("glue", "b0:x1", "b1:x0", Elastic(50.0, 50.0))
    scene.interface("joint", "b1:x1", "b2:x0", Contact(friction=0.3))
    scene.interface("bed", "b2:y0", Elastic(1.0, 1.0))
    scene.traction("b2:x1", (-1.0, 0.0), name="push")
    result = solve(assemble(scene), active=["joint"])
    assert result.accuracy.places == ("part b0 + b1", "part b2")
    assert result.accuracy.values.shape == (1, 2)


def test_an_undecided_run_is_promised_nothing():
    result = solve(block())
    assert result.converged and "more iterations" in next_halving(result, not_known(result, None))

    class Undecided:
        """The same run, had it found no answer."""

        status, converged = "undecided", False

        def __getattr__(self, name):
            return getattr(result, name)

    text = next_halving(Undecided(), not_known(result, None))
    assert "more iterations" not in text and "does not fall" in text and "undecided" in text
