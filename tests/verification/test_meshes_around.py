"""Axisymmetric scenes solved to an accuracy: tubes and spheres, whose forces are known (Lame)."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.mesh_error import discretisation_error
from dolfinx_frontend.geometry import SizeField, from_gmsh, gmsh_session, remeshable
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.scene.laws import Contact, Elastic, Law
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve

E, NU = 1000.0, 0.3
STEEL = LinearElastic(E=E, nu=NU)
A, C, B = 1.0, 1.5, 2.0
KAPPA, SHRINK = 2e3, 1e-3


def tubes(
    law: Law, cell: str, degree: int, pressure: float = 0.0, cells: tuple[int, int] = (2, 2)
) -> Scene:
    """Two tubes, one in the other, held along the axis."""
    scene = Scene(axisymmetric=True)
    for name, inner, outer in (("in", A, C), ("out", C, B)):
        scene.substructure(
            name, geometry.box((outer - inner, 1.0), cells, (inner, 0.0), cell), STEEL, degree=degree
        )
        scene.symmetry([f"{name}:y0", f"{name}:y1"])
    scene.interface("fit", "in:x1", "out:x0", law)
    if pressure:
        scene.pressure("in:x0", pressure)
    return scene


def tube_force(kappa: float, shrink: float, pressure: float = 0.0) -> float:
    """Their normal force, by Lame's solution in plane strain."""
    modulus, nu = E / (1.0 - NU**2), NU / (1.0 - NU)
    soft = C / modulus * ((C**2 + A**2) / (C**2 - A**2) - nu)
    soft += C / modulus * ((B**2 + C**2) / (B**2 - C**2) + nu)
    moved = shrink + pressure * 2.0 * A**2 * C / (modulus * (C**2 - A**2))
    return -moved / (1.0 / kappa + soft) * 2.0 * np.pi * C


@pytest.mark.parametrize(("cell", "degree"), [("quadrilateral", 2), ("triangle", 1)])
def test_tubes_shrunk_together(cell: str, degree: int) -> None:
    scene = tubes(Elastic(normal=KAPPA, tangential=KAPPA, jump=SHRINK), cell, degree)
    exact = tube_force(KAPPA, SHRINK)
    first = solve(assemble(scene), active=["fit"])
    told = discretisation_error(first, Resultant("fit"))
    assert told.quantity is not None and told.value is not None
    true = abs(told.value - exact)
    assert 0.5 * true <= told.quantity <= 3.0 * true
    for accuracy in (1e-2, 1e-4):
        result = solve(scene, accuracy=accuracy, quantity="fit", progress=False)
        made = result.errors()
        off = abs(result.mean_std("fit").mean / exact - 1.0)
        assert made.reached and off <= accuracy and off <= 2.0 * made.in_all


def test_tubes_pressed_together() -> None:
    scene = tubes(Contact(), "quadrilateral", 2, pressure=1.0)
    result = solve(scene, accuracy=1e-3, quantity="fit", progress=False)
    exact = tube_force(np.inf, 0.0, 1.0)
    assert result.errors().reached and abs(result.mean_std("fit").mean / exact - 1.0) <= 1e-3


def shell(inner: float, outer: float, order: int) -> Part:
    """The section of half a hollow sphere (or a ball) that gmsh can mesh again."""

    def make(sizes: SizeField | None) -> Part:
        with gmsh_session() as gmsh:
            o = gmsh.model.occ
            section = [(2, o.addDisk(0, 0, 0, outer, outer))]
            if inner > 0.0:
                section, _ = o.cut(section, [(2, o.addDisk(0, 0, 0, inner, inner))])
            section, _ = o.intersect(section, [(2, o.addRectangle(0, 0, 0, 2 * outer, 2 * outer))])
            o.synchronize()
            gmsh.model.addPhysicalGroup(2, [section[0][1]], name="part")
            for _, tag in gmsh.model.getBoundary(section, oriented=False):
                middle = np.mean(gmsh.model.getParametrizationBounds(1, tag))
                r, z, _ = gmsh.model.getValue(1, tag, [middle])
                name = "in" if np.hypot(r, z) < 0.5 * (inner + outer) else "out"
                name = "plane" if abs(z) < 1e-9 else "axis" if abs(r) < 1e-9 else name
                gmsh.model.addPhysicalGroup(1, [tag], name=f"part:{name}")
            if sizes is None:
                gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
            else:
                sizes.set(gmsh)
            gmsh.model.mesh.generate(2)
            return from_gmsh(gmsh.model, gdim=2, order=order).parts["part"]

    return remeshable(make)


@pytest.mark.parametrize(("inner", "order"), [(A, 1), (0.0, 1), (0.0, 2)])
def test_spheres_shrunk_together(inner: float, order: int) -> None:
    """With a ball inside cells touch the axis; straight cells round off the faces."""
    scene = Scene(axisymmetric=True)
    scene.substructure("in", shell(inner, C, order), STEEL)
    scene.substructure("out", shell(C, B, order), STEEL)
    scene.interface("fit", "in:out", "out:in", Elastic(normal=KAPPA, tangential=KAPPA, jump=SHRINK))
    scene.symmetry(["in:plane", "out:plane"])

    def moved(r: float, a: float, b: float, inside: float, outside: float) -> float:
        """Of a sphere between a and b under two pressures: u = (1 - 2 nu) / E F r + (1 + nu) / E G / r^2."""
        G = (inside - outside) * a**3 * b**3 / (2.0 * (b**3 - a**3))
        F = 2.0 * G / b**3 - outside
        return (1.0 - 2.0 * NU) / E * F * r + (1.0 + NU) / E * G / r**2

    soft = moved(C, C, B, 1.0, 0.0) - moved(C, inner, C, 0.0, 1.0)
    exact = -SHRINK / (1.0 / KAPPA + soft) * 2.0 * np.pi * C**2
    result = solve(scene, accuracy=5e-3, quantity="fit", progress=False)
    made = result.errors()
    assert made.reached and abs(result.mean_std("fit").mean / exact - 1.0) <= made.in_all <= 5e-3


@pytest.mark.parametrize("along", [1, 4, 120])
def test_walls_of_one_linear_cell_across(along: int) -> None:
    """Their slope is the same everywhere: off by 2 %, said 1e-12."""
    scene = tubes(Elastic(normal=KAPPA, jump=SHRINK), "quadrilateral", 1, cells=(1, along))
    result = solve(scene, accuracy=1e-3, quantity=Resultant("fit"), progress=False)
    assert result.errors().reached
    assert Resultant("fit").at_end(result, result) == pytest.approx(tube_force(KAPPA, SHRINK), rel=1e-3)


def test_nothing_is_believed_of_walls_of_one_linear_cell_across() -> None:
    """On a mesh that is given as it is, where they cannot get another degree."""
    problem = assemble(tubes(Elastic(normal=KAPPA, jump=SHRINK), "quadrilateral", 1, cells=(1, 4)))
    result = solve(problem, accuracy=1e-1, quantity="fit", progress=False)
    made = result.errors()
    assert not made.reached
    assert made.discretisation is not None and "one linear cell across" in made.discretisation.how
    with pytest.raises(SceneError, match="'in' is a wall .* degree=2"):
        discretisation_error(solve(problem), Resultant("fit"))
