"""Numbers of an answer that one can calculate with, and events made of them.

``Response("joint") > -50.0`` happens where the normal force of an interface is above a value; ``&`` and
``|`` join events. A response may be compared with another one and with random numbers: ``stress >
LogNormal("yield", 240.0, cov=0.05)``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, Literal, Never

import numpy as np

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arithmetic import SIGNS, Arithmetic
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_known, checked_name, is_real, told_call
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import Block, one_number_a_sample, stepped
from dolfinx_frontend.results.readings import column_of
from dolfinx_frontend.results.resultant import Interest, Quantile, Wanted, asked, over_all_ranks
from dolfinx_frontend.uncertainty.expressions import Operand

__all__ = ["Event", "Response", "response"]

MOST_CUTS = 4096
"""Ways in which an event may happen."""

_Side = Literal["everywhere", "somewhere"]


class Response(Arithmetic):
    """A number of an answer: a total force, a jump, or what a function makes of its fields.

    Parameters
    ----------
    of
        The name of an interface (its normal force), a :class:`Resultant`, or a function of the fields of n
        samples (:class:`Block`) that returns (n,) values.
    name
        Shown in tables and messages; None: its own.

    Attributes
    ----------
    name
        How it is shown.

    Raises
    ------
    SceneError
        What is no number of an answer.
    """

    def __init__(self, of: Interest, name: str | None = None) -> None:
        if of is None or isinstance(of, Quantile) or not (
            isinstance(of, str) or callable(of) or hasattr(of, "at_end")
        ):
            raise SceneError(
                f"Response: of = {short(of)}; give the name of an interface, a Resultant, or a function of "
                "the fields"
            )
        self._of: Any = of
        self.name = checked_name("Response", name) if name is not None else _name_of(of)

    @classmethod
    def opening(cls, interface: str, where: _Side = "everywhere") -> Response:
        """How far a contact is from opening, length: > 0 where it is open, < 0 where it bears.

        Unlike the gap, which is zero as long as it is closed, and the force, which is zero as soon as it is
        open, it tells on both sides how far it is to the limit: closed points count by their pressure,
        divided by a constant stiffness, that of the contact and of the parts beside it in series.

        Parameters
        ----------
        where
            ``"everywhere"``: of the last point that bears; positive where the whole interface is open.
            ``"somewhere"``: of the first point that opens.
        """
        checked_name("Response.opening", interface)
        check_known("where", where, ("everywhere", "somewhere"), "Response.opening")
        made = cls(interface, f"opening of {interface} {where}")
        made._of = _Opening(interface, where)
        return made

    @property
    def readings(self) -> tuple[Response, ...]:
        """The numbers of the answer that it is made of."""
        return (self,)

    @property
    def random(self) -> tuple[Operand, ...]:
        """The random numbers in it beside those of the problem."""
        return ()

    def recipe(self) -> str:
        """All that it is made of, numbers with all their digits; functions by their names."""
        return self.name

    def check(self, problem: Problem) -> None:
        """Raise SceneError unless a problem has what is read."""
        if isinstance(self._of, _Opening):
            self._of.check(problem)
        else:
            asked(f"response {self.name!r}", problem.interfaces, self._of)

    def read(self, answer: Any) -> Array:
        """The number (N,) in samples of an answer, of a history at its end."""
        if isinstance(self._of, _Opening):
            return self._of.read(answer)
        wanted: Wanted = asked(f"response {self.name!r}", answer.problem.interfaces, self._of)
        if not hasattr(wanted, "function"):
            return np.asarray(wanted.at_end(answer, answer), dtype=np.float64)
        where = f"response {self.name!r}"
        function: Callable[[Block], Any] = (
            column_of(answer, wanted.function)
            if isinstance(wanted.function, str)
            else over_all_ranks(wanted.function, answer.problem)
        )
        blocks = answer.blocks()
        found = [one_number_a_sample(told_call(where, function, b), len(b), self.name) for b in blocks]
        return np.concatenate(found)

    def at(self, read: Mapping[int, Array], values: Mapping[str, Array]) -> Array:
        """Its value (N,).

        Parameters
        ----------
        read
            ``id`` of each of the `readings` -> (N,).
        values
            Name of each random number in it -> (N,).
        """
        return read[id(self)]

    def _with(self, function: Callable[..., Any], *operands: Any) -> Any:
        if all(is_real(each) or isinstance(each, Operand | Response) for each in operands):
            return _Combined(function, operands)
        return NotImplemented

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **settings: Any) -> Any:
        if method != "__call__" or settings or ufunc.nout != 1 or ufunc.signature is not None:
            return NotImplemented
        single = (x.item() if isinstance(x, np.ndarray) and x.ndim == 0 else x for x in inputs)
        return self._with(ufunc, *single)

    def _over(self, other: Any, sign: str, below: bool) -> Event:
        if not (is_real(other) and math.isfinite(other)) and not isinstance(other, Operand | Response):
            raise SceneError(
                f"event: {self.name} {sign} {short(other)}; compare with a finite number, another response "
                "or a "
                "random number"
            )
        shown = other.name if isinstance(other, Operand | Response) else f"{float(other):g}"
        margin = self - other if below else other - self
        return Event((margin,), ((0,),), f"{self.name} {sign} {shown}")

    def __gt__(self, other: Any) -> Event:
        return self._over(other, ">", below=False)

    def __ge__(self, other: Any) -> Event:
        return self._over(other, ">", below=False)

    def __lt__(self, other: Any) -> Event:
        return self._over(other, "<", below=True)

    def __le__(self, other: Any) -> Event:
        return self._over(other, "<", below=True)

    def __eq__(self, other: object) -> bool:
        if is_real(other):
            raise SceneError(f"event: {self.name} == {short(other)} never happens; compare with < or >")
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def __repr__(self) -> str:
        return f"Response({self.name})"


class _Combined(Response):
    """A function of responses and random numbers."""

    def __init__(self, function: Callable[..., Any], operands: tuple[Any, ...]) -> None:
        self._function, self._operands = function, operands
        names = [o.name if isinstance(o, Response | Operand) else f"{float(o):g}" for o in operands]
        sign = SIGNS.get(function)
        if sign is not None:
            pairs = zip(names, operands, strict=True)
            nested = (f"({n})" if isinstance(o, _Combined) else n for n, o in pairs)
            self.name = f" {sign} ".join(nested)
        elif function is operator.neg:
            self.name = f"-({names[0]})"
        else:
            self.name = f"{getattr(function, '__name__', 'function')}({', '.join(names)})"

    @property
    def readings(self) -> tuple[Response, ...]:
        every = (r for each in self._operands if isinstance(each, Response) for r in each.readings)
        return tuple({id(r): r for r in every}.values())

    @property
    def random(self) -> tuple[Operand, ...]:
        found: list[Operand] = []
        for each in self._operands:
            if isinstance(each, Response):
                found += each.random
            elif isinstance(each, Operand):
                found.append(each)
        return tuple(found)

    def recipe(self) -> str:
        parts = [
            each.recipe() if isinstance(each, Response)
            else repr(each) if isinstance(each, Operand) else float(each).hex()
            for each in self._operands
        ]  # fmt: skip
        return f"{getattr(self._function, '__name__', 'function')}({', '.join(parts)})"

    def check(self, problem: Problem) -> None:
        for each in self.readings:
            each.check(problem)

    def read(self, answer: Any) -> Array:
        if self.random:
            raise SceneError(f"response {self.name!r}: it depends on random numbers that the answer has not")
        return self.at({id(each): each.read(answer) for each in self.readings}, {})

    def at(self, read: Mapping[int, Array], values: Mapping[str, Array]) -> Array:
        given = []
        for each in self._operands:
            if isinstance(each, Response):
                given.append(each.at(read, values))
            else:
                given.append(each.at(values) if isinstance(each, Operand) else each)
        with np.errstate(all="ignore"):
            return np.asarray(self._function(*given), dtype=np.float64)


class _Opening:
    """Reads how far a contact is from opening, see :meth:`Response.opening`."""

    def __init__(self, interface: str, where: str) -> None:
        self.interface, self.where = interface, where

    def check(self, problem: Problem) -> None:
        where = "Response.opening"
        check_known("interface", self.interface, problem.interfaces, where)
        law = problem.interfaces[self.interface].law
        if not law.unilateral:
            raise SceneError(
                f"{where}: interface {self.interface!r}: {law.title} does not open; name a contact"
            )

    def read(self, answer: Any) -> Array:
        def here() -> Array:
            return np.concatenate([self._of(answer, block) for block in answer.blocks()])

        found: Array = answer.everywhere(self.interface, here)
        return found

    def _of(self, answer: Any, block: Block) -> Array:
        force, jump = (stepped(each, answer.times, 1) for each in block.both(self.interface))
        contact = block.contact(self.interface)
        if contact is None:
            raise SceneError(f"Response.opening: the clearance of {self.interface!r} is not known here")
        normal = force[:, -1, :, 0]
        gap = jump[:, -1, :, 0] + np.broadcast_to(contact.clearance, (*jump.shape[:2], jump.shape[2]))[:, -1]
        # pressures as lengths, by a constant that depends on nothing that is random: bodies and law in series
        interface = answer.problem.interfaces[self.interface]
        soft = float(np.mean(answer.solver.flexibility(self.interface)))
        soft += float(np.mean(interface.law.nominal.fields(interface).parameters.get("compliance", 0.0)))
        margin = np.where(normal < 0.0, soft * normal, np.maximum(gap, 0.0))
        # a mean beside the extreme would depend on the mesh: it is the point that decides
        return np.asarray(margin.min(axis=1) if self.where == "everywhere" else margin.max(axis=1))


class Event:
    """Something that may happen; made by comparing a :class:`Response`, and by ``&`` and ``|``.

    Attributes
    ----------
    conditions
        Responses, each negative where its condition holds.
    cuts
        The event is their union, each the intersection of some of the conditions, by number.
    name
        How it is written.
    """

    def __init__(self, conditions: Sequence[Response], cuts: Sequence[tuple[int, ...]], name: str) -> None:
        self.conditions, self.cuts, self.name = tuple(conditions), tuple(cuts), name

    @staticmethod
    def any(events: Iterable[Event] | Event) -> Event:
        """That one of some events happens at least."""
        several = _several("any", events)
        return _told(reduce(operator.or_, several), "any", several)

    @staticmethod
    def all(events: Iterable[Event] | Event) -> Event:
        """That some events happen together."""
        several = _several("all", events)
        return _told(reduce(operator.and_, several), "all", several)

    @property
    def random(self) -> tuple[Operand, ...]:
        """The random numbers in it beside those of the problem."""
        return tuple(r for each in self.conditions for r in each.random)

    def __or__(self, other: Any) -> Event:
        if not isinstance(other, Event):
            return NotImplemented
        conditions, numbers = self._with(other)
        cuts = dict.fromkeys([*self.cuts, *(tuple(sorted(numbers[i] for i in cut)) for cut in other.cuts)])
        return Event(conditions, tuple(cuts), f"({self.name}) or ({other.name})")

    def __and__(self, other: Any) -> Event:
        if not isinstance(other, Event):
            return NotImplemented
        if len(self.cuts) * len(other.cuts) > MOST_CUTS:
            raise SceneError(
                f"event: {len(self.cuts)} x {len(other.cuts)} ways in which it may happen, more than "
                f"{MOST_CUTS}; "
                "write it with a response that is the largest or smallest of several"
            )
        conditions, numbers = self._with(other)
        cuts = dict.fromkeys(
            tuple(sorted({*one, *(numbers[i] for i in two)})) for one in self.cuts for two in other.cuts
        )
        return Event(conditions, tuple(cuts), f"({self.name}) and ({other.name})")

    def _with(self, other: Event) -> tuple[tuple[Response, ...], list[int]]:
        """The conditions of both, and the numbers that those of the other have there."""
        known = {id(each): i for i, each in enumerate(self.conditions)}
        conditions = list(self.conditions)
        for each in other.conditions:
            if id(each) not in known:
                known[id(each)] = len(conditions)
                conditions.append(each)
        return tuple(conditions), [known[id(each)] for each in other.conditions]

    def __invert__(self) -> Event:
        """That it does not happen."""
        cuts: list[tuple[int, ...]] = [()]
        for cut in self.cuts:
            cuts = list(dict.fromkeys(tuple(sorted({*one, number})) for one in cuts for number in cut))
            if len(cuts) > MOST_CUTS:
                raise SceneError(f"event: more than {MOST_CUTS} ways in which {self.name} does not happen")
        return Event(tuple(-each for each in self.conditions), cuts, f"not ({self.name})")

    def __bool__(self) -> Never:
        raise SceneError(
            f"event {self.name}: it is neither true nor false; join events by & and |, in brackets, instead "
            "of "
            "'and', 'or' and a < b < c"
        )

    def __repr__(self) -> str:
        return f"Event({self.name})"


def _told(event: Event, word: str, events: list[Event]) -> Event:
    """The same with a name that stays short."""
    if len(events) < 2:
        return event
    ends = [events[0].name, "...", events[-1].name] if len(events) > 3 else [each.name for each in events]
    return Event(event.conditions, event.cuts, f"{word} of {len(events)}: {', '.join(ends)}")


def _several(what: str, events: Iterable[Event] | Event) -> list[Event]:
    wanted = "give events, as Response('joint') > 0.0"
    if not isinstance(events, Iterable):
        check_kind(f"Event.{what}", "events", events, Event, wanted)
    found = list(events) if isinstance(events, Iterable) else [events]
    for each in found:
        check_kind(f"Event.{what}", "event", each, Event, wanted)
    if not found:
        raise SceneError(f"Event.{what}: there is no event; give one at least")
    return found


def response(where: str, given: Any) -> Response:
    """A quantity of interest as a response."""
    if isinstance(given, Response):
        return given
    if given is None or (isinstance(given, str) and given == "energy"):
        wanted = "give a Resultant, a function, or the name of an interface"
        raise SceneError(f"{where}: quantity = {given!r}; {wanted}")
    return Response(given)


def _name_of(of: Any) -> str:
    if isinstance(of, str):
        return of if "." in of else f"normal force of {of}"
    if callable(of) and not hasattr(of, "at_end"):
        return str(getattr(of, "__name__", "quantity")).strip("<>")
    return str(of)
