"""Two threads: on one problem, on one solver, on problems of their own."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Problem,
    Scene,
    assemble,
    errors,
    geometry,
    monte_carlo,
    solve,
    sweep,
)

TIGHT = Options(rtol=1e-9)


def pressed(law: Any, n: int = 8) -> Problem:
    scene = Scene()
    for name, x in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (n, n), origin=(x, 0.0))
        scene.substructure(name, part, LinearElastic(E=100.0, nu=0.3), degree=1)
    scene.interface("layer", "left:x1", "right:x0", law)
    scene.interface("bed", "right:x1", Elastic(normal=1.0, tangential=1.0))
    scene.fix("left:x0", name="wall")
    scene.traction("right:y1", (-1.0, 0.4), name="pull")
    return assemble(scene)


def contact() -> Problem:
    return pressed(Contact(friction=0.3, stiffness=200.0))


def springs() -> Problem:
    return pressed(Elastic(normal=LogNormal("k", mean=30.0, cov=0.3), tangential=10.0))


def at_once(*work: Callable[[], None]) -> None:
    """Run all at once; raise what one of them raised."""
    failed: list[BaseException] = []
    gate = threading.Barrier(len(work))

    def each(call: Callable[[], None]) -> None:
        try:
            gate.wait()
            call()
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=each, args=(call,)) for call in work]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]


@pytest.mark.parametrize("settings", [{}, {"backend": "mumps", "operator": "factored"}])
def test_one_problem(settings: dict[str, Any]) -> None:
    problem, options = contact(), TIGHT.with_(**settings)
    wanted = solve(problem, options=options).displacements["right"]

    def work() -> None:
        for _ in range(4):
            found = solve(problem, options=options)
            assert np.array_equal(found.displacements["right"], wanted)

    at_once(work, work, work)


BESIDE = """
import sys
import {first}  # which decides how many threads MPI expects
sys.path.insert(0, {here!r})
from mpi4py import MPI
from test_threads import np, TIGHT, at_once, contact, solve

problem, options = contact(), TIGHT.with_(backend="mumps", operator="factored")
wanted = solve(problem, options=options).displacements["right"]
left = [100]

def solves():
    while left[0] > 0:
        left[0] -= 1
        assert np.array_equal(solve(problem, options=options).displacements["right"], wanted)

def makes():
    while left[0] > 0:
        contact()

at_once(solves, makes)
print("level", MPI.Query_thread() == MPI.THREAD_MULTIPLE)
"""


@pytest.mark.parametrize(
    ("first", "several"),
    [
        ("petsc4py.PETSc", False),
        pytest.param("dolfinx_frontend", True, marks=pytest.mark.night(guard="where MPI allows less")),
    ],
)
def test_mumps_beside_a_thread_that_assembles(first: str, several: bool) -> None:
    """MUMPS calls MPI, and so does whoever makes a mesh: right even where MPI takes one thread at a time."""
    program = BESIDE.format(first=first, here=str(Path(__file__).parent))
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert ended.stdout.split() == ["level", str(several)]


def test_problems_of_their_own() -> None:
    problems = [contact() for _ in range(3)]
    wanted = solve(problems[0], options=TIGHT).displacements["right"]

    def work(problem: Problem) -> Callable[[], None]:
        def solves() -> None:
            for _ in range(4):
                assert np.array_equal(solve(problem, options=TIGHT).displacements["right"], wanted)

        return solves

    at_once(*(work(each) for each in problems))


def test_different_questions_to_one_problem() -> None:
    problem = springs()
    grid = {"layer.normal": [10.0, 20.0, 40.0]}
    one = solve(problem, chaos=3).force_coefficients("layer")
    two = sweep(problem, grid, progress=False).force("layer")
    three = monte_carlo(problem, 8, progress=False).force("layer")

    def chaos() -> None:
        for _ in range(3):
            assert np.array_equal(solve(problem, chaos=3).force_coefficients("layer"), one)

    def swept() -> None:
        for _ in range(3):
            assert np.array_equal(sweep(problem, grid, progress=False).force("layer"), two)

    def drawn() -> None:
        for _ in range(3):
            assert np.array_equal(monte_carlo(problem, 8, progress=False).force("layer"), three)

    at_once(chaos, swept, drawn)


def test_one_result() -> None:
    """Readings, measurements and samples of one result, which share one solver."""
    result = solve(springs(), chaos=3)
    force, mean = result.force_coefficients("layer"), result.mean("right").x.array.copy()
    # a body multiplies by its compliance after so many columns, which changes last digits: not in between
    samples = [result.monte_carlo(4).force("layer") for _ in range(4)][-1]
    measured = errors(result, "layer").relative("truncation")

    def reads() -> None:
        for _ in range(50):
            assert np.array_equal(result.force_coefficients("layer"), force)
            assert np.array_equal(result.mean("right").x.array, mean)

    def measures() -> None:
        for _ in range(2):
            assert errors(result, "layer").relative("truncation") == measured

    def draws() -> None:
        for _ in range(4):
            assert np.array_equal(result.monte_carlo(4).force("layer"), samples)

    at_once(reads, measures, draws, reads)
