"""Cards of bulk data: small, large and free fields, with continuations, each with its file and line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.files import OBJECTS, opened
from dolfinx_frontend.decks.fields import Where, Worded
from dolfinx_frontend.decks.lines import DeckError

__all__ = ["BulkCard", "bulk_cards", "grids", "text_lines"]

_SMALL, _LARGE = 8, 16


@dataclass
class BulkCard(Worded):
    """A card: its name, upper case, without the star of large fields, and what is in its fields after
    that."""

    name: str
    where: Where
    fields: list[str] = field(default_factory=list)

    def error(self, text: str, where: Where | None = None) -> DeckError:
        """The error of this card, to be raised."""
        return DeckError(f"{where or self.where}: {self.name}: {text}")

    def text(self, k: int) -> str:
        """Field k after the name, from 0; empty if it is not there."""
        return self.fields[k] if k < len(self.fields) else ""

    def real(self, k: int, what: str, default: float | None = None) -> float:
        """A field as a finite number, also without the E of its exponent."""
        return self.real_of(self.text(k), what, f"field {k + 2}", default, True)

    def whole(self, k: int, what: str, least: int = 1, default: int | None = None) -> int:
        """A field as a whole number."""
        return self.whole_of(self.text(k), what, f"field {k + 2}", default, least)


def text_lines(path: Path) -> Iterator[tuple[Where, str]]:
    """Lines of a file, with their places.

    Raises
    ------
    DeckError
        No file, or no text.
    """
    try:
        with opened(path, OBJECTS, DeckError) as file:
            content = file.read()
    except OSError as error:
        raise DeckError(f"{path.name} cannot be read: {error.strerror}") from None
    if b"\0" in content:
        raise DeckError(f"{path.name}: this is no text; a binary file is not read: have it written as text")
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), 1):
        yield Where(path.name, number), line


def bulk_cards(lines: Iterable[tuple[Where, str]]) -> Iterator[BulkCard]:
    """The cards of some lines; what is before BEGIN BULK is left out by the caller.

    Raises
    ------
    DeckError
        A continuation of nothing.
    """
    card: BulkCard | None = None
    for where, line in lines:
        row = line.partition("$")[0].expandtabs(_SMALL).rstrip()
        if not row.strip():
            continue
        name, fields = _fields(row)
        if name and name[0] not in "+*":
            if card is not None:
                yield card
            if name.strip().upper() == "ENDDATA":
                return
            card = BulkCard(name.rstrip("*").strip().upper(), where)
        elif card is None:
            raise DeckError(f"{where}: a continuation of nothing: {row[:40]!r}")
        card.fields += fields
    if card is not None:
        yield card


def _fields(row: str) -> tuple[str, list[str]]:
    """The first field of a line, and those that count after it: eight, or four large ones."""
    if "," in row:
        words = [word.strip() for word in row.split(",")]
        count = 4 if "*" in words[0] else 8
        return words[0], (words[1 : count + 1] + [""] * count)[:count]
    name = row[:_SMALL].strip()
    width = _LARGE if "*" in name else _SMALL
    count = 64 // width
    row = row.ljust(80)
    return name, [row[_SMALL + k * width : _SMALL + (k + 1) * width].strip() for k in range(count)]


def grids(cards: Iterable[BulkCard]) -> dict[int, Array]:
    """Number -> coordinates (3,) of the GRID cards among some.

    Raises
    ------
    DeckError
        Coordinates or displacements in a system of their own.
    """
    found: dict[int, Array] = {}
    for card in cards:
        if card.name != "GRID":
            continue
        for k, what in ((1, "CP"), (5, "CD")):
            if card.text(k) not in ("", "0"):
                raise card.error(f"{what} = {card.text(k)}: coordinate systems are not read; give points=")
        number = card.whole(0, "the number")
        if number in found:
            raise card.error(f"the number {number} is in use")
        found[number] = np.array([card.real(k, "a coordinate", 0.0) for k in (2, 3, 4)])
    return found
