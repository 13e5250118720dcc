"""The frozen corpus: scenes solved again and held against what an earlier state answered.

``frozen/`` has the scenes and the file. Every scene runs in a process of its own, with limits of processor
time and memory. What is different beyond the errors that were said at the freeze is listed, and so are counts
that grew; a difference that has no row in ``frozen/differences.md`` is a failure. ``--freeze`` writes what
the library answers now into the file: of the groups and scenes that are chosen only, the others are kept.
``--accept`` enters the new answers of scenes all of whose differences have a row, and of those that were bad
and are right now: a later state is held against them. ``--recount REASON`` enters the counts of scenes that
answer what they must; the reason stands in the file and is printed where counts grow again.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frozen.store import Record

MAIN = Path(__file__).resolve()
RTOL = 1e-9
"""That scenes are solved with."""
MEMORY = 6 * 2**30
"""Bytes that a scene may take."""
LIMIT, JUDGED = 60.0, 300.0
"""Seconds of processor time of a drawn scene; with the judge, at the freeze."""
SLOWER = 20.0
"""Wall time over processor time, on a busy machine, after which a scene hangs."""
OFTEN = 25
"""Scenes after which a freeze is written."""


# --- worker: parent of the processes of the scenes ---------------------------------------------------
def worker() -> None:
    """Serves scenes, each in a child that begins as all others do."""
    import faulthandler
    import logging
    from importlib import import_module
    from pkgutil import iter_modules

    import dolfinx_frontend as lf
    import frozen
    from campaign.pool import serve
    from frozen import drawn
    from frozen.registry import SCENES

    faulthandler.enable()
    logging.disable(logging.CRITICAL)
    for module in iter_modules(frozen.__path__, "frozen."):
        import_module(module.name)

    def do(task: Record, phase: Any) -> Record:
        if task.get("list"):
            known = {name: _about(each) for name, each in SCENES.items()}
            return {
                "library": str(Path(lf.__file__).resolve().parent),
                "scenes": known,
                "drawn": drawn.names(),
            }
        return in_child(lambda: _scene(task, phase), task["limit"])

    serve(do)


def _about(scene: Any) -> Record:
    right = {
        key: [each.value, each.tolerance * (abs(each.value) or 1.0), each.source]
        for key, each in scene.right.items()
    }
    return {"limit": scene.limit, "known_bad": scene.known_bad, "right": right}


def _scene(task: Record, phase: Any) -> Record:
    import warnings

    from frozen import drawn
    from frozen.registry import SCENES

    if "seed" in task:
        return drawn.frozen(task["seed"], phase)
    if "source" in task:
        return drawn.solved(task)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return drawn.answered(SCENES[task["name"]].function(RTOL), RTOL, few=False)
        except Exception as error:  # whatever it is, it is what the scene says
            return drawn.refused(error)


def in_child(work: Any, limit: float) -> Record:
    """What is made in a child of this process, which may die or take too long."""
    import resource
    import signal
    import traceback

    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(source)
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 5))
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            with os.fdopen(sink, "w") as file:
                json.dump(work(), file)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)  # not by MPI's end, which is the parent's
    os.close(sink)
    with os.fdopen(source) as file:
        text = file.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code == 0:
        found: Record = json.loads(text)
        return found
    what = f"code {code}" if code > 0 else signal.Signals(-code).name
    if code == -signal.SIGXCPU:
        what = f"no end within {limit:g} s of processor time"
    return {"outcome": "crashed", "what": what}


# --- parent ------------------------------------------------------------------------------------------
def python_of(library: Path | None) -> str:
    """The Python of this build, or that of another clone."""
    if library is None:
        return sys.executable
    # of the same environment as this one's: build/ENVIRONMENT/venv/bin/python
    beside = library.resolve() / "build" / Path(sys.prefix).parent.name / "venv" / "bin" / "python"
    if not beside.exists():
        raise SystemExit(
            f"{library} is not built here: cd {library} && ./run python -c 'import dolfinx_frontend'"
        )
    return str(beside)


def commit(folder: Path) -> str:
    asked = ["git", "-C", str(folder), "rev-parse", "--short", "HEAD"]
    return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def solve(tasks: list[Record], jobs: int, python: str, done: Any) -> None:
    """All tasks in processes of their own; `done` is told each record, one at a time."""
    from campaign.pool import Seat, side_by_side

    lock = threading.Lock()

    def do(task: Record, seat: Seat) -> None:
        seat.limit = SLOWER * task["limit"]
        began = perf_counter()
        found = seat.run(task)
        record = {"name": task["name"], "outcome": found["outcome"], **_nothing(), **found}
        for key in ("seed", "limit", "attempt", "errors", "seconds"):
            record.pop(key, None)
        with lock:
            done(record, perf_counter() - began)

    side_by_side(tasks, jobs, lambda: Seat(LIMIT, MAIN, python), do)


def _nothing() -> Record:
    return {"values": {}, "words": {}, "said": {}, "counts": {}, "missing": []}


def tasks_of(names: list[str], known: Record, old: dict[str, Record], freeze: bool) -> list[Record]:
    """What the workers are asked."""
    out = []
    for name in names:
        task: Record = {"name": name}
        if name in known["scenes"]:
            task["limit"] = known["scenes"][name]["limit"]
        elif freeze:
            task |= {"seed": int(name.split("/")[1]), "limit": JUDGED}
        else:
            task |= {key: old[name][key] for key in ("source", "kind", "rtol", "right") if key in old[name]}
            task["limit"] = LIMIT
        out.append(task)
    return out


def listed(python: str, library: Path | None) -> Record:
    """Scenes that there are, as a worker of that build says."""
    from campaign.pool import Seat

    seat = Seat(600.0, MAIN, python)
    known = seat.run({"list": True})
    seat.close()
    if "scenes" not in known:
        raise SystemExit("\n".join([known["what"], *known["errors"]]))
    wanted = (library or MAIN.parents[1]).resolve()
    if Path(known["library"]).parent != wanted:
        raise SystemExit(f"the library is that of {known['library']}, not of {wanted}")
    return known


def freeze(given: argparse.Namespace, python: str, known: Record) -> int:
    from frozen import compare, store

    head, records = store.read(given.file)
    names = store.chosen([*known["scenes"], *known["drawn"]], given.only, given.groups)
    if given.new:
        names = [name for name in names if name not in records]
    if not given.only and not given.new:
        gone = [n for n in store.chosen(records, None, given.groups) if n not in names]
        records = {name: each for name, each in records.items() if name not in gone}
    kept = {"counted": head["counted"]} if "counted" in head and (given.only or given.new) else {}
    head = kept | {"commit": commit(given.library or MAIN.parents[1]), "rtol": RTOL}
    count, told = 0, Counter[str]()

    def done(record: Record, seconds: float) -> None:
        nonlocal count
        name = record["name"]
        record |= {"group": name.split("/")[0]}
        if name in known["scenes"]:
            about = known["scenes"][name]
            record |= {key: about[key] for key in ("right", "known_bad") if about[key]} | {"rtol": RTOL}
            missed = ", ".join(sorted(compare.missed(record)))
            if missed and not about["known_bad"]:
                record["known_bad"] = f"misses the right values of {missed}"
                print(f"{name}: {record['known_bad']}", flush=True)
        elif record["outcome"] == "crashed":
            print(f"{name}: {record.get('what')}: not kept", flush=True)
            told["not kept"] += 1
            return
        records[name] = record
        count += 1
        told[record.get("verdict", record["outcome"])] += 1
        if count % OFTEN == 0:
            store.write(records, head, given.file)
            print(
                f"{count} of {len(names)}: " + ", ".join(f"{n} {k}" for k, n in told.most_common()),
                flush=True,
            )

    solve(tasks_of(names, known, records, True), given.jobs, python, done)
    size = store.write(records, head, given.file)
    print(
        f"{count} scenes frozen at {head['commit']}: " + ", ".join(f"{n} {k}" for k, n in told.most_common())
    )
    print(f"{len(records)} scenes in {given.file}, {size} bytes")
    if size > store.LARGEST:
        print(f"that is more than {store.LARGEST} bytes")
        return 1
    return 0


def check(given: argparse.Namespace, python: str, known: Record) -> int:
    from frozen import compare, store

    head, records = store.read(given.file)
    names = store.chosen(records, given.only, given.groups)
    there = store.chosen([*known["scenes"], *known["drawn"]], given.only, given.groups)
    if not names and not there:
        raise SystemExit(f"no scene of {given.groups or 'all groups'} fits {given.only or '*'}")
    absent = [name for name in names if "source" not in records[name] and name not in known["scenes"]]
    unknown = [name for name in there if name in known["scenes"] and name not in records]
    found: dict[str, Record] = {}
    seconds: dict[str, float] = {}

    def done(record: Record, spent: float) -> None:
        name = record["name"]
        if name in known["scenes"]:
            record["right"] = known["scenes"][name]["right"]
        found[name], seconds[name] = record, round(spent, 2)
        for each in compare.differences(records[name], record)[:5]:
            print(each, flush=True)
        if len(found) % 100 == 0:
            print(f"  {len(found)} of {len(names)} scenes", flush=True)

    solve(tasks_of([n for n in names if n not in absent], known, records, False), given.jobs, python, done)
    different = [each for name in sorted(found) for each in compare.differences(records[name], found[name])]
    different += [compare.Difference(name, "scene", "vanished", "a scene", "nothing") for name in absent]
    different += [compare.Difference(name, "record", "vanished", "a record", "nothing") for name in unknown]
    table = store.rows(store.DIFFERENCES.read_text(encoding="utf-8"))
    open_ = [each for each in different if store.excusing(table, each.scene, each.key) is None]
    grown = [each for name in sorted(found) for each in compare.grown(records[name], found[name])]
    better = [name for name in sorted(found) if compare.mended(records[name], found[name])]
    _report(found, different, open_, grown, better, head.get("counted", head["commit"]))
    if given.accept:
        state = commit(given.library or MAIN.parents[1])
        for name in {each.scene for each in different} - {each.scene for each in open_} - {*absent, *unknown}:
            records[name] = store.accepted(records[name], found[name], table, state)
        for name in better:
            kept = {key: each for key, each in records[name].items() if key not in ("known_bad", "what")}
            records[name] = kept | found[name] | {"accepted": state}
    if given.recount:
        for name in found.keys() - {each.scene for each in open_}:
            records[name] = {**records[name], "counts": found[name]["counts"]}
        head["counted"] = f"{commit(given.library or MAIN.parents[1])}: {given.recount}"
    if given.accept or given.recount:
        store.write(records, head, given.file)
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(
            json.dumps(
                {
                    "scenes": len(found),
                    "differences": [vars(each) | {"excused": each not in open_} for each in different],
                    "counts": [vars(each) for each in grown],
                    "mended": better,
                    "seconds": seconds,
                },
                indent=1,
            )
            + "\n"
        )
    return int(bool(open_))


def _report(
    found: dict[str, Record],
    different: list[Any],
    open_: list[Any],
    grown: list[Any],
    better: list[str],
    counted: str,
) -> None:
    scenes = len({each.scene for each in open_})
    if grown:
        print(f"\ncounts that grew: {len(grown)}, in {len({each.scene for each in grown})} scenes")
        print(f"  against those of {counted}")
        for key, many in Counter(each.key.split(".")[-1] for each in grown).most_common():
            print(f"  {key}: {many} times")
        for each in grown[:200]:
            print(f"  {each}")
    if better:
        print(f"\nno longer bad: {', '.join(better)}")
    if open_:
        print(f"\ndifferences in {scenes} scenes:")
        for each in open_:
            print(f"  {each}")
    excused = len(different) - len(open_)
    said = f", {excused} with a row in differences.md" if excused else ""
    print(
        f"\n{len(found)} scenes: {len(open_)} differences in {scenes} scenes{said}, {len(grown)} counts grew"
    )


def main() -> int:
    if sys.argv[1:] == ["--worker"]:
        worker()
        return 0
    from frozen import store

    parser = argparse.ArgumentParser(
        prog="./run bench frozen", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--freeze", action="store_true", help="write what the library answers now")
    parser.add_argument(
        "--new", action="store_true", help="with --freeze: only scenes that are not in the file"
    )
    parser.add_argument("--accept", action="store_true", help="enter answers that have a row or are mended")
    parser.add_argument("--recount", metavar="REASON", help="enter the counts of now, and why they grew")
    parser.add_argument("--groups", help="some of them, e.g. joints,cases")
    parser.add_argument(
        "--only", metavar="PATTERN", help="scenes whose name has it, or fits it as in a shell"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument(
        "--library", type=Path, metavar="FOLDER", help="another clone, whose build solves the scenes"
    )
    parser.add_argument("--file", type=Path, default=store.FILE, help="of the corpus")
    parser.add_argument("--json", type=Path, help="file to write the differences to")
    given = parser.parse_args()
    python = python_of(given.library)
    known = listed(python, given.library)
    return freeze(given, python, known) if given.freeze else check(given, python, known)


if __name__ == "__main__":
    sys.path.insert(0, str(MAIN.parent))
    sys.exit(main())
