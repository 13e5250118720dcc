"""What a user wants to know of an assembly: the number whose error is asked about."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_callable,
    checked_name,
    checked_number,
    is_whole,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.uncertainty.statistics import Compared, Statistic

__all__ = [
    "Interest",
    "Measure",
    "Quantile",
    "Resultant",
    "Wanted",
    "asked",
    "interest",
    "over_all_ranks",
]

Of = Literal["force", "jump"]
_COMPONENTS = ("normal", "shear1", "shear2")


def _itself() -> Any:
    return field(default=Compared(), kw_only=True, repr=False, compare=False)


@dataclass(frozen=True)
class Resultant:
    """A number of one interface: its total force, or its mean jump, in one local direction.

    Attributes
    ----------
    interface
        Name.
    of
        ``"force"``: integral of the force per area on side 1 (force), or ``"jump"``: mean of
        w2 - w1 (length).
    component
        0 is normal (tension > 0), 1 and 2 are tangential, in the local frames of the points.
    compared
        What its errors are relative to; ``solve(..., absolute=, relative_to=)`` sets it.

    Raises
    ------
    SceneError
        A word or component that is not known.
    """

    interface: str
    of: Of = "force"
    component: int = 0
    compared: Compared = _itself()

    @property
    def needs_states(self) -> bool:
        """Whether samples must keep their states: force and jump are there without."""
        return False

    @property
    def statistic(self) -> Statistic:
        """What is asked of it where it is random: mean and deviation."""
        return Statistic(compared=self.compared)

    def __post_init__(self) -> None:
        checked_name("Resultant", self.interface)
        if not isinstance(self.of, str) or self.of not in get_args(Of):
            raise SceneError(
                f"interface {self.interface!r}: of={self.of!r} is not known, use 'force' or 'jump'"
            )
        if not is_whole(self.component) or self.component not in (0, 1, 2):
            raise SceneError(
                f"interface {self.interface!r}: component {self.component!r} must be 0 (normal), 1 or 2"
            )

    def __str__(self) -> str:
        what = "force" if self.of == "force" else "mean jump"
        return f"{_COMPONENTS[self.component]} {what} of {self.interface}"

    def field(self, source: Any) -> Array:
        """The field that is summed, (..., points, components): force or jump of a result or of samples."""
        read = source.force if self.of == "force" else source.jump
        return np.asarray(read(self.interface))

    def total(self, field: Array, weights: Array) -> Array:
        """The number from such a field, for each of its leading axes; `weights` are the areas (points,)."""
        if self.component >= field.shape[-1]:
            raise SceneError(
                f"interface {self.interface!r} carries {field.shape[-1]} component(s), not component "
                f"{self.component}"
            )
        total = field[..., self.component] @ weights
        return np.asarray(total if self.of == "force" else total / weights.sum())

    def at_end(self, answer: Any, fields: Any) -> Array:
        """The number (N,) in samples of an answer, of a history at its end; collective."""

        def read() -> Array:
            values = self.total(self.field(fields), answer.problem.interfaces[self.interface].weights)
            return values if answer.times is None else values[..., -1]

        found: Array = answer.everywhere(self.interface, read)
        return found

    def value(self, result: Any) -> Array:
        """The number in a result: (), (T,) of a history, (N,) of samples.

        Parameters
        ----------
        result
            Anything with ``problem``, ``force(interface)`` and ``jump(interface)``.
        """
        interfaces = result.problem.interfaces
        check_known("interface", self.interface, interfaces, "problem")
        weights = interfaces[self.interface].weights
        return self.total(self.field(result), weights)

    def everywhere(self, result: Any) -> Array:
        """The number in a result, on all ranks; collective."""
        found: Array = result.everywhere(self.interface, lambda: self.value(result))
        return found

    def sampled(self, result: Any) -> Array:
        """The number (N,) at samples of a chaos; collective."""
        return np.concatenate([self.at_end(result, block) for block in result.blocks()])


@dataclass(frozen=True)
class Measure:
    """A number that a function makes of the fields of an answer.

    The largest stress, a displacement at a point, the force of several bolts; or 1 where something happens
    and 0 elsewhere, whose mean is its probability.

    Attributes
    ----------
    function
        Takes the fields at n samples (:class:`Block`), returns (n,) values; it is called several times. Or a
        number of the tables by name: ``"joint.pressure_max"``, of a history at its end.
    name
        For tables and messages.
    compared
        What its errors are relative to; ``solve(..., absolute=, relative_to=)`` sets it.
    """

    function: Callable[[Any], Any] | str = field(repr=False)
    name: str = "quantity"
    compared: Compared = _itself()

    def __post_init__(self) -> None:
        wanted = "give a function of the fields of n samples that returns (n,) values, or 'interface.column'"
        if not (isinstance(self.function, str) and "." in self.function):
            checked_callable("Measure", "function", self.function, wanted)
        checked_name("Measure", self.name)

    @property
    def interface(self) -> str | None:
        """Interface that a number of the tables is of; None: it is a function."""
        return self.function.rpartition(".")[0] if isinstance(self.function, str) else None

    @property
    def needs_states(self) -> bool:
        """Whether samples must keep their states: the function may ask for displacements."""
        return True

    @property
    def statistic(self) -> Statistic:
        """What is asked of it where it is random: mean and deviation."""
        return Statistic(compared=self.compared)

    def __str__(self) -> str:
        return self.name

    def at_end(self, answer: Any, fields: Any) -> Array:
        """The number (N,) in samples; `fields` are the samples themselves. Collective."""
        function = self.function
        # one of a point is told by its rank without more
        if not isinstance(function, str) and not hasattr(function, "on"):
            function = over_all_ranks(function, answer.problem)
        return np.asarray(fields.quantity(function, self.name).values)

    def value(self, result: Any) -> Array:
        """The number in a result: (1,), (N,) of samples. A function reads what its rank has."""
        return np.asarray(result.quantity(self.function, self.name).values)

    def everywhere(self, result: Any) -> Array:
        """The same on all ranks, of all of which a function may read; collective."""
        return self.at_end(result, result)

    def sampled(self, result: Any) -> Array:
        """The number (N,) at samples of a chaos; collective."""
        return self.at_end(result, result)


class _Elsewhere(BaseException):
    """A function has asked for a field that is on another rank."""


def over_all_ranks(function: Callable[[Any], Any], problem: Any) -> Callable[[Any], Any]:
    """A function of the fields that all ranks call: those of other ranks are fetched when it asks.

    Where there is one rank it is the function.
    """
    if getattr(problem, "comm", None) is None:
        return function

    def called(block: Any) -> Any:
        known: dict[tuple[Any, ...], Any] = {}
        found: list[Any] = []

        def interface(kind: str) -> Callable[[str], Any]:
            def read(name: str) -> Any:
                key = (kind, name, None)
                if name not in problem.interfaces or name in problem.own.interfaces:
                    return getattr(block, kind)(name)
                if key not in known:
                    raise _Elsewhere(key)
                return known[key]

            return read

        def displacement(part: str, unknowns: Any = None) -> Any:
            some = None if unknowns is None else tuple(int(each) for each in unknowns)
            key = ("_displacement", part, some)
            if part not in problem.parts or part in problem.substructures:
                return block._displacement(part, unknowns)
            if key not in known:
                raise _Elsewhere(key)
            return known[key]

        def here(key: tuple[Any, ...]) -> bool:
            kind, name, _ = key
            return name in problem.substructures if kind == "_displacement" else problem.speaks_for(name)

        shown = replace(
            block,
            _both=interface("_both"),
            _contact=interface("_contact"),
            _force=None if block._force is None else interface("_force"),
            _displacement=displacement,
        )
        while True:
            wanted: list[Any] = []
            with agreement(problem.comm):
                found.clear()
                try:
                    found.append(function(shown))
                except _Elsewhere as missing:
                    wanted.append(missing.args[0])
            wanted = list(dict.fromkeys(key for each in exchanged(problem.comm, wanted) for key in each))
            if not wanted:
                return found[0]
            own = {}
            with agreement(problem.comm):
                for key in wanted:
                    if here(key):
                        kind, name, some = key
                        more = () if kind != "_displacement" else (None if some is None else np.array(some),)
                        own[key] = getattr(block, kind)(name, *more)
            for each in exchanged(problem.comm, own):
                known.update(each)

    return called


@dataclass(frozen=True, repr=False)
class Quantile:
    """The value that a quantity of a random answer is below with a probability.

    Attributes
    ----------
    of
        A :class:`Resultant`, a function of the fields, the name of an interface (its normal force), or a
        number of the tables by name (``"joint.pressure_max"``).
    level
        The probability, in (0, 1).
    compared
        What its errors are relative to; ``solve(..., absolute=, relative_to=)`` sets it.
    """

    of: Resultant | Measure | Callable[[Any], Any] | str
    level: float
    compared: Compared = _itself()

    def __post_init__(self) -> None:
        checked_number("Quantile", "level", self.level, above=0.0, below=1.0)
        wanted = "give a Resultant, a function of the fields, or the name of an interface"
        if not isinstance(self.of, Resultant | Measure | str):
            checked_callable("Quantile", "of", self.of, wanted)

    @property
    def needs_states(self) -> bool:
        """Whether samples must keep their states."""
        return self.inner.needs_states

    @property
    def interface(self) -> str | None:
        """Interface that the quantity is of; None: it is a function."""
        return self.inner.interface

    @property
    def statistic(self) -> Statistic:
        """What is asked of it where it is random: the quantile."""
        return Statistic(self.level, self.compared)

    def __repr__(self) -> str:
        return f"Quantile({self.inner}, {self.level:g})"

    @property
    def inner(self) -> Resultant | Measure:
        """The quantity that it is a value of."""
        if isinstance(self.of, str):
            return Resultant(self.of)
        return self.of if isinstance(self.of, Resultant | Measure) else measure(self.of)

    def __str__(self) -> str:
        return f"{100.0 * self.level:g} % quantile of {self.inner}"

    def at_end(self, answer: Any, fields: Any) -> Array:
        """The quantity (N,) in samples."""
        return self.inner.at_end(answer, fields)

    def everywhere(self, result: Any) -> Array:
        """The quantity in a result, on all ranks; collective."""
        return self.inner.everywhere(result)

    def sampled(self, result: Any) -> Array:
        """The quantity (N,) at samples of a chaos; collective."""
        return self.inner.sampled(result)


def measure(function: Callable[[Any], Any]) -> Measure:
    """A function of the fields as a quantity, by its own name."""
    return Measure(function, str(getattr(function, "__name__", "quantity")).strip("<>"))


Wanted: TypeAlias = Resultant | Measure | Quantile
"""A number whose error is asked about."""

Interest = Resultant | Measure | Quantile | Callable[[Any], Any] | str | None
"""A quantity of interest as users give it; a name: the normal force of that interface, or a number of the
tables (``"joint.pressure_max"``); a function: a :class:`Measure`."""


def asked(where: str, interfaces: Mapping[str, Any], quantity: Interest) -> Wanted:
    """The quantity that is meant, which is not the energy norm.

    Raises
    ------
    SceneError
        There is no such interface, or no quantity.
    """
    found = interest(interfaces, quantity)
    if found is None:
        raise SceneError(
            f"{where}: quantity = {quantity!r}; give a Resultant, the name of an interface, or a function"
        )
    return found


def interest(interfaces: Mapping[str, Any], quantity: Interest) -> Wanted | None:
    """The quantity that is meant; None: the energy norm.

    Raises
    ------
    SceneError
        There is no such interface.
    """
    if quantity is None or (isinstance(quantity, str) and quantity == "energy"):
        return None
    if isinstance(quantity, Quantile):
        of = interest(interfaces, quantity.of)
        assert of is not None and not isinstance(of, Quantile)
        return replace(quantity, of=of)
    if isinstance(quantity, str):
        return _named(interfaces, quantity)
    if callable(quantity):
        return measure(quantity)
    wanted = "give a Resultant, a function of the fields, the name of an interface, or 'energy'"
    check_kind("quantity of interest", "quantity", quantity, (Resultant, Measure), wanted)
    if quantity.interface is not None:
        check_known("interface", quantity.interface, interfaces, "quantity of interest")
    return quantity


def _named(interfaces: Mapping[str, Any], text: str) -> Resultant | Measure:
    """The normal force of an interface of this name, or a number of the tables: ``"joint.pressure_max"``."""
    name, _, column = text.rpartition(".")
    if text in interfaces or not column or not name:
        check_known("interface", text, interfaces, "quantity of interest")
        return Resultant(text)
    check_known("interface", name, interfaces, f"quantity of interest {text!r}")
    return Measure(text, text)
