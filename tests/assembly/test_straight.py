"""Linear displacements on curved cells: rigid motions never strain a part."""

from __future__ import annotations

import math

import numpy as np
import pytest
from parts.rings import annulus

import dolfinx_frontend as lf


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_linear_displacements_on_curved_cells_are_on_straight_ones(cell: str) -> None:
    """A ring fixed at its rim takes the torque on its bore, by statics; linear fields are exact."""
    ring = annulus(10.0, 20.0, 2.0 * math.pi, divisions=(2, 12), cell=cell, geometry_order=2)
    scene = lf.Scene()
    with pytest.warns(lf.SceneWarning, match="degree=1 on curved cells"):
        scene.substructure("ring", ring, lf.LinearElastic(210e3, 0.3), degree=1)
    scene.fix("ring:outer", name="ground")
    scene.force("ring:inner", (0.0, 0.0), 1000.0, name="torque")
    problem = lf.assemble(scene)
    table = lf.solve(problem, progress=False).table(about=(0.0, 0.0))
    assert abs(table.value("moment_z", "ground")) == pytest.approx(1000.0, rel=1e-10)
    part = problem.substructures["ring"]
    x = part.dof_coordinates
    turned = np.stack([-x[:, 1], x[:, 0]], axis=1).ravel()
    assert np.abs(part.matrix @ turned).max() < 1e-12 * part.diagonal.max() * np.abs(x).max()
    assert set(problem.substructures["ring"].part.names) == set(ring.names)
