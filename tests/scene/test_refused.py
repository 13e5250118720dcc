"""What hostile scripts gave: one error that names it, no traceback of a library, no wrong number."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Chaos,
    Contact,
    Correlated,
    Elastic,
    FromSamples,
    LinearElastic,
    LogNormal,
    RandomField,
    Scene,
    SceneError,
    UserLaw,
    assemble,
    geometry,
    io,
    sample,
    solve,
    sweep,
)

MASKED = np.ma.masked_array([1.0, 2.0, 1e30], [0, 0, 1])


def joined(law: Any = None, push: Any = None) -> Any:
    """Two blocks with a law between them."""
    scene = Scene()
    for k in range(2):
        box = geometry.box((1.0, 1.0), (2, 2), origin=(float(k), 0.0))
        scene.substructure(f"b{k}", box, LinearElastic(E=1000.0, nu=0.25), degree=1)
    scene.fix("b0:x0")
    scene.fix("b1:x1", (1e-3, 2e-4) if push is None else push)
    scene.interface("joint", "b0:x1", "b1:x0", Elastic(normal=100.0, tangential=30.0) if law is None else law)
    return assemble(scene)


def refused(call: Callable[[], Any], *words: str) -> None:
    with pytest.raises(SceneError) as told:
        call()
    assert all(word in str(told.value) for word in words), str(told.value)


def fails(_: Any) -> Any:
    raise ZeroDivisionError("no")


def test_masked_arrays_are_refused_by_name() -> None:
    four = np.ma.masked_array([1.0] * 4, [1, 0, 0, 0])
    refused(lambda: joined(Contact(gap=four)), "gap", "masked array")
    refused(lambda: joined(Elastic(normal=np.ma.masked, tangential=1.0)), "normal", "masked array")
    refused(lambda: joined(Elastic(normal=lambda x: four, tangential=1.0)), "normal", "masked array")
    refused(lambda: joined(push=np.ma.masked_array([1.0, 2.0], [0, 1])), "masked array")
    refused(lambda: FromSamples("k", MASKED), "masked array")
    refused(lambda: LinearElastic(E=np.ma.masked, nu=0.2), "E = ")
    refused(lambda: LogNormal("k", 1.0, cov=np.ma.masked), "masked array")
    refused(lambda: geometry.box(np.ma.masked_array([1.0, 2.0], [0, 1]), (1, 1)), "lengths", "masked array")
    two = [LogNormal("k", 1.0, cov=0.1), LogNormal("g", 1.0, cov=0.1)]
    refused(lambda: Correlated(two, np.ma.masked_array(np.eye(2), [[0, 1], [1, 0]])), "masked array")
    problem = joined()
    refused(lambda: sweep(problem, {"joint.normal": MASKED}, progress=False), "joint.normal", "masked array")
    refused(lambda: solve(problem).table(about=np.ma.masked_array([0.0, 0.0], [0, 1])), "masked array")


def test_functions_that_raise_are_named() -> None:
    told = ("'joint'", "'normal'", "ZeroDivisionError: no")
    refused(lambda: joined(Elastic(normal=fails, tangential=1.0)), *told)
    problem = joined()
    grid = {"joint.normal": [1.0]}
    refused(lambda: sweep(problem, grid, outputs={"q": fails}, progress=False), "outputs['q']", told[2])
    refused(lambda: solve(problem).quantity(fails, "pull"), "quantity 'pull'", "ZeroDivisionError")
    field = RandomField("k", 100.0, cov=0.1, modes=2, covariance=lambda x, y: x)
    random = joined(Elastic(normal=field, tangential=1.0))
    refused(lambda: solve(random, chaos=1), "'k'", "covariance", "TypeError")


def test_a_field_whose_length_is_below_its_points_is_refused() -> None:
    field = RandomField("k", 100.0, cov=0.1, modes=2, length=1e-9)
    random = joined(Elastic(normal=field, tangential=1.0))
    refused(lambda: solve(random, chaos=1), "'k'", "correlation length")


def test_numbers_out_of_range_are_refused() -> None:
    refused(lambda: LinearElastic(E=10**400, nu=0.2), "E = <integer of")
    refused(lambda: geometry.box((1.0, 1.0), (1, 1), origin=(1e20, 0.0)), "origin", "1e+20")
    refused(lambda: geometry.box((1.0, 1.0), (10**10, 10**10)), "divisions", "1.0e+20 cells")
    refused(lambda: solve(joined(push=1e308)), "'b1'", "1e+308")
    refused(lambda: sweep(joined(), {(): [1.0]}, progress=False), "axis = ()")
    dates = {"joint.normal": np.array(["2020-01-01"], "M8")}
    refused(lambda: sweep(joined(), dates, progress=False), "joint.normal")


def test_germs_out_of_reach_are_refused() -> None:
    problem = joined(Elastic(normal=LogNormal("k", 100.0, cov=0.3), tangential=30.0))
    result = solve(problem, chaos=2)
    refused(lambda: sample(problem, [[1e5]], progress=False), "no finite value", "100000")
    refused(lambda: result.at([[1e300]]), "at: ", "1e+300")
    one = result.quantity(lambda f: f.force("joint")[..., 0].max(axis=-1), samples=1)
    assert "mean" in str(one) and "std" not in str(one)
    refused(one.std, "one sample has no variance and no standard deviation")
    many = result.quantity(lambda f: f.force("joint")[..., 0].max(axis=-1), samples=16)
    refused(lambda: many.histogram(10**9), "bins", "1..1000000")


def test_names_that_no_file_can_have_are_refused(tmp_path: Path) -> None:
    result = solve(joined())
    for write in (
        lambda path: io.write(result, path),
        lambda path: sweep(result.problem, {"joint.normal": [1.0]}, checkpoint=path, progress=False),
    ):
        refused(lambda: write(tmp_path / ("a" * 300)), "300 bytes")
        refused(lambda: write(tmp_path / "\ud800"), "\\ud800")
    for put in (result.table().to_csv, result.save):
        with pytest.raises(ValueError, match="300 bytes|cannot be written"):
            put(tmp_path / ("a" * 297 + ".h5"))
        with pytest.raises(ValueError, match="no file name can have|cannot be written"):
            put(tmp_path / "\ud800.h5")


def test_parts_and_interfaces_are_copied_as_they_are_and_say_why_they_cannot_be_pickled() -> None:
    problem = joined()
    part, interface = problem.substructures["b0"], problem.interfaces["joint"]
    assert copy.deepcopy(part) is part
    assert copy.deepcopy(interface).sides[0] is interface.sides[0]
    for each in (part, interface):
        with pytest.raises(TypeError, match="cannot be pickled"):
            pickle.dumps(each)


def test_users_law_with_masked_forces_is_refused() -> None:
    law = UserLaw(force=lambda jump: np.ma.masked_array(100.0 * jump, np.zeros_like(jump)), name="masked")
    refused(lambda: solve(joined(law)), "masked")


@pytest.mark.parametrize("value", [np.array(3), np.ma.masked, np.array(3, dtype=object)])
def test_an_array_without_axes_is_no_list(value: Any) -> None:
    """It says of itself that it can be gone through."""
    calls: list[Callable[[], Any]] = [
        lambda: geometry.box((1.0, 1.0), value),
        lambda: Scene().fix(value),
        lambda: Chaos(order=2, weights=value),
    ]
    if value is np.ma.masked or value.dtype == object:
        calls.append(lambda: RandomField("k", 1.0, cov=0.1, length=value, modes=2))
    else:
        assert RandomField("k", 1.0, cov=0.1, length=value, modes=2).length == 3.0
    for call in calls:
        with pytest.raises(SceneError):
            call()


@pytest.mark.parametrize("time", ["", [], [0.0, 1.0], 1j, None, np.array([0.0, 1.0])])
def test_a_time_of_an_amplitude_is_a_number(time: Any) -> None:
    with pytest.raises(SceneError, match="Amplitude: time = .* is not a number"):
        Amplitude([0, 1], [0, 1])(time)
