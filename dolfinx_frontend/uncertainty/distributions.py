"""Distributions of one variable, as scipy.stats spells them, and those that it does not have."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from dolfinx_frontend.common.arrays import Array


class Distribution(Protocol):
    """What is used of a distribution; scipy's frozen continuous ones fit as they are."""

    def pdf(self, x: Any) -> Any: ...
    def cdf(self, x: Any) -> Any: ...
    def sf(self, x: Any) -> Any: ...
    def ppf(self, u: Any) -> Any: ...
    def isf(self, u: Any) -> Any: ...
    def mean(self) -> Any: ...
    def std(self) -> Any: ...
    def support(self) -> tuple[Any, Any]: ...


class NewScipyLaw:
    """Random variables of scipy >= 1.15 (``scipy.stats.Normal(mu=0, sigma=1)``)."""

    def __init__(self, variable: Any) -> None:
        self._variable = variable
        self.pdf = variable.pdf
        self.cdf = variable.cdf
        self.sf = variable.ccdf
        self.ppf = variable.icdf
        self.isf = variable.iccdf
        self.mean = variable.mean
        self.std = variable.standard_deviation
        self.support = variable.support


class OpenTurnsLaw:
    """An OpenTURNS distribution of dimension 1, without importing OpenTURNS."""

    def __init__(self, distribution: Any) -> None:
        self._distribution = distribution

    @staticmethod
    def _each(function: Callable[[Any], Any], values: Any) -> Array:
        column = np.asarray(values, dtype=np.float64)
        result = np.array(function(column.reshape(-1, 1)), dtype=np.float64)
        return result.reshape(column.shape)

    def pdf(self, x: Any) -> Array:
        return self._each(self._distribution.computePDF, x)

    def cdf(self, x: Any) -> Array:
        return self._each(self._distribution.computeCDF, x)

    def sf(self, x: Any) -> Array:
        return self._each(self._distribution.computeComplementaryCDF, x)

    def _quantile(self, u: Any, tail: bool) -> Array:
        values = np.asarray(u, dtype=np.float64)
        found = [self._distribution.computeQuantile(float(v), tail)[0] for v in values.ravel()]
        return np.array(found, dtype=np.float64).reshape(values.shape)

    def ppf(self, u: Any) -> Array:
        return self._quantile(u, False)

    def isf(self, u: Any) -> Array:
        return self._quantile(u, True)

    def mean(self) -> float:
        return float(self._distribution.getMean()[0])

    def std(self) -> float:
        return float(self._distribution.getStandardDeviation()[0])

    def support(self) -> tuple[float, float]:
        interval = self._distribution.getRange()
        lower = interval.getLowerBound()[0] if interval.getFiniteLowerBound()[0] else -math.inf
        upper = interval.getUpperBound()[0] if interval.getFiniteUpperBound()[0] else math.inf
        return float(lower), float(upper)


def panels(law: Distribution) -> tuple[Array, Array]:
    """Nodes and weights (n,) that integrate polynomials times the density of a continuous distribution.

    Gauss-Legendre panels, halved where their mass differs from that of the distribution function;
    so kinks and integrable singularities of the density are found.  A panel that stays different at
    the smallest size takes the mass of the distribution function.
    """
    x, w = np.polynomial.legendre.leggauss(16)
    lower, upper = (float(v) for v in law.support())
    for tail in (1e-100, 1e-15):
        if not math.isfinite(lower):
            lower = float(law.ppf(tail))
        if not math.isfinite(upper):
            upper = float(law.isf(tail))
    middle = float(law.ppf(0.5))
    nodes: list[Array] = []
    weights: list[Array] = []
    edges = np.linspace(lower, upper, 97)
    left, right = edges[:-1], edges[1:]
    for level in range(60):
        half = 0.5 * (right - left)
        points = (0.5 * (left + right))[:, None] + half[:, None] * x
        masses = np.asarray(law.pdf(points)) * (half[:, None] * w)
        outer = np.where(left >= middle, law.sf(left), law.cdf(right))
        exact = outer - np.where(left >= middle, law.sf(right), law.cdf(left))
        with np.errstate(invalid="ignore"):
            # the second bound is the cancellation in `exact`
            error = np.abs(masses.sum(axis=1) - exact)
            close = error <= np.maximum(1e-12 * exact, 4e-16 * outer)
        last = level == 59 or len(left) > 4000
        if last:
            usable = np.where(np.isfinite(masses), np.maximum(masses, 0.0), 0.0)
            total = usable.sum(axis=1)
            uniform = exact[:, None] * (0.5 * w)
            with np.errstate(invalid="ignore", divide="ignore"):
                scaled = usable * (exact / total)[:, None]
            masses = np.where(close[:, None], masses, np.where(total[:, None] > 0, scaled, uniform))
            close = np.ones_like(close)
        nodes.append(points[close].ravel())
        weights.append(masses[close].ravel())
        if last or close.all():
            break
        left, right = left[~close], right[~close]
        centre = 0.5 * (left + right)
        left, right = np.concatenate([left, centre]), np.concatenate([centre, right])
    return np.concatenate(nodes), np.concatenate(weights)


def moments_determine(law: Distribution) -> bool:
    """Whether polynomials in the variable itself are a complete basis.

    They are for a bounded support and for tails like exp(-|x|^(1/2)) or lighter; not for a
    lognormal variable (O. Ernst et al., ESAIM M2AN 46 (2012) 317).  Judged by the growth of extreme
    quantiles.
    """
    middle = float(law.ppf(0.5))
    lower, upper = (float(v) for v in law.support())
    for unbounded, quantile in ((math.isinf(lower), law.ppf), (math.isinf(upper), law.isf)):
        if unbounded:
            near = float(quantile(1e-150)) - middle
            far = float(quantile(1e-300)) - middle
            if not (math.isfinite(far) and abs(far) < 4.5 * abs(near)):
                return False
    return True


class Atoms:
    """Discrete distribution: ascending values (n,) with probabilities (n,)."""

    def __init__(self, values: Array, probabilities: Array) -> None:
        self.values = values
        self.probabilities = probabilities / probabilities.sum()
        self.cumulated = np.cumsum(self.probabilities)

    def pdf(self, x: Any) -> Array:
        raise NotImplementedError("a discrete distribution has no density")

    def cdf(self, x: Any) -> Array:
        """Up to the middle of the atom: what makes the normal score of an atom its median."""
        index = np.clip(np.searchsorted(self.values, x), 0, len(self.values) - 1)
        middle: Array = self.cumulated[index] - 0.5 * self.probabilities[index]
        return middle

    def sf(self, x: Any) -> Array:
        return 1.0 - self.cdf(x)

    def ppf(self, u: Any) -> Array:
        index = np.searchsorted(self.cumulated, u)
        found: Array = self.values[np.minimum(index, len(self.values) - 1)]
        return found

    def isf(self, u: Any) -> Array:
        return self.ppf(1.0 - np.asarray(u))

    def mean(self) -> float:
        return float(self.probabilities @ self.values)

    def std(self) -> float:
        return math.sqrt(float(self.probabilities @ (self.values - self.mean()) ** 2))

    def support(self) -> tuple[float, float]:
        return float(self.values[0]), float(self.values[-1])
