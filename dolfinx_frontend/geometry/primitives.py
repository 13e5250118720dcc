"""Meshes that need no mesh generator."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_numbers, checked_reals
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.recorded import recorded
from dolfinx_frontend.geometry.parts import Marker, Part, cell_type, check_divisions, check_positive, located

__all__ = ["box"]

DIGITS = 1e-12
"""A cell is at least this long, relative to its coordinates."""

MOST_CELLS = 2**31 - 1
"""Cells of a mesh that can be numbered."""


@recorded
def box(
    lengths: Sequence[float],
    divisions: Sequence[int],
    origin: Sequence[float] | None = None,
    cell: str | None = None,
) -> Part:
    """A block with faces ``x0``, ``x1``, ``y0``, ``y1`` and, in three dimensions, ``z0``, ``z1``.

    Parameters
    ----------
    lengths
        Two or three edge lengths.
    divisions
        Cells along each edge.
    origin
        The corner with the lowest coordinates; the origin if not given.
    cell
        ``"triangle"`` or ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``; the
        quadrilateral and the hexahedron if not given.

    Raises
    ------
    SceneError
        A length that is not positive, a cell of another dimension, divisions that do not fit.
    """
    sizes = checked_reals("box", "lengths", lengths, "give 2 or 3 edge lengths")
    dim = len(sizes) if sizes.ndim == 1 else 0
    if dim not in (2, 3):
        raise SceneError(f"box: lengths = {short(lengths)} must hold 2 or 3 edge lengths")
    check_positive(**{f"lengths[{i}]": float(v) for i, v in enumerate(sizes)})
    numbers = check_divisions(divisions, dim)
    low: Array = np.zeros(dim)
    if origin is not None:
        low = checked_numbers("box", "origin", origin, f"give {dim} coordinates, like the lengths")
    if low.shape != (dim,):
        raise SceneError(f"box: origin = {short(origin)} must have {dim} coordinates, like the lengths")
    high = low + sizes
    steps = sizes / numbers
    lost = [i for i in range(dim) if steps[i] < DIGITS * max(abs(low[i]), abs(high[i]), np.finfo(float).tiny)]
    if lost or not np.all(np.isfinite(high)):
        raise SceneError(
            f"box: origin = {short(origin)}: coordinates there are rounded to more than the cells, which are "
            f"{short(steps.tolist())} long; choose an origin nearer to 0"
        )
    if math.prod(numbers) > MOST_CELLS:
        raise SceneError(
            f"box: divisions = {short(divisions)} make {math.prod(numbers):.1e} cells; "
            f"{MOST_CELLS:.1e} at most"
        )
    kind = cell_type(("quadrilateral", "hexahedron")[dim - 2] if cell is None else cell, dim)
    build = dmesh.create_rectangle if dim == 2 else dmesh.create_box
    mesh = build(MPI.COMM_SELF, [low, high], numbers, cell_type=kind)

    def plane(axis: int, value: float) -> Marker:
        tolerance = 1e-3 * float(sizes[axis]) / numbers[axis]
        return lambda x: np.abs(x[axis] - value) < tolerance

    return located(
        mesh,
        {
            f"{'xyz'[axis]}{end}": plane(axis, float((low, high)[end][axis]))
            for axis in range(dim)
            for end in (0, 1)
        },
    )
