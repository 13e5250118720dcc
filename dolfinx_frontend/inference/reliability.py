"""Probabilities of rare events on the assembly itself, contact and slip included."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.assembly.gathered import by_first, gathered
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_number,
    checked_seed,
    checked_whole,
)
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.evaluate.events import Event
from dolfinx_frontend.evaluate.function import check_handed_on
from dolfinx_frontend.inference.limit import ProblemLimit
from dolfinx_frontend.kernel.spread import check_given_alike
from dolfinx_frontend.plan.plan import check_problem
from dolfinx_frontend.rare.chance import FLAT, Method, chance
from dolfinx_frontend.rare.design import first_order
from dolfinx_frontend.rare.tails import Found
from dolfinx_frontend.uncertainty.quantities import Estimate

__all__ = ["Reliability", "reliability"]


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
