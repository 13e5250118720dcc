"""The extremes of the project, one case each: a scene with a closed form, and the digits that remain.

``tests/extremes/test_extremes.py`` asserts the cases, ``./run bench limits`` writes docs/limits.md from
them. The scenes are plane and of few cells, and their stresses uniform where possible: linear elements then
have no error of discretisation, and what is measured is rounding and iteration alone.

**What conditioning allows.** The entries of a part's stiffness are rounded to eps E. A motion that the exact
matrix does not resist (rigid, long, thin) meets a false stiffness of that size, so that its error is about
eps times the ratio of the part's stiffness to that of what holds the motion. ``bound`` of an outcome
is `ROUND` times that, plus what the tolerance of the iteration leaves.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from latin_core import Options, stochastic

from dolfinx_frontend import geometry
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.scene.laws import Contact, Elastic, Law, Perfect, Preload
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solving import solve
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.parameters import LogNormal, Normal, Uniform

Array = npt.NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)
E = 2e5  # N/mm^2, parts of 1 mm
PULL = 10.0  # N/mm^2
ROUND = 20.0
"""Rounding errors that add up in a sum of a few dozen terms; the derivations are orders of magnitude."""
RTOL = 1e-10
LEFT = 10.0 * RTOL
"""What an iteration with that tolerance may leave: its estimate is good to a factor of 3."""
TIGHT = Options(rtol=RTOL)
STATUSES = ("no_equilibrium", "slides", "undecided", "max_iterations")
"""Ends of an iteration that say that there is no answer."""


@dataclass(frozen=True)
class Outcome:
    """How a case ended.

    Attributes
    ----------
    kind
        ``"answer"``, the names of the warnings that came with one, the name of an error, or the status of an
        iteration that did not converge.
    error, bound
        Relative error against the closed form, and the largest that conditioning excuses.
    iterations
        Global stages.
    message
        Of the error or the warnings.
    """

    kind: str
    error: float | None = None
    bound: float | None = None
    iterations: int | None = None
    message: str = ""


@dataclass(frozen=True)
class Case:
    """One value of one extreme.

    Attributes
    ----------
    row, value
        Which extreme, and how far.
    run
        The solution, its error and its bound.
    expected
        The kinds that are right, see :class:`Outcome`.
    words
        What the message must contain.
    long
        For the generator of docs/limits.md only.
    note
        What holds beyond, or why a kind other than an answer is right.
    """

    row: str
    value: str
    run: Callable[[], tuple[Result, float, float]]
    expected: tuple[str, ...] = ("answer",)
    words: str = ""
    long: bool = False
    note: str = ""

    @property
    def name(self) -> str:
        """For the test's parameter."""
        return f"{self.row}: {self.value}"

    @staticmethod
    def right(outcome: Outcome) -> bool:
        """Whether it claims to have an answer."""
        return outcome.error is not None and outcome.kind.split(", ")[0] not in STATUSES

    def measure(self) -> Outcome:
        """Run it."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warnings.filterwarnings("ignore", "beyond the model")  # loads and moduli are extreme here
            try:
                result, error, bound = self.run()
            except SceneError as refusal:
                return Outcome(type(refusal).__name__, message=str(refusal))
        names = sorted({w.category.__name__ for w in caught})
        kind = "answer" if result.converged else result.status
        if names:
            kind = ", ".join(names) if result.converged else ", ".join([kind, *names])
        text = "\n".join(str(w.message) for w in caught)
        return Outcome(kind, float(error), float(bound), result.iterations, text)


# ---------------------------------------------------------------------------------------------
# Scenes
# ---------------------------------------------------------------------------------------------
def blocks(
    moduli: Sequence[float] = (E, E),
    nu: float = 0.0,
    size: float = 1.0,
    width: float = 1.0,
    cells: tuple[int, int] = (1, 1),
) -> Scene:
    """Blocks on one another and on a smooth plane, free to move up and to widen."""
    scene = Scene()
    for i, modulus in enumerate(moduli):
        part = geometry.box((width * size, size), cells, origin=(0.0, i * size))
        scene.substructure(f"p{i}", part, LinearElastic(modulus, nu), degree=1)
        scene.symmetry(f"p{i}:x0")
    scene.symmetry("p0:y0")
    return scene


def stack(
    laws: Sequence[Law],
    moduli: Sequence[float] | None = None,
    nu: float = 0.3,
    size: float = 1.0,
    width: float = 1.0,
    pull: float = PULL,
    cells: tuple[int, int] = (1, 1),
    **kinds: Any,
) -> Problem:
    """Blocks on one another under uniform uniaxial stress (plane strain), a law between each two."""
    scene = blocks(moduli or [E] * (len(laws) + 1), nu, size, width, cells)
    for i, law in enumerate(laws):
        scene.interface(f"j{i}", f"p{i}:y1", f"p{i + 1}:y0", law, **kinds)
    scene.traction(f"p{len(laws)}:y1", (0.0, pull), name="pull")
    return assemble(scene)


def stack_error(
    result: Result,
    openings: Sequence[float],
    moduli: Sequence[float] | None = None,
    nu: float = 0.3,
    size: float = 1.0,
    pull: float = PULL,
    whole: bool = False,
) -> float:
    """Largest relative error of the displacement of a part, by its own largest, and of a known force.

    With `whole` by the largest displacement of all parts, which is what a tolerance speaks of.
    """
    moduli = moduli or [E] * (len(openings) + 1)
    base, error = 0.0, 0.0
    largest = max(float(np.abs(u).max()) for u in result.displacements.values()) if whole else 0.0
    for i, modulus in enumerate(moduli):
        x = result.problem.substructures[f"p{i}"].dof_coordinates
        along, across = (1 - nu**2) * pull / modulus, -nu * (1 + nu) * pull / modulus
        exact = np.stack([across * x[:, 0], base + along * (x[:, 1] - i * size)], axis=1)
        base += along * size + (openings[i] if i < len(openings) else 0.0)
        found = result.displacements[f"p{i}"].reshape(exact.shape)
        error = max(error, float(np.abs(found - exact).max() / (largest or np.abs(exact).max())))
    for i in range(len(openings)):
        name = f"j{i}"
        if name in result.plan.active or result.plan.eliminated[name] == "springs assembled":
            error = max(error, float(np.abs(result.force(name)[:, 0] / pull - 1.0).max()))
    return error


def resultant(result: Result, name: str, component: int = 0) -> float:
    """Force over an interface."""
    return float(result.problem.interfaces[name].weights @ result.force(name)[:, component])


def nodal(result: Result, name: str) -> Array:
    """Forces of an interface on the nodes of its first side.

    Those at the points of a rigid contact are not unique where there are more points than nodes.
    """
    interface = result.problem.interfaces[name]
    force = result.force(name)
    local = np.zeros((interface.num_points, interface.dim))
    local[:, : force.shape[1]] = force
    weighted = interface.weights[:, None] * local
    return np.asarray(interface.local_trace(0).T @ weighted.ravel())


# ---------------------------------------------------------------------------------------------
# Interface stiffness
# ---------------------------------------------------------------------------------------------
def stiffness(ratio: float, active: str | None) -> tuple[Result, float, float]:
    """Springs of `ratio` E / L between two blocks."""
    kappa = ratio * E
    result = solve(stack([Elastic(kappa, kappa)]), active=active, options=TIGHT)
    # soft: the upper block hangs on eps E / L as much as on kappa. Stiff: assembled springs cancel
    loss = 1.0 / ratio if active else max(ratio, 1.0 / ratio)
    bound = ROUND * EPS * (1.0 + loss) + (LEFT if active else 0.0)
    return result, stack_error(result, [PULL / kappa]), bound


def glued() -> tuple[Result, float, float]:
    result = solve(stack([Perfect()]), options=TIGHT)
    return result, stack_error(result, [0.0]), ROUND * EPS


def free_stiffness(held: bool) -> tuple[Result, float, float]:
    """No stiffness at all; the upper block is held by springs of its own, or by nothing."""
    scene = blocks(nu=0.3)
    scene.interface("j0", "p0:y1", "p1:y0", Elastic(0.0, 0.0))
    scene.traction("p1:y1", (0.0, PULL))
    if held:
        scene.interface("ground", "p1:y0", Elastic(E, 0.0))
    result = solve(assemble(scene), active="all", options=TIGHT)
    error = abs(resultant(result, "ground") / PULL + resultant(result, "j0") / PULL - 1.0)
    error = max(error, float(np.abs(result.displacements["p0"]).max() / (PULL / E)))
    return result, error, LEFT


# ---------------------------------------------------------------------------------------------
# Materials, shapes, units
# ---------------------------------------------------------------------------------------------
def poisson(nu: float, active: str | None) -> tuple[Result, float, float]:
    result = solve(stack([Elastic(E, E)], nu=nu), active=active, options=TIGHT)
    # bulk and shear modulus go as 1 / (1 - 2 nu) and 1 / (1 + nu): one is held that much more than the other
    bound = ROUND * EPS * (1.0 + 1.0 / (1.0 - 2.0 * nu) + 1.0 / (1.0 + nu)) + (LEFT if active else 0.0)
    return result, stack_error(result, [PULL / E], nu=nu), bound


def bending(nu: float, degree: int) -> tuple[Result, float, float]:
    """A nearly incompressible cantilever: linear elements lock, quadratic ones do not."""
    scene = Scene()
    part = geometry.box((10.0, 1.0), (20, 2))
    scene.substructure("beam", part, LinearElastic(E, nu), degree=degree)
    scene.fix("beam:x0")
    scene.traction("beam:x1", (0.0, 1.0))
    result = solve(assemble(scene))
    tip = result.displacements["beam"].reshape(-1, 2)[:, 1].max()
    # Timoshenko, plane strain: P L^3 / (3 E' I) + 1.2 P L / (G h); the clamped end is stiffer by some h / L
    exact = 10.0**3 / (3.0 * E / (1.0 - nu**2) / 12.0) + 1.2 * 10.0 * 2.0 * (1.0 + nu) / E
    return result, abs(tip / exact - 1.0), 0.05 if degree > 1 else 1.0


def contrast(ratio: float, active: str | None) -> tuple[Result, float, float]:
    """Upper part `ratio` times as stiff as the lower one, springs of the softer one's stiffness."""
    moduli = [E, E * ratio]
    kappa = min(moduli)
    # parts that contract differently must slide, or their stress is not uniform
    result = solve(stack([Elastic(normal=kappa)], moduli), active=active, options=TIGHT)
    # a stiff part on soft springs: its rigid motion meets eps of its own stiffness
    bound = ROUND * EPS * (1.0 + max(ratio, 1.0 / ratio)) + (LEFT if active else 0.0)
    return result, stack_error(result, [PULL / kappa], moduli, whole=bool(active)), bound


def aspect(ratio: float, active: str | None) -> tuple[Result, float, float]:
    """Blocks `ratio` times as wide as high."""
    result = solve(stack([Elastic(E, E)], width=ratio), active=active, options=TIGHT)
    # entries of size E ratio (across) stand beside those of size E / ratio (along)
    bound = ROUND * EPS * max(ratio, 1.0 / ratio) ** 2 + (LEFT if active else 0.0)
    return result, stack_error(result, [PULL / E]), bound


def scaled(length: float, stress: float) -> Result:
    """Two blocks in rough contact, pressed and sheared, in units of length and stress."""
    scene = Scene()
    for i in range(2):
        part = geometry.box((length, length), (3, 2), origin=(0.0, i * length))
        scene.substructure(f"p{i}", part, LinearElastic(E * stress, 0.3), degree=1)
    scene.fix("p0:y0")
    scene.interface("j0", "p0:y1", "p1:y0", Contact(friction=0.3))
    scene.interface("guide", "p1:y1", Elastic(E * stress / length, 0.1 * E * stress / length))
    scene.traction("p1:y1", (4.0 * stress, -10.0 * stress), name="load")
    return solve(assemble(scene), options=TIGHT)


def units(length: float, force: float = 1.0) -> tuple[Result, float, float]:
    """The same digits and iterations whatever the units (the error is infinite if the latter differ)."""
    stress = force / length**2
    result, mine = scaled(length, stress), scaled(1.0, 1.0)
    error = 0.0
    for name, u in result.displacements.items():
        exact = mine.displacements[name]
        error = max(error, float(np.abs(u / length - exact).max() / np.abs(exact).max()))
    f, exact = nodal(result, "j0") / (stress * length), nodal(mine, "j0")
    error = max(error, float(np.abs(f - exact).max() / np.abs(exact).max()))
    # powers of ten are rounded: an iteration that stops at a tolerance may need one more
    if abs(result.iterations - mine.iterations) > 1 + mine.iterations // 10:
        error = float("inf")
    return result, error, LEFT


def magnitude(pull: float, active: str | None) -> tuple[Result, float, float]:
    """A load of any size: energies are its square."""
    result = solve(stack([Elastic(E, E)], pull=pull), active=active, options=TIGHT)
    return result, stack_error(result, [pull / E], pull=pull), ROUND * EPS + (LEFT if active else 0.0)


def unloaded(law: Law, active: str | None) -> tuple[Result, float, float]:
    """No load: nothing moves, and no number is 0 / 0."""
    result = solve(stack([law], pull=0.0), active=active, options=TIGHT)
    error = max(float(np.abs(u).max()) for u in result.displacements.values())
    if not np.isfinite(result.error):
        error = float("nan")
    return result, error, 0.0


# ---------------------------------------------------------------------------------------------
# Contact and friction
# ---------------------------------------------------------------------------------------------
def bolted(
    share: float, stiff: bool, space: str = "points", options: Options = TIGHT
) -> tuple[Result, float, float]:
    """Bolt K, D and joint in parallel under Q = share K D: opening exactly at 1 (TARGETS 2.6)."""
    K, D, k = 0.1 * E, 1e-3, 0.5 * E
    scene = blocks(cells=(2, 1))
    law = Contact(stiffness=k) if stiff else Contact()
    scene.interface("joint", "p0:y1", "p1:y0", law, space=space)  # type: ignore[arg-type]
    scene.interface("bolt", "p0:y1", "p1:y0", Elastic(normal=K, jump=-D))
    scene.traction("p1:y1", (0.0, share * K * D), name="Q")
    result = solve(assemble(scene), options=options)
    opening = (share - 1.0) * K * D / (K + k if stiff and share < 1.0 else K)
    opening = 0.0 if not stiff and share < 1.0 else opening
    joint = min(share - 1.0, 0.0) * K * D * (k / (K + k) if stiff else 1.0)
    bolt = K * (opening + D)
    per_node = nodal(result, "bolt") / bolt  # uniform: shares of the area
    error = max(
        float(np.abs(nodal(result, "joint") - joint * per_node).max()) / (K * D),
        float(np.abs(result.force("bolt")[:, 0] - bolt).max()) / (K * D),
    )
    return result, error, LEFT


def at_points(space: str) -> tuple[Result, float, float]:
    """The rigid joint at 0.8, force at its points, long after the displacements have converged."""
    result, _, _ = bolted(0.8, False, space, Options(rtol=1e-12, newton=0))
    exact = -0.2 * 0.1 * E * 1e-3
    error = float(np.abs(result.force("joint")[:, 0] / exact - 1.0).max())
    # what the nodes do not see of the point forces is not determined, and has no reason to grow either
    return result, error, LEFT if space == "facets" else 1e-2


def closing(gap: float, press: float) -> tuple[Result, float, float]:
    """Two bars of length 1, a gap, and a prescribed end displacement -press."""
    scene = blocks()
    scene.interface("joint", "p0:y1", "p1:y0", Contact(gap=gap))
    scene.fix("p1:y1", (0.0, -press), components=1, name="end")
    result = solve(assemble(scene), options=TIGHT)
    exact = -0.5 * E * max(press - gap, 0.0)
    size = max(0.5 * E * press, 0.5 * E * abs(gap))
    error = float(np.abs(result.force("joint")[:, 0] - exact).max())
    return result, error / size if size > 0.0 else error, LEFT


def sliding(mu: float) -> tuple[Result, float, float]:
    """A pressed block sheared on a rough floor; springs take what friction does not."""
    press, shear, kt = 10.0, 1.0, 0.1 * E
    scene = Scene()
    part = geometry.box((4.0, 1.0), (4, 1))
    material = LinearElastic(E, 0.0)
    scene.substructure("block", part, material, degree=1, body_force=(shear, 0.0))
    scene.interface("floor", "block:y0", Contact(friction=mu))
    scene.interface("spring", "block:y0", Elastic(tangential=kt))
    scene.traction("block:y1", (0.0, -press), name="press")
    result = solve(assemble(scene), options=TIGHT)
    width = 4.0
    normal = abs(resultant(result, "floor") / (-press * width) - 1.0)
    whole = resultant(result, "floor", 1) if mu > 0.0 else 0.0
    spring = float(
        result.problem.interfaces["spring"].weights @ result.force("spring").reshape(-1, 2)[:, 1]
    )
    balance = abs((abs(whole) + abs(spring)) / (shear * width) - 1.0)
    if mu < shear / press:
        share = abs(abs(whole) - mu * press * width) / (shear * width)
    else:  # whatever sticks carries all, springs carry nothing
        share = abs(spring) / (shear * width)
    return result, max(normal, balance, share), LEFT


def jammed(
    share: float, mu: float = 0.3, press: float = 10.0, newton: bool = True
) -> tuple[Result, float, float]:
    """A block that only the friction of two walls holds, under its weight: share 1 is the limit."""
    width, height = 1.0, 1.0
    scene = Scene()
    part = geometry.box((width, height), (2, 2))
    weight = share * 2.0 * mu * (press or 10.0) / width
    scene.substructure(
        "block", part, LinearElastic(E, 0.0), degree=1, body_force=(0.0, -weight) if weight else None
    )
    shift = 0.5 * press / E * width
    for face in ("x0", "x1"):
        law = Contact(friction=mu, gap=-shift)
        scene.interface(face, f"block:{face}", law)
    result = solve(assemble(scene), options=TIGHT if newton else TIGHT.with_(newton=0))
    held = sum(
        abs(resultant(result, face, 1)) if mu > 0 else 0.0 for face in ("x0", "x1")
    )
    return result, abs(held - weight * width * height) / (press or 10.0), LEFT


def unclamped(force: float) -> tuple[Result, float, float]:
    """A joint whose bolt is tightened to a force of zero or little, pressed by its load."""
    scene = blocks()
    scene.interface("joint", "p0:y1", "p1:y0", Contact())
    scene.interface("bolt", "p0:y1", "p1:y0", Preload(force))
    scene.traction("p1:y1", (0.0, -PULL), name="load")
    result = solve(assemble(scene), options=TIGHT)
    error = abs(resultant(result, "joint") / -(PULL + force) - 1.0)
    return result, max(error, abs(resultant(result, "bolt") - force) / PULL), LEFT


def floating() -> tuple[Result, float, float]:
    """Two parts joined to each other and to nothing else."""
    scene = Scene()
    for i in (0, 1):
        part = geometry.box((1.0, 1.0), (1, 1), origin=(0.0, float(i)))
        scene.substructure(f"p{i}", part, LinearElastic(E, 0.3), degree=1)
    scene.interface("j0", "p0:y1", "p1:y0", Elastic(E, E))
    scene.traction("p1:y1", (0.0, PULL))
    return solve(assemble(scene)), 0.0, 0.0


# ---------------------------------------------------------------------------------------------
# Chaos
# ---------------------------------------------------------------------------------------------
def hermite_mean(d: float, order: int) -> float:
    """Galerkin mean of 1 / (1 + d xi): the value of Gauss and Hermite (TARGETS 2.8)."""
    x, w = np.polynomial.hermite_e.hermegauss(order + 1)
    return float(w @ (1.0 / (1.0 + d * x)) / w.sum())


def opening_moments(problem: Problem, result: Any, joints: int) -> tuple[float, float]:
    """Mean and variance of the displacement of the end of a stack, by its chaos."""
    name = f"p{joints}"
    c = result.coefficients(name)
    x = problem.substructures[name].dof_coordinates
    row = 2 * int(np.argmax(x[:, 1])) + 1
    return float(c[row, 0]), float(np.sum(c[row, 1:] ** 2))


def gaussian(d: float, order: int) -> tuple[Result, float, float]:
    """A normal stiffness of coefficient of variation d between two blocks."""
    kappa = Normal("k", E, cov=d)
    problem = stack([Elastic(normal=kappa)])
    result = solve(problem, chaos=order, options=TIGHT)
    mean, _ = opening_moments(problem, result, 1)
    bars = 2.0 * (1.0 - 0.3**2) * PULL / E
    exact = bars + PULL / E * hermite_mean(d, order)
    # the smallest eigenvalue 1 - d x_max holds the last mode
    margin = 1.0 - d / stochastic.critical_cov(stochastic.Germ.hermite(), order)
    return result, abs(mean / exact - 1.0), (LEFT + ROUND * EPS) / margin


def positive(law: str, order: int) -> tuple[Result, float, float]:
    """A positive stiffness at high order, d = 0.2: E[1 / k] (TARGETS 2.7)."""
    d = 0.2
    if law == "lognormal":
        kappa, exact = LogNormal("k", E, cov=d), 1.0 + d**2
        # Hermite coefficients of 1 / k fall like s^n / sqrt(n!)
        s = np.sqrt(np.log1p(d**2))
        truncation = float(s ** (2 * order + 2) * 100.0)
    else:
        a = d * np.sqrt(3.0)
        kappa, exact = Uniform("k", mean=E, cov=d), np.log((1 + a) / (1 - a)) / (2 * a)
        # Gauss and Legendre: the pole at 1 / a, rho = 1 / a + sqrt(1 / a^2 - 1)
        rho = 1 / a + np.sqrt(1 / a**2 - 1)
        truncation = float(10.0 * rho ** (-2 * order - 2))
    problem = stack([Elastic(normal=kappa)])
    result = solve(problem, chaos=order, options=TIGHT)
    mean, _ = opening_moments(problem, result, 1)
    exact = 2.0 * (1.0 - 0.3**2) + exact
    return result, abs(mean * E / PULL / exact - 1.0), LEFT + ROUND * EPS + truncation


def many_germs(count: int, chaos: Chaos) -> tuple[Result, float, float]:
    """A random stiffness in each joint of a stack: the openings add up."""
    d = 0.2
    a = d * np.sqrt(3.0)
    laws = [Elastic(normal=Uniform(f"k{i}", mean=E, cov=d)) for i in range(count)]
    problem = stack(laws)
    result = solve(problem, chaos=chaos, options=TIGHT)
    mean, variance = opening_moments(problem, result, count)
    # Galerkin in one germ, by Gauss and Legendre of p + 1 points
    x, w = np.polynomial.legendre.leggauss(chaos.order + 1)
    one = float(0.5 * w @ (1.0 / (1.0 + a * x)))
    bars = (count + 1) * (1.0 - 0.3**2)
    error = abs(mean * E / PULL / (bars + count * one) - 1.0)
    basis = np.polynomial.legendre.legvander(x, chaos.order) * np.sqrt(
        2.0 * np.arange(chaos.order + 1) + 1.0
    )
    modes = 0.5 * basis.T @ (w / (1.0 + a * x))
    exact = count * float(np.sum(modes[1:] ** 2))
    error = max(error, abs(variance * (E / PULL) ** 2 / exact - 1.0))
    return result, error, LEFT * 10.0 + ROUND * EPS * count**2


# ---------------------------------------------------------------------------------------------
# Many parts, one facet
# ---------------------------------------------------------------------------------------------
def tower(parts: int, active: str | None) -> tuple[Result, float, float]:
    """Blocks on one another with springs between them."""
    laws: list[Law] = [Elastic(E, E)] * (parts - 1)
    result = solve(stack(laws), active=active if laws else None, options=TIGHT)
    # the softest motion of a chain of n is n^2 softer than one of its links
    bound = ROUND * EPS * max(parts, 2) ** 2 + (LEFT * parts if active else 0.0)
    return result, stack_error(result, [PULL / E] * (parts - 1)), bound


def wall(side: int, active: str | None) -> tuple[Result, float, float]:
    """side x side bricks with springs in all joints, pulled: nothing moves sideways at nu = 0."""
    scene = Scene()
    for i in range(side):
        for j in range(side):
            part = geometry.box((1.0, 1.0), (1, 1), origin=(float(i), float(j)))
            scene.substructure(f"p{i}_{j}", part, LinearElastic(E, 0.0), degree=1)
    for i in range(side):
        scene.fix(f"p{i}_0:y0", name=f"floor{i}")
        scene.traction(f"p{i}_{side - 1}:y1", (0.0, PULL), name=f"pull{i}")
        for j in range(side):
            if i + 1 < side:
                scene.interface(f"x{i}_{j}", f"p{i}_{j}:x1", f"p{i + 1}_{j}:x0", Elastic(E, E))
            if j + 1 < side:
                scene.interface(f"y{i}_{j}", f"p{i}_{j}:y1", f"p{i}_{j + 1}:y0", Elastic(E, E))
    result = solve(assemble(scene), active=active, options=TIGHT)
    error = 0.0
    for i in range(side):
        for j in range(side):
            x = result.problem.substructures[f"p{i}_{j}"].dof_coordinates
            exact = np.zeros_like(x)
            exact[:, 1] = (x[:, 1] + j) * PULL / E
            u = result.displacements[f"p{i}_{j}"].reshape(x.shape)
            error = max(error, float(np.abs(u - exact).max()))
    whole = (2 * side - 1) * PULL / E
    return result, error / whole, ROUND * EPS * side**2 + (LEFT * side if active else 0.0)


def one_facet(law: Law, space: str, opening: float, pull: float) -> tuple[Result, float, float]:
    result = solve(stack([law], space=space, pull=pull), active="all", options=TIGHT)
    return result, stack_error(result, [opening], pull=pull), LEFT


def lowered(real: type) -> tuple[Result, float, float]:
    """Numbers of 32 bits given by the user are taken as they are."""
    kappa = real(E)
    result = solve(stack([Elastic(kappa, kappa)], pull=real(PULL)), active="all", options=TIGHT)
    return result, stack_error(result, [PULL / E]), LEFT


def single() -> tuple[Result, float, float]:
    """The iteration in 32 bits, corrected in 64."""
    options = TIGHT.with_(precision="single")
    result = solve(stack([Elastic(E, E)]), active="all", options=options)
    return result, stack_error(result, [PULL / E]), LEFT


# ---------------------------------------------------------------------------------------------
# The list
# ---------------------------------------------------------------------------------------------
def _twice(
    row: str, shown: str, call: Callable[..., tuple[Result, float, float]], *args: Any, **how: Any
) -> Iterator[Case]:
    for active in (None, "all"):
        kind = "iterated" if active else "assembled"
        yield Case(row, f"{shown}, {kind}", lambda a=active: call(*args, a), **how)


def all_cases() -> Iterator[Case]:
    """Every row of the list of extremes, in its order."""
    row = "interface stiffness / (E/L)"
    # eps of the stiff parts is more than the tolerance asks for; rounding a displacement hides small strains
    soft = ("answer", "undecided", "inexact")
    for ratio in (1e-12, 1e-8, 1e-4, 1.0, 1e4, 1e8, 1e12):
        note = "strains of a part on soft springs are less exact than the forces"
        how = {"expected": soft, "note": note} if ratio <= 1e-8 else {}
        yield from _twice(row, f"{ratio:g}", stiffness, ratio, **how)
    refused = ("SceneError",)
    yield Case(row, "0, held otherwise", lambda: free_stiffness(True))
    yield Case(row, "0, held by nothing", lambda: free_stiffness(False), refused, "can move freely")
    yield Case(row, "inf", lambda: stiffness(np.inf, None), refused, "Perfect()")
    yield Case(row, "inf as Perfect()", glued)

    row = "Poisson's ratio"
    for nu in (-0.999999, 0.0, 0.49, 0.4999, 0.499999):
        # under uniform stress linear elements do not lock, but the scene does not know
        how = {"expected": ("SceneWarning",), "words": "linear elements lock"} if nu > 0.45 else {}
        if np.finfo(float).eps / (1.0 + nu) > 1e-10:  # the moduli differ by more than the tolerance bears
            how = {"expected": ("answer", "inexact"), "note": "rounding may leave more than the tolerance"}
        yield from _twice(row, f"{nu:g}", poisson, nu, **how)
    yield Case(row, "0.5", lambda: poisson(0.5, None), refused, "nu < 0.5")
    row = "bending, nearly incompressible (mesh: 2 x 20)"
    for nu in (0.3, 0.499999):
        yield Case(row, f"{nu:g}, degree 2", lambda v=nu: bending(v, 2))
    locked = "linear elements: 96 % too stiff at nu = 0.499, with a warning"
    yield Case(row, "0.499, degree 1", lambda: bending(0.499, 1), ("SceneWarning",), "lock", note=locked)

    row = "stiffness of a part / its neighbour's"
    seen = "rounding leaves more than the tolerance of 1e-10, and the status says so"
    hidden = {"expected": ("answer", "inexact"), "note": seen}
    for ratio in (1e-8, 1e-4, 1e4, 1e8):
        yield from _twice(row, f"{ratio:g}", contrast, ratio, **(hidden if ratio == 1e8 else {}))

    row = "aspect ratio"
    for ratio in (1e-4, 1e-2, 1e2, 1e4):
        yield from _twice(row, f"{ratio:g}", aspect, ratio, **(hidden if abs(np.log10(ratio)) > 3 else {}))

    row = "units"
    for name, length, force in (("N-m", 1e-3, 1.0), ("kN-m", 1e-3, 1e-3)):
        yield Case(row, f"{name} (against N-mm)", lambda a=length, b=force: units(a, b))
    for length in (1e-9, 1e-6, 1e-3, 1e3, 1e6):
        yield Case("length", f"{length:g}", lambda a=length: units(a, a**2))

    row = "size of the load / ordinary"
    for share in (1e-290, 1e-160, 1e-100, 1e-12, 1e12, 1e100, 1e160, 1e290):
        pull = share * PULL
        if 1e-130 < share < 1e130:
            yield from _twice(row, f"{share:g}", magnitude, pull)
            continue
        yield Case(row, f"{share:g}, assembled", lambda p=pull: magnitude(p, None))
        far = "leave the range of numbers"
        only = "only iterations are refused, beyond strains of 1e-130 and 1e130; direct solves are not"
        yield Case(row, f"{share:g}, iterated", lambda p=pull: magnitude(p, "all"), refused, far, note=only)
    row = "no load"
    yield from _twice(row, "elastic", unloaded, Elastic(E, E))
    yield Case(row, "contact", lambda: unloaded(Contact(), "all"), ("answer",))
    yield Case(row, "friction", lambda: unloaded(Contact(friction=0.3), "all"), ("answer",))

    yield Case("floating parts", "held by nothing", floating, refused, "can move freely")

    row = "bolted joint, Q / (K D)"
    for share in (0.8, 1.0 - 1e-9, 1.0 - EPS, 1.0, 1.0 + EPS, 1.0 + 1e-9, 1.2):
        for stiff in (True, False):
            kind = "elastic" if stiff else "rigid"
            yield Case(row, f"{share:.17g}, {kind}", lambda s=share, k=stiff: bolted(s, k))

    row = "friction coefficient"
    for mu in (0.0, 1e-12, 0.05, 0.3, 1e3):
        yield Case(row, f"{mu:g}", lambda m=mu: sliding(m))

    row = "preload"
    for force in (0.0, 1e-12, 1e3):
        yield Case(row, f"{force / PULL:g} of the load", lambda f=force: unclamped(f))

    row = "gap / (closing displacement)"
    for gap in (0.0, EPS, -EPS, 1e-12, -1e-12, 0.5, 1.0 - EPS, 1.0, 1.0 + EPS, 2.0, -1.0):
        shown = f"{gap:.17g}"
        yield Case(row, shown, lambda g=gap: closing(g * 1e-3, 1e-3))
    yield Case("gap / (closing displacement)", "0 / 0", lambda: closing(0.0, 0.0))

    row = "held by friction only, load / limit"
    for share in (0.0, 0.5, 0.95):
        yield Case(row, f"{share:g}", lambda s=share: jammed(s))
    yield Case(row, "0.99", lambda: jammed(0.99))
    near_limit = "next to the limit everything slips: the iteration may stagnate, without Newton from 0.99 on"
    ends = ("answer", "undecided", "undecided, SceneWarning")
    yield Case(row, "0.99, newton=0", lambda: jammed(0.99, newton=False), ends, note=near_limit)
    yield Case(row, "0.999999", lambda: jammed(1.0 - 1e-6), ends, note=near_limit)
    beyond = ("no_equilibrium, SceneWarning", "undecided, SceneWarning", "max_iterations, SceneWarning")
    within = "an imbalance below 2e-3 of the loads is not told from the error of the iteration"
    gave_up = (*beyond, "undecided", "max_iterations")
    yield Case(row, "1.000001", lambda: jammed(1.0 + 1e-6), gave_up, note=within)
    moved = "without the warning, a message names the translation of the last iterate"
    yield Case(row, "1.01", lambda: jammed(1.01), (*beyond, "undecided"), note=moved)
    yield Case(row, "2", lambda: jammed(2.0), beyond, "slips")
    yield Case(row, "no preload", lambda: jammed(1.0, press=0.0), beyond, "slips")

    row = "normal stiffness, order 3: d / d_crit"
    critical = stochastic.critical_cov(stochastic.Germ.hermite(), 3)
    indefinite = ("IndefiniteError",)
    for share in (0.01, 0.2 / critical):
        yield Case(row, f"{share:.3g}", lambda s=share: gaussian(s * critical, 3))
    for share in (0.95, 0.999, 1.0 - 1e-6):
        # next to it rounding is all that is certain
        near = ("NearlyIndefiniteWarning", "inexact, NearlyIndefiniteWarning")[: 1 if share < 0.99 else 2]
        yield Case(row, f"{share:.7g}", lambda s=share: gaussian(s * critical, 3), near, "nearly")
    for share in (1.0 + 1e-6, 1.001, 1.5, 1.0 / critical):
        yield Case(row, f"{share:.7g}", lambda s=share: gaussian(s * critical, 3), indefinite, "indefinite")

    row = "chaos order"
    for order in (1, 5, 10, 20):
        for law in ("lognormal", "uniform"):
            yield Case(row, f"{order}, {law}", lambda o=order, k=law: positive(k, o))
    for order in (8, 9):
        near = ("NearlyIndefiniteWarning",)
        yield Case(row, f"{order}, normal, d = 0.2", lambda o=order: gaussian(0.2, o), near, "nearly")
    for order in (10, 20):
        shown = f"{order}, normal, d = 0.2"
        yield Case(row, shown, lambda o=order: gaussian(0.2, o), indefinite, "indefinite")

    row = "random variables"
    for count, chaos in (
        (1, Chaos(order=3)),
        (5, Chaos(order=3)),
        (20, Chaos(order=2)),
        (20, Chaos(order=3, index_set="hyperbolic", q=0.5)),
    ):
        shown = f"{count}, {chaos.index_set} order {chaos.order}"
        yield Case(row, shown, lambda c=count, k=chaos: many_germs(c, k))

    row = "parts"
    for count in (1, 2, 10, 100, 1000):
        yield from _twice(row, f"chain of {count}", tower, count, long=count > 100)
    for side in (4, 32):
        yield from _twice(row, f"wall of {side**2}", wall, side, long=side > 4)

    row = "interfaces of one facet"
    for space in ("points", "facets"):
        for name, law, opening, pull in (
            ("perfect", Perfect(), 0.0, PULL),
            ("elastic", Elastic(E, E), PULL / E, PULL),
            ("contact", Contact(), 0.0, -PULL),
            ("friction", Contact(friction=0.3), 0.0, -PULL),
        ):
            yield Case(
                row,
                f"{name}, {space}",
                lambda k=law, s=space, o=opening, p=pull: one_facet(k, s, o, p),
            )

    row = "rigid contact, force at a point"
    yield Case(row, "space='facets'", lambda: at_points("facets"))
    more = "two points per facet, but one node: resultants and nodal forces are unique, point values are not"
    yield Case(row, "space='points', degree 1", lambda: at_points("points"), note=more)

    row = "numbers of 32 bits"
    yield Case(row, "in a scene", lambda: lowered(np.float32))
    yield Case(row, "in the iteration", single)


CASES = tuple(all_cases())
