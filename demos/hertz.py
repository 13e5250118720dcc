"""Cylinder on a block: Hertz pressure, then friction (Cattaneo and Mindlin), on meshes that do not match.

    ./run python demos/hertz.py [--quick] [--output DIR] [--no-figures]

Problem (N, mm, MPa; plane strain)
    NAFEMS R0094 benchmark 1: a cylinder of R = 50 mm, E = 210 000 MPa on a block of 200 mm by 100 mm,
    E = 70 000 MPa, nu = 0.3, pressed together with P = 35 kN per mm of thickness. With
    1/E* = (1 - nu^2)/E_1 + (1 - nu^2)/E_2 Hertz gives

        p(x) = p0 sqrt(1 - x^2/a^2),   a = sqrt(4 P R / (pi E*)) = 6.2146 mm,  p0 = 2 P/(pi a) = 3585.4 MPa.

    One half of the half cylinder and one half of the block are modelled. They are meshed separately with
    quadratic triangles (curved on the cylinder), which are small near the contact and grow with the distance.
    The load is a uniform pressure on the diametral plane of the cylinder; the block stands on a smooth plane.

What the closed form assumes
    The closed form holds for two half planes whose initial distance is the parabola x^2/(2R). Here the
    cylinder is round and the parts are finite, which changes the answer by the order of (a/R)^2: 1.5 % at
    this load. Therefore convergence is shown at a hundredth of the load, a/R = 0.0124, where the difference
    is 0.015 %. At the NAFEMS load the limits are checked twice, with the gap as meshed and with the parabola,
    so that this difference can be seen. Displacements and gaps are linear: the gap is measured along the
    normal of the block, before loading.

How a and p0 are measured more accurately than one facet
    The edge of the contact is inside a facet, and pressures are means over facets or values at points.
    Therefore the script looks neither for an edge nor for a largest value. It uses integrals of the pressure
    with smooth weights: these converge like the displacements (they are virtual works), even where single
    values oscillate. For a semi-ellipse

        int x^2 p dx = a^2/4 int p dx,            so   a = 2 sqrt(int x^2 p / int p),
        p0 = int phi p dx / int phi sqrt(1 - x^2/a^2) dx,   phi = (1 - (x/b)^2)^2 for |x| < b = 0.8 a.

    The first formula gives the width from the second moment, the second the height from the pressure in the
    middle. The total P is a third number, which equilibrium makes exact. In these integrals the pressure is
    constant on each facet.

    The error depends on where inside a facet the contact ends. Each mesh size is solved four times, with the
    edge moved by 0, 1/4, 1/2 and 3/4 of a facet; the root mean square of the four errors is shown.

The two interface spaces
    ``facets`` (one value per facet of the block) is stable: the pressure converges at first order in L2, as
    piecewise constants do. ``points`` imposes the law at quadrature points. On meshes that do not match it is
    not stable: the pressures at single points oscillate and do not converge, but their integrals do. With the
    default of three points per facet there are more conditions than nodes, and more iterations are needed;
    here quadrature_degree = 3 gives two points. For contact on non-matching meshes, use
    facets, or the default, mortar.

Friction
    Both parts have E = 210 000 MPa (Dundurs' beta = 0: pressure causes no slip, and friction does not change
    the pressure), mu = 0.3, P = 350 N/mm. Then Q = 0.5 mu P is applied and reversed through 0 to -0.5 mu P.
    According to Cattaneo 1938 and Mindlin 1949 the middle |x| < c sticks,

        q(x) = mu p0 [sqrt(1 - x^2/a^2) - c/a sqrt(1 - x^2/c^2)],   c/a = sqrt(1 - Q/(mu P)).

    According to Mindlin and Deresiewicz 1953, during unloading from the largest load Q* slip in the other
    direction starts at the edges, and the traction is reduced by twice the field of loading by (Q* - Q)/2.

    The parts must not rotate under Q. Therefore the cylinder carries a straight column that slides between
    smooth walls and is pressed from above, and the block slides on its smooth plane and is pulled along it.
    So P and Q are prescribed, not measured. The stick width c is measured like a, from mu p - q, which is a
    semi-ellipse of half-width c; during unloading from 2 mu p - |q* - q|.

    The energy that a cycle between -Q* and Q* dissipates follows from the compliance of half planes, which is
    the same in tangential and normal direction: with S = Q*/(mu P)

        W = 8 (mu P)^2 / (pi E*) [ (1 - S) ln(1 - S) / 2 + S/2 - S^2/4 ]   per thickness,

    It is measured as the work of q on the slip. The steps of Q are large: between two turning points slip has
    one direction, so that intermediate steps would not change the answer.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_frontend import (
    Amplitude,
    Contact,
    HistoryResult,
    LinearElastic,
    Options,
    Problem,
    Result,
    Scene,
    assemble,
    geometry,
    io,
    solve,
)
from dolfinx_frontend.scene.specs import Space

Array = npt.NDArray[np.float64]

# that points oscillate is shown here
warnings.filterwarnings("ignore", "interface 'contact': contact in the space 'points'")
# the load of NAFEMS strains the block by 3 %; the closed form is that of small strains, too
warnings.filterwarnings("ignore", "beyond the model: strain")

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "hertz"
RADIUS, HALF_WIDTH, HEIGHT = 50.0, 100.0, 100.0  # mm: cylinder, half the block
MU = 0.3
REACH = 1.35  # half-width of the contact faces, in a
PLACES = (0.0, 0.25, 0.5, 0.75)  # of the contact's edge in its facet


# %% Closed forms


@dataclass(frozen=True)
class Hertz:
    """Line contact of a cylinder and a plane, both elastic, in plane strain.

    Attributes
    ----------
    load
        P, force per thickness, N/mm.
    moduli
        E of cylinder and block, MPa.
    nu
        Poisson's ratio of both.
    """

    load: float
    moduli: tuple[float, float] = (210e3, 70e3)
    nu: float = 0.3

    @property
    def modulus(self) -> float:
        """E*, MPa."""
        return 1.0 / sum((1.0 - self.nu**2) / E for E in self.moduli)

    @property
    def a(self) -> float:
        """Half-width of the contact, mm."""
        return math.sqrt(4.0 * self.load * RADIUS / (math.pi * self.modulus))

    @property
    def p0(self) -> float:
        """Largest pressure, MPa."""
        return 2.0 * self.load / (math.pi * self.a)


NAFEMS = Hertz(35e3)
SMALL = Hertz(350.0)
RUBBED = Hertz(350.0, (210e3, 210e3))

Ellipses = list[tuple[float, float]]
"""Heights and half-widths of semi-ellipses; their sum is the field."""


def mindlin(hertz: Hertz, turns: Sequence[float]) -> Ellipses:
    """Tangential traction at the last of some turning points of Q / (mu P), with P constant.

    The path to the first turning point gives the field of loading by that Q; each further path adds twice
    the field of loading by half of its length. Valid as long as no path is longer than the one before it.
    """
    field: Ellipses = []
    for number, (start, end) in enumerate(zip((0.0, *turns), turns, strict=False)):
        factor = 1.0 if number == 0 else 2.0
        height = math.copysign(factor * MU * hertz.p0, end - start)
        c = stick(hertz, abs(end - start) / factor)
        field += [(height, hertz.a), (-height * c / hertz.a, c)]
    return field


def stick(hertz: Hertz, share: float) -> float:
    """Half-width c of the zone that sticks when Q rises from 0 to share mu P, mm."""
    return hertz.a * math.sqrt(1.0 - share)


def dissipation(hertz: Hertz, share: float) -> float:
    """Energy per thickness that a cycle of Q between -share mu P and share mu P dissipates, N."""
    shape = 0.5 * (1.0 - share) * math.log(1.0 - share) + 0.5 * share - 0.25 * share**2
    return 8.0 * (MU * hertz.load) ** 2 / (math.pi * hertz.modulus) * shape


def values(ellipses: Ellipses, x: Array) -> Array:
    """The field at x."""
    return np.asarray(sum(h * np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0)) for h, a in ellipses))


def integral(ellipses: Ellipses, x: Array) -> Array:
    """The integral of the field from 0 to x."""

    def one(h: float, a: float) -> Array:
        s = np.clip(x / a, -1.0, 1.0)
        return np.asarray(0.5 * h * a * (s * np.sqrt(1.0 - s**2) + np.arcsin(s)))

    return np.asarray(sum(one(h, a) for h, a in ellipses))


# %% Measuring


@dataclass(frozen=True)
class Strip:
    """Tractions along the contact, ordered by x; a half model is mirrored.

    Attributes
    ----------
    x, weights
        (m,), points or centroids of facets, and lengths; mm.
    facets
        Whether values are means over facets.
    """

    x: Array
    weights: Array
    facets: bool

    @property
    def edges(self) -> Array:
        """(m, 2), ends of the facets."""
        half = 0.5 * self.weights
        return np.stack([self.x - half, self.x + half], axis=1)

    def integral(self, values: Array, weight: Callable[[Array], Array]) -> float:
        """int weight(x) values dx."""
        if not self.facets:
            return float(self.weights @ (weight(self.x) * values))
        s, w = np.polynomial.legendre.leggauss(6)
        x = self.x[:, None] + 0.5 * self.weights[:, None] * s
        return float(values @ (0.5 * self.weights * (weight(x) @ w)))

    def half_width(self, values: Array) -> float:
        """Half-width of the semi-ellipse with this spread."""
        total, first, second = (
            self.integral(values, lambda x, k=k: x**k) for k in range(3)  # type: ignore[misc]
        )
        return 2.0 * math.sqrt(second / total - (first / total) ** 2)

    def height(self, values: Array, a: float) -> float:
        """Height of the semi-ellipse of half-width a with this weighted mean in the middle."""
        b = 0.8 * a

        def phi(x: Array) -> Array:
            return np.where(np.abs(x) < b, (1.0 - (x / b) ** 2) ** 2, 0.0)

        s, w = np.polynomial.legendre.leggauss(40)
        return self.integral(values, phi) / float(b * w @ (phi(b * s) * np.sqrt(1 - (b * s / a) ** 2)))

    def exact(self, ellipses: Ellipses) -> Array:
        """The closed form in the form of the values: at the points, or as means over the facets."""
        if not self.facets:
            return values(ellipses, self.x)
        ends = integral(ellipses, self.edges)
        return np.asarray((ends[:, 1] - ends[:, 0]) / self.weights)

    def difference(self, values: Array, ellipses: Ellipses) -> float:
        """Relative L2 error."""
        exact = self.exact(ellipses)
        return math.sqrt(float(self.weights @ (values - exact) ** 2 / (self.weights @ exact**2)))


def strip(problem: Problem, mirrored: bool) -> tuple[Strip, npt.NDArray[np.int64]]:
    """The contact as a strip, and which interface point each of its entries is."""
    contact = problem.interfaces["contact"]
    order = np.argsort(contact.points[:, 0])
    x, weights = contact.points[order, 0], contact.weights[order]
    if mirrored:
        order = np.concatenate([order[::-1], order])
        x, weights = np.concatenate([-x[::-1], x]), np.concatenate([weights[::-1], weights])
    return Strip(x, weights, contact.space == "facets"), order


# %% Geometry


def _mesh(
    name: str, draw: Callable[[Any], tuple[dict[str, list[int]], int]], h: float, near: float, far: float
) -> geometry.Part:
    """Quadratic triangles of size h within `near` of the origin, growing to `far`."""
    settings = {
        "Mesh.MeshSizeFromPoints": 0.0,
        "Mesh.MeshSizeFromCurvature": 0.0,
        "Mesh.MeshSizeExtendFromBoundary": 0.0,
        "Mesh.Algorithm": 6.0,
        "Mesh.SecondOrderIncomplete": 0.0,
    }
    with geometry.gmsh_session(name, settings) as gmsh:
        faces, surface = draw(gmsh.model.geo)
        gmsh.model.geo.synchronize()
        gmsh.model.addPhysicalGroup(2, [surface], name=name)
        for face, curves in faces.items():
            gmsh.model.addPhysicalGroup(1, curves, name=f"{name}:{face}")
        size = gmsh.model.mesh.field
        field = size.add("MathEval")
        size.setString(field, "F", f"Min({far}, {h} + 0.3 * Max(0, Sqrt(x*x + y*y) - {near}))")
        size.setAsBackgroundMesh(field)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        return geometry.from_gmsh(gmsh.model).parts[name]


def _outline(
    geo: Any, corners: Sequence[tuple[float, float]], names: Sequence[str], radius: float, cuts: int
) -> tuple[dict[str, list[int]], int]:
    """A surface inside corners; edges named "arc..." follow the cylinder, "...contact" has `cuts` facets."""
    points = [geo.addPoint(x, y, 0.0) for x, y in corners]
    centre = geo.addPoint(0.0, radius, 0.0)
    curves, faces = [], dict[str, list[int]]()
    for k, name in enumerate(names):
        start, end = points[k], points[(k + 1) % len(points)]
        round_one = name.startswith("arc")
        curve = geo.addCircleArc(start, centre, end) if round_one else geo.addLine(start, end)
        curves.append(curve)
        face = name.removeprefix("arc").strip()
        if face:
            faces.setdefault(face, []).append(curve)
        if face == "contact":
            geo.mesh.setTransfiniteCurve(curve, cuts + 1)
    surface = geo.addPlaneSurface([geo.addCurveLoop(curves)])
    return faces, surface


def cylinder(h: float, reach: float, near: float, whole: bool) -> geometry.Part:
    """Right half of a half cylinder; or (whole) a half cylinder under a column of the same width.

    Faces: contact (|x| < reach, facets of a length up to h), top, middle or walls.
    """
    angle = math.asin(reach / RADIUS)
    facets = math.ceil(angle * RADIUS / h)
    x, y = RADIUS * math.sin(angle), RADIUS * (1.0 - math.cos(angle))
    R = RADIUS

    def draw(geo: Any) -> tuple[dict[str, list[int]], int]:
        if not whole:
            corners = [(0.0, 0.0), (x, y), (R, R), (0.0, R)]
            return _outline(geo, corners, ["arc contact", "arc", "top", "middle"], R, facets)
        corners = [(-R, 2 * R), (-R, R), (-x, y), (x, y), (R, R), (R, 2 * R)]
        names = ["walls", "arc", "arc contact", "arc", "walls", "top"]
        return _outline(geo, corners, names, R, 2 * facets)

    return _mesh("cylinder", draw, h, near, R / 6)


def block(h: float, facets: int, near: float, whole: bool) -> geometry.Part:
    """Right half of the block, or the whole. Faces: contact, bottom and, of a half, middle."""
    w, W, H = facets * h, HALF_WIDTH, HEIGHT

    def draw(geo: Any) -> tuple[dict[str, list[int]], int]:
        if not whole:
            corners = [(0.0, 0.0), (0.0, -H), (W, -H), (W, 0.0), (w, 0.0)]
            return _outline(geo, corners, ["middle", "bottom", "", "", "contact"], RADIUS, facets)
        corners = [(-W, 0.0), (-W, -H), (W, -H), (W, 0.0), (w, 0.0), (-w, 0.0)]
        return _outline(geo, corners, ["", "bottom", "", "", "contact", ""], RADIUS, 2 * facets)

    return _mesh("block", draw, h, near, H / 8)


def bodies(hertz: Hertz, across: float, whole: bool) -> tuple[geometry.Part, geometry.Part, float]:
    """Cylinder and block with `across` facets of the block to a half-width a, and the facets' length h.

    The cylinder's facets are shorter by a fifth and reach a little further.
    """
    h = hertz.a / across
    facets = math.ceil(REACH * across)
    near = 1.5 * hertz.a
    return cylinder(0.8 * h, 1.003 * facets * h, near, whole), block(h, facets, near, whole), h


# %% Scenes


@dataclass(frozen=True)
class Answer:
    """One frictionless solution, measured."""

    hertz: Hertz
    h: float
    unknowns: int
    strip: Strip
    pressure: Array  # (strip), MPa
    result: Result
    scene: Scene

    @property
    def a(self) -> float:
        """Measured half-width, mm."""
        return self.strip.half_width(self.pressure)

    @property
    def p0(self) -> float:
        """Measured largest pressure, MPa."""
        return self.strip.height(self.pressure, self.a)

    @property
    def load(self) -> float:
        """Force that the contact carries, N/mm."""
        return float(self.strip.weights @ self.pressure)

    @property
    def errors(self) -> Array:
        """(3,): relative errors of a and p0, with signs, and of the pressure in L2."""
        hertz = self.hertz
        l2 = self.strip.difference(self.pressure, [(hertz.p0, hertz.a)])
        return np.array([self.a / hertz.a - 1.0, self.p0 / hertz.p0 - 1.0, l2])


def pressed(
    hertz: Hertz, upper: geometry.Part, lower: geometry.Part, law: Contact, space: Space
) -> Scene:
    """Cylinder on block under its load; the supports in horizontal direction are added later."""
    scene = Scene()
    scene.substructure("cylinder", upper, LinearElastic(hertz.moduli[0], hertz.nu))
    scene.substructure("block", lower, LinearElastic(hertz.moduli[1], hertz.nu))
    scene.interface(
        "contact",
        "block:contact",
        "cylinder:contact",
        law,
        space=space,
        quadrature_degree=3 if space == "points" else None,
        max_distance=100.0,  # at the ends of the faces the gap is many times the size of a facet
    )
    scene.fix("block:bottom", components=1)
    scene.pressure("cylinder:top", hertz.load / (2.0 * RADIUS))
    return scene


def press(
    hertz: Hertz, across: float, space: Space = "facets", gap: Any = None, rtol: float = 1e-6
) -> Answer:
    """The frictionless half model; `gap` None: as meshed."""
    upper, lower, h = bodies(hertz, across, whole=False)
    scene = pressed(hertz, upper, lower, Contact(gap=gap), space)
    scene.symmetry(["cylinder:middle", "block:middle"])
    problem = assemble(scene)
    result = solve(problem, options=Options(rtol=rtol))
    along, order = strip(problem, mirrored=True)
    pressure = -result.force("contact")[order, 0]
    return Answer(hertz, h, problem.size, along, pressure, result, scene)


# %% Friction: P first, then a cycle of Q

SHARE = 0.5  # largest Q / (mu P)
CYCLE = SHARE * np.array([0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0, 0.5, 1.0])  # Q / (mu P)
LOADED, UNLOADED, REVERSED, CLOSED = 2, 4, 6, 10  # steps
PATHS = {  # step -> turning points on the way to it, itself last
    LOADED: (LOADED,),
    UNLOADED: (LOADED, UNLOADED),
    REVERSED: (LOADED, REVERSED),
    CLOSED: (LOADED, REVERSED, CLOSED),
}


def shear_form(hertz: Hertz, step: int) -> Ellipses:
    """The closed form at a step."""
    return mindlin(hertz, [float(CYCLE[turn]) for turn in PATHS[step]])


@dataclass(frozen=True)
class Rubbing:
    """One cycle of tangential load, measured. Tractions are those on the block, (steps, strip), MPa."""

    hertz: Hertz
    h: float
    unknowns: int
    strip: Strip
    pressure: Array
    shear: Array
    slip: Array  # (steps, strip), mm, of the cylinder against the block
    result: HistoryResult

    def stick(self, step: int) -> tuple[float, float]:
        """c/a of the zone that has stuck since the last turning point: measured, and in closed form."""
        path = PATHS[step]
        before = path[-2] if len(path) > 1 else None
        start, traction, factor = 0.0, np.zeros_like(self.strip.x), 1.0
        if before is not None:
            start, traction, factor = float(CYCLE[before]), self.shear[before], 2.0
        way = float(CYCLE[step]) - start
        change = math.copysign(1.0, way) * (self.shear[step] - traction)
        c = self.strip.half_width(factor * MU * self.pressure[step] - change)
        exact = stick(self.hertz, abs(way) / factor)
        return c / self.strip.half_width(self.pressure[step]), exact / self.hertz.a

    def force(self, step: int) -> float:
        """Q / (mu P)."""
        total = self.strip.weights @ self.shear[step]
        return float(total / (MU * self.strip.weights @ self.pressure[step]))

    def shear_error(self, step: int) -> float:
        """Relative L2 error of the tangential traction, away from its kinks and the edge."""
        form = shear_form(self.hertz, step)
        largest = self.strip.exact(shear_form(self.hertz, LOADED))
        exact = self.strip.exact(form)
        kept = np.all([np.abs(np.abs(self.strip.x) - a) > 1.001 * self.h for _, a in form], axis=0)
        error = self.strip.weights[kept] @ (self.shear[step] - exact)[kept] ** 2
        return math.sqrt(float(error / (self.strip.weights @ largest**2)))

    @property
    def work(self) -> float:
        """Work of friction over the closed cycle, N."""
        slip = np.diff(self.slip[LOADED : CLOSED + 1], axis=0)
        return float(abs(np.sum((self.shear[LOADED + 1 : CLOSED + 1] * slip) @ self.strip.weights)))


def rub(hertz: Hertz, across: float, space: Space = "facets", rtol: float = 1e-5) -> Rubbing:
    """The whole model with friction, over a cycle of Q at constant P."""
    upper, lower, h = bodies(hertz, across, whole=True)
    scene = pressed(hertz, upper, lower, Contact(friction=MU), space)
    scene.fix("cylinder:walls", components=0)
    times = np.arange(len(CYCLE), dtype=np.float64)
    pull = MU * hertz.load / (2.0 * HALF_WIDTH)
    scene.traction("block:bottom", Amplitude(times, CYCLE) * (-pull, 0.0))
    problem = assemble(scene)
    result = solve(problem, times=times, options=Options(rtol=rtol))
    along, order = strip(problem, mirrored=False)
    force, jump = result.force("contact")[:, order], result.jump("contact")[:, order]
    # n is up, t1 is n turned by +90 degrees: -x
    return Rubbing(hertz, h, problem.size, along, -force[..., 0], -force[..., 1], -jump[..., 1], result)


# %% Report


class Steps:
    """Prints what is being done, and when it began."""

    def __init__(self) -> None:
        self.began = perf_counter()

    def __call__(self, what: str) -> None:
        print(f"\n[{perf_counter() - self.began:5.1f} s] {what}", flush=True)


@dataclass(frozen=True)
class Level:
    """The same mesh size with the contact's edge at four places of its facet."""

    h: float  # mean of the four, over a
    unknowns: int
    errors: Array  # (3,), rms of Answer.errors
    iterations: int  # the largest of the four


def level(hertz: Hertz, across: int, space: Space) -> Level:
    """Solve one mesh size."""
    answers = [press(hertz, across + place, space) for place in PLACES]
    assert all(answer.result.converged for answer in answers)
    return Level(
        float(np.mean([answer.h for answer in answers])) / hertz.a,
        answers[0].unknowns,
        np.sqrt(np.mean([answer.errors**2 for answer in answers], axis=0)),
        max(answer.result.iterations for answer in answers),
    )


def rates(levels: Sequence[Level]) -> Array:
    """(3,): slopes of the errors against h, by least squares in logarithms."""
    h = np.log([each.h for each in levels])
    errors = np.log([each.errors for each in levels])
    return np.asarray(np.polyfit(h, errors, 1)[0])


def round_gap(x: Array) -> Array:
    """Vertical distance of plane and cylinder, mm."""
    return np.asarray(RADIUS - np.sqrt(RADIUS**2 - x[:, 0] ** 2))


def parabola(x: Array) -> Array:
    """The distance in Hertz' theory, mm."""
    return np.asarray(x[:, 0] ** 2 / (2.0 * RADIUS))


# With the space points the gap is the distance to the closest point of the cylinder, which is too small by
# 3/4 (x/R)^2, 1 % at the edge; there the vertical distance is given.
GAPS: list[tuple[Space, str, Any]] = [
    ("facets", "as meshed", None),
    ("facets", "parabola", parabola),
    ("points", "vertical distance", round_gap),
    ("points", "parabola", parabola),
]


def report_nafems(answers: Sequence[Answer]) -> None:
    """Table of the benchmark."""
    first = answers[0]
    print(
        f"NAFEMS R0094-1: P = {NAFEMS.load / 1e3:g} kN/mm, facets of {first.h:.3f} mm = "
        f"a/{NAFEMS.a / first.h:g}, {first.unknowns} unknowns"
    )
    print(
        f"{'space':<8}{'gap':<20}{'a (mm)':>9}{'':>9}{'p0 (MPa)':>10}{'':>9}{'P (N/mm)':>10}"
        f"{'iterations':>12}"
    )
    print(f"{'Hertz':<28}{NAFEMS.a:>9.4f}{'':>9}{NAFEMS.p0:>10.1f}{'':>9}{NAFEMS.load:>10.0f}")
    for answer, (space, gap, _) in zip(answers, GAPS, strict=True):
        wide, high, _ = answer.errors
        print(
            f"{space:<8}{gap:<20}{answer.a:>9.4f}{wide:>+9.2%}{answer.p0:>10.1f}{high:>+9.2%}"
            f"{answer.load:>10.1f}{answer.result.iterations:>12}"
        )


def report_convergence(levels: dict[Space, list[Level]]) -> None:
    """Table of the errors on finer and finer meshes."""
    print(
        f"P = {SMALL.load:g} N/mm: a = {SMALL.a:.5f} mm, p0 = {SMALL.p0:.2f} MPa; "
        "rms errors of four meshes each"
    )
    for space, each in levels.items():
        print(f"{space:<10}{'h/a':>8}{'unknowns':>10}{'a':>10}{'p0':>10}{'p in L2':>10}{'iterations':>12}")
        for one in each:
            errors = "".join(f"{error:>10.3%}" for error in one.errors)
            print(f"{'':<10}{one.h:>8.4f}{one.unknowns:>10}{errors}{one.iterations:>12}")
        print(f"{'':<10}{'rate':>8}{'':>10}" + "".join(f"{rate:>10.2f}" for rate in rates(each)))


NAMES = {LOADED: "loaded", UNLOADED: "unloaded", REVERSED: "reversed", CLOSED: "closed"}


def report_friction(runs: Sequence[Rubbing]) -> None:
    """Table of the tangential answers."""
    hertz = runs[0].hertz
    print(
        f"P = {hertz.load:g} N/mm, mu = {MU}, Q up to {SHARE} mu P; a = {hertz.a:.4f} mm, "
        f"mu p0 = {MU * hertz.p0:.1f} MPa"
    )
    print(f"{'h/a':>7}{'step':>10}{'Q/(mu P)':>10}{'c/a':>9}{'closed form':>13}{'':>9}{'q in L2':>9}")
    for run in runs:
        for step, name in NAMES.items():
            c, form = run.stick(step)
            print(
                f"{run.h / hertz.a:>7.4f}{name:>10}{run.force(step):>10.4f}{c:>9.4f}"
                f"{form:>13.4f}{c / form - 1.0:>+9.2%}{run.shear_error(step):>9.2%}"
            )
        exact = dissipation(hertz, SHARE)
        print(
            f"{'':>7} energy of a cycle {1e3 * run.work:.3f} uJ/mm, closed form {1e3 * exact:.3f} uJ/mm "
            f"({run.work / exact - 1.0:+.2%}); {run.unknowns} unknowns x {len(CYCLE)} steps, "
            f"{run.result.iterations} iterations"
        )


# %% Figures


def _axes(rows: int, columns: int, width: float, height: float) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False).ravel()


def _steps(axis: Any, along: Strip, values: Array, a: float, label: str, colour: str) -> None:
    """Facet means as steps, values at points as dots."""
    if along.facets:
        edges = np.concatenate([along.edges[:1, 0], along.edges[:, 1]]) / a
        axis.stairs(values, edges, baseline=None, color=colour, lw=1.2, label=label)
    else:
        axis.plot(along.x / a, values, ".", color=colour, ms=4, label=label)


BLUE, ORANGE, GREY = "#1f5fa8", "#d0661c", "#555555"


def draw_pressure(answers: Sequence[Answer], path: Path) -> Path:
    """Pressure against Hertz, both spaces."""
    figure, axes = _axes(1, 2, 9.0, 3.6)
    x = np.linspace(-1.0, 1.0, 801)
    for axis, answer in zip(axes, (answers[0], answers[2]), strict=True):
        axis.plot(x, NAFEMS.p0 * np.sqrt(1.0 - x**2), color=GREY, lw=2.5, alpha=0.5, label="Hertz")
        space = "facets" if answer.strip.facets else "points"
        _steps(axis, answer.strip, answer.pressure, NAFEMS.a, space, BLUE)
        axis.set(xlabel="x / a", ylabel="pressure (MPa)", xlim=(-1.3, 1.3))
        axis.set_title(f"{space}: p0 {answer.errors[1]:+.2%}, a {answer.errors[0]:+.2%}", fontsize=10)
        axis.grid(color="#dddddd", lw=0.6)
        axis.set_axisbelow(True)
        axis.legend(loc="lower center")
    return _write(figure, path)


def draw_convergence(levels: dict[Space, list[Level]], path: Path) -> Path:
    """Errors against mesh size."""
    figure, axes = _axes(1, 2, 9.0, 3.8)
    for axis, (space, each) in zip(axes, levels.items(), strict=True):
        h = np.array([one.h for one in each])
        errors = np.array([one.errors for one in each])
        for k, (name, colour) in enumerate((("half-width a", BLUE), ("p0", ORANGE), ("p in L2", GREY))):
            axis.loglog(h, errors[:, k], "o-", color=colour, ms=4, lw=1.2, label=name)
        for power, at in ((1, errors[0, 2]), (2, errors[0, 1])):
            axis.loglog(h, 0.5 * at * (h / h[0]) ** power, ":", color="black", lw=0.9)
            axis.annotate(f"$h^{power}$", (h[1], 0.3 * at * (h[1] / h[0]) ** power))
        axis.set(xlabel="h / a", ylabel="relative error (rms)", title=space, ylim=(1e-5, 0.3))
        axis.set_xticks(h, [f"1/{1 / value:.0f}" for value in h], minor=False)
        axis.minorticks_off()
        axis.grid(color="#dddddd", lw=0.6)
        axis.set_axisbelow(True)
        axis.legend(loc="lower right", fontsize=8)
    return _write(figure, path)


def draw_shear(run: Rubbing, path: Path) -> Path:
    """Tangential traction at three times, against the closed form."""
    figure, axes = _axes(1, 3, 11.0, 3.4)
    hertz = run.hertz
    x = np.linspace(-1.0, 1.0, 2001)
    scale = MU * hertz.p0
    for axis, step in zip(axes, (LOADED, UNLOADED, REVERSED), strict=True):
        exact = values(shear_form(hertz, step), x * hertz.a) / scale
        axis.plot(x, np.sqrt(1.0 - x**2), "--", color="#999999", lw=0.9, label="$\\pm\\mu p$")
        axis.plot(x, -np.sqrt(1.0 - x**2), "--", color="#999999", lw=0.9)
        _steps(axis, run.strip, run.shear[step] / scale, hertz.a, "computed", BLUE)
        axis.plot(x, exact, color="black", ls=(0, (4, 3)), lw=1.2, zorder=10, label="closed form")
        axis.set(xlabel="x / a", ylabel="q / ($\\mu p_0$)", xlim=(-1.2, 1.2), ylim=(-1.1, 1.1))
        axis.set_title(f"{NAMES[step]}: Q = {CYCLE[step]:g} $\\mu$P", fontsize=10)
        axis.grid(color="#dddddd", lw=0.6)
        axis.set_axisbelow(True)
    axes[0].legend(loc="lower center", fontsize=8)
    return _write(figure, path)


def _write(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=150)
    return path


# %% The demo


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder of figures and fields")
    parser.add_argument("--no-figures", action="store_true", help="write no figures")
    parser.add_argument("--quick", action="store_true", help="coarser meshes: for tests")
    return parser.parse_args(given)


def main(given: Sequence[str] | None = None) -> None:
    """The whole story."""
    options = arguments(given)
    output: Path = options.output
    output.mkdir(parents=True, exist_ok=True)
    say = Steps()

    say("Hertz: the NAFEMS benchmark")
    answers = [press(NAFEMS, 16, space, gap) for space, _, gap in GAPS]
    report_nafems(answers)

    say("Hertz: convergence, at a hundredth of the load")
    sizes = (4, 8, 16) if options.quick else (4, 8, 16, 32)
    spaces: tuple[Space, ...] = ("facets", "points")
    levels = {space: [level(SMALL, across, space) for across in sizes] for space in spaces}
    report_convergence(levels)

    say("Cattaneo and Mindlin: a cycle of tangential load")
    runs = [rub(RUBBED, across + 0.25) for across in ((8, 16) if options.quick else (8, 16, 32))]
    report_friction(runs)

    say(f"writing to {output}")
    written = [io.write_fields(answers[0].result, output / "hertz.vtm")]
    last = runs[-1]
    for step, name in NAMES.items():
        written.append(io.write_fields(last.result, output / f"friction_{name}.vtm", step=step))
    if not options.no_figures:
        written += [
            draw_pressure(answers, output / "hertz_pressure.png"),
            draw_convergence(levels, output / "hertz_convergence.png"),
            draw_shear(last, output / "cattaneo_mindlin.png"),
        ]
    for path in written:
        print(f"wrote {path.name}")
    check(answers, levels, runs)
    say("all checks passed")


def check(
    answers: Sequence[Answer], levels: dict[Space, list[Level]], runs: Sequence[Rubbing]
) -> None:
    """The limits: 1 % for p0, 0.5 % for a; second order of both and first order of p; c within 0.5 %."""
    for answer in answers:
        assert answer.result.converged
        assert abs(answer.errors[0]) < 0.005, f"a: {answer.errors[0]:+.3%}"
        assert abs(answer.errors[1]) < 0.01, f"p0: {answer.errors[1]:+.3%}"
        assert abs(answer.load / NAFEMS.load - 1.0) < 1e-4, f"P: {answer.load}"
    for each in levels.values():
        assert each[-1].errors[0] < 0.005 and each[-1].errors[1] < 0.01
    order = rates(levels["facets"])
    assert np.all(order > (1.7, 1.7, 0.85)), f"rates {order}"
    for run in runs[1:]:
        assert run.result.converged
        for step in NAMES:
            assert abs(run.force(step) - CYCLE[step]) < 1e-4, f"Q: {run.force(step)}"
            c, form = run.stick(step)
            assert abs(c / form - 1.0) < 0.005, f"c: {c / form - 1.0:+.3%}"
            assert run.shear_error(step) < 0.02, f"q: {run.shear_error(step):.3%}"
        assert abs(run.work / dissipation(run.hertz, SHARE) - 1.0) < 0.04, f"W: {run.work}"


if __name__ == "__main__":
    main()
