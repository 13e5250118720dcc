"""What an interface holds of the rigid motions of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.part_loads import fitting
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import PartSummary
from dolfinx_frontend.assembly.rigid import Resistance, check_resistances, resistance
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.scene.laws import Contact, Elimination, Preload, Rigid

__all__ = ["check_determined", "check_held", "held", "own_resistances", "resistance_of"]


def held(problem: Problem, interface: Interface, where: Flags | Array | None = None) -> Resistance:
    """Rigid motions that an interface with points on this rank resists, at the points `where` (m,) only, in
    the directions (m, r) of its :meth:`held_rows` only, or in combinations (m, r, r) of these."""
    length = problem.parts[interface.sides[0].substructure].length
    return resistance_of(interface, length, where)


def resistance_of(interface: Interface, length: float, where: Flags | Array | None = None) -> Resistance:
    if interface.law.elimination is Elimination.TIED:
        return _of_tie(interface, cast(Rigid, interface.law.nominal), length)
    if interface.wrench is not None:
        return _of_wrench(interface, length, where)
    rows = interface.law.nominal.held_rows(interface)
    if where is not None and where.ndim == 3:
        rows = np.einsum("pij,pjd->pid", where, rows)
    elif where is not None:
        rows = rows * where.reshape(len(rows), -1, 1)
    sides = tuple(side.substructure for side in interface.sides)
    return resistance(sides, interface.points, interface.weights, rows, length)


def own_resistances(parts: Mapping[str, PartSummary]) -> list[Resistance]:
    """What holds parts beside their interfaces: axisymmetric ones move along their axis only, and a matrix
    may be grounded."""
    of_axis = np.diag([1.0, 0.0, 1.0])
    held = {name: of_axis if part.around else part.held for name, part in parts.items()}
    return [
        ((name,), gram, (parts[name].centre, parts[name].length))
        for name, gram in held.items()
        if gram is not None
    ]


def check_held(problem: Problem) -> None:
    """Raise if parts can move without any resistance of the laws as they are now; collective.

    A scene is checked when it is assembled; this is for laws that were replaced afterwards.
    """
    own = {
        name: held(problem, interface)
        for name, interface in problem.own.interfaces.items()
        if problem.speaks_for(name)
    }
    resistances = problem.gather(own)
    check_resistances(
        {name: (part.centre, part.length) for name, part in problem.parts.items()},
        [*(resistances[name] for name in problem.interfaces), *own_resistances(problem.parts)],
    )


def check_determined(problem: Problem) -> None:
    """Warn of bolts that are locked on nodes of a rigid contact of the same parts: only the sum of what they
    carry is determined; collective."""
    own = {}
    for name, interface in problem.own.interfaces.items():
        bolt = interface.law.nominal
        if not (isinstance(bolt, Preload) and bolt.stiffness is None and _locks(bolt)):
            continue
        for other, beside in problem.own.interfaces.items():
            law = beside.law.nominal
            if isinstance(law, Contact) and law.stiffness is None and _covers(beside, interface):
                own[name] = other
    for name, other in problem.gather(own).items():
        warn(
            f"interfaces {name!r} and {other!r} are rigid on the same faces: what each carries once {name!r} "
            "is locked is not determined; give Preload the stiffness of the bolt, or Contact one",
            SceneWarning,
        )


def _locks(bolt: Preload) -> bool:
    """Whether its length is given at some time."""
    return bolt.history or bool(bolt.given("shortening", "angle"))


def _covers(interface: Interface, other: Interface) -> bool:
    """Whether the nodes of an interface, part by part, are all those of another, or more."""
    nodes = {side.substructure: side.nodes for side in interface.sides}
    return all(
        side.substructure in nodes and np.isin(side.nodes, nodes[side.substructure]).all()
        for side in other.sides
    )


def _of_tie(interface: Interface, law: Rigid, length: float) -> Resistance:
    """What a face of a rigid group holds: the part of the first face, and that one the ground."""
    part, d = interface.sides[0].substructure, interface.dim
    if law.plane:
        rows = np.repeat(interface.sides[0].normal[None, None], interface.num_points, axis=0)
    else:
        rows = np.tile(np.eye(d), (interface.num_points, 1, 1))
    sides = (part,) if law.leads or part == law.anchor else (part, law.anchor)
    _, gram, origin = resistance(sides, interface.points, interface.weights, rows, length)
    if len(sides) == 2:
        return sides, gram, origin
    held: list[Array] = []
    if law.leads and not law.plane:
        centre, size = origin
        place = centre if law.point is None else fitting(f"rigid face {law.group!r}", "point", law.point, d)
        at = rigid_modes(place[None], *origin)[0]
        units = np.eye(at.shape[1])
        for name in law.motions():
            turn = -1 if d == 2 else d + "xyz".index(name[-1])
            held.append(units[turn] if name[0] == "r" else at["xyz".index(name)])
    elif law.leads:
        along = gram  # of the normal at all points: it holds one translation and the tilts
        normal = np.concatenate([interface.sides[0].normal, np.zeros(gram.shape[0] - d)])
        if law.motions():
            return sides, along, origin
        if not law.tilts:
            away = np.eye(len(gram)) - np.outer(normal, normal)
            return sides, away @ along @ away, origin
    given: Array = np.reshape(np.array(held, dtype=np.float64), (len(held), gram.shape[0]))
    return sides, given.T @ given, origin


def _of_wrench(interface: Interface, length: float, where: Flags | Array | None) -> Resistance:
    """What an interface between mean motions of faces holds: one motion."""
    assert interface.wrench is not None
    d = interface.dim
    row = interface.wrench.copy()
    row[d:] /= length
    holds = interface.law.nominal.holds(d)[0] and (where is None or bool(np.all(where)))
    sides = tuple(side.substructure for side in interface.sides)
    gram: Array = np.asarray(np.outer(row, row) * holds / max(float(row @ row), 1e-300), dtype=np.float64)
    return sides, gram, (interface.points[0].copy(), length)
