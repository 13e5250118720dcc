"""What the modes that random fields leave out do to a quantity."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.moments.model import PointModel
from dolfinx_frontend.uncertainty.space import latin_points
from dolfinx_frontend.uncertainty.statistics import MeanStd, share_of, size_of

__all__ = ["FullFields", "Lost", "beside_fields", "lost_of_fields"]

PAIRS, MOST_PAIRS, MOST_PAIRS_NONLINEAR = 32, 128, 32
"""Pairs of samples of what a truncated field leaves out: first, and at most, of linear laws and of others."""

OF_LOST, OF_TARGET = 0.25, 0.1
"""What a standard error of them may be: of what they tell, or of the accuracy."""

ALONG = 1.0
"""See `_lost`."""

SHARED = 4
"""Pairs with the same lost modes and others of the rest: what these do alike says nothing of a deviation."""

LEAST_BESIDE_FIELDS = 0.5
"""See `beside_fields`."""


class Lost(NamedTuple):
    """What truncated fields lack, relative to mean and deviation of a quantity, and which fields."""

    mean: float
    std: float
    of: str

    @property
    def largest(self) -> float:
        """The larger of both."""
        return float(np.fmax(self.mean, self.std))


class FullFields(NamedTuple):
    """The same number with more modes of its fields.

    Attributes
    ----------
    model
        Whose germs are those of the truncated fields and of the modes that these leave out.
    beyond
        How much more all modes do than those that are there.
    of
        The fields.
    """

    model: PointModel
    beyond: float
    of: str


def lost_of_fields(
    model: PointModel, full: FullFields, rtol: float, value: MeanStd, target: float = 0.0
) -> Lost:
    """What the modes that fields leave out do to a quantity.

    Samples of the fields as they are and with all modes that their points resolve, in antithetic pairs, until
    their scatter is small beside what they tell or beside `target`, the accuracy that is asked for. Few
    points do not resolve all modes: the others do as much more as they have of the variance.
    """
    rng = np.random.default_rng(0)
    own, pairs = model.space, PAIRS
    names = list(full.model.space.germ_names)
    known = [names.index(name) for name in own.germ_names]
    lost = np.setdiff1d(np.arange(len(names)), known)
    base: Array = np.zeros(0)
    change: Array = np.zeros((2, 0))
    size, whole = size_of(value, model.statistic), max(value.std or 0.0, model.statistic.compared.least)
    while True:
        points = own.from_uniform(latin_points(own.dimension, pairs, rng))
        at = np.zeros((pairs, full.model.space.dimension))
        # of one side of zero, as the pairs have both: what few lost modes do goes with their squares
        sides = rng.choice([-1.0, 1.0], (pairs // SHARED, len(lost)))
        sizes = special.ndtri(0.5 + 0.5 * latin_points(len(lost), pairs // SHARED, rng))
        at[:, lost] = np.repeat(sides * sizes, SHARED, axis=0)
        other = at.copy()
        other[:, lost] *= -1.0
        for block in (at, other):
            block[:, known] = points
        both = np.concatenate([at, other])
        good = np.logical_and(*np.split(full.model.admissible(both), 2))
        good = np.repeat(good.reshape(-1, SHARED).all(axis=1), SHARED)
        if not good.any():
            return Lost(np.nan, np.nan, "fields")
        here = model(points[good], rtol).values
        with_all = full.model(both[np.tile(good, 2)], rtol).values
        base = np.concatenate([base, here])
        change = np.hstack([change, with_all.reshape(2, -1) - here])
        found, doubts = _lost(base, change, size, value.std or 0.0)
        told, doubt = (max(share_of(x.mean, size), share_of(x.std or 0.0, whole)) for x in (found, doubts))
        most = MOST_PAIRS if model.linear else MOST_PAIRS_NONLINEAR
        # of what is more than is asked in any case less has to be known
        wanted = max(OF_LOST * told * (2.0 if told > 2.0 * target else 1.0), OF_TARGET * target)
        enough = not doubt > wanted
        if enough or 2 * len(base) > most:
            break
        pairs = len(base)  # as many again
    of_mean = share_of(found.mean + doubts.mean, size)
    of_std = share_of((found.std or 0.0) + (doubts.std or 0.0), whole)
    return Lost(full.beyond * of_mean, full.beyond * of_std, full.of)


def beside_fields(target: float, lost: Lost | None) -> float:
    """What fields leave of an accuracy for all other errors: `LEAST_BESIDE_FIELDS` of it at least."""
    if lost is None or not isfinite(lost.largest):
        return target
    return max(target - lost.largest, LEAST_BESIDE_FIELDS * target)


def _lost(base: Array, change: Array, size: float, std: float) -> tuple[MeanStd, MeanStd]:
    """Sizes of the changes of mean and deviation by pairs, and what a standard error adds: the quantity
    without the lost modes (n,) and its changes (2, n), in groups of `SHARED` with the same lost modes.

    The variance grows by that of the lost modes themselves, and by what they do more at some values of the
    others than at other ones. Unless it is plain, this is taken for at most `ALONG` times what they do to the
    mean, relative to deviation and mean: as where they act like a factor.
    """
    base, change = base.reshape(-1, SHARED), change.reshape(2, -1, SHARED)
    shift = change.mean(axis=0)
    means, squares = shift.mean(axis=1), np.mean(change**2, axis=(0, 2))
    # what a draw of the lost modes does at all points of its group goes with none of them
    apart = (shift - means[:, None]) * (base - base.mean(axis=1)[:, None])
    along = apart.sum(axis=1) / (SHARED - 1)

    def sure(values: Array) -> tuple[float, float]:
        # of draws that were independent: strata leave less, but for what modes do together
        doubt = float(values.std(ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else np.inf
        return float(values.mean()), doubt

    def of_variance(change: float) -> float:
        return abs(float(np.sqrt(max(std**2 + change, 0.0))) - std)

    (mean, of_mean), (added, of_squares), (with_others, of_others) = map(sure, (means, squares, along))
    least = max(abs(with_others) - of_others, 0.0)
    most = min(abs(with_others) + of_others, max(least, ALONG * share_of(abs(mean) + of_mean, size) * std**2))
    known = max(of_variance(added + 2.0 * sign * least) for sign in (-1.0, 1.0))
    at_most = max(of_variance(added + of_squares + 2.0 * sign * most) for sign in (-1.0, 1.0))
    return MeanStd(abs(mean), known), MeanStd(of_mean, max(at_most - known, 0.0))
