"""Samples that a polynomial answers and few solves correct, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend.inference.densities import Mixture
from dolfinx_frontend.inference.design import DesignPoint
from dolfinx_frontend.inference.doubled import Predictor, Round, sampled_round
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


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_a_joint_takes_fewer_solves(seed: int) -> None:
    """To a coefficient of variation of 3 %: 1800 solves without polynomials. Seeds 1 and 5 believe them late:
    rounds with them are weighed against the samples that are missing."""
    found = lf.reliability(joints(LESS_RARE), lf.Response.opening("joint") > 0.0, cov=0.03, seed=seed)
    assert found.probability.low <= exact(LESS_RARE) <= found.probability.high and found.cov <= 0.03
    assert "polynomials say where the limit is" in found.why and found.runs < 1200
