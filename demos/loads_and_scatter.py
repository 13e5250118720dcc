"""Five small scenes that engineers ask for, each with a closed form and a picture.

    ./run python demos/loads_and_scatter.py [--output DIR] [--no-figures]

All in N, mm, MPa, K.

Temperature
    A steel bolt (E = 200 000, A = 100, alpha = 12e-6) in an aluminium sleeve (70 000, 400, 23e-6), both
    50 long and 100 warmer, with one head: they take F = (alpha_s - alpha_b) dT / (1 / E_b A_b + 1 / E_s
    A_s) = 12 833.33 from each other.
Loads and supports
    A bar of 10 x 10 x 80 whose root is fixed and whose end is a rigid face, which a force of 100 pulls
    down from a point 60 beyond it. The root takes the force and its moment: 100 * 140.
Bolts
    M12 x 1.75, tightened by 80 N m; the friction of thread and head is lognormal (0.12, cov 0.2; 0.14,
    cov 0.15). The force F = M / (P / 2 pi + mu_t d2 / (2 cos 30) + mu_h D / 2) of VDI 2230 has, by
    quadrature, a mean and a deviation.
Random stiffness
    A rod of 10 whose modulus is a lognormal field of mean 2, cov 0.3, correlation exp(-|dx| / 5), pulled
    by 0.1. 1 / E is lognormal as well, so that mean and deviation of the displacement are integrals at
    every place.
Axisymmetry
    A sphere of R = 50 on a plate, both of E = 210 000: Hertz gives the radius a = (3 P R / 4 E*)^(1/3)
    and the pressure p0 sqrt(1 - r^2 / a^2), p0 = 3 P / (2 pi a^2).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import dolfinx_frontend as lf
import hertz
from dolfinx_frontend import figures, geometry
from dolfinx_frontend.figures.canvas import LINES, save, sheet

Array = npt.NDArray[np.float64]

OUTPUT = Path(__file__).resolve().parents[1] / "build" / "output" / "loads_and_scatter"


class Checked(NamedTuple):
    """A number that was computed, the one it should be, and how far off it may be, relatively."""

    what: str
    found: float
    exact: float
    tolerance: float

    def __str__(self) -> str:
        off = abs(self.found / self.exact - 1.0)
        return f"{self.what:<42} {self.found:12.5g}   exact {self.exact:12.5g}   off by {off:.1e}"


# %% Temperature


def temperature(folder: Path | None) -> list[Checked]:
    """A warm bolt in a sleeve."""
    scene = lf.Scene()
    dT, length = 100.0, 50.0
    parts = {"bolt": ((10, 10), (0, 0), 200e3, 12e-6), "sleeve": ((20, 20), (14, -5), 70e3, 23e-6)}
    for name, (section, corner, E, alpha) in parts.items():
        box = geometry.box((*section, length), (3, 3, 6), origin=(*corner, 0))
        scene.substructure(name, box, lf.LinearElastic(E, 0.3, alpha=alpha), degree=1)
        scene.temperature(name, dT)
        scene.symmetry([f"{name}:x0", f"{name}:y0", f"{name}:z0"])
    scene.plane(["bolt:z1", "sleeve:z1"], tilts=False, name="head")
    result = lf.solve(lf.assemble(scene))
    force = result.readings("head[bolt:z1]").interfaces["head[bolt:z1]"].values["force_z"]
    exact = (23e-6 - 12e-6) * dT / (1 / (200e3 * 100) + 1 / (70e3 * 400))
    if folder is not None:
        figures.deformed_figure(
            result, folder / "temperature.png", label="u_z (mm)", quantity=lambda u: u[:, 2],
            title="100 K warmer",
        )
    return [Checked("temperature: force of the bolt (N)", abs(force), exact, 1e-8)]


# %% Loads and supports


def remote_force(folder: Path | None) -> list[Checked]:
    """A bar that a force at a point beyond its end bends."""
    scene = lf.Scene()
    bar = geometry.box((80, 10, 10), (16, 2, 2), cell="hexahedron")
    scene.substructure("bar", bar, lf.LinearElastic(200e3, 0.3))
    scene.fix("bar:x0", name="root")
    scene.rigid("bar:x1", name="end")
    scene.force("bar:x1", (0, 0, -100.0), point=(140, 5, 5), name="pull")
    result = lf.solve(lf.assemble(scene))
    root = result.readings("root").interfaces["root"].values
    if folder is not None:
        figures.deformed_figure(
            result, folder / "remote_force.png", view=(-0.35, -1.0, 0.3),
            title="100 N beyond a rigid end face", arrows=[((140, 5, 22), (140, 5, 5))],
        )
    return [
        Checked("loads: force at the root (N)", abs(root["force_z"]), 100.0, 1e-8),
        Checked("loads: moment at the root (N mm)", abs(root["moment_y"]), 100.0 * 140, 1e-8),
    ]


# %% Bolts


def tightening(folder: Path | None) -> list[Checked]:
    """The force of a bolt that is tightened by a torque with random friction."""
    M, d, pitch = 80e3, 12.0, 1.75
    thread, head = lf.LogNormal("mu_thread", 0.12, cov=0.2), lf.LogNormal("mu_head", 0.14, cov=0.15)
    law = lf.Preload(torque=M, mu_thread=thread, mu_head=head, d=d, pitch=pitch)
    scene = lf.Scene()
    for name, z in (("lower", 0.0), ("upper", 20.0)):
        box = geometry.box((10, 10, 20), (1, 1, 2), origin=(0, 0, z))
        scene.substructure(name, box, lf.LinearElastic(200e3, 0.0), degree=1)
        scene.symmetry([f"{name}:x0", f"{name}:y0"])
    scene.interface("bolt", "lower:z1", "upper:z0", law)
    scene.fix(["lower:z0", "upper:z1"], components=2)
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=lf.Chaos(order=3, check_points=0), progress=False)
    weights = problem.interfaces["bolt"].weights
    germs = chaos.space.sample_sobol(2**15, 5)
    force: Array = chaos.at(germs).force("bolt")[..., 0] @ weights / 1e3
    # VDI 2230: pitch diameter, and mean diameter of the bearing area under the head
    d2, bearing = d - 0.75 * math.sqrt(0.75) * pitch, 1.3 * d
    nodes, of_nodes = np.polynomial.hermite_e.hermegauss(40)
    of_nodes = of_nodes / of_nodes.sum()
    s, t = (math.sqrt(math.log1p(c * c)) for c in (0.2, 0.15))
    mu_t, mu_h = 0.12 * np.exp(s * nodes - s * s / 2), 0.14 * np.exp(t * nodes - t * t / 2)
    arm = pitch / (2 * math.pi) + mu_t[:, None] * d2 / (2 * math.cos(math.pi / 6)) + mu_h[None] * bearing / 2
    exact = M / arm / 1e3
    mean = float(of_nodes @ exact @ of_nodes)
    std = math.sqrt(of_nodes @ (exact - mean) ** 2 @ of_nodes)
    if folder is not None:
        x = np.linspace(force.min(), force.max(), 300)
        shape = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * math.sqrt(2 * math.pi))
        figures.density_figure(
            {"normal density of the same moments": (x, shape)},
            folder / "tightening.png",
            "force of the bolt (kN)",
            samples=force,
            samples_label="M12 x 1.75, 80 N m, friction random",
            title=f"{mean:.2f} kN, deviation {std:.2f} kN",
        )
    return [
        Checked("bolts: mean of the force (kN)", float(force.mean()), mean, 2e-3),
        Checked("bolts: deviation of the force (kN)", float(force.std()), std, 2e-3),
    ]


# %% Random stiffness


def rod_with_a_field(folder: Path | None) -> list[Checked]:
    """A rod whose modulus is a random field."""
    length, force, mean_E, cov, scale = 10.0, 0.1, 2.0, 0.3, 5.0
    field = lf.RandomField(
        "E", mean_E, cov=cov, length=scale, distribution="lognormal", variance_captured=0.95
    )
    scene = lf.Scene()
    rod = geometry.box((length, 1, 1), (30, 1, 1))
    scene.substructure("rod", rod, lf.LinearElastic(field, 0.0), degree=1)
    scene.symmetry(["rod:x0", "rod:y0", "rod:z0"])
    scene.force("rod:x1", (force, 0, 0))
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, chaos=3, progress=False)
    places = problem.substructures["rod"].dof_coordinates
    axis = np.flatnonzero((abs(places[:, 1]) < 1e-9) & (abs(places[:, 2]) < 1e-9))
    axis = axis[np.argsort(places[axis, 0])]
    x = places[axis, 0]
    modes = chaos.coefficients("rod").reshape(-1, 3, len(chaos.basis))[axis, 0]
    spread = np.linalg.norm(modes[:, 1:], axis=1)

    def deviation(end: float) -> float:
        """Of the integral of 1 / E from 0 to a place."""
        r, w = np.polynomial.legendre.leggauss(60)
        r, w = 0.5 * end * (r + 1.0), 0.5 * end * w
        of_pairs = (1 + cov**2) ** 2 * ((1 + cov**2) ** np.exp(-r / scale) - 1)
        return force / mean_E * math.sqrt(2.0 * float(w @ ((end - r) * of_pairs)))

    exact, exact_spread = force / mean_E * (1 + cov**2) * x, np.array([deviation(float(end)) for end in x])
    if folder is not None:
        figure = sheet(6.5, 4.0)
        axes = figure.add_subplot()
        axes.fill_between(x, modes[:, 0] - spread, modes[:, 0] + spread, color=LINES[0], alpha=0.2, lw=0)
        axes.plot(x, modes[:, 0], color=LINES[0], label="mean, and a deviation about it (chaos)")
        for sign in (-1, 1):
            label = "closed form" if sign > 0 else None
            axes.plot(x[::3], (exact + sign * exact_spread)[::3], "o", ms=3, color=LINES[1], label=label)
        germs = chaos.space.sample(6, 3)
        for number, each in enumerate(chaos.at(germs).displacement("rod").reshape(6, -1, 3)[:, axis, 0]):
            label = "six rods" if number == 0 else None
            axes.plot(x, each, color="#888888", lw=0.7, label=label)
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("displacement (mm)")
        axes.legend()
        axes.set_title("A rod whose modulus is a random field")
        save(figure, folder / "random_field_rod.png")
    lost = chaos.random.lost["E"]
    # what the modes of the field lose is lost of its variance at a point
    off, end = 1.5 * cov**2 * lost, float(exact[-1])
    return [
        Checked("random stiffness: mean of the end (mm)", float(modes[-1, 0]), end, off),
        Checked("random stiffness: deviation (mm)", float(spread[-1]), float(exact_spread[-1]), 5e-3),
    ]


# %% Axisymmetry


class Sphere(NamedTuple):
    """A sphere on a plate: what Hertz says, and what was found, by facets."""

    a: float
    p0: float
    load: float
    radii: Array
    areas: Array
    pressure: Array

    @property
    def found_a(self) -> float:
        """Radius of the contact by the second moment of the pressure, of which a hemisphere has 2 a^2 / 5."""
        return math.sqrt(2.5 * float(self.areas @ (self.radii**2 * self.pressure)) / self.found_load)

    @property
    def found_load(self) -> float:
        return float(self.areas @ self.pressure)

    @property
    def found_p0(self) -> float:
        """Largest pressure, of the hemisphere with this force and radius."""
        return 1.5 * self.found_load / (math.pi * self.found_a**2)


def sphere_on_a_plate(across: float = 12.0, load: float = 1000.0) -> Sphere:
    """Solve with `across` facets to the radius of the contact."""
    R, E, nu = hertz.RADIUS, 210e3, 0.3
    modulus = E / (2 * (1 - nu**2))
    a = (0.75 * load * R / modulus) ** (1 / 3)
    h = a / across
    facets = math.ceil(hertz.REACH * across)
    scene = lf.Scene(axisymmetric=True)
    # the sections of sphere and plate are those of the half cylinder and the half block
    upper = hertz.cylinder(0.8 * h, 1.003 * facets * h, 1.5 * a, whole=False)
    scene.substructure("sphere", upper, lf.LinearElastic(E, nu))
    scene.substructure("plate", hertz.block(h, facets, 1.5 * a, whole=False), lf.LinearElastic(E, nu))
    sides = ("plate:contact", "sphere:contact")
    scene.interface("contact", *sides, lf.Contact(), space="facets", max_distance=100.0)
    scene.fix("plate:bottom", components=1)
    scene.force("sphere:top", (0.0, -load), name="press")
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    contact = problem.interfaces["contact"]
    order = np.argsort(contact.points[:, 0])
    pressure = -result.force("contact")[order, 0]
    radii, areas = contact.points[order, 0], contact.weights[order]
    return Sphere(a, 1.5 * load / (math.pi * a * a), load, radii, areas, pressure)


def sphere(folder: Path | None) -> list[Checked]:
    """Pressure under a sphere."""
    found = sphere_on_a_plate()
    if folder is not None:
        figure = sheet(6.5, 4.0)
        axes = figure.add_subplot()
        r = np.linspace(0.0, found.a, 400)
        axes.plot(r, found.p0 * np.sqrt(1 - (r / found.a) ** 2), color=LINES[0], label="Hertz")
        axes.plot(found.radii, found.pressure, "o", ms=4, color=LINES[1], label="means over facets")
        axes.set_xlim(0.0, 1.3 * found.a)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("r (mm)")
        axes.set_ylabel("pressure (MPa)")
        axes.legend()
        axes.set_title(f"A sphere of 50 mm on a plate, {found.load:.0f} N: a = {found.a:.3f} mm")
        save(figure, folder / "sphere.png")
    h = 1.0 / 12.0
    return [
        Checked("axisymmetry: force of the contact (N)", found.found_load, found.load, 1e-5),
        Checked("axisymmetry: radius of the contact (mm)", found.found_a, found.a, 0.3 * h**2),
        Checked("axisymmetry: largest pressure (MPa)", found.found_p0, found.p0, 0.6 * h**2),
    ]


SCENES: tuple[Callable[[Path | None], list[Checked]], ...] = (
    temperature,
    remote_force,
    tightening,
    rod_with_a_field,
    sphere,
)


def main() -> None:
    """Solve, draw and check all of them."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--no-figures", action="store_true")
    given: Any = parser.parse_args()
    wrong = []
    for scene in SCENES:
        for each in scene(None if given.no_figures else given.output):
            print(each)
            if not abs(each.found / each.exact - 1.0) <= each.tolerance:
                wrong.append(each.what)
    if not given.no_figures:
        print(f"figures are in {given.output}")
    if wrong:
        raise SystemExit(f"wrong: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
