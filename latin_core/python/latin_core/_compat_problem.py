"""Temporary: the mutable problem of old on a Structure and a current Laws value.

The frontend still speaks to the kernel in these words. It goes when the frontend hands Laws to every call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from latin_core import _core
from latin_core.sweep import SweepPoints
from latin_core.sweep import sweep as _sweep

__all__ = ["Problem", "sweep"]

Array = npt.NDArray[np.float64]


class Problem:
    """A Structure with laws that can be changed."""

    def __init__(self, **arguments: Any) -> None:
        self.structure = _core.Structure(**arguments)
        self.current = self.structure.laws()
        self._groups: dict[str, list[_core.LawColumns]] = {}

    def __repr__(self) -> str:
        return repr(self.structure).replace("Structure", "Problem", 1)

    rows = property(lambda self: self.structure.rows)
    total_rows = property(lambda self: self.structure.total_rows)
    loads = property(lambda self: self.structure.loads)
    unknowns = property(lambda self: self.structure.unknowns)
    active_unknowns = property(lambda self: self.structure.active_unknowns)
    macro_size = property(lambda self: self.structure.macro_size)
    weights = property(lambda self: self.structure.weights)
    directions = property(lambda self: self.structure.directions)
    costs = property(lambda self: self.structure.costs)

    def set_parameter(self, interface: str, parameter: str, values: Array) -> None:
        """Replace a parameter; columns that were set give their own still."""
        columns = {interface: self._groups[interface]} if interface in self._groups else None
        self.current = self.current.with_(parameters={interface: {parameter: values}}, columns=columns)

    def set_extra_loads(self, loads: Mapping[str, Array]) -> None:
        """Replace all extra loads."""
        self.current = self.current.with_(extra_loads=loads)

    def set_steps(self, steps: int) -> None:
        """Set the number of time steps."""
        self.current = self.current.with_(steps=steps)

    def set_columns(self, interface: str, groups: Sequence[_core.LawColumns]) -> None:
        """Replace the transforms of an interface."""
        self.current = self.current.with_(columns={interface: groups})
        self._groups[interface] = list(groups)

    def parameter(self, interface: str, parameter: str) -> Array:
        """A parameter as it was set."""
        return self.current.parameter(interface, parameter)

    def first_rows(self, interface: str) -> list[int]:
        """First row of each side."""
        return self.structure.first_rows(interface)

    def flexibility(self, interface: str) -> Array:
        """1/k1 + 1/k2."""
        return self.structure.flexibility(interface)

    def global_stage(self, data: Array, amplitudes: Array) -> Array:
        """Traces."""
        return self.structure.global_stage(self.current, data, amplitudes)

    def local_stage(self, data: Array, traces: Array) -> Array:
        """Residual."""
        return self.structure.local_stage(self.current, data, traces)

    def local_fields(self, interface: str, state: _core.State) -> tuple[Array, Array]:
        """Force and jump."""
        return self.structure.local_fields(self.current, interface, state)

    def resolve_samples(
        self, interface: str, free_jump: Array, parameters: Sequence[tuple[str, Array]]
    ) -> tuple[Array, Array]:
        """Force and jump, sample by sample."""
        return self.structure.resolve_samples(self.current, interface, free_jump, dict(parameters))

    def displacements(self, state: _core.State, amplitudes: Array) -> dict[str, Array]:
        """Displacements by substructure."""
        return self.structure.displacements(self.current, state, amplitudes)

    def solve(
        self,
        *,
        options: Any,
        amplitudes: Array,
        start: Sequence[_core.State],
        callback: Callable[[_core.Iteration], object] | None,
    ) -> tuple[_core.Summary, _core.State]:
        """Iterate with the laws as they are now."""
        return self.structure.solve(
            self.current, options=options, amplitudes=amplitudes, start=start, callback=callback
        )

    def sweep(
        self,
        *,
        point_callback: Callable[[int, _core.Summary, _core.State], object],
        **arguments: Any,
    ) -> None:
        """Solve for many parameter sets; the laws stay those of the last point."""

        def finished(point: int, laws: _core.Laws, summary: _core.Summary, state: _core.State) -> None:
            self.current = laws
            point_callback(point, summary, state)

        self.structure.sweep(self.current, point_callback=finished, **arguments)


class _Following:
    """A structure whose sweep leaves the laws of every point with a problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.rows = problem.structure.rows
        self.local_fields = problem.structure.local_fields

    def sweep(self, laws: _core.Laws, *, point_callback: Callable[..., object], **arguments: Any) -> None:
        def finished(point: int, of_point: _core.Laws, *rest: Any) -> None:
            self.problem.current = of_point
            point_callback(point, of_point, *rest)

        self.problem.structure.sweep(laws, point_callback=finished, **arguments)


def sweep(first: Any, *arguments: Any, **keywords: Any) -> SweepPoints:
    """:func:`latin_core.sweep.sweep` for a structure and laws, or for a problem."""
    if isinstance(first, Problem):
        following: Any = _Following(first)
        return _sweep(following, first.current, *arguments, **keywords)
    return _sweep(first, *arguments, **keywords)
