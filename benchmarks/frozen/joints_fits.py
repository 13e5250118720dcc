"""Engineers' joints of the frozen corpus: press fits, also turned, wedges and tapers, pins in lugs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import dolfinx_frontend as lf

from .registry import Right, scene
from .shapes import BALANCE, STEEL, annulus, arrived, ramp, read, solved, taper

# --- press fits: a shaft of 4 .. 10 in a hub of 10 .. 25, interference 0.01 ---

E, NU, INNER, FIT, OUTER, OVERSIZE = 210e3, 0.3, 4.0, 10.0, 25.0, 0.01


def lame(
    r: float, inner: float, outer: float, p_inner: float, p_outer: float, young: float = E, nu: float = NU
) -> float:
    """Radial displacement of a tube in plane strain (Lame)."""
    area = outer**2 - inner**2
    uniform = (1 - 2 * nu) * (p_inner * inner**2 - p_outer * outer**2) / area * r
    return (1 + nu) / young * (uniform + (p_inner - p_outer) * inner**2 * outer**2 / (area * r))


def fit_pressure(held: bool, young: float = E, shaft: float = E) -> float:
    """Pressure of the fit; ``held``: the rim of the hub is fixed."""

    def overlap(p: float) -> float:
        rim = (
            p * lame(OUTER, FIT, OUTER, 1.0, 0.0, young) / lame(OUTER, FIT, OUTER, 0.0, -1.0, young)
            if held
            else 0.0
        )
        hub = lame(FIT, FIT, OUTER, p, rim, young)
        return lame(FIT, INNER, FIT, 0.0, p, shaft) - hub + OVERSIZE

    return -overlap(0.0) / (overlap(1.0) - overlap(0.0))


def ring_fit(
    load: Any = None,
    *,
    n: tuple[int, int] = (24, 32),
    mu: float | None = 0.15,
    mm: float = 1.0,
    held: bool = True,
    hub: float = E,
    shaft: float = E,
    degree: int = 2,
    tresca: float | None = None,
) -> lf.Problem:
    """Whole rings in the plane; ``load``: torque per thickness, N, in any unit of length."""
    assembly = lf.Scene()
    rings = (("shaft", INNER, FIT, (3, n[0]), shaft), ("hub", FIT, OUTER, (4, n[1]), hub))
    for name, low, high, divisions, young in rings:
        part = annulus(low * mm, high * mm, 2 * math.pi, divisions)
        assembly.substructure(name, part, lf.LinearElastic(young / mm**2, NU), degree=degree)
    law = lf.Contact(gap=-OVERSIZE * mm, friction=mu, threshold=None if tresca is None else tresca / mm**2)
    assembly.interface("fit", "shaft:outer", "hub:inner", law)
    assembly.fix("hub:outer", name="rim")
    if load is not None:
        assembly.force("shaft:inner", (0.0, 0.0), load * 1.0, name="torque")
    return lf.assemble(assembly)


HELD = fit_pressure(True)
SLIPS = 2 * math.pi * FIT**2 * 0.15 * HELD
"""N: torque per thickness at which the fit slips."""
LAME, CHORDS = "Lame, plane strain", 2e-3
"""What parabolic arcs of 24 to 32 cells with quadratic displacements are off."""


def turned(share: float) -> dict[str, Right]:
    return {
        "fit.pressure_mean@0": Right(HELD, CHORDS, LAME),
        "fit.pressure_mean@1": Right(HELD, CHORDS, LAME),
        "rim.moment_z@1": Right(-share * SLIPS, 1e-4, "balance of the torque"),
    }


@scene("joints", right=turned(0.5))
def press_fit_turned_half(rtol: float) -> Any:
    problem = ring_fit(lf.Amplitude([1, 2], [0, 0.5 * SLIPS]))
    return read(solved(problem, rtol, [1.0, 2.0]), *turned(0.5))


@scene("joints", right=turned(0.95))
def press_fit_turned_nearly(rtol: float) -> Any:
    problem = ring_fit(lf.Amplitude([1, 2], [0, 0.95 * SLIPS]))
    return read(solved(problem, rtol, [1.0, 2.0]), *turned(0.95))


@scene("joints", right={"steps": Right(1, 0.0, "slip torque 2 pi r^2 mu p (Lame)")})
def press_fit_turned_too_far(rtol: float) -> Any:
    """120 % of the slip torque."""
    return arrived(ring_fit(lf.Amplitude([1, 2], [0, 1.2 * SLIPS])), rtol, [1.0, 2.0])


BACK = {
    "rim.moment_z@1": Right(-0.6 * SLIPS, 1e-4, "balance"),
    "rim.moment_z@2": Right(0.6 * SLIPS, 1e-4, "balance"),
    "fit.pressure_mean@3": Right(1e6 * HELD, CHORDS, LAME),
}


@scene("joints", right=BACK)
def press_fit_turned_to_and_fro(rtol: float) -> Any:
    """In N, m, and back to no torque."""
    problem = ring_fit(lf.Amplitude([1, 2, 3, 4], [0, 0.6, -0.6, 0]) * SLIPS, mm=1e-3)
    return read(solved(problem, rtol, [1.0, 2.0, 3.0, 4.0]), *BACK)


@scene("joints", right={"fit.pressure_mean": Right(fit_pressure(True, shaft=E / 1e6), CHORDS, LAME)})
def press_fit_of_a_soft_bush(rtol: float) -> Any:
    """A bush a million times softer than the hub."""
    return read(solved(ring_fit(shaft=E / 1e6, mu=0.5), rtol), "fit.pressure_mean")


@scene(
    "joints",
    right={
        "rim.moment_z@1": Right(-1000.0, 1e-4, "balance"),
        "fit.pressure_mean@1": Right(HELD, CHORDS, LAME),
    },
)
def press_fit_tresca(rtol: float) -> Any:
    """A threshold of 3 MPa, whose slip torque is 1 885 N."""
    problem = ring_fit(lf.Amplitude([1, 2], [0, 1000.0]), mu=None, tresca=3.0, n=(16, 20))
    return read(solved(problem, rtol, [1.0, 2.0]), "rim.moment_z@1", "fit.pressure_mean@1")


def sleeve(pull: Any, *, mu: Any = 0.15, degree: int = 2, warm: Any = None, n: int = 8) -> lf.Problem:
    """Sections (r, z) of shaft and hub, 8 mm long; ``pull``: N along the shaft; else both ends are held."""
    assembly = lf.Scene(axisymmetric=True)
    for name, low, high in (("shaft", INNER, FIT), ("hub", FIT, OUTER)):
        box = lf.geometry.box((high - low, 8.0), (6, n + 2 * (name == "hub")), (low, 0.0))
        assembly.substructure(name, box, lf.LinearElastic(E, NU, alpha=1e-5), degree=degree)
    gap = -OVERSIZE if warm is None else 0.0
    assembly.interface("fit", "shaft:x1", "hub:x0", lf.Contact(gap=gap, friction=mu))
    ends = (
        ["hub:y0"]
        if pull is not None
        else [f"{name}:{end}" for name in ("shaft", "hub") for end in ("y0", "y1")]
    )
    assembly.fix(ends, components=1, name="ground")
    if pull is not None:
        assembly.force("shaft:y1", (0.0, pull * 1.0), name="pull")
    if warm is not None:
        assembly.temperature("shaft", warm * 1.0)
    return lf.assemble(assembly)


FREE = fit_pressure(False)
GRIP = 2 * math.pi * FIT * 8.0 * 0.15 * FREE
"""N: about the force at which the shaft is pulled out; the ends of the fit press harder than Lame."""
SLEEVE = {
    "fit.force_y@1": Right(-0.5 * GRIP, BALANCE, "balance of the shaft"),
    "fit.force_y@2": Right(0.0, 1e-3, "balance"),
}


@scene("joints", right={"fit.pressure_mean": Right(FREE, 1e-4, LAME)})
def sleeve_pressed_on(rtol: float) -> Any:
    return read(solved(sleeve(None, mu=None), rtol), "fit.pressure_mean")


@scene("joints", right=SLEEVE)
def sleeve_pulled_and_let_go(rtol: float) -> Any:
    return read(solved(sleeve(lf.Amplitude([1, 2, 3], [0, 0.5, 0]) * GRIP), rtol, [1.0, 2.0, 3.0]), *SLEEVE)


@scene(
    "joints",
    right={"steps": Right(1, 0.0, "mu p A with twice the margin that the ends can press harder")},
    known_bad="the first step, which has an answer, stagnates with the second",
)
def sleeve_pulled_out(rtol: float) -> Any:
    return arrived(sleeve(lf.Amplitude([1, 2], [0, 2.0]) * GRIP), rtol, [1.0, 2.0])


WARM = {
    "fit.pressure_mean@0": Right(
        FREE * 50 * 1e-5 * 1.3 * FIT / OVERSIZE, 1e-4, "Lame: the shaft would grow by (1 + nu) alpha T r"
    ),
    "fit.pressure_mean@1": Right(0.0, 1e-6, "cold again: open"),
}


@scene("joints", right=WARM)
def sleeve_on_a_warm_shaft(rtol: float) -> Any:
    """50 K on the shaft, held axially, and cold again; no friction."""
    return read(solved(sleeve(None, mu=None, warm=ramp(0, 50, 0)), rtol, [1.0, 2.0]), *WARM)


# --- wedges --------------------

LEAN = math.radians(10)
PUSH = 1000.0


def wedge(
    path: list[float],
    *,
    mu: float = 0.3,
    n: int = 6,
    degree: int = 2,
    block: bool = False,
    axis: bool = False,
) -> lf.Problem:
    """Half a wedge (or a cone of 5 mm at its tip) of 20 mm, pushed along an inclined wall by 1000 N."""
    assembly = lf.Scene(axisymmetric=axis)
    start = 5.0 if axis else 0.0
    part = taper((5.0, 20.0), (n, 3 * n), LEAN, (start, 0.0))
    assembly.substructure("wedge", part, lf.LinearElastic(70e3, 0.3), degree=degree)
    if not axis:
        assembly.fix("wedge:x0", 0.0, components=0, name="middle")
    if block:
        wall = taper((15.0, 20.0), (n, 2 * n + 1), LEAN, (start + 5.0, 0.0), side="x0")
        assembly.substructure("block", wall, STEEL, degree=degree)
        assembly.fix("block:x1", name="ground")
        assembly.interface("wall", "wedge:x1", "block:x0", lf.Contact(gap=0.0, friction=mu))
    else:
        assembly.interface("wall", "wedge:x1", lf.Contact(gap=0.0, friction=mu))
    assembly.force("wedge:y1", (0.0, lf.Amplitude(list(range(len(path))), path) * -PUSH), name="push")
    return lf.assemble(assembly)


SLID = PUSH / (math.sin(LEAN) + 0.3 * math.cos(LEAN))
JAM = math.tan(LEAN)
SLIDES, JAMS = (
    "vertical balance while all of the wall slips, T = mu N",
    "balance without a load: T / N = tan 10 degrees",
)


def pressed(path: list[float], rtol: float, **shape: Any) -> dict[str, Any]:
    """A history in quarters; N at the first load, N and T / N at the end (0 without N)."""
    times = 0.25 * np.arange(1, 4 * len(path) - 3)
    problem = wedge(path, **shape)
    r = solved(problem, rtol, times)
    f = np.einsum(
        "tpc,p->tc",
        r.force("wall")[:, 0] if r.force("wall").ndim == 4 else r.force("wall"),
        problem.interfaces["wall"].weights,
    )
    ratio = abs(float(f[-1, 1] / f[-1, 0])) if abs(f[-1, 0]) > 1e-6 * PUSH else 0.0
    return {"answer": r, "pressed": -float(f[3, 0]), "left": -float(f[-1, 0]), "ratio": ratio}


WEDGE = {"pressed": Right(SLID, BALANCE, SLIDES), "ratio": Right(JAM, 1e-5, JAMS)}


@scene("joints", right=WEDGE)
def wedge_jams_at_a_millionth(rtol: float) -> Any:
    return pressed([0, 1, 1e-6], rtol)


@scene(
    "joints",
    right=WEDGE,
    known_bad="converged without any force: the jam is forgotten at a load of exactly zero",
)
def wedge_jams_at_zero(rtol: float) -> Any:
    return pressed([0, 1, 0], rtol)


@scene("joints", right={"pressed": WEDGE["pressed"]})
def wedge_pressed_again(rtol: float) -> Any:
    """Let go to exactly zero, and 20 % again."""
    return pressed([0, 1, 0, 0.2], rtol)


@scene(
    "joints",
    right={
        "pressed": Right(PUSH / (math.sin(LEAN) + 0.1 * math.cos(LEAN)), BALANCE, SLIDES),
        "left": Right(
            0.01 * PUSH / (math.sin(LEAN) - 0.1 * math.cos(LEAN)), 1e-3, "it slides back, T = -mu N"
        ),
    },
)
def wedge_that_does_not_lock(rtol: float) -> Any:
    """mu = 0.1 < tan 10: let go to 1 % of the load."""
    return pressed([0, 1, 0.01], rtol, mu=0.1)


@scene("joints", right=WEDGE)
def wedge_in_a_block(rtol: float) -> Any:
    """Meshes that do not match, linear cells, down to a millionth."""
    return pressed([0, 1, 1e-6], rtol, block=True, degree=1, n=8)


@scene(
    "joints",
    right=WEDGE,
    known_bad="converged without any force: the jam is forgotten at a load of exactly zero",
)
def wedge_in_a_block_at_zero(rtol: float) -> Any:
    return pressed([0, 1, 0], rtol, block=True, n=6)


@scene("joints", right=WEDGE)
def taper_jams_at_a_millionth(rtol: float) -> Any:
    """A hollow cone in a rigid seat."""
    return pressed([0, 1, 1e-6], rtol, axis=True)


@scene(
    "joints",
    right=WEDGE,
    known_bad="converged without any force: the jam is forgotten at a load of exactly zero",
)
def taper_jams_at_zero_and_on(rtol: float) -> Any:
    """A cone in a steel hub: to zero, up to a half, to zero."""
    return pressed([0, 1, 0, 0.5, 0], rtol, axis=True, block=True)


# --- a pin in a lug --------------------


def hinge(
    force: Any,
    *,
    half: bool = False,
    clearance: float = 0.0,
    mu: float | None = 0.2,
    n: int = 32,
    degree: int = 2,
    pin: float = 210e3,
) -> lf.Problem:
    """A hollow pin in a lug whose rim is held; ``clearance``: radial, negative: a bush that is pressed in."""
    assembly = lf.Scene()
    angle = math.pi if half else 2 * math.pi
    for name, low, high, cells, young in (
        ("pin", 3.0, 10.0, (3, n), pin),
        ("lug", 10.0, 20.0, (4, n + 4), 70e3),
    ):
        assembly.substructure(
            name, annulus(low, high, angle, cells), lf.LinearElastic(young, 0.3), degree=degree
        )
        if half:
            assembly.symmetry([f"{name}:theta0", f"{name}:theta1"], name=f"plane of {name}")
    assembly.interface("joint", "pin:outer", "lug:inner", lf.Contact(gap=clearance, friction=mu))
    assembly.fix("lug:outer", name="rim")
    assembly.force("pin:inner", force, name="load")
    return lf.assemble(assembly)


PINNED = {"joint.force_x": Right(-500.0, BALANCE, "balance of the pin")}


@scene("joints", right=PINNED)
def pin_without_friction(rtol: float) -> Any:
    """Half of a neat pin."""
    return read(solved(hinge((500.0, 0.0), half=True, mu=None), rtol), "joint.force_x")


@scene("joints", right=PINNED)
def pin_with_clearance(rtol: float) -> Any:
    """0.02 mm radial clearance and friction: an arc of contact that grows."""
    return read(solved(hinge((500.0, 0.0), half=True, clearance=0.02, n=24), rtol), "joint.force_x")


QUARTERS = {
    f"joint.force_{axis}@{k}": Right(-500.0 * value, 1e-5 if value else 1e-3, "balance of the pin")
    for k in (1, 3, 5, 7)
    for axis, value in (("x", (0, -1, 0, 1)[k // 2]), ("y", (1, 0, -1, 0)[k // 2]))
}


@scene("joints", right=QUARTERS)
def bush_under_a_turning_load(rtol: float) -> Any:
    """Pressed in by 0.01 mm; the load turns once in eight steps."""
    t = np.linspace(0.0, 1.0, 9)
    x, y = (lf.Amplitude(t, f(2 * np.pi * t) * (t > 0)) * 500.0 for f in (np.cos, np.sin))
    r = solved(hinge((x, y), clearance=-0.01, n=20), rtol, t[1:])
    return read(r, *QUARTERS)


@scene("joints", right=PINNED)
def rubber_bush(rtol: float) -> Any:
    """A bush of 5 MPa, pressed in by 0.2 mm, mu = 0.8."""
    return read(
        solved(hinge((ramp(0, 1) * 500.0, 0.0), clearance=-0.2, mu=0.8, pin=5.0, n=24), rtol, [0.5, 1.0]),
        "joint.force_x",
    )
