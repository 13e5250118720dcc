"""Stacks of plates and soft sheets, pressed and sheared to and fro: joints carry what balance says.

They were drawn; kept are those at which the iteration has stagnated or took thousands of steps.
"""

from __future__ import annotations

import numpy as np
import pytest

import dolfinx_frontend as lf

Plate = tuple[float, float, float, int, int]
"""Modulus, Poisson's ratio, height, cells along the length, degree."""
STACKS: dict[str, tuple[int, float, float, float, list[Plate], list[lf.Contact]]] = {
    "soft sheets between stiff blocks": (
        3,
        80.0,
        20.0,
        19.0,
        [(210e3, 0.3, 15.0, 4, 1), (4.0, 0.3, 0.2, 4, 1), (210e3, 0.45, 15.0, 7, 1), (2e3, 0.3, 0.2, 7, 1)],
        [
            lf.Contact(friction=1.5, stiffness=1e3),
            lf.Contact(friction=1.0),
            lf.Contact(friction=1.5, stiffness=1e5),
        ],
    ),
    "slender, with little friction": (
        2,
        20.0,
        5.0,
        0.25,
        [
            (3e3, 0.45, 15.0, 32, 1),
            (3e3, 0.45, 15.0, 33, 1),
            (70e3, 0.3, 8.0, 32, 1),
            (70e3, 0.3, 15.0, 32, 1),
        ],
        [lf.Contact(friction=1.5, stiffness=1e3), lf.Contact(friction=0.3), lf.Contact(friction=0.1)],
    ),
    "a block between films, which see less of its forces than it does": (
        3,
        20.0,
        0.1,
        0.035,
        [(4.0, 0.45, 0.5, 13, 2), (3e3, 0.45, 4.0, 14, 1), (4.0, 0.45, 0.2, 12, 1)],
        [lf.Contact(friction=0.4), lf.Contact(gap=0.01, friction=1.5, stiffness=1e5)],
    ),
}
"""Dimension, length, pressure, shear, plates from below, joints between them."""


TIMES = [1.0, 2.0, 3.0, 4.0, 5.0]
PRESSURES, SHEARS = np.array([1.0, 1.0, 1.0, 0.5, 1.0]), np.array([0.0, 1.0, -1.0, 0.3, 1.0])


def problem_of(stack: str) -> lf.Problem:
    dim, length, pressure, shear, plates, joints = STACKS[stack]
    scene, height, width = lf.Scene(), 0.0, 10.0 if dim == 3 else 1.0
    up = "yz"[dim - 2]
    for k, (young, nu, h, cells, degree) in enumerate(plates):
        layers = 1 if h < 1.0 else 2
        if dim == 3:
            size, divisions = (length, width, h), (cells, max(2, cells // 2), layers)
            origin = (0.0, 0.0, height)
        else:
            size, divisions, origin = (length, h), (cells, layers), (0.0, height)
        cell = "hexahedron" if dim == 3 else "triangle"
        part = lf.geometry.box(size, divisions, origin=origin, cell=cell)
        scene.substructure(f"p{k}", part, lf.LinearElastic(young, nu), degree=degree)
        height += h
    scene.fix(f"p0:{up}0")
    for k, law in enumerate(joints):
        scene.interface(f"i{k}", f"p{k}:{up}1", f"p{k + 1}:{up}0", law)
    rest = (0.0,) * (dim - 2)
    for name, values, vector in (
        ("press", PRESSURES, (0.0, *rest, -pressure)),
        ("shear", SHEARS, (shear, *rest, 0.0)),
    ):
        ramp = lf.Amplitude([0.0, *TIMES], [0.0, *values])
        scene.traction(f"p{len(plates) - 1}:{up}1", ramp * vector, name=name)
    return lf.assemble(scene)


@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_every_joint_carries_the_load(stack: str) -> None:
    result = lf.solve(problem_of(stack), times=TIMES, progress=False)
    assert result.statuses == ("converged",) * len(TIMES)
    dim, length, pressure, shear, _, joints = STACKS[stack]
    area = length * (10.0 if dim == 3 else 1.0)
    for k in range(len(joints)):
        weights = result.problem.interfaces[f"i{k}"].weights
        carried = np.einsum("tpc,p->tc", result.force(f"i{k}"), weights)
        slip = np.linalg.norm(carried[:, 1:], axis=1)
        assert carried[:, 0] == pytest.approx(-pressure * area * PRESSURES, rel=1e-5)
        assert slip == pytest.approx(shear * area * np.abs(SHEARS), abs=1e-5 * pressure * area)


def test_newton_does_not_see_how_soft_a_sheet_is() -> None:
    """5e4 times softer than its neighbours: pressed, which takes some steps, not hundreds."""
    problem = problem_of("soft sheets between stiff blocks")
    assert lf.solve(problem, times=TIMES[:1], progress=False).summary.newton_steps <= 20
