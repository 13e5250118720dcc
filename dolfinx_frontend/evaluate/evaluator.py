"""An assembly at many points: the one loop under sweeps, samples, functions and checks of a chaos.

Factors, the walk from neighbour to neighbour, files of finished points, ranks that share them, progress,
Ctrl-C and what becomes of points that nothing balances live here, once. What a point is (parameters of laws,
germs, inputs of a function), its caller says: a :class:`Design`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, NamedTuple, TypeVar, Unpack

from latin_core import Iteration, Options, Summary, SweepPoints, SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.interrupts import Interrupted, pressed, stop_if_pressed
from dolfinx_frontend.common.progress import Lines
from dolfinx_frontend.common.statuses import INEXACT, STOPPED
from dolfinx_frontend.evaluate.model_limits import check_model
from dolfinx_frontend.evaluate.support import named_without_equilibrium
from dolfinx_frontend.kernel.fingerprint import fingerprint
from dolfinx_frontend.kernel.fitting import solver_of, walked
from dolfinx_frontend.kernel.running import Interrupt, report_points
from dolfinx_frontend.kernel.solver import Kept, Solver
from dolfinx_frontend.kernel.spread import PointRanks, agreed_over, points_shown
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.accuracy import accuracy_of_run, ended
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.results.sweep import SweepResult

__all__ = ["Design", "Evaluator", "Names", "Spent", "checkpoint_path", "complete", "part_of"]

_log = logging.getLogger(__name__)
A = TypeVar("A", SweepResult, SampleResult)


class Names(NamedTuple):
    """How a run over points is called in messages, and one of its points."""

    run: str
    point: str


class Spent(NamedTuple):
    """Seconds of a run: until its first point was solved, and until its last."""

    first: float
    every: float


@dataclass(frozen=True)
class Design:
    """Points at which an assembly is solved.

    Attributes
    ----------
    parameters
        What differs from point to point, as the kernel has it. There may be more points than are solved:
        those of known states, which others start from.
    order
        The points that are solved, in this order.
    problem_at
        Number of a point -> the problem there.
    acts
        Whether what pushes on the parts differs from point to point.
    """

    parameters: Sequence[SweptParameter]
    order: Sequence[int]
    problem_at: Callable[[int], Problem]
    acts: bool


class Evaluator:
    """Solves an assembly at points, on the same factors.

    Attributes
    ----------
    names, problem, plan
        What is solved, and how.
    solver
        The factors; a basis of the bodies grows with the points that it answers.
    setup
        Seconds of the factorisation.
    """

    def __init__(
        self,
        names: Names,
        problem: Problem,
        plan: Plan,
        parameters: Sequence[SweptParameter] = (),
        *,
        solver: Solver | None = None,
        ranks: PointRanks | None = None,
    ) -> None:
        self.names, self.problem, self.plan, self.ranks = names, problem, plan, ranks
        began = perf_counter()
        if solver is None:
            with agreed_over(ranks):
                solver = solver_of(problem, plan, parameters)
        self.solver = solver
        self.setup = perf_counter() - began

    def answers(
        self,
        design: Design,
        answer: Callable[[SweepPoints, Spent], A],
        *,
        options: Options | None = None,
        checkpoint: Path | None = None,
        facts: Mapping[str, Any] | None = None,
        functions: Mapping[str, Callable[..., Any]] | None = None,
        told: Literal["all", "failed", "none"] = "all",
        progress: bool = False,
        callback: Callable[[Iteration], None] | None = None,
        interrupt: Interrupt | None = None,
        checked: bool = True,
        **kept: Unpack[Kept],
    ) -> A:
        """Solve at points; collective.

        Parameters
        ----------
        answer
            Makes the result of the solved points.
        options
            Other than those of the plan.
        checkpoint
            File of finished points.
        facts, functions
            What it says of the run beside what all say, and functions of the user that the answers depend on.
        told
            Log the points that do not converge: each one that fails, and (``"all"``) how many are inexact.
        interrupt
            The context of Ctrl-C that the caller is in; None: one of its own, whose end is logged.
        checked
            Warn of what in the answers the model does not hold for.
        """
        ranks, options = self.ranks, options or self.plan.options
        header = self._header(design, checkpoint, facts, functions)
        report = _Report(self, options, told, len(design.order))
        bar = points_shown(self.names.run, len(design.order), progress, self.problem, ranks)
        own = Interrupt()
        with own if interrupt is None else nullcontext(interrupt) as held, bar as step:
            self.solver, points = walked(
                self.solver,
                self.plan.amplitudes,
                design.parameters,
                design.order,
                options,
                checkpoint=checkpoint,
                header=header,
                progress=lambda point, summary: step(report(point, summary)),
                callback=held.watch(callback),
                ranks=ranks,
                **kept,
            )
        report.end()
        if interrupt is None:
            report_points(self.names.run, own, points, checkpoint)
        count = len(design.order)
        found = answer(points.first(count), report.spent)
        parameters = part_of(design.parameters, slice(0, count))
        known = kept.get("keep_fields", True)
        with agreed_over(ranks):
            named = named_without_equilibrium(
                self.names.point, found, parameters, design.problem_at, design.acts, known
            )
            found = replace(found, points=named)
            if checked and known:
                check_model(found, self.names.point)
        return found

    def _header(
        self,
        design: Design,
        checkpoint: Path | None,
        facts: Mapping[str, Any] | None,
        functions: Mapping[str, Callable[..., Any]] | None,
    ) -> dict[str, Any] | None:
        """What a file says of the run, and what ranks that share it must have alike; None: there are none."""
        if facts is None or (checkpoint is None and self.ranks is None):
            return None
        with agreed_over(self.ranks):
            of_all = fingerprint(
                self.problem, self.plan, design.parameters, functions, codes=checkpoint is not None
            )
            header = {"run": self.names.run, **facts, **of_all}
        if self.ranks is not None:
            self.ranks.check_same(header)
        return header


class _Report:
    """What is said of points that do not converge, and the time that all take."""

    def __init__(self, evaluator: Evaluator, options: Options, told: str, count: int) -> None:
        self._evaluator, self._rtol, self._told, self._count = evaluator, options.rtol, told, count
        self._lines = Lines(_log, evaluator.problem.rank)
        self._inexact: list[float] = []
        self._began, self._first = perf_counter(), 0.0

    def __call__(self, point: int, summary: Summary) -> int:
        """Note a point, and return its iterations; collective."""
        self._first = self._first or perf_counter() - self._began
        if summary.status == INEXACT:
            self._inexact.append(summary.error)
        elif self._told != "none" and summary.status != "converged":
            what, solver = self._evaluator.names.point, self._evaluator.solver
            accuracy = accuracy_of_run(summary, solver.plan, solver.bodies, solver.problem.comm)
            place = "" if accuracy is None else accuracy.place
            laws = [each.law for each in solver.problem.interfaces.values()]
            text = ended(summary.status, summary.error, place, self._rtol, summary.iterations, laws)
            self._lines.add(f"{what}s that ended as {summary.status}", f"{what} {point} ended as {text}")
        return summary.iterations

    def end(self) -> None:
        """Say what is left to say."""
        self._lines.rest()
        if self._inexact and self._told == "all" and self._evaluator.problem.rank == 0:
            worst = ended(INEXACT, max(self._inexact), "", self._rtol)
            what = self._evaluator.names.point
            _log.warning("%d of %d %ss ended as %s", len(self._inexact), self._count, what, worst)

    @property
    def spent(self) -> Spent:
        """Seconds until now."""
        return Spent(self._first, perf_counter() - self._began)


def part_of(parameters: Sequence[SweptParameter], points: slice) -> list[SweptParameter]:
    """The parameters at some of the points."""
    return [replace(each, values=each.values[:, points]) for each in parameters]


def checkpoint_path(where: str, checkpoint: str | Path | None) -> Path | None:
    """The file of finished points that a user gave, if there is one."""
    return None if checkpoint is None else checked_path(where, checkpoint, "checkpoint", new=True)


def complete(result: Result | SampleResult) -> None:
    """Check that a run was not interrupted, nor the search that it is a part of; collective.

    Raises
    ------
    Interrupted
        One of them was.
    """
    if result.status in STOPPED:
        raise Interrupted
    stop_if_pressed()
    if result.problem.comm is not None and any(exchanged(result.problem.comm, pressed())):
        raise Interrupted
