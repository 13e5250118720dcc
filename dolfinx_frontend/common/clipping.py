"""Intersections of flat convex polygons, all pairs at once.

All pairs are clipped at once in NumPy; convex polygons of at most four corners need only thirty lines.
Shapely (GEOS) could intersect arrays of polygons too, but the polygons would have to be projected into the
plane of a facet of side 1 and the results cut into triangles just as here. The additional package would pay
only for polygons that are not convex, and facets are convex.

Source: J. Sutherland, G. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974) 32-42.
"""

from __future__ import annotations

import basix
import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints

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


def flatten(window: Array, subject: Array) -> tuple[Array, Array]:
    """Corners of pairs of polygons (k, v, d) in the plane of the first: (k, v, d - 1) each."""
    d = window.shape[2]
    centre = window.mean(axis=1, keepdims=True)
    if d == 2:
        along = window[:, 1] - window[:, 0]
        axes = (along / np.linalg.norm(along, axis=1)[:, None])[:, None, :]
    else:
        arms = window - centre
        area = np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1)
        normal = area / np.linalg.norm(area, axis=1)[:, None]
        first = window[:, 1] - window[:, 0]
        first -= np.einsum("ki,ki->k", first, normal)[:, None] * normal
        first /= np.linalg.norm(first, axis=1)[:, None]
        axes = np.stack([first, np.cross(normal, first)], axis=1)
    flat = tuple(np.einsum("kaj,kvj->kva", axes, x - centre) for x in (window, subject))
    return flat[0], flat[1]


def simplices_of(window: Array, subject: Array) -> tuple[Ints, Array]:
    """Simplices of the intersections: the pair of each, and its corners (r, fdim + 1, fdim)."""
    if window.shape[2] == 1:
        low = np.maximum(window[:, :, 0].min(axis=1), subject[:, :, 0].min(axis=1))
        high = np.minimum(window[:, :, 0].max(axis=1), subject[:, :, 0].max(axis=1))
        pair = np.flatnonzero(high > low)
        return pair, np.stack([low, high], axis=1)[pair, :, None]
    common = clip(subject, window)
    count = common.shape[1] - 2
    if count < 1:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3, 2))
    apex = np.repeat(common[:, :1], count, axis=1)
    fan = np.stack([apex, common[:, 1:-1], common[:, 2:]], axis=2).reshape(-1, 3, 2)
    pair = np.repeat(np.arange(len(common)), count)
    solid = measure(fan) > 0.0
    return pair[solid], fan[solid]


def measure(simplices: Array) -> Array:
    """(r,) length or area."""
    sides = simplices[:, 1:] - simplices[:, :1]
    if simplices.shape[2] == 1:
        return np.abs(sides[:, 0, 0])
    return np.asarray(
        0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    )


def rule_on(simplices: Array, degree: int) -> tuple[Array, Array]:
    """Points (r, q, fdim) and weights (r, q) of a rule on every simplex."""
    fdim = simplices.shape[2]
    cell = basix.CellType.interval if fdim == 1 else basix.CellType.triangle
    s, w = (np.asarray(a) for a in basix.make_quadrature(cell, degree))
    barycentric = np.column_stack([1.0 - s.sum(axis=1), s])
    points = np.einsum("qv,rvi->rqi", barycentric, simplices)
    return points, measure(simplices)[:, None] * (w / w.sum())
