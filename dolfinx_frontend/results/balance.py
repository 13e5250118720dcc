"""What interfaces exert on the parts of an answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.results.answer import stepped
from dolfinx_frontend.scene.laws import Elimination

__all__ = ["directions_of", "eliminated", "force_of", "held_by_nodes", "nodal_forces"]


def eliminated(answer: Any, interface: Interface) -> Elimination | None:
    """How it was assembled into the parts; None: it is kept."""
    if interface.name in answer.plan.active:
        return None
    return interface.law.eliminated(interface.matching is not None)


def held_by_nodes(answer: Any, interface: Interface) -> bool:
    """Whether it holds nodes, instead of having a force at points."""
    return interface.name not in answer.plan.active and interface.law.prescribes == "jump"


def directions_of(interface: Interface) -> Array:
    """Directions (m, components, d) of the force at its points; a mean motion has one."""
    rows = np.asarray(interface.law.nominal.rows(interface)).reshape(interface.num_points, -1, interface.dim)
    return rows if interface.wrench is None else rows[:, :1]


def force_of(answer: Any, interface: Interface) -> Array:
    """(T, m, components)."""
    force = stepped(answer.force(interface.name), answer.times)
    return force if interface.wrench is None else force[..., :1]


def nodal_forces(answer: Any, interface: Interface, number: int) -> Array:
    """Nodal forces (T, n) of an interface on the part of one of its sides."""
    rows, force = directions_of(interface), force_of(answer, interface)
    at_points = np.einsum("m,tmk,mkd->tmd", interface.weights, force, rows).reshape(len(force), -1)
    return np.asarray((1.0 - 2.0 * number) * (csr(interface.sides[number].trace).T @ at_points.T).T)
