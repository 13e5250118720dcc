"""`./run bench pair`: its statistics, and what it says of numbers and counts."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from pair.verdict import Outcome, differs, grown, judged, median_interval, turns  # noqa: E402


@pytest.mark.parametrize("n", [*range(1, 40), 101])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.99])
def test_interval_of_the_median_is_binomial(n: int, confidence: float) -> None:
    low, high = median_interval(np.random.default_rng(0).permutation(n) + 1.0, confidence)
    # values are their ranks; the number of them below the median is binomial
    k = int(low) if math.isfinite(low) else 0
    if k:
        assert low == n + 1 - high
        assert 1.0 - 2.0 * stats.binom.cdf(k - 1, n, 0.5) >= confidence
    else:
        assert high == math.inf
    if k < n // 2:  # the next narrower one has too little
        assert 1.0 - 2.0 * stats.binom.cdf(k, n, 0.5) < confidence


def test_interval_of_fifteen_is_that_of_the_tables() -> None:
    assert median_interval(np.arange(1.0, 16.0)) == (4.0, 12.0)
    assert median_interval(np.arange(1.0, 6.0)) == (-math.inf, math.inf)


def test_turns_are_balanced_and_a_drift_cancels() -> None:
    order = [state for pair in range(4) for state in turns(pair, 1)]
    assert order == ["old", "new", "new", "old"] * 2
    many = list(turns(1, 4))
    places = {state: [k for k, each in enumerate(many) if each == state] for state in ("old", "new")}
    assert sum(places["old"]) == sum(places["new"])


def test_numbers_differ_beyond_both_errors() -> None:
    assert not differs(Outcome(1.0, 1e-3), Outcome(1.0019, 1e-3))
    assert differs(Outcome(1.0, 1e-3), Outcome(1.0021, 1e-3))
    assert not differs(Outcome(1.0, 0.0), Outcome(1.0 + 1e-12, 0.0))  # rounding
    assert differs(Outcome(1.0, math.nan), Outcome(1.0, 0.0))
    assert differs(Outcome(1.0, 0.0), Outcome(math.nan, 0.0))


def test_counts_that_both_have_are_compared() -> None:
    old = {"iterations": 10.0, "modes": 4.0, "gone": 1.0}
    assert grown(old, {"iterations": 11.0, "modes": 3.0, "new": 9.0}) == {"iterations": (10.0, 11.0)}


@pytest.mark.parametrize(("factor", "slower"), [(1.0, False), (1.1, True)])
def test_a_tenth_is_seen_in_noise_of_two_percent(factor: float, slower: bool) -> None:
    noise = np.random.default_rng(3).normal(1.0, 0.02, (2, 15))
    times = {"old": noise[0], "new": factor * noise[1]}
    outcome = {"number": 1.0, "error": 0.0, "counts": {}}
    record = {s: {"cpu_s": list(t), "wall_s": list(t), "outcome": outcome} for s, t in times.items()}
    verdict = judged("bench", record)
    assert verdict.passed is not slower
    assert verdict.word == ("SLOWER" if slower else "no slower")
    assert not verdict.number_differs
    assert verdict.low <= verdict.ratio <= verdict.high


def test_few_pairs_judge_numbers_only() -> None:
    outcome = {"number": 1.0, "error": 0.0, "counts": {}}
    seconds = {"old": [1.0] * 5, "new": [9.0] * 5}
    record = {s: {"cpu_s": t, "wall_s": t, "outcome": outcome} for s, t in seconds.items()}
    verdict = judged("bench", record)
    assert verdict.passed and verdict.word == "too few pairs"
