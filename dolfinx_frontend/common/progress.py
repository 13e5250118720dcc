"""Progress bars for long computations: meshing, assembly, iteration, sweeps and sampling.

They are drawn by tqdm, on the error stream, if that is a terminal and tqdm is installed, and appear after
half a second. ``progress(False)``, or ``LATIN_PROGRESS=0`` in the environment, switches them off; so does
tqdm's own ``TQDM_DISABLE=1``. The same steps are logged, see :mod:`logging`: loggers
``dolfinx_frontend`` and ``latin_core``, phases at INFO, single points and iterations at DEBUG.
"""

from __future__ import annotations

import os
import sys
from types import TracebackType
from typing import Any, ClassVar, Self

from dolfinx_frontend.common.checks import checked_flag

__all__ = ["Bar", "progress"]

_DELAY = 0.5  # seconds
_on = os.environ.get("LATIN_PROGRESS", "1").strip().lower() not in ("0", "false", "no", "off")


def progress(on: bool | None = None) -> bool:
    """Switch progress bars on or off for this process; None: change nothing, only return the setting.

    Returns
    -------
    bool
        Whether bars are drawn where the error stream is a terminal.
    """
    global _on
    if on is not None:
        _on = checked_flag("progress", "on", on)
    return _on


def _size() -> dict[str, Any]:
    """How wide a bar is: as the terminal, or 80 columns where it does not tell (tqdm would draw nothing)."""
    try:
        known = os.get_terminal_size(sys.stderr.fileno()).columns > 0
    except (OSError, ValueError):
        known = False
    return {"dynamic_ncols": True} if known else {"ncols": 80, "nrows": 24}


class Bar:
    """A progress bar, or nothing: a context in which :meth:`step` is called.

    Parameters
    ----------
    total
        Number of steps; None: unknown.
    what, unit
        Text in front of the bar, and the name of what is counted.
    wanted
        False: nothing is drawn.
    stays
        Whether the finished bar stays on the screen.
    """

    running: ClassVar[list[Bar]] = []
    """Those that are open, the innermost last: what a process without a terminal can tell of its progress."""

    def __init__(
        self, total: int | None, what: str, unit: str = "point", wanted: bool = True, stays: bool = False
    ) -> None:
        self._bar: Any = None
        self.what, self.unit, self.total, self.done = what, unit, total, 0
        Bar.running.append(self)
        if not (wanted and _on and sys.stderr is not None and sys.stderr.isatty()):
            return
        try:
            from tqdm import tqdm  # type: ignore[import-untyped,unused-ignore]
        except ImportError:
            return
        self._bar = tqdm(total=total, desc=what, unit=unit, leave=stays, delay=_DELAY, **_size())

    def step(self, **shown: Any) -> None:
        """One step is done; the keyword arguments are shown behind the bar."""
        self.done += 1
        if self._bar is not None:
            self._bar.set_postfix(shown, refresh=False)
            self._bar.update()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self in Bar.running:
            Bar.running.remove(self)
        if self._bar is not None:
            self._bar.close()
