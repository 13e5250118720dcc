"""Sobol indices from samples that are there: a polynomial of the germs, and what it does not explain.

With g the polynomial of least squares and e = f - g, the projections P of f on functions of some of the germs
obey | |P f| - |P g| | <= |e|: what is not explained bounds how far any index of f may be from that of g. Its
share of the variance is measured by leaving samples out one by one; the scatter of the coefficients by
leaving groups out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["Shares", "shares_of_samples"]

GROUPS = 20
"""Groups of samples that are left out one after the other."""
MOST = 200
"""Modes of the polynomial at most."""
PER_MODE = 2.0
"""Samples for every mode at least."""
PATIENCE = 2
"""Degrees after the best one that are tried."""


@dataclass(frozen=True)
class Shares:
    """Indices by source.

    Attributes
    ----------
    values, low, high
        (2, sources): first, total; NaN, 0 and 1 where there are too few samples to know.
    unexplained
        Share of the variance that the polynomial leaves.
    """

    values: Array
    low: Array
    high: Array
    unexplained: float


def shares_of_samples(space: RandomSpace, germs: Array, samples: Array, level: float) -> Shares:
    """Shares of the variance of a quantity by source.

    Parameters
    ----------
    space
        The germs; correlated ones count together.
    germs, samples
        Independent points (N, L), and the quantity there (N,).
    level
        Of the intervals.
    """
    values = (samples - samples.mean()) / samples.std()
    unexplained = 1.0
    best: Array = np.zeros((len(values), 0))
    table: Array = np.zeros((0, space.dimension))
    degree, best_degree, known = 0, 0, 0
    while degree < best_degree + PATIENCE or degree == 0:
        degree += 1
        if _modes(space, degree) > min(MOST, len(values) / PER_MODE):
            break
        basis = space.basis(Chaos(order=degree), memory_limit=0.0)
        if len(basis) == known:  # distributions of few values have no more
            break
        known = len(basis)
        psi = np.asarray(basis.evaluate(germs))
        q, r = np.linalg.qr(psi)
        if np.linalg.cond(r) > 1.0 / np.sqrt(np.finfo(float).eps):
            break
        left = (values - q @ (q.T @ values)) / np.maximum(1.0 - np.einsum("np,np->n", q, q), 1e-12)
        share = float(np.mean(left**2))
        if share < unexplained:
            best, unexplained, table = psi, share, np.asarray(basis.indices.table, dtype=np.float64)
            best_degree = degree
    if not len(table):
        nothing = np.zeros((2, len(space.groups)))
        return Shares(nothing * np.nan, nothing, nothing + 1.0, 1.0)
    return _intervals(space, table, best, values, min(unexplained, 1.0), level)


def _modes(space: RandomSpace, degree: int) -> int:
    """Modes of a total degree at most."""
    return math.comb(space.dimension + degree, degree)


def _intervals(
    space: RandomSpace, table: Array, psi: Array, values: Array, unexplained: float, level: float
) -> Shares:
    varies = table.any(axis=1)
    inside = np.array([table[:, list(columns)].any(axis=1) for columns in space.groups.values()])
    outside = np.array(
        [np.delete(table, list(columns), axis=1).any(axis=1) for columns in space.groups.values()]
    )

    def shares(matrix: Array, right: Array) -> Array:
        squares = np.where(varies, np.linalg.solve(matrix, right) ** 2, 0.0)
        both = np.array([(inside & ~outside) @ squares, inside @ squares])
        return np.asarray(both / (squares.sum() + unexplained))

    matrix, right = psi.T @ psi, psi.T @ values
    found = shares(matrix, right)
    drawn = np.array(
        [
            shares(matrix - own.T @ own, right - own.T @ values[k::GROUPS])
            for k in range(GROUPS)
            for own in [psi[k::GROUPS]]
        ]
    )
    scatter = np.sqrt((GROUPS - 1.0) / GROUPS * ((drawn - drawn.mean(axis=0)) ** 2).sum(axis=0))
    half = stats.t.isf(0.5 * (1.0 - level), GROUPS - 1) * scatter
    aside = np.sqrt(unexplained / (1.0 + unexplained))
    low = np.maximum(np.sqrt(np.maximum(found - half, 0.0)) - aside, 0.0) ** 2
    high = np.minimum(np.sqrt(np.minimum(found + half, 1.0)) + aside, 1.0) ** 2
    return Shares(np.clip(found * (1.0 + unexplained), low, high), low, high, unexplained)
