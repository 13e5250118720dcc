"""Inputs of a problem seen as a function: what they are called, and what they are to the kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core import SweptParameter

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_known, checked_names
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.evaluate.sampling import problem_at, sampled_values
from dolfinx_frontend.evaluate.support import acts
from dolfinx_frontend.evaluate.sweep import (
    swept_parts,
    swept_problem,
    swept_targets,
    swept_term,
    swept_values,
)
from dolfinx_frontend.plan.plan import Plan, check_keeps, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.acting import mean_number
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.uncertainty.expressions import Operand
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["Coordinates", "Inputs"]

Coordinates = Literal["physical", "germs", "normal"]
"""What random inputs are given as: their own values, germs, or independent standard normal scores."""

STEP = 1e-5
"""Of the difference quotients, relative to an input: of the laws and the readings alone, never of a solve."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """What changes from point to point.

    Attributes
    ----------
    problem
        What is solved.
    random
        What is random, with the germs of all of it, and of random numbers that the problem has not.
    names
        Of the inputs, in order.
    coordinates
        What random inputs are given as.
    germs
        Input -> column of the germs, of those that are given as germs or scores, or of no one number.
    direct
        Inputs that are parameters of laws, loads and parts -> interface (load, part) and parameter.
    """

    problem: Problem
    random: RandomLaws
    names: tuple[str, ...]
    coordinates: Coordinates
    germs: Mapping[str, int]
    direct: Mapping[str, tuple[str, str]]

    @classmethod
    def of(
        cls,
        problem: Problem,
        names: Sequence[str] | str | None,
        coordinates: Coordinates,
        more: Sequence[Operand] = (),
    ) -> Inputs:
        """Inputs by name; None: all that is random.

        Raises
        ------
        SceneError
            An unknown name, one that is twice there, or nothing is random and nothing is named.
        """
        where = "function"
        check_known("coordinates", coordinates, ("physical", "germs", "normal"), where)
        random = RandomLaws.of(problem)
        known = [*problem.law_parameters, *problem.load_parameters, *problem.part_parameters]
        given = [names] if isinstance(names, str) else None
        if given is None and names is not None:
            given = checked_names(where, "inputs", names)
        own = RandomSpace([*random.every, *_leaves(more)])
        of_random = {*own.names, *own.germ_names}
        direct_names = [n for n in given or () if n in known and n not in of_random]
        random = _without(random, direct_names)
        random = replace(random, space=RandomSpace([*random.every, *_leaves(more)]))
        space = random.space
        fields = {n for n in space.names if isinstance(space._sources[n], DiscretisedField)}
        if given is None:
            given = list(space.germ_names)
            if coordinates == "physical":
                given = [g for n in space.names for g in (_germs_of(space, n) if n in fields else [n])]
            if not given:
                raise SceneError(
                    "function: nothing is random: give a law or a load a random value, or name the inputs of "
                    "the function, e.g. inputs=['joint.normal']"
                )
        if not given:
            raise SceneError("function: inputs = []: name one at least; None: all that is random")
        twice = [n for k, n in enumerate(given) if n in given[:k]]
        if twice:
            raise SceneError(f"function: input {twice[0]!r} is there twice")
        germs: dict[str, int] = {}
        for name in given:
            if name in direct_names:
                continue
            if coordinates == "physical" and name in space.names:
                if name in fields:
                    raise SceneError(
                        f"function: input {name!r} is a random field: name its germs, "
                        f"{_germs_of(space, name)[0]!r}, ..."
                    )
                continue
            check_known("input", name, {*space.germ_names, *space.names, *known}, where)
            if name not in space.germ_names:
                raise SceneError(
                    f"function: input {name!r} with coordinates = {coordinates!r}: name germs, "
                    f"{', '.join(space.germ_names[:6])}"
                )
            germs[name] = space.germ_names.index(name)
        direct = swept_targets(problem, [(n,) for n in direct_names])
        return cls(problem, random, tuple(given), coordinates, germs, direct)

    @property
    def dimension(self) -> int:
        """Their number."""
        return len(self.names)

    def plan(self, given: Plan | None, **settings: Any) -> Plan:
        """A given plan that keeps what changes, or one made for it."""
        of_parts = swept_parts(self.problem, self.direct)
        of_loads = [each for each in self.direct.values() if each[0] in self.problem.loads]
        laws = [
            interface
            for name, (interface, _) in self.direct.items()
            if interface not in self.problem.loads and name not in of_parts
        ]
        vary = list(dict.fromkeys([*self.random.interfaces, *laws]))
        terms = [swept_term(self.problem, *each) for each in of_loads]
        loads = list(dict.fromkeys([*self.random.loads, *terms]))
        scaled = list(dict.fromkeys([*self.random.scaled, *of_parts.values()]))
        if given is not None:
            check_keeps("function", given, vary, loads, scaled)
            return given
        fields = self.random.fields
        return make_plan(self.problem, vary=vary, loads=loads, scaled=scaled, fields=fields, **settings)

    def checked(self, x: npt.ArrayLike) -> Array:
        """Points (N, inputs), finite; a point may be given by its row."""
        try:
            points = np.atleast_2d(np.array(x, dtype=np.float64))
        except (TypeError, ValueError):
            raise SceneError("function: points: give numbers, a row per point") from None
        if points.ndim != 2 or points.shape[1] != self.dimension:
            raise SceneError(
                f"function: points of shape {np.shape(x)}; there are {self.dimension} inputs: "
                f"{', '.join(self.names)}"
            )
        if not np.all(np.isfinite(points)):
            row, column = np.argwhere(~np.isfinite(points))[0]
            raise SceneError(
                f"function: input {self.names[column]!r} is {points[row, column]:g} at point {row}: give "
                "finite numbers"
            )
        return points

    def germ_points(self, x: Array) -> Array:
        """Points (N, L) of the germs; random numbers that are no input stay at their means."""
        space = self.random.space
        columns = {name: x[:, k] for k, name in enumerate(self.names)}
        given = {n: v for n, v in columns.items() if n not in self.germs and n not in self.direct}
        points = space.germ_points(given)
        if not given:
            points = np.repeat(points, len(x), axis=0)
        if not self.germs:
            return points
        if self.coordinates == "normal":
            scores = space.to_normal(points)
            for name, column in self.germs.items():
                scores[:, column] = columns[name]
            moved = space.from_normal(scores)
            used = list(self.germs.values())
            points[:, used] = moved[:, used]
            return points
        for name, column in self.germs.items():
            points[:, column] = columns[name]
        return points

    def values(self, x: Array) -> dict[str, Array]:
        """Random number -> its values (N,), of all that are numbers."""
        space = self.random.space
        if not space.dimension:
            return {}
        points = self.germ_points(x)
        sources = {n: s for n, s in space._sources.items() if not isinstance(s, DiscretisedField)}
        return {name: space.values(source, points) for name, source in sources.items()}

    def parameters(self, plan: Plan, x: Array) -> list[SweptParameter]:
        """What the kernel is given at points (N, inputs).

        Raises
        ------
        SceneError
            A value that makes no law.
        """
        direct: dict[tuple[str, ...], Array] = {}
        direct |= {(n,): np.ascontiguousarray(x[:, k]) for k, n in enumerate(self.names) if n in self.direct}
        found = swept_values(self.problem, plan, direct, self.direct) if direct else []
        if self.random.every:
            found += sampled_values(self.random, plan, self.germ_points(x))
        return found

    @property
    def acts(self) -> bool:
        """Whether what pushes on the parts differs from point to point."""
        interfaces = {name for name, _ in (*self.direct.values(), *self.random.sources)}
        return acts(self.problem, interfaces, self.random.loads)

    def problem_at(self, x: Array) -> Problem:
        """The problem at a point (inputs,)."""
        random = self.random
        now = problem_at(random, self.germ_points(x[None])[0]) if random.every else self.problem
        given = {name: x[k] for k, name in enumerate(self.names) if name in self.direct}
        return swept_problem(now, given) if given else now

    def around(self, x: Array, which: Sequence[int] | Ints, steps: Array) -> tuple[Array, Array]:
        """Neighbours (2 * which, inputs) of a point along some inputs, those above first; half their
        distances."""
        numbers: Ints = np.asarray(which, dtype=np.int64)
        rows = np.arange(len(numbers))
        ends = np.repeat(x[None, None], 2, axis=0).repeat(len(numbers), axis=1)
        ends[0, rows, numbers] += steps[numbers]
        ends[1, rows, numbers] -= steps[numbers]
        # as they are in the end
        return np.concatenate(list(ends)), 0.5 * (ends[0] - ends[1])[rows, numbers]

    def steps(self, x: Array) -> Array:
        """Steps (inputs,) of difference quotients at a point (inputs,)."""
        sizes = np.abs(x)
        for k, name in enumerate(self.names):
            if name in self.germs:
                sizes[k] = max(sizes[k], 1.0)
            elif name in self.direct:
                sizes[k] = sizes[k] or abs(self._nominal(name)) or 1e-3
            else:
                source: Any = self.random.space._sources[name]
                sizes[k] = max(sizes[k], float(source.std))
        return np.asarray(STEP * sizes)

    def _nominal(self, name: str) -> float:
        """What a parameter is in the scene; what changes in time, beside its amplitude; 0: not known."""
        problem, target = self.problem, self.direct[name]
        if target[0] in problem.loads:
            return float(mean_number(problem, swept_term(problem, *target))[0])
        value: Any = {**problem.law_parameters, **problem.part_parameters}.get(name)
        if isinstance(value, Varying):
            value = value.terms[0][1]
        if isinstance(value, Operand):
            return float(getattr(value, "mean", 0.0))
        if callable(value):
            value = value(problem.interfaces[target[0]].points)
        try:
            return float(np.mean(np.array(value, dtype=np.float64)))
        except (TypeError, ValueError):
            return 0.0

    def nominal(self) -> Array:
        """(inputs,) where everything has the value of the scene, what is random its mean or median score.

        Of a value that differs from point to point its mean over the points.
        """
        found = np.zeros(self.dimension)
        space = self.random.space
        means = space.germ_points({})[0] if space.dimension else np.zeros(0)
        if self.coordinates == "normal" and space.dimension:
            means = space.to_normal(means[None])[0]
        for k, name in enumerate(self.names):
            if name in self.germs:
                found[k] = means[self.germs[name]]
            elif name in self.direct:
                found[k] = self._nominal(name)
            else:
                found[k] = float(space._sources[name].mean)
        return found


def _leaves(operands: Sequence[Operand]) -> list[Any]:
    return [leaf for each in operands for leaf in each.leaves.values()]


def _germs_of(space: RandomSpace, name: str) -> list[str]:
    return [space.germ_names[column] for column in space.columns(space._sources[name])]


def _without(random: RandomLaws, names: Sequence[str]) -> RandomLaws:
    """What stays random where some parameters are given as numbers."""
    if not names:
        return random
    problem = random.problem
    sources = {key: s for key, s in random.sources.items() if ".".join(key) not in names}
    for name in names:
        value = problem.law_parameters.get(name)
        interface, _, parameter = name.rpartition(".")
        if isinstance(value, Operand) and (interface, parameter) not in random.sources:
            raise SceneError(
                f"function: input {name!r} is {value!r} in the scene and enters by a derived number: name "
                "the random "
                "number instead, or give the law a plain one"
            )
    loads = {term: s for term, s in random.loads.items() if f"{term.load}.{term.parameter}" not in names}
    of_parts = {name.rpartition(".")[0] for name in names if name in problem.part_parameters}
    parts = {part: s for part, s in random.parts.items() if part not in of_parts}
    of_loads = (s for found in loads.values() for s in found)
    space = RandomSpace([*sources.values(), *of_loads, *parts.values()])
    return replace(random, sources=sources, loads=loads, parts=parts, space=space)
