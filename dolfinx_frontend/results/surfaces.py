"""Interfaces of a problem as their answers see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.kernel.bridge import active_fields
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.answer import Surface
from dolfinx_frontend.results.contact import BondValues, ContactValues, bond_values, contact_values
from dolfinx_frontend.scene.laws import Fields

__all__ = ["law_contact", "law_values", "surface_of"]


def surface_of(interface: Interface, times: Array | None) -> Surface:
    """An interface with its law, of an answer at these times."""
    law = interface.law
    rows = law.nominal.fields(interface).frames
    return Surface(
        interface.name,
        law.title,
        interface.points,
        interface.weights,
        interface.normals,
        rows.reshape(interface.num_points, -1, interface.dim),
        law.unilateral,
        None if times is None else law.tightened(interface, times),
        interface.wrench,
        interface.places,
        interface.mean_normals,
    )


def law_contact(problem: Problem, plan: Plan, name: str) -> ContactValues | None:
    """Values of a contact at all times; None: it is none."""
    values = law_values(problem, plan, name)
    return values if isinstance(values, ContactValues) else None


def law_values(
    problem: Problem,
    plan: Plan,
    name: str,
    samples: int = 1,
    sampled: Callable[[Fields], Mapping[str, Array]] | None = None,
) -> ContactValues | BondValues | None:
    """Values of a contact or a bond at all times; None: it is neither.

    Parameters
    ----------
    samples, sampled
        Their number, and the fields of the law with its own values -> its parameters at the samples,
        (rows, samples * steps), steps fastest; None: those of the law.
    """
    interface = problem.interfaces[name]
    if not (interface.law.unilateral or interface.law.softens):
        return None
    fields = active_fields(interface, plan)
    parameters = fields.parameters if sampled is None else sampled(fields)
    if interface.law.softens:
        components = interface.law.count(interface.dim)
        return bond_values(parameters, interface.num_points, samples, components)
    return contact_values(parameters, interface.num_points, samples)
