"""Keyword blocks of a deck: keyword, parameters and data lines, each with its file and line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import OBJECTS, opened
from dolfinx_frontend.decks.abaqus.keywords import IGNORED, REFUSED, REPRESENTED
from dolfinx_frontend.decks.fields import Where, Worded
from dolfinx_frontend.decks.lines import DeckError

__all__ = ["Card", "Note", "Row", "placed", "read_cards"]

_BYTES = 1 << 30
"""Size of a deck with all that it includes from which on it is refused, bytes."""

_FILES, _DEPTH = 10_000, 32
"""Files that a deck may include, and how deep."""

SPELLED = {"".join(keyword.split()): keyword for keyword in (*REPRESENTED, *IGNORED, *REFUSED)}
"""Keywords without their blanks, which some decks leave out."""


class Note(NamedTuple):
    """What became of a card: ``kind`` is "changed", "ignored" or "refused"."""

    kind: str
    keyword: str
    file: str
    line: int
    text: str


@contextmanager
def placed(where: Where, keyword: str) -> Iterator[None]:
    """Errors of a scene as those of a card."""
    try:
        yield
    except DeckError:
        raise
    except SceneError as error:
        raise DeckError(f"{where}: *{keyword}: {error}") from error


class Row(NamedTuple):
    """A data line: its words, without blanks around them."""

    where: Where
    words: list[str]


def _word(row: Row, k: int) -> str:
    return row.words[k] if k < len(row.words) else ""


@dataclass
class Card(Worded):
    """A keyword, upper case, its parameters (upper case; a flag has the value ""), and its data lines."""

    keyword: str
    where: Where
    parameters: dict[str, str] = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)

    def error(self, text: str, where: Where | None = None) -> DeckError:
        """The error of this card, to be raised; the line is that of the card or of one of its rows."""
        return DeckError(f"{where or self.where}: *{self.keyword}: {text}")

    def get(self, *names: str) -> str | None:
        """The first of some parameters that is given."""
        return next((self.parameters[n] for n in names if n in self.parameters), None)

    def need(self, *names: str) -> str:
        """The same, which has to be there and not empty."""
        found = self.get(*names)
        if not found:
            raise self.error(f"the parameter {' or '.join(names)} is missing; add {names[0]}=...")
        return found

    def number(self, row: Row, k: int, what: str, default: float | None = None) -> float:
        """Word k of a row as a finite number."""
        return self.real_of(_word(row, k), what, f"word {k + 1}", default, False, row.where)

    def whole(self, row: Row, k: int, what: str, least: int = 1, default: int | None = None) -> int:
        """Word k of a row as a whole number."""
        return self.whole_of(_word(row, k), what, f"word {k + 1}", default, least, row.where)

    def numbers(self, row: Row, count: int, what: str, start: int = 0) -> list[float]:
        """So many words from `start` on; those that are missing at the end are 0."""
        return [self.number(row, start + k, what, 0.0) for k in range(count)]

    def stream(self) -> tuple[list[str], list[Where]]:
        """All words of all rows one after the other, and where they are; empty ones at ends are left out."""
        words: list[str] = []
        places: list[Where] = []
        for row in self.rows:
            kept = row.words if row.words[-1] else row.words[:-1]
            words += kept
            places += [row.where] * len(kept)
        return words, places


class _Reader:
    """Lines of a deck and of what it includes."""

    def __init__(self, path: Path) -> None:
        self.root = Path(os.path.realpath(path)).parent
        self.size, self.files = 0, 0

    def lines(self, path: Path, asked: Where | None, depth: int = 0) -> Iterator[tuple[Where, str]]:
        """Lines with their places; includes are followed."""
        prefix = f"{asked}: *INCLUDE: " if asked else ""
        self.files += 1
        if depth > _DEPTH or self.files > _FILES:
            raise DeckError(f"{prefix}more than {_DEPTH} includes inside each other, or {_FILES} files: does "
                            "a file include itself? Take the include out")
        try:
            with opened(path, OBJECTS, DeckError) as file:
                self.size += os.fstat(file.fileno()).st_size
                if self.size > _BYTES:
                    raise DeckError(f"{prefix}the deck has more than {_BYTES >> 20} MB; divide it")
                content = file.read(_BYTES).decode("utf-8", errors="replace")
        except DeckError as error:
            said = str(error).removeprefix(prefix)
            raise DeckError(f"{prefix}{said}") from error
        except OSError as error:
            why = f"{path.name!r} cannot be read ({error.strerror}); check the name"
            raise DeckError(f"{prefix}{why}") from error
        name = path.name
        pending: tuple[Where, str] | None = None
        for number, line in enumerate(content.split("\n"), start=1):
            text = line.strip().strip("\r\0")
            if not text or text.startswith("**"):
                continue
            where = Where(name, number)
            if pending is not None:
                where, text, pending = pending[0], pending[1] + text, None
            if text.startswith("*") and text.endswith(","):
                pending = where, text
                continue
            yield from self._followed(where, text, depth)
        if pending is not None:
            yield from self._followed(pending[0], pending[1].rstrip(","), depth)

    def _followed(self, where: Where, text: str, depth: int) -> Iterator[tuple[Where, str]]:
        if text[:8].upper() != "*INCLUDE":
            yield where, text
            return
        card = _card(where, text, keep=True)
        yield from self.included(card, card.need("INPUT"), depth)

    def included(self, card: Card, name: str, depth: int = 0) -> Iterator[tuple[Where, str]]:
        """Lines of a file that a card names, which is below the folder of the deck."""
        if "\0" in name:
            raise card.error("a name of a file with a zero byte; correct it")
        path = Path(os.path.realpath(self.root / name))
        if not path.is_relative_to(self.root):
            raise card.error(f"{name!r} is outside of the folder of the deck; copy it there")
        yield from self.lines(path, card.where, depth + 1)


def _card(where: Where, text: str, keep: bool = False) -> Card:
    words = text[1:].split(",")
    keyword = SPELLED.get("".join(words[0].upper().split()), " ".join(words[0].upper().split()))
    parameters: dict[str, str] = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        value = value.strip().strip('"').strip("'")
        key = "".join(name.upper().split())
        if key:
            parameters[key] = value if keep or key in ("INPUT", "FILE") else value.upper()
    return Card(keyword, where, parameters)


def read_cards(path: Path) -> list[Card]:
    """All cards of a deck and of what it includes, in order.

    Raises
    ------
    DeckError
        A file cannot be read, data stand before the first keyword, includes leave the folder of the deck.
    """
    reader = _Reader(path)
    cards: list[Card] = []
    for where, text in reader.lines(path, None):
        if text.startswith("*"):
            card = _card(where, text)
            cards.append(card)
            if card.keyword in ("NODE", "ELEMENT", "NSET", "ELSET", "AMPLITUDE") and card.get("INPUT"):
                card.rows += [
                    _row(place, line) for place, line in reader.included(card, card.need("INPUT"))
                    if not line.startswith("*")
                ]
        elif not cards:
            raise DeckError(f"{where}: {text[:40]!r} stands before the first keyword; begin with *HEADING")
        else:
            cards[-1].rows.append(_row(where, text))
    if not cards:
        raise DeckError(f"{path.name}: there is no keyword in it; give an Abaqus or CalculiX deck")
    return cards


def _row(where: Where, text: str) -> Row:
    return Row(where, [word.strip().strip('"') for word in text.split(",")])
