"""What a STEP file says of its solids, to tell which of them OpenCASCADE did not translate.

Only the text is read: solids, the products they belong to, and how often assemblies use these. OpenCASCADE
leaves out silently what it cannot translate.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from dolfinx_frontend.common.errors import SceneError

__all__ = ["Exchange"]

_INSTANCE = re.compile(r"#(\d{1,12})\s*=\s*((?:[^';]++|'[^']*+')*+);")
_COMMENT = re.compile(r"('[^']*+')|/\*.*?\*/", re.DOTALL)
_BETWEEN = re.compile(r"\s*(ENDSEC\s*;\s*DATA\s*(\([^;]*\))?\s*;\s*)*")
_SYNTAX = re.compile(r"\(?[\s!]*[A-Z][A-Z0-9_]*\s*\([A-Z0-9_#$*.,()+\-\s\"!'e]*\)\s*")
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
    def of(path: Path) -> Exchange:
        """The instances of a file, as far as they can be told apart.

        Raises
        ------
        SceneError
            The file has no end.
        """
        text = path.read_text(encoding="latin-1")
        if "END-ISO-10303-21" not in text[-4096:]:
            raise SceneError(
                f"{path.name!r} cannot be read as STEP: it does not end with END-ISO-10303-21, so that a "
                "part of it may be missing; export or copy it again"
            )
        if "/*" in text:  # comments, but not their lines
            text = _COMMENT.sub(lambda m: m[1] or "\n" * m[0].count("\n"), text)
        begin = re.search(r"\bDATA\s*(\([^;]*\))?\s*;", text)
        end = text.rfind("ENDSEC")
        instances: dict[int, str] = {}
        wrong = []
        at = begin.end() if begin else 0
        for m in _INSTANCE.finditer(text, at, end if end > at else len(text)):
            plain = _TEXT.sub("''", m[2]) if "'" in m[2] else m[2]
            if not _BETWEEN.fullmatch(text, at, m.start()):
                wrong.append(at)
            if int(m[1]) in instances or not _SYNTAX.fullmatch(plain) or plain.count("(") != plain.count(")"):
                wrong.append(m.start())
            instances[int(m[1])] = m[2]
            at = m.end()
        if end > at and not _BETWEEN.fullmatch(text, at, end):
            wrong.append(at)
        lines = [text.count("\n", 0, at + len(text[at:]) - len(text[at:].lstrip())) + 1 for at in wrong[:3]]
        flaws = [f"line {line} is damaged" for line in lines]
        if len(wrong) > len(flaws):
            flaws.append(f"{len(wrong) - len(flaws)} more lines are")
        return Exchange(instances, tuple(flaws))

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
    def solids(self) -> dict[int, tuple[str, int]]:
        """Number of a solid -> name of its product, and how often an assembly has it.

        A shape that is not there is counted as one. Solids that nothing refers to belong to no product.
        """
        shapes = {n: self._references(n)[:1] for n in self._all(["PRODUCT_DEFINITION_SHAPE"])}
        uses: dict[int, list[int]] = {}
        for use in self._all(["NEXT_ASSEMBLY_USAGE_OCCURRENCE"]):
            if len(ends := self._references(use)) >= 2:
                uses.setdefault(ends[1], []).append(ends[0])
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
        out: dict[int, tuple[str, int]] = {}
        for link in self._all(["SHAPE_DEFINITION_REPRESENTATION"]):
            ends = self._references(link)
            if len(ends) < 2 or not shapes.get(ends[0]):
                continue
            definition = shapes[ends[0]][0]
            one = self._name(definition), self._count(definition, uses, ())
            if not self._is_shape(ends[1]):  # whatever was in it
                out[ends[1]] = one
            for representation in (ends[1], *linked.get(ends[1], ())):
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

    def _count(self, definition: int, uses: Mapping[int, list[int]], above: tuple[int, ...]) -> int:
        """How often a definition is there: once, or in each place of each assembly that uses it."""
        if definition in above:  # a circle: the file is damaged
            return 1
        places = uses.get(definition, [])
        return sum(self._count(p, uses, (*above, definition)) for p in places) if places else 1

    def broken(self) -> dict[int, int]:
        """Solids that need an instance which the file does not have: number -> number of that instance."""
        out = {}
        sound: set[int] = set()  # instances that need nothing that is missing
        for solid in self.solids:
            seen, left = {solid}, [solid]
            keyword = _KEYWORD.match(self.instances.get(solid, ""))
            if keyword is None or keyword[1] not in _SOLIDS:
                out[solid] = solid
            while left and solid not in out:
                for other in self._references(left.pop()):
                    if other not in self.instances:
                        out[solid] = other
                        break
                    if other not in seen and other not in sound:
                        seen.add(other)
                        left.append(other)
            if solid not in out:
                sound |= seen
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
