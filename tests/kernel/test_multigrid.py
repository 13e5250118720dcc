"""Bodies without a factor: the same answers as with one, to the accuracy that was asked for, and plain
refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from latin_core import NumericalError
from petsc4py import PETSc as _PETSc

from dolfinx_frontend import (
    Amplitude,
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Normal,
    Options,
    Perfect,
    Problem,
    Resultant,
    Scene,
    assemble,
    discretisation_error,
    geometry,
    monte_carlo,
    reference,
    solve,
    sweep,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.kernel import fitting, subspace
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


def test_a_lower_level_without_a_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where its factor does not fit into the memory, as of five million unknowns."""
    problem = blocks(ELASTIC, cells=4)
    exact, factorised = solve(problem), solve(problem, options=MULTIGRID)
    monkeypatch.setattr(subspace, "available_memory", lambda: 1.0)
    found = solve(problem, options=MULTIGRID)
    assert found.solver.space is not None and factorised.solver.space is not None
    assert found.solver.space.bodies.multigrid.kind == "linear shape functions, aggregation"
    assert found.solver.space.count <= 1.2 * factorised.solver.space.count
    assert found.converged and apart(problem, found.displacements, exact.displacements) <= MULTIGRID.rtol


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


def of_points(problem: Problem, exact: Any, found: Any) -> np.ndarray:
    """Errors (points,) in the energy norm of the parts."""
    pairs = [(found.point(*at), exact.point(*at)) for at in np.ndindex(*exact.shape)]
    errors = [
        reference.energy_error(problem, one.displacements, other.displacements, springs=False)
        for one, other in pairs
    ]
    return np.array(errors)


GRID = {
    ("joint.normal", "joint.tangential"): np.geomspace(1e2, 1e6, 7),
    "ground.normal": [1e4, 2e4, 8e4],
}


@pytest.mark.parametrize(("degree", "cell"), [(2, "hexahedron"), (1, "tetrahedron")])
def test_a_sweep_over_four_decades(degree: int, cell: str, tmp_path: Path) -> None:
    """Every point is answered, with an error that is said and not larger; an interrupted sweep goes on."""
    problem = blocks(ELASTIC, degree, cell, 2)
    exact = sweep(problem, GRID, options=Options(rtol=1e-10), keep_states=True)
    rtol = 1e-5
    options = MULTIGRID.with_(rtol=rtol)
    found = sweep(problem, GRID, options=options, keep_states=True)
    assert found.complete and np.all(found.converged) and np.nanmax(found.error) <= rtol
    errors = of_points(problem, exact, found)
    assert np.all(errors <= found.error.ravel()) and errors.max() > 0.0
    assert np.nanmax(np.abs(found.force("joint") - exact.force("joint"))) <= 1e-3 * np.abs(
        exact.force("joint")
    ).max()

    calls: list[int] = []
    sweep(problem, GRID, options=options, callback=lambda iteration: calls.append(1))
    total = len(calls)
    calls.clear()

    def stop(iteration: Any) -> None:
        calls.append(1)
        if len(calls) > total - 8:
            raise StopIteration

    file = tmp_path / "sweep.h5"
    part = sweep(problem, GRID, options=options, checkpoint=file, callback=stop)
    assert not part.complete and part.finished.any()
    whole = sweep(problem, GRID, options=options, checkpoint=file)
    assert whole.complete and np.nanmax(whole.error) <= rtol
    size = np.abs(found.force("joint")).max()
    assert np.abs(whole.force("joint") - found.force("joint")).max() <= 1e-3 * size


def random_blocks() -> Problem:
    normal, tangential = LogNormal("n", 5e3, cov=0.5), LogNormal("t", 2e3, cov=0.3)
    return blocks(Elastic(normal=normal, tangential=tangential, jump=(0.01, 0.0, 0.0)), cells=2)


def test_samples() -> None:
    """Alone, and on the basis of a chaos."""
    problem = random_blocks()
    exact = monte_carlo(problem, 300, seed=3, options=Options(rtol=1e-10), keep_states=True)
    options = MULTIGRID.with_(rtol=1e-3)
    found = monte_carlo(problem, 300, seed=3, options=options, keep_states=True)
    assert np.all(found.converged) and np.nanmax(found.error) <= 1e-3
    assert np.all(of_points(problem, exact, found) <= found.error)
    assert found.scatter_error <= 1e-3
    deviation = exact.deviation("b1")
    size = np.abs(deviation).max()
    assert np.abs(found.deviation("b1") - deviation).max() <= 1e-3 * size
    chaos = solve(problem, chaos=Chaos(2, check_points=0), options=options)
    again = chaos.sample(exact.germs)
    assert np.all(again.converged)
    size = np.abs(exact.force("joint")).max()
    assert np.abs(again.force("joint") - exact.force("joint")).max() <= 1e-3 * size


def test_a_function() -> None:
    problem = random_blocks()
    exact = problem.function("joint", ["n", "t"], options=Options(rtol=1e-10))
    found = problem.function("joint", ["n", "t"], options=MULTIGRID)
    x = exact.nominal * np.array([[0.2, 1.0], [1.0, 1.0], [5.0, 0.3]])
    assert np.abs(found(x) - exact(x)).max() <= 1e-4 * np.abs(exact(x)).max()
    slopes = exact.gradient(x[0])
    assert np.abs(found.gradient(x[0]) - slopes).max(axis=-1) <= 1e-4 * np.abs(slopes).max()


def test_a_history_with_a_sweep() -> None:
    """Steps of a load that changes in time, at every point."""
    scene = Scene()
    for k in range(2):
        box = geometry.box((10.0, 10.0, 10.0), (2, 2, 2), origin=(10.0 * k, 0.0, 0.0), cell="hexahedron")
        scene.substructure(f"b{k}", box, LinearElastic(E=200e3, nu=0.3), degree=2)
    scene.fix("b0:x0")
    scene.interface("joint", "b0:x1", "b1:x0", Elastic(normal=5e3, tangential=2e3))
    times = np.array([1.0, 2.0, 3.0])
    scene.pressure("b1:x1", Amplitude(times, [1.0, -2.0, 0.5]) * 10.0)
    scene.traction("b1:z1", (0.0, 0.0, 1.0))
    problem = assemble(scene)
    grid = {"joint.normal": [1e3, 1e4, 1e5]}
    exact = sweep(problem, grid, options=Options(rtol=1e-10), times=times)
    found = sweep(problem, grid, options=MULTIGRID, times=times)
    assert np.all(found.converged)
    size = np.abs(exact.jump("joint")).max()
    assert np.abs(found.jump("joint") - exact.jump("joint")).max() <= 1e-4 * size


@pytest.mark.parametrize("active", [[], ["joint"]])
def test_errors_of_quantities(active: list[str]) -> None:
    """The dual problem has a basis of its own."""
    problem = blocks(ELASTIC, cells=2)
    exact, found = (
        solve(problem, active=active or None, options=options)
        for options in (Options(rtol=1e-9), MULTIGRID)
    )
    for name, of in (("joint", "force"), ("ground", "force"), ("joint", "jump")):
        wanted = Resultant(name, of)
        whole, by_cycles = (discretisation_error(each, wanted) for each in (exact, found))
        assert by_cycles.bound == pytest.approx(whole.bound, rel=1e-4), (name, of)
        assert by_cycles.correction == pytest.approx(whole.correction, rel=1e-4), (name, of)
    assert found.errors("ground").reached


def test_what_a_basis_does_not_have() -> None:
    problem = blocks(ELASTIC, cells=2)
    with pytest.raises(SceneError, match="'joint': its law is nonlinear, and backend 'multigrid'"):
        solve(blocks(Contact()), options=MULTIGRID)
    found = solve(problem, options=MULTIGRID)
    with pytest.raises(SceneError, match="has a basis for one answer"):
        found.solver.response_to({})


@pytest.mark.parametrize(("size", "cells"), [((75.0, 75.0, 1.0), (6, 6, 1)), ((70.0, 1.0, 1.0), (10, 1, 1))])
def test_thin_cells(size: tuple[float, float, float], cells: tuple[int, int, int]) -> None:
    """Which linear shape functions cannot bend: all their unknowns are on the lower level."""
    scene = Scene()
    steel = LinearElastic(E=200e3, nu=0.3)
    scene.substructure("plate", geometry.box(size, cells, cell="hexahedron"), steel, degree=2)
    block = geometry.box((10.0, size[1], 10.0), (3, 3, 3), origin=(-10.0, 0.0, 0.0), cell="hexahedron")
    scene.substructure("block", block, steel, degree=2)
    scene.fix("block:x0")
    scene.traction("plate:x1", (0.0, 0.0, 1.0))
    scene.interface("joint", "block:x1", "plate:x0", Elastic(normal=1e5, tangential=1e5), overlap="partial")
    problem = assemble(scene)
    exact, found = solve(problem), solve(problem, options=MULTIGRID)
    assert found.converged
    assert apart(problem, found.displacements, exact.displacements) <= MULTIGRID.rtol


def test_indices_of_64_bits() -> None:
    problem = blocks(ELASTIC, cells=2)
    exact = solve(problem, active=["joint"], options=Options(rtol=1e-9))
    found = solve(problem, active=["joint"], options=Options(rtol=1e-9, backend="cholmod64"))
    assert [cost["backend"] for cost in found.solver.costs] == ["cholmod64"] * 2
    assert apart(problem, found.displacements, exact.displacements) <= 1e-9


@pytest.mark.parametrize(("rate", "arrives"), [(0.5, True), (0.93, True), (0.97, False), (1.0, False)])
def test_rounds_stop_by_their_rate(rate: float, arrives: bool) -> None:
    """From 1 to 2e-5 in 200 rounds takes a rate below 0.95; one that is slower is known by the twentieth."""
    rounds, left, count = fitting._Rounds(2e-5), 1.0, 0
    try:
        while left > 2e-5:
            left = rounds.left(rate**count)
            rounds.go_on()
            count += 1
    except NumericalError:
        assert not arrives
        assert count == fitting.FIRST
    else:
        assert arrives
        assert count <= fitting.ROUNDS


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
