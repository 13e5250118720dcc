"""Scatter over meshes: many points on the first mesh, few on the last one; shapes of cells of degree 2."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from basix.ufl import element
from dolfinx import fem
from dolfinx.mesh import create_mesh
from mpi4py import MPI

import ufl
from dolfinx_frontend import geometry
from dolfinx_frontend.estimate.judged import ALMOST, Judged
from dolfinx_frontend.estimate.unseen import _round_facets
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.scene.laws import Contact, Elastic
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve, tensor_quadrature
from dolfinx_frontend.uncertainty.parameters import LogNormal


def pressed_and_pushed() -> Scene:
    """A block on a bed with random friction, pushed aside through random springs."""
    scene = Scene()
    steel = LinearElastic(E=1000.0, nu=0.3)
    for name, size, cells, at in (
        ("a", (2.0, 1.0), (4, 2), (0.0, 0.0)),
        ("b", (1.0, 1.0), (2, 2), (0.5, 1.0)),
        ("c", (1.0, 1.0), (3, 3), (0.5, 2.0)),
    ):
        scene.substructure(name, geometry.box(size, cells, at, "triangle"), steel)
    scene.interface("j", "a:y1", "b:y0", Contact(friction=LogNormal("mu", 0.3, cov=0.2)), overlap="partial")
    stiffness = LogNormal("k", mean=300.0, cov=0.3)
    scene.interface("k", "b:y1", "c:y0", Elastic(normal=stiffness, tangential=stiffness))
    scene.fix("a:y0")
    scene.fix("c:y1", (0.02, -0.02), name="push")
    return scene


def test_few_points_answer_on_the_last_mesh() -> None:
    accuracy = 1e-1
    quantity = Resultant("j", component=1)
    result = solve(pressed_and_pushed(), accuracy=accuracy, quantity=quantity, progress=False)
    made, value = result.errors(), result.mean_std(quantity)
    assert isinstance(result, SampleResult) and len(made.steps) > 1
    assert made.reached and "of the first mesh" in str(made)
    rule = tensor_quadrature(result.problem, 9, active=["j"], progress=False)
    exact = rule.mean_std(quantity)
    assert value.std is not None and exact.std is not None
    off = max(abs(value.mean / exact.mean - 1.0), abs(value.std / exact.std - 1.0))
    # the rule itself is good to a tenth of this: seven points per germ differ by that
    assert off <= made.total <= accuracy


def stacked() -> Scene:
    """Three blocks pushed down and aside on each other; where friction is large they stick."""
    scene = Scene()
    for name, E, low, high, cells in (
        ("a", 379.0, (0.233, 0.0), (1.748, 0.575), (4, 2)),
        ("b", 857.0, (0.219, 0.575), (1.394, 1.45), (2, 2)),
        ("c", 2956.0, (0.073, 1.45), (1.479, 2.569), (4, 3)),
    ):
        part = geometry.box(tuple(np.subtract(high, low)), cells, low, cell="quadrilateral")
        scene.substructure(name, part, LinearElastic(E=E, nu=0.3), degree=1)
    k, mu = LogNormal("k", mean=181.25, cov=0.345), LogNormal("mu", mean=0.19, cov=0.1435)
    scene.interface("springs", "b:y0", "a:y1", Elastic(normal=k, tangential=k), overlap="partial")
    scene.interface("joint", "b:y1", "c:y0", Contact(friction=mu), overlap="partial")
    scene.interface("bed", "a:x0", Elastic(normal=50.0, tangential=50.0))
    scene.fix("a:y0")
    scene.fix("c:y1", (0.0153, -0.03), name="push")
    return scene


def test_meshes_are_judged_where_a_joint_sticks() -> None:
    """At the means it slides, and 148 unknowns are right to 1e-3; the deviation there is off by 6 %."""
    quantity = Resultant("joint", component=1)
    result = solve(stacked(), accuracy=3e-2, quantity=quantity, progress=False)
    made = result.errors()
    assert made.moments is not None and made.moments.std is not None
    # nine points per germ on 6 238 unknowns of degree 3; five points differ by 0.5 %
    assert abs(made.moments.std / 0.2051 - 1.0) <= 2.0 * made.in_all


@pytest.mark.parametrize("edges", [4, 6, 8])
def test_parabolas_miss_area_of_a_disc(edges: int) -> None:
    """Of a disc with n parabolas around, the area is known: sectors of straight sides, and of each parabola
    two thirds of its height over its chord. pi less that is what is missing."""
    angle = 2.0 * np.pi / edges
    ring = [np.exp(1j * angle * k) for k in range(edges)]
    arcs = [np.exp(1j * angle * (k + 0.5)) for k in range(edges)]
    x = np.array([0.0, *ring, *arcs, *(0.5 * np.array(ring))])
    cells = []
    for k in range(edges):
        after = (k + 1) % edges
        # corners, then the middles of the edges (1, 2), (0, 2), (0, 1)
        cells.append([0, 1 + k, 1 + after, 1 + edges + k, 1 + 2 * edges + after, 1 + 2 * edges + k])
    of_cells = element("Lagrange", "triangle", 2, shape=(2,))
    mesh = create_mesh(
        MPI.COMM_SELF, cells=np.array(cells, dtype=np.int64), e=of_cells, x=np.stack([x.real, x.imag], axis=1)
    )
    area = fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx))
    height, chord = 1.0 - np.cos(0.5 * angle), 2.0 * np.sin(0.5 * angle)
    known = edges * (0.5 * np.sin(angle) + 2.0 / 3.0 * chord * height)
    assert area == pytest.approx(known, rel=1e-12)
    part: Any = SimpleNamespace(part=SimpleNamespace(mesh=mesh), dim=2)
    found = _round_facets(part)
    assert found is not None and len(found.cells) == edges
    assert _round_facets(part) is found  # of one mesh they are found once
    missing = float(np.sum(found.thickness * found.areas))
    # parabolas turn less than their arcs, and chords are shorter: both are of second order in the angle
    assert missing == pytest.approx(np.pi - area, rel=0.45 * angle**2)


def test_points_are_tried_where_meshes_almost_fit() -> None:
    """Only where points answer, which are held to the sum, and from the second mesh on."""
    friction, springs = (SimpleNamespace(law=SimpleNamespace(linear=linear)) for linear in (False, True))

    def up_to(law: Any = friction, **others: Any) -> float:
        known = {"accuracy": 0.01, "random": True, "before": "a mesh", "quantity": Resultant("j")} | others
        known["problem"] = SimpleNamespace(interfaces={"k": springs, "j": law})
        return Judged._almost(SimpleNamespace(**known))  # type: ignore[arg-type]

    assert up_to() == ALMOST * 0.01
    assert up_to(springs) == up_to(random=False) == up_to(before=None) == up_to(quantity=None) == 0.0
