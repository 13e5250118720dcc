"""Measured data, the model beside them, and samples of what they leave of uncertain numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import linalg, optimize, special, stats
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.uncertainty.space import sobol_points

__all__ = ["Data", "Function", "Model", "covariance_of", "modes_of", "weighted"]

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


class Slopes(Protocol):
    """Derivatives at a point."""

    @property
    def values(self) -> Array:
        """(quantities, inputs)."""


class Function(Protocol):
    """A model of what was measured; :class:`dolfinx_frontend.ProblemFunction` is one."""

    @property
    def dimension(self) -> int:
        """Number of inputs."""

    def __call__(self, x: Array) -> Array:
        """Quantities (N, quantities) at points (N, inputs), or (quantities,) at one (inputs,)."""

    def derivatives(self, x: Array) -> Slopes:
        """At a point (inputs,)."""


@dataclass(frozen=True, eq=False)
class Data:
    """Measurements: their means, and what noise these have."""

    means: Array  # (quantities,)
    noise: Array  # (quantities,) of the means
    constant: float  # of the logarithm of the likelihood, beside the means'

    @classmethod
    def of(cls, outputs: Sequence[str], data: npt.ArrayLike, noise: Any) -> Data:
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


class Model:
    """Residuals and their derivatives at points, counted."""

    def __init__(self, function: Function, data: Data, scale: Array, origin: Array) -> None:
        self.function, self.data, self.scale, self.origin = function, data, scale, origin
        self.gradients = 0

    def residuals(self, t: Array) -> Array:
        return self.data.residuals(self.function(self.origin + self.scale * t))

    def log_density(self, t: Array) -> float:
        """Of standard normal scores (L,), up to a constant."""
        return -0.5 * float(t @ t + np.sum(self.residuals(t) ** 2))

    def slopes(self, t: Array) -> Array:
        self.gradients += 1
        found = self.function.derivatives(self.origin + self.scale * t).values * self.scale
        return np.asarray(found / self.data.noise[:, None])


@dataclass(frozen=True, eq=False)
class Peaks:
    """A mixture of Student's t distributions, from which samples are drawn."""

    centres: list[Array]
    factors: list[Array]  # lower triangular
    shares: Array

    @classmethod
    def of(cls, centres: Sequence[Array], covariances: Sequence[Array], shares: Array) -> Peaks:
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


def weighted(
    model: Model, modes: Sequence[tuple[Array, Array]], count: int, generator: np.random.Generator
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
    peaks = Peaks.of([u for u, _ in modes], [c for _, c in modes], shares)
    first = Round(model, peaks, count, generator)
    if first.effective > POOR * count:
        return first.told(1.0)
    # a ridge: from the prior on, with ever less noise, around samples of the round before
    noise, rounds = math.inf, [first]
    now = Round(model, Peaks.of([np.zeros(dimension)], [np.eye(dimension)], np.ones(1)), count, generator)
    for _ in range(ROUNDS):
        noise = now.next_noise(noise)
        centres, weights = now.centres(noise, generator), now.weights(noise)
        slopes = [np.asarray(model.slopes(u) / noise, dtype=np.float64) for u in centres]
        around = [_along(covariance_of(each)) for each in slopes]
        middle = weights @ now.scores
        away = now.scores - middle
        spread = away.T @ (weights[:, None] * away) + 1e-6 * np.eye(dimension)
        shares = np.concatenate([np.full(len(centres), 0.9 / len(centres)), [0.1]])
        now = Round(model, Peaks.of([*centres, middle], [*around, spread], shares), count, generator)
        if noise <= 1.0:
            rounds.append(now)
            if len(rounds) > 2:
                break
    best = max(rounds, key=lambda each: each.effective)
    return best.told(1.0)


class Round:
    """Samples from a density, with what they are worth for noise that is so many times the given one."""

    def __init__(self, model: Model, peaks: Peaks, count: int, generator: np.random.Generator) -> None:
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


def covariance_of(jacobian: Array) -> Array:
    """Laplace's, of scores with a standard normal prior and residuals of unit noise."""
    return np.asarray(linalg.inv(np.eye(jacobian.shape[1]) + jacobian.T @ jacobian))


def modes_of(model: Model, generator: np.random.Generator) -> list[tuple[Array, Array, Array]]:
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
        known = (float((each[1] - k[1]) @ linalg.solve(covariance_of(k[3]), each[1] - k[1])) for k in kept)
        if each[0] < found[0][0] + LOWEST and all(distance > 1.0 for distance in known):
            kept.append(each)
    return [(u, rest, jacobian) for _, u, rest, jacobian in kept]
