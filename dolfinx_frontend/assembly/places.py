"""Points inside parts: in which cell they lie, and what its unknowns give there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import geometry

from dolfinx_frontend.assembly.elements import tabulate
from dolfinx_frontend.assembly.matrix_part import frames_of
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.substructure import NEAR, Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Place", "place_in", "place_of", "place_on_ranks"]


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


def place_of(where: str, s: Substructure, point: Array) -> Place:
    """The place of a point (d,) in a part.

    Raises
    ------
    SceneError
        It is outside, with how far.
    """
    tree, size = s.boxes
    cell, gap = _nearest(s.part.mesh, point, tree)
    _check_gap(where, point, gap, size)
    return _placed(s.part.mesh, s.space, cell, point)


def place_in(where: str, s: Substructure, point: Array) -> Place:
    """The place of a point (d,) in a part, which may be a matrix: then at one of its points.

    Raises
    ------
    SceneError
        As for :func:`place_of`.
    """
    frames = frames_of(s)
    if frames is None:
        return place_of(where, s, point)
    away = np.linalg.norm(frames.given.points - point, axis=1)
    at = int(np.argmin(away))
    if away[at] > NEAR * s.length:
        place, near = (", ".join(f"{v:.6g}" for v in x) for x in (point, frames.given.points[at]))
        raise SceneError(
            f"{where}: ({place}) is no point of {s.name!r}, which is a matrix; the nearest one is at "
            f"({near}), {away[at]:.4g} away"
        )
    return Place(0, np.zeros(s.dim), np.array([at]), np.ones(1))


def place_on_ranks(where: str, mesh: Any, space: Any, point: Array) -> tuple[int, Place]:
    """The rank that has the cell of a point (d,) of a part whose mesh is spread over the ranks, and its place
    there; collective.

    Raises
    ------
    SceneError
        As for :func:`place_of`, on all ranks.
    """
    comm, d = mesh.comm, int(mesh.geometry.dim)
    x = np.asarray(mesh.geometry.x)[:, :d]
    boxes = comm.allgather((x.min(axis=0), x.max(axis=0)) if len(x) else None)
    known = [box for box in boxes if box is not None]
    low, high = (join([box[k] for box in known], axis=0) for k, join in ((0, np.min), (1, np.max)))
    size = float((high - low).max())
    with agreement(comm):
        cell, gap = _nearest(mesh, point, geometry.bb_tree(mesh, d, padding=NEAR * size))
    gaps = comm.allgather(gap)
    rank = int(np.argmin(gaps))
    _check_gap(where, point, gaps[rank], size)
    place: Place | None = None
    with agreement(comm):
        if comm.rank == rank:
            place = _placed(mesh, space, cell, point)
    found: Place = comm.bcast(place, root=rank)
    return rank, found


def _nearest(mesh: Any, point: Array, tree: Any) -> tuple[int, float]:
    """The cell of this rank that a point is in, or is nearest to, and how far it is from it; `tree`: of the
    boxes of the cells."""
    d = int(mesh.geometry.dim)
    count = int(mesh.topology.index_map(d).size_local)
    if not count:
        return -1, float("inf")
    x = np.zeros((1, 3))
    x[0, :d] = point
    candidates = geometry.compute_collisions_points(tree, x)
    found = geometry.compute_colliding_cells(mesh, candidates, x).array
    found = found[found < count]  # the others are those of other ranks
    if len(found):
        return int(found[0]), 0.0
    cells = np.asarray(candidates.array, dtype=np.int32)
    cells = cells[cells < count]
    every = cells if len(cells) else np.arange(count, dtype=np.int32)
    gaps = [float(np.linalg.norm(geometry.compute_distance_gjk(_vertices(mesh, c), x))) for c in every]
    best = int(np.argmin(gaps))
    return int(every[best]), gaps[best]


def _check_gap(where: str, point: Array, gap: float, size: float) -> None:
    if gap > NEAR * size:
        shown = ", ".join(f"{v:.6g}" for v in point)
        raise SceneError(
            f"{where}: the point ({shown}) is {gap:.4g} outside the part; give one inside or on its surface"
        )


def _placed(mesh: Any, space: Any, cell: int, point: Array) -> Place:
    """Where in a cell a point is."""
    d = int(mesh.geometry.dim)
    nodes = np.asarray(mesh.geometry.x)[cell_nodes(mesh)[cell]][:, :d]
    reference = np.asarray(coordinate_map(mesh).pull_back(np.reshape(point, (1, d)), nodes))[0]
    values = tabulate(space.element.basix_element, 0, reference[None])[0, 0]
    return Place(cell, reference, np.asarray(space.dofmap.list)[cell].astype(np.int64), values)


def _vertices(mesh: Any, cell: int) -> Array:
    corners = mesh.topology.connectivity(mesh.topology.dim, 0).links(cell)
    shape = len(corners)
    found: Array = np.asarray(mesh.geometry.x, dtype=np.float64)[cell_nodes(mesh)[cell][:shape]]
    return found
