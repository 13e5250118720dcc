"""Random fields over an interface: the request, and its Karhunen-Loeve expansion on points.

Correlation lengths have the unit of the coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_known,
    checked_number,
    checked_numbers,
    checked_whole,
    is_list,
    told_call,
)
from dolfinx_frontend.common.deferred import linalg, optimize, special, spla
from dolfinx_frontend.common.describe import record
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.uncertainty.checks import deviation, named

__all__ = ["DiscretisedField", "RandomField", "exponential_1d_eigenvalues", "karhunen_loeve"]


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
    check_known("covariance", covariance, ("exponential", "gaussian", "matern"), where)
    if (nu is None) == (covariance == "matern"):
        raise SceneError(
            f"{where}: nu = {nu} with covariance {covariance!r}; 'matern' needs its smoothness "
            "nu > 0, the others have none"
        )
    if covariance == "exponential":
        return (lambda r: np.exp(-r)), True
    if covariance == "gaussian":
        return (lambda r: np.exp(-0.5 * r * r)), False
    assert nu is not None
    return _matern(checked_number(where, "nu", nu, above=0.0)), nu < 1.0


class NoModesError(SceneError):
    """A covariance of which nothing is left at the points of a field."""


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
        dimension and -0.228824 in two (B. Wu, P.-G. Martinsson, Adv. Comput. Math. 47 (2021) 45), and
        -0.266596 in three (Epstein's zeta function of the cubic lattice at -1).
    cell_dimension
        1 if weights are lengths, 2 if they are areas, 3 if volumes; default: d - 1, at least 1.

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
        # the mean distance in the piece is radius / 2 on a line, 2 / 3 of it in a disc, 3 / 4 in a ball
        mean = (1.0 / 6.0, 0.228824, 0.266596)[dimension - 1]
        radius = (dimension + 1) / dimension * mean * w ** (1.0 / dimension)
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
    if not np.all(np.isfinite(values)) or not values[0] > 0.0:
        raise NoModesError(
            f"there are no modes at its {m} points: its covariance gives no positive finite numbers "
            "there, or its correlation length is far below their distances; choose a larger length or a "
            "finer mesh"
        )
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

    operator = spla.LinearOperator((m, m), matvec=multiply, dtype=np.float64)
    count = modes if modes is not None else 20
    start = np.random.default_rng(0).standard_normal(m)
    while True:
        count = min(count, m - 1)
        values, vectors = spla.eigsh(operator, k=count, which="LA", v0=start)
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
    _: KW_ONLY
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
        where = named("RandomField", self.name)
        check_known("distribution", self.distribution, ("normal", "lognormal"), where)
        lowest = 0.0 if self.distribution == "lognormal" else -math.inf
        mean = checked_number(where, "mean", self.mean, above=lowest)
        deviation(where, mean, self.cov, self.std)
        lengths = self.length if is_list(self.length) else [self.length]
        for value in lengths:
            checked_number(where, "length", value, above=0.0)
        if not np.isscalar(self.length):
            given = np.asarray(self.length, dtype=np.float64)
            object.__setattr__(self, "length", tuple(map(float, given)) if given.ndim else float(given))
        _correlation(where, self.covariance, self.nu)
        if self.variance_captured is None and self.modes is None:
            object.__setattr__(self, "variance_captured", 0.95)
        elif self.variance_captured is not None and self.modes is not None:
            raise SceneError(f"{where}: give variance_captured or modes, not both")
        if self.variance_captured is not None:
            checked_number(where, "variance_captured", self.variance_captured, above=0.0, most=1.0)
        if self.modes is not None:
            checked_whole(where, "modes", self.modes, 1)

    @property
    def deviation(self) -> float:
        """Standard deviation."""
        return float(abs(self.mean) * (self.cov or 0.0) if self.std is None else self.std)

    @property
    def relative(self) -> RandomField:
        """The field divided by its mean.

        Raises
        ------
        SceneError
            The mean is not positive.
        """
        if not self.mean > 0.0:
            raise SceneError(
                f"RandomField {self.name!r}: mean = {self.mean:g}; a stiffness has a positive mean"
            )
        return replace(self, mean=1.0, std=None, cov=self.deviation / self.mean)

    def on(
        self, points: npt.ArrayLike, weights: npt.ArrayLike, cell_dimension: int | None = None
    ) -> DiscretisedField:
        """The field on points (m, d) with weights (m,) > 0, areas of an interface if nothing is said.

        A field that lives on several interfaces is discretised once, on all their points together.

        Raises
        ------
        SceneError
            Shapes that do not fit, a weight that is not positive, the wrong number of lengths, or
            more variance is asked for than the points resolve.
        """
        where = f"RandomField {self.name!r}"
        x = checked_numbers(where, "points", points, "give finite numbers (m, d)")
        w = checked_numbers(where, "weights", weights, "give positive numbers (m,)")
        if x.ndim != 2 or w.shape != (len(x),) or len(x) == 0:
            raise SceneError(
                f"{where}: points of shape {x.shape} and weights of shape {w.shape}; wanted (m, d) "
                "and (m,), m > 0"
            )
        if not (w > 0.0).all():
            raise SceneError(f"{where}: weights must be positive, the smallest is {w.min():g}")
        lengths = np.asarray(self.length, dtype=np.float64)
        if lengths.ndim and lengths.shape != (x.shape[1],):
            raise SceneError(
                f"{where}: {lengths.size} lengths for points with {x.shape[1]} coordinates"
            )
        correlation, kink = _correlation(where, self.covariance, self.nu)
        # cells in the scaled coordinates; with one length per axis their size is only estimated
        cell_dimension = cell_dimension or max(1, x.shape[1] - 1)
        typical = math.exp(float(np.log(lengths).mean()))
        scale = typical**cell_dimension
        try:
            eigenvalues, functions, captured = karhunen_loeve(
                x / lengths,
                w / scale,
                lambda r: told_call(f"{where}: covariance", correlation, r),
                variance_captured=self.variance_captured,
                modes=self.modes,
                kink=kink,
                cell_dimension=cell_dimension,
            )
        except NoModesError as error:
            raise SceneError(f"{where}: {error}") from error
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
    """A random field on the points of an interface: standard normal germs, one per mode.

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

    def factors(self, mode: int, degree: int) -> Array:
        """(m, degree + 1, degree + 1): E[exp(s xi - s^2 / 2) psi_j psi_k] of one germ of a lognormal field,
        whose product over the germs times the mean is E[field Psi_j Psi_k].

        psi_j(xi) under the tilted density is sum_i sqrt(binomial(j, i) / (j - i)!) s^(j - i) psi_i(xi - s).
        """
        s = self._log_shapes[:, mode]
        shift = np.zeros((len(s), degree + 1, degree + 1))
        for j in range(degree + 1):
            for i in range(j + 1):
                shift[:, j, i] = math.sqrt(math.comb(j, i) / math.factorial(j - i)) * s ** (j - i)
        found: Array = shift @ shift.transpose(0, 2, 1)
        return found

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
