"""What tables say beside the slip of joints: beams that carry shear, too, and slip beyond the model."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.groups import on_shortest_ways
from dolfinx_frontend.common.model_limits import LIMITS
from dolfinx_frontend.results.readings import UNLOADED, Readings
from dolfinx_frontend.scene.laws import Law

__all__ = ["bridged", "slid"]

SHARE = 0.01
"""Of the shear across a joint; less than the intervals of probabilities tell."""
_SHEAR = re.compile(r"(.*)\.shear[12]")


def bridged(answer: Any, joints: Sequence[str]) -> tuple[str, ...]:
    """What beams carry beside the friction of joints at the last step, a sentence a joint.

    Parameters
    ----------
    answer
        With forces of all interfaces: a result, or one point.
    """
    every = answer.problem.interfaces
    beams: dict[str, list[str]] = {}
    for name in every:
        if (found := _SHEAR.fullmatch(name)) and f"{found[1]}.axial" in every:
            beams.setdefault(found[1], []).append(name)
    if not beams:
        return ()
    sentences = []
    for joint in joints:
        law = every[joint].law
        if not isinstance(law, Law) or not law.rubs or joint not in answer.known:
            continue
        if _slid(answer, joint) > 1.0:
            continue  # further than the model goes, which is said, and soft beams carry something there, too
        own = _shear(answer, joint)
        carried = {
            beam: sum((_shear(answer, each) for each in of), np.zeros(len(own)))
            for beam, of in beams.items()
            if joint in _across(answer.problem, of[0])
        }
        total = float(np.linalg.norm(sum(carried.values(), np.zeros(len(own)))))
        rubs = float(np.linalg.norm(own))
        presses = float(np.linalg.norm(_resultant(answer, joint)))
        if total <= SHARE * (total + rubs) or total + rubs <= UNLOADED * presses:
            continue
        names = sorted(carried, key=lambda beam: -float(np.linalg.norm(carried[beam])))
        more = f" and {len(names) - 4} more" if len(names) > 4 else ""
        sentences.append(
            f"slip of {joint!r} is that beside {', '.join(map(repr, names[:4]))}{more}, which carry "
            f"{total / (total + rubs):.2g} of its shear ({total:.4g} of {total + rubs:.4g}), as bolts "
            "without clearance do; where only friction is to carry, give BoltStiffness(axial=m.axial, "
            "bending=1e-3 * m.bending, torsion=1e-3 * m.torsion)"
        )
    return tuple(sentences)


def slid(problem: Any, read: Readings) -> tuple[str, ...]:
    """Joints that slide further than the kinematics of the model go, a sentence each."""
    sentences = []
    for name, each in read.interfaces.items():
        interface = problem.interfaces[name]
        values = each.values.get("slip", np.zeros(1))
        slip = np.nan_to_num(values.reshape(len(values) if read.statistics != "value" else 1, -1))
        if not slip.any() or not isinstance(interface, Interface) or interface.one_point:
            continue
        limit = float(interface.reach.max())
        beyond = slip > limit
        if beyond.any():
            count = f" in {beyond.any(axis=1).sum()} of {len(slip)} points" if len(slip) > 1 else ""
            sentences.append(
                f"slip of {name!r} is up to {slip.max():.4g}{count}, beyond the model, {limit:.3g} (a facet "
                f"or {LIMITS.sliding:.0%} of its face): it slides away, or only soft bolts hold it"
            )
    return tuple(sentences)


def _slid(answer: Any, joint: str) -> float:
    """How far it has slid, relative to how far it may."""
    jump = answer.jump(joint)
    jump = jump if answer.times is None else jump[-1]
    return float(np.max(np.linalg.norm(jump[:, 1:], axis=1) / answer.problem.interfaces[joint].reach))


def _vectors(answer: Any, name: str) -> Array:
    """Forces (m, d) at the last step."""
    surface, force = answer.surface(name), answer.force(name)
    at_end = force if answer.times is None else force[-1]
    return np.asarray(surface.weights[:, None] * surface.vectors(at_end))


def _resultant(answer: Any, name: str) -> Array:
    return np.asarray(_vectors(answer, name).sum(axis=0))


def _shear(answer: Any, name: str) -> Array:
    """Resultant (d,) of what acts across the normals, of a beam of its one force."""
    surface = answer.surface(name)
    if surface.wrench is not None:
        return np.asarray(float(np.ravel(answer.force(name))[-1]) * surface.wrench[: surface.dim])
    vectors = _vectors(answer, name)
    along = np.einsum("pd,pd->p", vectors, surface.normals)
    return np.asarray((vectors - along[:, None] * surface.normals).sum(axis=0))


def _across(problem: Any, beam: str) -> list[str]:
    """Contacts on the shortest ways from one end of a beam to the other; what is glued moves as one."""
    every = {n: i for n, i in problem.interfaces.items() if len(i.sides) == 2 and i.wrench is None}
    pairs = {name: tuple(side.substructure for side in each.sides) for name, each in every.items()}
    contacts = [name for name, each in every.items() if each.law.unilateral]
    ends = tuple(side.substructure for side in problem.interfaces[beam].sides)
    glue = [pair for name, pair in pairs.items() if name not in contacts]
    ways, _ = on_shortest_ways(list(problem.parts), {n: pairs[n] for n in contacts}, glue, ends)
    return list(ways)
