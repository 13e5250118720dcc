"""Stacks of 3 to 40 parts from STEP files: every pair found and no other, solved or the loose part named.

    ./run bench stacks --count 100

The pairs are known from how the stacks are made (``tests/geometry/stacks.py``): touching, 0.1 mm apart (with
``gap=0.15``), overlapping by 0.1 mm (refused by name), sharing an edge only (no pair), clearance holes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import common  # makes the tests importable
import numpy as np

from tests.geometry.stacks import judged, made


def parts_of(number: int, most: int) -> int:
    """3 to `most`, the small ones more often."""
    return round(3.0 * (most / 3.0) ** float(np.random.default_rng([number, 1]).uniform()))


def main() -> None:
    """Judge, print a line each, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first stack")
    parser.add_argument("--most", type=int, default=40, help="parts")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--only-read", action="store_true", help="do not solve")
    given = parser.parse_args()
    words: Counter[str] = Counter()
    record: dict[str, Any] = {"benchmark": "stacks", "environment": common.environment(), "stacks": []}
    pairs = wrong = 0
    for number in range(given.first, given.first + given.count):
        stack = made(number, parts_of(number, given.most))
        with tempfile.TemporaryDirectory() as folder:
            verdict = judged(stack, Path(folder), number, solve=not given.only_read)
        words[verdict.word] += 1
        record["stacks"].append(
            {
                "number": number,
                "parts": len(stack.solids),
                "pairs": len(stack.pairs),
                "verdict": verdict.word,
                "seconds": verdict.seconds,
                "missed": verdict.missed,
                "false": verdict.false,
            }
        )
        if given.json is not None:  # after each: a long run may be ended
            given.json.parent.mkdir(parents=True, exist_ok=True)
            given.json.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        pairs += len(stack.pairs)
        wrong += len(verdict.missed) + len(verdict.false)
        line = f"{number:4}  {len(stack.solids):3} parts  {len(stack.pairs):3} pairs"
        print(f"{line}  {verdict.seconds:6.1f} s  {verdict.word}", flush=True)
        if verdict.missed or verdict.false:
            print(f"      missed {verdict.missed}, false {verdict.false}", flush=True)
        if verdict.word not in ("converged", "read"):
            print("      " + verdict.said.replace("\n", "\n      ")[:400], flush=True)
    print(f"\n{given.count} stacks, {pairs} pairs, {wrong} missed or false")
    for word, count in words.most_common():
        print(f"{count:5} {word}")


if __name__ == "__main__":
    main()
