"""Names, order of declaration, rotation and reflection of an assembly do not change what it does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import dolfinx_frontend as lf

RTOL = 1e-9
SAME = 1e-8
"""Direct answers round to 1e-12; an iteration stops at 1e-9, by an estimate good to a factor of 3."""
DIVISIONS = {"alike but turned": ((3, 2, 2), (2, 3, 2)), "finer below": ((3, 3, 2), (2, 3, 2))}


def _turn(axes: tuple[int, int, int], signs: tuple[float, float, float]) -> np.ndarray:
    turn = np.zeros((3, 3))
    turn[range(3), axes] = signs
    return turn


TURNS = [
    _turn(axes, signs)
    for axes, signs in zip(
        itertools.permutations(range(3)),
        [(1, 1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, -1), (-1, -1, -1), (-1, 1, -1)],
        strict=True,
    )
]
"""Each reorders the axes and reverses some: three rotations and three reflections."""


def _energies(
    law: lf.Elastic | lf.Perfect | lf.Contact,
    divisions: tuple[tuple[int, int, int], ...],
    names: tuple[str, str] = ("a", "b"),
    turn: np.ndarray = TURNS[0],
    upper_first: bool = False,
    supported: int = 0,
) -> np.ndarray:
    """Strain energies of both parts, the lower one first, and the displacement of the loaded face."""
    scene = lf.Scene()
    axes = np.abs(turn).argmax(axis=1)
    for k in (1, 0) if upper_first else (0, 1):
        size, origin = np.array([30.0, 30.0, 10.0]), np.array([0.0, 0.0, 10.0 * k])
        corner = np.minimum(turn @ origin, turn @ (origin + size))
        cells = tuple(np.array(divisions[k])[axes])
        part = lf.geometry.box(tuple(size[axes]), cells, origin=tuple(corner), cell="hexahedron")
        scene.substructure(names[k], part, lf.LinearElastic(210e3, 0.3), degree=1)

    def face(k: int, axis: int, end: int) -> str:
        number = int(np.flatnonzero(axes == axis)[0])
        return f"{names[k]}:{'xyz'[number]}{end if turn[number, axis] > 0 else 1 - end}"

    both = [face(0, 2, 1), face(1, 2, 0)]
    if upper_first:
        both.reverse()
    if upper_first:
        scene.traction(face(1 - supported, 0, 1), tuple(turn @ (3.0, 2.0, -3.0)), name="load")
    scene.interface("joint", *both, law)
    scene.fix(face(supported, 0, 0))
    if isinstance(law, lf.Contact):
        scene.interface("bed", face(1 - supported, 0, 0), lf.Elastic(normal=10.0, tangential=10.0))
    if not upper_first:
        scene.traction(face(1 - supported, 0, 1), tuple(turn @ (3.0, 2.0, -3.0)), name="load")
    problem = lf.assemble(scene)
    result = lf.solve(problem, progress=False, options=lf.Options(rtol=RTOL))
    assert result.status == "converged"
    found = []
    for name in names:
        u = result.displacements[name]
        moved = np.linalg.norm(u.reshape(-1, 3), axis=1).max()
        found += [u @ (problem.substructures[name].matrix @ u), moved]
    return np.array(found)


LAWS = {
    "springs": lf.Elastic(normal=1e3, tangential=300.0),
    "perfect": lf.Perfect(),
    "friction": lf.Contact(friction=0.2),
}


@pytest.mark.parametrize("divisions", DIVISIONS.values(), ids=DIVISIONS)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_names_order_and_axes(
    law: lf.Elastic, divisions: tuple[tuple[int, int, int], ...]
) -> None:
    known = _energies(law, divisions)
    assert _energies(law, divisions, ("b", "a")) == pytest.approx(known, rel=SAME)
    assert _energies(law, divisions, upper_first=True) == pytest.approx(known, rel=SAME)
    assert _energies(law, divisions, ("b", "a"), upper_first=True) == pytest.approx(known, rel=SAME)
    for turn in TURNS[1:]:
        assert _energies(law, divisions, ("z", "q"), turn) == pytest.approx(known, rel=SAME)


def test_turned_over() -> None:
    """The same scene upside down, with the parts in each other's place."""
    law, divisions = LAWS["springs"], DIVISIONS["alike but turned"]
    known = _energies(law, divisions)
    over = np.diag([1.0, 1.0, -1.0])
    assert _energies(law, divisions, ("b", "a"), over) == pytest.approx(known, rel=SAME)
