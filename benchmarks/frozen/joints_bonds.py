"""Engineers' joints of the frozen corpus: bonds and straps below and above their strength, lap joints."""

from __future__ import annotations

from typing import Any

import numpy as np

import dolfinx_frontend as lf

from .registry import Right, scene
from .shapes import BALANCE, ramp, read, solved

PLANE = lf.LinearElastic(70e3, 0.3, plane="stress")
GLUE, STRENGTH = 1e6, 60.0
ELASTIC = "below its strength a bond is elastic: the linear answer on the same mesh"


def strap(law: Any, end: float, cells: int = 20) -> lf.Problem:
    """A strap of 40 x 2 mm glued on a held block, its end moved by ``end`` mm until t = 1."""
    assembly = lf.Scene()
    assembly.substructure("base", lf.geometry.box((40, 5), (cells, 3), (0, -5)), PLANE)
    assembly.substructure("strap", lf.geometry.box((40, 2), (cells + 4, 2)), PLANE)
    assembly.interface("bond", "strap:y0", "base:y1", law)
    assembly.fix("base:y0", name="ground")
    assembly.fix("strap:x1", ramp(0, 1) * end, components=0, name="pull")
    return lf.assemble(assembly)


def undamaged(rtol: float, ratio: float, share: float, steps: int, cells: int = 20) -> dict[str, Any]:
    """A strap pulled to a share of the displacement at which its first point reaches the strength.

    ``force``: over that of the elastic bond; ``ratio``: last opening over that at the strength.
    """
    elastic = solved(strap(lf.Elastic(normal=GLUE, tangential=GLUE), 1.0, cells), rtol, [1.0])
    largest = float(np.linalg.norm(elastic.force("bond")[0], axis=1).max())
    end = share * STRENGTH / largest
    stiffness = elastic.table(step=0).value("force_x", "pull")
    law = lf.Debonding(normal=GLUE, tangential=GLUE, strength=STRENGTH, opening=ratio * STRENGTH / GLUE)
    r = solved(strap(law, end, cells), rtol, np.linspace(1 / steps, 1, steps))
    taken = r.table(step=steps - 1).value("force_x", "pull")
    return {"elastic": elastic, "answer": r, "force": float(taken / (stiffness * end))}


SOUND = {"force": Right(1.0, 1e-6, ELASTIC)}


@scene("joints", right=SOUND, known_bad="converged, torn in part at 30 % of what begins damage")
def strap_at_30_percent(rtol: float) -> Any:
    return undamaged(rtol, 1.5, 0.3, 1)


@scene("joints", right=SOUND, known_bad="inexact and torn off at 60 % of what begins damage")
def strap_at_60_percent(rtol: float) -> Any:
    return undamaged(rtol, 10.0, 0.6, 4)


@scene("joints", right=SOUND, known_bad="converged, torn in part at 90 % of what begins damage")
def strap_at_90_percent(rtol: float) -> Any:
    return undamaged(rtol, 10.0, 0.9, 16)


@scene("joints", right=SOUND, known_bad="stagnates, torn off at 90 % of what begins damage")
def strap_at_90_percent_tough(rtol: float) -> Any:
    return undamaged(rtol, 30.0, 0.9, 1, cells=40)


def tested(
    law: Any,
    path: list[float],
    *,
    young: float,
    shear: bool = False,
    mm: float = 1.0,
    n: int = 2,
    degree: int = 1,
) -> Any:
    """Two cubes of 10 mm, glued, without Poisson's effect, pulled (or sheared) along a path of mm."""
    assembly = lf.Scene()
    for name, x in (("left", 0.0), ("right", 10.0)):
        box = lf.geometry.box(
            (10 * mm, 10 * mm, 10 * mm), (n, n, n + (name == "right")), (x * mm, 0, 0), "hexahedron"
        )
        assembly.substructure(name, box, lf.LinearElastic(young / mm**2, 0.0), degree=degree)
    assembly.interface("bond", "left:x1", "right:x0", law)
    assembly.fix("left:x0", name="wall")
    moved = ramp(0.0, *path)
    direction = (0.0, mm, 0.0) if shear else (mm, 0.0, 0.0)
    assembly.fix("right:x1", moved * direction, name="grip")
    return lf.assemble(assembly)


FIRST, LAST, K = 0.002, 0.02, 2e4
"""mm, mm, MPa / mm: 40 MPa at 2 um, nothing at 20 um."""


def bilinear(path: list[float], series: float) -> list[float]:
    """Traction of the bond in a row with blocks of compliance ``series`` (length / E), step by step."""
    reached, slope, found = FIRST, K * FIRST / (LAST - FIRST), []
    for u in path:
        secant = K if u < 0.0 else max(slope * (LAST - reached) / reached, 0.0)
        force = secant * u / (1.0 + secant * series)
        if u - force * series > reached:
            force = slope * max(LAST - u, 0.0) / (1.0 - slope * series)
            reached = u - force * series
        found.append(force)
    return found


TORN = [0.001, 0.008, 0.012, 0.0, 0.008, 0.016, -0.004, 0.03, 0.01]
PULLED = bilinear(TORN, 20.0 / 210e3)
LAW = "bilinear law in series with the blocks, step by step"
OPENED = {f"bond.normal@{k}": Right(100.0 * f, 1e-6 if f else 1e-2, LAW) for k, f in enumerate(PULLED)}


@scene("joints", right=OPENED)
def bond_torn_and_let_go(rtol: float) -> Any:
    """Torn in part, let go, torn further, pressed, torn through."""
    law = lf.Debonding(normal=K, tangential=K / 2, strength=K * FIRST, opening=LAST)
    problem = tested(law, TORN, young=210e3)
    return read(solved(problem, rtol, np.arange(1.0, len(TORN) + 1)), *OPENED)


@scene("joints", right=OPENED)
def bond_torn_in_metres(rtol: float) -> Any:
    """The same in N and m, quadratic cells."""
    law = lf.Debonding(normal=K * 1e9, tangential=K / 2 * 1e9, strength=K * FIRST * 1e6, opening=LAST * 1e-3)
    problem = tested(law, TORN, young=210e3, mm=1e-3, degree=2)
    return read(solved(problem, rtol, np.arange(1.0, len(TORN) + 1)), *OPENED)


SLID = [0.002, 0.01, -0.01, 0.02, 0.0]


def sheared(path: list[float]) -> list[float]:
    """Shear of the same bond between rigid blocks: lambda = |j| sqrt(kt / kn)."""
    damage, found = 0.0, []
    for u in path:
        jump = abs(u) * 0.5**0.5
        if jump > FIRST:
            damage = max(damage, min(LAST / (LAST - FIRST) * (1.0 - FIRST / jump), 1.0))
        found.append(100.0 * (1.0 - damage) * K / 2 * u)
    return found


SHEAR = {
    f"bond.force_y@{k}": Right(f, 3e-4 if f else 1e-1, "the law between all but rigid blocks")
    for k, f in enumerate(sheared(SLID))
}


@scene("joints", right=SHEAR)
def bond_sheared_to_and_fro(rtol: float) -> Any:
    law = lf.Debonding(normal=K, tangential=K / 2, strength=K * FIRST, opening=LAST)
    problem = tested(law, SLID, young=1e10, shear=True)
    return read(solved(problem, rtol, np.arange(1.0, len(SLID) + 1)), *SHEAR)


def bond_pulled_askew(rtol: float, young: float, steps: int) -> Any:
    """A glued block, bedded softly, pulled off centre."""
    assembly = lf.Scene()
    for name, x in (("a", 0.0), ("b", 1.0)):
        assembly.substructure(
            name, lf.geometry.box((1, 1, 1), (3, 3, 3), (x, 0, 0)), lf.LinearElastic(young, 0.3), degree=1
        )
    assembly.fix("a:x0", name="wall")
    assembly.interface("bed", "b:y0", lf.Elastic(normal=0.4, tangential=1.0))
    strength, k = 0.0974, 413.0
    assembly.interface(
        "glue", "a:x1", "b:x0", lf.Debonding(normal=k, tangential=k / 2, strength=strength, opening=0.0059)
    )
    assembly.traction("b:x1", ramp(0, 1) * (-0.06, 0.009, 0.004), name="pull")
    assembly.pressure("b:y1", ramp(0, 1) * 0.028, name="press")
    r = solved(lf.assemble(assembly), rtol, np.linspace(1 / steps, 1, steps))
    jump = r.jump("glue")[-1]
    use = np.sqrt(np.maximum(jump[:, 0], 0) ** 2 + 0.5 * (jump[:, 1:] ** 2).sum(axis=1)).max() / (
        strength / k
    )
    return {"answer": r, "use": float(use)}


@scene(
    "joints",
    right={"use": Right(0.26, 0.3, "the elastic bond, solved alone: far below 1")},
    known_bad="converged, torn off at a quarter of what begins damage",
)
def bonded_block_pressed(rtol: float) -> Any:
    """A quarter of what begins damage."""
    return bond_pulled_askew(rtol, 1e3, 1)


def bonded_beam(push: float, n: int = 60) -> lf.Problem:
    """Two plates of 1.5 mm glued over 100 mm, bent in three points."""
    assembly = lf.Scene()
    material = lf.LinearElastic(120e3, 0.3, plane="stress")
    for name, y in (("low", -1.5), ("up", 0.0)):
        assembly.substructure(name, lf.geometry.box((100, 1.5), (n, 2), (0, y)), material)
    assembly.interface(
        "bond", "up:y0", "low:y1", lf.Debonding(normal=1e5, tangential=1e5, strength=30.0, energy=0.5)
    )
    assembly.fix_point("low", (0, -1.5), 0.0, components=1, name="left")
    assembly.fix_point("low", (100, -1.5), 0.0, name="right")
    assembly.fix_point("up", (50, 1.5), -push, components=1, name="push")
    return lf.assemble(assembly)


@scene("joints")
def bonded_beam_bent(rtol: float) -> Any:
    """1 MPa of 30: nothing is damaged."""
    return solved(bonded_beam(0.1), rtol)


# --- lap joints --------------------


def lap(
    pull: Any,
    law: Any,
    *,
    squeeze: float = 20.0,
    n: int = 20,
    degree: int = 2,
    material: Any = PLANE,
    other: Any = PLANE,
) -> lf.Problem:
    """Two strips of 60 x 3 mm that overlap by 30 mm, on a smooth bed, squeezed where they do, one pulled."""
    assembly = lf.Scene()
    assembly.substructure("low", lf.geometry.box((60, 3), (2 * n, 2), (0, -3)), material, degree=degree)
    assembly.substructure("up", lf.geometry.box((60, 3), (2 * n, 3), (30, 0)), other, degree=degree)
    assembly.interface("lap", "low:y1", "up:y0", law, overlap="partial")
    assembly.interface("bed", "low:y0", lf.Contact(gap=0.0))
    assembly.fix("low:x0", components=0, name="wall")
    assembly.fix("up:x1", components=1, name="guide")
    over = ramp(0, 1) * (lambda x: np.where(x[:, 0] < 60.0, squeeze, 0.0))
    assembly.pressure("up:y1", over, name="squeeze")
    assembly.traction("up:x1", pull * (1.0 / 3.0, 0.0), name="pull")
    return lf.assemble(assembly)


def lapped(*loads: float) -> dict[str, Right]:
    return {
        f"lap.force_x@{k}": Right(load, BALANCE if load else 1e-3, "balance of the upper strip")
        for k, load in enumerate(loads, start=1)
    }


@scene("joints", right=lapped(60.0, -60.0, 0.0))
def lap_with_friction(rtol: float) -> Any:
    """Half of mu p l, to and fro."""
    r = solved(
        lap(lf.Amplitude([1, 2, 3, 4], [0, 60, -60, 0]), lf.Contact(gap=0.0, friction=0.2)),
        rtol,
        [1.0, 2.0, 3.0, 4.0],
    )
    return read(r, *lapped(60.0, -60.0, 0.0))


@scene("joints", right=lapped(100.0))
def lap_on_rubber(rtol: float) -> Any:
    """The upper strip is 10 000 times softer; mu = 0.9, linear cells."""
    problem = lap(
        lf.Amplitude([1, 2], [0, 100]),
        lf.Contact(gap=0.0, friction=0.9),
        other=lf.LinearElastic(7.0, 0.45, plane="stress"),
        degree=1,
    )
    return read(solved(problem, rtol, [1.0, 2.0]), *lapped(100.0))


@scene("joints", right=lapped(30.0, 60.0, 90.0))
def lap_tresca(rtol: float) -> Any:
    """A threshold of 5 MPa: 150 N in all."""
    problem = lap(lf.Amplitude([1, 4], [0, 90]), lf.Contact(gap=0.0, threshold=5.0))
    return read(solved(problem, rtol, [1.0, 2.0, 3.0, 4.0]), *lapped(30.0, 60.0, 90.0))


@scene("joints", right={"lap.force_x": Right(200.0, 1e-9, "balance")})
def lap_glued(rtol: float) -> Any:
    """An elastic layer: linear, one solve."""
    law = lf.Elastic(normal=5e3, tangential=2e3)
    return read(
        solved(lap(lf.Amplitude([1, 2], [0, 200]), law, squeeze=1.0), rtol, [1.0, 2.0]), "lap.force_x"
    )


RIGID = lf.LinearElastic(1e9, 0.0)


@scene(
    "joints",
    right={
        "joint.shear@1": Right(1e3, 1e-4, "sticks: friction takes all"),
        "joint.shear@2": Right(2e3, 1e-4, "mu F: it slides on the bolt"),
        "joint.normal@2": Right(-10e3, 1e-3, "preload, plates of E = 1e9"),
    },
)
def lap_bolt_in_shear(rtol: float) -> Any:
    """Two rigid plates under a bolt, pulled past mu F along a soft spring that takes the rest."""
    assembly = lf.Scene()
    for name, z in (("low", 0.0), ("up", 10.0)):
        assembly.substructure(
            name, lf.geometry.box((30, 30, 10), (3 + (name == "up"), 3, 1), (0, 0, z)), RIGID, degree=1
        )
    assembly.interface("joint", "low:z1", "up:z0", lf.Contact(gap=0.0, friction=0.2))
    assembly.beam("bolt", "low:z0", "up:z1", lf.BoltStiffness(1e5, 1.0, 1.0), lf.Preload(10e3, until=1.0))
    assembly.interface("spring", "up:x1", lf.Elastic(normal=10.0, tangential=1.0))
    assembly.fix("low:z0", name="ground")
    assembly.force(
        "up:x0", (lf.Amplitude([1, 2, 3], [0, 1e3, 4e3]) * 1.0, 0.0, 0.0), point=(0, 15, 10), name="push"
    )
    r = solved(lf.assemble(assembly), rtol, [1.0, 2.0, 3.0])
    return read(r, "joint.shear@1", "joint.shear@2", "joint.normal@2")
