"""Scenes with closed forms whose two sides are meshed independently (consistent units, no names).

``blocks``: two squares or cubes on top of each other with a smooth displacement; the interface at x_d = 1 is
plane, its traction compressive and without shear, so that Perfect, Elastic and Contact have the same
solution. ``rings``: a quarter of two rings, or of two tubes between planes, under inner pressure (Lame).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from latin_core import Options

from dolfinx_frontend import Result, Scene, assemble, solve
from dolfinx_frontend.scene.laws import Contact, Elastic, Law, Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.specs import Space
from tests.helpers import DIMENSION, block, lame

Array = npt.NDArray[np.float64]

E, NU = 1.0, 0.3
LAM, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
KAPPA = 2.0
"""Stiffness of elastic interfaces, times length over modulus."""

OPTIONS = Options(rtol=1e-9, max_iterations=3000)


@dataclass(frozen=True)
class Errors:
    """Of one run.

    Attributes
    ----------
    energy
        Of the displacement, relative, in the energy norm.
    force
        Of the interface's force, relative, root mean square over the interface points.
    resultant
        Of the resultant normal force, relative.
    status, iterations
        Of the run.
    """

    energy: float
    force: float
    resultant: float
    status: str
    iterations: int


def _exact(lib: Any, x: Any) -> list[Any]:
    """Components of the displacement of `blocks`; x: coordinates, last one across the interface."""
    s = x[-1] - 1.0
    # even along, odd across the plane s = 0: no shear there; and compression throughout
    along = [lib.sin(2.0 * x[0] + 0.3) * lib.cos(1.5 * s)]
    if len(x) == 3:
        along[0] = along[0] * lib.cos(x[1])
        along.append(0.5 * lib.cos(x[0]) * lib.sin(1.5 * x[1] + 0.5) * lib.cos(1.5 * s))
    across = 0.5 * lib.sin(1.5 * s) * lib.cos(2.0 * x[0]) - 4.0 * s
    return [*along, across]


def _values(x: Array) -> Array:
    return np.stack(_exact(np, list(x.T)), axis=1)


def _pressure(x: Array) -> Array:
    """Exact normal stress (points,) on the plane, by complex steps."""
    d = x.shape[1]
    strain = np.empty((d, len(x)))
    for k in range(d):
        moved = x.astype(complex)
        moved[:, k] += 1e-30j
        strain[k] = _exact(np, list(moved.T))[k].imag / 1e-30
    stress: Array = LAM * strain.sum(axis=0) + 2 * MU * strain[d - 1]
    return stress


def _stress(u: Any, d: int) -> Any:
    e = ufl.sym(ufl.grad(u))
    return LAM * ufl.tr(e) * ufl.Identity(d) + 2 * MU * e


def law_of(name: str, opening: Any) -> Law:
    """Perfect, elastic or contact; an elastic one is opened so that its solution is continuous."""
    if name == "elastic":
        return Elastic(normal=KAPPA, tangential=KAPPA, jump=opening)
    return Perfect() if name == "perfect" else Contact(gap=0.0)


def _errors(result: Result, closed_form: Any, exact_force: Array, degree: int) -> Errors:
    above = below = 0.0
    for name, part in result.problem.substructures.items():
        mesh = part.part.mesh
        w = closed_form(ufl.SpatialCoordinate(mesh))
        dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 4})
        d = mesh.geometry.dim
        for v, which in ((result.displacement(name) - w, 0), (w, 1)):
            form = ufl.inner(_stress(v, d), ufl.grad(v)) * dx
            energy = fem.assemble_scalar(fem.form(form))
            above, below = (above + energy, below) if which == 0 else (above, below + energy)
    joint = result.problem.interfaces["joint"]
    force = result.force("joint")
    if joint.vertices is not None and joint.vertices.nodal.shape[0] == len(force):
        force = joint.vertices.nodal @ force  # the pressure at the places of the points
    distance = force.copy()
    distance[:, 0] -= exact_force
    size = joint.weights @ exact_force**2
    total = joint.weights @ exact_force
    return Errors(
        float(np.sqrt(above / below)),
        float(np.sqrt(joint.weights @ np.sum(distance**2, axis=1) / size)),
        float(abs(joint.weights @ force[:, 0] - total) / abs(total)),
        result.status,
        result.iterations,
    )


def blocks(cell: str, space: Space, law: str, degree: int, n: int, finer_first: bool = True) -> Errors:
    """n and 3 n / 2 cells along an edge; side 1 has the smaller facets if `finer_first`."""
    d = DIMENSION[cell]
    counts = (3 * n // 2, n) if finer_first else (n, 3 * n // 2)

    def closed_form(x: Any) -> Any:
        return ufl.as_vector(_exact(ufl, [x[k] for k in range(d)]))

    scene = Scene()
    low, high = np.zeros(d), np.ones(d)
    for name, count in zip("ab", counts, strict=True):
        part = block(cell, [count] * d, low, high)
        force = -ufl.div(_stress(closed_form(ufl.SpatialCoordinate(part.mesh)), d))
        scene.substructure(name, part, LinearElastic(E, NU), degree=degree, body_force=force)
        low, high = low.copy(), high.copy()
        low[-1], high[-1] = 1.0, 2.0

    def opening(x: Array) -> Array:
        jump = np.zeros_like(x)
        jump[:, 0] = -_pressure(x) / KAPPA
        return jump

    end = "xyz"[d - 1]
    scene.interface("joint", f"a:{end}1", f"b:{end}0", law_of(law, opening), space=space)
    for name, far in (("a", f"{end}0"), ("b", f"{end}1")):
        for face in [far, *(f"{axis}{k}" for axis in "xyz"[: d - 1] for k in (0, 1))]:
            scene.fix(f"{name}:{face}", value=_values)
    problem = assemble(scene)
    result = solve(problem, method="accelerated", active=["joint"], options=OPTIONS)
    return _errors(result, closed_form, _pressure(problem.interfaces["joint"].points), degree)


INNER, MIDDLE, OUTER, BORE = 1.0, 1.5, 2.0, 0.01


def pressure_between() -> float:
    """Pressure at the middle radius of the undivided ring."""

    def u(r: float, a: float, b: float, inside: float, outside: float) -> float:
        return float(lame(r, a, b, inside, outside, E, NU))

    compliance = u(MIDDLE, MIDDLE, OUTER, 1.0, 0.0) - u(MIDDLE, INNER, MIDDLE, 0.0, 1.0)
    return u(MIDDLE, INNER, MIDDLE, BORE, 0.0) / compliance


def rings(
    cell: str,
    space: Space,
    law: str,
    degree: int,
    n: int,
    order: int = 2,
    along: tuple[int, int] = (3, 2),
    height: tuple[int, int] = (3, 2),
) -> Errors:
    """along * n cells of the rings along the quarter, height * n / 2 across it; `order` of the geometry."""
    d = DIMENSION[cell]

    def bend(x: Array) -> Array:
        # x: radius, y: angle as a fraction of the quarter
        angle = 0.5 * np.pi * x[:, 1]
        return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), *x.T[2:]])

    scene = Scene()
    for k, (name, ends) in enumerate((("a", (INNER, MIDDLE)), ("b", (MIDDLE, OUTER)))):
        low, high = np.array([ends[0], 0.0, 0.0][:d]), np.array([ends[1], 1.0, 0.5][:d])
        part = block(cell, [n, along[k] * n, max(1, height[k] * n // 2)][:d], low, high, bend, order)
        scene.substructure(name, part, LinearElastic(E, NU), degree=degree)
        scene.symmetry([f"{name}:{face}" for face in ("y0", "y1", "z0", "z1")[: 2 * d - 2]])
    between = pressure_between()
    opening = np.zeros(d)
    opening[0] = between / KAPPA
    scene.interface("joint", "a:x1", "b:x0", law_of(law, opening), space=space)
    scene.pressure("a:x0", BORE)

    def closed_form(x: Any) -> Any:
        r = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        factor = lame(r, INNER, OUTER, BORE, 0.0, E, NU) / r
        return ufl.as_vector([factor * x[0], factor * x[1], 0.0 * x[0]][:d])

    problem = assemble(scene)
    result = solve(problem, method="accelerated", active=["joint"], options=OPTIONS)
    exact = np.full(problem.interfaces["joint"].num_points, -between)
    return _errors(result, closed_form, exact, degree)


SHIFT = 0.37
"""How far the upper square of `overlapping` is shifted."""


def overlapping(degree: int, n: int, aligned: bool = False, space: Space = "auto") -> float:
    """Energy of two squares, the upper one shifted sideways, pressed together without friction.

    Parameters
    ----------
    degree
        Of the displacements; triangles.
    n
        Even; the lower square has 3 n / 2 cells along an edge, to the next even number.
    aligned
        Whether nodes lie where the overlap begins and ends, as in a solution to compare with.
    space
        Of the interface.
    """
    scene = Scene()
    for name, count, start, middle in (("a", 3 * n // 2, 0.0, SHIFT), ("b", n, SHIFT, 1.0 - SHIFT)):

        def graded(x: Array, start: float = start, middle: float = middle) -> Array:
            # the node in the middle of the edge goes to where the other block begins or ends
            out = x.copy()
            s = 2.0 * (x[:, 0] - start)
            out[:, 0] = start + np.where(s < 1.0, s * middle, middle + (s - 1.0) * (1.0 - middle))
            return out

        count += count % 2
        low = np.array([start, 1.0 if name == "b" else 0.0])
        part = block("triangle", [count, count], low, low + 1.0, graded if aligned else None)
        scene.substructure(name, part, LinearElastic(E, NU), degree=degree)
    scene.interface("joint", "a:y1", "b:y0", Contact(gap=0.0), space=space, overlap="partial")
    scene.fix("a:y0")
    scene.fix("b:y1", value=(0.0, -0.1))
    result = solve(assemble(scene), options=OPTIONS)
    parts = result.problem.substructures.items()
    return sum(float(result.displacements[k] @ (s.matrix @ result.displacements[k])) for k, s in parts)


def _mode_2(radius: float, poisson: float = NU, modulus: float = E) -> Array:
    """(3, 4): radial stress, shear and radial displacement at a radius, of Airy's functions r^2, r^4, r^-2, 1
    times cos 2 theta (Michell); plane strain. Shears go with sin 2 theta, the others with cos 2 theta."""
    r, kappa = radius, 3.0 - 4.0 * poisson
    twice_mu = modulus / (1.0 + poisson)
    return np.array(
        [
            [-2.0, 0.0, -6.0 * r**-4, -4.0 * r**-2],
            [2.0, 6.0 * r**2, -6.0 * r**-4, -2.0 * r**-2],
            np.array([-2.0 * r, (kappa - 3.0) * r**3, 2.0 * r**-3, (kappa + 1.0) / r]) / twice_mu,
        ]
    )


def uneven_pressure() -> tuple[float, float, float]:
    """Pressures of two rings that touch without friction: the mean and the part with cos 2 theta at the
    middle radius, and that in the bore that makes the latter half of the former."""
    inside, middle, outside = (_mode_2(r) for r in (INNER, MIDDLE, OUTER))
    # unknown: four coefficients of each ring, and the pressure in the bore if that between them is 1
    system, right = np.zeros((9, 9)), np.zeros(9)
    system[0, :4], system[0, 8] = inside[0], 1.0  # radial stress in the bore: minus its pressure
    system[1, :4] = inside[1]
    system[2, :4], right[2] = middle[0], -1.0
    system[3, :4] = middle[1]
    system[4, 4:8], right[4] = middle[0], -1.0
    system[5, 4:8] = middle[1]
    system[6, 4:8] = outside[0]
    system[7, 4:8] = outside[1]
    system[8, :4], system[8, 4:8] = middle[2], -middle[2]  # they stay together
    scale = np.abs(system).max(axis=0)
    bore = (np.linalg.solve(system / scale, right) / scale)[8]
    between = pressure_between()
    return between, 0.5 * between, 0.5 * between * float(bore)


def uneven_rings(space: Space, n: int, cell: str = "triangle") -> tuple[float, float, int, Result]:
    """Errors of the contact pressure p(theta) in L2 and the largest one, relative to its mean, and unknowns.

    Two rings under an uneven pressure in the bore, without friction; quadratic cells, 3 n and 2 n along the
    quarter and n, or of quadrilaterals n / 4, through the thickness.
    """

    def bend(x: Array) -> Array:
        angle = 0.5 * np.pi * x[:, 1]
        return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle)])

    mean, wave, in_bore = uneven_pressure()
    scene = Scene()
    for name, ends, along in (("a", (INNER, MIDDLE), 3), ("b", (MIDDLE, OUTER), 2)):
        low, high = np.array([ends[0], 0.0]), np.array([ends[1], 1.0])
        through = n if cell == "triangle" else n // 4
        part = block(cell, [through, along * n], low, high, bend, 2)
        scene.substructure(name, part, LinearElastic(E, NU), degree=2)
        scene.symmetry([f"{name}:y0", f"{name}:y1"])
    scene.interface("joint", "a:x1", "b:x0", Contact(gap=0.0), space=space)

    def cosine(x: Array) -> Array:
        return np.asarray(np.cos(2.0 * np.arctan2(x[:, 1], x[:, 0])))

    scene.pressure("a:x0", lambda x: BORE + in_bore * cosine(x))
    problem = assemble(scene)
    result = solve(problem, options=OPTIONS)
    joint = problem.interfaces["joint"]
    off = (-result.force("joint")[:, 0] - mean - wave * cosine(joint.points)) / mean
    return float(np.sqrt(joint.weights @ off**2 / joint.area)), float(np.abs(off).max()), problem.size, result
