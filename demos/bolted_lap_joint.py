"""A bolted lap joint in single shear: preload, cyclic slip, and 1 000 parameter sets.

    ./run python demos/bolted_lap_joint.py                 25 000 unknowns, about a minute
    ./run python demos/bolted_lap_joint.py --size coarse   10 000 unknowns
    ./run python demos/bolted_lap_joint.py --quick         coarse, a short history, 4 x 4 x 4 sets

Problem
    Two steel plates overlap and are held together by two preloaded bolts. Friction between the plates carries
    the load. When it is exhausted, the bolts carry load too: they are bent by the friction under their heads
    and nuts. By symmetry (y -> -y) half of the joint is modelled; forces are given for the whole joint. The
    plates, and the shank, head and nut of the bolts, are meshed one by one. Their meshes do not match in the
    five contacts, where unilateral contact and Coulomb friction hold for the mean values on every facet.

Laws (N, mm, MPa)
    steel       E = 200 000 MPa, nu = 0.3
    contact     between the plates and under heads and nuts, friction 0.2
    bolts       an elastic cut of 4e5 N/mm between shank and head (the compliance of thread and washer),
                shortened by 0.15 mm: a preload of about 35 kN per bolt
    ends        one is clamped; the other one is held and then moved along x by 0.2 mm back and forth. While
                the bolts are tightened, both ends are held and the plates cannot expand sideways: the cycle
                begins with a load of -2.6 kN.

Dimensions (mm)
    plates 110 x 40 x 10, overlap 80; bolts of radius 6, 40 apart, in holes of radius 7 (clearance 1); heads
    and nuts of radius 11. Shanks and holes have no interface; the script checks afterwards that they do not
    touch.

Answers
    The loop of load against slip. Its area is compared with the work that the contacts take up and the energy
    that the parts store; the three balance for any time steps. The heat of friction, ``dissipation``, uses
    the force at the end of each step, as the law does, and needs small steps. Then load and slip at a
    displacement of 0.08 mm are computed as functions of friction, shortening and stiffness of the bolts. Each
    set takes two steps, tightening and then shear: both at once would be a different path with a different
    answer.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import entities_to_geometry
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from dolfinx_frontend import (
    Amplitude,
    Contact,
    Elastic,
    HistoryResult,
    LinearElastic,
    Options,
    Perfect,
    Problem,
    Scene,
    SweepResult,
    assemble,
    figures,
    io,
    solve,
    sweep,
)
from dolfinx_frontend.geometry.parts import Part
from parts.lap_joint import LapJoint, lap_joint

Array = npt.NDArray[np.float64]

STEEL = LinearElastic(E=200e3, nu=0.3)
FRICTION = 0.2
BOLT = 4e5  # N/mm, whole bolt
SHORTENING = 0.15  # mm
REACH = 0.2  # mm, of the cycle
PULL = 0.08  # mm, of the parametric study
HALVES = 2.0  # modelled halves in the whole joint

CONTACTS = ("plates", "head1", "nut1", "head2", "nut2")
CUTS = ("cut1", "cut2")
ON_LOWER = ("plates", "nut1", "nut2")  # their side 1 is the lower plate

TIGHTEN = Amplitude([0.0, 1.0], [0.0, 1.0])
CYCLE = Amplitude([1.0, 2.0, 4.0, 6.0], [0.0, 1.0, -1.0, 1.0])
SHEAR = Amplitude([1.0, 2.0], [0.0, 1.0])

TIMES = (1.0, 2.0)  # of the parametric study

# Starting from five earlier states is as good as starting from 15.
SETTINGS = Options(snapshots=5, max_iterations=3000)
RTOL = 5e-5  # of the parametric study

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "bolted_lap_joint"


# %% The scene


def build_scene(
    joint: LapJoint,
    moved: Any = 0.0,
    friction: float = FRICTION,
    bolt: float = BOLT,
    shortening: float = SHORTENING,
    degree: int = 2,
) -> Scene:
    """The laws on the interfaces of a lap joint.

    Parameters
    ----------
    joint
        From :func:`parts.lap_joint.lap_joint`.
    moved
        Displacement of the gripped end, a vector or one that changes in time.
    friction, bolt, shortening
        Friction of all contacts; stiffness (N/mm) and shortening (mm, reached at time 1) of a whole bolt.
    degree
        Degree of the displacements.
    """
    # half a bolt has half the stiffness
    cut = Elastic(normal=bolt / 2, tangential=bolt / 2, total=True, jump=TIGHTEN * -shortening)
    scene = Scene()
    for name, part in joint.parts.items():
        scene.substructure(name, part, STEEL, degree=degree)
    for each in joint.interfaces:
        if each.kind == "contact":
            law = Contact(gap=0.0, friction=friction)
            scene.interface(each.name, each.face1, each.face2, law, overlap="partial")
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


# %% Quantities of interest


def along_x(problem: Problem, name: str, field: Array, where: Array | None = None) -> Array:
    """x-component of a local field (..., m, 3), integrated over an interface (or its mean `where`), (...)."""
    interface = problem.interfaces[name]
    weights = interface.weights if where is None else interface.weights * where
    total = np.einsum("p,pc,...pc->...", weights, interface.frames[:, :, 0], field)
    return np.asarray(total if where is None else total / weights.sum())


def load(problem: Problem, answer: Any) -> Array:
    """Load that the whole joint transmits at each time, N: the sum of all forces on the lower plate."""
    return HALVES * sum(along_x(problem, name, answer.force(name)) for name in ON_LOWER)


def slip(problem: Problem, answer: Any) -> Array:
    """Slip of the plates at each time, mm: mean under the heads."""
    x = problem.interfaces["plates"].points
    under = np.min([np.hypot(x[:, 0] - a, x[:, 1]) for a in (-20.0, 20.0)], axis=0) < 11.0
    return along_x(problem, "plates", answer.jump("plates"), under.astype(float))


def smallest_clearance(joint: LapJoint, problem: Problem, result: Any) -> float:
    """Lower bound of the distance of shanks and holes over the history, mm.

    If a wall moves by a and a shank by b in the plane, they come closer by at most |a - b|; all nodes of a
    wall are compared with all nodes of the shank within the plate.
    """
    moving = result.displacements

    def moved(part: str, face: str, low: float, high: float) -> Array:
        space = problem.substructures[part].V
        mesh_part = joint.parts[part]
        dofs = fem.locate_dofs_topological(space, 2, mesh_part.facets(face))
        z = space.tabulate_dof_coordinates()[dofs, 2]
        dofs = dofs[(z > low - 1e-9) & (z < high + 1e-9)]
        return moving[part].reshape(len(result.times), -1, 3)[:, dofs, :2]

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


def stored(problem: Problem, result: HistoryResult) -> Array:
    """Energy in the parts and in the cuts of the modelled half at each time, (T,), N mm.

    The energy in the cuts counts from the end of tightening on: until then their shortening does work, too.
    """
    energy = sum((result.work(name) for name in CUTS), start=np.zeros(len(result.times)))
    for name, part in problem.substructures.items():
        x, y = part.stiffness.createVecs()
        for step, u in enumerate(result.displacements[name]):
            x.setArray(u)
            part.stiffness.mult(x, y)
            energy[step] += 0.5 * x.dot(y)
    return energy


@dataclass(frozen=True)
class Loop:
    """Forces (N) and energies (N mm) of the whole joint at each time of the cycle, lengths in mm."""

    result: HistoryResult
    moved: Array
    load: Array
    plates: Array  # part of the load that friction between the plates carries
    pressed: Array  # the plates on each other
    slip: Array
    clamping: Array  # (4, T) under heads and nuts
    stored: Array
    work: Array  # taken up by the contacts
    heat: Array  # taken up by friction, with the forces at the end of each step
    seconds: float

    @property
    def first(self) -> int:
        """First reversal: a cycle goes from here to the end, where the displacement is the same again."""
        return int(np.argmax(self.moved))

    def cycle(self, energy: Array) -> float:
        """Change of an energy over the cycle."""
        return float(energy[-1] - energy[self.first])

    @property
    def area(self) -> float:
        """Work of the moved end in a cycle."""
        return float(np.trapezoid(self.load[self.first :], self.moved[self.first :]))

    @property
    def sliding(self) -> float:
        """Friction between the plates over friction times pressing force, where it is largest."""
        return float(np.max(np.abs(self.plates) / (FRICTION * self.pressed)))


def hysteresis(joint: LapJoint, steps: int, rtol: float = 1e-5) -> Loop:
    """The cycle, with `steps` time steps per quarter."""
    problem = assemble(build_scene(joint, CYCLE * (REACH, 0.0, 0.0)))
    times = np.linspace(1.0, 6.0, 5 * steps + 1)
    began = perf_counter()
    result = solve(problem, times=times, options=SETTINGS.with_(rtol=rtol))
    seconds = perf_counter() - began
    normal = {
        n: -HALVES * result.force(n)[..., 0] @ problem.interfaces[n].weights for n in CONTACTS
    }
    return Loop(
        result,
        np.array([REACH * CYCLE(t) for t in times]),
        load(problem, result),
        HALVES * along_x(problem, "plates", result.force("plates")),
        normal["plates"],
        slip(problem, result),
        np.array([normal[n] for n in CONTACTS[1:]]),
        HALVES * stored(problem, result),
        HALVES * sum((result.work(n) for n in CONTACTS), start=np.zeros(len(times))),
        HALVES * sum((result.dissipation(n) for n in CONTACTS), start=np.zeros(len(times))),
        seconds,
    )


def report_loop(loop: Loop, clearance: float, of: float) -> None:
    """The cycle as a table."""
    problem, result = loop.result.problem, loop.result
    points = sum(problem.interfaces[name].num_points for name in CONTACTS)

    def kilo(forces: Array) -> str:
        return ", ".join(f"{1e-3 * f:.2f}" for f in forces)

    print(f"""
{problem.size} unknowns, {points} facets in contact, {len(result.times)} time steps
{result.status} after {result.iterations} iterations, {loop.seconds:.1f} s
clamping under heads and nuts       {kilo(loop.clamping[:, 0])} kN
the same at the end                 {kilo(loop.clamping[:, -1])} kN
load where the end reverses         {kilo(loop.load[[loop.first, -1]])} kN
friction between the plates         {loop.sliding:.4f} of friction x pressing force where it is largest
largest slip of the plates          {1e3 * loop.slip.max():.0f} µm
energy of a cycle: area of the loop {loop.area:.1f} mJ
    taken up by the contacts        {loop.cycle(loop.work):.1f} mJ
    stored                          {loop.cycle(loop.stored):.1f} mJ
    heat of friction                {loop.cycle(loop.heat):.1f} mJ
shanks stay away from the holes by  {clearance:.2f} mm or more, of {of:.2f} mm""")


def loop_figure(loop: Loop, path: Path) -> Path:
    """Load against the displacement of the end and against slip."""
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, x in zip(axes, (1e3 * loop.moved, 1e3 * loop.slip), strict=True):
        axis.plot(x, 1e-3 * loop.load, "o-", ms=3, color="#0072b2", label="load of the joint")
        axis.plot(
            x, 1e-3 * loop.plates, "--", lw=1.2, color="#d55e00", label="by friction of the plates"
        )
        axis.plot(
            x, 1e-3 * (loop.load - loop.plates), ":", lw=1.5, color="#009e73", label="by the bolts"
        )
        axis.plot(x[0], 1e-3 * loop.load[0], "s", ms=6, color="black", label="tightened")
        axis.grid(alpha=0.3)
        axis.axhline(0.0, color="black", lw=0.5)
        axis.axvline(0.0, color="black", lw=0.5)
    axes[0].set_xlabel("displacement of the end (µm)")
    axes[0].set_ylabel("load (kN)")
    axes[1].set_xlabel("slip of the plates under the heads (µm)")
    axes[0].legend(fontsize=8, loc="upper left")
    figure.savefig(path, dpi=150)
    return path


def corners_of(part: Part, numbers: npt.NDArray[np.int64]) -> Array:
    """Corners (k, 3, 2), in the plane, of facets."""
    mesh = part.mesh
    mesh.topology.create_connectivity(2, 3)
    corners = entities_to_geometry(mesh, 2, numbers.astype(np.int32))[:, :3]
    found: Array = mesh.geometry.x[corners][:, :, :2]
    return found


def contact_figure(joint: LapJoint, loop: Loop, path: Path) -> Path:
    """Pressure between the plates and the utilisation of friction, tightened and pulled."""
    interface = loop.result.problem.interfaces["plates"]
    part = joint.parts[interface.sides[interface.carrier].substructure]
    # slip begins within the first quarter
    begins = int(np.argmax(loop.plates > 0.6 * loop.plates.max()))
    steps = (0, begins, loop.first)
    found = [io.facet_fields(loop.result, "plates", step) for step in steps]
    triangles = corners_of(part, found[0][0])
    triangles = np.concatenate([triangles, triangles * [1.0, -1.0]])  # both halves
    pressures = [fields["pressure"] for _, fields in found]
    highest = float(np.max(pressures))
    closed = [np.where(p > 1e-6 * highest, p, np.nan) for p in pressures]
    used = [
        np.linalg.norm(fields["shear"], axis=1) / (FRICTION * p)
        for (_, fields), p in zip(found, closed, strict=True)
    ]
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    rows = (
        (closed, "pressure (MPa)", "viridis", highest),
        (used, "friction in use (-)", "plasma", 1.0),
    )
    for axes, (values, label, colours, top) in zip(grid, rows, strict=True):
        for axis, now in zip(axes, values, strict=True):
            # grey is a plate that touches nothing, white is no plate: the holes
            coloured = matplotlib.colormaps[colours].with_extremes(bad="#c8c8c8")
            shown = PolyCollection(triangles, array=np.tile(now, 2), cmap=coloured, clim=(0.0, top))
            shown.set_edgecolor("face")
            axis.add_collection(shown)
            axis.autoscale_view()
            axis.set_aspect("equal")
        figure.colorbar(shown, ax=axes, label=label)
        axes[0].set_ylabel("y (mm)")
    for axis, step in zip(grid[0], steps, strict=True):
        where = f"pulled by {1e3 * loop.moved[step]:.0f} µm" if step else "tightened"
        axis.set_title(where, fontsize=10)
    for axis in grid[-1]:
        axis.set_xlabel("x (mm)")
    figure.savefig(path, dpi=200)
    return path


# %% Parametric study


def grid(n: int) -> dict[tuple[str, ...], Array]:
    """Friction, shortening (as the jump of the cuts) and stiffness of half a bolt, n values each."""
    return {
        tuple(f"{name}.friction" for name in CONTACTS): np.linspace(0.1, 0.3, n),
        tuple(f"{name}.jump" for name in CUTS): -np.linspace(0.1, 0.2, n),
        tuple(f"{name}.{k}" for name in CUTS for k in ("normal", "tangential")): (
            0.5 * BOLT * np.linspace(0.5, 1.5, n)
        ),
    }


def study(problem: Problem, n: int, rtol: float = RTOL, **settings: Any) -> SweepResult:
    """Load and slip after tightening and shear, for n^3 parameter sets."""
    head = problem.interfaces["head1"].weights
    return sweep(
        problem,
        grid(n),
        times=TIMES,
        options=SETTINGS.with_(rtol=rtol),
        keep_fields=False,
        outputs={
            "load": lambda point: load(problem, point)[..., -1],
            "slip": lambda point: slip(problem, point)[..., -1],
            "preload": lambda point: -HALVES * (point.force("head1")[:, 0, :, 0] @ head),
        },
        **settings,
    )


def study_problem(joint: LapJoint, comm: Any = None) -> Problem:
    """Tightening, then a pull at the end; `comm` as for assemble."""
    return assemble(build_scene(joint, SHEAR * (PULL, 0.0, 0.0)), comm=comm)


def cold(joint: LapJoint, friction: float, jump: float, half_bolt: float) -> tuple[float, float]:
    """Load and slip of one set, solved by itself to a tight tolerance."""
    pull = SHEAR * (PULL, 0.0, 0.0)
    problem = assemble(build_scene(joint, pull, friction, 2.0 * half_bolt, -jump))
    # Newton steps: from zero to a tight tolerance the accelerated iteration alone may not converge
    options = Options(rtol=1e-8, max_iterations=10000)
    result = solve(problem, times=TIMES, options=options)
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


def report_study(surface: SweepResult, seconds: float, error: float, sets: int) -> None:
    """The study as a table."""
    counts = surface.points.iterations[surface.points.order]
    others = f"{counts[1:].mean():.1f} for each of the others"
    found = {name: surface.output(name) for name in ("load", "slip", "preload")}
    shares = found["load"] / (2.0 * found["preload"])

    def span(values: Array, factor: float, digits: int) -> str:
        return f"{factor * values.min():.{digits}f} to {factor * values.max():.{digits}f}"

    print(f"""
{counts.size} parameter sets in {seconds:.1f} s, {int(surface.converged.sum())} converged
iterations                          {counts[0]} for the first one, {others}
preload of a bolt                   {span(found["preload"], 1e-3, 1)} kN
load                                {span(found["load"], 1e-3, 1)} kN
load / preload of both bolts        {span(shares, 1.0, 2)}
slip of the plates                  {span(found["slip"], 1e3, 1)} µm
error of load and slip              {error:.1e} of the largest, at {sets} sets solved by themselves""")


def surface_figures(surface: SweepResult, folder: Path) -> list[Path]:
    """Load and slip over friction and preload, and over friction and stiffness."""
    friction, jump, half = surface.axes.values()
    middle = len(half) // 2
    # the preload depends on the friction by a fraction of a percent
    preload = 1e-3 * surface.output("preload")[:, :, middle].mean(axis=0)
    pulled = f"end moved by {1e3 * PULL:.0f} µm"
    paths = []
    for name, label, factor in (("load", "load (kN)", 1e-3), ("slip", "slip (µm)", 1e3)):
        z = factor * surface.output(name)
        labels = ("friction (-)", "preload of a bolt (kN)", label)
        title = f"{label.partition(' (')[0]}, bolts of {2e-3 * half[middle]:.0f} kN/mm, {pulled}"
        file = folder / f"{name}_friction_preload.png"
        paths.append(
            figures.response_surface(friction, preload, z[:, :, middle], labels, file, title=title)
        )
        labels = ("friction (-)", "stiffness of a bolt (kN/mm)", label)
        title = f"{label.partition(' (')[0]}, bolts shortened by {-jump[middle]:.2f} mm, {pulled}"
        file = folder / f"{name}_friction_stiffness.png"
        paths.append(
            figures.response_surface(
                friction, 2e-3 * half, z[:, middle], labels, file, title=title
            )
        )
    return paths


# %% The script


def main(given: Sequence[str] | None = None) -> None:
    """Solve, print, draw and check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", default=None, help="coarse, medium, or a cell size in mm")
    parser.add_argument("--quick", action="store_true", help="coarse, fewer steps and sets")
    parser.add_argument("--plan", action="store_true", help="print the scene and its plan, too")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder of figures and fields")
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    options = parser.parse_args(given)
    size = options.size or ("coarse" if options.quick else "medium")
    joint = lap_joint(size if size in ("coarse", "medium") else float(size))
    output: Path = options.output
    output.mkdir(parents=True, exist_ok=True)

    loop = hysteresis(joint, steps=4 if options.quick else 10)
    result = loop.result
    if options.plan:
        print(result.problem, result.plan, sep="\n")
    clearance = smallest_clearance(joint, result.problem, result)
    report_loop(loop, clearance, joint.clearance)

    problem = study_problem(joint)
    began = perf_counter()
    surface = study(problem, 4 if options.quick else 10)
    seconds = perf_counter() - began
    sets = 3 if options.quick else 6
    error = checked(joint, surface, sets)
    report_study(surface, seconds, error, sets)

    paths = []
    for name, step in (("tightened", 0), ("pulled", loop.first), ("pushed", 3 * loop.first)):
        paths.append(io.write_fields(result, output / f"{name}.vtm", step=step))
    paths.append(io.write_interfaces(result, output / "interfaces.pvd"))
    if not options.no_figures:
        x, y, z = joint.parts["upper"].mesh.geometry.x.max(axis=0)
        grip = (float(x), float(y) / 2, float(z) / 2)
        pull = [(grip, (grip[0] + 25.0, *grip[1:]))]
        paths += [
            figures.assembly_figure(joint, output / "joint.png", arrows=pull),
            figures.interface_figure(
                result, "plates", output / "pressure.png", step=0, label="pressure between the plates (MPa)"
            ),
            loop_figure(loop, output / "loop.png"),
            contact_figure(joint, loop, output / "contact.png"),
            *surface_figures(surface, output),
        ]
    print("\n" + "\n".join(f"wrote {path.name}" for path in paths))
    print(f"to {output}")

    check(loop, clearance, surface, error, options.quick)
    print("all checks passed")


def check(loop: Loop, clearance: float, surface: SweepResult, error: float, quick: bool) -> None:
    """Energies balance, plates slip at friction x pressing force, the parametric study is accurate."""
    assert loop.result.converged and surface.converged.all()
    assert clearance > 0.0, "a shank touches its hole, where the model has no interface"
    lost = loop.area - loop.cycle(loop.work) - loop.cycle(loop.stored)
    assert abs(lost) < 1e-3 * loop.area, f"energy of {lost:.3g} mJ is lost"
    heat = abs(loop.cycle(loop.heat) / loop.cycle(loop.work) - 1.0)
    assert heat < (0.1 if quick else 0.04), f"heat and work of the contacts differ by {heat:.1%}"
    assert 0.99 < loop.sliding < 1.0 + 1e-3, f"the plates slip at {loop.sliding:.4f}"
    assert error < 1e-3, f"sweep and tight solutions differ by {error:.1e}"


if __name__ == "__main__":
    main()
