"""Loads of parts: what acts inside a part or on one of its faces without an interface, as written.

A load is a sum of shapes, each times a number: its parameters. The numbers may be random, swept, or change in
time (an amplitude times a number), the shapes are assembled once: a load is a column of the right-hand side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import ufl

from dolfinx_frontend.common.checks import check_known, checked_numbers, is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict, frozen
from dolfinx_frontend.scene.amplitudes import Amplitude, Combination, Varying
from dolfinx_frontend.scene.values import Parameter, is_plain, is_uncertain

__all__ = [
    "AXES",
    "MOMENTS",
    "OF_STIFFNESS",
    "Load",
    "LoadTerm",
    "Term",
    "components",
    "is_field",
    "plain_vector",
    "point_forces",
    "scattered",
    "shaped",
]

AXES = ("x", "y", "z")
OF_STIFFNESS = ""
"""In place of the name of a load: its parameter is a part, its number a factor of the part's stiffness."""
MOMENTS = ("mx", "my", "mz")


class LoadTerm(NamedTuple):
    """A number of a load, and the amplitude that multiplies it in time (None: 1)."""

    load: str
    parameter: str
    amplitude: Amplitude | None


class Term(NamedTuple):
    """One summand of a value: amplitude * coefficient * number."""

    amplitude: Amplitude | None
    coefficient: float
    number: Any

    @property
    def mean(self) -> float:
        """Coefficient times the number, of a random one times its mean."""
        number = self.number if is_plain(self.number) else self.number.mean
        return self.coefficient * float(number)


@dataclass(frozen=True, repr=False)
class Load:
    """A load of a part; see :meth:`Scene.load` and what follows it.

    Attributes
    ----------
    name, part
        Its name, and that of the part.
    kind
        How its shapes are assembled.
    values
        Parameter -> its number: plain, random or an amplitude times one.
    shapes
        Parameter -> what a number 1 stands for.
    face
        Of the part; empty: it acts inside.
    """

    name: str
    part: str
    kind: str
    values: Mapping[str, Any]
    shapes: Mapping[str, Any] = field(repr=False)
    face: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", ReadOnlyDict({k: frozen(v) for k, v in self.values.items()}))
        object.__setattr__(self, "shapes", ReadOnlyDict({k: frozen(v) for k, v in self.shapes.items()}))
        for parameter, value in self.values.items():
            self.check_value(parameter, value)

    def __repr__(self) -> str:
        given = ", ".join(f"{k}={short(v)}" for k, v in self.values.items())
        where = f"{self.part}:{self.face}" if self.face else self.part
        return f"Load({self.name!r}, {self.kind} of {where!r}, {given})"

    @property
    def where(self) -> str:
        """For messages."""
        return f"load {self.name!r}"

    def check_value(self, parameter: str, value: Any) -> None:
        """Refuse what is no number, random number, or amplitude times one."""
        if isinstance(value, Amplitude):
            raise SceneError(
                f"{self.where}: {parameter} is an amplitude; multiply it by a value, e.g. by 1.0"
            )
        numbers = [n for _, n in value.terms] if isinstance(value, (Varying, Combination)) else [value]
        for number in numbers:
            if is_real(number) and np.isfinite(float(number)):
                continue
            if is_uncertain(number):
                continue
            raise SceneError(
                f"{self.where}: {parameter} = {short(number)}; give a finite number, a random number, or an "
                "Amplitude times one"
            )

    def terms(self, parameter: str) -> list[Term]:
        """What a number is the sum of."""
        value = self.values[parameter]
        if isinstance(value, Varying):
            return [Term(amplitude, 1.0, number) for amplitude, number in value.terms]
        if isinstance(value, Combination):
            return [Term(None, coefficient, number) for coefficient, number in value.terms]
        return [Term(None, 1.0, value)]

    @property
    def amplitudes(self) -> list[Amplitude | None]:
        """Of all its numbers, that are not 0."""
        terms = [t for p in self.values for t in self.terms(p)]
        return [t.amplitude for t in terms if not (is_plain(t.number) and t.mean == 0.0)]

    def at(self, time: float) -> Load:
        """The load at a time of a history."""
        varying = {k: v.at(time) for k, v in self.values.items() if isinstance(v, Varying)}
        return self.with_values(varying) if varying else self

    def with_values(self, values: Mapping[str, Any]) -> Load:
        """The load with other numbers.

        Raises
        ------
        SceneError
            Unknown parameter or inadmissible number.
        """
        for key in values:
            check_known("parameter", key, self.values, self.where)
        return Load(self.name, self.part, self.kind, {**self.values, **values}, self.shapes, self.face)


def is_field(value: Any) -> bool:
    """Whether a value varies from point to point: a UFL expression or a callable of the points."""
    if isinstance(value, ufl.core.expr.Expr):
        return True
    return callable(value) and not isinstance(value, (Amplitude, Parameter))


def scattered(value: Any) -> bool:
    """Whether a value has components of its own that are random or change in time, or is a random number
    times an amplitude: what no law takes."""

    if isinstance(value, Varying):
        numbers = [each for _, v in value.terms for each in (v if isinstance(v, (list, tuple)) else (v,))]
        return any(map(is_uncertain, numbers))
    return isinstance(value, (list, tuple)) and any(is_uncertain(v) or isinstance(v, Varying) for v in value)


def shaped(where: str, value: Any, number: str, unit: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters and shapes of a value that is a number (times the shape `unit`) or a field.

    Returns
    -------
    tuple
        parameter -> number, parameter -> shape.
    """
    if isinstance(value, Varying):
        fields = [(a, v) for a, v in value.terms if is_field(v)]
        numbers = tuple((a, v) for a, v in value.terms if not is_field(v))
    else:
        alone: tuple[Amplitude | None, Any] = (None, value)
        fields, numbers = ([alone], ()) if is_field(value) else ([], (alone,))
    values: dict[str, Any] = {}
    shapes: dict[str, Any] = {}
    if numbers:
        values[number] = Varying(numbers) if isinstance(value, Varying) else numbers[0][1]
        shapes[number] = unit
    for k, (amplitude, each) in enumerate(fields):
        name = "factor" if k == 0 else f"factor{k + 1}"
        values[name] = 1.0 if amplitude is None else amplitude * 1.0
        shapes[name] = each
    return values, shapes


def components(
    where: str, what: str, value: Any, names: Sequence[str] = AXES, count: int | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters and shapes of a vector: a number per component, of which there are `count`, or a field."""
    terms = value.terms if isinstance(value, Varying) else ((None, value),)
    vectors = [(a, v) for a, v in terms if not is_field(v)]
    fields = [(a, v) for a, v in terms if is_field(v)]
    values: dict[str, Any] = {}
    shapes: dict[str, Any] = {}
    wanted = "give one number per axis"
    lengths = set()
    for _, vector in vectors:
        if isinstance(vector, np.ndarray):
            checked_numbers(where, what, vector, wanted, dimensions=1)
        elif not isinstance(vector, (list, tuple)):
            raise SceneError(f"{where}: {what} = {short(vector)}; {wanted}")
        lengths.add(len(vector))
    if len(lengths) > 1 or (lengths and not lengths <= {1, 2, 3}):
        raise SceneError(f"{where}: {what} = {short(value)}; {wanted}")
    if count is not None and lengths and lengths != {count}:
        raise SceneError(
            f"{where}: {what} = {short(value)} has {lengths.pop()} component(s); give {count}, one per axis"
        )
    for k in range(lengths.pop() if lengths else 0):
        parts = tuple((a, v[k]) for a, v in vectors)
        values[names[k]] = Varying(parts) if isinstance(value, Varying) else parts[0][1]
        shapes[names[k]] = k
    for k, (amplitude, each) in enumerate(fields):
        name = "factor" if k == 0 else f"factor{k + 1}"
        values[name] = 1.0 if amplitude is None else amplitude * 1.0
        shapes[name] = each
    return values, shapes


def point_forces(where: str, points: Any, forces: Any, count: int | None) -> tuple[Any, Any]:
    """Points and the forces at them, both (n, d) plain numbers."""
    shape = np.shape(points)
    if shape[0] == 0 or shape != np.shape(forces) or (count is not None and shape[1] != count):
        wanted = f"(n, {count or 'd'})"
        raise SceneError(
            f"{where}: points of shape {shape} and forces of shape {np.shape(forces)}; give both as {wanted}"
        )
    wanted = "give finite numbers"
    first = checked_numbers(where, "point", points, wanted, dimensions=2)
    return frozen(first), frozen(checked_numbers(where, "force", forces, wanted, dimensions=2))


def plain_vector(where: str, what: str, value: Any) -> Any:
    """A point or direction: 2 or 3 plain numbers, (d,)."""
    wanted = "give 2 or 3 finite numbers"
    vector = checked_numbers(where, what, value, wanted, dimensions=1)
    if len(vector) not in (2, 3):
        raise SceneError(f"{where}: {what} = {short(value)}; {wanted}")
    return frozen(vector)
