"""What a user changes after the assembly: matrices, meshes, constants of materials."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem

from dolfinx_frontend import (
    AtPoint,
    LinearElastic,
    Scene,
    SceneError,
    assemble,
    discretisation_error,
    figures,
    geometry,
    io,
    solve,
)


def pulled(material: Callable[[Any], Any]) -> tuple[Any, Any]:
    """A strip that is pulled; its mesh and its answer."""
    box = geometry.box((2.0, 1.0), (4, 2))
    scene = Scene()
    scene.substructure("strip", box, material(box.mesh), degree=1)
    scene.fix("strip:x0")
    scene.traction("strip:x1", (1.0, 0.2))
    return box.mesh, solve(assemble(scene))


def readers(result: Any, folder: Path) -> list[Callable[[], Any]]:
    """All that reads meshes or materials again."""
    return [
        lambda: result.stress("strip"),
        lambda: result.std("strip", of="stress"),
        lambda: discretisation_error(result),
        lambda: result.errors(),
        lambda: io.write(result, folder / "out"),
        lambda: result.save(folder / "out.h5"),
    ]


def test_a_constant_of_a_material_that_was_changed_is_refused_where_it_is_read(tmp_path: Path) -> None:
    held: list[Any] = []

    def material(mesh: Any) -> LinearElastic:
        held.append(fem.Constant(mesh, 1e3))
        return LinearElastic(held[0], 0.3)

    _, result = pulled(material)
    before = result.stress("strip").x.array.copy()
    held[0].value = 1.0
    for read in readers(result, tmp_path):
        with pytest.raises(SceneError, match="'strip': a Constant of its material .* 1000 to 1"):
            read()
    assert solve(result.problem).converged, "needs the matrices only"
    held[0].value = 1e3
    assert np.array_equal(result.stress("strip").x.array, before), "put back"


def test_a_function_of_a_material_that_was_changed_is_refused() -> None:
    held: list[Any] = []

    def material(mesh: Any) -> Callable[[Any, Any], Any]:
        field = fem.Function(fem.functionspace(mesh, ("DG", 0)), name="modulus")
        field.x.array[:] = 10.0
        held.append(field)
        return lambda u, v: field * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v)))

    _, result = pulled(material)
    held[0].x.array[3] = 11.0
    with pytest.raises(SceneError, match="the Function 'modulus' of its material was changed"):
        discretisation_error(result)


def test_a_mesh_that_was_moved_is_refused_where_it_is_read(tmp_path: Path) -> None:
    mesh, result = pulled(lambda _: LinearElastic(1e3, 0.3))
    table = result.table().to_csv()
    mesh.geometry.x[:] *= 2.0
    drawn = [lambda: figures.deformed_figure(result, tmp_path / "out.png")]
    for read in readers(result, tmp_path) + drawn:
        with pytest.raises(SceneError, match="'strip': the nodes of its mesh were moved"):
            read()
    assert result.table().to_csv() == table


def test_a_matrix_that_was_destroyed_is_refused() -> None:
    _, result = pulled(lambda _: LinearElastic(1e3, 0.3))
    result.problem.substructures["strip"].stiffness.destroy()
    with pytest.raises(SceneError, match="'strip': its stiffness was destroyed"):
        solve(result.problem)


def warmed(dT: Callable[[Any], Any], held: list[Any]) -> Any:
    """The answer of a strip with a temperature and a load."""
    box = geometry.box((2.0, 1.0), (4, 2))
    scene = Scene()
    scene.substructure("strip", box, LinearElastic(1e3, 0.3, alpha=1e-3), degree=1)
    scene.fix("strip:x0")
    held.append(dT(box.mesh))
    scene.temperature("strip", held[0], name="heat")
    return solve(assemble(scene))


def test_a_constant_of_a_load_that_was_changed_is_refused_where_it_is_read(tmp_path: Path) -> None:
    held: list[Any] = []
    result = warmed(lambda mesh: fem.Constant(mesh, 10.0), held)
    before = result.stress("strip").x.array.copy()
    held[0].value = 20.0
    for read in (
        lambda: result.stress("strip"),
        lambda: io.write(result, tmp_path / "out"),
        lambda: result.save(tmp_path / "out.h5"),
        lambda: AtPoint(result.problem, "strip", (1.0, 0.5), "stress", "xx"),
    ):
        with pytest.raises(SceneError, match="load 'heat': a Constant of what it is made of .* 10 to 20"):
            read()
    assert solve(result.problem).converged, "needs the nodal forces only"
    held[0].value = 10.0
    assert np.array_equal(result.stress("strip").x.array, before), "put back"


def test_a_function_of_a_load_that_was_changed_is_refused() -> None:
    held: list[Any] = []

    def field(mesh: Any) -> Any:
        out = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)), name="warm")
        out.x.array[:] = 10.0
        return out

    result = warmed(field, held)
    held[0].x.array[0] = 11.0
    told = "load 'heat': the Function 'warm' of what it is made of was changed"
    with pytest.raises(SceneError, match=told):
        result.stress("strip")
