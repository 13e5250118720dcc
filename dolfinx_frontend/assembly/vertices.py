"""The linear shape functions of a part's mesh among its own ones: the coarse level of a multigrid method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Flags, Ints
from dolfinx_frontend.common.compat import component
from dolfinx_frontend.common.deferred import sp

__all__ = ["Vertices", "in_thin_cells", "vertices_of"]

THIN = 4.0
"""Extents of a cell whose linear shape functions cannot bend: the largest over the smallest."""


class Vertices(NamedTuple):
    """Vertices of a mesh whose shape functions have a higher degree.

    Attributes
    ----------
    weights
        (nodes, vertices): the linear shape functions at all nodes.
    nodes
        (vertices,) node of each.
    """

    weights: sp.csr_matrix
    nodes: Ints


def vertices_of(part: Substructure) -> Vertices | None:
    """The vertices of a part; None: its shape functions are linear already."""
    space = part.space
    if int(space.element.basix_element.degree) < 2:
        return None
    fine, dofs = component(space)
    nodes_of = dofs // part.dim
    coarse = fem.functionspace(space.mesh, ("Lagrange", 1))
    matrix = fem_petsc.interpolation_matrix(coarse, fine)
    matrix.assemble()
    weights = csr(matrix)
    matrix.destroy()
    weights.data[np.abs(weights.data) < 1e-12] = 0.0
    weights.eliminate_zeros()
    single = np.flatnonzero(np.diff(weights.indptr) == 1)
    nodes = np.empty(weights.shape[1], dtype=np.int64)
    nodes[weights.indices[weights.indptr[single]]] = nodes_of[single]
    order = np.empty_like(nodes_of)
    order[nodes_of] = np.arange(len(nodes_of))
    return Vertices(weights[order], nodes)


def in_thin_cells(part: Substructure) -> Flags:
    """Nodes (nodes,) of cells that are much longer one way than another.

    Linear shape functions are too stiff in bending by the square of that ratio.
    """
    nodes = np.asarray(part.space.dofmap.list)
    found = np.zeros(len(part.dof_coordinates), dtype=bool)
    for some in np.array_split(nodes, len(nodes) // 50_000 + 1):
        places = part.dof_coordinates[some]
        away = places - places.mean(axis=1, keepdims=True)
        extents = np.linalg.eigvalsh(np.swapaxes(away, 1, 2) @ away)
        thin = extents[:, -1] > THIN**2 * extents[:, 0]
        found[some[thin]] = True
    return found
