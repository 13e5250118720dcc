"""Interfaces of a problem as their answers see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.values import resolve
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.translate import LawFields, law_fields
from dolfinx_frontend.results.answer import Surface
from dolfinx_frontend.results.contact import ContactValues, contact_values
from dolfinx_frontend.scene.laws import Contact, Elastic, Law, Preload

__all__ = ["law_contact", "surface_of"]


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


def law_contact(
    problem: Problem,
    plan: Plan,
    name: str,
    samples: int = 1,
    sampled: Callable[[LawFields], Mapping[str, Array]] | None = None,
) -> ContactValues | None:
    """Values of a contact at all times; None: it is none.

    Parameters
    ----------
    samples, sampled
        Their number, and the fields of the law with its own values -> its parameters at the samples,
        (rows, samples * steps), steps fastest; None: those of the law.
    """
    interface = problem.interfaces[name]
    if not isinstance(interface.law, Contact):
        return None
    fields = active_fields(interface, plan)
    parameters = fields.parameters if sampled is None else sampled(fields)
    return contact_values(parameters, interface.num_points, samples)


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
