"""What an interface holds of the rigid motions of its parts."""

from __future__ import annotations

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import Resistance, resistance
from dolfinx_frontend.common.arrays import Flags

__all__ = ["held"]


def held(problem: Problem, interface: Interface, where: Flags | None = None) -> Resistance:
    """Rigid motions that an interface with points on this rank resists, at the points `where` (m,) only, or
    in the directions (m, r) of its :meth:`held_rows` only."""
    length = problem.parts[interface.sides[0].substructure].length
    return resistance_of(interface, length, where)


def resistance_of(interface: Interface, length: float, where: Flags | None = None) -> Resistance:
    rows = interface.law.nominal.held_rows(interface)
    if where is not None:
        rows = rows * where.reshape(len(rows), -1, 1)
    sides = tuple(side.substructure for side in interface.sides)
    return resistance(sides, interface.points, interface.weights, rows, length)
