"""Words of a card as numbers, with the place where they are: for Abaqus decks, Nastran files and matrices."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from dolfinx_frontend.decks.lines import DeckError

__all__ = ["Where", "Worded", "real"]

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d+))?")
_WHOLE = re.compile(r"[+-]?\d{1,12}")


class Where(NamedTuple):
    """A line of a file, counted from 1."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


def real(word: str, bare: bool = True) -> float | None:
    """A number as Fortran writes it, its exponent after E or D, `bare` after its sign; None: it is none."""
    found = _NUMBER.fullmatch(word)
    if found is None or (found[3] and not bare):
        return None
    return float(f"{found[1]}e{found[2] or found[3] or 0}")


class Worded:
    """A card whose words are read as numbers; the messages say which word is none."""

    def error(self, text: str, where: Where | None = None) -> DeckError:
        """The error of this card, to be raised."""
        raise NotImplementedError

    def real_of(
        self, word: str, what: str, place: str, default: float | None, bare: bool, where: Where | None = None
    ) -> float:
        """A word as a finite number; `what` it is, and its place in the line, are for the message."""
        if not word and default is not None:
            return default
        value = real(word, bare)
        if value is None or not math.isfinite(value):
            raise self.error(f"{what} = {word[:40]!r} ({place}) is no finite number; correct it", where)
        return value

    def whole_of(
        self, word: str, what: str, place: str, default: int | None, least: int, where: Where | None = None
    ) -> int:
        """A word as a whole number."""
        if not word and default is not None:
            return default
        if not _WHOLE.fullmatch(word) or int(word) < least:
            said = f"{what} = {word[:40]!r} ({place}) is no whole number >= {least}; correct it"
            raise self.error(said, where)
        return int(word)
