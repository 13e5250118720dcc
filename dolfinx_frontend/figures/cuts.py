"""Solids that are cut open by a plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import vertex_nodes
from dolfinx_frontend.figures.solids import Solid, skin_of

__all__: list[str] = []

# tetrahedra of a cell, by its vertices in the order of dolfinx
_TETRAHEDRA = {
    "tetrahedron": [(0, 1, 2, 3)],
    "hexahedron": [(0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7)],
    "prism": [(0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5)],
}


def as_points(solid: Solid) -> Solid:
    """The same with colours at points; triangles of different colours do not share points then."""
    if len(solid.colours) == len(solid.points):
        return solid
    triangles = np.arange(3 * len(solid.triangles)).reshape(-1, 3)
    start = 3 * len(solid.triangles)
    points = np.concatenate([solid.points[solid.triangles.ravel()], solid.points])
    colours = np.concatenate([np.repeat(solid.colours, 3, axis=0), np.zeros_like(solid.points)])
    return Solid(points, triangles, colours, solid.thin + start, solid.thick + start)


def cut_solid(displacement: Any, scale: float, point: Array, normal: Array, colour: Array) -> Solid:
    """The part behind a plane, moved by its magnified displacement, with the section closed.

    The normal points to what is taken away.  The section is that of the cells with straight edges.
    """
    mesh = displacement.function_space.mesh
    skin, _ = skin_of(mesh, None, displacement)
    assert skin.values is not None
    behind = (skin.points - point) @ normal  # the plane cuts what has not moved
    moved = skin.points + scale * skin.values
    kept = _clipped(moved, skin.triangles, behind)
    cap, edges = _section(mesh, displacement, scale, point, normal)
    ends = behind[skin.segments]
    crossing = skin.segments[skin.border & (ends.min(axis=1) <= 0.0) & (ends.max(axis=1) > 0.0)]
    a, b = crossing[np.arange(len(crossing))[:, None], np.argsort(behind[crossing], axis=1)].T
    rest = np.stack([moved[a], _between(moved[a], moved[b], behind[a], behind[b])], axis=1)
    edges = np.concatenate([edges, rest])
    points = np.concatenate([moved, kept.reshape(-1, 3), cap.reshape(-1, 3), edges.reshape(-1, 3)])
    inside = ends.max(axis=1) <= 0.0
    first = len(moved)
    triangles = first + np.arange(3 * (len(kept) + len(cap))).reshape(-1, 3)
    borders = first + 3 * (len(kept) + len(cap)) + np.arange(2 * len(edges)).reshape(-1, 2)
    light = 0.5 * (np.asarray(colour) + 1.0)  # the section is lighter than the surface
    tint = np.concatenate([np.tile(colour, (len(kept), 1)), np.tile(light, (len(cap), 1))])
    thin, thick = skin.segments[inside & ~skin.border], skin.segments[inside & skin.border]
    return Solid(points, triangles, tint, thin, np.concatenate([thick, borders]))


def _clipped(moved: Array, triangles: Ints, distance: Array) -> Array:
    """Triangles (t, 3, 3) of what is behind the plane, of a surface with distances (points,) from it."""
    d, x = distance[triangles], moved[triangles]
    out = [x[(d <= 0.0).all(axis=1)]]
    for count in (1, 2):  # corners behind
        mine = (d <= 0.0).sum(axis=1) == count
        order = np.argsort(d[mine], axis=1)
        a, b, c = np.moveaxis(np.take_along_axis(x[mine], order[:, :, None], axis=1), 1, 0)
        da, db, dc = np.take_along_axis(d[mine], order, axis=1).T
        if count == 1:
            out.append(np.stack([a, _between(a, b, da, db), _between(a, c, da, dc)], axis=1))
        else:
            p, q = _between(a, c, da, dc), _between(b, c, db, dc)
            out += [np.stack([a, b, q], axis=1), np.stack([a, q, p], axis=1)]
    return np.concatenate(out)


def _between(a: Array, b: Array, da: Array, db: Array) -> Array:
    """Points of the plane on lines from a (below) to b (above)."""
    share = (da / (da - db))[:, None]
    return np.asarray(a + share * (b - a))


def _section(mesh: Any, displacement: Any, scale: float, point: Array, normal: Array) -> tuple[Array, Array]:
    """Triangles (t, 3, 3) of the section of the cells, and its outline (s, 2, 3)."""
    topology = mesh.topology
    topology.create_connectivity(3, 0)
    cells = topology.connectivity(3, 0).array.reshape(topology.index_map(3).size_local, -1)
    split = np.asarray(_TETRAHEDRA[topology.cell_name()])
    tetrahedra = cells[:, split].reshape(-1, 4)
    owner = np.repeat(np.arange(len(cells)), len(split))
    rest = mesh.geometry.x[vertex_nodes(mesh)]
    distance = (rest - point) @ normal
    crossed = (distance[tetrahedra].min(axis=1) < 0.0) & (distance[tetrahedra].max(axis=1) > 0.0)
    tetrahedra, owner = tetrahedra[crossed], owner[crossed]
    if not len(tetrahedra):
        return np.empty((0, 3, 3)), np.empty((0, 2, 3))
    used, numbers = np.unique(tetrahedra, return_inverse=True)
    tetrahedra = numbers.reshape(-1, 4)
    where = np.zeros(len(used), dtype=np.int32)
    where[tetrahedra.ravel()] = np.repeat(owner, 4)
    moved = rest[used] + scale * displacement.eval(rest[used], where)
    d, x, key = distance[used][tetrahedra], moved[tetrahedra], used[tetrahedra]
    order = np.argsort(d, axis=1)
    d, key = np.take_along_axis(d, order, axis=1), np.take_along_axis(key, order, axis=1)
    x = np.take_along_axis(x, order[:, :, None], axis=1)
    triangles: list[Array] = []
    pieces: list[tuple[Array, Ints]] = []  # sides of the sections, and the faces of cells they are in

    def side(mine: Any, ends: tuple[Array, Array], face: tuple[int, int, int]) -> None:
        pieces.append((np.stack(ends, axis=1), np.sort(key[mine][:, face], axis=1)))

    for count in (1, 2, 3):  # vertices behind the plane
        mine = (d < 0.0).sum(axis=1) == count
        cut = {
            (i, j): _between(x[mine, i], x[mine, j], d[mine, i], d[mine, j])
            for i in range(count)
            for j in range(count, 4)
        }
        if count == 2:
            triangles += [
                np.stack([cut[0, 2], cut[0, 3], cut[1, 3]], axis=1),
                np.stack([cut[0, 2], cut[1, 3], cut[1, 2]], axis=1),
            ]
            for a, b, face in (
                ((0, 2), (0, 3), (0, 2, 3)), ((0, 3), (1, 3), (0, 1, 3)),
                ((1, 3), (1, 2), (1, 2, 3)), ((1, 2), (0, 2), (0, 1, 2)),
            ):  # fmt: skip
                side(mine, (cut[a], cut[b]), face)
            continue
        corners = list(cut)
        triangles.append(np.stack([cut[c] for c in corners], axis=1))
        for one, other in ((corners[0], corners[1]), (corners[1], corners[2]), (corners[0], corners[2])):
            i, j, k = sorted({*one, *other})
            side(mine, (cut[one], cut[other]), (i, j, k))
    lines = np.concatenate([p for p, _ in pieces])
    faces = np.concatenate([f for _, f in pieces])
    _, index, times = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    # a face that one tetrahedron alone has is on the surface
    return np.concatenate(triangles), lines[times[index.ravel()] == 1]
