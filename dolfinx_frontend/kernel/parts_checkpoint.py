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
from latin_core import Checkpoint

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
        """Arrays of this rank by interface and side."""
        out = {name: np.asarray(value) for name, value in arrays.items() if name not in (*_STATE, "worst")}
        for kind in _STATE:
            state = np.asarray(arrays[kind])
            for name, sides in self.rows.items():
                for side, (first, count) in sides.items():
                    out[f"{kind}:{name}:{side}"] = state[first : first + count]
        column, body = (int(each) for each in np.asarray(arrays["worst"]))
        out["interfaces"] = np.array(list(self.active), dtype=np.str_)
        out["column"] = np.array(column)
        out["part"] = np.array(self.bodies[body][0] if 0 <= body < len(self.bodies) else "")
        return out

    def has_all(self, arrays: Mapping[str, npt.NDArray[Any]]) -> bool:
        """Whether a point has all active interfaces: one of a run with fewer of them has not."""
        return set(self.active) <= set(map(str, np.ravel(arrays.get("interfaces", self.active))))

    def wanted(self) -> set[str]:
        """Names of the arrays of states that this rank needs."""
        return {f"{kind}:{n}:{side}" for kind in _STATE for n, sides in self.rows.items() for side in sides}

    def own(self, arrays: Mapping[str, npt.NDArray[Any]]) -> Arrays:
        """Arrays of this rank from those by interface and side; what is not there, or does not fit, is left
        out."""
        names = {"column", "part", "interfaces", *self.wanted()}
        out = {name: value for name, value in arrays.items() if name not in names}
        for kind in _STATE:
            state = np.zeros(self.shape)
            whole = True
            for name, sides in self.rows.items():
                for side, (first, count) in sides.items():
                    block = arrays.get(f"{kind}:{name}:{side}")
                    if block is None or block.dtype.kind != "f" or block.shape != (count, self.shape[1]):
                        whole = False
                    else:
                        state[first : first + count] = block
            if whole:
                out[kind] = state
        if _is_one(arrays.get("column"), "iu") and _is_one(arrays.get("part"), "U"):
            part = str(arrays["part"])
            at = next((k for k, body in enumerate(self.bodies) if part in body), -1)
            out["worst"] = np.array([int(arrays["column"]) if at >= 0 else -1, at], dtype=np.int64)
            if at < 0 and "largest" in out:
                out["largest"] = np.full_like(out["largest"], -1.0)
        return out


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
        if self._comm is None:
            assert self._file is not None
            for number, arrays in self._file:
                if self._layout.has_all(arrays):
                    yield number, self._layout.own(arrays)
            return
        stored = ((n, arrays) for n, arrays in self._file or () if self._layout.has_all(arrays))
        while True:
            of_ranks: list[Any] = [None] * int(self._comm.size)
            with agreement(self._comm):
                point = next(stored, None)
                if point is not None:
                    number, arrays = point
                    of_ranks = [
                        (number, {n: v for n, v in arrays.items() if n in wanted or not _of_state(n)})
                        for wanted in self._wanted
                    ]
            own = self._comm.scatter(of_ranks, root=0)
            if own is None:
                return
            yield own[0], self._layout.own(own[1])

    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write what all ranks have of a point."""
        own = self._layout.named(arrays)
        every = [own] if self._comm is None else self._comm.gather(own, root=0)
        with agreement(self._comm):
            if self._file is None:
                return
            # of what all have, that of the rank with the largest error
            first = max(every, key=lambda each: float(each["largest"]))
            whole = dict(first)
            for each in every:
                for name, value in each.items():
                    whole.setdefault(name, value)
            self._file.append(number, whole)

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()


def _is_one(value: npt.NDArray[Any] | None, kinds: str) -> bool:
    return value is not None and value.shape == () and value.dtype.kind in kinds


def _of_state(name: str) -> bool:
    return name.partition(":")[0] in _STATE
