"""Multiresolution: a grid of parameter sets, each solved from its neighbours' interface states."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import (
    Iteration,
    Options,
    Problem as Kernel,
    State,
    Summary,
    SweepPoints,
    SweptParameter,
    snake_order,
    sweep as kernel_sweep,
)

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.fingerprint import fingerprint
from dolfinx_frontend.kernel.running import Interrupt, report_points
from dolfinx_frontend.plan.plan import Direction, Method, Plan, make_plan

__all__ = ["PointFields", "SweepResult", "sweep"]

_log = logging.getLogger(__name__)

Key = str | tuple[str, ...]

STATUSES = ("converged", "max_iterations", "stagnated", "diverged", "interrupted")
"""How an iteration ends, from the best to the worst."""


class PointResults(ABC):
    """Answers at many points, of which Ctrl-C may have left some out; arrays have the points' shape first."""

    problem: Problem
    plan: Plan
    points: SweepPoints

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Shape of the points."""

    @property
    def iterations(self) -> npt.NDArray[np.int64]:
        """Global stages of every point, -1 where it was not reached."""
        return self.points.iterations.reshape(self.shape)

    @property
    def error(self) -> Array:
        """Estimated relative error of every point, NaN where it was not reached."""
        return self.points.error.reshape(self.shape)

    @property
    def finished(self) -> npt.NDArray[np.bool_]:
        """Which points were solved; at the others fields are NaN."""
        reached: npt.NDArray[np.bool_] = self.iterations >= 0
        return reached

    @property
    def complete(self) -> bool:
        """Whether all points were solved: Ctrl-C leaves those that are."""
        return bool(self.finished.all())

    @property
    def status(self) -> str:
        """The worst of the points, as :attr:`Result.status`; ``"interrupted"`` if one was not reached."""
        return max((str(s) or "interrupted" for s in self.points.status), key=STATUSES.index)

    def _field(self, store: dict[str, Array], interface: str) -> Array:
        if interface in self.plan.active:
            self.problem.here(interface)
        if interface not in store:
            raise unknown_name("active interface", interface, store, type(self).__name__)
        return in_time(self.plan, store[interface], self.shape, self.problem.interfaces[interface])

    def force(self, interface: str) -> Array:
        """Force per area on side 1 of an active interface, (points..., [T,] m, components), local frame."""
        return self._field(self.points.forces, interface)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 of an active interface, (points..., [T,] m, components), local frame."""
        return self._field(self.points.jumps, interface)

    def gathered(self, interface: str) -> tuple[Array, Array]:
        """Force and jump of an active interface on all ranks; collective."""
        return self.problem.everywhere(
            interface, lambda: (self.force(interface), self.jump(interface))
        )


@dataclass
class SweepResult(PointResults):
    """Answers over the grid; every array has the grid's shape first, then the time steps of a history.

    Attributes
    ----------
    axes
        Swept parameter -> its values, in the order of the axes.
    points
        Raw arrays by point number (C order of the grid).
    seconds
        Wall time: ``setup``, ``first`` (first point), ``rest``.
    """

    problem: Problem
    plan: Plan
    axes: dict[str, Array]
    points: SweepPoints
    seconds: dict[str, float]
    core: Kernel = field(repr=False)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def converged(self) -> npt.NDArray[np.bool_]:
        """Which points reached the tolerance."""
        status: npt.NDArray[np.bool_] = self.points.status == "converged"
        return status.reshape(self.shape)

    def output(self, name: str) -> Array:
        """What a function of `outputs` returned, (grid..., its own shape)."""
        if name not in self.points.outputs:
            raise unknown_name("output", name, self.points.outputs, "sweep")
        values = self.points.outputs[name]
        return values.reshape(*self.shape, *values.shape[1:])

    def displacements(self, *index: int) -> dict[str, Array]:
        """Substructure -> ([T,] n) unknowns at one point of the grid; interior fields are recovered here."""
        if self.points.states is None:
            raise SceneError("the states of the points were not kept: sweep with keep_states=True")
        data, traces = self.points.states[np.ravel_multi_index(index, self.shape)]
        state = State(np.asfortranarray(data), np.asfortranarray(traces))
        fields = self.core.displacements(state, self.plan.amplitudes)
        if self.plan.times is None:
            return {name: values[:, 0] for name, values in fields.items()}
        return {name: self.plan.in_time(values) for name, values in fields.items()}

    def __repr__(self) -> str:
        done = f"{int(self.finished.sum())} solved" + ("" if self.complete else " (INTERRUPTED)")
        total = int(self.iterations[self.finished].sum())
        return (
            f"SweepResult({' x '.join(str(n) for n in self.shape)} points, {done}, "
            f"{int(self.converged.sum())} converged, {total} iterations, "
            f"{sum(self.seconds.values()):.2f} s)"
        )


def in_time(plan: Plan, values: Array, shape: tuple[int, ...], interface: Interface) -> Array:
    """Fields of points (N, columns, rows) -> (shape..., [T,] m, components)."""
    if plan.times is not None:
        values = np.moveaxis(plan.in_time(np.swapaxes(values, 1, 2)), 0, 1)
        shape = (*shape, len(plan.times))
    return values.reshape(*shape, interface.num_points, -1)


def _axes(grid: Mapping[Key, Sequence[float]]) -> dict[tuple[str, ...], Array]:
    axes = {}
    for key, values in grid.items():
        names = (key,) if isinstance(key, str) else tuple(key)
        data = np.asarray(values, dtype=np.float64)
        if data.ndim != 1 or data.size == 0 or not np.all(np.isfinite(data)):
            raise SceneError(
                f"sweep over {', '.join(names)}: give a list of finite numbers, got {values!r}"
            )
        axes[names] = data
    if not axes:
        raise SceneError("sweep: the grid is empty; give {'interface.parameter': values}")
    return axes


def sweep(
    problem: Problem,
    grid: Mapping[Key, Sequence[float]],
    *,
    method: Method = "auto",
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    checkpoint: str | Path | None = None,
    progress: bool = True,
    callback: Callable[[Iteration], None] | None = None,
    keep_states: bool = False,
    times: npt.ArrayLike | None = None,
    keep_fields: bool = True,
    outputs: Mapping[str, Callable[[PointFields], npt.ArrayLike]] | None = None,
) -> SweepResult:
    """Solve for every point of a grid of law parameters.

    The grid is walked so that neighbours in the order differ in one parameter by one step; each
    point starts from the combination of the nearest solved interface states that leaves the
    smallest residual.

    Parameters
    ----------
    grid
        ``"interface.parameter"`` -> values. A tuple of names is one axis: all of them take its
        values, in the units of the law (totals where the law is given as a total).
    method, active, direction, options, plan
        As for :func:`solve`; swept interfaces are always active.
    checkpoint
        File of finished points. If it exists they are not solved again: an interrupted sweep goes
        on.
    progress
        True: a progress bar if on a terminal.
    callback
        Called after every iteration; it may raise StopIteration to end the sweep with what is done so far.
    keep_states
        Keep the interface states, from which displacements can be recovered.
    times
        Times (T,) of a load history. A swept value that changes in time keeps its amplitude.
    keep_fields
        Keep force and jump of the active interfaces at every point: N x T x rows numbers each.
    outputs
        Name -> function of the interface fields of a point; only what it returns (a number or an array) is
        kept, where all fields would be too many.

    Raises
    ------
    SceneError
        Unknown parameter, empty grid, inadmissible value.
    CheckpointError
        The checkpoint is damaged or of another sweep.
    KeyboardInterrupt
        At a second Ctrl-C. The first one returns the points that are finished, ``complete`` is False then.
    """
    if checkpoint is not None:
        problem.on_one_rank("a checkpoint")
    axes = _axes(grid)
    names = [name for key in axes for name in key]
    targets: dict[str, tuple[str, str]] = {}
    for name in names:
        interface, _, parameter = name.rpartition(".")
        if interface not in problem.interfaces or name not in problem.law_parameters:
            raise unknown_name("parameter", name, problem.law_parameters, "sweep")
        if name in targets:
            raise SceneError(f"sweep: {name!r} is on two axes")
        targets[name] = (interface, parameter)
    if plan is None:
        swept = {interface for interface, _ in targets.values()}
        plan = make_plan(problem, method, active, swept, direction, options, times=times)
    missing = [name for name, (interface, _) in targets.items() if interface not in plan.active]
    if missing:
        raise SceneError(f"sweep: the plan eliminates the interface of {', '.join(missing)}")

    mesh = np.meshgrid(*axes.values(), indexing="ij")
    parameters = []
    for key, values in zip(axes, mesh, strict=True):
        for name in key:
            interface, parameter = targets[name]
            kernel_name, pattern, factors = bridge.kernel_values(
                problem.interfaces[interface], parameter, values.reshape(1, -1)
            )
            if parameter in ("normal", "tangential") and values.min() < 0.0:
                raise SceneError(
                    f"sweep: {name!r} takes the value {values.min():g}: a stiffness must be >= 0"
                )
            pattern, columns = _through_time(problem, plan, interface, parameter, pattern)
            parameters.append(SweptParameter(interface, kernel_name, pattern, factors, columns))

    began = perf_counter()
    core = bridge.build(problem, plan)
    setup = perf_counter() - began
    order = snake_order([len(values) for values in axes.values()])
    header = None
    if checkpoint is not None:
        header = {
            "fingerprint": fingerprint(problem, plan, parameters),
            "grid": {", ".join(key): values.tolist() for key, values in axes.items()},
            "rtol": plan.options.rtol,
            "criterion": plan.options.criterion,
            "kept": [keep_fields, *(outputs or {})],
        }
    started = perf_counter()
    first = 0.0
    iterations = 0
    shown = progress and problem.rank == 0

    def point_done(point: int, summary: Any) -> None:
        nonlocal first, iterations
        first = first or perf_counter() - started
        iterations += summary.iterations
        warn_unconverged("sweep point", point, summary)
        bar.step(iterations=iterations)

    with Interrupt() as interrupt, Bar(len(order), "sweep", "point", shown, stays=True) as bar:
        points = kernel_sweep(
            core,
            plan.amplitudes,
            parameters,
            order,
            [name for name in plan.active if name in problem.own.interfaces],
            plan.options,
            checkpoint,
            header,
            point_done,
            interrupt.watch(callback),
            keep_states,
            keep_fields,
            {name: _reading(problem, plan, call) for name, call in (outputs or {}).items()},
        )
    report_points("sweep", interrupt, points, checkpoint)
    seconds = {"setup": setup, "first": first, "rest": perf_counter() - started - first}
    named = {", ".join(key): values for key, values in axes.items()}
    return SweepResult(problem, plan, named, points, seconds, core)


def _reading(
    problem: Problem, plan: Plan, function: Callable[[PointFields], npt.ArrayLike]
) -> Callable[[int, dict[str, tuple[Array, Array]]], npt.ArrayLike]:
    """A user's function of a point as the kernel's sweep calls it."""

    def read(_: int, fields: dict[str, tuple[Array, Array]]) -> npt.ArrayLike:
        if problem.comm is not None:  # a function may need interfaces of other ranks
            fields = problem.gather({n: each for n, each in fields.items() if problem.speaks_for(n)})
        return function(PointFields(problem, plan, fields))

    return read


def _through_time(
    problem: Problem, plan: Plan, interface: str, parameter: str, pattern: Array
) -> tuple[Array, int]:
    """Pattern of a swept value with a block of rows a column, and the number of columns."""
    value = problem.interfaces[interface].law.varying.get(parameter)
    if value is None or plan.times is None:
        return pattern, 1
    if len(value.terms) > 1:
        raise SceneError(
            f"sweep: {interface}.{parameter} is a sum of values that change in time; sweep a single "
            "amplitude * value"
        )
    amplitude = value.terms[0][0]
    if plan.history == "patterns":
        factors = [1.0 if a == amplitude else 0.0 for a in plan.patterns]
    else:
        factors = [1.0 if amplitude is None else amplitude(t) for t in plan.times]
    return np.kron(np.reshape(factors, (-1, 1)), pattern), len(factors)


@dataclass(frozen=True)
class PointFields:
    """Interface fields at one point of a sweep; what a function of `outputs` is given."""

    problem: Problem
    plan: Plan
    _fields: dict[str, tuple[Array, Array]] = field(repr=False)

    def force(self, interface: str) -> Array:
        """Force per area on side 1 of an active interface, ([T,] m, components), local frame."""
        return self._field(interface, 0)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 of an active interface, ([T,] m, components), local frame."""
        return self._field(interface, 1)

    def _field(self, interface: str, which: int) -> Array:
        if interface not in self._fields:
            raise unknown_name("active interface", interface, self._fields, "sweep")
        block = self._fields[interface][which].T[None]
        return in_time(self.plan, block, (), self.problem.interfaces[interface])


def warn_unconverged(what: str, point: int, summary: Summary) -> None:
    """Log a point that did not reach the tolerance."""
    if summary.status != "converged":
        _log.warning(
            "%s %d ended as %s after %d iterations (estimated error %.1e)",
            what,
            point,
            summary.status,
            summary.iterations,
            summary.error,
        )
