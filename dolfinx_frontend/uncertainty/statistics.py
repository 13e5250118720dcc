"""What is asked of a random number, and what errors of it are relative to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from dolfinx_frontend.common.arrays import Array

__all__ = [
    "FINEST",
    "NOISE",
    "Compared",
    "ErrorShare",
    "MeanStd",
    "Relative",
    "Statistic",
    "of_iteration",
    "share_of",
    "size_of",
    "whole_of",
]

FINEST = 1e-12
"""Tightest tolerance of a solve."""

NOISE = 100.0
"""A standard deviation below this many times the tolerance, relative to the mean, is noise."""


class MeanStd(NamedTuple):
    """Mean and standard deviation of a quantity of interest; None: not random."""

    mean: float
    std: float | None


@dataclass(frozen=True)
class ErrorShare:
    """One error of an answer.

    Attributes
    ----------
    energy
        Relative, in the energy norm; NaN: not known.
    quantity
        Of the quantity of interest (of its mean, if random), absolute, in its unit; None: none was named.
    std
        Of its standard deviation, absolute; None: not random.
    how
        How it was measured.
    """

    energy: float
    quantity: float | None = None
    std: float | None = None
    how: str = ""


@dataclass(frozen=True)
class Compared:
    """What errors of a quantity are relative to: its mean, and its deviation, unless this says otherwise.

    Attributes
    ----------
    least
        Size that both count as at least, in the unit of the quantity: beside it a small number is nothing.
    deviation
        Whether errors of the mean are relative to the deviation, too.
    """

    least: float = 0.0
    deviation: bool = False

    def size(self, mean: float, std: float | None) -> float:
        """What an error of the mean is relative to."""
        return max(std if self.deviation and std else abs(mean), self.least)

    def __str__(self) -> str:
        to = "the deviation" if self.deviation else "itself"
        return f"relative to {to}" + (f", or to {self.least:.3g} if that is more" if self.least else "")


class Relative(Protocol):
    """What says what its errors are relative to: a quantity of interest, or a :class:`Statistic`."""

    @property
    def compared(self) -> Compared:
        """What that is."""


@dataclass(frozen=True)
class Statistic:
    """Mean and deviation of a random number, or the value that it is below with a probability.

    Attributes
    ----------
    level
        That probability; None: mean and deviation.
    compared
        What errors are relative to.
    """

    level: float | None = None
    compared: Compared = Compared()

    def value(self, values: Array, weights: Array) -> MeanStd:
        """Of values (N,) with weights (N,) of sum 1; a quantile has no deviation."""
        if self.level is None:
            mean = float(weights @ values)
            return MeanStd(mean, float(np.sqrt(max(float(weights @ (values - mean) ** 2), 0.0))))
        ranked = np.argsort(values)
        below = np.maximum.accumulate(np.cumsum(weights[ranked]) - 0.5 * weights[ranked])
        return MeanStd(float(np.interp(self.level, below, values[ranked])), None)

    def controls(self, values: Array, mean: float, std: float) -> Array:
        """What a statistic near these is made of, (..., k), of values that are close to the number: their
        normalised powers, or whether they are below the quantile."""
        if self.level is not None:
            return np.asarray(values < mean, dtype=np.float64)[..., None]
        v = (values - mean) / std
        return np.stack([v, v**2], axis=-1)


def share_of(error: float, whole: float) -> float:
    """An error relative to the whole; infinite where the whole is nothing."""
    if whole == 0.0:
        return 0.0 if error == 0.0 else np.inf
    return abs(error / whole)


def whole_of(value: MeanStd, rtol: float, quantity: Relative | None = None) -> float | None:
    """What an error of the standard deviation is relative to: itself, if it is more than what a run with this
    error leaves of a mean."""
    if value.std is None:
        return None
    noise = value.std <= NOISE * rtol * abs(value.mean)
    least = 0.0 if quantity is None else quantity.compared.least
    return max(abs(value.mean) if noise else value.std, least)


def size_of(value: MeanStd, quantity: Relative | None = None) -> float:
    """What an error of the mean is relative to."""
    return abs(value.mean) if quantity is None else quantity.compared.size(*value)


def of_iteration(error: float, value: MeanStd | None) -> ErrorShare:
    """The algebraic error by its estimate, which is relative and of the whole."""
    how = "its estimate"
    if value is None:
        return ErrorShare(error, how=how)
    return ErrorShare(error, error * abs(value.mean), None if value.std is None else error * value.std, how)
