"""A scene solved to an accuracy gets the meshes that it needs: true errors, places, factors that stay."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import numpy as np
import pytest
from dolfinx import mesh as dmesh

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble, assembled_again
from dolfinx_frontend.common import interrupts
from dolfinx_frontend.common.compat import cell_nodes, create_mesh
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.mesh_error import DiscretisationError, discretisation_error
from dolfinx_frontend.geometry import SizeField, from_gmsh, gmsh_session, remeshable
from dolfinx_frontend.geometry.parts import Part, located
from dolfinx_frontend.results.probes import AtPoint
from dolfinx_frontend.results.resultant import Measure, Resultant
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Contact, Elastic, Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.parameters import LogNormal

STEEL = LinearElastic(E=1000.0, nu=0.3)


def l_part(n: int = 4) -> Part:
    """An L of two by two with a re-entrant corner at (1, 1), of triangles."""
    square = geometry.box((2.0, 2.0), (n, n), cell="triangle").mesh
    keep = dmesh.locate_entities(square, 2, lambda x: (x[0] < 1.0 + 1e-9) | (x[1] < 1.0 + 1e-9))
    nodes = np.asarray(cell_nodes(square))[keep].astype(np.int64)
    kept, cells = np.unique(nodes, return_inverse=True)
    mesh = create_mesh(cells.reshape(nodes.shape), np.asarray(square.geometry.x)[kept, :2], "triangle", 1)
    faces = {"top": lambda x: np.isclose(x[1], 2.0), "right": lambda x: np.isclose(x[0], 2.0)}
    return located(mesh, faces)


def corner_scene(held: bool = True) -> Scene:
    """The L, clamped at its right end, carries a block on springs, which may be held at its top."""
    scene = Scene()
    scene.substructure("L", l_part(), STEEL)
    scene.substructure("block", geometry.box((1.0, 1.0), (2, 2), (0.0, 2.0), "triangle"), STEEL)
    scene.interface("joint", "L:top", "block:y0", Elastic(normal=1e3, tangential=1e3))
    if held:
        scene.fix("block:y1")
    scene.fix("L:right")
    scene.traction("block:x1", (1.0, 0.3))
    return scene


CORNER = -0.057446
"""Normal force of its joint: matching uniform meshes of 2 244, 8 580 and 33 540 unknowns give -0.0579520,
-0.0577037 and -0.0575743, whose changes fall by 0.521; carried on -0.05743(1)."""


@pytest.mark.parametrize("accuracy", [5e-2, 1e-2, 3e-3, 1e-3])
def test_a_re_entrant_corner_decides(accuracy: float) -> None:
    result = solve(corner_scene(), accuracy=accuracy, quantity="joint", progress=False)
    made = result.errors()
    assert made.reached and made.in_all <= accuracy
    value = result.mean_std("joint").mean
    assert abs(value / CORNER - 1.0) <= accuracy
    # cells are small at the corner, and the answer says so
    place = made.places[0]
    assert place.part == "L" and 0.5 < place.share <= 1.0
    if accuracy <= 1e-2:
        ends = [(1.0, 1.0), (2.0, 1.0), (2.0, 0.0)]
        assert min(np.linalg.norm(np.array(place.at) - end) for end in ends) < 0.1
        assert place.size < 0.1 and len(made.steps) > 1
    # uniform meshes of the same error (0.23 % with 33 540 unknowns) are far larger
    if accuracy == 1e-3:
        assert result.problem.size < 12_000
    assert "discretisation" in str(made) and "mesh 1:" in str(made)


def rings(size: float, order: int) -> tuple[Part, Part]:
    """Quarters of two rings, 1..1.5 and 1.5..2, that gmsh can mesh again."""

    def maker(inner: float, outer: float) -> Part:
        def make(sizes: SizeField | None) -> Part:
            with gmsh_session() as gmsh:
                o = gmsh.model.occ
                disc, hole = o.addDisk(0, 0, 0, outer, outer), o.addDisk(0, 0, 0, inner, inner)
                ring, _ = o.cut([(2, disc)], [(2, hole)])
                square = o.addRectangle(0, 0, 0, 2 * outer, 2 * outer)
                quarter, _ = o.intersect(ring, [(2, square)])
                o.synchronize()
                gmsh.model.addPhysicalGroup(2, [quarter[0][1]], name="ring")
                for _, tag in gmsh.model.getBoundary(quarter, oriented=False):
                    middle = np.mean(gmsh.model.getParametrizationBounds(1, tag))
                    x = np.array(gmsh.model.getValue(1, tag, [middle]))
                    name = "in" if np.hypot(x[0], x[1]) < 0.5 * (inner + outer) else "out"
                    name = "x" if x[1] < 1e-9 else "y" if x[0] < 1e-9 else name
                    gmsh.model.addPhysicalGroup(1, [tag], name=f"ring:{name}")
                if sizes is None:
                    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
                else:
                    sizes.set(gmsh)
                gmsh.model.mesh.generate(2)
                return from_gmsh(gmsh.model, gdim=2, order=order).parts["ring"]

        return remeshable(make)

    return maker(1.0, 1.5), maker(1.5, 2.0)


def pressed(order: int, kappa: float, shrink: float) -> tuple[Scene, float]:
    """A ring shrunk onto another one, springs between; the exact force of a quarter (plane strain)."""
    scene = Scene()
    inner, outer = rings(0.5, order)
    for name, part in (("inner", inner), ("outer", outer)):
        scene.substructure(name, part, STEEL)
        scene.symmetry([f"{name}:x", f"{name}:y"])
    scene.interface("fit", "inner:out", "outer:in", Elastic(normal=kappa, tangential=kappa, jump=shrink))
    E, nu = 1000.0 / (1 - 0.09), 0.3 / 0.7
    c = 1.5
    soft_in = c / E * ((c**2 + 1.0) / (c**2 - 1.0) - nu)
    soft_out = c / E * ((4.0 + c**2) / (4.0 - c**2) + nu)
    pressure = shrink / (1.0 / kappa + soft_in + soft_out)
    return scene, -pressure * 0.5 * np.pi * c


@pytest.mark.parametrize(("order", "accuracy"), [(1, 1e-2), (1, 3e-3), (2, 1e-3)])
def test_lame_rings_on_their_true_geometry(order: int, accuracy: float) -> None:
    """Straight cells that were cut would stay on the first polygons, 1 % off."""
    scene, exact = pressed(order, 2e3, 1e-3)
    result = solve(scene, accuracy=accuracy, quantity="fit", progress=False)
    made = result.errors()
    assert made.reached
    assert abs(result.mean_std("fit").mean / exact - 1.0) <= accuracy


@pytest.mark.parametrize("kappa", [2e2, 2e3])
def test_chords_of_parts_that_cannot_be_meshed_again_are_in_the_sum(kappa: float) -> None:
    """Rings of straight cells: their polygons are what finer cells converge to, not the rings."""
    scene, exact = pressed(1, kappa, 1e-3)
    for spec in scene.substructures.values():
        object.__setattr__(spec.part, "again", None)
    result = solve(assemble(scene))
    found = discretisation_error(result, "fit")
    assert found.quantity is not None and found.value is not None
    off = abs(result.mean_std("fit").mean / exact - 1.0)
    # stresses do not show it; what normals say of it is right to a factor of two
    assert found.quantity < 0.1 * off * abs(exact)
    assert 0.5 * off < sum(found.round.values()) / abs(found.value) < 2.0 * off
    made = solve(scene, accuracy=1e-2, quantity="fit", progress=False).errors()
    assert not made.reached and any("chords" in note for note in made.notes)
    assert abs(made.moments.mean / exact - 1.0) < 1.2 * made.in_all


@pytest.mark.parametrize("count", [1, 2])
def test_springs_on_means_leave_out_what_varies_between_vertices(count: int) -> None:
    """A beam on another one, springs between, on a bed: against springs at points on finer meshes."""

    def force(n: int, m: int, space: str) -> tuple[float, DiscretisationError]:
        scene = Scene()
        for name, y, k in (("a", 0.0, n), ("b", 1.0, m)):
            part = geometry.box((4.0, 1.0), (4 * k, k), (0.0, y), "triangle")
            scene.substructure(name, part, STEEL, degree=2)
        scene.interface("i", "a:y1", "b:y0", Elastic(normal=1e3, tangential=1e3), space=space)
        scene.interface("bed", "a:y0", Elastic(normal=1e3, tangential=1e3))
        scene.fix("a:x0")
        scene.traction("b:x1", (0.0, -1.0))
        result = solve(assemble(scene))
        return result.mean_std("bed").mean, discretisation_error(result, "bed")

    fine, _ = force(12, 12, "points")
    value, found = force(count, count + 1, "mortar")
    assert found.quantity is not None
    off = abs(value - fine)
    assert found.seen < 0.6 * off  # without them
    assert 0.5 * off < found.quantity + found.unseen < 2.0 * off


def test_a_value_that_is_zero_is_compared_with_what_acts() -> None:
    scene = Scene()
    for name, y in (("a", 0.0), ("b", 1.0)):
        scene.substructure(name, geometry.box((2.0, 1.0), (4, 2), (0.0, y), "triangle"), STEEL)
    stiff = LogNormal("k", mean=100.0, cov=0.2)
    scene.interface("i", "a:y1", "b:y0", Elastic(normal=stiff, tangential=stiff))
    scene.fix("a:y0")
    scene.traction("b:y1", (0.0, -1.0))
    shear = Resultant("i", component=1)
    for answer in (
        solve(scene, accuracy=1e-2, quantity=shear, progress=False),
        solve(assemble(scene), accuracy=1e-2, quantity=shear),
    ):
        made = answer.errors()
        assert made.reached and any("beside the force of 2" in note for note in made.notes)
        assert "or to 2 if that is more" in str(made)


def test_what_matters_can_be_said_in_the_unit_of_the_quantity() -> None:
    close = solve(corner_scene(), accuracy=1e-3, quantity="joint", progress=False)
    far = solve(corner_scene(), accuracy=1e-3, quantity="joint", absolute=3e-3, progress=False)
    made = far.errors()
    assert made.reached and len(made.steps) < len(close.errors().steps)
    assert abs(far.mean_std("joint").mean - CORNER) < 3e-3
    assert "relative to itself, or to 3 if that is more" in str(made)
    with pytest.raises(SceneError, match="go with an accuracy of a quantity"):
        solve(corner_scene(), accuracy=1e-3, absolute=1.0)
    with pytest.raises(SceneError, match="absolute"):
        solve(corner_scene(), accuracy=1e-3, quantity="joint", absolute=-1.0)


def chain() -> Scene:
    """Six blocks with contact and springs between, of which the first one is clamped and has large cells."""
    scene = Scene()
    for k in range(6):
        n = 2 if k == 0 else 12
        scene.substructure(f"p{k}", geometry.box((1.0, 1.0), (n, n), (float(k), 0.0), "triangle"), STEEL)
    for k in range(5):
        law = Contact() if k % 2 else Elastic(normal=500.0, tangential=500.0)
        scene.interface(f"j{k}", f"p{k}:x1", f"p{k + 1}:x0", law)
    for k in range(6):
        scene.interface(f"base{k}", f"p{k}:y0", Elastic(normal=50.0, tangential=50.0))
    scene.fix("p0:x0")
    scene.traction("p5:x1", (-1.0, 0.0))
    scene.traction("p0:y1", (-0.5, -0.3))
    return scene


def test_parts_that_do_not_decide_keep_everything() -> None:
    scene = chain()
    first = assemble(scene)
    result = solve(scene, accuracy=1e-3, quantity="j0", active="all", progress=False)
    made = result.errors()
    assert made.reached and len(made.steps) > 1
    touched = {name for step in made.steps for name in step.changed}
    kept = set(first.substructures) - touched
    assert kept
    for name in kept:  # the meshes of the scene itself
        assert result.problem.substructures[name].part is scene.substructures[name].part
    costs = {cost["body"]: cost for cost in result.solver.costs}
    last = set(made.steps[-1].changed)
    assert {name for name, cost in costs.items() if not cost["kept"]} == last
    assert made.steps[-1].kept == (6 - len(last), 6)


def test_factors_that_are_kept_give_the_same_answer() -> None:
    scene = chain()
    result = solve(scene, accuracy=1e-3, quantity="j0", active="all", progress=False)
    again = Scene()
    for name, part in result.problem.substructures.items():
        degree = int(part.space.element.basix_element.degree)
        again.substructure(name, part.part, part.material, degree=degree)
    for name, joint in result.problem.interfaces.items():
        faces = (f"{s.substructure}:{s.face}" for s in joint.sides)
        again.interface(name, *faces, joint.law, space=joint.space)
    fresh = solve(assemble(again), active="all", options=result.plan.options.with_(rtol=1e-10))
    assert not any(cost["kept"] for cost in fresh.solver.costs)
    assert any(cost["kept"] for cost in result.solver.costs)
    mine, other = result.mean_std("j0").mean, fresh.mean_std("j0").mean
    assert mine == pytest.approx(other, rel=1e-4)


def test_a_random_scene_gets_its_meshes_at_the_means() -> None:
    scene = corner_scene()
    stiff = LogNormal("k", mean=1e3, cov=0.2)
    scene.interfaces.pop("joint")
    scene.interface("joint", "L:top", "block:y0", Elastic(normal=stiff, tangential=stiff))
    result = solve(scene, accuracy=2e-2, quantity="joint", progress=False)
    made = result.errors()
    assert made.reached and made.moments is not None and made.moments.std is not None
    fine = solve(scene, accuracy=2e-3, quantity="joint", progress=False).errors()
    assert fine.reached and fine.moments is not None and fine.moments.std is not None
    assert abs(made.moments.mean / fine.moments.mean - 1.0) <= 2e-2
    assert abs(made.moments.std / fine.moments.std - 1.0) <= 2e-2


def test_a_function_of_the_fields_is_witnessed_by_its_changes() -> None:
    def shear(fields):
        return fields.force("joint")[..., 1].max(axis=1)

    result = solve(corner_scene(), accuracy=5e-2, quantity=Measure(shear, "largest shear"), progress=False)
    made = result.errors()
    assert made.discretisation is not None and "change" in made.discretisation.how
    assert len(made.steps) > 1


@pytest.mark.parametrize("accuracy", [3e-2, 5e-3])
def test_a_shear_stress_beside_a_joint(accuracy: float) -> None:
    """Uniform meshes of degree 3 with 19 012 and 74 884 unknowns give 0.693981 and 0.693963. The parts that
    the energy decides were made finer, not the one with the point: said 0.2 % and was off by 15 %."""
    scene = corner_scene(held=False)
    at = AtPoint(assemble(scene), "block", (0.5, 2.5), "stress", "xy")
    made = solve(scene, accuracy=accuracy, quantity=at, progress=False).errors()
    assert made.reached and made.moments is not None
    assert abs(made.moments.mean / 0.69396 - 1.0) <= accuracy


def sheared(cells: int, degree: int) -> Scene:
    """A small block on a wide one, pressed, then pulled along: its face opens on one side and slips."""
    scene = Scene()
    for name, width, low, count in (("wide", 16.0, 0.0, cells), ("small", 8.0, 8.0, max(1, cells // 2))):
        at = ((16.0 - width) / 2, (16.0 - width) / 2, low)
        block = geometry.box((width, width, 8.0), (count, count, count), at, cell="hexahedron")
        scene.substructure(name, block, LinearElastic(E=2e4, nu=0.3), degree=degree)
    scene.interface("seat", "small:z0", "wide:z1", Contact(friction=0.3), overlap="partial")
    scene.fix("wide:z0")
    scene.interface("top", "small:z1", Elastic(normal=100.0, tangential=100.0))
    scene.pressure("small:z1", Amplitude([0, 1], [0, 1]) * 20.0)
    scene.traction("small:x0", Amplitude([1, 2], [0, 1]) * (8.0, 0.0, 0.0))
    return scene


def test_a_contact_of_one_point_is_not_believed() -> None:
    """One point is closed or open as a whole: a higher degree leaves it, and no change tells anything."""
    quantity, times = Resultant("seat", "force", 1), [1.0, 2.0]
    fine = solve(assemble(sheared(8, 2)), times=times)
    asked = {"accuracy": 0.05, "quantity": quantity, "times": times, "max_unknowns": 6000}
    made = solve(sheared(2, 1), progress=False, **asked)
    error, value = made.errors(), float(quantity.value(made)[-1])
    off = abs(value / float(quantity.value(fine)[-1]) - 1.0)
    assert not error.reached or off <= 0.05
    assert any("cut" in how for step in error.steps for how in step.changed.values())


def test_the_energy_norm() -> None:
    result = solve(corner_scene(), accuracy=5e-2, progress=False)
    made = result.errors()
    assert made.reached and made.in_all <= 5e-2 and made.steps[-1].value is None


def test_a_budget_ends_it_with_a_word() -> None:
    result = solve(corner_scene(), accuracy=1e-4, quantity="joint", max_unknowns=2000, progress=False)
    made = result.errors()
    assert not made.reached and result.problem.size <= 2000
    assert any("budget of 2000 unknowns" in note for note in made.notes)
    assert made.in_all > 1e-4  # and says what is left
    timed = solve(corner_scene(), accuracy=1e-4, quantity="joint", max_seconds=1e-3, progress=False).errors()
    assert len(timed.steps) == 1 and any("budget of 0.001 s" in note for note in timed.notes)


def test_ctrl_c_returns_the_last_answer_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(interrupts, "_last_press", -np.inf)
    count = 0

    def pressed_later(*given, **named):
        nonlocal count
        count += 1
        if count > 1:
            signal.raise_signal(signal.SIGINT)
        return assembled_again(*given, **named)

    monkeypatch.setattr("dolfinx_frontend.estimate.meshes.assembled_again", pressed_later)
    result = solve(corner_scene(), accuracy=1e-4, quantity="joint", progress=False)
    made = result.errors()
    assert len(made.steps) == 2 and not made.reached
    assert made.discretisation is not None and made.relative("discretisation") > 1e-4
    assert 1e-4 < made.in_all < 1.0  # of the iteration its estimate
    assert any("Ctrl-C" in note for note in made.notes)


def test_what_can_have_no_finer_mesh_is_named() -> None:
    from dolfinx import fem

    scene = Scene()
    part = geometry.box((1.0, 1.0), (2, 2), cell="quadrilateral")
    E = fem.Constant(part.mesh, 1000.0)
    scene.substructure("tied", part, LinearElastic(E=E, nu=0.3), degree=2)
    scene.fix("tied:x0")
    scene.interface("end", "tied:x1", Elastic(normal=100.0, tangential=100.0))
    scene.traction("tied:y1", (0.3, 1.0))
    made = solve(scene, accuracy=1e-6, quantity="end", progress=False).errors()
    assert not made.reached
    assert any("'tied' keeps its mesh" in note and "constants on its mesh" in note for note in made.notes)
    assert any("degree 3" in how for step in made.steps for how in step.changed.values())


def test_meshes_that_match_stay_glued() -> None:
    """Parts that are glued get meshes that need not match."""
    scene = corner_scene()
    scene.interfaces.pop("joint")
    scene.interface("joint", "L:top", "block:y0", Perfect())
    settings = {"quantity": Resultant("joint"), "active": ["joint"], "progress": False}
    result = solve(scene, accuracy=1e-2, **settings)
    fine = solve(scene, accuracy=1e-3, **settings)
    assert result.errors().reached and fine.errors().reached
    assert abs(result.mean_std("joint").mean / fine.mean_std("joint").mean - 1.0) <= 1e-2


def test_what_a_scene_cannot_be_asked() -> None:
    scene = corner_scene()
    with pytest.raises(SceneError, match="leave chaos out"):
        solve(scene, accuracy=1e-2, chaos=2)
    with pytest.raises(SceneError, match="1e-10..0.5"):
        solve(scene, accuracy=2.0)
    with pytest.raises(SceneError, match="max_unknowns"):
        solve(scene, accuracy=1e-2, max_unknowns=0)
    with pytest.raises(SceneError, match=r"solve\(scene, accuracy=...\)"):
        solve(assemble(scene), accuracy=1e-2, max_unknowns=1000)


def test_the_example_of_the_documentation(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "accuracy.md").read_text()
    part = page.partition("<!-- meshes: begin -->")[2].partition("<!-- meshes: end -->")[0]
    code, shown = re.findall(r"```(?:python|text)\n(.*?)```", part, flags=re.S)
    exec(compile(code, "accuracy.md", "exec"), {"__name__": "docs"})
    printed = capsys.readouterr().out
    for line in shown.splitlines():
        if line.startswith("  mesh") or line.startswith("errors"):
            assert line in printed, printed


def test_the_peak_pressure_of_hertz_from_twenty_elements() -> None:
    """A cylinder pressed on a block (plane strain), a = R / 20; the contact zone is found on the way."""
    radius, half_width, modulus = 1.0, 0.05, 1000.0 / (1.0 - 0.09) / 2.0

    def disc(sizes: SizeField | None) -> Part:
        with gmsh_session() as gmsh:
            g = gmsh.model.geo
            angle = 0.5
            ends = [(0.0, 1.0), (0.0, 0.0), (np.sin(angle), 1.0 - np.cos(angle)), (1.0, 1.0)]
            c, low, middle, right = (g.addPoint(radius * x, radius * y, 0) for x, y in ends)
            arcs = [g.addCircleArc(low, c, middle), g.addCircleArc(middle, c, right)]
            lines = [g.addLine(c, low), *arcs, g.addLine(right, c)]
            face = g.addPlaneSurface([g.addCurveLoop(lines)])
            g.synchronize()
            gmsh.model.addPhysicalGroup(2, [face], name="disc")
            for name, line in (("middle", 0), ("contact", 1), ("top", 3)):
                gmsh.model.addPhysicalGroup(1, [lines[line]], name=f"disc:{name}")
            if sizes is None:
                gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
                gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
            else:
                sizes.set(gmsh)
            gmsh.model.mesh.generate(2)
            return from_gmsh(gmsh.model, gdim=2, order=2).parts["disc"]

    scene = Scene()
    block = geometry.box((1.5, 1.5), (2, 2), (0.0, -1.5), "triangle")
    upper = remeshable(disc)
    assert upper.num_cells + block.num_cells == 20
    scene.substructure("disc", upper, STEEL)
    scene.substructure("block", block, STEEL)
    scene.symmetry(["disc:middle", "block:x0"])
    scene.fix("block:y0", components=1)
    force = np.pi * half_width**2 * modulus / (4.0 * radius)
    scene.traction("disc:top", (0.0, -0.5 * force / radius))
    scene.interface("contact", "block:y1", "disc:contact", Contact(), overlap="partial", max_distance=100.0)

    def peak(fields):
        return -fields.force("contact")[..., 0].min(axis=1)

    result = solve(scene, accuracy=3e-2, quantity=Measure(peak, "peak pressure"), progress=False)
    made = result.errors()
    assert made.reached and made.moments is not None
    # half-space: the bodies are 20 a and more; the peak of means over a vertex is lower by their size squared
    assert abs(made.moments.mean / (2.0 * force / (np.pi * half_width)) - 1.0) < 1e-2


def few_cells() -> Scene:
    """A soft beam, glued below a stiff block that is narrower."""
    scene = Scene()
    soft, hard = LinearElastic(E=1.36619646e8, nu=0.0045), LinearElastic(E=1.360645903e11, nu=0.258)
    beam = geometry.box((0.2210298570, 0.1042968252), (3, 2), cell="triangle")
    corner = (0.08374521859, 0.1042968252)
    block = geometry.box((0.1117612291, 0.0685699579), (2, 2), origin=corner, cell="quadrilateral")
    scene.substructure("a", beam, soft, degree=1)
    scene.substructure("b", block, hard, degree=1)
    scene.interface("glue", "b:y0", "a:y1", Perfect(), overlap="partial")
    scene.fix("a:x0")
    scene.interface("spring", "b:x1", Elastic(normal=2.92257e7, tangential=1.04042e7))
    scene.traction("b:y1", (-17.16353606, -13661.96467))
    return scene


def test_glue_of_few_cells_is_not_believed_from_one_mesh():
    """3.8 % off on 42 unknowns, where 2 % was said.

    Reference: 8, 16 and 32 times as many cells, degree 2: -1408.69, -1408.66, -1408.64.
    """
    result = solve(few_cells(), accuracy=0.03, quantity=Resultant("glue"), progress=False)
    errors = result.errors()
    assert errors.reached and len(errors.steps) > 2
    assert result.mean_std(Resultant("glue")).mean == pytest.approx(-1408.64, rel=errors.in_all + 1e-4)
    budget = {"max_unknowns": 60, "progress": False}
    ended = solve(few_cells(), accuracy=0.03, quantity=Resultant("glue"), **budget).errors()
    assert not ended.reached and np.isnan(ended.in_all) and "42 unknowns, too few to believe" in str(ended)


def test_a_value_that_was_rounding_on_the_first_meshes_is_judged_by_itself_on_the_last():
    """A block that is pressed off its middle: closed on the first mesh, open at a corner on later ones."""
    scene, young = Scene(), 210e9
    for name, y in (("low", 0.0), ("up", 0.5)):
        part = geometry.box((1.0, 0.5), (4 if name == "low" else 2, 2), origin=(0.0, y))
        scene.substructure(name, part, LinearElastic(E=young, nu=0.3), degree=1)
    scene.interface("joint", "up:y0", "low:y1", Contact(friction=0.05))
    scene.fix("low:y0")
    scene.interface("side", "up:x1", Elastic(normal=young * 1e-3, tangential=0.0))
    scene.traction("up:x0", (4e6, 0.0))
    scene.force("up:y1", (0.0, -1e7), point=(0.32, 1.0))
    opening = Resultant("joint", "jump")
    given = {"accuracy": 0.1, "quantity": opening, "times": [1.0], "progress": False}
    result = solve(scene, **given, max_unknowns=2000)
    made = result.errors()
    assert abs(made.steps[0].value) < 1e-15 < 1e-9 < abs(made.steps[-1].value)
    assert "relative to itself" not in str(made) and "is rounding beside" not in str(made)
    assert not made.reached and made.in_all > 0.1


def test_the_opening_of_a_contact_that_is_closed_is_compared_with_what_moves():
    """Nothing of it is left but rounding, the same without signs, too."""
    scene = Scene()
    for name, y in (("low", 0.0), ("up", 0.5)):
        part = geometry.box((1.0, 0.5), (3, 2), origin=(0.0, y))
        scene.substructure(name, part, LinearElastic(E=210e9, nu=0.3), degree=1)
    scene.interface("joint", "up:y0", "low:y1", Contact(friction=0.3))
    scene.fix("low:y0")
    scene.traction("up:y1", (0.0, -1e7))
    result = solve(scene, accuracy=0.1, quantity=Resultant("joint", "jump"), times=[1.0], progress=False)
    made = result.errors()
    assert made.reached and abs(result.mean_std(Resultant("joint", "jump")).mean) < 1e-15
    assert re.search(r"is rounding beside the displacement of 2\.\d+e-05 that its faces have", str(made))
