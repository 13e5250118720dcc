"""Executive and case control of a bulk data file: which loads, supports and temperatures a subcase has."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.decks.lines import DeckError

__all__ = ["Case", "cases"]

Line = tuple[Where, str]
_SETS = {
    "SPC": "SPC",
    "LOAD": "LOAD",
    "TEMP": "TEMP(BOTH)",
    "TEMPERATURE": "TEMP(BOTH)",
    "TEMP(LOAD)": "TEMP(LOAD)",
    "TEMPERATURE(LOAD)": "TEMP(LOAD)",
    "TEMP(INIT)": "TEMP(INIT)",
    "TEMP(INITIAL)": "TEMP(INIT)",
    "TEMPERATURE(INITIAL)": "TEMP(INIT)",
    "TEMPERATURE(INIT)": "TEMP(INIT)",
}
_REFUSED = ("MPC", "METHOD", "NLPARM", "BCONTACT", "BCSET", "BOLTLD", "DEFORM", "DLOAD", "TSTEP")


@dataclass
class Case:
    """A subcase: kind of a set (SPC, LOAD, TEMP(LOAD), TEMP(INIT)) -> its number, and where that is said."""

    number: int
    where: Where
    sets: dict[str, tuple[int, Where]] = field(default_factory=dict)

    def of(self, kind: str) -> int | None:
        """The number of a set; None: there is none."""
        found = self.sets.get(kind)
        return None if found is None else found[0]


def cases(lines: list[Line]) -> list[Case]:
    """The subcases; one, of number 1, if the file has no case control.

    Raises
    ------
    DeckError
        Another solution than linear statics, requests that have no counterpart.
    """
    above = Case(1, lines[0][0] if lines else Where("", 1))
    found: list[Case] = []
    for where, line in lines:
        row = line.partition("$")[0].strip().upper()
        key, _, value = (re.sub(r"\s", "", word) for word in row.partition("="))
        words = row.split()
        if words[:1] == ["SOL"] and words[1:2] not in (["101"], ["SESTATIC"], ["1"], ["24"]):
            raise DeckError(f"{where}: SOL {' '.join(words[1:])}: linear statics, SOL 101, is read")
        if words[:1] == ["SUBCASE"]:
            number = words[1] if len(words) > 1 and words[1].isdigit() else "0"
            found.append(Case(int(number), where, dict(above.sets)))
        elif key in _SETS:
            if not value.isdigit():
                raise DeckError(f"{where}: {key} = {value[:40]!r} is no number of a set")
            (found[-1] if found else above).sets[_SETS[key]] = int(value), where
        elif key in _REFUSED:
            raise DeckError(f"{where}: {key} has no counterpart; take it out")
    every = found or [above]
    for case in every:
        both = case.sets.pop("TEMP(BOTH)", None)
        if both is not None:
            raise DeckError(f"{both[1]}: TEMPERATURE = {both[0]}: write TEMP(LOAD) or TEMP(INITIAL)")
    return every
