"""Abaqus decks against closed forms; the decks are written here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dolfinx_frontend as lf
from tests.decks.decks import STEEL, Brick

TWIST = np.array([[1.0, 0.1, 0.05], [0.0, 0.9, 0.1], [0.05, 0.0, 1.1]])
GRADIENT = np.array([[1e-3, 2e-4, -3e-4], [4e-4, -5e-4, 1e-4], [2e-4, 3e-4, 7e-4]])
KINDS = ["C3D4", "C3D8", "C3D8R", "C3D8I", "C3D10", "C3D20", "C3D20R"]
PLANE = ["CPS3", "CPS4", "CPS4R", "CPS6", "CPS8", "CPE4", "CPE8R"]


def deck_of(tmp_path: Path, text: str) -> lf.InpDeck:
    file = tmp_path / "deck.inp"
    file.write_text(text)
    return lf.read_inp(file)


def solved(deck: lf.InpDeck, **options: object) -> lf.Result:
    result = lf.solve(lf.assemble(deck.scene()), times=deck.times, progress=False, **options)
    assert result.status == "converged"
    return result


def at(result: lf.Result, part: str, point: object, of: str, component: str, step: int = -1) -> float:
    probe = lf.AtPoint(result.problem, part, point, of, component, step)
    return float(np.ravel(result.quantity(probe).values)[0])


def stress_of(gradient: np.ndarray, E: float = 200e3, nu: float = 0.3, plane: str = "") -> np.ndarray:
    strain = 0.5 * (gradient + gradient.T)
    mu2, lmbda = E / (1 + nu), E * nu / ((1 + nu) * (1 - 2 * nu))
    if plane == "stress":
        lmbda = E * nu / (1 - nu**2)
    return lmbda * np.trace(strain) * np.eye(len(strain)) + mu2 * strain


def moved(brick: Brick, gradient: np.ndarray, sides: set[int]) -> str:
    """Supports that give some nodes a linear displacement."""
    lines = ["*BOUNDARY"]
    for node in sorted(sides):
        u = gradient @ brick.x[node][: len(gradient)]
        lines += [f"{node}, {k + 1}, {k + 1}, {value:.17g}" for k, value in enumerate(u)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", KINDS + PLANE)
def test_patch(kind: str, tmp_path: Path) -> None:
    flat = kind not in KINDS
    d = 2 if flat else 3
    brick = Brick(kind, "BODY", (2.0, 1.0, 1.5)[:d], (2, 2, 2)[:d], (0.5, 0, 0), 7,
                  mapping=lambda x: np.append(TWIST[:d, :d] @ x[:d], [0.0] * (3 - d)))
    sides = {n for axis in range(d) for high in (False, True) for n in brick.nodes_at(axis, high)}
    gradient = GRADIENT[:d, :d]
    text = f"{brick.text()}{STEEL}*STEP\n*STATIC\n{moved(brick, gradient, sides)}*END STEP\n"
    deck = deck_of(tmp_path, text)
    result = solved(deck)
    plane = "stress" if kind.startswith("CPS") else ""
    exact = stress_of(gradient, plane=plane)
    middle = np.mean(list(brick.x.values()), axis=0)[:d] + 0.01
    for i, word in ((0, "xx"), (1, "yy")):
        found = at(result, "BODY", middle, "stress", word)
        assert found == pytest.approx(exact[i, i], rel=1e-8)


@pytest.mark.parametrize("kind", ["C3D20", "C3D20R", "C3D8I"])
def test_cantilever(kind: str, tmp_path: Path) -> None:
    """F L^3 / 3 E I with the shear of Timoshenko; nu = 0."""
    L, b, F, E = 100.0, 10.0, 50.0, 200e3
    beam = Brick(kind, "BEAM", (L, b, b), (10, 1, 1))
    loads = "".join(f"{n}, 2, {F / 4}\n" for n in sorted(beam.nodes_at(0, True))
                    if set(beam.x[n][1:]) <= {0.0, b})
    text = (f"{beam.text()}*MATERIAL, NAME=STEEL\n*ELASTIC\n{E}, 0.\n*BOUNDARY\nBEAM_X0, 1, 3\n"
            f"*STEP\n*STATIC\n*CLOAD\n{loads}*END STEP\n")
    result = solved(deck_of(tmp_path, text))
    tip = at(result, "BEAM", (L, b / 2, b / 2), "displacement", "y")
    inertia, area, G = b**4 / 12, b**2, E / 2
    exact = F * L**3 / (3 * E * inertia) + F * L / (5 / 6 * G * area)
    assert tip == pytest.approx(exact, rel=5e-3)


def total(result: lf.Result, name: str, step: int | None = None) -> np.ndarray:
    """Force of an interface along its components: the local frame is that of its plane face."""
    weights = result.problem.interfaces[name].weights
    force = result.force(name) if step is None else result.force(name)[step]
    return np.asarray(weights @ force)


def plate(tmp_path: Path, middle: str) -> lf.InpDeck:
    """Two blocks on each other, of unlike meshes; the lower one is fixed."""
    low = Brick("C3D8", "LOW", (10.0, 10.0, 5.0), (2, 2, 1))
    high = Brick("C3D8", "HIGH", (10.0, 10.0, 5.0), (3, 3, 1), (0, 0, 5), 1000)
    head = f"{low.text()}{high.text()}*MATERIAL, NAME=STEEL\n*ELASTIC\n200000., 0.\n"
    return deck_of(tmp_path, head + middle)


def test_contact_with_friction_pressed_then_sheared(tmp_path: Path) -> None:
    """Pressed by p = 20 and sheared by 3 (sticks) and then a displacement that slips: shear is mu p."""
    deck = plate(tmp_path, """\
*SURFACE INTERACTION, NAME=DRY
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD
*FRICTION
.2, 1.E6
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Z1, 1, 2
*STEP, NLGEOM
*STATIC
*DSLOAD
SHIGH_Z1, P, 20.
*END STEP
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 1, .0001
*END STEP
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 1, .05
*END STEP
""")
    assert deck.times == [1.0, 2.0, 3.0]
    assert {n.kind for n in deck.notes} == {"changed"}
    words = " ".join(n.text for n in deck.notes)
    assert "NLGEOM" in words and "stick slope" not in words and "mortar" in words and "small" in words
    result = solved(deck)
    name = "SHIGH_Z0|SLOW_Z1"
    normal = [total(result, name, k)[0] for k in range(3)]
    assert normal == pytest.approx([-2000.0] * 3, rel=1e-6)
    shear = [np.linalg.norm(total(result, name, k)[1:]) for k in range(3)]
    assert shear[0] < 1e-6 * 2000
    # both blocks sheared in series, G = E / 2, as long as nothing slips (their sides are free: less)
    assert 0.0 < shear[1] < 100e3 * 100.0 * 1e-4 / 10.0
    assert shear[2] == pytest.approx(0.2 * 2000.0, rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_a_stick_slope_is_an_elastic_slip(tmp_path: Path) -> None:
    """Pressed by p = 20 and moved by u: the slope k holds k u where the blocks are stiff beside it."""
    deck = plate(tmp_path, """\
*SURFACE INTERACTION, NAME=DRY
*FRICTION
.2, 10.
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Z1, 1, 2
*STEP
*STATIC
*DSLOAD
SHIGH_Z1, P, 20.
*END STEP
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 1, .1
*END STEP
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 1, 1.
*END STEP
""")
    result, name = solved(deck), "SHIGH_Z0|SLOW_Z1"
    shear = [np.linalg.norm(total(result, name, k)[1:]) for k in range(3)]
    assert shear[1] == pytest.approx(10.0 * 0.1 * 100.0, rel=1e-2)
    assert shear[2] == pytest.approx(0.2 * 2000.0, rel=1e-6)
    law = next(each.law for each in deck.scene().interfaces.values() if isinstance(each.law, lf.Contact))
    assert law == lf.Contact(friction=0.2, tangential_stiffness=10.0)
    with pytest.raises(lf.SceneError, match="stick slope -10 is negative"):
        plate(tmp_path, """\
*SURFACE INTERACTION, NAME=DRY
*FRICTION
.2, -10.
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*STEP
*STATIC
*END STEP
""")


def test_contact_that_does_not_touch_yet(tmp_path: Path) -> None:
    """CLEARANCE states the gap: a displacement d presses with E (d - gap) / L."""
    deck = plate(tmp_path, """\
*SURFACE INTERACTION, NAME=DRY
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*CLEARANCE, MASTER=SLOW_Z1, SLAVE=SHIGH_Z0, VALUE=.004
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Z1, 1, 2
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 3, 3, -.01
*END STEP
""")
    assert deck.times is None
    assert total(solved(deck), "SHIGH_Z0|SLOW_Z1")[0] == pytest.approx(-100 * 200e3 * 0.006 / 10, rel=1e-6)


def test_linear_overclosure(tmp_path: Path) -> None:
    """A contact stiffness in series with the blocks."""
    deck = plate(tmp_path, """\
*SURFACE INTERACTION, NAME=SOFT
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
20000.
*CONTACT PAIR, INTERACTION=SOFT, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Z1, 1, 2
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 3, 3, -.01
*END STEP
""")
    assert any("20000" in n.text for n in deck.notes)
    exact = -100 * 0.01 / (10 / 200e3 + 1 / 20e3)
    assert total(solved(deck), "SHIGH_Z0|SLOW_Z1")[0] == pytest.approx(exact, rel=1e-6)


def test_tie_of_unlike_meshes(tmp_path: Path) -> None:
    deck = plate(tmp_path, """\
*TIE, NAME=WELD, POSITION TOLERANCE=.01
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
*STEP
*STATIC
*DSLOAD
SHIGH_Z1, P, -50.
*END STEP
""")
    result = solved(deck)
    top = at(result, "HIGH", (5.0, 5.0, 10.0), "displacement", "z")
    assert top == pytest.approx(50 * 10 / 200e3, rel=1e-6)
    assert at(result, "HIGH", (3.0, 3.0, 6.0), "stress", "zz") == pytest.approx(50.0, rel=1e-6)


BOLT = """\
*SURFACE, NAME=CUT
BELOW, S2
*PRE-TENSION SECTION, SURFACE=CUT, NODE=9000
*NODE
9000, 0., 0., 0.
*BOUNDARY
BOLT_Z0, 1, 3
BOLT_Z1, 1, 3
"""


def test_pretension(tmp_path: Path) -> None:
    """Tightened to a force, which is exact; then fixed, and a pulled end adds E A d / L."""
    bolt = Brick("C3D8", "BOLT", (10.0, 10.0, 40.0), (1, 2, 4))
    members = [bolt.first + k for k, nodes in enumerate(bolt.elements)
               if max(bolt.x[n][2] for n in nodes) == 20.0]
    text = bolt.text() + "*MATERIAL, NAME=STEEL\n*ELASTIC\n200000., 0.\n"
    text += "*ELSET, ELSET=BELOW\n" + ",\n".join(map(str, members)) + "\n" + BOLT
    tighten = "*STEP\n*STATIC\n*CLOAD\n9000, 1, 5000.\n*END STEP\n"
    result = solved(deck_of(tmp_path, text + tighten))
    assert total(result, "CUT")[0] == pytest.approx(5000.0, rel=1e-9)
    pull = "*STEP\n*STATIC\n*BOUNDARY, FIXED\n9000, 1\n*BOUNDARY\nBOLT_Z1, 3, 3, .01\n*END STEP\n"
    deck = deck_of(tmp_path, text + tighten + pull)
    assert [(s.start, s.end) for s in deck.steps] == [(0.0, 1.0), (1.0, 2.0)]
    result = solved(deck)
    found = [total(result, "CUT", k)[0] for k in range(2)]
    assert found == pytest.approx([5000.0, 5000.0 + 200e3 * 100 * 0.01 / 40], rel=1e-6)
    shorten = "*STEP\n*STATIC\n*BOUNDARY\n9000, 1, 1, .02\n*END STEP\n"
    result = solved(deck_of(tmp_path, text + shorten))
    assert total(result, "CUT")[0] == pytest.approx(200e3 * 100 * 0.02 / 40, rel=1e-6)


def test_a_clamped_bar_is_warmed(tmp_path: Path) -> None:
    """-E alpha dT, also with a temperature that is linear along the bar: that of its mean."""
    bar = Brick("C3D20", "BAR", (40.0, 5.0, 5.0), (4, 1, 1))
    rows = "".join(f"{n}, {293 + 100 * x[0] / 20:.15g}\n" for n, x in bar.x.items())
    for given, rel in (("NBAR, 393.\n", 1e-6), (rows, 1e-3)):
        deck = deck_of(tmp_path, (
            f"{bar.text()}*MATERIAL, NAME=STEEL\n*ELASTIC\n200000., 0.\n*EXPANSION, ZERO=293.\n12E-6\n"
            "*DENSITY\n7.8E-9\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNBAR, 293.\n"
            "*BOUNDARY\nBAR_X0, 1, 1\nBAR_X1, 1, 1\nBAR_Y0, 2, 2\nBAR_Z0, 3, 3\n"
            f"*STEP\n*STATIC\n*TEMPERATURE\n{given}*END STEP\n"
        ))
        assert deck.densities == {"BAR": 7.8e-9}
        result = solved(deck)
        assert at(result, "BAR", (17.0, 2.0, 3.0), "stress", "xx") == pytest.approx(-240.0, rel=rel)


def test_amplitudes_and_steps(tmp_path: Path) -> None:
    """A table in step 1, what is held in step 2, and OP=NEW, after which nothing pulls, in step 3."""
    bar = Brick("C3D8", "BAR", (10.0, 1.0, 1.0), (2, 1, 1))
    deck = deck_of(tmp_path, (
        f"{bar.text()}*MATERIAL, NAME=STEEL\n*ELASTIC\n1000., 0.\n"
        "*AMPLITUDE, NAME=SAW\n0., 0., .5, 2., 1., 1.\n*BOUNDARY\nBAR_X0, 1, 3\n"
        "*STEP\n*STATIC\n.1, 1.\n*DSLOAD, AMPLITUDE=SAW\nSBAR_X1, P, -10.\n*END STEP\n"
        "*STEP\n*STATIC\n1., 2.\n*CLOAD\nBAR_X1, 2, 0.\n*END STEP\n"
        "*STEP\n*STATIC\n*DLOAD, OP=NEW\n2, P4, -30.\n*END STEP\n"
        "*STEP\n*STATIC\n*DLOAD, OP=NEW\n*END STEP\n"
    ))
    assert deck.times == [0.5, 1.0, 3.0, 4.0, 5.0]
    result = solved(deck)
    found = [at(result, "BAR", (5.0, 0.5, 0.5), "stress", "xx", k) for k in range(5)]
    assert found == pytest.approx([20.0, 10.0, 10.0, 30.0, 0.0], abs=1e-9)


def test_instances_are_turned(tmp_path: Path) -> None:
    """One part twice, the second turned by 90 degrees about z and shifted, tied to the first."""
    bar = Brick("C3D20", "BODY", (10.0, 2.0, 2.0), (2, 1, 1))
    deck = deck_of(tmp_path, f"""\
*HEADING
a bar, and one that stands on its end
*PART, NAME=BAR
{bar.text()}*END PART
*ASSEMBLY, NAME=ALL
*INSTANCE, NAME=LYING, PART=BAR
*END INSTANCE
*INSTANCE, NAME=STANDING, PART=BAR
12., 0., 0.
12., 0., 0., 12., 0., 1., 90.
*END INSTANCE
*NSET, NSET=FOOT, INSTANCE=LYING
BODY_X0,
*TIE, NAME=WELD
STANDING.SBODY_Y1, LYING.SBODY_X1
*END ASSEMBLY
{STEEL}*BOUNDARY
FOOT, ENCASTRE
*STEP, NAME=PULL
*STATIC
*DSLOAD
STANDING.SBODY_X1, P, -1.
*END STEP
""")
    assert deck.parts == ("LYING.BODY", "STANDING.BODY")
    scene = deck.scene()
    x = np.asarray(scene.substructures["STANDING.BODY"].part.mesh.geometry.x)
    assert x.min(axis=0) == pytest.approx([10.0, 0.0, 0.0])
    assert x.max(axis=0) == pytest.approx([12.0, 10.0, 2.0])
    result = lf.solve(lf.assemble(scene), progress=False)
    # 4 N up at x = 11 bend the lying bar about its root
    rows = [name for name in scene.interfaces if name.startswith("FOOT")]
    assert rows == ["FOOT"]
    inertia = 2.0**4 / 12
    tip = at(result, "LYING.BODY", (10.0, 1.0, 1.0), "displacement", "y")
    exact = 4.0 * 10**3 / (3 * 200e3 * inertia) + 4.0 * 1.0 * 10**2 / (2 * 200e3 * inertia)
    assert tip == pytest.approx(exact, rel=0.1)


def test_pieces_of_two_materials_are_glued(tmp_path: Path) -> None:
    bar = Brick("C3D20", "BAR", (10.0, 1.0, 1.0), (2, 1, 1))
    deck = deck_of(tmp_path, (
        f"{bar.text(section=None)}*ELSET, ELSET=A\n1,\n*ELSET, ELSET=B\n2,\n"
        "*MATERIAL, NAME=M1\n*ELASTIC\n1000., 0.\n*MATERIAL, NAME=M2\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
        "500., 100., 100., 0., 0., 0., 50., 50.\n50.\n*ORIENTATION, NAME=TURNED\n1., 0., 0., 0., 1., 0.\n"
        "*SOLID SECTION, ELSET=A, MATERIAL=M1\n*SOLID SECTION, ELSET=B, MATERIAL=M2, ORIENTATION=TURNED\n"
        "*BOUNDARY\nBAR_X0, 1, 3\n*STEP\n*STATIC\n*DSLOAD\nSBAR_X1, P, -2.\n*END STEP\n"
    ))
    assert deck.parts == ("A", "B")
    result = solved(deck)
    end = at(result, "B", (10.0, 0.5, 0.5), "displacement", "x")
    assert end == pytest.approx(2 * 5 * (1e-3 + 2e-3), rel=1e-6)


COUPLING = "*COUPLING, REF NODE=900, SURFACE=SBAR_X1, CONSTRAINT NAME=C\n"


@pytest.mark.parametrize("how", [
    "*RIGID BODY, NSET=BAR_X1, REF NODE=900, ROT NODE=901\n",
    f"{COUPLING}*KINEMATIC\n1, 3\n",
    f"{COUPLING}*DISTRIBUTING\n1, 3\n",
])
def test_a_force_beside_a_bar(how: str, tmp_path: Path) -> None:
    """A reference node 60 beyond the end of a bar: the root takes the force and its moment."""
    bar = Brick("C3D8", "BAR", (80.0, 10.0, 10.0), (4, 1, 1))
    deck = deck_of(tmp_path, (
        f"{bar.text()}{STEEL}*NODE\n900, 140., 5., 5.\n901, 140., 5., 5.\n{how}*BOUNDARY\nBAR_X0, 1, 3\n"
        "*STEP\n*STATIC\n*CLOAD\n900, 3, -100.\n*END STEP\n"
    ))
    (values,) = solved(deck).table("BAR_X0").rows()
    assert values["force_z"] == pytest.approx(100.0, rel=1e-6)
    assert values["moment_y"] == pytest.approx(-14000.0, rel=1e-6)


def test_gravity_and_centrifugal_force(tmp_path: Path) -> None:
    bar = Brick("C3D20", "BAR", (10.0, 1.0, 1.0), (4, 1, 1))
    for load, exact in (("BAR, GRAV, 9810., 1., 0., 0.", 7.8e-9 * 9810 * 10 / 2),
                        ("BAR, CENTRIF, 1.E6, 0., .5, .5, 0., 0., 1.", 7.8e-9 * 1e6 * (100 - 25) / 2)):
        deck = deck_of(tmp_path, (
            f"{bar.text()}*MATERIAL, NAME=STEEL\n*ELASTIC\n200000., 0.\n*DENSITY\n7.8E-9\n"
            f"*BOUNDARY\nBAR_X0, 1, 3\n*STEP\n*STATIC\n*DLOAD\n{load}\n*END STEP\n"
        ))
        assert at(solved(deck), "BAR", (5.0, 0.5, 0.5), "stress", "xx") == pytest.approx(exact, rel=2e-2)


def test_press_fit_of_axisymmetric_rings(tmp_path: Path) -> None:
    """Lame in plane strain, an interference of 0.02."""
    disc = Brick("CAX8", "DISC", (5.0, 4.0), (6, 2), (5.0, 0.0))
    ring = Brick("CAX8", "RING", (10.0, 4.0), (6, 2), (9.98, 0.0), 1000)
    surfaces = ""
    for b, r, face in ((disc, 10.0, "S2"), (ring, 9.98, "S4")):
        members = [b.first + k for k, nodes in enumerate(b.elements)
                   if sum(abs(b.x[n][0] - r) < 1e-9 for n in nodes) == 3]
        surfaces += f"*SURFACE, NAME=S{b.name}\n" + "".join(f"{m}, {face}\n" for m in members)
    deck = deck_of(tmp_path, (
        f"{disc.text()}{ring.text()}{surfaces}*MATERIAL, NAME=STEEL\n*ELASTIC\n210000., .3\n"
        "*SURFACE INTERACTION, NAME=FIT\n*CONTACT PAIR, INTERACTION=FIT\nSDISC, SRING\n"
        "*BOUNDARY\nDISC_Y0, 2, 2\nDISC_Y1, 2, 2\nRING_Y0, 2, 2\nRING_Y1, 2, 2\n*STEP\n*STATIC\n*END STEP\n"
    ))
    result = solved(deck)
    E, nu = 210e3 / (1 - 0.3**2), 0.3 / 0.7
    disc_gives = 10.0 / E * ((10.0**2 + 5.0**2) / (10.0**2 - 5.0**2) - nu)
    ring_gives = 9.98 / E * ((19.98**2 + 9.98**2) / (19.98**2 - 9.98**2) + nu)
    exact = 0.02 / (disc_gives + ring_gives)
    # the two faces have radii that differ by 0.2 %
    assert -result.force("SDISC|SRING")[:, 0].mean() == pytest.approx(exact, rel=2e-3)
