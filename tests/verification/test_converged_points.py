"""Converged means right at every sample and point: a start from a neighbour is no reason to believe it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.verification.judged import Laws, Values, assert_right, connect, judged
from tests.verification.test_promise import FORCE, LENGTH, layers

STEEL = 2e5
SETTINGS: Any = pytest.mark.parametrize("newton", [{}, {"newton": 0}], ids=["default", "plain"])


def blocks(laws: Laws) -> lf.Scene:
    """Two blocks of 2 x 1, the upper one on a spring."""
    scene = lf.Scene()
    for k, name in enumerate("ab"):
        part = lf.geometry.box((2.0, 1.0), (12, 5), origin=(0.0, float(k)))
        scene.substructure(name, part, lf.LinearElastic(STEEL, 0.3), degree=1)
    faces = {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "guide": ["b:y1"]}
    return connect(scene, laws, faces | {"load": ["b:x1"], "press": ["b:y1"]}, joint="facets")


@SETTINGS
@pytest.mark.parametrize("rtol", [1e-2, 1e-3])
@pytest.mark.parametrize("which", ["friction", "gap"])
def test_samples_near_slip(which: str, rtol: float, newton: dict[str, int]) -> None:
    variables: dict[str, Any] = {
        "mu": lf.LogNormal("mu", 0.3, cov=0.4),
        "kc": lf.LogNormal("kc", 20.0 * STEEL, cov=0.5),
    }
    load, guide, pressure = (10.0, -2.0), (0.02 * STEEL, 0.002 * STEEL), 20.0
    if which == "gap":
        variables = {"g": lf.Normal("g", 2e-4, std=1e-4)}
        load, guide, pressure = (8.0, -12.0), (0.05 * STEEL, 0.02 * STEEL), 15.0

    def laws(a: Values, v: Values) -> Laws:
        if which == "gap":
            joint = lf.Contact(gap=v("g"), friction=0.3)
        else:
            joint = lf.Contact(friction=v("mu"), stiffness=v("kc"))
        return {
            "foot": lf.Displacement(0.0),
            "joint": joint,
            "guide": lf.Elastic(normal=guide[0], tangential=guide[1]),
            "load": lf.Traction(np.array(load)),
            "press": lf.Pressure(pressure),
        }

    def run(problem: lf.Problem) -> Any:
        options = lf.Options(rtol=rtol, **newton)
        return lf.monte_carlo(problem, 40, seed=3, options=options, keep_states=True, progress=False)

    random = {"variables": variables, "random": ["joint"]}
    assert_right(judged("samples", laws, blocks, run, rtol, **random))


def test_samples_from_tangents_that_were_kept() -> None:
    """Samples of linear laws start from the tangents of the mean, which a solver keeps: later ones are as
    right as the first, however far off the mean they are, also where two threads draw at once."""
    law = lf.LogNormal("k", 40.0, cov=20.0)  # over ten decades
    options = lf.Options(rtol=1e-8)
    problem = layers(law, 15.0)
    result = lf.solve(problem, chaos=lf.Chaos(order=1), options=options, progress=False)

    def off(seed: int) -> float:
        samples = result.monte_carlo(60, seed=seed, progress=False)
        jump = np.mean(samples.jump("l0")[..., 0], axis=-1)
        exact = FORCE / law.value(samples.germs[:, 0])
        rest = FORCE / 15.0 + 3.0 * FORCE * LENGTH / 200.0
        return float(np.max(np.abs(jump - exact) / (exact + rest)))

    with ThreadPoolExecutor(2) as pool:
        assert max(*map(off, range(3)), *pool.map(off, range(3, 9))) <= 1e-7
