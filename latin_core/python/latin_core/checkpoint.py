"""Checkpoint file of a long run: one SQLite database, one transaction a finished point.

A point is either in the file whole or not at all, whatever kills the run, and appending costs the
size of the point, not of the file.
"""

from __future__ import annotations

import hashlib
import io
import json
import sqlite3
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Checkpoint", "CheckpointError"]

_VERSION = 2
_DIGEST = hashlib.sha256().digest_size


def _digest(number: int, arrays: bytes) -> bytes:
    """Checksum of a point: the database itself does not notice a changed number or byte."""
    return hashlib.sha256(b"%d:" % number + arrays).digest()


class CheckpointError(ValueError):
    """The file cannot be used: not a checkpoint, damaged, of another version or of another run."""


class Checkpoint:
    """Finished points of one run.

    Parameters
    ----------
    path
        File to create, or to continue.
    header
        What the run is (JSON-able). A file with another header belongs to another run and is
        refused, untouched.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any]) -> None:
        self.path = Path(path)
        mine = json.dumps({"version": _VERSION, **header}, sort_keys=True)
        if not self.path.parent.is_dir():
            raise CheckpointError(
                f"checkpoint {self.path}: folder {self.path.parent} does not exist: make it first"
            )
        try:
            theirs = self._open(mine)
        except (sqlite3.Error, UnicodeDecodeError, OverflowError, OSError) as error:
            raise CheckpointError(
                f"checkpoint {self.path} cannot be read ({error}): move it away to start from the beginning"
            ) from error
        if theirs != mine:
            self._db.close()
            raise CheckpointError(
                f"checkpoint {self.path} belongs to another run or version: give another file "
                f"name, or move it away\n  in the file: {theirs[:300]}\n"
                f"  this run:    {mine[:300]}"
            )

    def _open(self, mine: str) -> str:
        """Connect to the file and return its header; a new one is given mine."""
        if self.path.exists() and self.path.stat().st_size > 0:
            with self.path.open("rb") as file:
                if file.read(16) != b"SQLite format 3\x00":
                    raise sqlite3.DatabaseError("not a checkpoint file")
        self._db = sqlite3.connect(self.path)
        try:
            if self._db.execute("select count(*) from sqlite_master").fetchone() == (0,):
                with self._db:
                    self._db.execute("begin")  # all of it or nothing
                    self._db.execute("create table header (text text)")
                    self._db.execute(
                        "create table point (number integer primary key, arrays blob)"
                    )
                    self._db.execute("insert into header values (?)", (mine,))
            if self._db.execute("pragma quick_check").fetchone() != ("ok",):
                raise sqlite3.DatabaseError("damaged")
            row = self._db.execute("select text from header").fetchone()
            if row is None:
                raise sqlite3.DatabaseError("not a checkpoint file")
            return str(row[0])
        except (sqlite3.Error, UnicodeDecodeError, OverflowError):
            self._db.close()
            raise

    def append(self, number: int, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Write one finished point; when this returns, it is on the disk."""
        buffer = io.BytesIO()
        named: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
        np.savez(buffer, **named)
        blob = buffer.getvalue()
        with self._db:
            self._db.execute(
                "insert or replace into point values (?, ?)", (number, _digest(number, blob) + blob)
            )

    def __iter__(self) -> Iterator[tuple[int, dict[str, npt.NDArray[Any]]]]:
        """Finished points as (number, arrays), by number."""
        query = "select number, arrays from point order by number"
        try:
            for number, stored in self._db.execute(query):
                digest, blob = bytes(stored[:_DIGEST]), bytes(stored[_DIGEST:])
                if digest != _digest(number, blob):
                    raise ValueError(f"point {number}: its checksum is another one")
                with np.load(io.BytesIO(blob), allow_pickle=False) as arrays:
                    point = dict(arrays)
                yield number, point
        except (
            sqlite3.Error,
            zipfile.BadZipFile,
            ValueError,  # UnicodeDecodeError, too
            TypeError,
            OverflowError,
            OSError,
            EOFError,
        ) as error:
            raise CheckpointError(
                f"checkpoint {self.path} is damaged ({error}): move it away to start from the beginning"
            ) from error

    def __repr__(self) -> str:
        return f"Checkpoint({str(self.path)!r})"

    def close(self) -> None:
        """Release the file."""
        self._db.close()
