"""Many points as combinations of solved ones, against solves of these points by themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import ProblemFunction, Response, geometry
from dolfinx_frontend.evaluate import reduced
from dolfinx_frontend.evaluate.reduced import FEWEST, Reduced

Array = npt.NDArray[np.float64]


def stacked(law: Any) -> lf.Problem:
    """Two blocks, joined by a law on the whole face and by a spring with a jump."""
    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((20.0, 30.0, 10.0), (3, 3, 2), (0.0, 0.0, 10.0 * level))
        scene.substructure(name, part, lf.LinearElastic(200e3, 0.3), degree=1)
    scene.fix("base:z0")
    scene.interface("joint", "base:z1", "cover:z0", law)
    stud = lf.Elastic(normal=2000.0, tangential=50.0, jump=-1e-3)
    scene.interface("stud", "base:x1", stud)
    scene.force("cover:z1", (300.0, 100.0, -1500.0), name="push")
    return lf.assemble(scene)


def spread(function: ProblemFunction, count: int = FEWEST) -> Array:
    rng = np.random.default_rng(5)
    return np.asarray(function.nominal * np.exp(rng.normal(0.0, 0.3, (count, function.dimension))))


@pytest.mark.parametrize("inputs", [
    ["joint.normal", "joint.tangential"],
    ["joint.normal", "stud.normal", "stud.tangential"],
])  # fmt: skip
def test_values_and_bounds(inputs: list[str]) -> None:
    """Forces, jumps, displacements of parts, and what is not linear in them."""
    problem = stacked(lf.Elastic(normal=300.0, tangential=100.0))
    quantities = {
        "joint": "joint",
        "slip": lf.Resultant("joint", "jump", 1),
        "corner": lf.AtPoint(problem, "cover", (20.0, 30.0, 20.0), component="x"),
        "largest": Response(lambda block: np.abs(block.force("joint")[..., 0]).max(axis=1), "largest"),
    }
    many = problem.function(quantities, inputs)
    x = spread(many)
    found = many.evaluate(x)
    assert many._reduced is not None and np.all(found.converged) and many.solves == FEWEST
    assert np.all(found.error <= many.plan.options.rtol)
    some = slice(0, FEWEST, 20)
    exact = problem.function(quantities, inputs, options=lf.Options(rtol=1e-11))(x[some])
    # a bound of the energy norm; quantities are no worse than a small multiple
    assert np.all(np.abs(found.values[some] / exact - 1.0) < 3e-6)


def test_springs_that_are_equal_only_in_the_first_batch() -> None:
    problem = stacked(lf.Elastic(normal=300.0, tangential=100.0))
    function = problem.function("joint", ["joint.normal", "joint.tangential"])
    x = spread(function)
    alike = np.column_stack([x[:, 0], x[:, 0]])
    function(alike)
    found = function(x)
    exact = problem.function("joint", function.inputs, options=lf.Options(rtol=1e-11))(x[:20])
    assert found[:20] == pytest.approx(exact, rel=3e-6)


def test_groups_of_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each point is in one group; values are those of one basis."""
    problem = stacked(lf.Elastic(normal=300.0, tangential=100.0))
    function = problem.function("joint", ["joint.normal", "stud.normal"])
    x = spread(function)
    one = function(x)
    monkeypatch.setattr(reduced, "MANY", 150)
    groups = reduced.neighbours(x)
    assert len(groups) == 4 and np.array_equal(np.sort(np.concatenate(groups)), np.arange(FEWEST))
    assert problem.function("joint", function.inputs)(x) == pytest.approx(one, rel=3e-6)


def test_where_it_does_not_apply() -> None:
    """Contact, moduli, loads and few points are solved one by one."""
    contact = stacked(lf.Contact(stiffness=300.0, friction=0.4))
    springs = stacked(lf.Elastic(normal=300.0, tangential=100.0))
    for problem, inputs in (
        (contact, ["joint.stiffness"]), (springs, ["cover.E"]), (springs, ["push.x", "joint.normal"]),
    ):  # fmt: skip
        function = problem.function("joint", inputs)
        parameters = function._inputs.parameters(function.plan, function.nominal[None])
        assert Reduced.of(function.solver, parameters) is None
    function = springs.function("joint", ["joint.normal"])
    function(spread(function, 50))
    assert function._reduced is None
