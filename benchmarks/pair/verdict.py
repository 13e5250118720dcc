"""What is said of a pair: an interval for the median of ratios, numbers that differ, counts that grew."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

CONFIDENCE = 0.95
SLOWER = 1.05
"""Ratio new over old that the upper end of the interval has to stay below."""
ROUNDING = 1e-10
"""Relative: sums of some thousand products in another order."""


def median_interval(values: Sequence[float], confidence: float = CONFIDENCE) -> tuple[float, float]:
    """An interval that holds the median of a continuous distribution with at least this confidence.

    The number of n values below the median is binomial (n, 1/2), whatever the distribution. So the order
    statistics x(k) and x(n + 1 - k) hold it with 1 - 2 P(B < k), where P(B < k) = 2^-n sum_{i < k} C(n, i); k
    is the largest with enough of it (David and Nagaraja, Order Statistics, 3rd ed. 2003, section 7.1).
    Of 15 values: the 4th and the 12th, with 96.5 %. Infinite ends: too few values (below 6 for 95 %).
    """
    ordered, n, below, k = sorted(values), len(values), 0.0, 0
    while k < n // 2 and 1.0 - 2.0 * (below + math.comb(n, k) * 0.5**n) >= confidence:
        below += math.comb(n, k) * 0.5**n
        k += 1
    return (ordered[k - 1], ordered[n - k]) if k else (-math.inf, math.inf)


def turns(pair: int, repeats: int) -> Iterator[str]:
    """Who runs when in a pair: old, new, new, old, ...; a drift of the machine's speed then cancels."""
    for k in range(pair * repeats, (pair + 1) * repeats):
        yield from (("old", "new") if k % 2 == 0 else ("new", "old"))


@dataclass(frozen=True)
class Outcome:
    """A number of an answer, what it may be off by (``error``, absolute), what the solver did for it."""

    number: float
    error: float
    counts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """Of a bench. ``ratio``: median of the processor times new over old; ``low``, ``high``: its interval."""

    name: str
    ratio: float
    low: float
    high: float
    wall_ratio: float
    old: Outcome
    new: Outcome
    old_s: float
    new_s: float
    number_differs: bool
    grown: dict[str, tuple[float, float]]

    @property
    def passed(self) -> bool:
        """Shown to be no slower, or too few pairs to say."""
        return self.high < SLOWER or math.isinf(self.high)

    @property
    def word(self) -> str:
        """For a reader; slower is what all of the interval says."""
        if math.isinf(self.high):
            return "too few pairs"
        return "no slower" if self.passed else "SLOWER" if self.low > 1.0 else "NOT SHOWN"


def differs(old: Outcome, new: Outcome) -> bool:
    """Whether two numbers are further apart than errors and rounding allow; what is not known differs."""
    allowed = old.error + new.error + ROUNDING * max(abs(old.number), abs(new.number))
    return not abs(new.number - old.number) <= allowed


def grown(old: Mapping[str, float], new: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Counts that both say and that became larger, beyond rounding."""
    return {
        name: (old[name], new[name])
        for name in old
        if name in new and new[name] > old[name] * (1.0 + ROUNDING)
    }


def judged(name: str, record: Mapping[str, Any]) -> Verdict:
    """What the times and outcomes of a bench say: ``{"old" | "new": {"cpu_s", "wall_s", "outcome"}}``."""
    old, new = (Outcome(**record[state]["outcome"]) for state in ("old", "new"))

    def ratios(of: str) -> list[float]:
        return [b / a for a, b in zip(record["old"][of], record["new"][of], strict=True)]

    def median(values: Sequence[float]) -> float:
        ordered = sorted(values)
        return 0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2])

    cpu = ratios("cpu_s")
    return Verdict(
        name,
        median(cpu),
        *median_interval(cpu),
        median(ratios("wall_s")),
        old,
        new,
        median(record["old"]["cpu_s"]),
        median(record["new"]["cpu_s"]),
        differs(old, new),
        grown(old.counts, new.counts),
    )
