"""A record held against the frozen one: what is different beyond the errors that were said."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from frozen.store import Record

WORSE = 3.0
"""A later state may say so many times the error said at the freeze."""
BETTER = 0.1
"""An error that is said to be less than this share of the frozen one is a claim, and wants a reason."""
ROUNDING = 1e-5
"""Rounding of a number over the error said of it: 3e-13 of it at 3e-8."""
GROWN, GROWN_BYTES = 1.05, 1.2
"""Ratios above which a count, or the peak of memory, has grown."""
PEAK = "peak bytes"
ORDER = (
    *("converged", "inexact", "max_iterations", "undecided", "undetermined", "slides"),
    *("no_equilibrium", "time_limit", "interrupted"),
)
"""How a solution ends, from the best to the worst."""


@dataclass(frozen=True)
class Difference:
    """One difference.

    Attributes
    ----------
    kind
        ``value``, ``word``, ``status``, ``error said``, ``right value``, ``outcome`` or ``vanished``.
    """

    scene: str
    key: str
    kind: str
    old: str
    new: str
    about: str = ""

    def __str__(self) -> str:
        about = f" ({self.about})" if self.about else ""
        return f"{self.scene}  {self.key}: {self.kind} {self.old} -> {self.new}{about}"


def differences(old: Record, new: Record) -> list[Difference]:
    """What a later state answers differently; of a scene that is known bad, where it is right no longer."""
    return list(_bad(old, new) if old.get("known_bad") else _good(old, new))


def _good(old: Record, new: Record) -> Iterator[Difference]:
    name = old["name"]
    if outcome(old) != outcome(new):
        yield Difference(
            name, "outcome", "outcome", outcome(old), outcome(new), str(new.get("what", ""))[:160]
        )
        return
    for key, word in old["words"].items():
        found = new["words"].get(key)
        if found is None:
            yield Difference(name, key, "vanished", word, "nothing")
        elif found != word:
            kind = "status" if _statuses(word) else "word"
            yield Difference(name, key, kind, word, found)
    rounding = _rounding(old)
    for key, (value, error) in old["values"].items():
        if key not in new["values"]:
            yield Difference(name, key, "vanished", shown(value), "nothing")
            continue
        if _is_zero(old, key):
            continue  # what is left of it is rounding, without a size of its own: its right value is asked
        found, now = new["values"][key]
        # how much the later state may say is asked below
        allowed = max((1.0 + WORSE) * float(error), float(error) + float(now), rounding[_quantity(key)])
        if not same(value, found, allowed):
            about = f"{_apart(value, found)} apart, error {float(error):.1e}"
            yield Difference(name, key, "value", shown(value), shown(found), about)
    for key, (error, floor) in old["said"].items():
        if key not in new["said"]:
            yield Difference(name, key, "vanished", shown(error), "nothing")
            continue
        found = float(new["said"][key][0])
        # a hundredth more: both are written with two digits
        allowed = 1.05 * max(WORSE * float(error), float(floor))
        if not (found <= allowed or (math.isnan(found) and math.isnan(float(error)))):
            yield Difference(name, key, "error said", shown(error), shown(found), "more than three times")
        elif found < BETTER * float(error) and float(error) > float(floor):
            yield Difference(name, key, "error said", shown(error), shown(found), "less than a tenth")
    for key in sorted(missed(new)):
        yield _missed(old, new, key)


def _quantity(key: str) -> str:
    """What a number is of, whatever the step, and whether it is a norm or a probe."""
    return re.split(r"@| norm$| probe$", key)[0]


def _rounding(record: Record) -> dict[str, float]:
    """Of each quantity what rounding of its largest step leaves in all of them."""
    largest: dict[str, float] = {}
    for key, (_, error) in record["values"].items():
        quantity = _quantity(key)
        largest[quantity] = max(largest.get(quantity, 0.0), ROUNDING * float(error))
    return largest


def _is_zero(record: Record, key: str) -> bool:
    return key in record.get("right", {}) and float(record["right"][key][0]) == 0.0


def _bad(old: Record, new: Record) -> Iterator[Difference]:
    claims = _claims(new) and not _claims(old)
    for key in sorted(missed(new)):
        if claims or key not in missed(old):
            yield _missed(old, new, key)


def mended(old: Record, new: Record) -> bool:
    """Whether a scene that was known to be bad has all its right values, and says so."""
    return bool(old.get("known_bad") and new.get("right")) and _claims(new) and not missed(new)


def _missed(old: Record, new: Record, key: str) -> Difference:
    value, tolerance, source = new["right"][key]
    found = new.get("values", {}).get(key)
    about = f"right is {shown(value)} within {float(tolerance):.1e}: {source}"
    return Difference(
        old["name"], key, "right value", shown(value), shown(found[0]) if found else "nothing", about
    )


def missed(record: Record) -> set[str]:
    """Right values that a record does not have; ``right`` has value, absolute tolerance and source."""
    out = set()
    for key, (value, tolerance, _) in record.get("right", {}).items():
        found = record.get("values", {}).get(key)
        if found is None or not same(value, found[0], float(tolerance)):
            out.add(key)
    return out


def outcome(record: Record) -> str:
    """How it ended; of an exception its type."""
    return str(record["outcome"])


def _claims(record: Record) -> bool:
    """Whether a record says that all of it converged."""
    words = [w for k, w in record.get("words", {}).items() if k.split(".")[-1] == "status"]
    return record["outcome"] == "answered" and all(word == "converged" for word in words)


def _statuses(word: str) -> bool:
    return any(part.split(" ")[0] in ORDER for part in word.split(", "))


def same(old: Any, new: Any, allowed: float) -> bool:
    """Whether two numbers are within what is allowed; what is not finite must be the same."""
    a, b = float(old), float(new)
    if not (math.isfinite(a) and math.isfinite(b)):
        return a == b or (math.isnan(a) and math.isnan(b))
    return abs(a - b) <= allowed


def grown(old: Record, new: Record) -> list[Difference]:
    """Counts that grew, and those that are told no longer."""
    out = []
    for key, count in old.get("counts", {}).items():
        found = new.get("counts", {}).get(key)
        if found is None:
            out.append(Difference(old["name"], key, "count", shown(count), "not told"))
        elif float(found) > (GROWN_BYTES if key == PEAK else GROWN) * float(count):
            ratio = f"x {float(found) / float(count):.2f}" if float(count) else ""
            out.append(Difference(old["name"], key, "count", shown(count), shown(found), ratio))
    return out


def shown(value: Any) -> str:
    """A number in short."""
    return f"{float(value):.10g}"


def _apart(old: Any, new: Any) -> str:
    return f"{abs(float(old) - float(new)):.1e}"
