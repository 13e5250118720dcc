"""Program of test_mpi.py: bars end to end on the ranks of a communicator, against all of them on one.

``mpirun -n N python mpi_kernel.py``, N > 1
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

from dolfinx_frontend.assembly.elements import petsc_matrix
from latin_core import Options, RemoteError, _core

NODES = 6
PARTS = 8
LAWS = ("perfect", "elastic", "contact", "elastic")
COLUMNS = 3


def bar(n: int) -> Any:
    """Stiffness of a bar with n nodes."""
    k = sp.lil_matrix((n, n))
    for i in range(n - 1):
        k[i : i + 2, i : i + 2] += (n - 1) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return petsc_matrix(k.tocsr())


def end(node: int) -> Any:
    """Trace at one node."""
    return petsc_matrix(sp.csr_matrix(([1.0], ([0], [node])), shape=(1, NODES)))


def problem(owner: list[int], rank: int, comm: int | None, spoil: int = -1) -> Any:
    """The chain's parts of this rank; every part also hangs on a soft spring, so that contact may open."""
    bodies, interfaces = [], []
    values: dict[str, dict[str, Any]] = {}
    ones = np.ones((1, 1), order="F")
    for part in range(PARTS):
        if owner[part] == rank:
            load = np.zeros((NODES, COLUMNS), order="F")
            load[-1] = (1.0 + part) * np.cos(part + 2.0 * np.arange(COLUMNS))
            member = _core.Member(
                name=f"bar{part}", stiffness=bar(NODES), prolongation=None, load=load, offset=None
            )
            bodies.append(_core.Body(name=f"bar{part}", size=NODES, members=[member], springs=[]))
    faces = [(f"hang{p}", "elastic", [(p, 2)], {"normal": 0.3}) for p in range(PARTS)]
    for p in range(1, PARTS):
        law = LAWS[p % len(LAWS)]
        given = {"normal": 2.0 + p} if law == "elastic" else {}
        faces.append((f"joint{p}", law, [(p - 1, NODES - 1), (p, 0)], given))
    for name, law, ends, given in faces:
        if all(owner[p] != rank for p, _ in ends):
            continue
        count = 2 if spoil == rank and name == f"joint{PARTS // 2}" else 1
        interfaces.append(
            _core.Interface(
                name=name,
                law=law,
                weights=np.ones(count),
                frames=np.ones((count, 1), order="F"),
                sides=[
                    _core.Side(
                        member=f"bar{p}",
                        trace=end(node),
                        direction=np.full(1, 1.5 + 0.1 * p),
                        scale=1.0,
                    )
                    if owner[p] == rank
                    else _core.Side(member=f"bar{p}")
                    for p, node in ends
                ],
                basis=None,
                paired=False,
            )
        )
        values[name] = {key: value * ones for key, value in given.items()}
    core = _core.Structure(
        bodies=bodies,
        interfaces=interfaces,
        operator="automatic",
        backend="automatic",
        memory_limit=0.0,
        comm=comm,
    )
    return core, core.laws(parameters=values)


def fails(world: MPI.Comm, work: Any, message: str, on: int) -> None:
    """One rank raises its own error, the others hear of it."""
    try:
        work()
    except RemoteError as error:
        assert world.rank != on and message in str(error) and f"rank {on}" in str(error), error
    except ValueError as error:
        assert world.rank == on and message in str(error), error
    else:
        raise AssertionError(f"no error on rank {world.rank}: {message}")


def main() -> None:
    """Compare, and fail on one rank."""
    world = MPI.COMM_WORLD
    owner = [p * world.size // PARTS for p in range(PARTS)]
    mine, laws = problem(owner, world.rank, world.py2f())
    settings: dict[str, Any] = {
        "options": Options(rtol=1e-12, newton=0),
        "amplitudes": np.eye(COLUMNS, order="F"),
    }
    summary, state = mine.solve(laws, **settings)
    whole, laws_0 = problem([0] * PARTS, 0, None)
    reference, state_0 = whole.solve(laws_0, **settings)
    assert summary.status == reference.status == "converged"
    # estimates are checked on one rank only: that may save an iteration
    assert abs(summary.iterations - reference.iterations) <= 3, (summary.iterations, reference.iterations)
    u, exact = (
        c.displacements(given, s, settings["amplitudes"])
        for c, given, s in ((mine, laws, state), (whole, laws_0, state_0))
    )
    assert sorted(u) == [f"bar{p}" for p in range(PARTS) if owner[p] == world.rank]
    size = max(np.abs(v).max() for v in exact.values())
    off = max(np.abs(u[n] - exact[n]).max() for n in u) / size
    assert off < 1e-10, off
    for p in range(1, PARTS):
        if world.rank in (owner[p - 1], owner[p]):
            pairs = zip(
                mine.local_fields(laws, f"joint{p}", state),
                whole.local_fields(laws_0, f"joint{p}", state_0),
            )
            assert all(np.abs(a - b).max() < 1e-9 * size for a, b in pairs)
    gaps = [
        whole.local_fields(laws_0, f"joint{p}", state_0)[1]
        for p in range(1, PARTS)
        if LAWS[p % 4] == "contact"
    ]
    assert any(np.any(g > 1e-3) for g in gaps) and any(np.any(g < 1e-9) for g in gaps)
    total = world.allreduce(mine.rows)
    assert total == mine.total_rows == whole.rows
    # Newton's steps are those of one rank
    by_newton = {**settings, "options": Options(rtol=1e-12)}
    asked, alone = (c.solve(given, **by_newton)[0] for c, given in ((mine, laws), (whole, laws_0)))
    assert asked.newton_steps == alone.newton_steps > 0 and asked.iterations == alone.iterations
    threads = _core.bound_threads(world.py2f())
    assert threads >= 1 and threads * world.size <= max(os.cpu_count() or 1, world.size)
    print(f"same on rank {world.rank}: {summary.iterations} iterations, off by {off:.1e}", flush=True)

    def stop(iteration: Any) -> None:
        if world.rank == 1 and iteration.number == 3:
            raise ValueError("the callback of rank 1 stops here")

    fails(world, lambda: mine.solve(laws, **settings, callback=stop), "rank 1 stops here", 1)
    fails(
        world,
        lambda: problem(owner, world.rank, world.py2f(), spoil=1),
        "'joint4': search direction has 1 values for 2 rows",
        1,
    )
    again, _ = mine.solve(laws, **settings)  # nothing was left on its way
    assert again.iterations == summary.iterations
    print(f"failed together on rank {world.rank}", flush=True)


if __name__ == "__main__":
    main()
