"""Damaged files in all readers: each is refused with one clear error, or read right.

Results, checkpoints, chaos files and meshes are cut short, zeroed, overwritten, spliced; each file from its
own seed. Readers run in processes that may die. ``faulty/readers.py`` has files, damages and readers.

Outcomes: ``refused`` (the reader's own error, with the file's name, the file untouched), ``right`` (read, and
it says what the good file says), ``another mesh`` (formats of meshes have no checksum: a changed digit is
another mesh, and one that can be assembled). Failures: ``wrong``, ``raised`` (another error), ``unnamed``,
``changed`` (the reader wrote to the file), ``crashed``, ``hung``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from time import perf_counter
from typing import Any

FINE = ("refused", "right", "another mesh")
FAILURES = ("wrong", "raised", "unnamed", "changed", "crashed", "hung")
KINDS = {
    "result": 3,
    "result of a chaos": 2,
    "result of samples": 2,
    "result of a sweep": 2,
    "checkpoint": 6,
    "chaos, HDF5": 3,
    "chaos, JSON": 3,
    "mesh 4.1": 1,
    "mesh 4.1, binary": 1,
    "mesh 2.2": 1,
}
"""What is drawn from, and how often; the readers' table has the same names."""
BATCH = 25
LIMIT = 60.0
"""Seconds for a batch of files."""


def seed_of(campaign: int, number: int) -> int:
    return int(hashlib.sha256(f"fuzz {campaign} {number}".encode()).hexdigest()[:12], 16)


def tasks(files: int, campaign: int, kinds: Iterable[str] = KINDS) -> list[dict[str, Any]]:
    """Batches of one kind each."""
    found = []
    turns = [kind for turn in range(max(KINDS.values())) for kind in kinds if turn < KINDS[kind]]
    for first in range(0, files, BATCH):
        seeds = [seed_of(campaign, number) for number in range(first, min(first + BATCH, files))]
        found.append({"kind": turns[first // BATCH % len(turns)], "seeds": seeds})
    return found


def one(task: dict[str, Any], seat: Any, folder: Path) -> list[dict[str, Any]]:
    """Verdicts on the files of a batch; what kills or stops the reader is left out, and the rest goes on."""
    verdicts: list[dict[str, Any]] = []
    left = list(task["seeds"])
    while left:
        answer = seat.run({"kind": task["kind"], "seeds": left, "folder": str(folder)})
        if "verdicts" in answer:
            return verdicts + answer["verdicts"]
        words = answer.get("what", "").split()
        seed = next((int(word) for word in words if word.isdigit() and int(word) in left), None)
        if seed is None:
            raise RuntimeError(f"{task['kind']}: the good file is not read: {answer}")
        where = left.index(seed)
        outcome = "hung" if "no end of" in answer["what"] else "crashed"
        about = {"kind": task["kind"], "seed": seed, "outcome": outcome, "what": answer["what"]}
        verdicts.append({**about, "errors": answer.get("errors", [])})
        # those before it are judged again: their verdicts are gone with the process
        if where:
            verdicts += one({**task, "seeds": left[:where]}, seat, folder)
        left = left[where + 1 :]
    return verdicts


def fuzz(todo: list[dict[str, Any]], jobs: int, quiet: bool = False) -> list[dict[str, Any]]:
    """Verdicts on all files."""
    from campaign.pool import Seat, side_by_side

    verdicts: list[dict[str, Any]] = []
    lock, began = threading.Lock(), perf_counter()

    def do(task: dict[str, Any], seat: Seat) -> None:
        with tempfile.TemporaryDirectory() as folder:
            found = one(task, seat, Path(folder))
        with lock:
            before = len(verdicts)
            verdicts.extend(found)
            if not quiet and before // 1000 < len(verdicts) // 1000:
                done = Counter(v["outcome"] for v in verdicts)
                said = ", ".join(f"{count} {outcome}" for outcome, count in done.items())
                print(f"  {len(verdicts)} files, {perf_counter() - began:.0f} s: {said}", flush=True)

    side_by_side(todo, jobs, lambda: Seat(LIMIT, Path(__file__).resolve()), do)
    return verdicts


def tally(verdicts: list[dict[str, Any]], seconds: float) -> dict[str, Any]:
    """The record."""
    counts = Counter(v["outcome"] for v in verdicts)
    by: dict[str, Counter[str]] = {}
    for v in verdicts:
        by.setdefault(v["kind"], Counter())[v["outcome"]] += 1
    return {
        "files": len(verdicts),
        **{name: counts[name] for name in (*FINE, *FAILURES)},
        "by": {name: dict(found) for name, found in sorted(by.items())},
        "seconds": round(seconds, 1),
        "failures": [v for v in verdicts if v["outcome"] in FAILURES],
    }


def worker() -> None:
    """A process in which files are read."""
    import faulthandler
    import logging

    faulthandler.enable()
    from campaign.pool import serve
    from faulty.readers import good_file, judge

    logging.disable(logging.CRITICAL)

    def batch(task: dict[str, Any], say: Any) -> dict[str, Any]:
        folder = Path(task["folder"])
        path, good, truth = good_file(task["kind"], folder)
        path = folder / f"damaged{path.suffix}"
        verdicts = []
        for seed in task["seeds"]:
            say(f"file {seed}")
            verdicts.append(judge(task["kind"], seed, path, good, truth))
        return {"verdicts": verdicts}

    serve(batch)


def main() -> int:
    if sys.argv[1:] == ["--worker"]:
        worker()
        return 0
    parser = argparse.ArgumentParser(
        prog="./run bench fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--files", type=int, default=1000, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of all of them")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--kinds", choices=KINDS, nargs="+", default=list(KINDS), help="these files only")
    given = parser.parse_args()
    began = perf_counter()
    todo = tasks(given.files, given.seed, given.kinds)
    record = {"seed": given.seed, **tally(fuzz(todo, given.jobs), perf_counter() - began)}
    for name, found in record["by"].items():
        print(f"{name:<18} {', '.join(f'{count} {outcome}' for outcome, count in sorted(found.items()))}")
    for failure in record["failures"][:20]:
        print(f"{failure['outcome']}: {failure['kind']} {failure['seed']}: {failure.get('what', '')}"[:300])
    print(", ".join(f"{name} {record[name]}" for name in ("files", *FINE, *FAILURES)))
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(record, indent=1) + "\n")
        print(f"written to {given.json}")
    return int(bool(record["failures"]))


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    sys.exit(main())
