"""What is random in a problem: the random parameters of its laws, and the space that they span.

Shared by everything that treats uncertainty (LATIN-PCE, monolithic SSFEM, sampling), so that all of them
speak of the same germs in the same order.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from latin_core.stochastic import ChaosBasis

from dolfinx_frontend.assembly.held import check_held
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import special
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.common.kept import kept
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying
from dolfinx_frontend.scene.laws import Fields, Law
from dolfinx_frontend.scene.loads import OF_STIFFNESS, LoadTerm
from dolfinx_frontend.uncertainty.expressions import ByName, Expression
from dolfinx_frontend.uncertainty.fields import DiscretisedField, RandomField
from dolfinx_frontend.uncertainty.parameters import RandomParameter
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = [
    "RandomLaws",
    "SampledParameter",
    "Source",
    "is_random",
    "sampled_parameters",
    "warn_of_free_parts",
]

Source = RandomParameter | DiscretisedField | Expression


class SampledParameter(NamedTuple):
    """A random parameter in kernel terms at N points of the germs: ``pattern @ values``."""

    name: str  # of the kernel's parameter
    pattern: Array  # (rows, r)
    values: Array  # (r, N)


def is_random(value: object) -> bool:
    """Whether a value is a random parameter, an expression of some, or a random field."""
    return isinstance(value, (RandomParameter, Expression, RandomField))


@dataclass(frozen=True, repr=False)
class RandomLaws:
    """The random law parameters of a problem.

    Attributes
    ----------
    problem
        The problem.
    sources
        (interface, parameter) -> random parameter, or random field on the interface points.
    dropped
        Random parameters that no answer depends on, with the reason: they get no germ.
    space
        Their germs.
    loads
        Numbers of loads of parts that are random -> the random parameters in them.
    parts
        Parts -> random factor of their stiffness, with the mean 1, or random field of it on their cells.
    """

    problem: Problem
    sources: dict[tuple[str, str], Source]
    dropped: tuple[str, ...]
    space: RandomSpace
    loads: dict[LoadTerm, tuple[RandomParameter | Expression, ...]] = field(default_factory=dict)
    parts: dict[str, Source] = field(default_factory=dict)

    def __post_init__(self) -> None:
        locked(self)

    def __repr__(self) -> str:
        named = [f"{name}.{parameter} = {source!r}" for (name, parameter), source in self.sources.items()]
        named += [f"{t.load}.{t.parameter} = {s!r}" for t, found in self.loads.items() for s in found]
        named += [f"stiffness of {name} = {source!r}" for name, source in self.parts.items()]
        return f"RandomLaws({', '.join(named)})"

    @classmethod
    def of(cls, problem: Problem) -> RandomLaws:
        """Collect the random parameters in the order of the interfaces.

        Raises
        ------
        SceneError
            Two parameters of one name, or a random value where a law takes none.
        """
        check_is_problem("RandomLaws", problem)
        return kept(problem, "_random_laws", lambda: cls._collected(problem))

    @classmethod
    def _collected(cls, problem: Problem) -> RandomLaws:
        sources: dict[tuple[str, str], Source] = {}
        fields: dict[tuple[str, RandomField], DiscretisedField] = {}
        dropped = []
        for name, interface in problem.interfaces.items():
            consumed: set[str] = set()
            for target, (names, function) in interface.law.derived().items():
                values = interface.law.parameters()
                own = {key: values[key] for key in names if is_random(values[key])}
                if own:
                    fields_of = [key for key, value in own.items() if isinstance(value, RandomField)]
                    if fields_of:
                        raise SceneError(
                            f"interface {name!r}: {fields_of[0]} is a random field; give a random number"
                        )
                    sources[name, target] = Expression(
                        ByName(function, own), *own.values(), name=f"{name}.{target}"
                    )
                    consumed |= set(own)
            for parameter, value in interface.law.parameters().items():
                value = _number_in_time(interface.law, parameter, value)
                if not is_random(value) or parameter in consumed:
                    continue
                if not interface.law.matters(parameter):
                    dropped.append(f"{name}.{parameter}: the interface has no stiffness")
                    continue
                if isinstance(value, RandomField):
                    key = (name, value)
                    if key not in fields:
                        fields[key] = value.on(interface.points, interface.weights)
                    sources[name, parameter] = fields[key]
                else:
                    sources[name, parameter] = value
        loads: dict[LoadTerm, tuple[RandomParameter | Expression, ...]] = {}
        for term in problem.load_terms:
            found = [n.number for n in problem.numbers_of(term) if is_random(n.number)]
            if any(isinstance(each, RandomField) for each in found):
                raise SceneError(
                    f"load {term.load!r}: {term.parameter} is a random field; a load of a part takes random "
                    "numbers: give a Normal, LogNormal, ..."
                )
            if found:
                loads[term] = tuple(found)
        of_loads = [each for found in loads.values() for each in found]
        parts: dict[str, Source] = dict(problem.factors)
        for name, value in problem.fields.items():
            parts[name] = value.on(*problem.cells_of(name))
        space = RandomSpace([*sources.values(), *of_loads, *parts.values()])
        return cls(problem, sources, tuple(dropped), space, loads, parts)

    @property
    def every(self) -> list[Source]:
        """All random parameters and fields, of laws, loads and parts."""
        of_loads = (each for found in self.loads.values() for each in found)
        return [*self.sources.values(), *of_loads, *self.parts.values()]

    @property
    def scaled(self) -> list[str]:
        """Parts whose stiffness has a random factor."""
        return [name for name in self.parts if name not in self.fields]

    @property
    def fields(self) -> dict[str, DiscretisedField]:
        """Parts -> random field of their stiffness, relative to its mean."""
        return {name: s for name, s in self.parts.items() if isinstance(s, DiscretisedField)}

    @property
    def of_fields(self) -> list[DiscretisedField]:
        """All random fields, of laws and parts, each once."""
        every = dict.fromkeys((*self.sources.values(), *self.parts.values()))
        return [s for s in every if isinstance(s, DiscretisedField)]

    @property
    def lost(self) -> dict[str, float]:
        """Random fields -> the part of their variance that their modes do not hold."""
        return {s.name: 1.0 - s.captured for s in self.of_fields}

    def factors(self, part: str, points: Array, checked: bool = True) -> Array:
        """What the stiffness of a part is multiplied with at points (N, L) of the germs, (N,); of a field
        (N, cells).

        Raises
        ------
        SceneError
            A factor that is not positive.
        """
        source = self.parts.get(part)
        if source is None:
            return np.ones(len(points))
        field = isinstance(source, DiscretisedField)
        values: Array = np.atleast_2d(self.space.values(source, points))
        least = values.min(axis=0)
        if checked and not least.min() > 0.0:
            worst = int(least.argmin())
            at = ", ".join(
                f"{g} = {x:.4g}" for g, x in zip(self.space.germ_names, points[worst], strict=True)
            )
            raise SceneError(
                f"substructure {part!r}: {int((least <= 0.0).sum())} of {len(points)} samples give it a "
                f"stiffness that is not positive (smallest factor {least.min():.4g}, at the germs {at}): "
                f"{source!r} is no stiffness at this spread; use "
                + (
                    "distribution='lognormal' or a smaller cov"
                    if field
                    else "one that is positive: LogNormal, Gamma, Beta, Uniform or TruncatedNormal"
                )
            )
        return np.ascontiguousarray(values.T) if field else values.ravel()

    def load_values(self, term: LoadTerm, points: Array) -> Array:
        """A number of a load at points (N, L) of the germs, (N,); see :data:`OF_STIFFNESS`."""
        if term.load == OF_STIFFNESS:
            return self.factors(term.parameter, points, checked=False)  # samples were, when they were solved
        total: Array = np.zeros(len(points))
        for each in self.problem.numbers_of(term):
            number = each.number
            values = self.space.values(number, points) if is_random(number) else float(number)
            total += each.coefficient * np.reshape(values, -1)
        return total

    def load_coefficients(self, term: LoadTerm, basis: ChaosBasis) -> Array:
        """Chaos coefficients (P + 1,) of a number of a load; see :data:`OF_STIFFNESS`."""
        if term.load == OF_STIFFNESS:
            if term.parameter not in self.scaled:
                return np.asarray(np.eye(1, len(basis))[0])
            return np.asarray(self.space.coefficients(self.parts[term.parameter], basis)[0])
        total = np.zeros(len(basis))
        for each in self.problem.numbers_of(term):
            if is_random(each.number):
                total += each.coefficient * self.space.coefficients(each.number, basis)[0]
            else:
                total[0] += each.coefficient * float(each.number)
        return total

    @property
    def interfaces(self) -> tuple[str, ...]:
        """Interfaces with something random, in the scene's order."""
        return tuple(dict.fromkeys(name for name, _ in self.sources))

    def amplitude(self, interface: str, parameter: str) -> Amplitude | None:
        """What multiplies a random parameter of a law in time; None: it is constant."""
        value = self.problem.interfaces[interface].law.parameters().get(parameter)
        return value.terms[0][0] if isinstance(value, Varying) else None

    def source(self, interface: str, parameter: str) -> Source | None:
        """The random parameter of a law, or None if the value is fixed."""
        return self.sources.get((interface, parameter))

    def area_factor(self, interface: str, parameter: str) -> float:
        """What turns a value in the law's unit into one per area: 1, or 1 / area for a total stiffness."""
        each = self.problem.interfaces[interface]
        return each.law.per_area(parameter, each.area)

    def linear(self, interface: str) -> bool:
        """Whether the law of an interface is linear: chaos coefficients go through it exactly."""
        return self.problem.interfaces[interface].law.linear

    def make_laws(self, points: Array) -> bool:
        """Whether all random parameters make laws at points (N, L) of the germs, see :meth:`sampled`."""
        for part, source in self.parts.items():
            if not np.min(self.space.values(source, points)) > 0.0:
                return False
        return all(
            _makes_laws(self.problem.interfaces[name].law, parameter, self.space.values(source, points))
            for (name, parameter), source in self.sources.items()
        )

    def sampled(self, name: str, parameter: str, points: Array) -> SampledParameter:
        """A random parameter of an interface at points (N, L) of the germs, as the kernel takes it.

        Raises
        ------
        SceneError
            A value that makes no law: a negative stiffness, friction or threshold.
        """
        interface = self.problem.interfaces[name]
        source = self.sources[name, parameter]
        law = interface.law
        values = np.atleast_2d(self.space.values(source, points))
        self._check_sampled(name, parameter, source, values, points)
        kernel_name, unit, values = law.kernel_values(interface, parameter, values)
        if isinstance(source, DiscretisedField):
            # one row of values per point of the interface, spread over the rows of the parameter
            m = interface.num_points
            pattern = np.zeros((len(unit), m))
            pattern[np.arange(len(unit)), np.arange(len(unit)) // (len(unit) // m)] = unit[:, 0]
            unit = pattern
        return SampledParameter(kernel_name, unit, values)

    def check_drawn(self, name: str, parameter: str, points: Array) -> None:
        """Refuse samples (N, L) of the germs where what a derived parameter is made of makes no law.

        The force of a torque may hide that its friction is negative.

        Raises
        ------
        SceneError
            A negative value, with the interface and the sample.
        """
        law = self.problem.interfaces[name].law
        names, _ = law.derived().get(parameter, ((), None))
        for given in names:
            source: Any = law.parameters().get(given)
            if is_random(source):
                values = np.atleast_2d(self.space.values(source, points))
                self._check_sampled(name, given, source, values, points)

    def _check_sampled(self, name: str, parameter: str, source: Any, values: Array, points: Array) -> None:
        """Refuse values (1 or m, N) at points (N, L) of the germs that make no law."""
        if _makes_laws(self.problem.interfaces[name].law, parameter, values):
            return
        count = int((values < 0.0).any(axis=0).sum())
        worst = int(values.min(axis=0).argmin())
        at = ", ".join(f"{g} = {x:.4g}" for g, x in zip(self.space.germ_names, points[worst], strict=True))
        what = f"{parameter} stiffness" if parameter in ("normal", "tangential") else parameter
        raise SceneError(
            f"interface {name!r}: {count} of {len(points)} samples give it a negative {what} "
            f"(smallest {values.min():.4g}, at the germs {at}): {source!r} is not a law for it at this "
            "spread; use one that cannot be negative: LogNormal, Gamma, Beta, Uniform or TruncatedNormal"
        )

    def at(self, point: Array) -> dict[str, Law]:
        """The laws of one sample: interface -> law with numbers instead of random values.

        Parameters
        ----------
        point
            (L,) values of the germs.
        """
        xi = np.asarray(point, dtype=np.float64).reshape(1, -1)
        if xi.shape[1] != self.space.dimension:
            raise SceneError(
                f"a point has {xi.shape[1]} germs, the problem has {self.space.dimension}: "
                f"{', '.join(self.space.germ_names)}"
            )
        laws = {name: i.law for name, i in self.problem.interfaces.items()}
        for (name, parameter), source in self.sources.items():
            values = self.space.values(source, xi)
            value: Any = values[:, 0] if isinstance(source, DiscretisedField) else float(values[0])
            amplitude = self.amplitude(name, parameter)
            if amplitude is not None:
                value = amplitude * value
            laws[name] = laws[name].with_(**{parameter: value})
        return laws


def sampled_parameters(
    random: RandomLaws, name: str, points: Array, fields: Fields, steps: int = 1
) -> dict[str, Array]:
    """Kernel parameter -> (rows, N * steps) at points (N, L) of the germs, time steps fastest.

    A parameter that is the same everywhere has one column.

    Parameters
    ----------
    fields
        The law, with one column or one per time step.
    """
    values = {}
    for parameter, block in fields.parameters.items():
        values[parameter] = np.tile(block, (1, len(points))) if block.shape[1] > 1 else block
    for interface, parameter in random.sources:
        if interface == name:
            each = random.sampled(name, parameter, points)
            values[each.name] = np.repeat(each.pattern @ each.values, steps, axis=1)
    return {parameter: np.asfortranarray(block) for parameter, block in values.items()}


_FAR = np.array([5.0, 6.0])
"""Normal scores between which it is told how fast a tail falls."""


def warn_of_free_parts(where: str, random: RandomLaws) -> None:
    """Warn of stiffnesses that come so near 0, where they leave parts free, that these have no moments;
    collective.

    What moves over a stiffness is as large as its inverse. If the probability of a stiffness below x falls as
    x^n, the inverse has a mean where n > 1, and a standard deviation where n > 2.

    Warns
    -----
    SceneWarning
        Names the parameters, the parts and their free motions.
    """
    problem = random.problem
    near: dict[tuple[str, float], dict[tuple[str, str], float]] = {}
    for key, source in random.sources.items():
        law = problem.interfaces[key[0]].law
        if key[1] in law.spans and not isinstance(source, DiscretisedField) and len(source.leaves) == 1:
            for tail in (-1.0, 1.0):
                power = _falls_as(source, tail)
                if power <= 2.0 and _makes_laws(law, key[1], np.zeros(1)):
                    near.setdefault((next(iter(source.leaves)), tail), {})[key] = power
    for powers in near.values():
        now = problem.with_laws(values={f"{name}.{parameter}": 0.0 for name, parameter in powers})
        if not now.loosened:
            continue
        try:
            check_held(now)
        except SceneError as failure:
            which = " and ".join(f"{p} of interface {n!r} = {random.sources[n, p]!r}" for n, p in powers)
            what = "mean" if max(powers.values()) <= 1.0 else "standard deviation"
            warn(
                f"{where}: {which} comes so near 0 that what loads move over it has no {what}, which no "
                "chaos can tell: give it a lower bound above 0, or a law like LogNormal. At 0 there is an "
                f"{failure}",
                SceneWarning,
            )


def _falls_as(source: RandomParameter | Expression, tail: float) -> float:
    """The power of x as which the probability of values below x falls towards 0, to two digits; infinite: no
    values are near 0."""
    ((name, leaf),) = source.leaves.items()
    far, near = source.at({name: leaf.from_normal(tail * _FAR[::-1])})
    if far == 0.0 or not 0.0 < far < near:
        return 0.0 if far == 0.0 else np.inf
    rate = -np.subtract(*special.log_ndtr(-_FAR[::-1])) / np.log(near / far)
    return float(np.round(rate, 2))


def _number_in_time(law: Law, parameter: str, value: Any) -> Any:
    """The random number of an amplitude times one, of a parameter that loads; others as they are."""
    if isinstance(value, Varying) and parameter in law.loading and len(value.terms) == 1:
        return value.terms[0][1]
    return value


def _makes_laws(law: Law, parameter: str, values: Array) -> bool:
    """Whether a law can have all of these values: no negative stiffness, friction or threshold."""
    if parameter not in law.not_negative:
        return True
    smallest = values.min()
    return bool(smallest > 0.0 or (smallest == 0.0 and parameter not in law.inverse))
