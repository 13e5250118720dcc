"""Text for people: the tables of a run from its record, what a deck will do, and signs of life."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import numpy as np

from dolfinx_frontend.assembly.held import held, own_resistances
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.rigid import free_motions
from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.decks.settings import Deck
from dolfinx_frontend.plan.plan import Plan, make_plan, plan_for
from dolfinx_frontend.plan.price import Way
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.results.tables import Table
from dolfinx_frontend.sheets.names import units_of

__all__ = ["Life", "outlook", "shown"]

NO_UNITS = 'not said (units = ["mm", "N"])'


def shown(record: Mapping[str, Any]) -> str:
    """The report of a run as text."""
    lines = [record.get("title") or str(record.get("deck") or "")]
    lines += [f"status {record.get('status')}, exit code {record.get('exit_code')}: "
              f"{record.get('message') or 'converged'}"]
    lines += [f"warning: {each}" for each in record.get("warnings", ())]
    lines += [f"note: {each}" for each in record.get("notes", ())]
    errors = record.get("errors") or {}
    if "text" in errors:
        lines += ["", *str(errors["text"]).splitlines()]
    rows = []
    for each in record.get("quantities", ()):
        unit = f" {each['unit']}" if each.get("unit") else ""
        if "missing" in each:
            rows.append((each["name"], "", each["missing"]))
        elif "value" in each:
            rows.append((each["name"], "", f"{_number(each['value'])}{unit}"))
        for key, found in each.items():
            if isinstance(found, dict):
                own = "" if key.startswith("P(") else unit
                between = f" ({_number(found['low'])} to {_number(found['high'])})"
                between = "" if found["low"] is None else between
                rows.append((each["name"], key, f"{_number(found['value'])}{own}{between}"))
    if rows:
        lines += ["", *columns(rows, "<<<")]
    units = record.get("units") or {}
    for name, table in (record.get("tables") or {}).items():
        if not table or "missing" in table:
            continue
        stated = ", ".join(dict.fromkeys(each for each in units.values() if each))
        lines += ["", f"{name}{f' ({stated})' if stated else ''}", str(_table(table))]
    return "\n".join(lines)


def _number(value: Any) -> str:
    return "unknown" if value is None else f"{value:.6g}"


def _table(table: Mapping[str, Any]) -> Table:
    labels = tuple(table["labels"])
    filled = {name: [np.nan if each is None and name not in labels else each for each in entries]
              for name, entries in table["columns"].items()}
    return Table(filled, labels, tuple(table.get("notes", ())))


def outlook(deck: Deck, problem: Problem) -> str:
    """What a deck will do: parts, gaps, free motions, plan and price."""
    lines = [str(problem), ""]
    unknowns = sum(part.size for part in problem.parts.values())
    lines.append(f"{unknowns} unknowns in {len(problem.parts)} parts")
    units = units_of(deck.units)
    stated = ", ".join(f"{name} {unit}" for name, unit in units.items() if unit)
    lines.append(f"units: {stated or NO_UNITS}; nothing is converted")
    for name, interface in problem.interfaces.items():
        if interface.law.unilateral and len(interface.sides) == 2:
            low, high = float(interface.gap.min()), float(interface.gap.max())
            lines.append(f"gap of {name} as meshed: {low:.4g} to {high:.4g} {units['length']}".rstrip())
    resisting = [held(problem, each) for each in problem.interfaces.values() if not each.law.unilateral]
    parts = {name: (part.centre, part.length) for name, part in problem.parts.items()}
    free = free_motions(parts, [*resisting, *own_resistances(problem.parts)])
    if len(free):
        for names, words in free.describe(np.eye(len(free))):
            lines.append(f"held by contact and friction only: {', '.join(names)}: {'; '.join(words)}")
    else:
        lines.append("free motions: none, also where contacts open")
    plan = _plan(deck, problem)
    return "\n".join([*lines, "", str(plan), f"price: {plan.price or 'not known'}"])


def _plan(deck: Deck, problem: Problem) -> Plan:
    names = ("method", "active", "direction", "times")
    settings: dict[str, Any] = {name: deck.run[name] for name in names if name in deck.run}
    settings["options"] = deck.options
    if deck.way == "samples":
        return plan_for(RandomLaws.of(problem), Way(points=deck.run["samples"]), **settings)
    return make_plan(problem, vary=(), **settings)


class Life(logging.Handler):
    """A line on the error stream every few seconds where it is no terminal: seconds, phase, what is done.

    Parameters
    ----------
    every
        Seconds between two lines.
    """

    def __init__(self, every: float) -> None:
        super().__init__(logging.INFO)
        self.every, self.began, self.phase, self.latest = every, time.monotonic(), "start", ""
        self._loggers = [logging.getLogger(name) for name in ("dolfinx_frontend", "latin_core")]
        self._before: list[tuple[int, bool]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)

    def __call__(self, phase: str) -> None:
        """A phase begins."""
        self.phase, self.latest = phase, ""
        self._line(phase)

    def emit(self, record: logging.LogRecord) -> None:
        if record.name.endswith(".progress"):
            return  # which is told here, with the phase
        self.latest = record.getMessage().splitlines()[0] if record.getMessage() else ""

    def _line(self, text: str) -> None:
        print(f"latin: {time.monotonic() - self.began:5.1f} s  {text}", file=sys.stderr, flush=True)

    def _tell(self) -> None:
        while not self._over.wait(self.every):
            text = self.phase
            bars = list(Bar.running)
            if bars and bars[-1].total:
                bar = bars[-1]
                text += f": {bar.done} of {bar.total} {bar.unit}s"
            if self.latest:
                text += f" ({self.latest})"
            self._line(text)

    def __enter__(self) -> Self:
        for logger in self._loggers:
            self._before.append((logger.level, logger.propagate))
            logger.addHandler(self)
            if not sys.stderr.isatty():
                logger.setLevel(logging.INFO)
                logger.propagate = False
        if not sys.stderr.isatty():
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        for logger, (level, propagate) in zip(self._loggers, self._before, strict=True):
            logger.removeHandler(self)
            logger.setLevel(level)
            logger.propagate = propagate
