"""Parts that are given as a matrix: the answer is that of the part which was condensed."""

import numpy as np
import pytest
from scipy.sparse.linalg import splu

import dolfinx_frontend as lf

STEEL = lf.LinearElastic(E=200e3, nu=0.3)
TIGHT = lf.Options(rtol=1e-11)


def block(z=0.0, cells=(2, 2, 2), cell="hexahedron"):
    return lf.geometry.box((30.0, 20.0, 20.0), cells, origin=(0.0, 0.0, z), cell=cell)


def condensed(part, kept, material=STEEL, degree=1, body_force=None):
    """K, points, force of a body force on the nodes of some faces, and these by face."""
    scene = lf.Scene()
    scene.substructure("part", part, material, degree=degree, body_force=body_force)
    scene.fix("part:z0")
    s = lf.assemble(scene).substructures["part"]
    x = s.dof_coordinates
    faces = {f: np.flatnonzero(np.abs(x[:, "xyz".index(f[0])] - at) < 1e-9) for f, at in kept.items()}
    nodes = np.unique(np.concatenate(list(faces.values())))
    a = (3 * nodes[:, None] + np.arange(3)).ravel()
    i = np.setdiff1d(np.arange(s.size), a)
    K = s.matrix.tocsc()
    solve = splu(K[i][:, i])
    inner = solve.solve(K[i][:, a].toarray())
    reduced = K[a][:, a].toarray() - K[a][:, i] @ inner
    force = s.load[a] - inner.T @ s.load[i]
    return 0.5 * (reduced + reduced.T), x[nodes], force, {f: np.searchsorted(nodes, n) for f, n in faces.items()}


def joint(base, law, force=(2.0, 1.0, -8.0), degree=1, cell="hexahedron", top=(2, 2, 2), **settings):
    """A block on a base, which is a mesh, or a Matrix."""
    scene = lf.Scene()
    if isinstance(base, lf.Matrix):
        scene.substructure("base", base)
        scene.load("base", "weight", name="weight")
    else:
        scene.substructure("base", base, STEEL, degree=degree, body_force=(0.0, 0.0, -2e-3))
    scene.substructure("block", block(20.0, top, cell), STEEL, degree=degree)
    scene.interface("joint", "block:z0", "base:z1", law, **settings)
    scene.fix("base:z0")
    scene.traction("block:z1", force)
    return lf.assemble(scene)


def reduced_base(degree=1, cell="hexahedron"):
    kept = {"z0": 0.0, "z1": 20.0}
    K, x, f, faces = condensed(block(cell=cell), kept, degree=degree, body_force=(0.0, 0.0, -2e-3))
    return lf.Matrix(K, x, {"weight": f}, faces)


@pytest.mark.parametrize(
    ("law", "degree", "cell"),
    [
        (lf.Perfect(), 1, "hexahedron"),
        (lf.Elastic(normal=1e4, tangential=3e3), 1, "hexahedron"),
        (lf.Elastic(normal=1e4, tangential=3e3), 2, "tetrahedron"),
        (lf.Contact(friction=0.32), 1, "hexahedron"),
        (lf.Contact(friction=0.35), 2, "tetrahedron"),
    ],
)
def test_a_condensed_part_gives_the_same_joint(law, degree, cell):
    whole = lf.solve(joint(block(cell=cell), law, degree=degree, cell=cell), options=TIGHT)
    matrix = lf.solve(joint(reduced_base(degree, cell), law, degree=degree, cell=cell), options=TIGHT)
    for read in ("force", "jump"):
        if law == lf.Perfect():
            continue  # it is assembled, and has none
        one, other = (getattr(each, read)("joint") for each in (whole, matrix))
        assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()
    u, v = (each.displacement("block").x.array for each in (whole, matrix))
    assert np.abs(u - v).max() < 1e-9 * np.abs(u).max()
    base = matrix.displacement("base")
    nodes = whole.problem.substructures["base"].dof_coordinates
    near = np.linalg.norm(nodes[None] - base.points[:, None], axis=2).argmin(axis=1)
    wanted = whole.displacement("base").x.array.reshape(-1, 3)[near]
    assert np.abs(base.displacements - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert base.rotations is None
