"""Program of test_mpi.py: parts whose stiffness varies, over ranks and on one.

``mpirun -n N python mpi_stiffness.py``
"""

from __future__ import annotations

import faulthandler
from collections.abc import Mapping
from typing import Any

import numpy as np
from blocks import RANK, WORLD, row
from mpi4py import MPI

import dolfinx_frontend as lf
from dolfinx_frontend import (
    Contact,
    Elastic,
    LogNormal,
    Options,
    Problem,
    RandomField,
    Resultant,
    Scene,
    SceneError,
)

TIGHT = Options(rtol=1e-13, max_iterations=3000)
TESTED = 1e-10
ACTIVE = ["j1", "j2", "j3"]
MODULI = [100.0, 200.0, 300.0, 150.0]


def scene(moduli: Mapping[int, Any] | None = None, contact: bool = False) -> Scene:
    """Four blocks over the ranks; some of their moduli are random."""

    def law(k: int) -> Any:
        return Contact(friction=0.4) if contact and k == 2 else Elastic(normal=20.0, tangential=10.0)

    return row(law, [(moduli or {}).get(k, e) for k, e in enumerate(MODULI)], (-2.0, 0.3))


def same(what: str, one: Any, other: Any, size: float | None = None) -> None:
    """Refuse digits that differ."""
    one, other = np.asarray(one), np.asarray(other)
    off = np.abs(one - other).max() / (np.abs(other).max() if size is None else size)
    assert off < TESTED, (what, off)


def both(made: Scene) -> tuple[Problem, Problem]:
    """Over the ranks, and on each."""
    return lf.assemble(made, comm=WORLD), lf.assemble(made, comm=MPI.COMM_SELF)


def fields(what: str, spread: Any, whole: Any) -> None:
    """Refuse other forces and jumps."""
    for name in ACTIVE:
        for one, other in zip(spread.gathered(name), (whole.force(name), whole.jump(name)), strict=True):
            same(f"{what}, {name}", one, other)


def random() -> None:
    """Random factors and fields, in a chaos and in samples."""
    numbers = {0: LogNormal("E0", 100.0, cov=0.2), 3: LogNormal("E3", 150.0, cov=0.3)}
    settings: dict[str, Any] = {"active": ACTIVE, "options": TIGHT}
    germs = np.array([[0.3, -1.0], [-0.5, 0.4], [1.5, 0.1]])
    for problems in (both(scene(numbers)), both(scene(numbers, contact=True))):
        samples = [lf.sample(p, germs, progress=False, **settings) for p in problems]
        fields("samples", *samples)
    chaos = [lf.solve(p, chaos=2, **settings) for p in both(scene(numbers))]
    assert all(each.converged for each in chaos)
    for name in chaos[0].problem.substructures:
        same(f"chaos of {name}", chaos[0].coefficients(name), chaos[1].coefficients(name))
    numbers = {3: RandomField("E3", 150.0, cov=0.2, length=8.0, modes=2)}
    problems = both(scene(numbers))
    chaos = [lf.solve(p, chaos=2, **settings) for p in problems]
    for name in chaos[0].problem.substructures:
        same(f"field, chaos of {name}", chaos[0].coefficients(name), chaos[1].coefficients(name))
    samples = [lf.sample(p, germs, progress=False, **settings) for p in problems]
    fields("samples of a field", *samples)
    print(f"same random parts on rank {RANK}", flush=True)


def swept() -> None:
    """Moduli in a sweep, in a function, and other ones."""
    settings: dict[str, Any] = {"active": ACTIVE, "options": TIGHT}
    problems = both(scene())
    for grid in ({"b0.E": [90.0, 130.0], "b3.stiffness": [0.8, 1.1]}, {"b3.E": [90.0, 130.0]}):
        fields("sweep", *(lf.sweep(p, grid, progress=False, **settings) for p in problems))
    functions = [p.function(Resultant("j2"), ["b0.E", "b3.E"], **settings) for p in problems]
    same("function", *(f([[90.0, 120.0], [130.0, 200.0]]) for f in functions))
    new = {"b0.E": 120.0, "b3.E": RandomField("E3", 150.0, cov=0.2, length=8.0, modes=2)}
    other = [p.with_laws(values=new) for p in problems]
    assert other[0].parts["b0"].modulus == other[1].parts["b0"].modulus
    fields("other moduli", *(lf.solve(p, **settings) for p in other))
    fields("and a field", *(lf.sample(p, [[0.4, -0.2]], progress=False, **settings) for p in other))
    print(f"same swept parts on rank {RANK}", flush=True)


def heated() -> None:
    """Loads that come from a stiffness change with it."""
    made = scene({1: LogNormal("E1", 200.0, cov=0.2), 3: LogNormal("E3", 150.0, cov=0.3)})
    for k in (1, 3):
        made.temperature(f"b{k}", 40.0, 1e-3, name=f"heat{k}")
    settings: dict[str, Any] = {"active": ACTIVE, "options": TIGHT}
    problems = both(made)
    chaos = [lf.solve(p, chaos=2, **settings) for p in problems]
    for name in chaos[0].problem.substructures:
        same(f"heat, chaos of {name}", chaos[0].coefficients(name), chaos[1].coefficients(name))
    fields("heat", *(lf.sample(p, [[0.4, -0.2], [-1.0, 0.1]], progress=False, **settings) for p in problems))
    print(f"same heat on rank {RANK}", flush=True)


def errors() -> None:
    """What a chaos of few modes misses, and a stiffness that is none."""
    problems = both(scene({3: LogNormal("E3", 150.0, cov=0.3)}))
    chaos = [lf.solve(p, chaos=2, active=ACTIVE, options=TIGHT) for p in problems]
    one, other = (each.truncation("j3").sample for each in chaos)
    assert abs(one - other) < 1e-8 * other, (one, other)
    measured = [each.errors(Resultant("j1")) for each in chaos]
    assert measured[0].total > 0.0 and abs(measured[0].total - measured[1].total) < 1e-3 * measured[1].total
    spread, _ = both(scene({3: lf.Normal("E3", 150.0, cov=0.5)}))
    try:
        lf.sample(spread, [[-3.0]], progress=False)
    except SceneError as error:
        assert "stiffness that is not positive" in str(error), error
    else:
        raise AssertionError("a negative stiffness was taken")
    print(f"same errors on rank {RANK}", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(100, exit=True)
    random()
    swept()
    heated()
    errors()
