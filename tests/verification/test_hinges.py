"""Kinks in several germs: hinged polynomials against functions that are known, and answers beside them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from dolfinx_frontend import (
    Contact,
    Elastic,
    Gamma,
    LinearElastic,
    LogNormal,
    Normal,
    Problem,
    Quantile,
    RandomLaws,
    SampleResult,
    Scene,
    Uniform,
    assemble,
    geometry,
    solve,
)
from dolfinx_frontend.moments.hinges import hinged
from dolfinx_frontend.moments.points import calibrated, wide_points

SETS = 8
LONG, HIGH, MOVE = 10.0, 4.0, 0.01


def stop(*stiffnesses, gap, young=1e5) -> Problem:
    """Bars with layers between them, moved by MOVE towards a rigid stop behind a gap."""
    scene = Scene()
    for n in range(len(stiffnesses) + 1):
        box = geometry.box((LONG, HIGH), (2, 2), origin=(LONG * n, 0.0))
        scene.substructure(f"b{n}", box, LinearElastic(E=young, nu=0.0), degree=1)
    for n, k in enumerate(stiffnesses):
        scene.interface(f"l{n}", f"b{n}:x1", f"b{n + 1}:x0", Elastic(normal=k, tangential=30.0))
    end = f"b{len(stiffnesses)}:x1"
    scene.fix("b0:x0", (MOVE, 0.0), name="grip")
    scene.interface("stop", end, Contact(gap=gap))
    scene.fix(end, components=1)
    return assemble(scene)


def drawn(count: int, dimension: int):
    """Sets of points of normal germs, their weights and numbers."""
    laws = [LogNormal(f"k{n}", 40.0, cov=0.3) for n in range(dimension - 1)]
    space = RandomLaws.of(stop(*laws, gap=Normal("gap", MOVE, std=0.001))).space
    assert space.dimension == dimension
    sets = [wide_points(space, count // SETS, seed) for seed in range(SETS)]
    points = np.concatenate([p for p, _ in sets])
    weights = np.concatenate([w / w.sum() for _, w in sets]) / SETS
    return space, points, weights, np.repeat(np.arange(SETS), count // SETS)


@pytest.mark.parametrize("kinks", [0, 1, 2])
def test_hinged_polynomials_are_found(kinks):
    """A polynomial, its largest value with 0, and the sum of two such with different kinks: to rounding."""
    space, points, weights, labels = drawn(1024, 3)
    a, b, c = points.T
    values = 1.0 + a - 0.5 * b * c
    if kinks:
        values = values + np.maximum(0.7 * a + 0.4 * b + 0.1 * a * c - 0.3, 0.0)
    if kinks == 2:
        values = values - 2.0 * np.maximum(c - 0.5, 0.0)
    found = hinged(space, points, weights, labels, values, [c > 0.5] if kinks == 2 else [])
    assert found is not None and len(found.signs) == kinks
    assert found.rest < 1e-6 * values.std()
    assert np.abs(found(space, points)[:, -1] - values).max() < 1e-5 * values.std()


def test_sets_are_judged_by_fits_that_have_not_seen_them():
    """Noise cannot be predicted: what is left is as large, not smaller."""
    space, points, weights, labels = drawn(256, 3)
    values = np.random.default_rng(0).standard_normal(256)
    found = hinged(space, points, weights, labels, values, [])
    spread = np.sqrt(weights @ (values - weights @ values) ** 2)
    assert found is None or found.rest > 0.9 * spread


def test_controls_are_integrated_exactly():
    """Weights that give a control its expectation, and polynomials of low degree theirs."""
    space, points, weights, _ = drawn(256, 3)
    control = np.maximum(points[:, 0], 0.0)
    expected = np.array([1.0 / np.sqrt(2.0 * np.pi)])
    share = calibrated(space, points, weights, (control[:, None], expected), 2)
    assert share @ control == pytest.approx(expected[0], rel=1e-10)
    assert share.sum() == pytest.approx(1.0, rel=1e-10)
    assert np.abs(share @ points).max() < 1e-10
    # twice the same control: one of them is left out
    both = np.column_stack([control, 2.0 * control])
    again = calibrated(space, points, weights, (both, np.append(expected, 2.0 * expected)), 2)
    np.testing.assert_allclose(again, share, atol=1e-12)


def exact(away: float, covs: tuple[float, ...], gap_std: float, young: float) -> tuple[float, float]:
    """Mean and deviation of the force on the stop, by quadrature of every factor; lognormal layers."""
    z, w = np.polynomial.hermite_e.hermegauss(60)
    w = w / w.sum()
    soft = np.array([(len(covs) + 1) * LONG / young])
    weight = np.ones(1)
    for cov in covs:
        s = np.sqrt(np.log1p(cov**2))
        soft = (soft[:, None] + np.exp(-(s * z - 0.5 * s * s)) / 2e4).ravel()
        weight = (weight[:, None] * w).ravel()
    reach = [stats.norm.expect(lambda t, n=n: (t - away) ** n, lb=away, ub=12.0) for n in (1, 2)]
    first, second = HIGH * gap_std * (weight @ (1.0 / soft)), (HIGH * gap_std) ** 2 * (weight @ soft**-2.0)
    mean, square = first * reach[0], second * reach[1]
    return -mean, float(np.sqrt(square - mean**2))


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize(("away", "covs"), [(-1.0, (0.3, 0.2)), (0.5, (0.5, 0.3)), (1.5, (0.3,))])
def test_kinks_in_several_germs(away, covs, accuracy):
    """The gap closes `away` deviations from its mean, behind random layers; 16 384 samples before."""
    gap = Normal("gap", MOVE + away * 1e-3, std=1e-3)
    problem = stop(*(LogNormal(f"k{n}", 2e4, cov=cov) for n, cov in enumerate(covs)), gap=gap)
    result = solve(problem, accuracy=accuracy, quantity="stop", meshes=False)
    mean, std = exact(away, covs, 1e-3, 1e5)
    found = result.mean_std("stop")
    wrong = max(abs(found.mean / mean - 1.0), abs(found.std / std - 1.0))
    assert isinstance(result, SampleResult) and result.errors().reached
    assert wrong <= accuracy
    assert len(result.germs) <= 2048


def test_values_that_grow_far_out_are_not_cut():
    """A heavy tail times a tail: 13 deviations are no bound (what cut there was off by 0.4 %)."""
    gap = Normal("gap", MOVE + 0.35e-3, std=1e-3)
    problem = stop(LogNormal("k0", 2e3, cov=0.55), gap=gap, young=1e7)
    found = solve(problem, accuracy=1e-3, quantity="stop", meshes=False)
    z, w = np.polynomial.hermite_e.hermegauss(80)
    s = np.sqrt(np.log1p(0.55**2))
    one = 1.0 / (2.0 * LONG / 1e7 + np.exp(-(s * z - 0.5 * s * s)) / 2e3)
    w = w / w.sum()
    reach = [stats.norm.expect(lambda t, n=n: (t - 0.35) ** n, lb=0.35, ub=12.0) for n in (1, 2)]
    mean = HIGH * 1e-3 * (w @ one) * reach[0]
    std = np.sqrt((HIGH * 1e-3) ** 2 * (w @ one**2) * reach[1] - mean**2)
    made = found.mean_std("stop")
    assert found.errors().reached
    assert max(abs(made.mean / -mean - 1.0), abs(made.std / std - 1.0)) <= 1e-3


def test_quantile_behind_a_kink():
    """Of the force on the stop, Gamma and uniform laws besides: against samples of the closed form."""
    gap, k = Uniform("gap", 0.007, 0.012), Gamma("k0", 2e4, cov=0.3)
    problem = stop(k, gap=gap)
    wanted = Quantile("stop", 0.2)
    result = solve(problem, accuracy=2e-2, quantity=wanted, meshes=False)
    u = stats.qmc.Sobol(2, seed=0).random_base2(17)
    stiff = stats.gamma(0.3**-2, scale=2e4 * 0.09).ppf(u[:, 0])
    force = -HIGH * np.clip(MOVE - (0.007 + 0.005 * u[:, 1]), 0.0, None) / (1.0 / stiff + 2.0 * LONG / 1e5)
    assert result.errors().reached
    assert result.mean_std(wanted).mean == pytest.approx(np.quantile(force, 0.2), rel=2e-2)
