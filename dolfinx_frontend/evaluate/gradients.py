"""Derivatives of a solved point with respect to its inputs, by the implicit function theorem.

A converged point has r(s, w(s, x), x) = 0: the residual r of the laws, the data s, the traces w that the
bodies answer. Where no point of an interface changes its status, so that r is smooth,

    (dr/ds + dr/dw G) ds/dx = -dr/dx - dr/dw dw/dx,     G ds = dw/ds ds,

one linear system with as many right-hand sides as there are inputs, on the factors that the solve had; or,
where quantities are fewer, its adjoint with as many as there are of these, see :mod:`.adjoint`. Its operator
is applied by differences of the *laws*, point by point: exact up to rounding in a branch, and of second order
where a law is curved; time steps see those before them. Newton's tangent is the preconditioner, conjugate
residuals of all inputs together do the rest. The readings are then differences along the answer; no solve is
ever differenced.

At a kink (a point that just opens, starts to slip) there is no derivative: the laws leave a residual at the
predicted neighbours that is of first order instead of second, and that is flagged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from latin_core import State

from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.evaluate.adjoint import adjoint
from dolfinx_frontend.evaluate.evaluator import part_of
from dolfinx_frontend.evaluate.inputs import Inputs
from dolfinx_frontend.evaluate.points import amplitudes_at, answer_at, is_field, laws_at
from dolfinx_frontend.evaluate.readings import Read
from dolfinx_frontend.evaluate.system import BYTES, NOTHING, System, laws_at_sets
from dolfinx_frontend.kernel.solver import Solver

__all__ = ["Derivatives", "Way", "derivatives"]

Way = Literal["direct", "adjoint"]

OVERHEAD = 4
"""Columns that the derivatives of readings and laws cost as much as."""
FLAGGED = 1e-3
"""Residual at the neighbours, relative to that of no prediction, above which there is a kink."""


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
    way
        Whether there was one for each input, or one for each quantity.
    """

    values: Array
    kinks: Flags
    places: tuple[str, ...]
    residual: float
    way: Way = "direct"


def derivatives(
    solver: Solver,
    inputs: Inputs,
    x: Array,
    state: State,
    read: Read,
    quantities: int,
    way: Way | None = None,
) -> Derivatives:
    """Derivatives of readings at a solved point; collective.

    Either with a linear system for each input, or with one for each quantity.

    Parameters
    ----------
    x
        (inputs,).
    state
        Converged there.
    read
        An answer at points, and these (N, inputs) -> readings (N, quantities).
    quantities
        Their number.
    way
        None: what has fewer columns. Kinks, several ranks and readings of very many numbers have no adjoint.
    """
    steps = inputs.steps(x)
    if way == "adjoint" or (way is None and quantities + OVERHEAD < len(x)):
        found = adjoint(solver, inputs, x, state, read, steps)
        if found is not None:
            none: Flags = np.zeros(len(x), dtype=bool)
            return Derivatives(found[0], none, ("",) * len(x), found[1], "adjoint")
    columns = solver.plan.amplitudes.shape[1]
    numbers = 6.0 * 8.0 * max(solver.total_rows, 1) * columns
    at_once = max(1, int(BYTES / numbers))
    parts = [
        _some(solver, inputs, x, state, read, range(k, min(k + at_once, len(x))), steps)
        for k in range(0, len(x), at_once)
    ]
    return Derivatives(
        np.concatenate([each.values for each in parts], axis=1),
        np.concatenate([each.kinks for each in parts]),
        tuple(place for each in parts for place in each.places),
        max(each.residual for each in parts),
    )


def _some(
    solver: Solver,
    inputs: Inputs,
    x: Array,
    state: State,
    read: Read,
    which: Sequence[int],
    steps: Array,
) -> Derivatives:
    """As `derivatives`, with respect to some of the inputs."""
    count, plan = len(which), solver.plan
    columns = plan.amplitudes.shape[1]
    around, widths = inputs.around(x, which, steps)
    parameters = inputs.parameters(plan, np.vstack([around, x]))
    here, there = part_of(parameters, slice(2 * count, None)), part_of(parameters, slice(0, 2 * count))
    laws, laws_there = laws_at(solver, solver.laws, here), laws_at(solver, solver.laws, there)
    # interfaces ask for no stiffness, and fields of it at several points are many factorisations
    laws_of_faces = laws_there
    if any(is_field(each) for each in there):
        faces = [each for each in there if not is_field(each)]
        laws_of_faces = (
            laws_at(solver, solver.laws, faces) if faces else laws_at_sets(solver, solver.laws, 2 * count)
        )
    loads_there = amplitudes_at(plan, there)
    system = System(solver, laws, state, amplitudes_at(plan, here), columns)

    data = np.asfortranarray(np.tile(state.data, (1, 2 * count)))
    if solver.total_rows:
        traces = solver.global_stage(laws_there, data, loads_there)
        moved = solver.local_stage(laws_of_faces, data, traces)
        scale = np.repeat(widths, columns)
        right = (moved[:, : count * columns] - moved[:, count * columns :]) / (2.0 * scale)
        slopes, residual = system.solve(right, np.repeat(widths, columns))
        change = slopes * scale
        data = np.asfortranarray(data + np.hstack([change, -change]))
    else:
        residual, right = 0.0, np.zeros((0, count * columns))
    traces = solver.global_stage(laws_there, data, loads_there) if solver.total_rows else data
    answer = answer_at(solver.problem, solver, laws_of_faces, data, traces, there)
    values = read(answer, around)
    kinks: Flags = np.zeros(count, dtype=bool)
    places = [""] * count
    if solver.total_rows:
        left = solver.local_stage(laws_of_faces, data, traces) - np.tile(system.residual, (1, 2 * count))
        ends = np.hstack([np.abs(change)] * 2), np.hstack([np.abs(right)] * 2), np.abs(left)
        changed, asked, away = (system.sets(each).reshape(2, count).max(axis=0) for each in ends)
        size = changed + widths * asked
        kinks = (size > NOTHING * system.size) & (away > FLAGGED * size)
        places = system.places(left.reshape(len(left), 2, count, columns), kinks)
    quotients = (values[:count] - values[count:]) / (2.0 * widths[:, None])
    return Derivatives(np.ascontiguousarray(quotients.T), kinks, tuple(places), residual)
