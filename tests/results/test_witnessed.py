"""Probabilities and quantiles of a chaos with contact: its samples alone are sure of what is wrong."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.results.witnessed import WitnessedQuantity
from dolfinx_frontend.uncertainty.quantities import Quantity
from tests.inference.joints import D_COV, JOINT, K_COV, Q_COV, D, K, exact, joints, lognormal

Array = npt.NDArray[np.float64]
LOAD = 5200.0
ALONE = {1: 0.0, 2: 1.3e-4, 3: 7.0e-4, 4: 8.6e-4}
"""P by a chaos of a lognormal jump that exceeds its 99.9 % quantile, order by order."""


def force(order: int) -> Quantity:
    problem = joints(LOAD)
    weights = problem.interfaces["joint"].weights
    result = lf.solve(problem, chaos=order)
    assert result.trusted
    return result.quantity(lambda block: block.force("joint")[..., 0] @ weights, "force")


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.TruncationWarning")
@pytest.mark.parametrize("order", [2, 5])
def test_a_tail_of_contact(order: int) -> None:
    """P(the joint opens) = 7.09e-4; order 5 alone says 1.46e-3 [1.24e-3, 1.72e-3], with trusted moments."""
    quantity, truth = force(order), exact(LOAD)
    assert truth == pytest.approx(7.09e-4, rel=1e-3)
    assert isinstance(quantity, WitnessedQuantity)
    alone = Quantity.probability(quantity, above=-1e-6)
    if order == 5:
        assert alone.low > 1.5 * truth
    found = quantity.probability(above=-1e-6, level=0.99)
    assert found.low <= truth <= found.high
    assert found.high < 2.5 * truth  # it is no excuse
    assert quantity.probability(above=-1e-6, level=0.99) == found  # what was solved is kept
    less = quantity.probability(below=-1e-6, level=0.99)
    assert less.low <= 1.0 - truth <= less.high
    assert quantity.probability(above=-np.inf).value == 1.0


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.TruncationWarning")
def test_a_quantile_of_contact() -> None:
    """The force that is exceeded with probability 1e-3, by 200 000 samples of the closed form."""
    (k, s), (d, t), (q, r) = (lognormal(*each) for each in ((K, K_COV), (D, D_COV), (LOAD, Q_COV)))
    z = np.random.default_rng(0).standard_normal((200_000, 3))
    stiffness, short, pull = np.exp(k + s * z[:, 0]), np.exp(d + t * z[:, 1]), np.exp(q + r * z[:, 2])
    values = -JOINT * np.maximum(stiffness * short - pull, 0.0) / (stiffness + JOINT)
    found = force(3).quantile(0.999)
    assert found.low <= float(np.quantile(values, 0.999)) <= found.high


def test_a_function_that_knows_the_truth() -> None:
    """Samples of a surrogate that is off beyond its limit: the strata find it, whatever the side."""
    rng = np.random.default_rng(1)
    truth = rng.standard_normal(50_000)
    surrogate = np.where(truth > 2.5, truth + 0.6, truth - 0.02)
    quantity = WitnessedQuantity(name="q", values=surrogate, solve=lambda which: truth[which])
    for above in (2.0, 2.8, -1.0):
        exactly = float((truth > above).mean())
        found = quantity.probability(above=above, level=0.99)
        assert found.low <= exactly <= found.high
        assert found.high - found.low < 4.0 * exactly  # 480 solves of 50 000 samples


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("grip", [False, True], ids=["pulled", "gripped"])
def test_a_tail_of_linear_laws(order: int, grip: bool) -> None:
    """A lognormal spring, pulled by 5 or displaced by .5: the jump is that of two springs in series."""
    scene = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(float(i), 0.0))
        scene.substructure(f"p{i}", part, lf.LinearElastic(E=20.0 if grip else 1e4, nu=0.0), degree=1)
        scene.symmetry(f"p{i}:y0")
    scene.interface("spring", "p0:x1", "p1:x0", lf.Elastic(normal=lf.LogNormal("k", 10.0, cov=0.5)))
    scene.fix("p0:x0", components=0)
    if grip:
        scene.fix("p1:x1", 0.5, components=0, name="grip")
    else:
        scene.traction("p1:x1", (5.0, 0.0), name="load")
    log_mean, log_std = lognormal(10.0, 0.5)
    stiffness = np.exp(log_mean - 3.0902323 * log_std)  # below it with probability 1e-3
    limit = 0.5 / (1.0 + 0.1 * stiffness) if grip else 5.0 / stiffness
    opening = lf.solve(lf.assemble(scene), chaos=order).quantity(lambda f: f.jump("spring")[..., 0].mean(-1))
    if not grip:  # the chaos alone
        assert Quantity.probability(opening, above=limit).value == pytest.approx(ALONE[order], abs=1e-5)
    found, quantile = opening.probability(above=limit, level=0.99), opening.quantile(0.999, level=0.99)
    assert found.low <= 1e-3 <= found.high
    assert quantile.low <= limit <= quantile.high


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_intervals_of_a_tail_hold(order: int) -> None:
    """exp(s x) beside its Hermite series: of 20 intervals of 95 % no more than 3 miss (or 1.6 % of luck)."""
    spread, limit = 0.5, np.exp(0.5 * 3.0902323)
    missed = 0
    for seed in range(20):
        x = np.random.default_rng(seed).standard_normal(20_000)
        truth = np.exp(spread * x)
        coefficients = [np.exp(0.5 * spread**2) * spread**k / math.factorial(k) for k in range(order + 1)]
        series = np.polynomial.hermite_e.hermeval(x, coefficients)
        quantity = WitnessedQuantity(name="q", values=series, solve=lambda which, truth=truth: truth[which])
        found = quantity.probability(above=limit)
        missed += not found.low <= 1e-3 <= found.high
    assert missed <= 3
