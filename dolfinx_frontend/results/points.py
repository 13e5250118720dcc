"""What acts at the points of an interface, in global axes: the numbers behind ParaView files and figures.

Signs: the pressure is -f_n, positive where the sides press on each other; shear is the tangential force per
area on side 1; opening and slip are the normal and the tangential part of the jump w2 - w1.
"""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.results.answer import Answer, Surface, stepped
from dolfinx_frontend.results.contact import CLOSED, OPEN, SLIPS, ContactValues, contact_states, slip_use
from dolfinx_frontend.results.moments import Accumulator, of_modes

__all__ = ["fields_at_points", "interface_fields"]

ALONG = 1e-12
"""A row of a frame within this of the normal is the normal."""


def fields_at_points(
    surface: Surface, force: Array, jump: Array, contact: ContactValues | None
) -> dict[str, Array]:
    """Fields at the points by name, what a law does not have left out.

    ``pressure``, ``opening``, ``gap`` (contacts), ``state`` (contacts: 0 open, 1 closed or stick, 2 slip),
    ``slip use`` (friction: of its limit, 0 where it is open, 1 where it slips): (..., m); ``shear``,
    ``slip``: (..., m, d), global axes.

    Parameters
    ----------
    force, jump
        (..., m, components).
    """
    normals, frames = surface.normals, surface.frames

    def split(values: Array) -> tuple[Array, Array]:
        vector = surface.vectors(values)
        normal = np.einsum("...pd,pd->...p", vector, normals)
        return normal, vector - normal[..., None] * normals

    normal, shear = split(force)
    fields = {"pressure": -normal, "shear": shear}
    count, d = frames.shape[1:]
    # of a jump, what has no component is not known
    if count == d or (count == 1 and np.abs(frames[:, 0] - normals).max(initial=0.0) < ALONG):
        opening, slip = split(jump)
        fields["opening"] = opening
        if contact is not None:
            fields["gap"] = opening + contact.clearance
        if count == d:
            fields["slip"] = slip
    if contact is not None:
        size = np.linalg.norm(shear, axis=-1)
        is_open, slips = contact_states(normal, size, contact.limits)
        fields["state"] = np.where(is_open, OPEN, np.where(slips, SLIPS, CLOSED))
        if contact.limits is not None:
            fields["slip use"] = slip_use(normal, size, contact.limits)
    return fields


def interface_fields(answer: Answer, name: str) -> dict[str, Array]:
    """Fields of an interface whose force is known, (T, m) or (T, m, d); T = 1 without a history.

    Of a random answer mean and, with " std" added to the name, standard deviation: from the coefficients of a
    chaos where the law is linear, otherwise over the samples; of states the probabilities.
    """
    surface, times = answer.surface(name), answer.times
    if answer.statistics in ("value", "grid"):
        block = answer.shown()
        force, jump = (stepped(values, times, 1) for values in block.both(name))
        return {k: v[0] for k, v in fields_at_points(surface, force, jump, block.contact(name)).items()}
    out = {}
    modes = answer.modes_of(name)
    if modes is not None:
        force, jump = (stepped(values, times, 1) for values in modes)
        for field, values in fields_at_points(surface, force, jump, None).items():
            out[field], out[f"{field} std"] = of_modes(values)
        return out
    sums = Accumulator(answer.statistics != "qmc")
    for block in answer.moment_blocks():
        force, jump = (stepped(values, times, 1) for values in block.both(name))
        fields = fields_at_points(surface, force, jump, block.contact(name))
        state = fields.pop("state", None)
        if state is not None:
            fields["open probability"] = (state == OPEN).astype(np.float64)
            fields["slip probability"] = (state == SLIPS).astype(np.float64)
        sums.add(fields, block.weights)
    for field, (mean, deviation) in sums.found().items():
        out[field] = mean
        if not field.endswith("probability"):
            out[f"{field} std"] = deviation
    return out
