"""Values of laws and materials: numbers, arrays, functions of the points, parameters with a mean.

A *value* of a law is a number, an array with one row per interface point, a callable of the points
``x (m, d) -> (m,)`` or ``(m, d)``, an opaque parameter (random, swept) with a ``mean``, or one that
changes in time (:class:`dolfinx_frontend.Amplitude` times a value).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import is_real, refuse_masked, told_call
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Combination, Varying

__all__ = [
    "Parameter",
    "Value",
    "evaluate",
    "is_plain",
    "is_random_field",
    "is_uncertain",
    "is_zero",
    "largest",
    "number",
]


@runtime_checkable
class Parameter(Protocol):
    """A value that is not known yet (random or swept); deterministic solvers take its mean."""

    @property
    def mean(self) -> float:
        """Nominal value."""


Value: TypeAlias = (float | Sequence[float] | Array | Callable[[Array], npt.ArrayLike] | Parameter | Varying)


def is_plain(value: object) -> bool:
    """Whether a value is a number or an array of numbers."""
    if isinstance(value, (int, float, np.number, np.ndarray)):
        return True
    return isinstance(value, (list, tuple)) and all(is_plain(v) for v in value)


def is_uncertain(value: object) -> bool:
    """Whether a value is a random number, or an expression of some."""
    return not is_plain(value) and isinstance(value, Parameter) and hasattr(value, "leaves")


def is_random_field(value: object) -> bool:
    """Whether a value is a random field."""
    return not is_plain(value) and isinstance(value, Parameter) and hasattr(value, "relative")


def number(value: object) -> float | None:
    """The value as a float if it is a single plain number, otherwise None."""
    if isinstance(value, (int, float, np.number)):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return float(value)
    return None


def is_zero(value: object) -> bool:
    """Whether a value is plainly nothing: None, or numbers that are all 0."""
    return value is None or (is_plain(value) and not np.any(np.asarray(value)))


def largest(value: object) -> float:
    """Size of the largest number of a value, random ones at means, amplitudes at 1; 0: it is not known."""
    if isinstance(value, Varying):
        value = value.nominal
    if isinstance(value, Combination):
        return sum(abs(coefficient) * largest(term) for coefficient, term in value.terms)
    if is_plain(value):
        return float(np.abs(np.asarray(value, dtype=np.float64)).max(initial=0.0))
    return abs(float(value.mean)) if isinstance(value, Parameter) else 0.0


def evaluate(
    value: Any,
    points: Array,
    components: int,
    what: str,
    scalar: str = "all",
    arrays: bool = True,
) -> Array:
    """Values of a law at points.

    Parameters
    ----------
    value
        Number, array (m,), (m, components) or (components,), callable or parameter with a mean.
        An array of ``components > 1`` numbers is one vector for all points, even if m is the same.
    points
        (m, d), length.
    components
        Number of components wanted.
    what
        What the value is, for messages, e.g. ``"interface 'joint', parameter 'normal'"``.
    scalar
        What a single number (per point) means if ``components > 1``: ``"first"`` sets the first
        component, ``"all"`` sets all of them, ``"zero"`` allows nothing but 0.
    arrays
        False if the points are not the interface points, so that a value per interface point
        cannot be used.

    Returns
    -------
    Array
        (m, components).

    Raises
    ------
    SceneError
        Wrong shape, wrong type, or a number that is not finite.
    """
    m = len(points)
    if isinstance(value, Varying):
        raise SceneError(f"{what}: it changes in time: solve with times=[...]")
    if isinstance(value, Combination):
        total = np.zeros((m, components))
        for coefficient, term in value.terms:
            total += coefficient * evaluate(term, points, components, what, scalar, arrays)
        return total
    origin = "gave"
    if not is_plain(value):
        if callable(value):
            value = told_call(what, value, points)
            origin = "returned"
        elif isinstance(value, Parameter):
            value = value.mean
        else:
            raise SceneError(
                f"{what}: a value of type {type(value).__name__} is not understood; give a number, "
                "an array, a callable of the points (m, d), or a parameter with a mean"
            )
    data = _as_array(value, what)
    if components == 1:
        if data.ndim == 0:
            return np.full((m, 1), float(data))
        if data.shape in ((m,), (m, 1)) and (arrays or origin == "returned"):
            return data.reshape(m, 1).copy()
    else:
        if data.shape == (components,):
            return np.tile(data, (m, 1))
        if data.shape == (m, components) and (arrays or origin == "returned"):
            return data.copy()
        per_point = data.ndim == 0 or (data.shape == (m,) and (arrays or origin == "returned"))
        if per_point and (scalar != "zero" or not np.any(data)):
            out = np.zeros((m, components))
            out[:, slice(0, 1) if scalar == "first" else slice(None)] = (
                data if data.ndim == 0 else data[:, None]
            )
            return out
    wanted = "a number" if components == 1 or scalar != "zero" else f"{components} components"
    if arrays or origin == "returned":
        wanted += f" or {m} rows (one per interface point)" + (f" of {components}" if components > 1 else "")
    else:
        wanted += " or a callable of the points (it is needed at nodes, not at interface points)"
    shown = f"shape {data.shape}" if data.ndim else f"the number {float(data):g}"
    raise SceneError(f"{what}: wrong shape: {origin} {shown}, wanted {wanted}")


def _as_array(value: Any, what: str) -> Array:
    """A value as finite numbers of any shape."""
    refuse_masked(what, value)
    try:
        given = np.asarray(value)
        # a complex number would lose a part, a text may be read as a number, None as NaN
        if given.dtype.kind not in "biufO" or (given.dtype.kind == "O" and not all(map(is_real, given.flat))):
            raise TypeError
        data = given.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as err:
        raise SceneError(f"{what}: {short(value)} is not a number or an array of numbers") from err
    if not np.all(np.isfinite(data)):
        raise SceneError(f"{what}: contains NaN or infinity; give finite numbers")
    return data
