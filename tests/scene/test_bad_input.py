"""Every mistake in a scene is reported with the thing, the value and a remedy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.rigid import check_rigid_bodies
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.plan.reduction import reduce
from dolfinx_frontend.reference.cholesky import Cholesky
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import (
    Displacement,
    Elastic,
    Law,
    Perfect,
    Pressure,
    Symmetry,
    Traction,
    resolve,
)
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.values import evaluate
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.parameters import LogNormal
from parts.rings import annulus

pytestmark = pytest.mark.sanitize

STEEL = LinearElastic(2e5, 0.3)
UNIT = geometry.box((1.0, 1.0), (2, 2))
ABOVE = geometry.box((1.0, 1.0), (2, 2), (0.0, 1.0))


def two(second=ABOVE, first=UNIT, material=STEEL):
    """Two parts, the lower one fixed."""
    scene = Scene()
    scene.substructure("lower", first, material, degree=1)
    scene.substructure("upper", second, material, degree=1)
    scene.fix("lower:y0")
    return scene


def message(action, *words):
    """The message of the error that an action raises, which contains the words."""
    with pytest.raises(SceneError) as caught:
        action()
    text = str(caught.value)
    for word in words:
        assert word in text, text
    return text


# ---------------------------------------------------------------------------------------------
# Names
# ---------------------------------------------------------------------------------------------
def test_unknown_names_come_with_near_ones():
    scene = two()
    glue = Perfect()
    message(lambda: scene.interface("j", "lowr:y1", "upper:y0", glue), "'lowr'", "'lower'", "'j'")
    message(lambda: scene.interface("j", "lower:y9", "upper:y0", glue), "'y9'", "'y1'", "lower")
    message(lambda: scene.interface("j", "lower", "upper:y0", glue), "'substructure:face'")
    message(lambda: scene.interface("j", "lower:y1", "upper:y0"), "no law")
    message(lambda: scene.interface("j", "lower:y1", 3.0, glue), "3.0")
    message(lambda: scene.interface("j", "lower:y1", "upper:y0", 3.0), "not a law")
    message(lambda: scene.interface("", "lower:y1", "upper:y0", glue), "not empty")
    message(lambda: Scene().interface("j", "a:b", Symmetry()), "there is no substructure yet")
    message(lambda: scene.symmetry([]), "no face given")


def test_names_are_unique():
    scene = two()
    message(lambda: scene.substructure("lower", UNIT, STEEL), "'lower'", "in use")
    message(lambda: scene.substructure("a:b", UNIT, STEEL), "colon")
    scene.symmetry("lower:x0", "s")
    message(lambda: scene.symmetry("lower:x1", "s"), "'s'", "in use")
    scene.pressure("lower:x1", 1.0)
    scene.pressure("lower:x1", 2.0)  # unnamed ones add up
    assert "pressure(lower:x1)#2" in scene.interfaces


def test_sides_of_a_law():
    scene = two()
    message(lambda: scene.interface("j", "lower:y1", Perfect()), "Perfect takes two sides")
    message(lambda: scene.interface("j", "lower:y1", "upper:y0", Symmetry()), "takes one side")
    message(lambda: scene.interface("j", "lower:y1", "lower:y1", Perfect()), "two different faces")
    message(lambda: scene.fix("upper:y1", components=2), "(2,) in 2 dimensions")
    message(lambda: scene.interface("j", "lower:y1", Pressure(1.0), quadrature_degree=0), "1..30")
    message(lambda: scene.interface("j", "lower:y1", Pressure(1.0), max_distance=-1.0), "positive")


def test_parameters_are_named():
    scene = two()
    scene.interface("joint", "lower:y1", "upper:y0", Elastic(normal=1.0, tangential=1.0))
    problem = assemble(scene)
    message(lambda: monolithic(problem, values={"joint.norml": 1.0}), "'joint.normal'")
    message(lambda: monolithic(problem, laws={"jiont": Perfect()}), "'joint'")
    message(lambda: reduce(problem, {"jiont"}), "'joint'")
    message(lambda: Elastic(normal=1.0).with_(norml=2.0), "norml", "normal, tangential")


# ---------------------------------------------------------------------------------------------
# Substructures and materials
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("degree", [0, 4, 1.5, True, "2"])
def test_degree(degree):
    message(lambda: Scene().substructure("a", UNIT, STEEL, degree=degree), "'a'", "1, 2 or 3")


def test_cells_and_dimensions():
    prism = dmesh.create_box(
        MPI.COMM_SELF, [np.zeros(3), np.ones(3)], [1, 1, 1], cell_type=dmesh.CellType.prism
    )
    part = SimpleNamespace(mesh=prism, facet_tags=None, names={})
    message(lambda: Scene().substructure("a", part, STEEL), "'prism'", "hexahedron")
    line = dmesh.create_unit_interval(MPI.COMM_SELF, 2)
    part = SimpleNamespace(mesh=line, facet_tags=None, names={})
    message(lambda: Scene().substructure("a", part, STEEL), "'interval'")
    message(lambda: Scene().substructure("a", prism, STEEL), "not a part", "'mesh'")
    scene = two()
    cube = geometry.box((1, 1, 1), (1, 1, 1))
    message(lambda: scene.substructure("c", cube, STEEL), "3 dimensions", "one dimension")
    message(lambda: Scene().substructure("a", UNIT, 3.0), "not a material")
    message(lambda: Scene().substructure("a", UNIT, STEEL, body_force=(0, 0, 1)), "give 2 numbers")
    message(lambda: assemble(Scene()), "empty")


def test_a_deterministic_answer_has_no_statistics():
    scene = two()
    scene.interface("joint", "lower:y1", "upper:y0", Perfect())
    scene.traction("upper:y1", (0.0, 1.0))
    result = solve(assemble(scene))
    with pytest.raises(AttributeError, match=r"no 'sobol': .* deterministic; .*chaos="):
        result.sobol("joint")
    with pytest.raises(AttributeError, match="'quantities'"):
        _ = result.quantities


def test_material_constants():
    message(lambda: LinearElastic(-1.0, 0.3), "E = -1.0")
    message(lambda: LinearElastic(np.nan, 0.3), "E = nan")
    message(lambda: LinearElastic(1.0, 0.5), "nu = 0.5", "-1 < nu < 0.5")
    message(lambda: LinearElastic(1.0, 0.3, "straining"), "'stress'")
    E = LogNormal("E", 1.0, cov=0.1)
    message(lambda: LinearElastic(1.0, E), "LinearElastic: nu = LogNormal('E'", "only the E of LinearElastic")
    message(lambda: LinearElastic(1.0, Amplitude([0, 1], [0, 0.3]) * 1.0), "nu =", "in time")
    message(lambda: OrthotropicElastic((1, E, 1), (0, 0, 0), (1, 1, 1)), "E = LogNormal('E'")
    message(lambda: Scene().substructure("a", UNIT, STEEL, body_force=E), "'a'", "is random")
    message(lambda: Traction((E, 0.0)), "Traction: t = (LogNormal('E'", "vector of random", "pressure(")
    cube = geometry.box((1, 1, 1), (1, 1, 1))
    stress = LinearElastic(1.0, 0.3, "stress")
    message(lambda: Scene().substructure("a", cube, stress), "'a'", "plane='stress' in 3D")
    message(lambda: OrthotropicElastic((1, 1, 1), (0.3, 0.3, 0.9), (1, 1, 1)), "positive definite")
    message(lambda: OrthotropicElastic((1, -1, 1), (0, 0, 0), (1, 1, 1)), "E = [1.0, -1.0", "> 0")
    message(lambda: OrthotropicElastic((1, 1, 1), (0, 0, np.inf), (1, 1, 1)), "not finite")
    message(lambda: OrthotropicElastic((1, 1), 0.1, 1.0), "three values")
    flat = OrthotropicElastic((1, 1), 0.1, 1.0, plane="stress")
    message(lambda: Scene().substructure("a", cube, flat), "'a'", "3D")
    full = OrthotropicElastic((1, 1, 1), (0, 0, 0), (1, 1, 1), np.eye(2))
    message(lambda: Scene().substructure("a", cube, full), "(3, 3)")
    message(
        lambda: OrthotropicElastic((1, 1, 1), (0, 0, 0), (1, 1, 1), np.ones((2, 2))), "orthonormal"
    )


def solo(material):
    scene = Scene()
    scene.substructure("plate", UNIT, material, degree=1)
    scene.fix("plate:x0")
    return scene


def test_not_a_number_in_a_matrix():
    holes = fem.Function(fem.functionspace(UNIT.mesh, ("DG", 0)))
    holes.x.array[:] = 1.0
    holes.x.array[0] = np.nan
    material = LinearElastic(holes, 0.3)
    message(lambda: assemble(solo(material)), "'plate'", "NaN")


def test_materials_that_are_no_stiffness():
    def lopsided(u, v):
        return ufl.inner(ufl.grad(u), ufl.grad(v)) + u[0] * v[1]

    message(lambda: assemble(solo(lopsided)), "'plate'", "not symmetric")
    message(lambda: assemble(solo(lambda u, v: -ufl.inner(ufl.grad(u), ufl.grad(v)))), "positive")
    message(lambda: assemble(solo(lambda u, v: None)), "'plate'", "NoneType")
    message(lambda: assemble(solo(lambda u, v: ufl.grad(u))), "scalar UFL integrand")
    message(lambda: assemble(solo(lambda u, v: u[0])), "'plate'", "not bilinear")


# ---------------------------------------------------------------------------------------------
# Values of laws
# ---------------------------------------------------------------------------------------------
def test_numbers_of_laws():
    message(lambda: Elastic(normal=-1.0), "normal = -1", "negative", ">= 0")
    message(lambda: Elastic(tangential=np.array([1.0, -2.0])), "tangential = -2")
    message(lambda: Elastic(normal=np.inf), "Perfect()")
    message(lambda: Elastic(normal=np.nan), "not finite")
    message(lambda: Elastic(), "neither normal nor tangential")
    message(lambda: Elastic(normal="stiff"), "'stiff'")
    message(lambda: Perfect(jump=np.nan), "jump")
    message(lambda: Pressure(np.nan), "p = nan")
    message(lambda: Traction((0.0, np.inf)), "t =")
    message(lambda: Displacement(0.0, components=(0, 0)), "different axes")


def joint(law, **options):
    scene = two()
    scene.interface("joint", "lower:y1", "upper:y0", law, **options)
    return scene


def test_values_of_the_wrong_shape():
    def assembled(law):
        return lambda: assemble(joint(law))

    m = assemble(joint(Perfect())).interfaces["joint"].num_points
    where = "interface 'joint', parameter 'normal'"
    message(assembled(Elastic(normal=np.ones(m + 1), tangential=1.0)), where, f"({m + 1},)", f"{m}")
    message(assembled(Elastic(normal=lambda x: np.ones((2, 3)))), where, "returned shape (2, 3)")
    message(assembled(Elastic(normal=lambda x: -x[:, 0], tangential=1.0)), "is negative", "joint")
    message(assembled(Elastic(normal=lambda x: x[:, 0] * np.nan)), where, "NaN")
    message(assembled(Elastic(normal=1.0, jump=(1.0, 2.0, 3.0))), "'jump'", "shape (3,)")
    scene = joint(Perfect())
    scene.traction("upper:y1", 3.0)
    message(lambda: assemble(scene), "'traction(upper:y1)'", "the number 3", "2 components")
    scene = joint(Perfect())
    scene.fix("upper:y1", (1.0, 2.0, 3.0), name="end")
    message(lambda: assemble(scene), "'end'", "shape (3,)")
    interface = assemble(joint(Perfect())).interfaces["joint"]
    message(lambda: resolve([1.0], interface, 3, name="p"), "'joint'", "'p'", "shape (1,)")
    message(lambda: resolve(object(), interface, 1), "type object")
    message(lambda: evaluate(lambda x: "one", interface.points, 1, "p"), "not a number")


def test_values_per_point_cannot_be_eliminated():
    scene = two()
    problem_points = assemble(joint(Perfect())).interfaces["joint"].num_points
    jump = np.full((problem_points, 2), 0.1)
    scene.interface("joint", "lower:y1", "upper:y0", Perfect(jump=jump))
    message(lambda: monolithic(assemble(scene)), "'joint'", "callable", "at nodes")


def test_values_of_the_right_shape():
    """Numbers, arrays, callables and parameters with a mean agree."""
    problem = assemble(joint(Perfect()))
    interface = problem.interfaces["joint"]
    m = interface.num_points
    uncertain = SimpleNamespace(mean=2.0)
    many = np.full(m, 2.0), np.full((m, 1), 2.0)
    for value in (2.0, *many, lambda x: 2.0 + 0 * x[:, 0], uncertain):
        assert np.array_equal(resolve(value, interface, 1), np.full((m, 1), 2.0))
    first = resolve(2.0, interface, 2, "first")
    assert np.array_equal(first, np.tile([2.0, 0.0], (m, 1)))
    assert np.array_equal(resolve([1.0, 2.0], interface, 2), np.tile([1.0, 2.0], (m, 1)))
    assert resolve(lambda x: x, interface, 2) == pytest.approx(interface.points)
    law = Elastic(normal=uncertain, tangential=1.0)
    stiff = monolithic(assemble(joint(law))).energy
    assert stiff == pytest.approx(monolithic(assemble(joint(law.with_(normal=2.0)))).energy)


# ---------------------------------------------------------------------------------------------
# Pairing
# ---------------------------------------------------------------------------------------------
def test_facets_that_do_not_face_each_other():
    words = ("'joint'", "do not face each other")
    far = two(geometry.box((1.0, 1.0), (2, 2), (0.0, 3.0)))
    far.interface("joint", "lower:y1", "upper:y0", Perfect())
    message(lambda: assemble(far), *words, "the faces are 2 apart")
    far.interface("points", "lower:y1", "upper:y0", Elastic(1.0, 1.0), space="points")
    del far.interfaces["joint"]
    message(lambda: assemble(far), "none of the 4 points", "largest distance 2")
    wrong = two()
    wrong.interface("joint", "lower:y1", "upper:y1", Perfect())
    message(lambda: assemble(wrong), *words)
    inside = two(geometry.box((1.0, 1.0), (2, 2)))  # same place, both faces look up
    inside.interface("joint", "lower:y1", "upper:y1", Perfect())
    message(lambda: assemble(inside), *words)
    inside.interface("points", "lower:y1", "upper:y1", Elastic(1.0, 1.0), space="points")
    del inside.interfaces["joint"]
    message(lambda: assemble(inside), "do not oppose")
    side = two(geometry.box((1.0, 1.0), (2, 2), (0.5, 1.0)))
    side.interface("joint", "lower:y1", "upper:y0", Perfect())
    message(lambda: assemble(side), "50 % of the area of lower:y1 is not covered", 'overlap="partial"')
    side.interface("points", "lower:y1", "upper:y0", Elastic(1.0, 1.0), space="points")
    del side.interfaces["joint"]
    text = message(lambda: assemble(side), "do not face each other", "no partner")
    assert "at 1 of 4 points" in text or "at 2 of 4 points" in text
    near = two(geometry.box((1.0, 1.0), (2, 2), (0.0, 1.4)))
    near.interface("joint", "lower:y1", "upper:y0", Perfect(), max_distance=1.0)
    assert assemble(near).interfaces["joint"].gap == pytest.approx(0.4)


def test_areas_that_differ():
    wide = two(geometry.box((2.0, 1.0), (4, 2), (0.0, 1.0)))
    wide.interface("joint", "lower:y1", "upper:y0", Elastic(normal=1.0, tangential=1.0))
    with pytest.warns(SceneWarning, match="differ by more than 1 %"):
        problem = assemble(wide)
    assert problem.interfaces["joint"].matching is None
    shifted = two(geometry.box((1.0, 1.0), (20, 2), (0.12, 1.0)), geometry.box((1.0, 1.0), (2, 2)))
    shifted.interface("joint", "lower:y1", "upper:y0", Elastic(normal=1.0, tangential=1.0), space="points")
    with pytest.warns(SceneWarning, match="beside"):
        assemble(shifted)


def test_faces_and_cells():
    ghost = geometry.Part(UNIT.mesh, UNIT.facet_tags, UNIT.names | {"ghost": 99})
    scene = two(first=ghost)
    scene.symmetry("lower:ghost")
    message(lambda: assemble(scene), "'ghost'", "no facets")
    mesh = UNIT.mesh
    middle = dmesh.locate_entities(mesh, 1, lambda x: np.abs(x[1] - 0.5) < 1e-9)
    tags = dmesh.meshtags(mesh, 1, np.sort(middle), np.full(len(middle), 1, dtype=np.int32))
    scene = Scene()
    scene.substructure("plate", geometry.Part(mesh, tags, {"middle": 1}), STEEL)
    scene.fix("plate:middle")
    message(lambda: assemble(scene), "'middle'", "inside the part")
    flipped = geometry.box((1.0, 1.0), (2, 2))
    centre = np.argmin(np.linalg.norm(flipped.mesh.geometry.x - [0.5, 0.5, 0.0], axis=1))
    flipped.mesh.geometry.x[centre, :2] = 1.5
    scene = Scene()
    scene.substructure("plate", flipped, STEEL)
    message(lambda: assemble(scene), "'plate'", "inside out")


# ---------------------------------------------------------------------------------------------
# Elimination
# ---------------------------------------------------------------------------------------------
def test_perfect_on_meshes_that_do_not_match():
    scene = two(geometry.box((1.0, 1.0), (3, 2), (0.0, 1.0)))
    scene.interface("joint", "lower:y1", "upper:y0", Perfect())
    problem = assemble(scene)
    message(lambda: monolithic(problem), "'joint'", "do not match")


def test_laws_that_cannot_be_eliminated():
    class Contact(Law):
        """Any law that the frontend does not know."""

    scene = joint(Contact())
    message(lambda: monolithic(assemble(scene)), "'joint'", "Contact cannot be eliminated")


def test_symmetry_on_a_curved_face():
    scene = Scene()
    scene.substructure("ring", annulus(1.0, 2.0, divisions=(1, 4)), STEEL)
    scene.symmetry(["ring:inner", "ring:theta0"])
    message(lambda: monolithic(assemble(scene)), "symmetry(ring:inner)", "not flat")


def test_displacements_that_contradict_each_other():
    scene = Scene()
    scene.substructure("plate", UNIT, STEEL, degree=1)
    scene.fix("plate:x0", 0.0, name="left")
    scene.fix("plate:y0", 0.1, name="bottom")
    message(lambda: monolithic(assemble(scene)), "'left'", "'bottom'", "0.05")
    scene = Scene()
    scene.substructure("plate", geometry.box((1.0, 1.0), (1, 1)), STEEL, degree=1)
    scene.fix(["plate:x0", "plate:x1"])
    message(lambda: monolithic(assemble(scene)), "plate", "nothing is left")


def test_matrices_that_are_not_definite():
    import scipy.sparse as sp

    bad = sp.csr_matrix(np.diag([1.0, -1.0]))
    message(lambda: Cholesky(bad, "mumps").solve(np.ones(2)), "not positive definite")
    message(lambda: Cholesky(bad, "cholmod").solve(np.ones(2)), "not positive definite")
    message(lambda: Cholesky(bad, "pencil"), "'pencil'", "cholmod")


# ---------------------------------------------------------------------------------------------
# Rigid bodies
# ---------------------------------------------------------------------------------------------
def test_floating_part():
    scene = two()
    words = ("unattached rigid body", "'upper'", "translation along x", "translation along y")
    message(lambda: assemble(scene), *words, "rotation about", "scene.fix")
    scene.pressure("upper:y1", 1.0)
    message(lambda: assemble(scene), *words)


def test_floating_group_is_named_as_one():
    scene = Scene()
    for k, name in enumerate(("a", "b")):
        part = geometry.box((1.0, 1.0, 1.0), (1, 1, 1), (0, 0, k))
        scene.substructure(name, part, STEEL, degree=1)
    scene.interface("glue", "a:z1", "b:z0", Perfect())
    text = message(lambda: assemble(scene), "'a', 'b' can move freely", "translation along z")
    assert text.count("rotation about") == 3 and text.count("translation") == 3
    scene.symmetry(["a:x0", "b:y0"])
    text = message(lambda: assemble(scene), "translation along z")
    assert "rotation" not in text and "along x" not in text


def test_sliding_part():
    scene = joint(Elastic(normal=100.0))
    text = message(lambda: assemble(scene), "'upper' can move freely: translation along x")
    assert "rotation" not in text and "'lower'" not in text
    assert assemble(joint(Elastic(normal=100.0, tangential=1.0))).size
    message(lambda: assemble(joint(Elastic(normal=100.0, tangential=0.0))), "translation along x")
    touching = Elastic(normal=lambda x: np.where(x[:, 0] < 0.5, 1.0, 0.0), tangential=1.0)
    assert assemble(joint(touching)).size  # half a joint holds as well


def test_turning_wheel():
    """A wheel in a frictionless bearing can turn about its centre."""
    angle = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    radial = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bearing = (("wheel",), radial + [3.0, 0.0], np.ones(12), radial[:, None, :])
    parts = {"wheel": (np.array([3.5, 0.0]), 2.0)}
    message(
        lambda: check_rigid_bodies(parts, {"bearing": bearing}),
        "'wheel' can move freely: rotation about (3, 0)",
    )


def test_hinged_door():
    """Held along a vertical line, free to turn about it."""
    z = np.linspace(0.0, 2.0, 5)
    line = np.stack([0 * z + 1.0, 0 * z, z], axis=1)
    hinge = (("door",), line, np.ones(5), np.tile(np.eye(3), (5, 1, 1)))
    parts = {"door": (np.array([1.5, 0.0, 1.0]), 1.0)}
    text = message(lambda: check_rigid_bodies(parts, {"hinge": hinge}), "rotation about z through")
    assert "(1, 0, " in text and "translation" not in text


def test_drawer():
    """A cube between two planes: one translation is left."""
    scene = Scene()
    part = geometry.box((1.0, 1.0, 1.0), (2, 2, 2))
    scene.substructure("drawer", part, STEEL, degree=1)
    scene.symmetry(["drawer:z0", "drawer:x0"])
    text = message(lambda: assemble(scene), "translation along y")
    assert "rotation" not in text
