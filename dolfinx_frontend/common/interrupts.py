"""Ctrl-C that is noted instead of raised, and asked about between pieces of work; so is a budget of time.

Handlers of SIGINT other than Python's own and the system's default are left alone, and so are threads other
than the main one, in which Python handles no signals.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from types import FrameType, TracebackType
from typing import Any, Self

import numpy as np

from dolfinx_frontend.common.progress import Bar

__all__ = [
    "Interrupt",
    "Interrupted",
    "as_interrupt",
    "keep_broken_pipes",
    "late",
    "pressed",
    "stop_if_pressed",
]

TWICE = 2.0
"""Seconds within which a second Ctrl-C raises, in whatever call it comes."""

_last_press = -np.inf


def keep_broken_pipes() -> None:
    """What writes to a reader that has gone away gets an exception, as everywhere in Python.

    PETSc's handler of signals, which comes with its import, would end this process and all other ranks.
    """
    before = signal.getsignal(signal.SIGPIPE)  # Python's, which does not know of PETSc's
    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGPIPE, before)


@contextmanager
def as_interrupt(number: signal.Signals) -> Iterator[None]:
    """A signal is as Ctrl-C meanwhile."""

    def press(_: int, frame: FrameType | None) -> None:
        handler = signal.getsignal(signal.SIGINT)
        # where Ctrl-C is ignored, as in the background of a shell, this is not
        (handler if callable(handler) else signal.default_int_handler)(signal.SIGINT, frame)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, press)
    try:
        yield
    finally:
        signal.signal(number, signal.SIG_DFL if before is None else before)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or the end of a budget of time, in a run whose last iterate is of no use by itself."""


class Interrupt:
    """The context in which Ctrl-C is noted instead of raised.

    Contexts may be nested: a search for an answer, and the runs that it makes. The outermost one that holds
    back is told, and all within it know.

    Parameters
    ----------
    holds
        False: Ctrl-C raises until :meth:`hold` is called: there is nothing yet that could be returned.
    alone
        Whether no other rank waits for this one, so that the work may end anywhere.

    Attributes
    ----------
    told
        Whether Ctrl-C was pressed here, and not in a context around this one, which asks for it again.
    """

    def __init__(self, holds: bool = True, alone: bool = True) -> None:
        self._holds, self.alone = holds, alone
        self._until = np.inf
        self.told = self._installed = False
        self._before: Any = None
        self._outer: Interrupt | None = None

    @property
    def asked(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self.told or (self._outer is not None and self._outer.asked)

    @property
    def late(self) -> bool:
        """Whether a budget of time has ended."""
        return monotonic() > self._until or (self._outer is not None and self._outer.late)

    @property
    def pressed(self) -> bool:
        """Whether Ctrl-C was pressed, or a budget of time has ended."""
        return self.asked or self.late

    def hold(self) -> None:
        """Hold Ctrl-C back from now on: there is an answer."""
        self._holds = True

    def limit(self, seconds: float) -> None:
        """A budget of time from now on, whose end is as Ctrl-C; 0: it has ended, and there is an answer."""
        self._until = monotonic() + seconds

    def watch(self, callback: Callable[[Any], None] | None = None) -> Callable[[Any], None]:
        """A callback for the kernel that ends the run once Ctrl-C was pressed."""

        def each(iteration: Any) -> None:
            for bar in Bar.running[-1:]:
                bar.at(iteration.number, iteration.error)
            if not self.pressed and callback is not None:
                callback(iteration)
            if self.pressed:
                raise StopIteration

        return each

    def __enter__(self) -> Self:
        if threading.current_thread() is not threading.main_thread():
            return self
        self._before = signal.getsignal(signal.SIGINT)
        # gmsh.initialize() leaves the system's default, which would end the process and lose what is done
        if self._before in (_press, signal.default_int_handler, signal.SIG_DFL):
            signal.signal(signal.SIGINT, _press)
            self._installed = True
        self._outer = _open[-1] if _open else None
        _open.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self in _open:
            _open.remove(self)
        if self.told and self._outer is not None:  # a piece that was done just then says nothing of it
            self._outer.told = True
        if self._installed:
            signal.signal(signal.SIGINT, self._before)
            self._installed = False


_open: list[Interrupt] = []
"""Of the main thread, the outermost first."""


def _press(number: int, frame: FrameType | None) -> None:
    global _last_press
    before, _last_press = _last_press, monotonic()
    told = next((each for each in _open if each._holds), None)
    if told is None or _open[-1].asked or _last_press - before < TWICE:
        signal.default_int_handler(number, frame)
    else:
        told.told = True


def pressed() -> bool:
    """Whether Ctrl-C was pressed in the run that this is a part of, or its budget of time has ended."""
    main = threading.current_thread() is threading.main_thread()
    return main and bool(_open) and _open[-1].pressed


def late() -> bool:
    """Whether it is the budget of time that ends the run that this is a part of."""
    return pressed() and not _open[-1].asked


def stop_if_pressed() -> None:
    """End a piece of work on which no other rank waits, if Ctrl-C was pressed in the run that it is for.

    Raises
    ------
    Interrupted
        It was.
    """
    if pressed() and all(each.alone for each in _open):
        raise Interrupted
