"""Small versions of ``./run bench faults`` and ``./run bench fuzz``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import faults  # noqa: E402
import fuzz  # noqa: E402

SEALED = [kind for kind in fuzz.KINDS if not kind.startswith("mesh")]
"""Kinds with a checksum; meshes are fuzzed beside the STEP files."""


@pytest.mark.night(guard="test_a_fault_that_loses_a_point_is_seen")
def test_faults() -> None:
    tasks = [task for task in (faults.drawn(2, number) for number in range(30)) if task["fault"] != "rank"]
    verdicts = faults.campaign(tasks[:20], 1, quiet=True)
    assert len(verdicts) == 20
    assert [faults.line(verdict) for verdict in verdicts if verdict["outcome"] != "right"] == []


def test_a_fault_that_loses_a_point_is_seen(tmp_path: Path) -> None:
    """The judge notices what it is there for."""
    import sqlite3

    from faulty.judge import resumed, undisturbed
    from faulty.work import WORK

    objects, _, truth, ticks = undisturbed("sweep")
    assert ticks > 50
    path = tmp_path / "points"
    WORK["sweep"].run(objects, path)
    with sqlite3.connect(path) as db:
        db.execute("delete from point where number = 3")
    db.close()
    task = {"work": "sweep", "folder": str(tmp_path), "kept": 12}
    assert resumed(task, WORK["sweep"], objects, truth, "")["outcome"] == "lost"
    assert resumed({**task, "kept": 11}, WORK["sweep"], objects, truth, "")["outcome"] == "right"
    wrong = {name: 1.001 * values for name, values in truth.items()}
    assert resumed(task, WORK["sweep"], objects, wrong, "")["outcome"] == "wrong"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert resumed(task, WORK["sweep"], objects, truth, "")["outcome"] == "unreadable"


@pytest.mark.slow
def test_damaged_files() -> None:
    verdicts = fuzz.fuzz(fuzz.tasks(200, 3, SEALED), 1, quiet=True)
    assert len(verdicts) == 200
    assert [verdict for verdict in verdicts if verdict["outcome"] in fuzz.FAILURES] == []
    assert sum(verdict["outcome"] == "refused" for verdict in verdicts) > 100
