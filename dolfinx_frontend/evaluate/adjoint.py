"""Derivatives of few quantities with respect to many inputs: one linear system for each quantity.

With A = dr/ds + dr/dw G of :mod:`.gradients`, dq/dx = q_x - <l, r_x> where A* l is the derivative of q with
respect to the data, all at fixed data; products are those of forces and traces, summed with the areas. The
bodies are their own adjoints. A law is a slope R of its force by the free jump, at every point and over its
history, and with e = +-1 on the two sides

    A = -(1 + N H),     A* = -(1 + H N'),     N = k - 2 e R e',     H = 1 / k - 2 G,
    A*^-1 = -(1 - H (1 + N' H)^-1 N'):

the same system with all slopes transposed, which friction and history are not indifferent to, and the same
tangent as a preconditioner, transposed as well. The slopes are differences of the laws at every point. Where
these see a kink, and where the product of both ways with random data differs, there is no adjoint.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from latin_core import Laws, State, SweptParameter

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.evaluate.inputs import Inputs
from dolfinx_frontend.evaluate.points import amplitudes_at, is_field, laws_at
from dolfinx_frontend.evaluate.readings import Leaf, Read, Readings
from dolfinx_frontend.evaluate.system import BYTES, NOTHING, REACH, System, laws_at_sets
from dolfinx_frontend.kernel.bridge import initial_stretches
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.results.acting import STIFFNESS

__all__ = ["adjoint"]

_log = logging.getLogger(__name__)

BENT = 0.05
"""Difference of the slopes of a law to both sides, relative to its largest, above which there is a kink."""
FLAGGED = 1e-3
"""Second difference of the residuals along an input, relative to the first, above which there is one."""
NEARER = 1e-10
"""Residual of the systems where there is a preconditioner: no rounding of differences is in its way."""
MOST_SLOPES = 5e7
"""Of all laws: each step by each step before it."""
PROVEN = 1e-6
"""What the products of both ways may differ by, relative to them."""


def adjoint(
    solver: Solver, inputs: Inputs, x: Array, state: State, read: Read, steps: Array
) -> tuple[Array, float] | None:
    """Derivatives (quantities, inputs) at a solved point, and the relative residual of the systems.

    None where there is no adjoint: several ranks, a kink, a reading of too many numbers, a history of many
    steps.

    Parameters
    ----------
    steps
        (inputs,) of the difference quotients of laws and loads.
    """
    if solver.problem.comm is not None or not solver.total_rows or np.any(solver.weights <= 0.0):
        return None
    columns = solver.plan.amplitudes.shape[1]
    rows = {name: len(solver.flexibility(name)) for name in solver.plan.active}
    of_points = [rows[name] ** 2 / solver.problem.interfaces[name].num_points for name in rows]
    if sum(of_points) * columns**2 > MOST_SLOPES:
        _log.info("derivatives: no adjoint, the slopes of laws over %d steps are too many", columns)
        return None
    parameters = inputs.parameters(solver.plan, x[None])
    laws, amplitudes = laws_at(solver, solver.laws, parameters), amplitudes_at(solver.plan, parameters)
    system = _Adjoint(solver, laws, state, amplitudes, parameters)
    if system.bent or not system.proven():
        why = "a kink" if system.bent else "the laws of a point depend on other points"
        _log.info("derivatives: no adjoint, %s", why)
        return None
    here = State(system.data, system.traces)
    readings = Readings(solver, laws, here, amplitudes, parameters, x, read)
    if readings.slopes is None:
        _log.info("derivatives: no adjoint, a reading of too many numbers or with a kink")
        return None
    if not system.multiply(readings.slopes, len(readings.values)):
        return None
    values = np.zeros((len(readings.values), len(x)))
    for points in _pieces(len(x), state.data.size):
        along = _Along(system, inputs, x, points, steps)
        if along.bent:
            _log.info("derivatives: no adjoint, a kink along an input")
            return None
        values[:, points] = along.derivatives(readings)
    return values, system.left


def _pieces(count: int, size: int) -> Iterator[Ints]:
    """Numbers of inputs, as many at a time as states of their neighbours fit into memory."""
    most = max(1, int(BYTES / (6.0 * 8.0 * max(size, 1))))
    return (np.arange(k, min(k + most, count)) for k in range(0, count, most))


class _Adjoint(System):
    """The system with transposed slopes; a solution makes that of the adjoint.

    Attributes
    ----------
    bent
        Whether a law has a kink at the state.
    multipliers
        (rows, quantities * columns) of the residuals.
    cells
        Part whose stiffness is a field -> derivatives (quantities, cells) by its factors.
    left
        Largest relative residual.
    """

    TRANSPOSED = True
    idle = 64

    def __init__(
        self,
        solver: Solver,
        laws: Laws,
        state: State,
        amplitudes: Array,
        parameters: Sequence[SweptParameter],
    ) -> None:
        super().__init__(solver, laws, state, amplitudes, solver.plan.amplitudes.shape[1])
        self.amplitudes = amplitudes
        self.fields = [each for each in parameters if is_field(each)]
        self.others = [each for each in parameters if not is_field(each)]
        self.left = 0.0
        self.cells: dict[str, Array] = {}
        if self.tangent is not None:
            self.near = NEARER
        self.sides: dict[str, tuple[slice, ...]] = {}
        for name in solver.plan.active:
            size = len(solver.flexibility(name))
            self.sides[name] = tuple(slice(first, first + size) for first in solver.first_rows(name))
        self.bent = False
        self.slopes = self._slopes()

    def _slopes(self) -> dict[str, Array]:
        """Slopes (points, numbers, numbers) of forces by free jumps; a number is a component in a column."""
        interfaces = self.solver.problem.interfaces
        components = {name: self._components(name) for name in self.sides}
        k = self.solver.directions
        found: dict[str, Array] = {}
        away = np.zeros(self.solver.rows)
        for name, sides in self.sides.items():
            of_data = np.abs(self.data[sides[0]]).max(initial=0.0)
            size = max(of_data, (k[sides[0], None] * np.abs(self.traces[sides[0]])).max(initial=0.0))
            away[sides[0]] = REACH * (size or self.size)
            numbers = components[name] * self.columns
            found[name] = np.zeros((interfaces[name].num_points, numbers, numbers))
        changes = [(c, j) for j in range(self.columns) for c in range(max(components.values()))]
        most = max(1, int(BYTES / (8.0 * 8.0 * self.data.size)))
        sizes = dict.fromkeys(found, 0.0)
        kinks = dict.fromkeys(found, 0.0)
        for first in range(0, len(changes), most):
            some = changes[first : first + most]
            laws, _ = self.repeated(len(some))
            change: Array = np.zeros((self.solver.rows, len(some), self.columns))
            for number, (component, column) in enumerate(some):
                for name, sides in self.sides.items():
                    rows = np.arange(sides[0].start + component, sides[0].stop, components[name])
                    if component < components[name]:
                        change[rows, number, column] = away[rows]
            change = change.reshape(len(change), -1)
            data, traces = (np.tile(each, (1, len(some))) for each in (self.data, self.traces))
            now = np.tile(self.residual, (1, len(some)))
            ends = [
                sign * (self._at(laws, data + sign * change, traces) - now) + 2.0 * change
                for sign in (1.0, -1.0)
            ]
            for name, sides in self.sides.items():
                c, points = components[name], interfaces[name].num_points
                scale = (0.5 * k[sides[0]] / away[sides[0]])[:, None]
                above, below = (
                    (each[sides[0]] * scale).reshape(points, c, len(some), self.columns) for each in ends
                )
                kinks[name] = max(kinks[name], float(np.abs(above - below).max(initial=0.0)))
                mean = 0.5 * (above + below)
                sizes[name] = max(sizes[name], float(np.abs(mean).max(initial=0.0)))
                for number, (component, column) in enumerate(some):
                    if component < c:
                        block = mean[:, :, number].transpose(0, 2, 1).reshape(points, -1)
                        found[name][:, :, column * c + component] = block
        for name in found:
            noise = 1e-6 / float(self.solver.flexibility(name).min())  # of laws without a slope
            self.bent |= kinks[name] > max(BENT * sizes[name], noise)
        return found

    def _at(self, laws: Laws, data: Array, traces: Array) -> Array:
        return self.solver.local_stage(laws, np.asfortranarray(data), np.asfortranarray(traces))

    def _components(self, name: str) -> int:
        return len(self.solver.flexibility(name)) // self.solver.problem.interfaces[name].num_points

    def _of_points(self, name: str, block: Array) -> Array:
        """(size, sets * columns) -> (points, columns * components, sets)."""
        c = self._components(name)
        shaped = block.reshape(-1, c, block.shape[1] // self.columns, self.columns).transpose(0, 3, 1, 2)
        return shaped.reshape(len(shaped), -1, shaped.shape[3])

    def _of_rows(self, name: str, block: Array) -> Array:
        """(points, columns * components, sets) -> (size, sets * columns)."""
        c = self._components(name)
        shaped = block.reshape(len(block), self.columns, c, -1).transpose(0, 2, 3, 1)
        return shaped.reshape(len(block) * c, -1)

    def _transposed(self, name: str, jumps: Array) -> Array:
        """R' of an interface times (size, sets * columns)."""
        product = np.matmul(self.slopes[name].transpose(0, 2, 1), self._of_points(name, jumps))
        return self._of_rows(name, product)

    def _between(self, block: Array) -> Array:
        """N' times (rows, sets * columns)."""
        found: Array = self.solver.directions[:, None] * block
        for name, sides in self.sides.items():
            apart = block[sides[0]] if len(sides) == 1 else block[sides[0]] - block[sides[1]]
            force = 2.0 * self._transposed(name, apart)
            for side, sign in zip(sides, (-1.0, 1.0), strict=False):
                found[side] += sign * force
        return found

    def _bodies(self, block: Array) -> Array:
        """H times (rows, sets * columns)."""
        laws, loads = self.repeated(block.shape[1] // self.columns)
        moved = self.solver.global_stage(laws, np.asfortranarray(block), loads)
        return np.asarray(block / self.solver.directions[:, None] - 2.0 * moved)

    def apply(self, change: Array) -> Array:
        """What the system with transposed slopes does to the data (rows, sets * columns)."""
        return np.asarray(-(change + self._between(self._bodies(change))))

    def product(self, one: Array, other: Array) -> Array:
        """(rows, sets * columns) twice -> (sets, other sets)."""
        weighted = self._shaped(self.solver.weights[:, None] * one)
        return np.asarray(np.tensordot(weighted, self._shaped(other), axes=((0, 2), (0, 2))))

    def _shaped(self, block: Array) -> Array:
        return block.reshape(len(block), -1, self.columns)

    def proven(self) -> bool:
        """Whether random data agree that this is the adjoint."""
        rng = np.random.default_rng(0)
        left, right = rng.standard_normal((2, *self.data.shape))
        direct = super().apply(right)
        transposed = -(left + self._bodies(self._between(left)))
        a, b = self.product(left, direct), self.product(transposed, right)
        size = self.product(np.abs(left), np.abs(direct)).max()
        return bool(np.abs(a - b).max() <= PROVEN * size)

    def laws_of(
        self, parameters: Sequence[SweptParameter], count: int, base: Laws | None = None
    ) -> tuple[Laws, Array]:
        """Laws and amplitudes where what is no field of a stiffness is as given at some points."""
        laws = self.solver.laws if base is None else base
        if self.fields:  # one value for all columns: the bodies keep their factors
            laws = laws.with_(stiffness={each.interface: (each.values[:, :1], None) for each in self.fields})
        if parameters:
            return laws_at(self.solver, laws, parameters), amplitudes_at(self.solver.plan, parameters)
        amplitudes = np.asfortranarray(np.tile(self.amplitudes, (1, count)))
        return (laws_at_sets(self.solver, laws, count) if self.columns > 1 else laws), amplitudes

    def multiply(self, slopes: dict[Leaf, Array], count: int) -> bool:
        """Find the multipliers of quantities; whether they can be had."""
        shape = (self.solver.rows, count, self.columns)
        of_traces: Array = np.zeros(shape)
        for name, sides in self.sides.items():
            force, jump = (slopes.get((of, name, b"")) for of in ("force", "jump"))
            if force is None and jump is None:
                continue
            size = len(self.solver.flexibility(name))
            by_force, by_jump = (
                np.zeros((size, count * self.columns)) if each is None
                else each.transpose(2, 0, 1).reshape(size, -1) for each in (force, jump)
            )  # fmt: skip
            soft = self.solver.flexibility(name)[:, None]
            free = (self._transposed(name, by_force - soft * by_jump) + by_jump).reshape(size, count, -1)
            for side, sign in zip(sides, (1.0, -1.0), strict=False):
                of_traces[side] -= 2.0 * sign * free
        weights, k = self.solver.weights[:, None], self.solver.directions[:, None]
        by_traces: Array = of_traces.reshape(len(of_traces), -1) / weights
        laws, loads = self.repeated(count)
        of_data = self.solver.global_stage(laws, np.asfortranarray(by_traces), loads) - 0.5 * by_traces / k
        of_parts = self._traces_of(slopes, count)
        if of_parts is None:
            return False
        of_unknowns, fields = of_parts
        given: Array = of_data + of_unknowns
        right = -self._between(given)
        changes, self.left = self.solve(right)
        self.multipliers: Array = np.asarray(-given - self._bodies(changes))
        if self.fields:
            self._by_cells(by_traces - 2.0 * self._between(self.multipliers), fields, count)
        return True

    def _by_cells(self, data: Array, fields: dict[str, Array], count: int) -> None:
        """Derivatives by the factors of cells: work of their stresses on the adjoint displacements."""
        solver = self.solver
        laws, loads = self.repeated(count)
        data = np.asfortranarray(data)
        answer = State(data, solver.global_stage(laws, data, loads))
        virtual = solver.displacements(laws, answer, loads)
        real = solver.displacements(self.laws, State(self.data, self.traces), self.amplitudes)
        for each in self.fields:
            part = each.interface
            stretch = solver.problem.stretch(part)
            moved = virtual[part] + fields[part].reshape(len(virtual[part]), -1)
            stretched = stretch.matrix @ real[part]
            if solver.loads:
                initial = initial_stretches(solver.problem, solver.plan, part)
                stretched = stretched - initial @ self.amplitudes
            work = (stretch.matrix @ moved).reshape(-1, count, self.columns) * stretched[:, None]
            of_cells = work.reshape(len(stretch.weights), stretch.components, count, self.columns)
            self.cells[part] = -of_cells.sum(axis=(1, 3)).T

    def _traces_of(self, slopes: dict[Leaf, Array], count: int) -> tuple[Array, dict[str, Array]] | None:
        """Traces (rows, quantities * columns) under what readings of unknowns of parts weigh these with.

        As further loads of the parts, as many at once as there are loads. Beside them the displacements (n,
        quantities, columns) of the parts whose stiffness is a field.
        """
        solver = self.solver
        parts_of = solver.problem.substructures
        found: Array = np.zeros((solver.rows, count, self.columns))
        fields: dict[str, Array] = {
            each.interface: np.zeros((parts_of[each.interface].size, count, self.columns))
            for each in self.fields
        }
        forces: dict[tuple[int, int], dict[str, Array]] = {}
        for (of, part, numbers), slope in slopes.items():
            if of != "moved":
                continue
            which = np.frombuffer(numbers, dtype=np.int64)
            for quantity, column in zip(*np.nonzero(np.any(slope != 0.0, axis=2)), strict=True):
                of_parts = forces.setdefault((int(quantity), int(column)), {})
                force = of_parts.setdefault(part, np.zeros(parts_of[part].size))
                np.add.at(force, which, slope[quantity, column])
        if not forces:
            return found.reshape(len(found), -1), fields
        if not solver.loads:
            return None
        wanted = list(forces)
        for first in range(0, len(wanted), solver.loads):
            some = wanted[first : first + solver.loads]
            parts = {part for each in some for part in forces[each]}
            extra = {part: np.zeros((parts_of[part].size, solver.loads)) for part in parts}
            unit: Array = np.zeros((solver.loads, len(some), self.columns))
            for number, each in enumerate(some):
                for part, on_part in forces[each].items():
                    extra[part][:, number] = on_part
                unit[number, number, each[1]] = 1.0
            unit = np.asfortranarray(unit.reshape(solver.loads, -1))
            nothing = np.zeros((solver.rows, unit.shape[1]), order="F")
            moved, unknowns = [], []
            for base in (solver.laws.with_(extra_loads=extra), solver.laws):
                several = [replace(p, values=np.repeat(p.values, len(some), axis=1)) for p in self.others]
                laws, _ = self.laws_of(several, len(some), base)
                moved.append(solver.global_stage(laws, nothing, unit))
                if fields:
                    unknowns.append(solver.displacements(laws, State(nothing, moved[-1]), unit))
            answer = self._shaped(moved[0] - moved[1])
            away = {part: self._shaped(unknowns[0][part] - unknowns[1][part]) for part in fields}
            for number, (quantity, column) in enumerate(some):
                found[:, quantity, column] = answer[:, number, column]
                for part in fields:
                    fields[part][:, quantity, column] = away[part][:, number, column]
        return found.reshape(len(found), -1), fields


class _Along:
    """What changes along some inputs at fixed data."""

    def __init__(self, system: _Adjoint, inputs: Inputs, x: Array, which: Ints, steps: Array) -> None:
        self.system, self.count = system, len(which)
        solver, columns = system.solver, system.columns
        self.around, self.widths = inputs.around(x, which, steps)
        parameters = inputs.parameters(solver.plan, np.vstack([self.around, x]))
        self.there = [_some(each, slice(0, 2 * self.count)) for each in parameters]
        sets = 2 * self.count
        self.fields = [each for each in self.there if is_field(each)]
        others = [each for each in self.there if not is_field(each)]
        self.laws, self.loads = system.laws_of(others, sets)
        self.data = np.asfortranarray(np.tile(system.data, (1, sets)))
        self.traces = np.asfortranarray(np.tile(system.traces, (1, sets)))
        self.moving = self._moving(parameters)
        if len(self.moving):
            some = [_some(each, self.moving) for each in others]
            self.laws_moving, self.loads_moving = system.laws_of(some, len(self.moving))
            rows = (self.moving[:, None] * columns + np.arange(columns)).ravel()
            self.traces[:, rows] = solver.global_stage(
                self.laws_moving, np.asfortranarray(self.data[:, rows]), self.loads_moving
            )
            self.columns_moving = rows
        ends = solver.local_stage(self.laws, self.data, self.traces) - np.tile(system.residual, (1, sets))
        above, below = (each.reshape(len(ends), self.count, columns) for each in np.split(ends, 2, axis=1))
        self.right = (above - below) / (2.0 * self.widths[:, None])
        second = np.abs(above + below).max(axis=(0, 2), initial=0.0)
        first = np.abs(above - below).max(axis=(0, 2), initial=0.0)
        self.bent = bool(np.any((second > FLAGGED * first) & (second > NOTHING * system.size)))

    def _moving(self, parameters: Sequence[SweptParameter]) -> Ints:
        """Neighbours at which bodies move at fixed data: loads or stiffnesses change, but for fields."""
        moving: Flags = np.zeros(2 * self.count, dtype=bool)
        for each in parameters:
            if not is_field(each) and (not each.interface or each.parameter == STIFFNESS):
                moving |= np.any(each.values[:, :-1] != each.values[:, -1:], axis=0)
        return np.flatnonzero(moving)

    def derivatives(self, readings: Readings) -> Array:
        """(quantities, inputs)"""
        system, solver = self.system, self.system.solver
        values = readings.explicit(self.there, self.around)
        found = self._quotients(values.T)
        assert readings.slopes is not None  # asked before
        state = State(self.data, self.traces)
        of_laws = {name for of, name, _ in readings.slopes if of != "moved"}
        for name in of_laws:
            for of, field in zip(("force", "jump"), solver.local_fields(self.laws, name, state), strict=True):
                slope = readings.slopes.get((of, name, b""))
                if slope is not None:
                    change = self._quotients(field.reshape(len(field), -1, system.columns).swapaxes(1, 2))
                    found += np.einsum("qcr,rci->qi", slope, change)
        if len(self.moving):
            found += self._by_displacements(readings.slopes)
        for each in self.fields:
            found += system.cells[each.interface] @ self._quotients(each.values)
        return found - system.product(system.multipliers, self.right.reshape(len(self.right), -1))

    def _by_displacements(self, slopes: dict[Leaf, Array]) -> Array | float:
        solver, columns = self.system.solver, self.system.columns
        moved = {leaf: slope for leaf, slope in slopes.items() if leaf[0] == "moved"}
        if not moved:
            return 0.0
        rows = self.columns_moving
        state = State(*(np.asfortranarray(each[:, rows]) for each in (self.data, self.traces)))
        fields = solver.displacements(self.laws_moving, state, self.loads_moving)
        sets = np.zeros((len(next(iter(moved.values()))), 2 * self.count))
        for (_, part, numbers), slope in moved.items():
            which = np.frombuffer(numbers, dtype=np.int64)
            field = fields[part][which].reshape(len(which), -1, columns)
            sets[:, self.moving] += np.einsum("qcr,rsc->qs", slope, field)
        return self._quotients(sets)

    def _quotients(self, block: Array) -> Array:
        """Difference quotients (..., inputs) of what is there at the neighbours, (..., 2 * inputs)."""
        return np.asarray((block[..., : self.count] - block[..., self.count :]) / (2.0 * self.widths))


def _some(parameter: SweptParameter, points: Ints | slice) -> SweptParameter:
    return replace(parameter, values=np.ascontiguousarray(parameter.values[:, points]))
