"""Loads, rigid faces and bolts as people write them: what is meant works, what is not meant says so."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
import ufl

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from latin_core import Options

RAMP = lf.Amplitude([0.0, 1.0], [0.0, 1.0])
TIGHT = Options(rtol=1e-9)


def blocks(*origins: float, E: float = 200e3, nu: float = 0.0, **material: Any) -> lf.Scene:
    """Cubes of 10 mm along x: a, b, ..."""
    scene = lf.Scene()
    for name, x in zip("abc", origins):
        box = geometry.box((10, 10, 10), (2, 2, 2), origin=(x, 0, 0), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(E, nu, **material), degree=1)
    return scene


@pytest.mark.parametrize("size", [(10.0, 10.0, 10.0), (200.0, 1.0, 1.0), (1e-3, 1e-3, 1e-5)])
@pytest.mark.parametrize("motion", [{"x": 0.1, "y": -0.2}, {"z": 0.3, "rx": 0.01, "ry": 0.02, "rz": -0.03}])
def test_a_part_moved_as_a_whole(size: Any, motion: dict[str, float]) -> None:
    """Nothing is strained: the answer is the rigid motion, and it is known."""
    scene = lf.Scene()
    scene.substructure("a", geometry.box(size, (6, 2, 2)), lf.LinearElastic(200e3, 0.3), degree=1)
    given = {**dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 0.0), **motion}
    scene.rigid("a:x0", point=(0, 0, 0), **given)
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    assert result.status == "converged"
    x = problem.substructures["a"].dof_coordinates
    exact = [given[k] for k in "xyz"] + np.cross([given[k] for k in ("rx", "ry", "rz")], x)
    scale = np.abs(exact).max()
    assert result.unknowns("a").reshape(-1, 3) == pytest.approx(exact, abs=1e-12 * scale)


def test_a_load_too_small_beside_a_motion_is_still_inexact() -> None:
    scene = blocks(0.0)
    scene.fix("a:x0", (1.0, 0.0, 0.0))
    scene.force("a:x1", (1e-9, 0.0, 0.0))
    assert lf.solve(lf.assemble(scene)).status == "inexact"


def test_forces_that_are_rounding_raise_no_warning() -> None:
    """A symmetric joint does not bend its bolt: what rounding makes of that is no error of the chaos."""
    scene = lf.Scene()
    k = lf.LogNormal("k", 1.0, cov=0.1)
    for name, z in (("a", 0.0), ("b", 10.0)):
        box = geometry.box((10, 10, 10), (2, 2, 2), origin=(0, 0, z), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(200e3, 0.3), degree=1)
    scene.interface("seat", "a:z1", "b:z0", lf.Contact())
    scene.fix("a:z0")
    scene.fix("b:z1", components=(0, 1))
    bolt = lf.BoltStiffness.vdi2230(5, 0.8, 10, 5, 205e3)
    scene.beam("bolt", "a:z0", "b:z1", lf.BoltStiffness(k * bolt.axial, k * bolt.bending, k * bolt.torsion))
    scene.force("b:z1", (0, 0, -500.0 * lf.LogNormal("F", 1.0, cov=0.1)))
    problem = lf.assemble(scene)
    with warnings.catch_warnings():
        warnings.simplefilter("error", lf.TruncationWarning)
        chaos = lf.solve(problem, chaos=2)
    assert chaos.trusted and "bolt.bending1" in chaos.checks


@pytest.mark.parametrize("kind", ["matrix", "ufl"])
def test_expansion_as_a_tensor(kind: str) -> None:
    """Free expansion by a full tensor: u = alpha dT x, no stress."""
    alpha = np.array([[1.0, 0.2, 0.1], [0.2, 2.0, 0.3], [0.1, 0.3, 3.0]]) * 1e-5
    given: Any = alpha if kind == "matrix" else ufl.as_matrix(alpha.tolist())
    scene = blocks(0.0, nu=0.3, alpha=given)
    scene.temperature("a", 100.0)
    scene.fix_point("a", (0, 0, 0))
    scene.fix_point("a", (0, 0, 10), components=(0, 1), name="edge")
    scene.fix_point("a", (0, 10, 0), components=0, name="side")
    problem = lf.assemble(scene)
    result = lf.solve(problem)
    u = result.unknowns("a").reshape(-1, 3)
    x = problem.substructures["a"].dof_coordinates
    free = x @ (alpha * 100.0)
    # a rigid rotation takes what the points hold
    modes = np.concatenate([np.cross(np.eye(3)[i], x).reshape(-1, 1) for i in range(3)], axis=1)
    turned = np.linalg.lstsq(modes, (u - free).ravel(), rcond=None)
    assert u.ravel() == pytest.approx(free.ravel() + modes @ turned[0], abs=1e-12)
    assert np.abs(result.stress("a").x.array).max() < 1e-8 * 200e3 * 1e-3


def test_values_that_change_in_time_are_scaled_and_added() -> None:
    p = lf.Normal("p", 2.0, cov=0.1)
    for value, factor in ((RAMP * p * 3.0, 6.0), (3.0 * (RAMP * p), 6.0), (-(RAMP * p) / 2.0, -1.0)):
        scene = blocks(0.0)
        scene.fix("a:x0", name="foot")
        scene.force("a:x1", (value, 0.0, 0.0), name="pull")
        result = lf.solve(lf.assemble(scene), times=[0.5, 1.0])
        read = result.reaction("foot", "x")(next(result.blocks()))
        assert np.ravel(read)[-1] == pytest.approx(-factor, rel=1e-9)
    both = RAMP * (1.0, 2.0) - (0.5, 0.0)
    assert [[c * x for x in v] for c, v in both.at(0.5).terms] == [[0.5, 1.0], [-0.5, -0.0]]
    halved = 0.5 * (RAMP * (lambda x: x[:, 0]))
    assert halved.terms[0][1](np.array([[4.0, 1.0]])) == pytest.approx([2.0])
    with pytest.raises(lf.SceneError, match="products"):
        RAMP * 2.0 * RAMP
    with pytest.raises(lf.SceneError, match="'x'; multiply it by a number"):
        RAMP * 2.0 * "x"


def test_a_component_of_a_traction_may_change_in_time_and_scatter() -> None:
    scene = blocks(0.0)
    scene.fix("a:x0", name="foot")
    t = lf.Normal("t", 2.0, cov=0.1)
    scene.traction("a:x1", (0.0, RAMP * t, 1.0), name="drag")
    result = lf.solve(lf.assemble(scene), times=[0.5, 1.0], chaos=1)
    read = result.quantity(result.reaction("foot", "y"))
    assert read.mean().value == pytest.approx(-200.0, rel=0.01)
    assert result.reaction("foot", "z")(next(result.blocks(8))) == pytest.approx(-100.0, rel=1e-9)


def bolted(law: lf.Law) -> lf.Scene:
    scene = blocks(0.0, 10.0)
    scene.interface("bolt", "a:x1", "b:x0", law)
    scene.fix("a:x0", name="foot")
    scene.fix("b:x1")
    return scene


def torque(**settings: Any) -> lf.Preload:
    given = {"torque": 100.0, "mu_thread": 0.1, "mu_head": 0.12, "d": 10.0, "pitch": 1.5}
    return lf.Preload(**{**given, **settings})


def test_torque_and_friction_are_swept_together() -> None:
    grid = {"bolt.torque": [50.0, 100.0], "bolt.mu_head": [0.1, 0.2], "bolt.mu_thread": [0.05, 0.15, 0.25]}
    problem = lf.assemble(bolted(torque()))
    assert set(grid) <= set(problem.law_parameters)
    swept = lf.sweep(problem, grid, options=TIGHT, progress=False)
    force = swept.force("bolt")[..., 0] @ problem.interfaces["bolt"].weights
    d2 = 10.0 - 0.6495 * 1.5
    for i, M in enumerate(grid["bolt.torque"]):
        for j, head in enumerate(grid["bolt.mu_head"]):
            for k, thread in enumerate(grid["bolt.mu_thread"]):
                lever = 1.5 / (2 * math.pi) + thread * d2 / (2 * math.cos(math.pi / 6)) + head * 13.0 / 2
                assert force[i, j, k] == pytest.approx(M / lever, rel=1e-8)
    with pytest.raises(lf.SceneError, match="bolt.mu_head.*>= 0"):
        lf.sweep(problem, {"bolt.torque": [50.0], "bolt.mu_head": [0.1, -0.1]}, progress=False)


@pytest.mark.parametrize(
    "name, source",
    [
        ("mu_thread", lf.Normal("mu", 0.1, cov=1.0)),
        ("mu_head", lf.Normal("mu", 0.1, cov=0.5)),
        ("torque", lf.Normal("M", 100.0, cov=1.0)),
        ("embedding", lf.Normal("f", 1e-3, cov=1.0)),
    ],
)
def test_samples_below_zero_are_refused(name: str, source: Any) -> None:
    given = {name: source} | ({"until": 1.0} if name == "embedding" else {})
    problem = lf.assemble(bolted(torque(**given)))
    times = {"times": [1.0, 2.0]} if name == "embedding" else {}
    with pytest.raises(lf.SceneError, match=rf"'bolt'.*samples give it a negative {name} .*LogNormal"):
        lf.monte_carlo(problem, 400, seed=1, progress=False, **times)


def test_a_bolt_that_pushes_is_doubted() -> None:
    for law in (lf.Preload(force=-10.0), lf.Preload(shortening=-0.1)):
        with pytest.warns(lf.SceneWarning, match="'bolt'.*pushes its sides apart"):
            bolted(law)
    tightened = lf.Preload(force=10.0, until=1.0, embedding=1.0)
    with pytest.warns(lf.SceneWarning, match="'bolt': the bolt pushes with .*embedding"):
        lf.solve(lf.assemble(bolted(tightened)), times=[1.0, 2.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fine = lf.Preload(force=10.0, until=1.0, embedding=1e-6)
        lf.solve(lf.assemble(bolted(fine)), times=[1.0, 2.0])


def test_bad_input_says_what_to_do() -> None:
    scene = blocks(0.0, 30.0)
    for axial in (-1.0, 0.0, math.nan, math.inf):
        with pytest.raises(lf.SceneError, match="axial = .*positive"):
            lf.BoltStiffness(axial, 1.0, 1.0)
    bolt = lf.BoltStiffness(1e3, 1e3, 1e3)
    with pytest.raises(lf.SceneError, match="beam 'bolt'.*stiffness = 5.*BoltStiffness"):
        scene.beam("bolt", "a:x1", "b:x0", bolt, lf.Preload(force=10.0, stiffness=5.0))
    scene.fix_point("a", (0, 0, 0), components=0)
    with pytest.raises(lf.SceneError, match="name="):
        scene.fix_point("a", (0, 0, 0), components=1)
    for wrong in ([[1.0, 2.0, 0.0]] * 3, np.ones((2, 3)), np.ones((1, 1, 1))):
        with pytest.raises(lf.SceneError, match="(?s)alpha = .*symmetric"):
            scene.temperature("a", 1.0, alpha=wrong)
    for form in (lambda v: v[0] + 1, lambda v: v[0] * v[1]):
        one = blocks(0.0)
        one.fix("a:x1")
        one.load("a", form)
        with pytest.raises(lf.SceneError, match="'load\\(a\\)': .*not linear in the test function"):
            lf.assemble(one)
    one = blocks(0.0)
    one.fix("a:x1")
    one.temperature("a", 1.0, alpha=(1e-5, 2e-5))
    with pytest.raises(lf.SceneError, match="alpha has the shape"):
        lf.assemble(one)
    one = blocks(0.0)
    one.fix("a:x1")
    one.rigid("a:x0", point=(1, 2), x=0.1)
    with pytest.raises(lf.SceneError, match="point has 2 numbers, the part 3"):
        lf.solve(lf.assemble(one))


def test_a_plane_over_parts_of_random_moduli() -> None:
    """A factor does not go through a group of several parts; a field of one mode, which is a number, does."""

    def heads(bolt: Any, sleeve: Any) -> lf.Problem:
        scene = lf.Scene()
        for name, E, alpha, size, x in (("bolt", bolt, 12e-6, 10, 0), ("sleeve", sleeve, 23e-6, 20, 30)):
            box = geometry.box((size, size, 50), (1, 1, 2), origin=(x, 0, 0), cell="hexahedron")
            scene.substructure(name, box, lf.LinearElastic(E, 0.3, alpha=alpha), degree=1)
            scene.temperature(name, 100.0)
            scene.symmetry([f"{name}:x0", f"{name}:y0", f"{name}:z0"])
        scene.plane(["bolt:z1", "sleeve:z1"], tilts=False, name="head")
        return lf.assemble(scene)

    E = lf.LogNormal("E", 200e3, cov=0.1)
    with pytest.raises(lf.SceneError, match="'head.*RandomField"):
        lf.solve(heads(E, 70e3), chaos=1)
    whole = {"cov": 0.1, "length": 1e6, "modes": 1, "distribution": "lognormal"}
    problem = heads(lf.RandomField("Eb", 200e3, **whole), lf.RandomField("Es", 70e3, **whole))
    chaos = lf.solve(problem, chaos=4, options=TIGHT)
    germs = np.array([[0.0, 0.0], [1.0, -0.5], [-1.5, 1.0]])
    stress = lf.AtPoint(problem, "bolt", (5, 5, 25), "stress", "zz")
    spread = math.sqrt(math.log(1.01))
    moduli = np.array([200e3, 70e3]) / math.sqrt(1.01) * np.exp(spread * germs)
    exact = 11e-6 * 100.0 / (1.0 / moduli[:, 0] + 100.0 / (moduli[:, 1] * 400.0))
    samples = lf.sample(problem, germs, options=TIGHT, keep_states=True, progress=False)
    # the field loses what 1e-5 of a correlation length is long
    assert samples.quantity(stress).values == pytest.approx(exact, rel=1e-4)
    assert stress(chaos.at(germs)) == pytest.approx(exact, rel=1e-3)
