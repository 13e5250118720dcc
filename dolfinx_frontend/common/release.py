"""Refuses a dolfinx that is missing or too old, before anything else of the package is imported."""

from __future__ import annotations

import contextlib
import importlib
import logging
import re
import signal
import warnings

OLDEST = (0, 9)
NEWEST_TRIED = (0, 11)
REMEDY = (
    "conda: conda install -c conda-forge 'fenics-dolfinx>=0.9'; container: dolfinx/dolfinx:stable; "
    "Debian 13 or newer: apt-get install python3-dolfinx; or let ./run make an environment"
)


def show_warnings() -> None:
    """Have Python show warnings again: ffcx redirects all of them to a logger without a handler."""
    loggers = (logging.getLogger("py.warnings"), logging.getLogger())
    if all(isinstance(h, logging.NullHandler) for logger in loggers for h in logger.handlers):
        logging.captureWarnings(False)


def check() -> None:
    """Compare the installed dolfinx with the releases with which the package was tested.

    Raises
    ------
    ImportError
        If dolfinx is missing or older than 0.9.

    Warns
    -----
    UserWarning
        If it is newer than any release that was tested.
    """
    oldest, newest = (".".join(map(str, release)) for release in (OLDEST, NEWEST_TRIED))
    # the thread that MPI starts leaves SIGTERM to this one, which holds it back while METIS would lose it
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    with contextlib.suppress(ModuleNotFoundError):  # it asks MPI for several threads, dolfinx would not
        importlib.import_module("mpi4py.MPI")
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    try:
        dolfinx = importlib.import_module("dolfinx")
    except ModuleNotFoundError as missing:
        if missing.name != "dolfinx":
            raise
        raise ImportError(
            f"dolfinx is not installed, dolfinx_frontend needs {oldest} or newer. {REMEDY}",
            name="dolfinx",
        ) from missing
    version = str(getattr(dolfinx, "__version__", ""))
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None:  # a build without a version number: nothing to compare
        return
    release = (int(numbers[1]), int(numbers[2]))
    if release < OLDEST:
        raise ImportError(
            f"dolfinx {version} is installed (in {getattr(dolfinx, '__file__', 'an unknown place')}), "
            f"dolfinx_frontend needs {oldest} or newer. {REMEDY}",
            name="dolfinx",
        )
    show_warnings()
    if release > NEWEST_TRIED:
        warnings.warn(
            f"dolfinx {version} is installed, dolfinx_frontend was tried with {oldest} to {newest}: "
            "if something fails, install one of these, and report it",
            stacklevel=2,
        )


check()
