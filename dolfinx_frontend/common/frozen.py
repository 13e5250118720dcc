"""Values that nobody changes later: copies of what a user gives, and arrays that cannot be written to."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from typing import Any, NoReturn, Self, SupportsIndex, TypeVar

import numpy as np

from dolfinx_frontend.common.deferred import sp

__all__ = ["OneProcess", "ReadOnlyDict", "by_value", "frozen", "locked", "locked_matrix", "read_only"]

A = TypeVar("A", bound=np.ndarray[Any, Any])
K = TypeVar("K")
V = TypeVar("V")


class ReadOnlyDict(dict[K, V]):
    """A dict that nobody changes; ``dict(it)`` is one to change. Unlike a mappingproxy it can be pickled."""

    def _refuse(self, *given: Any, **named: Any) -> NoReturn:
        raise TypeError("this dict is read-only: change a copy of it, dict(...)")

    __setitem__ = __delitem__ = _refuse
    __ior__ = _refuse  # type: ignore[assignment]
    clear = pop = popitem = setdefault = update = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (dict(self),))


def frozen(value: Any) -> Any:
    """A value with its arrays copied and read-only, its lists turned into tuples; all else as it is."""
    if isinstance(value, np.ndarray):
        if value.base is None and not value.flags.writeable:
            return value  # one of our own copies
        copy = value.copy()
        copy.setflags(write=False)
        return copy
    if type(value) in (list, tuple):
        return tuple(frozen(each) for each in value)
    if isinstance(value, Mapping):
        return ReadOnlyDict({key: frozen(each) for key, each in value.items()})
    return value


def read_only(values: A) -> A:
    """A view of an array that cannot be written to."""
    view = values.view()
    view.flags.writeable = False
    return view


def locked_matrix(matrix: sp.csr_matrix, own: bool = False) -> sp.csr_matrix:
    """A sparse matrix whose arrays cannot be written to: a copy, unless nobody else has it (`own`)."""
    if not matrix.data.flags.writeable:
        return matrix
    matrix = matrix if own else matrix.copy()
    matrix.sum_duplicates()  # SciPy does so in place when first asked for sorted indices
    for array in (matrix.data, matrix.indices, matrix.indptr):
        array.flags.writeable = False
    return matrix


def _locked_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return read_only(value)
    if isinstance(value, dict):
        return ReadOnlyDict({key: _locked_value(each) for key, each in value.items()})
    return tuple(map(_locked_value, value)) if type(value) is tuple else value


def locked(record: Any) -> None:
    """For the ``__post_init__`` of a frozen dataclass: arrays and dicts read-only."""
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if sp.issparse(value):
            object.__setattr__(record, each.name, locked_matrix(value))
        elif isinstance(value, (np.ndarray, dict)):
            object.__setattr__(record, each.name, _locked_value(value))


def by_value() -> bool:
    """Whether what asks for the content of an object can take functions by value, which pickle cannot."""
    frame = inspect.currentframe()
    while frame is not None:
        if {"cloudpickle", "dill", "codes"} & set(str(frame.f_globals.get("__name__")).split(".")):
            return True
        frame = frame.f_back
    return False


class OneProcess:
    """What never changes, so that a copy is the thing itself, and lives in the process that made it.

    `_instead` says what cannot leave the process, and what to do instead.
    """

    @property
    def _instead(self) -> str:
        return "it lives in this process"

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} cannot be pickled: {self._instead}")
