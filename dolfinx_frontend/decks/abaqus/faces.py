"""Named faces of the pieces of a deck."""

from __future__ import annotations

from collections.abc import Mapping

from dolfinx_frontend.decks.abaqus.pieces import Mesh, Pairs

__all__ = ["Faces", "Sides"]

Sides = dict[int, Pairs]
"""Faces by piece."""


class Faces:
    """Named faces of the pieces: what is asked for is made of faces that do not overlap."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._asked: list[tuple[str, Sides]] = []
        self._names: list[dict[int, list[str]]] = []
        self.of_piece: dict[int, dict[str, Pairs]] = {}

    def ask(self, label: str, sides: Mapping[int, Pairs]) -> int:
        """Number under which the names of these faces are found later."""
        wanted = {p: sorted(set(pairs)) for p, pairs in sides.items()}
        for k, (_, before) in enumerate(self._asked):
            if before == wanted:
                return k
        self._asked.append((label, wanted))
        return len(self._asked) - 1

    def taken(self) -> set[tuple[int, int]]:
        """All faces that have been asked for."""
        return {side for _, sides in self._asked for pairs in sides.values() for side in pairs}

    def divide(self) -> None:
        """Make faces of all that has been asked for."""
        asked_by: dict[int, dict[tuple[int, int], list[int]]] = {}
        for k, (_, sides) in enumerate(self._asked):
            for p, pairs in sides.items():
                for side in pairs:
                    asked_by.setdefault(p, {}).setdefault(side, []).append(k)
        self._names = [{} for _ in self._asked]
        for p, of_side in asked_by.items():
            groups: dict[tuple[int, ...], Pairs] = {}
            for side, asking in of_side.items():
                groups.setdefault(tuple(asking), []).append(side)
            for numbers, pairs in groups.items():
                name = self.add(p, self._asked[numbers[0]][0], pairs)
                for k in numbers:
                    self._names[k].setdefault(p, []).append(name)

    def add(self, p: int, label: str, pairs: Pairs) -> str:
        """A face of a piece under the name of a label, or one like it."""
        names = self.of_piece.setdefault(p, {})
        base = "".join(c if c.isalnum() or c in "._- " else "_" for c in label) or "face"
        name, number = base, 2
        while name in names or name == "free":
            name, number = f"{base}#{number}", number + 1
        names[name] = pairs
        return name

    def named(self, asked: int) -> list[tuple[int, str, Pairs]]:
        """Piece, name and faces of what was asked for."""
        return [
            (p, name, self.of_piece[p][name]) for p, names in self._names[asked].items() for name in names
        ]

    def text(self, p: int, name: str) -> str:
        """As a scene writes it."""
        return f"{self.mesh.pieces[p].name}:{name}"
