"""Confidence intervals have their level; Sobol indices by sampling agree with closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import FromSamples, Gamma, LogNormal, Normal, Uniform
from dolfinx_frontend.uncertainty.quantities import Estimate, Inputs, Quantity, sobol_of
from dolfinx_frontend.uncertainty.space import RandomSpace


def sampled(values, **settings):
    return Quantity("y", "mm", values=values, **settings)


def check_coverage(intervals, truth, level, least_only=False):
    """The fraction of intervals that contain the true value, within 4 standard errors."""
    low, high = np.array([(e.low, e.high) for e in intervals]).T
    share = np.mean((low <= truth) & (truth <= high))
    error = 4.0 * math.sqrt(level * (1.0 - level) / len(intervals))
    assert share > level - error
    assert least_only or share < level + error


# -- intervals -------------------------------------------------------------------------------------
LAWS = [stats.norm(3.0, 2.0), stats.uniform(0.0, 5.0), stats.gamma(4.0, scale=0.5)]


@pytest.mark.parametrize("law", LAWS, ids=["normal", "uniform", "gamma"])
@pytest.mark.parametrize("level", [0.8, 0.95])
def test_coverage_of_moments(law, level):
    draws = law.rvs(size=(800, 1000), random_state=np.random.default_rng(1))
    quantities = [sampled(v) for v in draws]
    check_coverage([q.mean(level) for q in quantities], law.mean(), level)
    check_coverage([q.std(level) for q in quantities], law.std(), level)


@pytest.mark.parametrize("law", LAWS, ids=["normal", "uniform", "gamma"])
def test_coverage_of_skewness(law):
    """For large samples; for small ones it is less, as documented."""
    generator = np.random.default_rng(9)
    skewness = float(law.stats(moments="s"))
    found = [sampled(law.rvs(size=20_000, random_state=generator)) for _ in range(400)]
    check_coverage([q.skewness() for q in found], skewness, 0.95)


@pytest.mark.parametrize("n", [20, 1000])
@pytest.mark.parametrize("q", [0.05, 0.5, 0.99])
def test_coverage_of_quantiles(n, q):
    draws = stats.norm.rvs(size=(500, n), random_state=np.random.default_rng(2))
    found = [sampled(v).quantile(q, 0.9) for v in draws]
    check_coverage(found, stats.norm.ppf(q), 0.9, least_only=True)
    assert all(e.low <= e.value <= e.high for e in found)


@pytest.mark.parametrize("p", [0.02, 0.3])
def test_coverage_of_probability(p):
    """Exact intervals have the level at least, Wilson's nearly."""
    draws = np.random.default_rng(3).random((400, 500))
    for method, level in (("exact", 0.95), ("wilson", 0.93)):
        found = [sampled(v).probability(below=p, level=0.95, method=method) for v in draws]
        check_coverage(found, p, level, least_only=True)


def test_probability_without_events():
    """Wilson at k = 0: upper end z^2 / (n + z^2)."""
    quantity = sampled(np.zeros(1000))
    z = stats.norm.isf(0.025)
    none = quantity.probability(above=1.0)
    assert none.value == 0.0 and none.low == pytest.approx(0.0, abs=1e-15)
    assert none.high == pytest.approx(z**2 / (1000 + z**2), rel=1e-10)
    exact = quantity.probability(above=1.0, method="exact")
    assert exact.high == pytest.approx(1.0 - 0.025 ** (1 / 1000), rel=1e-10)
    all_of_them = quantity.probability(below=1.0)
    assert all_of_them.value == 1.0 and all_of_them.low == pytest.approx(1.0 - none.high)


def test_probability_is_strict_and_two_sided():
    quantity = sampled(np.arange(10.0))
    assert quantity.probability(above=7.0).value == 0.2
    assert quantity.probability(below=7.0).value == 0.7
    assert quantity.probability(above=2.0, below=5.0).value == 0.2


def test_quantiles_of_a_large_sample():
    values = np.random.default_rng(4).standard_normal(100_000)
    for q in (0.001, 0.05, 0.5, 0.95, 0.999):
        truth = stats.norm.ppf(q)
        error = math.sqrt(q * (1.0 - q) / len(values)) / stats.norm.pdf(truth)
        assert abs(sampled(values).quantile(q).value - truth) < 4.0 * error


def test_small_samples_admit_what_they_do_not_know():
    few = sampled(np.arange(8.0))
    assert few.quantile(0.99).high == math.inf
    assert few.quantile(0.01).low == -math.inf
    lone = sampled([2.0])
    assert math.isnan(lone.mean().low) and "std" not in repr(lone)
    for read in (lone.std, lone.variance):  # a number that is none would go on in silence
        with pytest.raises(SceneError, match="one sample has no variance"):
            read()
    assert sampled([1.0, 2.0, 4.0]).std().high == math.inf
    assert "inf" in repr(few)


def test_constant_quantity():
    same = sampled(np.full(50, 3.0))
    assert same.mean() == Estimate(3.0, 3.0, 3.0, 0.95)
    assert same.std() == Estimate(0.0, 0.0, 0.0, 0.95)
    assert math.isnan(same.skewness().value)
    assert "nan" in repr(same)
    assert len(same.histogram().pdf) == 1
    with pytest.raises(SceneError, match="all values equal 3"):
        same.density()


def test_density_and_histogram():
    law = stats.gamma(9.0)
    quantity = sampled(law.rvs(size=50_000, random_state=np.random.default_rng(5)))
    density = quantity.density()
    assert integrate.trapezoid(density.pdf, density.x) == pytest.approx(1.0, abs=1e-3)
    assert np.abs(density.pdf - law.pdf(density.x)).max() < 0.03 * law.pdf(8.0)
    assert quantity.density([9.0]).x.tolist() == [9.0]
    edges, pdf = quantity.histogram()
    assert np.sum(pdf * np.diff(edges)) == pytest.approx(1.0)
    assert 20 < len(pdf) <= 1000
    assert len(quantity.histogram(7).pdf) == 7
    heavy = sampled(stats.cauchy.rvs(size=10_000, random_state=np.random.default_rng(6)))
    assert len(heavy.histogram().pdf) == 1000


# -- quadrature ------------------------------------------------------------------------------------
@pytest.mark.parametrize("rule", ["tensor", "sparse"])
def test_moments_by_quadrature(rule):
    """Exact for polynomials: y = a + b^2 with a, b normal, has the mean 1, variance 3, ..."""
    space = RandomSpace([Normal("a", 0.0, std=1.0), Normal("b", 0.0, std=1.0)])
    points, weights = space.tensor_gauss(5) if rule == "tensor" else space.sparse_gauss(6)
    values = points[:, 0] + points[:, 1] ** 2
    quantity = sampled(values, weights=weights, kind="quadrature")
    assert quantity.mean().value == pytest.approx(1.0, abs=1e-12)
    assert quantity.variance().value == pytest.approx(3.0, abs=1e-11)
    assert quantity.skewness().value == pytest.approx(8.0 / 3.0**1.5, abs=1e-10)
    assert math.isnan(quantity.mean().low)
    assert "quantile" not in repr(quantity) and "%" not in repr(quantity)
    for question in (
        lambda: quantity.quantile(0.5),
        lambda: quantity.probability(above=0.0),
        quantity.density,
        quantity.histogram,
    ):
        with pytest.raises(SceneError, match="quadrature: its weights .*Monte Carlo"):
            question()


def test_a_rule_that_is_too_coarse():
    quantity = sampled([0.0, 1.0, 1.0], weights=[2.0, -0.5, -0.5], kind="quadrature")
    with pytest.raises(SceneError, match="variance by quadrature is -2.*too coarse"):
        quantity.std()


# -- form ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("estimate", "shown"),
    [
        (Estimate(0.0433, 0.0420, 0.0446, 0.95), "0.0433 [0.0420, 0.0446] (95 %)"),
        (Estimate(2.31e7, 2.2e7, 2.4e7, 0.9), "2.31e+07 [2.20e+07, 2.40e+07] (90 %)"),
        (Estimate(3e-6, 1e-6, 7e-6, 0.95), "3.0e-06 [1.0e-06, 7.0e-06] (95 %)"),
        (Estimate(1.5, math.nan, math.nan, 0.95), "1.5"),
        (Estimate(1.0, 1.0 - 1e-9, 1.0 + 1e-9, 0.95), "1.000000 [1.000000, 1.000000] (95 %)"),
        (Estimate(0.0, 0.0, 0.0, 0.95), "0 [0, 0] (95 %)"),
        (Estimate(2.0, 1.0, math.inf, 0.95), "2.0000 [1.0000, inf] (95 %)"),
    ],
)
def test_estimate_as_text(estimate, shown):
    assert str(estimate) == shown


def test_table():
    shown = repr(sampled(np.random.default_rng(7).normal(5.0, 1.0, 1000)))
    assert shown.startswith("y [mm], 1000 samples\n  mean     ")
    assert "95 %" in shown and "skewness" in shown


def test_values_are_kept():
    values = np.arange(4.0)
    quantity = sampled(values)
    values[0] = 9.0
    assert quantity.values[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        quantity.values[0] = 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"values": [1.0, math.nan, math.inf]}, "2 of 3 values are not finite, the first at poi"),
        ({"values": [[1.0]]}, r"shape \(1, 1\)"),
        ({"values": []}, r"shape \(0,\)"),
        ({"values": [1.0], "kind": "monte"}, "unknown kind 'monte'"),
        ({"values": [1.0], "kind": "quadrature"}, "'quadrature' without weights"),
        ({"values": [1.0], "weights": [1.0]}, "'random' with weights"),
        ({"values": [1.0, 2.0], "weights": [1.0], "kind": "quadrature"}, r"shape \(1,\)"),
        ({"values": [1.0], "weights": [0.5], "kind": "quadrature"}, "sum 0.5"),
    ],
)
def test_bad_quantities(settings, message):
    with pytest.raises(SceneError, match=message):
        Quantity("y", **settings)


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lambda q: q.mean(95), r"level = 95; it must be in \(0, 1\)"),
        (lambda q: q.quantile(5), "q = 5; it must be"),
        (lambda q: q.probability(), "give above, below or both"),
        (lambda q: q.probability(above=2, below=1), "nothing is above 2 and below 1"),
        (lambda q: q.probability(above=2, method="wald"), "unknown method 'wald'"),
        (lambda q: sampled([1.0]).density(), "density needs 2 samples"),
    ],
)
def test_bad_questions(question, message):
    with pytest.raises(SceneError, match=message):
        question(sampled([1.0, 2.0, 3.0]))


# -- Sobol indices ---------------------------------------------------------------------------------
def check_indices(found, truth):
    """Within the error of 4 096 rows, and the interval (twice as wide) around the truth."""
    assert list(found) == list(truth)
    for name, (first, total) in truth.items():
        for estimate, value in zip(found[name], (first, total), strict=True):
            assert estimate.value == pytest.approx(value, abs=0.02)
            width = estimate.high - estimate.low
            assert estimate.low - 0.5 * width <= value <= estimate.high + 0.5 * width
            assert width < 0.2


def test_sobol_of_ishigami():
    """sin a + 7 sin^2 b + 0.1 c^4 sin a, uniform on [-pi, pi]: closed form."""
    space = RandomSpace([Uniform(n, -math.pi, math.pi) for n in "abc"])

    def ishigami(germs):
        a, b, c = math.pi * germs.T
        return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)

    alone = 0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2
    second = 49.0 / 8.0
    together = 0.01 * math.pi**8 * 8.0 / 225.0
    total = alone + second + together
    truth = {
        "a": (alone / total, (alone + together) / total),
        "b": (second / total, second / total),
        "c": (0.0, together / total),
    }
    found = sobol_of(ishigami, space)
    check_indices(found, truth)
    assert found == sobol_of(ishigami, space)


def test_sobol_of_groups_equals_that_of_coefficients():
    """A polynomial chaos with a correlated pair, a field and a gamma parameter."""
    pair = Correlated([Normal("k", 100.0, cov=0.2), LogNormal("K", 5.0, cov=0.3)], [[1, 0.5], [0.5, 1]])
    field = RandomField("f", 1.0, cov=0.1, length=0.5, modes=3).on(
        np.linspace(0.0, 1.0, 20)[:, None], np.full(20, 0.05)
    )
    space = RandomSpace([*pair, field, Gamma("g", 2.0, cov=0.5)])
    basis = space.basis(Chaos(order=2))
    line = np.random.default_rng(8).normal(size=(1, len(basis)))
    truth = {
        name: (float(s.first[0]), float(s.total[0]))
        for name, s in space.sobol(line, basis).items()
    }
    assert list(truth) == ["k+K", "f", "g"]
    found = sobol_of(lambda x: basis.evaluate_fields(line, x)[0], space, 2**13, seed=1)
    for name, indices in truth.items():
        for estimate, value in zip(found[name], indices, strict=True):
            assert estimate.value == pytest.approx(value, abs=0.05)
            width = estimate.high - estimate.low
            assert estimate.low - width <= value <= estimate.high + width


def test_sobol_of_special_cases():
    pair = RandomSpace([Normal("a", 1.0, cov=0.1), FromSamples("b", [1.0, 2.0, 4.0])])
    for index in sobol_of(lambda x: np.full(len(x), 3.0), pair)["a"]:
        assert math.isnan(index.value)
    lone = RandomSpace([Normal("a", 1.0, cov=0.1)])
    assert sobol_of(lambda x: x[:, 0] ** 3, lone)["a"].first.value == 1.0
    found = sobol_of(lambda x: x[:, 0] + x[:, 1], pair, 2**10)
    assert found["b"].total.value == pytest.approx(0.5, abs=0.05)
    with pytest.raises(SceneError, match="n = 1000 must be a power of two, e.g. 1024"):
        sobol_of(lambda x: x[:, 0], pair, 1000)
    with pytest.raises(SceneError, match=r"shape \(4, 2\)"):
        sobol_of(lambda x: x, pair, 4)
    with pytest.raises(SceneError, match="4 values that are not finite"):
        sobol_of(lambda x: np.full(len(x), np.nan), pair, 4)
    with pytest.raises(SceneError, match="nothing random"):
        sobol_of(lambda x: x[:, 0], RandomSpace([]), 4)


# --- from samples -----------------------------------------------------------------------------------
def ishigami(germs):
    a, b, c = math.pi * germs.T
    return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


ISHIGAMI = RandomSpace([Uniform(n, -math.pi, math.pi) for n in "abc"])


def shares_of_ishigami():
    alone, second = 0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 49.0 / 8.0
    together = 0.01 * math.pi**8 * 8.0 / 225.0
    both = np.array([[alone, second, 0.0], [alone + together, second, together]])
    return both / (alone + second + together)


def indices_of(function, space, count, seed=0, **settings):
    """(2, sources, 3): first and total, value and interval."""
    germs = space.sample(count, seed)
    found = Quantity("y", values=function(germs), inputs=Inputs(space, germs, **settings)).sobol()
    assert list(found) == list(space.groups)
    return np.array([[each[i][:3] for each in found.values()] for i in range(2)])


def test_sobol_of_samples_of_ishigami():
    """Within the interval, which narrows as the polynomial explains more."""
    truth = shares_of_ishigami()
    widths = []
    for count in (64, 256, 512):
        found = indices_of(ishigami, ISHIGAMI, count)
        assert np.all(found[..., 1] <= truth + 1e-12) and np.all(truth <= found[..., 2] + 1e-12)
        widths.append((found[..., 2] - found[..., 1]).max())
    assert widths[0] > widths[1] > widths[2] and widths[2] < 0.3
    assert found[..., 0] == pytest.approx(truth, abs=0.01)


def test_sobol_of_samples_of_an_additive_function():
    """a + 2 b^2 + 0.5 c with normal a, b, c and an idle d: 1, 8 and 1/4, exactly."""
    space = RandomSpace([Normal(n, 0.0, std=1.0) for n in "abcd"])
    found = indices_of(lambda g: g[:, 0] + 2.0 * g[:, 1] ** 2 + 0.5 * g[:, 2], space, 64)
    truth = np.array([1.0, 8.0, 0.25, 0.0]) / 9.25
    assert np.allclose(found, truth[None, :, None], atol=1e-9)


def test_intervals_of_indices_of_a_kink_hold():
    """max(a, 0) + b: the projection on a has the variance 1/2 - 1 / (2 pi)."""
    space = RandomSpace([Normal(n, 0.0, std=1.0) for n in "ab"])
    alone = 0.5 - 0.5 / math.pi
    truth = np.array([alone, 1.0]) / (alone + 1.0)
    held = []
    for seed in range(40):
        found = indices_of(lambda g: np.maximum(g[:, 0], 0.0) + g[:, 1], space, 128, seed)
        held.append((found[..., 1] <= truth) & (truth <= found[..., 2]))
    assert np.mean(held) > 0.95


def test_sobol_of_correlated_samples_and_few_samples():
    """A correlated pair is one source; of fewer samples than two for every mode nothing is known."""
    pair = Correlated([Normal("k", 0.0, std=1.0), Normal("K", 0.0, std=1.0)], [[1, 0.5], [0.5, 1]])
    space = RandomSpace([*pair, Normal("g", 0.0, std=1.0)])

    found = indices_of(lambda g: g[:, 0] + g[:, 2], space, 64)
    assert np.allclose(found, 0.5, atol=1e-9)
    assert np.all(np.isnan(indices_of(lambda g: g[:, 0] + g[:, 2], space, 5)[..., 0]))


def test_no_variance_has_no_indices():
    """A force that equilibrium fixes: what scatters is the error of the solver."""
    space = RandomSpace([Normal(n, 0.0, std=1.0) for n in "ab"])
    germs = space.sample(50, 0)
    quantity = Quantity("y", values=100.0 + 1e-6 * germs[:, 0], inputs=Inputs(space, germs, noise=1e-7))
    found = quantity.sobol()
    assert "no variance" in str(found) and all(math.isnan(e.total.value) for e in found.values())
    again = Quantity("y", values=100.0 + 1e-6 * germs[:, 0], inputs=Inputs(space, germs, noise=1e-9)).sobol()
    assert again["a"].first.value == pytest.approx(1.0) and "first 1" in str(again)
    with pytest.raises(SceneError, match="'y'.*germs"):
        Quantity("y", values=germs[:, 0]).sobol()
    rule = Quantity("y", values=[1.0, 2.0], weights=[0.5, 0.5], kind="quadrature")
    with pytest.raises(SceneError, match="quadrature"):
        rule.sobol()


def test_a_chaos_is_evaluated_where_a_polynomial_does_not_do():
    """A step of one germ, which no polynomial explains: pick-freeze has the narrower interval."""
    space = RandomSpace([Normal(n, 0.0, std=1.0) for n in "ab"])

    def step(germs):
        return (germs[:, 0] > 0.0) + 0.5 * germs[:, 1]

    found = indices_of(step, space, 4096, at=step)
    assert np.all(found[..., 2] - found[..., 1] < 0.1)
    assert found[..., 0] == pytest.approx(np.full((2, 2), 0.5), abs=0.03)
