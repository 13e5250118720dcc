"""Moments and quantiles of functions in closed form: what is said of an error holds, in milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy import stats

from dolfinx_frontend import Gamma, LogNormal, Normal, Uniform
from dolfinx_frontend.moments.model import ContactStates, Evaluations, Guess, Moments, PointModel
from dolfinx_frontend.moments.panels import by_panels
from dolfinx_frontend.moments.rules import by_rules
from dolfinx_frontend.moments.samples import by_samples
from dolfinx_frontend.moments.search import judges_of, moments_to
from dolfinx_frontend.moments.tails import heavy_tails
from dolfinx_frontend.moments.validation import few_witnesses, witnesses
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import Statistic

Function = Callable[..., Any]
TIGHT = 1e-12


@dataclass(eq=False)
class ClosedForm:
    """A function of random numbers; `gap`, if there is one, is a contact of one point that is open where it
    is positive, and pressed by -gap."""

    laws: Sequence[Any]
    function: Function
    gap: Function | None = None
    statistic: Statistic = field(default_factory=Statistic)
    solves: int = 0

    @property
    def space(self) -> RandomSpace:
        return RandomSpace(self.laws)

    @property
    def linear(self) -> bool:
        return self.gap is None

    @property
    def smooth(self) -> bool:
        return self.gap is None

    @property
    def may_open(self) -> bool:
        return self.gap is not None

    def numbers(self, points: Any) -> Any:
        return np.array([self.space.values(law, points) for law in self.laws])

    def admissible(self, points: Any) -> Any:
        return np.ones(len(points), dtype=bool)

    def __call__(self, points: Any, rtol: float, cold: bool = False) -> Evaluations:
        self.solves += len(points)
        values = np.asarray(self.function(*self.numbers(points)))
        return Evaluations(points, values, np.full(len(points), TIGHT), True, rtol, 0.0)

    def joined(self, first: Evaluations, second: Evaluations) -> Evaluations:
        names = "points", "values", "error"
        both = (np.concatenate([getattr(first, name), getattr(second, name)]) for name in names)
        return Evaluations(*both, True, first.rtol, 0.0)

    def contacts(self, found: Evaluations) -> list[ContactStates]:
        if self.gap is None:
            return []
        gap = np.asarray(self.gap(*self.numbers(found.points)))
        counts = np.stack([gap > 0.0, np.zeros(len(gap))], axis=-1).astype(np.float64)
        return [ContactStates(1, counts, lambda: np.maximum(-gap, 0.0), lambda: np.maximum(gap, 0.0))]

    def guess(self) -> Guess | None:
        return None

    def seconds(self, points: int) -> float:
        return 0.0


def exact(model: ClosedForm) -> tuple[float, float]:
    """Mean and deviation by Gauss-Legendre on pieces of the normal scores, of one or two random numbers."""
    at, w = np.polynomial.legendre.leggauss(10)
    ends = np.linspace(-8.5, 8.5, 240 if len(model.laws) == 1 else 60)
    half = 0.5 * np.diff(ends)[:, None]
    z = (ends[:-1, None] + half * (1.0 + at)).ravel()
    w = (half * w).ravel() * stats.norm.pdf(z)
    scores, weights = z[:, None], w
    if len(model.laws) == 2:
        both = np.meshgrid(z, z, indexing="ij")
        scores, weights = np.stack([each.ravel() for each in both], axis=1), np.outer(w, w).ravel()
    values = np.asarray(model.function(*model.numbers(model.space.from_normal(scores))))
    mean = float(weights @ values)
    return mean, float(np.sqrt(weights @ (values - mean) ** 2))


def judged(found: Moments, mean: float, std: float, accuracy: float) -> None:
    """Errors are at most those said, and these what was asked."""
    said, of_std = found.truncation.quantity, found.truncation.std
    assert said is not None and of_std is not None and found.value.std is not None
    assert abs(found.value.mean - mean) <= said + 1e-12 * abs(mean)
    assert abs(found.value.std - std) <= of_std + 1e-12 * abs(mean)
    assert said <= accuracy * abs(mean) and of_std <= accuracy * std
    assert np.sum(found.weights) == pytest.approx(1.0, abs=1e-9)


def kept(found: Moments) -> None:
    assert len(found.weights) == len(found.evaluations.points)


SMOOTH = {
    "springs in series": (
        [LogNormal("a", 1.0, cov=0.3), LogNormal("b", 2.0, cov=0.2)],
        lambda a, b: 1.0 / (1.0 / a + 1.0 / b),
    ),
    "a product": ([Uniform("a", 1.0, 2.0), Normal("b", 3.0, std=0.3)], lambda a, b: a * b),
    "an exponential": ([Normal("a", 0.0, std=0.4)], lambda a: np.exp(a)),
    "an inverse": ([Uniform("a", 1.0, 3.0)], lambda a: 1.0 / a),
}


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-4])
@pytest.mark.parametrize("name", SMOOTH)
def test_rules_of_smooth_functions(name: str, accuracy: float) -> None:
    model: PointModel = ClosedForm(*SMOOTH[name])
    assert isinstance(model, ClosedForm)
    found = by_rules(model, accuracy, TIGHT, few_witnesses(model, TIGHT, accuracy), kept)
    assert found is not None
    judged(found, *exact(model), accuracy)


def opens(away: float, std: float) -> ClosedForm:
    """The force of a stop behind a gap of `away` deviations."""
    law = Normal("g", away * std, std=std)
    return ClosedForm([law], lambda g: 5.0 * np.maximum(-g, 0.0) + 1.0, gap=lambda g: g)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
@pytest.mark.parametrize("away", [-1.5, -0.3, 0.0, 0.7, 1.9])
def test_pieces_of_a_germ_with_a_kink(away: float, accuracy: float) -> None:
    model = opens(away, 0.3)
    found = by_panels(model, accuracy, TIGHT, few_witnesses(model, TIGHT, accuracy), kept)
    assert found is not None
    judged(found, *exact(model), accuracy)


@pytest.mark.parametrize("shape", [0.4, 1.0])
def test_a_stop_between_two_springs(shape: float) -> None:
    """Two germs and a kink along a sum of both: samples beside a polynomial with kinks."""
    laws = [LogNormal("k", 10.0, cov=0.3), Normal("g", 0.2 * shape, std=0.2)]
    model = ClosedForm(laws, lambda k, g: k * np.maximum(0.1 - g, 0.0) + 2.0, gap=lambda k, g: g - 0.1)
    found, notes = by_samples(model, 2e-2, TIGHT)
    assert not notes
    judged(found, *exact(model), 2e-2)


def sum_of_two(rng: np.random.Generator) -> ClosedForm:
    means, stds = rng.uniform(2.0, 4.0, 2), rng.uniform(0.1, 0.5, 2)
    laws = [Normal(name, m, std=s) for name, m, s in zip("ab", means, stds, strict=True)]
    return ClosedForm(laws, lambda a, b: a + b)


def stop(rng: np.random.Generator) -> ClosedForm:
    laws = [LogNormal("k", 10.0, cov=rng.uniform(0.1, 0.4)), Normal("g", rng.uniform(-0.2, 0.4), std=0.2)]
    return ClosedForm(laws, lambda k, g: k * (0.5 + np.maximum(0.1 - g, 0.0)), gap=lambda k, g: g - 0.1)


def series(rng: np.random.Generator) -> ClosedForm:
    laws = [LogNormal(name, 1.0, cov=rng.uniform(0.1, 0.6)) for name in "ab"]
    return ClosedForm(laws, lambda a, b: 1.0 / (1.0 / a + 1.0 / b))


@pytest.mark.parametrize("make", [sum_of_two, stop, series])
def test_quantiles(make: Callable[[np.random.Generator], ClosedForm]) -> None:
    """A search for the quantile among the points said up to seven times too little, and took more of them."""
    rng = np.random.default_rng(5)
    for _ in range(12):
        model, accuracy = make(rng), 10.0 ** rng.uniform(-2.5, -1.3)
        level = rng.uniform(0.02, 0.98)
        model.statistic = Statistic(level)
        found, notes = by_samples(model, accuracy, TIGHT)
        many = model.space.sample_sobol(2**17, 3)
        true = np.quantile(model.function(*model.numbers(many)), level)
        said = found.truncation.quantity
        # of three standard errors of eight sets 2 % are beyond; the points say the value that is told
        assert not notes and said is not None and abs(found.value.mean - true) <= 1.5 * said + 1e-5 * true
        assert said <= accuracy * abs(true)
        again = model.statistic.value(found.evaluations.values, found.weights)
        assert again == found.value


@pytest.mark.parametrize(("cov", "endless"), [(0.65, False), (1.0, True)])
def test_tails_like_powers(cov: float, endless: bool) -> None:
    """1 / k of Gamma's law grows like u^-1/a far out, a = 1 / cov^2."""
    model = ClosedForm([Gamma("k", 1.0, cov=cov)], lambda k: 1.0 / k)
    seen = witnesses(model, TIGHT)
    value = Statistic().value(seen.values, seen.weights)
    (tail,) = heavy_tails(model, seen, value, 1e-3)
    assert tail.power == pytest.approx(cov**2, abs=max(tail.doubt, 1e-6)) and tail.endless == endless


def window(rng: np.random.Generator) -> ClosedForm:
    """A contact that is met in a window of one to three germs, with a probability of .7 to 15 %."""
    count = int(rng.integers(1, 4))
    along = rng.normal(size=count)
    along /= np.linalg.norm(along)
    start, chance, slope = rng.uniform(-2.0, 2.0), 10.0 ** rng.uniform(-2.15, -0.82), rng.uniform(0.5, 3.0)
    end = stats.norm.ppf(min(stats.norm.cdf(start) + chance, 1.0 - 1e-9))

    def sums(x: Sequence[Any]) -> Any:
        return sum(a * each for a, each in zip(along, x, strict=True))

    return ClosedForm(
        [Normal(f"x{k}", 0.0, std=1.0) for k in range(count)],
        lambda *x: 5.0 + 0.3 * x[0] + slope * np.clip(sums(x) - start, 0.0, end - start),
        gap=lambda *x: np.where((sums(x) > start) & (sums(x) < end), -1.0, 1.0),
    )


@pytest.mark.parametrize("make", [window, stop, series])
def test_the_search(make: Callable[[np.random.Generator], ClosedForm]) -> None:
    """Whatever it chooses, an accuracy that is reached is kept."""
    rng = np.random.default_rng(11)
    for _ in range(10):
        model, accuracy = make(rng), 10.0 ** rng.uniform(-2.5, -1.0)
        pilot = model.space.sample_sobol(64, 5)
        about = Statistic().value(model.function(*model.numbers(pilot)), np.full(64, 1.0 / 64.0))
        judges = judges_of(model, about, accuracy)
        found, notes = moments_to(model, about, accuracy, 0.9 * accuracy, judges=judges)
        many = model.space.sample_sobol(2**18, 3)
        true = Statistic().value(model.function(*model.numbers(many)), np.full(2**18, 2.0**-18))
        assert not notes and found.total(model.statistic) <= accuracy
        assert found.value.std is not None and true.std is not None
        assert abs(found.value.mean - true.mean) <= accuracy * true.mean
        assert abs(found.value.std - true.std) <= accuracy * true.std


def test_nothing_happens() -> None:
    """A function that is 0 at every point is told."""
    laws = [Normal("g", 9.0, std=1.0), Normal("h", 9.0, std=1.0)]
    model = ClosedForm(laws, lambda g, h: np.maximum(-g - h, 0.0), gap=lambda g, h: g + h)
    found, notes = by_samples(model, 1e-2, TIGHT, most=256)
    assert "the quantity is 0 at all" in " ".join(notes)
    assert found.value.mean == 0.0 and found.truncation.quantity == np.inf
    assert model.solves < 2000


def test_witnesses_lie_where_contacts_open() -> None:
    """Closed at every drawn point, open five deviations out along a sum of germs."""
    laws = [Normal("g", 3.6, std=1.0), Normal("h", 3.6, std=1.0)]
    model = ClosedForm(laws, lambda g, h: g + h, gap=lambda g, h: -(g + h))
    seen = few_witnesses(model, TIGHT, 1e-2)
    sums = model.space.to_normal(seen.points).sum(axis=1) / np.sqrt(2.0)
    assert sums.min() < -5.0 < -7.2 / np.sqrt(2.0) + 0.5
