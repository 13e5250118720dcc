"""Differences between dolfinx releases, found by feature and not by version number.

dolfinx renamed its gmsh module (``dolfinx.io.gmshio`` became ``dolfinx.io.gmsh``), swapped the order of
the arguments of ``create_mesh`` and lists the cells of a mesh by their type. The rest of the package goes
through this module and does not know which release is installed.
"""

from __future__ import annotations

import importlib
from typing import Any

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import mesh as dmesh
from mpi4py import MPI

__all__ = [
    "cell_nodes",
    "component",
    "coordinate_map",
    "create_mesh",
    "gmsh_cell_permutation",
    "vertex_nodes",
]


def _gmsh_reader() -> Any:
    """The module of dolfinx that reads gmsh models."""
    try:
        return importlib.import_module("dolfinx.io.gmsh")
    except ModuleNotFoundError as missing:
        if missing.name != "dolfinx.io.gmsh":  # present, but gmsh itself is not installed
            raise
        return importlib.import_module("dolfinx.io.gmshio")


def gmsh_cell_permutation(cell: str, nodes: int) -> npt.NDArray[np.intp]:
    """Node order of a gmsh cell.

    Parameters
    ----------
    cell
        Cell name, for example ``"tetrahedron"``.
    nodes
        Nodes per cell (10 for a second-order tetrahedron).

    Returns
    -------
    ndarray of int, (nodes,)
        ``p`` such that ``cells_dolfinx = cells_gmsh[:, p]``.
    """
    permutation = _gmsh_reader().cell_perm_array(dmesh.to_type(cell), nodes)
    return np.asarray(permutation, dtype=np.intp)


def create_mesh(
    cells: npt.NDArray[np.int64],
    x: npt.NDArray[np.float64],
    cell: str,
    order: int,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> dmesh.Mesh:
    """A mesh on this process alone, or spread over those of a communicator, which all call it.

    Parameters
    ----------
    cells
        Nodes of each cell in dolfinx order, (cells, nodes per cell).
    x
        Coordinates, (nodes, gdim); every node belongs to some cell.
    cell
        Cell name.
    order
        Order of the geometry (1 straight, 2 curved).
    comm
        Of several processes each may give some of the cells and nodes; the nodes of lower ranks come first.
    """
    element = basix.ufl.element(
        "Lagrange",
        cell,
        order,
        lagrange_variant=basix.LagrangeVariant.equispaced,
        shape=(x.shape[1],),
    )
    # keywords: the order of e and x changed between releases
    return dmesh.create_mesh(comm=comm, cells=cells, e=ufl.Mesh(element), x=x)


def cell_nodes(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    """Rows of ``mesh.geometry.x`` that each cell uses, (cells, nodes per cell)."""
    dofmaps = getattr(mesh.geometry, "dofmaps", None)  # a method in some releases
    return dofmaps[0] if isinstance(dofmaps, list) else mesh.geometry.dofmap


def component(space: Any) -> tuple[Any, npt.NDArray[np.int32]]:
    """The space of one component of a vector-valued one, and the unknown of that one of each of its own."""
    alone, dofs = space.sub(0).collapse()
    return alone, np.asarray(dofs[0] if isinstance(dofs[0], np.ndarray) else dofs)  # a list by types of cells


def vertex_nodes(mesh: dmesh.Mesh) -> npt.NDArray[np.int64]:
    """Row of ``mesh.geometry.x`` of every vertex of a mesh on one process, (vertices,)."""
    topology = mesh.topology
    topology.create_connectivity(topology.dim, 0)
    vertices = topology.connectivity(topology.dim, 0)
    nodes = np.empty(topology.index_map(0).size_local, dtype=np.int64)
    # vertices come first among the nodes of a cell
    nodes[vertices.array] = cell_nodes(mesh)[:, : vertices.links(0).size].reshape(-1)
    return nodes


def coordinate_map(mesh: dmesh.Mesh) -> Any:
    """The coordinate element of the cells."""
    cmaps = getattr(mesh.geometry, "cmaps", None)
    return cmaps[0] if isinstance(cmaps, list) else mesh.geometry.cmap
