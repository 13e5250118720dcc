"""Bonds that tear: snaps on their way, and meshes that are too coarse for it."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.results.contact import DAMAGED
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.scene.materials import modulus_along

__all__ = ["check_bonds"]

CELLS = 3.0
"""Cells in a process zone that resolve it (Turon et al. 2007: 3 to 10)."""

FALL = 0.05
"""Share of itself by which a load has to fall to be a snap: a crack that goes from point to point makes it
fall by a few per cent on coarse meshes."""


def check_bonds(result: Result) -> None:
    """Warn of snaps, and of bonds that tear in cells which do not resolve it. Collective.

    Warns
    -----
    SceneWarning
        A load has to fall on the way of the bonds from one step to the next: under loads that only grow the
        structure does not rest there. Or a bond that is damaged has fewer than three cells in its process
        zone: the mesh decides at which load it tears.
    """
    bonds = [name for name, each in result.problem.interfaces.items() if each.law.softens]
    if bonds and isinstance(result, HistoryResult) and result.summary.falls.size:
        _say_snaps(result, bonds)
    for name in bonds:
        if result.problem.speaks_for(name) and not result.problem.interfaces[name].one_point:
            _check_cells(result, result.problem.own.interfaces[name])


def _say_snaps(result: HistoryResult, bonds: list[str]) -> None:
    falls = result.summary.falls
    step = int(np.argmax(falls))
    if falls[step] <= FALL:
        return
    times = result.plan.times
    assert times is not None
    text = f"snaps before step 0 (t = {times[0]:g})"
    if step > 0:
        text = f"snaps between steps {step - 1} and {step} (t = {times[step - 1]:g} and {times[step]:g})"
        before, after = (_forces(result, each, bonds) for each in (step - 1, step))
        name = max(before, key=lambda each: before[each] - after[each], default="")
        if name and before[name] > after[name]:
            text += f", the force of {name!r} falls from {before[name]:.4g} to {after[name]:.4g}"
    more = int(np.count_nonzero(falls > FALL)) - 1
    text += f"; so it does in {more} other steps" if more else ""
    if result.problem.rank == 0:
        warn(
            f"bond {' or '.join(map(repr, bonds))}: {text}: on its way the load would have to fall by "
            f"{falls[step]:.0%}; the states before and behind are equilibria, between them it moves",
            SceneWarning,
            f"{bonds} falls",
        )


def _forces(result: HistoryResult, step: int, but: list[str]) -> dict[str, float]:
    """Size of the resultant of each interface and support at a step."""
    table = result.table(step=step)
    forces = np.array([table[f"force_{axis}"] for axis in "xyz"[: result.problem.dim]], dtype=float)
    sizes = zip(table["interface"], np.linalg.norm(forces, axis=0), strict=True)
    return {str(name): float(size) for name, size in sizes if name not in but and np.isfinite(size)}


def _check_cells(result: Result, interface: Interface) -> None:
    law, name = interface.law, interface.name
    jumps = result.jump(name).reshape(-1, interface.num_points, law.count(interface.dim))
    grows = np.max([law.damage(interface, jump) for jump in jumps], axis=0) > DAMAGED
    if not grows.any():
        return
    zone = law.process_zone(interface, _modulus_across(result.problem, interface))
    cells = np.where(grows, zone / interface.cell_sizes, np.inf)
    worst = int(np.argmin(cells))
    if cells[worst] < CELLS:
        place = ", ".join(f"{x:.3g}" for x in interface.points[worst])
        warn(
            f"bond {name!r}: it tears over a length of {zone[worst]:.3g} (E G / strength^2), which is "
            f"{cells[worst]:.2g} cells at ({place}): the mesh decides at which load; make cells of its faces "
            f"smaller than {zone[worst] / CELLS:.2g}",
            SceneWarning,
            f"{name} cells",
        )


def _modulus_across(problem: Problem, interface: Interface) -> Array:
    """(m,), force / area: Young's modulus along the normals, of the softer side."""
    found: list[Array] = []
    for side in interface.sides:
        part = problem.substructures.get(side.substructure)
        elasticity = getattr(part and part.material, "elasticity", None)
        matrix = None if elasticity is None else elasticity(interface.dim)
        if matrix is None:
            found.append(np.full(interface.num_points, problem.parts[side.substructure].modulus))
        else:
            found.append(modulus_along(matrix, interface.normals))
    return np.asarray(np.min(found, axis=0))
