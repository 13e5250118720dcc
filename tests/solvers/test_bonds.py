"""Snaps of bonds, and meshes that do not resolve how these tear: a bar that is glued and pulled."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry

E, STRENGTH, NORMAL, OPENING = 1e3, 10.0, 1e4, 0.05
FIRST = STRENGTH / NORMAL


def pulled(length: float, ends: float, cells: int) -> tuple[lf.Result, list[str]]:
    """Two bars of unit height and this length each, glued, and pulled apart in two steps."""
    scene = lf.Scene()
    for name, x in (("left", 0.0), ("right", length)):
        box = geometry.box((length, 1.0), (4, cells), origin=(x, 0.0))
        scene.substructure(name, box, lf.LinearElastic(E=E, nu=0.0, plane="stress"))
    scene.interface("bond", "left:x1", "right:x0", lf.Debonding(NORMAL, NORMAL, STRENGTH, opening=OPENING))
    scene.fix("left:x0")
    scene.fix("right:y0", components=1, name="roll")
    scene.fix("right:x1", 1.0 * lf.Amplitude([0.0, 1.0], [0.0, ends]), components=0, name="grip")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = lf.solve(lf.assemble(scene), times=[0.5, 1.0])
    return result, [str(each.message) for each in caught]


def test_a_long_bar_snaps() -> None:
    """It stores more than the bond can take: the load would have to fall to the final opening."""
    length = 10.0
    peak = FIRST + STRENGTH / E * 2 * length
    result, said = pulled(length, 1.5 * peak, 2)
    assert result.converged
    assert np.allclose(result.force("bond")[1], 0.0, atol=1e-6 * STRENGTH)
    assert result.summary.falls[0] == 0.0
    # points break one after the other: the load falls no further than where the last of them does
    assert 0.4 < result.summary.falls[1] < 1.001 * (1.0 - OPENING / peak)
    (snap,) = (each for each in said if "snaps" in each)
    assert "'bond'" in snap and "between steps 0 and 1 (t = 0.5 and 1)" in snap
    assert f"falls from {0.75 * peak / (2 * length / E + 1 / NORMAL):.4g} to " in snap


def test_a_short_bar_tears_without_a_snap() -> None:
    """Softer than its bond's falling branch nothing falls: 2 L / E < (opening - first) / strength."""
    length = 1.0
    result, said = pulled(length, 0.7 * OPENING, 2)
    assert result.converged
    assert np.all(result.summary.falls < 1e-6)
    assert not [each for each in said if "snaps" in each]


@pytest.mark.parametrize(("cells", "rings"), [(1, True), (2, False)])
def test_cells_in_the_process_zone(cells: int, rings: bool) -> None:
    """E G / strength^2 = 2.5 times the height: three cells and more with two of them on the face."""
    _, said = pulled(1.0, 0.7 * OPENING, cells)
    zone = [each for each in said if "E G / strength^2" in each]
    assert len(zone) == rings
    assert not rings or ("'bond': it tears over a length of 2.5 " in zone[0] and "2.5 cells" in zone[0])


def test_an_undamaged_bond_says_nothing() -> None:
    _, said = pulled(1.0, 0.5 * (FIRST + 2 * STRENGTH / E), 1)
    assert not said


def test_modulus_along_the_fibres_and_across() -> None:
    from dolfinx_frontend.scene.materials import modulus_along

    matrix = lf.OrthotropicElastic((135.3e3, 9e3), 0.24, 5.2e3, plane="stress").elasticity(2)
    assert matrix is not None
    assert modulus_along(matrix, np.eye(2)) == pytest.approx([135.3e3, 9e3])
    isotropic = lf.LinearElastic(E=210e3, nu=0.3).elasticity(3)
    assert isotropic is not None
    assert modulus_along(isotropic, np.array([[0.6, 0.0, 0.8]])) == pytest.approx([210e3])
