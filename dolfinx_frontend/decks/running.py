"""A deck solved: its answer, what is written of it, and the exit code that follows from its statuses."""

from __future__ import annotations

import json
import platform
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
from latin_core import InputError, NumericalError, __version__

from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.common.errors import BalanceError, SceneError
from dolfinx_frontend.common.files import write_text
from dolfinx_frontend.common.statuses import INEXACT, NO_EQUILIBRIUM, SLIDES, UNDECIDED, UNDETERMINED
from dolfinx_frontend.decks.settings import OPTIONS, Asked, Deck
from dolfinx_frontend.kernel.running import points_kept
from dolfinx_frontend.results.tables import Table
from dolfinx_frontend.sheets.names import units_of
from dolfinx_frontend.solving import quasi_monte_carlo, solve

__all__ = [
    *("BALANCE", "DONE", "INPUT", "INTERRUPTED", "LIMIT", "NUMBERS", "RESULT"),
    "Run",
    "code_of",
    "code_of_error",
    "run_deck",
    "sentence",
]

DONE, INPUT, BALANCE, NUMBERS, LIMIT, INTERRUPTED = 0, 2, 3, 4, 5, 130
"""Exit codes: converged, and as accurate as asked; wrong input; no equilibrium; not converged, or not
as accurate as asked; out of time or memory; interrupted."""

RESULT = "result.json"
ANSWER = "result.h5"
POINTS = "points"

_CODES = {
    "converged": DONE, UNDETERMINED: DONE, INEXACT: NUMBERS, "max_iterations": NUMBERS, UNDECIDED: BALANCE,
    SLIDES: BALANCE, NO_EQUILIBRIUM: BALANCE, "time_limit": LIMIT, "interrupted": INTERRUPTED,
}
_ORDER = (DONE, NUMBERS, BALANCE, LIMIT, INTERRUPTED)
_KNOWN = (SceneError, InputError, NumericalError, OSError, UnicodeError)
"""Errors whose words are for users."""
_ERRORS: dict[type[BaseException], int] = {
    KeyboardInterrupt: INTERRUPTED, MemoryError: LIMIT, BalanceError: BALANCE,
    SceneError: INPUT, InputError: INPUT, OSError: INPUT, UnicodeError: INPUT,
}
"""Exit codes of errors, the first that fits; of others, defects among them, NUMBERS."""


def code_of(statuses: Sequence[str], reached: bool = True, out_of_time: bool = False) -> int:
    """The exit code of the statuses of all steps or points."""
    found = {_CODES.get(status, NUMBERS) for status in statuses} | ({DONE} if reached else {NUMBERS})
    if out_of_time:
        found = {LIMIT if code == INTERRUPTED else code for code in found} | {LIMIT}
    return max(found, key=_ORDER.index)


def code_of_error(error: BaseException) -> int:
    """The exit code of what a run ended with."""
    return next((code for kind, code in _ERRORS.items() if isinstance(error, kind)), NUMBERS)


def sentence(error: BaseException) -> str:
    """What a run ended with, in a sentence."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted before there was an answer"
    if isinstance(error, _KNOWN):
        return str(error)
    if isinstance(error, MemoryError):
        return f"out of memory: {str(error) or 'take fewer cells or samples'}"
    # a defect: one sentence for a machine, all of it with --debug
    return f"{type(error).__name__}: {error}; this is a defect: please report it with the deck (--debug)"


@dataclass
class Run:
    """What became of a deck.

    Attributes
    ----------
    code, message
        Exit code, and a sentence if something is wrong.
    record
        What ``result.json`` has.
    answer
        The result, if there is one.
    """

    code: int = DONE
    message: str = ""
    record: dict[str, Any] = field(default_factory=dict)
    answer: Any = None


def run_deck(deck: Deck, folder: Path | None, phase: Callable[[str], None]) -> Run:
    """Solve a deck and write ``result.json`` and ``result.h5`` into a folder (None: nothing is written).

    A run that was killed goes on with the points that are finished.
    """
    began, run = time.monotonic(), Run()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with nullcontext() if folder is None else points_kept(folder / POINTS):
                run.answer = _answer(deck, phase)
            phase("results")
            _judge(run, deck)
        except (*_KNOWN, MemoryError, KeyboardInterrupt) as error:
            run.code, run.message = code_of_error(error), sentence(error)
    said = dict.fromkeys(str(each.message) for each in caught if issubclass(each.category, UserWarning))
    run.record = _record(deck, run, tuple(said), time.monotonic() - began)
    if folder is not None:
        if run.answer is not None:
            with suppress(SceneError):
                run.answer.save(folder / ANSWER)
        write_text(folder / RESULT, json.dumps(run.record, indent=1, allow_nan=False) + "\n")
    return run


def _answer(deck: Deck, phase: Callable[[str], None]) -> Any:
    ours = (*OPTIONS, "samples", "seed")
    settings: dict[str, Any] = {name: value for name, value in deck.run.items() if name not in ours}
    settings |= {"options": deck.options, "progress": True}
    if deck.way == "accuracy" and settings.pop("meshes", True):
        phase("meshes, iteration and samples to the accuracy")
        return solve(deck.scene, **settings, max_seconds=deck.run.get("max_seconds"))
    phase("assembly")
    problem = assemble(deck.scene)
    if deck.way == "accuracy":
        phase("iteration and samples to the accuracy")
        del settings["progress"]
        settings |= {"meshes": False, "max_seconds": deck.run.get("max_seconds")}
        return solve(problem, **settings)
    if deck.run.get("quantity") is not None or deck.run.get("max_unknowns") is not None:
        raise SceneError("run: quantity and max_unknowns go with an accuracy: accuracy = 1e-2")
    if deck.way != "samples":
        phase("solution" if deck.way == "solve" else "chaos")
        return solve(problem, **settings)
    phase("samples")
    count, seed = deck.run["samples"], deck.run.get("seed", 0)
    return quasi_monte_carlo(problem, count, seed=seed, **settings)


def _judge(run: Run, deck: Deck) -> None:
    """Exit code and sentence of an answer."""
    answer, reached, late = run.answer, True, False
    if deck.way == "accuracy":
        found = answer.errors(deck.run.get("quantity"))
        reached = found.reached
        if not reached:
            run.message = f"the accuracy was not reached: {found.in_all:.2g}, asked {found.asked:g}"
            late = any("budget" in note and " s " in note for note in found.notes)
    run.code = code_of(_statuses(answer), reached, late)
    if run.code != DONE and not run.message:
        run.message = str(getattr(answer, "ended", "")) or f"status {answer.status}"
    if run.code == LIMIT:
        run.message = f"max_seconds = {deck.run['max_seconds']:g} are over: {run.message}"


def _statuses(answer: Any) -> list[str]:
    return [str(each) for each in np.ravel(getattr(answer, "statuses", answer.status))]


def _record(deck: Deck, run: Run, said: tuple[str, ...], seconds: float) -> dict[str, Any]:
    """What ``result.json`` has: texts, and numbers that are finite or null."""
    record: dict[str, Any] = {
        "exit_code": run.code,
        "message": run.message,
        "title": deck.title,
        "deck": deck.path.name if deck.path else None,
        "way": deck.way,
        "units": {name: unit for name, unit in units_of(deck.units).items() if name},
        "versions": {
            "latin_core": __version__,
            "dolfinx": str(getattr(dolfinx, "__version__", "")),
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "seconds": seconds,
        "warnings": list(said),
        "notes": list(deck.notes),
    }
    answer = run.answer
    if answer is None:
        empty: dict[str, Any] = {"status": None, "quantities": [], "tables": {}}
        return {**_plain(record), **empty}
    record |= {"status": answer.status, "statuses": _statuses(answer)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record["errors"] = _try(lambda: _errors(answer, deck.run.get("quantity")))
        record["quantities"] = [_quantity(answer, each) for each in deck.asked]
        missing = [each["missing"] for each in record["quantities"] if "missing" in each]
        if missing and run.code == DONE:  # what was asked for is not there
            run.code, run.message = INPUT, missing[0]
            record |= {"exit_code": run.code, "message": run.message}
        record["tables"] = {"interfaces": _try(lambda: _table(answer.table(step=None)))}
        if getattr(answer, "times", None) is not None and len(answer.times) > 1:
            record["tables"]["bolts"] = _try(lambda: _table(answer.bolts()))
    return {**_plain(record)}


def _try(read: Callable[[], Any]) -> Any:
    """A part of the report, or why it is not there."""
    try:
        return read()
    except SceneError as error:
        return {"missing": str(error)}


def _errors(answer: Any, quantity: Any) -> dict[str, Any]:
    found = answer.errors(quantity)
    sources = ("algebraic", "truncation", "discretisation", "field")
    known = {each: found.relative(each) for each in sources if getattr(found, each) is not None}
    return {**known, "in_all": found.in_all, "asked": found.asked, "reached": found.reached,
            "of": "energy" if found.quantity is None else str(found.quantity), "text": str(found)}


def _quantity(answer: Any, asked: Asked) -> dict[str, Any]:
    title = asked.name or asked.of

    def read() -> dict[str, Any]:
        found = answer.quantity(asked.of, unit=asked.unit, step=asked.step)
        if found.kind == "value":
            return {"value": float(found.values[0])}
        estimates = {"mean": found.mean(), "std": found.std()}
        for q in asked.quantiles:
            estimates[f"quantile {q:g}"] = found.quantile(q)
        if asked.above is not None:
            estimates[f"P(above {asked.above:g})"] = found.probability(above=asked.above)
        if asked.below is not None:
            estimates[f"P(below {asked.below:g})"] = found.probability(below=asked.below)
        return {key: each._asdict() for key, each in estimates.items()}

    return {"name": title, "of": asked.of, "unit": asked.unit, **_try(read)}


def _table(table: Table) -> dict[str, Any]:
    columns = {name: list(entries) for name, entries in table.columns.items()}
    return {"labels": list(table.labels), "columns": columns, "notes": list(table.notes)}


def _plain(value: Any) -> Any:
    """Without what JSON has no word for."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
