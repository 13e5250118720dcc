"""Derivative-based screening, against total Sobol indices."""

from __future__ import annotations

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import SceneError, screen
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
