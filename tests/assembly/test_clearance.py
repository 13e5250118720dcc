"""Faces that are meshed inside each other: reported with their depth, unless only chords cross."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from dolfinx import mesh as dmesh

from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.laws import Contact
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import Space
from dolfinx_frontend.solving import solve
from latin_core import Options
from tests.helpers import DIMENSION, block, lame

CELLS = list(DIMENSION)
ONE = Options(max_iterations=1)
RADIUS = 1.5


def rings(
    cell: str, order: int, counts: tuple[int, int], space: Space, depth: float = 0.0, law: Contact = Contact()
) -> Problem:
    """A quarter of a ring in another one whose bore is too small by a depth."""
    d = DIMENSION[cell]

    def bend(x: Any) -> Any:
        angle = 0.5 * np.pi * x[:, 1]
        return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), *x.T[2:]])

    scene = Scene()
    for name, ends, count in (("pin", (1.0, RADIUS), counts[0]), ("hub", (RADIUS - depth, 2.0), counts[1])):
        low, high = np.array([ends[0], 0.0, 0.0][:d]), np.array([ends[1], 1.0, 0.5][:d])
        part = block(cell, [1, count, 2][:d], low, high, bend, order)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=2)
        scene.symmetry([f"{name}:{face}" for face in ("y0", "y1", "z0", "z1")[: 2 * d - 2]])
    scene.interface("fit", "pin:x1", "hub:x0", law, space=space)
    scene.pressure("pin:x0", 0.01)
    return assemble(scene)


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.common.errors.SceneWarning")
@pytest.mark.parametrize("space", ["points", "facets"])
@pytest.mark.parametrize("counts", [(6, 4), (4, 6), (12, 8)])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_chords_that_cross_are_no_interpenetration(
    cell: str, order: int, counts: tuple[int, int], space: Space
) -> None:
    if order == 1:  # a fit is stated, since straight cells cannot tell it
        message = r"'fit': the distance of the faces as meshed, .* of straight facets"
        with pytest.raises(SceneError, match=message):
            rings(cell, order, counts, space)
    problem = rings(cell, order, counts, space, law=Contact(gap=0.0 if order == 1 else None))
    fit = problem.interfaces["fit"]
    # the deepest chord: R (1 - cos(pi / 4 n)) below the arc, and facets of tetrahedra are cut askew
    sagitta = RADIUS * (1.0 - np.cos(np.pi / 4 / min(counts)))
    assert np.abs(fit.gap).max() < 1.01 * sagitta * (1.0 if order == 1 else 0.02)
    assert fit.clearance.min() == 0.0 or fit.gap.min() > 0.0
    solve(problem, options=ONE)


@pytest.mark.filterwarnings("ignore::dolfinx_frontend.common.errors.SceneWarning")
@pytest.mark.parametrize("space", ["points", "facets"])
@pytest.mark.parametrize(("order", "counts"), [(1, (18, 12)), (2, (6, 4))])
@pytest.mark.parametrize("cell", CELLS)
def test_interference_of_round_faces_is_reported(
    cell: str, order: int, counts: tuple[int, int], space: Space
) -> None:
    problem = rings(cell, order, counts, space, depth=0.02)
    message = r"'fit': the faces are meshed inside each other, by up to 0\.0(2|1999)"
    with pytest.raises(SceneError, match=message):
        solve(problem, options=ONE)


@pytest.mark.filterwarnings("ignore:interface 'joint'. contact in the space 'points'")
@pytest.mark.parametrize("space", ["points", "facets", "mortar"])
@pytest.mark.parametrize("counts", [(2, 2), (4, 3)])
@pytest.mark.parametrize("cell", CELLS)
def test_interference_of_plane_faces(cell: str, counts: tuple[int, int], space: Space) -> None:
    d, depth = DIMENSION[cell], 0.003
    low, high = np.zeros(d), np.ones(d)
    scene = Scene()
    for name, count in zip(("lower", "upper"), counts, strict=True):
        part = block(cell, [count] * d, low, high)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=2)
        low, high = low.copy(), high.copy()
        low[-1], high[-1] = 1.0 - depth, 2.0
    end = "xyz"[d - 1]
    scene.interface("joint", f"lower:{end}1", f"upper:{end}0", Contact(), space=space)
    scene.fix([f"lower:{end}0", f"upper:{end}1"])
    problem = assemble(scene)
    with pytest.raises(SceneError, match=r"'joint': .* meshed inside each other, by up to 0\.003:"):
        solve(problem, options=ONE)


def test_an_edge_is_no_curve() -> None:
    """A face round a corner: its kink of 90 degrees says nothing of how it was meshed."""
    part = block("quadrilateral", [4, 4])
    facets = np.sort(np.concatenate([part.facets("x1"), part.facets("y1")]))
    tags = dmesh.meshtags(part.mesh, 1, facets, np.ones(len(facets), dtype=np.int32))
    corner = Part(part.mesh, tags, {"corner": 1})
    assert np.all(FacetMap(corner, "corner", "test").sags == 0.0)


def shrunk(order: int, n: int, depth: float, law: Contact) -> Problem:
    """A ring pressed into another one, straight or curved cells, 3 n and 2 n along the quarter."""

    def bend(x: Any) -> Any:
        angle = 0.5 * np.pi * x[:, 1]
        return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle)])

    scene = Scene()
    for name, ends, count in (("a", (1.0, 1.5 + depth), 3 * n), ("b", (1.5, 2.0), 2 * n)):
        low, high = np.array([ends[0], 0.0]), np.array([ends[1], 1.0])
        part = block("triangle", [n, count], low, high, bend, order)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=2)
        scene.symmetry([f"{name}:y0", f"{name}:y1"])
    scene.interface("fit", "a:x1", "b:x0", law)
    return assemble(scene)


@pytest.mark.parametrize("part", [1.0, 100.0])
def test_gaps_below_the_sag_are_refused(part: float) -> None:
    """Straight cells whose facets are h^2 / 8 R beside the arc cannot tell smaller gaps, of either sign."""
    n = 6
    sagitta = 1.5 * (np.pi / (8 * n)) ** 2 / 2
    for sign in (-1.0, 1.0):
        depth = sign * 0.3 * sagitta / part
        message = (
            r"not more than the distance of straight facets .*, up to 0\.\d+: .* gap=0\.0 .*"
            r"geometry\.from_gmsh\(model, order=2\)"
        )
        with pytest.raises(SceneError, match=message):
            shrunk(1, n, depth, Contact())
        if sign < 0.0:  # curved cells tell it
            joint = shrunk(2, 2 * n, depth, Contact()).interfaces["fit"]
            assert np.abs(joint.gap + depth).max() < 0.02 * sagitta / part + 1e-6
    # a gap that is larger somewhere is one
    shrunk(1, n, -3.0 * sagitta, Contact())


def test_interference_below_the_sag_is_refused() -> None:
    """Straight cells, h^2 / 8 R beside the arc, cannot tell a smaller interference; curved ones can."""
    depth = 1e-3

    def u(a: float, b: float, inside: float, outside: float) -> float:
        return float(lame(1.5, a, b, inside, outside, 1.0, 0.3))

    exact = depth / (u(1.5, 2.0, 1.0, 0.0) - u(1.0, 1.5, 0.0, 1.0))
    errors = []
    for n in (3, 6):
        with pytest.raises(SceneError, match=r"up to 0\.00.* beside the round faces.*from_gmsh\(model"):
            shrunk(1, n, depth, Contact(interference=True))
        problem = shrunk(2, n, depth, Contact(interference=True))
        joint = problem.interfaces["fit"]
        pressure = -joint.weights @ solve(problem, options=ONE.with_(max_iterations=100)).force("fit")[:, 0]
        errors.append(abs(pressure / joint.area / exact - 1.0))
    assert errors[1] < 1e-3 and np.log2(errors[0] / errors[1]) > 3.0
    with pytest.warns(SceneWarning, match=r"the interference is uncertain by 2\d %"):
        shrunk(1, 24, depth, Contact(interference=True))
    # what is stated is not asked of the mesh
    shrunk(1, 3, depth, Contact(gap=-depth))


@pytest.mark.parametrize("counts", [(6, 4), (4, 6), (7, 7), (16, 10)])
@pytest.mark.parametrize("cell", CELLS)
def test_a_clearance_within_the_sag_of_curved_cells_is_told(cell: str, counts: tuple[int, int]) -> None:
    """It is taken for none, which a warning says with the clearance; two meshes of one face give none."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit = rings(cell, 2, counts, "auto").interfaces["fit"]
    assert fit.fits and fit.apart == 0.0
    noise = float(np.abs(fit.gap).max())
    for clearance in (0.15 * fit.sag.min() + noise, -0.15 * fit.sag.min() - noise):
        how = "apart by" if clearance > 0.0 else "inside each other by"
        message = rf"'fit': the faces are meshed {how} about .* taken as touching; state it, gap="
        with pytest.warns(SceneWarning, match=message):
            joint = rings(cell, 2, counts, "auto", -clearance).interfaces["fit"]
        assert joint.fits and not joint.clearance.any()
        assert abs(joint.apart - clearance) < noise + 1e-12
        with warnings.catch_warnings():  # what is stated is not asked of the mesh
            warnings.simplefilter("error")
            rings(cell, 2, counts, "auto", -clearance, Contact(gap=clearance))


def test_a_pin_at_one_side_of_its_hole_has_a_clearance() -> None:
    """It touches at one place, and is apart by up to twice the radial clearance at the opposite one."""
    radius, clearance, scene = 1.5, 8e-7, Scene()
    hole = ("hub", (radius + clearance, 2.0), 24, clearance)
    for name, ends, n, shift in (("pin", (1.0, radius), 36, 0.0), hole):

        def bend(x: Any, shift: float = shift) -> Any:
            angle = np.pi * x[:, 1]
            return np.column_stack([x[:, 0] * np.cos(angle) + shift, x[:, 0] * np.sin(angle)])

        part = block("triangle", [1, n], np.array([ends[0], 0.0]), np.array([ends[1], 1.0]), bend, 2)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=2)
        scene.fix(f"{name}:{'x0' if name == 'pin' else 'x1'}")
    scene.interface("fit", "pin:x1", "hub:x0", Contact())
    with pytest.warns(SceneWarning, match=r"apart by about 1\.\d+e-06"):
        assemble(scene)
