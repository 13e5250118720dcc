"""Moments by samples, and what stands for the quantity beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite, log2
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.moments.hinges import Hinged, hinged, sides_of
from dolfinx_frontend.moments.lines import Lines, beyond_lines, cost_of_lines, fitted, lines_of
from dolfinx_frontend.moments.model import Evaluations, Keep, Moments, PointModel, confirmed, so_far
from dolfinx_frontend.moments.points import (
    SETS,
    SURE,
    calibrated,
    moments_of_sets,
    normal_scores,
    wide_points,
)
from dolfinx_frontend.moments.tails import Tail, beside_tails
from dolfinx_frontend.moments.validation import (
    MOST_LINES,
    SAFE,
    Witnesses,
    checked_cold,
    far_out,
    with_unmet_states,
)
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import (
    FINEST,
    ErrorShare,
    MeanStd,
    share_of,
    size_of,
    whole_of,
)

__all__ = ["by_samples"]

MOST_SAMPLES, MOST_CHEAP_SAMPLES, CHEAP = 8192, 65_536, 60.0
"""Samples at most, and where so many take less than that many seconds by their price on the core whose
rates it has: how many are taken must not depend on what else the machine does."""

LEAST_SAMPLES = 16
"""Samples of a set that the search begins with."""

ENOUGH_FOR_ZERO = 1024
"""Samples after which a mean that cannot be told from 0 is given up."""

MOST_BESIDE = 2
"""Degree of the polynomials that are integrated exactly beside what stands for a quantity."""

WORTH = 0.9
"""Share of the deviation that is left beside it at most."""

SEEN_TO = 0.05
"""Accuracy from which on points far out judge, too."""

FAR_AWAY, FAR_OUT = 1.0, 1e-3
"""Normal score of what the deviation comes from beyond which it is drawn on its own, and share of the
variance that a point far out lacks of it to be taken for that."""

FEW_BEYOND = 5e-3
"""Probability of the piece of a tail of a germ that hardly a sample is in."""

TELLING = 16
"""Samples that must be beyond a score so that they say what is there."""

HALVINGS = 40
"""Of a range in which a quantile is searched."""

FIRST_COUNT, MOST_COUNT, CHUNK = 1024, 2**18, 2**22
"""Points of a set and of all sets by which what stands for a quantity is integrated, numbers at a time."""

PER_SAMPLE = 128
"""The latter for every sample at most: what costs more than samples do is left to more of these."""

OF_INTEGRAL = 0.2
"""Error of that, relative to the target."""

AT_REST = 5.0
"""Deviations off the mean from which on weights of points of lines, which are right, hardly change."""

FEWER = 8
"""How many times fewer tell by what fits that have not seen a set differ from the one that has."""

FAR = 3.0
"""Times the target that an error may be before it is worked out."""


def _most_samples(model: PointModel) -> int:
    """Samples that are tried at most."""
    most = MOST_CHEAP_SAMPLES
    while most > MOST_SAMPLES and model.seconds(most) > CHEAP:
        most //= 2
    return most


def _drawn(
    space: RandomSpace, each: int, centre: Array | None
) -> tuple[Array, Array, Ints, list[tuple[int, int, int]]]:
    """Points (n, L), weights (n,), numbers of the sets (n,) and names of the points, the same ones in larger
    sets of the same germs."""
    sets = [wide_points(space, each, seed, centre) for seed in range(SETS)]
    counts = [each // 2, each // 2] if centre is None else [each // 2, each // 4, each // 4]
    names = [(k, kind, i) for k in range(SETS) for kind, count in enumerate(counts) for i in range(count)]
    points = np.concatenate([p for p, _ in sets])
    weights = np.concatenate([w / w.sum() for _, w in sets]) / SETS
    labels: Ints = np.repeat(np.arange(SETS, dtype=np.int64), each)
    return points, np.asarray(weights, dtype=np.float64), labels, names


class _Sampled(NamedTuple):
    """What samples say."""

    weights: Array  # (n,) of sum 1
    value: MeanStd
    mean: float
    std: float  # errors of both
    how: str

    @property
    def truncation(self) -> ErrorShare:
        """Both as errors; not known where no sample has met what is asked for."""
        nothing = self.value.mean == 0.0 and not self.value.std
        return ErrorShare(np.nan, np.inf if nothing else self.mean, np.inf if nothing else self.std, self.how)


class _Samples:
    """Sets of samples of a quantity, which grow."""

    def __init__(self, model: PointModel, rtol: float) -> None:
        self.model, self.statistic, self.rtol = model, model.statistic, rtol
        self.space = model.space
        self.centre: Array | None = None
        self.found: Evaluations | None = None
        self.names: list[tuple[int, int, int]] = []
        self.drawn: Array = np.zeros(0)
        self.labels: Ints = np.zeros(0, dtype=np.int64)
        self.each = 0
        self._known: dict[Any, tuple[Array, Array]] = {}
        self._fitted: dict[Any, Array] = {}
        self.lines: Lines | None = None
        self.looked_along = False

    @property
    def solved(self) -> Evaluations:
        """The points."""
        assert self.found is not None
        return self.found

    @property
    def values(self) -> Array:
        """(n,) of the quantity."""
        return self.solved.values

    def grow(self, each: int) -> None:
        """Solve what sets of this size have more."""
        points, weights, labels, names = _drawn(self.space, each, self.centre)
        place = {name: k for k, name in enumerate(names)}
        known = set(self.names)
        new = [name for name in names if name not in known]
        if new:
            at = [place[name] for name in new]
            more = self.model(points[at], self.rtol)
            self.found = more if self.found is None else self.model.joined(self.found, more)
            self.names += new
        order = [place[name] for name in self.names]
        self.drawn, self.labels, self.each = weights[order], labels[order], each

    def tighten(self, rtol: float) -> None:
        """Solve all again."""
        self.rtol, self.found, self.names = rtol, None, []
        self.grow(self.each)

    def look_along(self, more: float, target: float, tails: Sequence[Tail]) -> bool:
        """Whether points along each germ were solved: of linear laws, once, if they are less than so many."""
        possible = self.model.linear and 1 < self.space.dimension <= MOST_LINES
        if self.looked_along or not possible or self.statistic.level is not None:
            return False
        if cost_of_lines(self.space) > more:
            return False
        self.looked_along = True
        spread = self._spread()
        size = size_of(MeanStd(float(self.drawn @ self.values), spread), self.statistic)
        target *= min(share_of(size, spread), 1.0)  # of the deviation, also where the mean is less
        self.lines = lines_of(self.model, target, self.rtol, tails)
        return self.lines is not None

    def so_far(self, said: _Sampled, whole: float) -> Moments:
        """The points with their weights, and what is known of their errors."""
        return so_far(self.with_lines(said), said.weights, said.truncation, said.value, whole)

    def plain(self) -> _Sampled:
        """As they are, polynomials of low degree being exact."""
        weights = np.empty_like(self.drawn)
        for k in range(SETS):
            own = self.labels == k
            weights[own] = calibrated(self.space, self.solved.points[own], self.drawn[own]) / SETS
        value, of_mean, of_std = moments_of_sets(self.statistic, self.values, weights, self.labels)
        return _Sampled(weights, value, of_mean, of_std, f"{SETS} sets of {self.each} samples")

    def fit(self) -> Hinged | None:
        """What stands for the quantity."""
        germs = self.solved.points
        sides = None if self.model.smooth else sides_of(self.model.contacts(self.solved))
        # what is seldom is fitted for more than it weighs: the fit is asked far out, too
        weights = np.sqrt(self.drawn)
        weights /= weights.sum()
        found = hinged(self.space, germs, weights, self.labels, self.values, sides)
        if self.lines is not None:
            along = fitted(self.lines, germs, weights, self.labels, self.values)
            if found is None or (along is not None and along.rest < found.rest):
                found = along
        if found is None:
            return None
        rest = float(np.sqrt(self.drawn @ (self.values - self._unseen(found)) ** 2))
        return found._replace(rest=rest) if rest < WORTH * self._spread() else None

    def _unseen(self, fit: Hinged) -> Array:
        """Values of the fits that have not seen the set of a point."""
        found: Array = fit(self.space, self.solved.points)[np.arange(len(self.labels)), self.labels]
        return found

    def _spread(self) -> float:
        mean = self.drawn @ self.values
        return float(np.sqrt(self.drawn @ (self.values - mean) ** 2))

    def less(self, fit: Hinged, target: float) -> _Sampled:
        """With what stands for the quantity as exact as polynomials are: its expectation is that of many
        points, and sets that a fit has not seen tell what it lacks."""
        self._fitted.clear()
        if self.statistic.level is not None:
            return self._quantile(fit, target, self.statistic.level)
        statistic, known = self.statistic, self.solved.points
        about = float(self.drawn @ self.values), self._spread()
        unseen = self._unseen(fit)
        own, doubts, means = self._corrected(fit, about, self._count_of(fit, about, target), unseen)
        controls, germs = statistic.controls(unseen, *about), known
        every, drawn = self.values, self.drawn
        free: Array | None = None
        if fit.functions is not None and self.lines is not None:
            # what is far out counts in what is expected: points that are there must be in the answer
            at = self.lines.evaluations.points
            of_lines = statistic.controls(fit(self.space, at)[:, -1], *about)
            controls, germs = np.concatenate([controls, of_lines]), np.concatenate([known, at])
            every = np.concatenate([every, self.lines.values])
            drawn = np.concatenate([np.where(self.lines.far(known), 0.0, drawn), self.lines.weights])
            free = np.asarray((1.0 + (controls[:, 0] / AT_REST) ** 2) ** -2.0, dtype=np.float64)
        weights = calibrated(self.space, germs, drawn, (controls, means), MOST_BESIDE, free)
        value = statistic.value(every, weights)
        squares = np.maximum(own[:, 1] - own[:, 0] ** 2, 0.0)
        each = np.column_stack([about[0] + about[1] * own[:, 0], about[1] * np.sqrt(squares)])
        wrong = SURE * each.std(axis=0, ddof=1) / np.sqrt(SETS) + about[1] * np.array([1.0, 0.5]) * doubts
        wrong += np.abs(each.mean(axis=0) - [value.mean, value.std or 0.0])
        return _Sampled(weights, value, float(wrong[0]), float(wrong[1]), self._how(fit))

    def _quantile(self, fit: Hinged, target: float, level: float) -> _Sampled:
        """The value at which the distribution of the fit, and of what it lacks, has the level.

        A sample is on another side of that value than the fit says only where the fit is as near to it as it
        is off: what the sets scatter by is at least what so many samples of that probability do.
        """
        about = self.statistic.value(self.values, self.drawn).mean, self._spread()
        count, unseen = self._count_of(fit, about, target), self._unseen(fit)

        def below(value: float) -> float:
            return float(self._corrected(fit, (value, about[1]), count, unseen)[0].mean())

        lower, upper = float(self.values.min()), float(self.values.max())
        ends = lower - about[1], upper + about[1]
        value = _crossing(below, level, *ends)
        own, doubts, _ = self._corrected(fit, (value, about[1]), count, unseen)
        near = [
            float(self._integrals(fit, (value + off, about[1]), count, slice(SETS, None)).mean())
            for off in (-fit.rest, fit.rest)
        ]
        scatter = max(float(own.std(ddof=1)) / np.sqrt(SETS), np.sqrt((near[1] - near[0]) / len(self.values)))
        slack = SURE * scatter + float(doubts[0])
        off = max(abs(_crossing(below, level + d, *ends) - value) for d in (-slack, slack))
        weights = self._weights_at(value, level)
        found = self.statistic.value(self.values, weights)
        return _Sampled(weights, found, off + abs(found.mean - value), 0.0, self._how(fit))

    def _weights_at(self, value: float, level: float) -> Array:
        """Weights (n,) whose quantile is a value: between its neighbours it is interpolated."""
        ranked = np.argsort(self.values)
        upper = int(np.clip(np.searchsorted(self.values[ranked], value), 1, len(ranked) - 1))
        pair = ranked[[upper - 1, upper]]
        low, high = self.values[pair]
        part = float(np.clip((value - low) / (high - low), 0.0, 1.0)) if high > low else 0.5
        inside = np.asarray(self.values < value, dtype=np.float64)[:, None]
        weights = self.drawn
        for _ in range(2):  # what the neighbours weigh says how much must be below
            one, other = weights[pair]
            below = np.array([level + 0.5 * one - 0.5 * part * (one + other)])
            weights = calibrated(self.space, self.solved.points, self.drawn, (inside, below), MOST_BESIDE)
        return weights

    def _how(self, fit: Hinged) -> str:
        kinks = len(fit.signs)
        beside = f"a polynomial of degree {fit.order}" + (f" with {kinks} kink(s)" if kinks else "")
        if fit.functions is not None:
            beside = f"functions of each germ and their products of degree {fit.order}"
        return f"{SETS} sets of {self.each} samples beside {beside}"

    def _corrected(
        self, fit: Hinged, about: tuple[float, float], count: int, unseen: Array
    ) -> tuple[Array, Array, Array]:
        """Expectations (sets, k) of the controls of the quantity by each set, errors (k,) of the integrals,
        and the expectations (k,) of the controls of the fits; `count`: points of a set of these, 0: none;
        `unseen`: values (n,) of the fits that have not seen the set of a point."""
        means, doubts = self._expected(fit, about, count)
        lacks = self.statistic.controls(self.values, *about)
        lacks = lacks - self.statistic.controls(unseen, *about)
        of_sets = [SETS * self.drawn[self.labels == k] @ lacks[self.labels == k] for k in range(SETS)]
        return means + of_sets, doubts, means.mean(axis=0)

    def _count_of(self, fit: Hinged, about: tuple[float, float], target: float) -> int:
        """Points of a set by which a fit is integrated; 0: none, as a polynomial without kinks is exact where
        it keeps within its range."""
        if not len(fit.signs) and self.statistic.level is None and self._unbounded(fit):
            return 0
        count, most = FIRST_COUNT, min(MOST_COUNT, PER_SAMPLE * len(self.values))
        while count * SETS < most:
            of_all = self._integrals(fit, about, count, slice(SETS, None))
            if _doubts(of_all).max() <= OF_INTEGRAL * target:
                break
            count *= 4
        return count

    def _expected(self, fit: Hinged, about: tuple[float, float], count: int) -> tuple[Array, Array]:
        """Expectations (sets, k) of the controls of every fit but the last one, and errors (k,) of these.

        That of the last one is made by many points, and what the rest differ by, which is little, by fewer.
        """
        if not count:
            first, rest = fit.coefficients[0, 0], np.sum(fit.coefficients[0, 1:] ** 2, axis=0)
            off = (first - about[0]) / about[1]
            return np.column_stack([off, off**2 + rest / about[1] ** 2])[:-1], np.zeros(2)
        of_all = self._integrals(fit, about, count, slice(SETS, None))
        every = self._integrals(fit, about, max(count // FEWER, FIRST_COUNT), slice(None))
        beside = every[:, :-1] - every[:, -1:]
        return of_all.mean(axis=0) + beside.mean(axis=0), _doubts(of_all) + _doubts(beside)

    def _unbounded(self, fit: Hinged) -> bool:
        """Whether a fit keeps within its range at wide points: beyond, it is no polynomial."""
        lower, upper = fit.range
        values = (fit(self.space, self._many(FIRST_COUNT, k)[0]) for k in range(SETS))
        return all(bool(np.all((lower < v) & (v < upper))) for v in values)

    def _integrals(self, fit: Hinged, about: tuple[float, float], count: int, which: slice) -> Array:
        """Means (SETS, fits, k) of the controls of some fits over as many sets of this many points."""
        found = []
        for seed in range(SETS):
            values, weights = self._values_of(fit, count, seed, which), self._many(count, seed)[1]
            found.append(np.einsum("n,nsk->sk", weights, self.statistic.controls(values, *about)))
        return np.array(found)

    def _values_of(self, fit: Hinged, count: int, seed: int, which: slice) -> Array:
        """Values (count, fits) of some fits at the points of a set."""
        key = count, seed, which.start
        if key not in self._fitted:
            points = self._many(count, seed)[0]
            parts = np.array_split(points, max(1, count * fit.coefficients.shape[1] // CHUNK))
            found = []
            for part in parts:
                stop_if_pressed()
                found.append(fit.of_terms(fit.terms(self.space, part), which))
            self._fitted[key] = np.concatenate(found)
        return self._fitted[key]

    def _many(self, count: int, seed: int) -> tuple[Array, Array]:
        """Points of a set by which what stands for the quantity is integrated, and their weights."""
        key = count, seed, None if self.centre is None else tuple(self.centre)
        if key not in self._known:
            points, weights = wide_points(self.space, count, 1000 + seed, self.centre)
            self._known[key] = points, calibrated(self.space, points, weights, most=MOST_BESIDE)
        return self._known[key]

    def about_to_lack(self, fit: Hinged) -> float:
        """About how large the error of the mean will be."""
        return SURE * fit.rest / float(np.sqrt(len(self.values)))

    def with_lines(self, said: _Sampled) -> Evaluations:
        """The points that have weights."""
        if self.lines is not None and len(said.weights) > len(self.values):
            return self.model.joined(self.solved, self.lines.evaluations)
        return self.solved

    def checked(self, said: _Sampled, fit: Hinged | None) -> float:
        """How much points differ that are solved again, those among them that stand out."""
        found, values = self.with_lines(said), self.values
        far = self.lines is not None and len(said.weights) > len(values)
        if self.lines is not None and far:
            values = np.concatenate([values, self.lines.values])
        apart = None if fit is None else values - fit(self.space, found.points)[:, -1]
        if apart is not None and far:
            apart[said.weights == 0.0] = 0.0
        return checked_cold(self.model, found, said.weights / said.weights.sum(), values, apart, tails=far)

    def steepest(self) -> Array:
        """Direction (L,) of the normal scores in which the quantity changes most."""
        z = normal_scores(self.space, self.solved.points)
        along = (self.drawn * (self.values - self.drawn @ self.values)) @ z
        size = float(np.linalg.norm(along))
        return np.asarray(along / size if size > 0.0 else np.eye(1, len(along))[0], dtype=np.float64)

    def seen_far(self, along_germs: bool, seen: Witnesses | None) -> Witnesses:
        """Points where contacts open, along germs, and along the direction of the steepest change."""
        nothing: Array = np.zeros(0)
        found = Witnesses(np.zeros((0, self.space.dimension)), nothing, nothing, nothing)
        if along_germs:
            found = far_out(self.model, self.rtol, self.steepest(), seen)
        return with_unmet_states(self.model, self.solved, found, self.rtol)

    def far(self, seen: Witnesses, fit: Hinged | None, value: MeanStd) -> MeanStd:
        """What points far out lack of what stands for the quantity: errors of mean and deviation.

        Beyond three deviations there are hardly samples, and all that it lacks counts; before, what it lacks
        is in the error of the samples if it is not rare, and its square is what the variance lacks.
        """
        std = value.std or 0.0
        if not len(seen.points):
            return MeanStd(0.0, 0.0)
        guess = np.full(len(seen.points), value.mean) if fit is None else fit(self.space, seen.points)[:, -1]
        rest = seen.values - guess
        size = float(np.sqrt(seen.tails @ rest**2))
        alone = np.where((seen.tails > 0.0) & (seen.tails < FEW_BEYOND), seen.tails, 0.0)
        if not std > 0.0:  # what the samples have not met at all
            return MeanStd(float(seen.tails @ np.abs(rest)), size)
        square = alone @ np.abs((seen.values - value.mean) ** 2 - (guess - value.mean) ** 2)
        of_mean = max(0.5 * size * min(size / std, 1.0), float(alone @ np.abs(rest)))
        of_std = max(SAFE * (float(np.sqrt(std**2 + size**2)) - std), 0.5 * float(square) / std)
        return MeanStd(of_mean, of_std)

    def look_far(self, seen: Witnesses | None, fit: Hinged | None) -> None:
        """Draw where the deviation comes from, if that is far out."""
        if self.centre is not None or not self._spread() > 0.0:
            return
        z = normal_scores(self.space, self.solved.points)
        share = self.drawn * (self.values - self.drawn @ self.values) ** 2
        middle = share @ z / share.sum()
        if seen is not None and fit is not None and len(seen.points):
            rest = seen.tails * (seen.values - fit(self.space, seen.points)[:, -1]) ** 2
            if rest.max() > FAR_OUT * share.sum():
                middle = normal_scores(self.space, seen.points[[int(np.argmax(rest))]])[0]
        if float(np.linalg.norm(middle)) > FAR_AWAY:
            self.centre = middle


def _doubts(integrals: Array) -> Array:
    """(k,) errors of the means of integrals (SETS, fits, k) over the sets: of the fit with the largest."""
    of_fits: Array = SURE * integrals.std(axis=0, ddof=1) / np.sqrt(SETS)
    return np.asarray(of_fits.max(axis=0))


def _crossing(rising: Callable[[float], float], level: float, lower: float, upper: float) -> float:
    """Where a rising function crosses a level, by halving."""
    for _ in range(HALVINGS):
        middle = 0.5 * (lower + upper)
        lower, upper = (lower, middle) if rising(middle) >= level else (middle, upper)
    return 0.5 * (lower + upper)


def by_samples(
    model: PointModel,
    target: float,
    rtol: float,
    seen: Witnesses | None = None,
    keep: Keep = lambda found: None,
    most: int = 0,
    tails: Sequence[Tail] = (),
) -> tuple[Moments, tuple[str, ...]]:
    """Calibrated samples, as many as their sets ask for; `seen` judges what stands for the quantity.

    Of the `tails` samples see little. Where a polynomial stands for the quantity it goes on in them, and is
    judged as far out as the points are that judge it.

    `most`: samples at most, 0: as many as are usual.
    """
    # what few points agree on is not believed to many digits: an event of their inverse number is not seen
    each = LEAST_SAMPLES * (1 if target > 3e-3 else 2 if target > 3e-4 else 8)
    most = most or _most_samples(model)
    notes: tuple[str, ...] = ()
    drawn = _Samples(model, rtol)
    # witnesses of a chaos are solved; else at coarse ones only where contacts open: few samples may be closed
    along_germs = target < SEEN_TO or seen is not None
    judged = model.statistic.level is None and (along_germs or model.may_open)
    far: Witnesses | None = None
    while True:
        drawn.grow(each)
        if tails:
            drawn.look_along(np.inf, target, tails)
        said, fit = drawn.plain(), None
        stands = far_judged = False

        def sizes(value: MeanStd) -> tuple[float, float]:
            size = size_of(value, model.statistic)
            return size, whole_of(value, min(drawn.rtol, 1e-10), model.statistic) or size

        def relative_of(said: _Sampled) -> float:
            size, whole = sizes(said.value)
            return max(share_of(said.mean, size), share_of(said.std, whole))

        keep(drawn.so_far(said, sizes(said.value)[1]))
        nothing = said.value.mean == 0.0 and not said.value.std
        relative = np.inf if nothing else relative_of(said)
        if not nothing and (relative > 0.6 * target or judged):
            fit = drawn.fit()
        if fit is not None and (relative > 0.6 * target or fit.functions is not None):
            size, whole = sizes(said.value)
            about = drawn.about_to_lack(fit)
            ahead = min(share_of(about, size), share_of(about, whole))
            if ahead <= FAR * target or each * SETS >= MOST_SAMPLES:
                said, stands = drawn.less(fit, target), True
                keep(drawn.so_far(said, sizes(said.value)[1]))
                relative = relative_of(said)
            else:
                relative = min(relative, ahead)
        if relative <= 0.6 * target and judged and (fit is not None or not said.value.std):
            if far is None:
                far = drawn.seen_far(along_germs, seen)
            off = drawn.far(far, fit, said.value)
            said = said._replace(mean=said.mean + off.mean, std=said.std + (off.std or 0.0))
            if stands and fit is not None and fit.functions is not None and drawn.lines is not None:
                off = beyond_lines(drawn.lines, tails, fit, far, said.value)
                said = said._replace(mean=said.mean + off.mean, std=said.std + (off.std or 0.0))
            relative, far_judged = relative_of(said), stands and along_germs
        size, whole = sizes(said.value)
        total = each * SETS
        if relative <= 0.6 * target:
            away = drawn.checked(said, fit)
            off_all = max(share_of(away, size), share_of(away, whole))
            if off_all <= 0.3 * target or drawn.rtol <= 1e-10:
                break
            drawn.tighten(max(0.03 * drawn.rtol, FINEST))
            continue
        # errors of scrambled points fall like 1 / N at best, more slowly where there are kinks
        factor = 2 ** max(1, min(2, round(log2(relative / (0.5 * target))))) if isfinite(relative) else 4
        if fit is not None and relative <= 4.0 * target:
            factor = 2  # it gets better with its points, too
        known = said.value.std is not None and share_of(said.std, whole) <= 0.6 * target
        lost = known and size <= said.mean
        # with kinks errors fall like N^-0.8; more points than usual only where they would do
        hopeless = total >= MOST_SAMPLES and not relative * (total / most) ** 0.8 <= 0.6 * target
        if total >= most or hopeless or (lost and total >= ENOUGH_FOR_ZERO):
            away = drawn.checked(said, fit)
            notes = (f"{total} samples: more are left to you, see quasi_monte_carlo",)
            if nothing:
                notes += (
                    f"the quantity is 0 at all {total} samples: it is 0, or no sample has met what makes it "
                    "differ from 0, which samples cannot tell; lf.reliability finds what happens so seldom, "
                    "and how often it does",
                )
            elif lost:
                notes += (
                    f"the mean {said.value.mean:.3g} cannot be told from 0 (+- {said.mean:.1g}, the "
                    f"deviation is {said.value.std:.3g}): no error is small relative to it; ask for a "
                    "function that adds what the quantity is to be compared with",
                )
            break
        if drawn.look_along((factor - 1) * total, target, tails):
            continue
        drawn.look_far(far, fit)
        each = min(each * factor, most // SETS)
    found = drawn.with_lines(said)
    halving = f"{2 * total} samples, about {2 * found.seconds:.2g} s"
    made = confirmed(found, said.weights, away, said.truncation, said.value, whole, halving)
    seen_by = (far.points, 1) if far is not None and far_judged else (found.points, TELLING)
    along = stands and fit is not None and fit.functions is not None and drawn.lines is not None
    left = [tail for tail in tails if not (along and drawn.lines and tail.germ in drawn.lines.known)]
    return beside_tails(made, left, model.space, *seen_by), notes
