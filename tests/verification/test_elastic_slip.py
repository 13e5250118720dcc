"""Elastic slip: a slider with a stiffness, against the return mapping by hand, over cycles and scatter.

A block is pressed on rigid ground and driven at the same face by a spring k_d, whose end is moved: all is
uniform, and the force follows that of K = 1 / (1 / k_d + 1 / k_t) in series with a slider of the bound mu p.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import lognorm

import dolfinx_frontend as lf

Array = npt.NDArray[np.float64]

SPRING, SLIP, FRICTION, PRESSURE, AREA = 100.0, 50.0, 0.3, 10.0, 100.0
SERIES = 1.0 / (1.0 / SPRING + 1.0 / SLIP)
BOUND = FRICTION * PRESSURE
FAR = 0.2
CYCLE = lf.Amplitude([0, 1, 3, 5], [0, 1, -1, 1])
TIMES = np.arange(0.125, 5.01, 0.125)
TIGHT = lf.Options(rtol=1e-11, max_iterations=2000)
LAW = lf.Contact(friction=FRICTION, tangential_stiffness=SLIP)


def block(law: lf.Contact, moved: Any, pressure: Any = PRESSURE, dim: int = 3) -> lf.Problem:
    """A block on the ground whose drive is moved by `moved` (in the directions along the ground)."""
    scene = lf.Scene()
    box = lf.geometry.box((10.0,) * dim, (2,) * dim, cell="hexahedron" if dim == 3 else "quadrilateral")
    scene.substructure("block", box, lf.LinearElastic(E=200e3, nu=0.0), degree=1)
    foot, top = ("block:z0", "block:z1") if dim == 3 else ("block:y0", "block:y1")
    scene.pressure(top, pressure)
    scene.interface("ground", foot, law)
    scene.interface("drive", foot, lf.Elastic(normal=1.0, tangential=SPRING, jump=moved))
    return lf.assemble(scene)


def shear_of(result: lf.Result) -> Array:
    """Mean shear at every step (T, d - 1), in the frame of the points."""
    points = result.problem.interfaces["ground"]
    return np.einsum("p,tpc->tc", points.weights, result.force("ground"))[:, 1:] / points.area


def by_hand(moved: Array, bounds: Array, stiffness: float = SERIES) -> tuple[Array, Array]:
    """Shear (T, d) and work of the slip per area (T,) by return mapping; a bound of 0 is an open contact."""
    slip, heat, shears, heats = np.zeros(moved.shape[1]), 0.0, [], []
    for at, bound in zip(moved, bounds, strict=True):
        trial = stiffness * (at - slip)
        size = float(np.linalg.norm(trial))
        shear = trial * min(1.0, bound / size) if size > 0.0 else trial
        after = at - shear / stiffness
        heat += float(shear @ (after - slip))
        slip = after
        shears.append(shear)
        heats.append(heat)
    return np.array(shears), np.array(heats)


@pytest.mark.parametrize("dim", [2, 3])
def test_loading_unloading_and_reversal(dim: int) -> None:
    jump = (0.0, FAR) if dim == 2 else (0.0, FAR, 0.0)
    result = lf.solve(block(LAW, CYCLE * jump, dim=dim), times=TIMES, options=TIGHT)
    assert result.converged
    moved = FAR * np.array([[CYCLE(t)] for t in TIMES])
    exact, heat = by_hand(moved, np.full(len(TIMES), BOUND))
    shear = shear_of(result)[:, :1]
    assert np.abs(exact).max() == BOUND and np.abs(exact[0]) < BOUND
    # the drive pulls with what the ground holds
    assert np.allclose(np.abs(shear), np.abs(exact), atol=1e-7 * BOUND)
    assert np.allclose(shear * np.sign(shear[0] * exact[0]), exact, atol=1e-7 * BOUND)
    area = result.problem.interfaces["ground"].area
    assert np.allclose(result.dissipation("ground"), area * heat, atol=1e-7 * area * heat[-1])
    # a whole cycle: 4 F (U - F / K), and the elastic slip comes back
    loop = result.dissipation("ground")[-1] - result.dissipation("ground")[TIMES == 1.0][0]
    assert loop == pytest.approx(4.0 * BOUND * (FAR - BOUND / SERIES) * area, rel=1e-7)
    # unloading from the bound is elastic
    turn = int(np.flatnonzero(TIMES == 1.0)[0])
    back = np.abs(shear[turn, 0] - shear[turn + 1, 0])
    assert back == pytest.approx(SERIES * (moved[turn, 0] - moved[turn + 1, 0]), rel=1e-7)


def test_a_path_that_turns() -> None:
    """Along one tangent, then along the other: the force turns on its bound."""
    along, across = lf.Amplitude([0, 1], [0, 1]), lf.Amplitude([1, 2, 3], [0, 1, 0])
    times = np.arange(0.25, 3.01, 0.25)
    moved = along * (0.0, FAR, 0.0) + across * (0.0, 0.0, FAR)
    result = lf.solve(block(LAW, moved), times=times, options=TIGHT)
    assert result.converged
    path = FAR * np.array([[along(t), across(t)] for t in times])
    exact, heat = by_hand(path, np.full(len(times), BOUND))
    shear = shear_of(result)
    assert np.allclose(shear * np.sign(shear[3] @ exact[3]), exact, atol=1e-7 * BOUND)
    assert np.allclose(result.dissipation("ground"), AREA * heat, atol=1e-7 * AREA * heat[-1])


@pytest.mark.filterwarnings("ignore:.*its faces (slide|move) by")
def test_a_pressure_that_falls_and_opens() -> None:
    """The bound follows the pressure; what opens forgets its elastic slip and begins anew where it closes."""
    press = lf.Amplitude([0, 1, 2, 3, 3.5, 4, 5], [1, 1, 0.3, 1, -1, 1, 1])
    move = lf.Amplitude([0, 1, 3, 4, 5], [0, 0.4, 0.4, 1, 1.3])
    times = np.arange(0.25, 5.01, 0.25)
    result = lf.solve(block(LAW, move * (0.0, FAR, 0.0), press * PRESSURE), times=times, options=TIGHT)
    assert result.converged
    points = result.problem.interfaces["ground"]
    normal = np.einsum("p,tp->t", points.weights, result.force("ground")[..., 0]) / AREA
    bounds = FRICTION * np.maximum(0.0, PRESSURE * np.array([press(t) for t in times]))
    assert np.allclose(-FRICTION * normal, bounds, atol=1e-9)
    path = FAR * np.array([[move(t)] for t in times])
    exact, heat = by_hand(path, bounds)
    shear = shear_of(result)[:, :1]
    assert np.allclose(shear * np.sign(shear[3] * exact[3]), exact, atol=1e-7 * BOUND)
    assert np.allclose(result.dissipation("ground"), AREA * heat, atol=1e-7 * AREA * heat[-1])
    closed = int(np.flatnonzero(bounds == 0.0)[-1]) + 1
    assert exact[closed, 0] == pytest.approx(SERIES * (path[closed] - path[closed - 1])[0])


def test_a_ring_on_a_shaft() -> None:
    """Axisymmetric: pressed onto a rigid shaft and pushed along it."""
    scene = lf.Scene(axisymmetric=True)
    ring = lf.geometry.box((5.0, 10.0), (2, 2), origin=(10.0, 0.0))
    scene.substructure("ring", ring, lf.LinearElastic(E=200e3, nu=0.0), degree=2)
    scene.pressure("ring:x1", PRESSURE)
    scene.interface("shaft", "ring:x0", LAW)
    scene.interface("drive", "ring:x0", lf.Elastic(tangential=SPRING, jump=CYCLE * (0.0, FAR)))
    result = lf.solve(lf.assemble(scene), times=TIMES, options=TIGHT)
    assert result.converged
    points = result.problem.interfaces["shaft"]
    assert points.area == pytest.approx(2.0 * np.pi * 10.0 * 10.0)
    normal, shear = np.einsum("p,tpc->ct", points.weights, result.force("shaft")) / points.area
    # of a ring that cannot shrink at a: 2 b^2 / (a^2 + b^2) p with nu = 0
    held = 2.0 * 15.0**2 / (10.0**2 + 15.0**2) * PRESSURE
    assert np.allclose(-normal, held, rtol=1e-2)
    exact, _ = by_hand(FAR * np.array([[CYCLE(t)] for t in TIMES]), -FRICTION * normal)
    assert np.allclose(shear * np.sign(shear[0] * exact[0, 0]), exact[:, 0], atol=1e-6 * BOUND)


def test_the_limit_is_the_law_without_it() -> None:
    drive = CYCLE * (0.0, FAR, 0.0)
    stiff, rigid = (
        lf.solve(block(law, drive), times=TIMES, options=TIGHT)
        for law in (LAW.with_(tangential_stiffness=1e12), LAW.with_(tangential_stiffness=None))
    )
    assert np.allclose(stiff.force("ground"), rigid.force("ground"), atol=1e-9 * PRESSURE)
    assert np.allclose(stiff.jump("ground"), rigid.jump("ground"), atol=1e-9 * FAR)
    assert np.allclose(stiff.dissipation("ground"), rigid.dissipation("ground"), rtol=1e-8)
    assert np.allclose(np.diff(np.log([_softer(k) for k in (1e5, 1e7, 1e9)])), -np.log(1e2), rtol=1e-2)


def _softer(stiffness: float) -> float:
    """How much less is held below the bound than by the rigid law."""
    law = LAW.with_(tangential_stiffness=stiffness)
    shear = shear_of(lf.solve(block(law, (0.0, 0.01, 0.0)), options=TIGHT, times=[1.0]))
    return float(SPRING * 0.01 - np.abs(shear).max())


SCATTER = lf.LogNormal("kt", mean=SLIP, cov=0.3)


def shear_at(f: Any) -> Any:
    force = np.asarray(f.force("ground"))
    return np.linalg.norm(force[..., 1:].mean(axis=-2), axis=-1)


def series(stiffness: Array, moved: float) -> Array:
    """Shear at random stiffnesses."""
    return np.minimum(moved / (1.0 / SPRING + 1.0 / stiffness), BOUND)


@pytest.mark.parametrize("moved", [0.02, 0.09])
def test_random_stiffness_by_samples(moved: float) -> None:
    problem = block(LAW.with_(tangential_stiffness=SCATTER), (0.0, moved, 0.0))
    samples = lf.quasi_monte_carlo(problem, 64, progress=False, options=lf.Options(rtol=1e-10))
    assert samples.converged
    drawn = samples.space.values(samples.random.source("ground", "tangential_stiffness"), samples.germs)
    exact = series(np.ravel(drawn), moved)
    assert np.allclose(shear_at(samples), exact, rtol=1e-7)
    assert (exact.max() == BOUND) == (moved == 0.09)


def test_random_stiffness_by_chaos() -> None:
    problem = block(LAW.with_(tangential_stiffness=SCATTER), (0.0, 0.02, 0.0))
    result = lf.solve(problem, chaos=4, options=lf.Options(rtol=1e-10, max_iterations=2000))
    assert result.converged and result.trusted
    found = result.quantity(shear_at, "shear", "MPa")
    sigma = np.sqrt(np.log(1.0 + 0.3**2))
    drawn = lognorm(sigma, scale=SLIP / np.sqrt(1.0 + 0.3**2)).ppf((np.arange(100_000) + 0.5) / 1e5)
    exact = series(drawn, 0.02)
    assert found.mean().value == pytest.approx(exact.mean(), rel=1e-3)
    assert found.std().value == pytest.approx(exact.std(), rel=1e-2)


def test_a_sweep_and_a_derivative() -> None:
    problem = block(LAW, (0.0, 0.02, 0.0))
    stiffnesses = np.array([10.0, 50.0, 1e3])
    surface = lf.sweep(problem, {"ground.tangential_stiffness": stiffnesses}, progress=False)
    assert np.allclose(shear_at(surface), series(stiffnesses, 0.02), rtol=1e-4)
    function = problem.function(shear_at, ["ground.tangential_stiffness"], options=lf.Options(rtol=1e-10))
    found = function.derivatives([SLIP])
    # K = k kt / (k + kt): dK / dkt = (K / kt)^2
    assert found.values[0, 0] == pytest.approx((SERIES / SLIP) ** 2 * 0.02, rel=1e-5)
    past = block(LAW, (0.0, FAR, 0.0)).function(shear_at, ["ground.tangential_stiffness"]).derivatives([SLIP])
    assert abs(past.values[0, 0]) < 1e-9 and not past.kinks.any()
