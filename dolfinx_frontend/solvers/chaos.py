"""LATIN with polynomial chaos: the columns of the iteration are chaos modes (paper, section 4.3).

The global stage does not change: P + 1 right-hand sides of one factorisation. On an interface with a random
stiffness kappa = sum_i kappa_i Psi_i the law f = kappa (j - Delta) becomes, mode by mode,

    f_k = sum_j A_kj (j_j - Delta_j),     A_kj = sum_i kappa_i E[Psi_i Psi_j Psi_k],

one system of size P + 1 a point and direction. A = V diag(lambda) V^T decouples it: in the columns j V the
law is the deterministic one with the stiffness lambda_q. So the kernel runs the same laws and the same
iteration as for one column, and its fixed point is the stochastic Galerkin solution (equations 17 and 19).

A law that is not linear (contact, friction) is evaluated at stochastic quadrature points instead, see
:mod:`dolfinx_frontend.solvers.collocation`. The response then has kinks, and its chaos converges slowly:
such an answer is compared with deterministic solves at check points before it is handed out.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from latin_core import Iteration, Options, State, stochastic
from latin_core import Problem as Kernel

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.running import iterate
from dolfinx_frontend.plan.plan import Decision, Direction, Method, Plan, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws, Source, sampled_parameters
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.uncertain import StochasticResult, one_number_a_sample, timed
from dolfinx_frontend.solvers.collocation import Collocation, collocation
from dolfinx_frontend.solvers.deterministic import fields_of_cuts, start_states
from dolfinx_frontend.solvers.sampling import SampleResult, sample_on
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.quantities import Quantity
from dolfinx_frontend.uncertainty.space import RandomSpace, Sobol

if TYPE_CHECKING:
    from dolfinx_frontend.io.chaos_file import Field

__all__ = [
    "ChaosResult",
    "FieldSamples",
    "Galerkin",
    "IndefiniteError",
    "NearlyIndefiniteWarning",
    "TruncationError",
    "TruncationWarning",
    "carry_on",
    "galerkin",
    "solve_chaos",
]


NEAR = 0.1
"""A smallest eigenvalue below this share of the mean is reported."""
SAMPLES_OF_MOMENTS = 2**12
"""Sobol points from which the moments of the force of a law that is not linear are computed."""
CHUNK = 512
"""Samples of a field that are evaluated at once."""
MOST_CHECKS = 4
"""Times ``check_points`` that a check takes at most."""
STARTS = 256
"""Samples at most for which the chaos predicts a start."""


class IndefiniteError(SceneError):
    """A random stiffness whose Galerkin matrix is not positive definite: its chaos means nothing."""


class NearlyIndefiniteWarning(UserWarning):
    """A random stiffness whose Galerkin matrix is close to losing definiteness."""


class TruncationWarning(UserWarning):
    """The chaos of a scene that is not linear is further from deterministic solves than was asked for."""


@dataclass(frozen=True)
class Galerkin:
    """Galerkin matrix of one random stiffness, in its eigenbasis.

    Attributes
    ----------
    interface, parameter, source
        Whose it is.
    forward
        One V (P + 1, P + 1), or one for each interface point if the source is a field.
    values
        (1 or m, P + 1) eigenvalues, per area.
    """

    interface: str
    parameter: str
    source: Source
    forward: list[Array] = field(repr=False)
    values: Array = field(repr=False)

    @property
    def smallest(self) -> float:
        """Smallest eigenvalue, force / length^3."""
        return float(self.values.min())


def galerkin(random: RandomLaws, basis: stochastic.ChaosBasis) -> dict[tuple[str, str], Galerkin]:
    """Galerkin matrices of all random stiffnesses, by (interface, parameter)."""
    done: dict[int, tuple[list[Array], Array]] = {}
    matrices = {}
    for (name, parameter), source in random.sources.items():
        if parameter not in ("normal", "tangential") or not random.linear(name):
            continue
        if id(source) not in done:
            coefficients, indices = random.space.expansion(source, basis)
            transforms = [
                stochastic.galerkin_transform(stochastic.galerkin_matrix(basis, row, indices))
                for row in coefficients
            ]
            done[id(source)] = (
                [np.asfortranarray(t.forward) for t in transforms],
                np.array([t.values for t in transforms]),
            )
        forward, values = done[id(source)]
        scale = random.area_factor(name, parameter)
        matrices[name, parameter] = Galerkin(name, parameter, source, forward, scale * values)
    return matrices


def _limit(source: Source, basis: stochastic.ChaosBasis, space: RandomSpace) -> str:
    """What the coefficient of variation would have to be, where that is known."""
    if isinstance(source, DiscretisedField) or not source.affine:
        return ""
    column = space.germ_names.index(source.name)
    order = int(basis.indices.table[:, column].max(initial=0))
    limit = stochastic.critical_cov(source.germ, order)
    return (
        f" (order {order} in its germ allows a coefficient of variation below {limit:.5f}, "
        f"this one has {source.cov:.5g})"
    )


def _guard(
    problem: Problem,
    random: RandomLaws,
    basis: stochastic.ChaosBasis,
    matrices: dict[tuple[str, str], Galerkin],
    indefinite: Literal["refuse", "prove"],
) -> tuple[str, ...]:
    """Refuse indefinite stiffnesses before anything is iterated on; the overrides that were proven."""
    bad = []
    for matrix in matrices.values():
        source = matrix.source
        mean = source.mean * random.area_factor(matrix.interface, matrix.parameter)
        where = f"interface {matrix.interface!r}, {matrix.parameter} stiffness {source.name!r}"
        limit = _limit(source, basis, random.space)
        if matrix.smallest <= 0.0:
            bad.append(
                f"{where}: its Galerkin matrix is indefinite, smallest eigenvalue "
                f"{matrix.smallest:.4g} for a mean of {mean:.4g}{limit}"
            )
        elif matrix.smallest < NEAR * mean:
            warnings.warn(
                f"{where}: its Galerkin matrix is nearly indefinite, smallest eigenvalue "
                f"{matrix.smallest:.4g} for a mean of {mean:.4g}{limit}; higher orders make it worse: "
                "LogNormal, Gamma and TruncatedNormal stay positive at every order",
                NearlyIndefiniteWarning,
                stacklevel=4,
            )
    if not bad:
        return ()
    mend = (
        "use a positive law (LogNormal, Gamma, TruncatedNormal with a positive lower bound), a smaller "
        "coefficient of variation or a lower order"
    )
    if indefinite == "refuse":
        raise IndefiniteError(
            "\n".join(bad) + f"\n{mend}; or pass indefinite='prove' to go on if the structure as a "
            "whole is proven definite"
        )
    floors = {
        key: np.broadcast_to(
            matrix.values.min(axis=1), (problem.interfaces[key[0]].num_points,)
        )
        for key, matrix in matrices.items()
    }
    problem.on_one_rank("the proof that the structure is definite (indefinite='prove')")
    if not bridge.definite(problem, floors):
        raise IndefiniteError(
            "\n".join(bad) + "\nthe structure as a whole could not be proven definite either (Cholesky "
            f"with every random stiffness at its smallest eigenvalue breaks down); {mend}"
        )
    return tuple(bad)


@dataclass(frozen=True)
class Columns:
    """How one active interface sees the columns: its parameters in them, and column transforms."""

    parameters: dict[str, Array]
    groups: list[dict[str, Any]]


def _through(block: Array, by: list[Array], points: int, modes: int) -> Array:
    """Columns (rows, modes * steps), time steps fastest, times one matrix for all points or one for each."""
    if not by:
        return block
    steps = block.shape[1] // modes
    parted = block.reshape(points, -1, modes, steps)
    if len(by) == 1:
        result: Array = np.einsum("pcjs,jq->pcqs", parted, by[0])
    else:
        result = np.einsum("pcjs,pjq->pcqs", parted, np.array(by))
    return result.reshape(len(block), -1)


def _each_step(values: Array, columns: int, steps: int) -> Array:
    """Values (rows, 1), (rows, steps) or (rows, columns) in all columns * steps; one column stays one."""
    if values.shape[1] == 1:
        return values
    return np.tile(values, (1, columns)) if values.shape[1] == steps else np.repeat(values, steps, axis=1)


def _linear_parameters(
    random: RandomLaws, basis: stochastic.ChaosBasis, name: str, plan: Plan, steps: int
) -> dict[str, Array]:
    """Parameters of a linear law in the columns of the run: modes x steps, the steps fastest.

    Jumps and forces enter linearly: what is fixed fills mode 0, what is random is constant in time.
    """
    interface = random.problem.interfaces[name]
    modes = len(basis)
    values = {}
    for kernel, block in bridge.active_fields(interface, plan).parameters.items():
        if kernel in ("normal", "tangential"):
            values[kernel] = _each_step(block, modes, steps) if block.shape[1] == steps else block
            continue
        values[kernel] = np.zeros((len(block), modes * steps))
        values[kernel][:, :steps] = block
    # of the columns of a history, those that a constant value is part of
    constant = np.array([a is None for a in plan.patterns]) if plan.history == "patterns" else np.ones(steps)
    for parameter in interface.law.parameters():
        source = random.source(name, parameter)
        if source is None or parameter in ("normal", "tangential"):
            continue
        kernel, unit = bridge.kernel_parameter(interface, parameter)
        coefficients = random.space.coefficients(source, basis)
        if len(coefficients) > 1:
            coefficients = np.repeat(coefficients, len(unit) // len(coefficients), axis=0)
        values[kernel] = np.kron(unit * coefficients, constant)
    return values


def _columns(
    random: RandomLaws,
    basis: stochastic.ChaosBasis,
    name: str,
    matrices: dict[tuple[str, str], Galerkin],
    plan: Plan,
    steps: int,
) -> Columns:
    """Parameters and column transforms of an active interface with a linear law."""
    interface = random.problem.interfaces[name]
    fields = bridge.active_fields(interface, plan)
    linear = _linear_parameters(random, basis, name, plan, steps)
    if fields.kind != "elastic" or not any(key[0] == name for key in matrices):
        return Columns(linear, [])
    normal, tangential = (matrices.get((name, p)) for p in ("normal", "tangential"))
    spans: list[tuple[int, int, Galerkin | None]] = [(0, 1, normal)]
    if fields.components > 1:
        shared = normal is not None and tangential is not None
        if shared and normal.source is tangential.source:  # type: ignore[union-attr]
            spans = [(0, fields.components, normal)]
        else:
            spans.append((1, fields.components, tangential))
    groups = []
    for begin, end, matrix in spans:
        parameters = {}
        forward = matrix.forward if matrix is not None else []
        for key in ("normal", "tangential"):
            own = matrices.get((name, key))
            if own is not None and matrix is not None and own.source is matrix.source:
                parameters[key] = np.repeat(own.values, steps, axis=1)
            else:
                parameters[key] = _each_step(fields.parameters[key], len(basis), steps)
        parameters["jump"] = _through(linear["jump"], forward, interface.num_points, len(basis))
        groups.append(
            {
                "begin": begin,
                "end": end,
                "forward": forward,
                "backward": [np.asfortranarray(v.T) for v in forward],
                "parameters": parameters,
            }
        )
    # the law beside its groups keeps what it was built with: nothing reads it
    return Columns({}, groups)


@dataclass(frozen=True, repr=False)
class FieldSamples:
    """Fields at N points of the germs; what a quantity of interest is computed from.

    Attributes
    ----------
    germs
        (N, L).
    """

    germs: Array
    _result: ChaosResult = field(repr=False)
    _psi: Array = field(repr=False)

    def __repr__(self) -> str:
        return f"FieldSamples({len(self.germs)} points in {self.germs.shape[1]} germs)"

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (N, [T,] m, components), local frame: component 0 is normal.

        A law that is not linear is evaluated anew at every sample, with the parameters of the sample: it
        holds exactly, so that a contact never pulls.
        """
        return self.both(interface)[0]

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (N, [T,] m, components), local frame."""
        return self.both(interface)[1]

    def both(self, interface: str) -> tuple[Array, Array]:
        """Force and jump, for the work of one."""
        name = interface
        result = self._result
        blocks = result._columns_of(name)  # (m, components, modes, steps) each
        force, jump = (np.einsum("pcjs,nj->pcns", block, self._psi) for block in blocks)
        if name in result.collocations:
            shape = force.shape
            free = jump + result._flexibility(name)[..., None, None] * force
            fields = bridge.active_fields(result.problem.interfaces[name], result.plan)
            parameters = sampled_parameters(result.random, name, self.germs, fields, shape[-1])
            both = result.core.resolve_samples(
                name,
                np.asfortranarray(free.reshape(shape[0] * shape[1], -1)),
                list(parameters.items()),
            )
            force, jump = (block.reshape(shape) for block in both)
        force, jump = (timed(result.plan, block) for block in (force, jump))
        return np.moveaxis(force, -1, 0), np.moveaxis(jump, -1, 0)

    def displacement(self, substructure: str) -> Array:
        """Unknowns (N, [T,] n) of a substructure."""
        return np.moveaxis(self._result.coefficients(substructure) @ self._psi.T, -1, 0)


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
            f"{self.interface}: resultant within {_percent(self.resultant_mean)} (mean) and "
            f"{_percent(self.resultant_std)} (standard deviation), per point within "
            f"{_percent(self.mean)} and {_percent(self.std)}"
        )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


NOISE = 100.0
"""A standard deviation below so many times the tolerance, as a share of the mean, is noise."""


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
    # nothing but noise, say of a resultant that equilibrium fixes, is measured by the mean
    noise = _relative(truth.std(axis=0, ddof=1), better, weights) <= NOISE * rtol
    whole = np.abs(better) if noise else ends[0]
    of_std = [_relative(d, whole, weights) for d in (away[0], np.max(away, axis=0))]
    return of_mean[1], of_std[1], max(of_mean[0], of_std[0])


@dataclass
class ChaosResult(Result, StochasticResult):
    """Answer of one LATIN-PCE run; fields have one column a chaos mode.

    Over a load history every field has the T time steps in front of its own axes.

    Attributes
    ----------
    random, chaos, basis
        What is random, what was asked for, and the modes.
    proven
        Stiffnesses whose own Galerkin matrix is indefinite, run on because the structure as a whole was
        proven definite (``indefinite="prove"``); empty otherwise.
    collocations
        Interfaces whose law is not linear -> the quadrature points at which it is evaluated.
    checks
        Active interface -> its truncation, measured at the end of the run if a law is not linear.
    checked
        The deterministic solves of that measurement.
    """

    random: RandomLaws = field(kw_only=True, repr=False)
    chaos: Chaos = field(kw_only=True)
    basis: stochastic.ChaosBasis = field(kw_only=True, repr=False)
    proven: tuple[str, ...] = field(kw_only=True, default=())
    collocations: dict[str, Collocation] = field(kw_only=True, default_factory=dict, repr=False)
    checks: dict[str, TruncationError] = field(kw_only=True, default_factory=dict, repr=False)
    checked: tuple[SampleResult, ...] = field(kw_only=True, default=(), repr=False)
    _columns: dict[str, Columns] = field(kw_only=True, default_factory=dict, repr=False)
    _blocks: dict[str, Array] | None = field(default=None, repr=False)
    _moments: dict[str, tuple[Array, Array, Array, Array]] = field(default_factory=dict, repr=False)

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    @property
    def modes(self) -> int:
        """P + 1."""
        return len(self.basis)

    @property
    def trusted(self) -> bool:
        """Whether the iteration converged and, if a law is not linear, every force passed the check.

        A linear scene is not checked by itself: ask :meth:`truncation`.
        """
        if not self.converged or not self.collocations:
            return self.converged
        if not self.checked or not all(part.converged for part in self.checked):
            return False
        return all(each.error <= self.chaos.tolerance for each in self.checks.values())

    @property
    def displacements(self) -> dict[str, Array]:
        """Substructure -> ([T,] n) mean of the unknowns."""
        return {name: self.coefficients(name)[..., 0] for name in self.problem.substructures}

    def displacement(self, substructure: str, step: int = -1) -> fem.Function:
        """Mean displacement; of a load history at a time step, the last by default."""
        return self.mean(substructure, step)

    @property
    def times(self) -> Array | None:
        """(T,) of a load history, or None."""
        return self.plan.times

    def coefficients(self, substructure: str) -> Array:
        """Chaos coefficients ([T,] n, P + 1) of the unknowns of a substructure, length."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        if self._blocks is None:
            blocks = self.core.displacements(self.state, _amplitudes(self.plan, self.modes))
            self._blocks = {
                name: timed(self.plan, block.reshape(len(block), self.modes, -1))
                for name, block in blocks.items()
            }
        return self._blocks[substructure]

    def field_moments(self, substructure: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] n) of the unknowns of a substructure, length."""
        block = self.coefficients(substructure)
        return block[..., 0], np.sqrt(np.sum(block[..., 1:] ** 2, axis=-1))

    def force_moments(self, interface: str) -> tuple[Array, Array]:
        """Mean and standard deviation ([T,] m, components) of the force per area on side 1.

        From the coefficients, or, where the law is not linear, from many samples of the law.
        """
        if interface in self.collocations:
            mean, variance = self._sampled_moments(interface)[:2]
            return mean, np.sqrt(variance)
        block = self.force_coefficients(interface)
        return block[..., 0], np.sqrt(np.sum(block[..., 1:] ** 2, axis=-1))

    def moment_germs(self) -> Array:
        """Points (N, L) of the germs from which moments of a law that is not linear are computed."""
        return self.space.sample_sobol(SAMPLES_OF_MOMENTS, 0)

    def _sampled_moments(self, interface: str) -> tuple[Array, Array, Array, Array]:
        """Mean and variance of the force ([T,] m, components) and of its resultant, from Sobol points."""
        if interface not in self._moments:
            germs = self.moment_germs()
            # about a first sample, so that nothing cancels
            origin = self.at(germs[:1]).force(interface)[0]
            total = self._resultant(interface, origin[None])[0]
            sums = [np.zeros_like(origin), np.zeros_like(origin), 0.0 * total, 0.0 * total]
            chunk = max(1, CHUNK // self._steps)
            for i in range(0, len(germs), chunk):
                force = self.at(germs[i : i + chunk]).force(interface)
                for k, part in ((0, force - origin), (2, self._resultant(interface, force) - total)):
                    sums[k] += part.sum(axis=0)
                    sums[k + 1] += (part**2).sum(axis=0)
            first, second, r_first, r_second = (each / len(germs) for each in sums)
            self._moments[interface] = (
                origin + first,
                np.maximum(second - first**2, 0.0),
                total + r_first,
                np.maximum(r_second - r_first**2, 0.0),
            )
        return self._moments[interface]

    def _resultant(self, name: str, force: Array) -> Array:
        """Total normal and tangential force, (N, [T,] 1 + d), of forces (N, [T,] m, components)."""
        interface = self.problem.interfaces[name]
        weighted = interface.weights[:, None] * force
        frames = interface.frames[:, 1 : force.shape[-1]]
        shear = np.einsum("...pt,ptd->...d", weighted[..., 1:], frames)
        return np.concatenate([weighted[..., 0].sum(axis=-1)[..., None], shear], axis=-1)

    def _flexibility(self, name: str) -> Array:
        """1/k1 (+ 1/k2) of an interface, (m, components)."""
        return self.core.flexibility(name).reshape(self.problem.interfaces[name].num_points, -1)

    def mode(self, substructure: str, index: int, step: int = -1) -> fem.Function:
        """Chaos coefficient u_index of the displacement (paper, Fig. 8)."""
        block = self.coefficients(substructure)[..., index]
        return self._function(substructure, block, f"u{index}", step)

    def force_coefficients(self, interface: str) -> Array:
        """Chaos coefficients ([T,] m, components, P + 1) of the force per area on side 1."""
        return timed(self.plan, self._columns_of(interface)[0])

    def jump_coefficients(self, interface: str) -> Array:
        """Chaos coefficients ([T,] m, components, P + 1) of the jump."""
        return timed(self.plan, self._columns_of(interface)[1])

    @property
    def _steps(self) -> int:
        """Columns of the run for each mode."""
        return self.state.data.shape[1] // self.modes

    def _columns_of(self, name: str) -> tuple[Array, Array]:
        """Force and jump of an active interface, (m, components, P + 1, steps) each."""
        if name not in self.plan.active:
            raise unknown_name("active interface", name, self.plan.active, "chaos result")
        points = self.problem.here(name).num_points
        force, jump = (
            block.reshape(points, -1, self.modes, self._steps) for block in self._kernel_fields(name)
        )
        return force, jump

    def force(self, interface: str) -> Array:
        """Mean force per area on side 1, ([T,] m, components)."""
        return self.force_coefficients(interface)[..., 0]

    def jump(self, interface: str) -> Array:
        """Mean jump, ([T,] m, components)."""
        return self.jump_coefficients(interface)[..., 0]

    def sobol(self, interface: str) -> dict[str, Sobol]:
        """Sobol indices ([T *] m * components,) of the interface force, by random source."""
        block = self.force_coefficients(interface).reshape(-1, self.modes)
        return self.space.sobol(block, self.basis)

    def at(self, germs: npt.ArrayLike) -> FieldSamples:
        """Fields at points (N, L) of the germs."""
        points = np.atleast_2d(np.asarray(germs, dtype=np.float64))
        return FieldSamples(points, self, self.basis.evaluate(points))

    def quantity(
        self,
        function: Callable[[FieldSamples], npt.ArrayLike],
        name: str = "quantity",
        unit: str = "",
        samples: int = 100_000,
        seed: int = 0,
        chunk: int | None = None,
    ) -> Quantity:
        """A scalar quantity of interest, evaluated sample by sample on the chaos.

        Parameters
        ----------
        function
            Takes the fields at N samples, returns (N,) values.
        name, unit
            For tables and figures.
        samples, seed
            Size and seed of the Monte Carlo sample of the germs.
        chunk
            Samples evaluated at once: bounds the memory. None: 5 000, fewer over a history.
        """
        chunk = chunk or max(1, 5000 // self._steps)
        points = self.space.sample(samples, seed)
        parts = [points[i : i + chunk] for i in range(0, samples, chunk)]
        values = [one_number_a_sample(function(self.at(p)), len(p), name) for p in parts]
        return Quantity(
            name=name, unit=unit, values=np.concatenate(values), weights=None, kind="random"
        )

    def save_chaos(self, path: str | Path, substructures: Sequence[str] = ()) -> None:
        """Write the chaos of all active interfaces (force, jump) and of the named substructures.

        The file (``.h5`` or ``.json``, see ``docs/chaos_file.md``) can be evaluated without this package.
        """
        from dolfinx_frontend.io.chaos_file import save_chaos

        self.problem.on_one_rank("save_chaos")
        save_chaos(path, self.space, self.basis, *self.chaos_fields(substructures))

    def chaos_fields(self, substructures: Sequence[str] = ()) -> tuple[dict[str, Field], dict[str, Any]]:
        """Fields and notes of the file that :meth:`save_chaos` writes."""
        from dolfinx_frontend.io.chaos_file import Field

        fields = {}
        for name in self.plan.active:
            for what, block, unit in (
                ("force", self.force_coefficients(name), "force / area"),
                ("jump", self.jump_coefficients(name), "length"),
            ):
                fields[f"{what}:{name}"] = Field(
                    block.reshape(-1, self.modes), unit, block.shape[:-1], f"{what} of {name}"
                )
        for name in substructures:
            block = self.coefficients(name)
            fields[f"displacement:{name}"] = Field(
                block.reshape(-1, self.modes), "length", block.shape[:-1]
            )
        return fields, {"order": int(self.chaos.order), "error": self.error, "status": self.status}

    def table(
        self,
        interfaces: Sequence[str] | str | None = None,
        step: int | None = -1,
        about: npt.ArrayLike | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
        samples: int = tables.SAMPLES,
        seed: int = 0,
    ) -> tables.Table:
        """As :meth:`Result.table`, with mean, standard deviation and quantiles over samples of the chaos.

        Every row is of the number itself, sample by sample: the largest pressure of each sample, not that of
        the mean. Interfaces that are active have rows.
        """
        readings = tables.read_chaos(self, samples, seed).select(interfaces)
        return tables.summarise(readings, step, about, quantiles)

    def bolts(
        self,
        interfaces: Sequence[str] | str | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
        samples: int = tables.SAMPLES,
        seed: int = 0,
    ) -> tables.Table:
        """As :meth:`Result.bolts`, with mean, standard deviation and quantiles."""
        readings = tables.read_chaos(self, samples, seed).select(interfaces)
        return tables.bolts(readings, quantiles)

    def save(
        self, path: str | Path, fields: bool = True, samples: int = tables.SAMPLES, seed: int = 0
    ) -> None:
        """As :meth:`Result.save`, with the whole chaos; the tables are made of so many samples."""
        from dolfinx_frontend.io import saved

        saved.save_result(path, self, tables.read_chaos(self, samples, seed), fields)

    def to_openturns(self, interface: str, inputs: Literal["parameters", "germs"] = "parameters") -> Any:
        """The force (m * components outputs) of an active interface as OpenTURNS' chaos result."""
        from dolfinx_frontend.io.openturns import to_openturns

        block = self.force_coefficients(interface).reshape(-1, self.modes)
        return to_openturns(self.space, self.basis, block, inputs=inputs)

    def resume(self) -> None:
        """Give the kernel back the laws of this result, after :func:`carry_on` has used it for another."""
        self.core.set_steps(self._steps)
        _make_deterministic(self.core, self.problem, self.plan)
        _make_stochastic(self.core, self._columns)

    def sample(
        self,
        germs: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
        kind: Literal["random", "qmc", "quadrature"] = "random",
        *,
        keep_states: bool = False,
        progress: bool = False,
        rtol: float | None = None,
    ) -> SampleResult:
        """Deterministic solves at points (N, L) of the germs: as
        :func:`dolfinx_frontend.solvers.sampling.sample`, on the factorised problem of this result and started
        from what its chaos predicts; to its tolerance, or to `rtol`."""
        points = np.atleast_2d(np.asarray(germs, dtype=np.float64))
        every = -(-len(points) // STARTS)
        psi = self.basis.evaluate(points[::every])
        columns = np.kron(psi.T, np.eye(self._steps))  # modes to one point's time steps each
        start = {
            every * i: State(
                np.asfortranarray(self.state.data @ one), np.asfortranarray(self.state.traces @ one)
            )
            for i, one in enumerate(np.split(columns, len(psi), axis=1))
        }
        plan = self.plan
        if rtol is not None:
            plan = replace(plan, options=plan.options.with_(rtol=rtol))
        with self.at_mean():
            return sample_on(
                self.core,
                self.random,
                plan,
                points,
                None if weights is None else np.asarray(weights, dtype=np.float64),
                kind,
                keep_states=keep_states,
                progress=progress,
                start=start,
            )

    @contextmanager
    def at_mean(self) -> Iterator[None]:
        """The factorised problem with every random parameter at its mean, as long as the context lasts."""
        _make_deterministic(self.core, self.problem, self.plan)
        try:
            yield
        finally:
            _make_deterministic(self.core, self.problem, self.plan)
            _make_stochastic(self.core, self._columns)

    def monte_carlo(self, samples: int, seed: int = 0, **settings: Any) -> SampleResult:
        """As :func:`dolfinx_frontend.monte_carlo`, on this result's solver, started from its chaos."""
        return self.sample(self.space.sample(samples, seed), **settings)

    def quasi_monte_carlo(self, samples: int, seed: int = 0, **settings: Any) -> SampleResult:
        """As :func:`dolfinx_frontend.quasi_monte_carlo`, on this result's solver, started from its chaos."""
        return self.sample(self.space.sample_sobol(samples, seed), kind="qmc", **settings)

    def truncation(self, interface: str, points: int = 16, seed: int = 1) -> TruncationError:
        """Estimate the error of the truncation in the force of an interface.

        Parameters
        ----------
        interface
            An active interface.
        points
            Deterministic solves at independent points of the germs; 0: only the decay.
        """
        decay, deviation = self._decay(interface)
        if points <= 0:
            return TruncationError(decay, np.nan, 0, interface)
        return self.compared(interface, [self.sample(self.space.sample(points, seed))])

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

    def compared(self, interface: str, truth: Sequence[SampleResult]) -> TruncationError:
        """The chaos against deterministic solves."""
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

    def _check(self) -> None:
        """Compare all forces with deterministic solves, and say so where they differ.

        More points are taken while the estimates pass and only their standard errors do not.
        """
        count, tolerance = self.chaos.check_points, self.chaos.tolerance
        if count == 0 or not self.converged:
            return
        # independent of the Sobol points at which the law may be evaluated
        germs = self.space.sample(MOST_CHECKS * count, 1)
        for first, last in ((0, 1), (1, 2), (2, MOST_CHECKS)):
            part = self.sample(germs[first * count : last * count])
            if not part.complete:
                return  # Ctrl-C: not checked, so not trusted; the log says so
            self.checked += (part,)
            own = [name for name in self.plan.active if self.problem.speaks_for(name)]
            self.checks = self.problem.gather({n: self.compared(n, self.checked) for n in own})
            if self.trusted or any(not c.estimate <= tolerance for c in self.checks.values()):
                break
        self.seconds["check"] = sum(sum(part.seconds.values()) for part in self.checked)
        if self.trusted or self.problem.rank > 0:
            return
        solves = sum(len(part.germs) for part in self.checked)
        bad = [str(c) for c in self.checks.values() if not c.error <= tolerance]
        lost = sum(int((part.points.status != "converged").sum()) for part in self.checked)
        if lost:
            bad.append(f"{lost} check solves did not converge")
        warnings.warn(
            f"the chaos of order {self.chaos.order} is not proven converged to {_percent(tolerance)} by "
            f"{solves} deterministic solves:\n  "
            + "\n  ".join(bad)
            + "\nlaws that are not linear make kinks, on which chaos converges slowly: raise the order, or "
            "sample on the same solver: result.quasi_monte_carlo(1024) or result.monte_carlo(1000), without "
            "chaos quasi_monte_carlo(problem, 1024); Chaos(tolerance=...) sets the limit",
            TruncationWarning,
            stacklevel=4,
        )

    def __repr__(self) -> str:
        text = (
            f"ChaosResult({self.status}, {self.modes} modes of order {self.chaos.order} in "
            f"{self.space.dimension} germs, {self.iterations} iterations, estimated error "
            f"{self.error:.1e}, {sum(self.seconds.values()):.2f} s"
        )
        if self.collocations:
            limit = _percent(self.chaos.tolerance)
            verdict = f"trusted to {limit}" if self.trusted else f"NOT TRUSTED to {limit}"
            measured = "".join(f"\n  {c}" for c in self.checks.values()) or " not checked"
            solves = sum(len(part.germs) for part in self.checked)
            text += f";\n  truncation {verdict} by {solves} deterministic solves:{measured}"
        return text + ")"


def _amplitudes(plan: Plan, modes: int) -> Array:
    """Amplitudes (l, modes * steps) of the load patterns: loads are not random."""
    return np.asfortranarray(np.kron(np.eye(1, modes), plan.amplitudes), dtype=np.float64)


def _make_deterministic(core: Kernel, problem: Problem, plan: Plan) -> None:
    """Give the active interfaces of a kernel problem back the laws that they were built with."""
    for name in problem.own.interfaces:
        if name not in plan.active:
            continue
        core.set_columns(name, [])
        for parameter, values in bridge.active_fields(problem.interfaces[name], plan).parameters.items():
            core.set_parameter(name, parameter, values)


def _make_stochastic(core: Kernel, columns: dict[str, Columns]) -> None:
    for name, each in columns.items():
        for parameter, values in each.parameters.items():
            core.set_parameter(name, parameter, values)
        core.set_columns(name, each.groups)


def _with_collocations(
    plan: Plan, random: RandomLaws, collocations: dict[str, Collocation], chaos: Chaos
) -> Plan:
    """The plan with what it means that laws are not linear."""
    if not collocations:
        return plan
    decisions = [
        Decision(
            f"law of {name}",
            f"at {len(each)} points in {len(each.germs)} germs ({each.rule}), "
            f"{each.bytes(random, plan.steps) / 1e6:.3g} MB",
            "it is not linear: evaluated at stochastic quadrature points and projected on the modes",
        )
        for name, each in collocations.items()
    ]
    decisions.append(
        Decision(
            "check",
            f"{chaos.check_points} to {MOST_CHECKS * chaos.check_points} deterministic solves"
            if chaos.check_points
            else "none: not asked for",
            f"laws with kinks: trusted if mean and deviation are within {_percent(chaos.tolerance)}",
        )
    )
    return replace(plan, decisions=plan.decisions + tuple(decisions))


def solve_chaos(
    problem: Problem,
    chaos: Chaos | int,
    method: Method = "auto",
    *,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    start: Result | State | None = None,
    indefinite: Literal["refuse", "prove"] = "refuse",
    callback: Callable[[Iteration], None] | None = None,
) -> ChaosResult:
    """Solve for the chaos coefficients of everything.

    Parameters
    ----------
    chaos
        Order and index set; a number is the order of a total-degree set.
    method, active, direction, options, plan, start, callback
        As for :func:`dolfinx_frontend.solve`; interfaces with random parameters are always active.
    times
        Times (T,) of a load history; random values do not change in it.
    indefinite
        ``"refuse"`` a random stiffness whose Galerkin matrix is indefinite, or ``"prove"`` first that the
        structure as a whole is definite and go on (the result carries the fact).

    Raises
    ------
    SceneError
        Nothing is random, or the basis needs more memory than there is.
    IndefiniteError
        A Galerkin stiffness is indefinite.

    Warns
    -----
    NearlyIndefiniteWarning
        A Galerkin stiffness is close to that.
    TruncationWarning
        A law is not linear, and the chaos is further from deterministic solves than ``chaos.tolerance``.
    """
    if indefinite not in ("refuse", "prove"):
        raise SceneError(f"indefinite = {indefinite!r}: use 'refuse' or 'prove'")
    chaos = chaos if isinstance(chaos, Chaos) else Chaos(order=chaos)
    random = RandomLaws.of(problem)
    if not random.sources:
        raise SceneError(
            "chaos: nothing is random: give a law a random parameter, or solve without chaos"
        )
    options = options or (Options.plain() if method == "latin" else Options())
    rows = sum(2 * problem.dim * problem.interfaces[n].num_points for n in random.interfaces)
    history = len(np.atleast_1d(np.asarray(times))) if times is not None and problem.amplitudes else 1
    needed = history * (problem.size + rows * (4 + 3 * options.acceleration))
    basis = random.space.basis(chaos, rows=needed)
    if plan is None:
        plan = make_plan(
            problem,
            method,
            active,
            random.interfaces,
            direction,
            options,
            random,
            len(basis),
            times=times,
        )
    return _run(problem, random, chaos, basis, plan, None, start_states(start), indefinite, callback)


def _run(
    problem: Problem,
    random: RandomLaws,
    chaos: Chaos,
    basis: stochastic.ChaosBasis,
    plan: Plan,
    core: Kernel | None,
    start: list[State],
    indefinite: Literal["refuse", "prove"] = "refuse",
    callback: Callable[[Iteration], None] | None = None,
) -> ChaosResult:
    """One run of a plan, on a kernel problem that is factorised already if there is one."""
    began = perf_counter()
    steps = plan.amplitudes.shape[1]
    curved = [name for name in plan.active if not random.linear(name)]
    collocations = {name: collocation(random, basis, chaos, name, steps) for name in curved}
    plan = _with_collocations(plan, random, collocations, chaos)
    matrices = galerkin(random, basis)
    proven = _guard(problem, random, basis, matrices, indefinite)
    columns = {}
    for name in (n for n in plan.active if n in problem.own.interfaces):
        if name in collocations:
            fields = bridge.active_fields(problem.interfaces[name], plan)
            columns[name] = Columns({}, [collocations[name].group(random, fields, steps)])
        else:
            columns[name] = _columns(random, basis, name, matrices, plan, steps)
    core = core or bridge.build(problem, plan)
    core.set_steps(steps)
    _make_stochastic(core, columns)
    built = perf_counter()
    summary, state = iterate(
        problem, plan, core, _amplitudes(plan, len(basis)), start, callback
    )
    seconds = {"setup": built - began, "solve": perf_counter() - built}
    result = ChaosResult(
        problem,
        plan,
        summary,
        state,
        seconds,
        core,
        _cuts=fields_of_cuts(problem, core, state),
        random=random,
        chaos=chaos,
        basis=basis,
        proven=proven,
        collocations=collocations,
        _columns=columns,
    )
    if collocations:
        result._check()
    return result


def carry_on(result: ChaosResult, chaos: Chaos, rtol: float) -> ChaosResult:
    """The run of another chaos or tolerance on the factorised problem of a result, started from its answer.

    The modes that both have are taken over, the others start from zero. The kernel is left with the laws of
    the new result; of the old one only :meth:`ChaosResult.resume` brings them back.

    Raises
    ------
    IndefiniteError
        A Galerkin stiffness is indefinite in the new basis.
    """
    problem, random, old = result.problem, result.random, result.plan
    rows = result.core.rows
    needed = result._steps * (problem.size + rows * (4 + 3 * old.options.acceleration))
    basis = random.space.basis(chaos, rows=needed)
    plan = make_plan(
        problem,
        old.method if old.method == "latin" else "auto",
        old.active,
        random.interfaces,
        old.direction,
        old.options.with_(rtol=rtol),
        random,
        len(basis),
        times=old.times,
    )
    steps = result._steps
    states = []
    for block in (result.state.data, result.state.traces):
        wider = np.zeros((len(block), len(basis) * steps), order="F")
        for mode, index in enumerate(np.asarray(result.basis.indices.table)):
            place = basis.indices.find([int(i) for i in np.atleast_1d(index)])
            if place is not None:
                wider[:, place * steps : (place + 1) * steps] = block[:, mode * steps : (mode + 1) * steps]
        states.append(wider)
    indefinite: Literal["refuse", "prove"] = "prove" if result.proven else "refuse"
    return _run(problem, random, chaos, basis, plan, result.core, [State(*states)], indefinite)
