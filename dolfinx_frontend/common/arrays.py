"""Types of arrays, written once, and the largest of one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Flags", "Ints", "largest_of"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]


def largest_of(errors: Array) -> float:
    """The largest of some errors (0 of none), or NaN if one is not known."""
    return float(np.max(errors, initial=0.0)) if np.all(np.isfinite(errors)) else float("nan")
