"""Answers of a given accuracy: errors are measured as in :mod:`dolfinx_frontend.estimate.errors` while the
computation goes on, which stops as soon as they are small enough."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite, log2
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt
from latin_core import Options

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.checks import check_optional_kind, checked_flag, is_real
from dolfinx_frontend.common.describe import short, shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.errors import (
    DIGIT,
    FINEST,
    INTERRUPTED,
    lost_variance,
    REPLICATES,
    UNKNOWN,
    by_solves,
    change_of,
    complete,
    distance,
    enlarged,
    error_of_meshes,
    errors,
    errors_of_samples,
    next_halving,
    of_direct,
    not_known,
    sizes_of,
    whole_of,
)
from dolfinx_frontend.kernel.running import Interrupted
from dolfinx_frontend.plan.plan import Direction, Method, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.accuracy import largest_of
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors, ErrorShare, MeanStd, share_of
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, Resultant, interest
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.solvers.deterministic import solve_once
from dolfinx_frontend.solvers.galerkin import IndefiniteError, carry_on, solve_chaos
from dolfinx_frontend.uncertainty.chaos import Chaos

__all__ = ["solve_to_accuracy"]

_log = logging.getLogger(__name__)

SLOWEST = 0.7
"""Largest factor by which errors are assumed to change from one set of modes to the next."""

MOST_MODES = 2000

MOST_ORDER = 8
"""Highest order of an adaptive chaos: beyond it, samples are cheaper."""

STALLED = 0.6
"""A chaos does not converge if mean and deviation change by more than this times the change before."""

MOST_SAMPLES = 8192

RULES = (3, 5, 7, 9, 12, 16, 20)
"""Points per germ of the tensor rules that are tried one after the other, at least three of them: the third
reaches out to 3.8 standard deviations: a kink beyond that has next to no weight."""

SUREST = 0.5
"""Smallest factor by which changes are assumed to fall from rule to rule: at kinks they fall irregularly."""

FORGOTTEN = 0.5
"""Weight of the change of the rule before: with a kink, a change can be small by chance."""

FEW_GERMS = 3
"""Most germs that are integrated by tensor rules where a law is nonlinear."""


# --- solve to an accuracy ---------------------------------------------------------------------------
def solve_to_accuracy(
    problem: Problem,
    accuracy: float,
    quantity: Interest = None,
    method: Method = "auto",
    *,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    meshes: bool = True,
) -> Result | SampleResult:
    """Solve until the error of a quantity is at most `accuracy`.

    Parameters
    ----------
    accuracy
        Relative error of the quantity (if random, of its mean and of its standard deviation), in 1e-10..0.5.
    quantity
        As for :func:`errors`; None: the energy norm.
    meshes
        Estimate the error of the meshes, too: what it makes invisible is not computed. False: only
        algebraic and truncation error.

    Returns
    -------
    Result
        A :class:`ChaosResult` if something is random, or samples where its chaos does not converge.
        ``result.errors()`` has the errors, and says in its notes what could not be reached.
    """
    if not is_real(accuracy) or not 1e-10 <= accuracy <= 0.5:
        raise SceneError(f"accuracy = {short(accuracy)}: it must lie in 1e-10..0.5")
    check_optional_kind("solve", "options", options, Options, "give Options(rtol=...)")
    checked_flag("solve", "meshes", meshes)
    what = interest(problem.interfaces, quantity)
    options = options or (Options.plain() if method == "latin" else Options())
    options = options.with_(rtol=max(DIGIT * accuracy, FINEST))
    random = RandomLaws.of(problem)
    if random.every:
        if what is not None and active is None and what.interface not in random.interfaces:
            active = [what.interface]
        first = solve_chaos(
            problem,
            Chaos(order=1, check_points=0),
            method,
            times=times,
            active=active,
            direction=direction,
            options=options,
            estimator=errors,
        )
        return _Search(first, accuracy, what).answer(meshes)
    plan = make_plan(problem, method, active, (), direction, options, times=times)
    return _tight_enough(solve_once(problem, plan, estimator=errors), accuracy, what, meshes)


def _tight_enough(result: Result, accuracy: float, quantity: Resultant | None, meshes: bool) -> Result:
    """A deterministic run carried on until its algebraic error is small enough."""
    of_meshes: ErrorShare | None = None
    notes: tuple[str, ...] = ()
    made = not_known(result, quantity)
    try:
        complete(result)
        of_meshes = error_of_meshes(result, quantity) if meshes else None
        target = _visible(accuracy, of_meshes, quantity, result)
        made = _settled(result, quantity)
        iterated = bool(result.plan.active)
        while iterated and made.relative("algebraic") > target and result.plan.options.rtol > FINEST:
            fall = min(0.5 * target / made.relative("algebraic"), DIGIT)
            result = result.tightened(max(result.plan.options.rtol * fall, FINEST))
            made = not_known(result, quantity)
            complete(result)
            made = _settled(result, quantity)
    except Interrupted:
        notes = (INTERRUPTED,)
    return _with_errors(result, made, accuracy, of_meshes, notes, partial(next_halving, result))


def _visible(
    accuracy: float, of_meshes: ErrorShare | None, quantity: Resultant | None, result: Result
) -> float:
    """Target of the other errors: the accuracy, but not less than a tenth of the error of the meshes."""
    if of_meshes is None:
        return accuracy
    relative = of_meshes.energy
    if quantity is not None and of_meshes.quantity is not None:
        relative = share_of(of_meshes.quantity, result.mean_std(quantity).mean)
    return float(np.clip(0.1 * relative, accuracy, 0.5)) if isfinite(relative) else accuracy


def _settled(result: Result, quantity: Resultant | None) -> Errors:
    """Algebraic error of a deterministic run."""
    if quantity is None:
        estimate = ErrorShare(result.error, how="its estimate")
        found = estimate if result.plan.active else of_direct(result, None)
        return Errors(found, None, None, None, None)
    if not result.plan.active:
        value = result.mean_std(quantity)
        return Errors(of_direct(result, value), None, None, quantity, value)
    value = result.mean_std(quantity)
    tight = result.tightened(max(DIGIT * min(result.plan.options.rtol, result.error), FINEST))
    complete(tight)
    after = tight.mean_std(quantity)
    how = "the iteration carried on to a tenth of its error"
    found = ErrorShare(result.error, abs(after.mean - value.mean), None, how)
    return Errors(found, None, None, quantity, value)


Answered = TypeVar("Answered", Result, ChaosResult, SampleResult)


def _with_errors(
    result: Answered,
    made: Errors,
    accuracy: float,
    of_meshes: ErrorShare | None,
    notes: tuple[str, ...],
    halving: Callable[[Errors], str] | None = None,
) -> Answered:
    """The result with what is known of its errors; `halving` says what would halve them (None: as `made`)."""
    made = replace(made, asked=accuracy, discretisation=of_meshes)
    if made.relative("discretisation") > accuracy:
        notes += (
            f"the meshes leave {shown_error(made.relative('discretisation'))}, more than asked: "
            "refine them",
        )
    if made.total > accuracy:
        notes += (f"the accuracy was not reached: {shown_error(made.total)} is left",)
    if halving is not None and INTERRUPTED not in notes:
        made = replace(made, next_halving=halving(made))
    for note in notes if result.problem.rank == 0 else ():
        _log.warning("%s", note)
    return result.with_notes(found=replace(made, notes=(*lost_variance(result), *notes)))


class _Search:
    """A chaos that grows where it matters, until what it leaves out is small enough.

    Attributes
    ----------
    result
        The largest chaos so far.
    target
        What algebraic and truncation error must stay below.
    gain
        How much worse the quantity is than the energy norm.
    """

    def __init__(self, first: ChaosResult, accuracy: float, quantity: Resultant | None) -> None:
        self.result = first
        self.accuracy = self.target = accuracy
        self.quantity = quantity
        self.rtol = first.plan.options.rtol
        self.gain = 1.0
        self.of_meshes: ErrorShare | None = None
        self.notes: tuple[str, ...] = ()

    def answer(self, meshes: bool) -> ChaosResult | SampleResult:
        """The chaos, or samples where it does not converge; after Ctrl-C the last chaos that was solved."""
        try:
            return self._answer(meshes)
        except Interrupted:
            self.notes += (INTERRUPTED,)
            return self._found(not_known(self.result, self.quantity))

    def _answer(self, meshes: bool) -> ChaosResult | SampleResult:
        self._calibrate()
        result, quantity = self.result, self.quantity
        if meshes:
            self.of_meshes = error_of_meshes(result, quantity)
        self.target = _visible(self.accuracy, self.of_meshes, quantity, result)
        self.rtol = float(np.clip(0.2 * self.target / self.gain, FINEST, 1e-3))
        curved = bool(result.collocations)
        if curved and quantity is not None and result.space.dimension <= FEW_GERMS:
            # few germs and nonlinear laws: rules converge where the chaos does, and a point costs less; the
            # error of the iteration is part of the changes from rule to rule
            each = float(np.clip(0.03 * self.target, FINEST, 3e-3))
            by_rules = _by_rules(result, quantity, self.target, each)
            if by_rules is None:
                return self._by_samples()
            return _with_errors(*by_rules, self.accuracy, self.of_meshes, self.notes)
        left, stalled = self._grow(curved)
        if curved and (stalled or left > 0.5 * self.target):
            return self._by_samples()
        made = _errors_of_chaos(self.result, quantity, left, self.gain)
        if curved:
            made = replace(made, truncation=by_solves(self.result, quantity))
            if made.relative("truncation") > self.target and quantity is not None:
                return self._by_samples()
        return self._found(made)

    def _found(self, made: Errors) -> ChaosResult:
        halving = partial(next_halving, self.result)
        return _with_errors(self.result, made, self.accuracy, self.of_meshes, self.notes, halving)

    def _carry_on(self, chaos: Chaos, rtol: float) -> None:
        self.result = carry_on(self.result, chaos, rtol)
        complete(self.result)

    def _calibrate(self) -> None:
        """Measure, on the first and cheapest chaos, how much worse the quantity is than the energy norm."""
        result, quantity, rtol = self.result, self.quantity, self.rtol
        complete(result)
        loose = result.error
        before = None if quantity is None else result.mean_std(quantity)
        self._carry_on(result.chaos, max(DIGIT * min(rtol, loose), FINEST))
        if quantity is not None and before is not None and loose > 0.0:
            change = change_of(before, self.result.mean_std(quantity), rtol)
            self.gain = max(change / loose, _mean_over_spread(self.result))

    def _grow(self, curved: bool) -> tuple[float, bool]:
        """Enlarge the chaos. Returns what it still leaves out, and whether it has stopped converging."""
        quantity, target = self.quantity, self.target
        change_before, left, fall = np.nan, np.inf, SLOWEST
        stalled = False
        while not stalled and left > 0.5 * target:
            old = self.result
            chaos = self._next(curved)
            if chaos is None:
                break
            before = None if quantity is None else old.mean_std(quantity)
            try:
                self._carry_on(chaos, self.rtol)
            except IndefiniteError as error:
                self.notes += (f"the chaos cannot grow: {str(error).splitlines()[0]}",)
                break
            if quantity is None or before is None:
                change = distance(self.result, old)
            else:
                change = change_of(before, self.result.mean_std(quantity), self.rtol)
            if isfinite(change_before) and change_before > 0.0:
                fall = min(change / change_before, SLOWEST)
                stalled = curved and change > STALLED * change_before and change > target
            else:
                fall = float(np.clip(_decay(self.result, quantity), UNKNOWN, SLOWEST))
            left = change * fall / (1.0 - fall)
            change_before = change
        return left, stalled

    def _next(self, curved: bool) -> Chaos | None:
        """The next larger chaos; None: that would be too large."""
        result = self.result
        chaos = enlarged(result, self.quantity, self.target)
        if curved:
            chaos = Chaos(order=result.chaos.order + 1, check_points=0)
        modes = len(chaos.indices) if chaos.indices is not None else 0
        if chaos.order > MOST_ORDER + (0 if curved else 12) or modes > MOST_MODES:
            self.notes += (
                f"the chaos was not carried beyond order {result.chaos.order}, {result.modes} modes",
            )
            return None
        return chaos

    def _by_samples(self) -> ChaosResult | SampleResult:
        """Quasi-Monte Carlo on the solver of a chaos that converges too slowly."""
        result, quantity = self.result, self.quantity
        if quantity is None:
            return self._found(_errors_of_chaos(result, None, by_solves(result, None).energy, 1.0))
        self.notes += (
            "chaos and Gauss rules converge slowly (a law is nonlinear): quasi-Monte Carlo on the same "
            "solver",
        )
        each = 32
        while True:
            parts = [result.space.sample_sobol(each, seed) for seed in range(REPLICATES)]
            samples = result.sample(np.concatenate(parts), kind="qmc")
            complete(samples)
            made = errors_of_samples(samples, quantity)
            total = each * REPLICATES
            if made.relative("truncation") <= 0.7 * self.target:
                break
            # errors of scrambled points fall like 1 / N at best, more slowly where there are kinks
            factor = 2 ** max(1, min(3, round(log2(made.relative("truncation") / (0.5 * self.target)))))
            if total * factor > MOST_SAMPLES:
                self.notes += (f"{total} samples: more are left to you, see quasi_monte_carlo",)
                break
            each *= factor
        return _with_errors(samples, made, self.accuracy, self.of_meshes, self.notes)


def _mean_over_spread(result: ChaosResult) -> float:
    """Size of the whole field over that of its deviation."""
    sizes = sizes_of(result, None)[0]
    spread = float(np.sum(sizes[1:] ** 2))
    return float(np.sqrt((1.0 + spread) / spread)) if spread > 1e-6 else 1.0


def _decay(result: ChaosResult, quantity: Resultant | None) -> float:
    """Size of the modes of the last degree, relative to those of the last but one."""
    sizes, _ = sizes_of(result, quantity)
    degree = result.basis.indices.table.sum(axis=1)
    last = int(degree.max())
    if last < 2:
        return SLOWEST
    above, below = (float(np.sqrt(np.sum(sizes[degree == d] ** 2))) for d in (last, last - 1))
    return above / below if below > 0.0 else SLOWEST


def _errors_of_chaos(
    result: ChaosResult, quantity: Resultant | None, left: float, gain: float
) -> Errors:
    """Errors that an adaptive run has found on its way."""
    algebraic = ErrorShare(result.error, how="its estimate")
    how = "the change by the last modes, carried on"
    if quantity is None:
        return Errors(algebraic, ErrorShare(left, how=how), None, None, None)
    value = result.mean_std(quantity)
    whole = whole_of(value, result.plan.options.rtol)
    assert whole is not None  # of a chaos
    size = gain * result.error
    algebraic = ErrorShare(
        result.error, size * abs(value.mean), size * whole, f"its estimate times {gain:.2g}, as at order 1"
    )
    truncation = ErrorShare(np.nan, left * abs(value.mean), left * whole, how)
    return Errors(algebraic, truncation, None, quantity, value, whole)


def _by_rules(
    result: ChaosResult, quantity: Resultant, target: float, rtol: float
) -> tuple[SampleResult, Errors] | None:
    """Tensor Gauss rules of rising order on the solver of a chaos; None: they do not converge in time."""
    before: MeanStd | None = None
    changes: list[float] = []
    for points in RULES:
        rule = result.space.tensor_gauss(points)
        if len(rule.points) > MOST_SAMPLES:
            return None
        samples = result.sample(rule.points, rule.weights, "quadrature", rtol=rtol)
        complete(samples)
        value = samples.mean_std(quantity)
        if before is not None:
            changes.append(change_of(before, value, rtol))
            # earlier changes count with less weight, and the fall is the mean over all of them
            change = max(c * FORGOTTEN**k for k, c in enumerate(reversed(changes)))
            fall = SUREST
            if len(changes) > 1 and changes[0] > 0.0:
                mean = (changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1))
                fall = float(np.clip(mean, SUREST, SLOWEST))
            left = change * fall / (1.0 - fall)
            if len(changes) > 1 and left <= 0.5 * target:
                whole = whole_of(value, rtol)
                error = largest_of(samples.error)
                how = f"the change by the last of {points} points per germ, carried on"
                made = Errors(
                    ErrorShare(error, error * abs(value.mean), error * abs(value.mean), "its estimate"),
                    ErrorShare(np.nan, left * abs(value.mean), left * (whole or 0.0), how),
                    None,
                    quantity,
                    value,
                    whole,
                )
                more = RULES[min(RULES.index(points) + 1, len(RULES) - 1)]
                count = more**result.space.dimension
                seconds = sum(samples.seconds.values()) * count / len(rule.points)
                return samples, replace(
                    made, next_halving=f"{more} points per germ, {count} solves, about {seconds:.2g} s"
                )
        before = value
    return None
