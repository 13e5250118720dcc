"""How an answer ended: names of the kernel's statuses, ``latin_core.STATUSES`` (``docs/statuses.md``)."""

__all__ = [
    "INEXACT",
    "NO_EQUILIBRIUM",
    "RENAMED",
    "SLIDES",
    "STOPPED",
    "UNDECIDED",
    "UNDETERMINED",
]

INEXACT = "inexact"
"""Rounding has left a larger error than asked for."""

UNDECIDED = "undecided"
"""A run found no answer, nor why there is none."""

UNDETERMINED = "undetermined"
"""The laws of a point leave parts free in motions that no load drives: any place is an answer."""

SLIDES = "slides"
"""From some step of a history on, what the loads move slides on as far as it is let."""

NO_EQUILIBRIUM = "no_equilibrium"
"""No forces of the interfaces balance the loads, of a history from some step on."""

RENAMED = {"stagnated": UNDECIDED, "diverged": UNDECIDED}
"""Words of saved answers of before, as they are now."""

STOPPED = ("time_limit", "interrupted")
"""What its user has ended."""
