"""Equations, springs, local axes, couplings of nodes, generated meshes and friction that changes in decks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.decks.lines import DeckError
from tests.decks.decks import STEEL, Brick
from tests.decks.test_abaqus import at, deck_of, solved, total

SOFT = "*MATERIAL, NAME=STEEL\n*ELASTIC\n1000., 0.\n"
L = 10.0


def force(result: lf.Result, name: str, step: int | None = None) -> float:
    found = np.asarray(result.force(name) if step is None else result.force(name)[step])
    return float(np.ravel(found)[0])


# --- springs and equations ----------------------------------------------------------------------------
SPRINGS = {
    "SPRINGA": ("SPRINGA", "1, 901", "", "\n40."),
    "SPRING1": ("SPRING1", "1", "", "1\n40."),
    "SPRING2": ("SPRING2", "1, 901", "", "1, 1\n40."),
    "of two nodes of the bar": ("SPRING2", "1, 902", "", "2, 1\n40."),
}


@pytest.mark.parametrize("which", SPRINGS)
def test_springs(which: str, tmp_path: Path) -> None:
    """A bar of E A / L = 100 that a spring of 40 draws along x: F = 140 u; across, it is in vain."""
    kind, nodes, _, data = SPRINGS[which]
    bar = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    end = sorted(bar.nodes_at(0, True), key=lambda n: tuple(bar.x[n]))
    nodes = ", ".join([str(end[0]), *nodes.split(", ")[1:]])
    follow = "".join(f"2\n{n}, 1, 1., {end[0]}, 1, -1.\n" for n in end[1:])
    deck = deck_of(tmp_path, (
        f"{bar.text()}{SOFT}*ELEMENT, TYPE={kind}, ELSET=S\n900, {nodes}\n*SPRING, ELSET=S\n{data}\n"
        f"*NODE\n901, 30., 0., 0.\n902, 30., 0., 0.\n*EQUATION\n{follow}*BOUNDARY\nBAR_X0, 1, 3\n901, 1, 3\n"
        "902, 1, 3\n"
        "*STEP\n*STATIC\n*DSLOAD\nSBAR_X1, P, -7.\n*END STEP\n"
    ))
    result = solved(deck, options=lf.Options(rtol=1e-9))
    stiffness = 100.0 if which.startswith("of") else 140.0
    assert at(result, "BAR", (L, 1.0, 1.0), "displacement", "x") == pytest.approx(7.0 / stiffness, rel=1e-7)
    if stiffness == 140.0:
        (name,) = [n for n in deck.scene().interfaces if n.startswith("spring")]
        assert abs(force(result, name)) == pytest.approx(40.0 * 7.0 / 140.0, rel=1e-6)


def two_bars() -> tuple[Brick, Brick, str]:
    one = Brick("C3D8", "ONE", (L, 1.0, 1.0), (2, 1, 1))
    two = Brick("C3D8", "TWO", (L, 1.0, 1.0), (2, 1, 1), (0.0, 3.0, 0.0), 200)
    return one, two, f"{one.text()}{two.text()}{SOFT}*BOUNDARY\nONE_X0, 1, 3\nTWO_X0, 1, 3\n"


def test_equations_between_two_bars(tmp_path: Path) -> None:
    """The ends move u_2 = 2 u_1, sets in pairs: work is 7 u_2 = 100 u_1^2 + 100 u_2^2, so that u_2 = .056."""
    _, _, head = two_bars()
    deck = deck_of(tmp_path, (
        f"{head}*EQUATION\n2\nTWO_X1, 1, 1., ONE_X1, 1, -2.\n"
        "*STEP\n*STATIC\n*DSLOAD\nSTWO_X1, P, -7.\n*END STEP\n"
    ))
    result = solved(deck, options=lf.Options(rtol=1e-9))
    u = [at(result, part, (L, y, 0.0), "displacement", "x") for part, y in (("ONE", 0.0), ("TWO", 3.0))]
    assert u == pytest.approx([0.028, 0.056], rel=1e-6)


@pytest.mark.parametrize("given", [False, True])
def test_a_control_node(given: bool, tmp_path: Path) -> None:
    """The ends of both bars follow a node that belongs to none: its force is shared, or its displacement is
    given, and held later."""
    _, _, head = two_bars()
    what = "*BOUNDARY\n900, 1, 1, .02\n" if given else "*CLOAD\n900, 1, 4.\n"
    deck = deck_of(tmp_path, (
        f"{head}*NODE\n900, 20., 0., 0.\n*EQUATION\n2\nONE_X1, 1, 1., 900, 1, -1.\n"
        f"2\nTWO_X1, 1, 1., 900, 1, -1.\n*STEP\n*STATIC\n{what}*END STEP\n*STEP\n*STATIC\n*END STEP\n"
    ))
    result = solved(deck, options=lf.Options(rtol=1e-9))
    for step in (0, 1):
        for part, y in (("ONE", 0.0), ("TWO", 4.0)):
            assert at(result, part, (L, y, 1.0), "displacement", "x", step) == pytest.approx(0.02, rel=1e-6)


@pytest.mark.parametrize(("cards", "words"), [
    ("*EQUATION\n2\n1, 1, 1., 9, 1\n", ("*EQUATION", "factor")),
    ("*EQUATION\n3\n1, 1, 1., 9, 1, 1.\n", ("*EQUATION", "3 terms")),
    ("*EQUATION\n2\n1, 7, 1., 9, 1, 1.\n", ("component 7",)),
    ("*EQUATION\n2\n11, 4, 1., 12, 1, 1.\n", ("component 4 of a node of a solid",)),
    ("*EQUATION\n1\nBAR_X0, 1, 1.\n*BOUNDARY\nBAR_X0, 1, 1, .1\n", ("supports contradict it",)),
    ("*ELEMENT, TYPE=SPRING1, ELSET=S\n900, 5\n", ("no *SPRING",)),
    ("*ELEMENT, TYPE=SPRING1, ELSET=S\n900, 5\n*SPRING, ELSET=S\n1\n-3.\n", ("stiffness is >= 0",)),
    ("*ELEMENT, TYPE=SPRING1, ELSET=S\n900, 5\n*SPRING, ELSET=S, NONLINEAR\n1\n3., 1.\n", ("not linear",)),
    ("*NODE\n950, 9., 9., 9.\n*ELEMENT, TYPE=SPRING2, ELSET=S\n900, 5, 950\n*SPRING, ELSET=S\n1, 1\n3.\n",
     ("node 950 belongs to no solid",)),
    ("*ELEMENT, TYPE=DCOUP3D, ELSET=S\n900, 950\n*NODE\n950, 1., 0., 0.\n"
     "*DISTRIBUTING COUPLING, ELSET=S\n5, -1.\n", ("weights",)),
    ("*TRANSFORM, NSET=BAR_X1, TYPE=S\n0., 0., 0., 1., 0., 0.\n", ("kind 'S'",)),
    ("*TRANSFORM, NSET=BAR_X1\n1., 0., 0., 2., 0., 0.\n", ("one line",)),
    ("*KINEMATIC COUPLING, REF NODE=950\nBAR_X1, 7, 8\n*NODE\n950, 1., 0., 0.\n", ("1 to 6",)),
    ("*ELGEN\n77, 3\n", ("no element 77",)),
    ("*ELGEN\n1, 3, 50, 50\n", ("has no node",)),
    ("*NFILL\nBAR_X0\n", ("two sets",)),
])
def test_errors(cards: str, words: tuple[str, ...], tmp_path: Path) -> None:
    bar = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    text = f"{bar.text()}{SOFT}{cards}*BOUNDARY\nBAR_X0, 2, 3\nBAR_X0, 1, 1\n*STEP\n*STATIC\n*END STEP\n"
    if "contradict" in words[0]:
        text = text.replace("BAR_X0, 1, 1\n*STEP", "*STEP")
    with pytest.raises(DeckError) as caught:
        deck_of(tmp_path, text).scene()
    for word in words:
        assert word in str(caught.value), str(caught.value)


# --- couplings of nodes ---------------------------------------------------------------------------------
@pytest.mark.parametrize("how", [
    "*KINEMATIC COUPLING, REF NODE=900\nBAR_X1, 1, 6\n",
    "*KINEMATIC COUPLING, REF NODE=900\nBAR_X1, 1, 2\nBAR_X1, 3\n",
    "*RIGID BODY, NSET=SOME, REF NODE=900, ROT NODE=901\n",
    "*KINEMATIC COUPLING, REF NODE=900\nBAR_X1\n*ELEMENT, TYPE=SPRING1, ELSET=S\n950, 900\n"
    "*SPRING, ELSET=S\n6\n0.\n",
])
def test_a_force_at_a_node_that_others_follow(how: str, tmp_path: Path) -> None:
    """60 beyond the end of a bar: the root takes the force and its moment, however the end follows."""
    bar = Brick("C3D8", "BAR", (80.0, 10.0, 10.0), (4, 1, 1))
    some = sorted(bar.nodes_at(0, True))[:3]
    deck = deck_of(tmp_path, (
        f"{bar.text()}{STEEL}*NODE\n900, 140., 5., 5.\n901, 140., 5., 5.\n*NSET, NSET=SOME\n"
        f"{', '.join(map(str, some))}\n{how}*BOUNDARY\nBAR_X0, 1, 3\n"
        "*STEP\n*STATIC\n*CLOAD\n900, 3, -100.\n*END STEP\n"
    ))
    (values,) = solved(deck, options=lf.Options(rtol=1e-9)).table("BAR_X0").rows()
    assert values["force_z"] == pytest.approx(100.0, rel=1e-6)
    assert values["moment_y"] == pytest.approx(-14000.0, rel=1e-6)


def test_distributing_coupling(tmp_path: Path) -> None:
    """The force acts at the centroid of the nodes, wherever their node is; a spring of it, as stiff as
    the bar, takes a half of it."""
    bar = Brick("C3D20", "BAR", (80.0, 10.0, 10.0), (4, 1, 1))
    text = (
        f"{bar.text()}{STEEL}*ELEMENT, TYPE=DCOUP3D, ELSET=D\n900, 900\n*NODE\n900, 140., 5., 5.\n"
        "*DISTRIBUTING COUPLING, ELSET=D\nBAR_X1, 1.\n*BOUNDARY\nBAR_X0, 1, 3\n"
    )
    load = "*STEP\n*STATIC\n*CLOAD\n900, 3, -100.\n*END STEP\n"
    deck = deck_of(tmp_path, text + load)
    assert any("centroid" in n.text for n in deck.notes)
    (values,) = solved(deck).table("BAR_X0").rows()
    assert values["force_z"] == pytest.approx(100.0, rel=1e-6)
    assert values["moment_y"] == pytest.approx(-8000.0, rel=1e-5)
    spring = "*ELEMENT, TYPE=SPRING1, ELSET=S\n950, 900\n*SPRING, ELSET=S\n1\n250000.\n"
    pull = "*STEP\n*STATIC\n*CLOAD\n900, 1, 1000.\n*END STEP\n"
    deck = deck_of(tmp_path, text.replace(".3\n", ".0\n") + spring + pull)
    (values,) = solved(deck, options=lf.Options(rtol=1e-9)).table("BAR_X0").rows()
    assert values["force_x"] == pytest.approx(-500.0, rel=5e-2)  # the nodal forces are uneven


def test_coupled_along_one_component(tmp_path: Path) -> None:
    """The end of a bar keeps even along z by *KINEMATIC 3 of a node that does not turn, and by equations."""
    bar = Brick("C3D20", "BAR", (10.0, 10.0, 20.0), (2, 2, 2))
    end = sorted(bar.nodes_at(2, True))
    ways = (
        "*COUPLING, REF NODE=900, SURFACE=SBAR_Z1, CONSTRAINT NAME=C\n*KINEMATIC\n3, 3\n",
        "*EQUATION\n" + "".join(f"2\n{n}, 3, 1., 900, 3, -1.\n" for n in end),
    )
    found = []
    for way in ways:
        deck = deck_of(tmp_path, (
            f"{bar.text()}{STEEL}*NODE\n900, 3., 4., 20.\n{way}*BOUNDARY\nBAR_Z0, 1, 3\n900, 4, 6\n"
            "*STEP\n*STATIC\n*CLOAD\n900, 3, 5000.\n*END STEP\n"
        ))
        result = solved(deck, options=lf.Options(rtol=1e-9))
        corners = [at(result, "BAR", (x, y, 20.0), "displacement", "z") for x in (0, 10) for y in (0, 10)]
        assert np.ptp(corners) < 1e-7 * corners[0]
        (values,) = result.table("BAR_Z0").rows()
        assert values["force_z"] == pytest.approx(-5000.0, rel=1e-6)
        found.append(corners[0])
    assert found[0] == pytest.approx(found[1], rel=1e-3)


# --- local axes -----------------------------------------------------------------------------------------
def sector(kind: str = "C3D20") -> Brick:
    """A quarter of a ring of radii 10 and 20, of height 5; x is the radius, y the angle."""
    return Brick(kind, "RING", (10.0, 1.0, 5.0), (4, 4, 1), (10.0, 0.0, 0.0), mapping=lambda x: np.array(
        [x[0] * np.cos(0.5 * np.pi * x[1]), x[0] * np.sin(0.5 * np.pi * x[1]), x[2]]))


@pytest.mark.parametrize("load", ["pressure", "displacement"])
@pytest.mark.parametrize("kind", ["C3D20", "C3D8I"])
def test_a_ring_in_cylindrical_axes(kind: str, load: str, tmp_path: Path) -> None:
    """Lame in plane strain: both cuts are held along the angle, the ring along its axis; the hole has a
    pressure, or is widened by .01."""
    ring = sector(kind)
    inside = "*DSLOAD\nSRING_X0, P, 100.\n" if load == "pressure" else "*BOUNDARY\nRING_X0, 1, 1, .01\n"
    deck = deck_of(tmp_path, (
        f"{ring.text()}{STEEL}*TRANSFORM, NSET=NRING, TYPE=C\n0., 0., -1., 0., 0., 1.\n"
        "*BOUNDARY\nRING_Y0, 2, 2\nRING_Y1, 2, 2\nNRING, 3, 3\n"
        f"*STEP\n*STATIC\n{inside}*END STEP\n"
    ))
    result = solved(deck)
    a, b, E, nu = 10.0, 20.0, 200e3, 0.3
    of_radius = {r: 1.3 / E * a**2 / (b**2 - a**2) * ((1 - 2 * nu) * r + b**2 / r) for r in (a, b)}
    scale = 100.0 if load == "pressure" else 0.01 / of_radius[a]
    found = [at(result, "RING", (r * c, r * c, 2.5), "displacement", "x") / c
             for r in (a, b) for c in (np.sqrt(0.5),)]
    rel = 2e-3 if kind == "C3D20" else 3e-2
    assert found == pytest.approx([scale * of_radius[a], scale * of_radius[b]], rel=rel)


def test_forces_and_supports_along_turned_axes(tmp_path: Path) -> None:
    """A bar turned by 30 degrees: its own axes give what global ones give to a bar along x."""
    c, s = np.sqrt(0.75), 0.5
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    ends = []
    own_axes = f"*TRANSFORM, NSET=NBAR\n{c}, {s}, 0., {-s}, {c}, 0.\n"
    for mapping, card in ((None, ""), (lambda x: turn @ x, own_axes)):
        bar = Brick("C3D20", "BAR", (L, 1.0, 1.0), (2, 1, 1), mapping=mapping)
        deck = deck_of(tmp_path, (
            f"{bar.text()}{STEEL}{card}*BOUNDARY\nBAR_X0, 1, 1\nBAR_Z0, 3, 3\n{bar.nodes_at(0)[0]}, 2, 2\n"
            "*STEP\n*STATIC\n*CLOAD\nBAR_X1, 1, 2.\nBAR_X1, 3, 1.\n*END STEP\n"
        ))
        result = solved(deck)
        x = (turn if mapping else np.eye(3)) @ [L, 1.0, 1.0]
        u = [at(result, "BAR", x, "displacement", axis) for axis in "xyz"]
        ends.append((turn.T if mapping else np.eye(3)) @ u)
    assert ends[1] == pytest.approx(ends[0], rel=1e-7, abs=1e-12)


def test_a_shaft_is_turned_along_the_angle(tmp_path: Path) -> None:
    """*KINEMATIC 2 in cylindrical axes: the end of a ring turns by .001 and is free else: T = G I_p phi / L,
    with cuts that are held along the radius and the axis for no more than the other parts of the ring do."""
    ring = sector()
    deck = deck_of(tmp_path, (
        f"{ring.text()}{STEEL}*NODE\n900, 0., 0., 5.\n*ORIENTATION, NAME=ROUND, SYSTEM=CYLINDRICAL\n"
        "0., 0., 0., 0., 0., 1.\n*COUPLING, REF NODE=900, SURFACE=SRING_Z1, ORIENTATION=ROUND, "
        "CONSTRAINT NAME=C\n*KINEMATIC\n2\n*TRANSFORM, NSET=NRING, TYPE=C\n0., 0., -1., 0., 0., 1.\n"
        "*BOUNDARY\nRING_Z0, 1, 3\nRING_Y0, 1, 1\nRING_Y0, 3, 3\nRING_Y1, 1, 1\nRING_Y1, 3, 3\n"
        "900, 1, 5\n*STEP\n*STATIC\n*BOUNDARY\n900, 6, 6, .001\n*END STEP\n"
    ))
    result = solved(deck)
    for r in (10.0, 15.0, 20.0):
        c = np.sqrt(0.5)
        found = at(result, "RING", (r * c, r * c, 2.5), "displacement", "y") / c
        assert found == pytest.approx(0.5 * 0.001 * r, rel=2e-2)


# --- friction that changes, generated meshes -----------------------------------------------------------
def test_change_friction(tmp_path: Path) -> None:
    """A block that slides: its shear is mu p before and after."""
    low = Brick("C3D8", "LOW", (10.0, 10.0, 5.0), (2, 2, 1))
    high = Brick("C3D8", "HIGH", (10.0, 10.0, 5.0), (3, 3, 1), (0, 0, 5), 1000)
    deck = deck_of(tmp_path, f"""\
{low.text()}{high.text()}*MATERIAL, NAME=STEEL
*ELASTIC
200000., 0.
*SURFACE INTERACTION, NAME=DRY
*FRICTION
.1,
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
HIGH_Z1, 1, 1, .05
*END STEP
*STEP
*STATIC
*CHANGE FRICTION, INTERACTION=DRY
*FRICTION
.3,
*BOUNDARY
HIGH_Z1, 1, 1, .1
*END STEP
""")
    result = solved(deck)
    shear = [np.linalg.norm(total(result, "SHIGH_Z0|SLOW_Z1", k)[1:]) for k in range(3)]
    assert shear[1:] == pytest.approx([0.1 * 2000.0, 0.3 * 2000.0], rel=1e-6)


def test_generated_meshes(tmp_path: Path) -> None:
    """A quarter of a ring, of nodes in cylindrical coordinates, filled and copied in a shifted system."""
    rows = "".join(f"{n}, {r}, 0., {z}\n{n + 90}, {r}, 90., {z}\n"
                   for n, r, z in ((1, 10., 0.), (2, 20., 0.), (11, 10., 5.), (12, 20., 5.)))
    deck = deck_of(tmp_path, (
        f"*SYSTEM\n5., 0., 0., 6., 0., 0.\n*NODE, SYSTEM=C\n{rows}*SYSTEM\n*NODE\n900, 1., 2., 3.\n"
        "*NSET, NSET=FROM\n1, 2, 11, 12\n*NSET, NSET=TO\n91, 92, 101, 102\n"
        "*NFILL, NSET=ALL\nFROM, TO, 3, 30\n"
        "*ELEMENT, TYPE=C3D8, ELSET=ONE\n1, 1, 2, 32, 31, 11, 12, 42, 41\n"
        f"*ELGEN, ELSET=RING\n1, 3, 30, 5\n{SOFT}*SOLID SECTION, ELSET=RING, MATERIAL=STEEL\n"
        "*BOUNDARY\nFROM, 1, 3\n*STEP\n*STATIC\n*CLOAD\nTO, 1, 1.\n*END STEP\n"
    ))
    part = deck.scene().substructures["RING"].part
    x = np.asarray(part.mesh.geometry.x)
    assert len(x) == 16 and part.mesh.topology.index_map(3).size_local == 3
    assert x.min(axis=0) == pytest.approx([5.0, 0.0, 0.0], abs=1e-12)
    assert x.max(axis=0) == pytest.approx([25.0, 20.0, 5.0])
    assert np.abs(x - [5.0 + 10.0 * 2 / 3, 10.0 / 3, 0.0]).sum(axis=1).min() < 1e-9
    assert deck.scene().substructures["RING"].part.mesh.geometry.x[:, 2].max() == 5.0


# --- what hangs together ----------------------------------------------------------------------------------
def test_a_bolt_in_a_frame(tmp_path: Path) -> None:
    """A closed frame is cut through one leg: it is two parts, glued elsewhere, and the leg has the force."""
    frame = Brick("C3D8", "FRAME", (30.0, 30.0, 10.0), (3, 3, 1))
    del frame.elements[4]
    leg = frame.first + 2 + 1  # the middle of the leg at y = 0 stands on it
    deck = deck_of(tmp_path, (
        f"{frame.text()}{STEEL}*SURFACE, NAME=CUT\n{leg}, S6\n*NODE\n900, 0., 0., 0.\n"
        "*PRE-TENSION SECTION, SURFACE=CUT, NODE=900\n*BOUNDARY\nFRAME_Z0, 3, 3\n"
        f"{frame.nodes_at(1, True)[0]}, 1, 2\n{frame.nodes_at(1, True)[-1]}, 2, 2\n"
        "*STEP\n*STATIC\n*CLOAD\n900, 1, 5000.\n*END STEP\n"
    ))
    assert deck.parts == ("FRAME", "FRAME#2")
    result = solved(deck)
    assert total(result, "CUT")[0] == pytest.approx(5000.0, rel=1e-9)
    assert "FRAME|FRAME#2" in deck.scene().interfaces


def test_parts_that_share_an_edge(tmp_path: Path) -> None:
    """Two cubes that share the nodes of an edge: what pulls one along the edge holds the other."""
    one = Brick("C3D20", "ONE", (1.0, 1.0, 1.0), (1, 1, 1))
    two = Brick("C3D20", "TWO", (1.0, 1.0, 1.0), (1, 1, 1), (1.0, 1.0, 0.0), 100)
    same = {b: a for a, x in one.x.items() for b, y in two.x.items() if np.allclose(x, y)}
    own = [str(same.get(n, n)) for n in two.elements[0]]
    element = f"*ELEMENT, TYPE=C3D20, ELSET=TWO\n500, {', '.join(own[:15])},\n{', '.join(own[15:])}\n"
    nodes = "".join(f"{n}, {x[0]}, {x[1]}, {x[2]}\n" for n, x in two.x.items() if n not in same)
    held = ", ".join(str(n) for n, x in two.x.items() if x[0] == 2.0)
    deck = deck_of(tmp_path, (
        f"{one.text()}{STEEL}*NODE\n{nodes}{element}*SOLID SECTION, ELSET=TWO, MATERIAL=STEEL\n"
        f"*NSET, NSET=HELD\n{held}\n*BOUNDARY\nHELD, 1, 3\nONE_X0, 1, 2\nONE_Y0, 1, 2\n"
        "*STEP\n*STATIC\n*DSLOAD\nSONE_Z1, P, -8.\n*END STEP\n"
    ))
    assert deck.parts == ("ONE", "TWO") and len(same) == 3
    (values,) = solved(deck, options=lf.Options(rtol=1e-9)).table("HELD").rows()
    assert values["force_z"] == pytest.approx(-8.0, rel=1e-6)


def test_adjust_closes_a_part_of_a_gap(tmp_path: Path) -> None:
    low = Brick("C3D8", "LOW", (10.0, 10.0, 5.0), (2, 2, 1))
    high = Brick("C3D8", "HIGH", (10.0, 10.0, 5.0), (5, 5, 1), (0, 0, 5), 1000,
                 mapping=lambda x: x + [0.0, 0.0, 1e-3 * x[0]])
    deck = deck_of(tmp_path, (
        f"{low.text()}{high.text()}{STEEL}*SURFACE INTERACTION, NAME=DRY\n"
        "*CONTACT PAIR, INTERACTION=DRY, ADJUST=.005, TYPE=SURFACE TO SURFACE\nSHIGH_Z0, SLOW_Z1\n"
        "*BOUNDARY\nLOW_Z0, 1, 3\nHIGH_Z1, 1, 3\n*STEP\n*STATIC\n*END STEP\n"
    ))
    gap = deck.scene().interfaces["SHIGH_Z0|SLOW_Z1"].law.parameters()["gap"]
    points = np.array([[x, 4.0, 5.0] for x in (0.0, 4.0, 6.0, 10.0)])
    assert gap(points) == pytest.approx([0.0, 0.0, 0.006, 0.01])


@pytest.mark.parametrize(("cards", "words"), [
    ("*STEP\n*STATIC\n*CLOAD, LOAD CASE=2\nBAR_X1, 1, 1.\n*END STEP\n", ("the parameter LOADCASE",)),
    ("*STEP, NLGEOM\n*STATIC\n*BOUNDARY\n900, 6, 6, 1.57\n*END STEP\n", ("rotation of 1.57",)),
])
def test_refused(cards: str, words: tuple[str, ...], tmp_path: Path) -> None:
    bar = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    head = f"{bar.text()}{SOFT}*NODE\n900, 0., 0., 0.\n*RIGIDBODY, NSET=BAR_X1, REF NODE=900\n"
    with pytest.raises(DeckError) as caught:
        deck_of(tmp_path, f"{head}*BOUNDARY\nBAR_X0, 1, 3\n{cards}").scene()
    for word in words:
        assert word in str(caught.value), str(caught.value)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_rod_is_tightened(sign: int, tmp_path: Path) -> None:
    """A rod between the means of the ends of two bars pulls both with the force of its section."""
    _, _, head = two_bars()
    deck = deck_of(tmp_path, (
        "*ELEMENT, TYPE=DCOUP3D, ELSET=D1\n901, 901\n*ELEMENT, TYPE=DCOUP3D, ELSET=D2\n902, 902\n"
        f"*ELEMENT, TYPE=B31, ELSET=ROD\n903, 903, 904\n{head}*NODE\n901, {L}, .5, .5\n902, {L}, 3.5, .5\n"
        f"903, {L}, .5, .5\n904, {L}, 3.5, .5\n910, 0., 0., 0.\n*BEAM SECTION, ELSET=ROD, MATERIAL=STEEL, "
        "SECTION=RECT\n.1, .1\n0., 0., 1.\n*DISTRIBUTING COUPLING, ELSET=D1\nONE_X1, 1.\n"
        "*DISTRIBUTING COUPLING, ELSET=D2\nTWO_X1, 1.\n*EQUATION\n"
        + "".join(f"2\n{a}, {k}, 1., {a + 2}, {k}, -1.\n" for a in (901, 902) for k in (1, 2, 3))
        + f"*PRE-TENSION SECTION, ELEMENT=903, NODE=910\n0., {sign}., 0.\n"
        "*STEP\n*STATIC\n*CLOAD\n910, 1, 4.\n*END STEP\n"
    ))
    result = solved(deck)
    for part, way in (("ONE", 1.0), ("TWO", -1.0)):
        (values,) = result.table(f"{part}_X0").rows()
        assert values["force_y"] == pytest.approx(-4.0 * sign * way, rel=1e-6)
        assert values["force_x"] == pytest.approx(0.0, abs=1e-6)


def test_forces_along_the_axes_of_a_coupling(tmp_path: Path) -> None:
    bar = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    deck = deck_of(tmp_path, (
        f"{bar.text()}{SOFT}*NODE\n900, {L}, .5, .5\n*ORIENTATION, NAME=TURNED\n.8, .6, 0., -.6, .8, 0.\n"
        "*COUPLING, REF NODE=900, SURFACE=SBAR_X1, ORIENTATION=TURNED, CONSTRAINT NAME=C\n*DISTRIBUTING\n"
        "1, 3\n*BOUNDARY\nBAR_X0, 1, 3\n*STEP\n*STATIC\n*CLOAD\n900, 1, 5.\n*END STEP\n"
    ))
    (values,) = solved(deck).table("BAR_X0").rows()
    assert [values[f"force_{c}"] for c in "xyz"] == pytest.approx([-4.0, -3.0, 0.0], abs=1e-6)


def test_a_ring_of_a_material_round_its_axis(tmp_path: Path) -> None:
    """Wound along the angle, four times as stiff there, nu = 0: u = A r^2 + B / r^2 (Lekhnitskii)."""
    ring = sector()
    deck = deck_of(tmp_path, (
        f"{ring.text(section=None)}*ORIENTATION, NAME=ROUND, SYSTEM=CYLINDRICAL\n0., 0., -1., 0., 0., 1.\n"
        "*MATERIAL, NAME=WOUND\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
        "5000., 20000., 5000., 0., 0., 0., 2500., 2500.\n2500.\n"
        "*SOLID SECTION, ELSET=RING, MATERIAL=WOUND, ORIENTATION=ROUND\n"
        "*BOUNDARY\nRING_Y0, 2, 2\nRING_Y1, 1, 1\nRING_Z0, 3, 3\n"
        "*STEP\n*STATIC\n*DSLOAD\nSRING_X0, P, 10.\n*END STEP\n"
    ))
    result = solved(deck)
    a, b, E = 10.0, 20.0, 5000.0
    # sigma_r = E u' is -10 at a and 0 at b
    A, B = np.linalg.solve([[2.0 * a, -2.0 / a**3], [2.0 * b, -2.0 / b**3]], [-10.0 / E, 0.0])
    c = np.sqrt(0.5)
    found = [at(result, "RING", (r * c, r * c, 2.5), "displacement", "x") / c for r in (a, b)]
    assert found == pytest.approx([A * r**2 + B / r**2 for r in (a, b)], rel=2e-2)
    r = 15.0
    hoop = at(result, "RING", (1e-6, r, 2.5), "stress", "xx")
    assert hoop == pytest.approx(20000.0 * (A * r + B / r**3), rel=5e-2)


def test_a_clamped_face_has_no_axes(tmp_path: Path) -> None:
    """All components of a curved face are 0: one support, whatever their axes are."""
    ring = sector()
    deck = deck_of(tmp_path, (
        f"{ring.text()}{STEEL}*TRANSFORM, NSET=NRING, TYPE=C\n0., 0., -1., 0., 0., 1.\n"
        "*BOUNDARY\nRING_X0, PINNED\n*STEP\n*STATIC\n*CLOAD\nRING_X1, 2, 1.\n*END STEP\n"
    ))
    scene = deck.scene()
    assert list(scene.interfaces) == ["RING_X0"]
    (values,) = solved(deck).table("RING_X0").rows()
    total_force = sum(np.array([-ring.x[n][1], ring.x[n][0]]) / 20.0 for n in ring.nodes_at(0, True))
    assert [values["force_x"], values["force_y"]] == pytest.approx(-total_force, rel=1e-6)
