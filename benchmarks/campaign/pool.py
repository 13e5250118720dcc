"""Processes in which scenes run: each serves many scenes, is watched, and replaced when it dies or hangs.

The parent imports nothing of the library, so that no crash reaches it. A worker gets one seed a line and
answers with lines of its own on a pipe that nothing else writes to: the phases it enters, then its verdict.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

T = TypeVar("T")
MAIN = Path(__file__).resolve().parent.parent / "campaign.py"
SERVES = 150
"""Scenes after which a worker is replaced, so that nothing adds up."""
STARTS = 120.0
"""Seconds that a worker may take to begin, on a busy machine."""


class Worker:
    """One process of a benchmark that is started with ``--worker``, by this Python or another build's."""

    def __init__(self, main: Path = MAIN, python: str = sys.executable) -> None:
        self.log = tempfile.TemporaryFile()
        self.read, write = os.pipe()
        environment = {**os.environ, "CAMPAIGN_PIPE": str(write)}
        self.process = subprocess.Popen(
            [python, str(main), "--worker"],
            stdin=subprocess.PIPE,
            stdout=self.log,
            stderr=self.log,
            pass_fds=(write,),
            env=environment,
            start_new_session=True,
        )
        os.close(write)
        self.buffer, self.served = b"", 0

    def lines(self, until: float) -> list[dict[str, Any]] | None:
        """What it said by a time; None when it is gone."""
        left = until - perf_counter()
        if left <= 0.0 or not select.select([self.read], [], [], left)[0]:
            return []
        data = os.read(self.read, 1 << 16)
        if not data:
            return None
        *whole, self.buffer = (self.buffer + data).split(b"\n")
        return [json.loads(line) for line in whole]

    def last_words(self) -> str:
        self.log.seek(0)
        return self.log.read()[-1500:].decode(errors="replace").strip()

    def stop(self) -> None:
        """End it and what it started, by its own process group."""
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()
        os.close(self.read)
        self.log.close()


class Seat:
    """A place at which one worker after another sits."""

    def __init__(self, limit: float, main: Path = MAIN, python: str = sys.executable) -> None:
        self.limit, self.main, self.python = limit, main, python
        self.worker: Worker | None = None

    def run(self, task: dict[str, Any]) -> dict[str, Any]:
        """The verdict on a scene, whatever happens to the worker.

        Parameters
        ----------
        task
            The scene's seed; or, with a ``source``, its kind and tolerance. The rest is put into the verdict.
        """
        began = perf_counter()
        if self.worker is not None and self.worker.served >= SERVES:
            self.close()
        if self.worker is None:
            self.worker = Worker(self.main, self.python)
        worker, phase, started = self.worker, "start", None
        worker.served += 1
        attempt = 0
        assert worker.process.stdin is not None
        try:
            worker.process.stdin.write(json.dumps(task).encode() + b"\n")
            worker.process.stdin.flush()
        except BrokenPipeError:
            pass
        while True:
            until = began + STARTS if started is None else started + self.limit
            found = worker.lines(until)
            if found is None:
                code = worker.process.wait()
                what = f"died in {phase} ({signal.Signals(-code).name if code < 0 else f'code {code}'})"
                words = worker.last_words()
                self.close()
                return self._lost(task, "crashed", what, words, began, attempt)
            for line in found:
                if "phase" in line:
                    phase = line["phase"]
                    if phase.startswith("attempt"):
                        attempt = int(phase.split()[1])
                    if started is None:
                        started = perf_counter()
                elif "verdict" in line:
                    verdict: dict[str, Any] = line["verdict"]
                    return verdict
            if perf_counter() >= until:
                words = worker.last_words()
                self.close()
                what = f"no end of {phase} within {self.limit:g} s"
                # the campaign's own slowness is nobody else's failure
                outcome = "unjudged" if phase == "reference" else "crashed"
                return self._lost(task, outcome, what, words, began, attempt)

    @staticmethod
    def _lost(
        task: dict[str, Any], outcome: str, what: str, words: str, began: float, attempt: int = 0
    ) -> dict[str, Any]:
        seconds = {"all": round(perf_counter() - began, 3)}
        lost = {"outcome": outcome, "what": what, "errors": words.splitlines()[-8:], "attempt": attempt}
        return {**task, **lost, "seconds": seconds}

    def close(self) -> None:
        if self.worker is not None:
            self.worker.stop()
            self.worker = None


def side_by_side(
    tasks: Iterable[T], jobs: int, seat: Callable[[], Seat], do: Callable[[T, Seat], None]
) -> None:
    """Do all tasks, so many at a time, each with a seat of its own; Ctrl-C ends with what is begun."""
    todo, lock, stop = iter(tasks), threading.Lock(), threading.Event()

    def work() -> None:
        own = seat()
        try:
            while not stop.is_set():
                with lock:
                    found = next(todo, None)
                if found is None:
                    return
                do(found, own)
        finally:
            own.close()

    threads = [threading.Thread(target=work, daemon=True) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    try:
        for thread in threads:
            while thread.is_alive():
                thread.join(0.5)
    except KeyboardInterrupt:
        print("interrupted: what is done is counted", flush=True)
        stop.set()


def ranked(task: dict[str, Any], limit: float) -> dict[str, Any]:
    """A scene on two ranks, in processes of its own."""
    began = perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "verdict.json"
        call = ["mpirun", "-n", "2", sys.executable, str(MAIN), "--ranked", str(task["seed"]), str(file)]
        with tempfile.TemporaryFile() as log:
            process = subprocess.Popen(call, stdout=log, stderr=log, start_new_session=True)
            what = ""
            try:
                code = process.wait(timeout=limit + STARTS / 2.0)
                if code:
                    what = f"two ranks ended with code {code}"
            except subprocess.TimeoutExpired:
                what = f"two ranks: no end within {limit:g} s"
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            log.seek(0)
            words = log.read()[-1500:].decode(errors="replace").strip()
        if file.exists():
            verdict: dict[str, Any] = json.loads(file.read_text())
            return verdict
        return Seat._lost(task, "crashed", what or "two ranks left no verdict", words, began)


def serve(judge: Callable[[dict[str, Any], Callable[[str], None]], dict[str, Any]]) -> None:
    """A worker's life: tasks in, verdicts out."""
    pipe = os.fdopen(int(os.environ["CAMPAIGN_PIPE"]), "w", buffering=1)

    def say(what: dict[str, Any]) -> None:
        pipe.write(json.dumps(what) + "\n")
        pipe.flush()

    for line in sys.stdin:
        task = json.loads(line)
        say({"phase": "draw"})
        say({"verdict": judge(task, lambda phase: say({"phase": phase}))})
