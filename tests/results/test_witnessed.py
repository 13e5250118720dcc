"""Probabilities and quantiles of a chaos with contact: its samples alone are sure of what is wrong."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.results.witnessed import WitnessedQuantity
from dolfinx_frontend.uncertainty.quantities import Quantity
from tests.inference.joints import D_COV, JOINT, K_COV, Q_COV, D, K, exact, joints, lognormal

Array = npt.NDArray[np.float64]
LOAD = 5200.0


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
