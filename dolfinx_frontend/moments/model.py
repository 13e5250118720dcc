"""What statistics know of a model: a number at points of the germs, how its contacts are there, what a point
costs. An assembly is one (:mod:`dolfinx_frontend.evaluate.model`), and so is any function in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags, largest_of
from dolfinx_frontend.uncertainty.space import RandomSpace
from dolfinx_frontend.uncertainty.statistics import (
    ErrorShare,
    MeanStd,
    Statistic,
    of_iteration,
    share_of,
    size_of,
)

__all__ = [
    "ContactStates",
    "Evaluations",
    "Guess",
    "Keep",
    "Moments",
    "PointModel",
    "confirmed",
    "so_far",
]


@dataclass(frozen=True)
class ContactStates:
    """States of a contact at n solved points.

    Attributes
    ----------
    points
        How many points the contact has.
    counts
        (n, 2) how many of these are open, and how many slip.
    pressed, apart
        Force (n,) that presses the contact together, and least gap (n,) of its points: 0 where one is closed.
    """

    points: int
    counts: Array
    pressed: Callable[[], Array]
    apart: Callable[[], Array]

    @property
    def kinds(self) -> Flags:
        """(n, 3) whether any point is open, any is closed, any slips."""
        opened, slipping = self.counts.T
        return np.stack([opened > 0.0, opened < self.points, slipping > 0.0], axis=-1)


@dataclass(frozen=True, eq=False)
class Evaluations:
    """A number at n solved points.

    Attributes
    ----------
    points
        (n, L) of the germs.
    values, error
        (n,) of the number, and estimated relative errors of the solves.
    exact
        Whether all were solved as asked, or as well as doubles allow.
    rtol
        Relative tolerance of the solves.
    seconds
        That they took.
    answer
        What the model keeps of them for its user.
    """

    points: Array
    values: Array
    error: Array
    exact: bool
    rtol: float
    seconds: float
    answer: Any = None

    @property
    def largest_error(self) -> float:
        """The largest of the errors; NaN: one is not known."""
        return largest_of(self.error)


class Guess(NamedTuple):
    """What an approximation says of the contacts: where to look, right or not."""

    points: Array  # (N, L) of the germs
    kinds: Flags  # (N, 3 contacts), as of `ContactStates.kinds`


class PointModel(Protocol):
    """A number as a function of the germs, by solves at single points."""

    @property
    def space(self) -> RandomSpace:
        """The germs."""

    @property
    def statistic(self) -> Statistic:
        """What is asked of the number."""

    @property
    def linear(self) -> bool:
        """Whether neighbours help each other and mislead none: all laws are linear."""

    @property
    def smooth(self) -> bool:
        """Whether the number is a smooth function of the germs: it is linear in the fields, too."""

    def admissible(self, points: Array) -> Flags:
        """Which points (n, L) make laws: a normal stiffness is negative far out."""

    def numbers(self, points: Array) -> Array:
        """The random numbers (k, n) of laws and loads at points (n, L)."""

    def __call__(self, points: Array, rtol: float, cold: bool = False) -> Evaluations:
        """Solve at points (n, L): from neighbour to neighbour, or each from nothing.

        Raises
        ------
        Interrupted
            Ctrl-C, or the time is over.
        """

    def joined(self, first: Evaluations, second: Evaluations) -> Evaluations:
        """The points of both in this order."""

    def contacts(self, found: Evaluations) -> Sequence[ContactStates]:
        """The contacts at solved points."""

    @property
    def may_open(self) -> bool:
        """Whether there are contacts."""

    def guess(self) -> Guess | None:
        """What an approximation says of the contacts; None: there is no approximation, or no contact."""

    def seconds(self, points: int) -> float:
        """Predicted time of so many solves, by the model of the plan: no clock decides how many are made."""


@dataclass(frozen=True, eq=False)
class Moments:
    """A statistic by solved points, with its errors.

    Attributes
    ----------
    evaluations, weights
        The points and their weights (n,) of sum 1.
    value
        The statistic.
    whole
        What an error of the deviation is relative to.
    algebraic, truncation
        Errors of the solves, and of taking so few of them.
    next_halving
        What would halve the latter.
    """

    evaluations: Evaluations
    weights: Array
    value: MeanStd
    whole: float
    algebraic: ErrorShare
    truncation: ErrorShare
    next_halving: str = ""

    def total(self, statistic: Statistic) -> float:
        """Relative error: the larger one of mean and deviation, of solves and of points together."""
        size, found = size_of(self.value, statistic), 0.0
        for each in (self.algebraic, self.truncation):
            of_std = 0.0 if each.std is None else share_of(each.std, self.whole)
            found += max(share_of(each.quantity or 0.0, size), of_std)
        return found


UNCONFIRMED = 1.5
"""Times what they say themselves that the errors of points are taken for when Ctrl-C ends the search: answers
are believed by a like margin below what is asked for, and after more points far out."""

Keep = Callable[[Moments], None]
"""Takes what is known while more points are solved."""


def confirmed(
    found: Evaluations,
    weights: Array,
    away: float,
    truncation: ErrorShare,
    value: MeanStd,
    whole: float,
    next_halving: str = "",
) -> Moments:
    """Moments by solved points, some of which were solved again: by how much they were `away`."""
    algebraic = ErrorShare(found.largest_error, away, away, "points solved again, and tighter")
    return Moments(found, weights, value, whole, algebraic, truncation, next_halving)


def so_far(
    found: Evaluations, weights: Array, truncation: ErrorShare, value: MeanStd, whole: float
) -> Moments:
    """Moments by solved points that nothing has confirmed yet, and of which none was solved again."""
    of_mean, of_std = (
        None if each is None else UNCONFIRMED * each for each in (truncation.quantity, truncation.std)
    )
    truncation = replace(truncation, quantity=of_mean, std=of_std)
    return Moments(found, weights, value, whole, of_iteration(found.largest_error, value), truncation)
