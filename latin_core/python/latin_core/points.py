"""Points of a sweep: what differs from one to the other, and what is left of each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from latin_core import _core

__all__ = ["ANSWERS", "Solved", "SweepPoints", "SweptParameter"]

ANSWERS = ("converged", "inexact")
"""Statuses of points that have an answer."""
_BY_POINT = "iterations", "error", "seconds", "status", "worst", "largest"
_BY_NAME = "forces", "jumps", "outputs"
Array = npt.NDArray[np.float64]


class Solved(NamedTuple):
    """A point that was solved, with the laws that hold there."""

    point: int
    laws: _core.Laws
    summary: _core.Summary
    state: _core.State


@dataclass(frozen=True, repr=False)
class SweptParameter:
    """A law parameter that varies over the points.

    Attributes
    ----------
    interface, parameter
        Names, as :meth:`latin_core.Structure.laws` takes them.
    pattern
        (rows * columns, r), rows may be 1: the parameter field at a point is ``pattern @ values[:, point]``,
        one block of rows after the other.
    values
        (r, points); r = 1 for a number.
    columns
        Columns of the field: the time steps of a history, or 1 if it is the same in all.
    """

    interface: str
    parameter: str
    pattern: Array
    values: Array
    columns: int = 1

    def __post_init__(self) -> None:
        for name in ("pattern", "values"):
            shape = np.shape(getattr(self, name))
            if len(shape) != 2:
                raise _core.InputError(
                    f"swept parameter {self.interface}.{self.parameter}: {name} has shape {shape}, "
                    "an array of two dimensions is wanted"
                )
            own = np.array(getattr(self, name), dtype=np.float64)  # in the order it has
            own.flags.writeable = False
            object.__setattr__(self, name, own)

    def __repr__(self) -> str:
        return f"SweptParameter({self.interface}.{self.parameter}, {self.values.shape[1]} points)"


@dataclass(repr=False)
class SweepPoints:
    """What a sweep leaves for every point; rows are points.

    Attributes
    ----------
    iterations, error, seconds
        (points,) global stages, estimated relative error, wall time; -1 and NaN where a point was
        not reached.
    status
        (points,) end of each iteration; where it was not reached, ``"interrupted"`` or ``"time_limit"``,
        or "" if it was not asked for or is missed.
    worst
        (points, 2) row and column of the largest error in ``Summary.errors`` of this rank; -1: there is none.
    largest
        (points,) that error; infinity: not known; -1: there is none.
    forces, jumps
        interface name -> (points, columns, rows): local-stage force and jump of every active interface.
    outputs
        name -> (points, ...): what the functions of `outputs` returned.
    histories
        point -> its iterations, in the order of solution (points of this run and rank only).
    order
        points in the order in which they were solved in this run, on this rank.
    states
        (points, 2, rows, columns): s and w of every point, if asked for.
    scatter
        Of samples: scatter of the body, relative to its size, whose errors are the largest relative to it.
    missed
        points of this run, of all ranks, that a check has refused: they are not kept.
    furthest
        Of the points with an answer that this rank has solved or read, the one whose interfaces move most,
        and its s and w (2, rows, columns); None: there is none.
    """

    iterations: npt.NDArray[np.int64]
    error: Array
    seconds: Array
    status: npt.NDArray[np.str_]
    forces: dict[str, Array]
    jumps: dict[str, Array]
    histories: dict[int, list[_core.Iteration]] = field(default_factory=dict)
    order: list[int] = field(default_factory=list)
    states: Array | None = None
    outputs: dict[str, Array] = field(default_factory=dict)
    worst: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    largest: Array = field(default_factory=lambda: np.zeros(0))
    scatter: float = 1.0
    missed: list[int] = field(default_factory=list)
    furthest: tuple[int, Array] | None = None

    def note(self, point: int, status: str, data: Array, traces: Array) -> None:
        """Keep the state of a point if it is the furthest so far."""
        moves = float(np.abs(traces).max(initial=0.0))
        least = -1.0 if self.furthest is None else float(np.abs(self.furthest[1][1]).max(initial=0.0))
        if status in ANSWERS and np.isfinite(moves) and moves > least:
            state = np.array([data, traces])
            state.flags.writeable = False
            self.furthest = point, state

    @classmethod
    def known(
        cls, forces: dict[str, Array], jumps: dict[str, Array], states: Array, error: Array | None = None
    ) -> SweepPoints:
        """Points whose fields and states (points, 2, rows, columns) are known without a run, with their
        errors."""
        count = len(states)
        return cls(
            iterations=np.zeros(count, dtype=np.int64),
            error=np.zeros(count) if error is None else error,
            seconds=np.zeros(count),
            status=np.full(count, "converged", dtype="<U16"),
            forces=forces,
            jumps=jumps,
            states=states,
            worst=np.full((count, 2), -1, dtype=np.int64),
            largest=np.full(count, -1.0),
        )

    def first(self, count: int) -> SweepPoints:
        """The first of the points."""
        if count == len(self.iterations):
            return self
        cut: dict[str, Any] = {name: getattr(self, name)[:count] for name in _BY_POINT}
        named: dict[str, Any] = {
            what: {name: each[:count] for name, each in getattr(self, what).items()} for what in _BY_NAME
        }
        states = None if self.states is None else self.states[:count]
        return replace(self, **cut, **named, states=states)

    def joined(self, other: SweepPoints) -> SweepPoints:
        """The points of both in this order; fields that the other has not (it was ended first) are NaN."""
        count, more = len(self.iterations), len(other.iterations)
        every: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _BY_POINT
        }
        named: dict[str, Any] = {
            what: {
                name: np.concatenate(
                    [each, getattr(other, what).get(name, np.full((more, *each.shape[1:]), np.nan))]
                )
                for name, each in getattr(self, what).items()
            }
            for what in _BY_NAME
        }
        states = None
        if self.states is not None and other.states is not None:
            states = np.concatenate([self.states, other.states])
        return SweepPoints(
            **every,
            **named,
            histories={**self.histories, **{count + k: each for k, each in other.histories.items()}},
            order=[*self.order, *(count + k for k in other.order)],
            states=states,
            scatter=min(self.scatter, other.scatter),
        )

    def __repr__(self) -> str:
        reached = self.iterations >= 0
        return (
            f"SweepPoints({int(reached.sum())} of {len(reached)} points solved, "
            f"{int(self.iterations[reached].sum())} iterations)"
        )
