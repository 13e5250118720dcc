"""Derivatives of a solved point with respect to its inputs, by the implicit function theorem.

A converged point has r(s, w(s, x), x) = 0: the residual r of the laws, the data s, the traces w that the
bodies answer. Where no point of an interface changes its status, so that r is smooth,

    (dr/ds + dr/dw G) ds/dx = -dr/dx - dr/dw dw/dx,     G ds = dw/ds ds,

one linear system with as many right-hand sides as there are inputs, on the factors that the solve had. Its
operator is applied by differences of the *laws*, point by point: exact up to rounding in a branch, and of
second order where a law is curved; time steps see those before them. Newton's tangent is the preconditioner,
conjugate residuals of all inputs together do the rest. The readings are then differences along the answer; no
solve is ever differenced.

At a kink (a point that just opens, starts to slip) there is no derivative: the laws leave a residual at the
predicted neighbours that is of first order instead of second, and that is flagged.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from latin_core import Laws, Linearised, NumericalError, State
from scipy import linalg

from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.inference.inputs import Inputs
from dolfinx_frontend.inference.points import amplitudes_at, answer_at, laws_at, part_of
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.results.sweep import SweepResult

__all__ = ["Derivatives", "derivatives"]

_log = logging.getLogger(__name__)

REACH = 1e-6
"""Of the difference quotients of the laws, relative to the state."""
ENOUGH = 1e-9
"""Residual of the linear systems, relative to their right-hand sides."""
NEAR = 3e-7
"""The same where the tangent of the whole structure is too dear to make corrections with, or does not do."""
MOST_SWEEPS = 8
"""Corrections before conjugate residuals, beside one per time step."""
IDLE = 8
"""Rounds of the search in which the residual is not halved, after which it ends."""
FLAGGED = 1e-3
"""Residual at the neighbours, relative to that of no prediction, above which there is a kink."""
NOTHING = 1e-12
"""Right-hand sides below this, relative to the state, are zero."""
BYTES = 2e8
"""Of states of the neighbours of a point."""


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives at one point.

    Attributes
    ----------
    values
        (quantities, inputs).
    kinks
        (inputs,) whether a status changes in the next neighbourhood along an input: then there is no
        derivative, and the value is something between those of the two sides.
    places
        Interface of the change for each input, or "".
    residual
        Largest relative residual of the linear systems.
    """

    values: Array
    kinks: Flags
    places: tuple[str, ...]
    residual: float


def derivatives(
    solver: Solver,
    inputs: Inputs,
    x: Array,
    state: State,
    read: Callable[[SweepResult, Array], Array],
) -> Derivatives:
    """Derivatives of readings at a solved point; collective.

    Parameters
    ----------
    x
        (inputs,).
    state
        Converged there.
    read
        An answer at points, and these (N, inputs) -> readings (N, quantities).
    """
    columns = solver.plan.amplitudes.shape[1]
    numbers = 6.0 * 8.0 * max(solver.total_rows, 1) * columns
    at_once = max(1, int(BYTES / numbers))
    steps = inputs.steps(x)
    found = [
        _some(solver, inputs, x, state, read, range(k, min(k + at_once, len(x))), steps)
        for k in range(0, len(x), at_once)
    ]
    return Derivatives(
        np.concatenate([each.values for each in found], axis=1),
        np.concatenate([each.kinks for each in found]),
        tuple(place for each in found for place in each.places),
        max(each.residual for each in found),
    )


def _some(
    solver: Solver,
    inputs: Inputs,
    x: Array,
    state: State,
    read: Callable[[SweepResult, Array], Array],
    which: Sequence[int],
    steps: Array,
) -> Derivatives:
    """As `derivatives`, with respect to some of the inputs."""
    count, plan = len(which), solver.plan
    columns = plan.amplitudes.shape[1]
    around = np.repeat(x[None], 2 * count, axis=0)
    for k, number in enumerate(which):
        around[k, number] += steps[number]
        around[count + k, number] -= steps[number]
    widths = 0.5 * (around[:count] - around[count:])[np.arange(count), list(which)]  # as they are in the end
    parameters = inputs.parameters(plan, np.vstack([around, x]))
    here, there = part_of(parameters, slice(2 * count, None)), part_of(parameters, slice(0, 2 * count))
    laws, laws_there = laws_at(solver, solver.laws, here), laws_at(solver, solver.laws, there)
    loads_there = amplitudes_at(plan, there)
    system = _System(solver, laws, state, amplitudes_at(plan, here), columns)

    data = np.asfortranarray(np.tile(state.data, (1, 2 * count)))
    if solver.total_rows:
        traces = solver.global_stage(laws_there, data, loads_there)
        moved = solver.local_stage(laws_there, data, traces)
        scale = np.repeat(widths, columns)
        right = (moved[:, : count * columns] - moved[:, count * columns :]) / (2.0 * scale)
        slopes, residual = system.solve(right, np.repeat(widths, columns))
        change = slopes * scale
        data = np.asfortranarray(data + np.hstack([change, -change]))
    else:
        residual, right = 0.0, np.zeros((0, count * columns))
    traces = solver.global_stage(laws_there, data, loads_there) if solver.total_rows else data
    answer = answer_at(solver.problem, solver, laws_there, data, traces, there)
    values = read(answer, around)
    kinks: Flags = np.zeros(count, dtype=bool)
    places = [""] * count
    if solver.total_rows:
        left = solver.local_stage(laws_there, data, traces) - np.tile(system.residual, (1, 2 * count))
        ends = np.hstack([np.abs(change)] * 2), np.hstack([np.abs(right)] * 2), np.abs(left)
        changed, asked, away = (system.sets(each).reshape(2, count).max(axis=0) for each in ends)
        size = changed + widths * asked
        kinks = (size > NOTHING * system.size) & (away > FLAGGED * size)
        places = system.places(left.reshape(len(left), 2, count, columns), kinks)
    quotients = (values[:count] - values[count:]) / (2.0 * widths[:, None])
    return Derivatives(np.ascontiguousarray(quotients.T), kinks, tuple(places), residual)


class _System:
    """The linear system of the changes of the data, at one state."""

    def __init__(self, solver: Solver, laws: Laws, state: State, amplitudes: Array, columns: int) -> None:
        self.solver, self.laws, self.columns = solver, laws, columns
        self.data = np.asfortranarray(state.data)
        self.comm = solver.problem.comm
        self.size = float(self._largest(np.abs(self.data).max(initial=0.0))) or 1.0
        self.no_loads = np.zeros_like(amplitudes)
        if not solver.total_rows:
            return
        rows = [solver.rows] if self.comm is None else exchanged(self.comm, solver.rows)
        first = sum(rows[: solver.problem.rank])
        self.own = slice(first, first + solver.rows)
        self.traces = solver.global_stage(laws, self.data, amplitudes)
        self.residual = solver.local_stage(laws, self.data, self.traces)
        self.tangent: Linearised | None = None
        try:
            self.tangent = solver.linearised(laws, State(self.data, self.traces))
        except NumericalError as error:
            _log.info("derivatives: no tangent of the whole structure, no preconditioner: %s", error)

    def _largest(self, values: npt.ArrayLike) -> Array:
        """The largest of every number on all ranks."""
        own = np.asarray(values, dtype=np.float64)
        return own if self.comm is None else np.max(exchanged(self.comm, own), axis=0)

    def places(self, left: Array, kinks: Flags) -> list[str]:
        """Interfaces where residuals (rows, 2, inputs, columns) are largest, of the inputs with kinks."""
        sizes = np.abs(left).max(axis=(1, 3), initial=0.0)
        rows = sizes.argmax(axis=0) if len(sizes) else np.zeros(len(kinks), dtype=np.int64)
        own = [(float(sizes[row, k]), self._place(int(row))) for k, row in enumerate(rows) if len(sizes)]
        own = own or [(0.0, "")] * len(kinks)
        every = [own] if self.comm is None else exchanged(self.comm, own)
        return [max(of_ranks)[1] if kink else "" for *of_ranks, kink in zip(*every, kinks, strict=True)]

    def _place(self, row: int) -> str:
        """The interface of a row."""
        for name in self.solver.plan.active:
            if name not in self.solver.problem.own.interfaces:
                continue
            size = len(self.solver.flexibility(name))
            if any(first <= row < first + size for first in self.solver.first_rows(name) if first >= 0):
                return name
        return ""

    def sets(self, block: Array) -> Array:
        """(rows, sets * columns) -> largest number of every set on all ranks, (sets,)."""
        sets = np.abs(block).reshape(len(block), block.shape[1] // self.columns, self.columns)
        return self._largest(sets.max(axis=(0, 2), initial=0.0))

    def _repeated(self, count: int) -> tuple[Laws, Array]:
        """Laws and no loads for sets of columns side by side."""
        loads = np.asfortranarray(np.tile(self.no_loads, (1, count)))
        if self.columns == 1 or count == 1:
            return self.laws, loads
        return laws_at_sets(self.solver, self.laws, count), loads

    def apply(self, change: Array) -> Array:
        """What changes of the data (rows, sets * columns) do to the residual."""
        count = change.shape[1] // self.columns
        laws, loads = self._repeated(count)
        moved = self.solver.global_stage(laws, np.asfortranarray(change), loads)
        size = self.sets(change)
        reach = np.where(size > 0.0, REACH * self.size / np.where(size > 0.0, size, 1.0), 0.0)
        by = np.repeat(reach, self.columns)
        data, traces = np.tile(self.data, (1, count)), np.tile(self.traces, (1, count))
        ends = [
            self.solver.local_stage(
                laws,
                np.asfortranarray(data + sign * by * change),
                np.asfortranarray(traces + sign * by * moved),
            )
            for sign in (1.0, -1.0)
        ]
        return np.asarray((ends[0] - ends[1]) / np.where(by > 0.0, 2.0 * by, 1.0))

    def correct(self, residual: Array) -> Array:
        """About the change of the data that takes a residual away."""
        if self.tangent is None:
            return residual
        return np.asarray(self.tangent.correct(np.asfortranarray(residual))[0])

    def solve(self, right: Array, widths: Array) -> tuple[Array, float]:
        """Changes (rows, sets * columns) with ``apply(changes) = -right``; the largest relative residual."""
        sizes = self.sets(right)
        widest = widths.reshape(-1, self.columns)[:, 0]
        nothing = sizes * widest <= NOTHING * self.size
        answer = np.zeros_like(right)
        left = right.copy()
        best = np.where(nothing, 0.0, np.inf)
        for _ in range(MOST_SWEEPS + self.columns):
            trial = answer + self.correct(left)
            rest = right + self.apply(trial)
            now = np.where(nothing, 0.0, self.sets(rest) / np.where(nothing, 1.0, sizes))
            better = now < best
            if not better.any():
                break
            taken = np.repeat(better, self.columns)
            answer[:, taken], left[:, taken] = trial[:, taken], rest[:, taken]
            fell = best[better].max() > 4.0 * now[better].max()
            best = np.where(better, now, best)
            if best.max(initial=0.0) <= ENOUGH or not fell:
                break
        late = np.flatnonzero(best > NEAR)
        if len(late):
            own = np.repeat(np.isin(np.arange(len(best)), late), self.columns)
            answer[:, own], best[late] = self._krylov(right[:, own], answer[:, own])
        answer[:, np.repeat(nothing, self.columns)] = 0.0
        return answer, float(best.max(initial=0.0))

    def _vectors(self, block: Array) -> Array:
        """(rows, sets * columns) -> (rows of all ranks * columns, sets)."""
        if self.comm is not None:
            block = np.vstack(exchanged(self.comm, block))
        shaped = block.reshape(len(block), -1, self.columns).transpose(0, 2, 1)
        return np.ascontiguousarray(shaped).reshape(-1, shaped.shape[2])

    def _block(self, vectors: Array) -> Array:
        """(rows of all ranks * columns, sets) -> (rows, sets * columns)."""
        shaped = vectors.reshape(-1, self.columns, vectors.shape[1])[self.own].transpose(0, 2, 1)
        return np.asfortranarray(shaped.reshape(len(shaped), shaped.shape[1] * shaped.shape[2]))

    def _krylov(self, right: Array, start: Array) -> tuple[Array, Array]:
        """The same of several sets, by conjugate residuals in one space of all of them.

        Inputs of one structure have much in common: each finds its answer in the directions of all, and a
        round applies the bodies to all of them at once.
        """
        answer = self._vectors(start)
        rest = -self._vectors(right + self.apply(start))
        sizes = np.linalg.norm(self._vectors(right), axis=0)
        now = np.linalg.norm(rest, axis=0) / sizes
        best, found, idle, mark = now.copy(), answer.copy(), 0, float(now.max())
        most = int(min(len(rest), max(len(sizes), BYTES // (16 * len(rest)))))
        directions: Array = np.zeros((len(rest), 0))
        images: Array = np.zeros((len(rest), 0))
        while idle < IDLE and now.max() > 0.0 and images.shape[1] + len(sizes) <= most:
            open_ones = now > NEAR
            if not open_ones.any():
                break
            new = rest[:, open_ones] / np.linalg.norm(rest[:, open_ones], axis=0)
            new = -self._vectors(self.correct(self._block(new)))
            image = self._vectors(self.apply(self._block(new)))
            for _ in range(2):
                parts = images.T @ image
                image, new = image - images @ parts, new - directions @ parts
            turned, triangle, order = linalg.qr(image, mode="economic", pivoting=True)
            heights = np.abs(np.diag(triangle))
            rank = int(np.count_nonzero(heights > 1e-9 * heights.max(initial=1e-300)))
            triangle, turned = triangle[:rank, :rank], turned[:, :rank]
            new = linalg.solve_triangular(triangle, new[:, order[:rank]].T, trans="T").T
            parts = turned.T @ rest
            answer, rest = answer + new @ parts, rest - turned @ parts
            directions, images = np.hstack([directions, new]), np.hstack([images, turned])
            now = np.linalg.norm(rest, axis=0) / sizes
            better = now < best
            idle = idle + 1 if now.max() > 0.5 * mark else 0
            mark = now.max() if idle == 0 else mark
            best[better], found[:, better] = now[better], answer[:, better]
        # differences of the laws have rounding that the recurrence does not see
        true = np.linalg.norm(self._vectors(right + self.apply(self._block(found))), axis=0) / sizes
        return self._block(found), true


def laws_at_sets(solver: Solver, laws: Laws, count: int) -> Laws:
    """Laws of one point for several sets of its columns."""
    given: dict[str, dict[str, Array]] = {}
    for name in laws.interfaces:
        interface = solver.problem.interfaces[name]
        for parameter in active_fields(interface, solver.plan).parameters:
            block = laws.parameter(name, parameter)
            if block.shape[1] > 1:
                given.setdefault(name, {})[parameter] = np.asfortranarray(np.tile(block, (1, count)))
    return laws.with_(parameters=given) if given else laws
