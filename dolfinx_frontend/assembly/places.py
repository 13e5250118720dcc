"""Points inside parts: in which cell they lie, and what its unknowns give there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import geometry

from dolfinx_frontend.assembly.elements import tabulate
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Place", "place_of"]

NEAR = 1e-6
"""Distance from a part, relative to its size, within which a point is one of its points."""


@dataclass(frozen=True)
class Place:
    """A point of a part.

    Attributes
    ----------
    cell
        Its number.
    reference
        (d,), where it is in the reference cell.
    nodes, shape
        Nodes of the cell, and values (nodes,) of their shape functions.
    """

    cell: int
    reference: Array
    nodes: Ints
    shape: Array


def place_of(where: str, mesh: Any, space: Any, point: Array) -> Place:
    """The place of a point (d,) in a part.

    Raises
    ------
    SceneError
        It is outside, with how far.
    """
    d = int(mesh.geometry.dim)
    x = np.zeros((1, 3))
    x[0, :d] = point
    count = int(mesh.topology.index_map(d).size_local)
    size = float(np.ptp(np.asarray(mesh.geometry.x)[:, :d], axis=0).max())
    tree = geometry.bb_tree(mesh, d, padding=NEAR * size)
    candidates = geometry.compute_collisions_points(tree, x)
    cells = np.asarray(candidates.array, dtype=np.int32)
    found = geometry.compute_colliding_cells(mesh, candidates, x).array
    if len(found):
        cell = int(found[0])
    else:
        every = cells if len(cells) else np.arange(count, dtype=np.int32)
        gaps = [float(np.linalg.norm(geometry.compute_distance_gjk(_vertices(mesh, c), x))) for c in every]
        best = int(np.argmin(gaps))
        if gaps[best] > NEAR * size:
            shown = ", ".join(f"{v:.6g}" for v in point)
            raise SceneError(
                f"{where}: the point ({shown}) is {gaps[best]:.4g} outside the part; give one inside or on "
                "its "
                "surface"
            )
        cell = int(every[best])
    nodes = np.asarray(mesh.geometry.x)[cell_nodes(mesh)[cell]][:, :d]
    reference = np.asarray(coordinate_map(mesh).pull_back(x[:, :d], nodes))[0]
    values = tabulate(space.element.basix_element, 0, reference[None])[0, 0]
    return Place(cell, reference, np.asarray(space.dofmap.list)[cell].astype(np.int64), values)


def _vertices(mesh: Any, cell: int) -> Array:
    corners = mesh.topology.connectivity(mesh.topology.dim, 0).links(cell)
    shape = len(corners)
    found: Array = np.asarray(mesh.geometry.x, dtype=np.float64)[cell_nodes(mesh)[cell][:shape]]
    return found
