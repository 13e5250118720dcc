"""Program of test_mpi.py: what the first rank does for all, with the matrices or the answer of all.

``mpirun -n N python mpi_gather.py FOLDER``
"""

from __future__ import annotations

import faulthandler
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from blocks import RANK, WORLD, row
from mpi4py import MPI

import dolfinx_frontend as lf
from dolfinx_frontend import Contact, Elastic, LogNormal, Normal, Options, Perfect, Problem, Resultant

TESTED = 1e-10


def both(law: Any, moduli: tuple[float, ...] = (100.0, 200.0, 300.0, 150.0)) -> tuple[Problem, Problem]:
    """Blocks over the ranks, and on each."""
    made = row(law, moduli, (-2.0, 0.3))
    made.temperature("b3", 20.0, 1e-4, name="heat")
    return lf.assemble(made, comm=WORLD), lf.assemble(made, comm=MPI.COMM_SELF)


def content(file: Path) -> dict[str, Any]:
    """All data sets and attributes of a file by name."""
    found: dict[str, Any] = {}

    def note(name: str, node: Any) -> None:
        for key, value in node.attrs.items():
            found[f"{name}@{key}"] = value
        if isinstance(node, h5py.Dataset):
            found[name] = node[()]

    with h5py.File(file) as opened:
        opened.visititems(note)
    return found


def same_tree(one: dict[str, Any], other: dict[str, Any]) -> None:
    """Refuse other names, texts, or numbers beyond rounding."""
    # how the problem prints is not the same: it says nothing of materials
    assert one.keys() == other.keys(), one.keys() ^ other.keys()
    for name, value in one.items():
        if np.asarray(value).dtype.kind == "f":
            size = max(float(np.abs(other[name]).max(initial=0.0)), 1e-300)
            assert np.abs(value - other[name]).max(initial=0.0) < TESTED * size, name
        elif "sha256" not in name and "seal" not in name:
            assert np.array_equal(value, other[name]), (name, value, other[name])


def exported(folder: Path) -> None:
    """The folder that one rank would write."""

    def law(k: int) -> Any:
        return Contact(friction=0.4) if k == 2 else Perfect() if k == 3 else Elastic(20.0, 10.0)

    spread, whole = both(law)
    cases: dict[str, dict[str, Any]] = {
        "one": {},
        "sweep": {"grid": {"j1.normal": [10.0, 20.0]}},
    }
    for name, settings in cases.items():
        assert spread.export(folder / name, **settings) == folder / name
        if RANK == 0:
            whole.export(folder / f"{name} alone", **settings)
            mine, alone = (folder / each for each in (name, f"{name} alone"))
            same_tree(content(mine / "problem.h5"), content(alone / "problem.h5"))
            files = [sorted(p.name for p in (each / "matrices").iterdir()) for each in (mine, alone)]
            assert files[0] == files[1], files
    print(f"same folder on rank {RANK}", flush=True)


def proven() -> None:
    """A random stiffness that may be negative, on a structure that bears it or not."""
    for beds, definite in ((0.4, True), (1.6, False)):
        law = Elastic(normal=Normal("k", 20.0, cov=beds), tangential=10.0)
        found = []
        for problem in both(lambda k, law=law: law if k == 2 else Elastic(20.0, 10.0)):
            try:
                answer = lf.solve(problem, chaos=2, indefinite="prove", options=Options(rtol=1e-12))
                found.append(np.concatenate([each.ravel() for each in answer.gathered("j2")]))
            except lf.IndefiniteError as error:
                found.append(str(error))
        if isinstance(found[0], str) or isinstance(found[1], str):
            assert found[0] == found[1], found
        else:
            assert np.abs(found[0] - found[1]).max() < TESTED * np.abs(found[1]).max()
        assert isinstance(found[0], str) is not definite, found
    print(f"same proof on rank {RANK}", flush=True)


def journal(folder: Path) -> None:
    """A function with a checkpoint: the digits of one rank, and the same again from the file."""

    def law(k: int) -> Any:
        return Contact(friction=0.4) if k == 2 else Elastic(normal=LogNormal(f"k{k}", 20.0, cov=0.2))

    points = [[18.0, 23.0], [20.0, 20.0], [25.0, 15.0]]
    settings: dict[str, Any] = {"active": ["j1", "j2", "j3"], "options": Options(rtol=1e-12)}
    spread, whole = both(law)
    file = folder / "function.sqlite"
    exact = whole.function(Resultant("j2"), **settings)(points)
    calls = []
    for _ in range(2):
        function = spread.function(Resultant("j2"), checkpoint=file, **settings)
        values, slopes = function(points), function.derivatives(points[0])
        calls.append((values, slopes.values, function.seconds))
        function.close()
    (first, slopes, took), (again, same_slopes, less) = calls
    assert np.abs(first - exact).max() < TESTED * np.abs(exact).max()
    assert np.array_equal(first, again) and np.array_equal(slopes, same_slopes) and less < took
    try:
        spread.function(Resultant("j1"), checkpoint=file, **settings)
    except lf.SceneError as error:
        assert "checkpoint" in str(error) or "rank 0 failed" in str(error), error
    else:
        raise AssertionError("the file of another function was taken")
    print(f"same function on rank {RANK}", flush=True)


def reported(folder: Path) -> None:
    """The sheet of one rank, of a bolt on the last one."""
    made = row(lambda k: Contact(friction=0.3) if k > 1 else Elastic(20.0, 10.0), [100.0] * 4, (1.0, 0.05))
    last = "b2:x1", "b3:x0"
    made.interface("bolt", *last, Elastic(normal=50.0, tangential=0.01, jump=-0.1))
    made.interface("stud", "b1:x1", "b2:x0", Elastic(normal=50.0, tangential=0.01, jump=-0.2))
    sheets = []
    for problem, name in ((lf.assemble(made, comm=WORLD), "sheet"), (lf.assemble(made), f"alone{RANK}")):
        result = lf.solve(problem, options=Options(rtol=1e-8))
        sheets.append(lf.report(result, folder / name, errors="goal", pictures=False, units=("mm", "N")))
    one, other = sheets
    assert one.ranking == other.ranking and len(one.ranking) == 2, (one.ranking, other.ranking)
    assert one.sentences == other.sentences and one.left_out == other.left_out, (one, other)
    rows = [[each for each in sheet.table.rows()] for sheet in sheets]
    assert len(rows[0]) == len(rows[1]) > 10
    for mine, alone in zip(*rows, strict=True):
        for a, b in zip(mine, alone, strict=True):
            near = isinstance(a, float) and (abs(a - b) <= 1e-6 * max(abs(a), 1.0) or np.isnan([a, b]).all())
            assert a == b or near, (mine, alone)
    assert (folder / "sheet.html").exists() and (folder / "sheet.csv").exists()
    print(f"same sheet on rank {RANK}", flush=True)


def held() -> None:
    """Rigid groups, beams between faces, and loads that inertia balances."""
    settings: dict[str, Any] = {"options": Options(rtol=1e-12)}
    made = row(lambda k: Elastic(20.0, 10.0), [100.0, 200.0, 300.0, 150.0], (1.0, 0.05))
    made.rigid(["b1:y1", "b2:y1"], name="frame")
    spread, whole = lf.assemble(made, comm=WORLD), lf.assemble(made, comm=MPI.COMM_SELF)
    assert spread.distribution is not None
    owner = spread.distribution.owner
    assert owner["b1"] == owner["b2"] and len(set(owner.values())) == 2, owner
    found, exact = (lf.solve(p, **settings) for p in (spread, whole))
    for name, u in found.displacements.items():
        assert np.abs(u - exact.displacements[name]).max() < TESTED * np.abs(u).max(), name
    made = row(lambda k: Elastic(20.0, 10.0), [100.0] * 4, (1.0, 0.05), ranks=[None, 0, 1, None])
    made.rigid(["b1:y1", "b2:y1"], name="frame")
    try:
        lf.assemble(made, comm=WORLD)
    except lf.SceneError as error:
        assert "give these parts the same rank=" in str(error), error
    else:
        raise AssertionError("a rigid group on two ranks")
    made = lf.Scene()
    made.inertia_relief(7.8e-9)
    for k in range(3):
        block = lf.geometry.box((10.0, 10.0), (2, 3), origin=(10.0 * k, 0.0))
        made.substructure(f"b{k}", block, lf.LinearElastic(200e3, 0.3), degree=1)
    for k in range(1, 3):
        made.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", Elastic(1e4, 5e3))
    made.pressure("b2:x1", lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * -100.0)
    made.force("b0:y1", (3.0, 5.0), name="push")
    found, exact = (
        lf.solve(lf.assemble(made, comm=comm), times=[0.5, 1.0], **settings)
        for comm in (WORLD, MPI.COMM_SELF)
    )
    for name, u in found.displacements.items():
        assert np.abs(u - exact.displacements[name]).max() < TESTED * np.abs(u).max(), name
    print(f"same support on rank {RANK}", flush=True)


def compared() -> None:
    """Monolithic solutions: of one answer and another, and of a chaos; what is not held is refused on all."""

    def law(k: int) -> Any:
        random = LogNormal("k", 20.0, cov=0.2)
        return Perfect() if k == 3 else Elastic(normal=random if k == 2 else 20.0, tangential=10.0)

    def near(one: Any, other: Any) -> bool:
        return bool(np.abs(one - other).max() <= TESTED * np.abs(other).max())

    problems = both(law)
    values = None, {"j2.normal": 35.0}
    found, exact = ([lf.reference.monolithic(p, values=v) for v in values] for p in problems)
    for one, other in zip(found, exact, strict=True):
        assert one.u.keys() == problems[0].substructures.keys()
        assert all(near(u, other.u[name]) for name, u in one.u.items())
        assert all(near(force, other.forces[name]) for name, force in one.forces.items())
        assert all(near(w, other.traces[name][0]) for name, (w, *_) in one.traces.items())
        assert near(one.energy, other.energy)
    modulus = {"b3.E": LogNormal("E", 150.0, cov=0.1)}
    field = lf.RandomField("c", 150.0, cov=0.2, length=3.0, modes=2)
    for more, solver in (({}, "cg"), (modulus, "direct"), ({"b3.E": field}, "cg")):
        one, other = (
            lf.reference.ssfem(p.with_laws(values=more), lf.Chaos(2), solver=solver) for p in problems
        )
        assert all(near(modes, other.coefficients[name]) for name, modes in one.coefficients.items()), more
        for name in ("j1", "j2"):
            assert near(one.force_coefficients(name), other.force_coefficients(name)), (more, name)
        assert near(one.jump_coefficients("j3"), other.jump_coefficients("j3"))
        assert one.converged and one.unknowns == other.unknowns
    least = [lf.reference.smallest_eigenvalue(p, lf.Chaos(2)) for p in problems]
    assert near(*map(np.array, least)), least
    made = both(lambda k: Contact() if k == 2 else Elastic(20.0, 10.0))[0]
    for call in (lambda: lf.reference.monolithic(made), lambda: lf.reference.ssfem(made, lf.Chaos(1))):
        try:
            call()
        except lf.SceneError as error:
            assert "j2" in str(error) and ("rank 0 failed" in str(error)) is (RANK > 0), error
        else:
            raise AssertionError("a contact has no monolithic solution")
    print(f"same reference on rank {RANK}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    exported(Path(sys.argv[1]))
    proven()
    journal(Path(sys.argv[1]))
    reported(Path(sys.argv[1]))
    held()
    compared()
