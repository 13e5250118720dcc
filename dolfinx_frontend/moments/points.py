"""Points of the germs, and their weights.

Half of the *wide* points follow the distribution of the germs, the other half a wider one, so that what
happens at 3 to 6 standard deviations is met. Each is weighted by the ratio of its density to that of the
mixture, which is at most 2. *Calibrated* weights are changed as little as possible so that polynomials of low
degree are integrated exactly: the smooth part of a quantity then has no sampling error.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import comb
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.space import RandomSpace, sobol_points
from dolfinx_frontend.uncertainty.statistics import MeanStd, Statistic

__all__ = [
    "FARTHEST",
    "FIRST_PANELS",
    "POINTS",
    "SETS",
    "SURE",
    "Panel",
    "calibrated",
    "kinks_at_ends",
    "misfit_of_halves",
    "moments_of_sets",
    "normal_scores",
    "panel_points",
    "wide_points",
]

SETS = 8
"""Independent sets of calibrated samples."""

SURE = 3.0
"""Standard errors of the mean of the sets that an error is at most: of Student's t with 7 degrees of freedom,
2 % are beyond."""

MOST_DEGREE = 4
"""Degree up to which calibrated samples integrate polynomials exactly."""

FIRST_PANELS = (-8.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 8.0)
"""Ends of the pieces of the normal score of a single germ that are split where there are kinks."""

POINTS = 4
"""Gauss points of a piece."""

FARTHEST = 8.2
"""Largest normal score of a point."""

DIFFERENT = 1e-6
"""Share of a function that is no combination of others, above which it is one of its own."""


def wide_points(
    space: RandomSpace, count: int, seed: int, centre: Array | None = None
) -> tuple[Array, Array]:
    """Points (count, L) of the germs and weights (count,) of mean about 1; half of a power of two each.

    `centre`: normal scores (L,) of what happens far out and seldom: half of the wider ones are drawn there.
    """
    stop_if_pressed()
    dimension = space.dimension
    nowhere: Array = np.zeros(dimension)
    wide = float(np.sqrt(1.0 + 3.0 / dimension))
    kinds: list[tuple[Array, float, int]] = [(nowhere, 1.0, count // 2), (nowhere, wide, count // 2)]
    if centre is not None:
        kinds[1:] = [(nowhere, wide, count // 4), (centre, 1.0, count // 4)]
    tiny = 2.0**-54
    scores = []
    for kind, (middle, scale, number) in enumerate(kinds):
        unit = sobol_points(dimension, number, np.random.default_rng([seed, kind]))
        scores.append(middle + scale * special.ndtri(np.clip(unit, tiny, 1.0 - tiny)))
    z = np.concatenate(scores)
    own = 0.5 * np.sum(z**2, axis=1)
    density = np.zeros(len(z))  # of the mixture, over that of the germs
    for middle, scale, number in kinds:
        away = own - 0.5 * np.sum((z - middle) ** 2, axis=1) / scale**2 - dimension * np.log(scale)
        density += number / count * np.exp(np.minimum(away, 700.0))
    return space.from_normal(np.clip(z, -FARTHEST, FARTHEST)), np.asarray(1.0 / density, dtype=np.float64)


def normal_scores(space: RandomSpace, points: Array) -> Array:
    """Normal scores (n, L) of points of the germs, at the end of a law as far out as points are drawn."""
    return np.clip(space.to_normal(points), -FARTHEST, FARTHEST)


def calibrated(
    space: RandomSpace,
    points: Array,
    weights: Array,
    controls: tuple[Array, Array] | None = None,
    most: int | None = None,
    free: Array | None = None,
) -> Array:
    """Weights (n,) of sum 1 close to the given ones that integrate polynomials of low degree exactly, and
    `controls`: functions (n, k) at the points, and their expectations (k,). `most`: highest degree. `free`:
    (n,) how much a weight may change beside those of 1; None: all are alike."""
    stop_if_pressed()
    count, dimension = len(points), space.dimension
    plain = weights / weights.sum()
    own = plain if free is None else free * plain
    if most is None:
        most = MOST_DEGREE if dimension > 1 else 2 * MOST_DEGREE
    for degree in range(most, -1 if controls is not None else 0, -1):
        if 5 * comb(dimension + degree, degree) > count and degree > 0:
            continue
        psi = space.basis(Chaos(order=degree)).evaluate(points)
        wanted = np.eye(1, psi.shape[1])[0]
        if controls is not None and np.all(np.isfinite(psi)):
            psi, wanted = _with_controls(psi, wanted, own, *controls)
        if not np.all(np.isfinite(psi)):
            continue
        gram = psi.T @ (own[:, None] * psi)
        values, vectors = np.linalg.eigh(gram)
        if values[0] < 1e-8 * values[-1]:
            continue
        change: Array = psi @ (vectors @ ((vectors.T @ (wanted - psi.T @ plain)) / values))
        factor = 1.0 + (change if free is None else free * change)
        if factor.min() > -0.5:
            return np.asarray(plain * factor, dtype=np.float64)
    return np.asarray(plain, dtype=np.float64)


def _with_controls(
    psi: Array, wanted: Array, weights: Array, controls: Array, means: Array
) -> tuple[Array, Array]:
    """Functions (n, k) and their expectations (k,), with those controls that are no combination of others."""
    for control, mean in zip(controls.T, means, strict=True):
        root = np.sqrt(weights)
        size = float(np.sqrt(weights @ control**2))
        line, *_ = np.linalg.lstsq(psi * root[:, None], control * root, rcond=None)
        rest = control - psi @ line
        left = float(np.sqrt(weights @ rest**2))
        if left > DIFFERENT * size:
            psi = np.column_stack([psi, rest / left])
            wanted = np.append(wanted, (mean - wanted @ line) / left)
    return psi, wanted


def moments_of_sets(
    statistic: Statistic, values: Array, weights: Array, labels: Ints
) -> tuple[MeanStd, float, float]:
    """The statistic of values over sets, whose numbers are the labels (n,), with weights (n,) of sum 1, and
    the errors of both."""
    value = statistic.value(values, weights)
    sets = int(labels.max()) + 1
    each = [(values[labels == k], sets * weights[labels == k]) for k in range(sets)]
    own = np.array([[0.0 if x is None else x for x in statistic.value(v, w)] for v, w in each])
    spread = SURE * own.std(axis=0, ddof=1) / np.sqrt(sets)
    # what the sets have in common is the bias of so few samples each
    bias = np.abs(own.mean(axis=0) - [value.mean, value.std or 0.0])
    return value, float(spread[0] + bias[0]), float(spread[1] + bias[1])


# --- pieces of one germ -----------------------------------------------------------------------------
class Panel(NamedTuple):
    """A piece of the range of the normal score of one germ, with what its points say."""

    lower: float
    upper: float
    sums: Array  # (3,): 1, value and square of the value, integrated with the density
    error: Array  # (3,): how much they changed when the panel that this is half of was split
    values: Array  # (POINTS,) of the quantity
    misfit: Array  # (3,) of the polynomials of that panel at the points of its halves; infinite: not known


def misfit_of_halves(parent: Array, halves: Array) -> Array:
    """(3,) root mean square differences of 1, value and square at the points of both halves of a panel
    (2 POINTS,) from the polynomials of its own points (POINTS,)."""
    at, _ = np.polynomial.legendre.leggauss(POINTS)
    own = np.vander(at, POINTS)
    beside = np.vander(np.concatenate([0.5 * (at - 1.0), 0.5 * (at + 1.0)]), POINTS)
    off = [halves**k - beside @ np.linalg.solve(own, parent**k) for k in range(3)]
    return np.array([float(np.sqrt(np.mean(each**2))) for each in off])


def kinks_at_ends(panels: Sequence[Panel]) -> list[Array]:
    """(3,) errors of the sums over panels by kinks between their last points and their ends.

    No point is there. The polynomials of both sides meet at the kink and differ at the end by the kink times
    its distance, which is at most that of the last point: half of their product is not integrated.
    """
    at, _ = np.polynomial.legendre.leggauss(POINTS)
    own = np.linalg.inv(np.vander(at, POINTS))
    of_lower, of_upper = (np.vander([end], POINTS)[0] @ own for end in (-1.0, 1.0))
    out: list[Array] = [np.zeros(3) for _ in panels]
    order = sorted(range(len(panels)), key=lambda k: panels[k].lower)
    for one, other in pairwise(order):
        left, right = panels[one], panels[other]
        density = float(np.exp(-0.5 * left.upper**2) / np.sqrt(2.0 * np.pi))
        off = np.array([abs(of_upper @ left.values**k - of_lower @ right.values**k) for k in range(3)])
        for k, panel in ((one, left), (other, right)):
            unseen = 0.5 * (1.0 - float(at[-1])) * (panel.upper - panel.lower)
            out[k] += 0.5 * unseen * density * off
    return out


def panel_points(panels: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    """Normal scores and weights (panels, POINTS) of Gauss rules with the normal density."""
    at, weights = np.polynomial.legendre.leggauss(POINTS)
    ends = np.array(panels)
    half = 0.5 * (ends[:, 1] - ends[:, 0])[:, None]
    z = ends[:, :1] + half * (1.0 + at)
    return z, half * weights * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
