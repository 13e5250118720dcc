"""Solids, drawn by VTK or by matplotlib."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.figures import render
from dolfinx_frontend.figures.canvas import plane_axes
from dolfinx_frontend.figures.render import up

__all__ = ["RenderError"]


class RenderError(RuntimeError):
    """The solid cannot be drawn here; the message says what to install."""


@dataclass(frozen=True)
class Skin:
    """Visible triangles of one part.

    points (n, 3); triangles (t, 3); patch (t,): which facet (cells in 2D) a triangle belongs to;
    segments (s, 2): pieces of the outlines of the facets; border (s,): whether the piece is an
    edge of the solid; values (n, k) or None: the function at the points.
    """

    points: Array
    triangles: Ints
    patch: Ints
    segments: Ints
    border: npt.NDArray[np.bool_]
    values: Array | None

    def solid(self, points: Array, colours: Array) -> Solid:
        """The skin with its points moved, in colours of triangles or points."""
        thin, thick = self.segments[~self.border], self.segments[self.border]
        return Solid(points, self.triangles, colours, thin, thick)


def _lattice(corners: int) -> tuple[Array, Ints, list[tuple[int, int, list[int]]]]:
    """Midpoint subdivision of a triangle or quadrilateral.

    Returns the weights of the corners at the points, (points, corners), the small triangles, and
    for every edge its two corners and the points along it.
    """
    if corners == 3:
        weights = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 0]])
        triangles = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2], [5, 3, 4]])
        edges = [(0, 1, [0, 5, 1]), (1, 2, [1, 3, 2]), (0, 2, [0, 4, 2])]
    else:  # corners in tensor order: (0, 0), (1, 0), (0, 1), (1, 1)
        half = np.array([[1, 0], [0.5, 0.5], [0, 1]])
        weights = np.einsum("ja,ib->jiab", half, half).reshape(9, 4)
        squares = [(3 * j + i) for j in (0, 1) for i in (0, 1)]
        triangles = np.array([t for s in squares for t in ((s, s + 1, s + 4), (s, s + 4, s + 3))])
        edges = [(0, 1, [0, 1, 2]), (1, 3, [2, 5, 8]), (2, 3, [6, 7, 8]), (0, 2, [0, 3, 6])]
    weights = weights / weights.sum(axis=1, keepdims=True)
    return weights.astype(np.float64), triangles.astype(np.int64), edges


def corner_weights(corners: int) -> Array:
    """(points, corners): weights of the corners of a facet at the points that its skin has."""
    return _lattice(corners)[0]


def skin_of(
    mesh: Any, tag_of_facet: Mapping[int, int] | None = None, function: Any = None
) -> tuple[Skin, Ints]:
    """The skin of a mesh and the facets (cells in 2D) of its patches."""
    import basix
    import basix.ufl

    cell_name = mesh.topology.cell_name()
    kind = basix.CellType[cell_name]
    cell_vertices, facets, cells, local, corners_of = _patches(mesh, kind)
    weights, triangles, edges = _lattice(corners_of[0].size)
    per_patch = weights.shape[0]

    shape = basix.ufl.element(
        "Lagrange",
        cell_name,
        coordinate_map(mesh).degree,
        lagrange_variant=basix.LagrangeVariant.equispaced,
    )
    count = facets.size
    x = np.empty((count, per_patch, 3))
    values = None
    if function is not None:
        space = function.function_space
        size = space.dofmap.bs
        coefficients = function.x.array.reshape(-1, size)
        values = np.empty((count, per_patch, size))
    for index, corners in enumerate(corners_of):
        mine = np.flatnonzero(local == index)
        where = weights @ np.asarray(basix.geometry(kind), dtype=np.float64)[corners]
        nodes = mesh.geometry.x[cell_nodes(mesh)[cells[mine]]]
        x[mine] = np.einsum("pn,fnd->fpd", np.asarray(shape.tabulate(0, where))[0], nodes)
        if values is not None:
            basis = space.element.basix_element.tabulate(0, where)[0][:, :, 0]
            dofs = coefficients[space.dofmap.list[cells[mine]]]
            values[mine] = np.einsum("pn,fnk->fpk", basis, dofs)

    shift = per_patch * np.arange(count)[:, None]
    corner_vertices = np.stack([cell_vertices[c, corners_of[i]] for c, i in zip(cells, local)])
    pairs = np.stack([np.sort(corner_vertices[:, [a, b]], axis=1) for a, b, _ in edges], axis=1)
    pieces = np.array([[p[0], p[1], p[1], p[2]] for _, _, p in edges]).reshape(len(edges), 2, 2)
    segments = (shift[:, :, None, None] + pieces[None]).reshape(-1, 2)
    border = _borders(pairs, _normals(x, triangles), facets, tag_of_facet)
    skin = Skin(
        points=x.reshape(-1, 3),
        triangles=(shift[:, :, None] + triangles[None]).reshape(-1, 3),
        patch=np.repeat(np.arange(count), len(triangles)),
        segments=segments,
        border=np.repeat(border.reshape(-1), 2),
        values=None if values is None else values.reshape(count * per_patch, -1),
    )
    return skin, facets


class _Patches(NamedTuple):
    """Exterior facets of a mesh of solids, or the cells of a flat one."""

    cell_vertices: Ints  # (cells, vertices)
    facets: Ints  # (patches,)
    cells: Ints  # (patches,) cell of each
    local: Ints  # (patches,) its number in the cell
    corners: list[Ints]  # of every number


def _patches(mesh: Any, kind: Any) -> _Patches:
    import basix
    from dolfinx import mesh as dmesh

    topology = mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim, dim - 1)
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, 0)
    cell_vertices = topology.connectivity(dim, 0).array.reshape(topology.index_map(dim).size_local, -1)
    if dim != 3:
        facets: Ints = np.arange(cell_vertices.shape[0], dtype=np.int64)
        corners: list[Ints] = [np.arange(cell_vertices.shape[1])]
        return _Patches(cell_vertices, facets, facets, np.zeros_like(facets), corners)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int64)
    cells = np.array([topology.connectivity(dim - 1, dim).links(f)[0] for f in facets])
    local = np.array(
        [
            int(np.flatnonzero(topology.connectivity(dim, dim - 1).links(c) == f)[0])
            for c, f in zip(cells, facets)
        ]
    )
    return _Patches(
        cell_vertices, facets, cells, local, [np.asarray(v) for v in basix.topology(kind)[dim - 1]]
    )


def _normals(x: Array, triangles: Ints) -> Array:
    """Mean unit normals of the patches, sign undefined, (patches, 3)."""
    corner = x[:, triangles]
    normal = np.cross(corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0]).sum(1)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _borders(
    pairs: Ints, normals: Array, facets: Ints, tag_of_facet: Mapping[int, int] | None
) -> npt.NDArray[np.bool_]:
    """Edges of patches that are edges of the solid: one patch only, another face, or a corner.

    Coarse meshes turn by up to 60 degrees from one facet of a screw to the next: no corner yet.
    """
    count, edges = pairs.shape[:2]
    tags = np.array([(tag_of_facet or {}).get(int(f), 0) for f in facets])
    _, label = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    label = label.reshape(-1)
    order = np.argsort(label, kind="stable")
    same = label[order][1:] == label[order][:-1]
    first, second = order[:-1][same], order[1:][same]
    patch1, patch2 = first // edges, second // edges
    cosine = np.abs(np.einsum("ij,ij->i", normals[patch1], normals[patch2]))
    smooth = cosine > np.cos(np.radians(70))
    inner = smooth & (tags[patch1] == tags[patch2])
    border = np.ones(count * edges, dtype=bool)
    border[first[inner]] = border[second[inner]] = False
    return border.reshape(count, edges)


@dataclass
class Solid:
    """Everything to draw: coloured triangles and lines.

    points (n, 3); triangles (t, 3); colours (t, 3) of the triangles or (n, 3) of the points, 0..1;
    thin, thick (s, 2): segments between points.
    """

    points: Array
    triangles: Ints
    colours: Array
    thin: Ints
    thick: Ints


def joined(solids: Sequence[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(s.points) for s in solids[:-1])])
    return Solid(
        np.concatenate([s.points for s in solids]),
        np.concatenate([s.triangles + i for s, i in zip(solids, starts)]),
        np.concatenate([s.colours for s in solids]),
        np.concatenate([s.thin + i for s, i in zip(solids, starts)]),
        np.concatenate([s.thick + i for s, i in zip(solids, starts)]),
    )


def _vtk_images(solid: Solid, views: Sequence[Sequence[float]], width: int) -> list[Array]:
    """One picture of the solid per direction it is seen from, by VTK in another process."""
    command = [sys.executable, "-P", str(Path(render.__file__).resolve())]
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        virtual = shutil.which("xvfb-run")
        if virtual is None:
            raise RenderError(
                "drawing solids needs a display and there is none; install xvfb and xauth, or "
                'call with renderer="matplotlib"'
            )
        command = [virtual, "-a", "-s", "-screen 0 1600x1600x24", *command]
    with tempfile.TemporaryDirectory() as folder:
        data, out = Path(folder, "solid.npz"), Path(folder, "images.npz")
        np.savez(data, width=width, views=np.asarray(views, dtype=float), **vars(solid))
        try:
            done = subprocess.run(
                [*command, str(data), str(out)], capture_output=True, text=True, timeout=300
            )
        except subprocess.TimeoutExpired as late:
            raise RenderError('VTK did not answer; call with renderer="matplotlib"') from late
        if done.returncode != 0 or not out.is_file():
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise RenderError(
                f"VTK could not draw the solid ({last}); install pyvista, or call with "
                'renderer="matplotlib"'
            )
        with np.load(out) as images:
            return [images[f"arr_{i}"] / 255.0 for i in range(len(views))]


def _trimmed(image: Array) -> Array:
    """The picture without its white margins."""
    ink = np.min(image, axis=2) < 0.999
    rows, columns = np.flatnonzero(np.any(ink, axis=1)), np.flatnonzero(np.any(ink, axis=0))
    if rows.size == 0:
        return image
    return image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _draw_with_matplotlib(axes: Any, solid: Solid, view: Sequence[float]) -> None:
    """Project along the view and paint from the back to the front."""
    from matplotlib.collections import PolyCollection

    forward = np.asarray(view, dtype=float) / np.linalg.norm(view)
    right = np.cross(up(view), forward)
    right /= np.linalg.norm(right)
    flat = solid.points @ np.column_stack([right, np.cross(forward, right)])
    depth = solid.points @ forward
    corners = solid.points[solid.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    colours = solid.colours
    if len(colours) == len(solid.points):
        colours = colours[solid.triangles].mean(axis=1)
    light = 0.75 + 0.25 * np.abs(normal @ forward)
    shade = np.clip(colours * light[:, None], 0, 1)
    # lines are polygons without area, sorted among the triangles but a little nearer
    nearer = 0.01 * float(np.ptp(depth))
    shapes = [*flat[solid.triangles], *flat[solid.thick]]
    faces = np.concatenate([shade, np.zeros((len(solid.thick), 3))])
    behind = np.concatenate(
        [depth[solid.triangles].mean(axis=1), depth[solid.thick].mean(axis=1) + nearer]
    )
    order = np.argsort(behind)
    axes.add_collection(
        PolyCollection(
            [shapes[i] for i in order],
            facecolors=faces[order],
            edgecolors=faces[order],
            linewidths=np.where(order < len(solid.triangles), 0.4, 0.8),
        )
    )
    axes.set_xlim(flat[:, 0].min(), flat[:, 0].max())
    axes.set_ylim(flat[:, 1].min(), flat[:, 1].max())
    axes.set_aspect("equal")


def arrow(start: Sequence[float], end: Sequence[float], colour: Array, by_point: bool) -> Solid:
    """An arrow of a load, in one colour (3,), given by points or by triangles."""
    tail, tip = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(tip - tail))
    along = (tip - tail) / length
    across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)[:, None]
    ring = length * (np.cos(turn) * across + np.sin(turn) * np.cross(along, across))
    neck = tail + 0.65 * (tip - tail)
    points = np.concatenate([tail + 0.035 * ring, neck + 0.035 * ring, neck + 0.1 * ring, [tail, tip]])
    i, j = np.arange(24), (np.arange(24) + 1) % 24
    ends = np.full(24, 72), np.full(24, 73)
    bands = [(24 * k + i, 24 * k + j, 24 * k + 24 + j) for k in (0, 1)]
    bands += [(24 * k + i, 24 * k + 24 + j, 24 * k + 24 + i) for k in (0, 1)]
    bands += [(i, j, ends[0]), (48 + i, 48 + j, ends[1])]
    triangles = np.concatenate([np.column_stack(band) for band in bands])
    colours = np.tile(colour, (len(points) if by_point else len(triangles), 1))
    none = np.empty((0, 2), dtype=np.int64)
    return Solid(points, triangles, colours, none, none)


def draw_solid(
    figure: Any, axes: Sequence[Any], solid: Solid, views: Sequence[Sequence[float]], renderer: str
) -> float:
    """Draw it into axes, each from another view; returns the largest height / width of the pictures."""
    if renderer not in ("auto", "vtk", "matplotlib"):
        raise ValueError(f"renderer = {renderer!r} must be 'auto', 'vtk' or 'matplotlib'")
    images = None
    if renderer != "matplotlib":
        try:
            images = _vtk_images(solid, views, 1400)
        except RenderError:
            if renderer == "vtk":
                raise
    ratios = []
    for i, (axis, view) in enumerate(zip(axes, views)):
        if images is None:
            _draw_with_matplotlib(axis, solid, view)
            wide, high = np.ptp([axis.get_xlim(), axis.get_ylim()], axis=1)
        else:
            picture = _trimmed(images[i])
            axis.imshow(picture, interpolation="antialiased")
            high, wide = picture.shape[:2]
        ratios.append(float(high / wide))
        axis.set_axis_off()
    return max(ratios)


def outline(axis: Any, skin: Skin, points: Array) -> None:
    """The edges of a flat part whose points have moved."""
    from matplotlib.collections import LineCollection

    edges = points[skin.segments[skin.border], :2]
    axis.add_collection(LineCollection(list(edges), colors="black", lw=0.8))
    plane_axes(axis)
