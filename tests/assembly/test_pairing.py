"""Traces of the two sides of an interface, and their pairing."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest
import scipy.sparse as sp
from dolfinx import fem

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.interface import frames
from dolfinx_frontend.assembly.pairing import make_interface
from dolfinx_frontend.scene.laws import Perfect, Pressure, Symmetry
from parts.rings import annulus, two_rings
from tests.helpers import DIMENSION, block, face_mass, polynomial, wavy

EPS = np.finfo(float).eps
CELLS = list(DIMENSION)


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


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", CELLS)
def test_traces_reproduce_polynomials(cell, degree):
    """Both traces are exact for every polynomial of the element's degree, matching or not."""
    d = DIMENSION[cell]
    lower, upper, top, bottom = stacked(cell, [3, 2, 2][:d], [2, 3, 2][:d])
    V = space(lower, degree), space(upper, degree)
    i = make_interface("i", Perfect(), (lower, upper), (("a", top), ("b", bottom)), V, space="points")
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
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V, space="points")
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
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V, space="points")
    assert i.gap == pytest.approx(np.full(i.num_points, 0.03))


def test_curved_faces_that_do_not_match_are_paired():
    """Cylinder sectors of different meshes: gaps and traces differ by the sagitta."""
    rings = two_rings(1.0, 2.0, 3.0, divisions=(2, 6), outer_divisions=(2, 10))
    V = tuple(space(p, 2) for p in rings.parts.values())
    i = make_interface(
        "i",
        Perfect(),
        tuple(rings.parts.values()),
        (("inner", "outer"), ("outer", "inner")),
        V,
        space="points",
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
    i = make_interface("i", Perfect(), (inner, outer), (("a", "x1"), ("b", "x0")), V, space="points")
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
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V, space="points")
    for side, W in zip(i.sides, V, strict=True):
        w = side.shape @ polynomial(2, nodes(W, 3) / size)
        assert np.abs(w - polynomial(2, i.points / size)).max() < 1e-12


def test_pairing_ten_thousand_points_takes_seconds():
    lower = geometry.box((1, 1, 0.1), (26, 26, 1), cell="tetrahedron")
    upper = geometry.box((1, 1, 0.1), (31, 31, 1), (0, 0, 0.1), cell="tetrahedron")
    V = space(lower, 2), space(upper, 2)
    begin = perf_counter()
    i = make_interface("i", Perfect(), (lower, upper), (("a", "z1"), ("b", "z0")), V, space="points")
    assert i.num_points > 8000
    assert perf_counter() - begin < 10.0  # 0.6 s on one idle core


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
