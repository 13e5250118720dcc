"""Speed against accuracy: what each digit of an answer costs with every method, on three scenes.

    ./run python demos/tradeoff.py                    coarse meshes, a minute or two
    ./run python demos/tradeoff.py --scenes vessel    one scene: vessel, lap or field
    ./run python demos/tradeoff.py --read FILE        a record of ./run bench tradeoff --json FILE

Problem
    The bolted vessel with two random stiffnesses, the bolted lap joint with random friction and bolts, and
    the vessel with a random field as the stiffness of its joint. Mean and standard deviation of one force
    are to be computed to 10 %, 1 %, 0.1 % or 0.01 %, at the least cost.

Method
    Every method is run with many settings: LATIN-PCE with different tolerances, orders, index sets, depths of
    the acceleration and operators; monolithic SSFEM; tensor and sparse quadrature; Monte Carlo and
    quasi-Monte Carlo; then different mesh sizes, degrees and interface spaces. The true error of each run is
    known from a much tighter run. One unit is a direct solution of the scene's base mesh, measured in the
    same run.

Answers
    A table and a figure for each scene: error against cost, with the front of the best settings. To read the
    figure, start from the accuracy that you need: the front shows the least cost at which it can be had. One
    picture shows errors on the same mesh, the other total errors (including that of the mesh), because a
    tolerance far below the error of the mesh gains nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))
OUTPUT = ROOT / "build" / "output" / "tradeoff"


class Progress:
    """One line that counts the runs, on a terminal; otherwise one line per scene."""

    def __init__(self) -> None:
        self.count = 0
        self.began = perf_counter()

    def __call__(self, line: str) -> None:
        if " units " in line:
            self.count += 1
            if sys.stdout.isatty():
                print(f"\r  {self.count} runs, {perf_counter() - self.began:.0f} s", end="", flush=True)
            return
        if sys.stdout.isatty() and self.count:
            print()
        print(line, flush=True)


def check(record: Mapping[str, Any]) -> None:
    """References agree, tight settings are right, and nothing on the front is beaten."""
    for name, scene in record["scenes"].items():
        same = scene["references"]["same"]
        assert same["status"] == ["converged", "converged"], f"{name}: a reference did not converge"
        # two methods (or rules), far below what is compared
        assert same["own_error"] < 1e-4, f"{name}: references differ by {same['own_error']:.1e}"
        best = min(r["error"] for r in scene["runs"] if r["error"] is not None)
        assert best < 1e-3, f"{name}: no setting comes below {best:.1e}"
        for each in scene["accuracy"]:
            if each["error"] is not None:
                # a promise for 95 % of the cases; estimates are right within a factor of three
                assert each["error"] <= 3.0 * each["asked"], f"{name}: accuracy={each['asked']} was not kept"


def main(given: Sequence[str] | None = None) -> None:
    """Measure or read, print, draw, check."""
    import tradeoff as bench  # of benchmarks, which is on the path now

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--read", type=Path, help="record of ./run bench tradeoff --json FILE")
    parser.add_argument("--scenes", nargs="+", choices=("vessel", "lap", "field"), help="only these")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder of the figure")
    parser.add_argument("--no-figures", action="store_true", help="write no figure")
    options = parser.parse_args(given)
    if options.read is not None:
        record = json.loads(options.read.read_text(encoding="utf-8"))
        chosen = options.scenes or list(record["scenes"])
        record["scenes"] = {name: record["scenes"][name] for name in chosen}
    else:
        progress = Progress()
        record = bench.measure_all(True, options.scenes, 1, progress)
        print(f"\n{progress.count} runs in {perf_counter() - progress.began:.0f} s")
    bench.report(record)
    if not options.no_figures:
        paths = bench.figure(record, options.output)
        print(f"\nwrote {', '.join(path.name for path in paths)} to {options.output}")
    check(record)
    print("all checks passed")


if __name__ == "__main__":
    main()
