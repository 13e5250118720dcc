"""Solved points that judge.

A *witness* is solved on its own, not started from what it judges, and lies where no rule and no chaos has put
its points: half of them follow the distribution of the germs, the others a wider one, and some lie far out
along each germ, where contacts open, and where they are in states that no other point has met.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.moments.kinks import all_states_of, opening_directions
from dolfinx_frontend.moments.model import ContactStates, Evaluations, PointModel
from dolfinx_frontend.moments.points import POINTS, Panel, calibrated, normal_scores, wide_points
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace, sobol_points
from dolfinx_frontend.uncertainty.statistics import MeanStd

__all__ = [
    "MOST_LINES",
    "SAFE",
    "TAIL",
    "Misfit",
    "Witnesses",
    "checked_cold",
    "far_out",
    "few_witnesses",
    "misfit",
    "off_witnesses",
    "surrogate",
    "with_unmet_states",
    "witnesses",
]

SAFE = 3.0
"""What the variance is said to lack, over what it seems to lack by few points."""

CHECKED = 4
"""Points that are solved again from nothing, to a hundredth of the tolerance."""

ALONE, OF_ALL = 48, 8
"""Others that are, each alone, at most, and one of so many."""

AGAIN, AGAIN_LINEAR = 32, 4
"""Points that are solved again to a hundredth of the tolerance, in another order; of linear laws, which no
state misleads, fewer."""

TAIL = np.array([2.5, 3.5, 4.5, 5.5, 6.5])
"""Normal scores of the witnesses along each germ."""

FEW, FEW_TO = 8, 5e-4
"""Witnesses of a rule that are drawn, and the accuracy from which on there are twice as many."""

MOST_UNMET, OF_UNMET = 8, 2
"""Witnesses are put into so many states of contacts that no other has met, so many into each."""

FAR_OFF = 30.0
"""Deviations that a quantity may be off the polynomial of a rule where no witness is."""

MOST_LINES = 16
"""Most germs that have such witnesses."""


class Witnesses(NamedTuple):
    """Solved points that judge."""

    points: Array  # (n, L)
    weights: Array  # (n,), of sum 1; 0 in the tails
    tails: Array  # (n,) probability of the piece of a tail that a point stands for, 0 elsewhere
    values: Array  # (n,) of the quantity
    states: Array = np.zeros((0, 0))  # (n, k) of contacts along one germ, see `all_states_of`


class Misfit(NamedTuple):
    """What solved points say of moments that were made without them."""

    mean: float
    std: float
    size: float  # root mean square of what is not in the approximation


def witnesses(model: PointModel, rtol: float) -> Witnesses:
    """Solve some points that nothing else has seen: 32 and more with more germs."""
    count = 2 ** int(np.ceil(np.log2(max(32, 8 * min(model.space.dimension, 16)))))
    return _seen(model, rtol, False, count, len(TAIL))


def few_witnesses(model: PointModel, rtol: float, target: float) -> Witnesses:
    """Solve each of so few points from nothing as an accuracy asks for: far out on the germs only where a
    quantity may be as far from a polynomial as would matter (`FAR_OFF` deviations)."""
    depth = int(np.sum(np.sqrt(target / _shares(TAIL)) <= FAR_OFF))
    count = FEW if target > FEW_TO else 2 * FEW
    return _seen(model, rtol, True, count, max(depth, 1))


def _seen(model: PointModel, rtol: float, cold: bool, count: int, depth: int) -> Witnesses:
    """Witnesses: `count` that are drawn, and the first `depth` of the tails."""
    points, weights = wide_points(model.space, count, 12345)
    good = model.admissible(points)
    points, weights = points[good], weights[good]
    weights = np.abs(calibrated(model.space, points, weights))
    lines, shares = _tails(model.space, depth)
    good = model.admissible(lines)
    tails = np.concatenate([np.zeros(len(points)), shares[good]])
    points = np.concatenate([points, lines[good]])
    weights = np.concatenate([weights / weights.sum(), np.zeros(int(good.sum()))])
    found = model(points, rtol, cold)
    seen = Witnesses(points, weights, tails, found.values)
    if points.shape[1] == 1:
        seen = seen._replace(states=all_states_of(model.contacts(found), len(points)))
    return with_unmet_states(model, found, seen, rtol, cold)


def with_unmet_states(
    model: PointModel, found: Evaluations, seen: Witnesses, rtol: float, cold: bool = False
) -> Witnesses:
    """The witnesses, and such as lie where contacts are in states in which no solved point has them."""
    contacts = model.contacts(found)
    openings = _openings(model, contacts, found.points)
    for points, share in (openings, _unmet(model, contacts)):
        good = model.admissible(points)
        if not good.any():
            continue
        more, states = model(points[good], rtol, cold), seen.states
        if len(states):
            states = np.concatenate([states, all_states_of(model.contacts(more), len(more.points))])
        seen = Witnesses(
            np.concatenate([seen.points, points[good]]),
            np.concatenate([seen.weights, np.zeros(int(good.sum()))]),
            np.concatenate([seen.tails, share[good]]),
            np.concatenate([seen.values, more.values]),
            states,
        )
    return seen


def _openings(model: PointModel, contacts: Sequence[ContactStates], known: Array) -> tuple[Array, Array]:
    """Points (n, L) where contacts open by what known ones (k, L) tell, and the probability that each stands
    for.

    Far out along a sum of germs a contact may be open that is closed along each of them.
    """
    space = model.space
    lines: list[Array] = [np.zeros((0, space.dimension))]
    shares: list[Array] = [np.zeros(0)]
    several = space.dimension > 1
    for reach, along in opening_directions(contacts, normal_scores(space, known)) if several else ():
        beyond = TAIL[TAIL > reach][:2]
        lines.append(beyond[:, None] * along)
        shares.append(_shares(beyond))
    return space.from_normal(np.concatenate(lines)), np.concatenate(shares)


def _unmet(model: PointModel, contacts: Sequence[ContactStates]) -> tuple[Array, Array]:
    """The same where an approximation has contacts in a state in which no solved point has them.

    A contact may be met in a window of the germs that points pass by.
    """
    guess = model.guess()
    points, shares = [np.zeros((0, model.space.dimension))], [np.zeros(0)]
    if guess is not None:
        kinds, which, counts = np.unique(guess.kinds, axis=0, return_inverse=True, return_counts=True)
        met = {row.tobytes() for row in np.concatenate([each.kinds for each in contacts], axis=1)}
        unmet = [k for k in np.argsort(-counts) if kinds[k].tobytes() not in met]
        for k in unmet[:MOST_UNMET]:
            members = guess.points[np.flatnonzero(which.ravel() == k)]
            chosen = members[np.linspace(0, len(members) - 1, OF_UNMET).round().astype(int)]
            points.append(chosen)
            shares.append(np.full(len(chosen), counts[k] / len(guess.points) / len(chosen)))
    return np.concatenate(points), np.concatenate(shares)


def far_out(model: PointModel, rtol: float, along: Array, seen: Witnesses | None = None) -> Witnesses:
    """Those of the witnesses that lie far out along each germ, solved unless `seen` has them, and others both
    ways along a direction (L,) of the normal scores."""
    space = model.space
    scores = np.concatenate([-TAIL[::-1], TAIL])
    lines, shares = space.from_normal(scores[:, None] * along), _shares(scores)
    if seen is None:
        of_germs, of_each = _tails(space)
        lines, shares = np.concatenate([lines, of_germs]), np.concatenate([shares, of_each])
    good = model.admissible(lines)
    lines, shares = lines[good], shares[good]
    values: Array = model(lines, rtol).values if len(lines) else np.zeros(0)
    if seen is not None:
        lines = np.concatenate([seen.points, lines])
        shares = np.concatenate([seen.tails, shares])
        values = np.concatenate([seen.values, values])
    return Witnesses(lines, np.zeros(len(lines)), shares, values)


def _shares(scores: Array) -> Array:
    """Probability of the piece of a tail that a normal score stands for."""
    half = 0.5 * (TAIL[1] - TAIL[0])
    return np.asarray(special.ndtr(-np.abs(scores) + half) - special.ndtr(-np.abs(scores) - half))


def _tails(space: RandomSpace, depth: int = len(TAIL)) -> tuple[Array, Array]:
    """Points far out along each germ, the others drawn, and what probability they stand for: the first
    `depth` of either side."""
    dimension = space.dimension
    if dimension > MOST_LINES:
        return np.zeros((0, dimension)), np.zeros(0)
    scores = np.concatenate([-TAIL[:depth][::-1], TAIL[:depth]])
    tiny = 2.0**-54
    count = 2 ** int(np.ceil(np.log2(dimension * len(scores))))
    drawn = sobol_points(dimension, count, np.random.default_rng(54321))[: dimension * len(scores)]
    z = special.ndtri(np.clip(drawn, tiny, 1.0 - tiny))
    for germ in range(dimension):
        z[germ * len(scores) : (germ + 1) * len(scores), germ] = scores
    return space.from_uniform(special.ndtr(z)), np.tile(_shares(scores), dimension)


def misfit(seen: Witnesses, approximate: Array, value: MeanStd) -> Misfit:
    """What witnesses say of an approximation (n,) at their points, whose moments are `value`.

    What the approximation has not is orthogonal to it if it is a projection: its square is what the
    variance lacks. Of a shift of the mean or a correlation, only what exceeds two standard errors counts.
    """
    share = seen.weights
    rest = seen.values - approximate
    size = float(np.sqrt((share + seen.tails) @ rest**2))

    def certain(values: Array) -> float:
        """What the mean of some values is more than two standard errors; of n equal weights 1 / sqrt(n)."""
        mean = float(share @ values)
        doubt = 2.0 * float(np.sqrt(share @ (values - mean) ** 2) * np.sqrt(share @ share))
        return max(abs(mean) - doubt, 0.0)

    std = value.std or 0.0
    shift = certain(rest * (approximate - value.mean))
    of_std = float(np.sqrt(std**2 + size**2) - std) * SAFE + (shift / std if std > 0.0 else size)
    # what is missing shifts the mean by as much as its square couples
    coupled = 0.5 * size * min(size / std, 1.0) if std > 0.0 else size
    return Misfit(max(certain(rest), coupled), of_std, size)


def off_witnesses(panels: Sequence[Panel], seen: Witnesses, space: RandomSpace) -> list[Array]:
    """(3,) errors of the sums over panels by what witnesses differ from their polynomials, each of which
    stands for its share of the probability, but no more than the panel has."""
    at, _ = np.polynomial.legendre.leggauss(POINTS)
    own = np.linalg.inv(np.vander(at, POINTS))
    scores, share = normal_scores(space, seen.points)[:, 0], seen.weights + seen.tails
    found = []
    for each in panels:
        inside = (each.lower < scores) & (scores < each.upper)
        beside = np.vander(2.0 * (scores[inside] - each.lower) / (each.upper - each.lower) - 1.0, POINTS)
        off = [np.abs(seen.values[inside] ** k - beside @ own @ each.values**k) for k in range(3)]
        found.append(np.minimum(share[inside], each.sums[0]) @ np.stack(off, axis=1))
    return found


def surrogate(
    space: RandomSpace, counts: Sequence[int], points: Array, weights: Array, values: Array
) -> Callable[[Array], Array]:
    """The polynomial that a tensor rule with these counts sees, as a function of points."""
    order = max(counts) - 1
    basis = space.basis(Chaos(order=order, index_set="tensor"))
    table = np.asarray(basis.indices.table)
    inside = np.all(table < np.asarray(counts), axis=1)
    psi = basis.evaluate(points)[:, inside]
    coefficients = psi.T @ (weights * values)
    return lambda at: np.asarray(basis.evaluate(at)[:, inside] @ coefficients)


def checked_cold(
    model: PointModel,
    found: Evaluations,
    weights: Array,
    values: Array,
    apart: Array | None = None,
    tails: bool = False,
) -> float:
    """Root mean square difference of some points to the same points solved again to a hundredth of the
    tolerance, the most important ones, those that stand out and some others from nothing (of linear laws all
    together: no state misleads them); NaN: one of these did not converge. `apart`: (n,) by how much values
    differ from what their neighbours say. `tails`: values far off the mean may be off by as much more."""
    weight = np.abs(weights) * (values - weights @ values) ** 2
    scale = np.ones(len(values))
    if tails and weight.sum() > 0.0:
        scale = np.maximum(np.abs(values - weights @ values) / np.sqrt(weight.sum()), 1.0)
    ranked = np.argsort(-weight, kind="stable")
    ranked = ranked[weights[ranked] != 0.0]  # of pieces that were halved nothing counts
    if apart is not None:
        outside = np.argsort(-np.abs(apart), kind="stable")[:CHECKED]
        first = np.concatenate([ranked[: CHECKED // 2], outside, ranked])
        ranked = first[np.sort(np.unique(first, return_index=True)[1])]
    rtol = max(0.01 * found.rtol, 1e-12)
    away = []
    others = ranked[CHECKED:]
    some = others[:: max(1, len(others) // (AGAIN_LINEAR if model.linear else AGAIN))]
    if not model.linear:
        groups = [ranked[k : k + 1] for k in range(0, min(CHECKED, len(ranked)))]
        alone = min(ALONE, len(others) // OF_ALL)
        groups += [point for point in np.random.default_rng(len(ranked)).permutation(others)[:alone, None]]
        groups += [some] if len(some) else []
    else:
        groups = [np.concatenate([ranked[:CHECKED], some])]
    for chosen in groups:
        again = model(found.points[chosen], rtol).values
        away += [float(v) for v in (again - values[chosen]) / scale[chosen]]
    return float(np.sqrt(np.mean(np.square(away))))
