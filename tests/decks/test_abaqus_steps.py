"""Supports that come and go in decks, nodes that meet faces, gaps, delays, several thicknesses."""

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
END = (L, 0.5, 0.5)


def bar(kind: str = "C3D8") -> tuple[Brick, str]:
    """Held at its begin, pulled by 10 at its end in the first step: it grows by .1."""
    brick = Brick(kind, "BAR", (L, 1.0, 1.0), (2, 1, 1))
    return brick, (
        f"{brick.text()}{SOFT}*BOUNDARY\nBAR_X0, 1, 3\n"
        "*STEP\n*STATIC\n*DSLOAD\nSBAR_X1, P, -10.\n*END STEP\n"
    )


def step(*cards: str, increments: str = "") -> str:
    static = ["*STATIC, DIRECT", increments] if increments else ["*STATIC"]
    return "\n".join(["*STEP", *static, *cards, "*END STEP\n"])


# --- forces -------------------------------------------------------------------------------------------
def test_forces_of_nodes_that_grow_alike_are_one_load(tmp_path: Path) -> None:
    """10 along the bar, of shares that are no binary numbers, and 1 across that grows in another way."""
    brick, _ = bar()
    nodes, shares = sorted(brick.nodes_at(0, True)), (0.1, 0.3, 0.2, 0.4)
    along = "".join(f"{node}, 1, {10 * share}\n" for node, share in zip(nodes, shares, strict=True))
    deck = deck_of(tmp_path, (
        "*AMPLITUDE, NAME=A\n0., 0., .3, .1, 1., 1.\n*AMPLITUDE, NAME=B\n0., 0., .3, 1., 1., 1.\n"
        f"{brick.text()}{SOFT}*BOUNDARY\nBAR_X0, 1, 3\n*STEP\n*STATIC, DIRECT\n.1, 1.\n"
        f"*CLOAD, AMPLITUDE=A\n{along}*CLOAD, AMPLITUDE=B\n{nodes[0]}, 2, 1.\n*END STEP\n"
    ))
    assert sorted(deck.scene().loads) == [f"force {nodes[0]}", "force of nodes"]
    result = solved(deck)
    corners = [(L, y, z) for y in (0.0, 1.0) for z in (0.0, 1.0)]
    for time, force in ((0.3, 1.0), (1.0, 10.0)):  # nu = 0: the mean over the section is that of a bar
        moved = [at(result, "BAR", x, "displacement", "x", deck.times.index(time)) for x in corners]
        assert np.mean(moved) == pytest.approx(force * L / 1000.0, rel=1e-9)


# --- supports -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["C3D8", "C3D20"])
def test_a_support_that_comes_and_goes(kind: str, tmp_path: Path) -> None:
    """It goes from where the end is to .02, on to .05, and lets go; and once more, where it stays."""
    _, text = bar(kind)
    deck = deck_of(tmp_path, text + (
        step("*BOUNDARY", "BAR_X1, 1, 1, .02", increments=".5, 1.")
        + step("*BOUNDARY", "BAR_X1, 1, 1, .05", increments=".5, 1.")
        + step("*BOUNDARY, OP=NEW", "BAR_X0, 1, 3")
        + step("*BOUNDARY, FIXED", "BAR_X1, 1, 1", "*DSLOAD", "SBAR_X1, P, -30.")
        + step("*BOUNDARY, OP=NEW", "BAR_X0, 1, 3")
    ))
    result = solved(deck, options=lf.Options(rtol=1e-10))
    assert deck.times == [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0]
    moved = [at(result, "BAR", END, "displacement", "x", k) for k in range(len(deck.times))]
    assert moved == pytest.approx([0.1, 0.06, 0.02, 0.035, 0.05, 0.1, 0.1, 0.3], abs=1e-9)
    names = [name for name in result.problem.interfaces if name.startswith("BAR_X1")]
    held = [sum(total(result, name, k)[0] for name in names) for k in range(len(deck.times))]
    assert held == pytest.approx([0.0, -4.0, -8.0, -6.5, -5.0, 0.0, -20.0, 0.0], abs=1e-7)


def test_an_amplitude_gives_the_value_itself(tmp_path: Path) -> None:
    _, text = bar()
    table = "*AMPLITUDE, NAME=A\n0., 0., .5, 1., 1., .5\n"
    deck = deck_of(tmp_path, table + text + step("*BOUNDARY, AMPLITUDE=A", "BAR_X1, 1, 1, .02"))
    moved = [at(solved(deck), "BAR", END, "displacement", "x", k) for k in range(3)]
    assert moved == pytest.approx([0.1, 0.02, 0.01], abs=1e-9)


def test_nodes_with_values_of_their_own_come_and_go(tmp_path: Path) -> None:
    """An end that is turned by its nodes in the second step, and is straight again in the third."""
    brick, text = bar()
    values = [f"{n}, 1, 1, {0.02 * x[1]:.6g}" for n, x in brick.x.items() if x[0] == L]
    deck = deck_of(tmp_path, text + step("*BOUNDARY", *values) + step("*BOUNDARY, OP=NEW", "BAR_X0, 1, 3"))
    result = solved(deck)
    for y in (0.0, 1.0):
        moved = [at(result, "BAR", (L, y, 0.5), "displacement", "x", k) for k in range(3)]
        assert moved == pytest.approx([0.1, 0.02 * y, 0.1], abs=1e-8)


def test_a_support_of_before_the_steps_is_taken_away_in_the_first(tmp_path: Path) -> None:
    brick = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    deck = deck_of(tmp_path, (
        f"{brick.text()}{SOFT}*BOUNDARY\nBAR_X1, 1, 3\n"
        + step("*BOUNDARY, OP=NEW", "BAR_X0, 1, 3", "*DSLOAD", "SBAR_X1, P, -10.")
    ))
    assert deck.times is None
    assert at(solved(deck), "BAR", END, "displacement", "x") == pytest.approx(0.1)


def test_a_support_of_before_the_steps_holds_its_value_until_it_goes(tmp_path: Path) -> None:
    """As CalculiX has it: held at 0, let go at once, and from where it is to .02."""
    _, text = bar()
    text = text.replace("BAR_X0, 1, 3\n", "BAR_X0, 1, 3\nBAR_X1, 1, 3\n", 1)
    deck = deck_of(tmp_path, text + (
        step("*BOUNDARY, OP=NEW", "BAR_X0, 1, 3", increments=".5, 1.")
        + step("*BOUNDARY", "BAR_X1, 1, 1, .02", increments=".5, 1.")
    ))
    result = solved(deck)
    moved = [at(result, "BAR", END, "displacement", "x", k) for k in range(len(deck.times))]
    assert deck.times == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert moved == pytest.approx([0.0, 0.1, 0.1, 0.06, 0.02], abs=1e-8)


def test_from_where_it_was_fixed_to_a_value(tmp_path: Path) -> None:
    _, text = bar()
    deck = deck_of(tmp_path, text + (
        step("*BOUNDARY, FIXED", "BAR_X1, 1, 1", "*DSLOAD", "SBAR_X1, P, -30.")
        + step("*BOUNDARY", "BAR_X1, 1, 1, .02", increments=".5, 1.")
        + step("*BOUNDARY, FIXED", "BAR_X1, 1, 1")
    ))
    result = solved(deck)
    moved = [at(result, "BAR", END, "displacement", "x", k) for k in range(len(deck.times))]
    assert moved == pytest.approx([0.1, 0.1, 0.06, 0.02, 0.02], abs=1e-8)


def test_a_held_block_on_a_held_slab(tmp_path: Path) -> None:
    """A slab of one cell that is held all around has no displacements at all: forces on it are no imbalance.
    The block is pressed, dragged by its foot, and dragged back."""
    low = Brick("C3D8", "LOW", (3.0, 3.0, 1.0), (1, 1, 1), (-1.0, -1.0, -1.0), 1000)
    high = Brick("C3D8", "HIGH", (1.0, 1.0, 1.0), (1, 1, 1))
    deck = deck_of(tmp_path, (
        f"{low.text()}{high.text()}{STEEL}*SURFACE INTERACTION, NAME=DRY\n"
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1.E7\n*FRICTION\n.2, 8000.\n"
        "*CONTACT PAIR, INTERACTION=DRY\nSHIGH_Z0, SLOW_Z1\n*BOUNDARY\nNLOW, 1, 3\n"
        + step("*DSLOAD", "SHIGH_Z1, P, 100.", "*BOUNDARY", "HIGH_Z1, 1, 2")
        + step("*BOUNDARY, OP=NEW", "NLOW, 1, 3", "HIGH_Z0, 2, 2, .05")
        + step("*BOUNDARY, OP=NEW", "NLOW, 1, 3", "HIGH_Z0, 2, 2, -.05")
    ))
    result = solved(deck)
    points = result.problem.interfaces["SHIGH_Z0|SLOW_Z1"]
    force = np.einsum("p,tpi,pij->tj", points.weights, result.force(points.name), points.frames)
    assert np.abs(force[:, 2]) == pytest.approx(100.0, rel=1e-6)
    assert force[1:, 1] == pytest.approx([-20.0, 20.0], rel=1e-3)  # friction of the normal force
    assert np.abs(force[:, 0]).max() < 1e-6


def test_supports_of_bodies_last(tmp_path: Path) -> None:
    _, text = bar()
    text = text.replace("*STEP", "*NODE\n900, 10., 0., 0.\n*RIGID BODY, NSET=BAR_X1, REF NODE=900\n*STEP", 1)
    with pytest.raises(DeckError, match="node 900 is held from step 2 on, but belongs to no solid or moves"):
        deck_of(tmp_path, text + step("*BOUNDARY", "900, 1, 1, .02"))


# --- nodes that meet faces ----------------------------------------------------------------------------
def two_blocks(kind: str, interaction: str, options: str = "", apart: float = 0.001) -> str:
    """Four feet of a block over the middle of another one of one cell; springs of feet are alike."""
    low = Brick(kind, "LOW", (4.0, 4.0, 2.0), (1, 1, 1), (-1.5, -1.0, -2.0), 1000)
    high = Brick("C3D8", "HIGH", (1.0, 1.0, 1.0), (1, 1, 1), (0.0, 0.0, apart))
    sides = [n for n, x in high.x.items() if x[2] == apart]
    return (
        f"{low.text()}{high.text()}{SOFT}*SURFACE INTERACTION, NAME=FEET\n{interaction}"
        f"*SURFACE, NAME=FEET, TYPE=NODE\n{sides[0]}\n{sides[1]}\n{sides[2]}\n{sides[3]}\n"
        f"*CONTACT PAIR, INTERACTION=FEET, TYPE=NODE TO SURFACE{options}\nFEET, SLOW_Z1\n"
        "*BOUNDARY\nLOW_Z0, 1, 3\nNHIGH, 1, 2\nNLOW, 1, 2\n"
    )


LINEAR = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n100.\n"


def single(text: str, feet: int) -> str:
    """The same with some of the feet only, which make up no face."""
    lines = text.split("\n")
    k = lines.index("*SURFACE, NAME=FEET, TYPE=NODE")
    del lines[k + 1 + feet : k + 5]
    return "\n".join(lines)


@pytest.mark.parametrize("kind", ["C3D8", "C3D20"])
def test_single_nodes_meet_a_face(kind: str, tmp_path: Path) -> None:
    """Two feet, pushed down by .011 behind a gap of .001: shares of a face take their forces to its nodes."""
    text = single(two_blocks(kind, LINEAR), 2) + step("*BOUNDARY", "NHIGH, 3, 3, -.011")
    result = solved(deck_of(tmp_path, text))
    stops = [name for name in result.problem.interfaces if name.startswith("FEET node")]
    assert len(stops) == 2
    area = 0.75  # a quarter of each of three faces
    for name, x in zip(sorted(stops), (0.0, 1.0)):
        force = float(result.force(name)[0, 0])
        under = at(result, "LOW", (x, 0.0, 0.0), "displacement", "z")
        assert force == pytest.approx(-100.0 * area * (0.01 + under), rel=1e-6)
        assert under < -1e-4


def test_single_nodes_that_stay_apart_are_put_on_by_adjust_and_refused(tmp_path: Path) -> None:
    push = step("*BOUNDARY", "NHIGH, 3, 3, -.0005")
    free = solved(deck_of(tmp_path, single(two_blocks("C3D8", ""), 1) + push))
    (name,) = [n for n in free.problem.interfaces if n.startswith("FEET node")]
    assert not free.force(name).any()
    put = solved(deck_of(tmp_path, single(two_blocks("C3D8", "", ", ADJUST=.002"), 1) + push))
    assert at(put, "LOW", (0.0, 0.0, 0.0), "displacement", "z") == pytest.approx(-0.0005, abs=1e-9)
    assert float(put.force(name)[0, 0]) < -0.01
    with pytest.raises(DeckError, match="contact of single nodes that is with friction"):
        deck_of(tmp_path, single(two_blocks("C3D8", "*FRICTION\n.2\n"), 1) + push)


def test_tied_single_nodes_follow_the_face(tmp_path: Path) -> None:
    text = single(two_blocks("C3D20", ""), 2)
    text = text.replace("*CONTACT PAIR, INTERACTION=FEET, TYPE=NODE TO SURFACE", "*TIE, NAME=GLUE")
    deck = deck_of(tmp_path, text.replace("NHIGH, 1, 2\n", "HIGH_Z1, 1, 2\n") + step("*BOUNDARY",
                   "HIGH_Z1, 3, 3, .01"))
    result = solved(deck, options=lf.Options(rtol=1e-10))
    for x in (0.0, 1.0):
        foot = at(result, "HIGH", (x, 0.0, 0.001), "displacement", "z")
        assert foot == pytest.approx(at(result, "LOW", (x, 0.0, 0.0), "displacement", "z"), abs=1e-9)
        assert foot > 1e-4


def test_surfaces_of_solids_in_the_same_place(tmp_path: Path) -> None:
    one = Brick("C3D8", "ONE", (1.0, 1.0, 1.0), (1, 1, 1))
    two = Brick("C3D8", "TWO", (1.0, 1.0, 2.0), (2, 2, 2), (0.0, 0.0, -1.0), 1000)
    deck = f"{one.text()}{two.text()}{STEEL}*TIE, NAME=GLUE\nSTWO_Z1, SONE_Z1\n"
    with pytest.raises(DeckError, match="TIE: both surfaces face the same way: their solids are in the same"):
        deck_of(tmp_path, deck + step("*BOUNDARY", "ONE_Z0, 1, 3"))
    deck = deck.replace("STWO_Z1, SONE_Z1", "SONE_Z1, SONE_Z1")
    with pytest.raises(DeckError, match="both surfaces are the same; name two"):
        deck_of(tmp_path, deck + step("*BOUNDARY", "ONE_Z0, 1, 3"))


def test_gaps(tmp_path: Path) -> None:
    """Four gaps of .02 beside an end that a force of 10 would move by .1: theirs is .08 times 100."""
    brick, text = bar()
    ends = brick.nodes_at(0, True)
    walls = [f"{900 + n}, 12., {brick.x[n][1]}, {brick.x[n][2]}" for n in ends]
    gaps = [f"{900 + n}, {n}, {900 + n}" for n in ends]
    cards = "\n".join([
        "*NODE, NSET=WALL", *walls, "*ELEMENT, TYPE=GAPUNI, ELSET=GAPS", *gaps, "*GAP, ELSET=GAPS", ".02, 2.",
        "*BOUNDARY", "WALL, 1, 3", "",
    ])
    result = solved(deck_of(tmp_path, text.replace("*STEP", f"{cards}*STEP", 1)))
    assert at(result, "BAR", END, "displacement", "x") == pytest.approx(0.02)
    forces = [float(result.force(n)[0, 0]) for n in result.problem.interfaces if n.startswith("gap ")]
    assert sum(forces) == pytest.approx(-8.0, rel=1e-5)  # the tolerance of the solution is 1e-6
    soft = text.replace("*STEP", f"{cards.replace('.02, 2.', '.02, 2., 0., 0., , 25.')}*STEP", 1)
    moved = at(solved(deck_of(tmp_path, soft)), "BAR", END, "displacement", "x")
    assert moved == pytest.approx(0.02 + 8.0 / 200.0)  # four springs of 25 beside 100


# --- the rest -----------------------------------------------------------------------------------------
def test_time_delay(tmp_path: Path) -> None:
    brick = Brick("C3D8", "BAR", (L, 1.0, 1.0), (2, 1, 1))
    deck = deck_of(tmp_path, (
        f"{brick.text()}{SOFT}*AMPLITUDE, NAME=A\n0., 0., 2., 4.\n*BOUNDARY\nBAR_X0, 1, 3\n"
        "*STEP\n*STATIC\n1., 2.\n*DLOAD, AMPLITUDE=A, TIME DELAY=.5\n2, P4, -1.\n*END STEP\n"
    ))
    result = solved(deck)
    assert at(result, "BAR", (5.0, 0.5, 0.5), "stress", "xx") == pytest.approx(3.0)


def test_sections_of_several_thicknesses(tmp_path: Path) -> None:
    """Two strips in a row of 1 and 2: the force is that of the thickness of the loaded one."""
    one = Brick("CPS8", "ONE", (2.0, 1.0), (2, 1))
    two = Brick("CPS8", "TWO", (2.0, 1.0), (2, 1), (2.0, 0.0), 1000)
    same = {n: m for n, x in two.x.items() for m, y in one.x.items() if np.allclose(x, y)}
    text = two.text(section=None)
    for n, m in sorted(same.items(), reverse=True):
        text = text.replace(f"\n{n}, {two.x[n][0]:.15g}, {two.x[n][1]:.15g}, {two.x[n][2]:.15g}", "")
        for before, after in ((", ", ","), ("\n", ", "), (", ", "\n")):
            text = text.replace(f"{before}{n}{after}", f"{before}{m}{after}")
    deck = deck_of(tmp_path, (
        f"{one.text(section=None)}{text}{SOFT}*SOLID SECTION, ELSET=ONE, MATERIAL=STEEL\n1.\n"
        "*SOLID SECTION, ELSET=TWO, MATERIAL=STEEL\n2.\n*BOUNDARY\nONE_X0, 1, 1\nONE_Y0, 2, 2\nTWO_Y0, 2, 2\n"
        "*STEP\n*STATIC\n*DLOAD\n1001, P2, -10.\n*END STEP\n"
    ))
    result = solved(deck)
    assert at(result, "TWO", (4.0, 0.5), "displacement", "x") == pytest.approx(20.0 * (2.0 + 1.0) / 1000.0)


def test_contact_stiffness_goes_with_the_thickness(tmp_path: Path) -> None:
    """A pressure p on a contact of stiffness k closes it by p / k, whatever the thickness."""
    low = Brick("CPS4", "LOW", (1.0, 1.0), (1, 1))
    high = Brick("CPS4", "HIGH", (1.0, 1.0), (1, 1), (0.0, 1.0), 1000)
    thick = [brick.text(section=None) + f"*SOLID SECTION, ELSET={brick.name}, MATERIAL=STEEL\n.25\n"
             for brick in (low, high)]
    deck = deck_of(tmp_path, (
        f"{''.join(thick)}{SOFT}*SURFACE, NAME=LOW\nLOW, S3\n*SURFACE, NAME=HIGH\nHIGH, S1\n"
        f"*SURFACE INTERACTION, NAME=DRY\n{LINEAR}*CONTACT PAIR, INTERACTION=DRY\nHIGH, LOW\n"
        "*BOUNDARY\nLOW_Y0, 1, 2\nHIGH_X0, 1\n*STEP\n*STATIC\n*DLOAD\n1000, P3, 10.\n*END STEP\n"
    ))
    moved = at(solved(deck), "HIGH", (0.5, 2.0), "displacement", "y")
    assert moved == pytest.approx(-10.0 * (2.0 / 1000.0 + 1.0 / 100.0))
