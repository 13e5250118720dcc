"""The answer of one solve, and of a load history."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from latin_core import Problem as Kernel, State, Summary

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.values import stiffnesses
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan.cost import shown
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.scene.laws import Contact, Elastic, Law

if TYPE_CHECKING:
    from dolfinx_frontend.estimate.errors import Errors

__all__ = ["HistoryResult", "Result", "phase_seconds"]

_OF_RANDOM = ("field_moments", "force_moments", "quantity", "sobol", "truncation")
"""What only random answers have."""


@dataclass
class Result:
    """Answer of one solve.

    Attributes
    ----------
    problem, plan
        What was solved, and how.
    summary
        Status, iterations, estimated error, seconds.
    state
        Interface data and traces: a later solve may start from them.
    seconds
        Phase -> wall time: ``setup`` (reduction, factorisation, condensation), ``solve``.
    """

    problem: Problem
    plan: Plan
    summary: Summary
    state: State
    seconds: dict[str, float]
    core: Kernel = field(repr=False)
    _displacements: dict[str, Array] | None = field(default=None, repr=False)
    _cuts: dict[str, tuple[Array, Array]] = field(default_factory=dict, repr=False)
    _errors: Errors | None = field(default=None, repr=False)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _OF_RANDOM:
                raise AttributeError(
                    f"{type(self).__name__} has no {name!r}: the answer is deterministic; give a law a "
                    "random value and solve with chaos=Chaos(order), or sample with monte_carlo"
                )
            return object.__getattribute__(self, name)  # raises, with the reason if a property failed

    @property
    def status(self) -> str:
        """``"converged"``, ``"max_iterations"``, ``"stagnated"``, ``"diverged"``, ``"interrupted"``."""
        return self.summary.status

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached."""
        return self.summary.status == "converged"

    @property
    def iterations(self) -> int:
        """Global stages."""
        return self.summary.iterations

    @property
    def error(self) -> float:
        """Estimated relative error, in strain energy and in displacement of the interfaces."""
        return self.summary.error

    @property
    def displacements(self) -> dict[str, Array]:
        """Substructure -> (n,) unknowns; interior fields are recovered when first asked for."""
        if self._displacements is None:
            fields = self.core.displacements(self.state, self.plan.amplitudes)
            self._displacements = {name: fields[name][:, 0] for name in self.problem.substructures}
        return self._displacements

    def displacement(self, substructure: str) -> fem.Function:
        """Displacement of a substructure as a dolfinx function (length)."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        function = fem.Function(self.problem.substructures[substructure].V, name="displacement")
        function.x.array[:] = self.displacements[substructure]
        return function

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 (m, components), length, in the local frame."""
        return self._local(interface)[1]

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (m, components), in the local frame: column 0 is normal."""
        return self._local(interface)[0]

    def errors(self, quantity: Resultant | str | None = None) -> Errors:
        """Errors of the iteration, the chaos and the meshes, in the energy norm and in a quantity.

        The iteration is carried on for one digit, a chaos gets its next modes: about half the cost of the
        run without its factorisation. After ``solve(accuracy=...)`` they are there already.

        Parameters
        ----------
        quantity
            A :class:`Resultant`, the name of an interface (its normal force), ``"energy"``; None: what was
            asked for, or the energy norm.
        """
        from dolfinx_frontend.estimate.errors import errors  # which builds on this module

        return errors(self, quantity)

    def spent(self) -> str:
        """Where the time and the memory went, beside what the plan predicted, as a table."""
        return spent(self)

    def table(
        self,
        interfaces: Sequence[str] | str | None = None,
        step: int | None = -1,
        about: npt.ArrayLike | None = None,
    ) -> tables.Table:
        """Resultants, pressures and areas of the interfaces: ``print`` it, ``to_csv``, ``to_pandas``.

        Columns (see :mod:`dolfinx_frontend.results.tables` for signs): area; ``force_x`` ..., ``moment_x``
        ... on side 1, global axes; ``normal`` (tension > 0) and ``shear``, total; ``pressure_min``,
        ``_mean``, ``_max``; ``shear_max``; ``open_area`` (no pressure) and ``slip_area`` (friction at its
        limit) of contacts. Of interfaces that were eliminated as supports or glue, the reactions; their
        points carry no pressure that is known. Collective on several ranks.

        Parameters
        ----------
        interfaces
            Names; None: all.
        step
            Of a load history; None: all, one row each.
        about
            Point (d,) of the moments; None: the centroid of each interface.
        """
        return tables.summarise(tables.read(self).select(interfaces), step, about)

    def bolts(self, interfaces: Sequence[str] | str | None = None) -> tables.Table:
        """Bolt forces of a load history before and after loading, see
        :func:`dolfinx_frontend.results.tables.bolts`."""
        return tables.bolts(tables.read(self).select(interfaces))

    def save(self, path: str | Path, fields: bool = True) -> None:
        """Write the result to one HDF5 file, which :func:`dolfinx_frontend.load` reads in any process.

        Parameters
        ----------
        path
            ``.h5`` or ``.hdf5``; an existing file is replaced when the new one is complete.
        fields
            False: only what the tables need, no forces, jumps and displacements.

        Raises
        ------
        ResultFileError
            The file cannot be written.
        """
        from dolfinx_frontend.io import saved

        saved.save_result(path, self, tables.read(self), fields)

    @contextmanager
    def at_mean(self) -> Iterator[None]:
        """The factorised problem with its deterministic laws, as long as the context lasts."""
        yield

    def _local(self, name: str) -> tuple[Array, Array]:
        """Force and jump (m, components) of an interface."""
        if name not in self.problem.interfaces:
            raise unknown_name("interface", name, self.problem.interfaces, "result")
        interface = self.problem.here(name)
        if name in self.plan.active:
            force, jump = self._kernel_fields(name)
            points = interface.num_points
            return force.reshape(points, -1), jump.reshape(points, -1)
        return self.eliminated(interface, interface.law, self.displacements)

    def _kernel_fields(self, name: str) -> tuple[Array, Array]:
        return self._cuts[name] if name in self._cuts else self.core.local_fields(name, self.state)

    def gathered(self, interface: str) -> tuple[Array, Array]:
        """Force and jump of an interface as :meth:`force` and :meth:`jump` give them, on all ranks.

        Collective: to be called on all of them.
        """
        return self.problem.everywhere(
            interface, lambda: (self.force(interface), self.jump(interface))
        )

    def eliminated(
        self, interface: Interface, law: Law, displacements: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """Force and jump (m, components) of an interface that was assembled into the bodies."""
        fields = bridge.law_fields(interface, law)
        if fields.kind == "perfect":
            name = interface.name
            raise SceneError(
                f"interface {name!r} was eliminated ({self.plan.eliminated[name]}), its force is "
                f"not an unknown: solve with active=[{name!r}] to have it"
            )
        points = interface.num_points
        jump = sum(
            (
                sign * (interface.local_trace(i) @ displacements[side.substructure])
                for i, (side, sign) in enumerate(zip(interface.sides, (-1.0, 1.0), strict=False))
            ),
            start=np.zeros(interface.dim * points),
        ).reshape(points, -1)[:, : fields.components]
        if not isinstance(law, Elastic):
            return fields.parameters["force"].reshape(points, -1), jump
        stiffness = stiffnesses(interface, law)[:, : fields.components]
        imposed = fields.parameters["jump"].reshape(points, -1)
        return stiffness * (jump - imposed), jump

    def __repr__(self) -> str:
        steps = "" if self.plan.times is None else f"{len(self.plan.times)} time steps, "
        return (
            f"{type(self).__name__}({self.status}, {steps}{self.iterations} iterations, "
            f"estimated error {self.error:.1e}, {sum(self.seconds.values()):.2f} s)"
        )


@dataclass(repr=False)
class HistoryResult(Result):
    """Answer over a load history; every field has the time steps as its first axis."""

    _all: dict[str, Array] | None = field(default=None, repr=False)

    @property
    def times(self) -> Array:
        """(T,)."""
        assert self.plan.times is not None  # a history has them
        return self.plan.times

    @property
    def displacements(self) -> dict[str, Array]:
        """Substructure -> (T, n) unknowns; interior fields are recovered when first asked for."""
        if self._all is None:
            fields = self.core.displacements(self.state, self.plan.amplitudes)
            self._all = {n: self.plan.in_time(fields[n]) for n in self.problem.substructures}
        return self._all

    def displacement(self, substructure: str, step: int = -1) -> fem.Function:
        """Displacement of a substructure at a time step (the last by default) as a dolfinx function."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        function = fem.Function(self.problem.substructures[substructure].V, name="displacement")
        function.x.array[:] = self.displacements[substructure][step]
        return function

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 (T, m, components), length, in the local frame."""
        return self._local(interface)[1]

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (T, m, components), in the local frame: component 0 is normal."""
        return self._local(interface)[0]

    def work(self, interface: str) -> Array:
        """Work that an interface has taken up since the beginning, (T,), force * length.

        Integral of f . dj by the trapezoidal rule, exact for elastic interfaces.
        """
        force, jump = self._local(interface)
        before = np.zeros_like(force[:1])
        middle = 0.5 * (force + np.concatenate([before, force[:-1]]))
        return self._along(interface, middle, jump)

    def dissipation(self, interface: str) -> Array:
        """Work that friction has turned to heat since the beginning, (T,), force * length.

        Integral of f_t . dj_t with the force at the end of each step, where the law holds: exact for as
        long as the slip of a step keeps its direction.

        Raises
        ------
        SceneError
            The interface has no friction.
        """
        force, jump = self._local(interface)
        law = self.problem.interfaces[interface].law
        if not isinstance(law, Contact) or not law.rubs:
            raise SceneError(
                f"interface {interface!r}: {type(law).__name__} has no friction; work() is for every law"
            )
        return self._along(interface, force[..., 1:], jump[..., 1:])

    def _along(self, interface: str, force: Array, jump: Array) -> Array:
        weights = self.problem.interfaces[interface].weights
        steps = np.diff(jump, axis=0, prepend=np.zeros_like(jump[:1]))
        return np.cumsum(np.einsum("p,tpc,tpc->t", weights, force, steps))

    def _local(self, name: str) -> tuple[Array, Array]:
        if name not in self.problem.interfaces:
            raise unknown_name("interface", name, self.problem.interfaces, "result")
        interface = self.problem.here(name)
        if name in self.plan.active:
            points = interface.num_points
            blocks = self._kernel_fields(name)
            force, jump = (self.plan.in_time(b.reshape(points, -1, b.shape[1])) for b in blocks)
            return force, jump
        fields = self.displacements
        pairs = [
            self.eliminated(interface, interface.law.at(t), {n: u[k] for n, u in fields.items()})
            for k, t in enumerate(self.times)
        ]
        return np.array([f for f, _ in pairs]), np.array([j for _, j in pairs])


def phase_seconds(result: Result) -> dict[str, Any]:
    """Where the time went: assemble, factorise, condense (all bodies), global, local, other."""
    costs = result.core.costs
    return {
        "assemble": sum(c["assemble_s"] for c in costs),
        "factorise": sum(c["factorise_s"] for c in costs),
        "condense": sum(c["condense_s"] for c in costs),
        "global": result.summary.global_s,
        "local": result.summary.local_s,
        "other": result.summary.other_s,
    }


def spent(result: Result) -> str:
    """Seconds, rates and bytes of a run beside the prediction of its plan, as a table."""
    cost = result.plan.cost
    phases = phase_seconds(result)
    numbers = sum(c["factor_numbers"] for c in result.core.costs)
    dense = sum(c["dense_numbers"] for c in result.core.costs)
    loop = phases["global"] + phases["local"] + phases["other"]
    lines = [f"{'phase':<12}{'seconds':>10}  predicted"]
    for name, seconds in phases.items():
        said = ""
        if cost is not None and name == "factorise":
            said = f"{shown(cost.factor_flops, 'Flop')}, {shown(8 * cost.factor_numbers, 'B')}"
            said += f" (spent: {shown(8 * numbers, 'B')}"
            said += f", {shown(cost.factor_flops / seconds, 'Flop/s')})" if seconds > 0.0 else ")"
        elif cost is not None and name == "global" and result.iterations:
            rate = cost.iteration_flops * result.iterations / max(loop, 1e-9)
            said = f"{shown(cost.iteration_flops, 'Flop')} an iteration"
            said += f" ({shown(rate, 'Flop/s')} over the loop, dense blocks {shown(8 * dense, 'B')})"
        lines.append(f"{name:<12}{seconds:>10.4f}  {said}".rstrip())
    lines.append(f"{'total':<12}{sum(result.seconds.values()):>10.4f}")
    return "\n".join(lines)
