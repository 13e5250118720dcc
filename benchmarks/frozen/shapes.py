"""What the scenes of the frozen corpus share: parts, one way to solve, one way to read."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import common  # noqa: F401  # makes the parts of the demos importable
import numpy as np
import numpy.typing as npt
from parts.rings import annulus as annulus  # noqa: F401

import dolfinx_frontend as lf
from dolfinx_frontend.geometry.parts import located

Array = npt.NDArray[np.float64]

STEEL = lf.LinearElastic(210e3, 0.3)
ALUMINIUM = lf.LinearElastic(70e3, 0.33)
BALANCE = 1e-6
"""Relative tolerance of an exact balance: a thousand times the tolerance of the iteration (energy)."""


def solved(problem: lf.Problem, rtol: float, times: Sequence[float] | None = None, **settings: Any) -> Any:
    """One answer at a tolerance."""
    options = lf.Options(rtol=rtol)
    return lf.solve(problem, times=times, options=options, progress=False, **settings)


def read(result: Any, *columns: str, **more: float) -> dict[str, Any]:
    """An answer, numbers of its tables, and more numbers.

    A column is named ``"interface.column"``, of the last step, or ``"interface.column@k"`` of step k.
    """
    return {"answer": result, **{name: number(result, name) for name in columns}, **more}


def number(result: Any, column: str) -> float:
    """A number of the tables, named as ``read`` does."""
    place, _, step = column.partition("@")
    interface, _, name = place.rpartition(".")
    table = result.table(interface, step=int(step)) if step else result.table(interface)
    return float(table.value(name, interface))


def arrived(problem: lf.Problem, rtol: float, times: Sequence[float]) -> dict[str, Any]:
    """A history that ends before its last step: its answer and ``"steps"``, how many converged first.

    A run that is refused as a whole has none.
    """
    try:
        result = solved(problem, rtol, times)
    except lf.SceneError:
        return {"steps": 0}
    known = [str(status) == "converged" for status in result.statuses]
    return {"answer": result, "steps": known.index(False) if False in known else len(known)}


def ramp(*values: float) -> lf.Amplitude:
    """Values at the times 0, 1, 2, ..."""
    return lf.Amplitude(list(range(len(values))), list(values))


def patched(
    part: lf.geometry.Part, patches: Mapping[str, tuple[str, Sequence[float], Sequence[float]]]
) -> Any:
    """A box with patches cut out of its faces.

    ``patches``: name -> (face such as ``"z1"``, lowest corner, highest corner); corners lie on nodes.
    """
    mesh, x = part.mesh, part.mesh.geometry.x
    low, high = x.min(axis=0), x.max(axis=0)
    small = 1e-6 * float((high - low).max())

    def plane(face: str) -> Callable[[Array], Any]:
        axis, value = "xyz".index(face[0]), (low, high)[int(face[1])]["xyz".index(face[0])]
        return lambda x: np.abs(x[axis] - value) < small

    def patch(face: str, first: Sequence[float], last: Sequence[float]) -> Callable[[Array], Any]:
        on = plane(face)
        return lambda x: on(x) & np.all(
            [
                (x[i] > a - small) & (x[i] < b + small)
                for i, (a, b) in enumerate(zip(first, last, strict=True))
            ],
            axis=0,
        )

    markers = {name: patch(*where) for name, where in patches.items()}
    whole = located(mesh, markers | {face: plane(face) for face in part.faces if face in FACES})
    taken = np.concatenate([whole.facets(name) for name in markers])
    faces = {face: np.setdiff1d(part.facets(face), taken) for face in part.faces if face in FACES}
    return lf.geometry.parts.tagged(mesh, {name: whole.facets(name) for name in markers} | faces)


FACES = ("x0", "x1", "y0", "y1", "z0", "z1")


def mapped(part: lf.geometry.Part, place: Callable[[Array], Array]) -> lf.geometry.Part:
    """A box whose nodes are moved, ``place(x)`` of points (n, 3)."""
    part.mesh.geometry.x[:] = place(part.mesh.geometry.x.copy())
    return part


def taper(
    lengths: tuple[float, float],
    divisions: tuple[int, int],
    angle: float,
    origin: tuple[float, float] = (0.0, 0.0),
    side: str = "x1",
) -> lf.geometry.Part:
    """A plane box one of whose sides, x0 or x1, leans along x by an angle (rad) from y = origin."""
    part = lf.geometry.box(lengths, divisions, origin=origin, cell="quadrilateral")

    def lean(x: Array) -> Array:
        share = (x[:, 0] - origin[0]) / lengths[0]
        x[:, 0] += (share if side == "x1" else 1.0 - share) * (x[:, 1] - origin[1]) * math.tan(angle)
        return x

    return mapped(part, lean)
