"""Settings of the iteration. Every default of the kernel stands here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

__all__ = ["Options"]


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
    acceleration
        Depth of Anderson's history; 0 runs the plain iteration of 2004.
    relaxation
        mu in (0, 1]; 1 is the plain step.
    stagnation_window
        Iterations without progress after which a run ends as ``"stagnated"``.
    newton
        Most interface unknowns (points times components) for which Newton steps on the dense flexibility
        of the interfaces are mixed into the accelerated iteration; only where a law is nonlinear and
        every body is condensed. The work of a step counts as iterations: on one of T columns 1/T of its
        stages. 0: never.
    snapshots
        Earlier interface states that a sweep combines into the start of a new point; 1 takes the
        nearest one as it is.
    together
        Points of a sweep (samples of a sampling) that are tried side by side, as columns of one global
        stage, once their first iterates are answers already; 1: one after the other. Of more than some
        8 the work no longer stays in a processor's cache.
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
        ``"cholmod"``, ``"mumps"`` or ``"automatic"``.
    memory_limit
        Bytes that one condensed block may take before ``"automatic"`` goes sparse; 0: no limit.
    """

    rtol: float = 1e-6
    criterion: Literal["error", "indicator"] = "error"
    max_iterations: int = 500
    acceleration: int = 10
    relaxation: float = 1.0
    stagnation_window: int = 100
    newton: int = 1500
    snapshots: int = 15
    together: int = 8
    scatter: bool = False
    macro: Literal["automatic", "none", "resultants", "linear"] = "automatic"
    directions: Literal["automatic", "diagonal", "matrix"] = "automatic"
    operator: Literal["automatic", "condensed", "factored"] = "automatic"
    precision: Literal["double", "single"] = "double"
    backend: Literal["automatic", "cholmod", "mumps"] = "automatic"
    memory_limit: float = 8e9

    def with_(self, **changes: Any) -> Options:
        """A copy with some settings changed."""
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
        if self.criterion not in ("error", "indicator"):
            raise ValueError(
                f"criterion {self.criterion!r} is not known: use 'error' or 'indicator'"
            )
        if self.precision not in ("double", "single"):
            raise ValueError(f"precision {self.precision!r} is not known: use 'double' or 'single'")
        if self.macro not in ("automatic", "none", "resultants", "linear"):
            raise ValueError(
                f"macro {self.macro!r} is not known: use 'automatic', 'none', 'resultants' or 'linear'"
            )
        if self.directions not in ("automatic", "diagonal", "matrix"):
            raise ValueError(
                f"directions {self.directions!r} is not known: use 'automatic', 'diagonal' or 'matrix'"
            )
