"""Design points: where an event is most probable, in the space of independent standard normal variables.

An event is a union of *cuts*, each the intersection of conditions g_i(u) < 0. The design point of a cut is
its point next to the origin. The distance beta says the probability to first order (FORM): Phi(-beta).

Source: R. Rackwitz, B. Fiessler, Comput. Struct. 9 (1978) 489, as sequential quadratic programming with the
merit function of P.-L. Liu, A. Der Kiureghian, Struct. Saf. 9 (1991) 161.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import optimize, stats

__all__ = [
    "LOST",
    "Cut",
    "DesignPoint",
    "Limit",
    "curvatures",
    "design_point",
    "first_order",
    "second_order",
    "worst",
]

Cut = tuple[int, ...]
"""Numbers of the conditions that happen together."""

MOST_STEPS = 60
CLOSE = 1e-4
"""Distance to the limit, and step, in deviations, at which a design point is found."""
KNOWN = 0.05
"""Distance to a known design point, relative to that from the origin, at which a search leads to it."""
SHORTEST = 1e-3
"""Of a step of the line search."""
LOST = -1e-300
"""Margin where there is no answer: the event is taken to happen there, and a search keeps away."""
FARTHEST = 30.0
"""Deviations: Phi(-38) is the smallest double, and steps go a little beyond."""


class Limit(Protocol):
    """Conditions g_i(u) < 0 of an event, as functions of L independent standard normal variables."""

    @property
    def points(self) -> int:
        """At which it was asked for so far."""

    @property
    def differentiable(self) -> bool:
        """Whether there are slopes."""

    @property
    def dimension(self) -> int:
        """L."""

    @property
    def cuts(self) -> Sequence[Cut]:
        """The event is their union, each the intersection of some of the conditions."""

    def margins(self, u: Array) -> Array:
        """g (N, k) at points (N, L)."""

    def slopes(self, u: Array) -> Array:
        """dg/du (k, L) at a point (L,); NaN where there is no answer."""


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """The point of a cut next to the origin.

    Attributes
    ----------
    u
        (L,) deviations.
    beta
        Its distance, negative if the event happens at the origin.
    alpha
        (L,) unit vector towards it.
    cut, active
        Its conditions, and those that hold it.
    normals
        (len(active), L) gradients of these, of length 1.
    converged
        Whether it is the design point, or only a point where the event happens.
    steps
        Of the search.
    """

    u: Array
    beta: float
    alpha: Array
    cut: Cut
    active: Cut
    normals: Array
    converged: bool
    steps: int


def worst(margins: Array, cuts: Sequence[Cut]) -> Array:
    """What is negative exactly where the event happens, (N,), of margins (N, k)."""
    return np.asarray(np.min([margins[:, list(cut)].max(axis=1) for cut in cuts], axis=0))


def _nearest(values: Array, slopes: Array, u: Array) -> tuple[Array, Array] | None:
    """The v next to the origin with values + slopes (v - u) <= 0, and which conditions hold it.

    Least distance programming by non-negative least squares: C. Lawson, R. Hanson, Solving least squares
    problems (1974), chapter 23. None: there is no such point.
    """
    wanted = values - slopes @ u  # -slopes v >= wanted
    size = float(np.abs(wanted).max())
    if not wanted.max() > 0.0:
        return np.zeros_like(u), np.zeros(len(values), dtype=bool)
    system = np.vstack([-slopes.T, wanted[None] / size])
    right = np.zeros(len(u) + 1)
    right[-1] = 1.0
    found, _ = optimize.nnls(system, right)
    rest = system @ found - right
    if abs(rest[-1]) < 1e-12:
        return None
    return -rest[:-1] / rest[-1] * size, found > 0.0


def design_point(
    limit: Limit, cut: Cut, start: Array, known: Sequence[DesignPoint] = ()
) -> DesignPoint | None:
    """Search the design point of a cut from a point (L,); None: the search leads to one that is known.

    Every step goes to the point next to the origin of the conditions as they are linearised here, and is made
    shorter until a merit function falls. At a kink the steepest condition so far is kept beside the new one,
    so that the search does not go in circles.
    """
    which = list(cut)
    u = np.array(start, dtype=np.float64)
    margins = limit.margins(u[None])[0, which]
    penalty, steps = 0.0, 0
    active = np.ones(len(which), dtype=bool)
    normals = np.zeros((len(which), len(u)))
    kept: list[tuple[Array, Array, Array]] = []  # of points beyond a kink: values, slopes, where
    converged = False
    near = np.inf, u, active, normals  # of the steps that begin on the limit, the shortest
    for steps in range(1, MOST_STEPS + 1):
        slopes = limit.slopes(u)[which]
        lengths = np.linalg.norm(slopes, axis=1)
        usable = lengths > 0.0
        if not usable[margins > 0.0].all() or not np.all(np.isfinite(slopes)):
            break  # flat where it does not hold: nothing to follow
        if not usable.any():
            # at the bound of what is random nothing changes any more: the nearest point is on the way back
            u = 0.7 * u
            margins = limit.margins(u[None])[0, which]
            continue
        scale = np.where(usable, lengths, 1.0)
        normals, values = slopes / scale[:, None], margins / scale
        rows = np.vstack([normals[usable], *(n for _, n, _ in kept)])
        at = np.concatenate([values[usable], *(v + n @ (u - w) for v, n, w in kept)])
        best = _nearest(at, rows, u)
        if best is None or np.linalg.norm(best[0]) > FARTHEST:
            kept.clear()
            best = _nearest(values[usable], normals[usable], u)
            if best is None:
                break
        target, holds = best
        if np.linalg.norm(target) > FARTHEST:
            target *= FARTHEST / np.linalg.norm(target)
        active = np.zeros(len(which), dtype=bool)
        active[np.flatnonzero(usable)] = holds[: int(usable.sum())]
        if any(float(np.linalg.norm(target - each.u)) < KNOWN * each.beta for each in known):
            return None
        step = target - u
        length = float(np.linalg.norm(step))
        if length <= CLOSE * max(1.0, float(np.linalg.norm(u))) and values.max() <= CLOSE:
            converged = True
            break
        if length < near[0] and np.abs(values[active]).max(initial=0.0) <= CLOSE:
            near = length, u, active, normals
        penalty = max(penalty, 2.0 * float(np.linalg.norm(u)) + 10.0)

        def merit(v: Array, g: Array, scale: Array = scale, penalty: float = penalty) -> float:
            return 0.5 * float(v @ v) + penalty * float(np.maximum(g / scale, 0.0).max())

        before = merit(u, margins)
        share, trial, found = 1.0, target, margins
        while True:
            trial = u + share * step
            found = limit.margins(trial[None])[0, which]
            answered = not np.any(found == LOST)
            if answered and merit(trial, found) < before - 1e-4 * share * length * length:
                break
            if share < SHORTEST:
                break
            share *= 0.5 if share > 0.2 else 0.1
        if share < SHORTEST:
            if kept:
                break
            # the slope is that of this side of a kink: that of the other side holds, too
            beyond = u + min(length, 0.05) * step / length
            other = limit.slopes(beyond)[which]
            size = np.linalg.norm(other, axis=1)
            if not np.all((size > 0.0) & np.isfinite(size)):
                break
            there = limit.margins(beyond[None])[0, which]
            kept.append((there / size, other / size[:, None], beyond))
            continue
        u, margins = trial, found
    if not converged and near[0] <= np.sqrt(CLOSE) * np.linalg.norm(near[1]):
        # slopes at a kink are no better, but the distance is right to the square of the step
        converged, (_, u, active, normals) = True, near
        margins = limit.margins(u[None])[0, which]
    beta = float(np.linalg.norm(u))
    if not converged and np.all(margins <= CLOSE * np.maximum(np.linalg.norm(normals, axis=1), 1.0)):
        active = np.ones(len(which), dtype=bool)
    alpha = np.asarray(u / beta if beta > 0.0 else -normals[0], dtype=np.float64)
    return DesignPoint(
        u, beta, alpha, cut, tuple(np.array(which)[active]), normals[active], converged, steps
    )


def first_order(limit: Limit, points: Sequence[DesignPoint]) -> float:
    """Probability of the event where its conditions are linear, of design points of all of its cuts.

    A single condition: Phi(-beta). Several: the union of half spaces, by the multivariate normal
    distribution; a cut of several active conditions by its smallest distance.
    """
    normals, betas = [], []
    for point in points:
        normals.append(point.alpha)
        betas.append(point.beta)
    if len(points) == 1:
        return _of_cut(points[0])
    rows = np.array(normals)
    correlation = np.clip(rows @ rows.T, -1.0, 1.0)
    np.fill_diagonal(correlation, 1.0)
    return _union(np.array(betas), correlation)


def _of_cut(point: DesignPoint) -> float:
    """Probability of an intersection of half spaces that hold the design point."""
    if len(point.normals) <= 1:
        return float(stats.norm.sf(point.beta))
    betas = -point.normals @ point.u  # normals point out of the event
    correlation = np.clip(point.normals @ point.normals.T, -1.0, 1.0)
    return float(
        stats.multivariate_normal(cov=correlation, allow_singular=True).cdf(-betas)
    )


def _union(betas: Array, correlation: Array) -> float:
    """P(any z_i > beta_i) by the bounds of O. Ditlevsen, J. Struct. Mech. 7 (1979) 453: their middle."""
    order = np.argsort(betas)
    betas, correlation = betas[order], correlation[np.ix_(order, order)]
    single = stats.norm.sf(betas)
    both = np.zeros((len(betas), len(betas)))
    for i in range(len(betas)):
        for j in range(i):
            rho = min(float(correlation[i, j]), 1.0 - 1e-9)
            law = stats.multivariate_normal(cov=[[1.0, rho], [rho, 1.0]], allow_singular=True)
            both[i, j] = float(law.cdf([-betas[i], -betas[j]]))
    low = single[0] + sum(max(single[i] - both[i, :i].sum(), 0.0) for i in range(1, len(betas)))
    high = single.sum() - sum(both[i, :i].max() for i in range(1, len(betas)))
    return float(0.5 * (low + max(high, low)))


def _tangents(alpha: Array) -> Array:
    """(L - 1, L) orthonormal vectors normal to a unit vector."""
    basis, _ = np.linalg.qr(np.column_stack([alpha, np.eye(len(alpha))]))
    return np.asarray(basis[:, 1 : len(alpha)].T)


def curvatures(limit: Limit, point: DesignPoint) -> Array | None:
    """Curvatures (2, L - 1) of the limit on both sides along the tangents at a design point.

    Positive: away from the origin. They are those of parabolas through points of the limit, which are found
    without derivatives, so that kinks do no harm. None: the limit is not met there.
    """
    tangents = _tangents(point.alpha)
    if not len(tangents):
        return np.zeros((2, 0))
    away = min(max(point.beta, 1.0), 3.0)
    sides = away * np.concatenate([tangents, -tangents])

    def values(heights: Array) -> Array:
        return worst(limit.margins(sides + heights[:, None] * point.alpha), [point.cut])

    low = np.full(len(sides), point.beta)
    f_low = values(low)
    high = low + np.where(f_low > 0.0, 0.25, -0.25)
    f_high = values(high)
    for _ in range(12):
        with np.errstate(divide="ignore", invalid="ignore"):
            move = -f_high * (high - low) / (f_high - f_low)
        move = np.where(np.isfinite(move), np.clip(move, -2.0, 2.0), 0.0)
        low, f_low = high, f_high
        if np.abs(move).max() < 1e-3:
            break
        high = high + move
        f_high = values(high)
    else:
        return None
    curved = 2.0 * (high - point.beta) / away**2
    return np.asarray(curved.reshape(2, -1))


def second_order(point: DesignPoint, curved: Array) -> float:
    """Probability with the curvatures of the limit, by K. Breitung, J. Eng. Mech. 110 (1984) 357, with the
    factor of M. Hohenbichler, R. Rackwitz, J. Eng. Mech. 114 (1988) 2195, both sides of each tangent by
    itself."""
    beta = point.beta
    if beta <= 0.0:
        return float(stats.norm.sf(beta))
    ratio = float(np.exp(stats.norm.logpdf(beta) - stats.norm.logsf(beta)))
    factors = 1.0 + ratio * curved
    if factors.min(initial=1.0) <= 0.0:
        return float("nan")
    return float(stats.norm.sf(beta) * np.prod(0.5 * np.sum(factors**-0.5, axis=0)))
