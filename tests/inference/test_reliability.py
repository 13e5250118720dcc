"""Probabilities of rare events with true contact, against integrals; events and what they refuse."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from scipy import stats

import dolfinx_frontend as lf
from dolfinx_frontend import Event, Response, SceneError, SceneWarning, geometry, reliability
from tests.inference.joints import D_COV, K_COV, LESS_RARE, Q_COV, RARE, D, K, exact, joints, lognormal


@pytest.fixture(scope="module")
def problem() -> lf.Problem:
    return joints(LESS_RARE)


def opens(tag: str = "") -> Event:
    return Response.opening("joint" + tag) > 0.0


@pytest.mark.parametrize(("load", "printed"), [(RARE, 1.000e-6), (LESS_RARE, 4.90905e-5)])
def test_a_joint_that_opens(load: float, printed: float) -> None:
    """Contact that opens has its kink on the limit itself: the search goes through, samples are within."""
    truth = exact(load)
    assert truth == pytest.approx(printed, rel=1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = reliability(joints(load), opens())
    assert found.method == "importance" and found.cov <= 0.1
    assert found.probability.low <= truth <= found.probability.high
    assert found.first_order == pytest.approx(truth, rel=1e-3)  # the limit is a plane here
    # shares of the variance of log Q - log K - log D, and the point where Q = K D
    covs = {"K": K_COV, "D": D_COV, "Q": Q_COV}
    variances = {name: lognormal(1.0, cov)[1] ** 2 for name, cov in covs.items()}
    total = sum(variances.values())
    assert found.importance == pytest.approx({n: v / total for n, v in variances.items()}, rel=5e-3)
    point = found.design_points[0]
    assert point["Q"] == pytest.approx(point["K"] * point["D"], rel=1e-3)
    assert "design point" in repr(found) and "importance" in repr(found)


def test_any_of_three_joints() -> None:
    """The common load makes them dependent."""
    assert exact(RARE, 8) == pytest.approx(7.843e-6, rel=1e-4)
    assert exact(LESS_RARE, 8) == pytest.approx(3.67003e-4, rel=1e-5)
    truth = exact(LESS_RARE, 3)
    event = Event.any(opens(str(k)) for k in range(1, 4))
    # the three are alike: rounding says in which order they come, and so which samples are drawn
    several = [reliability(joints(LESS_RARE, 3), event, cov=0.2, level=0.99, seed=seed) for seed in range(3)]
    assert sum(each.probability.low <= truth <= each.probability.high for each in several) >= 2
    found = several[0]
    assert all(len(each.design_points) == 3 and each.cov <= 0.2 for each in several)
    # the middle of the second order bounds of the union, to 2 %
    assert found.first_order == pytest.approx(truth, rel=0.02)
    assert "any of 3: " in repr(found) and "K2 = 5" not in repr(found).splitlines()[3]


def test_two_of_two_joints_and_a_random_limit() -> None:
    """An intersection, and an event with a random number that the scene has not."""
    problem = joints(LESS_RARE, 2)
    both = reliability(problem, opens("1") & opens("2"), cov=0.2)
    (k, s), (d, t), (q, r) = lognormal(K, K_COV), lognormal(D, D_COV), lognormal(LESS_RARE, Q_COV)
    z = np.linspace(-9.0, 9.0, 20001)
    below = stats.norm.cdf((q + r * z - k - d) / math.hypot(s, t))
    truth = float(stats.norm.pdf(z) * (z[1] - z[0]) @ below**2)
    assert both.probability.low <= truth <= both.probability.high
    assert set(both.importance) == {"K1", "D1", "K2", "D2", "Q"}


def test_a_limit_that_is_random_itself(problem: lf.Problem) -> None:
    """The load against a strength that only the event knows: P(Q > R), both lognormal."""
    strength = lf.LogNormal("R", 7000.0, cov=0.1)

    def pull(block: Any) -> Any:
        return block.load("load", "z")

    found = reliability(problem, Response(pull, "pull") > strength, method="form")
    (q, r), (m, s) = lognormal(LESS_RARE, Q_COV), lognormal(7000.0, 0.1)
    assert found.probability.value == pytest.approx(stats.norm.sf((m - q) / math.hypot(r, s)), rel=1e-4)
    assert "R" in found.design_points[0]
    assert np.isnan(found.cov) and np.isnan(found.probability.low)


def test_the_same_seed_gives_the_same_answer(problem: lf.Problem) -> None:
    event = Response("bolt") > 9000.0
    first, second = (reliability(problem, event, cov=0.2, seed=5) for _ in range(2))
    assert first.probability == second.probability and first.runs == second.runs
    assert first.method == "monte carlo"  # it is not rare
    other = reliability(problem, event, cov=0.2, seed=6)
    assert other.probability != first.probability


def test_events() -> None:
    a, b, c = Response("a"), Response("b"), Response("c")
    one, two, three = a > 1.0, b < 2.0, 2.0 * c - a > 0.0
    assert (one | two).cuts == ((0,), (1,))
    assert (one & (two | three)).cuts == ((0, 1), (0, 2))
    assert ((one | two) & (one | three)).cuts == ((0,), (0, 2), (0, 1), (1, 2))
    assert (~(one | two)).cuts == ((0, 1),)
    assert (~(one & two)).cuts == ((0,), (1,))
    assert three.name == "2 * normal force of c - normal force of a > 0" or "normal force of c" in three.name
    assert len(three.conditions[0].readings) == 2
    with pytest.raises(SceneError, match="neither true nor false"):
        one and two  # type: ignore[truthy-bool]
    with pytest.raises(SceneError, match="neither true nor false"):
        0.0 < a < 1.0  # noqa: B015
    with pytest.raises(SceneError, match="compare with a finite number"):
        a > math.inf  # noqa: B015
    with pytest.raises(SceneError, match="never happens; compare with < or >"):
        a == 3.0  # noqa: B015
    assert a == a and a != Response("joint") and len({a, a}) == 1  # noqa: PLR0124
    with pytest.raises(SceneError, match="give one at least"):
        Event.any([])


def test_bad_events(problem: lf.Problem) -> None:
    def nothing(block: Any) -> Any:
        return block.load("load", "z") * np.nan

    for call, words in (
        (lambda: reliability(problem, Response("joint")), "give an event"),
        (lambda: reliability(problem, Response("joints") > 0.0), "joints"),
        (lambda: reliability(problem, Response.opening("bolt") > 0.0), "does not open; name a contact"),
        (lambda: reliability(problem, opens(), method="form5"), "unknown method"),
        (lambda: reliability(problem, opens(), cov=0.0), "cov = 0"),
        (lambda: reliability(problem, Response(nothing, "q") > 0.0), "is nan at K = "),
    ):
        with pytest.raises(SceneError, match=words):
            call()  # type: ignore[no-untyped-call]


def test_never_and_always(problem: lf.Problem) -> None:
    with pytest.warns(SceneWarning, match="did not happen at any of"):
        found = reliability(problem, Response("bolt") < -1e6, most=1000)
    assert found.probability.value == 0.0
    with pytest.warns(SceneWarning, match="happened at all of.*~event"):
        found = reliability(problem, Response("bolt") > -1e6, most=200)
    assert found.probability.value == 1.0


def test_a_quantity_that_is_flat_is_named(problem: lf.Problem) -> None:
    """The gap of a stiff joint is 0 as long as it bears."""

    def gap(block: Any) -> Any:
        return np.maximum(block.jump("joint")[..., 0].min(axis=1), 0.0)

    with pytest.warns(SceneWarning):
        found = reliability(problem, Response(gap, "gap") > 1e-9, most=2000)
    assert "take one that tells how far the event is, as Response.opening" in found.why


def rod(load: Any) -> lf.Problem:
    """A spring that is pulled by a load, and has its force."""
    scene = lf.Scene()
    box = geometry.box((10.0, 10.0, 10.0), (1, 1, 1))
    scene.substructure("a", box, lf.LinearElastic(200e3, 0.0), degree=1)
    scene.symmetry(["a:x0", "a:y0"])
    scene.interface("layer", "a:z0", lf.Elastic(normal=lf.LogNormal("k", 50.0, cov=0.1), tangential=0.0))
    scene.force("a:z1", (0.0, 0.0, load), name="load")
    return lf.assemble(scene)


@pytest.mark.parametrize(
    "load, above, exact",
    [
        (lf.Uniform("F", 0.0, 1000.0), 999.9, 1e-4),
        (lf.Uniform("F", 0.0, 1000.0), 990.0, 1e-2),
        (lf.FromDistribution("F", stats.expon(scale=100.0)), 100.0 * np.log(1e5), 1e-5),
        (lf.FromDistribution("F", stats.weibull_min(2.0, scale=100.0)), 100.0 * np.sqrt(np.log(1e6)), 1e-6),
    ],
)
def test_tails_of_loads_that_are_bounded_or_heavy(load: Any, above: float, exact: float) -> None:
    """The search for a design point goes where nothing changes any more, or numbers end."""
    found = reliability(rod(load), Response("layer") > above, level=0.999)
    assert found.probability.low <= exact <= found.probability.high and found.cov < 0.1


def test_a_search_that_meets_points_without_an_answer() -> None:
    """A first step ends where the layer is 1e10 times too soft to be solved; the search keeps away."""
    layer, load = stats.weibull_min(3.0, scale=60.0), stats.gumbel_r(900.0, 80.0)
    k, force = lf.FromDistribution("k", layer), lf.FromDistribution("F", load)
    scene = lf.Scene()
    for number, name in enumerate(("a", "b")):
        box = geometry.box((20.0, 10.0, 10.0), (1, 1, 1), (20.0 * number, 0.0, 0.0), cell="hexahedron")
        scene.substructure(name, box, lf.LinearElastic(200e3, 0.0), degree=1)
    scene.fix("a:x0")
    scene.interface("layer", "a:x1", "b:x0", lf.Elastic(normal=k, tangential=100.0))
    scene.force("b:x1", (force, 0.0, 0.0), name="pull")
    problem = lf.assemble(scene)
    found = reliability(problem, Response(lf.AtPoint(problem, "b", (40.0, 5.0, 5.0), component="x")) > 3.0)
    share = (np.arange(1_000_000) + 0.5) / 1e6
    exact = float(load.sf(300.0 / (40.0 / 200e3 + 1.0 / layer.ppf(share))).mean())
    assert found.probability.low <= exact <= found.probability.high and found.method == "importance"
    assert found.lost == 0


@pytest.mark.parametrize("modulus", [1e6, 1e9])
def test_the_design_point_of_stiff_parts(modulus: float) -> None:
    """The limit Q = K D does not know how stiff the parts are beside the joint."""
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (1, 1), origin=(x0, 0.0))
        scene.substructure(name, part, lf.LinearElastic(E=modulus, nu=0.0), degree=1)
    scene.symmetry(["left:y0", "right:y0"])
    scene.interface("joint", "left:x1", "right:x0", lf.Contact(stiffness=4e5))
    bolt = lf.Elastic(normal=lf.LogNormal("K", K, cov=K_COV), jump=-lf.LogNormal("D", D, cov=D_COV))
    scene.interface("bolt", "left:x1", "right:x0", bolt)
    scene.fix("left:x0", components=0)
    scene.traction("right:x1", (lf.LogNormal("Q", RARE, cov=Q_COV), 0.0), name="load")
    found = reliability(lf.assemble(scene), opens(), "form")
    assert found.first_order == pytest.approx(exact(RARE), rel=1e-3)
