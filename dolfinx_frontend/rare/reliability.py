"""Probabilities of rare events on the assembly itself, contact and slip included."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, Literal, NamedTuple, TypeGuard

import numpy as np

from dolfinx_frontend.assembly.gathered import by_first, gathered
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_number,
    checked_seed,
    checked_whole,
)
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.evaluate.events import Event
from dolfinx_frontend.evaluate.function import check_handed_on
from dolfinx_frontend.kernel.spread import check_given_alike
from dolfinx_frontend.plan.plan import check_problem
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
from dolfinx_frontend.rare.limit import ProblemLimit
from dolfinx_frontend.rare.tails import (
    Found,
    directional_sampling,
    plain_sampling,
    subset_simulation,
)
from dolfinx_frontend.uncertainty.quantities import Estimate

__all__ = ["Chance", "Method", "Reliability", "chance", "reliability"]

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


@dataclass(frozen=True, repr=False)
class Reliability:
    """Probability of an event.

    Attributes
    ----------
    event
        How it is written.
    probability
        With its interval, which says the error of the sampling; that of meshes and iterations is not in it.
    cov
        Coefficient of variation of the estimate; NaN: of FORM and SORM, which have no such error.
    method, why
        What was done, and for what reason.
    design_points
        Random number -> its value, at the points where the event is most probable, the most probable first.
    betas
        Distances of these in standard normal space.
    importance
        Random number (``"a+b"`` of a correlated group) -> share in the squared distance of the first one,
        sum 1.
    first_order, second_order
        Probabilities by FORM and SORM; NaN: not computed.
    runs, gradients
        Points that were solved, and derivatives, which are no solves.
    seconds
        Wall time, ``setup`` and ``search``.
    lost
        Points that did not converge: the event was taken to happen there.
    medians
        Random number -> its median: what does not matter to the event has it at a design point.
    """

    event: str
    probability: Estimate
    cov: float
    method: str
    why: str
    design_points: tuple[Mapping[str, float], ...]
    betas: tuple[float, ...]
    importance: Mapping[str, float]
    first_order: float
    second_order: float
    runs: int
    gradients: int
    seconds: Mapping[str, float]
    lost: int = 0
    medians: Mapping[str, float] = field(default_factory=dict)

    @property
    def beta(self) -> float:
        """Generalised reliability index, -Phi^-1(probability)."""
        return float(stats.norm.isf(self.probability.value))

    def __repr__(self) -> str:
        value, low, high, level = self.probability
        found = f"{value:.4g}"
        if not np.isnan(low):
            found += f" [{low:.3g}, {high:.3g}] ({100 * level:g} %)"
        lines = [f"Reliability: P({self.event}) = {found}"]
        spread = "" if np.isnan(self.cov) else f", cov {100 * self.cov:.2g} %"
        lines.append(f"  by {self.method}: {self.why}")
        taken = sum(self.seconds.values())
        spent = f"{self.runs} solves, {self.gradients} gradients, {taken:.2f} s"
        lines.append(f"  beta {self.beta:.4g}{spread}; {spent}")
        for beta, point in list(zip(self.betas, self.design_points, strict=True))[:3]:
            # what the event does not need to differ from its median is left out
            moved = [n for n in point if not _near(point[n], self.medians.get(n, np.inf))]
            at = ", ".join(f"{name} = {point[name]:.5g}" for name in moved or point)
            lines.append(f"  design point at {beta:.4g} deviations: {at}")
        if len(self.betas) > 3:
            lines.append(f"  and {len(self.betas) - 3} more design points")
        if self.importance:
            shares = sorted(self.importance.items(), key=lambda each: -each[1])
            shown = [f"{name} {100 * share:.3g} %" for name, share in shares[:6] if share > 1e-3]
            lines.append("  importance: " + ", ".join(shown))
        if self.lost:
            lines.append(f"  {self.lost} points did not converge, the event was taken to happen there")
        return "\n".join(lines)


def _near(value: float, median: float) -> bool:
    """Whether a number has hardly moved."""
    return abs(value - median) <= 1e-3 * abs(median)


@together("reliability")
def reliability(
    problem: Problem,
    event: Event,
    method: Method = "auto",
    *,
    cov: float = 0.1,
    level: float = 0.95,
    most: int = 20_000,
    seed: int = 0,
    **settings: Any,
) -> Reliability:
    """The probability of an event, on the assembly as it is: every point is solved, no surrogate is believed.

    Parameters
    ----------
    event
        As ``Response("joint", ...) > 3.0``, joined by ``&`` and ``|``, see :class:`Event`.
    method
        ``"auto"``: some independent points; if the event is not among them, the design points of all ways in
        which it may happen (FORM), and samples around these (importance sampling); where no design point is
        found, subset simulation. Or one of them: ``"form"``, ``"sorm"``, ``"importance"``,
        ``"directional"``, ``"subset"``, ``"monte carlo"``.
    cov
        Coefficient of variation that the estimate is to have.
    level
        Of the interval.
    most
        Samples at most: a search that is under way is ended, and a stage that has begun is completed.
    seed
        Of the random numbers: the same seed gives the same answer.
    settings
        active, direction, options, plan, times: as for :func:`solve`. checkpoint: a file of the points that
        were solved; the same call goes on with it, with the same digits, also with a smaller `cov` or a
        larger `most`. points_comm: ranks that solve the points together, as for :func:`sweep`.

    A problem of up to 20 000 unknowns whose parts are on several ranks is solved by the first one, which is
    given all of it, and all get the answer; not with a plan, a checkpoint or a random field in a part.

    Raises
    ------
    SceneError
        Nothing is random, a quantity that is not finite, or points that do not converge.

    Warns
    -----
    SceneWarning
        An event that happened never or always, or an estimate that did not become as sure as asked.
    """
    where = "reliability"
    check_problem(where, problem)
    check_kind(where, "event", event, Event, "give an event, as Response('joint') > 0.0")
    check_handed_on(where, settings)
    known = ("auto", "form", "sorm", "importance", "directional", "subset", "monte carlo")
    check_known("method", method, known, where)
    checked_number(where, "cov", cov, above=0.0, below=1.0)
    checked_number(where, "level", level, above=0.0, below=1.0)
    checked_whole(where, "most", most, 100)
    asked = {"method": method, "cov": cov, "level": level, "most": most, "seed": checked_seed(where, seed)}

    def answered(problem: Problem) -> _Answer:
        return _Answer.of(problem, event, settings, **asked)

    given = {name: value for name, value in settings.items() if name not in _OF_RANKS}
    check_given_alike(problem, where, settings.get("points_comm"), laws=True, event=event, **asked, **given)
    if not _on_one_rank(problem, settings) or isinstance(seed, np.random.Generator):
        answer = answered(problem)
    else:
        answer = by_first(problem, gathered(problem), answered)
    _tell(answer, cov)
    return answer.result


_OF_RANKS = ("plan", "checkpoint", "points_comm")
"""Settings that are compared elsewhere, or need not be alike."""

SMALL = 20_000
"""Unknowns up to which the first of several ranks has all of a problem, and the others wait: its iterations
take less time than their messages do."""


def _on_one_rank(problem: Problem, settings: Mapping[str, Any]) -> bool:
    """Whether the first rank alone solves the points of a problem that is on several."""
    given = {name for name, value in settings.items() if value is not None}
    several = problem.comm is not None and not given & set(_OF_RANKS)
    return several and problem.size <= SMALL and not problem.fields


class _Answer(NamedTuple):
    """What was found, and what there is to tell of it."""

    result: Reliability
    found: Found
    places: tuple[str, ...]

    @classmethod
    def of(
        cls,
        problem: Problem,
        event: Event,
        settings: Mapping[str, Any],
        *,
        method: Method,
        cov: float,
        level: float,
        most: int,
        seed: Any,
    ) -> _Answer:
        """The answer on a problem."""
        began = perf_counter()
        limit = ProblemLimit(problem, event, **settings)
        ready = perf_counter()
        try:
            found = chance(limit, method, np.random.default_rng(seed), cov=cov, level=level, most=most)
        finally:
            limit.function.close()
        estimate = found.found
        points = sorted(found.points, key=lambda each: each.beta)
        result = Reliability(
            event=event.name,
            probability=Estimate(estimate.value, estimate.low, estimate.high, level),
            cov=estimate.cov,
            method=found.method,
            why=found.why,
            design_points=tuple(limit.values(each.u) for each in points),
            betas=tuple(each.beta for each in points),
            importance=limit.importance(points[0].alpha) if points else {},
            first_order=first_order(limit, found.points) if found.points else float("nan"),
            second_order=found.second,
            runs=limit.function.solves,
            gradients=limit.slopes_made,
            seconds={"setup": ready - began, "search": perf_counter() - ready},
            lost=limit.lost,
            medians=limit.values(np.zeros(limit.dimension)),
        )
        return cls(result, estimate, tuple(sorted(limit.places)))


def _tell(answer: _Answer, cov: float) -> None:
    """Warn of what the answer is not."""
    result, found = answer.result, answer.found
    told = f"reliability: {result.event}: "
    high = result.probability.high
    if found.value == 0.0:
        warn(
            f"{told}it did not happen at any of {result.runs} points"
            + (f"; its probability is below {high:.2g}" if high < 1.0 else "")
            + (f": {result.why}" if FLAT in result.why else ": check the event, or raise most"),
            SceneWarning,
        )
    elif found.value == 1.0:
        warn(
            f"{told}it happened at all of {found.points} points: ask for what does not happen, ~event, or "
            "check it",
            SceneWarning,
        )
    elif not found.complete and not np.isnan(found.cov):
        warn(
            f"{told}a coefficient of variation of {100 * cov:g} % was asked for, after {result.runs} points "
            "it is "
            f"{100 * found.cov:.2g} %: raise most",
            SceneWarning,
        )
    if result.lost:
        places = f" (in {', '.join(answer.places[:3])})" if answer.places else ""
        warn(f"{told}{result.lost} of {result.runs} points did not converge{places}", SceneWarning)


def chance(
    limit: Limit, method: Method, rng: np.random.Generator, *, cov: float, level: float, most: int
) -> Chance:
    """The probability of an event of independent standard normal variables, see :func:`reliability`."""
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
