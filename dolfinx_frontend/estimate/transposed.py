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
from typing import NamedTuple

import numpy as np
from latin_core import Laws
from scipy.sparse.linalg import LinearOperator, gmres

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["Transposed"]

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
    """A structure on one rank with transposed slopes at a state of one column of its data.

    Parameters
    ----------
    data
        (rows, columns) of the state, which an answer belongs to.
    size
        Of the displacements.
    """

    def __init__(
        self, solver: Solver, laws: Laws, data: Array, amplitudes: Array, column: int, size: float
    ) -> None:
        self.solver, self.laws, self.column = solver, laws, column
        self.data = np.asfortranarray(data)
        self.amplitudes, self.reach = amplitudes, REACH * size
        self.traces = solver.global_stage(laws, self.data, amplitudes)
        self.residual = solver.local_stage(laws, self.data, self.traces)[:, column]
        self.no_loads = np.zeros_like(amplitudes)
        self.nonlinear = [n for n in solver.plan.active if not solver.problem.interfaces[n].law.linear]
        self.slopes = [self._slopes(name) for name in self.nonlinear]

    def answer(self, jumps: Mapping[str, Array], loaded: Laws | None) -> tuple[Array, Array] | None:
        """Changes (rows, columns) of data and traces; None: the laws leave something free.

        Parameters
        ----------
        jumps
            Active interface -> imposed jump (rows of the interface, 1).
        loaded
            The laws with the loads of the dual problem; None: there are none.
        """
        right = np.zeros(len(self.data))
        for name, jump in jumps.items():
            self._pulled_apart(name, jump, right)
        before = np.zeros_like(self.traces)
        if loaded is not None:
            before = self.solver.global_stage(loaded, self.data, self.amplitudes) - self.traces
            right += self._residual(np.zeros(len(right)), before[:, self.column])
        size = float(np.linalg.norm(right))
        if not np.isfinite(size):
            return None
        step = np.zeros(len(right))
        if size > 0.0:
            shape = (len(right), len(right))
            operator = LinearOperator(shape, matvec=self._apply, dtype=np.float64)
            steps = min(MOST_STEPS, len(right))
            step, _ = gmres(operator, -right, rtol=ENOUGH, restart=steps, maxiter=1)
            if not float(np.linalg.norm(self._apply(step) + right)) <= NEARLY * size:
                return None
        change = np.zeros_like(self.data)
        change[:, self.column] = step
        return change, before + self._moved(step)

    def _apply(self, step: Array) -> Array:
        stop_if_pressed()
        return self._residual(step, self._moved(step)[:, self.column])

    def _moved(self, step: Array) -> Array:
        """What a change of the data (rows,) does to the traces, (rows, columns)."""
        block = np.zeros_like(self.data)
        block[:, self.column] = step
        return self.solver.global_stage(self.laws, block, self.no_loads)

    def _residual(self, step: Array, moved: Array) -> Array:
        """What changes of data and traces (rows,) do to the residual (rows,), slopes transposed."""
        found = self._local(step, moved) - self.residual
        free = step / self.solver.directions - 2.0 * moved
        for each in self.slopes:
            for rows, part in zip(each.rows, each.transposed(free), strict=True):
                found[rows] = -step[rows] - part
        return found

    def _local(self, step: Array, moved: Array, laws: Laws | None = None) -> Array:
        """The residual (rows,) beside the state."""
        c = self.column
        data, traces = self.data.copy(order="F"), self.traces.copy(order="F")
        data[:, c] += step
        traces[:, c] += moved
        return np.asarray(self.solver.local_stage(laws or self.laws, data, traces)[:, c])

    def _sides(self, name: str) -> tuple[tuple[slice, ...], int]:
        """Rows of the sides of an interface, and its components."""
        size = len(self.solver.flexibility(name))
        sides = tuple(slice(first, first + size) for first in self.solver.first_rows(name))
        return sides, size // self.solver.problem.interfaces[name].num_points

    def _slopes(self, name: str) -> _Slopes:
        rows, count = self._sides(name)
        nothing = np.zeros(len(self.data))
        columns = []
        for side in rows:
            for k in range(count):
                unit = np.zeros(len(self.data))
                unit[side][k::count] = self.reach
                change = self._local(nothing, unit) - self._local(nothing, -unit)
                change *= 0.25 / self.reach
                columns.append(np.hstack([change[r].reshape(-1, count) for r in rows]))
        return _Slopes(rows, np.stack(columns, axis=-1))

    def _pulled_apart(self, name: str, jump: Array, right: Array) -> None:
        """Add the residual (rows,) of an imposed jump (rows of the interface, 1), slopes transposed."""
        rows, count = self._sides(name)
        given, nothing = self.laws.parameter(name, "jump"), np.zeros(len(self.data))
        for k in range(count):
            unit = np.zeros((len(jump), 1))
            unit[k::count] = self.reach
            ends = [{name: {"jump": given + sign * unit}} for sign in (1.0, -1.0)]
            above, below = (self._local(nothing, nothing, self.laws.with_(parameters=each)) for each in ends)
            slope = (above - below) / (2.0 * self.reach)
            for side in rows:
                right[side][k::count] += (slope[side] * jump[:, 0]).reshape(-1, count).sum(axis=1)
