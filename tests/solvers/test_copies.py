"""What can leave its process can be pickled; what cannot says so and what to do; copies never fail."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf

PAIR = lf.Correlated([lf.Normal("a", 1.0, cov=0.1), lf.Normal("b", 1.0, cov=0.1)], [[1.0, 0.5], [0.5, 1.0]])
RANDOM: list[Any] = [
    lf.Normal("k", 1.0, cov=0.1),
    lf.TruncatedNormal("k", 1.0, cov=0.1, within=2.0),
    lf.LogNormal("k", 1.0, cov=0.1),
    lf.Uniform("k", 0.0, 1.0),
    lf.Gamma("k", 1.0, cov=0.1),
    lf.Beta("k", 2.0, 3.0),
    lf.FromSamples("k", [1.0, 2.0, 4.0]),
    PAIR["b"],
]


def problem(stiffness: Any) -> tuple[lf.Scene, lf.Problem]:
    """Two squares with an elastic layer between them."""
    scene = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        scene.substructure(f"p{i}", part, lf.LinearElastic(1.0, 0.3), degree=1)
    scene.fix("p0:y0", name="foot")
    scene.pressure("p1:y1", 1.0, "top")
    scene.interface("layer", "p0:y1", "p1:y0", lf.Elastic(stiffness, 5.0))
    return scene, lf.assemble(scene)


@pytest.mark.parametrize("parameter", RANDOM, ids=repr)
@pytest.mark.parametrize("way", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_random_parameters(parameter: Any, way: Any) -> None:
    other = way(parameter)
    assert other == parameter and hash(other) == hash(parameter) and repr(other) == repr(parameter)
    germs = np.array([-0.5, 0.0, 0.7])
    np.testing.assert_array_equal(other.value(germs), parameter.value(germs))
    for one, two in zip(other.germ.recurrence(3), parameter.germ.recurrence(3), strict=True):
        np.testing.assert_array_equal(one, two)


def test_spaces_and_bases() -> None:
    result = lf.solve(problem(RANDOM[2])[1], chaos=2, progress=False)
    points = np.array([[-1.0], [0.3]])
    for way in (copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))):
        np.testing.assert_array_equal(way(result.basis).evaluate(points), result.basis.evaluate(points))
        assert way(result.space).germ_names == result.space.germ_names
        np.testing.assert_array_equal(way(result.space).sample(3, 1), result.space.sample(3, 1))


def test_what_lives_in_its_process() -> None:
    scene, assembled = problem(RANDOM[0])
    result = lf.solve(assembled, progress=False)
    samples = lf.monte_carlo(assembled, 2, progress=False)
    found = [
        scene, scene.substructures["p0"].part, assembled, result, samples,
    ]
    for each in found:
        with pytest.raises(TypeError, match=f"a {type(each).__name__} cannot be pickled: it"):
            pickle.dumps(each)
    for each in found[1:]:
        assert copy.deepcopy(each) is each and copy.copy(each) is each
    other = copy.deepcopy(scene)
    other.pressure("p1:x0", 1.0, "more")
    assert "more" in other.interfaces and "more" not in scene.interfaces
    for value in (result.table(), result.plan, result.plan.options, result.errors()):
        assert repr(pickle.loads(pickle.dumps(value))) == repr(copy.deepcopy(value)) == repr(value)


def soft(jump: Any) -> Any:
    return 10.0 * jump


def test_laws_of_users() -> None:
    """A function that pickle cannot find by name is told with its law; copies need no pickle."""
    law = lf.UserLaw(force=soft)
    assert pickle.loads(pickle.dumps(law)) == law
    law = lf.UserLaw(force=lambda jump: 2.0 * jump, name="rubber")
    with pytest.raises(pickle.PicklingError, match="UserLaw 'rubber': its force cannot be pickled .*lambda"):
        pickle.dumps(law)
    with pytest.raises(pickle.PicklingError, match="UserLaw 'rubber'"):
        pickle.dumps({"layer": [law]})
    assert copy.copy(law) == copy.deepcopy(law) == law
    assert copy.deepcopy([law]) == [law]


def test_by_value_where_somebody_can() -> None:
    """Picklers that take functions by value, cloudpickle and dill, are not stopped."""
    law = lf.UserLaw(force=lambda jump: 2.0 * jump, name="rubber")
    names: dict[str, Any] = {"__name__": "joblib.externals.cloudpickle.cloudpickle", "law": law}
    exec("found = law.__reduce_ex__(4)", names)
    assert names["found"][2]["force"] is law.force
