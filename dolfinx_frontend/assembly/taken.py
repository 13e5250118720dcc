"""Cells of a mesh that is spread over the ranks, taken out of it: meshes of one rank.

Those along faces, of all ranks, for the one that owns the part; on every rank its own with the cells
around them, so that fits over neighbouring cells are those of the whole mesh; and all of them on one rank,
which can cut them and spread what it gets over the ranks again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import basix
import dolfinx.fem as fem
import numpy as np
from dolfinx import mesh as dmesh

from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map, create_mesh
from dolfinx_frontend.geometry.parts import Part

__all__ = [
    "Cells",
    "Surroundings",
    "cells_along",
    "joined",
    "meshed",
    "numbers_in",
    "on_one_rank",
    "spread_over",
]


class Cells(NamedTuple):
    """Some cells of a mesh that is spread over the ranks.

    Geometry nodes and nodes of unknowns by their global numbers, facets as (cell, number in it, tag).
    """

    cells: Ints
    nodes: Ints
    x: Array
    dofs: Ints
    places: Ints
    coordinates: Array
    facets: Ints


def cells_along(part: Any, space: Any, faces: Sequence[str]) -> Cells:
    """The cells of this rank along some faces."""
    wanted = [part.names[face] for face in faces]
    facets = _tagged_facets(part, np.flatnonzero(np.isin(part.facet_tags.values, wanted)))
    kept, facets[:, 0] = np.unique(facets[:, 0], return_inverse=True)
    return _taken(part, space, kept, facets)


def _tagged_facets(part: Any, at: Ints) -> Ints:
    """Some facets with tags, by their places among these, beside cells of this rank: (cell, number in it,
    tag)."""
    mesh, tags = part.mesh, part.facet_tags
    topology, tdim = mesh.topology, mesh.topology.dim
    topology.create_connectivity(tdim - 1, tdim)
    topology.create_connectivity(tdim, tdim - 1)
    facets, values = np.asarray(tags.indices)[at], np.asarray(tags.values)[at]
    to_cell = topology.connectivity(tdim - 1, tdim)
    cells = to_cell.array[to_cell.offsets[facets]] if len(facets) else np.zeros(0, dtype=np.int32)
    own = cells < topology.index_map(tdim).size_local  # a facet is told by the rank of its cell
    facets, values, cells = facets[own], values[own], cells[own]
    to_facet = topology.connectivity(tdim, tdim - 1)
    count = len(to_facet.offsets) - 1  # 0 on a rank without cells
    by_cell = to_facet.array.reshape(count, -1) if count else np.zeros((0, 1), dtype=np.int32)
    number = np.argmax(by_cell[cells] == facets[:, None], axis=1)
    return np.column_stack([cells, number, values]).astype(np.int64)


def _taken(part: Any, space: Any, kept: Ints, facets: Ints) -> Cells:
    """Some cells of this rank, by their local numbers."""
    mesh, d = part.mesh, int(part.mesh.geometry.dim)
    geometry, unknowns = cell_nodes(mesh)[kept], np.asarray(space.dofmap.list)[kept]
    local_nodes, local_dofs = np.unique(geometry), np.unique(unknowns)
    global_nodes = mesh.geometry.index_map().local_to_global(local_nodes.astype(np.int32))
    global_dofs = space.dofmap.index_map.local_to_global(local_dofs.astype(np.int32))
    return Cells(
        global_nodes[np.searchsorted(local_nodes, geometry)],
        global_nodes,
        np.asarray(mesh.geometry.x)[local_nodes][:, :d],
        global_dofs[np.searchsorted(local_dofs, unknowns)],
        global_dofs,
        space.tabulate_dof_coordinates()[local_dofs][:, :d],
        facets.astype(np.int64),
    )


def joined(pieces: Sequence[Cells]) -> Cells:
    """The cells of all ranks; nodes and unknowns are numbered from 0 in the order of their global numbers."""
    nodes, first = np.unique(np.concatenate([s.nodes for s in pieces]), return_index=True)
    places, at = np.unique(np.concatenate([s.places for s in pieces]), return_index=True)
    starts = np.cumsum([0, *(len(s.cells) for s in pieces)])
    shift = [np.array([start, 0, 0]) for start in starts]
    cells = [s.cells for s in pieces if len(s.cells)]
    dofs = [s.dofs for s in pieces if len(s.cells)]
    return Cells(
        np.searchsorted(nodes, np.concatenate(cells)),
        nodes,
        np.concatenate([s.x for s in pieces])[first],
        np.searchsorted(places, np.concatenate(dofs)),
        places,
        np.concatenate([s.coordinates for s in pieces])[at],
        np.concatenate([s.facets + move for s, move in zip(pieces, shift, strict=False)]),
    )


def meshed(part: Any, cells: Cells) -> Part:
    """The cells as a mesh of this rank, with the names of the faces."""
    mesh = create_mesh(cells.cells, cells.x, str(part.mesh.topology.cell_name()), _order(part))
    return _with_faces(mesh, cells.facets, part.names)


def _with_faces(mesh: Any, facets: Ints, names: Mapping[str, int]) -> Part:
    """A mesh with the facets that were told of the cells that it was made of, as far as it has them."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    mesh.topology.create_connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    count = int(mesh.topology.index_map(tdim).size_local)
    original = np.asarray(mesh.topology.original_cell_index)[:count]
    ascending = np.argsort(original)
    at = np.searchsorted(original[ascending], facets[:, 0])
    here = at < count
    here[here] = original[ascending[at[here]]] == facets[here, 0]
    cells, facets = ascending[at[here]], facets[here]
    of_cell = to_facet.array[to_facet.offsets[cells] + facets[:, 1]]
    order = np.argsort(of_cell)
    values = facets[order, 2].astype(np.int32)
    return Part(mesh, dmesh.meshtags(mesh, tdim - 1, of_cell[order], values), dict(names))


def on_one_rank(part: Any, owner: int) -> tuple[Part, Ints] | None:
    """All of a part on one rank, None elsewhere; collective.

    Returns the part there, and (cells,) the number of each of its cells among those of all ranks, those of
    the first one first.
    """
    mesh, comm = part.mesh, part.mesh.comm
    with agreement(comm):
        count = int(mesh.topology.index_map(mesh.topology.dim).size_local)
        facets = _tagged_facets(part, np.arange(len(part.facet_tags.indices)))
        own = _taken(part, fem.functionspace(mesh, ("Lagrange", 1)), np.arange(count), facets)
    pieces = comm.gather(own, root=owner)
    found: tuple[Part, Ints] | None = None
    with agreement(comm):
        if comm.rank == owner:
            made = meshed(part, joined(pieces))
            found = made, np.asarray(made.mesh.topology.original_cell_index, dtype=np.int64)
    return found


def spread_over(comm: Any, owner: int, part: Part | None) -> Part:
    """A part that one rank has spread over all of them, in pieces of about as many cells; collective.

    Parameters
    ----------
    part
        On the owner; None elsewhere.
    """
    told: Any = None
    with agreement(comm):
        if part is not None:
            mesh = part.mesh
            facets = _tagged_facets(part, np.arange(len(part.facet_tags.indices)))
            nodes = np.asarray(cell_nodes(mesh)).shape[1]
            told = part.cell, part.order, mesh.geometry.dim, nodes, facets, dict(part.names)
    cell, order, d, nodes, facets, names = comm.bcast(told, root=owner)
    cells: Ints = np.zeros((0, nodes), dtype=np.int64)
    x: Array = np.zeros((0, d))
    if part is not None:
        cells = np.asarray(cell_nodes(part.mesh), dtype=np.int64)
        x = np.asarray(part.mesh.geometry.x, dtype=np.float64)[:, :d]
    return _with_faces(create_mesh(cells, x, cell, order, comm), facets, names)


def _order(part: Any) -> int:
    return int(coordinate_map(part.mesh).degree)


def numbers_in(space: Any, cells: Cells) -> Ints:
    """Node of the space -> node of the cells. The nodes of a cell may come in another order."""
    mine = space.dofmap.list
    theirs = cells.dofs[np.asarray(space.mesh.topology.original_cell_index)]
    x = space.tabulate_dof_coordinates()[:, : cells.x.shape[1]]
    away = np.linalg.norm(x[mine][:, :, None] - cells.coordinates[theirs][:, None], axis=3)
    out = np.zeros(len(x), dtype=np.int64)
    out[mine] = np.take_along_axis(theirs, np.argmin(away, axis=2), axis=1)
    return out


class Surroundings:
    """The cells of this rank with some layers of those around them, as a mesh of its own; collective.

    Parameters
    ----------
    part, space
        As the scene has it, and displacements on its mesh.
    layers
        How many; a cell around has a corner in common.

    Attributes
    ----------
    part, space
        The same of these cells; None where there are none.
    own
        (k,) the number of each cell of this rank, in its order, among the cells of `part`.
    """

    def __init__(self, part: Any, space: Any, layers: int) -> None:
        mesh, comm = part.mesh, part.mesh.comm
        count = int(mesh.topology.index_map(mesh.topology.dim).size_local)
        none = np.zeros((0, 3), dtype=np.int64)
        with agreement(comm):
            pieces = [_taken(part, space, np.arange(count), none)]
            edge = _hull(mesh, count)
        corners = len(np.asarray(basix.geometry(basix.CellType[mesh.topology.cell_name()])))
        at_corners = pieces[0].cells[:, :corners]
        sent = np.zeros((comm.size, count), dtype=bool)
        sent[comm.rank] = True
        # of every rank: which of its cells are here, by their places, and which of this rank's it has
        self._here: list[list[Ints]] = [[] for _ in range(comm.size)]
        self._lent: list[list[Ints]] = [[] for _ in range(comm.size)]
        self._here[comm.rank].append(np.arange(count))
        self._lent[comm.rank].append(np.arange(count))
        places_taken = count
        for _ in range(layers):
            outgoing = []
            for rank, nodes in enumerate(comm.allgather(edge)):
                which = np.isin(at_corners, nodes).any(axis=1) & ~sent[rank]
                sent[rank] |= which
                self._lent[rank].append(np.flatnonzero(which))
                outgoing.append(_taken(part, space, np.flatnonzero(which), none) if which.any() else None)
            taken = []
            for rank, each in enumerate(comm.alltoall(outgoing)):
                if each is not None:
                    taken.append(each)
                    self._here[rank].append(places_taken + np.arange(len(each.cells)))
                    places_taken += len(each.cells)
            edge = np.unique(np.concatenate([edge[:0], *(each.cells[:, :corners].ravel() for each in taken)]))
            pieces += taken
        self.part: Part | None = None
        self.space: Any = None
        self.own: Ints = np.zeros(0, dtype=np.int64)
        places: Ints = np.zeros(0, dtype=np.int64)
        with agreement(comm):
            if count:
                cells = joined(pieces)
                self.part = meshed(part, cells)
                made = self.part.mesh
                degree = int(space.element.basix_element.degree)
                self.space = fem.functionspace(made, ("Lagrange", degree, (int(space.dofmap.bs),)))
                self.own = np.argsort(made.topology.original_cell_index)[:count]  # they came first
                places = cells.places[numbers_in(self.space, cells)]
        starts = np.array(comm.allgather(int(space.dofmap.index_map.local_range[0])))
        # of ranks without nodes the last one has them
        owner = np.searchsorted(starts, places, side="right") - 1
        self._of = [np.flatnonzero(owner == rank) for rank in range(comm.size)]
        self._asked = comm.alltoall([places[of] - start for of, start in zip(self._of, starts, strict=True)])
        self._comm, self._dim, self._count = comm, int(space.dofmap.bs), len(places)
        self._dim_of_x, self._none = int(mesh.geometry.dim), np.zeros(0, dtype=np.int64)

    def values(self, field: Any) -> Array:
        """Unknowns (n,) of `space` of a function on the whole mesh; collective."""
        nodal = np.asarray(field.x.array).reshape(-1, self._dim)
        out = np.zeros((self._count, self._dim))
        told = self._comm.alltoall([nodal[asked] for asked in self._asked])
        for of, values in zip(self._of, told, strict=True):
            out[of] = values
        return out.ravel()

    def field(self, of: Any) -> Any:
        """A function on the whole mesh as one on the mesh of `part`, None where there is none; collective.

        Parameters
        ----------
        of
            Of an element whose unknowns are values at points.
        """
        space, d = of.function_space, self._dim_of_x
        nodes, size = np.asarray(space.dofmap.list), int(space.dofmap.bs)
        x, values = space.tabulate_dof_coordinates()[:, :d], np.asarray(of.x.array).reshape(-1, size)
        lent = [nodes[np.concatenate([self._none, *cells])] for cells in self._lent]
        told = self._comm.alltoall([(x[own], values[own]) for own in lent])
        if self.part is None:
            return None
        made = fem.Function(fem.functionspace(self.part.mesh, space.ufl_element()))
        order = np.argsort(np.concatenate([place for places in self._here for place in places]))
        at = np.asarray(self.part.mesh.topology.original_cell_index)
        theirs, known = (np.concatenate(each)[order][at] for each in zip(*told, strict=True))
        mine = np.asarray(made.function_space.dofmap.list)
        points = made.function_space.tabulate_dof_coordinates()[:, :d]
        away = np.linalg.norm(points[mine][:, :, None] - theirs[:, None], axis=3)
        nearest = np.argmin(away, axis=2)[:, :, None]  # the nodes of a cell may come in another order
        made.x.array.reshape(-1, size)[mine] = np.take_along_axis(known, nearest, axis=1)
        return made


def _hull(mesh: Any, count: int) -> Ints:
    """Corners, by their global numbers, on the boundary of the own cells, which those of others may have."""
    topology = mesh.topology
    d = topology.dim
    topology.create_connectivity(d - 1, d)
    topology.create_connectivity(d, d - 1)
    topology.create_connectivity(d - 1, 0)
    links = topology.connectivity(d - 1, d)
    facet = np.repeat(np.arange(len(links.offsets) - 1), np.diff(links.offsets))
    own = np.bincount(facet[np.asarray(links.array) < count], minlength=len(links.offsets) - 1)
    facets = np.flatnonzero(own == 1).astype(np.int32)
    if not len(facets):
        return np.zeros(0, dtype=np.int64)
    nodes = np.unique(dmesh.entities_to_geometry(mesh, d - 1, facets)).astype(np.int32)
    return np.asarray(mesh.geometry.index_map().local_to_global(nodes), dtype=np.int64)
