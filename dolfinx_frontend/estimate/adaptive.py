"""Answers of a given accuracy: errors are measured as in :mod:`dolfinx_frontend.estimate.errors` while the
computation goes on, which stops as soon as they are small enough."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite, log
from time import monotonic, perf_counter
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt
from latin_core import Options

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.checks import check_optional_kind, checked_flag, checked_number, is_real
from dolfinx_frontend.common.describe import short, shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.interrupts import Interrupt, Interrupted
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.estimate.errors import (
    DIGIT,
    INTERRUPTED,
    LATE,
    beside_what_acts,
    compared_with,
    lost_variance,
    UNKNOWN,
    by_solves,
    change_of,
    distance,
    enlarged,
    error_of_meshes,
    errors,
    next_halving,
    of_direct,
    not_known,
    over_ranks,
    sizes_of,
    why_stopped,
)
from dolfinx_frontend.evaluate.evaluator import complete
from dolfinx_frontend.evaluate.model import QuantityModel, errors_of, samples_of
from dolfinx_frontend.moments.fields import Lost, beside_fields, lost_of_fields
from dolfinx_frontend.moments.model import Moments
from dolfinx_frontend.moments.samples import by_samples
from dolfinx_frontend.moments.search import FEW_GERMS, endless, judges_of, moments_to, tails_of, tolerance_of
from dolfinx_frontend.moments.tails import Tail, beyond_all, note_of, seen_to
from dolfinx_frontend.moments.validation import Witnesses, misfit, witnesses
from dolfinx_frontend.plan.plan import Direction, Method, make_plan
from dolfinx_frontend.plan.price import Way, price
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import Errors
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, Measure, Resultant, Wanted, interest
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.solvers.deterministic import solve_once
from dolfinx_frontend.solvers.galerkin import IndefiniteError, NearlyIndefiniteWarning, carry_on, solve_chaos
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.statistics import (
    FINEST,
    NOISE,
    Compared,
    ErrorShare,
    of_iteration,
    share_of,
    size_of,
    whole_of,
)

__all__ = [
    "NOT_YET",
    "as_solved",
    "kept_for",
    "of_power",
    "solve_to_accuracy",
    "so_far",
    "tight_enough",
    "with_errors",
]

_log = logging.getLogger(__name__)

NOT_YET = ErrorShare(np.nan, np.nan, np.nan, "not measured")
"""An error that Ctrl-C came before."""

MOST_MODES = 2000

MOST_ORDER = 8
"""Highest order of an adaptive chaos: beyond it, samples are cheaper."""

STALLED = 0.6
"""A chaos does not converge if mean and deviation change by more than this times the change before."""

SLOWEST = 0.7
"""Largest factor by which errors are assumed to change from one set of modes to the next."""


STEPS = 6
"""Times that a chaos is enlarged by the next degree in every germ and compared with its witnesses."""

LEAST_POWER = 0.5
"""Power of the degree with which the error of a chaos falls at least."""

EIGENVECTORS = 3e-9
"""Seconds that the eigenvectors of a matrix of n rows take, over n^3."""

RESOLVED = 0.3
"""Tolerance of a chaos whose deviation is small, relative to one that would make noise of it."""


LOOSE_FIRST = 0.1
"""Tolerance of a first chaos that only says by how much about a quantity scatters."""

MOST_INSTEAD = 1024
"""Points at most that are tried before a chaos whose modes random fields couple."""


PRICE = 1024
"""Points that a chaos may cost at most as much as."""


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
    known: ErrorShare | None = None,
    first: ChaosResult | None = None,
    compared: Compared | None = None,
    lost: Lost | None = None,
    max_seconds: float | None = None,
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
    known
        The error of the meshes, where it was measured before.
    first
        A chaos of order 1 of the problem, where there is one.
    compared
        What errors are relative to; None: as the quantity says.
    lost
        What the modes that random fields leave out do, where it was measured before.
    max_seconds
        Once anything is solved it ends then, as with Ctrl-C; None: no limit.

    Returns
    -------
    Result
        A :class:`ChaosResult` if something is random, or samples where its chaos does not converge.
        ``result.errors()`` has the errors, and says in its notes what could not be reached.

    Ctrl-C, once something is solved, ends it with what it has by then: samples or a chaos, whichever is known
    to be better, and the errors as far as they are known.
    """
    if not is_real(accuracy) or not 1e-10 <= accuracy <= 0.5:
        raise SceneError(f"accuracy = {short(accuracy)}: it must lie in 1e-10..0.5")
    check_optional_kind("solve", "options", options, Options, "give Options(rtol=...)")
    checked_flag("solve", "meshes", meshes)
    if max_seconds is not None:
        checked_number("solve", "max_seconds", max_seconds, above=0.0)
    began = monotonic()
    run = Interrupt(holds=False, alone=problem.comm is None)
    what = compared_with(interest(problem.interfaces, quantity), compared)
    of_one = None if what is None else what.interface
    options = options or (Options.plain() if method == "latin" else Options())
    options = options.with_(rtol=max(DIGIT * accuracy, FINEST))
    random = RandomLaws.of(problem)
    if random.every:
        if of_one is not None and active is None and of_one not in random.interfaces:
            active = [of_one]
        if not meshes and what is not None and not all(i.law.linear for i in problem.interfaces.values()):
            options = options.with_(rtol=max(options.rtol, LOOSE_FIRST))
        with run:
            first = first or solve_chaos(
                problem,
                Chaos(order=1, check_points=0),
                method,
                times=times,
                active=active,
                direction=direction,
                options=options,
                estimator=errors,
            )
            if known is not None:
                complete(first)  # a search for meshes has something better
            run.hold()
            if max_seconds is not None:
                run.limit(max_seconds - (monotonic() - began))
            return _Search(first, accuracy, what, known, lost).answer(meshes)
    plan = make_plan(problem, method, kept_for(what, method, active), (), direction, options, times=times)
    result = solve_once(problem, plan, estimator=errors)
    if max_seconds is not None:
        run.limit(max_seconds - (monotonic() - began))
    what, notes = beside_what_acts(result, what)
    return tight_enough(result, accuracy, what, meshes, known, notes, run)


def kept_for(
    quantity: Wanted | None, method: Method, active: Sequence[str] | Literal["all"] | None
) -> Sequence[str] | Literal["all"] | None:
    """What a plan is to keep: of an interface that is assembled across there are resultants only."""
    if active is not None or method == "latin" or not isinstance(quantity, Measure):
        return active
    return None if quantity.interface is None else [quantity.interface]


def tight_enough(
    result: Result,
    accuracy: float,
    quantity: Wanted | None,
    meshes: bool = True,
    known: ErrorShare | None = None,
    notes: tuple[str, ...] = (),
    run: Interrupt | None = None,
) -> Result:
    """A deterministic run carried on until its error is small enough; see :func:`solve_to_accuracy`. `run`:
    what holds Ctrl-C back; None: nothing yet."""
    of_meshes = known
    made = as_solved(result, quantity)
    if meshes and known is None:
        of_meshes = NOT_YET
    run = run or Interrupt(alone=result.problem.comm is None)
    run.hold()
    with run:
        try:
            complete(result)
            if meshes and known is None:
                of_meshes = error_of_meshes(result, quantity)
            target = _visible(accuracy, of_meshes, quantity, result)
            made = _settled(result, quantity)
            iterated = bool(result.plan.active)
            while iterated and made.relative("algebraic") > target and result.plan.options.rtol > FINEST:
                fall = min(0.5 * target / made.relative("algebraic"), DIGIT)
                tighter = result.tightened(max(result.plan.options.rtol * fall, FINEST))
                complete(tighter)
                result, made = tighter, as_solved(tighter, quantity)
                made = _settled(result, quantity)
        except Interrupted:
            notes += (why_stopped(),)
    return with_errors(result, made, accuracy, of_meshes, notes, partial(next_halving, result))


def as_solved(result: Result, quantity: Wanted | None) -> Errors:
    """What a run says of its own error, before anything is measured."""
    value = None if quantity is None else result.mean_std(quantity)
    return replace(not_known(result, quantity), algebraic=of_iteration(result.error, value))


def _visible(
    accuracy: float, of_meshes: ErrorShare | None, quantity: Wanted | None, result: Result
) -> float:
    """Target of the other errors: what the meshes leave of the accuracy; a tenth of their error at least."""
    if of_meshes is None:
        return accuracy
    relative = of_meshes.energy
    if quantity is not None and of_meshes.quantity is not None:
        relative = share_of(of_meshes.quantity, size_of(result.mean_std(quantity), quantity))
    if not isfinite(relative):
        return accuracy
    return min(max(0.1 * relative, accuracy - relative), 0.5)


def _settled(result: Result, quantity: Wanted | None) -> Errors:
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


def with_errors(
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
    if made.in_all > accuracy:
        notes += (f"the accuracy was not reached: {shown_error(made.in_all)} is left",)
    if halving is not None and not {INTERRUPTED, LATE} & set(notes):
        made = replace(made, next_halving=halving(made))
    for note in notes if result.problem.rank == 0 else ():
        _log.warning("%s", note)
    of_fields: tuple[str, ...] = lost_variance(result, made.field is not None)
    return result.with_notes(found=replace(made, notes=(*of_fields, *notes)))


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
    left
        What the chaos still leaves out, as far as it is known: relative.
    points
        The best ones so far, and their errors.
    """

    def __init__(
        self,
        first: ChaosResult,
        accuracy: float,
        quantity: Wanted | None,
        of_meshes: ErrorShare | None = None,
        lost: Lost | None = None,
    ) -> None:
        self.lost = lost
        self.result = first
        self.accuracy = self.target = accuracy
        self.quantity = quantity
        self.rtol = first.plan.options.rtol
        self.gain = 1.0
        self.left = np.nan
        self.points: tuple[SampleResult, Errors] | None = None
        self.of_meshes = of_meshes
        self.of_fields: ErrorShare | None = None
        self.seen: Witnesses | None = None
        self.tails: list[Tail] = []
        self.falls: list[float] = []
        self.per_point = np.inf
        self.notes: tuple[str, ...] = ()

    def answer(self, meshes: bool) -> ChaosResult | SampleResult:
        """The chaos, or samples where it does not converge; after Ctrl-C the better one of those that are
        finished."""
        unmeasured = meshes and self.of_meshes is None
        if unmeasured:
            self.of_meshes = NOT_YET
        try:
            return self._answer(unmeasured)
        except Interrupted:
            self.notes += (why_stopped(),)
            return self.so_far()

    def so_far(self) -> ChaosResult | SampleResult:
        """What is finished, with the errors as far as they are known."""
        made = self._known()
        if self.points is not None and not self.points[1].total > made.total:
            return self._of_points(*self.points)
        return self._found(made)

    def keep(self, found: Moments) -> None:
        """Points that are finished: fewer than there were before only if they are better."""
        best, (samples, made) = self.points, self._of_moments(found)
        if best is None or len(samples.germs) >= len(best[0].germs) or made.total <= best[1].total:
            self.points = samples, made

    @property
    def model(self) -> QuantityModel:
        """The quantity at points of the germs."""
        assert self.quantity is not None
        return QuantityModel.of_chaos(self.result, self.quantity)

    def _of_moments(self, found: Moments) -> tuple[SampleResult, Errors]:
        assert self.quantity is not None
        return samples_of(found), errors_of(found, self.quantity)

    def _known(self) -> Errors:
        """What is known of the errors of the chaos."""
        quantity = self.quantity
        made = as_solved(self.result, quantity)
        if isfinite(self.left):
            made = _errors_of_chaos(self.result, quantity, self.left, self.gain)
        made = replace(made, field=self.of_fields)
        if self.seen is None or not isinstance(quantity, Resultant):
            return made
        return self._with_witnesses(made, quantity, self.seen)

    def _answer(self, meshes: bool) -> ChaosResult | SampleResult:
        complete(self.result)
        coupled = self._coupled()
        if not coupled:
            self._calibrate()
        result, quantity = self.result, self.quantity
        if meshes:
            self.of_meshes = error_of_meshes(result, quantity)
        self.target = _visible(self.accuracy, self.of_meshes, quantity, result)
        self.rtol = self._tolerance()
        curved = bool(result.collocations)
        if quantity is not None:
            if not curved:
                self._resolve(quantity)
            self.quantity, notes = beside_what_acts(self.result, quantity)
            self.notes += notes
            quantity = self.quantity
            assert quantity is not None
            if notes:
                self.target = _visible(self.accuracy, self.of_meshes, quantity, self.result)
                self._calibrate()  # the gain is that of what errors are relative to
            self.of_fields = self._lost(quantity)
            self.target = beside_fields(self.target, self.lost)
            if coupled:
                found, _ = by_samples(self.model, self.target, self._each(), most=MOST_INSTEAD)
                samples, made = self._of_moments(found)
                if made.total <= self.target:
                    return self._of_points(samples, made)
                self._calibrate()
                self.rtol = self._tolerance()
            if not curved:
                self._look(quantity)
        if quantity is not None and self.seen is not None:
            self._look_far(quantity, self.seen)
        if quantity is not None and (curved or not isinstance(quantity, Resultant) or self._alone()):
            return self._by_points(quantity)
        left, stalled = self._grow(curved)
        if quantity is None:
            if curved and (stalled or left > 0.5 * self.target):
                return self._by_samples_of_energy()
            made = _errors_of_chaos(self.result, None, left, self.gain)
            if curved:
                made = replace(made, truncation=by_solves(self.result, None))
            return self._found(made)
        made = self._witnessed(quantity, left)
        if made.total > self.accuracy and made.relative("truncation") > 0.7 * self.target:
            self.notes += ("the chaos converges slowly: points on the same solver",)
            try:
                other = self._points_of(quantity)
            except SceneError as error:
                self.notes += (f"no points: {str(error).splitlines()[0]}",)
                return self._found(made)
            if not other[1].total >= made.total:
                return self._of_points(*other)
        return self._found(made)

    def _coupled(self) -> bool:
        """Whether random fields couple so many modes that some points may cost less."""
        result, linear = self.result, isinstance(self.quantity, Resultant) and not self.result.collocations
        return linear and bool(_points_of_fields(result.random)) and result.space.dimension > FEW_GERMS

    def _tolerance(self) -> float:
        """That a chaos needs."""
        return float(np.clip(0.2 * self.target / self.gain, FINEST, 1e-3))

    def _resolve(self, quantity: Wanted) -> None:
        """Tighten the tolerance until the deviation is more than the error of the iteration."""
        for _ in range(4):
            value = self.result.mean_std(quantity)
            rtol = _reached(self.result)
            if value.std is None:
                return
            if value.std > NOISE * rtol * abs(value.mean) or rtol <= 1e-11:
                if value.mean and value.std > NOISE * FINEST * abs(value.mean):
                    # larger chaoses must not make noise of it
                    least = RESOLVED * value.std / (NOISE * abs(value.mean))
                    self.rtol = max(min(self.rtol, least), FINEST)
                return
            if not isinstance(quantity, Resultant) or not value.std:
                return
            wanted = max(min(RESOLVED * value.std / (NOISE * abs(value.mean)), 0.01 * self.rtol), FINEST)
            self.rtol = wanted
            self._carry_on(self.result.chaos, wanted)

    def _lost(self, quantity: Wanted) -> ErrorShare | None:
        """What the modes that random fields leave out do."""
        if not self.result.random.of_fields:
            return None
        value = self.result.mean_std(quantity)
        full = self.model.full_fields() if self.lost is None else None
        if full is not None:
            self.lost = lost_of_fields(self.model, full, self._each(), value, self.target)
        if self.lost is None:
            return None
        mean = self.lost.mean * size_of(value, quantity)
        std = self.lost.std * max(value.std or 0.0, quantity.compared.least)
        return ErrorShare(np.nan, mean, std, f"samples of all modes of {self.lost.of}")

    def _each(self) -> float:
        """Tolerance of single points."""
        assert self.quantity is not None
        return tolerance_of(self.model, self.target, self.result.mean_std(self.quantity))

    def _look(self, quantity: Wanted) -> None:
        """Solve the witnesses, which tells what a point costs, too."""
        began = perf_counter()
        try:
            self.seen = witnesses(self.model, self._each())
        except SceneError as error:
            self.notes += (f"no witnesses: {str(error).splitlines()[0]}",)
            return
        seconds = (perf_counter() - began) / len(self.seen.points)
        self.per_point = float(over_ranks(self.result, seconds, max))  # on which all ranks decide alike

    def _witnessed(self, quantity: Wanted, left: float) -> Errors:
        """The chaos enlarged by the next degree in every germ, once at least, until that changes little and
        witnesses that are solved on their own agree with it."""
        change_before, fall = np.nan, max(self.falls[-2:], default=SLOWEST)
        for step in range(STEPS):
            made = replace(_errors_of_chaos(self.result, quantity, left, self.gain), field=self.of_fields)
            seen = self.seen
            if seen is None:
                return made
            made = self._with_witnesses(made, quantity, seen)
            if step and (made.relative("truncation") <= 0.7 * self.target or step == STEPS - 1):
                return made
            chaos = self._wider()
            if chaos is None:
                return made
            before = self.result.mean_std(quantity)
            try:
                self._carry_on(chaos, self.rtol)
            except SceneError as error:
                self.notes += (f"the chaos cannot grow: {str(error).splitlines()[0]}",)
                return made
            change = change_of(before, self.result.mean_std(quantity), _reached(self.result), quantity)
            if isfinite(change_before) and change_before > 0.0:
                fall = change / change_before
            self.left = left = change * of_power(fall, chaos.order)
            change_before = change
        raise AssertionError

    def _with_witnesses(self, made: Errors, quantity: Wanted, seen: Witnesses) -> Errors:
        """The errors of the chaos, of which witnesses may know more."""
        fields = self.result.at(seen.points)
        value = self.result.mean_std(quantity)
        found = misfit(seen, quantity.at_end(self.result, fields), value)
        tails = beyond_all(self.tails, seen_to(self.tails, self.result.space, seen.points), value)
        assert made.truncation is not None
        # what is not known of the modes is left to the points
        of_mean = float(np.fmax(made.truncation.quantity or 0.0, found.mean)) + tails.mean
        of_std = float(np.fmax(made.truncation.std or 0.0, found.std)) + (tails.std or 0.0)
        how = f"the change by the last modes, and {len(seen.points)} points solved on their own"
        return replace(made, truncation=ErrorShare(np.nan, of_mean, of_std, how))

    def _wider(self) -> Chaos | None:
        """The chaos with the modes that an accuracy ten times tighter would want, and the next degree in
        every germ; None: that would be too large."""
        result = self.result
        whole = enlarged(result, self.quantity, 0.0)
        assert whole.indices is not None
        if len(whole.indices) > 1.5 * result.modes + 30:
            chosen = enlarged(result, self.quantity, 0.1 * self.target)
            pure = [i for i in whole.indices[result.modes :] if sum(d > 0 for d in i) == 1]
            assert chosen.indices is not None
            indices = tuple(dict.fromkeys([*chosen.indices, *pure]))
            whole = replace(whole, indices=indices, order=max(sum(i) for i in indices))
        assert whole.indices is not None
        if whole.order > MOST_ORDER + 16 or not self._affordable(len(whole.indices)):
            self.notes += (f"the chaos was not carried beyond {result.modes} modes",)
            return None
        return whole

    def _affordable(self, modes: int) -> bool:
        """Whether a chaos of so many modes is in reach of time and memory."""
        result, rows = self.result, _points_of_fields(self.result.random)
        plan, way = result.plan, Way(result.random, modes, result.chaos.order)
        wanted = price(
            result.problem, plan.active, result.solver.rows, plan.options, way, result.steps, bool(plan.macro)
        )
        share = over_ranks(result, wanted.memory / available_memory(), max)
        if modes > MOST_MODES or share > 1.0:
            return False
        return rows * modes**3 * EIGENVECTORS <= 1.0 + PRICE * self.per_point

    def _alone(self) -> bool:
        """Whether there are tails for which pieces of the single germ do, or nothing does."""
        return bool(self.tails) and (self.result.space.dimension == 1 or endless(self.tails))

    def _by_points(self, quantity: Wanted) -> SampleResult:
        return self._of_points(*self._points_of(quantity))

    def _of_points(self, samples: SampleResult, made: Errors) -> SampleResult:
        made = replace(made, field=self.of_fields)
        return with_errors(samples, made, self.accuracy, self.of_meshes, self.notes)

    def _points_of(self, quantity: Wanted) -> tuple[SampleResult, Errors]:
        """Solved points instead of a chaos."""
        model, about, target = self.model, self.result.mean_std(quantity), self.target
        judges = self.seen
        if judges is None:
            judges = judges_of(model, about, target)
            if judges is not None:
                self._look_far(quantity, judges)
        limits = self.accuracy, target
        found, notes = moments_to(model, about, *limits, self.seen, judges, self.tails, self.keep)
        self.notes += notes
        return self._of_moments(found)

    def _look_far(self, quantity: Wanted, seen: Witnesses) -> None:
        """Find the tails that matter, and say what they mean."""
        self.tails = tails_of(self.model, self.result.mean_std(quantity), seen, self.target, self.rtol)
        note = note_of(self.tails, quantity, self.result.space.germ_names)
        self.notes += (note,) if note else ()

    def _found(self, made: Errors) -> ChaosResult:
        halving = partial(next_halving, self.result)
        return with_errors(self.result, made, self.accuracy, self.of_meshes, self.notes, halving)

    def _carry_on(self, chaos: Chaos, rtol: float) -> None:
        with warnings.catch_warnings():  # of orders that are tried, and judged by their errors
            warnings.simplefilter("ignore", NearlyIndefiniteWarning)
            found = carry_on(self.result, chaos, rtol)
        complete(found)
        self.result, self.left = found, np.nan

    def _calibrate(self) -> None:
        """Measure, on the first and cheapest chaos, how much worse the quantity is than the energy norm."""
        result, quantity, rtol = self.result, self.quantity, self.rtol
        loose = result.error
        if quantity is not None and (result.collocations or not isinstance(quantity, Resultant)):
            return  # an answer by points
        before = None if quantity is None else result.mean_std(quantity)
        self._carry_on(result.chaos, max(DIGIT * min(rtol, loose), FINEST))
        if quantity is not None and before is not None and loose > 0.0:
            change = change_of(before, self.result.mean_std(quantity), rtol, quantity)
            self.gain = max(change / loose, _mean_over_spread(self.result))

    def _grow(self, curved: bool) -> tuple[float, bool]:
        """Enlarge the chaos. Returns what it still leaves out, and whether it has stopped converging."""
        quantity, target = self.quantity, self.target
        change_before, left, fall = np.nan, np.inf, SLOWEST
        stalled = False
        while not stalled and left > (0.5 if quantity is None else 1.0) * target:
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
                change = change_of(before, self.result.mean_std(quantity), self.rtol, quantity)
            if isfinite(change_before) and change_before > 0.0:
                fall = min(change / change_before, SLOWEST)
                stalled = curved and change > STALLED * change_before and change > target
            else:
                fall = float(np.clip(_decay(self.result, quantity), UNKNOWN, SLOWEST))
            self.left = left = change * fall / (1.0 - fall)
            change_before = change
            self.falls.append(fall)
        return left, stalled

    def _next(self, curved: bool) -> Chaos | None:
        """The next larger chaos; None: that would be too large."""
        result = self.result
        chaos = enlarged(result, self.quantity, self.target)
        if curved:
            chaos = Chaos(order=result.chaos.order + 1, check_points=0)
        modes = len(chaos.indices) if chaos.indices is not None else 0
        if chaos.order > MOST_ORDER + (0 if curved else 12) or not self._affordable(modes):
            self.notes += (
                f"the chaos was not carried beyond order {result.chaos.order}, {result.modes} modes",
            )
            return None
        return chaos

    def _by_samples_of_energy(self) -> ChaosResult:
        """A chaos that converges too slowly, of which no quantity is asked."""
        left = by_solves(self.result, None).energy
        return self._found(_errors_of_chaos(self.result, None, left, 1.0))


def so_far(chaos: ChaosResult, accuracy: float, quantity: Wanted | None, known: ErrorShare) -> ChaosResult:
    """A chaos that nothing has measured yet, as an answer; `known`: the error of its meshes."""
    search = _Search(chaos, accuracy, quantity, known)
    search.notes = (why_stopped(),)
    found = search.so_far()
    assert isinstance(found, ChaosResult)
    return found


def of_power(fall: float, order: int) -> float:
    """What the degrees above `order` still change, relative to the change by that one, which was `fall` times
    the change before: at least as much.

    Falls get slower with the degree where a quantity is nearly singular (the inverse of a sum of gamma
    variables): changes like n^-(p + 1) leave n / p times the last one.
    """
    order = max(order, 2)  # a law of two values has no degree 2
    power = -log(min(max(fall, 1e-12), 1.0)) / log(order / (order - 1.0)) - 1.0
    return max(order / max(power, LEAST_POWER), 1.0)


def _reached(result: Result) -> float:
    """Error that the iteration has reached, or its tolerance."""
    rtol = result.plan.options.rtol
    return max(min(rtol, result.error), 1e-13) if isfinite(result.error) else rtol


def _points_of_fields(random: RandomLaws) -> int:
    """Points of random fields, each of which has a Galerkin matrix of its own."""
    fields = {id(s): s for s in random.sources.values() if isinstance(s, DiscretisedField)}
    return sum(len(each.points) for each in fields.values())


def _mean_over_spread(result: ChaosResult) -> float:
    """Size of the whole field over that of its deviation."""
    sizes = sizes_of(result, None)[0]
    spread = float(np.sum(sizes[1:] ** 2))
    return float(np.sqrt((1.0 + spread) / spread)) if spread > 1e-6 else 1.0


def _decay(result: ChaosResult, quantity: Wanted | None) -> float:
    """Size of the modes of the last degree, relative to those of the last but one."""
    sizes, _ = sizes_of(result, quantity)
    degree = result.basis.indices.table.sum(axis=1)
    last = int(degree.max())
    if last < 2:
        return SLOWEST
    above, below = (float(np.sqrt(np.sum(sizes[degree == d] ** 2))) for d in (last, last - 1))
    return above / below if below > 0.0 else SLOWEST


def _errors_of_chaos(
    result: ChaosResult, quantity: Wanted | None, left: float, gain: float
) -> Errors:
    """Errors that an adaptive run has found on its way."""
    algebraic = ErrorShare(result.error, how="its estimate")
    how = "the change by the last modes, carried on"
    if quantity is None:
        return Errors(algebraic, ErrorShare(left, how=how), None, None, None)
    value = result.mean_std(quantity)
    whole = whole_of(value, _reached(result), quantity)
    assert whole is not None  # of a chaos
    size = gain * result.error
    of_std = size * (whole_of(value, _reached(result)) or 0.0)
    algebraic = ErrorShare(
        result.error, size * abs(value.mean), of_std, f"its estimate times {gain:.2g}, as at order 1"
    )
    truncation = ErrorShare(np.nan, left * size_of(value, quantity), left * whole, how)
    return Errors(algebraic, truncation, None, quantity, value, whole)
