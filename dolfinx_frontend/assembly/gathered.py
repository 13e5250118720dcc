"""A problem whose parts are on several ranks, on one of them: its matrices, without meshes and materials, or
what it prescribes alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.groups import grouped
from dolfinx_frontend.scene.laws import Perfect
from dolfinx_frontend.scene.values import is_zero

__all__ = ["by_first", "gathered", "over_ranks", "prescribing"]

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


# --- what is prescribed ----------------------------------------------------------------------------
class _Nodes(NamedTuple):
    """What a rank sends of what is prescribed: coordinates (n, d) of some nodes of its parts; of sides their
    nodes among these, or -1, in the order of the other side's where meshes match, and normals there."""

    places: dict[str, Array]
    sides: dict[tuple[str, int], tuple[Ints, Array]]


def over_ranks(problem: Problem) -> list[str]:
    """What prescribes displacements or jumps of parts that glue joins over several ranks."""
    if problem.distribution is None:
        return []
    names = [name for name, i in problem.interfaces.items() if i.law.prescribes == "jump"]
    sides = {n: [s.substructure for s in problem.interfaces[n].sides] for n in names}
    partners = {n: problem.interfaces[n].law.partners for n in names}
    pairs = [(of[0], other) for n, of in sides.items() for other in (*of, *partners[n])]
    groups = grouped(list(problem.parts), pairs)
    wide = {part for group in groups if len(problem.distribution.ranks(group)) > 1 for part in group}
    return [name for name in names if sides[name][0] in wide]


def prescribing(problem: Problem, names: Sequence[str]) -> Problem | None:
    """Interfaces that prescribe displacements or jumps, with their parts, on the first rank; collective.

    The parts have no matrices and loads, and those nodes alone at which something may be prescribed twice:
    all of supports and of joints with a jump, of others the ones that are on two faces. None elsewhere.
    """
    with agreement(problem.comm):
        own = _nodes(problem, names)
    every = problem.comm.gather(own, root=0)
    found = None
    with agreement(problem.comm):
        if every is not None:
            places = {part: x for each in every for part, x in each.places.items()}
            sides = {where: of for each in every for where, of in each.sides.items()}
            interfaces = {name: _prescribing(problem.interfaces[name], sides) for name in names}
            found = Problem({part: _bare_part(problem, part, x) for part, x in places.items()}, interfaces)
    return found


def _nodes(problem: Problem, names: Sequence[str]) -> _Nodes:
    places: dict[str, Array] = {}
    found: dict[tuple[str, int], tuple[Ints, Array]] = {}
    used: dict[str, list[tuple[str, int]]] = {part: [] for part in problem.substructures}
    for name in names:
        for number, side in enumerate(problem.interfaces[name].sides):
            if side.substructure in used:
                used[side.substructure].append((name, number))
    for part, faces in used.items():
        x = problem.substructures[part].dof_coordinates
        times = np.zeros(len(x), dtype=np.int64)
        for name, number in faces:
            i = problem.interfaces[name]
            whole = len(i.sides) == 1 or not is_zero(i.law.parameters()["jump"])
            times[i.sides[number].nodes] += 2 if whole else 1
        kept = np.flatnonzero(times > 1)
        place = np.full(len(x), -1)
        place[kept] = np.arange(len(kept))
        for name, number in faces:
            i = problem.interfaces[name]
            side = i.sides[number]
            nodes = side.nodes if i.matching is None else i.matching[:, number]
            normals = side.node_normals[np.searchsorted(side.nodes, nodes)]
            found[name, number] = place[nodes], normals
        if faces:
            places[part] = x[kept]
    return _Nodes(places, found)


def _prescribing(interface: Interface, found: Mapping[tuple[str, int], tuple[Ints, Array]]) -> Interface:
    """An interface with the nodes that were sent of its sides."""
    sent = [found[interface.name, number] for number in range(len(interface.sides))]
    kept = [nodes >= 0 for nodes, _ in sent]
    pairs = None
    if interface.matching is not None:
        kept = [np.logical_and(*kept)] * 2
        pairs = np.stack([nodes[kept[0]] for nodes, _ in sent], axis=1)
    sides = tuple(
        replace(side, trace=None, nodes=nodes[some], node_normals=normals[some])
        for side, (nodes, normals), some in zip(interface.sides, sent, kept, strict=True)
    )
    return replace(interface, sides=sides, matching=pairs)


def _bare_part(problem: Problem, name: str, x: Array) -> Substructure:
    known, none = problem.parts[name], np.zeros((0, 0))
    part: Any = None
    return Substructure(
        name, part, None, None, none.ravel(), none, known.modulus, known.length, known.volume,
        known.centre, x, around=known.around,
    )
