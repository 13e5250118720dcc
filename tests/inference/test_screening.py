"""Derivative-based screening, against total Sobol indices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

import dolfinx_frontend as lf
from dolfinx_frontend import SceneError, screen
from dolfinx_frontend.inference.screening import bounds_of_indices
from dolfinx_frontend.uncertainty.space import sobol_points
from tests.inference.joints import D_COV, JOINT, K_COV, D, K, joints, lognormal


def test_bounds_of_total_indices() -> None:
    """The force of a joint that bears is JOINT (Q - K D) / (K + JOINT): indices of 2^14 pairs of samples."""
    load = 2000.0
    found = screen(joints(load), "joint", points=32)
    (bounds,) = found.bounds.values()
    z, other = np.random.default_rng(0).standard_normal((2, 1 << 14, 3))
    laws = [lognormal(K, K_COV), lognormal(D, D_COV), lognormal(load, 0.15)]

    def force(score: np.ndarray) -> np.ndarray:
        k, d, q = (np.exp(m + s * score[:, n]) for n, (m, s) in enumerate(laws))
        return np.asarray(JOINT * (q - k * d) / (k + JOINT))

    values = force(z)
    for number, germ in enumerate(bounds):
        mixed = z.copy()
        mixed[:, number] = other[:, number]
        total = 0.5 * np.mean((values - force(mixed)) ** 2) / values.var()
        assert 0.85 * total < bounds[germ] < 1.2 * total  # it is almost linear: the bound is the index
    assert found.kinks == 0 and found.points == 32 and not found.unimportant()
    assert found.unimportant(0.9) and "total Sobol indices at most" in repr(found)


def test_what_cannot_be_screened() -> None:
    problem = joints(2000.0)
    with pytest.raises(SceneError, match="is the same at all points"):
        screen(problem, lf.Response(lambda block: np.ones(len(block)), "one"), points=8)
    with pytest.raises(SceneError, match="power of two"):
        screen(problem, "joint", points=12)


def test_at_most_is_never_below_the_index() -> None:
    """100 products of lognormal factors and 100 quadratic functions, drawn; total indices in closed form.

    f = exp(s u): T_i = 1 - (e^(S - s_i^2) - 1) / (e^S - 1) with S = |s|^2. f = a u + b u^2: a_i^2 + 2 b_i^2.
    """
    rng = np.random.default_rng(0)
    excess = []
    for drawn in range(100):
        count, points = int(rng.integers(2, 6)), int(rng.choice([8, 16, 32, 64]))
        u = special.ndtri(np.clip(sobol_points(count, points, rng), 1e-12, 1.0 - 1e-12))
        s = rng.uniform(0.05, 0.4, count)
        values = np.exp(u @ s)
        whole = s @ s
        truth = 1.0 - np.expm1(whole - s**2) / np.expm1(whole)
        bounds, limits = bounds_of_indices(u, values, s * values[:, None])
        assert np.all(limits >= truth), drawn
        excess.append(np.max(limits / truth))
        a, b = rng.normal(size=count), 0.3 * rng.normal(size=count)
        truth = (a**2 + 2.0 * b**2) / np.sum(a**2 + 2.0 * b**2)
        _, limits = bounds_of_indices(u, u @ a + u**2 @ b, a + 2.0 * u * b)
        assert np.all(limits >= truth), drawn
    assert np.median(excess) < 1.5
    u = special.ndtri(sobol_points(3, 8, rng))
    bounds, limits = bounds_of_indices(u, u @ [3.0, 4.0, 0.0], np.tile([3.0, 4.0, 0.0], (8, 1)))
    assert np.allclose(bounds, [0.36, 0.64, 0.0]) and np.allclose(limits, bounds)
