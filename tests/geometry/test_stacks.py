"""A few of the generated stacks of ``./run bench stacks``: no pair missed, none too many."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.geometry.stacks import judged, made


@pytest.mark.parametrize(("seed", "parts"), [(1, 6), (3, 8), (20, 5)])
def test_every_pair_is_found_and_no_other(seed: int, parts: int, tmp_path: Path) -> None:
    stack = made(seed, parts)
    verdict = judged(stack, tmp_path, seed, solve=False)
    assert not verdict.missed and not verdict.false
    assert verdict.word == ("refused" if stack.overlap else "read"), verdict.said


@pytest.mark.parametrize(
    ("seed", "parts"), [(8, 3), pytest.param(9, 8, marks=pytest.mark.night(guard="the smaller stack"))]
)
def test_a_stack_is_solved(seed: int, parts: int, tmp_path: Path) -> None:
    """Converged, or the loose part is named: in the second, plates 0.1 mm apart and a pin with play."""
    verdict = judged(made(seed, parts), tmp_path, seed)
    assert verdict.good, (verdict.word, verdict.said)
