"""Program of test_mpi.py: Ctrl-C on one rank while the others work or wait.

``mpirun -n N python mpi_interrupt.py parts|points|outside|waiting...``
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI
from mpi_chain import chain
from mpi_points import TIGHT, made

from dolfinx_frontend import (
    LinearElastic,
    Options,
    Response,
    assemble,
    monte_carlo,
    reliability,
    solve,
)

WORLD = MPI.COMM_WORLD
LAST = WORLD.size - 1


def press(rank: int = LAST) -> None:
    """Ctrl-C on one rank alone."""
    if WORLD.rank == rank:
        os.kill(os.getpid(), signal.SIGINT)


def pressing(after: int, rank: int) -> Callable[[Any], None]:
    """A callback that does so once."""
    count = 0

    def callback(_: Any) -> None:
        nonlocal count
        count += 1
        if count == after:
            press(rank)

    return callback


def parts() -> None:
    """All ranks return the same iterate, and the next call is undisturbed."""
    problem, options = assemble(chain((-0.05, 0.02), friction=0.4), comm=WORLD), Options(rtol=1e-11, newton=0)
    result = solve(problem, options=options, callback=pressing(3, LAST), progress=False)
    whole = solve(problem, options=options, progress=False)
    assert result.status == "interrupted" and whole.converged, (result, whole)
    assert len(set(WORLD.allgather(result.iterations))) == 1 and result.iterations in (2, 3, 4)
    # their clocks differ, what they return does not
    late = solve(problem, options=options.with_(max_seconds=1e-3), progress=False)
    told = set(WORLD.allgather((late.status, late.iterations)))
    assert len(told) == 1 and late.status in ("time_limit", "converged"), told
    print(f"parts on rank {WORLD.rank}", flush=True)


def points() -> None:
    """Points over ranks: all return those that are finished, of the other ranks, too."""
    # another rank than before, for which it would be the second time within two seconds
    callback = pressing(20, 0)
    result = monte_carlo(made("friction"), 60, options=TIGHT, points_comm=WORLD, callback=callback)
    assert result.status == "interrupted" and not result.complete
    [told] = set(WORLD.allgather(repr(result).split(" (")[0]))
    assert " of 60" in told, told
    print(f"points on rank {WORLD.rank}", flush=True)


def outside() -> None:
    """Where there is nothing to return it ends all ranks."""
    scene = chain((-0.05, 0.0))
    scene.substructure("extra", press, LinearElastic(E=1.0, nu=0.3))  # of the last rank
    assemble(scene, comm=WORLD)


def waiting() -> None:
    """A rank that waits for what the first one works on ends all of them."""
    begun = threading.Event()

    def endless(block: Any) -> Any:
        WORLD.send(None, dest=LAST)
        begun.wait()
        return np.zeros(len(block))

    def listen() -> None:
        WORLD.recv(source=0)
        press()

    problem = made("linear", WORLD)
    if WORLD.rank == LAST:
        threading.Thread(target=listen, daemon=True).start()
    reliability(problem, Response(endless) > 1.0)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(60.0, exit=True)
    for what in sys.argv[1:]:
        {"parts": parts, "points": points, "outside": outside, "waiting": waiting}[what]()
    faulthandler.cancel_dump_traceback_later()
