"""TOML with its lines: the parser of the standard library tells no places, which messages need.

A *path* is a tuple of keys and, in arrays of tables, of numbers: ``("interface", "foot", "friction")``,
``("fix", 0, "faces")``.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import OBJECTS, opened, shown

__all__ = ["DeckError", "Lines", "Place", "Text", "read_text"]

Place = tuple[str | int, ...]
MOST_BYTES = 2**26
"""A deck is written by hand or by a program; what is larger is another file."""

_HEADER = re.compile(r"\s*(\[\[|\[)(.*?)\]{1,2}\s*(#.*)?$")
_AT_LINE = re.compile(r"\(at line (\d+), column \d+\)")


class DeckError(SceneError):
    """A deck that cannot be read as it is; the message begins with file and line.

    Attributes
    ----------
    notes
        What is refused, all of it, if that is the reason.
    """

    notes: tuple[Any, ...] = ()


class Lines:
    """Line of each key that is written at the beginning of one."""

    def __init__(self, text: str) -> None:
        self._of: dict[Place, int] = {(): 1}
        self._many: dict[Place, int] = {}
        table: Place = ()
        rows, k = text.splitlines(), 0
        while k < len(rows):
            first, row = k, rows[k]
            k += 1
            if not row.strip() or row.lstrip().startswith("#"):
                continue
            header = _HEADER.match(row)
            if header:
                table = self._header(header[1], header[2], first + 1)
                continue
            key = _key_of(row)
            if key is None:
                continue
            for n in range(1, len(key) + 1):
                self._of.setdefault((*table, *key[:n]), first + 1)
            # a value over several lines: the shortest text that the parser takes
            while k < len(rows) and not _whole("\n".join(rows[first:k])) and not _HEADER.match(rows[k]):
                k += 1

    def _header(self, brackets: str, name: str, line: int) -> Place:
        keys = _path(name)
        if keys is None:
            return ()
        table: Place = ()
        for n, key in enumerate(keys):
            table = (*table, key)
            last = n == len(keys) - 1
            if last and brackets == "[[":
                self._many[table] = self._many.get(table, -1) + 1
            self._of.setdefault(table, line)
            if table in self._many:
                table = (*table, self._many[table])
                self._of.setdefault(table, line)
        return table

    def at(self, place: Place) -> int:
        """The line of a key, or of what it is in."""
        while place not in self._of:
            place = place[:-1]
        return self._of[place]


def _path(key: str) -> tuple[str, ...] | None:
    """The keys of a dotted one."""
    try:
        found: Any = tomllib.loads(f"{key} = 0")
    except (tomllib.TOMLDecodeError, RecursionError):
        return None
    keys = []
    while isinstance(found, dict):
        if len(found) != 1:  # a comment, or several lines
            return None
        (name,) = found
        keys.append(name)
        found = found[name]
    return tuple(keys)


def _key_of(row: str) -> tuple[str, ...] | None:
    for place in (m.start() for m in re.finditer("=", row)):
        key = _path(row[:place])
        if key is not None:
            return key
    return None


def _whole(text: str) -> bool:
    try:
        tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError):
        return False
    return True


class Text:
    """A deck as it is written.

    Attributes
    ----------
    path
        The file.
    data
        What it says.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path, self._lines = path, None if not text else Lines(text)
        try:
            self.data: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            where = _AT_LINE.search(str(error))
            line = where[1] if where else str(len(text.splitlines()))
            why = _AT_LINE.sub("", str(error)).strip()
            raise DeckError(f"{path.name}:{line}: this is no TOML: {why}") from None
        except RecursionError:
            raise DeckError(f"{path.name}: it is nested too deeply") from None

    def line(self, place: Place) -> int:
        """The line of a key, or of what it is in."""
        return self._lines.at(place) if self._lines else 1

    def error(self, place: Place, message: str) -> DeckError:
        """An error that begins with file and line."""
        return DeckError(f"{self.path.name}:{self.line(place)}: {message}")

    def within(self, place: Place, message: str) -> DeckError:
        """The error of a whole table, at the line of the key whose name or value the message has."""
        table: Any = self.data
        for step in place:
            table = table[step]
        for key, value in table.items() if isinstance(table, Mapping) else ():
            if re.search(rf"\b{re.escape(key)}(\[\d+\])? (=|is) ", message):
                return self.error((*place, key), message)
            texts = value if isinstance(value, list) else [value]
            if any(isinstance(t, str) and t and repr(t) in message for t in texts) and key != "name":
                return self.error((*place, key), message)
            if any(isinstance(t, str) and t.count(":") == 1 and repr(t.split(":")[k]) in message
                   for t in texts for k in (0, 1)):
                return self.error((*place, key), message)
        return self.error(place, message)


def read_text(path: Path) -> Text:
    """A deck from its file.

    Raises
    ------
    DeckError
        No file, no text in UTF-8, no TOML; with the line.
    """
    try:
        with opened(path, OBJECTS, DeckError) as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise DeckError(f"{shown(path)} cannot be read: {error.strerror}") from None
    if len(content) > MOST_BYTES:
        raise DeckError(f"{path.name}: it has more than {MOST_BYTES >> 20} MB; a deck is a short text")
    try:
        return Text(path, content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DeckError(f"{path.name}:{line}: this is no text in UTF-8; save it as UTF-8") from None
