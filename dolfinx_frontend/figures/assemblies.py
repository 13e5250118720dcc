"""Assemblies, apart and deformed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem

from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, checked_number, checked_numbers
from dolfinx_frontend.common.compat import vertex_nodes
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.canvas import (
    fit_height,
    plane_axes,
    rgb,
    round_down,
    save,
    set_title,
    sheet,
    shown_at,
)
from dolfinx_frontend.figures.solids import Skin, Solid, arrow, draw_solid, joined, outline, skin_of
from dolfinx_frontend.geometry.parts import Assembly
from dolfinx_frontend.results.answer import Answer, check_answer

__all__ = ["KIND_COLOURS", "assembly_figure", "deformed_figure"]


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
"""Colour of a face by the kind of its interface: the kinds of the paper, and three more."""

LOAD_COLOUR = "#b00020"
"""Of the arrows of loads."""

Arrows = Sequence[tuple[Sequence[float], Sequence[float]]]
"""Arrows of loads: where each starts and ends."""

_ABOVE, _BELOW = (-0.45, -1.0, 0.45), (-0.7, 0.8, -0.4)


def load_arrows(where: str, arrows: Arrows, by_point: bool) -> list[Solid]:
    """What draws them, in colours of points or of triangles.

    Raises
    ------
    SceneError
        Not two points (3,) each, or both the same.
    """
    found, wanted = [], "give (start, end), each of three numbers"
    for each in arrows:
        ends = checked_numbers(where, "arrows", each, wanted, dimensions=2)
        if ends.shape != (2, 3) or not np.any(ends[0] != ends[1]):
            raise SceneError(f"{where}: arrows has {short(each)}; {wanted}")
        found.append(arrow(ends[0], ends[1], rgb(LOAD_COLOUR), by_point))
    return found


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
    arrows: Arrows = (),
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The parts, their meshes, and their faces coloured by the kind of their interface.

    Solids that are lifted apart are drawn assembled as well.

    Parameters
    ----------
    assembly
        Parts, with interfaces that name faces and kinds.
    path
        PNG file to write.
    explode
        Gap between the parts, which are lifted apart along z, as a fraction of the height of the
        assembly; 0 leaves them in place.
    lift
        Part -> shift along z, instead of `explode`; parts that are not named stay in place.
    arrows
        Of loads on the assembled solid: where each starts and ends, ``((x, y, z), (x, y, z))``.
    title
        Above the figure.
    renderer
        ``"vtk"``, ``"matplotlib"`` or ``"auto"``: VTK where it works.

    Raises
    ------
    RenderError
        ``renderer="vtk"`` and VTK is missing or has no display.
    """
    check_kind("assembly_figure", "assembly", assembly, Assembly, "give parts with their interfaces")
    checked_number("assembly_figure", "explode", explode, least=0.0)
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
            raise ValueError(f"lift names unknown parts: {sorted(set(lift) - set(bounds))}")
        shifts |= lift
    elif explode:
        shifts = _stacked(bounds, explode * height)
    together, apart = [], []
    for name, part in assembly.parts.items():
        tags = {int(f): int(t) for f, t in zip(part.facet_tags.indices, part.facet_tags.values)}
        skin, facets = skin_of(part.mesh, tags)
        colour = {t: rgb(_face_colour(kind_of, f"{name}:{face}")) for face, t in part.names.items()}
        by_patch = np.stack([colour[tags[int(f)]] for f in facets])
        together.append(skin.solid(skin.points, by_patch[skin.patch]))
        apart.append(skin.solid(skin.points + [0.0, 0.0, shifts[name]], by_patch[skin.patch]))
    together += load_arrows("assembly_figure", arrows, by_point=False)
    lifted = any(shifts.values())
    figure = sheet(10.0 if lifted else 7.0, 6.0)
    axes = figure.subplots(1, 3 if lifted else 2)
    if title:
        figure.suptitle(title)
    if lifted:
        ratio = draw_solid(figure, axes[:1], joined(together), [_ABOVE], renderer)
        ratio = max(ratio, draw_solid(figure, axes[1:], joined(apart), [_ABOVE, _BELOW], renderer))
    else:
        ratio = draw_solid(figure, axes, joined(together), [_ABOVE, _BELOW], renderer)
    labels = ("assembled", "lifted apart", "from below")
    for axis, label in zip(axes, labels if lifted else ("from above", "other side, from below")):
        axis.set_title(label, fontsize=12)
    fit_height(figure, ratio, 3.2, 1.3 if title else 0.9, 7.5)
    _kind_legend(figure, assembly, kind_of)
    return save(figure, path)


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
    figure.legend(
        handles=handles, loc="outside lower center", ncol=len(handles), frameon=False, fontsize=12
    )


def _plane_assembly(
    assembly: Assembly, kind_of: Mapping[str, str], path: str | Path, title: str | None
) -> Path:
    from matplotlib.collections import LineCollection

    figure = sheet(6.5, 6.0)
    axis = figure.add_subplot()
    for name, part in assembly.parts.items():
        skin, _ = skin_of(part.mesh)
        flat = skin.points[:, :2]
        axis.tripcolor(flat[:, 0], flat[:, 1], skin.triangles, np.zeros(len(flat)), cmap="Greys")
        axis.add_collection(LineCollection(list(flat[skin.segments]), colors="#999999", lw=0.4))
        part.mesh.topology.create_connectivity(1, 0)
        for face in part.names:
            colour = _face_colour(kind_of, f"{name}:{face}")
            vertices = [part.mesh.topology.connectivity(1, 0).links(f) for f in part.facets(face)]
            ends = part.mesh.geometry.x[vertex_nodes(part.mesh)[np.asarray(vertices)], :2]
            axis.add_collection(LineCollection(list(ends), colors="black", lw=3.6))
            axis.add_collection(LineCollection(list(ends), colors=colour, lw=2.4))
    plane_axes(axis)
    if title:
        axis.set_title(title)
    _kind_legend(figure, assembly, kind_of)
    return save(figure, path)


def deformed_figure(
    displacements: Answer | Mapping[str, fem.Function] | Sequence[fem.Function],
    path: str | Path,
    *,
    step: int = -1,
    scale: float | None = None,
    label: str = "|u| (mm)",
    quantity: Callable[[Array], Array] | None = None,
    view: Sequence[float] = (-0.45, -1.0, 0.45),
    lift: Mapping[str, float] | None = None,
    arrows: Arrows = (),
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The deformed assembly, coloured by a function of the displacement.

    Parameters
    ----------
    displacements
        Any answer (of a random one the mean is drawn), or one vector-valued Lagrange function per part.
    path
        PNG file to write.
    step
        Of the load history of an answer.
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
    arrows
        Of loads on solids: where each starts and ends, ``((x, y, z), (x, y, z))``.
    title, renderer
        As in :func:`assembly_figure`.
    """
    names, functions = _named_functions(displacements, step)
    shown = quantity or (lambda v: np.asarray(np.linalg.norm(v, axis=1)))
    skins = [skin_of(u.function_space.mesh, None, u)[0] for u in functions]
    colours = [np.asarray(shown(s.values), dtype=float) for s in skins if s.values is not None]
    if not isinstance(displacements, (Mapping, Sequence)):
        title = (title or "displacement") + shown_at(displacements, step)
    return draw_coloured(
        names, skins, colours, path, scale=scale, label=label, view=view, lift=lift, title=title,
        renderer=renderer, arrows=arrows,
    )  # fmt: skip


def draw_coloured(
    names: Sequence[str],
    skins: Sequence[Skin],
    colours: Sequence[Array],
    path: str | Path,
    *,
    scale: float | None,
    label: str,
    view: Sequence[float],
    lift: Mapping[str, float] | None,
    title: str | None,
    renderer: str,
    limits: tuple[float, float] | None = None,
    arrows: Arrows = (),
) -> Path:
    """Skins whose values are displacements, moved by them, in colours of numbers at their points."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if lift is not None and not set(lift) <= set(names):
        raise ValueError(f"lift names parts that are not drawn: {sorted(set(lift) - set(names))}")
    values = [s.values for s in skins if s.values is not None]
    moved = np.concatenate([np.linalg.norm(v, axis=1) for v in values])
    everything = np.concatenate([s.points for s in skins])
    size = float(np.ptp(everything, axis=0).max())
    if scale is None:
        scale = round_down(0.06 * size / float(moved.max())) if moved.max() > 0 else 1.0
    checked_number("figure", "scale", scale)
    low, high = limits or (min(c.min() for c in colours), max(c.max() for c in colours))
    norm, map_ = Normalize(low, high), colormaps["viridis"]
    figure = sheet(6.5, 5.0)
    axis = figure.add_subplot()
    set_title(axis, title or "", scale)
    solids = []
    for name, skin, u, field in zip(names, skins, values, colours, strict=True):
        points = skin.points.copy()
        points[:, : u.shape[1]] += scale * u
        points[:, u.shape[1] - 1] += (lift or {}).get(name, 0.0)
        if u.shape[1] == 2:
            axis.tripcolor(
                points[:, 0], points[:, 1], skin.triangles, field, norm=norm, shading="gouraud"
            )
            outline(axis, skin, points)
        else:
            solids.append(skin.solid(points, map_(norm(field))[:, :3]))
    if solids:
        solids += load_arrows("figure", arrows, by_point=True)
        fit_height(figure, draw_solid(figure, [axis], joined(solids), [view], renderer), 5.1, 0.4, 5.4)
    below, above = min(c.min() for c in colours) < low, max(c.max() for c in colours) > high
    extend = "both" if below and above else "min" if below else "max" if above else "neither"
    figure.colorbar(ScalarMappable(norm, map_), ax=axis, label=label, shrink=0.85, extend=extend)
    return save(figure, path, blended=True)


def _named_functions(
    displacements: Answer | Mapping[str, fem.Function] | Sequence[fem.Function], step: int
) -> tuple[list[str], list[fem.Function]]:
    """Names of the parts (empty if they are not known) and their displacements."""
    if not isinstance(displacements, (Mapping, Sequence)):
        check_answer("deformed_figure", "displacements", displacements)
        parts = [name for name, s in displacements.problem.substructures.items() if has_mesh(s)]
        displacements.problem.check_mesh()
        displacements = {name: displacements.displacement(name, step) for name in parts}
    named = isinstance(displacements, Mapping)
    functions = list(displacements.values() if isinstance(displacements, Mapping) else displacements)
    wanted = "give an answer, or one displacement per part"
    if not functions:
        raise SceneError(f"deformed_figure: displacements = {short(displacements)}; {wanted}")
    for function in functions:
        check_kind("deformed_figure", "displacements", function, fem.Function, wanted)
    return list(displacements) if named else [""] * len(functions), functions
