"""Whether what several ranks were given is the same: digests by value that ranks can compare."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.common.codes import Reader
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Told", "described", "difference", "digest"]

_ELSEWHERE = ("ufl", "dolfinx", "basix", "petsc4py", "mpi4py", "scipy", "openturns", "gmsh")
"""Libraries whose objects have numbers and addresses of their own on every rank."""


def digest(value: Any) -> str:
    """Digest of a value: numbers, arrays, records, containers; functions by code, closure and globals.

    It never fails, and equal values have equal digests. Objects of which only a library knows the content
    count by their kind: they are taken to be the same.
    """
    reader = _Lenient({})
    reader.feed(value, "")
    return reader.digest.hexdigest()[:24]


class Told(NamedTuple):
    """A value for other ranks."""

    digest: str
    text: str  # a line of it


def described(value: Any) -> dict[str, Told]:
    """A value, under an empty name, and what it is made of: the fields of a record, and what functions refer
    to (``"force, its variable 'R'"``)."""
    reader = _Parts({})
    if is_dataclass(value) and not isinstance(value, type):
        for each in fields(value):
            reader.feed(getattr(value, each.name), each.name)
    else:
        reader.feed(value, "")
    return {"": Told(digest(value), _words(value)), **reader.parts}


def difference(one: dict[str, Told], other: dict[str, Told]) -> tuple[str, str]:
    """What differs in two values, in the words of each: the smallest part of which that is known."""
    found = [name for name in one if name and name in other and one[name].digest != other[name].digest]
    name = next((n for n in found if not any(each.startswith(f"{n}, ") for each in found)), "")
    owner = name.rpartition(", its ")[0]
    inside = f" in {one[owner].text}" if owner != name and owner in one and ", its " in name else ""
    which = f"{name.removeprefix(', ')} = " if name else ""
    first, second = (f"{which}{each[name].text}{inside}" for each in (one, other))
    return first, second if second != first else f"{second}, of other content,"


def _words(value: Any) -> str:
    """A value in a line; a function by its place, for its address differs anyhow."""
    if isinstance(value, FunctionType):
        code = value.__code__
        return f"<function {value.__name__}, line {code.co_firstlineno} of {Path(code.co_filename).name}>"
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."


class _Lenient(Reader):
    """Where a checkpoint refuses what it cannot tell apart, ranks take it to be the same."""

    def feed(self, value: Any, where: str) -> None:
        kind = type(value)
        if kind.__module__.partition(".")[0] in _ELSEWHERE:
            self.say(kind.__qualname__, getattr(value, "__qualname__", ""))
        elif isinstance(value, np.generic):
            self.feed(value.item(), where)
        elif hasattr(value, "_definition"):  # random variables: what makes two of them the same
            self.say(kind.__qualname__)
            self.feed(value._definition, where)
        elif is_dataclass(value) and not isinstance(value, type) and id(value) not in self.seen:
            self.number(value)
            self.say(kind.__qualname__)
            for each in fields(value):
                self.feed(getattr(value, each.name), where)
        else:
            try:
                super().feed(value, where)
            except SceneError:
                self.say(kind.__qualname__)


class _Parts(_Lenient):
    """Notes what it was led to, by the way there."""

    def __init__(self, known: Any) -> None:
        super().__init__(known)
        self.parts: dict[str, Told] = {}

    def feed(self, value: Any, where: str) -> None:
        if where not in self.parts:
            self.parts[where] = Told(digest(value), _words(value))
        super().feed(value, where)
