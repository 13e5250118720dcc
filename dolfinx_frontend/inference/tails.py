"""Probabilities of rare events by sampling in the space of independent standard normal variables.

Every method returns its estimate with an interval and the number of points at which the conditions were
evaluated; all are loops over batches, end after a number of points that is known before, and never reject a
failed point silently.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special, stats

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.inference.design import DesignPoint, Limit, worst

__all__ = ["Found", "directional_sampling", "importance_sampling", "plain_sampling", "subset_simulation"]

FEWEST = 200
"""Points of importance sampling at least, on which its own scatter is judged."""
FEWEST_HITS = 40
"""Points of these at which the event happens."""
SAFETY = 0.85
"""Coefficient of variation that is aimed at, relative to the wanted one, which is estimated as well."""
OUTSIDE = 0.15
"""Share of the points of importance sampling that look elsewhere than around the design points."""
SMALLER = 0.3
"""Of the ball outside of which they do than the distance of the nearest design point, deviations."""
BEYOND = 0.6
"""Share of the points that are drawn beyond the tangent planes of the design points."""
MOVED = 0.1
"""Of these planes towards the origin, deviations."""
HEAVY = 0.07
"""Share of one point in the whole estimate that says that the density misses a part of the event."""
STOPPED = 1.1
"""Factor of the width of the interval, which is estimated from the samples on which the sampling stopped."""
APART = 1.5
"""Distance of such a point from design points and from others from which was searched."""
MOST_SEARCHES = 12
FARTHEST = 8.5
"""Radius (deviations, beside that of the other variables) up to which directions are searched."""


@dataclass(frozen=True, eq=False)
class Found:
    """An estimate of a probability.

    Attributes
    ----------
    value, low, high
        Probability and its interval.
    cov
        Coefficient of variation of the estimate; infinite: nothing was hit.
    points
        At which the conditions were evaluated.
    hits
        At which the event happened.
    complete
        Whether the wanted coefficient of variation was reached.
    failed
        (n, L) some points at which the event happens.
    """

    value: float
    low: float
    high: float
    cov: float
    points: int
    hits: int
    complete: bool
    failed: Array = field(default_factory=lambda: np.zeros((0, 0)))


def plain_sampling(
    limit: Limit, rng: np.random.Generator, cov: float, most: int, level: float, batch: int = 1000
) -> Found:
    """Independent samples, with Wilson's interval."""
    count = hits = 0
    failed: Array = np.zeros((0, limit.dimension))
    while count < most:
        u = rng.standard_normal((min(batch, most - count), limit.dimension))
        bad = worst(limit.margins(u), limit.cuts) < 0.0
        count, hits = count + len(u), hits + int(bad.sum())
        failed = np.concatenate([failed, u[bad]])[:200]
        if 0 < hits < count and math.sqrt((1.0 - hits / count) / hits) <= SAFETY * cov:
            break
    value = hits / count
    test = stats.binomtest(hits, count).proportion_ci(level, method="wilson")
    spread = math.sqrt((1.0 - value) / hits) if hits else math.inf
    return Found(value, float(test.low), float(test.high), spread, count, hits, spread <= cov, failed)


# --- importance sampling ------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class _Mixture:
    """Densities around design points, of three kinds.

    Beyond the tangent plane of a design point, moved a little towards the origin, the standard normal
    density itself: where the limit is a plane all weights are the same. Around the points the normal density
    of unit covariance, for what is curved towards the origin. And the standard normal density outside of a
    ball that is a little smaller than the distance of the nearest design point, in all directions, for what
    nobody has thought of.
    """

    centres: Array  # (n, L)
    normals: Array  # (n, L) of length 1
    offsets: Array  # (n,) of the planes from the origin
    shares: Array  # (2 n + 1,), of sum 1: beyond the planes, around the points, outside of the ball
    radius: float

    @classmethod
    def around(cls, points: Sequence[DesignPoint]) -> _Mixture:
        chances = special.log_ndtr(-np.array([each.beta for each in points]))
        shares = np.exp(chances - chances.max())
        shares = np.maximum(shares / shares.sum(), 0.2 / len(points))
        shares /= shares.sum()
        centres = np.array([each.u for each in points])
        nearest = min(each.beta for each in points)
        return cls(
            centres,
            np.array([each.alpha for each in points]),
            np.array([each.beta for each in points]) - MOVED,
            np.concatenate([BEYOND * shares, (1.0 - BEYOND - OUTSIDE) * shares, [OUTSIDE]]),
            max(nearest - SMALLER, 0.0),
        )

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        number = len(self.centres)
        which = rng.choice(len(self.shares), size=count, p=self.shares)
        u = rng.standard_normal((count, self.centres.shape[1]))
        beyond = which < number
        normals = self.normals[which[beyond]]
        # the part along the normal: a tail of the normal distribution by its inverse
        tail = special.ndtr(-self.offsets[which[beyond]]) * rng.random(int(beyond.sum()))
        along = -special.ndtri(np.maximum(tail, 1e-300))
        u[beyond] += (along - np.sum(u[beyond] * normals, axis=1))[:, None] * normals
        near = (which >= number) & (which < 2 * number)
        u[near] += self.centres[which[near] - number]
        outside = which == 2 * number
        chance = rng.random(int(outside.sum())) * float(stats.chi2.sf(self.radius**2, u.shape[1]))
        radii = np.sqrt(stats.chi2.isf(np.maximum(chance, 1e-300), u.shape[1]))
        u[outside] *= (radii / np.linalg.norm(u[outside], axis=1))[:, None]
        return u

    def ratio(self, u: Array) -> Array:
        """Logarithm of this density over the standard normal one, (N,)."""
        with np.errstate(divide="ignore"):
            inside = np.log((u @ self.normals.T > self.offsets).astype(float))
        beyond = inside - special.log_ndtr(-self.offsets)
        near = u @ self.centres.T - 0.5 * np.sum(self.centres**2, axis=1)
        with np.errstate(divide="ignore"):
            far = np.log((np.linalg.norm(u, axis=1) > self.radius).astype(float))
        outside = far - stats.chi2.logsf(self.radius**2, u.shape[1])
        logs = np.column_stack([beyond, near, outside])
        return np.asarray(special.logsumexp(logs, b=self.shares, axis=1))


def importance_sampling(
    limit: Limit,
    points: Sequence[DesignPoint],
    rng: np.random.Generator,
    cov: float,
    most: int,
    level: float,
    search: Callable[[Array], Sequence[DesignPoint]] | None = None,
) -> Found:
    """Samples around design points.

    Where a sample shows a part of the event of which there is no design point, more are searched and samples
    drawn around all of them. No sample is ever thrown away, which would be a choice by the answer: all count
    with the mixture of the densities that they were drawn from (E. Veach, L. Guibas, SIGGRAPH 95, 419: the
    balance heuristic).

    Parameters
    ----------
    search
        A point (L,) where the event happens -> new design points, or none; None: none are searched.
    """
    stages = [_Mixture.around(points)]
    counts = [0]
    hit: Array = np.zeros((0, limit.dimension))
    weights = np.zeros(0)
    looked: list[Array] = []
    wanted = min(FEWEST, most)
    while True:
        new = stages[-1].draw(rng, wanted - sum(counts))
        hit = np.concatenate([hit, new[worst(limit.margins(new), limit.cuts) < 0.0]])
        counts[-1] += len(new)
        count, hits = sum(counts), len(hit)
        ratios = np.stack([stage.ratio(hit) for stage in stages], axis=1)
        weights = count * np.exp(-special.logsumexp(ratios, b=np.array(counts), axis=1))
        value = float(weights.sum()) / count
        square = float(np.sum(weights**2)) / count - value**2
        spread = math.sqrt(max(square, 0.0) / (count - 1.0)) / value if hits else math.inf
        if search is not None and hits >= 5 and count < most and len(looked) < MOST_SEARCHES:
            heavy = hit[int(weights.argmax())]
            known = np.vstack([stages[-1].centres, *looked])
            share = float(weights.max() / weights.sum())
            if share > HEAVY and np.linalg.norm(known - heavy, axis=1).min() > APART:
                looked.append(heavy[None])
                if more := search(heavy):
                    points = [*points, *more]
                    stages.append(_Mixture.around(points))
                    counts.append(0)
                    wanted = min(count + FEWEST // 2, most)
                    continue
        if (hits >= FEWEST_HITS and spread <= SAFETY * cov) or count >= most:
            return _found(weights, hit, count, value, spread, cov, level)
        further = count * (spread / (SAFETY * cov)) ** 2 if hits >= 5 else 2.0 * count
        wanted = int(min(max(1.1 * further, count + 50), 4.0 * count, most))


def _found(
    weights: Array, hit: Array, count: int, value: float, spread: float, cov: float, level: float
) -> Found:
    """The interval is that of the logarithm: the estimate is positive, and skew where few points hit."""
    hits = len(hit)
    if not hits:
        return Found(0.0, 0.0, 1.0, math.inf, count, 0, False, hit)
    half = STOPPED * float(stats.t.isf(0.5 * (1.0 - level), max(hits - 1, 1))) * spread
    low, high = value * math.exp(-half), min(value * math.exp(half), 1.0)
    return Found(value, low, high, spread, count, hits, spread <= cov, hit[:200])


# --- directions ---------------------------------------------------------------------------------------
def directional_sampling(
    limit: Limit, rng: np.random.Generator, cov: float, most: int, level: float, batch: int = 64
) -> Found:
    """Independent directions; along each the limit is searched, and the rest is the chi distribution.

    O. Ditlevsen, R. Melchers, H. Gluver, Comput. Struct. 36 (1990) 355. Every change of sign on a grid of
    radii is refined to 1e-4 deviations.
    """
    dimension = limit.dimension
    far = math.sqrt(float(stats.chi2.isf(1e-16, dimension)))
    radii = np.linspace(0.0, far, int(math.ceil(2.0 * far)) + 1)
    at_origin = bool(worst(limit.margins(np.zeros((1, dimension))), limit.cuts)[0] < 0.0)
    chances: list[float] = []
    evaluated, hits = 1, 0
    failed: Array = np.zeros((0, dimension))
    while True:
        directions = rng.standard_normal((batch, dimension))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        grid = radii[1:, None, None] * directions
        values = worst(limit.margins(grid.reshape(-1, dimension)), limit.cuts).reshape(len(radii) - 1, batch)
        evaluated += grid.shape[0] * batch
        bad = np.vstack([np.full((1, batch), at_origin), values < 0.0])
        changes = np.argwhere(bad[1:] != bad[:-1])
        low, high = radii[changes[:, 0]], radii[changes[:, 0] + 1]
        lines = directions[changes[:, 1]]
        for _ in range(13 if len(changes) else 0):
            middle = 0.5 * (low + high)
            inside = worst(limit.margins(middle[:, None] * lines), limit.cuts) < 0.0
            evaluated += len(middle)
            same = inside == bad[changes[:, 0], changes[:, 1]]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        of_batch = np.full(batch, float(at_origin))
        beyond = stats.chi2.sf((0.5 * (low + high)) ** 2, dimension)
        np.add.at(of_batch, changes[:, 1], np.where(bad[changes[:, 0], changes[:, 1]], -beyond, beyond))
        chances += [float(each) for each in of_batch]
        if len(changes):
            failed = np.concatenate([failed, high[:, None] * lines])[:200]
        found = np.array(chances)
        hits = int(np.count_nonzero(found != float(at_origin)))
        value = float(found.mean())
        spread = float(found.std(ddof=1)) / (math.sqrt(len(found)) * value) if value > 0.0 else math.inf
        if (hits >= 30 and spread <= SAFETY * cov) or evaluated + len(radii) * batch > most:
            break
    if not value > 0.0:
        return Found(0.0, 0.0, 1.0, math.inf, evaluated, 0, False)
    half = float(stats.t.isf(0.5 * (1.0 - level), len(found) - 1)) * spread
    return Found(
        value, value * math.exp(-half), min(value * math.exp(half), 1.0), spread, evaluated, hits,
        spread <= cov, failed,
    )  # fmt: skip


# --- subsets ------------------------------------------------------------------------------------------
MOST_LEVELS = 15
"""Each takes a tenth: probabilities below 1e-15 count as never."""
SHARE = 0.1


def subset_simulation(
    limit: Limit, rng: np.random.Generator, cov: float, most: int, level: float
) -> Found:
    """Samples of ever rarer events, each from the one before by Markov chains.

    S.-K. Au, J. Beck, Probab. Eng. Mech. 16 (2001) 263, with the chains of I. Papaioannou et al., Probab.
    Eng. Mech. 41 (2015) 89. Several independent runs: their scatter is the error, so that correlated chains
    are no guess.
    """
    runs = 6
    per_level = max(200, int(round(22.0 / cov**2 / runs / 100.0)) * 100)
    values: list[float] = []
    evaluated, hits = 0, 0
    failed: Array = np.zeros((0, limit.dimension))
    complete = True
    for _ in range(runs):
        affordable = (most - evaluated) // max((runs - len(values)), 1)
        one = _one_run(limit, rng, per_level, affordable)
        evaluated += one.points
        hits += one.hits
        complete = complete and one.complete
        failed = np.concatenate([failed, one.failed])[-200:] if len(one.failed) else failed
        values.append(one.value)
    chances = np.array(values)
    value = float(chances.mean())
    if not complete or not chances.min() > 0.0:
        # what was not reached is rarer than the rarest level: an upper bound
        return Found(0.0, 0.0, float(chances.max()), math.inf, evaluated, hits, False, failed)
    spread = float(chances.std(ddof=1)) / (math.sqrt(runs) * value)
    half = float(stats.t.isf(0.5 * (1.0 - level), runs - 1)) * spread
    return Found(
        value, value * math.exp(-half), min(value * math.exp(half), 1.0), spread, evaluated, hits,
        spread <= cov, failed,
    )  # fmt: skip


def _one_run(limit: Limit, rng: np.random.Generator, count: int, most: int) -> Found:
    """One subset simulation; if it does not arrive, `value` is a bound and `complete` is False."""
    u = rng.standard_normal((count, limit.dimension))
    values = worst(limit.margins(u), limit.cuts)
    evaluated, chance, scale = count, 1.0, 0.6
    for _ in range(MOST_LEVELS):
        kept = int(SHARE * count)
        order = np.argsort(values, kind="stable")
        threshold = 0.5 * (values[order[kept - 1]] + values[order[kept]])
        failing = values < 0.0
        if failing.sum() >= kept:
            return Found(chance * float(failing.mean()), 0.0, 1.0, 0.0, evaluated, int(failing.sum()), True,
                         u[failing])  # fmt: skip
        stuck = not values[order[kept - 1]] < values[order[-1]]  # the same everywhere: nothing to follow
        if stuck or evaluated + count - kept > most:
            break
        chance *= SHARE
        seeds, at = u[order[:kept]], values[order[:kept]]
        u, values, scale = _chains(limit, rng, seeds, at, threshold, count, scale)
        evaluated += count - kept
    return Found(chance, 0.0, 1.0, math.inf, evaluated, 0, False)


def _chains(
    limit: Limit,
    rng: np.random.Generator,
    seeds: Array,
    values: Array,
    threshold: float,
    count: int,
    scale: float,
) -> tuple[Array, Array, float]:
    """Markov chains below a threshold, side by side: points (count, L), values, the scale that suited."""
    now, at = seeds.copy(), values.copy()
    points, found = [now.copy()], [at.copy()]
    for step in range(1, int(math.ceil(count / len(seeds)))):
        spread = min(1.0, scale)
        trial = math.sqrt(1.0 - spread**2) * now + spread * rng.standard_normal(now.shape)
        there = worst(limit.margins(trial), limit.cuts)
        accepted = there <= threshold
        now[accepted], at[accepted] = trial[accepted], there[accepted]
        scale = float(np.clip(scale * math.exp((accepted.mean() - 0.44) / math.sqrt(step)), 0.05, 1.0))
        points.append(now.copy())
        found.append(at.copy())
    return np.concatenate(points)[:count], np.concatenate(found)[:count], scale
