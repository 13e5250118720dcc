"""Probabilities of rare events by sampling in the space of independent standard normal variables.

Every method returns its estimate with an interval and the number of points at which the conditions were
evaluated; all are loops over batches, end after a number of points that is known before, and never reject a
failed point silently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.rare.design import Limit, worst

__all__ = ["Found", "directional_sampling", "plain_sampling", "subset_simulation"]

SAFETY = 0.85
"""Coefficient of variation that is aimed at, relative to the wanted one, which is estimated as well."""
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
    doubled
        Samples that were solved out of many that polynomials answer, see :mod:`.doubled`; 0: no polynomials.
    """

    value: float
    low: float
    high: float
    cov: float
    points: int
    hits: int
    complete: bool
    failed: Array = field(default_factory=lambda: np.zeros((0, 0)))
    doubled: int = 0


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
