"""Where the model of an answer ends, said once each: small displacements, strains and rotations, no yielding,
bolts in tension, bonds on a stable branch, small sliding."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from dolfinx_frontend.assembly.matrix_part import frames_of
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.errors import SceneError, telling
from dolfinx_frontend.common.model_limits import LIMITS, beyond
from dolfinx_frontend.common.statuses import NO_EQUILIBRIUM, SLIDES, STOPPED, UNDECIDED
from dolfinx_frontend.evaluate.bonds import check_bonds
from dolfinx_frontend.evaluate.loose import check_bolts
from dolfinx_frontend.evaluate.sliding import check_sliding
from dolfinx_frontend.results.deformation import Deformation, Largest, deformations
from dolfinx_frontend.results.point import OnePoint
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.sweep import PointResults

__all__ = ["check_model"]


def check_model(answer: Result | PointResults, what: str = "") -> None:
    """Warn of what in an answer the model does not hold for, with the place and the probable cause.

    Parameters
    ----------
    what
        One of several points in a message; of these the one whose interfaces move most has its fields looked
        at.

    Warns
    -----
    SceneWarning
        Once for each kind in a call of the user's.
    """
    with telling():
        one: Result | OnePoint | None = None
        if isinstance(answer, Result):
            one, which = answer, ""
        elif answer.furthest is not None:
            number, one = answer.furthest
            which = f", {what} {number}"
        if one is not None and not _check_fields(one, which):
            return  # everything else follows from a wrong unit
        check_bolts(answer, what)
        if isinstance(answer, Result):
            check_bonds(answer)
        check_sliding(answer, what)


def _check_fields(result: Result | OnePoint, which: str) -> bool:
    """Whether displacements, strains and stresses are of a size that a wrong unit does not make."""
    known = ~np.isin(result.statuses, (NO_EQUILIBRIUM, SLIDES, UNDECIDED, *STOPPED))
    with np.errstate(over="ignore", invalid="ignore"):  # of loads whose squares are no numbers
        found = dict(_deformed(result, known))
    if not found:
        return True
    size = _size(result.problem)
    part = max(found, key=lambda name: found[name].displacement.value)
    moved = found[part].displacement
    if not np.isfinite(moved.value):
        return True
    if moved.value > LIMITS.misread * size:
        cause = _unit(result.problem, part, size) or "a unit, or a part that hardly anything holds?"
        beyond(
            f"displacement {moved.value / size:.3g} times the assembly ({moved.value:.3g} of {size:.3g}), "
            f"{_at(result, part, moved, which)}: {cause}",
            "displacement",
        )
        return False
    if moved.value > LIMITS.displacement * size:
        beyond(
            f"displacement {moved.value:.3g} is {moved.value / size:.2g} of the size of the assembly, "
            f"{_at(result, part, moved, which)}: loads act on the shape before; less load, more support, or "
            "a program for large displacements",
            "displacement",
        )
    _check_cells(result, found, which)
    _check_yield(result, found, known, which)
    return True


def _deformed(result: Result | OnePoint, known: Flags) -> Iterator[tuple[str, Deformation]]:
    """Of the parts of this rank that have a mesh here; of none where recovering the fields takes too long."""
    problem = result.problem
    parts = {
        name: part
        for name, part in problem.substructures.items()
        if name not in problem.spread and not frames_of(part) and part.part is not None
    }
    numbers = len(known) * sum(len(s.load) for s in problem.substructures.values())
    if not parts or not known.any() or numbers > LIMITS.numbers:
        return
    for name, part in parts.items():
        unknowns = np.reshape(result.unknowns(name), (len(known), -1))
        if np.isfinite(unknowns[known]).all():
            yield name, deformations(part, unknowns, known)


def _size(problem: Problem) -> float:
    """Diagonal of the box around the assembly; of parts on other ranks around their centres."""
    corners = [part.centre[None] for part in problem.parts.values()]
    corners += [part.dof_coordinates for part in problem.substructures.values() if len(part.dof_coordinates)]
    low = np.min([each.min(axis=0) for each in corners], axis=0)
    high = np.max([each.max(axis=0) for each in corners], axis=0)
    return float(np.linalg.norm(high - low))


def _at(result: Result | OnePoint, part: str, largest: Largest, which: str) -> str:
    where = ", ".join(f"{x:.4g}" for x in largest.place)
    when = f", t = {result.times[largest.step]:g}" if result.times is not None else ""
    return f"part {part!r} at ({where}){when}{which}"


def _unit(problem: Problem, part: str, size: float) -> str:
    """The mistake of units that explains answers that are far too large; empty: none does."""
    modulus, (soft, stiff) = _modulus(problem, part), LIMITS.moduli
    if soft <= modulus <= stiff and size < LIMITS.metres:
        return f"E in MPa with a mesh in m? Then E is {modulus * LIMITS.units:.3g} (N, m, Pa)"
    if modulus < soft * stiff / LIMITS.units:
        in_mm = 1000.0 * modulus
        return (
            f"E in GPa? Then E is {in_mm:.3g} with a mesh in mm (N, mm, MPa), "
            f"{in_mm * LIMITS.units:.3g} with one in m (N, m, Pa)"
        )
    return ""


def _modulus(problem: Problem, part: str) -> float:
    known = problem.parts[part]
    return known.modulus if known.E is None else known.E


def _check_cells(result: Result | OnePoint, found: Mapping[str, Deformation], which: str) -> None:
    """Strains that are too large, or none at all, and rotations."""
    part = max(found, key=lambda name: found[name].rotation.value)
    turned = found[part].rotation
    if np.degrees(turned.value) > LIMITS.rotation:
        beyond(
            f"rotation by {np.degrees(turned.value):.3g} degrees, {_at(result, part, turned, which)}: "
            f"rotations are those of small motions, up to {LIMITS.rotation:g} degrees; hold the part, or "
            "take a program for large displacements",
            "rotation",
        )
    part = max(found, key=lambda name: found[name].strain.value)
    strain, modulus = found[part].strain, _modulus(result.problem, part)
    if strain.value > LIMITS.strain:
        beyond(
            f"strain {strain.value:.2g}, {_at(result, part, strain, which)}, more than "
            f"{LIMITS.strain:.0%}: with E = {modulus:.3g} that is a stress of {modulus * strain.value:.3g}, "
            "and what is linear here is off by about as much; a soft layer, a part that would yield, or a "
            "load or a modulus in another unit",
            "strain",
        )
    soft, stiff = LIMITS.moduli
    in_pascals = soft * LIMITS.units <= modulus <= stiff * LIMITS.units
    too_stiff = in_pascals and _size(result.problem) > LIMITS.metres
    if 0.0 < strain.value < LIMITS.nothing and too_stiff:
        beyond(
            f"strain {strain.value:.2g} at most, in part {part!r}: E in Pa with a mesh in mm? Then E is "
            f"{modulus / LIMITS.units:.3g} (N, mm, MPa)",
            "no strain",
        )


def _check_yield(
    result: Result | OnePoint, found: Mapping[str, Deformation], known: Flags, which: str
) -> None:
    """Stresses above the yield stress of a material that has one, at the last step and the most strained."""
    worst: tuple[float, str] = (1.0, "")
    for name, each in found.items():
        limit = getattr(result.problem.substructures[name].material, "yield_stress", None)
        if limit is None:
            continue
        for step in {int(np.flatnonzero(known)[-1]), each.strain.step}:
            try:
                stress = result.stress(name, step, of="von Mises")
            except SceneError:  # of a plane part, say, that has no third axis
                continue
            of_cells = stress.x.array[np.asarray(stress.function_space.dofmap.list)].mean(axis=1)
            cell = int(np.argmax(of_cells))
            use = float(of_cells[cell]) / limit
            if use > worst[0]:
                place = Largest(0.0, step, _centre(result, name, cell))
                worst = use, (
                    f"von Mises stress {of_cells[cell]:.4g} above the yield stress {limit:g}, "
                    f"{_at(result, name, place, which)}, and in {np.mean(of_cells > limit):.2g} of its cells"
                )
    if worst[1]:
        beyond(
            f"{worst[1]}: the part is elastic here, and yields in truth; less load or more section, or, "
            "beside a sharp edge only, a stress that has no limit",
            "yield",
        )


def _centre(result: Result | OnePoint, part: str, cell: int) -> Array:
    here = result.problem.substructures[part]
    places: Array = here.dof_coordinates[np.asarray(here.space.dofmap.list)[cell]].mean(axis=0)
    return places
