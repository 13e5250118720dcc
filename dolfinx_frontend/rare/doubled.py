"""Samples of which few are solved: a polynomial says at most of them whether an event happens.

Polynomials in the normal scores (a chaos, fitted to solved points) say where the limit of each condition is.
Many samples u_i with weights w_i are drawn, and each is *solved* with a probability p_i, large where the
polynomial may be wrong. With I the event and J what the polynomial says,

    P = mean of w_i (J_i + (I_i - J_i) b_i / p_i),        b_i = 1 if solved, else 0,

is unbiased for any polynomial: it decides how many solves are needed, never what the answer is. Two-phase
sampling, D. Horvitz, D. Thompson, J. Am. Stat. Assoc. 47 (1952) 663; p_i ~ w_i sqrt(chance that J_i is wrong)
leaves the least variance (J. Neyman, J. Am. Stat. Assoc. 33 (1938) 101).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import linalg, special
from dolfinx_frontend.rare.densities import Mixture
from dolfinx_frontend.rare.design import DesignPoint

__all__ = ["Predictor", "Round", "sampled_round"]

LOCAL = 3.0
"""Tangential distance of the points to which a limit is fitted, deviations, of up to 4 variables."""
DEEP = 2.5
"""The same along its normal."""
OF_G = 4
"""Terms in the condition itself."""
EACH = 3
"""Points for each coefficient of a polynomial at least."""
BELIEVED = 0.5
"""Error of the place of a limit, times the reliability index: deviations over which a tail falls by e."""
WRONG = 0.15
"""Share of the probability that may be on the wrong side."""
SMALLEST = 1e-3
"""Error of a limit at least, deviations."""
CAREFUL = 1.5
"""Errors of a polynomial are taken as so many times what its points say."""
FLOOR = 40
"""Solves of a round that look everywhere, whatever the polynomials say."""
POOL = 20_000
"""Samples of a round."""


@dataclass(frozen=True, eq=False)
class Limits:
    """Where one condition begins to hold near a design point: a coordinate as a polynomial in the others."""

    alpha: Array  # (L,) into the event
    frame: Array  # (L - 1, L) normal to it
    squares: int  # 0: none, 1: those of each coordinate, 2: products as well
    found: Array  # coefficients
    inverse: Array  # of the normal equations
    error: float  # deviations, each point left out of its own fit

    @classmethod
    def fitted(cls, alpha: Array, beta: float, u: Array, g: Array) -> Limits | None:
        """To a condition (N,) at points (N, L); None: there are too few points.

        The condition itself is a regressor, with a slope of its own on either side: kinks at the limit do no
        harm, and points on both sides tell where it is.
        """
        dimension = len(alpha)
        basis, _ = np.linalg.qr(np.column_stack([alpha, np.eye(dimension)]))
        frame = basis[:, 1:dimension].T
        along, t = u @ alpha, u @ frame.T
        reach = LOCAL * max(1.0, math.sqrt(dimension / 4.0))
        local = (np.linalg.norm(t, axis=1) < reach) & (np.abs(along - beta) < DEEP) & np.isfinite(g)
        along, t, g = along[local], t[local], g[local]
        terms = [1 + len(frame) + OF_G + more for more in (0, len(frame), len(frame) * (len(frame) + 1) // 2)]
        squares = max((k for k in range(3) if EACH * terms[k] <= len(g)), default=-1)
        if squares < 0:
            return None
        g = np.asarray(g / max(float(np.median(np.abs(g))), 1e-300), dtype=np.float64)
        above, below = np.maximum(g, 0.0), np.minimum(g, 0.0)
        table = np.column_stack([_terms(t, squares), above, below, above * above, below * below])
        best: tuple[float, Array, Array] | None = None
        for near in (1.0, 0.5, 0.25):  # the nearer to the limit, the straighter, and the fewer points
            root = np.exp(-0.125 * np.minimum((g / near) ** 2, 50.0))[:, None]
            if best is not None and float((root**2).sum()) < EACH * table.shape[1]:
                break
            inverse = linalg.pinvh((root * table).T @ (root * table))
            found = inverse @ ((root * table).T @ (root[:, 0] * along))
            lever = np.einsum("ij,jk,ik->i", root * table, inverse, root * table)
            left_out = (along - table @ found) / (1.0 - np.minimum(lever, 0.99))
            weights = root[:, 0] ** 2
            error = math.sqrt(float(weights @ left_out**2) / float(weights.sum()))
            if best is None or error < best[0]:
                best = error, found, inverse
        assert best is not None
        return cls(alpha, frame, squares, best[1], best[2], max(best[0], SMALLEST))

    def distances(self, u: Array) -> tuple[Array, Array]:
        """How far points (N, L) are beyond the limit, deviations, and the error of that."""
        rows = _terms(u @ self.frame.T, self.squares)
        count = rows.shape[1]
        spread = np.einsum("ij,jk,ik->i", rows, self.inverse[:count, :count], rows)
        return u @ self.alpha - rows @ self.found[:count], self.error * np.sqrt(1.0 + spread)


def _terms(t: Array, squares: int) -> Array:
    """(N, terms) of a polynomial in tangential coordinates (N, L - 1)."""
    columns = [np.ones((len(t), 1)), t]
    if squares == 1:
        columns.append(t * t)
    elif squares == 2:
        rows, others = np.triu_indices(t.shape[1])
        columns.append(t[:, rows] * t[:, others])
    return np.hstack(columns)


@dataclass(frozen=True, eq=False)
class Predictor:
    """Polynomials for all conditions that hold a design point, of all of them."""

    limits: tuple[tuple[Limits, ...], ...]

    @classmethod
    def fitted(cls, points: Sequence[DesignPoint], u: Array, margins: Array) -> Predictor | None:
        """To conditions (N, k) at points (N, L); None: somewhere there are too few points."""
        every = []
        for point in points:
            own = []
            for number, normal in zip(point.active, point.normals, strict=False):
                if not 0.99 < float(np.linalg.norm(normal)) < 1.01:
                    return None
                alpha: Array = -np.asarray(normal)
                made = Limits.fitted(alpha, float(alpha @ point.u), u, margins[:, number])
                if made is None:
                    return None
                own.append(made)
            if not own:
                return None
            every.append(tuple(own))
        return cls(tuple(every))

    def distances(self, u: Array) -> tuple[Array, Array]:
        """How far points (N, L) are inside of the event, deviations, and the error of that."""
        far: Array = np.full(len(u), -np.inf)
        error: Array = np.ones(len(u))
        for own in self.limits:
            each = [limits.distances(u) for limits in own]
            which = np.argmin([d for d, _ in each], axis=0)[None]
            inside = np.take_along_axis(np.array([d for d, _ in each]), which, axis=0)[0]
            spread = np.take_along_axis(np.array([s for _, s in each]), which, axis=0)[0]
            better = inside > far
            far, error = np.where(better, inside, far), np.where(better, spread, error)
        return far, error

    def believed(self, points: Sequence[DesignPoint], hits: Flags, weights: Array, u: Array) -> bool:
        """Whether the limits are known well enough, and few samples (n, L) are on the wrong side.

        Parameters
        ----------
        hits, weights
            (n,) whether the event happens there, and what it counts.
        """
        nearest = max(min(point.beta for point in points), 1.0)
        if max(each.error for own in self.limits for each in own) * nearest > BELIEVED:
            return False
        far, _ = self.distances(u)
        wrong = (far > 0.0) != hits
        # what is not in the event counts as little as what is: its own weight says how empty a place is
        typical = float(np.median(weights[hits]))
        return float(np.minimum(weights, typical)[wrong].sum()) <= WRONG * float(weights[hits].sum())


@dataclass(frozen=True, eq=False)
class Round:
    """An estimate, the variance of it, and the solved samples with the conditions there."""

    value: float
    variance: float
    solved: Array  # (m, L)
    margins: Array  # (m, k)
    hits: int


def sampled_round(
    predictor: Predictor,
    density: Mixture,
    ask: Callable[[Array], tuple[Array, Flags]],
    rng: np.random.Generator,
    solves: int,
    otherwise: float,
) -> Round | None:
    """One estimate; None: the errors of the polynomials let expect one that is worse than without them.

    That is known before anything is solved, so that it is no choice by the answer.

    Parameters
    ----------
    ask
        Points (m, L) -> conditions (m, k), and whether the event happens (m,).
    solves
        About how many.
    otherwise
        Coefficient of variation of that many solves with which rounds like this need as many solves in all as
        samples without polynomials.
    """
    u = density.draw(rng, POOL)
    weights = np.exp(-density.ratio(u))
    far, error = predictor.distances(u)
    said = far > 0.0
    wrong = np.asarray(special.ndtr(-np.abs(far) / (CAREFUL * error)))
    wanted = weights * np.sqrt(wrong)
    share = FLOOR / POOL
    chance = np.full(POOL, share)
    for _ in range(8):  # those that are solved for certain leave more for the others
        free = chance < 1.0
        rest = max(solves - FLOOR - float((~free).sum()), 1.0)
        chance = np.minimum(share + rest * wanted / max(float(wanted[free].sum()), 1e-300), 1.0)
    # what is to be expected of the errors of the polynomials, also where none of them will be seen
    expected = float(np.sum(weights**2 * wrong * (1.0 - chance) / chance)) / POOL**2
    expected += float((weights * said).var()) / POOL
    if math.sqrt(expected) > otherwise * float((weights * said).mean()):
        return None
    chosen = rng.random(POOL) < chance
    margins, happens = ask(u[chosen])
    parts = weights * said
    parts[chosen] += weights[chosen] * (happens.astype(float) - said[chosen]) / chance[chosen]
    value = float(parts.mean())
    seen = float(parts.var(ddof=1)) / POOL
    return Round(value, max(seen, expected), u[chosen], margins, int(happens.sum()))
