"""What parts of STEP files are taken for: fasteners and gaskets of drawn assemblies, found and false.

    ./run bench step --count 200
    ./run bench step --count 200 --held-out

The assemblies (``tests/geometry/assemblies.py`` and ``families.py``, in turns) have 3 to some 30 parts and
threads of M4 to M64. Each is judged with its names and without, and once more with all sizes of fasteners and
holes up to 5 % off the standard. Those of ``--held-out`` (``tests/geometry/heldout.py``) are of other
families, that nobody tunes on.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import Any

import common  # makes the tests importable
from scipy.stats import beta

from tests.geometry import assemblies, families, heldout
from tests.geometry.assemblies import Assembly, write
from tests.geometry.judging import COUNTED, judged


def limits(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson, 95 %."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    high = 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))
    return low, high


def share(title: str, hits: int, count: int) -> str:
    """A count with its share and limits."""
    if not count:
        return f"{title:34} none"
    low, high = limits(hits, count)
    part, span = f"{100 * hits / count:6.2f} %", f"({100 * low:.2f} to {100 * high:.2f} %)"
    return f"{title:34} {hits:5} of {count:5}  {part}  {span}"


def judge(number: int, assembly: Assembly, off: bool, sums: dict[str, Counter[Any]]) -> str:
    """One assembly, added to the sums; what is wrong with its file, if it cannot be read."""
    began = perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        file = write(assembly, Path(folder) / "assembly.step")
        try:
            verdicts = judged(assembly, file)
        except ValueError as error:  # which no assembly should raise
            print(f"{number:4}  not read: {error}", flush=True)
            return str(error)
    spent = perf_counter() - began
    print(f"{number:4}  M{assembly.d:g}  {len(assembly.parts):3} parts  {spent:6.1f} s", flush=True)
    for names, verdict in verdicts.items():
        key = f"{names}, {'up to 5 % off' if off else 'of standard size'}"
        sums.setdefault(key, Counter()).update(verdict.counts)
        for wrong in verdict.wrong:
            print(f"      {key}: {wrong}", flush=True)
    return ""


def main() -> None:
    """Draw, read, compare, print the sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first assembly")
    parser.add_argument("--held-out", action="store_true", help="of the families that nobody tunes on")
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin no assembly after these")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    given = parser.parse_args()

    def made(number: int, off: bool) -> Assembly:
        if given.held_out:
            return heldout.made(number, off)
        return (assemblies, families)[number % 2].made(number // 2, off)

    sums: dict[str, Counter[Any]] = {}
    failed, done, began = [], 0, perf_counter()
    for number in range(given.first, given.first + given.count):
        if perf_counter() - began > given.seconds:
            break
        done += 1
        failed += [text for off in (False, True) if (text := judge(number, made(number, off), off, sums))]
    for key, counts in sums.items():
        print(f"\n{key}")
        for kind in COUNTED:
            print(share(f"  {kind}s found", counts[kind, "found"], counts[kind, "there"]))
        found, there = (sum(counts[kind, word] for kind in COUNTED) for word in ("found", "there"))
        print(share("  all of these found", found, there))
        print(share("  sizes right of those found", counts["sizes"], counts["sized"]))
        print(share("  others taken for one", counts["false"], counts["others"]))
        print(share("  studs and dowels found", counts["more found"], counts["more there"]))
    print(f"\n{done} assemblies, two files each, {len(failed)} not read, {perf_counter() - began:.0f} s")
    if given.json is not None:
        record: dict[str, Any] = {"benchmark": "step", "environment": common.environment(), "failed": failed}
        record["sums"] = {key: {str(k): v for k, v in counts.items()} for key, counts in sums.items()}
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
