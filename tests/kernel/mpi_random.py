"""Program of test_mpi.py: random chains and towers over the ranks, against the same scenes on one rank.

``mpirun -n N python mpi_random.py FIRST LAST`` takes the scenes of these seeds: parts anywhere, on some seeds
all of them on one rank, interfaces that no other rank sees. Status, number of columns and nodal forces are
compared.
"""

from __future__ import annotations

import faulthandler
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from blocks import WORLD, row
from mpi4py import MPI

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LogNormal,
    Options,
    assemble,
    discretisation_error,
    monte_carlo,
    solve,
    sweep,
)

# what ranks do without, so that one rank iterates as several do
OPTIONS = Options(rtol=1e-10, max_iterations=3000, newton=0, macro="none", directions="diagonal")
KINDS = ("elastic", "contact", "history", "random", "accuracy", "samples", "sweep")
TIMES = [0.5, 1.0, 1.5, 2.0]
SECONDS = 60


class Drawn:
    """A scene of a seed, over the ranks or for one alone."""

    def __init__(self, seed: int, alone: bool) -> None:
        rng = np.random.default_rng(seed)
        self.kind = KINDS[seed % len(KINDS)]
        self.count = int(rng.integers(2, 6))
        self.accuracy = float(10.0 ** rng.uniform(-6.0, -3.0))
        tower, degree = rng.random() < 0.4, int(rng.integers(1, 3))
        together = int(rng.integers(WORLD.size)) if rng.random() < 0.2 else None
        ranks = [int(rng.integers(WORLD.size)) if rng.random() < 0.3 else None for _ in range(self.count)]
        if together is not None:
            ranks = [together] * self.count
        cells, moduli = [], []
        for k in range(self.count):
            cells.append((2 + k % 2, 2 + k % 2) if rng.random() < 0.3 else (2, 2))
            moduli.append(float(10.0 ** rng.uniform(1.0, 3.0)))
        load: Any = (0.3, -2.0) if tower else (-2.0, 0.3)
        if self.kind == "history":
            load = Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 0.5]) * load
        self.scene = row(
            lambda k: self.law(k, rng), moduli, load, cells, degree, None if alone else ranks, tower
        )

    def law(self, k: int, rng: np.random.Generator) -> Any:
        """The law of joint k; friction is left out, whose answers need not be unique."""
        stiffness = float(10.0 ** rng.uniform(0.0, 3.0))
        cov, other = rng.uniform(0.1, 0.4), rng.random() < 0.3
        if self.kind in ("contact", "history") and not other:
            return Contact(gap=float(rng.uniform(-0.01, 0.05)))
        if self.kind in ("random", "accuracy", "samples") and (k == 1 or not other):
            return Elastic(normal=LogNormal(f"k{k}", stiffness, cov=float(cov)), tangential=stiffness)
        return Elastic(normal=stiffness, tangential=stiffness)


def nodal(result: Any, name: str, read: Callable[[], Any]) -> Any:
    """Nodal forces (..., nodes) of an interface: forces at more points than nodes are not unique."""

    def found() -> Any:
        interface = result.problem.interfaces[name]
        force = np.asarray(read())
        weighted = force * interface.weights[:, None]
        full = np.zeros((*force.shape[:-1], interface.dim))
        full[..., : force.shape[-1]] = weighted
        return full.reshape(*force.shape[:-2], -1) @ interface.local_trace(0)

    return result.everywhere(name, found)


def answer(seed: int, comm: Any, active: Any) -> tuple[str, tuple[str, ...], dict[str, Any], float]:
    """How it ended with how many columns, the active interfaces, forces, and how far they may differ."""
    drawn = Drawn(seed, comm.size == 1)
    problem = assemble(drawn.scene, comm=comm)
    tolerance, kind = 1e-9, drawn.kind
    extra: dict[str, Any] = {} if active is None else {"active": active}
    forces: dict[str, Any] = {}
    if kind in ("random", "accuracy"):
        if kind == "random":
            result: Any = solve(problem, chaos=2, options=OPTIONS, **extra)
        else:
            # every rank asks for an interface that some do not have
            quantity = (None, "energy", "j1", f"j{drawn.count - 1}")[seed // len(KINDS) % 4]
            extra |= {"quantity": quantity, "meshes": seed % 2 == 0}
            result = solve(problem, accuracy=drawn.accuracy, options=OPTIONS, **extra)
            tolerance = 1e-2 * drawn.accuracy
        for name in result.plan.active:
            block = result.force_coefficients
            forces[name] = nodal(result, name, lambda name=name: np.moveaxis(block(name), -1, 0))
        if kind == "random":
            for name in (result.plan.active[0], result.plan.active[-1]):
                forces[f"truncation of {name}"] = np.array([result.truncation(name, points=3).sample])
        columns = result.modes
    elif kind == "samples":
        result, columns = monte_carlo(problem, 5, options=OPTIONS, progress=False, **extra), 5
    elif kind == "sweep":
        grid = {f"j{drawn.count - 1}.normal": [5.0, 20.0, 80.0]}
        result, columns = sweep(problem, grid, options=OPTIONS, progress=False, **extra), 3
    else:
        times: dict[str, Any] = {"times": TIMES} if kind == "history" else {}
        result, columns = solve(problem, options=OPTIONS, **times, **extra), 1
        # of recovered stresses: what springs on means leave out is known within a rank only
        of_meshes = discretisation_error(result, f"j{drawn.count - 1}")
        forces["error of the meshes"] = np.array([of_meshes.relative()])
    for name in result.plan.active:
        if name not in forces:
            forces[name] = nodal(result, name, lambda name=name: result.force(name))
    ended = f"{kind}: {result.status}, {columns} columns"
    return ended, result.plan.active, forces, tolerance


def main(first: int, last: int) -> None:
    """All scenes; what differs ends the program."""
    warnings.simplefilter("ignore")
    for seed in range(first, last):
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        ended, active, forces, tolerance = answer(seed, WORLD, None)
        told = WORLD.allgather((ended, active, {n: f.tobytes() for n, f in forces.items()}))
        assert all(each == told[0] for each in told), (seed, [each[:2] for each in told])
        other, _, exact, _ = answer(seed, MPI.COMM_SELF, active)
        assert ended == other and "converged" in ended, (seed, ended, other)
        size = max((np.abs(exact[name]).max() for name in active), default=1.0)
        for name, force in forces.items():
            off = np.abs(force - exact[name]).max() / (size if name in active else 1.0)
            assert off < (tolerance if name in active else 1e-6), (seed, name, ended, off)
        if WORLD.rank == 0:
            print(f"same scene {seed}: {ended}", flush=True)
        faulthandler.cancel_dump_traceback_later()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
