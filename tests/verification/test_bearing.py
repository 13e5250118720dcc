"""A bracket held by friction is pushed until it bears: closed form by statics.

A preload N presses it on its base, friction mu holds it up to mu N; what is pushed beyond goes into the stop
that it meets after the gap (the shank in its hole).
"""

from __future__ import annotations

import logging

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Contact,
    LinearElastic,
    Options,
    Scene,
    SceneError,
    SceneWarning,
    assemble,
    geometry,
    solve,
)
from dolfinx_frontend.assembly.problem import Problem
from tests.helpers import block

MU, PRELOAD, GAP = 0.1, 50e3, 1.0
LIMIT = MU * PRELOAD
SIDE, HIGH = 60.0, 20.0
RTOL = 1e-6


def bracket(push: float, history: bool, stop: bool = True, turn: float = 0.0) -> Problem:
    """Bracket on its base, in N and mm."""
    scene = Scene()
    for name, y in (("base", -HIGH), ("bracket", 0.0)):
        part = geometry.box((SIDE, HIGH, SIDE), (4, 2, 4), origin=(0.0, y, 0.0), cell="hexahedron")
        scene.substructure(name, part, LinearElastic(2e5, 0.3), degree=1)
    scene.fix("base:y0", name="ground")
    scene.interface("seat", "base:y1", "bracket:y0", Contact(friction=MU))
    if stop:
        scene.interface("bearing", "bracket:x1", Contact(gap=GAP))
        scene.symmetry("bracket:z0")
    pressure = PRELOAD / SIDE**2
    traction = push / (SIDE * HIGH) * np.array([np.cos(turn), 0.0, np.sin(turn)])
    tighten, load = Amplitude([0.0, 1.0], [0.0, 1.0]), Amplitude([1.0, 2.0], [0.0, 1.0])
    scene.pressure("bracket:y1", tighten * pressure if history else pressure, name="bolt")
    scene.traction("bracket:x0", load * traction if history else tuple(traction), name="push")
    return assemble(scene)


@pytest.mark.parametrize(
    ("push", "steps"),
    [
        *((share * LIMIT, steps) for share in (0.99, 1.01) for steps in (0, 2, 9)),
        *((1.8 * LIMIT, steps) for steps in (0, 2, 9)),
    ],
)
def test_slip_into_bearing(push, steps):
    problem = bracket(push, steps > 0)
    times = np.r_[1.0, np.linspace(1.0, 2.0, steps + 1)[1:]] if steps else None
    result = solve(problem, times=times, options=Options(rtol=RTOL, max_iterations=1000))
    seat = problem.interfaces["seat"]
    force = np.atleast_3d(result.force("bearing").T).T[-1]
    borne = -float(problem.interfaces["bearing"].weights @ force[:, 0])
    shear = np.atleast_3d(result.force("seat").T).T[-1]
    rubbed = np.einsum("p,pc,pc->", seat.weights, seat.frames[:, :, 0], shear)
    assert result.converged and set(result.statuses) == {"converged"}
    # statics: the friction that is left is the bound where the bracket bears, else all of the push
    assert borne + abs(rubbed) == pytest.approx(push, abs=100.0 * RTOL * PRELOAD)
    # pushed further once it bears, the seat strains, and some of its points stick again
    stuck = 0.01 * LIMIT if steps > 2 and push > 1.5 * LIMIT else 100.0 * RTOL * PRELOAD
    assert abs(rubbed) == pytest.approx(min(push, LIMIT), abs=stuck)


@pytest.mark.parametrize("share", [0.99, 0.999])
def test_below_the_limit_the_answer_is_right(share):
    result = solve(bracket(share * LIMIT, False, stop=False))
    seat = result.problem.interfaces["seat"]
    assert result.converged
    rubbed = np.einsum("p,pc,pc->", seat.weights, seat.frames[:, :, 0], result.force("seat"))
    assert abs(rubbed) == pytest.approx(share * LIMIT, rel=1e-4)


@pytest.mark.parametrize("share", [1.001, 1.01, 1.5])
def test_beyond_the_limit_a_translation_is_a_translation(share):
    with pytest.raises(SceneError) as raised:
        solve(bracket(share * LIMIT, False, stop=False))
    message = str(raised.value)
    assert "'bracket' has lost its support" in message and "translation along x" in message
    assert "'seat' slips" in message and "opens" not in message and "rotation" not in message


def test_a_turning_bracket_slips_and_does_not_open():
    """The proof of lost equilibrium climbs on its friction; the motion that is meant does not."""
    with pytest.raises(SceneError, match="rotation about y") as raised:
        solve(bracket(1.2 * LIMIT, False, stop=False, turn=0.4))
    assert "'seat' slips" in str(raised.value) and "opens" not in str(raised.value)


@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_a_run_without_an_answer_says_what_floats(caplog):
    """With too few iterations to reach the stop: which part has moved, and how."""
    caplog.set_level(logging.WARNING)
    # by the indicator: a run that is stopped by its error is carried on by other means before it gives up
    options = Options(max_iterations=40, newton=0, criterion="indicator")
    result = solve(bracket(1.8 * LIMIT, True), times=[1.0, 2.0], options=options)
    assert not result.converged and "inf" not in caplog.text
    assert f"ended as {result.status}" in caplog.text
    assert "the last iterate has moved 'bracket' by translation along" in caplog.text


@pytest.mark.filterwarnings("ignore:interface 'seat'. the areas")
@pytest.mark.parametrize(("order", "pin", "hub"), [(1, 8, 12), (2, 24, 16)])
def test_a_pin_that_rests_on_a_corner_of_straight_facets_says_so(order, pin, hub, caplog):
    """A pin with friction in a hole that is 5 % larger: straight ones touch at one corner, curved at more."""
    caplog.set_level(logging.WARNING)
    scene = Scene()
    for name, ends, n, drop in (("pin", (0.3, 0.95), pin, 0.05), ("hub", (1.0, 2.0), hub, 0.0)):

        def bend(x, drop=drop):
            angle = np.pi * (x[:, 1] - 0.5)
            return np.column_stack([x[:, 0] * np.sin(angle), -x[:, 0] * np.cos(angle) - drop])

        part = block("quadrilateral", [2, n], [ends[0], 0.0], [ends[1], 1.0], bend, order)
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=order)
    scene.interface("seat", "pin:x1", "hub:x0", Contact(friction=0.3))
    scene.fix("hub:x1")
    scene.traction("pin:x0", (0.0, -1e-3))
    problem = assemble(scene)
    if order == 1:
        assert not solve(problem, options=Options(max_iterations=60, newton=0)).converged
        assert "'seat': at the end 1 of 13 points touch, corners of straight facets" in caplog.text
        with pytest.warns(SceneWarning, match=r"'pin'.* one of many \(rotation about"):
            result = solve(problem)
    else:
        result = solve(problem, options=Options(max_iterations=1000))
        assert "corners" not in caplog.text
    assert result.converged
    chords = 2.0 * 0.3 * pin * np.sin(0.5 * np.pi / pin) if order == 1 else 0.3 * np.pi
    assert abs(result.table("seat").value("force_y", "seat")) == pytest.approx(1e-3 * chords, rel=1e-5)
