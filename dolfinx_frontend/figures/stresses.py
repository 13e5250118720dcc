"""Stresses on the surface of the deformed parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.common.checks import (
    check_known,
    checked_flag,
    checked_names,
    checked_numbers,
    checked_word,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.assemblies import Arrows, draw_coloured
from dolfinx_frontend.figures.canvas import shown_at
from dolfinx_frontend.figures.solids import skin_of
from dolfinx_frontend.results.answer import Answer, OfPart, check_answer
from dolfinx_frontend.results.stress import Shared

__all__ = ["stress_figure"]

_PRINCIPAL = ("principal 1", "principal 2", "principal 3")


def stress_figure(
    result: Answer,
    path: str | Path,
    *,
    of: str = "von Mises",
    deviation: bool = False,
    parts: Sequence[str] | str | None = None,
    step: int = -1,
    limits: tuple[float, float] | None = None,
    scale: float | None = None,
    label: str | None = None,
    view: Sequence[float] = (-0.45, -1.0, 0.45),
    lift: Mapping[str, float] | None = None,
    arrows: Arrows = (),
    title: str | None = None,
    renderer: str = "auto",
) -> Path:
    """The deformed assembly in colours of a stress.

    At a node it is the mean of the cells around, by volume, part by part: a part's stress is not mixed with
    its neighbour's. The largest value is named in the title, with its part.

    Parameters
    ----------
    result
        Any answer (samples and sweeps with ``keep_states=True``). Of a random one the mean is drawn: that of
        the von Mises stress of every sample, which is not the von Mises stress of the mean.
    path
        PNG file to write.
    of
        ``"von Mises"``, ``"principal 1"`` (the largest), ``"principal 2"``, ``"principal 3"``; or a component
        ``"xx"``, ``"xy"``, ...
    deviation
        Draw the standard deviation of a random answer instead.
    parts
        Those that are drawn; None: all.
    step
        Of a load history; the last by default.
    limits
        Ends of the colour bar, force / area. Where a rim presses into a face, a stress grows with every finer
        mesh: limits keep such a place from taking all the colours.
    scale
        Magnification of the displacements; chosen if not given.
    label
        Of the colour bar, with the unit.
    view, lift, arrows, title, renderer
        As in :func:`deformed_figure`.

    Raises
    ------
    SceneError
        A part or a stress that there is not, a material that gives none, a plane part and ``"von Mises"``.
    """
    where = "stress_figure"
    check_answer(where, "result", result)
    checked_flag(where, "deviation", deviation)
    problem = result.problem
    if isinstance(parts, str):
        parts = [parts]
    meshed = [name for name, part in problem.substructures.items() if has_mesh(part)]
    names = meshed if parts is None else checked_names(where, "parts", parts)
    for name in names:
        check_known("part", name, problem.substructures, where)
        problem.check_mesh(name)
    axes = "xyz"[: problem.dim]
    components = tuple(a + b for i, a in enumerate(axes) for b in axes[i:])
    checked_word(where, "of", of, ("von Mises", *_PRINCIPAL, *components))
    if limits is not None:
        low, high = checked_numbers(where, "limits", limits, "give two numbers, low < high", dimensions=1)
        if not low < high:
            raise SceneError(f"{where}: limits = {limits}; give two numbers, low < high")
    skins, colours = [], []
    for name in names:
        u = result.displacement(name, step)
        if deviation:
            stress = result.std(name, step, of=_deviations(of))
        else:
            kind = _deviations(of)
            stress = result.stress(name, step, of="tensor" if kind == "stress" else kind)
        at = _PRINCIPAL.index(of) if of in _PRINCIPAL else 0
        if of in components:  # of a ring in three axes, though its section is plane
            at = int(stress.function_space.value_shape[0]) * "xyz".index(of[0]) + "xyz".index(of[1])
        stress = Shared(stress).function(stress)
        skins.append(skin_of(u.function_space.mesh, None, u)[0])
        values = skin_of(u.function_space.mesh, None, stress)[0].values
        assert values is not None
        colours.append(values[:, at])
    largest = int(np.argmax([each.max() for each in colours]))
    shown = f"{of} stress" if of in components else of
    bar = label or (f"standard deviation of {shown}" if deviation else shown)
    unit = bar.rpartition("(")[2].rstrip(")") + " " if bar.endswith(")") else ""
    told = f"{shown}{shown_at(result, step, 'std' if deviation else '')}, "
    told += f"largest {colours[largest].max():.4g} {unit}in {names[largest]}"
    return draw_coloured(
        names, skins, colours, path, scale=scale, label=bar, view=view, lift=lift,
        title=f"{title}, {told}" if title else told, renderer=renderer, limits=limits, arrows=arrows,
    )  # fmt: skip


def _deviations(of: str) -> OfPart:
    """What the deviation of a number of a stress is asked of."""
    return "von Mises" if of == "von Mises" else "principal" if of in _PRINCIPAL else "stress"
