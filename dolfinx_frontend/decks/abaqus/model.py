"""Nodes, elements, sets, surfaces, materials and sections of a deck; parts and instances are laid out flat.

Nodes and elements are rows of one model, whatever instance they are in; scopes know their numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.axes import Axes, axes_of, turning
from dolfinx_frontend.decks.abaqus.cards import Card, Note, Row
from dolfinx_frontend.decks.abaqus.elements import FACES, KINDS, REFERENCE_NODES
from dolfinx_frontend.decks.abaqus.generated import copies, count, filled, place_of, system_of
from dolfinx_frontend.decks.abaqus.keywords import ACTING, REPRESENTED, fate
from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.decks.lines import DeckError

__all__ = ["Element", "Model", "Scope", "Surface"]


class Element(NamedTuple):
    """Its type, rows of its nodes, and where it is written."""

    kind: str
    nodes: tuple[int, ...]
    where: Where

    def error(self, text: str) -> DeckError:
        """The error of this element, to be raised."""
        return DeckError(f"{self.where}: *ELEMENT: {text}")


@dataclass
class Surface:
    """A surface as written: rows of names, and whether they name nodes."""

    name: str
    card: Card
    nodal: bool


class Section(NamedTuple):
    """A solid section: elements with a material."""

    scope: Scope
    elset: str
    card: Card


@dataclass
class Interaction:
    """What is said between the faces of a contact pair."""

    card: Card
    behavior: Card | None = None
    friction: Card | None = None


@dataclass
class Scope:
    """Numbers and names of the deck, of one part or of one instance.

    ``turn`` (3, 3) and ``shift`` (3,) place an instance.
    """

    model: Model
    name: str = ""
    turn: Array | None = None
    shift: Array | None = None
    nodes: dict[int, int] = field(default_factory=dict)
    elements: dict[int, int] = field(default_factory=dict)
    nsets: dict[str, list[int]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    system: tuple[Array, Array] | None = None
    orientations: dict[str, Card] = field(default_factory=dict)

    def place(self, x: list[float]) -> list[float]:
        """Coordinates in the assembly."""
        if self.turn is None:
            return x
        return [float(v) for v in self.turn @ np.array(x) + self.shift]

    def _scoped(self, word: str) -> tuple[Scope, str]:
        """The scope that a word like ``INSTANCE.NAME`` is looked for in, and the name there."""
        owner, dot, name = word.partition(".")
        if dot and owner in self.model.instances:
            return self.model.instances[owner], name
        return self, word

    def _members(self, kind: str, card: Card, word: str, where: Where) -> list[int]:
        scope, name = self._scoped(word.upper())
        numbers, sets = (scope.nodes, scope.nsets) if kind == "node" else (scope.elements, scope.elsets)
        if name in sets:
            return sets[name]
        if name.isdigit():
            if int(name[:15]) in numbers:
                return [numbers[int(name[:15])]]
            raise card.error(f"there is no {kind} {word[:40]}; define it before", where)
        known = ", ".join(sorted(sets)[:8]) or "none"
        raise card.error(f"there is no {kind} set {word[:40]!r} (known: {known}); define it before", where)

    def node_rows(self, card: Card, word: str, where: Where) -> list[int]:
        """Rows of a node, or of a set of them."""
        return self._members("node", card, word, where)

    def element_rows(self, card: Card, word: str, where: Where) -> list[int]:
        """Rows of an element, or of a set of them."""
        return self._members("element", card, word, where)

    def one_node(self, card: Card, word: str, where: Where) -> int:
        """Row of a node, or of the only one of a set."""
        rows = self.node_rows(card, word, where)
        if len(rows) != 1:
            raise card.error(f"{word} are {len(rows)} nodes; name one", where)
        return rows[0]

    def surface(self, card: Card, word: str, where: Where) -> tuple[Scope, Surface]:
        """A surface, and the scope that its rows are to be read in."""
        scope, name = self._scoped(word.upper())
        if name not in scope.surfaces:
            known = ", ".join(sorted(scope.surfaces)[:8]) or "none"
            raise card.error(f"there is no surface {word!r} (known: {known}); define it", where)
        return scope, scope.surfaces[name]


class Model:
    """A deck as read, before anything is made of it."""

    def __init__(self) -> None:
        self.x: list[list[float]] = []
        self.node_names: list[str] = []
        self.elements: list[Element] = []
        self.root = Scope(self)
        self.instances: dict[str, Scope] = {}
        self.parts: dict[str, list[Card]] = {}
        self.sections: list[Section] = []
        self.materials: dict[str, dict[str, Card]] = {}
        self.interactions: dict[str, Interaction] = {}
        self.amplitudes: dict[str, Card] = {}
        self.joints: list[Card] = []
        self.links: list[tuple[Scope, Card]] = []
        self.transforms: dict[int, Axes] = {}
        self.couplings: list[Card] = []
        self.early: list[Card] = []
        self.steps: list[list[Card]] = []
        self.notes: list[Note] = []
        self._current: str | None = None

    def note(self, kind: str, card: Card, text: str, where: Where | None = None) -> None:
        """Keep a note of a card."""
        place = where or card.where
        self.notes.append(Note(kind, card.keyword, place.file, place.line, text))

    # --- the order of a deck ----------------------------------------------------------------------
    def read(self, cards: list[Card]) -> None:
        """Take the cards of a deck, in order; what is refused is noted before anything else can be wrong."""
        iterator = iter([card for card in cards if self._represented(card)])
        nodes: list[Card] = []
        others: list[Callable[[], None]] = []
        for card in iterator:
            if card.keyword == "PART":
                name = card.need("NAME")
                if name in self.parts:
                    raise card.error(f"the part {name!r} is there already; give another name")
                self.parts[name] = list(self._until(iterator, card, "END PART"))
            elif card.keyword == "INSTANCE":
                inside = list(self._until(iterator, card, "END INSTANCE"))
                others.append(partial(self._instance, card, inside))
            elif card.keyword == "STEP":
                self.steps.append([card, *self._until(iterator, card, "END STEP")])
            elif card.keyword in ("NODE", "SYSTEM"):
                nodes.append(card)  # elements may come before theirs
            else:
                others.append(partial(self.take, self.root, card))
        for card in nodes:
            self.take(self.root, card)
        for action in others:
            action()
        if not self.elements:
            raise DeckError(f"{cards[-1].where}: the deck has no elements; add *ELEMENT, TYPE=...")
        if not self.steps:
            raise DeckError(f"{cards[-1].where}: the deck has no step; add *STEP, *STATIC and *END STEP")

    def _represented(self, card: Card) -> bool:
        """Whether a card is read; a note of it, or of parameters of it, that are not."""
        kind, why = fate(card.keyword)
        if kind != "represented":
            self.note(kind, card, why)
            return False
        told = {name for name in card.parameters if not name.startswith("_")}  # those are of other readers
        unknown = told - set(REPRESENTED[card.keyword].split())
        for name in sorted(unknown):
            self.note("refused" if card.keyword in ACTING else "ignored", card, f"the parameter {name[:40]}")
        name = card.get("TYPE") or ""
        if card.keyword == "ELEMENT" and name and name not in KINDS and name not in REFERENCE_NODES:
            self.note("refused", card, f"elements {name}: solids of first and second order are read, "
                      "tetrahedra and hexahedra, in the plane triangles and quadrilaterals")
            return False
        return True

    def _until(self, cards: Iterator[Card], begin: Card, end: str) -> Iterator[Card]:
        for card in cards:
            if card.keyword == end:
                return
            if card.keyword == begin.keyword:
                break
            yield card
        raise begin.error(f"*{end} is missing; add it")

    def take(self, scope: Scope, card: Card) -> None:
        """One card outside of steps."""
        reader = _READERS.get(card.keyword)
        if reader is not None:
            reader(self, scope, card)
        elif card.keyword in ("CONTACT PAIR", "TIE", "PRE-TENSION SECTION", "RIGID BODY", "CLEARANCE",
                              "KINEMATIC COUPLING"):
            self.joints.append(card)
        elif card.keyword in ("EQUATION", "SPRING", "GAP", "DISTRIBUTING COUPLING"):
            self.links.append((scope, card))
        elif card.keyword in ("BOUNDARY", "INITIAL CONDITIONS"):
            self.early.append(card)
        elif card.keyword not in ("ASSEMBLY", "END ASSEMBLY"):
            raise card.error("it does not belong here; put it between *STEP and *END STEP")

    def _instance(self, card: Card, inside: list[Card]) -> None:
        name, part = card.need("NAME"), card.need("PART")
        if part not in self.parts:
            raise card.error(f"there is no part {part!r}; define it before")
        if name in self.instances:
            raise card.error(f"the instance {name!r} is there already; give another name")
        scope = Scope(self, name, *_placed(card))
        self.instances[name] = scope
        for each in (*self.parts[part], *inside):
            self.take(scope, each)

    # --- nodes and elements ---------------------------------------------------------------------
    def _add_node(self, scope: Scope, card: Card, number: int, x: list[float], where: Where) -> int:
        place = scope.place(x)
        if number in scope.nodes:
            if self.x[scope.nodes[number]] != place:
                raise card.error(f"node {number} is there already, elsewhere; renumber it", where)
            return scope.nodes[number]
        scope.nodes[number] = len(self.x)
        self.x.append(place)
        self.node_names.append(f"{scope.name}.{number}" if scope.name else str(number))
        return scope.nodes[number]

    def _node(self, scope: Scope, card: Card) -> None:
        kind = card.get("SYSTEM") or "R"
        if kind not in ("R", "C", "S"):
            raise card.error(f"SYSTEM = {kind!r}; give R, C or S")
        into = _set_of(scope.nsets, card.get("NSET"))
        for row in card.rows:
            number = card.whole(row, 0, "number of the node")
            x = place_of(card.numbers(row, 3, "coordinate", 1), kind)
            if scope.system is not None:
                x = [float(v) for v in np.array(x) @ scope.system[0] + scope.system[1]]
            into.append(self._add_node(scope, card, number, x, row.where))

    def _system(self, scope: Scope, card: Card) -> None:
        scope.system = system_of(card)

    def _element(self, scope: Scope, card: Card) -> None:
        name = card.need("TYPE")
        size = KINDS[name].nodes if name in KINDS else REFERENCE_NODES[name]
        if name in KINDS and KINDS[name].changed:
            self.note("changed", card, f"{name}: {KINDS[name].changed}")
        into = _set_of(scope.elsets, card.get("ELSET"))
        words, places = card.stream()
        if len(words) % (size + 1):
            raise card.error(
                f"{name} has a number and {size} nodes, but {len(words)} words do not divide into "
                f"{size + 1}; complete the last element", places[-1] if places else None
            )
        for k in range(0, len(words), size + 1):
            row = Row(places[k], words[k : k + size + 1])
            number = card.whole(row, 0, "number of the element")
            nodes = []
            for j in range(1, size + 1):
                node = card.whole(row, j, "node")
                if node not in scope.nodes:
                    raise card.error(f"element {number}: there is no node {node}; define it", places[k + j])
                nodes.append(scope.nodes[node])
            if len(set(nodes)) < size:
                raise card.error(f"element {number} names a node twice; correct it", row.where)
            self._add_element(scope, card, number, Element(name, tuple(nodes), row.where), into)

    def _add_element(
        self, scope: Scope, card: Card, number: int, element: Element, into: list[int]
    ) -> None:
        if number in scope.elements:
            before = self.elements[scope.elements[number]]
            if before[:2] != element[:2]:
                raise card.error(
                    f"element {number} is there already ({before.where}), with other nodes; renumber it",
                    element.where,
                )
            into.append(scope.elements[number])
            return
        scope.elements[number] = len(self.elements)
        self.elements.append(element)
        into.append(scope.elements[number])

    def _ngen(self, scope: Scope, card: Card) -> None:
        if card.get("LINE") not in (None, ""):
            self.note("refused", card, "nodes along arcs are not read yet; write them")
            return
        into = _set_of(scope.nsets, card.get("NSET"))
        for row in card.rows:
            first, last = card.whole(row, 0, "first node"), card.whole(row, 1, "last node")
            step = card.whole(row, 2, "increment", default=1)
            ends = [scope.one_node(card, str(n), row.where) for n in (first, last)]
            intervals = count(card, row, first, last, step) - 1
            if scope.turn is not None:
                raise card.error("in an instance nodes are generated in its part; move it there", row.where)
            a, b = (np.array(self.x[e]) for e in ends)
            for k in range(intervals + 1):
                x = [float(v) for v in a + (b - a) * (k / max(intervals, 1))]
                number = first + k * step
                into.append(
                    scope.nodes[number] if number in (first, last)
                    else self._add_node(scope, card, number, x, row.where)
                )

    def _nfill(self, scope: Scope, card: Card) -> None:
        if card.get("BIAS") not in (None, "1", "1.", "1.0") or "SINGULAR" in card.parameters:
            self.note("refused", card, "nodes at unequal distances; write them")
            return
        if scope.turn is not None:
            raise card.error("in an instance nodes are generated in its part; move it there")
        into = _set_of(scope.nsets, card.get("NSET"))
        for row in card.rows:
            if len(row.words) < 3:
                raise card.error("two sets of nodes and a number of intervals are needed", row.where)
            one, two = (scope.node_rows(card, word, row.where) for word in row.words[:2])
            ends = [(self.number(a), self.x[a], self.x[b]) for a, b in zip(one, two)]
            into += [*one, *two]
            into += [self._add_node(scope, card, n, x, row.where) for n, x in filled(card, row, ends)]

    def number(self, node: int) -> int:
        """The number of a node in its deck."""
        return int(self.node_names[node].rpartition(".")[2])

    def _elgen(self, scope: Scope, card: Card) -> None:
        into = _set_of(scope.elsets, card.get("ELSET"))
        for row in card.rows:
            number = card.whole(row, 0, "number of the element")
            if number not in scope.elements:
                raise card.error(f"there is no element {number}; define it before", row.where)
            first = self.elements[scope.elements[number]]
            into.append(scope.elements[number])
            for element, node in copies(card, row):
                wanted = [self.number(n) + node for n in first.nodes]
                missing = [n for n in wanted if n not in scope.nodes]
                if missing:
                    what = f"element {number + element} has no node {missing[0]}"
                    raise card.error(f"{what}; define it", row.where)
                nodes = tuple(scope.nodes[n] for n in wanted)
                self._add_element(scope, card, number + element, Element(first.kind, nodes, row.where), into)

    # --- sets and surfaces ----------------------------------------------------------------------
    def _collect(self, scope: Scope, card: Card) -> None:
        inside, kind = scope, card.keyword
        if (name := card.get("INSTANCE")) is not None:
            if name not in self.instances:
                raise card.error(f"there is no instance {name!r}; correct the name")
            inside = self.instances[name]
        target = card.need(kind)
        sets = scope.nsets if kind == "NSET" else scope.elsets
        found: dict[int, None] = dict.fromkeys(_set_of(sets, target))
        for row in card.rows:
            if "GENERATE" in card.parameters:
                first, last = card.whole(row, 0, "first"), card.whole(row, 1, "last")
                step = card.whole(row, 2, "increment", default=1)
                count(card, row, first, last, step)
                numbers = inside.nodes if kind == "NSET" else inside.elements
                found.update((numbers[n], None) for n in range(first, last + 1, step) if n in numbers)
                continue
            for word in row.words:
                if word:
                    members = inside.node_rows if kind == "NSET" else inside.element_rows
                    found.update(dict.fromkeys(members(card, word, row.where)))
        if kind == "NSET" and (elset := card.get("ELSET")) is not None:
            for e in inside.element_rows(card, elset, card.where):
                found.update(dict.fromkeys(self.elements[e].nodes))
        sets[target][:] = found

    def _surface(self, scope: Scope, card: Card) -> None:
        name = card.need("NAME")
        kind = card.get("TYPE") or "ELEMENT"
        if kind not in ("ELEMENT", "NODE"):
            self.note("refused", card, f"TYPE={kind}: surfaces of faces and of nodes are read")
        if not card.rows:
            raise card.error(f"the surface {name!r} has no rows; give faces, or take it out")
        before = scope.surfaces.get(name)
        if before is not None:
            if [r.words for r in before.card.rows] != [r.words for r in card.rows]:
                raise card.error(f"the surface {name!r} is there already ({before.card.where}); rename it")
        scope.surfaces[name] = Surface(name, card, kind == "NODE")

    # --- materials and what is between faces -----------------------------------------------------
    def _material(self, scope: Scope, card: Card) -> None:
        self._current = card.need("NAME")
        if self._current in self.materials:
            raise card.error(f"the material {self._current!r} is there already; give another name")
        self.materials[self._current] = {"MATERIAL": card}

    def _of_material(self, scope: Scope, card: Card) -> None:
        if self._current is None:
            raise card.error("it belongs to a *MATERIAL, which comes before it")
        if card.keyword in self.materials[self._current]:
            raise card.error(f"the material {self._current!r} has it already; take one out")
        self.materials[self._current][card.keyword] = card

    def _section(self, scope: Scope, card: Card) -> None:
        self.sections.append(Section(scope, card.need("ELSET"), card))

    def _named(self, scope: Scope, card: Card) -> None:
        name = card.need("NAME")
        target = self.amplitudes if card.keyword == "AMPLITUDE" else scope.orientations
        if name in target:
            raise card.error(f"the name {name!r} is in use; give another one")
        target[name] = card

    def _transform(self, scope: Scope, card: Card) -> None:
        axes = axes_of(card, scope.turn, scope.shift)
        for node in scope.node_rows(card, card.need("NSET"), card.where):
            self.transforms[node] = axes

    def _interaction(self, scope: Scope, card: Card) -> None:
        if card.keyword == "SURFACE INTERACTION":
            name = card.need("NAME")
            if name in self.interactions:
                raise card.error(f"the interaction {name!r} is there already; give another name")
            self.interactions[name] = Interaction(card)
            return
        if not self.interactions:
            raise card.error("it belongs to a *SURFACE INTERACTION, which comes before it")
        last = self.interactions[next(reversed(self.interactions))]
        kind = "friction" if card.keyword == "FRICTION" else "behavior"
        if getattr(last, kind) is not None:
            raise card.error(f"its interaction has a {kind} already; take one out")
        setattr(last, kind, card)

    def _coupling(self, scope: Scope, card: Card) -> None:
        if card.keyword == "COUPLING":
            self.couplings.append(card)
            return
        if not self.couplings or "_KIND" in self.couplings[-1].parameters:
            raise card.error("it belongs to a *COUPLING, which comes before it")
        self.couplings[-1].parameters["_KIND"] = card.keyword
        self.couplings[-1].rows += card.rows

    # --- geometry ---------------------------------------------------------------------------------
    def points(self) -> Array:
        """Coordinates of all nodes (nodes, 3)."""
        return np.array(self.x, dtype=np.float64).reshape(-1, 3)

    def face_rows(
        self, scope: Scope, card: Card, word: str, label: str, where: Where
    ) -> list[tuple[int, int]]:
        """Element and face of a face label, S1 or P1, of an element or a set."""
        if len(label) < 2 or not label[1:].isdigit():
            raise card.error(f"{label!r} is no face; write S1, S2, ...", where)
        number = int(label[1:3])
        found = []
        for e in scope.element_rows(card, word, where):
            kind = KINDS.get(self.elements[e].kind)
            if kind is None or not 1 <= number <= len(FACES[kind.cell]) or len(label) > 2:
                raise card.error(f"{self.elements[e].kind} has no face {label!r}; correct it", where)
            found.append((e, number - 1))
        return found


def _set_of(sets: dict[str, list[int]], name: str | None) -> list[int]:
    return [] if name is None else sets.setdefault(name, [])


def _placed(card: Card) -> tuple[Array | None, Array | None]:
    """Turn and shift of an instance: first shifted, then turned about an axis from a to b."""
    if not card.rows:
        return None, None
    if len(card.rows) > 2:
        raise card.error("an instance has a row with a shift, and one with an axis and an angle")
    shift = np.array(card.numbers(card.rows[0], 3, "shift"))
    turn: Array = np.eye(3)
    origin: Array = np.zeros(3)
    if len(card.rows) == 2:
        row = card.rows[1]
        numbers = [card.number(row, k, "axis or angle") for k in range(7)]
        origin, axis = np.array(numbers[:3]), np.array(numbers[3:6]) - numbers[:3]
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise card.error("its axis has no length; give two points", row.where)
        turn = turning(np.asarray(axis / length, dtype=np.float64), numbers[6])
    return turn, turn @ (shift - origin) + origin


_READERS: dict[str, Callable[[Model, Scope, Card], None]] = {
    "NODE": Model._node,
    "ELEMENT": Model._element,
    "NGEN": Model._ngen,
    "NFILL": Model._nfill,
    "ELGEN": Model._elgen,
    "SYSTEM": Model._system,
    "NSET": Model._collect,
    "ELSET": Model._collect,
    "SURFACE": Model._surface,
    "MATERIAL": Model._material,
    "ELASTIC": Model._of_material,
    "EXPANSION": Model._of_material,
    "DENSITY": Model._of_material,
    "SOLID SECTION": Model._section,
    "ORIENTATION": Model._named,
    "AMPLITUDE": Model._named,
    "TRANSFORM": Model._transform,
    "SURFACE INTERACTION": Model._interaction,
    "SURFACE BEHAVIOR": Model._interaction,
    "FRICTION": Model._interaction,
    "COUPLING": Model._coupling,
    "KINEMATIC": Model._coupling,
    "DISTRIBUTING": Model._coupling,
}
