"""The group ``campaign``: drawn scenes, kept as scripts, with what the reference says of wrong ones."""

from __future__ import annotations

import resource
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from campaign.judge import (
    ATTEMPTS,
    FACTOR,
    LINEAR,
    Case,
    Found,
    Verdict,
    galerkin_truth,
    model_of,
    one,
    tight_truth,
    truth,
)
from campaign.points import Array
from campaign.reference import Inadmissible, Unsolved
from campaign.scenes import Scene, scene
from frozen.observe import ROUNDING, Observation, displacements, nodes, observe
from frozen.store import Record, kept, short

GROUP = "campaign"
FIRST, COUNT = 44_000_000, 1000
"""Seeds of the scenes: even ones are dev, odd ones held out."""
RTOL = 1e-9
"""That all scenes are solved with, unless they do not reach it."""
BAD = ("wrong", "not_converged", "raised", "crashed")


def names() -> list[str]:
    return [f"{GROUP}/{seed}" for seed in range(FIRST, FIRST + COUNT)]


def peak() -> float:
    """Largest resident memory of this process so far, bytes; 0 where the system does not tell it."""
    scale = 1 if sys.platform == "darwin" else 1024
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale)


def answered(result: Any, rtol: float, few: bool) -> Record:
    """What is kept of an answer, and the peak of the memory that it took."""
    memory = peak()
    seen = observe(result, rtol, few)
    seen.counts["peak bytes"] = memory
    return {"outcome": "answered", **kept(seen)}


def refused(error: BaseException) -> Record:
    """What is kept of an exception: its type; its words are shown but may change."""
    return {"outcome": f"raised {type(error).__name__}", "what": str(error)[:300], **kept(Observation())}


def solved(record: Record) -> Record:
    """A frozen scene, solved again."""
    case = Case(record["source"], record["kind"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = answered(case.space["run"](case.assemble()), record["rtol"], few=True)
        except Exception as error:  # whatever it is, it is what the scene says now
            found = refused(error)
    return {**found, "right": record.get("right", {})}


def frozen(seed: int, phase: Callable[[str], None] = lambda _: None) -> Record:
    """A scene of a seed as it is answered now and judged: at the tolerance of all if it is reached."""
    for attempt in range(ATTEMPTS):
        phase(f"attempt {attempt}")
        drawn = scene(seed, attempt, None, 1)
        tight = replace(
            drawn, rtol=RTOL, source=drawn.source.replace(f"rtol={drawn.rtol!r}", f"rtol={RTOL!r}")
        )
        record, verdict = _judged(tight, phase)
        if verdict.outcome == "inadmissible":
            continue
        if record["outcome"] != "answered" or verdict.status != "converged":
            tight = drawn
            record, verdict = _judged(drawn, phase)
        break
    record |= {"kind": tight.kind, "source": tight.source, "rtol": tight.rtol, "about": drawn.about}
    record["verdict"] = verdict.outcome
    if verdict.outcome in BAD:
        record["known_bad"] = f"{verdict.outcome}: {verdict.what}"[:200]
        phase("reference")
        record["right"] = _right(tight, record["rtol"])
    return record


def _judged(drawn: Scene, phase: Callable[[str], None]) -> tuple[Record, Verdict]:
    """What is kept of a scene, and what the judge says of it."""
    space: dict[str, Any] = {"__name__": "scene"}
    exec(compile(drawn.source, "<scene>", "exec"), space)  # the campaign's own text
    run, record = space["run"], {}

    def watched(problem: Any) -> Any:
        try:
            result = run(problem)
            record.update(answered(result, drawn.rtol, few=True))
        except Exception as error:
            record.update(refused(error))
            raise
        return result

    verdict = one(drawn, phase, space={**space, "run": watched})
    return record, verdict


def _right(drawn: Scene, rtol: float) -> dict[str, list[Any]]:
    """Displacements that the reference finds, in the terms of an observation; nothing where it finds none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        case = Case(drawn.source, drawn.kind)
        problem = case.assemble()
        try:
            fields = _reference(case, problem)
        except (Inadmissible, Unsolved):
            return {}
        except Exception:  # of the answer, which is bad: then the reference cannot begin
            return {}
    floor = ROUNDING * max((float(np.abs(u).max(initial=0.0)) for u in fields.values()), default=0.0)
    right = {}
    for name, u in fields.items():
        found = displacements(nodes(problem.substructures[name]), u, name, FACTOR * rtol, floor)
        for key, (value, error) in found.items():
            right[key] = [short(value, 12), short(error), "reference of the campaign"]
    return right


def _reference(case: Case, problem: Any) -> Mapping[str, Array]:
    """Part -> unknowns: at the end of a history, at the last point of a sweep, the mean of what is random."""
    found: Found | None = None
    try:
        found = case.run(problem)
    except Exception:
        if case.kind not in ("static", "history"):
            raise
    if found is None:
        ties = [n for n, each in problem.interfaces.items() if type(each.law).__name__ == "Perfect"]
        model = model_of(case, problem, [n for n in ties if problem.interfaces[n].matching is None])
        from campaign.reference import histories

        if case.times is None:
            return {n: u[:, 0] for n, u in model.solve(case.laws())[0].fields.items()}
        return {n: u[:, 0] for n, u in histories(model, case.laws, case.times)[-1].fields.items()}
    model = model_of(case, problem, found.plan.active)
    if case.kind == "chaos":
        linear = all(isinstance(law, LINEAR) for law in case.laws().values())
        answer = (
            galerkin_truth(case, problem, found, model)[0]
            if linear
            else tight_truth(case, problem, found)[0][0]
        )
        return {name: u[:, 0] for name, u in answer.fields.items()}
    values, probabilities = case.values(found)
    if case.kind != "samples":
        last = truth(case, problem, found, model, len(values) - 1, values[-1])[-1]
        return {name: u[:, 0] for name, u in last.fields.items()}
    mean: dict[str, Array] = {}
    for k, (value, p) in enumerate(zip(values, np.asarray(probabilities), strict=True)):
        for name, u in truth(case, problem, found, model, k, value)[0].fields.items():
            mean[name] = mean.get(name, 0.0) + p * u[:, 0]
    return mean
