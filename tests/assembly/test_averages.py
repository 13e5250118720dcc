"""The interface space ``facets``: averages, intersections, patch tests and convergence."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
import ufl
from dolfinx import fem

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.overlap import check_cover, common, constant
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.plan import make_plan
from dolfinx_frontend.plan.reduction import reduce
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.scene.laws import Contact, Elastic, Perfect, Pressure
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from latin_core import Options
from tests.helpers import DIMENSION, block, face_mass, polynomial, wavy

CELLS = list(DIMENSION)
TIGHT = Options(rtol=1e-12)
FIRST, SECOND = [3, 4, 2], [4, 3, 2]
LAYER = Elastic(normal=3e6, tangential=3e6)


def space(part, degree):
    return fem.functionspace(part.mesh, ("Lagrange", degree, (part.mesh.geometry.dim,)))


def nodes(V, d):
    return V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local, :d]


def turn(d, angle):
    """A rotation of the plane, or one about the axis (1, 2, 2) / 3."""
    if d == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    a = np.array([1.0, 2.0, 2.0]) / 3.0
    cross = np.cross(np.eye(3), -a)
    return np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(a, a)


def stacked(cell, angle=0.0, slope=0.0, amount=0.08, first=FIRST, second=SECOND):
    """Blocks of height 1 on top of each other; the common plane is inclined, then all is turned.

    Their meshes are wavy within the common plane and do not match.
    """
    d = DIMENSION[cell]
    axis = d - 1
    low, high = np.zeros(d), np.ones(d)
    low[axis], high[axis] = 1.0, 2.0
    R = turn(d, angle)

    def mapping(sign):
        def apply(x):
            out = wavy(sign * amount, axis)(x)
            hat = 1.0 - np.abs(x[:, axis] - 1.0)  # 1 on the common plane, 0 at the bottom and top
            out[:, axis] += slope * hat * (out[:, 0] - 0.5)
            return out @ R.T

        return apply

    lower = block(cell, first[:d], mapping=mapping(1.0), seed=1)
    upper = block(cell, second[:d], low, high, mapping(-1.0), seed=2)
    end = "xyz"[axis]
    return lower, upper, f"{end}1", f"{end}0", R


def pair(cell, degree, **options):
    """The interface of two stacked blocks, and their spaces."""
    lower, upper, top, bottom, _ = stacked(cell, **options)
    V = space(lower, degree), space(upper, degree)
    i = make_interface(
        "i", LAYER, (lower, upper), (("a", top), ("b", bottom)), V, space="facets"
    )
    return i, V, (lower, upper), (top, bottom)


# ---------------------------------------------------------------------------------------------
# Averages
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", CELLS)
def test_averages_and_loads_are_exact(cell, degree, angle):
    """Plane faces at any angle: linear means, and the resultants of a constant pressure."""
    d = DIMENSION[cell]
    i, V, parts, faces = pair(cell, degree, angle=angle, slope=0.2)
    total = np.sqrt(1.04)
    assert i.space == "facets"
    assert i.matching is None
    assert i.num_points == len(FacetMap(parts[0], faces[0], "test"))
    assert i.area == pytest.approx(total, rel=1e-13)
    assert i.area == pytest.approx(i.sides[1].area, rel=1e-13)
    assert np.abs(i.gap).max() < 1e-13
    for k, (side, W) in enumerate(zip(i.sides, V, strict=True)):
        assert np.abs(np.asarray(side.shape.sum(axis=1)) - 1.0).max() < 1e-13
        w = (csr(side.trace) @ polynomial(1, nodes(W, d)).ravel()).reshape(-1, d)
        # coefficients of cubic nodal functions in monomials are up to 200
        assert np.abs(w - polynomial(1, i.points)).max() < (1e-12 if degree == 3 else 1e-13)
        # 2 degree + 2 is exact for bilinear facets
        mass = face_mass(W, parts[k], faces[k], 2 * degree + 2)
        load = (mass @ np.ones(len(mass)))[::d]
        assert np.abs(side.shape.T @ i.weights - load).max() < 1e-12


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [2, 3])
def test_means_of_polynomials_agree(cell, degree):
    """Both traces see the same mean of every polynomial of the degree, and it is the right one."""
    d = DIMENSION[cell]
    i, V, parts, faces = pair(cell, degree, angle=0.4, slope=0.2)
    w = [s.shape @ polynomial(degree, nodes(W, d)) for s, W in zip(i.sides, V, strict=True)]
    facets = FacetMap(parts[0], faces[0], "test")
    index, s, weight = facets.quadrature(2 * degree + 4)
    x, _, scale = facets.surface(index, s)
    moment = sp.csr_matrix((weight * scale, (index, np.arange(len(index)))))
    exact = (moment @ polynomial(degree, x)) / i.weights[:, None]
    for mean in w:
        assert np.abs(mean - exact).max() < 1e-12


def test_facets_within_a_quadrilateral():
    """Shape functions of a quadrilateral that is no parallelogram are no polynomials on a part of it."""
    i, V, parts, faces = pair("hexahedron", 2, angle=0.4, first=[6, 8, 2], second=[2, 3, 2])
    mass = face_mass(V[1], parts[1], faces[1], 8)
    load = (mass @ np.ones(len(mass)))[::3]
    assert np.abs(i.sides[1].shape.T @ i.weights - load).max() < 1e-12


def test_mixed_cells():
    """Triangles on quadrilaterals, in both orders."""
    tet = block("tetrahedron", [3, 3, 1], mapping=wavy(0.05, 2))
    hexa = block("hexahedron", [4, 2, 1], [0, 0, 1], [1, 1, 2], wavy(-0.08, 2))
    for first, second, ends in ((tet, hexa, ("z1", "z0")), (hexa, tet, ("z0", "z1"))):
        V = space(first, 2), space(second, 1)
        labels = (("a", ends[0]), ("b", ends[1]))
        i = make_interface("i", Perfect(), (first, second), labels, V, space="facets")
        mass = face_mass(V[1], second, ends[1], 5)
        load = (mass @ np.ones(len(mass)))[::3]
        assert np.abs(i.sides[1].shape.T @ i.weights - load).max() < 1e-12


@pytest.mark.parametrize("cell", CELLS)
def test_matching_facets_are_recognised(cell):
    """Renumbered copies match, also where the maps are not affine; such interfaces can be glued."""
    d = DIMENSION[cell]
    axis = d - 1
    low, high = np.zeros(d), np.ones(d)
    low[axis], high[axis] = 1.0, 2.0
    lower = block(cell, FIRST[:d], mapping=wavy(0.08, axis), seed=5)
    upper = block(cell, FIRST[:d], low, high, wavy(0.08, axis), seed=6)
    end = "xyz"[axis]
    V = space(lower, 2), space(upper, 2)
    labels = (("a", f"{end}1"), ("b", f"{end}0"))
    i = make_interface("i", Perfect(), (lower, upper), labels, V, space="facets")
    assert i.matching is not None
    assert len(i.matching) == np.prod([2 * n + 1 for n in FIRST[: d - 1]])


def test_one_side():
    part = block("hexahedron", [3, 2, 1], mapping=wavy(0.08, 2))
    V = space(part, 2)
    i = make_interface("i", Pressure(1.0), (part,), (("a", "z1"),), (V,), space="facets")
    assert i.num_points == 6
    w = i.sides[0].shape @ polynomial(1, nodes(V, 3))
    assert np.abs(w - polynomial(1, i.points)).max() < 1e-13
    mass = face_mass(V, part, "z1", 6)
    load = (mass @ np.ones(len(mass)))[::3]
    assert np.abs(i.sides[0].shape.T @ i.weights - load).max() < 1e-13
    # averages of quadratic vertex functions vanish: normals at nodes have their own points
    assert np.abs(i.sides[0].node_normals - [0, 0, 1]).max() < 1e-13


def test_gap_is_the_mean_distance():
    lower = block("hexahedron", [2, 2, 1])
    upper = block("tetrahedron", [3, 3, 1], [0, 0, 1.03], [1, 1, 2])
    V = space(lower, 1), space(upper, 1)
    labels = (("a", "z1"), ("b", "z0"))
    i = make_interface("i", Perfect(), (lower, upper), labels, V, space="facets")
    assert i.gap == pytest.approx(np.full(4, 0.03), abs=1e-14)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("ratio", [1e-4, 1.0, 1e4])
def test_thin_facets_and_contrast_of_size(cell, ratio):
    size = np.array([ratio, 1.0, 1.0])
    lower = geometry.box(size, (2, 3, 1), cell=cell)
    upper = geometry.box(size, (3, 50, 1), (0, 0, 1.0), cell=cell)
    for parts, ends in (((lower, upper), ("z1", "z0")), ((upper, lower), ("z0", "z1"))):
        V = space(parts[0], 2), space(parts[1], 2)
        labels = (("a", ends[0]), ("b", ends[1]))
        i = make_interface("i", Perfect(), parts, labels, V, space="facets")
        assert i.area == pytest.approx(ratio, rel=1e-13)
        for side, W in zip(i.sides, V, strict=True):
            w = side.shape @ polynomial(1, nodes(W, 3) / size)
            assert np.abs(w - polynomial(1, i.points / size)).max() < 1e-12
        mass = face_mass(V[1], parts[1], ends[1], 4)
        load = (mass @ np.ones(len(mass)))[::3]
        assert np.abs(i.sides[1].shape.T @ i.weights - load).max() < 1e-12 * ratio


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_units_do_not_matter(scale):
    def mapping(x):
        return scale * wavy(0.08, 2)(x)

    lower = block("tetrahedron", FIRST, mapping=mapping)
    upper = block("tetrahedron", SECOND, [0, 0, 1], [1, 1, 2], mapping)
    V = space(lower, 2), space(upper, 2)
    labels = (("a", "z1"), ("b", "z0"))
    i = make_interface("i", Perfect(), (lower, upper), labels, V, space="facets")
    assert i.area == pytest.approx(scale**2, rel=1e-13)
    w = [s.shape @ nodes(W, 3) for s, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - w[1]).max() < 1e-13 * scale


def curved(cell, count, order):
    """A quarter of a cylinder of radius 2 between two meshes that do not match."""
    d = DIMENSION[cell]

    def bend(x):
        r, angle = 1.0 + x[:, 0], 0.5 * np.pi * x[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), *x.T[2:]])

    low, high = np.zeros(d), np.ones(d)
    low[0], high[0] = 1.0, 2.0
    inner = block(cell, [1, 2 * count, count][:d], mapping=bend, order=order, seed=1)
    outer = block(cell, [1, 3 * count, count + 1][:d], low, high, bend, order, seed=2)
    V = space(inner, 2), space(outer, 2)
    labels = (("a", "x1"), ("b", "x0"))
    return make_interface("i", Perfect(), (inner, outer), labels, V, space="facets"), V, (inner, outer)


@pytest.mark.parametrize(("order", "least"), [(1, 1.9), (2, 3.9)])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_curved_faces_converge(cell, order, least):
    """Coordinates have the same means on both sides up to h^2 (chords) and h^4 (quadratic maps)."""
    d = DIMENSION[cell]
    errors = []
    for count in (2, 4, 8):
        i, V, _ = curved(cell, count, order)
        assert np.abs(np.asarray(i.sides[1].shape.sum(axis=1)) - 1.0).max() < 1e-12
        w = [s.shape @ nodes(W, d) for s, W in zip(i.sides, V, strict=True)]
        errors.append(np.abs(w[0] - w[1]).max())
        assert abs(i.area / np.pi - 1.0) < 0.1 / count**2
    rates = [np.log2(a / b) for a, b in pairwise(errors)]
    assert rates[-1] > least, (errors, rates)


def test_round_rims_need_not_agree():
    """Two meshes of a disc have different chords at the rim: what lies between them is filled."""

    def disc(x):
        r = np.abs(x[:, :2] - 0.5).max(axis=1, keepdims=True)
        length = np.linalg.norm(x[:, :2] - 0.5, axis=1, keepdims=True)
        scale = np.divide(r, length, out=np.zeros_like(r), where=length > 0)
        return np.column_stack([(x[:, :2] - 0.5) * scale, x[:, 2]])

    lower = block("tetrahedron", [10, 10, 1], mapping=disc)
    upper = block("tetrahedron", [14, 14, 1], [0, 0, 1], [1, 1, 2], disc)
    V = space(lower, 1), space(upper, 1)
    labels = (("a", "z1"), ("b", "z0"))
    i = make_interface("i", LAYER, (lower, upper), labels, V, space="facets")
    assert i.area == pytest.approx(i.sides[0].area, rel=1e-12)
    partly = make_interface("i", LAYER, (lower, upper), labels, V, space="facets", overlap="partial")
    assert 0.99 * i.area < partly.area < 0.9999 * i.area
    w = [s.shape @ nodes(W, 3) for s, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - w[1]).max() < 1e-13


# ---------------------------------------------------------------------------------------------
# Overlap
# ---------------------------------------------------------------------------------------------
def overhanging(cell, shift, overlap, **options):
    d = DIMENSION[cell]
    low, high = np.zeros(d), np.ones(d)
    low[d - 1], high[d - 1] = 1.0, 2.0
    low[0] += shift
    high[0] += shift
    lower, upper = block(cell, [4] * d), block(cell, [3] * d, low, high)
    end = "xyz"[d - 1]
    V = space(lower, 2), space(upper, 2)
    labels = (("a", f"{end}1"), ("b", f"{end}0"))
    i = make_interface(
        "i", Perfect(), (lower, upper), labels, V, space="facets", overlap=overlap, **options
    )
    return i, V


@pytest.mark.parametrize("cell", CELLS)
def test_partial_overlap(cell):
    """A facet counts with its covered area; the rest is left out; both means are over the same area."""
    d = DIMENSION[cell]
    shift = 0.37
    i, V = overhanging(cell, shift, "partial")
    assert i.area == pytest.approx(1.0 - shift, rel=1e-13)
    first = FacetMap(block(cell, [4] * d), f"{'xyz'[d - 1]}1", "test")
    assert i.num_points == len(first) - (len(first) // 4)
    assert i.points[:, 0].min() > shift
    for side, W in zip(i.sides, V, strict=True):
        w = side.shape @ polynomial(1, nodes(W, d))
        assert np.abs(w - polynomial(1, i.points)).max() < 1e-13
        assert np.abs(np.asarray(side.shape.sum(axis=1)) - 1.0).max() < 1e-13


@pytest.mark.parametrize("cell", CELLS)
def test_overlap_errors(cell):
    with pytest.raises(SceneError, match=r"37 % of the area of a:.1 is not covered by b:.0"):
        overhanging(cell, 0.37, "full")
    for overlap in ("full", "partial"):
        with pytest.raises(
            SceneError, match=r"interface 'i': the facets do not face each other.*faces are 0\.5 apart"
        ):
            overhanging(cell, 1.5, overlap)


def test_too_far_apart():
    lower = block("hexahedron", [2, 2, 1])
    upper = block("hexahedron", [3, 3, 1], [0, 0, 1.2], [1, 1, 2])
    V = space(lower, 1), space(upper, 1)
    labels = (("a", "z1"), ("b", "z0"))
    with pytest.raises(SceneError, match="no facet of a:z1 overlaps one of b:z0"):
        make_interface("i", Perfect(), (lower, upper), labels, V, None, 0.1, space="facets")
    i = make_interface("i", Perfect(), (lower, upper), labels, V, None, 0.3, space="facets")
    assert i.gap == pytest.approx(np.full(4, 0.2))
    # tilted: a part of it is too far away, and the message says how far it is
    upper = block(
        "hexahedron", [3, 3, 1], [0, 0, 1], [1, 1, 2],
        lambda x: np.column_stack([x[:, :2], x[:, 2] + 0.3 * x[:, 0]]),
    )
    V = space(lower, 1), space(upper, 1)
    with pytest.raises(SceneError, match=r"is not covered by b:z0 .* largest distance 0\.\d+"):
        make_interface("i", Perfect(), (lower, upper), labels, V, None, 0.2, space="facets")


def test_folded_side():
    """A face with two sheets above each other would count twice."""
    lower = block("hexahedron", [2, 2, 1])
    sheets = block("hexahedron", [2, 2, 2], [0, 0, 1], [1, 1, 1.1])
    first = FacetMap(lower, "z1", "test")
    twice = FacetMap(sheets, "z0", "test")
    for name in ("cells", "local", "nodes"):
        value = getattr(twice, name)
        setattr(twice, name, np.concatenate([value, value]))
    twice.nodes[len(twice) // 2 :, :, 2] += 0.05
    V = space(lower, 1), space(sheets, 1)
    near = 0.25 * first.sizes, 0.25 * twice.sizes
    found = common((first, twice), V, constant("quadrilateral"), near)
    with pytest.raises(SceneError, match="more than once"):
        check_cover("interface 'i'", ("a:z1", "b:z0"), (first, twice), found, "full")


def test_scene_keywords():
    scene = Scene()
    for name in "ab":
        scene.substructure(name, geometry.box((1.0, 1.0), (2, 2)), LinearElastic(1.0, 0.3))
    with pytest.raises(SceneError, match="space = 'nodes'; use 'auto' or 'points' or 'facets' or 'mortar'"):
        scene.interface("i", "a:x1", "b:x0", Perfect(), space="nodes")
    with pytest.raises(SceneError, match="overlap = 'some'"):
        scene.interface("i", "a:x1", "b:x0", Perfect(), space="facets", overlap="some")
    with pytest.raises(SceneError, match="needs two sides and a space that knows what is covered: 'mortar'"):
        scene.interface("i", "a:x1", "b:x0", Perfect(), space="points", overlap="partial")
    with pytest.raises(SceneError, match="needs two sides"):
        scene.interface("i", "a:x1", Pressure(1.0), space="facets", overlap="partial")


# ---------------------------------------------------------------------------------------------
# Solutions
# ---------------------------------------------------------------------------------------------
MODULUS = 2e6


def compressed(cell, nu, law, degree, interface_space="facets", **options):
    """Two blocks, height 2, compressed by 0.1 along their (turned) axis; the sides are free.

    Bottom and top get the displacement of the uniaxial stress -1e5, plus the opening of the
    interface above it. Returns the problem, the exact displacements and the exact traction.
    """
    d = DIMENSION[cell]
    lower, upper, top, bottom, R = stacked(cell, **options)
    strain = np.full(d, 0.05 * nu)
    strain[d - 1] = -0.05
    gradient = R @ np.diag(strain) @ R.T
    axis = R[:, d - 1]
    scene = Scene()
    material = LinearElastic(MODULUS, nu, plane="stress" if d == 2 else "strain")
    for name, part in (("a", lower), ("b", upper)):
        scene.substructure(name, part, material, degree=degree)
    scene.interface("joint", f"a:{top}", f"b:{bottom}", law, space=interface_space)
    V = space(lower, 1)
    n = make_interface("n", Pressure(0.0), (lower,), (("a", top),), (V,)).normals[0]
    traction = -1e5 * axis * (axis @ n)
    opening = traction / law.normal if isinstance(law, Elastic) else np.zeros(d)
    exact = {"a": lambda x: x @ gradient.T, "b": lambda x: x @ gradient.T + opening}
    scene.fix(f"a:{bottom}", value=exact["a"], name="bottom")
    scene.fix(f"b:{top}", value=exact["b"], name="top")
    return assemble(scene), exact, traction


@pytest.mark.parametrize("law", [Perfect(), LAYER], ids=["perfect", "elastic"])
@pytest.mark.parametrize(
    ("angle", "slope"), [(0.0, 0.0), (0.4, 0.25), (1.3, 0.5)], ids=["flat", "inclined", "steep"]
)
@pytest.mark.parametrize("nu", [0.0, 0.3])
@pytest.mark.parametrize("cell", CELLS)
def test_patch(cell, nu, angle, slope, law):
    """TARGETS 2.3: constant pressure and linear displacements are transferred without an error."""
    problem, exact, traction = compressed(cell, nu, law, 2, angle=angle, slope=slope)
    assert problem.interfaces["joint"].matching is None
    result = solve(problem, method="accelerated", active=["joint"], options=TIGHT)
    assert result.plan.active == ("joint",)
    assert result.converged
    d = problem.dim
    for name, part in problem.substructures.items():
        u = result.displacements[name].reshape(-1, d)
        assert np.abs(u - exact[name](part.dof_coordinates)).max() < 1e-10 * 0.1
    joint = problem.interfaces["joint"]
    force = np.einsum("pij,pi->pj", joint.frames, result.force("joint"))
    assert np.abs(force - traction).max() < 1e-10 * 1e5
    if slope == 0.0:
        assert np.abs(result.force("joint")[:, 0] + 1e5).max() < 1e-10 * 1e5


@pytest.mark.parametrize("law", [Contact(), Contact(friction=5.0)], ids=["smooth", "rough"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("cell", CELLS)
def test_patch_in_contact(cell, seed, law):
    """The same with contact, at random angles; a face inclined to the load is held by friction."""
    rng = np.random.default_rng(seed)
    slope = rng.uniform(-0.5, 0.5) if law.rubs else 0.0
    divisions = {"first": [3, 4, 2], "second": [*rng.integers(2, 5, 2), 2]}
    problem, exact, traction = compressed(
        cell, 0.3, law, 2, angle=rng.uniform(-3.0, 3.0), slope=slope, **divisions
    )
    assert problem.interfaces["joint"].matching is None
    result = solve(problem, options=TIGHT.with_(max_iterations=2000))
    assert result.converged
    d = problem.dim
    for name, part in problem.substructures.items():
        u = result.displacements[name].reshape(-1, d)
        assert np.abs(u - exact[name](part.dof_coordinates)).max() < 1e-10 * 0.1
    joint = problem.interfaces["joint"]
    force = result.force("joint")
    vectors = np.einsum("pij,pi->pj", joint.frames[:, : force.shape[1]], force)
    assert np.abs(vectors - traction).max() < 1e-10 * 1e5


@pytest.mark.parametrize("cell", CELLS)
def test_points_do_not_pass_the_patch_test(cell):
    """What the space ``points`` misses on the same scene, on any mesh: benchmarks/measured/interfaces.md."""
    problem, exact, _ = compressed(cell, 0.3, LAYER, 2, "points", angle=0.4)
    result = solve(problem, method="accelerated", active=["joint"], options=TIGHT)
    u = np.concatenate(
        [
            result.displacements[n].reshape(-1, problem.dim) - exact[n](part.dof_coordinates)
            for n, part in problem.substructures.items()
        ]
    )
    assert 1e-4 < np.abs(u).max() / 0.1 < 5e-2
    assert 1e-4 < np.abs(result.force("joint")[:, 0] / -1e5 - 1.0).max() < 0.1


def saddle(problem, held):
    """Dense oracle: minimise the energy under W (T2 - T1) u = 0 and u = value at the held nodes."""
    offset, start = {}, 0
    for name, part in problem.substructures.items():
        offset[name], start = start, start + part.size
    K = sp.block_diag([s.matrix for s in problem.substructures.values()]).toarray()
    joint = problem.interfaces["joint"]
    C = np.zeros((joint.dim * joint.num_points, start))
    for sign, side in zip((-1.0, 1.0), joint.sides, strict=True):
        T = csr(side.trace).toarray()
        C[:, offset[side.substructure] : offset[side.substructure] + T.shape[1]] += sign * T
    C *= np.repeat(joint.weights, joint.dim)[:, None]
    fixed, value = [], []
    for side, function in held:
        at = problem.substructures[side.substructure].dof_coordinates[side.nodes]
        columns = joint.dim * side.nodes[:, None] + np.arange(joint.dim)
        fixed.append(columns.ravel() + offset[side.substructure])
        value.append(function(at).ravel())
    u = np.zeros(start)
    u[np.concatenate(fixed)] = np.concatenate(value)
    free = np.setdiff1d(np.arange(start), np.concatenate(fixed))
    A = np.block([[K[np.ix_(free, free)], C[:, free].T], [C[:, free], np.zeros((len(C),) * 2)]])
    b = -np.concatenate([(K @ u)[free], C @ u])
    scale = np.sqrt(np.abs(np.diag(K)).mean())  # K and C in like units before the pseudo-inverse
    D = np.concatenate([np.full(len(free), 1 / scale), np.full(len(C), scale / joint.weights.mean())])
    x = D * np.linalg.lstsq(D[:, None] * A * D, D * b, rcond=1e-12)[0]
    u[free] = x[: len(free)]
    names = problem.substructures
    force = x[len(free) :].reshape(-1, joint.dim)
    return {n: u[offset[n] : offset[n] + names[n].size] for n in names}, force


@pytest.mark.parametrize("space", ["facets", "mortar"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_perfect_is_the_saddle_point(cell, degree, space):
    """Bent blocks: the iteration against the constrained minimum of energy, solved densely."""
    d = DIMENSION[cell]
    lower, upper, top, bottom, _ = stacked(cell, 0.4, 0.25, first=[3, 2, 1], second=[2, 3, 1])
    scene = Scene()
    for name, part, E in (("a", lower, 1.0), ("b", upper, 3.0)):
        scene.substructure(name, part, LinearElastic(E, 0.3), degree=degree)
    scene.interface("joint", f"a:{top}", f"b:{bottom}", Perfect(), space=space)

    def lift(x):
        return np.sin(2.0 * x @ np.arange(1.0, d * d + 1.0).reshape(d, d) / d)

    scene.fix(f"a:{bottom}", name="bottom")
    scene.fix(f"b:{top}", value=lift, name="top")
    if space == "facets" and cell == "tetrahedron" and degree == 1:
        with pytest.raises(SceneError, match="12 facets but 12 nodes on a:z1: .* use space='mortar'"):
            assemble(scene)
        return
    problem = assemble(scene)
    result = solve(problem, options=TIGHT)  # active without being asked for
    assert result.converged
    held = [
        (problem.interfaces["bottom"].sides[0], np.zeros_like),
        (problem.interfaces["top"].sides[0], lift),
    ]
    u, force = saddle(problem, held)
    for name in problem.substructures:
        assert np.abs(result.displacements[name] - u[name]).max() < 1e-10
    assert np.abs(result.jump("joint")).max() < 1e-10
    if degree == 2:
        joint = problem.interfaces["joint"]
        mine = np.einsum("pij,pi->pj", joint.frames, result.force("joint"))
        assert np.abs(mine - force).max() < 1e-7 * np.abs(force).max()


def test_elastic_is_the_monolithic_solution():
    law = Elastic(normal=3e6, tangential=1e6)
    problem, _, _ = compressed("tetrahedron", 0.3, law, 2, angle=0.4, slope=0.3)
    reference = monolithic(problem)
    result = solve(problem, method="accelerated", options=TIGHT)
    for name, u in reference.u.items():
        assert np.abs(result.displacements[name] - u).max() < 1e-10 * 0.1


def test_plan_keeps_a_perfect_interface_of_facets():
    problem, _, _ = compressed("quadrilateral", 0.3, Perfect(), 2)
    plan = make_plan(problem)
    assert plan.active == ("joint",)
    assert "its meshes do not match" in str(plan)
    with pytest.raises(SceneError, match="'direct' cannot be used: joint must stay active"):
        make_plan(problem, method="direct")
    with pytest.raises(SceneError, match="meshes that do not match"):
        reduce(problem, ["joint"])
    points, _, _ = compressed("quadrilateral", 0.3, Perfect(), 2, interface_space="points")
    with pytest.raises(SceneError, match="space='facets'"):
        make_plan(points)


def test_plan_glues_facets_that_match():
    problem, exact, _ = compressed("hexahedron", 0.3, Perfect(), 1, amount=0.0, second=FIRST)
    plan = make_plan(problem)
    assert plan.method == "direct"
    u = solve(problem).displacements["b"].reshape(-1, 3)
    assert np.abs(u - exact["b"](problem.substructures["b"].dof_coordinates)).max() < 1e-12


# ---------------------------------------------------------------------------------------------
# Convergence
# ---------------------------------------------------------------------------------------------
def energy_norm_error(interface_space, law_name, n, degree, finer="first"):
    """Relative error in energy of a smooth solution on two squares, meshes n : 3n/2 (triangles).

    u = (sin x cos y, cos x sin y / 2) with the body force that belongs to it; continuous across
    y = 1, the elastic interface has the imposed jump that makes it so.
    """
    E, nu, kappa = 1.0, 0.3, 2.0
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def exact(x):
        x0, y = 2 * x[:, 0], 2 * x[:, 1]
        return np.column_stack([np.sin(x0) * np.cos(y), 0.5 * np.cos(x0) * np.sin(y)])

    def closed_form(mesh):
        x = 2 * ufl.SpatialCoordinate(mesh)
        return ufl.as_vector(
            [ufl.sin(x[0]) * ufl.cos(x[1]), 0.5 * ufl.cos(x[0]) * ufl.sin(x[1])]
        )

    def stress(u):
        e = ufl.sym(ufl.grad(u))
        return lam * ufl.tr(e) * ufl.Identity(2) + 2 * mu * e

    def opening(x):  # -f_1 / kappa in the frame n = (0, 1), t = (-1, 0)
        x0, y = 2 * x[:, 0], 2 * x[:, 1]
        exx, eyy = 2 * np.cos(x0) * np.cos(y), np.cos(x0) * np.cos(y)
        exy = 0.5 * (-2 * np.sin(x0) * np.sin(y) - np.sin(x0) * np.sin(y))
        syy = lam * (exx + eyy) + 2 * mu * eyy
        return -np.column_stack([syy, -2 * mu * exy]) / kappa

    law = Perfect() if law_name == "perfect" else Elastic(kappa, kappa, jump=opening)
    counts = (3 * n // 2, n) if finer == "first" else (n, 3 * n // 2)
    scene = Scene()
    for name, y, count in (("a", 0.0, counts[0]), ("b", 1.0, counts[1])):
        part = block("triangle", [count, count], [0, y], [1, y + 1.0])
        force = -ufl.div(stress(closed_form(part.mesh)))
        material = LinearElastic(E, nu)
        scene.substructure(name, part, material, degree=degree, body_force=force)
    scene.interface("joint", "a:y1", "b:y0", law, space=interface_space)
    for face in ("a:x0", "a:x1", "a:y0", "b:x0", "b:x1", "b:y1"):
        scene.fix(face, value=exact)
    problem = assemble(scene)
    result = solve(problem, method="accelerated", active=["joint"], options=Options(rtol=1e-9))
    above = below = 0.0
    for name in "ab":
        u = result.displacement(name)
        w = closed_form(problem.substructures[name].part.mesh)
        dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 4})
        for v, which in ((u - w, 0), (w, 1)):
            energy = fem.assemble_scalar(fem.form(ufl.inner(stress(v), ufl.grad(v)) * dx))
            above, below = (above + energy, below) if which == 0 else (above, below + energy)
    return np.sqrt(above / below)


@pytest.mark.parametrize(
    ("interface_space", "law", "degree", "rate"),
    [
        ("facets", "elastic", 1, 0.95),
        ("facets", "perfect", 1, 0.95),
        ("facets", "elastic", 2, 1.9),
        ("facets", "perfect", 2, 1.9),
    ],
)
def test_convergence(interface_space, law, degree, rate):
    """Facets of the finer side do not spoil the order of the elements."""
    errors = [energy_norm_error(interface_space, law, n, degree) for n in (4, 8)]
    assert np.log2(errors[0] / errors[1]) > rate


def test_points_lose_the_order_where_facets_keep_it():
    """Quadrature points miss the kinks of side 2: the nodal forces have a relative error of order 1."""
    points, facets = (energy_norm_error(s, "elastic", 8, 2) for s in ("points", "facets"))
    assert points > 1.4 * facets


@pytest.mark.parametrize("space", ["points", "facets", "mortar"])
def test_perfect_on_matching_meshes_is_one_discretisation(space: str) -> None:
    """Kept or assembled, at any tolerance, its nodes are tied."""
    scene = Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        part = geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0), cell="quadrilateral")
        scene.substructure(name, part, LinearElastic(1e3, 0.2), degree=2)
    scene.fix("a:x0")
    scene.interface("tie", "a:x1", "b:x0", Perfect(), space=space)  # type: ignore[arg-type]
    scene.traction("b:x1", (0.0, 1.0))
    problem = assemble(scene)
    known = monolithic(problem).u["b"]
    for active in (None, "all"):
        result = solve(problem, active=active, options=Options(rtol=1e-10), progress=False)
        assert np.abs(result.displacements["b"] - known).max() < 1e-9 * np.abs(known).max()
