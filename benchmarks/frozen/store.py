"""The file of the corpus, JSON lines in .xz, one a scene, in the order of names; the table of differences.

Numbers have as many digits as their error gives sense to, twelve at most.
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch, fnmatchcase
from pathlib import Path
from typing import Any

from frozen.observe import Observation

FOLDER = Path(__file__).resolve().parent
FILE = FOLDER / "frozen.jsonl.xz"
DIFFERENCES = FOLDER / "differences.md"
FORM = 1
DIGITS = 12
ACCEPTED = "\n## Accepted\n"
"""Heading of rows whose answers the corpus has."""
ROUNDING = "rounding"
"""First word of a check: it is what the states differ by."""
LARGEST = 3_000_000
"""Bytes of the file."""

Record = dict[str, Any]


def kept(seen: Observation) -> Record:
    """An observation as it is written."""
    return {
        "values": {key: [number(v, e), short(e)] for key, (v, e) in sorted(seen.values.items())},
        "words": dict(sorted(seen.words.items())),
        "said": {key: [short(v), short(floor)] for key, (v, floor) in sorted(seen.said.items())},
        "counts": {key: short(v, DIGITS) for key, v in sorted(seen.counts.items())},
        "missing": sorted(seen.missing),
    }


def number(value: float, error: float) -> float | str:
    """A number to a tenth of its error, twelve digits at most; what is not finite as a word."""
    if not math.isfinite(value):
        return str(value)
    digits = DIGITS
    if value and error > 0.0 and math.isfinite(error):
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
        if digits < 1:
            return 0.0
    return short(value, min(digits, DIGITS))


def short(value: float, digits: int = 2) -> float | str:
    """A number with few digits; whole numbers without a point."""
    if not math.isfinite(value):
        return str(value)
    found = float(f"{value:.{digits - 1}e}")
    return int(found) if found.is_integer() and abs(found) < 1e15 else found


def write(records: Mapping[str, Record], head: Mapping[str, Any], file: Path = FILE) -> int:
    """Write all records, and say how many bytes they take."""
    lines = [json.dumps({"form": FORM, **head}, sort_keys=True)]
    lines += [json.dumps(records[name], sort_keys=True, separators=(",", ":")) for name in sorted(records)]
    data = lzma.compress(("\n".join(lines) + "\n").encode(), preset=9 | lzma.PRESET_EXTREME)
    beside = file.with_name(file.name + ".new")
    beside.write_bytes(data)
    beside.replace(file)
    return len(data)


def read(file: Path = FILE) -> tuple[Record, dict[str, Record]]:
    """Head and records; nothing of a file that is not there."""
    if not file.exists():
        return {"form": FORM}, {}
    head, *lines = lzma.decompress(file.read_bytes()).decode().splitlines()
    first = json.loads(head)
    if first.get("form") != FORM:
        raise ValueError(f"{file} has form {first.get('form')}, this program reads {FORM}: freeze it again")
    records = (json.loads(line) for line in lines)
    return first, {record["name"]: record for record in records}


@dataclass(frozen=True)
class Row:
    """A difference that is known to be right, and the independent check that says so."""

    scene: str
    key: str
    old: str
    new: str
    check: str


def rows(text: str) -> list[Row]:
    """Rows of the table of differences.md; those that were accepted excuse nothing any more.

    Raises
    ------
    ValueError
        A row without five cells, or with an empty one.
    """
    found = []
    for line in text.partition(ACCEPTED)[0].splitlines():
        if not line.startswith("|"):
            continue
        cells = [each.strip().strip("`") for each in line.strip().strip("|").split("|")]
        if cells[0] == "scene" or set("".join(cells)) <= set("-: "):
            continue
        if len(cells) != 5 or not all(cells):
            raise ValueError(f"differences.md: a row needs scene, key, old, new and check: {line}")
        found.append(Row(*cells))
    return found


def excusing(table: Iterable[Row], scene: str, key: str) -> Row | None:
    """The row of a difference; scene and key of a row may be patterns, ``*`` for anything."""
    for row in table:
        if _fits(scene, row.scene) and _fits(key, row.key):
            return row
    return None


def _fits(name: str, pattern: str) -> bool:
    return name == pattern or fnmatchcase(name, pattern.replace("[", "[[]"))


def accepted(old: Record, new: Record, table: Iterable[Row], commit: str) -> Record:
    """A record with the answers of a later state, all of whose differences have a row.

    Where the check of the row begins with ``rounding`` both states are right, and may be as far apart again.
    """
    rows, values = list(table), dict(new["values"])
    for key, (value, error) in values.items():
        row = excusing(rows, old["name"], key)
        if row is not None and row.check.startswith(ROUNDING) and key in old["values"]:
            apart = abs(float(value) - float(old["values"][key][0]))
            values[key] = [value, short(max(float(error), apart))] if math.isfinite(apart) else [value, error]
    found = {key: new[key] for key in ("outcome", "what", "words", "said", "missing") if key in new}
    return {**old, **found, "values": values, "accepted": commit}


def chosen(names: Iterable[str], only: str | None, groups: str | None) -> list[str]:
    """Scenes whose name has a pattern (as in a shell, or a part of the name), of some groups (a, b)."""
    wanted = None if groups is None else {each.strip() for each in groups.split(",")}
    return [
        name
        for name in sorted(names)
        if (wanted is None or name.split("/")[0] in wanted)
        and (only is None or only in name or fnmatch(name, only))
    ]
