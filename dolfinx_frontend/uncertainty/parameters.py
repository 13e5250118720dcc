"""Random parameters of a scene.

What a user writes instead of a number in a law, and how it becomes polynomial chaos:

========================  ============================================  ================
:func:`Normal`            normal; can be negative                       Hermite, affine
:func:`TruncatedNormal`   normal, cut at bounds                         own, affine
:func:`LogNormal`         positive                                      Hermite, exact
:func:`Uniform`           between two bounds                            Legendre, affine
:func:`Gamma`             positive                                      Laguerre, affine
:func:`Beta`              between two bounds                            Jacobi, affine
:func:`FromSamples`       observed values, equally probable             own, affine
:func:`FromDistribution`  any distribution of scipy.stats or OpenTURNS  own or Hermite
:class:`Correlated`       several, joined by a Gaussian copula (Nataf)  Hermite
:class:`RandomField`      varies over an interface, Karhunen-Loeve      Hermite
========================  ============================================  ================

A *germ* is one independent random variable with its orthonormal polynomials.  *Affine* means that
the parameter is a linear function of its own germ: its chaos has two terms, and every Galerkin
matrix has its eigenvalues among the values that the parameter can take, so that a positive distribution
stays positive definite at every order.  The others have full coupling: a chaos of order p needs
their coefficients up to degree 2p, which :meth:`RandomSpace.expansion` provides.

Correlation lengths have the unit of the coordinates; a parameter has the unit of what it replaces.
"""

from __future__ import annotations

import math
from typing import Any, Literal, Never, cast

import numpy as np
import numpy.typing as npt
from latin_core.stochastic import Germ

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_name, checked_number, checked_numbers
from dolfinx_frontend.common.deferred import special, stats
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.recorded import recorded
from dolfinx_frontend.uncertainty.checks import checked_bounds, deviation, named, refuse_positional
from dolfinx_frontend.uncertainty.distributions import (
    Atoms,
    Distribution,
    NewScipyLaw,
    OpenTurnsLaw,
    moments_determine,
    panels,
)
from dolfinx_frontend.uncertainty.expressions import Operand

__all__ = [
    "Beta",
    "FromDistribution",
    "FromSamples",
    "Gamma",
    "LogNormal",
    "Normal",
    "RandomParameter",
    "TruncatedNormal",
    "Uniform",
]


def _mesh_of_normal() -> tuple[Array, Array]:
    """Trapezoidal rule under the standard normal density: exponentially accurate, any growth."""
    z = np.arange(-1024, 1025) / 64.0
    return z, np.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * 64.0)


class RandomParameter(Operand):
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
        self, kind: str, name: str, definition: tuple[Any, ...], shown: str, law: Distribution
    ) -> None:
        checked_name(kind, name)
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

    @property
    def continuous(self) -> bool:
        """Whether it takes every value in between, and not only observed or discrete ones."""
        return not isinstance(self._law, Atoms)

    @property
    def atoms(self) -> tuple[Array, Array] | None:
        """Values (n,) of the germ of a discrete parameter, and probabilities (n,); None: it is continuous."""
        law = self._law
        return (self.to_germ(law.values), law.probabilities.copy()) if isinstance(law, Atoms) else None

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
    """value = shift + scale * germ, where the germ has the parameter's own distribution."""

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
        law: Distribution,
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
    """A function of a standard normal germ, given by the quantiles of a distribution."""

    affine = False

    def __init__(
        self, kind: str, name: str, definition: tuple[Any, ...], shown: str, law: Distribution
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


class _NormalParameter(_Affine):
    """Its own distribution is that of the germ, so quantiles are exact."""

    def from_normal(self, score: npt.ArrayLike) -> Array:
        return self.value(score)

    def to_normal(self, value: npt.ArrayLike) -> Array:
        return self.to_germ(value)


@recorded
def Normal(name: str, mean: float, *more: Never, cov: Any = None, std: Any = None) -> RandomParameter:
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
        One of them, by its keyword: coefficient of variation > 0, or standard deviation > 0.

    Raises
    ------
    SceneError
        As all functions of this module, on a value that is no number or out of range.
    """
    where = named("Normal", name)
    refuse_positional(where, more)
    m = checked_number(where, "mean", mean)
    s = deviation(where, m, cov, std)
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


@recorded
def TruncatedNormal(
    name: str,
    mean: float,
    *more: Never,
    cov: Any = None,
    std: Any = None,
    lower: Any = None,
    upper: Any = None,
    within: Any = None,
) -> RandomParameter:
    """Normal distribution that is truncated at bounds and scaled back to the probability 1.

    ``mean``, ``cov`` and ``std`` are those of the normal distribution *before* truncation; the attributes
    ``mean`` and ``std`` of the result are those of the truncated variable itself.

    Parameters
    ----------
    name, mean, cov, std
        As for :func:`Normal`.
    lower, upper
        Bounds in the unit of the parameter; one of them may be None (no bound).
    within
        Instead of bounds: truncate at mean +- within * std.
    """
    where = named(kind := "TruncatedNormal", name)
    refuse_positional(where, more)
    m = checked_number(where, "mean", mean)
    s = deviation(where, m, cov, std)
    if (within is None) == (lower is None and upper is None):
        raise SceneError(f"{where}: give either lower and/or upper, or within (in std)")
    if within is not None:
        z_up = checked_number(where, "within", within, above=0.0)
        z_lo = -z_up
    else:
        z_lo = -math.inf if lower is None else (checked_number(where, "lower", lower) - m) / s
        z_up = math.inf if upper is None else (checked_number(where, "upper", upper) - m) / s
    if not z_lo < z_up:
        raise SceneError(f"{where}: lower = {lower:g} must be less than upper = {upper:g}")
    if min(z_up, -z_lo) < -8.0:
        raise SceneError(
            f"{where}: the bounds lie more than 8 std away from the mean on one side; "
            "that is a tail and not a truncated normal: give another distribution"
        )
    germ = Germ.from_measure(*panels(stats.truncnorm(z_lo, z_up)))
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


@recorded
def LogNormal(name: str, mean: float, *more: Never, cov: Any = None, std: Any = None) -> RandomParameter:
    """Lognormal parameter: the logarithm is normal.  Positive, chaos exact at any degree.

    ``mean`` > 0, ``cov`` and ``std`` are those of the parameter, not of its logarithm.
    """
    where = named("LogNormal", name)
    refuse_positional(where, more)
    m = checked_number(where, "mean", mean, above=0.0)
    return _LogNormalParameter(name, m, deviation(where, m, cov, std))


@recorded
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
    where = named(kind := "Uniform", name)
    if (lower is None) != (upper is None) or (lower is None) == (mean is None):
        raise SceneError(f"{where}: give lower and upper, or mean and cov (or std)")
    if mean is None:
        if cov is not None or std is not None:
            raise SceneError(f"{where}: lower and upper already say the std")
        lo, up = checked_bounds(where, lower, upper)
    else:
        m = checked_number(where, "mean", mean)
        reach = math.sqrt(3.0) * deviation(where, m, cov, std)
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


@recorded
def Gamma(name: str, mean: float, *more: Never, cov: Any = None, std: Any = None) -> RandomParameter:
    """Gamma parameter on (0, inf) with ``mean`` > 0 and ``cov`` or ``std``; shape = 1 / cov^2."""
    where = named("Gamma", name)
    refuse_positional(where, more)
    m = checked_number(where, "mean", mean, above=0.0)
    s = deviation(where, m, cov, std)
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


@recorded
def Beta(
    name: str, a: float, b: float, lower: float = 0.0, upper: float = 1.0
) -> RandomParameter:
    """Beta parameter, ``a``, ``b`` > 0: density ~ (x - lower)^(a-1) (upper - x)^(b-1)."""
    where = named("Beta", name)
    first = checked_number(where, "a", a, above=0.0)
    second = checked_number(where, "b", b, above=0.0)
    lo, up = checked_bounds(where, lower, upper)
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


class _Discrete(_Affine):
    """Takes finitely many values; its germ is the standardised value."""

    _law: Atoms

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
        law = Atoms(atoms, masses.astype(np.float64))
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


@recorded
def FromSamples(name: str, samples: npt.ArrayLike) -> RandomParameter:
    """The empirical distribution of observed values (N,), each with probability 1 / N.

    Its polynomials are those of the samples; with n different values there are n of them.
    """
    where = named("FromSamples", name)
    values = checked_numbers(where, "samples", samples, "give a list of finite numbers", dimensions=1)
    if not values.size:
        raise SceneError(f"{where}: samples = {samples!r}: give a list of finite numbers")
    return _Discrete(
        "FromSamples", name, (values.tobytes(),), values, np.full(values.size, 1.0 / values.size)
    )


@recorded
def FromDistribution(
    name: str, distribution: Any, germ: Literal["auto", "own", "normal"] = "auto"
) -> RandomParameter:
    """Any distribution of one variable, continuous or discrete.

    Parameters
    ----------
    name
        Name of the random variable.
    distribution
        A frozen ``scipy.stats`` distribution, a scipy >= 1.15 random variable, or an OpenTURNS
        ``Distribution`` of dimension 1.
    germ
        ``"own"``: polynomials of the distribution itself, by Lanczos; the parameter is affine.
        ``"normal"``: a function of a standard normal germ.  ``"auto"`` takes the own ones where
        they are complete, i.e. unless a tail is heavier than exp(-sqrt(x)) (a lognormal distribution is such
        a case).
    """
    where = named(kind := "FromDistribution", name)
    check_known("germ", germ, ("auto", "own", "normal"), where)
    definition: tuple[Any, ...]
    law: Distribution
    if hasattr(distribution, "computeQuantile") and hasattr(distribution, "getDimension"):
        if distribution.getDimension() != 1:
            raise SceneError(
                f"{where}: the distribution has {distribution.getDimension()} variables; "
                "give one of dimension 1 (Correlated joins several)"
            )
        definition = (repr(distribution),)
        if distribution.isDiscrete():
            values = np.array(distribution.getSupport())[:, 0]
            masses = np.array(distribution.getProbabilities())
            return _Discrete(kind, name, definition, values, masses)
        law = OpenTurnsLaw(distribution)
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
        law = NewScipyLaw(distribution)
    else:
        raise SceneError(
            f"{where}: unknown distribution {distribution!r} of type "
            f"{type(distribution).__name__}; give a frozen scipy.stats distribution, e.g. "
            "scipy.stats.weibull_min(2.0, scale=100.0), or an OpenTURNS Distribution"
        )
    mean, std = float(law.mean()), float(law.std())
    if not (math.isfinite(mean) and math.isfinite(std) and std > 0.0):
        raise SceneError(
            f"{where}: mean {mean:g} and std {std:g}; a chaos needs a distribution with a finite "
            "variance > 0"
        )
    definition = (*definition, germ)
    shown = f"mean={mean:g}, std={std:g}"
    if germ == "own" or (germ == "auto" and moments_determine(law)):
        nodes, weights = panels(law)
        own = Germ.from_measure((nodes - mean) / std, weights)
        return _Affine(kind, name, definition, shown, germ=own, shift=mean, scale=std, law=law)
    return _Gaussian(kind, name, definition, shown, law)
