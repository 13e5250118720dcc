"""Program of test_mpi.py: coarse problem, Newton's method and matrix directions, against those of one rank.

``mpirun -n N python mpi_reach.py``
"""

from __future__ import annotations

import faulthandler
import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LinearElastic,
    Options,
    Perfect,
    Scene,
    assemble,
    make_plan,
    solve,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.helpers import block  # noqa: E402

WORLD = MPI.COMM_WORLD
TIMES = [0.5, 1.0, 1.5, 2.0]
BARE = {"newton": 0, "macro": "none", "directions": "diagonal"}


def chain(parts: int, contact: bool, history: bool = False, uneven: bool = False) -> Scene:
    """Blocks end to end, pressed together and sheared: every other joint may slip, or all are linear."""
    scene = Scene()
    for k in range(parts):
        cells = 3 + (k % 2 if uneven else 0)
        stiff = LinearElastic(E=1000.0 * (1 + k % 3), nu=0.3)
        make = lambda k=k, cells=cells: block(  # noqa: E731
            "quadrilateral", (2, cells), (float(k), 0.0), (k + 1.0, 1.0)
        )
        scene.substructure(f"b{k}", make, stiff, degree=2)
    scene.fix("b0:x0")
    for k in range(1, parts):
        law: Any = Elastic(normal=800.0, tangential=300.0) if k % 2 else Perfect()
        law = Contact(friction=0.3) if contact and k % 2 == 0 else law
        scene.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", law)
    push: Any = (-0.05, 0.02)
    if history:
        push = Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 0.5]) * (0.0, 0.02) + np.array([-0.05, 0.0])
    scene.fix(f"b{parts - 1}:x1", push, name="pushed")
    return scene


def same(what: str, scene: Scene, history: bool = False, **settings: Any) -> Any:
    """The answer over the ranks, compared with that of one."""
    options = Options(**({"rtol": 1e-11, "max_iterations": 3000} | settings))
    times: dict[str, Any] = {"times": TIMES} if history else {}
    spread, whole = assemble(scene, comm=WORLD), assemble(scene, comm=MPI.COMM_SELF)
    active = make_plan(spread, options=options, **times).active
    found = solve(spread, options=options, **times)
    exact = solve(whole, options=options, active=active, **times)
    assert found.converged and exact.converged, (what, found, exact)
    size = max(np.abs(u).max() for u in exact.displacements.values())
    off = max((np.abs(u - exact.displacements[n]).max() for n, u in found.displacements.items()), default=0.0)
    assert off <= 1e-10 * size, (what, off / size)
    assert abs(found.iterations - exact.iterations) <= 2, (what, found.iterations, exact.iterations)
    assert found.plan.macro == exact.plan.macro and found.plan.paired == exact.plan.paired
    assert found.solver.macro_size == exact.solver.macro_size
    print(f"{what} on rank {WORLD.rank}: {found.iterations} and {exact.iterations} iterations", flush=True)
    return found


def main() -> None:
    """All of it."""
    faulthandler.dump_traceback_later(100, exit=True)
    diagonal = {"directions": "diagonal"}
    bare = same("bare", chain(8, False), **BARE)
    for moments in ("resultants", "linear"):
        found = same(f"{moments} coarse", chain(8, False), newton=0, macro=moments, **diagonal)
        assert found.solver.macro_size == len(found.plan.macro) * (2 if moments == "resultants" else 4)
    assert found.iterations < 0.5 * bare.iterations, "a coarse problem reaches all parts at once"
    same("coarse with contact", chain(6, True), newton=0, macro="linear", **diagonal)
    found = same("matrix", chain(6, False, uneven=True), newton=0, macro="none", directions="matrix")
    assert len(found.plan.paired) >= WORLD.size - 1
    same("automatic", chain(6, False, uneven=True))
    for history in (False, True):  # with the dense flexibility of the interfaces, and without
        scene, name = chain(5, True, history), "history" if history else "static"
        same(f"{name} dense newton", scene, history, **diagonal)
        found = same(f"{name} newton", scene, history, operator="factored", macro="linear", **diagonal)
    same("all", chain(6, True, uneven=True))
    print(f"all reached on rank {WORLD.rank}", flush=True)


if __name__ == "__main__":
    main()
