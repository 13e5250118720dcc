"""Work of gmsh in a process of its own: what ends that process is an error here."""

from __future__ import annotations

import json
import logging
import math
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any, IO

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import OBJECTS, opened

__all__ = ["TIMEOUT", "alone", "away", "check_timeout"]

_log = logging.getLogger(__name__)

_PROGRAM = Path(__file__).with_name("worker.py")

TIMEOUT = 600.0
"""Seconds after which reading or meshing is given up if nothing is said: sound files take a few."""

_SIGNALS: dict[int, str] = {
    signal.SIGSEGV: "a segmentation fault",
    signal.SIGABRT: "an abort",
    signal.SIGFPE: "an arithmetic error",
    signal.SIGILL: "an illegal instruction",
    signal.SIGBUS: "a bus error",
    signal.SIGKILL: "a kill (out of memory, perhaps)",
}


def check_timeout(timeout: float | None) -> None:
    """Refuse what is no time.

    Raises
    ------
    SceneError
        Not None, and not a positive finite number.
    """
    if timeout is not None and not (
        isinstance(timeout, (int, float)) and math.isfinite(timeout) and timeout > 0.0
    ):
        raise SceneError(f"timeout = {timeout!r} must be positive seconds, or None")


_FIRST = 4096
"""Bytes of a file that tell what it is."""


@contextmanager
def alone(file: Path, name: str, check: Callable[[str, bytes], object]) -> Iterator[Path]:
    """A copy of a file under another name, alone in a folder that nobody else can write to.

    gmsh executes what it takes for a script by its name or its beginning, and ``NAME.opt`` beside any file;
    OpenCASCADE looks for other files beside a STEP file. So neither sees the path of a user, and what is
    checked of the copy is what is read. `check` refuses what does not begin as it should, by the name of the
    file and its first bytes, before anything is copied.

    Raises
    ------
    SceneError
        It cannot be read or copied, is too large, or does not begin as it should.
    """
    with opened(file, OBJECTS, SceneError) as given, tempfile.TemporaryDirectory() as folder:
        first = given.peek(_FIRST)[:_FIRST]
        if first.startswith(b"\x1f\x8b"):
            raise SceneError(f"{file.name!r} is compressed (gzip); unpack it")
        check(file.name, first)
        copy = Path(folder, name)
        try:
            with copy.open("xb") as target:
                shutil.copyfileobj(given, target)
        except OSError as error:
            raise SceneError(
                f"{file.name!r} cannot be read or copied to {folder} ({error}); check the room in the folder "
                "of temporary files"
            ) from error
        given.close()
        yield copy


def away(
    task: str,
    file: Path,
    failed: str,
    remedy: str,
    timeout: float | None = TIMEOUT,
    each: Callable[[str], None] | None = None,
    **arguments: Any,
) -> Any:
    """Carry out one of the tasks of :mod:`reading` in another process.

    Parameters
    ----------
    task, arguments
        Its name, and what it is called with.
    file
        The file that it is about.
    failed, remedy
        For messages: what could not be done ("cannot be read"), and what may help.
    timeout
        Seconds, None: as long as it takes.
    each
        Told what is done next.

    Raises
    ------
    SceneError
        The one of the task, or what ended the process; with the name of the file.
    RuntimeError
        The program did not start, or has an error.
    """
    check_timeout(timeout)
    began = perf_counter()
    state, stage, answer = "ended", "starting", None
    expired = threading.Event()
    with tempfile.TemporaryFile() as said:
        process = _start(said)
        assert process.stdin is not None and process.stdout is not None

        def expire() -> None:
            expired.set()
            process.kill()

        timer = threading.Timer(timeout or 0.0, expire)
        try:
            if timeout is not None:
                timer.start()
            try:
                process.stdin.write(json.dumps(sys.path).encode() + b"\n" + pickle.dumps((task, arguments)))
                process.stdin.flush()
                while state == "ended":
                    kind, answer = pickle.load(process.stdout)
                    if kind != "next":
                        state = kind
                    else:
                        stage = answer
                        if each is not None:
                            each(answer)
            except (OSError, EOFError, pickle.UnpicklingError):  # it is gone
                pass
        finally:
            timer.cancel()
            if state == "ended" and sys.exc_info()[0] is not None or expired.is_set():
                process.kill()
            _close(process)
            code = process.wait()
        said.seek(0)
        words = said.read()[-2000:].decode(errors="replace")
    _log.info("gmsh: %s, %.2f s", file.name, perf_counter() - began)
    if state == "done":
        return answer
    if state != "ended":
        raise _told(state, answer, file, f"{failed}, while {stage}", remedy)
    if expired.is_set():
        raise SceneError(
            f"{file.name!r} {failed}: gmsh was still {stage} after timeout = {timeout:g} s; {remedy}, or "
            "give more"
        )
    _log.debug("the other process said: %s", words)
    how = _SIGNALS.get(-code, f"signal {-code}") if code < 0 else f"exit code {code}"
    if stage == "starting":
        raise RuntimeError(f"the process that reads {file.name!r} did not start ({how}): {words}")
    raise SceneError(f"{file.name!r} {failed}: gmsh ended with {how}, while {stage}; {remedy}")


def _start(said: IO[bytes]) -> subprocess.Popen[bytes]:
    """The other process, in a group of its own: Ctrl-C is the business of this one."""
    return subprocess.Popen(
        # -P: the folder of the program has a gmsh.py of its own
        [sys.executable, "-P", str(_PROGRAM)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=said,
        process_group=0,
    )


def _told(state: str, answer: object, file: Path, failed: str, remedy: str) -> Exception:
    """The error that the other process told of."""
    if state == "refused":
        text = str(answer)
        return SceneError(text if repr(file.name) in text else f"{file.name!r}: {text}")
    if state == "failed":
        return SceneError(f"{file.name!r} {failed}: {answer}; {remedy}")
    return RuntimeError(f"reading {file.name!r} failed, through no fault of the file:\n{answer}")


def _close(process: subprocess.Popen[bytes]) -> None:
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            try:
                stream.close()
            except OSError:  # what was not written stays so
                pass
