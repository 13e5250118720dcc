"""``solve``: which solver answers which request."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, overload

import numpy.typing as npt
from latin_core import Iteration, Options, State

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.adaptive import solve_to_accuracy
from dolfinx_frontend.plan.plan import Direction, Method, Plan
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.solvers.chaos import ChaosResult, solve_chaos
from dolfinx_frontend.solvers.deterministic import solve_deterministic
from dolfinx_frontend.uncertainty.chaos import Chaos

__all__ = ["solve"]


@overload
def solve(
    problem: Problem,
    method: Method = "auto",
    *,
    accuracy: float,
    quantity: Resultant | str | None = None,
    meshes: bool = True,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
) -> Any: ...


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
) -> ChaosResult: ...


def solve(
    problem: Problem,
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
    accuracy: float | None = None,
    quantity: Resultant | str | None = None,
    meshes: bool = True,
) -> Any:
    """Solve a problem.

    Parameters
    ----------
    problem
        From :func:`dolfinx_frontend.assemble`.
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
    accuracy
        Instead of a tolerance and an order: the relative error that the answer may have, 1e-10 to 0.5.
        Tolerance, order and modes follow; ``result.errors()`` says what was reached and what dominates.
        Where something is random the answer is a :class:`ChaosResult`, or, where its chaos does not
        converge, a :class:`SampleResult`.
    quantity
        Of which: a :class:`Resultant` (if random, of its mean and of its standard deviation), the name of an
        interface (its normal force), or ``"energy"`` (None).
    meshes
        With `accuracy`: estimate the error of the meshes and compute nothing that it makes invisible.

    Returns
    -------
    Result
        Its ``status`` says whether the tolerance was reached; nothing is raised if it was not. With
        times a :class:`HistoryResult`, with chaos a :class:`ChaosResult`.

    Raises
    ------
    SceneError
        A plan that cannot be carried out, or loads that no forces of the interfaces can balance.
    IndefiniteError
        A Galerkin stiffness is indefinite.
    KeyboardInterrupt
        At a second Ctrl-C, or during the factorisation. The first one ends the iteration within one step,
        with the status ``"interrupted"`` and a warning in the log.

    Warns
    -----
    SceneWarning
        Parts that have lost their support, see :mod:`dolfinx_frontend.solvers.support`.
    """
    if accuracy is not None:
        set_elsewhere = {"chaos": chaos, "plan": plan, "start": start, "callback": callback}
        for name, value in set_elsewhere.items():
            if value is not None:
                raise SceneError(
                    f"accuracy = {accuracy:g} decides on the chaos and the plan: leave {name} out"
                )
        return solve_to_accuracy(
            problem,
            accuracy,
            quantity,
            method,
            times=times,
            active=active,
            direction=direction,
            options=options,
            meshes=meshes,
        )
    if quantity is not None:
        raise SceneError("a quantity goes with an accuracy: solve(problem, accuracy=1e-3, quantity=...)")
    if chaos is not None:
        return solve_chaos(
            problem,
            chaos,
            method,
            times=times,
            active=active,
            direction=direction,
            options=options,
            plan=plan,
            start=start,
            indefinite=indefinite,
            callback=callback,
        )
    return solve_deterministic(
        problem,
        method,
        times=times,
        active=active,
        direction=direction,
        options=options,
        plan=plan,
        start=start,
        callback=callback,
    )
