"""Fields of interfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known, checked_number, checked_numbers
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.assemblies import KIND_COLOURS, Arrows, load_arrows
from dolfinx_frontend.figures.canvas import (
    fit_height,
    rgb,
    round_down,
    save,
    set_title,
    sheet,
    shown_at,
)
from dolfinx_frontend.figures.cuts import as_points, cut_solid
from dolfinx_frontend.figures.solids import corner_weights, draw_solid, joined, outline, skin_of
from dolfinx_frontend.io.facets import corner_fields, facet_fields
from dolfinx_frontend.results.answer import Answer
from dolfinx_frontend.results.contact import CLOSED, OPEN, SLIPS

if TYPE_CHECKING:
    from dolfinx import fem

    from dolfinx_frontend.assembly.problem import Problem

__all__ = ["facet_corners", "interface_figure", "interface_map"]


ROUND = 0.1
"""Mean normal of an interface below which it goes all around."""
STATE_COLOURS = ("#fff3c4", "#3b6fb6", "#e08214")
"""Of open, closed and slipping contacts; none is the grey of parts."""


def interface_figure(
    result: Answer,
    interface: str,
    path: str | Path,
    *,
    quantity: str = "pressure",
    label: str | None = None,
    step: int = -1,
    scale: float | None = None,
    hide: Sequence[str] | None = None,
    cut: tuple[Sequence[float], Sequence[float]] | None = None,
    view: Sequence[float] | None = None,
    arrows: Arrows = (),
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The deformed assembly with a field of an interface on the side that its points are on.

    The field is continuous in the space ``"mortar"``, and drawn facet by facet in the others.

    Parameters
    ----------
    result
        Result of a solve or a sampling (with ``keep_states=True``); a random answer shows its mean
        displacement.
    interface
        Its name.
    path
        PNG file to write.
    quantity
        A field of :func:`dolfinx_frontend.io.write_interfaces`: ``"pressure"``, ``"gap"``,
        ``"pressure std"``, ``"slip probability"``, ...; of vectors the magnitude is drawn. ``"state"``: where
        a contact is open, closed (sticks) or slips, in three colours.
    label
        Of the colour bar, with the unit; None: the quantity.
    step
        Of a load history.
    scale
        Magnification of the displacements; chosen if not given so that the largest is 3 % of the size of the
        parts that are drawn.
    hide
        Parts that are not drawn; None: in 3D those that would cover it, side 2 and what lies beyond.
    cut
        A point and a normal: instead of being hidden, solids that would cover the interface are cut open by
        this plane, and drawn where the normal does not point.
    view
        Direction towards the viewer, for solids; None: obliquely onto the interface.
    arrows
        Of loads on solids: where each starts and ends, ``((x, y, z), (x, y, z))``.
    title, renderer
        As in :func:`assembly_figure`.

    Raises
    ------
    SceneError
        An unknown interface, quantity or part to hide; a cut without a normal, or of a flat part.
    RenderError
        ``renderer="vtk"`` and VTK is missing or has no display.
    """
    from matplotlib.cm import ScalarMappable

    numbers, values = _drawn_values(result, interface, quantity, step)
    problem = result.problem
    described = problem.interfaces[interface]
    side = described.sides[described.carrier]
    normal = np.zeros(3)
    normal[: described.dim] = side.normal if np.any(side.normal) else described.normals[0]
    own = problem.substructures[side.substructure]
    names = _drawn(problem, interface, normal, hide)
    plane = None if cut is None else _plane(cut, described.dim)
    every = [] if plane is None else _drawn(problem, interface, normal, ())
    covering = sorted(set(every) - {*names, *(hide or ())})
    for name in (*names, *covering):
        problem.check_mesh(name)
    functions = {name: result.displacement(name, step) for name in names}
    skins = {name: skin_of(u.function_space.mesh, None, u) for name, u in functions.items()}
    scale = _visible_scale(skins) if scale is None else checked_number("interface_figure", "scale", scale)
    norm, colours = _scale_of(values, quantity)
    figure = sheet(6.5, 5.0)
    axis = figure.add_subplot()
    set_title(axis, (title or f"{quantity} on {interface}") + shown_at(result, step, quantity), scale)
    solids = []
    for name, (skin, facets) in skins.items():
        points = skin.points.copy()
        if skin.values is not None:
            points[:, : skin.values.shape[1]] += scale * skin.values
        if described.dim == 2:
            flat = np.ones(len(points))
            axis.tripcolor(*points[:, :2].T, skin.triangles, flat, cmap="Greys", vmin=0.0, vmax=5.0)
            outline(axis, skin, points)
            continue
        tint = np.tile(rgb(KIND_COLOURS["free"]), (len(facets), 1)) * 0.5 + 0.5
        if name == own.name:
            _, mine, at = np.intersect1d(facets, numbers, return_indices=True)
        if values.ndim == 1:
            if name == own.name:
                tint[mine] = colours(norm(values[at]))[:, :3]
            solids.append(skin.solid(points, tint[skin.patch]))
            continue
        if quantity == "state":  # one colour a triangle: states do not run into each other
            by_triangle = tint[skin.patch]
            if name == own.name:
                corners = corner_weights(values.shape[1])[skin.triangles % (len(points) // len(facets))]
                nearest = corners.sum(axis=1).argmax(axis=1)
                row = np.full(len(facets), -1)
                row[mine] = at
                drawn = np.flatnonzero(row[skin.patch] >= 0)
                states = values[row[skin.patch[drawn]], nearest[drawn]]
                by_triangle[drawn] = colours(norm(states))[:, :3]
            solids.append(skin.solid(points, by_triangle))
            continue
        tint = np.repeat(tint[:, None], len(points) // len(facets), axis=1)
        if name == own.name:
            inside = _between(corner_weights(values.shape[1]), values[at], quantity)
            tint[mine] = colours(norm(inside))[:, :, :3]
        solids.append(skin.solid(points, tint.reshape(-1, 3)))
    if solids:
        solids = [as_points(each) for each in solids] if plane is not None else solids
        for name in covering:
            assert plane is not None
            tone = rgb(KIND_COLOURS["free"]) * 0.5 + 0.5
            solids.append(as_points(cut_solid(result.displacement(name, step), scale, *plane, tone)))
        by_point = len(solids[0].colours) == len(solids[0].points)
        solids += load_arrows("interface_figure", arrows, by_point)
        direction = _onto(normal) if view is None else view
        ratio = draw_solid(figure, [axis], joined(solids), [direction], renderer)
        fit_height(figure, ratio, 5.1, 0.4, 5.4)
    else:
        moved = functions[own.name]
        _facet_lines(axis, own, side.face, numbers, values, quantity, moved, scale, norm, colours)
    label = label or (interface if quantity == "state" else quantity)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axis, label=label, shrink=0.85)
    if quantity == "state":
        bar.set_ticks([OPEN, CLOSED, SLIPS], labels=["open", "closed", "slips"])
    return save(figure, path, blended=quantity != "state")


def _plane(cut: Any, dim: int) -> tuple[Array, Array]:
    """Point and unit normal of a cut."""
    wanted = "give a point and a normal, each of three numbers"
    plane = checked_numbers("interface_figure", "cut", cut, wanted, dimensions=2)
    if dim != 3 or plane.shape != (2, 3) or not np.any(plane[1]):
        raise SceneError(f"interface_figure: cut = {cut}; {wanted}, for solids")
    return plane[0], plane[1] / np.linalg.norm(plane[1])


def _drawn_values(result: Answer, interface: str, quantity: str, step: int) -> tuple[Ints, Array]:
    """Facets (k,), and a scalar field on them: (k, vertices of a facet) where it is continuous, else (k,)."""
    numbers, found = facet_fields(result, interface, step)
    corners = corner_fields(result, interface, step)
    if corners is not None and quantity in corners[1]:
        values = corners[1][quantity]
        return numbers, np.linalg.norm(values, axis=2) if values.ndim == 3 else values
    known = {**found, **(corners[1] if corners is not None else {})}
    check_known("quantity", quantity, known, f"interface {interface!r}")
    return numbers, found[quantity] if found[quantity].ndim == 1 else np.linalg.norm(found[quantity], axis=1)


def _scale_of(values: Array, quantity: str) -> tuple[Any, Any]:
    """Norm and colours of a field."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize

    if quantity == "state":
        return BoundaryNorm([-0.5, 0.5, 1.5, 2.5], 3), ListedColormap(STATE_COLOURS)
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-6 * max(abs(low), abs(high)):  # all the same: rounding is no field
        low, high = low - 0.01 * max(abs(low), 1.0), high + 0.01 * max(abs(high), 1.0)
    return Normalize(low, high), colormaps["viridis"]


def _between(weights: Array, values: Array, quantity: str) -> Array:
    """(k, points): values (k, vertices) at points with weights (points, vertices); states are not mixed."""
    if quantity == "state":
        return np.asarray(values[:, weights.argmax(axis=1)])
    return np.asarray(values @ weights.T)


def _visible_scale(skins: Mapping[str, Any]) -> float:
    """Magnification by which the largest displacement is 3 % of the size of what is drawn."""
    everything = np.concatenate([skin.points for skin, _ in skins.values()])
    moves = [np.abs(skin.values).max() for skin, _ in skins.values() if skin.values is not None]
    size, most = float(np.ptp(everything, axis=0).max()), float(max(moves))
    return round_down(0.03 * size / most) if most > 0.0 else 1.0


def _drawn(problem: Any, interface: str, normal: Array, hide: Sequence[str] | None) -> list[str]:
    """Parts that are drawn: all but `hide`, by default in 3D those whose middle lies beyond the face."""
    described = problem.interfaces[interface]
    own = problem.substructures[described.sides[described.carrier].substructure]
    for name in hide or ():
        check_known("part", name, problem.substructures, "hide")
        if name == own.name:
            other = next((s.substructure for s in described.sides if s.substructure != name), "others")
            raise SceneError(
                f"interface_figure: hide = {name!r}, on which the points of {interface!r} are; hide {other}"
            )
    if hide is None and own.dim == 2:
        hide = ()  # nothing covers anything
    elif hide is None and float(np.linalg.norm(described.normals.mean(axis=0))) < ROUND:
        hide = [s.substructure for s in described.sides]  # all around: from every side something covers it
    elif hide is None:
        plane = float(normal[: own.dim] @ described.points.mean(axis=0))
        hide = [
            name
            for name, s in problem.substructures.items()
            if float((s.dof_coordinates @ normal[: own.dim]).mean()) > plane
        ]
    shown = [name for name, s in problem.substructures.items() if has_mesh(s)]
    return [name for name in shown if name not in hide or name == own.name]


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
    quantity: str,
    displacement: fem.Function,
    scale: float,
    norm: Any,
    colours: Any,
) -> None:
    """Facets of a face in the plane, displaced and coloured."""
    from matplotlib.collections import LineCollection

    facets = FacetMap(part.part, face, part.name)
    row = np.searchsorted(np.sort(part.part.facet_tags.find(part.part.names[face])), numbers)
    along = np.linspace(0.0, 1.0, 5)[:, None]
    index, s = np.repeat(row, len(along)), np.tile(along, (len(row), 1))
    x, _ = facets.push_forward(index, s)
    nodal = displacement.x.array.reshape(-1, part.dim)
    u = facets.trace(part.space, index, s, len(nodal)) @ nodal
    lines = (x + scale * u).reshape(len(row), len(along), 2)
    if values.ndim == 2:  # piece by piece
        middle = 0.5 * (along[1:] + along[:-1])
        values = _between(np.hstack([1.0 - middle, middle]), values, quantity).ravel()
        lines = np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 2)
    axis.add_collection(LineCollection(list(lines), colors=colours(norm(values)), lw=5.0, capstyle="butt"))


def interface_map(
    points: npt.ArrayLike,
    values: npt.ArrayLike,
    path: str | Path,
    label: str,
    *,
    facets: npt.ArrayLike | None = None,
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
    facets
        Corners (k, 3 or 4, 2 or 3) of the facets that the points lie in (:func:`facet_corners`): the field is
        then drawn on them, up to their border, linear in each and smoothed between them. None: over the hull
        of the points.
    mirror
        Opening in radians of the symmetric sector 0 <= theta <= mirror that the points lie in;
        the whole circle is then drawn.
    axes_labels, title
        Texts.
    extremes
        Mark where the field is largest and smallest.
    """
    x, f = _checked_field(points, values)
    triangles = None
    if facets is not None:
        if mirror is not None:
            raise SceneError("interface_map: give facets or mirror, not both")
        places, field, triangles = _on_facets(x, f, facets)
    else:
        places, field = (x, f) if mirror is None else _whole_circle(x, f, mirror)
    figure = sheet(6.2, 5.0)
    axis = figure.add_subplot()
    filled = _contours(axis, places, field, triangles)
    if facets is not None:
        _facet_edges(axis, facets)
    figure.colorbar(filled, ax=axis, label=label, shrink=0.9)
    if extremes:
        _mark_extremes(axis, x, f)
        if mirror is not None:  # inside the bore
            axis.legend(loc="center", framealpha=0.9)
        else:
            figure.legend(loc="outside lower center", ncol=2, frameon=False)
    axis.set_aspect("equal")
    axis.set_xlabel(axes_labels[0])
    axis.set_ylabel(axes_labels[1])
    if title:
        axis.set_title(title)
    return save(figure, path)


def _checked_field(points: npt.ArrayLike, values: npt.ArrayLike) -> tuple[Array, Array]:
    """First two coordinates (m, 2) of points, and a scalar field (m,) there."""
    x = checked_numbers("interface_map", "points", points, "give points (m, 2) or (m, 3)", dimensions=2)
    f = checked_numbers("interface_map", "values", values, "give one number per point").reshape(-1)
    if x.shape[1] < 2 or len(x) < 3:
        raise SceneError(f"interface_map: points of shape {x.shape}; give three (m, 2) or (m, 3) at least")
    if f.size != len(x):
        raise SceneError(f"interface_map: {f.size} values for {len(x)} points")
    return x[:, :2], f


def _whole_circle(x: Array, field: Array, mirror: float) -> tuple[Array, Array]:
    """Points (n, 2) and field of the whole circle from those of a sector that ends in two mirrors."""
    checked_number("interface_map", "mirror", mirror, above=0.0)
    copies = round(np.pi / mirror)
    if abs(copies * mirror - np.pi) > 1e-9:
        raise SceneError(f"interface_map: mirror = {mirror} must be pi divided by a whole number")
    both = np.concatenate([x, x * [1.0, -1.0]])
    turns = 2 * mirror * np.arange(copies)
    places = np.concatenate(
        [both @ np.array([[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]]) for t in turns]
    )
    # points on the symmetry planes come twice
    spacing = 1e-9 * float(np.abs(x).max())
    _, first = np.unique(np.round(places / spacing).astype(np.int64), axis=0, return_index=True)
    return places[first], np.tile(field, 2 * copies)[first]


def facet_corners(problem: Problem, interface: str) -> Array:
    """Corners (k, 3 or 4, 3) of the facets on the side of an interface that its points are on.

    Raises
    ------
    SceneError
        An unknown interface, or one of a plane problem.
    """
    check_known("interface", interface, problem.interfaces, "facet_corners")
    described = problem.interfaces[interface]
    if described.dim != 3:
        raise SceneError(f"facet_corners: {interface!r} is a line; give an interface of solids")
    side = described.sides[described.carrier]
    part = problem.substructures[side.substructure].part
    found = FacetMap(part, side.face, side.substructure)
    count = 4 if "hex" in found.cell.name else 3
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], dtype=float)[:count]
    rows = np.repeat(np.arange(len(found)), count)
    x, _ = found.push_forward(rows, np.tile(corners, (len(found), 1)))
    return np.asarray(x).reshape(len(found), count, 3)


def _on_facets(x: Array, f: Array, facets: npt.ArrayLike) -> tuple[Array, Array, Ints]:
    """Vertices (n, 2) of facets, a field (n,) there, and triangles (t, 3), from values at points in them.

    In each facet a linear field is fitted to its points; a vertex has the mean of its facets.
    """
    from scipy.spatial import cKDTree

    corners = checked_numbers("interface_map", "facets", facets, "give corners (k, 3 or 4, d)", dimensions=3)
    if corners.shape[1] not in (3, 4) or corners.shape[2] not in (2, 3):
        raise SceneError(f"interface_map: facets of shape {corners.shape}; give (k, 3 or 4, 2 or 3)")
    corners = corners[:, :, :2]
    count = corners.shape[1]
    owner = _facet_of(x, corners)
    at_corner = np.full(corners.shape[:2], np.nan)
    for k in np.unique(owner):
        mine = owner == k
        middle = x[mine].mean(axis=0)
        basis = np.column_stack([np.ones(mine.sum()), x[mine] - middle])
        fitted = np.linalg.lstsq(basis, f[mine], rcond=1e-6)[0]
        at_corner[k] = fitted[0] + (corners[k] - middle) @ fitted[1:]
    flat = corners.reshape(-1, 2)
    near = 1e-6 * float(np.ptp(flat, axis=0).max())
    first = cKDTree(flat).query_ball_point(flat, near)
    group = np.array([min(each) for each in first])
    _, vertex = np.unique(group, return_inverse=True)
    known = ~np.isnan(at_corner.ravel())
    number = np.bincount(vertex, known)
    mean = np.bincount(vertex[known], at_corner.ravel()[known], minlength=len(number))
    places = np.zeros((len(number), 2))
    places[vertex] = flat
    rows = vertex.reshape(-1, count)[np.isin(np.arange(len(corners)), owner)]
    triangles = rows if count == 3 else np.concatenate([rows[:, [0, 1, 3]], rows[:, [0, 3, 2]]])
    return places, mean / np.maximum(number, 1), triangles


def _facet_of(x: Array, corners: Array) -> Ints:
    """Facet (n,) that each of the points (n, 2) is in, or nearest to: corners (k, 3 or 4, 2)."""
    split = [(0, 1, 2)] if corners.shape[1] == 3 else [(0, 1, 3), (0, 3, 2)]
    least = np.full((len(x), len(corners)), -np.inf)
    for a, b, c in split:
        edges = np.stack([corners[:, b] - corners[:, a], corners[:, c] - corners[:, a]], axis=2)
        inside = np.einsum("kij,nkj->nki", np.linalg.pinv(edges), x[:, None] - corners[None, :, a])
        third = 1.0 - inside.sum(axis=2)
        least = np.maximum(least, np.minimum(inside.min(axis=2), third))
    return np.asarray(least.argmax(axis=1), dtype=np.int64)


def _facet_edges(axis: Any, facets: npt.ArrayLike) -> None:
    """Thin outlines of facets."""
    from matplotlib.collections import PolyCollection

    corners = np.asarray(facets, dtype=float)[:, :, :2]
    order = (0, 1, 2) if corners.shape[1] == 3 else (0, 1, 3, 2)
    lines = PolyCollection(list(corners[:, order]), facecolors="none", edgecolors="#555555", linewidths=0.3)
    axis.add_collection(lines)


def _contours(axis: Any, places: Array, field: Array, triangles: Ints | None = None) -> Any:
    """Filled contours of a field at points, with a line where it changes its sign."""
    from matplotlib.ticker import MaxNLocator
    from matplotlib.tri import Triangulation

    mesh = Triangulation(places[:, 0], places[:, 1], triangles)
    if triangles is None:
        corners = places[mesh.triangles]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        # triangles across a bore or outside a curved border have edges far longer than their peers
        mesh.set_mask(longest > 3.0 * np.median(longest))
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
    return filled


def _mark_extremes(axis: Any, x: Array, f: Array) -> None:
    """Marks where a field (m,) at points (m, 2) is largest and smallest."""
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
