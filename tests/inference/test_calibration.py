"""Uncertain numbers from measurements, against integrals over the prior and closed forms."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend import Fit, Posterior, SceneError, calibrate, geometry
from dolfinx_frontend.inference.calibration import _Smoothed
from dolfinx_frontend.fit.chains import Chains

Array = npt.NDArray[np.float64]

LENGTH, AREA, YOUNG, FORCE = 20.0, 100.0, 200e3, 1000.0
DATA, NOISE = [0.2105, 0.2180, 0.2141], 0.005
TIGHT = lf.Options(rtol=1e-10)


def bars(layer: Any, force: Any = FORCE, more: Any = None) -> lf.Problem:
    """Two bars with a layer between them: the end moves by F / A (2 L / E + 1 / k)."""
    scene = lf.Scene()
    for number, name in enumerate(("first", "second")):
        box = geometry.box((LENGTH, 10.0, 10.0), (2, 1, 1), (LENGTH * number, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(YOUNG, 0.0), degree=1)
    scene.fix("first:x0")
    scene.interface("layer", "first:x1", "second:x0", lf.Elastic(normal=layer, tangential=100.0))
    if more is not None:
        scene.interface("beside", "first:x1", "second:x0", lf.Elastic(normal=more, tangential=100.0))
    scene.force("second:x1", (force, 0.0, 0.0), name="pull")
    return lf.assemble(scene)


def end(problem: lf.Problem) -> lf.AtPoint:
    return lf.AtPoint(problem, "second", (2.0 * LENGTH, 5.0, 5.0), component="x")


def moved(stiffness: Any) -> Any:
    return FORCE / AREA * (2.0 * LENGTH / YOUNG + 1.0 / stiffness)


def test_two_bars_with_a_layer() -> None:
    """Posterior mean 47.1444 and deviation 0.6412, which an integral over the prior gives as well."""
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = calibrate(problem, end(problem), DATA, NOISE, options=TIGHT)
    assert isinstance(found, Posterior)
    s = np.sqrt(np.log1p(0.3**2))
    z = np.linspace(-6.0, 6.0, 200_001)
    k = 50.0 * np.exp(s * z - 0.5 * s * s)
    logs = stats.norm.logpdf(z) + sum(stats.norm.logpdf(y, moved(k), NOISE) for y in DATA)
    density = np.exp(logs)
    share = density / density.sum()
    mean, deviation = float(share @ k), float(np.sqrt(share @ (k - share @ k) ** 2))
    assert mean == pytest.approx(47.1444, abs=5e-5) and deviation == pytest.approx(0.6412, abs=5e-5)
    assert found.mean("k").value == pytest.approx(mean, rel=5e-3)
    assert found.mean("k").low <= mean <= found.mean("k").high
    assert found.std("k") == pytest.approx(deviation, rel=5e-3 * mean / deviation * 0.5)
    assert found.laplace["k"] == pytest.approx(deviation, rel=0.02)
    assert found.evidence == pytest.approx(np.log(density.sum() * (z[1] - z[0])), abs=0.02)
    assert found.quantile("k", 0.5) == pytest.approx(float(np.interp(0.5, np.cumsum(share), k)), rel=2e-3)
    assert not found.unseen and "k = 47.1" in repr(found)


def test_the_posterior_is_a_random_number_of_the_next_scene() -> None:
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = calibrate(problem, end(problem), DATA, NOISE, options=TIGHT)
    assert isinstance(found, Posterior)
    layer = found.random()["k"]
    assert layer.mean == pytest.approx(found.mean("k").value) and layer.std == pytest.approx(found.std("k"))
    again = bars(layer)
    drawn = lf.monte_carlo(again, 400, seed=1, options=TIGHT, keep_states=True, progress=False)
    values = drawn.quantity(end(again)).values
    assert values.mean() == pytest.approx(float(found.weights @ moved(found.samples[:, 0])), rel=3e-3)
    assert values.std() == pytest.approx(moved(47.1444 - 0.6412) - moved(47.1444), rel=0.15)


def test_what_the_data_do_not_see_is_named() -> None:
    """Of two layers side by side only the sum of the stiffnesses is measured."""
    problem = bars(lf.LogNormal("a", 25.0, cov=0.3), more=lf.LogNormal("b", 25.0, cov=0.3))
    found = calibrate(problem, end(problem), DATA, NOISE, options=TIGHT, samples=1024)
    assert isinstance(found, Posterior)
    (unseen,) = found.unseen
    assert unseen.seen == pytest.approx(1.0) and set(unseen.weights) == {"a", "b"}
    assert unseen.weights["a"] * unseen.weights["b"] < 0.0
    assert found.correlation[0, 1] < -0.9
    total = found.samples.sum(axis=1)
    assert found.weights @ total == pytest.approx(47.2, rel=5e-3)
    joined = found.random()
    assert set(joined) == {"a", "b"}
    fit = calibrate(problem, end(problem), DATA, NOISE, "least squares", options=TIGHT)
    assert isinstance(fit, Fit) and len(fit.unseen) == 1 and np.isinf(list(fit.std.values())).all()


def test_least_squares_without_a_prior() -> None:
    """The stiffness at which the mean of the data is met, with the error that the noise leaves."""
    problem = bars(50.0)
    inputs = ["layer.normal"]
    fit = calibrate(problem, end(problem), DATA, NOISE, "least squares", inputs=inputs, options=TIGHT)
    assert isinstance(fit, Fit)
    mean = float(np.mean(DATA))
    stiffness = 1.0 / (mean * AREA / FORCE - 2.0 * LENGTH / YOUNG)
    assert fit.values["layer.normal"] == pytest.approx(stiffness, rel=1e-6)
    slope = FORCE / AREA / stiffness**2
    assert fit.std["layer.normal"] == pytest.approx(NOISE / np.sqrt(3.0) / slope, rel=1e-5)
    assert fit.predicted == pytest.approx([mean], rel=1e-6) and fit.misfit < 1e-5


def test_several_quantities_with_gaps_in_the_data() -> None:
    """Force and displacement; a row per measurement, NaN where nothing was measured."""
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3), lf.Normal("F", FORCE, cov=0.1))
    quantities = {"end": end(problem), "force": "layer"}
    data = [[0.2105, 1010.0], [0.2180, np.nan], [np.nan, 990.0]]
    found = calibrate(problem, quantities, data, {"end": NOISE, "force": 20.0}, options=TIGHT, samples=1024)
    assert isinstance(found, Posterior)
    assert found.mean("F").value == pytest.approx(1000.0, rel=0.01)
    assert found.std("F") < 20.0 and not found.unseen


def test_bad_data() -> None:
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3))
    where = end(problem)
    for data, noise, words in (
        (DATA, 0.0, "noise of .* = 0: give a standard deviation > 0"),
        (DATA, -1.0, "noise of .* = -1"),
        (DATA, {"displacement": 1.0}, "unknown quantity 'displacement'"),
        ([[1.0, 2.0]], NOISE, r"data of shape \(1, 2\) for 1 quantities"),
        ([], NOISE, "data of shape"),
        ("a", NOISE, "data = 'a'; give numbers"),
        ([np.nan], NOISE, "nothing was measured"),
        ([np.inf], NOISE, "infinite"),
        ([1000.0 * d for d in DATA], 1000.0 * NOISE, "excludes the data.*about 1000 times the prediction"),
        ([d / 1000.0 for d in DATA], NOISE / 1000.0, "prior excludes the data.*1/1000 of the prediction"),
        ([5.0], NOISE, "prior excludes the data"),
    ):
        with pytest.raises(SceneError, match=words):
            calibrate(problem, where, data, noise)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="is no random number: it has no prior"):
        calibrate(problem, where, DATA, NOISE, inputs=["pull.x"])
    with pytest.raises(SceneError, match="give a power of two"):
        calibrate(problem, where, DATA, NOISE, samples=1000)


def test_two_values_that_fit_alike() -> None:
    """A sign that the data do not see: both maxima are sampled, and the evidence has both."""
    pull = lf.Normal("F", mean=200.0, std=800.0)
    problem = bars(50.0, force=pull)
    size = abs(lf.Response(end(problem)))
    found = calibrate(problem, size, [0.2, 0.21], 0.01, options=TIGHT)
    assert isinstance(found, Posterior)
    z = np.linspace(-6.0, 6.0, 400_001)
    force = 200.0 + 800.0 * z
    values = np.abs(force) / FORCE * moved(50.0)
    density = np.exp(stats.norm.logpdf(z) + sum(stats.norm.logpdf(y, values, 0.01) for y in (0.2, 0.21)))
    share = density / density.sum()
    mean = float(share @ force)
    assert len(found.modes) == 1 and "another maximum" in repr(found)
    assert found.mean("F").low - 20.0 <= mean <= found.mean("F").high + 20.0
    assert found.std("F") == pytest.approx(np.sqrt(share @ (force - mean) ** 2), rel=0.02)
    assert found.evidence == pytest.approx(np.log(density.sum() * (z[1] - z[0])), abs=0.05)


def test_a_ridge_is_followed() -> None:
    """Of two layers only the sum is seen, to a thousandth: the deviation of one is that of the integral."""
    problem = bars(lf.LogNormal("a", 25.0, cov=0.3), more=lf.LogNormal("b", 25.0, cov=0.3))
    found = calibrate(problem, end(problem), [moved(47.0)], 2e-4, options=TIGHT)
    assert isinstance(found, Posterior)
    s = np.sqrt(np.log1p(0.09))
    a = np.linspace(1.0, 46.0, 40_001)  # with so little noise b is 47 - a
    share = stats.lognorm.pdf(a, s, scale=25.0 * np.exp(-0.5 * s * s))
    share *= stats.lognorm.pdf(47.0 - a, s, scale=25.0 * np.exp(-0.5 * s * s))
    share /= share.sum()
    assert found.std("a") == pytest.approx(np.sqrt(share @ (a - share @ a) ** 2), rel=0.05)
    assert found.effective > 200.0


def test_a_direction_that_moved_is_seen() -> None:
    """Data with much noise and far from the prior say little, but move the value by deviations."""
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = calibrate(problem, end(problem), [moved(15.0)], 0.13, options=TIGHT, samples=256)
    assert isinstance(found, Posterior)
    (only,) = found.directions
    assert abs(only.moved) > 1.0 and not found.unseen


def test_another_unit_is_said_even_where_it_fits() -> None:
    problem = bars(50.0)
    with pytest.warns(lf.SceneWarning, match="about 1000 times the prediction"):
        calibrate(problem, end(problem), [1000.0 * moved(50.0)], 1.0, "least squares", inputs=["pull.x"])
    with pytest.raises(SceneError, match="unknown setting 'sample'"):
        calibrate(problem, end(problem), DATA, NOISE, sample=4)


@pytest.mark.skipif(find_spec("openturns") is None, reason="no OpenTURNS")
def test_markov_chains() -> None:
    """The closed form 47.1444 and 0.6412 within four standard errors of the effective samples."""
    problem = bars(lf.LogNormal("k", 50.0, cov=0.3))
    found = calibrate(problem, end(problem), DATA, NOISE, "mcmc", samples=512, seed=1, options=TIGHT)
    assert isinstance(found, Posterior)
    assert len(found.acceptance) == 4 and all(0.25 < each < 0.7 for each in found.acceptance)
    assert found.rhat["k"] < 1.05 and 50.0 < found.effective < 512.0 and np.isnan(found.evidence)
    error = 0.6412 / np.sqrt(found.effective)
    assert abs(found.mean("k").value - 47.1444) < 4.0 * error
    assert abs(found.std("k") - 0.6412) < 4.0 * error / np.sqrt(2.0)
    assert "4 chains" in repr(found) and "R-hat" in repr(found)


def test_agreement_of_chains() -> None:
    """Of a first-order autoregression with factor r: (1 - r) / (1 + r) of the samples are independent."""
    rng = np.random.default_rng(3)
    r, count = 0.8, 20_000
    noise = np.sqrt(1.0 - r * r) * rng.standard_normal((4, count))
    values = np.zeros((4, count))
    values[:, 0] = rng.standard_normal(4)
    for k in range(1, count):
        values[:, k] = r * values[:, k - 1] + noise[:, k]
    chains = Chains(values[:, :, None], np.ones(4))
    rhat, effective = chains.agreement(values)
    assert rhat == pytest.approx(1.0, abs=2e-3)
    assert effective == pytest.approx(4 * count * (1.0 - r) / (1.0 + r), rel=0.1)
    apart = values + np.array([[0.0], [0.0], [0.0], [3.0]])
    assert chains.agreement(apart)[0] > 1.3 and chains.agreement(apart)[1] < 50.0
    assert chains.agreement(np.ones((4, 100))) == (np.inf, 1.0)


def test_germs_of_a_field_are_calibrated() -> None:
    """A displacement that is all but linear in the germs: Laplace's deviations are those of the samples."""
    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((20.0, 30.0, 10.0), (4, 4, 1), (0.0, 0.0, 10.0 * level), cell="hexahedron")
        scene.substructure(name, part, lf.LinearElastic(YOUNG, 0.3), degree=1)
    scene.fix("base:z0")
    gap = lf.RandomField("g", mean=0.0, std=1e-4, length=8.0, modes=3)
    scene.interface("joint", "base:z1", "cover:z0", lf.Contact(stiffness=1e4, gap=gap))
    scene.interface("spring", "base:z1", "cover:z0", lf.Elastic(normal=1.0, tangential=5.0))
    scene.force("cover:z1", (0.0, 0.0, -9000.0), name="press")
    problem = lf.assemble(scene)
    corner = lf.AtPoint(problem, "cover", (20.0, 30.0, 20.0), component="z")
    function = problem.function(corner, options=TIGHT)
    data, noise = function([0.5, 0.0, 0.0]), 2e-6
    found = calibrate(problem, corner, data, noise, options=TIGHT)
    assert isinstance(found, Posterior) and found.names == found.germs == ("g[0]", "g[1]", "g[2]")
    slopes = function.gradient([0.0, 0.0, 0.0])[0] / noise
    inverse = np.linalg.inv(np.eye(3) + np.outer(slopes, slopes))
    for k, name in enumerate(found.names):
        assert found.std(name) == pytest.approx(np.sqrt(inverse[k, k]), rel=0.1)
        assert found.laplace[name] == pytest.approx(np.sqrt(inverse[k, k]), rel=0.02)
    with pytest.raises(SceneError, match="is a germ of a random field"):
        found.random()


def test_smoothed_samples_have_scores_that_are_their_inverse() -> None:
    """Also in the normal tails beyond three deviations."""
    rng = np.random.default_rng(5)
    law = _Smoothed(rng.gamma(4.0, 2.0, size=2000), np.full(2000, 1.0 / 2000))
    scores = np.linspace(-5.0, 5.0, 41)
    assert law.scores(law.icdf(stats.norm.cdf(scores))) == pytest.approx(scores, abs=2e-3)


def test_numbers_that_determine_each_other_are_joined_as_closely_as_a_copula_lets_them() -> None:
    """The second falls as the first grows: correlation -1 of the samples, -0.999 of the copula."""
    x = np.linspace(1.0, 2.0, 400)
    found = Posterior(
        names=("a", "b"),
        samples=np.column_stack([x, 5.0 - x]),
        weights=np.full(400, 1.0 / 400),
        likeliest={},
        laplace={},
        effective=400.0,
        evidence=0.0,
        misfit=0.0,
        directions=(),
        runs=0,
        gradients=0,
        seconds=0.0,
    )
    first, second = found.random().values()
    assert first.group.normal_correlation[0, 1] == -0.999 and second.group is first.group
