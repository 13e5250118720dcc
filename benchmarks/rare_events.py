"""Probabilities of the public set of limit states (otbenchmark), over many seeds.

``./run bench rare_events --seeds 100`` prints the table of benchmarks/measured/rare_events.md: how often
the 95 % interval of ``method="auto"`` held the probability, the mean and the scatter of the estimates
relative to it, what was reported of that scatter, and the mean and largest number of points, all counted.

``--integrate`` integrates the probabilities again, ``--drawn`` does the same with limits that are drawn by
chance, which no setting was chosen on: in the plane (curved, kinked, wavy, two joined) and in 3 to 15
variables (paraboloids with an exponential scale).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter

import common
import numpy as np
import numpy.typing as npt
from scipy import special

from tests.inference.published import PROBABILITIES, PUBLISHED, Conditions, Published, plane, sobol
from dolfinx_frontend.rare.chance import chance

HEAD = ("limit state", "variables", "probability", "held", "mean", "scatter", "cov", "points", "most", "by")
MOST = 20_000
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """What happened over the seeds."""

    name: str
    dimension: int
    truth: float
    held: int
    ratios: Array
    cov: float
    points: Array
    methods: str
    seconds: float

    def shown(self) -> list[str]:
        """As the table has it."""
        count = len(self.ratios)
        return [
            self.name, str(self.dimension), f"{self.truth:.4g}", f"{self.held} of {count}",
            f"{self.ratios.mean():.3f}", f"{100 * self.ratios.std():.0f} %", f"{100 * self.cov:.0f} %",
            f"{self.points.mean():.0f}", f"{self.points.max():.0f}", self.methods,
        ]  # fmt: skip


def measured(name: str, make: Callable[[], Conditions], truth: float, seeds: int) -> Row:
    """The intervals of so many seeds."""
    held, ratios, covs, points = 0, [], [], []
    methods: dict[str, int] = {}
    began = perf_counter()
    for seed in range(seeds):
        limit = make()
        answer = chance(limit, "auto", np.random.default_rng(seed), cov=0.1, level=0.95, most=MOST)
        found = answer.found
        held += int(found.low <= truth <= found.high)
        ratios.append(found.value / truth)
        covs.append(found.cov)
        points.append(limit.points)
        methods[answer.method] = methods.get(answer.method, 0) + 1
    every = ", ".join(sorted(methods, key=lambda each: -methods[each]))
    return Row(
        name, limit.dimension, truth, held, np.array(ratios), float(np.mean(covs)), np.array(points),
        every, perf_counter() - began,
    )  # fmt: skip


def in_the_plane(seed: int) -> Published:
    """A curved, kinked or wavy limit of two variables, or two of them."""
    drawn = np.random.default_rng(1000 + seed)
    a, c = (each / np.linalg.norm(each) for each in drawn.standard_normal((2, 2)))
    beta, other = drawn.uniform(2.0, 4.8), drawn.uniform(-0.3, 0.8)
    curved = drawn.normal(0.0, 0.15, (2, 2))
    curved = curved + curved.T
    size, often = drawn.uniform(0.1, 0.5), drawn.uniform(1.0, 4.0)

    def first(u: Array) -> Array:
        return np.asarray(beta - u @ a + 0.5 * np.einsum("ni,ij,nj->n", u, curved, u))

    def second(u: Array) -> Array:
        return np.asarray(beta + other - u @ c)

    def wavy(u: Array) -> Array:
        return np.asarray(beta - u @ a + size * np.sin(often * (a[1] * u[:, 0] - a[0] * u[:, 1])))

    kinds: list[Callable[[Array], Array]] = [
        first,
        lambda u: np.minimum(first(u), second(u)),
        lambda u: np.maximum(first(u) - 1.0, second(u) - 1.5),
        wavy,
        lambda u: np.where(first(u) > 0.0, 3.0 * first(u), first(u) ** 3 / 10.0),
    ]
    made = Published(2, (kinds[seed % len(kinds)],), lambda: plane(made, 1201))
    return made


def in_space(seed: int) -> Published:
    """A paraboloid in 3 to 15 variables."""
    drawn = np.random.default_rng(5000 + seed)
    dimension = int(drawn.integers(3, 16))
    beta, curved = drawn.uniform(2.3, 4.8), drawn.uniform(-0.12, 0.4, dimension - 1)
    turn, _ = np.linalg.qr(drawn.standard_normal((dimension, dimension)))

    def away(u: Array) -> Array:
        v = u @ turn
        return np.expm1(beta + 0.5 * v[:, 1:] ** 2 @ curved - v[:, 0])

    def given(z: Array) -> Array:
        return np.asarray(special.ndtr(-(beta + 0.5 * z**2 @ curved)))

    return Published(dimension, (away,), lambda: sobol(dimension - 1, given, 15))


def drawn_limits() -> Iterator[tuple[str, Published]]:
    """40 and 25 of them."""
    for seed in range(40):
        yield f"plane {seed}", in_the_plane(seed)
    for seed in range(25):
        yield f"space {seed}", in_space(seed)


def main() -> None:
    """Measure and report; the exit status is 1 if intervals of all together hold less than 9 of 10 times."""
    parser: argparse.ArgumentParser = common.parser("rare_events", __doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--integrate", action="store_true", help="integrate the probabilities again")
    parser.add_argument("--drawn", action="store_true", help="limits that are drawn by chance")
    options = parser.parse_args()
    rows: list[Row] = []
    if options.drawn:
        for name, limit in drawn_limits():
            truth = limit.probability()
            if 1e-8 < truth < 0.2:
                rows.append(measured(name, limit.single, truth, options.seeds))
    else:
        for name, limit in PUBLISHED.items():
            truth = limit.probability() if options.integrate else PROBABILITIES[name]
            rows.append(measured(name, limit.single, truth, options.seeds))
            if len(limit.functions) > 1:
                rows.append(measured(f"{name}, joined", limit.system, truth, options.seeds))
    print(common.markdown_table(HEAD, [each.shown() for each in rows]))
    held, count = sum(each.held for each in rows), sum(len(each.ratios) for each in rows)
    worst = min(each.held for each in rows)
    print(f"held {held} of {count}, least {worst}; {sum(each.seconds for each in rows):.0f} s")
    records = [
        {"name": r.name, "truth": r.truth, "held": r.held, "points": r.points.tolist(),
         "ratios": r.ratios.tolist(), "seconds": r.seconds}
        for r in rows
    ]  # fmt: skip
    common.write_json({"environment": common.environment(), "cases": records}, options.json)
    if held < 0.9 * count:
        sys.exit("intervals hold too seldom")


if __name__ == "__main__":
    main()
