"""Iterations of contact and friction to an error of 1e-5 over search directions, with and without Newton.

``./run bench iterations [--scenes vessel lap ...] [--size coarse] [--json FILE]`` solves each scene
to `rtol` = 1e-5 with the default search direction k and with multiples of it, with Newton steps and
with Anderson's method alone. Of each run: ``status``, ``iterations`` (global stages of all columns,
a Newton step counted by its work), ``newton_steps``, ``seconds`` of the iteration, the estimated
``error`` and the ``true_error``: the difference in the energy norm of all bodies and times from a
solution to 1e-11, relative to that solution.

Scenes: the vessel with true contact under its cover, without friction and with 0.1 and 0.3, over a
history of preload and pressure; the load history of the bolted lap joint (preload and a cycle of
shear, 21 steps); Hertz' cylinder in the NAFEMS and in the small scene; Cattaneo and Mindlin's
cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import common
import numpy as np

from dolfinx_frontend import Amplitude, Contact, Options, Problem, assemble, reference, solve
from dolfinx_frontend.plan.plan import Direction
from parts.lap_joint import lap_joint
from parts.vessel import bolted_vessel

RTOL = 1e-5
TIGHT = Options(rtol=1e-11, max_iterations=20000, stagnation_window=400)


@dataclass(frozen=True)
class Case:
    """A problem and how it is solved."""

    problem: Problem
    settings: dict[str, Any]


def vessel(size: str | float, friction: float, pressures: tuple[float, ...]) -> Case:
    """The vessel's cover in true contact: preload, then pressure."""
    demo = common.demo("bolted_vessel")
    shape = bolted_vessel(size=size)
    times = np.arange(len(pressures), dtype=float)
    law = Contact(friction=friction or None)
    scene = demo.vessel_scene(shape, joint=law, pressure=Amplitude(times, pressures) * 1.0)
    return Case(assemble(scene), {"times": times})


def lap(size: str | float, steps: int) -> Case:
    """The lap joint over preload and a cycle of shear, `steps` steps per quarter."""
    demo = common.demo("bolted_lap_joint")
    pull = demo.CYCLE * (demo.REACH, 0.0, 0.0)
    problem = assemble(demo.build_scene(lap_joint(size), pull))
    return Case(problem, {"times": np.linspace(1.0, 6.0, 5 * steps + 1)})


def hertz(scene: str, across: float) -> Case:
    """Hertz' cylinder without friction ("NAFEMS", "SMALL") or rubbed over a cycle ("RUBBED")."""
    demo = common.demo("hertz")
    given = getattr(demo, scene)
    caught: list[Case] = []

    def instead(problem: Problem, **settings: Any) -> None:
        caught.append(Case(problem, {k: settings[k] for k in ("times",) if k in settings}))
        raise StopIteration

    demo.solve = instead
    try:
        (demo.rub if scene == "RUBBED" else demo.press)(given, across)
    except StopIteration:
        pass
    return caught[0]


def scenes(size: str) -> dict[str, Callable[[], Case]]:
    """The scenes by name."""
    fine = size != "coarse"
    pressures = tuple(np.arange(0.0, 3.61, 0.4 if fine else 1.2))
    of_vessel = "paper" if fine else "coarse"
    across = 16 if fine else 8
    return {
        "vessel": lambda: vessel(of_vessel, 0.0, pressures),
        "vessel 0.1": lambda: vessel(of_vessel, 0.1, pressures),
        "vessel 0.3": lambda: vessel(of_vessel, 0.3, pressures),
        "lap": lambda: lap("medium" if fine else "coarse", 4),
        "hertz": lambda: hertz("NAFEMS", across),
        "hertz small": lambda: hertz("SMALL", across),
        "mindlin": lambda: hertz("RUBBED", across),
    }


def measure(
    case: Case, exact: Any, factor: float, newton: bool, **changes: Any
) -> dict[str, Any]:
    """One run, with `factor` times the default search direction."""
    options = Options(rtol=RTOL, max_iterations=2000)
    options = options.with_(**({} if newton else {"newton": 0}), **changes)
    began = perf_counter()
    result = solve(
        case.problem, direction=Direction(factor=3.0 * factor), options=options, **case.settings
    )
    seconds = perf_counter() - began
    return {
        "factor": factor,
        "newton": newton,
        "status": result.status,
        "iterations": result.iterations,
        "newton_steps": result.summary.newton_steps,
        "restarts": result.summary.restarts,
        "seconds": result.summary.global_s
        + result.summary.local_s
        + result.summary.newton_s
        + result.summary.check_s
        + result.summary.other_s,
        "seconds_in_all": seconds,
        "error": result.error,
        "true_error": reference.energy_difference(case.problem, result, exact),
    }


def tight(case: Case) -> Any:
    """The solution to 1e-11."""
    exact = solve(case.problem, options=TIGHT, **case.settings)
    if exact.error > 1e-8:
        exact = solve(case.problem, options=TIGHT.with_(newton=0), **case.settings)
    return exact


def main() -> None:
    """Measure and report."""
    parser = common.parser("iterations", "Iterations of contact and friction over search directions.")
    parser.add_argument("--scenes", nargs="*", default=None)
    parser.add_argument("--size", default="coarse", choices=("coarse", "demo"))
    parser.add_argument("--factors", nargs="*", type=float, default=[0.1, 1.0, 10.0])
    parser.add_argument("--newton", choices=("both", "on", "off"), default="both")
    given = parser.parse_args()
    record: dict[str, Any] = {"benchmark": "iterations", "rtol": RTOL, "scenes": {}}
    for name, make in scenes(given.size).items():
        if given.scenes and name not in given.scenes:
            continue
        case = make()
        runs = record["scenes"][name] = []
        began = perf_counter()
        exact = tight(case)
        points = {n: i.num_points for n, i in case.problem.interfaces.items() if n in exact.plan.active}
        print(
            f"{name}: {case.problem.size} unknowns, points {points}, {exact.plan.columns} columns; "
            f"tight: {exact.status} {exact.iterations} its, error {exact.error:.1e}, "
            f"{perf_counter() - began:.1f} s",
            flush=True,
        )
        for factor in given.factors:
            for newton in (False, True):
                if given.newton == "both" or (given.newton == "on") == newton:
                    r = measure(case, exact, factor, newton)
                    runs.append(r)
                    print(
                        f"   k x {factor:<5g} {'newton  ' if newton else 'anderson'} {r['status']:10s} "
                        f"{r['iterations']:5d} its ({r['newton_steps']:3d} N, {r['restarts']} restarts) "
                        f"{r['seconds']:7.2f} s, estimate {r['error']:.1e}, true {r['true_error']:.1e}",
                        flush=True,
                    )
    record["environment"] = common.environment()
    common.write_json(record, given.json)


if __name__ == "__main__":
    main()
