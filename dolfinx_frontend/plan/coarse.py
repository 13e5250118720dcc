"""Coarse (macro) problem: which displacements of an interface are balanced for all parts at once."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array

__all__ = ["Moments", "basis"]


Moments = Literal["resultants", "linear"]
"""Constant fields (the resultants of the forces), or linear ones (their moments, too)."""

_FLAT = 1e-4
"""A face has no extent in a direction in which it is thinner than this fraction of its size."""
_DEPENDENT = 1e-6
"""Fields are left out if less than this fraction of them is independent of the others."""


def basis(interface: Interface, frames: Array, components: int, moments: Moments = "linear") -> Array:
    """Coarse displacements of an interface, orthonormal in the metric of its areas.

    They are constant or linear in space, which includes its rigid motions, seen in the components that the
    law has: on a plane interface of all components 9 in 3D and 4 in 2D, on a curved one up to 12 and 6.

    Parameters
    ----------
    interface
        m points with weights.
    frames
        (components * m, d) rows of the local frame.
    components
        Unknown components at a point.
    moments
        ``"resultants"``: constant fields only.

    Returns
    -------
    Array
        (components * m, moments), in Fortran order.
    """
    d, m = interface.dim, interface.num_points
    w = interface.weights
    fields = [np.ones(m)]
    if moments == "linear" and m > 1:
        x = interface.points[:, :d] - w @ interface.points[:, :d] / w.sum()
        spread, axes = np.linalg.eigh((x * w[:, None]).T @ x)
        fields += [x @ axes[:, i] / np.sqrt(s) for i, s in enumerate(spread) if s > _FLAT**2 * spread[-1]]
    axis = frames.reshape(m, components, d)
    raw = np.stack([(axis[:, :, a] * f[:, None]).ravel() for f in fields for a in range(d)], axis=1)
    raw /= np.linalg.norm(raw, axis=0).clip(min=np.finfo(float).tiny)
    root = np.sqrt(np.repeat(w, components))[:, None]
    left, size, _ = np.linalg.svd(root * raw, full_matrices=False)
    return np.asfortranarray(left[:, size > _DEPENDENT * size[0]] / root)
