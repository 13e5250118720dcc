"""Assemblies as engineers build them, with sizes and names of their own: each kind once was misread."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.geometry.step import StepAssembly
from dolfinx_frontend.geometry.threads import INCHES
from tests.geometry.assemblies import cut, cylinder, fuse, hexagon

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demos"))

from parts.step_file import write_step  # noqa: E402

Solids = dict[str, int]


@pytest.fixture
def read(tmp_path: Path) -> Callable[[Callable[[Any], Solids]], StepAssembly]:
    return lambda build: lf.read_step(write_step(tmp_path / "built.step", build))


def laws(step: StepAssembly) -> dict[str, str]:
    made = step.proposal(scatter=False)
    return {n: type(j.law).__name__ if j else "free" for n, j in made._joins.items()}


def cover(occ: Any) -> Solids:
    """Countersunk M6 in a cover with a paper seal; tapped holes as they are drilled."""
    at = (-30.0, 30.0)

    def cone(x: float) -> tuple[int, int]:
        return 3, occ.addCone(x, 0, 10.5, 0, 0, -3.4, 6.4, 3.0)

    def box(low: float, high: float) -> tuple[int, int]:
        return 3, occ.addBox(-50, -25, low, 100, 50, high - low)

    house = cut(occ, box(-25, 0), [cylinder(occ, x, 0, -12, 1, 5) for x in at])
    seal = cut(occ, box(0, 0.5), [cylinder(occ, x, 0, -1, 2, 6.6) for x in at])
    lid = cut(occ, box(0.5, 10.5), [cylinder(occ, x, 0, 0, 11, 6.6) for x in at] + [cone(x) for x in at])
    out = {"Gehaeuse": house[1], "Papierdichtung": seal[1], "Deckel": lid[1]}
    for k, x in enumerate(at):
        screw = fuse(occ, [cone(x), cylinder(occ, x, 0, -8, 7.1, 6)])
        out[f"Senkschraube {k}"] = cut(occ, screw, [hexagon(occ, x, 0, 8.5, 10.6, 4, 0.1)])[1]
    return out


def test_countersunk_screws_clamp_a_thin_seal(read: Any) -> None:
    step = read(cover)
    assert [f.title for f in step.found.values()] == ["", "gasket", "", "bolt M6", "bolt M6"]
    kinds = {t.kind for n, t in step.touches.items() if "Gehaeuse|Senk" in n}
    assert not step.misfits and kinds == {"thread"}
    found = laws(step)
    assert found["Gehaeuse|Papierdichtung"] == found["Papierdichtung|Deckel"] == "Contact"
    assert found["Gehaeuse|Senkschraube 0+"] == "Perfect" and found["Deckel|Senkschraube 0-"] == "Contact"
    # a mesh as fine as the paper is thin has millions of unknowns, on both sides of it
    made = step.proposal()
    assert made._size("Papierdichtung") == pytest.approx(6 * step.solids["Papierdichtung"].thickness)


def buttons(occ: Any) -> Solids:
    """Button heads of ISO 7380: a part of a sphere."""
    block = cut(occ, (3, occ.addBox(-15, -15, -25, 30, 30, 25)), [cylinder(occ, 0, 0, -18, 1, 6.8)])
    lid = cut(occ, (3, occ.addBox(-15, -15, 0, 30, 30, 4)), [cylinder(occ, 0, 0, -1, 5, 9)])
    ball = (3, occ.addSphere(0, 0, 0.2, 8.2))
    cap = occ.intersect([ball], [cylinder(occ, 0, 0, 4, 8.4, 14)])[0][0]
    screw = cut(occ, fuse(occ, [cap, cylinder(occ, 0, 0, -12, 4, 8)]), [hexagon(occ, 0, 0, 5.8, 9, 5, 0.1)])
    return {"bloque": block[1], "tapa": lid[1], "pieza": screw[1]}


def test_button_heads(read: Any) -> None:
    step = read(buttons)
    assert step.found["pieza"].title == "bolt M8" and not step.misfits
    assert laws(step)["tapa|pieza-"] == "Contact"


def inches(occ: Any) -> Solids:
    """3/8-16 UNC with a washer and a nut of ASME B18, drilled for the tap."""
    inch, out = 25.4, {}
    for name, low in (("PLATE-A", 0.0), ("PLATE-B", 0.5)):
        box = (3, occ.addBox(0, 0, low * inch, 2 * inch, 2 * inch, 0.5 * inch))
        hole = cylinder(occ, inch, inch, low * inch - 1, (low + 0.6) * inch, 0.4063 * inch)
        out[name] = cut(occ, box, [hole])[1]
    washer = cylinder(occ, inch, inch, inch, 1.065 * inch, 0.812 * inch)
    out["FW-375"] = cut(occ, washer, [cylinder(occ, inch, inch, 20, 30, 0.406 * inch)])[1]
    head = hexagon(occ, inch, inch, 1.065 * inch, 1.308 * inch, 0.5625 * inch, 0.3)
    shank = cylinder(occ, inch, inch, -0.4 * inch, 1.065 * inch, 0.375 * inch)
    out["HHCS-375-16"] = fuse(occ, [head, shank])[1]
    nut = hexagon(occ, inch, inch, -0.328 * inch, 0.0, 0.5625 * inch, 0.1)
    out["HN-375-16"] = cut(occ, nut, [cylinder(occ, inch, inch, -20, 5, 0.3125 * inch)])[1]
    return out


def test_threads_of_inches(read: Any) -> None:
    step = read(inches)
    titles = ["", "", "washer 3/8-16 UNC", "bolt 3/8-16 UNC", "nut 3/8-16 UNC"]
    assert [f.title for f in step.found.values()] == titles and not step.misfits
    thread = step.touches["HHCS-375-16|HN-375-16"]
    assert thread.kind == "thread" and math.isclose(thread.gap, -0.5 * (0.375 - 0.3125) * 25.4)
    step.is_bolt("HHCS-375-16", "3/8-24 UNF")
    assert "3/8-24 UNF, class 8.8" in step.proposal().why["join", "HHCS-375-16-|HHCS-375-16+"]


def test_stress_areas_of_inches() -> None:
    """ASME B1.1, square inches."""
    areas = {"1/4-20 UNC": 0.0318, "3/8-24 UNF": 0.0878, "1/2-13 UNC": 0.1419, "1-8 UNC": 0.606,
             "1-1/2-12 UNF": 1.581}
    for name, area in areas.items():
        own = 0.25 * math.pi * (INCHES[name].stressed_diameter / 25.4) ** 2
        assert math.isclose(own, area, abs_tol=6e-4 * max(1.0, area / 0.6))


def pad(occ: Any) -> Solids:
    """A rail on rubber, M16 with a square washer, slots."""
    ground = cut(occ, (3, occ.addBox(-40, -40, -20, 80, 80, 20)), [cylinder(occ, 0, 0, -21, 1, 17.5)])
    rubber = cut(occ, (3, occ.addBox(-40, -40, 0, 80, 80, 3)), [cylinder(occ, 0, 0, -1, 8, 18)])
    tools = [cylinder(occ, s * 6, 0, 2, 19, 17.5) for s in (-1, 1)]
    tools.append((3, occ.addBox(-6, -8.75, 2, 12, 17.5, 17)))
    rail = cut(occ, (3, occ.addBox(-40, -30, 3, 80, 60, 15)), tools)
    square = cut(occ, (3, occ.addBox(-20, -20, 18, 40, 40, 6)), [cylinder(occ, 0, 0, 17, 25, 17.5)])
    bolt = fuse(occ, [hexagon(occ, 0, 0, 24, 34, 24, 0.1), cylinder(occ, 0, 0, -40, 24, 16)])
    nut = cut(occ, hexagon(occ, 0, 0, -34.8, -20, 24, 0.4), [cylinder(occ, 0, 0, -50, 0, 13.8)])
    parts = {"Grundplatte": ground, "Gummiplatte": rubber, "Schiene": rail, "Scheibe DIN 436": square}
    return {name: tag for name, (_, tag) in {**parts, "Schraube": bolt, "Mutter": nut}.items()}


def test_rubber_under_a_slotted_rail(read: Any) -> None:
    step = read(pad)
    assert [f.title for f in step.found.values()] == ["", "gasket", "", "", "bolt M16", "nut M16"]
    assert not step.misfits
    found = laws(step)
    assert found["Scheibe DIN 436|Schraube-"] == found["Schiene|Scheibe DIN 436"] == "Contact"


def tee(occ: Any) -> Solids:
    """A plate on a slotted profile with a screw in a tee nut, which is a block."""
    profile = cut(occ, (3, occ.addBox(-30, -20, -40, 60, 40, 40)), [(3, occ.addBox(-31, -5, -6, 62, 10, 7))])
    profile = cut(occ, profile, [(3, occ.addBox(-31, -10, -12, 62, 20, 6))])
    plate = cut(occ, (3, occ.addBox(-25, -20, 0, 50, 40, 8)), [cylinder(occ, 0, 0, -1, 9, 9)])
    block = cut(occ, (3, occ.addBox(-8, -9, -12, 16, 18, 6)), [cylinder(occ, 0, 0, -20, 5, 6.8)])
    screw = fuse(occ, [cylinder(occ, 0, 0, 8, 16, 13), cylinder(occ, 0, 0, -11, 8, 8)])
    screw = cut(occ, screw, [hexagon(occ, 0, 0, 12, 17, 6, 0)])
    return {"Profil": profile[1], "Platte": plate[1], "Nutenstein": block[1], "Zylinderschraube M8": screw[1]}


def test_a_screw_in_a_block(read: Any) -> None:
    step = read(tee)
    assert step.found["Zylinderschraube M8"].title == "bolt M8"
    assert "is held by 'Nutenstein'" in str(step)
    assert [m for m in step.misfits if "no fastener holds 'Profil'" in m] == step.misfits


def clevis(occ: Any) -> Solids:
    """A fork and an eye on a pin with a head."""
    def along(low: float, high: float, d: float) -> tuple[int, int]:
        return 3, occ.addCylinder(-15, low, 0, 0, high - low, 0, 0.5 * d)

    fork = cut(occ, (3, occ.addBox(-30, -25, -15, 60, 50, 30)), [(3, occ.addBox(-31, -10, -16, 50, 20, 32))])
    fork = cut(occ, fork, [along(-40, 40, 12)])
    eye = cut(occ, (3, occ.addBox(-60, -9.8, -12, 60, 19.6, 24)), [along(-40, 40, 12)])
    pin = fuse(occ, [along(-30, 30, 12), along(-33, -30, 16)])
    return {"Gabel": fork[1], "Auge": eye[1], "Bolzen": pin[1]}


def test_a_clevis_pin_may_be_called_a_dowel(read: Any) -> None:
    step = read(clevis)
    (said,) = step.misfits
    assert "looks like a bolt but its head has no hexagon" in said
    assert "step.is_a('Bolzen', \"dowel\")" in said
    step.is_a("Bolzen", "dowel")
    assert "Contact" in laws(step).values() and "Perfect" in laws(step).values()


def test_what_is_said_to_be_a_bolt_keeps_its_thread(read: Any) -> None:
    step = read(buttons)
    step.is_bolt("pieza", "M8")
    assert laws(step)["bloque|pieza+"] == "Perfect" and not step.misfits
