"""Cost against the number of parts where every interface is kept: a chain that rubs, a wall of bricks.

``./run bench many_parts --json FILE`` writes ``friction``, a chain of cubes whose every fourth joint has
friction, opens at its edges and slips, and ``wall``, square bricks in rows and columns with a spring layer in
every joint, held at its foot and sheared at its top. Of each number of ``parts``: ``dof``; ``iterations``;
``seconds`` of a solution, from the matrices of the parts on (processor time; of a chain the median of three,
of a wall one run); ``unit_s``, one direct solution of the assembled structure (of the chain with springs in
its contacts) in the same time, and ``units``; ``error``, true, in the energy norm: of a chain against an
answer to ``reference_error`` (up to 256 parts; then ``estimate``), of a wall against the direct solution (if
it is small);
``assembly_s`` and ``peak_gb``, of the whole process.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
from collections.abc import Callable
from time import process_time
from typing import Any, TypeVar

import common
import contact

from dolfinx_frontend import (
    Elastic,
    LinearElastic,
    Options,
    Problem,
    Scene,
    assemble,
    geometry,
    reference,
    solve,
)
from tests.verification import test_macro

FRICTION = (8, 16, 32, 64, 128, 256, 512)
WALL = (64, 256, 1024, 4096)
COMPARED = 256  # parts up to which a chain is compared with another answer
DIRECT_UP_TO = 100_000  # unknowns up to which a wall is compared with the direct solution

T = TypeVar("T")


def timed(call: Callable[[], T], repeats: int) -> tuple[T, float]:
    """What a call returns, and the median of its processor times."""
    seconds = []
    for _ in range(repeats):
        began = process_time()
        value = call()
        seconds.append(process_time() - began)
    return value, statistics.median(seconds)


def unit(problem: Problem, repeats: int) -> float:
    """Processor time of one direct solution of the assembled structure, by the faster of two solvers."""
    found = []
    for solver in ("cholmod", "mumps"):

        def direct(solver: str = solver) -> None:
            for _, matrix, load in reference.Monolithic(problem).systems(problem.laws()):
                reference.Cholesky(matrix, solver).solve(load, refine=False)

        direct()
        found.append(timed(direct, repeats)[1])
    return min(found)


def rubbing(parts: int) -> dict[str, Any]:
    """A chain in which every fourth joint has friction and opens, all interfaces kept."""
    began = process_time()
    problem = test_macro.rubbing(parts)
    record: dict[str, Any] = {"parts": parts, "dof": problem.size, "assembly_s": process_time() - began}
    record["unit_s"] = unit(contact.with_springs(problem), 3)
    test_macro.cut(problem, rtol=3e-7)
    run, record["seconds"] = timed(lambda: test_macro.cut(problem, rtol=3e-7), 3)
    record |= {"iterations": run.iterations, "status": run.status, "spent": run.spent()}
    if parts > COMPARED:
        return record | {"estimate": run.error}
    # a slender chain has fewer digits (2e-8 of 64 parts)
    exact = solve(problem, options=Options(rtol=1e-10 if parts <= 32 else 3e-8, max_iterations=2000))
    record |= {"reference_status": exact.status, "reference_error": exact.error}
    return record | {"error": reference.energy_difference(problem, run, exact)}


def bricks(rows: int) -> Problem:
    """A square wall: as many bricks in a row as there are rows."""
    scene = Scene()
    for i in range(rows):
        for j in range(rows):
            brick = geometry.box((1.0, 1.0), (2, 2), origin=(float(j), float(i)), cell="quadrilateral")
            scene.substructure(f"b{i}_{j}", brick, LinearElastic(E=200e3, nu=0.3), degree=2)
    mortar = Elastic(normal=1e6, tangential=4e5)
    for i in range(rows):
        for j in range(rows):
            if j:
                scene.interface(f"h{i}_{j}", f"b{i}_{j - 1}:x1", f"b{i}_{j}:x0", mortar)
            if i:
                scene.interface(f"v{i}_{j}", f"b{i - 1}_{j}:y1", f"b{i}_{j}:y0", mortar)
    for j in range(rows):
        scene.fix(f"b0_{j}:y0", name=f"foot{j}")
        scene.traction(f"b{rows - 1}_{j}:y1", (1.0, -2.0), name=f"push{j}")
    return assemble(scene, progress=lambda line: None)


def wall(parts: int) -> dict[str, Any]:
    """A wall with a spring layer in every joint, all of them kept."""
    began = process_time()
    problem = bricks(round(parts**0.5))
    record: dict[str, Any] = {"parts": parts, "dof": problem.size, "assembly_s": process_time() - began}
    active = [name for name in problem.interfaces if name[0] in "hv"]
    options = Options(rtol=1e-6, max_iterations=3000)
    run, record["seconds"] = timed(lambda: solve(problem, active=active, options=options, progress=False), 1)
    record |= {"iterations": run.iterations, "status": run.status, "estimate": run.error}
    record["spent"] = run.spent()
    if problem.size <= DIRECT_UP_TO:  # its Python is slow with thousands of parts
        record["unit_s"] = unit(problem, 1)
        record["error"] = reference.energy_error(problem, run.displacements, reference.monolithic(problem).u)
    return record


def one(kind: str, parts: int) -> dict[str, Any]:
    """One line, in a process that does nothing else."""
    command = [sys.executable, __file__, "--one", kind, str(parts)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{kind} of {parts} parts failed:\n{done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    if "unit_s" in found:
        found["units"] = found["seconds"] / found["unit_s"]
    error = "-" if "error" not in found else f"{found['error']:.1e}"
    print(
        f"{kind:9} {parts:6} parts {found['dof']:8} unknowns {found['iterations']:5} iterations "
        f"{found['seconds']:8.3g} s {found.get('units', float('nan')):6.2f} units  error {error}  "
        f"{found['peak_gb']:.2f} GB",
        flush=True,
    )
    return found


def main() -> None:
    """Measure, print and write."""
    parser = common.parser("many_parts", __doc__)
    parser.add_argument("--friction", nargs="*", type=int, default=list(FRICTION))
    parser.add_argument("--wall", nargs="*", type=int, default=list(WALL), help="squares of whole numbers")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        kind, parts = given.one[0], int(given.one[1])
        found = rubbing(parts) if kind == "friction" else wall(parts)
        peak = 1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(json.dumps(found | {"peak_gb": peak}, default=float))
        return
    record: dict[str, Any] = {"benchmark": "many_parts", "commit": common.commit()}
    record["friction"] = [one("friction", parts) for parts in given.friction]
    record["wall"] = [one("wall", parts) for parts in given.wall]
    common.write_json(record | {"environment": common.environment()}, given.json)


if __name__ == "__main__":
    main()
