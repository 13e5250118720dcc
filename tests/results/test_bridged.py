"""What is said beside the slip of a joint: a block that slides loads its bolts with what friction leaves."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf

FORCE, PULL = 20e3, 4e3
"""Of the bolts together, and along the joint."""
M8 = lf.BoltStiffness.vdi2230(d=8, pitch=1.25, shank=10, thread=10, E=205e3)


def joint(friction: Any, softness: float = 1.0, bolts: int = 2, pull: float = PULL) -> lf.Problem:
    later = lf.Amplitude([1, 2], [0, 1])
    scene = lf.Scene()
    for k, name in enumerate(("low", "top")):
        plate = lf.geometry.box((80, 40, 10), (4, 2, 1), origin=(0, 0, 10.0 * k), cell="hexahedron")
        scene.substructure(name, plate, lf.LinearElastic(E=200e3, nu=0.0), degree=1)
    scene.interface("joint", "low:z1", "top:z0", lf.Contact(friction=friction))
    soft = lf.BoltStiffness(axial=M8.axial, bending=softness * M8.bending, torsion=softness * M8.torsion)
    for k in range(bolts):
        scene.beam(f"bolt {k}", "low:z0", "top:z1", soft, lf.Preload(FORCE / bolts, until=1.0))
    scene.fix("low:z0")
    scene.traction("top:x1", later * (pull / 400.0, 0, 0))
    return lf.assemble(scene)


TIMES = [1.0, 2.0]


def test_bolts_that_carry_shear_are_named_with_their_share() -> None:
    """Friction of 0.15 carries 3 000 of 4 000 N."""
    result = lf.solve(joint(0.15), times=TIMES, progress=False)
    [text] = [each for each in result.table("joint").notes if "carry" in each]
    assert text.startswith("slip of 'joint' is that beside 'bolt 0', 'bolt 1', which carry 0.25 of its shear")
    assert "(1000 of 4000)" in text
    assert "bending=1e-3 * m.bending" in text
    with pytest.warns(lf.SceneWarning, match="carry 0.25 of its shear"):
        result.quantity("joint.slip_safety")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result.quantity("joint.shear")
        with pytest.raises(lf.SceneError, match="unknown interface 'joynt'; did you mean 'joint'"):
            result.quantity("joynt.slip")


def test_of_samples_it_is_that_of_the_one_that_moves_most() -> None:
    """Of frictions of 0.19, 0.11 and 0.14: 2 200 N."""
    problem = joint(lf.Uniform("mu", 0.1, 0.2), bolts=1)
    germs = np.array([[0.8], [-0.8], [-0.2]])
    answer = lf.sample(problem, germs, times=TIMES, progress=False)
    [text] = answer.bridged(["joint"])
    assert "carry 0.45 of its shear (1800 of 4000)" in text and "point 1" in text
    number, point = answer.furthest
    again = lf.sample(problem, germs, times=TIMES, keep_states=True, progress=False).point(1)
    for part in ("low", "top"):
        assert number == 1 and np.allclose(point.unknowns(part), again.unknowns(part), rtol=1e-9, atol=1e-12)


def test_joints_that_stick_beside_soft_bolts_have_nothing_to_be_told() -> None:
    result = lf.solve(joint(0.25, softness=1e-3), times=TIMES, progress=False)
    assert result.table("joint").notes == ()
    unloaded = lf.solve(joint(0.25, pull=0.0), times=TIMES, progress=False)
    assert unloaded.table("joint").notes == ()


def test_slip_behind_soft_bolts_is_beyond_the_model() -> None:
    """It is a converged answer: the bolts hold at some millimetres."""
    with pytest.warns(lf.SceneWarning, match="its faces slide by"):
        result = lf.solve(joint(0.15, softness=1e-3), times=TIMES, progress=False)
    [text] = result.table("joint").notes
    slip = result.table("joint").value("slip", "joint")
    assert result.converged
    assert text.startswith(f"slip of 'joint' is up to {slip:.4g}, beyond the model, 4.47")


def test_samples_say_where_their_indices_are() -> None:
    answer = lf.sample(joint(lf.Uniform("mu", 0.25, 0.3)), [[0.0], [0.5]], times=TIMES, progress=False)
    with pytest.raises(AttributeError, match=r"ask quantity\('joint.normal'\).sobol"):
        answer.sobol("joint")
