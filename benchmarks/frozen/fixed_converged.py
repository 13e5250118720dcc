"""Scenes that said "converged" and were wrong somewhere, gave up, or were not looked at: iterations of all
kinds.

``closely`` is solved with the tolerance of the corpus; ``loosely`` with that at which the fault was seen.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dolfinx_frontend as lf
import numpy as np

from frozen.fixed_parts import (
    FORCE,
    LENGTH,
    STEEL,
    beyond,
    box,
    joined,
    layers,
    options,
    pair_and_light,
    refusal,
    row,
    square,
    squares_in_a_row,
    within,
)
from frozen.registry import Right, scene

GROUP = "fixed"
CASES = Path(__file__).resolve().parents[1] / "campaign" / "cases"
CLOSED = "closed form"
BALANCE = "balance of forces"


# -- light and soft parts --------------------------------------------------------------------------
LIGHT = {"tenth": (1e-1, 1e-2), "millionth": (1e-6, 1e-2), "far": (1e-2, 1e-1), "near": (1.0, 1e-3)}


@scene(GROUP, {f"{name} {way}.stop.normal": Right(-100.0 * ratio, 1e-6 if way == "closely" else 3e-2, BALANCE)
               for name, (ratio, _) in LIGHT.items() for way in ("closely", "loosely")})
def a_light_part_lands(rtol: float) -> Any:
    """"Converged" is measured in every part; runs that give up find their answer also of parts that fly
    far."""
    out = {}
    for name, (ratio, gap) in LIGHT.items():
        problem = pair_and_light(ratio, gap)
        out[f"{name} closely"] = lf.solve(problem, options=options(rtol))
        out[f"{name} loosely"] = lf.solve(problem, options=options(1e-2, newton=0))
    return out


@scene(GROUP)
def linear_interfaces_that_are_kept(rtol: float) -> Any:
    """Estimates that were believed after two iterations; also beside friction."""
    out: dict[str, Any] = {}
    for parts, bed in ((2, 0.0), (3, 1.0), (4, 1.0)):
        problem = squares_in_a_row(parts, bed)
        out[f"{parts} closely"] = lf.solve(problem, active="all", options=options(rtol))
        out[f"{parts} loosely"] = lf.solve(problem, active=["grip"], options=options(1e-2))
    sliding = squares_in_a_row(2, 0.0, lambda k: lf.Contact(friction=0.3), lf.Displacement((-0.01, 0.002)))
    out["friction"] = lf.solve(sliding, active="all", options=options(rtol))
    return out


def rough_row(seed: int) -> tuple[lf.Problem, Any]:
    """Moduli over three decades, springs over four, interference, beds; and what is kept."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    moduli = 100.0 * 10.0 ** rng.uniform(-1.5, 1.5, count)
    laws: dict[str, Any] = {"wall": lf.Displacement(0.0)}
    faces = {"wall": ["b0:x0"]}
    for k in range(1, count):
        stiffness, jump = 10.0 ** rng.uniform(0, 4), 0.0 if rng.random() < 0.6 else float(1e-2 * rng.normal())
        laws[f"j{k}"] = lf.Elastic(normal=stiffness, tangential=stiffness * rng.uniform(0.1, 1.0), jump=jump)
        faces[f"j{k}"] = [f"b{k - 1}:x1", f"b{k}:x0"]
        if rng.random() < 0.5:
            normal, tangential = 10.0 ** rng.uniform(-1, 2, size=2)
            laws[f"bed{k}"] = lf.Elastic(normal=normal, tangential=tangential)
            faces[f"bed{k}"] = [f"b{k}:y0"]
    gripped, value = rng.random() < 0.7, rng.normal(size=2)
    laws["grip"] = lf.Displacement(tuple(0.01 * value)) if gripped else lf.Traction(value)
    faces["grip"] = [f"b{count - 1}:x1"]
    active: Any = "all" if rng.random() < 0.7 else [name for name in faces if rng.random() < 0.6] or "all"
    made = lf.Scene()
    for k, E in enumerate(moduli):
        square(made, f"b{k}", float(k), 0.0, E)
    return joined(made, laws, faces), active


@scene(GROUP)
def rough_rows(rtol: float) -> Any:
    """Estimates of bodies far apart in stiffness that springs join."""
    out = {}
    for seed in range(8):
        problem, active = rough_row(seed)
        out[f"{seed} closely"] = lf.solve(problem, active=active, options=options(rtol))
        out[f"{seed} loosely"] = lf.solve(problem, active=active, options=options(1e-2))
    return out


DECADES = (-10, -6, 6, 10)


@scene(GROUP, {f"1e{decade}.j1.normal": Right(1.0, 1e-5, BALANCE) for decade in DECADES})
def springs_of_any_stiffness(rtol: float) -> Any:
    """"A direct solution checks and corrects itself", "with very stiff springs the first correction is
    followed by a second", "a part between two soft springs"."""
    out = {}
    for decade in DECADES:
        stiffness = 100.0 * 10.0**decade
        problem = squares_in_a_row(
            2, 0.0, lambda k, s=stiffness: lf.Elastic(normal=s, tangential=s),
            lf.Traction(np.array((1.0, 0.0)))
        )
        out[f"1e{decade}"] = lf.solve(problem, options=options(rtol))
    return out


@scene(GROUP, {f"1e{decade}.tip": Right(0.01 + 0.01 * 10.0**-decade, 1e-6, CLOSED) for decade in (-8, 8)})
def parts_of_far_apart_stiffness(rtol: float) -> Any:
    """"Parts that are joined and do not factorise together", "Rounding of joined bodies far apart in
    stiffness"."""
    out: dict[str, Any] = {}
    for decade in (-8, 8, 12):
        made = lf.Scene()
        for name, x, E in (("left", 0.0, 100.0), ("right", 1.0, 100.0 * 10.0**decade)):
            box(made, name, (1.0, 1.0), (2, 2), (x, 0.0), lf.LinearElastic(E, 0.0))
        made.interface("joint", "left:x1", "right:x0", lf.Perfect())
        made.fix("left:x0", name="wall")
        made.traction("right:x1", (1.0, 0.0), name="pull")
        problem = lf.assemble(made)
        if decade == 12:  # rounding decides whether it is refused
            out["1e12"] = lf.solve(problem, active="all", options=options(rtol)).status
            continue
        result = lf.solve(problem, options=options(rtol))
        tip = float(result.displacements["right"].reshape(-1, 2)[:, 0].max())
        out[f"1e{decade}"] = {"result": result, "tip": within(tip, 1e-6 * tip)}
    return out


@scene(GROUP, {"ground.normal": Right(-5.0 * 100.0, 1e-4, BALANCE)})
def a_stiff_block_on_a_soft_spring(rtol: float) -> Any:
    """`inexact`: "iterations end so, where rounding alone is above the tolerance"."""
    made = lf.Scene()
    box(made, "block", (10.0, 10.0, 2.0), (2, 2, 1), (0.0, 0.0, 0.0), lf.LinearElastic(2e7, 0.3),
        cell="hexahedron")
    draw = lf.Amplitude([1.0, 2.0, 3.0, 4.0], [0.0, 0.25, -0.25, 0.25])
    made.interface("ground", "block:z0", lf.Contact(friction=0.2))
    made.pressure("block:z1", lf.Amplitude([0.0, 1.0], [0.0, 1.0]) * 5.0)
    made.interface("spring", "block:x1", lf.Elastic(normal=1e3, total=True, jump=draw * -1.0))
    return lf.solve(lf.assemble(made), times=np.linspace(0.25, 4.0, 16), options=options(rtol))


# -- histories -------------------------------------------------------------------------------------
@scene(GROUP)
def loads_that_cancel(rtol: float) -> Any:
    """"errors of linear histories are measured at their times": load patterns cancel at the end."""
    made = lf.Scene()
    for k, name in enumerate("abc"):
        square(made, name, float(k), 0.0, STEEL)
    made.fix("a:x0", name="wall")
    for k, pair in enumerate(("ab", "bc")):
        springs = lf.Elastic(normal=STEEL, tangential=STEEL)
        made.interface(f"j{k}", f"{pair[0]}:x1", f"{pair[1]}:x0", springs)
    rising, falling = lf.Amplitude([0.0, 1.0], [1.0, 1.0]), lf.Amplitude([0.0, 1.0], [0.0, -0.999])
    made.interface("pull", "c:x1", lf.Traction(rising * np.array((100.0, 20.0))))
    made.interface("back", "b:y1", lf.Traction(falling * np.array((80.0, 30.0))))
    problem, times = lf.assemble(made), [0.0, 0.5, 0.9, 1.0]
    plain = {"newton": 0, "directions": "diagonal", "macro": "none"}
    return {
        "direct": lf.solve(problem, times=times, options=options(rtol)),
        "closely": lf.solve(problem, times=times, active="all", options=options(rtol, **plain)),
        "loosely": lf.solve(problem, times=times, active="all", options=options(1e-2, **plain)),
    }


@scene(GROUP)
def histories_with_few_steps(rtol: float) -> Any:
    """"a direct solution of a linear history with as many time steps as load patterns took patterns for
    steps"."""
    up, cycle = lf.Amplitude([0, 1], [0, 1]), lf.Amplitude([1, 2, 3], [0, 1, -1])
    squared = lf.Amplitude(lambda t: t * t)
    made = lf.Scene()
    for name, x in (("left", 0.0), ("right", 20.0)):
        part = lf.geometry.box((20.0, 10.0, 10.0), (2, 2, 2), origin=(x, 0.0, 0.0), cell="hexahedron")
        weight = squared * (0.0, 0.0, -1e-3) + (0.0, 1e-3, 0.0)
        made.substructure(name, part, lf.LinearElastic(E=200e3, nu=0.3), degree=1, body_force=weight)
    made.fix("left:x0", value=up * (0.0, 0.01, 0.0))
    made.traction("right:x1", cycle * (20.0, 0.0, -1.0) + (0.0, 1.0, 0.0), name="load")
    made.pressure("left:z1", cycle * 3.0, name="pressure")
    springs = lf.Elastic(normal=500.0, tangential=200.0, jump=up * -0.02 + 0.001)
    made.interface("layer", "left:x1", "right:x0", springs)
    problem = lf.assemble(made)
    return {
        f"{steps} {way}": lf.solve(problem, times=[1.0 + 0.25 * k for k in range(steps)], active=active,
                                   options=options(rtol))
        for steps in (2, 4, 5)
        for way, active in (("direct", ()), ("kept", ("layer",)))
    }


@scene(GROUP)
def shear_that_flips_in_every_step(rtol: float) -> Any:
    """Tresca's law under reversing shear: an iteration jumped between the bounds of all points for ever."""
    made = lf.Scene()
    sizes = {"a": ((7.3466, 10.0), (2, 2), 0.0, 25.0), "b": ((15.895, 10.0), (1, 3), 7.3466, 330.0)}
    for name, (size, cells, x, E) in sizes.items():
        box(made, name, size, cells, (x, 0.0), lf.LinearElastic(E, 0.3), degree=2)
    made.fix("a:x0")
    made.interface("joint", "a:x1", "b:x0", lf.Contact(gap=0.0, threshold=0.002), space="facets")
    made.interface("bed", "b:y0", lf.Elastic(normal=0.28, tangential=0.28))
    press = lf.Amplitude([0, 1], [0, 1]) * np.array([-0.025406, 0.0])
    shear = lf.Amplitude([1, 2, 3, 4], [0, 1, -1, 0.5]) * np.array([0.0, 0.0013])
    made.traction("b:x1", press + shear)
    problem, times = lf.assemble(made), np.linspace(0.5, 4.0, 8)
    return {
        "closely": lf.solve(problem, times=times, options=options(rtol)),
        "loosely": lf.solve(problem, times=times, options=options(1e-2, newton=0)),
    }


@scene(GROUP)
def steps_of_a_thousandth(rtol: float) -> Any:
    """"Converged" is measured at every step: friction under a load that begins and ends at 1e-3 of its
    peak."""
    tiny = lf.Amplitude([0.0, 1.0, 2.0, 3.0], [0.0, 1e-3, 1e-3, 1e-3])
    large = lf.Amplitude([1.0, 2.0, 3.0], [0.0, 1.0, 0.0])
    made = lf.Scene()
    for k, name in enumerate("ab"):
        box(made, name, (2.0, 1.0), (8, 4), (0.0, float(k)), lf.LinearElastic(STEEL, 0.3))
    pressed, sheared = np.array((0.0, -20.0)), np.array((10.0, 0.0))
    laws = {
        "foot": lf.Displacement(0.0),
        "joint": lf.Contact(friction=0.3),
        "guide": lf.Elastic(normal=0.01 * STEEL, tangential=0.002 * STEEL),
        "press": lf.Traction(tiny * pressed + large * pressed),
        "shear": lf.Traction(tiny * sheared + large * sheared),
    }
    faces = {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "guide": ["b:y1"], "press": ["b:y1"],
             "shear": ["b:x1"]}
    problem, times = joined(made, laws, faces, joint="facets"), np.linspace(0.25, 3.0, 12)
    return {
        "closely": lf.solve(problem, times=times, options=options(rtol)),
        "loosely": lf.solve(problem, times=times, options=options(1e-2, newton=0)),
    }


SHARE = {"press": (0.0, 0.0, -50.0), "shear": (8.0, 0.0, 0.0)}


@scene(GROUP, {f"{way}.joint.{what}@1": Right(value, tolerance, BALANCE)
               for what, value in (("normal", -50.0 * 36.0), ("shear", 8.0 * 30.0))
               for way, tolerance in (("closely", 1e-6), ("late", 1e-2))}, limit=120.0)
def a_punch_with_friction(rtol: float) -> Any:
    """Newton's method for contact zones of every size: pressed, then sheared; at once, and fetched late."""
    press, shear = lf.Amplitude([0.0, 1.0], [0.0, 1.0]), lf.Amplitude([1.0, 2.0], [0.0, 1.0])
    made = lf.Scene()
    for name, side, at, n in (("low", 10.0, (0.0, 0.0, 0.0), 10), ("up", 6.0, (2.0, 2.0, 5.0), 9)):
        box(made, name, (side, side, 5.0), (n, n, 2), at, lf.LinearElastic(STEEL, 0.3), cell="hexahedron")
    made.fix("low:z0")
    made.interface("joint", "up:z0", "low:z1", lf.Contact(friction=0.3), space="facets", overlap="partial")
    made.traction("up:z1", press * SHARE["press"])
    made.traction("up:x1", shear * SHARE["shear"])
    problem = lf.assemble(made)
    return {
        "closely": lf.solve(problem, times=[1.0, 2.0], options=options(rtol)),
        "late": lf.solve(problem, times=[1.0, 2.0], options=options(1e-4, newton=60)),
    }


# -- chaos, samples, sweeps ------------------------------------------------------------------------
@scene(GROUP)
def a_soft_mount_beside_a_stiff_joint(rtol: float) -> Any:
    """"in mean and fluctuation" of every part; "the fluctuation of a part that scatters as a rigid body"."""
    out = {}
    for soft in (1e-1, 1e-5):
        made = lf.Scene()
        for name, x, y in (("a", 0.0, 0.0), ("b", 0.0, 1.0), ("c", 3.0, 0.0)):
            square(made, name, x, y, STEEL, cells=3)
        joint, mount = lf.LogNormal("ka", 0.3 * STEEL, cov=0.2), lf.LogNormal("kb", soft * STEEL, cov=0.2)
        laws = {f"side_{name}": lf.Symmetry() for name in "abc"} | {
            "foot": lf.Displacement(0.0),
            "joint": lf.Elastic(normal=joint, tangential=0.3 * STEEL),
            "heavy": lf.Traction(np.array((5.0, 100.0))),
            "mount": lf.Elastic(normal=mount, tangential=soft * STEEL),
            "light": lf.Traction(np.array((0.0, 10.0 * soft))),
        }
        faces = {f"side_{name}": [f"{name}:x0"] for name in "abc"}
        faces |= {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "heavy": ["b:y1"], "mount": ["c:y0"],
                  "light": ["c:y1"]}
        problem = joined(made, laws, faces)
        for way, each in (("closely", options(rtol)), ("loosely", options(1e-2, newton=0))):
            out[f"{soft:g} {way}"] = lf.solve(problem, chaos=lf.Chaos(3), options=each)
    return out


@scene(GROUP)
def a_small_scatter(rtol: float) -> Any:
    """"a fluctuation ... is not measured with the mean": coefficients of variation of 0.1 and 1e-4."""
    out = {}
    for cov in (1e-1, 1e-4):
        made = lf.Scene()
        for k, name in enumerate("ab"):
            box(made, name, (1.0,) * 3, (2, 2, 2), (0.0, 0.0, float(k)), lf.LinearElastic(STEEL, 0.3),
                cell="hexahedron")
        springs = lf.Elastic(normal=lf.Normal("kn", STEEL, cov=cov),
                             tangential=lf.Normal("kt", STEEL, cov=cov))
        laws = {"foot": lf.Displacement(0.0), "joint": springs,
                "load": lf.Traction(np.array((50.0, 5.0, 100.0)))}
        problem = joined(made, laws, {"foot": ["a:z0"], "joint": ["a:z1", "b:z0"], "load": ["b:z1"]})
        out[f"{cov:g}"] = lf.solve(problem, chaos=lf.Chaos(2), options=options(rtol))
    return out


@scene(GROUP)
def a_large_scatter(rtol: float) -> Any:
    """"of a linear chaos with what a wrong mean does to the fluctuation": covariances of 1 and 0.8."""
    out = {}
    for name, moduli in (("unlike", (2e5, 1.0, 1e3)), ("alike", (100.0, 100.0, 100.0))):
        made = lf.Scene()
        for k, (part, E) in enumerate(zip("abc", moduli, strict=True)):
            square(made, part, float(k), 0.0, E)
        laws = {f"bed_{part}": lf.Elastic(normal=0.1, tangential=0.1) for part in "bc"} | {
            "wall": lf.Displacement(0.0),
            "j0": lf.Elastic(normal=lf.LogNormal("k0", 0.01, cov=1.0), tangential=0.01),
            "j1": lf.Elastic(normal=lf.LogNormal("k1", 100.0, cov=0.8), tangential=1.0),
            "pull": lf.Traction(np.array((1e-3, 2e-4))),
        }
        faces = {"wall": ["a:x0"], "j0": ["a:x1", "b:x0"], "j1": ["b:x1", "c:x0"], "pull": ["c:x1"]}
        problem = joined(made, laws, faces | {f"bed_{part}": [f"{part}:y0"] for part in "bc"})
        for way, tolerance, given in (("closely", rtol, {}), ("loosely", 1e-1, {"direction": 30.0})):
            out[f"{name} {way}"] = lf.solve(problem, chaos=lf.Chaos(2), options=options(tolerance), **given)
    return out


@scene(GROUP)
def random_and_swept_displacements(rtol: float) -> Any:
    """A chaos or a sweep whose only active interface is the one that moves; starts of neighbours."""
    grip = lf.Displacement(lf.Normal("u", 0.01, cov=0.1), components=0)
    random = squares_in_a_row(3, 1.0, None, grip)
    springs = squares_in_a_row(
        3, 1.0, lambda k: lf.Elastic(normal=lf.LogNormal(f"k{k}", 50.0, cov=0.2), tangential=50.0),
        lf.Displacement(0.01, components=0),
    )
    plain = squares_in_a_row(3, 1.0, None, lf.Displacement(0.01, components=0))
    swept = {"grip.value": [0.01, 0.02], "j1.normal": [5.0, 50.0, 500.0]}
    return {
        "grip": lf.solve(random, chaos=2, options=options(rtol)),
        "springs": lf.solve(springs, chaos=2, active=["grip"], options=options(rtol)),
        "sweep": lf.sweep(plain, swept, options=options(rtol), keep_states=True, progress=False),
        "sweep loosely": lf.sweep(plain, swept, options=options(1e-2), keep_states=True, progress=False),
    }


@scene(GROUP, limit=120.0)
def samples_near_slip(rtol: float) -> Any:
    """"Samples are as right as what they scatter by": friction, or a gap, that decides."""
    out = {}
    random = {"mu": lf.LogNormal("mu", 0.3, cov=0.4), "kc": lf.LogNormal("kc", 20.0 * STEEL, cov=0.5)}
    cases = {
        "friction": (lf.Contact(friction=random["mu"], stiffness=random["kc"]), (10.0, -2.0), (0.02, 0.002),
                     20.0),
        "gap": (lf.Contact(gap=lf.Normal("g", 2e-4, std=1e-4), friction=0.3), (8.0, -12.0), (0.05, 0.02),
                15.0),
    }
    for name, (joint, load, guide, pressure) in cases.items():
        made = lf.Scene()
        for k, part in enumerate("ab"):
            box(made, part, (2.0, 1.0), (12, 5), (0.0, float(k)), lf.LinearElastic(STEEL, 0.3))
        laws = {
            "foot": lf.Displacement(0.0),
            "joint": joint,
            "guide": lf.Elastic(normal=guide[0] * STEEL, tangential=guide[1] * STEEL),
            "load": lf.Traction(np.array(load)),
            "press": lf.Pressure(pressure),
        }
        faces = {"foot": ["a:y0"], "joint": ["a:y1", "b:y0"], "guide": ["b:y1"], "load": ["b:x1"],
                 "press": ["b:y1"]}
        problem = joined(made, laws, faces, joint="facets")
        for way, tolerance in (("closely", rtol), ("loosely", 1e-2)):
            out[f"{name} {way}"] = lf.monte_carlo(
                problem, 24, seed=3, options=options(tolerance), keep_states=True, progress=False
            )
    return out


@scene(GROUP, {"off": Right(0.0, 1e-7, CLOSED)})
def samples_from_kept_tangents(rtol: float) -> Any:
    """"Samples of linear laws begin with tangents that the solver keeps": over ten decades of a stiffness."""
    law = lf.LogNormal("k", 40.0, cov=20.0)
    result = lf.solve(layers(law, 15.0), chaos=lf.Chaos(order=1), options=options(rtol), progress=False)
    worst = 0.0
    for seed in range(4):
        samples = result.monte_carlo(60, seed=seed, progress=False)
        exact = FORCE / law.value(samples.germs[:, 0])
        rest = FORCE / 15.0 + 3.0 * FORCE * LENGTH / 200.0
        off = np.abs(np.mean(samples.jump("l0")[..., 0], axis=-1) - exact) / (exact + rest)
        worst = max(worst, float(off.max()))
    return {"off": beyond(worst, 1e-7)}


@scene(GROUP)
def a_start_of_another_load(rtol: float) -> Any:
    """"A start from a result under other loads could be taken for the answer"; snapshots that are the
    same."""
    made = row(2, 200.0)
    made.interface("l0", "b0:x1", "b1:x0", lf.Elastic(normal=40.0, tangential=10.0))
    made.fix("b0:x0")
    made.force("b1:x1", (FORCE, 0.0), name="load")
    problem = lf.assemble(made)
    first = lf.solve(problem, active="all", options=options(rtol))
    grid = {"load.x": [FORCE, FORCE * (1.0 + 1e-13), 2.5 * FORCE], "l0.normal": [40.0, 40.0 * (1.0 + 1e-13)]}
    softer = problem.with_laws(values={"l0.normal": 4.0})
    return {
        "again": lf.solve(softer, active="all", start=first, options=options(rtol)),
        "sweep": lf.sweep(problem, grid, options=options(rtol), keep_states=True, progress=False),
    }


# -- parts without a support -----------------------------------------------------------------------
def on_the_floor(push: float, friction: float) -> lf.Problem:
    """A cube pressed by 10 MPa on the floor and pushed aside at its top."""
    made = lf.Scene()
    box(made, "block", (10.0,) * 3, (4, 2, 2), (0.0,) * 3, lf.LinearElastic(200e3, 0.3), cell="hexahedron")
    made.interface("floor", "block:z0", lf.Contact(friction=friction))
    made.traction("block:z1", (push, 0.0, -10.0), name="load")
    return lf.assemble(made)


@scene(GROUP, {"holds.floor.normal": Right(-1000.0, 1e-6, BALANCE),
               "nearly.floor.shear": Right(285.0, 1e-6, BALANCE)})
def supports_that_are_lost(rtol: float) -> Any:
    """"parts that lose their support are named", "a step of a history in which a part has flown off"."""
    short = options(rtol, max_iterations=400)
    return {
        "holds": lf.solve(on_the_floor(1.0, 0.3), options=short),
        "nearly": lf.solve(on_the_floor(2.85, 0.3), options=short),
        "slips": refusal(lambda: lf.solve(on_the_floor(3.2, 0.3), options=short)),
        "tips": refusal(lambda: lf.solve(on_the_floor(5.5, 50.0), options=short)),
    }


# -- what campaigns drew ---------------------------------------------------------------------------
ROUGH = ("gen_raised_user_law",)
"""Rounding leaves 1e-4 there, and the search for less takes a minute."""


def drawn(file: Path) -> Callable[[float], Any]:
    """The scene of a script of the campaign: as it was run there, and closely."""

    def run(rtol: float) -> dict[str, Any]:
        text = file.read_text()
        names: dict[str, Any] = {"__name__": "case"}
        exec(compile(text, file.name, "exec"), names)
        amplitudes = names.get("AMPLITUDES", [])
        values = names["VARIABLES"] | {key: grid[0] for key, grid in names["GRID"].items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", lf.SceneWarning)  # of areas that differ
            problem = lf.assemble(names["build"](lambda k: amplitudes[k], lambda name: values[name]))
        loosely = names["run"](problem)
        if file.stem in ROUGH:
            return {"loosely": loosely}
        if names["VARIABLES"] or names["GRID"]:
            exec(compile(re.sub(r"rtol=[\d.e-]+", f"rtol={rtol}", text), file.name, "exec"), names)
            return {"loosely": loosely, "closely": names["run"](problem)}
        closely = lf.solve(problem, options=options(rtol), times=names["TIMES"])
        return {"loosely": loosely, "closely": closely}

    run.__name__ = f"campaign_{file.stem.removeprefix('gen_')}"
    return run


for _file in sorted([*CASES.glob("gen_*.txt"), *(CASES / "later").glob("*.txt")]):
    if "two_ranks" not in _file.stem:
        scene(GROUP, limit=120.0)(drawn(_file))
