"""Decks that are written: read again they are the scene, and what they cannot hold is refused by name.

That CalculiX answers the same is what `benchmarks/calculix.py` measures.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from dolfinx_frontend.decks.command import main

STEEL = lf.LinearElastic(E=200e3, nu=0.3)
TIGHT = lf.Options(rtol=1e-10)
CELLS = {"tetrahedron": 3, "hexahedron": 3, "triangle": 2, "quadrilateral": 2}


def fields(problem: lf.Problem, result: Any) -> dict[tuple[str, ...], np.ndarray]:
    """Place of a node -> its last displacement, of the one from below where there are two."""
    found: dict[tuple[str, ...], np.ndarray] = {}
    for name, part in problem.substructures.items():
        x = part.dof_coordinates
        for place, u in zip(x, result.unknowns(name).reshape(-1, len(x), problem.dim)[-1], strict=True):
            found[tuple(f"{v + 0.0:.6f}" for v in np.round(place, 6) + 0.0)] = u
    return found


def assert_read_again(scene: lf.Scene, folder: Path, tolerance: float, times: Any = None) -> None:
    """Displacements of the deck that is written are those of the scene, at the nodes that both have."""
    problem, file = lf.assemble(scene), folder / "scene.inp"
    lf.write_inp(problem, file, times)
    deck = lf.read_inp(file)
    again = lf.assemble(deck.scene())
    given = {} if times is None else {"times": times}
    ours = fields(problem, lf.solve(problem, progress=False, options=TIGHT, **given))
    given = {} if deck.times is None else {"times": deck.times}
    theirs = fields(again, lf.solve(again, progress=False, options=TIGHT, **given))
    assert set(ours) == set(theirs)
    largest = max(np.abs(u).max() for u in ours.values())
    assert max(np.abs(u - theirs[x]).max() for x, u in ours.items()) < tolerance * largest


def two(cell: str, degree: int, law: lf.Interface | Any, divisions: int = 2, **scene: Any) -> lf.Scene:
    """A unit block on another one, which is held."""
    d, made = CELLS[cell], lf.Scene(**scene)
    for name, level in (("lower", 0.0), ("upper", 1.0)):
        origin = (*([1.0 if scene else 0.0] * (d - 1)), level)
        box = geometry.box((1.0,) * d, (divisions,) * d, origin=origin, cell=cell)
        made.substructure(name, box, STEEL, degree=degree)
    up = "xyz"[d - 1]
    made.interface("joint", f"upper:{up}0", f"lower:{up}1", law)
    made.fix(f"lower:{up}0", name="ground")
    return made


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_elements_and_forces_are_those_of_the_parts(cell: str, degree: int, tmp_path: Path) -> None:
    """Glued parts of every cell: nothing is approximate, whatever the numbering of dolfinx is."""
    scene, d = two(cell, degree, lf.Perfect()), CELLS[cell]
    up = "xyz"[d - 1]
    if (cell, degree) == ("hexahedron", 2):  # nodes in the middle of faces, which take load, are not there
        scene.fix("upper:z1", np.array([1e-3, 0.0, 2e-3]))
    else:
        scene.traction(f"upper:{up}1", np.arange(1.0, d + 1.0))
        scene.pressure("upper:x1", lambda x: 3.0 + x[:, 1])
    assert_read_again(scene, tmp_path, 1e-9)


def test_a_section_of_a_ring(tmp_path: Path) -> None:
    scene = two("quadrilateral", 2, lf.Perfect(), axisymmetric=True)
    scene.fix("upper:y1", (1e-3, -1e-3))
    assert_read_again(scene, tmp_path, 1e-5)  # u / r has another quadrature on cells with middle nodes


def test_contact_with_friction_and_its_history(tmp_path: Path) -> None:
    """With stiffnesses of its own nothing of the law is replaced."""
    law = lf.Contact(friction=0.2, stiffness=1e6, tangential_stiffness=1e5, gap=1e-4)
    scene = two("tetrahedron", 2, law)
    press = lf.Amplitude([0, 1, 4], [0, 1, 1]) * (0.0, 0.0, -2e-3)
    scene.fix("upper:z1", press + lf.Amplitude([1, 2, 3], [0, 1, -1]) * (3e-3, 0.0, 0.0), name="head")
    assert_read_again(scene, tmp_path, 1e-6, [1.0, 2.0, 3.0])


def test_rigid_contact_is_a_stiff_one(tmp_path: Path) -> None:
    """Under a pressure p the blocks overlap by p h / (300 E), beside what a confined column shortens."""
    scene = two("hexahedron", 1, lf.Contact())
    for face in ("x0", "y0", "x1", "y1"):
        axis = "xy".index(face[0])
        scene.fix([f"lower:{face}", f"upper:{face}"], components=axis)
    scene.pressure("upper:z1", 10.0)
    file = tmp_path / "scene.inp"
    lf.write_inp(lf.assemble(scene), file)
    again = lf.assemble(lf.read_inp(file).scene())
    top = min(u[2] for u in fields(again, lf.solve(again, progress=False, options=TIGHT)).values())
    confined = 200e3 * 0.7 / (1.3 * 0.4)
    modulus = again.parts["E_LOWER"].modulus  # an estimate of E
    assert top == pytest.approx(-20.0 / confined - 10.0 * 0.5 / (300.0 * modulus), rel=1e-6)


def test_layers_ties_and_rigid_bodies(tmp_path: Path) -> None:
    scene = two("tetrahedron", 2, lf.Elastic(normal=4e4, tangential=1e4))
    scene.rigid("upper:z1", point=(0.0, 0.0, 2.0), name="head", x=1e-3, z=0.0, ry=1e-4, rx=0.0)
    assert_read_again(scene, tmp_path, 1e-8)


def test_oblique_supports_bodies_and_heat(tmp_path: Path) -> None:
    c, s = math.cos(0.4), math.sin(0.4)
    scene = lf.Scene()
    block = geometry.box((1.0, 1.0, 1.0), (2, 2, 2), cell="tetrahedron")
    scene.substructure("block", block, lf.LinearElastic(E=200e3, nu=0.3, alpha=1e-5))
    scene.fix("block:z0", (1e-4, 2e-4, 0.0), [0, 1], frame=[[c, s, 0.0], [0.0, 0.0, 1.0], [s, -c, 0.0]])
    scene.symmetry("block:x0")
    scene.fix_point("block", (1.0, 1.0, 1.0), components=1)
    scene.body_force("block", (0.0, 0.0, lf.Normal("g", 5.0, cov=0.1)))
    scene.force("block:x1", (0.0, 3.0, 0.0), moment=(1.0, 0.0, 0.0))
    scene.temperature("block", 40.0)
    assert_read_again(scene, tmp_path, 1e-9)


def passing(**second: Any) -> lf.Scene:
    """A bar that is pulled, held where it is, let go, and bent to a place."""
    scene = lf.Scene()
    bar = geometry.box((4.0, 1.0, 1.0), (2, 1, 1), cell="hexahedron")
    scene.substructure("bar", bar, STEEL, degree=1)
    scene.fix("bar:x0")
    scene.traction("bar:x1", lf.Amplitude([0, 1, 2], [0, 1, 0.5]) * (10.0, 2.0, 0.0))
    scene.fix("bar:x1", components=(0, 1), name="jig", during=((1, 2),), kept=1.0)
    scene.fix("bar:x1", 0.01, name="lift", **({"components": 2, "during": ((2, 3), (4, 5))} | second))
    return scene


def test_supports_that_come_and_go(tmp_path: Path) -> None:
    for last in (2.0, 3.0, 5.0):
        times = [1.0, *np.arange(2.0, last + 0.5)]
        assert_read_again(passing(), tmp_path, 1e-9, times=times)
    turned = {"frame": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "components": 0}
    assert_read_again(passing(**turned), tmp_path, 1e-9, times=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(("second", "words"), [
    ({"kept": 0.5}, "'lift', Held: kept = 0.5 at t = 3"),
    ({"frame": [[1, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]]}, "'lift', Held: its axes are oblique"),
])
def test_supports_that_a_deck_cannot_hold(second: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(lf.SceneError, match=words):
        lf.write_inp(lf.assemble(passing(**second)), tmp_path / "scene.inp", times=[1.0, 2.0, 3.0])


def test_an_orthotropic_block(tmp_path: Path) -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    axes = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
    wood = lf.OrthotropicElastic(E=(12e3, 1e3, 600.0), nu=(0.4, 0.4, 0.3), G=(800.0, 700.0, 60.0), axes=axes)
    scene = lf.Scene()
    scene.substructure("wood", geometry.box((1.0, 1.0, 1.0), (2, 2, 2), cell="tetrahedron"), wood)
    scene.fix("wood:x0")
    scene.fix("wood:x1", (-0.01, 0.0, 0.0))
    assert_read_again(scene, tmp_path, 1e-9)


def bolt(law: lf.Preload, second: str = "tetrahedron") -> lf.Scene:
    """A bar that is cut, between two walls, and symmetric."""
    scene = lf.Scene()
    for name, z, cell in (("left", 0.0, "tetrahedron"), ("right", 1.0, second)):
        scene.substructure(name, geometry.box((1, 1, 1), (2, 2, 2), origin=(0, 0, z), cell=cell), STEEL)
    scene.interface("cut", "left:z1", "right:z0", law)
    scene.fix(["left:z0", "right:z1"])
    scene.fix(["left:x0", "right:x0"], components=0)
    return scene


def test_a_section_that_is_shortened(tmp_path: Path) -> None:
    assert_read_again(bolt(lf.Preload(shortening=1e-3)), tmp_path, 1e-9)


def test_a_section_that_is_tightened_and_fixed(tmp_path: Path) -> None:
    file = tmp_path / "bolt.inp"
    lf.write_inp(lf.assemble(bolt(lf.Preload(force=50.0, until=1.0))), file, [1.0, 2.0, 3.0])
    first, second, third = file.read_text().split("*STEP")[1:]
    assert "1, 50\n" in first.split("*CLOAD\n")[1].splitlines(keepends=True)[0]
    assert "*BOUNDARY, FIXED" in second and "FIXED" not in first + third and "50" not in third


BEAM = lf.BoltStiffness.vdi2230(d=0.2, pitch=0.02, shank=1.0, thread=1.0, E=200e3)
REFUSED = {
    "beam": (lambda s: s.beam("bolt", "lower:x0", "upper:x0", BEAM), "bolt.axial"),
    "springs": (lambda s: s.springs("upper:z1", x=1.0), "springs"),
    "plane": (lambda s: s.plane("upper:z1"), "plane.*Plane"),
    "ground": (lambda s: s.interface("bed", "upper:z1", lf.Elastic(normal=1.0)), "bed"),
    "field": (lambda s: s.temperature("upper", lambda x: x[:, 0], alpha=1e-5), "temperature of 'upper'"),
    "strain": (lambda s: s.initial_strain("upper", np.eye(3)), "initial_strain of 'upper'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_a_deck_cannot_hold_is_refused_by_name(what: str, tmp_path: Path) -> None:
    scene = two("hexahedron", 1, lf.Contact(friction=0.1))
    REFUSED[what][0](scene)
    with pytest.raises(lf.SceneError, match=f"write_inp: .*{REFUSED[what][1]}"):
        lf.write_inp(lf.assemble(scene), tmp_path / "scene.inp")
    assert not (tmp_path / "scene.inp").exists()


LAWS = {
    "threshold": lf.Contact(threshold=1.0), "jump": lf.Contact(jump=-0.1, friction=0.1),
    "tangential": lf.Elastic(normal=1.0), "not one number": lf.Contact(friction=lambda x: 0.1 + x[:, 0]),
}


@pytest.mark.parametrize("word", LAWS)
def test_laws_that_a_deck_cannot_hold_are_refused(word: str, tmp_path: Path) -> None:
    with pytest.raises(lf.SceneError, match=f"interface 'joint'.*{word}"):
        scene = two("hexahedron", 1, LAWS[word])
        scene.fix("upper:z1")
        lf.write_inp(lf.assemble(scene), tmp_path / "scene.inp")


def test_parts_and_sections_that_a_deck_cannot_hold(tmp_path: Path) -> None:
    file = tmp_path / "scene.inp"
    with pytest.raises(lf.SceneError, match="substructure 'lower'.*degree = 3"):
        lf.write_inp(lf.assemble(two("triangle", 3, lf.Perfect())), file)
    for law in (lf.Preload(force=1.0, until=1.0, embedding=0.1), lf.Preload(force=1.0, stiffness=5.0)):
        with pytest.raises(lf.SceneError, match="'cut', Preload.*nothing in series"):
            lf.write_inp(lf.assemble(bolt(law)), file, [1.0, 2.0])
    with pytest.raises(lf.SceneError, match="'cut', Preload.*tighten a bolt again"):
        lf.write_inp(lf.assemble(bolt(lf.Preload(force=1.0, during=((0, 1), (2, 3))))), file, [1.0, 2.0, 3.0])
    with pytest.raises(lf.SceneError, match="'cut', Preload.*node for node"):
        lf.write_inp(lf.assemble(bolt(lf.Preload(force=1.0), "hexahedron")), file)
    with pytest.raises(lf.SceneError, match="assemble the scene first"):
        lf.write_inp(lf.Scene(), file)


def test_a_deck_in_toml_is_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = two("hexahedron", 1, lf.Contact(friction=0.1))
    scene.pressure("upper:z1", lf.Amplitude([1, 2], [1, 2]) * 1.0)
    scene.fix("upper:x0", components=0)
    lf.write_inp(lf.assemble(scene), tmp_path / "a.inp", [1.0, 2.0])
    scene.to_deck(tmp_path / "b.toml")
    text = (tmp_path / "b.toml").read_text()
    (tmp_path / "b.toml").write_text(f"[run]\ntimes = [1, 2]\n{text}")
    assert main(["convert", str(tmp_path / "b.toml"), str(tmp_path / "b.inp")]) == 0
    assert "b.inp" in capsys.readouterr().out
    assert (tmp_path / "a.inp").read_text() == (tmp_path / "b.inp").read_text()
