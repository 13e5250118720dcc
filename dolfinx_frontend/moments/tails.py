"""What a quantity does beyond the last points of a rule.

Where a stiffness can come close to 0 the jump under a force grows like a power of the probability u of what
is beyond: q ~ u^-s, with s = 1 / a for laws that begin like k^(a - 1), such as Gamma's and Beta's. Beyond a
point of probability u its square has the integral q^2 u / (1 - 2 s), which no finite rule sees and which is
much where s is near 1/2; from s = 1/2 on there is no finite deviation, from s = 1 on no finite mean. Points
along one germ tell s: log |q| against log u is a straight line far out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.moments.model import Moments, PointModel
from dolfinx_frontend.moments.points import normal_scores
from dolfinx_frontend.moments.validation import TAIL, Witnesses
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import MeanStd

__all__ = ["FINE", "Tail", "beside_tails", "beyond_all", "heavy_tails", "note_of", "seen_to"]

LINE = np.array([2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0])
"""Normal scores of the points along a germ that tell how a quantity grows."""

FINE = 1e-10
"""Their tolerance: how a deviation depends on s near 1/2 takes many digits of it."""

RESOLVED = 1e-4
"""Error of a normal score at most by the rounding of its germ: nearer to an end there are no digits left."""

OF_TARGET = 0.05
"""Share of the target that what is beyond the witnesses may be without being looked at."""

LIKELY = 0.45
"""Power at most that witnesses are taken to say before it is looked at."""

CERTAIN = 1e-7
"""Least doubt of a power."""

LEAST_OF_LAWS = 0.1
"""Power of a random number below which a quantity is taken to have none: it may be inverse to its square."""

SLOW = 0.5
"""Ratio of its changes up to which a power is carried on as a geometric series; above, three times the last
one are doubt."""


class Tail(NamedTuple):
    """How a quantity grows along a germ.

    What a doubt of `power` does is an error; where that reaches 1/2, infinite.
    """

    germ: int
    end: float  # normal score of the last point
    point: Array  # (L,) of the germs
    size: float  # distance of the quantity from its mean there
    power: float  # s: it grows like u^-s
    doubt: float  # error of that

    @property
    def endless(self) -> bool:
        """Whether the deviation is infinite."""
        return self.power - self.doubt >= 0.5

    @property
    def weight(self) -> float:
        """Of the last point, so that it stands for the square of all that is beyond."""
        return float(special.ndtr(-abs(self.end))) / (1.0 - 2.0 * self.power)

    def off(self) -> tuple[float, float]:
        """Errors of the integrals of the quantity and of its square beyond the last point, if it stands for
        them."""
        beyond, s = float(special.ndtr(-abs(self.end))), self.power
        if s + self.doubt >= 0.5:
            return np.inf, np.inf
        first = beyond * self.size * (1.0 / (1.0 - 2.0 * s) - 1.0 / (1.0 - s))
        least = 1.0 / (1.0 - 2.0 * s)
        return first, beyond * self.size**2 * (1.0 / (1.0 - 2.0 * (s + self.doubt)) - least)

    def beyond(self, score: float) -> tuple[float, float]:
        """Integrals of distance from the mean and of its square beyond a normal score, at most."""
        s = max(self.power + self.doubt, 0.0)
        if s >= 0.5:
            return np.inf if s >= 1.0 else 0.0, np.inf
        log_u = float(special.log_ndtr(-abs(score)))
        size = self.size * float(np.exp(self.power * (special.log_ndtr(-abs(self.end)) - log_u)))
        u = float(np.exp(log_u))
        return size * u / (1.0 - s), size**2 * u / (1.0 - 2.0 * s)


def heavy_tails(model: PointModel, seen: Witnesses, value: MeanStd, target: float) -> list[Tail]:
    """Tails that matter at an accuracy: where witnesses let it seem so, points along the germ are solved."""
    space, found = model.space, []
    scores = normal_scores(space, seen.points)
    for germ, continuous in enumerate(space.continuous):
        for side in (-1.0, 1.0) if continuous else ():
            of_line = [_nearest(scores[:, germ], side * at) for at in TAIL]
            known = [k for k in of_line if k is not None and seen.tails[k] > 0.0]
            if len(known) < 2 or not _suspect(scores[known, germ], seen.values[known], value, target):
                continue
            z = np.repeat(scores[known[-1:]], len(LINE), axis=0)
            z[:, germ] = side * LINE
            points = space.from_normal(z)
            away = np.abs(space.to_normal(points)[:, germ] - z[:, germ])
            good = np.logical_and(model.admissible(points), away <= RESOLVED)
            if not good.any():
                continue
            points, z = points[good], z[good, germ]
            if not _steep(model, points, z):
                continue
            tail = _grown(germ, z, points, model(points, FINE).values - value.mean)
            if tail is not None:
                found.append(tail)
    return found


def _steep(model: PointModel, points: Array, scores: Array) -> bool:
    """Whether a random number of the laws changes like a power far out, over the last two points (n, L).

    Only then can a quantity: what a contact does that opens there looks like one, and is a kink.
    """
    if len(points) < 2:
        return True
    least = LEAST_OF_LAWS * abs(float(np.diff(special.log_ndtr(-np.abs(scores[-2:])))[0]))
    values = np.abs(model.numbers(points[-2:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return not bool(np.all(np.abs(np.log(values[:, 1] / values[:, 0])) < least))


def _nearest(scores: Array, wanted: float) -> int | None:
    """The witness at this score; None: there is none."""
    k = int(np.argmin(np.abs(scores - wanted)))
    return k if abs(scores[k] - wanted) <= RESOLVED else None


def _suspect(scores: Array, values: Array, value: MeanStd, target: float) -> bool:
    """Whether what is beyond the last of some witnesses along a germ may matter."""
    size, log_u = np.abs(values - value.mean), special.log_ndtr(-np.abs(scores))
    if not (np.all(np.isfinite(size)) and size[-1] > 0.0):
        return bool(np.any(~np.isfinite(size)))
    with np.errstate(divide="ignore"):
        powers = np.log(size[-1] / size[[0, -2]]) / (log_u[[0, -2]] - log_u[-1])
    s = float(np.clip(powers.max(), 0.0, LIKELY))
    last = abs(scores[-1]) + 0.5 * (TAIL[1] - TAIL[0])
    u = float(special.ndtr(-last))
    square = (size[-1] * np.exp(s * (log_u[-1] - np.log(u)))) ** 2 * u / (1.0 - 2.0 * s)
    return bool(square > 2.0 * OF_TARGET * target * (value.std or 0.0) ** 2)


def _grown(germ: int, scores: Array, points: Array, away: Array) -> Tail | None:
    """The tail that points along a germ tell of; None: there is none."""
    size = np.abs(away)
    good = np.logical_and(np.isfinite(size), size > 0.0)
    if good.sum() < 3:  # differences of powers
        return None
    scores, points, size = scores[good], points[good], size[good]
    powers = np.diff(np.log(size)) / -np.diff(special.log_ndtr(-np.abs(scores)))
    changes = np.diff(powers)
    s, doubt = float(powers[-1]), 3.0 * abs(float(changes[-1]))
    if len(changes) > 1 and changes[-2] != 0.0:
        ratio = float(changes[-1] / changes[-2])
        if 0.0 <= ratio < SLOW:
            rest = float(changes[-1]) * ratio / (1.0 - ratio)
            s, doubt = s + rest, abs(rest)
    if s <= 0.0:
        return None
    return Tail(germ, float(scores[-1]), points[-1], float(size[-1]), s, max(doubt, CERTAIN))


def seen_to(tails: Sequence[Tail], space: RandomSpace, points: Array, few: int = 1) -> list[float]:
    """Normal scores to which points (n, L) of the germs see each tail: only so few are beyond."""
    scores = normal_scores(space, points)
    half = 0.5 * (TAIL[1] - TAIL[0]) if few == 1 else 0.0  # of the piece that a witness stands for
    of_each = [np.sort(np.sign(tail.end) * scores[:, tail.germ]) for tail in tails]
    return [max(float(each[-min(few, len(each))]) + half, 0.0) for each in of_each]


def beyond_all(tails: Sequence[Tail], scores: Sequence[float], value: MeanStd) -> MeanStd:
    """Errors of mean and deviation of what sees each tail to a normal score."""
    std = value.std or 0.0
    of_each = [tail.beyond(score) for tail, score in zip(tails, scores, strict=True)]
    first, square = (float(sum(each[k] for each in of_each)) for k in (0, 1))
    root = float(np.sqrt(square))
    return MeanStd(first, min(square / (2.0 * std), root) if std > 0.0 else root)


def beside_tails(
    found: Moments, tails: Sequence[Tail], space: RandomSpace, points: Array, few: int = 1
) -> Moments:
    """Moments, of which points (n, L) see the tails so far, with the errors of what is beyond."""
    if not tails:
        return found
    off, known = beyond_all(tails, seen_to(tails, space, points, few), found.value), found.truncation
    with_them = replace(
        known,
        quantity=(known.quantity or 0.0) + off.mean,
        std=(known.std or 0.0) + (off.std or 0.0),
        how=f"{known.how}; what is beyond them",
    )
    return replace(found, truncation=with_them)


def note_of(tails: Sequence[Tail], quantity: object, names: Sequence[str]) -> str:
    """What there is to say of deviations that are not finite, or may not be; empty: nothing."""
    steep = max(tails, key=lambda tail: tail.power, default=None)
    if steep is None or steep.power + steep.doubt < 0.5:
        return ""
    what = "deviation" if steep.power < 1.0 else "mean and no finite deviation"
    sure = f"there is no finite {what}" if steep.endless else "it is not sure that the deviation is finite"
    return (
        f"{quantity} grows like p^-{steep.power:.3g} far out along {names[steep.germ]}, where p is the "
        f"probability of what is beyond: {sure} (p^-0.5 has none); ask for a Quantile, or bound the law"
    )
