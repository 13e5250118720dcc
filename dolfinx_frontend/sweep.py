"""Multiresolution: a grid of parameter sets, each solved from its neighbours' interface states."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_frontend import bridge
from dolfinx_frontend.assembly import Problem
from dolfinx_frontend.errors import SceneError, unknown_name
from dolfinx_frontend.plan import Direction, Method, Plan, make_plan
from latin_core import (
    Iteration,
    Options,
    State,
    Summary,
    SweepPoints,
    SweptParameter,
    snake_order,
)
from latin_core import Problem as Kernel
from latin_core import sweep as kernel_sweep

__all__ = ["SweepResult", "sweep"]

Array = npt.NDArray[np.float64]
Key = str | tuple[str, ...]

_log = logging.getLogger(__name__)


@dataclass
class SweepResult:
    """Answers over the grid; every array has the grid's shape first.

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
    def iterations(self) -> npt.NDArray[np.int64]:
        """Global stages of every point."""
        return self.points.iterations.reshape(self.shape)

    @property
    def error(self) -> Array:
        """Estimated relative error of every point."""
        return self.points.error.reshape(self.shape)

    @property
    def converged(self) -> npt.NDArray[np.bool_]:
        """Which points reached the tolerance."""
        status: npt.NDArray[np.bool_] = self.points.status == "converged"
        return status.reshape(self.shape)

    def _field(self, store: dict[str, Array], interface: str) -> Array:
        if interface not in store:
            raise unknown_name("active interface", interface, store, "sweep")
        points = self.problem.interfaces[interface].num_points
        return store[interface].reshape(*self.shape, points, -1)

    def force(self, interface: str) -> Array:
        """Force per area on side 1 of an active interface, (grid..., m, components), local."""
        return self._field(self.points.forces, interface)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 of an active interface, (grid..., m, components), local frame."""
        return self._field(self.points.jumps, interface)

    def displacements(self, *index: int) -> dict[str, Array]:
        """Substructure -> (n,) unknowns at one point of the grid; interior fields are recovered here."""
        if self.points.states is None:
            raise SceneError("the states of the points were not kept: sweep with keep_states=True")
        data, traces = self.points.states[np.ravel_multi_index(index, self.shape)]
        state = State(data.reshape(-1, 1), traces.reshape(-1, 1))
        fields = self.core.displacements(state, np.ones((1, 1)))
        return {name: values[:, 0] for name, values in fields.items()}

    def __repr__(self) -> str:
        done = int((self.points.iterations >= 0).sum())
        total = int(self.points.iterations[self.points.iterations >= 0].sum())
        return (
            f"SweepResult({' x '.join(str(n) for n in self.shape)} points, {done} solved, "
            f"{int(self.converged.sum())} converged, {total} iterations, "
            f"{sum(self.seconds.values()):.2f} s)"
        )


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


def fingerprint(problem: Problem, plan: Plan, parameters: Sequence[SweptParameter]) -> str:
    """Hash of what makes two runs the same: parts, loads, interfaces, laws, plan, swept values.

    Numbers count with nine digits, so that another order of summation is no other run.
    """
    digest = hashlib.sha256()

    def add(name: str, values: npt.ArrayLike) -> None:
        data = np.asarray(values, dtype=np.float64).ravel()
        size = float(np.abs(data).max(initial=0.0))
        digits = np.round(data / (size or 1.0), 9) + 0.0  # no negative zeros
        digest.update(f"{name} {data.size} {size:.9e}".encode() + digits.tobytes())

    for part in problem.substructures.values():
        add(part.name, part.size)
        for what in (part.volume, part.stiffness.norm(), part.load):
            add("part", what)
    for name, interface in problem.interfaces.items():
        fields = bridge.law_fields(interface)
        add(f"{name} {type(interface.law).__name__}", interface.weights)
        for parameter, values in sorted(fields.parameters.items()):
            add(parameter, values)
    for each in parameters:
        add(f"{each.interface} {each.parameter}", each.pattern)
        add("values", each.values)
    digest.update(f"{plan.method} {plan.active} {plan.direction}".encode())
    return digest.hexdigest()


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
        Called after every iteration.
    keep_states
        Keep the interface states, from which displacements can be recovered.

    Raises
    ------
    SceneError
        Unknown parameter, empty grid, inadmissible value.
    CheckpointError
        The checkpoint is damaged or of another sweep.
    """
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
        plan = make_plan(problem, method, active, swept, direction, options)
    missing = [name for name, (interface, _) in targets.items() if interface not in plan.active]
    if missing:
        raise SceneError(f"sweep: the plan eliminates the interface of {', '.join(missing)}")

    mesh = np.meshgrid(*axes.values(), indexing="ij")
    parameters = []
    for key, values in zip(axes, mesh, strict=True):
        for name in key:
            interface, parameter = targets[name]
            kernel_name, pattern = bridge.kernel_parameter(problem.interfaces[interface], parameter)
            if parameter in ("normal", "tangential") and values.min() < 0.0:
                raise SceneError(
                    f"sweep: {name!r} takes the value {values.min():g}: a stiffness must be >= 0"
                )
            parameters.append(SweptParameter(interface, kernel_name, pattern, values.reshape(1, -1)))

    began = perf_counter()
    core = bridge.build(problem, plan)
    setup = perf_counter() - began
    order = snake_order([len(values) for values in axes.values()])
    bar = Progress(len(order), "sweep") if progress else None
    started = perf_counter()
    first = 0.0

    def point_done(point: int, summary: Any) -> None:
        nonlocal first
        first = first or perf_counter() - started
        warn_unconverged("sweep point", point, summary)
        if bar is not None:
            bar.step(summary.iterations)

    try:
        points = kernel_sweep(
            core,
            np.ones((1, plan.columns)),
            parameters,
            order,
            plan.active,
            plan.options,
            checkpoint,
            {
                "fingerprint": fingerprint(problem, plan, parameters),
                "grid": {", ".join(key): values.tolist() for key, values in axes.items()},
                "rtol": plan.options.rtol,
                "criterion": plan.options.criterion,
            },
            point_done,
            callback,
            keep_states,
        )
    finally:
        if bar is not None:
            bar.close()
    seconds = {"setup": setup, "first": first, "rest": perf_counter() - started - first}
    named = {", ".join(key): values for key, values in axes.items()}
    return SweepResult(problem, plan, named, points, seconds, core)


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


class Progress:
    """Progress bar over points, silent when not on a terminal or without tqdm."""

    def __init__(self, total: int, what: str) -> None:
        try:
            from tqdm import tqdm  # type: ignore[import-untyped,unused-ignore]
        except ImportError:
            self._bar = None
        else:
            self._bar = tqdm(total=total, desc=what, unit="point", disable=None)
        self._iterations = 0

    def step(self, iterations: int) -> None:
        self._iterations += iterations
        if self._bar is not None:
            self._bar.set_postfix(iterations=self._iterations, refresh=False)
            self._bar.update()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
