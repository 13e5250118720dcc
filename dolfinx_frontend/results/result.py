"""The answer of a deterministic solve, static or over a load history."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, Self, TYPE_CHECKING, overload

import numpy as np
from latin_core import Laws, State, Summary

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import together
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import checked_number
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.common.statuses import INEXACT, NO_EQUILIBRIUM, SLIDES
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.cost import shown
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.accuracy import Accuracy, Corrected, direct_status, ended
from dolfinx_frontend.results.acting import load_factors, mean_number
from dolfinx_frontend.results.answer import AnswerKind, Block, timed
from dolfinx_frontend.results.bridged import bridged
from dolfinx_frontend.results.certificate import write_certificate
from dolfinx_frontend.results.errors import (
    Continuation,
    EnergyBound,
    Errors,
    Estimator,
    Kind,
    not_continued,
    not_measured,
)
from dolfinx_frontend.results.face import Face
from dolfinx_frontend.results.resultant import Interest, asked
from dolfinx_frontend.results.surfaces import law_values
from dolfinx_frontend.results.value import Value
from dolfinx_frontend.uncertainty.statistics import MeanStd

__all__ = ["HistoryResult", "Result", "phase_seconds", "spent"]

_OF_RANDOM = ("coefficients", "sobol", "truncation")
"""What only random answers have."""


@dataclass(frozen=True, eq=False, repr=False)
class Result(Value, Face):
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
    solver, laws
        The factorised structure, which other results may share, and the laws it was solved with.
    found
        Errors that ``solve(accuracy=...)`` has measured on its way.
    accuracy
        Estimated errors by part, step, mean and fluctuation; None: only the largest is known.
    corrected
        Of a direct solve: the solution after its corrections; None: it was iterated on.
    verdict
        Its status, where more is known than the iteration knew; None: it is that.
    """

    problem: Problem
    plan: Plan
    summary: Summary
    state: State
    seconds: Mapping[str, float]
    solver: Solver
    laws: Laws
    cuts: Mapping[str, tuple[Array, Array]]
    found: Errors | None = field(default=None, kw_only=True)
    accuracy: Accuracy | None = field(default=None, kw_only=True)
    corrected: Corrected | None = field(default=None, kw_only=True)
    verdict: str | None = field(default=None, kw_only=True)
    estimator: Estimator = field(default=not_measured, kw_only=True)
    continuation: Continuation = field(default=not_continued, kw_only=True)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _OF_RANDOM:
                raise AttributeError(
                    f"{type(self).__name__} has no {name!r}: the answer is deterministic; give a law a "
                    "random value and solve with chaos=Chaos(order), or sample with monte_carlo"
                )
            return super().__getattr__(name)

    @property
    def status(self) -> str:
        """``"converged"``, or how else it ended: ``docs/statuses.md`` has them all."""
        if self.corrected is not None:
            return direct_status(self.corrected.accuracy, self.plan.options.rtol)
        return self.verdict or self.summary.status

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached."""
        return self.status == "converged"

    @property
    def iterations(self) -> int:
        """Global stages."""
        return self.summary.iterations

    @property
    def error(self) -> float:
        """Estimated relative error, in strain energy and in displacement of the interfaces: the largest of
        all parts and steps, of mean and fluctuation; NaN: not known."""
        if self.corrected is not None:
            return self.corrected.accuracy.largest
        return self.summary.error + self.solver.left if np.isfinite(self.summary.error) else float("nan")

    @property
    def place(self) -> str:
        """Where the largest error is: ``"part mount, step 7, fluctuation"``; empty: not known."""
        return "" if self.accuracy is None else self.accuracy.place

    @property
    def step_errors(self) -> Array:
        """Estimated relative error of every time step, (T,), of a static answer (1,); NaN: not known."""
        count = 1 if self.times is None else len(self.times)
        if self.accuracy is None:
            return np.full(count, self.error)
        return self.accuracy.by_step(count)

    @property
    def statuses(self) -> tuple[str, ...]:
        """Status of every time step, of a static answer one: a step converged if those before it did, too."""
        count = 1 if self.times is None else len(self.times)
        if self.converged:
            return ("converged",) * count
        errors = self.step_errors
        good = np.cumprod(errors <= self.plan.options.rtol) > 0
        # the steps before one without equilibrium have answers
        known = np.isfinite(errors) & (self.status in (NO_EQUILIBRIUM, SLIDES))
        others = np.where(known, INEXACT, self.status)
        return tuple("converged" if each else str(other) for each, other in zip(good, others, strict=True))

    @property
    def ended(self) -> str:
        """Status, estimated error, its place and, if the run did not converge, a remedy, in a sentence."""
        iterations = None if self.corrected is not None else self.iterations
        laws = [each.law for each in self.problem.interfaces.values()]
        return ended(self.status, self.error, self.place, self.plan.options.rtol, iterations, laws)

    @property
    def unsolved(self) -> tuple[str, ...]:
        """What a table has to say of a run that did not converge."""
        return () if self.converged else (f"NOT CONVERGED: {self.ended}",)

    def bridged(self, joints: Sequence[str]) -> tuple[str, ...]:
        """What beams carry of the shear of joints whose slip is asked for, a sentence each."""
        return bridged(self, joints) if self.problem.comm is None else ()

    @property
    def kind(self) -> AnswerKind:
        """``"deterministic"``, or ``"history"`` of a load history."""
        return "deterministic" if self.times is None else "history"

    @property
    def mean_laws(self) -> Laws:
        """Laws without anything random."""
        return self.laws

    @property
    def mean_state(self) -> State | None:
        """The state that belongs to `mean_laws`; None: it was not computed."""
        return self.state

    @property
    def without_recovery(self) -> str | None:
        """None: there are displacement fields, whose gradients can be recovered."""
        return None

    @together("tightened")
    def tightened(self, rtol: float) -> Self:
        """The run carried on to another tolerance, on the same factors."""
        checked_number("tightened", "rtol", rtol, above=0.0, below=1.0)
        self.problem.check_alike("tightened", rtol=rtol)
        more: Self = self.continuation(self, rtol)
        return more

    @together("mean_std")
    def mean_std(self, quantity: Interest) -> MeanStd:
        """A total force or mean jump, of a history at its end, or what a function makes of the fields; its
        standard deviation if it is random.

        Collective: to be called on all ranks.
        """
        value = asked("mean_std", self.problem.interfaces, quantity).everywhere(self)
        return MeanStd(float(np.ravel(value)[-1]), None)

    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of a part, length; interior fields are recovered when first asked for."""
        self._check_part(part)
        return self._recovered[part]

    @cached_property
    def _recovered(self) -> dict[str, Array]:
        if self.corrected is not None:
            fields = dict(self.corrected.displacements)
        else:
            fields = self.solver.displacements(self.laws, self.state, self.plan.amplitudes)
        return {name: read_only(timed(self.plan, fields[name])) for name in self.problem.substructures}

    def force(self, interface: str) -> Array:
        """Force per area on side 1, ([T,] m, components), in the local frame: component 0 is normal."""
        return read_only(self._local(interface)[0])

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1 ([T,] m, components), length, in the local frame."""
        return read_only(self._local(interface)[1])

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The answer as one sample."""

        def both(name: str) -> tuple[Array, Array]:
            force, jump = self._local(name)
            return force[None], jump[None]

        contact = partial(law_values, self.problem, self.plan)
        number = partial(mean_number, self.problem)
        load = partial(load_factors, self.problem, self.times, of=number)
        yield Block(1, both, self._as_sample, contact, _load=load, _parts=self.problem.substructures)

    def _as_sample(self, part: str, unknowns: Ints | None) -> Array:
        u = self.unknowns(part)[None]
        return u if unknowns is None else u[..., unknowns]

    @overload
    def errors(self, quantity: Interest = None, kind: Literal["estimate"] = "estimate") -> Errors: ...
    @overload
    def errors(self, quantity: Interest = None, *, kind: Literal["bound"]) -> EnergyBound: ...

    @together("errors")
    def errors(
        self, quantity: Interest = None, kind: Kind = "estimate"
    ) -> Errors | EnergyBound:
        """Errors of the iteration, the chaos and the meshes, in the energy norm and in a quantity.

        The iteration is carried on until its error is ten times smaller, a chaos gets its next modes: about
        half the cost of the run without its factorisation. After ``solve(accuracy=...)`` they are known
        already.

        Parameters
        ----------
        quantity
            A :class:`Resultant`, the name of an interface (its normal force), ``"energy"``; None: what was
            asked for, or the energy norm.
        kind
            ``"bound"``: the energy of the error of the meshes at most, by a stress in balance with the loads
            (triangles and tetrahedra of degree 1 and 2); :attr:`EnergyBound.notes` say where it is no proof.
        """
        if kind == "bound":
            return self.estimator(self, quantity, kind=kind)
        return self.estimator(self, quantity, kind)

    def certificate(self, path: str | Path) -> None:
        """Write the answer with all that proves it, for ``tools/check_certificate.py`` (docs/certificate.md).

        Parameters
        ----------
        path
            ``.npz``; an existing file is replaced when the new one is complete.

        Raises
        ------
        SceneError
            What cannot be certified, by its name: user laws, materials that vary, matrices, axisymmetry,
            rigid faces, several ranks; an error that is not known.
        FileError
            The file cannot be written.
        """
        write_certificate(self, path)

    def spent(self) -> str:
        """Where the time and the memory went, beside what the plan predicted, as a table."""
        return spent(self)

    def _local(self, name: str) -> tuple[Array, Array]:
        """Force and jump ([T,] m, components) of an interface."""
        self._check_interface(name)
        if self.corrected is not None and name in self.corrected.springs:
            return self._spring(*self.corrected.springs[name], self.problem.interfaces[name])
        if name not in self.plan.active:
            force, jump = self._eliminated(name, self._as_sample)
            return force[0], jump[0]
        points = self.problem.here(name).num_points
        force, jump = (
            timed(self.plan, block.reshape(points, -1, block.shape[-1]))
            for block in self._kernel_fields(name)
        )
        return force, jump

    def _spring(self, force: Array, jump: Array, interface: Interface) -> tuple[Array, Array]:
        """Force and jump ([T,] m, components) of an assembled spring, of a solution with corrections."""
        both = (each.reshape(interface.num_points, interface.dim, -1) for each in (force, jump))
        components = interface.law.count(interface.dim)
        force, jump = (timed(self.plan, each[:, :components]) for each in both)
        return force, jump

    def _kernel_fields(self, name: str) -> tuple[Array, Array]:
        return self.cuts[name] if name in self.cuts else self.solver.local_fields(self.laws, name, self.state)

    def _where(self) -> str:
        return f" in {self.place}" if self.place and not self.converged else ""

    def __repr__(self) -> str:
        steps = "" if self.plan.times is None else f"{len(self.plan.times)} time steps, "
        return (
            f"{type(self).__name__}({self.status}, {steps}{self.iterations} iterations, "
            f"estimated error {shown_error(self.error)}{self._where()}, {sum(self.seconds.values()):.2f} s)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class HistoryResult(Result):
    """Answer over a load history; every field has the time steps as its first axis."""

    @property
    def times(self) -> Array:
        """(T,)."""
        assert self.plan.times is not None  # a history has them
        return self.plan.times

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

        Integral of f_t . ds over the slip s (without what is elastic of it) with the force at the end of each
        step, where the law holds: exact for as long as the slip of a step keeps its direction.

        Raises
        ------
        SceneError
            The interface has no friction.
        """
        force, jump = self._local(interface)
        points = self.problem.interfaces[interface]
        law = points.law
        if not law.rubs:
            raise SceneError(
                f"interface {interface!r}: {law.title} has no friction; work() is for every law"
            )
        fields = [law.at(t).fields(points, t).parameters for t in self.times]
        elastic = np.array([each.get("tangential_compliance", np.zeros((1, 1))) for each in fields])
        return self._along(interface, force[..., 1:], jump[..., 1:] - elastic * force[..., 1:])

    def _along(self, interface: str, force: Array, jump: Array) -> Array:
        weights = self.problem.interfaces[interface].weights
        steps = np.diff(jump, axis=0, prepend=np.zeros_like(jump[:1]))
        return np.cumsum(np.einsum("p,tpc,tpc->t", weights, force, steps))


def phase_seconds(result: Result) -> dict[str, Any]:
    """Where the time went: assemble, factorise, condense (all bodies), prepare (the rest of the set-up),
    global, local, the flexibility of Newton's method and its steps, checks, callbacks, other, finish (after
    the iteration); of a solver that another answer has made, its set-up is counted there."""
    costs, summary = result.solver.costs, result.summary
    phases = {name: sum(c[f"{name}_s"] for c in costs) for name in ("assemble", "factorise", "condense")}
    phases["prepare"] = max(result.seconds["setup"] - sum(phases.values()), 0.0)
    own = ("global", "local", "flexibility", "newton", "check", "callback", "other")
    iteration = {name: float(getattr(summary, f"{name}_s")) for name in own}
    return {**phases, **iteration, "finish": result.seconds["solve"] - sum(iteration.values())}


def spent(result: Result) -> str:
    """Seconds, rates and bytes of a run beside the prediction of its plan, as a table."""
    cost = result.plan.cost
    phases = phase_seconds(result)
    numbers = sum(c["factor_numbers"] for c in result.solver.costs)
    dense = sum(c["dense_numbers"] for c in result.solver.costs)
    loop = phases["global"] + phases["local"] + phases["other"] + phases["check"]
    lines = [f"{'phase':<12}{'seconds':>10}  predicted"]
    for name, seconds in phases.items():
        said = ""
        if name in ("flexibility", "newton", "check", "callback") and not seconds:
            continue
        if cost is not None and name == "flexibility":
            said = f"{shown(cost.newton_flops, 'Flop')} with Newton's systems"
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
