"""STEP files: names, touching and nearly touching faces with exact areas and gaps, scenes, bad input."""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest

from dolfinx_frontend import Contact, Elastic, LinearElastic, Perfect, Preload, assemble, read_step, solve
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.finer import size_field
from dolfinx_frontend.geometry.session import gmsh_session
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step import StepAssembly

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from make_flange_step import FlangeShape, make_flange  # noqa: E402

STEEL = LinearElastic(E=200e3, nu=0.3)
EXACT = 1e-9  # relative, of areas and volumes that OpenCASCADE integrates
CHORDS = 0.01  # area of a triangulation with 32 chords a turn: 1 - sin(x) / x = 0.0064 at x = 2 pi / 32


def write(path: Path, build: Any, names: tuple[str, ...] = ()) -> Path:
    """A STEP file of the solids that `build(occ)` makes, with these product names."""
    with gmsh_session("made"):
        build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    if names:
        text = path.read_text(encoding="latin-1")
        one = len(names) == 1
        # gmsh numbers the files that a process writes, and the solids in each
        pattern = r"PRODUCT\('Open CASCADE STEP translator [\d.]+ \d+" + ("()" if one else r"\.(\d+)")
        text = re.sub(
            pattern + r"',\s*'[^']*'",
            lambda m: f"PRODUCT('{names[int(m[1] or 1) - 1]}',''",
            text,
        )
        path.write_text(text, encoding="latin-1")
    return path


def two_blocks(occ: Any, gap: float = 0.0) -> None:
    occ.addBox(0, 0, 0, 20, 10, 10)
    occ.addBox(5, 2, 10 + gap, 8, 6, 4)


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    return write(tmp_path / "blocks.step", two_blocks, ("base", "top: 1|2"))


@pytest.fixture(scope="module")
def flange(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_flange(tmp_path_factory.mktemp("step") / "flange.step")


def ready(step: StepAssembly) -> StepAssembly:
    step.material("*", STEEL)
    step.size("*", 5.0)
    return step


# -- reading -----------------------------------------------------------------------------------


def test_touching_blocks(blocks: Path) -> None:
    step = read_step(blocks)
    # a colon and a bar would be taken for those of faces and interfaces
    assert list(step.solids) == ["base", "top. 1-2"]
    assert math.isclose(step.solids["base"].volume, 2000.0, rel_tol=EXACT)
    (touch,) = step.touches.values()
    assert touch.name == "base|top. 1-2" and touch.kind == "touching"
    assert math.isclose(touch.area, 48.0, rel_tol=EXACT)
    assert touch.gap == touch.widest == 0.0
    assert np.array_equal(touch.normal, [0, 0, 1])
    assert step.sides(touch.name) == ("base:top. 1-2", "top. 1-2:base")
    table = str(step)
    assert "2 parts" in table and "touching" in table and "normal (0, 0, 1)" in table
    # the base keeps its five other faces and what is left of the upper one
    assert step.faces("base").count("plane") == 6


@pytest.mark.parametrize("gap", [0.02, 0.3])
def test_nearly_touching_blocks(tmp_path: Path, gap: float) -> None:
    path = write(tmp_path / "near.step", lambda occ: two_blocks(occ, gap))
    step = read_step(path, gap=0.5)
    assert list(step.solids) == ["part 1", "part 2"]  # nobody gave them names
    (touch,) = step.touches.values()
    # the smaller face comes first: the other one covers it
    assert touch.parts == ("part 2", "part 1") and touch.kind == "near"
    assert math.isclose(touch.area, 48.0, rel_tol=1e-6)
    assert math.isclose(touch.gap, gap, rel_tol=1e-6) and math.isclose(touch.widest, gap, rel_tol=1e-6)
    assert np.allclose(touch.normal, [0, 0, -1], atol=1e-9)


def test_a_pin_in_a_hole(tmp_path: Path) -> None:
    """Round faces with a clearance: exact distances, not those of the chords."""

    def build(occ: Any) -> None:
        plate = [(3, occ.addBox(-10, -10, 0, 20, 20, 6))]
        occ.cut(plate, [(3, occ.addCylinder(0, 0, 0, 0, 0, 6, 4.05))])
        occ.addCylinder(0, 0, -3, 0, 0, 12, 4.0)
        occ.addBox(30, 0, 0, 1, 1, 1)

    step = read_step(write(tmp_path / "pin.step", build, ("plate", "pin", "crumb")), gap=0.1)
    (touch,) = step.touches.values()
    assert touch.parts == ("plate", "pin") and touch.shape.startswith("cylinder, radius 4.05")
    assert math.isclose(touch.area, 2 * math.pi * 4.05 * 6, rel_tol=CHORDS)
    assert math.isclose(touch.gap, 0.05, rel_tol=1e-6) and math.isclose(touch.widest, 0.05, rel_tol=1e-6)
    assert not touch.normal.any()
    assert "nothing touches: 'plate' and 'crumb' are 20 apart" in str(step)


def test_a_pin_with_a_head(tmp_path: Path) -> None:
    """The shank ends in the hole: it comes first, with its own area, as the second group of the parts."""

    def build(occ: Any) -> None:
        plate = [(3, occ.addBox(-10, -10, 0, 20, 20, 6))]
        occ.cut(plate, [(3, occ.addCylinder(0, 0, 0, 0, 0, 6, 4.2))])
        pin = [(3, occ.addCylinder(0, 0, 1, 0, 0, 5, 4.0)), (3, occ.addCylinder(0, 0, 6, 0, 0, 3, 7.0))]
        occ.fuse(pin[:1], pin[1:])

    step = ready(read_step(write(tmp_path / "pin.step", build, ("plate", "pin")), gap=0.3))
    assert list(step.touches) == ["plate|pin", "pin|plate#2"]
    seat, shank = step.touches.values()
    assert math.isclose(seat.area, math.pi * (7.0**2 - 4.2**2), rel_tol=EXACT)
    assert math.isclose(shank.area, 2 * math.pi * 4.0 * 5, rel_tol=CHORDS)
    assert math.isclose(shank.gap, 0.2, rel_tol=1e-6)
    # a ring of 0.2 mm under the head, far thinner than the sagitta of the chords around it
    step.join("*", Contact(friction=0.2))
    scene = step.scene()
    assert {str(f) for i in scene.interfaces.values() for f in i.faces} == {
        "plate:pin", "pin:plate", "pin:plate#2", "plate:pin#2"
    }
    result_area = scene.substructures["pin"].part.face_area("plate")
    assert math.isclose(result_area, seat.area, rel_tol=0.05)


def test_faces_of_one_pair_are_grouped(tmp_path: Path) -> None:
    """Two feet on a plane are one interface, a step beside it another one."""

    def build(occ: Any) -> None:
        base = [(3, occ.addBox(0, 0, 0, 30, 10, 5)), (3, occ.addBox(30, 0, 0, 5, 10, 9))]
        occ.fuse(base[:1], base[1:])
        bridge = [(3, occ.addBox(0, 0, 5, 30, 10, 10))]
        occ.cut(bridge, [(3, occ.addBox(10, 0, 5, 10, 10, 4))])

    step = read_step(write(tmp_path / "feet.step", build, ("base", "bridge")))
    assert list(step.touches) == ["base|bridge", "base|bridge#2"]
    feet, side = step.touches.values()
    assert len(feet.surfaces[0]) == 2 and math.isclose(feet.area, 200.0, rel_tol=EXACT)
    assert len(side.surfaces[0]) == 1 and math.isclose(side.area, 40.0, rel_tol=EXACT)
    assert np.array_equal(feet.normal, [0, 0, 1]) and np.array_equal(side.normal, [-1, 0, 0])
    # each has a face of its own on both parts
    assert step.sides("base|bridge#2") == ("base:bridge#2", "bridge:base#2")


@pytest.mark.night(guard="test_named_faces: the same file; test_a_bolt_that_is_cut_and_tightened")
def test_the_flange(flange: Path) -> None:
    shape = FlangeShape()
    step = read_step(flange, cuts=Cut("stud *", normal=(0, 0, 2)))
    assert len(step.solids) == 35 and len(step.touches) == 42
    # stud bolts: two halves with the section between them, and the threads
    cut = step.touches["stud 3-|stud 3+"]
    assert cut.kind == "cut" and np.array_equal(cut.normal, [0, 0, 1])
    assert math.isclose(cut.area, math.pi * shape.bolt**2, rel_tol=EXACT)
    thread = step.touches["stud 3+|upper nut 3"]
    assert math.isclose(thread.area, 2 * math.pi * shape.bolt * shape.nut_height, rel_tol=EXACT)
    seat = step.touches["upper flange|gasket"]
    assert math.isclose(
        seat.area, math.pi * (shape.gasket_outer**2 - shape.gasket_inner**2), rel_tol=EXACT
    )
    # a hexagon less the hole in the flange, which is larger than the thread
    hexagon = 2 * math.sqrt(3) * (shape.nut_width / 2) ** 2
    nut = step.touches["lower flange|lower nut 8"]
    assert math.isclose(nut.area, hexagon - math.pi * shape.hole**2, rel_tol=EXACT)
    # nuts of one kind are one row of the table
    assert "upper flange|upper nut *  (8)" in str(step)
    wide = read_step(flange, gap=2.0)
    hole = wide.touches["lower flange|stud 5"]
    assert math.isclose(hole.gap, shape.hole - shape.bolt, rel_tol=1e-6)
    assert math.isclose(hole.area, 2 * math.pi * shape.hole * shape.thickness, rel_tol=CHORDS)


# -- scenes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("imprint", [True, False])
def test_a_patch_test_through_a_file(blocks: Path, tmp_path: Path, imprint: bool) -> None:
    """A bar of two blocks under traction: the same stress on meshes that match and that do not."""

    def build(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 4, 4)
        occ.addBox(10, 0, 0, 10, 4, 4)

    path = write(tmp_path / "bar.step", build, ("left", "right"))
    step = read_step(path, imprint=imprint)
    assert step.touches["left|right"].kind == ("touching" if imprint else "near")
    step.material("*", LinearElastic(E=200e3, nu=0.0))
    step.size("left", 4.0)
    step.size("right", 2.5)
    step.join("right|*", Elastic(normal=1000.0, tangential=1000.0))
    assert step.face("left:end", normal=(-1, 0, 0)) == ("left:end",)
    assert step.face("right:end", normal=(1, 0, 0), at=(20.0, None, None)) == ("right:end",)
    scene = step.scene()
    spec = scene.interfaces["left|right"]
    assert (spec.space, spec.overlap) == ("auto", "full" if imprint else "partial")
    scene.fix("left:end", components=0)
    scene.fix("left:end", components=(1, 2), name="grip")
    scene.traction("right:end", (5.0, 0.0, 0.0))
    problem = assemble(scene)
    result = solve(problem)
    assert (problem.interfaces["left|right"].matching is not None) == imprint
    assert np.allclose(result.force("left|right")[:, 0], 5.0, rtol=1e-8)
    x = problem.substructures["right"].dof_coordinates
    u = result.displacements["right"].reshape(-1, 3)[:, 0]
    assert np.allclose(u, 5.0 * x[:, 0] / 200e3 + 5.0 / 1000.0, rtol=1e-8)


def test_a_bolt_that_is_cut_and_tightened(tmp_path: Path) -> None:
    """A stud between two rigid ends: the force that was given, and the shortening that belongs to it."""
    path = write(tmp_path / "bar.step", lambda occ: occ.addBox(0, 0, 0, 3, 3, 40), ("stud",))
    step = read_step(path, cuts=[Cut("stud", (0, 0, 1), through=(0, 0, 15.0))])
    assert list(step.solids) == ["stud-", "stud+"]
    assert np.allclose([s.volume for s in step.solids.values()], [135.0, 225.0], rtol=EXACT)
    step.material("*", LinearElastic(E=200e3, nu=0.0))
    step.join("stud-|stud+", Preload(force=900.0))
    step.face("stud-:end", normal=(0, 0, -1))
    step.face("stud+:end", normal=(0, 0, 1))
    scene = step.scene(progress=False)
    scene.fix(("stud-:end", "stud+:end"))
    problem = assemble(scene)
    result = solve(problem)
    weights = problem.interfaces["stud-|stud+"].weights
    assert math.isclose(weights @ result.force("stud-|stud+")[:, 0], 900.0, rel_tol=1e-6)
    assert np.allclose(result.jump("stud-|stud+")[:, 0], -100.0 * 40.0 / 200e3, rtol=1e-5)


def test_sizes_by_part_and_by_interface(blocks: Path) -> None:
    step = ready(read_step(blocks))
    step.join("*", Perfect())
    coarse = {n: p.num_cells for n, p in step.mesh().parts.items()}
    step.size("base", 2.0)
    finer = {n: p.num_cells for n, p in step.mesh().parts.items()}
    assert finer["base"] > 5 * coarse["base"]
    step.size("base", 5.0)
    step.size("top*|base", 1.0)  # the parts in either order
    local = step.mesh(order=1)
    facets = local.parts["base"].facets("top. 1-2").size
    assert facets > 2 * 48.0 / 1.0**2 * 0.7  # two triangles of legs 1 a unit square, roughly
    assert local.parts["base"].order == 1
    assert math.isclose(local.parts["base"].face_area("top. 1-2"), 48.0, rel_tol=1e-9)


def test_later_patterns_go_before_earlier_ones(flange: Path) -> None:
    step = read_step(flange)
    step.material("*", STEEL)
    step.join("*", Perfect())
    step.join("gasket|*", Contact(gap=0.0))
    step.leave("stud 1|*")
    text = str(step)
    assert re.search(r"upper flange\|gasket .* Contact", text)
    assert re.search(r"stud 1\|lower nut 1 .* left open", text)
    assert re.search(r"stud \*\|upper nut \*  \(7\) .* Perfect", text)


def test_named_faces(flange: Path) -> None:
    shape = FlangeShape()
    step = read_step(flange)
    holes = step.face("* flange:hole", radius=shape.hole)
    assert holes == ("lower flange:hole", "upper flange:hole")
    assert step.faces("lower flange").count("hole") == 8
    with pytest.raises(SceneError, match="no free face of 'lower flange' fits") as error:
        step.face("lower flange:again", radius=shape.hole)  # they have a name
    assert "tag" in str(error.value) and "cylinder, radius 51.5" in str(error.value)
    step.face("gasket:rim", where=lambda f: f.radius == pytest.approx(shape.gasket_outer))


def test_a_mesh_serves_other_laws(blocks: Path) -> None:
    step = ready(read_step(blocks))
    step.join("*", Perfect())
    assembly = step.mesh()
    assert [c.kind for c in assembly.interfaces] == ["perfect"]
    step.join("*", Contact(gap=0.0))
    scene = step.scene(assembly)
    assert scene.substructures["base"].part is assembly.parts["base"]
    assert isinstance(scene.interfaces["base|top. 1-2"].law, Contact)
    step.leave("*")
    assert not step.scene(assembly).interfaces


def test_the_page_of_the_documentation() -> None:
    """Its examples run as they stand."""
    page = Path(__file__).resolve().parents[2] / "docs" / "step.md"
    names: dict[str, Any] = {"__name__": "docs"}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S):
        exec(compile(block, page.name, "exec"), names)
    assert names["result"].converged
    table = page.read_text().partition("```\nbolted.step")[2].partition("```")[0]
    for name, touch in names["step"].touches.items():
        found = re.search(rf"{re.escape(name)} +{touch.kind} +([\d.]+) +([\d.]+) ", table)
        assert found and math.isclose(float(found[1]), touch.area, rel_tol=CHORDS), name
        assert math.isclose(float(found[2]), touch.gap, rel_tol=1e-3, abs_tol=1e-9), name


# -- bad input ---------------------------------------------------------------------------------


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="missing.step does not exist"):
        read_step(tmp_path / "missing.step")
    text = tmp_path / "text.step"
    text.write_text("a drawing")
    with pytest.raises(SceneError, match="'text.step' cannot be read as STEP: it does not begin with ISO"):
        read_step(text)
    broken = tmp_path / "broken.step"
    broken.write_text("ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n")
    with pytest.raises(SceneError, match="'broken.step' cannot be"):
        read_step(broken)
    sheet = write(tmp_path / "sheet.step", lambda occ: occ.addRectangle(0, 0, 0, 1, 1))
    with pytest.raises(SceneError, match="'sheet.step' cannot be modelled: it holds no solid, but 1 faces"):
        read_step(sheet)


@pytest.mark.parametrize("imprint", [True, False])
def test_solids_that_overlap(tmp_path: Path, imprint: bool) -> None:
    def build(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 10, 10)
        occ.addBox(9, 0, 0, 4, 10, 10)

    path = write(tmp_path / "overlap.step", build, ("plate", "bolt"))
    wanted = r"overlap: 'plate' and 'bolt' by 100 \(25 % of the smaller one\), some 0.83 mm over 120 mm"
    with pytest.raises(SceneError, match=wanted):
        read_step(path, imprint=imprint)


def test_solids_that_do_not_touch(tmp_path: Path) -> None:
    path = write(tmp_path / "apart.step", lambda occ: two_blocks(occ, 0.3), ("base", "top"))
    wanted = (
        r"no faces touch or come nearer than gap = 0.00\d+; the nearest parts: 'base' and 'top' are 0.3 apart"
    )
    with pytest.raises(SceneError, match=wanted):
        read_step(path)


def test_patterns_that_fit_nothing(blocks: Path) -> None:
    step = ready(read_step(blocks))
    for call in (
        lambda: step.material("botl*", STEEL),
        lambda: step.size("botl*", 1.0),
        lambda: step.faces("botl*"),
        lambda: step.face("botl*:end", normal=(0, 0, 1)),
        lambda: read_step(blocks, cuts=Cut("botl*", (0, 0, 1))),
    ):
        with pytest.raises(SceneError, match=r"unknown part 'botl\*'.*known: 'base', 'top. 1-2'"):
            call()
    for call in (
        lambda: step.join("base|bolt", Perfect()),
        lambda: step.leave("base|bolt"),
        lambda: step.size("base|bolt", 1.0),
    ):
        with pytest.raises(SceneError, match=r"unknown interface 'base\|bolt'.*known: 'base\|top. 1-2'\)"):
            call()
    with pytest.raises(SceneError, match="unknown interface 'gasket'"):
        step.sides("gasket")


def test_scenes_that_are_not_complete(blocks: Path) -> None:
    step = read_step(blocks)
    with pytest.raises(SceneError, match="no material for 'base', 'top. 1-2'; give one"):
        step.scene()
    step.material("*", STEEL)
    with pytest.raises(SceneError, match=r"no law for 'base\|top. 1-2'; give one.*or leave it open"):
        step.scene()


def test_values_that_make_no_sense(blocks: Path) -> None:
    step = ready(read_step(blocks))
    for size in (0.0, -1.0, math.nan):
        with pytest.raises(SceneError, match="size of 'base': .*it must be a positive number"):
            step.size("base", size)
    with pytest.raises(SceneError, match="gap = -1; it must be a finite number >= 0"):
        read_step(blocks, gap=-1.0)
    with pytest.raises(SceneError, match="join '\\*': 3.0 is not a law"):
        step.join("*", 3.0)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="face 'base': write 'part:face'"):
        step.face("base", normal=(0, 0, 1))
    with pytest.raises(SceneError, match="give three coordinates, None for any"):
        step.face("base:end", at=(0.0,))
    with pytest.raises(SceneError, match="give three numbers"):
        step.face("base:end", normal=(0.0, 0.0, 0.0))
    with pytest.raises(SceneError, match="the name is in use on 'base'"):
        step.face("base:top. 1-2", normal=(0, 0, -1))
    with pytest.raises(SceneError, match="leaves 1 pieces, not two; move it"):
        read_step(blocks, cuts=Cut("base", (0, 0, 1), through=(0, 0, 50.0)))
    with pytest.raises(SceneError, match="order = 3 must be 1"):
        step.mesh(order=3)
    with pytest.raises(SceneError, match="a circle needs three cells"):
        step.mesh(per_turn=2)


def test_a_file_that_changed(blocks: Path) -> None:
    step = ready(read_step(blocks))
    step.join("*", Perfect())
    write(blocks, lambda occ: two_blocks(occ, 0.001), ("base", "top: 1|2"))
    with pytest.raises(SceneError, match="'blocks.step' has changed since it was read"):
        step.mesh()


def test_nothing_of_gmsh_stays_open(blocks: Path) -> None:
    assert not gmsh.isInitialized()
    ready(read_step(blocks)).mesh()
    assert not gmsh.isInitialized()


def test_one_part_is_meshed_again_on_its_true_geometry(tmp_path: Path) -> None:
    file = tmp_path / "two.step"
    with gmsh_session("write") as gmsh:
        pipe = gmsh.model.occ.cut(
            [(3, gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 10, 5))],
            [(3, gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 10, 3))],
        )[0]
        gmsh.model.occ.addBox(-6, -6, 10, 12, 12, 4)
        gmsh.model.occ.synchronize()
        assert pipe
        gmsh.write(str(file))
    step = read_step(file)
    pipe_name = min(step.solids, key=lambda n: step.solids[n].volume)
    step.size("*", 4.0)
    part = step.mesh(order=1, per_turn=6).parts[pipe_name]
    again = part.again(size_field(part.mesh, np.full(part.num_cells, 1.5)))
    true = np.pi * (25.0 - 9.0) * 10.0
    assert again.faces == part.faces and again.num_cells > 2 * part.num_cells
    # an area of chords lacks a part that falls with their square
    assert abs(again.volume() / true - 1.0) < 0.4 * abs(part.volume() / true - 1.0)
    with pytest.raises(SceneError, match="step.mesh"):
        part.again(None)
