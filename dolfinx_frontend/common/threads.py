"""One thread at a time in PETSc and its solvers, which keep state of the whole process."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from mpi4py import MPI

__all__ = ["PETSC", "alone", "own_threads"]

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


def own_threads() -> int:
    """Threads that this rank may use: its share of the cores, or ``OMP_NUM_THREADS`` if that is less."""
    cores = max(len(os.sched_getaffinity(0)) // MPI.COMM_WORLD.size, 1)
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return min(cores, max(int(asked), 1)) if asked.isdigit() else cores
