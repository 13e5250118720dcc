"""Vectors of space."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.arrays import Array

__all__ = ["unit"]


def unit(v: Array) -> Array:
    """The direction of a vector (d,), exact if it is a coordinate axis up to rounding."""
    direction = v / np.linalg.norm(v)
    axis = np.round(direction)
    return np.asarray(axis + 0.0 if np.abs(direction - axis).max() < 1e-9 else direction, dtype=np.float64)
