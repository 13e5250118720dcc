"""Equations and springs between nodes, and nodes that follow a reference node.

All are sums of displacements. Displacements of nodes that belong to no solid are taken out of them: they are
given, or one of the equations says what they are. What is left joins nodes of solids; forces on reference
nodes become forces on these.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.axes import Axes, axes_of
from dolfinx_frontend.decks.abaqus.cards import Card, Note, Row, placed
from dolfinx_frontend.decks.abaqus.elements import RODS, listed
from dolfinx_frontend.decks.abaqus.history import Curve, Given, History, combined
from dolfinx_frontend.decks.abaqus.model import Model, Scope
from dolfinx_frontend.decks.abaqus.pieces import Mesh
from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.scene.scene import Scene

__all__ = ["Links", "Sum", "unused"]

Dof = tuple[int, int]
"""A node, and 1 to 3 of its displacements, 4 to 6 of its rotations, about global axes."""

_ROUNDING = 1e-12
"""Coefficients below this, relative to the largest of a sum, are rounding."""


@dataclass
class Sum:
    """Coefficients of displacements, what their sum is, and the stiffness of a spring; None: it is rigid.
    With a gap the sum may be larger, and smaller by that."""

    terms: dict[Dof, float]
    card: Card
    where: Where
    stiffness: float | None = None
    value: Curve = ((0.0, 0.0),)
    gap: float | None = None
    name: str = ""

    @property
    def rigid(self) -> bool:
        """Whether it is an equation."""
        return self.stiffness is None and self.gap is None

    def error(self, text: str) -> DeckError:
        """The error of its row, to be raised."""
        return self.card.error(text, self.where)

    def take(self, dof: Dof, terms: dict[Dof, float], value: Curve, sign: float = -1.0) -> None:
        """Put other displacements, and a known one, in place of one; `sign`: of what goes to the value."""
        factor = self.terms.pop(dof, 0.0)
        if not factor:
            return
        size = max(map(abs, self.terms.values()), default=0.0)
        for each, c in terms.items():
            total = self.terms.get(each, 0.0) + factor * c
            self.terms[each] = total
            if abs(total) <= _ROUNDING * max(size, abs(factor * c)):
                del self.terms[each]
        self.value = combined([(1.0, self.value), (sign * factor, value)])


@dataclass
class Links:
    """All sums of a deck.

    Attributes
    ----------
    given
        Displacements of reference nodes: sums of others, and a value.
    others
        Nodes that stand for rigid bodies and bolts.
    rods
        Displacements that a rod shortens, its force, and what gave it.
    shared
        Nodes at which two pieces hang together that share no faces: node, and pieces.
    """

    model: Model
    mesh: Mesh
    history: History
    sums: list[Sum] = field(default_factory=list)
    given: dict[Dof, Sum] = field(default_factory=dict)
    others: set[int] = field(default_factory=set)
    shared: list[tuple[int, int, int]] = field(default_factory=list)
    rods: list[tuple[dict[Dof, float], Curve, Given]] = field(default_factory=list)

    @property
    def dim(self) -> int:
        """Space dimension."""
        return self.mesh.pieces[0].kind.dim

    def named(self) -> set[int]:
        """Nodes whose displacements are in sums."""
        return {node for each in self.sums for node, _ in each.terms}

    # --- reading -------------------------------------------------------------------------------------
    def collect(self) -> None:
        """The sums of the cards of the model."""
        springs = {k for k, e in enumerate(self.model.elements) if e.kind.startswith(("SPRING", "GAP"))}
        for scope, card in self.model.links:
            if card.keyword == "EQUATION":
                self._equations(scope, card)
            elif card.keyword == "SPRING":
                springs -= self._springs(scope, card)
            elif card.keyword == "GAP":
                springs -= self._gaps(scope, card)
            elif card.keyword == "DISTRIBUTING COUPLING":
                self._distributing(scope, card)
        self._between()
        self._tighten()
        if springs:
            raise self.model.elements[min(springs)].error("it has no *SPRING or *GAP; give its set one")

    def _between(self) -> None:
        """Where equations join all nodes of a face, the nodes between them follow them, as in elements of the
        deck."""
        joined: dict[int, set[int]] = {}
        for each in self.sums:
            if each.card.keyword == "EQUATION":
                for node, k in each.terms:
                    joined.setdefault(k, set()).add(node)
        if not joined:
            return
        card = next(each.card for each in self.sums if each.card.keyword == "EQUATION")
        seen: set[Dof] = set()
        for side in [side for piece in self.mesh.pieces for side in piece.exterior]:
            face = {n for n in self.mesh.face(side) if n < len(self.model.x)}
            for k in [k for k, nodes in joined.items() if nodes >= face]:
                for node, shares in self.mesh.between(side).items():
                    known = all(self.history.lasts(("u", n, k)) for n in shares)
                    if (node, k) not in seen and not known:
                        seen.add((node, k))
                        follows = {(n, k): w for n, w in shares.items()}
                        self._add(card, card.where, [{(node, k): -1.0}, follows])

    def _tighten(self) -> None:
        """Rods of pre-tension sections pull their ends together; others are no solids."""
        rods = {k for k, e in enumerate(self.model.elements) if e.kind in RODS}
        for card in self.model.joints:
            if card.keyword != "PRE-TENSION SECTION" or card.get("ELEMENT") is None:
                continue
            members = self.model.root.element_rows(card, card.need("ELEMENT"), card.where)
            if len(members) != 1 or members[0] not in rods:
                raise card.error(f"ELEMENT is one element of {' or '.join(RODS)}; correct it")
            rods -= set(members)
            one, two = self.model.elements[members[0]].nodes
            along = self.mesh.x[two] - self.mesh.x[one]
            length = float(np.linalg.norm(along))
            given = np.array(card.numbers(card.rows[0], 3, "direction")) if card.rows else along
            node = self.model.root.one_node(card, card.need("NODE"), card.where)
            if not length > 0.0 or not np.any(given):
                raise card.error("its rod, or its direction, has no length; correct them")
            force = ("f", node, 1)
            if node in self.history.fixed or ("u", node, 1) in self.history.curves:
                self.model.note("refused", card, "a rod's length is given; give the SURFACE of a solid bolt")
            elif force in self.history.curves:
                self.model.note("changed", card, "the rod has this force and no stiffness")
                pull = {(one, k + 1): float(c) for k, c in enumerate(along / length) if c}
                pull |= {(two, k): -c for (_, k), c in pull.items()}
                sign = -1.0 if given @ along < 0.0 else 1.0
                curve = combined([(sign, self.history.curves[force])])
                self.rods.append((pull, curve, self.history.given[force]))
        for k in sorted(rods)[:1]:
            kind, _, where = self.model.elements[k]
            said = f"{kind}: solids only, and rods of *PRE-TENSION SECTION"
            self.model.notes.append(Note("refused", "ELEMENT", *where, said))

    def along(self, node: int, component: int, factor: float, axes: Axes | None = None) -> dict[Dof, float]:
        """A component of a node, along axes that are given or its own, by global ones."""
        own = self.model.transforms.get(node) if axes is None else axes
        first = 1 if component <= 3 else 4
        if own is None:
            return {(node, component): factor}
        row = own.at(self.mesh.x[node])[component - first]
        return {(node, first + k): factor * float(c) for k, c in enumerate(row) if abs(c) > _ROUNDING}

    def _equations(self, scope: Scope, card: Card) -> None:
        words, places = card.stream()
        pairs = [(w, p) for w, p in zip(words, places) if w]
        k = 0
        while k < len(pairs):
            where = pairs[k][1]
            count = card.whole(Row(where, [pairs[k][0]]), 0, "number of terms")
            found = pairs[k + 1 : k + 1 + 3 * count]
            if len(found) < 3 * count:
                raise card.error(f"{count} terms are node, component and factor each; complete them", where)
            k += 1 + 3 * count
            terms: list[tuple[list[int], int, float]] = []
            for t in range(0, 3 * count, 3):
                row = Row(found[t][1], [w for w, _ in found[t : t + 3]])
                component = card.whole(row, 1, "component")
                if component > 6:
                    raise card.error(f"component {component}; give 1 to 6", row.where)
                nodes = scope.node_rows(card, row.words[0], row.where)
                terms.append((nodes, component, card.number(row, 2, "factor")))
            most = max(len(nodes) for nodes, _, _ in terms)
            if any(len(nodes) not in (1, most) for nodes, _, _ in terms):
                raise card.error("its sets have different numbers of nodes; give pairs", where)
            for n in range(most):
                self._add(card, where, [
                    self.along(nodes[n if len(nodes) > 1 else 0], c, factor) for nodes, c, factor in terms
                ])

    def _add(
        self, card: Card, where: Where, terms: Iterable[dict[Dof, float]], stiffness: float | None = None
    ) -> None:
        total: dict[Dof, float] = {}
        for each in terms:
            for dof, c in each.items():
                total[dof] = total.get(dof, 0.0) + c
        self.sums.append(Sum({dof: c for dof, c in total.items() if c}, card, where, stiffness))

    def _springs(self, scope: Scope, card: Card) -> set[int]:
        members = scope.element_rows(card, card.need("ELSET"), card.where)
        kinds = {self.model.elements[e].kind for e in members}
        if not kinds or not kinds <= {"SPRINGA", "SPRING1", "SPRING2"} or len(kinds) > 1:
            found = ", ".join(sorted(kinds)) or "none"
            raise card.error(f"its elements are {found}; give springs of one type")
        kind = kinds.pop()
        count = {"SPRINGA": 0, "SPRING1": 1, "SPRING2": 2}[kind]
        if "NONLINEAR" in card.parameters or len(card.rows) > 1 + (count > 0):
            self.model.note("refused", card, "springs that are not linear; give one stiffness")
            return set(members)
        axes = self.orientation(scope, card)
        if len(card.rows) < 1 + (count > 0):
            raise card.error("its stiffness is missing; give it after the line of its components")
        components = [card.whole(card.rows[0], k, "component") for k in range(count)]
        stiffness = card.number(card.rows[-1], 0, "stiffness")
        if stiffness < 0.0 or any(c > 6 for c in components):
            raise card.error("a stiffness is >= 0, a component 1 to 6; correct them", card.rows[-1].where)
        for e in members:
            nodes = self.model.elements[e].nodes
            if kind == "SPRINGA":
                x = self.mesh.x[list(nodes)]
                length = float(np.linalg.norm(x[1] - x[0]))
                if not length > 0.0:
                    raise self.model.elements[e].error("its nodes coincide: it has no direction; use SPRING2")
                terms = [
                    {(node, k + 1): sign * float(c) for k, c in enumerate((x[1] - x[0]) / length) if c}
                    for node, sign in zip(nodes, (-1.0, 1.0))
                ]
            else:
                along = Axes(np.eye(3), np.zeros(3), False, np.eye(3)) if axes is None else axes
                terms = [
                    self.along(n, c, s, along) for n, c, s in zip(nodes, components, (1.0, -1.0))
                ]
            self._add(card, self.model.elements[e].where, terms, stiffness)
        return set(members)

    def _gaps(self, scope: Scope, card: Card) -> set[int]:
        """Two nodes each that come no nearer along a direction than a clearance lets them."""
        members = scope.element_rows(card, card.need("ELSET"), card.where)
        if not card.rows or any(self.model.elements[e].kind != "GAPUNI" for e in members):
            raise card.error("it has a line of clearance and direction, and elements GAPUNI; correct it")
        row = card.rows[0]
        gap, *along = (card.number(row, k, "clearance or direction", 0.0) for k in range(4))
        stiffness = card.number(row, 5, "stiffness", 0.0)
        length = float(np.linalg.norm(along))
        if not length > 0.0 or stiffness < 0.0:
            raise card.error("its direction has a length, its stiffness is >= 0; correct them", row.where)
        for e in members:
            element = self.model.elements[e]
            terms = {
                (node, k + 1): sign * c / length
                for node, sign in zip(element.nodes, (-1.0, 1.0)) for k, c in enumerate(along) if c
            }
            name = f"gap {'-'.join(self.model.node_names[n] for n in element.nodes)}"
            self.sums.append(Sum(terms, card, element.where, stiffness or None, gap=gap, name=name))
        return set(members)

    def orientation(self, scope: Scope, card: Card) -> Axes | None:
        """Axes that a card names; None: global."""
        name = card.get("ORIENTATION")
        if name is None:
            return None
        found = scope.orientations.get(name) or self.model.root.orientations.get(name)
        if found is None:
            raise card.error(f"there is no orientation {name!r}; define it")
        return axes_of(found, scope.turn, scope.shift)

    def _distributing(self, scope: Scope, card: Card) -> None:
        """The reference node has the mean displacement of the nodes."""
        members = scope.element_rows(card, card.need("ELSET"), card.where)
        if len(members) != 1 or self.model.elements[members[0]].kind != "DCOUP3D":
            raise card.error("its set is one element DCOUP3D; correct it")
        reference = self.model.elements[members[0]].nodes[0]
        weights: dict[int, float] = {}
        for row in card.rows:
            weight = card.number(row, 1, "weight", 1.0)
            for node in scope.node_rows(card, row.words[0], row.where):
                weights[node] = weights.get(node, 0.0) + weight
        total = sum(weights.values())
        if min(weights.values(), default=-1.0) < 0.0 or not total > 0.0:
            raise card.error("its weights are >= 0, with a sum that is > 0; give nodes and weights")
        x, nodes = self.mesh.x, list(weights)
        away = float(np.linalg.norm(x[reference] - np.average(x[nodes], axis=0, weights=[*weights.values()])))
        if away > 1e-6 * float(np.ptp(x[nodes], axis=0).max()):
            self.model.note("changed", card, f"forces act at the centroid of its nodes, {away:.4g} away")
        for k in range(1, self.dim + 1):
            terms = [{(n, k): w / total} for n, w in weights.items()]
            self._add(card, card.where, [*terms, {(reference, k): -1.0}])

    def follow(
        self, card: Card, nodes: list[int], reference: int, turning: int | None, components: Iterable[int],
        axes: Axes | None,
    ) -> None:
        """Nodes move with a reference node, which turns by its 4 to 6, or by 1 to 3 of another one."""
        given = set(components)
        if given and max(given) > 6:
            raise card.error("components are 1 to 6; correct them")
        wanted = sorted(c for c in given or range(1, 4) if c <= self.dim)
        known = set(nodes) - {reference}
        extra = {
            node for piece in self.mesh.pieces for side in piece.exterior
            if not known.isdisjoint(self.mesh.face(side))
            for node, parents in self.mesh.between(side).items() if known.issuperset(parents)
        }
        for node in [*sorted(known), *sorted(extra - known)]:
            arm = self.mesh.x[node] - self.mesh.x[reference]
            rows: Array = np.eye(3) if axes is None else axes.at(self.mesh.x[node])
            for component in wanted:
                a = rows[component - 1]
                terms = {(node, k + 1): float(c) for k, c in enumerate(a) if abs(c) > _ROUNDING}
                terms |= {(reference, k + 1): -float(c) for k, c in enumerate(a) if abs(c) > _ROUNDING}
                of_turns = np.cross(arm, a)
                for k in range(3) if self.dim == 3 else (2,):
                    at = (reference, k + 4) if turning in (None, reference) else (int(turning or 0), k + 1)
                    if abs(of_turns[k]) > _ROUNDING * float(np.abs(arm).max()):
                        terms[at] = terms.get(at, 0.0) - float(of_turns[k])
                self._add(card, card.where, [terms])

    def tie(self, card: Card, where: Where, node: int, shares: Mapping[int, float]) -> None:
        """A node moves as a point between others."""
        for k in range(1, self.dim + 1):
            self._add(card, where, [{(node, k): -1.0}, {(n, k): share for n, share in shares.items()}])

    # --- taking the reference nodes out --------------------------------------------------------------
    def reduce(self, bodies: set[int]) -> None:
        """Take out what is given, and the displacements of nodes that belong to no solid.

        Parameters
        ----------
        bodies
            Reference nodes of rigid bodies and bolts.
        """
        solid, curves = self.mesh.pieces_of_node, self.history.curves
        used, self.others = self.named(), bodies
        for node in used & bodies:
            first = next(each for each in self.sums if any(n == node for n, _ in each.terms))
            if any(n == node and ("u", n, k) not in curves for n, k in first.terms):
                name = self.model.node_names[node]
                raise first.error(f"node {name} moves a rigid body or a bolt: hold it, or join other nodes")
        for each in self.sums:
            own = [d for d in each.terms if d[0] not in self.model.transforms]
            for dof in [d for d in own if self.history.lasts(("u", *d))]:
                each.take(dof, {}, curves["u", *dof])
        for key, curve in curves.items():
            if key[0] == "u" and key[1] in used and key[1] not in solid and key[1] in self.model.transforms:
                given, terms = self.history.given[key], self.along(key[1], key[2], 1.0)
                self.sums.append(Sum(terms, given.card, given.row.where, None, curve))
        for node, k in sorted({d for each in self.sums for d in each.terms if d[0] not in solid}):
            self._eliminate((node, k))
        rigid = [each for each in self.sums if each.rigid and not each.terms]
        if any(abs(v) > 0.0 for each in rigid for _, v in each.value):
            wrong = next(each for each in rigid if any(v for _, v in each.value))
            raise wrong.error("supports contradict it; take one of them out")
        self.sums = [each for each in self.sums if each.terms]

    def _eliminate(self, dof: Dof) -> None:
        rigid = [e for e in self.sums if e.rigid and abs(e.terms.get(dof, 0.0)) > 0.0]
        if not rigid:
            left = next((e for e in self.sums if dof in e.terms), None)
            if left is not None:
                name = self.model.node_names[dof[0]]
                raise left.error(f"node {name} belongs to no solid, and nothing says how it moves: hold it")
            return
        chosen = max(rigid, key=lambda e: abs(e.terms[dof]) / max(map(abs, e.terms.values())))
        self.sums = [each for each in self.sums if each is not chosen]
        factor = chosen.terms.pop(dof)
        chosen.terms = {d: -c / factor for d, c in chosen.terms.items()}
        chosen.value = combined([(1.0 / factor, chosen.value)])
        for each in self.sums:
            each.take(dof, chosen.terms, chosen.value)
        for each in self.given.values():
            each.take(dof, chosen.terms, chosen.value, 1.0)
        self.given[dof] = chosen

    # --- into a scene --------------------------------------------------------------------------------
    def forces(
        self, loads: Mapping[int, Mapping[int, Curve]], givers: Mapping[int, Given]
    ) -> Iterator[tuple[int, dict[int, Curve], Given]]:
        """Forces on nodes of solids along global axes, of those on all nodes along their own."""
        found: dict[Dof, list[tuple[float, Curve]]] = {}
        by: dict[int, Given] = {}
        curves, solid = self.history.curves, self.mesh.pieces_of_node
        acting = [
            (self.along(node, component, 1.0), curve, givers[node])
            for node, of_node in loads.items() for component, curve in of_node.items()
        ]
        for along, curve, giver in (*acting, *self.rods):
            for dof, c in along.items():
                given = self.given.get(dof)
                if dof[0] not in solid and given is None:
                    if ("u", *dof) in curves:
                        continue  # its support takes it
                    raise giver.error(
                        f"component {dof[1]} of node {self.model.node_names[dof[0]]} belongs to no solid, "
                        "and nothing says how it moves"
                    )
                for other, share in ({dof: 1.0} if given is None else given.terms).items():
                    found.setdefault(other, []).append((c * share, curve))
                    by.setdefault(other[0], giver)
        for node, given_by in by.items():
            own = {k: combined(found[node, k]) for k in range(1, 7) if (node, k) in found}
            yield node, own, given_by

    def put(self, scene: Scene) -> None:
        """Add the sums to a scene that has the parts and joints."""
        pieces, d, used = self.mesh.pieces, self.dim, set(scene.interfaces)
        for node, *both in self.shared:
            x, card = listed(self.mesh.x[node, :d]), pieces[both[0]].section.card
            for k in range(d):
                axis = [float(j == k) for j in range(d)]
                terms = [(pieces[p].name, x, [s * a for a in axis]) for p, s in zip(both, (-1.0, 1.0))]
                with placed(card.where, card.keyword):
                    scene.link(unused(f"node {self.model.node_names[node]} {'xyz'[k]}", used), terms)
        for each in self.sums:
            vectors: dict[int, list[float]] = {}
            for (node, k), c in each.terms.items():
                if k > d:
                    raise each.error(f"component {k} of a node of a solid; give 1 to {d}")
                vectors.setdefault(node, [0.0] * d)[k - 1] += c
            options = [self.mesh.pieces_of_node[node] for node in vectors]
            parts = self._parts(options)
            if parts is None:
                raise each.error("it joins nodes of more than two parts; divide it")
            terms = [
                (pieces[next(p for p in own if p in parts)].name, listed(self.mesh.x[node, :d]), vector)
                for own, (node, vector) in zip(options, vectors.items())
            ]
            name = unused(each.name or f"{each.card.keyword.lower()} {each.where.line}", used)
            value, gap = self.history.value(each.value), None
            if each.gap is not None:
                left = combined([(1.0, ((0.0, each.gap),)), (-1.0, each.value)])
                value, gap = 0.0, self.history.value(left)
            with placed(each.where, each.card.keyword):
                scene.link(name, terms, value, each.stiffness, gap)

    def _parts(self, options: list[list[int]]) -> set[int] | None:
        """One or two parts, each node in one of them."""
        every = sorted({p for own in options for p in own})
        pairs = [{a, b} for a, b in product(every, every) if a <= b]
        pairs.sort(key=len)
        return next((pair for pair in pairs if all(pair & set(own) for own in options)), None)


def unused(name: str, used: set[str]) -> str:
    """A name that is not used yet, and is from here on."""
    base = "".join(c if c.isprintable() and c != ":" else "_" for c in name)
    found, number = base, 2
    while found in used:
        found, number = f"{base}#{number}", number + 1
    used.add(found)
    return found
