"""Kinks of a quantity along one germ: between solved points whose contacts are in another state.

A Gauss rule integrates max(x - c, 0) wrongly by a kernel of c, which between two of its points a distance d
apart, where the density is p, is p d^2 / 8 at most (that of the midpoint rule, with c at a midpoint; of the
mean over c nothing is left: Brass and Petras, Quadrature Theory, 2011). A point w of the rule stands for p d.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.moments.model import ContactStates

__all__ = ["all_states_of", "error_by_kinks", "opening_directions"]

ONE_POINT = 1e-3
"""Distance of two solved points, relative to the points of the rule, below which they are one."""

NOTHING = 1e-9
"""Share of the largest force, or gap, below which there is none."""


def all_states_of(contacts: Sequence[ContactStates], count: int) -> Array:
    """How many points of each contact are open, and how many slip, side by side at n points: (n, 2 contacts)
    numbers."""
    return np.concatenate([np.zeros((count, 0)), *(each.counts for each in contacts)], axis=1)


def opening_directions(contacts: Sequence[ContactStates], scores: Array) -> list[tuple[float, Array]]:
    """How far out contacts open, or close if hardly one is closed, and in which direction (L,) of the normal
    scores (n, L) of solved points.

    Where the force on them, or their gap, is linear in these (FORM: Hasofer and Lind, J. Eng. Mech. Div. 100,
    1974).
    """
    found = []
    for contact in contacts:
        for of_points in (contact.pressed, contact.apart):
            left = of_points()
            before = left > NOTHING * np.abs(left).max(initial=0.0)
            if np.count_nonzero(before) > scores.shape[1] + 1:
                break
        else:
            continue
        terms = np.column_stack([np.ones(np.count_nonzero(before)), scores[before]])
        first, *slope = np.linalg.lstsq(terms, left[before], rcond=None)[0]
        steepness = float(np.linalg.norm(slope))
        if first > 0.0 and steepness > NOTHING * first:
            found.append((float(first) / steepness, -np.asarray(slope) / steepness))
    return found


def error_by_kinks(
    rule: Array, weights: Array, at: Array, values: Array, states: Array, mean: float
) -> tuple[float, float]:
    """What kinks may do to the first and to the second central moment by a rule of one germ.

    Many points of a contact that change their state one after the other are as many small kinks, whose errors
    have signs of chance; all at once they are one.

    Parameters
    ----------
    rule, weights
        Points (k,) of the rule in rising order and their weights, of sum 1.
    at, values, states
        Solved points (n,), those of the rule among them, the quantity there, and what tells the states of
        contacts apart, (n, k).
    """
    order = np.argsort(at)
    apart = ONE_POINT * float(np.diff(rule).min(initial=np.inf))
    kept = [order[0]]
    kept += [k for before, k in zip(order[:-1], order[1:], strict=True) if at[k] - at[before] > apart]
    x, v, s = at[kept], values[kept], states[kept]
    if len(x) < 3:
        return 0.0, 0.0
    slopes = np.diff(v) / np.diff(x)
    changed = np.abs(np.diff(s, axis=0)).sum(axis=1)
    squares = np.zeros(2)
    for k in np.flatnonzero(changed):
        bend = abs(slopes[min(k + 1, len(slopes) - 1)] - slopes[max(k - 1, 0)])
        i = int(np.searchsorted(rule, 0.5 * (x[k] + x[k + 1])))
        ends = rule[max(i - 1, 0)], rule[min(i, len(rule) - 1)]
        reach = max(ends[1], x[k + 1]) - min(ends[0], x[k]) if ends[0] == ends[1] else ends[1] - ends[0]
        weight = float(weights[[max(i - 1, 0), min(i, len(rule) - 1)]].max())
        alone = max(changed[k] / changed.sum(), changed[k] ** -0.5)
        error = alone * bend * reach * weight / 8.0
        squares += np.square([error, 2.0 * error * max(abs(v[k] - mean), abs(v[k + 1] - mean))])
    of_first, of_second = np.sqrt(squares)
    return float(of_first), float(of_second)
