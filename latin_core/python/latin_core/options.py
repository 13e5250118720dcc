"""Settings of the iteration; defaults are those of the C++ library."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from latin_core._core import InputError, default_options

__all__ = ["Options"]

_DEFAULT: dict[str, Any] = default_options()


@dataclass(frozen=True)
class Options:
    """How a problem is factorised and iterated on.

    Attributes
    ----------
    rtol
        Tolerance on the measure named by `criterion`.
    criterion
        ``"error"``: the estimated relative error, the larger of its shares in strain energy and in
        displacement of the interfaces; it does not depend on the search direction (``History`` in
        the C++ sources says how it is made). ``"indicator"``: the paper's, which depends on the
        search direction and may lie a thousand times below the error.
    max_iterations
        Global stages in one solve.
    max_seconds
        Of a solve, or of a whole sweep or sampling, which end then with the status ``"time_limit"`` and
        what is done so far: asked before every step.
    acceleration
        Depth of Anderson's history; 0 runs the plain iteration of 2004.
    relaxation
        mu in (0, 1]; 1 is the plain step.
    stagnation_window
        Iterations without progress after which a run ends as ``"undecided"``.
    newton
        Newton's method begins after one accelerated step less than this, where a law is nonlinear and no
        column is transformed: on the dense flexibility of the interfaces, column by column of a history,
        where that matrix and the condensed stiffnesses of the bodies keep to `memory_limit`; else with the
        whole bodies. After half of `max_iterations` it begins at the latest. The work of a step counts as
        iterations: on one of T columns 1/T of its stages. 0 or False: only where the run would give up,
        and the bodies are condensed at no great price; 1 or True: at once;
        ``"automatic"``: by the Python frontend, at once where laws with memory make the answer a matter of
        the way to it, else when the iterations so far have cost as much as the flexibility will; without
        it, 1.
    snapshots
        Earlier interface states that a sweep combines into the start of a new point; 1 takes the
        nearest one as it is.
    together
        Points of a sweep (samples of a sampling) that are tried side by side, as columns of one global
        stage, once their first iterates are answers already; 1: one after the other. Of more than some
        8 the work no longer stays in a processor's cache. Where all laws are linear, eight times as many are
        solved together, without an iteration.
    scatter
        Points of a sweep are samples: the tolerance is held by what they scatter by, too. Samplings set it.
    macro
        Coarse problem that balances the forces between the parts at every iteration: ``"linear"`` (their
        moments, too), ``"resultants"``, ``"none"``, or ``"automatic"``: linear where the accelerated
        iteration runs on several interfaces between parts.
    directions
        ``"matrix"``: interfaces that are linear and fixed but kept take the step that solves them with
        both of their parts; ``"diagonal"``: every interface takes its residual as it is;
        ``"automatic"``: matrix where the iteration is accelerated.
    operator
        ``"condensed"`` (dense factor of the Schur complement on the active unknowns),
        ``"factored"`` (sparse solves) or ``"automatic"``.
    precision
        ``"single"``: condensed global stages on the steps alone in single precision, corrected by one in
        double precision before an answer is accepted, so that every `rtol` is reached; points of a sweep
        that are tried side by side stay in double precision. ``"double"``: all in double precision.
    backend
        What solves for the inside of the parts: ``"cholmod"`` (indices of 64 bits where those of 32 cannot
        count the numbers of a factor; ``"cholmod64"``: at once), ``"mumps"``, ``"multigrid"`` (conjugate
        gradients on the linear shape functions of the same mesh, without a factor of the parts; by the Python
        frontend, for linear laws), or ``"automatic"``.
    memory_limit
        Bytes that one condensed block may take before ``"automatic"`` goes sparse, and the dense
        flexibility of Newton steps before they do without; 0: no limit.

    Raises
    ------
    InputError
        A setting out of its range, or of another type; it names both.
    """

    rtol: float = _DEFAULT["rtol"]
    criterion: Literal["error", "indicator"] = "error"
    max_iterations: int = _DEFAULT["max_iterations"]
    max_seconds: float = _DEFAULT["max_seconds"]
    acceleration: int = _DEFAULT["acceleration"]
    relaxation: float = _DEFAULT["relaxation"]
    stagnation_window: int = _DEFAULT["stagnation_window"]
    newton: int | Literal["automatic"] = "automatic"
    snapshots: int = _DEFAULT["snapshots"]
    together: int = _DEFAULT["together"]
    scatter: bool = _DEFAULT["scatter"]
    macro: Literal["automatic", "none", "resultants", "linear"] = "automatic"
    directions: Literal["automatic", "diagonal", "matrix"] = "automatic"
    operator: Literal["automatic", "condensed", "factored"] = "automatic"
    precision: Literal["double", "single"] = "double"
    backend: Literal["automatic", "cholmod", "cholmod64", "mumps", "multigrid"] = "automatic"
    memory_limit: float = _DEFAULT["memory_limit"]

    def with_(self, **changes: Any) -> Options:
        """A copy with some settings changed; InputError: no such setting, or not such a value."""
        for name in changes:
            if name not in self.__dataclass_fields__:
                raise InputError(
                    f"there is no setting {name!r}: they are {', '.join(self.__dataclass_fields__)}"
                )
        return replace(self, **changes)

    @classmethod
    def plain(cls, **changes: Any) -> Options:
        """The iteration of the 2004 paper: relaxed, not accelerated, with room for iterations.

        Without relaxation, boundary interfaces leave modes that change sign at every iteration.
        """
        settings: dict[str, Any] = {
            "acceleration": 0,
            "relaxation": 0.9,
            "max_iterations": 5000,
            "stagnation_window": 500,
        }
        return cls(**{**settings, **changes})

    def __post_init__(self) -> None:
        self._number("rtol", lambda value: 0.0 < value < 1.0, "in (0, 1)")
        self._number("relaxation", lambda value: 0.0 < value <= 1.0, "in (0, 1]")
        self._number("max_seconds", lambda value: value >= 0.0, "at 0 or above")
        self._number("memory_limit", lambda value: value >= 0.0, "at 0 or above")
        for name, least, most in _COUNTS:
            self._count(name, least, most)
        if isinstance(self.newton, bool):
            object.__setattr__(self, "newton", int(self.newton))
        if not isinstance(self.newton, str) or self.newton != "automatic":
            self._count("newton", 0, None, ", or 'automatic'")
        if not isinstance(self.scatter, bool):
            raise InputError(f"scatter is {self.scatter!r}: give True or False")
        for name, words in _WORDS.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in words:
                *first, last = map(repr, words)
                raise InputError(f"{name} {value!r} is not known: use {', '.join(first)} or {last}")

    def _number(self, name: str, holds: Callable[[float], bool], where: str) -> None:
        value = getattr(self, name)
        real = isinstance(value, (int, float, np.integer, np.floating))
        if not real or isinstance(value, bool) or not holds(value):
            raise InputError(f"{name} is {value!r}: it must lie {where}")

    def _count(self, name: str, least: int, most: int | None, other: str = "") -> None:
        value = getattr(self, name)
        whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
        if not whole or value < least or (most is not None and value > most):
            wanted = f"at least {least}" if most is None else f"in {least}..{most}"
            raise InputError(f"{name} is {value!r}: it must be a whole number, {wanted}{other}")


_COUNTS: tuple[tuple[str, int, int | None], ...] = (
    ("max_iterations", 1, None),
    ("acceleration", 0, 100),
    ("stagnation_window", 1, None),
    ("snapshots", 1, None),
    ("together", 1, None),
)
"""Settings that count: name, least, most."""

_WORDS: dict[str, tuple[str, ...]] = {
    "criterion": ("error", "indicator"),
    "precision": ("double", "single"),
    "macro": ("automatic", "none", "resultants", "linear"),
    "directions": ("automatic", "diagonal", "matrix"),
    "operator": ("automatic", "condensed", "factored"),
    "backend": ("automatic", "cholmod", "cholmod64", "mumps", "multigrid"),
}
"""Settings that are one of some words."""
