"""Samples that a polynomial answers and few solves correct, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend.rare.chance import chance
from dolfinx_frontend.rare.densities import Mixture
from dolfinx_frontend.rare.design import DesignPoint
from dolfinx_frontend.rare.doubled import Predictor, Round, sampled_round
from tests.inference.joints import LESS_RARE, exact, joints

Array = npt.NDArray[np.float64]

BETA = 4.0


def along(u: Array) -> Array:
    return np.asarray(u.sum(axis=1) / math.sqrt(u.shape[1]))


def point(dimension: int) -> DesignPoint:
    alpha = np.full(dimension, 1.0 / math.sqrt(dimension))
    return DesignPoint(BETA * alpha, BETA, alpha, (0,), (0,), -alpha[None], True, 1)


def rounds(shift: float, count: int) -> list[Round]:
    """Of a plane at distance 4, by polynomials fitted to one that is elsewhere."""
    rng = np.random.default_rng(3)
    own = point(3)
    density = Mixture.around([own])
    u = density.draw(rng, 100)
    predictor = Predictor.fitted([own], u, (BETA + shift - along(u))[:, None])
    assert predictor is not None

    def ask(u: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        margins = BETA - along(u)
        return margins[:, None], margins < 0.0

    made = [sampled_round(predictor, density, ask, rng, 80, math.inf) for _ in range(count)]
    return [each for each in made if each is not None]


class TwoPlanes:
    """One condition with two design points: u_1 > 3 or u_2 > 3."""

    dimension, cuts, differentiable = 2, ((0,),), True

    def margins(self, u: Array) -> Array:
        return 3.0 - u.max(axis=1, keepdims=True)

    def slopes(self, u: Array) -> Array:
        return -np.eye(2)[None, int(np.argmax(u))]


def test_two_design_points_scatter_as_they_say() -> None:
    """Errors over what is said of them, squared, over 200 seeds: as chi-square with as many degrees of
    freedom.

    Bounds are its quantiles of 0.1 and 99.9 %; 95 % intervals hold as often as a binomial number does.
    """
    limit, truth = TwoPlanes(), 1.0 - stats.norm.cdf(3.0) ** 2
    seeds, given = map(np.random.default_rng, range(200)), {"cov": 0.1, "level": 0.95, "most": 10_000}
    found = [chance(limit, "auto", rng, **given).found for rng in seeds]  # type: ignore[arg-type]
    ratios = np.array([(each.value / truth - 1.0) / each.cov for each in found])
    low, high = stats.chi2.ppf([1e-3, 1.0 - 1e-3], 200) / 200.0
    assert low < np.mean(ratios**2) < high
    held = sum(each.low <= truth <= each.high for each in found)
    assert held >= stats.binom.ppf(1e-3, 200, 0.95)


@pytest.mark.parametrize("shift", [0.0, 0.2, -0.3])
def test_unbiased_whatever_the_polynomial_says(shift: float) -> None:
    """The mean of 60 rounds is the probability, to four of its standard errors, and variances are seen."""
    made = rounds(shift, 60)
    values = np.array([each.value for each in made])
    assert len(made) == 60 and 60 <= np.mean([len(each.solved) for each in made]) <= 100
    error = float(values.std(ddof=1)) / math.sqrt(60.0)
    assert abs(values.mean() - stats.norm.sf(BETA)) < 4.0 * error + 0.003 * stats.norm.sf(BETA)
    # a polynomial that is right leaves the scatter of the pool; one that is not says so
    seen = math.sqrt(float(np.mean([each.variance for each in made])))
    assert float(values.std(ddof=1)) < 1.5 * seen
    assert (seen < 0.02 * stats.norm.sf(BETA)) == (shift == 0.0)


def test_no_round_where_errors_are_too_large() -> None:
    """Known before anything is solved."""
    rng = np.random.default_rng(0)
    own = point(2)
    density = Mixture.around([own])
    u = density.draw(rng, 100)
    margins = BETA - along(u) + rng.normal(0.0, 0.7, len(u))
    predictor = Predictor.fitted([own], u, margins[:, None])
    assert predictor is not None

    def ask(u: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        raise AssertionError("nothing is solved")

    assert sampled_round(predictor, density, ask, rng, 80, 0.05) is None
    weights = np.exp(-density.ratio(u))
    assert not predictor.believed([own], margins < 0.0, weights, u)
    assert Predictor.fitted([own], u[:12], margins[:12, None]) is None


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_a_joint_takes_fewer_solves(seed: int) -> None:
    """To a coefficient of variation of 3 %: 1800 solves without polynomials. Seeds 1 and 5 believe them late:
    rounds with them are weighed against the samples that are missing. With seed 2 rounding of the solves
    decides whether they are believed."""
    found = lf.reliability(joints(LESS_RARE), lf.Response.opening("joint") > 0.0, cov=0.03, seed=seed)
    assert found.probability.low <= exact(LESS_RARE) <= found.probability.high and found.cov <= 0.03
    assert "polynomials say where the limit is" in found.why and found.runs < 1200
