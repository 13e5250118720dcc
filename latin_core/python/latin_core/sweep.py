"""Multiresolution: one problem, many parameter sets (paper, section 3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from latin_core import _core
from latin_core.checkpoint import Checkpoint
from latin_core.options import Options

__all__ = ["SweepPoints", "SweptParameter", "sweep"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SweptParameter:
    """A law parameter that varies over the points.

    Attributes
    ----------
    interface, parameter
        Names, as :meth:`latin_core.Problem.set_parameter` takes them.
    pattern
        (rows or 1, r): the parameter field at a point is ``pattern @ values[:, point]``.
    values
        (r, points); r = 1 for a number.
    """

    interface: str
    parameter: str
    pattern: Array
    values: Array


@dataclass
class SweepPoints:
    """What a sweep leaves for every point; rows are points.

    Attributes
    ----------
    iterations, error, seconds
        (points,) global stages, estimated relative error, wall time; -1 and NaN where a point was
        not reached.
    status
        (points,) end of each iteration, "" where not reached.
    forces, jumps
        interface name -> (points, rows): local-stage force and jump of every active interface.
    histories
        point -> its iterations, in the order of solution (points of this run only).
    order
        points in the order in which they were solved in this run.
    states
        (points, 2, rows): s and w of every point, if asked for.
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


def sweep(
    problem: _core.Problem,
    amplitudes: Array,
    parameters: Sequence[SweptParameter],
    order: Sequence[int],
    interfaces: Sequence[str],
    options: Options | None = None,
    checkpoint: str | Path | None = None,
    header: dict[str, Any] | None = None,
    progress: Callable[[int, _core.Summary], None] | None = None,
    callback: Callable[[_core.Iteration], None] | None = None,
    keep_states: bool = False,
) -> SweepPoints:
    """Solve for every point, each started from the states of its nearest solved neighbours.

    Parameters
    ----------
    amplitudes
        (loads, columns) of the load patterns.
    order
        Points in the order of solution, see :func:`latin_core.snake_order`.
    interfaces
        Active interfaces of which force and jump are kept.
    checkpoint
        File of finished points; those in it already are not solved again.
    header
        Facts that make the run what it is, compared with the file's.
    progress, callback
        Called after every point, and after every iteration.
    keep_states
        Keep s and w of every point; not with a checkpoint, which has them.

    Raises
    ------
    CheckpointError
        The file is damaged or of another run.
    KeyboardInterrupt
        Within one iteration of Ctrl-C; finished points are in the checkpoint.
    """
    options = options or Options()
    points = parameters[0].values.shape[1] if parameters else 1
    result = SweepPoints(
        iterations=np.full(points, -1, dtype=np.int64),
        error=np.full(points, np.nan),
        seconds=np.full(points, np.nan),
        status=np.full(points, "", dtype="<U16"),
        forces={},
        jumps={},
        states=np.full((points, 2, problem.rows), np.nan) if keep_states else None,
    )

    def keep(point: int, arrays: dict[str, Any]) -> None:
        result.iterations[point] = int(arrays["iterations"])
        result.error[point] = float(arrays["error"])
        result.seconds[point] = float(arrays["seconds"])
        result.status[point] = str(arrays["status"])
        for name in interfaces:
            for store, key in ((result.forces, "force"), (result.jumps, "jump")):
                values = arrays[f"{key}:{name}"]
                if name not in store:
                    store[name] = np.full((points, values.size), np.nan)
                store[name][point] = values

    known: list[_core.State] = []
    known_points: list[int] = []
    file = Checkpoint(checkpoint, header or {}) if checkpoint is not None else None
    try:
        for number, arrays in file or ():
            keep(number, arrays)
            if str(arrays["status"]) == "converged":
                known.append(_core.State(arrays["data"], arrays["traces"]))
                known_points.append(number)

        def finished(point: int, summary: _core.Summary, state: _core.State) -> None:
            arrays: dict[str, Any] = {
                "iterations": summary.iterations,
                "error": summary.error,
                "seconds": summary.history[-1].seconds if summary.history else 0.0,
                "status": summary.status,
            }
            for name in interfaces:
                force, jump = problem.local_fields(name, state)
                arrays[f"force:{name}"] = force[:, 0]
                arrays[f"jump:{name}"] = jump[:, 0]
            keep(point, arrays)
            if result.states is not None:
                result.states[point] = state.data[:, 0], state.traces[:, 0]
            result.histories[point] = summary.history
            result.order.append(point)
            if file is not None:
                file.append(point, {**arrays, "data": state.data, "traces": state.traces})
            if progress is not None:
                progress(point, summary)

        problem.sweep(
            options=options.kernel(),
            amplitudes=amplitudes,
            parameters=[
                _core.SweptParameter(
                    interface=each.interface,
                    parameter=each.parameter,
                    pattern=each.pattern,
                    values=each.values,
                )
                for each in parameters
            ],
            order=[p for p in order if result.iterations[p] < 0],
            known=known,
            known_points=known_points,
            callback=callback,
            point_callback=finished,
        )
    finally:
        if file is not None:
            file.close()
    return result
