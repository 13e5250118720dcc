"""Answers by solved points where no chaos does: rules, pieces of one germ, samples."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import isfinite, log2

import numpy as np
from scipy.special import ndtr

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.estimate.errors import (
    FINEST,
    change_of,
    complete,
    over_ranks,
    size_of,
    whole_of,
)
from dolfinx_frontend.estimate.points import (
    FIRST_PANELS,
    POINTS,
    SETS,
    Panel,
    calibrated,
    checked_cold,
    kinks_at_ends,
    misfit,
    misfit_of_halves,
    moments_of_sets,
    panel_points,
    solved,
    surrogate,
    wide_points,
    witnesses,
)
from dolfinx_frontend.plan.price import Way, price, speed
from dolfinx_frontend.results.accuracy import largest_of
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors, ErrorShare, MeanStd, share_of
from dolfinx_frontend.results.resultant import Wanted
from dolfinx_frontend.results.samples import SampleResult

__all__ = ["SLOWEST", "by_panels", "by_rules", "by_samples"]

SLOWEST = 0.7
"""Largest factor by which errors are assumed to change from one set of modes to the next."""

MOST_SAMPLES, MOST_CHEAP_SAMPLES, CHEAP = 8192, 65_536, 60.0
"""Samples at most, and where so many take less than that many seconds by their price on the core whose
rates it has: how many are taken must not depend on what else the machine does."""

LEAST_SAMPLES = 16
"""Samples of a set that the search begins with."""

RULES = (3, 5, 7, 9, 12, 16, 20)
"""Points per germ of the tensor rules that are tried one after the other, at least two of them."""

SUREST = 0.5
"""Smallest factor by which changes are assumed to fall from rule to rule: at kinks they fall irregularly."""

FORGOTTEN = 0.5
"""Weight of the change of the rule before: with a kink, a change can be small by chance."""

MOST_HALVINGS = 16
"""Times that pieces of a germ are halved."""

ENOUGH_FOR_ZERO = 1024
"""Samples after which a mean that cannot be told from 0 is given up."""

KINKED = 4.0 / 3.0
"""Power of the misfit of a polynomial that the error of its rule is at most: with n points of a germ, a kink
leaves a misfit of n^(-3/4) or less, and an error of n^-1 in the rule."""

BROKEN_OFF = 1.0 / 6.0
"""A polynomial of a piece of a germ is off by a sixteenth when the piece is halved, at a kink by a half:
above this it is a kink."""

AT_KINK = 0.15
"""Error of the sum over a piece with a kink, relative to how far its polynomial is off: four points, measured
for kinks everywhere in the piece."""

MOST_RULE = 2048
"""Points of a tensor rule at most."""


def of_solved_again(
    samples: SampleResult,
    away: float,
    truncation: ErrorShare,
    quantity: Wanted,
    value: MeanStd,
    whole: float,
) -> Errors:
    """Errors of solved points, some of which were solved again: by how much they were `away`."""
    algebraic = ErrorShare(largest_of(samples.error), away, away, "points solved again, and tighter")
    return Errors(algebraic, truncation, None, quantity, value, whole)


def by_rules(
    result: ChaosResult, quantity: Wanted, target: float, rtol: float
) -> tuple[SampleResult, Errors] | None:
    """Tensor Gauss rules of rising order, which witnesses must agree with; None: they do not in time."""
    space = result.space
    before: MeanStd | None = None
    changes: list[float] = []
    seen = witnesses(result, quantity, rtol, complete)
    for points in RULES:
        counts = [points if g.capacity is None else min(points, g.capacity) for g in space.germs]
        rule = space.tensor_gauss(counts)
        if len(rule.points) > MOST_RULE:
            return None
        samples = solved(result, rule.points, rule.weights, rtol, quantity)
        complete(samples)
        value = samples.mean_std(quantity)
        if before is not None:
            values = quantity.at_end(samples, samples)
            size = size_of(value, quantity)
            whole = whole_of(value, rtol, quantity) or size
            changes.append(change_of(before, value, rtol, quantity))
            # earlier changes count with less weight, and the fall is the mean over all of them
            change = max(c * FORGOTTEN**k for k, c in enumerate(reversed(changes)))
            fall = SUREST
            if len(changes) > 1 and changes[0] > 0.0:
                mean = (changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1))
                fall = float(np.clip(mean, SUREST, SLOWEST))
            left = change * fall / (1.0 - fall)
            smooth = surrogate(space, counts, rule.points, np.asarray(rule.weights), values)
            off = misfit(seen, smooth(seen.points), value)
            spread = value.std or 0.0
            kinked = share_of(off.size, spread) ** KINKED * spread
            if not spread > 0.0 and not value.mean:
                return None  # nothing happens at any point of the rule
            of_mean = max(left * size, kinked)
            of_std = max(left * whole, kinked)
            relative = max(share_of(of_mean, size), share_of(of_std, whole))
            if relative <= 0.5 * target:
                outside = f"{len(seen.points)} points outside it"
                how = f"the change by the last of {points} points per germ, {outside}"
                away = checked_cold(result, samples, quantity, values)
                if not away <= 0.3 * target * min(size_of(value, quantity), whole):
                    return None
                truncation = ErrorShare(np.nan, of_mean, of_std, how)
                made = of_solved_again(samples, away, truncation, quantity, value, whole)
                more = RULES[min(RULES.index(points) + 1, len(RULES) - 1)]
                count = more**space.dimension
                seconds = sum(samples.seconds.values()) * count / len(rule.points)
                return samples, replace(
                    made, next_halving=f"{more} points per germ, {count} solves, about {seconds:.2g} s"
                )
            if kinked > 5.0 * target * whole and points >= 7:
                return None  # a kink: more points would not do
        before = value
    return None


def by_panels(
    result: ChaosResult, quantity: Wanted, target: float, rtol: float
) -> tuple[SampleResult, Errors] | None:
    """Gauss rules on pieces of one germ, which are halved around kinks; None: they do not converge."""
    space = result.space

    def integrated(ends: list[tuple[float, float]]) -> list[tuple[Array, Array]]:
        z, weights = panel_points(ends)
        samples = solved(result, space.from_uniform(ndtr(z.reshape(-1, 1))), weights.ravel(), rtol, quantity)
        complete(samples)
        values = quantity.at_end(samples, samples).reshape(z.shape)
        powers = (np.ones_like(values), values, values**2)
        sums = [np.array([float(w @ p[k]) for p in powers]) for k, w in enumerate(weights)]
        return list(zip(sums, values, strict=True))

    ends = list(pairwise(FIRST_PANELS))
    unknown = np.full(3, np.inf)
    leaves = [
        Panel(*end, sums, unknown, values, unknown)
        for end, (sums, values) in zip(ends, integrated(ends), strict=True)
    ]
    for _ in range(MOST_HALVINGS):
        total = np.sum([leaf.sums for leaf in leaves], axis=0)
        mean = float(total[1] / total[0])
        value = MeanStd(mean, float(np.sqrt(max(total[2] / total[0] - mean**2, 0.0))))
        size = size_of(value, quantity)
        whole = whole_of(value, min(rtol, 1e-10), quantity) or size

        def relative(wrong: Array, value: MeanStd = value, whole: float = whole) -> tuple[float, float]:
            """Errors of mean and deviation, of those of the moments."""
            if not np.all(np.isfinite(wrong)):
                return np.inf, np.inf
            of_mean = wrong[1] + wrong[0] * abs(value.mean)
            square = wrong[2] + 2.0 * abs(value.mean) * wrong[1] + wrong[0] * value.mean**2
            std = value.std or 0.0
            return float(of_mean), float(min(square / (2.0 * std), np.sqrt(square)) if std > 0.0 else square)

        wrong = [leaf.error + more for leaf, more in zip(leaves, kinks_at_ends(leaves), strict=True)]
        of_mean, of_std = relative(np.sum(wrong, axis=0))
        if value.mean == 0.0 and not value.std and np.isfinite(of_mean):
            return None  # nothing happens at any point
        if max(share_of(of_mean, size), share_of(of_std, whole)) <= 0.5 * target:
            z, weights = panel_points([(leaf.lower, leaf.upper) for leaf in leaves])
            points = space.from_uniform(ndtr(z.reshape(-1, 1)))
            samples = solved(result, points, weights.ravel(), rtol, quantity)
            complete(samples)
            values = quantity.at_end(samples, samples)
            value = samples.mean_std(quantity)
            away = checked_cold(result, samples, quantity, values)
            if not away <= 0.3 * target * min(size_of(value, quantity), whole):
                return None
            how = f"the change by the last halving of {len(leaves)} pieces of the germ"
            truncation = ErrorShare(np.nan, of_mean, of_std, how)
            made = of_solved_again(samples, away, truncation, quantity, value, whole)
            seconds = 2.0 * sum(samples.seconds.values())
            return samples, replace(made, next_halving=f"half the pieces, about {seconds:.2g} s")
        each = 0.25 * target / len(leaves)
        shares = [relative(each) for each in wrong]
        split = [
            max(share_of(a, size), share_of(b, whole)) > each or not np.isfinite(a) for a, b in shares
        ]
        if sum(split) * 2 * POINTS > MOST_RULE:
            return None
        halves = [
            half
            for leaf, cut in zip(leaves, split, strict=True)
            if cut
            for middle in [0.5 * (leaf.lower + leaf.upper)]
            for half in ((leaf.lower, middle), (middle, leaf.upper))
        ]
        found = integrated(halves)
        parents = [leaf for leaf, cut in zip(leaves, split, strict=True) if cut]
        leaves = [leaf for leaf, cut in zip(leaves, split, strict=True) if not cut]
        for k, parent in enumerate(parents):
            pair = found[2 * k : 2 * k + 2]
            # what halving has changed is what was wrong before, and with a kink may be small by chance
            both = [sums for sums, _ in pair]
            error = 0.5 * np.abs(parent.sums - both[0] - both[1])
            off = misfit_of_halves(parent.values, np.concatenate([values for _, values in pair]))
            at_kink = ~(off <= BROKEN_OFF * parent.misfit) | np.isinf(parent.misfit)
            error = np.maximum(error, 0.5 * AT_KINK * parent.sums[0] * np.where(at_kink, off, 0.0))
            if np.all(np.isfinite(parent.error)):
                error = np.maximum(error, FORGOTTEN**4 * parent.error)
            ends = halves[2 * k : 2 * k + 2]
            leaves += [
                Panel(*end, sums, error, values, off) for end, (sums, values) in zip(ends, pair, strict=True)
            ]
    return None


def _most_samples(result: ChaosResult) -> int:
    """Samples that are tried at most."""
    most, plan = MOST_CHEAP_SAMPLES, result.plan
    while most > MOST_SAMPLES:
        way = Way(result.random, points=most)
        of_all = price(
            result.problem, plan.active, result.solver.rows, plan.options, way, result.steps, bool(plan.macro)
        )
        if over_ranks(result, of_all.seconds * speed()) <= CHEAP:
            return most
        most //= 2
    return MOST_SAMPLES


def by_samples(
    result: ChaosResult, quantity: Wanted, target: float, rtol: float
) -> tuple[SampleResult, Errors, tuple[str, ...]]:
    """Calibrated samples, as many as their sets ask for."""
    each, most = LEAST_SAMPLES, _most_samples(result)
    notes: tuple[str, ...] = ()
    space = result.space
    while True:
        sets = [wide_points(space, each, seed) for seed in range(SETS)]
        points = np.concatenate([p for p, _ in sets])
        weights = np.concatenate([calibrated(space, p, w) for p, w in sets]) / SETS
        samples = solved(result, points, weights, rtol, quantity)
        complete(samples)
        values = quantity.at_end(samples, samples)
        value, of_mean, of_std = moments_of_sets(quantity, values, weights, SETS)
        size = size_of(value, quantity)
        whole = whole_of(value, min(rtol, 1e-10), quantity) or size
        nothing = value.mean == 0.0 and not value.std
        relative = np.inf if nothing else max(share_of(of_mean, size), share_of(of_std, whole))
        total = each * SETS
        if relative <= 0.6 * target:
            away = checked_cold(result, samples, quantity, values)
            off = max(share_of(away, size), share_of(away, whole))
            if off <= 0.3 * target or rtol <= 1e-10:
                break
            rtol = max(0.03 * rtol, FINEST)
            continue
        # errors of scrambled points fall like 1 / N at best, more slowly where there are kinks
        factor = 2 ** max(1, min(2, round(log2(relative / (0.5 * target))))) if isfinite(relative) else 4
        known = value.std is not None and share_of(of_std, whole) <= 0.6 * target
        lost = known and size <= of_mean
        # with kinks errors fall like N^-0.8; more points than usual only where they would do
        hopeless = total >= MOST_SAMPLES and not relative * (total / most) ** 0.8 <= 0.6 * target
        if total >= most or hopeless or (lost and total >= ENOUGH_FOR_ZERO):
            away = checked_cold(result, samples, quantity, values)
            notes = (f"{total} samples: more are left to you, see quasi_monte_carlo",)
            if nothing:
                notes += ("no sample has met what makes the quantity differ from 0",)
            elif lost:
                notes += (
                    f"the mean {value.mean:.3g} cannot be told from 0 (+- {of_mean:.1g}, the deviation is "
                    f"{value.std:.3g}): no error is small relative to it; ask for a function that adds what "
                    "the quantity is to be compared with",
                )
            break
        each = min(each * factor, most // SETS)
    unseen = np.inf if nothing else None
    how = f"{SETS} sets of {each} samples"
    truncation = ErrorShare(np.nan, unseen or of_mean, unseen or of_std, how)
    made = of_solved_again(samples, away, truncation, quantity, value, whole)
    seconds = sum(samples.seconds.values())
    halving = f"{2 * total} samples, about {2 * seconds:.2g} s"
    return samples, replace(made, next_halving=halving), notes
