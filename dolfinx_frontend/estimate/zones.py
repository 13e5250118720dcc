"""What a scene tells a search for meshes: soft springs, contact zones, places of errors, random loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.compat import cell_nodes
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.estimate.cells import Cells
from dolfinx_frontend.estimate.unseen import extent
from dolfinx_frontend.plan.random_laws import RandomLaws, Source
from dolfinx_frontend.results.contact import CLOSED as STICKS
from dolfinx_frontend.results.contact import OPEN, SLIPS, ContactValues, contact_states, slip_use
from dolfinx_frontend.results.errors import Place
from dolfinx_frontend.results.probes import AtPoint
from dolfinx_frontend.results.readings import column_of
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Quantile, Resultant, Wanted
from dolfinx_frontend.results.surfaces import law_contact
from dolfinx_frontend.scene.laws import Elimination
from dolfinx_frontend.scene.loads import OF_STIFFNESS
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.uncertainty.fields import DiscretisedField

__all__ = [
    "RESOLVED",
    "SEEN",
    "Zones",
    "acted",
    "all_values_of",
    "contact_zones",
    "loading",
    "parts_read",
    "places_of",
    "soft_springs",
    "values_of",
]

COARSER = 1.5
"""Facets of the side with the points, relative to those of the other side, at most."""

RESOLVED, SEEN = 6.0, 3.0
"""Closed points of a contact zone with an edge, in each direction, at least: to be believed as any other,
and if what is said of its mesh fits twice; and without an edge, that one would be seen."""

NEARLY_USED = 0.7
"""Share of the friction limit above which points that stick on one mesh may slip on another."""

COVERED = 0.99
"""Share of a face from which on all of it counts as covered."""

CLOSED = 1e-6
"""Pressure relative to the largest above which a point of an interface counts as closed."""


def soft_springs(scene: Scene, problem: Problem, meshes: Mapping[str, Cells]) -> list[str]:
    """Interfaces of springs that are softer than the cells beside them, whose space was left open.

    At points these hold exactly, whatever the meshes; means about vertices leave out how jumps vary between
    them, which no estimate sees. Stiff springs would lock at points.
    """
    found = []
    for name, spec in scene.interfaces.items():
        if spec.space != "auto" or spec.overlap != "full" or spec.remote is not None or len(spec.faces) != 2:
            continue
        interface, law = problem.interfaces[name], spec.law.nominal
        if law.elimination is not Elimination.SPRINGS or law.unilateral or not law.linear:
            continue
        first, second = (len(meshes[side.substructure].faces[side.face][0]) for side in interface.sides)
        if not (first and second):
            continue  # points of a matrix
        size = (extent(problem, interface) / first) ** (1.0 / (interface.dim - 1))
        other = (extent(problem, interface, 1) / second) ** (1.0 / (interface.dim - 1))
        if np.any(interface.chords):
            continue  # points on one polygon are not on the other
        if size > COARSER * other:
            continue  # between the points nothing would hold the second side
        modulus = min(problem.parts[side.substructure].modulus for side in interface.sides)
        if float(law.stiffnesses(interface).max(initial=0.0)) * size < modulus:
            found.append(name)
    return found


class Zones(NamedTuple):
    """Contact zones at an answer.

    Attributes
    ----------
    edges
        Active interface that may open -> its points (k, d) around which some are open, stick or slip and some
        do not, at a time that the end remembers.
    across
        Closed points of the zone with the fewest in each direction, infinite where none has an edge and all
        have enough.
    alike
        Interface all of whose points do the same although friction is used (nearly) up -> its closed points
        (k, d), and what they do at every such time: a finer mesh may show an edge.
    """

    edges: dict[str, Array]
    across: float
    alike: dict[str, tuple[Array, bytes]]


def contact_zones(result: Result, step: int = -1) -> Zones:
    """What the contacts of an answer do at a step of a load history; collective."""
    out, across, alike, problem = {}, np.inf, {}, result.problem
    unilateral = [name for name in result.plan.active if problem.interfaces[name].law.unilateral]
    with agreement(problem.comm):
        forces = {name: np.asarray(result.force(name)) for name in unilateral if problem.speaks_for(name)}
    for name, force in problem.gather(forces).items():
        interface = problem.interfaces[name]
        contact = law_contact(result.problem, result.plan, name)
        force = force.reshape(-1, *force.shape[-2:])
        state, used = _states(interface, contact, force[: step % len(force) + 1])
        closed = state[-1] != OPEN
        if not closed.any():
            continue
        own = float(np.count_nonzero(closed) ** (1.0 / (interface.dim - 1)))
        uniform = interface.covered > COVERED and bool(np.all(state == state[:, :1]))
        if uniform and contact is not None and np.any(np.ptp(contact.clearance, axis=-1) > 0.0):
            out[name] = interface.points[closed]  # between the points nothing has its gap
        elif uniform and own >= SEEN - 1e-9:
            if used > NEARLY_USED:
                alike[name] = interface.points[closed], state[:, 0].tobytes()
            continue
        across = min(across, own)
        if uniform or own < RESOLVED - 1e-9:
            out[name] = interface.points[closed]
            continue
        count = min(interface.num_points, 3 if interface.dim == 2 else 7)
        _, around = spatial.cKDTree(interface.points).query(interface.points, k=count)
        mixed = np.any(state[:, around].min(axis=2) != state[:, around].max(axis=2), axis=0)
        if mixed.any():
            out[name] = interface.points[mixed]
    return Zones(out, across, alike)


def _states(
    interface: Interface, contact: ContactValues | None, force: Array
) -> tuple[Array, float]:
    """Where a contact is open, sticks or slips (times, m) by its force (times, m, components), at its end or,
    where that remembers them, at all times; and the largest share of the friction limit that is used."""
    last = len(force)
    first = 0 if interface.law.history else last - 1
    force = force[first:]
    normal, shear = force[..., 0], np.linalg.norm(force[..., 1:], axis=-1)
    closed = normal < -CLOSED * np.abs(normal).max(axis=-1, keepdims=True, initial=0.0)
    limits = None if contact is None else contact.limits
    if limits is None:
        return np.where(closed, STICKS, OPEN), 0.0
    # of a law that does not change in time there is one
    friction, threshold = (each[0] if each.shape[1] == 1 else each[0, first:last] for each in limits)
    slips = contact_states(normal, shear, (friction, threshold))[1]
    used = float(slip_use(normal, shear, (friction, threshold)).max(initial=0.0))
    return np.where(closed, np.where(slips, SLIPS, STICKS), OPEN), used


def places_of(
    problem: Problem, meshes: Mapping[str, Cells], cells: Mapping[str, Array]
) -> tuple[Place, ...]:
    """Parts by what their cells contribute, the largest first; those below a hundredth are left out. All
    ranks have the cells of all parts and their contributions. Collective."""
    sums = {name: float(each.sum()) for name, each in cells.items()}
    total = sum(sums.values())
    ranked = [name for name in sorted(sums, key=lambda n: -sums[n]) if sums[name] > 0.01 * total]
    own = {}
    with agreement(problem.comm):
        for name in ranked:
            first, count = 0, len(cells[name])
            if name in problem.spread:
                mesh = problem.spread[name].part.mesh
                first, end = mesh.topology.index_map(mesh.topology.dim).local_range
                count = int(end - first)
            elif name in problem.own.substructures:
                mesh = problem.substructures[name].part.mesh
            else:
                continue
            worst = int(cells[name].argmax()) - int(first)
            if not 0 <= worst < count:  # of another rank
                continue
            nodes = np.asarray(mesh.geometry.x)[np.asarray(cell_nodes(mesh))[worst], : mesh.geometry.dim]
            at = tuple(float(v) for v in nodes.mean(axis=0))
            size = float(meshes[name].sizes.min())
            own[name] = Place(name, sums[name] / total, at, len(cells[name]), size)
    found = problem.gather(own, parts=True)
    return tuple(found[name] for name in ranked)


def parts_read(result: Result, quantity: Wanted) -> set[str]:
    """Parts that a number is read from, or on which an interface lies that it is read from; over several
    ranks, or where a function reads no field, all parts."""
    problem = result.problem
    inner = quantity.inner if isinstance(quantity, Quantile) else quantity
    found: set[str] = set()

    def beside(interface: str) -> None:
        if interface in problem.interfaces:
            found.update(side.substructure for side in problem.interfaces[interface].sides)

    if isinstance(inner, Resultant):
        beside(inner.interface)
        return found
    if problem.comm is not None:
        return set(problem.parts)

    def told(read: Callable[..., Any], tell: Callable[[str], None]) -> Callable[..., Any]:
        def reads(name: str, *more: Any) -> Any:
            tell(name)
            return read(name, *more)

        return reads

    block = result.shown()
    shown = replace(
        block,
        _both=told(block._both, beside),
        _contact=told(block._contact, beside),
        _force=None if block._force is None else told(block._force, beside),
        _displacement=told(block._displacement, found.add),
    )
    function = inner.function
    if isinstance(function, str):
        function = column_of(result, function)
    (function.on(problem) if isinstance(function, AtPoint) else function)(shown)
    return found or set(problem.parts)


def loading(random: RandomLaws) -> list[tuple[str, Source]]:
    """What is random and loads the structure: its key (``"interface.parameter"``) and source."""
    laws = random.problem.interfaces
    found = [
        (f"{name}.{parameter}", source)
        for (name, parameter), source in random.sources.items()
        if parameter not in laws[name].law.spans and parameter != "friction"
    ]
    return found + [
        (f"{term.load}.{term.parameter}", source)
        for term, own in random.loads.items()
        for source in own
        if term.load != OF_STIFFNESS
    ]


def all_values_of(random: RandomLaws, xi: Array) -> dict[str, Any]:
    """Values of what is random at a point (1, L) of the germs, stiffnesses of interfaces, too."""
    return values_of(random, xi, stiffnesses=True)


def values_of(random: RandomLaws, xi: Array, stiffnesses: bool = False) -> dict[str, Any]:
    """Values of random loads at a point (1, L) of the germs."""
    values: dict[str, Any] = {}
    for (name, parameter), source in random.sources.items():
        if parameter in random.problem.interfaces[name].law.spans and not stiffnesses:
            continue
        drawn = random.space.values(source, xi)
        value: Any = drawn[:, 0] if isinstance(source, DiscretisedField) else float(drawn[0])
        amplitude = random.amplitude(name, parameter)
        values[f"{name}.{parameter}"] = value if amplitude is None else amplitude * value
    for term in random.loads:
        if term.load == OF_STIFFNESS:
            continue
        number = float(random.load_values(term, xi)[0])
        amplitude = term.amplitude
        values[f"{term.load}.{term.parameter}"] = number if amplitude is None else amplitude * number
    return values


def acted(result: Result, quantity: Wanted | None) -> float:
    """Size of the quantity in an answer, or its energy norm; collective."""
    if quantity is not None:
        return abs(result.mean_std(quantity).mean)
    own = {}
    for name, part in result.problem.own.substructures.items():
        u = np.asarray(result.displacements[name])
        last = u if u.ndim == 1 else u[-1]
        own[name] = float(last @ (part.matrix @ last))
    return float(np.sqrt(max(sum(result.problem.gather(own, parts=True).values()), 0.0)))
