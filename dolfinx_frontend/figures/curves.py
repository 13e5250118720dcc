"""Convergence, responses and densities."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.checks import (
    check_kind,
    checked_number,
    checked_numbers,
    checked_reals,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.canvas import DASHES, LINES, colours_of, save, sheet

__all__ = ["convergence_figure", "density_figure", "response_surface"]


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
        belongs to iteration 0, before the first iteration.
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
    figure = sheet(7.0, 4.0)
    axis = figure.add_subplot()
    dots = "start of a new point"
    for colour, (name, history) in zip(colours_of(len(runs)), runs.items()):
        where, what, wanted = "convergence_figure", "histories", "give errors, one after each iteration"
        check_kind(where, what, history, (list, tuple, np.ndarray), wanted)
        pieces = [np.atleast_1d(checked_reals(where, what, piece, wanted)) for piece in history]
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
        checked_number("convergence_figure", "target", target, above=0.0)
        axis.axhline(target, color="#666666", ls="--", lw=1.0, label=f"target {target:g}")
    axis.set_xlabel("iterations")
    axis.set_ylabel(label)
    axis.grid(True, which="major", color="#dddddd", lw=0.6)
    if axis.get_legend_handles_labels()[1]:
        axis.legend(loc="upper right", framealpha=0.9)
    if title:
        axis.set_title(title)
    return save(figure, path)


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
    """A response over two parameters, as a surface and as a map, with one level line.

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
    given = {"x": x, "y": y, "z": z}
    xs, ys, zs = (checked_numbers("response_surface", n, v, "give finite numbers") for n, v in given.items())
    if zs.shape != (xs.size, ys.size) or min(zs.shape) < 2:
        raise SceneError(
            f"response_surface: z has the shape {zs.shape}, expected (x, y) = {(xs.size, ys.size)}, 2 values "
            "each at least"
        )
    checked_number("response_surface", "level", level)
    grid_x, grid_y = np.meshgrid(xs, ys, indexing="ij")
    figure = sheet(11.0, 4.6)
    crosses = zs.min() < level < zs.max()
    # the line lies on the surface: draw it last, at any depth
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
    return save(figure, path)


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
        Name -> (abscissae, density); each line is thinner than the one before it and has its own
        dashes, so that curves that coincide remain visible.
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
    where = "density_figure"
    check_kind(where, "densities", densities, Mapping, "give {name: (abscissae, density)}")
    if threshold is not None:
        checked_number(where, "threshold", threshold)
    figure = sheet(6.5, 4.0)
    axis = figure.add_subplot()
    if samples is not None:
        drawn = checked_numbers(where, "samples", samples, "give finite numbers").reshape(-1)
        bins = min(80, max(10, int(np.sqrt(drawn.size))))
        named = samples_label or f"{drawn.size} samples"
        axis.hist(drawn, bins=bins, density=True, color="#d0d0d0", label=named)
    for number, (name, given) in enumerate(densities.items()):
        wanted = "give abscissae and density, of one length"
        check_kind(where, f"densities[{name!r}]", given, (tuple, list, np.ndarray), wanted)
        x, y = checked_numbers(where, f"densities[{name!r}]", np.stack(given), wanted, dimensions=2)
        colour = LINES[number % len(LINES)]
        dashes = DASHES[number % len(DASHES)]
        width = max(3.0 - 0.7 * number, 1.2) if len(densities) > 1 else 1.5
        axis.plot(x, y, color=colour, ls=dashes, lw=width, label=name)
        if threshold is not None and number == 0:
            axis.fill_between(x, y, where=(x >= threshold).tolist(), color=colour, alpha=0.25, lw=0)
    if threshold is not None:
        axis.axvline(threshold, color="black", ls="--", lw=1.0)
    rows = len(densities) + (samples is not None)
    axis.set_ylim(0.0, axis.get_ylim()[1] * (1.05 + 0.08 * rows))  # the names stay above the curves
    axis.set_xlabel(label)
    unit = re.search(r"\(([^()]+)\)$", label)
    axis.set_ylabel(f"probability density (1/{unit[1]})" if unit else "probability density")
    if rows:
        axis.legend(framealpha=0.9, loc="upper right")
    if title:
        axis.set_title(title)
    return save(figure, path)
