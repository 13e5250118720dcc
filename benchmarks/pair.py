"""Another commit beside this one, scene by scene in turns: ``./run bench pair OTHER``.

OTHER is a commit, which is built once in the user's cache folder (through its own ``./run``, so that it has
its own environment), or a folder with a checkout. One process of each stays alive: neither the import nor the
first run of a scene is measured. 15 pairs of runs follow in the order old, new, new, old, ..., on one thread;
a run is as many calls as take 0.25 s. The scenes are those of this commit, see ``pair/scenes.py``; they use
the public interface only.

**No slower** is a bench whose upper end of the 95 % interval for the median of the ratios new over old is
below 1.05 (``pair/verdict.py``); of fewer than 6 pairs there is no such interval, and times are not judged.
They are those of the processor: the clock also counts the time in which a process waits because others run,
which says nothing of the code; on a quiet machine both agree, and the clock's ratio is printed beside.

Beside the times stand a number of each answer, which must not differ by more than both say they may be off,
and what the solver did (iterations, factorisations, columns ...); counts that grew are listed. The exit code
is 1 if a bench is not shown to be no slower, fails, or its number differs.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import common

from pair.scenes import BENCHES
from pair.states import ROOT, Failed, State, source_of
from pair.verdict import SLOWER, Verdict, judged, median_interval, turns

PAIRS = 15
RUN_S = 0.25
"""Seconds of a run: a hundred times what a timer's tick or the start of a call may take."""


def measured(name: str, states: dict[str, State], pairs: int) -> dict[str, Any]:
    """Times (``cpu_s``, ``wall_s``, one a pair) and the outcome of a bench in both states."""
    first = max(each["cpu_s"] for each in in_both(states, do="prepare", name=name).values())
    repeats = max(1, math.ceil(RUN_S / max(first, 1e-3)))
    record: dict[str, Any] = {state: {"cpu_s": [0.0] * pairs, "wall_s": [0.0] * pairs} for state in states}
    for pair in range(pairs):
        for state in turns(pair, repeats):
            for clock, seconds in in_both({state: states[state]}, do="run")[state].items():
                record[state][clock][pair] += seconds
    for state, found in in_both(states, do="outcome").items():
        record[state]["outcome"] = found
    return record | {"repeats": repeats}


def in_both(states: dict[str, State], **command: Any) -> dict[str, dict[str, Any]]:
    """What states answer; if one of them fails, all are asked, and all that failed are named."""
    answers, failures = {}, {}
    for name, state in states.items():
        try:
            answers[name] = state.ask(**command)
        except Failed as error:
            failures[name] = str(error)
    if failures:
        raise Failed(failures)
    return answers


def line(verdict: Verdict) -> list[str]:
    """A row of the table."""
    same = "differs" if verdict.number_differs else "same"
    return [
        verdict.name,
        f"{verdict.old_s:.3f}",
        f"{verdict.new_s:.3f}",
        f"{verdict.ratio:.3f}",
        f"{verdict.low:.3f} to {verdict.high:.3f}",
        f"{verdict.wall_ratio:.3f}",
        verdict.word,
        f"{verdict.old.number:.8g}",
        f"{verdict.new.number:.8g}",
        f"{same} (+- {verdict.old.error + verdict.new.error:.1g})",
    ]


def report(verdicts: list[Verdict], failed: dict[str, dict[str, str]]) -> bool:
    """Print what was found; True if all is well."""
    header = ["", "old s", "new s", "ratio", "interval", "clock", "", "old number", "new number", ""]
    common.table(header, [line(each) for each in verdicts])
    for each in verdicts:
        for count, (old, new) in each.grown.items():
            print(f"  {each.name}: {count} grew from {old:g} to {new:g}")
    for name, words in failed.items():
        for state, text in words.items():
            print(f"  {name}: the {state} state failed: {text.strip().splitlines()[-1]}")
    bad = [each.name for each in verdicts if not each.passed or each.number_differs]
    bad += [name for name, words in failed.items() if "new" in words]
    timed = all(math.isfinite(each.high) for each in verdicts)
    well = f"no bench is slower (all below {SLOWER})" if timed else "no number differs; times were not judged"
    print("\n" + (f"not as before: {', '.join(bad)}" if bad else well))
    return not bad


def main() -> None:
    """Build, measure, print and write."""
    parser = argparse.ArgumentParser(
        prog="./run bench pair", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("other", metavar="OTHER", help="commit, or folder with a checkout", nargs="?")
    parser.add_argument("--only", nargs="+", choices=list(BENCHES), metavar="BENCH", help="these benches")
    parser.add_argument("--all", action="store_true", help="all benches, not only the usual sample")
    parser.add_argument("--pairs", type=int, default=PAIRS, help=f"runs of each state ({PAIRS})")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--list", action="store_true", help="print the benches, and end")
    given = parser.parse_args()
    if given.other is None and not given.list:
        parser.error("give a commit, or a folder with a checkout")
    if given.pairs < 1:
        parser.error(f"--pairs {given.pairs}: give 1 or more")
    if not math.isfinite(median_interval([1.0] * given.pairs)[1]):
        print(f"{given.pairs} pairs are too few for an interval: only numbers and counts are judged")
    names = given.only or [each.name for each in BENCHES.values() if each.usual or given.all]
    if given.list:
        print("\n".join(f"{n:26}{(BENCHES[n].function.__doc__ or '').splitlines()[0]}" for n in names))
        return
    began = perf_counter()
    records: dict[str, dict[str, Any]] = {}
    failed: dict[str, dict[str, str]] = {}
    verdicts: list[Verdict] = []
    with tempfile.TemporaryDirectory() as logs:
        print(f"building {given.other} ...", file=sys.stderr, flush=True)
        folders = {"old": source_of(given.other), "new": ROOT}
        states = {name: State(folder, Path(logs) / f"{name}.log") for name, folder in folders.items()}
        for name in names:
            try:
                records[name] = measured(name, states, given.pairs)
            except Failed as error:
                [failed[name]] = error.args
                continue
            verdicts.append(judged(name, records[name]))
            print(f"  {perf_counter() - began:6.0f} s  " + "  ".join(line(verdicts[-1])[:7]), flush=True)
        for state in states.values():
            state.end()
    print()
    well = report(verdicts, failed)
    if given.json:
        common.write_json(
            {
                "benchmark": "pair",
                "old": str(folders["old"]),
                "commit": common.commit(),
                "pairs": given.pairs,
                "seconds": perf_counter() - began,
                "benches": {each.name: records[each.name] | {"verdict": asdict(each)} for each in verdicts},
                "failed": failed,
                "environment": common.environment(),
            },
            given.json,
        )
    sys.exit(0 if well else 1)


if __name__ == "__main__":
    main()
