"""Answers at many points: over a grid of parameter sets, and what sweeps and samplings share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from latin_core import State, SweepPoints

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.kernel.bridge import KernelLaws
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.value import Value

__all__ = ["PointFields", "PointResults", "SweepResult", "in_time"]

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


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(Value, PointResults):
    """Answers over the grid; every array has the grid's shape first, then the time steps of a history.

    Attributes
    ----------
    axes
        Swept parameter -> its values, in the order of the axes.
    points
        Raw arrays by point number (C order of the grid).
    seconds
        Wall time: ``setup``, ``first`` (first point), ``rest``.
    solver, laws
        The factorised structure, and the laws where nothing is swept.
    """

    problem: Problem
    plan: Plan
    axes: Mapping[str, Array]
    points: SweepPoints
    seconds: Mapping[str, float]
    solver: Solver
    laws: KernelLaws

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
        fields = self.solver.displacements(self.laws, state, self.plan.amplitudes)
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
