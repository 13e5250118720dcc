"""Fields of interfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known, checked_number, checked_numbers
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.assemblies import KIND_COLOURS
from dolfinx_frontend.figures.canvas import rgb, round_down, save, sheet
from dolfinx_frontend.figures.solids import corner_weights, draw_solid, joined, outline, skin_of
from dolfinx_frontend.io.facets import corner_fields, facet_fields
from dolfinx_frontend.results.answer import Answer
from dolfinx_frontend.results.contact import CLOSED, OPEN, SLIPS

if TYPE_CHECKING:
    from dolfinx import fem

__all__ = ["interface_figure", "interface_map"]


STATE_COLOURS = ("#d9d9d9", "#3b6fb6", "#e08214")
"""Of open, closed and slipping contacts."""


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
    view: Sequence[float] | None = None,
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
    view
        Direction towards the viewer, for solids; None: obliquely onto the interface.
    title, renderer
        As in :func:`assembly_figure`.

    Raises
    ------
    SceneError
        An unknown interface, quantity or part to hide.
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
    for name in names:
        problem.check_mesh(name)
    functions = {name: result.displacement(name, step) for name in names}
    skins = {name: skin_of(u.function_space.mesh, None, u) for name, u in functions.items()}
    scale = _visible_scale(skins) if scale is None else checked_number("interface_figure", "scale", scale)
    norm, colours = _scale_of(values, quantity)
    figure = sheet(6.5, 5.0)
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
        draw_solid(figure, [axis], joined(solids), [_onto(normal) if view is None else view], renderer)
    else:
        moved = functions[own.name]
        _facet_lines(axis, own, side.face, numbers, values, quantity, moved, scale, norm, colours)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axis, label=label or quantity, shrink=0.85)
    if quantity == "state":
        bar.set_ticks([OPEN, CLOSED, SLIPS], labels=["open", "closed", "slips"])
    return save(figure, path, blended=quantity != "state")


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
    if hide is None and own.dim == 2:
        hide = ()  # nothing covers anything
    elif hide is None:
        plane = float(normal[: own.dim] @ described.points.mean(axis=0))
        hide = [
            name
            for name, s in problem.substructures.items()
            if float((s.dof_coordinates @ normal[: own.dim]).mean()) > plane
        ]
    return [name for name in problem.substructures if name not in hide or name == own.name]


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
    x, f = _checked_field(points, values)
    places, field = (x, f) if mirror is None else _whole_circle(x, f, mirror)
    figure = sheet(6.2, 5.0)
    axis = figure.add_subplot()
    filled = _contours(axis, places, field)
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


def _contours(axis: Any, places: Array, field: Array) -> Any:
    """Filled contours of a field at points, with a line where it changes its sign."""
    from matplotlib.ticker import MaxNLocator
    from matplotlib.tri import Triangulation

    mesh = Triangulation(*places.T)
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
