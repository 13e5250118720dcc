"""Whether what several ranks were given is the same: digests by value that ranks can compare."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.codes import Reader
from dolfinx_frontend.common.errors import SceneError

__all__ = ["digest"]

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
