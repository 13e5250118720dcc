"""How wrong an answer is: the error of its iteration, of its chaos, of its meshes.

Each is measured in the energy norm and in a quantity of interest by computing a little more and comparing:
the iteration is carried on until its error is ten times smaller, the chaos gets its next modes. Both use the
factorisation of the answer and start from its state.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from math import ceil, isfinite, log
from operator import add
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.ranks import agreement, exchanged, together
from dolfinx_frontend.common.arrays import Array, largest_of
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.interrupts import Interrupted, late
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.estimate.equilibrated import energy_bound
from dolfinx_frontend.estimate.mesh_error import DiscretisationError, discretisation_error, with_dual
from dolfinx_frontend.estimate.unseen import walls_not_seen
from dolfinx_frontend.evaluate.evaluator import complete
from dolfinx_frontend.plan.cost import shown
from dolfinx_frontend.results.accuracy import remedy
from dolfinx_frontend.results.answer import AnswerKind
from dolfinx_frontend.results.chaos import ChaosResult
from dolfinx_frontend.results.errors import EnergyBound, Errors, Kind, Source
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, Resultant, Wanted, interest
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.solvers.galerkin import IndefiniteError, carry_on
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.statistics import (
    Compared,
    ErrorShare,
    MeanStd,
    of_iteration,
    share_of,
    size_of,
    whole_of,
)

__all__ = [
    "DIGIT",
    "FINEST",
    "INTERRUPTED",
    "LATE",
    "change_of",
    "compared_with",
    "distance",
    "enlarged",
    "error_of_meshes",
    "errors",
    "errors_of_samples",
    "beside_what_acts",
    "by_solves",
    "next_halving",
    "of_direct",
    "not_known",
    "over_ranks",
    "sizes_of",
    "why_stopped",
]

_log = logging.getLogger(__name__)
Index = tuple[int, ...]

DIGIT = 0.1
"""Factor by which the tolerance is tightened to measure the error of the iteration."""

FINEST = 1e-12
"""Tightest tolerance of an iteration."""

DROPPED = 0.02
"""Predicted variance of modes that may be left out, relative to the accuracy of the moments. Moments change
with the square of such modes, and the prediction of a mode may be wrong by a factor of three."""

INTERRUPTED = "interrupted (Ctrl-C): its errors as far as they were measured by then"
LATE = "max_seconds has ended the search: its errors as far as they were measured by then"
UNKNOWN = 0.3
"""Assumed decay of the modes from one degree to the next where it cannot be measured."""

OF_POINTS = 1.5
"""Times its estimate that the error of a number at a point is taken for: no second mesh confirms it."""

REPLICATES = 4

ZERO = 1e-9
"""A total force or mean jump below this, relative to the same without signs, is rounding."""

CLOSED = 1e-12
"""The same of jumps that a law prescribes, without signs, relative to the displacements of the faces."""


# --- quantities -------------------------------------------------------------------------------------


def compared_with(quantity: Wanted | None, compared: Compared | None) -> Wanted | None:
    """The quantity whose errors are relative to something; None: as it says.

    Raises
    ------
    SceneError
        There is no quantity.
    """
    if compared is None or compared == Compared():
        return quantity
    if quantity is None:
        raise SceneError("absolute and relative_to go with a quantity, the energy norm has neither")
    return replace(quantity, compared=compared)


def beside_what_acts(
    result: Result, quantity: Wanted | None, below: float = ZERO, why: str = "is rounding"
) -> tuple[Wanted | None, tuple[str, ...]]:
    """The quantity, relative to what acts on its interface if beside that it is rounding; and a note."""
    if quantity is not None and quantity.compared.deviation and result.statistics != "value":
        value = result.mean_std(quantity)
        if (value.std or 0.0) < ZERO * abs(value.mean):
            least = max(quantity.compared.least, abs(value.mean))
            itself = replace(quantity, compared=replace(quantity.compared, deviation=False, least=least))
            return itself, ("the deviation is rounding beside the mean: errors are relative to the mean",)
    if not isinstance(quantity, Resultant) or quantity.compared.least > 0.0:
        return quantity, ()
    try:
        value = result.mean_std(quantity)
    except SceneError:
        return quantity, ()
    # ranks that do not have the interface know nothing of it
    whole = over_ranks(result, _without_signs(result, quantity), max)
    what = f"{quantity.of} of {whole:.3g} that the interface has without signs"
    name = quantity.interface
    if quantity.of == "jump" and name in result.plan.active and result.problem.interfaces[name].law.rigid:
        moved = over_ranks(result, _displaced(result, name), max)
        if whole < CLOSED * moved:  # closed everywhere: nothing of it is left but rounding
            whole, what = moved, f"displacement of {moved:.3g} that its faces have"
    if not max(abs(value.mean), value.std or 0.0) < below * whole:
        if quantity.compared.deviation or not abs(value.mean) < ZERO * (value.std or 0.0):
            return quantity, ()
        note = (
            f"the mean {value.mean:.1g} is rounding beside the deviation of {value.std:.3g}: errors are "
            "relative to the deviation, as with relative_to='deviation'; give absolute= to say what matters"
        )
        return replace(quantity, compared=replace(quantity.compared, deviation=True)), (note,)
    note = (
        f"the value {value.mean:.1g} {why} beside the {what}: errors are relative to that; give absolute= to "
        "say what matters"
    )
    return replace(quantity, compared=replace(quantity.compared, least=whole)), (note,)


def _without_signs(result: Result, quantity: Resultant) -> float:
    """Force or mean jump of an interface without signs, of all columns the largest; 0: not known."""
    try:
        field, weights = quantity.field(result), result.problem.interfaces[quantity.interface].weights
    except (SceneError, KeyError):
        return 0.0
    if field.ndim < 2 or field.shape[-2] != len(weights):
        return 0.0
    field = field.reshape(-1, *field.shape[-2:])
    whole = float((np.linalg.norm(field, axis=-1) @ weights).max())
    return whole if quantity.of == "force" else whole / float(weights.sum())


def _displaced(result: Result, interface: str) -> float:
    """The largest displacement of the faces of an interface, of all columns; 0: not here."""
    solver, state = result.solver, result.state
    if interface not in result.problem.own.interfaces or state is None:
        return 0.0
    size = len(solver.flexibility(interface))
    sides = [row for row in solver.first_rows(interface) if row >= 0]
    return max(float(np.abs(state.traces[row : row + size]).max(initial=0.0)) for row in sides)


def change_of(one: MeanStd, other: MeanStd, rtol: float, quantity: Wanted | None = None) -> float:
    """Relative change of mean and standard deviation, the larger."""
    change = share_of(one.mean - other.mean, size_of(other, quantity))
    whole = whole_of(other, rtol, quantity)
    if one.std is not None and other.std is not None and whole is not None:
        change = max(change, share_of(one.std - other.std, whole))
    return change


def over_ranks(result: Result, value: Any, join: Callable[[list[Any]], Any] | None = None) -> Any:
    """What the ranks have of something together: their sum, or what `join` makes of them; collective."""
    comm = result.problem.comm
    if comm is None:
        return value
    every = exchanged(comm, value)
    return reduce(add, every) if join is None else join(every)


def distance(one: ChaosResult, other: ChaosResult) -> float:
    """Relative difference of two chaoses with the same kernel in the energy norm, over all columns.

    The first may have modes that the second has not. Of parts whose stiffness varies the strain counts, too,
    part by part and relative to its own: where statics decides the forces, these do not change at all.
    """
    solver, steps = one.solver, one.steps
    data, traces = one.state.data.copy(), one.state.traces.copy()
    found = [one.basis.indices.find([int(i) for i in row]) for row in other.basis.indices.table]
    places = np.concatenate([np.arange(p * steps, (p + 1) * steps) for p in found if p is not None])
    data[:, places] -= other.state.data
    traces[:, places] -= other.state.traces
    forces = data - solver.directions[:, None] * traces
    square = float(over_ranks(one, np.sum(traces * solver.weights[:, None] * forces)))
    whole = float(np.sqrt(abs(square) / one.summary.energy)) if one.summary.energy > 0.0 else 0.0
    modes = [i for i in found if i is not None]
    strains = max((_of_strain(one, other, part, modes) for part in one.plan.varied), default=0.0)
    return max(whole, float(over_ranks(one, strains, max)))


def _of_strain(one: ChaosResult, other: ChaosResult, part: str, modes: Sequence[int]) -> float:
    """The same of the strains of a part, in the energy norm of its mean stiffness, on its rank; else 0."""
    if part not in one.problem.substructures:
        return 0.0
    stiffness = one.problem.substructures[part].matrix
    all_of_it = one.coefficients(part)
    change = all_of_it.copy()
    change[..., modes] -= other.coefficients(part)

    def energy(block: Array) -> float:
        columns = np.moveaxis(block, -2, 0).reshape(stiffness.shape[0], -1)
        return float(np.sum(columns * (stiffness @ columns)))

    size = energy(all_of_it)
    return float(np.sqrt(max(energy(change), 0.0) / size)) if size > 0.0 else 0.0


# --- more of the same -------------------------------------------------------------------------------
def _margin(table: npt.NDArray[np.int32], caps: Sequence[int]) -> list[Index]:
    """Indices outside of a set all of whose backward neighbours are in it."""
    inside = {tuple(int(i) for i in row) for row in table}
    found: dict[Index, None] = {}
    for index in inside:
        for germ in range(len(index)):
            new = (*index[:germ], index[germ] + 1, *index[germ + 1 :])
            if new in inside or new[germ] > caps[germ]:
                continue
            back = ((*new[:g], d - 1, *new[g + 1 :]) for g, d in enumerate(new) if d > 0)
            if all(b in inside for b in back):
                found[new] = None
    return sorted(found)


def sizes_of(result: ChaosResult, quantity: Wanted | None) -> tuple[Array, Array]:
    """(P + 1,) size of each mode in the quantity, and in the whole field, relative to the mean."""
    steps = result.steps
    metric = (result.solver.weights / result.solver.directions)[:, None]
    square = np.sum(metric * result.state.data**2, axis=0).reshape(-1, steps).sum(axis=1)
    square = over_ranks(result, square)
    of_field = np.sqrt(square / square[0]) if square[0] > 0.0 else np.sqrt(square)
    if not isinstance(quantity, Resultant) or quantity.interface in result.collocations:
        return of_field, of_field
    values = np.abs(result.resultant_coefficients(quantity))
    mean = values[0] if values[0] > 0.0 else max(float(values.max()), 1e-300)
    return values / mean, of_field


def enlarged(result: ChaosResult, quantity: Wanted | None, target: float = 0.0) -> Chaos:
    """The chaos with those of its next modes that are predicted to matter at an accuracy; 0: all of them."""
    table = result.basis.indices.table
    caps = [germ.capacity - 1 if germ.capacity is not None else 2**30 for germ in result.space.germs]
    names: list[Index] = [tuple(int(i) for i in row) for row in table]
    of_quantity, whole = sizes_of(result, quantity)
    sizes = {name: float(size) for name, size in zip(names, of_quantity, strict=True)}
    of_field = {name: float(size) for name, size in zip(names, whole, strict=True)}
    margin = _margin(table, caps)

    def predicted(index: Index) -> float:
        """Size of a mode by the decay along each germ: the largest of these guesses."""
        guesses = []
        for germ, degree in enumerate(index):
            if degree == 0:
                continue
            back = (*index[:germ], degree - 1, *index[germ + 1 :])
            fall = UNKNOWN  # along a germ of degree 1
            if degree > 1:
                before = (*index[:germ], degree - 2, *index[germ + 1 :])
                if any(before):
                    fall = min(sizes[back] / max(sizes[before], 1e-300), 1.0)
            guesses.append(sizes[back] * fall)
            # a germ may move a symmetric quantity in the second order only
            alone = tuple(int(g == germ) for g in range(len(index)))
            guesses.append(of_field[back] * of_field[alone])
        return max(guesses)

    ranked = sorted(((predicted(index), index) for index in margin), reverse=True)
    squares = np.array([size**2 for size, _ in ranked])
    variance = sum(size**2 for index, size in sizes.items() if any(index))
    # in the energy norm an error is the size of the modes that are left out, in moments its square
    allowed = variance * (DROPPED * target if quantity is not None else DROPPED * target**2)
    after = squares.sum() - np.cumsum(squares)  # variance of all that rank behind each
    count = min(int(np.searchsorted(-after, -allowed)) + 1, len(ranked)) if target else len(ranked)
    chosen = [index for _, index in ranked[:count]]
    indices = (*sizes, *chosen)
    order = max(sum(index) for index in indices)
    return replace(result.chaos, order=order, indices=indices)


# --- errors of a result -----------------------------------------------------------------------------
@overload
def errors(
    result: Result | SampleResult, quantity: Interest = None, kind: Literal["estimate"] = "estimate"
) -> Errors: ...


@overload
def errors(
    result: Result | SampleResult, quantity: Interest = None, *, kind: Literal["bound"]
) -> EnergyBound: ...


@together("errors")
def errors(
    result: Result | SampleResult, quantity: Interest = None, kind: Kind = "estimate"
) -> Errors | EnergyBound:
    """Estimate the errors of a result by their sources, or prove what that of its meshes is at most.

    Parameters
    ----------
    result
        Of :func:`dolfinx_frontend.solve`, or samples.
    quantity
        A :class:`Resultant`, the name of an interface (its normal force), or ``"energy"``; None: what
        ``solve(accuracy=..., quantity=...)`` was asked for, or the energy norm.
    kind
        ``"bound"``: of deterministic answers on triangles and tetrahedra of degree 1 and 2, the energy of the
        error at most, by a stress in balance; it says of what it is an estimate only.

    The iteration is carried on until its error is ten times smaller, and a chaos is solved again with its
    next modes. Both start from the answer, which takes about half as long as the run without its
    factorisation. The result stays as it is.

    Ctrl-C ends the measurement: what it has not reached is NaN then, and a note says so.
    """
    if getattr(result, "kind", None) not in _BY_KIND:
        raise SceneError(f"errors: result = {short(result)}; give a result of solve, or samples")
    check_known("kind", kind, ("estimate", "bound"), "errors")
    result.problem.check_alike("errors", quantity=quantity, kind=kind)
    if kind == "bound":
        if interest(result.problem.interfaces, quantity) is not None:
            raise SceneError("errors: kind='bound' is of the energy: leave the quantity out")
        return energy_bound(result)
    if quantity is None and result.found is not None:
        return result.found
    with agreement(result.problem.comm):
        result.problem.check_sources()
    with Bar(1, "errors", "answer", result.problem.rank == 0):
        return _BY_KIND[result.kind](result, interest(result.problem.interfaces, quantity))


def _errors_of_run(
    result: Result,
    quantity: Wanted | None,
    truncation: Callable[[Any, Wanted | None], ErrorShare] | None = None,
) -> Errors:
    """Errors of a run with fields; `truncation` measures that of its chaos, from the tightened run."""
    made = replace(not_known(result, quantity), notes=lost_variance(result))
    try:
        if result.plan.active:
            tight = result.tightened(max(DIGIT * min(result.plan.options.rtol, result.error), FINEST))
            made = replace(made, algebraic=_algebraic(result, tight, quantity, made.moments))
            if truncation is not None:
                made = replace(made, truncation=truncation(tight, quantity))
        else:
            made = replace(made, algebraic=of_direct(result, made.moments), whole=None)
        made = replace(made, discretisation=error_of_meshes(result, quantity))
    except Interrupted:
        return replace(made, notes=(*made.notes, why_stopped()))
    return replace(made, next_halving=next_halving(result, made))


def why_stopped() -> str:
    """The note of a search that was ended: by Ctrl-C, or by its budget of time."""
    return LATE if late() else INTERRUPTED


def lost_variance(result: Result | SampleResult, counted: bool = False) -> tuple[str, ...]:
    """What the modes of random fields leave out: in no error but that of the field, where it is counted."""
    random = getattr(result, "random", None)  # a deterministic answer has none
    told = "which the error of the field above counts" if counted else "which is in no error above"
    return tuple(
        f"random field {name!r}: its modes lose {100.0 * share:.3g} % of its variance, {told}"
        for name, share in (random.lost if random is not None else {}).items()
    )


def of_direct(result: Result, value: MeanStd | None) -> ErrorShare:
    """The algebraic error of a direct solution: what its corrections have left."""
    error = max(result.error, FINEST)
    return ErrorShare(error, None if value is None else error * abs(value.mean), how="direct solve")


def not_known(result: Result, quantity: Wanted | None) -> Errors:
    """The errors of a result of which nothing is measured."""
    value = None if quantity is None else result.mean_std(quantity)
    nan = None if value is None else np.nan
    of_std = None if value is None or value.std is None else np.nan
    algebraic = ErrorShare(result.error, nan, of_std, "its estimate; not measured")
    truncation = None
    if result.statistics != "value":
        truncation = ErrorShare(np.nan, nan, of_std, "not measured")
    whole = None if value is None else whole_of(value, result.plan.options.rtol, quantity)
    return Errors(algebraic, truncation, None, quantity, value, whole)


def _algebraic(
    result: Result, tight: Result, quantity: Wanted | None, value: MeanStd | None
) -> ErrorShare:
    """The error of the iteration, from the run with the tighter tolerance."""
    complete(tight)
    how = "the iteration carried on to a tenth of its error"
    if quantity is None or value is None:
        return ErrorShare(result.error, how=how)
    after = tight.mean_std(quantity)
    return ErrorShare(result.error, abs(after.mean - value.mean), _difference(after.std, value.std), how)


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else abs(one - other)


def _truncation(result: ChaosResult, quantity: Wanted | None) -> ErrorShare:
    """The error of a chaos, from a larger one."""
    if result.collocations:
        return by_solves(result, quantity)
    try:
        wider = carry_on(result, enlarged(result, quantity), result.plan.options.rtol)
    except IndefiniteError as error:
        return ErrorShare(np.nan, how=f"not known: {str(error).splitlines()[0]}")
    complete(wider)
    found = ErrorShare(distance(wider, result), how=f"the next {wider.modes - result.modes} modes")
    if quantity is None:
        return found
    before, after = result.mean_std(quantity), wider.mean_std(quantity)
    of_std = _difference(after.std, before.std)
    return replace(found, quantity=abs(after.mean - before.mean), std=of_std)


def by_solves(result: ChaosResult, quantity: Wanted | None) -> ErrorShare:
    """The error of a chaos of a nonlinear law, by deterministic solves.

    The chaos is their control variate: moments are corrected by mean and variance of the difference, and two
    standard errors are added.
    """
    count = max(result.chaos.check_points, 32)
    truth = result.sample(result.space.sample(count, 1))
    complete(truth)
    names = (quantity.interface,) if isinstance(quantity, Resultant) else result.plan.active
    problem = result.problem
    here = [name for name in names if problem.speaks_for(name)]
    with agreement(problem.comm):
        compared = {name: result.compared(name, [truth]).error for name in here}
    error = max(problem.gather(compared).values())
    how = f"{count} deterministic solves"
    if quantity is None:
        return ErrorShare(error, how=how)
    value = result.mean_std(quantity)
    exact, own = (quantity.at_end(result, fields) for fields in (truth, result.at(truth.germs)))
    shift = exact - own
    margin = 2.0 * shift.std(ddof=1) / np.sqrt(count)
    better = value.mean + shift.mean()
    spread = (exact - better) ** 2 - (own - value.mean) ** 2
    more = 2.0 * spread.std(ddof=1) / np.sqrt(count)
    assert value.std is not None  # of a chaos
    ends = [np.sqrt(max(value.std**2 + spread.mean() + s * more, 0.0)) for s in (-1.0, 0.0, 1.0)]
    away = max(abs(end - value.std) for end in ends)
    return ErrorShare(error, float(abs(shift.mean()) + margin), float(away), how)


def errors_of_samples(result: SampleResult, quantity: Wanted | None) -> Errors:
    """Errors of samples, from the differences between consecutive parts of the sample."""
    error = largest_of(result.error)
    if quantity is None:
        raise SceneError("errors of samples: name a quantity, e.g. the interface of a Resultant")
    if result.weights is not None:
        raise SceneError(
            "one quadrature does not tell its error: compare it with one of more points, or let "
            "solve(accuracy=...) do so"
        )
    values = quantity.at_end(result, result)
    value = result.mean_std(quantity)
    spread = np.array(
        [[p.mean(), p.std()] for p in np.array_split(values, REPLICATES)]
    ).std(axis=0, ddof=1)
    mean, std = 2.0 * spread / np.sqrt(REPLICATES)
    rtol = result.plan.options.rtol
    truncation = ErrorShare(np.nan, float(mean), float(std), f"{REPLICATES} parts of {len(values)} samples")
    whole = whole_of(value, rtol, quantity)
    made = Errors(of_iteration(error, value), truncation, None, quantity, value, whole)
    seconds = sum(result.seconds.values())
    halving = f"{2 * len(values)} Sobol samples, about {2 * seconds:.2g} s"
    return replace(made, next_halving=halving, notes=lost_variance(result))


def error_of_meshes(result: Result, quantity: Wanted | None) -> ErrorShare | None:
    """The error of the meshes, where it can be estimated."""
    try:
        # of a function there is no dual problem: the energy has to do
        weighted = with_dual(result.problem, quantity) is not None
        found = discretisation_error(result, quantity if weighted else None)
    except SceneError as error:
        _log.info("no estimate of the discretisation error: %s", error)
        if not (result.problem.spread or walls_not_seen(result.problem)):
            return None
        unknown = None if quantity is None else np.nan
        return ErrorShare(np.nan, unknown, None, f"not known: {str(error).splitlines()[0]}")
    if found.quantity is not None and not isinstance(quantity, Resultant):
        found = replace(found, quantity=OF_POINTS * found.quantity)
    if found.quantity is None:
        return ErrorShare(found.energy + found.unseen, None, None, _how_of_meshes(found))
    return ErrorShare(found.energy, found.quantity + found.unseen, None, _how_of_meshes(found))


def _how_of_meshes(found: DiscretisationError) -> str:
    """How it was estimated, and of what most of it is."""
    size = found.energy if found.quantity is None else found.quantity
    if sum(found.round.values()) > max(size, sum(found.means.values())):
        return f"cells on round faces of {max(found.round, key=lambda n: found.round[n])}"
    if sum(found.means.values()) > size:
        return f"springs that hold means of {max(found.means, key=lambda n: found.means[n])}"
    return "recovered stresses"


def next_halving(result: Result, made: Errors) -> str:
    """What would halve the dominating error, and its cost by the model of the plan."""
    return _HALVINGS[made.dominating](result, made)


def _iteration_cost(result: Result) -> tuple[float, float]:
    """Operations of one iteration on all ranks, by the model of the plan, and the seconds that it took."""
    cost, summary = result.plan.cost, result.summary
    spent = max(summary.global_s + summary.local_s + summary.check_s + summary.other_s, 1e-6)
    seconds = float(over_ranks(result, spent / max(result.iterations, 1), max))
    return float(over_ranks(result, cost.iteration_flops if cost is not None else 0.0)), seconds


def _smaller_tolerance(result: Result, made: Errors) -> str:
    flops, seconds = _iteration_cost(result)
    count = _iterations_for(result, 0.5)
    if count is None:
        laws = [each.law for each in result.problem.interfaces.values()]
        advice = remedy(result.status, laws=laws)
        advice = advice or "nothing of its run says how many iterations it would take"
        return f"the error does not fall any more ({result.status}): {advice}"
    return (
        f"rtol = {0.5 * result.plan.options.rtol:.1e}: about {count} more iterations, "
        f"{shown(count * flops, 'Flop')}, {count * seconds:.2g} s"
    )


def _more_modes(result: ChaosResult, made: Errors) -> str:
    flops, seconds = _iteration_cost(result)
    wider = enlarged(result, made.quantity, made.asked or 0.0)
    assert wider.indices is not None
    count = ceil(0.5 * result.iterations)
    factor = len(wider.indices) / result.modes
    return (
        f"{len(wider.indices)} instead of {result.modes} modes: about {count} iterations, "
        f"{shown(count * factor * flops, 'Flop')}, {count * factor * seconds:.2g} s"
    )


def _smaller_cells(result: Result, made: Errors) -> str:
    cost = result.plan.cost
    # a rank may have no part
    meshed = [part for part in result.problem.substructures.values() if has_mesh(part)]
    degrees = [part.V.ufl_element().degree for part in meshed] or [1]
    degree = min(over_ranks(result, degrees))
    finer = 2.0 ** (-1.0 / degree)
    factor = finer ** (-2.0 * result.problem.dim)
    more = factor * float(over_ranks(result, cost.factor_flops if cost is not None else 0.0))
    seconds = factor * float(over_ranks(result, sum(result.seconds.values()), max))
    return (
        f"cells of {finer:.2g} times the size: {finer ** -result.problem.dim:.1f} times the unknowns, "
        f"{shown(more, 'Flop')} to factorise, about {seconds:.2g} s"
    )


def _iterations_for(result: Result, fall: float) -> int | None:
    """Iterations until the error has fallen by a factor, at the rate of the last half of the run; None: it
    does not fall, or what is known of it says nothing."""
    if result.status not in ("converged", "max_iterations"):
        return None
    record = [(i.number, i.error) for i in result.summary.history if isfinite(i.error) and i.error > 0.0]
    if len(record) < 2:
        return 1 if result.converged else None
    (first, before), (last, now) = record[len(record) // 2 - 1], record[-1]
    if now >= before:
        return None
    return max(1, ceil(-log(fall) * (last - first) / log(before / now)))


_HALVINGS: Mapping[Source, Callable[[Any, Errors], str]] = {
    "algebraic": _smaller_tolerance,
    "truncation": _more_modes,  # which only a chaos has among the runs
    "field": lambda result, made: "more modes of the fields: RandomField(variance_captured=...)",
    "discretisation": _smaller_cells,
}


_BY_KIND: Mapping[AnswerKind, Callable[[Any, Wanted | None], Errors]] = {
    "deterministic": _errors_of_run,
    "history": _errors_of_run,
    "chaos": partial(_errors_of_run, truncation=_truncation),
    "samples": errors_of_samples,
}
