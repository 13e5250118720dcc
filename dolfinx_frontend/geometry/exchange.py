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
    """The instances of a file: number -> what stands behind the equals sign."""

    instances: Mapping[int, str]

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
                f"{path.name!r} cannot be read as STEP: it does not end with END-ISO-10303-21, so that a part of "
                "it may be missing; export or copy it again"
            )
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

    def broken(self) -> dict[int, int]:
        """Solids that need an instance which the file does not have: number -> number of that instance."""
        out = {}
        sound: set[int] = set()  # instances that need nothing that is missing
        for solid in self.solids:
            seen, left = {solid}, [solid]
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
        out = [f"{self._words(s)} (it needs #{at}, which the file does not have)" for s, at in broken.items()]
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
