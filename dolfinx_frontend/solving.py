"""What a user calls: which solver answers which request.

``solve`` for one answer (deterministic, a history, a chaos, or as right as asked), ``sweep`` for a grid of
parameter sets, ``monte_carlo`` and its kin for points of the germs; ``errors`` of any of these.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy.typing as npt
from latin_core import Iteration, NumericalError, Options, State
from mpi4py import MPI

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.checks import (
    check_kind,
    check_optional_kind,
    checked_flag,
    checked_number,
    checked_word,
    is_real,
)
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import BalanceError, SceneError, SceneWarning, warn
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.estimate.adaptive import solve_to_accuracy
from dolfinx_frontend.estimate.errors import errors
from dolfinx_frontend.estimate.meshes import solve_scene
from dolfinx_frontend.evaluate import sampling
from dolfinx_frontend.evaluate.function import ProblemFunction, check_handed_on, problem_function
from dolfinx_frontend.evaluate.sweep import sweep
from dolfinx_frontend.kernel.running import check_running
from dolfinx_frontend.kernel.spread import check_given_alike
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, check_settings, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.results.resultant import Interest
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers.deterministic import solve_once, start_states
from dolfinx_frontend.solvers.export import export
from dolfinx_frontend.solvers.galerkin import solve_chaos
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.quantities import Kind
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import Compared

__all__ = [
    "SampleSettings",
    "errors",
    "export",
    "monte_carlo",
    "quasi_monte_carlo",
    "sample",
    "solve",
    "sparse_quadrature",
    "sweep",
    "tensor_quadrature",
]


@overload
def solve(
    problem: Scene,
    method: Method = "auto",
    *,
    accuracy: float,
    quantity: Interest = None,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    max_unknowns: int | None = None,
    max_seconds: float | None = None,
    progress: bool = True,
    absolute: float | None = None,
    relative_to: Literal["value", "deviation"] = "value",
    comm: Any = None,
) -> Result | SampleResult: ...


@overload
def solve(
    problem: Problem,
    method: Method = "auto",
    *,
    accuracy: float,
    quantity: Interest = None,
    meshes: bool = True,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    absolute: float | None = None,
    relative_to: Literal["value", "deviation"] = "value",
) -> Result | SampleResult: ...


@overload
def solve(
    problem: Problem,
    method: Method = "auto",
    *,
    chaos: None = None,
    times: None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    max_seconds: float | None = None,
) -> Result: ...


@overload
def solve(
    problem: Problem,
    method: Method = "auto",
    *,
    chaos: None = None,
    times: npt.ArrayLike,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    max_seconds: float | None = None,
) -> HistoryResult: ...


@overload
def solve(
    problem: Problem,
    method: Method = "auto",
    *,
    chaos: Chaos | int,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    indefinite: Literal["refuse", "prove"] = "refuse",
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    max_seconds: float | None = None,
) -> ChaosResult: ...


@together("solve")
def solve(
    problem: Problem | Scene,
    method: Method = "auto",
    *,
    chaos: Chaos | int | None = None,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    indefinite: Literal["refuse", "prove"] = "refuse",
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    accuracy: float | None = None,
    quantity: Interest = None,
    meshes: bool = True,
    max_unknowns: int | None = None,
    max_seconds: float | None = None,
    absolute: float | None = None,
    relative_to: Literal["value", "deviation"] = "value",
    comm: Any = None,
) -> Result | SampleResult:
    """Solve a problem.

    Parameters
    ----------
    problem
        From :func:`dolfinx_frontend.assemble`; or, with `accuracy`, a :class:`Scene`: then its meshes are a
        part of the answer, and are made finer where they decide.
    method, active, direction, options
        As :func:`dolfinx_frontend.make_plan` takes them; or
    chaos
        Expand the answer in polynomial chaos: order and index set, or the order of a total-degree set.
        None: random parameters are taken at their mean, and the plan says so.
    times
        Times (T,) of a load history; values of laws that change in time (:class:`Amplitude`) are taken there.
        The state before the first time is unloaded and unslipped.
    plan
        a plan made before.
    start
        Start from the interface state of an earlier result of the same plan.
    indefinite
        With chaos: ``"refuse"`` a random stiffness whose Galerkin matrix is indefinite, or ``"prove"``
        first that the structure as a whole is definite and go on.
    callback
        Called after every iteration; it may raise StopIteration to end the run with what is done so far, as
        Ctrl-C does (see :mod:`dolfinx_frontend.kernel.running`), or anything else to end it without a result.
    progress
        A progress bar if on a terminal.
    accuracy
        Instead of a tolerance and an order: the relative error that the answer may have, 1e-10 to 0.5.
        Tolerance, order and modes follow; ``result.errors()`` says what was reached and what dominates.
        Where something is random the answer is a :class:`ChaosResult`, or, where its chaos does not
        converge, a :class:`SampleResult`.
    quantity
        Of which: a :class:`Resultant` (if random, of its mean and of its standard deviation), the name of an
        interface (its normal force), a number of the tables by name (``"joint.pressure_max"``, see
        :meth:`Result.quantity`), a :class:`Quantile`, a function of the fields (:class:`Measure`), or
        ``"energy"`` (None).
    absolute
        Of the quantity, in its unit, > 0: an error (of mean or deviation) below it is small enough, whatever
        `accuracy` says; for what may be zero.
    relative_to
        What an error of the mean is relative to: the ``"value"`` itself, or the ``"deviation"``, where that
        is what counts. An error of the deviation is relative to the deviation in either case.
    meshes
        With `accuracy`: estimate the error of the meshes and compute nothing that it makes invisible.
    max_unknowns, max_seconds
        Budgets: of the meshes of a scene, in unknowns of all parts (None: 400 000); in seconds, of
        factorisation and iteration (None: no limit): it ends then with what is done so far and the status
        ``"time_limit"``, with `accuracy` with the best answer so far, and ``result.errors()`` says what is
        left.
    comm
        Of a scene: mpi4py communicator over which its parts are spread, as for
        :func:`dolfinx_frontend.assemble`; collective. A problem has the ranks that it was assembled over.

    Returns
    -------
    Result
        Its ``status`` says whether the tolerance was reached; nothing is raised if it was not. With
        times a :class:`HistoryResult`, with chaos a :class:`ChaosResult`. A deterministic run that gives
        up is made again with the default settings, and with a softer search direction, unless a plan,
        the method ``"latin"`` or fewer iterations than usual are asked for; the plan of the result is
        that of the run that converged, and the log says so.

    Raises
    ------
    SceneError
        A plan that cannot be carried out, or loads that no forces of the interfaces can balance.
    IndefiniteError
        A Galerkin stiffness is indefinite.
    KeyboardInterrupt
        At a second Ctrl-C, or during the factorisation. The first one ends the iteration within one step,
        with the status ``"interrupted"`` and a warning in the log. With an accuracy, once something is
        solved, it ends the search: the best answer so far comes back, and ``result.errors()`` says in its
        notes that it was interrupted and has the errors as far as they are known.

    Warns
    -----
    SceneWarning
        Parts that have lost their support, see :mod:`dolfinx_frontend.evaluate.support`.
    """
    settings: dict[str, Any] = {"times": times, "active": active, "direction": direction, "options": options}
    check_running("solve", callback, progress)
    compared = _compared(accuracy, quantity, absolute, relative_to)
    check_optional_kind("solve", "comm", comm, MPI.Intracomm, "give an mpi4py communicator, or None")
    if comm == MPI.COMM_NULL:
        raise SceneError("solve: comm is MPI.COMM_NULL, or was freed; give another, or None")
    checked_flag("solve", "meshes", meshes)
    if isinstance(problem, Scene) and accuracy is not None:
        given_too = {"chaos": chaos, "plan": plan, "start": start, "callback": callback}
        for name, value in (given_too | {"meshes": None if meshes else meshes}).items():
            if value is not None:
                raise SceneError(
                    f"solve(scene, accuracy={short(accuracy)}) decides on the meshes: leave {name} out"
                )
        return solve_scene(
            problem,
            accuracy,
            quantity,
            method,
            max_unknowns=max_unknowns,
            max_seconds=max_seconds,
            progress=progress,
            compared=compared,
            comm=comm,
            **settings,
        )
    if isinstance(problem, Scene):
        to_do = "assemble the scene first: assemble(scene); or say how accurate the answer is to be, whose "
        to_do += "meshes are then made for it: solve(scene, accuracy=1e-2, quantity=...)"
        check_kind("solve", "problem", problem, Problem, to_do)
    check_problem("solve", problem, plan)
    assert isinstance(problem, Problem)  # a scene was refused
    if comm is not None:
        raise SceneError("solve: comm is of a scene; a problem has its ranks: assemble(scene, comm=...)")
    if max_unknowns is not None:
        raise SceneError("max_unknowns is the budget of meshes: solve(scene, accuracy=...)")
    if max_seconds is not None and accuracy is None:
        seconds = checked_number("solve", "max_seconds", max_seconds, above=0.0)
        if plan is None:
            settings["options"] = (options or Options()).with_(max_seconds=seconds)
        else:
            plan = replace(plan, options=plan.options.with_(max_seconds=seconds))
    told = {"chaos": chaos, "indefinite": indefinite, "accuracy": accuracy, "quantity": quantity}
    given = {"plan": plan is None, "start": start is None, "meshes": meshes, "callback": callback is None}
    check_settings("solve", plan, method, **settings)
    checked_word("solve", "indefinite", indefinite, ("refuse", "prove"))
    start_states(start)
    problem.check_alike("solve", laws=True, method=method, **told, **given, **settings)
    if accuracy is not None:
        set_elsewhere = {"chaos": chaos, "plan": plan, "start": start, "callback": callback}
        for name, value in set_elsewhere.items():
            if value is not None:
                raise SceneError(
                    f"accuracy = {short(accuracy)} decides on the chaos and the plan: leave {name} out"
                )
        return solve_to_accuracy(
            problem,
            accuracy,
            quantity,
            method,
            meshes=meshes,
            compared=compared,
            max_seconds=max_seconds,
            **settings,
        )
    if quantity is not None:
        raise SceneError("a quantity goes with an accuracy: solve(problem, accuracy=1e-3, quantity=...)")
    if chaos is not None:
        return solve_chaos(
            problem,
            chaos,
            method,
            plan=plan,
            start=start,
            indefinite=indefinite,
            callback=callback,
            progress=progress,
            estimator=errors,
            **settings,
        )
    if plan is not None:
        return _solved(problem, plan, start, callback, progress)
    plan = make_plan(problem, method, vary=(), **settings)
    others = () if method == "latin" else _other_plans(problem, **settings)
    try:
        return _solved(problem, plan, start, callback, progress, others)
    except NumericalError:
        # on several ranks the others may not have failed
        if start is not None or problem.comm is not None or len(plan.active) == len(problem.interfaces):
            raise
        kept = _with_all_kept(problem, method, callback, progress, **settings)
        if kept is None:
            raise
        return kept


def _solved(
    problem: Problem,
    plan: Plan,
    start: Result | State | None,
    callback: Callable[[Iteration], None] | None,
    progress: bool,
    others: Iterable[Plan] = (),
) -> Result:
    """Of a history that goes beyond what its joints carry: with the steps before."""
    try:
        return solve_once(problem, plan, start, callback, progress, errors, others)
    except BalanceError as failure:
        if failure.answer is None:
            raise
        warn(f"{failure}; result.statuses has the steps before it", SceneWarning)
        answer: Result = failure.answer
        return answer


def _with_all_kept(
    problem: Problem,
    method: Method,
    callback: Callable[[Iteration], None] | None,
    progress: bool,
    **settings: Any,
) -> Result | None:
    """Parts whose joined matrix does not factorise, for their moduli differ too much, solved one by one, as
    well as rounding allows; None if that finds no answer either."""
    try:
        plan = make_plan(problem, method, vary=(), **{**settings, "active": "all"})
        result = solve_once(problem, plan, None, callback, progress, errors)
    except (SceneError, NumericalError):
        return None
    known = result.status == "inexact" and result.error < _STILL_AN_ANSWER
    if not known and result.status not in ("converged", *STOPPED):
        return None
    if problem.rank == 0:
        _log.warning("parts that are joined do not factorise together: all interfaces are kept")
    return result


def _compared(
    accuracy: float | None, quantity: Interest, absolute: float | None, relative_to: str
) -> Compared | None:
    """What errors are relative to; None: nothing is said of it."""
    checked_word("solve", "relative_to", relative_to, ("value", "deviation"))
    if absolute is None and relative_to == "value":
        return None
    if accuracy is None or quantity is None:
        raise SceneError(
            "absolute and relative_to go with an accuracy of a quantity: solve(problem, accuracy=1e-2, "
            "quantity=..., absolute=...)"
        )
    least = 0.0 if absolute is None else checked_number("solve", "absolute", absolute, above=0.0)
    if is_real(accuracy) and accuracy > 0.0:  # which others refuse
        least /= accuracy
    return Compared(least, relative_to == "deviation")


_log = logging.getLogger(__name__)
_STILL_AN_ANSWER = 0.3
"""An inexact answer whose error is below this says more than an exception."""
_SOFTER = 0.1
"""A search direction that suits soft contacts, where the default does not do."""


def _other_plans(
    problem: Problem,
    *,
    times: npt.ArrayLike | None,
    active: Sequence[str] | Literal["all"] | None,
    direction: Direction | float | None,
    options: Options | None,
) -> Iterator[Plan]:
    """Plans of what is solved in another way where a run gives up, made when they are asked for."""
    default = Options()
    own = options or default
    if own.criterion == "indicator" or own.max_iterations < default.max_iterations:
        return
    ways = ("acceleration", "relaxation", "newton", "macro", "directions", "precision")
    ordinary = own.with_(**{name: getattr(default, name) for name in ways})
    if direction is not None or own != ordinary:
        yield make_plan(problem, vary=(), times=times, active=active, options=ordinary)
    if active is not None:
        yield make_plan(problem, vary=(), times=times, options=ordinary)
    yield make_plan(problem, vary=(), times=times, direction=_SOFTER, options=ordinary)


class SampleSettings(TypedDict, total=False):
    """Settings of every sampling, see :func:`sample`."""

    method: Method
    active: Sequence[str] | Literal["all"] | None
    direction: Direction | float | None
    options: Options | None
    plan: Plan | None
    times: npt.ArrayLike | None
    keep_states: bool
    checkpoint: str | Path | None
    callback: Callable[[Iteration], None] | None
    progress: bool
    points_comm: Any


@together("sample")
def sample(
    problem: Problem,
    germs: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    kind: Kind = "random",
    **settings: Unpack[SampleSettings],
) -> SampleResult:
    """Solve at given points of the germs.

    Parameters
    ----------
    germs
        (N, L) points.
    weights
        (N,) quadrature weights; None: equal.
    kind
        What the points are: independent draws (``"random"``), ``"qmc"`` or a ``"quadrature"``.
    settings
        method, active, direction, options, plan: as for :func:`solve`; interfaces with random parameters are
        always active.
        times: times (T,) of a load history; random values do not change in it.
        keep_states: keep the interface states, from which displacements can be recovered.
        checkpoint: as for :func:`sweep`.
        callback: called after every iteration; it may raise StopIteration to end the sampling with what is
        done so far.
        progress: a progress bar if on a terminal.
        points_comm: as for :func:`sweep`, ranks that solve the points together.

    Raises
    ------
    KeyboardInterrupt
        At a second Ctrl-C. The first one returns the points that are finished, ``complete`` is False then.
    SceneError
        Nothing is random, or a sample is no admissible law (a negative stiffness).
    """
    return sampling.sample(problem, germs, weights, kind, estimator=errors, **settings)


def _space(where: str, problem: Problem) -> RandomSpace:
    """The germs of a problem that something is to be sampled of."""
    check_problem(where, problem)
    random = RandomLaws.of(problem)
    if not random.every:
        raise SceneError(f"{where}: nothing is random: give a law or a load a random parameter")
    return random.space


@together("monte_carlo")
def monte_carlo(
    problem: Problem, samples: int, seed: int = 0, **settings: Unpack[SampleSettings]
) -> SampleResult:
    """Monte Carlo with `samples` independent points; `settings` as for :func:`sample`."""
    germs = _space("monte_carlo", problem).sample(samples, seed)
    check_given_alike(problem, "monte_carlo", settings.get("points_comm"), samples=samples, seed=seed)
    return sample(problem, germs, **settings)


@together("quasi_monte_carlo")
def quasi_monte_carlo(
    problem: Problem, samples: int, seed: int = 0, **settings: Unpack[SampleSettings]
) -> SampleResult:
    """Scrambled Sobol points, a power of two of them; `settings` as for :func:`sample`."""
    germs = _space("quasi_monte_carlo", problem).sample_sobol(samples, seed)
    check_given_alike(problem, "quasi_monte_carlo", settings.get("points_comm"), samples=samples, seed=seed)
    return sample(problem, germs, kind="qmc", **settings)


@together("tensor_quadrature")
def tensor_quadrature(
    problem: Problem, points: int, **settings: Unpack[SampleSettings]
) -> SampleResult:
    """Tensor Gauss rule with `points` in each germ; `settings` as for :func:`sample`."""
    rule = _space("tensor_quadrature", problem).tensor_gauss(points)
    check_given_alike(problem, "tensor_quadrature", settings.get("points_comm"), points=points)
    return sample(problem, rule.points, rule.weights, "quadrature", **settings)


@together("sparse_quadrature")
def sparse_quadrature(
    problem: Problem, level: int, **settings: Unpack[SampleSettings]
) -> SampleResult:
    """Smolyak rule, exact for total degree 2 level + 1; `settings` as for :func:`sample`."""
    rule = _space("sparse_quadrature", problem).sparse_gauss(level)
    check_given_alike(problem, "sparse_quadrature", settings.get("points_comm"), level=level)
    return sample(problem, rule.points, rule.weights, "quadrature", **settings)


def _function(
    problem: Problem, quantities: Any, inputs: Sequence[str] | str | None = None, **settings: Any
) -> ProblemFunction:
    """The assembly as a function of its uncertain numbers, see :class:`ProblemFunction`.

    Parameters
    ----------
    quantities
        What it returns: the name of an interface (its normal force), a :class:`Resultant`, a function of
        the fields, a :class:`Response`, or several of them in a list or by name.
    inputs
        Names of what it depends on: random numbers of the scene, by their own values; parameters of laws,
        loads and parts, as for :func:`sweep`; germs, of random fields. What is random and not named
        stays at its mean. None: all that is random.
    settings
        method, active, direction, options, plan, times: as for :func:`solve`.
        coordinates: ``"physical"``, or ``"germs"`` or ``"normal"`` to give all that is random by its
        germs, or by independent standard normal scores.
        on_failure: of points that do not converge, ``"nan"`` (NaN and a warning that names them) or
        ``"raise"``.
        checkpoint: a file of the points that were solved; a script that asks for the same ones in the
        same order again is answered from it, with the same digits, and goes on.
        points_comm: as for :func:`sweep`, ranks that solve the points together: all make the same calls.

    Raises
    ------
    SceneError
        Nothing is random and no input is named, or an unknown name.
    """
    own = ("coordinates", "on_failure", "more")
    check_handed_on("function", {n: v for n, v in settings.items() if n not in own})
    return problem_function(problem, quantities, inputs, **settings)


Problem.export = export
Problem.function = _function
