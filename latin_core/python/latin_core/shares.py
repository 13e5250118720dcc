"""Points of a sweep over ranks: every rank has the whole structure and takes shares of the points.

The points are cut into shares beforehand, in the same way for any number of ranks. All ranks solve the same
few points, the pilots; every share starts from these and from nothing else. So an answer does not depend on
who solved which share, nor on how many ranks there were, but for rounding.

The first rank hands out the shares, keeps what the points leave and writes the checkpoint. It works, too, and
answers the others between two of its iterations; so they ask for a share before they have finished the last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import perf_counter, sleep
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from latin_core._core import RemoteError

__all__ = ["Shares", "split"]

FEWEST = 16
"""Points below which one rank solves all."""
SHARE = 8, 256
"""Points of a share, at least and at most."""
LEAST_SHARES = 8
"""Shares that there are at least, if they are not too small."""
FLUSH = 0.5
"""Seconds after which finished points are sent."""
PAUSE = 1e-3
"""Seconds between two looks for messages."""
BLOCK = 1 << 26
"""Bytes of an array that are sent at a time."""
_TO_FIRST, _FROM_FIRST = 20042, 20043
_NONE_LEFT, _STOP, _GOODBYE = -1, -2, -3

Taken = Callable[[int, Mapping[str, Any]], None]


def split(
    order: Sequence[int], where: npt.NDArray[np.float64], most_pilots: int = 4
) -> tuple[list[int], list[list[int]]]:
    """Pilots and shares of points; they do not depend on the number of ranks.

    A share is a box of neighbours, walked in the given order: the fewer points lie on its rim, the fewer miss
    a neighbour to start from. The last shares are small, so that all ranks end together.

    Parameters
    ----------
    order
        Points in the order of a walk through all of them.
    where
        (points, coordinates), in which points are near to each other or far.
    most_pilots
        As many pilots are taken, fewer of few points.
    """
    count = len(order)
    if count < FEWEST:
        return [], [list(order)]
    few = min(most_pilots, max(4, count // 16))
    first = [_middle(box, where) for box in _boxes(list(order), where, -(-count // few))] if few else []
    known = set(first)
    left = [point for point in order if point not in known]
    boxes = _boxes(left, where, min(max(-(-len(left) // LEAST_SHARES), SHARE[0]), SHARE[1]))
    shares: list[list[int]] = []
    for number, box in enumerate(boxes):
        halves = 1 if number < 0.75 * len(boxes) else 2 if number < 0.875 * len(boxes) else 4
        shares += _boxes(box, where, max(-(-len(box) // halves), SHARE[0]))
    return first, shares


def _boxes(points: list[int], where: npt.NDArray[np.float64], most: int) -> list[list[int]]:
    """Points halved across the longest side of their box until there are no more than so many in each."""
    boxes: list[list[int]] = []
    left = [np.array(points, dtype=np.int64)]
    while left:
        box = left.pop()
        if len(box) <= most:
            boxes.append([int(point) for point in box])
            continue
        here = where[box]
        along = here[:, int(np.argmax(np.ptp(here, axis=0)))]
        low = np.zeros(len(box), dtype=bool)
        low[np.argsort(along, kind="stable")[: len(box) // 2]] = True
        left += [box[~low], box[low]]
    return boxes


def _middle(points: list[int], where: npt.NDArray[np.float64]) -> int:
    here = where[points]
    return points[int(np.argmin(np.sum((here - here.mean(axis=0)) ** 2, axis=1)))]


class Shares:
    """Ranks over which the points of a sweep are spread.

    Parameters
    ----------
    comm
        mpi4py communicator of all of them.
    group
        Communicator of the ranks that hold one structure together, as many in every group; None: each rank
        has the whole of it.

    Attributes
    ----------
    taken
        Called on the first rank with each point that another one has solved, and its iterations.
    """

    def __init__(self, comm: Any, group: Any = None) -> None:
        self.taken: Callable[[int, int], None] | None = None
        self._all = comm
        self._group = group if group is not None and group.size > 1 else None
        # ranks with the same parts of the structure; those of the leaders of the groups hand out the shares
        self._comm = comm if self._group is None else comm.Split(self._group.rank, comm.rank)
        self._leads = self._group is None or self._group.rank == 0
        self._working: set[int] = set()
        self._shares: list[list[int]] = []
        self._take: Taken | None = None
        self._next = 0
        self._stopped = self._exhausted = False
        self._failure: Exception | None = None

    def __repr__(self) -> str:
        held = "" if self._group is None else f", {self._group.size} for each structure"
        return f"Shares({self._all.size} ranks{held})"

    @property
    def first(self) -> bool:
        """Whether this rank keeps all points and the checkpoint."""
        return bool(self._comm.rank == 0)

    def close(self) -> None:
        """Free what was made of the communicator."""
        if self._comm is not self._all:
            self._comm.Free()

    # --- all ranks together ---
    @contextmanager
    def agreed(self) -> Iterator[None]:
        """Work after which all ranks go on, or all raise: the one that failed its own error.

        Raises
        ------
        RemoteError
            Another rank failed.
        """
        own: BaseException | None = None
        try:
            yield
        except BaseException as error:
            own = error
        every = self._all.allgather(None if own is None else f"{type(own).__name__}: {own}")
        if own is not None:
            raise own
        for rank, text in enumerate(every):
            if text is not None:
                raise RemoteError(f"rank {rank} failed: {text}")

    def told(self, value: Any) -> Any:
        """What the first rank says."""
        return self._comm.bcast(value, root=0)

    def joined(self, own: list[Any]) -> list[Any]:
        """The lists of all ranks, or groups, one after the other."""
        return [each for some in self._comm.allgather(own) for each in some]

    def least(self, value: float) -> float:
        """The smallest of all ranks."""
        return float(self._all.allreduce(value, op=MPI.MIN))

    def merge(self, own: npt.NDArray[np.int64], arrays: dict[str, npt.NDArray[Any]]) -> None:
        """Arrays (points, ...) of which every rank has the rows `own`; afterwards all have the rows of all.

        What another rank has and this one lacks is made, NaN where nobody has a row.
        """
        if self._comm.size == 1:
            return
        told = {name: (each.shape, each.dtype.str) for name, each in arrays.items()}
        every = self._comm.allgather((own, told if len(own) else {}))
        for _, names in every:
            for name, (shape, kind) in names.items():
                if name not in arrays:
                    arrays[name] = np.full(shape, np.nan, dtype=kind)
        for root, (rows, names) in enumerate(every):
            mine = root == self._comm.rank
            for name, (shape, kind) in names.items():
                step = max(1, BLOCK // max(1, int(np.prod(shape[1:])) * np.dtype(kind).itemsize))
                for begin in range(0, len(rows), step):
                    some = rows[begin : begin + step]
                    block = arrays[name][some] if mine else np.empty((len(some), *shape[1:]), dtype=kind)
                    self._comm.Bcast(block.reshape(-1).view(np.uint8), root=root)
                    if not mine:
                        arrays[name][some] = block

    # --- a run ---
    def begin(self, shares: Sequence[Sequence[int]], take: Taken) -> None:
        """A run over these shares; on the first rank `take` is called with what points of others leave."""
        self._shares = [list(each) for each in shares]
        self._take = take
        self._next = self._comm.size  # the first ones need not be asked for
        self._mine: int | None = self._comm.rank
        self._asked = False
        self._stopped = self._exhausted = False
        self._failure = None
        self._working = set(range(1, self._comm.size)) if self.first else set()
        self._outbox: list[tuple[int, Mapping[str, Any]]] = []
        self._sent = self._looked = perf_counter()
        self._requests: list[Any] = []

    def next(self) -> list[int]:
        """The points of the next share; none: there are no more. A group calls it together."""
        number = self._take_share() if self._leads else None
        if self._group is not None:
            number = self._group.bcast(number, root=0)
        assert number is not None
        if number < 0:
            self._exhausted = number == _NONE_LEFT
            self._flush()
            return []
        return self._shares[number]

    def _take_share(self) -> int:
        if self.first:
            self._receive()
            number = self._mine if self._mine is not None else self._given()
            self._mine = None
            number = _STOP if self._stopped else number
        else:
            self._flush()
            number = self._mine if self._mine is not None else self._awaited()
            self._mine = None
            if 0 <= number < len(self._shares):
                self._send("ask", None)  # in time for the one after this
                self._asked = True
        return number if number < len(self._shares) else _NONE_LEFT

    def _given(self) -> int:
        """The next share of all, handed out."""
        number, self._next = self._next, self._next + 1
        return number if number < len(self._shares) else _NONE_LEFT

    def _awaited(self) -> int:
        if not self._asked:
            return _NONE_LEFT
        while True:
            answer = self._heard()
            if answer is None:
                sleep(PAUSE)
            elif answer == _STOP:
                self._stopped = True
                return _STOP
            else:
                self._asked = False
                return answer

    def _heard(self) -> int | None:
        """What the first rank has answered, if it has."""
        if not self._comm.iprobe(source=0, tag=_FROM_FIRST):
            return None
        return int(self._comm.recv(source=0, tag=_FROM_FIRST))

    def poll(self) -> None:
        """Look for messages, if that was not done just now; to be called often.

        Raises
        ------
        StopIteration
            Another rank was interrupted or has failed.
        """
        now = perf_counter()
        if now - self._looked < PAUSE and not self._stopped:
            return
        self._looked = now
        if self.first:
            self._receive()
        elif self._leads and (answer := self._heard()) is not None:
            if answer == _STOP:
                self._stopped = True
            else:
                self._mine, self._asked = answer, False
        if self._stopped:
            raise StopIteration

    def solved(self, number: int, arrays: Mapping[str, Any]) -> None:
        """What a point of this rank has left; the first rank keeps its own by itself."""
        if self.first:
            return
        self._outbox.append((number, arrays))
        if perf_counter() - self._sent > FLUSH:
            self._flush()

    def end(self, failed: bool) -> None:
        """The end of the run on this rank; waits for the others. If it came early, all end."""
        early = failed or not self._exhausted
        if not self.first:
            self._flush()
            self._send("end", early)
            while True:
                answer = self._heard()
                if answer == _GOODBYE:
                    break
                if answer is None:
                    sleep(PAUSE)
        else:
            if early:
                self._stop()
            while self._working:
                self._receive()
                sleep(PAUSE)
            for other in range(1, self._comm.size):
                self._requests.append(self._comm.isend(_GOODBYE, dest=other, tag=_FROM_FIRST))
        MPI.Request.Waitall(self._requests)
        self._requests = []
        if self._failure is not None and not failed:
            raise self._failure

    def _flush(self) -> None:
        self._sent = perf_counter()
        if self._outbox:
            self._send("points", self._outbox)
            self._outbox = []

    def _send(self, kind: str, content: Any) -> None:
        self._requests = [each for each in self._requests if not each.Test()]
        self._requests.append(self._comm.isend((kind, content), dest=0, tag=_TO_FIRST))

    def _stop(self) -> None:
        if self._stopped:
            return
        self._stopped = True
        if self._leads:
            for other in self._working:
                self._requests.append(self._comm.isend(_STOP, dest=other, tag=_FROM_FIRST))

    def _receive(self) -> None:
        """All that the others have sent to the first rank."""
        status = MPI.Status()
        while self._working and self._comm.iprobe(source=MPI.ANY_SOURCE, tag=_TO_FIRST, status=status):
            source = status.Get_source()
            kind, content = self._comm.recv(source=source, tag=_TO_FIRST)
            if kind == "ask":
                answer = _NONE_LEFT if self._stopped else self._given()
                self._requests.append(self._comm.isend(answer, dest=source, tag=_FROM_FIRST))
            elif kind == "end":
                self._working.discard(source)
                if content:
                    self._stop()
            else:
                self._keep(content)

    def _keep(self, points: Sequence[tuple[int, Mapping[str, Any]]]) -> None:
        assert self._take is not None
        for number, arrays in points:
            try:
                self._take(number, arrays)
            except Exception as error:  # told at the end, when no other rank waits for an answer
                self._failure = self._failure or error
                self._stop()
                return
