"""What a plan will cost, in operations and bytes, before anything is factorised.

The model has two measured constants: a sparse Cholesky factor of a three-dimensional part with n unknowns
holds about 28 n^(4/3) numbers if it is a cube, 10 if it is a wall of one or two cells (its share of nodes on
the surface tells which it is), one of a two-dimensional part about 6 n log2 n; it takes about 1.3 / n times
the square of that in operations. Numbers are right within a factor of two, walls of one cell 2.5 times too
many.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import log2
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.assembly.interface import Interface, Side
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.assembly.vertices import in_thin_cells
from dolfinx_frontend.plan.reduction import members_of_bodies
from latin_core import Options

__all__ = [
    "BYTES_OF_ENTRY",
    "Body",
    "Cost",
    "LowerLevel",
    "blocks_fit",
    "bodies_of",
    "interface_unknowns",
    "lower_level",
    "predict",
    "shown",
]

_FILL_OF_CUBE, _LEAST_FILL = 28.0, 10.0
"""Numbers in the factor of a three-dimensional part over n^(4/3): of a cube, and of thin walls at least."""
_SURFACE_OF_CUBE, _POWER_OF_SURFACE = 5.4, 2.2
"""Nodes on the surface over (all nodes)^(2/3), of a cube; how the fill falls with what others have more."""
_SOLUTIONS = 60
"""That a step of the kernel's ``SparseSkeleton`` takes at most."""
_BLOCKS_BESIDE_NEWTON = 10.0
"""Blocks of all time steps that are kept beside the history of the iteration (measured)."""
_STEPS_BESIDE_NEWTON = 2
"""Depth that the history of the acceleration reaches before Newton's method takes over."""


@dataclass(frozen=True)
class Cost:
    """Predicted cost of a plan.

    Attributes
    ----------
    unknowns, active, rows
        Unknowns of all bodies, those that active interfaces touch, and rows of the interface data.
    factor_numbers
        Numbers in the sparse factors.
    factor_flops
        Operations of the factorisations.
    iteration_flops, iteration_bytes
        Operations of one iteration with all columns, and bytes that it reads.
    memory
        Bytes of the factors (dense blocks are a part of them), the operators of pairs, Newton's matrices and
        the history of the iteration.
    direct, multigrid
        Most bytes at one time, beside the matrices of the parts: with factors, and with
        ``backend="multigrid"``.
    newton_flops
        Operations of the dense flexibility and the systems of Newton's method, if it is used.
    """

    unknowns: int
    active: int
    rows: int
    factor_numbers: float
    factor_flops: float
    iteration_flops: float
    iteration_bytes: float
    memory: float
    direct: float = 0.0
    multigrid: float = 0.0
    newton_flops: float = 0.0

    def __str__(self) -> str:
        text = f"factorise {shown(self.factor_flops, 'Flop')}, memory {shown(self.memory, 'B')}"
        if self.rows:
            text += (
                f"; an iteration {shown(self.iteration_flops, 'Flop')}, "
                f"{shown(self.iteration_bytes, 'B')} read"
            )
        return text


def shown(value: float, unit: str) -> str:
    """A number with an SI prefix, e.g. ``"1.2 GFlop"``."""
    for factor, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"


def _removed(interface: Interface) -> int:
    """Unknowns that an eliminated interface takes out."""
    return len(interface.sides[0].nodes) * interface.law.removed(interface.dim)


class Body(NamedTuple):
    """A body after reduction: its unknowns, the active ones, numbers in its sparse factor and its matrix."""

    unknowns: int
    active: int
    entries: float
    matrix: int

    @property
    def flops(self) -> float:
        """Operations of the factorisation."""
        return 1.3 * self.entries**2 / self.unknowns

    def condensed(self, options: Options) -> bool:
        """Whether the kernel applies a dense factor on the active unknowns (as in its ``body.cpp``)."""
        block = float(self.active) ** 2
        cheaper = block <= 50.0 * float(self.unknowns) ** (4 / 3)
        fits = options.memory_limit <= 0 or 8.0 * block <= options.memory_limit
        automatic = options.operator == "automatic" and cheaper and fits
        return options.operator == "condensed" or automatic


def _fill(part: Substructure) -> float:
    """Unknowns of a part times the numbers in its factor over n^(4/3)."""
    surface = part.surface / (part.size / part.dim) ** (2 / 3)
    of_shape = _FILL_OF_CUBE * (_SURFACE_OF_CUBE / surface) ** _POWER_OF_SURFACE
    return float(part.size * max(of_shape, _LEAST_FILL))


def bodies_of(problem: Problem, kept: tuple[str, ...]) -> Iterator[Body]:
    """The bodies that are left if all interfaces but those kept are eliminated."""
    cut, touching = set(kept), dict[str, list[tuple[Interface, Side]]]()
    for interface in problem.interfaces.values():
        for side in interface.sides:
            touching.setdefault(side.substructure, []).append((interface, side))
    for group in members_of_bodies(problem, set(problem.interfaces).difference(kept)):
        n = whole = sum(problem.substructures[name].size for name in group)
        on_body: set[tuple[str, int]] = set()
        inside: dict[str, Interface] = {}
        for interface, side in (each for name in group for each in touching.get(name, ())):
            if interface.name in cut:
                on_body.update((side.substructure, int(node)) for node in side.nodes)
            else:
                inside[interface.name] = interface
        n -= sum(map(_removed, inside.values()))
        n = max(n, 1)
        active = min(problem.dim * len(on_body), n)
        matrix = sum(problem.substructures[name].entries for name in group)
        entries = 6.0 * n * max(log2(n), 1.0)
        if problem.dim == 3:
            entries = sum(_fill(problem.substructures[name]) for name in group) * (n / whole) * n ** (1 / 3)
            entries += 0.5 * float(active) ** 2
        entries = max(entries, 0.5 * matrix)  # a part that was condensed is dense
        yield Body(n, active, entries, matrix)


def interface_unknowns(problem: Problem, active: Iterable[str]) -> int:
    """Points times components of the active interfaces."""
    interfaces = (problem.interfaces[name] for name in active)
    return sum(i.num_points * i.law.count(i.dim) for i in interfaces)


def blocks_fit(problem: Problem, active: Iterable[str], options: Options) -> bool:
    """Whether the dense block of every body on its active unknowns is within the memory limit."""
    limit = options.memory_limit
    return limit <= 0 or all(8.0 * float(b.active) ** 2 <= limit for b in bodies_of(problem, tuple(active)))


def predict(
    problem: Problem,
    active: Iterable[str],
    columns: int,
    options: Options,
    paired: Iterable[str] = (),
    newton: bool = False,
    dense: int = 0,
) -> Cost:
    """Cost of factorising and iterating with these active interfaces.

    Parameters
    ----------
    active
        Names of the active interfaces.
    columns
        Columns of every field.
    options
        The acceleration has a history of its depth; the operators keep to the memory limit.
    paired
        Interfaces that are solved with both of their parts: a dense factor each.
    newton
        Whether Newton's method is used, with its matrices: few accelerated steps are left beside it.
    dense
        Unknowns of the interfaces of all ranks where it has their dense flexibility, else 0.
    """
    kept = tuple(active)
    unknowns = touched = rows = matrices = 0
    numbers = flops = products = of_pairs = of_newton = 0.0
    for body in bodies_of(problem, kept):
        numbers += body.entries
        flops += body.flops
        matrices += body.matrix
        block = float(body.active) ** 2
        products += 2.0 * min(block, 4.0 * body.entries)  # else the sparse factor is applied
        unknowns += body.unknowns
        touched += body.active
        if dense:  # the same body without its search direction
            of_newton += float(body.active) ** 2
    for name in kept:
        interface = problem.interfaces[name]
        rows += len(interface.sides) * interface.num_points * interface.dim
    for name in paired:
        sides = problem.interfaces[name].sides
        if len(sides) == 2:
            block = float(problem.dim * sum(len(side.nodes) for side in sides)) ** 2
            of_pairs += block
            products += 2.0 * block
            flops += block**1.5
    depth = options.acceleration if kept else 0
    # the flexibility, and the factor of a zone that is all closed
    of_newton += 2.0 * float(dense) ** 2
    if newton:
        # solutions with their forces and residuals
        of_newton += 2.0 * _SOLUTIONS * rows
        if columns > 1:
            of_newton += _BLOCKS_BESIDE_NEWTON * rows * columns
        depth = min(depth, _STEPS_BESIDE_NEWTON)
    history = 8.0 * rows * columns * (6.0 + 3.0 * depth)
    return Cost(
        unknowns=unknowns,
        active=touched,
        rows=rows,
        factor_numbers=numbers,
        factor_flops=flops,
        iteration_flops=columns * (products + rows * (20.0 + 4.0 * depth)) if rows else 0.0,
        iteration_bytes=8.0 * products / 2.0 + history if rows else 0.0,
        memory=8.0 * (numbers + of_pairs + of_newton) + history,
        direct=8.0 * (numbers + of_pairs + of_newton) + history + BYTES_OF_ENTRY * matrices,
        multigrid=_multigrid(problem, unknowns, columns) + history,
    )


BYTES_OF_ENTRY = 20.0
"""Bytes for an entry of the matrices of parts that are factorised (lower triangles, in two orders)."""
_ROW = 960.0
"""Bytes a row of the whole matrix."""
_FIELDS = 70
"""Fields that a basis has in the end (measured: 30 to 80)."""
_COPIES = 3.2
"""Matrices at one time while the one of the multigrid is made."""


class LowerLevel(NamedTuple):
    """The lower level of a multigrid of bodies: its unknowns, and numbers in its factor (0: none)."""

    unknowns: float
    entries: float


def lower_level(problem: Problem, unknowns: int) -> LowerLevel:
    """Of parts that have some unknowns together.

    The linear shape functions and all unknowns of thin cells; parts with no others are solved by aggregation.
    """
    parts = [part for part in problem.substructures.values() if part.space is not None]
    if not parts or any(int(part.space.element.basix_element.degree) < 2 for part in parts):
        return LowerLevel(0.0, 0.0)
    share = unknowns / max(sum(part.size for part in parts), 1)
    linear = entries = thin = 0.0
    for part in parts:
        bending = float(np.mean(in_thin_cells(part)))
        degree = int(part.space.element.basix_element.degree)
        linear += (1.0 - bending) * part.size / float(degree**part.dim)
        if bending > 0.0:
            thin += bending * part.size
            of_plane = 6.0 * part.size * log2(part.size)
            entries += bending * (_fill(part) * part.size ** (1 / 3) if part.dim == 3 else of_plane)
    linear *= share
    if problem.dim == 3:
        entries += 15.0 * linear ** (4.0 / 3.0)
    else:
        entries += 6.0 * linear * max(log2(max(linear, 2.0)), 1.0)
    return LowerLevel(linear + thin * share, entries)


def _multigrid(problem: Problem, unknowns: int, columns: int) -> float:
    """Bytes of a solution by multigrid: its matrix, the basis and its products, and the factor below."""
    basis = 16.0 * _FIELDS + 8.0 * 8.0 * columns
    matrix = unknowns * max(_COPIES * _ROW, 1.3 * _ROW + basis)
    return float(matrix + 8.0 * lower_level(problem, unknowns).entries)
