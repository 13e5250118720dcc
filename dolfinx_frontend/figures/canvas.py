"""Sheets, colours and lines of flat figures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.files import Files, replaced


LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")

DASHES = ("-", "--", "-.", ":")

_DPI = 200


def sheet(width: float, height: float) -> Any:
    """A figure without a window and without global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def fit_height(figure: Any, ratio: float, width: float, around: float, most: float) -> None:
    """Make a figure as high as its pictures, which have this ratio (height / width) and width (inches).

    `around` is what titles and legends take, `most` what the figure may have; nothing is left blank.
    """
    figure.set_figheight(float(np.clip(ratio * width + around, 2.4, most)))


def save(figure: Any, path: str | Path, blended: bool = False) -> Path:
    from PIL import Image

    target = checked_path("figure", path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, facecolor="white", bbox_inches="tight")
    # a palette makes the file three times smaller; where colours run into each other it needs dither
    full = Image.open(buffer).convert("RGB")
    picture = full.quantize(256, dither=Image.Dither.NONE)
    if blended:
        covering = full.quantize(256, method=Image.Quantize.MAXCOVERAGE)
        colours = np.array(covering.getpalette(), dtype=np.uint8).reshape(-1, 3)
        colours[colours.sum(axis=1).argmax()] = 255  # paper stays white
        covering.putpalette(colours.ravel().tolist())
        picture = full.quantize(palette=covering, dither=Image.Dither.FLOYDSTEINBERG)
    with Files() as files:
        files.folder(target.parent)
        temporary = files.enter_context(replaced(target))
        picture.save(temporary, format="png", dpi=(_DPI, _DPI))
    return target


def rgb(colour: str) -> Array:
    from matplotlib.colors import to_rgb

    return np.asarray(to_rgb(colour))


def plane_axes(axis: Any) -> None:
    axis.set_aspect("equal")
    axis.set_xlabel("x")
    axis.set_ylabel("y")


def round_down(value: float) -> float:
    """The next lower number of the form 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-12)) * power)


def shown_at(answer: Any, step: int, of: str = "") -> str:
    """Of which step a picture is, and of which statistic, for its title; `of` names its field."""
    times, kind = getattr(answer, "times", None), getattr(answer, "statistics", "value")
    found = [] if times is None else [f"t = {times[step]:g}"]
    if kind == "grid":
        found.append("last point of the sweep")
    elif kind != "value" and not any(word in of for word in ("std", "probability", "mean")):
        found.append("mean")
    return "".join(f", {each}" for each in found)


def set_title(axis: Any, what: str, scale: float) -> None:
    """The title of a deformed picture, on two lines where it is long."""
    between = ",\n" if len(what) > 50 else ", "
    axis.set_title(f"{what}{between if what else ''}displacements × {scale:g}", fontsize=11)


def colours_of(count: int) -> list[str]:
    return [LINES[i % len(LINES)] for i in range(count)]
