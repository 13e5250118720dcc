"""Many points of an assembly whose laws are all linear springs: combinations of a few solved ones.

Solved states obey the bodies and the balance of the interfaces, and so does f = f_0 + sum c_k (f_k - f_0),
of which jumps and states follow alike. What is left is the law j - Delta = f / K of every spring. Its
residual r is made orthogonal to the forces of the basis (Galerkin in complementary energy): a small system
for each point, whose matrices are summed by the values of the springs. The energy of the error is at most
sum w K r^2, because bodies only add to 1 / K: a bound, computed at every point. Points above the tolerance
are solved by themselves, and the worst of some that are tried first become part of the basis (A. Patera, G.
Rozza, Reduced Basis Approximation, 2007, chapter 4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from latin_core import SweepPoints, SweptParameter

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["FEWEST", "Reduced", "neighbours"]

FEWEST = 400
"""Points from which on a basis is worth its solves."""
FIRST, ADDED, MOST = 8, 8, 160
"""Points of the first basis, those that are added at once, and all of them at most."""
TIGHTER = 1e-3
"""Tolerance of the points of the basis, relative to that of the others."""
CHUNK = 512
"""Points at once."""
MANY = 8192
"""Points at most that share a basis."""
TRIED, FEW = 256, 0.02
"""Points on which a basis is tried, and the share of them that may be left to be solved."""
SAME = 1e-3
"""Directions of the basis below this, of the tolerance times the forces, are left out."""


def neighbours(x: Array) -> list[Ints]:
    """Points (N, inputs) in groups of near ones, cut in the middle along the input that scatters most."""
    scale = np.std(x, axis=0)
    scale[scale == 0.0] = 1.0
    groups: list[Ints] = [np.arange(len(x))]
    done: list[Ints] = []
    while groups:
        own = groups.pop()
        if len(own) <= MANY:
            done.append(own)
            continue
        along = x[own] / scale
        order = np.argsort(along[:, int(np.argmax(np.std(along, axis=0)))], kind="stable")
        groups += [np.sort(each) for each in np.array_split(own[order], 2)]
    return done


@dataclass(frozen=True, eq=False)
class _Springs:
    """One component of one interface: K = shape * value."""

    rows: Array  # (m,) of the forces
    shape: Array  # (m,)
    given: tuple[str, str] | None  # interface and parameter if it is swept; None: the value is 1


class Reduced:
    """Combinations of solved points; None of it where a law is no spring, or something else changes."""

    def __init__(self, solver: Solver, springs: Sequence[_Springs], jump: Array, weights: Array) -> None:
        self._solver, self._springs, self._jump, self._weights = solver, springs, jump, weights
        self._names = [n for n in solver.plan.active if n in solver.problem.own.interfaces]
        self._forces: Array = np.zeros((0, len(weights)))
        self._jumps = self._forces
        self._states: Array = np.zeros((0, 2 * solver.rows))
        self._flexible: Array = np.zeros(len(weights))
        self._groups: list[int] = []  # the first spring of each
        self._of_group: list[int] = []
        self._ready = False

    @classmethod
    def of(cls, solver: Solver, parameters: Sequence[SweptParameter]) -> Reduced | None:
        """For what is swept; None: it does not apply."""
        problem, plan, laws = solver.problem, solver.plan, solver.laws
        if solver.space is not None:  # a basis of the bodies has its own way with many points
            return None
        if problem.distribution is not None or plan.amplitudes.shape[1] != 1 or not plan.active:
            return None
        swept = {(p.interface, p.parameter): p for p in parameters}
        if len(swept) < len(parameters):
            return None
        springs: list[_Springs] = []
        jumps, weights, first = [], [], 0
        for name in plan.active:
            interface = problem.interfaces[name]
            fields = active_fields(interface, plan)
            dim, count = interface.dim, interface.num_points
            if fields.kind != "elastic" or set(fields.parameters) != {"normal", "tangential", "jump"}:
                return None
            for parameter, components in (("normal", [0]), ("tangential", range(1, dim))):
                rows = np.concatenate([first + np.arange(count) * dim + c for c in components])
                given = swept.pop((name, parameter), None)
                shape = laws.parameter(name, parameter) if given is None else given.pattern
                if shape.shape[1] != 1 or not shape.min() > 0.0 or (given is not None and given.columns != 1):
                    return None
                own = np.tile(np.broadcast_to(shape[:, 0], count), len(components))
                springs.append(_Springs(rows, own, None if given is None else (name, parameter)))
            jumps.append(np.ravel(laws.parameter(name, "jump")))
            weights.append(np.repeat(interface.weights, dim))
            first += count * dim
        if swept or any(len(j) != len(w) for j, w in zip(jumps, weights, strict=True)):
            return None
        return cls(solver, springs, np.concatenate(jumps), np.concatenate(weights))

    # --- the basis --------------------------------------------------------------------------------
    def _add(self, parameters: Sequence[SweptParameter], which: Ints) -> bool:
        """Solve some points; whether they converged."""
        joined = [replace(p, values=np.ascontiguousarray(p.values[:, which])) for p in parameters]
        solver = self._solver
        options = solver.plan.options
        tight = replace(options, rtol=max(TIGHTER * options.rtol, 1e-12))
        found = solver.walk(
            solver.laws, solver.plan.amplitudes, joined, range(len(which)), tight, keep_states=True
        )
        if any(status != "converged" for status in found.status):
            return False
        count = len(which)
        assert found.states is not None  # asked for
        self._forces = np.vstack([self._forces, self._beside(found.forces, count)])
        self._jumps = np.vstack([self._jumps, self._beside(found.jumps, count)])
        states = np.array([np.concatenate([d.ravel(), t.ravel()]) for d, t in found.states])
        self._states = np.vstack([self._states, states])
        values = self._values(joined, slice(None))
        self._flexible = self._flexibility([v.mean(keepdims=True) for v in values])[0]
        self._reduce()
        return True

    def _beside(self, fields: dict[str, Array], count: int) -> Array:
        return np.hstack([np.reshape(fields[name], (count, -1)) for name in self._names])

    def _grouped(self, parameters: Sequence[SweptParameter]) -> None:
        """Springs of the same value at all points share a matrix."""
        values = self._values(parameters, slice(None))
        if self._groups and all(
            np.array_equal(values[self._groups[group]], own)
            for group, own in zip(self._of_group, values, strict=True)
        ):
            return
        self._groups, self._of_group = [], []
        for k, own in enumerate(values):
            same = [g for g, first in enumerate(self._groups) if np.array_equal(values[first], own)]
            if not same:
                self._groups.append(k)
            self._of_group.append(same[0] if same else len(self._groups) - 1)
        if self._ready:
            self._reduce()

    def _reduce(self) -> None:
        """Directions of the basis, orthonormal in the energy of the springs, and their matrices."""
        root = np.sqrt(self._weights * self._flexible)
        self._middle = self._forces[0], self._jumps[0], self._states[0]
        away = self._forces[1:] - self._forces[0]
        left, sizes, _ = np.linalg.svd(away * root, full_matrices=False)
        kept = sizes > SAME * self._solver.plan.options.rtol * float(np.linalg.norm(self._forces[0] * root))
        turn = (left[:, kept] / sizes[kept]).T
        self._f = turn @ away
        self._j = turn @ (self._jumps[1:] - self._jumps[0])
        self._s = turn @ (self._states[1:] - self._states[0])
        weighted = self._f * self._weights
        self._bodies = weighted @ self._j.T
        self._start = weighted @ (self._middle[1] - self._jump)
        size = len(self._f)
        self._soft = np.zeros((len(self._groups), size, size))
        self._soft_start = np.zeros((len(self._groups), size))
        for spring, group in zip(self._springs, self._of_group, strict=True):
            own = weighted[:, spring.rows] / spring.shape
            self._soft[group] += own @ self._f[:, spring.rows].T
            self._soft_start[group] += own @ self._middle[0][spring.rows]

    def _flexibility(self, values: Sequence[Array]) -> Array:
        """1 / K (n, rows), of values of the springs, each (n,)."""
        table: Array = np.ones((len(values[0]), len(self._weights)))
        for spring, value in zip(self._springs, values, strict=True):
            table[:, spring.rows] = 1.0 / (value[:, None] * spring.shape)
        return table

    # --- points -----------------------------------------------------------------------------------
    def _values(self, parameters: Sequence[SweptParameter], points: slice) -> list[Array]:
        swept = {(p.interface, p.parameter): p.values[0, points] for p in parameters}
        count = len(next(iter(swept.values())))
        return [np.ones(count) if s.given is None else swept[s.given] for s in self._springs]

    def _combined(self, values: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
        """Coefficients, forces, jumps and the bounds of the relative errors, a row per point."""
        size = len(self._f)
        soft = 1.0 / np.column_stack([values[group] for group in self._groups])
        # no direction is in the basis where the forces of all its points are alike
        summed = soft @ self._soft.reshape(len(self._groups), size * size)
        matrix = summed.reshape(len(soft), size, size) - self._bodies
        right = self._start - soft @ self._soft_start
        found = np.linalg.solve(matrix, right[..., None])[..., 0]
        forces = self._middle[0] + found @ self._f
        jumps = self._middle[1] + found @ self._j
        flexible = self._flexibility(values)
        rest = jumps - self._jump - flexible * forces
        error = (rest * rest / flexible) @ self._weights
        size = (forces * forces * flexible) @ self._weights
        return found, forces, jumps, np.sqrt(error / np.maximum(size, 1e-300))

    def solve(
        self,
        parameters: Sequence[SweptParameter],
        read: Callable[[SweepPoints, slice], Array],
    ) -> tuple[Array, Array]:
        """Values (N, quantities) and bounds of the relative errors (N,); NaN where these are too large.

        Parameters
        ----------
        read
            Points and which they are -> values.
        """
        count, rtol = parameters[0].values.shape[1], self._solver.plan.options.rtol
        errors = np.full(count, np.inf)
        self._grouped(parameters)
        if not self._ready:
            if not self._add(parameters, np.unique(np.linspace(0, count - 1, FIRST).astype(np.int64))):
                return np.full((count, 1), np.nan), errors
            self._ready = True
        tried = np.unique(np.linspace(0, count - 1, TRIED).astype(np.int64))
        trial = [replace(p, values=np.ascontiguousarray(p.values[:, tried])) for p in parameters]
        while len(self._forces) < MOST:
            found = self._combined(self._values(trial, slice(None)))[3]
            bad = np.flatnonzero(~(found <= rtol))
            if len(bad) <= FEW * len(tried):
                break
            worst = bad[np.argsort(-np.nan_to_num(found[bad], nan=np.inf))]
            step = max(1, len(worst) // (2 * ADDED))
            if not self._add(parameters, tried[worst[: step * ADDED : step]]):
                break
        parts = []
        for k in range(0, count, CHUNK):
            own = slice(k, min(k + CHUNK, count))
            found, forces, jumps, errors[own] = self._combined(self._values(parameters, own))
            parts.append(read(self._points(found, forces, jumps, errors[own]), own))
        values = np.concatenate(parts)
        values[errors > rtol] = np.nan
        return values, errors

    def _points(self, found: Array, forces: Array, jumps: Array, errors: Array) -> SweepPoints:
        count, rows = len(found), self._solver.rows
        states = (self._middle[2] + found @ self._s).reshape(count, 2, rows, 1)
        sizes = [len(np.ravel(self._solver.laws.parameter(n, "jump"))) for n in self._names]
        ends = np.cumsum(sizes)[:-1]
        by_name = [
            {n: b[:, None, :] for n, b in zip(self._names, np.split(block, ends, axis=1), strict=True)}
            for block in (forces, jumps)
        ]
        return SweepPoints.known(by_name[0], by_name[1], states, errors)
