"""Errors of meshes that recovered stresses do not show: round faces of few cells, springs on means.

Straight cells leave out what lies between a chord and its arc, and are too much where the face is hollow. To
first order a layer of thickness t on a face changes a quantity by int t sigma(u) : eps(z), with the dual
solution z; what acts on the face acts on the length of the chord instead of that of the arc. How far the arc
is follows from how normals turn from facet to facet, so that this is an estimate of a smooth face.

Cells of degree 2 leave out what lies between a parabola and its arc: of a circle of radius R and an edge over
the angle phi on the mean R phi^4 / 960 (the parabola through three points of the circle is
R c^2 s^2 (1 - s^2) / 2 off, c = 1 - cos(phi / 2), s from -1 to 1), by which a shaft with seven edges around
has 0.14 % too little area.

Springs on means over an interface (``"mortar"``, ``"facets"``) leave out how the jump varies within these:
int k [u] . [z] less what their means have of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from dolfinx import mesh as dmesh

from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap, copied_nodes, face_copy
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, swap
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.kept import kept
from dolfinx_frontend.estimate.recovery import recovery
from dolfinx_frontend.scene.laws import Elimination
from dolfinx_frontend.scene.specs import PartLike

__all__ = [
    "CROSSING",
    "Longer",
    "of_chords",
    "of_crossing_chords",
    "of_shape",
    "of_shapes",
    "of_springs",
    "one_cell_across",
    "other_sides",
    "walls_not_seen",
]

SHARP = np.pi / 4.0
"""Turns of normals above this are edges of the part."""

CROSSING = 4.0
"""phi^2 / 6 over phi^2 / 24, by which an arc is longer than its chord."""

STIFF = 10.0
"""Stiffness of springs relative to the cells beside from which on these follow the jump."""

_EDGES = {
    "triangle": ((1, 2), (0, 2), (0, 1)),
    "tetrahedron": ((2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1)),
}
"""Corners of the edges of a cell, in the order of their middle nodes."""

FLAT = 1e-9
"""Sine of turns that are rounding."""


class _Round(NamedTuple):
    """Round exterior facets of a part."""

    cells: Ints  # (k,) beside them
    areas: Array  # (k,)
    thickness: Array  # (k,) mean distance of the smooth face, outwards, length
    longer: Array  # (k,) its area over that of the facet, less 1


def _round_facets(part: Substructure) -> _Round | None:
    """The facets whose normals turn to those beside, found when first asked for; None: there are none."""
    return kept(part, "_round", lambda: _found_round(part))


def _found_round(part: Substructure) -> _Round | None:
    mesh, d = part.part.mesh, part.dim
    if int(coordinate_map(mesh).degree) > 1:
        return _parabolas(part)
    topology = mesh.topology
    topology.create_connectivity(d - 1, d)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)
    links = topology.connectivity(d - 1, d)
    cells = np.array([links.links(int(f))[0] for f in facets], dtype=np.int64)
    nodes = np.asarray(dmesh.entities_to_geometry(mesh, d - 1, facets), dtype=np.int64)
    every = np.asarray(mesh.geometry.x, dtype=np.float64)
    x = every[nodes]  # (k, corners, 3)
    inside = every[np.asarray(cell_nodes(mesh))[cells]].mean(axis=1)
    if d == 2:
        along = x[:, 1] - x[:, 0]
        normals: Array = np.stack([along[:, 1], -along[:, 0], 0.0 * along[:, 0]], axis=1)
        pairs, share = [(0, 1)], 1.0 / 12.0
    else:
        quads = nodes.shape[1] == 4
        # corners of quadrilaterals go row by row
        first, second = ((0, 3), (1, 2)) if quads else ((0, 1), (0, 2))
        product = np.cross(x[:, first[1]] - x[:, first[0]], x[:, second[1]] - x[:, second[0]])
        normals = np.asarray(0.5 * product, dtype=np.float64)
        pairs = [(0, 1), (2, 3), (0, 2), (1, 3)] if quads else [(0, 1), (1, 2), (2, 0)]
        share = 1.0 / 24.0
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-300)[:, None]
    normals *= np.sign(np.einsum("ki,ki->k", normals, x.mean(axis=1) - inside))[:, None]
    turned = _normals_at_corners(nodes, normals, areas)
    thickness, longer = np.zeros(len(facets)), np.zeros(len(facets))
    for a, b in pairs:
        edge = x[:, b] - x[:, a]
        bend = np.einsum("ki,ki->k", turned[:, b] - turned[:, a], edge)  # curvature times length^2
        thickness += share * bend
        long = np.maximum(np.einsum("ki,ki->k", edge, edge), 1e-300)
        longer = np.maximum(longer, bend**2 / long / 24.0)
    kept = longer > FLAT**2
    if not kept.any():
        return None
    return _Round(cells[kept], areas[kept], thickness[kept], longer[kept])


def _parabolas(part: Substructure) -> _Round | None:
    """The same of triangles and tetrahedra of degree 2; None of others."""
    mesh, d = part.part.mesh, part.dim
    name = str(mesh.topology.cell_name())
    if int(coordinate_map(mesh).degree) != 2 or name not in _EDGES:
        return None
    topology = mesh.topology
    topology.create_connectivity(d - 1, d)
    topology.create_connectivity(d, d - 1)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)
    links, back = topology.connectivity(d - 1, d), topology.connectivity(d, d - 1)
    cells = np.array([links.links(int(f))[0] for f in facets], dtype=np.int64)
    local = np.array([int(np.flatnonzero(back.links(c) == f)[0]) for c, f in zip(cells, facets, strict=True)])
    nodes = np.asarray(cell_nodes(mesh))[cells]
    every = np.asarray(mesh.geometry.x, dtype=np.float64)
    x = every[nodes]  # (k, nodes of a cell, 3)
    thickness, longer, areas = (np.zeros(len(facets)) for _ in range(3))
    middle = {frozenset(edge): d + 1 + k for k, edge in enumerate(_EDGES[name])}
    for opposite in range(d + 1):  # a facet has the number of the corner that it has not
        of = local == opposite
        corners = [c for c in range(d + 1) if c != opposite]
        y = x[of]

        def tangent(a: int, b: int, y: Array = y) -> Array:
            """Of the edge from corner a to corner b, in a."""
            return np.asarray(4.0 * y[:, middle[frozenset((a, b))]] - 3.0 * y[:, a] - y[:, b])

        normals, count = {}, len(corners)
        if d == 3:
            straight = np.cross(*(y[:, c] - y[:, corners[0]] for c in corners[1:]))
        else:
            straight = _across(y, *corners)
        inwards = np.einsum("ki,ki->k", straight, y[:, corners[0]] - y[:, opposite])
        for n, a in enumerate(corners):
            # around the facet one way, so that all normals are on one side
            after, last = corners[(n + 1) % count], corners[n - 1]
            if d == 3:
                cross = np.cross(tangent(a, after), tangent(a, last))
            else:
                along = (1.0 - 2.0 * n) * tangent(a, after)
                cross = np.stack([along[:, 1], -along[:, 0], 0.0 * along[:, 0]], axis=1)
            cross *= np.sign(inwards)[:, None]
            normals[a] = cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None]
        first = y[:, corners[1]] - y[:, corners[0]]
        if d == 2:
            areas[of] = np.linalg.norm(first, axis=1)
        else:
            areas[of] = 0.5 * np.linalg.norm(np.cross(first, y[:, corners[2]] - y[:, corners[0]]), axis=1)
        for a, b in ((a, b) for a in corners for b in corners if a < b):
            turn = normals[b] - normals[a]
            square = np.einsum("ki,ki->k", turn, turn)
            bend = np.einsum("ki,ki->k", turn, y[:, b] - y[:, a])
            thickness[of] += (0.5 if d == 3 else 1.0) * bend * square / 960.0
            longer[of] = np.maximum(longer[of], square**2 / 960.0)
    kept = longer > FLAT**2
    if not kept.any():
        return None
    return _Round(cells[kept], areas[kept], thickness[kept], longer[kept])


def _across(y: Array, a: int, b: int) -> Array:
    """(k, 3) normals of plane edges from corner a to corner b."""
    along = y[:, b] - y[:, a]
    return np.stack([along[:, 1], -along[:, 0], 0.0 * along[:, 0]], axis=1)


def _normals_at_corners(nodes: Ints, normals: Array, areas: Array) -> Array:
    """(k, corners, 3) normals of the smooth face at corners of facets: means over facets that turn little."""
    count = nodes.shape[1]
    node, facet = nodes.ravel(), np.repeat(np.arange(len(nodes)), count)
    order = np.argsort(node, kind="stable")
    begin = np.searchsorted(node[order], np.arange(node.max() + 2))
    around = np.diff(begin)[node]
    out = np.zeros((len(node), 3))
    for k in range(int(around.max(initial=0))):
        some = np.flatnonzero(around > k)
        other = facet[order[begin[node[some]] + k]]
        cosine = np.einsum("ki,ki->k", normals[other], normals[facet[some]])
        weight = areas[other] * (cosine > np.cos(SHARP))
        out[some] += weight[:, None] * normals[other]
    out /= np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None]
    return out.reshape(*nodes.shape, 3)


def of_shapes(
    problem: Problem, fields: Mapping[str, Array], duals: Mapping[str, Array], value: float
) -> dict[str, float]:
    """Part -> what its cells on round faces do to a quantity of that value, in its unit, >= 0."""
    out = {}
    acted: dict[str, list[Array]] = {}
    for interface in problem.own.interfaces.values():
        for side in interface.sides:
            acted.setdefault(side.substructure, []).append(interface.points)
    for name, part in problem.own.substructures.items():
        if name not in fields or name in problem.spread:  # of which Piece.of_shape tells
            continue
        if not has_mesh(part):
            continue
        points = np.concatenate(acted.get(name, [np.zeros((0, part.dim))]))
        u = fields[name]
        layer, longer = of_shape(part, u, duals.get(name, u), points)
        out[name] = abs(layer) + longer.share * abs(value)
    return {name: error for name, error in out.items() if error != 0.0}


def of_shape(
    part: Substructure, u: Array, z: Array, points: Array, own: Ints | None = None
) -> tuple[float, Longer]:
    """What the layers between straight cells and round faces do to a quantity, with its sign, and how much
    longer than chords the arcs beside points are; of some of the cells."""
    found = _beside(part, own)
    if found is None:
        return 0.0, Longer()
    made = recovery(part)
    density = made.products(u, z) / made.volumes()
    layer = float(np.sum((found.thickness * found.areas) * density[found.cells]))
    # what acts on round faces acts on their chords
    return layer, _longer(part, found, points)


def _beside(part: Substructure, own: Ints | None) -> _Round | None:
    """Round facets beside some of the cells; None: there are none."""
    found = _round_facets(part)
    if found is None or own is None:
        return found
    kept = np.isin(found.cells, own)
    some = found.cells[kept], found.areas[kept], found.thickness[kept], found.longer[kept]
    return _Round(*some) if kept.any() else None


class Longer(NamedTuple):
    """Area of the chords of round facets, and what their arcs have more."""

    chords: float = 0.0
    more: float = 0.0

    @property
    def share(self) -> float:
        """Area of the arcs over that of their chords, less 1."""
        return self.more / self.chords if self.chords else 0.0

    @classmethod
    def together(cls, every: Sequence[Longer]) -> Longer:
        """Of several ranks."""
        return cls(sum(each.chords for each in every), sum(each.more for each in every))


def _longer(part: Substructure, found: _Round, points: Array) -> Longer:
    """Of round facets beside points."""
    if not len(points):
        return Longer()
    mesh, d = part.part.mesh, part.dim
    corners = np.asarray(mesh.geometry.x)[np.asarray(cell_nodes(mesh))[found.cells]][..., :d]
    centre = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    distance, _ = spatial.cKDTree(points).query(centre)
    areas = found.areas[distance <= reach]
    return Longer(float(areas.sum()), float(areas @ found.longer[distance <= reach]))


def one_cell_across(mesh: dmesh.Mesh) -> bool:
    """Whether all vertices of a mesh lie on its rim.

    In a wall of revolution of such linear cells the slope is the same everywhere and the hoop strain follows
    from the nodes: no estimate sees what is left of it.
    """
    topology = mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    topology.create_connectivity(topology.dim - 1, 0)
    facets = dmesh.exterior_facet_indices(topology)
    on_rim = dmesh.compute_incident_entities(topology, facets, topology.dim - 1, 0)
    return len(on_rim) >= int(topology.index_map(0).size_local)


def walls_not_seen(problem: Problem) -> list[str]:
    """Parts that are walls of revolution of one linear cell across; collective."""
    if not any(part.around for part in problem.parts.values()):
        return []
    own = {
        name: True
        for name, part in problem.own.substructures.items()
        if part.around and name not in problem.spread
        if int(part.space.element.basix_element.degree) == 1 and one_cell_across(part.part.mesh)
    }
    return list(problem.gather(own, parts=True))


def of_crossing_chords(problem: Problem) -> dict[str, float]:
    """Part -> relative error by the normals of its chords on interfaces that are not matched.

    There the chords of both sides cross: their normals differ from that of the arc by up to half the turn phi
    from facet to facet, which laws along and across see as phi^2 / 6; cells that are far smaller than the
    chords follow them altogether (measured with rings: 3.6 % where this says 3.7 %).
    """
    out: dict[str, float] = {}
    for interface in problem.own.interfaces.values():
        if len(interface.sides) != 2 or interface.matching is not None:
            continue
        for side in interface.sides:
            part = problem.own.substructures.get(side.substructure)
            if part is None or not has_mesh(part):
                continue
            if part.name not in problem.spread:  # of which Piece.of_chords tells
                turned = CROSSING * of_chords(part, interface.points).share
                out[part.name] = max(out.get(part.name, 0.0), turned)
    return {name: error for name, error in out.items() if error != 0.0}


def of_chords(part: Substructure, points: Array, own: Ints | None = None) -> Longer:
    """How much longer than the chords of a part beside points their arcs are; of some of its cells."""
    straight = int(coordinate_map(part.part.mesh).degree) == 1
    found = _beside(part, own) if straight else None
    return Longer() if found is None else _longer(part, found, points)


def extent(problem: Problem, interface: Interface, side: int = 0) -> float:
    """Area of a side, or length in 2D: of an axisymmetric one its length in the section."""
    area = interface.sides[side].area
    if not problem.parts[interface.sides[side].substructure].around:
        return float(area)
    return float(area / (2.0 * np.pi * np.average(interface.points[:, 0])))


def _on_means(interface: Interface) -> bool:
    """Whether an interface has linear springs on means."""
    law = interface.law.nominal
    if interface.space == "points" or law.elimination is not Elimination.SPRINGS:
        return False
    return law.linear and not law.unilateral and interface.covered >= 1.0 - 1e-3


class OtherSide(NamedTuple):
    """The side of an interface that is on another rank."""

    face: FaceCopy
    field: Array  # of the answer, at the nodes of the copy
    dual: Array


def other_sides(
    problem: Problem, fields: Mapping[str, Array], duals: Mapping[str, Array]
) -> dict[str, OtherSide]:
    """Interface of linear springs on means whose first side is on this rank -> its second side, which is on
    another one; collective."""
    comm, spread = problem.comm, problem.distribution
    if comm is None or spread is None:
        return {}
    outgoing: dict[int, dict[str, OtherSide]] = {}
    with agreement(comm):
        for name in problem.cuts:
            interface = problem.interfaces[name]
            first, second = (spread.owner[side.substructure] for side in interface.sides)
            if not _on_means(interface) or problem.rank not in (first, second):
                continue
            told = outgoing.setdefault(first if problem.rank == second else second, {})
            if problem.rank == second:
                side = interface.sides[1]
                part, where = problem.substructures[side.substructure], f"interface {name!r}"
                if not has_mesh(part):
                    continue
                nodes = copied_nodes(FacetMap(part.part, side.face, where), part.space)
                u, z = (each[part.name].reshape(-1, part.dim)[nodes].ravel() for each in (fields, duals))
                told[name] = OtherSide(face_copy(part.part, side.face, part.space, where), u, z)
    return swap(comm, outgoing)


def of_springs(
    problem: Problem,
    fields: Mapping[str, Array],
    duals: Mapping[str, Array],
    others: Mapping[str, OtherSide],
) -> dict[str, float]:
    """Interface of linear springs on means -> what these leave out of the quantity, in its unit, >= 0, on the
    rank of its first side. `others` are what :func:`other_sides` found."""
    out = {}
    for name, interface in problem.own.interfaces.items():
        if not _on_means(interface):
            continue
        law = interface.law.nominal
        known = [problem.own.substructures.get(side.substructure) for side in interface.sides]
        labels = tuple((side.substructure, side.face) for side in interface.sides)
        faces: list[PartLike | FaceCopy] = []
        spaces: list[Any] = []
        u: list[Array] = []
        z: list[Array] = []
        for part, (owner, _) in zip(known, labels, strict=True):
            if part is not None and part.name in fields and has_mesh(part):
                faces.append(part.part)
                spaces.append(part.space)
                u.append(fields[owner])
                z.append(duals[owner])
            elif part is None and name in others:
                faces.append(others[name].face)
                spaces.append(others[name].face.space)
                u.append(others[name].field)
                z.append(others[name].dual)
        if len(faces) < len(known):
            continue
        try:
            stiffness = law.stiffnesses(interface)
            at = make_interface(
                name, law, tuple(faces), labels, tuple(spaces), space="points", max_distance=10.0
            )
            both = _energy(at, law.stiffnesses(at), u, z)
        except SceneError:
            continue
        left = both - _energy(interface, stiffness, u, z)
        # stiff springs follow the cells instead: what they leave out is then less than this says
        count = max(len(np.unique(interface.facets)), 1)
        size = (extent(problem, interface) / count) ** (1.0 / max(interface.dim - 1, 1))
        modulus = min(problem.parts[side.substructure].modulus for side in interface.sides)
        stiff = float(stiffness.max(initial=0.0)) * size / modulus
        out[name] = abs(left) / (1.0 + (stiff / STIFF) ** 2)
    return out


def _energy(interface: Interface, stiffness: Array, u: Sequence[Array], z: Sequence[Array]) -> float:
    """int k [u] . [z] as the points of an interface have it, of fields by side."""
    jumps = []
    for field in (u, z):
        jump = np.zeros(interface.num_points * interface.dim)
        for number, own in enumerate(field):
            sign = 1.0 if len(field) == 1 else 2.0 * number - 1.0
            jump += sign * (interface.local_trace(number) @ own)
        jumps.append(jump.reshape(-1, interface.dim))
    return float(np.sum(interface.weights[:, None] * stiffness * jumps[0] * jumps[1]))
