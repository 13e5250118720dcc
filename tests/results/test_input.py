"""Whatever an answer is asked: what is no name, step, count or function is refused by name and value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.helpers import NO_WHOLE_NUMBERS, refused

QUIET: dict[str, Any] = {"progress": False}
NOT_KNOWN = (0, None, 1.5, ["layer"], {}, True, "", "layr", "a\nb")
KINDS = ("once", "history", "chaos", "samples", "sweep", "point", "saved")


def scene(stiffness: Any, load: Any) -> lf.Problem:
    """Two squares with an elastic layer between them."""
    made = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        made.substructure(f"p{i}", part, lf.LinearElastic(1.0, 0.3), degree=1)
    made.fix("p0:y0", name="foot")
    made.pressure("p1:y1", load, "top")
    made.interface("layer", "p0:y1", "p1:y0", lf.Elastic(stiffness, 5.0))
    return lf.assemble(made)


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One answer of each kind."""
    fixed, random = scene(5.0, 1.0), scene(lf.LogNormal("k", 5.0, cov=0.1), 1.0)
    moving = scene(5.0, lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * 1.0)
    grid = {"layer.normal": [1.0, 2.0]}
    found: dict[str, Any] = {
        "once": lf.solve(fixed, **QUIET),
        "history": lf.solve(moving, times=[0.5, 1.0], **QUIET),
        "chaos": lf.solve(random, chaos=2, **QUIET),
        "samples": lf.monte_carlo(random, 5, keep_states=True, **QUIET),
        "sweep": lf.sweep(fixed, grid, keep_states=True, outputs={"n": lambda b: [1.0]}, **QUIET),
    }
    found["point"] = found["sweep"].point(0)
    path = tmp_path_factory.mktemp("saved") / "answer.h5"
    found["once"].save(path)
    found["saved"] = lf.load(path)
    return found


@pytest.fixture(params=KINDS)
def answer(request: pytest.FixtureRequest, answers: dict[str, Any]) -> Any:
    """Every kind in turn."""
    return answers[request.param]


@pytest.mark.parametrize("name", NOT_KNOWN)
def test_names(answer: Any, name: Any) -> None:
    for read in (answer.force, answer.jump):
        refused(lambda read=read: read(name), repr(name), "'layer'")
    for read in (answer.displacement, answer.stress, answer.mean):
        refused(lambda read=read: read(name), repr(name), "'p0'")
    if answer.statistics != "grid":
        refused(lambda: answer.std(name), repr(name), "'p0'")
    refused(lambda: answer.moments(name), repr(name))
    if name not in (None, ["layer"], {}):
        for read in (answer.table, answer.bolts):
            refused(lambda read=read: read(name), repr(name))
    refused(lambda: answer.table([name]), repr(name))


@pytest.mark.parametrize("step", [2, "a", 0.5, True, 1j, np.nan, [0], "0"])
def test_steps(answer: Any, step: Any) -> None:
    reads: list[Any] = [
        answer.table, *(lambda step, r=r: r("p0", step) for r in (answer.displacement, answer.stress)),
    ]
    if answer.statistics != "grid":
        reads.append(lambda step: answer.std("p0", step))
    for read in reads:
        text = refused(lambda read=read: read(step=step))
        assert f"step = {step!r}" in text or "there is no step 2" in text


def test_tables(answer: Any) -> None:
    for about in ("ab", [1.0], [1.0, "b"], [1.0, None], [np.nan, 0.0], 3.0, [1j, 0.0], [True, False]):
        refused(lambda about=about: answer.table(about=about), "about = ", "2 coordinates")
    for quantiles in ("ab", [1.5], [np.nan], [None], 0.5, [0.0], ["0.5"], [True], None):
        refused(lambda quantiles=quantiles: answer.table(quantiles=quantiles), "quantile")
    table = answer.table()
    for column in (3, None, "forc", ["normal"]):
        refused(lambda column=column: table[column], repr(column), "column")
    refused(lambda: table.value("normal", "layr"), "'layr'")
    refused(lambda: table.value("normal", "layer", tim=1.0), "'tim'")


def test_quantities(answer: Any) -> None:
    for wrong in ("layer", None, 3, ["layer"]):
        refused(lambda wrong=wrong: answer.quantity(wrong), f"function = {wrong!r}", "cannot be called")
    for name in (3, None, ["a"], "", "a\nb"):
        refused(lambda name=name: answer.quantity(lambda b: np.zeros(len(b)), name), f"name = {name!r}")
    refused(lambda: answer.quantity(lambda b: np.zeros(len(b)), "q", 3), "'q'", "unit = 3")
    for returned in ("abc", None, ["a"], [1j], 1.0, [[1.0]]):
        refused(lambda returned=returned: answer.quantity(lambda b: returned, "q"), "'q'")
    refused(lambda: answer.quantity(lambda b: np.full(len(b), np.nan), "q"), "'q'", "not finite")
    for name in (0, None, "layr", ["layer"]):
        refused(lambda name=name: answer.quantity(lambda b: b.force(name)[:, 0, 0]), repr(name))
        refused(lambda name=name: answer.quantity(lambda b: b.displacement(name)[:, 0]), repr(name))


def test_words(answer: Any) -> None:
    for of in (3, None, ["stress"], "strain"):
        refused(lambda of=of: answer.std("p0", of=of), f"of = {of!r}")
        if of is not None:
            refused(lambda of=of: answer.moments("layer", of), f"of = {of!r}")


def test_files(answer: Any, tmp_path: Path) -> None:
    for path in (3, None, True, "", ["a"], 1.5, b"a.h5"):
        refused(lambda path=path: answer.save(path), f"path = {path!r}")
        refused(lambda path=path: lf.load(path), f"path = {path!r}")
        refused(lambda path=path: lf.io.write(answer, path), f"folder = {path!r}")
        refused(lambda path=path: lf.io.write_fields(answer, path), f"path = {path!r}")
        refused(lambda path=path: lf.io.write_interfaces(answer, path), f"path = {path!r}")
    refused(lambda: answer.save(tmp_path / "a.h5", fields="no"), "fields = 'no'")


def test_what_is_no_answer(tmp_path: Path) -> None:
    for wrong in (3, None, "answer", scene(5.0, 1.0)):
        refused(lambda wrong=wrong: lf.io.write(wrong, tmp_path), "result = ")
        refused(lambda wrong=wrong: lf.io.write_interfaces(wrong, tmp_path / "a.vtm"), "result = ")
        refused(lambda wrong=wrong: lf.io.facet_fields(wrong, "layer"), "result = ")
        refused(lambda wrong=wrong: lf.io.write_fields(wrong, tmp_path / "a.vtu"), "fields = ")


def test_points(answers: dict[str, Any]) -> None:
    for wrong in (0.5, "a", None, True, 1j, [0], np.nan):
        for kind in ("samples", "sweep"):
            refused(lambda kind=kind, wrong=wrong: answers[kind].point(wrong), f"index = {wrong!r}")
    refused(lambda: answers["sweep"].point(2), "(2,)")
    refused(lambda: answers["samples"].point(0, 0), "(0, 0)")
    for name in (3, None, "m", ["n"]):
        refused(lambda name=name: answers["sweep"].output(name), repr(name), "'n'")


def test_a_chaos(answers: dict[str, Any], tmp_path: Path) -> None:
    chaos = answers["chaos"]
    for germs in ("abc", [["a"]], [[np.nan]], [[np.inf]], [[1j]], None, [[True]], [[0.0, 1.0]], [[[0.0]]]):
        refused(lambda germs=germs: chaos.at(germs), "germs")
        refused(lambda germs=germs: chaos.sample(germs), "germs")
    for shown, wrong in {**NO_WHOLE_NUMBERS, "0": 0, "-3": -3}.items():
        refused(lambda wrong=wrong: chaos.monte_carlo(wrong), f"samples = {shown}")
        refused(lambda wrong=wrong: chaos.quasi_monte_carlo(wrong), f"samples = {shown}")
        if wrong is not None:
            refused(lambda wrong=wrong: chaos.table(samples=wrong), f"samples = {shown}")
            refused(
                lambda wrong=wrong: chaos.quantity(lambda b: np.zeros(len(b)), samples=wrong),
                f"samples = {shown}",
            )
            refused(lambda wrong=wrong: chaos.save(tmp_path / "a.h5", samples=wrong), f"samples = {shown}")
        if wrong != 0:
            refused(lambda wrong=wrong: chaos.truncation("layer", wrong), f"points = {shown}")
            refused(lambda wrong=wrong: chaos.mode("p0", wrong), "mode")
    for name in NOT_KNOWN:
        for read in (chaos.sobol, chaos.truncation, chaos.force_coefficients, chaos.to_openturns):
            refused(lambda read=read, name=name: read(name), repr(name))
        refused(lambda name=name: chaos.coefficients(name), repr(name))
        refused(lambda name=name: chaos.mode(name, 0), repr(name))
        refused(lambda name=name: chaos.save_chaos(tmp_path / "c.h5", [name]), repr(name))
    for rtol in ("a", np.nan, 0.0, 1.0, -1.0, True, 1j):
        refused(lambda rtol=rtol: chaos.monte_carlo(1, rtol=rtol), "rtol = ")
    for seed in ("a", -1, 1.5, [1]):
        refused(lambda seed=seed: chaos.monte_carlo(1, seed), "seed = ")
        refused(lambda seed=seed: chaos.table(seed=seed), "seed = ")


def test_a_history(answers: dict[str, Any]) -> None:
    for name in NOT_KNOWN:
        for read in (answers["history"].work, answers["history"].dissipation):
            refused(lambda read=read, name=name: read(name), repr(name))
