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

__all__ = ["Exchange"]

_INSTANCE = re.compile(r"#(\d{1,12})\s*=\s*((?:[^';]++|'[^']*+')*+);")
_KEYWORD = re.compile(r"\(?\s*([A-Z_0-9]+)\s*\(")
_REFERENCE = re.compile(r"#(\d{1,12})")
_TEXT = re.compile(r"'((?:[^']|'')*)'")
_SOLIDS = frozenset(("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "FACETED_BREP"))


@dataclass(frozen=True)
class Exchange:
    """The instances of a file: number -> what stands behind the equals sign."""

    instances: Mapping[int, str]

    @staticmethod
    def of(path: Path) -> Exchange:
        """The instances of a file, as far as they can be told apart."""
        text = path.read_text(encoding="latin-1")
        return Exchange({int(m[1]): m[2] for m in _INSTANCE.finditer(text)})

    @cached_property
    def _by_keyword(self) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for number, text in self.instances.items():
            if keyword := _KEYWORD.match(text):
                found.setdefault(keyword[1], []).append(number)
        return found

    def _all(self, keywords: Iterable[str]) -> list[int]:
        return [number for keyword in keywords for number in self._by_keyword.get(keyword, ())]

    def _references(self, number: int) -> list[int]:
        text = _TEXT.sub("''", self.instances.get(number, ""))
        return [int(r) for r in _REFERENCE.findall(text)]

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

        Solids that belong to no product are left out, as OpenCASCADE leaves them out.
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
        out: dict[int, tuple[str, int]] = {}
        for link in self._all(["SHAPE_DEFINITION_REPRESENTATION"]):
            ends = self._references(link)
            if len(ends) < 2 or not shapes.get(ends[0]):
                continue
            definition = shapes[ends[0]][0]
            for representation in (ends[1], *linked.get(ends[1], ())):
                for item in self._references(representation):
                    if item in solids:
                        out[item] = (self._name(definition), self._count(definition, uses, ()))
        return out

    def _count(self, definition: int, uses: Mapping[int, list[int]], above: tuple[int, ...]) -> int:
        """How often a definition is there: once, or in each place of each assembly that uses it."""
        if definition in above:  # a circle: the file is damaged
            return 1
        places = uses.get(definition, [])
        return sum(self._count(p, uses, (*above, definition)) for p in places) if places else 1

    def _broken(self, solid: int) -> int | None:
        """An instance that a solid needs and the file does not have."""
        seen, left = {solid}, [solid]
        while left:
            for other in self._references(left.pop()):
                if other not in self.instances:
                    return other
                if other not in seen:
                    seen.add(other)
                    left.append(other)
        return None

    def lost(self, found: Iterable[str]) -> list[str]:
        """Which solids are missing, in words, if the file has more of them than were `found`.

        Parameters
        ----------
        found
            Names of the products of the solids that were translated, as the file has them.
        """
        names = Counter(found)
        wanted = sum(count for _, count in self.solids.values())
        number = wanted - names.total()
        if number <= 0:
            return []
        broken = {solid: at for solid in self.solids if (at := self._broken(solid)) is not None}
        if sum(self.solids[solid][1] for solid in broken) == number:
            return [f"{self._words(s)} (it needs #{at}, which the file does not have)" for s, at in broken.items()]
        expected: Counter[str] = Counter()
        for name, count in self.solids.values():
            expected[name] += count
        missing = expected - names
        suspects = [solid for solid, (name, _) in self.solids.items() if missing[name]]
        if missing.total() == number and len(suspects) == number:
            return [self._words(solid) for solid in suspects]
        listed = ", ".join(map(self._words, (suspects or list(self.solids))[:8]))
        return [f"{number} of {wanted}: of {listed}" + (", ..." if len(self.solids) > 8 else "")]

    def _words(self, solid: int) -> str:
        name = self.solids[solid][0]
        return f"{name!r} (#{solid})" if name else f"#{solid}"
