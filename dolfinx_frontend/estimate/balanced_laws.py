"""What laws of interfaces add to a bound of the energy: twice what Fenchel's inequality leaves of them.

For a law with an energy phi of the jump j and its conjugate phi* of the force f, phi(j) + phi*(f) - f . j >=
0, and 0 where the law holds. Contact asks for pressures that never pull and openings that are never negative,
everywhere and not at nodes only: polynomials are judged by their Bernstein coefficients, in whose convex hull
they lie.
"""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.estimate.balanced_faces import OnFace
from dolfinx_frontend.estimate.balanced_parts import SETTINGS
from dolfinx_frontend.scene.laws import Law

__all__ = ["contact_pressure", "gap_of_contact", "gap_of_friction", "gap_of_springs"]


def gap_of_springs(
    interface: Interface, law: Law, face: OnFace, traction: Array, jump: Array
) -> tuple[float, str]:
    """int (t - k j) . (t - k j) / k dA of tractions and jumps (m, d) at points; and why it is not known."""
    fields = law.fields(interface)
    stiffness = [np.ravel(fields.parameters[each]) for each in ("normal", "tangential")]
    given = fields.parameters.get("jump")
    varies = any(np.ptp(k) > SETTINGS.rounding * k.max() for k in stiffness)
    if varies or (given is not None and np.any(given)):
        return 0.0, f"the springs of {interface.name!r} are not the same everywhere"
    found = 0.0
    along = [np.sum(v * face.normals, axis=1, keepdims=True) for v in (traction, jump)]
    across = [v - c * face.normals for v, c in zip((traction, jump), along, strict=True)]
    for known, force, j in zip(stiffness, (along[0], across[0]), (along[1], across[1]), strict=True):
        k = float(known[0])
        if k > 0.0:
            found += float(face.weights @ np.sum((force - k * j) ** 2, axis=1)) / k
    return found, ""


def contact_pressure(face: OnFace, nodal: Array, rests: bool) -> Array | None:
    """Normal tractions (nodes,), so changed that none pulls and the resultant stays: the nearest of all;
    None: there is none. Where both sides rest on supports these can
    take what is lost.

    The least sum of squares of changes of coefficients, by Newton's method on its dual problem.
    """
    values = face.hull.coefficients(nodal)
    nodes = np.unique(face.nodes)
    largest = np.abs(values).max(initial=0.0)
    if values.max(initial=0.0) <= SETTINGS.rounding * largest:
        return nodal
    places = face.linear(face.places[nodes])  # (nodes, d)
    resultant = face.integrals(nodes)  # (d, nodes)
    wanted, own = resultant @ values[nodes], values[nodes]
    room = np.abs(resultant[0])  # what a coefficient stands for
    size = room.sum() * largest
    factors = np.zeros(len(wanted))
    for _ in range(SETTINGS.rounds):
        found = np.minimum(own + places @ factors, 0.0)
        off = wanted - resultant @ found
        if np.abs(off).max() <= SETTINGS.rounding**2 * size:
            out = np.zeros_like(nodal)
            out[nodes] = found
            return face.hull.values(out)
        active = found < 0.0
        slope = resultant[:, active] @ places[active]
        factors = factors + np.linalg.lstsq(slope, off, rcond=None)[0]
    return face.hull.values(np.minimum(values, 0.0)) if rests else None


def gap_of_contact(face: OnFace, normal: Array, opening: Array, compliance: float) -> float:
    """2 int c/2 (f - min(g, 0)/c)^2 - f max(g, 0) dA of forces and openings (m,); rigid: -2 int f g."""
    rest = -2.0 * normal * np.maximum(opening, 0.0)
    if compliance > 0.0:
        rest = rest + compliance * (normal - np.minimum(opening, 0.0) / compliance) ** 2
    return float(face.weights @ rest)


def gap_of_friction(face: OnFace, bound: Array, traction: Array, slip: Array) -> tuple[float, bool]:
    """2 int b |s| - t . s dA of bounds (m,), tangential tractions and slips (m, d); and whether b holds."""
    size, shear = np.linalg.norm(slip, axis=1), np.linalg.norm(traction, axis=1)
    rest = bound * size - np.sum(traction * slip, axis=1)
    holds = bool(np.all(shear <= bound + SETTINGS.rounding * shear.max(initial=0.0)))
    return 2.0 * float(face.weights @ np.maximum(rest, 0.0)), holds
