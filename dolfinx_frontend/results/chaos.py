"""The answer of a chaos run: its modes, samples of them, and how far it is from the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from latin_core import Laws, State, stochastic

from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known, checked_names, checked_whole
from dolfinx_frontend.common.describe import short, shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import read_only
from dolfinx_frontend.formats.chaos_file import Field, content, save_chaos
from dolfinx_frontend.formats.openturns import to_openturns
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.columns import Collocation
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.random_laws import RandomLaws, sampled_parameters
from dolfinx_frontend.results.acting import load_factors
from dolfinx_frontend.results.answer import (
    BYTES,
    CACHED,
    SAMPLES,
    AnswerKind,
    Block,
    Of,
    chunks,
    stepped,
    timed,
)
from dolfinx_frontend.results.contact import BondValues, ContactValues
from dolfinx_frontend.results.moments import Accumulator, of_modes
from dolfinx_frontend.results.readings import Readings
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.resultant import Interest, Resultant, asked
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.results.surfaces import law_values
from dolfinx_frontend.results.uncertain import StochasticResult
from dolfinx_frontend.results.witnessed import WitnessedQuantity
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.laws import Fields
from dolfinx_frontend.scene.loads import LoadTerm
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.quantities import Inputs, Kind, Quantity
from dolfinx_frontend.uncertainty.space import RandomSpace, Sobol
from dolfinx_frontend.uncertainty.statistics import NOISE, MeanStd

__all__ = ["ChaosResult", "Sampler", "TruncationError"]

SAMPLES_OF_MOMENTS = 2**12
"""Sobol points from which the moments of the force of a nonlinear law are computed."""

CHUNK = 512
"""Samples of a field that are evaluated at once."""

POINTS_OF_MISFIT = 2**8
"""Sobol points at which a linear law is compared with its chaos."""

TRUSTED = 3.0
"""A stated error is right within this factor."""


@dataclass(frozen=True)
class TruncationError:
    """How far the chaos is from the answer it truncates, in the force of one interface.

    Attributes
    ----------
    decay
        Estimate from the coefficients: size of the modes of highest degree over the standard deviation,
        carried on as a geometric series where they fall from degree to degree.
    sample
        Root mean square over check points of the difference to deterministic solves, over the standard
        deviation; NaN if no points were asked for.
    points
        Number of check points.
    interface
        Interface whose force was compared.
    mean, std
        Relative errors of mean and standard deviation of the force per point, in the norm over the interface:
        the difference that the check points show, the chaos being their control variate, plus two standard
        errors of it.
    resultant_mean, resultant_std
        The same of the total force: its normal part (sum of f_n) and its tangential part, together.
    estimate
        The largest of these four without the standard errors.
    """

    decay: float
    sample: float
    points: int
    interface: str
    mean: float = np.nan
    std: float = np.nan
    resultant_mean: float = np.nan
    resultant_std: float = np.nan
    estimate: float = np.nan

    @property
    def resultant(self) -> float:
        """The larger error of the resultant."""
        return max(self.resultant_mean, self.resultant_std)

    @property
    def error(self) -> float:
        """The largest of the errors of mean and standard deviation."""
        return max(self.resultant, self.mean, self.std)

    def __str__(self) -> str:
        return (
            f"{self.interface}: resultant within {percent(self.resultant_mean)} (mean) and "
            f"{percent(self.resultant_std)} (standard deviation), per point within "
            f"{percent(self.mean)} and {percent(self.std)}"
        )


def _at_points(block: Array, psi: Array) -> Array:
    """Columns (m, components, modes, steps) at points, psi (n, modes) there: (m, components, n, steps)."""
    m, components, modes, steps = block.shape
    flat = np.moveaxis(block, 2, 3).reshape(-1, modes)
    return np.swapaxes((flat @ psi.T).reshape(m, components, steps, len(psi)), 2, 3)


def _moments(blocks: Sequence[Array]) -> tuple[Array, Array]:
    """Mean and standard deviation (m, components, steps) of blocks (m, components, samples, steps), which are
    overwritten."""
    count = sum(each.shape[2] for each in blocks)
    mean = np.asarray(sum(each.sum(axis=2) for each in blocks) / count)
    square = np.zeros(mean.shape)
    for each in blocks:
        each -= mean[:, :, None]
        square += np.einsum("pcnt,pcnt->pct", each, each)
    return mean, np.sqrt(square / count)


def percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _relative(difference: Array, whole: Array, weights: Array) -> float:
    """Norm of a difference over that of the whole."""
    size = float(np.sqrt(np.sum(weights * whole**2)))
    error = float(np.sqrt(np.sum(weights * difference**2)))
    return error / size if size > 0.0 else (np.inf if error > 0.0 else 0.0)


def _moment_errors(
    truth: Array, chaos: Array, mean: Array, variance: Array, weights: Array, rtol: float
) -> tuple[float, float, float]:
    """Bounds of the relative errors of mean and standard deviation of quantities, and the larger estimate.

    Parameters
    ----------
    truth, chaos
        (N, k) at the check points.
    mean, variance
        (k,) of the chaos, which is the control variate.
    weights
        (k,) of the norm.
    rtol
        Of the iterations.
    """
    count = len(truth)

    def estimate(samples: Array) -> tuple[Array, Array]:
        return samples.mean(axis=0), 2.0 * samples.std(axis=0, ddof=1) / np.sqrt(count)

    shift, margin = estimate(truth - chaos)
    better = mean + shift
    of_mean = [_relative(np.abs(shift) + m, better, weights) for m in (0.0 * margin, margin)]
    shift, margin = estimate((truth - better) ** 2 - (chaos - mean) ** 2)
    ends = [np.sqrt(np.maximum(variance + shift + s * margin, 0.0)) for s in (0.0, -1.0, 1.0)]
    away = [np.abs(end - np.sqrt(variance)) for end in ends]
    # a deviation that is only noise, e.g. of a resultant fixed by equilibrium, is compared with the mean
    noise = _relative(truth.std(axis=0, ddof=1), better, weights) <= NOISE * rtol
    whole = np.abs(better) if noise else ends[0]
    of_std = [_relative(d, whole, weights) for d in (away[0], np.max(away, axis=0))]
    return of_mean[1], of_std[1], max(of_mean[0], of_std[0])


class Sampler(Protocol):
    """Deterministic solves at points of the germs on the factorised problem of a chaos."""

    def __call__(
        self,
        result: ChaosResult,
        germs: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
        kind: Kind = "random",
        *,
        keep_states: bool = False,
        progress: bool = False,
        rtol: float | None = None,
    ) -> SampleResult: ...


@dataclass(frozen=True, eq=False, repr=False)
class ChaosResult(Result, StochasticResult):
    """Answer of one LATIN-PCE run; fields have one column per chaos mode.

    Over a load history every field has the T time steps in front of its own axes.

    Attributes
    ----------
    random, chaos, basis
        What is random, what was asked for, and the modes.
    proven
        Stiffnesses whose own Galerkin matrix is indefinite, run on because the structure as a whole was
        proven definite (``indefinite="prove"``); empty otherwise.
    collocations
        Interfaces whose law is nonlinear -> the quadrature points at which it is evaluated.
    checks
        Active interface -> its truncation, measured at the end of the run if a law is nonlinear.
    checked
        The deterministic solves of that measurement.
    misfits
        If all laws are linear: interface with a random law -> estimated relative error of mean and standard
        deviation of its force, see :meth:`misfit`, and ``"load.parameter"`` -> what the chaos leaves out of a
        random number of a load; None: not estimated.
    sampler
        Solves deterministically at points of the germs, see :meth:`sample`.
    """

    random: RandomLaws = field(kw_only=True)
    chaos: Chaos = field(kw_only=True)
    basis: stochastic.ChaosBasis = field(kw_only=True)
    proven: tuple[str, ...] = field(kw_only=True, default=())
    collocations: Mapping[str, Collocation] = field(kw_only=True, default_factory=dict)
    checks: Mapping[str, TruncationError] = field(kw_only=True, default_factory=dict)
    checked: tuple[SampleResult, ...] = field(kw_only=True, default=())
    misfits: Mapping[str, float] | None = field(kw_only=True, default=None)
    sampler: Sampler = field(kw_only=True)

    _notes = Result._notes | {"checks", "checked", "misfits"}

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    @property
    def modes(self) -> int:
        """P + 1."""
        return len(self.basis)

    @property
    def trusted(self) -> bool | None:
        """Whether the iteration converged and the truncation of every force is within ``chaos.tolerance``.

        If a law is nonlinear, by deterministic solves. Where all are linear, by :attr:`misfits`, an estimate
        without any solve: :meth:`truncation` measures it. None: it converged, and nothing is known of its
        truncation.
        """
        if not self.converged:
            return False
        if not self.collocations:
            if self.misfits is None:
                return None
            return all(each <= self.chaos.tolerance for each in self.misfits.values())
        if not self.checked or not all(part.converged for part in self.checked):
            return False
        return all(each.error <= self.chaos.tolerance for each in self.checks.values())

    @property
    def mean_laws(self) -> Laws:
        """The laws with every random parameter at its mean."""
        return self.solver.laws

    @property
    def mean_state(self) -> State | None:
        """None: the modes are no state of `mean_laws`."""
        return None

    @together("mean_std")
    def mean_std(self, quantity: Interest) -> MeanStd:
        """A total force or mean jump, of a history at its end, or what a function makes of the fields;
        collective."""
        what = asked("mean_std", self.problem.interfaces, quantity)
        if not isinstance(what, Resultant):
            values = what.sampled(self)
            return what.statistic.value(values, np.full(len(values), 1.0 / len(values)))
        if what.interface in self.collocations:
            sums = Accumulator()
            for block in self.moment_blocks():
                sums.add({"": what.at_end(self, block)}, block.weights)
            mean, std = sums.found()[""]
        else:
            mean, std = of_modes(self.resultant_coefficients(what))
        return MeanStd(float(mean), float(std))

    def resultant_coefficients(self, quantity: Resultant) -> Array:
        """Chaos coefficients (P + 1,) of a total force or mean jump, of a history at its end; collective."""

        def read() -> Array:
            block = self.force_coefficients if quantity.of == "force" else self.jump_coefficients
            values = quantity.total(
                np.moveaxis(block(quantity.interface), -1, 0),
                self.problem.interfaces[quantity.interface].weights,
            )
            return values if self.times is None else values[..., -1]

        return self.everywhere(quantity.interface, read)

    @property
    def kind(self) -> AnswerKind:
        """``"chaos"``."""
        return "chaos"

    @property
    def statistics(self) -> Kind:
        """``"random"``: the samples at which it is evaluated are independent."""
        return "random"

    def coefficients(self, substructure: str) -> Array:
        """Chaos coefficients ([T,] n, P + 1) of the unknowns of a substructure, length."""
        self._check_part(substructure)
        return self._blocks[substructure]

    @cached_property
    def _blocks(self) -> dict[str, Array]:
        amplitudes = amplitudes_of(self.plan, self.random, self.basis)
        blocks = self.solver.displacements(self.laws, self.state, amplitudes)
        return {
            name: read_only(timed(self.plan, block.reshape(len(block), self.modes, -1)))
            for name, block in blocks.items()
        }

    def unknowns(self, part: str) -> Array:
        """Mean ([T,] n) of the unknowns of a part, length."""
        return self.coefficients(part)[..., 0]

    def deviation(self, part: str) -> Array:
        """Standard deviation ([T,] n) of the unknowns of a part, length."""
        deviation: Array = np.sqrt(np.sum(self.coefficients(part)[..., 1:] ** 2, axis=-1))
        return deviation

    def spread(self, part: str) -> Sequence[Array]:
        """Modes ([T,] n) of the unknowns beside the mean, whose squares add up to the variance."""
        block = self.coefficients(part)
        return [block[..., k] for k in range(1, self.modes)]

    def _load_modes(self, load: str, parameter: str) -> Array:
        """Chaos coefficients (P + 1, [T]) of what a shape of a load is multiplied with."""
        of = partial(self.random.load_coefficients, basis=self.basis)
        return load_factors(self.problem, self.times, load, parameter, of)

    def stiffness_modes(self, part: str) -> Array | None:
        """Galerkin matrix (P + 1, P + 1) of the random factor of a part's stiffness; None: there is none."""
        if part not in self.random.scaled:
            return None
        matrix = self.random.space.galerkin_matrix(self.random.parts[part], self.basis)
        return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix)

    def stiffness_coupling(self, part: str) -> stochastic.Coupling | None:
        """What a random field adds to 1 in the factors of the cells of a part, on the modes; None: none."""
        source = self.random.fields.get(part)
        if source is None:
            return None
        coefficients, indices = self.random.space.expansion(source, self.basis)
        change = np.array(coefficients)
        change[:, indices.find([0] * self.random.space.dimension)] -= 1.0
        return stochastic.Coupling(self.basis, change, indices)

    def load_number(self, load: str, parameter: str) -> Array:
        """Mean ([T]) of what a shape of a load of a part is multiplied with."""
        number: Array = self._load_modes(load, parameter)[0]
        return number

    def load_spread(self, load: str, parameter: str) -> Sequence[Array]:
        """Its modes ([T]) beside the mean."""
        return list(self._load_modes(load, parameter)[1:])

    def modes_of(self, interface: str) -> tuple[Array, Array] | None:
        """Coefficients (P + 1, [T,] m, components) of force and jump; None where the law is nonlinear."""
        return None if interface in self.collocations else self._modes_of(interface)

    def _modes_of(self, name: str) -> tuple[Array, Array]:
        self._check_interface(name)
        if name in self.plan.active:
            force, jump = (np.moveaxis(timed(self.plan, b), -1, 0) for b in self._columns_of(name))
            return force, jump

        def modes(part: str, unknowns: Ints | None) -> Array:
            block = self.coefficients(part)
            return np.moveaxis(block if unknowns is None else block[..., unknowns, :], -1, 0)

        force, jump = self._eliminated(name, modes)
        # what does not depend on the displacements is in the mean only
        still, _ = self._eliminated(name, lambda part, unknowns: np.zeros_like(modes(part, unknowns)[:1]))
        force[1:] -= still
        return force, jump

    def _interface_moments(self, name: str, of: Of) -> tuple[Array, Array]:
        if of == "force" and name in self.collocations:
            mean, variance = self._sampled_moments(name)[:2]
            return mean, np.sqrt(variance)
        return super()._interface_moments(name, of)

    def moment_blocks(self) -> Iterator[Block]:
        """The samples of :meth:`moment_germs`, some at a time."""
        for germs in self._in_parts(self.moment_germs()):
            # of Sobol points all of which count the same
            yield replace(self.at(germs), weights=np.ones(len(germs)))

    def moment_germs(self) -> Array:
        """Points (N, L) of the germs from which moments of a nonlinear law are computed."""
        return self.space.sample_sobol(SAMPLES_OF_MOMENTS, 0)

    def _sampled_moments(self, interface: str) -> tuple[Array, Array, Array, Array]:
        """Mean and variance of the force ([T,] m, components) and of its resultant, from Sobol points."""
        if interface not in self._moments:
            germs = self.moment_germs()
            # about a first sample, so that nothing cancels
            origin = self.at(germs[:1]).force(interface)[0]
            total = self._resultant(interface, origin[None])[0]
            sums = [np.zeros_like(origin), np.zeros_like(origin), 0.0 * total, 0.0 * total]
            chunk = max(1, CHUNK // self.steps)
            for i in range(0, len(germs), chunk):
                force = self.at(germs[i : i + chunk]).force(interface)
                for k, part in ((0, force - origin), (2, self._resultant(interface, force) - total)):
                    sums[k] += part.sum(axis=0)
                    sums[k + 1] += (part**2).sum(axis=0)
            first, second, r_first, r_second = (each / len(germs) for each in sums)
            self._moments[interface] = (
                read_only(origin + first),
                read_only(np.maximum(second - first**2, 0.0)),
                read_only(total + r_first),
                read_only(np.maximum(r_second - r_first**2, 0.0)),
            )
        return self._moments[interface]

    @cached_property
    def _moments(self) -> dict[str, tuple[Array, Array, Array, Array]]:
        """What was sampled already."""
        return {}

    def _resultant(self, name: str, force: Array) -> Array:
        """Total normal and tangential force, (N, [T,] 1 + d), of forces (N, [T,] m, components)."""
        interface = self.problem.interfaces[name]
        weighted = interface.weights[:, None] * force
        frames = interface.frames[:, 1 : force.shape[-1]]
        shear = np.einsum("...pt,ptd->...d", weighted[..., 1:], frames)
        return np.concatenate([weighted[..., 0].sum(axis=-1)[..., None], shear], axis=-1)

    def _flexibility(self, name: str) -> Array:
        """1/k1 (+ 1/k2) of an interface, (m, components)."""
        return self.solver.flexibility(name).reshape(self.problem.interfaces[name].num_points, -1)

    def mode(self, part: str, index: int, step: int = -1) -> fem.Function:
        """Chaos coefficient u_index of the displacement (paper, Fig. 8)."""
        if not 0 <= checked_whole("mode", "index", index) < self.modes:
            raise SceneError(f"mode: there is no mode {index}, the chaos has {self.modes}")
        step = check_step(self.times, step, "mode")
        block = stepped(self.coefficients(part)[..., index], self.times)
        return self.function(part, block[step], f"u{index}")

    def force_coefficients(self, interface: str) -> Array:
        """Chaos coefficients ([T,] m, components, P + 1) of the force per area on side 1."""
        return np.moveaxis(self._modes_of(interface)[0], 0, -1)

    def jump_coefficients(self, interface: str) -> Array:
        """Chaos coefficients ([T,] m, components, P + 1) of the jump."""
        return np.moveaxis(self._modes_of(interface)[1], 0, -1)

    @property
    def steps(self) -> int:
        """Columns of the run for each mode."""
        return self.state.data.shape[1] // self.modes

    def _columns_of(self, name: str) -> tuple[Array, Array]:
        """Force and jump of an active interface, (m, components, P + 1, steps) each; they are kept."""
        if name not in self._columns:
            check_known("active interface", name, self.plan.active, "chaos result")
            points = self.problem.here(name).num_points
            force, jump = (
                read_only(np.ascontiguousarray(block.reshape(points, -1, self.modes, self.steps)))
                for block in self._kernel_fields(name)
            )
            self._columns[name] = force, jump
        return self._columns[name]

    @cached_property
    def _columns(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def _local(self, name: str) -> tuple[Array, Array]:
        """Mean force and jump ([T,] m, components) of an interface."""
        force, jump = self._modes_of(name)
        return force[0], jump[0]

    def sobol(self, interface: str) -> dict[str, Sobol]:
        """Sobol indices ([T *] m * components,) of the interface force, by random source.

        NaN where it scatters by no more than its error, relative to the largest force. Those of any number
        are ``quantity(...).sobol()``.
        """
        block = self.force_coefficients(interface).reshape(-1, self.modes)
        deviations = np.sqrt(np.sum(block[:, 1:] ** 2, axis=1))
        least = TRUSTED * self.error * max(np.abs(block[:, 0]).max(), deviations.max())
        none = np.where(deviations > least, 0.0, np.nan)
        found = self.space.sobol(block, self.basis)
        return {name: Sobol(each.first + none, each.total + none) for name, each in found.items()}

    def at(self, germs: npt.ArrayLike) -> Block:
        """Fields at points (N, L) of the germs."""
        points = self.space.checked_points(germs, "at")
        psi = self.basis.evaluate(points)
        # the products with modes that follow are to be finite as well
        far = np.flatnonzero(~(np.abs(psi).max(axis=1) < 1e150))
        if far.size:
            raise SceneError(
                f"at: the chaos has no numbers at the germs {short(points[far[0]].tolist())}: germs are of "
                "order 1 (standard normal, or within [-1, 1])"
            )

        def displacement(part: str, unknowns: Ints | None) -> Array:
            block = self.coefficients(part)
            return np.moveaxis((block if unknowns is None else block[..., unknowns, :]) @ psi.T, -1, 0)

        def both(name: str) -> tuple[Array, Array]:
            self._check_interface(name)
            if name in self.plan.active:
                return self._sampled(name, points, psi)
            return self._eliminated(name, displacement)

        def contact(name: str) -> ContactValues | BondValues | None:
            parameters = partial(self._parameters_at, name, points)
            return law_values(self.problem, self.plan, name, len(points), parameters)

        def force(name: str) -> Array:
            self._check_interface(name)
            if name in self.plan.active and name not in self.collocations:  # the jump costs as much again
                return np.moveaxis(timed(self.plan, _at_points(self._columns_of(name)[0], psi)), -1, 0)
            return both(name)[0]

        number = partial(self.random.load_values, points=points)
        load = partial(load_factors, self.problem, self.times, of=number)
        parts = self.problem.substructures
        return Block(len(points), both, displacement, contact, points, None, force, load, parts)

    def _parameters_at(self, name: str, points: Array, fields: Fields) -> dict[str, Array]:
        return sampled_parameters(self.random, name, points, fields, self.plan.steps)

    def _sampled(self, name: str, points: Array, psi: Array) -> tuple[Array, Array]:
        """Force and jump (n, [T,] m, components) of an active interface at points of the germs."""
        force, jump = (_at_points(block, psi) for block in self._columns_of(name))
        if name in self.collocations:
            shape = force.shape
            free = jump + self._flexibility(name)[..., None, None] * force
            fields = bridge.active_fields(self.problem.interfaces[name], self.plan)
            parameters = sampled_parameters(self.random, name, points, fields, shape[-1])
            free = np.asfortranarray(free.reshape(shape[0] * shape[1], -1))
            found = self.solver.resolve_samples(self.laws, name, free, parameters)
            force, jump = (block.reshape(shape) for block in found)
        force, jump = (timed(self.plan, block) for block in (force, jump))
        return np.moveaxis(force, -1, 0), np.moveaxis(jump, -1, 0)

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """So many random samples (None: 4096), some at a time."""
        count = SAMPLES if samples is None else samples
        yield from map(self.at, self._in_parts(self.space.sample(count, seed)))

    def many(self, samples: int | None, seed: int) -> Iterator[Block]:
        """As `blocks`, so few samples at a time that their fields stay in the cache."""
        germs = self.space.sample(SAMPLES if samples is None else samples, seed)
        yield from map(self.at, self._in_parts(germs, CACHED))

    def quantity(
        self,
        function: Callable[[Block], npt.ArrayLike] | str,
        name: str = "quantity",
        unit: str = "",
        samples: int | None = None,
        seed: int = 0,
        step: int = -1,
    ) -> Quantity:
        """A scalar quantity of interest, evaluated at random samples of the chaos, see
        :meth:`Result.quantity`.

        Its probabilities and quantiles solve some of these samples, and their intervals carry the error of
        the chaos: see :class:`WitnessedQuantity`. On several ranks they do not.
        """
        found = super().quantity(function, name, unit, samples, seed, step)
        if self.problem.comm is not None:
            return found

        def solve(which: npt.NDArray[np.int64]) -> Array:
            germs = self.space.sample(len(found), seed)[which]
            solved = self.sampler(self, germs, keep_states=True)
            return solved.quantity(function, name, step=step).values

        return WitnessedQuantity(
            name=name, unit=unit, values=found.values, kind=found.kind, inputs=found.inputs, solve=solve
        )

    def inputs(self, number: Callable[[Block], Array], germs: Array) -> Inputs:
        """The germs, and the chaos as what it is evaluated by."""

        def at(points: Array) -> Array:
            return np.concatenate([number(self.at(part)) for part in self._in_parts(points, CACHED)])

        return Inputs(self.space, germs, TRUSTED * self.error, at)

    @together("readings")
    def readings(
        self, interfaces: Sequence[str] | str | None = None, samples: int | None = None, seed: int = 0
    ) -> Readings:
        """The numbers behind the tables, a number per sample and time step; the last ones are kept."""
        if not isinstance(interfaces, str | list | tuple | None) or not isinstance(seed, int):
            return super().readings(interfaces, samples, seed)
        # in words, because a list may hold anything; what is wrong is refused and never kept
        key = repr((interfaces, samples, seed))
        self.problem.check_alike("readings", interfaces=interfaces, samples=samples, seed=seed)
        if key not in self._readings:
            found = super().readings(interfaces, samples, seed)
            self._readings.clear()
            self._readings[key] = found
        return self._readings[key]

    @cached_property
    def _readings(self) -> dict[str, Readings]:
        return {}

    def _in_parts(self, germs: Array, size: float = BYTES) -> Iterator[Array]:
        steps = 1 if self.times is None else len(self.times)
        most = max(i.num_points for i in self.problem.interfaces.values()) * self.problem.dim * steps
        return (germs[part] for part in chunks(len(germs), most, size))

    def save_chaos(self, path: str | Path, substructures: Sequence[str] = ()) -> None:
        """Write the chaos of all active interfaces (force, jump) and of the named substructures.

        The file (``.h5`` or ``.json``, see ``docs/chaos_file.md``) can be evaluated without this package.
        Collective; the first of several ranks writes.
        """
        fields, notes = self.chaos_fields(substructures)
        with agreement(self.problem.comm, "save_chaos"):
            if self.problem.rank == 0:
                save_chaos(path, self.space, self.basis, fields, notes)

    def chaos_fields(self, substructures: Sequence[str] = ()) -> tuple[dict[str, Field], dict[str, Any]]:
        """Fields and notes of the file that :meth:`save_chaos` writes; collective, all on the first rank."""
        substructures = checked_names("save_chaos", "substructures", substructures)
        for name in substructures:
            check_known("substructure", name, self.problem.parts, "save_chaos")
        return self._fields_of(self.plan.active, substructures)

    def _fields_of(
        self, interfaces: Sequence[str], substructures: Sequence[str]
    ) -> tuple[dict[str, Field], dict[str, Any]]:
        fields: dict[str, Field] = {}
        comm = self.problem.comm
        with agreement(comm, "chaos fields"):
            for name in interfaces:
                if comm is None or name in self.problem.own.interfaces:
                    fields |= self._fields_of_interface(name)
            for name in substructures:
                if comm is None or name in self.problem.substructures:
                    block = self.coefficients(name)
                    fields[f"displacement:{name}"] = Field(
                        block.reshape(-1, self.modes), "length", block.shape[:-1]
                    )
        if comm is not None:
            every = comm.gather(fields, root=0) or [fields]
            known = {name: each for of_rank in reversed(every) for name, each in of_rank.items()}
            names = [f"{what}:{name}" for name in interfaces for what in ("force", "jump")]
            names += [f"displacement:{name}" for name in self.problem.parts]
            fields = {name: known[name] for name in names if name in known}
        return fields, {"order": int(self.chaos.order), "error": self.error, "status": self.status}

    def _fields_of_interface(self, name: str) -> dict[str, Field]:
        return {
            f"{what}:{name}": Field(
                block.reshape(-1, self.modes), unit, block.shape[:-1], f"{what} of {name}"
            )
            for what, block, unit in (
                ("force", self.force_coefficients(name), "force / area"),
                ("jump", self.jump_coefficients(name), "length"),
            )
        }

    def extra_content(self, parts: Sequence[str], samples: int | None, seed: int) -> dict[str, Any]:
        """What a file has of a chaos beside what it has of all: the chaos itself."""
        known = self.known if parts else self.plan.active
        return {
            "chaos": content(self.space, self.basis, *self._fields_of(known, parts)),
            "nonlinear": list(self.collocations),
            "germs": self.space.sample(SAMPLES if samples is None else samples, seed),
        }

    def save(self, path: str | Path, fields: bool = True, samples: int | None = None, seed: int = 0) -> None:
        """As :meth:`Result.save`, with the whole chaos, and the samples that its tables are made of."""
        super().save(path, fields, samples, seed)

    def to_openturns(self, interface: str, inputs: Literal["parameters", "germs"] = "parameters") -> Any:
        """The force (m * components outputs) of an active interface as OpenTURNS' chaos result."""
        block = self.force_coefficients(interface).reshape(-1, self.modes)
        return to_openturns(self.space, self.basis, block, inputs=inputs)

    @together("sample")
    def sample(
        self,
        germs: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
        kind: Kind = "random",
        *,
        keep_states: bool = False,
        progress: bool = False,
        rtol: float | None = None,
    ) -> SampleResult:
        """Deterministic solves at points (N, L) of the germs: as
        :func:`dolfinx_frontend.evaluate.sampling.sample`, on the factorised problem of this result and
        started from what its chaos predicts; to its tolerance, or to `rtol`."""
        return self.sampler(self, germs, weights, kind, keep_states=keep_states, progress=progress, rtol=rtol)

    @together("monte_carlo")
    def monte_carlo(
        self,
        samples: int,
        seed: int = 0,
        *,
        keep_states: bool = False,
        progress: bool = False,
        rtol: float | None = None,
    ) -> SampleResult:
        """As :func:`dolfinx_frontend.monte_carlo`, on this result's solver, started from its chaos."""
        germs = self.space.sample(samples, seed)
        self.problem.check_alike("monte_carlo", samples=samples, seed=seed)
        return self.sample(germs, keep_states=keep_states, progress=progress, rtol=rtol)

    @together("quasi_monte_carlo")
    def quasi_monte_carlo(
        self,
        samples: int,
        seed: int = 0,
        *,
        keep_states: bool = False,
        progress: bool = False,
        rtol: float | None = None,
    ) -> SampleResult:
        """As :func:`dolfinx_frontend.quasi_monte_carlo`, on this result's solver, started from its chaos."""
        germs = self.space.sample_sobol(samples, seed)
        self.problem.check_alike("quasi_monte_carlo", samples=samples, seed=seed)
        return self.sample(germs, kind="qmc", keep_states=keep_states, progress=progress, rtol=rtol)

    @together("truncation")
    def truncation(self, interface: str, points: int = 16, seed: int = 1) -> TruncationError:
        """Estimate the error of the truncation in the force of an interface; collective.

        Parameters
        ----------
        interface
            An active interface.
        points
            Deterministic solves at independent points of the germs; 0: only the decay.
        """
        checked_whole("truncation", "points", points, 0)
        self.problem.check_alike("truncation", interface=interface, points=points, seed=seed)
        # before the solves: on all ranks it is an interface with a chaos, or on none
        decay, deviation = self.everywhere(interface, lambda: self._decay(interface))
        if points == 0:
            return TruncationError(decay, np.nan, 0, interface)
        truth = [self.sample(self.space.sample(points, seed))]
        return self.everywhere(interface, lambda: self.compared(interface, truth))

    def _decay(self, interface: str) -> tuple[float, float]:
        """Estimate from the coefficients, and standard deviation of the force in the interface's norm."""
        block = self.force_coefficients(interface)
        weights = self.problem.interfaces[interface].weights
        share = (weights[:, None, None] * block**2).reshape(-1, self.modes).sum(axis=0)
        deviation = float(np.sqrt(share[1:].sum()))
        degree = self.basis.indices.table.sum(axis=1)
        by_degree = [float(np.sqrt(share[degree == d].sum())) for d in range(1, degree.max() + 1)]
        decay = np.nan
        if deviation > 0.0 and by_degree:
            ratio = by_degree[-1] / by_degree[-2] if len(by_degree) > 1 and by_degree[-2] > 0 else 1.0
            ratio = min(ratio, 0.9)
            decay = by_degree[-1] * ratio / np.sqrt(1.0 - ratio**2) / deviation
        return float(decay), deviation

    @cached_property
    def points_of_misfit(self) -> Array:
        """Points (N, L) of the germs at which :meth:`misfit` asks the laws."""
        return read_only(self.space.sample_sobol(POINTS_OF_MISFIT, 1))

    def misfit(self, interface: str) -> float:
        """How far the chaos is from the linear law of an interface with something random.

        Equilibrium holds for every mode, the law for as many as there are: at points of the germs it fails by
        what the truncation left out. One local stage there, and the answer of the parts to it, give the force
        that the law wants; the result is the larger relative change of mean and standard deviation. The parts
        answer to a change as they do to what is random, see :meth:`_compliance`. What the chaos cannot
        represent is orthogonal to it, and adds its square to the variance.
        """
        germs = self.points_of_misfit
        weights = self.problem.interfaces[interface].weights[:, None, None, None]
        fields = bridge.active_fields(self.problem.interfaces[interface], self.plan)
        flexible = self._flexibility(interface)[..., None, None]
        compliance = self._compliance(interface)
        chunk = max(1, CHUNK // self.steps)
        own, better, square = [], [], 0.0
        for i in range(0, len(germs), chunk):
            points = germs[i : i + chunk]
            psi = self.basis.evaluate(points)
            force, jump = (_at_points(block, psi) for block in self._columns_of(interface))
            parameters = sampled_parameters(self.random, interface, points, fields, self.steps)
            free = np.asfortranarray((jump + flexible * force).reshape(force.shape[0] * force.shape[1], -1))
            shift = float(np.abs(free).max()) or 1.0
            found, there = (
                self.solver.resolve_samples(self.laws, interface, each, parameters)[0].reshape(force.shape)
                for each in (free, free + shift)
            )
            # laws are linear: 1 where the jump is given, 0 where the force is; in place, for blocks are large
            given = np.subtract(there, found, out=there)
            given *= flexible / shift
            np.clip(given, 0.0, 1.0, out=given)
            given *= compliance - 1.0
            given += 1.0
            change = np.subtract(found, force, out=found)
            change /= given
            square += float(weights.ravel() @ np.einsum("pcnt,pcnt->p", change, change)) / len(germs)
            own.append(force)
            better.append(np.add(change, force, out=change))
        scale = weights[..., 0]
        (mean, std), (mean_exact, deviation) = (_moments(each) for each in (own, better))
        of_mean = _relative(mean - mean_exact, mean_exact, scale)
        spread = float(np.sum(scale * deviation**2))
        size = float(np.sum(scale * mean_exact**2))
        if spread <= (NOISE * self.plan.options.rtol) ** 2 * size:  # noise, as in a check
            return of_mean
        of_std = _relative(std - deviation, deviation, scale)
        return max(of_mean, of_std, square / spread)

    def misfit_of(self, term: LoadTerm) -> float:
        """What the chaos leaves out of a random number of a load, which it holds by its modes: the larger
        relative error of mean and standard deviation, or of the variance."""
        germs = self.space.sample_sobol(SAMPLES_OF_MOMENTS, 1)
        exact = self.random.load_values(term, germs)
        modes = self.random.load_coefficients(term, self.basis)
        pieces = (germs[i : i + CHUNK] for i in range(0, len(germs), CHUNK))
        found = np.concatenate([self.basis.evaluate(each) @ modes for each in pieces])
        size, deviation = float(np.sqrt(np.mean(exact**2))), float(exact.std())
        if size == 0.0 or deviation == 0.0:
            return 0.0
        left = exact - found
        of_std = abs(float(found.std()) / deviation - 1.0)
        return max(abs(float(left.mean())) / size, of_std, float(np.mean(left**2)) / deviation**2)

    def _compliance(self, interface: str) -> Array:
        """What the jump varies by for a force that varies by 1, relative to the search directions.

        That of the parts where only the law of the interface is random; (m, components, 1, 1).
        """
        weights = self.problem.interfaces[interface].weights[:, None, None, None]
        force, jump = (
            np.sqrt(np.sum(weights * block[:, :, 1:] ** 2, axis=(0, 2, 3)))
            for block in self._columns_of(interface)
        )
        flexible = self._flexibility(interface)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = jump / (force * flexible)
        usual = np.where(np.isnan(found), 1.0, np.clip(found, 1e-8, 1e8))  # 0 / 0: nothing varies
        return np.asarray(usual[..., None, None], dtype=np.float64)

    def acts(self, interface: str, truth: Sequence[SampleResult]) -> float:
        """How much force an interface has in deterministic solves; of a moment, on the length of the part."""
        of = self.problem.interfaces[interface]
        force = np.concatenate([part.force(interface) for part in truth])
        squares = (of.weights[:, None] * force**2).sum(axis=(-2, -1))
        size = float(np.sqrt(of.weights.sum() * squares.max(initial=0.0)))
        if of.wrench is None:
            return size
        length = self.problem.substructures[of.sides[0].substructure].length
        arms = np.where(np.arange(len(of.wrench)) < of.dim, 1.0, 1.0 / length)
        return size * float(np.linalg.norm(arms * of.wrench))

    def compared(self, interface: str, truth: Sequence[SampleResult], least: float = 0.0) -> TruncationError:
        """The chaos against deterministic solves; an interface whose force is below `least` is right."""
        if self.acts(interface, truth) <= least:
            count = sum(len(part.germs) for part in truth)
            return TruncationError(0.0, 0.0, count, interface, 0.0, 0.0, 0.0, 0.0, 0.0)
        decay, deviation = self._decay(interface)
        exact = np.concatenate([part.force(interface) for part in truth])
        own = np.concatenate([self.at(part.germs).force(interface) for part in truth])
        weights = self.problem.interfaces[interface].weights
        square = (weights[:, None] * (exact - own) ** 2).reshape(len(exact), -1).sum(axis=1)
        measured = float(np.sqrt(square.mean())) / deviation if deviation > 0.0 else np.nan
        count = len(exact)
        if count < 2:
            return TruncationError(decay, measured, count, interface)
        mean, variance, total, total_variance = self._sampled_moments(interface)
        of_mean, of_std, estimate = _moment_errors(
            exact.reshape(count, -1),
            own.reshape(count, -1),
            mean.ravel(),
            variance.ravel(),
            np.broadcast_to(weights[:, None], exact.shape[1:]).ravel(),
            self.plan.options.rtol,
        )
        total_mean, total_std, total_estimate = _moment_errors(
            self._resultant(interface, exact).reshape(count, -1),
            self._resultant(interface, own).reshape(count, -1),
            total.ravel(),
            total_variance.ravel(),
            np.ones(total.size),
            self.plan.options.rtol,
        )
        return TruncationError(
            decay,
            measured,
            count,
            interface,
            of_mean,
            of_std,
            total_mean,
            total_std,
            max(estimate, total_estimate),
        )

    def __repr__(self) -> str:
        text = (
            f"ChaosResult({self.status}, {self.modes} modes of order {self.chaos.order} in "
            f"{self.space.dimension} germs, {self.iterations} iterations, estimated error "
            f"{shown_error(self.error)}{self._where()}, {sum(self.seconds.values()):.2f} s"
        )
        if self.collocations:
            limit = percent(self.chaos.tolerance)
            verdict = f"trusted to {limit}" if self.trusted else f"NOT TRUSTED to {limit}"
            measured = "".join(f"\n  {c}" for c in self.checks.values()) or " not checked"
            solves = sum(len(part.germs) for part in self.checked)
            text += f";\n  truncation {verdict} by {solves} deterministic solves:{measured}"
        elif self.misfits and not self.trusted:
            worst = max(self.misfits, key=lambda name: self.misfits[name] if self.misfits else 0.0)
            text += (
                f";\n  truncation NOT TRUSTED to {percent(self.chaos.tolerance)}: about "
                f"{percent(self.misfits[worst])} in {worst}"
            )
        return text + ")"


def amplitudes_of(plan: Plan, random: RandomLaws, basis: stochastic.ChaosBasis) -> Array:
    """Amplitudes (l, modes * steps) of the load patterns: those of loads that vary have the modes of
    these."""
    found = [np.kron(np.eye(1, len(basis)), plan.fixed_amplitudes)]
    for term, factors in zip(plan.loads, plan.load_factors, strict=True):
        found.append(np.kron(random.load_coefficients(term, basis), factors)[None])
    return np.asfortranarray(np.vstack(found), dtype=np.float64)
