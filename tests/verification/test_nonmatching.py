"""Rates of both interface spaces on meshes that do not match, plane and curved, in 2D and 3D.

Expected: displacements of degree p have the order p in the energy norm, whatever the law. Forces that are
constant on facets and exact in the mean would be off by h^2 at centroids; with rigid laws the multiplier of
degree 0 allows for h^(p - 1/2), at most h^2 (measured: docs/interfaces.md).
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from dolfinx_frontend.common.errors import SceneWarning
from dolfinx_frontend.scene.specs import Space
from tests.verification.nonmatching import Errors, blocks, overlapping, rings


def rates(coarse: Errors, fine: Errors) -> tuple[float, float, float]:
    """Of energy, force and resultant when the cells are halved."""
    pairs = ((getattr(coarse, k), getattr(fine, k)) for k in ("energy", "force", "resultant"))
    energy, force, resultant = (float(np.log2(a / b)) for a, b in pairs)
    return energy, force, resultant


@pytest.mark.parametrize("finer_first", [True, False])
@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_plane_facets(cell: str, law: str, finer_first: bool) -> None:
    space: Space = "facets"
    coarse, fine = (blocks(cell, space, law, 2, n, finer_first) for n in (4, 8))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > (1.9 if finer_first else 1.4)  # facets larger than cells behind them: h^(3/2)
    # constant pressures on facets larger than the cells that press on them: at least h
    assert force > (1.4 if finer_first else 0.9) and resultant > 1.4


@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
def test_plane_facets_of_degree_1(law: str) -> None:
    coarse, fine = (blocks("triangle", "facets", law, 1, n) for n in (4, 8))
    energy, force, _ = rates(coarse, fine)
    assert energy > 0.9 and force > (1.8 if law == "elastic" else 0.9)


@pytest.mark.parametrize("law", ["elastic", "contact", "perfect"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_curved_facets(cell: str, law: str) -> None:
    """A split Lame ring."""
    coarse, fine = (rings(cell, "facets", law, 2, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > 1.85 and force > 1.4 and resultant > 1.8


@pytest.mark.parametrize("law", ["elastic", "contact"])
@pytest.mark.parametrize("scene", [blocks, rings])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_solids_facets(cell: str, scene: object, law: str) -> None:
    assert callable(scene)
    coarse, fine = (scene(cell, "facets", law, 2, n) for n in (2, 4))
    assert coarse.status == fine.status == "converged"
    energy, force, resultant = rates(coarse, fine)
    assert energy > 1.8 and force > 1.2 and resultant > 1.4


@pytest.mark.parametrize("law", ["elastic", "perfect"])
def test_facets_on_linear_tetrahedra_lock(law: str) -> None:
    """Two facets per node: forces of rigid laws (not of springs) are meaningless; a warning says so."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        errors = blocks("tetrahedron", "facets", law, 1, 4)
    locks = any(issubclass(w.category, SceneWarning) and "locks" in str(w.message) for w in told)
    assert locks == (law == "perfect")
    assert (errors.force > 1.0) == (law == "perfect")


def test_points_keep_displacements_in_contact_but_not_pressures() -> None:
    """Kinks of side 2 within a facet: springs lose the order of degree 2, contact its pressures."""
    coarse, fine = (blocks("triangle", "points", "elastic", 2, n) for n in (4, 8))
    assert 0.3 < rates(coarse, fine)[0] < 1.0
    coarse, fine = (blocks("triangle", "points", "contact", 2, n) for n in (4, 8))
    energy, _, resultant = rates(coarse, fine)
    assert energy > 1.8 and resultant > 0.9
    assert fine.force > 0.3


@pytest.mark.parametrize("degree", [1, 2])
def test_partly_overlapping_faces(degree: int) -> None:
    """Stresses are singular where the overlap ends: energies have the order 1 or more, not 2 p."""
    exact = overlapping(degree, 48, aligned=True)
    errors = [abs(overlapping(degree, n) / exact - 1.0) for n in (6, 12)]
    assert np.log2(errors[0] / errors[1]) > 0.9 and errors[1] < 0.05
