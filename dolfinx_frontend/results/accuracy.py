"""How wrong an answer is, and where: estimated relative errors of parts, steps, mean and fluctuation.

An error is relative to what the same part does in the same step, so that nothing small hides beside something
large. The largest decides on the status.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from latin_core import STATUSES, Summary

from dolfinx_frontend.assembly.ranks import exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.common.statuses import (
    INEXACT,
    NO_EQUILIBRIUM,
    SLIDES,
    UNDECIDED,
    UNDETERMINED,
)
from dolfinx_frontend.plan.plan import Plan

__all__ = [
    "Accuracy",
    "Corrected",
    "accuracy_of_run",
    "direct_status",
    "ended",
    "known",
    "place_of",
    "remedy",
    "stronger",
    "unsolved",
]

SHOWN = 4
"""Parts of one body that a place names."""

ACCEPTABLE = 1e-2
"""Errors below this may be all that a user wants."""

NUMBERED = 10
"""Points that a sentence numbers."""

_REMEDIES = {
    "max_iterations": "allow more with Options(max_iterations=...)",
    UNDECIDED: "leave method, direction and options to solve, hold every part where contacts slip or "
    "open, or apply the loads in more steps",
    "time_limit": "allow more with max_seconds, or go on from here with start=result",
    "interrupted": "go on from here with start=result",
    SLIDES: "hold what moves, or leave such values out",
    UNDETERMINED: "hold what is free (the log names it), or leave such values out",
    NO_EQUILIBRIUM: "hold what moves, or leave such values out",
    INEXACT: "rounding leaves no more: make stiffnesses less different",
}


def stronger(laws: Iterable[Any]) -> str:
    """What laws would hold more with: ``"raise preload or friction, "``; empty: they hold by nothing."""
    every = [law for law in laws if not isinstance(law, str)]  # of a file there are names
    ways = {
        "preload": any(law.bolt for law in every),
        "friction": any(law.rubs for law in every),
        "the strength of the bond": any(law.softens for law in every),
    }
    named = " or ".join(way for way, is_there in ways.items() if is_there)
    return f"raise {named}, " if named else ""


def remedy(status: str, error: float = float("nan"), laws: Iterable[Any] = ()) -> str:
    """What to do about a run that ended so, with that error and laws; nothing if it converged."""
    if status in (SLIDES, NO_EQUILIBRIUM):
        return stronger(laws) + _REMEDIES[status]
    if status in (UNDECIDED, INEXACT) and error < ACCEPTABLE:
        return f"if that is good enough, loosen rtol to {2.0 * error:.0e}"
    return _REMEDIES.get(status, "")


def unsolved(statuses: Sequence[str]) -> tuple[str, ...]:
    """How many points ended otherwise than converged, and which, a sentence for each way."""
    found = []
    for status in STATUSES[1:]:
        which = [k for k, each in enumerate(statuses) if each == status]
        if which:
            more = f" and {len(which) - NUMBERED} more" if len(which) > NUMBERED else ""
            words = "have no equilibrium" if status == NO_EQUILIBRIUM else f"ended as {status}"
            numbers = ", ".join(map(str, which[:NUMBERED]))
            found.append(f"{len(which)} of {len(statuses)} points {words} (points {numbers}{more})")
    return tuple(found)


@dataclass(frozen=True)
class Accuracy:
    """Estimated relative errors of an answer.

    Attributes
    ----------
    values
        (groups, places), relative; NaN where nothing is known.
    groups
        What a row is: ``""``, ``"fluctuation"``, ``"step 7"``, ``"step 7, fluctuation"``, ...
    places
        What a column is: ``"part mount"``, ``"part left + right"``, ``"interface layer"``.
    steps
        (groups,) number of the time step of every row; None: rows are no time steps.
    """

    values: Array
    groups: tuple[str, ...]
    places: tuple[str, ...]
    steps: tuple[int, ...] | None = field(default=None)

    def __post_init__(self) -> None:
        locked(self)

    @property
    def largest(self) -> float:
        """The largest error that is known, or NaN."""
        known = self.values[np.isfinite(self.values)]
        if known.size < self.values.size or not known.size:
            return float("nan")
        return float(known.max())

    @property
    def place(self) -> str:
        """Where the largest error is: ``"part mount, step 7, fluctuation"``; what is not known is largest."""
        if not self.values.size:
            return ""
        ranked = np.where(np.isfinite(self.values), self.values, np.inf)
        group, place = np.unravel_index(int(np.argmax(ranked)), ranked.shape)
        return ", ".join(word for word in (self.places[place], self.groups[group]) if word)

    def by_step(self, count: int) -> Array:
        """The largest error of every time step, (count,)."""
        if self.steps is None:
            return np.full(count, self.largest)
        out = np.full(count, -np.inf)
        for step, row in zip(self.steps, self.values, strict=True):
            out[step] = max(out[step], row.max()) if np.all(np.isfinite(row)) else np.inf
        return np.where(np.isfinite(out), out, np.nan)


@dataclass(frozen=True)
class Corrected:
    """A direct solution after its corrections.

    Attributes
    ----------
    accuracy
        What they have left.
    displacements
        Part -> unknowns (n, load patterns).
    springs
        Eliminated spring -> force per area and jump (d m, load patterns), local frame.
    corrections
        How many were made.
    """

    accuracy: Accuracy
    displacements: Mapping[str, Array] = field(repr=False)
    springs: Mapping[str, tuple[Array, Array]] = field(repr=False)
    corrections: int = 0

    def __post_init__(self) -> None:
        locked(self)


def known(errors: Array) -> Array:
    """Estimated errors, NaN where a kernel that knows none says so by infinity."""
    return np.where(np.isfinite(errors), errors, np.nan)


def direct_status(accuracy: Accuracy, rtol: float) -> str:
    """``"converged"``, or ``"inexact"``."""
    return "converged" if accuracy.largest <= rtol else INEXACT


def body_name(members: Sequence[str]) -> str:
    """A body as a place."""
    more = " + ..." if len(members) > SHOWN else ""
    return "part " + " + ".join(members[:SHOWN]) + more


def accuracy_of_run(
    summary: Summary, plan: Plan, bodies: Sequence[Sequence[str]], comm: Any = None, left: float = 0.0
) -> Accuracy | None:
    """The errors of an iteration as its kernel measured them, collective; None: nothing was iterated on.

    Parameters
    ----------
    bodies
        Names of the parts of every body, one rank's after the other's.
    comm
        Of the ranks; None: there is one.
    left
        Error that the solver leaves whatever is iterated.
    """
    tables = [summary.errors] if comm is None else exchanged(comm, summary.errors)
    tables = [table for table in tables if table.size]
    if not tables:
        return None
    values = np.hstack(tables) + left
    measured = plan.measured_in_time
    kinds = len(values) // (plan.amplitudes if measured is None else measured).shape[1]
    rows = range(len(values))
    labels = tuple(group_name(plan, row, kinds) for row in rows)
    steps = tuple(row // kinds for row in rows) if plan.measured_by_step else None
    return Accuracy(values, labels, tuple(map(body_name, bodies)), steps)


def group_name(plan: Plan, row: int, kinds: int) -> str:
    """What a row of the kernel's errors is: a step or load pattern; of two kinds first the mean."""
    step, kind = divmod(row, kinds)
    label = ""
    if plan.measured_by_step:
        label = f"step {step}"
    elif plan.history == "patterns" and len(plan.patterns) > 1:
        label = f"load pattern {step}"
    fluctuates = ("mean", "fluctuation")[kind] if kinds > 1 else ""
    return ", ".join(word for word in (label, fluctuates) if word)


def place_of(plan: Plan, bodies: Sequence[Sequence[str]], worst: Sequence[int]) -> str:
    """The place of a row and a body among the errors of a point of a sweep; empty if negative: not known."""
    row, body = (int(each) for each in worst)
    if row < 0 or not 0 <= body < len(bodies):
        return ""
    return ", ".join(word for word in (body_name(bodies[body]), group_name(plan, row, 1)) if word)


def ended(
    status: str,
    error: float,
    place: str,
    rtol: float,
    iterations: int | None = None,
    laws: Iterable[Any] = (),
) -> str:
    """How a run ended, in a sentence; where, how far off and what to do if it did not converge."""
    if status == "converged":
        return f"converged, estimated error {shown_error(error)}" + (f" ({place})" if place else "")
    where = f" in {place}" if place else ""
    advice = remedy(status, error, laws)
    if status == INEXACT and error <= rtol:
        advice = "each sample is right; rounding hides a part of what they differ by"
    after = "" if iterations is None else f" after {iterations} iterations"
    text = f"{status}{after}: estimated error {shown_error(error)}{where}, asked {rtol:.1e}"
    return f"{text}; {advice}" if advice else text
