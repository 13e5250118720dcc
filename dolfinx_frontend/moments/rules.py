"""Answers by tensor Gauss rules of few germs, which witnesses and the next degree must agree with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.moments.kinks import all_states_of, error_by_kinks
from dolfinx_frontend.moments.model import Evaluations, Keep, Moments, PointModel, confirmed, so_far
from dolfinx_frontend.moments.validation import Witnesses, misfit, surrogate
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import FINEST, ErrorShare, MeanStd, share_of, size_of, whole_of

__all__ = ["NextDegree", "by_rules", "next_degree"]

RULES, TIGHT_RULES, TIGHT_TO = (3, 5, 7, 9, 12, 16, 20), (4, 6, 8, 10, 12, 16, 20), 5e-4
"""Points per germ of the rules that are tried one after the other; the second ones from an accuracy on."""

MOST_TENSOR = 160
"""Points of a tensor rule at most: samples beside a polynomial do with no more."""

KINKED = 4.0 / 3.0
"""Power of the misfit of a polynomial that the error of its rule is at most: with n points of a germ, a kink
leaves a misfit of n^(-3/4) or less, and an error of n^-1 in the rule."""

BEYOND = 2.0
"""The same of the misfit of the polynomial with the next degree, as it has more terms than the rule sees."""

HIGHEST = 0.999
"""Leverage of a point at most."""

AGAIN = 2
"""Points of a rule that are solved again, to a hundredth of the tolerance."""


class NextDegree(NamedTuple):
    """What a polynomial of the next degree says, which goes through a rule and its witnesses."""

    moments: MeanStd
    rest: float  # root mean square of what it lacks at witnesses that it has not seen


def next_degree(
    space: RandomSpace, counts: Sequence[int], points: Array, weights: Array, values: Array, seen: Witnesses
) -> NextDegree | None:
    """Least squares with what a rule with these counts sees and the next degree; None: it is not determined.

    What one of the witnesses is off that is left out follows from its leverage h: r / (1 - h).
    """
    order = max(counts)
    basis = space.basis(Chaos(order=order, index_set="tensor"))
    table = np.asarray(basis.indices.table)
    used = np.all(table < np.asarray(counts), axis=1) | (table.sum(axis=1) <= order)
    share = seen.weights + seen.tails
    root = np.sqrt(np.concatenate([weights / weights.sum(), share]))
    psi = basis.evaluate(np.concatenate([points, seen.points]))[:, used]
    every = np.concatenate([values, seen.values])
    if psi.shape[0] <= psi.shape[1] or not np.all(np.isfinite(psi)):
        return None
    q, r = np.linalg.qr(root[:, None] * psi)
    size = np.abs(np.diag(r))
    if not size.min() > 1e-10 * size.max():
        return None
    along = q.T @ (root * every)
    coefficients = np.linalg.solve(r, along)
    leverage = np.minimum(np.sum(q**2, axis=1), HIGHEST)
    left = ((every - psi @ coefficients) / (1.0 - leverage))[len(points) :]
    std = float(np.sqrt(np.sum(coefficients[1:] ** 2)))
    return NextDegree(MeanStd(float(coefficients[0]), std), float(np.sqrt(share @ left**2)))


def by_rules(
    model: PointModel, target: float, rtol: float, seen: Witnesses, keep: Keep
) -> Moments | None:
    """Tensor Gauss rules of rising order; None: none does in time.

    Two witnesses must agree with the polynomial that a rule sees: points that it has not seen, and the
    polynomial with the next degree, which goes through all of them. Points of nonlinear laws are solved from
    nothing each.
    """
    space, statistic = model.space, model.statistic
    rules = RULES if target > TIGHT_TO else TIGHT_RULES
    for points, more in zip(rules, (*rules[1:], rules[-1]), strict=True):
        counts = [points if g.capacity is None else min(points, g.capacity) for g in space.germs]
        rule = space.tensor_gauss(counts)
        weights = np.asarray(rule.weights) / np.sum(rule.weights)
        if len(rule.points) > MOST_TENSOR:
            return None
        found = model(rule.points, rtol, cold=not model.linear)
        value = statistic.value(found.values, weights)
        size = size_of(value, statistic)
        whole = whole_of(value, rtol, statistic) or size
        if not (value.std or 0.0) > 0.0 and not value.mean:
            return None  # nothing happens at any point of the rule
        off, kinked = _off(model, counts, found, weights, seen, value)
        how = f"the next degree beside {points} points per germ, and {len(seen.points)} points outside"
        truncation = ErrorShare(np.nan, off.mean, off.std, how)
        keep(so_far(found, weights, truncation, value, whole))
        if max(share_of(off.mean, size), share_of(off.std or 0.0, whole)) <= 0.5 * target:
            least = min(size, whole)
            away = _again(model, found, weights)
            while not away <= 0.3 * target * least and rtol > 1e-10:
                rtol = max(0.01 * rtol, FINEST)
                found = model(rule.points, rtol, cold=not model.linear)
                value = statistic.value(found.values, weights)
                away = _again(model, found, weights)
            if not away <= 0.3 * target * least:
                return None
            count = more**space.dimension
            seconds = found.seconds * count / len(rule.points)
            halving = f"{more} points per germ, {count} solves, about {seconds:.2g} s"
            return confirmed(found, weights, away, truncation, value, whole, halving)
        enough = 7 if space.dimension == 1 else 5
        if kinked > 5.0 * target * whole and points >= enough:
            return None  # a kink: more points would not do
    return None


def _off(
    model: PointModel,
    counts: Sequence[int],
    found: Evaluations,
    weights: Array,
    seen: Witnesses,
    value: MeanStd,
) -> tuple[MeanStd, float]:
    """Errors of mean and deviation by a rule with these counts, and what of it is by kinks."""
    space, spread = model.space, value.std or 0.0
    smooth = surrogate(space, counts, found.points, weights, found.values)
    off = misfit(seen, smooth(seen.points), value)
    beyond = next_degree(space, counts, found.points, weights, found.values, seen)
    kinked = share_of(off.size, spread) ** KINKED * spread
    of_mean = of_std = np.inf
    if beyond is not None:
        kinked = min(kinked, BEYOND * share_of(beyond.rest, spread) ** KINKED * spread)
        of_mean = max(off.mean, kinked, abs(beyond.moments.mean - value.mean))
        of_std = max(off.std, kinked, abs((beyond.moments.std or 0.0) - spread))
    at_kinks = _at_kinks(model, found, weights, seen, value)
    both = MeanStd(max(of_mean, at_kinks.mean), max(of_std, at_kinks.std or 0.0))
    return both, max(kinked, at_kinks.std or 0.0)


def _at_kinks(
    model: PointModel, found: Evaluations, weights: Array, seen: Witnesses, value: MeanStd
) -> MeanStd:
    """Errors of a rule of one germ by kinks, where contacts of solved points have other states."""
    if not seen.states.shape[1] or not value.std:
        return MeanStd(0.0, 0.0)
    rule = found.points[:, 0]
    order = np.argsort(rule)
    at, every = np.concatenate([rule, seen.points[:, 0]]), np.concatenate([found.values, seen.values])
    states = np.concatenate([all_states_of(model.contacts(found), len(rule)), seen.states])
    of_first, of_second = error_by_kinks(rule[order], weights[order], at, every, states, value.mean)
    return MeanStd(of_first, of_second / (2.0 * value.std))


def _again(model: PointModel, found: Evaluations, weights: Array) -> float:
    """How far points with the most weight in mean and deviation are at most from the same ones solved to a
    hundredth of the tolerance; NaN: one did not converge."""
    values = found.values
    of_std = np.argsort(-np.abs(weights) * (values - weights @ values) ** 2, kind="stable")
    chosen = list(dict.fromkeys([int(np.argmax(np.abs(weights))), *(int(k) for k in of_std)]))[:AGAIN]
    again = model(found.points[chosen], max(0.01 * found.rtol, FINEST), cold=not model.linear)
    return float(np.max(np.abs(again.values - values[chosen]))) if again.exact else float("nan")
