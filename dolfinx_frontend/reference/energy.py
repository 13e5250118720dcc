"""Distances of answers in the energy of the structure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_known
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.reduction import spring_jump

__all__ = ["energy_difference", "energy_error"]


def energy_error(
    problem: Problem,
    u: Mapping[str, Array],
    exact: Mapping[str, Array],
    values: dict[str, Any] | None = None,
    springs: bool = True,
) -> float:
    """Relative error in the energy norm.

    sqrt( a(u - ur) / a(ur) ) with a(v) = sum v^T K v, plus, with `springs`, sum j^T W kappa_c j
    over the elastic interfaces: j is the jump of u - ur above, the stretch j - Delta of ur below.
    kappa_c is kappa in series with the stiffness E / L of the softer neighbour.  Without that cap a
    rounding error of the jump of a very stiff interface would count as an error of the structure;
    without the springs a rigid motion would count as none.

    Of displacement modes, a sums over all of them, with the mean stiffness of the interfaces; the mean of
    an imposed jump belongs to the first mode.

    Parameters
    ----------
    problem
        Assembled scene.
    u, exact
        Substructure -> displacements (n_e,), or modes (n_e, P + 1) on the same basis, of which those that
        one of the two lacks at the end count as 0; `exact` is what to compare with.
    values
        The parameters with which `exact` was computed.
    """
    check_is_problem("energy_error", problem)
    for what, group in (("u", u), ("exact", exact)):
        check_kind("energy_error", what, group, Mapping, "give {part: displacements}")
        for name in problem.substructures:
            check_known("part", name, group, f"energy_error: {what}")
    columns = max(_columns(v).shape[1] for group in (u, exact) for v in group.values())

    def padded(group: Mapping[str, Array], name: str) -> Array:
        modes = _columns(group[name])
        return np.pad(modes, ((0, 0), (0, columns - modes.shape[1])))

    right = {name: padded(exact, name) for name in problem.substructures}
    error = {name: padded(u, name) - right[name] for name in right}
    above, below = _strain(problem, error), _strain(problem, right)
    for name, law in problem.laws(None, values).items() if springs else ():
        if not law.springs:
            continue
        i = problem.interfaces[name]
        cap = i.stiffness_unit(problem.substructures)
        kappa = law.stiffnesses(i)
        k = (i.weights[:, None] * kappa * cap / (kappa + cap))[:, :, None]
        above += float(np.sum(k * spring_jump(problem, name, error) ** 2))
        stretch = spring_jump(problem, name, right)
        stretch[:, :, 0] -= law.jumps(i)
        below += float(np.sum(k * stretch**2))
    return _ratio(above, below)


def energy_difference(problem: Problem, one: Any, other: Any) -> float:
    """Relative difference of two results in the strain energy of all parts, over all times.

    Parameters
    ----------
    problem
        Assembled scene of both.
    one, other
        Results, with ``displacements`` of (n_e,) or (T, n_e); `other` is the reference.
    """
    check_is_problem("energy_difference", problem)
    for what, result in (("one", one), ("other", other)):
        if not hasattr(result, "displacements"):
            raise SceneError(f"energy_difference: {what} = {short(result)}; give a result with displacements")
    exact = {name: _columns(other.displacements[name].T) for name in problem.substructures}
    error = {name: _columns(one.displacements[name].T) - u for name, u in exact.items()}
    return _ratio(_strain(problem, error), _strain(problem, exact))


def _columns(u: Array) -> Array:
    """Displacements (n,) or (n, columns) as columns."""
    values = np.asarray(u, dtype=np.float64)
    return values[:, None] if values.ndim == 1 else values


def _strain(problem: Problem, u: Mapping[str, Array]) -> float:
    """Twice the strain energy of the parts, summed over the columns (n_e, columns)."""
    return float(sum(np.sum(v * (problem.substructures[n].matrix @ v)) for n, v in u.items()))


def _ratio(above: float, below: float) -> float:
    """sqrt(above / below) of two energies."""
    if below == 0.0:
        return 0.0 if above == 0.0 else float("inf")
    return float(np.sqrt(max(above, 0.0) / below))
