"""Sums and products of skewed functions of one germ each, against closed forms; what stands for them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats
from tests.verification.test_promise import FORCE, LENGTH, inverse_gamma, inverse_lognormal, layers, off
from tests.verification.test_tails import inverse_weibull

from dolfinx_frontend import (
    Chaos,
    FromDistribution,
    FromSamples,
    Gamma,
    LogNormal,
    Measure,
    Normal,
    Resultant,
    solve,
)
from dolfinx_frontend.evaluate.model import QuantityModel
from dolfinx_frontend.moments.lines import lines_of
from dolfinx_frontend.moments.points import calibrated, wide_points
from dolfinx_frontend.moments.tails import _steep

END = Resultant("load", "jump")
OBSERVED = np.exp(1.5 * special.ndtri((np.arange(40) + 0.5) / 40.0))


def of_observed() -> tuple[float, float]:
    """Mean and variance of the inverse of observed values."""
    return float(np.mean(1.0 / OBSERVED)), float(np.var(1.0 / OBSERVED))


LAWS = {
    "lognormal, gamma, Weibull": [
        (LogNormal("a", 40.0, cov=1.1), 40.0, inverse_lognormal(1.1)),
        (Gamma("b", 60.0, cov=0.6), 60.0, inverse_gamma(0.6)),
        (FromDistribution("c", stats.weibull_min(2.3, scale=50.0)), 50.0, inverse_weibull(2.3)),
        (Gamma("d", 90.0, cov=0.5), 90.0, inverse_gamma(0.5)),
    ],
    "observed values, gamma": [
        (FromSamples("a", 40.0 * OBSERVED), 40.0, of_observed()),
        (Gamma("b", 60.0, cov=0.55), 60.0, inverse_gamma(0.55)),
        (LogNormal("c", 60.0, cov=0.7), 60.0, inverse_lognormal(0.7)),
        (FromSamples("d", 70.0 * OBSERVED), 70.0, of_observed()),
    ],
}


@pytest.mark.parametrize(("name", "accuracy"), zip(LAWS, [1e-1, 1e-3], strict=True))
def test_skewed_layers_in_series(name, accuracy):
    """Off by 11 % where 4.5 % was said and 10 % asked; at 1 % "not reached" after 16 384 samples."""
    laws = LAWS[name]
    result = solve(layers(*(law for law, *_ in laws)), accuracy=accuracy, quantity=END, meshes=False)
    mean = 5.0 * LENGTH / 200.0 + sum(first / scale for _, scale, (first, _) in laws)
    std = np.sqrt(sum(variance / scale**2 for _, scale, (_, variance) in laws))
    made = result.errors()
    assert made.reached and off(result.mean_std(END), -FORCE * mean, FORCE * std) <= made.total
    assert len(result.germs) < 1500
    assert "functions of each germ" in made.truncation.how


def test_a_function_that_no_sum_is():
    """The largest of skewed jumps: no function of one germ fits it, and what is said still holds."""
    laws = [LogNormal(f"k{n}", 40.0, cov=0.8) for n in range(4)]

    def largest(fields):
        return np.max([fields.jump(f"l{n}")[..., 0].mean(axis=-1) for n in range(4)], axis=0)

    result = solve(layers(*laws), accuracy=1e-1, quantity=Measure(largest, "largest"), meshes=False)
    # the largest inverse of four: its distribution is the fourth power, the median of k is its mean / root
    sigma = float(np.sqrt(np.log1p(0.8**2)))
    z = np.linspace(-8.0, 8.0 + 2.0 * sigma, 40_001)
    density = 4.0 * special.ndtr(z) ** 3 * stats.norm.pdf(z)
    q = FORCE / 40.0 * np.sqrt(1.0 + 0.8**2) * np.exp(sigma * z)
    first, second = (float(np.trapezoid(density * q**k, z)) for k in (1, 2))
    made = result.errors()
    assert made.reached and off(made.moments, first, np.sqrt(second - first**2)) <= made.total


def test_functions_of_each_germ_are_orthonormal():
    """For the laws of the germs: by Gauss-Hermite points of the normal score, and by the values."""
    laws = [LogNormal("a", 40.0, cov=0.8), FromSamples("b", 40.0 * OBSERVED), Normal("c", 40.0, cov=0.01)]
    first = solve(layers(*laws), chaos=Chaos(order=1, check_points=0), active="all")
    lines = lines_of(QuantityModel.of_chaos(first, END), 1e-3, 1e-8, [])
    assert lines is not None and lines.known == {0, 1, 2}
    z, weights = np.polynomial.hermite_e.hermegauss(80)
    inside = np.abs(z) < 8.0
    for germ in range(3):
        atoms = first.space.atoms(germ)
        scores: np.ndarray = np.zeros((int(inside.sum()), 3))
        scores[:, germ] = z[inside]
        points, share = first.space.from_normal(scores), weights[inside] / weights.sum()
        if atoms is not None:
            points = np.zeros((40, 3))
            points[:, germ], share = atoms
        own = [k for k, f in enumerate(lines.table(3)) if all(n == 0 for j, n in enumerate(f) if j != germ)]
        psi = lines(points, 3)[:, own]
        assert psi.shape[1] >= 4
        # the functions are piecewise polynomials: a rule across their ends is right to their own errors
        np.testing.assert_allclose(psi.T @ (share[:, None] * psi), np.eye(len(own)), atol=2e-3)


def test_weights_beside_those_that_are_right():
    """Points far out keep their weights, and all integrate what they should."""
    space = solve(layers(LogNormal("a", 40.0, cov=0.5)), chaos=Chaos(order=1, check_points=0)).space
    points, weights = wide_points(space, 64, 0)
    points = np.concatenate([points, [[9.0]]])
    drawn = np.concatenate([weights / weights.sum(), [1e-12]])
    controls, wanted = points**3 + np.exp(points), np.array([np.exp(0.5)])
    free = 1.0 / (1.0 + points[:, 0] ** 2) ** 2
    made = calibrated(space, points, drawn, (controls, wanted), 2, free)
    moments = [made @ points[:, 0] ** k for k in range(3)]
    np.testing.assert_allclose(moments, [1.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(made @ controls[:, 0], wanted[0], rtol=1e-9)
    assert abs(made[-1] * drawn.sum() - 1e-12) < 1e-12


@pytest.mark.parametrize(
    ("law", "steep"),
    [
        (Normal("k", 40.0, std=1.0), False),
        (LogNormal("k", 40.0, cov=0.3), False),
        (Gamma("k", 40.0, cov=0.6), True),
        (LogNormal("k", 40.0, cov=3.0), True),
    ],
)
def test_numbers_that_change_like_a_power(law, steep):
    """Far out along a normal load a joint that opens there looked like a tail: "not known" was said of it."""
    first = solve(layers(law), chaos=Chaos(order=1, check_points=0))
    scores = np.array([[-7.0], [-8.0]])
    assert _steep(QuantityModel.of_chaos(first, END), first.space.from_normal(scores), scores[:, 0]) == steep
