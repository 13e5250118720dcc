"""Quantities of interest by the name of an interface."""

import numpy as np
import pytest
from scipy.stats import norm

from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    Normal,
    Quantile,
    Response,
    Resultant,
    Scene,
    SceneError,
    assemble,
    geometry,
    monte_carlo,
    solve,
)


def test_force_is_a_total_and_jump_is_a_mean():
    force = np.array([[1.0, 2.0], [3.0, 4.0]])
    weights = np.array([0.5, 2.0])
    assert Resultant("joint").total(force, weights) == 6.5
    assert Resultant("joint", "jump", 1).total(2.0 * force, weights) == pytest.approx(18.0 / 2.5)
    assert Resultant("joint").total(np.array([force, force]), weights).shape == (2,)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"of": "pressure"}, "use 'force' or 'jump'"),
        ({"component": 3}, "must be 0"),
        ({"component": -1}, "joint"),
    ],
)
def test_what_is_not_known_is_refused(settings, said):
    with pytest.raises(SceneError, match=said):
        Resultant("joint", **settings)


def test_a_component_that_the_interface_does_not_carry():
    with pytest.raises(SceneError, match="carries 1 component"):
        Resultant("joint", component=2).total(np.ones((2, 1)), np.ones(2))


def softened(random: bool) -> Scene:
    """Two squares in a row on springs with a gap behind them, pushed: the springs carry what the gap does."""
    scene = Scene()
    for k in range(3):
        part = geometry.box((1.0, 1.0), (1, 1), (float(k), 0.0), cell="quadrilateral")
        scene.substructure(f"r{k}", part, LinearElastic(1e5, 0.0), degree=1)
        scene.symmetry(f"r{k}:y0")
    scene.fix("r0:x0")
    scene.interface("springs", "r0:x1", "r1:x0", Elastic(normal=1e3, tangential=1e3))
    gap = Normal("g", -0.003, std=0.001) if random else -0.003
    scene.interface("gap", "r1:x1", "r2:x0", Contact(gap=gap))
    scene.fix("r2:x1", -0.01, components=0)
    return scene


FORCE, PER_GAP = 13.0 / (1.0 + 3e-2), 1e3 / (1.0 + 3e-2)
"""Closed form: the displacement and the interference over the compliance of springs and three squares."""


@pytest.mark.parametrize("scene", [False, True])
def test_springs_that_a_plan_assembles_across_have_numbers_by_name(scene: bool) -> None:
    """The pressure of springs that are eliminated otherwise: of a run, of what is random, its quantile."""
    for quantity, sign in (("springs.normal", -1.0), ("springs.pressure_max", 1.0)):
        for random in (False, True):
            made = softened(random)
            asked = made if scene else assemble(made)
            found = solve(asked, accuracy=1e-3, quantity=quantity, progress=False)
            errors = found.errors()
            assert errors.reached and errors.moments is not None and str(errors.quantity) == quantity
            assert errors.moments.mean == pytest.approx(sign * FORCE, rel=1e-3)
            if random:
                assert errors.moments.std == pytest.approx(1e-3 * PER_GAP, rel=1e-3)


@pytest.mark.parametrize("of", ["springs", "springs.normal"])
def test_a_quantile_of_springs_that_are_assembled_across(of: str) -> None:
    found = solve(assemble(softened(True)), accuracy=1e-2, quantity=Quantile(of, 0.05), progress=False)
    errors = found.errors()
    exact = -FORCE + 1e-3 * PER_GAP * norm.ppf(0.05)
    assert errors.moments is not None and errors.reached
    assert abs(errors.moments.mean - exact) <= 1e-2 * abs(exact)


def test_a_response_takes_a_number_by_name() -> None:
    problem = assemble(softened(True))
    samples = monte_carlo(problem, 3, active=["springs"], progress=False)
    found = Response("springs.pressure_max").read(samples)
    np.testing.assert_allclose(found, -Response("springs").read(samples), rtol=1e-9)  # on an area of 1
