"""Orthotropic materials."""

from __future__ import annotations


import numpy as np
import pytest

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
