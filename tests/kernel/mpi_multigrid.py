"""Program of test_mpi.py: bodies without a factor over the ranks, against factors on one rank.

``mpirun -n N python mpi_multigrid.py solve|points|shared|groups|fail``; prints a line a rank. With three
ranks the second one has no part, and groups are of two.
"""

from __future__ import annotations

import faulthandler
import re
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from blocks import RANK, WORLD
from mpi4py import MPI

from dolfinx_frontend import (
    Chaos,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Perfect,
    Resultant,
    Scene,
    SceneError,
    assemble,
    discretisation_error,
    geometry,
    make_plan,
    solve,
    sweep,
)
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.kernel import fitting, multigrid, subspace
from dolfinx_frontend.plan import plan as planning

RTOL = 1e-10
MULTIGRID, TIGHT = Options(backend="multigrid", rtol=RTOL), Options(rtol=1e-12)
JOINT = Elastic(normal=5e3, tangential=2e3, jump=(0.01, 0.0, 0.0))


def stack(comm: Any, law: Any, degree: int = 2, apart: bool = False) -> Any:
    """Four blocks, the last two glued, on elastic ground: pushed, shortened, and pulled down at the end.

    The law is that of the two joints; where ranks are to be `apart` the glue is between them.
    """
    ranks: list[int | None] = [None] * 4
    if comm.size > 1:
        last = comm.size - 1
        ranks = [0, 0, 0, last] if apart else [0, 0, last, last]
    scene = Scene()
    for k in range(4):
        scene.substructure(
            f"b{k}",
            lambda k=k: geometry.box((10.0, 10.0, 10.0), (2, 2, 2), origin=(10.0 * k, 0.0, 0.0)),
            LinearElastic(E=200e3, nu=0.3),
            degree=degree,
            rank=ranks[k],
        )
    scene.interface("ground", "b0:x0", Elastic(normal=2e4, tangential=1e4))
    scene.interface("joint", "b0:x1", "b1:x0", law)
    scene.interface("middle", "b1:x1", "b2:x0", law)
    scene.interface("glue", "b2:x1", "b3:x0", Perfect())
    scene.fix("b3:x1", (0.0, 0.0, -0.01))
    scene.pressure("b1:z1", 20.0)
    return assemble(scene, comm=comm)


def near(found: Any, exact: Any, tolerance: float = 1e-9) -> None:
    size = np.abs(exact).max()
    off = np.abs(np.asarray(found) - np.asarray(exact)).max()
    assert off <= tolerance * size, (off, size)


def solutions() -> None:
    """One answer, by two levels and by aggregation, glue between ranks, and the coefficients of a chaos."""
    for degree in (2, 1):
        exact = solve(stack(MPI.COMM_SELF, JOINT, degree), options=TIGHT)
        found = solve(stack(WORLD, JOINT, degree), options=MULTIGRID)
        assert found.converged and found.error <= RTOL
        size = max(np.abs(u).max() for u in exact.displacements.values())
        for name, u in found.displacements.items():
            assert np.abs(u - exact.displacements[name]).max() <= 1e-9 * size, name
    cost = WORLD.allreduce(make_plan(found.problem).cost.direct)
    planning.available_memory = lambda: 0.9 * cost  # of all ranks together
    choice = {line.what: line for line in make_plan(found.problem).decisions}
    planning.available_memory = available_memory
    assert f"for {WORLD.size} ranks on a machine" in str(choice.get("bodies", choice.get("memory"))), choice
    wanted = Resultant("middle", "force")
    bounds = [discretisation_error(each, wanted).bound for each in (exact, found)]
    assert abs(bounds[1] - bounds[0]) <= 1e-4 * bounds[0], bounds

    torn = solve(stack(WORLD, JOINT, apart=True), options=MULTIGRID.with_(rtol=1e-6))
    exact = solve(stack(MPI.COMM_SELF, JOINT), options=TIGHT)
    assert torn.converged
    for name, u in torn.displacements.items():
        near(u, exact.displacements[name], 1e-6)
    refused = "glue.*'multigrid' at one interface, between elements of degree 2"
    try:
        solve(stack(WORLD, JOINT, degree=1, apart=True), options=MULTIGRID)
    except SceneError as error:
        assert re.search(refused, str(error)), error
    else:
        raise AssertionError(refused)

    random = Elastic(normal=LogNormal("n", 5e3, cov=0.2), tangential=LogNormal("t", 2e3, cov=0.1))
    alone, spread = stack(MPI.COMM_SELF, random), stack(WORLD, random)
    chaos = Chaos(3, check_points=0)
    exact = solve(alone, chaos=chaos, options=TIGHT)
    found = solve(spread, chaos=chaos, options=MULTIGRID, active=exact.plan.active)
    assert found.converged and found.error <= RTOL
    for name in spread.substructures:
        near(found.coefficients(name), exact.coefficients(name))
    print(f"same solutions on rank {RANK}", flush=True)


GRID = {"middle.normal": np.geomspace(1e2, 1e6, 10), "ground.normal": [1e4, 2e4, 8e4]}


def points() -> None:
    """A sweep, where most points come from a basis that few have made, and slopes."""
    alone, spread = stack(MPI.COMM_SELF, JOINT), stack(WORLD, JOINT)
    swept(alone, spread)
    loose = MULTIGRID.with_(rtol=1e-6)
    slopes = [
        problem.function("middle", ["middle.normal"], options=options).gradient([4e3])
        for problem, options in ((alone, TIGHT), (spread, loose))
    ]
    near(slopes[1], slopes[0], 1e-4)
    print(f"same points on rank {RANK}", flush=True)


def swept(alone: Any, spread: Any, rtol: float = 1e-8, **more: Any) -> None:
    """A sweep without factors has the forces of factors on one rank."""
    exact = sweep(alone, GRID, options=TIGHT, progress=False)
    found = sweep(spread, GRID, options=MULTIGRID.with_(rtol=rtol), progress=False, **more)
    assert found.complete and np.all(found.converged) and np.nanmax(found.error) <= rtol
    for name in ("middle", "ground"):
        if name in spread.own.interfaces:
            near(found.force(name), exact.force(name), 100.0 * rtol)


def shared() -> None:
    """Points over ranks that all have the whole problem, some of which ask for more fields."""
    problem = stack(MPI.COMM_SELF, JOINT)
    kept, asked = fitting._far, []

    def fewer(parameters: Any, order: Any) -> Any:
        asked.append(len(order))
        return kept(parameters, order)[:2]

    fitting._far = fewer  # the basis of two points cannot answer all
    swept(problem, problem, rtol=1e-6, points_comm=WORLD)
    fitting._far = kept
    assert len(asked) > 1 and len(set(WORLD.allgather(tuple(asked)))) == 1, asked
    print(f"shared points on rank {RANK}", flush=True)


def groups() -> None:
    """Groups of two ranks that have the problem together, and share the points."""
    group = WORLD.Split(RANK // 2, RANK)
    swept(stack(MPI.COMM_SELF, JOINT), stack(group, JOINT), rtol=1e-6, points_comm=WORLD)
    print(f"grouped points on rank {RANK}", flush=True)


def together(call: Callable[[], Any], reason: str) -> None:
    """All ranks raise; the one that failed first with its own error."""
    error: BaseException | None = None
    try:
        call()
    except Exception as found:
        error = found
    told = WORLD.allgather((type(error).__name__, str(error)))
    assert all(reason in message for _, message in told), told
    assert told[-1][0] == "MemoryError" and told[0][0] != "MemoryError", told


def failures() -> None:
    """What one rank lacks, wherever it does, ends all; afterwards all is as before."""
    problem = stack(WORLD, JOINT)
    grid = {"middle.normal": [1e3, 2e3, 4e3]}
    calls = (
        lambda: solve(problem, options=MULTIGRID),
        lambda: sweep(problem, grid, options=MULTIGRID, progress=False),
    )  # in turn
    places = (
        (subspace.Bodies, "_add_body", 1),
        (fitting._Check, "answer", 2),
        (subspace.Subspace, "with_fields", 3),
        (subspace.Subspace, "residual", 1),
        (multigrid._Levels, "_smooth", 4),
        (multigrid._Levels, "energies", 2),
    )
    for turn, (cls, name, number) in enumerate(places):
        kept, count = getattr(cls, name), 0

        def failing(*args: Any, kept: Any = kept, number: int = number, **more: Any) -> Any:
            nonlocal count
            count += 1
            if count == number and RANK == WORLD.size - 1:
                raise MemoryError("no room here")
            return kept(*args, **more)

        setattr(cls, name, failing)
        try:
            together(calls[turn % 2], "no room here")
        finally:
            setattr(cls, name, kept)
    assert solve(problem, options=MULTIGRID.with_(rtol=1e-4)).converged
    print(f"failed together on rank {RANK}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    for asked in sys.argv[1:]:
        {"solve": solutions, "points": points, "shared": shared, "groups": groups, "fail": failures}[asked]()
