"""Multiresolution: one structure, many parameter sets (paper, section 3)."""

from __future__ import annotations

import logging
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from latin_core import _core
from latin_core.checkpoint import Checkpoint, CheckpointError, PointFile, edited, wrong_array
from latin_core.options import Options
from latin_core.points import Solved, SweepPoints, SweptParameter
from latin_core.shares import Shares, split

__all__ = ["sweep"]

_PILOTS, _PILOTS_OF_SAMPLES = 4, 16
"""Points that all ranks solve first; the scatter of samples is that of these."""
_CHECKED, _CHECKED_BYTES = 256, 64e6
"""Points, and bytes of their states, that are checked together."""
_log = logging.getLogger(__name__)
Array = npt.NDArray[np.float64]


def _check_outputs(outputs: Iterable[str]) -> None:
    clash = [name for name in outputs if ":" in name]
    if clash:
        raise ValueError(f"output {clash[0]!r}: a name without a colon is wanted")


def _nothing_yet(points: int, states: tuple[int, int] | None) -> SweepPoints:
    """A sweep of which no point was reached; `states`: rows and columns of those that are kept."""
    return SweepPoints(
        iterations=np.full(points, -1, dtype=np.int64),
        error=np.full(points, np.nan),
        seconds=np.full(points, np.nan),
        status=np.full(points, "", dtype="<U16"),
        forces={},
        jumps={},
        worst=np.full((points, 2), -1, dtype=np.int64),
        largest=np.full(points, -1.0),
        states=None if states is None else np.full((points, 2, *states), np.nan),
    )


def _worst(errors: Array) -> tuple[npt.NDArray[np.int64], float]:
    """Place (2,) of the largest error of a table, and that error; what is not known is larger than any."""
    if not errors.size:
        return np.full(2, -1, dtype=np.int64), -1.0
    ranked = np.where(np.isfinite(errors), errors, np.inf)
    place = np.unravel_index(int(np.argmax(ranked)), ranked.shape)
    return np.array(place, dtype=np.int64), float(ranked[place])


def _check_points(name: str, numbers: Iterable[int], points: int) -> None:
    for number in numbers:
        if not 0 <= operator.index(number) < points:
            raise _core.InputError(f"{name}: point {number} is none of {points} (0 to {points - 1})")


Shape = tuple[int, ...]
Fields = dict[str, tuple[Array, Array]]
"""Interface -> its local-stage force and jump, (rows, columns) each."""


@dataclass(frozen=True)
class _Keeper:
    """Writes what a point leaves to its place in the result: numbers, fields of `interfaces`, `outputs`."""

    result: SweepPoints
    interfaces: Sequence[str]
    outputs: Mapping[str, Callable[[int, Fields], npt.ArrayLike]]

    def finish(self, solved: Solved, fields: Fields, more: float) -> dict[str, Any]:
        """Keep a point that was solved in this run; what it leaves, by name.

        `more` is what a check adds to its error.
        """
        point, _, summary, state = solved
        _log.debug("point %d: %s after %d iterations", point, summary.status, summary.iterations)
        arrays = self._measured(point, summary, fields)
        arrays["error"] += more
        self.keep(point, arrays)
        self.result.scatter = summary.scatter
        self.result.note(point, summary.status, state.data, state.traces)
        if self.result.states is not None:
            self.result.states[point] = state.data, state.traces
        self.result.histories[point] = summary.history
        self.result.order.append(point)
        return arrays

    def _measured(self, point: int, summary: _core.Summary, fields: Fields) -> dict[str, Any]:
        worst, largest = _worst(summary.errors)
        arrays: dict[str, Any] = {
            "iterations": summary.iterations,
            "error": summary.error,
            "seconds": summary.history[-1].seconds if summary.history else 0.0,
            "status": summary.status,
            "worst": worst,
            "largest": largest,
        }
        for name in self.interfaces:
            arrays[f"force:{name}"], arrays[f"jump:{name}"] = (each.T for each in fields[name])
        for name, function in self.outputs.items():
            found = np.asarray(function(point, fields))
            if found.dtype.kind not in "biuf":  # a complex number would lose a part of it
                raise _core.InputError(f"outputs: {name!r} returned {found!r}: return real numbers")
            arrays[f"output:{name}"] = found.astype(np.float64)
        return arrays

    def read(
        self, file: PointFile | None, shapes: Callable[[], dict[str, Shape]]
    ) -> Iterator[tuple[int, _core.State]]:
        """Keep the points of a checkpoint; numbers and states of those that converged.

        `shapes` has those of the state and the fields of a point.
        """
        points = len(self.result.iterations)
        if file is None:
            return
        layout: dict[str, tuple[str, Shape | None]] = {}
        for number, arrays in file:
            layout = layout or self._layout(shapes())
            with file.agreement():
                if not 0 <= number < points:
                    raise CheckpointError(
                        f"{file.path} holds point {number}, this sweep has {points} points"
                    )
                for name, (kinds, shape) in layout.items():
                    wrong = wrong_array(arrays, name, kinds, shape)
                    if wrong:
                        raise edited(file.path, number, wrong)
                for key in (f"output:{name}" for name in self.outputs):
                    layout[key] = ("f", arrays[key].shape)
                self.keep(number, arrays)
                converged = str(arrays["status"]) == "converged"
                if converged and not all(np.isfinite(arrays[name]).all() for name in ("data", "traces")):
                    raise edited(file.path, number, "it is converged, and its state is not finite")
            if converged:
                self.result.note(number, "converged", arrays["data"], arrays["traces"])
                yield number, _core.State(arrays["data"], arrays["traces"])

    def _layout(self, shapes: Mapping[str, Shape]) -> dict[str, tuple[str, Shape | None]]:
        """Kinds and shape of what a checkpoint has of every point; None: any shape."""
        layout: dict[str, tuple[str, Shape | None]]
        layout = dict.fromkeys(("error", "seconds", "largest"), ("f", ()))
        layout |= {"iterations": ("iu", ()), "status": ("U", ()), "worst": ("iu", (2,))}
        layout |= {name: ("f", shape) for name, shape in shapes.items()}
        return layout | {f"output:{name}": ("f", None) for name in self.outputs}

    def keep(self, point: int, arrays: Mapping[str, Any]) -> None:
        """What a point has left, in memory or in a checkpoint."""
        result = self.result
        result.iterations[point] = int(arrays["iterations"])
        result.error[point] = float(arrays["error"])
        result.seconds[point] = float(arrays["seconds"])
        result.status[point] = str(arrays["status"])
        result.worst[point] = arrays["worst"]
        result.largest[point] = arrays["largest"]
        for name in self.interfaces:
            self._store(result.forces, name, point, arrays[f"force:{name}"])
            self._store(result.jumps, name, point, arrays[f"jump:{name}"])
        for name in self.outputs:
            self._store(result.outputs, name, point, arrays[f"output:{name}"])

    def _store(self, into: dict[str, Array], name: str, point: int, values: Array) -> None:
        if name not in into:
            into[name] = np.full((len(self.result.iterations), *values.shape), np.nan)
        if into[name].shape[1:] != values.shape:
            raise _core.InputError(
                f"outputs: {name!r} has shape {values.shape} at point {point}, {into[name].shape[1:]} "
                "before: return one shape for all points"
            )
        into[name][point] = values


def sweep(
    structure: _core.Structure,
    laws: _core.Laws,
    amplitudes: Array,
    parameters: Sequence[SweptParameter],
    order: Sequence[int],
    interfaces: Sequence[str] = (),
    options: Options | None = None,
    checkpoint: str | Path | PointFile | None = None,
    header: dict[str, Any] | None = None,
    progress: Callable[[int, _core.Summary], None] | None = None,
    callback: Callable[[_core.Iteration], None] | None = None,
    keep_states: bool = False,
    keep_fields: bool = True,
    outputs: Mapping[str, Callable[[int, Fields], npt.ArrayLike]] | None = None,
    start: Mapping[int, _core.State] | None = None,
    shares: Shares | None = None,
    before: SweepPoints | None = None,
    check: Callable[[Sequence[Solved]], Sequence[float]] | None = None,
    beginning: _core.Beginning | None = None,
) -> SweepPoints:
    """Solve for every point, each started from the states of its nearest solved neighbours.

    Parameters
    ----------
    structure, laws
        What is solved, and its laws but for what is swept.
    amplitudes
        (loads, columns) of the load patterns.
    parameters
        What changes from point to point.
    order
        Points in the order of solution, see :func:`latin_core.snake_order`; of linear laws the one in the
        middle comes first, and those that are far from each other come next.
    interfaces
        Active interfaces of which force and jump are kept.
    checkpoint
        File of finished points; those in it already are not solved again. Several ranks give one that is open
        on all of them.
    header
        Facts that make the run what it is, compared with the file's, where this is to be opened.
    progress, callback
        Called after every point, and after every iteration; a callback that raises StopIteration ends the
        sweep with the points that are finished.
    keep_states
        Keep s and w of every point; not with a checkpoint, which has them.
    keep_fields
        Keep force and jump of every point.
    outputs
        Name -> function of the point and the fields of `interfaces`, called after every point; what it
        returns (a number or an array, of one shape for all points) is kept.
    start
        Guesses of the states of some points, from which they and their neighbours are started.
    shares
        Ranks over which the points are spread; all of them call this alike, have the same structure, and get
        the whole result. `progress` and `callback` are called on the rank that solves; `header` and
        `checkpoint` are those of the first rank.
    before
        What an earlier call with the same settings has left; its points are not solved again.
    check
        Called with some points that were solved, before any of them is kept; returns what their errors are
        larger by, NaN for those that are not to be kept.
    beginning
        Of `laws`, kept from one sweep to the next, see :meth:`latin_core.Structure.sweep`.

    Raises
    ------
    RemoteError
        Another rank has failed; it raises its own error.
    InputError
        Shapes that disagree, or a point that there is not.
    CheckpointError
        The file is damaged or of another run.
    KeyboardInterrupt
        Within one iteration of Ctrl-C; finished points are in the checkpoint.
    """
    options = options or Options()
    points = parameters[0].values.shape[1] if parameters else 1
    amplitudes = np.asarray(amplitudes)
    if amplitudes.ndim != 2:
        raise _core.InputError(f"amplitudes: shape (loads, columns) is wanted, got {amplitudes.shape}")
    _check_points("order", order, points)
    _check_points("start", start or (), points)
    result = before or _nothing_yet(points, (structure.rows, amplitudes.shape[1]) if keep_states else None)
    result.missed.clear()
    outputs = outputs or {}
    _check_outputs(outputs)
    keeper = _Keeper(result, interfaces if keep_fields else (), outputs)
    known: list[_core.State] = list(start.values()) if start else []
    known_points: list[int] = list(start) if start else []
    file: PointFile | None = None

    def shapes() -> dict[str, Shape]:
        nothing = np.zeros((structure.rows, amplitudes.shape[1]))
        found: dict[str, Shape] = dict.fromkeys(("data", "traces"), nothing.shape)
        for name in keeper.interfaces:
            fields = structure.local_fields(laws, name, _core.State(nothing, nothing))
            for what, values in zip(("force", "jump"), fields, strict=True):
                found[f"{what}:{name}"] = values.T.shape
        return found

    waiting: list[Solved] = []
    bytes_of_point = 16.0 * structure.total_rows * amplitudes.shape[1] + 1.0
    together = max(1, min(_CHECKED, int(_CHECKED_BYTES / bytes_of_point)))

    def finished(point: int, laws: _core.Laws, summary: _core.Summary, state: _core.State) -> None:
        if run is not None and run.another_keeps(point):
            result.scatter = summary.scatter
            return
        solved = Solved(point, laws, summary, state)
        if check is None:
            kept(solved, 0.0)
            return
        waiting.append(solved)
        if len(waiting) >= together:
            checked()

    def checked() -> None:
        if check is None or not waiting:
            return
        some = waiting.copy()
        waiting.clear()
        for solved, more in zip(some, check(some), strict=True):
            if np.isnan(more):
                result.missed.append(solved.point)
            else:
                kept(solved, more)

    def kept(solved: Solved, more: float) -> None:
        point, laws, summary, state = solved
        read = interfaces if keep_fields or outputs else ()
        fields = {name: structure.local_fields(laws, name, state) for name in read}
        arrays = keeper.finish(solved, fields, more)
        if file is not None or run is not None:
            arrays |= {"data": state.data, "traces": state.traces}
        if file is not None:
            file.append(point, arrays)
        if run is not None:
            run.solved(point, arrays)
        if progress is not None:
            progress(point, summary)

    ended = "converged"

    def solve(order: Sequence[int], **more: Any) -> None:
        nonlocal ended
        ended = structure.sweep(
            laws,
            options=options,
            amplitudes=amplitudes,
            parameters=parameters,
            order=order,
            known=known,
            known_points=known_points,
            point_callback=finished,
            beginning=beginning,
            **more,
        )
        checked()

    run: _OverRanks | None = None
    try:
        with nullcontext() if shares is None else shares.agreed():
            if checkpoint is not None and (shares is None or shares.first):
                if isinstance(checkpoint, (str, Path)):
                    file = Checkpoint(checkpoint, header or {})
                else:
                    file = checkpoint
            for number, state in keeper.read(file, shapes):
                if shares is None:  # shares start all alike
                    known.append(state)
                    known_points.append(number)
        if shares is None:
            solve([p for p in order if result.iterations[p] < 0], callback=callback)
        else:
            run = _OverRanks(shares, keeper, file)
            few = _PILOTS_OF_SAMPLES if options.scatter else 0 if start else _PILOTS
            run.solve(split(order, _coordinates(parameters), few), solve, callback)
            ended = max(shares.joined([ended]), key=_core.STATUSES.index)
    finally:
        if file is not None:
            file.close()
    if ended != "converged":
        result.status[result.iterations < 0] = ended
    return result


def _coordinates(parameters: Sequence[SweptParameter]) -> Array:
    """(points, numbers) all swept values, every one scaled by its range."""
    values = [each.values for each in parameters] or [np.zeros((1, 1))]
    every: Array = np.concatenate(values).T
    size = np.ptp(every, axis=0)
    size[size == 0.0] = 1.0
    scaled: Array = every / size
    return scaled


class _OverRanks:
    """A sweep whose points are spread over ranks, as this one sees it."""

    def __init__(self, shares: Shares, keeper: _Keeper, file: PointFile | None) -> None:
        self._shares, self._keeper, self._file = shares, keeper, file
        self._done = np.zeros(0, dtype=bool)
        self._pilots: set[int] = set()
        self._own: list[int] = []
        self._written = False

    def solve(
        self,
        whole: tuple[list[int], list[list[int]]],
        solve: Callable[..., None],
        callback: Callable[[_core.Iteration], None] | None,
    ) -> None:
        """Solve the pilots, which all ranks do, and shares; afterwards all have all points."""
        shares, result = self._shares, self._keeper.result
        self._done, self._written = shares.told((result.iterations >= 0, self._file is not None))
        pilots, cut = whole
        cut = [[point for point in each if not self._done[point]] for each in cut]
        cut = [each for each in cut if each]
        if not cut and all(self._done[point] for point in pilots):
            pilots = []
        self._pilots = set(pilots)

        def each_iteration(iteration: _core.Iteration) -> None:
            if callback is not None:
                callback(iteration)
            shares.poll()

        with shares.agreed():
            shares.begin(cut, self._take)
            failed = True
            try:
                solve(pilots, callback=each_iteration, next_points=shares.next)
                failed = False
            finally:
                shares.end(failed)
        self._gather()

    def another_keeps(self, point: int) -> bool:
        """Whether a point that this rank has solved is not its to keep."""
        return point in self._pilots and (not self._shares.first or bool(self._done[point]))

    def solved(self, point: int, arrays: dict[str, Any]) -> None:
        """A point of this rank; the first one is told all of it if it is to be written."""
        self._own.append(point)
        if not self._written:
            arrays = {"iterations": arrays["iterations"]}
        self._shares.solved(point, arrays)

    def _take(self, point: int, arrays: Mapping[str, Any]) -> None:
        """A point of another rank, on the first one."""
        if self._file is not None:
            self._file.append(point, arrays)
        if self._shares.taken is not None:
            self._shares.taken(point, int(arrays["iterations"]))

    def _gather(self) -> None:
        """What any rank has, on all."""
        result = self._keeper.result
        own = np.array(self._own, dtype=np.int64)
        if self._shares.first:
            own = np.concatenate([np.flatnonzero(self._done), own])
        arrays: dict[str, Any] = {name: getattr(result, name) for name in _OF_POINTS}
        if result.states is not None:
            arrays["states"] = result.states
        into = {"force": result.forces, "jump": result.jumps, "output": result.outputs}
        for kind, fields in into.items():
            arrays |= {f"{kind}:{name}": each for name, each in fields.items()}
        self._shares.merge(own, arrays)
        for name, each in arrays.items():
            kind, _, rest = name.partition(":")
            if rest:
                into[kind][rest] = each
            else:
                setattr(result, name, each)
        result.scatter = self._shares.least(result.scatter)
        result.missed = self._shares.joined(result.missed)


_OF_POINTS = ("iterations", "error", "seconds", "worst", "largest", "status")
