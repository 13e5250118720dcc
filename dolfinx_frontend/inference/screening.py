"""Which of many random inputs matter: derivative-based screening."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import checked_seed, checked_whole
from dolfinx_frontend.common.deferred import special, stats
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.function import check_handed_on, problem_function
from dolfinx_frontend.kernel.spread import check_given_alike
from dolfinx_frontend.plan.plan import check_problem
from dolfinx_frontend.uncertainty.space import sobol_points

__all__ = ["Screening", "bounds_of_indices", "screen"]

RISK = 1e-3
"""Probability that an index is larger than it is said to be at most."""


@dataclass(frozen=True, repr=False)
class Screening:
    """Bounds of total Sobol indices from derivatives.

    Attributes
    ----------
    bounds
        Quantity -> germ -> estimated bound of its total Sobol index: mean square of the derivative with
        respect to its standard normal score, over the variance (I. Sobol, S. Kucherenko, Math. Comput. Simul.
        79 (2009) 3009; the constant of a normal variable is 1). Of a linear quantity it is the index.
    limits
        The same -> what the index is at most, with a probability of 99.9 %: from the scatter of the bound. It
        may be above 1: then it says nothing.
    kinks
        Points at which a derivative was met that does not exist.
    points, runs
        Points of the mean, and points that were solved.
    """

    bounds: Mapping[str, Mapping[str, float]]
    limits: Mapping[str, Mapping[str, float]]
    kinks: int
    points: int
    runs: int

    def unimportant(self, below: float = 0.01) -> tuple[str, ...]:
        """Germs whose index is at most a share of the variance, for every quantity."""
        names = next(iter(self.limits.values()))
        return tuple(name for name in names if all(each[name] < below for each in self.limits.values()))

    def __repr__(self) -> str:
        lines = [f"Screening: {self.points} points with derivatives, {self.runs} solves"]
        for quantity, bounds in self.bounds.items():
            lines.append(f"  {quantity}: total Sobol indices at most")
            for name, value in sorted(bounds.items(), key=lambda each: -each[1])[:12]:
                lines.append(f"    {name:<24} {self.limits[quantity][name]:.3g} (estimate {value:.3g})")
            if len(bounds) > 12:
                lines.append(f"    and {len(bounds) - 12} smaller ones")
        lines.append(f"  {len(self.unimportant())} of {len(next(iter(self.bounds.values())))} below 0.01")
        if self.kinks:
            lines.append(f"  a kink was met at {self.kinks} points")
        return "\n".join(lines)


@together("screen")
def screen(
    problem: Problem, quantities: Any, *, points: int = 32, seed: int = 0, **settings: Any
) -> Screening:
    """Which of the random inputs of a problem cannot matter, from derivatives at a few points.

    Parameters
    ----------
    quantities
        As :meth:`Problem.function` takes them.
    points
        At which derivatives are taken, a power of two; each is a solve, and a gradient with respect to all.
    seed
        Of the points (scrambled Sobol sequence).
    settings
        active, direction, options, plan, times, checkpoint: as for :meth:`Problem.function`.

    Raises
    ------
    SceneError
        Nothing is random, a point does not converge, or a quantity that does not change.
    """
    where = "screen"
    check_problem(where, problem)
    check_handed_on(where, settings)
    checked_whole(where, "points", points, 8)
    if points & (points - 1):
        raise SceneError(f"{where}: points = {points}: give a power of two, e.g. {2 ** points.bit_length()}")
    check_given_alike(
        problem, where, settings.get("points_comm"), quantities=quantities, points=points, seed=seed
    )
    function = problem_function(problem, quantities, None, coordinates="normal", **settings)
    try:
        generator = np.random.default_rng(checked_seed(where, seed))
        unit = sobol_points(function.dimension, points, generator)
        u = special.ndtri(np.clip(unit, 2.0**-54, 1.0 - 2.0**-54))
        found = [function.derivatives(each) for each in u]
        values = function(u)
    finally:
        function.close()
    slopes: Array = np.array([each.values for each in found])  # (points, quantities, inputs)
    variances = values.var(axis=0, ddof=1)
    for number, name in enumerate(function.outputs):
        if not variances[number] > (1e-9 * float(np.abs(values[:, number]).max())) ** 2:
            raise SceneError(
                f"{where}: {name} is the same at all points: it depends on nothing that is random"
            )
    both = [bounds_of_indices(u, values[:, q], slopes[:, q]) for q in range(len(function.outputs))]
    bounds, limits = (np.array(each) for each in zip(*both, strict=True))

    def named(table: Array) -> dict[str, dict[str, float]]:
        return {
            name: {each: float(table[q, i]) for i, each in enumerate(function.inputs)}
            for q, name in enumerate(function.outputs)
        }

    kinks = sum(bool(each.kinks.any()) for each in found)
    return Screening(named(bounds), named(limits), kinks, points, function.solves)


def bounds_of_indices(u: Array, values: Array, slopes: Array) -> tuple[Array, Array]:
    """Bounds (L,) of total Sobol indices, and what they are at most but for :data:`RISK`.

    With g the mean gradient, Cov(f, u) = g (Stein), so that Var(f) = |g|^2 + Var(f - g u): of what is nearly
    linear all but nothing is left to chance. The scatter is that of the logarithm, by leaving out points.

    Parameters
    ----------
    u, values, slopes
        Points (n, L) of standard normal scores, values (n,) and gradients (n, L) there.
    """

    def ratios(kept: Ints) -> Array:
        own = slopes[kept]
        mean = own.mean(axis=0)
        rest = values[kept] - u[kept] @ mean
        return np.asarray(np.mean(own**2, axis=0) / (mean @ mean + rest.var(ddof=1)))

    count = len(values)
    every: Ints = np.arange(count, dtype=np.int64)
    found = ratios(every)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log([ratios(np.delete(every, k)) for k in range(count)])
        scatter = np.sqrt((count - 1.0) / count * ((logs - logs.mean(axis=0)) ** 2).sum(axis=0))
        limits = found * np.exp(stats.t.isf(RISK, count - 1) * scatter)
    return found, np.where(found > 0.0, limits, 0.0)
