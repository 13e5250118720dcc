"""Moments by Gauss rules on pieces of one germ."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.moments.model import Evaluations, Keep, Moments, PointModel, confirmed, so_far
from dolfinx_frontend.moments.points import (
    FIRST_PANELS,
    POINTS,
    Panel,
    kinks_at_ends,
    misfit_of_halves,
    panel_points,
)
from dolfinx_frontend.moments.tails import FINE, Tail
from dolfinx_frontend.moments.validation import Witnesses, checked_cold, off_witnesses
from dolfinx_frontend.uncertainty.statistics import ErrorShare, MeanStd, share_of, size_of, whole_of

__all__ = ["by_panels"]

MOST_HALVINGS = 16
"""Times that pieces of a germ are halved."""

FORGOTTEN = 0.5
"""Weight of the change of the rule before: with a kink, a change can be small by chance."""

BROKEN_OFF = 1.0 / 6.0
"""A polynomial of a piece of a germ is off by a sixteenth when the piece is halved, at a kink by a half:
above this it is a kink."""

AT_KINK = 0.15
"""Error of the sum over a piece with a kink, relative to how far its polynomial is off: four points, measured
for kinks everywhere in the piece."""

MOST_RULE = 2048
"""Points of pieces at most."""


def by_panels(
    model: PointModel,
    target: float,
    rtol: float,
    seen: Witnesses,
    keep: Keep,
    tails: Sequence[Tail] = (),
) -> Moments | None:
    """Gauss rules on pieces of one germ, which are halved around kinks and where witnesses differ from them;
    None: they do not converge.

    The last point of each of the `tails` stands for all that is beyond.
    """
    space, statistic = model.space, model.statistic
    every: list[Evaluations] = []  # all points, in one piece
    first: dict[tuple[float, float], int] = {}  # of the points of a piece
    if tails:
        rtol = min(rtol, FINE)
    ended = {float(np.sign(tail.end)): tail.end for tail in tails}
    lower, upper = ended.get(-1.0, FIRST_PANELS[0]), ended.get(1.0, FIRST_PANELS[-1])
    more_points = np.array([tail.point for tail in tails]).reshape(-1, 1)
    more_weights = np.array([tail.weight for tail in tails])
    beyond: Array = np.zeros(3)
    of_beyond: Array = np.zeros(3)
    if tails:
        every.append(model(more_points, rtol))
        beyond = np.array([float(more_weights @ every[0].values**k) for k in range(3)])
        of_beyond = np.sum([[tail.weight, *tail.off()] for tail in tails], axis=0)

    def integrated(ends: list[tuple[float, float]]) -> list[tuple[Array, Array]]:
        z, weights = panel_points(ends)
        more = model(space.from_normal(z.reshape(-1, 1)), rtol)
        known = len(every[0].points) if every else 0
        first.update({end: known + k * POINTS for k, end in enumerate(ends)})
        every[:] = [model.joined(every[0], more) if every else more]
        values = more.values.reshape(z.shape)
        powers = (np.ones_like(values), values, values**2)
        sums = [np.array([float(w @ p[k]) for p in powers]) for k, w in enumerate(weights)]
        return list(zip(sums, values, strict=True))

    ends = list(pairwise([lower, *(z for z in FIRST_PANELS if lower < z < upper), upper]))
    unknown = np.full(3, np.inf)
    leaves = [
        Panel(*end, sums, unknown, values, unknown)
        for end, (sums, values) in zip(ends, integrated(ends), strict=True)
    ]
    for _ in range(MOST_HALVINGS):
        total = np.sum([leaf.sums for leaf in leaves], axis=0) + beyond
        mean = float(total[1] / total[0])
        value = MeanStd(mean, float(np.sqrt(max(total[2] / total[0] - mean**2, 0.0))))
        size = size_of(value, statistic)
        whole = whole_of(value, min(rtol, 1e-10), statistic) or size

        def relative(wrong: Array, value: MeanStd = value, whole: float = whole) -> tuple[float, float]:
            """Errors of mean and deviation, of those of the moments."""
            if not np.all(np.isfinite(wrong)):
                return np.inf, np.inf
            of_mean = wrong[1] + wrong[0] * abs(value.mean)
            square = wrong[2] + 2.0 * abs(value.mean) * wrong[1] + wrong[0] * value.mean**2
            std = value.std or 0.0
            return float(of_mean), float(min(square / (2.0 * std), np.sqrt(square)) if std > 0.0 else square)

        wrong = [leaf.error for leaf in leaves]
        if not model.smooth:
            more = zip(kinks_at_ends(leaves), off_witnesses(leaves, seen, space), strict=True)
            wrong = [error + at_kinks + beside for error, (at_kinks, beside) in zip(wrong, more, strict=True)]
        of_mean, of_std = relative(np.sum(wrong, axis=0))
        of_tails = relative(of_beyond)
        if value.mean == 0.0 and not value.std and np.isfinite(of_mean):
            return None  # nothing happens at any point
        _, weights = panel_points([(leaf.lower, leaf.upper) for leaf in leaves])
        how = f"the change by the last halving of {len(leaves)} pieces of the germ"
        if tails:
            how += " and what is beyond them, of which its last point tells"
        truncation = ErrorShare(np.nan, of_mean + of_tails[0], of_std + of_tails[1], how)
        found = every[0]
        rule = np.zeros(len(found.points))  # none of pieces that were halved
        rule[: len(tails)] = more_weights
        for leaf, own in zip(leaves, weights, strict=True):
            at = first[leaf.lower, leaf.upper]
            rule[at : at + POINTS] = own
        rule /= rule.sum()
        keep(so_far(found, rule, truncation, value, whole))
        if max(share_of(of_mean, size), share_of(of_std, whole)) <= 0.5 * target:
            value = statistic.value(found.values, rule)
            away = checked_cold(model, found, rule, found.values, tails=bool(tails))
            if not away <= 0.3 * target * min(size_of(value, statistic), whole):
                return None
            halving = f"half the pieces, about {2.0 * found.seconds:.2g} s"
            return confirmed(found, rule, away, truncation, value, whole, halving)
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
        of_halves = integrated(halves)
        parents = [leaf for leaf, cut in zip(leaves, split, strict=True) if cut]
        leaves = [leaf for leaf, cut in zip(leaves, split, strict=True) if not cut]
        for k, parent in enumerate(parents):
            pair = of_halves[2 * k : 2 * k + 2]
            # what halving has changed is what was wrong before, and with a kink may be small by chance
            both = [sums for sums, _ in pair]
            error = 0.5 * np.abs(parent.sums - both[0] - both[1])
            off = misfit_of_halves(parent.values, np.concatenate([values for _, values in pair]))
            at_kink = ~(off <= BROKEN_OFF * parent.misfit) | np.isinf(parent.misfit)
            if not model.smooth:
                error = np.maximum(error, 0.5 * AT_KINK * parent.sums[0] * np.where(at_kink, off, 0.0))
            if np.all(np.isfinite(parent.error)):
                error = np.maximum(error, FORGOTTEN**4 * parent.error)
            ends = halves[2 * k : 2 * k + 2]
            leaves += [
                Panel(*end, sums, error, values, off) for end, (sums, values) in zip(ends, pair, strict=True)
            ]
    return None
