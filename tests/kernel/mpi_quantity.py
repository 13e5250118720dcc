"""Quantities of interfaces that one rank has, on two: all ranks get the same numbers, or all raise.

Started by ``test_mpi.py``: prints ``same answer`` and ``failed together`` once per rank.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from dolfinx_frontend import (
    AtPoint,
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Measure,
    Options,
    Resultant,
    Scene,
    assemble,
    discretisation_error,
    geometry,
    solve,
)
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError

COMM = MPI.COMM_WORLD


def chain(law: Callable[[int], Any], comm: Any) -> Problem:
    """Four blocks on a soft bed, two on each rank."""
    scene = Scene()
    for k in range(4):
        scene.substructure(
            f"b{k}",
            lambda k=k: geometry.box((10.0, 10.0), (2, 2), origin=(10.0 * k, 0.0)),
            LinearElastic(200.0, 0.3),
            degree=1,
        )
    scene.fix("b0:x0", name="wall")
    for k in range(1, 4):
        scene.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", law(k))
        scene.interface(f"bed{k}", f"b{k}:y0", Elastic(3.0, 3.0))
    scene.traction("b3:x1", (-2.0, 0.3), name="pull")
    return assemble(scene, comm=comm)


LAWS: dict[str, Callable[[int], Any]] = {
    "elastic": lambda k: Elastic(100.0, 100.0),
    "contact": lambda k: Contact(friction=0.3),
    "random": lambda k: Elastic(LogNormal(f"k{k}", 100.0, cov=0.2), 100.0),
}


def main() -> None:
    """Every law, with interfaces of either rank and the one between them; then one that has no force."""
    warnings.simplefilter("ignore")
    for kind, law in LAWS.items():
        problem, alone = chain(law, COMM), chain(law, MPI.COMM_SELF)
        for name in ("j1", "j2", "j3"):
            accuracy = 1e-2 if kind == "random" else 1e-4
            result = solve(problem, accuracy=accuracy, quantity=name, meshes=False)
            found = result.errors().moments
            other = solve(alone, accuracy=accuracy, quantity=name, meshes=False).errors().moments
            assert found is not None and other is not None
            every = COMM.allgather(found)
            assert len(set(every)) == 1, (kind, name, every)
            # the same quantity: how good its estimate is, other tests say
            away = abs(found.mean / other.mean - 1.0)
            assert away <= 10.0 * accuracy, (kind, name, found, other)
    # functions of the fields that no rank has all of
    problem, alone = chain(LAWS["contact"], COMM), chain(LAWS["contact"], MPI.COMM_SELF)

    def ends(fields: Any) -> Any:
        jump = fields.displacement("b3").max(axis=-1) - fields.displacement("b0").max(axis=-1)
        return fields.force("j1")[..., 0].min(axis=1) + fields.force("bed3")[..., 1].max(axis=1) + jump

    values = [
        solve(p, accuracy=1e-4, quantity=Measure(ends, "both ends"), meshes=False).mean_std(
            Measure(ends, "both ends")
        )
        for p in (problem, alone)
    ]
    assert len(set(COMM.allgather(values[0].mean))) == 1
    assert abs(values[0].mean - values[1].mean) <= 1e-3 * abs(values[1].mean), values
    # numbers at points: all ranks make them, whoever has the part, and all know them
    for part, x, of, component in (("b3", 33.0, "stress", "xy"), ("b0", 4.0, "displacement", "x")):
        values = []
        for p in (problem, alone):
            probe = AtPoint(p, part, (x, 4.0), of, component)
            values.append(solve(p, accuracy=1e-4, quantity=probe, meshes=False).mean_std(Measure(probe)).mean)
        assert len(set(COMM.allgather(values[0]))) == 1
        assert abs(values[0] - values[1]) <= 1e-3 * abs(values[1]), (part, values)
    for point in ((55.0, 4.0), (33.0,)):  # whoever catches it goes on
        try:
            AtPoint(problem, "b3", point)
        except SceneError as error:
            assert "outside the part" in str(error) or "2 numbers" in str(error), error
        else:
            raise AssertionError(f"no such point: {point}")
    print(f"same answer on rank {COMM.rank}", flush=True)
    problem, alone = chain(LAWS["elastic"], COMM), chain(LAWS["elastic"], MPI.COMM_SELF)
    # the reaction of a support that was assembled across, and what its error is
    tight = Options(rtol=1e-12)
    results = [solve(p, options=tight) for p in (problem, alone)]
    found, other = (discretisation_error(each, Resultant("wall")) for each in results)
    for one, exact in ((found.value, other.value), (found.correction, other.correction)):
        assert abs(one - exact) < 1e-8 * abs(other.value), (found, other)
    for _ in range(2):  # whoever catches it goes on: the next collective call must not hang
        try:
            solve(problem, accuracy=1e-3, quantity=Resultant("wall", component=2))
        except SceneError:
            continue
        raise AssertionError("a reaction has no third component in two dimensions")
    print(f"failed together on rank {COMM.rank}", flush=True)


main()
