"""A bolted lap joint in single shear: preload, cyclic slip, and 1 000 parameter sets.

    ./run python demos/bolted_lap_joint.py                 25 000 unknowns, about a minute
    ./run python demos/bolted_lap_joint.py --size coarse   a coarse mesh
    ./run python demos/bolted_lap_joint.py --quick         a short history, 4 x 4 x 4 parameter sets

Problem
    Two steel plates overlap and are held together by two preloaded bolts; friction between the plates
    carries the load, and beyond it the bolts do, bent by the friction under their heads and nuts. Half of
    the joint is modelled, by symmetry (y -> -y); forces are given for the whole joint. Plates, and bolts of
    shank, head and nut, are meshed one by one: their meshes do not match in the five contacts, where unilateral
    contact and Coulomb friction hold in the mean on every facet.

Laws (N, mm, MPa)
    steel       E = 200 000 MPa, nu = 0.3
    contact     between the plates and under heads and nuts, friction 0.2
    bolts       an elastic cut of 4e5 N/mm between shank and head (the compliance of thread and washer),
                shortened by 0.15 mm: a preload of about 35 kN a bolt
    ends        one clamped, the other one moved along x: tightening first, then +-0.2 mm

Dimensions (mm)
    plates 110 x 40 x 10, overlap 80; bolts of radius 6, 40 apart, in holes of radius 7 (clearance 1); heads and
    nuts of radius 11. Shanks and holes have no interface: that they do not touch is checked afterwards.

Answers
    the loop of load against displacement, the energy that it encloses against what friction takes up; then
    load and slip at a displacement of 0.08 mm over friction, shortening and stiffness of the bolts, each set in two
    steps (tightening, then shear: both at once is another path and another answer).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from matplotlib.figure import Figure

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    LinearElastic,
    Options,
    Perfect,
    Problem,
    Scene,
    SweepResult,
    assemble,
    plotting,
    solve,
    sweep,
)
from dolfinx_frontend.lap_joint import LapJoint, lap_joint

Array = npt.NDArray[np.float64]

STEEL = LinearElastic(E=200e3, nu=0.3)
FRICTION = 0.2
BOLT = 4e5  # N/mm, whole bolt
SHORTENING = 0.15  # mm
REACH = 0.2  # mm, of the cycle
PULL = 0.08  # mm, of the parametric study
HALVES = 2.0  # modelled halves in the whole joint

CONTACTS = ("plates", "head1", "nut1", "head2", "nut2")
ON_LOWER = ("plates", "nut1", "nut2")  # their side 1 is the lower plate

TIGHTEN = Amplitude([0.0, 1.0], [0.0, 1.0])
CYCLE = Amplitude([1.0, 2.0, 4.0, 6.0], [0.0, 1.0, -1.0, 1.0])
SHEAR = Amplitude([1.0, 2.0], [0.0, 1.0])

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "bolted_lap_joint"


# %% The scene


def build_scene(
    joint: LapJoint,
    moved: Any = 0.0,
    friction: float = FRICTION,
    bolt: float = BOLT,
    shortening: float = SHORTENING,
) -> Scene:
    """The laws on the interfaces of a lap joint.

    Parameters
    ----------
    joint
        From :func:`dolfinx_frontend.lap_joint.lap_joint`.
    moved
        Displacement of the gripped end, a vector or one that changes in time.
    friction, bolt, shortening
        Of all contacts; stiffness (N/mm) and shortening (mm, reached at time 1) of a whole bolt.
    """
    # half a bolt has half the stiffness
    cut = Elastic(normal=bolt / 2, tangential=bolt / 2, total=True, jump=TIGHTEN * -shortening)
    scene = Scene()
    for name, part in joint.parts.items():
        scene.substructure(name, part, STEEL, degree=2)
    for each in joint.interfaces:
        if each.kind == "contact":
            law = Contact(gap=0.0, friction=friction)
            scene.interface(
                each.name, each.face1, each.face2, law, space="facets", overlap="partial"
            )
        elif each.kind == "elastic":
            scene.interface(each.name, each.face1, each.face2, cut, space="facets")
        elif each.kind == "perfect":
            scene.interface(each.name, each.face1, each.face2, Perfect())
        elif each.kind == "symmetry":
            scene.symmetry(each.face1, name=each.name)
        else:
            value = moved if each.name == "grip" else 0.0
            scene.fix(each.face1, value, name=each.name)
    return scene


# %% What is read from an answer


def along_x(problem: Problem, name: str, field: Array, where: Array | None = None) -> Array:
    """x-component of a local field (T, m, 3), integrated over an interface (or its mean `where`), (T,)."""
    interface = problem.interfaces[name]
    weights = interface.weights if where is None else interface.weights * where
    total = np.einsum("p,pc,tpc->t", weights, interface.frames[:, :, 0], field)
    return np.asarray(total if where is None else total / weights.sum())


def load(problem: Problem, fields: Any) -> Array:
    """Load that the whole joint transmits at each time, N: all that acts on the lower plate."""
    return HALVES * sum(along_x(problem, name, fields.force(name)) for name in ON_LOWER)


def slip(problem: Problem, fields: Any) -> Array:
    """Slip of the plates at each time, mm: mean under the heads."""
    x = problem.interfaces["plates"].points
    under = np.min([np.hypot(x[:, 0] - a, x[:, 1]) for a in (-20.0, 20.0)], axis=0) < 11.0
    return along_x(problem, "plates", fields.jump("plates"), under.astype(float))


def smallest_clearance(joint: LapJoint, problem: Problem, result: Any) -> float:
    """Lower bound of the distance of shanks and holes over the history, mm.

    A wall that moves by a and a shank by b in the plane come closer by at most |a - b|; all nodes of a wall
    are held against all nodes of the shank within the plate.
    """
    fields = result.displacements

    def moved(part: str, face: str, low: float, high: float) -> Array:
        space = problem.substructures[part].V
        mesh_part = joint.parts[part]
        dofs = fem.locate_dofs_topological(space, 2, mesh_part.facets(face))
        z = space.tabulate_dof_coordinates()[dofs, 2]
        dofs = dofs[(z > low - 1e-9) & (z < high + 1e-9)]
        return fields[part].reshape(len(result.times), -1, 3)[:, dofs, :2]

    t = float(joint.parameters["thickness"])
    closest = joint.clearance
    for number in (1, 2):
        for plate, low, high in (("lower", -t, 0.0), ("upper", 0.0, t)):
            wall = moved(plate, f"hole{number}", low, high)
            shank = moved(f"shank{number}", "side", low, high)
            nearer = wall[:, :, None] - shank[:, None]
            closest = min(closest, joint.clearance - float(np.hypot(*np.moveaxis(nearer, -1, 0)).max()))
    return closest


# %% Cyclic shear


def hysteresis(joint: LapJoint, steps: int) -> dict[str, Any]:
    """The loop: `steps` time steps a quarter."""
    problem = assemble(build_scene(joint, CYCLE * (REACH, 0.0, 0.0)))
    times = np.linspace(1.0, 6.0, 5 * steps + 1)
    began = perf_counter()
    result = solve(problem, times=times, options=Options(rtol=1e-5, max_iterations=2000))
    seconds = perf_counter() - began
    moved = np.array([REACH * CYCLE(t) for t in times])
    carried = load(problem, result)
    heat = HALVES * sum(result.dissipation(name) for name in CONTACTS)
    # one cycle: from the first reversal on (t = 2) until the same displacement again (t = 6)
    ring = slice(steps, None)
    area = float(np.trapezoid(carried[ring], moved[ring]))
    taken = float(heat[-1] - heat[steps])
    clamped = np.array(
        [result.force(n)[..., 0] @ problem.interfaces[n].weights for n in CONTACTS[1:]]
    )
    return {
        "problem": problem,
        "result": result,
        "moved": moved,
        "load": carried,
        "slip": slip(problem, result),
        "area": area,
        "heat": taken,
        "preload": -HALVES * clamped[:, 0],
        "pressed": -HALVES * clamped[:, -1],
        "clearance": smallest_clearance(joint, problem, result),
        "seconds": seconds,
    }


def loop_figure(loop: dict[str, Any], path: Path) -> Path:
    """Load against displacement, and slip against displacement."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    x = 1e3 * loop["moved"]
    left.plot(x, 1e-3 * loop["load"], "o-", ms=3, color="#0072b2")
    result, problem = loop["result"], loop["problem"]
    plates = HALVES * along_x(problem, "plates", result.force("plates"))
    left.plot(x, 1e-3 * plates, "--", lw=1, color="#d55e00", label="by friction between the plates")
    left.plot(x, 1e-3 * (loop["load"] - plates), ":", lw=1.4, color="#009e73", label="by the bolts")
    left.set_xlabel("displacement of the end (µm)")
    left.set_ylabel("load (kN)")
    left.legend(fontsize=8)
    right.plot(x, 1e3 * loop["slip"], "o-", ms=3, color="#0072b2")
    right.set_xlabel("displacement of the end (µm)")
    right.set_ylabel("slip of the plates under the heads (µm)")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.axhline(0.0, color="black", lw=0.5)
    figure.savefig(path, dpi=150)
    return path


# %% Parametric study


def grid(n: int) -> dict[tuple[str, ...], Array]:
    """Friction, shortening (as the jump of the cuts) and stiffness of half a bolt, n values each."""
    both = ("cut1", "cut2")
    return {
        tuple(f"{name}.friction" for name in CONTACTS): np.linspace(0.1, 0.3, n),
        tuple(f"{name}.jump" for name in both): -np.linspace(0.1, 0.2, n),
        tuple(f"{name}.{k}" for name in both for k in ("normal", "tangential")): (
            0.5 * BOLT * np.linspace(0.5, 1.5, n)
        ),
    }


TIMES = (1.0, 2.0)
RTOL = 1e-4


def study(problem: Problem, n: int, rtol: float = RTOL, **settings: Any) -> SweepResult:
    """Load and slip after tightening and shear, for n^3 parameter sets."""
    return sweep(
        problem,
        grid(n),
        times=TIMES,
        options=Options(rtol=rtol, acceleration=20, max_iterations=2000),
        outputs={
            "load": lambda fields: load(problem, fields)[-1],
            "slip": lambda fields: slip(problem, fields)[-1],
            "preload": lambda fields: -HALVES
            * (problem.interfaces["head1"].weights @ fields.force("head1")[0, :, 0]),
        },
        progress=False,
        **settings,
    )


def study_problem(joint: LapJoint) -> Problem:
    """Tightening, then a pull at the end."""
    return assemble(build_scene(joint, SHEAR * (PULL, 0.0, 0.0)))


def cold(joint: LapJoint, friction: float, jump: float, half_bolt: float) -> tuple[float, float]:
    """Load and slip of one set, solved by itself to a tight tolerance."""
    pull = SHEAR * (PULL, 0.0, 0.0)
    problem = assemble(build_scene(joint, pull, friction, 2.0 * half_bolt, -jump))
    result = solve(problem, times=TIMES, options=Options(rtol=1e-8, max_iterations=5000))
    assert result.converged, result.status
    return float(load(problem, result)[-1]), float(slip(problem, result)[-1])


def checked(joint: LapJoint, surface: SweepResult, sets: int) -> float:
    """Largest error of load and slip, relative to the largest ones, at some sets drawn at random."""
    values = list(surface.axes.values())
    chosen = np.random.default_rng(1).integers(0, surface.shape[0], (sets, 3))
    chosen[0], chosen[-1] = 0, surface.shape[0] - 1
    found = {name: surface.output(name) for name in ("load", "slip")}
    worst = 0.0
    for index in map(tuple, chosen.tolist()):
        exact = cold(joint, *(float(v[i]) for v, i in zip(values, index, strict=True)))
        for name, value in zip(found, exact, strict=True):
            worst = max(worst, abs(found[name][index] - value) / np.abs(found[name]).max())
    return worst


def surface_figures(surface: SweepResult, folder: Path) -> list[Path]:
    """Load and slip over friction and preload, and over friction and stiffness."""
    friction, jump, half = surface.axes.values()
    middle = len(half) // 2
    paths = []
    for name, label, factor in (("load", "load (kN)", 1e-3), ("slip", "slip (µm)", 1e3)):
        z = factor * surface.output(name)
        labels = ("friction (-)", "shortening of the bolts (mm)", label)
        title = f"bolts of {2e-3 * half[middle]:.0f} kN/mm, end moved by {1e3 * PULL:.0f} µm"
        file = folder / f"{name}_friction_preload.png"
        paths.append(
            plotting.response_surface(friction, -jump, z[:, :, middle], labels, file, title=title)
        )
        labels = ("friction (-)", "stiffness of a bolt (kN/mm)", label)
        title = f"bolts shortened by {-jump[middle]:.2f} mm, end moved by {1e3 * PULL:.0f} µm"
        file = folder / f"{name}_friction_stiffness.png"
        paths.append(
            plotting.response_surface(
                friction, 2e-3 * half, z[:, middle], labels, file, title=title
            )
        )
    return paths


# %% The script


def main() -> None:
    """Solve, print, draw and check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", default=None, help="coarse, medium, or a cell size in mm")
    parser.add_argument("--quick", action="store_true", help="coarse, fewer steps and sets")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true")
    given = parser.parse_args()
    size = given.size or ("coarse" if given.quick else "medium")
    joint = lap_joint(size if size in ("coarse", "medium") else float(size))

    loop = hysteresis(joint, steps=4 if given.quick else 10)
    result = loop["result"]
    print(result.problem)
    print(result.plan)
    print(f"""
{result.status} after {result.iterations} iterations on {len(result.times)} steps, {loop["seconds"]:.1f} s
clamping under heads and nuts       {", ".join(f"{1e-3 * p:.2f}" for p in loop["preload"])} kN
the same at the end                 {", ".join(f"{1e-3 * p:.2f}" for p in loop["pressed"])} kN
largest load                        {1e-3 * loop["load"].max():.2f} kN
largest slip of the plates          {1e3 * loop["slip"].max():.0f} µm
energy of a cycle, area of the loop {loop["area"]:.0f} mJ
energy of a cycle, by friction      {loop["heat"]:.0f} mJ
shanks stay away from the holes by  {loop["clearance"]:.2f} mm or more, of {joint.clearance:.2f} mm""")

    problem = study_problem(joint)
    n = 4 if given.quick else 10
    began = perf_counter()
    surface = study(problem, n)
    seconds = perf_counter() - began
    counts = surface.points.iterations[surface.points.order]
    error = checked(joint, surface, 3 if given.quick else 6)
    found = {name: surface.output(name) for name in ("load", "slip", "preload")}
    print(f"""
{counts.size} parameter sets in {seconds:.1f} s: {counts[0]} iterations for the first one, then {counts[1:].mean():.1f} each
load                                {1e-3 * found["load"].min():.1f} to {1e-3 * found["load"].max():.1f} kN
slip                                {1e3 * found["slip"].min():.1f} to {1e3 * found["slip"].max():.1f} µm
preload of a bolt                   {1e-3 * found["preload"].min():.1f} to {1e-3 * found["preload"].max():.1f} kN
error of load and slip              {error:.1e} of the largest ones, against tight solutions of some sets""")

    if not given.no_figures:
        given.output.mkdir(parents=True, exist_ok=True)
        paths = [loop_figure(loop, given.output / "loop.png")]
        paths += surface_figures(surface, given.output)
        paths.append(plotting.assembly_figure(joint, given.output / "joint.png"))
        print("\n" + "\n".join(f"wrote {path.name}" for path in paths))
        print(f"figures are in {given.output}")

    assert result.converged and surface.converged.all()
    assert loop["clearance"] > 0.0, "a shank touches its hole, where the model has no interface"
    difference = abs(loop["area"] - loop["heat"]) / loop["area"]
    assert difference < (0.1 if given.quick else 0.04), f"energies differ by {difference:.1%}"
    assert error < 1e-3, f"sweep and tight solutions differ by {error:.1e}"
    print("all checks passed")


if __name__ == "__main__":
    main()
