"""An assembly as a function of its uncertain numbers: ``f = problem.function("joint")``, then ``f(x)``.

Points are solved in batches on one factorisation, each from the nearest points that were solved before, now
or in an earlier call. Derivatives need no further solve, see :mod:`dolfinx_frontend.evaluate.gradients`.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, Never

import numpy as np
import numpy.typing as npt
from latin_core import Options, State, SweepPoints

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.checks import check_known, checked_name
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError, SceneWarning, telling, warn
from dolfinx_frontend.evaluate.evaluator import Design, Evaluator, Names, checkpoint_path, part_of
from dolfinx_frontend.evaluate.events import Response, response
from dolfinx_frontend.evaluate.gradients import Derivatives, Way, derivatives
from dolfinx_frontend.evaluate.inputs import Coordinates, Inputs
from dolfinx_frontend.evaluate.journal import BATCH, Journal, Solved, facts_of, settle
from dolfinx_frontend.evaluate.points import answer_of
from dolfinx_frontend.evaluate.reduced import FEWEST, Reduced, neighbours
from dolfinx_frontend.evaluate.sampling import short_steps
from dolfinx_frontend.formats.openturns import function_of
from dolfinx_frontend.kernel.fitting import sloped
from dolfinx_frontend.kernel.running import Interrupt, Interrupted
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.kernel.spread import PointRanks, agreed_over, point_ranks
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, check_settings
from dolfinx_frontend.results.accuracy import place_of
from dolfinx_frontend.results.sweep import SweepResult
from dolfinx_frontend.uncertainty.expressions import Operand

__all__ = ["Evaluation", "KinkWarning", "ProblemFunction", "check_handed_on", "problem_function"]

_log = logging.getLogger(__name__)

BYTES = 3e8
"""States and fields of the points of a batch."""
KEPT = 128
"""Solved points whose states are kept as starts, at most."""
KEPT_BYTES = 2e8
NEAREST = 24
"""Of these that a call with few points is started from."""

LOOSE = 1e-4
"""Relative residual of the systems of derivatives that is told."""

Failure = Literal["nan", "raise"]
FUNCTION = Names("function", "point")


class KinkWarning(SceneWarning):
    """A derivative was asked for where there is none: a contact just opens or closes, or starts to slip."""


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """What a function is at some points.

    Attributes
    ----------
    values
        (N, quantities); NaN where a point did not converge.
    statuses
        (N,) ``"converged"``, or how a point ended instead, see :attr:`Result.status`.
    places
        (N,) where the largest error is.
    error
        (N,) estimated relative errors.
    iterations
        (N,) global stages; 0 for what was known from an earlier call.
    """

    values: Array
    statuses: npt.NDArray[np.str_]
    places: npt.NDArray[np.str_]
    error: Array
    iterations: npt.NDArray[np.int64]

    @property
    def converged(self) -> Flags:
        """(N,) which points reached the tolerance."""
        return np.asarray(self.statuses == "converged")

    def __repr__(self) -> str:
        good, total = int(self.converged.sum()), int(self.iterations.sum())
        return f"Evaluation({len(self.values)} points, {good} converged, {total} iterations)"


@dataclass(eq=False)
class _Known:
    """A point that was solved."""

    x: Array
    state: State
    values: Array
    status: str
    place: str
    error: float


class ProblemFunction:
    """An assembly as a vectorised function of law parameters, loads and random numbers.

    ``f(x)`` takes points (N, inputs) and returns (N, quantities); of one point (inputs,) it returns
    (quantities,). It solves the assembly as it is, contact and slip included: nothing is fitted.

    Attributes
    ----------
    inputs, outputs
        Names of the columns.
    problem, plan, solver
        What is solved, how, and on which factors.
    solves
        Points that were solved so far, those of the checkpoint included.
    seconds
        Spent in solves and in derivatives.
    """

    def __init__(
        self,
        inputs: Inputs,
        quantities: Mapping[str, Response],
        plan: Plan,
        on_failure: Failure = "nan",
        checkpoint: Path | None = None,
        ranks: PointRanks | None = None,
    ) -> None:
        self._ranks = ranks
        self._inputs = inputs
        self._responses = tuple(quantities.values())
        self.inputs, self.outputs = inputs.names, tuple(quantities)
        self.problem, self.plan, self.on_failure = inputs.problem, plan, on_failure
        self._evaluator = Evaluator(FUNCTION, inputs.problem, plan, ranks=ranks)
        self.solves = 0
        self.seconds = 0.0
        self._known: OrderedDict[bytes, _Known] = OrderedDict()
        size = 2 * 8 * max(self.solver.total_rows, 1) * plan.amplitudes.shape[1]  # alike on all ranks
        self._kept = int(min(KEPT, max(4, KEPT_BYTES // size)))
        fields = 2 * sum(i.num_points * i.dim for i in inputs.problem.interfaces.values()) * 8
        self._batch = int(max(1, BYTES // (size + fields * plan.steps + 1)))
        self._warned: set[str] = set()  # warnings that were given
        self._looked = False
        self._reduced: Reduced | None = None
        self._journal: Journal | None = None
        self._written = checkpoint is not None
        if ranks is not None:
            facts = facts_of(inputs, quantities, plan, codes=False)
            ranks.check_same(facts)
        if checkpoint is not None:
            with agreed_over(ranks):
                if ranks is None or ranks.first:
                    self._journal = Journal.of(checkpoint, inputs, quantities, self.solver)
            self._batch = min(self._batch, BATCH)
            settle(self.solver)

    @property
    def solver(self) -> Solver:
        """The factors."""
        return self._evaluator.solver

    @property
    def dimension(self) -> int:
        """Number of inputs."""
        return self._inputs.dimension

    @property
    def nominal(self) -> Array:
        """(inputs,) what the inputs are in the scene, random ones at their means."""
        return self._inputs.nominal()

    def __repr__(self) -> str:
        return (
            f"ProblemFunction({', '.join(self.outputs)} of {', '.join(self.inputs)}; {self.solves} points "
            "solved, "
            f"{self.seconds:.2f} s)"
        )

    @together("the function")
    def __call__(self, x: npt.ArrayLike) -> Array:
        """Values (N, quantities) at points (N, inputs), or (quantities,) at one point (inputs,).

        Raises
        ------
        SceneError
            Wrong shapes, a value that makes no law (a negative stiffness), or, with ``on_failure="raise"``,
            a point that did not converge.

        Warns
        -----
        SceneWarning
            Points that did not converge, with their numbers and places: their values are NaN.
        """
        found = self.evaluate(x)
        lost = np.flatnonzero(~found.converged)
        if len(lost):
            text = self._told(found, lost, len(found.values))
            if self.on_failure == "raise":
                raise SceneError(text)
            warn(text + "; their values are NaN", SceneWarning)
        return found.values if np.ndim(x) > 1 else found.values[0]

    def _told(self, found: Evaluation, lost: Any, count: int) -> str:
        each = [
            f"point {n} {found.statuses[n]}" + (f" in {found.places[n]}" if found.places[n] else "")
            for n in lost[:3]
        ]
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        return (
            f"function: {len(lost)} of {count} points did not converge: {', '.join(each)}{more}; raise "
            "options=Options(max_iterations=...) or lower rtol"
        )

    @together("evaluate")
    def evaluate(self, x: npt.ArrayLike) -> Evaluation:
        """Values at points (N, inputs) with the status of each; never warns of a status."""
        points = self._inputs.checked(x)
        self.problem.check_alike("function", points=points)
        if self._ranks is not None:
            self._ranks.check_alike("function", points=points)
        began = perf_counter()
        count = len(points)
        found = Evaluation(
            np.full((count, len(self.outputs)), np.nan),
            np.full(count, "", dtype="<U16"),
            np.full(count, "", dtype="<U64"),
            np.full(count, np.nan),
            np.zeros(count, dtype=np.int64),
        )
        new = []
        for k, point in enumerate(points):
            known = self._known.get(point.tobytes())
            if known is None:
                new.append(k)
                continue
            found.values[k], found.statuses[k], found.places[k] = known.values, known.status, known.place
            found.error[k] = known.error
        combined = self._combined(points[new]) if new else None
        if combined is not None:
            which, (values, error) = np.array(new), combined
            good = error <= self.plan.options.rtol
            found.values[which[good]], found.error[which[good]] = values[good], error[good]
            found.statuses[which[good]] = "converged"
            self.solves += int(good.sum())
            new = list(which[~good])
        for first in range(0, len(new), self._batch):
            self._solve(points, np.array(new[first : first + self._batch]), found)
        found.values[~found.converged] = np.nan
        self.seconds += perf_counter() - began
        return found

    def _solve(self, points: Array, which: npt.NDArray[np.int64], into: Evaluation) -> None:
        """Solve some points and read them, or take them from the file."""
        x = points[which]
        solved = None if self._journal is None else self._journal.batch(x)
        if self._ranks is not None and self._written:
            solved = self._ranks.told(solved)
        if solved is None:
            with Interrupt() as interrupt:
                solved = self._solved(x, interrupt)
                with agreed_over(self._ranks):
                    if self._journal is not None:
                        self._journal.add(solved)
            if interrupt.told:  # too late to stop the kernel
                self._end(len(x), len(x))
        self.solves += len(x)
        into.values[which], into.statuses[which] = solved.values, solved.statuses
        into.places[which], into.error[which] = solved.places, solved.error
        into.iterations[which] = solved.iterations
        for k, data, traces in zip(solved.kept, solved.data, solved.traces, strict=True):
            state = State(np.asfortranarray(data), np.asfortranarray(traces))
            self._known[x[k].tobytes()] = _Known(
                x[k].copy(), state, solved.values[k], "converged", str(solved.places[k]),
                float(solved.error[k]),
            )  # fmt: skip
        while len(self._known) > self._kept:
            self._known.popitem(last=False)

    def _combined(self, x: Array) -> tuple[Array, Array] | None:
        """Values (N, quantities) of many points and their errors, NaN where these are too large.

        As combinations of solved ones, see :mod:`.reduced`; None: laws that are no springs, or few points.
        """
        if self._journal is not None or len(x) < FEWEST:
            return None
        with agreement(self.problem.comm):
            parameters = self._inputs.parameters(self.plan, x)
        if not self._looked:
            self._looked, self._reduced = True, Reduced.of(self.solver, parameters)
        if self._reduced is None:
            return None

        def solved(reduced: Reduced, which: Ints) -> tuple[Array, Array]:
            mine = [replace(p, values=np.ascontiguousarray(p.values[:, which])) for p in parameters]

            def read(points: SweepPoints, own: slice) -> Array:
                answer = answer_of(self.problem, self.plan, self.solver, points, part_of(mine, own))
                return self._read(answer, x[which[own]])

            return reduced.solve(mine, read)

        groups = neighbours(x)
        if len(groups) == 1:
            return solved(self._reduced, groups[0])
        values, errors = np.full((len(x), len(self.outputs)), np.nan), np.full(len(x), np.inf)
        for which in groups:  # near ones have so much in common that a basis for each is smaller by far
            reduced = Reduced.of(self.solver, parameters)
            assert reduced is not None  # as the first one
            values[which], errors[which] = solved(reduced, which)
        return values, errors

    def _solved(self, x: Array, interrupt: Interrupt) -> Solved:
        """Points (n, inputs), solved."""
        starts = self._starts(x)
        every = np.vstack([x, *(each.x for each in starts)])
        with agreed_over(self._ranks), agreement(self.problem.comm):
            parameters = self._inputs.parameters(self.plan, every)
        if not parameters:
            raise SceneError(
                f"function: nothing that is solved depends on {', '.join(self.inputs)}: name other inputs, "
                "or solve it once and compare the answer with their distributions"
            )
        scale, inputs = np.ptp(every, axis=0), self._inputs
        scale[scale == 0.0] = 1.0
        own = part_of(parameters, slice(0, len(x)))
        with telling(self._warned):
            answer = self._evaluator.answers(
                Design(parameters, short_steps(x / scale), lambda k: inputs.problem_at(x[k]), inputs.acts),
                lambda points, _: answer_of(self.problem, self.plan, self.solver, points, own),
                told="none",
                interrupt=interrupt,
                keep_states=True,
                start={len(x) + k: each.state for k, each in enumerate(starts)},
            )
        solved = answer.points
        if np.any(solved.iterations < 0):
            self._end(int((solved.iterations >= 0).sum()), len(x))
        with agreed_over(self._ranks):
            values = self._read(answer, x)
        # of a large batch those at the end, which are neighbours of each other, would do little good
        spaced = np.linspace(0, len(x) - 1, min(len(x), self._kept)).round().astype(np.int64)
        kept_ones = np.array(
            [k for k in np.unique(spaced) if solved.status[k] == "converged"], dtype=np.int64
        )
        assert solved.states is not None  # asked for
        states = solved.states[kept_ones]
        bodies = self.solver.bodies
        return Solved(
            x.copy(),
            values,
            np.array(solved.status, dtype="<U16"),
            np.array([place_of(self.plan, bodies, each) for each in solved.worst], dtype="<U64"),
            np.array(solved.error, dtype=np.float64),
            np.array(solved.iterations, dtype=np.int64),
            kept_ones,
            states[:, 0],
            states[:, 1],
        )

    def _end(self, done: int, count: int) -> Never:
        """End a call that Ctrl-C has interrupted."""
        kept = "; the checkpoint has all whole batches: the same call goes on" if self._written else ""
        raise Interrupted(f"function: interrupted after {done} of {count} points{kept}")

    def _starts(self, x: Array) -> list[_Known]:
        """Solved points near some points, which these are started from."""
        every = list(self._known.values())
        most = min(len(every), max(NEAREST, len(x)))
        if most == len(every):
            return every
        known = np.array([each.x for each in every])
        scale = np.ptp(np.vstack([known, x]), axis=0)
        scale[scale == 0.0] = 1.0
        distance, _ = spatial.cKDTree(x / scale).query(known / scale)
        return [every[k] for k in np.argsort(distance, kind="stable")[:most]]

    def _read(self, answer: SweepResult, x: Array) -> Array:
        """The quantities (N, quantities) of an answer at points (N, inputs)."""
        values = self._inputs.values(x) if any(each.random for each in self._responses) else {}
        leaves = {id(leaf): leaf for each in self._responses for leaf in each.readings}
        read = {key: leaf.read(answer) for key, leaf in leaves.items()}
        found = [np.broadcast_to(each.at(read, values), (len(x),)) for each in self._responses]
        return np.column_stack(found).astype(np.float64)

    # --- derivatives ------------------------------------------------------------------------------
    @together("gradient")
    def gradient(self, x: npt.ArrayLike) -> Array:
        """Derivatives (N, quantities, inputs) at points (N, inputs), or (quantities, inputs) at one point.

        Warns
        -----
        KinkWarning
            At points where a contact just opens or closes, or starts to slip: there is no derivative, and
            the value is between those of the two sides.

        Raises
        ------
        SceneError
            A point that does not converge.
        """
        points = self._inputs.checked(x)
        found = [self.derivatives(point) for point in points]
        told = [
            f"point {k} along {self.inputs[i]}" + (f" ({each.places[i]})" if each.places[i] else "")
            for k, each in enumerate(found)
            for i in np.flatnonzero(each.kinks)
        ]
        if told:
            more = f" and {len(told) - 3} more" if len(told) > 3 else ""
            warn(f"function: no derivative at a kink: {', '.join(told[:3])}{more}", KinkWarning)
        loose = max((each.residual for each in found), default=0.0)
        if loose > LOOSE:
            warn(
                f"function: derivatives are not better than their linear systems, which leave {loose:.1e} of "
                "their right-hand sides",
                SceneWarning,
            )
        values = np.array([each.values for each in found]).reshape(-1, len(self.outputs), self.dimension)
        return values if np.ndim(x) > 1 else np.asarray(values[0])

    @together("derivatives")
    def derivatives(self, x: npt.ArrayLike, way: Way | None = None) -> Derivatives:
        """Derivatives at one point (inputs,), with the inputs along which there is a kink; never warns of
        these.

        Parameters
        ----------
        way
            ``"direct"``: a linear system for each input, ``"adjoint"``: one for each quantity; None: what has
            fewer. At kinks, over several ranks and for readings of very many numbers there is no adjoint, and
            ``way`` of what is returned says so.

        Raises
        ------
        SceneError
            The point does not converge.
        """
        point = self._inputs.checked(x)
        if way is not None:
            check_known("way", way, ("direct", "adjoint"), "function")
        if len(point) != 1:
            raise SceneError(f"function: derivatives of {len(point)} points; give one, (inputs,)")
        found = self.evaluate(point)  # also where the file has the derivatives: the same starts follow
        if not found.converged[0]:
            raise SceneError(self._told(found, [0], 1))
        if self._ranks is None:
            return self._derivatives(point[0], way)
        result = None
        with agreed_over(self._ranks):  # the last digits of all that follows are those of one rank
            if self._ranks.first:
                result = self._derivatives(point[0], way)
        said: Derivatives = self._ranks.told(result)
        return said

    def _derivatives(self, point: Array, way: Way | None) -> Derivatives:
        asked = way is not None
        if self._journal is not None and not asked and (written := self._journal.slopes(point)) is not None:
            return written
        began = perf_counter()
        known = self._known[point.tobytes()]
        count = len(self.outputs)
        if self.solver.space is not None:  # an adjoint has other forces than those that its basis is for
            way = "direct"
            every = range(self.dimension)
            around = self._inputs.around(point, every, self._inputs.steps(point))[0]
            parameters = self._inputs.parameters(self.plan, around)
            self._evaluator.solver = sloped(self.solver, self.plan.amplitudes, parameters)
        result = derivatives(self.solver, self._inputs, point, known.state, self._read, count, way)
        self.seconds += perf_counter() - began
        if self._journal is not None and not asked:
            self._journal.add_slopes(point, result)
        return result

    def close(self) -> None:
        """Release the checkpoint, so that another run can use it."""
        if self._journal is not None:
            self._journal.close()

    # --- for others -------------------------------------------------------------------------------
    def openturns(self) -> Any:
        """The function as an ``openturns.Function`` with its gradient.

        Raises
        ------
        SceneError
            OpenTURNS is not installed.
        """
        return function_of(self, self.gradient, self.inputs, self.outputs)


SETTINGS = ("method", "active", "direction", "options", "plan", "times", "checkpoint", "points_comm")
"""What other calls hand on to the function that they are made of."""


def check_handed_on(where: str, given: Mapping[str, Any]) -> None:
    """Refuse settings that are none."""
    for name in given:
        check_known("setting", name, SETTINGS, where)


def _named(where: str, quantities: Any) -> dict[str, Response]:
    """Quantities by name."""
    if isinstance(quantities, Mapping):
        return {checked_name(where, name): response(where, each) for name, each in quantities.items()}
    several = quantities if isinstance(quantities, list | tuple) else [quantities]
    found: dict[str, Response] = {}
    for each in several:
        one = response(where, each)
        name = one.name
        if name in found:
            raise SceneError(f"{where}: quantity {name!r} is there twice; give a dict {{name: quantity}}")
        found[name] = one
    if not found:
        raise SceneError(f"{where}: quantities = {quantities!r}; give one at least")
    return found


@together("function")
def problem_function(
    problem: Problem,
    quantities: Any,
    inputs: Sequence[str] | str | None = None,
    *,
    coordinates: Coordinates = "physical",
    on_failure: Failure = "nan",
    more: Sequence[Operand] = (),
    method: Method = "auto",
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    times: npt.ArrayLike | None = None,
    checkpoint: str | Path | None = None,
    points_comm: Any = None,
) -> ProblemFunction:
    """As :meth:`Problem.function`, which has the parameters; `more`: random numbers beside the problem's."""
    settings: dict[str, Any] = {"active": active, "direction": direction, "options": options, "times": times}
    check_problem("function", problem, plan)
    file = checkpoint_path("function", checkpoint)
    check_settings("function", plan, method, **settings)
    check_known("on_failure", on_failure, ("nan", "raise"), "function")
    named = _named("function", quantities)
    for each in named.values():
        each.check(problem)
    extra = [*more, *(r for each in named.values() for r in each.random)]
    own = Inputs.of(problem, inputs, coordinates, extra)
    problem.check_alike("function", quantities=named, inputs=own.names, coordinates=coordinates)
    ranks = point_ranks("function", problem, points_comm)
    if ranks is not None:
        ranks.check_alike(
            "function", quantities=named, method=method, checkpoint=file is None, inputs=own.names, **settings
        )
    with agreed_over(ranks):
        if plan is None:
            plan = own.plan(None, method=method, **settings)
        else:
            own.plan(plan)
    return ProblemFunction(own, named, plan, on_failure, file, ranks)
