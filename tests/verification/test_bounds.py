"""Bounds of the error in energy against closed forms: bars under their own weight, of linear stress (nu = 0).

The exact energy is known, that of the error is the difference (Galerkin's orthogonality), and quadratic
displacements are exact. So a bound is at least the true error, and nothing where there is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common.arrays import Array

E, WEIGHT, LENGTH, WIDTH = 200.0, 3e-3, 2.0, 1.0
SPRINGS = 40.0
ROUNDING = 1e-6
"""Of a bound that is nothing, relative to the answer: roots of rounding."""


CELLS = {2: ["triangle", "quadrilateral"], 3: ["tetrahedron", "hexahedron"]}
BOTH = [(dim, cell) for dim, cells in CELLS.items() for cell in cells]


def box(
    dim: int, origin: float, divisions: int, length: float = LENGTH, cell: str = "", shear: float = 0.0
) -> Any:
    """A bar along y from `origin`, whose cross section may be a parallelogram."""
    sizes = [WIDTH, length] + [WIDTH] * (dim - 2)
    start = [0.0, origin] + [0.0] * (dim - 2)
    cells = [divisions, 2 * divisions] + [divisions] * (dim - 2)
    made = lf.geometry.box(sizes, cells, origin=start, cell=cell or CELLS[dim][0])
    made.mesh.geometry.x[:, 0] += shear * made.mesh.geometry.x[:, 2]
    return made


def down(dim: int, value: float) -> list[float]:
    """A vector along -y."""
    return [0.0, -value] + [0.0] * (dim - 2)


def bar(
    dim: int,
    degree: int,
    joint: Any = None,
    divisions: int = 2,
    cell: str = "",
    above: str = "",
    shear: float = 0.0,
) -> lf.Problem:
    """One bar, or two on each other, under their weight; what stands above slides on planes of symmetry."""
    scene = lf.Scene()
    steel = lf.LinearElastic(E=E, nu=0.0)
    names = ["a"] if joint is None else ["a", "b"]
    for k, name in enumerate(names):
        mesh = box(dim, k * LENGTH, divisions, cell=(above or cell) if k else cell, shear=shear)
        scene.substructure(name, mesh, steel, degree=degree, body_force=down(dim, WEIGHT))
        for face in ("x0", "z0")[: dim - 1]:
            scene.interface(f"{name} {face}", f"{name}:{face}", lf.Symmetry())
    if joint is not None:
        scene.interface("joint", "a:y1", "b:y0", joint)
    scene.fix("a:y0")
    return lf.assemble(scene)


def energy(parts: int) -> float:
    """Twice the strain energy of the bars: int (w (h - y))^2 / E over their height h."""
    height = parts * LENGTH
    return WEIGHT**2 * height**3 / (3.0 * E) * WIDTH


def strain(answer: Any) -> float:
    """Twice the strain energy of an answer."""
    fields = {name: answer.unknowns(name) for name in answer.problem.substructures}
    return sum(float(u @ (answer.problem.substructures[n].matrix @ u)) for n, u in fields.items())


LAWS = {
    "one": None,
    "glued": lf.Perfect(),
    "springs": lf.Elastic(normal=SPRINGS, tangential=SPRINGS),
    "contact": lf.Contact(),
    "soft contact": lf.Contact(stiffness=SPRINGS),
    "threshold": lf.Contact(threshold=1.0),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("dim", "cell"), BOTH)
def test_linear_stress_is_bounded_on_linear_cells(dim: int, cell: str, law: str) -> None:
    answer = lf.solve(bar(dim, 1, LAWS[law], cell=cell), options=lf.Options(rtol=1e-10))
    bound = answer.errors(kind="bound")
    parts = len(answer.problem.substructures)
    # a contact or a spring carries the upper weight whatever the mesh: its energy is exact
    true = float(np.sqrt(energy(parts) - strain(answer)))
    assert bound.strict, bound.notes
    # with friction the shear of the cells' diagonals reaches the joint
    assert 1.0 <= bound.total / true < (3.0 if law == "threshold" else 1.6)
    assert bound.whole == pytest.approx(float(np.sqrt(strain(answer))))
    assert set(bound.parts) == set(answer.problem.substructures)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("dim", "cell"), BOTH)
def test_nothing_is_left_of_an_exact_answer(dim: int, cell: str, law: str) -> None:
    answer = lf.solve(bar(dim, 2, LAWS[law], 1, cell), options=lf.Options(rtol=1e-12))
    bound = answer.errors(kind="bound")
    assert bound.strict, bound.notes
    assert strain(answer) == pytest.approx(energy(len(answer.problem.substructures)), rel=1e-10)
    assert bound.relative < ROUNDING


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("shear", [0.7, -3.0])
def test_hexahedra_that_are_sheared(shear: float, law: str) -> None:
    answer = lf.solve(bar(3, 2, LAWS[law], 1, "hexahedron", shear=shear), options=lf.Options(rtol=1e-12))
    bound = answer.errors(kind="bound")
    assert bound.strict and bound.relative < ROUNDING, bound.notes
    rough = lf.solve(bar(3, 1, LAWS[law], 2, "hexahedron", shear=shear), options=lf.Options(rtol=1e-10))
    true = float(np.sqrt(energy(len(rough.problem.substructures)) - strain(rough)))
    bound = rough.errors(kind="bound")
    assert bound.strict and 1.0 <= bound.total / true < 2.0, bound.notes


@pytest.mark.parametrize("law", [each for each in LAWS if each != "one"])
def test_quadrilaterals_on_triangles(law: str) -> None:
    """Both have the same tractions on edges: such a joint is proven as every other one."""
    problem = bar(2, 2, LAWS[law], 1, "triangle", "quadrilateral")
    exact = lf.solve(problem, options=lf.Options(rtol=1e-12)).errors(kind="bound")
    assert exact.strict and exact.relative < ROUNDING, exact.notes


@pytest.mark.parametrize(("dim", "cell"), BOTH)
def test_bending_is_bounded(dim: int, cell: str) -> None:
    """Stress linear across the bar: quadratic displacements are exact."""

    def bent(degree: int, divisions: int) -> Any:
        scene = lf.Scene()
        mesh = box(dim, 0.0, divisions, cell=cell)
        scene.substructure("a", mesh, lf.LinearElastic(E=E, nu=0.0), degree=degree)
        scene.fix("a:y0")
        scene.force("a:y1", moment=1e-3 if dim == 2 else (0.0, 0.0, 1e-3))
        return lf.solve(lf.assemble(scene), options=lf.Options(rtol=1e-10))

    exact = bent(2, 1).errors(kind="bound")
    assert exact.strict and exact.relative < ROUNDING, exact.notes
    answer = bent(1, 2)
    bound = answer.errors(kind="bound")
    true = float(np.sqrt(1e-6 * LENGTH * 12.0 / (E * WIDTH**3) - strain(answer)))
    assert bound.strict and 1.0 <= bound.total / true < 1.6, bound.notes


def test_trapezoids_are_estimated() -> None:
    """Their functions are no polynomials; a constant stress is exact in any case."""

    def pulled(shear: float) -> Any:
        scene = lf.Scene()
        mesh = box(2, 0.0, 2, cell="quadrilateral")
        mesh.mesh.geometry.x[:, 0] *= 1.0 + 0.2 * mesh.mesh.geometry.x[:, 1]
        scene.substructure("a", mesh, lf.LinearElastic(E=E, nu=0.0), degree=1)
        scene.fix("a:y0")
        scene.traction("a:y1", (shear, 0.1))
        # of a constant stress, on a face that leans by 0.2
        scene.traction("a:x1", (0.0, -0.02 / np.sqrt(1.04)))
        return lf.solve(lf.assemble(scene)).errors(kind="bound")

    plain, bent = pulled(0.0), pulled(0.01)
    assert not plain.strict and "no parallelograms" in plain.notes[0]
    assert plain.relative < ROUNDING
    assert 0.01 < bent.relative < 1.0


def test_an_answer_that_has_not_converged_is_not_proven() -> None:
    problem = bar(2, 2, lf.Contact(stiffness=SPRINGS), 1)
    rough = lf.solve(problem, method="latin", options=lf.Options(max_iterations=3, rtol=1e-12, newton=0))
    assert not rough.converged
    bound = rough.errors(kind="bound")
    assert not bound.strict and "not converged" in bound.notes[-1]


def test_loads_on_faces_and_temperature() -> None:
    """Clamped and heated between walls: the stress is constant, and so are tractions of all kinds."""
    scene = lf.Scene()
    scene.substructure("a", box(2, 0.0, 2), lf.LinearElastic(E=E, nu=0.0, alpha=1e-4), degree=1)
    scene.fix("a:y0")
    scene.interface("side", "a:x0", lf.Symmetry())
    scene.traction("a:y1", (0.0, -0.1))
    scene.pressure("a:y1", 0.2)
    scene.force("a:y1", (0.0, -0.3))
    scene.temperature("a", 10.0)
    answer = lf.solve(lf.assemble(scene))
    bound = answer.errors(kind="bound")
    # it is free to expand but where it is glued
    assert bound.strict and 0.0 < bound.relative < 0.3
    scene.pressure("a:x1", lambda x: 0.1 * np.exp(4.0 * x[:, 1]))
    bent = lf.solve(lf.assemble(scene)).errors(kind="bound")
    assert not bent.strict and any("polynomial" in note for note in bent.notes)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pull", [0.0, 12.0])
@pytest.mark.parametrize(("dim", "cell"), [(2, "quadrilateral"), (3, "tetrahedron"), (3, "hexahedron")])
def test_what_grows_freely_has_no_error(dim: int, cell: str, pull: float, degree: int) -> None:
    """Uniform heat beside symmetries, and a pull: every mesh has the answer (kN, cm)."""
    scene = lf.Scene()
    size, cells = (60.0, 5.0, 4.0)[:dim], (3, 2, 2)[:dim]
    steel = lf.LinearElastic(E=21e3, nu=0.3, alpha=12e-6)
    scene.substructure("bar", lf.geometry.box(size, cells, cell=cell), steel, degree=degree)
    scene.symmetry([f"bar:{axis}0" for axis in "xyz"[:dim]])
    scene.temperature("bar", 30.0)
    if pull:
        scene.traction("bar:x1", (pull, 0.0, 0.0)[:dim])
    bound = lf.solve(lf.assemble(scene)).errors(kind="bound")
    assert bound.strict, bound.notes
    assert bound.relative < ROUNDING


def test_finer_meshes_have_smaller_bounds() -> None:
    found = [lf.solve(bar(2, 1, lf.Contact(), k)).errors(kind="bound").relative for k in (2, 4, 8)]
    # of order 1: the weight is balanced in the mean of a cell only
    assert found[0] / found[1] == pytest.approx(2.0, rel=0.05)
    assert found[1] / found[2] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("cell", CELLS[2])
def test_every_unit_says_the_same(cell: str) -> None:
    def scaled(length: float, stress: float) -> float:
        scene = lf.Scene()
        mesh = lf.geometry.box((length, 2.0 * length), (2, 4), cell=cell)
        scene.substructure("a", mesh, lf.LinearElastic(E=E * stress, nu=0.3), degree=1)
        scene.fix("a:y0")
        scene.traction("a:y1", (1e-3 * stress, 0.0))
        return lf.solve(lf.assemble(scene)).errors(kind="bound").relative

    assert scaled(1e3, 1e6) == pytest.approx(scaled(1.0, 1.0), rel=1e-9)
    assert scaled(1e-6, 1e-3) == pytest.approx(scaled(1.0, 1.0), rel=1e-9)


def test_what_has_no_bound_says_so() -> None:
    scene = lf.Scene()
    for name, origin, n in (("a", 0.0, 2), ("b", LENGTH, 3)):
        scene.substructure(name, box(2, origin, n), lf.LinearElastic(E=E, nu=0.3), degree=1)
    scene.interface("joint", "a:y1", "b:y0", lf.Elastic(normal=SPRINGS, tangential=SPRINGS))
    scene.fix("a:y0")
    scene.traction("b:y1", (1e-3, 0.0))
    bound = lf.solve(lf.assemble(scene)).errors(kind="bound")
    assert not bound.strict and "'joint' joins meshes that do not match" in bound.notes
    assert "about" in repr(bound) and "no bound" in str(bound)

    rubbing = lf.solve(bar(2, 1, lf.Contact(friction=0.3))).errors(kind="bound")
    assert not rubbing.strict and "'joint'" in rubbing.notes[0]


def twisted() -> Any:
    scene = lf.Scene()
    mesh = box(3, 0.0, 1, cell="hexahedron")
    mesh.mesh.geometry.x[:, 0] *= 1.0 + 0.2 * mesh.mesh.geometry.x[:, 1]
    scene.substructure("a", mesh, lf.LinearElastic(E=E, nu=0.3), degree=1)
    scene.fix("a:y0")
    scene.traction("a:y1", (0.0, 1e-3, 0.0))
    return lf.solve(lf.assemble(scene))


def bound_of(load: Any) -> Any:
    scene = lf.Scene()
    scene.substructure("a", box(2, 0.0, 1), lf.LinearElastic(E=E, nu=0.3), degree=1)
    scene.fix("a:y0")
    load(scene)
    return lf.solve(lf.assemble(scene))


def random_springs() -> Any:
    problem = bar(2, 1, lf.Elastic(normal=lf.Uniform("k", 30.0, 50.0), tangential=SPRINGS))
    return lf.solve(problem, chaos=lf.Chaos(order=1))


def cubic() -> Any:
    return lf.solve(bar(2, 3))


REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "degree": (cubic, {}, "triangle cells of degree 3"),
    "hexahedra": (twisted, {}, "no parallelepipeds"),
    "chaos": (random_springs, {}, "the answer is a"),
    "point": (
        lambda: bound_of(lambda scene: scene.point_force("a", (0.0, LENGTH), (1e-3, 0.0))),
        {},
        "a point_force is no traction",
    ),
    "rigid": (
        lambda: bound_of(lambda scene: (scene.rigid("a:y1"), scene.force("a:y1", (1e-3, 0.0)))),
        {},
        "ties its nodes to rigid motions",
    ),
    "quantity": (lambda: lf.solve(bar(2, 1, lf.Perfect())), {"quantity": "joint"}, "leave the quantity out"),
    "kind": (lambda: lf.solve(bar(2, 1)), {"kind": "proof"}, "kind"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_bounded_is_refused(case: str) -> None:
    make, given, why = REFUSED[case]
    with pytest.raises(lf.SceneError, match=why):
        make().errors(**{"kind": "bound", **given})


def spike(x: Array) -> Array:
    """Nothing at any point of a coarse mesh."""
    return np.asarray(10.0 * (np.abs(x[:, 0] - 0.2) < 1e-3))


@pytest.mark.parametrize(
    "load",
    [
        lambda scene: scene.pressure("a:y1", spike),
        lambda scene: scene.temperature("a", spike, alpha=1e-3),
        lambda scene: scene.traction("a:y1", lambda x: np.column_stack([spike(x), spike(x)])),
    ],
)
def test_functions_of_the_place_are_sampled_and_not_proven(load: Any) -> None:
    """Between the points a function may be anything."""
    bound = bound_of(load).errors(kind="bound")
    assert not bound.strict and "function of the place" in bound.notes[0]


def test_what_was_tightened_on_this_mesh_is_not_proven() -> None:
    """The length at which a bolt was locked has the error of the step before, which is in no distance now."""
    scene = lf.Scene()
    for name, origin in (("a", 0.0), ("b", LENGTH)):
        scene.substructure(name, box(3, origin, 1), lf.LinearElastic(E=E, nu=0.3), degree=1)
        scene.fix(f"{name}:x0")
    axial = lf.BoltStiffness(axial=10.0, bending=1.0, torsion=1.0)
    later = lf.Amplitude([1.0, 2.0], [0.0, 1.0])
    scene.beam("bolt", "a:y0", "b:y1", axial, lf.Preload(1e-3, until=1.0))
    scene.traction("b:y1", later * (0.0, 1e-3, 0.0))
    answer = lf.solve(lf.assemble(scene), times=[1.0, 2.0])
    bound = answer.errors(kind="bound")
    assert not bound.strict and "remembers" in bound.notes[0]


def test_displacements_that_are_no_polynomials_are_not_proven() -> None:
    scene = lf.Scene()
    scene.substructure("a", box(2, 0.0, 2), lf.LinearElastic(E=E, nu=0.3), degree=2)
    scene.fix("a:y0")
    bent = lf.Displacement(value=lambda x: np.column_stack([0.0 * x[:, 0], 1e-3 * np.sin(9.0 * x[:, 0])]))
    scene.interface("bent", "a:y1", bent)
    bound = lf.solve(lf.assemble(scene)).errors(kind="bound")
    assert not bound.strict and any("between nodes" in note for note in bound.notes)


@pytest.mark.parametrize("space", ["points", "mortar"])
def test_glue_that_is_iterated_on(space: Any) -> None:
    """It is proven as that which is assembled: what is glued has no jump between nodes either."""
    scene = lf.Scene()
    for name, origin in (("a", 0.0), ("b", LENGTH)):
        scene.substructure(name, box(2, origin, 2), lf.LinearElastic(E=E, nu=0.3), degree=2)
    scene.interface("joint", "a:y1", "b:y0", lf.Perfect(), space=space)
    scene.fix("a:y0")
    scene.traction("b:y1", (1e-3, 0.0))
    problem = lf.assemble(scene)
    assembled = lf.solve(problem).errors(kind="bound")
    kept = lf.solve(problem, active=["joint"], options=lf.Options(rtol=1e-10)).errors(kind="bound")
    assert assembled.strict and kept.strict, kept.notes
    # tractions of the joint are given here and found there
    assert kept.total == pytest.approx(assembled.total, rel=0.1)


def test_history_of_linear_laws_is_bounded_at_its_end() -> None:
    scene = lf.Scene()
    scene.substructure("a", box(2, 0.0, 2), lf.LinearElastic(E=E, nu=0.3), degree=1)
    scene.fix("a:y0")
    ramp = lf.Amplitude([0.0, 1.0], [0.0, 1.0])
    scene.traction("a:y1", ramp * (1e-3, 0.0))
    problem = lf.assemble(scene)
    history = lf.solve(problem, times=[0.5, 1.0]).errors(kind="bound")
    assert history.strict
    static: Array = np.array([lf.solve(problem.at(1.0)).errors(kind="bound").total])
    assert history.total == pytest.approx(static[0], rel=1e-9)
