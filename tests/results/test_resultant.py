"""Quantities of interest by the name of an interface."""

import numpy as np
import pytest

from dolfinx_frontend import Resultant, SceneError


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
