"""Program of test_mpi.py: points of sweeps side by side, and derivatives, against the same on one rank.

``mpirun -n N python mpi_together.py``
"""

from __future__ import annotations

import faulthandler
import importlib
from typing import Any

import numpy as np
from blocks import WORLD, row
from mpi4py import MPI

from dolfinx_frontend import (
    AtPoint,
    Contact,
    Elastic,
    LogNormal,
    Options,
    Response,
    Resultant,
    assemble,
    reliability,
    sweep,
)

searched: Any = importlib.import_module("dolfinx_frontend.inference.reliability")

ACTIVE = ["j1", "j2", "j3"]
VALUES = list(np.linspace(15.0, 40.0, 40))


def joint(k: int, contact: bool) -> Any:
    """Springs, and a contact perhaps."""
    if k == 2 and contact:
        return Contact(stiffness=500.0, friction=0.4, threshold=0.01)
    return Elastic(normal=20.0, tangential=10.0)


def side_by_side(contact: bool, **settings: Any) -> None:
    """A sweep that solves points side by side."""
    scene = row(lambda k: joint(k, contact), [100.0, 200.0, 300.0, 150.0], (-2.0, 0.3))
    options = Options(rtol=1e-7, **settings)
    spread, whole = assemble(scene, comm=WORLD), assemble(scene, comm=MPI.COMM_SELF)
    grid = {"j1.normal": VALUES}
    found, exact = (sweep(p, grid, options=options, active=ACTIVE, progress=False) for p in (spread, whole))
    assert found.converged.all() and exact.converged.all()
    at_once = [int((each.points.iterations == 1).sum()) for each in (found, exact)]
    print(f"side by side on rank {WORLD.rank}: {at_once} of {len(VALUES)} points", flush=True)
    assert min(at_once) > len(VALUES) // 2, at_once
    for name in ACTIVE:
        for one, other in zip(found.gathered(name), (exact.force(name), exact.jump(name)), strict=True):
            off = np.abs(one - other).max() / np.abs(other).max()
            assert off < 10 * options.rtol, (contact, name, off)


def derivatives() -> None:
    """Derivatives of resultants, at points where nothing changes its status."""

    def law(k: int) -> Any:
        if k == 2:
            return Contact(friction=0.4)
        return Elastic(normal=LogNormal(f"k{k}", 20.0, cov=0.2), tangential=10.0)

    scene = row(law, [100.0, 200.0, 300.0, 150.0], (-2.0, 0.3))
    found = []
    for comm in (WORLD, MPI.COMM_SELF):
        function = assemble(scene, comm=comm).function(
            {"n1": Resultant("j1"), "n3": Resultant("j3")}, active=ACTIVE, options=Options(rtol=1e-11)
        )
        found.append(function.derivatives([18.0, 23.0]))
    one, other = found
    assert np.abs(other.values).max() > 1e-3, other
    assert np.abs(one.values - other.values).max() < 1e-8 * np.abs(other.values).max(), found
    assert np.array_equal(one.kinks, other.kinks) and one.places == other.places
    # the first rank with all of it, the ranks together, and one rank
    chances = []
    for comm, small in ((WORLD, searched.SMALL), (WORLD, 0), (MPI.COMM_SELF, searched.SMALL)):
        searched.SMALL = small
        problem = assemble(scene, comm=comm)
        event = (Response("j1") > -7.6) & (Response(AtPoint(problem, "b3", (38.0, 6.0))) > -1.0)
        chances.append(reliability(problem, event, "form", active=ACTIVE))
    points = [np.array([*each.design_points[0].values()]) for each in chances]
    for one in points[:-1]:
        assert np.abs(one - points[-1]).max() < 1e-6 * np.abs(points[-1]).max(), chances
    assert len(set(WORLD.allgather(chances[0].probability.value))) == 1
    print(f"same derivatives on rank {WORLD.rank}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    side_by_side(False)
    side_by_side(True, criterion="indicator")
    derivatives()
