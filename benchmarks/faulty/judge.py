"""One disturbed run, and what is left afterwards."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from faulty import injection
from faulty.injection import Clock, ticking
from faulty.work import WITHIN, WORK, Work, difference

MAIN = Path(__file__).resolve().parent.parent / "faults.py"


@cache
def undisturbed(name: str) -> tuple[Any, dict[str, np.ndarray], dict[str, np.ndarray], int]:
    """Objects, what they answer, what the run gives, and its ticks."""
    work = WORK[name]
    objects = work.build()
    before = work.before(objects)
    clock = Clock()
    with tempfile.TemporaryDirectory() as folder, ticking(clock):
        truth = work.numbers(work.run(objects, Path(folder) / "points"))
    return objects, before, truth, clock.count


def kept(path: Path) -> dict[int, bytes]:
    """The points in a checkpoint, as they are stored, if it is readable."""
    if not path.exists() or path.stat().st_size == 0:
        return {}
    with closing(sqlite3.connect(path)) as db:
        if db.execute("select count(*) from sqlite_master").fetchone() == (0,):
            return {}
        assert db.execute("pragma quick_check").fetchone() == ("ok",)
        return dict(db.execute("select number, arrays from point"))


def disturb(task: dict[str, Any], say: Callable[[str], None]) -> dict[str, Any]:
    """Do it, with the fault; what the objects of this process answer afterwards, and the run that goes on."""
    name, fault, folder = task["work"], task["fault"], Path(task["folder"])
    work = WORK[name]
    random = np.random.default_rng(task["seed"])
    if fault == "rank":
        return _rank(random, say)
    if fault == "save":
        return _save(task, random, say)
    objects, before, truth, ticks = undisturbed(name)
    path = folder / "points"
    clock, ended, out = Clock(int(random.integers(ticks))), "whole", None
    if fault == "kill":
        clock.action = injection.kill
    elif fault == "exception":
        clock.action = injection.raising(str(random.choice(["memory", "keyboard", "value", "unknown"])))
    elif fault == "interrupt":
        clock.action = injection.pressing(int(random.integers(1, 3)))
    say("run")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if fault == "write":
                kind = str(random.choice(["full", "read-only", "lock", "removed", "folder", "size"]))
                first, count = int(random.integers(0, 12)), int(random.integers(1, 13))
                clock.where = f"writes {first} to {first + count}: {kind}"
                with injection.failing_writes(kind, first, count, folder):
                    out = work.run(objects, path)
            else:
                with ticking(clock), injection.telling(lambda: say(f"kept {len(kept(path))}")):
                    out = work.run(objects, path)
        except (Exception, KeyboardInterrupt) as error:
            ended = type(error).__name__
    what = f"{fault} at tick {clock.at} of {ticks} ({clock.where}), ended: {ended}"
    say("after")
    return _judged(task, work, objects, before, truth, out, what, fault)


def _judged(
    task: dict[str, Any],
    work: Work,
    objects: Any,
    before: dict[str, np.ndarray],
    truth: dict[str, np.ndarray],
    out: Any,
    what: str,
    fault: str,
) -> dict[str, Any]:
    def verdict(outcome: str, why: str = "") -> dict[str, Any]:
        return {**task, "outcome": outcome, "what": f"{what} {why}".strip()}

    try:
        if difference(work.before(objects), before) != 0.0:
            return verdict("changed", "an object answers differently")
    except Exception as error:
        return verdict("changed", f"an object raises {type(error).__name__}: {error}")
    if fault == "write":
        if out is None:
            return verdict("lost", "the run ended without its results")
        if difference(work.numbers(out), truth) != 0.0:
            return verdict("wrong", "the run that could not write has other numbers")
    if fault == "exception" and out is not None and difference(work.numbers(out), truth) != 0.0:
        return verdict("wrong", "the disturbed run has other numbers")
    return resumed(task, work, objects, truth, what)


def resumed(
    task: dict[str, Any], work: Work, objects: Any, truth: dict[str, np.ndarray], what: str
) -> dict[str, Any]:
    """The run that goes on: the same numbers, and the points that were there are still there."""
    path = Path(task["folder"]) / "points"
    found: dict[str, Any] = {**task, "what": what}
    try:
        there = kept(path)
    except Exception as error:
        return {**found, "outcome": "unreadable", "what": f"{what} {type(error).__name__}: {error}"}
    if len(there) < task.get("kept", 0):
        return {**found, "outcome": "lost", "what": f"{what}: {len(there)} points of {task['kept']}"}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            numbers = work.numbers(work.run(objects, path))
    except Exception as error:
        return {**found, "outcome": "raised", "what": f"{what} {type(error).__name__}: {error}"}
    off = difference(numbers, truth)
    found |= {"difference": off, "kept": len(there)}
    if off > (WITHIN if work.checkpoint else 0.0):
        return {**found, "outcome": "wrong", "what": f"{what}: differs by {off:.1e}"}
    if work.checkpoint and any(kept(path).get(number) != each for number, each in there.items()):
        return {**found, "outcome": "lost", "what": f"{what}: a point of the file has changed"}
    return {**found, "outcome": "right"}


def resume(task: dict[str, Any]) -> dict[str, Any]:
    """After a kill: what is left goes on in this process."""
    if task["fault"] == "save":
        return saved(task, "killed while it saved")
    objects, _, truth, _ = undisturbed(task["work"])
    return resumed(task, WORK[task["work"]], objects, truth, "killed")


# --- results that are saved ---
def _stored(path: Path) -> dict[str, np.ndarray]:
    import dolfinx_frontend as lf

    found = lf.load(path)
    return {"force": np.array(found.force("layer")), "jump": np.array(found.jump("layer"))}


def _save(task: dict[str, Any], random: np.random.Generator, say: Callable[[str], None]) -> dict[str, Any]:
    """Over a file that is there: afterwards it is the old one or the new one, whole."""
    from dolfinx_frontend.io import ResultFileError

    objects = undisturbed(task["work"])[0]
    path, result = Path(task["folder"]) / "result.h5", objects[1]
    clock = Clock()
    with injection.saving(clock):
        result.save(path)
    truth = _stored(path)
    np.savez(path.with_suffix(".npz"), **truth)
    kind = str(random.choice(["size", "kill", "memory", "keyboard", "unknown"]))
    action = injection.kill if kind == "kill" else injection.raising(kind)
    clock = Clock(int(random.integers(clock.count)), None if kind == "size" else action)
    size = int(random.integers(path.stat().st_size)) if kind == "size" else 1 << 40
    say("save")
    ended = "whole"
    try:
        with injection.limited(size), injection.saving(clock):
            result.save(path)
    except ResultFileError as error:
        ended = "ResultFileError"
        if str(path) not in str(error):
            return {**task, "outcome": "raised", "what": f"{kind}: no name in {error}"}
    except (Exception, KeyboardInterrupt) as error:
        ended = type(error).__name__
        if kind == "size":
            return {**task, "outcome": "raised", "what": f"limit {size}: {ended}: {error}"}
    return saved(task, f"save, {kind} at tick {clock.at} ({clock.where}), ended: {ended}")


def saved(task: dict[str, Any], what: str) -> dict[str, Any]:
    """Whether the file of a result is whole."""
    path = Path(task["folder"]) / "result.h5"
    try:
        found = _stored(path)
    except Exception as error:
        return {**task, "outcome": "unreadable", "what": f"{what} {type(error).__name__}: {error}"}
    with np.load(path.with_suffix(".npz")) as truth:
        off = difference(found, dict(truth))
    return {**task, "outcome": "right" if off == 0.0 else "wrong", "what": what, "difference": off}


# --- ranks ---
def _rank(random: np.random.Generator, say: Callable[[str], None]) -> dict[str, Any]:
    """Two ranks, one is killed: all end, and the next run is right."""
    victim, at = int(random.integers(2)), int(random.integers(40))
    say("ranks")
    what = f"rank {victim} killed at tick {at}"
    began = perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for attempt in ("killed", "again"):
            file = Path(folder) / "numbers.npz"
            call = ["mpirun", "-n", "2", sys.executable, str(MAIN), "--ranked", str(file)]
            call += [str(victim), str(at)] if attempt == "killed" else ["-1", "-1"]
            with tempfile.TemporaryFile() as log:
                code = subprocess.run(call, stdout=log, stderr=log, check=False).returncode
                log.seek(0)
                words = log.read()[-300:].decode(errors="replace")
            whole = file.exists()
            if attempt == "killed" and not whole and code == 0:
                return {"outcome": "lost", "what": f"{what}: ended as if nothing were"}
            if attempt == "again" and not whole:
                return {"outcome": "raised", "what": f"{what}: the next run ended with {code}: {words}"}
            if whole:
                with np.load(file) as stored:
                    numbers = {name: stored[name] for name in ("force", "jump")}
                    off = difference(numbers, undisturbed("sampling")[2])
                if off > WITHIN:
                    return {"outcome": "wrong", "what": f"{what}: {attempt}, differs by {off:.1e}"}
                file.unlink()
    return {"outcome": "right", "what": what, "seconds": round(perf_counter() - began, 1), "difference": off}


def on_ranks(file: Path, victim: int, at: int) -> None:
    """The sampling on all ranks of mpirun; one of them is killed at one of its ticks."""
    from mpi4py import MPI

    import dolfinx_frontend as lf
    from faulty.work import SAMPLES, TIGHT, blocks, loose

    comm = MPI.COMM_WORLD
    problem = blocks(loose(), comm)
    clock = Clock(at if comm.rank == victim else -1, injection.kill)
    with ticking(clock):
        result = lf.monte_carlo(problem, SAMPLES, seed=3, options=TIGHT, progress=False)
        force, jump = result.gathered("layer")
    if comm.rank == 0:
        part = file.with_suffix(".part.npz")
        np.savez(part, force=force, jump=jump)
        os.replace(part, file)
