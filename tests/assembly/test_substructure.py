"""Stiffness, volume and modulus of a part."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from tests.helpers import small_assembly

EPS = np.finfo(float).eps
STEEL = LinearElastic(2e5, 0.3)


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


def test_what_an_assembled_problem_has_cannot_be_written() -> None:
    problem = small_assembly()
    scene_objects = [*problem.substructures.values(), *problem.interfaces.values()]
    scene_objects += [side for i in problem.interfaces.values() for side in i.sides]
    arrays = []
    for each in scene_objects:
        for field in dataclasses.fields(each):
            value = getattr(each, field.name)
            if isinstance(value, np.ndarray):
                arrays.append(value)
            elif sp.issparse(value):
                arrays += [value.data, value.indices, value.indptr]
    joint = next(iter(problem.interfaces.values()))
    arrays += [joint.normals, next(iter(problem.substructures.values())).matrix.data]
    assert len(arrays) > 20
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    # and so has what is made of it
    changed = problem.with_laws({joint.name: joint.law}).interfaces[joint.name]
    assert changed.weights is not None and not changed.weights.flags.writeable
