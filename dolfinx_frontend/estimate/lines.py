"""What a quantity does along each germ, as what stands for it where it is integrated.

The displacement of springs in series is a sum of functions of one germ each, and with a random load a product
with such a sum. Where 1 / k is skewed no polynomial of low degree is close to it, and samples hardly see where
its deviation comes from. Points along one germ, all others at their medians, tell its function g whole: in the
normal score it is smooth, and piecewise polynomials of asinh((g - middle) / scale) are as right far out, where
g grows like an exponential, as near the middle. Made orthonormal with polynomials of the score, products of
such functions of several germs have known means and variances, in which what is beyond the last point counts,
too. How well a sum of them fits is told by samples, as of polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.hinges import PER_TERM, Hinged, Terms, without_each
from dolfinx_frontend.estimate.points import FARTHEST, SAFE, Witnesses, lawful, normal_scores, solved
from dolfinx_frontend.estimate.tails import Tail
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import MeanStd
from dolfinx_frontend.results.resultant import Wanted
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["Lines", "beyond_lines", "cost_of_lines", "fitted", "lines_of"]

ENDS = (-FARTHEST, -4.5, -1.5, 1.5, 4.5, FARTHEST)
"""Ends of the pieces of a normal score."""

COARSE, FINE_POINTS, FINE_TO = 6, 8, 3e-3
"""Gauss points of a piece, and the accuracy below which there are more: a function is off by 2e-3 and 1e-4 of
its deviation (inverses of gamma, lognormal and Weibull variables)."""

MOST_ATOMS = 200
"""Values at most of a discrete germ that are all solved."""

HIGHEST = 3
"""Degree of the polynomials of a score beside the function."""

MOST_ORDER = 4
"""Highest degree of products, in which a function of one germ counts as 1."""

OWN = 1e-6
"""Share of a function above which it is no combination of others."""

FAR = 2.5
"""Normal score from which on points of the lines are part of the answer: hardly a sample is there."""


class _Along(NamedTuple):
    """Functions of one germ, orthonormal with 1 for what its points stand for."""

    raw: Callable[[Array, Array], Array]  # (n, k) of the germ (n,) and its normal score (n,); the first is 1
    mixing: Array  # (k, functions): orthonormal functions are raw @ mixing
    degrees: Ints  # (functions,)

    def __call__(self, points: Array, scores: Array) -> Array:
        return self.raw(points, scores) @ self.mixing


class Lines(NamedTuple):
    """Functions of each germ, and the points that told them.

    Attributes
    ----------
    samples, values, weights
        The points, the quantity there (n,), and the probability that each stands for (n,): far out, 0 where
        other samples are.
    known
        Germs along which the quantity is known to the end of its tails.
    """

    space: RandomSpace
    along: tuple[_Along, ...]
    samples: SampleResult
    values: Array
    weights: Array
    known: frozenset[int]

    def table(self, order: int) -> list[tuple[int, ...]]:
        """Products up to a degree: of each germ the number of its function, 0 for none."""
        found: list[tuple[tuple[int, ...], int]] = [((), 0)]
        for each in self.along:
            choices = [(0, 0), *((k + 1, int(d)) for k, d in enumerate(each.degrees))]
            found = [(f + (k,), d + e) for f, d in found for k, e in choices if d + e <= order]
        return [f for f, _ in sorted(found, key=lambda one: one[1])]

    def degrees(self, order: int) -> Ints:
        """(terms,) degree of each product."""
        of = [np.concatenate([[0], each.degrees]) for each in self.along]
        return np.array(
            [sum(int(d[k]) for d, k in zip(of, f, strict=True)) for f in self.table(order)], dtype=np.int64
        )

    def __call__(self, points: Array, order: int) -> Array:
        """All products (n, terms) up to a degree at points (n, L) of the germs."""
        scores = normal_scores(self.space, points)
        table = np.array(self.table(order))
        out: Array = np.ones((len(points), len(table)))
        for germ, each in enumerate(self.along):
            own = np.column_stack([np.ones(len(points)), each(points[:, germ], scores[:, germ])])
            out *= own[:, table[:, germ]]
        return out

    def far(self, points: Array) -> Flags:
        """Which points (n, L) lie where those of the lines are that stand for something."""
        scores = np.abs(normal_scores(self.space, points)[:, sorted(self.known)])
        return np.any(scores > FAR, axis=1)


def cost_of_lines(space: RandomSpace, target: float) -> int:
    """Points that all lines have."""
    count = (len(ENDS) - 1) * _points(target)
    atoms = (g.capacity or 0 for g, c in zip(space.germs, space.continuous, strict=True) if not c)
    return count * sum(space.continuous) + sum(each for each in atoms if each <= MOST_ATOMS)


def _points(target: float) -> int:
    return COARSE if target > FINE_TO else FINE_POINTS


def lines_of(
    result: ChaosResult,
    quantity: Wanted,
    target: float,
    rtol: float,
    tails: Sequence[Tail],
    complete: Callable[[SampleResult], None],
) -> Lines | None:
    """Solve points along each germ, all others at their medians; None: these make no laws, or no sense.

    The last point of each of the `tails` stands for all that is beyond.
    """
    space = result.space
    middle = space.from_normal(np.zeros((1, space.dimension)))[0]
    germs, masses, scores = [], [], []
    for germ, continuous in enumerate(space.continuous):
        at, mass, score = _of_continuous(space, germ, tails, _points(target))
        if not continuous:
            at, mass, score = _of_atoms(space, germ)
        points = np.tile(middle, (len(at), 1))
        points[:, germ] = at
        if not len(at) or not np.all(np.isfinite(points)) or not np.all(lawful(result.random, points)):
            points, mass, score = points[:0], mass[:0], score[:0]
        germs.append(points)
        masses.append(mass)
        scores.append(score)
    if not sum(map(len, germs)):
        return None
    try:
        samples = solved(result, np.concatenate(germs), np.ones(sum(map(len, germs))), rtol, quantity)
    except SceneError:
        return None
    complete(samples)
    values = quantity.at_end(samples, samples)
    first = np.cumsum([0, *map(len, germs)])
    along, known = [], set()
    for germ, mass in enumerate(masses):
        own = values[first[germ] : first[germ + 1]]
        if not np.all(np.isfinite(own)):
            own, mass = own[:0], mass[:0]
        if len(own):
            known.add(germ)
        along.append(_functions(space, germ, germs[germ][:, germ], scores[germ], mass, own, _points(target)))
    far = (np.abs(np.concatenate(scores)) > FAR) & np.isfinite(values)
    weights = np.where(far, np.concatenate(masses), 0.0)
    return Lines(space, tuple(along), samples, np.where(far, values, 0.0), weights, frozenset(known))


def _of_continuous(
    space: RandomSpace, germ: int, tails: Sequence[Tail], points: int
) -> tuple[Array, Array, Array]:
    """Values of a germ (n,), the probability that each stands for, and its normal score."""
    own = {float(np.sign(tail.end)): tail for tail in tails if tail.germ == germ}
    ends = np.array(ENDS)
    for side, tail in own.items():
        ends[0 if side < 0.0 else -1] = tail.end
    at, weights = np.polynomial.legendre.leggauss(points)
    half = 0.5 * np.diff(ends)[:, None]
    z = (ends[:-1, None] + half * (1.0 + at)).ravel()
    mass = (half * weights).ravel() * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    z = np.concatenate([z, [tail.end for tail in own.values()]])
    mass = np.concatenate([mass, [tail.weight for tail in own.values()]])
    scores = np.zeros((len(z), space.dimension))
    scores[:, germ] = z
    return space.from_normal(scores)[:, germ], mass, z


def _of_atoms(space: RandomSpace, germ: int) -> tuple[Array, Array, Array]:
    """The same of all values of a discrete germ; none if there are too many."""
    found, nothing = space.atoms(germ), np.zeros(0)
    if found is None or len(found[0]) > MOST_ATOMS:
        return nothing, nothing, nothing
    values, probabilities = found
    points = np.zeros((len(values), space.dimension))
    points[:, germ] = values
    return values, probabilities, normal_scores(space, points)[:, germ]


def _functions(
    space: RandomSpace, germ: int, points: Array, scores: Array, mass: Array, values: Array, count: int
) -> _Along:
    """The quantity along a germ and polynomials beside it; without values (n,) at its points, these alone."""
    family = space.germs[germ]
    if not space.continuous[germ]:
        highest = min(HIGHEST, (family.capacity or 1) - 1)
        if not len(values):
            return _Along(
                lambda p, z: family.evaluate(np.ascontiguousarray(p), highest)[:, 1:],
                np.eye(highest),
                np.arange(1, highest + 1),
            )
        between = 0.5 * (points[1:] + points[:-1])  # which rise

        def of_discrete(p: Array, z: Array) -> Array:
            own = family.evaluate(np.ascontiguousarray(p), highest)
            return np.column_stack([own[:, 0], values[np.searchsorted(between, p)], own[:, 1:]])

        return _orthonormal(of_discrete, points, scores, mass)

    def polynomials(z: Array) -> Array:
        return np.polynomial.hermite_e.hermevander(z, HIGHEST)

    if not len(values):
        size = np.sqrt([1.0, 2.0, 6.0][:HIGHEST])
        return _Along(lambda p, z: polynomials(z)[:, 1:] / size, np.eye(HIGHEST), np.arange(1, HIGHEST + 1))
    inside = (len(ENDS) - 1) * count
    g, w = values[:inside], mass[:inside] / mass[:inside].sum()
    mean = float(w @ g)
    middle, scale = float(np.interp(0.0, scores[:inside], g)), float(np.sqrt(w @ (g - mean) ** 2))
    if not scale > 0.0:
        return _functions(space, germ, points[:0], scores[:0], mass[:0], values[:0], count)
    ends = np.array(ENDS)
    ends[0], ends[-1] = _ends(scores[:inside], count)
    at, _ = np.polynomial.legendre.leggauss(count)
    heights = np.arcsinh((g - middle) / scale).reshape(-1, count) @ np.linalg.inv(np.vander(at, count)).T

    def of_score(p: Array, z: Array) -> Array:
        within = np.clip(z, ends[0], ends[-1])
        piece = np.clip(np.searchsorted(ends, within) - 1, 0, len(ends) - 2)
        t = 2.0 * (within - ends[piece]) / (ends[piece + 1] - ends[piece]) - 1.0
        height = np.sum(np.vander(t, count) * heights[piece], axis=1)
        own = polynomials(z)
        return np.column_stack([own[:, 0], middle + scale * np.sinh(height), own[:, 1:]])

    return _orthonormal(of_score, points, scores, mass)


def _ends(scores: Array, count: int) -> tuple[float, float]:
    """Ends of the first and of the last piece by their Gauss points."""
    at, _ = np.polynomial.legendre.leggauss(count)
    lower, upper = scores[:count], scores[-count:]
    first = ENDS[1] - 2.0 * (ENDS[1] - lower[0]) / (1.0 - at[0])
    last = ENDS[-2] + 2.0 * (upper[-1] - ENDS[-2]) / (1.0 + at[-1])
    return first, last


def _orthonormal(raw: Callable[[Array, Array], Array], points: Array, scores: Array, mass: Array) -> _Along:
    """Functions made orthonormal for what points stand for, without those that are combinations of others."""
    share = mass / mass.sum()
    found = raw(points, scores)
    degrees = [0, 1, *range(1, found.shape[1] - 1)]
    columns: list[Array] = []
    of: list[int] = []
    for k in range(found.shape[1]):
        mix = np.eye(1, found.shape[1], k)[0]
        size = float(np.sqrt(share @ found[:, k] ** 2))
        for _ in range(2):  # twice is enough
            own = found @ mix
            mix = mix - sum(((share @ (own * (found @ c))) * c for c in columns), np.zeros(len(mix)))
        left = float(np.sqrt(share @ (found @ mix) ** 2))
        if left > OWN * size:
            columns.append(mix / left)
            of.append(degrees[k])
    return _Along(raw, np.stack(columns[1:], axis=1), np.array(of[1:], dtype=np.int64))


def fitted(
    lines: Lines, points: Array, weights: Array, labels: Ints, values: Array
) -> Hinged | None:
    """Sums of products of functions of one germ through values (n,) at points (n, L), of the degree that serves
    best; None: too few points. `weights`, `labels`: as of :func:`hinges.hinged`."""
    sets = int(labels.max()) + 1
    mean = float(weights @ values)
    spread = float(np.sqrt(weights @ (values - mean) ** 2))
    best: Hinged | None = None
    for order in range(1, MOST_ORDER + 1):
        degrees = lines.degrees(order)
        if not spread > 0.0 or PER_TERM * len(degrees) > len(values):
            break
        terms = Terms(lines(points, order), degrees, weights, (values - mean) / spread)
        found = without_each(terms, [], order, labels, sets, (-np.inf, np.inf))
        if found is not None and (best is None or found.rest < best.rest):
            best = found
    if best is None:
        return None
    coefficients = spread * best.coefficients
    coefficients[0, 0] += mean
    return best._replace(coefficients=coefficients, rest=spread * best.rest, functions=lines)


def beyond_lines(
    lines: Lines, tails: Sequence[Tail], fit: Hinged, seen: Witnesses, value: MeanStd
) -> MeanStd:
    """Errors of mean and deviation by what is beyond the last points of a fit to lines: as far as the powers of
    the tails are not known, and as much of it as the last witnesses along a germ say that the fit is off."""
    first = square = 0.0
    scores = normal_scores(lines.space, seen.points)
    off = np.abs(seen.values - fit(lines.space, seen.points)[:, -1])
    for tail in tails:
        if tail.germ not in lines.known:
            continue
        of_doubt = tail.off()
        outer = np.argsort(-np.sign(tail.end) * scores[:, tail.germ])[:2]
        away = np.abs(seen.values[outer] - value.mean)
        share = min(float(np.max(off[outer] / np.maximum(away, 1e-300), initial=0.0)), 1.0)
        reach = float(np.max(np.abs(scores[outer, tail.germ]), initial=0.0))
        of_rest = tail.beyond(reach)
        first += SAFE * of_doubt[0] + share * of_rest[0]
        square += SAFE * of_doubt[1] + share * (2.0 + share) * of_rest[1]
    std = value.std or 0.0
    root = float(np.sqrt(square))
    return MeanStd(first, min(square / (2.0 * std), root) if std > 0.0 else root)
