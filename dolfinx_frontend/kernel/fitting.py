"""Solvers without a factor of the parts: the basis of their bodies grows until a run of linear laws, or every
point of a walk, is answered."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import NamedTuple, Unpack

import numpy as np
from latin_core import (
    Iteration,
    Laws,
    NumericalError,
    Options,
    State,
    SweepPoints,
    SweptParameter,
)
from latin_core.points import Solved

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, meeting_often
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.common.threads import alone
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.fingerprint import fingerprint
from dolfinx_frontend.kernel.rows import Rows
from dolfinx_frontend.kernel.running import FOLDER
from dolfinx_frontend.kernel.solver import OfWalk, Solver, locked
from dolfinx_frontend.kernel.spread import PointRanks, agreed_over
from dolfinx_frontend.kernel.subspace import Answer, Bodies, Subspace
from dolfinx_frontend.plan.plan import Plan

__all__ = ["SHARE", "fitted", "sloped", "solver_of", "walked"]

_log = logging.getLogger(__name__)

SHARE = 0.5
"""Of the tolerance for what the basis leaves; the iteration has the rest."""

ROUNDS = 200
"""Blocks of fields at most."""

FIRST = 20
"""Rounds after which their rate is believed: the first ones may find little."""

NEGLIGIBLE = 0.05
"""Share of the squared residual that one round may leave to later ones."""

FAINT = 1e-9
"""A fluctuation that is so small beside the mean is measured with it."""

FAR, EVEN = 8, 8
"""Points that a basis is made for first: such that are far from each other, and such of a fair choice."""

ADDED = 64
"""Fields at most that one walk over points adds."""

EXACT = 1e-5
"""Answers of several points are combinations of fewer, to this share of the tolerance."""

OF_SPRINGS = 1e-3
"""Share of the energy of springs between bodies that errors of points are relative to: soft ones would hide
the strain of the bodies."""

RANGE = 1e3
"""Springs of the multigrid are at most so many times softer than the stiffest that are swept."""

ALIKE = 4.0
"""Springs of a multigrid serve points whose springs are so many times softer, not more."""


def _check(problem: Problem, plan: Plan) -> None:
    """Refuse what a basis cannot answer.

    Raises
    ------
    SceneError
        A law is nonlinear.
    """
    for name in plan.active:
        if not problem.interfaces[name].law.superposes:
            raise SceneError(
                f"interface {name!r}: its law is nonlinear, and backend 'multigrid' is for linear ones: use "
                "backend='cholmod'; where its factors do not fit, cut the largest parts into several with "
                "Perfect() between them, or spread the parts over MPI ranks"
            )


def _begun(
    problem: Problem,
    plan: Plan,
    description: bridge.Description,
    floors: Mapping[tuple[str, str], Array] | None = None,
) -> Subspace:
    """The basis of rigid motions and loads."""
    began = perf_counter()
    with meeting_often(problem.comm):
        bodies = Bodies(problem, description, floors)
        space = Subspace.of(bodies)
    text = "multigrid of %d unknowns (%s), %.2f s"
    _log.info(text, bodies.size, bodies.multigrid.kind, perf_counter() - began)
    return space


class _Rounds:
    """Errors before every round in which a basis grows."""

    def __init__(self, goal: float, measured: Sequence[float] = ()) -> None:
        self._goal = goal
        self._measured = list(measured)
        self._best = np.inf

    def left(self, found: float) -> float:
        """What an error of one cycle may be in truth."""
        self._measured.append(found)
        left = found * self.underestimated
        self._best = min(self._best, left)
        return left

    @property
    def several(self) -> bool:
        """Whether they tell a rate."""
        return len(self._measured) > 1 or self._measured == [0.0]

    @property
    def underestimated(self) -> float:
        """How many times larger errors may be than one cycle says.

        Where the eigenvalues of M^-1 A lie in [1 / kappa, 1], r^T A^-1 r <= kappa r^T M^-1 r, and conjugate
        gradients take the fraction (sqrt(kappa) - 1) / (sqrt(kappa) + 1) from the error in a step: the rounds
        tell kappa.
        """
        recent = np.array(self._measured[-_RECENT:])
        if len(recent) < 2 or not recent[-1] > 0.0:
            return 1.0
        rate = min((recent[-1] / recent[0]) ** (1.0 / (len(recent) - 1)), _SLOWEST)
        return float((1.0 + rate) / (1.0 - rate))

    def go_on(self) -> None:
        """Another round.

        Raises
        ------
        NumericalError
            They do not converge.
        """
        if self.expected > ROUNDS:
            raise NumericalError(
                f"backend 'multigrid' ended at an error of {self._best:.1e}, asked {self._goal:.1e}: after "
                f"{len(self._measured)} rounds it falls so slowly that {ROUNDS} would not do: use "
                "backend='cholmod', or other settings of PETSc with the prefix latin_body_"
            )

    @property
    def expected(self) -> float:
        """Rounds after which the goal is reached, at the rate of the later half of those that were made."""
        measured = self._measured
        if len(measured) <= FIRST or not self._best > self._goal:
            return len(measured)
        half = len(measured) // 2
        gained = np.log(min(measured[:half]) / min(measured[half:]))
        if not gained > 0.0:
            return float("inf")
        return len(measured) + (len(measured) - half) * float(np.log(self._best / self._goal) / gained)


_RECENT = 6
"""Errors, with the rounds between them, that a rate is taken from."""
_SLOWEST = 0.99
_LEAST = 2.0
"""Errors of points may be so many times larger than one cycle says, however well it went: that is a rate of a
third."""


# --- one run --------------------------------------------------------------------------------------
def _with_pattern(description: bridge.Description, loads: Mapping[str, Array]) -> bridge.Description:
    """A description with one more load pattern: forces (n,) on parts."""

    def wider(block: Array, column: Array | None = None) -> Array:
        added = np.zeros(len(block)) if column is None else column
        return np.asfortranarray(np.column_stack([block, added]))

    bodies = []
    for body in description.bodies:
        members = [
            {
                **each,
                "load": wider(each["load"], loads.get(each["name"])),
                "offset": None if each["offset"] is None else wider(each["offset"]),
            }
            for each in body["members"]
        ]
        springs = [{**each, "jump": wider(each["jump"])} for each in body["springs"]]
        bodies.append({**body, "members": members, "springs": springs})
    return description._replace(bodies=bodies)


@alone
def fitted(
    problem: Problem,
    plan: Plan,
    applied: Callable[[Laws], Laws],
    amplitudes: Array,
    means: int,
    loads: Mapping[str, Array] | None = None,
) -> tuple[Solver, list[State]]:
    """A solver in whose basis a run is answered to a share of its tolerance, and the answer to start from.

    Parameters
    ----------
    plan
        With ``backend="multigrid"``.
    applied
        The laws of the run, of those of the plan.
    amplitudes
        (load patterns, columns).
    means
        Columns that are means; the others are fluctuations, with an error of their own.
    loads
        Part -> forces (n,) of one more load pattern, after those of the plan.

    Raises
    ------
    SceneError
        A law is nonlinear, a stiffness of a part varies, or glue is active that the rounds do not answer.
    NumericalError
        The cycles do not converge.
    """
    _check(problem, plan)
    description = bridge.describe(problem, plan)
    with agreement(problem.comm):
        if loads is not None:
            description = _with_pattern(description, loads)
    with meeting_often(problem.comm):
        return _fitted(_begun(problem, plan, description), plan, applied, amplitudes, means)


def _fitted(
    space: Subspace, plan: Plan, applied: Callable[[Laws], Laws], amplitudes: Array, means: int
) -> tuple[Solver, list[State]]:
    """As :func:`fitted`, from the basis of rigid motions and loads."""
    problem = space.bodies.problem
    goal, left = SHARE * plan.options.rtol, 0.1
    rounds = _Rounds(goal, [1.0])
    start: list[State] = []
    while True:
        solver = Solver(problem, plan, space=space)
        with agreement(problem.comm):
            laws = applied(solver.laws)
        loose = plan.options.with_(rtol=float(np.clip(0.02 * left, 0.2 * goal, 0.01)))
        summary, state = solver.run(laws, loose, amplitudes, start, progress=False)
        answer = solver.in_basis(laws, state, amplitudes)
        found, fields = _corrections(space, solver.residual(answer), space.energies(answer), means)
        left = rounds.left(found)
        _log.info("multigrid round: %d fields, error %s", space.count, shown_error(left))
        solver.left, start = left, [state]
        if left <= goal or summary.status in STOPPED or not np.isfinite(left):
            return solver, start
        rounds.go_on()
        space = space.with_fields(fields)


def _corrections(space: Subspace, residual: Array, energies: Array, means: int) -> tuple[float, Array]:
    """The estimated relative error of an answer, and fields (n, few) that take most of it away."""
    bodies, rows = space.bodies, space.bodies.rows
    groups = [slice(0, means), slice(means, len(energies))]
    sizes = np.array([energies[group].sum() for group in groups])
    sizes = np.maximum(sizes, FAINT**2 * sizes.max())
    if not sizes.max() > 0.0:  # nothing acts
        sizes[:] = 1.0
    for group, size in zip(groups, sizes, strict=True):
        residual[:, group] /= np.sqrt(size)
    gram = bodies.multigrid.energies(residual)
    values, vectors = rows.told(np.linalg.eigh(0.5 * (gram + gram.T)))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    rest = values.sum() - np.cumsum(values)
    count = 1 + int(np.argmax(rest <= NEGLIGIBLE * values.sum()))
    chosen = vectors[:, :count]
    forces = residual @ chosen
    fields = bodies.multigrid.cycle(forces)
    energy = chosen @ rows.dot(forces, fields) @ chosen.T
    squares = np.diag(energy) * (values.sum() / max(values[:count].sum(), np.finfo(float).tiny))
    return rows.told(float(np.sqrt(max(abs(squares[group].sum()) for group in groups)))), fields


# --- many points ----------------------------------------------------------------------------------
@alone
def solver_of(
    problem: Problem,
    plan: Plan,
    parameters: Sequence[SweptParameter] = (),
    before: Solver | None = None,
) -> Solver:
    """A solver for points: with factors, or with a basis that :func:`walked` lets grow.

    Parameters
    ----------
    parameters
        What will be swept, where it is known.
    before
        As for :class:`Solver`.

    Raises
    ------
    SceneError
        As :func:`fitted`.
    """
    if plan.options.backend != "multigrid":
        return Solver(problem, plan, before)
    _check(problem, plan)
    description = bridge.describe(problem, plan)
    with agreement(problem.comm):
        floors = _floors(problem, parameters)
    return Solver(problem, plan, space=_begun(problem, plan, description, floors))


def _floors(problem: Problem, parameters: Sequence[SweptParameter]) -> dict[tuple[str, str], Array]:
    """The softest of all swept springs of this rank, point by point of their interfaces.

    With them errors are measured from above: r^T A^-1 r falls with the stiffness of A.
    """
    found = {}
    for each in parameters:
        interface = problem.own.interfaces.get(each.interface)
        if interface is None or each.parameter not in interface.law.spans:
            continue
        softest, stiffest = np.inf, 0.0
        for first in range(0, each.values.shape[1], 256):
            values = each.pattern @ each.values[:, first : first + 256]
            by_column = values.reshape(each.columns, -1, values.shape[1])
            softest = np.minimum(softest, by_column.min(axis=(0, 2)))
            stiffest = max(stiffest, float(values.max()))
        if stiffest > 0.0:
            floor = np.maximum(softest, stiffest / RANGE)
            found[each.interface, each.parameter] = np.broadcast_to(floor, (interface.num_points,)).copy()
    return found


def _softer(space: Subspace, parameters: Sequence[SweptParameter]) -> float:
    """How many times softer than the springs of the multigrid those of points are, or stiffer beyond
    :data:`RANGE`."""
    largest = 1.0
    problem = space.bodies.problem
    for name, floor in _floors(problem, parameters).items():
        interface = problem.interfaces[name[0]]
        own = space.bodies.floors.get(name)
        if own is None:
            own = interface.law.stiffnesses(interface)[:, interface.law.spans[name[1]]].min(axis=1)
        own = np.maximum(own, np.finfo(float).tiny)
        largest = max(largest, float(np.max(own / floor)), float(np.max(floor / own)) / RANGE)
    return max(space.bodies.rows.every(largest))


class _Check:
    """Whether a basis answers points, and the fields that it lacks.

    Answers of many points are combinations of few: so are the residuals, which are linear in them. Of these
    few, multigrid says the energy.

    Attributes
    ----------
    solver
        In whose basis the points were solved.
    found
        Largest error of a point that was checked, by one cycle.
    fields
        (n, few) blocks.
    moved
        (fields, columns) blocks of some points in the basis.
    """

    def __init__(
        self,
        solver: Solver,
        amplitudes: Array,
        parameters: Sequence[SweptParameter],
        goal: float,
        underestimated: float | None,
    ) -> None:
        assert solver.space is not None
        self.solver, self.space = solver, solver.space
        self._amplitudes, self._goal = amplitudes, goal
        self._tries = underestimated is None
        self._under = underestimated or 1.0
        self._loads = [each for each in parameters if not each.interface]
        self.found = 0.0
        self.moved: list[Array] = []
        self.fields: list[Array] = []

    def __call__(self, solved: Sequence[Solved]) -> Sequence[float]:
        """Errors that the basis leaves in points; NaN where they are above the goal."""
        with meeting_often(self.solver.problem.comm):
            return self._checked(solved)

    def _checked(self, solved: Sequence[Solved]) -> Sequence[float]:
        whole = _beside([self.answer(each) for each in solved])
        if self._tries:
            self.moved.append(self.space.free(whole))
        found, fields = self.errors(whole)
        self.found = max(self.found, float(found.max(initial=0.0)))
        left = self._under * found
        missed = ~(left <= self._goal)
        if (self._tries or missed.any()) and sum(each.shape[1] for each in self.fields) < ADDED:
            self.fields.append(fields)
        return [float(each) for each in np.where(missed, np.nan, left)]

    def errors(self, whole: Answer) -> tuple[Array, Array]:
        """Relative errors (points,) of answers by one cycle, and fields (n, few) that take most of them
        away."""
        columns = self._amplitudes.shape[1]
        energies = self.space.energies(whole, OF_SPRINGS).reshape(-1, columns).sum(axis=1)
        size = energies.max(initial=0.0)
        scale = np.sqrt(np.maximum(energies, FAINT**2 * size)) if size > 0.0 else np.ones(len(energies))
        per_column = np.repeat(scale, columns)
        rows = self.space.bodies.rows
        few, shares = _few(Answer(*(block / per_column for block in whole)), EXACT * self._goal, rows)
        return self._measured(self.solver.residual(few), shares, columns)

    def answer(self, solved: Solved) -> Answer:
        """A point as the bodies see it."""
        amplitudes = self._amplitudes
        for each in self._loads:
            own = each.pattern @ each.values[:, solved.point]
            amplitudes = amplitudes + own.reshape(amplitudes.shape, order="F")
        return self.solver.in_basis(solved.laws, solved.state, np.asfortranarray(amplitudes))

    def _measured(self, residual: Array, shares: Array, columns: int) -> tuple[Array, Array]:
        """Errors of points by one cycle, and what the cycle makes of the directions that matter.

        Parameters
        ----------
        residual
            (n, few), of which every point has its `shares` (few, points * columns).
        """
        multigrid, rows = self.space.bodies.multigrid, self.space.bodies.rows
        gram = multigrid.energies(residual)
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        energetic = (np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T) @ shares
        sizes, right = rows.told(np.linalg.svd(energetic, full_matrices=False)[1:])
        squares = ((sizes[:, None] * right) ** 2).reshape(len(sizes), -1, columns).sum(axis=2)
        # rows: what is left by the directions before
        rest = np.vstack([np.cumsum(squares[::-1], axis=0)[::-1], np.zeros(squares.shape[1])])
        least = max(float(rest[0].max(initial=0.0)), self._goal**2)
        count = max(1, int(np.argmax(np.all(rest <= NEGLIGIBLE * least, axis=1))))
        forces = residual @ (shares @ right[:count].T)
        fields = multigrid.cycle(forces)
        energy = rows.dot(forces, fields)
        energy = 0.5 * (energy + energy.T)
        own = right[:count]
        of_chosen = np.einsum("ic,ij,jc->c", own, energy, own).reshape(-1, columns).sum(axis=1)
        unit = np.maximum(sizes[:count], np.finfo(float).tiny)
        factor = max(float(np.linalg.eigvalsh(energy / np.outer(unit, unit))[-1]), 0.0)
        found: Array = np.sqrt(np.maximum(of_chosen, 0.0)) + np.sqrt(factor * rest[count])
        return rows.told(found), fields


def _beside(answers: Sequence[Answer]) -> Answer:
    """Answers, column beside column."""
    return Answer(*(np.hstack(blocks) for blocks in zip(*answers, strict=True)))


def _few(answer: Answer, tolerance: float, rows: Rows) -> tuple[Answer, Array]:
    """Answers of which others are combinations, and their shares (few, columns) in each."""
    factors = [rows.norm(block) for block in (answer.moved, answer.force)]
    factors = [size if size > 0.0 else 1.0 for size in [*factors, float(np.linalg.norm(answer.amplitudes))]]
    whole = np.vstack([block / size for block, size in zip(answer, factors, strict=True)])
    ends = np.cumsum([len(block) for block in answer])
    # all ranks have the amplitudes
    counted = whole if rows.rank == 0 else whole[: ends[1]]
    _, sizes, right = rows.told(np.linalg.svd(rows.triangle(counted), full_matrices=False))
    sizes[:1] = np.maximum(sizes[:1], np.finfo(float).tiny)
    kept = sizes > tolerance * sizes.max(initial=0.0) / np.sqrt(max(answer.moved.shape[1], 1))
    shares = right[kept]
    parts = np.split(whole @ shares.T, ends[:-1])
    return Answer(*(np.asfortranarray(part * f) for part, f in zip(parts, factors, strict=True))), shares


class _Walk(NamedTuple):
    """What all walks over the same points have in common."""

    amplitudes: Array
    parameters: Sequence[SweptParameter]
    options: Options
    goal: float
    callback: Callable[[Iteration], None] | None

    def check(self, solver: Solver, scatter: float, underestimated: float | None) -> _Check:
        """For points that are solved in the basis of a solver; None: they are tried only."""
        return _Check(solver, self.amplitudes, self.parameters, self.goal * scatter, underestimated)

    def tried(
        self, solver: Solver, points: Sequence[int], check: Callable[[Sequence[Solved]], Sequence[float]]
    ) -> bool:
        """Solve some points for their fields only; whether all were reached."""
        found = solver.walk(
            solver.laws,
            self.amplitudes,
            self.parameters,
            points,
            self.options,
            callback=self.callback,
            keep_fields=False,
            check=check,
        )
        return int((found.iterations >= 0).sum()) + len(found.missed) == len(points)


def _far(parameters: Sequence[SweptParameter], points: Sequence[int]) -> list[int]:
    """Some of many points: such that are far from each other, and every so manieth."""
    if len(points) <= FAR + EVEN or not parameters:
        return list(points)
    values = np.concatenate([each.values[:, points] for each in parameters]).T
    size = np.ptp(values, axis=0)
    places = values / np.where(size > 0.0, size, 1.0)
    even = np.unique(np.linspace(0, len(points) - 1, EVEN).astype(np.int64))
    chosen = [int(each) for each in even]
    away = np.min([np.sum((places - places[k]) ** 2, axis=1) for k in chosen], axis=0)
    for _ in range(FAR):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.sum((places - places[chosen[-1]]) ** 2, axis=1))
    return [points[k] for k in dict.fromkeys(chosen)]


def walked(
    solver: Solver,
    amplitudes: Array,
    parameters: Sequence[SweptParameter],
    order: Sequence[int],
    options: Options,
    *,
    checkpoint: str | Path | None = None,
    ranks: PointRanks | None = None,
    **more: Unpack[OfWalk],
) -> tuple[Solver, SweepPoints]:
    """Solve at many points, see :meth:`Solver.walk`; and the solver that knows the answers.

    A solver with a basis gets fields until a check has passed every point: first those that a few points
    need, then those of points that the check refuses.

    Raises
    ------
    NumericalError
        The cycles of multigrid do not converge.
    """
    folder = FOLDER.get()
    if folder is not None and checkpoint is None and ranks is None and not more.get("outputs"):
        checkpoint, more = _kept_in(folder, solver, parameters, options, more)
    if solver.space is None:
        points = solver.walk(
            solver.laws, amplitudes, parameters, order, options, checkpoint=checkpoint, ranks=ranks, **more
        )
        return solver, points
    half = options.with_(rtol=(1.0 - SHARE) * options.rtol)
    own = _Walk(amplitudes, parameters, half, SHARE * options.rtol, more.get("callback"))
    with meeting_often(solver.problem.comm):
        return _walked_in_basis(solver, own, order, checkpoint, ranks, more)


def _kept_in(
    folder: Path, solver: Solver, parameters: Sequence[SweptParameter], options: Options, more: OfWalk
) -> tuple[Path | None, OfWalk]:
    """The file of a walk, by all that its answers depend on, and what it says of it."""
    plan = replace(solver.plan, options=options)
    try:
        header = {"run": "walk", **fingerprint(solver.problem, plan, parameters)}
    except SceneError:  # a function that cannot be told apart from another one
        return None, more
    name = hashlib.sha256(json.dumps(header).encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    return folder / name, {**more, "header": header}


@alone
def _walked_in_basis(
    solver: Solver,
    own: _Walk,
    order: Sequence[int],
    checkpoint: str | Path | None,
    ranks: PointRanks | None,
    more: OfWalk,
) -> tuple[Solver, SweepPoints]:
    """As :func:`walked`, by a solver with a basis. Ranks that share the points make the same basis, each for
    itself."""
    parameters = own.parameters
    assert solver.space is not None
    with agreed_over(ranks), meeting_often(solver.problem.comm):
        if _softer(solver.space, parameters) > ALIKE:
            solver = _with_springs(solver, parameters)
    solver, scatter, under, whole = _grown_alike(ranks, solver, own, _far(parameters, order), 1.0, _LEAST)
    points: SweepPoints | None = None
    while True:
        check = own.check(solver, scatter, under)
        left = [p for p in order if points is None or points.iterations[p] < 0] if whole else []
        points = solver.walk(
            solver.laws,
            own.amplitudes,
            parameters,
            left,
            own.options,
            checkpoint=checkpoint,
            ranks=ranks,
            before=points,
            check=check,
            **more,
        )
        missed = list(points.missed)
        still = [p for p in left if points.iterations[p] < 0]
        if not missed or len(missed) < len(still):  # all are done, or Ctrl-C
            if own.options.scatter:
                points.scatter = min(points.scatter, scatter)
            return solver, locked(points)
        _log.info("multigrid: %d of %d points need more fields", len(missed), len(left))
        lacking = check.fields if ranks is None else ranks.joined(check.fields)
        with agreed_over(ranks), meeting_often(solver.problem.comm):
            space = check.space.with_fields(np.hstack(lacking))
            solver = Solver(solver.problem, solver.plan, space=space)
        solver, scatter, under, whole = _grown_alike(
            ranks, solver, own, _far(parameters, missed), scatter, under
        )


def _grown_alike(
    ranks: PointRanks | None,
    solver: Solver,
    own: _Walk,
    points: Sequence[int],
    scatter: float,
    underestimated: float,
) -> tuple[Solver, float, float, bool]:
    """As :func:`_grown`, on ranks that share points."""
    with agreed_over(ranks), meeting_often(solver.problem.comm):
        solver, scatter, underestimated, whole = _grown(solver, own, points, scatter, underestimated)
    if ranks is not None:
        scatter, underestimated = ranks.told((scatter, underestimated))
        whole = all(ranks.joined([whole]))
    return solver, scatter, underestimated, whole


def _with_springs(solver: Solver, parameters: Sequence[SweptParameter]) -> Solver:
    """A solver with the springs of other points, and the fields that it had."""
    problem, plan, old = solver.problem, solver.plan, solver.space
    assert old is not None
    space = _begun(problem, plan, old.bodies.described, _floors(problem, parameters))
    known: Array = np.zeros((old.bodies.size, 0), order="F")
    for piece, fields in zip(old.bodies.pieces, old.fields, strict=True):
        block = np.zeros((old.bodies.size, fields.shape[1]), order="F")
        block[piece.own] = fields
        known = np.hstack([known, block])
    return Solver(problem, plan, space=space.with_fields(known))


def _grown(
    solver: Solver, own: _Walk, points: Sequence[int], scatter: float, underestimated: float
) -> tuple[Solver, float, float, bool]:
    """A solver whose basis answers a few points; what these scatter by, how far one cycle may underestimate
    errors, and whether the points were all reached."""
    rounds = _Rounds(own.goal)
    while True:
        check = own.check(solver, scatter, None)
        whole = own.tried(solver, points, check)
        if not whole or not points:
            return solver, scatter, underestimated, whole
        if own.options.scatter and len(points) > 2:
            moved, columns = np.hstack(check.moved), own.amplitudes.shape[1]
            scatter = min(scatter, _scatter(moved, columns, check.space.bodies.rows))
        left = rounds.left(check.found)
        _log.info("multigrid round: %d fields, error %s", check.space.count, shown_error(left))
        if rounds.several and left <= own.goal * scatter:
            return solver, scatter, max(underestimated, rounds.underestimated), True
        rounds.go_on()
        space = check.space.with_fields(np.hstack(check.fields))
        solver = Solver(solver.problem, solver.plan, space=space)


def _scatter(moved: Array, columns: int, rows: Rows) -> float:
    """What points differ by, relative to their energy; the fields of a basis are orthonormal in energy."""
    by_point = moved.T.reshape(moved.shape[1] // columns, columns * len(moved))
    mean = by_point.mean(axis=0)
    squares = np.array([np.sum(mean**2), np.sum((by_point - mean) ** 2)])
    size, away = rows.sum(squares)
    return float(np.clip(np.sqrt(away / len(by_point) / size), FAINT, 1.0)) if size > 0.0 else 1.0


class _Pairs:
    """The answers of points, by their number."""

    def __init__(self, check: _Check) -> None:
        self._check = check
        self.answers: dict[int, Answer] = {}

    def __call__(self, solved: Sequence[Solved]) -> Sequence[float]:
        """Keep them all."""
        self.answers |= {each.point: self._check.answer(each) for each in solved}
        return [0.0] * len(solved)


@alone
def sloped(solver: Solver, amplitudes: Array, parameters: Sequence[SweptParameter]) -> Solver:
    """A solver that knows the differences between pairs of near points as well as points by themselves.

    Parameters
    ----------
    parameters
        Of 2 p points: the first of each pair, then the second of each.

    Raises
    ------
    NumericalError
        The cycles of multigrid do not converge.
    """
    if solver.space is None or not parameters:
        return solver
    with meeting_often(solver.problem.comm):
        return _sloped(solver, amplitudes, parameters)


def _sloped(solver: Solver, amplitudes: Array, parameters: Sequence[SweptParameter]) -> Solver:
    """As :func:`sloped`, by a solver with a basis."""
    options = solver.plan.options
    goal = SHARE * options.rtol
    own = _Walk(amplitudes, parameters, options.with_(rtol=TIGHT, scatter=False), goal, None)
    count = parameters[0].values.shape[1] // 2
    rounds = _Rounds(goal)
    while True:
        check = own.check(solver, 1.0, None)
        pairs = _Pairs(check)
        if not own.tried(solver, range(2 * count), pairs):
            return solver
        first, second = (_beside([pairs.answers[k + half] for k in range(count)]) for half in (0, count))
        found, fields = check.errors(Answer(*(a - b for a, b in zip(first, second, strict=True))))
        left = max(rounds.left(float(found.max())), _LEAST * float(found.max()))
        _log.info("multigrid round for slopes: %d fields, error %s", check.space.count, shown_error(left))
        if left <= goal:
            return solver
        rounds.go_on()
        solver = Solver(solver.problem, solver.plan, space=check.space.with_fields(fields))


TIGHT = 1e-11
"""Tolerance of points of which differences are taken."""
