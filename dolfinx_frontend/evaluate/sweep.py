"""Multiresolution: a grid of parameter sets, each solved from its neighbours' interface states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import Iteration, Options, SweepPoints, SweptParameter, snake_order

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    check_optional_kind,
    checked_callable,
    checked_name,
    checked_names,
    checked_numbers,
    checked_reals,
    told_call,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen, read_only
from dolfinx_frontend.evaluate.evaluator import Design, Evaluator, Names, Spent, checkpoint_path
from dolfinx_frontend.evaluate.support import acts
from dolfinx_frontend.kernel.running import check_running
from dolfinx_frontend.kernel.spread import agreed_over, point_ranks
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, check_settings, make_plan
from dolfinx_frontend.results.acting import stiffness_factors, swept_loads
from dolfinx_frontend.results.answer import Block
from dolfinx_frontend.results.sweep import SweepResult, point_block
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.loads import LoadTerm

__all__ = [
    "planned",
    "sweep",
    "swept_parts",
    "swept_problem",
    "swept_targets",
    "swept_term",
    "swept_values",
]

Key = str | tuple[str, ...]

SWEEP = Names("sweep", "sweep point")

_GRID = "give {'interface.parameter': values}"


def _axes(grid: Mapping[Key, Sequence[float]]) -> dict[tuple[str, ...], Array]:
    check_kind("sweep", "grid", grid, Mapping, _GRID)
    axes = {}
    for key, values in grid.items():
        names = (key,) if isinstance(key, str) else tuple(checked_names("sweep", "axis", key))
        if not names:
            raise SceneError("sweep: axis = (): give one name at least, e.g. 'interface.parameter'")
        where, wanted = f"sweep over {', '.join(names)}", "give a list of finite numbers"
        data = checked_numbers(where, "values", values, wanted, dimensions=1)
        if not data.size:
            raise SceneError(f"{where}: values = []: {wanted}")
        axes[names] = frozen(data)
    if not axes:
        raise SceneError("sweep: the grid is empty; give {'interface.parameter': values}")
    return axes


def swept_targets(problem: Problem, axes: Iterable[tuple[str, ...]]) -> dict[str, tuple[str, str]]:
    """Swept name -> interface and parameter."""
    targets: dict[str, tuple[str, str]] = {}
    for name in (name for key in axes for name in key):
        interface, _, parameter = name.rpartition(".")
        known = [*problem.law_parameters, *problem.load_parameters, *problem.part_parameters]
        check_known("parameter", name, known, "sweep")
        if name in targets:
            raise SceneError(f"sweep: {name!r} is on two axes")
        targets[name] = (interface, parameter)
    return targets


def swept_values(
    problem: Problem,
    plan: Plan,
    values_of: Mapping[tuple[str, ...], Array],
    targets: Mapping[str, tuple[str, str]],
) -> list[SweptParameter]:
    """Values (N,) of names at N points, as the kernel takes them.

    Raises
    ------
    SceneError
        A value that the law does not take, or that the plan has no place for.
    """
    of_loads = {name for name, (load, _) in targets.items() if load in problem.loads}
    of_parts = set(swept_parts(problem, targets))
    others = of_loads | of_parts
    of_laws = {name: interface for name, (interface, _) in targets.items() if name not in others}
    missing = [name for name, interface in of_laws.items() if interface not in plan.active]
    if missing:
        raise SceneError(f"sweep: the plan eliminates the interface of {', '.join(missing)}")
    loads: dict[LoadTerm, Array] = {}
    parameters: list[SweptParameter] = []
    of_stiffness: dict[str, Array] = {}
    swept: dict[str, dict[str, Array]] = {}
    for key, values in values_of.items():
        for name in key:
            swept.setdefault(targets[name][0], {})[targets[name][1]] = values
    for key, values in values_of.items():
        for name in key:
            interface, parameter = targets[name]
            if name in of_parts:
                nominal = problem.part_parameters[name]
                if not values.min() > 0.0:
                    raise SceneError(
                        f"sweep: {name!r} takes the value {values.min():g}: a stiffness is "
                        "positive; leave it out"
                    )
                if interface in of_stiffness:
                    raise SceneError(
                        f"sweep: {name!r}: the stiffness of {interface!r} is on two axes; give one"
                    )
                of_stiffness[interface] = values / nominal
                continue
            if name in of_loads:
                loads[swept_term(problem, interface, parameter)] = values
                continue
            where = problem.interfaces[interface]
            if parameter in where.law.not_negative and values.min() < 0.0:
                raise SceneError(f"sweep: {name!r} takes the value {values.min():g}: it must be >= 0")
            own = {p: v for p, v in swept.get(interface, {}).items() if p in _made_with(where.law, parameter)}
            if len(own) > 1 and parameter != next(iter(own)):
                continue  # it came with the first of them
            kernel_name, pattern, factors = _kernel_values(where, parameter, values, own)
            if any(p.interface == interface and p.parameter == kernel_name for p in parameters):
                raise SceneError(
                    f"sweep: {name!r} and another swept value of {interface!r} set the same number of its "
                    f"law ({kernel_name}): sweep one of them, or the result of both"
                )
            pattern, columns = _through_time(problem, plan, interface, parameter, pattern)
            parameters.append(SweptParameter(interface, kernel_name, pattern, factors, columns))
    absent = [f"{t.load}.{t.parameter}" for t in loads if t not in plan.loads]
    if absent:
        raise SceneError(f"sweep: the plan has no column for {', '.join(absent)}: leave the plan out")
    absent = [part for part in of_stiffness if part not in plan.scaled]
    if absent:
        raise SceneError(
            f"sweep: the plan has no factor for the stiffness of {', '.join(absent)}: leave the plan out"
        )
    return [*parameters, *stiffness_factors(of_stiffness), *swept_loads(plan, loads)]


def _made_with(law: Law, parameter: str) -> tuple[str, ...]:
    """Parameters that make one number of a law together: torque and friction the force of a bolt."""
    return next((names for names, _ in law.derived().values() if parameter in names), (parameter,))


def _kernel_values(
    where: Interface, parameter: str, values: Array, own: Mapping[str, Array]
) -> tuple[str, Array, Array]:
    """As ``law.kernel_values``, of all the swept parameters that make one number together."""
    kernel_name, pattern, factors = where.law.kernel_values(where, parameter, values.reshape(1, -1))
    if len(own) > 1:
        function = next(f for names, f in where.law.derived().values() if parameter in names)
        factors = np.asarray(function({name: each.reshape(1, -1) for name, each in own.items()}))
    return kernel_name, pattern, factors


def swept_parts(problem: Problem, targets: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Swept stiffnesses -> their parts."""
    known = problem.part_parameters.keys() - problem.load_parameters.keys()
    return {name: part for name, (part, _) in targets.items() if name in known}


def swept_term(problem: Problem, load: str, parameter: str) -> LoadTerm:
    """A number of a load that is swept: it keeps its amplitude."""
    terms = problem.loads[load].load.terms(parameter)
    if len(terms) > 1:
        raise SceneError(
            f"sweep: {load}.{parameter} is a sum of values that change in time; sweep a single "
            "amplitude * value"
        )
    return LoadTerm(load, parameter, terms[0].amplitude)


@together("sweep")
def sweep(
    problem: Problem,
    grid: Mapping[Key, Sequence[float]],
    *,
    method: Method = "auto",
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    checkpoint: str | Path | None = None,
    progress: bool = True,
    callback: Callable[[Iteration], None] | None = None,
    keep_states: bool = False,
    times: npt.ArrayLike | None = None,
    keep_fields: bool = True,
    outputs: Mapping[str, Callable[[Block], npt.ArrayLike]] | None = None,
    points_comm: Any = None,
) -> SweepResult:
    """Solve for every point of a grid of law parameters.

    The grid is walked so that neighbours in the order differ in one parameter by one step; each
    point starts from the combination of the nearest solved interface states that leaves the
    smallest residual. Where all laws are linear there is nothing to iterate on: on one rank, the point in the
    middle comes first and all others are solved together, by conjugate gradients on the condensed interfaces.

    Parameters
    ----------
    grid
        ``"interface.parameter"`` -> values. A tuple of names is one axis: all of them take its
        values, in the units of the law (totals where the law is given as a total).
    method, active, direction, options, plan
        As for :func:`solve`; swept interfaces are always active.
    checkpoint
        File of finished points. If it exists they are not solved again: an interrupted sweep goes
        on.
    progress
        True: a progress bar if on a terminal.
    callback
        Called after every iteration; it may raise StopIteration to end the sweep with what is done so far.
    keep_states
        Keep the interface states, from which displacements can be recovered.
    times
        Times (T,) of a load history. A swept value that changes in time keeps its amplitude.
    keep_fields
        Keep force and jump of the active interfaces at every point: N x T x rows numbers each.
    outputs
        Name -> function of the interface fields of a point (a :class:`Block` of one sample) that returns
        (1,) or (1, ...), the sample in front; only that is kept, where all fields would be too many.
    points_comm
        mpi4py communicator of ranks that solve the points together, e.g. ``MPI.COMM_WORLD``; every rank has
        the whole problem (``assemble(scene, comm=MPI.COMM_SELF)``), all call alike and get the whole result.
        None: no ranks beside those of the problem.

    Raises
    ------
    SceneError
        Unknown parameter, empty grid, inadmissible value.
    CheckpointError
        The checkpoint is damaged or of another sweep.
    KeyboardInterrupt
        At a second Ctrl-C. The first one returns the points that are finished, ``complete`` is False then.
    """
    settings: dict[str, Any] = {"active": active, "direction": direction, "options": options, "times": times}
    _check_request(problem, plan, method, grid, outputs, settings)
    check_running("sweep", callback, progress, keep_states=keep_states, keep_fields=keep_fields)
    file = checkpoint_path("sweep", checkpoint)
    names = None if outputs is None else tuple(outputs)
    told = {"outputs": names, "plan": plan is None, "checkpoint": file is not None}
    kept = {"keep_states": keep_states, "keep_fields": keep_fields}
    problem.check_alike("sweep", laws=True, grid=grid, method=method, **told, **kept, **settings)
    ranks = point_ranks("sweep", problem, points_comm)
    if ranks is not None:
        ranks.check_alike("sweep", grid=grid, method=method, **told, **kept, **settings)
    with agreed_over(ranks):
        plan, axes, parameters = planned(problem, grid, method, plan, settings)
    evaluator = Evaluator(SWEEP, problem, plan, parameters, ranks=ranks)
    flat = _flat(axes)

    def at(point: int) -> Problem:
        return swept_problem(problem, {name: v[point] for key, v in flat.items() for name in key})

    def answer(points: SweepPoints, spent: Spent) -> SweepResult:
        seconds = {"setup": evaluator.setup, "first": spent.first, "rest": spent.every - spent.first}
        named, solver = {", ".join(key): read_only(values) for key, values in axes.items()}, evaluator.solver
        return SweepResult(problem, plan, named, points, seconds, solver, solver.laws, tuple(parameters))

    result = evaluator.answers(
        Design(
            parameters,
            snake_order([len(values) for values in axes.values()]),
            at,
            acts(problem, {name.rpartition(".")[0] for key in axes for name in key}),
        ),
        answer,
        checkpoint=file,
        facts={
            "grid": {", ".join(key): values.tolist() for key, values in axes.items()},
            "keep_fields": keep_fields,
            "outputs": list(outputs or {}),
        },
        functions=outputs,
        progress=progress,
        callback=callback,
        keep_states=keep_states,
        keep_fields=keep_fields,
        outputs={name: _reading(problem, plan, name, call) for name, call in (outputs or {}).items()},
    )
    if ranks is not None:
        ranks.close()
    return result


def swept_problem(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The problem with other numbers; those that change in time keep their amplitudes."""
    known = {**problem.law_parameters, **problem.load_parameters}
    given: dict[str, Any] = {}
    for name, value in values.items():
        old = known.get(name)
        amplitude = old.terms[0][0] if isinstance(old, Varying) else None
        given[name] = float(value) if amplitude is None else amplitude * float(value)
    return problem.with_laws(values=given)


def _flat(axes: Mapping[tuple[str, ...], Array]) -> dict[tuple[str, ...], Array]:
    """Values (N,) of the axes at all points of their grid."""
    mesh = np.meshgrid(*axes.values(), indexing="ij")
    return {key: values.ravel() for key, values in zip(axes, mesh, strict=True)}


def planned(
    problem: Problem,
    grid: Mapping[Key, Sequence[float]],
    method: Method,
    plan: Plan | None,
    settings: Mapping[str, Any],
) -> tuple[Plan, dict[tuple[str, ...], Array], list[SweptParameter]]:
    """Plan, axes and swept values of a grid; arguments as for :func:`sweep`."""
    axes = _axes(grid)
    targets = swept_targets(problem, axes)
    if plan is None:
        parts = swept_parts(problem, targets)
        swept = {
            interface
            for name, (interface, _) in targets.items()
            if interface not in problem.loads and name not in parts
        }
        loads = [swept_term(problem, *each) for each in targets.values() if each[0] in problem.loads]
        plan = make_plan(problem, method, vary=swept, loads=loads, scaled=parts.values(), **settings)
    with agreement(problem.comm):
        parameters = swept_values(problem, plan, _flat(axes), targets)
    return plan, axes, parameters


def _check_request(
    problem: Problem,
    plan: Plan | None,
    method: Method,
    grid: object,
    outputs: Mapping[str, Callable[[Block], npt.ArrayLike]] | None,
    settings: Mapping[str, Any],
) -> None:
    check_problem("sweep", problem, plan)
    check_kind("sweep", "grid", grid, Mapping, _GRID)  # before grids of ranks are compared
    check_settings("sweep", plan, method, **settings)
    check_optional_kind("sweep", "outputs", outputs, Mapping, "give {name: function of the fields}")
    for name, function in outputs.items() if isinstance(outputs, Mapping) else ():
        checked_name("sweep: outputs", name, colon=False)
        checked_callable("sweep", f"outputs[{name!r}]", function, "give a function of the fields")


def _reading(
    problem: Problem, plan: Plan, name: str, function: Callable[[Block], npt.ArrayLike]
) -> Callable[[int, dict[str, tuple[Array, Array]]], npt.ArrayLike]:
    """A user's function of a point as the kernel's sweep calls it."""

    def read(_: int, fields: dict[str, tuple[Array, Array]]) -> npt.ArrayLike:
        if problem.comm is not None:  # a function may need interfaces of other ranks
            fields = problem.gather({n: each for n, each in fields.items() if problem.speaks_for(n)})
        # what a function does to its arrays is no business of the sweep's, nor of the next function's
        shown = {n: (read_only(force), read_only(jump)) for n, (force, jump) in fields.items()}
        with agreement(problem.comm):
            return _read_point(point_block(problem, plan, shown), name, function)

    return read


def _read_point(fields: Block, name: str, function: Callable[[Block], npt.ArrayLike]) -> Array:
    """What a user's function reads at a point."""
    found = told_call(f"sweep: outputs[{name!r}]", function, fields)
    values = found if type(found) is np.ndarray else None
    if values is None or values.dtype.kind not in "biuf":  # flags are numbers here, too
        values = checked_reals("sweep: outputs", f"{name}(fields)", found, "return real numbers")
    if values.ndim == 0 or len(values) != 1:
        raise SceneError(
            f"sweep: outputs[{name!r}]: the function returned shape {values.shape} for 1 "
            "sample; return one number or array a sample, with the samples in front"
        )
    first: Array = values[0]
    return first


def _through_time(
    problem: Problem, plan: Plan, interface: str, parameter: str, pattern: Array
) -> tuple[Array, int]:
    """Pattern of a swept value with a block of rows per column, and the number of columns."""
    value = problem.interfaces[interface].law.varying.get(parameter)
    if value is None or plan.times is None:
        return pattern, 1
    if len(value.terms) > 1:
        raise SceneError(
            f"sweep: {interface}.{parameter} is a sum of values that change in time; sweep a single "
            "amplitude * value"
        )
    amplitude = value.terms[0][0]
    if plan.history == "patterns":
        factors = [1.0 if a == amplitude else 0.0 for a in plan.patterns]
    else:
        factors = [1.0 if amplitude is None else amplitude(t) for t in plan.times]
    return np.kron(np.reshape(factors, (-1, 1)), pattern), len(factors)
