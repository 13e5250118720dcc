"""Files of displacements and stresses, read back by other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem

from dolfinx_frontend import (
    Elastic,
    LinearElastic,
    OrthotropicElastic,
    Scene,
    SceneError,
    assemble,
    geometry,
    io,
    solve,
)
from dolfinx_frontend.results.stress import stress_function
from dolfinx_frontend.scene.materials import strain

pytestmark = pytest.mark.sanitize

pyvista = pytest.importorskip("pyvista")

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


def polynomial(part: geometry.Part, degree: int) -> fem.Function:
    """A displacement of the element's full degree in every direction."""
    d = part.mesh.geometry.dim
    function = fem.Function(fem.functionspace(part.mesh, ("Lagrange", degree, (d,))))
    function.interpolate(lambda x: formula(x, degree)[:d])
    return function


def formula(x: Any, degree: int) -> Any:
    """Values (3, points) at x (3, points)."""
    return np.stack([x[0] ** degree + 2 * x[1], x[1] ** degree - x[0], x[2] ** degree + x[0]])


def unit_box(cell: str) -> geometry.Part:
    d = CELLS[cell]
    return geometry.box((1.0, 2.0, 1.5)[:d], (2, 3, 2)[:d], cell=cell)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", CELLS)
def test_displacement_is_read_back(cell: str, degree: int, tmp_path: Path) -> None:
    part = unit_box(cell)
    path = io.write_fields({"the part": polynomial(part, degree)}, tmp_path / "file.vtm")
    blocks = pyvista.read(path)
    assert blocks.keys() == ["the part"]
    grid = blocks["the part"]
    assert grid.n_cells == part.num_cells
    assert list(grid.point_data) == ["displacement"]
    d = CELLS[cell]
    expected = formula(grid.points.T, degree).T
    expected[:, d:] = 0.0
    assert grid["displacement"] == pytest.approx(expected, abs=1e-12)
    # the order of the nodes in the cells: VTK interpolates between them as dolfinx does
    inside = np.random.default_rng(1).uniform(0.1, 0.9, (20, 3)) * [1.0, 2.0, 1.5]
    inside[:, d:] = 0.0
    probe = pyvista.PolyData(inside).sample(grid)
    assert probe["vtkValidPointMask"].all()
    assert probe["displacement"] == pytest.approx(
        np.where(np.arange(3) < d, formula(inside.T, degree).T, 0.0), abs=1e-9
    )


def test_stress_of_a_uniform_strain(tmp_path: Path) -> None:
    part = unit_box("tetrahedron")
    u = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 2, (3,))))
    gradient = np.array([[1.0, 0.2, 0.4], [0.2, -0.5, 0.6], [0.4, 0.6, 0.3]]) * 1e-3
    u.interpolate(lambda x: gradient @ x)
    E, nu = 200e3, 0.3
    grid = pyvista.read(
        io.write_fields({"a": u}, tmp_path / "a.vtm", {"a": LinearElastic(E, nu)})
    )["a"]
    mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    s = 2 * mu * gradient + lmbda * np.trace(gradient) * np.eye(3)
    expected = [s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[1, 2], s[0, 2]]
    assert grid["stress"] == pytest.approx(np.tile(expected, (grid.n_points, 1)), rel=1e-9)
    deviator = s - np.trace(s) / 3 * np.eye(3)
    mises = np.sqrt(1.5 * np.sum(deviator**2))
    assert grid["von Mises"] == pytest.approx(np.full(grid.n_points, mises), rel=1e-9)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_stress_in_the_plane(plane: str, tmp_path: Path) -> None:
    part = unit_box("quadrilateral")
    u = fem.Function(fem.functionspace(part.mesh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.stack([1e-3 * x[0], 0.0 * x[0]]))
    E, nu = 100.0, 0.25
    material = LinearElastic(E, nu, plane)
    grid = pyvista.read(io.write_fields({"a": u}, tmp_path / "a.vtm", {"a": material}))["a"]
    lmbda = E * nu / (1 - nu**2) if plane == "stress" else E * nu / ((1 + nu) * (1 - 2 * nu))
    expected = [(lmbda + E / (1 + nu)) * 1e-3, lmbda * 1e-3, 0.0]
    assert grid["stress"] == pytest.approx(np.tile(expected, (grid.n_points, 1)), abs=1e-12)
    assert "von Mises" not in grid.point_data


def test_result_of_a_scene(tmp_path: Path) -> None:
    """Two blocks pulled apart: displacement and stress are the exact ones."""
    E, t = 200e3, 10.0
    scene = Scene()
    for name, x0 in (("left/1", 0.0), ("right", 20.0)):
        block = geometry.box((20.0, 10.0, 10.0), (2, 1, 1), origin=(x0, 0.0, 0.0))
        scene.substructure(name, block, LinearElastic(E=E, nu=0.0), degree=2)
    scene.interface("layer", "left/1:x1", "right:x0", Elastic(normal=50.0, tangential=50.0))
    scene.fix("left/1:x0")
    scene.traction("right:x1", (t, 0.0, 0.0))
    result = solve(assemble(scene))
    path = io.write_fields(result, tmp_path / "deep" / "blocks.vtm", scene)
    assert sorted(p.name for p in path.parent.rglob("*.vtu")) == ["0_left_1.vtu", "1_right.vtu"]
    blocks = pyvista.read(path)
    assert blocks.keys() == ["left/1", "right"]
    for name, shift in (("left/1", 0.0), ("right", t / 50.0)):
        grid = blocks[name]
        exact = t / E * grid.points[:, 0] + shift
        assert grid["displacement"][:, 0] == pytest.approx(exact, rel=1e-8, abs=1e-10)
        assert grid["stress"][:, 0] == pytest.approx(np.full(grid.n_points, t), rel=1e-7)
        assert np.abs(grid["stress"][:, 1:]).max() < 1e-6


def test_orthotropic_stress_is_consistent_with_the_energy() -> None:
    part = unit_box("hexahedron")
    u = polynomial(part, 2)
    material = OrthotropicElastic(E=(10.0, 2.0, 1.0), nu=(0.3, 0.2, 0.1), G=(1.0, 0.7, 0.5))
    stress = stress_function(u, material)
    dx = ufl.dx(domain=part.mesh)
    energy = fem.assemble_scalar(fem.form(ufl.inner(stress, strain(u)) * dx))
    assert energy == pytest.approx(
        fem.assemble_scalar(fem.form(material.bilinear(u, u) * dx)), rel=1e-10
    )


def test_a_form_has_no_stress(tmp_path: Path) -> None:
    u = polynomial(unit_box("triangle"), 1)

    def material(v: Any, w: Any) -> Any:
        return ufl.inner(strain(v), strain(w))

    grid = pyvista.read(io.write_fields({"a": u}, tmp_path / "a.vtm", {"a": material}))["a"]
    assert list(grid.point_data) == ["displacement"]
    with pytest.raises(SceneError, match="gives no stress"):
        stress_function(u, material)  # type: ignore[arg-type]


def test_mistakes(tmp_path: Path) -> None:
    u = polynomial(unit_box("triangle"), 1)
    with pytest.raises(ValueError, match=r"ends in \.vtm"):
        io.write_fields({"a": u}, tmp_path / "a.vtu")
    with pytest.raises(ValueError, match="no displacements"):
        io.write_fields({}, tmp_path / "a.vtm")
