"""Answers at many points: over a grid of parameter sets, and what sweeps and samplings share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt
from latin_core import STATUSES, Laws, State, SweepPoints, SweptParameter

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Flags, Ints, largest_of
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.statuses import INEXACT
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results.accuracy import ended, known, place_of, unsolved
from dolfinx_frontend.results.acting import STIFFNESS, factors_of, load_factors, mean_number, with_loads
from dolfinx_frontend.results.answer import AnswerKind, Block, chunks, timed
from dolfinx_frontend.results.bridged import bridged
from dolfinx_frontend.results.contact import BondValues, ContactValues
from dolfinx_frontend.results.face import Face
from dolfinx_frontend.results.point import OnePoint, point_number
from dolfinx_frontend.results.surfaces import law_values
from dolfinx_frontend.results.value import Value
from dolfinx_frontend.scene.laws import Fields
from dolfinx_frontend.scene.loads import OF_STIFFNESS, LoadTerm
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = ["PointResults", "SweepResult", "point_block"]


class PointResults(Face):
    """Answers at many points, of which Ctrl-C may have left some out; arrays have the points' shape first."""

    problem: Problem
    plan: Plan
    points: SweepPoints
    solver: Solver
    laws: Laws

    @abstractmethod
    def _contact_at(self, name: str, part: slice) -> ContactValues | BondValues | None:
        """Values of a contact or a bond at some of the points."""

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
        """Estimated relative error of every point, NaN where it was not reached or is not known."""
        return known(self.points.error).reshape(self.shape)

    @property
    def statuses(self) -> npt.NDArray[np.str_]:
        """Status of every point, ``"interrupted"`` or ``"time_limit"`` where it was not reached."""
        found = np.array([str(each) or "interrupted" for each in self.points.status])
        return found.reshape(self.shape)

    @property
    def places(self) -> npt.NDArray[np.str_]:
        """Where the largest error of every point is: ``"part mount, step 7"``; empty: not known."""
        worst, bodies = self.points.worst, self.solver.bodies
        found = [place_of(self.plan, bodies, each) for each in worst] or [""] * len(self.points.status)
        return np.array(found).reshape(self.shape)

    @property
    def place(self) -> str:
        """The point that ended worst, of those the one with the largest error, and where that is."""
        ranks = [STATUSES.index(str(each)) for each in self.statuses.ravel()]
        errors = np.where(np.isfinite(self.error), self.error, np.inf).ravel()
        if not ranks:
            return ""
        number = max(range(len(ranks)), key=lambda k: (ranks[k], errors[k]))
        words = [f"point {number}", str(self.places.ravel()[number])]
        return ", ".join(word for word in words if word)

    @property
    def ended(self) -> str:
        """The worst status, its estimated error and place and, if it did not converge, a remedy."""
        error = largest_of(self.error[self.finished])
        count = int(np.sum(self.statuses != "converged"))
        laws = [each.law for each in self.problem.interfaces.values()]
        text = ended(self.status, error, self.place, self.plan.options.rtol, laws=laws)
        if not count:
            return text
        return f"{count} of {self.statuses.size} points did not converge, the worst as {text}"

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
        """The worst of the points, as :attr:`Result.status`; one that was not reached is the worst."""
        return max(map(str, self.statuses.ravel()), key=STATUSES.index)

    def contact_at(self, name: str) -> ContactValues | None:
        """Friction and gap of a contact at all points; None: the law is no contact."""
        values = self._contact_at(name, slice(None))
        return values if isinstance(values, ContactValues) else None

    @property
    def reached(self) -> Flags:
        """(N,): the points that were come to before the run ended."""
        return np.asarray(self.points.iterations) >= 0

    @property
    def unsolved(self) -> tuple[str, ...]:
        """How many points ended otherwise than converged, and which, a sentence for each way."""
        return unsolved([str(each) for each in self.statuses.ravel()])

    @property
    def without_displacements(self) -> str | None:
        """Why there are no displacements, and how to get them; None: there are."""
        if self.points.states is not None:
            return None
        return "the states of the points were not kept: sweep or sample with keep_states=True"

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (points..., [T,] m, components), local frame."""
        return self._field(interface, 0)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (points..., [T,] m, components), local frame."""
        return self._field(interface, 1)

    def _field(self, name: str, which: int) -> Array:
        self._check_interface(name)
        if name in self.plan.active:
            values = self._active(name, slice(None))[which]
        else:
            values = np.concatenate([self._block(part).both(name)[which] for part in self._in_parts()])
        return values.reshape(*self.shape, *values.shape[1:])

    def _active(self, name: str, part: slice) -> tuple[Array, Array]:
        """Force and jump (n, [T,] m, components) of an active interface at some of the points."""
        interface = self.problem.here(name)
        if name not in self.points.forces:
            why = "force and jump were not kept: sweep with keep_fields=True"
            raise SceneError(f"interface {name!r}: {why if self.reached.any() else 'no point was reached'}")
        forces, jumps = self.points.forces[name], self.points.jumps[name]
        return _shaped(self.plan, interface, forces[part]), _shaped(self.plan, interface, jumps[part])

    def _block(self, part: slice, states: Array | None = None) -> Block:
        """Some of the points; `states` (n, 2, rows, columns) are theirs, where they were not all kept."""
        displacement = self._displacements(part, states)

        def both(name: str) -> tuple[Array, Array]:
            self._check_interface(name)
            if name in self.plan.active:
                return self._active(name, part)
            return self._eliminated(name, displacement, states is not None)

        count = len(range(*part.indices(len(self.points.status))))
        load = partial(load_factors, self.problem, self.times, of=partial(self._load_at, part=part))
        contact, parts = partial(self._contact_at, part=part), self.problem.substructures
        return Block(count, both, displacement, contact, _load=load, _parts=parts)

    def _displacements(
        self, part: slice, states: Array | None = None
    ) -> Callable[[str, Ints | None], Array]:
        """Part and some of its unknowns -> these (n, [T,] unknowns) at some of the points."""

        @cache  # recovered for all parts at once, when first asked for
        def recovered() -> dict[str, Array]:
            return self._recovered(part, states)

        def displacement(name: str, unknowns: Ints | None) -> Array:
            if states is None:
                self._check_part(name)
            u = recovered()[name]
            return u if unknowns is None else u[..., unknowns]

        return displacement

    def _swept_loads(self) -> Sequence[SweptParameter]:
        """Loads of parts that differ from point to point, as the kernel had them."""
        return ()

    def _load_at(self, term: LoadTerm, part: slice) -> Array:
        """A number of a load at some of the points, (n,) or (1,)."""
        return mean_number(self.problem, term)

    def _in_parts(self) -> Iterator[slice]:
        """Slices of the points whose fields fit into memory."""
        points = max(each.num_points for each in self.problem.interfaces.values())
        unknowns = self.problem.size if self.points.states is not None else 0
        steps = 1 if self.times is None else len(self.times)
        return chunks(len(self.points.status), steps * (points * self.problem.dim + unknowns))

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The points, some at a time."""
        return map(self._block, self._in_parts())

    def _recovered(self, part: slice, states: Array | None = None) -> dict[str, Array]:
        """Part -> unknowns (n, [T,] unknowns) at some of the points; one solve per point."""
        if states is None:
            assert self.points.states is not None  # was asked before
            states = self.points.states[part]  # (points, 2, rows, columns)
        shape = (2, states.shape[2], len(states) * states.shape[3])
        data, traces = np.moveaxis(states, 0, 2).reshape(shape)
        state = State(np.asfortranarray(data), np.asfortranarray(traces))
        amplitudes = with_loads(self.plan, self._swept_loads(), part)
        if amplitudes.shape[1] != data.shape[1]:  # the loads are the same at all points
            amplitudes = np.asfortranarray(np.tile(amplitudes, (1, len(states))))
        laws = self.laws
        if factors := factors_of(self.problem, self._swept_loads(), part):
            laws = laws.with_(stiffness=factors)
        fields = self.solver.displacements(laws, state, amplitudes)
        return {
            name: np.moveaxis(timed(self.plan, values.reshape(len(values), len(states), -1)), -1, 0)
            for name, values in fields.items()
        }

    def point(self, *index: int) -> OnePoint:
        """The answer at one of the points (the last by default), as a deterministic one.

        Raises
        ------
        SceneError
            There is no such point, or it was not reached.
        """
        number = point_number(index, self.shape)
        if not self.finished.ravel()[number]:
            raise SceneError(f"point: point {index} was not reached, the run was interrupted")
        return self._point(number)

    def _point(self, number: int, states: Array | None = None) -> OnePoint:
        return OnePoint(
            self,
            partial(self._block, slice(number, number + 1), states),
            str(self.points.status[number]),
            int(self.points.iterations[number]),
            float(self.error.ravel()[number]),
            str(self.places.ravel()[number]),
            states is not None,
        )

    def bridged(self, joints: Sequence[str]) -> tuple[str, ...]:
        """What beams carry of the shear of joints whose slip is asked for, where interfaces move most."""
        if self.furthest is None:
            return ()
        number, one = self.furthest
        return tuple(f"{text} (at point {number}, which moves most)" for text in bridged(one, joints))

    @cached_property
    def furthest(self) -> tuple[int, OnePoint] | None:
        """Number of the point whose interfaces move most, and that point with its displacements, if known."""
        if self.points.furthest is None or self.problem.comm is not None:
            return None
        number, state = self.points.furthest
        if str(self.points.status[number]) not in ("converged", INEXACT):
            return None
        return number, self._point(number, state[None])

    def extra_content(self, parts: Sequence[str], samples: int | None, seed: int) -> dict[str, Any]:
        """What a file has of these answers beside what it has of all."""
        points = self.points
        return {
            "points": {
                "status": [str(each) for each in points.status],
                "iterations": np.asarray(points.iterations, dtype=np.int64),
                "error": np.asarray(points.error, dtype=np.float64),
            }
        }


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
    parameters
        What was swept, in the kernel's terms.
    """

    problem: Problem
    plan: Plan
    axes: Mapping[str, Array]
    points: SweepPoints
    seconds: Mapping[str, float]
    solver: Solver
    laws: Laws
    parameters: tuple[SweptParameter, ...] = ()

    @property
    def kind(self) -> AnswerKind:
        """``"sweep"``."""
        return "sweep"

    @property
    def statistics(self) -> Kind:
        """``"grid"``: its points have no probability."""
        return "grid"

    @property
    def coordinates(self) -> Mapping[str, Array]:
        """Swept parameters -> their values at all points, (n,)."""
        mesh = np.meshgrid(*self.axes.values(), indexing="ij")
        return {name: values.ravel() for name, values in zip(self.axes, mesh, strict=True)}

    def shown(self) -> Block:
        """The last point."""
        return self.point()._one

    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of a part at the last point; :meth:`point` has those of any other."""
        self._check_part(part)
        return self.point().unknowns(part)

    def extra_content(self, parts: Sequence[str], samples: int | None, seed: int) -> dict[str, Any]:
        """What a file has of a sweep beside what it has of all."""
        return {**super().extra_content(parts, samples, seed), "axes": dict(self.axes)}

    def _swept_loads(self) -> Sequence[SweptParameter]:
        return [each for each in self.parameters if not each.interface or each.parameter == STIFFNESS]

    def _load_at(self, term: LoadTerm, part: slice) -> Array:
        mean = mean_number(self.problem, term)
        for each in self._swept_loads():
            if term.load == OF_STIFFNESS and each.interface == term.parameter:
                return np.asarray(each.values[0, part])
        if term not in self.plan.loads:
            return np.repeat(mean, len(range(*part.indices(len(self.points.status)))))
        row = len(self.plan.patterns) + self.plan.loads.index(term)
        columns = np.arange(self.plan.amplitudes.size).reshape(self.plan.amplitudes.shape, order="F")[row]
        for each in (one for one in self._swept_loads() if not one.interface):
            unit = each.pattern[columns, 0]
            if np.any(unit):
                return np.asarray(mean + each.values[0, part])
        return mean

    def _contact_at(self, name: str, part: slice) -> ContactValues | BondValues | None:
        numbers = range(*part.indices(len(self.points.status)))

        def swept(fields: Fields) -> Mapping[str, Array]:
            steps, values = self.plan.steps, {}
            for parameter, block in fields.parameters.items():
                values[parameter] = np.tile(block, (1, len(numbers))) if block.shape[1] > 1 else block
            for each in self.parameters:
                if each.interface == name:
                    at = each.pattern @ each.values[:, part]
                    at = at.reshape(each.columns, -1, len(numbers)).transpose(1, 2, 0)
                    at = np.repeat(at, steps // each.columns, axis=2)
                    values[each.parameter] = at.reshape(len(at), -1)
            return values

        return law_values(self.problem, self.plan, name, len(numbers), swept)

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
        check_known("output", name, self.points.outputs, "sweep")
        values = self.points.outputs[name]
        return values.reshape(*self.shape, *values.shape[1:])

    def __repr__(self) -> str:
        done = f"{int(self.finished.sum())} solved" + ("" if self.complete else " (INTERRUPTED)")
        total = int(self.iterations[self.finished].sum())
        worst = "" if np.all(self.converged[self.finished]) else f", worst: {self.status} in {self.place}"
        return (
            f"SweepResult({' x '.join(str(n) for n in self.shape)} points, {done}, "
            f"{int(self.converged.sum())} converged{worst}, {total} iterations, "
            f"{sum(self.seconds.values()):.2f} s)"
        )


def _shaped(plan: Plan, interface: Interface, values: Array) -> Array:
    """Fields of points (n, columns, rows) -> (n, [T,] m, components)."""
    values = np.swapaxes(values, 1, 2)  # (n, rows, columns)
    values = timed(plan, values.reshape(len(values), interface.num_points, -1, values.shape[2]))
    return values if plan.times is None else np.moveaxis(values, 0, 1)


def point_block(problem: Problem, plan: Plan, fields: Mapping[str, tuple[Array, Array]]) -> Block:
    """One point while a sweep goes on, from force and jump (rows, columns) of its active interfaces."""

    def both(name: str) -> tuple[Array, Array]:
        check_known("active interface", name, fields, "sweep")
        force, jump = (_shaped(plan, problem.interfaces[name], each.T[None]) for each in fields[name])
        return force, jump

    def displacement(part: str, unknowns: Ints | None) -> Array:
        raise SceneError(
            f"displacements of {part!r} are not known while a sweep goes on: sweep with keep_states=True and "
            "read them from its points"
        )

    return Block(1, both, displacement)
