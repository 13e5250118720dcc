"""LATIN with polynomial chaos: the columns of the iteration are chaos modes (paper, section 4.3).

The global stage does not change: P + 1 right-hand sides of one factorisation. On an interface with a random
stiffness kappa = sum_i kappa_i Psi_i the law f = kappa (j - Delta) becomes, mode by mode,

    f_k = sum_j A_kj (j_j - Delta_j),     A_kj = sum_i kappa_i E[Psi_i Psi_j Psi_k],

one system of size P + 1 per point and direction. A = V diag(lambda) V^T decouples it: in the columns j V the
law is the deterministic one with the stiffness lambda_q. So the kernel runs the same laws and the same
iteration as for one column, and its fixed point is the stochastic Galerkin solution (equations 17 and 19).

A nonlinear law (contact, friction) is evaluated at stochastic quadrature points instead, see
:mod:`dolfinx_frontend.solvers.collocation`. The response then has kinks, and its chaos converges slowly:
such an answer is compared with deterministic solves at check points before it is handed out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from latin_core import Iteration, Laws, Options, State, stochastic

from dolfinx_frontend.assembly.gathered import by_first, gathered
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_optional_kind, checked_word
from dolfinx_frontend.common.errors import SceneError, warn
from dolfinx_frontend.evaluate.sampling import sample_chaos
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.columns import Collocation, ColumnGroup
from dolfinx_frontend.kernel.fitting import SHARE, fitted
from dolfinx_frontend.kernel.running import within
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.plan.plan import (
    Decision,
    Direction,
    Method,
    Plan,
    check_problem,
    checked_chaos,
    plan_of_chaos,
    plan_of_random,
)
from dolfinx_frontend.plan.price import Way
from dolfinx_frontend.plan.random_laws import RandomLaws, Source, warn_of_free_parts
from dolfinx_frontend.results.accuracy import accuracy_of_run
from dolfinx_frontend.results.chaos import ChaosResult, amplitudes_of, percent
from dolfinx_frontend.results.errors import Estimator, not_measured
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.solvers.collocation import collocation
from dolfinx_frontend.solvers.deterministic import check_start, start_states
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.expressions import Expression
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = [
    "Galerkin",
    "IndefiniteError",
    "Changes",
    "NearlyIndefiniteWarning",
    "Planned",
    "Prepared",
    "TruncationWarning",
    "carry_on",
    "chaos_on",
    "fields_of_parts",
    "galerkin",
    "planned",
    "prepared",
    "solve_chaos",
]

NEAR = 0.1
"""A smallest eigenvalue below this fraction of the mean is reported."""

MOST_CHECKS = 4
"""Times ``check_points`` that a check takes at most."""


class IndefiniteError(SceneError):
    """A random stiffness whose Galerkin matrix is not positive definite: its chaos means nothing."""


class NearlyIndefiniteWarning(UserWarning):
    """A random stiffness whose Galerkin matrix is close to losing definiteness."""


class TruncationWarning(UserWarning):
    """The chaos of a nonlinear scene is further from deterministic solves than was asked for."""


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


def _transforms(
    random: RandomLaws, source: Source, basis: stochastic.ChaosBasis
) -> tuple[list[Array], Array]:
    """Transforms and eigenvalues at every point of a parameter."""
    if not random.space.multiplies(source):
        coefficients, indices = random.space.expansion(source, basis)
        forward, values = stochastic.galerkin_transforms(basis, coefficients, indices)
        return forward, values
    # dense, so that no detour over sparse matrices pays
    found = [np.linalg.eigh(matrix) for matrix in random.space.galerkin_matrices(source, basis)]
    return [np.asfortranarray(each.eigenvectors) for each in found], np.array([e.eigenvalues for e in found])


def galerkin(random: RandomLaws, basis: stochastic.ChaosBasis) -> dict[tuple[str, str], Galerkin]:
    """Galerkin matrices of all random stiffnesses, by (interface, parameter)."""
    done: dict[int, tuple[list[Array], Array]] = {}
    matrices = {}
    for (name, parameter), source in random.sources.items():
        if parameter not in random.problem.interfaces[name].law.spans:
            continue
        if id(source) not in done:
            done[id(source)] = _transforms(random, source, basis)
        forward, values = done[id(source)]
        scale = random.area_factor(name, parameter)
        matrices[name, parameter] = Galerkin(name, parameter, source, forward, scale * values)
    return matrices


def stiffness_of_parts(random: RandomLaws, basis: stochastic.ChaosBasis) -> dict[str, Galerkin]:
    """Galerkin matrices of the random factors of the stiffness of parts, by part."""
    found = {}
    for part in random.scaled:
        source = random.parts[part]
        coefficients, indices = random.space.expansion(source, basis)
        matrix = stochastic.galerkin_matrix(basis, coefficients[0], indices)
        transform = stochastic.galerkin_transform(matrix)
        forward = np.asfortranarray(transform.forward)
        found[part] = Galerkin("", part, source, [forward], np.array([transform.values]))
    return found


def fields_of_parts(random: RandomLaws, basis: stochastic.ChaosBasis) -> dict[str, stochastic.Coupling]:
    """What random fields add to the stiffness of parts at their means, projected on the modes, by part.

    Raises
    ------
    IndefiniteError
        A normal field of which the projected stiffness of a cell is not positive definite.
    """
    found = {}
    for part, source in random.fields.items():
        coefficients, indices = random.space.expansion(source, basis)
        change = np.array(coefficients)
        change[:, indices.find([0] * random.space.dimension)] -= 1.0
        found[part] = stochastic.Coupling(basis, change, indices)
        if not source.affine:
            continue  # it is positive, and so is its projection
        spread = source.field.deviation * np.linalg.norm(source.shapes, axis=1)
        worst = int(spread.argmax())
        least = 1.0 + float(np.linalg.eigvalsh(found[part].matrix(worst))[0])
        where = (
            f"substructure {part!r}, random field {source.name!r} of its stiffness: with the standard "
            f"deviation {spread[worst]:.4g} of its mean at {np.round(source.points[worst], 6).tolist()} its "
            "Galerkin matrix"
        )
        remedy = "distribution='lognormal' stays positive at every order"
        if least <= 0.0:
            raise IndefiniteError(
                f"{where} is indefinite, smallest eigenvalue {least:.4g} for a mean of 1; {remedy}; or take "
                "a smaller cov, or a lower order"
            )
        if least < NEAR:
            warn(
                f"{where} is nearly indefinite, smallest eigenvalue {least:.4g} for a mean of 1; {remedy}",
                NearlyIndefiniteWarning,
            )
    return found


def _limit(source: Source, basis: stochastic.ChaosBasis, space: RandomSpace) -> str:
    """What the coefficient of variation would have to be, where that is known."""
    if isinstance(source, DiscretisedField | Expression) or not source.affine:
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
    parts: Mapping[str, Galerkin],
) -> tuple[str, ...]:
    """Refuse indefinite stiffnesses before anything is iterated on; the overrides that were proven."""
    bad = []
    for matrix in [*matrices.values(), *parts.values()]:
        source = matrix.source
        if matrix.interface:
            mean = source.mean * random.area_factor(matrix.interface, matrix.parameter)
            where = f"interface {matrix.interface!r}, {matrix.parameter} stiffness {source.name!r}"
        else:
            mean = source.mean
            where = f"substructure {matrix.parameter!r}, factor {source.name!r} of its stiffness"
        limit = _limit(source, basis, random.space)
        if isinstance(source, Expression) and not source.affine:
            least, at = random.space.least(source, basis)
            if least <= 0.0:
                raise IndefiniteError(
                    f"{where}: it is {least:.4g} at {at}: a stiffness is > 0; give an expression that "
                    "is positive wherever its parameters can be"
                )
        if matrix.smallest <= 0.0:
            bad.append(
                f"{where}: its Galerkin matrix is indefinite, smallest eigenvalue "
                f"{matrix.smallest:.4g} for a mean of {mean:.4g}{limit}"
            )
        elif matrix.smallest < NEAR * mean and not getattr(source, "bounds", (-np.inf,))[0] >= 0.0:
            # a law that is never negative loses nothing at any order
            warn(
                f"{where}: its Galerkin matrix is nearly indefinite, smallest eigenvalue "
                f"{matrix.smallest:.4g} for a mean of {mean:.4g}{limit}; higher orders make it worse: "
                "LogNormal, Gamma and TruncatedNormal stay positive at every order",
                NearlyIndefiniteWarning,
            )
    if not bad:
        return ()
    remedy = (
        "use a positive law (LogNormal, Gamma, TruncatedNormal with a positive lower bound), a smaller "
        "coefficient of variation or a lower order"
    )
    if any(part.smallest <= 0.0 for part in parts.values()):
        raise IndefiniteError("\n".join(bad) + f"\n{remedy}")
    if indefinite == "refuse":
        raise IndefiniteError(
            "\n".join(bad) + f"\n{remedy}; or pass indefinite='prove' to go on if the structure as a "
            "whole is proven definite"
        )
    floors = {
        key: np.broadcast_to(matrix.values.min(axis=1), (problem.interfaces[key[0]].num_points,))
        for key, matrix in matrices.items()
    }
    if not _definite(problem, floors):
        raise IndefiniteError(
            "\n".join(bad) + "\nthe structure as a whole could not be proven definite either (Cholesky "
            f"with every random stiffness at its smallest eigenvalue breaks down); {remedy}"
        )
    return tuple(bad)


def _definite(problem: Problem, floors: Mapping[tuple[str, str], Array]) -> bool:
    """As :func:`bridge.definite`; on several ranks by the first one, which is given the matrices of all."""
    return by_first(problem, gathered(problem), lambda whole: bridge.definite(whole, floors))


def _through(block: Array, by: list[Array], points: int, modes: int) -> Array:
    """Columns (rows, modes * steps), time steps fastest, times one matrix for all points or one for each."""
    if not by or not np.any(block):
        return block
    steps = block.shape[1] // modes
    parted = block.reshape(points, -1, modes, steps).swapaxes(2, 3)  # (points, components, steps, modes)
    result = np.empty(parted.shape)
    for point in range(points):  # the matrices of a field may fill the memory: no copy of all
        result[point] = parted[point] @ by[point if len(by) > 1 else 0]
    return result.swapaxes(2, 3).reshape(len(block), -1)


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
        if source is None or parameter in interface.law.spans:
            continue
        kernel, unit = interface.law.kernel_unit(interface, parameter)
        coefficients = random.space.coefficients(source, basis)
        if len(coefficients) > 1:
            coefficients = np.repeat(coefficients, len(unit) // len(coefficients), axis=0)
        amplitude = random.amplitude(name, parameter)
        in_time = constant if amplitude is None else plan.column_factors(amplitude)
        # the mean is there already where all is told at every time
        if amplitude is not None:
            values[kernel] = values[kernel] + np.kron(
                unit * np.hstack([np.zeros((len(coefficients), 1)), coefficients[:, 1:]]), in_time
            )
            coefficients = coefficients.copy()
            away = coefficients[:, 0] - source.mean
            values[kernel][:, :steps] += np.kron((unit * away[:, None]), in_time)
            continue
        values[kernel] = np.kron(unit * coefficients, constant)
    return values


def _groups(
    random: RandomLaws,
    basis: stochastic.ChaosBasis,
    name: str,
    matrices: dict[tuple[str, str], Galerkin],
    plan: Plan,
    steps: int,
) -> list[ColumnGroup]:
    """Columns in which springs with random stiffnesses decouple; none where the stiffness is not random."""
    interface = random.problem.interfaces[name]
    law = interface.law
    random_ones = {law.kernel_name(p): matrices[name, p] for p in law.spans if (name, p) in matrices}
    if not random_ones:
        return []
    fields = bridge.active_fields(interface, plan)
    linear = _linear_parameters(random, basis, name, plan, steps)
    normal, tangential = random_ones.get("normal"), random_ones.get("tangential")
    spans: list[tuple[int, int, Galerkin | None]] = [(0, 1, normal)]
    if fields.components > 1:
        if normal is not None and tangential is not None and normal.source is tangential.source:
            spans = [(0, fields.components, normal)]
        else:
            spans.append((1, fields.components, tangential))
    groups = []
    for begin, end, matrix in spans:
        parameters = {}
        forward = matrix.forward if matrix is not None else []
        for key in ("normal", "tangential"):
            own = random_ones.get(key)
            if own is not None and matrix is not None and own.source is matrix.source:
                parameters[key] = np.repeat(own.values, steps, axis=1)
            else:
                parameters[key] = _each_step(fields.parameters[key], len(basis), steps)
        parameters["jump"] = _through(linear["jump"], forward, interface.num_points, len(basis))
        groups.append(ColumnGroup(begin, end, tuple(forward), None, parameters))
    return groups


@dataclass(frozen=True)
class Changes:
    """How the laws in the columns of a chaos differ from those without: modes x steps, the steps fastest.

    Attributes
    ----------
    steps, modes
        Their numbers.
    parameters
        Interface -> kernel parameter -> its values.
    columns
        Interface -> groups of components in other columns, as the kernel takes them.
    stiffness
        Part -> factors of its stiffness, and the matrix that leads to their columns; or what a field adds.
    """

    steps: int
    modes: int
    parameters: dict[str, dict[str, Array]]
    columns: dict[str, list[dict[str, Any]]]
    stiffness: dict[str, tuple[Array, Array] | stochastic.Coupling] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        random: RandomLaws,
        basis: stochastic.ChaosBasis,
        matrices: dict[tuple[str, str], Galerkin],
        collocations: Mapping[str, Collocation],
        plan: Plan,
        parts: Mapping[str, Galerkin],
        inside: Mapping[str, stochastic.Coupling],
    ) -> Changes:
        """Those of the active interfaces on this rank; `collocations` of the nonlinear ones."""
        steps = plan.amplitudes.shape[1]
        parameters: dict[str, dict[str, Array]] = {}
        columns: dict[str, list[dict[str, Any]]] = {}
        for name in (n for n in plan.active if n in random.problem.own.interfaces):
            if name in collocations:
                fields = bridge.active_fields(random.problem.interfaces[name], plan)
                groups = [collocations[name].group(random, fields, steps)]
            else:
                groups = _groups(random, basis, name, matrices, plan, steps)
            if groups:
                columns[name] = [each.kernel() for each in groups]
            else:
                parameters[name] = _linear_parameters(random, basis, name, plan, steps)
        every: dict[str, Any] = {p: (each.values[0], each.forward[0]) for p, each in parts.items()}
        here = {p: v for p, v in (every | dict(inside)).items() if p in random.problem.substructures}
        return cls(steps, len(basis), parameters, columns, here)

    def applied(self, laws: Laws) -> Laws:
        """The laws with the changes."""
        return laws.with_(
            steps=self.steps,
            modes=self.modes,
            parameters=self.parameters,
            columns=self.columns,
            stiffness=self.stiffness or None,
        )


def _with_collocations(
    plan: Plan, random: RandomLaws, collocations: dict[str, Collocation], chaos: Chaos
) -> Plan:
    """The plan with what it means that laws are nonlinear."""
    if not collocations:
        return plan
    decisions = [
        Decision(
            f"law of {name}",
            f"at {len(each)} points in {len(each.germs)} germs ({each.rule}), "
            f"{each.bytes(random, plan.steps) / 1e6:.3g} MB",
            "it is nonlinear: evaluated at stochastic quadrature points and projected on the modes",
        )
        for name, each in collocations.items()
    ]
    decisions.append(
        Decision(
            "check",
            f"{chaos.check_points} to {MOST_CHECKS * chaos.check_points} deterministic solves"
            if chaos.check_points
            else "none: not asked for",
            f"laws with kinks: trusted if mean and deviation are within {percent(chaos.tolerance)}",
        )
    )
    return replace(plan, decisions=plan.decisions + tuple(decisions))


class Planned(NamedTuple):
    """A chaos that can be run: what is random, what was asked for, its modes, and the plan."""

    random: RandomLaws
    chaos: Chaos
    basis: stochastic.ChaosBasis
    plan: Plan


def planned(
    problem: Problem,
    chaos: Chaos | int,
    method: Method = "auto",
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    indefinite: Literal["refuse", "prove"] = "refuse",
) -> Planned:
    """The modes of a chaos, and the plan for its run; arguments as for :func:`solve_chaos`."""
    checked_word("solve", "indefinite", indefinite, ("refuse", "prove"))
    check_problem("chaos", problem, plan)
    check_optional_kind("chaos", "options", options, Options, "give Options(rtol=...)")
    chaos = checked_chaos(chaos)
    random = RandomLaws.of(problem)
    told: dict[str, Any] = {"method": method, "active": active, "direction": direction, "times": times}
    basis, plan = plan_of_chaos(random, chaos, plan, options=options, **told)
    return Planned(random, chaos, basis, plan)


class Prepared(NamedTuple):
    """The laws in the columns of a chaos.

    Attributes
    ----------
    plan
        With what it means that laws are nonlinear.
    collocations
        Interfaces whose law is nonlinear -> the quadrature points.
    proven
        Stiffnesses that were proven not to matter although their own Galerkin matrix is indefinite.
    changes
        How the laws differ from those without chaos.
    """

    plan: Plan
    collocations: dict[str, Collocation]
    proven: tuple[str, ...]
    changes: Changes


def prepared(problem: Problem, wanted: Planned, indefinite: Literal["refuse", "prove"]) -> Prepared:
    """What the laws of a chaos are, once they are known to be positive definite."""
    random, chaos, basis, plan = wanted
    steps = plan.amplitudes.shape[1]
    curved = [name for name in plan.active if not random.linear(name)]
    collocations = {name: collocation(random, basis, chaos, name, steps) for name in curved}
    plan = _with_collocations(plan, random, collocations, chaos)
    matrices = galerkin(random, basis)
    parts = stiffness_of_parts(random, basis)
    proven = _guard(problem, random, basis, matrices, indefinite, parts)
    fields = fields_of_parts(random, basis)
    changes = Changes.of(random, basis, matrices, collocations, plan, parts, fields)
    return Prepared(plan, collocations, proven, changes)


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
    progress: bool = True,
    estimator: Estimator = not_measured,
) -> ChaosResult:
    """Solve for the chaos coefficients of everything.

    Parameters
    ----------
    chaos
        Order and index set; a number is the order of a total-degree set.
    method, active, direction, options, plan, start, callback, progress
        As for :func:`dolfinx_frontend.solve`; interfaces with random parameters are always active.
    times
        Times (T,) of a load history; random values do not change in it.
    estimator
        Measures the errors of the result when they are asked for.
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
        A law is nonlinear, and the chaos is further from deterministic solves than ``chaos.tolerance``.
    SceneWarning
        The truncation is not trusted, and stiffnesses come so near 0, where parts are free, that moments of
        these do not exist.
    """
    wanted = planned(problem, chaos, method, times, active, direction, options, plan, indefinite)
    states = start_states(start)
    return _run(problem, wanted, None, states, indefinite, callback, progress, estimator)


def _run(
    problem: Problem,
    wanted: Planned,
    solver: Solver | None,
    start: Sequence[State],
    indefinite: Literal["refuse", "prove"] = "refuse",
    callback: Callable[[Iteration], None] | None = None,
    progress: bool = True,
    estimator: Estimator = not_measured,
) -> ChaosResult:
    """One run of a plan, on a solver that is factorised already if there is one."""
    began = perf_counter()
    random, chaos, basis, _ = wanted
    plan, collocations, proven, changes = prepared(problem, wanted, indefinite)
    amplitudes = amplitudes_of(plan, random, basis)
    options = plan.options
    if options.backend == "multigrid":
        solver, start = fitted(problem, plan, changes.applied, amplitudes, changes.steps)
        options = options.with_(rtol=(1.0 - SHARE) * options.rtol)
    solver = solver or Solver(problem, plan)
    laws = changes.applied(solver.laws)
    built = perf_counter()
    check_start(start, solver, amplitudes.shape[1])
    options = within(options, built - began)
    summary, state = solver.run(laws, options, amplitudes, start, callback, progress)
    seconds = {"setup": built - began, "solve": perf_counter() - built}
    result = ChaosResult(
        problem,
        plan,
        summary,
        state,
        seconds,
        solver,
        laws,
        solver.fields_of_cuts(laws, state),
        random=random,
        chaos=chaos,
        basis=basis,
        proven=proven,
        collocations=collocations,
        accuracy=accuracy_of_run(summary, plan, solver.bodies, problem.comm, solver.left),
        estimator=estimator,
        continuation=_tightened,
        sampler=sample_chaos,
    )
    result = _checked(result)
    if not result.trusted:
        warn_of_free_parts("chaos", random)
    return result


def _tightened(result: ChaosResult, rtol: float) -> ChaosResult:
    """The same chaos, carried on to another tolerance."""
    return carry_on(result, result.chaos, rtol)


def _checked(result: ChaosResult) -> ChaosResult:
    """The result with all its forces compared with deterministic solves where a law is nonlinear.

    More points are taken while the estimates pass and only their standard errors do not. A warning says where
    they differ.
    """
    count, tolerance = result.chaos.check_points, result.chaos.tolerance
    if not result.collocations and result.converged:
        return result.with_notes(misfits=_misfits(result))
    if not result.collocations or count == 0 or not result.converged:
        return result
    problem = result.problem
    # independent of the Sobol points at which the law may be evaluated
    germs = result.space.sample(MOST_CHECKS * count, 1)
    for first, last in ((0, 1), (1, 2), (2, MOST_CHECKS)):
        part = result.sample(germs[first * count : last * count])
        if not part.complete:
            return result  # Ctrl-C: not checked, so not trusted; the log says so
        checked = (*result.checked, part)
        own = [name for name in result.plan.active if problem.speaks_for(name)]
        sizes = problem.gather({n: result.acts(n, checked) for n in own})
        least = result.plan.options.rtol * max(sizes.values(), default=0.0)
        checks = problem.gather({n: result.compared(n, checked, least) for n in own})
        seconds = {**result.seconds, "check": sum(sum(each.seconds.values()) for each in checked)}
        result = result.with_notes(checks=checks, checked=checked, seconds=seconds)
        if result.trusted or any(not c.estimate <= tolerance for c in checks.values()):
            break
    if not result.trusted and problem.rank == 0:
        _warn_of_truncation(result)
    return result


def _misfits(result: ChaosResult) -> dict[str, float] | None:
    """Misfits of all interfaces with something random, and of random numbers of loads.

    None: one of the interfaces was eliminated, or has patterns, or has no law at some points (a stiffness
    below 0); or the stiffness of a part is random, or a random value changes in time.
    """
    problem, names = result.problem, result.random.interfaces
    if names and (result.plan.history == "patterns" or not set(names) <= set(result.plan.active)):
        return None
    if result.random.parts or any(result.random.amplitude(*key) is not None for key in result.random.sources):
        return None  # not measured
    if not result.random.make_laws(result.points_of_misfit):
        return None
    with agreement(problem.comm):
        own = {name: result.misfit(name) for name in names if problem.speaks_for(name)}
    of_loads = {f"{term.load}.{term.parameter}": result.misfit_of(term) for term in result.random.loads}
    return problem.gather(own) | of_loads


def _warn_of_truncation(result: ChaosResult) -> None:
    tolerance = result.chaos.tolerance
    solves = sum(len(part.germs) for part in result.checked)
    bad = [str(c) for c in result.checks.values() if not c.error <= tolerance]
    lost = sum(int((part.points.status != "converged").sum()) for part in result.checked)
    if lost:
        bad.append(f"{lost} check solves did not converge")
    warn(
        f"the chaos of order {result.chaos.order} is not proven converged to {percent(tolerance)} by "
        f"{solves} deterministic solves:\n  "
        + "\n  ".join(bad)
        + "\nlaws that are nonlinear make kinks, on which chaos converges slowly: raise the order, or "
        "sample on the same solver: result.quasi_monte_carlo(1024) or result.monte_carlo(1000), without "
        "chaos quasi_monte_carlo(problem, 1024); Chaos(tolerance=...) sets the limit",
        TruncationWarning,
    )


def chaos_on(
    result: Result,
    chaos: Chaos,
    method: Method = "auto",
    *,
    times: npt.ArrayLike | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    progress: bool = True,
) -> ChaosResult | None:
    """A chaos on the factors of the answer at its means, from which it starts; None: it needs others."""
    problem = result.problem
    wanted = planned(problem, chaos, method, times, result.plan.active, direction, options)
    if wanted.plan.options.backend == "multigrid" or not wanted.plan.shares_factors(result.plan):
        return None
    steps = wanted.plan.amplitudes.shape[1]
    if result.state.data.shape[1] != steps:
        return None
    start = []
    for block in (result.state.data, result.state.traces):
        wider = np.zeros((len(block), len(wanted.basis) * steps), order="F")
        wider[:, :steps] = block
        start.append(wider)
    return _run(
        problem, wanted, result.solver, [State(*start)], progress=progress, estimator=result.estimator
    )


def carry_on(result: ChaosResult, chaos: Chaos, rtol: float) -> ChaosResult:
    """The run of another chaos or tolerance on the factorised problem of a result, started from its answer.

    The modes that both have are taken over, the others start from zero.

    Raises
    ------
    IndefiniteError
        A Galerkin stiffness is indefinite in the new basis.
    """
    problem, random, old = result.problem, result.random, result.plan
    rows = result.solver.rows
    needed = result.steps * (problem.size + rows * (4 + 3 * old.options.acceleration))
    basis = random.space.basis(chaos, rows=needed)
    plan = plan_of_random(
        "chaos",
        random,
        None,
        method=old.method if old.method == "latin" else "auto",
        active=old.active,
        direction=old.direction,
        options=old.options.with_(rtol=rtol),
        way=Way(None, len(basis), chaos.order, chaos.check_points),
        times=old.times,
    )
    steps = result.steps
    states = []
    for block in (result.state.data, result.state.traces):
        wider = np.zeros((len(block), len(basis) * steps), order="F")
        for mode, index in enumerate(np.asarray(result.basis.indices.table)):
            place = basis.indices.find([int(i) for i in np.atleast_1d(index)])
            if place is not None:
                wider[:, place * steps : (place + 1) * steps] = block[:, mode * steps : (mode + 1) * steps]
        states.append(wider)
    indefinite: Literal["refuse", "prove"] = "prove" if result.proven else "refuse"
    start = [State(*states)]
    wanted = Planned(random, chaos, basis, plan)
    return _run(problem, wanted, result.solver, start, indefinite, estimator=result.estimator)
