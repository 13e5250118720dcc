"""A pipe flange from a STEP file: eight bolts tightened in turn, pressure, and the probability of a leak.

    ./run python demos/flange_from_step.py           35 parts, 94 000 unknowns, two and a half minutes
    ./run python demos/flange_from_step.py --quick   a coarse mesh, 16 samples

Problem
    Two weld-neck flanges (near DN 100) with a ring gasket and eight M20 stud bolts with two nuts each: 27
    solids, written by ``make_flange_step.py`` and read again with ``read_step``. Each stud is cut in
    the middle for its pretension section. Where solids touch they share a face, and their meshes match.

Laws (N, mm, MPa)
    flanges, bolts   E = 200 000 MPa, nu = 0.3
    gasket           E = 3 000 MPa, nu = 0.2; glued to the lower flange; contact with the upper flange
                     through the filler of 2 000 N/mm^3, which transmits no traction
    nuts             glued to flanges and studs
    studs            Preload: 45 kN in the step in which a stud is tightened, constant length otherwise
    load             10 MPa inside, with the thrust on the end of the pipe; the end of the lower pipe is fixed

Load history
    First all bolts are tightened to 20 % at once (by hand), then one after another in a star pattern to 60 %
    and to 100 %, then in circular passes at 100 % until every bolt has its preload. Then the pressure is
    applied. Tightening one bolt relieves its neighbours.

Random variables
    The preload of every bolt (normal, coefficient of variation 10 %, independent: a torque wrench) and the
    stiffness of the filler (lognormal, 25 %). The joint leaks where the pressure on the gasket, averaged over
    its width and an eighth of its circumference, is below 2 times the pressure inside.

Answer sheets
    ``tightened.html`` and ``scatter.html`` (numbers in ``.csv``): for each bolt preload, force range, load
    factor, residual clamping and margins, for the gasket its pressure against what it needs, with errors.

Checks
    balance of bolts, gasket and pressure; preload; symmetry under rotation by one bolt; the sheets against
    the forces that the demo computes itself.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from make_flange_step import FlangeShape, make_flange
from matplotlib.figure import Figure

from dolfinx_frontend import (
    Amplitude,
    Contact,
    HistoryResult,
    Law,
    LinearElastic,
    LogNormal,
    Normal,
    Options,
    Perfect,
    Preload,
    Problem,
    RandomLaws,
    Report,
    SampleResult,
    Scene,
    assemble,
    figures,
    io,
    quasi_monte_carlo,
    read_step,
    report,
    sample,
    solve,
)
from dolfinx_frontend.geometry.parts import Assembly, Connection
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step import StepAssembly

Array = npt.NDArray[np.float64]

# the gasket is pressed by 2 % at its rim, and its modulus is not known better than that
warnings.filterwarnings("ignore", "beyond the model: strain")

STEEL = LinearElastic(E=200e3, nu=0.3)
GASKET = LinearElastic(E=3e3, nu=0.2)
FILLER = 2000.0  # N/mm^3
FORCE = 45e3  # N, of a bolt
PRESSURE = 10.0  # MPa
LEAK = 2.0  # least gasket pressure over the pressure inside
STAR = (1, 5, 3, 7, 2, 6, 4, 8)
ROUND = (1, 2, 3, 4, 5, 6, 7, 8)
SCATTER = 0.10  # of the preloads
FILLER_SCATTER = 0.25

STRESS_AREA = 245.0  # mm^2, of M20

BOLTS = tuple(f"stud {k}-|stud {k}+" for k in ROUND)
SEAT = "upper flange|gasket"
# faces of the upper half on which the pressure acts
LOADS = ("pressure(upper flange:inside)", "thrust")

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "flange_from_step"


# %% From the STEP file to a scene


def read(path: Path, shape: FlangeShape, size: float) -> StepAssembly:
    """The STEP file with materials, mesh sizes, and names for the faces that are held or loaded."""
    step = read_step(path, cuts=Cut("stud *", normal=(0.0, 0.0, 1.0)))
    step.material("*", STEEL)
    step.material("gasket", GASKET)
    step.size("* flange", size)
    step.size("gasket", 0.65 * size)
    step.size("stud *", 0.6 * size)
    step.size("* nut *", 0.6 * size)
    end = shape.levels[-1]
    step.face("lower flange:end", normal=(0, 0, -1), at=(None, None, -end))
    step.face("upper flange:end", normal=(0, 0, 1), at=(None, None, end))
    # the pressure reaches the inner rim of the gasket
    step.face("* flange:inside", radius=shape.bore)
    step.face("* flange:inside", where=lambda f: abs(f.low[0] + shape.gasket_inner) < 1e-3)
    step.face("gasket:inside", radius=shape.gasket_inner)
    step.join("*", Perfect())
    step.join(SEAT, Contact(gap=0.0, stiffness=FILLER))
    step.join("stud *-|stud *+", Preload(FORCE))
    return step


def schedule(rounds: int) -> list[tuple[tuple[int, ...], float]]:
    """The steps of the tightening: bolts that are tightened, and the fraction of the force that they get."""
    steps: list[tuple[tuple[int, ...], float]] = [(ROUND, 0.2)]
    for share in (0.6, 1.0):
        steps += [((bolt,), share) for bolt in STAR]
    for _ in range(rounds):
        steps += [((bolt,), 1.0) for bolt in ROUND]
    return steps


def bolt_laws(steps: list[tuple[tuple[int, ...], float]]) -> dict[str, Law]:
    """Pretension sections whose force is given while the bolt is tightened; step k ends at k + 1."""
    given = Amplitude(np.arange(1.0, len(steps) + 1.0), [share for _, share in steps])
    laws: dict[str, Law] = {}
    for bolt, name in zip(ROUND, BOLTS, strict=True):
        during = tuple((float(k), k + 1.0) for k, (bolts, _) in enumerate(steps) if bolt in bolts)
        laws[name] = Preload(given * FORCE, during=during)
    return laws


def random_laws(tightened: float) -> dict[str, Law]:
    """Random preloads, reached by all bolts at one time, and a random filler."""
    laws: dict[str, Law] = {
        name: Preload(Normal(f"F{k}", mean=FORCE, cov=SCATTER), until=tightened)
        for k, name in zip(ROUND, BOLTS, strict=True)
    }
    laws[SEAT] = Contact(gap=0.0, stiffness=LogNormal("k", mean=FILLER, cov=FILLER_SCATTER))
    return laws


def loaded(step: StepAssembly, assembly: Assembly, shape: FlangeShape, on: Amplitude) -> Scene:
    """The scene with the pressure, its thrust on the pipe's end, and the support."""
    scene = step.scene(assembly)
    scene.fix("lower flange:end")
    for part in ("upper flange", "lower flange", "gasket"):
        scene.pressure(f"{part}:inside", on * PRESSURE, name=f"pressure({part}:inside)")
    thrust = PRESSURE * shape.bore**2 / (shape.pipe**2 - shape.bore**2)
    scene.traction("upper flange:end", on * (0.0, 0.0, thrust), name="thrust")
    return scene


# %% Quantities of interest; the last axes of a force are points and components


def bolt_forces(problem: Problem, answer: Any) -> Array:
    """Force of every bolt, N, (..., 8)."""
    each = [answer.force(n)[..., 0] @ problem.interfaces[n].weights for n in BOLTS]
    return np.stack(each, axis=-1)


def along_axis(problem: Problem, name: str, force: Array) -> Array:
    """Resultant along z of what an interface exerts on its first side, N."""
    interface = problem.interfaces[name]
    frames = interface.frames[:, : force.shape[-1]]
    return np.asarray(np.einsum("p,pc,...pc->...", interface.weights, frames[:, :, 2], force))


def gasket_pressure(problem: Problem, answer: Any, angles: Array) -> Array:
    """Pressure on the gasket around the circumference, MPa, (..., angles).

    Mean over its width and, with the weight 1 + cos, over an eighth of the circumference.
    """
    interface = problem.interfaces[SEAT]
    at = np.arctan2(interface.points[:, 1], interface.points[:, 0])
    away = np.abs((angles[:, None] - at + np.pi) % (2 * np.pi) - np.pi)
    weights = np.where(away < np.pi / 8, 1.0 + np.cos(8 * away), 0.0) * interface.weights
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(-answer.force(SEAT)[..., 0] @ weights.T)


def harmonics(problem: Problem, answer: Any) -> Array:
    """Complex amplitudes 0 to 7 of the gasket's pressure around the circumference, MPa, (..., 8)."""
    interface = problem.interfaces[SEAT]
    at = np.arctan2(interface.points[:, 1], interface.points[:, 0])
    waves = np.exp(-1j * np.outer(np.arange(8), at)) * interface.weights / interface.area
    return np.asarray(-answer.force(SEAT)[..., 0] @ waves.T)


def imbalance(problem: Problem, answer: Any, loads: Array) -> float:
    """Largest imbalance of bolts, gasket and pressure along the axis, relative to the largest of them."""
    bolts = bolt_forces(problem, answer).sum(axis=-1)
    gasket = along_axis(problem, SEAT, answer.force(SEAT))
    largest = max(np.abs(each).max() for each in (bolts, gasket, loads))
    return float(np.abs(bolts - gasket - loads).max() / largest)


def pressure_force(problem: Problem, times: Array, on: Amplitude) -> Array:
    """Force of the pressure that separates the flanges, N, on the area of the meshes, (T,)."""
    inside, end = (problem.interfaces[name] for name in LOADS)
    push = -float(inside.weights @ inside.normals[:, 2]) * PRESSURE
    pull = float(end.area) * float(np.asarray(end.law.at(1e9).t.terms[0][1])[2])
    return np.array([on(t) for t in times]) * (push + pull)


# %% Figures


def tightening_figure(
    problem: Problem, result: HistoryResult, steps: list[tuple[tuple[int, ...], float]], path: Path
) -> Path:
    """Bolt forces over the steps, and the gasket's pressure around the circumference."""
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    forces = 1e-3 * bolt_forces(problem, result)
    numbers = np.arange(1, len(forces) + 1)
    colours = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#7f7f7f", "#000000"]
    for k, colour in enumerate(colours):
        left.plot(numbers, forces[:, k], "-", lw=1.2, color=colour, label=f"bolt {k + 1}")
        own = [i for i, (bolts, _) in enumerate(steps) if bolts == (k + 1,)]
        left.plot(numbers[own], forces[own, k], "o", ms=4, color=colour)
    left.axhline(1e-3 * FORCE, color="black", lw=0.6, ls="--")
    for start in range(1, len(steps), 8):
        left.axvline(start + 0.5, color="#bbbbbb", lw=0.7)
    left.axvline(len(steps) + 0.5, color="#bbbbbb", lw=0.7)
    left.set_xlabel("step of the tightening (the last one: pressure)")
    left.set_ylabel("bolt force (kN)")
    left.set_title("a dot where the bolt is tightened", fontsize=10)
    left.legend(fontsize=8, ncols=2, loc="lower right")
    angles = np.linspace(0.0, 2 * np.pi, 181)
    around = gasket_pressure(problem, result, angles)
    stages = {0: "20 %, by hand", 4: "half of the first star", 8: "60 %", 16: "100 %"}
    stages |= {len(steps) - 1: "last round", len(steps): f"with {PRESSURE:g} MPa"}
    for k, (stage, label) in enumerate(stages.items()):
        right.plot(np.degrees(angles), around[stage], color=colours[k], lw=1.4, label=label)
    right.set_xlim(0, 360)
    right.set_xticks(range(0, 361, 45))
    right.set_ylim(bottom=0.0)
    right.set_xlabel("angle (degrees); bolts at the ticks, bolt 1 at 0")
    right.set_ylabel("pressure on the gasket (MPa)")
    right.legend(fontsize=8, ncols=2, loc="lower center")
    for axes in (left, right):
        axes.grid(alpha=0.25)
    figure.savefig(path, dpi=150)
    return path


def exploded(assembly: Assembly, path: Path) -> Path:
    """The parts pulled apart, faces coloured by the kind of their interface."""
    lift = {}
    for name in assembly.parts:
        level = {"upper nut": 95.0, "upper flange": 50.0, "gasket": 0.0, "lower flange": -50.0}
        level |= {"lower nut": -95.0}
        lift[name] = next((z for start, z in level.items() if name.startswith(start)), 0.0)
        if name.startswith("stud"):
            lift[name] = 20.0 if name.endswith("+") else -20.0
    held = [Connection("support", "support", "lower flange:end")]
    held += [Connection(name, "pressure", name[9:-1]) for name in LOADS[:1]]
    held += [Connection(p, "pressure", f"{p}:inside") for p in ("lower flange", "gasket")]
    shown = replace(assembly, interfaces=(*assembly.interfaces, *held))
    return figures.assembly_figure(shown, path, lift=lift)


def cut_open(result: HistoryResult, path: Path) -> Path:
    """Pressure on the gasket with the load, what lies on it cut open in front."""
    return figures.interface_figure(
        result,
        SEAT,
        path,
        label="pressure on the gasket (MPa)",
        scale=20.0,
        cut=((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        view=(-0.35, -1.0, 0.75),
    )


def leak_figure(least: Any, forces: Array, path: Path) -> Path:
    """Distribution of the least gasket pressure with the probability of a leak, and what it depends on."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    values = np.asarray(least.values)
    limit = LEAK * PRESSURE
    left.hist(values, bins=max(10, int(np.sqrt(values.size))), density=True, color="#b8cfe0")
    density = least.density()
    x, y = np.asarray(density[0]), np.asarray(density[1])
    left.plot(x, y, color="#0072b2", lw=1.6)
    left.fill_between(x, y, where=(x < limit).tolist(), color="#d55e00", alpha=0.45, lw=0)
    left.axvline(limit, color="#d55e00", lw=1.2, ls="--", label=f"leak below {limit:g} MPa")
    left.set_xlabel("least pressure on the gasket (MPa)")
    leak = least.probability(below=limit)
    left.set_title(f"P(leak) = {leak.value:.1%} ({leak.low:.1%} to {leak.high:.1%})", fontsize=10)
    left.set_ylabel("density (1/MPa)")
    left.set_ylim(bottom=0.0)
    left.legend(fontsize=8)
    right.plot(1e-3 * forces.mean(axis=1), values, ".", ms=4, color="#0072b2", label="mean of the bolts")
    right.plot(1e-3 * forces.min(axis=1), values, ".", ms=4, color="#e69f00", label="loosest bolt")
    right.axhline(limit, color="#d55e00", lw=1.2, ls="--")
    right.set_xlabel("preload (kN)")
    right.set_ylabel("least pressure on the gasket (MPa)")
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.25)
    figure.savefig(path, dpi=150)
    return path


# %% The studies


def answer_sheet(answer: Any, path: Path, title: str, pictures: bool, errors: Any = True) -> Report:
    """The bolts and the gasket of an answer, written as HTML and CSV."""
    return report(
        answer,
        path,
        title=title,
        units=("mm", "N"),
        bolts={name: f"bolt {k}" for k, name in zip(ROUND, BOLTS, strict=True)},
        seals={SEAT: LEAK * PRESSURE},
        stress_area=STRESS_AREA,
        errors=errors,
        pictures=pictures,
    )


def rotation_error(problem: Problem, times: Array, options: Options) -> tuple[float, float]:
    """Deviation from rotational symmetry: one bolt after another is tightened 10 % more than the others.

    Returns
    -------
    tuple
        Largest difference of the bolt forces with pressure, rotated back, over the preload; and of the
        first harmonics of the gasket's pressure, over its mean.
    """
    names = RandomLaws.of(problem).space.germ_names
    germs = np.zeros((8, len(names)))
    for k in ROUND:
        germs[k - 1, names.index(f"F{k}")] = 1.0
    answer = sample(problem, germs, times=times, options=options, progress=False)
    forces = bolt_forces(problem, answer)[:, -1]
    waves = harmonics(problem, answer)[:, -1]
    turns = np.exp(1j * np.outer(np.arange(8), np.arange(8)) * 2 * np.pi / 8)
    back = np.stack([np.roll(forces[k], -k) for k in range(8)])
    same = waves * turns
    shape_error = np.abs(same[:, 1:5] - same[:, 1:5].mean(axis=0)).max() / np.abs(same[:, 0]).mean()
    return float(np.abs(back - back.mean(axis=0)).max() / FORCE), float(shape_error)


def main() -> None:
    """Read, tighten, load, sample, print, draw and check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="coarse, few samples")
    parser.add_argument("--size", type=float, default=None, help="cells of the flanges in mm")
    parser.add_argument("--samples", type=int, default=None, help="a power of two")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true")
    given = parser.parse_args()
    size = given.size or (26.0 if given.quick else 17.0)
    rounds = 3
    samples = given.samples or (16 if given.quick else 1024)
    given.output.mkdir(parents=True, exist_ok=True)
    began = perf_counter()

    shape = FlangeShape()
    file = make_flange(given.output / "flange.step", shape)
    step = read(file, shape, size)
    print(step)
    assembly = step.mesh()
    meshed = perf_counter()

    steps = schedule(rounds)
    tightened = float(len(steps))
    on = Amplitude([tightened, tightened + 1.0], [0.0, 1.0])
    problem = assemble(loaded(step, assembly, shape, on))
    unknowns = sum(len(s.load) for s in problem.substructures.values())
    ready = perf_counter()

    times = np.arange(1.0, len(steps) + 2.0)
    options = Options(rtol=1e-8, max_iterations=1000)
    sequence = problem.with_laws(bolt_laws(steps))
    result = solve(sequence, times=times, options=options)
    forces = bolt_forces(sequence, result)
    loads = pressure_force(problem, times, on)
    rest = imbalance(sequence, result, loads)
    at_turn = [
        abs(forces[k, bolt - 1] / (share * FORCE) - 1.0)
        for k, (bolts, share) in enumerate(steps)
        for bolt in bolts
    ]
    solved = perf_counter()
    spent = f"mesh {meshed - began:.0f} s, assembly {ready - meshed:.0f} s, solution {solved - ready:.0f} s"
    size_of = f"{len(assembly.parts)} parts, {unknowns} unknowns, {len(step.interfaces)} interfaces"
    print(f"""
{size_of}; {spent}
{result.status} after {result.iterations} iterations on {len(times)} steps, estimated error {result.error:.0e}

bolt forces, kN                 {"".join(f"{f'bolt {k}':>8}" for k in ROUND)}""")
    shown = {"by hand, 20 %": 0, "first star, 60 %": 8, "second star, 100 %": 16}
    shown |= {f"round {n + 1}, 100 %": 24 + 8 * n for n in range(rounds)}
    shown |= {f"with {PRESSURE:g} MPa inside": len(steps)}
    for label, k in shown.items():
        print(f"{label:<32}" + "".join(f"{1e-3 * f:8.2f}" for f in forces[k]))
    gasket = along_axis(sequence, SEAT, result.force(SEAT))
    angles = np.radians(np.arange(0.0, 360.0, 5.0))
    around = gasket_pressure(sequence, result, angles)
    final = float(np.abs(forces[-2] / FORCE - 1.0).max())
    print(f"""
                                tightened   with pressure
sum of bolt forces              {1e-3 * forces[-2].sum():9.2f}  {1e-3 * forces[-1].sum():9.2f}   kN
reaction of the gasket          {1e-3 * gasket[-2]:9.2f}  {1e-3 * gasket[-1]:9.2f}   kN
force of the pressure           {1e-3 * loads[-2]:9.2f}  {1e-3 * loads[-1]:9.2f}   kN
rest, relative to largest    {rest:9.1e} (largest of all steps)
least pressure on the gasket    {around[-2].min():9.2f}  {around[-1].min():9.2f}   MPa
largest pressure on the gasket  {around[-2].max():9.2f}  {around[-1].max():9.2f}   MPa""")

    # random samples: all bolts at once, then the pressure
    pair = np.array([tightened, tightened + 1.0])
    uncertain = problem.with_laws(random_laws(tightened))
    start = perf_counter()
    # a sample starts from the state of a close one: Anderson's steps are then 4 times cheaper than Newton's
    quickly = Options(rtol=1e-7, max_iterations=1000, newton=0)
    drawn: SampleResult = quasi_monte_carlo(uncertain, samples, times=pair, options=quickly)
    seconds = perf_counter() - start
    sample_rest = imbalance(uncertain, drawn, loads[-2:])
    names = drawn.space.germ_names
    preloads = FORCE * (1.0 + SCATTER * drawn.germs[:, [names.index(f"F{k}") for k in ROUND]])
    reached = np.abs(bolt_forces(uncertain, drawn)[:, 0] / preloads - 1.0).max()
    least = drawn.quantity(
        lambda f: gasket_pressure(uncertain, f, angles)[:, -1].min(axis=1), "least gasket pressure", "MPa"
    )
    change = bolt_forces(uncertain, drawn)[:, 1] - bolt_forces(uncertain, drawn)[:, 0]
    leak = least.probability(below=LEAK * PRESSURE)
    mean, deviation = least.mean().value, least.std().value
    low, high = (least.quantile(q).value for q in (0.05, 0.95))
    interval = f"({100 * leak.low:.2f} to {100 * leak.high:.2f} %, {100 * leak.level:.0f} % interval)"
    print(f"""
{samples} samples of {len(names)} variables in {seconds:.0f} s, {drawn.iterations.mean():.1f} iterations each
least pressure on the gasket    {mean:9.2f} MPa mean, {deviation:.2f} MPa standard deviation
                                {low:9.2f} MPa at 5 %, {high:.2f} MPa at 95 %
bolt force due to the pressure  {1e-3 * change.mean():9.2f} kN mean, {1e-3 * change.std():.2f} kN deviation
P(leak)                         {100 * leak.value:9.2f} %  {interval}""")

    turned, shape_error = rotation_error(uncertain, pair, options)
    nominal = solve(
        problem.with_laws({n: Preload(FORCE, until=tightened) for n in BOLTS}), times=pair, options=options
    )
    alike = bolt_forces(problem, nominal)[-1]
    spread = float(np.ptp(alike) / FORCE)
    print(f"""
symmetry, one bolt further (errors of the mesh)
all bolts alike: spread         {spread:9.1e} of the preload
one bolt tighter, bolt forces   {turned:9.1e} of the preload
one bolt tighter, gasket        {shape_error:9.1e} of the mean pressure""")

    drawn_too = not given.no_figures
    title = f"Flange, bolts tightened in turn, {PRESSURE:g} MPa"
    sheet = answer_sheet(result, given.output / "tightened.html", title, drawn_too)
    title = f"Flange, random preloads and gasket, {PRESSURE:g} MPa"
    scatter = answer_sheet(drawn, given.output / "scatter.html", title, drawn_too, nominal.errors())
    print(f"\n{sheet.sentences[0]}\n\nwith scatter\n" + "\n".join(scatter.sentences))

    paths = [io.write_fields(result, given.output / "flange.vtm")]
    paths += [given.output / "tightened.html", given.output / "scatter.html"]
    if not given.no_figures:
        paths.append(tightening_figure(sequence, result, steps, given.output / "tightening.png"))
        paths.append(leak_figure(least, preloads, given.output / "leak.png"))
        paths.append(exploded(assembly, given.output / "flange.png"))
        paths.append(cut_open(result, given.output / "gasket.png"))
        moved = {name: result.displacement(name) for name in assembly.parts}
        title = f"with {PRESSURE:g} MPa inside"
        paths.append(figures.deformed_figure(moved, given.output / "deformed.png", scale=10.0, title=title))
    print("\n" + "\n".join(f"wrote {each.name}" for each in paths))
    print(f"they are in {given.output}; {perf_counter() - began:.0f} s in all")

    assert result.converged and drawn.converged and nominal.converged
    assert len(assembly.parts) > 25
    assert max(rest, sample_rest) < 1e-6, f"bolts, gasket and pressure: {rest:.1e}, {sample_rest:.1e}"
    assert max(at_turn) < 1e-2 and reached < 1e-2, f"preload missed by {max(at_turn):.1e}, {reached:.1e}"
    told = np.array([[sheet.value(f"bolt {k}", key) for key in ("F_V", "F_S", "F_KV")] for k in ROUND])
    assert np.allclose(told[:, 0], forces[-2]) and np.allclose(told[:, 1], forces[-1])
    assert abs(told[:, 2].sum() / forces[-2].sum() - 1.0) < 1e-4, "the bolts share the force of the gasket"
    assert np.isclose(scatter.value("bolt 1", "F_S", "mean"), bolt_forces(uncertain, drawn)[:, -1, 0].mean())
    assert np.isclose(scatter.value(SEAT, "Q_S", "mean"), mean)
    assert np.isclose(scatter.value(SEAT, "m_L", "P(used up)"), leak.value)
    assert final < 1e-2, f"after the last round a bolt is off by {final:.1%}"
    assert max(spread, turned, shape_error) < 1e-2, f"rotated: {turned:.1e}, {shape_error:.1e}"
    print("all checks passed")


if __name__ == "__main__":
    main()
