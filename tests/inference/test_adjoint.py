"""Adjoint derivatives against direct ones and against differences of solves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import ProblemFunction, Response
from dolfinx_frontend.evaluate.system import REACH, System
from tests.inference.joints import RARE, D, K, joints
from tests.inference.test_function import (
    STEP,
    TIGHT,
    blocks,
    corner,
    field,
    friction,
    heat_and_moduli,
    history,
    scores,
)

Array = npt.NDArray[np.float64]


EPS = float(np.finfo(float).eps)


@pytest.fixture(autouse=True)
def amplified(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Linear systems to 1e-10, so that the two ways differ by their own errors; and how many times larger
    than its right-hand side the answer of each system is."""
    monkeypatch.setattr(System, "near", 1e-10)
    monkeypatch.setattr(System, "idle", 64)
    found: list[float] = []
    solve = System.solve

    def noted(self: System, right: Array, widths: Array | None = None) -> tuple[Array, float]:
        answer, residual = solve(self, right, widths)
        sizes = self.sets(right)
        found.extend(self.sets(answer)[sizes > 0.0] / sizes[sizes > 0.0])
        return answer, residual

    monkeypatch.setattr(System, "solve", noted)
    return found


def gaps() -> ProblemFunction:
    """Germs of a rough face, partial slip."""
    gap = lf.RandomField("g", mean=0.0, std=1e-4, length=5.0, modes=16)
    scene = blocks(lf.Contact(stiffness=1e4, gap=gap, friction=0.3))
    scene.force("cover:z1", (300.0, 0.0, -1500.0), name="push")
    problem = lf.assemble(scene)
    return problem.function({"u": corner(problem, "x"), "w": corner(problem, "z")}, options=TIGHT)


def moduli() -> ProblemFunction:
    """A stiffness that differs from cell to cell, a heated part, and the stress in it."""
    scene = lf.Scene()
    factor = lf.RandomField("a", mean=1.0, cov=0.2, length=20.0, modes=6, distribution="lognormal")
    for level, name in enumerate(("base", "cover")):
        part = lf.geometry.box((20.0, 30.0, 10.0), (3, 3, 2), (0.0, 0.0, 10.0 * level))
        steel = lf.LinearElastic(200e3, 0.3, alpha=1e-5)
        scene.substructure(name, part, steel, degree=1, stiffness=factor if level else 1.0)
    scene.fix("base:z0")
    scene.interface("joint", "base:z1", "cover:z0", lf.Contact(friction=0.2, stiffness=1e4))
    scene.interface("spring", "base:z1", "cover:z0", lf.Elastic(normal=1.0, tangential=5.0))
    scene.force("cover:z1", (300.0, 0.0, -1500.0), name="push")
    scene.temperature("cover", 20.0, name="heat")
    problem = lf.assemble(scene)
    stress = lf.AtPoint(problem, "cover", (7.0, 11.0, 14.0), "stress", "mises")
    inputs = ["joint.friction", "push.x", "heat.dT", *(f"a[{k}]" for k in range(6))]
    return problem.function({"u": corner(problem, "x"), "mises": stress}, inputs, options=TIGHT)


def unsymmetric() -> ProblemFunction:
    """A law whose stiffness is no symmetric matrix."""
    matrix = np.array([[100.0, 20.0, 0.0], [-15.0, 60.0, 10.0], [5.0, -8.0, 60.0]])

    def force(jump: Array, size: Array) -> Array:
        return np.asarray(size[:, None] * np.einsum("ab,pbc->pac", matrix, jump))

    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = lf.geometry.box((20.0, 30.0, 10.0), (2, 2, 1), (0.0, 0.0, 10.0 * level), cell="hexahedron")
        scene.substructure(name, part, lf.LinearElastic(200e3, 0.3), degree=1)
    scene.fix("base:z0")
    scene.interface("joint", "base:z1", "cover:z0", lf.UserLaw(force=force, values={"size": 1.0}))
    scene.force("cover:z1", (300.0, 0.0, 3000.0), point=(14.0, 15.0, 20.0), name="pull")
    problem = lf.assemble(scene)
    inputs = ["pull.z", "joint.size", "cover.E"]
    return problem.function({"u": corner(problem, "x")}, inputs, options=TIGHT)


def debonding() -> ProblemFunction:
    """Softening, unloading and loading again."""
    scene = blocks(lf.Debonding(normal=1e3, tangential=1e3, strength=1.0, energy=0.02))
    scene.interface("holds", "base:z1", "cover:z0", lf.Elastic(normal=20.0, tangential=20.0))
    on = lf.Amplitude([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.3, 1.2])
    scene.force("cover:z1", (50.0 * on, 0.0, 500.0 * on), point=(16.0, 15.0, 20.0), name="pull")
    problem = lf.assemble(scene)
    inputs = ["pull.z", "pull.x", "joint.normal", "joint.strength"]
    quantity = {"u": corner(problem, "z")}
    return problem.function(quantity, inputs, times=[1.0, 2.0, 3.0], options=TIGHT)


@pytest.mark.parametrize(
    "made",
    [friction, history, heat_and_moduli, field, scores, gaps, moduli, unsymmetric, debonding],
)
def test_both_ways_agree(made: Callable[[], ProblemFunction], amplified: list[float]) -> None:
    """What the two may differ by is the residual of the direct way: a difference over REACH of laws that are
    known to EPS leaves EPS / REACH of its answer."""
    function = made()
    x = function.nominal
    x = np.where(x == 0.0, np.resize([0.3, -0.2, 0.5], len(x)), x)
    function(x)
    one = function.derivatives(x, way="direct")
    rounding = EPS / REACH * max(amplified)
    other = function.derivatives(x, way="adjoint")
    assert one.way == "direct" and other.way == "adjoint" and other.residual < 1e-9
    size = np.maximum(np.abs(function(x)), np.abs(one.values * x).max(axis=1))[:, None]
    assert one.residual <= 1e-10 + 4.0 * rounding
    assert np.all(np.abs(one.values - other.values) * np.abs(x) <= (1e-8 + one.residual) * size)


@pytest.mark.parametrize("made", [gaps, moduli])
def test_many_inputs_take_the_adjoint_way(made: Callable[[], ProblemFunction]) -> None:
    """Central differences of solves to 1e-6 of the quantity."""
    function = made()
    x = function.nominal
    x = np.where(x == 0.0, np.resize([0.3, -0.2, 0.5], len(x)), x)
    found = function.derivatives(x)
    assert found.way == "adjoint" and not found.kinks.any()
    value = np.abs(function(x))
    for k in {0, 2, 5, len(x) - 1}:
        away = STEP * abs(x[k]) * np.eye(len(x))[k]
        slope = (function(x + away) - function(x - away)) / (2.0 * away[k])
        error = np.abs(found.values[:, k] - slope) * abs(x[k])
        assert np.all(error <= 1e-6 * np.maximum(value, np.abs(found.values * x).max(axis=1)))


def test_where_there_is_no_adjoint_the_direct_way_is_taken() -> None:
    """A kink of the law, which is flagged, and a minimum of numbers that are all equal."""
    problem = joints(RARE)
    function = problem.function({"joint": "joint"}, options=TIGHT)
    at = np.array([K, D, K * D])
    assert function.derivatives(at, way="adjoint").way == "direct"
    assert function.derivatives(at, way="adjoint").kinks.any()
    away = function.nominal
    assert function.derivatives(away, way="adjoint").way == "adjoint"
    opening = problem.function(Response.opening("joint"), options=TIGHT)
    assert opening.derivatives(away, way="adjoint").way == "direct"
    with pytest.raises(lf.SceneError, match="unknown way 'backwards'"):
        opening.derivatives(away, way="backwards")  # type: ignore[arg-type]


def test_long_histories_are_worked_out_directly(monkeypatch: pytest.MonkeyPatch) -> None:
    function = history()
    x = function.nominal
    function(x)
    monkeypatch.setattr("dolfinx_frontend.evaluate.adjoint.MOST_SLOPES", 100.0)
    assert function.derivatives(x, way="adjoint").way == "direct"
