"""Program of test_mpi.py: calls and arguments that differ between two ranks, and ranks without parts.

``mpirun -n N python mpi_agree.py differ|refused|idle|check|fail``; prints a line a rank.
"""

from __future__ import annotations

import faulthandler
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from blocks import RANK, WORLD, row
from mpi4py import MPI

from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    RandomField,
    Response,
    Scene,
    SceneError,
    UserLaw,
    assemble,
    calibrate,
    discretisation_error,
    geometry,
    io,
    make_plan,
    monte_carlo,
    reliability,
    sample,
    screen,
    solve,
    sparse_quadrature,
    sweep,
    tensor_quadrature,
)


def chain(
    law: Any, count: int = 2, comm: Any = WORLD, loads: Any = (-2.0, 0.3), modulus: float = 200.0
) -> Any:
    """Blocks in a row on a soft bed, pushed from the right."""
    return assemble(row(lambda _: law, [modulus] * count, loads), comm=comm)


def raises(call: Callable[[], Any], *messages: str) -> None:
    """All ranks raise, and the message says what differs."""
    error = ""
    try:
        call()
    except SceneError as found:
        error = str(found)
    told = WORLD.allgather(error)  # on the user's communicator: nothing of the failed call is left in it
    assert all(m in each for m in messages for each in told), (messages, told)


TOLD = "force, its defaults = (1.0,) in <function <lambda>, line "


def differ() -> None:
    """What differs is raised on all ranks, whatever it is, and the next call works."""
    stiff, soft = Elastic(normal=100.0, tangential=50.0), Elastic(normal=100.0 + RANK, tangential=50.0)
    raises(lambda: chain(soft), "assemble", "the law of interface 'j1' differs", "101")
    raises(lambda: chain(stiff, modulus=200.0 + RANK), "material of substructure 'b0' differs")
    raises(lambda: chain(stiff, count=2 + RANK), "the list of substructures differs")
    raises(lambda: chain(Elastic(normal=np.array([1.0, 2.0 + RANK]), tangential=1.0)), "'j1' differs")
    # functions are the same if their code and what they enclose is
    chain(UserLaw(force=lambda jump: 100.0 * jump, name="linear"))
    varied = UserLaw(force=lambda jump, c=1.0 + RANK: c * jump, name="linear")
    raises(lambda: chain(varied), "'j1' differs", TOLD)
    chain(stiff, loads=lambda x: 0.01 * x)

    problem = chain(Elastic(normal=LogNormal("k", 100.0, cov=0.2), tangential=50.0), count=4)
    raises(lambda: solve(problem, options=Options(rtol=1e-4 * (1 + RANK))), "options differs")
    raises(lambda: solve(problem.with_laws({"j2": soft})), "the law of interface 'j2' differs")
    raises(lambda: solve(problem, chaos=2 if RANK else None), "chaos differs", "None on rank 0, 2 on rank 1")
    raises(lambda: solve(problem, accuracy=1e-3, quantity=f"j{1 + RANK}"), "quantity differs", "'j2'")
    raises(lambda: sweep(problem, {"j1.tangential": [10.0, 20.0 + RANK]}), "sweep: grid differs")
    raises(lambda: monte_carlo(problem, 4, seed=RANK), "monte_carlo: seed differs")
    result = solve(problem, chaos=2)
    raises(lambda: result.truncation(f"j{1 + RANK}"), "truncation: interface differs")
    raises(lambda: result.errors(f"j{1 + RANK}"), "errors: quantity differs")
    raises(lambda: result.table(step=RANK), "table: step differs", "0 on rank 0, 1 on rank 1")
    raises(lambda: result.table(about=(0.0, 1.0 * RANK)), "table: about differs")
    raises(lambda: result.table(quantiles=[0.5, 0.9][: 1 + RANK]), "table: quantiles differs")
    raises(lambda: result.table(f"j{1 + RANK}"), "table: interfaces differs")
    raises(lambda: result.table(samples=4 + RANK), "table: samples differs")
    raises(lambda: result.bolts() if RANK else result.table(), "rank 0 calls table, rank 1 calls bolts")
    raises(lambda: result.truncation("j1", points=RANK + 1), "truncation: points differs")
    joints = "gathered: rank 0 asks for interface 'j1', rank 1 asks for interface 'j2'"
    raises(lambda: result.gathered(f"j{1 + RANK}"), joints)
    raises(lambda: solve(problem) if RANK else result.gathered("j1"), "calls gathered, rank 1 calls solve")
    function = problem.function("j1")
    raises(lambda: function([100.0 + RANK]), "the function: points differs")
    raises(lambda: function.gradient([90.0]) if RANK else function([90.0]), "rank 1 calls gradient")
    raises(lambda: calibrate(problem, "j1", [1.0 + RANK], 0.1), "calibrate: data differs")
    raises(lambda: screen(problem, f"j{1 + RANK}"), "screen: quantities differs")
    whole = chain(Elastic(normal=LogNormal("k", 100.0, cov=0.2), tangential=50.0), comm=MPI.COMM_SELF)
    shared: dict[str, Any] = {"points_comm": WORLD}
    raises(lambda: monte_carlo(whole, 20 + RANK, **shared), "monte_carlo: samples differs", "21 on rank 1")
    raises(lambda: sample(whole, [[0.1 * RANK]], **shared), "sample: germs differs")
    grid = {"j1.tangential": [10.0, 20.0]}
    raises(
        lambda: sweep(whole, grid, **shared) if RANK else monte_carlo(whole, 20, **shared),
        "rank 0 calls monte_carlo, rank 1 calls sweep",
    )
    event = Response("j1") > 1.0 + RANK
    raises(lambda: reliability(whole, event, **shared), "reliability: event differs")
    raises(lambda: result.errors() if RANK else solve(problem), "rank 0 calls solve, rank 1 calls errors")
    raises(lambda: result.truncation("bed1"), "interface 'bed1' was eliminated")
    # interfaces that touch one rank only, from all
    for name in ("j1", "j2", "j3"):
        told = WORLD.allgather(str(result.truncation(name, points=2)))
        assert told[0] == told[-1], told
        told = WORLD.allgather(str(result.errors(name)))
        assert told[0] == told[-1], told

    own = WORLD.Dup()
    mine = chain(stiff, comm=own)
    assert mine.comm != own and MPI.Comm.Compare(mine.comm, own) == MPI.CONGRUENT
    assert chain(stiff, comm=own).comm == mine.comm, "one duplicate of a communicator"
    own.Free()
    assert mine.comm == MPI.COMM_NULL, "freed with the user's"


def refused() -> None:
    """What one rank alone is refused, all are, whatever they were about to do; the next call works."""
    problem = chain(Elastic(normal=LogNormal("k", 100.0, cov=0.2), tangential=50.0), count=4)
    result, run = solve(problem, chaos=2), solve(problem)
    bad, grid = RANK == 1, {"j1.tangential": [10.0, 20.0]}

    def one(value: Any, good: Any = None) -> Any:
        return value if bad else good

    raises(lambda: sweep(problem, grid, outputs=one(5)), "outputs = 5")
    raises(lambda: sweep(problem, one(7, grid)), "grid = 7")
    raises(lambda: sweep(problem, grid, callback=one(3)), "callback = 3")
    raises(lambda: sweep(problem, grid, checkpoint=one("c.sqlite")), "checkpoint differs")
    raises(lambda: problem.export(one(5, "never")), "path = 5")
    raises(lambda: problem.export(f"never{RANK}"), "folder differs")
    outputs = {"q": lambda f: [1 / (1 - RANK)]}
    raises(lambda: sweep(problem, grid, outputs=outputs), "'q'", "ZeroDivisionError")
    raises(lambda: solve(problem, meshes=one(5, True)), "meshes = 5")
    raises(lambda: solve(problem, progress=one(5, True)), "progress = 5")
    raises(lambda: solve(problem, start=one(5)), "start = 5")
    raises(lambda: solve(problem, plan=one(5)), "plan = 5")
    raises(lambda: monte_carlo(problem, one(-4, 4)), "-4")
    raises(lambda: monte_carlo(problem, 4, keep_states=one(5, False)), "keep_states = 5")
    raises(lambda: sample(problem, one([[1.0, 2.0, 3.0]], [[0.5]])), "points of shape (1, 3)")
    raises(lambda: tensor_quadrature(problem, one(0, 2)), "points = 0")
    raises(lambda: sparse_quadrature(problem, one("x", 1)), "level = 'x'")
    raises(lambda: result.monte_carlo(one(-4, 4)), "-4")
    raises(lambda: result.monte_carlo(2, rtol=one(-1.0)), "rtol = -1")
    raises(lambda: result.truncation("j1", points=one(-1, 2)), "points = -1")
    raises(lambda: run.errors(one(5)), "5")
    raises(lambda: run.tightened(one(-1.0, 1e-6)), "rtol = -1")
    raises(lambda: discretisation_error(run, step=one(9, -1)), "9")
    raises(lambda: make_plan(problem, one("magic", "auto")), "'magic'")
    raises(lambda: assemble(row(lambda _: Contact(), [1.0], (0.0, 0.0)), progress=one(5), comm=WORLD), "5")
    raises(lambda: io.write(run, one(5, "never")), "folder = 5")
    raises(lambda: io.write(run, f"never{RANK}"), "folder differs", "never1")
    raises(lambda: io.write(result, "never", modes=one((1,), ())), "modes differs")
    raises(lambda: io.write_fields(run, "never.vtm", step=one(4, -1)), "4")
    raises(lambda: io.write_interfaces(run, "never.vtm", interfaces=one("j9")), "interfaces differs", "'j9'")
    assert solve(problem).converged and run.tightened(1e-7).converged

    # a callback that fails on one rank ends all; the other is told, and the next call works
    def only_here(iteration: Any) -> None:
        if bad:
            raise RuntimeError("only here")

    for call in (solve, lambda p, **k: sweep(p, grid, **k), lambda p, **k: monte_carlo(p, 2, **k)):
        try:
            call(problem, callback=only_here)
        except RuntimeError as error:
            assert "only here" in str(error) and ("rank 1" in str(error) or bad), error
        else:
            raise AssertionError(call)
        assert solve(problem).converged
    # a quantity is read where its interface is; elsewhere it is refused, and nobody waits
    told = ""
    try:
        run.quantity(lambda fields: fields.force("j3").max(axis=(1, 2)))
    except SceneError as error:
        told = str(error)
    assert ("is on rank 1" in told) == (not bad), told
    loose = Options(rtol=one(1e-4, 1e-5))
    raises(lambda: solve(problem, options=loose), "options differs", "rtol = 0.0001 on rank 1")

    elsewhere = next(n for n in problem.parts if n not in problem.substructures)
    for read in (run.displacement, run.stress, run.std):
        try:
            read(elsewhere)
        except SceneError as error:
            assert f"is on rank {1 - RANK}, this is rank {RANK}" in str(error), error
        else:
            raise AssertionError(elsewhere)

    own = WORLD.Dup()
    mine = chain(Contact(), comm=own)
    own.Free()
    raises(lambda: chain(Contact(), comm=own), "comm")
    try:
        solve(mine)
    except SceneError as error:
        assert "has been freed" in str(error), error


def idle() -> None:
    """More ranks than parts: quiet, and the digits of one rank."""
    options = Options(rtol=1e-10, newton=0, macro="none", directions="diagonal", max_iterations=1000)
    laws = (Elastic(normal=LogNormal("k", 100.0, cov=0.2), tangential=50.0), Contact())
    for law, extra in zip(laws, ({"chaos": 2}, {}), strict=True):
        problem, alone = chain(law), chain(law, comm=MPI.COMM_SELF)
        found = solve(problem, options=options, **extra)
        exact = solve(alone, options=options, active=found.plan.active, **extra)
        assert found.converged and exact.converged
        assert abs(found.iterations - exact.iterations) <= 1, (found, exact)
        assert len(found.displacements) == len(problem.substructures)
        for name, u in found.displacements.items():
            assert np.abs(u - exact.displacements[name]).max() < 1e-9 * np.abs(u).max()
        told = WORLD.allgather((str(found.errors("j1")), str(found.table()), found.error))
        assert all(each == told[0] for each in told), told
    result = solve(chain(laws[0]), accuracy=1e-3, quantity="j1")
    assert len(set(WORLD.allgather((result.modes, result.error)))) == 1


def checked() -> None:
    """An estimate is checked on several ranks as on one: a light part hides from neither.

    The last block is pushed by a force 1e-5 times those on the first ones, through a gap that it has to
    close: an estimate of all parts together is below the tolerance at once.
    """
    scene = Scene()
    for k, (x, load) in enumerate(((0.0, 10.0), (1.0, 10.0), (3.0, -1e-4))):
        scene.substructure(
            f"b{k}",
            lambda x=x: geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0)),
            LinearElastic(E=1000.0, nu=0.3),
            degree=1,
            body_force=(load, 0.0),
        )
    scene.fix("b0:x0", name="wall")
    scene.interface("joint", "b0:x1", "b1:x0", Elastic(normal=500.0, tangential=500.0))
    scene.interface("stop", "b2:x0", Contact(gap=1e-6))
    scene.interface("bed", "b2:y0", Elastic(normal=1e-2, tangential=1e-3))
    options = Options(rtol=1e-3, newton=0, macro="none", directions="diagonal")
    ended = []
    for comm in (WORLD, MPI.COMM_SELF):
        result = solve(assemble(scene, comm=comm), options=options, active="all")
        problem = result.problem
        weights = problem.interfaces["stop"].weights
        moved = float(weights @ result.gathered("stop")[1][:, 0] / weights.sum())
        force = float(weights @ result.gathered("stop")[0][:, 0])
        ended.append((result.status, result.iterations, result.error))
        assert result.converged, result
        # the springs of the bed carry what they are moved by, the stop the rest
        expected = -1e-4 + 1e-3 * 1e-6
        assert abs(force - expected) < 3e-3 * abs(expected), (comm.size, force, expected)
        assert abs(moved + 1e-6) < 3e-3 * 1e-6, (comm.size, moved)
    one, other = ended
    assert one[:2] == other[:2] and abs(one[2] - other[2]) <= 1e-5 * other[2], ended


def failing() -> None:
    """A body of the last rank with an indefinite random field fails between reductions: on all ranks."""
    field = RandomField("E", 150.0, cov=0.7, length=8.0, modes=2)
    made = row(lambda k: Elastic(normal=20.0, tangential=10.0), [100.0, 200.0, 300.0, field], (-2.0, 0.3))
    problem = assemble(made, comm=WORLD)
    seen = np.linalg.eigvalsh
    np.linalg.eigvalsh = lambda matrix: np.ones(len(matrix))  # the frontend, which refuses it, looks away
    text = ""
    try:
        solve(problem, chaos=4, active=["j1", "j2", "j3"])
    except RuntimeError as error:
        text = str(error)
    finally:
        np.linalg.eigvalsh = seen
    told = WORLD.allgather(text)
    assert all("random field is not positive definite" in each for each in told), told


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    faulthandler.dump_traceback_later(100, exit=True)
    for each in sys.argv[1:]:
        {"differ": differ, "refused": refused, "idle": idle, "check": checked, "fail": failing}[each]()
        print(f"{each}: agreed on rank {RANK}", flush=True)
