"""Vectors of space."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.arrays import Array

__all__ = ["unit", "unit_rows"]


def unit(v: Array) -> Array:
    """The direction of a vector (d,), exact if it is a coordinate axis up to rounding."""
    direction = v / np.linalg.norm(v)
    axis = np.round(direction)
    return np.asarray(axis + 0.0 if np.abs(direction - axis).max() < 1e-9 else direction, dtype=np.float64)


def unit_rows(v: Array) -> Array:
    """The directions of vectors (m, d); those of length 0 stay so."""
    length = np.linalg.norm(v, axis=1)
    return np.asarray(v / np.where(length > 0.0, length, 1.0)[:, None], dtype=np.float64)
