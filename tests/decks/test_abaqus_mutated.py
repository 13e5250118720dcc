"""Decks that are damaged: an error with file, line and card, or the answer of what the deck now says."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.decks.lines import DeckError
from tests.decks.decks import STEEL, Brick

LINE = re.compile(r"\w+\.inp(:\d+)?: ")
WORDS = ("", "nan", "inf", "-1", "0", "1e999", "abc", "99999999999999999999", "1", "2", "-5.", "*",
         "3, 4", "1_0")


def whole_deck() -> str:
    """A deck with most keywords."""
    low = Brick("C3D8", "LOW", (4.0, 4.0, 2.0), (1, 1, 2))
    high = Brick("C3D20R", "HIGH", (4.0, 4.0, 2.0), (2, 1, 1), (0, 0, 2), 200)
    return f"""\
*HEADING
a deck
{low.text()}{high.text()}{STEEL}*EXPANSION
1.2E-5
*DENSITY
7.8E-9
*AMPLITUDE, NAME=SAW
0., 0., .5, 2., 1., 1.
*SURFACE, NAME=CUT
ELOW_Z0, S2
*NODE
900, 0., 0., 0.
901, 2., 2., 9.
*PRE-TENSION SECTION, SURFACE=CUT, NODE=900
*COUPLING, REF NODE=901, SURFACE=SHIGH_X1, CONSTRAINT NAME=C
*DISTRIBUTING
1, 3
*SURFACE INTERACTION, NAME=DRY
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
20000.
*FRICTION
.2, 1.E6
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE, ADJUST=.01
SHIGH_Z0, SLOW_Z1
*NSET, NSET=ALL
NLOW, NHIGH
*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, 293.
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Z1, 1, 3
*STEP, NAME=TIGHTEN
*STATIC
.1, 1.
*CLOAD
900, 1, -10.
901, 3, -5.
*END STEP
*STEP, INC=100
*STATIC
*BOUNDARY, FIXED
900, 1
*DLOAD, AMPLITUDE=SAW
200, P2, 3.
LOW, GRAV, 9810., 0., 0., -1.
*DSLOAD
SHIGH_Y0, P, 1.
*TEMPERATURE
ALL, 300.
*NODE PRINT, NSET=ALL
RF
*END STEP
"""


def linked_deck() -> str:
    """A deck with equations, springs, local axes, generated nodes and elements, and friction that changes."""
    low = Brick("C3D8R", "LOW", (4.0, 4.0, 2.0), (1, 1, 2))
    high = Brick("C3D20", "HIGH", (4.0, 4.0, 2.0), (2, 1, 1), (0, 0, 2), 200)
    return f"""\
{low.text()}{high.text()}{STEEL}*SYSTEM
10., 0., 0., 11., 0., 0.
10., 1., 0.
*NODE, NSET=ARC, SYSTEM=C
601, 1., 0., 0.
602, 2., 0., 0.
607, 1., 0., 1.
608, 2., 0., 1.
*NODE, NSET=END, SYSTEM=C
641, 1., 90., 0.
642, 2., 90., 0.
647, 1., 90., 1.
648, 2., 90., 1.
*SYSTEM
*NFILL, NSET=RING
ARC, END, 2, 20
*ELEMENT, TYPE=C3D8, ELSET=FIRST
601, 601, 602, 622, 621, 607, 608, 628, 627
*ELGEN, ELSET=ARCH
601, 2, 20, 1
*SOLID SECTION, ELSET=ARCH, MATERIAL=STEEL
*TRANSFORM, NSET=RING, TYPE=C
10., 0., 0., 10., 0., 1.
*ELEMENT, TYPE=DCOUP3D, ELSET=MEAN
900, 901
*ELEMENT, TYPE=SPRINGA, ELSET=ROD
901, 901, 902
*ELEMENT, TYPE=SPRING2, ELSET=STRUT
902, 602, 903
*NODE
901, 2., 2., 9.
902, 2., 2., 15.
903, 12., 0., 5.
904, 4., 2., 3.
*SPRING, ELSET=ROD
100.
*SPRING, ELSET=STRUT
3, 3
100.
*DISTRIBUTING COUPLING, ELSET=MEAN
HIGH_Z1, 1.
*ORIENTATION, NAME=ROUND, SYSTEM=CYLINDRICAL
4., 2., 3., 5., 2., 3.
1, 30.
*KINEMATIC COUPLING, REF NODE=904, ORIENTATION=ROUND
HIGH_X1, 1, 1
*EQUATION
2
LOW_X1, 1, 1., 647, 2, -.5
*SURFACE INTERACTION, NAME=DRY
*FRICTION
.2,
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE, ADJUST=.01
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
HIGH_Y0, 1, 3
ARC, 1, 3
END, 3, 3
902, 1, 3
903, 1, 6
904, 3, 6
*STEP
*STATIC
*CLOAD
901, 3, -5.
END, 1, 2.
904, 2, 3.
*END STEP
*STEP
*STATIC
*CHANGE FRICTION, INTERACTION=DRY
*FRICTION
.1,
*BOUNDARY
904, 6, 6, .01
*END STEP
"""


def stepped_deck() -> str:
    """A deck with supports that come and go, nodes that meet a face or are tied to one, gaps and a delay."""
    low = Brick("C3D8", "LOW", (4.0, 4.0, 2.0), (2, 2, 1))
    high = Brick("C3D20", "HIGH", (1.0, 1.0, 1.0), (1, 1, 1), (0.5, 0.5, 2.001), 200)
    feet = [n for n, x in high.x.items() if x[2] == 2.001 and x[0] == 0.5]
    head = [n for n, x in high.x.items() if x[2] == 3.001 and x[1] == 1.5]
    return f"""\
{low.text()}{high.text()}{STEEL}*SURFACE, NAME=FEET, TYPE=NODE
{feet[0]}
{feet[1]}
*SURFACE, NAME=SIDE, TYPE=NODE
{feet[2]}
*SURFACE INTERACTION, NAME=DRY
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
1.E6
*CONTACT PAIR, INTERACTION=DRY, TYPE=NODE TO SURFACE, ADJUST=.0005
FEET, SLOW_Z1
*TIE, NAME=GLUE
SIDE, SLOW_Z1
*NODE
901, 1.5, 1.5, 4.
*ELEMENT, TYPE=GAPUNI, ELSET=STOP
901, {head[0]}, 901
*GAP, ELSET=STOP
.01, 0., 0., 1., , 1.E6
*AMPLITUDE, NAME=SAW
0., 0., .5, 1., 1., .5
*BOUNDARY
LOW_Z0, 1, 3
901, 1, 3
HIGH_Z1, 1, 2
*STEP
*STATIC
*DSLOAD, AMPLITUDE=SAW, TIME DELAY=.25
SHIGH_Z1, P, 10.
*END STEP
*STEP
*STATIC, DIRECT
.5, 1.
*BOUNDARY, OP=NEW
LOW_Z0, 1, 3
901, 1, 3
HIGH_Z1, 3, 3, .005
HIGH_X0, 1, 1
*BOUNDARY, OP=NEW, FIXED
HIGH_Y0, 2, 2
*END STEP
*STEP
*STATIC
*BOUNDARY, OP=NEW
LOW_Z0, 1, 3
901, 1, 3
HIGH_Z1, 1, 3
*END STEP
"""


def mutated(lines: list[str], random_of: random.Random) -> list[str]:
    out = list(lines)
    k = random_of.randrange(len(out))
    how = random_of.randrange(7)
    if how == 0:
        del out[k]
    elif how == 1:
        out.insert(k, out[k])
    elif how == 2:
        j = random_of.randrange(len(out))
        out[j], out[k] = out[k], out[j]
    elif how == 3:
        words = out[k].split(",")
        words[random_of.randrange(len(words))] = random_of.choice(WORDS)
        out[k] = ",".join(words)
    elif how == 4:
        out[k] = out[k][: random_of.randrange(len(out[k]) + 1)]
    elif how == 5:
        keywords = [n for n, line in enumerate(out) if line.startswith("*")]
        n = random_of.choice(keywords)
        other = ("*NONSENSE", out[n].replace("=", "=X"), out[n] + ", X=1", out[n].split(",")[0])
        out[n] = random_of.choice(other)
    else:
        out = out[: k + 1]
    return out


def read(tmp_path: Path, lines: list[str]) -> lf.Scene:
    file = tmp_path / "deck.inp"
    file.write_text("\n".join(lines))
    return lf.read_inp(file).scene()


def test_the_whole_deck(tmp_path: Path) -> None:
    scene = read(tmp_path, whole_deck().split("\n"))
    assert set(scene.substructures) == {"LOW", "LOW#2", "HIGH"}
    deck = lf.read_inp(tmp_path / "deck.inp")
    assert deck.times == [1.0, 1.5, 2.0]
    with pytest.warns(lf.SceneWarning, match="the bolt pushes"):
        result = lf.solve(lf.assemble(scene), times=deck.times, progress=False)
    assert result.status == "converged"


def test_the_linked_deck(tmp_path: Path) -> None:
    scene = read(tmp_path, linked_deck().split("\n"))
    assert set(scene.substructures) == {"LOW", "HIGH", "ARCH"}
    deck = lf.read_inp(tmp_path / "deck.inp")
    assert deck.times == [1.0, 2.0] and {n.keyword for n in deck.notes} >= {"DISTRIBUTING COUPLING"}
    assert lf.solve(lf.assemble(scene), times=deck.times, progress=False).status == "converged"


def test_the_stepped_deck(tmp_path: Path) -> None:
    scene = read(tmp_path, stepped_deck().split("\n"))
    deck = lf.read_inp(tmp_path / "deck.inp")
    assert deck.times == [0.25, 0.75, 1.0, 1.5, 2.0, 3.0]
    assert lf.solve(lf.assemble(scene), times=deck.times, progress=False).status == "converged"


@pytest.mark.parametrize("deck", [whole_deck, linked_deck, stepped_deck])
@pytest.mark.parametrize("seed", range(10))
def test_mutated_decks(seed: int, deck: Callable[[], str], tmp_path: Path) -> None:
    lines = deck().split("\n")
    random_of = random.Random(seed)
    for _ in range(25):
        damaged = lines
        for _ in range(random_of.choice((1, 1, 1, 2, 4))):
            damaged = mutated(damaged, random_of)
        try:
            read(tmp_path, damaged)
        except DeckError as error:
            assert LINE.match(str(error)), str(error)


@pytest.mark.parametrize(("text", "words"), [
    ("*NODE\n1, 0., nan, 0.\n", ("deck.inp:2: *NODE", "'nan'")),
    ("*NODE\n-1, 0., 0., 0.\n", ("deck.inp:2", "number of the node", "'-1'")),
    ("*NODE\n1, 0., 0., 0.\n1, 1., 0., 0.\n", ("deck.inp:3", "node 1 is there already")),
    ("1, 2\n", ("deck.inp:1", "before the first keyword")),
    ("", ("no keyword",)),
    ("*NODE\n1, 0., 0., 0.\n", ("no elements",)),
    ("*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n", ("deck.inp:2", "no node 1")),
    ("*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3\n", ("deck.inp:7", "5")),
    ("*NSET, NSET=A, GENERATE\n1, 900000000000, 1\n", ("deck.inp:2", "members")),
    ("*NSET, NSET=A\nB,\n", ("deck.inp:2", "no node set 'B'")),
    ("*STEP\n*STATIC\n", ("deck.inp:1", "*END STEP is missing")),
    ("*INCLUDE, INPUT=../other.inp\n", ("deck.inp:1", "outside of the folder")),
    ("*INCLUDE, INPUT=deck.inp\n", ("*INCLUDE", "include itself")),
    ("*INCLUDE, INPUT=nothing.inp\n", ("deck.inp:1", "does not exist")),
    ("*FREQUENCY\n", ("1 card(s) are refused", "deck.inp:1: *FREQUENCY")),
])
def test_errors(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    if text.startswith("*FREQ"):
        text = whole_deck() + text
        words = (words[0],)
    file = tmp_path / "deck.inp"
    file.write_text(text)
    with pytest.raises(DeckError) as caught:
        lf.read_inp(file)
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_all_that_is_refused_is_named_at_once(tmp_path: Path) -> None:
    file = tmp_path / "deck.inp"
    text = whole_deck() + "*STEP\n*FREQUENCY\n10\n*END STEP\n*MODEL CHANGE\n*EQUATOIN\n2\n"
    file.write_text(text + "*SURFACE BEHAVIOUR\n*ELEMENT, TYPE=S8R, ELSET=S\n9001, 1, 2, 3, 4\n")
    with pytest.raises(DeckError) as caught:
        lf.read_inp(file)
    message = str(caught.value)
    for word in ("*FREQUENCY", "*MODEL CHANGE", "*EQUATOIN", "did you mean *SURFACE BEHAVIOR", "S8R"):
        assert word in message
    assert {n.kind for n in caught.value.notes} == {"refused"}
    assert all(n.line > 100 for n in caught.value.notes)


def test_includes_are_followed_below_the_folder(tmp_path: Path) -> None:
    (tmp_path / "mesh").mkdir()
    bar = Brick("C3D8", "BAR", (4.0, 1.0, 1.0), (1, 1, 1))
    (tmp_path / "mesh" / "bar.inp").write_text(bar.text())
    deck = tmp_path / "deck.inp"
    deck.write_text(f"** comment\n*INCLUDE,\n INPUT=mesh/bar.inp\n{STEEL}*BOUNDARY\nBAR_X0, 1, 3\n"
                    "*STEP\n*STATIC\n*DSLOAD\nSBAR_X1, P, -1.\n*END STEP\n")
    assert lf.read_inp(str(deck)).parts == ("BAR",)
    (tmp_path / "mesh" / "bar.inp").write_text(bar.text().replace("0, 0", "0, x", 1))
    with pytest.raises(DeckError, match=r"bar\.inp:\d+: \*NODE"):
        lf.read_inp(deck)
    with pytest.raises(lf.SceneError, match="cannot be read"):
        lf.read_inp(tmp_path)
