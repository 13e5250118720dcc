"""Tracebacks of refused input end at the line of the user's script: what is inside of the package says
nothing of a mistake outside of it."""

from __future__ import annotations

import sys
import traceback
from types import TracebackType
from typing import Any

from dolfinx_frontend.common.checks import checked_flag
from dolfinx_frontend.common.errors import SceneError, of_user

__all__ = ["debug", "install", "shortened"]

_whole = False


def debug(on: bool | None = None) -> bool:
    """Show tracebacks in full, for who looks for a fault in the package itself; None: only tell.

    Returns
    -------
    bool
        Whether they are.
    """
    global _whole
    if on is not None:
        _whole = checked_flag("debug", "on", on)
    return _whole


def shortened(trace: TracebackType | None) -> TracebackType | None:
    """A traceback up to the last frame of the user's; None: it has none, or there is no traceback."""
    frames = []
    while trace is not None:
        frames.append(trace)
        trace = trace.tb_next
    while frames and not of_user(frames[-1].tb_frame):
        frames.pop()
    short: TracebackType | None = None
    for each in reversed(frames):
        short = TracebackType(short, each.tb_frame, each.tb_lasti, each.tb_lineno)
    return short


def _text(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> str:
    short = shortened(trace)
    told = traceback.TracebackException(kind, error, short or trace, compact=True)
    told.__cause__ = told.__context__ = None
    return "".join(told.format())


def _hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if _whole or not isinstance(error, SceneError):
        sys.__excepthook__(kind, error, trace)
        return
    sys.stderr.write(_text(kind, error, trace))


def _in_notebook(shell: Any, kind: type[BaseException], error: BaseException, trace: Any, **_: Any) -> None:
    """As IPython shows others: cells and lines, without its own frames."""
    if not _whole:
        error.__cause__ = error.__context__ = None
        trace = shortened(trace) or trace
    shell.showtraceback((kind, error, trace))


def install() -> None:
    """Have Python, and IPython where that runs, show refusals of the package in short.

    A hook that somebody else has set stays.
    """
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _hook
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is not None:
        shell.set_custom_exc((SceneError,), _in_notebook)
