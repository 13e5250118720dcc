"""Points of a part that are nearest to a given one: corners, edges, axes of holes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.vectors import unit
from dolfinx_frontend.geometry.shapes import Body
from dolfinx_frontend.geometry.solids import POINTS_OF_EDGES

__all__ = ["PLACES"]

_FLAT = 1e-9
"""Height of an arc over its chord from which it is none, relative."""


def _curves(body: Body) -> Iterator[Array]:
    """Points (k, 3) of each edge, in order."""
    for face in body.faces:
        yield from face.rim.reshape(-1, POINTS_OF_EDGES, 3)


def _corners(body: Body, x: Array) -> Array:
    return np.array([end for curve in _curves(body) for end in curve[[0, -1]]])


def _edges(body: Body, x: Array) -> Array:
    return np.array([_on_curve(curve, x) for curve in _curves(body)])


def _on_curve(curve: Array, x: Array) -> Array:
    """Closest point of a line or an arc; of another curve, of the chords between its points."""
    a, b, c = curve[0], curve[1], curve[2]
    normal = np.cross(b - a, c - a)
    size = float(np.linalg.norm(np.ptp(curve, axis=0)))
    if np.linalg.norm(normal) > _FLAT * size**2:
        # the centre has the same distance to three points
        rows = np.array([b - a, c - a, normal])
        centre = np.linalg.solve(rows, np.array([rows[0] @ (a + b) / 2, rows[1] @ (a + c) / 2, normal @ a]))
        radius, axis = float(np.linalg.norm(a - centre)), unit(normal)
        across = x - centre - ((x - centre) @ axis) * axis
        if np.allclose(np.linalg.norm(curve - centre, axis=1), radius, rtol=1e-6) and across.any():
            on = centre + radius * unit(across)
            turn = [np.arctan2(np.cross(a - centre, p - centre) @ axis, (a - centre) @ (p - centre))
                    % (2 * np.pi) for p in (on, curve[3])]
            full = np.linalg.norm(curve[-1] - a) < 1e-6 * radius
            return on if full or turn[0] <= turn[1] * 4.0 / 3.0 else _closest(curve[[0, -1]], x)
    start, along = curve[:-1], np.diff(curve, axis=0)
    length = np.maximum(np.einsum("ki,ki->k", along, along), np.finfo(np.float64).tiny)
    share = np.clip(np.einsum("ki,ki->k", x - start, along) / length, 0.0, 1.0)
    return _closest(start + share[:, None] * along, x)


def _holes(body: Body, x: Array) -> Array:
    """Of the axes of holes, from one end to the other."""
    out = []
    for face in body.faces:
        first = face.first
        if first.kind == "cylinder" and first.hollow:
            t = (face.rim - first.origin) @ first.axis
            at = np.clip((x - first.origin) @ first.axis, t.min(), t.max())
            out.append(first.origin + at * first.axis)
    return np.array(out).reshape(-1, 3)


def _closest(points: Array, x: Array) -> Array:
    return np.asarray(points[np.argmin(np.linalg.norm(points - x, axis=1))])


PLACES: Mapping[str, Callable[[Body, Array], Array]] = {"corner": _corners, "edge": _edges, "hole": _holes}
"""Kind of place -> the points (k, 3) of that kind that may be the nearest to x (3,)."""
