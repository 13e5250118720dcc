"""A part with its displacement space as arrays, and the same part made from them in another process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import basix
import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map, create_mesh
from dolfinx_frontend.common.frozen import ReadOnlyDict, read_only
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.materials import matrix_stress

__all__ = ["StoredMaterial", "StoredPart", "facet_cells", "part_arrays"]

Tree = dict[str, Any]


def facet_cells(part: Any, facets: Ints) -> Ints:
    """Cell of each exterior facet, and the number of the facet in it, (k, 2)."""
    topology = part.mesh.topology
    tdim = topology.dim
    topology.create_connectivity(tdim - 1, tdim)
    topology.create_connectivity(tdim, tdim - 1)
    to_cell = topology.connectivity(tdim - 1, tdim)
    cells = to_cell.array[to_cell.offsets[facets]].astype(np.int64)
    to_facet = topology.connectivity(tdim, tdim - 1).array
    local = np.argmax(to_facet.reshape(-1, _facets_a_cell(part.mesh))[cells] == facets[:, None], axis=1)
    return np.stack([cells, local], axis=1)


def _facets_a_cell(mesh: dmesh.Mesh) -> int:
    return len(basix.topology(basix.CellType[mesh.topology.cell_name()])[mesh.topology.dim - 1])


def part_arrays(part: Any, space: Any, material: Any) -> Tree:
    """All that :class:`StoredPart` needs of a part: texts, numbers and arrays."""
    mesh = part.mesh
    element = space.element.basix_element
    tags = part.facet_tags
    facets = np.asarray(tags.indices, dtype=np.int64)
    tree: Tree = {
        "cell": str(mesh.topology.cell_name()),
        "order": int(coordinate_map(mesh).degree),
        "degree": int(element.degree),
        "lagrange": int(element.lagrange_variant),
        "x": np.asarray(mesh.geometry.x, dtype=np.float64)[:, : mesh.geometry.dim],
        "cells": np.asarray(cell_nodes(mesh), dtype=np.int64),
        "dofs": np.asarray(space.dofmap.list, dtype=np.int64),
        "facets": np.column_stack([facet_cells(part, facets), tags.values]).astype(np.int64),
        "faces": list(part.names),
        "tags": np.array(list(part.names.values()), dtype=np.int64),
    }
    elasticity = getattr(material, "elasticity", None)
    matrix = None if elasticity is None else elasticity(int(mesh.geometry.dim))
    if matrix is not None:
        tree["elasticity"] = np.asarray(matrix, dtype=np.float64)
    return tree


@dataclass(frozen=True)
class StoredMaterial:
    """Linear elasticity by its matrix, see :func:`dolfinx_frontend.scene.materials.matrix_stress`."""

    matrix: Any

    def stress(self, u: Any) -> Any:
        """Stress, UFL (d, d), force / area (in-plane components in 2D)."""
        return matrix_stress(self.matrix, u)

    def elasticity(self, dim: int) -> Any:
        """The matrix."""
        return self.matrix


class StoredPart:
    """A part read from a file; its mesh is made when it is first asked for.

    dolfinx renumbers cells and nodes: unknowns keep the numbers of the file, :meth:`function` puts them
    where they belong.

    Parameters
    ----------
    tree
        From :func:`part_arrays`.
    nodes
        (nodes, d) coordinates of the unknowns, in the file's numbers.

    Raises
    ------
    ValueError, LookupError, TypeError
        The arrays do not fit.
    """

    def __init__(self, name: str, tree: Tree, nodes: Array) -> None:
        self.name, self.dof_coordinates = name, nodes
        self._cell, self._order = str(tree["cell"]), int(tree["order"])
        self._degree, self._lagrange = int(tree["degree"]), int(tree["lagrange"])
        self._x = np.array(tree["x"], dtype=np.float64)
        self._cells, self._dofs, self._facets = (
            np.array(tree[key], dtype=np.int64) for key in ("cells", "dofs", "facets")
        )
        tags = np.array(tree["tags"], dtype=np.int64)
        names = zip(map(str, tree["faces"]), map(int, tags), strict=True)
        self.names: dict[str, int] = ReadOnlyDict(names)
        matrix = tree.get("elasticity")
        self.material = None
        if matrix is not None:
            self.material = StoredMaterial(read_only(np.array(matrix, dtype=np.float64)))
        if not (
            self._x.ndim == self._cells.ndim == self._dofs.ndim == self._facets.ndim == nodes.ndim == 2
            and len(self._cells) == len(self._dofs)
            and self._facets.shape[1] == 3
            and self._cells.min() >= 0
            and self._cells.max() < len(self._x)
            and self._dofs.min() >= 0
            and self._dofs.max() < len(nodes)
            and self._cell in basix.CellType.__members__
        ):
            raise ValueError(f"part {name!r}: its mesh does not fit together")

    def __getstate__(self) -> Tree:
        """What was read: a copy makes its own mesh."""
        return {name: each for name, each in vars(self).items() if name not in ("part", "V", "_numbers")}

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.dof_coordinates.shape[1])

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return self.dof_coordinates.size

    @cached_property
    def part(self) -> Part:
        """Mesh and faces."""
        mesh = create_mesh(self._cells, self._x, self._cell, self._order)
        tdim = mesh.topology.dim
        mesh.topology.create_connectivity(tdim, tdim - 1)
        to_facet = mesh.topology.connectivity(tdim, tdim - 1).array.reshape(-1, _facets_a_cell(mesh))
        facets = to_facet[self._new_cells(mesh)[self._facets[:, 0]], self._facets[:, 1]]
        order = np.argsort(facets)
        tags = self._facets[order, 2].astype(np.int32)
        return Part(mesh, dmesh.meshtags(mesh, tdim - 1, facets[order].astype(np.int32), tags), self.names)

    @staticmethod
    def _new_cells(mesh: dmesh.Mesh) -> Ints:
        """Cell of the file -> cell of the mesh."""
        return np.argsort(np.asarray(mesh.topology.original_cell_index))

    def facet_rows(self, face: str, cells: Ints) -> Ints:
        """Numbers of facets, given as :func:`facet_cells` has them, among those of a face."""
        mesh = self.part.mesh
        tdim = mesh.topology.dim
        to_facet = mesh.topology.connectivity(tdim, tdim - 1).array.reshape(-1, _facets_a_cell(mesh))
        facets = to_facet[self._new_cells(mesh)[cells[:, 0]], cells[:, 1]]
        rows: Ints = np.searchsorted(np.sort(self.part.facet_tags.find(self.names.get(face, -1))), facets)
        return rows

    @cached_property
    def V(self) -> fem.FunctionSpace:
        """The displacement space."""
        mesh = self.part.mesh
        variant = basix.LagrangeVariant(self._lagrange)
        element = basix.ufl.element(
            "Lagrange", mesh.topology.cell_name(), self._degree, lagrange_variant=variant, shape=(self.dim,)
        )
        return fem.functionspace(mesh, element)

    @property
    def space(self) -> fem.FunctionSpace:
        """The displacement space."""
        return self.V

    @cached_property
    def _numbers(self) -> Ints:
        """Node of the space -> node of the file."""
        mesh, mine = self.part.mesh, self.V.dofmap.list
        theirs = self._dofs[np.asarray(mesh.topology.original_cell_index)]
        x = self.V.tabulate_dof_coordinates()[:, : self.dim]
        # the nodes of a cell may come in another order
        away = np.linalg.norm(x[mine][:, :, None] - self.dof_coordinates[theirs][:, None], axis=3)
        out = np.zeros(len(x), dtype=np.int64)
        out[mine] = np.take_along_axis(theirs, np.argmin(away, axis=2), axis=1)
        return out

    def function(self, unknowns: Array, name: str) -> fem.Function:
        """Unknowns (n,), in the file's numbers, as a dolfinx function."""
        function = fem.Function(self.V, name=name)
        function.x.array[:] = unknowns.reshape(-1, self.dim)[self._numbers].ravel()
        return function
