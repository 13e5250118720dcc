"""Estimated against true errors, and how often ``accuracy=`` reaches the accuracy.

``./run bench estimates [--json FILE] [--markdown benchmarks/measured/estimates.md] [--quick]``

Three scenes: the coarse bolted vessel with random screw and joint, two blocks whose joint is a random field,
and the coarse bolted lap joint in contact and friction with random cuts of its bolts.

*algebraic*: the estimate of the iteration (energy norm) against the error that it is an estimate of, over
search directions k x 0.01 .. x 100 and tolerances 1e-2 .. 1e-8. *truncation*: the estimate of
``result.errors`` for mean and standard deviation of a quantity, orders 1 .. 5, against a chaos of order 12
(two germs; 9 if normal) or 7. *promise*: runs of ``solve(accuracy=...)``: true error (the larger of mean and
standard deviation), and the time over that of the cheapest setting that reaches the accuracy. *gap*: the same
for a contact with a random gap, *held out* (``--held-out``) for cases that the rules were not made on.
*discretisation*: estimates of ``discretisation.estimate`` against closed forms and fine meshes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import Any

import common
import numpy as np

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    Gamma,
    IndefiniteError,
    LinearElastic,
    LogNormal,
    Normal,
    Options,
    Problem,
    RandomField,
    RandomLaws,
    Resultant,
    SampleResult,
    Scene,
    Uniform,
    assemble,
    geometry,
    solve,
    tensor_quadrature,
)
from dolfinx_frontend.estimate.mesh_error import discretisation_error as of_meshes
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan.plan import Direction, Plan
from dolfinx_frontend.uncertainty.statistics import MeanStd
from parts.lap_joint import lap_joint
from parts.vessel import bolted_vessel
from tests.verification import test_accuracy, test_discretisation

FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4)
ORDERS = (1, 2, 3, 4, 5)
FINEST = Options(rtol=1e-12, max_iterations=5000)


@dataclass
class Case:
    """A random scene, its quantities, and how it is solved."""

    name: str
    problem: Problem
    quantities: tuple[Resultant, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    linear: bool = True
    accuracies: tuple[float, ...] = ACCURACIES
    exact: dict[Resultant, MeanStd] | None = None


def vessel(screw: Any, joint: Any, name: str) -> Case:
    """The bolted vessel: force of the screw, closing of the joint."""
    demo = common.demo("bolted_vessel")
    problem = assemble(demo.vessel_scene(bolted_vessel("coarse"), screw, joint))
    return Case(name, problem, (Resultant("screw"), Resultant("joint", "jump")))


def blocks(cov: float, length: float, captured: float, name: str) -> Case:
    """Two blocks, pulled and sheared, with a random field between them."""
    layer = RandomField(
        "joint",
        mean=2000.0,
        cov=cov,
        covariance="exponential",
        length=length,
        variance_captured=captured,
        distribution="lognormal",
    )
    scene = Scene()
    for part, x0 in (("left", 0.0), ("right", 20.0)):
        box = geometry.box((20.0, 10.0, 10.0), (4, 3, 3), origin=(x0, 0.0, 0.0), cell="hexahedron")
        scene.substructure(part, box, LinearElastic(E=200e3, nu=0.3), degree=2)
    scene.interface("layer", "left:x1", "right:x0", Elastic(normal=layer, tangential=layer))
    scene.fix("left:x0")
    scene.traction("right:x1", (10.0, 0.0, -2.0))
    both = (Resultant("layer", "jump"), Resultant("layer", "jump", 2))
    return Case(name, assemble(scene), both)


def lap(bolt: Any, name: str) -> Case:
    """The lap joint, tightened and sheared: the force of a bolt at the end."""
    demo = common.demo("bolted_lap_joint")
    scene = demo.build_scene(lap_joint(12.0), demo.SHEAR * (0.05, 0.0, 0.0))
    cut = Elastic(normal=bolt, tangential=bolt, total=True, jump=demo.TIGHTEN * -demo.SHORTENING)
    problem = assemble(scene).with_laws(dict.fromkeys(demo.CUTS, cut))
    return Case(name, problem, (Resultant("cut1"),), {"times": (1.0, 2.0)}, False, ACCURACIES[:3])


CASES: dict[str, Callable[[], Case]] = {
    "vessel, normal": lambda: vessel(
        Normal("screw", 2.5e4, cov=0.1), Normal("joint", 100.0, cov=0.2), "vessel, normal"
    ),
    "vessel, lognormal": lambda: vessel(
        LogNormal("screw", 2.5e4, cov=0.2), LogNormal("joint", 100.0, cov=0.4), "vessel, lognormal"
    ),
    "vessel, uniform": lambda: vessel(
        Uniform("screw", mean=2.5e4, cov=0.1), Gamma("joint", 100.0, cov=0.3), "vessel, uniform and gamma"
    ),
    "blocks, field": lambda: blocks(0.3, 10.0, 0.7, "blocks, short field"),
    "lap joint, bolts": lambda: lap(LogNormal("bolt", 2e5, cov=0.2), "lap joint, bolts lognormal"),
    "blocks, long field": lambda: blocks(0.5, 60.0, 0.7, "blocks, long field"),
}

HELD_OUT: dict[str, Callable[[], Case]] = {
    "vessel, two lognormal": lambda: vessel(
        LogNormal("screw", 2.5e4, cov=0.1), LogNormal("joint", 100.0, cov=0.25), "vessel, other lognormal"
    ),
    "vessel, gamma": lambda: vessel(
        Gamma("screw", 2.5e4, cov=0.25), Uniform("joint", mean=100.0, cov=0.2), "vessel, gamma and uniform"
    ),
    "vessel, wide": lambda: vessel(
        Normal("screw", 2.5e4, cov=0.15), Gamma("joint", 100.0, cov=0.45), "vessel, normal and wide gamma"
    ),
    "blocks, 15": lambda: blocks(0.4, 15.0, 0.7, "blocks, medium field"),
    "blocks, 40": lambda: blocks(0.2, 40.0, 0.7, "blocks, smooth field"),
}
"""Not looked at while the rules of ``accuracy=`` were made, unlike those above."""


def gap(spread: float) -> Case:
    """Two rods with a random gap of 8 um, pressed by 10 um: contact with a kink, in closed form."""
    problem, exact = test_accuracy.rods(spread)
    quantity = Resultant("gap")
    exact = {quantity: exact}
    return Case(f"rods, gap 0.008 +- {spread:.2g}", problem, (quantity,), {}, False, ACCURACIES[:3], exact)


GAPS = {f"gap {s:.2g}": partial(gap, s) for s in np.geomspace(2e-4, 8e-3, 12)}
PROMISES: dict[str, dict[str, Callable[[], Case]]] = {"promise": CASES, "held out": HELD_OUT, "gap": GAPS}


# --- algebraic ------------------------------------------------------------------------------------
def defaults(problem: Problem, plan: Plan) -> dict[str, Any]:
    """The search direction of the plan, interface by interface."""
    core = bridge.build(problem, plan).structure
    found = {}
    for name in plan.active:
        interface = problem.interfaces[name]
        count = interface.num_points * interface.law.count(interface.dim)
        first = core.first_rows(name)[0]
        found[name] = core.directions[first : first + count].reshape(interface.num_points, -1)[:, 0].copy()
    return found


def difference(scale: float, one: Any, exact: Any) -> float:
    """What is estimated: the larger relative error of strain energy and interface displacement."""
    weights = one.solver.weights[:, None]
    traces = exact.state.traces
    forces = exact.state.data - exact.solver.directions[:, None] * traces
    w = one.state.traces - traces
    f = one.state.data - one.solver.directions[:, None] * one.state.traces - forces
    strain, of_traces = float(np.sum(w * weights * f)), float(scale * np.sum(weights * w**2))
    whole = exact.summary.energy + scale * float(np.sum(weights * traces**2))
    return float(max(np.sqrt(abs(strain) / exact.summary.energy), np.sqrt(of_traces / whole)))


def algebraic(
    name: str,
    problem: Problem,
    settings: dict[str, Any],
    factors: tuple[float, ...] = FACTORS,
    tolerances: tuple[float, ...] = TOLERANCES,
) -> list[dict[str, Any]]:
    """Estimate and error for each search direction and tolerance."""
    options = settings.pop("options", Options())
    exact = solve(problem, options=Options(rtol=3e-13, max_iterations=20000), **settings)
    about = common.settled(exact, min(tolerances))
    plan = exact.plan
    scale = bridge._scale(problem, plan)
    usual = defaults(problem, plan)
    rows = []
    for factor in factors:
        direction = Direction(given={n: k * factor for n, k in usual.items()})
        for rtol in tolerances:
            tried = options.with_(rtol=rtol, max_iterations=2500)
            result = solve(problem, options=tried, direction=direction, **settings)
            true = difference(scale, result, exact)
            rows.append(
                {
                    "scene": name,
                    "factor": factor,
                    "rtol": rtol,
                    "status": result.status,
                    "iterations": result.iterations,
                    "estimate": result.error,
                    "true": true,
                    "ratio": result.error / true if true > 0.0 else np.inf,
                    "exact": about,
                }
            )
    return rows


def algebraic_scenes() -> list[tuple[str, Problem, dict[str, Any]]]:
    """Deterministic vessel, all its interfaces kept or two; the lap joint; chaos of the blocks."""
    plain = assemble(common.demo("bolted_vessel").vessel_scene(bolted_vessel("coarse")))
    demo = common.demo("bolted_lap_joint")
    joint = assemble(demo.build_scene(lap_joint(12.0), demo.SHEAR * (0.05, 0.0, 0.0)))
    field = CASES["blocks, field"]().problem
    times = {"times": (1.0, 2.0)}
    found: list[tuple[str, Problem, dict[str, Any]]] = [
        ("vessel, joint and screw kept", plain, {"method": "accelerated"}),
        ("vessel, all kept", plain, {"method": "accelerated", "active": "all"}),
        ("lap joint, contact and friction", joint, {**times, "options": Options(newton=0)}),
    ]
    return found + [
        (f"blocks, chaos of order {order}", field, {"chaos": Chaos(order)}) for order in ORDERS
    ]


# --- truncation -----------------------------------------------------------------------------------
def truth(case: Case) -> tuple[dict[Resultant, MeanStd], dict[str, Any]]:
    """Moments that are much more accurate than those compared, and how they were computed."""
    if case.exact:
        return case.exact, {"how": "closed form"}
    if not case.linear:
        drawn = tensor_quadrature(
            case.problem, 24, options=Options(rtol=1e-8), progress=False, **case.settings
        )
        if not drawn.converged:
            raise RuntimeError(f"{case.name}: points of the reference did not converge")
        return {q: drawn.mean_std(q) for q in case.quantities}, {"how": "24 points", "status": "converged"}
    few = RandomLaws.of(case.problem).space.dimension <= 2
    for order in (12, 9, 7) if few else (7,):
        try:
            fine = solve(case.problem, chaos=order, options=FINEST, **case.settings)
            break
        except IndefiniteError:
            if order == 7:
                raise
    about = {"how": f"order {order}", **common.settled(fine, 1e-10)}
    return {q: fine.mean_std(q) for q in case.quantities}, about


def off(found: MeanStd, exact: MeanStd) -> tuple[float, float]:
    """Relative errors of mean and standard deviation."""
    assert found.std is not None and exact.std is not None
    return abs(found.mean / exact.mean - 1.0), abs(found.std / exact.std - 1.0)


def truncation(case: Case, exact: dict[Resultant, MeanStd]) -> list[dict[str, Any]]:
    """Estimates of ``errors`` against the truth, orders 1 to 5."""
    rows = []
    for order in ORDERS:
        result = solve(case.problem, chaos=order, options=Options(rtol=1e-10), **case.settings)
        for quantity in case.quantities:
            made = result.errors(quantity)
            found, share = result.mean_std(quantity), made.truncation
            assert share is not None and share.quantity is not None and share.std is not None
            true = off(found, exact[quantity])
            estimates = (share.quantity / abs(found.mean), share.std / (found.std or np.inf))
            for what, estimate, error in zip(("mean", "deviation"), estimates, true, strict=True):
                rows.append(
                    {
                        "scene": case.name,
                        "quantity": str(quantity),
                        "of": what,
                        "order": order,
                        "estimate": estimate,
                        "true": error,
                        "ratio": estimate / error if error > 1e-10 else None,
                    }
                )
    return rows


# --- promise --------------------------------------------------------------------------------------
def promise(case: Case, exact: dict[Resultant, MeanStd], repeats: int = 1) -> list[dict[str, Any]]:
    """``accuracy=`` compared with the cheapest setting: order (or rule for nonlinear laws) and tolerance."""
    front: list[tuple[float, dict[Resultant, float]]] = []
    for size, rtol in product(range(1, 7), (1e-2, 1e-3, 1e-4, 1e-6)):
        chaos = Chaos(size, check_points=0)
        runs = [partial(solve, case.problem, chaos=chaos, options=Options(rtol=rtol), **case.settings)]
        if not case.linear:
            # as in the demo: Newton's dense steps do not pay in a sweep
            how = {"options": Options(rtol=rtol, newton=0), "progress": False}
            for points in (2 * size, 2 * size + 1):
                runs.append(partial(tensor_quadrature, case.problem, points, **how, **case.settings))
        for run in runs:
            try:
                timed = common.timed(run, repeats)
            except IndefiniteError:
                continue
            errors = {q: max(off(timed.value.mean_std(q), exact[q])) for q in case.quantities}
            front.append((timed.seconds, errors))
    rows = []
    for quantity in case.quantities:
        for accuracy in case.accuracies:
            how = {"accuracy": accuracy, "quantity": quantity, "meshes": False}
            timed = common.timed(partial(solve, case.problem, **how, **case.settings), repeats)
            result = timed.value
            true = max(off(result.mean_std(quantity), exact[quantity]))
            fits = [seconds for seconds, errors in front if errors[quantity] <= accuracy]
            rows.append(
                {
                    "scene": case.name,
                    "quantity": str(quantity),
                    "accuracy": accuracy,
                    "true": true,
                    "said": result.errors().total,
                    "kept": true <= accuracy,
                    "size": sized(result),
                    "seconds": timed.seconds,
                    "over_cheapest": timed.seconds / min(fits) if fits else None,
                }
            )
    return rows


def sized(result: Any) -> str:
    """How many modes, or points of which kind."""
    if not isinstance(result, SampleResult):
        return str(result.modes)
    return f"{'rule' if result.sampling == 'quadrature' else 'samples'} of {len(result.germs)}"


# --- discretisation -------------------------------------------------------------------------------
QUADS, BRICKS = ("quadrilateral", "triangle"), ("hexahedron", "tetrahedron")


def in_energy() -> list[tuple[str, tuple[str, str], tuple[int, int], Any, Any]]:
    """Scene, cells, coarse and fine meshes, problem, and the true error of an answer."""
    meshes = test_discretisation
    cube = meshes.strain_energy(solve(meshes.loaded_cube(4, "hexahedron", 3)))
    rough, fine = (meshes.strain_energy(solve(meshes.corner(n, "quadrilateral", 2))) for n in (16, 32))
    corner = fine + (fine - rough) / (2.0 ** (2.0 * meshes.LAMBDA) - 1.0)

    def short_of(exact: float) -> Any:
        def error(result: Any, degree: int) -> float:
            energy = meshes.strain_energy(result)
            return float(np.sqrt((exact - energy) / energy))

        return error

    return [
        ("split ring", QUADS, (4, 8), meshes.split_ring, meshes.ring_error),
        ("cube, smooth", BRICKS, (2, 4), meshes.loaded_cube, short_of(cube)),
        ("L, re-entrant corner", QUADS, (2, 16), meshes.corner, short_of(corner)),
    ]


def in_quantity() -> list[tuple[str, tuple[str, str], tuple[int, int], Any, Resultant, float]]:
    """Scene, cells, meshes, problem, quantity and its true value."""
    meshes, ring = test_discretisation, test_discretisation.RING
    joint, support = Resultant("joint"), Resultant("ground")
    best = solve(meshes.bolted(8, "hexahedron", 2))
    fine = {q: of_meshes(best, q) for q in (joint, support)}
    blocks = {q: found.value + found.correction for q, found in fine.items()}
    force = -ring.pressure() * np.pi / 2.0 * ring.c
    return [
        ("split ring, joint force", QUADS, (4, 8), meshes.split_ring, joint, force),
        ("two blocks, joint force", BRICKS, (2, 4), meshes.bolted, joint, blocks[joint]),
        ("two blocks, shear force of the support", BRICKS, (2, 4), meshes.bolted, support, blocks[support]),
    ]


def discretisation() -> list[dict[str, Any]]:
    """Estimated and true errors of the meshes."""
    rows = []

    def add(kind: str, scene: str, cell: str, n: int, degree: int, estimated: float, true: float) -> None:
        row = {"kind": kind, "scene": scene, "cell": cell, "n": n, "degree": degree}
        rows.append(row | {"estimate": estimated, "true": true, "ratio": estimated / true})

    for scene, cells, sizes, build, error in in_energy():
        for cell, degree, n in product(cells, (1, 2), sizes):
            result = solve(build(n, cell, degree))
            add("energy", scene, cell, n, degree, of_meshes(result).energy, error(result, degree))
    for scene, cells, sizes, build, quantity, exact in in_quantity():
        for cell, degree, n in product(cells, (1, 2), sizes):
            found = of_meshes(solve(build(n, cell, degree)), quantity)
            true = abs(found.value / exact - 1.0)
            add("quantity", scene, cell, n, degree, found.quantity / abs(exact), true)
    law, side = Contact(friction=0.4), Resultant("side")
    fine, rough = (solve(test_discretisation.sheared(n, law), times=[0.0, 1.0, 2.0]) for n in (16, 4))
    found, exact = of_meshes(rough, side, 2), side.value(fine)[2]
    true = abs(found.value / exact - 1.0)
    add("quantity", "friction, force of the side", QUADS[0], 4, 1, found.quantity / abs(exact), true)
    return rows


# --- report ---------------------------------------------------------------------------------------
def within(rows: list[dict[str, Any]]) -> tuple[int, int]:
    """Rows whose estimate is within a factor of three, and all that have a ratio."""
    ratios = [r["ratio"] for r in rows if r["ratio"] is not None and r.get("status") in (None, "converged")]
    return sum(1 / 3 <= ratio <= 3 for ratio in ratios), len(ratios)


def spread(rows: list[dict[str, Any]]) -> list[str]:
    """Smallest, median and largest ratio."""
    ratios = [r["ratio"] for r in rows if r["ratio"] is not None and r.get("status") in (None, "converged")]
    if not ratios:
        return ["-", "-", "-"]
    return [f"{x:.2g}" for x in (min(ratios), float(np.median(ratios)), max(ratios))]


def tables(record: dict[str, Any]) -> dict[str, tuple[tuple[str, ...], list[list[str]]]]:
    """Header and rows of each table."""
    made: dict[str, tuple[tuple[str, ...], list[list[str]]]] = {}
    rows = []
    for scene in dict.fromkeys(r["scene"] for r in record["algebraic"]):
        for factor in FACTORS:
            mine = [r for r in record["algebraic"] if r["scene"] == scene and r["factor"] == factor]
            if mine:
                good, count = within(mine)
                counts = [f"{good} of {count}", f"{len(mine) - count}"]
                rows.append([scene, f"{factor:g}", *spread(mine), *counts])
    header = ("scene", "k x", "smallest", "median", "largest", "within 1/3 .. 3", "not converged")
    made["algebraic"] = (header, rows)
    rows = []
    for scene in dict.fromkeys(r["scene"] for r in record["truncation"]):
        for order in ORDERS:
            mine = [r for r in record["truncation"] if r["scene"] == scene and r["order"] == order]
            good, count = within(mine)
            worst = max(r["true"] for r in mine)
            rows.append([scene, str(order), f"{worst:.1e}", *spread(mine), f"{good} of {count}"])
    header = ("scene", "order", "largest error", "smallest", "median", "largest", "within 1/3 .. 3")
    made["truncation"] = (header, rows)
    for name in PROMISES:
        rows = []
        for r in record[name]:
            ratio = "-" if r["over_cheapest"] is None else f"{r['over_cheapest']:.1f}"
            rows.append(
                [r["scene"], r["quantity"], f"{r['accuracy']:g}", f"{r['true']:.1e}", f"{r['said']:.1e}"]
                + [r["size"], ratio]
            )
        header = ("scene", "quantity", "asked", "true", "said", "modes", "time / cheapest")
        made[name] = (header, rows)
    header = ("scene", "cell", "P1, coarse", "P1, fine", "P2, coarse", "P2, fine")
    for kind in ("energy", "quantity"):
        groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for r in record["discretisation"]:
            if r["kind"] == kind:
                groups.setdefault((r["scene"], r["cell"]), []).append(r)
        rows = []
        for (scene, cell), mine in groups.items():
            sizes = ", ".join(str(n) for n in dict.fromkeys(r["n"] for r in mine))
            cells = [f"{r['true']:.1e}: {r['ratio']:.2f}" for r in mine]
            rows.append([f"{scene}, n = {sizes}", cell, *cells, *[""] * (4 - len(cells))])
        made[f"discretisation in {kind}"] = (header, rows)
    return made


def written(path: Path, record: dict[str, Any]) -> None:
    """Put the tables between their marks in a page."""
    for name, (header, rows) in tables(record).items():
        if rows:
            common.between_marks(path, name, common.markdown_table(header, rows))
    print(f"\nwritten to {path}")


def main() -> None:
    """Measure and report."""
    parser = common.parser("estimates", __doc__)
    parser.add_argument("--markdown", type=Path, help="page with marks, benchmarks/measured/estimates.md")
    parser.add_argument("--quick", action="store_true", help="every other tolerance, three directions")
    parts = ["algebraic", "truncation", "promise", "gap", "discretisation"]
    parser.add_argument("--only", nargs="*", choices=parts, default=parts)
    parser.add_argument("--held-out", action="store_true", help="only the promise, on the held-out cases")
    parser.add_argument("--cases", nargs="*", default=None, help="some of truncation, promise, gap")
    given = parser.parse_args()
    chosen = {"held out"} if given.held_out else set(given.only)
    warnings.simplefilter("ignore")
    record: dict[str, Any] = {"environment": common.environment()}
    record |= {name: [] for name in ("algebraic", "truncation", *PROMISES, "discretisation")}
    record["exact"] = {}
    if "algebraic" in chosen:
        grid = (FACTORS[1:4], TOLERANCES[::2]) if given.quick else (FACTORS, TOLERANCES)
        for name, problem, settings in algebraic_scenes():
            began = perf_counter()
            record["algebraic"] += algebraic(name, problem, settings, *grid)
            print(f"{name}: {perf_counter() - began:.0f} s", flush=True)
    for group, cases in PROMISES.items():
        for name, build in cases.items():
            if not {group, "truncation" if group == "promise" else group} & chosen:
                continue
            if given.cases is not None and name not in given.cases:
                continue
            case = build()
            began = perf_counter()
            exact, record["exact"][case.name] = truth(case)
            if "truncation" in chosen and case.linear:
                record["truncation"] += truncation(case, exact)
            if group in chosen:
                record[group] += promise(case, exact, 1 if given.quick else given.repeats)
            print(f"{case.name}: {perf_counter() - began:.0f} s", flush=True)
    if "discretisation" in chosen:
        record["discretisation"] = discretisation()
    for header, rows in tables(record).values():
        if rows:
            common.table(header, rows)
    for kind in ("algebraic", "truncation"):
        good, count = within(record[kind])
        print(f"{kind}: {good} of {count} estimates within a factor of three")
    for name in filter(record.get, PROMISES):
        print(f"{name}: {sum(r['kept'] for r in record[name])} of {len(record[name])} kept")
    common.write_json(record, given.json)
    if given.markdown is not None:
        written(given.markdown, record)


if __name__ == "__main__":
    main()
