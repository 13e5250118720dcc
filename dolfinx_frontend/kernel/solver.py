"""The factorised structure of a plan, and the only code that calls it.

The structure is constant, and every call brings its laws, which are a value. Results keep both and so stay
what they are, whatever is computed after them on the same factors.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, TypedDict, Unpack

import numpy as np
import numpy.typing as npt
from latin_core import (
    Beginning,
    Iteration,
    Laws,
    Linearised,
    Options,
    State,
    Structure,
    Summary,
    SweepPoints,
    SweptParameter,
)
from latin_core import sweep as kernel_sweep
from latin_core.points import Solved

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict, read_only
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.common.statuses import STOPPED
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.parts_checkpoint import Layout, PartsCheckpoint
from dolfinx_frontend.kernel.running import Interrupt
from dolfinx_frontend.kernel.spread import PointRanks, agreed_over, one_answer
from dolfinx_frontend.kernel.subspace import Answer, Subspace
from dolfinx_frontend.plan.plan import Plan

__all__ = ["Kept", "OfWalk", "Solver", "locked"]

_log = logging.getLogger(__name__)


class Kept(TypedDict, total=False):
    """What a walk over points keeps of them, and starts from; as :func:`latin_core.sweep` takes it."""

    keep_states: bool
    keep_fields: bool
    outputs: Mapping[str, Callable[[int, dict[str, tuple[Array, Array]]], npt.ArrayLike]] | None
    start: Mapping[int, State] | None


class OfWalk(Kept, total=False):
    """What a walk may be told beside the points."""

    header: dict[str, Any] | None
    progress: Callable[[int, Summary], None] | None
    callback: Callable[[Iteration], None] | None


class Solver:
    """Factorised bodies and active interfaces of a plan.

    Several threads may use one solver at once. Bodies that the solver `before` has as well, but for their
    interfaces, keep their factors.

    Attributes
    ----------
    problem, plan
        What was built.
    laws
        The laws of the plan, what is random at its mean.
    bodies
        Names of the parts of every body on this rank.
    acting
        Part on this rank -> loads and prescribed displacements; of a direct plan only.
    weights, directions
        (rows,) areas and search directions of the active interface points on this rank.
    costs
        Seconds, numbers and unknowns of every body.
    space
        The basis that the bodies move in; None: they have all of their unknowns.
    left
        Estimated relative error that the basis leaves in the answer that it was made for.
    """

    def __init__(
        self,
        problem: Problem,
        plan: Plan,
        before: Solver | None = None,
        space: Subspace | None = None,
    ) -> None:
        problem.check_alike(
            "factorise",
            laws=True,
            method=plan.method,
            active=plan.active,
            eliminated=plan.eliminated,
            columns=plan.columns,
            direction=plan.direction,
            options=plan.options,
            times=plan.times,
            history=plan.history,
        )
        self.problem = problem
        self.plan = plan
        known: Structure | None = None if before is None else before._core
        self.space, self.left = space, 0.0
        described: bridge.Description | None = None
        if space is not None:
            bodies, interfaces = space.described()
            described = space.bodies.described._replace(bodies=bodies, interfaces=interfaces)
        self._core: Structure
        with Bar(1, "factorise", "structure", problem.rank == 0):
            self._core, own, acting = bridge.build(problem, plan, known, described)
        self.acting = ReadOnlyDict(acting)
        every = [own] if problem.comm is None else exchanged(problem.comm, own)
        self.bodies = tuple(body for bodies in every for body in bodies)
        self._first_body = sum(len(bodies) for bodies in every[: problem.rank])
        with agreement(problem.comm):
            self.laws = bridge.laws(self._core, problem, plan)
        self._beginning = Beginning()
        self.weights = read_only(self._core.weights)
        self.directions = read_only(self._core.directions)
        self.costs = tuple(ReadOnlyDict(dict[str, Any](**cost)) for cost in self._core.costs)

    def __repr__(self) -> str:
        active = len(self.plan.active)
        return f"Solver({self.unknowns} unknowns, {self.rows} rows on {active} active interfaces)"

    @property
    def rows(self) -> int:
        """Rows of the interface fields on this rank."""
        return self._core.rows

    @property
    def total_rows(self) -> int:
        """Rows on all ranks."""
        return self._core.total_rows

    @property
    def loads(self) -> int:
        """Load patterns."""
        return self._core.loads

    @property
    def unknowns(self) -> int:
        """Unknowns of the factorised bodies."""
        return self._core.unknowns

    @property
    def active_unknowns(self) -> int:
        """Those on active interfaces."""
        return self._core.active_unknowns

    @property
    def macro_size(self) -> int:
        """Unknowns of the coarse problem."""
        return self._core.macro_size

    def run(
        self,
        laws: Laws,
        options: Options,
        amplitudes: Array,
        start: Sequence[State] = (),
        callback: Callable[[Iteration], None] | None = None,
        progress: bool = True,
        balanced: Callable[[int], bool] | None = None,
    ) -> tuple[Summary, State]:
        """Iterate; Ctrl-C ends the run with what is done so far.

        Parameters
        ----------
        amplitudes
            (load patterns, columns).
        start
            States to start from.
        callback
            Called after every iteration.
        progress
            A progress bar if on a terminal.
        balanced
            Whether anything can balance the loads of a column; called where something flies.
        """
        if self.problem.comm is None:
            self.problem.check_unchanged()
        noisy = _log.isEnabledFor(logging.DEBUG)
        shown = progress and self.problem.rank == 0
        with Interrupt() as interrupt, Bar(None, "solve", "iteration", shown) as bar:
            began = perf_counter()

            def each(iteration: Iteration) -> None:
                if iteration.number >= bar.done:  # the same one goes on
                    bar.step(error=shown_error(iteration.error))
                if noisy:
                    error = shown_error(iteration.error)
                    _log.debug("iteration %d: estimated error %s", iteration.number, error)
                if callback is not None:
                    callback(iteration)

            summary, state = self._core.solve(
                laws,
                options=options,
                amplitudes=amplitudes,
                start=list(start),
                callback=interrupt.watch(each),
                balanced=balanced,
            )
        seconds = perf_counter() - began
        text = "%s after %d iterations, estimated error %s, %.2f s"
        _log.info(text, summary.status, summary.iterations, shown_error(summary.error), seconds)
        if interrupt.told and summary.status not in STOPPED:
            _log.warning("Ctrl-C came when the iteration had ended; press it twice to end the program")
        return summary, state

    def walk(
        self,
        laws: Laws,
        amplitudes: Array,
        parameters: Sequence[SweptParameter],
        order: Sequence[int],
        options: Options,
        *,
        checkpoint: str | Path | None = None,
        ranks: PointRanks | None = None,
        before: SweepPoints | None = None,
        check: Callable[[Sequence[Solved]], Sequence[float]] | None = None,
        **more: Unpack[OfWalk],
    ) -> SweepPoints:
        """Solve at many points, see :func:`latin_core.sweep`; `laws` hold where nothing is swept.

        Parameters
        ----------
        checkpoint
            File of finished points.
        ranks
            That solve the points together, each on a solver of its own.
        before, check
            Points that an earlier walk has left, and what says whether points are good enough to be kept:
            then the arrays are not locked yet.
        more
            See :class:`OfWalk`.
        """
        if self.problem.comm is None:
            self.problem.check_unchanged()
        own = self.problem.own.interfaces
        file: Any = None
        with agreed_over(ranks):
            if checkpoint is not None and (ranks is None or ranks.first):
                file = self.checkpoint(checkpoint, more.get("header") or {})
        with one_answer(ranks):
            points = kernel_sweep(
                self._core,
                laws,
                amplitudes,
                parameters,
                order,
                [name for name in self.plan.active if name in own],
                options,
                file,
                shares=None if ranks is None else ranks.shares,
                before=before,
                check=check,
                beginning=self._beginning if laws is self.laws else None,
                **more,
            )
        self._over_ranks(points)
        return points if check is not None else locked(points)

    def checkpoint(self, path: str | Path, header: Mapping[str, Any]) -> PartsCheckpoint:
        """A file of states, see :class:`PartsCheckpoint`; collective."""
        rows = {}
        for name in self.plan.active:
            if name in self.problem.own.interfaces:
                count = len(self.flexibility(name))
                starts = enumerate(self.first_rows(name))
                rows[name] = {side: (start, count) for side, start in starts if start >= 0}
        shape = self.rows, self.plan.amplitudes.shape[1]
        first, count = self._first_body, len(self.costs)
        layout = Layout(rows, shape, self.bodies[first : first + count], self.plan.active)
        return PartsCheckpoint(self.problem.comm, path, header, layout)

    def _over_ranks(self, points: SweepPoints) -> None:
        """Of the largest errors that the ranks have seen, the place of the largest; collective."""
        points.worst[points.worst[:, 1] >= 0, 1] += self._first_body
        comm = self.problem.comm
        if comm is None:
            return
        errors, places = zip(*exchanged(comm, (points.largest, points.worst)), strict=True)
        which = np.argmax(errors, axis=0)
        points.largest[:] = np.max(errors, axis=0)
        points.worst[:] = np.stack(places)[which, np.arange(len(which))]

    def displacements(self, laws: Laws, state: State, amplitudes: Array) -> dict[str, Array]:
        """Substructure on this rank -> unknowns (n, columns) of a state."""
        fields = self._core.displacements(laws, state, amplitudes)
        if self.space is not None:
            fields = self.space.expanded(fields)
        return {name: read_only(u) for name, u in fields.items()}

    def response_to(self, forces: Mapping[str, Array]) -> dict[str, Array]:
        """Displacements (n, columns) of the parts on this rank under forces (n, columns) and nothing else."""
        self._check_whole("what depends on other forces")
        return self._core.response_to(forces)

    def in_basis(self, laws: Laws, state: State, amplitudes: Array) -> Answer:
        """A state in the basis of the solver, see :meth:`Subspace.answer`."""
        assert self.space is not None
        return self.space.answer(self._core, laws, state, amplitudes)

    def residual(self, answer: Answer) -> Array:
        """What an answer in the basis leaves of the bodies' equations, see :meth:`Subspace.residual`."""
        assert self.space is not None
        return self.space.residual(self._core, answer)

    def _check_whole(self, what: str) -> None:
        """Refuse what a basis that was made for one answer does not have."""
        if self.space is not None:
            raise SceneError(
                f"backend 'multigrid' has a basis for one answer, and {what} is another one: solve with "
                "backend='cholmod'"
            )

    def local_fields(self, laws: Laws, interface: str, state: State) -> tuple[Array, Array]:
        """Force and jump (rows, columns) of an active interface; collective where it joins two ranks."""
        force, jump = self._core.local_fields(laws, interface, state)
        return read_only(force), read_only(jump)

    def fields_of_cuts(self, laws: Laws, state: State) -> dict[str, tuple[Array, Array]]:
        """Those of the interfaces between this rank and others, which both work out together: collective."""
        own = self.problem.own.interfaces
        return {name: self.local_fields(laws, name, state) for name in self.problem.cuts if name in own}

    def resolve_samples(
        self, laws: Laws, interface: str, free_jump: Array, parameters: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """Force and jump (rows, samples) of a law at given free jumps and parameters."""
        return self._core.resolve_samples(laws, interface, free_jump, parameters)

    def flexibility(self, interface: str) -> Array:
        """1 / k1 (+ 1 / k2) of an interface, (rows,)."""
        return self._core.flexibility(interface)

    def first_rows(self, interface: str) -> list[int]:
        """First row of each side of an interface in the interface fields."""
        return self._core.first_rows(interface)

    def global_stage(self, laws: Laws, data: Array, amplitudes: Array) -> Array:
        """Traces (rows, columns) of the bodies under interface data."""
        return self._core.global_stage(laws, data, amplitudes)

    def local_stage(self, laws: Laws, data: Array, traces: Array) -> Array:
        """Residual (rows, columns) of the laws: what the next data differ by."""
        return self._core.local_stage(laws, data, traces)

    def linearised(self, laws: Laws, state: State, transposed: bool = False) -> Linearised:
        """The structure with the tangents of its laws at a state, factorised; transposed, for adjoints.

        A basis has to know the slopes that are asked for, see :func:`dolfinx_frontend.kernel.fitting.sloped`.

        Raises
        ------
        NumericalError
            It is not stable with them, or they would cost more than the bodies did.
        """
        if transposed:
            self._check_whole("an adjoint")
        return self._core.linearised(laws, state, transposed)


def locked(points: SweepPoints) -> SweepPoints:
    """Points whose arrays nobody changes any more."""
    blocks: list[Any] = [points.iterations, points.error, points.seconds, points.status, points.states]
    blocks += [points.worst, points.largest]
    blocks += [*points.forces.values(), *points.jumps.values(), *points.outputs.values()]
    for block in blocks:
        if block is not None:
            block.flags.writeable = False
    points.forces, points.jumps = ReadOnlyDict(points.forces), ReadOnlyDict(points.jumps)
    points.outputs = ReadOnlyDict(points.outputs)
    points.histories = ReadOnlyDict(points.histories)
    return points
