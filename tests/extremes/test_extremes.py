"""Every extreme ends in a right answer, or in the error, warning or status that is named for it."""

from __future__ import annotations

import math

import pytest

from tests.extremes.cases import CASES, Case

SHORT = [case for case in CASES if not case.long]


def test_cases_are_told_apart() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", SHORT, ids=[case.name for case in SHORT])
def test_extreme(case: Case) -> None:
    outcome = case.measure()
    assert outcome.kind in case.expected, outcome
    assert case.words in outcome.message
    if not case.right(outcome):
        return  # an error, or a status that says that there is no answer
    assert outcome.error is not None and outcome.bound is not None
    assert math.isfinite(outcome.error) and outcome.error <= outcome.bound, outcome


def test_the_cases_bite() -> None:
    """A case whose answer is wrong fails: its closed form does not come from the solver."""
    from tests.extremes import cases

    result, error, bound = cases.stiffness(1.0, "all")
    assert error <= bound
    assert cases.stack_error(result, [1.001 * cases.PULL / cases.E]) > 1e-4
