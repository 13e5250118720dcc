"""Expressions of random numbers, against closed forms and samples."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.reference.galerkin import ssfem
from dolfinx_frontend.uncertainty.space import RandomSpace

K = lf.LogNormal("k", 100.0, cov=0.3)
D = lf.Normal("D", 2.0, cov=0.1)
G = lf.Uniform("G", 1.0, 2.0)


def test_how_they_are_written() -> None:
    for value, name, mean in (
        (2 * K, "2 * k", 200.0),
        (-D, "-D", -2.0),
        (K * D + G, "(k * D) + G", 201.5),
        (np.sqrt(K), "sqrt(k)", 10.0),
        (np.float64(3.0) / D, "3 / D", 1.5),
        (lf.expression(lambda a, b: a * b**3, K, D, name="E t^3"), "E t^3", 800.0),
        (abs(-D) ** 2, "abs(-D) ** 2", 4.0),
        (1 - (K - 1), "1 - (k - 1)", -98.0),
    ):
        assert value.name == name and value.mean == pytest.approx(mean, rel=1e-14)
    assert 2 * K == 2 * K and 2 * K != 3 * K and len({2 * K, 2 * K}) == 1
    assert pickle.loads(pickle.dumps(2 * K)) == 2 * K and copy.deepcopy(2 * K) == 2 * K
    assert (2 * D - G / 3 + 1).affine and not (D * G).affine and not (2 * K).affine and not (1 / D).affine


def test_projections_and_samples() -> None:
    """k D of independent k and D, k^2 and 1 / k of a lognormal k: moments by hand."""
    product, square, inverse = K * D, K**2, 1.0 / K
    space = RandomSpace([product, square, inverse, 3 * D - 2 * G])
    assert space.germ_names == ("k", "D", "G")
    basis = space.basis(lf.Chaos(order=6))
    factor = 1.0 + 0.3**2
    found = space.coefficients(product, basis)[0]
    assert found[0] == pytest.approx(200.0, rel=1e-12)
    assert np.sum(found[1:] ** 2) == pytest.approx(200.0**2 * (factor * 1.01 - 1.0), rel=1e-9)
    found = space.coefficients(square, basis)[0]
    assert found[0] == pytest.approx(100.0**2 * factor, rel=1e-12)
    assert space.coefficients(inverse, basis)[0, 0] == pytest.approx(factor / 100.0, rel=1e-12)
    found = space.coefficients(3 * D - 2 * G, basis)[0]
    assert found[0] == pytest.approx(3.0, rel=1e-13)
    assert np.sum(found[1:] ** 2) == pytest.approx(9 * 0.04 + 4 / 12, rel=1e-12)
    germs = space.sample(7, 1)
    k, d = space.values(K, germs), space.values(D, germs)
    assert space.values(product, germs) == pytest.approx(k * d, rel=1e-14)
    assert space.values(1.0 / K, germs) == pytest.approx(1.0 / k, rel=1e-14)


def test_of_correlated_numbers() -> None:
    a, b = lf.Correlated([lf.Normal("a", 1.0, std=0.1), lf.Normal("b", 2.0, std=0.2)], [[1, 0.5], [0.5, 1]])
    space = RandomSpace([a + b])
    found = space.coefficients(a + b, space.basis(lf.Chaos(order=1)))[0]
    assert found[0] == pytest.approx(3.0, rel=1e-12)
    assert np.sum(found[1:] ** 2) == pytest.approx(0.01 + 0.04 + 2 * 0.5 * 0.02, rel=1e-12)


def springs(first: Any, second: Any, force: Any) -> lf.Problem:
    """A stiff block between two springs, of which one number may drive both: u = F / (k1 + k2)."""
    scene = lf.Scene()
    scene.substructure("a", geometry.box((1, 1, 1), (1, 1, 2)), lf.LinearElastic(1e7, 0.0), degree=1)
    scene.symmetry(["a:x0", "a:y0"])
    scene.interface("low", "a:z0", lf.Elastic(normal=first))
    scene.interface("high", "a:z1", lf.Elastic(normal=second))
    scene.load("a", lambda v: v[2], factor=force, name="push")
    return lf.assemble(scene)


def test_one_number_drives_several_parameters() -> None:
    """u = k D / (3 k) = D / 3 whatever k is, if all of them are the same k."""
    problem = springs(K, 2 * K, K * D)
    probe = lf.AtPoint(problem, "a", (0.5, 0.5, 0.5), component="z")
    samples = lf.monte_carlo(problem, 8, seed=1, keep_states=True, progress=False)
    assert samples.space.germ_names == ("k", "D")
    d = samples.space.values(D, samples.germs)
    assert samples.quantity(probe).values == pytest.approx(d / 3.0, rel=1e-4)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=4), options=lf.Options(rtol=1e-8))
    germs = chaos.space.sample(8, 2)
    # the order that is left out of k and k D is beyond 4: relative (s^5 / sqrt(5!)), s = 0.29
    assert probe(chaos.at(germs)) == pytest.approx(chaos.space.values(D, germs) / 3.0, rel=2e-3)
    monolithic = ssfem(problem, lf.Chaos(order=4))
    expected = monolithic.coefficients["a"]
    assert chaos.coefficients("a") == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_with_an_amplitude_and_in_sweeps() -> None:
    ramp = lf.Amplitude([0, 1], [0, 1])
    problem = springs(100.0, 200.0, ramp * (2 * D))
    probe = lf.AtPoint(problem, "a", (0.5, 0.5, 0.5), component="z")
    chaos = lf.solve(problem, chaos=1, times=[0, 1])
    assert probe(chaos.at([[1.0]])) == pytest.approx(2.0 * 2.2 / 300.0, rel=1e-4)
    swept = lf.sweep(problem, {"push.factor": [3.0, 6.0]}, times=[0, 1], keep_states=True, progress=False)
    assert swept.quantity(probe).values.reshape(-1)[-1] == pytest.approx(6.0 / 300.0, rel=1e-4)
    scene = lf.Scene()
    scene.substructure("a", geometry.box((1, 1, 1), (1, 1, 1)), lf.LinearElastic(1e3, 0.0), degree=1)
    scene.fix("a:z0", name="foot")
    scene.traction("a:z1", (0.5 * D, -D, 0.0), name="t")  # components of one random number
    chaos = lf.solve(lf.assemble(scene), chaos=1)
    assert not chaos.plan.active
    for axis, expected in (("x", -1.1), ("y", 2.2)):
        assert chaos.reaction("foot", axis)(chaos.at([[1.0]])) == pytest.approx(expected, rel=1e-10)


def test_a_contact_with_an_expression() -> None:
    """The bar closes a random gap c - D: its force is that of what is left, sampled and in a chaos."""
    scene = lf.Scene()
    scene.substructure("a", geometry.box((1, 1, 10), (1, 1, 2)), lf.LinearElastic(1e3, 0.0), degree=1)
    scene.fix("a:z0", 0.05 * D, components=2, name="push")
    scene.symmetry(["a:x0", "a:y0"])
    scene.interface("wall", "a:z1", lf.Contact(gap=0.04 + 0.005 * G))
    problem = lf.assemble(scene)
    samples = lf.monte_carlo(problem, 5, seed=3, progress=False)
    space, xi = samples.space, samples.germs
    left = 0.05 * space.values(D, xi) - 0.04 - 0.005 * space.values(G, xi)
    mean, _ = samples.moments("wall")
    assert mean[:, 0] == pytest.approx(-1e3 * left.mean() / 10.0, rel=1e-3)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: np.sqrt(D - 5.0), "'sqrt\\(D - 5\\)' is nan at D = 2"),
        (lambda: 1.0 / (D - 2.0), "is inf at D = 2, the means: give one that is finite"),
        (lambda: lf.expression(lambda a: [1.0, 2.0, 3.0], D), "returned .* for arrays of shape"),
        (lambda: lf.expression(lambda a: math.sqrt(a), D), "the function raised TypeError"),
        (lambda: lf.expression(np.sin), "no operand is random"),
        (lambda: lf.expression(np.sin, "D"), "operand = 'D'; give random numbers"),
        (lambda: np.ones(3) * D, "one random number"),
        (lambda: np.modf(D), "functions of numbers"),
        (lambda: D + lf.Normal("D", 3.0, cov=0.1), "two definitions"),
        (lambda: 2 * lf.Normal("D", 3.0, cov=0.1) + D, "two definitions"),
    ],
)
def test_bad_expressions(make: Any, text: str) -> None:
    with pytest.raises(lf.SceneError, match=text):
        make()


def test_bad_values_are_told_with_their_place() -> None:
    problem = springs(K, np.log(K) * 10.0 - 30.0, 1.0)  # negative below k = 20
    with pytest.raises(lf.IndefiniteError, match="it is -.* at k = .*a stiffness is > 0"):
        lf.solve(problem, chaos=2)
    with pytest.raises(lf.SceneError, match="negative normal stiffness"):
        lf.sample(problem, [[-6.0]], progress=False)
    problem = springs(100.0, 100.0, np.sqrt(D - 1.5))
    with pytest.raises(lf.SceneError, match="'sqrt\\(D - 1.5\\)' is nan at D = .*: give a function"):
        lf.solve(problem, chaos=2)
    with pytest.raises(lf.SceneError, match="is nan at D = "):
        lf.monte_carlo(problem, 200, seed=0, progress=False)
    deterministic = lf.solve(problem)
    assert deterministic.converged
