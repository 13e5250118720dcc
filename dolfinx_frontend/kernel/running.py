"""What a user sees of a run: Ctrl-C, a progress bar, lines in the log.

Ctrl-C while the kernel iterates ends the run with what is done so far: ``solve`` returns its last iterate
with the status ``"interrupted"``, a sweep or a sampling the points that are finished, with ``complete``
False, and a warning is logged. A second Ctrl-C within two seconds of the first, or in the same call, raises
KeyboardInterrupt: so a script that calls solve in a loop can always be ended. Outside of the iteration
(meshing, assembly, factorisation), where nothing is done that could be returned, Ctrl-C raises
KeyboardInterrupt as ever.

``solve(accuracy=...)`` is one run from its first answer on: the first Ctrl-C ends it wherever it is, with the
best answer so far (:mod:`dolfinx_frontend.common.interrupts`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from latin_core import Options

from dolfinx_frontend.common.checks import checked_callable, checked_flag
from dolfinx_frontend.common.interrupts import Interrupt, Interrupted

__all__ = ["FOLDER", "Interrupt", "Interrupted", "check_running", "points_kept", "report_points", "within"]

_log = logging.getLogger(__name__)

FOLDER: ContextVar[Path | None] = ContextVar("folder of points", default=None)
"""Where walks over points keep these, see :func:`points_kept`."""


@contextmanager
def points_kept(folder: Path) -> Iterator[None]:
    """Walks over points keep these in files of a folder, and begin with what is there of the same walk.

    What is killed goes on, however many walks it has chosen; files that no walk asks for do no harm.
    """
    mark = FOLDER.set(folder)
    try:
        yield
    finally:
        FOLDER.reset(mark)


def check_running(where: str, callback: object, progress: object, **flags: object) -> None:
    """Refuse a callback that cannot be called, and settings that are neither True nor False."""
    if callback is not None:
        checked_callable(where, "callback", callback, "give a function of an Iteration")
    for name, value in {"progress": progress, **flags}.items():
        checked_flag(where, name, value)


def within(options: Options, spent: float) -> Options:
    """Options whose ``max_seconds`` have begun some seconds ago."""
    if options.max_seconds == np.inf:
        return options
    return options.with_(max_seconds=max(options.max_seconds - spent, 0.0))


def report_points(what: str, interrupt: Interrupt, points: Any, checkpoint: object) -> None:
    """Log how a walk over points ended."""
    reached = points.iterations >= 0
    done, count = int(reached.sum()), len(reached)
    total = int(points.iterations[reached].sum())
    _log.info("%s: %d of %d points, %d iterations", what, done, count, total)
    if done < count and interrupt.pressed and not interrupt.told:
        _log.info("%s: Ctrl-C after %d of %d points", what, done, count)  # its caller says what comes of it
    elif done < count:
        kept = "give checkpoint= to go on"
        if checkpoint or FOLDER.get():
            kept = "the checkpoint has them: the same call goes on"
        _log.warning("%s: interrupted after %d of %d points (%s)", what, done, count, kept)
    elif interrupt.told:
        _log.warning("Ctrl-C came when all points were done; press it twice to end the program")
