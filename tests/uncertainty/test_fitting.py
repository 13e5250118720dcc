"""Distributions fitted to samples: against SciPy, known distributions, and what is refused."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from scipy import stats

import dolfinx_frontend as lf
from tests.helpers import refused

pytest.importorskip("openturns")


def test_criteria_and_statistics_are_those_of_scipy() -> None:
    values = np.random.default_rng(3).normal(50.0, 7.0, 60)
    fit = lf.fit_distribution("k", values, ["normal"])
    mean, std = values.mean(), values.std(ddof=1)
    likelihood = stats.norm.logpdf(values, mean, std).sum()
    assert fit.best.aic == pytest.approx(4.0 - 2.0 * likelihood)
    assert fit.best.bic == pytest.approx(2.0 * math.log(60) - 2.0 * likelihood)
    tested = stats.goodness_of_fit(
        stats.norm, values, statistic="ad", n_mc_samples=999, rng=np.random.default_rng(1)
    )
    error = 4.0 * math.sqrt(0.25 / 199)
    assert fit.best.anderson_darling == pytest.approx(tested.pvalue, abs=error)
    random = fit.random()
    assert (random.mean, random.std) == (pytest.approx(mean), pytest.approx(std))


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("lognormal", stats.lognorm(0.6, scale=5e4)),
        ("normal", stats.norm(-3.0, 2.0)),
        ("weibull", stats.weibull_min(1.2, scale=2e-6)),
        ("uniform", stats.uniform(1e9, 1e9)),
        ("gumbel", stats.gumbel_r(10.0, 2.0)),
    ],
)
def test_the_distribution_is_found(name: str, law: object) -> None:
    values = law.rvs(400, random_state=5)  # type: ignore[attr-defined]
    fit = lf.fit_distribution("x", values, resamples=39)
    assert fit.best.name == name, fit
    assert fit.best.fits and not fit.notes[1:]
    # moments within four standard errors; the random number has them too
    error = 4.0 * values.std() / math.sqrt(len(values))
    assert abs(fit.best.mean - law.mean()) < error  # type: ignore[attr-defined]
    random = fit.random()
    assert random.mean == pytest.approx(fit.best.mean, rel=1e-6)
    assert random.std == pytest.approx(fit.best.std, rel=1e-6)
    assert np.isclose(float(fit.best.distribution.getMean()[0]), fit.best.mean)


def test_a_wrong_distribution_is_rejected_as_often_as_said() -> None:
    """Normal samples: rejected in about 5 of 100 cases; exponential ones: always."""
    rng = np.random.default_rng(0)
    rejected = [
        not lf.fit_distribution("x", rng.normal(size=30), ["normal"], resamples=99).best.fits
        for _ in range(40)
    ]
    # either of two tests: between 5 and 10 %; 4 standard errors of 40 cases
    assert sum(rejected) <= 40 * (0.10 + 4.0 * math.sqrt(0.1 * 0.9 / 40))
    assert not lf.fit_distribution("x", rng.exponential(size=100), ["normal"]).best.fits


def test_it_is_a_random_number_of_a_scene() -> None:
    values = np.random.default_rng(1).lognormal(math.log(50.0), 0.3, 40)
    stiffness = lf.fit_distribution("k", values).random("lognormal")
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        box = lf.geometry.box((20.0, 10.0, 10.0), (1, 1, 1), origin=(x0, 0, 0), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(E=200e3, nu=0.0), degree=1)
    scene.interface("layer", "left:x1", "right:x0", lf.Elastic(normal=stiffness, tangential=50.0))
    scene.fix("left:x0")
    scene.fix("right:x1", (0.05, 0.0, 0.0), name="grip")
    assert lf.solve(lf.assemble(scene), chaos=2, progress=False).converged


def test_notes_and_messages() -> None:
    fit = lf.fit_distribution("mu", [0.11, 0.13, 0.12, 0.15, 0.10, 0.14])
    assert "6 values are few" in str(fit)
    rounded = lf.fit_distribution("mu", [0.1, 0.2, 0.1, 0.1, 0.2, 0.3] * 6)
    assert any("rounded" in note for note in rounded.notes)
    two = np.concatenate([np.random.default_rng(0).normal(m, 0.1, 50) for m in (1.0, 9.0)])
    assert any("FromSamples" in note for note in lf.fit_distribution("x", two).notes)
    refused(lambda: lf.fit_distribution("x", [1.0, 2.0, 3.0]), "'x'", "3 values", "5 values at least")
    refused(lambda: lf.fit_distribution("x", [[1.0, 2.0], [3.0, 4.0]]), "shape (2, 2)")
    refused(lambda: lf.fit_distribution("x", [1.0, math.nan, 2.0, 3.0, math.nan]), "2 of 5", "number 1")
    refused(lambda: lf.fit_distribution("x", [2.0] * 9), "all 9 samples are 2", "does not scatter")
    refused(lambda: lf.fit_distribution("x", ["a"] * 9), "samples")
    values = [48.0, 51.0, 55.0, 47.0, 50.0]
    refused(lambda: lf.fit_distribution("k", [*values, 49e3, 52e3]), "2 of 7", "about 1000 times", "units")
    refused(lambda: lf.fit_distribution("k", [*values, 0.05]), "1 of 6", "about 1/1000 of")
    refused(lambda: lf.fit_distribution("d", [*values, 2.0]), "1 of 6", "about 1/25.4 of")
    refused(lambda: lf.fit_distribution("k", values, ["lognormale"]), "did you mean 'lognormal'")
    refused(lambda: lf.fit_distribution("k", [-1.0, *values], ["gamma"]), "-1", "'normal'")
    refused(lambda: lf.fit_distribution("k", values, criterion="cic"), "cic", "'bic'")
    refused(lambda: lf.fit_distribution("k", values).random("gauss"), "gauss", "normal")


def test_without_openturns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openturns", None)
    refused(lambda: lf.fit_distribution("k", [1.0, 2.0, 3.0, 4.0, 5.5]), "pip install openturns")
