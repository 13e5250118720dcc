"""Kinks of a quantity along one germ: between solved points whose contacts are in another state.

A Gauss rule integrates max(x - c, 0) wrongly by a kernel of c, which between two of its points a distance d
apart, where the density is p, is p d^2 / 8 at most (that of the midpoint rule, with c at a midpoint; of the
mean over c nothing is left: Brass and Petras, Quadrature Theory, 2011). A point w of the rule stands for p d.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.contact import NOTHING, contact_states
from dolfinx_frontend.results.samples import SampleResult

__all__ = ["all_states_of", "contacts_of", "error_by_kinks", "kinds_of_states", "opening_directions",
           "states_of"]

ONE_POINT = 1e-3
"""Distance of two solved points, relative to the points of the rule, below which they are one."""


def states_of(answer: ChaosResult | SampleResult) -> dict[str, Array]:
    """Contact -> how many of its points are open, and how many slip, at the end of every sample, or of those
    by which a chaos has its moments, (n, 2). Collective."""
    names = contacts_of(answer)
    return {name: answer.everywhere(name, partial(_counts, answer, name)) for name in names}


def contacts_of(answer: ChaosResult | SampleResult) -> list[str]:
    """Active interfaces whose points may open."""
    interfaces, active = answer.problem.interfaces, answer.plan.active
    return [name for name, each in interfaces.items() if each.law.unilateral and name in active]


def all_states_of(samples: SampleResult) -> Array:
    """The same of all contacts side by side, (n, 2 contacts)."""
    return np.concatenate([np.zeros((len(samples.germs), 0)), *states_of(samples).values()], axis=1)


def kinds_of_states(answer: ChaosResult | SampleResult) -> Array:
    """Of every contact whether any of its points is open, any is closed, and any slips, side by side, (n, 3
    contacts). Collective."""
    names = contacts_of(answer)
    return np.concatenate([answer.everywhere(n, partial(_kinds, answer, n)) for n in names], axis=1)


def _kinds(answer: ChaosResult | SampleResult, name: str) -> Array:
    opened, slipping = _counts(answer, name).T
    closed = opened < answer.problem.interfaces[name].num_points
    return np.stack([opened > 0.0, closed, slipping > 0.0], axis=-1)


def _counts(samples: ChaosResult | SampleResult, name: str) -> Array:
    """Open and slipping points of a contact, (n, 2)."""
    found = []
    for block in samples.moment_blocks() if isinstance(samples, ChaosResult) else samples.blocks():
        force, contact = np.asarray(block.force(name)), block.contact(name)
        if samples.times is not None:
            force = force[:, -1]
        limits = None if contact is None else contact.limits
        if limits is not None:
            limits = limits[0][:, -1], limits[1][:, -1]
        states = contact_states(force[..., 0], np.linalg.norm(force[..., 1:], axis=-1), limits)
        found.append(np.stack([np.count_nonzero(each, axis=-1) for each in states], axis=-1))
    return np.concatenate(found, dtype=np.float64)


def opening_directions(samples: SampleResult, scores: Array) -> list[tuple[float, Array]]:
    """How far out contacts open, or close if hardly one is closed, and in which direction (L,) of the normal
    scores (n, L) of samples.

    Where the force on them, or their gap, is linear in these (FORM: Hasofer and Lind, J. Eng. Mech. Div. 100,
    1974). Collective.
    """
    found = []
    for name in contacts_of(samples):
        for of_samples in (_pressed, _apart):
            left = samples.everywhere(name, partial(of_samples, samples, name))
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


def _pressed(samples: SampleResult, name: str) -> Array:
    """Force that presses a contact together at the end of every sample, (n,)."""
    force = np.asarray(samples.force(name))
    force = force if samples.times is None else force[:, -1]
    return np.asarray(-force[..., 0] @ samples.problem.interfaces[name].weights)


def _apart(samples: SampleResult, name: str) -> Array:
    """Least gap of the points of a contact at the end of every sample, (n,): 0 where one is closed."""
    found = []
    for block in samples.blocks():
        jump, contact = np.asarray(block.jump(name))[..., 0], block.contact(name)
        if contact is None:
            return np.zeros(len(samples.germs))
        steps = jump if samples.times is not None else jump[:, None]
        gap = (steps + np.broadcast_to(contact.clearance, steps.shape))[:, -1]
        found.append(np.maximum(gap, 0.0).min(axis=-1))
    return np.concatenate(found)


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
