"""Which joints a bolt clamps, and which part of a joint belongs to which bolt.

Parts that are glued move together. A bolt joins two such groups, and the contacts on the shortest ways from
one to the other are what it clamps, without those of its own head and nut, which carry the force of the bolt.
Where several bolts clamp one joint each of them has the points that are nearest to its axis; a point on the
border, which stands for a piece of the joint of some size, is divided.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import softmax

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_name, checked_names
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.groups import on_shortest_ways
from dolfinx_frontend.results.answer import Answer, Surface
from dolfinx_frontend.sheets.names import by_pattern

__all__ = ["Bolt", "bolts_of", "normal_of"]

ALONG = 0.7
"""A joint is across a bolt where the product of its mean normal and the axis is more than this: a contact of
the shank with its hole is none."""
SOME = 1e-3
"""A bolt that has less of every point of a joint has nothing of it."""
AXIAL = ".axial"
"""How the interface of a bolt that is a beam ends."""


@dataclass(frozen=True)
class Bolt:
    """A bolt of the sheet.

    Attributes
    ----------
    name, interface
        How it is shown, and where its force is.
    axis, centre
        (d,), unit vector and a point of it.
    area
        Of its section as modelled; NaN: it has none (a beam).
    joints
        Interface -> (m,), the share of each of its points that belongs to this bolt, 0 to 1.
    why
        Why there is none; empty if there is one.
    """

    name: str
    interface: str
    axis: Array
    centre: Array
    area: float
    joints: Mapping[str, Array] = field(default_factory=dict)
    why: str = ""


def normal_of(surface: Surface) -> Array:
    """(d,), unit: the mean normal, of a mean motion its direction; 0 of a closed face."""
    d = surface.dim
    mean = surface.weights @ surface.normals if surface.wrench is None else surface.wrench[:d]
    size = float(np.linalg.norm(mean))
    return np.asarray(mean / size if size > 1e-6 * surface.area or surface.wrench is not None else 0.0 * mean)


def is_bolt(answer: Answer, name: str) -> bool:
    """Whether an interface is a bolt: a preload, an imposed jump, or the axial force of a beam."""
    law, surface = answer.problem.interfaces[name].law, answer.surface(name)
    if surface.wrench is not None and not name.endswith(AXIAL):
        return False
    pulls = law == "Preload" if isinstance(law, str) else bool(law.bolt)
    return pulls or surface.bolt is not None or surface.wrench is not None


def _parts(answer: Answer, name: str) -> list[str]:
    return [side.substructure for side in answer.problem.interfaces[name].sides]


def _glues(answer: Answer, name: str) -> bool:
    """Whether an interface holds its sides together as one."""
    law = answer.problem.interfaces[name].law
    return law == "Perfect" if isinstance(law, str) else law.prescribes == "jump"


def bolts_of(answer: Answer, chosen: Any = None, joints: Any = None) -> list[Bolt]:
    """The bolts of an answer and what they clamp.

    Parameters
    ----------
    chosen
        Interfaces, or interface -> name that is shown; None: those whose law is a preload or an imposed jump,
        and axial forces of beams.
    joints
        Bolt or pattern -> interfaces that it clamps; None: found from how the parts are joined.

    Raises
    ------
    SceneError
        A name that there is not.
    """
    every = answer.problem.interfaces
    two_sided = [name for name, each in every.items() if len(each.sides) == 2]
    if chosen is None:
        names = [name for name in two_sided if is_bolt(answer, name)]
    else:
        names = [chosen] if isinstance(chosen, str) else checked_names("report", "bolts", chosen)
    for name in names:
        check_known("interface", name, every, "report, bolts")
    shown = {name: name.removesuffix(AXIAL) for name in names}
    if isinstance(chosen, Mapping):
        shown = {name: checked_name("report, bolts", chosen[name]) for name in names}
    if len(set(shown.values())) < len(shown):
        raise SceneError(f"report: bolts: {short(list(shown.values()))}: two of them have the same name")
    given = by_pattern("report", "joints", joints, list(shown.values()))
    found = []
    for name in names:
        surface = answer.surface(name)
        area = float("nan") if surface.wrench is not None else surface.area
        found.append(Bolt(shown[name], name, normal_of(surface), surface.centre, area))
    clamped = {b.name: _given(answer, given[b.name]) if b.name in given else () for b in found}
    clamped |= {b.name: _clamped(answer, b, names, two_sided) for b in found if b.name not in given}
    return [_with_points(answer, bolt, found, clamped) for bolt in found]


def _given(answer: Answer, names: Any) -> tuple[str, ...]:
    chosen = [names] if isinstance(names, str) else checked_names("report", "joints", names)
    for name in chosen:
        check_known("interface with a known force", name, answer.known, "report, joints")
    return tuple(chosen)


def _clamped(answer: Answer, bolt: Bolt, bolts: Sequence[str], two_sided: Sequence[str]) -> tuple[str, ...]:
    """The joints that a bolt clamps, by how the parts are joined."""
    edges = [n for n in two_sided if n not in bolts and answer.surface(n).wrench is None]
    across = [
        n
        for n in edges
        if n in answer.known
        and not _glues(answer, n)
        and abs(float(normal_of(answer.surface(n)) @ bolt.axis)) > ALONG
    ]
    contacts = [n for n in across if answer.surface(n).contact]
    for joints in (contacts, across):
        glue = [n for n in edges if n not in joints and not answer.surface(n).contact]
        found = _on_shortest_ways(answer, bolt, joints, glue)
        if found:
            return found
    return ()


def _on_shortest_ways(
    answer: Answer, bolt: Bolt, joints: Sequence[str], glue: Sequence[str]
) -> tuple[str, ...]:
    parts = list(answer.problem.substructures)
    pairs = {name: _parts(answer, name) for name in (*joints, *glue)}
    for each in pairs.values():
        parts += [p for p in each if p not in parts]
    ends = _parts(answer, bolt.interface)
    parts += [p for p in ends if p not in parts]
    own = {name: pairs[name] for name in joints}
    ways, (first, last) = on_shortest_ways(parts, own, [pairs[n] for n in glue], ends)
    # the contacts of head and nut carry the force of the bolt itself
    inner = [name for name, pair in ways.items() if first not in pair and last not in pair]
    inner = inner or [name for name in ways if not set(pairs[name]) & set(ends)]
    return tuple(inner or ways)


def _with_points(
    answer: Answer, bolt: Bolt, bolts: Sequence[Bolt], clamped: Mapping[str, tuple[str, ...]]
) -> Bolt:
    if not clamped[bolt.name]:
        why = "no contact or elastic joint across its axis that it clamps was found: name it with joints="
        if not set(answer.known) - {each.interface for each in bolts}:
            why = "joints: their forces are not known here (eliminated, or saved without fields)"
        return Bolt(bolt.name, bolt.interface, bolt.axis, bolt.centre, bolt.area, why=why)
    own: dict[str, Array] = {}
    for joint in clamped[bolt.name]:
        sharing = [b for b in bolts if joint in clamped[b.name]]
        surface = answer.surface(joint)
        away = np.array([_from_axis(surface.acting[0], b) for b in sharing])
        # half of a point's own size on either side of the border it belongs to both, as a cell there does
        size = surface.weights ** (1.0 / max(surface.dim - 1, 1))
        share = softmax(-2.0 * away / size, axis=0)[sharing.index(bolt)]
        if share.max() > SOME:
            own[joint] = share
    why = "" if own else "no point of the joints that it clamps is nearer to it than to other bolts"
    return Bolt(bolt.name, bolt.interface, bolt.axis, bolt.centre, bolt.area, own, why)


def _from_axis(points: Array, bolt: Bolt) -> Array:
    """(m,), distances of points from the axis of a bolt."""
    away = points - bolt.centre
    return np.asarray(np.linalg.norm(away - np.outer(away @ bolt.axis, bolt.axis), axis=1))
