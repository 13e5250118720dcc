"""``accuracy=`` with several germs, kinks, fields and any quantity, against closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from latin_core import stochastic
from scipy import integrate, special, stats

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    FromSamples,
    Gamma,
    LinearElastic,
    LogNormal,
    Measure,
    Normal,
    Problem,
    Quantile,
    RandomField,
    RandomLaws,
    Resultant,
    SampleResult,
    Scene,
    SceneError,
    Uniform,
    assemble,
    geometry,
    quasi_monte_carlo,
    solve,
)
from dolfinx_frontend.estimate.adaptive import of_power
from dolfinx_frontend.moments.points import calibrated, wide_points
from dolfinx_frontend.uncertainty.statistics import MeanStd

LENGTH, HEIGHT, FORCE = 10.0, 4.0, 10.0


def off(found: MeanStd, mean: float, std: float) -> float:
    """The larger of the relative errors of mean and deviation."""
    assert found.std is not None
    return max(abs(found.mean / mean - 1.0), abs(found.std / std - 1.0))


def layers(*stiffnesses, young=200.0, **load) -> Problem:
    """Bars in a row with layers between them, pulled by a force per area: u = FORCE (sum 1/k + L/E)."""
    scene = Scene()
    for n in range(len(stiffnesses) + 1):
        box = geometry.box((LENGTH, HEIGHT), (2, 2), origin=(LENGTH * n, 0.0))
        scene.substructure(f"b{n}", box, LinearElastic(E=young, nu=0.0), degree=1)
    for n, k in enumerate(stiffnesses):
        scene.interface(f"l{n}", f"b{n}:x1", f"b{n + 1}:x0", Elastic(normal=k, tangential=10.0))
    scene.fix("b0:x0")
    last = f"b{len(stiffnesses)}:x1"
    if "pulled" in load:
        scene.fix(last, (load["pulled"], 0.0), name="grip")
    else:
        scene.traction(last, (FORCE, 0.0), name="load")
    return assemble(scene)


def inverse_gamma(cov: float) -> tuple[float, float]:
    """Mean and variance of 1/x, x of Gamma's law with mean 1."""
    first = 1.0 / (1.0 - cov**2)
    return first, first / (1.0 - 2.0 * cov**2) - first**2


def inverse_lognormal(cov: float) -> tuple[float, float]:
    """The same of the lognormal law."""
    return 1.0 + cov**2, (cov * (1.0 + cov**2)) ** 2


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.NearlyIndefiniteWarning")
@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(
    ("law", "cov", "inverse"), [(Gamma, 0.4, inverse_gamma), (LogNormal, 0.9, inverse_lognormal)]
)
def test_two_layers(law, cov, inverse, accuracy):
    """The last modes may not matter although others do: deviations were off twenty times as far as asked."""
    problem = layers(law("k1", 40.0, cov=cov), law("k2", 60.0, cov=cov))
    quantity = Resultant("load", "jump")
    result = solve(problem, accuracy=accuracy, quantity=quantity, meshes=False)
    first, variance = inverse(cov)
    mean = FORCE * (3.0 * LENGTH / 200.0 + first / 40.0 + first / 60.0)
    std = FORCE * np.sqrt(variance * (40.0**-2 + 60.0**-2))
    assert off(result.mean_std(quantity), -mean, std) <= accuracy or not result.errors().reached
    if accuracy > 1e-3:
        assert result.errors().reached


@pytest.mark.parametrize(
    ("means", "accuracy"),
    [((20.0, 80.0, 30.0), 5e-2), ((20.0, 80.0, 30.0), 2e-2), ((60.0, 30.0, 30.0, 30.0), 1e-2)],
)
def test_chaoses_that_fall_like_a_power_of_the_degree(means, accuracy):
    """Springs side by side with Gamma's laws of one scale: so is their sum. The next degree in every germ
    changed little, as did all those after it: off by 1.7 times what was asked, said 0.7 times."""
    scale, whole = 20.0, sum(means)
    scene = Scene()
    for n in range(2):
        box = geometry.box((LENGTH, HEIGHT), (2, 2), origin=(LENGTH * n, 0.0))
        scene.substructure(f"b{n}", box, LinearElastic(E=1e5, nu=0.0), degree=1)
    for n, mean in enumerate(means):
        law = Elastic(normal=Gamma(f"k{n}", mean, cov=np.sqrt(scale / mean)), tangential=30.0)
        scene.interface(f"l{n}", "b0:x1", "b1:x0", law)
    scene.fix("b0:x0")
    scene.traction("b1:x1", (FORCE, 0.0), name="load")
    quantity = Resultant("l0", "jump")
    result = solve(assemble(scene), accuracy=accuracy, quantity=quantity, meshes=False)
    first, variance = inverse_gamma(np.sqrt(scale / whole))
    made = result.errors()
    assert made.reached
    true = off(result.mean_std(quantity), FORCE / whole * first, FORCE / whole * np.sqrt(variance))
    assert true <= made.total


def test_laws_of_two_values():
    """Their polynomials end with degree 1."""
    problem = layers(FromSamples("k", [30.0, 50.0]))
    found = solve(problem, accuracy=1e-3, quantity=Resultant("l0", "jump"), meshes=False)
    values = FORCE / np.array([30.0, 50.0])
    assert off(found.mean_std(Resultant("l0", "jump")), values.mean(), values.std()) <= 1e-3
    assert found.errors().reached


def test_what_a_power_leaves():
    """Changes like n^-(p + 1): what is left after degree n is zeta(p + 1, n + 1)."""
    for power in (1.0, 2.0, 4.0):
        for order in (4, 10, 20):
            fall = (1.0 - 1.0 / order) ** (power + 1.0)
            left = special.zeta(power + 1.0, order + 1.0) * order ** (power + 1.0)
            # an integral over whole degrees; one change is left at least
            assert left <= of_power(fall, order) <= max(1.0, left * (1.0 + power / order))
    assert of_power(1e-3, 4) == 1.0


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
@pytest.mark.parametrize("mean", [200.0, 5.0, 1.0])
def test_small_deviation_is_judged_by_itself(mean, accuracy):
    """The jump of a layer that is soft beside its bars hardly scatters: 2e-5 of its mean."""
    problem = layers(LogNormal("k", mean, cov=0.3), young=2e5, pulled=0.05)
    result = solve(problem, accuracy=accuracy, quantity=Resultant("l0", "jump"), meshes=False)
    s = np.sqrt(np.log1p(0.09))
    law = stats.lognorm(s, scale=mean * np.exp(-0.5 * s * s))
    z, w = np.polynomial.hermite_e.hermegauss(60)
    k = law.median() * np.exp(s * z)
    values = 0.05 / (1.0 + 2.0 * LENGTH / 2e5 * k)
    w = w / w.sum()
    exact = w @ values
    std = np.sqrt(w @ (values - exact) ** 2)
    assert off(result.mean_std(Resultant("l0", "jump")), exact, std) <= accuracy
    assert result.errors().reached


def test_small_deviation_of_a_sum_stays_one():
    """A deviation of 1e-6 of the mean that a looser run of a larger chaos took for noise: off by 1.7e-2."""
    laws = LogNormal("a", 1e4, cov=0.5), Gamma("b", 1e4, cov=0.4), Uniform("c", 5e3, 2e4)
    problem = layers(*laws, young=1.0)
    result = solve(problem, accuracy=1e-2, quantity=Resultant("load", "jump"), meshes=False)
    of_uniform = np.log(4.0) / 1.5e4
    variance = inverse_lognormal(0.5)[1] * 1e-8 + inverse_gamma(0.4)[1] * 1e-8 + (1e-8 - of_uniform**2)
    means = (inverse_lognormal(0.5)[0] + inverse_gamma(0.4)[0]) * 1e-4 + of_uniform
    mean = FORCE * (4.0 * LENGTH + means)
    found = result.mean_std(Resultant("load", "jump"))
    assert off(found, -mean, FORCE * np.sqrt(variance)) <= 1e-2
    assert result.errors().reached


def stop(gap, move: float = 0.01) -> Problem:
    """A bar whose left end is moved towards a rigid stop: force = E A / L (move - gap)+."""
    scene = Scene()
    box = geometry.box((LENGTH, HEIGHT), (2, 2))
    scene.substructure("bar", box, LinearElastic(E=1000.0, nu=0.0), degree=1)
    scene.fix("bar:x0", (move, 0.0), name="grip")
    scene.interface("stop", "bar:x1", Contact(gap=gap))
    scene.fix("bar:x1", components=1)
    return assemble(scene)


def force_on_stop(law, move: float = 0.01) -> tuple[float, float]:
    """Mean and deviation of the normal force, by scipy."""
    stiff, lowest = 1000.0 * HEIGHT / LENGTH, law.ppf(1e-15)
    first, second = (
        integrate.quad(lambda g: (stiff * (move - g)) ** n * law.pdf(g), lowest, move, epsabs=0, limit=400)[0]
        for n in (1, 2)
    )
    return -first, np.sqrt(second - first**2)


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("away", [-3.5, -2.5, 0.3, 2.5, 3.5])
def test_kinks_far_from_the_mean(away, accuracy):
    """Contact that closes or opens `away` deviations from the mean of its gap."""
    spread = 0.001
    mean = 0.01 + away * spread
    problem = stop(Normal("g", mean, std=spread))
    result = solve(problem, accuracy=accuracy, quantity="stop", meshes=False)
    assert result.errors().reached
    assert off(result.mean_std("stop"), *force_on_stop(stats.norm(mean, spread))) <= accuracy


def test_contact_in_two_of_a_hundred():
    problem = stop(Uniform("g", 0.009, 0.06))
    result = solve(problem, accuracy=1e-2, quantity="stop", meshes=False)
    assert result.errors().reached
    assert off(result.mean_std("stop"), *force_on_stop(stats.uniform(0.009, 0.051))) <= 1e-2


def test_what_no_point_has_seen_is_not_reached():
    """A gap that is never closed within six deviations: 0 +- 0 is no answer."""
    result = solve(stop(Uniform("g", 0.02, 0.06)), accuracy=1e-1, quantity="stop", meshes=False)
    made = result.errors()
    assert result.mean_std("stop") == MeanStd(0.0, 0.0)
    assert not made.reached and any("no sample" in note for note in made.notes)


def line(young: float = 1e9, **settings) -> Problem:
    """A layer with a random field between all but rigid bars, pulled by 1e-3."""
    field = RandomField("k", mean=50.0, cov=0.3, length=5.0, distribution="lognormal", **settings)
    scene = Scene()
    for name, y0 in (("lo", -2.0), ("up", 0.0)):
        box = geometry.box((LENGTH, 2.0), (40, 1), origin=(0.0, y0))
        scene.substructure(name, box, LinearElastic(E=young, nu=0.0), degree=1)
    scene.interface("line", "lo:y1", "up:y0", Elastic(normal=field, tangential=50.0))
    scene.fix("lo:y0")
    scene.fix("up:y1", (0.0, 1e-3), name="grip")
    return assemble(scene)


@pytest.mark.parametrize("modes", [1, 2])
def test_what_fields_leave_out_is_an_error(modes):
    """std^2 = 2 int_0^L (L - t) C(t) dt of the whole field."""
    result = solve(line(modes=modes), accuracy=1e-3, quantity="line", meshes=False)
    s = np.log1p(0.09)
    whole = 2.0 * integrate.quad(lambda t: (LENGTH - t) * np.expm1(s * np.exp(-t / 5.0)), 0.0, LENGTH)[0]
    std = 50.0 * 1e-3 * np.sqrt(whole)
    made = result.errors()
    found = result.mean_std("line")
    assert found.std is not None and made.field is not None and made.whole is not None
    true = (std - found.std) / found.std
    said = made.relative("field")
    # 32 pairs share 8 draws of the lost modes, one standard error of which is added
    assert 0.9 * true <= said <= 3.0 * true + 1e-4
    assert made.reached == (made.total <= 1e-3)
    assert f"{100 * result.random.sources['line', 'normal'].captured:.4g} %" in made.field.how
    # the note said that no error had it
    assert all("which the error of the field above counts" in note for note in made.notes if "lose" in note)


def test_matrices_of_lognormal_fields_are_products():
    problem = line(modes=3)
    random = RandomLaws.of(problem)
    field = random.sources["line", "normal"]
    basis = random.space.basis(Chaos(order=3))
    coefficients, indices = random.space.expansion(field, basis)
    for row, matrix in enumerate(random.space.galerkin_matrices(field, basis)):
        enumerated = stochastic.galerkin_matrix(basis, coefficients[row], indices)
        np.testing.assert_allclose(matrix, enumerated.toarray(), atol=1e-12 * field.mean)


def test_thirty_germs():
    """Nothing is enumerated: 6e11 products of degree 8 in 30 germs."""
    problem = line(modes=30)
    result = solve(problem, accuracy=1e-2, quantity="line", meshes=False)
    s = np.log1p(0.09)
    whole = 2.0 * integrate.quad(lambda t: (LENGTH - t) * np.expm1(s * np.exp(-t / 5.0)), 0.0, LENGTH)[0]
    assert off(result.mean_std("line"), 1e-3 * 50.0 * LENGTH, 50.0 * 1e-3 * np.sqrt(whole)) <= 1e-2
    assert result.errors().reached


def test_sobol_points_are_divided_by_their_number():
    samples = quasi_monte_carlo(layers(LogNormal("k", 40.0, cov=0.3)), 64, progress=False)
    values = Resultant("l0", "jump").value(samples)
    assert samples.mean_std(Resultant("l0", "jump")).std == pytest.approx(values.std(), rel=1e-12)
    quantity = samples.quantity(lambda f: f.jump("l0")[..., 0].mean(-1))
    assert quantity.std().value == pytest.approx(values.std(), rel=1e-9)


JUMP = stats.lognorm(np.sqrt(np.log1p(0.09)), scale=FORCE / 40.0 * np.exp(0.5 * np.log1p(0.09)))


def jump(fields):
    """Jump of the layer, FORCE / k."""
    return fields.jump("l0")[..., 0].mean(axis=-1)


def far(fields):
    """Whether it is above 0.35."""
    return (jump(fields) > 0.35).astype(float)


def end(fields):
    """Displacement of the end."""
    return fields.displacement("b1").max(axis=-1)


@pytest.mark.parametrize(
    ("quantity", "exact"),
    [
        (jump, JUMP.mean()),
        (Measure(far, "far"), JUMP.sf(0.35)),
        (end, JUMP.mean() + FORCE * 2.0 * LENGTH / 200.0),
        (Quantile(jump, 0.9), JUMP.ppf(0.9)),
        (Quantile(Resultant("l0", "jump"), 0.1), JUMP.ppf(0.1)),
    ],
    ids=["function", "probability", "largest", "quantile of a function", "quantile of a resultant"],
)
def test_any_number(quantity, exact):
    """Functions of the fields, probabilities and quantiles; 1 / k is lognormal."""
    result = solve(layers(LogNormal("k", 40.0, cov=0.3)), accuracy=2e-2, quantity=quantity, meshes=False)
    made = result.errors()
    assert isinstance(result, SampleResult) and made.reached
    assert result.mean_std(quantity).mean == pytest.approx(exact, rel=2e-2)
    assert abs(made.moments.mean / exact - 1.0) <= 2e-2


@pytest.mark.parametrize("level", [0.9, 0.95])
def test_a_quantile_is_where_its_own_probability_is_known(level):
    """Samples beside a polynomial: their weights are made for the value that is said."""
    scene, law = Scene(), LogNormal("k", 100.0, cov=0.3)
    for name, x0 in (("left", 0.0), ("right", 20.0)):
        bar = geometry.box((20.0, 10.0), (2, 1), origin=(x0, 0.0))
        scene.substructure(name, bar, LinearElastic(E=200e3, nu=0.0), degree=1)
    scene.interface("pad", "left:x1", "right:x0", Elastic(normal=law, tangential=50.0))
    scene.fix("left:x0")
    scene.fix("right:x1", (0.1, 0.0), name="grip")
    width = np.sqrt(np.log1p(0.3**2))
    k = stats.lognorm(width, scale=100.0 * np.exp(-0.5 * width**2)).ppf(level)
    quantity, exact = Quantile("pad", level), 1.0 / (1.0 / k + 40.0 / 200e3)
    result = solve(assemble(scene), accuracy=3e-3, quantity=quantity, meshes=False)
    assert not result.errors().reached or abs(result.mean_std(quantity).mean / exact - 1.0) <= 3e-3


def test_quantities_of_all_answers():
    problem = layers(LogNormal("k", 40.0, cov=0.3))
    chaos = solve(problem, chaos=6)
    assert chaos.mean_std(jump).mean == pytest.approx(JUMP.mean(), rel=1e-2)
    assert chaos.mean_std(Quantile(jump, 0.9)).mean == pytest.approx(JUMP.ppf(0.9), rel=1e-2)
    assert solve(problem).mean_std(jump).mean == pytest.approx(FORCE / 40.0, rel=1e-6)
    fixed = solve(layers(40.0), accuracy=1e-3, quantity=end)
    assert fixed.mean_std(end).mean == pytest.approx(1.25, rel=1e-3)


def test_quantities_that_are_none():
    problem = layers(LogNormal("k", 40.0, cov=0.3))
    with pytest.raises(SceneError, match="level"):
        Quantile("l0", 1.5)
    with pytest.raises(SceneError, match="unknown interface"):
        solve(problem, accuracy=1e-2, quantity=Quantile("nowhere", 0.5))
    with pytest.raises(SceneError, match="give a Resultant"):
        solve(problem).mean_std(None)


@pytest.mark.parametrize("laws", [1, 2, 5])
def test_calibrated_points(laws):
    """Mean 0 and variance 1 of every germ, exactly; the weights of the wide half are right without that."""
    space = RandomLaws.of(layers(*(LogNormal(f"k{n}", 40.0, cov=0.3) for n in range(laws)))).space
    points, weights = wide_points(space, 1024, 3)
    assert weights.max() <= 2.0 and np.abs(points).max() > 3.5
    # Monte Carlo's 4 / sqrt(N) is far more than Sobol points leave
    assert weights.mean() == pytest.approx(1.0, abs=4.0 / np.sqrt(1024))
    share = calibrated(space, points, weights)
    assert share.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(share @ points, 0.0, atol=1e-12)
    np.testing.assert_allclose((points.T * share) @ points, np.eye(laws), atol=1e-12)
