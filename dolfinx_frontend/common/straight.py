"""Meshes with straight cells, and tags of facets that go from one mesh to another."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.compat import cell_nodes, create_mesh, vertex_nodes

__all__ = ["moved_tags", "sorted_tags", "straight_mesh"]


def sorted_tags(mesh: dmesh.Mesh, facets: npt.NDArray[np.int32], values: npt.NDArray[np.int32]) -> Any:
    """Tags of facets in any order."""
    order = np.argsort(facets)
    d = mesh.topology.dim - 1
    return dmesh.meshtags(mesh, d, np.asarray(facets)[order], np.asarray(values)[order])


def straight_mesh(part: Any) -> tuple[dmesh.Mesh, Any]:
    """The mesh of a part with straight cells, in the same order, and its tags."""
    mesh = part.mesh
    name = str(mesh.topology.cell_name())
    mesh.topology.create_connectivity(mesh.topology.dim, 0)
    count = mesh.topology.connectivity(mesh.topology.dim, 0).links(0).size
    corners = np.asarray(cell_nodes(mesh))[:, :count]  # vertices come first among the nodes of a cell
    kept, cells = np.unique(corners, return_inverse=True)
    x = np.asarray(mesh.geometry.x)[kept, : mesh.geometry.dim]
    straight = create_mesh(cells.reshape(corners.shape).astype(np.int64), x, name, 1)
    # vertices of the new mesh -> nodes of the old one
    rows = np.asarray(straight.geometry.input_global_indices, dtype=np.int64)
    of_new = kept[rows[vertex_nodes(straight)]]
    tags = moved_tags(mesh, vertex_nodes(mesh), part.facet_tags, straight, of_new)
    # cells in the order of the old mesh, so that what is said of one holds for the other
    return straight, tags


def moved_tags(mesh: dmesh.Mesh, names: Any, tags: Any, other: dmesh.Mesh, of_other: Any) -> Any:
    """The tags of facets of a mesh on another one whose vertices have the same names."""

    def keys(of: dmesh.Mesh, known: Any) -> Any:
        d = of.topology.dim
        of.topology.create_entities(d - 1)
        of.topology.create_connectivity(d - 1, 0)
        links = of.topology.connectivity(d - 1, 0)
        width = links.links(0).size
        return np.sort(known[np.asarray(links.array).reshape(-1, width)], axis=1)

    both = np.concatenate([keys(mesh, names)[tags.indices], keys(other, of_other)])
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.ravel()
    count = len(tags.indices)
    value = np.zeros(number.max() + 1, dtype=np.int32)
    value[number[:count]] = tags.values
    found = value[number[count:]]
    facets = np.flatnonzero(found).astype(np.int32)
    return sorted_tags(other, facets, found[facets])
