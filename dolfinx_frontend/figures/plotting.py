"""Figures of assemblies, interface fields, convergence, responses and densities, as PNG files.

Every function takes plain arrays, parts or dolfinx functions, writes one file and returns its path;
labels carry the units.  Flat figures are drawn by matplotlib.  Solids are drawn by VTK through
pyvista in a process of its own, because VTK ends the process that has no display; a virtual one
(``xvfb-run``) is used where there is none.  With ``renderer="auto"`` matplotlib draws solids too
where VTK cannot, more coarsely.

This file is also the program of that process and imports nothing of the package when it is run.
"""

from __future__ import annotations

import dataclasses
import io
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array, Ints

if TYPE_CHECKING:
    from dolfinx import fem

    from dolfinx_frontend.geometry.parts import Assembly, Part
    from dolfinx_frontend.solvers.sampling import SampleResult
    from dolfinx_frontend.solvers.solve import Result

__all__ = [
    "KIND_COLOURS",
    "FrontPanel",
    "RenderError",
    "assembly_figure",
    "convergence_figure",
    "deformed_figure",
    "density_figure",
    "front_figure",
    "interface_figure",
    "interface_map",
    "pareto_front",
    "response_surface",
]


KIND_COLOURS = {
    "perfect": "#2166ac",
    "elastic": "#35c4b5",
    "contact": "#d6604d",
    "preload": "#7b3294",
    "pressure": "#f48fb1",
    "symmetry": "#ffffff",
    "support": "#e08a00",
    "free": "#8b9199",
}
"""Colour of a face by the kind of its interface: those of the paper, and three more."""

_LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
_DASHES = ("-", "--", "-.", ":")
_DPI = 150


class RenderError(RuntimeError):
    """The solid cannot be drawn here; the message says what to install."""


# ---------------------------------------------------------------------------------------------
# Facets as small triangles
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class _Skin:
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

    def solid(self, points: Array, colours: Array) -> _Solid:
        """The skin with its points moved, in colours of triangles or points."""
        thin, thick = self.segments[~self.border], self.segments[self.border]
        return _Solid(points, self.triangles, colours, thin, thick)


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


def _skin(
    mesh: Any, tag_of_facet: Mapping[int, int] | None = None, function: Any = None
) -> tuple[_Skin, Ints]:
    """The skin of a mesh and the facets (cells in 2D) of its patches."""
    import basix
    import basix.ufl
    from dolfinx import mesh as dmesh

    from dolfinx_frontend.common.compat import cell_nodes, coordinate_map

    topology = mesh.topology
    dim = topology.dim
    cell_name = topology.cell_name()
    kind = basix.CellType[cell_name]
    topology.create_connectivity(dim, dim - 1)
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, 0)
    cell_vertices = topology.connectivity(dim, 0).array.reshape(
        topology.index_map(dim).size_local, -1
    )
    if dim == 3:
        facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int64)
        cells = np.array([topology.connectivity(dim - 1, dim).links(f)[0] for f in facets])
        local = np.array(
            [
                int(np.flatnonzero(topology.connectivity(dim, dim - 1).links(c) == f)[0])
                for c, f in zip(cells, facets)
            ]
        )
        corners_of = [np.asarray(v) for v in basix.topology(kind)[dim - 1]]
    else:
        facets = np.arange(cell_vertices.shape[0], dtype=np.int64)
        cells, local = facets, np.zeros_like(facets)
        corners_of = [np.arange(cell_vertices.shape[1])]
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
    skin = _Skin(
        points=x.reshape(-1, 3),
        triangles=(shift[:, :, None] + triangles[None]).reshape(-1, 3),
        patch=np.repeat(np.arange(count), len(triangles)),
        segments=segments,
        border=np.repeat(border.reshape(-1), 2),
        values=None if values is None else values.reshape(count * per_patch, -1),
    )
    return skin, facets


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


# ---------------------------------------------------------------------------------------------
# Drawing solids
# ---------------------------------------------------------------------------------------------
@dataclass
class _Solid:
    """Everything to draw: coloured triangles and lines.

    points (n, 3); triangles (t, 3); colours (t, 3) of the triangles or (n, 3) of the points, 0..1;
    thin, thick (s, 2): segments between points.
    """

    points: Array
    triangles: Ints
    colours: Array
    thin: Ints
    thick: Ints


def _joined(solids: Sequence[_Solid]) -> _Solid:
    starts = np.cumsum([0, *(len(s.points) for s in solids[:-1])])
    return _Solid(
        np.concatenate([s.points for s in solids]),
        np.concatenate([s.triangles + i for s, i in zip(solids, starts)]),
        np.concatenate([s.colours for s in solids]),
        np.concatenate([s.thin + i for s, i in zip(solids, starts)]),
        np.concatenate([s.thick + i for s, i in zip(solids, starts)]),
    )


def _up(view: Sequence[float] | Array) -> tuple[float, float, float]:
    """What is up in a picture: z, and y where one looks along z."""
    return (0.0, 0.0, 1.0) if np.hypot(view[0], view[1]) > 1e-6 * abs(view[2]) else (0.0, 1.0, 0.0)


def _vtk_images(solid: _Solid, views: Sequence[Sequence[float]], width: int) -> list[Array]:
    """One picture of the solid per direction it is seen from, by VTK in another process."""
    command = [sys.executable, "-P", str(Path(__file__).resolve())]
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


def _draw_with_vtk(data: str, out: str) -> None:
    """The program of the other process."""
    import pyvista

    with np.load(data) as file:
        solid = {name: file[name] for name in file.files}
    points = solid["points"]
    count = len(solid["triangles"])
    faces = np.column_stack([np.full(count, 3), solid["triangles"]])
    surface = pyvista.PolyData(points, faces.reshape(-1))
    colours = (255 * solid["colours"]).astype(np.uint8)

    def lines(segments: Ints) -> Any:
        cells = np.column_stack([np.full(len(segments), 2), segments]).reshape(-1)
        return pyvista.PolyData(points, lines=cells)

    images = []
    width = int(solid["width"])
    for view in solid["views"]:
        plotter = pyvista.Plotter(off_screen=True, window_size=(width, width))
        plotter.set_background("white")
        plotter.add_mesh(surface, scalars=colours, rgb=True, ambient=0.72, diffuse=0.3)
        for name, colour, thickness in (("thin", "#777777", 1.0), ("thick", "black", 3.0)):
            if len(solid[name]):
                actor = plotter.add_mesh(lines(solid[name]), color=colour, line_width=thickness)
                # lines lie on the surface: bring them forward, or it hides parts of them
                actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
                actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -8.0)
        plotter.enable_parallel_projection()
        plotter.enable_anti_aliasing("ssaa")
        plotter.view_vector(view, viewup=_up(view))
        plotter.reset_camera()
        images.append(plotter.screenshot(None, return_img=True))
        plotter.close()
    np.savez_compressed(out, *images)


def _trimmed(image: Array) -> Array:
    """The picture without its white margins."""
    ink = np.min(image, axis=2) < 0.999
    rows, columns = np.flatnonzero(np.any(ink, axis=1)), np.flatnonzero(np.any(ink, axis=0))
    if rows.size == 0:
        return image
    return image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _draw_with_matplotlib(axes: Any, solid: _Solid, view: Sequence[float]) -> None:
    """Project along the view and paint from the back to the front."""
    from matplotlib.collections import PolyCollection

    forward = np.asarray(view, dtype=float) / np.linalg.norm(view)
    right = np.cross(_up(view), forward)
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


def _draw_solid(
    figure: Any, axes: Sequence[Any], solid: _Solid, views: Sequence[Sequence[float]], renderer: str
) -> None:
    if renderer not in ("auto", "vtk", "matplotlib"):
        raise ValueError(f"renderer = {renderer!r} must be 'auto', 'vtk' or 'matplotlib'")
    images = None
    if renderer != "matplotlib":
        try:
            images = _vtk_images(solid, views, 1400)
        except RenderError:
            if renderer == "vtk":
                raise
    for i, (axis, view) in enumerate(zip(axes, views)):
        if images is None:
            _draw_with_matplotlib(axis, solid, view)
        else:
            axis.imshow(_trimmed(images[i]), interpolation="antialiased")
        axis.set_axis_off()


# ---------------------------------------------------------------------------------------------
# Figures
# ---------------------------------------------------------------------------------------------
def _figure(width: float, height: float) -> Any:
    """A figure that belongs to nobody: no window, no global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Any, path: str | Path) -> Path:
    from PIL import Image

    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, facecolor="white", bbox_inches="tight")
    # a palette makes the file three times smaller
    picture = Image.open(buffer).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    picture.save(target, format="png", optimize=True, dpi=(_DPI, _DPI))
    return target


def _rgb(colour: str) -> Array:
    from matplotlib.colors import to_rgb

    return np.asarray(to_rgb(colour))


def _stacked(heights: Mapping[str, tuple[float, float]], gap: float) -> dict[str, float]:
    """Shifts along z that lift parts (name -> lowest, highest z) clear of each other."""
    shifts: dict[str, float] = {}
    top = -np.inf
    for name in sorted(heights, key=lambda n: sum(heights[n])):
        low, high = heights[name]
        shifts[name] = 0.0 if top == -np.inf else max(0.0, top + gap - low)
        top = high + shifts[name]
    return shifts


def assembly_figure(
    assembly: Assembly,
    path: str | Path,
    *,
    explode: float = 0.08,
    lift: Mapping[str, float] | None = None,
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The parts, their meshes, and their faces coloured by the kind of their interface.

    Parameters
    ----------
    assembly
        With interfaces that name faces and kinds.
    path
        PNG file to write.
    explode
        Gap between the parts, which are lifted apart along z, as a fraction of the height of the
        assembly; 0 leaves them in place.
    lift
        Part -> shift along z, instead of `explode`; parts that are not named stay in place.
    title
        Above the figure.
    renderer
        ``"vtk"``, ``"matplotlib"`` or ``"auto"``: VTK where it works.

    Raises
    ------
    RenderError
        ``renderer="vtk"`` and VTK is missing or has no display.
    """
    kind_of = {c.face1: c.kind for c in assembly.interfaces}
    kind_of |= {c.face2: c.kind for c in assembly.interfaces if c.face2}
    if next(iter(assembly.parts.values())).mesh.geometry.dim == 2:
        return _plane_assembly(assembly, kind_of, path, title)
    bounds = {
        name: (float(p.mesh.geometry.x[:, 2].min()), float(p.mesh.geometry.x[:, 2].max()))
        for name, p in assembly.parts.items()
    }
    height = max(b for _, b in bounds.values()) - min(a for a, _ in bounds.values())
    shifts = dict.fromkeys(bounds, 0.0)
    if lift is not None:
        if not set(lift) <= set(bounds):
            raise ValueError(f"lift names parts that are not there: {sorted(set(lift) - set(bounds))}")
        shifts |= lift
    elif explode:
        shifts = _stacked(bounds, explode * height)
    solids = []
    for name, part in assembly.parts.items():
        tags = {int(f): int(t) for f, t in zip(part.facet_tags.indices, part.facet_tags.values)}
        skin, facets = _skin(part.mesh, tags)
        colour = {t: _rgb(_face_colour(kind_of, f"{name}:{face}")) for face, t in part.names.items()}
        by_patch = np.stack([colour[tags[int(f)]] for f in facets])
        solids.append(skin.solid(skin.points + [0.0, 0.0, shifts[name]], by_patch[skin.patch]))
    figure = _figure(7.5, 6.5)
    axes = figure.subplots(1, 2)
    if title:
        figure.suptitle(title)
    _draw_solid(figure, axes, _joined(solids), [(-0.45, -1.0, 0.45), (-0.7, 0.8, -0.4)], renderer)
    for axis, label in zip(axes, ("from above", "other side, from below")):
        axis.set_title(label, fontsize=10)
    _kind_legend(figure, assembly, kind_of)
    return _save(figure, path)


def _face_colour(kind_of: Mapping[str, str], face: str) -> str:
    return KIND_COLOURS.get(kind_of.get(face, "free"), "#888888")


def _kind_legend(figure: Any, assembly: Assembly, kind_of: Mapping[str, str]) -> None:
    from matplotlib.patches import Patch

    kinds = {kind_of.get(f"{n}:{face}", "free") for n, part in assembly.parts.items() for face in part.names}
    handles = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=kind)
        for kind, colour in KIND_COLOURS.items()
        if kind in kinds
    ]
    figure.legend(handles=handles, loc="outside lower center", ncol=len(handles), frameon=False)


def _plane_assembly(
    assembly: Assembly, kind_of: Mapping[str, str], path: str | Path, title: str | None
) -> Path:
    from matplotlib.collections import LineCollection

    figure = _figure(6.5, 6.0)
    axis = figure.add_subplot()
    for name, part in assembly.parts.items():
        skin, _ = _skin(part.mesh)
        flat = skin.points[:, :2]
        axis.tripcolor(flat[:, 0], flat[:, 1], skin.triangles, np.zeros(len(flat)), cmap="Greys")
        axis.add_collection(LineCollection(list(flat[skin.segments]), colors="#999999", lw=0.4))
        part.mesh.topology.create_connectivity(1, 0)
        for face in part.names:
            colour = _face_colour(kind_of, f"{name}:{face}")
            vertices = [part.mesh.topology.connectivity(1, 0).links(f) for f in part.facets(face)]
            ends = part.mesh.geometry.x[_vertex_nodes(part)[np.asarray(vertices)], :2]
            axis.add_collection(LineCollection(list(ends), colors="black", lw=3.6))
            axis.add_collection(LineCollection(list(ends), colors=colour, lw=2.4))
    _plane(axis)
    if title:
        axis.set_title(title)
    _kind_legend(figure, assembly, kind_of)
    return _save(figure, path)


def _vertex_nodes(part: Part) -> Ints:
    """Geometry node of every vertex."""
    from dolfinx_frontend.common.compat import cell_nodes

    topology = part.mesh.topology
    topology.create_connectivity(topology.dim, 0)
    vertices = topology.connectivity(topology.dim, 0)
    nodes = np.empty(topology.index_map(0).size_local, dtype=np.int64)
    nodes[vertices.array] = cell_nodes(part.mesh)[:, : vertices.links(0).size].reshape(-1)
    return nodes


def deformed_figure(
    displacements: Mapping[str, fem.Function] | Sequence[fem.Function],
    path: str | Path,
    *,
    scale: float | None = None,
    label: str = "|u| (mm)",
    quantity: Callable[[Array], Array] | None = None,
    view: Sequence[float] = (-0.45, -1.0, 0.45),
    lift: Mapping[str, float] | None = None,
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The deformed assembly, coloured by a function of the displacement.

    Parameters
    ----------
    displacements
        One vector-valued Lagrange function per part.
    path
        PNG file to write.
    scale
        Magnification of the displacements; chosen if not given so that the largest is 6 % of the
        size of the assembly.
    label
        Of the colour bar, with the unit.
    quantity
        Maps displacements (points, d) to the values shown (points,); the magnitude if not given.
    view
        Direction towards the viewer, for solids.
    lift
        Part -> shift along the last axis before it is drawn: parts on elastic interfaces overlap
        where magnified displacements close them. Needs displacements by name.
    title, renderer
        As in :func:`assembly_figure`.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    given = displacements.values() if isinstance(displacements, Mapping) else displacements
    functions = list(given)
    names = list(displacements) if isinstance(displacements, Mapping) else [""] * len(functions)
    if lift is not None and not set(lift) <= set(names):
        raise ValueError(f"lift names parts that are not drawn: {sorted(set(lift) - set(names))}")
    skins = [_skin(u.function_space.mesh, None, u)[0] for u in functions]
    values = [s.values for s in skins if s.values is not None]
    moved = np.concatenate([np.linalg.norm(v, axis=1) for v in values])
    everything = np.concatenate([s.points for s in skins])
    size = float(np.ptp(everything, axis=0).max())
    if scale is None:
        scale = _round_down(0.06 * size / float(moved.max())) if moved.max() > 0 else 1.0
    shown = quantity or (lambda v: np.asarray(np.linalg.norm(v, axis=1)))
    colour_of = [np.asarray(shown(v), dtype=float) for v in values]
    norm = Normalize(min(c.min() for c in colour_of), max(c.max() for c in colour_of))
    colours = colormaps["viridis"]
    heading = f"{title + ', ' if title else ''}displacements × {scale:g}"
    figure = _figure(6.5, 5.0)
    axis = figure.add_subplot()
    axis.set_title(heading, fontsize=11)
    solids = []
    for name, skin, u, field in zip(names, skins, values, colour_of):
        points = skin.points.copy()
        points[:, : u.shape[1]] += scale * u
        points[:, u.shape[1] - 1] += (lift or {}).get(name, 0.0)
        if functions[0].function_space.mesh.geometry.dim == 2:
            axis.tripcolor(
                points[:, 0], points[:, 1], skin.triangles, field, norm=norm, shading="gouraud"
            )
            _outline(axis, skin, points)
        else:
            solids.append(skin.solid(points, colours(norm(field))[:, :3]))
    if solids:
        _draw_solid(figure, [axis], _joined(solids), [view], renderer)
    figure.colorbar(ScalarMappable(norm, colours), ax=axis, label=label, shrink=0.85)
    return _save(figure, path)


def interface_figure(
    result: Result | SampleResult,
    interface: str,
    path: str | Path,
    *,
    quantity: str = "pressure",
    label: str | None = None,
    step: int = -1,
    scale: float | None = None,
    hide: Sequence[str] | None = None,
    view: Sequence[float] | None = None,
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The deformed assembly with what acts on an interface, facet by facet, on its first side.

    Parameters
    ----------
    result
        Of a solve or a sampling (with ``keep_states=True``): of a random answer the mean displacement.
    interface
        Its name.
    path
        PNG file to write.
    quantity
        A field of :func:`dolfinx_frontend.io.fields.write_interfaces`: ``"pressure"``, ``"gap"``,
        ``"pressure std"``, ``"slip probability"``, ...; of vectors the size is drawn.
    label
        Of the colour bar, with the unit; None: the quantity.
    step
        Of a load history.
    scale
        Magnification of the displacements; chosen if not given so that the largest is 3 % of the size of the
        parts that are drawn.
    hide
        Parts that are not drawn; None: in 3D those that would cover it, side 2 and what lies beyond.
    view
        Direction towards the viewer, for solids; None: obliquely onto the interface.
    title, renderer
        As in :func:`assembly_figure`.

    Raises
    ------
    SceneError
        An interface, quantity or part to hide that there is not.
    RenderError
        ``renderer="vtk"`` and VTK is missing or has no display.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    from dolfinx_frontend.common.errors import unknown_name
    from dolfinx_frontend.io.fields import facet_fields

    numbers, found = facet_fields(result, interface, step)
    if quantity not in found:
        raise unknown_name("quantity", quantity, found, f"interface {interface!r}")
    values = found[quantity] if found[quantity].ndim == 1 else np.linalg.norm(found[quantity], axis=1)
    problem = result.problem
    described = problem.interfaces[interface]
    side = described.sides[0]
    normal = np.zeros(3)
    normal[: described.dim] = side.normal if np.any(side.normal) else described.normals[0]
    own = problem.substructures[side.substructure]
    for name in hide or ():
        if name not in problem.substructures:
            raise unknown_name("part", name, problem.substructures, "hide")
    if hide is None and own.dim == 2:
        hide = ()  # nothing covers anything
    elif hide is None:
        # of a part beyond the face nothing is behind it
        plane = float(normal[: own.dim] @ described.points.mean(axis=0))
        beyond = {
            name: float((s.dof_coordinates @ normal[: own.dim]).mean()) > plane
            for name, s in problem.substructures.items()
        }
        hide = [name for name in problem.substructures if beyond[name] and name != own.name]
    names = [name for name in problem.substructures if name not in hide or name == own.name]
    functions = {name: _displaced(result, name, step) for name in names}
    skins = {name: _skin(u.function_space.mesh, None, u) for name, u in functions.items()}
    everything = np.concatenate([skin.points for skin, _ in skins.values()])
    moves = [np.abs(skin.values).max() for skin, _ in skins.values() if skin.values is not None]
    size, most = float(np.ptp(everything, axis=0).max()), float(max(moves))
    if scale is None:
        scale = _round_down(0.03 * size / most) if most > 0.0 else 1.0
    low, high = float(values.min()), float(values.max())
    norm = Normalize(low, high if high > low else low + max(abs(low), 1.0) * 1e-6)
    colours = colormaps["viridis"]
    figure = _figure(6.5, 5.0)
    axis = figure.add_subplot()
    axis.set_title(f"{title + ', ' if title else ''}displacements × {scale:g}", fontsize=11)
    solids = []
    for name, (skin, facets) in skins.items():
        points = skin.points.copy()
        if skin.values is not None:
            points[:, : skin.values.shape[1]] += scale * skin.values
        if described.dim == 2:
            flat = np.ones(len(points))
            axis.tripcolor(*points[:, :2].T, skin.triangles, flat, cmap="Greys", vmin=0.0, vmax=5.0)
            _outline(axis, skin, points)
            continue
        rgb = np.tile(_rgb(KIND_COLOURS["free"]), (len(facets), 1)) * 0.5 + 0.5
        if name == own.name:
            _, mine, at = np.intersect1d(facets, numbers, return_indices=True)
            rgb[mine] = colours(norm(values[at]))[:, :3]
        solids.append(skin.solid(points, rgb[skin.patch]))
    if solids:
        _draw_solid(figure, [axis], _joined(solids), [_onto(normal) if view is None else view], renderer)
    else:
        _facet_lines(axis, own, side.face, numbers, values, functions[own.name], scale, norm, colours)
    figure.colorbar(ScalarMappable(norm, colours), ax=axis, label=label or quantity, shrink=0.85)
    return _save(figure, path)


def _plane(axis: Any) -> None:
    axis.set_aspect("equal")
    axis.set_xlabel("x")
    axis.set_ylabel("y")


def _outline(axis: Any, skin: _Skin, points: Array) -> None:
    """The edges of a flat part whose points have moved."""
    from matplotlib.collections import LineCollection

    edges = points[skin.segments[skin.border], :2]
    axis.add_collection(LineCollection(list(edges), colors="black", lw=0.8))
    _plane(axis)


def _displaced(result: Any, name: str, step: int) -> Any:
    """Displacement of a part, of a random answer its mean."""
    if hasattr(result, "mean"):
        return result.mean(name, step)
    if result.plan.times is not None:
        return result.displacement(name, step)
    return result.displacement(name)


def _onto(normal: Array) -> list[float]:
    """A direction from which a face with this normal is seen obliquely, never along the vertical."""
    aside = np.array([-0.45, -1.0, 0.45])
    aside = aside / np.linalg.norm(aside)
    return [float(x) for x in normal + (0.8 if normal @ aside > -0.3 else -0.8) * aside]


def _facet_lines(
    axis: Any,
    part: Any,
    face: str,
    numbers: Ints,
    values: Array,
    displacement: fem.Function,
    scale: float,
    norm: Any,
    colours: Any,
) -> None:
    """Facets of a face in the plane, displaced and coloured."""
    from matplotlib.collections import LineCollection

    from dolfinx_frontend.assembly.facet_map import FacetMap

    facets = FacetMap(part.part, face, part.name)
    row = np.searchsorted(np.sort(part.part.facet_tags.find(part.part.names[face])), numbers)
    along = np.linspace(0.0, 1.0, 5)[:, None]
    index, s = np.repeat(row, len(along)), np.tile(along, (len(row), 1))
    x, _ = facets.push_forward(index, s)
    nodal = displacement.x.array.reshape(-1, part.dim)
    u = facets.trace(part.space, index, s, len(nodal)) @ nodal
    lines = (x + scale * u).reshape(len(row), len(along), 2)
    axis.add_collection(LineCollection(list(lines), colors=colours(norm(values)), lw=5.0, capstyle="butt"))


def _round_down(value: float) -> float:
    """The next lower number of the form 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-12)) * power)


def interface_map(
    points: npt.ArrayLike,
    values: npt.ArrayLike,
    path: str | Path,
    label: str,
    *,
    mirror: float | None = None,
    axes_labels: tuple[str, str] = ("x (mm)", "y (mm)"),
    title: str | None = None,
    extremes: bool = True,
) -> Path:
    """Colour map of a scalar field on a plane interface, seen from above.

    Parameters
    ----------
    points
        Interface points, (m, 2) or (m, 3); the first two coordinates are drawn.
    values
        The field at the points, (m,).
    path
        PNG file to write.
    label
        Of the colour bar, with the unit.
    mirror
        Opening in radians of the symmetric sector 0 <= theta <= mirror that the points lie in;
        the whole circle is then drawn.
    axes_labels, title
        Texts.
    extremes
        Mark where the field is largest and smallest.
    """
    from matplotlib.ticker import MaxNLocator
    from matplotlib.tri import Triangulation

    x = np.asarray(points, dtype=float)[:, :2]
    f = np.asarray(values, dtype=float).reshape(-1)
    if f.size != len(x):
        raise ValueError(f"{f.size} values for {len(x)} points")
    places: Array = x
    field: Array = f
    if mirror is not None:
        copies = round(np.pi / mirror)
        if abs(copies * mirror - np.pi) > 1e-9:
            raise ValueError(f"mirror = {mirror} must be pi divided by a whole number")
        both = np.concatenate([x, x * [1.0, -1.0]])
        turns = 2 * mirror * np.arange(copies)
        places = np.concatenate(
            [both @ np.array([[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]]) for t in turns]
        )
        # points on the symmetry planes come twice
        spacing = 1e-9 * float(np.abs(x).max())
        _, first = np.unique(np.round(places / spacing).astype(np.int64), axis=0, return_index=True)
        places, field = places[first], np.tile(f, 2 * copies)[first]
    mesh = Triangulation(*places.T)
    corners = places[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    # triangles across a bore or outside a curved border have edges far longer than their peers
    mesh.set_mask(longest > 3.0 * np.median(longest))
    figure = _figure(6.2, 5.0)
    axis = figure.add_subplot()
    lowest, highest = float(field.min()), float(field.max())
    if highest - lowest <= 1e-12 * max(abs(highest), abs(lowest), 1e-300):
        highest = lowest + max(abs(lowest), 1.0) * 1e-6
    crosses = lowest < 0 < highest
    limit = max(-lowest, highest)
    ends = (-limit, limit) if crosses else (lowest, highest)
    levels = MaxNLocator(30, steps=[1, 2, 2.5, 5, 10]).tick_values(*ends)
    filled = axis.tricontourf(mesh, field, levels=levels, cmap="RdBu_r" if crosses else "viridis")
    if crosses:
        axis.tricontour(mesh, field, levels=[0.0], colors="black", linewidths=1.2)
    figure.colorbar(filled, ax=axis, label=label, shrink=0.9)
    if extremes:
        for which, marker, name in ((f.argmax(), "^", "max"), (f.argmin(), "v", "min")):
            axis.plot(
                *x[which],
                marker,
                color="white",
                markeredgecolor="black",
                markersize=8,
                label=f"{name} {f[which]:.3g}".replace("-", "\N{MINUS SIGN}"),
                linestyle="none",
                clip_on=False,
            )
        if mirror is not None:  # inside the bore
            axis.legend(loc="center", framealpha=0.9)
        else:
            figure.legend(loc="outside lower center", ncol=2, frameon=False)
    axis.set_aspect("equal")
    axis.set_xlabel(axes_labels[0])
    axis.set_ylabel(axes_labels[1])
    if title:
        axis.set_title(title)
    return _save(figure, path)


def convergence_figure(
    histories: Mapping[str, Sequence[Any]] | Sequence[Any],
    path: str | Path,
    *,
    label: str = "relative error",
    target: float | None = None,
    title: str | None = None,
) -> Path:
    """Errors against iterations on a logarithmic scale.

    Parameters
    ----------
    histories
        Errors of one run, after each of its iterations; or one such sequence per point of a sweep,
        drawn end to end with a dot where each point starts; or a mapping of several such, by name.
        A point of a sweep may give pairs (iteration, error) instead: the error of a warm start
        belongs to iteration 0, which is none.
    path
        PNG file to write.
    label
        Of the errors.
    target
        Tolerance, drawn as a dashed line.
    title
        Above the figure.
    """
    runs = histories if isinstance(histories, Mapping) else {"": histories}
    figure = _figure(7.0, 4.0)
    axis = figure.add_subplot()
    dots = "start of a new point"
    for colour, (name, history) in zip(_cycle(len(runs)), runs.items()):
        pieces = [np.atleast_1d(np.asarray(piece, dtype=float)) for piece in history]
        if all(np.ndim(piece) == 0 for piece in history):  # one flat run
            pieces = [np.asarray(history, dtype=float)]
        pieces = [piece for piece in pieces if piece.size > 0]
        pairs = [
            piece.T if piece.ndim == 2 else np.stack([np.arange(1, piece.size + 1), piece])
            for piece in pieces
        ]
        before = np.cumsum([0, *(numbers[-1] for numbers, _ in pairs)])
        iterations = [start + numbers for start, (numbers, _) in zip(before, pairs)]
        errors = [values for _, values in pairs]
        axis.semilogy(
            np.concatenate([[], *iterations]),
            np.concatenate([[], *errors]),
            color=colour,
            lw=1.1,
            label=name or None,
        )
        if len(pieces) > 1:
            first = [(numbers[0], values[0]) for numbers, values in zip(iterations, errors)]
            axis.semilogy(*zip(*first), ".", color="black", ms=4, label=dots)
            dots = "_nolegend_"
    if target is not None:
        axis.axhline(target, color="#666666", ls="--", lw=1.0, label=f"target {target:g}")
    axis.set_xlabel("iterations")
    axis.set_ylabel(label)
    axis.grid(True, which="major", color="#dddddd", lw=0.6)
    if axis.get_legend_handles_labels()[1]:
        axis.legend(loc="upper right", framealpha=0.9)
    if title:
        axis.set_title(title)
    return _save(figure, path)


def _cycle(count: int) -> list[str]:
    return [_LINES[i % len(_LINES)] for i in range(count)]


def response_surface(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    z: npt.ArrayLike,
    labels: tuple[str, str, str],
    path: str | Path,
    *,
    level: float = 0.0,
    title: str | None = None,
) -> Path:
    """A response over two parameters, in relief and as a map, with the line where it is a level.

    Parameters
    ----------
    x, y
        Values of the parameters, (nx,) and (ny,).
    z
        The response, (nx, ny).
    labels
        Of x, y and z, with units.
    path
        PNG file to write.
    level
        Value of the response whose line is drawn.
    title
        Above the figure.
    """
    xs, ys, zs = (np.asarray(v, dtype=float) for v in (x, y, z))
    if zs.shape != (xs.size, ys.size):
        raise ValueError(f"z has the shape {zs.shape}, expected (x, y) = {(xs.size, ys.size)}")
    grid_x, grid_y = np.meshgrid(xs, ys, indexing="ij")
    figure = _figure(11.0, 4.6)
    crosses = zs.min() < level < zs.max()
    # the line lies on the surface: draw it after, whatever the depth
    relief = figure.add_subplot(1, 2, 1, projection="3d", computed_zorder=False)
    relief.plot_surface(
        grid_x, grid_y, zs, cmap="viridis", rstride=1, cstride=1, edgecolor="#00000055", lw=0.3
    )
    if crosses:
        relief.contour(grid_x, grid_y, zs, levels=[level], colors="red", linewidths=2.5, zorder=10)
    relief.set_xlabel(labels[0], labelpad=8)
    relief.set_ylabel(labels[1], labelpad=8)
    relief.set_title(labels[2], fontsize=10)
    relief.view_init(elev=24, azim=-55)
    relief.set_box_aspect(None, zoom=0.88)
    flat = figure.add_subplot(1, 2, 2)
    filled = flat.contourf(grid_x, grid_y, zs, levels=20, cmap="viridis")
    if crosses:
        line = flat.contour(grid_x, grid_y, zs, levels=[level], colors="red", linewidths=2.0)
        flat.clabel(line, fmt=f"{level:g}")
    flat.set_xlabel(labels[0])
    flat.set_ylabel(labels[1])
    figure.colorbar(filled, ax=flat, label=labels[2])
    if title:
        figure.suptitle(title)
    return _save(figure, path)


def density_figure(
    densities: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]],
    path: str | Path,
    label: str,
    *,
    samples: npt.ArrayLike | None = None,
    samples_label: str | None = None,
    threshold: float | None = None,
    title: str | None = None,
) -> Path:
    """Probability densities, with a histogram of samples behind them.

    Parameters
    ----------
    densities
        Name -> (abscissae, density); each is thinner than the one before it and dashed in its own
        way, so that curves that coincide are all seen.
    path
        PNG file to write.
    label
        Of the abscissa, with the unit.
    samples
        Drawn as a histogram.
    samples_label
        Name of the histogram; by default their number.
    threshold
        Drawn as a vertical line; the first density is shaded beyond it.
    title
        Above the figure.
    """
    figure = _figure(6.5, 4.0)
    axis = figure.add_subplot()
    if samples is not None:
        drawn = np.asarray(samples, dtype=float).reshape(-1)
        bins = min(80, max(10, int(np.sqrt(drawn.size))))
        named = samples_label or f"{drawn.size} samples"
        axis.hist(drawn, bins=bins, density=True, color="#d0d0d0", label=named)
    for number, (name, (at, density)) in enumerate(densities.items()):
        x, y = np.asarray(at, dtype=float), np.asarray(density, dtype=float)
        colour = _LINES[number % len(_LINES)]
        dashes = _DASHES[number % len(_DASHES)]
        width = max(3.0 - 0.7 * number, 1.2) if len(densities) > 1 else 1.5
        axis.plot(x, y, color=colour, ls=dashes, lw=width, label=name)
        if threshold is not None and number == 0:
            axis.fill_between(x, y, where=(x >= threshold).tolist(), color=colour, alpha=0.25, lw=0)
    if threshold is not None:
        axis.axvline(threshold, color="black", ls="--", lw=1.0)
    axis.set_ylim(bottom=0)
    axis.set_xlabel(label)
    axis.set_ylabel("probability density")
    axis.legend(framealpha=0.9)
    if title:
        axis.set_title(title)
    return _save(figure, path)


# ---------------------------------------------------------------------------------------------
# Error against cost
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class FrontPanel:
    """Error against cost in one picture of :func:`front_figure`.

    Attributes
    ----------
    title, cost_label, error_label
        Texts, with units.
    points
        Method -> (n, 2) cost and error, both > 0.
    front
        Which of the points of a method may be on the front, (n,); the others are drawn small. All if the
        method is not named.
    marked
        (n, 2) cost and error of points that are drawn as stars.
    floor
        Error of what the errors are measured against; smaller ones are drawn there.
    """

    title: str
    cost_label: str
    error_label: str
    points: Mapping[str, npt.ArrayLike]
    front: Mapping[str, npt.ArrayLike] = dataclasses.field(default_factory=dict)
    marked: npt.ArrayLike = ()
    floor: float = 0.0


def pareto_front(cost: npt.ArrayLike, error: npt.ArrayLike) -> Ints:
    """Indices of the points that no other one beats in cost and in error, by rising cost."""
    c, e = np.asarray(cost, dtype=float), np.asarray(error, dtype=float)
    best, out = np.inf, []
    for i in np.lexsort((e, c)):
        if e[i] < best:
            best = e[i]
            out.append(i)
    return np.array(out, dtype=np.int64)


_MARKERS = ("o", "s", "^", "v", "x", "+", "D", "P", "<", ">")


def front_figure(
    panels: Sequence[Sequence[FrontPanel]], path: str | Path, *, marked_label: str = "chosen"
) -> Path:
    """Error against cost, doubly logarithmic: a marker a method, the front of all as a step line.

    Parameters
    ----------
    panels
        Rows of pictures.
    path
        PNG file to write.
    marked_label
        Of the stars.
    """
    rows, columns = len(panels), max(len(row) for row in panels)
    names = list(dict.fromkeys(n for row in panels for panel in row for n in panel.points))
    styles = {
        name: {"marker": _MARKERS[i % len(_MARKERS)], "color": _LINES[i % len(_LINES)]}
        for i, name in enumerate(names)
    }
    figure = _figure(3.9 * columns + 0.4, 3.5 * rows + 0.7)
    grid = figure.subplots(rows, columns, squeeze=False)
    shown: dict[str, Any] = {}
    for axes, row in zip(grid, panels, strict=True):
        for axis in axes[len(row) :]:
            axis.set_axis_off()
        for axis, panel in zip(axes, row, strict=False):
            _draw_front(axis, panel, styles, marked_label, shown)
    named = [n for n in (*names, *(n for n in shown if n not in names)) if n in shown]
    if named:
        figure.legend(
            [shown[n] for n in named],
            named,
            loc="outside lower center",
            ncol=min(len(named), 2 * columns),
            frameon=False,
            fontsize=9,
        )
    return _save(figure, path)


def _draw_front(
    axis: Any,
    panel: FrontPanel,
    styles: Mapping[str, Mapping[str, Any]],
    marked_label: str,
    shown: dict[str, Any],
) -> None:
    """One picture; `shown` collects what the legend names."""
    from matplotlib.ticker import NullFormatter

    candidates = []
    for name, given in panel.points.items():
        xy = np.asarray(given, dtype=float).reshape(-1, 2).copy()
        if not len(xy):
            continue
        xy[:, 1] = np.maximum(xy[:, 1], panel.floor)
        counts = np.asarray(panel.front.get(name, np.ones(len(xy))), dtype=bool)
        candidates.append(xy[counts])
        look = {"ls": "none", "mfc": "none", "mew": 1.1, **styles[name]}
        axis.plot(*xy[~counts].T, ms=3, alpha=0.5, **look)
        (shown[name],) = axis.plot(*xy[counts].T, ms=5.5, **look)
    everything = np.concatenate([np.empty((0, 2)), *candidates])
    front = everything[pareto_front(*everything.T)]
    axis.set_xscale("log")
    axis.set_yscale("log")
    stars = np.asarray(panel.marked, dtype=float).reshape(-1, 2).copy()
    if len(stars):
        stars[:, 1] = np.maximum(stars[:, 1], panel.floor)
        (shown[marked_label],) = axis.plot(
            *stars.T, "*", ms=12, mfc="#f0e442", mec="black", mew=0.9, ls="none", zorder=5
        )
    if len(front):
        # what a cost buys: the error of the best setting that costs as much or less
        x = np.append(front[:, 0], max(axis.get_xlim()[1], front[-1, 0]))
        (line,) = axis.plot(
            x, np.append(front[:, 1], front[-1, 1]), drawstyle="steps-post", color="black", lw=1.3, zorder=1
        )
        axis.set_xlim(right=x[-1])
        shown["front of all"] = line
    if panel.floor > 0.0:
        low = axis.get_ylim()[0]
        if low < panel.floor:
            band = axis.axhspan(low, panel.floor, color="#dddddd", lw=0, zorder=0)
            shown["below the error of the reference"] = band
            axis.set_ylim(bottom=low)
    _number_costs(axis.xaxis)
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel(panel.cost_label)
    axis.set_ylabel(panel.error_label)
    axis.set_title(panel.title, fontsize=10)
    axis.set_axisbelow(True)
    axis.grid(True, which="major", color="#dddddd", lw=0.6)


def _number_costs(axis: Any) -> None:
    """Ticks of a logarithmic axis as plain numbers, few enough to be read over any range."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    subs: tuple[float, ...] = (1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    if decades > 0.8:
        subs = (1.0,) if decades > 2.5 else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


if __name__ == "__main__":
    _draw_with_vtk(*sys.argv[1:])
