"""Interfaces of a problem as their answers see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.values import resolve
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.plan.translate import law_fields
from dolfinx_frontend.results.answer import Surface
from dolfinx_frontend.scene.laws import Contact, Elastic, Law, Preload

__all__ = ["surface_of"]


def surface_of(interface: Interface, times: Array | None) -> Surface:
    """An interface with its law, of an answer at these times."""
    law = interface.law
    rows = law_fields(interface, law.nominal).frames
    return Surface(
        interface.name,
        type(law).__name__,
        interface.points,
        interface.weights,
        interface.normals,
        rows.reshape(interface.num_points, -1, interface.dim),
        isinstance(law, Contact),
        _tightened(interface, times),
    )


def _tightened(interface: Interface, times: Array | None) -> int | None:
    """The step of a history that ends the tightening of a bolt; None if the interface is none."""
    law = interface.law
    if times is None or not _is_bolt(law):
        return None
    if isinstance(law, Preload):
        controlled = [k for k, t in enumerate(times) if law.controlled(t)]
        if law.until is None and law.during is None:
            return _settled([resolve(law.at(t).force, interface, 1, name="force") for t in times])
        return controlled[-1] if controlled else 0
    d = interface.dim
    return _settled([resolve(law.at(t).parameters()["jump"], interface, d, "first", "jump") for t in times])


def _settled(values: Sequence[Array]) -> int:
    """The first step from which nothing changes any more."""
    last = len(values) - 1
    while last > 0 and np.array_equal(values[last - 1], values[last]):
        last -= 1
    return last


def _is_bolt(law: Law) -> bool:
    if isinstance(law, Preload):
        return True
    if not isinstance(law, (Elastic, Contact)):
        return False
    try:
        return bool(np.any(np.asarray(law.jump, dtype=np.float64)))
    except (TypeError, ValueError):
        return True
