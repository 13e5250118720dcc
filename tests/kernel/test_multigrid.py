"""Bodies without a factor: the same answers as with one, to the accuracy that was asked for, and plain
refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from latin_core import NumericalError
from petsc4py import PETSc as _PETSc

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    Normal,
    Options,
    Perfect,
    Problem,
    Scene,
    assemble,
    geometry,
    monte_carlo,
    reference,
    solve,
    sweep,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.kernel import fitting
from dolfinx_frontend.kernel.multigrid import PREFIX

PETSc: Any = _PETSc

MULTIGRID = Options(backend="multigrid", rtol=1e-6)


def blocks(law: Any, degree: int = 2, cell: str = "hexahedron", cells: int = 3) -> Problem:
    """Three blocks, the last two glued, on an elastic foundation: pushed, pulled down at the end, and
    shortened."""
    scene = Scene()
    steel = LinearElastic(E=200e3, nu=0.3)
    for k in range(3):
        box = geometry.box((10.0, 10.0, 10.0), (cells,) * 3, origin=(10.0 * k, 0.0, 0.0), cell=cell)
        scene.substructure(f"b{k}", box, steel, degree=degree)
    scene.interface("ground", "b0:x0", Elastic(normal=2e4, tangential=1e4))
    scene.interface("joint", "b0:x1", "b1:x0", law)
    scene.interface("glue", "b1:x1", "b2:x0", Perfect())
    scene.fix("b2:x1", (0.0, 0.0, -0.01))
    scene.pressure("b1:z1", 20.0)
    return assemble(scene)


def apart(problem: Problem, one: Any, other: Any) -> float:
    return float(reference.energy_error(problem, one, other))


ELASTIC = Elastic(normal=5e3, tangential=2e3, jump=(0.01, 0.0, 0.0))


@pytest.mark.parametrize(
    ("degree", "cell"), [(2, "hexahedron"), (2, "tetrahedron"), (1, "hexahedron"), (3, "hexahedron")]
)
def test_a_direct_solution(degree: int, cell: str) -> None:
    """Loads, prescribed displacements and springs inside one body."""
    problem = blocks(ELASTIC, degree, cell, 2 if degree == 3 else 3)
    exact, found = solve(problem), solve(problem, options=MULTIGRID)
    assert found.converged and found.error <= MULTIGRID.rtol
    assert apart(problem, found.displacements, exact.displacements) <= MULTIGRID.rtol
    for name in ("joint", "ground"):
        scale = np.abs(exact.force(name)).max()
        assert np.abs(found.force(name) - exact.force(name)).max() <= 1e-3 * scale


def test_an_active_joint() -> None:
    problem = blocks(ELASTIC)
    exact = solve(problem, active=["joint"], options=Options(rtol=1e-9))
    found = solve(problem, active=["joint"], options=MULTIGRID)
    assert found.converged
    assert apart(problem, found.displacements, exact.displacements) <= MULTIGRID.rtol
    coarser = solve(problem, active=["joint"], options=MULTIGRID.with_(rtol=1e-2))
    finer = coarser.continuation(coarser, 1e-5)
    assert finer.converged and finer.error <= 1e-5
    assert apart(problem, finer.displacements, exact.displacements) <= 1e-5


def test_a_random_joint() -> None:
    """All coefficients of a chaos; few cycles answer them all."""
    normal, tangential = Normal("n", 5e3, cov=0.2), Normal("t", 2e3, cov=0.1)
    problem = blocks(Elastic(normal=normal, tangential=tangential, jump=(0.01, 0.0, 0.0)))
    chaos = Chaos(3, check_points=0)
    exact = reference.ssfem(problem, chaos, rtol=1e-11)
    found = solve(problem, chaos=chaos, options=MULTIGRID)
    own = {name: found.coefficients(name) for name in problem.substructures}
    assert found.converged and found.error <= MULTIGRID.rtol
    assert apart(problem, own, exact.coefficients) <= MULTIGRID.rtol
    assert found.solver.space is not None and found.solver.space.count < 150


def test_options_of_petsc_go_first() -> None:
    problem = blocks(ELASTIC, cells=2)
    exact = solve(problem)
    options = PETSc.Options()
    options[f"{PREFIX}pc_type"] = "icc"
    try:
        found = solve(problem, options=MULTIGRID.with_(rtol=1e-3))
    finally:
        options.delValue(f"{PREFIX}pc_type")
    assert apart(problem, found.displacements, exact.displacements) <= 1e-3
    assert found.solver.space is not None
    assert found.solver.space.bodies.multigrid.pc.getType() == "icc"


def test_what_a_basis_for_one_answer_does_not_have() -> None:
    problem = blocks(ELASTIC)
    grid = {"joint.normal": [4e3, 5e3]}
    with pytest.raises(SceneError, match="'multigrid' solves one linear run"):
        sweep(problem, grid, options=MULTIGRID)
    with pytest.raises(SceneError, match="'joint': its law is nonlinear, and backend 'multigrid'"):
        solve(blocks(Contact()), options=MULTIGRID)
    random = blocks(Elastic(normal=Normal("n", 5e3, cov=0.2), tangential=2e3))
    with pytest.raises(SceneError, match="'multigrid' solves one linear run"):
        monte_carlo(random, 10, options=MULTIGRID)
    found = solve(problem, options=MULTIGRID)
    with pytest.raises(SceneError, match="has a basis for one answer"):
        found.solver.response_to({})


def test_indices_of_64_bits() -> None:
    problem = blocks(ELASTIC, cells=2)
    exact = solve(problem, active=["joint"], options=Options(rtol=1e-9))
    found = solve(problem, active=["joint"], options=Options(rtol=1e-9, backend="cholmod64"))
    assert [cost["backend"] for cost in found.solver.costs] == ["cholmod64"] * 2
    assert apart(problem, found.displacements, exact.displacements) <= 1e-9


def test_cycles_that_do_not_converge(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lower level that is of no use, near incompressibility: no answer, and a way out."""
    scene = Scene()
    box = geometry.box((10.0, 10.0, 10.0), (2, 2, 2), cell="hexahedron")
    scene.substructure("b", box, LinearElastic(E=200e3, nu=0.4999), degree=2)
    scene.fix("b:x0")
    scene.traction("b:x1", (0.0, 0.0, 1.0))
    monkeypatch.setattr(fitting, "ROUNDS", 8)
    with pytest.raises(NumericalError, match="ended at an error of .*: use backend='cholmod'"):
        solve(assemble(scene), options=MULTIGRID)
