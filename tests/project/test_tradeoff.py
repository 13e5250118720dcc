"""A sample of the trade of speed for accuracy: errors fall with the knobs; fronts, tables and the page."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from parts.front import FrontPanel, _draw_front, front_figure, pareto_front

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def bench() -> Iterator[ModuleType]:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import tradeoff

    yield tradeoff
    sys.path.pop(0)


def measured(bench: ModuleType, name: str, settings: list[Any], in_all: bool = False) -> dict[str, Any]:
    fine, coarser = bench.Mesh("coarse", 3), bench.Mesh("coarse")
    scene = replace(bench.scenes(quick=True)[name], settings=settings, fine=fine, coarser=coarser)
    record: dict[str, Any] = bench.measure(scene, repeats=1, in_all=in_all, say=lambda line: None)
    assert record["references"]["same"]["status"] == ["converged", "converged"]
    assert all(run["seconds"] > 0.0 and run["units_all"] > run["units"] > 0.0 for run in record["runs"])
    return record


@pytest.fixture(scope="module")
def vessel(bench: ModuleType) -> dict[str, Any]:
    setting, mesh = bench.Setting, bench.Mesh
    return measured(
        bench,
        "vessel",
        [
            *(setting("latin", {"order": p, "rtol": 1e-8}) for p in (1, 2, 3)),
            *(setting("latin", {"order": 3, "rtol": r}) for r in (1e-1, 1e-2, 1e-4)),
            setting("single", {"order": 3, "rtol": 1e-8}),
            *(setting("ssfem", {"order": p, "rtol": 1e-8}) for p in (1, 2, 3)),
            *(setting("ssfem", {"order": 3, "rtol": r}) for r in (1e-1, 1e-2, 1e-4)),
            *(setting("tensor", {"points": n, "rtol": 1e-8}) for n in (2, 3, 4)),
            *(setting("sparse", {"level": n, "rtol": 1e-8}) for n in (1, 2, 3)),
            *(setting("mc", {"samples": n, "rtol": 1e-4}) for n in (16, 2048)),
            *(setting("qmc", {"samples": n, "rtol": 1e-5}) for n in (16, 512)),
            setting("latin", {"order": 2, "rtol": 1e-6}, mesh("coarse", 1)),
        ],
        in_all=True,
    )


def series(record: Mapping[str, Any], method: str, **fixed: Any) -> list[float]:
    """Errors of a method with some knobs fixed, in the order in which they were measured."""
    runs = [r for r in record["runs"] if r["method"] == method and fixed.items() <= r["knobs"].items()]
    assert all(r["status"] == "converged" for r in runs)
    return [r["error"] for r in runs if r["error"] is not None]


def test_references_of_two_methods_agree(vessel: dict[str, Any]) -> None:
    # chaos to 1e-11 and quadrature to 1e-10; the deviation is a fifth of the mean
    assert vessel["references"]["same"]["own_error"] < 1e-9


@pytest.mark.parametrize("method", ["latin", "ssfem"])
def test_errors_fall_with_order_and_tolerance(vessel: dict[str, Any], method: str) -> None:
    by_order = series(vessel, method, rtol=1e-8)
    assert len(by_order) == 3
    # a smooth answer: the chaos converges geometrically, at c.o.v. 0.2 by at least 3 an order
    assert by_order[1] < by_order[0] / 3.0 and by_order[2] < by_order[1] / 3.0
    by_tolerance = [*series(vessel, method, order=3)[-3:], by_order[-1]]
    # one step of a check may be worth several tolerances; at the end the truncation is left
    assert all(b <= 2.0 * a for a, b in zip(by_tolerance, by_tolerance[1:], strict=False))
    assert by_tolerance[-1] < 0.05 * by_tolerance[0]


def test_galerkin_methods_have_one_truncation_error(vessel: dict[str, Any]) -> None:
    own, other = (series(vessel, method, rtol=1e-8) for method in ("latin", "ssfem"))
    # the same Galerkin equations, solved to 1e-8; the estimate may be off by a factor of 3, and the
    # deviation is a fifth of the mean
    assert own == pytest.approx(other, abs=3e-7)


@pytest.mark.parametrize("method", ["tensor", "sparse"])
def test_errors_fall_with_the_rule(vessel: dict[str, Any], method: str) -> None:
    found = series(vessel, method, rtol=1e-8)
    assert len(found) == 3 and found[2] < found[1] < found[0]


def test_errors_of_samples_fall(vessel: dict[str, Any]) -> None:
    few, many = series(vessel, "mc")
    # 128 times the samples: a factor of 11 in the mean; seeds are fixed, four of them are averaged
    assert many < few / 3.0
    few, many = series(vessel, "qmc")
    assert many < few / 5.0


def test_mesh_errors_are_apart(vessel: dict[str, Any]) -> None:
    linear = vessel["runs"][-1]
    assert linear["mesh"] == "coarse, degree 1, points" and linear["error"] is None
    tight = next(r for r in vessel["runs"] if r["knobs"] == {"order": 3, "rtol": 1e-8})
    # elements of degree 1 are too stiff by tens of percent, those of degree 2 by one percent
    assert tight["error"] < 1e-4 < tight["error_all"] < linear["error_all"] / 5.0


def test_what_accuracy_chooses(bench: ModuleType) -> None:
    scene = replace(bench.scenes(quick=True)["vessel"], settings=[])
    record = bench.measure(scene, 1, in_all=False, asked=(1e-2,), say=lambda line: None)
    (chosen,) = record["accuracy"]
    assert chosen["status"] == "converged" and chosen["asked"] == 1e-2
    assert chosen["error"] <= 1e-2 and chosen["error_all"] is None


def test_float32_iteration_reaches_what_double_does(vessel: dict[str, Any]) -> None:
    single = series(vessel, "single", rtol=1e-8)
    # the same Galerkin equations to 1e-8: corrected in double precision
    assert single == pytest.approx(series(vessel, "latin", rtol=1e-8)[-1:], abs=3e-7)


def test_contact_and_field(bench: ModuleType) -> None:
    setting = bench.Setting
    runs = [setting("tensor", {"points": 3, "rtol": r}) for r in (1e-1, 1e-4)]
    scene = bench.scenes(quick=True)["lap"]
    small = replace(scene, exact=setting("tensor", {"points": 4, "rtol": 1e-7}), check=runs[-1])
    found = bench.measure(replace(small, settings=runs), 1, in_all=False, say=lambda line: None)
    loose, tight = series(found, "tensor")
    assert tight < loose / 10.0
    orders = [setting("latin", {"order": p, "rtol": 1e-7}) for p in (1, 2)]
    first, second = series(measured(bench, "field", orders), "latin")
    assert second < first / 10.0


def run_of(cost: float, error: float, rtol: float = 1e-2, order: int = 1, **changes: Any) -> dict[str, Any]:
    knobs = {"order": order, "rtol": rtol}
    return {
        "method": "latin",
        "knobs": knobs,
        "label": f"order {order}, rtol {rtol:g}",
        "mesh": "coarse",
        "status": "converged",
        "iterations": 3,
        "seconds": cost,
        "units": cost,
        "units_all": cost + 1.0,
        "error": error,
        "error_all": error + 1e-3,
        **changes,
    }


def record_of(runs: list[dict[str, Any]]) -> dict[str, Any]:
    reference = {"mean": -1.0, "std": 0.1, "own_error": 1e-5, "how": "one", "compared": "other"}
    return {
        "title": "a scene",
        "quantity": "force",
        "base": "coarse",
        "unit_s": 1.0,
        "meshes": [{"name": "coarse", "dof": 10, "assembly_s": 1.0}],
        "references": {"same": reference, "all": reference},
        "runs": runs,
        "accuracy": [
            {**run_of(2.5, 5e-3), "asked": 1e-2, "meshes": False},
            {**run_of(2.5, 5e-3), "asked": 1e-2, "meshes": True, "dominating": "discretisation"},
        ],
    }


def test_luck_does_not_count(bench: ModuleType) -> None:
    lucky, tight = run_of(1.0, 1e-6, rtol=1e-1), run_of(2.0, 1e-3, rtol=1e-3)
    record = record_of([lucky, tight, run_of(1.5, 1e-3, rtol=1e-2, status="max_iterations")])
    bench.mark_luck(record)
    assert [r["lucky"] for r in record["runs"]] == [True, False, False]
    assert bench.usable(record, in_all=False) == [tight]
    # another order is tighter, too; another method is not
    looser, other = run_of(1.0, 1e-6, order=1), run_of(1.0, 1.0, order=2)
    assert bench.tighter(looser, other) and not bench.tighter(other, looser)
    assert not bench.tighter(looser, {**other, "method": "ssfem"})
    assert not bench.tighter(looser, {**other, "knobs": {**other["knobs"], "operator": "factored"}})


def test_the_cheapest_is_the_best_of_those_that_cost_as_much(bench: ModuleType) -> None:
    runs = [run_of(1.0, 9e-3), run_of(1.05, 1e-4), run_of(3.0, 1e-6), run_of(0.5, 0.5)]
    assert bench.cheapest(runs, 1e-2) is runs[1]
    assert bench.cheapest(runs, 1e-5) is runs[2]
    assert bench.cheapest(runs, 1e-9) is None
    assert bench.cheapest(runs, 1e-2, methods=("ssfem",)) is None


def test_front() -> None:
    cost, error = [3.0, 1.0, 2.0, 2.0, 4.0], [1e-3, 1e-1, 1e-2, 2e-2, 1e-2]
    assert pareto_front(cost, error).tolist() == [1, 2, 0]
    assert pareto_front([], []).size == 0


def test_page_and_figure(bench: ModuleType, tmp_path: Path) -> None:
    runs = [run_of(1.0, 5e-2, rtol=1e-1), run_of(2.0, 1e-4, rtol=1e-3), run_of(3.0, 1e-6, rtol=1e-6)]
    scene = record_of(runs)
    bench.mark_luck(scene)
    environment = {"processor": "some", "threads": "1", "load": 0.0}
    record = {"quick": True, "environment": environment, "scenes": {"a": scene}}
    page = tmp_path / "accuracy.md"
    page.write_text("# Accuracy\n\nBefore.\n", encoding="utf-8")
    bench.write_page(record, page)
    once = page.read_text(encoding="utf-8")
    assert once.startswith("# Accuracy\n\nBefore.\n\n## Reading the front\n")
    assert "| 1 % | order 1, rtol 0.001 | 1e-04 | 2.00 | 2.000 |" in once
    assert "| 1 % | 2.00 | - | - | - | 2.50 | 5e-03 | 1.2 |" in once
    assert "6.0e-03 for 3.5, discretisation decides |" in once
    page.write_text(once + "\nAfter.\n", encoding="utf-8")
    bench.write_page(record, page)
    assert page.read_text(encoding="utf-8") == once + "\nAfter.\n"
    drawn = sorted((tmp_path / "figures").iterdir())
    assert drawn and all(path.stat().st_size > 5000 for path in drawn)


def test_empty_panel_is_drawn(tmp_path: Path) -> None:
    panel = FrontPanel("none", "cost (units)", "error", {"a": np.empty((0, 2))})
    assert front_figure([[panel]], tmp_path / "none.png").exists()


def test_what_was_chosen_is_in_the_picture() -> None:
    grid = {"a": np.array([[1.0, 1.0], [2.0, 0.1]])}
    panel = FrontPanel("far", "cost (units)", "error", grid, marked=np.array([[50.0, 0.01]]))
    axis = Figure().subplots()
    _draw_front(axis, panel, {"a": {"marker": "o", "color": "black"}}, "chosen", {})
    low, high = axis.get_xlim()
    assert low <= 1.0 and high >= 50.0
