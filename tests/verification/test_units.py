"""One scene in six systems of units is one answer, for every law and kind of joint, direct and iterated.

Multiplying lengths, forces and what is made of them by constants changes no equation. What is left is
rounding where a scene is solved directly, and the tolerance of the iteration (1e-10 here) elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import dolfinx_frontend as lf

UNITS = {
    "N-m": (1e-3, 1.0),
    "kN-m": (1e-3, 1e-3),
    "N-um": (1e3, 1.0),
    "N-nm": (1e6, 1.0),
    "kN-mm": (1.0, 1e-3),
}
"""(length, force) of a unit by those of mm and N, inverse: a length of 1 mm is 1e-3 in metres."""
SAME = 1e-8
BLOCK = (30.0, 30.0, 10.0)
Build = Callable[[float, float], tuple[lf.Scene, dict]]


def _blocks(a: float, f: float, divisions=((2, 2, 1), (2, 2, 1)), gap: float = 0.0) -> lf.Scene:
    scene = lf.Scene()
    for k, each in enumerate(divisions):
        part = lf.geometry.box(
            tuple(v * a for v in BLOCK), each, origin=(0.0, 0.0, (BLOCK[2] + gap) * k * a), cell="hexahedron"
        )
        scene.substructure(f"p{k}", part, lf.LinearElastic(210e3 * f / a**2, 0.3), degree=1)
    scene.fix("p0:x0")
    return scene


def _loaded(scene: lf.Scene, a: float, f: float, history: lf.Amplitude | None = None) -> lf.Scene:
    traction = tuple(v * f / a**2 for v in (3.0, 2.0, -3.0))
    scene.traction("p1:x1", traction if history is None else history * traction)
    return scene


def _soft(a: float, f: float, stiffness: float = 100.0) -> lf.Elastic:
    return lf.Elastic(normal=stiffness * f / a**3, tangential=0.3 * stiffness * f / a**3)


def _joint(law: Callable[[float, float], object], matching: bool = True) -> Build:
    def build(a: float, f: float) -> tuple[lf.Scene, dict]:
        scene = _blocks(a, f, ((2, 2, 1), (2, 2, 1)) if matching else ((3, 2, 1), (2, 2, 1)))
        scene.interface("joint", "p0:z1", "p1:z0", law(a, f))
        scene.interface("bed", "p1:x0", _soft(a, f))
        return _loaded(scene, a, f), {}

    return build


def _beam(a: float, f: float) -> tuple[lf.Scene, dict]:
    scene = _blocks(a, f)
    scene.interface("joint", "p0:z1", "p1:z0", _soft(a, f, 1e3))
    scene.beam("bolt", "p0:z0", "p1:z1", lf.BoltStiffness(1e5 * f / a, 1e6 * f * a, 1e6 * f * a))
    return _loaded(scene, a, f), {}


def _springs(a: float, f: float) -> tuple[lf.Scene, dict]:
    scene = _blocks(a, f)
    scene.interface("joint", "p0:z1", "p1:z0", _soft(a, f, 1e3))
    moments = {axis: 1e6 * f * a for axis in ("rx", "ry", "rz")}
    scene.springs("p1:z1", "ground", x=1e4 * f / a, y=2e4 * f / a, z=3e4 * f / a, **moments)
    return _loaded(scene, a, f), {}


def _node(a: float, f: float) -> tuple[lf.Scene, dict]:
    scene = _blocks(a, f)
    scene.interface("joint", "p0:z1", "p1:z0", _soft(a, f, 1e3))
    scene.fix_point("p1", (30.0 * a, 30.0 * a, 20.0 * a), 1e-3 * a, components=2, name="node")
    return _loaded(scene, a, f), {}


def _bolt(a: float, f: float) -> tuple[lf.Scene, dict]:
    scene = _blocks(a, f)
    scene.interface("joint", "p0:z1", "p1:z0", lf.Contact(friction=0.2, gap=0.0))
    scene.interface("bed", "p1:x0", _soft(a, f, 10.0))
    stiffness = lf.BoltStiffness(1e5 * f / a, 3e6 * f * a, 3e6 * f * a)
    scene.beam("bolt", "p0:z0", "p1:z1", stiffness, lf.Preload(3000.0 * f, until=1.0))
    return _loaded(scene, a, f, lf.Amplitude([1, 2], [0, 0.3])), {"times": [1.0, 2.0]}


def _section(a: float, f: float) -> tuple[lf.Scene, dict]:
    scene = _blocks(a, f)
    scene.interface("joint", "p0:z1", "p1:z0", lf.Preload(3000.0 * f, until=1.0))
    scene.interface("bed", "p1:z1", _soft(a, f))
    return _loaded(scene, a, f, lf.Amplitude([1, 2], [0, 0.3])), {"times": [1.0, 2.0]}


SCENES: dict[str, Build] = {
    "springs between parts": _joint(lambda a, f: _soft(a, f, 1e3)),
    "springs on other meshes": _joint(lambda a, f: _soft(a, f, 1e3), matching=False),
    "perfect": _joint(lambda a, f: lf.Perfect()),
    "perfect on other meshes": _joint(lambda a, f: lf.Perfect(), matching=False),
    "contact": _joint(lambda a, f: lf.Contact()),
    "friction": _joint(lambda a, f: lf.Contact(friction=0.2)),
    "elastic slip": _joint(
        lambda a, f: lf.Contact(friction=0.2, stiffness=1e3 * f / a**3, tangential_stiffness=300.0 * f / a**3)
    ),
    "bond": _joint(
        lambda a, f: lf.Debonding(
            normal=1e3 * f / a**3, tangential=300.0 * f / a**3, strength=200.0 * f / a**2, opening=a
        )
    ),
    "law of a user": _joint(
        lambda a, f: lf.UserLaw(
            force=lambda jump, kappa: kappa[:, None] * jump, values={"kappa": 1e3 * f / a**3}
        )
    ),
    "pretension section": _section,
    "beam": _beam,
    "springs of mean motions": _springs,
    "node": _node,
    "bolt over friction": _bolt,
}
ONE_POINT = ("beam", "springs of mean motions", "node", "bolt over friction")


def _answer(build: Build, a: float, f: float, **settings: object) -> lf.Result:
    scene, times = build(a, f)
    return lf.solve(lf.assemble(scene), progress=False, options=lf.Options(rtol=1e-10), **times, **settings)


def _difference(result: lf.Result, known: lf.Result, a: float, f: float) -> float:
    """Largest relative difference of the displacements and forces of two answers, by part and interface."""
    worst = 0.0
    for name, u in known.displacements.items():
        worst = max(worst, float(np.abs(result.displacements[name] / a - u).max() / np.abs(u).max()))
    for name, surface in known.problem.interfaces.items():
        if surface.wrench is None:
            continue
        # all but axial beams and springs along an axis resist rotations, by moments
        length = 1.0 if name.split(".")[-1] in ("axial", "x", "y", "z") else a
        own, force = np.asarray(known.force(name)), np.asarray(result.force(name))
        worst = max(worst, float(np.abs(force / (f * length) - own).max() / max(np.abs(own).max(), 1.0)))
    return worst


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("active", [None, "all"])
def test_units(name: str, active: str | None) -> None:
    known = _answer(SCENES[name], 1.0, 1.0, active=active)
    assert known.status == "converged"
    for unit, (a, f) in UNITS.items():
        result = _answer(SCENES[name], a, f, active=active)
        assert result.status == "converged", unit
        # a proposal of Newton's more, where the error of the last one is the tolerance but for rounding
        assert abs(result.iterations - known.iterations) <= max(2, 0.2 * known.iterations), unit
        assert _difference(result, known, a, f) < SAME, unit


@pytest.mark.parametrize("name", ONE_POINT)
@pytest.mark.parametrize("method", ["accelerated", "latin"])
def test_units_of_points_by_each_iteration(name: str, method: str) -> None:
    """The plain iteration is linear: it stops at its tolerance only."""
    known = _answer(SCENES[name], 1.0, 1.0, method=method, active="all")
    for unit in ("N-m", "N-nm"):
        a, f = UNITS[unit]
        result = _answer(SCENES[name], a, f, method=method, active="all")
        assert result.status == known.status, unit
        assert _difference(result, known, a, f) < SAME, unit


@pytest.mark.parametrize("diameter", [2.0, 12.0, 64.0, 200.0])
def test_bolts_of_all_sizes(diameter: float) -> None:
    """A bolt between blocks of 3 by 1 diameters: with and without an interface kept it is one answer, which
    grows with the scene (stiffness E d, E d^3)."""

    def build(a: float, f: float) -> tuple[lf.Scene, dict]:
        scene = _blocks(a, f)
        scene.interface("joint", "p0:z1", "p1:z0", _soft(a, f, 1e3))
        shank = lf.BoltStiffness.of_cylinders([(20.0 * a, 10.0 * a)], E=205e3 * f / a**2)
        scene.beam("bolt", "p0:z0", "p1:z1", shank)
        return _loaded(scene, a, f), {}

    small, scale = _answer(build, 1.0, 1.0), diameter / 10.0
    for active in (None, ["joint"], "all"):
        large = _answer(build, scale, scale**2, active=active)
        assert large.status == "converged" and _difference(large, small, scale, scale**2) < SAME


@pytest.mark.parametrize("bending", [1e6, 8e8, 1e10, 1e12])
def test_large_bolt_between_large_blocks(bending: float) -> None:
    """Its bending stiffness in N mm is a large number, and no stiff spring."""
    scene = lf.Scene()
    for k in range(2):
        part = lf.geometry.box((200, 200, 100), (2, 2, 1), origin=(0, 0, 100.0 * k), cell="hexahedron")
        scene.substructure(f"p{k}", part, lf.LinearElastic(210e3, 0.3), degree=1)
    scene.fix("p0:x0")
    scene.interface("j", "p0:z1", "p1:z0", lf.Elastic(normal=100.0, tangential=30.0))
    scene.beam("bolt", "p0:z0", "p1:z1", lf.BoltStiffness(3e6, bending, bending))
    scene.traction("p1:x1", (3.0, 2.0, -3.0))
    problem = lf.assemble(scene)
    exact = lf.reference.monolithic(problem).u["p1"]
    found = lf.solve(problem, progress=False)
    assert found.status == "converged"
    # the reference is one factorisation: rounding of bending E I / L beside E
    rounding = 1e-13 * bending / 1e6 + 1e-9
    assert np.abs(found.displacements["p1"] - exact).max() < rounding * np.abs(exact).max()
