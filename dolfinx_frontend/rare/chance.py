"""The probability of an event of independent standard normal variables: which method, and what it finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeGuard

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.rare.design import (
    DesignPoint,
    Limit,
    curvatures,
    design_point,
    first_order,
    second_order,
    worst,
)
from dolfinx_frontend.rare.importance import importance_sampling
from dolfinx_frontend.rare.tails import Found, directional_sampling, plain_sampling, subset_simulation

__all__ = ["FLAT", "Chance", "Method", "chance"]

Method = Literal["auto", "form", "sorm", "importance", "directional", "subset", "monte carlo"]

PILOT = 32
"""Independent points before anything is decided."""
FREQUENT = 6
"""Of these at which the event happens, from which on it is not rare."""
SAME = 0.1
"""Design points closer than this (deviations) are one."""
MOST_POINTS = 20
"""Design points at most around which samples are drawn."""
MOST_STARTS = 6
"""Points from which more design points are searched."""
FARTHER = 2.5
"""A design point further than the first by so many deviations adds nothing."""
WORTH = 3000
"""Points that must be left for directions to be tried."""
LEAST = 50
"""Points that a sampling is allowed whatever the search has taken."""
FLAT = "the quantity is the same at all of the first points"
FEW = 8
"""Variables up to which directions are sampled where design points do not do."""


@dataclass(frozen=True, eq=False)
class Chance:
    """What a method found, in standard normal variables.

    Attributes
    ----------
    found
        The estimate; of FORM and SORM without interval.
    points
        Design points.
    second
        Probability with curvatures; NaN: not computed.
    method, why
        What was done, and for what reason.
    """

    found: Found
    points: tuple[DesignPoint, ...]
    second: float
    method: str
    why: str


def chance(
    limit: Limit, method: Method, rng: np.random.Generator, *, cov: float, level: float, most: int
) -> Chance:
    """The probability of an event of independent standard normal variables, see
    :func:`dolfinx_frontend.reliability`."""
    none = float("nan")
    samplers: dict[str, Callable[..., Found]] = {
        "monte carlo": plain_sampling, "directional": directional_sampling, "subset": subset_simulation,
    }  # fmt: skip
    limit = _Counted(limit)
    if method in samplers:
        found = samplers[method](limit, rng, cov, most, level)
        return Chance(found, (), none, method, "as asked")
    pilot = np.vstack([np.zeros((1, limit.dimension)), rng.standard_normal((PILOT, limit.dimension))])
    margins = limit.margins(pilot)
    distance = worst(margins, limit.cuts)
    hits = int((distance[1:] < 0.0).sum())
    asked = "as asked" if method != "auto" else ""
    if method == "auto" and hits >= FREQUENT:
        found = plain_sampling(limit, rng, cov, limit.left(most), level)
        return Chance(found, (), none, "monte carlo", f"it happened at {hits} of {PILOT} independent points")
    if method == "auto" and not limit.differentiable:
        return _without_points(limit, rng, cov, level, most, "there are no derivatives")
    points = _searched(limit, pilot, margins, rng)
    usable = [each for each in points if each.beta > 0.0]
    if method in ("form", "sorm"):
        return _approximate(limit, method, usable, distance[0])
    if not usable:
        return _without_points(limit, rng, cov, level, most, asked or _flat(distance))
    return _sampled(limit, usable, rng, cov, level, most, asked)


class _Counted:
    """A limit that counts the points at which it is asked for."""

    def __init__(self, limit: Limit) -> None:
        self._limit, self.dimension, self.cuts = limit, limit.dimension, limit.cuts
        self.differentiable = limit.differentiable
        self.points = 0
        self.slopes = limit.slopes

    def margins(self, u: Array) -> Array:
        self.points += len(u)
        return self._limit.margins(u)

    def left(self, most: int) -> int:
        """Points that are left of `most`, a few at least."""
        return max(most - self.points, LEAST)


def _flat(distance: Array) -> str:
    """Why there is no design point."""
    if np.ptp(distance) == 0.0:
        return (
            f"no design point was found: {FLAT}: it depends on nothing that is random, or does not change "
            "before it happens; take one that tells how far the event is, as Response.opening"
        )
    return "no design point was found"


def _searched(limit: Limit, pilot: Array, margins: Array, rng: np.random.Generator) -> list[DesignPoint]:
    """Design points of all cuts, each once; a cut may have several, which are searched from all around."""
    found: list[DesignPoint] = []
    around = max(1, min(MOST_STARTS // len(limit.cuts), 2 * limit.dimension))
    for cut in limit.cuts:
        one = design_point(limit, cut, np.zeros(limit.dimension))
        if not _happens(one, limit):
            # from the best of the points so far
            best = margins[:, list(cut)].max(axis=1).argmin()
            one = design_point(limit, cut, pilot[best])
        if not _happens(one, limit):
            continue
        found.append(one)
        if not one.beta > 0.0:
            continue
        frame, _ = np.linalg.qr(np.column_stack([one.alpha, rng.standard_normal((limit.dimension,) * 2)]))
        sides = np.concatenate([-one.alpha[None], frame[:, 1:].T, -frame[:, 1:].T])
        for side in sides[:around]:
            more = design_point(limit, cut, one.beta * side, found)
            if _happens(more, limit) and more.beta < one.beta + FARTHER:
                found.append(more)
    return _different(found)


def _different(points: list[DesignPoint]) -> list[DesignPoint]:
    kept: list[DesignPoint] = []
    for each in sorted(points, key=lambda point: point.beta):
        if all(np.linalg.norm(each.u - other.u) > SAME for other in kept):
            kept.append(each)
    return kept[:MOST_POINTS]


def _happens(point: DesignPoint | None, limit: Limit) -> TypeGuard[DesignPoint]:
    """Whether the event happens at a design point, or next to it."""
    if point is None or point.converged:
        return point is not None
    near = np.array([point.u, 1.001 * point.u])
    return bool((limit.margins(near)[:, list(point.cut)].max(axis=1) <= 0.0).any())


def _approximate(limit: Limit, method: str, points: list[DesignPoint], at_origin: float) -> Chance:
    """FORM, or SORM."""
    none = float("nan")
    good = [each for each in points if each.converged]
    if len(good) < len(points) or not points:
        raise SceneError(
            f"reliability: {method}: no design point of {'some conditions' if good else 'the event'} was "
            "found"
            + (", which happens at the median of everything" if at_origin < 0.0 else "")
            + "; use method='auto' or 'subset'"
        )
    value, why = first_order(limit, good), f"{len(good)} design point{'s' if len(good) > 1 else ''}"
    second = none
    if method == "sorm":
        if len(good) > 1 or len(good[0].active) > 1:
            raise SceneError(
                "reliability: sorm: the event has several design points or conditions; use method='auto'"
            )
        curved = curvatures(limit, good[0])
        second = none if curved is None else second_order(good[0], curved)
        if np.isnan(second):
            raise SceneError(
                "reliability: sorm: the limit is not a paraboloid around its design point; use 'auto'")
        value, why = second, "one design point, curvatures from points of the limit"
    found = Found(value, none, none, none, 0, 0, True)
    return Chance(found, tuple(good), second, method, why)


def _sampled(
    limit: _Counted,
    points: list[DesignPoint],
    rng: np.random.Generator,
    cov: float,
    level: float,
    most: int,
    asked: str,
) -> Chance:
    """Importance sampling; a part of the event that shows up gets a design point of its own."""
    none = float("nan")
    known = list(points)

    def search(u: Array) -> list[DesignPoint]:
        tried = (design_point(limit, cut, u, known) for cut in limit.cuts)
        new = [each for each in tried if _happens(each, limit)]
        every = _different([*known, *new])
        more = [each for each in every if all(each is not other for other in known)]
        known.extend(more)
        return more

    found = importance_sampling(limit, points, rng, cov, limit.left(most), level, search)
    added = len(known) - len(points)
    why = f"{len(known)} design point{'s' if len(known) > 1 else ''}"
    if not found.complete and not asked and limit.dimension <= FEW and limit.left(most) > WORTH:
        other = directional_sampling(limit, rng, cov, limit.left(most), level)
        if other.complete:
            return Chance(other, tuple(known), none, "directional", f"{why} are not all there is")
    why += f", {added} of them found by samples" if added else ""
    if found.doubled:
        why += f"; polynomials say where the limit is, {found.doubled} solves correct them"
        asked = asked and f"{asked}; {why}"
    return Chance(found, tuple(known), none, "importance", asked or why)


def _without_points(
    limit: _Counted, rng: np.random.Generator, cov: float, level: float, most: int, why: str
) -> Chance:
    """Subset simulation, and samples around the points where it arrives."""
    none = float("nan")
    found = subset_simulation(limit, rng, max(cov, 0.2), limit.left(most), level)
    if not len(found.failed) or limit.left(most) <= LEAST:
        return Chance(found, (), none, "subset", why)
    order = np.argsort(np.linalg.norm(found.failed, axis=1))
    points: list[DesignPoint] = []
    for u in found.failed[order]:
        if all(np.linalg.norm(u - each.u) > 1.5 for each in points) and len(points) < MOST_POINTS:
            beta = float(np.linalg.norm(u))
            cut = limit.cuts[0]
            points.append(DesignPoint(u, beta, u / beta, cut, cut, np.zeros((0, len(u))), False, 0))
    better = importance_sampling(limit, points, rng, cov, limit.left(most), level)
    overlap = better.low <= found.high and found.low <= better.high
    if better.complete and overlap:
        return Chance(better, (), none, "importance", f"{why}: around points of a subset simulation")
    return Chance(found, (), none, "subset", why)
