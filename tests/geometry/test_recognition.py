"""What parts are taken for: by shape, wherever and however large they are; names, overruling, tables."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_frontend import read_step
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.naming import named_kind, named_size
from dolfinx_frontend.geometry.shapes import _revolved
from dolfinx_frontend.geometry.solids import Cut, Surface
from dolfinx_frontend.geometry.step import StepAssembly
from dolfinx_frontend.geometry.threads import HEAD, JOINT, SIZES, nearest_size, preload
from tests.geometry.assemblies import hexagon, made, write
from tests.geometry.judging import judged

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from make_bracket_step import make_bracket  # noqa: E402
from make_flange_step import make_flange  # noqa: E402
from parts.step_file import write_step  # noqa: E402


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_bracket(tmp_path_factory.mktemp("step") / "bracket.step")


def pin(occ: Any, low: float, high: float, d: float, x: float = 0.0) -> tuple[int, int]:
    return 3, occ.addCylinder(x, 0, low, 0, 0, high - low, 0.5 * d)


def cut(occ: Any, body: tuple[int, int], *tools: tuple[int, int]) -> int:
    return int(occ.cut([body], list(tools))[0][0][1])


def block(occ: Any, low: float, high: float) -> tuple[int, int]:
    return 3, occ.addBox(-30, -30, low, 60, 60, high - low)


# -- sizes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("d", "pitch", "friction", "grade", "kN"),
    [  # VDI 2230 table A3, fine threads, as printed in catalogues
        (8, 1.0, 0.10, "8.8", 20.7), (8, 1.0, 0.12, "10.9", 29.7), (12, 1.25, 0.14, "12.9", 80.4),
        (16, 1.5, 0.12, "8.8", 87.6), (20, 1.5, 0.10, "8.8", 151.0), (24, 2.0, 0.14, "10.9", 290.0),
    ],
)
def test_preload_of_the_tables(d: float, pitch: float, friction: float, grade: str, kN: float) -> None:
    size = replace_pitch(d, pitch)
    assert math.isclose(preload(size, grade, "torque", friction).high, 1e3 * kN, rel_tol=4e-3)


def replace_pitch(d: float, pitch: float) -> Any:
    return SIZES[f"M{d:g}"]._replace(pitch=pitch)


def test_scatter_is_that_of_the_tables() -> None:
    span = preload(SIZES["M12"], "8.8", "torque, tested")
    assert math.isclose(span.high / span.low, 1.6) and math.isclose(2.0 * span.cov, 0.6 / 2.6)
    assert math.isclose(HEAD.mean, 0.12) and math.isclose(JOINT.mean + 2 * JOINT.cov * JOINT.mean, 0.23)
    with pytest.raises(SceneError, match="unknown property class '8.9'.*did you mean '8.8'"):
        preload(SIZES["M12"], "8.9")
    with pytest.raises(SceneError, match="way of tightening 'torq'.*'torque'"):
        preload(SIZES["M12"], "8.8", "torq")


def test_nearest_sizes() -> None:
    for size in SIZES.values():
        assert nearest_size(size.d) == size == nearest_size(size.pitch_diameter, size.across)
        stress = 0.25 * math.pi * size.stressed_diameter**2
        assert stress < 0.25 * math.pi * size.d**2
    # ISO 898-1: stress areas, mm^2
    for name, area in {"M8": 36.6, "M12": 84.3, "M20": 245.0, "M36": 817.0}.items():
        assert math.isclose(0.25 * math.pi * SIZES[name].stressed_diameter**2, area, rel_tol=2e-3)
    assert nearest_size(1.0) is None and nearest_size(200.0) is None


@pytest.mark.parametrize(
    ("name", "kind", "size"),
    [
        ("Sechskantschraube_ISO4014-M12x40", "bolt", "M12"), ("DIN 912 M8 x 30", "bolt", "M8"),
        ("Vis_CHC_M6", "bolt", "M6"), ("tornillo 3", "bolt", None), ("Ecrou H M10", "nut", "M10"),
        ("\u00c9crou-H", "nut", None), ("hexNut", "nut", None), ("Unterlegscheiben", "washer",
                                                                 None), ("rondelle 12", "washer", None),
        ("Flachdichtung", "gasket", None), ("joint torique", "gasket", None), ("Stiftschraube M16", "stud",
                                                                               "M16"),
        ("dowel pin 6", "dowel", None), ("television stand", "", None), ("minute hand", "", None),
        ("M12_plate", "", "M12"), ("motor 2", "", None), ("arm120", "", None), ("part", "", None),
    ],
)
def test_names(name: str, kind: str, size: str | None) -> None:
    found = named_size(name)
    assert named_kind(name) == kind
    assert (found.name if found else None) == size


# -- shapes ----------------------------------------------------------------------------------------


def test_the_demos(bracket: Path, tmp_path: Path) -> None:
    step = read_step(bracket)
    assert {n: f.title for n, f in step.found.items()} == {
        "bracket": "", "base": "", "bolt 1": "bolt M8", "bolt 2": "bolt M8"
    }
    assert "held by 'base'" in str(step) and "bolt M8" in str(step)
    flange = read_step(make_flange(tmp_path / "flange.step"))
    kinds = {n.rstrip(" 12345678"): f.title for n, f in flange.found.items()}
    # the studs are drawn at the pitch diameter of M20: their nuts tell
    assert kinds == {
        "lower flange": "", "upper flange": "", "gasket": "gasket", "stud": "stud M20",
        "lower nut": "nut M20",
        "upper nut": "nut M20",
    }


@pytest.mark.parametrize(("seed", "off"), [(1, False), (12, True), (16, False), (102, True), (104, False)])
def test_assemblies(tmp_path: Path, seed: int, off: bool) -> None:
    """With names and without: units, rotations, mirrors, orders."""
    assembly = made(seed, off)
    for verdict in judged(assembly, write(assembly, tmp_path / "made.step")).values():
        assert not verdict.wrong


def test_neither_size_nor_place_nor_order_matters(tmp_path: Path) -> None:
    assembly = made(8)
    titles = []
    for unit, turn in (("mm", (0.0, (0.0, 0.0, 1.0), False)), ("m", (1.1, (0.6, 0.0, 0.8), True)),
                       ("inch", (2.0, (0.0, 1.0, 0.0), False))):
        assembly.unit, assembly.turn = unit, turn
        assembly.parts = assembly.parts[3:] + assembly.parts[:3]
        found = read_step(write(assembly, tmp_path / "turned.step")).found
        titles.append({name: f.title for name, f in found.items()})
    assert titles[0] == titles[1] == titles[2]


def made_step(path: Path, build: Callable[[Any], dict[str, int]]) -> StepAssembly:
    return read_step(write_step(path, build))


def flanged_pin(occ: Any, name: str) -> dict[str, int]:
    """A pin with a flange in a plate: a bolt but for what holds it."""
    plate = cut(occ, block(occ, 0, 10), pin(occ, -1, 11, 9))
    whole = occ.fuse([pin(occ, -6, 10, 8)], [pin(occ, 10, 16, 13)])[0][0][1]
    return {"plate": plate, name: int(whole)}


def test_what_looks_like_a_bolt_but_for_one_thing(tmp_path: Path) -> None:
    step = made_step(tmp_path / "pin.step", lambda occ: flanged_pin(occ, "pivot"))
    found = step.found["pivot"]
    assert not found.kind and "no nut or thread holds its shank" in found.missing
    step = made_step(tmp_path / "pin2.step", lambda occ: flanged_pin(occ, "screw 7"))
    assert step.found["screw 7"].title == "bolt M8" and "named so" in step.found["screw 7"].reasons[-1]


def test_a_name_makes_no_bolt_of_a_plate(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        names = ("bolt M12", "nut DIN 934", "ISO 7089 washer", "gasket")
        return {name: block(occ, 12 * k, 12 * k + 12)[1] for k, name in enumerate(names)}

    found = made_step(tmp_path / "plates.step", build).found
    assert not any(f.kind for f in found.values())


def joint(occ: Any, mirrored: bool) -> dict[str, int]:
    """A hexagon bolt with a chamfered head through two plates, a nut, a countersunk hole; perhaps splines."""
    tools = [pin(occ, -1, 41, 11), (3, occ.addCone(0, 0, 0, 0, 0, 3, 8.5, 5.5))]
    solids = {"a": cut(occ, block(occ, 0, 20), *tools)}
    solids["b"] = cut(occ, block(occ, 20, 40), pin(occ, 19, 41, 11))
    limit = (3, occ.addCone(0, 0, 40, 0, 0, 6.4, 7.6 + 1.732 * 6.4, 7.6))
    head = occ.intersect([hexagon(occ, 0, 0, 40, 46.4, 16.0, 0.2)], [limit])[0]
    solids["c"] = occ.fuse(head, [pin(occ, -12, 40, 10)])[0][0][1]
    solids["d"] = cut(occ, hexagon(occ, 0, 0, -8.4, 0, 16.0, 0.5), pin(occ, -20, 1, 10))
    if mirrored:
        across = [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
        occ.affineTransform([(3, tag) for tag in solids.values()], across)
    return solids


def test_splines_are_the_planes_cylinders_and_cones_that_they_draw(tmp_path: Path) -> None:
    """An affine map makes splines of all faces; files of some programs have nothing else."""
    plain, mirrored = (
        made_step(tmp_path / f"{way}.step", lambda occ, way=way: joint(occ, way)) for way in (False, True)
    )
    assert "B_SPLINE_SURFACE" in (tmp_path / "True.step").read_text(encoding="latin-1")
    assert [f.title for f in mirrored.found.values()] == ["", "", "bolt M10", "nut M10"]
    assert plain.found["c"].reasons == mirrored.found["c"].reasons
    for name, solid in plain.solids.items():
        shapes = [
            sorted((s.kind, s.hollow, round(s.radius or 0.0, 5)) for s in each.surfaces)
            for each in (solid, mirrored.solids[name])
        ]
        assert shapes[0] == shapes[1]


def test_a_chamfer_makes_no_interface(tmp_path: Path) -> None:
    """It meets the face beside in an edge: within any gap there is a strip, however narrow."""
    step = made_step(tmp_path / "joint.step", lambda occ: joint(occ, False))
    assert set(step.touches) == {"a|b", "a|d", "b|c", "c|d"}
    cone = next(s for s in step.solids["a"].surfaces if s.kind == "cone")
    assert cone.hollow and math.isclose(abs(cone.axis[2]), 1.0)
    assert np.allclose(cone.origin, [0.0, 0.0, 8.5])


def test_flanks_of_a_thread_are_around_its_axis() -> None:
    """Normals of a helicoid with flanks of 30 degrees pass the axis by the lead over a turn."""
    turns, r = (a.ravel() for a in np.meshgrid(np.linspace(0, 6, 9), np.linspace(2.4, 3.0, 4)))
    x, y, slope = np.cos(turns), np.sin(turns), 1.0 / math.sqrt(3.0)
    points = np.stack([r * x, r * y, turns / (2 * math.pi) - r * slope], axis=1)
    out = np.stack([x, y, 0.0 * r - slope], axis=1)
    along = np.stack([-r * y, r * x, 0.0 * r + 0.5 / math.pi], axis=1)
    normals = np.cross(out, along)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    z = np.array([0.0, 0.0, 1.0])
    face = Surface("a", 1, "bspline surface", 1.0, z, z, z, z, z, points=points, normals=normals)
    assert _revolved(face, np.zeros(3), z, 1e-3) == "round"
    assert _revolved(face, np.array([1.0, 0.0, 0.0]), z, 1e-3) == ""


def test_a_slotted_screw_and_a_collar_that_is_no_washer(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        house = cut(occ, block(occ, 0, 20), pin(occ, -1, 21, 20), pin(occ, 5, 20, 8, 22))
        lid = cut(occ, block(occ, 20, 26), pin(occ, 19, 27, 20), pin(occ, 19, 27, 9, 22))
        screw = occ.fuse([pin(occ, 26, 31, 13, 22)], [pin(occ, 8, 26, 8, 22)])[0][0]
        screw = cut(occ, screw, (3, occ.addBox(10, -1, 28.5, 30, 2, 5)))
        collar = cut(occ, pin(occ, 40, 46, 32), pin(occ, 39, 47, 20))
        return {"a": house, "b": lid, "c": screw, "shaft": pin(occ, -40, 60, 20)[1], "e": collar}

    found = made_step(tmp_path / "shaft.step", build).found
    assert [f.title for f in found.values()] == ["", "", "bolt M8", "", ""]
    assert "recess head" in found["c"].reasons[0] + found["c"].reasons[1]


def test_a_square_nut_is_one_by_its_name(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        nut = cut(occ, (3, occ.addBox(-8, -8, -6, 16, 16, 6)), pin(occ, -7, 1, 10))
        house = cut(occ, block(occ, -30, -6), pin(occ, -31, -5, 10))
        plate = cut(occ, block(occ, 0, 20), pin(occ, -1, 21, 11))
        return {"Vierkantmutter": nut, "nut housing": house, "plate": plate,
                "bolt": occ.fuse([pin(occ, -20, 20, 10)], [pin(occ, 20, 26, 16)])[0][0][1]}

    found = made_step(tmp_path / "square.step", build).found
    assert [f.title for f in found.values()] == ["nut M10", "", "", "bolt M10"]


def test_dowels_gaskets_and_sheets(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        lower = cut(occ, block(occ, 0, 20), pin(occ, 5, 20, 6), pin(occ, 5, 20, 6, 15))
        middle = cut(occ, block(occ, 20, 40), pin(occ, 20, 35, 6), pin(occ, 20, 35, 6, 15))
        seal = cut(occ, block(occ, 40, 41.5), pin(occ, 39, 43, 30))
        upper = block(occ, 41.5, 60)[1]
        return {
            "a": lower, "b": middle, "c": seal, "d": upper, "e": pin(occ, 6, 34, 6)[1], "f": pin(occ, 6, 34,
                                                                                                 6, 15)[1],
            "g": block(occ, 60, 61)[1],
        }

    step = made_step(tmp_path / "flat.step", build)
    found = step.found
    assert found["c"].between == ("b", "d") and not found["g"].between
    step.rename({"b": "house", "c": "seal"})
    assert set(step.found["seal"].between) == {"house", "d"}
    assert {n: f.kind for n, f in found.items()} == {
        "a": "", "b": "", "c": "sheet", "d": "", "e": "dowel", "f": "dowel", "g": "sheet"
    }


# -- overruled -------------------------------------------------------------------------------------


def test_overruled(bracket: Path) -> None:
    step = read_step(bracket)
    step.is_bolt("bolt 1", "M10")
    step.is_not("bolt 2")
    assert step.found["bolt 1"].title == "bolt M10" and step.found["bolt 1"].reasons == ("said so",)
    assert not step.found["bolt 2"].kind
    assert "M10" in str(step)
    with pytest.raises(SceneError, match="is_bolt: unknown part 'bolt 3'; did you mean 'bolt"):
        step.is_bolt("bolt 3", "M8")
    with pytest.raises(SceneError, match="is_bolt 'bolt 1': unknown size 'M13'; did you mean 'M"):
        step.is_bolt("bolt 1", "M13")
    with pytest.raises(SceneError, match="'base' cannot be a bolt: it has no round shank"):
        step.is_bolt("base", "M8")
    with pytest.raises(SceneError, match="unknown kind of part 'gaskt'; did you mean 'gasket'"):
        step.is_a("base", "gaskt")
    with pytest.raises(SceneError, match="is_not: unknown part 'bracke'"):
        step.is_not("bracke")


def test_halves_are_one_bolt(bracket: Path) -> None:
    step = read_step(bracket, cuts=Cut("bolt *", normal=(0, 0, 1), through=(0, 0, 4)))
    assert {n: f.title for n, f in step.found.items() if f.kind} == {"bolt 1": "bolt M8", "bolt 2": "bolt M8"}


# -- what does not fit -----------------------------------------------------------------------------


def test_what_does_not_fit_is_said(tmp_path: Path) -> None:
    """A hole that is too narrow, a bolt that is too short, one without a nut, a part that nothing holds."""

    def build(occ: Any) -> dict[str, int]:
        holes = pin(occ, 0, 20, 8.2), pin(occ, 14, 20, 8, 20), pin(occ, -1, 20, 9, -20)
        low = cut(occ, block(occ, 0, 20), *holes)
        wide = [pin(occ, 19, 31, d, x) for d, x in ((8.2, 0), (9, 20), (9, -20))]
        high = cut(occ, block(occ, 20, 30), *wide)
        bolts = [
            int(occ.fuse([pin(occ, tip, 30, 8, x)], [pin(occ, 30, 36, 13, x)])[0][0][1])
            for tip, x in ((-10.0, 0.0), (18.0, 20.0), (-10.0, -20.0))
        ]
        nut = cut(occ, pin(occ, -6.8, 0, 13), pin(occ, -7, 1, 8))
        lid = (3, occ.addBox(-30, -30, -20.2, 20, 20, 5))[1]
        foot = (3, occ.addBox(10, 10, 30, 15, 15, 5))[1]
        names = ("lower", "upper", "bolt a", "bolt b", "bolt c", "nut", "lid", "foot")
        return dict(zip(names, (low, high, *bolts, nut, lid, foot), strict=True))

    step = made_step(tmp_path / "misfits.step", build)
    said = "\n".join(step.misfits)
    assert "the hole of 'lower' for 'bolt a' has 8.2 mm: ISO 273 has 8.4 mm (fine) to 10 mm for M8" in said
    assert "'bolt b' is 2 mm in the thread of 'lower', 0.25 diameters: it is too short" in said
    assert "'bolt c' has neither nut nor thread at its end" in said
    assert "no fastener holds 'foot', which lies on 'upper'" in said
    assert "does not fit: the hole of" in str(step)


def test_gaps_are_said(tmp_path: Path) -> None:
    def build(occ: Any) -> dict[str, int]:
        return {
            "base": block(occ, 0, 10)[1], "cover": block(occ, 10.2, 20)[1], "top": block(occ, 20, 25)[1],
            "away": block(occ, 25.7, 30)[1],
        }

    step = made_step(tmp_path / "gap.step", build)
    (said,) = (text for text in step.misfits if "apart" in text)
    assert "'base' and 'cover' face each other over 3600 mm^2, 0.2 mm apart" in said and "gap=0.24" in said
    joined = read_step(tmp_path / "gap.step", gap=0.24)
    assert joined.touches["base|cover"].kind == "near" and not any("apart" in text for text in joined.misfits)
