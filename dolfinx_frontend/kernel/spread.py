"""Points over ranks: every rank, or group of ranks, has the whole problem and solves a share of the points.

See :mod:`latin_core.shares` for how points are handed out. Here: what all ranks must have alike, and errors.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from latin_core import RemoteError
from latin_core.checkpoint import differences
from latin_core.shares import Shares
from mpi4py import MPI

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import (
    agreement,
    bound_threads,
    check_alike,
    end_all_on_errors,
    exchanged,
    own_communicator,
)
from dolfinx_frontend.common.checks import check_optional_kind
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.kernel.fingerprint import Facts

__all__ = ["PointRanks", "agreed_over", "check_given_alike", "one_answer", "point_ranks", "points_shown"]


class PointRanks:
    """Ranks that solve points of the same problem.

    Attributes
    ----------
    comm
        A communicator of all of them.
    """

    def __init__(self, where: str, problem: Problem, comm: Any) -> None:
        self.comm = own_communicator(comm)
        group = problem.comm
        size = 1 if group is None else group.size
        sizes = exchanged(self.comm, size)
        if min(sizes) != max(sizes):
            raise SceneError(
                f"{where}: points_comm has ranks whose problem is spread over {min(sizes)} ranks, and over "
                f"{max(sizes)}: groups must be of one size"
            )
        inside = size == 1 or MPI.Group.Intersection(group.group, self.comm.group).size == size
        if not all(exchanged(self.comm, inside)):
            raise SceneError(
                f"{where}: points_comm lacks some of the ranks that the problem is spread over: give one "
                "that has them all, e.g. MPI.COMM_WORLD"
            )
        if self.comm.size > 1:
            end_all_on_errors(self.comm)
            bound_threads(self.comm.py2f())
        self._shares = Shares(self.comm, group)

    @property
    def shares(self) -> Shares:
        """As the kernel takes them."""
        return self._shares

    def close(self) -> None:
        """Free what was made of the communicator; collective."""
        self._shares.close()

    @property
    def first(self) -> bool:
        """Whether this rank writes the checkpoint and the progress bar."""
        return bool(self.comm.rank == 0)

    def check_alike(self, call: str, **given: Any) -> None:
        """As :meth:`Problem.check_alike`, of these ranks."""
        check_alike(self.comm, call, given)

    def check_same(self, facts: Facts) -> None:
        """Refuse a rank whose problem is another one, which it may be with meshes that are made anew.

        Raises
        ------
        SceneError
            What differs, on all ranks.
        """
        mine = json.loads(json.dumps(facts))
        for rank, different in enumerate(exchanged(self.comm, differences(self._shares.told(mine), mine))):
            if different:
                more = f", and {len(different) - 4} more" if len(different) > 4 else ""
                raise SceneError(
                    f"points_comm: rank {rank} has another problem than rank 0, they differ in: "
                    f"{'; '.join(different[:4])}{more}: assemble the same scene on all ranks (read a mesh "
                    "from a file instead of making it on each, if it comes out differently)"
                )

    def told(self, value: Any) -> Any:
        """What the first rank says."""
        return self._shares.told(value)

    def joined(self, own: list[Any]) -> list[Any]:
        """The lists of all ranks, or groups, one after the other."""
        return self._shares.joined(own)


def point_ranks(where: str, problem: Problem, points_comm: Any) -> PointRanks | None:
    """The ranks that a user wants points spread over; None: none are given."""
    if points_comm is None:
        return None
    wanted = "give an mpi4py communicator, e.g. MPI.COMM_WORLD, or None"
    check_optional_kind(where, "points_comm", points_comm, MPI.Intracomm, wanted)
    if points_comm == MPI.COMM_NULL:
        raise SceneError(f"{where}: points_comm is MPI.COMM_NULL, or was freed: {wanted}")
    return PointRanks(where, problem, points_comm)


def check_given_alike(
    problem: Problem, call: str, points_comm: Any = None, laws: bool = False, **given: Any
) -> None:
    """As :meth:`Problem.check_alike`, of the ranks that solve points together, too, if there are."""
    problem.check_alike(call, laws=laws, **given)
    if isinstance(points_comm, MPI.Intracomm) and points_comm != MPI.COMM_NULL:
        check_alike(own_communicator(points_comm), call, given)


@contextmanager
def agreed_over(ranks: PointRanks | None) -> Iterator[None]:
    """Work that ranks do each for itself: if it fails on one, all raise."""
    with agreement(None if ranks is None else ranks.comm):
        yield


@contextmanager
def one_answer(ranks: PointRanks | None) -> Iterator[None]:
    """A walk over ranks: what another rank has failed with, as the error of a scene."""
    try:
        yield
    except RemoteError as error:
        if ranks is None:  # the parts are on ranks, not the points
            raise
        raise SceneError(str(error)) from error


@contextmanager
def points_shown(
    what: str, count: int, shown: bool, problem: Problem, ranks: PointRanks | None
) -> Iterator[Callable[[int], None]]:
    """A progress bar of a walk over points, on one rank; what is yielded is called with the iterations of
    each point."""
    iterations = 0
    shown = shown and (problem.rank == 0 if ranks is None else ranks.first)
    with Bar(count, what, "point", shown, stays=True) as bar:

        def step(more: int) -> None:
            nonlocal iterations
            iterations += more
            bar.step(iterations=iterations)

        if ranks is not None:
            ranks.shares.taken = lambda _, more: step(more)
        yield step
