"""Mean and standard deviation of fields whose samples come some at a time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dolfinx_frontend.common.arrays import Array

__all__ = ["Accumulator", "of_modes"]


class Accumulator:
    """Sums of samples about the first of them, so that nothing cancels."""

    def __init__(self, independent: bool = True) -> None:
        """Samples without weights are `independent` draws; Sobol points are not: they fill the space evenly,
        and their variance is divided by their number."""
        self._independent = independent
        self._origin: dict[str, Array] = {}
        self._sums: dict[str, tuple[Array, Array]] = {}
        self._total = 0.0
        self._lost = 0.0

    def add(self, fields: Mapping[str, Array], weights: Array | None) -> None:
        """Fields (n, ...) by name, with weights (n,); None: of a sample, with an unbiased variance if its
        points are independent."""
        if weights is None:
            weights = np.ones(len(next(iter(fields.values()))))
            self._lost = float(self._independent)
        self._total += float(weights.sum())
        for name, values in fields.items():
            origin = self._origin.setdefault(name, values[0].copy())
            away = values - origin
            first, second = (np.tensordot(weights, power, 1) for power in (away, away**2))
            before = self._sums.get(name, (0.0, 0.0))
            self._sums[name] = (before[0] + first, before[1] + second)

    def found(self) -> dict[str, tuple[Array, Array]]:
        """Name -> mean and standard deviation, (...) each."""
        out = {}
        free = max(self._total - self._lost, 0.5 * self._total)  # of one sample the deviation is 0
        for name, (first, second) in self._sums.items():
            mean = first / self._total
            variance = (second - self._total * mean**2) / free
            out[name] = (self._origin[name] + mean, np.sqrt(np.maximum(variance, 0.0)))
        return out


def of_modes(modes: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (...) of chaos modes (P + 1, ...), exactly."""
    deviation: Array = np.sqrt(np.sum(modes[1:] ** 2, axis=0))
    return modes[0], deviation
