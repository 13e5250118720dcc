"""Supports that come and go, against bars by hand: u(x) of a bar with a force F at its end is F x / (E A)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dolfinx_frontend as lf

E, LENGTH = 1000.0, 10.0  # area 1
COMPLIANCE = LENGTH / E
CLOSE = 1e-9  # rounding of unknowns, and the tolerance of the solutions
TIGHT = lf.Options(rtol=1e-10)

Build = Callable[[lf.Scene], None]


def solved(build: Build, times: list[float], held: bool = True) -> lf.Result:
    """A bar along x without lateral strain, held at x0."""
    scene = lf.Scene()
    box = lf.geometry.box((LENGTH, 1, 1), (4, 1, 1), cell="hexahedron")
    scene.substructure("bar", box, lf.LinearElastic(E=E, nu=0.0), degree=1)
    if held:
        scene.fix("bar:x0", name="root")
    build(scene)
    return lf.solve(lf.assemble(scene), times=times, options=TIGHT)


def pulled(scene: lf.Scene, times: list[float], forces: list[float]) -> None:
    """A force at the end."""
    scene.traction("bar:x1", lf.Amplitude(times, forces) * (1.0, 0.0, 0.0))


def ends(result: lf.Result) -> list[float]:
    """Displacement of the end along x at every step."""
    x = result.problem.substructures["bar"].dof_coordinates
    at_end = np.flatnonzero(x[:, 0] > LENGTH - 1e-9)
    moved = result.unknowns("bar").reshape(len(result.times), -1, 3)[:, at_end, 0]
    assert np.ptp(moved, axis=1).max() < 1e-8
    return list(moved.mean(axis=1))


def reactions(result: lf.Result, name: str) -> list[float]:
    """Along x at every step."""
    points = result.problem.interfaces[name]
    return list(np.einsum("p,tp->t", points.weights, result.force(name)[:, :, 0]))


def near(found: list[float], wanted: list[float]) -> None:
    assert found == pytest.approx(wanted, abs=CLOSE * max(map(abs, wanted)) + 1e-9)


def test_a_bar_that_is_loaded_and_released() -> None:
    def build(scene: lf.Scene) -> None:
        scene.body_force("bar", lf.Amplitude([0, 1], [0, 1]) * (1.0, 0.0, 0.0))
        scene.fix("bar:x1", 0.0, 0, "grip", during=((0, 1),))

    result = solved(build, [0.5, 1.0, 2.0])
    assert result.converged
    near(ends(result), [0.0, 0.0, 0.5 * LENGTH * COMPLIANCE])
    near(reactions(result, "grip"), [-2.5, -5.0, 0.0])  # each end takes half


@pytest.mark.parametrize(("kept", "far"), [(0.0, 0.02), (1.0, 0.1), (0.25, 0.04)])
def test_a_stop_that_comes_later(kept: float, far: float) -> None:
    """It brings the end to .02, holds it where it was, or a quarter of the way."""

    def build(scene: lf.Scene) -> None:
        pulled(scene, [0, 1, 2, 3], [0, 10, 30, 30])
        scene.fix("bar:x1", 0.02, 0, "stop", during=((1, 2),), kept=kept)

    result = solved(build, [1.0, 2.0, 3.0])
    near(ends(result), [0.1, far, 0.3])
    near(reactions(result, "stop"), [0.0, far / COMPLIANCE - 30.0, 0.0])


def test_the_way_to_a_value() -> None:
    """As in decks: linear from where the end is; then the value moves it; then it is held where it is."""

    def build(scene: lf.Scene) -> None:
        pulled(scene, [0, 1, 2], [0, 10, 10])
        value = lf.Amplitude([3, 4], [1, 2]) * 0.02
        way = lf.Amplitude([1, 3, 4, 5], [1, 0, 0, 1]) * 1.0
        scene.fix("bar:x1", value, 0, "grip", during=((1, 4), (5, 7)), kept=way)

    result = solved(build, [1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0])
    near(ends(result), [0.1, 0.06, 0.02, 0.03, 0.04, 0.1, 0.1, 0.1])


def test_one_support_takes_over_from_another() -> None:
    def build(scene: lf.Scene) -> None:
        scene.body_force("bar", lf.Amplitude([0, 1], [0, 1]) * (1.0, 0.0, 0.0))
        scene.fix("bar:x0", name="first", during=((0, 1),))
        scene.fix_point("bar", (10.0, 0.0, 0.0), 0.0, None, "second", during=((1, 2),), kept=1.0)
        for point, axes in (((10.0, 1.0, 0.0), (0, 2)), ((10.0, 0.0, 1.0), 0)):
            scene.fix_point("bar", point, 0.0, axes, during=((1, 2),), kept=1.0)

    result = solved(build, [1.0, 2.0], held=False)
    assert result.converged
    near(reactions(result, "first"), [-10.0, 0.0])
    x = result.problem.substructures["bar"].dof_coordinates
    corner = int(np.flatnonzero(np.all(np.isclose(x, (10.0, 0.0, 0.0)), axis=1))[0])
    moved = result.unknowns("bar").reshape(2, -1, 3)[:, corner]
    assert moved[0] == pytest.approx([0.05, 0.0, 0.0], abs=1e-10)
    assert moved[1] == pytest.approx(moved[0], abs=1e-10)


def test_faces_that_share_an_edge_hold_it_together() -> None:
    """Where steps add up: the part of the last one is that of a block that is held at once."""

    def block(build: Build) -> lf.Problem:
        scene = lf.Scene()
        box = lf.geometry.box((2, 1, 1), (4, 2, 2), cell="tetrahedron")
        scene.substructure("bar", box, lf.LinearElastic(E=E, nu=0.3), degree=2)
        scene.fix("bar:x0")
        build(scene)
        return lf.assemble(scene)

    def late(scene: lf.Scene) -> None:
        scene.traction("bar:x1", lf.Amplitude([0, 1, 2], [0, 1, 2]) * (0.01, 0.02, 0.0))
        for face in ("bar:y0", "bar:z0"):
            scene.fix(face, during=((1, 2),), kept=1.0)

    def always(scene: lf.Scene) -> None:
        scene.traction("bar:x1", (0.01, 0.02, 0.0))
        scene.fix(["bar:y0", "bar:z0"])

    in_steps = lf.solve(block(late), times=[1.0, 2.0], options=TIGHT).unknowns("bar")
    at_once = lf.solve(block(always)).unknowns("bar")
    assert in_steps[1] - in_steps[0] == pytest.approx(at_once, abs=1e-8 * np.abs(in_steps).max())


def test_a_random_value() -> None:
    """The force of the stop is linear in its value."""
    value = lf.Normal("far", mean=0.05, std=0.01)

    scene = lf.Scene()
    box = lf.geometry.box((LENGTH, 1, 1), (2, 1, 1), cell="hexahedron")
    scene.substructure("bar", box, lf.LinearElastic(E=E, nu=0.0), degree=1)
    scene.fix("bar:x0")
    pulled(scene, [0, 1], [0, 10])
    scene.fix("bar:x1", value, 0, "stop", during=((1, 2),))
    problem = lf.assemble(scene)
    chaos = lf.solve(problem, times=[1.0, 2.0], chaos=1, options=TIGHT)
    assert reactions(chaos, "stop") == pytest.approx([0.0, 0.05 / COMPLIANCE - 10.0], abs=1e-8)
    moved = chaos.std("bar", step=1).x.array
    assert moved.max() == pytest.approx(0.01, abs=1e-10)
    sampled = lf.quasi_monte_carlo(problem, 64, times=[1.0, 2.0]).quantity("stop.force_x", step=1).values
    assert sampled.mean() == pytest.approx(-5.0, abs=3.0 / 8.0)
    assert sampled.std(ddof=1) == pytest.approx(1.0, abs=3.0 / np.sqrt(128.0))


def test_friction_remembers_what_a_support_did() -> None:
    """A block is dragged by 1, let go and dragged back: sliding friction turns round, mu p = 20."""
    scene = lf.Scene()
    box = lf.geometry.box((1, 1, 1), (3, 3, 1), cell="hexahedron")
    scene.substructure("block", box, lf.LinearElastic(E=210e3, nu=0.0), degree=1)
    scene.interface("floor", "block:z0", lf.Contact(friction=0.2, stiffness=1e6, tangential_stiffness=2e3))
    scene.pressure("block:z1", 100.0)
    scene.fix("block:x0", components=1)
    scene.fix("block:x0", 0.05, 0, "out", during=((0, 1),))
    scene.fix("block:x1", -0.03, 0, "back", during=((2, 3),))
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0, 3.0])
    assert result.converged
    points = result.problem.interfaces["floor"]
    shear = np.einsum("p,tpi,pij->tj", points.weights, result.force("floor"), points.frames)[:, 0]
    # let go it springs back by the elastic slip, 20 / 2000
    x = result.unknowns("block").reshape(3, -1, 3)[:, :, 0].mean(axis=1)
    assert shear == pytest.approx([-20.0, 0.0, 20.0], abs=2e-2)
    assert x == pytest.approx([0.05, 0.04, -0.03], abs=1e-3)  # the block shears by 20 / G


def test_what_is_let_go_and_loaded_is_named() -> None:
    def build(scene: lf.Scene) -> None:
        scene.fix("bar:x0", name="root", during=((0, 1),))
        pulled(scene, [0, 1], [0, 10])

    with pytest.warns(lf.SceneWarning, match="no equilibrium at step 1, t = 2: 'bar' has lost its support"):
        result = solved(build, [1.0, 2.0], held=False)
    assert result.statuses == ("converged", "no_equilibrium")


def test_what_is_let_go_without_loads_is_warned_of() -> None:
    def build(scene: lf.Scene) -> None:
        scene.fix("bar:x0", lf.Amplitude([0, 1], [0, 1]) * 0.1, name="root", during=((0, 1),))

    with pytest.warns(lf.SceneWarning, match="'bar' has lost its support at step 1"):
        solved(build, [1.0, 2.0], held=False)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"during": ((2, 1),)}, r"during = \(\(2, 1\),\); intervals increase"),
        ({"during": (1, 2)}, "give intervals"),
        ({"during": ()}, "give intervals"),
        ({"kept": 1.0}, "kept = 1 without during"),
        ({"during": ((0, 1),), "kept": float("nan")}, "kept = nan is not finite"),
    ],
)
def test_bad_intervals(settings: dict[str, object], message: str) -> None:
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((1, 1), (1, 1)), lf.LinearElastic(E=E, nu=0.0))
    with pytest.raises(lf.SceneError, match=message):
        scene.fix("bar:x0", **settings)  # type: ignore[arg-type]


def test_an_interval_without_a_step_is_refused() -> None:
    with pytest.raises(lf.SceneError, match="'grip': it holds after 1 up to 2, and no step is there"):
        solved(lambda scene: scene.fix("bar:x1", name="grip", during=((1, 2),)), [1.0, 3.0])


def test_it_wants_times() -> None:
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((1, 1), (1, 1)), lf.LinearElastic(E=E, nu=0.0))
    scene.fix("bar:x0")
    scene.fix("bar:x1", name="grip", during=((0, 1),))
    with pytest.raises(lf.SceneError, match=r"'grip': values change in time: solve with times"):
        lf.solve(lf.assemble(scene))


def test_a_deck_says_it_in_the_same_words(tmp_path: Path) -> None:
    deck = tmp_path / "bar.toml"
    deck.write_text("""\
[substructure.bar]
box = { lengths = [10, 1, 1], divisions = [2, 1, 1], cell = "hexahedron" }
material = "LinearElastic"
E = 1000
nu = 0.0

[[fix]]
faces = "bar:x0"

[amplitude.load]
times = [0, 1]
values = [0, 1]

[[traction]]
faces = "bar:x1"
t = { amplitude = "load", value = [10, 0, 0] }

[[fix]]
faces = "bar:x1"
components = 0
name = "stop"
during = [[1, 2]]
kept = 1.0
""")
    scene = lf.read_deck(deck).scene
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0, 3.0])
    near(ends(result), [0.1, 0.1, 0.1])
    again = tmp_path / "again.toml"
    scene.to_deck(again)
    twice = lf.solve(lf.assemble(lf.read_deck(again).scene), times=[1.0, 2.0, 3.0])
    assert np.array_equal(twice.unknowns("bar"), result.unknowns("bar"))


def test_what_it_prescribes_contradicts_others_while_it_holds() -> None:
    def build(scene: lf.Scene) -> None:
        scene.fix("bar:z0", 0.01, 2, "lift", during=((1, 2),))

    with pytest.raises(lf.SceneError, match="'lift' and 'root' prescribe different displacements at 2"):
        solved(build, [1.0, 2.0])
    assert solved(build, [0.5, 1.0]).converged
