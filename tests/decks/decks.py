"""Decks as text: bricks of any element type, for the tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
TETS = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n200000., .3\n"


class Brick:
    """A block of elements as a deck writes it; nodes and elements are numbered from `first`."""

    def __init__(
        self,
        kind: str,
        name: str,
        size: Sequence[float],
        divisions: Sequence[int],
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        first: int = 1,
        mapping: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        self.kind, self.name, self.first = kind, name, first
        self.size, self.origin = np.array(size, float), np.array(origin, float)
        self.mapping = mapping
        self._of: dict[tuple[float, ...], int] = {}
        self._boxed: dict[int, np.ndarray] = {}
        self.x: dict[int, np.ndarray] = {}
        self.elements: list[list[int]] = []
        flat = kind[0] == "C" and kind[1] in "PA"
        count = int("".join(c for c in kind[3:] if c.isdigit()))
        step = np.array(size, float) / np.array(divisions[: len(size)])
        self.flat = flat
        for index in np.ndindex(*divisions[: 2 if flat else 3]):
            low = self.origin[: len(step)] + step * index
            if flat:
                corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
                x = np.array([[*(low + step * c), 0.0] for c in corners])
                edges: Iterable[tuple[int, int]] = ((0, 1), (1, 2), (2, 3), (3, 0))
                cells = [(0, 1, 2), (0, 2, 3)] if count in (3, 6) else [(0, 1, 2, 3)]
                if count in (3, 6):
                    edges = ((0, 1), (1, 2), (2, 0))
            else:
                corners = [(*xy, z) for z in (0, 1) for xy in ((0, 0), (1, 0), (1, 1), (0, 1))]
                x = np.array([low + step * c for c in corners])
                cells = list(TETS) if count in (4, 10) else [tuple(range(8))]
                edges = TET_EDGES if count in (4, 10) else EDGES
            for cell in cells:
                local = x[list(cell)]
                nodes = [self._node(p) for p in local]
                if count in (6, 8, 10, 20) and count > len(cell):
                    nodes += [self._node(0.5 * (local[a] + local[b])) for a, b in edges]
                self.elements.append(nodes)

    def _node(self, x: np.ndarray) -> int:
        key = tuple(np.round(x, 9))
        if key not in self._of:
            number = self.first + len(self._of)
            self._of[key] = number
            self._boxed[number] = x
            self.x[number] = x if self.mapping is None else self.mapping(x)
        return self._of[key]

    def nodes_at(self, axis: int, high: bool = False) -> list[int]:
        """Nodes of a side of the box."""
        value = self.origin[axis] + (self.size[axis] if high else 0.0)
        return [n for n, x in self._boxed.items() if abs(x[axis] - value) < 1e-9]

    def text(self, section: str | None = "STEEL", sets: bool = True) -> str:
        """Nodes, elements, sets of the six sides NAME_X0 ..., and surfaces of them."""
        out = [f"*NODE, NSET=N{self.name}"]
        out += [f"{n}, {x[0]:.15g}, {x[1]:.15g}, {x[2]:.15g}" for n, x in self.x.items()]
        out += [f"*ELEMENT, TYPE={self.kind}, ELSET={self.name}"]
        for number, nodes in enumerate(self.elements, start=self.first):
            words = list(map(str, (number, *nodes)))
            lines = [words[k : k + 11] for k in range(0, len(words), 11)]
            out += [", ".join(line) + ("," if k + 1 < len(lines) else "") for k, line in enumerate(lines)]
        if section:
            out += [f"*SOLID SECTION, ELSET={self.name}, MATERIAL={section}"]
        for axis, letter in enumerate("XY" if self.flat else "XYZ"):
            for high in (False, True):
                name = f"{self.name}_{letter}{int(high)}"
                nodes = self.nodes_at(axis, high)
                out += [f"*NSET, NSET={name}"]
                out += [", ".join(map(str, nodes[k : k + 12])) for k in range(0, len(nodes), 12)]
                if not self.flat and self.kind.startswith("C3D") and self.kind[3:].strip("RI") in ("8", "20"):
                    out += self._surface(name, axis, high)
        return "\n".join(out) + "\n"

    def _surface(self, name: str, axis: int, high: bool) -> list[str]:
        label = {(0, False): "S6", (0, True): "S4", (1, False): "S3", (1, True): "S5",
                 (2, False): "S1", (2, True): "S2"}[axis, high]
        members = self.members_at(axis, high)
        out = [f"*ELSET, ELSET=E{name}", *(f"{m}," for m in members)]
        return [*out, f"*SURFACE, NAME=S{name}", f"E{name}, {label}"]

    def members_at(self, axis: int, high: bool = False) -> list[int]:
        """Elements with 4 corners on a side of the box."""
        on = set(self.nodes_at(axis, high))
        return [
            self.first + k for k, nodes in enumerate(self.elements)
            if sum(n in on for n in nodes[:8]) >= 4
        ]
