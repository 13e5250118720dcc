"""Whether what several ranks were given is the same: digests by value that ranks can compare."""

from __future__ import annotations

import functools
import hashlib
import sys
import types
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["digest"]

_ELSEWHERE = ("ufl", "dolfinx", "basix", "petsc4py", "mpi4py", "scipy", "openturns")
"""Libraries whose objects have numbers and addresses of their own on every rank."""
_COMMON = (*_ELSEWHERE, "numpy", "dolfinx_frontend", "latin_core", "gmsh")


def digest(value: Any) -> str:
    """Digest of a value: numbers, arrays, records, containers; functions by code, closure and globals.

    It never fails, and equal values have equal digests. Objects of which only a library knows the content
    count by their kind: they are taken to be the same.
    """
    reader = _Reader()
    reader.feed(value)
    return reader.hash.hexdigest()[:24]


def _of_library(module: str | None) -> bool:
    """Whether something is of an installed library, which all ranks have in common."""
    top = (module or "").partition(".")[0]
    return top != "__main__" and (top in sys.stdlib_module_names or top in _COMMON)


def _names(code: types.CodeType) -> set[str]:
    """Names that a function and those inside it look up."""
    inside = [each for each in code.co_consts if isinstance(each, types.CodeType)]
    return {*code.co_names}.union(*map(_names, inside))


class _Reader:
    """Feeds values to a hash; what was met before counts by its number, so that circles end."""

    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self.seen: dict[int, int] = {}
        self.kept: list[Any] = []

    def say(self, *words: object) -> None:
        for word in words:
            data = word if isinstance(word, bytes) else repr(word).encode("utf-8", "backslashreplace")
            self.hash.update(b"%d:" % len(data) + data)

    def feed(self, value: Any) -> None:
        if value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
            self.say(value)
        elif isinstance(value, np.generic):
            self.say(value.item())
        elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
            self.say(value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes())
        elif id(value) in self.seen:
            self.say("seen", self.seen[id(value)])
        else:
            self.seen[id(value)] = len(self.seen)
            self.kept.append(value)  # so that its id stays its own
            self._compound(value)

    def _each(self, kind: str, values: Sequence[Any]) -> None:
        self.say(kind, len(values))
        for value in values:
            self.feed(value)

    def _compound(self, value: Any) -> None:
        kind = type(value).__qualname__
        if isinstance(value, np.ndarray):
            self._each("objects", value.ravel().tolist())
        elif isinstance(value, Mapping):
            self._each("dict", [part for item in value.items() for part in item])
        elif isinstance(value, Set):
            self.say(kind, *sorted(digest(each) for each in value))
        elif is_dataclass(value) and not isinstance(value, type):
            self._each(kind, [getattr(value, each.name) for each in fields(value)])
        elif hasattr(value, "_definition"):  # random variables: what makes two of them the same
            self._each(kind, [value._definition])
        elif isinstance(value, (list, tuple)):
            self._each(kind, value)
        elif isinstance(value, types.FunctionType):
            self._function(value)
        elif isinstance(value, types.MethodType):
            self._each("method", [value.__func__, value.__self__])
        elif isinstance(value, functools.partial):
            self._each("partial", [value.func, value.args, value.keywords])
        elif type(value).__module__.partition(".")[0] in _ELSEWHERE or isinstance(value, type):
            self.say(kind, getattr(value, "__qualname__", ""))
        else:
            self._each(kind, sorted(getattr(value, "__dict__", {}).items()))

    def _function(self, value: types.FunctionType) -> None:
        self.say("function", value.__module__, value.__qualname__)
        if _of_library(value.__module__):
            return
        self._code(value.__code__)
        for name in sorted(_names(value.__code__) & value.__globals__.keys()):
            found = value.__globals__[name]
            self.say("global", name)
            if not isinstance(found, types.ModuleType):
                self.feed(found)
        cells = []
        for cell in value.__closure__ or ():
            try:
                cells.append(cell.cell_contents)
            except ValueError:  # not set yet
                cells.append(None)
        self._each("encloses", [*(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).items(), *cells])

    def _code(self, code: types.CodeType) -> None:
        self.say(code.co_code, code.co_names)
        for each in code.co_consts:
            if isinstance(each, types.CodeType):
                self._code(each)
            else:
                self.feed(each)
