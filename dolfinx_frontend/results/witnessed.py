"""Probabilities and quantiles of a chaos: with solved points beside it.

A polynomial cannot follow a kink, nor a tail that is longer than its own. Its moments may be right to a
percent while a tail is off by a factor, and the scatter of its own samples says nothing of that. So some of
the samples are solved: those from whose values one can not be sure on which side of the limit the assembly
really is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

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

    def __repr__(self) -> str:
        alone = Quantity(name=self.name, unit=self.unit, values=self.values, kind=self.kind)
        return f"{alone!r}\n  of the chaos alone: quantile() and probability() solve samples beside it"

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

        def look(number: int) -> int:
            chosen = strata.draw(number, min(PER_STRATUM, budget), rng)
            if len(chosen):
                strata.learn(chosen, margin(self.solved(chosen)))
            return len(chosen)

        for inside in (True, False):
            for place, number in enumerate(strata.of_side(inside)):
                if budget <= 0 or (place > 0 and not len(strata.doubt(number).members)):
                    break
                budget -= look(number)
        while budget > 0 and (worst := strata.least_known()) is not None:
            budget -= look(worst)
        return strata.estimate(level, rng)

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


class _Doubt(NamedTuple):
    """Members of a stratum on whose side the chaos has no say, how many of them were solved, and inside."""

    members: Any
    looked: int
    hits: int


def _likely(doubt: _Doubt, side: bool) -> float:
    """Chance that a sample in doubt is inside."""
    return doubt.hits / doubt.looked if doubt.looked else float(side)


class _Strata:
    """Samples by their distance from a limit, and what solves have said of them."""

    def __init__(self, margins: Array) -> None:
        self.margins, self.count = margins, len(margins)
        order = np.argsort(-margins, kind="stable")  # inside first, the closest last
        inside = int(np.count_nonzero(margins > 0.0))
        finest = max(FINEST, min(inside, self.count - inside) // GROWTH)
        self.members: list[Any] = []
        self.inside: list[bool] = []
        for side, members in ((True, order[:inside][::-1]), (False, order[inside:])):
            first, size = 0, finest
            while first < len(members):
                self.members.append(members[first : first + size])
                self.inside.append(side)
                first, size = first + size, size * GROWTH
        self.side = np.zeros(self.count)  # inside (1) or not, as far as is known
        self.side[order[:inside]] = 1.0
        self.solved: Flags = np.zeros(self.count, dtype=bool)
        self.largest = 0.0  # error of the chaos

    def of_side(self, inside: bool) -> list[int]:
        """Strata of a side, from the limit outwards."""
        return [k for k, side in enumerate(self.inside) if side == inside]

    def doubt(self, number: int) -> _Doubt:
        """What of a stratum is in reach of the errors that were met."""
        members = self.members[number]
        near = members[np.abs(self.margins[members]) <= SAFE * self.largest]
        looked = near[self.solved[near]]
        return _Doubt(near, len(looked), int(self.side[looked].sum()))

    def draw(self, number: int, count: int, rng: np.random.Generator) -> Any:
        """Members of a stratum at random that were not solved: those in doubt, if there are any."""
        for members in (self.doubt(number).members, self.members[number]):
            rest = members[~self.solved[members]]
            if len(rest):
                return rng.permutation(rest)[:count]
        return self.members[number][:0]

    def learn(self, chosen: Any, truth: Array) -> None:
        """What solves said: margins (n,) of some samples."""
        self.solved[chosen] = True
        self.side[chosen] = truth > 0.0
        error = np.abs(truth - self.margins[chosen])
        self.largest = max(self.largest, float(error[np.isfinite(error)].max(initial=0.0)))

    def least_known(self) -> int | None:
        """The stratum that leaves most of the doubt; None: that of the samples is larger anyway."""
        spreads = np.zeros(len(self.members))
        for number in range(len(self.members)):
            near, looked, hits = self.doubt(number)
            spread = float(stats.beta(hits + 0.5, looked - hits + 0.5).std())
            spreads[number] = (len(near) - looked) / self.count * spread
        value = float(self._totals(_likely))
        own = math.sqrt(max(value * (1.0 - value), 1.0 / self.count) / self.count)
        worst = int(np.argmax(spreads))
        return worst if math.hypot(*spreads) > own and spreads[worst] > 0.0 else None

    def _totals(self, chance: Callable[[_Doubt, bool], Any], shares: Any = None) -> Any:
        """Share of the samples that are inside.

        Parameters
        ----------
        chance
            Of a sample in doubt that was not solved.
        shares
            (..., strata) of these in the whole; None: those of the samples.
        """
        total: Any = 0.0
        for number, (members, side) in enumerate(zip(self.members, self.inside, strict=True)):
            doubt = self.doubt(number)
            open_ = len(doubt.members) - doubt.looked
            inside = (self.side[members].sum() + open_ * (chance(doubt, side) - side)) / len(members)
            total = total + inside * (len(members) / self.count if shares is None else shares[:, number])
        return total

    def estimate(self, level: float, rng: np.random.Generator) -> Estimate:
        """The probability of inside, from draws of the posterior of the share of every stratum.

        For the lower end a stratum in which nothing was inside counts as empty, for the upper end one in
        which all was inside as full: a prior would put half a sample into each of the large strata far away,
        which is more than a whole tail.
        """
        sizes = np.array([len(each) for each in self.members], dtype=np.float64)
        shares = rng.dirichlet(sizes + 1e-9, size=DRAWS) if len(sizes) > 1 else np.ones((DRAWS, 1))

        def end(upper: bool) -> Callable[[_Doubt, bool], Any]:
            def chance(doubt: _Doubt, _: bool) -> Any:
                if doubt.hits == doubt.looked * upper:
                    return float(upper)
                one, other = (0.5, 0.0) if upper else (0.0, 0.5)
                return rng.beta(doubt.hits + one, doubt.looked - doubt.hits + other, size=DRAWS)

            return chance

        tail = 0.5 * (1.0 - level)
        value = float(self._totals(_likely))
        low = float(np.quantile(self._totals(end(False), shares), tail))
        high = float(np.quantile(self._totals(end(True), shares), 1.0 - tail))
        # where nothing is inside, the rule of three
        most = -math.log(tail) / self.count
        return Estimate(value, min(low, value), max(high, value, most), level)
