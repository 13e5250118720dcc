"""The interface space ``mortar``, and the choice of a space: traces, patch tests, edges, overlap."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.plan.plan import make_plan
from dolfinx_frontend.scene.laws import Contact, Elastic, Perfect, Pressure
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from tests.assembly.test_averages import CELLS, LAYER, TIGHT, compressed, nodes, space, stacked
from tests.helpers import DIMENSION, block, face_mass, polynomial

LAWS = {"perfect": Perfect(), "elastic": LAYER, "smooth": Contact(), "rough": Contact(friction=5.0)}


def joined(cell, degree, law=LAYER, swapped=False, **options):
    """The interface of two stacked blocks, their spaces, parts and faces."""
    lower, upper, top, bottom, _ = stacked(cell, **options)
    V = space(lower, degree), space(upper, degree)
    sides = (lower, upper), (("a", top), ("b", bottom)), V
    if swapped:
        sides = tuple(each[::-1] for each in sides)
    return make_interface("i", law, *sides, space="mortar"), sides


# ---------------------------------------------------------------------------------------------
# Traces
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("law", ["elastic", "smooth"])
@pytest.mark.parametrize("angle", [0.0, 1.1])
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", CELLS)
def test_means_and_loads_are_exact(cell, degree, angle, law):
    """Plane faces at any angle: linear fields have the same means on both sides, constant pressures pass."""
    d = DIMENSION[cell]
    i, (parts, labels, V) = joined(cell, degree, LAWS[law], angle=angle, slope=0.2)
    assert i.space == "mortar"
    assert i.matching is None
    assert i.weights.min() > 0.0
    assert i.area == pytest.approx(np.sqrt(1.04), rel=1e-13)
    assert np.abs(i.gap).max() < 1e-13
    w = [(csr(side.trace) @ polynomial(1, nodes(W, d)).ravel()) for side, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - w[1]).max() < 1e-12
    for k, (side, W) in enumerate(zip(i.sides, V, strict=True)):
        assert np.abs(np.asarray(side.shape.sum(axis=1)) - 1.0).max() < 1e-12
        mass = face_mass(W, parts[k], labels[k][1], 2 * degree + 2)
        load = (mass @ np.ones(len(mass)))[::d]
        assert np.abs(side.shape.T @ i.weights - load).max() < 1e-12
    # what belongs to the points adds up to the facets, and values at vertices to those at the points
    assert np.abs(np.asarray(i.areas.sum(axis=0)).ravel() - i.weights).max() < 1e-13
    assert i.areas.sum() == pytest.approx(i.area, rel=1e-13)
    assert np.abs(i.vertices.nodal.sum(axis=1) - 1.0).max() < 1e-13
    if degree == 1:  # dual multipliers: the carrying side has its nodes
        own = i.sides[i.carrier].shape
        assert np.abs(own[np.arange(len(i.points)), own.argmax(axis=1).A1] - 1.0).max() < 1e-12
        assert np.abs(nodes(V[i.carrier], d)[own.argmax(axis=1).A1] - i.points).max() < 1e-14


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_the_order_of_the_sides_does_not_matter(cell, degree):
    """The same points and traces, told from the other side: the sign of the normal is the user's."""
    i, (_, _, V) = joined(cell, degree, Contact(), angle=0.4)
    j, _ = joined(cell, degree, Contact(), swapped=True, angle=0.4)
    assert i.carrier == 1 - j.carrier
    assert np.abs(i.points - j.points).max() < 1e-14
    assert np.abs(i.normals + j.normals).max() < 1e-14
    assert np.abs(i.weights - j.weights).max() < 1e-14
    for k in (0, 1):
        difference = csr(i.sides[k].trace) - csr(j.sides[1 - k].trace)
        assert abs(difference).max() < 1e-13
    # the normal points out of the side that was given first
    assert i.normals @ i.sides[0].normal == pytest.approx(np.ones(i.num_points))
    assert j.normals @ j.sides[0].normal == pytest.approx(np.ones(j.num_points))


def test_the_finer_side_carries():
    i, _ = joined("hexahedron", 2, first=[6, 6, 1], second=[2, 3, 1])
    assert (i.carrier, i.num_points) == (0, 49)
    assert "a:z1, the finer side" in i.why
    i, _ = joined("hexahedron", 2, first=[2, 3, 1], second=[6, 6, 1])
    assert (i.carrier, i.num_points) == (1, 49)
    # facets elsewhere on a large face do not count
    plate = geometry.box((10.0, 1.0, 1.0), (40, 1, 1), (-4.5, 0.0, 0.0), cell="hexahedron")
    cube = geometry.box((1.0, 1.0, 1.0), (2, 2, 1), (0.0, 0.0, 1.0), cell="hexahedron")
    V = space(plate, 1), space(cube, 1)
    labels = (("a", "z1"), ("b", "z0"))
    i = make_interface("i", Contact(), (plate, cube), labels, V, overlap="partial")
    assert i.space == "mortar"
    assert i.area == pytest.approx(1.0)


# ---------------------------------------------------------------------------------------------
# The choice of a space
# ---------------------------------------------------------------------------------------------
def test_the_choice():
    chosen = {}
    for name, law, counts in (
        ("tie", Perfect(), (2, 2)),
        ("tie apart", Perfect(), (2, 3)),
        ("springs", LAYER, (2, 2)),
        ("springs apart", LAYER, (2, 3)),
        ("contact", Contact(), (2, 2)),
        ("contact apart", Contact(), (2, 3)),
    ):
        parts = tuple(block("triangle", [n, n], [0, k], [1, k + 1]) for k, n in enumerate(counts))
        V = tuple(space(p, 1) for p in parts)
        i = make_interface(name, law, parts, (("a", "y1"), ("b", "y0")), V)
        chosen[name] = i.space
        assert (i.matching is not None) == (counts[0] == counts[1])
        assert i.why
    assert chosen == {
        "tie": "points",
        "tie apart": "mortar",
        "springs": "points",
        "springs apart": "mortar",
        "contact": "mortar",
        "contact apart": "mortar",
    }
    V = (space(parts[0], 1),)
    assert make_interface("load", Pressure(1.0), parts[:1], (("a", "y1"),), V).space == "points"
    assert make_interface("ground", Contact(), parts[:1], (("a", "y0"),), V).space == "mortar"


def test_the_plan_says_which_and_why():
    problem, _, _ = compressed("quadrilateral", 0.3, Perfect(), 2, "auto")
    text = str(make_plan(problem))
    assert "space mortar" in text
    assert "its meshes do not match: at the vertices of" in text
    problem, _, _ = compressed("quadrilateral", 0.3, Perfect(), 2, "facets")
    assert "asked for" in str(make_plan(problem))


def test_points_on_meshes_that_do_not_match_are_warned_of():
    for law, warned in ((Contact(), True), (LAYER, False)):
        scene = Scene()
        for name, n, y in (("a", 2, 0.0), ("b", 3, 1.0)):
            scene.substructure(name, geometry.box((1.0, 1.0), (n, n), (0.0, y)), LinearElastic(1.0, 0.3))
        scene.interface("i", "a:y1", "b:y0", law, space="points")
        scene.fix(["a:y0", "b:y1"])
        if warned:
            with pytest.warns(SceneWarning, match="contact in the space 'points' on meshes that do not"):
                assemble(scene)
        else:
            assemble(scene)


# ---------------------------------------------------------------------------------------------
# Solutions
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("cell", CELLS)
def test_patch(cell, seed, degree, law):
    """TARGETS 2.3 with the default space, at random angles, on random meshes: 1e-10 everywhere."""
    rng = np.random.default_rng(seed)
    slope = 0.0 if law == "smooth" else rng.uniform(-0.5, 0.5)  # friction holds an inclined face
    divisions = {"first": [*rng.integers(2, 5, 2), 2], "second": [*rng.integers(2, 5, 2), 2]}
    problem, exact, traction = compressed(
        cell, 0.3, LAWS[law], degree, "auto", angle=rng.uniform(-3.0, 3.0), slope=slope, **divisions
    )
    joint = problem.interfaces["joint"]
    assert joint.space == "mortar"
    result = solve(problem, method="accelerated", active=["joint"], options=TIGHT.with_(max_iterations=500))
    assert result.converged
    d = problem.dim
    for name, part in problem.substructures.items():
        u = result.displacements[name].reshape(-1, d)
        assert np.abs(u - exact[name](part.dof_coordinates)).max() < 1e-10 * 0.1
    force = result.force("joint")
    vectors = np.einsum("pij,pi->pj", joint.frames[:, : force.shape[1]], force)
    assert np.abs(vectors - traction).max() < 1e-10 * 1e5


@pytest.mark.parametrize("law", ["perfect", "smooth"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_faces_that_overlap_partly(cell, degree, law):
    """Only what is covered counts: means of linear fields agree, and resultants of a pressure are right."""
    d, shift = DIMENSION[cell], 0.37
    low, high = np.zeros(d), np.ones(d)
    low[-1], high[-1] = 1.0, 2.0
    low[0], high[0] = shift, 1.0 + shift
    parts = block(cell, [4] * d), block(cell, [3] * d, low, high)
    V = tuple(space(part, degree) for part in parts)
    labels = (("a", f"{'xyz'[d - 1]}1"), ("b", f"{'xyz'[d - 1]}0"))
    with pytest.raises(SceneError, match="37 % of the area of a:.1 is not covered by b:.0"):
        make_interface("joint", LAWS[law], parts, labels, V)
    i = make_interface("joint", LAWS[law], parts, labels, V, overlap="partial")
    assert i.area == pytest.approx(1.0 - shift, rel=1e-12)
    w = [csr(side.trace) @ polynomial(1, nodes(W, d)).ravel() for side, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - w[1]).max() < 1e-12
    for side, W in zip(i.sides, V, strict=True):
        load = side.shape.T @ i.weights
        assert load.sum() == pytest.approx(1.0 - shift, rel=1e-12)
        assert load @ nodes(W, d)[:, 0] == pytest.approx(0.5 * (1.0 - shift**2), rel=1e-12)


# ---------------------------------------------------------------------------------------------
# Edges and cross points
# ---------------------------------------------------------------------------------------------
def cornered(law, degree, side_law, cell="quadrilateral"):
    """Two stacked blocks whose left sides are held by `side_law`."""
    d = DIMENSION[cell]
    scene = Scene()
    low, high = np.zeros(d), np.ones(d)
    for name, n in (("a", 4), ("b", 3)):
        scene.substructure(name, block(cell, [n] * d, low, high), LinearElastic(1.0, 0.3), degree=degree)
        low, high = low.copy(), high.copy()
        low[-1], high[-1] = 1.0, 2.0
    end = "xyz"[d - 1]
    scene.interface("joint", f"a:{end}1", f"b:{end}0", law)
    side_law(scene)
    scene.fix([f"a:{end}0", f"b:{end}1"])
    return assemble(scene).interfaces["joint"]


def test_held_vertices_have_no_multiplier_of_their_own():
    def fixed(scene):
        scene.fix(["a:x0", "b:x0"])

    def rolling(scene):
        scene.symmetry(["a:x0", "b:x0"])

    whole = [0.0, 0.25, 0.5, 0.75, 1.0]
    merged = whole[1:]
    for law, degree, sides, x in (
        (Perfect(), 1, fixed, merged),
        (Perfect(), 1, rolling, merged),
        (Contact(), 1, fixed, merged),
        (Contact(), 1, rolling, whole),  # the contact holds along y, the plane along x
        (Contact(friction=0.3), 1, rolling, merged),
        (Perfect(), 2, fixed, whole),  # quadratic displacements have nodes enough
        (Elastic(normal=1.0, tangential=1.0), 1, fixed, whole),  # springs hold nothing twice
    ):
        i = cornered(law, degree, sides)
        assert np.allclose(np.sort(i.points[:, 0]), x), (law, degree, sides)
        assert i.area == pytest.approx(1.0)
        assert np.abs(i.sides[0].shape.sum(axis=1) - 1.0).max() < 1e-13
        assert np.abs(i.vertices.nodal.sum(axis=1) - 1.0).max() < 1e-13
    # the field at the held vertex is that of its neighbour
    i = cornered(Perfect(), 1, fixed)
    values = i.vertices.nodal @ i.points[:, 0]
    assert np.allclose(np.sort(values), [0.25, 0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_cross_point_of_four_parts(cell, degree):
    """Four tied squares around a point, each with its own mesh: a linear field passes, and its tractions."""
    gradient = np.array([[0.01, 0.004], [-0.002, -0.02]])
    E, nu = 3.0, 0.3
    strain = 0.5 * (gradient + gradient.T)
    stress = E / (1 + nu) * (strain + nu / (1 - 2 * nu) * np.trace(strain) * np.eye(2))
    scene = Scene()
    for name, n, x, y in (("a", 2, 0, 0), ("b", 3, 1, 0), ("c", 5, 0, 1), ("d", 4, 1, 1)):
        part = block(cell, [n, n], [x, y], [x + 1, y + 1])
        scene.substructure(name, part, LinearElastic(E, nu), degree=degree)
        outer = [f"{name}:x{x}", f"{name}:y{y}"]
        scene.fix(outer, value=lambda p: p @ gradient.T)
    joints = {"ab": ("a:x1", "b:x0"), "cd": ("c:x1", "d:x0"), "ac": ("a:y1", "c:y0"), "bd": ("b:y1", "d:y0")}
    for name, faces in joints.items():
        scene.interface(name, *faces, Perfect())
    problem = assemble(scene)
    result = solve(problem, options=TIGHT.with_(max_iterations=500))
    assert result.converged
    for name, part in problem.substructures.items():
        u = result.displacements[name].reshape(-1, 2)
        assert np.abs(u - part.dof_coordinates @ gradient.T).max() < 1e-10 * 0.02
    for name in joints:
        i = problem.interfaces[name]
        force = np.einsum("pij,pi->pj", i.frames, result.force(name))
        assert np.abs(force - i.sides[0].normal @ stress).max() < 1e-7 * np.abs(stress).max()


@pytest.mark.parametrize("overlap", ["full", "partial"])
@pytest.mark.parametrize("cell", CELLS)
def test_faces_that_meet_in_an_edge_or_a_corner_are_refused(cell, overlap):
    """Faces of one plane that continue each other, and faces around a corner, have no area in common."""
    d = DIMENSION[cell]
    beside, ends = np.zeros(d), np.ones(d)
    beside[:2], ends[:2] = 1.0, 2.0  # on the diagonal: a line, or a point in 2D
    parts = block(cell, [2] * d), block(cell, [3] * d, beside, ends)
    V = tuple(space(part, 1) for part in parts)
    for faces in (("x1", "x0"), ("x1", "y0"), ("y1", "x0")):
        labels = (("a", faces[0]), ("b", faces[1]))
        with pytest.raises(SceneError, match="'joint': the facets do not face each other: no facet of a:"):
            make_interface("joint", Contact(), parts, labels, V, overlap=overlap)


def test_round_parts_that_touch_in_a_line_or_a_point():
    """A cylinder and a ball on a plane: contact there and gaps beside it, found from the distance."""
    for cell in ("triangle", "hexahedron"):
        d = DIMENSION[cell]
        scene = Scene()

        def arch(x):
            out = x.copy()
            rise = 1.0 - np.sqrt(1.0 - 0.25 * (x[:, : d - 1] ** 2).sum(axis=1))
            out[:, -1] = x[:, -1] + (2.0 - x[:, -1]) * rise
            return out

        low, high = -0.5 * np.ones(d), 0.5 * np.ones(d)
        low[-1], high[-1] = 1.0, 2.0
        round_part = block(cell, [10] * (d - 1) + [2], low, high, arch, 2)
        low[-1], high[-1] = 0.0, 1.0
        ground = block(cell, [6] * (d - 1) + [2], low, high)
        scene.substructure("ball", round_part, LinearElastic(1.0, 0.3), degree=2)
        scene.substructure("ground", ground, LinearElastic(1.0, 0.3), degree=2)
        axis = "xyz"[d - 1]
        scene.interface("contact", f"ball:{axis}0", f"ground:{axis}1", Contact(), overlap="partial")
        scene.fix(f"ground:{axis}0")
        scene.symmetry([f"ball:{a}0" for a in "xyz"[: d - 1]])
        scene.fix(f"ball:{axis}1", value=-0.002, components=d - 1)
        problem = assemble(scene)
        i = problem.interfaces["contact"]
        result = solve(problem, options=TIGHT.with_(rtol=1e-7, max_iterations=1000))
        assert result.converged
        pressure = -result.force("contact")[:, 0]
        r = np.linalg.norm(i.points[:, : d - 1], axis=1)
        assert np.all(pressure >= -1e-9) and r[pressure > 1e-6].max() < 0.3
        assert r[np.argmax(pressure)] < 0.1


# ---------------------------------------------------------------------------------------------
# Nodes off the middle of quadratic edges
# ---------------------------------------------------------------------------------------------
def uneven(cell, off, along):
    """Two blocks of quadratic cells, pressed evenly; nodes between vertices are moved within the plane.

    Each by off edges in the first direction and off * along in the second one: diagonals stay straight if
    along is 1.
    """
    d = DIMENSION[cell]
    scene = Scene()
    for name, base, n, sign in (("a", 0.0, 3, 1.0), ("b", 1.0, 2, -0.7)):

        def moved(x, n=n, sign=sign):
            out = x.copy()
            for j, factor in zip(range(d - 1), (1.0, along)):
                between = np.round(2 * n * x[:, j]).astype(int) % 2 == 1
                out[between, j] += sign * off * factor / n
            return out

        low = np.zeros(d)
        low[-1] = base
        part = block(cell, [n] * d, low, low + 1, moved, 2)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=2)
        scene.symmetry([f"{name}:{axis}0" for axis in "xy"[: d - 1]])
    end = "xyz"[d - 1]
    scene.interface("joint", f"a:{end}1", f"b:{end}0", Contact())
    scene.symmetry(f"a:{end}0")
    scene.pressure(f"b:{end}1", 1.0)
    return assemble(scene)


@pytest.mark.parametrize("off", [0.02, 0.15])
@pytest.mark.parametrize("cell", CELLS)
def test_nodes_off_the_middle_of_straight_edges_pass_the_patch_test(cell, off):
    problem = uneven(cell, off, 1.0)
    assert problem.interfaces["joint"].area == pytest.approx(1.0, rel=1e-13)
    result = solve(problem, options=TIGHT)
    assert np.abs(result.force("joint")[:, 0] + 1.0).max() < 1e-10


def test_nodes_off_the_middle_of_curved_edges_are_told():
    """Diagonals of tetrahedra that are no longer straight: facets are cut along chords, beside them."""
    message = r"'joint': middle nodes of .* up to 1\d % .* wrong by 0\.\d %"
    with pytest.warns(SceneWarning, match=message) as told:
        problem = uneven("tetrahedron", 0.15, 0.6)
    assert len(told) == 2  # of each side
    off = np.abs(solve(problem, options=TIGHT).force("joint")[:, 0] + 1.0).max()
    assert off < 0.15 * 0.15**2 * 2  # twice what is told
