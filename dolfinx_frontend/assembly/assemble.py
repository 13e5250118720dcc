"""From a scene to matrices: the last step that knows dolfinx.

The result is frozen: stiffness and load of every substructure without any boundary condition, and
the traces, weights and frames of every interface.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Container, Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap, copied_nodes
from dolfinx_frontend.assembly.held import own_resistances, resistance_of
from dolfinx_frontend.assembly.held_nodes import Held
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.matrix_part import (
    LentFace,
    PointSet,
    PointsOf,
    check_units,
    copy_of,
    discretised_matrix,
    frames_of,
    lent_faces,
)
from dolfinx_frontend.assembly.meeting import held_nodes
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.assembly.part_loads import part_load, spread_load
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import (
    Distribution,
    agreement,
    bound_threads,
    check_alike,
    end_all_on_errors,
    exchanged,
    one_call,
    own_communicator,
    place,
    swap,
)
from dolfinx_frontend.assembly.relief import Relief, densities_of, relief_supports
from dolfinx_frontend.assembly.remote import check_cold, remote_interface
from dolfinx_frontend.assembly.rigid import check_resistances
from dolfinx_frontend.assembly.spread import SpreadPart, condensed
from dolfinx_frontend.assembly.stretch import with_cells
from dolfinx_frontend.assembly.substructure import Substructure, discretise, summary
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_optional_kind, checked_callable
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.common.groups import grouped
from dolfinx_frontend.common.interrupts import stop_if_pressed
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.common.threads import alone
from dolfinx_frontend.scene.amplitudes import Varying, amplitudes_of
from dolfinx_frontend.scene.laws import Elimination, Perfect
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import InterfaceSpec, Remote, SubstructureSpec, check_face

__all__ = ["assemble", "assembled_again", "placed"]

_log = logging.getLogger(__name__)


def _check_law(interface: Interface) -> None:
    """Evaluate the values of a law once, so that mistakes are reported here."""
    law = interface.law.nominal
    law.check_faces(interface, interface.sag, interface.chords, interface.apart)
    if law.linear:
        law.fields(interface)


@alone
def assemble(scene: Scene, progress: Callable[[str], None] | None = None, *, comm: Any = None) -> Problem:
    """Assemble a scene.

    Parameters
    ----------
    scene
        The scene; the same on all ranks.
    progress
        Called with a line before each substructure and interface; None: a progress bar if on a terminal.
    comm
        mpi4py communicator over which the parts are spread; collective. None: this process alone,
        with a warning if it is one of several.

    Returns
    -------
    Problem
        Frozen.

    Raises
    ------
    SceneError
        Everything that is wrong with meshes, materials, faces, laws, and parts that can move
        without resistance. If one rank fails, all raise.
    """
    check_optional_kind("assemble", "comm", comm, MPI.Intracomm, "give an mpi4py communicator, or None")
    if comm == MPI.COMM_NULL:
        raise SceneError("assemble: comm is MPI.COMM_NULL, or was freed; give another, or None")
    comm = None if comm is None or (comm.size == 1 and MPI.COMM_WORLD.size == 1) else comm
    spread = own_communicator(comm) if comm is not None and comm.size > 1 else None
    with one_call(spread, "assemble"):
        return _checked_assembly(scene, progress, comm)


def placed(scene: Scene, comm: Any) -> dict[str, int]:
    """Part -> the rank of a communicator that it belongs to; None: there is one rank."""
    between = [each.faces for each in scene.interfaces.values() if isinstance(each.law, Perfect)]
    glue = [(faces[0].substructure, faces[-1].substructure) for faces in between]
    return place(
        scene.substructures,
        1 if comm is None else comm.size,
        _kept_together(scene),
        grouped(list(scene.substructures), glue),
    )


def assembled_again(
    scene: Scene, before: Problem, progress: Callable[[str], None] | None = None, *, comm: Any = None
) -> Problem:
    """Assemble a scene of which some parts were assembled before; collective.

    Parts with the same mesh and degree are the same objects again, and so are interfaces between these that
    nothing else changes.

    Parameters
    ----------
    before
        Of the same scene with other meshes of some parts, over the same ranks.
    comm
        As for :func:`assemble`; every part has the rank that it had.
    """
    # inertia relief changes the loads of all parts
    return _checked_assembly(scene, progress, comm, before if scene.densities is None else None)


def _checked_assembly(
    scene: Scene, progress: Callable[[str], None] | None, comm: Any, before: Problem | None = None
) -> Problem:
    check_kind("assemble", "scene", scene, Scene, "give a Scene, which describes the parts and interfaces")
    if progress is not None:
        checked_callable("assemble", "progress", progress, "give a function of a line, or None")
    if not scene.substructures:
        raise SceneError("the scene is empty; add substructures")
    began = perf_counter()
    count = len(scene.substructures) + len(scene.interfaces)
    first = comm is None or comm.rank == 0
    with Bar(count, "assemble", "item", progress is None and first) as bar:

        def say(line: str) -> None:
            stop_if_pressed()
            bar.step()
            _log.debug("%s", line)
            if progress is not None:
                progress(line)

        problem = _assemble(scene, say, comm, before)
    if first:
        _log.info(
            "assembled %d unknowns in %d substructures, %d interfaces, %.2f s",
            problem.size,
            len(problem.parts),
            len(problem.interfaces),
            perf_counter() - began,
        )
    return problem


def _assemble(scene: Scene, say: Callable[[str], None], comm: Any, before: Problem | None = None) -> Problem:
    if comm is None and MPI.COMM_WORLD.size > 1:
        warn(
            f"{MPI.COMM_WORLD.size} ranks are running, and each assembles all of the scene: pass "
            "comm=MPI.COMM_WORLD to spread it over them, comm=MPI.COMM_SELF if this is meant (as for points "
            "over ranks, points_comm=)",
            SceneWarning,
        )
    comm = None if comm is None or comm.size == 1 else comm
    if comm is not None:
        comm = own_communicator(comm)
        end_all_on_errors(comm)
        check_alike(comm, "assemble", _described(scene))
        bound_threads(comm.py2f())
    owner = placed(scene, comm)
    rank = 0 if comm is None else comm.rank

    _check_ties(scene, owner)
    spread = {
        name: _known_on_ranks(before, spec)
        or condensed(spec, comm, owner[name], _faces_of(scene, name), scene.densities is not None)
        for name, spec in scene.substructures.items()
        if spec.spread
    }
    substructures, copies = _own_parts(scene, owner, rank, say, comm, before, spread)
    found = swap(comm, copies)
    with agreement(comm):
        elsewhere = lent_faces(scene, substructures, found)
        held = held_nodes(scene, substructures, elsewhere)
        told: dict[int, dict[_Where, Held | None]] = {
            other: {where: _renumbered(held.get(where), scene, substructures, where) for where in faces}
            for other, faces in copies.items()
        }
    held.update({where: each for where, each in swap(comm, told).items() if each is not None})
    kept: set[str] = set()
    if before is not None:
        kept = {name for name, s in substructures.items() if s is before.substructures.get(name)}
        if comm is not None:
            kept = {name for each in exchanged(comm, kept) for name in each}
    centres = _centres(scene, substructures, comm)
    interfaces = _own_interfaces(
        scene, owner, rank, substructures, elsewhere, held, centres, say, comm, before, kept
    )
    relief: dict[str, Interface] = {}
    with agreement(comm):
        if scene.densities is not None and owner[next(iter(scene.substructures))] == rank:
            relief = relief_supports(substructures[next(iter(scene.substructures))])
    interfaces = {**interfaces, **relief}
    summaries = {name: summary(s) for name, s in substructures.items()}
    resistances = {
        name: resistance_of(i, substructures[i.sides[0].substructure].length)
        for name, i in interfaces.items()
        if owner[i.sides[0].substructure] == rank
    }
    if comm is not None:
        bare = {name: _bare(interfaces[name]) for name in resistances}
        for known, its in ((summaries, summaries), (resistances, resistances), (interfaces, bare)):
            for each in exchanged(comm, its):
                known.update({n: value for n, value in each.items() if n not in known})
        laws = {name: joint.law for name, joint in scene.interfaces.items()}
        for of_relief in exchanged(comm, {name: each.law for name, each in relief.items()}):
            laws |= of_relief
        interfaces = {
            name: interfaces[name] if interfaces[name].law is law else replace(interfaces[name], law=law)
            for name, law in laws.items()
        }
    parts = {name: summaries[name] for name in scene.substructures}
    if len({part.dim for part in parts.values()}) > 1:
        raise SceneError("the parts have different dimensions; a scene has one dimension")
    check_units(scene, substructures, parts)
    check_cold(scene)
    check_resistances(
        {name: (part.centre, part.length) for name, part in parts.items()},
        [
            *(resistances[name] for name in interfaces),
            *own_resistances(parts),
        ],
    )
    loads = {}
    with agreement(comm):
        for name, load in scene.loads.items():
            if load.part not in spread:
                loads[name] = part_load(load, substructures.get(load.part))
    for name, load in scene.loads.items():
        if load.part in spread:
            whole = spread[load.part].condensed
            loads[name] = spread_load(load, whole, substructures.get(load.part))
    loads = {name: loads[name] for name in scene.loads}
    if scene.densities is not None:
        inertia = Relief(substructures, densities_of(scene), parts, comm)
        loads = {name: inertia.load_balanced(each) for name, each in loads.items()}
        substructures = inertia.parts_balanced()
    if comm is None:
        return Problem(substructures, interfaces, None, loads, dict(held), centres=centres)
    forces = [spec.body_force for spec in scene.substructures.values()]
    amplitudes = amplitudes_of([f for f in forces if isinstance(f, Varying)])
    parts = with_cells(comm, parts, substructures)
    return Problem(
        substructures,
        interfaces,
        Distribution(comm, owner, parts, tuple(amplitudes)),
        loads,
        dict(held),
        spread={name: each.condensed for name, each in spread.items()},
        centres=centres,
    )


def _described(scene: Scene) -> dict[str, object]:
    """What all ranks must be given alike, but for the meshes, of which each may have its own only."""
    given: dict[str, object] = {
        "the list of substructures": list(scene.substructures),
        "the list of interfaces": list(scene.interfaces),
    }
    for name, spec in scene.substructures.items():
        for what in ("material", "degree", "body_force", "rank", "stiffness"):
            given[f"{what} of substructure {name!r}"] = getattr(spec, what)
    given["the densities of inertia_relief"] = scene.densities
    given["the list of loads"] = list(scene.loads)
    for name, load in scene.loads.items():
        given[f"load {name!r}"] = (load.part, load.kind, load.face)
        given[f"the values of load {name!r}"] = load.values
    for name, joint in scene.interfaces.items():
        given[f"the law of interface {name!r}"] = joint.law
        given[f"the faces of interface {name!r}"] = tuple(map(str, joint.faces))
        for what in ("quadrature_degree", "max_distance", "space", "overlap", "remote"):
            given[f"{what} of interface {name!r}"] = getattr(joint, what)
    return given


def _kept_together(scene: Scene) -> list[list[str]]:
    """Parts that are on one rank: of a rigid group, and of springs and beams between mean motions."""
    pairs = []
    for joint in scene.interfaces.values():
        parts = [face.substructure for face in joint.faces]
        tied = joint.law.elimination is Elimination.TIED
        if tied or joint.remote is not None:
            pairs += [(parts[0], other) for other in (*parts[1:], *(joint.law.partners if tied else ()))]
    return [group for group in grouped(list(scene.substructures), pairs) if len(group) > 1]


def _check_ties(scene: Scene, owner: Mapping[str, int]) -> None:
    """Refuse rigid faces that something else holds, or on several ranks."""
    tied = {i.faces[0]: i for i in scene.interfaces.values() if i.law.elimination is Elimination.TIED}
    for joint in scene.interfaces.values():
        for face in joint.faces:
            own = tied.get(face)
            twice = joint.law.rigid and not (joint.law.unilateral or joint.law.bolt)
            if own is not None and own is not joint and twice:
                raise SceneError(
                    f"interface {joint.name!r}: {face} is rigid by {own.name!r}, and {joint.law.title} would "
                    "hold its nodes a second time: add the other face to the rigid group, give its motion "
                    "there, or use Elastic or Contact"
                )
    for joint in tied.values():
        ranks = {owner[joint.faces[0].substructure], *(owner[part] for part in joint.law.partners)}
        if len(ranks) > 1:
            raise SceneError(
                f"interface {joint.name!r}: its rigid group has parts on ranks {sorted(ranks)}; it works on "
                "one rank: give these parts the same rank= in scene.substructure"
            )


def _faces_of(scene: Scene, part: str) -> list[str]:
    """Faces of a part that the scene uses."""
    every = [face for joint in scene.interfaces.values() for face in joint.faces]
    used = [face.face for face in every if face.substructure == part]
    used += [load.face for load in scene.loads.values() if load.part == part and load.face]
    return list(dict.fromkeys(used))


_Where = tuple[str, int]
"""An interface, and the number of a side of it."""


def _known(before: Problem | None, spec: SubstructureSpec) -> Substructure | None:
    """A part as it was assembled before; None: it has another mesh or degree now."""
    part = None if before is None else before.substructures.get(spec.name)
    frames = frames_of(part)
    if frames is not None:
        return part if frames.given is spec.matrix else None
    if part is None or part.part is not spec.part:
        return None
    return part if int(part.space.element.basix_element.degree) == spec.degree else None


def _known_on_ranks(before: Problem | None, spec: SubstructureSpec) -> SpreadPart | None:
    """The same of a part whose mesh is spread over the ranks; all of them know it, or none."""
    whole = None if before is None else before.spread.get(spec.name)
    if before is None or whole is None or whole.part is not spec.part or whole.ratio != 1.0:
        return None
    if int(whole.space.element.basix_element.degree) != spec.degree:
        return None
    here = before.substructures.get(spec.name)
    return SpreadPart(whole, None if here is None else replace(spec, source=here.part), here)


def _same_held(one: Held | None, other: Held | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in ("nodes", "directions", "least"))


def _known_interface(
    before: Problem | None,
    spec: InterfaceSpec,
    kept: Container[str],
    held: Mapping[_Where, Held],
    centres: tuple[Array, ...],
) -> Interface | None:
    """An interface as it was assembled before; None: something of it is new. `kept` parts are as before, on
    whatever rank."""
    if before is None or spec.name not in before.interfaces:
        return None
    for number, face in enumerate(spec.faces):
        if face.substructure not in kept:
            return None
        if not _same_held(held.get((spec.name, number)), before.held.get((spec.name, number))):
            return None
    known = before.interfaces[spec.name]
    if known.space == "mortar" and len(known.sides) == 2 and not np.allclose(before.centres, centres):
        return None
    return known


def _own_parts(
    scene: Scene,
    owner: Mapping[str, int],
    rank: int,
    say: Callable[[str], None],
    comm: Any,
    before: Problem | None,
    spread: Mapping[str, SpreadPart],
) -> tuple[dict[str, Substructure], dict[int, dict[_Where, FaceCopy | PointSet]]]:
    """Parts of this rank, and what others need of them (other rank -> (interface, side) -> face)."""
    substructures: dict[str, Substructure] = {}
    copies: dict[int, dict[_Where, FaceCopy | PointSet]] = {}
    with agreement(comm):
        specs = {}
        for name, spec in scene.substructures.items():
            if owner[name] == rank:
                say(f"substructure {name}")
                if name in spread:
                    own, part = spread[name].spec, spread[name].part
                    assert own is not None and part is not None
                    specs[name], substructures[name] = own, part
                    continue
                specs[name] = spec.made()
                made = discretise if specs[name].matrix is None else discretised_matrix
                substructures[name] = _known(before, specs[name]) or made(specs[name])
        for name, joint in scene.interfaces.items():
            for face in joint.faces:
                if owner[face.substructure] == rank and not (joint.remote and joint.remote.nodes):
                    check_face(specs[face.substructure], face, f"interface {name!r}")
        for name, joint in scene.interfaces.items():
            ranks = [owner[face.substructure] for face in joint.faces]
            for number, face in enumerate(joint.faces):
                if ranks[number] != rank:
                    continue
                other = ranks[1 - number] if len(ranks) == 2 else rank
                if other != rank and joint.remote is not None:
                    raise SceneError(
                        f"interface {name!r}: its parts are on ranks {ranks[0]} and {ranks[1]}; it works on "
                        "one rank: give both parts the same rank= in scene.substructure"
                    )
                if other != rank:
                    s = substructures[face.substructure]
                    copies.setdefault(other, {})[name, number] = copy_of(s, face.face, f"interface {name!r}")
    return substructures, copies


def _renumbered(
    held: Held | None, scene: Scene, substructures: Mapping[str, Substructure], where: _Where
) -> Held | None:
    """What holds a face, with the nodes of its copy on another rank."""
    if held is None:
        return None
    face = scene.interfaces[where[0]].faces[where[1]]
    s = substructures[face.substructure]
    if frames_of(s) is not None:  # its copy has the numbers of the part
        return held
    facets = FacetMap(s.part, face.face, f"interface {where[0]!r}")
    return replace(held, nodes=np.searchsorted(copied_nodes(facets, s.space), held.nodes))


def _centres(scene: Scene, substructures: Mapping[str, Substructure], comm: Any) -> tuple[Array, ...]:
    """Centres of what holds the scene, of what loads it, and of its parts, as far as there is any."""
    sums: dict[int, Array] = {}
    with agreement(comm):
        for joint in scene.interfaces.values():
            part = substructures.get(joint.faces[0].substructure)
            if len(joint.faces) == 1 and part is not None:
                holds = joint.law.elimination is not Elimination.LOAD
                _add(sums, 0 if holds else 1, part, joint.faces[0].face, joint.remote)
        for load in scene.loads.values():
            part = substructures.get(load.part)
            if load.face and part is not None:
                _add(sums, 1, part, load.face, None)
        for part in substructures.values():
            sums[2] = sums.get(2, 0.0) + np.append(part.volume * part.centre, part.volume)
    if comm is not None:
        of_ranks = exchanged(comm, sums)
        known = set().union(*of_ranks)
        sums = {k: np.sum([each[k] for each in of_ranks if k in each], axis=0) for k in known}
    return tuple(read_only(each[:-1] / each[-1]) for _, each in sorted(sums.items()))


def _add(sums: dict[int, Array], kind: int, part: Substructure, face: str, remote: Remote | None) -> None:
    """Add area times place, and area, of a face; nodes count as faces as large as the part."""
    x: Array
    area: Array
    if remote is not None and remote.nodes:
        x = np.array(remote.nodes)
        area = np.full(len(x), part.length ** (part.dim - 1))
    elif frames_of(part) is not None:
        on = PointsOf(part, face, f"substructure {part.name!r}")
        x, area = on.centre[None], np.array([on.area])
    else:
        facets = FacetMap(part.part, face, f"substructure {part.name!r}")
        rule, weights = facets.rule(2)
        x, area = facets.samples.mean(axis=1), (weights * facets.alike_surface(rule)[1]).sum(axis=1)
    sums[kind] = sums.get(kind, 0.0) + np.append(area @ x, area.sum())


def _own_interfaces(
    scene: Scene,
    owner: Mapping[str, int],
    rank: int,
    substructures: Mapping[str, Substructure],
    elsewhere: Mapping[_Where, FaceCopy],
    held: Mapping[_Where, Held],
    centres: tuple[Array, ...],
    say: Callable[[str], None],
    comm: Any,
    before: Problem | None,
    kept: Container[str],
) -> dict[str, Interface]:
    """Interfaces that touch this rank; `elsewhere` has the faces that are on other ranks."""
    interfaces = {}
    with agreement(comm):
        for name, joint in scene.interfaces.items():
            ranks = [owner[face.substructure] for face in joint.faces]
            if rank not in ranks:
                continue
            say(f"interface {name}")
            known = _known_interface(before, joint, kept, held, centres)
            if known is not None:
                interfaces[name] = known
                continue
            alone = len(joint.faces) == 1 and frames_of(substructures[joint.faces[0].substructure])
            if joint.remote is not None or alone:
                parts = tuple(substructures[face.substructure] for face in joint.faces)
                interfaces[name] = remote_interface(joint, parts)
                _check_law(interfaces[name])
                continue
            members = [
                elsewhere.get((name, number)) or substructures[face.substructure]
                for number, face in enumerate(joint.faces)
            ]
            interface = make_interface(
                name,
                joint.law,
                tuple(s.part if isinstance(s, Substructure) else s for s in members),
                tuple((f.substructure, f.face) for f in joint.faces),
                tuple(s.space for s in members),
                joint.quadrature_degree,
                joint.max_distance,
                joint.space,
                joint.overlap,
                tuple(held.get((name, number)) for number in range(len(members))),
                centres,
            )
            lent = members[interface.carrier]
            interface = lent.drawn(interface) if isinstance(lent, LentFace) else interface
            _check_law(interface)
            interfaces[name] = interface
    return interfaces


def _bare(interface: Interface) -> Interface:
    """What other ranks must be told of an interface: no law, which they have, and no traces."""
    nothing, none = sp.csr_matrix((0, 0)), np.zeros(0, dtype=np.int64)
    return replace(
        interface,
        law=Perfect(),
        matching=None if interface.matching is None else np.zeros((0, 2), dtype=np.int64),
        facets=none,
        areas=nothing,
        vertices=None,
        sides=tuple(
            replace(side, trace=None, shape=nothing, nodes=none, node_normals=side.node_normals[:0])
            for side in interface.sides
        ),
    )
