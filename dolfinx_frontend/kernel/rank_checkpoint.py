"""The checkpoint of a run over ranks: one file, which the first rank writes and reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from latin_core import Checkpoint

from dolfinx_frontend.assembly.ranks import agreement, exchanged

__all__ = ["RankCheckpoint"]


def _joined(headers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The facts of all ranks: those that only one has, or all alike, as they are; others by rank."""
    facts: dict[str, Any] = {"ranks": len(headers)}
    for name in dict.fromkeys(name for header in headers for name in header):
        values = {f"rank {rank}": header[name] for rank, header in enumerate(headers) if name in header}
        first = next(iter(values.values()))
        facts[name] = first if all(each == first for each in values.values()) else values
    return facts


class RankCheckpoint:
    """Finished points of a run over ranks, in one file.

    A point is written when all ranks have finished it. So what ends the ranks leaves whole points. Every
    member but :meth:`close` is collective. The parts must be on the ranks that they were on when the file was
    made.

    Parameters
    ----------
    path, header
        As for :class:`latin_core.Checkpoint`; those of the first rank, and the facts of all.

    Raises
    ------
    CheckpointError
        As there, on the first rank; on the others a SceneError says so.
    """

    def __init__(self, comm: Any, path: str | Path, header: Mapping[str, Any]) -> None:
        self.path = Path(path)
        self._comm = comm
        self._file: Checkpoint | None = None
        headers = exchanged(comm, dict(header))
        with agreement(comm):
            if comm.rank == 0:
                self._file = Checkpoint(path, _joined(headers))

    def agreement(self) -> AbstractContextManager[None]:
        """Where what is read is looked at: if it is wrong on one rank, all raise."""
        return agreement(self._comm)

    def __iter__(self) -> Iterator[tuple[int, dict[str, npt.NDArray[Any]]]]:
        """Finished points as (number, arrays of this rank), by number."""
        stored = iter(self._file or ())
        while True:
            of_ranks: list[Any] = [None] * int(self._comm.size)
            with agreement(self._comm):
                point = next(stored, None)
                if point is not None:
                    of_ranks = [(point[0], _of_rank(point[1], rank)) for rank in range(len(of_ranks))]
            own = self._comm.scatter(of_ranks, root=0)
            if own is None:
                return
            yield own

    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write what all ranks have of a point."""
        every = self._comm.gather({name: np.asarray(value) for name, value in arrays.items()}, root=0)
        with agreement(self._comm):
            if self._file is not None:
                self._file.append(
                    number,
                    {
                        f"{rank}/{name}": value
                        for rank, own in enumerate(every)
                        for name, value in own.items()
                    },
                )

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()


def _of_rank(arrays: Mapping[str, npt.NDArray[Any]], rank: int) -> dict[str, npt.NDArray[Any]]:
    start = f"{rank}/"
    return {name.removeprefix(start): each for name, each in arrays.items() if name.startswith(start)}
