"""What all answers that a solver gives have in common: they are read in one way, whatever they are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from dolfinx_frontend.assembly.matrix_part import frames_of, motion_of
from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.assembly.spread import Condensed
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import (
    check_known,
    checked_callable,
    checked_flag,
    checked_name,
    checked_word,
    told_call,
)
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.results import tables, writing
from dolfinx_frontend.results.answer import (
    AnswerKind,
    Block,
    Of,
    OfPart,
    Surface,
    one_number_a_sample,
    stepped,
)
from dolfinx_frontend.results.bridged import slid
from dolfinx_frontend.results.moments import Accumulator, of_modes
from dolfinx_frontend.results.probes import AtPoint, reaction_of
from dolfinx_frontend.results.reactions import eliminated_fields, prescribed_force
from dolfinx_frontend.results.readings import Readings, column_of, read
from dolfinx_frontend.results.resultant import over_all_ranks
from dolfinx_frontend.results.sampled_stress import (
    MADE_OF_STRESS,
    PartStress,
    made_of_stress,
    moments_of_stress,
    number_of_stress,
)
from dolfinx_frontend.results.stress import stress_function
from dolfinx_frontend.results.surfaces import surface_of
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.uncertainty.quantities import Inputs, Kind, Quantity

__all__ = ["Face"]

T = TypeVar("T")

DRAWS = 100_000
"""Samples of a chaos from which a quantity of interest is made."""


_OF_QUANTITIES = ("quantile", "percentile", "probability")
"""What a number has, and an answer has not."""


class Face(Shown, ABC):
    """Readings, tables, fields and files of an answer: see :class:`dolfinx_frontend.results.answer.Answer`.

    A class of answers gives `kind`, `blocks`, `unknowns`, `force` and `jump`; what is random also how its
    samples are to be read, and its moments.
    """

    problem: Any
    plan: Any
    seconds: Mapping[str, float]

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _OF_QUANTITIES:
                raise AttributeError(
                    f"{type(self).__name__} has no {name!r}: it is that of a quantity; ask "
                    "mean_std(Quantile('joint', 0.95)) or quantity('joint.pressure_max').quantile(0.95)"
                )
            if name == "sobol":
                raise AttributeError(
                    f"{type(self).__name__} has no 'sobol': ask quantity('joint.normal').sobol(), or solve "
                    "with chaos=Chaos(order)"
                )
            return object.__getattribute__(self, name)  # raises, with the reason if a property failed

    # --- what a class of answers gives ---------------------------------------------------------
    @property
    @abstractmethod
    def kind(self) -> AnswerKind:
        """``"deterministic"``, ``"history"``, ``"chaos"``, ``"samples"`` or ``"sweep"``."""

    @property
    @abstractmethod
    def status(self) -> str:
        """``"converged"``, or how else it ended: ``docs/statuses.md`` has them all."""

    @abstractmethod
    def force(self, interface: str) -> Array:
        """Force per area on side 1, local frame: component 0 is normal."""

    @abstractmethod
    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, length, local frame."""

    @abstractmethod
    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The samples, some at a time; of a chaos this many random ones (None: as many as a table takes)."""

    @abstractmethod
    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of a part, length: of a random answer the mean, of a sweep the last point."""

    @property
    def statistics(self) -> Kind:
        """How the samples are to be read."""
        return "value"

    @property
    def coordinates(self) -> Mapping[str, Array]:
        """Of a sweep: swept parameters -> their values at all points, (n,)."""
        return {}

    @property
    def without_displacements(self) -> str | None:
        """Why there are no displacements, and how to get them; None: there are."""
        return None

    @property
    def without_recovery(self) -> str | None:
        """Why the error of the meshes cannot be estimated, and what to do; None: it can."""
        return (
            f"{type(self).__name__} has no displacement fields to recover: take the result of "
            "solve(problem), e.g. at the mean of the parameters"
        )

    def moment_blocks(self) -> Iterator[Block]:
        """The samples from which moments of fields are made."""
        return self.blocks()

    def many(self, samples: int | None, seed: int) -> Iterator[Block]:
        """As `blocks`, for numbers of which each sample gives one: as many at a time as are quick."""
        return self.blocks(samples, seed)

    def shown(self) -> Block:
        """The one sample that fields are of where there are no moments: of a sweep its last point."""
        return next(self.blocks())

    def modes_of(self, interface: str) -> tuple[Array, Array] | None:
        """Chaos coefficients (P + 1, [T,] m, components) of force and jump where moments follow from them."""
        return None

    def spread(self, part: str) -> Sequence[Array]:
        """Unknowns ([T,] n) whose squares add up to the variance, of fields that are linear in them."""
        return ()

    def deviation(self, part: str) -> Array | None:
        """Standard deviation ([T,] n) of the unknowns; None: nothing is random."""
        return None

    @property
    def draws(self) -> int | None:
        """Samples of a chaos from which a quantity of interest is made; None: all that there are."""
        return DRAWS

    def extra_content(self, parts: Sequence[str], samples: int | None, seed: int) -> dict[str, Any]:
        """What a file has of the answer beside what it has of all; displacements of some parts only."""
        return {}

    # --- how everything else sees it -----------------------------------------------------------
    @property
    def times(self) -> Array | None:
        """(T,) of a load history, or None."""
        times: Array | None = self.plan.times
        return times

    @property
    def unsolved(self) -> tuple[str, ...]:
        """What a table has to say of a run or points that did not converge, a sentence each."""
        return ()

    @property
    def known(self) -> tuple[str, ...]:
        """Interfaces whose force is known at their points.

        Those that are active, and, where the displacements are known, springs and loads that were assembled
        across.
        """
        active = self.plan.active
        if self.without_displacements is not None:
            return tuple(name for name in self.problem.interfaces if name in active)
        interfaces = self.problem.interfaces.items()
        return tuple(name for name, each in interfaces if name in active or each.law.prescribes != "jump")

    def surface(self, interface: str) -> Surface:
        """An interface as tables and figures see it."""
        self._check_interface(interface)
        return surface_of(self.problem.interfaces[interface], self.times)

    def load(self, interface: str) -> Array | None:
        """Force ([T,] m, components) of a load that was assembled into its part; None: it is no such load."""
        each, times = self.problem.interfaces[interface], self.times
        if interface in self.plan.active or each.law.prescribes != "force":
            return None
        force = prescribed_force(each, self._laws(interface))
        return force[0] if times is None else force

    def _laws(self, interface: str) -> list[Law]:
        """The law of an interface at every time."""
        law, times = self.problem.interfaces[interface].law, self.times
        return [law] if times is None else [law.at(t) for t in times]

    def why_unknown(self, interface: str) -> str | None:
        """Why the force of an interface not in `known` cannot follow from equilibrium; None: it may."""
        why = self.without_displacements
        return None if why is None else f"eliminated, its force follows from the displacements: {why}"

    def everywhere(self, interface: str, read: Callable[[], T]) -> T:
        """What the rank of an interface's first side reads, on all ranks; collective."""
        found: T = self.problem.everywhere(interface, read)
        return found

    @together("gathered")
    def gathered(self, interface: str) -> tuple[Array, Array]:
        """Force and jump of an interface as :meth:`force` and :meth:`jump` give them, on all ranks.

        Collective: to be called on all of them.
        """
        return self.everywhere(interface, lambda: (self.force(interface), self.jump(interface)))

    def function(self, part: str, unknowns: Array, name: str) -> fem.Function:
        """Unknowns (n,) as a dolfinx function; of a matrix as a :class:`Motion` of its points."""
        frames = frames_of(self.problem.substructures[part])
        if frames is not None:
            given = frames.given
            shape = frames.nodes, len(given.points), given.turning
            found = motion_of(*shape, unknowns, linear=name == "displacement")
            return cast(fem.Function, found)  # who asks for a matrix knows
        function = fem.Function(self.problem.substructures[part].V, name=name)
        function.x.array[:] = unknowns
        return function

    def _check_interface(self, name: str) -> None:
        check_known("interface", name, self.problem.interfaces, "result")

    def _check_part(self, name: str) -> None:
        if isinstance(name, str):
            self.problem.check_here(name)
        check_known("substructure", name, self.problem.substructures, "result")
        if self.without_displacements is not None:
            raise SceneError(f"displacements of {name!r} are not known: {self.without_displacements}")

    def _eliminated(
        self, name: str, displacement: Callable[[str, Ints | None], Array], kept: bool = False
    ) -> tuple[Array, Array]:
        """Force and jump (n, [T,] m, components) of a spring or load, from unknowns (n, [T,] unknowns).

        `kept`: these are known, whatever is of other samples.

        Raises
        ------
        SceneError
            It is a support or glue: its force is no unknown.
        """
        interface = self.problem.here(name)
        if interface.law.prescribes == "jump":
            raise SceneError(
                f"interface {name!r} was eliminated ({self.plan.eliminated[name]}), its force is "
                f"not an unknown: solve with active=[{name!r}] to have it"
            )
        if self.without_displacements is not None and not kept:
            raise SceneError(
                f"interface {name!r} was eliminated ({self.plan.eliminated[name]}), its force follows from "
                f"the displacements: {self.without_displacements}"
            )
        times = self.times

        def stepwise(part: str, unknowns: Ints | None) -> Array:
            return stepped(displacement(part, unknowns), times, 1)

        force, jump = eliminated_fields(interface, self._laws(name), stepwise)
        return (force[:, 0], jump[:, 0]) if times is None else (force, jump)

    # --- fields --------------------------------------------------------------------------------
    @property
    def displacements(self) -> dict[str, Array]:
        """Part -> ([T,] n) unknowns, length: of a random answer the mean, of a sweep the last point."""
        return {name: self.unknowns(name) for name in self.problem.substructures}

    def displacement(self, part: str, step: int = -1) -> fem.Function:
        """Displacement of a part as a dolfinx function, length; of a random answer its mean. Of a part that
        is a matrix a :class:`Motion` of its points.

        Of a part whose mesh is spread over the ranks it is on the whole mesh, and all ranks call this.

        Parameters
        ----------
        step
            Of a load history; the last by default.

        Raises
        ------
        SceneError
            No such part or step, or samples whose states were not kept.
        """
        whole = getattr(self.problem, "spread", {}).get(part) if isinstance(part, str) else None
        if whole is not None:
            return self._on_all_ranks(part, whole, step)[0]
        self._check_part(part)
        step = check_step(self.times, step, "displacement")
        return self.function(part, stepped(self.unknowns(part), self.times)[step], "displacement")

    def _on_all_ranks(
        self, part: str, whole: Condensed, step: int
    ) -> tuple[fem.Function, dict[tuple[str, str], float]]:
        """Displacement of a part whose mesh is spread over the ranks, and numbers of its loads."""
        comm, unknowns = self.problem.comm, None
        numbers: dict[tuple[str, str], float] = {}
        self._check_fields(part, whole)
        with agreement(comm):
            step = check_step(self.times, step, "displacement")
            if part in self.problem.substructures:
                self._check_part(part)
                unknowns = stepped(self.unknowns(part), self.times)[step]
                for key in whole.loads:
                    numbers[key] = float(stepped(self.load_number(*key), self.times)[step])
        numbers = comm.bcast(numbers, root=whole.owner)
        time = None if self.times is None else float(self.times[step])
        return whole.displacement(unknowns, numbers, time), numbers

    def _check_fields(self, part: str, whole: Condensed) -> None:
        """Refuse fields inside of a part whose mesh is spread over the ranks, if they are not known."""
        if self._factored(part) and whole.loaded:
            raise SceneError(
                f"displacement of {part!r}: its mesh is spread over the ranks, its stiffness varies, and "
                "loads act inside of it: make it on COMM_SELF to have its fields"
            )

    def mode_on_all_ranks(self, part: str, mode: int) -> fem.Function:
        """One of the modes of :meth:`spread`, at the last step, length, of a part whose mesh is spread over
        the ranks; collective."""
        whole, unknowns = self.problem.spread[part], None
        numbers: dict[tuple[str, str], float] = {}
        self._check_fields(part, whole)
        with agreement(self.problem.comm):
            if part in self.problem.substructures:
                unknowns = stepped(self.spread(part)[mode], self.times)[-1]
                for key in whole.loads:
                    numbers[key] = float(stepped(self.load_spread(*key)[mode], self.times)[-1])
        found: fem.Function = whole.answer(unknowns, numbers)
        return found

    def mean(self, part: str, step: int = -1) -> fem.Function:
        """Mean displacement, as :meth:`displacement`."""
        return self.displacement(part, step)

    def stress(self, part: str, step: int = -1, of: str = "tensor") -> fem.Function:
        """Stress of the displacement, force / area, (d, d), cell by cell; of a random answer its mean.

        Parameters
        ----------
        of
            ``"tensor"``; ``"von Mises"``; or ``"principal"``, three numbers, the largest first. Of a random
            answer the last two are computed sample by sample: the mean of the von Mises stress is not that of
            the mean stress.

        Raises
        ------
        SceneError
            As for :meth:`displacement`, the material is a form that gives no stress, or `of` needs an axis
            that a plane part does not have.
        """
        checked_word("stress", "of", of, ("tensor", *MADE_OF_STRESS))
        whole = getattr(self.problem, "spread", {}).get(part) if isinstance(part, str) else None
        if whole is not None:
            return self._stress_on_all_ranks(part, whole, step, of)
        u = self.displacement(part, step)
        self.problem.check_sources(part)
        step = check_step(self.times, step, "stress")
        if self._factored(part):
            found = self._stress_moments if of == "tensor" else partial(made_of_stress, self, of=of)
            return found(part, step)[0]
        if frames_of(self.problem.substructures[part]) is not None:
            raise SceneError(f"stress of {part!r}: it is a matrix, of which only displacements are known")
        if self.problem.substructures[part].material is None:
            raise SceneError(
                f"stress of {part!r}: no material is known for it. A file has none of a part with initial "
                "strains (temperatures) or a random stiffness, or whose material is a form: compute stresses "
                "before save"
            )
        if of != "tensor":
            return made_of_stress(self, part, step, of)[0]
        initial = [
            (stress, float(stepped(self.load_number(load, parameter), self.times)[step]))
            for load, parameter, stress in self.problem.initial_stresses(part)
        ]
        return stress_function(u, self.problem.substructures[part].material, initial=initial)

    def _stress_on_all_ranks(self, part: str, whole: Condensed, step: int, of: str) -> fem.Function:
        """As :meth:`stress`, of a part whose mesh is spread over the ranks; collective."""
        random = of != "tensor" and self.statistics not in ("value", "grid")
        if random or self._factored(part):
            what = f"of = {of!r} of a random answer" if random else "that of a stiffness that varies"
            raise SceneError(
                f"stress of {part!r}: its mesh is spread over the ranks, which do not have {what}: make it "
                "on COMM_SELF"
            )
        u, numbers = self._on_all_ranks(part, whole, step)
        with agreement(self.problem.comm):
            initial = [(stress, numbers[key]) for key, stress in whole.stresses.items()]
            found = stress_function(u, whole.material, initial=initial)
            return found if of == "tensor" else number_of_stress(part, found, of)

    def _factored(self, part: str) -> bool:
        """Whether the stiffness of a part varies in this answer."""
        return part in getattr(self.plan, "varied", ())

    def stiffness_coupling(self, part: str) -> Any:
        """What a random field multiplies modes with in the cells of a part; None: no modes, or no field."""
        return None

    def stiffness_modes(self, part: str) -> Array | None:
        """Matrix (P + 1, P + 1) by which the factor of a stiffness multiplies modes; None: no modes."""
        return None

    def _stress_moments(self, part: str, step: int) -> tuple[fem.Function, fem.Function]:
        """Mean and deviation of the stress of a part whose stiffness varies; of a sweep of its last point."""
        stress = PartStress(self, part, step)
        loads = self.problem.initial_stresses(part)
        mean, deviation = stress.function.copy(), stress.function.copy()
        by, coupling = self.stiffness_modes(part), self.stiffness_coupling(part)
        of_cells = stress.of_cells
        if coupling is not None:

            def of_modes(mean: Array, spread: Sequence[Array]) -> list[Array]:
                return [stepped(each, self.times)[step] for each in (mean, *spread)]

            numbers_of = [of_modes(self.load_number(a, b), self.load_spread(a, b)) for a, b, _ in loads]
            unknowns = of_modes(self.unknowns(part), self.spread(part))
            modes = np.array([stress(u, [float(e[k]) for e in numbers_of]) for k, u in enumerate(unknowns)])
            each_cell = modes[:, of_cells].reshape(len(modes), -1).T
            change = coupling.apply(np.ascontiguousarray(each_cell), of_cells.shape[1])
            total = (each_cell + change).reshape(*of_cells.shape, -1)
            mean.x.array[of_cells] = total[..., 0]
            deviation.x.array[of_cells] = np.sqrt(np.sum(total[..., 1:] ** 2, axis=-1))
            return mean, deviation
        if by is not None:

            def now(mean: Array, spread: Sequence[Array]) -> Array:
                return np.stack([stepped(each, self.times)[step] for each in (mean, *spread)])

            modes = now(self.unknowns(part), self.spread(part))
            numbers = [now(self.load_number(a, b), self.load_spread(a, b)) for a, b, _ in loads]
            fields = by @ modes
            every = [by @ each for each in numbers]
            found = [stress(fields[k], [float(each[k]) for each in every]) for k in range(len(fields))]
            mean.x.array[:] = found[0]
            deviation.x.array[:] = np.sqrt(np.sum(np.square(found[1:]), axis=0)) if len(found) > 1 else 0.0
            return mean, deviation
        mean.x.array[:], deviation.x.array[:] = moments_of_stress(stress, self)
        return mean, deviation

    def load_number(self, load: str, parameter: str) -> Array:
        """What a shape of a load of a part is multiplied with, ([T]): of a random answer the mean, of a sweep
        at the last point."""
        number: Array = self.shown().load(load, parameter)[0]
        return number

    def load_spread(self, load: str, parameter: str) -> Sequence[Array]:
        """Its modes ([T]) beside the mean, in the order of :meth:`spread`."""
        return ()

    def std(self, part: str, step: int = -1, of: OfPart = "displacement") -> fem.Function:
        """Standard deviation of every component of the displacement or the stress; 0 if nothing is random.

        The stress of a chaos has that of its coefficients, that of samples is computed at all of them, and so
        are ``"von Mises"`` and ``"principal"``, also of a chaos.

        Raises
        ------
        SceneError
            As for :meth:`displacement`, or of a sweep, whose points have no probability.
        """
        if not isinstance(of, str) or of not in ("displacement", "stress", *MADE_OF_STRESS):
            known = ", ".join(map(repr, ("displacement", "stress", *MADE_OF_STRESS)))
            raise SceneError(f"std: of = {of!r}: use one of {known}")
        self._no_grid("std")
        self._check_part(part)
        step = check_step(self.times, step, "std")
        if of == "stress":
            return self._stress_deviation(part, step)
        if of != "displacement":
            return made_of_stress(self, part, step, of)[1]
        deviation = self.deviation(part)
        values = np.zeros_like(self.unknowns(part)) if deviation is None else deviation
        return self.function(part, stepped(values, self.times)[step], "deviation")

    def _stress_deviation(self, part: str, step: int) -> fem.Function:
        if self._factored(part):
            return self._stress_moments(part, step)[1]
        self.problem.check_sources(part)
        stress = PartStress(self, part, step)
        keys = [(load, parameter) for load, parameter, _ in self.problem.initial_stresses(part)]
        out = stress.function.copy()
        spread = self.spread(part)
        if self.deviation(part) is None:
            out.x.array[:] = 0.0
        elif spread:
            numbers = [self.load_spread(*key) for key in keys]
            total = np.zeros_like(out.x.array)
            for k, each in enumerate(spread):
                now = [float(stepped(modes[k], self.times)[step]) for modes in numbers]
                total += stress(stepped(each, self.times)[step], now) ** 2
            out.x.array[:] = np.sqrt(total)
        else:
            out.x.array[:] = moments_of_stress(stress, self)[1]
        return out

    def moments(self, name: str, of: Of | None = None) -> tuple[Array, Array]:
        """Mean and standard deviation of what acts on an interface or of a part's displacement.

        Exact from the coefficients of a chaos where the law is linear, otherwise over samples; the deviation
        is 0 if nothing is random.

        Parameters
        ----------
        name
            Of an interface or of a part.
        of
            ``"force"`` or ``"jump"``, ([T,] m, components), or ``"displacement"``, unknowns ([T,] n); None:
            the force of an interface, the displacement of a part.
        """
        parts, interfaces = self.problem.substructures, self.problem.interfaces
        check_known("interface or part", name, (*parts, *interfaces), "moments")
        if of is None:
            if name in parts and name in interfaces:
                raise SceneError(
                    f"moments: {name!r} is a part and an interface: say of='force' or of='displacement'"
                )
            of = "displacement" if name in parts else "force"
        if not isinstance(of, str) or of not in ("force", "jump", "displacement"):
            raise SceneError(f"moments: of = {of!r}: use 'force', 'jump' or 'displacement'")
        self._no_grid("moments")
        if of == "displacement":
            self._check_part(name)
            mean, deviation = self.unknowns(name), self.deviation(name)
            return mean, np.zeros_like(mean) if deviation is None else deviation
        self._check_interface(name)
        return self._interface_moments(name, of)

    def _interface_moments(self, name: str, of: Of) -> tuple[Array, Array]:
        if self.statistics == "value":
            value = self.force(name) if of == "force" else self.jump(name)
            return value, np.zeros_like(value)
        modes = self.modes_of(name)
        if modes is not None:
            return of_modes(modes[0] if of == "force" else modes[1])
        sums = Accumulator(self.statistics != "qmc")
        for block in self.moment_blocks():
            sums.add({name: block.force(name) if of == "force" else block.jump(name)}, block.weights)
        return sums.found()[name]

    def _no_grid(self, what: str) -> None:
        if self.statistics == "grid":
            raise SceneError(
                f"{what}: the points of a sweep have no probability: read force, jump or table of all of "
                "them, point(...) of one, or sample a problem with random parameters"
            )

    # --- numbers -------------------------------------------------------------------------------
    def quantity(
        self,
        function: Callable[[Block], npt.ArrayLike] | str,
        name: str = "quantity",
        unit: str = "",
        samples: int | None = None,
        seed: int = 0,
        step: int = -1,
    ) -> Quantity:
        """A scalar quantity of interest, evaluated sample by sample.

        A deterministic answer gives one value, a sweep one per point of its grid.

        Parameters
        ----------
        function
            Takes the fields at n samples (:class:`Block`), returns (n,) values; it is called several times.
            An :class:`AtPoint` of another problem is found again in the meshes of this one. Or a number of
            the tables by name: ``"joint.pressure_min"``, ``"bolt.normal"`` (see :meth:`table`). Both are
            known to all ranks, which ask together; another function reads what its rank has.
        name, unit
            For tables and figures.
        samples, seed
            Of a chaos: this many random samples (None: 100 000). Other answers use all their samples.
        step
            Of a load history, for a number of the tables.
        """
        wanted = "give a function of the fields of n samples that returns (n,) values, or 'interface.column'"
        wanted += "; of an interface, a Resultant, a Measure or a Quantile mean_std(...) tells mean and "
        wanted += "deviation, or the quantile: mean_std(Quantile('joint', 0.95))"
        if isinstance(function, str) and "." in function:
            name = function if name == "quantity" else name
            joint, _, column = function.rpartition(".")
            function = column_of(self, function, check_step(self.times, step, "quantity"))
            for text in self.bridged([joint]) if column.startswith("slip") else ():
                warn(text, SceneWarning, f"{joint} bridged")
        number: Callable[..., Any] = checked_callable("quantity", "function", function, wanted)
        checked_name("quantity", name)
        where = f"quantity {name!r}"
        if isinstance(number, AtPoint):
            number = over_all_ranks(number.on(self.problem), self.problem)

        def values(block: Block) -> Array:
            return one_number_a_sample(told_call(where, number, block), len(block), name)

        blocks = self.many(self.draws if samples is None else samples, seed)
        found = [(values(b), b.weights, b.germs) for b in blocks]
        weights = [w for _, w, _ in found if w is not None]
        germs = [g for _, _, g in found if g is not None]
        return Quantity(
            name=name,
            unit=unit,
            values=np.concatenate([each for each, _, _ in found]),
            weights=np.concatenate(weights) if weights else None,
            kind=self.statistics,
            inputs=self.inputs(values, np.concatenate(germs)) if germs else None,
        )

    def inputs(self, number: Callable[[Block], Array], germs: Array) -> Inputs | None:
        """What a number of a random answer depends on, known at points (N, L) of the germs; None: that is not
        known."""
        return None

    def reaction(self, interface: str, component: str, step: int = -1) -> Callable[[Block], Array]:
        """The reaction of a support or glued face for :meth:`quantity`, see
        :func:`dolfinx_frontend.results.probes.reaction_of`."""
        return reaction_of(self, interface, component, step)

    @together("table")
    def table(
        self,
        interfaces: Sequence[str] | str | None = None,
        step: int | None = -1,
        about: npt.ArrayLike | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
        samples: int | None = None,
        seed: int = 0,
    ) -> tables.Table:
        """Resultants, pressures and areas of the interfaces: ``print`` it, ``to_csv``, ``to_pandas``.

        Columns (see :mod:`dolfinx_frontend.results.readings` for signs): area; ``force_x`` ...,
        ``moment_x`` ... on side 1, global axes; ``normal`` (tension > 0) and ``shear``, total;
        ``pressure_min``, ``_mean``, ``_max``; ``shear_max``. Of contacts ``open_area`` (no pressure); with
        friction ``slip_area`` (at its limit), ``slip_share`` (the same over what is closed), ``slip_use``
        (share of the friction limit of what is closed that is used up: at 1 all of it slips), ``slip_safety``
        (what friction carries over the forces and moments along the joint, inf without them, NaN where it
        cannot slide as a whole), and ``slip`` (length that the closed faces have moved along each other, the
        most). Of interfaces that were eliminated as supports or glue, the
        reactions; their points carry no pressure that is known. Collective on several ranks.

        A random answer has a row per statistic: mean, standard deviation and quantiles of the number itself,
        sample by sample (the largest pressure of each sample, not that of the mean); a quadrature has no
        quantiles. A sweep has a row per point.

        Parameters
        ----------
        interfaces
            Names; None: all.
        step
            Of a load history; None: all, one row each.
        about
            Point (d,) of the moments; None: the centroid of each interface.
        quantiles
            Probabilities, where the answer is random.
        samples, seed
            Of a chaos: this many random samples (None: 4096).
        """
        self.problem.check_alike("table", step=step, about=about, quantiles=quantiles)
        read = self.readings(interfaces, samples, seed)
        found = tables.summarise(read, step, about, quantiles)
        beside = (*self.bridged(list(read.interfaces)), *slid(self.problem, read))
        return replace(found, notes=(*found.notes, *beside, *self.unsolved))

    def bridged(self, joints: Sequence[str]) -> tuple[str, ...]:
        """What beams carry of the shear of joints whose slip is asked for, a sentence each."""
        return ()

    @together("bolts")
    def bolts(
        self,
        interfaces: Sequence[str] | str | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
        samples: int | None = None,
        seed: int = 0,
    ) -> tables.Table:
        """Bolt forces of a load history before and after loading, see
        :func:`dolfinx_frontend.results.tables.bolts`; arguments as for :meth:`table`."""
        self.problem.check_alike("bolts", quantiles=quantiles)
        found = tables.bolts(self.readings(interfaces, samples, seed), quantiles)
        return replace(found, notes=(*found.notes, *self.unsolved))

    @together("readings")
    def readings(
        self, interfaces: Sequence[str] | str | None = None, samples: int | None = None, seed: int = 0
    ) -> Readings:
        """The numbers behind the tables, a number per sample and time step."""
        self.problem.check_alike("readings", interfaces=interfaces, samples=samples, seed=seed)
        return read(self, interfaces, samples, seed)

    def save(
        self, path: str | Path, fields: bool = True, samples: int | None = None, seed: int = 0
    ) -> None:
        """Write the answer to one HDF5 file, which :func:`dolfinx_frontend.load` reads in any process.

        Parameters
        ----------
        path
            ``.h5`` or ``.hdf5``; an existing file is replaced when the new one is complete.
        fields
            False: only what the tables need, no forces, jumps, displacements and meshes.
        samples, seed
            Of a chaos: the samples that the tables of the file are made of, as for :meth:`table`.

        Raises
        ------
        ResultFileError
            The file cannot be written.
        """
        checked_flag("save", "fields", fields)
        writing.save(self, path, fields, samples, seed)
