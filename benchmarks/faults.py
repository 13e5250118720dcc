"""Faults in the middle of runs: is anything lost, wrong, unreadable, or without an end?

Each run draws a computation (a sweep, a sampling, ``errors()``, ``accuracy=``), a fault and its moment from
its seed, in processes that may die: writes to the checkpoint that fail (full, read-only, locked, removed), an
exception or Ctrl-C at a call of the kernel, an iteration or a statement of the database, kill -9 there, the
same while a result is saved, and two ranks of which one is killed. ``faulty/`` has the pieces; the library is
patched from outside.

Afterwards every object that was there before must answer with the same bits, the file must be readable with
every point that was said to be written, and the same call again must give the numbers of an undisturbed run:
to the same bits where there is no checkpoint, to 30 rtol (of 1e-8) where a run goes on from one, because its
points start from other neighbours.

Outcomes: ``right``, ``wrong``, ``lost``, ``changed``, ``unreadable``, ``raised``, ``crashed``, ``hung``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import Any

OUTCOMES = ("right", "wrong", "lost", "changed", "unreadable", "raised", "crashed", "hung")
WORKS = ("sweep", "sampling", "errors", "accuracy")
LIMIT = 60.0
"""Seconds until a run counts as one without an end."""


def drawn(campaign: int, number: int) -> dict[str, Any]:
    """The task of a run."""
    seed = int(hashlib.sha256(f"faults {campaign} {number}".encode()).hexdigest()[:12], 16)
    choice = random.Random(seed)
    work = WORKS[number % len(WORKS)]
    faults = {"exception": 4, "interrupt": 2, "kill": 3, "save": 2}
    if work in ("sweep", "sampling"):
        faults |= {"write": 4}
    if work == "sampling":
        faults |= {"rank": 3}
    fault = choice.choices(list(faults), list(faults.values()))[0]
    return {"number": number, "seed": seed, "work": work, "fault": fault}


def one(task: dict[str, Any], seat: Any) -> dict[str, Any]:
    """The verdict on a run."""
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / "run"
        folder.mkdir()
        whole = {**task, "folder": str(folder)}
        verdict = seat.run(whole)
        died = verdict["outcome"] == "crashed"
        if died and "SIGKILL" in verdict["what"] and task["fault"] in ("kill", "save"):
            kept = re.search(r"died in kept (\d+)", verdict["what"])
            verdict = seat.run({**whole, "resume": True, "kept": int(kept[1]) if kept else 0})
        if verdict["outcome"] == "crashed" and "no end of" in verdict["what"]:
            verdict["outcome"] = "hung"
    return {**task, **verdict}


def campaign(tasks: list[dict[str, Any]], jobs: int, quiet: bool = False) -> list[dict[str, Any]]:
    """Verdicts on some runs."""
    from campaign.pool import Seat, side_by_side

    verdicts: list[dict[str, Any]] = []
    lock, began = threading.Lock(), perf_counter()

    def do(task: dict[str, Any], seat: Seat) -> None:
        verdict = one(task, seat)
        with lock:
            verdicts.append(verdict)
            if not quiet and verdict["outcome"] != "right":
                print(line(verdict), flush=True)
            if not quiet and len(verdicts) % 50 == 0:
                print(f"  {len(verdicts)} runs, {perf_counter() - began:.0f} s", flush=True)

    side_by_side(tasks, jobs, lambda: Seat(LIMIT, Path(__file__).resolve()), do)
    return sorted(verdicts, key=lambda v: v["number"])


def line(verdict: dict[str, Any]) -> str:
    """A run that did not go right."""
    head = f"{verdict['outcome']:<11}{verdict['number']:>5} {verdict['work']} {verdict['fault']}"
    return f"{head}: {verdict.get('what', '')} {' '.join(verdict.get('errors', [])[-2:])}"[:600]


def tally(verdicts: list[dict[str, Any]], seconds: float) -> dict[str, Any]:
    """The record."""
    counts = Counter(v["outcome"] for v in verdicts)
    by: dict[str, Counter[str]] = {}
    for v in verdicts:
        by.setdefault(f"{v['work']}, {v['fault']}", Counter())[v["outcome"]] += 1
    differences = [v["difference"] for v in verdicts if v.get("difference") is not None]
    return {
        "runs": len(verdicts),
        **{name: counts[name] for name in OUTCOMES},
        "by": {name: dict(found) for name, found in sorted(by.items())},
        "largest_difference": max(differences, default=None),
        "same_bits": sum(d == 0.0 for d in differences),
        "seconds": round(seconds, 1),
        "failures": [v for v in verdicts if v["outcome"] != "right"],
    }


def worker() -> None:
    """One of the processes in which runs are disturbed."""
    import faulthandler
    import logging

    faulthandler.enable()
    from campaign.pool import serve
    from faulty.judge import disturb, resume

    logging.disable(logging.CRITICAL)

    def judge(task: dict[str, Any], say: Any) -> dict[str, Any]:
        return resume(task) if task.get("resume") else disturb(task, say)

    serve(judge)


def main() -> int:
    if sys.argv[1:] == ["--worker"]:
        worker()
        return 0
    if sys.argv[1:2] == ["--ranked"]:
        from faulty.judge import on_ranks

        on_ranks(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
        return 0
    parser = argparse.ArgumentParser(
        prog="./run bench faults", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of all of them")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--only", type=int, help="one run by its number")
    given = parser.parse_args()
    numbers = range(given.runs) if given.only is None else [given.only]
    began = perf_counter()
    verdicts = campaign([drawn(given.seed, number) for number in numbers], given.jobs)
    record = {"seed": given.seed, **tally(verdicts, perf_counter() - began)}
    if given.only is not None:
        print(verdicts[0])
    for name, found in record["by"].items():
        print(f"{name:<22} {', '.join(f'{count} {outcome}' for outcome, count in found.items())}")
    print(", ".join(f"{name} {record[name]}" for name in ("runs", *OUTCOMES)))
    print(f"largest difference {record['largest_difference']}, the same bits in {record['same_bits']}")
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(record, indent=1) + "\n")
        print(f"written to {given.json}")
    return int(record["right"] < record["runs"])


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    sys.exit(main())
