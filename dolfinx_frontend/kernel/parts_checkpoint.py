"""The checkpoint of a run over points: one file, which any number of ranks goes on with.

What a point leaves is kept by interface and side, and not as the ranks had it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from latin_core.checkpoint import Checkpoint, edited, wrong_array

from dolfinx_frontend.assembly.ranks import agreement, exchanged

__all__ = ["Layout", "PartsCheckpoint"]

_STATE = ("data", "traces")
_MORE = ("active interfaces",)
"""Facts of which the file may have more than a run: fields of other interfaces, too."""

Arrays = dict[str, npt.NDArray[Any]]


class Layout(NamedTuple):
    """What of a structure is on this rank.

    Attributes
    ----------
    rows
        Active interface that touches this rank -> first row and number of rows of each side that is here, by
        the number of the side.
    shape
        Rows and columns of a state.
    bodies
        Names of the parts of every body.
    active
        All active interfaces, on any rank.
    """

    rows: Mapping[str, Mapping[int, tuple[int, int]]]
    shape: tuple[int, int]
    bodies: Sequence[Sequence[str]]
    active: Sequence[str]

    def named(self, arrays: Mapping[str, npt.ArrayLike]) -> Arrays:
        """Arrays of this rank by interface and side; states are (rows, columns) or (n, rows, columns)."""
        out = {name: np.asarray(value) for name, value in arrays.items() if name not in (*_STATE, "worst")}
        if not any(kind in arrays for kind in _STATE):
            return out
        for kind in _STATE:
            state = np.asarray(arrays[kind])
            for name, sides in self.rows.items():
                for side, (first, count) in sides.items():
                    out[f"{kind}:{name}:{side}"] = state[..., first : first + count, :]
        out["interfaces"] = np.array(list(self.active), dtype=np.str_)
        if "worst" in arrays:
            column, body = (int(each) for each in np.asarray(arrays["worst"]))
            out["column"] = np.array(column)
            out["part"] = np.array(self.bodies[body][0] if 0 <= body < len(self.bodies) else "")
        return out

    def has_all(self, arrays: Mapping[str, npt.NDArray[Any]]) -> bool:
        """Whether a point has all active interfaces: one of a run with fewer of them has not."""
        return set(self.active) <= set(map(str, np.ravel(arrays.get("interfaces", self.active))))

    def wanted(self) -> dict[str, tuple[int, int]]:
        """Names and shapes of the arrays of states that this rank needs."""
        columns = self.shape[1]
        return {
            f"{kind}:{name}:{side}": (count, columns)
            for kind in _STATE
            for name, sides in self.rows.items()
            for side, (_, count) in sides.items()
        }

    def own(self, arrays: Mapping[str, npt.NDArray[Any]]) -> Arrays:
        """Arrays of this rank from those by interface and side."""
        wanted = self.wanted()
        out = {n: value for n, value in arrays.items() if n not in {"column", "part", "interfaces", *wanted}}
        states = _states(arrays)
        if states is None:
            return out
        for kind in _STATE:
            out[kind] = np.zeros((*states, *self.shape))
            for name, sides in self.rows.items():
                for side, (first, count) in sides.items():
                    out[kind][..., first : first + count, :] = arrays[f"{kind}:{name}:{side}"]
        if "column" in arrays:
            part = str(arrays["part"])
            at = next((k for k, body in enumerate(self.bodies) if part in body), -1)
            out["worst"] = np.array([int(arrays["column"]) if at >= 0 else -1, at], dtype=np.int64)
            if at < 0 and "largest" in out:
                out["largest"] = np.full_like(out["largest"], -1.0)
        return out


def _states(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[int, ...] | None:
    """What the shapes of an entry's states begin with; None: it has no states."""
    if "kept" in arrays:
        return arrays["kept"].shape[:1]
    return None if "x" in arrays else ()


def _wrong(arrays: Mapping[str, npt.NDArray[Any]], wanted: Mapping[str, tuple[int, int]]) -> str:
    """What is wrong with what an entry has of states, by its name in the file; empty: nothing."""
    states = _states(arrays)
    if states is None:
        return ""
    checks = [(name, "f", (*states, *shape)) for name, shape in wanted.items()]
    if states == ():
        checks += [("column", "iu", ()), ("part", "U", ())]
    return next(filter(None, (wrong_array(arrays, *each) for each in checks)), "")


def _joined(headers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The facts of all ranks, of which each has those of its parts."""
    facts: dict[str, Any] = {}
    for header in headers:
        for name, value in header.items():
            facts.setdefault(name, value)
    return facts


class PartsCheckpoint:
    """Finished points of a run in one file.

    A point is written when all ranks have finished it. So what ends the ranks leaves whole points. Every
    member but :meth:`close` is collective.

    An entry is a point, with its state, or what a function was asked for (with ``x``): of points that were
    solved together it has the states of those in ``kept``, of a derivative none.

    Parameters
    ----------
    comm
        The ranks that share the problem; None: there is one.
    path, header
        As for :class:`latin_core.Checkpoint`; those of the first rank, and the facts of all. The file may be
        of a run with more active interfaces, as one over other ranks may have.

    Raises
    ------
    CheckpointError
        As there, on the first rank; on the others a SceneError says so.
    """

    def __init__(self, comm: Any, path: str | Path, header: Mapping[str, Any], layout: Layout) -> None:
        self.path = Path(path)
        self._comm, self._layout = comm, layout
        self._file: Checkpoint | None = None
        headers = [dict(header)] if comm is None else exchanged(comm, dict(header))
        wanted = layout.wanted()
        self._wanted = [wanted] if comm is None else exchanged(comm, wanted)
        with agreement(comm):
            if comm is None or comm.rank == 0:
                self._file = Checkpoint(path, _joined(headers), _MORE)

    def agreement(self) -> AbstractContextManager[None]:
        """Where what is read is looked at: if it is wrong on one rank, all raise."""
        return agreement(self._comm)

    def __iter__(self) -> Iterator[tuple[int, Arrays]]:
        """Finished points as (number, arrays of this rank), by number."""
        stored = ((n, arrays) for n, arrays in self._file or () if self._layout.has_all(arrays))
        while True:
            of_ranks: list[Any] = [None] * len(self._wanted)
            with agreement(self._comm):
                point = next(stored, None)
                if point is not None:
                    of_ranks = [self._of_rank(*point, wanted) for wanted in self._wanted]
            own = of_ranks[0] if self._comm is None else self._comm.scatter(of_ranks, root=0)
            if own is None:
                return
            yield own[0], self._layout.own(own[1])

    def _of_rank(
        self, number: int, arrays: Arrays, wanted: Mapping[str, tuple[int, int]]
    ) -> tuple[int, Arrays]:
        """What a rank needs of a point."""
        wrong = _wrong(arrays, wanted)
        if wrong:
            raise edited(self.path, number, wrong)
        return number, {n: value for n, value in arrays.items() if n in wanted or not _of_state(n)}

    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write what all ranks have of a point."""
        own = self._layout.named(arrays)
        every = [own] if self._comm is None else self._comm.gather(own, root=0)
        with agreement(self._comm):
            if self._file is None:
                return
            # of what all have, that of the rank with the largest error
            first = max(every, key=lambda each: float(each.get("largest", 0.0)))
            whole = dict(first)
            for each in every:
                for name, value in each.items():
                    whole.setdefault(name, value)
            self._file.append(number, whole)

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()


def _of_state(name: str) -> bool:
    return name.partition(":")[0] in _STATE
