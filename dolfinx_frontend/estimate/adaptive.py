"""How wrong an answer is, and answers that are as right as asked.

Three errors remain in an answer: of the iteration (algebraic), of the chaos (truncation), of the meshes
(discretisation). Each is measured in the energy norm and in a quantity of interest by doing a little more
and looking at what changes: the iteration goes on for one digit, the chaos gets its next modes (both on the
factors that are there, started from the answer that is there). :func:`solve_to_accuracy` uses the same
measurements to stop as soon as the answer is good enough.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, log2
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import Options

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.errors import (
    DIGIT,
    FINEST,
    REPLICATES,
    UNKNOWN,
    ErrorShare,
    Errors,
    Interest,
    Moments,
    change_of,
    checked,
    distance_of,
    enlarged,
    errors_of_samples,
    interest_of,
    moments,
    next_step,
    share_of,
    share_of_meshes,
    sizes_of,
    tightened,
    whole_of,
)
from dolfinx_frontend.plan.plan import Direction, Method
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.solvers.chaos import ChaosResult, IndefiniteError, carry_on, solve_chaos
from dolfinx_frontend.solvers.deterministic import solve_deterministic
from dolfinx_frontend.solvers.sampling import SampleResult
from dolfinx_frontend.uncertainty.chaos import Chaos

__all__ = ["solve_to_accuracy"]

_log = logging.getLogger(__name__)

SLOWEST = 0.7
"""Errors are not taken to fall more slowly than so from one set of modes to the next."""

MOST_MODES = 2000

MOST_ORDER = 8
"""Of an adaptive chaos: beyond, samples are cheaper."""

STALLED = 0.6
"""Moments that change more than so from order to order, in terms of the change before, do not converge."""

MOST_SAMPLES = 8192

RULES = (3, 5, 7, 9, 12, 16, 20)
"""Points a germ of the tensor rules that are tried one after the other, at least three of them: the third
looks 3.8 standard deviations far, so that a kink beyond it hardly counts."""

SUREST = 0.5
"""Changes of rules are not taken to fall faster than so: with kinks they are no series."""

FORGOTTEN = 0.5
"""What a change still counts, one rule later: with a kink, changes are small by chance."""

FEW_GERMS = 3
"""So many germs are integrated by tensor rules where laws are not linear."""


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
    """Solve until the error of a quantity is at most as large as asked.

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
    if not (np.isfinite(accuracy) and 1e-10 <= accuracy <= 0.5):
        raise SceneError(f"accuracy = {accuracy!r}: it must lie in 1e-10..0.5")
    what = interest_of(problem, quantity)
    options = options or _default_options(method)
    kept = active
    settings: dict[str, Any] = {"times": times, "direction": direction}
    random = RandomLaws.of(problem)
    if random.sources:
        if what is not None and active is None and what.interface not in random.interfaces:
            kept = [what.interface]
        return _adaptive(problem, accuracy, what, method, kept, options, random, meshes, settings)
    first = max(DIGIT * accuracy, FINEST)
    result: Result = solve_deterministic(
        problem, method, active=active, options=options.with_(rtol=first), **settings
    )
    of_meshes = share_of_meshes(result, what) if meshes else None
    target = _visible(accuracy, of_meshes, what, result)
    made = _settled(result, what, target)
    while made.relative("algebraic") > target and result.plan.options.rtol > FINEST:
        rtol = max(result.plan.options.rtol * min(0.5 * target / made.relative("algebraic"), DIGIT), FINEST)
        result = tightened(result, rtol)
        made = _settled(result, what, target)
    answer: Result = _with_errors(result, made, accuracy, of_meshes, ())
    return answer


def _default_options(method: Method) -> Options:
    return Options.plain() if method == "latin" else Options()


def _visible(
    accuracy: float, of_meshes: ErrorShare | None, quantity: Resultant | None, result: Result
) -> float:
    """What the other errors must keep below: nothing is pushed ten times below the error of the meshes."""
    if of_meshes is None:
        return accuracy
    relative = of_meshes.energy
    if quantity is not None and of_meshes.quantity is not None:
        relative = share_of(of_meshes.quantity, moments(result, quantity).mean)
    return float(np.clip(0.1 * relative, accuracy, 0.5)) if isfinite(relative) else accuracy


def _settled(result: Result, quantity: Resultant | None, target: float) -> Errors:
    """Algebraic error of a deterministic run."""
    if quantity is None or not result.plan.active:
        share = ErrorShare(result.error if result.plan.active else FINEST, how="its estimate")
        if quantity is None:
            return Errors(share, None, None, None, None)
        value = moments(result, quantity)
        share = replace(share, quantity=FINEST * abs(value.mean), how="direct solve")
        return Errors(share, None, None, quantity, value)
    value = moments(result, quantity)
    after = moments(tightened(result, max(DIGIT * result.plan.options.rtol, FINEST)), quantity)
    how = "the iteration carried on for one digit"
    share = ErrorShare(result.error, abs(after.mean - value.mean), None, how)
    return Errors(share, None, None, quantity, value)


def _with_errors(
    result: Any,
    made: Errors,
    accuracy: float,
    of_meshes: ErrorShare | None,
    notes: tuple[str, ...],
) -> Any:
    """The result with what is known of its errors."""
    made = replace(made, asked=accuracy, discretisation=of_meshes)
    if made.relative("discretisation") > accuracy:
        notes += (
            f"the meshes leave {made.relative('discretisation'):.1e}, more than asked: "
            "refine them",
        )
    if made.total > accuracy:
        notes += (f"the accuracy was not reached: {made.total:.1e} is left",)
    if isinstance(result, Result):
        made = replace(made, next_halving=next_step(result, made))
    result._errors = replace(made, notes=notes)
    for note in notes:
        _log.warning("%s", note)
    return result


def _adaptive(
    problem: Problem,
    accuracy: float,
    quantity: Resultant | None,
    method: Method,
    active: Sequence[str] | Literal["all"] | None,
    options: Options,
    random: RandomLaws,
    meshes: bool,
    settings: dict[str, Any],
) -> Result | SampleResult:
    """A chaos that grows where it matters, until what it leaves out is small enough."""
    rtol = max(DIGIT * accuracy, FINEST)
    result = solve_chaos(
        problem,
        Chaos(order=1, check_points=0),
        method,
        active=active,
        options=options.with_(rtol=rtol),
        **settings,
    )
    # how much worse a quantity is than the energy norm is found out where it is cheap
    loose = result.error
    before = None if quantity is None else moments(result, quantity)
    result = carry_on(result, result.chaos, max(DIGIT * min(rtol, loose), FINEST))
    gain = 1.0
    if quantity is not None and before is not None and loose > 0.0:
        gain = max(change_of(before, moments(result, quantity), rtol) / loose, _mean_over_spread(result))
    of_meshes = share_of_meshes(result, quantity) if meshes else None
    target = _visible(accuracy, of_meshes, quantity, result)
    rtol = float(np.clip(0.2 * target / gain, FINEST, 1e-3))

    curved = bool(result.collocations)
    notes: tuple[str, ...] = ()
    if curved and quantity is not None and result.space.dimension <= FEW_GERMS:
        # few germs and laws that are not linear: rules converge where the chaos does, at less for a point
        # what the iteration leaves shows in the changes from rule to rule
        each = float(np.clip(0.03 * target, FINEST, 3e-3))
        by_rules = _by_rules(result, quantity, target, each)
        if by_rules is None:
            return _by_samples(result, quantity, accuracy, target, of_meshes, notes)
        return _with_errors(*by_rules, accuracy, of_meshes, notes)  # type: ignore[no-any-return]
    change_before, left, fall = np.nan, np.inf, SLOWEST
    stalled = False
    while True:
        chaos = enlarged(result, quantity, target)
        if curved:
            chaos = Chaos(order=result.chaos.order + 1, check_points=0)
        modes = len(chaos.indices) if chaos.indices is not None else 0
        if chaos.order > MOST_ORDER + (0 if curved else 12) or modes > MOST_MODES:
            notes += (f"the chaos was not carried beyond order {result.chaos.order}, {result.modes} modes",)
            break
        before = None if quantity is None else moments(result, quantity)
        old = result
        try:
            result = carry_on(result, chaos, rtol)
        except IndefiniteError as error:
            old.resume()
            result = old
            notes += (f"the chaos cannot grow: {str(error).splitlines()[0]}",)
            break
        if result.status == "interrupted":
            notes += ("interrupted",)
            break
        if quantity is None or before is None:
            change = distance_of(result, old)
        else:
            change = change_of(before, moments(result, quantity), rtol)
        if isfinite(change_before) and change_before > 0.0:
            fall = min(change / change_before, SLOWEST)
            stalled = curved and change > STALLED * change_before and change > target
        else:
            fall = float(np.clip(_decay(result, quantity), UNKNOWN, SLOWEST))
        left = change * fall / (1.0 - fall)
        change_before = change
        if left <= 0.5 * target or stalled:
            break
    if curved and result.status != "interrupted" and (stalled or left > 0.5 * target):
        return _by_samples(result, quantity, accuracy, target, of_meshes, notes)
    made = _errors_of_chaos(result, quantity, left, gain)
    if curved and result.status != "interrupted":
        share = checked(result, quantity)
        made = replace(made, truncation=share)
        if made.relative("truncation") > target and quantity is not None:
            return _by_samples(result, quantity, accuracy, target, of_meshes, notes)
    return _with_errors(result, made, accuracy, of_meshes, notes)  # type: ignore[no-any-return]


def _mean_over_spread(result: ChaosResult) -> float:
    """Size of the whole field over that of its deviation."""
    sizes = sizes_of(result, None)[0]
    spread = float(np.sum(sizes[1:] ** 2))
    return float(np.sqrt((1.0 + spread) / spread)) if spread > 1e-6 else 1.0


def _decay(result: ChaosResult, quantity: Resultant | None) -> float:
    """Fall of the modes from the last degree but one to the last."""
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
    value = moments(result, quantity)
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
    before: Moments | None = None
    changes: list[float] = []
    for points in RULES:
        rule = result.space.tensor_gauss(points)
        if len(rule.points) > MOST_SAMPLES:
            return None
        samples = result.sample(rule.points, rule.weights, "quadrature", rtol=rtol)
        value = moments(samples, quantity)
        if before is not None:
            changes.append(change_of(before, value, rtol))
            # earlier changes count, too, and the fall of all
            change = max(c * FORGOTTEN**k for k, c in enumerate(reversed(changes)))
            fall = SUREST
            if len(changes) > 1 and changes[0] > 0.0:
                mean = (changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1))
                fall = float(np.clip(mean, SUREST, SLOWEST))
            left = change * fall / (1.0 - fall)
            if len(changes) > 1 and left <= 0.5 * target:
                whole = whole_of(value, rtol)
                error = float(np.nanmax(samples.error))
                how = f"the change by the last of {points} points a germ, carried on"
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
                    made, next_halving=f"{more} points a germ, {count} solves, about {seconds:.2g} s"
                )
        before = value
    return None


def _by_samples(
    result: ChaosResult,
    quantity: Resultant | None,
    accuracy: float,
    target: float,
    of_meshes: ErrorShare | None,
    notes: tuple[str, ...],
) -> Result | SampleResult:
    """Quasi-Monte Carlo on the solver of a chaos that converges too slowly."""
    if quantity is None:
        made = _errors_of_chaos(result, None, checked(result, None).energy, 1.0)
        return _with_errors(result, made, accuracy, of_meshes, notes)  # type: ignore[no-any-return]
    notes += (
        "chaos and Gauss rules converge slowly (a law is not linear): quasi-Monte Carlo on the same solver",
    )
    each = 32
    while True:
        parts = [result.space.sample_sobol(each, seed) for seed in range(REPLICATES)]
        samples = result.sample(np.concatenate(parts), kind="qmc")
        made = errors_of_samples(samples, quantity)
        total = each * REPLICATES
        if made.relative("truncation") <= 0.7 * target:
            break
        # errors of scrambled points fall like 1 / N at best, more slowly where there are kinks
        factor = 2 ** max(1, min(3, round(log2(made.relative("truncation") / (0.5 * target)))))
        if total * factor > MOST_SAMPLES:
            notes += (f"{total} samples: more are left to you, see quasi_monte_carlo",)
            break
        each *= factor
    return _with_errors(samples, made, accuracy, of_meshes, notes)  # type: ignore[no-any-return]
