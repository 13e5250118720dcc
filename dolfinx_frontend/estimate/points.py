"""Solved points of the germs as witnesses and as answers.

A *witness* is solved on its own, not started from what it judges, and lies where no rule and no chaos has
put its points: half of the witnesses follow the distribution of the germs, the other half a wider one, so
that what happens at 3 to 6 standard deviations is met. Each is weighted by the ratio of its density to that
of the mixture, which is at most 2.

*Calibrated samples* are such points in independent scrambled sets, whose weights are changed as little as
possible so that polynomials of low degree are integrated exactly: the smooth part of a quantity then has no
sampling error. The sets tell the error of their mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import comb, isfinite
from typing import NamedTuple

import numpy as np
from latin_core import SweepPoints

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.interrupts import Interrupted, stop_if_pressed
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.estimate.errors import size_of
from dolfinx_frontend.estimate.kinks import (
    all_states_of,
    contacts_of,
    kinds_of_states,
    opening_directions,
)
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import MeanStd, share_of
from dolfinx_frontend.results.resultant import Wanted
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.solvers.sampling import sample_on
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.space import RandomSpace, latin_points, sobol_points

__all__ = [
    "EXACT",
    "FARTHEST",
    "SAFE",
    "SETS",
    "FIRST_PANELS",
    "POINTS",
    "Lost",
    "Misfit",
    "Panel",
    "Witnesses",
    "beside_fields",
    "calibrated",
    "checked_cold",
    "far_out",
    "few_witnesses",
    "joined",
    "kinks_at_ends",
    "lawful",
    "lost_of_fields",
    "misfit",
    "misfit_of_halves",
    "moments_of_sets",
    "normal_scores",
    "panel_points",
    "solved",
    "solved_alone",
    "surrogate",
    "wide_points",
    "off_witnesses",
    "with_unmet_states",
    "witnesses",
]

SAFE = 3.0
"""What the variance is said to lack, over what it seems to lack by few points."""

SETS = 8
"""Independent sets of calibrated samples."""

SURE = 3.0
"""Standard errors of the mean of the sets that an error is at most: of Student's t with 7 degrees of freedom,
2 % are beyond."""

MOST_DEGREE = 4
"""Degree up to which calibrated samples integrate polynomials exactly."""

CHECKED = 4
"""Points that are solved again from nothing, to a hundredth of the tolerance."""

ALONE, OF_ALL = 48, 8
"""Others that are, each alone, at most, and one of so many."""

AGAIN, AGAIN_LINEAR = 32, 4
"""Points that are solved again to a hundredth of the tolerance, in another order; of linear laws, which no
state misleads, fewer."""

PAIRS, MOST_PAIRS, MOST_PAIRS_CURVED = 32, 128, 32
"""Pairs of samples of what a truncated field leaves out: first, and at most, of linear laws and of others."""

OF_LOST, OF_TARGET = 0.25, 0.1
"""What a standard error of them may be: of what they tell, or of the accuracy."""

ALONG = 1.0
"""See `_lost`."""

SHARED = 4
"""Pairs with the same lost modes and others of the rest: what these do alike says nothing of a deviation."""

MOST_NOT_RESOLVED, UNRESOLVED, MOST_UNRESOLVED = 3.0, 2.5, 0.5
"""How much more modes that points do not resolve are taken to do at most; and by how much more than they have
of the variance, relative to that, and at most: layers with 8 points over two correlation lengths told 1.4
times too little, with 32 points what they lack."""

LEAST_BESIDE_FIELDS = 0.5
"""See `beside_fields`."""

MOST_FIELD_MODES, MOST_PART_MODES = 300, 150
"""Modes of the whole fields at most, of interfaces and of parts, which have a point in every cell."""

TAIL = np.array([2.5, 3.5, 4.5, 5.5, 6.5])
"""Normal scores of the witnesses along each germ."""

FIRST_PANELS = (-8.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 8.0)
"""Ends of the pieces of the normal score of a single germ that are split where there are kinks."""

POINTS = 4
"""Gauss points of a piece."""

EXACT = "converged", "inexact"
"""Statuses of points that are as right as doubles allow."""

MANY_ROWS = 300
"""Rows of the interface data from which on a step of Newton's method costs what about 150 iterations do."""

FEW, FEW_TO = 8, 5e-4
"""Witnesses of a rule that are drawn, and the accuracy from which on there are twice as many."""

MOST_UNMET, OF_UNMET = 8, 2
"""Witnesses are put into so many states of contacts that no other has met, so many into each."""

FAR_OFF = 30.0
"""Deviations that a quantity may be off the polynomial of a rule where no witness is."""

MOST_LINES = 16
"""Most germs that have such witnesses."""

FARTHEST = 8.2
"""Largest normal score of a point."""

DIFFERENT = 1e-6
"""Share of a function that is no combination of others, above which it is one of its own."""


# --- points -----------------------------------------------------------------------------------------
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


# --- solves -----------------------------------------------------------------------------------------
def solved(
    result: ChaosResult,
    points: Array,
    weights: Array,
    rtol: float,
    quantity: Wanted | None = None,
    newton: int | None = None,
) -> SampleResult:
    """Deterministic solves at points of the germs, from neighbour to neighbour: not started from a chaos.

    The tolerance is relative to the whole: what a part scatters by matters as far as the quantity does.
    `newton`: as of the options, None: as it is; points that fail without these steps are not told of.
    """
    options = result.plan.options.with_(rtol=rtol)
    if newton is not None:
        options = options.with_(newton=newton)
    return sample_on(
        result.solver,
        result.random,
        replace(result.plan, options=options),
        points,
        weights / weights.sum(),
        "quadrature",
        keep_states=quantity is not None and quantity.needs_states,
        scatter=False,
        told="failed" if newton is None else "none",
        estimator=result.estimator,
    )


def solved_alone(
    result: ChaosResult, points: Array, weights: Array, rtol: float, quantity: Wanted | None = None
) -> SampleResult:
    """The same, each point from nothing: none can stay where a neighbour is.

    Newton's steps cost more than they save where there are many rows, and are taken then once a point has
    failed without.
    """
    plain = 0 if result.plan.options.newton and result.solver.rows >= MANY_ROWS else None
    found: SampleResult | None = None
    for point in points:
        one = solved(result, point[None], np.ones(1), rtol, quantity, plain)
        if plain is not None and one.status not in (*EXACT, *STOPPED):
            plain = None
            one = solved(result, point[None], np.ones(1), rtol, quantity)
        found = one if found is None else joined(found, one)
        if one.status in STOPPED:
            break
    assert found is not None
    whole = weights[: len(found.germs)]
    return replace(found, weights=whole / whole.sum())


def _both(one: Mapping[str, Array], other: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Fields of some points and of so many others, which have none where Ctrl-C came before the first."""
    return {
        name: np.concatenate([each, other.get(name, np.full((count, *each.shape[1:]), np.nan))])
        for name, each in one.items()
    }


def joined(first: SampleResult, second: SampleResult) -> SampleResult:
    """The points of both in this order, all with the same weight."""
    one, other = first.points, second.points
    count = len(first.germs)
    states = None
    if one.states is not None and other.states is not None:
        states = np.concatenate([one.states, other.states])
    merged = SweepPoints(
        iterations=np.concatenate([one.iterations, other.iterations]),
        error=np.concatenate([one.error, other.error]),
        seconds=np.concatenate([one.seconds, other.seconds]),
        status=np.concatenate([one.status, other.status]),
        forces=_both(one.forces, other.forces, len(second.germs)),
        jumps=_both(one.jumps, other.jumps, len(second.germs)),
        histories={**one.histories, **{count + k: each for k, each in other.histories.items()}},
        order=[*one.order, *(count + k for k in other.order)],
        states=states,
        worst=np.concatenate([one.worst, other.worst]),
        largest=np.concatenate([one.largest, other.largest]),
        scatter=min(one.scatter, other.scatter),
    )
    seconds = {k: first.seconds[k] + second.seconds[k] for k in first.seconds}
    germs = np.concatenate([first.germs, second.germs])
    return replace(first, germs=germs, weights=np.ones(len(germs)), points=merged, seconds=seconds)


def lawful(random: RandomLaws, points: Array) -> Array:
    """Which points make laws: a normal stiffness is negative far out."""
    if not len(points) or random.make_laws(points):
        return np.ones(len(points), dtype=bool)
    return np.array([random.make_laws(point[None]) for point in points])


class Witnesses(NamedTuple):
    """Solved points that judge."""

    points: Array  # (n, L)
    weights: Array  # (n,), of sum 1; 0 in the tails
    tails: Array  # (n,) probability of the piece of a tail that a point stands for, 0 elsewhere
    values: Array  # (n,) of the quantity
    states: Array = np.zeros((0, 0))  # (n, k) of contacts along one germ, see `all_states_of`


class Lost(NamedTuple):
    """What truncated fields lack, relative to mean and deviation of a quantity, and which fields."""

    mean: float
    std: float
    of: str

    @property
    def largest(self) -> float:
        """The larger of both."""
        return float(np.fmax(self.mean, self.std))


class Misfit(NamedTuple):
    """What solved points say of moments that were made without them."""

    mean: float
    std: float
    size: float  # root mean square of what is not in the approximation


def witnesses(
    result: ChaosResult, quantity: Wanted, rtol: float, complete: Callable[[SampleResult], None]
) -> Witnesses:
    """Solve some points that nothing else has seen: 32 and more with more germs."""
    count = 2 ** int(np.ceil(np.log2(max(32, 8 * min(result.space.dimension, 16)))))
    return _seen(result, quantity, rtol, complete, solved, count, len(TAIL))


def few_witnesses(
    result: ChaosResult,
    quantity: Wanted,
    rtol: float,
    complete: Callable[[SampleResult], None],
    target: float,
) -> Witnesses:
    """Solve each of so few points from nothing as an accuracy asks for: far out on the germs only where a
    quantity may be as far from a polynomial as would matter (`FAR_OFF` deviations)."""
    depth = int(np.sum(np.sqrt(target / _shares(TAIL)) <= FAR_OFF))
    count = FEW if target > FEW_TO else 2 * FEW
    return _seen(result, quantity, rtol, complete, solved_alone, count, max(depth, 1))


def _seen(
    result: ChaosResult,
    quantity: Wanted,
    rtol: float,
    complete: Callable[[SampleResult], None],
    solve: Callable[..., SampleResult],
    count: int,
    depth: int,
) -> Witnesses:
    """Witnesses: `count` that are drawn, and the first `depth` of the tails."""
    points, weights = wide_points(result.space, count, 12345)
    good = lawful(result.random, points)
    points, weights = points[good], weights[good]
    weights = np.abs(calibrated(result.space, points, weights))
    lines, shares = _tails(result.space, depth)
    good = lawful(result.random, lines)
    tails = np.concatenate([np.zeros(len(points)), shares[good]])
    points = np.concatenate([points, lines[good]])
    weights = np.concatenate([weights / weights.sum(), np.zeros(int(good.sum()))])
    samples = solve(result, points, np.ones(len(points)), rtol, quantity)
    complete(samples)
    found = Witnesses(points, weights, tails, quantity.at_end(samples, samples))
    if points.shape[1] == 1:
        found = found._replace(states=all_states_of(samples))
    return with_unmet_states(result, samples, found, solve, rtol, quantity, complete)


def with_unmet_states(
    result: ChaosResult,
    samples: SampleResult,
    seen: Witnesses,
    solve: Callable[..., SampleResult],
    rtol: float,
    quantity: Wanted,
    complete: Callable[[SampleResult], None],
) -> Witnesses:
    """The witnesses, and such as lie where contacts are in states in which no sample has them."""
    for points, share in (_openings(result, samples), _unmet(result, samples)):
        good = lawful(result.random, points)
        if not good.any():
            continue
        more = solve(result, points[good], np.ones(int(good.sum())), rtol, quantity)
        complete(more)
        seen = Witnesses(
            np.concatenate([seen.points, points[good]]),
            np.concatenate([seen.weights, np.zeros(int(good.sum()))]),
            np.concatenate([seen.tails, share[good]]),
            np.concatenate([seen.values, quantity.at_end(more, more)]),
            np.concatenate([seen.states, all_states_of(more)]) if len(seen.states) else seen.states,
        )
    return seen


def _openings(result: ChaosResult, samples: SampleResult) -> tuple[Array, Array]:
    """Points (n, L) where contacts open by what samples tell, and the probability that each stands for.

    Far out along a sum of germs a contact may be open that is closed along each of them.
    """
    space = result.space
    lines: list[Array] = [np.zeros((0, space.dimension))]
    shares: list[Array] = [np.zeros(0)]
    several = space.dimension > 1
    for reach, along in opening_directions(samples, normal_scores(space, samples.germs)) if several else ():
        beyond = TAIL[TAIL > reach][:2]
        lines.append(beyond[:, None] * along)
        shares.append(_shares(beyond))
    return space.from_normal(np.concatenate(lines)), np.concatenate(shares)


def _unmet(result: ChaosResult, samples: SampleResult) -> tuple[Array, Array]:
    """The same where the chaos has contacts in a state in which no sample has them.

    A contact may be met in a window of the germs that points pass by. The chaos need not be right: what it
    says of the state is where to look.
    """
    germs = result.moment_germs()
    points, shares = [np.zeros((0, germs.shape[1]))], [np.zeros(0)]
    if contacts_of(result):
        kinds, which, counts = np.unique(
            kinds_of_states(result), axis=0, return_inverse=True, return_counts=True
        )
        met = {row.tobytes() for row in kinds_of_states(samples)}
        unmet = [k for k in np.argsort(-counts) if kinds[k].tobytes() not in met]
        for k in unmet[:MOST_UNMET]:
            members = germs[np.flatnonzero(which.ravel() == k)]
            chosen = members[np.linspace(0, len(members) - 1, OF_UNMET).round().astype(int)]
            points.append(chosen)
            shares.append(np.full(len(chosen), counts[k] / len(germs) / len(chosen)))
    return np.concatenate(points), np.concatenate(shares)


def far_out(
    result: ChaosResult,
    quantity: Wanted,
    rtol: float,
    complete: Callable[[SampleResult], None],
    along: Array,
    seen: Witnesses | None = None,
) -> Witnesses:
    """Those of the witnesses that lie far out along each germ, solved unless `seen` has them, and others both
    ways along a direction (L,) of the normal scores."""
    space = result.space
    scores = np.concatenate([-TAIL[::-1], TAIL])
    lines, shares = space.from_normal(scores[:, None] * along), _shares(scores)
    if seen is None:
        of_germs, of_each = _tails(space)
        lines, shares = np.concatenate([lines, of_germs]), np.concatenate([shares, of_each])
    good = lawful(result.random, lines)
    lines, shares = lines[good], shares[good]
    values: Array = np.zeros(0)
    if len(lines):
        samples = solved(result, lines, np.ones(len(lines)), rtol, quantity)
        complete(samples)
        values = quantity.at_end(samples, samples)
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
    result: ChaosResult,
    samples: SampleResult,
    quantity: Wanted,
    values: Array,
    apart: Array | None = None,
    tails: bool = False,
) -> float:
    """Root mean square difference of some points to the same points solved again to a hundredth of the
    tolerance, the most important ones, those that stand out and some others from nothing (of linear laws all
    together: no state misleads them); NaN: one of these did not converge. `apart`: (n,) by how much values
    differ from what their neighbours say. `tails`: values far off the mean may be off by as much more."""
    weights = samples.probabilities
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
    rtol = max(0.01 * samples.plan.options.rtol, 1e-12)
    away = []
    others = ranked[CHECKED:]
    some = others[:: max(1, len(others) // (AGAIN if result.collocations else AGAIN_LINEAR))]
    if result.collocations:
        groups = [ranked[k : k + 1] for k in range(0, min(CHECKED, len(ranked)))]
        alone = min(ALONE, len(others) // OF_ALL)
        groups += [point for point in np.random.default_rng(len(ranked)).permutation(others)[:alone, None]]
        groups += [some] if len(some) else []
    else:
        groups = [np.concatenate([ranked[:CHECKED], some])]
    for chosen in groups:
        again = solved(result, samples.germs[chosen], np.ones(len(chosen)), rtol, quantity)
        if not again.complete:
            raise Interrupted
        away += [float(v) for v in (quantity.at_end(again, again) - values[chosen]) / scale[chosen]]
    return float(np.sqrt(np.mean(np.square(away))))


def moments_of_sets(
    quantity: Wanted, values: Array, weights: Array, labels: Ints
) -> tuple[MeanStd, float, float]:
    """The statistics of a quantity over sets, whose numbers are the labels (n,), with weights (n,) of sum 1,
    and the errors of both."""
    mean, std = quantity.statistic(values, weights)
    value = MeanStd(mean, std)
    sets = int(labels.max()) + 1
    each = [(values[labels == k], sets * weights[labels == k]) for k in range(sets)]
    own = np.array([[0.0 if x is None else x for x in quantity.statistic(v, w)] for v, w in each])
    spread = SURE * own.std(axis=0, ddof=1) / np.sqrt(sets)
    # what the sets have in common is the bias of so few samples each
    bias = np.abs(own.mean(axis=0) - [value.mean, value.std or 0.0])
    return value, float(spread[0] + bias[0]), float(spread[1] + bias[1])


# --- fields -----------------------------------------------------------------------------------------
def _fuller(random: RandomLaws) -> RandomLaws | None:
    """The same with all modes that the points of its fields resolve; None: there is no field."""
    wider: dict[int, DiscretisedField] = {}

    def widen(source: DiscretisedField, most: int, *cell_dimension: int) -> None:
        most = min(len(source.points), most)
        if id(source) in wider or most <= len(source.eigenvalues):
            return
        try:
            field = replace(source.field, modes=most, variance_captured=None)
            wider[id(source)] = field.on(source.points, source.weights, *cell_dimension)
        except SceneError:
            return

    for source in random.sources.values():
        if isinstance(source, DiscretisedField):
            widen(source, MOST_FIELD_MODES)
    for name, of_part in random.fields.items():
        widen(of_part, MOST_PART_MODES, random.problem.cells_of(name)[2])
    if not wider:
        return None
    sources = {key: wider.get(id(s), s) for key, s in random.sources.items()}
    parts = {name: wider.get(id(s), s) for name, s in random.parts.items()}
    of_loads = [each for found in random.loads.values() for each in found]
    space = RandomSpace([*sources.values(), *of_loads, *parts.values()])
    return replace(random, sources=sources, parts=parts, space=space)


def lost_of_fields(
    result: ChaosResult,
    quantity: Wanted,
    rtol: float,
    value: MeanStd,
    complete: Callable[[SampleResult], None],
    target: float = 0.0,
) -> Lost | None:
    """What the modes that fields leave out do to a quantity.

    Samples of the fields as they are and with all modes that their points resolve, in antithetic pairs, until
    their scatter is small beside what they tell or beside `target`, the accuracy that is asked for. Few
    points do not resolve all modes: the others do as much more as they have of the variance.
    None: nothing is left out.
    """
    full = _fuller(result.random)
    if full is None:
        return None
    rng = np.random.default_rng(0)
    own, pairs = result.space, PAIRS
    names = list(full.space.germ_names)
    known = [names.index(name) for name in own.germ_names]
    lost = np.setdiff1d(np.arange(len(names)), known)
    plan = replace(result.plan, options=result.plan.options.with_(rtol=rtol))
    base: Array = np.zeros(0)
    change: Array = np.zeros((2, 0))
    size, whole = size_of(value, quantity), max(value.std or 0.0, quantity.compared.least)
    while True:
        points = own.from_uniform(latin_points(own.dimension, pairs, rng))
        at = np.zeros((pairs, full.space.dimension))
        # of one side of zero, as the pairs have both: what few lost modes do goes with their squares
        sides = rng.choice([-1.0, 1.0], (pairs // SHARED, len(lost)))
        sizes = special.ndtri(0.5 + 0.5 * latin_points(len(lost), pairs // SHARED, rng))
        at[:, lost] = np.repeat(sides * sizes, SHARED, axis=0)
        other = at.copy()
        other[:, lost] *= -1.0
        for block in (at, other):
            block[:, known] = points
        both = np.concatenate([at, other])
        good = np.logical_and(lawful(full, both[:pairs]), lawful(full, both[pairs:]))
        good = np.repeat(good.reshape(-1, SHARED).all(axis=1), SHARED)
        if not good.any():
            return Lost(np.nan, np.nan, "fields")
        known_ones = solved(result, points[good], np.ones(int(good.sum())), rtol, quantity)
        complete(known_ones)
        twice = both[np.tile(good, 2)]
        with_all = sample_on(
            result.solver,
            full,
            plan,
            twice,
            np.full(len(twice), 1.0 / len(twice)),
            "quadrature",
            keep_states=quantity.needs_states,
            scatter=False,
        )
        complete(with_all)
        here = quantity.at_end(known_ones, known_ones)
        base = np.concatenate([base, here])
        change = np.hstack([change, quantity.at_end(with_all, with_all).reshape(2, -1) - here])
        found, doubts = _lost(base, change, size, value.std or 0.0)
        told, doubt = (max(share_of(x.mean, size), share_of(x.std or 0.0, whole)) for x in (found, doubts))
        most = MOST_PAIRS if not result.collocations else MOST_PAIRS_CURVED
        # of what is more than is asked in any case less has to be known
        wanted = max(OF_LOST * told * (2.0 if told > 2.0 * target else 1.0), OF_TARGET * target)
        enough = not doubt > wanted
        if enough or 2 * len(base) > most:
            break
        pairs = len(base)  # as many again
    more = _not_resolved(result.random, full)
    of = ", ".join(
        f"{s.name} ({100.0 * s.captured:.4g} % of its variance)" for s in result.random.of_fields
    )
    of_mean = share_of(found.mean + doubts.mean, size)
    of_std = share_of((found.std or 0.0) + (doubts.std or 0.0), whole)
    return Lost(more * of_mean, more * of_std, of)


def beside_fields(target: float, lost: Lost | None) -> float:
    """What fields leave of an accuracy for all other errors: `LEAST_BESIDE_FIELDS` of it at least."""
    if lost is None or not isfinite(lost.largest):
        return target
    return max(target - lost.largest, LEAST_BESIDE_FIELDS * target)


def _lost(base: Array, change: Array, size: float, std: float) -> tuple[MeanStd, MeanStd]:
    """Sizes of the changes of mean and deviation by pairs, and what a standard error adds: the quantity
    without the lost modes (n,) and its changes (2, n), in groups of `SHARED` with the same lost modes.

    The variance grows by that of the lost modes themselves, and by what they do more at some values of the
    others than at other ones. Unless it is plain, this is taken for at most `ALONG` times what they do to the
    mean, relative to deviation and mean: as where they act like a factor.
    """
    base, change = base.reshape(-1, SHARED), change.reshape(2, -1, SHARED)
    shift = change.mean(axis=0)
    means, squares = shift.mean(axis=1), np.mean(change**2, axis=(0, 2))
    # what a draw of the lost modes does at all points of its group goes with none of them
    apart = (shift - means[:, None]) * (base - base.mean(axis=1)[:, None])
    along = apart.sum(axis=1) / (SHARED - 1)

    def sure(values: Array) -> tuple[float, float]:
        # of draws that were independent: strata leave less, but for what modes do together
        doubt = float(values.std(ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else np.inf
        return float(values.mean()), doubt

    def of_variance(change: float) -> float:
        return abs(float(np.sqrt(max(std**2 + change, 0.0))) - std)

    (mean, of_mean), (added, of_squares), (with_others, of_others) = map(sure, (means, squares, along))
    least = max(abs(with_others) - of_others, 0.0)
    most = min(abs(with_others) + of_others, max(least, ALONG * share_of(abs(mean) + of_mean, size) * std**2))
    known = max(of_variance(added + 2.0 * sign * least) for sign in (-1.0, 1.0))
    at_most = max(of_variance(added + of_squares + 2.0 * sign * most) for sign in (-1.0, 1.0))
    return MeanStd(abs(mean), known), MeanStd(of_mean, max(at_most - known, 0.0))


def _not_resolved(own: RandomLaws, full: RandomLaws) -> float:
    """Variance that fields have beside their modes, over what of it the points resolve: of the field with
    most."""
    most = 1.0
    pairs = [(s, full.sources[key]) for key, s in own.sources.items()]
    for source, wider in pairs + [(s, full.parts[name]) for name, s in own.parts.items()]:
        if isinstance(source, DiscretisedField) and isinstance(wider, DiscretisedField):
            found = wider.captured - source.captured
            if found > 0.0:
                most = max(most, (1.0 - source.captured) / found)
    most = min(most, MOST_NOT_RESOLVED)
    return most * (1.0 + min(UNRESOLVED * (most - 1.0), MOST_UNRESOLVED))
