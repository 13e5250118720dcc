"""Rows of boxes."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import Assembly, Connection
from dolfinx_frontend.geometry.primitives import box

__all__ = ["block_chain"]


def block_chain(
    n: int,
    lengths: Sequence[float] = (1.0, 1.0, 1.0),
    divisions: Sequence[int] | Sequence[Sequence[int]] = (2, 2, 2),
    axis: int = 0,
    cell: str | None = None,
) -> Assembly:
    """Blocks end to end: parts ``block0``, ``block1``, ... along an axis.

    Parameters
    ----------
    n
        Number of blocks.
    lengths
        Edge lengths of each block.
    divisions
        Cells along each edge, for all blocks alike (meshes match) or one triple or pair per block.
    axis
        Direction of the chain.
    cell
        As in :func:`box`.

    Returns
    -------
    Assembly
        With the interfaces ``link1`` (between ``block0`` and ``block1``), ``link2``, ...
    """
    dim = len(lengths)
    if n < 1:
        raise SceneError(f"n = {n} must be at least 1")
    if axis not in range(dim):
        raise SceneError(f"axis = {axis} must be between 0 and {dim - 1}")
    each = np.asarray(divisions, dtype=int)
    if each.shape not in ((dim,), (n, dim)):
        raise SceneError(f"divisions = {divisions} must be {dim} numbers, or {n} rows of {dim}")
    each = np.broadcast_to(each, (n, dim))
    step = np.eye(dim)[axis] * float(lengths[axis])
    parts = {
        f"block{i}": box(lengths, row.tolist(), (i * step).tolist(), cell)
        for i, row in enumerate(each)
    }
    end = "xyz"[axis]
    links = tuple(
        Connection(f"link{i}", "perfect", f"block{i - 1}:{end}1", f"block{i}:{end}0")
        for i in range(1, n)
    )
    return Assembly(parts, links, MappingProxyType({"n": n, "lengths": tuple(lengths)}))
