"""Several MPI ranks: who owns which part, errors that end all ranks, threads that share the cores.

A substructure belongs to one rank, where its mesh and its matrices are. Scenes are described on all
ranks alike; ``assemble(scene, comm=MPI.COMM_WORLD)`` builds on each what belongs to it.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, TypeVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.specs import SubstructureSpec
from latin_core import bound_threads

__all__ = [
    "Distribution",
    "PartSummary",
    "agreement",
    "bound_threads",
    "end_all_on_errors",
    "place",
    "swap",
]

T = TypeVar("T")
_TAG = 20041


@dataclass(frozen=True)
class PartSummary:
    """What every rank knows of a part; see :class:`dolfinx_frontend.assembly.assemble.Substructure`."""

    dim: int
    size: int
    modulus: float
    length: float
    volume: float
    centre: Array = field(repr=False)
    loaded: bool
    """Whether it has body forces that are constant in time."""


@dataclass(frozen=True)
class Distribution:
    """How a problem is spread over ranks.

    Attributes
    ----------
    comm
        mpi4py communicator.
    owner
        Substructure -> its rank.
    parts
        Substructure -> what every rank knows of it, in the order of the scene.
    load_amplitudes
        Amplitudes of all body forces.
    """

    comm: Any = field(repr=False)
    owner: Mapping[str, int]
    parts: Mapping[str, PartSummary] = field(repr=False)
    load_amplitudes: tuple[Amplitude, ...] = field(repr=False)

    @property
    def rank(self) -> int:
        """This rank."""
        return int(self.comm.rank)

    def ranks(self, substructures: Sequence[str]) -> list[int]:
        """Ranks of some substructures, each once."""
        return sorted({self.owner[name] for name in substructures})


def _cost(spec: SubstructureSpec) -> float:
    """Relative cost of a part: a factor of n unknowns holds about n^(4/3) numbers; 0: not known yet."""
    if spec.lazy:
        return 0.0
    nodes = spec.part.mesh.geometry.index_map().size_local
    grow = spec.degree / max(int(coordinate_map(spec.part.mesh).degree), 1)
    return float((spec.dim * nodes * grow**spec.dim) ** (4 / 3))


def place(specs: Mapping[str, SubstructureSpec], ranks: int) -> dict[str, int]:
    """Owner of every part: the given rank, or a share of equal cost, contiguous in the scene's order.

    Raises
    ------
    SceneError
        A given rank that does not exist.
    """
    for name, spec in specs.items():
        if spec.rank is not None and not 0 <= spec.rank < ranks:
            raise SceneError(
                f"substructure {name!r}: rank = {spec.rank} of {ranks}; admissible: 0..{ranks - 1}"
            )
    costs = np.array([_cost(spec) for spec in specs.values()])
    if np.any(costs == 0.0):  # nothing is known of some: count all alike
        costs[:] = 1.0
    middle = (np.cumsum(costs) - 0.5 * costs) / costs.sum()
    shares = np.minimum((middle * ranks).astype(int), ranks - 1)
    return {
        name: int(share) if spec.rank is None else spec.rank
        for (name, spec), share in zip(specs.items(), shares, strict=True)
    }


@contextmanager
def agreement(comm: Any) -> Iterator[None]:
    """Work that does not communicate: if it fails on one rank, all raise.

    That rank raises its own error, the others a SceneError with the message of the first. Without a
    communicator nothing is added.
    """
    if comm is None:
        yield
        return
    own: Exception | None = None
    try:
        yield
    except Exception as error:
        own = error
    messages = comm.allgather(None if own is None else f"{type(own).__name__}: {own}")
    if own is not None:
        raise own
    for rank, message in enumerate(messages):
        if message is not None:
            raise SceneError(f"rank {rank} failed: {message}")


def swap(comm: Any, outgoing: Mapping[int, Mapping[Any, T]]) -> dict[Any, T]:
    """Give neighbours what they need, and take the same of them; keys are unique over all ranks."""
    requests = [comm.isend(dict(given), dest=other, tag=_TAG) for other, given in outgoing.items()]
    taken: dict[Any, T] = {}
    for other in outgoing:
        taken.update(comm.recv(source=other, tag=_TAG))
    for request in requests:
        request.wait()
    return taken


def end_all_on_errors(comm: Any) -> None:
    """An error that one rank does not catch ends all of them: the others might wait for it for ever."""

    def end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        lines = traceback.format_exception(kind, error, trace)
        sys.stderr.write(f"rank {comm.rank} of {comm.size}:\n" + "".join(lines))
        sys.stderr.flush()
        comm.Abort(1)

    if comm.size > 1 and "LATIN_KEEP_EXCEPTHOOK" not in os.environ:
        sys.excepthook = end
