"""Exceptions and warnings of the frontend; messages name the thing, the value and a remedy."""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType
from typing import Any

__all__ = [
    "BalanceError",
    "MemoryLimitError",
    "SceneError",
    "SceneWarning",
    "of_user",
    "telling",
    "unknown_name",
    "warn",
]

_NOT_THE_USER = ("dolfinx_frontend", "latin_core", "contextlib", "functools")


class SceneError(ValueError):
    """A scene that cannot be modelled as it was described."""


class BalanceError(SceneError):
    """Loads that no forces of the interfaces balance, at the points that these have.

    Attributes
    ----------
    step
        Of a load history the first step with such loads, else 0.
    answer
        The result of a history of which earlier steps converged, else None.
    """

    step: int = 0
    answer: Any = None


class MemoryLimitError(SceneError, MemoryError):
    """What was asked for takes more memory than there is."""

    @classmethod
    def of(cls, message: str, cause: Exception) -> SceneError:
        """A SceneError with this message, of this kind if its cause is the memory."""
        return cls(message) if isinstance(cause, MemoryError) else SceneError(message)


class SceneWarning(UserWarning):
    """A scene that can be modelled, but probably not in the way that was intended."""


def unknown_name(kind: str, name: Any, known: Iterable[str], where: str = "") -> SceneError:
    """Error for a name that does not exist, with the nearest ones that do.

    Parameters
    ----------
    kind
        The kind of thing that is named, e.g. ``"part"``.
    name
        The name that was given; what is no string is said to be none.
    known
        The names that exist.
    where
        Where it was given, e.g. ``"interface 'joint'"``.

    Returns
    -------
    SceneError
        To be raised by the caller.
    """
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5) if isinstance(name, str) else []
    hint = "did you mean " + " or ".join(repr(n) for n in near) + "?" if near else ""
    if not isinstance(name, str):
        hint = "a name is a string"
    shown = ", ".join(repr(n) for n in names[:12]) + (", ..." if len(names) > 12 else "")
    prefix = f"{where}: " if where else ""
    listing = f"known: {shown}" if names else f"there is no {kind} yet"
    return SceneError(f"{prefix}unknown {kind} {name!r}; {hint + ' ' if hint else ''}({listing})")


def of_user(frame: FrameType) -> bool:
    """Whether a frame is of a script, and not of the packages or of what they are called through."""
    return str(frame.f_globals.get("__name__", "")).partition(".")[0] not in _NOT_THE_USER


_told: ContextVar[set[str] | None] = ContextVar("told", default=None)


@contextmanager
def telling(told: set[str] | None = None) -> Iterator[None]:
    """A call in which a warning with a key is given once, however often it is come across inside.

    Parameters
    ----------
    told
        Keys of warnings that were given, to which those of the call are added; None: those of the call around
        it, or none.
    """
    if told is None:
        told = _told.get()
    token = _told.set(set() if told is None else told)
    try:
        yield
    finally:
        _told.reset(token)


def warn(message: str, category: type[Warning], key: str = "") -> None:
    """A warning at the line of a user's script, however deep in the package it comes from.

    Parameters
    ----------
    key
        What it is about: within one call (:func:`telling`) it is said once; empty: always.
    """
    told = _told.get()
    if key and told is not None:
        if key in told:
            return
        told.add(key)
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and not of_user(frame):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
