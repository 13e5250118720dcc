"""Finer meshes of parts: on their true geometry where they know how to be meshed, else cells cut in pieces.

Cells that are cut keep the geometry that they have: straight ones on a round face stay on its chords, curved
ones on the parabolas of the mesh that was given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import basix
import basix.ufl
import dolfinx.fem as fem
import numpy as np
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.checks import check_kind, checked_callable
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map, create_mesh, vertex_nodes
from dolfinx_frontend.common.straight import moved_tags, sorted_tags, straight_mesh
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.geometry.sizes import SizeField

__all__ = [
    "SIMPLICES",
    "Model",
    "OfModel",
    "bisected",
    "cell_sizes",
    "halved",
    "remeshable",
    "remeshable_model",
    "size_field",
]

SIMPLICES = ("triangle", "tetrahedron")


def remeshable(make: Callable[[SizeField | None], Part]) -> Part:
    """A part of a function that can mesh it again, for ``solve(scene, accuracy=...)``.

    Parameters
    ----------
    make
        Takes a :class:`SizeField`, or None for its own mesh; returns the part, with the same faces each time.
        Within a session of gmsh ``size.set(gmsh)`` sets the sizes; ``size(points)`` returns them at points.
    """
    checked_callable("remeshable", "make", make, "give a function of a SizeField, or None, that makes a Part")
    part = make(None)
    check_kind("remeshable", "what make(None) returned", part, Part, "return a Part")
    return Part(part.mesh, part.facet_tags, part.names, make)


class Model:
    """Parts that one function makes together, so that their meshes match where they touch.

    Parameters
    ----------
    make
        See :func:`remeshable_model`.
    """

    def __init__(self, make: Callable[[Mapping[str, SizeField] | None], Mapping[str, Part]]) -> None:
        self._make = make

    def parts(self, sizes: Mapping[str, SizeField] | None) -> dict[str, Part]:
        """The parts with other sizes; None: with their own."""
        made = self._make(sizes)
        check_kind("remeshable_model", "what make returned", made, Mapping, "return {name: Part}")
        for name, part in made.items():
            check_kind("remeshable_model", f"part {name!r} of what make returned", part, Part, "return Parts")
        return {n: Part(p.mesh, p.facet_tags, p.names, OfModel(self, n)) for n, p in made.items()}


@dataclass(frozen=True)
class OfModel:
    """How a part of a model is meshed again: with all of it."""

    model: Model
    name: str

    def __call__(self, sizes: SizeField | None) -> Part:
        """The part alone, which need not match the others any more."""
        return self.model.parts(None if sizes is None else {self.name: sizes})[self.name]


def remeshable_model(
    make: Callable[[Mapping[str, SizeField] | None], Mapping[str, Part]],
) -> dict[str, Part]:
    """Parts of one model, which ``solve(scene, accuracy=...)`` meshes again all at once: meshes that match go
    on matching.

    Parameters
    ----------
    make
        Takes a :class:`SizeField` for each part by its name (or for some of them), or None for its own mesh;
        returns the parts, with the same names and faces each time. Within a session of gmsh
        ``SizeField.joined(sizes.values()).set(gmsh)`` sets the sizes.
    """
    checked_callable("remeshable_model", "make", make, "give a function of {part: SizeField}, or of None")
    return Model(make).parts(None)


def cell_sizes(mesh: dmesh.Mesh) -> Array:
    """Mean length of the edges of every cell, (cells,)."""
    kind = basix.CellType[str(mesh.topology.cell_name())]
    count = len(np.asarray(basix.geometry(kind)))
    x: Array = np.asarray(mesh.geometry.x, dtype=np.float64)
    corners: Array = x[np.asarray(cell_nodes(mesh))[:, :count]]
    edges = np.asarray(basix.topology(kind)[1])
    lengths = np.linalg.norm(corners[:, edges[:, 0]] - corners[:, edges[:, 1]], axis=2)
    return np.asarray(lengths.mean(axis=1), dtype=np.float64)


def size_field(mesh: dmesh.Mesh, wanted: Array) -> SizeField:
    """Sizes (cells,) of the cells of a mesh as a field: at its vertices the geometric means around."""
    kind = basix.CellType[str(mesh.topology.cell_name())]
    nodes = np.asarray(cell_nodes(mesh))[:, : len(np.asarray(basix.geometry(kind)))]
    kept, cells = np.unique(nodes, return_inverse=True)
    cells = cells.reshape(nodes.shape)
    each = np.repeat(np.log(wanted), nodes.shape[1])
    total = np.bincount(cells.ravel(), each)
    sizes = np.exp(total / np.bincount(cells.ravel()))
    x = np.asarray(mesh.geometry.x, dtype=np.float64)[kept, : mesh.geometry.dim]
    return SizeField(x, cells.astype(np.int64), sizes)


def bisected(part: Any, ratios: Array, rounds: int = 3) -> Part:
    """A part of triangles or tetrahedra with some of its cells cut, their neighbours as far as they must be.

    Parameters
    ----------
    ratios
        (cells,), wanted size relative to that of each cell; cells are halved while they are above by 1.4.
    rounds
        Times that a cell is halved at most.
    """
    for _ in range(rounds):
        cut = ratios < 1.0 / np.sqrt(2.0)
        if not cut.any():
            break
        before = cell_sizes(part.mesh)
        part, parent = _cut(part, cut)
        ratios = np.minimum(ratios[parent] * before[parent] / cell_sizes(part.mesh), 1.0)
    return Part(part.mesh, part.facet_tags, part.names, getattr(part, "again", None))


def _cut(part: Any, marked: Flags) -> tuple[Part, Ints]:
    """Halve the edges of the marked cells. Returns the part, and the cell that each of its cells is from."""
    mesh, order = part.mesh, int(coordinate_map(part.mesh).degree)
    base, tags = (mesh, part.facet_tags) if order == 1 else straight_mesh(part)
    topology = base.topology
    topology.create_entities(1)
    topology.create_connectivity(topology.dim, 1)
    if order > 1:
        marked = marked[_original(base)]
    edges = dmesh.compute_incident_entities(
        topology, np.flatnonzero(marked).astype(np.int32), topology.dim, 1
    )
    option: Any = getattr(dmesh, "RefinementOption").parent_cell_and_facet  # noqa: B009
    fine, parent, facet = dmesh.refine(base, edges, partitioner=None, option=option)
    d = fine.topology.dim
    for one, other in ((d - 1, d), (d, d - 1), (d - 1, 0)):
        fine.topology.create_connectivity(one, other)
    topology.create_connectivity(d, d - 1)
    topology.create_connectivity(d - 1, d)
    moved = dmesh.transfer_meshtag(tags, fine, parent, facet)
    found = Part(fine, sorted_tags(fine, moved.indices, moved.values), dict(part.names))
    # as a tag: the order of `parent` is that of the cells before they were renumbered
    every = np.arange(topology.index_map(d).size_local, dtype=np.int32)
    of_cells = dmesh.transfer_meshtag(dmesh.meshtags(base, d, every, every), fine, parent)
    origin = np.zeros(fine.topology.index_map(d).size_local, dtype=np.int64)
    origin[of_cells.indices] = of_cells.values
    return (found, origin) if order == 1 else _curved(part, base, found, origin, order)


def _original(mesh: dmesh.Mesh) -> Ints:
    return np.asarray(mesh.topology.original_cell_index, dtype=np.int64)


def _curved(part: Any, base: dmesh.Mesh, fine: Part, parent: Ints, order: int) -> tuple[Part, Ints]:
    """The cut cells on the geometry of the curved ones that they are from."""
    name, d = str(base.topology.cell_name()), base.geometry.dim
    of_old = _original(base)[parent]  # cells of the curved mesh
    space = fem.functionspace(fine.mesh, ("Lagrange", order))
    lattice = np.asarray(space.element.basix_element.points)
    straight: Array = np.asarray(fine.mesh.geometry.x, dtype=np.float64)[cell_nodes(fine.mesh)][:, :, :d]
    at = straight[:, :1] + np.einsum("qk,cki->cqi", lattice, straight[:, 1:] - straight[:, :1])
    origin: Array = np.asarray(base.geometry.x, dtype=np.float64)[cell_nodes(base)][parent][:, :, :d]
    jacobian = np.swapaxes(origin[:, 1:] - origin[:, :1], 1, 2)
    reference = np.einsum("cki,cqi->cqk", np.linalg.inv(jacobian), at - origin[:, :1])
    x = _mapped(part.mesh, of_old, reference)
    cells = np.asarray(space.dofmap.list, dtype=np.int64)
    nodes = np.zeros((cells.max() + 1, d))
    nodes[cells] = x
    mesh = create_mesh(cells, nodes, name, order)
    # the first nodes of a cell are its vertices
    names = np.zeros(fine.mesh.topology.index_map(0).size_local, dtype=np.int64)
    fine.mesh.topology.create_connectivity(d, 0)
    corners = np.asarray(fine.mesh.topology.connectivity(d, 0).array).reshape(-1, d + 1)
    names[corners] = cells[:, : d + 1]
    rows = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    tags = moved_tags(fine.mesh, names, fine.facet_tags, mesh, rows[vertex_nodes(mesh)])
    return Part(mesh, tags, dict(part.names)), of_old[_original(mesh)]


def _mapped(mesh: dmesh.Mesh, cells: Ints, reference: Array) -> Array:
    """Places (n, q, d) of reference points (n, q, d) of cells (n,)."""
    cmap = coordinate_map(mesh)
    kind = basix.CellType[str(mesh.topology.cell_name())]
    element = basix.create_element(
        basix.ElementFamily.P, kind, int(cmap.degree), basix.LagrangeVariant(int(cmap.variant))
    )
    d = mesh.geometry.dim
    values = np.asarray(element.tabulate(0, reference.reshape(-1, d)), dtype=np.float64)
    shapes = values[0, :, :, 0].reshape(*reference.shape[:2], -1)
    x = np.asarray(mesh.geometry.x, dtype=np.float64)[np.asarray(cell_nodes(mesh))[cells]][:, :, :d]
    return np.asarray(np.einsum("cqk,cki->cqi", shapes, x))


def halved(part: Any) -> Part:
    """A part of quadrilaterals or hexahedra with every cell cut in 2^d, on the geometry that it has."""
    mesh, d = part.mesh, part.mesh.geometry.dim
    name, order = str(mesh.topology.cell_name()), int(coordinate_map(mesh).degree)
    # the nodes of the pieces are a lattice of the cell, which a Lagrange space numbers
    lattice = basix.ufl.element(
        "Lagrange", name, 2 * order, lagrange_variant=basix.LagrangeVariant.equispaced
    )
    space = fem.functionspace(mesh, lattice)
    points = np.asarray(lattice.basix_element.points)
    place = np.rint(points * 2 * order).astype(np.int64)
    number = {tuple(int(v) for v in p): k for k, p in enumerate(place)}
    own = basix.ufl.element("Lagrange", name, order, lagrange_variant=basix.LagrangeVariant.equispaced)
    inside = np.rint(np.asarray(own.basix_element.points) * order).astype(np.int64)
    dofs = np.asarray(space.dofmap.list, dtype=np.int64)
    count = len(dofs)
    x = np.zeros((dofs.max() + 1, d))
    x[dofs] = _mapped(mesh, np.arange(count), np.broadcast_to(points, (count, *points.shape)))
    pieces = []
    for corner in np.ndindex(*(2,) * d):
        shift = order * np.asarray(corner)
        pieces.append(dofs[:, [number[tuple(int(v) for v in p + shift)] for p in inside]])
    fine = create_mesh(np.concatenate(pieces), x, name, order)
    tags = _tags_by_place(part, fine)
    return Part(fine, tags, dict(part.names), getattr(part, "again", None))


def _tags_by_place(part: Any, fine: dmesh.Mesh) -> Any:
    """Tags of the facets of the pieces of cells: a facet has the tag of the one that it is a piece of."""
    mesh, d = part.mesh, part.mesh.topology.dim
    for one, other in ((d - 1, d), (d, d - 1)):
        mesh.topology.create_connectivity(one, other)
        fine.topology.create_connectivity(one, other)
    count = int(mesh.topology.index_map(d).size_local)
    # a piece is from the cell with its number modulo the count, at the corner with the number above
    at = _original(fine)
    parent, corner = at % count, at // count
    kind = basix.CellType[str(mesh.topology.cell_name())]
    corners = np.asarray(basix.geometry(kind))
    on_side = [  # local facet -> its axis and end
        (int(axis), int(round(corners[list(facet)][0, axis])))
        for facet in basix.topology(kind)[d - 1]
        for axis in [int(np.argmin(np.ptp(corners[list(facet)], axis=0)))]
    ]
    bits = np.array(list(np.ndindex(*(2,) * d)))
    value = np.zeros(int(mesh.topology.index_map(d - 1).size_local), dtype=np.int32)
    value[part.facet_tags.indices] = part.facet_tags.values
    of_cell = np.asarray(mesh.topology.connectivity(d, d - 1).array).reshape(count, -1)
    of_piece = np.asarray(fine.topology.connectivity(d, d - 1).array).reshape(len(at), -1)
    found = np.zeros(int(fine.topology.index_map(d - 1).size_local), dtype=np.int32)
    for k, (axis, end) in enumerate(on_side):
        outer = bits[corner, axis] == end
        found[of_piece[outer, k]] = value[of_cell[parent[outer], k]]
    facets = np.flatnonzero(found).astype(np.int32)
    return sorted_tags(fine, facets, found[facets])
