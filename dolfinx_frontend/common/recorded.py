"""Calls as they were made, so that what they made can be written down and made again."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, ParamSpec, Protocol, TypeVar, cast

from dolfinx_frontend.common.frozen import ReadOnlyDict, frozen

__all__ = ["Call", "Journal", "Journaled", "is_journaled", "journaled", "made_by", "mark", "recorded"]

P = ParamSpec("P")
R = TypeVar("R")

_MADE = "_made_by"
_JOURNALED = "_journaled"


class Call(NamedTuple):
    """A call: the name of what was called, and what was given, by keyword; defaults are left out."""

    name: str
    arguments: Mapping[str, Any]


class Journal:
    """The calls that made something, in order.

    Attributes
    ----------
    complete
        Whether nothing else has changed it in between.
    """

    def __init__(self, calls: tuple[Call, ...] = ()) -> None:
        self.calls = list(calls)
        self.complete = True
        self.known: Any = None
        self._inside = False

    def __iter__(self) -> Iterator[Call]:
        return iter(self.calls)

    def copy(self) -> Journal:
        """One of its own, for a copy of what it is of."""
        other = Journal(tuple(self.calls))
        other.complete, other.known = self.complete, self.known
        return other

    def compare(self, content: Any) -> None:
        """Notice what has changed since the last call without one."""
        self.complete = self.complete and (self.known is None or self.known == content)

    def run(self, of: Journaled, call: Call, function: Callable[[], R]) -> R:
        """Carry a call out and write it down, unless it is a part of another one."""
        if self._inside:
            return function()
        self.compare(of.in_journal())
        self._inside = True
        try:
            result = function()
        finally:
            self._inside = False
        self.calls.append(call)
        self.known = of.in_journal()
        return result


class Journaled(Protocol):
    """What keeps a journal of the calls of its methods."""

    @property
    def journal(self) -> Journal:
        """Its calls."""

    def in_journal(self) -> Any:
        """What tells its content from another one."""


M = TypeVar("M", bound=Callable[..., Any])


def _call(function: Callable[..., Any], signature: inspect.Signature, *given: Any, **named: Any) -> Call:
    """What is given as keywords; `**settings` are among them."""
    found: dict[str, Any] = {}
    for name, value in signature.bind(*given, **named).arguments.items():
        kind = signature.parameters[name].kind
        found |= value if kind is inspect.Parameter.VAR_KEYWORD else {name: value}
    return Call(function.__name__, ReadOnlyDict({key: frozen(value) for key, value in found.items()}))


def journaled(method: M) -> M:
    """A method whose calls are written down in the journal of the object."""
    signature = inspect.signature(method)

    @functools.wraps(method)
    def run(self: Journaled, /, *given: Any, **named: Any) -> Any:
        try:
            call = _call(method, signature, self, *given, **named)
        except TypeError:  # which the method says better
            return method(self, *given, **named)
        arguments = {key: value for key, value in call.arguments.items() if key != "self"}
        call = Call(call.name, ReadOnlyDict(arguments))
        return self.journal.run(self, call, lambda: method(self, *given, **named))

    setattr(run, _JOURNALED, True)
    return cast(M, run)


def is_journaled(method: Any) -> bool:
    """Whether the calls of a method are written down."""
    return bool(getattr(method, _JOURNALED, False))


def recorded(function: Callable[P, R]) -> Callable[P, R]:
    """A function whose results know the call that made them, see :func:`made_by`."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def run(*given: P.args, **named: P.kwargs) -> R:
        result = function(*given, **named)
        mark(result, _call(function, signature, *given, **named))
        return result

    return run


def mark(value: Any, call: Call) -> None:
    """Let a value know the call that made it."""
    object.__setattr__(value, _MADE, call)


def made_by(value: Any) -> Call | None:
    """The call that made a value; None: it is not known."""
    found = getattr(value, "__dict__", {}).get(_MADE)
    return found if isinstance(found, Call) else None
