"""Random parameters and fields of a scene, and the space that they span.

What a user writes instead of a number in a law, and how it becomes polynomial chaos:

========================  ============================================  ================
:func:`Normal`            normal; can be negative                       Hermite, affine
:func:`TruncatedNormal`   normal, cut at bounds                         own, affine
:func:`LogNormal`         positive                                      Hermite, exact
:func:`Uniform`           between two bounds                            Legendre, affine
:func:`Gamma`             positive                                      Laguerre, affine
:func:`Beta`              between two bounds                            Jacobi, affine
:func:`FromSamples`       observed values, equally probable             own, affine
:func:`FromDistribution`  any law of scipy.stats or OpenTURNS           own or Hermite
:class:`Correlated`       several, joined by a Gaussian copula (Nataf)  Hermite
:class:`RandomField`      varies over an interface, Karhunen-Loeve      Hermite
========================  ============================================  ================

A *germ* is one independent random variable with its orthonormal polynomials.  *Affine* means that
the parameter is a linear function of its own germ: its chaos has two terms, and every Galerkin
matrix has its eigenvalues among the values that the parameter can take, so that a positive law
stays positive definite at every order.  The others have full coupling: a chaos of order p needs
their coefficients up to degree 2p, which :meth:`RandomSpace.expansion` provides.

Correlation lengths have the unit of the coordinates; a parameter has the unit of what it replaces.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from latin_core import stochastic as core
from latin_core.stochastic import ChaosBasis, Germ, IndexSet, MultiIndexSet, Rule
from scipy import linalg, optimize, special, stats
from scipy.sparse import linalg as sparse_linalg
from scipy.stats import qmc

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import record
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = [
    "Beta",
    "Chaos",
    "Correlated",
    "CorrelatedParameter",
    "DiscretisedField",
    "Expansion",
    "FromDistribution",
    "FromSamples",
    "Gamma",
    "LogNormal",
    "Normal",
    "RandomField",
    "RandomParameter",
    "RandomSpace",
    "Sobol",
    "TruncatedNormal",
    "Uniform",
    "exponential_1d_eigenvalues",
    "karhunen_loeve",
]


# ---------------------------------------------------------------------------------------------
# Laws of one variable, as scipy.stats spells them
# ---------------------------------------------------------------------------------------------
class _Law(Protocol):
    """What is used of a distribution; scipy's frozen continuous ones fit as they are."""

    def pdf(self, x: Any) -> Any: ...
    def cdf(self, x: Any) -> Any: ...
    def sf(self, x: Any) -> Any: ...
    def ppf(self, u: Any) -> Any: ...
    def isf(self, u: Any) -> Any: ...
    def mean(self) -> Any: ...
    def std(self) -> Any: ...
    def support(self) -> tuple[Any, Any]: ...


class _NewScipyLaw:
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


class _OpenTurnsLaw:
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


def _panels(law: _Law) -> tuple[Array, Array]:
    """Nodes and weights (n,) that integrate polynomials times the density of a continuous law.

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


def _moments_determine(law: _Law) -> bool:
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


def _mesh_of_normal() -> tuple[Array, Array]:
    """Trapezoidal rule under the standard normal density: exponentially accurate, any growth."""
    z = np.arange(-1024, 1025) / 64.0
    return z, np.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * 64.0)


# ---------------------------------------------------------------------------------------------
# Random parameters
# ---------------------------------------------------------------------------------------------
class RandomParameter:
    """One random number of a scene; made by the functions of this module, never changed.

    Two parameters with the same name and the same definition are the same random variable.

    Attributes
    ----------
    name
        Identifies the variable in a scene.
    mean, std
        Expectation and standard deviation of the parameter, its unit.
    germ
        The independent variable of its chaos.
    affine
        Whether the parameter is a linear function of its germ.
    """

    mean: float
    std: float
    germ: Germ
    affine: bool

    def __init__(
        self, kind: str, name: str, definition: tuple[Any, ...], shown: str, law: _Law
    ) -> None:
        if not isinstance(name, str) or not name:
            raise SceneError(f"{kind}: name = {name!r}; give a random parameter a name in words")
        self.name = name
        self._definition = (kind, name, definition)
        self._shown = f"{kind}({name!r}, {shown})"
        self._law = law

    @property
    def cov(self) -> float:
        """Coefficient of variation, std / |mean|; infinite if the mean is 0."""
        return self.std / abs(self.mean) if self.mean != 0.0 else math.inf

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and greatest value that the parameter can take."""
        lower, upper = self._law.support()
        return float(lower), float(upper)

    def value(self, germ: npt.ArrayLike) -> Array:
        """The parameter at values (N,) of its germ: (N,), exact."""
        raise NotImplementedError

    def to_germ(self, value: npt.ArrayLike) -> Array:
        """Values (N,) of the germ that belong to values (N,) of the parameter."""
        raise NotImplementedError

    def from_normal(self, score: npt.ArrayLike) -> Array:
        """The quantile of the parameter at the probability of a standard normal score (N,)."""
        z = np.asarray(score, dtype=np.float64)
        tail = special.ndtr(-np.abs(z))  # either tail by its own function: no cancellation
        result = np.empty_like(z)
        below = z <= 0.0
        result[below] = self._law.ppf(tail[below])
        result[~below] = self._law.isf(tail[~below])
        return result

    def to_normal(self, value: npt.ArrayLike) -> Array:
        """The standard normal score (N,) with the probability of a value (N,) of the parameter."""
        x = np.asarray(value, dtype=np.float64)
        below = np.asarray(self._law.cdf(x), dtype=np.float64)
        above = np.asarray(self._law.sf(x), dtype=np.float64)
        return np.where(below <= 0.5, special.ndtri(below), -special.ndtri(above))

    def germ_from_normal(self, score: npt.ArrayLike) -> Array:
        """Values (N,) of the germ at standard normal scores (N,): how samples are drawn."""
        return self.to_germ(self.from_normal(score))

    def coefficients(self, degree: int) -> Array:
        """(degree + 1,) chaos coefficients in the orthonormal polynomials of the germ."""
        raise NotImplementedError

    def hermite_coefficients(self, degree: int) -> Array:
        """(degree + 1,) chaos coefficients of the parameter as a function of its normal score."""
        z, weights = _mesh_of_normal()
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            values = self.from_normal(z)
        finite = np.isfinite(values)
        if not finite[np.abs(z) <= 8.0].all():
            raise SceneError(f"{self}: its quantiles are not finite; check the distribution")
        values = np.interp(z, z[finite], values[finite])
        psi = Germ.hermite().evaluate(z, degree)
        return cast(Array, psi.T @ (weights * values))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RandomParameter) and self._definition == other._definition

    def __hash__(self) -> int:
        return hash(self._definition)

    def __repr__(self) -> str:
        return self._shown


class _Affine(RandomParameter):
    """value = shift + scale * germ, where the germ has the parameter's own law."""

    affine = True

    def __init__(
        self,
        kind: str,
        name: str,
        definition: tuple[Any, ...],
        shown: str,
        *,
        germ: Germ,
        shift: float,
        scale: float,
        law: _Law,
    ) -> None:
        super().__init__(kind, name, definition, shown, law)
        alpha, beta = germ.recurrence(2)
        self.germ = germ
        self.mean = float(shift + scale * alpha[0])
        self.std = float(scale * beta[1])
        self._shift = shift
        self._scale = scale

    def value(self, germ: npt.ArrayLike) -> Array:
        return np.asarray(self._shift + self._scale * np.asarray(germ, dtype=np.float64))

    def to_germ(self, value: npt.ArrayLike) -> Array:
        return np.asarray((np.asarray(value, dtype=np.float64) - self._shift) / self._scale)

    def coefficients(self, degree: int) -> Array:
        return np.array([self.mean, self.std, *[0.0] * (degree - 1)])[: degree + 1]


class _Gaussian(RandomParameter):
    """A function of a standard normal germ, given by the quantiles of a law."""

    affine = False

    def __init__(
        self, kind: str, name: str, definition: tuple[Any, ...], shown: str, law: _Law
    ) -> None:
        super().__init__(kind, name, definition, shown, law)
        self.germ = Germ.hermite()
        self.mean = float(law.mean())
        self.std = float(law.std())

    def value(self, germ: npt.ArrayLike) -> Array:
        return self.from_normal(germ)

    def to_germ(self, value: npt.ArrayLike) -> Array:
        return self.to_normal(value)

    def germ_from_normal(self, score: npt.ArrayLike) -> Array:
        return np.asarray(score, dtype=np.float64)

    def coefficients(self, degree: int) -> Array:
        return self.hermite_coefficients(degree)


def _number(kind: str, name: str, what: str, value: Any, positive: bool = False) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(f"{kind} {name!r}: {what} = {value!r} is not a number") from error
    if not math.isfinite(number) or (positive and number <= 0.0):
        wanted = "a positive number" if positive else "a finite number"
        raise SceneError(f"{kind} {name!r}: {what} = {number:g}; it must be {wanted}")
    return number


_LEAST_COV = 1e-13
"""Coefficient of variation that is told from rounding."""
_TINY = 1e-150
"""Standard deviation whose square is a number."""


def _spread(kind: str, name: str, mean: float, cov: Any, std: Any) -> float:
    """Standard deviation from the one of the two that is given."""
    if (cov is None) == (std is None):
        raise SceneError(
            f"{kind} {name!r}: give either cov (std / |mean|) or std, not "
            + ("none" if cov is None else "both")
        )
    if std is not None:
        spread = _number(kind, name, "std", std, positive=True)
    elif mean == 0.0:
        raise SceneError(f"{kind} {name!r}: mean 0 has no coefficient of variation; give std")
    else:
        spread = abs(mean) * _number(kind, name, "cov", cov, positive=True)
    share = spread / abs(mean) if mean != 0.0 else 1.0
    if not _LEAST_COV < share < 1.0 / _LEAST_COV or not _TINY < spread < 1.0 / _TINY:
        raise SceneError(
            f"{kind} {name!r}: std = {spread:g} for a mean of {mean:g}: one of them is rounding of the "
            "other, or their squares leave the range of numbers; give a number instead, or other units"
        )
    return spread


def _bounds(kind: str, name: str, lower: Any, upper: Any) -> tuple[float, float]:
    lo, up = _number(kind, name, "lower", lower), _number(kind, name, "upper", upper)
    if not lo < up:
        raise SceneError(f"{kind} {name!r}: lower = {lo:g} must be less than upper = {up:g}")
    return lo, up


class _NormalParameter(_Affine):
    """Its own law is that of the germ, so quantiles are exact."""

    def from_normal(self, score: npt.ArrayLike) -> Array:
        return self.value(score)

    def to_normal(self, value: npt.ArrayLike) -> Array:
        return self.to_germ(value)


def Normal(name: str, mean: float, cov: Any = None, *, std: Any = None) -> RandomParameter:
    """Normal (Gaussian) parameter, mean (1 + cov xi) as in the paper's equation 13.

    It takes negative values: as a stiffness it is only usable at orders for which cov is below the
    critical one.

    Parameters
    ----------
    name
        Name of the random variable.
    mean
        Expectation.
    cov, std
        One of them: coefficient of variation > 0, or standard deviation > 0.

    Raises
    ------
    SceneError
        As all functions of this module, on a value that is no number or out of range.
    """
    m = _number("Normal", name, "mean", mean)
    s = _spread("Normal", name, m, cov, std)
    return _NormalParameter(
        "Normal",
        name,
        (m, s),
        f"mean={m:g}, std={s:g}",
        germ=Germ.hermite(),
        shift=m,
        scale=s,
        law=stats.norm(m, s),
    )


def TruncatedNormal(
    name: str,
    mean: float,
    cov: Any = None,
    lower: Any = None,
    upper: Any = None,
    *,
    std: Any = None,
    within: Any = None,
) -> RandomParameter:
    """Normal law that is cut at bounds and scaled back to the probability 1.

    ``mean``, ``cov`` and ``std`` are those of the normal law *before* the cut; the attributes
    ``mean`` and ``std`` of the result are those of the truncated variable itself.

    Parameters
    ----------
    name, mean, cov, std
        As for :func:`Normal`.
    lower, upper
        Bounds in the unit of the parameter; one of them may be None (no bound).
    within
        Instead of bounds: cut at mean +- within * std.
    """
    kind = "TruncatedNormal"
    m = _number(kind, name, "mean", mean)
    s = _spread(kind, name, m, cov, std)
    if (within is None) == (lower is None and upper is None):
        raise SceneError(f"{kind} {name!r}: give either lower and/or upper, or within (in std)")
    if within is not None:
        z_up = _number(kind, name, "within", within, positive=True)
        z_lo = -z_up
    else:
        z_lo = -math.inf if lower is None else (_number(kind, name, "lower", lower) - m) / s
        z_up = math.inf if upper is None else (_number(kind, name, "upper", upper) - m) / s
    if not z_lo < z_up:
        raise SceneError(f"{kind} {name!r}: lower = {lower:g} must be less than upper = {upper:g}")
    if min(z_up, -z_lo) < -8.0:
        raise SceneError(
            f"{kind} {name!r}: the bounds lie more than 8 std away from the mean on one side; "
            "that is a tail and not a truncated normal: give another law"
        )
    germ = Germ.from_measure(*_panels(stats.truncnorm(z_lo, z_up)))
    low, up = m + s * z_lo, m + s * z_up
    return _Affine(
        kind,
        name,
        (m, s, z_lo, z_up),
        f"mean={m:g}, std={s:g}, lower={low:g}, upper={up:g}",
        germ=germ,
        shift=m,
        scale=s,
        law=stats.truncnorm(z_lo, z_up, loc=m, scale=s),
    )


class _LogNormalParameter(_Gaussian):
    """exp(m + s xi)."""

    def __init__(self, name: str, mean: float, std: float) -> None:
        self._s = math.sqrt(math.log1p((std / mean) ** 2))
        self._m = math.log(mean) - 0.5 * self._s**2
        super().__init__(
            "LogNormal",
            name,
            (mean, std),
            f"mean={mean:g}, std={std:g}",
            stats.lognorm(self._s, scale=math.exp(self._m)),
        )
        self.mean, self.std = mean, std

    def from_normal(self, score: npt.ArrayLike) -> Array:
        return np.asarray(np.exp(self._m + self._s * np.asarray(score, dtype=np.float64)))

    def to_normal(self, value: npt.ArrayLike) -> Array:
        return np.asarray((np.log(np.asarray(value, dtype=np.float64)) - self._m) / self._s)

    def hermite_coefficients(self, degree: int) -> Array:
        k = np.arange(degree + 1)
        powers = k * math.log(self._s) - 0.5 * special.gammaln(k + 1.0)
        return np.asarray(self.mean * np.exp(powers))


def LogNormal(name: str, mean: float, cov: Any = None, *, std: Any = None) -> RandomParameter:
    """Lognormal parameter: the logarithm is normal.  Positive, chaos exact at any degree.

    ``mean`` > 0, ``cov`` and ``std`` are those of the parameter, not of its logarithm.
    """
    m = _number("LogNormal", name, "mean", mean, positive=True)
    return _LogNormalParameter(name, m, _spread("LogNormal", name, m, cov, std))


def Uniform(
    name: str,
    lower: Any = None,
    upper: Any = None,
    *,
    mean: Any = None,
    cov: Any = None,
    std: Any = None,
) -> RandomParameter:
    """Uniform parameter, by ``lower`` and ``upper``, or by ``mean`` and ``cov`` (or ``std``)."""
    kind = "Uniform"
    if (lower is None) != (upper is None) or (lower is None) == (mean is None):
        raise SceneError(f"{kind} {name!r}: give lower and upper, or mean and cov (or std)")
    if mean is None:
        if cov is not None or std is not None:
            raise SceneError(f"{kind} {name!r}: lower and upper already say the std")
        lo, up = _bounds(kind, name, lower, upper)
    else:
        m = _number(kind, name, "mean", mean)
        reach = math.sqrt(3.0) * _spread(kind, name, m, cov, std)
        lo, up = m - reach, m + reach
    return _Affine(
        kind,
        name,
        (lo, up),
        f"lower={lo:g}, upper={up:g}",
        germ=Germ.legendre(),
        shift=0.5 * (lo + up),
        scale=0.5 * (up - lo),
        law=stats.uniform(lo, up - lo),
    )


def Gamma(name: str, mean: float, cov: Any = None, *, std: Any = None) -> RandomParameter:
    """Gamma parameter on (0, inf) with ``mean`` > 0 and ``cov`` or ``std``; shape = 1 / cov^2."""
    m = _number("Gamma", name, "mean", mean, positive=True)
    s = _spread("Gamma", name, m, cov, std)
    shape, scale = (m / s) ** 2, s * s / m
    return _Affine(
        "Gamma",
        name,
        (m, s),
        f"mean={m:g}, std={s:g}",
        germ=Germ.laguerre(shape),
        shift=0.0,
        scale=scale,
        law=stats.gamma(shape, scale=scale),
    )


def Beta(
    name: str, a: float, b: float, lower: float = 0.0, upper: float = 1.0
) -> RandomParameter:
    """Beta parameter, ``a``, ``b`` > 0: density ~ (x - lower)^(a-1) (upper - x)^(b-1)."""
    first = _number("Beta", name, "a", a, positive=True)
    second = _number("Beta", name, "b", b, positive=True)
    lo, up = _bounds("Beta", name, lower, upper)
    return _Affine(
        "Beta",
        name,
        (first, second, lo, up),
        f"a={first:g}, b={second:g}, lower={lo:g}, upper={up:g}",
        germ=Germ.jacobi(first, second),
        shift=0.5 * (lo + up),
        scale=0.5 * (up - lo),
        law=stats.beta(first, second, loc=lo, scale=up - lo),
    )


class _Atoms:
    """Discrete law: ascending values (n,) with probabilities (n,)."""

    def __init__(self, values: Array, probabilities: Array) -> None:
        self.values = values
        self.probabilities = probabilities / probabilities.sum()
        self.cumulated = np.cumsum(self.probabilities)

    def pdf(self, x: Any) -> Array:
        raise NotImplementedError("a discrete law has no density")

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


class _Discrete(_Affine):
    """Takes finitely many values; its germ is the standardised value."""

    _law: _Atoms

    def __init__(
        self,
        kind: str,
        name: str,
        definition: tuple[Any, ...],
        values: Array,
        probabilities: Array,
    ) -> None:
        atoms, where = np.unique(np.asarray(values, dtype=np.float64), return_inverse=True)
        masses = np.bincount(where.ravel(), weights=probabilities)
        law = _Atoms(atoms, masses.astype(np.float64))
        mean, std = law.mean(), law.std()
        # a lone value repeated has a rounding error for its std
        if len(atoms) < 2 or not std > 1e-14 * np.abs(atoms).max():
            raise SceneError(
                f"{kind} {name!r}: all {len(values)} values equal {mean:g}; a random parameter "
                "needs two different ones at least"
            )
        germ = Germ.from_measure((atoms - mean) / std, law.probabilities)
        shown = f"{len(atoms)} values, mean={mean:g}, std={std:g}"
        super().__init__(
            kind, name, definition, shown, germ=germ, shift=mean, scale=std, law=law
        )

    def hermite_coefficients(self, degree: int) -> Array:
        """Exact: psi_k phi integrated over a step is a difference of psi_{k-1} phi / sqrt(k)."""
        edges = special.ndtri(self._law.cumulated[:-1])
        density = np.exp(-0.5 * edges**2) / math.sqrt(2.0 * math.pi)
        psi = Germ.hermite().evaluate(edges, max(degree - 1, 0))
        steps = np.diff(self._law.values) * density
        result = np.empty(degree + 1)
        result[0] = self.mean
        for k in range(1, degree + 1):
            result[k] = steps @ psi[:, k - 1] / math.sqrt(k)
        return result


def FromSamples(name: str, samples: npt.ArrayLike) -> RandomParameter:
    """The empirical law of observed values (N,), each with probability 1 / N.

    Its polynomials are those of the samples; with n different values there are n of them.
    """
    try:
        values = np.asarray(samples, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SceneError(f"FromSamples {name!r}: the samples are not numbers") from error
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise SceneError(
            f"FromSamples {name!r}: give a list of finite numbers; got an array of shape "
            f"{values.shape}"
        )
    return _Discrete(
        "FromSamples", name, (values.tobytes(),), values, np.full(values.size, 1.0 / values.size)
    )


def FromDistribution(
    name: str, distribution: Any, germ: Literal["auto", "own", "normal"] = "auto"
) -> RandomParameter:
    """Any law of one variable, continuous or discrete.

    Parameters
    ----------
    name
        Name of the random variable.
    distribution
        A frozen ``scipy.stats`` distribution, a scipy >= 1.15 random variable, or an OpenTURNS
        ``Distribution`` of dimension 1.
    germ
        ``"own"``: polynomials of the law itself, by Lanczos; the parameter is affine.
        ``"normal"``: a function of a standard normal germ.  ``"auto"`` takes the own ones where
        they are complete, i.e. unless a tail is heavier than exp(-sqrt(x)) (a lognormal law is such
        a case).
    """
    kind = "FromDistribution"
    if germ not in ("auto", "own", "normal"):
        raise unknown_name("germ", str(germ), ("auto", "own", "normal"), f"{kind} {name!r}")
    definition: tuple[Any, ...]
    law: _Law
    if hasattr(distribution, "computeQuantile") and hasattr(distribution, "getDimension"):
        if distribution.getDimension() != 1:
            raise SceneError(
                f"{kind} {name!r}: the distribution has {distribution.getDimension()} variables; "
                "give one of dimension 1 (Correlated joins several)"
            )
        definition = (repr(distribution),)
        if distribution.isDiscrete():
            values = np.array(distribution.getSupport())[:, 0]
            masses = np.array(distribution.getProbabilities())
            return _Discrete(kind, name, definition, values, masses)
        law = _OpenTurnsLaw(distribution)
    elif hasattr(distribution, "dist") and hasattr(distribution, "ppf"):
        definition = (
            type(distribution.dist),
            distribution.args,
            tuple(sorted(distribution.kwds.items())),
        )
        if hasattr(distribution, "pmf"):
            atoms = np.arange(distribution.ppf(1e-16), distribution.isf(1e-16) + 1.0)
            return _Discrete(kind, name, definition, atoms, distribution.pmf(atoms))
        law = distribution
    elif hasattr(distribution, "icdf") and hasattr(distribution, "iccdf"):
        definition = (repr(distribution),)
        law = _NewScipyLaw(distribution)
    else:
        raise SceneError(
            f"{kind} {name!r}: unknown distribution {distribution!r} of type "
            f"{type(distribution).__name__}; give a frozen scipy.stats distribution, e.g. "
            "scipy.stats.weibull_min(2.0, scale=100.0), or an OpenTURNS Distribution"
        )
    mean, std = float(law.mean()), float(law.std())
    if not (math.isfinite(mean) and math.isfinite(std) and std > 0.0):
        raise SceneError(
            f"{kind} {name!r}: mean {mean:g} and std {std:g}; a chaos needs a law with a finite "
            "variance > 0"
        )
    definition = (*definition, germ)
    shown = f"mean={mean:g}, std={std:g}"
    if germ == "own" or (germ == "auto" and _moments_determine(law)):
        nodes, weights = _panels(law)
        own = Germ.from_measure((nodes - mean) / std, weights)
        return _Affine(kind, name, definition, shown, germ=own, shift=mean, scale=std, law=law)
    return _Gaussian(kind, name, definition, shown, law)


# ---------------------------------------------------------------------------------------------
# Correlated parameters
# ---------------------------------------------------------------------------------------------
class CorrelatedParameter(RandomParameter):
    """One parameter of a :class:`Correlated` group: its own law, germs of the group."""

    def __init__(self, group: Correlated, position: int) -> None:
        self.marginal = group.marginals[position]
        super().__init__(
            "CorrelatedParameter",
            self.marginal.name,
            (group._definition, position),
            "",
            self.marginal._law,
        )
        self._shown = f"<{self.marginal!r} correlated with {len(group.marginals) - 1} others>"
        self.group = group
        self.position = position
        self.mean, self.std = self.marginal.mean, self.marginal.std
        self.germ = Germ.hermite()
        self.affine = False

    def value(self, germ: npt.ArrayLike) -> Array:
        """The parameter at its normal scores (N,), which are combinations of the germs."""
        return self.marginal.from_normal(germ)

    def to_germ(self, value: npt.ArrayLike) -> Array:
        return self.marginal.to_normal(value)

    def from_normal(self, score: npt.ArrayLike) -> Array:
        return self.marginal.from_normal(score)

    def to_normal(self, value: npt.ArrayLike) -> Array:
        return self.marginal.to_normal(value)

    def coefficients(self, degree: int) -> Array:
        return self.marginal.hermite_coefficients(degree)

    def hermite_coefficients(self, degree: int) -> Array:
        return self.marginal.hermite_coefficients(degree)


class Correlated(Sequence[CorrelatedParameter]):
    """Random parameters with a Gaussian copula (Nataf's model).

    Used as ``k, K = Correlated([Normal("k", ...), LogNormal("K", ...)], matrix)``: the members go
    into laws like any other parameter.

    Parameters
    ----------
    parameters
        Independent parameters, with different names; their laws are kept.
    matrix
        (n, n) correlation matrix: symmetric, positive definite, diagonal 1.
    space
        ``"physical"``: `matrix` holds the correlation coefficients of the parameters themselves,
        from which those of the normal scores are solved for.  ``"normal"``: `matrix` is that of the
        normal scores.

    Attributes
    ----------
    marginals
        The parameters as they were given.
    normal_correlation
        (n, n) correlation matrix of the normal scores.

    Raises
    ------
    SceneError
        The matrix has the wrong shape, is not symmetric or not positive definite (with its smallest
        eigenvalue), or a correlation is out of reach of the two laws (with the range).
    """

    def __init__(
        self,
        parameters: Sequence[RandomParameter],
        matrix: npt.ArrayLike,
        space: Literal["physical", "normal"] = "physical",
    ) -> None:
        self.marginals = tuple(parameters)
        names = [getattr(p, "name", repr(p)) for p in self.marginals]
        where = f"Correlated [{', '.join(names)}]"
        for parameter in self.marginals:
            if not isinstance(parameter, RandomParameter) or isinstance(
                parameter, CorrelatedParameter
            ):
                raise SceneError(f"{where}: {parameter!r} is not an independent random parameter")
        if len(set(names)) < len(names) or not names:
            raise SceneError(f"{where}: give one parameter or more, all with different names")
        if space not in ("physical", "normal"):
            raise unknown_name("space", str(space), ("physical", "normal"), where)
        given = np.array(matrix, dtype=np.float64)
        n = len(names)
        if given.shape != (n, n):
            raise SceneError(f"{where}: the matrix has shape {given.shape}; wanted ({n}, {n})")
        if not (np.isfinite(given).all() and np.allclose(given, given.T, rtol=0.0, atol=1e-12)):
            raise SceneError(f"{where}: the correlation matrix is not symmetric and finite")
        if not np.allclose(np.diag(given), 1.0, rtol=0.0, atol=1e-12):
            raise SceneError(
                f"{where}: the diagonal of the correlation matrix is {np.diag(given)}; it must be 1"
            )
        self._check_definite(where, "the correlation matrix", given)
        normal = given
        if space == "physical":
            normal = np.eye(n)
            hermite = [p.hermite_coefficients(40) for p in self.marginals]
            for i in range(n):
                for j in range(i):
                    normal[i, j] = normal[j, i] = self._score_correlation(
                        where, i, j, given[i, j], hermite[i], hermite[j]
                    )
            self._check_definite(where, "the correlation matrix of the normal scores", normal)
        self.normal_correlation = normal
        self._definition = (
            tuple(p._definition for p in self.marginals),
            given.tobytes(),
            space,
        )
        self._members = tuple(CorrelatedParameter(self, i) for i in range(n))

    @staticmethod
    def _check_definite(where: str, what: str, matrix: Array) -> None:
        smallest = float(linalg.eigvalsh(matrix)[0])
        if smallest <= 1e-12:
            raise SceneError(
                f"{where}: {what} is not positive definite: its smallest eigenvalue is "
                f"{smallest:.6g}; lower the correlations"
            )

    def _score_correlation(
        self, where: str, i: int, j: int, target: float, a: Array, b: Array
    ) -> float:
        """Correlation of two normal scores for a given one of the parameters (Mehler's series)."""
        if target == 0.0:
            return 0.0
        first, second = self.marginals[i], self.marginals[j]
        series = a * b / (first.std * second.std)
        series[0] = 0.0
        normal_pair = np.abs(series[2:]).max() < 1e-12 and abs(series[1] - 1.0) < 1e-12
        if normal_pair:
            return target
        polynomial = np.polynomial.Polynomial(series)
        lowest, highest = float(polynomial(-1.0)), float(polynomial(1.0))
        if not lowest < target < highest:
            raise SceneError(
                f"{where}: {first.name!r} and {second.name!r} cannot have the correlation "
                f"{target:g}; with their laws it lies between {lowest:.4g} and {highest:.4g}"
            )
        found = optimize.brentq(lambda r: float(polynomial(r)) - target, -1.0, 1.0, xtol=1e-15)
        return float(found)

    def __len__(self) -> int:
        return len(self._members)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            for member in self._members:
                if member.name == key:
                    return member
            raise unknown_name("parameter", key, [m.name for m in self._members], "Correlated")
        return self._members[key]

    def __iter__(self) -> Iterator[CorrelatedParameter]:
        return iter(self._members)

    def __repr__(self) -> str:
        return f"Correlated({list(self.marginals)!r})"


# ---------------------------------------------------------------------------------------------
# Random fields
# ---------------------------------------------------------------------------------------------
Correlation: TypeAlias = Callable[[Array], Array]
"""Correlation at a distance >= 0 that is divided by the correlation length; any shape; 1 at 0."""


def _matern(nu: float) -> Correlation:
    def correlation(r: Array) -> Array:
        s = math.sqrt(2.0 * nu) * np.maximum(r, 1e-12)
        with np.errstate(under="ignore"):
            value = np.exp(
                (1.0 - nu) * math.log(2.0) - special.gammaln(nu) + nu * np.log(s) - s
            ) * special.kve(nu, s)
        return np.where(r <= 1e-12, 1.0, value)

    return correlation


def _correlation(where: str, covariance: Any, nu: float | None) -> tuple[Correlation, bool]:
    """The function, and whether it has a kink at distance 0."""
    if callable(covariance):
        return covariance, True
    if (nu is None) == (covariance == "matern"):
        raise SceneError(
            f"{where}: nu = {nu} with covariance {covariance!r}; 'matern' needs its smoothness "
            "nu > 0, the others have none"
        )
    if covariance == "exponential":
        return (lambda r: np.exp(-r)), True
    if covariance == "gaussian":
        return (lambda r: np.exp(-0.5 * r * r)), False
    if covariance == "matern" and nu is not None:
        return _matern(_number("RandomField", where, "nu", nu, positive=True)), nu < 1.0
    raise unknown_name(
        "covariance", str(covariance), ("exponential", "gaussian", "matern"), where
    )


class _Modes(NamedTuple):
    """Karhunen-Loeve modes of a field of variance 1."""

    eigenvalues: Array  # (r,), descending
    functions: Array  # (m, r), sum_i weight_i f_a(i) f_b(i) = delta_ab
    captured: float  # part of the integrated variance in these modes


def karhunen_loeve(
    points: npt.ArrayLike,
    weights: npt.ArrayLike,
    correlation: Correlation,
    *,
    variance_captured: float | None = None,
    modes: int | None = None,
    kink: bool = True,
    cell_dimension: int | None = None,
) -> _Modes:
    """Eigenpairs of int rho(|x - y|) f(y) dy = lambda f(x) by Nystroem's method on given points.

    The symmetric matrix W^1/2 C W^1/2 is dense up to 1 500 points; beyond, Lanczos with products of
    C (stored up to 1 GB, otherwise recomputed in blocks of rows).

    Parameters
    ----------
    points, weights
        (m, d) and (m,) > 0: quadrature of the interface.
    correlation
        Function of the distance of `points`, which are already divided by the correlation length.
    variance_captured, modes
        One of them: take modes until this part of the variance is reached, or this number.
    kink
        The correlation has a kink at distance 0 (exponential).  Then the diagonal holds an average
        over a piece of the cell of a point, which takes away the leading error: for a lattice of
        points and a distance |x - y| it is the regularised lattice sum of the distance, -1/6 in one
        dimension and -0.228824 in two (B. Wu, P.-G. Martinsson, Adv. Comput. Math. 47 (2021) 45).
    cell_dimension
        1 if weights are lengths, 2 if they are areas; default: d - 1, at least 1.

    Returns
    -------
    eigenvalues (r,), functions (m, r) orthonormal under the weights, captured part of the variance.
    """
    x = np.asarray(points, dtype=np.float64)
    w = np.asarray(weights, dtype=np.float64)
    m = len(w)
    root = np.sqrt(w)
    dimension = max(1, x.shape[1] - 1) if cell_dimension is None else cell_dimension
    diagonal: Array = np.ones(m)
    if kink:
        nodes, gauss = np.polynomial.legendre.leggauss(12)
        t = 0.5 * (nodes + 1.0)
        # the mean distance in the piece is radius / 2 on a line, 2 radius / 3 in a disc
        radius = w / 3.0 if dimension == 1 else 1.5 * 0.228824 * np.sqrt(w)
        density = 0.5 * gauss * dimension * t ** (dimension - 1)
        diagonal = correlation(radius[:, None] * t) @ density

    def rows(start: int, stop: int) -> Array:
        square = np.zeros((stop - start, m))
        for axis in range(x.shape[1]):
            square += (x[start:stop, axis, None] - x[None, :, axis]) ** 2
        block = correlation(np.sqrt(square))
        block[np.arange(stop - start), np.arange(start, stop)] = diagonal[start:stop]
        scaled: Array = root[start:stop, None] * block * root
        return scaled

    total = float(w.sum())
    wanted = m if modes is None else min(modes, m)
    if m <= 1500:
        values, vectors = linalg.eigh(rows(0, m))
        values, vectors = values[::-1].copy(), vectors[:, ::-1]
    else:
        values, vectors = _lanczos(rows, m, total, variance_captured, wanted if modes else None)
    usable = int(np.count_nonzero(values > 1e-14 * values[0]))
    if modes is None:
        reached = np.cumsum(values[:usable]) / total
        goal = 1.0 if variance_captured is None else variance_captured
        wanted = int(np.searchsorted(reached, goal * (1.0 - 1e-12))) + 1
    wanted = min(wanted, usable)
    functions = vectors[:, :wanted] / root[:, None]
    # eigenvectors have no sign: make the integral positive, or the greatest value
    integral = w @ functions
    # the first of the points that share the greatest value, in spite of rounding
    summit = np.argmax(np.abs(functions) > 0.999 * np.abs(functions).max(axis=0), axis=0)
    extreme = functions[summit, np.arange(wanted)]
    clear = np.abs(integral) > 1e-6 * math.sqrt(total)
    functions = functions * np.where(np.where(clear, integral, extreme) < 0.0, -1.0, 1.0)
    kept = values[:wanted]
    return _Modes(kept, functions, min(float(kept.sum()) / total, 1.0))


def _lanczos(
    rows: Callable[[int, int], Array],
    m: int,
    total: float,
    captured: float | None,
    modes: int | None,
) -> tuple[Array, Array]:
    """Leading eigenpairs, descending; as many as the variance asks for."""
    step = max(1, int(2e7) // m)
    starts = range(0, m, step)
    stored = [rows(s, min(s + step, m)) for s in starts] if 8.0 * m * m <= 1e9 else None

    def multiply(vector: Array) -> Array:
        v = vector.ravel()
        if stored is not None:
            return np.concatenate([block @ v for block in stored])
        return np.concatenate([rows(s, min(s + step, m)) @ v for s in starts])

    operator = sparse_linalg.LinearOperator((m, m), matvec=multiply, dtype=np.float64)
    count = modes if modes is not None else 20
    start = np.random.default_rng(0).standard_normal(m)
    while True:
        count = min(count, m - 1)
        values, vectors = sparse_linalg.eigsh(operator, k=count, which="LA", v0=start)
        order = np.argsort(values)[::-1]
        values, vectors = values[order], vectors[:, order]
        enough = captured is None or values.sum() >= captured * total
        if modes is not None or enough or count == m - 1:
            return values, vectors
        count *= 2


def exponential_1d_eigenvalues(length: float, size: float, count: int) -> Array:
    """Eigenvalues (count,) of exp(-|x - y| / length) on an interval of this size, descending.

    lambda = 2 c / (w^2 + c^2), c = 1 / length, where w solves c = w tan(w a) and w = -c tan(w a)
    in turn, a = size / 2 (R. Ghanem, P. Spanos, Stochastic Finite Elements, Springer 1991, 2.3.3).
    """
    c, a = 1.0 / length, 0.5 * size

    def even(w: float) -> float:
        return c * math.cos(w * a) - w * math.sin(w * a)

    def odd(w: float) -> float:
        return w * math.cos(w * a) + c * math.sin(w * a)

    eigenvalues = []
    for k in range(count):
        low, high = 0.5 * math.pi * k / a, 0.5 * math.pi * (k + 1) / a
        w = optimize.brentq(odd if k % 2 else even, low, high, xtol=1e-15 / a, rtol=1e-15)
        eigenvalues.append(2.0 * c / (w * w + c * c))
    return np.array(eigenvalues)


@dataclass(frozen=True, repr=False)
class RandomField:
    """A parameter that varies at random over an interface.

    Parameters
    ----------
    name
        Names the field; its germs are ``name[0]``, ``name[1]``, ...
    mean
        Expectation, the same everywhere.
    cov, std
        One of them: coefficient of variation or standard deviation, the same everywhere (before the
        truncation of the modes).
    covariance
        ``"exponential"``: exp(-r); ``"gaussian"``: exp(-r^2 / 2); ``"matern"`` with smoothness `nu`
        (1/2 is the exponential, infinity the Gaussian one); or a function of an array r.
        r = distance / length.
    length
        Correlation length, or one for each axis.
    nu
        Smoothness of the Matern covariance.
    variance_captured, modes
        One of them: part of the variance, in (0, 1], that the Karhunen-Loeve modes must hold, or
        their number.
    distribution
        ``"normal"``, or ``"lognormal"``: exponential of a normal field that has this covariance
        function.  Its mean is exact at every point in spite of the truncation.
    """

    name: str
    mean: float
    cov: float | None = None
    std: float | None = None
    covariance: str | Correlation = "exponential"
    length: float | tuple[float, ...] = 1.0
    nu: float | None = None
    variance_captured: float | None = None
    modes: int | None = None
    distribution: Literal["normal", "lognormal"] = "normal"

    def __repr__(self) -> str:
        return record(self)

    def __post_init__(self) -> None:
        where = f"RandomField {self.name!r}"
        if not isinstance(self.name, str) or not self.name:
            raise SceneError(f"RandomField: name = {self.name!r}; give a random field a name")
        if self.distribution not in ("normal", "lognormal"):
            raise unknown_name(
                "distribution", str(self.distribution), ("normal", "lognormal"), where
            )
        positive = self.distribution == "lognormal"
        mean = _number("RandomField", self.name, "mean", self.mean, positive)
        _spread("RandomField", self.name, mean, self.cov, self.std)
        for value in np.atleast_1d(np.asarray(self.length, dtype=object)):
            _number("RandomField", self.name, "length", value, positive=True)
        if not np.isscalar(self.length):
            object.__setattr__(self, "length", tuple(np.asarray(self.length).tolist()))
        _correlation(where, self.covariance, self.nu)
        if self.variance_captured is None and self.modes is None:
            object.__setattr__(self, "variance_captured", 0.95)
        elif self.variance_captured is not None and self.modes is not None:
            raise SceneError(f"{where}: give variance_captured or modes, not both")
        if self.variance_captured is not None and not 0.0 < self.variance_captured <= 1.0:
            raise SceneError(
                f"{where}: variance_captured = {self.variance_captured:g} must be in (0, 1]"
            )
        if self.modes is not None and (not isinstance(self.modes, int) or self.modes < 1):
            raise SceneError(f"{where}: modes = {self.modes!r} must be a whole number >= 1")

    @property
    def deviation(self) -> float:
        """Standard deviation."""
        return _spread("RandomField", self.name, self.mean, self.cov, self.std)

    def on(self, points: npt.ArrayLike, weights: npt.ArrayLike) -> DiscretisedField:
        """The field on interface points (m, d) with weights (m,) > 0.

        A field that lives on several interfaces is discretised once, on all their points together.

        Raises
        ------
        SceneError
            Shapes that do not fit, a weight that is not positive, the wrong number of lengths, or
            more variance is asked for than the points resolve.
        """
        where = f"RandomField {self.name!r}"
        x = np.asarray(points, dtype=np.float64)
        w = np.asarray(weights, dtype=np.float64)
        if x.ndim != 2 or w.shape != (len(x),) or len(x) == 0:
            raise SceneError(
                f"{where}: points of shape {x.shape} and weights of shape {w.shape}; wanted (m, d) "
                "and (m,), m > 0"
            )
        if not (np.isfinite(x).all() and np.isfinite(w).all() and (w > 0.0).all()):
            raise SceneError(f"{where}: points must be finite and weights positive")
        lengths = np.asarray(self.length, dtype=np.float64)
        if lengths.ndim and lengths.shape != (x.shape[1],):
            raise SceneError(
                f"{where}: {lengths.size} lengths for points with {x.shape[1]} coordinates"
            )
        correlation, kink = _correlation(where, self.covariance, self.nu)
        # cells in the scaled coordinates; with one length per axis their size is only estimated
        cell_dimension = max(1, x.shape[1] - 1)
        typical = math.exp(float(np.log(lengths).mean()))
        scale = typical**cell_dimension
        eigenvalues, functions, captured = karhunen_loeve(
            x / lengths,
            w / scale,
            correlation,
            variance_captured=self.variance_captured,
            modes=self.modes,
            kink=kink,
        )
        if self.variance_captured is not None and captured < self.variance_captured * (1.0 - 1e-9):
            raise SceneError(
                f"{where}: {len(x)} points resolve only {100.0 * captured:.4g} % of its variance, "
                f"{100.0 * self.variance_captured:.4g} % is asked for; lower variance_captured, "
                "or refine the mesh"
            )
        return DiscretisedField(
            self, eigenvalues * scale, np.asarray(functions / math.sqrt(scale)), captured, x, w
        )


@dataclass(frozen=True, eq=False, repr=False)
class DiscretisedField:
    """A random field on the points of an interface: standard normal germs, one a mode.

    Attributes
    ----------
    field
        What was asked for.
    eigenvalues
        (r,) of the correlation function, descending; their sum over all modes is the area.
    functions
        (m, r) modes at the points, orthonormal under the weights.
    captured
        Part of the variance in the modes.
    points, weights
        (m, d), (m,).
    """

    field: RandomField
    eigenvalues: Array
    functions: Array
    captured: float
    points: Array
    weights: Array

    def __repr__(self) -> str:
        return (
            f"DiscretisedField({self.name!r}, {len(self.eigenvalues)} modes at {len(self.points)} points, "
            f"{self.captured:.4g} of the variance)"
        )

    @property
    def name(self) -> str:
        """Name of the field."""
        return self.field.name

    @property
    def mean(self) -> float:
        """Expectation."""
        return self.field.mean

    @cached_property
    def shapes(self) -> Array:
        """(m, r) sqrt(eigenvalue) * function: the standardised field is shapes @ germs."""
        scaled: Array = self.functions * np.sqrt(self.eigenvalues)
        return scaled

    @property
    def affine(self) -> bool:
        """Whether the field is a linear function of its germs."""
        return self.field.distribution == "normal"

    @cached_property
    def _log_shapes(self) -> Array:
        log_std = math.sqrt(math.log1p((self.field.deviation / self.field.mean) ** 2))
        scaled: Array = log_std * self.shapes
        return scaled

    def value(self, germs: npt.ArrayLike) -> Array:
        """The field at germ points (N, r): (m, N)."""
        xi = np.asarray(germs, dtype=np.float64)
        if self.affine:
            affine: Array = self.mean + self.field.deviation * (self.shapes @ xi.T)
            return affine
        shapes = self._log_shapes
        variance = np.sum(shapes**2, axis=1)
        positive: Array = self.mean * np.exp(shapes @ xi.T - 0.5 * variance[:, None])
        return positive

    def coefficients(self, table: npt.NDArray[np.int32]) -> Array:
        """(m, n) chaos coefficients on multi-indices (n, r) of the germs."""
        degrees = table.sum(axis=1)
        result = np.zeros((len(self.points), len(table)))
        if self.affine:
            result[:, degrees == 0] = self.mean
            single = np.flatnonzero(degrees == 1)
            result[:, single] = self.field.deviation * self.shapes[:, table[single].argmax(axis=1)]
            return result
        result[:] = self.mean
        for mode in range(table.shape[1]):
            top = int(table[:, mode].max(initial=0))
            powers = np.ones((len(self.points), top + 1))
            for k in range(1, top + 1):
                powers[:, k] = powers[:, k - 1] * self._log_shapes[:, mode] / math.sqrt(k)
            result *= powers[:, table[:, mode]]
        return result


# ---------------------------------------------------------------------------------------------
# The space
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True, repr=False)
class Chaos:
    """What chaos is wanted.

    Parameters
    ----------
    order
        p >= 0.
    index_set
        ``"total"``: total degree <= p; ``"tensor"``: degree <= p in each germ; ``"hyperbolic"``:
        q-norm of the degrees <= p, which thins out interactions.
    q
        Of the hyperbolic set, in (0, 1].
    weights
        Anisotropy: a positive number a germ, or by name of the parameters (1 for the others);
        degree i of a germ counts as weight * i.
    max_interaction
        Greatest number of germs in one mode; None: no limit.
    quadrature
        Points in each germ (by name of the parameter, or one number for all) of the tensor Gauss rule at
        which laws that are not linear are evaluated. None: 2 (p + 1), and 16 at least in one or two germs,
        if that gives few enough points (:data:`dolfinx_frontend.solvers.collocation.MOST_TENSOR`),
        Sobol points otherwise.
    sobol_points
        Use so many scrambled Sobol points instead, a power of two.
    check_points
        Deterministic solves with which the truncation of a scene that is not linear is checked; 0: none.
    tolerance
        Relative error of mean and standard deviation of an interface force up to which such an answer is
        trusted.
    indices
        Multi-indices (one degree a germ, the zero index among them) of a set of your own, within `order`;
        `index_set`, `q`, `weights` and `max_interaction` do not apply. ``solve(accuracy=...)`` makes
        such sets.
    """

    order: int
    index_set: IndexSet = "total"
    q: float = 0.75
    weights: Sequence[float] | Mapping[str, float] | None = None
    max_interaction: int | None = None
    quadrature: int | Mapping[str, int] | None = None
    sobol_points: int | None = None
    check_points: int = 32
    tolerance: float = 0.01
    indices: tuple[tuple[int, ...], ...] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return record(self)

    def __post_init__(self) -> None:
        if isinstance(self.order, bool) or not isinstance(self.order, (int, np.integer)):
            raise SceneError(f"Chaos: order = {self.order!r} is not a whole number")
        if self.order < 0:
            raise SceneError(f"Chaos: order = {self.order} must be >= 0")
        if self.index_set not in ("total", "tensor", "hyperbolic"):
            raise unknown_name(
                "index set", str(self.index_set), ("total", "tensor", "hyperbolic"), "Chaos"
            )
        _number("Chaos", "q", "q", self.q, positive=True)
        if self.q > 1.0:
            raise SceneError(f"Chaos: q = {self.q:g} must be in (0, 1]")
        most = self.max_interaction
        if most is not None and (not _whole(most) or most < 1):
            raise SceneError(f"Chaos: max_interaction = {most!r} must be a whole number >= 1")
        self._check_points()
        if self.weights is not None:
            named = isinstance(self.weights, Mapping)
            if not named and not isinstance(self.weights, (Sequence, np.ndarray)):
                raise SceneError(f"Chaos: weights = {self.weights!r}: give one a germ, or by name")
            values = self.weights.values() if isinstance(self.weights, Mapping) else self.weights
            for value in values:
                _number("Chaos", "weights", "weight", value, positive=True)
            if not named:
                object.__setattr__(self, "weights", tuple(self.weights))

    def _check_points(self) -> None:
        _number("Chaos", "tolerance", "tolerance", self.tolerance, positive=True)
        wanted = self.quadrature
        for count in wanted.values() if isinstance(wanted, Mapping) else (wanted,):
            if count is not None and (not _whole(count) or count < 1):
                raise SceneError(
                    f"Chaos: quadrature = {wanted!r}: give a whole number of points >= 1 in each germ"
                )
        sobol = self.sobol_points
        if sobol is not None and (not _whole(sobol) or sobol < 1 or sobol & (sobol - 1)):
            raise SceneError(f"Chaos: sobol_points = {sobol!r} must be a power of two")
        if sobol is not None and wanted is not None:
            raise SceneError("Chaos: quadrature and sobol_points are two rules: give one")
        if not _whole(self.check_points) or self.check_points < 0 or self.check_points == 1:
            raise SceneError(
                f"Chaos: check_points = {self.check_points!r}: give 0 (no check) or a number >= 2"
            )


def _whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


class Expansion(NamedTuple):
    """A random quantity in its own chaos."""

    coefficients: Array  # (rows, n): one row, or one an interface point
    indices: MultiIndexSet  # n multi-indices in the germs of the space


class Sobol(NamedTuple):
    """Sobol indices of a random source; NaN in rows without variance."""

    first: Array  # (rows,) variance due to it alone
    total: Array  # (rows,) variance in which it takes part


@dataclass(frozen=True)
class _Block:
    """Germs that belong together: an independent parameter, a correlated group, or a field."""

    name: str
    columns: tuple[int, ...]
    members: tuple[RandomParameter, ...]
    field: DiscretisedField | None
    mixing: Array  # (members, germs) lower triangular: normal scores = mixing @ germs


Source: TypeAlias = RandomParameter | DiscretisedField


def _machine_memory() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError):  # not known here: no limit
        return 0.0


class RandomSpace:
    """All randomness of a scene: germs in the order in which their parameters are first seen.

    Parameters
    ----------
    sources
        Random parameters and discretised fields, repeated as often as they are used.  Of a
        correlated group only the members that occur take part, and they share their germs.

    Attributes
    ----------
    names
        Names of the parameters and fields.
    germs, germ_names
        (L,) independent variables, and what they are called.
    groups
        Name of each independent source (``"a+b"`` for a correlated group) -> its germ numbers.

    Raises
    ------
    SceneError
        One name with two definitions.
    """

    def __init__(self, sources: Iterable[Source]) -> None:
        seen: dict[str, Source] = {}
        for source in sources:
            if not isinstance(source, (RandomParameter, DiscretisedField)):
                raise SceneError(
                    f"{source!r} of type {type(source).__name__} is not a random parameter; a "
                    "RandomField must be put on its points first"
                )
            other = seen.setdefault(source.name, source)
            same = other is source or other == source
            if not same:
                raise SceneError(
                    f"random parameter {source.name!r} has two definitions: {other!r} and "
                    f"{source!r}; give them different names, or use one object in both places"
                )
        self._sources = seen
        self.names = tuple(seen)
        blocks: list[_Block] = []
        germs: list[Germ] = []
        germ_names: list[str] = []

        def add(
            name: str,
            new: Sequence[tuple[Germ, str]],
            members: Sequence[RandomParameter],
            field: DiscretisedField | None,
            mixing: Array,
        ) -> None:
            columns = tuple(range(len(germs), len(germs) + len(new)))
            blocks.append(_Block(name, columns, tuple(members), field, mixing))
            germs.extend(germ for germ, _ in new)
            germ_names.extend(label for _, label in new)

        done: set[Any] = set()
        for name, source in seen.items():
            if isinstance(source, DiscretisedField):
                count = len(source.eigenvalues)
                new = [(Germ.hermite(), f"{name}[{i}]") for i in range(count)]
                add(name, new, (), source, np.eye(count))
            elif isinstance(source, CorrelatedParameter):
                key = source.group._definition
                if key in done:
                    continue
                done.add(key)
                members = [m for m in source.group if seen.get(m.name) == m]
                rows = [m.position for m in members]
                mixing = linalg.cholesky(
                    source.group.normal_correlation[np.ix_(rows, rows)], lower=True
                )
                label = "+".join(m.name for m in members)
                new = [(Germ.hermite(), f"{label}[{i}]") for i in range(len(members))]
                add(label, new, members, None, mixing)
            else:
                add(name, [(source.germ, name)], (source,), None, np.eye(1))
        self._blocks = tuple(blocks)
        self.germs = tuple(germs)
        self.germ_names = tuple(germ_names)
        self.groups = {block.name: block.columns for block in blocks}

    @property
    def dimension(self) -> int:
        """L, the number of germs."""
        return len(self.germs)

    def __repr__(self) -> str:
        return f"<RandomSpace of {', '.join(self.germ_names) or 'nothing random'}>"

    # -- bases ---------------------------------------------------------------------------------
    def basis(
        self, chaos: Chaos, rows: int = 0, memory_limit: float | None = None
    ) -> ChaosBasis:
        """The chaos basis of a request.

        Parameters
        ----------
        chaos
            The request.
        rows
            Numbers that will be stored for each mode.
        memory_limit
            Bytes; None: the memory of the machine; 0: no limit.

        Raises
        ------
        SceneError
            The modes would need more memory than the limit (it is said how much), or the weights do
            not fit the germs.
        """
        limit = _machine_memory() if memory_limit is None else memory_limit
        # a law with few atoms has no polynomials of higher degree
        caps = [
            min(germ.capacity - 1 if germ.capacity is not None else 2**30, 2**30)
            for germ in self.germs
        ]
        if chaos.indices is not None:
            return self._own_basis(chaos, caps, rows, limit)
        try:
            indices = MultiIndexSet(
                chaos.index_set,
                self.dimension,
                int(chaos.order),
                q=chaos.q,
                weights=self._weights(chaos),
                interaction=chaos.max_interaction or 0,
                caps=caps if min(caps, default=2**30) < chaos.order else (),
                bytes_per_index=8.0 * rows,
                memory_limit=limit,
            )
            return ChaosBasis(self.germs, indices)
        except (ValueError, RuntimeError) as error:
            raise SceneError(f"{chaos} on {self!r}: {error}") from error

    def _own_basis(
        self, chaos: Chaos, caps: Sequence[int], rows: int, limit: float
    ) -> ChaosBasis:
        """The basis of a set of indices."""
        assert chaos.indices is not None
        table = np.array(chaos.indices, dtype=np.int32).reshape(len(chaos.indices), -1)
        if table.shape[1] != self.dimension:
            raise SceneError(
                f"Chaos: indices of {table.shape[1]} germs, there are {self.dimension}: "
                f"{', '.join(self.germ_names)}"
            )
        if np.any(table > caps):
            raise SceneError(f"Chaos: an index beyond the degrees {list(caps)} that the germs have")
        if limit and 8.0 * rows * len(table) > limit:
            raise SceneError(
                f"{len(table)} modes need {8e-9 * rows * len(table):.3g} GB, more than the limit"
            )
        try:
            return ChaosBasis(self.germs, MultiIndexSet.from_table(table))
        except (ValueError, RuntimeError) as error:
            raise SceneError(f"Chaos: indices: {error}") from error

    def _weights(self, chaos: Chaos) -> list[float]:
        if chaos.weights is None:
            return []
        if not isinstance(chaos.weights, Mapping):
            if len(chaos.weights) != self.dimension:
                raise SceneError(
                    f"Chaos: {len(chaos.weights)} weights for {self.dimension} germs: "
                    f"{', '.join(self.germ_names)}"
                )
            return [float(w) for w in chaos.weights]
        result = [1.0] * self.dimension
        for name, weight in chaos.weights.items():
            if name not in self._sources:
                raise unknown_name("random parameter", name, self.names, "Chaos: weights")
            for column in self._find(self._sources[name])[0].columns:
                result[column] = float(weight)
        return result

    # -- coefficients --------------------------------------------------------------------------
    def columns(self, source: Source) -> tuple[int, ...]:
        """Numbers of the germs that a parameter or field shares in."""
        return self._find(source)[0].columns

    def _find(self, source: Source) -> tuple[_Block, int]:
        """Block of a source, and its place among the members."""
        for block in self._blocks:
            if block.field is source:
                return block, 0
            for position, member in enumerate(block.members):
                if member == source:
                    return block, position
        raise SceneError(f"{source!r} is not part of {self!r}")

    def coefficients_at(self, source: Source, table: npt.NDArray[np.int32]) -> Array:
        """Chaos coefficients of a parameter or field on multi-indices (n, L): (rows, n)."""
        block, position = self._find(source)
        columns = list(block.columns)
        others = np.ones(self.dimension, dtype=bool)
        others[columns] = False
        inside = ~np.any(table[:, others] > 0, axis=1)
        own = table[np.ix_(inside, columns)]
        rows = len(block.field.points) if block.field is not None else 1
        result = np.zeros((rows, len(table)))
        if block.field is not None:
            result[:, inside] = block.field.coefficients(own)
            return result
        parameter = block.members[position]
        degrees = own.sum(axis=1)
        line = parameter.coefficients(int(degrees.max(initial=0)))
        factors = np.ones(len(own))
        if isinstance(parameter, CorrelatedParameter):
            # psi_n of a unit combination of normal germs, by the multinomial theorem for Hermite
            factors = np.exp(
                0.5 * (special.gammaln(degrees + 1.0) - special.gammaln(own + 1.0).sum(axis=1))
            )
            factors = factors * np.prod(block.mixing[position] ** own, axis=1)
        result[0, inside] = line[degrees] * factors
        return result

    def coefficients(self, source: Source, basis: ChaosBasis) -> Array:
        """Projection of a parameter or field on the modes of a basis: (1 or m, P + 1)."""
        return self.coefficients_at(source, basis.indices.table)

    def expansion(
        self, source: Source, basis: ChaosBasis, memory_limit: float | None = None
    ) -> Expansion:
        """The parameter with every mode that the products of two modes of `basis` can reach.

        This is what an exact Galerkin matrix needs: degree 1 for an affine parameter, otherwise up
        to twice the degree of the basis.

        Raises
        ------
        SceneError
            There are more modes than memory.
        """
        block, _ = self._find(source)
        columns = list(block.columns)
        table = basis.indices.table[:, columns]
        highest = 2 * table.max(axis=0, initial=0)
        order = 2 * int(table.sum(axis=1).max(initial=0))
        if source.affine:
            highest, order = np.minimum(highest, 1), min(order, 1)
        caps = np.zeros(self.dimension, dtype=int)
        caps[columns] = highest
        rows = len(block.field.points) if block.field is not None else 1
        try:
            indices = MultiIndexSet(
                "total",
                self.dimension,
                order,
                caps=[int(c) for c in caps],
                bytes_per_index=8.0 * rows,
                memory_limit=_machine_memory() if memory_limit is None else memory_limit,
            )
        except ValueError as error:
            raise SceneError(f"the chaos of {source.name!r}: {error}") from error
        return Expansion(self.coefficients_at(source, indices.table), indices)

    def galerkin_matrix(self, source: Source, basis: ChaosBasis, row: int = 0) -> Any:
        """E[a Psi_j Psi_k] of a parameter, or of a field at its point `row`: (P + 1, P + 1)."""
        coefficients, indices = self.expansion(source, basis)
        return core.galerkin_matrix(basis, coefficients[row], indices)

    # -- points --------------------------------------------------------------------------------
    def values(self, source: Source, points: npt.ArrayLike) -> Array:
        """A parameter (N,) or field (m, N) at points (N, L) of the germs; not by its chaos."""
        xi = np.asarray(points, dtype=np.float64)
        block, position = self._find(source)
        own = xi[:, list(block.columns)]
        if block.field is not None:
            return block.field.value(own)
        parameter = block.members[position]
        return parameter.value(own @ block.mixing[position])

    def germ_points(self, values: Mapping[str, npt.ArrayLike]) -> Array:
        """Points (N, L) of the germs for given values of parameters, (N,) or one for all points.

        Parameters that are not named stay at their mean.

        Raises
        ------
        SceneError
            An unknown name, a field (it is no one number), different lengths, or a value that the
            law of its parameter cannot take.
        """
        given: dict[str, Array] = {}
        for name, value in values.items():
            source = self._sources.get(name)
            if source is None:
                raise unknown_name("random parameter", name, self.names)
            if isinstance(source, DiscretisedField):
                raise SceneError(f"random field {name!r} cannot be set by a number a point")
            given[name] = np.atleast_1d(np.asarray(value, dtype=np.float64))
        sizes = {len(v) for v in given.values()} - {1}
        if len(sizes) > 1:
            raise SceneError(f"values of different lengths: {sorted(sizes)}")
        count = sizes.pop() if sizes else 1
        points = np.zeros((count, self.dimension))
        for block in self._blocks:
            if block.field is not None:
                continue
            scores = np.empty((count, len(block.members)))
            for position, member in enumerate(block.members):
                wanted = given.get(member.name, np.array([member.mean]))
                with np.errstate(invalid="ignore", divide="ignore"):
                    scores[:, position] = member.to_germ(wanted)
                lower, upper = member.bounds
                bad = ~np.isfinite(scores[:, position]) | (wanted < lower) | (wanted > upper)
                if np.any(bad):
                    worst = np.broadcast_to(wanted, (count,))[bad][0]
                    raise SceneError(
                        f"{member!r} cannot take the value {worst:g}; it lies between {lower:g} "
                        f"and {upper:g}"
                    )
            points[:, list(block.columns)] = linalg.solve_triangular(
                block.mixing, scores.T, lower=True
            ).T
        return points

    def from_uniform(self, probabilities: npt.ArrayLike) -> Array:
        """Points (N, L) of the germs at probabilities (N, L) in (0, 1)."""
        tiny = 2.0**-54
        u = np.clip(np.asarray(probabilities, dtype=np.float64), tiny, 1.0 - 2.0 * tiny)
        scores = special.ndtri(u)
        for block in self._blocks:
            for member in block.members:
                if not isinstance(member, CorrelatedParameter):
                    column = block.columns[0]
                    scores[:, column] = member.germ_from_normal(scores[:, column])
        return cast(Array, scores)

    def sample(self, count: int, rng: np.random.Generator | int | None = None) -> Array:
        """Monte Carlo: `count` random points (count, L) of the germs."""
        generator = np.random.default_rng(rng)
        return self.from_uniform(generator.random((count, self.dimension)))

    def sample_sobol(self, count: int, rng: np.random.Generator | int | None = None) -> Array:
        """Quasi-Monte Carlo: scrambled Sobol points (count, L); count must be a power of two.

        Raises
        ------
        SceneError
            `count` is not a power of two, or there are no germs.
        """
        if count < 1 or count & (count - 1):
            above = 2 ** max(count - 1, 1).bit_length()
            raise SceneError(
                f"{count} Sobol points lose their balance; take a power of two, e.g. {above}"
            )
        if not self.germs:
            raise SceneError("there is nothing random to sample")
        generator = np.random.default_rng(rng)
        try:
            engine = qmc.Sobol(self.dimension, scramble=True, rng=generator)
        except TypeError:  # the name of the argument before scipy 1.15
            engine = qmc.Sobol(self.dimension, scramble=True, seed=generator)
        return self.from_uniform(engine.random_base2(count.bit_length() - 1))

    def tensor_gauss(self, counts: int | Sequence[int], memory_limit: float = 0.0) -> Rule:
        """Tensor Gauss rule with so many points in each germ."""
        if isinstance(counts, (int, np.integer)):
            wanted = [int(counts)] * self.dimension
        else:
            wanted = [int(c) for c in counts]
        return core.tensor_gauss(self.germs, wanted, memory_limit)

    def sparse_gauss(self, level: int, memory_limit: float = 0.0) -> Rule:
        """Smolyak rule, exact for total degree 2 level + 1."""
        return core.smolyak(self.germs, level, memory_limit)

    # -- answers -------------------------------------------------------------------------------
    def sobol(self, coefficients: npt.ArrayLike, basis: ChaosBasis) -> dict[str, Sobol]:
        """Sobol indices of fields (rows, P + 1) by independent source: the keys of :attr:`groups`.

        The germs of a correlated group or of a random field count together; the shares of
        correlated parameters among each other are not defined.
        """
        block = np.asarray(coefficients, dtype=np.float64)
        result = {}
        for name, columns in self.groups.items():
            rest = [i for i in range(self.dimension) if i not in columns]
            result[name] = Sobol(
                core.sobol_closed(block, basis.indices, columns),
                1.0 - core.sobol_closed(block, basis.indices, rest),
            )
        return result
