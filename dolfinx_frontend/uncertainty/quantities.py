"""Statistics of one random number: moments, quantiles, probabilities, density, Sobol indices.

Each comes with a confidence interval for its sampling error. The error of the model (mesh, chaos
order) is not included.

The intervals hold for independent samples. Scrambled Sobol points (``kind="qmc"``) are usually
more accurate than independent samples, so that their interval is usually too wide: it bounds the
error, but does not measure it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_callable,
    checked_name,
    checked_number,
    checked_numbers,
    checked_reals,
    checked_seed,
    checked_whole,
    is_real,
)
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.uncertainty.sobol import shares_of_samples
from dolfinx_frontend.uncertainty.space import RandomSpace, sobol_points

__all__ = [
    "Density", "Estimate", "Histogram", "Inputs", "Kind", "Quantity", "SobolEstimate", "SobolIndices",
    "sobol_of",
]  # fmt: skip

ROUNDING = 1e-14
"""A standard deviation below this share of the largest value is none."""
NARROW = 0.01
"""Width of an interval of a Sobol index that needs no second estimate."""
MOST_BINS = 10**6
"""Bins of a histogram."""

Kind = Literal["random", "qmc", "quadrature", "value", "grid"]
"""Independent samples, Sobol points, points of a rule; one value that is not random, those of a sweep."""


class Estimate(NamedTuple):
    """A number and its confidence interval."""

    value: float
    low: float  # NaN: no interval; -inf: the sample has no lower bound
    high: float
    level: float  # probability that such an interval contains the true value, e.g. 0.95

    def __str__(self) -> str:
        width = self.high - self.low
        if math.isnan(width):
            return f"{self.value:.6g}"
        finite = [abs(v) for v in self[:3] if math.isfinite(v)]
        largest = max(finite, default=0.0)
        if not math.isfinite(width):
            width = 1e-3 * largest
        if largest == 0.0:
            numbers = ["0", "0", "0"]
        else:
            # two digits of the width of the interval
            last = math.floor(math.log10(max(width, 1e-5 * largest))) - 1
            first = math.floor(math.log10(largest))
            form = f".{max(-last, 0)}f" if -4 <= first < 6 else f".{max(first - last, 0)}e"
            numbers = [format(v, form) for v in self[:3]]
        return f"{numbers[0]} [{numbers[1]}, {numbers[2]}] ({100.0 * self.level:g} %)"


class Density(NamedTuple):
    """Estimated probability density."""

    x: Array  # (n,), unit of the quantity
    pdf: Array  # (n,), 1 / unit


class Histogram(NamedTuple):
    """Relative frequencies."""

    edges: Array  # (bins + 1,), unit of the quantity
    pdf: Array  # (bins,), 1 / unit; its integral is 1


class SobolEstimate(NamedTuple):
    """Sobol indices of one source by sampling; NaN if the quantity has no variance."""

    first: Estimate  # fraction of the variance due to the source alone
    total: Estimate  # fraction in which it takes part


class SobolIndices(dict[str, SobolEstimate]):
    """Source -> its indices, printed as a table; all NaN where there is no variance to share."""

    def __repr__(self) -> str:
        if all(math.isnan(each.total.high) for each in self.values()):
            return "no variance: the quantity depends on nothing random by more than its error"
        lines = [f"  {name:<12} first {each.first}, total {each.total}" for name, each in self.items()]
        return "\n".join(["Sobol indices", *lines])


@dataclass(frozen=True)
class Inputs:
    """What the values of a quantity depend on.

    Attributes
    ----------
    space, germs
        The germs, and the points (N, L) that the values belong to.
    noise
        Relative error of a value: scatter below it is none.
    at
        Points (n, L) -> the quantity (n,) there, where that costs little; None: only the values are known.
    """

    space: RandomSpace
    germs: Array
    noise: float = 0.0
    at: Callable[[Array], Array] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "germs", frozen(self.germs))


def _check_level(level: float) -> None:
    checked_number("interval", "level", level, above=0.0, below=1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Quantity(Shown):
    """A scalar quantity of interest, known at points of the random space.

    Attributes
    ----------
    name, unit
        What it is.
    values
        (N,) at the points; read-only.
    weights
        (N,) of a quadrature rule, sum 1, some may be negative; None: all points count the same.
    kind
        ``"random"``: independent samples; ``"qmc"``: scrambled Sobol points; ``"quadrature"``: the
        points of a rule, which give moments and nothing else; ``"value"``: one value that is not
        random; ``"grid"``: values at the points of a sweep, which have no statistics.
    inputs
        What it depends on; None: that is not known.

    Raises
    ------
    SceneError
        Values that are not finite (with their number), or weights that do not fit.
    """

    name: str
    unit: str = ""
    values: Array = field(kw_only=True)
    weights: Array | None = field(default=None, kw_only=True)
    kind: Kind = field(default="random", kw_only=True)
    inputs: Inputs | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        where = f"quantity {checked_name('quantity', self.name)!r}"
        check_kind(where, "unit", self.unit, str, "give a string")
        check_known("kind", self.kind, get_args(Kind), where)
        values = checked_reals(where, "values", self.values, "give one number per point")
        if values.ndim != 1 or values.size == 0:
            raise SceneError(f"{where}: values of shape {values.shape}; give one number per point")
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise SceneError(
                f"{where}: {bad} of {values.size} values are not finite, the first at point "
                f"{int(np.argmin(np.isfinite(values)))}; let the function return a number there"
            )
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        if (self.weights is None) == (self.kind == "quadrature"):
            raise SceneError(
                f"{where}: kind {self.kind!r} {'without' if self.weights is None else 'with'} "
                "weights; a quadrature has weights, samples have none"
            )
        if self.weights is not None:
            weights = checked_reals(where, "weights", self.weights, "give one number per point")
            total = float(weights.sum())
            if weights.shape != values.shape or not abs(total - 1.0) <= 1e-8:
                raise SceneError(
                    f"{where}: weights of shape {weights.shape} and sum {total:.12g} for "
                    f"{values.size} points; a rule for expectations has one per point, with sum 1"
                )
            weights.flags.writeable = False
            object.__setattr__(self, "weights", weights)

    def __len__(self) -> int:
        return len(self.values)

    def _no_grid(self, what: str) -> None:
        if self.kind == "grid":
            raise SceneError(
                f"quantity {self.name!r}: no {what} and no statistics from the points of a sweep, which have "
                "no probability: read its values"
            )

    def _samples(self, what: str, least: int = 1) -> Array:
        """The values, if they are samples and enough of them."""
        self._no_grid(what)
        if self.weights is not None:
            sign = " (some negative)" if self.weights.min() < 0.0 else ""
            raise SceneError(
                f"quantity {self.name!r}: no {what} from the {len(self)} points of a quadrature: "
                f"its weights{sign} integrate smooth functions and cannot be used for counting; "
                "use Monte Carlo or a chaos evaluated at samples"
            )
        if len(self) < least:
            raise SceneError(
                f"quantity {self.name!r}: {what} needs {least} samples at least, there are "
                f"{len(self)}"
            )
        return self.values

    # -- moments -------------------------------------------------------------------------------
    def _moment(self, order: int) -> float:
        """Central moment, of the samples (divided by N) or the rule."""
        centred = self.values - float(np.average(self.values, weights=self.weights))
        return float(np.average(centred**order, weights=self.weights))

    def mean(self, level: float = 0.95) -> Estimate:
        """Expectation, with Student's interval."""
        _check_level(level)
        self._no_grid("mean")
        value = float(np.average(self.values, weights=self.weights))
        if self.weights is not None or len(self) < 2:
            return Estimate(value, math.nan, math.nan, level)
        half = float(stats.t.isf(0.5 * (1.0 - level), len(self) - 1) * stats.sem(self.values))
        return Estimate(value, value - half, value + half, level)

    def variance(self, level: float = 0.95) -> Estimate:
        """Variance (unbiased for independent samples, divided by N for Sobol points), unit squared, with
        Bonett's interval.

        The interval on the logarithm of the variance takes its width from the kurtosis of the
        samples, where the chi-square interval takes that of the normal distribution:
        D. Bonett, Comput. Stat. Data Anal. 50 (2006) 775, equation 3.  For distributions with heavy tails
        and few samples it is too narrow, like any other.

        Raises
        ------
        SceneError
            One sample; a rule with negative weights gives a negative variance: it is too coarse.
        """
        _check_level(level)
        self._no_grid("variance")
        if self.kind == "value":  # nothing is random
            return Estimate(0.0, 0.0, 0.0, level)
        n = len(self)
        if n < 2:
            raise SceneError(
                f"quantity {self.name!r}: one sample has no variance and no standard deviation; take more"
            )
        if self.weights is not None:
            variance = self._moment(2)
            if variance < 0.0:
                raise SceneError(
                    f"quantity {self.name!r}: the variance by quadrature is {variance:.3g}: the "
                    "rule is too coarse for this quantity; raise its level"
                )
            return Estimate(variance, math.nan, math.nan, level)
        variance = float(np.var(self.values, ddof=0 if self.kind == "qmc" else 1))
        z = float(stats.norm.isf(0.5 * (1.0 - level)))
        if n < 5 or n <= z:
            return Estimate(variance, 0.0, math.inf, level)
        if variance == 0.0:
            return Estimate(0.0, 0.0, 0.0, level)
        scaled = (self.values - self.values.mean()) / math.sqrt(variance)
        trimmed = stats.trim_mean(scaled, min(0.5 / math.sqrt(n - 4.0), 0.49))
        kurtosis = n * float(np.sum((scaled - trimmed) ** 4)) / (n - 1.0) ** 2
        centre = n / (n - z)
        spread = max(kurtosis - (n - 3.0) / n, 0.0) / (n - 1.0)
        factor = math.exp(min(z * centre * math.sqrt(spread), 700.0))
        return Estimate(variance, centre * variance / factor, centre * variance * factor, level)

    def std(self, level: float = 0.95) -> Estimate:
        """Standard deviation; its interval is the root of that of :meth:`variance`."""
        value, low, high, _ = self.variance(level)
        return Estimate(math.sqrt(value), math.sqrt(low), math.sqrt(high), level)

    def skewness(self, level: float = 0.95) -> Estimate:
        """Skewness E[z^3], z the standardised quantity; NaN without variance.

        The interval is that of large samples, from the influence function
        z^3 - 3 z - g - 3/2 g (z^2 - 1) of the skewness g (delta method); from 1 000 samples of a
        gamma distribution of skewness 1 a 95 % interval holds the truth in 90 % of the cases.
        """
        _check_level(level)
        self._no_grid("skewness")
        variance = self._moment(2)
        if not variance > 0.0:
            return Estimate(math.nan, math.nan, math.nan, level)
        value = self._moment(3) / variance**1.5
        if self.weights is not None:
            return Estimate(value, math.nan, math.nan, level)
        z = (self.values - self.values.mean()) / math.sqrt(variance)
        influence = z**3 - 3.0 * z - value - 1.5 * value * (z**2 - 1.0)
        half = float(stats.norm.isf(0.5 * (1.0 - level)) * np.std(influence)) / math.sqrt(len(z))
        return Estimate(value, value - half, value + half, level)

    # -- distribution --------------------------------------------------------------------------
    def quantile(self, q: float, level: float = 0.95) -> Estimate:
        """The value that is not exceeded with probability `q`, 0 < q < 1.

        The interval lies between two order statistics, by the binomial distribution: exact for any
        continuous distribution.  An end is infinite where the sample is too small to bound it.
        """
        _check_level(level)
        checked_number(f"quantity {self.name!r}", "q", q, above=0.0, below=1.0)
        values = self._samples("quantile")
        value = float(np.quantile(values, q, method="median_unbiased"))
        if self.kind == "value":
            return Estimate(value, value, value, level)
        low, high = stats.quantile_test(values, q=0.0, p=q).confidence_interval(level)
        return Estimate(
            value,
            -math.inf if math.isnan(low) else float(low),
            math.inf if math.isnan(high) else float(high),
            level,
        )

    def probability(
        self,
        above: float | None = None,
        below: float | None = None,
        level: float = 0.95,
        method: Literal["wilson", "exact"] = "wilson",
    ) -> Estimate:
        """Probability that the quantity is > `above`, < `below`, or between both if both are given.

        Parameters
        ----------
        above, below
            Bounds, unit of the quantity.
        level
            Of the interval.
        method
            ``"wilson"``: has the level on average, also at zero counts; ``"exact"``: Clopper and
            Pearson's, never has less than the level, wider.
        """
        _check_level(level)
        where = f"quantity {self.name!r}"
        if above is None and below is None:
            raise SceneError(f"{where}: probability of what? give above, below or both")
        for what, bound in (("above", above), ("below", below)):
            if bound is not None and not (is_real(bound) and math.isinf(bound)):
                checked_number(where, what, bound)
        if above is not None and below is not None and not above < below:
            raise SceneError(f"{where}: nothing is above {above:g} and below {below:g}")
        check_known("method", method, ("wilson", "exact"), where)
        values = self._samples("probability")
        inside = np.ones(len(values), dtype=bool)
        if above is not None:
            inside &= values > above
        if below is not None:
            inside &= values < below
        count = int(np.count_nonzero(inside))
        if self.kind == "value":
            return Estimate(float(count), float(count), float(count), level)
        test = stats.binomtest(count, len(values))
        low, high = test.proportion_ci(level, method=method)
        return Estimate(count / len(values), float(low), float(high), level)

    def density(self, x: npt.ArrayLike | None = None) -> Density:
        """Gaussian kernel estimate with Scott's width; `x` (n,): default 200 points over the range.

        It rounds off kinks and steps of a density over the kernel's width.
        """
        values = self._samples("density", least=2)
        deviation = float(np.std(values))
        if not deviation > 1e-14 * float(np.abs(values).max()):
            raise SceneError(
                f"quantity {self.name!r}: all values equal {values[0]:g}: there is no density"
            )
        kernel = stats.gaussian_kde(values)
        if x is None:
            margin = 3.0 * deviation * float(kernel.factor)
            x = np.linspace(values.min() - margin, values.max() + margin, 200)
        at = np.atleast_1d(checked_numbers(f"quantity {self.name!r}", "x", x, "give finite numbers (n,)"))
        return Density(at, np.asarray(kernel(at)))

    def histogram(self, bins: int | npt.ArrayLike | None = None) -> Histogram:
        """Relative frequencies; `bins`: their number, or edges (bins + 1,).

        Default: the rule of Freedman and Diaconis, 1 000 bins at most.
        """
        where = f"quantity {self.name!r}"
        values = self._samples("histogram")
        if bins is None:
            width = 2.0 * float(stats.iqr(values)) / np.cbrt(len(values))
            span = float(np.ptp(values))
            bins = math.ceil(min(max(span / width, 1.0), 1000.0)) if width > 0.0 else 1
        elif np.ndim(bins):
            bins = checked_numbers(where, "bins", bins, "give increasing edges (bins + 1,)", dimensions=1)
            if len(bins) < 2 or np.any(np.diff(bins) <= 0.0):
                raise SceneError(f"{where}: bins = {short(bins)}: give increasing edges (bins + 1,)")
        else:
            bins = checked_whole(where, "bins", bins, 1, MOST_BINS)
        pdf, edges = np.histogram(values, bins=bins, density=True)
        return Histogram(edges, pdf)

    def sobol(self, level: float = 0.95, n: int = 2**12, seed: int = 0) -> SobolIndices:
        """Shares of the variance by source, first and total, with intervals.

        From samples by a polynomial of the germs: the interval contains what it does not explain, and is wide
        where that is much. A chaos is evaluated at 2 ** 12 points a source as well (:func:`sobol_of`), and
        what has the narrower intervals is returned. Germs that are correlated, or of one field, count as one.

        Parameters
        ----------
        level
            Of the intervals.
        n, seed
            Of a chaos: points, a power of two.

        Raises
        ------
        SceneError
            Nothing is random, its germs are not known (a saved answer), or it is from the points of a rule.
        """
        _check_level(level)
        values, known = self._samples("Sobol indices", least=2), self.inputs
        if known is None or not known.space.germs:
            raise SceneError(
                f"quantity {self.name!r}: no Sobol indices of a {self.kind} without its germs; take them "
                "from the answer of a chaos or of samples, before it is saved"
            )
        if not np.std(values) > max(known.noise * abs(values.mean()), ROUNDING * np.abs(values).max()):
            none = Estimate(math.nan, math.nan, math.nan, level)
            return SobolIndices({name: SobolEstimate(none, none) for name in known.space.groups})
        if len(known.space.groups) == 1:  # it has the whole variance
            one = Estimate(1.0, 1.0, 1.0, level)
            return SobolIndices({name: SobolEstimate(one, one) for name in known.space.groups})
        few = slice(None) if known.at is None else slice(n)
        shares = shares_of_samples(known.space, known.germs[few], values[few], level)
        both = np.stack([shares.values, shares.low, shares.high], axis=2)
        found = {
            name: SobolEstimate(*(Estimate(float(v), float(l), float(h), level) for v, l, h in both[:, k]))
            for k, name in enumerate(known.space.groups)
        }
        if known.at is not None and np.max(shares.high - shares.low) > NARROW:
            other = sobol_of(known.at, known.space, n, seed, level)
            widths = [max(e.high - e.low for each in of.values() for e in each) for of in (found, other)]
            found = other if widths[1] < widths[0] else found
        return SobolIndices(found)

    # -- table ---------------------------------------------------------------------------------
    def _rows(self) -> Iterator[tuple[str, Estimate]]:
        if self.kind in ("value", "grid"):
            for value in self.values[:10]:
                yield "value", Estimate(float(value), math.nan, math.nan, math.nan)
            return
        yield "mean", self.mean()
        if len(self) > 1:
            yield "std", self.std()
            yield "skewness", self.skewness()
        if self.weights is None:
            for percent in (1, 5, 50, 95, 99):
                yield f"{percent} %", self.quantile(percent / 100.0)

    def __repr__(self) -> str:
        kinds = {
            "random": "samples", "qmc": "Sobol points", "quadrature": "points of a rule",
            "value": "value, not random", "grid": "points of a sweep",
        }  # fmt: skip
        unit = f" [{self.unit}]" if self.unit else ""
        lines = [f"{self.name}{unit}, {len(self)} {kinds[self.kind]}"]
        lines += [f"  {label:<9}{estimate}" for label, estimate in self._rows()]
        return "\n".join(lines)


def sobol_of(
    function: Callable[[Array], npt.ArrayLike],
    space: RandomSpace,
    n: int = 2**12,
    seed: int = 0,
    level: float = 0.95,
    resamples: int = 400,
) -> dict[str, SobolEstimate]:
    """Sobol indices of any scalar quantity by sampling, e.g. of the largest traction.

    Pick-freeze with two scrambled Sobol matrices A, B (n, L) and, for each independent source, A
    with the germs of that source from B: so a correlated group or a random field counts as one.
    `function` is evaluated (sources + 2) n times.  Estimators: A. Saltelli et al., Comput. Phys.
    Commun. 181 (2010) 259, table 2 (b, f), by ``scipy.stats.sobol_indices``.

    Parameters
    ----------
    function
        Takes points (n, L) of the germs, returns (n,) values.
    space
        The germs.
    n
        Size of a matrix: a power of two.
    seed
        Of the points and the bootstrap.
    level, resamples
        Bootstrap percentile intervals, by this many resamplings of the n rows.

    Returns
    -------
    Source (key of ``space.groups``) -> indices.

    Raises
    ------
    SceneError
        `n` is no power of two, or the function does not return one finite number per point.
    """
    _check_level(level)
    checked_callable("sobol_of", "function", function, "give a function of points (n, L) of the germs")
    checked_whole("sobol_of", "n", n, 2)
    checked_whole("sobol_of", "resamples", resamples, 1)
    if n & (n - 1):
        raise SceneError(f"sobol_of: n = {n} must be a power of two, e.g. {2 ** (n - 1).bit_length()}")
    if not space.germs:
        raise SceneError("sobol_of: there is nothing random")
    generator = np.random.default_rng(checked_seed("sobol_of", seed))
    first, second = _two_matrices(space, n, generator)
    f_a, f_b = (_one_value_per_point(function, points) for points in (first, second))
    both = np.concatenate([f_a, f_b])
    if not np.std(both) > 1e-14 * np.abs(both).max():
        none = Estimate(math.nan, math.nan, math.nan, level)
        return {name: SobolEstimate(none, none) for name in space.groups}
    if len(space.groups) == 1:
        # the only source has the whole variance
        whole = Estimate(1.0, 1.0, 1.0, level)
        return {name: SobolEstimate(whole, whole) for name in space.groups}
    mixed = np.stack(
        [_one_value_per_point(function, p)[None] for p in _mixed_points(space, first, second)]
    )

    def indices(rows: npt.NDArray[np.intp] | slice) -> Array:
        """(2, sources): first, total."""
        found = stats.sobol_indices(
            func={"f_A": f_a[None, rows], "f_B": f_b[None, rows], "f_AB": mixed[..., rows]}, n=n
        )
        return np.array([found.first_order, found.total_order])

    values = indices(slice(None))
    drawn = np.array([indices(generator.integers(n, size=n)) for _ in range(resamples)])
    low, high = np.quantile(drawn, [0.5 * (1.0 - level), 0.5 * (1.0 + level)], axis=0)
    return {
        name: SobolEstimate(
            *(
                Estimate(float(values[i, k]), float(low[i, k]), float(high[i, k]), level)
                for i in range(2)
            )
        )
        for k, name in enumerate(space.groups)
    }


def _two_matrices(space: RandomSpace, n: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Two scrambled Sobol matrices (n, L) of points of the germs."""
    dimension = space.dimension
    uniform = sobol_points(2 * dimension, n, generator)
    return space.from_uniform(uniform[:, :dimension]), space.from_uniform(uniform[:, dimension:])


def _mixed_points(space: RandomSpace, first: Array, second: Array) -> Iterator[Array]:
    """The first matrix with the germs of one source from the second, for every source."""
    for columns in space.groups.values():
        points = first.copy()
        points[:, list(columns)] = second[:, list(columns)]
        yield points


def _one_value_per_point(function: Callable[[Array], npt.ArrayLike], points: Array) -> Array:
    """Values (n,) of a user's function at points (n, L)."""
    returned = function(points)
    values = checked_reals("sobol_of", "function(points)", returned, "return one finite number per point")
    if values.shape != (len(points),) or not np.isfinite(values).all():
        raise SceneError(
            f"sobol_of: the function returned shape {values.shape} with "
            f"{int(np.count_nonzero(~np.isfinite(values)))} values that are not finite for {len(points)} "
            "points; return one finite number per point"
        )
    return values
