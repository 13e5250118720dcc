"""Parts of a STEP file by other names: as if the file had had them, before and after other calls."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.step import StepAssembly, read_step

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from make_bracket_step import make_bracket  # noqa: E402
from parts.step_file import write_step  # noqa: E402

STEEL = lf.LinearElastic(E=200e3, nu=0.3)


def stack(path: Path, names: tuple[str, str, str, str]) -> Path:
    """A block on a block, one that is 0.3 mm above, one that lies apart."""
    boxes = ((0, 0, 0, 20, 10, 10), (5, 2, 10, 8, 6, 4), (5, 2, 14.3, 8, 6, 4), (40, 0, 0, 5, 5, 5))
    return write_step(path, lambda occ: {n: occ.addBox(*box) for n, box in zip(names, boxes, strict=True)})


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_bracket(tmp_path_factory.mktemp("step") / "bracket.step")


def completed(step: StepAssembly, a: str, b: str) -> None:
    step.material("*", STEEL)
    step.size(a, 4.0)
    step.size(f"{a}|{b}", 3.0)
    step.join(f"{b}|{a}", lf.Contact(gap=0.0))
    step.face(f"{a}:foot", normal=(0, 0, -1))


def test_as_if_the_file_had_these_names(tmp_path: Path) -> None:
    old, new = ("base", "top", "cap", "far"), ("far", "lid", "cap", "base")
    (tmp_path / "other").mkdir()
    renamed = read_step(stack(tmp_path / "stack.step", old))
    expected = read_step(stack(tmp_path / "other" / "stack.step", new))
    completed(renamed, "base", "top")
    renamed.rename(dict(zip(old, new, strict=True)))  # two of them change places
    completed(expected, "far", "lid")
    assert str(renamed) == str(expected)
    assert "nothing touches: " in str(expected) and "face each other" in str(expected)
    assert renamed.faces() == expected.faces()
    assert renamed.sides("far|lid") == expected.sides("far|lid") == ("far:lid", "lid:far")
    meshes = [step.mesh(progress=False).parts for step in (renamed, expected)]
    assert list(meshes[0]) == list(meshes[1])
    for name in new:
        assert np.array_equal(*(parts[name].mesh.geometry.x for parts in meshes))
        assert set(meshes[0][name].names) == set(meshes[1][name].names)
    renamed.rename({"far": "base", "base": "far"})  # back, and on
    renamed.rename("lid", "top")
    assert set(renamed.mesh(progress=False).parts) == set(old)


def test_a_deck_has_the_names(tmp_path: Path) -> None:
    step = read_step(stack(tmp_path / "stack.step", ("base", "top", "cap", "far")), gap=0.5)
    step.rename({"top": "plate", "base": "bed. 1"})
    completed(step, "bed. 1", "plate")
    step.rename("plate", "middle")
    step.join("middle|cap", lf.Perfect())
    scene = step.scene(progress=False)
    scene.fix("bed. 1:foot")
    deck, other = tmp_path / "deck.toml", tmp_path / "other.toml"
    scene.to_deck(deck)
    again = lf.read_deck(deck).scene
    assert list(again.substructures) == list(scene.substructures) == ["bed. 1", "middle", "cap", "far"]
    assert list(again.interfaces) == list(scene.interfaces)
    again.to_deck(other)
    assert other.read_text() == deck.read_text()


def test_what_a_part_is_taken_for_stays(bracket: Path) -> None:
    step = read_step(bracket, cuts=lf.Cut("bolt 1", normal=(0, 0, 1), through=(0, 0, 4)))
    assert list(step.solids)[-3:] == ["bolt 1-", "bolt 1+", "bolt 2"]
    step.is_bolt("bolt 2", "M10")
    titles = [f.title for f in step.found.values()]
    step.rename({"bolt 1": "left", "bolt 2": "right", "base": "ground", "bracket": "nut"})
    assert list(step.solids) == ["nut", "ground", "left-", "left+", "right"]
    assert "left-|left+" in step.touches and step.touches["left-|left+"].kind == "cut"
    assert [f.title for f in step.found.values()] == titles
    assert list(step.found) == [f.part for f in step.found.values()] == ["nut", "ground", "left", "right"]
    assert {p.part for p in step.found["left"].passages} == {"nut", "ground"}
    assert "named so ('bolt 1')" in step.found["left"].reasons
    assert not any("base" in each or "bracket" in each for f in step.found.values() for each in f.reasons)
    made = step.proposal()
    assert list(made.solids) == ["nut", "ground", "left-", "left+", "right-", "right+"]
    assert made.found["right"].title == "bolt M10" and "M10" in made.why["join", "right-|right+"]
    made.rename("right", "second bolt")
    assert "M10" in made.why["join", "second bolt-|second bolt+"]
    assert list(made.found) == ["nut", "ground", "left", "second bolt"]
    assert set(made.mesh(progress=False, order=1).parts) == set(made.solids)


@pytest.fixture(scope="module")
def named(bracket: Path) -> StepAssembly:
    step = read_step(bracket, cuts=lf.Cut("bolt 1", normal=(0, 0, 1), through=(0, 0, 4)))
    step.face("base:bolt", normal=(0, 0, -1), at=(None, None, -20))
    return step


@pytest.mark.parametrize(("given", "words"), [
    (("bolt 3", "x"), "rename: unknown part 'bolt 3'; did you mean 'bolt"),
    (("bolt 1-", "x"), "rename: unknown part 'bolt 1-'; did you mean 'bolt 1'"),
    (("bolt *", "x"), "unknown part 'bolt \\*'"),
    (("bolt 1", "base"), "'base' and 'bolt 1' would both be 'base'"),
    (("bolt 2", "bolt 1-"), "'bolt 1-' and 'bolt 2' would both be 'bolt 1-'"),
    (({"bolt 1": "x", "bolt 2": "x-"},), "'bolt 1-' and 'bolt 2' would both be 'x-'"),
    (("bolt 1", "a:b"), "without a colon"),
    (("bolt 1", "a|b"), "has a bar, which stands between parts"),
    (("bolt 1", ""), "not empty"),
    (("bolt 1", None), "a name is a string"),
    (({"bolt 1": "x"}, "y"), "beside several parts"),
    (("bolt 2", "bolt"), "the face 'base:bolt' has its name from you"),
])
def test_refused(named: StepAssembly, given: Any, words: str) -> None:
    before = str(named), named.faces()
    with pytest.raises(SceneError, match=words):
        named.rename(*given)
    assert (str(named), named.faces()) == before


def test_a_mesh_from_before_is_refused(tmp_path: Path) -> None:
    step = read_step(stack(tmp_path / "stack.step", ("base", "top", "cap", "far")))
    completed(step, "base", "top")
    meshed = step.mesh(progress=False)
    step.rename("top", "lid")
    with pytest.raises(SceneError, match="this mesh has other names; mesh again: unknown part 'lid'"):
        step.scene(meshed)
