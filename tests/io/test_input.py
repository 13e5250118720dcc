"""Chaos files, OpenTURNS, the reference solvers and figures refuse what they cannot use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import figures, io, reference
from tests.helpers import refused

JUNK = ("a", None, 3, 1.5, True, 1j, ["a"], b"x")
NO_TOLERANCES = ("a", None, 0.0, 1.0, -1.0, True, 1j, np.nan, [1.0])


def scene(stiffness: Any) -> lf.Problem:
    """Two squares with an elastic layer between them."""
    made = lf.Scene()
    for i in (0, 1):
        part = lf.geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        made.substructure(f"p{i}", part, lf.LinearElastic(1.0, 0.3), degree=1)
    made.fix("p0:y0", name="foot")
    made.pressure("p1:y1", 1.0, "top")
    made.interface("layer", "p0:y1", "p1:y0", lf.Elastic(stiffness, 5.0))
    return lf.assemble(made)


@pytest.fixture(scope="module")
def fixed() -> lf.Problem:
    """Nothing is random."""
    return scene(5.0)


@pytest.fixture(scope="module")
def random() -> lf.Problem:
    """The stiffness is random."""
    return scene(lf.LogNormal("k", 5.0, cov=0.1))


@pytest.fixture(scope="module")
def chaos(random: lf.Problem) -> lf.ChaosResult:
    """Its chaos."""
    return lf.solve(random, chaos=2, progress=False)


def test_chaos_files(chaos: lf.ChaosResult, tmp_path: Path) -> None:
    path = tmp_path / "chaos.json"
    chaos.save_chaos(path)
    file = io.load_chaos(path)
    field = "force:layer"
    for wrong in ("abc", None, [["a"]], [[np.nan]], [[None]], 1j, [[True]], [[0.0, 1.0]]):
        refused(lambda wrong=wrong: file.evaluate(field, wrong), "points")
        refused(lambda wrong=wrong: file.modes(wrong), "points")
        refused(lambda wrong=wrong: file.parameter("k", wrong), "points")
    for wrong in (3, None, ["a"], "none", 1.5, {}):
        for read in (file.mean, file.std, file.sobol):
            refused(lambda read=read, wrong=wrong: read(wrong), repr(wrong), "'force:layer'")
        refused(lambda wrong=wrong: file.parameter(wrong, [[0.0]]), repr(wrong), "'k'")
        refused(lambda wrong=wrong: file.evaluate(wrong, [[0.0]]), repr(wrong))
    for wrong in (3, None, ["k"], "k"):
        refused(lambda wrong=wrong: file.germ_points(wrong), "values = ")
    for wrong in ("a", None, [None], True, 1j, np.nan):
        refused(lambda wrong=wrong: file.germ_points({"k": wrong}), "'k'", "value = ")
    space, basis = chaos.space, chaos.basis
    for wrong in JUNK:
        refused(lambda wrong=wrong: io.save_chaos(path, wrong, basis, {}), "space = ")
        refused(lambda wrong=wrong: io.save_chaos(path, space, wrong, {}), "basis = ")
        refused(lambda wrong=wrong: io.save_chaos(path, space, basis, wrong), "fields = ")
        refused(lambda wrong=wrong: io.save_chaos(path, space, basis, {"f": wrong}), "fields['f'] = ")
        if wrong not in (3, 1.5):
            refused(lambda wrong=wrong: io.Field(wrong), "coefficients = ")
    for wrong in (3, None, True, "", ["a"], 1.5):
        refused(lambda wrong=wrong: io.load_chaos(wrong), f"path = {wrong!r}")
        refused(lambda wrong=wrong: io.save_chaos(wrong, space, basis, {}), f"path = {wrong!r}")


def test_openturns(chaos: lf.ChaosResult) -> None:
    space, basis, block = chaos.space, chaos.basis, np.ones((1, 3))
    for wrong in JUNK:
        refused(lambda wrong=wrong: io.to_openturns(wrong, basis, block), "space = ")
        refused(lambda wrong=wrong: io.to_openturns(space, wrong, block), "basis = ")
        refused(lambda wrong=wrong: io.to_openturns(space, basis, wrong), "coefficients")
        refused(lambda wrong=wrong: io.to_openturns(space, basis, block, inputs=wrong), "inputs", repr(wrong))
        if wrong != ["a"]:
            refused(lambda wrong=wrong: io.to_openturns(space, basis, block, wrong), "names = ")
    refused(lambda: io.to_openturns(space, basis, block, ["a", "b"]), "2 names for 1 rows")


def test_reference_solvers(fixed: lf.Problem, random: lf.Problem) -> None:
    request = lf.Chaos(1)
    for wrong in JUNK:
        for solve in (reference.monolithic, reference.Monolithic):
            refused(lambda solve=solve, wrong=wrong: solve(wrong), "problem = ", "assemble")
        refused(lambda wrong=wrong: reference.ssfem(wrong, request), "problem = ", "assemble")
        refused(lambda wrong=wrong: reference.smallest_eigenvalue(wrong, request), "problem = ")
        refused(lambda wrong=wrong: reference.ssfem(random, wrong), "chaos = ")
        refused(lambda wrong=wrong: reference.ssfem(random, request, wrong), "solver", repr(wrong))
        refused(lambda wrong=wrong: reference.Cholesky(wrong), "matrix = ")
        refused(lambda wrong=wrong: reference.energy_difference(fixed, wrong, wrong), "one = ")
        refused(lambda wrong=wrong: reference.energy_error(fixed, wrong, wrong), "u = ")
        if wrong is not None:
            refused(lambda wrong=wrong: reference.monolithic(fixed, solver=wrong), "solver", repr(wrong))
            refused(lambda wrong=wrong: reference.monolithic(fixed, values=wrong), "values = ")
            refused(lambda wrong=wrong: reference.monolithic(fixed, laws=wrong), "laws = ")
    for wrong in NO_TOLERANCES:
        refused(lambda wrong=wrong: reference.ssfem(random, request, rtol=wrong), "rtol = ")
        refused(lambda wrong=wrong: reference.smallest_eigenvalue(random, request, wrong), "rtol = ")
    for wrong in ("a", None, 0, 1.5, True):
        refused(
            lambda wrong=wrong: reference.ssfem(random, request, max_iterations=wrong), "max_iterations = "
        )


def test_figures(fixed: lf.Problem, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path, once = tmp_path / "figure.png", lf.solve(fixed, progress=False)
    for wrong in JUNK:
        refused(lambda wrong=wrong: figures.interface_figure(wrong, "layer", path), "result = ")
        refused(lambda wrong=wrong: figures.interface_figure(once, wrong, path), repr(wrong))
        refused(
            lambda wrong=wrong: figures.interface_figure(once, "layer", path, quantity=wrong), repr(wrong)
        )
        refused(lambda wrong=wrong: figures.deformed_figure(wrong, path), "displacements = ")
        refused(lambda wrong=wrong: figures.assembly_figure(wrong, path), "assembly = ")
        refused(lambda wrong=wrong: figures.density_figure(wrong, path, "x"), "densities = ")
        refused(lambda wrong=wrong: figures.density_figure({"a": wrong}, path, "x"), "densities['a'] = ")
        refused(lambda wrong=wrong: figures.convergence_figure(wrong, path), "histories = ")
        refused(lambda wrong=wrong: figures.interface_map(wrong, [1.0], path, "x"), "points = ")
        refused(lambda wrong=wrong: figures.interface_map(np.eye(3), wrong, path, "x"), "values")
        refused(
            lambda wrong=wrong: figures.response_surface([0, 1], [0, 1], wrong, ("x", "y", "z"), path), "z"
        )
    for wrong in (3, None, True, ["a"], 1.5):
        refused(lambda wrong=wrong: figures.interface_figure(once, "layer", wrong), f"path = {wrong!r}")
    for wrong in ("a", 0.5, True, 1):
        refused(lambda wrong=wrong: figures.interface_figure(once, "layer", path, step=wrong), "step")
    assert not path.exists()


def test_paraview(fixed: lf.Problem, tmp_path: Path) -> None:
    path, once = tmp_path / "parts.vtm", lf.solve(fixed, progress=False)
    for wrong in JUNK:
        if wrong is None:
            continue
        refused(lambda wrong=wrong: io.write_fields(once, path, wrong), "materials = ")
        refused(lambda wrong=wrong: io.write_fields(once, path, modes=wrong), "modes = ")
        refused(lambda wrong=wrong: io.write_interfaces(once, path, interfaces=wrong), "interface")
