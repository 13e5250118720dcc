"""The linear system of the changes of a state, and its adjoint, on the factors of a solve.

Its operator is applied by differences of the *laws*, point by point, see :mod:`.gradients`; Newton's tangent
is the preconditioner, conjugate residuals of all right-hand sides together do the rest.
"""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt
from latin_core import Laws, Linearised, NumericalError, State

from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import linalg
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["BYTES", "NOTHING", "REACH", "System", "laws_at_sets"]

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
"""Rounds of the search in which the residual is not halved, after which it ends: many columns share them."""
NOTHING = 1e-12
"""Right-hand sides below this, relative to the state, are zero."""
BYTES = 2e8
"""Of states of the neighbours of a point."""


class System:
    """The linear system of the changes of the data, at one state.

    Attributes
    ----------
    data, traces, residual
        (rows, columns) of the state.
    size
        Largest number of the data.
    near
        Residual of conjugate residuals, relative to the right-hand sides.
    idle
        Rounds of these in which the residual is not halved, after which they end.
    """

    TRANSPOSED = False
    near = NEAR
    idle = IDLE

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
            self.tangent = solver.linearised(laws, State(self.data, self.traces), self.TRANSPOSED)
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

    def repeated(self, count: int) -> tuple[Laws, Array]:
        """Laws and no loads for sets of columns side by side."""
        loads = np.asfortranarray(np.tile(self.no_loads, (1, count)))
        if self.columns == 1 or count == 1:
            return self.laws, loads
        return laws_at_sets(self.solver, self.laws, count), loads

    def apply(self, change: Array) -> Array:
        """What changes of the data (rows, sets * columns) do to the residual."""
        count = change.shape[1] // self.columns
        laws, loads = self.repeated(count)
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

    def solve(self, right: Array, widths: Array | None = None) -> tuple[Array, float]:
        """Changes (rows, sets * columns) with ``apply(changes) = -right``; the largest relative residual.

        Parameters
        ----------
        widths
            (sets * columns,) what changes are multiplied with: what is nothing beside the state is not solved
            for. None: only zeros are not.
        """
        sizes = self.sets(right)
        nothing = sizes == 0.0
        if widths is not None:
            nothing = sizes * widths.reshape(-1, self.columns)[:, 0] <= NOTHING * self.size
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
        late = np.flatnonzero(best > self.near)
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
        while idle < self.idle and now.max() > 0.0 and images.shape[1] + len(sizes) <= most:
            open_ones = now > self.near
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
