"""Observed values with outliers: the Gauss rules of their germ carry these with the weight that they have."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import norm

import dolfinx_frontend as lf

Array = npt.NDArray[np.float64]
LOAD, STOP, GAP, COV = 4.0, 20.0, 0.5, 0.3

PLAIN = np.random.default_rng(3).normal(10.0, 0.5, 997)
OBSERVED = {
    "none": PLAIN,
    "one low": np.r_[PLAIN, 0.05],
    "two low": np.r_[PLAIN, 0.05, 0.02],
    "two low, one high": np.r_[PLAIN, 0.05, 0.02, 200.0],
}


def exact(stiffness: Array) -> tuple[float, float]:
    """Mean and deviation of the force of a stop with a lognormal gap, beside springs, under a load."""
    spread = np.sqrt(np.log(1.0 + COV**2))
    quantiles = (np.arange(4000) + 0.5) / 4000.0
    gap = GAP * np.exp(spread * norm.ppf(quantiles) - 0.5 * spread**2)
    spring = stiffness[:, None]
    closed = np.maximum((LOAD + STOP * gap) / (spring + STOP) - gap, 0.0)
    force = -STOP * np.where(LOAD / spring > gap, closed, 0.0)
    return float(force.mean()), float(force.std())


@pytest.mark.parametrize("name", OBSERVED)
def test_a_stop_beside_observed_springs(name: str) -> None:
    """The parts' own compliance is 4e-4 of that of the springs."""
    scene = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(float(i), 0.0))
        scene.substructure(f"p{i}", part, lf.LinearElastic(E=1e6, nu=0.0), degree=1)
        scene.symmetry(f"p{i}:y0")
    gap = lf.LogNormal("g", GAP, cov=COV)
    scene.interface("stop", "p0:x1", "p1:x0", lf.Contact(gap=gap, stiffness=STOP))
    scene.interface("springs", "p0:x1", "p1:x0", lf.Elastic(normal=lf.FromSamples("k", OBSERVED[name])))
    scene.fix("p0:x0", components=0)
    scene.traction("p1:x1", (-LOAD, 0.0), name="load")
    answer = lf.solve(lf.assemble(scene), accuracy=0.1, quantity="stop", progress=False)
    mean, std = exact(OBSERVED[name])
    assert answer.errors().reached
    assert answer.mean_std("stop").mean == pytest.approx(mean, abs=0.1 * std)
    assert answer.mean_std("stop").std == pytest.approx(std, rel=0.1)
