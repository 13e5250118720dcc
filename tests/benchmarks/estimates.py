"""Estimated against true errors, and what ``accuracy=`` keeps of its promise.

``./run bench estimates [--json FILE] [--markdown docs/accuracy.md] [--quick]``

Three scenes: the coarse bolted vessel with random screw and joint, two blocks whose joint is a random field,
and the coarse bolted lap joint in contact and friction with random cuts of its bolts.

*algebraic*: the estimate of the iteration (energy norm) against the error that it is an estimate of, over
search directions k x 0.01 .. x 100 and tolerances 1e-2 .. 1e-8. *truncation*: the estimate of
``result.errors`` for mean and standard deviation of a quantity, orders 1 .. 5, against a chaos of order 12
(two germs; 9 if normal) or 7. *promise*: runs of ``solve(accuracy=...)``: true error (the larger of mean and
standard deviation), and the time in units of the cheapest order and tolerance that reach the accuracy.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import common
import numpy as np

from dolfinx_frontend import (
    Chaos,
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
    Scene,
    Uniform,
    assemble,
    bridge,
    geometry,
    solve,
    tensor_quadrature,
)
from dolfinx_frontend.accuracy import Moments, moments
from dolfinx_frontend.lap_joint import lap_joint
from dolfinx_frontend.plan import Direction, Plan

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


def vessel(screw: Any, joint: Any, name: str) -> Case:
    """The bolted vessel: force of the screw, closing of the joint."""
    demo = common.demo("bolted_vessel")
    problem = assemble(demo.vessel_scene(geometry.bolted_vessel("coarse"), screw, joint))
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
        Normal("screw", 2.5e4, 0.1), Normal("joint", 100.0, 0.2), "vessel, normal"
    ),
    "vessel, lognormal": lambda: vessel(
        LogNormal("screw", 2.5e4, 0.2), LogNormal("joint", 100.0, 0.4), "vessel, lognormal"
    ),
    "vessel, uniform": lambda: vessel(
        Uniform("screw", mean=2.5e4, cov=0.1), Gamma("joint", 100.0, 0.3), "vessel, uniform and gamma"
    ),
    "blocks, field": lambda: blocks(0.3, 10.0, 0.7, "blocks, short field"),
    "lap joint, bolts": lambda: lap(LogNormal("bolt", 2e5, 0.2), "lap joint, bolts lognormal"),
    "blocks, long field": lambda: blocks(0.5, 60.0, 0.7, "blocks, long field"),
}

HELD_OUT: dict[str, Callable[[], Case]] = {
    "vessel, two lognormal": lambda: vessel(
        LogNormal("screw", 2.5e4, 0.1), LogNormal("joint", 100.0, 0.25), "vessel, other lognormal"
    ),
    "vessel, gamma": lambda: vessel(
        Gamma("screw", 2.5e4, 0.25), Uniform("joint", mean=100.0, cov=0.2), "vessel, gamma and uniform"
    ),
    "vessel, wide": lambda: vessel(
        Normal("screw", 2.5e4, 0.15), Gamma("joint", 100.0, 0.45), "vessel, normal and wide gamma"
    ),
    "blocks, 15": lambda: blocks(0.4, 15.0, 0.7, "blocks, medium field"),
    "blocks, 40": lambda: blocks(0.2, 40.0, 0.7, "blocks, smooth field"),
}
"""Not looked at while the rules of ``accuracy=`` were made, unlike those above."""


# --- algebraic ------------------------------------------------------------------------------------
def defaults(problem: Problem, plan: Plan) -> dict[str, Any]:
    """The search direction of the plan, interface by interface."""
    core = bridge.build(problem, plan)
    found = {}
    for name in plan.active:
        interface = problem.interfaces[name]
        count = interface.num_points * bridge.law_fields(interface, interface.law.nominal).components
        first = core.first_rows(name)[0]
        found[name] = core.directions[first : first + count].reshape(interface.num_points, -1)[:, 0].copy()
    return found


def difference(scale: float, one: Any, exact: Any) -> float:
    """What the estimate means: the larger of the shares in strain energy and in interface displacement."""
    weights = one.core.weights[:, None]
    traces = exact.state.traces
    forces = exact.state.data - exact.core.directions[:, None] * traces
    w = one.state.traces - traces
    f = one.state.data - one.core.directions[:, None] * one.state.traces - forces
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
    exact = solve(problem, options=options.with_(rtol=3e-13, max_iterations=20000), **settings)
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
                }
            )
    return rows


def algebraic_scenes() -> list[tuple[str, Problem, dict[str, Any]]]:
    """Deterministic vessel, all its interfaces kept or two; the lap joint; chaos of the blocks."""
    plain = assemble(common.demo("bolted_vessel").vessel_scene(geometry.bolted_vessel("coarse")))
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
def truth(case: Case) -> dict[Resultant, Moments]:
    """Moments far beyond what is compared."""
    if case.linear:
        few = RandomLaws.of(case.problem).space.dimension <= 2
        for order in (12, 9, 7) if few else (7,):
            try:
                fine = solve(case.problem, chaos=order, options=FINEST, **case.settings)
            except IndefiniteError:
                continue
            return {q: moments(fine, q) for q in case.quantities}
        fine = solve(case.problem, chaos=7, options=FINEST, **case.settings)
    else:
        fine = tensor_quadrature(
            case.problem, 24, plan_options=Options(rtol=1e-8, newton=0), progress=False, **case.settings
        )
    return {q: moments(fine, q) for q in case.quantities}


def off(found: Moments, exact: Moments) -> tuple[float, float]:
    """Relative errors of mean and standard deviation."""
    assert found.std is not None and exact.std is not None
    return abs(found.mean / exact.mean - 1.0), abs(found.std / exact.std - 1.0)


def truncation(case: Case, exact: dict[Resultant, Moments]) -> list[dict[str, Any]]:
    """Estimates of ``errors`` against the truth, orders 1 to 5."""
    rows = []
    for order in ORDERS:
        result = solve(case.problem, chaos=order, options=Options(rtol=1e-10), **case.settings)
        for quantity in case.quantities:
            made = result.errors(quantity)
            found, share = moments(result, quantity), made.truncation
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
def promise(case: Case, exact: dict[Resultant, Moments], repeats: int = 1) -> list[dict[str, Any]]:
    """``accuracy=`` against the cheapest order and tolerance."""
    front: list[tuple[float, dict[Resultant, float]]] = []
    for order in range(1, 7):
        for rtol in (1e-2, 1e-3, 1e-4, 1e-6):
            settings = {"chaos": Chaos(order, check_points=0), "options": Options(rtol=rtol)}

            def run(given: dict[str, Any] = settings) -> Any:
                return solve(case.problem, **given, **case.settings)

            try:
                timed = common.timed(run, repeats)
            except ValueError:  # an indefinite stiffness
                continue
            errors = {q: max(off(moments(timed.value, q), exact[q])) for q in case.quantities}
            front.append((timed.seconds, errors))
    rows = []
    for quantity in case.quantities:
        for accuracy in case.accuracies:

            def run(quantity: Resultant = quantity, accuracy: float = accuracy) -> Any:
                return solve(
                    case.problem, accuracy=accuracy, quantity=quantity, meshes=False, **case.settings
                )

            timed = common.timed(run, repeats)
            result = timed.value
            true = max(off(moments(result, quantity), exact[quantity]))
            fits = [seconds for seconds, errors in front if errors[quantity] <= accuracy]
            rows.append(
                {
                    "scene": case.name,
                    "quantity": str(quantity),
                    "accuracy": accuracy,
                    "true": true,
                    "said": result.errors().total,
                    "kept": true <= accuracy,
                    "modes": getattr(result, "modes", None),
                    "seconds": timed.seconds,
                    "over_cheapest": timed.seconds / min(fits) if fits else None,
                }
            )
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
    rows = []
    for r in record["promise"]:
        ratio = "-" if r["over_cheapest"] is None else f"{r['over_cheapest']:.1f}"
        rows.append(
            [r["scene"], r["quantity"], f"{r['accuracy']:g}", f"{r['true']:.1e}", f"{r['said']:.1e}"]
            + ["samples" if r["modes"] is None else str(r["modes"]), ratio]
        )
    header = ("scene", "quantity", "asked", "true", "said", "modes", "time / cheapest")
    made["promise"] = (header, rows)
    return made


def written(path: Path, record: dict[str, Any]) -> None:
    """Put the tables between their marks in a page."""
    for name, (header, rows) in tables(record).items():
        common.between_marks(path, name, common.markdown_table(header, rows))
    print(f"\nwritten to {path}")


def main() -> None:
    """Measure and report."""
    parser = common.parser("estimates", __doc__)
    parser.add_argument("--markdown", type=Path, help="page with marks, e.g. docs/accuracy.md")
    parser.add_argument("--quick", action="store_true", help="every other tolerance, three directions")
    parser.add_argument("--only", nargs="*", default=["algebraic", "truncation", "promise"])
    parser.add_argument("--cases", nargs="*", default=list(CASES), help="of truncation and promise")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    record: dict[str, Any] = {"environment": common.environment()}
    record |= {"algebraic": [], "truncation": [], "promise": []}
    if "algebraic" in given.only:
        grid = (FACTORS[1:4], TOLERANCES[::2]) if given.quick else (FACTORS, TOLERANCES)
        for name, problem, settings in algebraic_scenes():
            began = perf_counter()
            record["algebraic"] += algebraic(name, problem, settings, *grid)
            print(f"{name}: {perf_counter() - began:.0f} s", flush=True)
    for build in ((CASES | HELD_OUT)[name] for name in given.cases):
        if not {"truncation", "promise"} & set(given.only):
            break
        case = build()
        began = perf_counter()
        exact = truth(case)
        if "truncation" in given.only and case.linear:
            record["truncation"] += truncation(case, exact)
        if "promise" in given.only:
            record["promise"] += promise(case, exact, 1 if given.quick else given.repeats)
        print(f"{case.name}: {perf_counter() - began:.0f} s", flush=True)
    for header, rows in tables(record).values():
        if rows:
            common.table(header, rows)
    for kind in ("algebraic", "truncation"):
        good, count = within(record[kind])
        print(f"{kind}: {good} of {count} estimates within a factor of three")
    kept = sum(r["kept"] for r in record["promise"])
    print(f"promise: {kept} of {len(record['promise'])} kept")
    common.write_json(record, given.json)
    if given.markdown is not None:
        written(given.markdown, record)


if __name__ == "__main__":
    main()
