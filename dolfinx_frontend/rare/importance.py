"""Importance sampling around design points, which looks for those that are missing and for curvature."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import special, stats
from dolfinx_frontend.rare.densities import Mixture
from dolfinx_frontend.rare.design import DesignPoint, Limit, worst
from dolfinx_frontend.rare.doubled import Predictor, Round, sampled_round
from dolfinx_frontend.rare.tails import Found

__all__ = ["importance_sampling"]

FEWEST = 200
"""Points of importance sampling at least, on which its own scatter is judged."""
FEWEST_HITS = 40
"""Points of these at which the event happens."""
HEAVY = 0.07
"""Share of one point in the whole estimate that says that the density misses a part of the event."""
SURE = 0.95
"""Coefficient of variation that is aimed at, with its own error, relative to the wanted one."""
APART = 1.5
"""Distance of such a point from design points and from others from which was searched."""
MOST_SEARCHES = 12
NEARER = 0.1
"""Deviations by which a sample of the event is nearer to the origin than its design points should be."""
UNEXPLAINED = 0.4
"""Of the distance to the planes at which a sample is nearer to the event than these say."""
MOST_STRANGE = 4
MOST_FITTED = 4000
"""Samples up to which surfaces are fitted to them."""

FEWEST_SOLVED = 80
"""Solves of a round whose other samples a polynomial answers."""
MOST_ROUNDS = 5

Search = Callable[[Array], Sequence[DesignPoint]]


def importance_sampling(
    limit: Limit,
    points: Sequence[DesignPoint],
    rng: np.random.Generator,
    cov: float,
    most: int,
    level: float,
    search: Search | None = None,
) -> Found:
    """Samples around design points.

    Where a sample shows a part of the event of which there is no design point, more are searched and samples
    drawn around all of them. No sample is ever thrown away, which would be a choice by the answer: all count
    with the mixture of the densities that they were drawn from (E. Veach, L. Guibas, SIGGRAPH 95, 419: the
    balance heuristic).

    Parameters
    ----------
    most
        Points at which the limit is asked for, those of searches included.
    search
        A point (L,) where the event happens -> new design points, or none; None: none are searched.
    """
    samples = _Samples(limit, points, cov)
    allowed = limit.points + most
    samples.draw(rng, max(min(FEWEST // 2, most), 1))
    if samples.explained() and samples.doubled(rng, allowed):
        return samples.found(level)
    wanted = FEWEST - FEWEST // 2  # where samples have to be looked at, half of them are too few
    while True:
        samples.draw(rng, max(min(wanted, allowed - limit.points), 1))
        left = allowed - limit.points
        if left > 0 and search is not None and samples.looked_around(search):
            wanted = FEWEST // 2
            continue
        if left > 0 and samples.curved():
            wanted = FEWEST // 2
            continue
        if samples.done or left <= 0:
            return samples.found(level)
        if samples.doubled(rng, allowed):
            return samples.found(level)
        wanted = samples.wanted()


class _Samples:
    """Samples of an event so far, and the densities that they were drawn from."""

    def __init__(self, limit: Limit, points: Sequence[DesignPoint], cov: float) -> None:
        self.limit, self.points, self.cov = limit, list(points), cov
        self.stages = [Mixture.around(points)]
        self.counts = [0]
        self.every: Array = np.zeros((0, limit.dimension))
        self.hit = self.every
        self.margins: Array = np.zeros((0, 0))  # of every sample
        self.weights = np.zeros(0)  # of those where it happens
        self.value, self.spread = 0.0, math.inf
        self._mean, self._plain = 0.0, math.inf  # without polynomials
        self._rounds: list[Round] = []
        self._given_up = False
        self._looked: list[Array] = []
        self._strange = self._fitted = 0

    @property
    def count(self) -> int:
        """Samples."""
        return len(self.every)

    @property
    def done(self) -> bool:
        """Whether the estimate is as sure as wanted."""
        if self.count < FEWEST:
            return False
        return len(self.hit) >= FEWEST_HITS and _surely(self.weights) * self.spread <= SURE * self.cov

    def draw(self, rng: np.random.Generator, count: int) -> None:
        """More of them, and the estimate of all."""
        new = self.stages[-1].draw(rng, count)
        there = self.limit.margins(new)
        self.hit = np.concatenate([self.hit, new[worst(there, self.limit.cuts) < 0.0]])
        self.every = np.concatenate([self.every, new])
        self.margins = np.concatenate([self.margins, there]) if len(self.margins) else there
        self.counts[-1] += count
        ratios = np.stack([stage.ratio(self.hit) for stage in self.stages], axis=1)
        self.weights = self.count * np.exp(-special.logsumexp(ratios, b=np.array(self.counts), axis=1))
        self._mean = float(self.weights.sum()) / self.count
        square = float(np.sum(self.weights**2)) / self.count - self._mean**2
        self._plain = math.inf
        if len(self.hit):
            self._plain = math.sqrt(max(square, 0.0) / max(self.count - 1.0, 1.0)) / self._mean
        self._combine()

    def wanted(self) -> int:
        """How many more are likely to do."""
        if self.count < FEWEST:
            return FEWEST - self.count
        if len(self.hit) < 5:
            return self.count
        missing = (_surely(self.weights) * self.spread / (SURE * self.cov)) ** 2
        return int(min(max((1.1 * missing - 1.0) * self.count, 50.0), 3.0 * self.count))

    def _stage(self, mixture: Mixture) -> None:
        self.stages.append(mixture)
        self.counts.append(0)

    def explained(self) -> bool:
        """Whether no sample shows a part of the event of which there is no design point."""
        share = float(self.weights.max(initial=0.0)) / max(float(self.weights.sum()), 1e-300)
        return share <= HEAVY and not _unexplained(self.limit, self.points, [], self.every, self.margins)

    def looked_around(self, search: Search) -> bool:
        """Whether samples led to more design points, or to places where these are missing."""
        before = len(self.points)
        if self._strange < MOST_STRANGE:
            for near in _unexplained(self.limit, self.points, self._looked, self.every, self.margins):
                self._strange += 1
                self._looked.append(near)
                self.points += search(near)
        if len(self.points) == before and len(self._looked) < MOST_SEARCHES and len(self.hit):
            self._look_at_hits(search)
        if len(self.points) > before:
            self._stage(Mixture.around(self.points))
        return len(self.points) > before

    def _look_at_hits(self, search: Search) -> None:
        heavy = self.hit[int(self.weights.argmax())]
        known = np.vstack([self.stages[-1].centres, *self._looked])
        share = float(self.weights.max() / self.weights.sum())
        if len(self.hit) >= 5 and share > HEAVY and np.linalg.norm(known - heavy, axis=1).min() > APART:
            self._looked.append(heavy)
            more = search(heavy)
            self.points += more
            if more:
                return
        # an event next to the origin that no design point is next to
        sizes = np.linalg.norm(self.hit, axis=1)
        k = int(sizes.argmin())
        if sizes[k] < min(each.beta for each in self.points) - NEARER:
            self._looked.append(self.hit[k])
            more = search(self.hit[k])
            self.points += more
            if min((each.beta for each in more), default=math.inf) > sizes[k]:
                self.points.append(_centre(self.hit[k], self.limit))

    def curved(self) -> bool:
        """Whether the next samples are drawn beyond paraboloids, which all samples so far show."""
        if len(self.hit) < 5 or self.count < 2 * self._fitted or self.count > MOST_FITTED:
            return False
        first, self._fitted = not self._fitted, self.count
        if self.done and not first:
            return False
        found = self.stages[-1].curved(self.points, self.every, self.margins)
        # what lies before the planes is met by few samples with large weights, or by none so far
        if found is None or (self.done and found.before() <= HEAVY):
            return False
        self._stage(found)
        return True

    def doubled(self, rng: np.random.Generator, allowed: int) -> bool:
        """Whether rounds with polynomials do, which spare most solves; made where these are believed."""
        if self._given_up or len(self.hit) < FEWEST_HITS // 2:
            return False
        known, conditions, happens = self.every, self.margins, self._happens(self.margins)
        ratios = np.stack([stage.ratio(known) for stage in self.stages], axis=1)
        weights = self.count * np.exp(-special.logsumexp(ratios, b=np.array(self.counts), axis=1))
        predictor = Predictor.fitted(self.points, known, conditions)
        if predictor is None or not predictor.believed(self.points, happens, weights, known):
            return False

        def ask(u: Array) -> tuple[Array, Flags]:
            there = self.limit.margins(u)
            return there, self._happens(there)

        solves, goal = FEWEST_SOLVED, SURE * self.cov
        while len(self._rounds) < MOST_ROUNDS and self.limit.points + solves < allowed:
            plain = _surely(self.weights) * self._plain
            missing = self.count * ((plain / goal) ** 2 - 1.0)  # samples, without polynomials
            # as many solves in such rounds reach the goal, whatever the samples so far are worth
            otherwise = goal * math.sqrt(max(missing, 0.0) / solves)
            one = sampled_round(predictor, self.stages[-1], ask, rng, solves, otherwise)
            if one is None:
                break
            self._rounds.append(one)
            self._combine()
            if self.spread <= goal:
                return True
            known = np.concatenate([known, one.solved])
            conditions = np.concatenate([conditions, one.margins])
            predictor = Predictor.fitted(self.points, known, conditions) or predictor
            spent = sum(len(each.solved) for each in self._rounds)
            more = max(spent * ((self.spread / goal) ** 2 - 1.0), FEWEST_SOLVED)
            if more > missing:
                break  # as many samples without polynomials do
            solves = int(min(more, 4.0 * solves))
        self._given_up = bool(self._rounds)
        self._combine()
        return False

    def _happens(self, margins: Array) -> Flags:
        return np.asarray(worst(margins, self.limit.cuts) < 0.0)

    def _combine(self) -> None:
        """Value and coefficient of variation of all rounds, each of which counts by its solves.

        Where polynomials were given up, samples without them count as well, by their number: no round is ever
        thrown away.
        """
        if not self._rounds:
            self.value, self.spread = self._mean, self._plain
            return
        counts = [float(len(each.solved)) for each in self._rounds]
        values = [each.value for each in self._rounds]
        variances = [each.variance for each in self._rounds]
        if self._given_up:
            counts, values = [*counts, float(self.count)], [*values, self._mean]
            variances.append((self._plain * self._mean) ** 2 if self._mean > 0.0 else math.inf)
        shares = np.array(counts) / sum(counts)
        self.value = float(shares @ values)
        self.spread = math.inf
        if self.value > 0.0:
            self.spread = math.sqrt(float(shares**2 @ variances)) / self.value

    def found(self, level: float) -> Found:
        """The interval is that of the logarithm: the estimate is positive, and skew where few points hit."""
        hits, spread, value = len(self.hit), self.spread, self.value
        solved = sum(len(each.solved) for each in self._rounds)
        if not value > 0.0:
            return Found(0.0, 0.0, 1.0, math.inf, self.count + solved, hits, False, self.hit)
        only_rounds = self._rounds and not self._given_up
        quantile = stats.norm if only_rounds else stats.t(max(hits - 1, 1))
        half = float(quantile.isf(0.5 * (1.0 - level))) * spread
        half *= 1.0 if only_rounds else _surely(self.weights)
        low, high = value * math.exp(-half), value * math.exp(min(half, 600.0))
        hits += sum(each.hits for each in self._rounds)
        return Found(
            value, low, min(high, 1.0), spread, self.count + solved, hits, spread <= self.cov, self.hit[:200],
            solved,
        )


def _centre(u: Array, limit: Limit) -> DesignPoint:
    """A point (L,) of the event to draw samples around, which is no design point."""
    beta, cut = float(np.linalg.norm(u)), limit.cuts[0]
    alpha = np.asarray(u / beta, dtype=np.float64)
    return DesignPoint(u, beta, alpha, cut, cut, np.zeros((0, len(u))), False, 0)


def _unexplained(
    limit: Limit, points: Sequence[DesignPoint], looked: Sequence[Array], u: Array, margins: Array
) -> list[Array]:
    """Samples (L,) that are much nearer to the event than the planes of all design points say, at most a few.

    How a condition falls towards the limit is measured at the samples before the planes of its own points.
    """
    found: list[Array] = []
    away = np.min([each.beta - u @ each.alpha for each in points], axis=0)
    for cut in limit.cuts:
        g = margins[:, list(cut)].max(axis=1)
        own = [each for each in points if each.cut == cut]
        if not own:
            continue
        before = np.min([each.beta - u @ each.alpha for each in own], axis=0)
        usable = (before > 0.1) & (g > 0.0) & np.isfinite(g)
        if usable.sum() < 10:
            continue
        near = g / np.median(g[usable] / before[usable])
        strange = np.flatnonzero((near < UNEXPLAINED * away) & (away > 1.0) & (near < 2.0))
        for k in strange[np.argsort(near[strange])]:
            known = [each.u for each in points] + [*looked] + found
            apart = min(float(np.linalg.norm(u[k] - each)) for each in known)
            if apart > APART and len(found) < MOST_STRANGE:
                found.append(u[k])
    return found


def _surely(weights: Array) -> float:
    """Factor of a deviation that was estimated from few large weights: by two of its own deviations' worth.

    The relative error of a sum of squares is about the root of that of fourth powers over it.
    """
    squares = weights * weights
    return math.sqrt(1.0 + 2.0 * math.sqrt(float(squares @ squares)) / max(float(squares.sum()), 1e-300))
