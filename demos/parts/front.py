"""Error against cost, and the front of what nothing beats."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.figures.canvas import LINES, save, sheet

__all__ = ["FrontPanel", "front_figure", "pareto_front"]


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
        name: {"marker": _MARKERS[i % len(_MARKERS)], "color": LINES[i % len(LINES)]}
        for i, name in enumerate(names)
    }
    figure = sheet(3.9 * columns + 0.4, 3.5 * rows + 0.7)
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
    return save(figure, path)


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
