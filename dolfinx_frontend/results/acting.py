"""Numbers of loads of parts in an answer: what a load is multiplied with in a sample, at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from latin_core import SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.scene.loads import OF_STIFFNESS, LoadTerm

__all__ = ["factors_of", "load_factors", "mean_number", "stiffness_factors", "swept_loads", "with_loads"]

STIFFNESS = "part.stiffness"
"""The kernel's name for the factor of the stiffness of a part, which is named in place of an interface."""


def swept_loads(plan: Plan, values: Mapping[LoadTerm, Array]) -> list[SweptParameter]:
    """Numbers of loads at all points, (N,) each, as the kernel adds them to the amplitudes of a plan."""
    found = []
    fixed = len(plan.patterns)
    for row, (term, mean) in enumerate(zip(plan.loads, plan.load_means, strict=True)):
        if term in values:
            pattern = np.zeros((fixed + len(plan.loads), plan.load_factors.shape[1]))
            pattern[fixed + row] = plan.load_factors[row]
            away = (values[term] - mean)[None, :]
            found.append(SweptParameter("", "", pattern.ravel(order="F")[:, None], away, 1))
    return found


def stiffness_factors(values: Mapping[str, Array]) -> list[SweptParameter]:
    """Factors (N,) or (N, cells) of the stiffness of parts at all points, as the kernel takes them."""
    found = []
    for part, each in values.items():
        factors = each.reshape(len(each), -1).T
        found.append(SweptParameter(part, STIFFNESS, np.ones((1, len(factors))), factors, 1))
    return found


def factors_of(
    problem: Problem, parameters: Sequence[SweptParameter], points: slice
) -> dict[str, tuple[Array, None]]:
    """Of them those of some points and of parts of this rank, for laws that are asked at all of these side by
    side."""
    return {
        each.interface: (each.values[:, points], None)
        for each in parameters
        if each.parameter == STIFFNESS and each.interface in problem.substructures
    }


def with_loads(plan: Plan, parameters: Sequence[SweptParameter], points: slice) -> Array:
    """Amplitudes (l, points * columns) of a plan with the loads of some points."""
    shape = plan.amplitudes.shape
    count = len(range(*points.indices(parameters[0].values.shape[1]))) if parameters else 1
    total = np.repeat(plan.amplitudes[None], count, axis=0)
    for each in parameters:
        if not each.interface:
            added = each.pattern @ each.values[:, points]  # (l * c, points)
            total += np.moveaxis(added.reshape(*shape, count, order="F"), -1, 0)
    return np.asfortranarray(np.moveaxis(total, 0, 1).reshape(shape[0], -1))


def mean_number(problem: Problem, term: LoadTerm) -> Array:
    """A number of a load, random ones at their means, (1,)."""
    if term.load == OF_STIFFNESS:
        return np.ones(1)
    return np.array([sum(n.mean for n in problem.numbers_of(term))])


def load_factors(
    problem: Problem, times: Array | None, load: str, parameter: str, of: Callable[[LoadTerm], Array]
) -> Array:
    """What a shape of a load is multiplied with, (n, [T]).

    Parameters
    ----------
    of
        A number of a load -> its values (n,).
    """
    if load == OF_STIFFNESS:
        return of(LoadTerm(load, parameter, None))
    total: Any = 0.0
    for term in problem.loads[load].keys():
        if term.parameter == parameter:
            values, amplitude = of(term), term.amplitude
            if times is None:
                total = total + values
                continue
            total = total + np.outer(values, [1.0 if amplitude is None else amplitude(t) for t in times])
    return np.asarray(total, dtype=np.float64)
