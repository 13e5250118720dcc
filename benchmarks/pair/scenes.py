"""The scenes of ``./run bench pair``: what is measured, what number is read, what is counted.

Only the public interface of the library is used, and what stands in the demos of the same commit: older and
newer commits run the same scenes. A bench is a function that builds its scene (not measured) and returns what
is measured and how its answer is read::

    @bench()
    def slab() -> Prepared:
        problem = ...
        return Prepared(lambda: lf.solve(problem), lambda answer: outcome(value, answer))
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_frontend as lf

PLACE = 10.0
"""Error of a force or an extreme over that of the energy norm in which answers tell theirs."""
STEEL, ALUMINIUM = lf.LinearElastic(E=200e3, nu=0.3), lf.LinearElastic(E=70e3, nu=0.3)  # MPa
QUIET: dict[str, Any] = {"progress": False}


@dataclass(frozen=True)
class Prepared:
    """``run`` is measured; ``read`` makes ``{"number", "error", "counts"}`` of what it returned."""

    run: Callable[[], Any]
    read: Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class Bench:
    """``usual``: of the default sample."""

    name: str
    function: Callable[[], Prepared]
    usual: bool


BENCHES: dict[str, Bench] = {}


def bench(usual: bool = True) -> Callable[[Callable[[], Prepared]], Callable[[], Prepared]]:
    """Enters a function into ``BENCHES``."""

    def enter(function: Callable[[], Prepared]) -> Callable[[], Prepared]:
        name = function.__name__
        BENCHES[name] = Bench(name, function, usual)
        return function

    return enter


# --- what is read ----------------------------------------------------------------------------------


def counts(answer: Any) -> dict[str, float]:
    """What the solver did, as far as an answer tells it: sums over points and bodies."""
    found: dict[str, Any] = {}
    points = getattr(answer, "points", None)
    for name in ("iterations", "modes"):
        if hasattr(answer, name):
            found[name] = getattr(answer, name)
    if (summary := getattr(answer, "summary", None)) is not None:
        found |= {name: getattr(summary, name) for name in ("newton_steps", "restarts")}
    if hasattr(answer, "germs"):
        found["points"] = len(answer.germs)
    elif points is not None and hasattr(points, "order"):
        found["points"] = len(points.order)
    if (solver := getattr(answer, "solver", None)) is not None:
        costs = solver.costs
        found["factorisations"] = sum(not each["kept"] for each in costs)
        found["factor_numbers"] = sum(each["factor_numbers"] for each in costs)
        found["dense_numbers"] = sum(each["dense_numbers"] for each in costs)
        found["active_unknowns"] = solver.active_unknowns
    return {name: float(np.sum(value)) for name, value in found.items()}


def outcome(number: float, answer: Any, error: float | None = None) -> dict[str, Any]:
    """A number of an answer; its error (relative) is PLACE times what the answer says if none is given."""
    if error is None:
        said = getattr(answer, "error", math.nan) if not hasattr(answer, "points") else math.nan
        error = PLACE * float(np.max(said))
    return {"number": float(number), "error": error * abs(float(number)), "counts": counts(answer)}


def normal_force(problem: Any, answer: Any, interface: str) -> float:
    """Resultant of the normal forces on an interface, of a history at its end."""
    force = answer.force(interface)[..., 0]
    return float(np.ravel(force @ problem.interfaces[interface].weights)[-1])


# --- the bolted vessel -----------------------------------------------------------------------------


@cache
def vessel_demo() -> Any:
    """The demo, whose geometry and laws are taken."""
    import bolted_vessel

    return bolted_vessel


@cache
def vessel(size: str | float = "paper") -> Any:
    """The vessel with stiffnesses that are numbers."""
    return lf.assemble(vessel_demo().build_scene(size)[1])


@cache
def random_vessel(size: str | float = "paper") -> Any:
    """The vessel with two normal stiffnesses."""
    demo = vessel_demo()
    return lf.assemble(demo.random_scene(demo.build_scene(size)[0]))


def of_vessel(solve: Callable[[], Any], problem: Any) -> Prepared:
    """From the matrices to all displacements; read is the force of the joint."""

    def run() -> Any:
        answer = solve()
        answer.displacements  # noqa: B018  interior fields are computed when asked for
        return answer

    return Prepared(run, lambda answer: outcome(normal_force(problem, answer, "joint"), answer))


@bench()
def vessel_direct() -> Prepared:
    """Solved as planned, at once."""
    problem = vessel()
    return of_vessel(lambda: lf.solve(problem, **QUIET), problem)


@bench()
def vessel_accelerated() -> Prepared:
    """All interfaces are kept and iterated on."""
    problem, options = vessel(), lf.Options(rtol=1e-4, operator="factored")
    return of_vessel(lambda: lf.solve(problem, active="all", options=options, **QUIET), problem)


@bench()
def vessel_sweep() -> Prepared:
    """13 x 7 sets of two stiffnesses."""
    demo, problem, rtol = vessel_demo(), vessel(), 1e-6
    grid = demo.stiffnesses(demo.XI_SCREW, demo.XI_JOINT)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(float(answer.force("joint")[..., 0].max()), answer, PLACE * rtol)

    return Prepared(lambda: lf.sweep(problem, grid, options=lf.Options(rtol=rtol), **QUIET), read)


def vessel_chaos_of(size: str | float, options: Any) -> Prepared:
    """Chaos of order 3 with the modes of all displacements; read is the mean force of the joint."""
    problem = random_vessel(size)

    def run() -> Any:
        answer = lf.solve(problem, chaos=lf.Chaos(order=3, check_points=0), options=options, **QUIET)
        for part in problem.substructures:
            answer.coefficients(part)
        return answer

    def read(answer: Any) -> dict[str, Any]:
        mean, _ = answer.mean_std("joint")
        return outcome(float(np.ravel(mean)[-1]), answer)

    return Prepared(run, read)


@bench()
def vessel_chaos() -> Prepared:
    """By factors."""
    return vessel_chaos_of("paper", lf.Options(rtol=1e-8))


@bench()
def vessel_chaos_multigrid() -> Prepared:
    """Without factors."""
    return vessel_chaos_of("coarse", lf.Options(rtol=1e-5, backend="multigrid"))


def vessel_points(solve: Callable[[Any, Any], Any]) -> Prepared:
    """Points of the random vessel; read is the mean of the largest normal stress."""
    demo, problem, rtol = vessel_demo(), random_vessel(), 1e-6

    def read(answer: Any) -> dict[str, Any]:
        stress = answer.quantity(demo.largest_stress)
        # what the points differ by is larger than their mean, which is close to zero
        scale = abs(stress.mean().value) + stress.std().value
        return outcome(scale, answer, PLACE * rtol)

    return Prepared(lambda: solve(problem, lf.Options(rtol=rtol)), read)


@bench()
def vessel_quadrature() -> Prepared:
    """4 x 4 points of a Gauss rule."""
    return vessel_points(lambda problem, options: lf.tensor_quadrature(problem, 4, options=options, **QUIET))


@bench()
def vessel_monte_carlo() -> Prepared:
    """400 samples."""
    return vessel_points(
        lambda problem, options: lf.monte_carlo(problem, 400, seed=1, options=options, **QUIET)
    )


@bench()
def vessel_assembled() -> Prepared:
    """The matrices of the parts, from their meshes."""
    scene = vessel_demo().build_scene("paper")[1]

    def read(problem: Any) -> dict[str, Any]:
        return {"number": float(problem.size), "error": 0.0, "counts": {}}

    return Prepared(lambda: lf.assemble(scene), read)


@bench(usual=False)
def vessel_field() -> Prepared:
    """The modulus of the cylinder is a lognormal field; order 2."""
    field = lf.RandomField("E", 200e3, cov=0.2, length=60.0, modes=2, distribution="lognormal")
    problem = random_vessel().with_laws(values={"cylinder.E": field})
    options = lf.Options(rtol=1e-6)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(float(np.ravel(answer.mean_std("joint")[0])[-1]), answer)

    return Prepared(lambda: lf.solve(problem, chaos=lf.Chaos(order=2), options=options, **QUIET), read)


# --- contact ---------------------------------------------------------------------------------------


def blocks(cells: int, friction: Any, matching: bool) -> Any:
    """A block on a softer one, pressed (and sheared where it rubs); `cells` along 10 mm."""
    across = 2 * cells if matching else 2 * cells - 1
    upper = lf.geometry.box((20, 20, 10), (2 * cells, 2 * cells, cells), (0, 0, 20), cell="tetrahedron")
    lower = lf.geometry.box((20, 20, 20), (across, across, 2 * cells), cell="tetrahedron")
    scene = lf.Scene()
    scene.substructure("upper", upper, STEEL, degree=2)
    scene.substructure("lower", lower, ALUMINIUM, degree=2)
    law = lf.Contact(friction=friction or None)
    scene.interface("contact", "upper:z0", "lower:z1", law, space="facets")
    scene.fix("upper:z1", np.array([0.06 if friction else 0.0, 0.0, -0.05]))  # mm
    scene.fix("lower:z0")
    return lf.assemble(scene)


def of_contact(problem: Any, **settings: Any) -> Prepared:
    """Pressed as told; read is the force of the contact."""

    def run() -> Any:
        answer = lf.solve(problem, **settings, **QUIET)
        answer.displacements  # noqa: B018
        return answer

    return Prepared(run, lambda answer: outcome(normal_force(problem, answer, "contact"), answer))


@bench()
def contact_without_friction() -> Prepared:
    """Meshes that do not match."""
    return of_contact(blocks(3, 0.0, matching=False), options=lf.Options(rtol=1e-5, max_iterations=5000))


@bench()
def contact_with_friction() -> Prepared:
    """Meshes that match."""
    return of_contact(blocks(3, 0.3, matching=True), options=lf.Options(rtol=1e-5, max_iterations=5000))


@bench()
def contact_samples() -> Prepared:
    """64 samples of a random coefficient of friction."""
    rtol, problem = 1e-5, blocks(2, lf.Uniform("friction", 0.2, 0.4), matching=True)

    def read(answer: Any) -> dict[str, Any]:
        weights = problem.interfaces["contact"].weights
        force = answer.quantity(lambda fields: fields.force("contact")[..., 0] @ weights)
        return outcome(force.mean().value, answer, PLACE * rtol)

    return Prepared(
        lambda: lf.monte_carlo(problem, 64, seed=1, options=lf.Options(rtol=rtol), **QUIET), read
    )


@bench()
def friction_chain() -> Prepared:
    """16 cubes, pressed and bent; every fourth joint rubs and opens at its edges."""
    scene, edge = lf.Scene(), 20.0  # mm
    for k in range(16):
        part = lf.geometry.box((edge,) * 3, (2, 2, 2), origin=(k * edge, 0.0, 0.0), cell="hexahedron")
        scene.substructure(f"b{k}", part, lf.LinearElastic(E=100e3 * (1 + k // 4 % 2), nu=0.3), degree=2)
    for k in range(1, 16):
        contact = lf.Contact(friction=0.1, gap=lambda x: 2e-3 * ((x[:, 1] - 10.0) / 10.0) ** 2)  # mm
        law = lf.Perfect() if k % 4 else contact
        scene.interface(f"j{k}", f"b{k - 1}:x1", f"b{k}:x0", law, space="points" if k % 4 == 0 else "auto")
    scene.fix("b0:x0")
    scene.fix("b15:x1", np.array([-0.1, 0.0, 0.0]))
    problem, options = lf.assemble(scene), lf.Options(rtol=1e-5, max_iterations=5000)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(normal_force(problem, answer, "j8"), answer)

    return Prepared(lambda: lf.solve(problem, active="all", options=options, **QUIET), read)


@cache
def lap_demo() -> Any:
    """The bolted lap joint."""
    import bolted_lap_joint

    return bolted_lap_joint


@cache
def lap_problem() -> Any:
    """Tightened, then pulled."""
    from parts.lap_joint import lap_joint

    return lap_demo().study_problem(lap_joint("coarse"))


@bench()
def lap_history() -> Prepared:
    """Tightened, then pulled in four steps; five contacts with friction."""
    demo, problem = lap_demo(), lap_problem()
    options = lf.Options(rtol=1e-5, max_iterations=5000)
    times = (1.0, 1.25, 1.5, 1.75, 2.0)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(float(demo.load(problem, answer)[-1]), answer)

    return Prepared(lambda: lf.solve(problem, times=times, options=options, **QUIET), read)


@bench()
def lap_sets() -> Prepared:
    """27 sets of friction, shortening and stiffness of the bolts, two steps each."""
    demo, problem, rtol = lap_demo(), lap_problem(), 5e-5

    def read(answer: Any) -> dict[str, Any]:
        return outcome(float(answer.output("load").max()), answer, PLACE * rtol)

    return Prepared(lambda: demo.study(problem, 3, rtol=rtol, **QUIET), read)


@bench()
def bond_history() -> Prepared:
    """Two glued strips that are peeled in six steps (Debonding)."""
    scene = lf.Scene()
    for name, at in (("lower", 0.0), ("upper", 2.0)):  # mm
        strip = lf.geometry.box((40.0, 2.0), (40, 2), origin=(0.0, at), cell="quadrilateral")
        scene.substructure(name, strip, lf.LinearElastic(E=70e3, nu=0.3), degree=2)
    bond = lf.Debonding(normal=1e3, tangential=1e3, strength=10.0, energy=0.5)
    scene.interface("bond", "lower:y1", "upper:y0", bond)
    scene.fix("lower:y0")
    scene.fix("upper:x0", lf.Amplitude([0.0, 6.0], [0.0, 1.0]) * (0.0, 0.3), name="peel")
    problem, options = lf.assemble(scene), lf.Options(rtol=1e-5, max_iterations=5000)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(float(np.ravel(answer.jump("bond")[-1, :, 0]).max()), answer)

    times = np.arange(1.0, 7.0)
    return Prepared(lambda: lf.solve(problem, times=times, options=options, **QUIET), read)


def flange(size: float) -> Prepared:
    """35 parts: contact with friction under nuts, a gasket, eight preloads, then pressure."""
    import flange_from_step as demo

    shape = demo.FlangeShape()
    with tempfile.TemporaryDirectory() as folder:
        step = demo.read(demo.make_flange(Path(folder) / "flange.step", shape), shape, size)
        step.join("upper flange|upper nut *", lf.Contact(friction=0.12))
        problem = lf.assemble(demo.loaded(step, step.mesh(), shape, lf.Amplitude((1.0, 2.0), (0.0, 1.0))))
    problem = problem.with_laws({name: lf.Preload(demo.FORCE, until=1.0) for name in demo.BOLTS})
    options = lf.Options(rtol=1e-4, max_iterations=1000)

    def read(answer: Any) -> dict[str, Any]:
        return outcome(normal_force(problem, answer, demo.SEAT), answer)

    return Prepared(lambda: lf.solve(problem, times=(1.0, 2.0), options=options, **QUIET), read)


@bench()
def flange_coarse() -> Prepared:
    """Cells of 24 mm."""
    return flange(24.0)


@bench(usual=False)
def flange_fine() -> Prepared:
    """Cells of 14 mm."""
    return flange(14.0)


# --- others ----------------------------------------------------------------------------------------


@bench()
def wall() -> Prepared:
    """6 x 6 blocks with a spring layer in every joint, all of them kept."""
    scene, rows, springs = lf.Scene(), range(6), lf.Elastic(normal=1e4, tangential=1e4)
    for i in rows:
        for j in rows:
            brick = lf.geometry.box((10.0, 10.0), (4, 4), origin=(10.0 * j, 10.0 * i), cell="quadrilateral")
            scene.substructure(f"b{i}_{j}", brick, lf.LinearElastic(E=20e3, nu=0.2), degree=2)
            if j:
                scene.interface(f"h{i}_{j}", f"b{i}_{j - 1}:x1", f"b{i}_{j}:x0", springs)
            if i:
                scene.interface(f"v{i}_{j}", f"b{i - 1}_{j}:y1", f"b{i}_{j}:y0", springs)
    for j in rows:
        scene.fix(f"b0_{j}:y0", name=f"foot{j}")
        scene.traction(f"b5_{j}:y1", (1.0, -2.0), name=f"push{j}")
    problem, options = lf.assemble(scene), lf.Options(rtol=1e-6, max_iterations=3000)
    active: Sequence[str] = [name for name in problem.interfaces if name[0] in "hv"]

    def read(answer: Any) -> dict[str, Any]:
        return outcome(normal_force(problem, answer, "v1_0"), answer)

    return Prepared(lambda: lf.solve(problem, active=active, options=options, **QUIET), read)


@bench()
def accuracy() -> Prepared:
    """Mean and deviation of a random joint to 0.1 %, the way found by the library."""
    import bonded_lap_joint as demo

    asked, rtol = lf.Resultant("adhesive"), 1e-3
    problem = demo.bonded(lf.LogNormal("k", mean=4500.0, cov=0.3), demo.FORCE)

    def read(answer: Any) -> dict[str, Any]:
        mean, deviation = answer.mean_std(asked)
        return outcome(float(deviation), answer, rtol)

    return Prepared(
        lambda: lf.solve(problem, accuracy=rtol, quantity=asked, meshes=False, relative_to="deviation"), read
    )


@bench()
def import_time() -> Prepared:
    """A process that imports the library, and ends."""

    def run() -> None:
        subprocess.run([sys.executable, "-c", "import dolfinx_frontend"], check=True)

    return Prepared(run, lambda _: {"number": 0.0, "error": 0.0, "counts": {}})
