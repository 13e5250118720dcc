"""Which values of its uncertain numbers fit what was measured on an assembly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize, special, stats
from scipy.interpolate import PchipInterpolator

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_number, checked_seed, checked_whole
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.inference.function import ProblemFunction, check_handed_on, problem_function
from dolfinx_frontend.plan.plan import check_problem
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.parameters import FromDistribution, RandomParameter
from dolfinx_frontend.uncertainty.quantities import Estimate
from dolfinx_frontend.uncertainty.space import sobol_points

__all__ = ["Direction", "Fit", "Posterior", "calibrate"]

UNSEEN = 0.7
"""Posterior over prior deviation of a direction above which the data say next to nothing of it."""
FAR = 5.0
"""Deviations of the prior, and of the noise, that no explanation needs."""
TAILS = 5.0
"""Degrees of freedom of the density from which samples are drawn: tails heavier than any posterior's."""
WIDER = 1.15
POOR = 0.2
"""Effective share of samples below which another density is fitted to them."""
ROUNDS = 12
TRIED, STARTS = 64, 3
"""Points of the prior that are tried for further modes, and how many of them are searched from."""
LOWEST = 12.0
"""Logarithm of the density by which a mode may be below the highest."""
LEAST_SHARE = 0.2
CENTRES = 128
"""Samples around which the next are drawn."""
MOVED = 1.0
"""Deviations of the prior by which a direction that the data say little of may move."""
UNIT = 1.5
"""Data that are 1000 times the prediction but for this factor look like a wrong unit."""


@dataclass(frozen=True)
class Direction:
    """A combination of uncertain numbers, in deviations of their priors.

    Attributes
    ----------
    weights
        Random number -> its share in the direction, squares of sum 1.
    seen
        Posterior over prior deviation along it: 1, the data say nothing.
    moved
        Deviations of the prior by which the likeliest point lies along it.
    """

    weights: Mapping[str, float]
    seen: float
    moved: float = 0.0

    def __str__(self) -> str:
        parts = sorted(self.weights.items(), key=lambda each: -abs(each[1]))
        large = [(name, w) for name, w in parts if abs(w) > 0.2]
        shown = " ".join(f"{'+' if w > 0 else '-'} {abs(w):.2g} {name}" for name, w in large)
        return shown.removeprefix("+ ")


@dataclass(frozen=True, repr=False)
class Fit:
    """Least squares.

    Attributes
    ----------
    values, std
        Input -> value, and its standard deviation by the linearised model and the noise; infinite: the data
        do not see it.
    predicted
        (quantities,) at these values.
    misfit
        Root mean square of the residuals in deviations of the noise.
    unseen
        Directions that the data do not determine.
    runs
        Points that were solved.
    """

    values: Mapping[str, float]
    std: Mapping[str, float]
    predicted: Array
    misfit: float
    unseen: tuple[Direction, ...]
    runs: int

    def __repr__(self) -> str:
        lines = [f"Fit: misfit {self.misfit:.3g} deviations of the noise, {self.runs} solves"]
        lines += [f"  {name} = {value:.6g} +- {self.std[name]:.2g}" for name, value in self.values.items()]
        lines += [f"  not determined by the data: {each}" for each in self.unseen]
        return "\n".join(lines)


@dataclass(frozen=True, repr=False)
class Posterior:
    """What is known of uncertain numbers once data are.

    Attributes
    ----------
    names
        Random numbers.
    samples, weights
        (n, numbers) values, and (n,) their probabilities, of sum 1.
    likeliest
        Random number -> value at the maximum of the posterior density of the standard normal scores.
    laplace
        Random number -> its standard deviation by a normal distribution around that point.
    effective
        Independent samples that are worth as much as the weighted ones.
    evidence
        Logarithm of the probability density of the data under the prior: it compares models.
    misfit
        Root mean square of the residuals at the likeliest point, in deviations of the noise.
    directions
        Combinations of the numbers, from what the data say most of to what they say least of.
    modes
        Random number -> value at the other points at which the density has a maximum that counts.
    runs, gradients, seconds
        Points that were solved, derivatives, wall time.
    """

    names: tuple[str, ...]
    samples: Array
    weights: Array
    likeliest: Mapping[str, float]
    laplace: Mapping[str, float]
    effective: float
    evidence: float
    misfit: float
    directions: tuple[Direction, ...]
    runs: int
    gradients: int
    seconds: float
    priors: Mapping[str, Any] = field(default_factory=dict)
    modes: tuple[Mapping[str, float], ...] = ()

    @property
    def unseen(self) -> tuple[Direction, ...]:
        """Directions of which the data say next to nothing: there the posterior is the prior."""
        return tuple(each for each in self.directions if each.seen > UNSEEN and abs(each.moved) < MOVED)

    def _column(self, name: str) -> Array:
        check_known("random number", name, self.names, "posterior")
        return np.asarray(self.samples[:, self.names.index(name)])

    def mean(self, name: str, level: float = 0.95) -> Estimate:
        """Expectation of a number; the interval is the error of the sampling."""
        checked_number("posterior", "level", level, above=0.0, below=1.0)
        values = self._column(name)
        mean = float(self.weights @ values)
        half = float(stats.norm.isf(0.5 * (1.0 - level))) * self.std(name) / math.sqrt(self.effective)
        return Estimate(mean, mean - half, mean + half, level)

    def std(self, name: str) -> float:
        """Standard deviation of a number."""
        values = self._column(name)
        mean = float(self.weights @ values)
        return math.sqrt(float(self.weights @ (values - mean) ** 2))

    def quantile(self, name: str, q: float) -> float:
        """The value that a number is below with probability `q`."""
        checked_number("posterior", "q", q, above=0.0, below=1.0)
        values = self._column(name)
        order = np.argsort(values)
        below = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        return float(np.interp(q, below, values[order]))

    @property
    def correlation(self) -> Array:
        """(numbers, numbers)."""
        centred = self.samples - self.weights @ self.samples
        block = centred.T @ (self.weights[:, None] * centred)
        size = np.sqrt(np.diag(block))
        return np.asarray(block / np.outer(size, size))

    def random(self) -> dict[str, RandomParameter]:
        """The posterior as random numbers of the next scene: distributions, joined by a normal copula."""
        laws = {name: _Smoothed(self._column(name), self.weights) for name in self.names}
        single = {name: FromDistribution(name, law, germ="normal") for name, law in laws.items()}
        if len(single) == 1:
            return single
        scores = np.column_stack([laws[name].scores(self._column(name)) for name in self.names])
        centred = scores - self.weights @ scores
        block = centred.T @ (self.weights[:, None] * centred)
        size = np.sqrt(np.diag(block))
        matrix = np.clip(block / np.outer(size, size), -0.999, 0.999)
        np.fill_diagonal(matrix, 1.0)
        joined = Correlated(list(single.values()), matrix, space="normal")
        return dict(zip(self.names, joined, strict=True))

    def __repr__(self) -> str:
        lines = [
            f"Posterior of {len(self.weights)} samples worth {self.effective:.0f} independent ones; misfit "
            f"{self.misfit:.3g} deviations of the noise; {self.runs} solves, {self.gradients} gradients, "
            f"{self.seconds:.2f} s"
        ]
        for name in self.names:
            low, high = self.quantile(name, 0.025), self.quantile(name, 0.975)
            before = self.priors.get(name)
            told = f", before {before.mean:.5g} +- {before.std:.3g}" if before is not None else ""
            lines.append(
                f"  {name} = {self.mean(name).value:.6g} +- {self.std(name):.3g} "
                f"[{low:.5g}, {high:.5g}] (95 %){told}"
            )
        for mode in self.modes:
            at = ", ".join(f"{name} = {value:.5g}" for name, value in mode.items())
            lines.append(f"  there is another maximum, at {at}")
        lines += [f"  the data say next to nothing of {each}" for each in self.unseen]
        return "\n".join(lines)


class _Smoothed:
    """The distribution of weighted samples, smooth, with normal tails, spelt as scipy's random variables."""

    def __init__(self, values: Array, weights: Array) -> None:
        order = np.argsort(values, kind="stable")
        below = np.clip(np.cumsum(weights[order]) - 0.5 * weights[order], 1e-12, 1.0 - 1e-12)
        z = special.ndtri(below)
        grid = np.linspace(-3.0, 3.0, 25)
        knots = np.interp(grid, z, values[order])
        keep = np.concatenate([[True], np.diff(knots) > 1e-12 * np.abs(knots).max()])
        self._z, self._x = grid[keep], knots[keep]
        self._of = PchipInterpolator(self._z, self._x)
        ends = self._of.derivative()(self._z[[0, -1]])
        self._slopes = np.maximum(ends, 1e-3 * np.ptp(self._x) / np.ptp(self._z))
        self._fine = np.linspace(self._z[0], self._z[-1], 4001)
        self._at = self._of(self._fine)
        self._mean = float(weights @ values)
        self._std = math.sqrt(float(weights @ (values - self._mean) ** 2))
        self._told = f"samples around {self._mean:.12g} +- {self._std:.12g}"

    def __repr__(self) -> str:
        return self._told

    def _quantile(self, z: Any) -> Array:
        z = np.asarray(z, dtype=np.float64)
        inside = self._of(np.clip(z, self._z[0], self._z[-1]))
        low, high = np.minimum(z - self._z[0], 0.0), np.maximum(z - self._z[-1], 0.0)
        return np.asarray(inside + self._slopes[0] * low + self._slopes[1] * high)

    def scores(self, x: Any) -> Array:
        """Normal scores of values."""
        x = np.asarray(x, dtype=np.float64)
        inside = np.interp(x, self._at, self._fine)
        low, high = np.minimum(x - self._x[0], 0.0), np.maximum(x - self._x[-1], 0.0)
        return np.asarray(inside + low / self._slopes[0] + high / self._slopes[1])

    def icdf(self, p: Any) -> Array:
        return self._quantile(special.ndtri(np.asarray(p, dtype=np.float64)))

    def iccdf(self, p: Any) -> Array:
        return self._quantile(-special.ndtri(np.asarray(p, dtype=np.float64)))

    def cdf(self, x: Any) -> Array:
        return np.asarray(special.ndtr(self.scores(x)))

    def ccdf(self, x: Any) -> Array:
        return np.asarray(special.ndtr(-self.scores(x)))

    def pdf(self, x: Any) -> Array:
        z = self.scores(x)
        step = 1e-4
        slope = (self._quantile(z + step) - self._quantile(z - step)) / (2.0 * step)
        return np.asarray(stats.norm.pdf(z) / slope)

    def mean(self) -> float:
        return self._mean

    def standard_deviation(self) -> float:
        return self._std

    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf


@dataclass(frozen=True, eq=False)
class _Data:
    """Measurements: their means, and what noise these have."""

    means: Array  # (quantities,)
    noise: Array  # (quantities,) of the means
    constant: float  # of the logarithm of the likelihood, beside the means'

    @classmethod
    def of(cls, outputs: Sequence[str], data: npt.ArrayLike, noise: Any) -> _Data:
        where = "calibrate"
        try:
            values = np.array(data, dtype=np.float64)
        except (TypeError, ValueError):
            raise SceneError(f"{where}: data = {short(data)}; give numbers, a column per quantity") from None
        count = len(outputs)
        if values.ndim < 2:
            values = values.reshape(-1, 1) if count == 1 else values.reshape(1, -1)
        if values.ndim != 2 or values.shape[1] != count or not values.size:
            raise SceneError(
                f"{where}: data of shape {np.shape(data)} for {count} quantities ({', '.join(outputs)}): "
                "give a row "
                "per measurement, a column per quantity, NaN where nothing was measured"
            )
        if np.any(np.isinf(values)):
            raise SceneError(f"{where}: data: infinite; give finite numbers, NaN where nothing was measured")
        given = noise
        if isinstance(noise, Mapping):
            for name in noise:
                check_known("quantity", name, outputs, f"{where}: noise")
            absent = [name for name in outputs if name not in noise]
            if absent:
                raise SceneError(f"{where}: noise: none for {', '.join(absent)}: give its standard deviation")
            given = [noise[name] for name in outputs]
        try:
            deviation = np.broadcast_to(np.array(given, dtype=np.float64), (count,))
        except (TypeError, ValueError):
            raise SceneError(
                f"{where}: noise = {short(noise)}: give one standard deviation, or one per quantity"
            ) from None
        for name, each in zip(outputs, deviation, strict=True):
            if not (each > 0.0 and math.isfinite(each)):
                raise SceneError(
                    f"{where}: noise of {name} = {each:g}: give a standard deviation > 0, that of the "
                    "measurement and "
                    "of what the model leaves out"
                )
        counts = np.sum(~np.isnan(values), axis=0)
        if np.any(counts == 0):
            raise SceneError(
                f"{where}: nothing was measured of {outputs[int(np.argmin(counts))]}: leave the quantity out"
            )
        means = np.nanmean(values, axis=0)
        scatter = np.nansum((values - means) ** 2, axis=0) / deviation**2
        constant = -0.5 * float(np.sum(scatter + counts * np.log(2.0 * math.pi * deviation**2)))
        return cls(means, deviation / np.sqrt(counts), constant)

    def residuals(self, values: Array) -> Array:
        """(N, quantities), or (quantities,), in deviations of the noise of the means."""
        return np.asarray((values - self.means) / self.noise)


@together("calibrate")
def calibrate(
    problem: Problem,
    quantities: Any,
    data: npt.ArrayLike,
    noise: Any,
    method: Literal["bayes", "least squares"] = "bayes",
    *,
    inputs: Sequence[str] | str | None = None,
    samples: int = 2048,
    seed: int = 0,
    **settings: Any,
) -> Posterior | Fit:
    """Fit uncertain numbers of a problem to measurements, on the assembly itself.

    Parameters
    ----------
    quantities
        What was measured, as :meth:`Problem.function` takes it.
    data
        (quantities,), or (measurements, quantities); of one quantity (measurements,). NaN: not measured.
    noise
        Standard deviation of a measurement, one for all or one per quantity, in its unit; independent and
        normal.
    method
        ``"bayes"``: the random numbers of the problem are the prior. The maximum of the posterior by
        Gauss-Newton with derivatives, a normal distribution there (Laplace), and weighted samples of the
        posterior itself. ``"least squares"``: no prior; `inputs` may be parameters of laws, loads and parts
        as well.
    inputs
        What is fitted; None: all that is random.
    samples
        Of the posterior, a power of two; each is a solve.
    seed
        Of the random numbers.
    settings
        active, direction, options, plan, times: as for :func:`solve`. checkpoint: a file of the points that
        were solved; the same call goes on with it, with the same digits.

    Raises
    ------
    SceneError
        Data of a wrong shape, noise that is not positive, nothing to fit, or a prior that excludes the data;
        data that look like another unit are said to.

    Warns
    -----
    SceneWarning
        Weighted samples that are worth few independent ones.
    """
    where = "calibrate"
    check_problem(where, problem)
    check_known("method", method, ("bayes", "least squares"), where)
    check_handed_on(where, settings)
    checked_whole(where, "samples", samples, 64)
    if samples & (samples - 1):
        near = 2 ** samples.bit_length()
        raise SceneError(f"{where}: samples = {samples}: give a power of two, e.g. {near}")
    generator = np.random.default_rng(checked_seed(where, seed))
    bayes = method == "bayes"
    function = problem_function(
        problem,
        quantities,
        inputs,
        coordinates="normal" if bayes else "physical",
        on_failure="raise",
        **settings,
    )
    if bayes and function._inputs.direct:
        raise SceneError(
            f"{where}: {next(iter(function._inputs.direct))} is no random number: it has no prior; give it "
            "one in the "
            "scene, or method='least squares'"
        )
    try:
        known = _Data.of(function.outputs, data, noise)
        return _bayes(function, known, samples, generator) if bayes else _least_squares(function, known)
    finally:
        function.close()


class _Model:
    """Residuals and their derivatives at points, counted."""

    def __init__(self, function: ProblemFunction, data: _Data, scale: Array, origin: Array) -> None:
        self.function, self.data, self.scale, self.origin = function, data, scale, origin
        self.gradients = 0

    def residuals(self, t: Array) -> Array:
        return self.data.residuals(self.function(self.origin + self.scale * t))

    def slopes(self, t: Array) -> Array:
        self.gradients += 1
        found = self.function.derivatives(self.origin + self.scale * t).values * self.scale
        return np.asarray(found / self.data.noise[:, None])


def _least_squares(function: ProblemFunction, data: _Data) -> Fit:
    origin = function.nominal
    scale = np.where(origin != 0.0, np.abs(origin), 1.0)
    for k, name in enumerate(function.inputs):
        std = getattr(function._inputs.random.space._sources.get(name), "std", None)
        scale[k] = std if std else scale[k]
    model = _Model(function, data, scale, origin)
    start, first = np.zeros(len(origin)), function(origin)
    found = optimize.least_squares(model.residuals, start, jac=model.slopes, xtol=1e-10, ftol=1e-12)
    jacobian = np.asarray(found.jac)
    _, sizes, right = np.linalg.svd(jacobian, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(origin) - len(sizes))])
    blind = sizes <= 1e-6 * max(sizes.max(), 1e-300)
    inverse = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=~blind)
    std = scale * np.sqrt(np.sum((inverse[:, None] * right) ** 2, axis=0))
    std[np.sum(right[blind] ** 2, axis=0) > 1e-3] = math.inf
    unseen = tuple(
        Direction(dict(zip(function.inputs, each.tolist(), strict=True)), 1.0) for each in right[blind]
    )
    values = origin + scale * found.x
    misfit = math.sqrt(2.0 * float(found.cost) / len(data.means))
    if misfit > FAR:
        told = _unit(first, data.means) or _told(first, data.means, "the values of the scene")
        raise SceneError(f"calibrate: no values fit the data ({misfit:.3g} deviations of the noise off){told}")
    if told := _unit(first, data.means):
        warn(f"calibrate: the data{told.removeprefix(': they')}", SceneWarning)
    return Fit(
        dict(zip(function.inputs, values.tolist(), strict=True)),
        dict(zip(function.inputs, std.tolist(), strict=True)),
        function(values),
        misfit,
        unseen,
        function.solves,
    )


def _unit(predicted: Array, means: Array) -> str:
    """What is said where data look like another unit, or nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.nanmedian(np.abs(means) / np.abs(predicted)))
    for factor in (1e3, 1e-3, 1e6, 1e-6):
        if ratio > 0.0 and factor / UNIT < ratio < factor * UNIT:
            times = f"{factor:g} times" if factor > 1.0 else f"1/{1.0 / factor:g} of"
            return f": they are about {times} the prediction: are they in the units of the scene?"
    return ""


def _told(predicted: Array, means: Array, of: str) -> str:
    shown, given = (np.array2string(each, precision=4) for each in (means, predicted))
    return f": the data are {shown}, {of} give {given}"


def _bayes(function: ProblemFunction, data: _Data, count: int, generator: np.random.Generator) -> Posterior:
    began = perf_counter()
    dimension = function.dimension
    model = _Model(function, data, np.ones(dimension), np.zeros(dimension))
    first = function(np.zeros(dimension))

    modes = _modes(model, generator)
    u, rest, jacobian = modes[0]
    misfit = float(np.sqrt(np.mean(rest**2)))
    distance = float(np.linalg.norm(u))
    if misfit > FAR or distance > FAR * math.sqrt(max(1.0, dimension / 4.0)):
        raise SceneError(
            f"calibrate: the prior excludes the data: the best point is {distance:.3g} deviations from its "
            "median, and "
            f"{misfit:.3g} deviations of the noise from the data"
            + (_unit(first, data.means) or _told(first, data.means, "the medians of the priors"))
        )
    if told := _unit(first, data.means):
        warn(f"calibrate: the data{told.removeprefix(': they')}", SceneWarning)
    inverse = _covariance(jacobian)
    peaks = [(each, _covariance(slopes)) for each, _, slopes in modes]
    scores, weights, evidence = _weighted(model, peaks, count, generator)
    effective = float(1.0 / np.sum(weights**2))
    if effective < 50.0:
        warn(
            f"calibrate: {len(weights)} weighted samples are worth {effective:.0f} independent ones: raise "
            "samples=",
            SceneWarning,
        )
    values = function._inputs.values(scores)
    chosen = {germ for germ in function.inputs}
    space = function._inputs.random.space
    names = [
        n for n in values if chosen & {space.germ_names[c] for c in space.columns(space._sources[n])}
    ]
    away = 1e-4 * np.eye(dimension)
    around = function._inputs.values(np.vstack([u, u + away, u - away]))
    laplace = {}
    for name in names:
        slope = (around[name][1 : dimension + 1] - around[name][dimension + 1 :]) / 2e-4
        laplace[name] = math.sqrt(float(slope @ inverse @ slope))
    return Posterior(
        tuple(names),
        np.column_stack([values[name] for name in names]),
        weights,
        {name: float(around[name][0]) for name in names},
        laplace,
        effective,
        evidence + data.constant,
        misfit,
        _directions(function.inputs, jacobian, u),
        function.solves,
        model.gradients,
        perf_counter() - began,
        {name: space._sources[name] for name in names},
        tuple(
            {name: float(function._inputs.values(each[None])[name][0]) for name in names}
            for each, _, _ in modes[1:]
        ),
    )


def _directions(names: Sequence[str], jacobian: Array, u: Array) -> tuple[Direction, ...]:
    """Right singular vectors of the derivatives in deviations of prior and noise."""
    _, sizes, right = np.linalg.svd(jacobian, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(names) - len(sizes))])
    return tuple(
        Direction(
            dict(zip(names, (v * np.sign(v[np.abs(v).argmax()])).tolist(), strict=True)),
            float(1.0 / math.sqrt(1.0 + s * s)),
            float(u @ v * np.sign(v[np.abs(v).argmax()])),
        )
        for s, v in zip(sizes, right, strict=True)
    )


@dataclass(frozen=True, eq=False)
class _Peaks:
    """A mixture of Student's t distributions, from which samples are drawn."""

    centres: list[Array]
    factors: list[Array]  # lower triangular
    shares: Array

    @classmethod
    def of(cls, centres: Sequence[Array], covariances: Sequence[Array], shares: Array) -> _Peaks:
        factors = [linalg.cholesky(WIDER**2 * each, lower=True) for each in covariances]
        return cls(list(centres), factors, shares / shares.sum())

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, Array]:
        """Samples (count, L), and the logarithm of their density (count,)."""
        dimension = len(self.centres[0])
        unit = sobol_points(dimension + 2, count, generator)
        unit = np.clip(unit, 2.0**-54, 1.0 - 2.0**-54)
        stretch = np.sqrt(TAILS / stats.chi2(TAILS).ppf(unit[:, dimension]))
        offsets = special.ndtri(unit[:, :dimension]) * stretch[:, None]
        which = np.minimum(np.searchsorted(np.cumsum(self.shares), unit[:, -1]), len(self.shares) - 1)
        scores = np.empty((count, dimension))
        for k, (centre, factor) in enumerate(zip(self.centres, self.factors, strict=True)):
            scores[which == k] = centre + offsets[which == k] @ factor.T
        law = stats.multivariate_t(np.zeros(dimension), np.eye(dimension), df=TAILS)
        logs = [
            np.reshape(law.logpdf(linalg.solve_triangular(factor, (scores - centre).T, lower=True).T), -1)
            - float(np.log(np.diag(factor)).sum())
            for centre, factor in zip(self.centres, self.factors, strict=True)
        ]
        return scores, np.asarray(special.logsumexp(np.stack(logs, axis=1), b=self.shares, axis=1))


def _weighted(
    model: _Model, modes: Sequence[tuple[Array, Array]], count: int, generator: np.random.Generator
) -> tuple[Array, Array, float]:
    """Samples (n, L) of the posterior with weights (n,) of sum 1, and the logarithm of the evidence (of the
    means).

    From Student's t distributions around the modes (points and covariances); where these do little, around
    samples of the round before, each as wide as the data leave it there: a ridge is followed.
    """
    dimension = len(modes[0][0])
    heights = np.array([-0.5 * float(u @ u + np.sum(model.residuals(u) ** 2)) for u, _ in modes])
    heights += [0.5 * np.linalg.slogdet(covariance)[1] for _, covariance in modes]
    shares = np.maximum(special.softmax(heights), LEAST_SHARE / len(modes))
    peaks = _Peaks.of([u for u, _ in modes], [c for _, c in modes], shares)
    first = _Round(model, peaks, count, generator)
    if first.effective > POOR * count:
        return first.told(1.0)
    # a ridge: from the prior on, with ever less noise, around samples of the round before
    noise, rounds = math.inf, [first]
    now = _Round(model, _Peaks.of([np.zeros(dimension)], [np.eye(dimension)], np.ones(1)), count, generator)
    for _ in range(ROUNDS):
        noise = now.next_noise(noise)
        centres, weights = now.centres(noise, generator), now.weights(noise)
        around = [_along(_covariance(model.slopes(u) / noise)) for u in centres]
        middle = weights @ now.scores
        away = now.scores - middle
        spread = away.T @ (weights[:, None] * away) + 1e-6 * np.eye(dimension)
        shares = np.concatenate([np.full(len(centres), 0.9 / len(centres)), [0.1]])
        now = _Round(model, _Peaks.of([*centres, middle], [*around, spread], shares), count, generator)
        if noise <= 1.0:
            rounds.append(now)
            if len(rounds) > 2:
                break
    best = max(rounds, key=lambda each: each.effective)
    return best.told(1.0)


class _Round:
    """Samples from a density, with what they are worth for noise that is so many times the given one."""

    def __init__(self, model: _Model, peaks: _Peaks, count: int, generator: np.random.Generator) -> None:
        self.scores, log_density = peaks.draw(count, generator)
        dimension = self.scores.shape[1]
        self._rest = np.sum(model.residuals(self.scores) ** 2, axis=1)
        self._logs = -0.5 * np.sum(self.scores**2, axis=1) - log_density
        self._logs -= 0.5 * dimension * math.log(2.0 * math.pi)

    def weights(self, noise: float = 1.0) -> Array:
        """(n,) of sum 1."""
        return np.asarray(special.softmax(self._logs - 0.5 * self._rest / noise**2))

    @property
    def effective(self) -> float:
        """Independent samples that they are worth."""
        return float(1.0 / np.sum(self.weights() ** 2))

    def next_noise(self, noise: float) -> float:
        """The least noise, not below the given one, for which they are worth a twentieth of their number."""
        high, low = min(noise, 1e6), 1.0

        def enough(each: float) -> bool:
            return bool(1.0 / np.sum(self.weights(each) ** 2) > 0.05 * len(self._rest))

        if enough(low):
            return low
        for _ in range(30):
            middle = math.sqrt(high * low)
            high, low = (middle, low) if enough(middle) else (high, middle)
        return max(1.0, min(high, 0.8 * noise))

    def centres(self, noise: float, generator: np.random.Generator) -> list[Array]:
        """Some of them, by chance, more at the ends than they are worth."""
        logs = self._logs - 0.5 * self._rest / noise**2 + 0.25 * np.sum(self.scores**2, axis=1)
        chosen = generator.choice(len(self.scores), CENTRES, p=special.softmax(logs))
        return list(self.scores[np.unique(chosen)])

    def told(self, noise: float) -> tuple[Array, Array, float]:
        """Samples, weights, and the logarithm of the evidence."""
        logs = self._logs - 0.5 * self._rest / noise**2
        return self.scores, self.weights(noise), float(special.logsumexp(logs)) - math.log(len(logs))


def _along(covariance: Array) -> Array:
    """No longer than a ridge of unit curvature stays within its width."""
    sizes, turn = np.linalg.eigh(covariance)
    longest = max(2.0 * math.sqrt(float(sizes[0])), 1e-8)
    return np.asarray((turn * np.minimum(sizes, longest)) @ turn.T)


def _covariance(jacobian: Array) -> Array:
    """Laplace's, of scores with a standard normal prior and residuals of unit noise."""
    return np.asarray(linalg.inv(np.eye(jacobian.shape[1]) + jacobian.T @ jacobian))


def _modes(model: _Model, generator: np.random.Generator) -> list[tuple[Array, Array, Array]]:
    """Likeliest points, their residuals and derivatives, the likeliest first.

    Searched from the median, and from those points of the prior that fit best and lie apart.
    """
    dimension = model.function.dimension

    def residuals(u: Array) -> Array:
        return np.concatenate([u, model.residuals(u)])

    def slopes(u: Array) -> Array:
        return np.vstack([np.eye(dimension), model.slopes(u)])

    def search(start: Array) -> tuple[float, Array, Array, Array]:
        found = optimize.least_squares(residuals, start, jac=slopes, xtol=1e-9, ftol=1e-12)
        rest, jacobian = np.asarray(found.fun)[dimension:], np.asarray(found.jac)[dimension:]
        return float(found.cost), np.asarray(found.x), rest, jacobian

    unit = np.clip(sobol_points(dimension, TRIED, generator), 1e-6, 1.0 - 1e-6)
    tried = special.ndtri(unit)
    costs = np.sum(tried**2, axis=1) + np.sum(model.residuals(tried) ** 2, axis=1)
    found = [search(np.zeros(dimension))]
    starts: list[Array] = [found[0][1]]
    for k in np.argsort(costs):
        if len(starts) > STARTS:
            break
        if min(float(np.linalg.norm(tried[k] - each)) for each in starts) > 1.0:
            starts.append(tried[k])
            found.append(search(tried[k]))
    found.sort(key=lambda each: each[0])
    kept: list[tuple[float, Array, Array, Array]] = []
    for each in found:
        known = (float((each[1] - k[1]) @ linalg.solve(_covariance(k[3]), each[1] - k[1])) for k in kept)
        if each[0] < found[0][0] + LOWEST and all(distance > 1.0 for distance in known):
            kept.append(each)
    return [(u, rest, jacobian) for _, u, rest, jacobian in kept]
