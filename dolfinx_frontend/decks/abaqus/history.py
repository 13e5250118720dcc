"""Steps of a deck as one history: every load and support is a curve, linear between points in total time."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from dolfinx_frontend.decks.abaqus.cards import Card, Row
from dolfinx_frontend.decks.abaqus.model import Model
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.scene.amplitudes import Amplitude

__all__ = ["DIGITS", "Curve", "Given", "History", "Hold", "Key", "Step", "combined"]

DIGITS = 12
"""Of shapes of curves: what is beyond is rounding."""
Curve = tuple[tuple[float, float], ...]
"""Points (total time, value)."""

Key = tuple[Any, ...]
"""("u", node, component), ("f", node, component), ("p", element, face), ("T", node), ("b", ...)"""

_JUMP = 1e-6
"""Share of a step in which a value that jumps at its begin gets there."""

_SMALL, _LARGE = 0.02, 0.2
"""Given rotations, of steps with NLGEOM, from which on their size is said, and they are refused."""

_NONE: Curve = ((0.0, 0.0),)

_NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6), "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6), "YSYMM": (2, 4, 6), "ZSYMM": (3, 4, 5),
}


class Step(NamedTuple):
    """A step: its name, begin and end in total time, and its place in the deck."""

    number: int
    name: str
    start: float
    end: float
    file: str
    line: int


class Hold(NamedTuple):
    """A support: its value, the intervals in which it holds (empty: always), and the share of the way to its
    value that is left."""

    curve: Curve
    during: tuple[tuple[float, float], ...] = ()
    kept: Curve = _NONE


class Given(NamedTuple):
    """A value that a step gives: its card, row and the name of what it acts on."""

    value: float
    card: Card
    row: Row
    target: str

    def error(self, text: str) -> DeckError:
        """The error of its row, to be raised."""
        return self.card.error(text, self.row.where)


class _Phase(NamedTuple):
    """What of a step its curves need; `number` is 0 before the first one."""

    number: int
    start: float
    end: float
    at_once: bool


@dataclass
class History:
    """All curves of a deck.

    Attributes
    ----------
    curves, given
        Key -> curve, and the last that gave it.
    fixed
        Node of a bolt or body -> step from which on its displacements stay what they are (FIXED).
    start_temperatures
        Node -> temperature without thermal strain.
    increments
        Total times at which *STATIC, DIRECT wants a solution.
    frictions
        Interaction -> steps from whose begin on it has another friction.
    references, bolts
        Nodes that are handled by what they stand for, and those of bolts.
    """

    model: Model
    steps: list[Step] = field(default_factory=list)
    curves: dict[Key, Curve] = field(default_factory=dict)
    given: dict[Key, Given] = field(default_factory=dict)
    fixed: dict[int, int] = field(default_factory=dict)
    forced: dict[Key, list[int]] = field(default_factory=dict)
    spans: dict[Key, list[tuple[float, float]]] = field(default_factory=dict)
    kept: dict[Key, Curve] = field(default_factory=dict)
    start_temperatures: dict[int, float] = field(default_factory=dict)
    increments: list[float] = field(default_factory=list)
    frictions: dict[str, dict[Step, Card]] = field(default_factory=dict)
    references: frozenset[int] = frozenset()
    _large: bool = False
    bolts: frozenset[int] = frozenset()

    def read(self) -> None:
        """The cards before the first step, and all steps."""
        found: dict[Key, list[Given]] = {}
        for card in self.model.early:
            if card.keyword == "BOUNDARY":
                self._rows(card, self._boundary, found)
            elif card.get("TYPE") == "TEMPERATURE":
                for row in card.rows:
                    value = card.number(row, 1, "temperature")
                    for node in self.model.root.node_rows(card, row.words[0], row.where):
                        self.start_temperatures[node] = value
            else:
                self.model.note("refused", card, f"initial {card.get('TYPE')}: only temperatures are read")
        self._apply(_Phase(0, 0.0, 0.0, True), found)
        for number, cards in enumerate(self.model.steps, start=1):
            self._step(number, cards)
        for key, curve in self.curves.items():
            angle = max(abs(v) for _, v in curve) if key[0] == "u" and key[2] > 3 and self._large else 0.0
            if angle > _SMALL:
                given = self.given[key]
                kind = "refused" if angle > _LARGE else "changed"
                said = f"a rotation of {angle:.3g} is taken as small: displacements are off by about"
                self.model.note(kind, given.card, f"{said} {50.0 * angle:.2g} %", given.row.where)

    def _step(self, number: int, cards: list[Card]) -> None:
        head = cards[0]
        if head.get("NLGEOM") not in (None, "NO"):
            self.model.note("changed", head, "NLGEOM: displacements are taken as small")
            self._large = True
        if "PERTURBATION" in head.parameters:
            self.model.note("refused", head, "PERTURBATION: write an ordinary step")
        begin = self.steps[-1].end if self.steps else 0.0
        static = next((c for c in cards if c.keyword == "STATIC"), None)
        if static is None:
            self.model.note("refused", head, "a step without *STATIC")
        end = begin + (1.0 if static is None else self._period(static, begin))
        name = head.get("NAME") or f"STEP-{number}"
        self.steps.append(Step(number, name, begin, end, *head.where))
        found: dict[Key, list[Given]] = {}
        fresh: set[str] = set()
        changed = ""
        for card in cards[1:]:
            reader = _LOADS.get(card.keyword)
            if card.keyword == "CHANGE FRICTION":
                changed = card.need("INTERACTION")
            elif card.keyword == "FRICTION" and changed:
                self.frictions.setdefault(changed, {})[self.steps[-1]] = card
                changed = ""
            elif reader is None:
                if card.keyword != "STATIC":
                    raise card.error("it does not belong into a step; put it before the first *STEP")
            if reader is None:
                continue
            kind, method = reader
            if card.get("OP") not in (None, "MOD", "NEW"):
                raise card.error(f"OP = {card.get('OP')!r}; give MOD or NEW")
            if card.get("OP") == "NEW":
                fresh |= {kind, "b"} if kind == "p" else {kind}
            if card.keyword == "BOUNDARY" and "FIXED" in card.parameters:
                self._fix(card, number, found)
            else:
                self._rows(card, lambda c, r, f, m=method: m(self, c, r, f), found)  # type: ignore[misc]
        phase = _Phase(number, begin, end, head.get("AMPLITUDE") == "STEP")
        self._drop(fresh, found, phase, cards)
        self._apply(phase, found)

    def _period(self, card: Card, begin: float) -> float:
        if not card.rows:
            return 1.0
        row = card.rows[0]
        period = card.number(row, 1, "period", 1.0) or 1.0
        first = card.number(row, 0, "first increment", period) or period
        if period < 0.0 or first < 0.0:
            raise card.error("its increment and period are positive; correct them", row.where)
        if "DIRECT" in card.parameters:
            count = min(round(period / first), 10_000)
            self.increments += [begin + k * period / count for k in range(1, count)] if count > 1 else []
        return period

    @staticmethod
    def _rows(
        card: Card, method: Callable[[Card, Row, dict[Key, list[Given]]], None], found: dict[Key, list[Given]]
    ) -> None:
        for row in card.rows:
            method(card, row, found)

    def _fix(self, card: Card, number: int, found: dict[Key, list[Given]]) -> None:
        stay: dict[Key, list[Given]] = {}
        self._rows(card, self._boundary, stay)
        for key, given in stay.items():
            if key[1] in self.references:
                self.fixed.setdefault(key[1], number)
            else:
                found[key] = given

    # --- rows -------------------------------------------------------------------------------------
    def _boundary(self, card: Card, row: Row, found: dict[Key, list[Given]]) -> None:
        word = row.words[1].upper() if len(row.words) > 1 else ""
        value = 0.0
        if word in _NAMED:
            components: Any = _NAMED[word]
        else:
            first = card.whole(row, 1, "first component")
            last = card.whole(row, 2, "last component", default=first)
            value = card.number(row, 3, "value", 0.0)
            if first == last == 11:
                self.model.note("refused", card, "temperatures as unknowns", row.where)
                return
            if last > 6 or last < first:
                raise card.error(f"components {first} to {last}; give some of 1 to 6, in order", row.where)
            components = range(first, last + 1)
        for node in self.model.root.node_rows(card, row.words[0], row.where):
            for k in components:  # the last one counts
                found[("u", node, k)] = [Given(value, card, row, row.words[0])]

    def _cload(self, card: Card, row: Row, found: dict[Key, list[Given]]) -> None:
        k = card.whole(row, 1, "component")
        if k > 6:
            raise card.error(f"component {k}; give 1 to 6", row.where)
        given = Given(card.number(row, 2, "force"), card, row, row.words[0])
        for node in self.model.root.node_rows(card, row.words[0], row.where):
            found.setdefault(("f", node, k), []).append(given)

    def _dload(self, card: Card, row: Row, found: dict[Key, list[Given]]) -> None:
        label = row.words[1].upper() if len(row.words) > 1 else ""
        given = Given(card.number(row, 2, "load"), card, row, row.words[0])
        if label in ("GRAV", "CENTRIF"):
            count = 3 if label == "GRAV" else 6
            axis = tuple(card.number(row, 3 + k, "direction or axis") for k in range(count))
            if not any(axis[-3:]):
                raise card.error(f"{label} needs a direction that is not 0; give it", row.where)
            for e in self.model.root.element_rows(card, row.words[0], row.where):
                found.setdefault(("b", label, axis, e), []).append(given)
        elif label[:1] == "P" and label[1:].isdigit():
            scope = self.model.root
            for pair in self.model.face_rows(scope, card, row.words[0], label, row.where):
                found.setdefault(("p", *pair), []).append(given)
        else:
            self.model.note("refused", card, f"load {label!r}: pressures P1, P2, ..., GRAV and CENTRIF are "
                            "read", row.where)

    def _dsload(self, card: Card, row: Row, found: dict[Key, list[Given]]) -> None:
        if len(row.words) < 2 or row.words[1].upper() != "P":
            self.model.note("refused", card, "loads on surfaces other than P, a pressure", row.where)
            return
        given = Given(card.number(row, 2, "pressure"), card, row, row.words[0])
        scope, surface = self.model.root.surface(card, row.words[0], row.where)
        if surface.nodal:
            raise card.error(f"{row.words[0]} is a surface of nodes; give one of faces", row.where)
        for each in surface.card.rows:
            label = each.words[1].upper() if len(each.words) > 1 else ""
            for pair in self.model.face_rows(scope, surface.card, each.words[0], label, each.where):
                found.setdefault(("p", *pair), []).append(given)

    def _temperature(self, card: Card, row: Row, found: dict[Key, list[Given]]) -> None:
        given = Given(card.number(row, 1, "temperature"), card, row, row.words[0])
        for node in self.model.root.node_rows(card, row.words[0], row.where):
            found[("T", node)] = [given]

    # --- curves -----------------------------------------------------------------------------------
    def _last(self, key: Key) -> float:
        if key in self.curves:
            return self.curves[key][-1][1]
        return self.start_temperatures.get(key[1], 0.0) if key[0] == "T" else 0.0

    def _drop(
        self, fresh: set[str], found: dict[Key, list[Given]], phase: _Phase, cards: list[Card]
    ) -> None:
        """What OP=NEW takes away falls to nothing in the course of the step."""
        for key, curve in list(self.curves.items()):
            if key[0] not in fresh or key in found:
                continue
            if key[0] == "u":
                self._release(key, phase, cards)
                continue
            rest = self.start_temperatures.get(key[1], 0.0) if key[0] == "T" else 0.0
            held = ((phase.start, curve[-1][1]),) if curve[-1][0] < phase.start else ()
            self.curves[key] = (*curve, *held, (phase.end, rest))

    def _release(self, key: Key, phase: _Phase, cards: list[Card]) -> None:
        """End a support at the begin of a step."""
        if key[1] not in self.references:
            start, end = self.spans[key][-1]
            if not phase.start > start:
                del self.curves[key], self.spans[key], self.kept[key]
            elif end == math.inf:
                self.spans[key][-1] = start, phase.start
                for curves in (self.curves, self.kept):  # up to here they are what they were
                    last, value = curves[key][-1]
                    curves[key] += ((phase.start, value),) if last < phase.start else ()
        elif key[1] not in self.fixed:
            card = next(c for c in cards if c.keyword == "BOUNDARY" and c.get("OP") == "NEW")
            node = self.model.node_names[key[1]]
            self.model.note("refused", card, f"OP=NEW takes a support of node {node} away, which belongs "
                            "to no solid or moves a body: these last")

    def _hold(self, key: Key, given: Given, phase: _Phase) -> bool:
        """Begin a support, or go on with it; whether it goes from where its node is to a constant value."""
        spans, kept = self.spans.setdefault(key, []), self.kept.setdefault(key, ())
        stays, at_once = "FIXED" in given.card.parameters, phase.at_once or bool(given.card.get("AMPLITUDE"))
        if spans and spans[-1][1] == math.inf:
            if kept[-1][1] and not stays:  # from where it was held to a value
                soon = phase.start + _JUMP * (phase.end - phase.start) if at_once else phase.end
                held = () if kept[-1][0] == phase.start else ((phase.start, kept[-1][1]),)
                self.kept[key] = (*kept, *held, (soon, 0.0))
            return False
        if phase.number > 1 and key[1] in self.references and key[1] not in self.bolts:
            name = self.model.node_names[key[1]]
            self.model.note("refused", given.card, f"node {name} is held from step {phase.number} on, but "
                            "belongs to no solid or moves a body: its supports last from the first step on",
                            given.row.where)
        spans.append((phase.start, math.inf))
        late = phase.number > 1 and (stays or not at_once)
        own = {phase.start: float(late), phase.end: float(stays and late)}
        self.kept[key] = (*kept, *own.items())
        return late

    def hold(self, key: Key) -> Hold:
        """A support as it comes and goes."""
        end = self.steps[-1].end
        during = tuple((start, min(stop, end)) for start, stop in self.spans[key])
        if during == ((0.0, end),) or key[1] in self.references:
            return Hold(self.curves[key])
        return Hold(self.curves[key], during, self.kept[key] if any(v for _, v in self.kept[key]) else _NONE)

    def lasts(self, key: Key) -> bool:
        """Whether a support holds from the begin to the end."""
        return key in self.curves and not self.hold(key).during

    def _apply(self, phase: _Phase, found: dict[Key, list[Given]]) -> None:
        for key, given in found.items():
            before = self._last(key)
            if key[0] == "u":
                if "FIXED" in given[0].card.parameters:
                    given = [given[0]._replace(value=before)]
                before = given[0].value if self._hold(key, given[0], phase) else before
            self.given[key] = given[0]
            self.forced.setdefault(key, []).append(phase.number)
            total: dict[float, float] = {}
            pieces = [self._points(each, before / len(given), phase) for each in given]
            times = sorted({t for piece in pieces for t, _ in piece})
            for t in times:
                total[t] = sum(_at(piece, t) for piece in pieces)
            start: Curve = self.curves.get(key, ())
            if times[0] > phase.start and (not start or start[-1][0] < phase.start):
                start = (*start, (phase.start, before))
            self.curves[key] = (*start, *((t, v) for t, v in total.items() if not start or t > start[-1][0]))

    def _points(self, given: Given, before: float, phase: _Phase) -> Curve:
        """Points of one value in a step."""
        name = given.card.get("AMPLITUDE")
        if name is None:
            if phase.at_once:
                soon = phase.start + _JUMP * (phase.end - phase.start)
                return ((soon, given.value),) if phase.number else ((0.0, given.value),)
            return (phase.start, before), (phase.end, given.value)
        table, total_time = self._amplitude(name, given)
        shift = 0.0 if total_time else phase.start
        if given.card.get("TIMEDELAY") is not None:
            shift += given.card.number(Row(given.card.where, [given.card.need("TIMEDELAY")]), 0, "TIME DELAY")
        inside = [t + shift for t, _ in table if phase.start < t + shift < phase.end]
        points = [(t, given.value * _at(table, t - shift)) for t in (phase.start, *inside, phase.end)]
        if points[0][1] != before and phase.start > 0.0:
            points[0] = phase.start + _JUMP * (phase.end - phase.start), points[0][1]
            points = [points[0], *(p for p in points[1:] if p[0] > points[0][0])]
        return tuple(points)

    def _amplitude(self, name: str, given: Given) -> tuple[Curve, bool]:
        card = self.model.amplitudes.get(name)
        if card is None:
            known = ", ".join(self.model.amplitudes) or "none"
            raise given.error(f"there is no amplitude {name!r} (known: {known}); define it")
        if card.get("DEFINITION") not in (None, "TABULAR") or card.get("VALUE") not in (None, "RELATIVE"):
            self.model.note("refused", card, "amplitudes other than tables of factors")
            return ((0.0, 1.0),), False
        words, places = card.stream()
        if not words or len(words) % 2:
            raise card.error("an amplitude is pairs of time and factor; complete it")
        row = Row(places[0], words)
        numbers = [card.number(row, k, "time or factor") for k in range(len(words))]
        points = list(zip(numbers[::2], numbers[1::2]))
        for a, b in zip(points, points[1:]):
            if b[0] <= a[0]:
                raise card.error(f"times increase, but {a[0]:g} is followed by {b[0]:g}; correct them")
        return tuple(points), card.get("TIME") == "TOTALTIME" or card.get("TIME") == "TOTAL TIME"

    def changing(self, name: str, first: float, of: Callable[[Card], float]) -> Curve:
        """A number of an interaction that steps change at their begin."""
        curve: Curve = ((0.0, first),)
        for step, card in self.frictions.get(name, {}).items():
            soon = step.start + _JUMP * (step.end - step.start)
            before = (*curve, (step.start, curve[-1][1])) if step.start else ()
            curve = (*before, (soon, of(card)))
        return curve

    # --- as values of a scene ---------------------------------------------------------------------
    @cached_property
    def static(self) -> bool:
        """Whether one solution at the end is all: one step in which all loads grow in proportion."""
        if len(self.steps) != 1 or self.increments:
            return False
        return all(
            len(curve) == 1 or (len(curve) == 2 and curve[0][1] in (0.0, curve[1][1]))
            or (key[0] == "T" and len(curve) == 2)
            for key, curve in self.curves.items()
        )

    @property
    def times(self) -> list[float]:
        """Total times to be solved at: ends of steps, and where curves have kinks."""
        found = {step.end for step in self.steps} | set(self.increments)
        jumps = {s.start + _JUMP * (s.end - s.start) for s in self.steps}
        found |= {t for curve in self.curves.values() for t, _ in curve if t > 0.0 and t not in jumps}
        ordered = sorted(found)
        close = 1e-9 * ordered[-1]
        return [t for k, t in enumerate(ordered) if k == 0 or t - ordered[k - 1] > close]

    def value(self, curve: Curve) -> Any:
        """A curve as a number, or an amplitude times one."""
        size = max((abs(v) for _, v in curve), default=0.0)
        last = curve[-1][1]
        if self.static or size == 0.0 or all(v == last for _, v in curve):
            return last
        times = [t for t, _ in curve]
        return Amplitude(times, [round(v / size, DIGITS) for _, v in curve]) * size


def combined(terms: Sequence[tuple[float, Curve]]) -> Curve:
    """Sum of factors times curves."""
    found = [(factor, curve) for factor, curve in terms if factor and any(v for _, v in curve)]
    if not found:
        return ((0.0, 0.0),)
    times = sorted({t for _, curve in found for t, _ in curve})
    return tuple((t, sum(factor * _at(curve, t) for factor, curve in found)) for t in times)


def _at(points: Curve, t: float) -> float:
    """Linear between the points, constant outside."""
    k = bisect.bisect_right(points, t, key=lambda p: p[0])
    if k == 0 or k == len(points):
        return points[0][1] if k == 0 else points[-1][1]
    (a, u), (b, v) = points[k - 1], points[k]
    return u + (v - u) * (t - a) / (b - a)


_LOADS: dict[str, tuple[str, Callable[..., None]]] = {
    "BOUNDARY": ("u", History._boundary),
    "CLOAD": ("f", History._cload),
    "DLOAD": ("p", History._dload),
    "DSLOAD": ("p", History._dsload),
    "TEMPERATURE": ("T", History._temperature),
}
