"""Faults from outside: the library's calls are wrapped and counted, and at one of them something happens.

Nothing in the library knows of it. A *tick* is a moment before or after a call of the kernel, an iteration,
or a statement of a checkpoint's database.
"""

from __future__ import annotations

import errno
import os
import resource
import signal
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any
from unittest import mock

import latin_core
from dolfinx_frontend.kernel import running
from latin_core import checkpoint as checkpoints

CALLS = ("solve", "sweep", "laws", "displacements", "response_to", "local_fields", "resolve_samples")


class Injected(Exception):
    """An exception that nobody expects."""


class Clock:
    """Counts ticks; does something at one of them, and from then on what `also` says."""

    def __init__(self, at: int = -1, action: Callable[[str], None] | None = None) -> None:
        self.at, self.action, self.count, self.where = at, action, 0, ""

    def tick(self, where: str) -> None:
        self.count += 1
        if self.count - 1 == self.at and self.action is not None:
            self.where = where
            self.action(where)


def _wrapped(clock: Clock, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def call(*args: Any, **settings: Any) -> Any:
        clock.tick(f"before {name}")
        answer = function(*args, **settings)
        clock.tick(f"after {name}")
        return answer

    return call


@contextmanager
def ticking(clock: Clock) -> Iterator[None]:
    """The library with all its moments counted."""

    class Database(sqlite3.Connection):
        """A database whose statements tick."""

        def execute(self, *args: Any) -> Any:
            clock.tick("a statement")
            return super().execute(*args)

        def executemany(self, *args: Any) -> Any:
            clock.tick("before points are written")
            answer = super().executemany(*args)
            clock.tick("before points are committed")
            return answer

        def __exit__(self, *args: Any) -> Any:
            answer = super().__exit__(*args)
            clock.tick("after a transaction")
            return answer

    def connect(*args: Any, **settings: Any) -> Any:
        return connect_before(*args, **{"factory": Database, **settings})

    connect_before = sqlite3.connect
    watch_before = running.Interrupt.watch

    def watch(self: Any, callback: Any = None) -> Any:
        each = watch_before(self, callback)

        def iteration(what: Any) -> None:
            clock.tick("an iteration")
            each(what)

        return iteration

    with (
        mock.patch.multiple(
            latin_core.Structure,
            **{name: _wrapped(clock, name, getattr(latin_core.Structure, name)) for name in CALLS},
        ),
        mock.patch.object(running.Interrupt, "watch", watch),
        mock.patch.object(checkpoints.sqlite3, "connect", connect),
    ):
        yield


# --- what happens ---
def kill(where: str) -> None:
    """kill -9."""
    os.kill(os.getpid(), signal.SIGKILL)


def raising(kind: str) -> Callable[[str], None]:
    """An exception."""
    kinds: dict[str, Callable[[str], BaseException]] = {
        "memory": MemoryError,
        "keyboard": KeyboardInterrupt,
        "value": ValueError,
        "unknown": Injected,
    }

    def action(where: str) -> None:
        raise kinds[kind](f"injected {where}")

    return action


def pressing(times: int) -> Callable[[str], None]:
    """Ctrl-C, once or twice."""

    def action(where: str) -> None:
        for _ in range(times):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.002)

    return action


@contextmanager
def saving(clock: Clock) -> Iterator[None]:
    """The moments of a result that is saved."""
    from dolfinx_frontend.formats import hdf5

    import h5py

    with (
        mock.patch.object(h5py.Group, "create_dataset", _wrapped(clock, "data", h5py.Group.create_dataset)),
        mock.patch.object(hdf5, "seal", _wrapped(clock, "the checksum", hdf5.seal)),
        mock.patch.object(os, "fsync", _wrapped(clock, "the disk", os.fsync)),
        mock.patch.object(Path, "replace", _wrapped(clock, "the new name", Path.replace)),
    ):
        yield


@contextmanager
def limited(size: int) -> Iterator[None]:
    """No file may become larger than so many bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def telling(tell: Callable[[], None]) -> Iterator[None]:
    """Say after every write to a checkpoint that it is done."""
    before = checkpoints.Checkpoint._write

    def write(self: Any, patience: float) -> None:
        before(self, patience)
        tell()

    with mock.patch.object(checkpoints.Checkpoint, "_write", write):
        yield


@contextmanager
def failing_writes(kind: str, first: int, count: int, folder: Path) -> Iterator[None]:
    """Writes to a checkpoint fail from one on, for some times."""
    before = checkpoints.Checkpoint._write
    done, kept = [0], []
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def write(self: Any, patience: float) -> None:
        number, done[0] = done[0], done[0] + 1
        path = Path(self._file)
        if number == first and kind == "lock":
            held = sqlite3.connect(path)
            held.execute("begin immediate")
            kept.append(held)
        if number == first and kind == "removed":
            path.unlink()
        if number == first and kind == "folder":
            path.parent.rename(path.parent.with_name("away"))
        if number == first and kind == "size":
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 2000, hard))
        if number == first + count:
            undo()
        if first <= number < first + count:
            if kind == "full":
                raise sqlite3.OperationalError("database or disk is full")
            if kind == "read-only":
                raise OSError(errno.EROFS, "Read-only file system")
        before(self, 0.0)  # nobody else waits here

    def undo() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        while kept:
            kept.pop().close()
        away = folder.with_name("away")
        if away.exists():
            away.rename(folder)

    try:
        with mock.patch.object(checkpoints.Checkpoint, "_write", write):
            yield
    finally:
        undo()
