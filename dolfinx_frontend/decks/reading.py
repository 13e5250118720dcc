"""Which reader reads which file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dolfinx_frontend.common.checks import checked_flag, checked_path
from dolfinx_frontend.decks import toml
from dolfinx_frontend.decks.abaqus.deck import InpDeck, read_inp
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.nastran.deck import read_bdf
from dolfinx_frontend.decks.settings import Deck

__all__ = ["READERS", "read_deck"]


def _inp(path: Path, allow_code: bool) -> Deck:
    """A deck of Abaqus or CalculiX, which names no code."""
    return _foreign(path, read_inp(path))


def _bdf(path: Path, allow_code: bool) -> Deck:
    """A file of Nastran, which names no code."""
    return _foreign(path, read_bdf(path))


def _foreign(path: Path, deck: InpDeck) -> Deck:
    run = {} if deck.times is None else {"times": [float(t) for t in deck.times]}
    notes = tuple(f"{n.file}:{n.line}: *{n.keyword} {n.kind}: {n.text}" for n in deck.notes)
    return Deck(deck.scene(), run=run, title=deck.name, path=path, notes=notes)


READERS: dict[str, Callable[[Path, bool], Deck]] = {
    ".bdf": _bdf, ".dat": _bdf, ".nas": _bdf, ".inp": _inp, ".toml": toml.read,
}
"""Suffix of a file -> its reader, which takes the path and whether code may be executed."""


def read_deck(path: str | Path, allow_code: bool = False) -> Deck:
    """The scene that a deck describes, how it is to be run, and what is asked.

    Parameters
    ----------
    path
        The file; its suffix says what it is. Files that it names are beside it.
    allow_code
        Whether functions that it names, ``"module:function"``, are imported: this executes their modules,
        also those in the folder of the deck. Only for decks that you trust.

    Returns
    -------
    Deck
        With the meshes of all parts.

    Raises
    ------
    SceneError
        What cannot be read, with line, value and the nearest right word.
    """
    file = checked_path("read_deck", path)
    checked_flag("read_deck", "allow_code", allow_code)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise DeckError(f"{file.name}: a deck ends with {' or '.join(READERS)}, not with {file.suffix!r}")
    return reader(file, allow_code)
