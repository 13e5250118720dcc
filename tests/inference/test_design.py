"""Design points and samplers on limits that are plain functions, against integrals and closed forms.

The public set on which OpenTURNS compares its algorithms (otbenchmark) is in published.py; all of it, over
many seeds, is measured by ``./run bench rare_events``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from dolfinx_frontend.rare.chance import chance
from dolfinx_frontend.rare.design import (
    Cut,
    DesignPoint,
    curvatures,
    design_point,
    first_order,
    second_order,
    worst,
)
from dolfinx_frontend.rare.importance import importance_sampling
from dolfinx_frontend.rare.tails import (
    directional_sampling,
    plain_sampling,
    subset_simulation,
)
from tests.inference.published import PROBABILITIES, PUBLISHED, Conditions

Array = npt.NDArray[np.float64]


class Plain(Conditions):
    """Conditions with their probability."""

    def plane(self) -> float:
        """The probability by a fine grid in two dimensions."""
        z = np.linspace(-8.503, 8.511, 1101)  # no limit runs along it
        x, y = np.meshgrid(z, z)
        inside = worst(self.margins(np.column_stack([x.ravel(), y.ravel()])), self.cuts) < 0.0
        density = stats.norm.pdf(z) * (z[1] - z[0])
        return float(density @ inside.reshape(x.shape) @ density)


def linear(beta: float, dimension: int) -> Plain:
    return Plain(dimension, lambda u: beta - u.sum(axis=1) / math.sqrt(dimension))


def found_point(limit: Plain, cut: Cut) -> DesignPoint:
    point = design_point(limit, cut, np.zeros(limit.dimension))
    assert point is not None
    return point


ROOT = math.sqrt(2.0)
PLANE: dict[str, Plain] = {
    # branches of a series system (four design points)
    "four branches": Plain(
        2,
        lambda u: 3.0 + 0.1 * (u[:, 0] - u[:, 1]) ** 2 - (u[:, 0] + u[:, 1]) / ROOT,
        lambda u: 3.0 + 0.1 * (u[:, 0] - u[:, 1]) ** 2 + (u[:, 0] + u[:, 1]) / ROOT,
        lambda u: (u[:, 0] - u[:, 1]) + 7.0 / ROOT,
        lambda u: (u[:, 1] - u[:, 0]) + 7.0 / ROOT,
    ),
    "RP22": Plain(2, lambda u: 2.5 - (u[:, 0] + u[:, 1]) / ROOT + 0.1 * (u[:, 0] - u[:, 1]) ** 2),
    "flat quartic": Plain(
        2, lambda u: 2.5 - 0.8 * (u[:, 0] - u[:, 1]) + 4.6e-6 * (u[:, 0] + u[:, 1] - 20.0) ** 4
    ),
    "steep quartic": Plain(2, lambda u: 2.0 - u[:, 1] + u[:, 0] ** 4),
    "sine": Plain(
        2,
        lambda u: np.sin(2.5 * (u[:, 0] + 1.5)) + 2.0 - ((u[:, 0] + 1.5) ** 2 + 4.0) * (u[:, 1] + 1.5) / 20.0,
    ),
    "RP55": Plain(  # frequent: islands
        2,
        lambda u: 0.2 + 0.6 * (u[:, 0] - u[:, 1]) ** 4 - (u[:, 0] - u[:, 1]) / ROOT,
        lambda u: 0.2 + 0.6 * (u[:, 0] - u[:, 1]) ** 4 + (u[:, 0] - u[:, 1]) / ROOT,
        lambda u: (u[:, 0] - u[:, 1]) + 5.0 / ROOT - 2.2,
        lambda u: (u[:, 1] - u[:, 0]) + 5.0 / ROOT - 2.2,
    ),
    "parallel": Plain(
        2, lambda u: 1.4 - 0.1 * u[:, 0] ** 2 - u[:, 1], lambda u: 2.0 - u[:, 0], cuts=[(0, 1)]
    ),
    "RP75": Plain(2, lambda u: 3.0 - u[:, 0] * u[:, 1]),  # two design points for one condition
    "parabola or line": Plain(
        2, lambda u: -u[:, 0] ** 2 + u[:, 1] + 8.0, lambda u: -0.2 * u[:, 0] + u[:, 1] + 6.0
    ),
    "kink on the limit": Plain(2, lambda u: _kinked(4.0 - u[:, 0] - 0.5 * u[:, 1])),
    "convex kink": Plain(2, lambda u: 3.5 - np.maximum(u[:, 0], u[:, 1])),
    "concave kink": Plain(2, lambda u: 2.0 - np.minimum(u[:, 0], u[:, 1])),
    "three of three": Plain(
        2,
        lambda u: 1.5 - u[:, 0],
        lambda u: 1.5 - u[:, 1],
        lambda u: 5.0 - u[:, 0] - u[:, 1],
        cuts=[(0, 1, 2)],
    ),
    "ring": Plain(2, lambda u: 4.2 - np.hypot(u[:, 0], u[:, 1])),
    "inactive": Plain(2, lambda u: 4.0 - u[:, 0]),
}


def _kinked(values: Array) -> Array:
    return np.where(values > 0.0, values, 20.0 * values)


@pytest.mark.parametrize("name", PLANE)
def test_limits_of_two_variables(name: str) -> None:
    """Whatever way is chosen, the interval (level 0.999: one seed is enough) holds the integral."""
    limit = PLANE[name]
    truth = limit.plane()
    found = chance(limit, "auto", np.random.default_rng(3), cov=0.1, level=0.999, most=30_000)
    assert found.found.low <= truth <= found.found.high, (truth, found)
    assert found.found.complete and found.found.cov <= 0.1


@pytest.mark.parametrize(
    ("beta", "dimension"), [(5.0, 10), (3.0, 100), (2.0, 1), (4.5, 2), (6.0, 5)], ids=str
)
def test_linear_limits(beta: float, dimension: int) -> None:
    """Phi(-beta), from 0.02 to 1e-9: FORM exactly, samples within their interval."""
    limit, truth = linear(beta, dimension), float(stats.norm.sf(beta))
    point = found_point(limit, (0,))
    assert point.converged and point.steps <= 3
    assert first_order(limit, [point]) == pytest.approx(truth, rel=1e-6)
    found = chance(limit, "auto", np.random.default_rng(1), cov=0.1, level=0.999, most=20_000).found
    assert found.low <= truth <= found.high


def test_a_search_does_not_cycle_at_a_kink() -> None:
    limit = PLANE["kink on the limit"]
    point = found_point(limit, (0,))
    assert point.converged
    assert point.beta == pytest.approx(4.0 / math.sqrt(1.25), rel=1e-4)
    corner = found_point(PLANE["concave kink"], (0,))
    assert corner.u == pytest.approx([2.0, 2.0], abs=1e-3)


class Rounded(Plain):
    """A limit on which rounding turns the slopes, as where some points of a face touch and some do not."""

    drawn = np.random.default_rng(4)

    def slopes(self, u: Array) -> Array:
        near = np.abs(self.margins(u[None])).max() < 0.1
        return super().slopes(u) + near * self.drawn.normal(0.0, 0.003, (1, len(u)))


def test_slopes_that_rounding_turns_on_the_limit() -> None:
    point = found_point(Rounded(5, lambda u: _kinked(4.0 - u.sum(axis=1) / math.sqrt(5.0))), (0,))
    assert point.converged
    assert point.beta == pytest.approx(4.0, rel=1e-4)  # to first order the turn does not matter


def test_an_intersection_is_held_by_several_conditions() -> None:
    limit = PLANE["three of three"]
    point = found_point(limit, (0, 1, 2))
    assert point.u == pytest.approx([2.5, 2.5], abs=1e-3)
    assert point.active == (2,)
    both = Plain(2, lambda u: 1.5 - u[:, 0], lambda u: 2.0 - u[:, 1], cuts=[(0, 1)])
    corner = found_point(both, (0, 1))
    assert corner.active == (0, 1)
    assert first_order(both, [corner]) == pytest.approx(stats.norm.sf(1.5) * stats.norm.sf(2.0), rel=1e-3)


def test_curvatures_of_a_paraboloid() -> None:
    """beta + sum kappa_i u_i^2 / 2: curvatures as given; SORM within 1 % of the integral at beta 4."""
    kappa = np.array([0.3, -0.1])

    def away(u: Array) -> Array:
        return np.asarray(4.0 + 0.5 * (u[:, 1:] ** 2 @ kappa) - u[:, 0])

    limit = Plain(3, away)
    point = found_point(limit, (0,))
    found = curvatures(limit, point)
    assert found is not None
    assert np.sort(found[0]) == pytest.approx(np.sort(kappa), abs=2e-3)
    z = np.linspace(-8.0, 8.0, 801)
    x, y = np.meshgrid(z, z)
    density = stats.norm.pdf(z) * (z[1] - z[0])
    truth = density @ stats.norm.sf(4.0 + 0.5 * (kappa[0] * x**2 + kappa[1] * y**2)) @ density
    assert second_order(point, found) == pytest.approx(truth, rel=0.02)


def test_union_of_half_spaces_is_within_its_bounds() -> None:
    """Two that are independent: 1 - (1 - p)^2."""
    limit = Plain(2, lambda u: 2.0 - u[:, 0], lambda u: 2.0 - u[:, 1])
    points = [found_point(limit, cut) for cut in limit.cuts]
    alone = stats.norm.sf(2.0)
    assert first_order(limit, points) == pytest.approx(1.0 - (1.0 - alone) ** 2, rel=1e-4)


def test_intervals_cover() -> None:
    """95 % intervals of 300 seeds: no fewer hold the truth than with a chance of 2e-3."""
    limit, truth = PLANE["RP22"], PLANE["RP22"].plane()
    point = found_point(limit, (0,))
    inside = 0
    for seed in range(300):
        found = importance_sampling(limit, [point], np.random.default_rng(seed), 0.1, 20_000, 0.95)
        inside += found.low <= truth <= found.high
    assert inside >= stats.binom.ppf(2e-3, 300, 0.95)


@pytest.mark.parametrize("sampler", [directional_sampling, subset_simulation, plain_sampling])
def test_other_samplers(sampler: Callable[..., object]) -> None:
    limit = PLANE["RP22"]
    found = sampler(limit, np.random.default_rng(5), 0.1, 200_000, 0.999)
    assert found.low <= limit.plane() <= found.high  # type: ignore[attr-defined]


def test_never_and_always_end() -> None:
    """What never happens ends with a bound, what always does with 1; a flat quantity is named."""
    never = Plain(2, lambda u: 1.0 + 0.1 * np.exp(-(u**2).sum(axis=1)))
    found = chance(never, "auto", np.random.default_rng(0), cov=0.1, level=0.95, most=20_000)
    assert found.found.value == 0.0 and found.found.points <= 20_000
    always = Plain(2, lambda u: -1.0 - u[:, 0] ** 2)
    assert chance(always, "auto", np.random.default_rng(0), cov=0.1, level=0.95, most=2000).found.value == 1.0
    flat = Plain(2, lambda u: np.where(u[:, 0] > 4.0, -1.0, 1.0))
    found = chance(flat, "auto", np.random.default_rng(0), cov=0.1, level=0.95, most=5000)
    assert "is the same at all of the first points" in found.why


INTEGRATED = ["RP28", "RP31", "RP33", "RP54", "RP55", "RP60", "RP63", "RP75", "RP77", "RP107", "RP110",
              "RP111", "R - S", "axial"]  # fmt: skip


@pytest.mark.parametrize("name", INTEGRATED)
def test_probabilities_of_the_public_set(name: str) -> None:
    """Those that one variable or a closed form gives; the others are integrated by the benchmark."""
    assert PUBLISHED[name].probability() == pytest.approx(PROBABILITIES[name], rel=1e-6)


@pytest.mark.parametrize("name", [n for n in PUBLISHED if n not in ("RP63", "RP77")])
def test_the_public_set(name: str) -> None:
    """One function each, as otbenchmark has them; level 0.999, because one seed is enough."""
    limit = PUBLISHED[name].single()
    found = chance(limit, "auto", np.random.default_rng(1), cov=0.1, level=0.999, most=20_000)
    assert found.found.low <= PROBABILITIES[name] <= found.found.high
    assert found.found.cov <= 0.1 and limit.points <= 20_000


def test_what_is_dear_ends_with_its_budget() -> None:
    """A hundred variables and no design point: an interval all the same, and no run more than allowed."""
    limit = PUBLISHED["RP63"].single()
    found = chance(limit, "auto", np.random.default_rng(1), cov=0.1, level=0.999, most=12_000).found
    assert found.low <= PROBABILITIES["RP63"] <= found.high and limit.points <= 12_000


def test_without_derivatives_subsets_do() -> None:
    """Of a function that has none."""
    limit = PUBLISHED["RP22"].single()
    limit.differentiable = False
    found = chance(limit, "auto", np.random.default_rng(1), cov=0.1, level=0.999, most=20_000)
    assert "no derivatives" in found.why and limit.slopes_made == 0
    assert found.found.low <= PROBABILITIES["RP22"] <= found.found.high
