"""The campaign judges rightly: what is right, wrong, or crashes, and its truth is the truth."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from campaign import judge, pool, reference, scenes  # noqa: E402

HEAD = """
import numpy as np

import dolfinx_frontend as lf

AMPLITUDES = [lf.Amplitude([0.0, 1.0], [0.0, 1.0]), lf.Amplitude([1.0, 2.0, 3.0], [0.0, 1.0, -0.5])]
TIMES = {times}
VARIABLES = {variables}
GRID = {grid}
RANDOM = {random}


def laws(a, v):
    return {{"wall": lf.Displacement(0.0), "joint": {joint}, "bed": {bed}, "load": {load}}}


def build(a, v):
    law, scene = laws(a, v), lf.Scene()
    for k in range(2):
        part = lf.geometry.box((1.0, 1.0), (2, 2), origin=(float(k), 0.0))
        scene.substructure(f"p{{k}}", part, lf.LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("wall", "p0:x0", law["wall"])
    scene.interface("joint", "p0:x1", "p1:x0", law["joint"])
    scene.interface("bed", "p1:y0", law["bed"])
    scene.interface("load", "p1:x1", law["load"])
    return scene


def run(problem):
    {run}
"""
SPRINGS = "lf.Elastic(normal=50.0, tangential=20.0)"
BED = "lf.Elastic(normal=5.0, tangential=2.0)"
PULL = "lf.Traction(np.array((0.1, 0.05)))"
PUSH = "lf.Traction(np.array((-0.1, 0.02)))"
SOLVE = "return lf.solve(problem, times=TIMES, options=lf.Options(rtol=1e-6))"
FIRST_PRESSED = "lf.Traction(a(0) * np.array((-0.1, 0.0)) + a(1) * np.array((0.0, 0.03)))"
RANDOM = {"variables": '{"k": lf.LogNormal("k", 50.0, cov=0.2)}', "random": '["joint"]'}
SOFT = 'lf.Elastic(normal=v("k"), tangential=20.0)'
TIGHT = "lf.Options(rtol=1e-12)"
PLAN = f"plan=lf.make_plan(problem, vary=RANDOM, options={TIGHT}), keep_states=True, progress=False"
DIAGONAL = "lf.Options(rtol=1e-8, macro='none', directions='diagonal')"

EASY: dict[str, dict[str, str]] = {
    "springs": {"joint": SPRINGS, "load": PULL},
    "springs kept": {
        "joint": SPRINGS,
        "load": PULL,
        "run": f"return lf.solve(problem, active='all', options={DIAGONAL})",
    },
    "contact": {"joint": "lf.Contact()", "load": PUSH},
    "stiff contact, gap": {"joint": "lf.Contact(gap=0.005, stiffness=200.0)", "load": PUSH},
    "friction": {"joint": "lf.Contact(friction=0.1)", "load": FIRST_PRESSED, "times": "[0.5, 1.0, 1.5, 2.0]"},
    "bond": {
        "joint": "lf.Debonding(normal=80.0, tangential=40.0, strength=0.05, opening=0.05)",
        "load": PULL,
    },
    "bolt": {
        "joint": "lf.Preload(a(0) * 0.05, until=1.0)",
        "load": "lf.Traction(a(1) * np.array((0.1, 0.05)))",
        "times": "[0.5, 1.0, 1.5, 2.5]",
    },
    "chaos": {
        "joint": SOFT,
        "load": PULL,
        "kind": "chaos",
        "run": "return lf.solve(problem, chaos=lf.Chaos(3), options=lf.Options(rtol=1e-13))",
        **RANDOM,
    },
    "samples": {
        "joint": SOFT,
        "load": PULL,
        "kind": "samples",
        "run": f"return lf.monte_carlo(problem, 4, seed=1, {PLAN})",
        **RANDOM,
    },
    "sweep": {
        "joint": 'lf.Elastic(normal=v("joint.normal"), tangential=20.0)',
        "load": PULL,
        "kind": "sweep",
        "grid": '{"joint.normal": [20.0, 50.0, 90.0]}',
        "random": '["joint"]',
        "run": f"return lf.sweep(problem, GRID, {PLAN})",
    },
}


def given(name: str, **changes: str) -> scenes.Scene:
    """A scene of the table with some entries changed."""
    entries = {"times": "None", "variables": "{}", "grid": "{}", "random": "[]", "bed": BED, "run": SOLVE}
    entries |= EASY[name] | changes
    kind = entries.pop("kind", "static" if entries["times"] == "None" else "history")
    source = HEAD.format(**entries)
    return scenes.Scene(0, "", kind, source, 1e-6, 1, name)


@pytest.mark.parametrize("name", list(EASY))
def test_right_is_right(name: str) -> None:
    verdict = judge.one(given(name))
    assert verdict.outcome == "right", (verdict.what, verdict.errors)
    assert verdict.true is not None and verdict.true <= 3e-6
    assert verdict.rounding < 1e-9


@pytest.mark.parametrize("name", ["springs", "friction", "chaos", "samples", "sweep"])
def test_a_perturbed_answer_is_wrong(name: str) -> None:
    verdict = judge.one(given(name), perturb=1e-4)
    assert verdict.outcome == "wrong"
    # in all norms and parts the same
    assert verdict.true == pytest.approx(1e-4, rel=0.1)


def test_an_error_of_one_step_or_of_the_scatter_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    original = judge.Case.run

    def spoilt(self: judge.Case, *settings: Any) -> judge.Found:
        found = original(self, *settings)
        step = found.fields[0][-1]
        if self.kind == "chaos":
            step["p1"] = np.array(step["p1"])
            step["p1"][:, 1:] *= 1.01
        else:
            step["p1"] = 1.01 * step["p1"]
        return found

    monkeypatch.setattr(judge.Case, "run", spoilt)
    verdict = judge.one(given("friction"))
    assert verdict.outcome == "wrong" and "p1, step 3" in verdict.errors[0]
    assert not any("step 2" in line or "p0" in line for line in verdict.errors)
    verdict = judge.one(given("chaos"))
    assert verdict.outcome == "wrong" and "p1, fluctuation" in verdict.errors[0]
    assert "mean" not in str(verdict.errors)


@pytest.fixture(scope="module")
def seat() -> Iterator[pool.Seat]:
    made = pool.Seat(limit=4.0)
    yield made
    made.close()


def task(name: str, **changes: str) -> dict[str, Any]:
    drawn = given(name, **changes)
    return {"seed": 1, "source": drawn.source, "kind": drawn.kind, "rtol": drawn.rtol}


def test_crashes_hangs_and_exceptions_are_counted(seat: pool.Seat) -> None:
    died = seat.run(task("springs", run="import os; os.abort()"))
    assert (died["outcome"], died["seed"]) == ("crashed", 1)
    assert "SIGABRT" in died["what"] and "solve" in died["what"]
    assert seat.run(task("springs"))["outcome"] == "right"  # another worker has taken its place
    slow = seat.run(task("springs", run="import time; time.sleep(60)"))
    assert slow["outcome"] == "crashed" and "within 4 s" in slow["what"]
    raised = seat.run(task("springs", run="raise RuntimeError('no')"))
    assert raised["outcome"] == "raised" and "RuntimeError: no" in raised["what"]


def test_a_run_that_stops_early_has_not_converged() -> None:
    call = "return lf.solve(problem, active='all', options=lf.Options(rtol=1e-6, max_iterations=2))"
    verdict = judge.one(given("contact", run=call))
    assert verdict.outcome == "not_converged" and verdict.status == "max_iterations"


def test_a_scene_without_an_answer_may_be_refused() -> None:
    free = "lf.Contact()"  # bed and joint open: p1 flies away
    drawn = given("contact", bed=free, load=PULL)
    verdict = judge.one(drawn)
    assert verdict.outcome in ("refused", "unjudged", "inadmissible"), verdict.what


def test_a_script_says_what_the_campaign_said(capsys: pytest.CaptureFixture[str]) -> None:
    drawn = given("contact")
    space: dict[str, Any] = {"__name__": "script"}
    exec(compile(scenes.script(drawn), "script", "exec"), space)
    judge.show(space, drawn.kind, drawn.rtol)
    assert "right (reference: assembled)" in capsys.readouterr().out


def test_scenes_come_from_their_seed() -> None:
    for seed in range(6):
        assert scenes.script(scenes.scene(seed)) == scenes.script(scenes.scene(seed))
        assert scenes.scene(seed).family == scenes.FAMILIES[seed % 2]
    assert scenes.scene(0).source != scenes.scene(2).source


def test_the_reference_knows_a_closed_form() -> None:
    """A block under uniaxial stress closes a gap: the contact takes the load less what springs take."""
    E, gap, k, p, length = 100.0, 0.01, 30.0, 3.0, 1.0
    scene = lf.Scene()
    part = lf.geometry.box((length, length), (2, 2), cell="triangle")
    scene.substructure("block", part, lf.LinearElastic(E, 0.0), degree=1)
    scene.symmetry("block:y0")
    scene.interface("stop", "block:x0", lf.Contact(gap=gap))
    scene.interface("bed", "block:x0", lf.Elastic(normal=k))
    scene.pressure("block:x1", p, name="load")
    problem = lf.assemble(scene)
    model = reference.Model(problem, {n: i.law for n, i in problem.interfaces.items()}, ())
    answer, _ = model.solve({n: i.law for n, i in problem.interfaces.items()})
    x = problem.substructures["block"].dof_coordinates
    found = answer.fields["block"].reshape(-1, 2)
    assert found[:, 0] == pytest.approx(-gap - p / E * x[:, 0], rel=1e-12)
    assert answer.forces["stop"] == pytest.approx(k * gap - p, rel=1e-10)
