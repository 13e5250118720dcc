"""One thread at a time in PETSc and its solvers, which keep state of the whole process."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = ["PETSC", "alone"]

P = ParamSpec("P")
T = TypeVar("T")

PETSC = threading.RLock()
"""Held while PETSc objects are made, and while the kernel works with them."""


def alone(function: Callable[P, T]) -> Callable[P, T]:
    """A function that waits until no other thread is in PETSc."""

    @wraps(function)
    def waiting(*args: P.args, **settings: P.kwargs) -> T:
        with PETSC:
            return function(*args, **settings)

    return waiting
