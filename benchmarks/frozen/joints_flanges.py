"""Engineers' joints of the frozen corpus: mounts on gaskets, flanges under bolts, clamps."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_frontend as lf

from .registry import Right, scene
from .shapes import ALUMINIUM, BALANCE, STEEL, Array, arrived, mapped, patched, ramp, read, solved

M10 = lf.BoltStiffness.vdi2230(d=10, pitch=1.5, shank=15, thread=9, E=205e3)
TIGHTENED = 12e3


def mount(
    side: Any = None,
    *,
    cells: tuple[int, int] = (8, 6),
    rubber: float = 200.0,
    mu: Any = 0.12,
    glued: bool = False,
    tresca: float | None = None,
    warm: Any = None,
    degree: int = 1,
    force: Any = TIGHTENED,
) -> lf.Problem:
    """An aluminium foot of 160 x 120 x 10 mm on a gasket of 2 mm on a base, four M10 in the corners.

    ``side``: N along x at the height of 60 mm; ``warm``: K on foot and gasket; ``glued``: gasket on base.
    """
    assembly = lf.Scene()
    corners = {f"bolt{k}": ((0.0, 120.0)[k % 2], (0.0, 80.0)[k // 2]) for k in range(4)}

    def box(z: float, height: float, n: int, face: str | None = None) -> Any:
        part = lf.geometry.box((160, 120, height), (*cells, n), (0, 0, z), "hexahedron")
        if face is None:
            return part
        top = z + height * (face == "z1")
        return patched(part, {k: (face, (x, y, top), (x + 40, y + 40, top)) for k, (x, y) in corners.items()})

    assembly.substructure(
        "base", box(-12, 12, 2, "z0"), lf.LinearElastic(210e3, 0.3, alpha=11.5e-6), degree=degree
    )
    assembly.substructure("gasket", box(0, 2, 1), lf.LinearElastic(rubber, 0.4, alpha=50e-6), degree=degree)
    assembly.substructure(
        "foot", box(2, 10, 2, "z1"), lf.LinearElastic(70e3, 0.33, alpha=23e-6), degree=degree
    )
    rubs = lf.Contact(gap=0.0, friction=None if tresca else mu, threshold=tresca)
    assembly.interface("lower", "base:z1", "gasket:z0", lf.Perfect() if glued else rubs)
    assembly.interface("upper", "gasket:z1", "foot:z0", rubs)
    for k in corners:
        assembly.beam(k, f"base:{k}", f"foot:{k}", M10, lf.Preload(force, until=1.0))
    assembly.fix(["base:x0", "base:x1"], name="ground")
    if side is not None:
        assembly.force("foot:x1", (side * 1.0, 0.0, 0.0), point=(80.0, 60.0, 60.0), name="side")
    if warm is not None:
        for part in ("foot", "gasket"):
            assembly.temperature(part, warm * 1.0)
    return lf.assemble(assembly)


BOLTED = {
    f"bolt{k}.axial.normal@0": Right(TIGHTENED, BALANCE, "the preload that was asked for") for k in range(4)
}
BOLTED["upper.normal@0"] = Right(-4 * TIGHTENED, BALANCE, "balance of the foot")


def foot(result: Any, loads: list[float]) -> dict[str, float]:
    """What of a side load friction and the shear of the bolts do not balance, at each later step."""
    left = {}
    for step, load in enumerate(loads, start=1):
        table = result.table(step=step)
        rows = [name for name in table["interface"] if str(name).startswith("bolt")]
        taken = table.value("force_x", "upper") + sum(table.value("force_x", str(name)) for name in rows)
        left[f"left over x@{step}"] = float(taken) - load
    return left


def in_balance(*steps: int) -> dict[str, Right]:
    return {f"left over x@{step}": Right(0.0, 1e-2, "balance of the foot, N of kN") for step in steps}


@scene("joints", right=BOLTED | in_balance(1, 2, 3))
def mount_pulled_aside(rtol: float) -> Any:
    """3 kN aside, back, and none."""
    r = solved(mount(lf.Amplitude([1, 2, 3, 4], [0, 3e3, -3e3, 0])), rtol, [1.0, 2.0, 3.0, 4.0])
    return read(r, *BOLTED, **foot(r, [3e3, -3e3, 0.0]))


@scene("joints", right=BOLTED)
def mount_on_rubber(rtol: float) -> Any:
    """A gasket of 5 MPa, mu 0.8, glued to the base."""
    r = solved(mount(lf.Amplitude([1, 2], [0, 1e3]), rubber=5.0, mu=0.8, glued=True), rtol, [1.0, 2.0])
    return read(r, *BOLTED)


@scene("joints", right=BOLTED)
def mount_tresca(rtol: float) -> Any:
    r = solved(mount(lf.Amplitude([1, 2], [0, 2e3]), tresca=0.5), rtol, [1.0, 2.0])
    return read(r, *BOLTED)


@scene("joints", right=BOLTED)
def mount_warm_and_cold(rtol: float) -> Any:
    """40 K, and cold again."""
    r = solved(mount(warm=lf.Amplitude([1, 2, 3], [0, 40, 0]), glued=True), rtol, [1.0, 2.0, 3.0])
    return read(r, *BOLTED)


@scene(
    "joints",
    right=BOLTED,
    known_bad="no answer in 30 s",
)
def mount_large(rtol: float) -> Any:
    """Quadratic cells: 18 000 unknowns, side load and heat."""
    problem = mount(
        lf.Amplitude([1, 2], [0, 3e3]), cells=(12, 9), degree=2, warm=lf.Amplitude([2, 3], [0, 40])
    )
    return read(solved(problem, rtol, [1.0, 2.0, 3.0]), *BOLTED)


@scene(
    "joints",
    right={"upper.normal": Right(-4 * TIGHTENED, BALANCE, "balance of the foot: the same in every sample")},
)
def mount_samples(rtol: float) -> Any:
    """Twelve samples of friction, glued gasket."""
    problem = mount(lf.Amplitude([1, 2], [0, 2e3]), mu=lf.LogNormal("mu", 0.2, cov=0.2), glued=True)
    r = lf.quasi_monte_carlo(
        problem, 8, times=[1.0, 2.0], options=lf.Options(rtol=rtol), progress=False, keep_states=True
    )
    normal = r.force("upper")[:, 0, :, 0] @ problem.interfaces["upper"].weights
    return {"answer": r, "upper.normal": float(normal[np.abs(normal + 4 * TIGHTENED).argmax()])}


# --- flanges --------------------


def ring_flange(
    bolts: Any,
    thrust: Any,
    *,
    mu: float | None = 0.3,
    gasket: float = 500.0,
    rim: float | None = None,
    degree: int = 2,
    n: int = 1,
    law: Any = None,
) -> lf.Problem:
    """Section of a flange of 50 .. 100 x 20 mm on half a gasket of 50 .. 70 mm; N on the bolt circle,
    80 .. 90 mm, and on the pipe, 50 .. 60 mm. ``rim``: distance of its rim to the other flange.
    ``law``: of the gasket.
    """
    assembly = lf.Scene(axisymmetric=True)
    top = {
        "pipe": ("y1", (50.0,), (60.0,)),
        "circle": ("y1", (80.0,), (90.0,)),
        "rim": ("y0", (90.0,), (100.0,)),
    }
    flange = patched(lf.geometry.box((50, 20), (10 * n, 4 * n), (50, 0)), top)
    assembly.substructure("flange", flange, STEEL, degree=degree)
    if law is None:
        part = lf.geometry.box((20, 1.5), (6 * n, n), (50, -1.5))
        assembly.substructure("gasket", part, lf.LinearElastic(gasket, 0.4), degree=degree)
        assembly.fix("gasket:y0", components=1, name="plane")
        assembly.interface("seal", "gasket:y1", "flange:y0", lf.Contact(gap=0.0, friction=mu))
    else:
        assembly.interface("seal", "flange:y0", law)
    if rim is not None:
        assembly.interface("stop", "flange:rim", lf.Contact(gap=rim))
    assembly.force("flange:circle", (0.0, bolts * -1.0), name="bolts")
    assembly.force("flange:pipe", (0.0, thrust * 1.0), name="thrust")
    return lf.assemble(assembly)


BOLT_UP, THRUST = 200e3, 80e3
SEALED = {
    "seal.normal@0": Right(-BOLT_UP, BALANCE, "balance of the flange"),
    "seal.normal@2": Right(THRUST - BOLT_UP, BALANCE, "balance of the flange"),
    "seal.normal@3": Right(-BOLT_UP, BALANCE, "balance of the flange"),
}
OPERATION = (ramp(0, 1) * BOLT_UP, lf.Amplitude([1, 2, 3], [0, 1, 0]) * THRUST)


@scene("joints", right=SEALED)
def flange_on_gasket(rtol: float) -> Any:
    """Bolted up, under pressure and without it."""
    return read(solved(ring_flange(*OPERATION), rtol, [1.0, 1.5, 2.0, 3.0]), *SEALED)


@scene("joints", right=SEALED)
def flange_on_gasket_fine(rtol: float) -> Any:
    return read(solved(ring_flange(*OPERATION, n=3, mu=0.1), rtol, [1.0, 1.5, 2.0, 3.0]), *SEALED)


@scene("joints", right=SEALED)
def flange_on_a_gasket_law(rtol: float) -> Any:
    """The gasket is a stiffness in compression under the whole face."""
    return read(
        solved(ring_flange(*OPERATION, law=lf.Contact(gap=0.0, stiffness=300.0)), rtol, [1.0, 1.5, 2.0, 3.0]),
        *SEALED,
    )


@scene(
    "joints",
    right={"both": Right(THRUST - BOLT_UP, BALANCE, "balance of the flange")},
    known_bad="the step in which the rim closes is inexact",
)
def flange_that_meets_its_rim(rtol: float) -> Any:
    """The rim closes at 0.02 mm: gasket and rim share the bolt force."""
    r = solved(ring_flange(*OPERATION, rim=0.02), rtol, [1.0, 2.0])
    table = r.table()
    return read(r, both=float(table.value("normal", "seal") + table.value("normal", "stop")))


@scene(
    "joints",
    right={f"normal {k}": Right(60e3 - k * 1e3, BALANCE, "balance of the flange") for k in (100, 150, 200)},
)
def flange_sweep(rtol: float) -> Any:
    """Three bolt forces."""
    problem = ring_flange(150e3, 60e3)
    r = lf.sweep(
        problem, {"bolts.y": [-100e3, -150e3, -200e3]}, options=lf.Options(rtol=rtol), progress=False
    )
    normal = r.force("seal")[..., 0] @ problem.interfaces["seal"].weights
    return {"answer": r} | {f"normal {k}": float(v) for k, v in zip((100, 150, 200), normal, strict=True)}


@scene(
    "joints",
    right={"mean": Right(-12e3, 1e-6, "balance: the force is given"), "std": Right(0.0, 1e-2, "the same")},
)
def gasket_chaos(rtol: float) -> Any:
    """A linear gasket of random stiffness under a plate: its force does not scatter, its closing does."""
    assembly = lf.Scene()
    assembly.substructure("plate", lf.geometry.box((60, 40, 8), (6, 4, 2)), STEEL, degree=1)
    k = lf.LogNormal("k", 40.0, cov=0.3)
    assembly.interface("gasket", "plate:z0", lf.Elastic(normal=k, tangential=k))
    assembly.pressure("plate:z1", 5.0, name="press")
    r = lf.solve(lf.assemble(assembly), chaos=4, options=lf.Options(rtol=rtol), progress=False)
    moments = r.mean_std(lf.Resultant("gasket"))
    return {"answer": r, "mean": float(moments.mean), "std": float(moments.std)}


def sector(
    bolt: Any, pull: Any, *, mu: float = 0.2, degree: int = 1, cells: tuple[int, int, int] = (6, 4, 2)
) -> lf.Problem:
    """30 degrees of two flanges of 40 .. 80 x 12 mm with one bolt between r = 60 and 80; the upper one is
    pulled up at its inner ring."""
    assembly = lf.Scene()
    turn = math.radians(30)

    def bend(x: Array) -> Array:
        r, theta = x[:, 0].copy(), (x[:, 1] - 0.5) * turn
        x[:, 0], x[:, 1] = r * np.cos(theta), r * np.sin(theta)
        return x

    for name, z, face in (("lower", -12.0, "z0"), ("upper", 0.0, "z1")):
        n = (cells[0] + 2 * (name == "upper"), cells[1], cells[2])
        top = z + 12.0 * (face == "z1")
        part = lf.geometry.box((40, 1, 12), n, (40, 0, z), "hexahedron")
        spots = {
            "seat": (face, (60.0, 0.0, top), (80.0, 1.0, top)),
            "tube": (face, (40.0, 0.0, top), (50.0, 1.0, top)),
        }
        assembly.substructure(name, mapped(patched(part, spots), bend), STEEL, degree=degree)
        assembly.symmetry([f"{name}:y0", f"{name}:y1"], name=f"planes of {name}")
    assembly.interface("joint", "lower:z1", "upper:z0", lf.Contact(gap=0.0, friction=mu))
    assembly.beam("bolt", "lower:seat", "upper:seat", M10, lf.Preload(bolt, until=1.0))
    assembly.fix("lower:tube", name="ground")
    assembly.force("upper:tube", (0.0, 0.0, pull * 1.0), name="pull")
    return lf.assemble(assembly)


SECTOR = {
    "joint.normal@0": Right(-20e3, BALANCE, "balance of the upper flange"),
    "sum@1": Right(8e3, BALANCE, "balance of the upper flange"),
    "sum@2": Right(0.0, 1e-2, "balance, without a load"),
}


@scene("joints", right=SECTOR)
def flange_sector(rtol: float) -> Any:
    """Prying: bolt and joint together balance the pull."""
    r = solved(sector(20e3, lf.Amplitude([1, 2, 3], [0, 8e3, 0])), rtol, [1.0, 2.0, 3.0])
    both = {
        f"sum@{k}": float(
            r.table(step=k).value("normal", "joint") + r.table(step=k).value("normal", "bolt.axial")
        )
        for k in (1, 2)
    }
    return read(r, "joint.normal@0", **both)


# --- clamps --------------------


def jaw(
    path: Any,
    *,
    gap: Any = 0.05,
    mm: float = 1.0,
    soft: float = 70e3,
    n: int = 6,
    degree: int = 1,
    mu: float = 0.3,
) -> lf.Problem:
    """A jaw that closes on a bar by a path (mm) after a gap, without Poisson's effect: springs in a row."""
    assembly = lf.Scene()
    for name, x, length, young in (("bar", 0.0, 40.0, soft), ("jaw", 40.0, 20.0, 210e3)):
        cells = (n, n // 2, n // 2) if name == "bar" else (n // 2, n // 2 + 1, n // 2)
        box = lf.geometry.box((length * mm, 10 * mm, 10 * mm), cells, (x * mm, 0, 0), "hexahedron")
        assembly.substructure(name, box, lf.LinearElastic(young / mm**2, 0.0), degree=degree)
    assembly.fix("bar:x0", name="wall")
    assembly.interface("clamp", "bar:x1", "jaw:x0", lf.Contact(gap=gap, friction=mu))
    assembly.fix("jaw:x1", path * -mm, components=0, name="grip")
    assembly.fix("jaw:x1", components=(1, 2), name="guide")
    return lf.assemble(assembly)


def squeeze(closed: float, soft: float = 70e3) -> float:
    """N: a bar of 40 mm and a jaw of 20 mm, 100 mm2, shortened together."""
    return -100.0 * max(closed, 0.0) / (40.0 / soft + 20.0 / 210e3)


CLAMP = {
    f"clamp.normal@{k}": Right(squeeze(u - 0.05), 1e-8 if u > 0.05 else 1e-3, "springs in a row")
    for k, u in enumerate((0.04, 0.1, 0.2, 0.1, 0.0, 0.15))
}


@scene("joints", right=CLAMP)
def clamp_closed_and_opened(rtol: float) -> Any:
    path = lf.Amplitude([0, 1, 2, 3, 4, 5, 6], [0, 0.04, 0.1, 0.2, 0.1, 0.0, 0.15])
    return read(solved(jaw(path), rtol, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), *CLAMP)


@scene(
    "joints",
    right={
        f"clamp.normal@{k}": Right(squeeze(0.05 + 0.1 * k, 0.07), 1e-8, "springs in a row") for k in (0, 1)
    },
)
def clamp_on_foam(rtol: float) -> Any:
    """The bar is 3 million times softer than the jaw; N and m, quadratic cells."""
    r = solved(jaw(ramp(0, 0.1, 0.2), gap=0.05e-3, mm=1e-3, soft=0.07, n=4, degree=2), rtol, [1.0, 2.0])
    return read(r, "clamp.normal@0", "clamp.normal@1")


@scene("joints", right={"clamp.normal": Right(squeeze(0.05), 1e-8, "springs in a row")})
def clamp_large(rtol: float) -> Any:
    """45 000 unknowns, quadratic cells."""
    return read(solved(jaw(0.1, n=16, degree=2), rtol), "clamp.normal")


@scene(
    "joints",
    right={
        f"gap {g}": Right(squeeze(0.1 - g), 1e-7, "springs in a row") for g in (0.0, 0.02, 0.04, 0.06, 0.08)
    },
)
def clamp_sweep(rtol: float) -> Any:
    gaps = [0.0, 0.02, 0.04, 0.06, 0.08]
    problem = jaw(0.1, mu=0.2)
    r = lf.sweep(problem, {"clamp.gap": gaps}, options=lf.Options(rtol=rtol), progress=False)
    normal = r.force("clamp")[..., 0] @ problem.interfaces["clamp"].weights
    return {"answer": r} | {f"gap {g}": float(v) for g, v in zip(gaps, normal, strict=True)}


def strap_in_jaws(
    pull: Any, *, mu: float = 0.25, degree: int = 1, cells: int = 8, spring: bool = False
) -> lf.Problem:
    """A strip of 60 x 20 x 2 mm between two jaws pressed with 6 kN, pulled along x."""
    assembly = lf.Scene()
    assembly.substructure(
        "strip", lf.geometry.box((60, 20, 2), (2 * cells, cells, 1), (0, 0, -1)), ALUMINIUM, degree=degree
    )
    for name, z in (("low", -11.0), ("high", 1.0)):
        box = lf.geometry.box((30, 20, 10), (cells + 1, cells - 1, 2), (0, 0, z))
        assembly.substructure(name, box, STEEL, degree=degree)
    assembly.interface("j0", "low:z1", "strip:z0", lf.Contact(gap=0.0, friction=mu))
    assembly.interface("j1", "high:z0", "strip:z1", lf.Contact(gap=0.0, friction=mu))
    assembly.fix("low:z0", name="bed")
    assembly.fix("high:x0", components=(0, 1), name="guide")
    assembly.pressure("high:z1", ramp(0, 1) * 10.0, name="press")
    assembly.force("strip:x1", (pull * 1.0, 0.0, 0.0), name="pull")
    return lf.assemble(assembly)


HOLDS = {
    "j0.normal@0": Right(-6e3, BALANCE, "pressure x area"),
    "shear@1": Right(2e3, BALANCE, "balance of the strip"),
    "shear@2": Right(-2e3, BALANCE, "balance of the strip"),
    "shear@3": Right(0.0, 1e-2, "no load"),
}


@scene("joints", right=HOLDS)
def strip_in_jaws(rtol: float) -> Any:
    """Pulled to and fro at two thirds of 2 mu N, and let go."""
    r = solved(strap_in_jaws(lf.Amplitude([1, 2, 3, 4], [0, 2e3, -2e3, 0])), rtol, [1.0, 2.0, 3.0, 4.0])
    shear = {
        f"shear@{k}": float(r.table(step=k).value("force_x", "j0") + r.table(step=k).value("force_x", "j1"))
        for k in (1, 2, 3)
    }
    return read(r, "j0.normal@0", **shear)


@scene(
    "joints",
    right={"steps": Right(2, 0.0, "2 mu N = 3 kN")},
    known_bad="the steps below the limit are refused with the one above it",
)
def strip_pulled_out_of_jaws(rtol: float) -> Any:
    return arrived(strap_in_jaws(lf.Amplitude([1, 2], [0, 3.6e3]), cells=4), rtol, [1.0, 1.5, 2.0])


@scene("joints", right={"gasket@0": Right(-8 * 45e3, BALANCE, "balance of the upper flange")})
def pipe_flange_of_35_parts(rtol: float) -> Any:
    """The flange of the demo: eight studs with friction under their nuts, a gasket, then pressure."""
    import flange_from_step as demo

    shape = demo.FlangeShape()
    with tempfile.TemporaryDirectory() as folder:
        step = demo.read(demo.make_flange(Path(folder) / "flange.step", shape), shape, 24.0)
        step.join("upper flange|upper nut *", lf.Contact(friction=0.12))
        problem = lf.assemble(demo.loaded(step, step.mesh(), shape, lf.Amplitude((1.0, 2.0), (0.0, 1.0))))
    problem = problem.with_laws({name: lf.Preload(demo.FORCE, until=1.0) for name in demo.BOLTS})
    r = solved(problem, rtol, [1.0, 2.0])
    normal = r.force(demo.SEAT)[:, :, 0] @ problem.interfaces[demo.SEAT].weights
    return {"answer": r, "gasket@0": float(normal[0])}


# --- one bolt of 10 x 10 x 40 between walls, without cross contraction ---

STIFF = 200e3 * 100.0 / 40.0
TORQUE, PITCH, SIZE, THREAD, HEAD = 40e3, 1.75, 12.0, 0.12, 0.14
TURNED, LOST = 9.0, 0.002
OF_TORQUE = TORQUE / (
    PITCH / (2 * math.pi)
    + THREAD * (SIZE - 0.649519 * PITCH) / (2 * math.cos(math.radians(30)))
    + HEAD * 1.3 * SIZE / 2
)
VDI = "VDI 2230: M = F (P / 2 pi + mu_G d2 / (2 cos 30) + mu_K D_Km / 2)"
LENGTHS = {
    "torque": Right(OF_TORQUE, 1e-3, f"{VDI}; the mean diameter of the head is that of the docs, 1.3 d"),
    "angle": Right(PITCH * TURNED / 360 * STIFF, 1e-6, "pitch times share of a turn, times E A / L"),
    "embedding": Right(12e3 - LOST * STIFF, 1e-6, "12 kN less the lost length times E A / L"),
    "von Mises": Right((12e3 - LOST * STIFF) / 100.0, 1e-6, "the only stress is force over area"),
}


@scene("joints", right=LENGTHS)
def a_bolt_tightened_in_four_ways(rtol: float) -> Any:
    """By torque, by angle, and by force with embedding after it."""

    def bolt(law: lf.Preload, times: list[float] | None = None) -> tuple[float, Any]:
        assembly = lf.Scene()
        for name, z in (("lower", 0.0), ("upper", 20.0)):
            box = lf.geometry.box((10, 10, 20), (1, 1, 2), origin=(0, 0, z))
            assembly.substructure(name, box, lf.LinearElastic(200e3, 0.0), degree=1)
            assembly.symmetry([f"{name}:x0", f"{name}:y0"])
        assembly.interface("bolt", "lower:z1", "upper:z0", law)
        assembly.fix(["lower:z0", "upper:z1"], components=2)
        problem = lf.assemble(assembly)
        result = solved(problem, rtol, times, active="all")
        force = np.asarray(result.force("bolt")).reshape(-1, problem.interfaces["bolt"].num_points, 3)
        return float(force[-1, :, 0] @ problem.interfaces["bolt"].weights), result

    sizes = {"d": SIZE, "pitch": PITCH, "mu_thread": THREAD, "mu_head": HEAD}
    torque, _ = bolt(lf.Preload(torque=TORQUE, **sizes))
    angle, _ = bolt(lf.Preload(angle=TURNED, pitch=PITCH))
    embedding, result = bolt(lf.Preload(12e3, until=1.0, embedding=LOST), [1.0, 2.0])
    mises = result.stress("lower", of="von Mises").x.array.max()
    return {"answer": result, "torque": torque, "angle": angle, "embedding": embedding, "von Mises": mises}


OPEN = Right(70.0, 0.1, "resultant at 1 from the edge: pressure on a triangle of 3, but for cells of 1.25")


@scene("joints", right={"open": OPEN})
def a_face_that_is_partly_open(rtol: float) -> Any:
    """Areas that are open or slip, of a block that a force beyond its middle tilts on a rigid ground."""
    assembly = lf.Scene()
    box = lf.geometry.box((10, 10, 10), (8, 4, 4), cell="hexahedron")
    assembly.substructure("block", box, lf.LinearElastic(200e3, 0.0), degree=1)
    assembly.interface("ground", "block:z0", lf.Contact(friction=0.3))
    assembly.symmetry("block:y0")
    assembly.force("block:z1", (150.0, 0.0, -1000.0), point=(7.5, 5.0, 10.0), name="weight")
    result = solved(lf.assemble(assembly), rtol)
    table = result.table("ground")
    areas = {name: table.value(f"{name}_area", "ground") for name in ("open", "slip")}
    return {"answer": result, **areas}


TILTS = {f"open@{k}": Right(right, 0.1, "contact on 3 (b / 2 - e) of b, pressure on a triangle")
         for k, right in ((1, 25.0), (2, 55.0))} | {"open@0": Right(0.0, 1e-9, "e below b / 6")}


@scene("joints", right=TILTS)
def a_footing_that_opens(rtol: float) -> Any:
    """A stiff block on a soft bed that only pushes; a side load grows to e of 1.5, 2.5, 3.5 of 10."""
    assembly = lf.Scene()
    box = lf.geometry.box((10, 10, 10), (40, 1, 2), cell="hexahedron")
    assembly.substructure("block", box, lf.LinearElastic(200e3, 0.0), degree=1)
    assembly.interface("bed", "block:z0", lf.Contact(stiffness=10.0, friction=0.8))
    assembly.symmetry("block:y0")
    times = [1.0, 2.0, 3.0]
    side = lf.Amplitude([0.0, *times], [0.0, 150.0, 250.0, 350.0]) * 1.0
    assembly.force("block:z1", (side, 0.0, -1000.0), point=(5.0, 5.0, 10.0), name="load")
    table = solved(lf.assemble(assembly), rtol, times).table("bed", step=None)
    return {f"open@{k}": table.value("open_area", "bed", time=t) for k, t in enumerate(times)}
