"""Germs, chaos, Galerkin matrices, random parameters and fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.distributions import Atoms, Distribution
from dolfinx_frontend.uncertainty.fields import RandomField, exponential_1d_eigenvalues
from dolfinx_frontend.uncertainty.parameters import (
    Beta,
    FromDistribution,
    FromSamples,
    Gamma,
    LogNormal,
    Normal,
    RandomParameter,
    TruncatedNormal,
    Uniform,
)
from dolfinx_frontend.uncertainty.space import RandomSpace
from hypothesis import given, settings
from hypothesis import strategies as st
from latin_core import stochastic as core
from scipy import special, stats

pytestmark = pytest.mark.sanitize

Array = npt.NDArray[np.float64]

HERMITE = core.Germ.hermite()


def everything() -> list[RandomParameter]:
    """One parameter of each kind, all with a finite variance."""
    samples = np.random.default_rng(5).gamma(25.0, 4.0, size=300)
    return [
        Normal("x", 100.0, cov=0.2),
        TruncatedNormal("x", 100.0, cov=0.5, lower=0.0),
        LogNormal("x", 100.0, cov=0.2),
        Uniform("x", 60.0, 150.0),
        Gamma("x", 100.0, cov=0.2),
        Beta("x", 2.0, 5.0, 10.0, 20.0),
        FromSamples("x", samples),
        FromDistribution("x", stats.weibull_min(2.0, scale=100.0)),
        FromDistribution("x", stats.weibull_min(2.0, scale=100.0), germ="normal"),
        FromDistribution("x", stats.triang(0.3, loc=50.0, scale=100.0)),
        FromDistribution("x", stats.lognorm(0.2, scale=100.0)),
        FromDistribution("x", stats.poisson(7.0)),
    ]


def inverse_mean(parameter: RandomParameter, order: int) -> float:
    """E[mean / parameter] by Galerkin at an order: a random spring under a force."""
    space = RandomSpace([parameter])
    basis = space.basis(Chaos(order))
    matrix = space.galerkin_matrix(parameter, basis).toarray()
    load = np.zeros(len(basis))
    load[0] = parameter.mean
    return float(np.linalg.solve(matrix, load)[0])


# --- kernel face ------------------------------------------------------------------------------
@settings(max_examples=40, deadline=None)
@given(
    a=st.floats(0.2, 50.0), b=st.floats(0.2, 50.0), degree=st.integers(0, 25)
)
def test_jacobi_and_laguerre_are_orthonormal_for_all_shapes(
    a: float, b: float, degree: int
) -> None:
    for germ in (core.Germ.jacobi(a, b), core.Germ.laguerre(a)):
        rule = germ.gauss(degree + 1)
        psi = germ.evaluate(rule.points[:, 0], degree)
        gram = psi.T @ (rule.weights[:, None] * psi)
        assert np.abs(gram - np.eye(degree + 1)).max() < 1e-12


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=40, unique=True),
    degree=st.integers(0, 6),
)
def test_any_measure_has_gauss_rules_inside_its_support(values: list[float], degree: int) -> None:
    atoms = np.sort(values)
    if np.diff(atoms).min() < 1e-3 * np.ptp(atoms) or np.ptp(atoms) < 1e-150:
        return  # numerically fewer atoms, whose squares are nothing: another test
    germ = core.Germ.from_measure(atoms, np.ones(len(atoms)))
    count = min(degree + 1, len(atoms))
    rule = germ.gauss(count)
    slack = 1e-12 * np.abs(atoms).max()
    assert rule.points.min() >= atoms[0] - slack and rule.points.max() <= atoms[-1] + slack
    scale = np.abs(atoms).max()
    for power in range(2 * count):
        exact = np.mean((atoms / scale) ** power)
        assert rule.weights @ (rule.points[:, 0] / scale) ** power == pytest.approx(
            exact, abs=1e-10
        )


@settings(max_examples=30, deadline=None)
@given(
    dimension=st.integers(1, 4),
    order=st.integers(0, 5),
    shape=st.sampled_from(["total", "tensor", "hyperbolic"]),
    interaction=st.integers(0, 3),
    weights=st.lists(st.floats(0.5, 3.0), min_size=4, max_size=4),
)
def test_index_sets_are_lower_sets(
    dimension: int, order: int, shape: core.IndexSet, interaction: int, weights: list[float]
) -> None:
    """Every index below an index is in the set, the mean comes first, rows are found again."""
    indices = core.MultiIndexSet(
        shape, dimension, order, weights=weights[:dimension], interaction=interaction
    )
    table = indices.table
    assert not table[0].any()
    assert (np.diff(table.sum(axis=1)) >= 0).all()
    for row, index in enumerate(table):
        assert indices.find(index.tolist()) == row
        for variable in np.flatnonzero(index):
            below = index.copy()
            below[variable] -= 1
            assert indices.find(below.tolist()) is not None


def test_defaults_and_shapes_of_the_face() -> None:
    basis = core.ChaosBasis([HERMITE, core.Germ.legendre()], core.MultiIndexSet("total", 2, 3))
    points = np.ascontiguousarray(np.random.default_rng(0).random((5, 2)))
    assert len(basis) == 10 and basis.dimension == 2
    psi = basis.evaluate(points)
    assert psi.shape == (5, 10)
    coefficients = np.arange(30.0).reshape(3, 10)
    assert np.allclose(basis.evaluate_fields(coefficients, points), coefficients @ psi.T)
    assert np.array_equal(core.mean(coefficients), coefficients[:, 0])
    assert str(HERMITE) == "hermite" and HERMITE.capacity is None
    with pytest.raises(ValueError, match="two-dimensional"):
        basis.evaluate(points[0])
    alpha, beta = HERMITE.recurrence(6)
    again = core.Germ.from_recurrence(alpha, beta)
    assert np.allclose(again.gauss(6).points, HERMITE.gauss(6).points)
    table = core.MultiIndexSet.from_table([[0, 1], [0, 0], [1, 0]])
    assert table.table.tolist() == [[0, 0], [1, 0], [0, 1]]


# --- closed forms -----------------------------------------------------------------------------
CLOSED = [
    (LogNormal("k", 100.0, cov=0.2), 1.0 + 0.2**2),
    (Gamma("k", 100.0, cov=0.2), 1.0 / (1.0 - 0.2**2)),
    (Uniform("k", mean=100.0, cov=0.2), 1.04315242),
    (TruncatedNormal("k", 100.0, cov=0.2, within=3.0), 1.04414285),
]


@pytest.mark.parametrize("parameter, expected", CLOSED, ids=[p._definition[0] for p, _ in CLOSED])
def test_random_spring_converges_to_the_closed_form(
    parameter: RandomParameter, expected: float
) -> None:
    errors = [abs(inverse_mean(parameter, order) - expected) for order in range(1, 7)]
    assert errors[-1] < 1e-6
    assert all(e < 0.3 * before for before, e in zip(errors[:4], errors[1:5], strict=True))
    assert inverse_mean(parameter, 12) == pytest.approx(expected, abs=6e-9)


@pytest.mark.parametrize("order, expected", [(2, 1.04545455), (3, 1.04602510), (4, 1.04615385)])
def test_normal_spring_gives_the_gauss_value(order: int, expected: float) -> None:
    assert inverse_mean(Normal("k", 100.0, cov=0.2), order) == pytest.approx(expected, abs=1e-8)


def test_definiteness_of_a_normal_stiffness_ends_at_order_ten() -> None:
    """cov 0.2 passes at order 9 and fails at 10; positive distributions never fail."""
    stiffness = Normal("k", 100.0, cov=0.2)
    space = RandomSpace([stiffness])
    smallest = [
        core.smallest_eigenvalue(space.galerkin_matrix(stiffness, space.basis(Chaos(p))))
        for p in (9, 10)
    ]
    assert smallest[0] > 0.0 > smallest[1]
    assert core.critical_cov(HERMITE, 9) > 0.2 > core.critical_cov(HERMITE, 10)
    assert round(core.critical_cov(HERMITE, 3), 5) == 0.42837
    for parameter in (LogNormal("k", 1.0, cov=0.8), Gamma("k", 1.0, cov=0.8), CLOSED[3][0]):
        space = RandomSpace([parameter])
        matrix = space.galerkin_matrix(parameter, space.basis(Chaos(14)))
        assert core.smallest_eigenvalue(matrix) > 0.0, parameter


def test_lognormal_coefficients_in_closed_form() -> None:
    parameter = LogNormal("k", 100.0, cov=0.3)
    s = math.sqrt(math.log(1.09))
    k = np.arange(9)
    expected = 100.0 * s**k / np.sqrt(special.factorial(k))
    assert np.allclose(parameter.coefficients(8), expected, rtol=1e-14)
    # the general projection finds the same
    projected = FromDistribution("k", stats.lognorm(s, scale=100.0 * math.exp(-0.5 * s * s)))
    assert str(projected.germ) == "hermite"
    assert np.allclose(projected.coefficients(8), expected, rtol=1e-11)


# --- all parameters ---------------------------------------------------------------------------
@pytest.mark.parametrize("parameter", everything(), ids=repr)
def test_moments_maps_and_chaos_agree(parameter: RandomParameter) -> None:
    space = RandomSpace([parameter])
    points = space.sample_sobol(4096, rng=1)
    values = space.values(parameter, points)
    assert values.mean() == pytest.approx(parameter.mean, rel=1e-3)
    assert values.std() == pytest.approx(parameter.std, rel=6e-3)
    lower, upper = parameter.bounds
    assert (values >= lower).all() and (values <= upper).all()
    assert np.allclose(parameter.to_germ(values), points[:, 0], rtol=1e-8, atol=1e-8)

    coefficients = parameter.coefficients(12)
    assert coefficients[0] == pytest.approx(parameter.mean, rel=1e-12)
    assert np.sum(coefficients[1:] ** 2) == pytest.approx(parameter.std**2, rel=2e-6)
    linear = space.basis(Chaos(1))
    psi = linear.evaluate(points)
    sampled = (psi * values[:, None]).T @ psi / len(points)
    found = space.galerkin_matrix(parameter, linear).toarray()
    assert np.abs(found - sampled).max() < 0.02 * parameter.mean
    matrix = space.galerkin_matrix(parameter, space.basis(Chaos(3))).toarray()
    low, up = np.linalg.eigvalsh(matrix)[[0, -1]]
    assert lower <= low and up <= upper

    hermite = parameter.hermite_coefficients(30)
    if not hasattr(parameter, "_law") or not isinstance(parameter._law, Atoms):
        assert np.sum(hermite[1:] ** 2) == pytest.approx(parameter.std**2, rel=2e-3)
    assert hermite[0] == pytest.approx(parameter.mean, rel=1e-9)


def test_discrete_hermite_coefficients_are_exact() -> None:
    """Fair coin: sign of the score; E[sign(z) psi_k] is known."""
    coin = FromSamples("x", [-1.0, 1.0, 1.0, -1.0])
    c = coin.hermite_coefficients(3)
    assert np.allclose(c, [0.0, math.sqrt(2 / math.pi), 0.0, -1 / math.sqrt(3 * math.pi)])


@pytest.mark.parametrize(
    "law, germ",
    [
        (stats.norm(), core.Germ.hermite()),
        (stats.uniform(-1.0, 2.0), core.Germ.legendre()),
        (stats.gamma(25.0), core.Germ.laguerre(25.0)),
        (stats.beta(0.5, 0.3, loc=-1.0, scale=2.0), core.Germ.jacobi(0.5, 0.3)),
    ],
)
def test_numerical_polynomials_equal_the_classical_ones(
    law: Distribution, germ: core.Germ
) -> None:
    own = FromDistribution("x", law, germ="own")
    alpha, beta = own.germ.recurrence(30)
    exact_alpha, exact_beta = germ.recurrence(30)
    # the last density is infinite at an end, next to which floating point has no more points
    tolerance = 1e-11 * exact_beta.max()
    assert np.abs(alpha * own.std + own.mean - exact_alpha).max() < tolerance
    assert np.abs(beta[1:] * own.std - exact_beta[1:]).max() < tolerance


def test_truncated_normal_reports_its_own_moments() -> None:
    law = stats.truncnorm(-2.0, math.inf, loc=100.0, scale=50.0)
    parameter = TruncatedNormal("x", 100.0, cov=0.5, lower=0.0)
    assert parameter.mean == pytest.approx(law.mean(), rel=1e-12)
    assert parameter.std == pytest.approx(law.std(), rel=1e-10)
    both = TruncatedNormal("x", 100.0, cov=0.2, within=3.0)
    assert both.bounds == pytest.approx((40.0, 160.0))
    assert both.mean == pytest.approx(100.0, rel=1e-13) and both.std < 20.0


def test_openturns_distributions_are_understood() -> None:
    ot = pytest.importorskip("openturns")
    pairs = [
        (ot.WeibullMin(100.0, 2.0, 0.0), stats.weibull_min(2.0, scale=100.0)),
        (ot.LogNormal(4.0, 0.2, 0.0), stats.lognorm(0.2, scale=math.exp(4.0))),
        (ot.Triangular(1.0, 2.0, 4.0), stats.triang(1 / 3, loc=1.0, scale=3.0)),
        (ot.Poisson(3.0), stats.poisson(3.0)),
    ]
    z = np.linspace(-3.0, 3.0, 9)
    for theirs, ours in pairs:
        a, b = FromDistribution("x", theirs), FromDistribution("x", ours)
        assert a.mean == pytest.approx(b.mean, rel=1e-9)
        assert a.std == pytest.approx(b.std, rel=1e-9)
        assert a.affine == b.affine
        assert np.allclose(a.from_normal(z), b.from_normal(z), rtol=1e-9)
    with pytest.raises(SceneError, match="2 variables"):
        FromDistribution("x", ot.Normal(2))


def test_new_scipy_variables_are_understood() -> None:
    if not hasattr(stats, "Normal"):
        pytest.skip("scipy < 1.15")
    parameter = FromDistribution("x", stats.Normal(mu=100.0, sigma=5.0))
    assert parameter.mean == 100.0 and parameter.std == 5.0
    assert parameter.from_normal(np.array([1.0]))[0] == pytest.approx(105.0)


# --- bad input --------------------------------------------------------------------------------
BAD = [
    (lambda: Normal("", 1.0, cov=0.1), "name = ''; a name is a string"),
    (lambda: Normal("k", 1.0), "give either cov"),
    (lambda: Normal("k", 1.0, cov=0.1, std=0.1), "not both"),
    (lambda: Normal("k", 0.0, cov=0.1), "mean 0"),
    (lambda: Normal("k", 1.0, cov=0.0), "positive"),
    (lambda: Normal("k", math.nan, cov=0.1), "finite"),
    (lambda: LogNormal("k", -1.0, cov=0.1), "mean = -1; it must be a positive"),
    (lambda: Gamma("k", 1.0, cov=-0.1), "cov = -0.1; it must be a positive"),
    (lambda: Beta("k", 0.0, 1.0), "a = 0; it must be a positive"),
    (lambda: Uniform("k", 2.0, 1.0), "lower = 2 must be less than upper = 1"),
    (lambda: Uniform("k", 1.0), "give lower and upper, or mean and cov"),
    (lambda: Uniform("k", 1.0, 2.0, cov=0.1), "already say the std"),
    (lambda: TruncatedNormal("k", 1.0, cov=0.1), "lower and/or upper, or within"),
    (lambda: TruncatedNormal("k", 1.0, cov=0.1, lower=3.0, upper=2.0), "must be less"),
    (lambda: TruncatedNormal("k", 1.0, cov=0.1, lower=5.0), "tail"),
    (lambda: FromSamples("k", [1.0, 1.0]), "all 2 values equal 1"),
    (lambda: FromSamples("k", [1.0, math.inf]), "finite numbers"),
    (lambda: FromSamples("k", ["a"]), "give a list of finite numbers"),
    (lambda: FromDistribution("k", "weibull"), "unknown distribution 'weibull' of type str"),
    (lambda: FromDistribution("k", stats.cauchy()), "finite variance"),
    (lambda: FromDistribution("k", stats.norm(), germ="hermite"), "unknown germ 'hermite'"),
    (lambda: Chaos(-1), "order = -1; give a whole number >= 0"),
    (lambda: Chaos(1.5), "order = 1.5; give a whole number"),
    (lambda: Chaos(2, index_set="totl"), "unknown index set 'totl'; did you mean 'total'"),
    (lambda: Chaos(2, q=1.5), "q = 1.5"),
    (lambda: Chaos(2, max_interaction=0), "max_interaction = 0"),
    (lambda: Chaos(2, weights=[1.0, -1.0]), "weights = -1"),
    (lambda: RandomField("f", 1.0, cov=0.1, covariance="expo"), "unknown covariance 'expo'"),
    (lambda: RandomField("f", 1.0, cov=0.1, covariance="matern"), "needs its smoothness"),
    (lambda: RandomField("f", 1.0, cov=0.1, distribution="weibull"), "unknown distribution"),
    (lambda: RandomField("f", 1.0, cov=0.1, length=-1.0), "length = -1"),
    (lambda: RandomField("f", 1.0, cov=0.1, variance_captured=1.5), "1.5; it must be in"),
    (lambda: RandomField("f", 1.0, cov=0.1, modes=0), "modes = 0"),
    (lambda: RandomField("f", 1.0, cov=0.1, modes=2, variance_captured=0.9), "not both"),
    (lambda: RandomField("f", -1.0, cov=0.1, distribution="lognormal"), "mean = -1"),
    (lambda: RandomField("f", 1.0, cov=0.1).on(np.zeros((3, 2)), np.ones(2)), "wanted"),
    (lambda: RandomField("f", 1.0, cov=0.1).on(np.zeros((2, 2)), np.zeros(2)), "weights must be positive"),
    (
        lambda: RandomField("f", 1.0, cov=0.1, length=0.01, variance_captured=0.99).on(
            *segment(10)
        ),
        "30 points resolve only .* refine the mesh",
    ),
    (
        lambda: RandomField("f", 1.0, cov=0.1, length=(1.0, 2.0)).on(np.eye(3), np.ones(3)),
        "2 lengths",
    ),
    (lambda: Correlated([Normal("a", 1, cov=0.1)] * 2, np.eye(2)), "different names"),
    (lambda: RandomSpace([RandomField("f", 1.0, cov=0.1)]), "put on its points first"),
]


@pytest.mark.parametrize("make, message", BAD, ids=[message for _, message in BAD])
def test_bad_input_is_refused_with_its_name_and_value(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(SceneError, match=message):
        make()


def test_one_name_is_one_variable() -> None:
    first, same, other = Normal("k", 1.0, cov=0.1), Normal("k", 1.0, std=0.1), Normal("k", 1.0, cov=0.2)
    assert first == same and hash(first) == hash(same) and first != other
    assert RandomSpace([first, same, first]).germ_names == ("k",)
    with pytest.raises(SceneError, match="'k' has two definitions"):
        RandomSpace([first, other])
    with pytest.raises(SceneError, match="two definitions"):
        RandomSpace([first, LogNormal("k", 1.0, cov=0.1)])


def test_a_basis_beyond_memory_says_how_much_it_needs() -> None:
    space = RandomSpace([Normal(f"k{i}", 1.0, cov=0.1) for i in range(20)])
    with pytest.raises(SceneError, match=r"4\.71292e\+13 modes or more and needs 3\.77e\+06 GB"):
        space.basis(Chaos(30), memory_limit=24e9)
    with pytest.raises(SceneError, match="limit of 24 GB"):
        space.basis(Chaos(5), rows=100_000, memory_limit=24e9)
    assert len(space.basis(Chaos(5, max_interaction=2))) == 1 + 20 * 5 + 190 * 10
    assert len(space.basis(Chaos(5, "hyperbolic", q=0.5))) < 500


def test_a_sample_of_few_values_has_few_polynomials() -> None:
    space = RandomSpace([FromSamples("a", [1.0, 2.0, 4.0]), Normal("b", 1.0, cov=0.1)])
    basis = space.basis(Chaos(4))
    assert basis.indices.table.max(axis=0).tolist() == [2, 4]


def test_weights_by_name_make_the_basis_anisotropic() -> None:
    space = RandomSpace([Normal("a", 1.0, cov=0.1), Normal("b", 1.0, cov=0.1)])
    table = space.basis(Chaos(4, weights={"b": 2.0})).indices.table
    assert table.max(axis=0).tolist() == [4, 2]
    with pytest.raises(SceneError, match="unknown random parameter 'c'"):
        space.basis(Chaos(4, weights={"c": 2.0}))
    with pytest.raises(SceneError, match="3 weights for 2 germs"):
        space.basis(Chaos(4, weights=[1.0, 1.0, 1.0]))


# --- several parameters -----------------------------------------------------------------------
def test_order_of_germs_points_and_maps() -> None:
    a, b, c = Normal("a", 1.0, cov=0.1), Gamma("b", 2.0, cov=0.2), Uniform("c", 1.0, 3.0)
    space = RandomSpace([b, a, b, c])
    assert space.names == ("b", "a", "c") and space.groups == {"b": (0,), "a": (1,), "c": (2,)}
    points = space.germ_points({"a": [1.1, 1.2], "c": 2.5})
    assert np.allclose(space.values(a, points), [1.1, 1.2])
    assert np.allclose(space.values(b, points), 2.0)
    assert np.allclose(space.values(c, points), 2.5)
    with pytest.raises(SceneError, match="cannot take the value 4"):
        space.germ_points({"c": 4.0})
    with pytest.raises(SceneError, match="unknown random parameter 'd'"):
        space.germ_points({"d": 4.0})
    with pytest.raises(SceneError, match="different lengths"):
        space.germ_points({"a": [1.0, 1.0], "b": [1.0, 1.0, 1.0]})
    with pytest.raises(SceneError, match="not part of"):
        space.values(Normal("z", 1.0, cov=0.1), points)
    with pytest.raises(SceneError, match="1000 Sobol points.*1024"):
        space.sample_sobol(1000)
    monte_carlo = space.sample(2000, rng=7)
    assert np.array_equal(monte_carlo, space.sample(2000, rng=7))
    for i, germ in enumerate(space.germs):
        psi = germ.evaluate(monte_carlo[:, i], 2)
        assert np.abs(psi[:, 1:].mean(axis=0)).max() < 4.0 * 2.5 / math.sqrt(2000)


def test_coefficients_of_independent_parameters_reproduce_them() -> None:
    a, b = LogNormal("a", 1.0, cov=0.3), Gamma("b", 2.0, cov=0.2)
    space = RandomSpace([a, b])
    basis = space.basis(Chaos(9))
    points = space.sample(50, rng=3)
    for parameter in (a, b):
        fields = basis.evaluate_fields(space.coefficients(parameter, basis), points)
        assert np.allclose(fields[0], space.values(parameter, points), rtol=1e-4)


def test_correlated_parameters_keep_laws_and_correlation() -> None:
    k, K = Correlated([LogNormal("k", 100.0, cov=0.5), Gamma("K", 5e4, cov=0.3)], [[1.0, 0.6], [0.6, 1.0]])
    z = Normal("z", 1.0, cov=0.1)
    space = RandomSpace([K, z, k])
    assert space.groups == {"k+K": (0, 1), "z": (2,)}
    points = space.sample_sobol(2**15, rng=2)
    x, y = space.values(k, points), space.values(K, points)
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(0.6, abs=3e-3)
    assert [x.mean(), x.std()] == pytest.approx([100.0, 50.0], rel=3e-3)
    assert [y.mean(), y.std()] == pytest.approx([5e4, 1.5e4], rel=3e-3)

    basis = space.basis(Chaos(7))
    ck, cK = space.coefficients(k, basis)[0], space.coefficients(K, basis)[0]
    assert ck[1:] @ cK[1:] / (k.std * K.std) == pytest.approx(0.6, abs=1e-7)
    small = points[:200]
    error = basis.evaluate_fields(ck[None], small)[0] - space.values(k, small)
    assert np.sqrt(np.mean(error**2)) < 1e-3 * k.std

    back = space.germ_points({"k": [90.0, 120.0], "K": 4e4})
    assert np.allclose(space.values(k, back), [90.0, 120.0])
    assert np.allclose(space.values(K, back), 4e4)

    # Galerkin matrix of a function of two germs against quadrature
    coarse = space.basis(Chaos(2))
    rule = space.tensor_gauss(20)
    psi = coarse.evaluate(rule.points)
    expected = psi.T @ ((rule.weights * space.values(k, rule.points))[:, None] * psi)
    found = space.galerkin_matrix(k, coarse).toarray()
    assert np.abs(found - expected).max() < 1e-9 * k.mean
    assert core.smallest_eigenvalue(space.galerkin_matrix(k, coarse)) > 0.0


def test_only_the_members_in_use_take_part() -> None:
    group = Correlated(
        [Normal(n, 1.0, cov=0.1) for n in "abc"], [[1, 0.5, 0.2], [0.5, 1, 0.3], [0.2, 0.3, 1]]
    )
    space = RandomSpace([group["c"], group["a"]])
    assert space.dimension == 2 and space.names == ("c", "a")
    points = space.sample_sobol(2**12, rng=1)
    values = [space.values(group[n], points) for n in "ac"]
    assert np.corrcoef(values)[0, 1] == pytest.approx(0.2, abs=5e-3)
    with pytest.raises(SceneError, match="unknown parameter 'd'"):
        group["d"]


def test_normal_space_correlation_is_taken_as_it_is() -> None:
    matrix = [[1.0, 0.6], [0.6, 1.0]]
    pair = [LogNormal("k", 1.0, cov=1.0), LogNormal("K", 1.0, cov=1.0)]
    assert np.array_equal(Correlated(pair, matrix, space="normal").normal_correlation, matrix)
    # lognormal pair in closed form: rho = (exp(s^2 r) - 1) / (exp(s^2) - 1)
    physical = Correlated(pair, matrix).normal_correlation[0, 1]
    assert physical == pytest.approx(math.log1p(0.6) / math.log(2.0), rel=1e-9)
    normals = Correlated([Normal("a", 1, cov=0.1), Normal("b", 1, cov=0.1)], matrix)
    assert np.array_equal(normals.normal_correlation, matrix)


def test_impossible_correlations_are_refused() -> None:
    three = [Normal(n, 1.0, cov=0.1) for n in "abc"]
    bad = [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]]
    with pytest.raises(SceneError, match=r"not positive definite: .* eigenvalue is -0\.8"):
        Correlated(three, bad)
    with pytest.raises(SceneError, match="not symmetric"):
        Correlated(three[:2], [[1.0, 0.5], [0.4, 1.0]])
    with pytest.raises(SceneError, match="must be 1"):
        Correlated(three[:2], [[2.0, 0.5], [0.5, 1.0]])
    with pytest.raises(SceneError, match=r"shape \(2, 2\); wanted \(3, 3\)"):
        Correlated(three, np.eye(2))
    with pytest.raises(SceneError, match="unknown space 'Normal'"):
        Correlated(three, np.eye(3), space="Normal")  # type: ignore[arg-type]
    skewed = [LogNormal("a", 1.0, cov=1.0), LogNormal("b", 1.0, cov=1.0)]
    with pytest.raises(SceneError, match="cannot have the correlation -0.8; .* between -0.5 and 1"):
        Correlated(skewed, [[1.0, -0.8], [-0.8, 1.0]])


def test_sobol_indices_of_ishigami() -> None:
    """f = sin x + 7 sin^2 y + 0.1 z^4 sin x on (-pi, pi)^3, known in closed form."""
    a, b = 7.0, 0.1
    space = RandomSpace([Uniform(n, -math.pi, math.pi) for n in "xyz"])
    basis = space.basis(Chaos(14))
    rule = space.tensor_gauss(16)
    x, y, z = math.pi * rule.points.T
    response = np.sin(x) + a * np.sin(y) ** 2 + b * z**4 * np.sin(x)
    transform = core.quadrature_transform(basis, rule)
    coefficients = response[None] @ transform.backward
    alone_x = 0.5 * (1.0 + b * math.pi**4 / 5.0) ** 2
    alone_y = a * a / 8.0
    together = b * b * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    total = alone_x + alone_y + together
    assert core.variance(coefficients)[0] == pytest.approx(total, rel=1e-6)
    found = space.sobol(coefficients, basis)
    expected = {"x": (alone_x, alone_x + together), "y": (alone_y,) * 2, "z": (0.0, together)}
    for name, (first, whole) in expected.items():
        assert found[name].first[0] == pytest.approx(first / total, abs=1e-6)
        assert found[name].total[0] == pytest.approx(whole / total, abs=1e-6)
    first = [core.sobol_closed(coefficients, basis.indices, [i])[0] for i in range(3)]
    assert first == pytest.approx([found[n].first[0] for n in "xyz"], abs=1e-14)
    degrees = basis.indices.table.sum(axis=1)
    decay = np.bincount(degrees, weights=coefficients[0] ** 2)[1:]
    assert decay[13] < 1e-4 * decay.max()


# --- fields -----------------------------------------------------------------------------------
def segment(facets: int, points: int = 3, size: float = 1.0) -> tuple[Array, Array]:
    """Gauss points of facets along a line in the plane."""
    x, w = np.polynomial.legendre.leggauss(points)
    nodes = ((np.arange(facets)[:, None] + 0.5 * (x + 1.0)) / facets).ravel() * size
    return np.column_stack([nodes, 0.3 * nodes * 0.0]), np.tile(0.5 * w * size / facets, facets)


def test_exponential_eigenvalues_solve_the_integral_equation() -> None:
    """Their sum is the size; lambda_1 is the one tabulated for correlation length = size = 1."""
    values = exponential_1d_eigenvalues(0.5, 1.0, 4000)
    assert (np.diff(values) < 0.0).all()
    tail = 2.0 / 0.5 / (math.pi**2 * 4000.0)
    assert values.sum() + tail == pytest.approx(1.0, abs=1e-6)
    assert exponential_1d_eigenvalues(1.0, 1.0, 1)[0] == pytest.approx(0.7388108, abs=1e-6)


def test_karhunen_loeve_reaches_the_closed_form() -> None:
    exact = exponential_1d_eigenvalues(0.5, 1.0, 10)
    field = RandomField("k", 100.0, cov=0.2, length=0.5, modes=10)
    coarse, fine = (field.on(*segment(n)).eigenvalues for n in (100, 200))
    assert np.abs(fine[:4] / exact[:4] - 1.0).max() < 2e-6
    assert np.abs((4.0 * fine - coarse) / 3.0 / exact - 1.0).max() < 1e-6
    # one interface of many points: no extrapolation, and Lanczos instead of a dense solver
    many = field.on(*segment(667))
    assert np.abs(many.eigenvalues / exact - 1.0).max() < 1e-6
    # lengths scale
    scaled = RandomField("k", 1.0, cov=0.2, length=500.0, modes=10).on(*segment(100, size=1000.0))
    assert np.allclose(scaled.eigenvalues, 1000.0 * coarse, rtol=1e-10)


@pytest.mark.parametrize(
    "covariance, nu", [("exponential", None), ("gaussian", None), ("matern", 0.5), ("matern", 2.5)]
)
def test_modes_are_orthonormal_and_rebuild_the_covariance(covariance: str, nu: float) -> None:
    x, w = segment(60)
    field = RandomField(
        "k", 10.0, cov=0.1, covariance=covariance, nu=nu, length=0.4, variance_captured=0.99
    ).on(x, w)
    gram = field.functions.T @ (w[:, None] * field.functions)
    assert np.abs(gram - np.eye(len(field.eigenvalues))).max() < 1e-12
    assert 0.99 <= field.captured <= 1.0
    assert (w @ field.functions >= -1e-6).all()
    r = np.abs(x[:, 0, None] - x[None, :, 0]) / 0.4
    exact = {
        "exponential": np.exp(-r),
        "gaussian": np.exp(-0.5 * r * r),
    }.get(covariance)
    if exact is None:
        s = math.sqrt(5.0) * r
        exact = np.exp(-r) if nu == 0.5 else (1.0 + s + s * s / 3.0) * np.exp(-s)
    error = field.shapes @ field.shapes.T - exact
    # root of the sum of squares of the lost eigenvalues, whose sum is 1 % at most
    assert math.sqrt(w @ error**2 @ w) < 0.01
    space = RandomSpace([field])
    assert space.germ_names[0] == "k[0]" and space.groups["k"] == tuple(range(space.dimension))


def test_matern_one_half_is_the_exponential() -> None:
    x, w = segment(50)
    half = RandomField("k", 1.0, cov=0.1, covariance="matern", nu=0.5, length=0.3, modes=6).on(x, w)
    exponential = RandomField("k", 1.0, cov=0.1, length=0.3, modes=6).on(x, w)
    assert np.allclose(half.eigenvalues, exponential.eigenvalues, rtol=1e-9)


def test_dense_and_lanczos_agree_on_a_surface() -> None:
    side = np.linspace(0.0, 1.0, 40)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))])
    weights = np.full(len(grid), 1.0 / len(grid))
    field = RandomField(
        "k", 1.0, cov=0.1, covariance="gaussian", length=(0.5, 0.3, 1.0), variance_captured=0.95
    )
    lanczos = field.on(points, weights)  # 1600 points
    # the Gaussian correlation is a product: eigenvalues from two lines
    lines = []
    for length in (0.5, 0.3):
        r = (side[:, None] - side[None]) / length
        lines.append(np.linalg.eigvalsh(np.exp(-0.5 * r * r) / 40.0))
    products = np.sort(np.outer(*lines).ravel())[::-1]
    assert np.allclose(lanczos.eigenvalues, products[: len(lanczos.eigenvalues)], atol=1e-9)
    captured = np.cumsum(products)
    assert captured[len(lanczos.eigenvalues) - 1] >= 0.95 > captured[len(lanczos.eigenvalues) - 2]


@pytest.mark.parametrize("distribution", ["normal", "lognormal"])
def test_chaos_of_a_field_reproduces_the_field(distribution: str) -> None:
    x, w = segment(10)
    field = RandomField(
        "k", 100.0, cov=0.3, covariance="gaussian", length=0.5, modes=3, distribution=distribution
    ).on(x, w)
    space = RandomSpace([field, Normal("z", 1.0, cov=0.1)])
    basis = space.basis(Chaos(8))
    points = space.sample(40, rng=0)
    coefficients = space.coefficients(field, basis)
    assert np.allclose(coefficients[:, 0], 100.0)
    values = space.values(field, points)
    assert values.shape == (30, 40)
    assert np.allclose(basis.evaluate_fields(coefficients, points), values, rtol=1e-4)
    if distribution == "lognormal":
        assert (values > 0.0).all()
    # Galerkin matrix at one point against quadrature
    coarse = space.basis(Chaos(2))
    rule = space.tensor_gauss(10)
    psi = coarse.evaluate(rule.points)
    expected = psi.T @ ((rule.weights * space.values(field, rule.points)[7])[:, None] * psi)
    assert np.abs(space.galerkin_matrix(field, coarse, 7).toarray() - expected).max() < 1e-7
    with pytest.raises(SceneError, match="cannot be set by one number"):
        space.germ_points({"k": 1.0})
    with pytest.raises(SceneError, match="the chaos of 'k'"):
        if distribution == "normal":
            space.expansion(field, basis, memory_limit=1.0)
        else:
            space.expansion(field, basis, memory_limit=1e4)


@pytest.mark.parametrize("kind", [Normal, LogNormal, Gamma, TruncatedNormal])
def test_a_spread_has_a_keyword(kind: Any) -> None:
    """50 with a third number of 5: a deviation of 5 to some, a coefficient of 5 to others."""
    with pytest.raises(SceneError, match=r"'k': 5.0 may be meant as either .*std=5.0.*cov=5.0"):
        kind("k", 50.0, 5.0)
    with pytest.raises(TypeError, match="positional"):
        RandomField("k", 50.0, 5.0)  # type: ignore[misc]


def test_an_interrupt_that_scipy_swallows_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its tables are then zero, and all points the same."""
    from scipy.stats import qmc

    monkeypatch.setattr(qmc.Sobol, "random_base2", lambda self, m: np.full((2**m, self.d), 0.25))
    with pytest.raises(KeyboardInterrupt):
        RandomSpace([Normal("a", 1.0, cov=0.1)]).sample_sobol(4)
