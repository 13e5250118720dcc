"""Two threads against one, and the kernel's numbers of a Cholesky factor against CHOLMOD's.

``./run bench threads --json FILE`` writes ``threads``, of each case a row for each number of ``threads``,
each in a process of its own: ``busy_s``, processor time of the busiest thread, which on a quiet machine is
that of the clock where it never waits for the others; ``process_s``, that of all; ``wall_s``; ``ratio`` and
``wall_ratio`` of one thread to these; ``difference`` of the displacements, relative to the largest. Cases:

* ``factor``: one cube of ``--cells``^3 linear hexahedra, held and pulled: order, factor and solution;
* ``bodies``: the chain of 16 cubes of ``scaling.py``, all joints kept, from the matrices of the parts on;
* ``friction``: the chain of 64 cubes of ``many_parts.py`` whose every fourth joint rubs;
* ``flange``: ``demos/flange_from_step.py`` with cells of ``--size`` mm, all steps of its tightening.

``numbers``: of each matrix ``unknowns``, ``gflop`` of its factor and, after the same analysis on one thread,
of ``cholmod`` and of ``kernel``: ``..._s`` (processor time, the least of some runs), ``..._gb`` beyond what
was there, ``..._backward`` error of a solution, row by row, and ``..._failed``, the column of a pivot that
was not positive (-1: none); ``difference`` of the two factors, relative to the largest number.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

import common
import numpy as np
import scaling
import scipy.sparse as sp

from dolfinx_frontend import (
    Amplitude,
    Elastic,
    LinearElastic,
    Options,
    Perfect,
    Scene,
    assemble,
    geometry,
    reference,
    solve,
)
from tests.verification import test_macro

THREADS = (1, 2)
Call = Callable[[], Any]
"""What is timed: returns a result, whose displacements are compared."""


def factor(given: argparse.Namespace) -> Call:
    """A cube on its own."""
    scene = Scene()
    scene.substructure("cube", scaling.block(0, given.cells), LinearElastic(E=200e3, nu=0.3), degree=1)
    scene.fix("cube:x0")
    scene.traction("cube:x1", (100.0, 10.0, 0.0))
    problem = assemble(scene)
    return lambda: solve(problem, progress=False)


def bodies(given: argparse.Namespace) -> Call:
    """Parts side by side."""
    joints = [f"joint{k}" for k in range(scaling.PARTS - 1)]
    problem = assemble(scaling.chain(given.part_cells, False))
    return lambda: solve(problem, active=joints, options=Options(rtol=1e-8), progress=False)


def friction(_: argparse.Namespace) -> Call:
    """A chain that rubs."""
    problem = test_macro.rubbing(64)
    return lambda: test_macro.cut(problem, rtol=3e-7)


def flange(given: argparse.Namespace) -> Call:
    """The bolts of the demo tightened in turn."""
    demo = common.demo("flange_from_step")
    shape = demo.FlangeShape()
    steps = demo.schedule(3)
    on = Amplitude([float(len(steps)), len(steps) + 1.0], [0.0, 1.0])
    with tempfile.TemporaryDirectory() as folder:
        step = demo.read(demo.make_flange(Path(folder) / "flange.step", shape), shape, given.size)
        problem = assemble(demo.loaded(step, step.mesh(), shape, on))
    problem = problem.with_laws(demo.bolt_laws(steps))
    times = np.arange(1.0, len(steps) + 2.0)
    options = Options(rtol=1e-8, max_iterations=1000)
    return lambda: solve(problem, times=times, options=options, progress=False)


CASES: dict[str, Callable[[argparse.Namespace], Call]] = {
    "factor": factor,
    "bodies": bodies,
    "friction": friction,
    "flange": flange,
}


def thread_times() -> dict[str, float]:
    """Processor time of every thread of this process so far (Linux)."""
    tick = float(os.sysconf("SC_CLK_TCK"))
    found = {}
    for task in Path("/proc/self/task").iterdir():
        # behind the name, which may have anything in it, user and system time are numbers 12 and 13
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        found[task.name] = (float(fields[11]) + float(fields[12])) / tick
    return found


def work(case: str, file: Path, given: argparse.Namespace) -> None:
    """What the process of a number of threads does."""
    call = CASES[case](given)
    before, spent, began = thread_times(), process_time(), perf_counter()
    result = call()
    fields = result.displacements
    found = {"wall_s": perf_counter() - began, "process_s": process_time() - spent}
    found["busy_s"] = max(after - before.get(name, 0.0) for name, after in thread_times().items())
    found |= {"unknowns": result.problem.size, "iterations": result.iterations, "status": result.status}
    np.savez(file, found=json.dumps(found, default=float), **fields)


def of_threads(case: str, counts: list[int], given: argparse.Namespace) -> list[dict[str, Any]]:
    """A row for each number of threads."""
    rows: list[dict[str, Any]] = []
    exact: dict[str, Any] = {}
    for threads in counts:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "answer.npz"
            number = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
            call = [sys.executable, __file__, "--work", case, str(file), "--cells", str(given.cells)]
            call += ["--part-cells", str(given.part_cells), "--size", str(given.size)]
            subprocess.run(call, env={**os.environ, **number}, check=True)
            fields = dict(np.load(file))
        row = {"case": case, "threads": threads} | json.loads(str(fields.pop("found")))
        exact = exact or fields
        rows.append(row)
        row["ratio"] = rows[0]["busy_s"] / row["busy_s"]
        row["wall_ratio"] = rows[0]["wall_s"] / row["wall_s"]
        largest = max(np.abs(u).max() for u in exact.values())
        row["difference"] = float(max(np.abs(fields[name] - u).max() for name, u in exact.items()) / largest)
        print(row, flush=True)
    return rows


class Cubes(NamedTuple):
    """Two cubes or squares of unit size side by side, glued, the first one held."""

    dimensions: int
    cells: int
    degree: int
    stiffness: float = 1.0
    """Modulus of the second one, that of the first is 1."""
    hold: float | None = None
    """Springs that hold the first one; None: it is fixed."""

    def matrix(self) -> Any:
        """The assembled stiffness."""
        scene = Scene()
        cell = "hexahedron" if self.dimensions == 3 else "quadrilateral"
        more = (0.0,) * (self.dimensions - 1)
        for k, modulus in enumerate((1.0, self.stiffness)):
            lengths, counts = (1.0,) * self.dimensions, (self.cells,) * self.dimensions
            box = geometry.box(lengths, counts, origin=(float(k), *more), cell=cell)
            scene.substructure(f"b{k}", box, LinearElastic(E=modulus, nu=0.3), degree=self.degree)
        scene.interface("glue", "b0:x1", "b1:x0", Perfect())
        if self.hold is None:
            scene.fix("b0:x0")
        else:
            scene.interface("bed", "b0:x0", Elastic(normal=self.hold, tangential=self.hold))
        problem = assemble(scene, progress=lambda line: None)
        [(_, matrix, _)] = reference.Monolithic(problem).systems(problem.laws())
        return matrix


MATRICES = {
    "squares": Cubes(2, 15, 1),
    "squares, quadratic": Cubes(2, 50, 2),
    "squares, finer": Cubes(2, 110, 2),
    "cubes": Cubes(3, 5, 1),
    "cubes, finer": Cubes(3, 11, 1),
    "cubes, quadratic": Cubes(3, 7, 2),
    "cubes, 61 000": Cubes(3, 21, 1),
    "cubes, 141 000": Cubes(3, 28, 1),
    "squares, 1e10 times as stiff": Cubes(2, 40, 2, 1e10),
    "cubes, 1e10 times as stiff": Cubes(3, 7, 2, 1e10),
    "cubes, 1e10 times as soft": Cubes(3, 7, 2, 1e-10),
    "cubes, held by 1e-10": Cubes(3, 7, 2, 1.0, 1e-10),
}


def compiled(folder: Path) -> Path:
    """The program that compares, made of ``_factor.cpp`` and the kernel's sources."""
    program, here = folder / "factor", Path(__file__)
    core = common.ROOT / "latin_core"
    sources = [here.with_name("_factor.cpp"), core / "src/algebra/supernodes.cpp"]
    sources += sorted((core / "src/common").glob("*.cpp"))
    headers = [f"-I{core / 'include'}", *("-I/usr/include/" + each for each in ("eigen3", "suitesparse"))]
    libraries = ["-lcholmod", "-llapack", "-lblas"]
    command = ["mpicxx", "-std=c++20", "-O3", "-DNDEBUG", *headers, *map(str, sources), *libraries]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


def numbers(program: Path, folder: Path) -> list[dict[str, Any]]:
    """A row for each matrix."""
    rows = []
    for name, cubes in MATRICES.items():
        lower = sp.tril(sp.csc_matrix(cubes.matrix()), format="csc")
        lower.eliminate_zeros()
        with (folder / "matrix").open("wb") as file:
            np.array([lower.shape[0]], dtype=np.int64).tofile(file)
            lower.indptr.astype(np.int32).tofile(file)
            lower.indices.astype(np.int32).tofile(file)
            lower.data.astype(np.float64).tofile(file)
        repeats = 3 if lower.shape[0] > 30_000 else 7
        one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        call = [str(program), str(folder / "matrix"), str(repeats)]
        run = subprocess.run(call, stdout=subprocess.PIPE, text=True, env={**os.environ, **one}, check=True)
        rows.append({"matrix": name} | json.loads(run.stdout))
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("threads", __doc__)
    parser.add_argument("--threads", type=int, nargs="*", default=list(THREADS))
    parser.add_argument("--only", nargs="*", default=[*CASES, "numbers"], help="what is run")
    parser.add_argument("--cells", type=int, default=35, help="along an edge of the cube")
    parser.add_argument("--part-cells", type=int, default=7, help="along an edge of a part of the chain")
    parser.add_argument("--size", type=float, default=26.0, help="cells of the flange, mm")
    parser.add_argument("--work", nargs=2, metavar=("CASE", "FILE"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(given.work[0], Path(given.work[1]), given)
        return
    record: dict[str, Any] = {"benchmark": "threads", "commit": common.commit()}
    cases = [case for case in CASES if case in given.only]
    record["threads"] = [row for case in cases for row in of_threads(case, given.threads, given)]
    if "numbers" in given.only:
        with tempfile.TemporaryDirectory() as folder:
            record["numbers"] = numbers(compiled(Path(folder)), Path(folder))
    record["environment"] = common.environment()
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
