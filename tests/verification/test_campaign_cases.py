"""The scenes that the first campaign failed at, judged again: ``./run test -m night``."""

from __future__ import annotations

import contextlib
import io
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from campaign import judge, pool  # noqa: E402

CASES = BENCHMARKS / "campaign" / "cases"
FACTOR = judge.FACTOR
LEAST = 1e-10
"""Errors below this are rounding."""


def drawn(file: Path, seat: pool.Seat) -> tuple[str, str]:
    """Outcome of a drawn scene, and what is to be said of it."""
    text = file.read_text()
    found = re.search(r'show\(globals\(\), kind="(\w+)", rtol=([\d.e-]+)\)', text)
    assert found is not None, file
    if "mpirun" in text:
        call = ["mpirun", "-n", "2", sys.executable, "-c", text]
        said = subprocess.run(call, capture_output=True, text=True, timeout=120).stdout
        line = re.search(r"^(\w+) \(reference: .*?\): (.*)$", said, re.MULTILINE)
        return (line[1], line[2]) if line else ("crashed", said)
    verdict = seat.run({"seed": 0, "source": text, "kind": found[1], "rtol": float(found[2])})
    return verdict["outcome"], verdict["what"]


def written(file: Path, parts: ModuleType) -> tuple[str, str]:
    """Outcome of a script that loops over what makes it worse: of its lines, the worst."""
    parts.TOLD.clear()
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(file.read_text(), str(file), "exec"), {"__name__": "case"})
    lines = list(parts.TOLD)
    assert lines, file
    converged = [line for line in lines if line[1] == "converged"]
    wrong = [x for x in converged if x[4] > max(FACTOR * min(x[2], x[3]), LEAST)]
    if wrong:
        what, _, _, said, true = max(wrong, key=lambda x: x[4])
        return "wrong", f"{len(wrong)} of {len(lines)}, {what}: true {true:.1e}, said {said:.1e}"
    if len(converged) < len(lines):
        return "not_converged", f"{len(lines) - len(converged)} of {len(lines)}"
    return "right", f"{len(lines)} lines"


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The scripts' helper; what it mutes is undone."""
    import logging
    import warnings

    module = ModuleType("parts")
    with warnings.catch_warnings():
        try:
            exec(compile((CASES / "parts.txt").read_text(), "parts.txt", "exec"), module.__dict__)
            monkeypatch.setitem(sys.modules, "parts", module)
            yield module
        finally:
            logging.disable(logging.NOTSET)


@pytest.mark.night(guard="test_scenes_that_later_campaigns_failed_at")
@pytest.mark.timeout(900)
@pytest.mark.xfail(strict=False, reason="the error of a part, step or fluctuation hides behind others")
def test_the_scenes_that_the_first_campaign_failed_at(
    parts: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    seat, table = pool.Seat(limit=60.0), []
    try:
        for file in sorted(CASES.glob("*.txt")):
            if file.stem == "parts":
                continue
            outcome: Any
            try:
                outcome = drawn(file, seat) if file.stem.startswith("gen_") else written(file, parts)
            except Exception as error:  # one case is no reason to lose the table
                outcome = "raised", f"{type(error).__name__}: {error}"
            table.append((file.stem, *outcome))
    finally:
        seat.close()
    with capsys.disabled():
        print()
        for name, outcome, what in table:
            print(f"{name:<34}{outcome:<15}{' '.join(what.split())[:150]}")
    # rounding above the tolerance is no failure
    bad = [f"{name}: {outcome}" for name, outcome, _ in table if outcome not in ("right", "rounding")]
    assert not bad, bad


MARKS = {
    "scatter_part_by_part": pytest.mark.night(guard="the other scenes"),
    "bolt_beside_contact": pytest.mark.xfail(
        reason="moduli of 1e-7 beside 118: the errors said, 2e-6 and 6e-6, leave out how exactly bodies of "
        "such parts are factorised (the reference is 8e-5 off answers that agree to 2.4e-7)",
        strict=False,
    ),
}
LATER = sorted((CASES / "later").glob("*.txt"))


@pytest.mark.parametrize(
    "file", [pytest.param(file, id=file.stem, marks=MARKS.get(file.stem, ())) for file in LATER]
)
def test_scenes_that_later_campaigns_failed_at(file: Path) -> None:
    """Estimates were too small, or nothing was found; rounding may decide where the name says so."""
    seat = pool.Seat(limit=60.0)
    try:
        outcome, what = drawn(file, seat)
    finally:
        seat.close()
    if file.stem == "scatter_part_by_part":  # another equilibrium than the one that the loading leads to
        assert outcome in ("right", "wrong", "several"), what
    elif file.stem.startswith("rounding_"):  # a pivot that is rounding is one, or is told as none
        assert outcome in ("right", "rounding") or "beyond rounding" in what, (outcome, what)
    else:
        assert outcome == "right", what


@pytest.mark.night(guard="test_scenes_that_later_campaigns_failed_at")
@pytest.mark.timeout(900)
def test_forty_drawn_scenes(tmp_path: Path) -> None:
    """None is wrong; campaigns of thousands find 0.5 to 1 %."""
    table = tmp_path / "campaign.json"
    call = [sys.executable, str(BENCHMARKS / "campaign.py"), "--json", str(table)]
    drawn = ["--scenes", "40", "--seed", "300", "--jobs", "2", "--time-limit", "300"]
    run = subprocess.run([*call, *drawn], capture_output=True, text=True, timeout=850)
    assert run.returncode == 0, run.stderr
    found = json.loads(table.read_text())
    said = "\n".join(f"{one['seed']} {one['outcome']}: {one['what']}" for one in found["failures"])
    assert found["scenes"] == 40
    assert found["raised"] == found["crashed"] == 0, said
    assert found["wrong"] == 0, said
    assert found["not_converged"] <= 1, said
    assert found["estimate_within"] >= 0.9, said
