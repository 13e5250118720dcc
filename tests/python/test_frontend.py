"""Frontend: traces, pairing, assembly, elimination and the monolithic oracle."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
import scipy.sparse as sp
from dolfinx import fem

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import frames
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.assembly.rigid import check_rigid_bodies
from dolfinx_frontend.assembly.values import jumps, stiffnesses
from dolfinx_frontend.plan.reduction import body_load, body_matrix, displacements, reduce
from dolfinx_frontend.reference.cholesky import Cholesky, solvers
from dolfinx_frontend.reference.direct import Monolithic, monolithic
from dolfinx_frontend.reference.energy import energy_error
from dolfinx_frontend.scene.laws import Displacement, Elastic, Perfect, Pressure, Symmetry
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from parts.rings import annulus, two_rings
from parts.unit import measure_unit
from tests.python.helpers import DIMENSION, block, face_mass, lame, polynomial, wavy

EPS = np.finfo(float).eps
CELLS = list(DIMENSION)
STEEL = LinearElastic(2e5, 0.3)


def space(part, degree):
    return fem.functionspace(part.mesh, ("Lagrange", degree, (part.mesh.geometry.dim,)))


def nodes(V, d):
    return V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local, :d]


def stacked(cell, first, second, amount=0.08):
    """Two blocks on top of each other along the last axis, wavy within their common plane."""
    d = DIMENSION[cell]
    axis = d - 1
    low, high = np.zeros(d), np.ones(d)
    low[axis], high[axis] = 1.0, 2.0
    lower = block(cell, first, mapping=wavy(amount, axis), seed=1)
    upper = block(cell, second, low, high, mapping=wavy(-amount, axis), seed=2)
    end = "xyz"[axis]
    return lower, upper, f"{end}1", f"{end}0"


# ---------------------------------------------------------------------------------------------
# Traces and pairing
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", CELLS)
def test_traces_reproduce_polynomials(cell, degree):
    """Both traces are exact for every polynomial of the element's degree, matching or not."""
    d = DIMENSION[cell]
    lower, upper, top, bottom = stacked(cell, [3, 2, 2][:d], [2, 3, 2][:d])
    V = space(lower, degree), space(upper, degree)
    i = make_interface("i", Perfect(), (lower, upper), (("a", top), ("b", bottom)), V)
    for side, W in zip(i.sides, V, strict=True):
        u = polynomial(degree, nodes(W, d))
        w = (csr(side.trace) @ u.ravel()).reshape(-1, d)
        exact = polynomial(degree, i.points)
        assert np.abs(w - exact).max() < 1e3 * EPS * np.abs(u).max()
    assert i.matching is None
    assert i.weights.min() > 0.0
    assert i.area == pytest.approx(1.0, abs=1e-13)
    assert i.sides[1].area == pytest.approx(1.0, abs=1e-13)
    assert np.abs(i.gap).max() < 1e-13
    assert np.abs(i.normals - np.eye(d)[d - 1]).max() < 1e-13


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_matching_meshes_give_the_same_columns(cell, degree):
    """Renumbered copies of a mesh are recognised; at degree 3 this exercises permuted edge dofs."""
    n, low, high = [2, 3, 2], [0, 0, 1], [1, 1, 2]
    lower = block(cell, n, mapping=wavy(0.08, 2), seed=5)
    upper = block(cell, n, low, high, mapping=wavy(0.08, 2), seed=6)
    if cell == "tetrahedron":  # the diagonals of the top and the bottom of a box agree
        assert len(lower.facet_tags.find(lower.names["z1"])) == 2 * 6
    V = space(lower, degree), space(upper, degree)
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V)
    assert i.matching is not None
    assert len(i.matching) == (2 * degree + 1) * (3 * degree + 1)
    x = nodes(V[0], 3)[i.matching[:, 0]], nodes(V[1], 3)[i.matching[:, 1]]
    assert np.abs(x[0] - x[1]).max() < 1e-13


@pytest.mark.parametrize("cell", CELLS)
def test_renumbering_changes_nothing(cell):
    """Degree 3 on curved cells: traces do not know the numbering."""
    d = DIMENSION[cell]

    def bend(x):
        out = x.copy()
        out[:, 0] += 0.1 * x[:, 1] ** 2
        return out

    values = []
    for seed in (None, 8):
        part = block(cell, [2] * d, mapping=bend, order=2, seed=seed)
        V = space(part, 3)
        i = make_interface("i", Symmetry(), (part,), (("a", "x1"),), (V,))
        u = np.sin(nodes(V, d) @ np.arange(1.0, d + 1.0))
        w = i.sides[0].shape @ u
        order = np.lexsort(np.round(i.points, 9).T)
        values.append((i.points[order], w[order], i.weights[order]))
    for first, second in zip(*values, strict=True):
        assert np.abs(first - second).max() < 1e-12


@pytest.mark.parametrize(("order", "slope"), [(1, 2), (2, 4)])
def test_arc_length_and_normals(order, slope):
    """Weights of curved facets add up to the area, at the rate of the geometry."""
    errors = []
    for n in (4, 8, 16):
        part = annulus(1.0, 2.0, divisions=(1, n), geometry_order=order)
        i = make_interface("i", Pressure(1.0), (part,), (("a", "inner"),), (space(part, 2),))
        errors.append(abs(i.area - np.pi / 2))
        radial = -i.points / np.linalg.norm(i.points, axis=1)[:, None]
        assert np.einsum("pi,pi->p", radial, i.normals).min() > 1 - (1.0 / n) ** 2
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(slope, abs=0.1)


def test_frames_are_smooth_and_orthonormal():
    angle = np.linspace(0, 2 * np.pi, 50)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    F, axis = frames(ring)
    assert axis == 2
    assert np.abs(F @ np.swapaxes(F, 1, 2) - np.eye(3)).max() < 1e-15
    assert np.allclose(np.linalg.det(F), 1.0)
    assert np.abs(F[:, 1] - [0, 0, 1]).max() < 1e-15
    plane, axis = frames(np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert np.array_equal(plane[0], [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def test_gap_is_signed_along_the_normal():
    lower = block("hexahedron", [2, 2, 1])
    upper = block("hexahedron", [3, 3, 1], [0, 0, 1.03], [1, 1, 2])
    V = space(lower, 1), space(upper, 1)
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V)
    assert i.gap == pytest.approx(np.full(i.num_points, 0.03))


def test_curved_faces_that_do_not_match_are_paired():
    """Cylinder sectors of different meshes: gaps and traces differ by the sagitta."""
    rings = two_rings(1.0, 2.0, 3.0, divisions=(2, 6), outer_divisions=(2, 10))
    V = tuple(space(p, 2) for p in rings.parts.values())
    i = make_interface(
        "i", Perfect(), tuple(rings.parts.values()), (("inner", "outer"), ("outer", "inner")), V
    )
    sagitta = 2.0 * (np.pi / 12) ** 4  # more than a parabola over one facet leaves the arc
    assert np.abs(i.gap).max() < sagitta
    w = [side.shape @ nodes(W, 2)[:, 0] for side, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - w[1]).max() < sagitta


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_curved_faces_in_three_dimensions(cell):
    """A quarter of a cylinder on meshes that do not match, up to the sagitta."""

    def bend(x):
        r, angle = 1.0 + x[:, 0], 0.5 * np.pi * x[:, 1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), x[:, 2]], axis=1)

    inner = block(cell, [1, 6, 3], mapping=bend, order=2, seed=1)
    outer = block(cell, [1, 9, 2], [1, 0, 0], [2, 1, 1], bend, order=2, seed=2)
    V = space(inner, 2), space(outer, 2)
    i = make_interface("i", Perfect(), (inner, outer), (("a", "x1"), ("b", "x0")), V)
    sagitta = 2.0 * (np.pi / 12) ** 4
    assert i.area == pytest.approx(np.pi, rel=sagitta)
    assert np.abs(i.gap).max() < sagitta
    w = [side.shape @ nodes(W, 3) for side, W in zip(i.sides, V, strict=True)]
    assert np.abs(w[0] - i.points).max() < 1e-13
    assert np.abs(w[1] - i.points).max() < sagitta
    assert np.abs(np.linalg.norm(i.normals[:, :2], axis=1) - 1.0).max() < 1e-12
    assert i.tangent_axis == 2


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("ratio", [1e-4, 1.0, 1e4])
def test_thin_facets(cell, ratio):
    """Facets with an aspect ratio of 1e4 and more find their partners."""
    size = np.array([ratio, 1.0, 1.0])
    lower = geometry.box(size, (2, 3, 1), cell=cell)
    upper = geometry.box(size, (3, 50, 1), (0, 0, 1.0), cell=cell)
    V = space(lower, 2), space(upper, 2)
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V)
    for side, W in zip(i.sides, V, strict=True):
        w = side.shape @ polynomial(2, nodes(W, 3) / size)
        assert np.abs(w - polynomial(2, i.points / size)).max() < 1e-12


def test_pairing_ten_thousand_points_takes_seconds():
    lower = geometry.box((1, 1, 0.1), (26, 26, 1), cell="tetrahedron")
    upper = geometry.box((1, 1, 0.1), (31, 31, 1), (0, 0, 0.1), cell="tetrahedron")
    V = space(lower, 2), space(upper, 2)
    begin = perf_counter()
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V)
    assert i.num_points > 8000
    assert perf_counter() - begin < 10.0  # 0.6 s on one idle core


# ---------------------------------------------------------------------------------------------
# Assembly
# ---------------------------------------------------------------------------------------------
def test_elastic_coupling_is_the_boundary_mass():
    """T^T W T equals the boundary mass matrix that UFL assembles."""
    for cell, end in (("tetrahedron", "z1"), ("quadrilateral", "y1")):
        d = DIMENSION[cell]
        part = block(cell, [2] * d, seed=4)
        V = space(part, 2)
        i = make_interface("i", Symmetry(), (part,), (("a", end),), (V,))
        T = csr(i.sides[0].trace)
        mass = (T.T @ sp.diags(np.repeat(i.weights, d)) @ T).toarray()
        exact = face_mass(V, part, end, 4)
        assert np.abs(mass - exact).max() < 1e2 * EPS * np.abs(exact).max()


def test_local_trace_rotates_into_the_frames():
    part = annulus(1.0, 2.0, divisions=(1, 4))
    V = space(part, 2)
    i = make_interface("i", Symmetry(), (part,), (("a", "outer"),), (V,))
    u = nodes(V, 2).ravel()  # u = x
    local = (i.local_trace(0) @ u).reshape(-1, 2)
    w = (csr(i.sides[0].trace) @ u).reshape(-1, 2)
    assert local == pytest.approx(np.einsum("pij,pj->pi", i.frames, w), abs=1e-14)


def test_substructure_quantities():
    """Volume, length, modulus, rigid modes: K R = 0 and body forces add up."""
    scene = Scene()
    part = geometry.box((2.0, 1.0, 0.5), (2, 2, 1), cell="tetrahedron")
    scene.substructure("a", part, STEEL, degree=2, body_force=(0.0, 0.0, -3.0))
    scene.fix("a:x0")
    lines = []
    problem = assemble(scene, lines.append)
    s = problem.substructures["a"]
    assert s.volume == pytest.approx(1.0, rel=1e-13)
    assert s.length == pytest.approx(1.0, rel=1e-13)
    assert s.modulus == pytest.approx(2e5, rel=1e-12)  # the estimate is exact at nu = 0.3
    assert s.rigid_modes.shape == (s.size, 6)
    assert np.abs(s.matrix @ s.rigid_modes).max() < 1e2 * EPS * np.abs(s.matrix.data).max()
    assert s.load.reshape(-1, 3).sum(axis=0) == pytest.approx([0, 0, -3.0], abs=1e-13)
    assert lines == ["substructure a", "interface displacement(a:x0)"]
    assert "displacement(a:x0)" in repr(problem) and "a" in repr(scene)
    assert problem.law_parameters == {"displacement(a:x0).value": 0.0}
    assert problem.interface_points["displacement(a:x0)"].shape[1] == 3


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999])
def test_modulus_does_not_know_incompressibility(nu):
    scene = Scene()
    scene.substructure("a", geometry.box((1.0, 1.0), (2, 2)), LinearElastic(7.0, nu))
    scene.fix("a:x0")
    modulus = assemble(scene).substructures["a"].modulus
    assert modulus == pytest.approx(7.0 * 1.3 / (1 + nu), rel=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
def test_orthotropic_reduces_to_isotropic(dim):
    """With isotropic constants, orthotropic material is isotropic in any axes."""
    E, nu = 3.0, 0.25
    G = E / (2 * (1 + nu))
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((dim, dim)))[0]
    part = block(("quadrilateral", "hexahedron")[dim - 2], [2] * dim)
    for plane in ("strain", "stress") if dim == 2 else ("strain",):
        K = []
        for material in (
            LinearElastic(E, nu, plane),
            OrthotropicElastic((E,) * 3, (nu,) * 3, (G,) * 3, axes, plane),
        ):
            scene = Scene()
            scene.substructure("a", part, material, degree=1)
            scene.fix("a:x0")
            K.append(assemble(scene).substructures["a"].matrix.toarray())
        assert np.abs(K[0] - K[1]).max() < 1e2 * EPS * np.abs(K[0]).max()


def test_orthotropic_energy_of_uniform_strains():
    """Energy of a uniform stress along a turned material axis is stress^2 volume / (2 E1)."""
    E, nu, G = (10.0, 4.0, 2.0), (0.3, 0.2, 0.1), (1.5, 1.2, 0.7)
    axes = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    part = block("hexahedron", [1, 1, 1])
    scene = Scene()
    scene.substructure("a", part, OrthotropicElastic(E, nu, G, axes), degree=1)
    scene.fix("a:x0")
    s = assemble(scene).substructures["a"]
    for local, energy in (
        (np.diag([1 / E[0], -nu[0] / E[0], -nu[1] / E[0]]), 1 / E[0]),
        (np.diag([-nu[1] / E[0], -nu[2] / E[1], 1 / E[2]]), 1 / E[2]),
        (np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]) / (2 * G[0]), 1 / G[0]),
        (np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0]]) / (2 * G[2]), 1 / G[2]),
    ):
        u = (s.dof_coordinates @ (axes.T @ local @ axes).T).ravel()
        assert u @ (s.matrix @ u) == pytest.approx(energy, rel=1e-12)


# ---------------------------------------------------------------------------------------------
# Elimination
# ---------------------------------------------------------------------------------------------
def small_assembly(**laws):
    """Two glued plates: fixed side, oblique symmetry, prescribed end."""
    scene = Scene()
    c, s = np.cos(0.3), np.sin(0.3)

    def turned(x):
        return x @ np.array([[c, s], [-s, c]])

    lower = block("quadrilateral", [2, 2], mapping=turned)
    upper = block("quadrilateral", [2, 1], (0, 1), (1, 2), mapping=turned, seed=3)
    scene.substructure("a", lower, LinearElastic(1.0, 0.3), degree=2, body_force=(0.1, 0.2))
    scene.substructure("b", upper, LinearElastic(3.0, 0.2), degree=2)
    scene.interface("glue", "a:y1", "b:y0", laws.get("glue", Perfect()))
    scene.symmetry("a:x0", "oblique")
    scene.interface("end", "b:y1", Displacement(lambda x: 0.1 + 0.2 * x))
    scene.interface("spring", "a:y0", Elastic(normal=2.0, tangential=1.0, jump=(0.1, 0.0)))
    return assemble(scene)


def test_elimination_equals_lagrange_multipliers():
    """Z and u0 against a dense saddle-point system with all constraints at the nodes."""
    problem = small_assembly()
    (body,) = reduce(problem, problem.interfaces)
    q = Cholesky(body_matrix(problem, body)).solve(body_load(problem, body))
    u = displacements(body, q)

    a, b = (problem.substructures[n] for n in "ab")
    n = a.size + b.size
    K = sp.block_diag([a.matrix, b.matrix]).toarray()
    F = np.concatenate([a.load, b.load])
    spring = problem.interfaces["spring"]
    T = spring.local_trace(0)
    k = np.repeat(spring.weights, 2) * stiffnesses(spring, spring.law).ravel()
    K[: a.size, : a.size] += (T.T @ sp.diags(k) @ T).toarray()
    F[: a.size] -= T.T @ (k * jumps(spring, spring.law).ravel())
    rows, values = [], []

    def constrain(entries, value):
        row = np.zeros(n)
        for at, c in entries:
            row[at] += c
        rows.append(row)
        values.append(value)

    for i, j in problem.interfaces["glue"].matching:
        for c in range(2):
            constrain([(2 * i + c, 1.0), (a.size + 2 * j + c, -1.0)], 0.0)
    normal = problem.interfaces["oblique"].normals[0]
    for i in problem.interfaces["oblique"].sides[0].nodes:
        constrain([(2 * i, normal[0]), (2 * i + 1, normal[1])], 0.0)
    for i in problem.interfaces["end"].sides[0].nodes:
        for c in range(2):
            constrain([(a.size + 2 * i + c, 1.0)], 0.1 + 0.2 * b.dof_coordinates[i, c])
    C = np.array(rows)
    m = len(C)
    saddle = np.block([[K, C.T], [C, np.zeros((m, m))]])
    exact = np.linalg.solve(saddle, np.concatenate([F, values]))[:n]
    got = np.concatenate([u["a"], u["b"]])
    assert np.abs(got - exact).max() < 1e2 * EPS * np.linalg.cond(saddle)
    assert np.abs(C @ got - values).max() < 1e-14
    assert body.n == n - np.linalg.matrix_rank(C)
    Z = sp.vstack([body.Z["a"], body.Z["b"]])
    assert np.abs(C @ Z).max() < 1e-15


def test_active_interfaces_leave_bodies_apart():
    problem = small_assembly()
    bodies = reduce(problem, {"oblique", "end"})
    assert [b.members for b in bodies] == [("a",), ("b",)]
    assert all(b.springs == () for b in bodies)
    assert bodies[1].offset["b"].any()
    (both,) = reduce(problem, {"glue", "spring"})
    assert both.members == ("a", "b") and both.springs == ("spring",)


def test_axis_aligned_constraints_keep_selections():
    """Three symmetry planes at a corner: Z stays a selection matrix."""
    scene = Scene()
    scene.substructure("a", block("hexahedron", [1, 1, 1]), STEEL, degree=1)
    scene.symmetry(["a:x0", "a:y0", "a:z0"])
    (body,) = reduce(problem := assemble(scene), set(problem.interfaces))
    Z = body.Z["a"]
    assert body.n == 24 - 3 * 4
    assert np.array_equal(np.unique(Z.data), [1.0]) and Z.nnz == body.n


def test_prescribed_jump_of_a_perfect_interface():
    """A wedge of thickness 0.1 between two bars that are held at their ends."""
    scene = Scene()
    for k, name in enumerate(("a", "b")):
        part = geometry.box((1.0, 1.0), (2, 2), (k, 0.0))
        scene.substructure(name, part, LinearElastic(1.0, 0.0), degree=1)
    scene.interface("wedge", "a:x1", "b:x0", Perfect(jump=0.1))
    scene.fix(["a:x0", "b:x1"])
    solution = monolithic(assemble(scene))
    w1, w2 = solution.traces["wedge"]
    assert w2 - w1 == pytest.approx(np.tile([0.1, 0.0], (len(w1), 1)), abs=1e-14)
    assert w1[:, 0] == pytest.approx(-0.05)
    assert solution.energy == pytest.approx(0.05**2, rel=1e-12)


def test_jumps_add_up_through_a_ring_of_parts():
    """Four plates meet at one point; the jumps of the four joints around it have to agree."""
    def plates(last):
        scene = Scene()
        for name, corner in (("a", (0, 0)), ("b", (1, 0)), ("c", (1, 1)), ("d", (0, 1))):
            scene.substructure(name, geometry.box((1.0, 1.0), (1, 1), corner), STEEL, degree=1)
        scene.interface("ab", "a:x1", "b:x0", Perfect(jump=0.1))
        scene.interface("bc", "b:y1", "c:y0", Perfect())
        scene.interface("dc", "d:x1", "c:x0", Perfect(jump=last))
        scene.interface("ad", "a:y1", "d:y0", Perfect())
        scene.fix("a:x0")
        return assemble(scene)

    solution = monolithic(plates(0.1))
    for name in ("b", "c"):
        assert solution.u[name].reshape(-1, 2)[:, 0] == pytest.approx(0.1, abs=1e-13)
    with pytest.raises(ValueError, match="contradicts"):
        monolithic(plates(0.2))


# ---------------------------------------------------------------------------------------------
# Monolithic solutions against closed forms
# ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_patch(cell):
    """Uniform tension passes through a glued interface of distorted meshes."""
    n = [2, 2, 2]
    scene = Scene()
    lower = block(cell, n, mapping=wavy(0.08, 2), seed=5)
    upper = block(cell, n, [0, 0, 1], [1, 1, 2], mapping=wavy(0.08, 2), seed=6)
    for name, part in (("a", lower), ("b", upper)):
        scene.substructure(name, part, STEEL, degree=2)
    scene.interface("glue", "a:z1", "b:z0", Perfect())
    scene.symmetry(["a:x0", "a:y0", "a:z0", "b:x0", "b:y0"])
    scene.traction("b:z1", (0.0, 0.0, 10.0))
    problem = assemble(scene)
    solution = monolithic(problem)
    for name, u in solution.u.items():
        x = problem.substructures[name].dof_coordinates
        exact = 10.0 / 2e5 * x * np.array([-0.3, -0.3, 1.0])
        assert np.abs(u.reshape(-1, 3) - exact).max() < 1e-10 * np.abs(exact).max()


def ring(n, nu=0.3):
    scene = Scene()
    part = annulus(100.0, 200.0, divisions=(n, 2 * n))
    scene.substructure("ring", part, LinearElastic(2e5, nu), degree=2)
    scene.symmetry(["ring:theta0", "ring:theta1"])
    scene.pressure("ring:inner", 1.6, "bore")
    return assemble(scene)


def test_lame_ring_converges():
    """u(a), u(b) of TARGETS and the rate of the energy, twice the degree."""
    exact_a, exact_b = (lame(r, 100, 200, 1.6, 0, 2e5, 0.3) for r in (100.0, 200.0))
    assert exact_a == pytest.approx(1.525333e-3, abs=5e-10)
    assert exact_b == pytest.approx(9.706667e-4, abs=5e-11)
    energy = 0.5 * 1.6 * exact_a * np.pi / 2 * 100
    errors = []
    for n in (2, 4, 8):
        problem = ring(n)
        solution = monolithic(problem)
        errors.append(abs(solution.energy - energy) / energy)
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(4.0, abs=0.1)
    s = problem.substructures["ring"]
    r = np.linalg.norm(s.dof_coordinates, axis=1)
    radial = np.einsum("ni,ni->n", solution.u["ring"].reshape(-1, 2), s.dof_coordinates) / r
    assert radial == pytest.approx(lame(r, 100, 200, 1.6, 0, 2e5, 0.3), rel=2 * errors[-1] ** 0.5)
    assert radial[r < 100.001] == pytest.approx(exact_a, rel=10 * errors[-1])


def test_oblique_symmetry():
    """A sector of 22.5 degrees behaves like the whole ring, and w . n = 0 on its oblique side."""
    scene = Scene()
    part = annulus(100.0, 200.0, np.pi / 8, (4, 2))
    scene.substructure("ring", part, STEEL, degree=2)
    scene.symmetry(["ring:theta0", "ring:theta1"])
    scene.pressure("ring:inner", 1.6)
    problem = assemble(scene)
    solution = monolithic(problem)
    u = solution.u["ring"].reshape(-1, 2)
    for name in ("symmetry(ring:theta0)", "symmetry(ring:theta1)"):
        assert np.abs(solution.traces[name][0][:, 0]).max() < 10 * EPS * np.abs(u).max()
    x = problem.substructures["ring"].dof_coordinates
    inside = np.linalg.norm(x, axis=1) < 100.001
    exact = lame(100.0, 100, 200, 1.6, 0, 2e5, 0.3)
    assert np.linalg.norm(u[inside], axis=1) == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("outer", [None, (8, 24)])
def test_split_lame_ring(outer):
    """Jump p_c / k across an elastic joint at r = c, on meshes that match and that do not."""
    a, c, b, p, k, E, nu = 100.0, 150.0, 200.0, 1.6, 2e3, 2e5, 0.3
    rings = two_rings(a, c, b, divisions=(8, 16), outer_divisions=outer)
    scene = Scene()
    for name, part in rings.parts.items():
        scene.substructure(name, part, LinearElastic(E, nu), degree=2)
    # across facets that do not match the integrand has kinks: a finer rule
    degree = None if outer is None else 12
    law = Elastic(normal=k)
    scene.interface("joint", "inner:outer", "outer:inner", law, quadrature_degree=degree)
    scene.pressure("inner:inner", p)
    scene.symmetry([f"{part}:{face}" for part in rings.parts for face in ("theta0", "theta1")])
    problem = assemble(scene)
    solver = Monolithic(problem)
    for stiffness in (k, 10 * k):
        solution = solver.solve(values={"joint.normal": stiffness})
        compliance = lame(c, c, b, 1, 0, E, nu) - lame(c, a, c, 0, 1, E, nu) + 1 / stiffness
        contact = lame(c, a, c, p, 0, E, nu) / compliance
        force = solution.forces["joint"]
        assert np.abs(force[:, 0] + contact).max() < 2e-3 * contact
        i = problem.interfaces["joint"]
        assert i.weights @ -force[:, 0] / i.area == pytest.approx(contact, rel=2e-5)
        w1, w2 = solution.traces["joint"]
        jump = i.weights @ (w2 - w1)[:, 0] / i.area
        assert jump == pytest.approx(-contact / stiffness, rel=2e-5)
        assert np.array_equal(force[:, 1], np.zeros(i.num_points))


def test_bolted_pair_of_springs():
    """Joint force k (K D - Q) / (K + k), bolt tension N + Q, whatever the blocks are made of."""
    K, k, D, Q = 50.0, 400.0, 0.2, 6.0
    scene = Scene()
    for level, name in enumerate(("base", "cover")):
        part = geometry.box((2.0, 3.0, 1.0), (2, 2, 1), (0, 0, level))
        scene.substructure(name, part, LinearElastic(30.0, 0.0), degree=1)
    scene.fix("base:z0")
    scene.symmetry(["cover:x0", "cover:y0"])
    scene.interface("joint", "base:z1", "cover:z0", Elastic(normal=k, total=True))
    scene.interface("bolt", "base:z1", "cover:z0", Elastic(normal=K, jump=-D, total=True))
    scene.traction("cover:z1", (0.0, 0.0, Q / 6.0))
    problem = assemble(scene)
    for pull in (Q, 9.0):
        solution = monolithic(problem, values={"traction(cover:z1).t": (0.0, 0.0, pull / 6.0)})
        area = problem.interfaces["joint"].weights
        joint, bolt = (area @ solution.forces[n][:, 0] for n in ("joint", "bolt"))
        N = k * (K * D - pull) / (K + k)
        assert -joint == pytest.approx(N, rel=1e-12)
        assert bolt == pytest.approx(N + pull, rel=1e-12)


def test_energy_error():
    problem = small_assembly(glue=Elastic(normal=5.0, tangential=5.0))
    reference = monolithic(problem)
    assert energy_error(problem, reference.u, reference) == 0.0
    error = {n: 1e-3 * u for n, u in reference.u.items()}
    u = {n: reference.u[n] + e for n, e in error.items()}
    parts = sum(e @ (problem.substructures[n].matrix @ e) for n, e in error.items())
    whole = sum(w @ (problem.substructures[n].matrix @ w) for n, w in reference.u.items())
    assert energy_error(problem, u, reference, springs=False) == pytest.approx(
        np.sqrt(parts / whole), rel=1e-9
    )
    assert energy_error(problem, u, reference) > 0.0


def test_solvers_agree_and_the_unit_is_measured():
    problem = ring(3)
    u = [monolithic(problem, solver=s).u["ring"] for s in solvers()]
    for other in u[1:]:
        assert np.abs(other - u[0]).max() < 1e-11 * np.abs(u[0]).max()
    measured = measure_unit(problem)
    (body,) = reduce(problem, problem.interfaces)
    assert measured.dof == body.n and measured.seconds > 0 and measured.solver in solvers()


def test_laws_are_overridden():
    problem = ring(2)
    once = monolithic(problem)
    twice = monolithic(problem, values={"bore.p": 3.2})
    varying = monolithic(problem, laws={"bore": Pressure(lambda x: 1.6 + 0.0 * x[:, 0])})
    assert twice.u["ring"] == pytest.approx(2 * once.u["ring"], rel=1e-10, abs=1e-15)
    assert varying.u["ring"] == pytest.approx(once.u["ring"], rel=1e-12, abs=1e-16)
    law = Elastic(normal=1.0)
    assert law.with_(normal=2.0) == replace(law, normal=2.0)
    assert law.parameters() == {"normal": 1.0, "jump": 0.0}


def test_units_do_not_matter():
    """Pairing, elimination and rigid-body checks are the same in any unit of length and force."""
    shortening = []
    for length, stress in ((1.0, 1.0), (1e-3, 1e6), (1e6, 1e-9), (1e-9, 1.0)):
        scene = Scene()
        for k, name in enumerate(("a", "b")):
            part = geometry.box((length,) * 3, (2, 2, 1), (0, 0, k * length))
            scene.substructure(name, part, LinearElastic(2e5 * stress, 0.3), degree=1)
        scene.interface("joint", "a:z1", "b:z0", Elastic(normal=1e5 * stress / length))
        scene.fix("a:z0")
        scene.symmetry(["b:x0", "b:y0"])
        scene.pressure("b:z1", 10.0 * stress)
        solution = monolithic(assemble(scene))
        shortening.append(solution.u["b"].reshape(-1, 3)[:, 2].min() / length)
    assert shortening == pytest.approx([shortening[0]] * 4, rel=1e-9)


# ---------------------------------------------------------------------------------------------
# Rigid bodies
# ---------------------------------------------------------------------------------------------
def chain(n, d=3):
    """Synthetic parts in a row with the points of their common faces."""
    parts = {f"p{k}": (np.eye(d)[0] * (k + 0.5), 1.0) for k in range(n)}
    grid = np.array([[0.0, y, z] for y in (0.1, 0.5, 0.9) for z in (0.1, 0.5, 0.9)])
    return parts, grid


@pytest.mark.parametrize("directions", [3, 1])
def test_a_thousand_parts(directions):
    """Glued parts merge; frictionless ones leave 6 unknowns a part for the sparse null space."""
    parts, grid = chain(1000)
    rows = np.tile(np.eye(3)[:directions], (9, 1, 1))
    weights = np.full(9, 1 / 9)
    links = {
        f"i{k}": ((f"p{k - 1}", f"p{k}"), grid + [k, 0, 0], weights, rows) for k in range(1, 1000)
    }
    links["end"] = (("p0",), grid, weights, np.tile(np.eye(3), (9, 1, 1)))
    begin = perf_counter()
    if directions == 3:
        check_rigid_bodies(parts, links)
    else:
        with pytest.raises(ValueError, match="translation along y"):
            check_rigid_bodies(parts, links)
    assert perf_counter() - begin < 20.0
