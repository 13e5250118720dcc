"""A contact that is met in a window of the germs only: points go where the chaos has another state of it."""

from __future__ import annotations

import numpy as np
import pytest

import dolfinx_frontend as lf

CASES = {  # germs, middle and half width of the window in deviations, stiffness of the stop, accuracy
    "one germ": (1, 0.9, 0.2, 45.0, 0.1),
    "one germ, narrow": (1, 0.487, 0.036, 1.6, 0.01),
    "two germs": (2, -1.0, 0.12, 15.0, 0.03),
    "three germs": (3, 1.5, 0.041, 1.9, 0.03),
}


@pytest.mark.parametrize("name", CASES)
def test_a_stop_that_is_met_in_a_window(name: str) -> None:
    """F = 1 + k (1 - ((a - m) / e)^2)+ of a standard normal number a, which is a sum of germs."""
    germs, middle, width, stiffness, accuracy = CASES[name]
    scene = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(float(i), 0.0))
        scene.substructure(f"p{i}", part, lf.LinearElastic(E=1e8, nu=0.0), degree=1)
        scene.symmetry(f"p{i}:y0")
    at: lf.Normal = germs**-0.5 * lf.Normal("a0", 0.0, std=1.0)
    for k in range(1, germs):
        at = at + germs**-0.5 * lf.Normal(f"a{k}", 0.0, std=1.0)
    gap = ((at - middle) / width) ** 2
    scene.interface("soft", "p0:x1", "p1:x0", lf.Elastic(normal=1.0))
    scene.interface("stop", "p0:x1", "p1:x0", lf.Contact(gap=gap, stiffness=stiffness))
    scene.fix("p0:x0", components=0)
    scene.fix("p1:x1", -1.0, components=0, name="grip")
    answer = lf.solve(lf.assemble(scene), accuracy=accuracy, quantity="grip", progress=False)
    x = np.linspace(-width, width, 20001)
    share = np.exp(-0.5 * (middle + x) ** 2) / np.sqrt(2.0 * np.pi) * (x[1] - x[0])
    stop = stiffness * (1.0 - (x / width) ** 2)
    mean = 1.0 + share @ stop
    std = np.sqrt(share @ stop**2 - (mean - 1.0) ** 2)
    found = answer.mean_std("grip")
    assert answer.errors().reached
    assert -found.mean == pytest.approx(mean, rel=accuracy)
    assert found.std == pytest.approx(std, rel=accuracy)
