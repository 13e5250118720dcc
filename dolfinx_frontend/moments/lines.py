"""What a quantity does along each germ, as what stands for it where it is integrated.

The displacement of springs in series is a sum of functions of one germ each, and with a random load a
product with such a sum. Where 1 / k is skewed no polynomial of low degree is close to it, and samples hardly
see where its deviation comes from. Points along one germ, all others at their medians, tell its function g
whole: in the normal score it is smooth, and piecewise polynomials of asinh((g - middle) / scale) are as right
far out, where g grows like an exponential, as near the middle. Orthonormal with polynomials of the score,
products of such functions of several germs have known means and variances, in which what is beyond the last
point counts, too. How well a sum of them fits is told by samples, as of polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.moments.hinges import PER_TERM, Hinged, Terms, without_each
from dolfinx_frontend.moments.model import Evaluations, PointModel
from dolfinx_frontend.moments.points import FARTHEST, normal_scores
from dolfinx_frontend.moments.tails import Tail
from dolfinx_frontend.moments.validation import SAFE, Witnesses
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import MeanStd

__all__ = ["Lines", "beyond_lines", "cost_of_lines", "fitted", "lines_of"]

ENDS = (-FARTHEST, -4.5, -1.5, 1.5, 4.5, FARTHEST)
"""Ends of the pieces of a normal score."""

GAUSS = 6
"""Gauss points of a piece."""

HALVINGS, OF_LINE = 4, 0.3
"""Times that pieces are halved at most; the error of a piece above which one is, over the accuracy."""

MOST_ATOMS = 200
"""Values at most of a discrete germ that are all solved."""

HIGHEST = 3
"""Degree of the polynomials of a score beside the function."""

MOST_ORDER = 4
"""Highest degree of products, in which a function of one germ counts as 1."""

OWN = 1e-3
"""Share of a function above which it is no combination of others, and which enlarges errors of pieces."""

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
    evaluations, values, weights
        The points, the quantity there (n,), and the probability that each stands for (n,): far out, 0 where
        other samples are.
    known
        Germs along which the quantity is known to the end of its tails.
    """

    space: RandomSpace
    along: tuple[_Along, ...]
    evaluations: Evaluations
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
        return np.asarray(np.any(scores > FAR, axis=1), dtype=np.bool_)


def cost_of_lines(space: RandomSpace) -> int:
    """About how many points all lines have."""
    atoms = [len(found[0]) for found in map(space.atoms, range(space.dimension)) if found is not None]
    return (len(ENDS) - 1) * GAUSS * sum(space.continuous) + sum(each for each in atoms if each <= MOST_ATOMS)


class _Piece(NamedTuple):
    """Points of a germ that are solved together."""

    germ: int
    points: Array  # (n, L) of the germs
    scores: Array  # (n,) normal scores of the germ
    mass: Array  # (n,) probability that each stands for
    ends: tuple[float, float] | None  # normal scores between which they are Gauss points; None: they are not
    values: Array = np.zeros(0)  # (n,) of the quantity
    first: int = 0  # number of the first one of them


def lines_of(model: PointModel, target: float, rtol: float, tails: Sequence[Tail]) -> Lines | None:
    """Solve points along each germ, all others at their medians; None: there are none that make laws.

    Pieces of a germ are halved where polynomials are not as right as an accuracy `target` asks for. The last
    point of each of the `tails` stands for all that is beyond.
    """
    space = model.space
    new: list[_Piece] = []
    for germ in range(space.dimension):
        found = _pieces(space, germ, tails)
        every = [each.points for each in found]
        if all(np.all(np.isfinite(each)) and np.all(model.admissible(each)) for each in every):
            new += found
    solved: Evaluations | None = None
    pieces: list[_Piece] = []
    for halved in range(1 + HALVINGS):
        if not new:
            break
        points = np.concatenate([each.points for each in new])
        more = model(points, rtol)
        values, at = more.values, 0 if solved is None else len(solved.points)
        solved = more if solved is None else model.joined(solved, more)
        for each in new:
            own, values = np.split(values, [len(each.points)])
            pieces.append(each._replace(values=own, first=at))
            at += len(own)
        bad = {each.germ for each in pieces if not np.all(np.isfinite(each.values))}
        pieces = [each for each in pieces if each.germ not in bad]
        rough = _rough(pieces, OF_LINE * target) if halved < HALVINGS else []
        pieces = [each for each in pieces if not any(each is other for other in rough)]
        new = [half for each in rough for half in _halves(space, each)]
    if solved is None or not pieces:
        return None
    own_pieces = ([each for each in pieces if each.germ == germ] for germ in range(space.dimension))
    along = tuple(_functions(space, germ, found) for germ, found in enumerate(own_pieces))
    known, weights = np.zeros((2, len(solved.points)))
    for each in pieces:
        part = slice(each.first, each.first + len(each.points))
        known[part], weights[part] = each.values, np.where(np.abs(each.scores) > FAR, each.mass, 0.0)
    return Lines(space, along, solved, known, weights, frozenset(each.germ for each in pieces))


def _piece(space: RandomSpace, germ: int, lower: float, upper: float) -> _Piece:
    """Gauss points between two normal scores of a germ."""
    at, weights = np.polynomial.legendre.leggauss(GAUSS)
    half = 0.5 * (upper - lower)
    z = lower + half * (1.0 + at)
    mass = half * weights * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return _Piece(germ, _on_line(space, germ, z), z, mass, (lower, upper))


def _on_line(space: RandomSpace, germ: int, scores: Array) -> Array:
    """Points (n, L) at normal scores (n,) of a germ, all others at their medians."""
    every: Array = np.zeros((len(scores), space.dimension))
    every[:, germ] = scores
    return space.from_normal(every)


def _halves(space: RandomSpace, piece: _Piece) -> list[_Piece]:
    assert piece.ends is not None
    lower, upper = piece.ends
    middle = 0.5 * (lower + upper)
    return [_piece(space, piece.germ, *ends) for ends in ((lower, middle), (middle, upper))]


def _pieces(space: RandomSpace, germ: int, tails: Sequence[Tail]) -> list[_Piece]:
    """The first pieces of a germ, to the last points of its tails, and these; all values of a discrete one,
    none if there are too many."""
    atoms = space.atoms(germ)
    if atoms is not None:
        values, probabilities = atoms
        if len(values) > MOST_ATOMS:
            return []
        points = np.repeat(_on_line(space, germ, np.zeros(1)), len(values), axis=0)
        points[:, germ] = values
        return [_Piece(germ, points, normal_scores(space, points)[:, germ], probabilities, None)]
    own = [tail for tail in tails if tail.germ == germ]
    ends = np.array(ENDS)
    for tail in own:
        ends[0 if tail.end < 0.0 else -1] = tail.end
    found = [_piece(space, germ, float(a), float(b)) for a, b in pairwise(ends)]
    if own:
        z = np.array([tail.end for tail in own])
        weights = np.array([tail.weight for tail in own])
        found.append(_Piece(germ, _on_line(space, germ, z), z, weights, None))
    return found


def _height(pieces: Sequence[_Piece]) -> tuple[float, float, Array] | None:
    """Of the pieces of a germ: middle and scale, and Legendre coefficients (pieces, GAUSS) of
    asinh((g - middle) / scale); None: the quantity does not change."""
    g, mass = (np.stack([getattr(each, what) for each in pieces]) for what in ("values", "mass"))
    w = mass / mass.sum()
    scale = float(np.sqrt(np.sum(w * (g - np.sum(w * g)) ** 2)))
    if not scale > 0.0:
        return None
    scores = np.concatenate([each.scores for each in pieces])
    middle = float(np.interp(0.0, scores, g.ravel()))
    at, _ = np.polynomial.legendre.leggauss(GAUSS)
    inverse = np.linalg.inv(np.polynomial.legendre.legvander(at, GAUSS - 1))
    return middle, scale, np.arcsinh((g - middle) / scale) @ inverse.T


def _of_scores(pieces: Sequence[_Piece], germ: int) -> list[_Piece]:
    """Pieces of a germ in rising order."""
    own = (each for each in pieces if each.germ == germ and each.ends is not None)
    return sorted(own, key=lambda each: each.ends or (0.0,))


def _rough(pieces: Sequence[_Piece], most: float) -> list[_Piece]:
    """Pieces whose polynomials are off by more than a share of the deviation, by their last coefficients."""
    found: list[tuple[float, _Piece]] = []
    square = 0.0
    for germ in sorted({each.germ for each in pieces}):
        own = _of_scores(pieces, germ)
        known = _height(own) if own else None
        if known is None:
            continue
        middle, scale, heights = known
        square += scale * scale
        last = np.abs(heights[:, -2:]).max(axis=1)
        for each, rough in zip(own, last, strict=True):
            steep = float(np.sqrt(each.mass @ (scale**2 + (each.values - middle) ** 2)))
            found.append((float(rough) * steep, each))
    return [each for off, each in found if off > most * np.sqrt(square)]


def _functions(space: RandomSpace, germ: int, pieces: Sequence[_Piece]) -> _Along:
    """The quantity along a germ and polynomials beside it; without pieces, these alone."""
    family = space.germs[germ]
    if not space.continuous[germ]:
        highest = min(HIGHEST, (family.capacity or 1) - 1)

        def polynomials(p: Array, z: Array) -> Array:
            return np.asarray(family.evaluate(np.ascontiguousarray(p), highest))

    else:
        highest = HIGHEST

        def polynomials(p: Array, z: Array) -> Array:
            found = np.polynomial.hermite_e.hermevander(z, HIGHEST) / np.sqrt([1.0, 1.0, 2.0, 6.0])
            return np.asarray(found, dtype=np.float64)

    def alone(p: Array, z: Array) -> Array:
        return polynomials(p, z)[:, 1:]

    own = _of_scores(pieces, germ)
    known = _height(own) if own else None
    if not pieces or (own and known is None):
        return _Along(alone, np.eye(highest), np.arange(1, highest + 1))
    points = np.concatenate([each.points[:, germ] for each in pieces])
    scores, mass = (np.concatenate([getattr(p, what) for p in pieces]) for what in ("scores", "mass"))
    if known is None:
        values = pieces[0].values
        between = 0.5 * (points[1:] + points[:-1])  # of atoms, which rise

        def along(p: Array, z: Array) -> Array:
            found: Array = values[np.searchsorted(between, p)]
            return found

    else:
        middle, scale, heights = known
        bounds = [each.ends for each in own if each.ends is not None]
        ends: Array = np.array([bounds[0][0], *(upper for _, upper in bounds)])

        def along(p: Array, z: Array) -> Array:
            within = np.clip(z, ends[0], ends[-1])
            piece = np.clip(np.searchsorted(ends, within) - 1, 0, len(ends) - 2)
            t = 2.0 * (within - ends[piece]) / (ends[piece + 1] - ends[piece]) - 1.0
            height = np.sum(np.polynomial.legendre.legvander(t, GAUSS - 1) * heights[piece], axis=1)
            return np.asarray(middle + scale * np.sinh(height))

    def every(p: Array, z: Array) -> Array:
        beside = polynomials(p, z)
        return np.column_stack([beside[:, 0], along(p, z), beside[:, 1:]])

    return _orthonormal(every, points, scores, mass)


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


def fitted(lines: Lines, points: Array, weights: Array, labels: Ints, values: Array) -> Hinged | None:
    """Sums of products of functions of one germ through values (n,) at points (n, L), of the degree that
    serves best; None: too few points. `weights`, `labels`: as of :func:`hinges.hinged`."""
    sets = int(labels.max()) + 1
    mean = float(weights @ values)
    spread = float(np.sqrt(weights @ (values - mean) ** 2))
    best: Hinged | None = None
    for order in range(1, MOST_ORDER + 1):
        degrees = lines.degrees(order)
        if not spread > 0.0 or PER_TERM * len(degrees) > len(values):
            break
        terms = Terms(lines(points, order), degrees, weights, np.asarray((values - mean) / spread))
        found = without_each(terms, [], order, labels, sets, (-np.inf, np.inf))
        if found is not None and (best is None or found.rest < best.rest):
            best = found
    if best is None:
        return None
    coefficients = spread * best.coefficients
    coefficients[0, 0] += mean
    return best._replace(coefficients=coefficients, rest=spread * best.rest, functions=lines.__call__)


def beyond_lines(
    lines: Lines, tails: Sequence[Tail], fit: Hinged, seen: Witnesses, value: MeanStd
) -> MeanStd:
    """Errors of mean and deviation by what is beyond the last points of a fit to lines: as far as the powers
    of the tails are not known, and as much of it as the last witnesses along a germ say that it is off."""
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
