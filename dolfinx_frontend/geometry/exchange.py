"""What a STEP file says of its solids, to tell which of them OpenCASCADE did not translate.

Only the text is read: solids, the products they belong to, and how often assemblies use these. OpenCASCADE
leaves out silently what it cannot translate.
"""

from __future__ import annotations

import codecs
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from dolfinx_frontend.common.errors import SceneError

__all__ = ["Exchange", "check_begin", "closed"]

# All of these are found in a time that grows with the length of the text, whatever is in it.
_STATEMENT = re.compile(r"\s*+((?:[^';]++|'[^']*+'|')*+)(?:;|\Z)")
_INSTANCE = re.compile(r"#(\d{1,12})\s*+=\s*+(.*)", re.DOTALL)
_DATA = re.compile(r"DATA\s*+(\(.*\)\s*)?", re.DOTALL)
_COMMENT = re.compile(r"('[^']*+')|/\*.*?(?:\*/|\Z)", re.DOTALL)
_OUTSIDE = re.compile(
    r"\b(DOCUMENT_FILE|DCMFL|(APPLIED_)?EXTERNAL_IDENTIFICATION_ASSIGNMENT|AEIA|EXTERNAL_SOURCE|EXTSRC)\b",
    re.IGNORECASE,
)
"""Entities, by their long and short names, in which the names of other files are."""
_SYNTAX = re.compile(r"\(?[\s!]*[A-Z][A-Z0-9_]*\s*\([A-Z0-9_#$*.,()+\-\s\"!'e]*\)\s*")
_UNBOUNDED = re.compile(
    r"(?<![.\w#\"])[+-]?(?:nan|inf(?:inity)?|\d[\d.]*+e\+?\d{3,})(?![\w.])", re.IGNORECASE
)
"""What OpenCASCADE may read as no finite number, and compute with for ever."""
_KEYWORD = re.compile(r"\(?\s*([A-Z_0-9]+)")
_REFERENCE = re.compile(r"#(\d{1,12})")
_TEXT = re.compile(r"'((?:[^']|'')*)'")
_SOLIDS = frozenset(("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "FACETED_BREP"))
_OF_SOLIDS = frozenset(("ADVANCED_BREP_SHAPE_REPRESENTATION", "FACETED_BREP_SHAPE_REPRESENTATION"))
_NO_SOLIDS = frozenset(
    (
        "AXIS2_PLACEMENT_3D",
        "MAPPED_ITEM",
        "SHELL_BASED_SURFACE_MODEL",
        "GEOMETRIC_SET",
        "GEOMETRIC_CURVE_SET",
        "CARTESIAN_POINT",
        "STYLED_ITEM",
    )
)


_MOST_PLACES = 100_000
"""Places of a product in its assemblies, at most: some thousand are what gmsh can be asked to mesh."""


def plain_text(path: Path) -> str:
    """The text of a file without its comments, but with their lines."""
    text = path.read_text(encoding="latin-1")
    return _COMMENT.sub(lambda m: m[1] or "\n" * m[0].count("\n"), text) if "/*" in text else text


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1


def _is_finite(number: str) -> bool:
    try:
        return math.isfinite(float(number))
    except ValueError:  # "1.2.3e400"
        return False


def closed(path: Path) -> tuple[str, ...]:
    """Make a file name no other files: OpenCASCADE would open them. What it named, without what is empty."""
    text = plain_text(path)
    if not _OUTSIDE.search(text):
        return ()
    names, parts = list[str](), list[str]()
    for m in _STATEMENT.finditer(text):
        if _OUTSIDE.search(_TEXT.sub("''", m[0])):
            names += [each for each in _TEXT.findall(m[0]) if each.strip()]
            parts.append(_TEXT.sub("''", m[0]))
        else:
            parts.append(m[0])
    path.write_text("".join(parts), encoding="latin-1")
    return tuple(dict.fromkeys(names))


def check_begin(name: str, first: bytes) -> None:
    """Refuse a file that does not begin as STEP, by its first bytes.

    Raises
    ------
    SceneError
        It does not.
    """
    if first.startswith(codecs.BOM_UTF8):  # OpenCASCADE finds nothing in it
        raise SceneError(
            f"{name!r} cannot be read as STEP: it begins with a byte order mark of an editor; save it "
            "as plain text without one"
        )
    if b"ISO-10303-21" not in first:
        raise SceneError(
            f"{name!r} cannot be read as STEP: it does not begin with ISO-10303-21 (an exchange file "
            "of ISO 10303-21 does); export it as STEP AP203, AP214 or AP242"
        )


@dataclass(frozen=True)
class Exchange:
    """What is in a file.

    Attributes
    ----------
    instances
        Number -> what stands behind the equals sign.
    flaws
        Lines that are not written as ISO 10303-21 has it, in words.
    """

    instances: Mapping[int, str]
    flaws: tuple[str, ...] = ()

    @staticmethod
    def of(path: Path, name: str = "") -> Exchange:
        """The instances of a file, as far as they can be told apart; `name`: what messages call it.

        Raises
        ------
        SceneError
            The file is no text, has no end, or numbers that are not finite.
        """
        text = plain_text(path)
        if "\0" in text:
            raise SceneError(
                f"{name or path.name!r} cannot be read as STEP: line {_line(text, text.index(chr(0)))} is no "
                "text; export or copy it again"
            )
        if "END-ISO-10303-21" not in text[-4096:]:
            raise SceneError(
                f"{name or path.name!r} cannot be read as STEP: it does not end with END-ISO-10303-21, so "
                "that a part of it may be missing; export or copy it again"
            )
        begin = next((m.end() for m in _STATEMENT.finditer(text) if _DATA.fullmatch(m[1].rstrip())), 0)
        instances: dict[int, str] = {}
        wrong = []
        for statement in _STATEMENT.finditer(text, begin):
            at, each = statement.start(1), statement[1].rstrip()
            if each.startswith("END-ISO-10303-21"):
                break
            if not each or each == "ENDSEC" or _DATA.fullmatch(each):
                continue
            m = _INSTANCE.fullmatch(each)
            if m is None:
                wrong.append(at)
                continue
            plain = _TEXT.sub("''", m[2]) if "'" in m[2] else m[2]
            if (number := _UNBOUNDED.search(plain)) and not _is_finite(number[0]):
                raise SceneError(
                    f"{name or path.name!r} cannot be read as STEP: {number[0]} in line {_line(text, at)} is "
                    "no finite number; export it again"
                )
            if int(m[1]) in instances or not _SYNTAX.fullmatch(plain) or plain.count("(") != plain.count(")"):
                wrong.append(at)
            instances[int(m[1])] = m[2]
        flaws = [f"line {_line(text, at)} is damaged" for at in wrong[:3]]
        if len(wrong) > len(flaws):
            flaws.append(f"{len(wrong) - len(flaws)} more lines are")
        exchange = Exchange(instances, tuple(flaws))
        _ = exchange.places  # refuses what OpenCASCADE would be lost in
        return exchange

    @cached_property
    def _by_keyword(self) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for number, text in self.instances.items():
            if keyword := _KEYWORD.match(text):
                found.setdefault(keyword[1], []).append(number)
        return found

    def _all(self, keywords: Iterable[str]) -> list[int]:
        return [number for keyword in keywords for number in self._by_keyword.get(keyword, ())]

    @cached_property
    def _all_references(self) -> dict[int, list[int]]:
        """What each instance refers to, in order."""
        return {
            number: [int(r) for r in _REFERENCE.findall(_TEXT.sub("''", text) if "'" in text else text)]
            for number, text in self.instances.items()
        }

    def _references(self, number: int) -> list[int]:
        return self._all_references.get(number, [])

    def _name(self, definition: int) -> str:
        """Name of the product of a definition: definition -> formation -> product."""
        for formation in self._references(definition)[:1]:
            for product in self._references(formation)[:1]:
                if text := _TEXT.search(self.instances.get(product, "")):
                    return text[1].strip()
        return ""

    @cached_property
    def places(self) -> dict[int, int]:
        """Number of a definition -> how often it is there: in each place of each assembly that uses it.

        Each is counted once, after all that use it. One that nothing uses is left out, and so are those in a
        circle, which only a damaged file has.

        Raises
        ------
        SceneError
            More places than anybody means.
        """
        uses: dict[int, list[int]] = {}
        for use in self._all(["NEXT_ASSEMBLY_USAGE_OCCURRENCE"]):
            if len(ends := self._references(use)) >= 2:
                uses.setdefault(ends[1], []).append(ends[0])
        within: dict[int, list[int]] = {}
        for definition, above in uses.items():
            for each in above:
                within.setdefault(each, []).append(definition)
        waits = {definition: len(above) for definition, above in uses.items()}
        places = dict.fromkeys(within.keys() - uses.keys(), 1)
        ready = list(places)
        for definition in ready:  # which grows
            for each in within.get(definition, ()):
                places[each] = places.get(each, 0) + places[definition]
                waits[each] -= 1
                if waits[each] == 0:
                    ready.append(each)
            if places[definition] > _MOST_PLACES:
                raise SceneError(
                    f"a product is in {places[definition]} places of the assembly; export a part of it"
                )
        return {definition: places[definition] for definition in ready}

    @cached_property
    def solids(self) -> dict[int, tuple[str, int]]:
        """Number of a solid -> name of its product, and how often an assembly has it.

        A shape that is not there is counted as one. Solids that nothing refers to belong to no product.
        """
        shapes = {n: self._references(n)[:1] for n in self._all(["PRODUCT_DEFINITION_SHAPE"])}
        # a representation of a part may be linked to the one that its product names
        linked: dict[int, set[int]] = {}
        for relation in self._all(["SHAPE_REPRESENTATION_RELATIONSHIP"]):
            if len(pair := self._references(relation)) >= 2:
                linked.setdefault(pair[0], set()).add(pair[1])
                linked.setdefault(pair[1], set()).add(pair[0])
        solids = set(self._all(_SOLIDS))
        # what a representation of solids has is one, in a damaged file under another name or under none
        for representation in self._all(_OF_SOLIDS):
            text = self.instances[representation].rpartition(")")[0].rpartition(",")[0]  # without its units
            for item in map(int, _REFERENCE.findall(_TEXT.sub("''", text))):
                keyword = _KEYWORD.match(self.instances.get(item, ""))
                if keyword is None or keyword[1] not in _NO_SOLIDS:
                    solids.add(item)
        shape_of: dict[int, tuple[str, int]] = {}
        for link in self._all(["SHAPE_DEFINITION_REPRESENTATION"]):
            ends = self._references(link)
            if len(ends) >= 2 and shapes.get(ends[0]):
                definition = shapes[ends[0]][0]
                shape_of[ends[1]] = self._name(definition), self.places.get(definition, 1)
        # what is none may have been anything
        out = {number: one for number, one in shape_of.items() if not self._is_shape(number)}
        held: dict[int, tuple[str, int]] = {}
        for number, one in shape_of.items():
            held |= dict.fromkeys((number, *linked.get(number, ())), one)
        for representation, one in held.items():
            out |= {item: one for item in self._references(representation) if item in solids}
        # in a damaged file nothing may be left of a product but its solids
        used = set().union(*self._all_references.values())
        for representation in self._all(_OF_SOLIDS):
            if representation not in used:
                out |= {i: ("", 1) for i in self._references(representation) if i in solids and i not in out}
        return out

    def _is_shape(self, number: int) -> bool:
        """Whether an instance is a representation, and not one of solids that has none."""
        text = self.instances.get(number, "")
        keyword = _KEYWORD.match(text)
        if keyword is None or "REPRESENTATION" not in text:
            return False
        kinds = [_KEYWORD.match(self.instances.get(item, "")) for item in self._references(number)]
        return keyword[1] not in _OF_SOLIDS or any(
            k is not None and (k[1] in _SOLIDS or k[1] == "MAPPED_ITEM") for k in kinds
        )

    def broken(self) -> dict[int, int]:
        """Solids that need an instance which the file does not have: number -> number of that instance."""
        needed_by: dict[int, list[int]] = {}
        for number, references in self._all_references.items():
            for other in references:
                needed_by.setdefault(other, []).append(number)
        lacks = {number: number for number in needed_by.keys() - self.instances.keys()}
        left = list(lacks)
        for number in left:  # which grows
            for above in needed_by.get(number, ()):
                if above not in lacks:
                    lacks[above] = lacks[number]
                    left.append(above)
        out = {}
        for solid in self.solids:
            keyword = _KEYWORD.match(self.instances.get(solid, ""))
            if keyword is None or keyword[1] not in _SOLIDS:
                out[solid] = solid
            elif solid in lacks:
                out[solid] = lacks[solid]
        return out

    def lost(self, found: Iterable[str]) -> list[str]:
        """Which solids are missing or damaged, in words.

        Parameters
        ----------
        found
            Names of the products of the solids that were translated, as the file has them.
        """
        names = Counter(found)
        broken = self.broken()
        out = [*self.flaws]
        for solid, at in broken.items():
            why = "it is damaged" if solid == at else f"it needs #{at}, which the file does not have"
            out.append(f"{self._words(solid)} ({why})")
        wanted = sum(count for _, count in self.solids.values())
        number = wanted - names.total()
        if number <= sum(self.solids[solid][1] for solid in broken):
            return out
        expected: Counter[str] = Counter()
        for name, count in self.solids.values():
            expected[name] += count
        missing = expected - names
        suspects = [s for s, (name, _) in self.solids.items() if missing[name] and s not in broken]
        if len(suspects) == number - len(broken):
            return [*out, *map(self._words, suspects)]
        listed = ", ".join(map(self._words, (suspects or list(self.solids))[:8]))
        more = ", ..." if len(suspects or self.solids) > 8 else ""
        return [*out, f"{number} of these {wanted}: {listed}{more}"]

    def _words(self, solid: int) -> str:
        name = self.solids[solid][0]
        return f"{name!r} (#{solid})" if name else f"#{solid}"
