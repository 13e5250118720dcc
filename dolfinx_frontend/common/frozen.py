"""Values that nobody changes later: copies of what a user gives, and arrays that cannot be written to."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NoReturn, Self, SupportsIndex, TypeVar

import numpy as np
import scipy.sparse as sp

__all__ = ["OneProcess", "frozen", "locked", "locked_matrix", "read_only"]

A = TypeVar("A", bound=np.ndarray[Any, Any])


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
        return {key: frozen(each) for key, each in value.items()}
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
    return tuple(map(_locked_value, value)) if type(value) is tuple else value


def locked(record: Any) -> None:
    """Make the arrays of a frozen dataclass read-only; for its ``__post_init__``."""
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(record, each.name, read_only(value))
        elif sp.issparse(value):
            object.__setattr__(record, each.name, locked_matrix(value))
        elif isinstance(value, dict):
            object.__setattr__(record, each.name, {key: _locked_value(v) for key, v in value.items()})


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
