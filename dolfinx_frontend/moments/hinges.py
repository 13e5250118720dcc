"""Polynomials with hinges: what stands for a quantity that has kinks where it is integrated.

Where a contact opens, a quantity stays continuous and changes its slope. A *hinged polynomial* is

    s = p_0 + sum_j h_j,    h_j = max(p_j, 0) or min(p_j, 0),

smooth on both sides of every kink, wherever that is: its place is the zero of a polynomial and is found with
it. With the points on the side of p_j known, all coefficients are those of a linear least-squares fit, whose
p_j say the sides anew (hinging hyperplanes: Breiman, IEEE Trans. Inf. Theory 39, 1993); the contact status of
solved points tells where to begin.

It is no answer. It is fitted to all sets of samples but one, integrated with many points, and corrected by
what the set that it has not seen lacks: an estimate without bias, however bad the fit, whose error is that of
a difference (control variates with cross-fitting).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import comb
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.deferred import linalg
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.moments.model import ContactStates
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["PER_TERM", "Hinged", "Terms", "hinged", "sides_of", "without_each"]

MOST_HINGES = 3

MOST_DEGREE, MOST_TERMS = 8, 500
"""Highest degree, and most coefficients."""

PER_TERM = 1.6
"""Points that a coefficient of a piece asks for at least."""

STEPS = 12
"""Fits after each of which the points change sides at most."""

BETTER = 0.7
"""Share of the root mean square residual that a hinge more must leave at most."""

LEVELS = (0.05, 0.2, 0.4, 0.6, 0.8, 0.95)
"""Shares of the points on one side of the cuts across the steepest direction."""

SEARCHED = 2
"""Degree of the polynomials that look for kinks."""

FEW, AGAIN = 1024, 3
"""Points at most that look for kinks, and fits to all of them from there."""

WORSE = 5.0
"""Residual, relative to the best, above which a degree more is not tried."""

BEYOND = 5.0
"""How far a value may be outside those of the points, relative to their range: it may grow far out."""


class Hinged(NamedTuple):
    """Hinged polynomials, one fitted without each of the sets and one to all points.

    Attributes
    ----------
    order
        Highest degree.
    coefficients
        (1 + hinges, terms, sets + 1), zero above the degree of a piece; the last one is of all points.
    signs
        (hinges,) 1: max, -1: min.
    range
        Least and largest value.
    rest
        Root mean square difference of the values from those of the fits that have not seen them.
    functions
        What they are sums of, (n, terms) of points (n, L) and a degree; None: polynomials of the germs.
    """

    order: int
    coefficients: Array
    signs: Array
    range: tuple[float, float]
    rest: float
    functions: Callable[[Array, int], Array] | None = None

    def __call__(self, space: RandomSpace, points: Array) -> Array:
        """Values (n, sets + 1) at points (n, L) of the germs."""
        return self.of_terms(self.terms(space, points))

    def terms(self, space: RandomSpace, points: Array) -> Array:
        """The basis (n, terms) at points (n, L) of the germs."""
        if self.functions is not None:
            return self.functions(points, self.order)
        return space.basis(Chaos(order=self.order)).evaluate(points)

    def of_terms(self, psi: Array, which: slice = slice(None)) -> Array:
        """Values (n, sets + 1) from the basis (n, terms), or those of some sets."""
        out = psi @ self.coefficients[0, :, which]
        for sign, each in zip(self.signs, self.coefficients[1:, :, which], strict=True):
            out += sign * np.maximum(sign * (psi @ each), 0.0)
        return np.clip(out, *self.range, out=out)


class _Fit(NamedTuple):
    """A fit to all points."""

    hinges: Array  # (hinges, terms): positive on the side of a hinge
    rest: float  # what it would leave of points that it has not seen, by its number of coefficients

    def sides(self, psi: Array) -> list[Flags]:
        """Points (n,) each on the side of a hinge."""
        return [psi @ each > 0.0 for each in self.hinges]


class Terms(NamedTuple):
    """What a degree offers at the points."""

    psi: Array  # (n, terms)
    degrees: Ints  # (terms,)
    weights: Array  # (n,) of sum 1
    values: Array  # (n,)

    def used(self, inside: Sequence[Flags], order: int) -> list[Flags] | None:
        """Terms of every piece, of as high a degree as its points allow; None: they do not allow degree 1."""
        outside = ~np.any(inside, axis=0) if len(inside) else np.ones(len(self.psi), dtype=bool)
        out = []
        for piece in (outside, *inside):
            count = piece.sum()
            found = [d for d in range(order, 0, -1) if PER_TERM * (self.degrees <= d).sum() <= count]
            if not found:
                return None
            out.append(self.degrees <= found[0])
        terms = sum(int(each.sum()) for each in out)
        return out if PER_TERM * terms <= len(self.psi) and terms <= MOST_TERMS else None

    def design(self, inside: Sequence[Flags], used: Sequence[Flags]) -> Array:
        blocks = [self.psi[:, used[0]]]
        blocks += [self.psi[:, own] * side[:, None] for side, own in zip(inside, used[1:], strict=True)]
        return np.concatenate(blocks, axis=1)

    def spread(self, found: Array, used: Sequence[Flags]) -> Array:
        """(pieces, terms, k) of the coefficients (unknowns, k) of the used terms."""
        out = np.zeros((len(used), self.psi.shape[1], found.shape[1]))
        first = 0
        for piece, own in zip(out, used, strict=True):
            piece[own] = found[first : first + int(own.sum())]
            first += int(own.sum())
        return out


def _solved(gram: Array, right: Array) -> Array | None:
    """The least-squares coefficients of normal equations; None: they are not determined."""
    ridge = 1e-14 * float(np.trace(gram))
    try:
        found = linalg.cho_solve(linalg.cho_factor(gram + ridge * np.eye(len(gram))), right)
    except linalg.LinAlgError:
        return None
    return np.asarray(found) if np.all(np.isfinite(found)) else None


def _signs(terms: Terms, inside: Sequence[Flags], pieces: Array) -> Array:
    """1 where a hinge is positive on its side, -1 where it is negative there."""
    tops = [float(terms.weights[a] @ (terms.psi[a] @ p)) for a, p in zip(inside, pieces[1:], strict=True)]
    return np.where(np.array(tops) >= 0.0, 1.0, -1.0)


def _fitted(terms: Terms, inside: Sequence[Flags], order: int, steps: int = STEPS) -> _Fit | None:
    """Least squares and sides in turn; the best that was met."""
    best: _Fit | None = None
    known: set[bytes] = set()
    for _ in range(steps if inside else 1):
        stop_if_pressed()
        used = terms.used(inside, order)
        if used is None:
            break
        design = terms.design(inside, used)
        weighted = design * terms.weights[:, None]
        found = _solved(weighted.T @ design, weighted.T @ terms.values)
        if found is None:
            break
        pieces = terms.spread(found[:, None], used)[:, :, 0]
        signs = _signs(terms, inside, pieces)
        hinges = signs[:, None] * pieces[1:]
        at = [terms.psi @ each for each in hinges]
        own = terms.psi @ pieces[0]
        for sign, each in zip(signs, at, strict=True):
            own = own + sign * np.maximum(each, 0.0)
        rest = float(np.sqrt(terms.weights @ (terms.values - own) ** 2))
        rest /= 1.0 - design.shape[1] / len(design)
        if best is None or rest < best.rest:
            best = _Fit(hinges, rest)
        inside = [each > 0.0 for each in at]
        key = np.concatenate([np.zeros(0, dtype=bool), *inside]).tobytes()
        if key in known:
            break
        known.add(key)
    return best


def sides_of(contacts: Sequence[ContactStates]) -> list[Flags]:
    """Points (n,) each where a contact is open somewhere, in more than half of its points, and everywhere."""
    found = []
    for contact in contacts:
        share = contact.counts[:, 0] / contact.points
        found += [share > 0.0, share > 0.5, share >= 1.0]
    return found


def _cuts(terms: Terms) -> list[Flags]:
    """Points on one side of planes across the direction in which the values change most."""
    line = terms.degrees <= 1
    psi = terms.psi[:, line]
    weighted = psi * terms.weights[:, None]
    found = _solved(weighted.T @ psi, weighted.T @ terms.values)
    if found is None:
        return []
    along = psi @ found
    ranked = np.argsort(along)
    below = np.cumsum(terms.weights[ranked])
    return [along > along[ranked[min(int(np.searchsorted(below, s)), len(ranked) - 1)]] for s in LEVELS]


def _kinks(terms: Terms, sides: Sequence[Flags]) -> list[Array]:
    """Hinges (hinges, terms): none, the best one, that and the one that helps most beside it, and so on."""
    plain = _fitted(terms, [], SEARCHED)
    out: list[Array] = [np.zeros((0, terms.psi.shape[1]))]
    if plain is None:
        return out
    inside: list[Flags] = []
    best = plain.rest
    tried = {each.tobytes(): each for each in [*sides, *_cuts(terms)]}
    every = [other for each in tried.values() for other in (each, ~each) if 0 < other.sum() < len(other)]
    while len(inside) < MOST_HINGES:
        fits = [_fitted(terms, [*inside, each], SEARCHED) for each in every]
        chosen = min((each for each in fits if each is not None), key=lambda each: each.rest, default=None)
        if chosen is None or not chosen.rest < BETTER * best:
            break
        inside, best = chosen.sides(terms.psi), chosen.rest
        out.append(chosen.hinges)
    return out


def hinged(
    space: RandomSpace,
    points: Array,
    weights: Array,
    labels: Ints,
    values: Array,
    sides: Sequence[Flags] | None,
) -> Hinged | None:
    """Hinged polynomials through values (n,) at points (n, L) of the germs, of the degree that serves best.

    Parameters
    ----------
    weights, labels
        (n,) of sum 1, and the number of the set of every point.
    sides
        Where to look for kinks: points on one side of what might be one. None: there are none.

    Returns
    -------
    None: there are too few points, or they do not determine any.
    """
    sets = int(labels.max()) + 1
    mean = float(weights @ values)
    spread = float(np.sqrt(weights @ (values - mean) ** 2))
    if not spread > 0.0:
        return None
    scaled: Array = np.asarray((values - mean) / spread, dtype=np.float64)
    margin = BEYOND * (scaled.max() - scaled.min())
    span = scaled.min() - margin, scaled.max() + margin
    best: Hinged | None = None
    ways: list[list[Flags]] = []
    for order in range(1, MOST_DEGREE + 1):
        if PER_TERM * min(comb(space.dimension + order, order), 10**6) > len(values):
            break
        basis = space.basis(Chaos(order=order))
        degrees = np.asarray(basis.indices.table).sum(axis=1)
        terms = Terms(basis.evaluate(points), degrees, weights, scaled)
        if not np.all(np.isfinite(terms.psi)):
            break
        if sides is None:
            ways = ways or [[]]
        elif order <= SEARCHED:
            few = Terms(terms.psi[:FEW], degrees, weights[:FEW] / weights[:FEW].sum(), scaled[:FEW])
            known = (each[:FEW] for way in ways for each in way)
            kinks = _kinks(few, [*(each[:FEW] for each in sides), *known])
            ways = [[terms.psi @ each > 0.0 for each in way] for way in kinks]
        going = []
        for way in ways:
            fit = _fitted(terms, way, order, AGAIN)
            inside = [] if fit is None else fit.sides(terms.psi)
            found = None if fit is None else without_each(terms, inside, order, labels, sets, span)
            if found is None:
                continue
            if best is None or found.rest < best.rest:
                best = found
            if found.rest <= WORSE * best.rest:
                going.append(inside)
        ways = going
        if not ways:
            break
    if best is None:
        return None
    coefficients = spread * best.coefficients
    coefficients[0, 0] += mean
    lower, upper = (mean + spread * each for each in span)
    return best._replace(coefficients=coefficients, range=(lower, upper), rest=spread * best.rest)


def without_each(
    terms: Terms, inside: list[Flags], order: int, labels: Ints, sets: int, span: tuple[float, float]
) -> Hinged | None:
    """The fits to all sets but one, with the sides of all points."""
    used = terms.used(inside, order)
    if used is None:
        return None
    stop_if_pressed()
    design = terms.design(inside, used)
    own = [labels == k for k in range(sets)]
    weighted = design * terms.weights[:, None]
    grams = [weighted[k].T @ design[k] for k in own]
    rights = [weighted[k].T @ terms.values[k] for k in own]
    gram, right = np.sum(grams, axis=0), np.sum(rights, axis=0)
    every = [_solved(gram - g, right - r) for g, r in zip(grams, rights, strict=True)]
    every.append(_solved(gram, right))
    good = [each for each in every if each is not None]
    if len(good) < len(every):
        return None
    pieces = terms.spread(np.stack(good, axis=1), used)
    signs = _signs(terms, inside, pieces[:, :, -1])
    made = Hinged(order, pieces, signs, span, np.inf)
    at = made.of_terms(terms.psi)
    unseen = at[np.arange(len(labels)), labels]
    return made._replace(rest=float(np.sqrt(terms.weights @ (terms.values - unseen) ** 2)))
