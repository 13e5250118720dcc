"""LATIN with polynomial chaos: the columns of the iteration are chaos modes (paper, section 4.3).

The global stage does not change: P + 1 right-hand sides of one factorisation. On an interface with a random
stiffness kappa = sum_i kappa_i Psi_i the law f = kappa (j - Delta) becomes, mode by mode,

    f_k = sum_j A_kj (j_j - Delta_j),     A_kj = sum_i kappa_i E[Psi_i Psi_j Psi_k],

one system of size P + 1 a point and direction. A = V diag(lambda) V^T decouples it: in the columns j V the
law is the deterministic one with the stiffness lambda_q. So the kernel runs the same laws and the same
iteration as for one column, and its fixed point is the stochastic Galerkin solution (equations 17 and 19).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from latin_core import Iteration, Options, State, stochastic

from dolfinx_frontend import bridge
from dolfinx_frontend.assembly import Problem
from dolfinx_frontend.chaos_file import Field, save_chaos, to_openturns
from dolfinx_frontend.errors import SceneError, unknown_name
from dolfinx_frontend.laws import Contact
from dolfinx_frontend.plan import Direction, Method, Plan, make_plan
from dolfinx_frontend.quantities import Quantity
from dolfinx_frontend.random import Chaos, DiscretisedField, RandomSpace, Sobol
from dolfinx_frontend.solve import Result, start_states
from dolfinx_frontend.stochastic import RandomLaws, Source
from dolfinx_frontend.uncertain import StochasticResult, one_number_a_sample

__all__ = [
    "ChaosResult",
    "FieldSamples",
    "Galerkin",
    "IndefiniteError",
    "NearlyIndefiniteWarning",
    "TruncationError",
    "galerkin",
    "solve_chaos",
]

Array = npt.NDArray[np.float64]

NEAR = 0.1
"""A smallest eigenvalue below this share of the mean is reported."""


class IndefiniteError(SceneError):
    """A random stiffness whose Galerkin matrix is not positive definite: its chaos means nothing."""


class NearlyIndefiniteWarning(UserWarning):
    """A random stiffness whose Galerkin matrix is close to losing definiteness."""


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
        if parameter not in ("normal", "tangential"):
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
    if not bridge.definite(problem, floors):
        raise IndefiniteError(
            "\n".join(bad) + "\nthe structure as a whole could not be proven definite either (Cholesky "
            f"with every random stiffness at its smallest eigenvalue breaks down); {mend}"
        )
    return tuple(bad)


def _modes(random: RandomLaws, basis: stochastic.ChaosBasis, name: str, parameter: str) -> Array:
    """Chaos coefficients of a value that enters linearly: (1 or m, P + 1), zero but for mode 0 if fixed."""
    source = random.source(name, parameter)
    if source is not None:
        return random.space.coefficients(source, basis)
    modes = np.zeros((1, len(basis)))
    modes[0, 0] = 1.0
    return modes


def _affine_field(
    random: RandomLaws, basis: stochastic.ChaosBasis, name: str, parameter: str
) -> tuple[str, Array]:
    """Kernel parameter and (rows, P + 1) of a jump or force: what enters the law linearly."""
    interface = random.problem.interfaces[name]
    modes = _modes(random, basis, name, parameter)
    source = random.source(name, parameter)
    if source is None:
        kernel = bridge.KERNEL_NAMES.get(parameter, parameter)
        return kernel, bridge.law_fields(interface).parameters[kernel] @ modes
    kernel, unit = bridge.kernel_parameter(interface, parameter)
    if len(modes) > 1:
        modes = np.repeat(modes, len(unit) // len(modes), axis=0)
    return kernel, unit * modes


def _columns(
    random: RandomLaws,
    basis: stochastic.ChaosBasis,
    name: str,
    matrices: dict[tuple[str, str], Galerkin],
) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Parameters (with P + 1 columns) and column transforms of an active interface."""
    interface = random.problem.interfaces[name]
    fields = bridge.law_fields(interface)
    linear = dict(
        _affine_field(random, basis, name, parameter)
        for parameter in interface.law.parameters()
        if parameter not in ("normal", "tangential")
    )
    if fields.kind != "elastic" or not any(key[0] == name for key in matrices):
        return linear, []
    jump = linear.get("jump", np.zeros((len(fields.frames), len(basis))))
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
            mine = own is not None and matrix is not None and own.source is matrix.source
            parameters[key] = own.values if mine and own is not None else fields.parameters[key]
        if not forward:
            parameters["jump"] = jump
        elif len(forward) == 1:
            parameters["jump"] = jump @ forward[0]
        else:
            rows = jump.reshape(interface.num_points, fields.components, -1)
            parameters["jump"] = np.einsum("pcj,pjq->pcq", rows, np.array(forward)).reshape(
                jump.shape
            )
        groups.append(
            {
                "begin": begin,
                "end": end,
                "forward": forward,
                "backward": [np.asfortranarray(v.T) for v in forward],
                "parameters": parameters,
            }
        )
    return linear, groups


@dataclass(frozen=True)
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

    def force(self, interface: str) -> Array:
        """Force per area on side 1, (N, m, components), local frame: component 0 is normal."""
        return np.moveaxis(self._result.force_coefficients(interface) @ self._psi.T, -1, 0)

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, (N, m, components), local frame."""
        return np.moveaxis(self._result.jump_coefficients(interface) @ self._psi.T, -1, 0)

    def displacement(self, substructure: str) -> Array:
        """Unknowns (N, n) of a substructure."""
        return self._psi @ self._result.coefficients(substructure).T


@dataclass(frozen=True)
class TruncationError:
    """How far the chaos is from the answer it truncates.

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
    """

    decay: float
    sample: float
    points: int
    interface: str


@dataclass
class ChaosResult(Result, StochasticResult):
    """Answer of one LATIN-PCE run; fields have one column a chaos mode.

    Attributes
    ----------
    random, chaos, basis
        What is random, what was asked for, and the modes.
    proven
        Stiffnesses whose own Galerkin matrix is indefinite, run on because the structure as a whole was
        proven definite (``indefinite="prove"``); empty otherwise.
    """

    random: RandomLaws = field(kw_only=True, repr=False)
    chaos: Chaos = field(kw_only=True)
    basis: stochastic.ChaosBasis = field(kw_only=True, repr=False)
    proven: tuple[str, ...] = field(kw_only=True, default=())
    _blocks: dict[str, Array] | None = field(default=None, repr=False)

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    @property
    def modes(self) -> int:
        """P + 1."""
        return len(self.basis)

    @property
    def displacements(self) -> dict[str, Array]:
        """Substructure -> (n,) mean of the unknowns."""
        return {name: self.coefficients(name)[:, 0] for name in self.problem.substructures}

    def coefficients(self, substructure: str) -> Array:
        """Chaos coefficients (n, P + 1) of the unknowns of a substructure, length."""
        if substructure not in self.problem.substructures:
            raise unknown_name("substructure", substructure, self.problem.substructures, "result")
        if self._blocks is None:
            amplitudes = np.zeros((1, self.modes))
            amplitudes[0, 0] = 1.0
            self._blocks = self.core.displacements(self.state, amplitudes)
        return self._blocks[substructure]

    def field_moments(self, substructure: str) -> tuple[Array, Array]:
        """Mean and standard deviation (n,) of the unknowns of a substructure, length."""
        block = self.coefficients(substructure)
        return block[:, 0], np.sqrt(np.sum(block[:, 1:] ** 2, axis=1))

    def force_moments(self, interface: str) -> tuple[Array, Array]:
        """Mean and standard deviation (m, components) of the force per area on side 1."""
        block = self.force_coefficients(interface)
        return block[..., 0], np.sqrt(np.sum(block[..., 1:] ** 2, axis=-1))

    def mode(self, substructure: str, index: int) -> fem.Function:
        """Chaos coefficient u_index of the displacement (paper, Fig. 8)."""
        return self._function(substructure, self.coefficients(substructure)[:, index], f"u{index}")

    def force_coefficients(self, interface: str) -> Array:
        """Chaos coefficients (m, components, P + 1) of the force per area on side 1."""
        return self._modes_of(interface)[0]

    def jump_coefficients(self, interface: str) -> Array:
        """Chaos coefficients (m, components, P + 1) of the jump."""
        return self._modes_of(interface)[1]

    def _modes_of(self, name: str) -> tuple[Array, Array]:
        if name not in self.plan.active:
            raise unknown_name("active interface", name, self.plan.active, "chaos result")
        points = self.problem.interfaces[name].num_points
        force, jump = self.core.local_fields(name, self.state)
        return force.reshape(points, -1, self.modes), jump.reshape(points, -1, self.modes)

    def force(self, interface: str) -> Array:
        """Mean force per area on side 1, (m, components)."""
        return self.force_coefficients(interface)[..., 0]

    def jump(self, interface: str) -> Array:
        """Mean jump, (m, components)."""
        return self.jump_coefficients(interface)[..., 0]

    def sobol(self, interface: str) -> dict[str, Sobol]:
        """Sobol indices (m * components,) of the interface force, by random source."""
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
        chunk: int = 5000,
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
            Samples evaluated at once: bounds the memory.
        """
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
        fields = {}
        for name in self.plan.active:
            for what, block, unit in (
                ("force", self.force_coefficients(name), "force / area"),
                ("jump", self.jump_coefficients(name), "length"),
            ):
                fields[f"{what}:{name}"] = Field(
                    block.reshape(-1, self.modes), unit, block.shape[:2], f"{what} of {name}"
                )
        for name in substructures:
            fields[f"displacement:{name}"] = Field(self.coefficients(name), "length")
        meta = {"order": int(self.chaos.order), "error": self.error, "status": self.status}
        save_chaos(path, self.space, self.basis, fields, meta)

    def to_openturns(self, interface: str, inputs: Literal["parameters", "germs"] = "parameters") -> Any:
        """The force (m * components outputs) of an active interface as OpenTURNS' chaos result."""
        block = self.force_coefficients(interface).reshape(-1, self.modes)
        return to_openturns(self.space, self.basis, block, inputs=inputs)

    def truncation(self, interface: str, points: int = 16, seed: int = 1) -> TruncationError:
        """Estimate the error of the truncation in the force of an interface.

        Parameters
        ----------
        interface
            An active interface.
        points
            Deterministic solves at independent points of the germs; 0: only the decay.
        """
        from dolfinx_frontend.sampling import sample

        block = self.force_coefficients(interface)
        weights = self.problem.interfaces[interface].weights
        share = np.einsum("p,pcj->j", weights, block**2)
        deviation = float(np.sqrt(share[1:].sum()))
        degree = self.basis.indices.table.sum(axis=1)
        by_degree = [float(np.sqrt(share[degree == d].sum())) for d in range(1, degree.max() + 1)]
        decay = np.nan
        if deviation > 0.0 and by_degree:
            ratio = by_degree[-1] / by_degree[-2] if len(by_degree) > 1 and by_degree[-2] > 0 else 1.0
            ratio = min(ratio, 0.9)
            decay = by_degree[-1] * ratio / np.sqrt(1.0 - ratio**2) / deviation
        measured = np.nan
        if points > 0:
            germs = self.space.sample(points, seed)
            truth = sample(self.problem, germs, plan_options=self.plan.options, progress=False)
            difference = truth.force(interface) - self.at(germs).force(interface)
            square = np.einsum("p,npc->n", weights, difference**2)
            measured = float(np.sqrt(square.mean())) / deviation if deviation > 0.0 else np.nan
        return TruncationError(float(decay), measured, points, interface)

    def __repr__(self) -> str:
        return (
            f"ChaosResult({self.status}, {self.modes} modes of order {self.chaos.order} in "
            f"{self.space.dimension} germs, {self.iterations} iterations, estimated error "
            f"{self.error:.1e}, {sum(self.seconds.values()):.2f} s)"
        )


def solve_chaos(
    problem: Problem,
    chaos: Chaos | int,
    method: Method = "auto",
    *,
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
    """
    if indefinite not in ("refuse", "prove"):
        raise SceneError(f"indefinite = {indefinite!r}: use 'refuse' or 'prove'")
    chaos = chaos if isinstance(chaos, Chaos) else Chaos(order=chaos)
    for name, interface in problem.interfaces.items():
        if isinstance(interface.law, Contact):
            raise SceneError(
                f"chaos: interface {name!r} is in contact, and a law that is not linear cannot be applied "
                "to chaos coefficients: use sampling (monte_carlo, quasi_monte_carlo, tensor_quadrature)"
            )
    random = RandomLaws.of(problem)
    if not random.sources:
        raise SceneError(
            "chaos: nothing is random: give a law a random parameter, or solve without chaos"
        )
    options = options or (Options.plain() if method == "latin" else Options())
    rows = sum(2 * problem.dim * problem.interfaces[n].num_points for n in random.interfaces)
    basis = random.space.basis(chaos, rows=problem.size + rows * (4 + 3 * options.acceleration))
    if plan is None:
        plan = make_plan(
            problem, method, active, random.interfaces, direction, options, random, len(basis)
        )
    began = perf_counter()
    matrices = galerkin(random, basis)
    proven = _guard(problem, random, basis, matrices, indefinite)
    core = bridge.build(problem, plan)
    for name in plan.active:
        linear, groups = _columns(random, basis, name, matrices)
        for parameter, values in linear.items():
            core.set_parameter(name, parameter, values)
        core.set_columns(name, groups)
    amplitudes = np.zeros((1, len(basis)))
    amplitudes[0, 0] = 1.0
    built = perf_counter()
    summary, state = core.solve(
        options=plan.options.kernel(),
        amplitudes=amplitudes,
        start=start_states(start),
        callback=callback,
    )
    seconds = {"setup": built - began, "solve": perf_counter() - built}
    return ChaosResult(
        problem,
        plan,
        summary,
        state,
        seconds,
        core,
        random=random,
        chaos=chaos,
        basis=basis,
        proven=proven,
    )
