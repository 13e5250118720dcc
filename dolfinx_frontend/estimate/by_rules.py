"""Answers by tensor Gauss rules of few germs, which witnesses and the next degree must agree with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.estimate.by_points import Keep, of_solved_again, so_far
from dolfinx_frontend.estimate.errors import FINEST, complete, size_of, whole_of
from dolfinx_frontend.estimate.kinks import all_states_of, error_by_kinks
from dolfinx_frontend.estimate.points import (
    EXACT,
    Witnesses,
    misfit,
    solved,
    solved_alone,
    surrogate,
)
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors, ErrorShare, MeanStd, share_of
from dolfinx_frontend.results.resultant import Wanted
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace

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
    result: ChaosResult, quantity: Wanted, target: float, rtol: float, seen: Witnesses, keep: Keep
) -> tuple[SampleResult, Errors] | None:
    """Tensor Gauss rules of rising order; None: none does in time.

    Two witnesses must agree with the polynomial that a rule sees: points that it has not seen, and the
    polynomial with the next degree, which goes through all of them. Points of nonlinear laws are solved from
    nothing each.
    """
    space = result.space
    rules = RULES if target > TIGHT_TO else TIGHT_RULES
    for points, more in zip(rules, (*rules[1:], rules[-1]), strict=True):
        counts = [points if g.capacity is None else min(points, g.capacity) for g in space.germs]
        rule = space.tensor_gauss(counts)
        weights = np.asarray(rule.weights)
        if len(rule.points) > MOST_TENSOR:
            return None
        samples = _solved(result, rule.points, weights, rtol, quantity)
        value, values = samples.mean_std(quantity), quantity.at_end(samples, samples)
        size = size_of(value, quantity)
        whole = whole_of(value, rtol, quantity) or size
        spread = value.std or 0.0
        if not spread > 0.0 and not value.mean:
            return None  # nothing happens at any point of the rule
        smooth = surrogate(space, counts, rule.points, weights, values)
        off = misfit(seen, smooth(seen.points), value)
        beyond = next_degree(space, counts, rule.points, weights, values, seen)
        kinked = share_of(off.size, spread) ** KINKED * spread
        of_mean, of_std = off.mean, off.std
        if beyond is None:
            of_mean = of_std = np.inf
        else:
            kinked = min(kinked, BEYOND * share_of(beyond.rest, spread) ** KINKED * spread)
            of_mean = max(of_mean, kinked, abs(beyond.moments.mean - value.mean))
            of_std = max(of_std, kinked, abs((beyond.moments.std or 0.0) - spread))
        at_kinks = _at_kinks(samples, values, seen, value)
        of_mean, of_std = max(of_mean, at_kinks.mean), max(of_std, at_kinks.std or 0.0)
        kinked = max(kinked, at_kinks.std or 0.0)
        how = f"the next degree beside {points} points per germ, and {len(seen.points)} points outside"
        truncation = ErrorShare(np.nan, of_mean, of_std, how)
        keep(samples, so_far(samples, truncation, quantity, value, whole))
        if max(share_of(of_mean, size), share_of(of_std, whole)) <= 0.5 * target:
            least = min(size, whole)
            away = _again(result, samples, quantity, values)
            while not away <= 0.3 * target * least and rtol > 1e-10:
                rtol = max(0.01 * rtol, FINEST)
                samples = _solved(result, rule.points, weights, rtol, quantity)
                value, values = samples.mean_std(quantity), quantity.at_end(samples, samples)
                away = _again(result, samples, quantity, values)
            if not away <= 0.3 * target * least:
                return None
            made = of_solved_again(samples, away, truncation, quantity, value, whole)
            count = more**space.dimension
            seconds = sum(samples.seconds.values()) * count / len(rule.points)
            return samples, replace(
                made, next_halving=f"{more} points per germ, {count} solves, about {seconds:.2g} s"
            )
        enough = 7 if space.dimension == 1 else 5
        if kinked > 5.0 * target * whole and points >= enough:
            return None  # a kink: more points would not do
    return None


def _at_kinks(samples: SampleResult, values: Array, seen: Witnesses, value: MeanStd) -> MeanStd:
    """Errors of a rule of one germ by kinks, where contacts of solved points have other states."""
    if not seen.states.shape[1] or not value.std:
        return MeanStd(0.0, 0.0)
    rule = samples.germs[:, 0]
    order = np.argsort(rule)
    at, every = np.concatenate([rule, seen.points[:, 0]]), np.concatenate([values, seen.values])
    states = np.concatenate([all_states_of(samples), seen.states])
    of_first, of_second = error_by_kinks(
        rule[order], samples.probabilities[order], at, every, states, value.mean
    )
    return MeanStd(of_first, of_second / (2.0 * value.std))


def _solved(
    result: ChaosResult, points: Array, weights: Array, rtol: float, quantity: Wanted
) -> SampleResult:
    """The points of a rule: of linear laws neighbours help each other, and mislead none."""
    solve = solved_alone if result.collocations else solved
    samples = solve(result, points, weights, rtol, quantity)
    complete(samples)
    return samples


def _again(result: ChaosResult, samples: SampleResult, quantity: Wanted, values: Array) -> float:
    """How far points with the most weight in mean and deviation are at most from the same ones solved to a
    hundredth of the tolerance; NaN: one did not converge."""
    weights = samples.probabilities
    of_std = np.argsort(-np.abs(weights) * (values - weights @ values) ** 2, kind="stable")
    chosen = list(dict.fromkeys([int(np.argmax(np.abs(weights))), *(int(k) for k in of_std)]))[:AGAIN]
    rtol = max(0.01 * samples.plan.options.rtol, FINEST)
    again = _solved(result, samples.germs[chosen], np.ones(len(chosen)), rtol, quantity)
    if again.status not in EXACT:
        return float("nan")
    return float(np.max(np.abs(quantity.at_end(again, again) - values[chosen])))
