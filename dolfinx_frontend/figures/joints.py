"""The diagram of a bolted joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.checks import checked_number, checked_numbers
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.figures.canvas import LINES, save, sheet

__all__ = ["joint_diagram"]


def joint_diagram(
    load: npt.ArrayLike,
    bolt: npt.ArrayLike,
    clamping: npt.ArrayLike,
    path: str | Path,
    *,
    stiffness: float,
    units: tuple[str, str] = ("mm", "N"),
    title: str | None = None,
) -> Path:
    """Force of a bolt and of the parts that it clamps: against its elongation, and against the load.

    The left diagram is that of VDI 2230: the bolt is a line through the origin, the clamped parts one that
    falls from the preload to the point where the joint is open; the load is the distance between the two.

    Parameters
    ----------
    load
        Working load, (n,), rising from 0: n >= 2.
    bolt, clamping
        Force of the bolt (tension > 0) and between the clamped parts (pressure > 0) at each load, (n,).
    path
        PNG file to write.
    stiffness
        Of the bolt, force / length: :attr:`BoltStiffness.axial`.
    units
        Of length and force, for the labels.
    title
        Above the figure.

    Raises
    ------
    SceneError
        Arrays of different lengths, or less than two loads.
    """
    where = "joint_diagram"
    given = {"load": load, "bolt": bolt, "clamping": clamping}
    wanted = "give one finite number per load"
    loads, forces, clamped = (checked_numbers(where, name, values, wanted) for name, values in given.items())
    if len({loads.shape, forces.shape, clamped.shape}) > 1 or loads.size < 2 or loads.ndim != 1:
        shapes = ", ".join(f"{n} {v.shape}" for n, v in zip(given, (loads, forces, clamped), strict=True))
        raise SceneError(f"{where}: {shapes}; give the three as (n,), n >= 2")
    k = checked_number(where, "stiffness", stiffness, above=0.0)
    length, force = units
    figure = sheet(9.6, 4.2)
    left, right = figure.subplots(1, 2)
    blue, red, green = LINES[:3]

    elongation = forces / k
    left.plot([0.0, *elongation], [0.0, *forces], color=blue, lw=2.0, label="bolt")
    left.plot(elongation, clamped, "o-", color=red, ms=4, lw=2.0, label="clamped parts")
    middle = int(np.argmin(np.abs(loads - 0.6 * loads[clamped > 1e-6 * forces].max(initial=loads[1]))))
    ends = [(elongation[middle], values[middle]) for values in (clamped, forces)]
    left.annotate("", xy=ends[1], xytext=ends[0], arrowprops={"arrowstyle": "<->", "color": green, "lw": 1.6})
    left.annotate(
        f"load\n{loads[middle]:.5g} {force}",
        xy=(ends[0][0], 0.5 * (ends[0][1] + ends[1][1])),
        xytext=(8, 0),
        textcoords="offset points",
        va="center",
        color=green,
    )
    left.set_xlabel(f"elongation of the bolt ({length})")
    left.set_ylabel(f"force ({force})")

    right.plot(loads, forces, "o-", color=blue, ms=4, lw=2.0, label="bolt")
    right.plot(loads, clamped, "o-", color=red, ms=4, lw=2.0, label="clamped parts")
    right.plot(loads, loads, color="#666666", ls="--", lw=1.0, label="the load itself")
    right.set_xlabel(f"load ({force})")
    right.set_ylabel(f"force ({force})")
    for axis in (left, right):
        axis.set_xlim(left=0.0)
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.25)
        axis.legend(framealpha=0.9)
    left.set_xlim(right=max(1.05 * float(elongation.max()), 1.22 * ends[0][0]))  # room for the text
    if title:
        figure.suptitle(title)
    return save(figure, path)
