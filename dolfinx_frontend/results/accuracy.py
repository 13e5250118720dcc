"""How wrong an answer is where: the estimated relative errors of parts, steps, mean and fluctuation, one by one.

An error is relative to what the same part does in the same step, so that nothing small hides beside something
large. The largest decides on the status.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from latin_core import Summary

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.plan.plan import Plan

__all__ = ["Accuracy", "Corrected", "accuracy_of_run", "direct_status", "remedy"]

SHOWN = 4
"""Parts of one body that a place names."""

INEXACT = "inexact"
"""Status of a direct solution that rounding has left with a larger error than asked for."""

_REMEDIES = {
    "max_iterations": "raise Options(max_iterations=...), or loosen rtol to the error that is reached",
    "stagnated": "loosen rtol to the error that is reached, or change the search direction (direction=...)",
    "diverged": "check that every part is held when contacts slip or open",
    "interrupted": "go on from here with start=result",
    INEXACT: "bring the stiffness of its springs, its material or its shape nearer to those of the other parts, or "
    "loosen rtol to the error that is reached",
}


def remedy(status: str) -> str:
    """What to do about a run that ended so; nothing if it converged."""
    return _REMEDIES.get(status, "")


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


def direct_status(accuracy: Accuracy, rtol: float) -> str:
    """``"converged"``, or ``"inexact"``."""
    return "converged" if accuracy.largest <= rtol else INEXACT


def body_name(members: Sequence[str]) -> str:
    """A body as a place."""
    more = " + ..." if len(members) > SHOWN else ""
    return "part " + " + ".join(members[:SHOWN]) + more


def accuracy_of_run(
    summary: Summary, plan: Plan, bodies: Sequence[Sequence[str]], random: bool
) -> Accuracy | None:
    """The errors of an iteration as its kernel measured them; None: it knows their maximum only.

    Parameters
    ----------
    bodies
        Names of the parts of every body.
    random
        Whether rows are mean and fluctuation, one after the other; without a chaos nothing fluctuates.
    """
    values = np.asarray(getattr(summary, "errors", ()), dtype=np.float64)
    if values.ndim != 2 or not values.size or values.shape[1] != len(bodies) or len(values) % 2:
        return None
    count = len(values) // 2
    stepped, patterned = plan.history == "steps", plan.history == "patterns"
    groups, steps, rows = [], [], []
    for step in range(count):
        label = f"step {step}" if stepped else f"load pattern {step}" if patterned and count > 1 else ""
        for kind in (0, 1) if random else (0,):
            fluctuates = "fluctuation" if kind else "mean" if random else ""
            groups.append(", ".join(word for word in (label, fluctuates) if word))
            steps.append(step)
            rows.append(2 * step + kind)
    places = tuple(map(body_name, bodies))
    return Accuracy(values[rows], tuple(groups), places, tuple(steps) if stepped else None)


def ended(status: str, error: float, place: str, rtol: float) -> str:
    """How a run ended, in a sentence; where, how far off and what to do if it did not converge."""
    if status == "converged":
        return f"converged, estimated error {shown_error(error)}" + (f" ({place})" if place else "")
    where = f" in {place}" if place else ""
    advice = remedy(status)
    return f"{status}: estimated error {shown_error(error)}{where}, asked {rtol:.1e}" + (f"; {advice}" if advice else "")
