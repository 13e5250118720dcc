"""Progress bars for long computations: meshing, assembly, iteration, sweeps and sampling.

They are drawn by tqdm, on the error stream, if that is a terminal and tqdm is installed, and appear after
half a second. ``progress(False)``, or ``LATIN_PROGRESS=0`` in the environment, switches them off; so does
tqdm's own ``TQDM_DISABLE=1``. The same steps are logged, see :mod:`logging`: loggers
``dolfinx_frontend`` and ``latin_core``, phases at INFO, single points and iterations at DEBUG. Where no bar
is drawn, a line at INFO says every few seconds how far the innermost phase is.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from time import monotonic, sleep
from types import TracebackType
from typing import Any, ClassVar, Self

from dolfinx_frontend.common.checks import checked_flag
from dolfinx_frontend.common.describe import shown_error

__all__ = ["Bar", "Lines", "progress"]

_log = logging.getLogger(__name__)
_DELAY = 0.5  # seconds
EVERY = 5.0
"""Seconds between two lines of the log."""
LINES = 3
"""Of one kind that are logged in full; of points that fail there may be thousands."""
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
        self.what, self.unit, self.total, self.done, self.within = what, unit, total, 0, ""
        self.told, self.began = wanted, monotonic()
        Bar.running.append(self)
        if wanted and _log.isEnabledFor(logging.INFO):
            _tell()
        if not (wanted and _on and sys.stderr is not None and sys.stderr.isatty()):
            return
        try:
            from tqdm import tqdm  # type: ignore[import-untyped,unused-ignore]
        except ImportError:
            return
        self._bar = tqdm(total=total, desc=what, unit=unit, leave=stays, delay=_DELAY, **_size())

    def __str__(self) -> str:
        of = "" if self.total is None else f" of {self.total}"
        far = f"{self.unit} {self.done}{of}, " if self.done or self.total != 1 else ""
        return f"{self.what}: {far}{self.within}{monotonic() - self.began:.0f} s"

    @property
    def drawn(self) -> bool:
        """Whether a terminal has it."""
        return self._bar is not None

    def at(self, iteration: int, error: float) -> None:
        """How far the step that is under way is."""
        if self.unit != "iteration":
            self.within = f"iteration {iteration}, error {shown_error(error)}, "

    def step(self, **shown: Any) -> None:
        """One step is done; the keyword arguments are shown behind the bar."""
        self.done += 1
        self.within = ""
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


_teller: threading.Thread | None = None


def _tell() -> None:
    """Have the running phases told until there is none."""
    global _teller
    if _teller is None or not _teller.is_alive():
        _teller = threading.Thread(target=_telling, name="progress", daemon=True)
        _teller.start()


def _telling() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})  # it is for the main thread
    while Bar.running:
        sleep(EVERY)
        # a phase that has begun just now is no news
        old = [bar for bar in list(Bar.running) if bar.told and monotonic() - bar.began > 0.5 * EVERY]
        if old and not any(bar.drawn for bar in old):
            _log.info("%s", old[-1])


class Lines:
    """Warnings of points in the log: the first ones of a kind, then how many more there are."""

    def __init__(self, log: logging.Logger, rank: int = 0) -> None:
        self._log, self._silent = log, rank != 0
        self._counts: dict[str, int] = {}

    def add(self, kind: str, line: str) -> None:
        """A line of a kind, named in the plural, as ``"samples that ended as slides"``."""
        self._counts[kind] = self._counts.get(kind, 0) + 1
        if not self._silent:
            self._log.log(logging.WARNING if self._counts[kind] <= LINES else logging.DEBUG, "%s", line)

    def rest(self) -> None:
        """Say how many lines of each kind were left out."""
        for kind, count in self._counts.items():
            if count > LINES and not self._silent:
                self._log.warning("and %d more %s", count - LINES, kind)
