"""Fields of interfaces from the meshes of one assembly to those of another: where an iteration starts."""

from __future__ import annotations

import numpy as np
from latin_core import State

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["carried"]

_NEAREST = 4
"""Points of the old interface that a value is a mean of, weighted by the inverse squares of the distances."""


def carried(old: Solver, state: State, new: Solver) -> list[State]:
    """The state of a solver on the interface points of another one of the same scene; []: it does not fit.

    Interfaces that both have keep their values; on others forces and traces are interpolated.
    """
    if not new.total_rows or old.plan.active != new.plan.active or old.plan.columns != new.plan.columns:
        return []
    data = np.zeros((new.rows, state.data.shape[1]), order="F")
    traces = np.zeros_like(data)
    for name in new.plan.active:
        if name not in new.problem.own.interfaces:
            continue
        one, other = old.problem.interfaces[name], new.problem.interfaces[name]
        first, second = old.first_rows(name), new.first_rows(name)
        own, wanted = len(old.flexibility(name)), len(new.flexibility(name))
        for start, goal in zip(first, second, strict=True):
            if goal < 0:  # the side is on another rank
                continue
            here, there = slice(start, start + own), slice(goal, goal + wanted)
            k = old.directions[here, None]
            w = np.asarray(state.traces)[here]
            f = np.asarray(state.data)[here] - k * w
            if one is not other:
                w, f = (_moved(each, one, other, wanted) for each in (w, f))
            traces[there] = w
            data[there] = f + new.directions[there, None] * w
    return [State(data, traces)]


def _moved(values: Array, old: Interface, new: Interface, rows: int) -> Array:
    """Values (rows, c) of the points of an interface at those of another one."""
    d, columns = old.dim, values.shape[1]
    field = values.reshape(old.num_points, -1, columns)
    components = field.shape[1]
    if components == d:  # frames may have turned
        field = np.einsum("mri,mrc->mic", old.frames, field)
    count = min(_NEAREST, old.num_points)
    distance, near = spatial.cKDTree(old.points).query(new.points, k=count)
    distance, near = distance.reshape(-1, count), near.reshape(-1, count)
    size = float(np.ptp(old.points, axis=0).max()) or 1.0
    weight = 1.0 / (distance**2 + (1e-6 * size) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    moved = np.einsum("mk,mkic->mic", weight, field[near])
    if components == d:
        moved = np.einsum("mri,mic->mrc", new.frames, moved)
    return np.asarray(moved.reshape(rows, columns))
