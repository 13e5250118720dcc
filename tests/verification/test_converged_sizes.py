"""Nonlinear iterations do not fall off a cliff: a punch with friction on meshes of several sizes."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.results.result import HistoryResult
from tests.verification.judged import Laws, Values, assert_right, connect, judged, measure

TIMES = [1.0, 2.0]
PRESS, SHEAR = lf.Amplitude([0.0, 1.0], [0.0, 1.0]), lf.Amplitude([1.0, 2.0], [0.0, 1.0])
NORMAL, TANGENTIAL = 50.0 * 6.0 * 6.0, 8.0 * 6.0 * 5.0
"""Total loads of the punch, N."""


def punch_laws(a: Values, v: Values) -> Laws:
    return {
        "foot": lf.Displacement(0.0),
        "joint": lf.Contact(friction=0.3),
        "press": lf.Traction(a(0) * np.array((0.0, 0.0, -50.0))),
        "shear": lf.Traction(a(1) * np.array((8.0, 0.0, 0.0))),
    }


def punch(laws: Laws, cells: int) -> lf.Scene:
    """A block of 6 x 6 x 5 mm on one of 10 x 10 x 5 mm: pressed, then sheared."""
    scene, few = lf.Scene(), int(0.9 * cells)
    for name, side, at, n in (("low", 10.0, (0.0, 0.0, 0.0), cells), ("up", 6.0, (2.0, 2.0, 5.0), few)):
        part = lf.geometry.box((side, side, 5.0), (n, n, 2), origin=at, cell="hexahedron")
        scene.substructure(name, part, lf.LinearElastic(2e5, 0.3), degree=1)
    faces = {"foot": ["low:z0"], "joint": ["up:z0", "low:z1"], "press": ["up:z1"], "shear": ["up:x1"]}
    return connect(scene, laws, faces, joint="facets")


@cache
def solved(cells: int, newton: int | None = None) -> HistoryResult:
    """With a default, or Newton's method after a number of accelerated steps."""
    options = lf.Options(rtol=1e-5) if newton is None else lf.Options(rtol=1e-5, newton=newton)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the punch covers only a part of the lower face
        problem = lf.assemble(punch(punch_laws(lambda k: (PRESS, SHEAR)[k], lambda name: None), cells))
        return lf.solve(problem, times=TIMES, options=options)


def check(result: HistoryResult) -> None:
    """The forces of the joint are the loads, and hold the laws of contact and friction."""
    assert result.converged, (result.status, result.iterations, result.error)
    joint = result.problem.interfaces["joint"]
    memory: dict[str, Any] = {}
    for step, sheared in enumerate((0.0, TANGENTIAL)):
        force, jump = result.force("joint")[step], result.jump("joint")[step]
        total = joint.weights @ np.einsum("mk,mkd->md", force, joint.frames)
        assert np.abs(np.abs(total) - (sheared, 0.0, NORMAL)).max() <= 3.0 * 1e-5 * NORMAL
        laws = {"joint": lf.Contact(friction=0.3)}
        fields = {name: u[step][:, None] for name, u in result.displacements.items()}
        broken = measure.broken_laws(result.problem, laws, {"joint": (force, jump)}, fields, None, memory)
        assert max(broken.values(), default=0.0) <= 30.0 * 1e-5, broken


@pytest.mark.parametrize(("cells", "unknowns"), [(6, 75), (12, 300), (20, 972)])
def test_small_zones(cells: int, unknowns: int) -> None:
    result = solved(cells)
    assert 3 * result.problem.interfaces["joint"].num_points == unknowns
    check(result)


def test_zones_on_both_sides_of_1500_unknowns() -> None:
    large = solved(26)
    assert 3 * large.problem.interfaces["joint"].num_points == 1587
    check(large)
    assert large.iterations <= 2 * solved(20).iterations


@pytest.mark.parametrize("cells", [6, 9, 12])
def test_a_late_begin_costs_no_more_than_the_wait(cells: int) -> None:
    at_once, late = solved(cells, newton=1), solved(cells, newton=60)
    check(at_once)
    check(late)
    assert late.iterations <= 60 + 2 * at_once.iterations


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6])
def test_a_small_punch_is_right(rtol: float) -> None:
    options = lf.Options(rtol=rtol)
    run = {"amplitudes": [PRESS, SHEAR], "times": TIMES}

    def solve(problem: lf.Problem) -> HistoryResult:
        return lf.solve(problem, times=TIMES, options=options)

    assert_right(judged("history", punch_laws, lambda laws: punch(laws, 6), solve, rtol, **run))
