"""Which way fits into the memory: said, and chosen, before anything is factorised."""

from __future__ import annotations

import resource
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    Normal,
    Options,
    Problem,
    Scene,
    assemble,
    geometry,
    make_plan,
    solve,
    sweep,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.plan import plan as planning
from dolfinx_frontend.reference.cholesky import _reason


@pytest.fixture(scope="module")
def problem() -> Problem:
    scene = Scene()
    for k in range(2):
        box = geometry.box((1.0, 1.0, 1.0), (3, 3, 3), origin=(float(k), 0.0, 0.0), cell="hexahedron")
        scene.substructure(f"b{k}", box, LinearElastic(E=200e3, nu=0.3), degree=2)
    scene.fix("b0:x0")
    scene.interface("joint", "b0:x1", "b1:x0", Elastic(normal=Normal("k", 1e5, cov=0.2), tangential=1e5))
    scene.pressure("b1:z1", 1.0)
    return assemble(scene)


def with_free(monkeypatch: pytest.MonkeyPatch, free: float) -> None:
    monkeypatch.setattr(planning, "available_memory", lambda: free)


def lines(plan: Any) -> dict[str, Any]:
    return {line.what: line for line in plan.decisions}


def test_multigrid_where_a_factor_does_not_fit(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    cost = make_plan(problem).cost
    assert cost is not None
    with_free(monkeypatch, 0.9 * cost.direct)
    plan = make_plan(problem)
    assert plan.options.backend == "multigrid"
    assert "factors would need" in lines(plan)["bodies"].reason
    assert make_plan(problem, options=Options(backend="cholmod")).options.backend == "cholmod"
    chaos, options = Chaos(2, check_points=0), Options(rtol=1e-4)
    with_free(monkeypatch, 1e12)
    factorised = solve(problem, chaos=chaos, options=options)
    assert factorised.solver.space is None and factorised.plan.cost is not None
    with_free(monkeypatch, 0.9 * factorised.plan.cost.direct)
    found = solve(problem, chaos=chaos, options=options)
    assert found.solver.space is not None and found.converged
    forces = factorised.force("joint"), found.force("joint")
    assert np.abs(forces[1] - forces[0]).max() <= 1e-2 * np.abs(forces[0]).max()


def test_sweeps_where_a_factor_does_not_fit(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    cost = make_plan(problem, vary=["joint"]).cost
    assert cost is not None
    with_free(monkeypatch, 0.9 * cost.direct)
    line = lines(make_plan(problem, vary=["joint"]))["bodies"]
    assert "multigrid" in line.choice and " s of processor time" in line.choice
    found = sweep(problem, {"joint.normal": [5e4, 1e5, 2e5]})
    assert found.solver.space is not None and np.all(found.converged)
    with_free(monkeypatch, 1e12)
    exact = sweep(problem, {"joint.normal": [5e4, 1e5, 2e5]}, options=Options(rtol=1e-9))
    size = np.abs(exact.force("joint")).max()
    assert np.abs(found.force("joint") - exact.force("joint")).max() <= 1e-3 * size


def test_what_would_do(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Contact that does not fit: the part to cut, machines, and why there is no multigrid."""
    contact = problem.with_laws({"joint": Contact(friction=0.3)})
    cost = make_plan(contact).cost
    assert cost is not None
    with_free(monkeypatch, 0.9 * cost.direct)
    assert "factors may not fit" in lines(make_plan(contact))["memory"].choice
    with_free(monkeypatch, 0.3 * cost.direct)
    what = (
        r"factors of \d+ unknowns need about .*B, and .*B are free: .*cut 'b1', whose factor needs .*B, into "
        r"parts with Perfect\(\) between them, or spread .* 4 machines.*the laws of 'joint' are nonlinear"
    )
    with pytest.raises(SceneError, match=what):
        make_plan(contact)


def test_the_faster_way(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where both fit, multigrid has to be twice as fast by its price."""
    with_free(monkeypatch, 1e12)
    monkeypatch.setattr(planning, "_LARGE", 1)
    assert make_plan(problem).options.backend != "multigrid"
    monkeypatch.setattr(planning, "_WORTH", 1e-3)
    line = lines(make_plan(problem))["bodies"]
    assert "factors would take" in line.reason and "multigrid" in line.choice
    by_factors = make_plan(problem, options=Options(backend="cholmod")).price
    assert by_factors is not None and by_factors.seconds > 0.0


def test_a_limit_of_the_process() -> None:
    before = available_memory()
    assert before > 0.0
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (2**40, hard))
        assert available_memory() <= 2**40
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_why_a_factor_failed() -> None:
    """Memory that ran out is not a structure that moves."""
    matrix = sp.eye(10, format="csr")
    said = (("CHOLMOD analysis failed with status -2", 76), ("status -3", 76), ("Out of memory", 55))
    for text, code in said:
        assert "has not enough memory" in _reason("cholmod", matrix, text, code)
    assert "not positive definite" in _reason("cholmod", matrix, "failed with status 1", 76)
