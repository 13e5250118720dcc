"""Damaged STEP and mesh files: each is read, or refused with one error that names it.

``./run bench fuzz_geometry --count 2000`` damages 2000 files of each kind; the interpreter that reads them is
watched from outside. `fuzz` is to be called from other programs. One process forks for every file: what
reads it is the same as in `read_step` and `read_msh`, only not started each time (the tests do that).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import common  # noqa: F401  makes the tests importable
import numpy as np

from tests.geometry.fuzz import DEFECTS, Forking, content, damaged, judge, make

KINDS = ("step", "msh")


def _case(kind: str, folder: Path, files: list[Path], seed: int, number: int) -> tuple[Path, Path]:
    """The damaged file of a number, and the sound one it comes from."""
    rng = np.random.default_rng([seed, number])
    sound = files[number % len(files)]
    file = folder / f"damaged_{number}{sound.suffix}"
    file.write_bytes(damaged(sound.read_bytes(), rng))
    return file, sound


def _batch(kind: str, folder: Path, seed: int, numbers: range) -> None:
    """Judge some numbers; a line before and a line after each."""
    files = sorted(folder.glob(f"sound/*.{kind}"))
    with Forking():
        expected = {file: content(kind, file) for file in files}
        for number in numbers:
            print(json.dumps([number, None, ""]), flush=True)
            file, sound = _case(kind, folder, files, seed, number)
            verdict, message = judge(kind, file, expected[sound])
            if verdict not in DEFECTS:
                file.unlink()
            print(json.dumps([number, verdict, message]), flush=True)


def fuzz(kind: str, count: int, seed: int = 0, processes: int = 1, keep: Path | None = None) -> Counter[str]:
    """Verdicts of `count` damaged files of a kind, ``"step"`` or ``"msh"``; see `judge` for the words.

    Parameters
    ----------
    processes
        Interpreters at work at the same time.
    keep
        Folder for files with a defect; None: nothing is kept.
    """
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as made:
        folder = keep or Path(made)
        (folder / "sound").mkdir(parents=True, exist_ok=True)
        make(kind, folder / "sound")
        todo = [range(k, count, processes) for k in range(processes)]
        while todo:
            started = [(numbers, _start(kind, folder, seed, numbers)) for numbers in todo]
            todo = []
            for numbers, process in started:
                done = numbers.start - numbers.step
                at = done
                assert process.stdout is not None
                for line in process.stdout:
                    at, verdict, message = json.loads(line)
                    if verdict is None:
                        continue
                    done = at
                    counts[verdict] += 1
                    if verdict in DEFECTS or verdict == "crash":
                        print(f"{kind} {at}: {verdict}: {message}", flush=True)
                if process.wait() != 0:
                    if at == done:
                        raise RuntimeError(f"the fuzzing itself failed with exit code {process.returncode}")
                    counts["interpreter ended"] += 1
                    print(f"{kind} {at}: the interpreter ended with {process.returncode}", flush=True)
                    todo.append(range(at + numbers.step, numbers.stop, numbers.step))
    return counts


def _start(kind: str, folder: Path, seed: int, numbers: range) -> subprocess.Popen[str]:
    words = [kind, str(folder), str(seed), str(numbers.start), str(numbers.stop), str(numbers.step)]
    line = [sys.executable, str(Path(__file__)), "--batch", *words]
    return subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=os.environ | {"LATIN_PROGRESS": "0"})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="damaged files of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kind", choices=KINDS, help="only this one")
    parser.add_argument("--keep", type=Path, help="folder for the files with a defect")
    parser.add_argument("--batch", nargs=6, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.batch:
        kind, folder, seed, *ends = given.batch
        _batch(kind, Path(folder), int(seed), range(*map(int, ends)))
        return 0
    bad = 0
    for kind in (given.kind,) if given.kind else KINDS:
        counts = fuzz(kind, given.count, given.seed, given.processes, given.keep)
        print(f"{kind}: " + ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common()), flush=True)
        bad += sum(counts[verdict] for verdict in DEFECTS)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
