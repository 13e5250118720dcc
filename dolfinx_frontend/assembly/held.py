"""What an interface holds of the rigid motions of its parts."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import Resistance, resistance
from dolfinx_frontend.assembly.values import stiffnesses
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.scene.laws import Displacement, Elastic

__all__ = ["held"]


def held(problem: Problem, interface: Interface, where: Flags | None = None) -> Resistance:
    """Rigid motions that an interface with points on this rank resists, at the points `where` (m,) only."""
    length = problem.parts[interface.sides[0].substructure].length
    return resistance_of(interface, length, where)


def resistance_of(interface: Interface, length: float, where: Flags | None = None) -> Resistance:
    rows = _held_rows(interface)
    if where is not None:
        rows = rows * where[:, None, None]
    sides = tuple(side.substructure for side in interface.sides)
    return resistance(sides, interface.points, interface.weights, rows, length)


def _held_rows(interface: Interface) -> Array:
    """(m, r, d): directions in which the interface holds at each point, in global components."""
    law, d = interface.law.nominal, interface.dim
    m = interface.num_points
    if isinstance(law, Displacement):
        return np.tile(np.eye(d)[list(law.axes(d))], (m, 1, 1))
    rows = interface.frames[:, list(np.flatnonzero(law.holds(d))), :].copy()
    if isinstance(law, Elastic):
        kappa = stiffnesses(interface, law)[:, list(np.flatnonzero(law.holds(d)))]
        rows *= kappa[:, :, None] > 0.0
    return rows
