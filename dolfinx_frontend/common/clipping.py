"""Intersections of flat convex polygons, all pairs at once.

For the few faces of CAD models that are looked at before anything is meshed; interfaces of meshes are
intersected by the kernel.

Source: J. Sutherland, G. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974) 32-42.
"""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.arrays import Array

__all__ = ["clip"]


def clip(subjects: Array, windows: Array) -> Array:
    """Intersections of convex polygons, pair by pair.

    Parameters
    ----------
    subjects
        (k, a, 2), corners in the order of the rim, either way round.
    windows
        (k, b, 2), counter-clockwise.

    Returns
    -------
    Array
        (k, c, 2); polygons with fewer than c corners repeat one of them, empty ones have no area.
    """
    out = np.asarray(subjects, dtype=np.float64)
    rows = np.arange(len(out))[:, None]
    for edge in range(windows.shape[1]):
        start = windows[:, edge, None, :]
        along = windows[:, (edge + 1) % windows.shape[1], None, :] - start
        inside = along[..., 0] * (out - start)[..., 1] - along[..., 1] * (out - start)[..., 0]
        following, ahead = np.roll(out, -1, axis=1), np.roll(inside, -1, axis=1)
        kept, crossed = inside >= 0.0, (inside >= 0.0) != (ahead >= 0.0)
        share = np.divide(inside, inside - ahead, out=np.zeros_like(inside), where=crossed)
        crossing = out + share[..., None] * (following - out)
        # every edge gives its first corner, then the point where it crosses the line
        points = np.stack([out, crossing], axis=2).reshape(len(out), -1, 2)
        valid = np.stack([kept, crossed], axis=2).reshape(len(out), -1)
        width = max(int(valid.sum(axis=1).max(initial=0)), 1)
        order = np.argsort(~valid, axis=1, kind="stable")[:, :width]
        order = np.where(np.take_along_axis(valid, order, axis=1), order, order[:, :1])
        out = points[rows, order]
        out[~valid.any(axis=1)] = 0.0  # nothing is left: one point
    return out
