"""Program of test_mpi.py: blocks end to end over the ranks, against the same scene on one rank.

``mpirun -n N python mpi_chain.py same|columns|stop|refuse|crash``
"""

from __future__ import annotations

import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dolfinx_frontend import (
    Amplitude,
    Chaos,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Perfect,
    Scene,
    SceneError,
    assemble,
    geometry,
    io,
    make_plan,
    solve,
    sweep,
)
from dolfinx_frontend.reference.direct import monolithic
from dolfinx_frontend.solving import sample

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.helpers import block  # noqa: E402

PARTS = 5
WORLD = MPI.COMM_WORLD
MADE: list[int] = []
# what ranks do without, so that one rank iterates as several do
SERIAL: dict[str, Any] = {"newton": 0, "macro": "none", "directions": "diagonal"}


def part(k: int, cells: int = 3) -> Any:
    """Block k, which is counted."""
    MADE.append(k)
    return block("quadrilateral", (2, cells), (float(k), 0.0), (k + 1.0, 1.0))


def chain(
    pull: Any, what: str = "same", space: Any = "points", friction: float = 0.05
) -> Scene:
    """Perfect, elastic, contact with friction, elastic; pressed together and sheared at the end."""
    scene = Scene()
    for k in range(PARTS):
        cells = 5 if space == "facets" and k % 2 else 3
        stiff = LinearElastic(E=1000.0 * (1 + k), nu=0.3)
        scene.substructure(f"b{k}", lambda k=k, cells=cells: part(k, cells), stiff, degree=2)
    if what != "free":
        scene.fix("b0:x0", name="wall")
    laws = (
        Perfect(),
        Elastic(normal=800.0, tangential=300.0),
        Contact(friction=friction),
        Elastic(normal=2000.0, tangential=900.0),
    )
    for k, law in enumerate(laws):
        second = "nowhere" if what == "missing" and k == 2 else "x0"
        scene.interface(f"j{k}", f"b{k}:x1", f"b{k + 1}:{second}", law, space=space)
    if what == "lost":
        scene.traction(f"b{PARTS - 1}:x1", (1.0, 0.0), name="pulled")
    elif what != "free":
        scene.fix(f"b{PARTS - 1}:x1", pull, name="pushed")
    return scene


def nodal(interface: Any, force: Any) -> Any:
    """Nodal forces: where points outnumber the nodes of a contact, forces at points are not unique."""
    weighted = force * interface.weights[:, None]
    return interface.local_trace(0).T @ weighted.reshape(-1, 2 * interface.num_points).T


def compare(times: Any, space: Any, friction: float) -> None:
    """The digits of one rank."""
    pull: Any = (-0.05, 0.04)
    if times is not None:
        pull = Amplitude([0.0, 1.0, 2.0], [0.0, 1.0, 0.9]) * (0.0, 0.2) + np.array([-0.05, 0.0])
    options = Options(rtol=1e-10, max_iterations=400, **SERIAL)
    scene = chain(pull, space=space, friction=friction)
    problem = assemble(scene, comm=WORLD)
    made = MADE.copy()
    MADE.clear()
    owner = problem.owner
    assert made == [k for k in range(PARTS) if owner[f"b{k}"] == WORLD.rank]
    assert list(owner.values()) == sorted(owner.values()) and set(owner.values()) == set(range(WORLD.size))
    whole = assemble(scene, comm=MPI.COMM_SELF)
    MADE.clear()
    assert whole.owner == dict.fromkeys(owner, 0)
    assert problem.size == whole.size and problem.amplitudes == whole.amplitudes
    extra: dict[str, Any] = {} if times is None else {"times": times}
    # the cuts stay active: so they do in what it is compared with
    found = solve(problem, options=options, **extra)
    exact = solve(whole, options=options, active=found.plan.active, **extra)
    assert found.converged and exact.converged, (found, exact)
    assert problem.cuts == tuple(
        f"j{k}" for k in range(PARTS - 1) if owner[f"b{k}"] != owner[f"b{k + 1}"]
    )
    assert sorted(found.displacements) == sorted(problem.substructures)
    size = max(np.abs(u).max() for u in exact.displacements.values())
    off = max(np.abs(u - exact.displacements[n]).max() for n, u in found.displacements.items()) / size
    assert off < 1e-9, off
    largest = np.abs(nodal(whole.interfaces["j2"], exact.force("j2"))).max()
    for name in found.plan.active:
        force, jump = found.gathered(name)
        wrong = np.abs(nodal(whole.interfaces[name], force - exact.force(name))).max() / largest
        assert wrong < 1e-9 and np.abs(jump - exact.jump(name)).max() < 1e-9 * size, (name, wrong)
        if name in problem.own.interfaces:
            assert np.array_equal(found.force(name), force)
    elsewhere = [n for n in problem.interfaces if n not in problem.own.interfaces]
    for name in elsewhere:
        try:
            found.jump(name)
        except SceneError as error:
            assert "gathered" in str(error)
        else:
            raise AssertionError(name)
    f, n = exact.force("j2")[..., 1], exact.force("j2")[..., 0]
    assert np.any(np.abs(f) > friction * np.abs(n) * (1 - 1e-6)), "nothing slips"
    counts = f"{found.iterations} and {exact.iterations} iterations"
    print(f"same on rank {WORLD.rank}: {counts}, off by {off:.1e}", flush=True)


def columns() -> None:
    """Sweeps, samples and chaos: what varies touches one rank or two, the digits are those of one rank."""
    options = Options(rtol=1e-10, max_iterations=400, together=1, **SERIAL)
    scene = chain((-0.05, 0.02), friction=0.4)
    scene.interface("bed", "b2:y0", Elastic(normal=LogNormal("bed", 50.0, cov=0.3), tangential=20.0))
    scene.interfaces["j1"] = replace(
        scene.interfaces["j1"], law=Elastic(normal=LogNormal("k", 800.0, cov=0.2), tangential=300.0)
    )
    both = [assemble(scene, comm=WORLD), assemble(scene, comm=MPI.COMM_SELF)]
    kept = make_plan(both[0]).active

    def same(a: Any, b: Any, what: str, tolerance: float = 1e-8) -> None:
        off = np.abs(a - b).max() / max(np.abs(b).max(), 0.01)  # jumps where nothing slips are rounding
        assert off < tolerance, (what, off)

    grid = {"j1.normal": [600.0, 900.0], "j3.tangential": [700.0, 800.0, 1100.0]}
    reads = {"load": lambda f: f.force("j1")[..., 0].sum(axis=1) + f.force("j2")[..., 0].sum(axis=1)}
    swept = [sweep(p, grid, active=kept, options=options, outputs=reads, progress=False) for p in both]
    assert swept[0].converged.all() and swept[1].converged.all()
    for name in ("j1", "j2", "j3"):
        for one, other in zip(swept[0].gathered(name), swept[1].gathered(name), strict=True):
            same(one, other, f"sweep {name}")
    same(swept[0].output("load"), swept[1].output("load"), "output")

    points = np.array([[0.3, -0.5], [-1.0, 0.4], [0.0, 1.2]])
    active = tuple(dict.fromkeys([*kept, "j1", "bed"]))
    samples = []
    for p in both:
        plan = make_plan(p, active=active, options=options)
        samples.append(sample(p, points, plan=plan, progress=False))
    expanded = [
        solve(p, chaos=Chaos(order=2, check_points=0), active=active, options=options) for p in both
    ]
    assert all(each.converged for each in expanded), expanded
    for name in ("bed", "j1", "j2"):
        mine = both[0].everywhere(name, lambda: samples[0].force(name))
        exact = samples[1].force(name)
        weights = both[0].interfaces[name].weights
        totals = (np.einsum("p,npc->nc", weights, f) for f in (mine, exact))
        same(*totals, f"total of samples {name}", 1e-9)
        # 9 points on 7 nodes: four combinations of the point forces of the rigid contact move nothing
        one, other = (
            (mine, exact) if name != "j2" else (nodal(both[1].interfaces[name], f) for f in (mine, exact))
        )
        same(one, other, f"samples {name}")
        mine = both[0].everywhere(name, lambda: expanded[0].moments(name)[1])
        same(mine, expanded[1].moments(name)[1], f"chaos {name}", 1e-8)
    for name in both[0].substructures:
        same(expanded[0].coefficients(name), expanded[1].coefficients(name), f"chaos {name}")
    checked = solve(both[0], chaos=Chaos(order=2, check_points=2), active=active, options=options)
    assert sorted(checked.checks) == sorted(active) and checked.trusted in (True, False)
    try:
        monolithic(both[0])
    except SceneError as error:
        assert "'j2': Contact cannot be eliminated" in str(error)
    else:
        raise AssertionError("a monolithic solve with contact")
    print(f"same columns on rank {WORLD.rank}", flush=True)


def stopped() -> None:
    """One rank asks for what is done so far: all stop at one iteration; all write one set of files."""
    problem = assemble(chain((-0.05, 0.02), friction=0.4), comm=WORLD)

    def enough(iteration: Any) -> None:
        if iteration.number == 3 and WORLD.rank == WORLD.size - 1:
            raise StopIteration

    result = solve(problem, options=Options(rtol=1e-11, **SERIAL), callback=enough)
    assert result.status == "interrupted" and result.iterations in (3, 4), result
    assert len(set(WORLD.allgather(result.iterations))) == 1
    grid = {"j1.normal": [600.0, 900.0, 1200.0]}
    swept = sweep(problem, grid, options=Options(rtol=1e-11, **SERIAL), callback=enough, progress=False)
    assert not swept.complete and swept.status == "interrupted"

    folder = WORLD.bcast(tempfile.mkdtemp() if WORLD.rank == 0 else None)
    whole = solve(problem, options=Options(rtol=1e-11, **SERIAL))
    parts, interfaces = io.write(whole, folder)
    WORLD.barrier()
    index = interfaces.read_text()
    files = re.findall('file="([^"]+)"', index + parts.read_text())
    assert len(files) > 4 + 2 * 3  # parts, and facets and points of interfaces
    assert all((interfaces.parent / file).stat().st_size > 500 for file in files)

    crossed = Scene()  # its points are on the second side, which the second rank has
    for k, cells in enumerate((3, 4)):
        box = geometry.box((1.0, 1.0), (cells, cells), origin=(float(k), 0.0))
        crossed.substructure(f"p{k}", box, LinearElastic(E=1e3, nu=0.3), degree=1, rank=k)
    crossed.interface("j", "p0:x1", "p1:x0", Elastic(normal=1e3, tangential=1e3))
    crossed.fix("p0:x0")
    crossed.traction("p1:x1", (1.0, 0.0))
    index = io.write(solve(assemble(crossed, comm=WORLD)), Path(folder) / "crossed")[1]
    WORLD.barrier()
    files = re.findall('file="([^"]+)"', index.read_text())
    assert len(files) >= 2 and all((index.parent / file).stat().st_size > 500 for file in files)
    print(f"stopped on rank {WORLD.rank}", flush=True)


def refused(scene: Scene, message: str, solved: bool = False) -> None:
    """All ranks raise, with the same message."""
    try:
        problem = assemble(scene, comm=WORLD)
        if solved:
            solve(problem)
    except SceneError as error:
        assert message in str(error), error
    except ZeroDivisionError:
        assert "ZeroDivisionError" in message
    else:
        raise AssertionError(message)


def main(what: str) -> None:
    """Compare, or fail as asked."""
    pull = (-0.05, 0.0)
    if what == "same":
        compare(None, "points", 0.05)
        compare(None, "facets", 0.05)
        compare([0.5, 1.0, 1.5, 2.0], "points", 0.1)
    elif what == "columns":
        columns()
    elif what == "stop":
        stopped()
    elif what == "refuse":
        broken = chain(pull)  # the last part belongs to the last rank
        broken.substructure("extra", lambda: 1 / 0, LinearElastic(E=1.0, nu=0.3))
        refused(broken, f"rank {WORLD.size - 1} failed: ZeroDivisionError")
        refused(chain(pull, "missing"), "interface 'j2', substructure 'b3': unknown face 'nowhere'")
        refused(chain(pull, "free"), "unattached rigid body")
        # nothing bears the pull: the contact opens
        refused(chain(pull, "lost"), "no equilibrium: 'b3', 'b4' has lost its support", solved=True)
        print(f"refused on rank {WORLD.rank}", flush=True)
    elif what == "crash":
        problem = assemble(chain(pull), comm=WORLD)
        if WORLD.rank == WORLD.size - 1:
            raise RuntimeError("only here")
        solve(problem)


if __name__ == "__main__":
    for each in sys.argv[1:]:
        main(each)
