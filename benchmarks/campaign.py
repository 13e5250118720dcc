"""Random scenes against independent references: how often is "converged" wrong?

Each scene is drawn from its own seed, solved with random settings in a process of its own, and compared with
a reference that is not the kernel: for every part, every step, mean and fluctuation. ``campaign/`` has the
pieces: ``scenes`` (what is drawn), ``reference`` (the truth), ``measure`` (the norms), ``judge`` (the
verdict), ``pool`` (the processes).

Outcomes: ``right``; ``wrong`` (says converged, and some error is above three tolerances or above three times
what the result says, or forces break a law or the balance of a part); ``not_converged`` (though there is an
answer); ``raised`` (an exception though there is an answer); ``crashed`` (the process died or did not end).
Outside of these: ``several`` (another answer than the reference's that holds the laws and the balance of all
parts), ``refused`` (an exception where there is no answer), ``rounding`` (not converged, and double precision
does not allow the tolerance), ``unjudged`` (no reference was found, or not in time: printed).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import threading
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import Any

OUTCOMES = ("right", "wrong", "not_converged", "raised", "crashed")
OTHERS = ("several", "refused", "rounding", "unjudged")
PRINTED = (*OUTCOMES[1:], "unjudged")
PERCENTILES = (1, 5, 10, 25, 50, 75, 90, 95, 99)
WITHIN = (1.0 / 3.0, 5.0)


def seed_of(campaign: int, number: int, family: str | None) -> int:
    """Seed of a scene: even ones are dev, odd ones held out."""
    from campaign.scenes import FAMILIES

    seed = int(hashlib.sha256(f"{campaign} {number}".encode()).hexdigest()[:14], 16)
    return seed if family is None else seed - seed % 2 + FAMILIES.index(family)


def tally(verdicts: list[dict[str, Any]], given: dict[str, Any], seconds: float) -> dict[str, Any]:
    """The record of a campaign."""
    counts = Counter(v["outcome"] for v in verdicts)
    ratios = [v["ratio"] for v in verdicts if v.get("ratio") is not None]
    within = sum(WITHIN[0] <= r <= WITHIN[1] for r in ratios)
    bad = [v for v in verdicts if v["outcome"] in OUTCOMES[1:]]
    record: dict[str, Any] = {"scenes": len(verdicts)}
    record |= {name: counts[name] for name in (*OUTCOMES, *OTHERS)}
    record["estimate_within"] = within / len(ratios) if ratios else None
    record["estimates"] = len(ratios)
    record["estimate_percentiles"] = {
        mark: sorted(ratios)[mark * (len(ratios) - 1) // 100] for mark in PERCENTILES if ratios
    }
    about = ("seed", "ratio", "said", "true", "kind", "rtol", "status", "outcome")
    record["estimates_outside"] = [
        {name: v.get(name) for name in about}
        for v in verdicts
        if v.get("ratio") is not None and not WITHIN[0] <= v["ratio"] <= WITHIN[1]
    ]
    for outcome in ("wrong", "not_converged"):
        record[f"{outcome}_by"] = dict(Counter(v["why"] for v in verdicts if v["outcome"] == outcome))
    honest = [v for v in verdicts if v["outcome"] == "wrong" and v.get("whole") is not None]
    over = [v for v in honest if v["whole"] > 3.0 * v["rtol"] or v["whole"] > 3.0 * v["said"]]
    record["wrong_in_one_number"] = len(over)
    record["by_kind"] = _by(verdicts, lambda v: v.get("kind", ""))
    record["by_family"] = _by(verdicts, lambda v: v.get("family", ""))
    record["options"] = given
    record["seconds"] = round(seconds, 1)
    record["seconds_a_scene"] = _seconds(verdicts)
    keys = ("seed", "outcome", "why", "what", "about", "family", "kind", "rtol", "status", "iterations")
    more = ("said", "true", "whole", "ratio", "rounding", "reference", "attempt", "errors", "seconds")
    record["failures"] = [{k: v.get(k) for k in (*keys, *more, "script")} for v in bad]
    few = ("seed", "outcome", "what", "about", "status")
    rest = [v for v in verdicts if v["outcome"] in OTHERS]
    record["others"] = [{k: v.get(k) for k in few} for v in rest]
    return record


def _by(verdicts: list[dict[str, Any]], key: Any) -> dict[str, dict[str, int]]:
    out: dict[str, Counter[str]] = {}
    for v in verdicts:
        out.setdefault(key(v), Counter())[v["outcome"]] += 1
    return {name: dict(counts) for name, counts in sorted(out.items())}


def _seconds(verdicts: list[dict[str, Any]]) -> dict[str, float]:
    total: Counter[str] = Counter()
    for v in verdicts:
        total.update(v.get("seconds") or {})
    return {name: round(value / max(1, len(verdicts)), 3) for name, value in total.items()}


def line(verdict: dict[str, Any]) -> str:
    """A failing scene in one line."""
    about = verdict.get("about") or ""
    return f"{verdict['outcome']:<14}{verdict['seed']}  {about}: {verdict.get('what', '')}"


def campaign(seeds: list[int], jobs: int, limit: float, quiet: bool = False) -> list[dict[str, Any]]:
    """Verdicts on the scenes of some seeds, in the order of the seeds."""
    from campaign.pool import Seat, ranked, side_by_side
    from campaign.scenes import family_of, scene

    verdicts: list[dict[str, Any] | None] = [None] * len(seeds)
    lock, done, began = threading.Lock(), Counter(), perf_counter()

    def do(k: int, seat: Seat) -> None:
        drawn = scene(seeds[k])
        task: dict[str, Any] = {"seed": seeds[k], "family": family_of(seeds[k])}
        task |= {"kind": drawn.kind, "about": drawn.about}
        verdict = ranked(task, limit) if drawn.ranks > 1 else seat.run(task)
        if verdict.get("script", "") == "":
            from campaign.scenes import script

            last = scene(seeds[k], verdict["attempt"], None, drawn.ranks)
            verdict["about"], verdict["script"] = last.about, script(last)
        verdicts[k] = verdict
        with lock:
            done[verdict["outcome"]] += 1
            count = sum(done.values())
            if not quiet and verdict["outcome"] in PRINTED:
                print(line(verdict)[:240], flush=True)
            if not quiet and count % 50 == 0:
                spent = perf_counter() - began
                said = ", ".join(f"{n} {o}" for o, n in done.most_common())
                print(f"  {count} scenes, {spent:.0f} s: {said}", flush=True)

    side_by_side(range(len(seeds)), jobs, lambda: Seat(limit), do)
    return [v for v in verdicts if v is not None]


def worker() -> None:
    """One of the pool's processes."""
    import faulthandler
    import logging
    import resource

    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_DATA, (6 * 2**30, 6 * 2**30))
    from campaign.judge import judge, one
    from campaign.pool import serve
    from campaign.scenes import Scene

    logging.disable(logging.CRITICAL)

    def verdict(task: dict[str, Any], phase: Any) -> dict[str, Any]:
        if "source" in task:
            given = Scene(task["seed"], "", task["kind"], task["source"], task["rtol"], 1, "given")
            return one(given, phase).record()
        return judge(task["seed"], phase).record()

    serve(verdict)


def on_ranks(seed: int, file: Path) -> None:
    """A scene on all ranks of mpirun."""
    import logging

    from campaign.judge import judge_ranked
    from mpi4py import MPI

    logging.disable(logging.CRITICAL)
    verdict = judge_ranked(seed, MPI.COMM_WORLD)
    if MPI.COMM_WORLD.rank == 0:
        file.write_text(json.dumps(verdict.record()))


def main() -> int:
    if len(sys.argv) == 2 and sys.argv[1] == "--worker":
        worker()
        return 0
    if len(sys.argv) == 4 and sys.argv[1] == "--ranked":
        on_ranks(int(sys.argv[2]), Path(sys.argv[3]))
        return 0
    parser = argparse.ArgumentParser(
        prog="./run bench campaign", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=100, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the campaign")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--only", type=int, help="one scene by its own seed, with its script")
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds a scene")
    parser.add_argument("--family", choices=("dev", "held-out"), help="draw from one generator only")
    parser.add_argument("--scripts", type=Path, help="folder for a script of every failing scene")
    parser.add_argument("--check", action="store_true", help="an error if a scene is wrong or crashed")
    given = parser.parse_args()
    began = perf_counter()
    if given.only is not None:
        seeds = [given.only]
    else:
        seeds = [seed_of(given.seed, k, given.family) for k in range(given.scenes)]
    verdicts = campaign(seeds, given.jobs, given.time_limit)
    options = {k: str(v) if isinstance(v, Path) else v for k, v in vars(given).items()}
    record = tally(verdicts, options, perf_counter() - began)
    if given.only is not None and verdicts:
        print(verdicts[0]["script"])
        print({k: v for k, v in verdicts[0].items() if k != "script"})
    if given.scripts is not None:
        given.scripts.mkdir(parents=True, exist_ok=True)
        for failure in record["failures"]:
            (given.scripts / f"{failure['outcome']}_{failure['seed']}.py").write_text(failure["script"])
    print(", ".join(f"{name} {record[name]}" for name in ("scenes", *OUTCOMES, *OTHERS)))
    for outcome in ("wrong", "not_converged"):
        said = ", ".join(f"{name} {count}" for name, count in sorted(record[f"{outcome}_by"].items()))
        print(f"{outcome} by: {said or '-'}")
    share = record["estimate_within"]
    said = "-" if share is None else f"{100.0 * share:.1f} %"
    print(f"estimates within 1/3 .. 5: {said} of {record['estimates']}")
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(record, indent=1) + "\n")
        print(f"written to {given.json}")
    return int(given.check and record["wrong"] + record["crashed"] > 0)


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    sys.exit(main())
