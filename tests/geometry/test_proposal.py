"""Scenes from what parts are taken for: laws with their reasons, what was given holds, forces in balance."""

from __future__ import annotations

import inspect
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.step import StepAssembly
from dolfinx_frontend.geometry.threads import SIZES, preload
from tests.geometry.assemblies import hexagon

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from make_bracket_step import make_bracket  # noqa: E402
from make_flange_step import make_flange  # noqa: E402
from parts.step_file import write_step  # noqa: E402
from proposed_from_step import CASES, balances  # noqa: E402


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_bracket(tmp_path_factory.mktemp("step") / "bracket.step")


def named_faces(step: StepAssembly) -> None:
    step.face("base:below", normal=(0, 0, -1), at=(None, None, -20))
    step.face("bracket:back", normal=(-1, 0, 0))


def test_bracket_runs_and_is_in_balance(bracket: Path) -> None:
    step = lf.read_step(bracket)
    step.size("b*", 15.0)
    named_faces(step)
    scene = step.propose(scatter=False)
    scene.fix("base:below", name="support")
    later = lf.Amplitude([1, 2], [0, 1])
    scene.force("bracket:back", (0.0, later * 500.0, later * 400.0), name="pull")
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0], progress=False)
    assert result.converged
    table = result.table("support")
    assert np.allclose([table.value(f"force_{x}", "support") for x in "xyz"], [0, -500, -400], atol=0.1)
    bolts = result.bolts()
    for k in (1, 2):
        force = bolts.value("before", f"bolt {k}-|bolt {k}+")
        assert math.isclose(force, preload(SIZES["M8"]).mean, rel_tol=1e-4)


def test_laws_and_reasons(bracket: Path) -> None:
    step = lf.read_step(bracket)
    made = step.proposal()
    laws: dict[str, Any] = {n: (j.law if j else None, made.why["join", n]) for n, j in made._joins.items()}
    assert set(laws) == {
        "bracket|base", "bracket|bolt 1-", "bracket|bolt 2-", "base|bolt 1+", "base|bolt 2+",
        "bolt 1-|bolt 1+", "bolt 2-|bolt 2+",
    }
    joint, head = laws["bracket|base"], laws["bracket|bolt 1-"]
    assert joint[0].friction.mean == 0.165 and "A6" in joint[1]
    assert head[0].friction.mean == 0.12 and "A5, class B" in head[1]
    assert isinstance(laws["base|bolt 1+"][0], lf.Perfect) and "thread" in laws["base|bolt 1+"][1]
    force = laws["bolt 1-|bolt 1+"][0].force
    # alpha_A = 2: the greatest is twice the least, which are four deviations apart
    assert math.isclose(force.std / force.mean, 1.0 / 6.0) and "M8, class 8.8" in laws["bolt 1-|bolt 1+"][1]
    stronger = step.proposal(grade="10.9", tightening="impact")._joins["bolt 2-|bolt 2+"].law.force
    assert math.isclose(stronger.mean + 2 * stronger.std, preload(SIZES["M8"], "10.9").high)
    with pytest.raises(SceneError, match="unknown property class '8.7'"):
        step.propose(grade="8.7")


def test_what_was_given_holds(bracket: Path) -> None:
    step = lf.read_step(bracket)
    named_faces(step)
    soft = lf.LinearElastic(E=70e3, nu=0.33)
    step.material("br*", soft)
    step.material("bolt 2", soft)
    step.size("bolt 1", 3.0)
    step.join("bracket|base", lf.Perfect())
    step.leave("bracket|bolt 1")
    made = step.proposal()
    assert isinstance(made._joins["bracket|base"].law, lf.Perfect)
    assert made._joins["bracket|bolt 1-"] is None and made._joins["bracket|bolt 2-"] is not None
    kept = {n for n, body in made._bodies.items() if body.material is soft}
    assert kept == {"bracket", "bolt 2-", "bolt 2+"} and made._sizes["bolt 1+"] == 3.0
    ((_, below),) = [(k, v) for k, v in made._named.items() if k == ("base", "below")]
    (surface,) = [s for s in made.solids["base"].surfaces if s.tag in below]
    assert np.allclose(surface.normal, [0, 0, -1]) and math.isclose(surface.centre[2], -20.0)


def test_overruled_parts_are_proposed_so(bracket: Path) -> None:
    step = lf.read_step(bracket)
    step.is_bolt("bolt 1", "M10")
    step.is_not("bolt 2")
    made = step.proposal()
    assert "M10" in made.why["join", "bolt 1-|bolt 1+"]
    assert "bolt 2" in made.solids and "bolt 2-" not in made.solids
    assert isinstance(made._joins["bracket|bolt 2"].law, lf.Perfect)


def test_flange(tmp_path: Path) -> None:
    """Studs are cut between their nuts, gaskets are in contact on both sides."""
    made = lf.read_step(make_flange(tmp_path / "flange.step")).proposal()
    for k in range(1, 9):
        assert made.touches[f"stud {k}-|stud {k}+"].kind == "cut"
        halves = [made.solids[f"stud {k}{end}"] for end in "-+"]
        assert math.isclose(halves[0].volume, halves[1].volume, rel_tol=1e-6)
    tied = {n for n, j in made._joins.items() if j is not None and isinstance(j.law, lf.Perfect)}
    assert len(tied) == 16 and all("stud" in n and "nut" in n for n in tied)
    seats = [n for n in made._joins if "gasket" in n]
    assert len(seats) == 2 and all(isinstance(made._joins[n].law, lf.Contact) for n in seats)
    assert made._bodies["gasket"].material.E < made._bodies["stud 1+"].material.E


def test_what_no_bolt_clamps_is_tied(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        return {"a": occ.addBox(0, 0, 0, 10, 10, 5), "b": occ.addBox(0, 0, 5, 10, 10, 5)}

    made = lf.read_step(write_step(tmp_path / "two.step", build)).proposal()
    assert isinstance(made._joins["a|b"].law, lf.Perfect) and "no bolt" in made.why["join", "a|b"]


def mount(occ: Any) -> dict[str, int]:
    """A foot with a wall on a base over a gasket, two M10 with round heads and nuts; nothing has a name."""

    def pin(x: float, low: float, high: float, r: float) -> tuple[int, int]:
        return 3, occ.addCylinder(x, 0, low, 0, 0, high - low, r)

    def bored(body: tuple[int, int], low: float, high: float) -> int:
        return int(occ.cut([body], [pin(x, low - 1, high + 1, 5.5) for x in (-30, 30)])[0][0][1])

    base = bored((3, occ.addBox(-50, -25, -12, 100, 50, 12)), -12, 0)
    gasket = bored((3, occ.addBox(-50, -25, 0, 100, 50, 2)), 0, 2)
    floor, wall = (3, occ.addBox(-50, -25, 2, 100, 50, 10)), (3, occ.addBox(-6, -25, 2, 12, 50, 40))
    solids = [base, gasket, bored(occ.fuse([floor], [wall])[0][0], 2, 12)]
    for x in (-30, 30):
        solids.append(occ.fuse([pin(x, -22, 12, 5)], [pin(x, 12, 18.4, 8)])[0][0][1])
        solids.append(occ.cut([pin(x, -20, -12, 8)], [pin(x, -23, -11, 5)])[0][0][1])
    return {f"P{k}": int(tag) for k, tag in enumerate(solids)}


def test_a_sheet_has_the_joints_of_a_gasket(tmp_path: Path) -> None:
    """No shape tells a material: it is asked for, and all else is proposed as with a name."""
    def joints(step: StepAssembly) -> dict[str, Any]:
        made = step.proposal()
        laws = {n: j.law if j else None for n, j in made._joins.items()}
        frictions = {n: law.friction for n, law in laws.items() if isinstance(law, lf.Contact)}
        return {n: (type(law), getattr(frictions.get(n), "mean", None)) for n, law in laws.items()}

    step = lf.read_step(write_step(tmp_path / "mount.step", mount))
    found = step.found["P1"]
    assert found.kind == "sheet" and found.between == ("P0", "P2")
    (said,) = step.misfits
    assert said.startswith("'P1' is a thin sheet between two parts, and no shape tells its material: give")
    as_sheet = joints(step)
    assert "a gasket has some 1 GPa" in step.proposal().why["material", "P1"]
    step.is_gasket("P1")
    assert not step.misfits and joints(step) == as_sheet
    step.is_not("P1")
    other = lf.read_step(tmp_path / "mount.step")
    other.material("P1", lf.LinearElastic(E=70e3, nu=0.33))
    assert not other.misfits


@pytest.mark.night(guard="test_bracket_runs_and_is_in_balance")
def test_a_gasket_under_a_side_load_is_in_balance(tmp_path: Path) -> None:
    step = lf.read_step(write_step(tmp_path / "mount.step", mount))
    titles = [f.title for f in step.found.values()]
    assert titles == ["", "sheet", "", "bolt M10", "nut M10", "bolt M10", "nut M10"]
    step.is_gasket("P1")
    step.size("*", 25.0)
    step.face("P0:ends", where=lambda s: abs(abs(s.centre[0]) - 50.0) < 1e-6)
    step.face("P2:wall", normal=(-1, 0, 0), at=(-6, None, None))
    scene = step.propose(per_turn=5)
    scene.fix("P0:ends", name="support")
    scene.force("P2:wall", (lf.Amplitude([1, 2], [0, 1]) * 1000.0, 0, 0), name="side")
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0], progress=False)
    assert result.converged
    held = [result.table("support").value(f"force_{x}", "support") for x in "xyz"]
    assert np.allclose(held, [-1000.0, 0.0, 0.0], atol=0.5)


@pytest.mark.parametrize(
    "case",
    ["bracket", pytest.param("flange", marks=pytest.mark.night(guard="test_bracket_runs_and_is_in_balance")),
     pytest.param("mount", marks=pytest.mark.night(guard="test_bracket_runs_and_is_in_balance"))],
)
def test_demos_are_proposed_in_balance(tmp_path: Path, case: str) -> None:
    """In under 15 lines each; the balances are those of their demos."""
    make, build, load, joint = CASES[case]
    assert len(inspect.getsource(build).splitlines()) < 17  # with its name and docstring
    result = lf.solve(lf.assemble(build(make(tmp_path / f"{case}.step"))), times=[1.0, 2.0], progress=False)
    rest, shared, _ = balances(result, load, joint)
    assert result.converged and rest < 1e-6 and abs(shared) < 1e-6


def screw_in_block(occ: Any, bore: float) -> dict[str, int]:
    """A cap screw M10 through a plate into a block, whose hole has the radius `bore`."""
    def pin(low: float, high: float, r: float) -> tuple[int, int]:
        return 3, occ.addCylinder(0, 0, low, 0, 0, high - low, r)

    block = occ.cut([(3, occ.addBox(-20, -20, -25, 40, 40, 25))], [pin(-20, 0, bore)])[0][0][1]
    plate = occ.cut([(3, occ.addBox(-20, -20, 0, 40, 40, 10))], [pin(-1, 11, 5.5)])[0][0][1]
    screw = occ.fuse([pin(-15, 10, 5)], [pin(10, 20, 8)])[0][0][1]
    return {"block": block, "plate": plate, "ISO 4762 M10x25": screw}


@pytest.mark.parametrize("imprint", [True, False])
def test_a_thread_drawn_with_an_overlap_is_tied(tmp_path: Path, imprint: bool) -> None:
    """Nominal screw, hole of the core: the area of the thread is that of the screw, pi d l."""
    file = write_step(tmp_path / "m10.step", lambda occ: screw_in_block(occ, 4.25))
    step = lf.read_step(file, imprint=imprint)
    assert step.found["ISO 4762 M10x25"].title == "bolt M10" and not step.misfits
    volume = 40**2 * 25 - math.pi * (25 * 15 + 4.25**2 * 5)
    assert math.isclose(step.solids["block"].volume, volume, rel_tol=1e-9)
    if not imprint:  # nothing is divided, so nothing is known to be one face
        return
    thread = step.touches["block|ISO 4762 M10x25"]
    assert thread.kind == "thread" and math.isclose(thread.gap, -0.75) and "thread" in str(step)
    assert math.isclose(thread.area, 2 * math.pi * 5 * 15, rel_tol=1e-9)
    made = step.proposal()
    assert isinstance(made._joins["block|ISO 4762 M10x25+"].law, lf.Perfect)
    assert "0.75 mm into its hole: tied over its length" in made.why["join", "block|ISO 4762 M10x25+"]


@pytest.mark.parametrize("bore", [4.95, 3.6])
def test_other_overlaps_are_refused(tmp_path: Path, bore: float) -> None:
    """A press fit is no thread, and a hole that is narrower than any core is a mistake."""
    with pytest.raises(SceneError, match="solids overlap: 'block' and 'ISO 4762 M10x25'"):
        lf.read_step(write_step(tmp_path / "m10.step", lambda occ: screw_in_block(occ, bore)))


def test_a_screw_at_its_core_is_in_its_thread(tmp_path: Path) -> None:
    """Drawn at its core in a hole of the minor diameter, which is wider: the head tells the size."""
    def build(occ: Any) -> dict[str, int]:
        def pin(low: float, high: float, r: float) -> tuple[int, int]:
            return 3, occ.addCylinder(0, 0, low, 0, 0, high - low, r)

        solids = screw_in_block(occ, 4.25)
        occ.remove([(3, solids["ISO 4762 M10x25"])], recursive=True)
        socket = occ.cut([pin(10, 20, 8)], [hexagon(occ, 0, 0, 15, 20, 8.0, 0.0)])[0][0]
        solids["screw"] = occ.fuse([pin(-15, 10, 4.08)], [socket])[0][0][1]
        return {k: v for k, v in solids.items() if k != "ISO 4762 M10x25"}

    step = lf.read_step(write_step(tmp_path / "core.step", build))
    found = step.found["screw"]
    assert found.title == "bolt M10" and [p.fits for p in found.passages] == [True, False]
    made = step.proposal()  # reads it again with a gap in which the thread is seen
    tied = {n for n, j in made._joins.items() if j is not None and isinstance(j.law, lf.Perfect)}
    assert tied == {"screw+|block"} and math.isclose(made.touches["screw+|block"].gap, 0.17, rel_tol=1e-3)
