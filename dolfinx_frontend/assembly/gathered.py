"""A problem whose parts are on several ranks, on one of them: its matrices, without meshes and materials."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from dolfinx_frontend.assembly.elements import csr, petsc_matrix
from dolfinx_frontend.assembly.interface import Interface, Side
from dolfinx_frontend.assembly.part_loads import PartLoad
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.stretch import Stretch
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.scene.laws import Perfect

__all__ = ["by_first", "gathered"]

T = TypeVar("T")

_LEFT = ("part", "space", "stiffness", "material", "sources", "factor")
"""What of a part does not travel, or not as it is."""


class _Own(NamedTuple):
    """What a rank sends: of parts their stiffness, the nodes on exterior facets, and the rest; of interfaces
    all but laws and traces; sides with their traces, and their column of the matching nodes; nodal forces of
    loads; which are initial strains, and what they do to the cells of a random field; these cells."""

    parts: dict[str, tuple[sp.csr_matrix, int, dict[str, Any]]]
    interfaces: dict[str, Interface]
    sides: dict[tuple[str, int], tuple[Side, sp.csr_matrix, Any]]
    loads: dict[str, dict[str, dict[str, Array]]]
    strains: dict[str, dict[str, Array | None]]
    stretches: dict[str, Stretch]


def gathered(problem: Problem) -> Problem | None:
    """All of a problem on the first rank, as it would be assembled there; None on the others. Collective.

    Its parts have no meshes, spaces and materials: it can be planned, reduced and handed to the kernel. A
    problem of one rank is its own.
    """
    if problem.distribution is None:
        return problem
    comm = problem.comm
    with agreement(comm):
        own = _own(problem)
    every = comm.gather(own, root=0)
    found = None
    with agreement(comm):
        if comm.rank == 0:
            found = _joined(problem, every)
    return found


def _own(problem: Problem) -> _Own:
    parts, interfaces, sides = {}, {}, {}
    for name, part in problem.substructures.items():
        rest = {each.name: getattr(part, each.name) for each in fields(part) if each.name not in _LEFT}
        parts[name] = (csr(part.stiffness), part.surface, rest)
    for name, interface in problem.interfaces.items():
        if problem.speaks_for(name):
            bare = tuple(replace(side, trace=None) for side in interface.sides)
            interfaces[name] = replace(interface, law=Perfect(), sides=bare)
        for number, side in enumerate(interface.sides):
            if side.substructure in problem.substructures:
                nodes = None if interface.matching is None else interface.matching[:, number]
                sides[name, number] = (replace(side, trace=None), csr(side.trace), nodes)
    loads = {name: {p: dict(of) for p, of in each.columns.items()} for name, each in problem.loads.items()}
    stretches = {name: problem.stretch(name) for name in problem.fields if name in problem.substructures}
    strains: dict[str, dict[str, Array | None]] = {}
    for name, each in problem.loads.items():
        where = each.load.part
        on = stretches.get(where)
        strains[name] = {
            p: None if on is None else on.initial(problem.substructures[where], stress)
            for p, stress in each.stresses.items()
        }
    alone = {name: replace(stretch, _space=None) for name, stretch in stretches.items()}
    return _Own(parts, interfaces, sides, loads, strains, alone)


def _joined(problem: Problem, every: list[_Own]) -> Problem:
    """The problem from what all ranks have sent; what all of them know is taken from here."""
    sent = {name: each for own in every for name, each in own.parts.items()}
    parts = {}
    for name, summary in problem.parts.items():
        stiffness, surface, rest = sent[name]
        parts[name] = Substructure(
            part=None,  # type: ignore[arg-type]
            space=None,
            stiffness=petsc_matrix(stiffness),
            factor=summary.factor,
            **rest,
        )
        vars(parts[name])["surface"] = surface  # there is no mesh to count them on
    bare = {name: each for own in every for name, each in own.interfaces.items()}
    of_sides = {where: each for own in every for where, each in own.sides.items()}
    interfaces = {}
    for name, known in problem.interfaces.items():
        sides, matching = [], []
        for number in range(len(bare[name].sides)):
            side, trace, nodes = of_sides[name, number]
            sides.append(replace(side, trace=petsc_matrix(trace)))
            matching.append(nodes)
        pairs = None if bare[name].matching is None else np.stack(matching, axis=1)
        interfaces[name] = replace(bare[name], law=known.law, sides=tuple(sides), matching=pairs)
    columns: dict[str, dict[str, dict[str, Array]]] = {}
    for own in every:
        for name, by_parameter in own.loads.items():
            for parameter, by_part in by_parameter.items():
                columns.setdefault(name, {}).setdefault(parameter, {}).update(by_part)
    strains: dict[str, dict[str, Any]] = {name: {} for name in problem.loads}
    for own in every:
        for name, of_load in own.strains.items():
            strains[name].update(of_load)
    loads: Mapping[str, PartLoad] = {
        name: replace(each, columns=columns.get(name, {}), stresses=strains[name])
        for name, each in problem.loads.items()
    }
    found = Problem(parts, interfaces, None, dict(loads))
    for own in every:
        found.told(own.stretches)
    return found


def by_first(problem: Problem, whole: Problem | None, work: Callable[[Problem], T]) -> T:
    """What the first rank makes of all of a problem, on all ranks; collective.

    Parameters
    ----------
    whole
        What :func:`gathered` returned.
    """
    found: list[T] = []
    with agreement(problem.comm):
        if whole is not None:
            found.append(work(whole))
    return found[0] if problem.comm is None else problem.comm.bcast(found, root=0)[0]
