"""Distributions, fields, chaos requests and quantities refuse what is no number with its name and value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.uncertainty.quantities import sobol_of
from dolfinx_frontend.uncertainty.space import RandomSpace
from tests.helpers import NO_NAMES, NO_NUMBERS, NO_WHOLE_NUMBERS, NOT_FINITE, refused

pytestmark = pytest.mark.sanitize

WRONG = {k: v for k, v in {**NO_NUMBERS, **NOT_FINITE}.items() if k not in ("None", "[1.0]")}
GIVEN: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Normal": (lf.Normal, {"mean": 1.0, "cov": 0.1}),
    "Normal std": (lf.Normal, {"mean": 1.0, "std": 0.1}),
    "LogNormal": (lf.LogNormal, {"mean": 1.0, "cov": 0.1}),
    "Gamma": (lf.Gamma, {"mean": 1.0, "std": 0.1}),
    "TruncatedNormal": (lf.TruncatedNormal, {"mean": 1.0, "cov": 0.1, "lower": 0.8, "upper": 1.3}),
    "TruncatedNormal within": (lf.TruncatedNormal, {"mean": 1.0, "cov": 0.1, "within": 2.0}),
    "Uniform": (lf.Uniform, {"lower": 0.0, "upper": 1.0}),
    "Uniform mean": (lf.Uniform, {"mean": 1.0, "cov": 0.1}),
    "Beta": (lf.Beta, {"a": 2.0, "b": 2.0, "lower": 0.0, "upper": 1.0}),
    "RandomField": (lf.RandomField, {"mean": 1.0, "cov": 0.1, "length": 1.0, "variance_captured": 0.9}),
    "RandomField matern": (
        lf.RandomField,
        {"mean": 1.0, "std": 0.1, "length": 1.0, "covariance": "matern", "nu": 1.5, "modes": 2},
    ),
}


@pytest.mark.parametrize("kind, name", [(kind, name) for kind, (_, given) in GIVEN.items() for name in given])
def test_numbers(kind: str, name: str) -> None:
    make, given = GIVEN[kind]
    assert make("k", **given).name == "k"
    if name == "covariance":
        return
    for shown, wrong in WRONG.items():
        refused(
            lambda wrong=wrong: make("k", **{**given, name: wrong}), kind.split()[0], "'k'",
            f"{name} = {shown}"
        )


@pytest.mark.parametrize("kind", GIVEN)
def test_names(kind: str) -> None:
    make, given = GIVEN[kind]
    for wrong in NO_NAMES.values():
        refused(lambda wrong=wrong: make(wrong, **given), kind.split()[0], f"name = {wrong!r}", "a string")


def test_fields() -> None:
    def field(**changes: Any) -> Any:
        return lf.RandomField("f", 1.0, **{"cov": 0.1, **changes})

    for wrong in (0, 1.5, "a", True):
        refused(lambda wrong=wrong: field(modes=wrong), f"modes = {wrong!r}")
    for wrong in (3, None, ["gaussian"], "round"):
        refused(lambda wrong=wrong: field(covariance=wrong), repr(wrong))
        refused(lambda wrong=wrong: field(distribution=wrong), repr(wrong))
    for wrong in ((1.0, "a"), (1.0, None), (0.0, 1.0), (1.0, True)):
        refused(lambda wrong=wrong: field(length=wrong), "length = ")
    for points in ("ab", [["a"]], [[np.nan]], None, 1.0):
        refused(lambda points=points: field().on(points, [1.0]), "'f'", "points")
    for weights in ("a", ["a"], [np.nan], None, [0.0], [1.0, 1.0]):
        refused(lambda weights=weights: field().on([[0.0]], weights), "'f'", "weights")


def test_samples_and_distributions() -> None:
    for wrong in (
        "abc", ["a", "b"], [1.0, None], [1.0, np.nan], 1.0, [], [[1.0, 2.0]], [1j, 2.0], [True, False],
    ):
        refused(lambda wrong=wrong: lf.FromSamples("k", wrong), "'k'", "samples = ")
    for wrong in (3, None, "normal", len):
        refused(lambda wrong=wrong: lf.FromDistribution("k", wrong), "'k'", "unknown distribution")
    for wrong in (3, None, ["own"], "other"):
        refused(lambda wrong=wrong: lf.FromDistribution("k", None, wrong), "germ", repr(wrong))


def test_correlations() -> None:
    a, b = lf.Normal("a", 1.0, cov=0.1), lf.Normal("b", 1.0, cov=0.1)
    for wrong in (3, None, "ab", a):
        refused(lambda wrong=wrong: lf.Correlated(wrong, [[1.0]]), "parameters = ")
    refused(lambda: lf.Correlated([a, 3], np.eye(2)), "3")  # type: ignore[list-item]
    for matrix in (
        "ab", [["a", 0.0], [0.0, 1.0]], [[1.0, np.nan], [np.nan, 1.0]], None, [[1.0, 1j], [1j, 1.0]],
    ):
        refused(lambda matrix=matrix: lf.Correlated([a, b], matrix), "matrix = ")
    for space in (3, None, ["normal"], "other"):
        refused(lambda space=space: lf.Correlated([a, b], np.eye(2), space), repr(space))


CHAOS: dict[str, Any] = {
    "order": {**NO_WHOLE_NUMBERS, "-1": -1},
    "q": {**{k: v for k, v in NO_NUMBERS.items() if k != "[1.0]"}, **NOT_FINITE, "0": 0, "1.5": 1.5},
    "tolerance": {**{k: v for k, v in NO_NUMBERS.items() if k != "[1.0]"}, **NOT_FINITE, "0": 0},
    "max_interaction": {k: v for k, v in {**NO_WHOLE_NUMBERS, "0": 0}.items() if v is not None},
    "quadrature": {k: v for k, v in {**NO_WHOLE_NUMBERS, "0": 0}.items() if v is not None},
    "sobol_points": {k: v for k, v in {**NO_WHOLE_NUMBERS, "0": 0, "3": 3}.items() if v is not None},
    "check_points": {**NO_WHOLE_NUMBERS, "1": 1, "-3": -3},
}


@pytest.mark.parametrize("name", CHAOS)
def test_requests(name: str) -> None:
    for shown, wrong in CHAOS[name].items():
        refused(lambda wrong=wrong: lf.Chaos(**{"order": 1, name: wrong}), "Chaos", f"{name} = {shown}")


def test_sets_of_requests() -> None:
    for wrong in (3, None, ["total"], "round"):
        refused(lambda wrong=wrong: lf.Chaos(1, index_set=wrong), repr(wrong), "'total'")
    for wrong in (3, "a", [1.0, "a"], [np.nan], [0.0], {"k": None}, {"k": True}):
        refused(lambda wrong=wrong: lf.Chaos(1, weights=wrong), "weights = ")
    for wrong in (3, "ab", [], [[1.5]], [["a"]], [[-1]], [[0], [0, 1]], [[True]]):
        refused(lambda wrong=wrong: lf.Chaos(1, indices=wrong), "indices = ")


def test_points_of_a_space() -> None:
    space = RandomSpace([lf.Normal("a", 1.0, cov=0.1)])
    for wrong in ("a", [1.0, None], None, 1j, True, [np.nan]):
        refused(lambda wrong=wrong: space.germ_points({"a": wrong}), "'a'", "value = ")
    for name in (3, None, "b"):
        refused(lambda name=name: space.germ_points({name: 1.0}), repr(name))
    for wrong in ("a", [["a"]], [[np.nan]], None, [[0.0, 0.0]]):
        refused(lambda wrong=wrong: space.values(lf.Normal("a", 1.0, cov=0.1), wrong), "values")


def quantity(**changes: Any) -> lf.Quantity:
    """Of four samples."""
    return lf.Quantity(**{"name": "q", "values": np.array([1.0, 2.0, 4.0, 7.0]), **changes})


def test_quantities() -> None:
    for wrong in ("abc", [1.0, "a"], None, 1.0, [], [1j], [True], [np.nan]):
        refused(lambda wrong=wrong: quantity(values=wrong), "'q'", "values")
    for wrong in ("abcd", ["a"] * 4, 1.0, [0.5, 0.5], [1j] * 4, [np.nan] * 4):
        refused(lambda wrong=wrong: quantity(weights=wrong, kind="quadrature"), "'q'", "weights")
    for wrong in NO_NAMES.values():
        refused(lambda wrong=wrong: quantity(name=wrong), f"name = {wrong!r}")
    refused(lambda: quantity(unit=3), "unit = 3")
    for wrong in (3, None, ["random"], "sobol"):
        refused(lambda wrong=wrong: quantity(kind=wrong), "kind", repr(wrong))


def test_questions() -> None:
    q = quantity()
    for shown, wrong in {**NO_NUMBERS, "nan": np.nan}.items():
        if wrong is not None:
            shown = "[1]" if shown == "[1.0]" else shown
            refused(lambda wrong=wrong: q.probability(above=wrong), f"above = {shown}")
            refused(lambda wrong=wrong: q.probability(below=wrong), f"below = {shown}")
    for wrong in (*NO_NUMBERS.values(), *NOT_FINITE.values(), 0.0, 1.0, 95):
        refused(lambda wrong=wrong: q.quantile(wrong), "q = ")
        for ask in (q.mean, q.std, q.variance, q.skewness):
            refused(lambda ask=ask, wrong=wrong: ask(wrong), "level = ")
        refused(lambda wrong=wrong: q.quantile(0.5, wrong), "level = ")
        refused(lambda wrong=wrong: q.probability(above=1.0, level=wrong), "level = ")
    for wrong in (3, None, ["wilson"]):
        refused(lambda wrong=wrong: q.probability(above=1.0, method=wrong), "method", repr(wrong))
    for wrong in ("a", ["a"], [np.nan], 1j, [None]):
        refused(lambda wrong=wrong: q.density(wrong), "x = ")
    for wrong in ("auto", 0, -1, 2.5, True, [1.0], [2.0, 1.0], ["a", "b"], [np.nan, 1.0]):
        refused(lambda wrong=wrong: q.histogram(wrong), "bins = ")
    assert q.probability(above=-np.inf, below=3.0).value == 0.5


def test_sobol_indices() -> None:
    space = RandomSpace([lf.Normal("a", 1.0, cov=0.1), lf.Normal("b", 1.0, cov=0.1)])

    def total(x: Any) -> Any:
        return x.sum(axis=1)

    for wrong in (0, 1, -4, 2.0, "a", None, True):
        refused(
            lambda wrong=wrong: sobol_of(total, space, wrong), f"n = {wrong!r}" if wrong != 2.0 else "n = 2"
        )
    for wrong in ("a", -1, 1.5):
        refused(lambda wrong=wrong: sobol_of(total, space, 4, wrong), "seed = ")
    for wrong in (0, "a", 1.5):
        refused(lambda wrong=wrong: sobol_of(total, space, 4, resamples=wrong), "resamples = ")
    refused(lambda: sobol_of(3, space, 4), "function = 3")  # type: ignore[arg-type]
    for returned in ("abcd", None, [1j] * 4, 1.0):
        refused(lambda returned=returned: sobol_of(lambda x: returned, space, 4), "sobol_of", "function")


@pytest.mark.parametrize("wrong", [np.array(["gaussian", "a"]), np.array("gaussian"), None, 3, ["matern"]])
def test_covariances(wrong: Any) -> None:
    given: dict[str, Any] = {"mean": 1.0, "cov": 0.1, "length": 1.0, "modes": 2}
    refused(lambda: lf.RandomField("k", **given, covariance=wrong), "unknown covariance", "'gaussian'")
