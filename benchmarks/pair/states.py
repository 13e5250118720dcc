"""Commits that are built, and the process of each that runs scenes."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
WORKER = Path(__file__).with_name("worker.py")


class Failed(RuntimeError):
    """A process could not do what it was told; its words."""


def cache_folder() -> Path:
    """The user's, as ``tools/env/bootstrap.sh`` has it."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "latin" / "commits"


def source_of(other: str) -> Path:
    """The folder of a state: a given one, or the files of a commit, made once in the user's cache folder."""
    if (Path(other) / "run").is_file():
        return Path(other).resolve()
    git = ["git", "-C", str(ROOT)]
    found = subprocess.run(
        [*git, "rev-parse", "--verify", "--quiet", f"{other}^{{commit}}"], capture_output=True, text=True
    )
    if found.returncode:
        raise SystemExit(f"pair: {other!r} is neither a commit of {ROOT} nor a folder with a file `run`")
    sha = found.stdout.strip()
    folder = cache_folder() / sha
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            part = folder.with_suffix(".part")  # made beside its place: a half of it is never taken
            shutil.rmtree(part, ignore_errors=True)
            with subprocess.Popen([*git, "archive", sha], stdout=subprocess.PIPE) as archive:
                assert archive.stdout is not None
                with tarfile.open(fileobj=archive.stdout, mode="r|") as files:
                    files.extractall(part, filter="tar")
            if archive.returncode:
                raise SystemExit(f"pair: git archive {sha} ended with {archive.returncode}")
            part.rename(folder)
    return folder


class State:
    """A commit's library in a process of its own that stays alive, on one thread."""

    def __init__(self, folder: Path, log: Path) -> None:
        self.folder, self.log = folder, log
        # its own environment, not the one in which this process runs
        own = [str(folder / "run"), "python"] if folder != ROOT else [sys.executable]
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        environment = {k: v for k, v in os.environ.items() if k not in ("LATIN_SKIP_BUILD", "PYTHONPATH")}
        self.process = subprocess.Popen(
            [*own, str(WORKER), str(folder / "demos")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=open(log, "w"),
            text=True,
            env=environment | threads,
        )
        library = Path(self.ask(do="names")["library"])
        if folder not in library.parents:
            raise SystemExit(f"pair: the environment of {folder} has the library {library}")

    def ask(self, **command: Any) -> dict[str, Any]:
        """Send a command, wait for its answer."""
        assert self.process.stdin is not None and self.process.stdout is not None
        try:
            print(json.dumps(command), file=self.process.stdin, flush=True)
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            tail = self.log.read_text(errors="replace")[-2000:]
            raise SystemExit(f"pair: the process of {self.folder} ended ({self.process.wait()}):\n{tail}")
        found: dict[str, Any] = json.loads(line)
        if "failed" in found:
            raise Failed(found["failed"])
        return found

    def end(self) -> None:
        """It ends with its input."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
