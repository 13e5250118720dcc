"""What a way costs as a whole: processor time and memory of one solution, a chaos, a rule, or samples.

An estimate before anything is factorised, in direct solves of the same scene, whose own time is an estimate,
too. The rates below were measured on one core that multiplies matrices at 70 GFlop/s; those of other machines
follow from one product of matrices that is timed when the first price is asked for. How many iterations
contact and friction take is not known before; typical numbers are taken. ``./run bench plan`` sets prices
beside what runs took.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from math import log10, prod
from time import process_time
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.plan.cost import BYTES_OF_ENTRY, Body, bodies_of, lower_level, predict, shown
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from latin_core import Options

__all__ = ["FACTOR", "NONLINEAR", "ROW_OF_POINT", "Price", "Way", "price", "speed"]

_CORE = 70e9
"""Operations a second of a product of matrices, where the other rates were measured."""
FACTOR, _TANGENT = 29e9, 20e9
"""Operations a second of sparse factorisations, and of dense tangents of small zones."""
_READ, _READ_TOGETHER = 35e9, 25e9
"""Bytes a second of dense blocks: for several points, and for the columns of a chaos."""
_ENTRY, _PART, _FIRST = 5e-8, 1e-3, 8e-3
"""Seconds for an entry of the matrices, for a part, and once."""
_STOCHASTIC = 0.02
"""Seconds for modes or points and what is found out about them."""
ROW_OF_POINT, _ROW_OF_COLUMN = 3.5e-7, 8e-8
"""Seconds for a row of the interface data and an iteration, of a point and of a column of a chaos."""
_ROW_AT_ONCE, _ROW_OF_MODE = 5e-7, 8e-7
"""Seconds for a row where a linear scene has a tangent: of a point, and of a mode."""
_TRANSFORM = 5e9
"""Operations a second of transforms at the points of a field."""
_LAW = 4e-9
"""Seconds for a row, a quadrature point and an iteration of a nonlinear law."""
_EIGENVECTORS = 4e-10
"""Seconds for a point of a field, over the third power of the modes."""
_OF_FIELD, _ENTRY_OF_FIELD, _BYTES_OF_FIELD = 10, 5e-7, 120.0
"""Where a part has a random field: steps of conjugate gradients; seconds and bytes for an entry of its
matrix."""
_ITERATIONS, _WITH_MACRO, NONLINEAR = 40, 12, 85
"""Iterations of a chaos at a tolerance of 1e-4: of linear laws, of those with a coarse problem, of others."""
_FIRST_POINTS, _NEXT_POINT = 45, 3
"""Iterations that the first points take together, and that each takes then."""
_OF_HISTORY = 140
"""Iterations of a point with a load history: the snapshots of others help little there."""
_EXTRA, _EXTRA_STOCHASTIC = 10e6, 12e6
"""Bytes beside all fields, and those of modes or points."""
_BYTES_OF_PRODUCT = 24.0
"""Bytes for a pair of modes at a point of a field."""
_BEGINNING = 3.0
"""Bytes of the tangents of linear laws that a solver keeps for points, over dense blocks (measured)."""
_FIELDS = 40.0
"""Fields of the interfaces at one time, of a chaos."""
_NEGLIGIBLE, _AFFORDABLE, _POWER = 2e8, 0.1, 1.4
"""When the kernel makes a tangent of all active unknowns (``tangent.cpp``)."""
_SET_UP, _CYCLE, _FIELD = 1.05e-7, 8e-9, 3e-7
"""By multigrid: seconds for an entry of the matrices, once and for the cycle of a column, and for an unknown
and what is done with the field that the cycle makes."""
_AGGREGATION = 3.5
"""How many times longer these take with linear shape functions."""
_CYCLES, _CYCLES_OF_ONE, _CYCLES_OF_POINTS = 5.5, 1.5, 7.0
"""Fields of a body for a digit of the tolerance: of a chaos, of a direct solution, and of points."""
_OF_POINTS = 40
"""Answers that those of all points are combinations of."""
_BELOW = 4e9
"""Operations a second of solutions on the lower level."""
_MOST_TENSOR, _LEAST_LINE, _FEWEST_SOBOL = 4096, 16, 1024


class Way(NamedTuple):
    """What is to be run: modes of a chaos of some order, checked by some points; or points; neither: one
    solution."""

    random: RandomLaws | None = None
    modes: int = 0
    order: int = 0
    checks: int = 0
    points: int = 0


@dataclass(frozen=True)
class Price:
    """Estimated cost of a run from assembled parts to its answer.

    Attributes
    ----------
    seconds
        Processor time.
    units
        The same in direct solves of the scene: factorising all parts, and solving once.
    memory
        Most bytes at one time, beside the assembled parts.
    sure
        Whether all laws are linear, so that numbers of iterations are known.
    """

    seconds: float
    units: float
    memory: float
    sure: bool = True

    def __str__(self) -> str:
        work = "about one direct solve" if self.units < 1.05 else f"about {self.units:.2g} direct solves"
        return f"{work}, {self.seconds:.2g} s of processor time, {shown(self.memory, 'B')}"


@cache
def speed() -> float:
    """How fast this core is, relative to the one where the rates were measured."""
    size = 256
    matrix = np.ones((size, size))
    matrix @ matrix
    best = np.inf
    for _ in range(5):
        began = process_time()
        matrix @ matrix
        best = min(best, process_time() - began)
    return float(np.clip(2.0 * size**3 / max(best, 1e-6) / _CORE, 0.05, 20.0))


class _Sizes(NamedTuple):
    """What the time depends on."""

    entries: float
    numbers: float
    flops: float
    dense: float
    active: float
    tangent: bool
    build: float


def _sizes(problem: Problem, bodies: Sequence[Body]) -> _Sizes:
    own = problem.own
    entries = float(sum(part.entries for part in own.substructures.values()))
    numbers = sum(body.entries for body in bodies)
    flops = sum(body.flops for body in bodies)
    dense = 8.0 * sum(min(float(body.active) ** 2, 4.0 * body.entries) for body in bodies)
    condense = sum(float(body.active) ** 3 for body in bodies)
    reach = _AFFORDABLE * sum(body.entries**_POWER for body in bodies)
    build = _FIRST + _PART * len(own.substructures) + _ENTRY * entries + flops / FACTOR
    active = float(sum(body.active for body in bodies))
    tangent = active > 0 and condense <= max(_NEGLIGIBLE, reach)
    return _Sizes(entries, numbers, flops, dense, active, tangent, build)


def price(
    problem: Problem,
    kept: Iterable[str],
    rows: int,
    options: Options,
    way: Way,
    steps: int = 1,
    macro: bool = False,
) -> Price:
    """Estimate what a way costs.

    Parameters
    ----------
    kept
        Active interfaces.
    rows
        Rows of the interface data.
    steps
        Columns of a history.
    macro
        Whether the iteration has a coarse problem.
    """
    names = tuple(kept)
    if options.backend == "multigrid":
        return _by_multigrid(problem, names, rows, options, way, steps)
    sizes = _sizes(problem, list(bodies_of(problem.own, names)))
    curved = [n for n in names if not problem.interfaces[n].law.superposes]
    digits = log10(1.0 / options.rtol) / 4.0
    unit = sizes.build
    seconds = sizes.build
    memory = _EXTRA + BYTES_OF_ENTRY * sizes.entries + 8.0 * sizes.numbers + sizes.dense
    if curved:
        memory += 16.0 * sizes.active**2 if sizes.tangent else 0.0
    elif way.points and sizes.tangent:
        memory += _BEGINNING * sizes.dense
    if way.modes or way.points:
        seconds += _STOCHASTIC
        memory += _EXTRA_STOCHASTIC
    one = _Run(sizes, rows, steps, digits, bool(curved), macro, way.random)
    if way.modes:
        more = one.of_chaos(way, problem, names, curved)
        checks = one.of_points(way.checks) if curved and way.checks else (0.0, 0.0)
        seconds, memory = seconds + more[0] + checks[0], memory + more[1] + checks[1]
    elif way.points or curved or names:
        more = one.of_points(max(way.points, 1))
        seconds, memory = seconds + more[0], memory + more[1]
    if way.random is not None and way.random.fields:
        own = problem.own.substructures  # of this rank, as all that is counted here
        inside = float(sum(own[name].entries for name in way.random.fields if name in own))
        seconds, memory = seconds + _ENTRY_OF_FIELD * inside, memory + _BYTES_OF_FIELD * inside
    return Price(seconds / speed(), seconds / unit, memory, not curved)


def _by_multigrid(
    problem: Problem, names: Sequence[str], rows: int, options: Options, way: Way, steps: int
) -> Price:
    """As :func:`price`, with ``backend="multigrid"``."""
    bodies = list(bodies_of(problem.own, tuple(names)))
    sizes = _sizes(problem, bodies)
    columns = _OF_POINTS if way.points else max(way.modes, 1) * steps
    each = _CYCLES_OF_POINTS if way.points else _CYCLES if names else _CYCLES_OF_ONE
    cycles = each * log10(1.0 / options.rtol)
    unknowns = sum(body.unknowns for body in bodies)
    below = lower_level(problem.own, unknowns)
    seconds = (_SET_UP + cycles * _CYCLE) * sizes.entries + cycles * _FIELD * unknowns
    seconds *= 1.0 if below.unknowns else _AGGREGATION
    seconds += _FIRST + 1.3 * below.entries**2 / max(below.unknowns, 1.0) / FACTOR
    seconds += cycles * 4.0 * below.entries / _BELOW
    seconds += _ROW_AT_ONCE * rows * steps * (way.points + 10 * max(way.modes, 1))
    memory = _EXTRA + predict(problem.own, names, columns, options).multigrid
    memory += 16.0 * rows * steps * way.points
    return Price(seconds / speed(), seconds / sizes.build, memory)


class _Run(NamedTuple):
    """A run on factorised parts: seconds and bytes beside theirs."""

    sizes: _Sizes
    rows: int
    steps: int
    digits: float
    curved: bool
    macro: bool
    random: RandomLaws | None

    @property
    def _of_tangent(self) -> float:
        """Seconds of a tangent of all active unknowns."""
        return self.sizes.active**3 / 3.0 / _TANGENT

    def of_points(self, points: int) -> tuple[float, float]:
        """Seconds and bytes of points that are solved one after the other."""
        sizes, rows = self.sizes, self.rows
        kept = 16.0 * rows * self.steps * points
        if self.random is not None and self.random.fields:
            each = _ENTRY * sizes.entries + sizes.flops / FACTOR + 2e-3
            return points * each, kept + BYTES_OF_ENTRY * sizes.entries
        scaled = self.random is not None and bool(self.random.scaled)
        if sizes.tangent and not (self.curved or scaled):
            return self._of_tangent + _ROW_AT_ONCE * rows * points * self.steps, kept
        iterations = self.digits * (min(_FIRST_POINTS, 20 * points) + _NEXT_POINT * points)
        each = self._of_tangent if sizes.tangent else 0.0
        each += self.steps * (sizes.dense / _READ + ROW_OF_POINT * rows)
        if self.curved and self.steps > 1:
            iterations = self.digits * _OF_HISTORY * points
            each = sizes.dense / _READ + ROW_OF_POINT * rows
        return iterations * each, 2.0 * kept

    def of_chaos(
        self, way: Way, problem: Problem, names: Sequence[str], curved: Sequence[str]
    ) -> tuple[float, float]:
        """Seconds and bytes of a chaos."""
        sizes, rows = self.sizes, self.rows
        columns = way.modes * self.steps
        seconds, memory = 0.0, _FIELDS * 8.0 * rows * columns
        fields = {} if self.random is None else {id(s): s for s in self.random.sources.values()}
        of_fields = [source for source in fields.values() if isinstance(source, DiscretisedField)]
        if of_fields:
            steps = 2 if sizes.tangent else self.digits * (_WITH_MACRO if self.macro else _ITERATIONS)
            seconds += steps * 4.0 * rows * self.steps * way.modes**2 / _TRANSFORM
        for source in of_fields:
            seconds += _EIGENVECTORS * len(source.points) * way.modes**3
            memory += _BYTES_OF_PRODUCT * len(source.points) * way.modes**2
        if self.random is not None and self.random.fields:
            seconds += columns * _OF_FIELD * 16.0 * sizes.numbers / _READ_TOGETHER
            cells = sum(len(each.points) for each in self.random.fields.values())
            memory += 8.0 * cells * way.modes
        if not names:
            return seconds, memory
        each = sizes.dense / _READ_TOGETHER + _ROW_OF_COLUMN * rows
        if not self.curved and sizes.tangent:
            return seconds + self._of_tangent + _ROW_OF_MODE * rows * columns, memory
        if not self.curved:
            iterations = self.digits * (_WITH_MACRO if self.macro else _ITERATIONS)
            return seconds + iterations * columns * each, memory
        iterations = self.digits * NONLINEAR
        points = _points_of_law(self.random, way)
        of_laws = sum(problem.interfaces[n].num_points * problem.dim for n in curved) * points * self.steps
        seconds += iterations * (columns * each + 2.0 * _LAW * of_laws)
        seconds += iterations * self._of_tangent if sizes.tangent else 0.0
        return seconds, memory + 16.0 * of_laws


def _points_of_law(random: RandomLaws | None, way: Way) -> int:
    """Points at which a nonlinear law of a chaos is evaluated, unless told otherwise."""
    germs = 1 if random is None else random.space.dimension
    line = 2 * (way.order + 1)
    if _LEAST_LINE**germs <= 256:
        line = max(line, _LEAST_LINE)
    total = prod([line] * germs)
    return total if total <= _MOST_TENSOR else max(_FEWEST_SOBOL, _LEAST_LINE * way.modes)
