"""Friction solved to an accuracy: what meshes do to it, believed from two with different contact points.

A block on another one is pressed, pushed aside and, in some scenes, pushed back. Their references are uniform
meshes of 8 and 16 times as many cells, degree 2, carried on by 0.7 of their change, which is in `doubt`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from dolfinx_frontend import (
    Amplitude,
    Contact,
    LinearElastic,
    Resultant,
    Scene,
    SceneError,
    assemble,
    discretisation_error,
    geometry,
    solve,
)
from dolfinx_frontend.common.errors import BalanceError, SceneWarning
from dolfinx_frontend.estimate import meshes

WIDE, HIGH, MOVE = 30.0, 10.0, 0.01


class Pair(NamedTuple):
    """Two blocks, a below b."""

    young: tuple[float, float]
    nu: float
    friction: float
    cell: str
    degree: int
    cells: tuple[int, int]
    width: float
    push: float
    """Of the displacement that presses, or with `loaded` of the traction that does."""
    loaded: bool = False
    back: bool = False
    curved: bool = False
    left: float = 0.0

    @property
    def times(self) -> list[float]:
        """Pressed, pushed, pushed back."""
        return [1.0, 2.0, 3.0] if self.back else [1.0, 2.0]

    def scene(self) -> Scene:
        """The scene on its coarse meshes."""
        scene, (na, nb) = Scene(), self.cells
        steel = [LinearElastic(E=each, nu=self.nu) for each in self.young]
        lower = geometry.box((WIDE, HIGH), (na, max(2, na // 3)), (0.0, 0.0), cell=self.cell)
        wide = nb if self.width < 20.0 else 2 * nb + 1
        upper = geometry.box((self.width, HIGH), (wide, nb), (self.left, HIGH), cell=self.cell)
        scene.substructure("a", lower, steel[0], degree=self.degree)
        scene.substructure("b", upper, steel[1], degree=self.degree)
        middle, half = self.left + self.width / 2.0, self.width / 2.0

        def gap(x: Any) -> Any:
            return 1e-3 * ((x[:, 0] - middle) / half) ** 2

        law = Contact(friction=self.friction, gap=gap if self.curved else None)
        scene.interface("c", "b:y0", "a:y1", law, overlap="partial" if self.width < WIDE else "full")
        scene.fix("a:y0")
        press, aside = Amplitude([0, 1], [0, 1]), Amplitude([1, 2, 3], [0, 1, -0.6])
        if self.loaded:
            pressure = 1e-3 * min(self.young)
            scene.traction("b:y1", press * (0, -pressure) + aside * (self.push * pressure, 0))
        else:
            scene.fix("b:y1", press * (0, -MOVE) + aside * (self.push * MOVE, 0), name="grip")
        return scene


FORCE, JUMP = Resultant("c", "force", 1), Resultant("c", "jump", 1)

SLID_BACK = Pair((5979.54, 2802.06), 0.142917, 0.3, "triangle", 1, (6, 4), 30.0, 0.24, True, True, True)
"""Sticks everywhere at the end, where it has slid partly before."""
SMALL_CHANGE = Pair((11215.2, 2902.24), 0.396585, 0.1, "triangle", 2, (4, 3), 10.0, 0.416629, left=10.0)
"""The first mesh is by chance as good as the second one."""
TURNS_BACK = Pair((87753.6, 36228.1), 0.064858, 0.3, "triangle", 1, (8, 3), 10.0, 0.372431, left=10.0)
"""The third mesh goes beyond the answer, the fourth farther."""
SLIDES_ON_FOUR = Pair(
    (42684.4, 3195.82), 0.0565112, 0.1, "quadrilateral", 1, (5, 3), 10.0, 0.366887, left=10.0
)
"""All four points slide; of more points some stick."""
ONE_CHANGE = Pair((8516.0, 151429.0), 0.188461, 0.3, "triangle", 2, (5, 3), 30.0, 0.24, True, True)
"""An estimate of 1e-5, and one change of 4e-3, where 2e-2 are wrong."""


@pytest.mark.parametrize(
    ("pair", "quantity", "accuracy", "exact", "doubt"),
    [
        (SLID_BACK, JUMP, 0.05, -4.38613e-4, 6e-4),
        (SMALL_CHANGE, FORCE, 0.05, -2.4054, 2.1e-3),
        (TURNS_BACK, FORCE, 0.02, -29.5147, 8e-4),
        (SLIDES_ON_FOUR, FORCE, 0.01, -2.91099, 4e-4),
        (ONE_CHANGE, JUMP, 0.01, -1.77458e-3, 3e-4),
    ],
    ids=["slid-back", "small-change", "turns-back", "slides-on-four", "one-change"],
)
def test_what_is_said_to_be_reached_is(pair, quantity, accuracy, exact, doubt):
    """Before, the errors were 1.04 to 4.4 times what was asked, and up to 11 times what was said."""
    result = solve(pair.scene(), accuracy=accuracy, quantity=quantity, times=pair.times, progress=False)
    made = result.errors()
    off = abs(float(np.atleast_1d(quantity.value(result))[-1]) / exact - 1.0)
    assert made.reached and off <= accuracy + doubt
    assert off <= made.in_all + doubt
    counts = [result.problem.interfaces["c"].num_points, assemble(pair.scene()).interfaces["c"].num_points]
    assert counts[0] > counts[1]  # a higher degree alone is no witness


def test_a_zone_that_may_have_another_edge_has_no_bound():
    """Where points slide in part or all of them do, what is said to bound the error may be below it."""
    slides = solve(assemble(SLIDES_ON_FOUR.scene()), times=[1.0, 2.0])
    assert discretisation_error(slides, FORCE).bound is None
    sticks = solve(assemble(SLIDES_ON_FOUR._replace(push=0.01, friction=2.0).scene()), times=[1.0, 2.0])
    found = discretisation_error(sticks, FORCE)
    assert found.bound is not None and found.quantity is not None and found.quantity <= found.bound


def upright(push: float) -> Scene:
    """A block of side HIGH that is pushed at its top by `push` of what presses it: beyond 0.5 it tips.

    It ends within a cell of the lower block, which is the finer one: the outermost contact points of the
    coarse mesh stand for the part of the cell that is covered, and the block tips by them from 0.45 on.
    """
    pair = Pair((16e3, 77e3), 0.2, 0.6, "quadrilateral", 2, (12, 2), 10.0, push, True, left=2.0)
    return pair.scene()


@pytest.mark.parametrize("cells", [(3, 2), (4, 4)])
def test_a_block_tips_over_its_corner(cells: tuple[int, int]) -> None:
    """Beyond 0.5 on any mesh whose vertices are at the corners."""
    pair = Pair((16e3, 77e3), 0.2, 0.6, "quadrilateral", 2, cells, 10.0, 0.49, True)
    assert solve(assemble(pair.scene()), times=[1.0, 2.0]).converged
    with pytest.warns(SceneWarning, match="no equilibrium at step 1"):
        tipped = solve(assemble(pair._replace(push=0.51).scene()), times=[1.0, 2.0])
    assert tipped.statuses == ("converged", "no_equilibrium")


def test_a_support_that_a_coarse_mesh_has_lost_is_looked_for_on_finer_ones():
    with pytest.warns(SceneWarning, match="no equilibrium at step 1"):
        assert solve(assemble(upright(0.45)), times=[1.0, 2.0]).statuses == ("converged", "no_equilibrium")
    result = solve(upright(0.45), accuracy=0.2, quantity=JUMP, times=[1.0, 2.0], progress=False)
    assert result.converged and len(result.problem.interfaces["c"].points) > 5


OPENING = Resultant("joint", "jump")


def tall_block(side: float) -> Scene:
    """1 m x 3 m on a base, pushed with a part of what tips it."""
    scene, young, weight = Scene(), 3e10, 1e5
    concrete = LinearElastic(E=young, nu=0.2)
    base = geometry.box((3.0, 1.0), (7, 2), (-1.0, -1.0), cell="triangle")
    scene.substructure("base", base, concrete, degree=1)
    scene.substructure("tall", geometry.box((1.0, 3.0), (2, 4), cell="triangle"), concrete, degree=1)
    scene.interface("joint", "tall:y0", "base:y1", Contact(friction=0.9), overlap="partial")
    scene.fix("base:y0")
    scene.force("tall:y1", (0.0, -weight))
    scene.force("tall:y1", (side * weight / 6.0, 0.0), name="side")
    return scene


def test_a_higher_degree_may_lose_a_support_that_the_same_cells_have():
    """It has no equilibrium on the cells of the first mesh; reference: 16 and 32 times as many, degree 2."""
    exact, doubt = 5.31e-8, 0.08e-8
    result = solve(tall_block(0.5), accuracy=0.05, quantity=OPENING, times=[1.0], progress=False)
    assert result.errors().reached
    assert abs(result.mean_std(OPENING).mean - exact) < 0.05 * exact + doubt


def test_an_answer_is_not_lost_with_the_support_of_later_meshes(monkeypatch):
    """Smaller cells beside the contact are not tried here."""
    monkeypatch.setattr(meshes, "MOST_TRIES", 0)
    result = solve(tall_block(0.5), accuracy=0.05, quantity=OPENING, times=[1.0], progress=False)
    made = result.errors()
    assert result.converged and not made.reached and len(made.steps) == 1
    assert "no forces of the interfaces balance the loads" in str(made)
    with pytest.raises(BalanceError):
        solve(upright(0.45), accuracy=0.2, quantity=JUMP, times=[1.0, 2.0], progress=False)


def test_a_support_that_is_lost_on_all_meshes_is_an_error():
    with pytest.raises(SceneError, match="no equilibrium"):
        solve(upright(0.55), accuracy=0.2, quantity=JUMP, times=[1.0, 2.0], progress=False)


def test_one_mesh_alone_tells_nothing_of_an_edge():
    """A budget that leaves one mesh: its estimate would fit, and is half of the truth."""
    budget = {"max_unknowns": 70, "progress": False}
    result = solve(SLIDES_ON_FOUR.scene(), accuracy=0.04, quantity=FORCE, times=[1.0, 2.0], **budget)
    made = result.errors()
    assert len(made.steps) == 1 and not made.reached and np.isnan(made.in_all)
    assert "no other mesh confirms where 'c' slips or opens" in str(made)


def test_estimates_that_coarser_meshes_show_to_say_too_much():
    """A stiff block that is pressed and pushed to and fro.

    What its face carries along is what pushes it, on any mesh: exact by equilibrium. By the estimates alone
    2 % are not reached within 20 000 unknowns.
    """
    scene, width, press, push = Scene(), 0.674, 1e-3, 2.24e-4
    for name, size, cells, origin, young in (
        ("low", (1.57, 0.716), (7, 3), (0.0, 0.0), 1.0),
        ("up", (width, 0.789), (3, 3), (0.614, 0.716), 227.0),
    ):
        part = geometry.box(size, cells, origin=origin, cell="quadrilateral")
        scene.substructure(name, part, LinearElastic(E=young, nu=0.0), degree=1)
    scene.interface("joint", "up:y0", "low:y1", Contact(friction=0.527), overlap="partial")
    scene.fix("low:y0")
    pressed, pushed = Amplitude([0, 1], [0, 1]), Amplitude([1, 2, 3, 4], [0.0, 1.0, 0.324, -0.265])
    scene.traction("up:y1", pressed * np.array([0.0, -press]) + pushed * np.array([push, 0.0]))
    force = Resultant("joint", component=1)
    times = [1, 1.5, 2, 2.5, 3, 3.5, 4]
    given = {"accuracy": 0.02, "quantity": force, "times": times, "max_unknowns": 20_000, "progress": False}
    result = solve(scene, **given)
    made = result.errors()
    exact = -0.265 * push * width
    assert made.reached and len(made.steps) > 2
    assert abs(abs(result.mean_std(force).mean) - abs(exact)) <= made.in_all * abs(exact)
