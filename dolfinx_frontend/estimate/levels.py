"""Scatter of nonlinear laws that is found on a coarse mesh and solved at few points of a fine one.

How many points a quantity needs hardly depends on the mesh: the search for them, with its witnesses, is made
where points are cheap. The fine mesh gets as few as the coarse one says are enough, and every one of them is
compared with the same point of the coarse mesh: what the meshes change is smooth, and an iteration that has
stopped at another state stands out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from latin_core import Options

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.estimate.adaptive import solve_to_accuracy
from dolfinx_frontend.estimate.errors import errors
from dolfinx_frontend.evaluate.model import QuantityModel
from dolfinx_frontend.kernel.fitting import solver_of
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.moments.points import SETS, SURE, calibrated, wide_points
from dolfinx_frontend.plan.plan import Method, plan_of_random
from dolfinx_frontend.plan.price import Way
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.statistics import FINEST, ErrorShare, MeanStd, share_of, size_of, whole_of

__all__ = ["CoarsePoints", "FinePoints", "coarse_points", "fine_points"]

OF_COARSE, OF_RULE = 0.5, 0.5
"""Shares of what the meshes leave of the accuracy: of the points of the coarse mesh, and of the fine one."""

FEW = (2, 3, 4, 5, 7, 9)
"""Points per germ of the rules that may do on the fine mesh."""

MOST_FEW = 128

SAMPLES = (4, 8, 16, 32, 64, 128)
"""Samples of each set that may do there."""

TIGHT_FINE, LOOSEST_FINE = 3e-2, 1e-5
"""Tolerance of points that are compared with those of another mesh, relative to the accuracy of the
deviation, and the loosest: what a point is off there stands out."""

MOST_DEGREE = 3
"""Of polynomials that tell what of a change from mesh to mesh is smooth."""

LEAST = 4
"""Points of the fine mesh at least: two of them tell a line."""

LEAST_REST, CERTAIN = 2, 0.975
"""Points that a fit must leave over, and the probability at which what these few tell is made larger."""

OF_TWO = 0.02
"""Accuracy below which two points per germ do not tell enough of a change from mesh to mesh."""


# --- points -----------------------------------------------------------------------------------------
class CoarsePoints(NamedTuple):
    """What the coarse mesh says."""

    chaos: ChaosResult  # of order 1, on its solver
    samples: SampleResult  # as many as the accuracy wants there
    made: Errors
    rtol: float


class FinePoints(NamedTuple):
    """Points of the fine mesh, and their errors but for those of the mesh."""

    samples: SampleResult
    made: Errors


def coarse_points(
    coarse: ChaosResult, accuracy: float, quantity: Resultant, method: Method, settings: Mapping[str, Any]
) -> CoarsePoints | None:
    """The points that an accuracy wants on the coarse mesh; None: these would not tell of another mesh.

    Random fields have other modes on other meshes.
    """
    random = coarse.random
    if random.of_fields or not coarse.collocations:
        return None
    found = solve_to_accuracy(
        coarse.problem,
        max(OF_COARSE * accuracy, 1e-10),
        quantity,
        method,
        meshes=False,
        first=coarse,
        **settings,
    )
    made = found.errors()
    if not isinstance(found, SampleResult) or not made.reached or not found.converged or not found.complete:
        return None
    value = found.mean_std(quantity)
    spread = min(share_of(max(value.std or 0.0, quantity.compared.least), value.mean), 1.0)
    if not spread > 0.0:
        return None
    rtol = float(np.clip(TIGHT_FINE * accuracy * spread, FINEST, LOOSEST_FINE))
    return CoarsePoints(coarse, found, made, rtol)


def _fewer(known: CoarsePoints, accuracy: float) -> Iterator[tuple[Array, Array, bool, str]]:
    """Points (n, L), weights (n,) of sum 1, whether these may be changed, and a name; few points first."""
    space, most = known.chaos.space, len(known.samples.germs)
    for count in FEW if accuracy > OF_TWO else FEW[1:]:
        counts = [count if g.capacity is None else min(count, g.capacity) for g in space.germs]
        if np.prod(counts, dtype=float) > min(MOST_FEW, most):
            break
        rule = space.tensor_gauss(counts)
        yield rule.points, np.asarray(rule.weights), count == FEW[0], f"{count} points per germ"
    for each in SAMPLES:
        if SETS * each >= most:
            break
        points, weights = wide_points(space, SETS * each, 0)
        yield points, calibrated(space, points, weights), True, f"{SETS * each} samples"


def _with_moments(weights: Array, values: Array, exact: MeanStd) -> Array:
    """Weights (n,) of sum 1 close to the given ones that give values (n,) their mean and deviation."""
    std = exact.std or 0.0
    if not std > 0.0:
        return weights
    v = (values - exact.mean) / std
    rows = np.stack([np.ones_like(v), v, v**2])
    gram = (rows * np.abs(weights)) @ rows.T
    if not np.linalg.cond(gram) < 1e8:
        return weights
    change = np.linalg.solve(gram, np.array([1.0, 0.0, 1.0]) - rows @ weights)
    made: Array = weights + np.abs(weights) * (change @ rows)
    return made if np.abs(made).sum() < 2.0 * np.abs(weights).sum() else weights


def fine_points(
    known: CoarsePoints,
    problem: Problem,
    before: Solver,
    accuracy: float,
    quantity: Resultant,
    method: Method,
    options: Options,
    settings: Mapping[str, Any],
) -> FinePoints | None:
    """As few points as will do on a fine mesh; None: that is not known.

    Parameters
    ----------
    before
        Factors that may be kept.
    accuracy
        That mean and deviation are to have on this mesh.
    """
    random = RandomLaws.of(problem)
    if random.space.germ_names != known.chaos.space.germ_names:
        return None
    exact = known.samples.mean_std(quantity)
    whole = whole_of(exact, 1e-10, quantity) or size_of(exact, quantity)
    solver = None
    for points, weights, free, told in _fewer(known, accuracy):
        coarse = QuantityModel.of_chaos(known.chaos, quantity)(points, known.samples.plan.options.rtol).values
        if free:
            weights = _with_moments(weights, coarse, exact)
        own = quantity.statistic.value(coarse, weights)
        of_mean, of_std = abs(own.mean - exact.mean), abs((own.std or 0.0) - (exact.std or 0.0))
        if max(share_of(of_mean, size_of(exact, quantity)), share_of(of_std, whole)) > OF_RULE * accuracy:
            continue
        if solver is None:
            plan = plan_of_random(
                "solve",
                random,
                None,
                Way(points=len(points)),
                method=method,
                options=options.with_(rtol=known.rtol),
                **settings,
            )
            same = plan.columns == before.plan.columns and plan.shares_factors(before.plan)
            kept = before.problem is problem and same
            solver = before if kept else solver_of(problem, plan, before=before)
        model = QuantityModel(solver, random, plan, quantity, False, errors)
        solved = model(points, known.rtol)
        samples: SampleResult = replace(solved.answer, weights=weights)
        found = _compared(known, model, samples, coarse, MeanStd(of_mean, of_std), told)
        if found is not None and found.total <= accuracy:
            return FinePoints(samples, found)
    return None


def _compared(
    known: CoarsePoints, model: QuantityModel, samples: SampleResult, coarse: Array, off: MeanStd, told: str
) -> Errors | None:
    """Errors of points of the fine mesh, the same ones having the values `coarse` (n,) on the coarse mesh,
    where they are `off`; None: a point cannot be believed."""
    quantity = model.quantity
    values = quantity.at_end(samples, samples)
    weights = samples.probabilities
    value = samples.mean_std(quantity)
    whole = whole_of(value, known.rtol, quantity)
    if whole is None or len(values) < LEAST or not samples.converged:
        return None
    # what the meshes change: as the value of the coarse mesh does, smoothly, and besides
    root = np.sqrt(np.abs(weights))
    rows = np.stack([np.ones_like(coarse), coarse - coarse.mean()])
    line, *_ = np.linalg.lstsq((rows * root).T, values * root, rcond=None)
    rest = values - line @ rows
    size_of_rest = _size_of_rest(rest, weights, len(rows))
    for degree in range(1, MOST_DEGREE + 1):
        psi = samples.space.basis(Chaos(order=degree)).evaluate(samples.germs)
        count = psi.shape[1] + 1
        if count + LEAST_REST > len(values):
            break
        both = np.column_stack([psi, coarse])
        smooth, *_ = np.linalg.lstsq(both * root[:, None], values * root, rcond=None)
        left = values - both @ smooth
        size = _size_of_rest(left, weights, count)
        if size < size_of_rest:
            rest, size_of_rest = left, size
    doubt = SURE * size_of_rest * float(np.sqrt(np.sum(weights**2)))
    # the most important points and those that stand out, from nothing and tighter
    important = int(np.argmax(np.abs(weights) * (values - value.mean) ** 2))
    apart = int(np.argmax(np.abs(rest)))
    chosen = list(dict.fromkeys([important, apart]))
    again = model(samples.germs[chosen], max(0.1 * samples.plan.options.rtol, FINEST), cold=True)
    away = np.abs(again.values - values[chosen]).max()
    how = "points solved again, and tighter"
    algebraic = ErrorShare(float(np.max(samples.error)), float(away), float(away), how)
    before = known.samples.mean_std(quantity)
    of_coarse = known.made.truncation
    if of_coarse is None or before.std is None:
        return None
    scale = abs(float(line[1]))
    of_mean = scale * ((of_coarse.quantity or 0.0) + off.mean) + doubt
    of_std = scale * ((of_coarse.std or 0.0) + (off.std or 0.0)) + doubt
    how = f"{told}, compared with {len(known.samples.germs)} of the first mesh ({of_coarse.how})"
    truncation = ErrorShare(np.nan, of_mean, of_std, how)
    seconds = sum(samples.seconds.values())
    return Errors(
        algebraic,
        truncation,
        None,
        quantity,
        value,
        whole,
        notes=known.made.notes,
        next_halving=f"twice the points, about {2.0 * seconds:.2g} s",
    )


def _size_of_rest(rest: Array, weights: Array, terms: int) -> float:
    """Root mean square of what a fit with so many terms leaves (n,), larger where it left few points over."""
    free = len(rest) - terms
    size = float(np.sqrt(np.sum(np.abs(weights) * rest**2) * len(rest) / free))
    return size * float(stats.t.ppf(CERTAIN, free) / stats.norm.ppf(CERTAIN))
