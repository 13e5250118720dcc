"""Orthotropic materials."""

from __future__ import annotations


import numpy as np
import pytest

from dolfinx_frontend import AtPoint, SceneError, solve
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import Scene
from tests.helpers import block

EPS = np.finfo(float).eps


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


def test_axes_by_a_function():
    """Axes that are alike at all points are those of a matrix; what is no frame is refused."""
    axes = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    part = block("hexahedron", [2] * 3)
    constants = ((10.0, 4.0, 2.0), (0.3, 0.2, 0.1), (1.5, 1.2, 0.7))

    def scene_of(given):
        scene = Scene()
        scene.substructure("a", part, OrthotropicElastic(*constants, given))
        scene.fix("a:x0")
        scene.traction("a:x1", (1.0, 2.0, 0.5))
        return scene

    ways = (axes, lambda x: np.tile(axes, (len(x), 1, 1)))
    results = [solve(assemble(scene_of(given)), progress=False) for given in ways]
    fields = [np.asarray(r.displacement("a").x.array) for r in results]
    assert np.abs(fields[0] - fields[1]).max() < 1e-10 * np.abs(fields[0]).max()
    stresses = [
        r.quantity(AtPoint(r.problem, "a", (0.4, 0.3, 0.3), "stress", "xy")).values for r in results
    ]
    assert stresses[0] == pytest.approx(stresses[1], rel=1e-9)
    with pytest.raises(SceneError, match="orthonormal rows"):
        assemble(scene_of(lambda x: np.ones((len(x), 3, 3))))
