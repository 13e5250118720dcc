"""Speed against accuracy: all settings, one by one and together, on three scenes, and the Pareto front.

``./run bench tradeoff --json FILE --markdown benchmarks/measured/tradeoff.md`` measures all of it and writes
the record, the part of the page on the front and its figures; ``--read FILE`` makes them from a record.

The scenes are the geometries of the demos, with randomness that has moments of every order:

* ``vessel``: the bolted vessel, lognormal stiffness of screw (c.o.v. 0.1) and joint (0.2). The demo's normal
  stiffness has no E[1/k], so that no reference exists for it. Quantity: normal force on the joint;
* ``lap``: the bolted lap joint, tightened and pulled, with contact and friction; lognormal coefficient of
  friction and stiffness of the bolts (0.15 each). Quantity: friction force between the plates when pulled;
* ``field``: the vessel with the random field of ``random_field_joint`` as the stiffness of its joint, always
  with six Karhunen-Loeve modes. Quantity: normal force on the joint.

Every run gives mean and standard deviation of the quantity; its ``error`` is the larger of their relative
errors against a reference, of two kinds that are kept apart:

* ``error``: against a reference on the same mesh, degree and interface space: algebra and chaos;
* ``error_all``: against a mesh (and degree) finer than all that are compared: discretisation, too.

``own_error`` of a reference is its difference from a second one, of another method or of the next finer
rule, or (``error_all``) of the next coarser mesh. Errors of (quasi-)Monte Carlo are root mean squares over
`SEEDS` seeds. ``lucky`` marks an error that is small by chance: a setting of the same series with all knobs
as tight or tighter is over three times worse; ``lucky_all`` one that is smaller than that of the tightest run
on its mesh, because errors of chaos and mesh cancel. Such points are drawn small, and left out of front and
table.

Cost: ``seconds`` from the matrices of the parts to the two numbers, a median; ``units`` = seconds over one
direct solution (analysis, factorisation, one solve) of the scene's base mesh, measured in the same run with
the same threads; ``units_all`` has the assembly by dolfinx and the pairing of the interfaces, too. Meshing is
in neither.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, Literal

import common
import contact
import numpy as np
import numpy.typing as npt
from _graded import graded

from dolfinx_frontend import (
    Chaos,
    Contact,
    Elastic,
    LogNormal,
    Options,
    Problem,
    RandomField,
    Resultant,
    SampleResult,
    assemble,
    monte_carlo,
    quasi_monte_carlo,
    reference,
    solve,
    sparse_quadrature,
    tensor_quadrature,
)
from parts.front import FrontPanel, front_figure
from parts.lap_joint import lap_joint
from parts.unit import measure_unit
from parts.vessel import BoltedVessel, bolted_vessel

Array = npt.NDArray[np.float64]
Method = Literal["latin", "single", "latin2004", "ssfem", "tensor", "sparse", "mc", "qmc"]

METHODS: dict[Method, str] = {
    "latin": "LATIN-PCE",
    "ssfem": "monolithic SSFEM",
    "tensor": "tensor quadrature",
    "sparse": "sparse quadrature",
    "mc": "Monte Carlo",
    "qmc": "quasi-Monte Carlo",
    "latin2004": "LATIN-PCE of 2004",
    "single": "LATIN-PCE, float32",
}
LEVELS = (1e-1, 1e-2, 1e-3, 1e-4)
SEEDS = 4
ADAPTED_UNKNOWNS, ADAPTED_SECONDS = 400_000, 120.0
"""Budget of the meshes that follow the question."""

CARRIER = 5.0
"""Cells of the mesh that sizes of graded meshes are first given on, mm."""

KL_MODES = 6  # 80 % of the variance on the coarse mesh
LUCK = 3.0
TIE = 1.1
CANCELLED = 0.95
UNIT_EVERY = 15

# what makes a run tighter when it grows; the other knobs name the series
GROWING = ("order", "points", "level", "samples")


# %% Scenes, meshes, settings


@dataclass(frozen=True)
class Mesh:
    """Size (a name or mm), degree of the displacements, space of the active interfaces, and the size at the
    rims of interfaces where it is graded towards these (mm)."""

    size: str | float
    degree: int = 2
    space: Literal["points", "facets"] = "points"
    rims: float | None = None

    def __str__(self) -> str:
        size = self.size if isinstance(self.size, str) else f"{self.size:g} mm"
        if self.rims is not None:
            size += f", {self.rims:g} mm at rims"
        return f"{size}, degree {self.degree}, {self.space}"


@dataclass(frozen=True)
class Setting:
    """A method, its settings, and the mesh (None: the base mesh of the scene)."""

    method: Method
    knobs: Mapping[str, Any] = field(default_factory=dict)
    mesh: Mesh | None = None

    def __str__(self) -> str:
        return label(self.method, self.knobs)


def label(method: str, knobs: Mapping[str, Any]) -> str:
    """A setting in words."""
    words = {"order": "order", "points": "points per germ", "level": "level", "samples": "samples"}
    parts = [METHODS[method]]  # type: ignore[index]
    for key, value in knobs.items():
        if key in ("points", "samples"):
            parts.append(f"{value} {words[key]}")
        elif key == "rtol":
            parts.append(f"rtol {value:.0e}".replace("e-0", "e-"))
        elif key in ("index_set", "operator"):
            parts.append(str(value))
        else:
            parts.append(f"{words.get(key, key)} {value}")
    return ", ".join(parts)


@dataclass(frozen=True)
class Moments:
    """Mean and standard deviation of the quantity."""

    mean: float
    std: float

    def error(self, exact: Moments) -> float:
        """The larger relative difference from other moments."""
        return max(abs(self.mean / exact.mean - 1.0), abs(self.std / exact.std - 1.0))


@dataclass(frozen=True)
class Scene:
    """One scene and what is measured on it.

    Attributes
    ----------
    title, quantity
        In words, and the number of interest (N, of the modelled part).
    describe, build
        The scene on a mesh before assembly, whose time counts; the assembled problem, which is kept.
    base
        Where algebra, chaos and the other methods are compared; its direct solution is the unit.
    settings
        The grid of knobs, on the base mesh and on others.
    exact, check
        References on a mesh: a tight one, and one to compare it with.
    fine, coarser
        Mesh of the reference for the error in all, and the mesh to compare it with.
    moderate
        Reference on those two meshes: chaos and algebra far below the discretisation.
    times, options
        Of all runs.
    """

    title: str
    quantity: Resultant
    describe: Callable[[Mesh], Any]
    build: Callable[[Mesh], Problem]
    base: Mesh
    settings: Sequence[Setting]
    exact: Setting
    check: Setting
    fine: Mesh
    coarser: Mesh
    moderate: Setting
    times: tuple[float, ...] | None = None
    options: Options = Options(max_iterations=3000)

    @property
    def meshes(self) -> list[Mesh]:
        """All meshes on which settings are measured, the base first."""
        return list(dict.fromkeys([self.base, *(s.mesh for s in self.settings if s.mesh is not None)]))


_lap_shape = cache(lap_joint)


@cache
def _vessel_shape(size: str | float, rims: float | None) -> BoltedVessel:
    if rims is None:
        return bolted_vessel(size)
    return graded(bolted_vessel(CARRIER), rims, float(size))


def vessel_scene(mesh: Mesh) -> Any:
    """The bolted vessel with two random stiffnesses, meshed, not assembled."""
    demo = common.demo("bolted_vessel")
    return demo.vessel_scene(
        _vessel_shape(mesh.size, mesh.rims),
        LogNormal("screw", mean=0.5 * demo.SCREW, cov=demo.SCREW_COV),
        LogNormal("joint", mean=demo.JOINT, cov=demo.JOINT_COV),
        degree=mesh.degree,
        space=mesh.space,
    )


@cache
def vessel(mesh: Mesh) -> Problem:
    """The same assembled."""
    return assemble(vessel_scene(mesh))


@cache
def field_joint(mesh: Mesh) -> Problem:
    """The same parts and matrices, a joint whose stiffness varies from place to place."""
    demo, problem = common.demo("bolted_vessel"), vessel(mesh)
    stiffness = RandomField(
        "joint",
        mean=demo.JOINT,
        cov=0.3,
        covariance="exponential",
        length=20.0,
        modes=KL_MODES,
        distribution="lognormal",
    )
    half = 0.5 * demo.SCREW
    screw = problem.interfaces["screw"].law.with_(normal=half, tangential=half)
    return problem.with_laws({"joint": Elastic(normal=stiffness, tangential=stiffness), "screw": screw})


def lap_scene(mesh: Mesh) -> Any:
    """The bolted lap joint, tightened and pulled, meshed, not assembled."""
    demo = common.demo("bolted_lap_joint")
    pull = demo.SHEAR * (demo.PULL, 0.0, 0.0)
    return demo.build_scene(_lap_shape(mesh.size), pull, degree=mesh.degree)


@cache
def lap(mesh: Mesh) -> Problem:
    """The same assembled, with random friction and bolts."""
    demo, problem = common.demo("bolted_lap_joint"), assemble(lap_scene(mesh))
    friction = LogNormal("friction", mean=demo.FRICTION, cov=0.15)
    bolt = LogNormal("bolt", mean=0.5 * demo.BOLT, cov=0.15)
    laws = {}
    for name, interface in problem.interfaces.items():
        if isinstance(interface.law, Contact):
            laws[name] = interface.law.with_(friction=friction)
        elif name in demo.CUTS:
            laws[name] = interface.law.with_(normal=bolt, tangential=bolt)
    return problem.with_laws(laws)


def grid(method: Method, mesh: Mesh | None = None, **knobs: Sequence[Any]) -> Iterator[Setting]:
    """All combinations of knobs."""
    for values in product(*knobs.values()):
        yield Setting(method, dict(zip(knobs, values, strict=True)), mesh)


def elastic_settings(
    quick: bool, orders: Sequence[int], tensor: Sequence[int], levels: Sequence[int]
) -> list[Setting]:
    """The grid of settings of a linear scene, on its base mesh."""
    rtols = (1e-1, 1e-2, 1e-4, 1e-7) if quick else (1e-1, 3e-2, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
    middle = orders[min(1, len(orders) - 1)]
    sampled = (1e-3, 1e-6) if not quick else (1e-4,)
    samples = (16, 128, 1024) if quick else (16, 64, 256, 1024, 4096)
    return [
        *grid("latin", order=orders, rtol=rtols),
        # one knob at a time from here on
        *grid("latin", order=(middle, orders[-1]), index_set=("hyperbolic",), rtol=(1e-2, 1e-4)),
        *(grid("latin", order=(1, 2), index_set=("tensor",), rtol=(1e-2, 1e-4)) if len(tensor) else ()),
        *grid("latin", order=(middle,), acceleration=(0, 2, 5, 20), rtol=(1e-2, 1e-4)),
        *grid("latin", order=(middle,), operator=("factored",), rtol=(1e-2, 1e-4)),
        *grid("single", order=(middle,), rtol=(1e-2, 1e-4, 1e-6)),
        *grid("latin2004", order=(1,), rtol=(1e-1,) if quick else (1e-1, 1e-2)),
        *grid("ssfem", order=orders, rtol=(1e-1, 1e-2, 1e-4) if quick else (1e-1, 1e-2, 1e-4, 1e-7)),
        *grid("tensor", points=tensor, rtol=sampled),
        *grid("sparse", level=levels, rtol=sampled),
        *grid("mc", samples=samples, rtol=(1e-3,)),
        *grid("qmc", samples=samples, rtol=(1e-4,)),
    ]


def scenes(quick: bool = False) -> dict[str, Scene]:
    """The three scenes by name."""
    base = Mesh("coarse" if quick else "paper")
    fine, coarser = Mesh("paper", 3), Mesh("coarse", 3)
    if not quick:  # uniform meshes have 1.4e-3 left with 210 000 unknowns
        fine, coarser = (Mesh(12.0, 3, rims=each) for each in (1.6, 2.4))
    others = [Mesh("coarse", 1), Mesh("coarse", 2, "facets")]
    if not quick:
        others += [Mesh("coarse"), Mesh(18.0), Mesh("coarse", 3), Mesh("paper", 1)]
        others += [Mesh("paper", 2, "facets"), Mesh(6.2), Mesh("paper", 3)]
    by_hand = [] if quick else [Mesh(12.0, 3, rims=3.0), coarser]
    pairs = ((1, 1e-1), (2, 1e-2), (3, 1e-4))
    joint = Resultant("joint")
    made = {
        "vessel": Scene(
            "bolted vessel, two random stiffnesses",
            joint,
            vessel_scene,
            vessel,
            base,
            [
                *elastic_settings(quick, range(1, 4 if quick else 6), range(2, 5 if quick else 7), (1, 2, 3)),
                *(Setting("latin", {"order": p, "rtol": r}, m) for m in others for p, r in pairs),
                *(Setting("latin", {"order": 3, "rtol": 1e-4}, m) for m in by_hand),
            ],
            Setting("latin", {"order": 8, "rtol": 1e-11}),
            Setting("tensor", {"points": 12, "rtol": 1e-10}),
            fine,
            coarser,
            Setting("latin", {"order": 3, "rtol": 1e-6, "operator": "factored"}),
        ),
        "lap": Scene(
            "bolted lap joint, contact and friction",
            Resultant("plates", component=1),
            lap_scene,
            lap,
            Mesh("coarse", 2, "facets"),
            lap_settings(quick),
            Setting("tensor", {"points": 12 if quick else 20, "rtol": 1e-8}),
            Setting("tensor", {"points": 8 if quick else 16, "rtol": 1e-8}),
            # meshes of contact converge slowly: 4 mm and medium differ more than medium and coarse do
            Mesh("medium" if quick else 4.0, 3, "facets"),
            Mesh("coarse" if quick else "medium", 3, "facets"),
            Setting("tensor", {"points": 3, "rtol": 1e-6}),
            (1.0, 2.0),
            # as in the demo: Newton's dense steps do not pay in a sweep
            Options(newton=0, max_iterations=3000),
        ),
        "field": Scene(
            f"random field, {KL_MODES} Karhunen-Loeve modes",
            joint,
            vessel_scene,
            field_joint,
            base,
            [
                *elastic_settings(quick, (1, 2) if quick else (1, 2, 3), (), (1, 2) if quick else (1, 2, 3)),
                # the deviation is 5 % of the mean: a tolerance on the whole must be that much smaller
                *(
                    Setting("latin", {"order": p, "rtol": r}, m)
                    for m in others
                    for p, r in ((1, 1e-4), (2, 1e-5))
                ),
                *(Setting("latin", {"order": 2, "rtol": 1e-5}, m) for m in by_hand),
            ],
            Setting("latin", {"order": 3 if quick else 4, "rtol": 1e-11}),
            Setting("sparse", {"level": 3 if quick else 4, "rtol": 1e-10}),
            fine,
            coarser,
            Setting("latin", {"order": 2, "rtol": 1e-6, "operator": "factored"}),
        ),
    }
    return {name: replace(scene, settings=_once(scene.settings)) for name, scene in made.items()}


def _once(settings: Sequence[Setting]) -> list[Setting]:
    """Without what a grid has twice."""
    return list({(str(s), s.mesh): s for s in settings}.values())


def lap_settings(quick: bool) -> list[Setting]:
    """The grid of settings of the scene with contact and friction."""
    rtols = (1e-1, 1e-2, 1e-3) if quick else (3e-1, 1e-1, 3e-2, 1e-2, 1e-3, 1e-4, 1e-5)
    meshes = [Mesh("coarse", 3, "facets")] if quick else []
    if not quick:
        meshes = [Mesh(10.0, 2, "facets"), Mesh("coarse", 3, "facets"), Mesh("medium", 2, "facets")]
    samples = (16, 64) if quick else (16, 64, 256)
    sampled = (1e-2, 1e-4) if quick else (1e-2, 1e-3, 1e-4, 1e-5)
    return [
        *grid("latin", order=(1, 2) if quick else (1, 2, 3), rtol=rtols),
        *grid("latin", order=(2,), acceleration=(0, 5, 20), rtol=(1e-2, 1e-3)),
        *grid("latin", order=(2,), newton=(1,), rtol=(1e-2, 1e-3)),
        *grid("single", order=(2,), rtol=(1e-2, 1e-3, 1e-4)),
        *grid("latin", order=(2,), operator=("factored",), rtol=(1e-2,)),
        *grid("tensor", points=(2, 3, 4) if quick else (2, 3, 4, 6), rtol=sampled),
        *grid("tensor", points=(3,), snapshots=(1, 15), rtol=sampled[1:2]),
        *grid("sparse", level=(1, 2) if quick else (1, 2, 3), rtol=sampled[1:3]),
        *grid("mc", samples=samples, rtol=(1e-2,)),
        *grid("qmc", samples=samples, rtol=(1e-3,)),
        *(s for m in meshes for s in grid("tensor", m, points=(3,), rtol=(1e-2,) if quick else (1e-2, 1e-4))),
    ]


# %% One run


@dataclass(frozen=True)
class Answer:
    """What a run gives."""

    moments: Moments
    status: str
    iterations: int


def of_chaos(scene: Scene, problem: Problem, found: Any) -> Moments:
    """Moments from the chaos coefficients ([T,] m, components, P + 1) of an answer, at the last time."""
    name = scene.quantity.interface
    of_force = scene.quantity.of == "force"
    field = found.force_coefficients(name) if of_force else found.jump_coefficients(name)
    weights = problem.interfaces[name].weights
    modes = scene.quantity.total(np.moveaxis(field, -1, 0), weights)
    modes = modes.reshape(len(modes), -1)[:, -1]
    return Moments(float(modes[0]), float(np.sqrt(np.sum(modes[1:] ** 2))))


def of_samples(scene: Scene, result: SampleResult) -> Moments:
    """Moments of samples."""
    return Moments(*result.mean_std(scene.quantity))


def run(scene: Scene, setting: Setting, problem: Problem, seed: int = 0) -> Answer:
    """Run a setting: from the matrices of the parts to mean and standard deviation."""
    knobs, method = dict(setting.knobs), setting.method
    rtol = knobs.pop("rtol")
    if method in ("latin", "single", "latin2004", "ssfem"):
        about = {k: knobs.pop(k) for k in ("index_set", "q") if k in knobs}
        chaos = Chaos(knobs.pop("order"), check_points=0, **about)
        if method == "ssfem":
            found = reference.ssfem(problem, chaos, rtol=rtol)
            status = "converged" if found.converged else "max_iterations"
            return Answer(of_chaos(scene, problem, found), status, found.iterations)
        options = scene.options.with_(rtol=rtol)
        if method == "single":
            options = options.with_(precision="single")
        if method == "latin2004":
            options = Options.plain(rtol=rtol, operator="factored")
        result = solve(
            problem,
            "latin" if method == "latin2004" else "auto",
            chaos=chaos,
            times=scene.times,
            options=options.with_(**knobs),
        )
        return Answer(of_chaos(scene, problem, result), result.status, result.iterations)
    samplers = {
        "tensor": lambda **how: tensor_quadrature(problem, knobs.pop("points"), **how),
        "sparse": lambda **how: sparse_quadrature(problem, knobs.pop("level"), **how),
        "mc": lambda **how: monte_carlo(problem, knobs.pop("samples"), seed, **how),
        "qmc": lambda **how: quasi_monte_carlo(problem, knobs.pop("samples"), seed, **how),
    }
    others = {k: knobs.pop(k) for k in ("snapshots", "together", "acceleration") if k in knobs}
    drawn = samplers[method](
        options=scene.options.with_(rtol=rtol, **others), times=scene.times, progress=False
    )
    status = "converged" if drawn.converged else "not converged"
    return Answer(of_samples(scene, drawn), status, int(drawn.iterations.sum()))


# %% Measuring a scene


def nominal(problem: Problem) -> Problem:
    """The problem of the unit: means for random values, springs for contacts."""
    return contact.with_springs(problem)


def exact_moments(scene: Scene, tight: Setting, check: Setting) -> dict[str, Any]:
    """Moments of a tight setting, with their difference from another one."""
    made, other = (run(scene, s, scene.build(s.mesh or scene.base)) for s in (tight, check))
    return {
        "mean": made.moments.mean,
        "std": made.moments.std,
        "how": f"{tight} on {tight.mesh or scene.base}",
        "compared": f"{check} on {check.mesh or scene.base}",
        "own_error": made.moments.error(other.moments),
        "status": [made.status, other.status],
    }


def _moments(made: Mapping[str, Any]) -> Moments:
    return Moments(made["mean"], made["std"])


def measure(
    scene: Scene,
    repeats: int = 3,
    seeds: int = SEEDS,
    in_all: bool = True,
    asked: Sequence[float] = (),
    followed: Sequence[float] = (),
    say: Callable[[str], None] = print,
) -> dict[str, Any]:
    """The record of a scene.

    Parameters
    ----------
    in_all
        Whether a fine mesh is solved, too.
    asked
        Accuracies that ``solve(accuracy=...)`` is asked for.
    followed
        Those that it is asked for in all, with meshes that follow the question.
    """
    meshes: dict[Mesh, dict[str, Any]] = {}
    for mesh in scene.meshes:
        problem = scene.build(mesh)
        described = scene.describe(mesh)
        seconds = common.timed(partial(assemble, described), repeats, 2.0).seconds
        about = {"name": str(mesh), "degree": mesh.degree, "space": mesh.space}
        meshes[mesh] = {**about, "dof": problem.size, "assembly_s": seconds}
    problem = scene.build(scene.base)
    linear = nominal(problem)
    units = [common.unit(linear, repeats)]
    say(f"{scene.title}: {problem.size} unknowns, a unit is {units[0].seconds:.3f} s")
    same = exact_moments(scene, scene.exact, scene.check)
    references = {"same": same}
    say(f"  reference: {same['mean']:.6g} +- {same['std']:.6g}, own error {same['own_error']:.1e}")
    if in_all:
        references["all"] = exact_moments(
            scene, replace(scene.moderate, mesh=scene.fine), replace(scene.moderate, mesh=scene.coarser)
        )
        fine = references["all"]
        say(f"  fine mesh: {fine['mean']:.6g} +- {fine['std']:.6g}, own error {fine['own_error']:.1e}")
    runs, chosen = [], []
    for number, setting in enumerate(scene.settings):
        if number % UNIT_EVERY == UNIT_EVERY - 1:  # a machine is not equally fast all the time
            units.append(measure_unit(linear, 1))
        row = one(scene, setting, references, repeats, seeds)
        runs.append(finish(row, meshes[setting.mesh or scene.base], units[-1].seconds))
        say(_line(row))
    for wanted, of_meshes in product(asked, (False, True) if in_all else (False,)):
        row = automatic(scene, wanted, of_meshes, references, repeats)
        chosen.append(finish(row, meshes[scene.base], units[-1].seconds))
        say(f"  asked for {percent(wanted)}:{_line(row)}")
    seconds = float(np.median([each.seconds for each in units]))
    for row in (*runs, *chosen):
        finish(row, next(m for m in meshes.values() if m["name"] == row["mesh"]), seconds)
    record: dict[str, Any] = {
        "title": scene.title,
        "quantity": str(scene.quantity),
        "base": str(scene.base),
        "unit_s": seconds,
        "unit_range": [min(u.seconds for u in units), max(u.seconds for u in units)],
        "unit_solver": units[0].solver,
        "meshes": list(meshes.values()),
        "references": references,
        "runs": runs,
        "accuracy": chosen,
    }
    mark_luck(record)
    record["in_all"] = []
    for wanted in followed if in_all else ():
        row = adapted(scene, wanted, references, record)
        record["in_all"].append(row)
        over = "" if row["over_best"] is None else f", {row['over_best']:.1f} over the best by hand"
        say(
            f"  in all {percent(wanted)}: true {row['true']:.1e}, said {row['said']:.1e}, "
            f"reached {row['reached']}, {row['units']:.1f} units, {row['unknowns']} unknowns{over}"
        )
    return record


def finish(row: dict[str, Any], mesh: Mapping[str, Any], unit_s: float) -> dict[str, Any]:
    """Add the mesh and the units."""
    row["mesh"] = mesh["name"]
    row["units"] = row["seconds"] / unit_s
    row["units_all"] = (row["seconds"] + mesh["assembly_s"]) / unit_s
    return row


def one(
    scene: Scene, setting: Setting, references: Mapping[str, Any], repeats: int, seeds: int
) -> dict[str, Any]:
    """One setting: its answers, errors and seconds."""
    problem = scene.build(setting.mesh or scene.base)
    drawn = setting.method in ("mc", "qmc")
    timed = [
        # a first run of some milliseconds is not like the others
        common.timed(partial(run, scene, setting, problem, seed + 1), 1 if drawn else repeats, 1.0)
        for seed in range(seeds if drawn else 1)
    ]
    answers = [each.value for each in timed]
    on_base = setting.mesh is None or setting.mesh == scene.base
    return {
        "method": setting.method,
        "knobs": dict(setting.knobs),
        "label": str(setting),
        "status": worst([each.status for each in answers]),
        "iterations": answers[0].iterations,
        "seconds": float(np.median([each.seconds for each in timed])),
        **errors([each.moments for each in answers], references, on_base),
    }


def worst(statuses: Iterable[str]) -> str:
    """The first status that is not converged."""
    return next((s for s in statuses if s != "converged"), "converged")


def errors(found: Sequence[Moments], references: Mapping[str, Any], on_base: bool) -> dict[str, Any]:
    """Moments and their errors; of several runs the root mean square."""

    def rms(exact: Mapping[str, Any]) -> float:
        return float(np.sqrt(np.mean([m.error(_moments(exact)) ** 2 for m in found])))

    return {
        "mean": found[0].mean,
        "std": found[0].std,
        "error": rms(references["same"]) if on_base else None,
        "error_all": rms(references["all"]) if "all" in references else None,
    }


def automatic(
    scene: Scene, accuracy: float, meshes: bool, references: Mapping[str, Any], repeats: int
) -> dict[str, Any]:
    """What ``solve(accuracy=...)`` chooses, what it costs and how good it is.

    With `meshes` it stops where the error of the mesh hides the rest, and its error in all counts; without,
    that on the same mesh.
    """
    problem = scene.build(scene.base)
    timed = common.timed(
        lambda: solve(
            problem, accuracy=accuracy, quantity=scene.quantity, times=scene.times, meshes=meshes
        ),
        repeats,
        1.0,
    )
    result = timed.value
    knobs: dict[str, Any] = {"rtol": result.plan.options.rtol}
    if isinstance(result, SampleResult):
        by_rule = result.weights is not None
        found, method = of_samples(scene, result), "tensor" if by_rule else "qmc"
        status = "converged" if result.converged else "not converged"
        count = len(result.germs)
        if by_rule:
            knobs["points"] = round(count ** (1.0 / result.germs.shape[1]))
        else:
            knobs["samples"] = count
        iterations = int(result.iterations.sum())
    else:
        found, method = of_chaos(scene, problem, result), "latin"
        status, iterations = result.status, result.iterations
        knobs |= {"order": result.chaos.order, "modes": result.modes}
    estimate = result.errors()
    row = {
        "asked": accuracy,
        "meshes": meshes,
        "method": "accuracy",
        "knobs": knobs,
        "label": label(method, knobs),
        "status": status,
        "iterations": iterations,
        "seconds": timed.seconds,
        "estimated": estimate.total,
        "dominating": estimate.dominating,
        **errors([found], references, on_base=True),
    }
    return row | {"error": None} if meshes else row | {"error_all": None}


def uncertain(scene: Scene, mesh: Mesh) -> Any:
    """The scene on a mesh with its random laws, before assembly."""
    described = scene.describe(mesh)
    for name, interface in scene.build(mesh).interfaces.items():
        described.interfaces[name] = replace(described.interfaces[name], law=interface.law)
    return described


def adapted(
    scene: Scene, accuracy: float, references: Mapping[str, Any], record: Mapping[str, Any]
) -> dict[str, Any]:
    """What ``solve(scene, accuracy=...)`` makes of the coarsest mesh: meshes, chaos and iteration together.

    `true` is against the fine mesh, whose own error is ``references["all"]["own_error"]``; `units` have
    assembly, meshing and estimates; `over_best` is the cost over that of the cheapest mesh and setting by
    hand whose error in all is as small (None: there is none).
    """
    mesh = replace(scene.base, size="coarse")
    described = uncertain(scene, mesh)
    timed = common.timed(
        lambda: solve(
            described,
            accuracy=accuracy,
            quantity=scene.quantity,
            times=scene.times,
            max_unknowns=ADAPTED_UNKNOWNS,
            max_seconds=ADAPTED_SECONDS,
        ),
        1,
        1.0,
    )
    made = timed.value.errors()
    found = Moments(made.moments.mean, made.moments.std or 0.0)
    units = timed.seconds / record["unit_s"]
    best = cheapest(usable(record, in_all=True), accuracy, in_all=True)
    return {
        "asked": accuracy,
        "true": found.error(_moments(references["all"])),
        "said": made.in_all,
        "reached": bool(made.reached),
        "units": units,
        "over_best": None if best is None else units / best["units_all"],
        "mean": found.mean,
        "std": found.std,
        "unknowns": timed.value.problem.size,
        "steps": [str(step) for step in made.steps],
        "notes": list(made.notes),
    }


def _line(row: Mapping[str, Any]) -> str:
    shown = " ".join(
        f"{key} {row[key]:.1e}" for key in ("error", "error_all") if row[key] is not None
    )
    note = "" if row["status"] == "converged" else f" ({row['status']})"
    return f"  {row['units']:8.2f} units  {shown}  {row['label']} on {row['mesh']}{note}"


# %% Fronts


def tighter(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Whether b belongs to the series of a, and no setting of b is looser than that of a."""
    if (a["method"], a["mesh"]) != (b["method"], b["mesh"]):
        return False
    ours, theirs = dict(a["knobs"]), dict(b["knobs"])
    if ours.pop("rtol") < theirs.pop("rtol"):
        return False
    for key in GROWING:
        if key in ours and ours.pop(key) > theirs.pop(key):
            return False
    return ours == theirs


def mark_luck(record: dict[str, Any]) -> None:
    """Mark errors that are small by chance, see the head of this file."""
    for key, luck, which in (("error", "lucky", "same"), ("error_all", "lucky_all", "all")):
        if which not in record["references"]:
            continue
        floor = max(record["references"][which]["own_error"], 1e-9)
        rows = [r for r in record["runs"] if r[key] is not None]
        for row in rows:
            most = max(other[key] for other in rows if tighter(row, other))
            row[luck] = bool(most > LUCK * max(row[key], floor))
            if key == "error_all":
                # an error of the mesh that one of the chaos happens to cancel
                best = min((r for r in rows if r["mesh"] == row["mesh"]), key=_looseness)
                row[luck] |= bool(row[key] < CANCELLED * best[key])


def _looseness(row: Mapping[str, Any]) -> tuple[float, ...]:
    """Smallest for the run whose error is almost only that of the mesh."""
    if row["error"] is not None:
        return (row["error"],)
    return (row["knobs"]["rtol"], -max(row["knobs"].get(key, 0) for key in GROWING))


def usable(record: Mapping[str, Any], in_all: bool) -> list[dict[str, Any]]:
    """Runs that count for the front: converged, measured, not lucky."""
    key, luck = ("error_all", "lucky_all") if in_all else ("error", "lucky")
    return [
        r for r in record["runs"] if r[key] is not None and r["status"] == "converged" and not r[luck]
    ]


def cheapest(
    rows: Iterable[Mapping[str, Any]], level: float, in_all: bool = False, methods: Sequence[str] = ()
) -> Mapping[str, Any] | None:
    """The run of least cost whose error is at most `level`; the best of those that cost as much."""
    error, cost = ("error_all", "units_all") if in_all else ("error", "units")
    good = [r for r in rows if r[error] <= level and (not methods or r["method"] in methods)]
    if not good:
        return None
    least = min(float(r[cost]) for r in good)
    return min((r for r in good if r[cost] <= TIE * least), key=lambda r: float(r[error]))


def panels(scene: Mapping[str, Any]) -> list[FrontPanel]:
    """Pictures of a scene: errors on the same mesh, total errors."""
    row = []
    for in_all in (False, True):
        error, cost = ("error_all", "units_all") if in_all else ("error", "units")
        made = scene["references"].get("all" if in_all else "same")
        if made is None:
            continue
        good = {id(r) for r in usable(scene, in_all)}
        points, front = {}, {}
        for method, name in METHODS.items():
            mine = [r for r in scene["runs"] if r["method"] == method and r[error] is not None]
            if mine:
                points[name] = np.array([[r[cost], r[error]] for r in mine])
                front[name] = np.array([id(r) in good for r in mine])
        row.append(
            FrontPanel(
                scene["title"],
                "cost with assembly (units)" if in_all else "cost (units)",
                "relative error, in all" if in_all else "relative error, same mesh",
                points,
                front,
                np.array([[r[cost], r[error]] for r in scene["accuracy"] if r[error] is not None]),
                max(made["own_error"], 1e-10),
            )
        )
    return row


def figure(record: Mapping[str, Any], folder: Path) -> list[Path]:
    """Error against cost, a figure for each scene: ``tradeoff_NAME.png``."""
    label = "chosen by solve(accuracy=...)"
    return [
        front_figure([panels(scene)], folder / f"tradeoff_{name}.png", marked_label=label)
        for name, scene in record["scenes"].items()
    ]


# %% Tables and the page

GROUPS: dict[str, tuple[str, ...]] = {
    "LATIN-PCE": ("latin", "single", "latin2004"),
    "SSFEM": ("ssfem",),
    "quadrature": ("tensor", "sparse"),
    "(quasi-)Monte Carlo": ("mc", "qmc"),
}


def percent(level: float) -> str:
    """An accuracy as a user says it."""
    return f"{100.0 * level:g} %"


def table_same(scene: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """For each accuracy: what to use on this mesh, and what it costs."""
    header = ["accuracy", "use", "error", "units", "seconds"]
    rows = []
    good = usable(scene, in_all=False)
    for level in LEVELS:
        best = cheapest(good, level)
        cells = ["not reached", "-", "-", "-"]
        if best is not None:
            cells = [best["label"], f"{best['error']:.0e}", f"{best['units']:.2f}", f"{best['seconds']:.3f}"]
        rows.append([percent(level), *cells])
    return header, rows


def table_methods(scene: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """For each accuracy: units of the cheapest setting of each method, and of what accuracy= chose."""
    header = ["units for", *GROUPS, "accuracy=", "its error", "over the front"]
    rows = []
    good = usable(scene, in_all=False)
    for level in LEVELS:
        cells = []
        for methods in GROUPS.values():
            best = cheapest(good, level, methods=methods)
            cells.append("-" if best is None else f"{best['units']:.2f}")
        chosen = _chosen(scene, level, meshes=False)
        least = min((float(r["units"]) for r in good if r["error"] <= level), default=None)
        cells += ["-", "-"] if chosen is None else [f"{chosen['units']:.2f}", f"{chosen['error']:.0e}"]
        over = None if chosen is None or least is None else chosen["units"] / least
        cells.append("-" if over is None else f"{over:.1f}")
        rows.append([percent(level), *cells])
    return header, rows


def _chosen(scene: Mapping[str, Any], level: float, meshes: bool) -> Mapping[str, Any] | None:
    """What accuracy= did on request of a level."""
    return next((r for r in scene["accuracy"] if (r["asked"], r["meshes"]) == (level, meshes)), None)


def table_knobs(scene: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """The settings that are changed one at a time, around the one that most runs share."""
    galerkin = [
        r
        for r in scene["runs"]
        if r["method"] in ("latin", "single") and r["error"] is not None
    ]
    groups: dict[tuple[int, float], list[Mapping[str, Any]]] = {}
    for r in galerkin:
        groups.setdefault((r["knobs"]["order"], r["knobs"]["rtol"]), []).append(r)
    about = max(groups.values(), key=len, default=[])
    # ties: the tighter one
    tied = [g for g in groups.values() if len(g) == len(about)]
    about = min(tied, key=lambda g: float(g[0]["knobs"]["rtol"]), default=[])
    return (
        ["setting", "iterations", "units", "error", "status"],
        [
            [r["label"], str(r["iterations"]), f"{r['units']:.2f}", f"{r['error']:.0e}", r["status"]]
            for r in about
        ],
    )


def table_meshes(scene: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Effect of size, degree and space: the tightest run on each mesh."""
    rows = []
    for mesh in sorted(scene["meshes"], key=lambda m: float(m["dof"])):
        runs = [r for r in scene["runs"] if r["mesh"] == mesh["name"] and r["error_all"] is not None]
        if runs:
            best = min(runs, key=_looseness)
            cells = [f"{best['error_all']:.1e}", f"{best['units_all']:.1f}", f"{mesh['assembly_s']:.2f}"]
            rows.append([mesh["name"], str(mesh["dof"]), best["label"], *cells])
    return ["mesh", "unknowns", "setting", "error in all", "units", "assembly, seconds"], rows


def table_all(scene: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """For each accuracy in all: mesh, degree and setting."""
    header = ["in all", "mesh", "use", "error", "units", "seconds", "`accuracy=` on the base mesh"]
    rows = []
    good = usable(scene, in_all=True)
    for level in LEVELS:
        best = cheapest(good, level, in_all=True)
        cells = ["-", "not reached", "-", "-", "-"]
        if best is not None:
            seconds = best["units_all"] * scene["unit_s"]
            cells = [best["mesh"], best["label"], f"{best['error_all']:.1e}"]
            cells += [f"{best['units_all']:.1f}", f"{seconds:.2f}"]
        chosen = _chosen(scene, level, meshes=True)
        if chosen is not None:
            decides = f"{chosen['dominating']} decides"
            cells.append(f"{chosen['error_all']:.1e} for {chosen['units_all']:.1f}, {decides}")
        rows.append([percent(level), *cells, *(["-"] if chosen is None else [])])
    return header, rows


EMPTY = "## Reading the front\n\n<!-- front: begin -->\n<!-- front: end -->\n"


INTRODUCTION = """![Bolted vessel]({figures}/tradeoff_vessel.png)

![Bolted lap joint]({figures}/tradeoff_lap.png)

![Random field]({figures}/tradeoff_field.png)

Each point is one choice of settings. Its cost is that of computing the mean and the standard deviation of
one number; its error is the larger of their true relative errors. The line is the front: the best that can
be had for a given cost. A setting above the line or to its right wastes work. Stars are the settings that
`solve(problem, accuracy=...)` chose.

Two errors are shown separately. On the left is the error on the same mesh, against a much tighter
solution; it depends on tolerance, chaos and method. On the right is the total error, against a much
finer mesh. There the front becomes flat where the error of the mesh dominates; from that point on, tighter
tolerances and higher orders gain nothing.

So begin on the right and choose the mesh whose error is small enough. Then find the same error on the
left (a third of it, if the sum of both must stay below the limit), and read the setting from the table.

A *unit* is one direct solution of the base mesh in the same run. Costs on the left do not include
the assembly of the parts' matrices; those on the right include assembly and pairing. Some errors
are small by chance (a tighter setting of the same series is over three times worse, or errors of chaos and
mesh cancel); they are drawn small, and are left out of the front and of the tables. Errors of Monte Carlo
are root mean squares over several seeds. In the grey band errors cannot be distinguished from the error of
the reference. If several settings cost the same to within 10 %, the tables name the most accurate one.
"""


def section(record: Mapping[str, Any], figures: str = "figures") -> str:
    """The part of the page on the front; ``figures``: their folder as seen from the page."""
    e = record["environment"]
    quick = " (`--quick`: coarse meshes, few settings)" if record["quick"] else ""
    text = [
        f"Made by `./run bench tradeoff --json FILE --markdown benchmarks/measured/tradeoff.md`{quick} on",
        f"{e['processor']}, {e['threads']} thread(s), load {e['load']:.1f} at the end.",
        "",
        INTRODUCTION.format(figures=figures),
    ]
    for scene in record["scenes"].values():
        same = scene["references"]["same"]
        base = next(m for m in scene["meshes"] if m["name"] == scene["base"])
        text += [
            f"### {_sentence(scene['title'])}",
            "",
            f"{_sentence(scene['quantity'])}: {same['mean']:.6g} N, standard deviation {same['std']:.5g} N,",
            f"on {scene['base']} ({base['dof']} unknowns; a unit is {scene['unit_s']:.3f} s). Reference:",
            f"{same['how']}; it differs by {same['own_error']:.0e} from",
            f"{same['compared']}.",
            "",
            common.markdown_table(*table_same(scene)),
            "",
            "The least cost of each method (`-`: not reached by any setting that was tried), and the cost of",
            "what `accuracy=` chose, its true error, and its cost divided by the least one:",
            "",
            common.markdown_table(*table_methods(scene)),
            "",
            "One setting changed at a time:",
            "",
            common.markdown_table(*table_knobs(scene)),
            "",
        ]
        made = scene["references"].get("all")
        if made is not None:
            text += [
                f"Total error, against {made['how']} ({made['mean']:.6g} N, {made['std']:.5g} N), which",
                f"differs by {made['own_error']:.0e} from {made['compared']}; units and seconds with",
                "assembly:",
                "",
                common.markdown_table(*table_all(scene)),
                "",
                "Size, degree and interface space; for each mesh the run with the tightest settings:",
                "",
                common.markdown_table(*table_meshes(scene)),
                "",
            ]
    return "\n".join(text).rstrip()


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def write_page(record: Mapping[str, Any], page: Path, figures: Path | None = None) -> None:
    """Put the section into the page, which is made if it is not there; the figures go beside it, or there."""
    figures = page.parent / "figures" if figures is None else figures
    text = page.read_text(encoding="utf-8") if page.exists() else "# Accuracy\n"
    if "<!-- front: begin -->" not in text:
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(f"{text.rstrip()}\n\n{EMPTY}", encoding="utf-8")
    shown = os.path.relpath(figures, page.parent)
    common.between_marks(page, "front", section(record, shown))
    drawn = figure(record, figures)
    print(f"written to {page} and {', '.join(map(str, drawn))}")


def report(record: Mapping[str, Any]) -> None:
    """Short tables."""
    for scene in record["scenes"].values():
        print(f"\n{scene['title']}: {scene['quantity']}, base mesh {scene['base']}")
        common.table(*table_same(scene))
        print()
        common.table(*table_methods(scene))
        if "all" in scene["references"]:
            print("\nwith the error of the mesh and the time of assembly")
            common.table(*table_all(scene))


def measure_all(
    quick: bool, names: Sequence[str] | None = None, repeats: int = 3, say: Callable[[str], None] = print
) -> dict[str, Any]:
    """The record of all scenes, or of those that are named."""
    # the quick references know the error in all to 0.2 %
    followed = LEVELS[:2] if quick else LEVELS
    record: dict[str, Any] = {"benchmark": "tradeoff", "quick": quick, "scenes": {}}
    for name, scene in scenes(quick).items():
        if not names or name in names:
            record["scenes"][name] = measure(scene, repeats, asked=LEVELS, followed=followed, say=say)
    return record | {"environment": common.environment()}


def main() -> None:
    """Measure, or read a record; then print and write."""
    about = "Speed against accuracy on three scenes, and the Pareto front."
    parser: argparse.ArgumentParser = common.parser("tradeoff", about)
    parser.add_argument("--quick", action="store_true", help="coarse meshes, few settings")
    parser.add_argument("--scenes", nargs="+", choices=("vessel", "lap", "field"), help="only these")
    parser.add_argument("--read", type=Path, help="take this record instead of measuring")
    parser.add_argument("--markdown", type=Path, help="page whose part on the front is written")
    parser.add_argument("--figures", type=Path, default=common.FIGURES, help="folder of its figures")
    options = parser.parse_args()
    if options.read is not None:
        record: dict[str, Any] = json.loads(options.read.read_text(encoding="utf-8"))
    else:
        record = measure_all(options.quick, options.scenes, options.repeats, partial(print, flush=True))
    report(record)
    common.write_json(record, options.json)
    if options.markdown is not None:
        write_page(record, options.markdown, options.figures)


if __name__ == "__main__":
    main()
