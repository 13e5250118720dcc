"""Program of test_mpi.py: what ranks once did without, against the same on one rank.

``mpirun -n N python mpi_lifted.py``
"""

from __future__ import annotations

import faulthandler
import warnings
from typing import Any

import numpy as np
from blocks import WORLD, row
from mpi4py import MPI

import dolfinx_frontend as lf
from dolfinx_frontend import Contact, Elastic, Options, Resultant
from dolfinx_frontend.evaluate.model import QuantityModel
from dolfinx_frontend.moments.hinges import sides_of
from dolfinx_frontend.moments.model import Evaluations

SAME = 1e-10


def both(scene: lf.Scene) -> tuple[lf.Problem, lf.Problem]:
    """Over the ranks, and on each alone."""
    return lf.assemble(scene, comm=WORLD), lf.assemble(scene, comm=MPI.COMM_SELF)


def near(found: Any, exact: Any, what: str, tolerance: float = SAME) -> None:
    """The digits of one rank."""
    one, other = np.asarray(found), np.asarray(exact)
    off = np.abs(one - other).max() / np.abs(other).max()
    assert off < tolerance, (what, off)


def flying(friction: float) -> lf.Scene:
    """Loose blocks with gaps between them, on a floor below a gap, pushed together and down."""
    scene = lf.Scene()
    for k, modulus in enumerate([1e3, 1e3, 10.0, 1e3]):
        box = lf.geometry.box((10.0, 10.0), (2, 2), origin=(10.0 * k, 0.0))
        scene.substructure(f"b{k}", box, lf.LinearElastic(E=modulus, nu=0.3), degree=1)
    scene.fix("b0:x0")
    for k, gap in enumerate([0.5, 0.3, 0.2], 1):
        scene.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", Contact(gap=gap, friction=friction))
        scene.interface(f"floor{k}", f"b{k}:y0", Contact(gap=0.01))
        scene.traction(f"b{k}:y1", (0.0, -0.01))
    scene.traction("b3:x1", lf.Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 0.6]) * (-2.0, -0.01))
    return scene


def searched() -> None:
    """A run that has used up its iterations ends with Newton's method, as on one rank."""
    for friction, times, most in ((0.0, [1.0], 60), (0.2, [0.5, 1.0, 2.0], 300)):
        options = Options(rtol=1e-9, max_iterations=most, newton=0)
        found, exact = (
            lf.solve(p, times=times, options=options, active="all") for p in both(flying(friction))
        )
        both_take = found.iterations, exact.iterations
        assert found.status == exact.status == "converged", (found, exact)
        assert most < min(both_take) and max(both_take) < 1.5 * most, both_take
        for name, u in found.displacements.items():
            what = f"{name}, friction {friction}, {len(times)} steps"
            near(u, exact.displacements[name], what, options.rtol)
    print(f"same search on rank {WORLD.rank}", flush=True)


def supported() -> None:
    """Reactions of supports that were eliminated: in tables, as quantities, and their errors."""
    scene = row(lambda k: Elastic(20.0, 10.0), [100.0, 200.0, 300.0], (-2.0, 0.3))
    found, exact = (lf.solve(p, options=Options(rtol=1e-12)) for p in both(scene))
    assert "wall" not in exact.plan.active
    wall = "wall"
    tables = [each.readings().interfaces[wall].values for each in (found, exact)]
    for column in ("force_x", "force_y", "moment_z"):
        near(tables[0][column], tables[1][column], column)
    near(*(each.quantity("wall.force_x").values for each in (found, exact)), "column")
    near(*(each.quantity(each.reaction("wall", "y")).values for each in (found, exact)), "reaction")
    errors = [lf.discretisation_error(each, Resultant("wall")) for each in (found, exact)]
    for what in ("value", "bound", "correction"):
        near(*(getattr(each, what) for each in errors), what, 1e-8)
    print(f"same reactions on rank {WORLD.rank}", flush=True)


def sides(samples: lf.SampleResult) -> list[Any]:
    """Which samples have an open contact."""
    model = QuantityModel(samples.solver, samples.random, samples.plan, lf.Resultant("j2"), False)
    zeros = np.zeros(len(samples.germs))
    return sides_of(model.contacts(Evaluations(samples.germs, zeros, zeros, True, 1e-10, 0.0, samples)))


def opened() -> None:
    """Which samples have an open contact, from where fits with kinks begin."""

    def law(k: int) -> Any:
        return Contact(gap=lf.Normal("g", 0.05, std=0.1)) if k == 2 else Elastic(20.0, 10.0)

    scene = row(law, [100.0, 200.0, 300.0], (-2.0, 0.3))
    settings: dict[str, Any] = {"seed": 1, "active": ["j1", "j2"], "options": Options(rtol=1e-10)}
    found, exact = (
        sides(lf.monte_carlo(p, 12, progress=False, **settings)) for p in both(scene)
    )
    assert len(found) == len(exact) == 3 and any(0 < each.sum() < 12 for each in exact), exact
    assert all(np.array_equal(one, other) for one, other in zip(found, exact, strict=True))
    print(f"same sides on rank {WORLD.rank}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    warnings.simplefilter("ignore")
    searched()
    supported()
    opened()
