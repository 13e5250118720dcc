"""Joints that rest on so little that they may roll: what hangs on nothing spoils nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from parts.rings import annulus

RADIUS, CLEARANCE = 10.0, 0.05


@pytest.mark.parametrize(
    "around, friction, turn", [(24, 1.5, 0.17), (16, 0.8, 0.23), (24, 0.1, 0.1), (16, 0.05, 0.36)]
)
@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_pin_on_a_vertex_of_its_hole(around: int, friction: float, turn: float, unit: float) -> None:
    """At first it rests on one vertex, on which it may roll; it carries the load that turns, step by step."""
    scene, times = lf.Scene(), np.arange(1.0, 5.0)
    pin = annulus(2.0 * unit, RADIUS * unit, 2 * math.pi, divisions=(3, around))
    hole = annulus((RADIUS + CLEARANCE) * unit, 25.0 * unit, 2 * math.pi, divisions=(3, around))
    for name, part in (("pin", pin), ("ring", hole)):
        scene.substructure(name, part, lf.LinearElastic(210e3 / unit**2, 0.3), degree=2)
    scene.fix("ring:outer")
    law = lf.Contact(gap=CLEARANCE * unit, friction=friction)
    scene.interface("hole", "pin:outer", "ring:inner", law)
    load = 10.0 * 2 * math.pi * 2.0 / unit
    way = np.array([np.cos(turn * (times - 1.0)), np.sin(turn * (times - 1.0))])
    for axis, path in enumerate(way):
        traction = np.where(np.arange(2) == axis, -10.0 / unit**2, 0.0)
        in_time = lf.Amplitude([0.0, *times], [0.0, *path])
        scene.traction("pin:inner", in_time * tuple(traction), name=f"push{axis}")
    problem, options = lf.assemble(scene), lf.Options(rtol=1e-8)
    with pytest.warns(lf.SceneWarning, match="'pin'.* at step 0.*one of many .rotation about"):
        result = lf.solve(problem, times=times, options=options, progress=False)
    assert result.converged
    for step, (x, y) in enumerate(way.T):
        table = result.table("hole", step=step)
        found = np.abs([float(table.value(f"force_{axis}", "hole")) for axis in "xy"])
        assert found == pytest.approx(load * np.abs([x, y]), rel=2e-4, abs=1e-6 * load)


def test_a_frame_on_corners() -> None:
    """Two posts under a lintel that bends: it rests on their corners, and carries its load to the ground."""
    scene, wide, high, span = lf.Scene(), 10.0, 20.0, 60.0
    boxes = {
        "bed": ((span, 5.0), (12, 1), (0.0, -5.0)),
        "left": ((wide, high), (2, 4), (0.0, 0.0)),
        "right": ((wide, high), (2, 4), (span - wide, 0.0)),
        "lintel": ((span, wide), (12, 2), (0.0, high)),
    }
    for name, (size, divisions, origin) in boxes.items():
        box = geometry.box(size, divisions, origin=origin, cell="quadrilateral")
        scene.substructure(name, box, lf.LinearElastic(210e3, 0.3))
    scene.fix("bed:y0")
    law = lf.Contact(friction=0.8)
    for post in ("left", "right"):
        scene.interface(f"foot-{post}", f"{post}:y0", "bed:y1", law, overlap="partial")
        scene.interface(f"head-{post}", f"{post}:y1", "lintel:y0", law, overlap="partial")
    times = [1.0, 2.0, 3.0]
    scene.traction("lintel:y1", lf.Amplitude([0, 1, 2, 3], [0, 1, 1, 1]) * (0.0, -5.0), name="press")
    scene.traction("lintel:y1", lf.Amplitude([0, 1, 2, 3], [0, 0, 1, -1]) * (0.1, 0.0), name="push")
    result = lf.solve(lf.assemble(scene), times=times, options=lf.Options(rtol=1e-8), progress=False)
    assert result.converged
    for step, push in enumerate((0.0, 0.1, -0.1)):
        table = result.table(step=step)
        feet = [[table.value(f"force_{axis}", f"foot-{post}") for post in ("left", "right")] for axis in "xy"]
        sums = [abs(sum(each)) for each in feet]
        assert sums == pytest.approx([abs(push) * span, 5.0 * span], rel=1e-6, abs=1e-5)
