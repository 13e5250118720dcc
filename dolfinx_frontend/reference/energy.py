"""Distances of answers in the energy of the structure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.values import jumps, stiffnesses
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.plan.reduction import spring_jump
from dolfinx_frontend.reference.direct import ReferenceSolution
from dolfinx_frontend.scene.laws import Elastic

__all__ = ["energy_error"]


def energy_error(
    problem: Problem,
    u: Mapping[str, Array],
    reference: ReferenceSolution,
    values: dict[str, Any] | None = None,
    springs: bool = True,
) -> float:
    """Relative error in the energy norm.

    sqrt( a(u - ur) / a(ur) ) with a(v) = sum v^T K v, plus, with `springs`, sum j^T W kappa_c j
    over the elastic interfaces: j is the jump of u - ur above, the stretch j - Delta of ur below.
    kappa_c is kappa in series with the stiffness E / L of the softer neighbour.  Without that cap a
    rounding error of the jump of a very stiff interface would count as an error of the structure;
    without the springs a rigid motion would count as none.

    Parameters
    ----------
    problem
        Assembled scene.
    u
        Substructure -> displacements (n_e,).
    reference
        What to compare with.
    values
        The parameters with which the reference was solved.
    """
    laws = problem.laws(None, values)
    above = below = 0.0
    for name, s in problem.substructures.items():
        e = np.asarray(u[name]) - reference.u[name]
        above += float(e @ (s.matrix @ e))
        below += float(reference.u[name] @ (s.matrix @ reference.u[name]))
    error = {name: np.asarray(u[name]) - reference.u[name] for name in problem.substructures}
    for name, i in problem.interfaces.items():
        law = laws[name]
        if not springs or not isinstance(law, Elastic):
            continue
        parts = [problem.substructures[s.substructure] for s in i.sides]
        cap = min(p.modulus / p.length for p in parts)
        kappa = stiffnesses(i, law)
        k = i.weights[:, None] * kappa * cap / (kappa + cap)
        above += float(np.sum(k * spring_jump(problem, name, error) ** 2))
        stretch = spring_jump(problem, name, reference.u) - jumps(i, law)
        below += float(np.sum(k * stretch**2))
    if below == 0.0:
        return 0.0 if above == 0.0 else float("inf")
    return float(np.sqrt(max(above, 0.0) / below))


def energy_difference(problem: Problem, one: Any, other: Any) -> float:
    """Relative difference of two results in the strain energy of all bodies, over all times.

    Parameters
    ----------
    problem
        Assembled scene of both.
    one, other
        Results, with ``displacements`` of (n_e,) or (T, n_e); `other` is the reference.
    """
    above = below = 0.0
    for name, part in problem.substructures.items():
        exact = np.atleast_2d(other.displacements[name]).T
        error = np.atleast_2d(one.displacements[name]).T - exact
        above += float(np.sum(error * (part.matrix @ error)))
        below += float(np.sum(exact * (part.matrix @ exact)))
    return float(np.sqrt(abs(above) / below))
