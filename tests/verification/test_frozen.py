"""The frozen corpus: what is kept of answers; each kind of difference is found, and no other."""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from frozen import compare, drawn, store  # noqa: E402
from frozen.observe import Observation, observe  # noqa: E402

RTOL = 1e-9


def pair(law: lf.Law, pull: Any = (-0.1, 0.02)) -> lf.Problem:
    """Two squares: the first held, the second pressed on it and held by springs at its lower side."""
    scene = lf.Scene()
    for k in range(2):
        part = lf.geometry.box((1.0, 1.0), (2, 2), origin=(float(k), 0.0))
        scene.substructure(f"p{k}", part, lf.LinearElastic(E=100.0, nu=0.3))
    scene.interface("wall", "p0:x0", lf.Displacement(0.0))
    scene.interface("joint", "p0:x1", "p1:x0", law)
    scene.interface("bed", "p1:y0", lf.Elastic(normal=5.0, tangential=2.0))
    scene.interface("load", "p1:x1", lf.Traction(pull))
    return lf.assemble(scene)


CONTACT = lf.Contact(friction=0.3)
SOFT = lf.Elastic(normal=lf.LogNormal("k", 50.0, cov=0.2), tangential=20.0)
OPTIONS = lf.Options(rtol=RTOL)


def history() -> Any:
    rising = lf.Amplitude([0.0, 2.0], [0.0, 1.0])
    return lf.solve(pair(CONTACT, rising * np.array((-0.1, 0.02))), times=[1.0, 2.0], options=OPTIONS)


RESULTS = {
    "static": lambda: lf.solve(pair(CONTACT), options=OPTIONS),
    "history": history,
    "chaos": lambda: lf.solve(pair(SOFT), chaos=lf.Chaos(2, check_points=0), options=OPTIONS),
    "samples": lambda: lf.monte_carlo(
        pair(SOFT), 8, seed=1, options=OPTIONS, keep_states=True, progress=False
    ),
    "sweep": lambda: lf.sweep(
        pair(lf.Elastic(normal=50.0, tangential=20.0)),
        {"joint.normal": [20.0, 80.0]},
        options=OPTIONS,
        keep_states=True,
        progress=False,
    ),
}


@pytest.mark.parametrize("kind", RESULTS)
def test_statuses_resultants_errors_and_counts_of_every_kind_are_kept(kind: str) -> None:
    seen = observe(RESULTS[kind](), RTOL)
    assert not seen.missing
    assert seen.words["status"] == "converged"
    assert 0.0 <= seen.said["error"][0] <= RTOL
    assert seen.counts["factorisations"] >= 1.0
    assert "iterations" in seen.counts
    statistic = " mean" if kind in ("chaos", "samples") else "@1" if kind in ("history", "sweep") else ""
    value, error = seen.values[f"load.force_x{statistic}"]
    # what is on side 1 of a load is what pulls: its area is 1
    assert value == pytest.approx(-0.1, abs=1e-8)
    assert 0.0 < error <= 30.0 * RTOL * 10.0
    assert {"p0.u", "p1.u_x", "joint.opening max"} <= set(seen.values) or kind == "sweep"
    if kind in ("chaos", "samples"):
        assert seen.values["p1.u std"][0] > 0.0
        assert "joint.normal 95 %" in seen.values
    json.dumps(store.kept(seen))


def test_records_of_statistics_are_read_field_by_field() -> None:
    result = RESULTS["samples"]()
    seen = observe(
        {"q": result.quantity("joint.normal"), "mean": result.mean_std("joint"), "n": 3.5, "w": "word"}, RTOL
    )
    assert {"q.mean", "q.std", "mean.mean", "mean.std", "n"} <= set(seen.values)
    assert seen.said["q.mean interval"][0] > 0.0
    assert seen.words["w"] == "word"


def test_a_field_that_vanished_is_said() -> None:
    @dataclass
    class Summary:
        restarts: int = 1

    class Result:
        kind, status, statuses, iterations = "deterministic", "converged", ("converged",), 3
        summary, without_displacements = Summary(), "none are there"

        def table(self, step: int | None) -> Any:
            raise AttributeError("no table any more")

    seen = observe(Result(), RTOL)
    assert seen.counts["restarts"] == 1.0
    assert any("newton_steps" in each for each in seen.missing)
    assert any("table" in each for each in seen.missing)


def test_what_is_kept_does_not_depend_on_the_numbering_of_nodes() -> None:
    rng = np.random.default_rng(0)
    places, u = rng.random((20, 2)), rng.standard_normal((20, 2))
    order = rng.permutation(20)
    from frozen.observe import displacements

    one = displacements(places, u.ravel(), "p", RTOL)
    two = displacements(places[order], u[order].ravel(), "p", RTOL)
    assert all(one[key][0] == pytest.approx(two[key][0], abs=1e-14) for key in one)


# --- compare -----------------------------------------------------------------------------------------
def record(**changes: Any) -> dict[str, Any]:
    base: dict[str, Any] = {
        "name": "joints/one",
        "outcome": "answered",
        "values": {"clamp.normal": [48e3, 1e-4], "p.u": [1.0, 1e-9]},
        "words": {"status": "converged"},
        "said": {"error": [4e-10, 1e-9]},
        "counts": {"iterations": 100, "peak bytes": 2e8},
        "missing": [],
        "right": {"clamp.normal": [48e3, 1.0, "balance"]},
    }
    return {**copy.deepcopy(base), **changes}


def test_equal_records_are_silent() -> None:
    assert not compare.differences(record(), record())
    assert not compare.grown(record(), record())


@pytest.mark.parametrize(
    ("kind", "key", "change"),
    [
        ("value", "p.u", {"values": {"clamp.normal": [48e3, 1e-4], "p.u": [1.0 + 5e-9, 1e-9]}}),
        ("value", "p.u", {"values": {"clamp.normal": [48e3, 1e-4], "p.u": ["nan", 1e-9]}}),
        ("vanished", "p.u", {"values": {"clamp.normal": [48e3, 1e-4]}}),
        ("status", "status", {"words": {"status": "stagnated"}}),
        ("error said", "error", {"said": {"error": [1.3e-9, 1e-9]}}),
        ("error said", "error", {"said": {"error": ["nan", 1e-9]}}),
        ("status", "status", {"words": {"status": "inexact"}}),
        ("right value", "clamp.normal", {"right": {"clamp.normal": [48010.0, 1.0, "balance"]}}),
        ("outcome", "outcome", {"outcome": "raised SceneError"}),
    ],
)
def test_a_planted_difference_is_found(kind: str, key: str, change: Mapping[str, Any]) -> None:
    found = compare.differences(record(), record(**change))
    assert [(each.kind, each.key, each.scene) for each in found] == [(kind, key, "joints/one")]


def test_what_is_within_the_errors_is_silent() -> None:
    new = record(
        values={"clamp.normal": [48e3 + 3e-4, 1e-4], "p.u": [1.0 - 3.9e-9, 1e-9], "new": [1.0, 1e-9]},
        said={"error": [1.2e-9, 1e-9]},
    )
    assert not compare.differences(record(), new)


def test_a_better_status_and_a_smaller_error_want_a_reason_too() -> None:
    """Both may be claimed by mistake."""
    old = record(words={"status": "converged 0-1, stagnated 2-3"}, said={"error": [1e-5, 1e-9]})
    same = record(words={"status": "converged 0-1, stagnated 2-3"}, said={"error": [2e-6, 1e-9]})
    assert not compare.differences(old, same)
    found = compare.differences(old, record(said={"error": [5e-7, 1e-9]}))
    assert [each.kind for each in found] == ["status", "error said"]


def test_counts_that_grew_are_listed() -> None:
    more = compare.grown(record(), record(counts={"iterations": 106, "peak bytes": 2.3e8}))
    assert [each.key for each in more] == ["iterations"]
    more = compare.grown(record(), record(counts={"iterations": 104, "peak bytes": 2.5e8}))
    assert [each.key for each in more] == ["peak bytes"]
    assert [each.new for each in compare.grown(record(), record(counts={"peak bytes": 2e8}))] == ["not told"]


def test_of_a_scene_known_to_be_bad_only_right_values_count() -> None:
    bad = record(
        known_bad="tears",
        words={"status": "stagnated"},
        values={"clamp.normal": [40e3, 1.0], "p.u": [1.0, 1e-9]},
    )
    mended = record()
    assert not compare.differences(bad, mended)
    assert compare.mended(bad, mended)
    assert not compare.differences(bad, {**bad, "values": {"clamp.normal": [41e3, 1.0]}})
    claims = record(values={"clamp.normal": [40e3, 1.0]})
    assert [each.kind for each in compare.differences(bad, claims)] == ["right value"]
    lost = record(known_bad="tears", words={"status": "stagnated"})
    assert [each.kind for each in compare.differences(lost, bad)] == ["right value"]


def test_a_row_excuses_its_scene_and_key_only() -> None:
    head = "| scene | key | old | new | check |\n|---|---|---|---|---|\n"
    text = head + "| `joints/one` | `p.u` | 1 | 1.1 | closed form of the bar |\n"
    text += "| joints/two | bolt*.bending[12]* | 1 | 2 | rounding: the assembled reference |\n"
    text += "\n## Accepted\n\n| `joints/one` | `p.u_x` | 1 | 1.1 | closed form of the bar |\n"
    table = store.rows(text)
    assert store.excusing(table, "joints/one", "p.u") is table[0]
    assert store.excusing(table, "joints/two", "bolt3.bending[12].normal") is table[1]
    others = ("joints/one", "p.u_x"), ("joints/two", "p.u"), ("joints/two", "bolt3.bending1.normal")
    for scene, key in others:
        assert store.excusing(table, scene, key) is None
    with pytest.raises(ValueError, match="check"):
        store.rows(head + "| joints/one | p.u | 1 | 1.1 | |\n")
    whole = store.DIFFERENCES.read_text(encoding="utf-8").replace(store.ACCEPTED, "\n")
    for row in store.rows(whole):
        assert len(row.check) > 20 and not row.scene.startswith("*")


@pytest.mark.parametrize(("check", "allowed"), [("closed form", 1e-9), ("rounding: a reference", 0.1)])
def test_an_accepted_answer_is_what_later_ones_are_held_against(check: str, allowed: float) -> None:
    table = [store.Row("joints/one", "p.u", "1", "1.1", check)]
    new = record(values={"clamp.normal": [48e3, 1e-4], "p.u": [1.1, 1e-9]})
    kept = store.accepted(record(), new, table, "abc")
    assert kept["values"] == {"clamp.normal": [48e3, 1e-4], "p.u": [1.1, pytest.approx(allowed)]}
    assert kept["accepted"] == "abc" and not compare.differences(kept, new)
    assert bool(compare.differences(kept, record())) == (check == "closed form")


def test_of_a_number_that_is_zero_its_right_value_is_asked() -> None:
    """A sum of forces in balance is rounding, and has no size of its own."""
    right = {"sum": [0.0, 1e-6, "balance"]}
    old = record(right=right, values={"sum": [3e-13, 3e-22]})
    assert not compare.differences(old, record(right=right, values={"sum": [-8e-12, 8e-21]}))
    wrong = compare.differences(old, record(right=right, values={"sum": [2e-6, 2e-15]}))
    assert [each.kind for each in wrong] == ["right value"]


# --- file --------------------------------------------------------------------------------------------
def test_the_file_gives_back_what_was_written(tmp_path: Path) -> None:
    seen = Observation(
        values={"a": (1.23456789012345, 1e-9), "b": (float("nan"), 0.0)}, said={"e": (float("inf"), 1e-9)}
    )
    kept = {"name": "joints/one", "outcome": "answered", **store.kept(seen)}
    file = tmp_path / "frozen.jsonl.xz"
    store.write({"joints/one": kept}, {"commit": "abc"}, file)
    head, found = store.read(file)
    assert head["commit"] == "abc"
    assert found == {"joints/one": kept}
    assert not compare.differences(kept, found["joints/one"])
    # to a tenth of the error that was said
    assert found["joints/one"]["values"]["a"][0] == pytest.approx(1.23456789012345, abs=1e-10)


def test_scenes_are_chosen_by_group_and_pattern() -> None:
    names = ["joints/a", "joints/ab", "campaign/1"]
    assert store.chosen(names, None, "joints") == ["joints/a", "joints/ab"]
    assert store.chosen(names, "joints/*b", None) == ["joints/ab"]
    assert store.chosen(names, "1", None) == ["campaign/1"]


def test_the_frozen_file_is_small_and_names_its_state() -> None:
    head, records = store.read()
    assert store.FILE.stat().st_size <= store.LARGEST
    assert head["commit"]
    assert {"campaign", "cases", "fixed", "joints", "scripts"} <= {name.split("/")[0] for name in records}


# --- scenes ------------------------------------------------------------------------------------------
def test_a_drawn_scene_is_solved_again_as_it_was() -> None:
    old = drawn.frozen(drawn.FIRST)
    new = {"name": "campaign/0", **drawn.solved(old)}
    assert old["verdict"] == "right"
    assert not compare.differences({"name": "campaign/0", **old}, new)
    wrong = old["source"].replace("lf.LinearElastic(E=", "lf.LinearElastic(E=1.001 * ")
    assert compare.differences(
        {"name": "campaign/0", **old}, {"name": "campaign/0", **drawn.solved({**old, "source": wrong})}
    )
