"""Distributions fitted to measured values, by OpenTURNS."""

from __future__ import annotations

import importlib
import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    checked_names,
    checked_reals,
    checked_seed,
    checked_whole,
    checked_word,
)
from dolfinx_frontend.common.describe import columns, short
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.uncertainty.checks import named
from dolfinx_frontend.uncertainty.parameters import (
    FromDistribution,
    Gamma,
    LogNormal,
    Normal,
    RandomParameter,
)

__all__ = ["CANDIDATES", "Candidate", "DistributionFit", "fit_distribution", "openturns"]

_log = logging.getLogger(__name__)

LEAST = 5
"""Values below which nothing is fitted."""
FEW = 20
"""Values below which tests tell next to nothing, see the notes of a fit."""
REJECTED = 0.05
"""p below which a distribution does not fit."""
FACTORS = (1e6, 1e3, 25.4)
"""Between units that are confused: GPa and kPa, m and mm, inch and mm."""
LIKE, WITHIN = 1.3, 5.0
"""How near a factor is to one of these, and how much the values of either group differ at most."""
SAME = 0.5
"""Share of different values below which they are rounded."""


class _Family(NamedTuple):
    """How a candidate is fitted; `positive`: to positive values only."""

    parameters: int
    positive: bool
    fit: Callable[[Any, Array], Any]


def _lognormal(ot: Any, values: Array) -> Any:
    logs = np.log(values)
    return ot.LogNormal(float(logs.mean()), float(logs.std(ddof=1)), 0.0)


def _from_zero(factory: str) -> Callable[[Any, Array], Any]:
    """Of a family with three parameters the one that begins at 0."""

    def fit(ot: Any, values: Array) -> Any:
        made = getattr(ot, factory)()
        made.setKnownParameter([0.0], [2])
        return made.build(ot.Sample(values[:, None]))

    return fit


def _free(factory: str) -> Callable[[Any, Array], Any]:
    return lambda ot, values: getattr(ot, factory)().build(ot.Sample(values[:, None]))


CANDIDATES: Mapping[str, _Family] = {
    "normal": _Family(2, False, _free("NormalFactory")),
    "lognormal": _Family(2, True, _lognormal),
    "gamma": _Family(2, True, _from_zero("GammaFactory")),
    "weibull": _Family(2, True, _from_zero("WeibullMinFactory")),
    "gumbel": _Family(2, False, _free("GumbelFactory")),
    "uniform": _Family(2, False, _free("UniformFactory")),
}
"""Distributions that are tried; all have two parameters, positive ones begin at 0."""


@dataclass(frozen=True)
class Candidate:
    """One distribution fitted to the values.

    Attributes
    ----------
    name
        As in :data:`CANDIDATES`.
    distribution
        Of OpenTURNS.
    mean, std
        Its moments.
    aic, bic
        2 k - 2 ln L and k ln N - 2 ln L, of k = 2 parameters; the lower the better.
    kolmogorov, anderson_darling
        p-values: how probable values that fit worse were, if this were their distribution. Small: it is not.
    """

    name: str
    distribution: Any = field(repr=False)
    mean: float
    std: float
    aic: float
    bic: float
    kolmogorov: float
    anderson_darling: float

    @property
    def fits(self) -> bool:
        """Whether neither test rejects it at 5 %."""
        return min(self.kolmogorov, self.anderson_darling) >= REJECTED


@dataclass(frozen=True, repr=False)
class DistributionFit:
    """Distributions fitted to measured values; ``print`` it.

    Attributes
    ----------
    name
        Of the random number.
    candidates
        The best first: those that the tests do not reject, by the criterion; then the others.
    notes
        What a reader must know: few values, rounded ones, or that nothing fits.
    """

    name: str
    count: int
    candidates: tuple[Candidate, ...]
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> Candidate:
        """The first candidate."""
        return self.candidates[0]

    def random(self, candidate: str | None = None) -> RandomParameter:
        """The random number for a scene, of the best candidate or of one by name."""
        chosen = self.best
        if candidate is not None:
            found = {c.name: c for c in self.candidates}
            if candidate not in found:
                raise unknown_name("candidate", candidate, found, f"fit of {self.name!r}")
            chosen = found[candidate]
        makers: dict[str, Callable[..., RandomParameter]] = {"normal": Normal, "gamma": Gamma}
        makers["lognormal"] = LogNormal
        if chosen.name in makers:
            return makers[chosen.name](self.name, chosen.mean, std=chosen.std)
        return FromDistribution(self.name, chosen.distribution)

    def __repr__(self) -> str:
        rows = [["", "mean", "std", "AIC", "BIC", "p Kolmogorov", "p Anderson-Darling"]]
        for each in self.candidates:
            numbers = (f"{each.mean:.5g}", f"{each.std:.4g}", f"{each.aic:.2f}", f"{each.bic:.2f}")
            rows.append([each.name, *numbers, f"{each.kolmogorov:.3f}", f"{each.anderson_darling:.3f}"])
        lines = [f"Fit of {self.name!r} to {self.count} values, the best first", *columns(rows, "<>>>>>>")]
        return "\n".join(lines + [f"note: {each}" for each in self.notes])


def openturns() -> Any:
    """The module.

    Raises
    ------
    SceneError
        It is not installed.
    """
    try:
        return importlib.import_module("openturns")
    except ImportError as error:
        raise SceneError(
            "this needs OpenTURNS, which is not installed: pip install openturns, or "
            "conda install -c conda-forge openturns"
        ) from error


def fit_distribution(
    name: str,
    samples: npt.ArrayLike,
    candidates: Sequence[str] | None = None,
    criterion: Literal["bic", "aic"] = "bic",
    resamples: int = 199,
    seed: int = 0,
) -> DistributionFit:
    """Distributions that fit measured values, with the tests; ``.random()`` is the best as a random number.

    Kolmogorov's and Anderson and Darling's tests are made with the parameters that were fitted, so their
    p-values come from values drawn from the fit and fitted again (parametric bootstrap), not from tables for
    known parameters, which would reject too little. p has steps of 1 / (resamples + 1).

    Parameters
    ----------
    name
        Of the random number.
    samples
        (N,) measured values, 5 at least.
    candidates
        Some of ``"normal"``, ``"lognormal"``, ``"gamma"``, ``"weibull"``, ``"gumbel"``, ``"uniform"``; None:
        all, of values that are not all positive those that allow it.
    criterion
        What decides among those that are not rejected.
    resamples, seed
        Of the bootstrap.

    Raises
    ------
    SceneError
        Too few values, values that are not finite or all the same, or that are of two units by their factor
        (1000, 25.4).
    """
    where = named("fit_distribution", name)
    wanted = "give a list of finite numbers"
    values = checked_reals(where, "samples", samples, wanted)
    _check(where, values)
    checked_word(where, "criterion", criterion, ("bic", "aic"))
    checked_whole(where, "resamples", resamples, 19)
    rng = np.random.default_rng(checked_seed(where, seed))
    tried = list(CANDIDATES) if candidates is None else checked_names(where, "candidates", candidates)
    for each in tried:
        if each not in CANDIDATES:
            raise unknown_name("candidate", each, CANDIDATES, where)
    positive = bool(values.min() > 0.0)
    allowed = [each for each in tried if positive or not CANDIDATES[each].positive]
    if not allowed:
        raise SceneError(
            f"{where}: {', '.join(tried)} has positive values only, the lowest of the samples is "
            f"{values.min():g}; allow 'normal', 'gumbel' or 'uniform'"
        )
    ot = openturns()
    # a fit must not depend on the unit: routines of optimisation have absolute tolerances
    scale = float(np.abs(values).mean())
    told = ot.Log.Flags()
    ot.Log.Show(ot.Log.NONE)  # a search that fails is a candidate less
    try:
        found = list(_fitted(ot, values, allowed, scale, resamples, rng))
    finally:
        ot.Log.Show(told)
    if not found:
        raise SceneError(f"{where}: none of {', '.join(allowed)} could be fitted; try candidates=['normal']")
    found.sort(key=lambda each: (not each.fits, getattr(each, criterion)))
    return DistributionFit(name, len(values), tuple(found), tuple(_notes(values, found, positive)))


def _check(where: str, values: Array) -> None:
    if values.ndim != 1 or len(values) < LEAST:
        what = f"{len(values)} values" if values.ndim == 1 else f"an array of shape {values.shape}"
        raise SceneError(
            f"{where}: samples is {what}; a fit needs {LEAST} values at least, one after another, and its "
            f"tests {FEW}: measure more, or give a distribution that is known from elsewhere"
        )
    bad = ~np.isfinite(values)
    if bad.any():
        raise SceneError(
            f"{where}: {int(bad.sum())} of {len(values)} samples are not finite, the first is number "
            f"{int(bad.argmax())} (counted from 0); leave out what was not measured"
        )
    if np.ptp(values) <= 1e-12 * np.abs(values).max():
        raise SceneError(
            f"{where}: all {len(values)} samples are {values[0]:g}: what does not scatter has no "
            "distribution; give the number itself"
        )
    if values.min() > 0.0:
        _check_units(where, np.sort(values))


def _check_units(where: str, ordered: Array) -> None:
    """Refuse two groups of values that differ by the factor between two units."""
    cut = int(np.argmax(ordered[1:] / ordered[:-1])) + 1
    low, high = ordered[:cut], ordered[cut:]
    factor = float(np.median(high) / np.median(low))
    for known in FACTORS:
        alike = max(low[-1] / low[0], high[-1] / high[0]) < WITHIN
        if alike and 1.0 / LIKE < factor / known < LIKE:
            more = len(high) <= len(low)
            few, rest = (high, low) if more else (low, high)
            shown = f"about {known:g} times" if more else f"about 1/{known:g} of"
            raise SceneError(
                f"{where}: {len(few)} of {len(ordered)} samples ({short([float(v) for v in few])}) are "
                f"{shown} the others (median {np.median(rest):g}): usually a matter of units; convert them"
            )


def _fitted(
    ot: Any, values: Array, names: Sequence[str], scale: float, resamples: int, rng: np.random.Generator
) -> Iterator[Candidate]:
    scaled: Array = np.asarray(values / scale, dtype=np.float64)
    count = len(values)
    for name in names:
        family = CANDIDATES[name]
        try:
            law = family.fit(ot, scaled)
            own = _distances(ot, law, scaled)
            seeds = rng.integers(2**31, size=resamples)
            drawn = [_drawn(ot, family, law, count, int(s)) for s in seeds]
        except (TypeError, ValueError, RuntimeError) as error:
            _log.info("fit of %s: %s", name, error)
            continue
        worse = np.array([each for each in drawn if each is not None])
        p = (1.0 + (worse >= own).sum(axis=0)) / (1.0 + len(worse)) if len(worse) else np.full(2, np.nan)
        densities = np.array(law.computeLogPDF(ot.Sample(scaled[:, None]))).ravel()
        likelihood = float(densities.sum()) - count * math.log(scale)
        yield Candidate(
            name,
            _times(ot, name, law, scale),
            scale * float(law.getMean()[0]),
            scale * float(law.getStandardDeviation()[0]),
            2.0 * family.parameters - 2.0 * likelihood,
            family.parameters * math.log(count) - 2.0 * likelihood,
            float(p[0]),
            float(p[1]),
        )


def _times(ot: Any, name: str, law: Any, scale: float) -> Any:
    """The law of a multiple, of the same family."""
    first, second = law.getParameter()[:2]
    if name == "lognormal":
        return ot.LogNormal(first + math.log(scale), second, 0.0)
    if name == "gamma":
        return ot.Gamma(first, second / scale, 0.0)
    if name == "weibull":
        return ot.WeibullMin(scale * first, second, 0.0)
    families = {"normal": ot.Normal, "gumbel": ot.Gumbel, "uniform": ot.Uniform}
    return families[name](scale * first, scale * second)


def _drawn(ot: Any, family: _Family, law: Any, count: int, seed: int) -> Array | None:
    """Distances of values drawn from a law from their own fit; None: they could not be fitted."""
    state = ot.RandomGenerator.GetState()
    try:
        ot.RandomGenerator.SetSeed(seed)
        values = np.array(law.getSample(count)).ravel()
    finally:
        ot.RandomGenerator.SetState(state)
    try:
        return _distances(ot, family.fit(ot, values), values)
    except (TypeError, ValueError, RuntimeError):
        return None


def _distances(ot: Any, law: Any, values: Array) -> Array:
    """Kolmogorov's D and Anderson and Darling's A^2 of values from a distribution."""
    ordered = np.sort(values)
    sample = ot.Sample(ordered[:, None])
    below = np.array(law.computeCDF(sample)).ravel()
    above = np.array(law.computeComplementaryCDF(sample)).ravel()
    n = len(ordered)
    steps = np.arange(n + 1) / n
    kolmogorov = max(float((steps[1:] - below).max()), float((below - steps[:-1]).max()))
    tiny = np.finfo(np.float64).tiny
    logs = np.log(np.maximum(below, tiny)) + np.log(np.maximum(above[::-1], tiny))
    return np.array([kolmogorov, -n - float(((2.0 * np.arange(1, n + 1) - 1.0) * logs).sum()) / n])


def _notes(values: Array, found: Sequence[Candidate], positive: bool) -> Iterator[str]:
    if len(values) < FEW:
        yield (
            f"{len(values)} values are few: tests reject next to nothing, and tails are a guess; a choice by "
            "what is known of the quantity (stiffness and friction are positive) is worth more"
        )
    different = len(np.unique(values))
    if different < SAME * len(values):
        yield (
            f"only {different} of {len(values)} values differ: they are rounded, which tests take for a "
            "misfit"
        )
    if not any(each.fits for each in found):
        yield "all candidates are rejected at 5 %: FromSamples(name, samples) keeps the values as they are"
    elif not positive and values.mean() > 0.0:
        yield f"the lowest value is {values.min():g}: distributions of positive numbers were not tried"
