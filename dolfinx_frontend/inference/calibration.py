"""Which values of its uncertain numbers fit what was measured on an assembly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_number, checked_seed, checked_whole
from dolfinx_frontend.common.deferred import interpolate, optimize, special, stats
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.evaluate.function import ProblemFunction, check_handed_on, problem_function
from dolfinx_frontend.fit.chains import Chains, walked
from dolfinx_frontend.fit.posterior import Data, Model, covariance_of, modes_of, weighted
from dolfinx_frontend.kernel.spread import check_given_alike
from dolfinx_frontend.plan.plan import check_problem
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fitting import openturns
from dolfinx_frontend.uncertainty.parameters import FromDistribution, Normal, RandomParameter
from dolfinx_frontend.uncertainty.quantities import Estimate

__all__ = ["Direction", "Fit", "Posterior", "calibrate"]

UNSEEN = 0.7
"""Posterior over prior deviation of a direction above which the data say next to nothing of it."""
FAR = 5.0
"""Deviations of the prior, and of the noise, that no explanation needs."""
MOVED = 1.0
"""Deviations of the prior by which a direction that the data say little of may move."""
NOISY = 0.1
"""Error of a solve over the noise above which it is said."""
AGREED = 1.05
"""R-hat above which chains do not agree."""
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
        Random numbers, and germs of random fields, ``"field[0]"``, which are standard normal before.
    samples, weights
        (n, numbers) values, and (n,) their probabilities, of sum 1.
    likeliest
        Random number -> value at the maximum of the posterior density of the standard normal scores.
    laplace
        Random number -> its standard deviation by a normal distribution around that point.
    effective
        Independent samples that are worth as much as the weighted ones.
    evidence
        Logarithm of the probability density of the data under the prior: it compares models; NaN of chains.
    misfit
        Root mean square of the residuals at the likeliest point, in deviations of the noise.
    directions
        Combinations of the numbers, from what the data say most of to what they say least of.
    modes
        Random number -> value at the other points at which the density has a maximum that counts.
    runs, gradients, seconds
        Points that were solved, derivatives, wall time.
    acceptance
        Of Markov chains: the share of the steps of each that were accepted.
    rhat
        Of Markov chains: random number -> how much further apart they are together than each by itself; 1:
        they agree.
    germs
        Those of the names that are germs of random fields.
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
    acceptance: tuple[float, ...] = ()
    rhat: Mapping[str, float] = field(default_factory=dict)
    germs: tuple[str, ...] = ()

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
        """The posterior as random numbers of the next scene: distributions, joined by a normal copula.

        Raises
        ------
        SceneError
            There are germs of random fields in it, which no other scene takes one by one.
        """
        germs = [name for name in self.names if name in self.germs]
        if germs:
            raise SceneError(
                f"posterior: {germs[0]} is a germ of a random field and no random number of another scene; "
                "take the samples, e.g. as points of problem.function"
            )
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
        if self.acceptance:
            shares = ", ".join(f"{100.0 * each:.0f} %" for each in self.acceptance)
            worst = max(self.rhat.values())
            lines.append(f"  {len(self.acceptance)} chains: {shares} of steps accepted, R-hat {worst:.4f}")
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
        self._of = interpolate.PchipInterpolator(self._z, self._x)
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


@together("calibrate")
def calibrate(
    problem: Problem,
    quantities: Any,
    data: npt.ArrayLike,
    noise: Any,
    method: Literal["bayes", "mcmc", "least squares"] = "bayes",
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
        posterior itself. ``"mcmc"``: the same, with Markov chains in place of weighted samples (random walk
        of OpenTURNS on the assembly, four chains from different starts). ``"least squares"``: no prior;
        `inputs` may be parameters of laws, loads and parts as well.
    inputs
        What is fitted; None: all that is random.
    samples
        Of the posterior, a power of two; each is a solve. Of chains, of all together; they have as many
        solves and a quarter more.
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
        Samples that are worth few independent ones, chains that do not agree.
    """
    where = "calibrate"
    check_problem(where, problem)
    check_known("method", method, ("bayes", "mcmc", "least squares"), where)
    check_handed_on(where, settings)
    checked_whole(where, "samples", samples, 64)
    if samples & (samples - 1):
        near = 2 ** samples.bit_length()
        raise SceneError(f"{where}: samples = {samples}: give a power of two, e.g. {near}")
    check_given_alike(
        problem,
        where,
        settings.get("points_comm"),
        quantities=quantities,
        data=data,
        noise=noise,
        method=method,
        inputs=inputs,
        samples=samples,
        seed=seed,
    )
    generator = np.random.default_rng(checked_seed(where, seed))
    bayes = method != "least squares"
    if method == "mcmc":
        openturns()  # before any work
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
            "one in the scene, or method='least squares'"
        )
    try:
        known = Data.of(function.outputs, data, noise)
        if not bayes:
            return _least_squares(function, known)
        return _bayes(function, known, samples, generator, method == "mcmc")
    finally:
        function.close()


def _least_squares(function: ProblemFunction, data: Data) -> Fit:
    origin = function.nominal
    scale = np.where(origin != 0.0, np.abs(origin), 1.0)
    for k, name in enumerate(function.inputs):
        std = getattr(function._inputs.random.space._sources.get(name), "std", None)
        scale[k] = std if std else scale[k]
    model = Model(function, data, scale, origin)
    start, first = np.zeros(len(origin)), function(origin)
    try:
        found = optimize.least_squares(model.residuals, start, jac=model.slopes, xtol=1e-10, ftol=1e-12)
    except SceneError as error:
        told = _unit(first, data.means).replace(": they", "; the data")
        raise SceneError(f"calibrate: on the way to the data: {error}{told}") from error
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
        raise SceneError(
            f"calibrate: no values fit the data ({misfit:.3g} deviations of the noise off){told}"
        )
    if told := _unit(first, data.means):
        warn(f"calibrate: the data{told.removeprefix(': they')}", SceneWarning)
    _check_errors(function, data, values)
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


def _check_errors(function: ProblemFunction, data: Data, x: Array) -> None:
    """Warn of a noise that the solves themselves have."""
    found = function.evaluate(x[None])
    error = float(found.error[0]) * np.abs(found.values[0])
    for name, own, noise in zip(function.outputs, error, data.noise, strict=True):
        if own > NOISY * noise:
            enough = max(function.plan.options.rtol * NOISY * noise / own, 1e-13)
            warn(
                f"calibrate: the error of a solve, about {own:.2g} of {name}, is not small beside the noise "
                f"of its mean, {noise:.2g}: give options=Options(rtol={enough:.0e}), or a noise that "
                "includes what the model leaves out",
                SceneWarning,
            )


def _told(predicted: Array, means: Array, of: str) -> str:
    shown, given = (np.array2string(each, precision=4) for each in (means, predicted))
    return f": the data are {shown}, {of} give {given}"


def _bayes(
    function: ProblemFunction, data: Data, count: int, generator: np.random.Generator, chained: bool
) -> Posterior:
    began = perf_counter()
    dimension = function.dimension
    model = Model(function, data, np.ones(dimension), np.zeros(dimension))
    first = function(np.zeros(dimension))

    modes = modes_of(model, generator)
    u, rest, jacobian = modes[0]
    misfit = float(np.sqrt(np.mean(rest**2)))
    distance = float(np.linalg.norm(u))
    if misfit > FAR or distance > FAR * math.sqrt(max(1.0, dimension / 4.0)):
        raise SceneError(
            f"calibrate: the prior excludes the data: the best point is {distance:.3g} deviations from its "
            f"median, and {misfit:.3g} deviations of the noise from the data"
            + (_unit(first, data.means) or _told(first, data.means, "the medians of the priors"))
        )
    if told := _unit(first, data.means):
        warn(f"calibrate: the data{told.removeprefix(': they')}", SceneWarning)
    _check_errors(function, data, u)
    inverse = covariance_of(jacobian)
    peaks = [(each, covariance_of(slopes)) for each, _, slopes in modes]
    chains: Chains | None = None
    scores: Array
    weights: Array
    if chained:
        chains = walked(model.log_density, peaks, count, generator)
        scores, evidence = chains.scores.reshape(-1, dimension), math.nan
        weights = np.full(len(scores), 1.0 / len(scores))
    else:
        scores, weights, evidence = weighted(model, peaks, count, generator)
    effective = float(1.0 / np.sum(weights**2))
    chosen = {germ for germ in function.inputs}
    space = function._inputs.random.space
    known = set(function._inputs.values(scores[:1]))
    of_fields = [
        germ
        for source in space.names if source not in known
        for column in space.columns(space._sources[source]) if (germ := space.germ_names[column]) in chosen
    ]  # fmt: skip

    def numbers(u: Array) -> dict[str, Array]:
        """Random numbers and germs of fields at scores (N, L), (N,) each."""
        own = {germ: np.asarray(u[:, function.inputs.index(germ)]) for germ in of_fields}
        return {**function._inputs.values(u), **own}

    values = numbers(scores)
    names = [n for n in known if chosen & {space.germ_names[c] for c in space.columns(space._sources[n])}]
    names = [n for n in values if n in names or n in of_fields]
    rhat: dict[str, float] = {}
    if chains is not None:
        for name in names:
            rhat[name], own = chains.agreement(values[name].reshape(chains.scores.shape[:2]))
            effective = min(effective, own)
        if max(rhat.values()) > AGREED:
            warn(
                f"calibrate: the chains do not agree (R-hat {max(rhat.values()):.3f}): raise samples=, or "
                "use method='bayes'",
                SceneWarning,
            )
    if effective < 50.0:
        kind = "samples of chains" if chains is not None else "weighted samples"
        warn(
            f"calibrate: {len(weights)} {kind} are worth {effective:.0f} independent ones: raise samples=",
            SceneWarning,
        )
    away = 1e-4 * np.eye(dimension)
    around = numbers(np.vstack([u, u + away, u - away]))
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
        {name: Normal(name, 0.0, std=1.0) if name in of_fields else space._sources[name] for name in names},
        tuple(
            {name: float(numbers(each[None])[name][0]) for name in names}
            for each, _, _ in modes[1:]
        ),
        () if chains is None else tuple(float(each) for each in chains.acceptance),
        rhat,
        tuple(of_fields),
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
