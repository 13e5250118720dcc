"""Several MPI ranks: who owns which part, what all must be given alike, errors that end all ranks.

A substructure belongs to one rank, where its mesh and its matrices are. Scenes are described on all
ranks alike; ``assemble(scene, comm=MPI.COMM_WORLD)`` builds on each what belongs to it.
"""

from __future__ import annotations

import functools
import os
import pickle
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter, sleep
from types import TracebackType
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import numpy as np

from mpi4py import MPI

from dolfinx_frontend.common.alike import described, difference, digest
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.errors import SceneError, telling
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.specs import SubstructureSpec
from latin_core import bound_threads

__all__ = [
    "Distribution",
    "PartSummary",
    "agreement",
    "bound_threads",
    "check_alike",
    "end_all_on_errors",
    "exchanged",
    "meeting_often",
    "one_call",
    "own_communicator",
    "place",
    "swap",
    "together",
    "waited",
]

P = ParamSpec("P")
T = TypeVar("T")
E = TypeVar("E", bound=BaseException)
_TAG = 20041
_NOT_THERE = "not there"


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
    around: bool = False
    """Whether it is the section of a body of revolution."""
    E: float | None = None
    """Young's modulus of its material at the mean; None: the material has none."""
    factor: Any = 1.0
    """What its stiffness is multiplied with: 1, or a random number or field with the mean 1."""
    cells: tuple[Array, Array, int] | None = field(default=None, repr=False)
    """Of a factor that is a random field: midpoints and volumes of the cells, and their dimension, as
    :class:`dolfinx_frontend.assembly.stretch.Stretch` has them."""
    held: Array | None = field(default=None, repr=False)
    """Gram matrix (r, r) of the rigid motions that it resists by itself; None: of none."""


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

    def __post_init__(self) -> None:
        locked(self)

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
    if spec.matrix is not None:
        return float(spec.matrix.stiffness.nnz)
    nodes = spec.part.mesh.geometry.index_map().size_global
    grow = spec.degree / max(int(coordinate_map(spec.part.mesh).degree), 1)
    return float((spec.dim * nodes * grow**spec.dim) ** (4 / 3))


UNEVEN = 1.2
"""What the largest share may cost, relative to that of single parts, where glued bodies stay whole."""


def _shares(costs: Array, ranks: int) -> Ints:
    """Rank of each of some things in a row: contiguous shares of equal cost."""
    middle = (np.cumsum(costs) - 0.5 * costs) / costs.sum()
    return np.asarray(np.minimum(middle * ranks, ranks - 1.0), dtype=np.int64)


def _largest(costs: Array, shares: Ints) -> float:
    """Cost of the rank that has most to do."""
    return float(np.bincount(shares, costs).max())


def place(
    specs: Mapping[str, SubstructureSpec],
    ranks: int,
    together: Sequence[Sequence[str]] = (),
    glued: Sequence[Sequence[str]] = (),
) -> dict[str, int]:
    """Owner of every part: the given rank, or a share of equal cost, contiguous in the scene's order.

    Groups of parts that are kept `together` go where the first of them with a given rank is, or the first.
    Bodies of `glued` parts stay whole where shares become as even: else their glue must be iterated on.

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
    shares = _shares(costs, ranks)
    if all(spec.rank is None for spec in specs.values()):
        label = np.arange(len(specs))
        at = {name: k for k, name in enumerate(specs)}
        for group in glued:
            label[[at[name] for name in group]] = at[group[0]]
        _, label = np.unique(label, return_inverse=True)
        whole = _shares(np.bincount(label, costs).astype(np.float64), ranks)[label]
        if _largest(costs, whole) <= UNEVEN * _largest(costs, shares):
            shares = whole
    owner = {
        name: int(share) if spec.rank is None else spec.rank
        for (name, spec), share in zip(specs.items(), shares, strict=True)
    }
    for group in together:
        leader = next((name for name in group if specs[name].rank is not None), group[0])
        owner |= {name: owner[leader] for name in group if specs[name].rank is None}
    return owner


def _free_duplicate(comm: Any, keyval: int, duplicate: Any) -> None:
    """A communicator that is freed takes its duplicate with it: on all ranks at once, as MPI wants it."""
    duplicate.Free()


_DUPLICATE: list[int] = []
"""Key under which a communicator of the user keeps its duplicate, once there is one."""


def own_communicator(comm: Any) -> Any:
    """A duplicate of the user's communicator, one for each: so messages of the user never meet the project's.

    It is freed together with the user's. Collective when it is first asked for.
    """
    if not _DUPLICATE:
        _DUPLICATE.append(MPI.Comm.Create_keyval(delete_fn=_free_duplicate))
    known = comm.Get_attr(_DUPLICATE[0])
    if known is None:
        known = comm.Dup()
        comm.Set_attr(_DUPLICATE[0], known)
    return known


@dataclass(eq=False)
class _Call:
    """A call that all ranks make, and whether they have met in it."""

    comm: Any
    name: str
    met: bool = False


class _Open(threading.local):
    """The calls that this rank is in, the outer ones first."""

    def __init__(self) -> None:
        self.calls: list[_Call] = []


_OPEN = _Open()


def _check_alive(comm: Any) -> None:
    if comm == MPI.COMM_NULL:
        raise SceneError(
            "the communicator that the problem was assembled on has been freed: keep it for as long as the "
            "problem and its results are used"
        )


BRIEF, PAUSE = 1e-3, 2e-4
"""Seconds of waiting in which a rank only offers its core to others, and of sleep between later looks."""

_awaited: dict[int, Any] = {}
"""Of a communicator, the request of a meeting that Ctrl-C has ended: the other ranks still count on it."""


def waited(request: Any) -> None:
    """Wait for messages and leave the core to others meanwhile, which MPI's own waiting does not; Ctrl-C
    comes through."""
    began = perf_counter()
    while not request.Test():
        if perf_counter() - began < BRIEF:
            os.sched_yield()
        else:
            sleep(PAUSE)


def _everyone_says(comm: Any, content: T) -> list[T]:
    """What every rank says, in their order; collective. Ctrl-C ends the wait for the others."""
    key = comm.py2f()
    if key not in _awaited:
        _awaited[key] = comm.Ibarrier()
    waited(_awaited[key])
    del _awaited[key]
    held: list[KeyboardInterrupt] = []

    def finish(request: Any) -> None:
        try:
            waited(request)
        except KeyboardInterrupt as error:  # all are here, and none leaves before it has heard the others
            request.Wait()
            held.append(error)

    own = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    sizes = np.empty(comm.size, dtype=np.int64)
    finish(comm.Iallgather(np.array([len(own)]), sizes))
    ends = np.cumsum(sizes)
    block = bytearray(int(ends[-1]))
    finish(comm.Iallgatherv([own, MPI.BYTE], [block, (sizes, ends - sizes), MPI.BYTE]))
    if held:
        raise held[0]
    said = memoryview(block)
    return [pickle.loads(said[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


_RULE = "all ranks must make the same calls in the same order, and be given the same"


class _Said(NamedTuple, Generic[T]):
    """What a rank says where all meet."""

    call: str
    """Of the user, in which it is."""
    step: str
    """Of the call, which has arguments or names of its own."""
    content: T
    failure: str | None


def _meet(comm: Any, step: str, content: T, failure: str | None = None) -> list[_Said[T]]:
    """What all ranks call and say; raises on those that have not failed if one has, or makes another call."""
    _check_alive(comm)
    own = [each for each in _OPEN.calls if each.comm == comm]
    for each in own:
        each.met = True
    every = _everyone_says(comm, _Said(own[0].name if own else "", step, content, failure))
    if failure is None:
        for rank, said in enumerate(every):
            if said.failure is not None:
                raise _known_to_all(SceneError(f"rank {rank} failed: {said.failure}"))
        _check_calls(every, [said.call for said in every], "calls")
    return every


def _check_calls(every: Sequence[_Said[Any]], told: Sequence[str], verb: str) -> None:
    """Raise on all ranks unless all do the same."""
    for rank, text in enumerate(told):
        if text != told[0]:
            first, other = (told[k] or every[k].step or "something else" for k in (0, rank))
            call = every[rank].call if every[rank].call == every[0].call else ""
            raise _known_to_all(
                SceneError(
                    f"{call and call + ': '}rank 0 {verb} {first}, rank {rank} {verb} {other}: {_RULE}"
                )
            )


_KNOWN_TO_ALL = "known_to_all_ranks"


def _known_to_all(error: E) -> E:
    """An error that no rank has to be told any more."""
    setattr(error, _KNOWN_TO_ALL, True)
    return error


def _reason(error: BaseException) -> str:
    return str(error) if isinstance(error, SceneError) else f"{type(error).__name__}: {error}"


def exchanged(comm: Any, content: T) -> list[T]:
    """What every rank says, in their order; collective. If a rank has failed before, the others raise.

    Raises
    ------
    SceneError
        Another rank has failed in the same call.
    """
    return [said.content for said in _meet(comm, "", content)]


@contextmanager
def one_call(comm: Any, call: str) -> Iterator[None]:
    """A call that all ranks make: what one of them is refused before they first meet in it, all are.

    A rank that fails before it has met the others (an argument that only it was given is wrong, say) tells
    them where they wait for it: it raises its own error, they a SceneError with its message. A call in which
    the ranks do not meet ends with a meeting. Without a communicator nothing is added.
    """
    if comm is None:
        yield
        return
    own = _Call(comm, call)
    _OPEN.calls.append(own)
    try:
        yield
        if not own.met:
            _meet(comm, call, None)
    except Exception as error:
        if not own.met:
            _meet(comm, call, None, _reason(error))
        raise
    finally:
        _OPEN.calls.remove(own)


def together(call: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator: a function of a problem or a result that all ranks call, see :func:`one_call`: those of the
    problem, and those of an argument ``points_comm`` or ``comm``."""

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def called(*args: P.args, **kwargs: P.kwargs) -> T:
            first: Any = args[0] if args else kwargs.get("problem", kwargs.get("result"))
            distribution = getattr(getattr(first, "problem", first), "distribution", None)
            comm = getattr(distribution, "comm", None)
            given = kwargs.get("points_comm", kwargs.get("comm"))
            over = getattr(getattr(first, "_ranks", None), "comm", None)
            if isinstance(given, MPI.Intracomm) and given != MPI.COMM_NULL:
                over = own_communicator(given)
            with telling(), one_call(over, call), one_call(comm, call):
                return function(*args, **kwargs)

        return called

    return decorate


def check_alike(comm: Any, call: str, given: Mapping[str, Any]) -> None:
    """Raise on all ranks unless all make the same call and are given the same; collective.

    Parameters
    ----------
    call
        What is called, for the message.
    given
        What it is -> the value.

    Raises
    ------
    SceneError
        What differs, with the values of two ranks; or another rank has failed before.
    """
    every = _meet(comm, call, {name: digest(value) for name, value in given.items()})
    _check_calls(every, [said.step for said in every], "calls")
    first = every[0].content
    for rank, said in enumerate(every):
        for name in dict.fromkeys([*first, *said.content]):
            if first.get(name) != said.content.get(name):
                values = exchanged(comm, described(given.get(name, _NOT_THERE)))
                one, two = difference(values[0], values[rank])
                raise SceneError(
                    f"{said.call or call}: {name} differs between ranks: {one} on rank 0, {two} on rank "
                    f"{rank}; {_RULE}"
                )


@contextmanager
def agreement(comm: Any, call: str = "") -> Iterator[None]:
    """Work that does not communicate: if it fails on one rank, all raise.

    That rank raises its own error, the others a SceneError with the message of the first. Without a
    communicator nothing is added.

    Parameters
    ----------
    call
        What is done; if that is not the same on all ranks, all raise.
    """
    if comm is None:
        yield
        return
    own: Exception | None = None
    try:
        yield
    except Exception as error:
        own = error
    every = _meet(comm, call, None, None if own is None else _reason(own))
    if own is not None:
        raise _known_to_all(own)
    _check_calls(every, [said.step for said in every], "asks for")


@contextmanager
def meeting_often(comm: Any) -> Iterator[None]:
    """Work in which the ranks meet again and again: a rank that fails tells the others where they meet next.

    All that communicates in it has to begin with a meeting (:func:`exchanged`, :func:`agreement`). What fails
    on all ranks has to do so at the same place. Without a communicator nothing is added.
    """
    try:
        yield
    except BaseException as error:
        if comm is not None and not getattr(error, _KNOWN_TO_ALL, False):
            _known_to_all(error)
            _meet(comm, "", None, _reason(error))
        raise


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
