"""Pictures of the answer sheet, as PNG data that a page carries with it."""

from __future__ import annotations

import base64
import logging
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import FileError
from dolfinx_frontend.figures.assemblies import deformed_figure
from dolfinx_frontend.figures.canvas import LINES, save, sheet
from dolfinx_frontend.figures.interfaces import interface_figure
from dolfinx_frontend.figures.solids import RenderError
from dolfinx_frontend.results.answer import Answer
from dolfinx_frontend.sheets.seals import Seal, SealNumbers
from dolfinx_frontend.sheets.turning import view_of

__all__ = ["Picture", "View", "draw", "forces_picture", "margins_picture", "ring_picture", "solid_pictures"]

_log = logging.getLogger(__name__)
MOST = 12
"""Bolts with a line of their own."""
BAND = (0.05, 0.95)
_GREY, _RED = "#9aa5b1", "#d55e00"


class Picture(NamedTuple):
    """A picture; `data` is base64 of a PNG."""

    title: str
    data: str


class View(NamedTuple):
    """HTML of a picture that turns."""

    html: str


def draw(title: str, make: Callable[[Path], object]) -> Picture | str:
    """A picture, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        try:
            make(path)
        except (ValueError, RenderError, FileError, ImportError) as error:
            _log.info("no picture %s: %s", title, error)
            return f"{title}: {str(error).partition(chr(10))[0]}"
        return Picture(title, base64.b64encode(path.read_bytes()).decode())


def _with(unit: str, text: str) -> str:
    return f"{text} ({_plain(unit)})" if unit else text


def _plain(text: str) -> str:
    """A text that matplotlib shows as it is: no formula, and no label that it hides."""
    shown = text.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def forces_picture(
    forces: Mapping[str, Array], times: Array, tightened: Sequence[float], weakest: str, unit: str, path: Path
) -> None:
    """Bolt forces (N, T) over the steps; of samples the mean and the band from 5 to 95 %."""
    figure = sheet(7.5, 3.6)
    axis = figure.add_subplot()
    named = list(forces) if len(forces) <= MOST else [weakest]
    for k, (name, force) in enumerate(forces.items()):
        colour = LINES[k % len(LINES)] if name in named else _GREY
        bold = name == weakest
        axis.plot(
            times,
            force.mean(axis=0),
            color=_RED if bold else colour,
            lw=2.4 if bold else 1.1,
            ls="-" if k < len(LINES) or bold else "--",
            marker="." if len(times) < 40 else None,
            label=_plain(name) if name in named else None,
            zorder=3 if bold else 2,
        )
        if len(force) > 1 and (bold or len(forces) == 1):
            low, high = np.quantile(force, BAND, axis=0)
            axis.fill_between(times, low, high, color=_RED if bold else colour, alpha=0.18, lw=0)
    if len(tightened):
        axis.axvline(max(tightened), color="#555555", lw=0.8, ls=":")
    axis.set_xlabel("time of the load history (dotted: all bolts are tightened)")
    axis.set_ylabel(_with(unit, "bolt force"))
    axis.grid(alpha=0.25)
    axis.legend(fontsize=7, ncols=2, loc="best", framealpha=0.9)
    save(figure, path)


def margins_picture(margins: Mapping[str, Array], path: Path) -> None:
    """Least margin (N,) of each bolt; of samples and sweeps the middle and the range from 5 to 95 %."""
    names = list(margins)[:24]
    figure = sheet(7.5, 0.9 + 0.28 * len(names))
    axis = figure.add_subplot()
    for k, name in enumerate(names):
        values = margins[name]
        middle = float(np.mean(values))
        colour = _RED if k == 0 else LINES[0]
        axis.barh(k, middle, color=colour, height=0.6, alpha=0.85)
        if len(values) > 1:
            low, high = np.quantile(values, BAND)
            axis.plot([low, high], [k, k], color="black", lw=1.4, marker="|")
    axis.axvline(0.0, color="black", lw=1.0)
    axis.set_yticks(range(len(names)), [_plain(name) for name in names])
    axis.invert_yaxis()
    lowest = min(float(np.quantile(margins[n], BAND[0])) for n in names)
    axis.set_xlim(min(0.0, lowest) * 1.05, max(1.0, *(float(np.mean(margins[n])) for n in names)))
    axis.set_xlabel("least margin m (0: opens or slips; bar: value or mean; line: 5 to 95 %)")
    axis.grid(alpha=0.25, axis="x")
    save(figure, path)


def ring_picture(seal: Seal, numbers: SealNumbers, unit: str, path: Path) -> None:
    """Pressure of a gasket around its ring, against what it needs."""
    figure = sheet(7.5, 3.4)
    axis = figure.add_subplot()
    angles = np.append(seal.angles, 360.0)
    for colour, (stage, around) in zip((LINES[4], LINES[0]), numbers.around.items()):
        closed = np.append(around, around[:, :1], axis=1)
        axis.plot(angles, closed.mean(axis=0), color=colour, lw=1.8, label=stage)
        if len(closed) > 1:
            low, high = np.quantile(closed, BAND, axis=0)
            axis.fill_between(angles, low, high, color=colour, alpha=0.2, lw=0)
    for level, name in ((seal.service, "needed in service"), (seal.assembly, "needed at assembly")):
        if level is not None:
            style = "--" if name.endswith("service") else ":"
            axis.axhline(level, color=_RED, ls=style, lw=1.3, label=name)
    axis.set_xlim(0, 360)
    axis.set_xticks(range(0, 361, 45))
    low, high = axis.get_ylim()
    axis.set_ylim(min(0.0, low), high)
    axis.set_xlabel("angle around the ring (degrees)")
    axis.set_ylabel(_with(unit, "pressure"))
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)
    save(figure, path)


def solid_pictures(
    answer: Any, interfaces: Sequence[str], units: Mapping[str, str], renderer: str
) -> list[Picture | View | str]:
    """The assembly, and the pressure on some of its interfaces."""
    found: list[Picture | View | str] = []
    for name in interfaces:

        def pressure(path: Path, name: str = name) -> object:
            label = _with(units["stress"], "pressure")
            return interface_figure(answer, name, path, label=label, renderer=renderer)

        found.append(draw(f"pressure on {name}", pressure))
    title = "the assembly, deformed"
    label = _with(units["length"], "|u|")
    if answer.without_displacements is not None:
        return [*found, f"{title}: {answer.without_displacements}"]
    try:
        view = view_of(answer, units["length"])
    except SceneError as error:
        return [*found, f"{title}: {str(error).partition(chr(10))[0]}"]
    if view.startswith("<"):
        return [*found, View(view)]
    return [*found, draw(title, lambda p: deformed_figure(answer, p, label=label, renderer=renderer))]


def shown_answer(answer: Answer) -> str:
    """Of what fields in pictures are."""
    return {"value": "", "grid": " (last point of the sweep)"}.get(answer.statistics, " (mean)")
