"""Checks of the numbers that describe random parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_name, checked_number
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.model_limits import LIMITS, beyond

LEAST_COV = 1e-13
"""Smallest coefficient of variation that can be distinguished from rounding."""

TINY = 1e-150
"""Smallest standard deviation whose square does not underflow."""


def named(kind: str, name: Any) -> str:
    """Where a mistake in a random parameter is: its kind and its name, which is checked."""
    return f"{kind} {checked_name(kind, name)!r}"


def deviation(where: str, mean: float, cov: Any, std: Any) -> float:
    """Standard deviation, from `cov` or `std`; exactly one of them must be given."""
    if (cov is None) == (std is None):
        raise SceneError(
            f"{where}: give either cov (std / |mean|) or std, not "
            + ("none" if cov is None else "both")
        )
    if std is not None:
        spread = checked_number(where, "std", std, above=0.0)
    elif mean == 0.0:
        raise SceneError(f"{where}: mean 0 has no coefficient of variation; give std")
    else:
        spread = abs(mean) * checked_number(where, "cov", cov, above=0.0)
        if cov > LIMITS.cov:
            beyond(
                f"{where}: cov = {cov:g} is a standard deviation of {cov:g} times the mean: for {cov:g} % it "
                f"is cov={cov / 100.0:g}; std= says a deviation that is meant"
            )
    share = spread / abs(mean) if mean != 0.0 else 1.0
    if not LEAST_COV < share < 1.0 / LEAST_COV or not TINY < spread < 1.0 / TINY:
        raise SceneError(
            f"{where}: std = {spread:g} for a mean of {mean:g}: one of them is lost in the "
            "rounding of the other, or their squares leave the range of numbers; give a number that is not "
            "random, or use other units"
        )
    return spread


def refuse_positional(where: str, more: tuple[Any, ...]) -> None:
    """Refuse a spread without a keyword: it may be meant as either."""
    if more:
        raise SceneError(
            f"{where}: {more[0]!r} may be meant as either of two: give std={more[0]!r}, the standard "
            f"deviation, or cov={more[0]!r}, the coefficient of variation std / |mean|"
        )


def checked_bounds(where: str, lower: Any, upper: Any) -> tuple[float, float]:
    lo, up = checked_number(where, "lower", lower), checked_number(where, "upper", upper)
    if not lo < up:
        raise SceneError(f"{where}: lower = {lo:g} must be less than upper = {up:g}")
    return lo, up


def common_length(given: Mapping[str, Array], where: str = "") -> int:
    """Number of points of values (N,) or (1,) by name, which are set together."""
    sizes = {len(values) for values in given.values()} - {1}
    if len(sizes) > 1:
        raise SceneError(f"{where}values of different lengths: {sorted(sizes)}")
    return sizes.pop() if sizes else 1
