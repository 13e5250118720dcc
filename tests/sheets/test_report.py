"""The answer sheet: its numbers against closed forms and the tables of the answer, and what it says."""

from __future__ import annotations

import base64
import csv
import io
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend.io import FileError
from dolfinx_frontend.sheets.turning import view_of
from parts.lap_joint import lap_joint
from tests.helpers import refused
from tests.verification import scenes

A, E, L = 400.0, 200e3, 10.0
K_BOLT, LAYER = 4e5, 1e5
K_PLATES = 1.0 / (2.0 * L / (E * A) + 1.0 / (LAYER * A))  # two bars and the contact layer in series
PHI = K_BOLT / (K_BOLT + K_PLATES)
PRELOAD, LOAD, SHEAR, MU = 5e4, 2e4, 2e3, 0.2
TIMES = [0.5, 1.0, 1.5, 2.0]
ON = lf.Amplitude([1, 2], [0, 1])


def joint(
    preload: object = PRELOAD,
    load: float = LOAD,
    shear: float = 0.0,
    friction: float | None = None,
    history: bool = True,
    name: str = "bolt",
    moment: float = 0.0,
) -> lf.Problem:
    """Two bars with a contact layer, clamped by a bolt that is a beam between their far ends."""
    scene = lf.Scene()
    for level, part in enumerate(("base", "cover")):
        box = lf.geometry.box((20.0, 20.0, L), (2, 2, 1), (0.0, 0.0, L * level), cell="hexahedron")
        scene.substructure(part, box, lf.LinearElastic(E=E, nu=0.0), degree=1)
        held = ["x0", "y0"] if friction is None else ["y0"]
        if not moment:
            scene.symmetry([f"{part}:{face}" for face in held])
    law = lf.Contact(stiffness=LAYER) if friction is None else lf.Contact(stiffness=LAYER, friction=friction)
    scene.interface("joint", "base:z1", "cover:z0", law)
    # bending of the bolt would take a share of the shear
    stiffness = lf.BoltStiffness(K_BOLT, 1e-3, 1e-3)
    bolt = lf.Preload(preload, until=1.0) if history else lf.Preload(preload)
    scene.beam(name, "base:z0", "cover:z1", stiffness, bolt)
    scene.fix("base:z0")
    scene.force("cover:z1", (shear * ON, 0.0, load * ON) if history else (shear, 0.0, load), name="load")
    if moment:
        scene.springs("cover:z1", rz=3e6)
        scene.force("cover:z1", moment=(0.0, 0.0, moment * ON), name="turn")
    return lf.assemble(scene)


def test_load_factor_of_two_bars_and_a_bolt(tmp_path: Path) -> None:
    result = lf.solve(joint(), times=TIMES, options=lf.Options(rtol=1e-10))
    sheet = lf.report(result, tmp_path / "new" / "sheet", units=("mm", "N"), stress_area=84.3, pictures=False)
    exact = {
        "F_M": PRELOAD,
        "F_V": PRELOAD,
        "F_S": PRELOAD + PHI * LOAD,
        "F_S min": PRELOAD,
        "F_S max": PRELOAD + PHI * LOAD,
        "F_SA": PHI * LOAD,
        "F_A": LOAD,
        "Phi": PHI,
        "F_KV": PRELOAD,
        "F_KR": PRELOAD - (1.0 - PHI) * LOAD,
        "m_K": 1.0 - (1.0 - PHI) * LOAD / PRELOAD,
        "sigma_a": 0.5 * PHI * LOAD / 84.3,
        "open": 0.0,
    }
    for key, value in exact.items():
        assert sheet.value("bolt", key) == pytest.approx(value, rel=1e-7, abs=1e-12), key
    assert sheet.weakest == "bolt" and "against opening" in sheet.sentences[0]
    # what is written is what it holds, and the CSV has every digit
    page, numbers = tmp_path / "new" / "sheet.html", tmp_path / "new" / "sheet.csv"
    assert page.read_text() == sheet.html
    rows = {row["key"]: row for row in csv.DictReader(io.StringIO(numbers.read_text()))}
    assert float(rows["Phi"]["value"]) == sheet.value("bolt", "Phi") and rows["F_V"]["unit"] == "N"
    assert float(rows["F_V"]["error_mesh"]) < 1e-3 and rows["sigma_a"]["unit"] == "MPa"
    assert "no check by these or other codes" in sheet.html and "src='http" not in sheet.html


def test_the_bolt_table_is_that_of_the_answer() -> None:
    result = lf.solve(joint(), times=TIMES)
    table, sheet = result.bolts(), lf.report(result, pictures=False, errors=False)
    for column, key in (("before", "F_M"), ("after", "F_S"), ("lowest", "F_S min"), ("highest", "F_S max")):
        assert sheet.value("bolt", key) == table.value(column, "bolt.axial")
    assert sheet.value("bolt", "F_KR") == pytest.approx(-result.table("joint").value("normal", "joint"))


def test_slip() -> None:
    """Shear Q on a joint with friction: S_G = mu F_K / Q, and the margin is what is left of the friction."""
    result = lf.solve(joint(load=0.0, shear=SHEAR, friction=MU), times=TIMES, options=lf.Options(rtol=1e-10))
    sheet = lf.report(result, pictures=False)
    assert sheet.value("bolt", "F_Q") == pytest.approx(SHEAR, rel=1e-6)
    assert sheet.value("bolt", "S_G") == pytest.approx(MU * PRELOAD / SHEAR, rel=1e-6)
    assert sheet.value("bolt", "m_G") == pytest.approx(1.0 - SHEAR / (MU * PRELOAD), rel=1e-6)
    assert "slip" in sheet.sentences[0]
    # another coefficient than that of the law
    other = lf.report(result, pictures=False, friction={"joint": 0.1})
    assert other.value("bolt", "S_G") == pytest.approx(0.5 * MU * PRELOAD / SHEAR, rel=1e-6)


@pytest.mark.parametrize(("of_limit", "slips"), [(0.5, False), (2.0, True)])
def test_a_joint_that_turns_slips_though_its_forces_cancel(of_limit: float, slips: bool) -> None:
    """A square of side a under uniform pressure p turns where M = mu p int r dA = 0.3826 mu p a^3."""
    limit = 0.3826 * MU * PRELOAD / A * 20.0**3
    problem = joint(load=0.0, friction=MU, moment=of_limit * limit)
    result = lf.solve(problem, times=TIMES, options=lf.Options(rtol=1e-6))
    sheet = lf.report(result, pictures=False, errors=False)
    assert sheet.value("bolt", "F_Q") < 0.01 * MU * PRELOAD
    used = result.table("joint").value("slip_use", "joint")  # its middle sticks: a quarter of it
    assert used == pytest.approx(0.75, rel=1e-6) if slips else used < 0.6
    assert sheet.value("bolt", "margin") == (0.0 if slips else pytest.approx(1.0, abs=0.01))
    assert (sheet.value("bolt", "S_G") == 1.0) == slips


def test_bolts_of_the_lap_joint_clamp_its_plates() -> None:
    """Of the contacts of plates, heads and nuts the sheet takes that of the plates, shared by both bolts."""
    parts = lap_joint("coarse")
    pull = lf.Amplitude([1, 2], [0, 1]) * (0.02, 0.0, 0.0)
    problem = lf.assemble(scenes.demo("bolted_lap_joint").build_scene(parts, pull))
    result = lf.solve(problem, times=[1.0, 2.0], options=lf.Options(rtol=1e-8, max_iterations=500))
    sheet = lf.report(result, pictures=False, errors=False)
    clamping = sum(sheet.value(f"cut{k}", "F_KV") for k in (1, 2))
    # the ends of the plates are held: they take a little of what the bolts press
    assert clamping == pytest.approx(sum(sheet.value(f"cut{k}", "F_V") for k in (1, 2)), rel=5e-3)
    assert clamping == pytest.approx(-result.table("plates", step=0).value("normal", "plates"), rel=1e-9)
    assert all("“plates”" in each or "Weakest" not in each for each in sheet.sentences)
    # sizes of the shares, which differ a little in direction
    shear = result.table("plates").value("shear", "plates")
    assert shear <= sum(sheet.value(f"cut{k}", "F_Q") for k in (1, 2)) < 1.01 * shear
    other = lf.report(result, pictures=False, errors=False, joints={"cut1": "head1"})
    assert other.value("cut1", "F_KV") == pytest.approx(other.value("cut1", "F_V"), rel=1e-5)


def test_open_joint() -> None:
    """More load than the joint can be unloaded by: the bolt takes all of it, and the sheet says so."""
    result = lf.solve(joint(load=2.0 * PRELOAD), times=TIMES)
    sheet = lf.report(result, pictures=False)
    assert sheet.value("bolt", "F_S max") == pytest.approx(2.0 * PRELOAD, rel=1e-5)
    assert sheet.value("bolt", "m_K") == pytest.approx(0.0, abs=1e-6)
    assert sheet.value("bolt", "open") == pytest.approx(1.0)
    assert "Nothing is left" in sheet.sentences[0] and "verdict bad" in sheet.html


def test_random_preload() -> None:
    """F_V is what is drawn, and the joint opens where F_V < (1 - Phi) F_A."""
    limit = (1.0 - PHI) * LOAD
    preload = lf.Normal("F", mean=limit, cov=0.1)
    problem = joint(preload)
    drawn = lf.monte_carlo(problem, 400, seed=1, times=TIMES, progress=False)
    sheet = lf.report(drawn, pictures=False, quantiles=(0.1, 0.9))
    forces = preload.value(drawn.germs[:, 0])
    assert sheet.value("bolt", "F_V", "mean") == pytest.approx(forces.mean(), rel=1e-6)
    assert sheet.value("bolt", "F_V", "std") == pytest.approx(forces.std(ddof=1), rel=1e-6)
    assert sheet.value("bolt", "F_V", "10 %") == pytest.approx(
        np.quantile(forces, 0.1, method="median_unbiased"), rel=1e-6
    )
    opens = np.mean(forces <= limit)
    assert sheet.value("bolt", "m_K", "P(used up)") == pytest.approx(opens, abs=0.01)
    low, high = (sheet.value("bolt", "m_K", f"P(used up), {end}") for end in ("low", "high"))
    assert low < 0.5 < high
    assert drawn.bolts().value("after", "bolt.axial", statistic="mean") == sheet.value("bolt", "F_S", "mean")
    # the same by a chaos: it is linear until the joint opens
    chaos = lf.solve(joint(lf.LogNormal("F", PRELOAD, cov=0.05)), chaos=3, times=TIMES, progress=False)
    other = lf.report(chaos, pictures=False, samples=500)
    assert other.value("bolt", "F_V", "mean") == pytest.approx(PRELOAD, rel=5.0 * 0.05 / np.sqrt(500))
    assert "Probability" in other.sentences[0]
    assert other.value("bolt", "Phi", "std") < 1e-4
    assert other.value("bolt", "Phi", "mean") == pytest.approx(PHI, rel=1e-4)


def test_chance_by_a_chaos_is_checked_by_solves() -> None:
    """A chaos does not follow the joint as it opens; the sentence on top does: exact P in its interval."""
    limit = (1.0 - PHI) * LOAD
    mean, deviation = 1.2 * limit, np.sqrt(np.log(1.01))
    exact = stats.norm.cdf((np.log(limit / mean) + 0.5 * deviation**2) / deviation)
    chaos = lf.solve(joint(lf.LogNormal("F", mean, cov=0.1)), chaos=4, times=TIMES, progress=False)
    sheet = lf.report(chaos, pictures=False, samples=2000, errors=False)
    found = re.search(r"slips: [\d.]+ \[([\d.]+), ([\d.]+)\]", sheet.sentences[0])
    assert found is not None and float(found[1]) < exact < float(found[2])


def test_sweep_and_a_loaded_answer(tmp_path: Path) -> None:
    swept = lf.sweep(joint(), {"load.z": [0.5 * LOAD, LOAD, 1.5 * LOAD]}, times=TIMES, progress=False)
    sheet = lf.report(swept, pictures=False)
    lowest = 1.0 - 1.5 * (1.0 - PHI) * LOAD / PRELOAD
    assert sheet.value("bolt", "m_K", "lowest") == pytest.approx(lowest, rel=1e-5)
    assert sheet.value("bolt", "F_SA", "highest") == pytest.approx(1.5 * PHI * LOAD, rel=1e-5)
    assert "load.z = 30000" in sheet.sentences[0]
    swept.save(tmp_path / "swept.h5")
    again = lf.report(lf.load(tmp_path / "swept.h5"), pictures=False)
    assert again.value("bolt", "m_K", "lowest") == sheet.value("bolt", "m_K", "lowest")
    assert again.value("bolt", "Phi") == sheet.value("bolt", "Phi")


def seat(elements: int) -> lf.Problem:
    """A stiff plate that a pressure presses on another one."""
    scene = lf.Scene()
    for level, part in enumerate(("lower", "upper")):
        box = lf.geometry.box((40.0, 40.0, 10.0), (elements, elements, 1), (-20.0, -20.0, 10.0 * level))
        scene.substructure(part, box, lf.LinearElastic(E=2e8, nu=0.0), degree=1)
    scene.interface("seat <&>", "lower:z1", "upper:z0", lf.Contact(stiffness=100.0))
    scene.fix("lower:z0")
    scene.symmetry(["upper:x0", "upper:y0"])
    scene.pressure("upper:z1", 5.0, name="weight")
    return lf.assemble(scene)


def test_gasket_and_names_that_are_no_html() -> None:
    """A stiff plate presses with p: the pressure is p everywhere; a name with <&> is shown as it is."""
    result = lf.solve(seat(4))
    sheet = lf.report(result, pictures=False, seals={"seat*": 4.0}, units=("мм", "Н"), title="A < B & C")
    name = "seat <&>"
    assert sheet.value(name, "Q_S") == pytest.approx(5.0, rel=1e-4)
    assert sheet.value(name, "F_G") == pytest.approx(5.0 * 1600.0, rel=1e-6)
    assert sheet.value(name, "m_L") == pytest.approx(0.25, rel=1e-3)
    assert "seat &lt;&amp;&gt;" in sheet.html and "<&>" not in sheet.html and "Н/мм²" in sheet.html
    assert "<h1>A &lt; B &amp; C</h1>" in sheet.html
    assert sheet.weakest is None and any("no interface has a preload" in each for each in sheet.left_out)
    leaks = lf.report(result, pictures=False, seals={name: (6.0, 5.5)})
    assert leaks.value(name, "m_L") < 0.0 and "verdict bad" in leaks.html


def test_what_cannot_be_given_is_said() -> None:
    static = lf.solve(joint(history=False, load=0.0))
    sheet = lf.report(static, pictures=False)
    assert sheet.value("bolt", "F_S") == pytest.approx(PRELOAD)
    said = " ".join(sheet.left_out)
    for words in ("no load history", "no friction", "a beam has no section", "gaskets: none was named"):
        assert words in said, said
    assert "No margin can be given" in sheet.sentences[0]
    tightened = lf.solve(joint(), times=[0.5, 1.0])
    assert "no step after the last tightening" in " ".join(lf.report(tightened, pictures=False).left_out)
    unloaded = lf.solve(joint(load=0.0), times=TIMES)
    assert "no axial load" in " ".join(lf.report(unloaded, pictures=False).left_out)
    limited = lf.solve(joint(), times=TIMES, options=lf.Options(max_iterations=1), method="latin")
    assert not limited.converged and "max_iterations" in lf.report(limited, pictures=False).sentences[0]


def test_messages(tmp_path: Path) -> None:
    result = lf.solve(joint(), times=TIMES)
    refused(lambda: lf.report(3), "report", "is no answer")
    refused(lambda: lf.report(result, bolts=["blot"]), "blot", "report, bolts")
    refused(lambda: lf.report(result, joints={"bolt": "joints"}), "joints", "did you mean 'joint'")
    refused(lambda: lf.report(result, joints={"blot": "joint"}), "blot", "did you mean 'bolt'")
    refused(lambda: lf.report(result, seals={"joints": 1.0}), "joints", "did you mean 'joint'")
    refused(lambda: lf.report(result, seals={"joint": -1.0}), "-1", "positive")
    refused(lambda: lf.report(result, seals="joint"), "give seals as")
    refused(lambda: lf.report(result, seals={"bolt.axial": 1.0}), "mean motions")
    refused(lambda: lf.report(result, friction=-0.1), "friction", "-0.1", "a finite number >= 0")
    refused(lambda: lf.report(result, stress_area={"bolt": 0.0}), "stress_area", "positive")
    refused(lambda: lf.report(result, units="mm"), "units", "('mm', 'N')")
    refused(lambda: lf.report(result, units=("N", "mm")), "length comes first", "('mm', 'N')")
    refused(lambda: lf.report(result, quantiles=[2.0]), "quantile")
    refused(lambda: lf.report(result, errors=3), "errors", "True, False")
    refused(lambda: lf.report(result, renderer="vtl"), "renderer", "'vtl'")  # type: ignore[arg-type]
    refused(lambda: lf.report(result, tmp_path / "sheet.pdf"), "sheet.pdf", "a browser prints PDF")
    refused(lambda: lf.report(result, bolts={"bolt.axial": ""}), "name")
    sheet = lf.report(result, pictures=False)
    refused(lambda: sheet.value("bolt", "F_X"), "F_X", "F_V, value")
    refused(lambda: sheet.value("blot", "F_V"), "blot", "bolt")
    (tmp_path / "file").write_text("")
    refused(lambda: sheet.save(tmp_path / "file" / "sheet.html"), "cannot be made", error=FileError)
    assert str(sheet).count("\n") > 3 and repr(sheet).startswith("Report(")


def test_pictures_are_in_the_page() -> None:
    answer = lf.solve(joint(name="_$a_b$<"), times=TIMES)
    sheet = lf.report(answer, renderer="matplotlib", units=("mm", "$N"), seals={"joint": None})
    images = re.findall(r"src='data:image/png;base64,([^']{100,})'", sheet.html)
    assert len(images) == 4  # margins, forces, around the joint, pressure on it; the assembly turns
    assert len(sheet.html) < 1_000_000


def test_errors_of_another_answer() -> None:
    problem = joint(lf.LogNormal("F", PRELOAD, cov=0.05))
    drawn = lf.monte_carlo(problem, 16, times=TIMES, progress=False)
    assert any("error of the meshes" in each for each in lf.report(drawn, pictures=False).left_out)
    known = lf.errors(lf.solve(problem, times=TIMES))
    sheet = lf.report(drawn, pictures=False, errors=known)
    assert not any("error of the meshes" in each for each in sheet.left_out)


def test_chance_of_any_bolt() -> None:
    """Normal preload: P(opens) = P(F < (1 - Phi) F_A), within the interval of the sentence."""
    mean = (1.0 - PHI) * LOAD / (1.0 - 0.1 * stats.norm.isf(0.05))
    drawn = lf.quasi_monte_carlo(joint(lf.Normal("F", mean=mean, cov=0.1)), 512, times=TIMES, progress=False)
    sheet = lf.report(drawn, pictures=False)
    low, high = (sheet.value("bolt", "m_K", f"P(used up), {end}") for end in ("low", "high"))
    assert low < 0.05 < high and "opens or slips" in sheet.sentences[0]


def test_errors_of_bolt_forces_themselves() -> None:
    """Of linear bars nothing is left; where meshes decide, the estimate is that of the quantity."""
    exact = lf.solve(joint(), times=TIMES, options=lf.Options(rtol=1e-10))
    sheet = lf.report(exact, stress_area=84.3, pictures=False, errors="goal")
    table = sheet.table.columns
    of = dict(zip(zip(table["key"], table["statistic"], strict=True), table["error_mesh_of"], strict=True))
    assert of["Phi", "value"] == "energy"
    assert of["F_S", "value"] == "goal"
    at = [k for k, key in enumerate(table["key"]) if key == "F_S"][0]
    assert table["error_mesh"][at] < 1e-6 * sheet.value("bolt", "F_S")
    assert "dual weighted residuals" in sheet.html
    with pytest.raises(lf.SceneError, match="give True, False, 'goal'"):
        lf.report(exact, pictures=False, errors="quantity")


def test_bending_of_a_bolt() -> None:
    """A square stud cut in the middle under a moment M: sigma = M / W, of the round bar of its area."""
    scene = lf.Scene()
    side, moment = 8.0, 2e4
    for level, part in enumerate(("lower", "upper")):
        stud = lf.geometry.box((side, side, 30.0), (2, 2, 3), (0.0, 0.0, 30.0 * level), cell="hexahedron")
        scene.substructure(part, stud, lf.LinearElastic(E=E, nu=0.0), degree=2)
    scene.interface("stud", "lower:z1", "upper:z0", lf.Preload(1e4, until=1.0))
    scene.fix("lower:z0")
    scene.fix("upper:z1", (0.0, 0.0, 0.0), name="end")
    # between two clamped ends a moment in the middle of a half leaves one in the cut
    scene.force("upper:z0", (0.0, 0.0, 0.0), moment=(0.0, moment * ON, 0.0), name="bend")
    result = lf.solve(lf.assemble(scene), times=TIMES, options=lf.Options(rtol=1e-10))
    sheet = lf.report(result, pictures=False, errors=False)
    held = result.readings("stud").interfaces["stud"].values["moment_y"]
    area = side * side
    modulus = np.pi * (4.0 * area / np.pi) ** 1.5 / 32.0
    assert abs(held[-1]) > 0.1 * moment
    change = np.abs(held[TIMES.index(1.0) :] - held[TIMES.index(1.0)]).max()
    assert sheet.value("stud", "sigma_ab") == pytest.approx(0.5 * change / modulus, rel=1e-9)
    beam = lf.report(lf.solve(joint(), times=TIMES), pictures=False, errors=False, stress_area=84.3)
    assert any("σ_ab" in each for each in beam.left_out)


def test_the_assembly_turns_in_the_sheet(tmp_path: Path) -> None:
    """A block that is stretched by 1 % along x: its triangles, and how far they move, are in the page."""
    scene = lf.Scene()
    block = lf.geometry.box((2.0, 1.0, 1.0), (1, 1, 1), cell="hexahedron")
    scene.substructure("bar", block, lf.LinearElastic(1e3, 0.0), degree=1)
    scene.symmetry(["bar:x0", "bar:y0", "bar:z0"])
    scene.traction("bar:x1", (10.0, 0.0, 0.0))
    result = lf.solve(lf.assemble(scene))
    page = view_of(result, "mm")
    packed = dict(re.findall(r"data-(\w)='([^']*)'", page))
    corners, moves = (
        np.frombuffer(base64.b64decode(packed[k]), "<i2").reshape(-1, 3, 3) / 32767.0 for k in "pu"
    )
    colours = np.frombuffer(base64.b64decode(packed["c"]), "u1").reshape(-1, 3)
    assert len(corners) == len(moves) == len(colours) == 6 * 8
    size = np.ptp(corners.reshape(-1, 3), axis=0)
    assert size == pytest.approx(size[0] * np.array([1.0, 0.5, 0.5]), abs=1e-4)
    share = (corners[..., 0] - corners[..., 0].min()) / size[0]  # 0.02 at the end, shown 5 times as large
    assert moves[..., 0] / size[0] == pytest.approx(5.0 * 0.02 * share / 2.0, abs=1e-4)
    assert "× 5<" in page and "|u| from 0 to 0.02 mm" in page and "http" not in page
    sheet = lf.report(result, tmp_path / "sheet.html", errors=False)
    assert sheet.html.count("<canvas") == 1


def test_what_does_not_turn_says_why() -> None:
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((2.0, 1.0), (1, 1)), lf.LinearElastic(1e3, 0.0))
    scene.fix("bar:x0")
    assert view_of(lf.solve(lf.assemble(scene)), "mm") == "only solids turn"


def test_heat_has_no_load_factor() -> None:
    """A sleeve that grows between plates stretches its bolt: both gain as much, and nothing pulls."""
    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        block = lf.geometry.box((20.0, 20.0, 10.0), (1, 1, 1), (0.0, 0.0, 10.0 * level), cell="hexahedron")
        scene.substructure(name, block, lf.LinearElastic(200e3, 0.0, alpha=12e-6), degree=1)
    scene.interface("joint", "base:z1", "cover:z0", lf.Contact(friction=0.2))
    stiffness = lf.BoltStiffness(axial=4e5, bending=1e6, torsion=1e6)
    cold = lf.Preload(2e4, until=1.0, shortening=0.0)
    scene.beam("bolt", "base:z0", "cover:z1", stiffness, cold)
    scene.fix("base:z0", components=2)
    scene.symmetry(["base:x0", "base:y0", "cover:x0", "cover:y0"])
    for part in ("base", "cover"):
        scene.temperature(part, lf.Amplitude([1, 2], [0, 1]) * 100.0)
    scene.force("cover:z1", (0.0, 0.0, 400.0 * lf.Amplitude([1, 2], [0, 1])), name="little")
    result = lf.solve(lf.assemble(scene), times=[1.0, 2.0])
    sheet = lf.report(result, pictures=False, errors=False)
    assert result.bolts().value("change", "bolt.axial") > 4e3  # 4e5 x 0.024 is 9.6e3 of a stiff sleeve
    assert any("by heat or bending" in text for text in sheet.left_out)
    refused(lambda: sheet.value("bolt", "Phi"), "Phi")


def test_a_joint_of_two_bolts_has_a_probability_of_its_own() -> None:
    """A load at the edge: friction is used up around one bolt before it is around the other."""
    later = lf.Amplitude([1, 2], [0, 1])
    scene = lf.Scene()
    for k, name in enumerate(("low", "top")):
        plate = lf.geometry.box((40.0, 10.0), (8, 2), origin=(0.0, 10.0 * k))
        for n, x in enumerate((5.0, 35.0)):
            plate = plate.with_face(f"bolt {n}", lambda p, x=x: np.abs(p[0] - x) < 5.1, of=f"y{k}")
        scene.substructure(name, plate, lf.LinearElastic(E=2e3, nu=0.0), degree=1)
    scene.interface("joint", "low:y1", "top:y0", lf.Contact(friction=lf.Uniform("mu", 0.1, 0.3)))
    for k in range(2):
        soft = lf.BoltStiffness(axial=1e3, bending=1.0, torsion=1.0)
        scene.beam(f"bolt {k}", f"low:bolt {k}", f"top:bolt {k}", soft, lf.Preload(500.0, until=1.0))
    scene.fix("low:y0")
    scene.traction("top:x1", later * (10.0, 0.0))
    answer = lf.quasi_monte_carlo(lf.assemble(scene), 16, times=[1.0, 2.0], progress=False)
    said = " ".join(lf.report(answer, errors=False, pictures=False).sentences)
    assert "opens or slips around it" in said and "all of “joint” is open or at its limit of friction" in said
    safety = answer.quantity("joint.slip_safety").values
    shown = re.search(r"its friction is ([\d.]+) times .* \(median, ([\d.]+) at 5 %\)", said)
    assert shown is not None and float(shown[1]) == pytest.approx(np.median(safety), rel=1e-3)
    assert float(shown[2]) == pytest.approx(np.quantile(safety, 0.05), rel=1e-3)


def test_samples_that_slide_are_answers() -> None:
    """A block of friction 0.3 to 0.5 on its bed, drawn by 0.4 of what presses it."""
    later = lf.Amplitude([1, 2], [0, 1])
    scene = lf.Scene()
    for k, name in enumerate(("bed", "block")):
        part = lf.geometry.box((10.0, 10.0), (2, 2), origin=(0.0, 10.0 * k))
        scene.substructure(name, part, lf.LinearElastic(E=2e3, nu=0.0), degree=1)
    scene.interface("joint", "bed:y1", "block:y0", lf.Contact(friction=lf.Uniform("mu", 0.3, 0.5)))
    scene.fix("bed:y0")
    scene.traction("block:y1", (0.0, -10.0), name="press")
    scene.traction("block:y1", later * (4.0, 0.0), name="draw")
    germs = np.array([[-0.5], [0.5], [0.8]])
    answer = lf.sample(lf.assemble(scene), germs, times=[1.0, 2.0], progress=False)
    assert answer.status in ("slides", "no_equilibrium")
    sheet = lf.report(answer, errors=False, pictures=False)
    assert sheet.sentences[0].startswith("In 1 of 3 samples nothing balances the loads")
    assert not any("converged answer" in each for each in sheet.sentences)
