"""Newton's method over sizes of the zone and lengths of the history."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from dolfinx_frontend import (
    Amplitude,
    Contact,
    LinearElastic,
    Options,
    Problem,
    Scene,
    assemble,
    geometry,
    reference,
    solve,
)
from dolfinx_frontend.plan.cost import interface_unknowns

PRESS, PULL = Amplitude([0, 1], [0, 1]), Amplitude([1, 2], [0, 1])


def blocks(cells: int) -> Problem:
    """Two blocks, one on the other: pressed, then pulled along until a part of the face slips."""
    scene, steel = Scene(), LinearElastic(200e3, 0.3)
    for name, z in (("low", 0.0), ("up", 5.0)):
        box = geometry.box((10, 10, 5), (cells, cells, 3), origin=(0, 0, z), cell="hexahedron")
        scene.substructure(name, box, steel)
    scene.fix("low:z0")
    scene.interface("joint", "up:z0", "low:z1", Contact(friction=0.3), space="points")
    scene.pressure("up:z1", 50.0 * PRESS)
    scene.traction("up:x1", PULL * (16.0, 0, 0))
    return assemble(scene)


def test_iterations_do_not_fall_off_a_cliff() -> None:
    counts: list[int] = []
    for cells, least in ((7, 500), (12, 1800)):
        problem = blocks(cells)
        assert interface_unknowns(problem, ["joint"]) >= least
        result = solve(problem, times=[1.0, 2.0])
        assert result.converged and result.summary.newton_steps > 0
        counts.append(result.iterations)
    assert max(counts) <= 2 * min(counts)


@pytest.mark.parametrize("operator", ["condensed", "factored"])
def test_with_and_without_newton_it_is_the_same_answer(operator: Any) -> None:
    problem, rtol = blocks(6), 1e-7
    options = Options(rtol=rtol, operator=operator)
    result = solve(problem, times=[1.0, 2.0], options=options)
    alone = Options(rtol=1e-10, newton=0, max_iterations=5000)
    exact = solve(problem, times=[1.0, 2.0], options=alone)
    assert result.converged and exact.converged
    assert result.summary.newton_steps > 0 == exact.summary.newton_steps
    assert result.iterations <= 100
    # three times what the result says, as its estimate promises
    assert reference.energy_difference(problem, result, exact) <= 3 * rtol


MEASURED = """
from pathlib import Path
import numpy as np
from dolfinx_frontend import *
scene = Scene()
for i in range(2):
    box = geometry.box((1.0, 1.0, 0.5), (11, 11, 2), origin=(0.0, 0.0, 0.5 * i), cell="hexahedron")
    scene.substructure(f"a{i}", box, LinearElastic(2e5, 0.3), degree=1)
scene.fix("a0:z0")
scene.interface("joint", "a0:z1", "a1:z0", Contact(friction=0.3), space="points")
press, shear = Amplitude([0, 1], [0, 1]), Amplitude([1, 2, 3, 4], [0, 1, -1, 1])
scene.fix("a1:z1", press * (0.0, 0.0, -0.0005) + shear * (0.0002, 0.0, 0.0), name="grip")
problem = assemble(scene)
def peak():  # bytes; ru_maxrss would be that of the process that started this one
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
before = peak()
result = solve(problem, times=np.linspace(0.05, 4.0, 80))
assert result.converged and result.summary.newton_steps >= 80
print(peak() - before, result.plan.cost.memory)
"""


def test_the_plan_predicts_the_memory_of_a_history() -> None:
    run = subprocess.run(
        [sys.executable, "-c", MEASURED], capture_output=True, text=True, check=True, timeout=300
    )
    taken, predicted = map(float, run.stdout.split()[-2:])
    assert 0.7 <= predicted / taken <= 1.3
