"""Contact at the end of a face: what turns on a corner presses there, not a third of a facet inside."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import mesh as dmesh
from scipy import sparse

import dolfinx_frontend as lf
from dolfinx_frontend.assembly import mortar

LENGTH, HEIGHT, YOUNG = 100.0, 4.0, 200e3


def bar(size: float, cell: str, faces: dict[str, tuple[float, float]]) -> lf.geometry.Part:
    """A bar along x whose lower side has faces between places."""
    dim = 3 if cell in ("tetrahedron", "hexahedron") else 2
    sizes = (LENGTH, HEIGHT) if dim == 2 else (LENGTH, HEIGHT, HEIGHT)
    box = lf.geometry.box(sizes, [max(1, round(side / size)) for side in sizes], cell=cell)
    mesh, names = box.mesh, dict(box.names)
    tags = np.array(box.facet_tags.values)
    middle = dmesh.compute_midpoints(mesh, dim - 1, box.facet_tags.indices)
    for name, (low, high) in faces.items():
        names[name] = max(names.values()) + 1
        inside = (tags == box.names["y0"]) & (middle[:, 0] > low) & (middle[:, 0] < high)
        tags[inside] = names[name]
    return lf.geometry.Part(mesh, dmesh.meshtags(mesh, dim - 1, box.facet_tags.indices, tags), names)


def flexibility(length: float, width: float = 1.0) -> float:
    """Of a cantilever (Timoshenko), without lateral contraction."""
    return (length**3 / (HEIGHT**3 / 4) + length / (5 / 12 * HEIGHT)) / (width * YOUNG)


@pytest.mark.parametrize(
    ("cell", "degree", "size"),
    [
        ("quadrilateral", 1, 0.625),
        ("quadrilateral", 2, 2.5),
        ("quadrilateral", 2, 1.25),
        ("triangle", 2, 2.5),
        ("hexahedron", 2, 2.5),
        ("tetrahedron", 2, 2.5),
    ],
)
def test_a_cantilever_on_the_corner_of_its_stop(cell: str, degree: int, size: float) -> None:
    scene = lf.Scene()
    stress = {"plane": "stress"} if cell in ("quadrilateral", "triangle") else {}
    bent = bar(size, cell, {"stop": (LENGTH - 2.5, LENGTH)})
    scene.substructure("bar", bent, lf.LinearElastic(YOUNG, 0.0, **stress), degree=degree)
    scene.fix("bar:x0")
    scene.traction("bar:x1", (0.0, -50.0 / HEIGHT, 0.0)[: 2 if stress else 3])
    scene.interface("stop", "bar:stop", lf.Contact(gap=0.5))
    found = -lf.solve(lf.assemble(scene), progress=False).table().value("normal", "stop")
    width = 1.0 if stress else HEIGHT
    right = 50.0 * width - 0.5 / flexibility(LENGTH, width)
    assert found == pytest.approx(right, rel=1e-3)


def patch(shape: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m, d) and facets of a square, or a line, that a warp has made uneven."""
    line = np.arange(count + 1.0) + 0.2 * np.sin(3.0 * np.arange(count + 1.0))
    if shape == "line":
        cells = [[k, k + 1] for k in range(count)]
        return np.column_stack([line, np.zeros_like(line)]), np.array(cells)
    first, second = np.meshgrid(line, line + 0.1, indexing="ij")
    x = np.column_stack([first.ravel(), (second + 0.1 * np.sin(first)).ravel(), np.zeros(first.size)])
    corner = [i * (count + 1) + j for i in range(count) for j in range(count)]
    if shape == "quadrilaterals":
        return x, np.array([[c, c + 1, c + count + 1, c + count + 2] for c in corner])
    halves = [(0, count + 1, count + 2), (0, count + 2, 1)]
    return x, np.array([[c + k for k in half] for c in corner for half in halves])


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("shape", ["line", "triangles", "quadrilaterals"])
def test_forces_at_the_end_act_at_its_vertices(shape: str, count: int) -> None:
    """Moments of the multipliers about their vertices vanish, their sum is 1, their weights are positive."""
    x, corners = patch(shape, count)
    m, d = x.shape
    mass = np.array([linear_mass(x[facet]) for facet in corners])
    normals, tied = np.tile(np.eye(d)[-1], (m, 1)), np.zeros((m, d, d))
    rim = mortar._rim(corners)
    assert rim.sum() == (2 if shape == "line" else 4 * count)
    change = mortar._at_rim(corners, mass, x, normals, rim, tied).toarray()
    total = np.zeros((m, m))
    for facet, each in zip(corners, mass, strict=True):
        total[np.ix_(facet, facet)] += each
    weights = change @ total.sum(axis=1)
    moments = change @ total @ x - weights[:, None] * x
    assert change.sum(axis=0) == pytest.approx(np.ones(m), abs=1e-14)
    assert moments[rim] == pytest.approx(0.0, abs=1e-13)
    assert weights.min() > 0.4 * total.sum(axis=1).min()
    # nothing ends on a plane of symmetry
    across = np.zeros((m, d, d))
    across[:, 0, 0] = 1.0
    ends = mortar._at_rim(corners, mass, x, normals, rim, across)
    assert shape != "line" or (ends - sparse.identity(m)).nnz == 0


def linear_mass(x: np.ndarray) -> np.ndarray:
    """Integrals of the products of the linear functions of a facet."""
    if len(x) == 2:
        return np.linalg.norm(x[1] - x[0]) / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    if len(x) == 3:
        return np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0])) / 24.0 * (np.ones((3, 3)) + np.eye(3))
    out = np.zeros((4, 4))
    for s in 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]):
        for r in 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]):
            shape = np.array([(1 - s) * (1 - r), s * (1 - r), (1 - s) * r, s * r])
            along = np.array([r - 1, 1 - r, -r, r]) @ x, np.array([s - 1, -s, 1 - s, s]) @ x
            weight = (5.0 if s != 0.5 else 8.0) * (5.0 if r != 0.5 else 8.0) / 324.0
            out += weight * np.linalg.norm(np.cross(*along)) * np.outer(shape, shape)
    return out
