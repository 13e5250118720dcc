"""What a plan will cost, in operations and bytes, before anything is factorised.

The model has two measured constants: a sparse Cholesky factor of a three-dimensional part with n
unknowns holds about 15 n^(4/3) numbers (10 for walls of one or two cells, 22 for a cube), one of a
two-dimensional part about 6 n log2 n; it takes about 1.3 / n times the square of that in operations.
So numbers are right within a factor of two and operations, for walls ordered on their nodes, up to 2.5
times too many, which is enough to choose between dense and sparse, few and many columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import log2

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.plan.reduction import members_of_bodies

__all__ = ["Cost", "predict", "shown"]


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
        Bytes of the factors, the dense blocks and the history of the iteration.
    """

    unknowns: int
    active: int
    rows: int
    factor_numbers: float
    factor_flops: float
    iteration_flops: float
    iteration_bytes: float
    memory: float

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


def predict(
    problem: Problem,
    active: Iterable[str],
    columns: int,
    depth: int,
    paired: Iterable[str] = (),
) -> Cost:
    """Cost of factorising and iterating with these active interfaces.

    Parameters
    ----------
    active
        Names of the active interfaces.
    columns
        Columns of every field.
    depth
        Depth of the acceleration, whose history is kept.
    paired
        Interfaces that are solved with both of their parts: a dense factor each.
    """
    kept = tuple(active)
    unknowns = touched = rows = 0
    numbers = flops = products = dense = 0.0
    for group in members_of_bodies(problem, set(problem.interfaces).difference(kept)):
        n = sum(problem.substructures[name].size for name in group)
        on_body: set[tuple[str, int]] = set()
        for name, interface in problem.interfaces.items():
            mine = [s for s in interface.sides if s.substructure in group]
            if name in kept:
                for side in mine:
                    on_body.update((side.substructure, int(node)) for node in side.nodes)
            elif mine:
                n -= _removed(interface)
        n = max(n, 1)
        active_unknowns = min(problem.dim * len(on_body), n)
        entries = 15.0 * n ** (4 / 3) if problem.dim == 3 else 6.0 * n * max(log2(n), 1.0)
        numbers += entries
        flops += 1.3 * entries**2 / n
        block = float(active_unknowns) ** 2
        block = min(block, 4.0 * entries)  # else the sparse factor is applied
        dense += block
        products += 2.0 * block
        unknowns += n
        touched += active_unknowns
    for name in kept:
        interface = problem.interfaces[name]
        rows += len(interface.sides) * interface.num_points * interface.dim
    for name in paired:
        sides = problem.interfaces[name].sides
        if len(sides) == 2:
            block = float(problem.dim * sum(len(side.nodes) for side in sides)) ** 2
            dense += block
            products += 2.0 * block
            flops += block**1.5
    history = 8.0 * rows * columns * (6.0 + 3.0 * depth)
    return Cost(
        unknowns=unknowns,
        active=touched,
        rows=rows,
        factor_numbers=numbers,
        factor_flops=flops,
        iteration_flops=columns * (products + rows * (20.0 + 4.0 * depth)) if rows else 0.0,
        iteration_bytes=8.0 * products / 2.0 + history if rows else 0.0,
        memory=8.0 * (numbers + dense) + history,
    )
