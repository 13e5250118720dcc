"""Samples of a posterior by Markov chains: the random walk of OpenTURNS on the assembly itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import linalg
from dolfinx_frontend.uncertainty.fitting import openturns

__all__ = ["Chains", "walked"]

CHAINS = 4
BURN_IN = 0.25
"""Of the samples of a chain, before them: the steps are adapted meanwhile."""
STEP = 2.38
"""Of the walk, over the root of the dimension, in deviations: the best for a normal posterior (G. Roberts,
A. Gelman, W. Gilks, Ann. Appl. Probab. 7 (1997) 110)."""
APART = 2.0
"""Deviations of the starts: a chain that has forgotten its own is one of several that agree."""


@dataclass(frozen=True, eq=False)
class Chains:
    """Samples of several chains.

    Attributes
    ----------
    scores
        (chains, n, L).
    acceptance
        (chains,) share of steps that were accepted.
    """

    scores: Array
    acceptance: Array

    def agreement(self, values: Array) -> tuple[float, float]:
        """R-hat and effective number of values (chains, n), see A. Gelman et al., Bayesian Data Analysis, 3rd
        ed., 11.4 and 11.5: of half chains, autocorrelations up to the first pair whose sum is negative."""
        count = values.shape[1] // 2
        halves = np.concatenate([values[:, :count], values[:, -count:]])
        within = float(halves.var(axis=1, ddof=1).mean())
        total = within * (count - 1) / count + float(halves.mean(axis=1).var(ddof=1))
        if not total > 0.0:
            return math.inf, 1.0  # nothing moved
        size = 2 ** math.ceil(math.log2(2 * count))
        waves = np.fft.rfft(halves - halves.mean(axis=1, keepdims=True), size, axis=1)
        products = np.fft.irfft(np.abs(waves) ** 2, size, axis=1)[:, :count].mean(axis=0) / count
        correlation = 1.0 - (within - products * count / (count - 1)) / total
        correlation[0] = 1.0
        pairs = correlation[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
        negative = np.flatnonzero(pairs < 0.0)
        pairs = np.minimum.accumulate(pairs[: negative[0] if len(negative) else len(pairs)])
        effective = halves.size / max(2.0 * float(pairs.sum()) - 1.0, 1.0 / math.log10(halves.size))
        return math.sqrt(total / within) if within > 0.0 else math.inf, effective


def walked(
    log_density: Callable[[Array], float],
    peaks: Sequence[tuple[Array, Array]],
    count: int,
    generator: np.random.Generator,
) -> Chains:
    """Four chains of together `count` samples, started apart around the modes.

    Parameters
    ----------
    log_density
        Of scores (L,), up to a constant.
    peaks
        Modes (L,) and covariances there, the likeliest first.
    """
    ot = openturns()
    dimension = len(peaks[0][0])
    failed: list[Exception] = []

    def told(u: Any) -> list[float]:
        if failed:
            return [-math.inf]
        try:
            return [log_density(np.array(u, dtype=np.float64))]
        except Exception as error:  # OpenTURNS drops what it was
            failed.append(error)
            return [-math.inf]

    target = ot.PythonFunction(dimension, 1, told)
    support = ot.Interval([-40.0] * dimension, [40.0] * dimension)
    each = count // CHAINS
    scores, accepted = [], []
    before = ot.RandomGenerator.GetState()
    try:
        for number in range(CHAINS):
            centre, covariance = peaks[number % len(peaks)]
            root = linalg.cholesky(covariance, lower=True)
            start = centre + APART * root @ generator.standard_normal(dimension) / math.sqrt(dimension)
            steps = STEP**2 / dimension * covariance
            proposal = ot.Normal([0.0] * dimension, ot.CovarianceMatrix(steps.tolist()))
            ot.RandomGenerator.SetSeed(int(generator.integers(1, 2**31)))
            walk = ot.RandomWalkMetropolisHastings(target, support, start.tolist(), proposal)
            adapted = int(BURN_IN * each)
            walk.setBurnIn(adapted)
            scores.append(np.array(walk.getSample(adapted + each))[adapted:])
            if failed:
                raise failed[0]
            accepted.append(float(walk.getAcceptanceRate()))
    finally:
        ot.RandomGenerator.SetState(before)
    return Chains(np.stack(scores), np.array(accepted))
