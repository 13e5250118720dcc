"""Program of test_mpi.py: checkpoints, results and chaos files of a run over ranks.

``mpirun -n N python mpi_files.py write|kill|raise|resume|some|more|all FOLDER``
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from blocks import WORLD, row
from mpi4py import MPI

from dolfinx_frontend import (
    Contact,
    Elastic,
    LogNormal,
    Options,
    Resultant,
    SceneError,
    assemble,
    io,
    load,
    make_plan,
    monte_carlo,
    solve,
    sweep,
)
from dolfinx_frontend.evaluate import evaluator
from dolfinx_frontend.evaluate import function as functions
from latin_core import CheckpointError

GRID = {"j1.normal": [5.0, 20.0, 80.0], "bed2.tangential": [2.0, 3.0]}
OPTIONS = Options(rtol=1e-10)
LAST = WORLD.size - 1


def joint(k: int) -> Any:
    """Springs and a contact."""
    return Contact(gap=0.01) if k == 2 else Elastic(normal=20.0, tangential=10.0)


def random_joint(k: int) -> Any:
    """Springs, random ones between the first and the second block."""
    return Elastic(normal=LogNormal("k", 20.0, cov=0.2) if k == 1 else 20.0, tangential=10.0)


def function_joint(k: int) -> Any:
    """Random springs and a contact with friction."""
    return Contact(friction=0.4) if k == 2 else Elastic(normal=LogNormal(f"k{k}", 20.0, cov=0.2))


POINTS = [[18.0, 23.0], [20.0, 20.0], [25.0, 15.0]]


def problem(laws: Any = joint, comm: Any = WORLD) -> Any:
    """Four blocks."""
    return assemble(row(laws, [100.0, 200.0, 300.0, 150.0], (-2.0, 0.3)), comm=comm)


def same(found: Any, exact: Any, what: str) -> None:
    """The digits of one rank."""
    off = np.abs(np.asarray(found) - exact).max()
    assert off <= 1e-10 * np.abs(exact).max(), (what, off)


def interrupted(file: Path, how: Any) -> Any:
    """A sweep that ends on the last rank after three points."""
    seen: list[int] = []

    def count(iteration: Any) -> None:
        seen.append(iteration.number)
        begun = sum(now <= before for before, now in zip([99, *seen], seen, strict=False))
        if begun > 3 and WORLD.rank == LAST:
            how()

    return sweep(problem(), GRID, options=OPTIONS, checkpoint=file, callback=count, progress=False)


def stop() -> None:
    """As a mistake in a callback does."""
    raise RuntimeError("only on the last rank")


def kill() -> None:
    """As a machine that is switched off does."""
    os.kill(os.getpid(), signal.SIGKILL)


def resumed(file: Path) -> None:
    """The sweep goes on with what is in the file, to the answers of one rank."""
    spread = problem()
    active = make_plan(spread, vary=["j1", "bed2"], options=OPTIONS).active
    exact = sweep(problem(comm=MPI.COMM_SELF), GRID, options=OPTIONS, active=active, progress=False)

    def again() -> Any:
        return sweep(spread, GRID, options=OPTIONS, checkpoint=file, progress=False)

    swept = again()
    assert swept.converged.all()
    for name in active:
        for one, other in zip(swept.gathered(name), (exact.force(name), exact.jump(name)), strict=True):
            same(one, other, name)
    before = len(swept.points.order)
    assert before < 6, "points of the file are not solved again"
    assert not again().points.order, "all are in the file"
    try:
        sweep(spread, {"j1.normal": [5.0, 21.0]}, options=OPTIONS, checkpoint=file, progress=False)
    except (CheckpointError, SceneError) as error:
        assert "belongs to another run" in str(error) and "grid" in str(error), error
    else:
        raise AssertionError("a checkpoint of another grid")
    print(f"resumed on rank {WORLD.rank}: {before} points left", flush=True)


def some(file: Path) -> None:
    """The first points of a sweep whose interfaces are all active, and of one in which some are not."""

    def begin(name: str, **settings: Any) -> None:
        seen: list[int] = []

        def three(iteration: Any) -> None:
            seen.append(iteration.number)
            if sum(now <= before for before, now in zip([99, *seen], seen, strict=False)) > 2:
                raise StopIteration

        found = sweep(
            problem(), GRID, options=OPTIONS, checkpoint=file.with_name(name), callback=three, progress=False,
            **settings,
        )
        assert 0 < len(found.points.order) < 6

    begin("all", active="all")
    begin("few")
    function = problem(function_joint).function(
        Resultant("j2"), active="all", options=OPTIONS, checkpoint=file.with_name("function")
    )
    function(POINTS[:2])
    function.derivatives(POINTS[0])
    function.close()
    print(f"begun on rank {WORLD.rank}", flush=True)


def goes_on(file: Path, last: bool) -> None:
    """A function is answered from the file of other ranks, and solves from there what is not in it."""
    calls: list[str] = []

    def counted(name: str) -> Any:
        module: Any = evaluator if name == "walked" else functions
        plain = getattr(module, name)
        return mock.patch.object(module, name, lambda *a, **k: calls.append(name) or plain(*a, **k))

    settings: dict[str, Any] = {"active": "all", "options": OPTIONS}
    function = problem(function_joint).function(Resultant("j2"), checkpoint=file, **settings)
    with counted("walked"), counted("derivatives"):
        function(POINTS[:2])
        slopes = function.derivatives(POINTS[0]).values
        assert not calls, calls
        values = function(POINTS)
        assert calls == ([] if last else ["walked"]), calls
    function.close()
    alone = problem(function_joint, MPI.COMM_SELF).function(Resultant("j2"), **settings)
    same(values, alone(POINTS), "values of a function")
    exact = alone.derivatives(POINTS[0]).values
    # slopes of laws are differences, which know the root of the rounding: 1.5e-8
    assert np.abs(slopes - exact).max() < 1e-7 * np.abs(exact).max()


def more(file: Path, last: bool) -> None:
    """The sweeps go on with another number of ranks: with the points that are there, to the digits of one."""
    exact = sweep(problem(comm=MPI.COMM_SELF), GRID, options=OPTIONS, active="all", progress=False)
    seen: list[int] = []

    def once(iteration: Any) -> None:
        seen.append(iteration.number)
        if not last and sum(now <= before for before, now in zip([99, *seen], seen, strict=False)) > 1:
            raise StopIteration

    where = {"options": OPTIONS, "checkpoint": file.with_name("all"), "callback": once, "progress": False}
    swept = sweep(problem(), GRID, active="all", **where)
    solved = len(swept.points.order)
    there = np.flatnonzero(swept.points.iterations >= 0)
    assert 0 < solved < len(there), "points of the file are not solved again"
    assert len(there) == 6 or not last
    for name in ("j1", "j2", "j3", "bed2"):
        for one, other in zip(swept.gathered(name), (exact.force(name), exact.jump(name)), strict=True):
            same(np.reshape(one, (6, -1))[there], np.reshape(other, (6, -1))[there], name)
    worst = swept.points.worst[there]
    assert np.all((worst[:, 1] >= 0) & (worst[:, 1] < len(swept.solver.bodies))), worst
    # interfaces between ranks are active: what was not then has no force in the file
    spread = problem()
    where["checkpoint"] = file.with_name("few")
    lacking = set(make_plan(spread, vary=["j1", "bed2"], options=OPTIONS).active) - {"j1", "j2", "bed2"}
    try:
        sweep(spread, GRID, **where)
    except (CheckpointError, SceneError) as error:
        assert lacking and "active interfaces (the file lacks 'j3')" in str(error), (lacking, error)
    else:
        assert not lacking, lacking
    goes_on(file.with_name("function"), last)
    print(f"gone on with rank {WORLD.rank}", flush=True)


def write(folder: Path) -> None:
    """Results of all kinds, their files read again, against those of one rank."""
    spread, whole = problem(random_joint), problem(random_joint, MPI.COMM_SELF)
    active = (*make_plan(spread).active, "j1", "j3")
    result, exact = (solve(p, options=OPTIONS, active=active) for p in (spread, whole))
    chaos, exact_chaos = (solve(p, chaos=2, options=OPTIONS, active=active) for p in (spread, whole))
    drawn, exact_drawn = (
        monte_carlo(p, 5, options=OPTIONS, active=active, keep_states=True, progress=False)
        for p in (spread, whole)
    )
    answers = {"solve": (result, exact), "chaos": (chaos, exact_chaos), "samples": (drawn, exact_drawn)}
    for name, (one, other) in answers.items():
        one.save(folder / f"{name}.h5")
        WORLD.barrier()
        read = load(folder / f"{name}.h5")
        other.save(folder / f"{name}_{WORLD.rank}.h5")
        alone = load(folder / f"{name}_{WORLD.rank}.h5")
        assert read.status == alone.status and read.known == alone.known
        for interface in alone.known:
            same(read.force(interface), alone.force(interface), f"{name} {interface}")
        for part in whole.substructures:
            same(read.unknowns(part), alone.unknowns(part), f"{name} {part}")
        assert str(read.table()).split()[:8] == str(alone.table()).split()[:8]
    chaos.save_chaos(folder / "chaos_file.h5", ["b0", "b3"])
    WORLD.barrier()
    fields = io.load_chaos(folder / "chaos_file.h5").fields
    wanted, _ = exact_chaos.chaos_fields(["b0", "b3"])
    assert list(fields) == list(wanted), (list(fields), list(wanted))
    for name, each in wanted.items():
        same(fields[name].coefficients, each.coefficients, name)
    try:
        chaos.save_chaos(folder / "nowhere" / "chaos_file.h5")
    except Exception as error:  # its own error on the first rank, what it says on the others
        assert "nowhere" in str(error), error
    else:
        raise AssertionError("a folder that is not there")
    file = folder / "samples.sqlite"
    again = [monte_carlo(spread, 5, options=OPTIONS, checkpoint=file, progress=False) for _ in range(2)]
    assert len(again[0].points.order) == 5 and not again[1].points.order
    same(again[1].gathered("j1")[0], exact_drawn.force("j1"), "samples of a checkpoint")
    print(f"written on rank {WORLD.rank}", flush=True)


def main(what: str, folder: Path) -> None:
    """One of these."""
    faulthandler.dump_traceback_later(100, exit=True)
    if what == "write":
        write(folder)
    elif what == "resume":
        resumed(folder / "sweep.sqlite")
    elif what == "some":
        some(folder / "sweep.sqlite")
    elif what in ("more", "all"):
        more(folder / "sweep.sqlite", what == "all")
    elif what == "raise":
        try:
            interrupted(folder / "sweep.sqlite", stop)
        except Exception as error:
            assert "only on the last rank" in str(error), error
            print(f"raised on rank {WORLD.rank}", flush=True)
    else:
        interrupted(folder / "sweep.sqlite", kill)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
