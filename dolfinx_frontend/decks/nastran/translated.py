"""Cards of bulk data as the keyword cards of the model that decks share; each keeps its file and line."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.cards import Card, Note, Row
from dolfinx_frontend.decks.abaqus.elements import FACES
from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.nastran.bulk import BulkCard
from dolfinx_frontend.decks.nastran.case import Case

__all__ = ["Bush", "Translated", "translated"]

IGNORED = {
    "PARAM": "parameters of another program",
    "EIGRL": "no vibrations",
    "EIGR": "no vibrations",
    "CONM2": "nothing is weighed",
    "MDLPRM": "parameters of another program",
}
_WHY = "is not read; solids, RBE2, RBE3, CBUSH, SPC, FORCE, PLOAD4 and TEMP are"
REFUSED = {
    "BOLT": "bolts are not read; use scene.beam or a pre-tension section",
    "LOAD": "sets of loads that add others up are not read; give FORCE and PLOAD4 in one set",
    "SPCADD": "sets of supports that add others up are not read; give SPC and SPC1 in one set",
    "MPC": "equations between nodes are not read",
    "CPENTA": "wedges have no counterpart; mesh with tetrahedra or hexahedra",
    "CPYRAM": "pyramids have no counterpart; mesh with tetrahedra or hexahedra",
}
"""Card -> why it is refused; others with what is read."""

_CELLS = {"CTETRA": {4: "C3D4", 10: "C3D10"}, "CHEXA": {8: "C3D8", 20: "C3D20"}}
_TOP_BEFORE_SIDES = [*range(12), *range(16, 20), *range(12, 16)]
_AXES_ALIKE = 1e-9
"""Directions of coordinate systems that differ by less are the same."""


class Keyword(Card):
    """A keyword card that stands for one of Nastran, whose name errors have."""

    def error(self, text: str, where: Where | None = None) -> DeckError:
        """The error of this card, to be raised."""
        return DeckError(f"{where or self.where}: {self.parameters.get('_OF', self.keyword)}: {text}")


class Bush(NamedTuple):
    """An elastic joint: its nodes (None: the ground) and stiffnesses by motion."""

    card: BulkCard
    first: int
    second: int | None
    stiffness: dict[str, float]


@dataclass
class Translated:
    """Keyword cards, and what they have no words for."""

    cards: list[Card]
    notes: list[Note]
    bushes: list[Bush]


class _System(NamedTuple):
    """A rectangular coordinate system: origin, and rows of axes."""

    origin: Array
    axes: Array


class _Translation:
    """Of one subcase."""

    def __init__(self, cards: Iterable[BulkCard], case: Case) -> None:
        self.case, self.notes = case, list[Note]()
        self.by_name: dict[str, list[BulkCard]] = {}
        refused = []
        for card in cards:
            if card.name in IGNORED:
                self.notes.append(Note("ignored", card.name, *card.where, IGNORED[card.name]))
            elif card.name in _READ:
                self.by_name.setdefault(card.name, []).append(card)
            else:
                why = REFUSED.get(card.name, _WHY)
                refused.append(Note("refused", card.name, *card.where, why))
        if refused:
            first = list({note.keyword: note for note in reversed(refused)}.values())[::-1]
            lines = "\n  ".join(f"{n.file}:{n.line}: {n.keyword} {n.text}" for n in first)
            error = DeckError(f"{first[0].file}: {len(refused)} card(s) are refused:\n  {lines}")
            error.notes = tuple(refused)
            raise error
        self.systems = self._systems()
        self.x = {card.whole(0, "its number"): self._place(card) for card in self.of("GRID")}
        self.cells: dict[int, tuple[str, list[int]]] = {}
        self.made: list[Card] = []

    def of(self, *names: str) -> list[BulkCard]:
        """The cards of some names."""
        return [card for name in names for card in self.by_name.get(name, [])]

    def add(
        self, keyword: str, of: BulkCard, rows: Iterable[Iterable[object]] = (), **parameters: str
    ) -> None:
        """A keyword card in the place of one of Nastran; parameters in capital letters."""
        words = [Row(of.where, [str(word) for word in row]) for row in rows]
        self.made.append(Keyword(keyword, of.where, {**parameters, "_OF": of.name}, words))

    def each(self, keyword: str, cards: Iterable[tuple[BulkCard, list[object]]], **parameters: str) -> None:
        """One keyword card with a row of each of several cards."""
        rows = [(card, Row(card.where, [str(word) for word in words])) for card, words in cards]
        if rows:
            given = {**parameters, "_OF": rows[0][0].name}
            self.made.append(Keyword(keyword, rows[0][0].where, given, [row for _, row in rows]))

    # --- places -----------------------------------------------------------------------------------
    def _systems(self) -> dict[int, _System]:
        found = {0: _System(np.zeros(3), np.eye(3))}
        left = self.of("CORD2R")
        while left:
            later = []
            for card in left:
                base = found.get(card.whole(1, "RID", 0, 0))
                if base is None:
                    later.append(card)
                    continue
                three = [[card.real(k + i, "a coordinate", 0.0) for i in range(3)] for k in (2, 5, 8)]
                a, b, c = base.origin + np.array(three) @ base.axes
                z = b - a
                y = np.cross(z, c - a)
                if not np.linalg.norm(z) or np.linalg.norm(y) <= _AXES_ALIKE * np.linalg.norm(z) ** 2:
                    raise card.error("its three points are on a line")
                z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
                found[card.whole(0, "its number")] = _System(a, np.array([np.cross(y, z), y, z]))
            if len(later) == len(left):
                raise later[0].error(f"there is no coordinate system {later[0].text(1)}")
            left = later
        return found

    def system(self, card: BulkCard, k: int, what: str) -> _System:
        """The system that a field names."""
        number = card.whole(k, what, 0, 0)
        if number not in self.systems:
            raise card.error(f"{what} = {number}: there is no CORD2R of that number")
        return self.systems[number]

    def _place(self, card: BulkCard) -> Array:
        system = self.system(card, 1, "CP")
        moves = self.system(card, 5, "CD")
        if np.abs(moves.axes - np.eye(3)).max() > _AXES_ALIKE:
            raise card.error(f"CD = {card.text(5)}: displacements along axes of their own are not read")
        x = np.array([card.real(k, "a coordinate", 0.0) for k in (2, 3, 4)])
        return np.asarray(system.origin + x @ system.axes)

    def known(self, card: BulkCard, k: int) -> int:
        """A node that a field names."""
        node = card.whole(k, "a node")
        if node not in self.x:
            raise card.error(f"there is no GRID {node}")
        return node

    # --- parts ------------------------------------------------------------------------------------
    def parts(self) -> None:
        """Nodes, elements, materials and sections."""
        grids = self.of("GRID")
        self.each("NODE", ((g, [n, *map(repr, map(float, x))]) for g, (n, x) in zip(grids, self.x.items())))
        groups: dict[tuple[str, int], list[tuple[BulkCard, list[object]]]] = {}
        for card in self.of(*_CELLS):
            nodes = [self.known(card, k) for k in range(2, len(card.fields)) if card.text(k)]
            if len(nodes) not in _CELLS[card.name]:
                counts = " or ".join(map(str, _CELLS[card.name]))
                raise card.error(f"{len(nodes)} nodes; give {counts}, all in the middle of edges or none")
            number = card.whole(0, "its number")
            self.cells[number] = card.name, nodes
            kind = _CELLS[card.name][len(nodes)]
            order = _TOP_BEFORE_SIDES if kind == "C3D20" else range(len(nodes))
            group = groups.setdefault((kind, card.whole(1, "its property")), [])
            group.append((card, [number, *(nodes[k] for k in order)]))
        for (kind, of), members in groups.items():
            # rows that name many nodes are one row each
            self.each("ELEMENT", members, TYPE=kind, ELSET=f"PSOLID-{of}")
        self._materials()
        used = {of for _, of in groups}
        for card in self.of("PSOLID"):
            if card.whole(0, "its number") in used:
                used.discard(card.whole(0, "its number"))
                self._section(card)
        if used:
            cell = next(c for c in self.of(*_CELLS) if c.whole(1, "its property") in used)
            raise cell.error(f"there is no PSOLID {cell.text(1)}")

    def _section(self, card: BulkCard) -> None:
        number, system = card.text(0), card.text(2)
        more = {}
        if system not in ("", "0"):
            if system == "-1":
                raise card.error("CORDM = -1: axes of elements are not read; give the number of a CORD2R")
            axes = self.system(card, 2, "CORDM").axes
            more["ORIENTATION"] = f"PSOLID-{number}"
            row = [repr(float(v)) for v in (*axes[0], *axes[1])]
            self.add("ORIENTATION", card, [row], NAME=more["ORIENTATION"])
        self.add("SOLID SECTION", card, ELSET=f"PSOLID-{number}", MATERIAL=f"MAT-{card.text(1)}", **more)

    def _materials(self) -> None:
        for card in self.of("MAT1", "MAT9"):
            self.add("MATERIAL", card, NAME=f"MAT-{card.whole(0, 'its number')}")
            (_isotropic if card.name == "MAT1" else _orthotropic)(self, card)

    # --- what is joined -----------------------------------------------------------------------------
    def joints(self) -> None:
        """Rigid bodies and mean motions of faces."""
        for card in self.of("RBE2"):
            name, components = f"RBE2-{card.whole(0, 'its number')}", set(card.text(2))
            if not set("123") <= components <= set("123456"):
                raise card.error(f"CM = {card.text(2)!r}: 123 or 123456 is read")
            members = self._members(card, 3)
            self.add("NSET", card, [[n] for n in members], NSET=name)
            self.add("RIGID BODY", card, NSET=name, REFNODE=str(self.known(card, 1)))
        for card in self.of("RBE3"):
            self._mean_motion(card)

    def _mean_motion(self, card: BulkCard) -> None:
        name = f"RBE3-{card.whole(0, 'its number')}"
        card.real(4, "WT1")  # one weight of all nodes is alike, whatever it is
        if card.text(5) != "123":
            raise card.error(f"C1 = {card.text(5)!r}: 123 is read")
        members = self._members(card, 6)
        self.add("SURFACE", card, [[n] for n in members], NAME=name, TYPE="NODE")
        self.add("COUPLING", card, CONSTRAINTNAME=name, SURFACE=name, REFNODE=str(self.known(card, 2)))
        self.add("DISTRIBUTING", card)

    def _members(self, card: BulkCard, first: int) -> list[int]:
        """Nodes from a field on; A THRU B, too. Numbers with a point end them."""
        out: list[int] = []
        words = [card.text(k) for k in range(first, len(card.fields))]
        for k, word in enumerate(words):
            if not word or word.upper() == "THRU":
                continue
            if not word.isdigit():
                if word.upper() in ("UM", "ALPHA") or "." in word:
                    if card.name == "RBE3":
                        raise card.error(f"{word}: one weight of all nodes is read, and no UM")
                    break
                raise card.error(f"{word[:40]!r} is no number of a node")
            if k and words[k - 1].upper() == "THRU":
                out += [n for n in range(out[-1] + 1, int(word) + 1) if n in self.x]
            else:
                out.append(self.known(card, first + k))
        return out

    def bushes(self) -> list[Bush]:
        """Elastic joints of two nodes."""
        stiffness = {card.whole(0, "its number"): card for card in self.of("PBUSH")}
        found = []
        for card in self.of("CBUSH"):
            of = stiffness.get(card.whole(1, "its property"))
            if of is None:
                raise card.error(f"there is no PBUSH {card.text(1)}")
            if of.text(1).upper() != "K":
                raise of.error("its first values are those of K, the stiffness")
            values = [of.real(2 + k, "a stiffness", 0.0) for k in range(6)]
            second = self.known(card, 3) if card.text(3) else None
            alike = len(set(values[:3])) == 1 and len(set(values[3:])) == 1
            axes = self.system(card, 7, "CID").axes if card.text(7) else None
            if not alike and (axes is None or np.abs(axes - np.eye(3)).max() > _AXES_ALIKE):
                raise card.error("its axes are not the global ones; give CID = 0, or stiffnesses alike")
            motions = dict(zip(("x", "y", "z", "rx", "ry", "rz"), values, strict=True))
            found.append(Bush(card, self.known(card, 2), second, {n: k for n, k in motions.items() if k}))
        return found

    # --- the step -----------------------------------------------------------------------------------
    def step(self) -> None:
        """Supports, loads and temperatures of the subcase."""
        last = self.of("GRID")[-1]
        self._temperatures(before=True)
        self.add("STEP", last)
        self.add("STATIC", last)
        self.each("BOUNDARY", self._supports())
        self.each("CLOAD", self._forces())
        self.each("DLOAD", self._pressures())
        self._temperatures(before=False)
        self.add("END STEP", last)
        for kind, names in _SETS.items():
            number = self.case.of(kind)
            if number is not None and not any(c.text(0) == str(number) for c in self.of(*names)):
                where = self.case.sets[kind][1]
                raise DeckError(f"{where}: {kind} = {number}: there is no {' or '.join(names)} of that set")

    def _chosen(self, kind: str) -> list[BulkCard]:
        number = self.case.of(kind)
        return [c for c in self.of(*_SETS[kind]) if number is not None and c.whole(0, "its set") == number]

    def _supports(self) -> list[tuple[BulkCard, list[object]]]:
        out: list[tuple[BulkCard, list[object]]] = []
        for card in self.of("GRID"):
            out += [(card, [card.text(0), c, c]) for c in card.text(6)]
        for card in self._chosen("SPC"):
            if card.name == "SPC":
                for k in (1, 4):
                    value = repr(card.real(k + 2, "a displacement", 0.0))
                    if card.text(k):
                        node = self.known(card, k)
                        out += [(card, [node, c, c, value]) for c in _components(card, k + 1)]
            else:
                out += [(card, [n, c, c]) for n in self._members(card, 2) for c in _components(card, 1)]
        cells = {n for _, nodes in self.cells.values() for n in nodes}
        references = {card.whole(1, "a node") for card in self.of("RBE2")}
        references |= {card.whole(2, "a node") for card in self.of("RBE3")}
        # nodes of solids have no rotations to hold
        return [
            (c, w) for c, w in out
            if str(w[1]) in "123" or (int(str(w[0])) in references and int(str(w[0])) not in cells)
        ]

    def _forces(self) -> list[tuple[BulkCard, list[object]]]:
        out: list[tuple[BulkCard, list[object]]] = []
        for card in self._chosen("LOAD"):
            if card.name == "FORCE":
                along = np.array([card.real(k, "a component", 0.0) for k in (4, 5, 6)])
                force = card.real(3, "F") * along @ self.system(card, 2, "CID").axes
                node = self.known(card, 1)
                out += [(card, [node, k + 1, repr(float(v))]) for k, v in enumerate(force) if v]
        return out

    def _pressures(self) -> list[tuple[BulkCard, list[object]]]:
        out: list[tuple[BulkCard, list[object]]] = []
        for card in self._chosen("LOAD"):
            if card.name != "PLOAD4":
                continue
            values = {card.real(k, "a pressure", card.real(2, "P1")) for k in (2, 3, 4, 5)}
            if len(values) > 1 or any(card.text(k) for k in range(8, 12)):
                raise card.error("one pressure of all corners, normal to the face, is read")
            if card.text(6).upper() == "THRU":
                raise card.error("THRU is for shells; give G1 and G3 (or G4) of each face")
            number = card.whole(1, "its element")
            if number not in self.cells:
                raise card.error(f"there is no CTETRA or CHEXA {number}")
            out.append((card, [number, f"P{self._face(card, *self.cells[number])}", repr(values.pop())]))
        return out

    def _face(self, card: BulkCard, name: str, nodes: list[int]) -> int:
        """Number of a face: of opposite corners, of a tetrahedron a corner on it and the one that is off."""
        first, other = self.known(card, 6), self.known(card, 7)
        for number, corners in enumerate(FACES["tetrahedron" if name == "CTETRA" else "hexahedron"], 1):
            on = [nodes[k] for k in corners]
            if first not in on:
                continue
            if name == "CTETRA":
                found = other in nodes[:4] and other not in on
            else:
                found = other in on and abs(on.index(other) - on.index(first)) == 2
            if found:
                return number
        raise card.error(f"G1 = {first} and G3 or G4 = {other} name no face of its element")

    def _temperatures(self, before: bool) -> None:
        """Before the step those without strain, in it those of the load."""
        if before:
            given = self._nodal("TEMP(INIT)")
            if not given and self.case.of("TEMP(LOAD)") is not None:
                of = {card.real(6, "TREF", 0.0) for card in self.of("MAT1")}
                if len(of) > 1:
                    raise self.of("MAT1")[0].error("the materials have different TREF; give TEMP(INITIAL)")
                value = of.pop() if of else 0.0
                given = [(card, [card.text(0), repr(value)]) for card in self.of("GRID")]
            self.each("INITIAL CONDITIONS", given, TYPE="TEMPERATURE")
        else:
            self.each("TEMPERATURE", self._nodal("TEMP(LOAD)"))

    def _nodal(self, kind: str) -> list[tuple[BulkCard, list[object]]]:
        found: dict[int, tuple[BulkCard, list[object]]] = {}
        chosen = self._chosen(kind)
        for card in chosen:
            if card.name == "TEMPD":
                value = repr(card.real(1, "a temperature"))
                found |= {node: (card, [node, value]) for node in self.x}
        for card in chosen:
            if card.name == "TEMP":
                for k in range(1, 6, 2):
                    if card.text(k):
                        node = self.known(card, k)
                        found[node] = card, [node, repr(card.real(k + 1, "a temperature"))]
        return list(found.values())


def _components(card: BulkCard, k: int) -> str:
    word = card.text(k)
    if not word or not set(word) <= set("123456"):
        raise card.error(f"components {word[:40]!r}; give some of 123456")
    return word


def _isotropic(made: _Translation, card: BulkCard) -> None:
    """MAT1: E, G, nu, of which one may be left out."""
    E, G, nu = (card.real(k, what) if card.text(k) else None for k, what in ((1, "E"), (2, "G"), (3, "NU")))
    if E is None and G is not None and nu is not None:
        E = 2.0 * G * (1.0 + nu)
    if nu is None and E is not None and G:
        nu = 0.5 * E / G - 1.0
    if E is None or nu is None:
        raise card.error("give two of E, G and NU")
    if G is not None and abs(2.0 * G * (1.0 + nu) - E) > 0.01 * E:
        raise card.error(f"E = {E:g}, G = {G:g} and NU = {nu:g} do not belong together; leave G out")
    made.add("ELASTIC", card, [[repr(E), repr(nu)]])
    if card.text(4):
        made.add("DENSITY", card, [[repr(card.real(4, "RHO"))]])
    if card.text(5):
        made.add("EXPANSION", card, [[repr(card.real(5, "A"))]])


def _orthotropic(made: _Translation, card: BulkCard) -> None:
    """MAT9: one half of the stiffness, by rows, of xx, yy, zz, xy, yz, zx."""
    C = np.zeros((6, 6))
    C[np.triu_indices(6)] = [card.real(1 + k, "a constant", 0.0) for k in range(21)]
    if C[:3, 3:].any() or (C[3:, 3:] - np.diag(np.diag(C[3:, 3:]))).any():
        raise card.error("it is not orthotropic along its axes, which is what is read")
    values = [C[0, 0], C[0, 1], C[1, 1], C[0, 2], C[1, 2], C[2, 2], C[3, 3], C[5, 5], C[4, 4]]
    made.add("ELASTIC", card, [[repr(float(v)) for v in values]], TYPE="ORTHOTROPIC")
    if card.text(22):
        made.add("DENSITY", card, [[repr(card.real(22, "RHO"))]])
    if any(card.text(k) for k in range(23, 29)):
        raise card.error("coefficients of expansion of MAT9 are not read")


_SETS = {"SPC": ("SPC", "SPC1"), "LOAD": ("FORCE", "PLOAD4"), "TEMP(LOAD)": ("TEMP", "TEMPD"),
         "TEMP(INIT)": ("TEMP", "TEMPD")}
_READ = {
    *("GRID", "CORD2R", "CTETRA", "CHEXA", "PSOLID", "MAT1", "MAT9", "RBE2", "RBE3", "CBUSH", "PBUSH"),
    *("SPC", "SPC1", "FORCE", "PLOAD4", "TEMP", "TEMPD"),
}


def translated(cards: Iterable[BulkCard], case: Case) -> Translated:
    """The keyword cards of a subcase.

    Raises
    ------
    DeckError
        What is refused by name, and what does not fit together.
    """
    made = _Translation(cards, case)
    steps: list[Callable[[], None]] = [made.parts, made.joints, made.step]
    if not made.x:
        raise DeckError(f"{case.where}: there is no GRID")
    for step in steps:
        step()
    return Translated(made.made, made.notes, made.bushes())
