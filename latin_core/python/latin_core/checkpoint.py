"""Checkpoint file of a long run: one SQLite database, one transaction a finished point.

A point is either in the file whole or not at all, whatever kills the run, and appending costs the
size of the point, not of the file. A file that cannot be written while the run goes on (a full disk,
a lock, a removed folder) does not end the run: its points wait in memory, and every next one tries again.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import logging
import math
import os
import re
import sqlite3
import stat
import struct
import sys
import threading
import uuid
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

__all__ = [
    "Checkpoint",
    "CheckpointError",
    "CheckpointWarning",
    "PointFile",
    "differences",
    "edited",
    "wrong_array",
]

_VERSION = 5
_DIGEST = hashlib.sha256().digest_size
_MAGIC = b"SQLite format 3\x00"
_JOURNAL_OF_SEVERAL = bytes.fromhex("d9d505f920a163d7")
"""End of a journal that names another file, which SQLite deletes; a database that is alone has none such."""
_SCHEMA = {
    "header": "CREATE TABLE header (text text)",
    "point": "CREATE TABLE point (number integer primary key, arrays blob)",
}
"""Name of a table -> how it was made: all that is in the database."""
_ARRAY = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '([<>|][biufcU]\d{1,6})', 'fortran_order': (True|False), "
    rb"'shape': \(([0-9, ]*)\), \} *\n",
    re.DOTALL,
)
"""Beginning of an array of numbers or texts as numpy writes it: its type, order and shape."""
_SAME = 1e-10
"""Difference up to which two numbers of a header are the same: another order of summation is no other run."""
_PATIENCE = 5.0
"""Seconds to wait for a database that another program has locked, before it is said."""
_LOCK_BYTE = 0x40000000 + 4096
"""Where the lock of a running sweep lies: beside the bytes that SQLite locks for moments."""

_log = logging.getLogger(__name__)
_in_use: set[tuple[int, int] | None] = set()
_in_use_guard = threading.Lock()


def _digest(number: int, arrays: bytes, run: str = "") -> bytes:
    """Checksum of a point of a run (its header): the database itself does not notice a changed number or
    byte, or the point of another problem."""
    return hashlib.sha256(b"%d:" % number + run.encode() + arrays).digest()


def _unpacked(blob: bytes) -> dict[str, npt.NDArray[Any]]:
    """The arrays that :func:`numpy.savez` packed, which take no more memory than they have bytes.

    Raises
    ------
    ValueError
        They are compressed, or one has not the bytes that it claims, or Python objects.
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    with zipfile.ZipFile(io.BytesIO(blob)) as file:
        entries = file.infolist()
        if any(each.compress_type != zipfile.ZIP_STORED for each in entries):
            raise ValueError("its arrays are compressed")
        if sum(each.file_size for each in entries) > len(blob):
            raise ValueError("its arrays are larger than it is")
        for entry in entries:
            data = file.read(entry)
            head = _ARRAY.match(data)
            if head is None:
                raise ValueError(f"{entry.filename!r} is no array of numbers or texts")
            kind, content = np.dtype(head[1].decode()), bytearray(data[head.end() :])
            shape = tuple(int(each) for each in head[3].replace(b",", b" ").split())
            if not kind.itemsize or math.prod(shape) * kind.itemsize != len(content):
                raise ValueError(f"{entry.filename!r} has not the numbers that it claims")
            order: Literal["F", "C"] = "F" if head[2] == b"True" else "C"
            arrays[entry.filename.removesuffix(".npy")] = np.ndarray(shape, kind, content, order=order)
    return arrays


class CheckpointError(ValueError):
    """The file cannot be used: not a checkpoint, damaged, in use, of another version or of another run."""


class CheckpointWarning(UserWarning):
    """Finished points could not be written to the file of a run, which goes on without."""


def _same(one: Any, other: Any) -> bool:
    """Whether two facts of a header agree; numbers to ten digits, or to 1e-10 where they are below 1."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if type(one) is float and type(other) is float:
        return one == other or abs(one - other) <= _SAME * max(1.0, abs(one), abs(other))
    return type(one) is type(other) and bool(one == other)


def _told(name: str, theirs: Mapping[str, Any], mine: Mapping[str, Any]) -> str:
    """A fact in which two headers differ, with its values if they are short."""

    def value_of(facts: Mapping[str, Any]) -> str:
        value = facts[name] if name in facts else None
        return "none" if value is None else str(value)

    values = value_of(theirs), value_of(mine)
    plain = all(isinstance(facts.get(name), (str, int, float, type(None))) for facts in (theirs, mine))
    if plain and max(map(len, values)) <= 32 and not name.startswith("code"):
        return f"{name} (in the file {values[0]}, in this run {values[1]})"
    return name


def differences(theirs: Mapping[str, Any], mine: Mapping[str, Any]) -> list[str]:
    """Names of the facts in which two runs differ, with short values; floats agree to ten digits."""
    names = list(mine) + [name for name in theirs if name not in mine]
    return [
        _told(name, theirs, mine)
        for name in names
        if name not in theirs or name not in mine or not _same(theirs[name], mine[name])
    ]


def wrong_array(arrays: Mapping[str, Any], name: str, kinds: str, shape: tuple[int, ...] | None) -> str:
    """What is wrong with an array of a point, by its name; empty: nothing.

    Parameters
    ----------
    kinds
        Kinds of numbers (``dtype.kind``) that it may have.
    shape
        That is wanted; None: any.
    """
    if name not in arrays:
        return f"{name!r} is missing"
    found = arrays[name]
    if found.dtype.kind not in kinds:
        return f"{name!r} is of type {found.dtype}, {'a text' if kinds == 'U' else 'numbers'} wanted"
    if shape is not None and found.shape != shape:
        return f"{name!r} has shape {found.shape}, {shape} wanted"
    return ""


def _shown(path: Path) -> str:
    """A name for messages, in one line and in the order of its characters."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def edited(path: Path, number: int, wrong: str) -> CheckpointError:
    """What a point says whose checksum is right and whose arrays are not."""
    return CheckpointError(
        f"checkpoint {_shown(path)} was edited: point {number}: {wrong}: move it away to start from the "
        "beginning"
    )


def _busy(error: BaseException) -> bool:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    return code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


class PointFile(Protocol):
    """What a run keeps its finished points in: a :class:`Checkpoint`, or one that ranks share."""

    path: Path

    def __iter__(self) -> Iterator[tuple[int, dict[str, npt.NDArray[Any]]]]:
        """Finished points as (number, arrays)."""

    def agreement(self) -> contextlib.AbstractContextManager[None]:
        """Where what is read is looked at: if it is wrong on one rank, all raise."""

    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write one finished point."""

    def close(self) -> None:
        """Release the file."""


class Checkpoint:
    """Finished points of one run.

    Parameters
    ----------
    path
        File to create, or to continue.
    header
        What the run is (JSON-able): facts by name, which are named if they differ. A file with
        another header belongs to another run and is refused, untouched. Floats agree to ten digits.
    more
        Facts that are lists, of which the file may have more than `header`.

    Raises
    ------
    CheckpointError
        The file cannot be opened, is damaged, used by another run at this time, or of another run.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any], more: Sequence[str] = ()) -> None:
        self.path = Path(path)
        self._shown = _shown(self.path)
        self._file = os.path.abspath(self.path)
        self._waiting: dict[int, bytes] = {}
        self._warned = False
        self._descriptor = -1
        self._key: tuple[int, int] | None = None
        self._db: Any = None
        self._run = ""
        if self.path.name == ":memory:":
            raise CheckpointError("checkpoint ':memory:' would be gone with the run: give the name of a file")
        if str(path).lower().startswith("file:"):
            raise CheckpointError(f"checkpoint {str(path)!r} is an address: give the name of a file")
        if self.path.is_symlink() and os.path.islink(os.path.realpath(self.path)):
            raise CheckpointError(
                f"checkpoint {self._shown} is a link that leads back to itself: give the name of a file"
            )
        if not self.path.parent.is_dir():
            raise CheckpointError(
                f"checkpoint {self._shown}: folder {self.path.parent} does not exist: make it first"
            )
        mine = json.loads(json.dumps({"version": _VERSION, **header}))
        try:
            theirs = self._open(mine)
        except (sqlite3.Error, ValueError, OverflowError, OSError, RecursionError) as error:
            self._release()
            raise self._refusal(error, "cannot be read") from error
        except BaseException:
            self._release()
            raise
        lacking: dict[str, list[Any]] = {}
        for name in more:
            if isinstance(theirs.get(name), list) and isinstance(mine.get(name), list):
                lacking[name] = [each for each in mine[name] if each not in theirs[name]]
                if not lacking[name]:
                    theirs[name] = mine[name]
        different = [
            f"{name} (the file lacks {', '.join(map(repr, lacking[name]))})" if lacking.get(name) else name
            for name in differences(theirs, mine)
        ]
        if different:
            self._release()
            if theirs.get("version") != _VERSION:
                different = different[:1]  # the facts of another version have other names
            more = f", and {len(different) - 6} more" if len(different) > 6 else ""
            raise CheckpointError(
                f"checkpoint {self._shown} belongs to another run or version, they differ in: "
                f"{'; '.join(different[:6])}{more}: give another file name, or move it away"
            )

    # --- opening and closing ---
    def _refusal(self, error: Exception, what: str) -> CheckpointError:
        """What a failure to read the file is told as."""
        if isinstance(error, CheckpointError):
            return error
        if _busy(error):
            return CheckpointError(
                f"checkpoint {self._shown} is locked by another program ({error}): close that, or wait"
            )
        return CheckpointError(
            f"checkpoint {self._shown} {what} ({error}): move it away to start from the beginning"
        )

    def _open(self, mine: Mapping[str, Any]) -> dict[str, Any]:
        """Connect to the file and return its header; a new one is given mine."""
        made = not os.path.exists(self._file)
        try:
            self._claim(made)
            self._db = self._connected()
            if not self._has_tables():
                with self._db:
                    self._db.execute("begin")  # all of it or nothing
                    for statement in _SCHEMA.values():
                        self._db.execute(statement)
                    text = json.dumps(mine)
                    self._db.execute("insert into header values (?)", (text,))
            if self._db.execute("pragma quick_check").fetchone() != ("ok",):
                raise sqlite3.DatabaseError("damaged")
            row = self._db.execute("select text from header").fetchone()
        except BaseException:
            if made and self._key is not None:  # nothing but what was made here a moment ago
                with contextlib.suppress(OSError):
                    os.unlink(self._file)
            raise
        if row is None:
            raise sqlite3.DatabaseError("not a checkpoint file")
        self._run = str(row[0])
        theirs = json.loads(self._run)
        if not isinstance(theirs, dict):
            raise sqlite3.DatabaseError("not a checkpoint file")
        return theirs

    def _connected(self) -> sqlite3.Connection:
        """The database, unless SQLite would first end a transaction over several files: it deletes one that
        the journal of such names."""
        beside = f"{os.path.realpath(self._file)}-journal"
        if os.path.isfile(beside):
            with open(beside, "rb") as journal:
                journal.seek(-min(len(_JOURNAL_OF_SEVERAL), os.path.getsize(beside)), os.SEEK_END)
                if journal.read() == _JOURNAL_OF_SEVERAL:
                    raise CheckpointError(
                        f"checkpoint {self._shown} has a journal beside it, {beside}, that names another "
                        "file, as those of no run do: move both away"
                    )
        return sqlite3.connect(self._file, timeout=_PATIENCE, check_same_thread=False)

    def _has_tables(self) -> bool:
        """Whether it is a checkpoint, or empty; the database of another program is refused.

        A trigger, a view or an index would run whatever it says with the first statement that meets it: the
        database has the two tables, as they are made here, and nothing else.
        """
        rows = self._db.execute("select name, type, sql from sqlite_master order by name").fetchall()
        if rows and rows != [(name, "table", statement) for name, statement in _SCHEMA.items()]:
            names = [repr(name) if kind == "table" else f"{kind} {name!r}" for name, kind, _ in rows]
            told = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
            raise CheckpointError(
                f"checkpoint {self._shown} is a database of another program (its tables: {told}): give "
                "another file name"
            )
        return bool(rows)

    def _claim(self, made: bool) -> None:
        """Open the file and mark it as in use, in this process and for others.

        One descriptor for all that is done besides SQLite: closing any other one of the same file would
        drop SQLite's own locks.
        """
        with _in_use_guard:
            if not made:
                status = os.stat(self._file)
                # what the system makes up (/proc, /sys) says that it is a file, lies on no disk, and may wait
                made_up = not status.st_blocks and not os.statvfs(self._file).f_blocks
                if not stat.S_ISREG(status.st_mode) or made_up:
                    raise CheckpointError(
                        f"checkpoint {self._shown} is a folder, a pipe, a socket or a device, or made up by "
                        "the system: give the name of a file"
                    )
                if (status.st_dev, status.st_ino) in _in_use:
                    raise self._used("in this program")
            try:
                self._descriptor = os.open(self._file, os.O_RDWR | os.O_CREAT, 0o666)
            except OSError as error:
                if made:
                    raise CheckpointError(
                        f"checkpoint {self._shown} cannot be written ({error}): choose a folder that is "
                        "writable and has room"
                    ) from error
                if not isinstance(error, PermissionError) and error.errno != errno.EROFS:
                    raise
                self._descriptor = os.open(self._file, os.O_RDONLY)
            status = os.fstat(self._descriptor)
            self._key = (status.st_dev, status.st_ino)
            _in_use.add(self._key)
        self._lock()
        if status.st_size > 0 and os.pread(self._descriptor, len(_MAGIC), 0) != _MAGIC:
            raise sqlite3.DatabaseError("not a checkpoint file")

    def _used(self, where: str) -> CheckpointError:
        return CheckpointError(
            f"checkpoint {self._shown} is in use by another run {where}: wait for its end, or give another "
            "file name"
        )

    def _lock(self) -> None:
        """Keep other processes out until this one ends, however it ends; where there are locks."""
        if sys.platform != "linux":
            return
        import fcntl

        wanted = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, _LOCK_BYTE, 1, 0)
        try:
            fcntl.fcntl(self._descriptor, fcntl.F_OFD_SETLK, wanted)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                with _in_use_guard:
                    _in_use.discard(self._key)
                self._key = None
                raise self._used("of another program") from error

    def _release(self) -> None:
        self._drop(self._db, self._descriptor, self._key)
        self._db, self._descriptor, self._key = None, -1, None

    @staticmethod
    def _drop(db: Any, descriptor: int, key: tuple[int, int] | None) -> None:
        if db is not None:
            with contextlib.suppress(sqlite3.Error):
                db.close()
        if descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(descriptor)
        with _in_use_guard:
            _in_use.discard(key)

    # --- writing ---
    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write one finished point; when this returns, it is on the disk.

        If it cannot be written it waits in memory, with one warning for the run; the next calls and
        :meth:`close` try again.
        """
        buffer = io.BytesIO()
        named: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
        np.savez(buffer, **named)
        blob = buffer.getvalue()
        self._waiting[number] = _digest(number, blob, self._run) + blob
        self._try(_PATIENCE if not self._warned else 0.0)

    def _try(self, patience: float) -> None:
        try:
            self._write(patience)
        except (sqlite3.Error, OSError) as error:
            if not self._warned:
                self._warned = True
                why = "another program has locked it" if _busy(error) else error
                warnings.warn(
                    f"checkpoint {self._shown} cannot be written ({why}): the run goes on, its points are "
                    "kept in memory, and writing is tried again",
                    CheckpointWarning,
                    stacklevel=3,
                )
        else:
            if self._warned:
                self._warned = False
                _log.info("checkpoint %s can be written again, all finished points are in it", self.path)

    def _write(self, patience: float) -> None:
        """All that waits, in one transaction."""
        self._find_again()
        self._db.execute(f"pragma busy_timeout = {int(1000 * patience)}")
        with self._db:
            points = list(self._waiting.items())
            self._db.executemany("insert or replace into point values (?, ?)", points)
        self._waiting.clear()

    def _find_again(self) -> None:
        """Make the file anew, with all its points, if somebody has removed it."""
        try:
            status = os.stat(self._file)
        except FileNotFoundError:
            pass
        else:
            if (status.st_dev, status.st_ino) != self._key:
                raise OSError(errno.EEXIST, "another file has taken its place")
            return
        new = os.path.join(os.path.dirname(self._file), f".{uuid.uuid4().hex}")
        try:
            os.close(os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))
            with contextlib.closing(sqlite3.connect(new)) as copy:
                self._db.backup(copy)  # the removed file can be read as long as it is open
            os.link(new, self._file)  # unlike a replacement, takes no other file's place
        finally:
            with contextlib.suppress(OSError):
                os.unlink(new)
        before = self._db, self._descriptor, self._key
        try:
            self._claim(False)
            self._db = self._connected()
        except BaseException:
            new_one = self._descriptor if self._descriptor != before[1] else -1
            self._drop(None, new_one, self._key if self._key != before[2] else None)
            self._db, self._descriptor, self._key = before
            raise
        self._drop(*before)
        _log.warning("checkpoint %s was removed while the run goes on: it is there again, whole", self.path)

    # --- reading ---
    def __iter__(self) -> Iterator[tuple[int, dict[str, npt.NDArray[Any]]]]:
        """Finished points as (number, arrays), by number."""
        query = "select number, arrays from point order by number"
        try:
            for number, stored in self._db.execute(query):
                digest, blob = bytes(stored[:_DIGEST]), bytes(stored[_DIGEST:])
                if digest != _digest(number, blob, self._run):
                    raise ValueError(f"point {number}: its checksum is another one")
                yield number, _unpacked(blob)
        except (
            sqlite3.Error,
            zipfile.BadZipFile,
            ValueError,  # UnicodeDecodeError, too
            TypeError,
            OverflowError,
            OSError,
            EOFError,
            MemoryError,
            NotImplementedError,
        ) as error:
            raise self._refusal(error, "is damaged") from error

    def agreement(self) -> contextlib.AbstractContextManager[None]:
        """There is one rank: nothing to agree on."""
        return contextlib.nullcontext()

    def __repr__(self) -> str:
        return f"Checkpoint({str(self.path)!r})"

    def close(self) -> None:
        """Write what waits, if that is possible now, and release the file."""
        try:
            if self._waiting:
                self._try(_PATIENCE)
            if self._waiting:
                text = "checkpoint %s lacks %d points that could not be written; they are in the result"
                _log.warning(text, self.path, len(self._waiting))
        finally:
            self._release()
