"""Program of test_mpi_points.py: points of one problem over ranks that have all of it, or groups of two.

``mpirun -n N python mpi_points.py same|function FOLDER|groups|stop FOLDER|refuse|kill FILE|resume FILE``;
prints a line a rank.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from blocks import RANK, WORLD, row
from mpi4py import MPI

from dolfinx_frontend import (
    Contact,
    Elastic,
    LogNormal,
    Options,
    Problem,
    Response,
    SceneError,
    assemble,
    monte_carlo,
    quasi_monte_carlo,
    reliability,
    sparse_quadrature,
    sweep,
    tensor_quadrature,
)

TIGHT = Options(rtol=1e-12)
SAME = 1e-10


def scene(kind: str, modulus: float = 200.0) -> Any:
    """Three blocks; a random bearing before a contact with random friction, or before another bearing."""
    first = Elastic(normal=LogNormal("K", 60.0, cov=0.3), tangential=40.0)
    second: Any = Elastic(normal=LogNormal("L", 50.0, cov=0.3), tangential=40.0)
    if kind == "friction":
        second = Contact(gap=0.0, friction=LogNormal("F", 0.3, cov=0.2))
    return row(lambda k: first if k == 1 else second, [modulus, 300.0, 100.0], (-2.0, 0.3))


def made(kind: str, comm: Any = MPI.COMM_SELF) -> Problem:
    """Assembled, on every rank by itself."""
    return assemble(scene(kind), comm=comm)


def apart(one: Any, other: Any) -> float:
    """Largest difference of the forces on joints and beds, relative to the largest force."""
    names = [name for name in one.plan.active if name in other.plan.active]
    size = max(np.abs(one.force(name)).max() for name in names)
    return max(float(np.abs(one.force(name) - other.force(name)).max() / size) for name in names)


def same() -> None:
    """Every kind of points has the digits of one rank, and of one rank that takes shares."""
    grid = {"j1.normal": np.linspace(40.0, 80.0, 6).tolist(), "j2.friction": [0.1, 0.2, 0.3, 0.4, 0.5]}
    for kind in ("linear", "friction"):
        problem = made(kind)
        calls = [
            lambda more, p=problem: monte_carlo(p, 100, options=TIGHT, **more),
            lambda more, p=problem: monte_carlo(p, 5, options=TIGHT, **more),
            lambda more, p=problem: quasi_monte_carlo(p, 64, options=TIGHT, **more),
            lambda more, p=problem: tensor_quadrature(p, 5, options=TIGHT, **more),
            lambda more, p=problem: sparse_quadrature(p, 2, options=TIGHT, **more),
        ]
        if kind == "friction":
            # what is read is as large as a force, so that its digits are those of a force
            calls += [
                lambda more, p=problem: sweep(p, grid, options=TIGHT, **more),
                lambda more, p=problem: sweep(
                    p, grid, options=TIGHT, outputs={"f": lambda b: b.force("j2")[:, 0]}, **more
                ),
            ]
        for call in calls:
            alone = call({})
            spread = call({"points_comm": WORLD})
            shared = call({"points_comm": MPI.COMM_SELF})
            assert spread.status == "converged" and spread.complete, spread
            assert apart(alone, spread) < SAME and apart(shared, spread) < SAME, (kind, alone)
            told = WORLD.allgather(spread.points.iterations.tolist())
            assert all(each == told[0] for each in told)
            for name, values in alone.points.outputs.items():
                other = spread.points.outputs[name]
                assert np.abs(other - values).max() < SAME * np.abs(values).max()
        solved = WORLD.allgather(len(monte_carlo(problem, 100, points_comm=WORLD).points.order))
        assert sum(solved) == 100 and min(solved) > 0, solved
    print(f"same points on rank {RANK}", flush=True)


def function(folder: Path) -> None:
    """A function and a probability are those of one rank; so are gradients, and what a file has answered."""
    problem = made("friction")
    alone, spread = (
        problem.function("j2", options=TIGHT, **more) for more in ({}, {"points_comm": WORLD})
    )
    x = alone.nominal * np.random.default_rng(1).uniform(0.8, 1.2, (60, 2))
    assert np.abs(alone(x) / spread(x) - 1.0).max() < SAME
    assert np.abs(alone.gradient(x[:2]) / spread.gradient(x[:2]) - 1.0).max() < 1e-6
    force = Response("j2") < -16.74
    tight: dict[str, Any] = {"options": TIGHT}
    exact = reliability(problem, force, cov=0.2, **tight)
    found = reliability(problem, force, cov=0.2, points_comm=WORLD, checkpoint=folder / "found", **tight)
    again = reliability(problem, force, cov=0.2, points_comm=WORLD, checkpoint=folder / "found", **tight)
    told = WORLD.allgather(found.probability.value)
    assert all(each == told[0] for each in told), told
    assert found.method == exact.method and found.runs == exact.runs
    assert abs(found.probability.value / exact.probability.value - 1.0) < 1e-6, (found, exact)
    assert again.probability.value == found.probability.value
    print(f"same function on rank {RANK}", flush=True)


def groups() -> None:
    """Two groups of two ranks, each with the problem spread over its ranks."""
    group = WORLD.Split(RANK // 2, RANK)
    options = TIGHT.with_(rtol=1e-11, newton=0, macro="none", directions="diagonal")
    active = ["j1", "j2"]
    whole = monte_carlo(made("linear"), 40, options=options, active=active)
    spread = monte_carlo(made("linear", group), 40, options=options, active=active, points_comm=WORLD)
    for name in active:
        def read(name: str = name) -> Any:
            return spread.force(name)

        force = spread.everywhere(name, read)
        assert np.abs(force - whole.force(name)).max() < 1e-9 * np.abs(whole.force(name)).max()
    print(f"same groups on rank {RANK}", flush=True)


def stop(folder: Path) -> None:
    """A rank that raises ends all with its reason; what is finished stays, and the same call goes on."""
    problem, last = made("friction"), WORLD.size - 1
    file = folder / "points"

    def failing(error: type[Exception], after: int) -> Any:
        count = 0

        def callback(_: Any) -> None:
            nonlocal count
            count += 1
            if RANK == last and count > after:
                raise error("only here")

        return callback

    told = ""
    try:
        monte_carlo(
            problem, 200, options=TIGHT, points_comm=WORLD, checkpoint=file, callback=failing(KeyError, 75)
        )
    except KeyError as error:
        assert RANK == last
        told = str(error)
    except SceneError as error:
        assert RANK != last and f"rank {last} failed: KeyError" in str(error), error
        told = str(error)
    assert "only here" in told
    part = monte_carlo(
        problem, 200, options=TIGHT, points_comm=WORLD, checkpoint=file, callback=failing(StopIteration, 10)
    )
    assert not part.complete and part.finished.any()
    assert len(set(WORLD.allgather(int(part.finished.sum())))) == 1
    result = monte_carlo(problem, 200, options=TIGHT, points_comm=WORLD, checkpoint=file)
    solved = sum(WORLD.allgather(len(result.points.order)))
    assert result.complete and solved == 200 - int(part.finished.sum()), solved
    # a file that was written by several ranks goes on with one, and the other way round
    alone = monte_carlo(problem, 200, options=TIGHT, checkpoint=file) if RANK == 0 else None
    if alone is not None:
        assert alone.points.order == []
    exact = monte_carlo(problem, 200, options=TIGHT)
    assert apart(exact, result) < SAME
    print(f"stopped on rank {RANK}", flush=True)


def raises(call: Any, *messages: str) -> None:
    """All ranks raise, with these words."""
    try:
        call()
    except SceneError as error:
        found = str(error)
    else:
        found = "nothing was raised"
    told = WORLD.allgather(found)
    assert all(any(m in each for m in messages) for each in told), told


def refuse() -> None:
    """What differs between ranks, and what is no communicator."""
    problem = made("linear")
    other = assemble(scene("linear", 200.0 + RANK), comm=MPI.COMM_SELF)
    more: dict[str, Any] = {"points_comm": WORLD}
    raises(lambda: monte_carlo(other, 20, **more), "points_comm: rank 1 has another problem than rank 0")
    raises(lambda: monte_carlo(problem, 20, seed=RANK, **more), "monte_carlo: seed differs")
    raises(lambda: sweep(problem, {"j1.normal": [1.0, 2.0 + RANK]}, **more), "grid differs")
    raises(lambda: monte_carlo(problem, 20, points_comm="all"), "points_comm = 'all'")
    raises(lambda: monte_carlo(problem, 20, points_comm=MPI.COMM_NULL), "points_comm")
    raises(lambda: sweep(problem, {"j1.normal": [-1.0 if RANK else 1.0]}, **more), "grid differs", "must be")
    raises(
        lambda: monte_carlo(problem, 20, **more, options=5 if RANK == 1 else None), "options", "rank 1 failed"
    )
    result = monte_carlo(problem, 20, **more)
    assert result.converged
    print(f"refused on rank {RANK}", flush=True)


def kill(file: Path) -> None:
    """The last rank is killed in the middle."""
    count = 0

    def callback(_: Any) -> None:
        nonlocal count
        count += 1
        if RANK == WORLD.size - 1 and count == 90:
            os.kill(os.getpid(), signal.SIGKILL)

    monte_carlo(made("friction"), 200, options=TIGHT, points_comm=WORLD, checkpoint=file, callback=callback)


def resume(file: Path) -> None:
    """The run that was killed goes on."""
    problem = made("friction")
    result = monte_carlo(problem, 200, options=TIGHT, points_comm=WORLD, checkpoint=file)
    solved = sum(WORLD.allgather(len(result.points.order)))
    assert result.complete and 0 < solved <= 200, solved
    assert apart(monte_carlo(problem, 200, options=TIGHT), result) < SAME
    print(f"resumed on rank {RANK}: {solved} of 200", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", "beyond the model: strain")  # of 2 % here
    faulthandler.dump_traceback_later(100, exit=True)
    given = [Path(each) for each in sys.argv[2:]]
    {f.__name__: f for f in (same, function, groups, stop, refuse, kill, resume)}[sys.argv[1]](*given)
