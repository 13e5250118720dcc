"""The dual problem of a structure with nonlinear laws: the slopes of its laws at an answer, transposed.

With data s and traces w = G s of the interface rows, k the search directions and e = +-1 on both sides, the
residual of a law with the slope R of its force by the free jump changes by

    dr = -ds - N (ds / k - 2 dw),      N = k - 2 e R e'.

The bodies are their own adjoints, so that the dual problem has R' in the place of R. Of linear laws R is
symmetric; where a contact slides it is not: its friction follows the pressure, and the pressure does not
follow the friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from latin_core import Laws

from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import spla
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["Transposed"]

T = TypeVar("T")

ENOUGH, MOST_STEPS = 1e-3, 400
"""Residual of the dual problem relative to its right-hand side, enough for an estimate; most steps."""

NEARLY = 2e-2
"""Residual with which it is of use."""

REACH = 1e-6
"""Of the difference quotients of the laws, relative to the largest displacement."""


class _Slopes(NamedTuple):
    """N of an interface with a nonlinear law, point by point."""

    rows: tuple[slice, ...]  # of its sides
    blocks: Array  # (points, sides * components, sides * components)

    def transposed(self, x: Array) -> Array:
        """N' of rows (n,), in the order of `rows`, (sides, points * components)."""
        points, size = self.blocks.shape[:2]
        sides = len(self.rows)
        own = np.stack([x[rows].reshape(points, -1) for rows in self.rows], axis=1).reshape(points, size)
        moved = np.einsum("mji,mj->mi", self.blocks, own).reshape(points, sides, -1)
        return np.asarray(moved.transpose(1, 0, 2).reshape(sides, -1))


class Transposed:
    """A structure with transposed slopes at a state of one column of its data.

    Interface rows are those of all ranks here, one rank after the other: every rank has all of them.

    Parameters
    ----------
    data
        (rows of this rank, columns) of the state, which an answer belongs to.
    size
        Of the displacements.
    """

    def __init__(
        self, solver: Solver, laws: Laws, data: Array, amplitudes: Array, column: int, size: float
    ) -> None:
        self.solver, self.laws, self.column = solver, laws, column
        self.problem, self.comm = solver.problem, solver.problem.comm
        self.data = np.asfortranarray(data)
        self.amplitudes, self.reach = amplitudes, REACH * size
        self.first = np.concatenate([[0], np.cumsum(self._said(len(self.data)))])
        self.traces = solver.global_stage(laws, self.data, amplitudes)
        self.residual = self._everywhere(solver.local_stage(laws, self.data, self.traces)[:, column])
        self.directions = self._everywhere(solver.directions)
        self.no_loads = np.zeros((len(amplitudes), 1))
        nonlinear = [n for n in solver.plan.active if not self.problem.interfaces[n].law.linear]
        self.slopes = [self._slopes(name) for name in nonlinear]

    def answer(self, jumps: Mapping[str, Array], loaded: Laws | None) -> tuple[Array, Array] | None:
        """Changes (rows, columns) of data and traces of this rank; None: the laws leave something free.

        Collective.

        Parameters
        ----------
        jumps
            Active interface of this rank -> imposed jump (rows of the interface, 1).
        loaded
            The laws with the loads of the dual problem; None: this rank has none.
        """
        right = np.zeros(len(self.residual))
        for name in sorted(set().union(*self._said(set(jumps)))):
            right += self._pulled_apart(name, jumps.get(name))
        before = np.zeros_like(self.traces)
        if loaded is not None:
            before = self.solver.global_stage(loaded, self.data, self.amplitudes) - self.traces
        right += self._residual(np.zeros(len(right)), before[:, self.column])
        size = float(np.linalg.norm(right))
        if not self._first(np.isfinite(size)):
            return None
        step = np.zeros(len(right))
        if self._first(size > 0.0):
            step[:] = self._solved(-right)
            if not self._first(float(np.linalg.norm(self._apply(step) + right)) <= NEARLY * size):
                return None
        change = np.zeros_like(self.data)
        change[:, self.column] = self._mine(step)
        before[:, self.column] += self._moved(step)
        return change, before

    # --- ranks -------------------------------------------------------------------------------------
    def _said(self, content: T) -> list[T]:
        """What every rank says."""
        return [content] if self.comm is None else exchanged(self.comm, content)

    def _first(self, content: T) -> T:
        """What the first rank says: rounding may differ from rank to rank, what is decided must not."""
        return self._said(content)[0]

    def _everywhere(self, rows: Array) -> Array:
        """The rows of all ranks, of those of this one."""
        return rows if self.comm is None else np.concatenate(self._said(rows))

    def _mine(self, rows: Array) -> Array:
        """The rows of this rank."""
        first = 0 if self.comm is None else self.first[self.comm.rank]
        return rows[first : first + len(self.data)]

    # --- the dual problem --------------------------------------------------------------------------
    def _solved(self, right: Array) -> Array:
        """The step (rows,) by GMRES on the first rank; the others take part in its products."""
        if self.comm is not None and self.comm.rank > 0:
            while True:
                step, ends = self._first((right, True))
                if ends:
                    return step
                self._apply(step)
        operator = spla.LinearOperator((len(right), len(right)), matvec=self._asked, dtype=np.float64)
        steps = min(MOST_STEPS, len(right))
        step, _ = spla.gmres(operator, right, rtol=ENOUGH, restart=steps, maxiter=1)
        return self._first((step, True))[0]

    def _asked(self, step: Array) -> Array:
        return self._apply(self._first((step, False))[0])

    def _apply(self, step: Array) -> Array:
        with agreement(self.comm):
            stop_if_pressed()
        return self._residual(step, self._moved(step))

    def _moved(self, step: Array) -> Array:
        """What a change of the data (rows,) does to the traces of this rank, (rows of this rank,)."""
        # of one column: bodies do not mix them, and several cost a sparse factor more than their number
        own = np.asfortranarray(self._mine(step)[:, None])
        return self.solver.global_stage(self.laws, own, self.no_loads)[:, 0]

    def _residual(self, step: Array, moved: Array) -> Array:
        """What changes of data (rows,), and of traces of this rank, do to the residual (rows,) with slopes
        transposed."""
        moved = self._everywhere(moved)
        found = self._local(step, moved) - self.residual
        free = step / self.directions - 2.0 * moved
        for each in self.slopes:
            for rows, part in zip(each.rows, each.transposed(free), strict=True):
                found[rows] = -step[rows] - part
        return found

    def _local(self, step: Array, moved: Array, laws: Laws | None = None) -> Array:
        """The residual (rows,) beside the state."""
        c = self.column
        data, traces = self.data.copy(order="F"), self.traces.copy(order="F")
        data[:, c] += self._mine(step)
        traces[:, c] += self._mine(moved)
        return self._everywhere(self.solver.local_stage(laws or self.laws, data, traces)[:, c])

    def _sides(self, name: str) -> tuple[tuple[slice, ...], int]:
        """Rows of the sides of an interface, and its components."""
        own = None
        if name in self.problem.own.interfaces:
            own = len(self.solver.flexibility(name)), self.solver.first_rows(name)
        told = [(first, *each) for first, each in zip(self.first, self._said(own), strict=False) if each]
        said = [[first + row if row >= 0 else -1 for row in rows] for first, _, rows in told]
        size = told[0][1]
        sides = tuple(slice(first, first + size) for first in map(max, zip(*said, strict=True)))
        return sides, size // self.problem.interfaces[name].num_points

    def _slopes(self, name: str) -> _Slopes:
        rows, count = self._sides(name)
        nothing = np.zeros(len(self.residual))
        columns = []
        for side in rows:
            for k in range(count):
                unit = np.zeros(len(nothing))
                unit[side][k::count] = self.reach
                change = self._local(nothing, unit) - self._local(nothing, -unit)
                change *= 0.25 / self.reach
                columns.append(np.hstack([change[r].reshape(-1, count) for r in rows]))
        return _Slopes(rows, np.stack(columns, axis=-1))

    def _pulled_apart(self, name: str, jump: Array | None) -> Array:
        """The residual (rows,) of an imposed jump (rows of the interface, 1), slopes transposed."""
        rows, count = self._sides(name)
        nothing = np.zeros(len(self.residual))
        of_all = next(each for each in self._said(jump) if each is not None)
        right = np.zeros(len(nothing))
        for k in range(count):
            unit = np.zeros((len(of_all), 1))
            unit[k::count] = self.reach
            ends = (self._moved_apart(name, sign * unit) for sign in (1.0, -1.0))
            above, below = (self._local(nothing, nothing, laws) for laws in ends)
            slope = (above - below) / (2.0 * self.reach)
            for side in rows:
                right[side][k::count] += (slope[side] * of_all[:, 0]).reshape(-1, count).sum(axis=1)
        return right

    def _moved_apart(self, name: str, jump: Array) -> Laws:
        """The laws with more of an imposed jump (rows of the interface, 1)."""
        if name not in self.problem.own.interfaces:
            return self.laws
        return self.laws.with_(parameters={name: {"jump": self.laws.parameter(name, "jump") + jump}})
