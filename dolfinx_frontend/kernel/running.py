"""What a user sees of a run: Ctrl-C, a progress bar, lines in the log.

Ctrl-C while the kernel iterates ends the run with what is done so far: ``solve`` returns its last iterate
with the status ``"interrupted"``, a sweep or a sampling the points that are finished, with ``complete``
False, and a warning is logged. A second Ctrl-C within two seconds of the first, or in the same call, raises
KeyboardInterrupt: so a script that calls solve in a loop can always be ended. Outside of the iteration
(meshing, assembly, factorisation), where nothing is done that could be returned, Ctrl-C raises
KeyboardInterrupt as ever.

Handlers of SIGINT other than Python's own and the system's default are left alone, and so are threads other
than the main one, in which Python handles no signals.
"""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable
from time import monotonic
from types import FrameType, TracebackType
from typing import Any, Self

import numpy as np
from latin_core import Iteration

from dolfinx_frontend.common.checks import checked_callable, checked_flag

__all__ = ["Interrupt", "Interrupted", "check_running", "report_points"]

TWICE = 2.0
"""Seconds within which a second Ctrl-C raises, in whatever call it comes."""

_log = logging.getLogger(__name__)
_last_press = -np.inf


def check_running(where: str, callback: object, progress: object, **flags: object) -> None:
    """Refuse a callback that cannot be called, and settings that are neither True nor False."""
    if callback is not None:
        checked_callable(where, "callback", callback, "give a function of an Iteration")
    for name, value in {"progress": progress, **flags}.items():
        checked_flag(where, name, value)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a run whose last iterate is of no use by itself."""


class Interrupt:
    """The context in which Ctrl-C is noted instead of raised.

    Attributes
    ----------
    pressed
        Whether it was.
    """

    def __init__(self) -> None:
        self.pressed = False
        self._before: Any = None

    def _press(self, number: int, frame: FrameType | None) -> None:
        global _last_press
        before, _last_press = _last_press, monotonic()
        if self.pressed or _last_press - before < TWICE:
            signal.default_int_handler(number, frame)
        self.pressed = True

    def watch(self, callback: Callable[[Iteration], None] | None = None) -> Callable[[Iteration], None]:
        """A callback for the kernel that ends the run once Ctrl-C was pressed."""

        def each(iteration: Iteration) -> None:
            if not self.pressed and callback is not None:
                callback(iteration)
            if self.pressed:
                raise StopIteration

        return each

    def __enter__(self) -> Self:
        main = threading.current_thread() is threading.main_thread()
        before = signal.getsignal(signal.SIGINT)
        # gmsh.initialize() leaves the system's default, which would end the process and lose what is done
        if main and before in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(signal.SIGINT, self._press)
            self._before = before
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)


def report_points(what: str, interrupt: Interrupt, points: Any, checkpoint: object) -> None:
    """Log how a walk over points ended."""
    reached = points.iterations >= 0
    done, count = int(reached.sum()), len(reached)
    total = int(points.iterations[reached].sum())
    _log.info("%s: %d of %d points, %d iterations", what, done, count, total)
    if done < count:
        kept = "the checkpoint has them: the same call goes on" if checkpoint else "give checkpoint= to go on"
        _log.warning("%s: interrupted after %d of %d points (%s)", what, done, count, kept)
    elif interrupt.pressed:
        _log.warning("Ctrl-C came when all points were done; press it twice to end the program")
