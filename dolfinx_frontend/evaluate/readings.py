"""Derivatives of numbers of an answer with respect to the fields that they are read from.

Nothing is known of a reading but that it is a function of the fields of some samples. It is asked once, and
what it asks for is written down: forces and jumps of interfaces, some unknowns of parts. Then these are
changed one number after the other, many of them side by side, as samples. No solve takes part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from latin_core import Laws, State, SweepPoints, SweptParameter

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.evaluate.points import answer_at
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.results.answer import timed
from dolfinx_frontend.results.sweep import SweepResult

__all__ = ["Leaf", "Read", "Readings"]

Read = Callable[[SweepResult, Array], Array]
"""An answer at points, and these (N, inputs) -> readings (N, quantities)."""
Leaf = tuple[str, str, bytes]
"""A field that is read: ``"force"``, ``"jump"`` or ``"moved"``, of an interface or a part, its unknowns."""

SHORT, LONG = 1e-5, 1e-3
"""Steps relative to the largest number of a field. The short one and its double make a difference of the
fourth order: a stress is small beside what one unknown adds to it. The long one has no rounding to speak of,
and is taken where the reading is linear: where both agree to `SAME`, relative to the reading and field."""
SAME = 1e-9
TRIED = 1e-3
"""Random changes that tell which groups of numbers are read at all."""
BENT = 0.05
"""Difference of the slopes to both sides, relative to the largest, above which a reading has a kink: a
minimum of equal numbers, for instance, follows all of them together and none alone."""
ROUNDING = 1e-12
"""Of readings, which may differ from one number of samples to another."""
NUMBERS = 4e6
"""Of the fields of samples that are read at once."""
MOST = 4e8
"""Of all that are read: where a reading needs more, an adjoint is no bargain."""


@dataclass(frozen=True, eq=False, repr=False)
class _Probe(SweepResult):
    """Samples of an answer whose fields are given."""

    moved: Callable[[str, Ints | None], Array] = field(kw_only=True)

    def _displacements(
        self, part: slice, states: Array | None = None
    ) -> Callable[[str, Ints | None], Array]:
        def displacement(name: str, unknowns: Ints | None) -> Array:
            self._check_part(name)
            block = self.moved(name, unknowns)[part]  # (n, columns, unknowns)
            return np.moveaxis(timed(self.plan, np.moveaxis(block, (2, 0), (0, 1))), -1, 0)

        return displacement


class _Fields(dict[str, Array]):
    """Forces or jumps by interface, with a note of what was asked for."""

    def __init__(self, of: str, every: Mapping[str, Array], note: Callable[[Leaf, Array], Array]) -> None:
        super().__init__(every)
        self.of, self.note = of, note

    def __getitem__(self, name: str) -> Array:
        return self.note((self.of, name, b""), super().__getitem__(name))


class Readings:
    """Readings at one solved point, and their derivatives.

    Attributes
    ----------
    values
        (quantities,).
    slopes
        Field -> derivatives (quantities, columns, numbers), of those that are read; None: too many numbers,
        or a kink.
    """

    def __init__(
        self,
        solver: Solver,
        laws: Laws,
        state: State,
        amplitudes: Array,
        parameters: Sequence[SweptParameter],
        x: Array,
        read: Read,
    ) -> None:
        self._solver, self._laws, self._state, self._amplitudes = solver, laws, state, amplitudes
        self._read, self._x = read, x
        self._answer = answer_at(solver.problem, solver, laws, state.data, state.traces, parameters)
        self._unknowns: dict[str, Array] = {}
        self._leaves: dict[Leaf, Array] = {}
        self.values = self._at(self._answer.parameters, x[None], {}, 1)[0]
        self.slopes = self._slopes()

    def explicit(self, parameters: Sequence[SweptParameter], x: Array) -> Array:
        """Readings (N, quantities) at points (N, inputs) with the same fields at all of them."""
        return self._at(parameters, x, {}, len(x))

    def _at(
        self, parameters: Sequence[SweptParameter], x: Array, given: Mapping[Leaf, Array], count: int
    ) -> Array:
        """Readings (count, quantities) with some fields (count, columns, numbers) as given."""

        def note(leaf: Leaf, block: Array) -> Array:
            base = self._leaves.setdefault(leaf, block[0])
            return given[leaf] if leaf in given else np.broadcast_to(base, (count, *base.shape))

        def moved(part: str, unknowns: Ints | None) -> Array:
            if not self._unknowns:
                found = self._solver.displacements(self._laws, self._state, self._amplitudes)
                self._unknowns = dict(found)
            every = self._unknowns[part].T
            numbers = np.arange(every.shape[1]) if unknowns is None else np.asarray(unknowns, dtype=np.int64)
            return note(("moved", part, numbers.astype(np.int64).tobytes()), every[None][:, :, numbers])

        points = self._answer.points
        states = points.states
        assert states is not None  # answer_at has them
        several = SweepPoints.known(
            _Fields("force", points.forces, note),
            _Fields("jump", points.jumps, note),
            np.broadcast_to(states, (count, *states.shape[1:])),
        )
        if len(x) != count:
            parameters = [replace(each, values=np.repeat(each.values, count, axis=1)) for each in parameters]
            x = np.repeat(x, count, axis=0)
        base = self._answer
        axes = {"point": np.arange(count, dtype=np.float64)}
        probe = _Probe(
            base.problem, base.plan, axes, several, {}, base.solver, base.laws, tuple(parameters), moved=moved
        )
        return self._read(probe, x)

    def _slopes(self) -> dict[Leaf, Array] | None:
        found: dict[Leaf, Array] = {}
        spent = 0.0
        data = self._state.data
        sizes = {
            "force": float(np.abs(data).max(initial=0.0)),
            "jump": float(np.abs(data / self._solver.directions[:, None]).max(initial=0.0)),
            "moved": 0.0,
        }
        for leaf, base in self._leaves.items():
            size = float(np.abs(base).max(initial=0.0)) or sizes[leaf[0]] or 1.0
            which = self._read_ones(leaf, base, size)
            spent += 6.0 * len(which) * base.size
            if spent > MOST:
                return None
            found[leaf] = np.zeros((len(self.values), base.size))
            for some in _pieces(which, 6 * base.size):
                slopes = self._slopes_of(leaf, base, size, some)
                if slopes is None:
                    return None
                found[leaf][:, some] = slopes
            found[leaf] = found[leaf].reshape(-1, *base.shape)
        return found

    def _read_ones(self, leaf: Leaf, base: Array, size: float) -> Ints:
        """Which numbers of a field may have a slope: those of a column and a component stand together."""
        columns, count = base.shape
        components = 1
        if leaf[0] != "moved":
            components = count // self._solver.problem.interfaces[leaf[1]].num_points
        group = np.arange(columns)[:, None] * components + np.arange(count)[None] % components
        group = group.ravel()
        change = TRIED * size * np.random.default_rng(0).uniform(0.5, 1.0, base.size)
        used = np.zeros(columns * components, dtype=bool)
        for some in _pieces(np.arange(len(used)), base.size):
            by = change * (group == some[:, None])
            values = self._at_fields(leaf, base + np.concatenate([by, -by]).reshape(-1, *base.shape))
            changed = np.abs(values - self.values) > ROUNDING * np.abs(self.values)
            used[some] |= changed.any(axis=1).reshape(2, -1).any(axis=0)
        return np.flatnonzero(used[group])

    def _slopes_of(self, leaf: Leaf, base: Array, size: float, which: Ints) -> Array | None:
        """Derivatives (quantities, which) with respect to some numbers of a field; None: there is a kink."""
        steps = size * np.array([SHORT, -SHORT, 2.0 * SHORT, -2.0 * SHORT, LONG, -LONG])
        samples = np.tile(base.ravel(), (len(steps), len(which), 1))
        samples[:, np.arange(len(which)), which] += steps[:, None]
        taken = samples[:, np.arange(len(which)), which] - base.ravel()[which]  # as they are in the end
        values = self._at_fields(leaf, samples.reshape(-1, *base.shape))
        away = values.reshape(len(steps), len(which), -1) - self.values
        above, below = (away[k] / taken[k, :, None] for k in (0, 1))
        near, far, long = ((away[k] - away[k + 1]) / (taken[k] - taken[k + 1])[:, None] for k in (0, 2, 4))
        short = near + (near - far) / 3.0
        largest = np.maximum(np.abs(above), np.abs(below)).max(axis=0, initial=0.0)
        rounding = ROUNDING * np.abs(self.values) / (SHORT * size)
        if np.any(np.abs(above - below) > BENT * largest + rounding):
            return None
        scale = np.maximum(np.abs(self.values), np.abs(long * size).max(axis=0, initial=0.0)) / size
        found: Array = np.where(np.abs(short - long) <= SAME * scale, long, short)
        return found.T

    def _at_fields(self, leaf: Leaf, samples: Array) -> Array:
        return self._at(self._answer.parameters, self._x[None], {leaf: samples}, len(samples))


def _pieces(numbers: Any, size: int) -> Iterator[Ints]:
    """Numbers, as many at a time as samples of this size fit into the cache."""
    most = max(1, int(NUMBERS / max(size, 1)))
    return (numbers[k : k + most] for k in range(0, len(numbers), most))
