"""Probabilities and quantiles of a chaos whose laws have kinks: with solved points beside it.

A polynomial cannot follow a kink. Its moments may be right to a percent while a tail is off by a factor, and
the scatter of its own samples says nothing of that. So some of the samples are solved: those from whose
values one can not be sure on which side of the limit the assembly really is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import stats
from dolfinx_frontend.uncertainty.quantities import Estimate, Quantity

__all__ = ["WitnessedQuantity"]

PER_STRATUM = 24
"""Samples that are solved of each stratum at first."""
MOST = 480
"""Samples that are solved for one probability."""
NEAR = 32
"""Samples around a quantile that are solved."""
SAFE = 4.0
"""A sample whose value is further from the limit than so many times the largest error of the chaos that was
met is on the side that the chaos says."""
FINEST = 16
"""Samples of the strata next to the limit at least."""
GROWTH = 4
DRAWS = 4000
"""Of the posterior of a probability."""


@dataclass(frozen=True, eq=False, repr=False)
class WitnessedQuantity(Quantity):
    """A quantity of a chaos, with what deterministic solves say of some of its samples.

    Attributes
    ----------
    solve
        Numbers (n,) of samples -> the quantity (n,) there by deterministic solves.
    """

    solve: Callable[[Any], Array] = field(kw_only=True)
    _known: dict[int, float] = field(kw_only=True, default_factory=dict)

    def solved(self, which: Any) -> Array:
        """The quantity (n,) at some samples, each solved once."""
        new = [k for k in dict.fromkeys(int(each) for each in which) if k not in self._known]
        if new:
            values = self.solve(np.array(new))
            self._known.update((k, float(each)) for k, each in zip(new, values, strict=True))
        return np.array([self._known[int(k)] for k in which])

    def probability(
        self,
        above: float | None = None,
        below: float | None = None,
        level: float = 0.95,
        method: Literal["wilson", "exact"] = "wilson",
    ) -> Estimate:
        """As :meth:`Quantity.probability`; the interval carries the error of the chaos, too.

        The samples are sorted by how far the chaos says they are from the limit, in strata that grow away
        from it. Of each stratum in reach of the errors of the chaos some samples are solved, at random; the
        share of these that are inside takes the place of that by the chaos (stratified sampling in two
        phases).
        """
        plain = super().probability(above, below, level, method)
        low = -math.inf if above is None else float(above)
        high = math.inf if below is None else float(below)

        def margin(values: Array) -> Array:
            return np.minimum(values - low, high - values)

        if not np.isfinite(np.minimum(self.values - low, high - self.values)).any():
            return plain  # everything is inside, whatever the values
        strata = _Strata(margin(self.values))
        rng = np.random.default_rng(0)
        budget = min(MOST, len(self.values))
        for inside in (True, False):
            for number in strata.of_side(inside):
                if strata.safe(number) or budget <= 0:
                    break
                budget -= self._look(strata, number, min(PER_STRATUM, budget), margin, rng)
        while budget > 0 and (worst := strata.least_known()) is not None:
            budget -= self._look(strata, worst, min(PER_STRATUM, budget), margin, rng)
        return strata.estimate(level, rng)

    def _look(
        self,
        strata: _Strata,
        number: int,
        count: int,
        margin: Callable[[Array], Array],
        rng: np.random.Generator,
    ) -> int:
        """Solve some more samples of a stratum; how many these are."""
        chosen = strata.draw(number, count, rng)
        if len(chosen):
            strata.learn(number, margin(self.solved(chosen)), margin(self.values[chosen]))
        return len(chosen)

    def quantile(self, q: float, level: float = 0.95) -> Estimate:
        """As :meth:`Quantity.quantile`, moved by the median error of the chaos at solved samples next to it;
        the interval is widened by the least and the largest of these errors."""
        plain = super().quantile(q, level)
        order = np.argsort(self.values, kind="stable")
        total = len(order)
        middle = q * (total - 1.0)
        reach = max(0.5 * NEAR, 2.0 * math.sqrt(total * q * (1.0 - q)))
        first, last = np.clip([middle - reach, middle + reach], 0.0, total - 1.0)
        which = order[np.unique(np.linspace(first, last, min(NEAR, total)).round().astype(int))]
        away = self.solved(which) - self.values[which]
        shift = float(np.median(away))
        return Estimate(
            plain.value + shift, plain.low + float(away.min()), plain.high + float(away.max()), level
        )


class _Strata:
    """Samples by their distance from a limit, and what solves have said of them."""

    def __init__(self, margins: Array) -> None:
        self.count = len(margins)
        order = np.argsort(-margins, kind="stable")  # inside first, the closest last
        inside = int(np.count_nonzero(margins > 0.0))
        finest = max(FINEST, min(inside, self.count - inside) // GROWTH)
        self.members: list[Any] = []
        self.inside: list[bool] = []
        self.distance: list[float] = []  # of the closest
        for side, members in ((True, order[:inside][::-1]), (False, order[inside:])):
            first, size = 0, finest
            while first < len(members):
                part = members[first : first + size]
                self.members.append(part)
                self.inside.append(side)
                self.distance.append(float(np.abs(margins[part]).min()))
                first, size = first + size, size * GROWTH
        self.looked = [0] * len(self.members)
        self.hits = [0] * len(self.members)
        self.rest: list[Any] = [None] * len(self.members)
        self.largest = 0.0  # error of the chaos
        self.wrong: Flags = np.zeros(len(self.members), dtype=bool)

    def of_side(self, inside: bool) -> list[int]:
        """Strata of a side, from the limit outwards."""
        return [k for k, side in enumerate(self.inside) if side == inside]

    def safe(self, number: int) -> bool:
        """Whether a stratum is out of reach: beyond the errors, behind one with no sample on a wrong side."""
        side = self.of_side(self.inside[number])
        place = side.index(number)
        if place < 1 or self.looked[side[place - 1]] == 0:
            return place > 0
        return bool(not self.wrong[side[place - 1]] and self.distance[number] > SAFE * self.largest)

    def draw(self, number: int, count: int, rng: np.random.Generator) -> Any:
        """More members of a stratum at random, none twice."""
        if self.rest[number] is None:
            self.rest[number] = rng.permutation(self.members[number])
        chosen, self.rest[number] = self.rest[number][:count], self.rest[number][count:]
        return chosen

    def learn(self, number: int, truth: Array, chaos: Array) -> None:
        """What solves said: margins (n,) of both."""
        self.looked[number] += len(truth)
        self.hits[number] += int(np.count_nonzero(truth > 0.0))
        error = np.abs(truth - chaos)
        self.largest = max(self.largest, float(error[np.isfinite(error)].max(initial=0.0)))
        if np.any((truth > 0.0) != self.inside[number]):
            self.wrong[number] = True

    def _spread(self, number: int) -> float:
        """Deviation that the solves leave in the whole, of a stratum."""
        looked, size = self.looked[number], len(self.members[number])
        if looked == 0 or looked == size:
            return 0.0
        law = stats.beta(self.hits[number] + 0.5, looked - self.hits[number] + 0.5)
        return size / self.count * float(law.std()) * math.sqrt(1.0 - looked / size)

    def least_known(self) -> int | None:
        """The stratum that leaves most of the doubt; None: that of the samples is larger anyway."""
        spreads = [self._spread(k) for k in range(len(self.members))]
        value = self._value()
        own = math.sqrt(max(value * (1.0 - value), 1.0 / self.count) / self.count)
        worst = int(np.argmax(spreads))
        return worst if math.hypot(*spreads) > own and spreads[worst] > 0.0 else None

    def _value(self) -> float:
        total = 0.0
        for members, inside, looked, hits in zip(
            self.members, self.inside, self.looked, self.hits, strict=True
        ):
            total += len(members) / self.count * (hits / looked if looked else float(inside))
        return total

    def estimate(self, level: float, rng: np.random.Generator) -> Estimate:
        """The probability of inside, from draws of the posterior of the share of every stratum.

        For the lower end a stratum in which nothing was inside counts as empty, for the upper end one in
        which all was inside as full: a prior would put half a sample into each of the large strata far away,
        which is more than a whole tail.
        """
        sizes = np.array([len(each) for each in self.members], dtype=np.float64)
        shares = rng.dirichlet(sizes + 1e-9, size=DRAWS) if len(sizes) > 1 else np.ones((DRAWS, 1))
        ends: list[Array] = [np.zeros(DRAWS), np.zeros(DRAWS)]
        for number, inside in enumerate(self.inside):
            looked, hits = self.looked[number], self.hits[number]
            share = float(inside) if looked == 0 else hits / looked
            known = looked == 0 or looked == len(self.members[number])
            for upper, total in enumerate(ends):
                if known or share == float(upper):
                    total += shares[:, number] * share
                else:
                    one, other = (0.5, 0.0) if upper else (0.0, 0.5)
                    chance = rng.beta(hits + one, looked - hits + other, size=DRAWS)
                    total += shares[:, number] * chance
        tail = 0.5 * (1.0 - level)
        value = self._value()
        low, high = float(np.quantile(ends[0], tail)), float(np.quantile(ends[1], 1.0 - tail))
        # where nothing is inside, the rule of three
        most = -math.log(tail) / self.count
        return Estimate(value, min(low, value), max(high, value, most), level)
