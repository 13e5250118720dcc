"""Program of test_mpi.py: meshes that follow the question, over ranks and on one: the same meshes and digits.

``mpirun -n N python mpi_meshes.py same|laws|random|fail|kill``
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Normal,
    Options,
    Perfect,
    Resultant,
    Scene,
    assemble,
    discretisation_error,
    geometry,
    solve,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.resultant import Measure

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.verification.test_meshes import CORNER, corner_scene, pressed  # noqa: E402

WORLD, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
STEEL = LinearElastic(E=1000.0, nu=0.3)


def same(
    what: str,
    make: Callable[[], Scene],
    accuracy: float,
    quantity: Any = None,
    **settings: Any,
) -> Any:
    """A scene solved over the ranks and on one: meshes, values, errors and places are the same.

    Runs start near their answers, from the fields of the mesh before, where rounding makes other accelerated
    steps: values agree within their tolerance, those of the last meshes solved tightly to 1e-10.
    """
    given = {"active": "all", "progress": False} | settings
    found = solve(make(), accuracy=accuracy, quantity=quantity, comm=WORLD, **given)
    made = found.errors()
    alone = solve(make(), accuracy=accuracy, quantity=quantity, comm=SELF, **given)
    exact = alone.errors()
    assert found.problem.size == alone.problem.size, (what, str(made), str(exact))
    for one, other in zip(made.steps, exact.steps, strict=True):
        assert one.changed == other.changed and one.kept == other.kept, (what, one, other)
    for one, other in zip(made.steps, exact.steps, strict=True):
        if other.value is not None:
            assert abs(one.value - other.value) <= 0.02 * accuracy * abs(other.value), (what, one, other)
        assert np.isclose(one.error, other.error, rtol=0.05, atol=0.0, equal_nan=True), (what, one, other)
    one, other = (solve(r.problem, options=Options(rtol=1e-12), active="all") for r in (found, alone))
    size = max(np.abs(u).max() for u in other.displacements.values())
    for name, u in one.displacements.items():
        off = np.abs(u - other.displacements[name]).max()
        assert off <= 1e-10 * size, (what, name, off / size)
    assert made.reached == exact.reached and made.notes == exact.notes, (what, made.notes, exact.notes)
    assert [(p.part, p.cells) for p in made.places] == [(p.part, p.cells) for p in exact.places], what
    told = WORLD.allgather(str((made.steps[-1]._replace(seconds=0.0), made.places, made.notes, made.in_all)))
    assert all(each == told[0] for each in told), (what, told)
    if WORLD.rank == 0:
        print(what, len(made.steps), flush=True)
    return found


def blocks(law: Any, cell: str = "triangle", degree: int = 2, lazy: bool = True) -> Scene:
    """Three blocks of other meshes on a bed, one after the other, each made on its rank only."""
    scene = Scene()
    for k, n in enumerate((2, 3, 2)):
        make = lambda k=k, n=n: geometry.box((1.0, 1.0), (n, n), (float(k), 0.0), cell)  # noqa: E731
        scene.substructure(f"p{k}", make if lazy else make(), STEEL, degree=degree)
        scene.interface(f"bed{k}", f"p{k}:y0", Elastic(normal=50.0, tangential=50.0))
    for k in range(2):
        scene.interface(f"j{k}", f"p{k}:x1", f"p{k + 1}:x0", law)
    scene.fix("p0:x0")
    scene.traction("p2:x1", (-1.0, -0.3))
    return scene


def section() -> Scene:
    """Two rings around each other, of whose sections a rank makes its own only."""
    scene = Scene(axisymmetric=True)
    for k in range(2):
        make = lambda k=k: geometry.box((1.0, 1.0), (2, 2 + k), (1.0 + k, 0.0), "triangle")  # noqa: E731
        scene.substructure(f"p{k}", make, STEEL)
    scene.interface("j", "p0:x1", "p1:x0", Elastic(normal=500.0, tangential=500.0))
    scene.fix("p1:y0")
    scene.pressure("p0:x0", 1.0)
    return scene


def all_alike() -> None:
    """Parts of all kinds, quantities and budgets."""
    result = same("corner", corner_scene, 1e-2, "joint")
    assert abs(result.mean_std("joint").mean / CORNER - 1.0) < 1e-2 and result.errors().reached
    same("energy", corner_scene, 0.1)
    shear = Measure(lambda fields: fields.force("joint")[..., 1].max(axis=1), "largest shear")
    same("function", corner_scene, 0.1, shear)
    timed = solve(corner_scene(), accuracy=1e-4, quantity="joint", max_seconds=1e-3, comm=WORLD).errors()
    assert len(timed.steps) == 1 and len(set(WORLD.allgather(timed.notes))) == 1
    result = same("budget", corner_scene, 1e-4, "joint", max_unknowns=400)
    assert any("budget of 400" in note for note in result.errors().notes)
    print(f"same meshes on rank {WORLD.rank}", flush=True)


def all_laws() -> None:
    """Parts of other meshes, with laws of all kinds, and parts that gmsh meshes again."""
    same("glue", lambda: blocks(Perfect(), "quadrilateral"), 5e-3, "j1")
    same("given", lambda: blocks(Elastic(500.0, 500.0), lazy=False), 1e-2, Resultant("j0", "jump"))
    same("friction", lambda: blocks(Contact(friction=0.2)), 2e-2, "j1")
    same("section", section, 1e-2, "j")
    result = same("rings", lambda: pressed(1, 2e3, 1e-3)[0], 1e-2, "fit")
    assert abs(result.mean_std("fit").mean / pressed(1, 2e3, 1e-3)[1] - 1.0) <= 1e-2
    # springs on means between ranks are in the sum
    made = [
        discretisation_error(solve(assemble(blocks(Elastic(900.0, 900.0)), comm=c), active="all"), "bed1")
        for c in (WORLD, SELF)
    ]
    assert made[1].means.keys() == made[0].means.keys() and {"j0", "j1"} <= made[0].means.keys()
    for name, each in made[1].means.items():
        assert abs(made[0].means[name] - each) <= 1e-6 * max(made[1].means.values()), (name, made)
    print(f"same laws on rank {WORLD.rank}", flush=True)


def all_random() -> None:
    """What is random, whose points and modes are solved in another way on one rank: within the accuracy."""
    stiff = LogNormal("k", mean=1e3, cov=0.2)

    def loaded(law: Any) -> Callable[[], Scene]:
        def make() -> Scene:
            scene = corner_scene()
            scene.interfaces.pop("joint")
            scene.interface("joint", "L:top", "block:y0", law)
            return scene

        return make

    def pushed(mean: float) -> Scene:
        scene = Scene()
        steel = LinearElastic(E=LogNormal("E", 1000.0, cov=0.1), nu=0.3) if mean < -1.0 else STEEL
        scene.substructure("a", geometry.box((1.0, 1.0), (2, 2), cell="triangle"), steel)
        scene.substructure("b", geometry.box((1.0, 1.0), (3, 3), (1.0, 0.0), "triangle"), STEEL)
        scene.interface("bed", "b:y0", Elastic(normal=20.0, tangential=20.0))
        scene.interface("j", "a:x1", "b:x0", Contact() if mean == 0.0 else Elastic(500.0, 500.0))
        scene.fix("a:x0")
        scene.traction("b:x1", (Normal("load", mean, std=0.3), 0.0))
        return scene

    for what, make, accuracy, name in (
        ("stiffness", loaded(Elastic(normal=stiff, tangential=stiff)), 2e-2, "joint"),
        ("load", lambda: pushed(-1.0), 2e-2, "j"),
        ("modulus", lambda: pushed(-2.0), 2e-2, "j"),
        ("contact that random loads close", lambda: pushed(0.0), 0.1, "j"),
    ):
        print(what, flush=True)
        answers = [
            solve(make(), accuracy=accuracy, quantity=name, comm=c, progress=False) for c in (WORLD, SELF)
        ]
        found, exact = (each.errors() for each in answers)
        assert found.reached == exact.reached, (what, str(found), str(exact))
        sizes = [[s.unknowns for s in each.steps] for each in (found, exact)]
        assert sizes[0] == sizes[1], (what, str(found), str(exact))
        assert found.moments is not None and exact.moments is not None
        for one, other in zip(found.moments, exact.moments, strict=True):
            assert abs(one - other) <= 0.1 * accuracy * abs(other), (what, found.moments, exact.moments)
        assert len(set(WORLD.allgather(found.moments))) == 1
    print(f"same scatter on rank {WORLD.rank}", flush=True)


def fail(how: str) -> None:
    """A part that can be meshed once only, on one rank; calls that differ."""

    def failing() -> Scene:
        scene, _ = pressed(1, 2e3, 1e-3)
        part = scene.substructures["outer"].part

        def again(size: Any) -> Any:
            if how == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise RuntimeError("gmsh has gone")

        object.__setattr__(part, "again", again)
        return scene

    owner = WORLD.size - 1
    try:
        solve(failing(), accuracy=1e-3, quantity="fit", comm=WORLD, progress=False)
    except RuntimeError as error:
        assert WORLD.rank == owner and str(error) == "gmsh has gone"
    except SceneError as error:
        assert WORLD.rank != owner and f"rank {owner} failed: RuntimeError: gmsh has gone" in str(error)
    else:
        raise AssertionError("it cannot be meshed again")
    for given, word in (
        ({"accuracy": 1e-2 * (1 + WORLD.rank)}, "accuracy"),
        ({"max_unknowns": 100 + WORLD.rank}, "max_unknowns"),
    ):
        try:
            solve(corner_scene(), **({"accuracy": 1e-2, "quantity": "joint", "comm": WORLD} | given))
        except SceneError as error:
            assert word in str(error) and "differs between ranks" in str(error), error
        else:
            raise AssertionError("the ranks were given different things")
    try:  # what one rank is refused, all are
        solve(corner_scene(), accuracy=1e-2, quantity="joint" if WORLD.rank else "jo", comm=WORLD)
    except SceneError:
        pass
    problem = assemble(corner_scene(), comm=WORLD)
    try:
        solve(problem, accuracy=1e-2, quantity="joint", comm=WORLD)
    except SceneError as error:
        assert "assemble(scene, comm=...)" in str(error)
    else:
        raise AssertionError("a problem has its ranks")
    result = solve(corner_scene(), accuracy=5e-2, quantity="joint", comm=WORLD, progress=False)
    assert result.errors().reached, "the next call must not hang"
    print(f"failed together on rank {WORLD.rank}", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    faulthandler.dump_traceback_later(110, exit=True)
    runs = {"same": all_alike, "laws": all_laws, "random": all_random}
    runs.get(sys.argv[1], lambda: fail(sys.argv[1]))()
