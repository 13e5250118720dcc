"""What joins the pieces of a deck: contact pairs, ties, pre-tension sections, glue, rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.axes import Axes
from dolfinx_frontend.decks.abaqus.cards import Card, Row, placed
from dolfinx_frontend.decks.abaqus.elements import KINDS, listed
from dolfinx_frontend.decks.abaqus.faces import Faces, Sides
from dolfinx_frontend.decks.abaqus.facets import Distance, Facets
from dolfinx_frontend.decks.abaqus.history import Curve, History, combined
from dolfinx_frontend.decks.abaqus.links import Links, Sum, unused
from dolfinx_frontend.decks.abaqus.materials import thickness_of
from dolfinx_frontend.decks.abaqus.model import Interaction, Model
from dolfinx_frontend.decks.abaqus.pieces import Mesh, Pairs
from dolfinx_frontend.decks.abaqus.points import areas_at, over
from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.scene.laws import Contact, Elastic, Law, Perfect, Preload
from dolfinx_frontend.scene.scene import Scene

__all__ = ["Body", "Joints", "cuts_of", "references_of"]

_TOUCHING = 1e-6
"""Overlap of faces, relative to their size, that is rounding of the deck."""

_FORMULATIONS = ("SURFACE TO SURFACE", "NODE TO SURFACE", "MORTAR", "LINMORTAR", "PGLINMORTAR", "MASSLESS")

_REACH = 0.25
"""Distance, relative to the size of a facet, up to which faces are looked for unless a deck has more."""


@dataclass
class Joint:
    """Two surfaces with a law."""

    name: str
    law: Law
    first: int
    second: int
    reach: float | None
    card: tuple[Where, str]
    matching: bool = False


@dataclass
class Body:
    """A rigid body, or the faces that a force at a point is distributed over."""

    name: str
    faces: int
    reference: int
    turning: int | None
    rigid: bool
    card: tuple[Where, str]

    @property
    def nodes(self) -> set[int]:
        """Its reference nodes."""
        return {self.reference} if self.turning is None else {self.reference, self.turning}


def cuts_of(model: Model) -> list[tuple[Card, str, Pairs]]:
    """Faces of the pre-tension sections: card, name of the surface, faces."""
    found = []
    for card in model.joints:
        if card.keyword != "PRE-TENSION SECTION":
            continue
        if card.get("ELEMENT") is not None:
            continue  # a rod
        name = card.need("SURFACE")
        scope, surface = model.root.surface(card, name, card.where)
        if surface.nodal:
            raise card.error(f"the surface {name!r} is made of nodes; give one of faces")
        pairs: Pairs = []
        for row in surface.card.rows:
            label = row.words[1].upper() if len(row.words) > 1 else ""
            pairs += model.face_rows(scope, surface.card, row.words[0], label, row.where)
        found.append((card, name, pairs))
    return found


def references_of(model: Model) -> tuple[frozenset[int], frozenset[int]]:
    """Nodes that stand for bolts and bodies or belong to no solid, and those of bolts."""
    found = set(range(len(model.x))).difference(*(e.nodes for e in model.elements if e.kind in KINDS))
    bolts: set[int] = set()
    needed = {"PRE-TENSION SECTION": "NODE"}
    needed |= dict.fromkeys(("RIGID BODY", "COUPLING", "KINEMATIC COUPLING"), "REFNODE")
    for card in (*model.joints, *model.couplings):
        words = [card.need(needed[card.keyword])] if card.keyword in needed else []
        words += filter(None, [card.get("ROTNODE")])
        nodes = {model.root.one_node(card, word, card.where) for word in words}
        found |= nodes
        bolts |= nodes if card.keyword == "PRE-TENSION SECTION" else set()
    return frozenset(found), frozenset(bolts)


class Joints:
    """All joints of a deck, as faces that are asked for and laws."""

    def __init__(self, mesh: Mesh, history: History, faces: Faces, links: Links) -> None:
        self.model, self.mesh, self.history, self.faces, self.links = mesh.model, mesh, history, faces, links
        self.joints: list[Joint] = []
        self.bodies: list[Body] = []

    def collect(self, cuts: list[tuple[Card, str, Pairs]]) -> None:
        """Ask for the faces of all joints."""
        self._glue({side for _, _, pairs in cuts for side in pairs})
        for card, name, pairs in cuts:
            self._bolt(card, name, pairs)
        for card in self.model.joints:
            if card.keyword == "CONTACT PAIR":
                for row in card.rows:
                    self._contact(card, row)
            elif card.keyword == "TIE":
                self._tie(card)
            elif card.keyword == "RIGID BODY":
                self._rigid_body(card)
            elif card.keyword == "KINEMATIC COUPLING":
                self._kinematic(card)
        for card in self.model.couplings:
            self._coupling(card)
        used = [c for c in self.model.joints if c.keyword == "CLEARANCE" and "_USED" not in c.parameters]
        if used:
            raise used[0].error("there is no contact pair of these surfaces; correct MASTER and SLAVE")

    # --- glue and bolts ---------------------------------------------------------------------------
    def _glue(self, cut: set[tuple[int, int]]) -> None:
        """Pieces that share faces are glued there; those that share no more than nodes are refused."""
        pieces, of = self.mesh.pieces, self.mesh.of_element
        shared: dict[tuple[int, int], tuple[Pairs, Pairs]] = {}
        joined: set[tuple[int, int]] = set()
        for a, b in self.mesh.neighbours.items():
            p, q = int(of[a[0]]), int(of[b[0]])
            if p >= q:
                continue
            joined.add((p, q))
            if a not in cut and b not in cut:
                ours, theirs = shared.setdefault((p, q), ([], []))
                ours.append(a)
                theirs.append(b)
        for (p, q), (ours, theirs) in shared.items():
            name = f"{pieces[p].name}|{pieces[q].name}"
            first = self.faces.ask(f"to {pieces[q].name}", {p: ours})
            second = self.faces.ask(f"to {pieces[p].name}", {q: theirs})
            card = pieces[p].section.card
            self._join(name, Perfect(), first, second, None, card, card.where, matching=True)
        groups = list(range(len(pieces)))
        for p, q in joined:
            low, high = sorted((groups[p], groups[q]))
            groups = [low if g == high else g for g in groups]
        for node, members in self.mesh.pieces_of_node.items():
            one, *others = sorted({groups[p]: p for p in reversed(members)}.values())
            self.links.shared += [(node, one, other) for other in others]

    def _bolt(self, card: Card, name: str, pairs: Pairs) -> None:
        mesh, history = self.mesh, self.history
        others = []
        for side in pairs:
            if side not in mesh.neighbours:
                raise card.error(f"a face of {name!r} is outside of the bolt; cut between two elements")
            if not mesh.outside(side):
                raise card.error(f"{name!r} does not cut the bolt through: the elements on both sides are "
                                 "connected elsewhere; let it go through the whole section")
            others.append(mesh.neighbours[side])
        first, second = self._by_piece(pairs), self._by_piece(others)
        if len(first) != 1 or len(second) != 1:
            raise card.error(f"{name!r} cuts several parts; give each a section of its own")
        sign = self._direction(card, pairs)
        node = self.model.root.one_node(card, card.need("NODE"), card.where)
        force, length = history.curves.get(("f", node, 1)), history.curves.get(("u", node, 1))
        others_of = [history.curves.get((kind, node, k), ()) for kind in "uf" for k in range(2, 7)]
        if any(v for curve in others_of for _, v in curve):
            raise card.error(f"node {self.model.node_names[node]} of a bolt takes loads along 1 only")
        locked = history.fixed.get(node)
        if force is not None and length is not None:
            raise card.error("the bolt has a force and a displacement; give one, and FIXED later")
        law: Law
        if length is not None:
            law = Preload(shortening=history.value(length) * sign)
        else:
            given = history.value(force if force is not None else ((0.0, 0.0),)) * sign
            until = None
            if locked is not None:
                if force is not None and max(history.forced["f", node, 1]) >= locked:
                    raise card.error(f"the bolt gets a force in step {locked} or later, where it is FIXED")
                if locked == 1:
                    raise card.error("the bolt is FIXED in the first step; tighten it before")
                until = history.steps[locked - 1].start
            law = Preload(force=given, until=until)
            self.model.note("changed", card, "its force is even over the section, which bends freely")
        one, two = self.faces.ask(name, first), self.faces.ask(f"{name} cut", second)
        self._join(name, law, one, two, None, card, card.where, matching=True)

    def _by_piece(self, pairs: Pairs) -> Sides:
        out: Sides = {}
        for side in pairs:
            out.setdefault(int(self.mesh.of_element[side[0]]), []).append(side)
        return out

    def _direction(self, card: Card, pairs: Pairs) -> float:
        """Of positive forces: 1 for tension, -1 for compression."""
        if not card.rows:
            return 1.0
        given = np.array(card.numbers(card.rows[0], 3, "direction"))
        mean = Facets(self.mesh, self._by_piece(pairs)).normals.mean(axis=0)
        size = float(np.linalg.norm(given) * np.linalg.norm(mean))
        cosine = float(given @ mean) / size if size else 0.0
        if abs(cosine) < 0.999:
            raise card.error("its direction is not the normal of the section; leave it out")
        return math.copysign(1.0, cosine)

    # --- contact ------------------------------------------------------------------------------------
    def _surfaces(self, card: Card, row: Row) -> tuple[list[str], Sides, Sides, list[int]]:
        """Names, faces of the slave and of the master, and nodes of the slave that are on no face of it."""
        if len(row.words) < 2 or not row.words[1]:
            raise card.error("one surface only, contact with itself is not read; name two", row.where)
        names = [w.upper() for w in row.words[:2]]
        (slave, alone), (master, _) = (
            self.mesh.surface(self.model.root, card, w, row.where) for w in names
        )
        if not master or not (slave or alone):
            wrong = names[0] if master else names[1]
            raise card.error(f"the surface {wrong!r} has no face of an element; give faces", row.where)
        if {p: sorted(s) for p, s in slave.items()} == {p: sorted(s) for p, s in master.items()}:
            raise card.error("both surfaces are the same; name two", row.where)
        if slave and Facets(self.mesh, slave).inside(Facets(self.mesh, master)):
            said = "both surfaces face the same way: their solids are in the same place"
            raise card.error(f"{said}; name faces that face each other, or move a part", row.where)
        return names, slave, master, alone

    def _contact(self, card: Card, row: Row) -> None:
        names, slave, master, alone = self._surfaces(card, row)
        named = card.need("INTERACTION")
        interaction = self.model.interactions.get(named)
        if interaction is None:
            known = ", ".join(self.model.interactions) or "none"
            raise card.error(f"there is no interaction {named!r} (known: {known}); define it")
        self._formulation(card)
        if alone:
            self._stops(card, row, names, alone, Facets(self.mesh, master), interaction)
        if not slave:
            return
        gap = self._gap(card, row, names, Facets(self.mesh, slave), Facets(self.mesh, master))
        apart = Facets(self.mesh, slave).distance(Facets(self.mesh, master))
        law = self._law(named, interaction, gap, apart, self._thickness(card, row.where, slave))
        first, second = self.faces.ask(names[0], slave), self.faces.ask(names[1], master)
        reach = apart.least + _REACH * apart.facet if gap is None else max(apart.most, 0.0)
        self._join(f"{names[0]}|{names[1]}", law, first, second, reach, card, row.where)

    def _stops(
        self, card: Card, row: Row, names: list[str], nodes: list[int], master: Facets,
        interaction: Interaction,
    ) -> None:
        """Single nodes that meet faces: each is a stop."""
        stiffness, tied = self._behavior(interaction)
        if tied or interaction.friction is not None or self.mesh.pieces[0].kind.plane == "axisymmetric":
            what = "tied" if tied else "axisymmetric" if interaction.friction is None else "with friction"
            said = f"contact of single nodes that is {what}: give a surface of faces"
            self.model.note("refused", card, said, row.where)
            return
        areas, adjusted = areas_at(self.mesh, nodes), self._adjusted(card, row)
        stated, lost = self._clearance(names), []
        for node in nodes:
            below = over(self.mesh, master, node) if node in self.mesh.pieces_of_node else None
            if below is None:
                lost.append(self.model.node_names[node])
                continue
            gap = below.distance if stated is None else stated
            if stated is None and adjusted is not None:
                wanted, tolerance = adjusted
                gap = 0.0 if (node in wanted if wanted else gap <= tolerance) else gap
            own = {n: -share for n, share in below.shares.items()} | {node: 1.0}
            along = [(k, float(c)) for k, c in enumerate(below.normal, start=1) if c]
            terms = {(n, k): w * c for n, w in own.items() for k, c in along}
            thickness = self._thickness(card, row.where, self.mesh.pieces_of_node[node])
            yields = None if stiffness is None else stiffness * areas[node] * thickness
            name = f"{names[0]} node {self.model.node_names[node]}|{names[1]}"
            self.links.sums.append(Sum(terms, card, row.where, yields, gap=gap, name=name))
        if lost:
            shown = ", ".join(lost[:4]) + (", ..." if len(lost) > 4 else "")
            said = f"nodes over no face of {names[1]} meet nothing: {shown}"
            self.model.note("changed", card, said, row.where)

    def _join(
        self,
        name: str,
        law: Law,
        first: int,
        second: int,
        reach: float | None,
        card: Card,
        where: Where,
        matching: bool = False,
    ) -> None:
        self.joints.append(Joint(name, law, first, second, reach, (where, card.keyword), matching))

    def _formulation(self, card: Card) -> None:
        kind = card.get("TYPE") or "NODE TO SURFACE"
        kind = " ".join(kind.split())
        if kind not in _FORMULATIONS:
            raise card.error(f"TYPE = {kind!r}; give SURFACE TO SURFACE, NODE TO SURFACE or MORTAR")
        if "MORTAR" not in kind:
            self.model.note("changed", card, f"{kind}: discretised by mortar multipliers")
        self.model.note("changed", card, "sliding is small: faces meet where they are meshed")

    def _thickness(self, card: Card, where: Where, pieces: Iterable[int]) -> float:
        """Of what a surface belongs to."""
        found = sorted({thickness_of(self.mesh.pieces[p]) for p in pieces})
        if len(found) > 1:
            shown = ", ".join(f"{t:g}" for t in found)
            raise card.error(f"parts of different thicknesses ({shown}); give each a pair of its own", where)
        return found[0]

    def _clearance(self, names: list[str]) -> float | None:
        """The clearance that a card of its own states."""
        for other in self.model.joints:
            if other.keyword == "CLEARANCE" and [other.need("SLAVE"), other.need("MASTER")] == names:
                other.parameters["_USED"] = ""
                return other.number(Row(other.where, [other.need("VALUE")]), 0, "VALUE")
        return None

    def _adjusted(self, card: Card, row: Row) -> tuple[set[int] | None, float] | None:
        """Nodes that ADJUST puts onto the other surface, or None, and within which distance; None: it says
        nothing."""
        word = card.get("ADJUST")
        if not word or word == "NO":
            return None
        try:
            return None, card.number(Row(card.where, [word]), 0, "ADJUST")
        except DeckError:
            return set(self.model.root.node_rows(card, word, row.where)), 0.0

    def _gap(
        self, card: Card, row: Row, names: list[str], slave: Facets, master: Facets
    ) -> Any:
        """The gap that the deck states, a number or a function of the points; None: as meshed."""
        stated, adjusted = self._clearance(names), self._adjusted(card, row)
        if stated is not None or adjusted is None:
            return stated
        (wanted, tolerance), apart = adjusted, slave.distance(master)
        all_of_it = set(listed(slave.nodes[slave.nodes < len(self.model.x)]))
        if (
            apart.most <= tolerance * (1.0 + 1e-6) + _TOUCHING * apart.extent if wanted is None
            else wanted >= all_of_it
        ):
            return 0.0
        return slave.adjusted(master, wanted, tolerance)

    def _law(self, name: str, interaction: Interaction, gap: Any, apart: Distance, thickness: float) -> Law:
        stiffness, tied = self._behavior(interaction)
        mu, stick = (0.0, None) if interaction.friction is None else self._friction(interaction.friction)
        stiffness, stick = (None if k is None else k * thickness for k in (stiffness, stick))
        curve = self.history.changing(name, mu, lambda card: self._friction(card)[0])
        friction = self.history.value(curve) if any(v for _, v in curve) else None
        if tied:
            return Elastic(normal=stiffness, tangential=stick or stiffness)
        inside = gap is None and apart.least < -_TOUCHING * apart.extent
        slope = {} if friction is None else {"tangential_stiffness": stick}
        return Contact(gap=gap, friction=friction, stiffness=stiffness, interference=inside, **slope)

    def _behavior(self, interaction: Interaction) -> tuple[float | None, bool]:
        """Contact stiffness (None: rigid), and whether faces are tied by it."""
        card = interaction.behavior
        if card is None:
            return None, False
        kind = card.get("PRESSURE-OVERCLOSURE") or "HARD"
        if kind == "HARD":
            return None, False
        if not card.rows:
            raise card.error(f"{kind} without numbers; give them in the next line")
        row = card.rows[0]
        if kind in ("LINEAR", "TIED"):
            stiffness = card.number(row, 0, "stiffness")
        elif kind == "EXPONENTIAL":
            # p = p0 exp(ln(100) overclosure / c0): its slope where the faces touch
            c0, p0 = card.number(row, 0, "clearance"), card.number(row, 1, "pressure")
            stiffness = p0 * math.log(100.0) / c0 if c0 else 0.0
        elif kind == "TABULAR":
            table = [(card.number(r, 0, "pressure"), card.number(r, 1, "overclosure")) for r in card.rows]
            if len(table) != 2 or table[0] != (0.0, 0.0) or table[1][1] <= 0.0:
                raise card.error("a table of more than one slope from 0, 0 on is not read; give LINEAR")
            stiffness = table[1][0] / table[1][1]
        else:
            raise card.error(f"{kind!r}; give HARD, LINEAR, EXPONENTIAL, TABULAR or TIED")
        if stiffness <= 0.0:
            raise card.error(f"its stiffness is {stiffness:g}; it is > 0", row.where)
        if kind != "TIED":
            self.model.note("changed", card, f"{kind}: a contact stiffness of {stiffness:.6g} per area")
        return stiffness, kind == "TIED"

    def _friction(self, card: Card) -> tuple[float, float | None]:
        """Coefficient of friction, and the stiffness of sticking points."""
        if "ROUGH" in card.parameters:
            self.model.note("refused", card, "ROUGH: give a coefficient")
            return 0.0, None
        if not card.rows:
            raise card.error("friction without a coefficient; give it in the next line")
        mu = card.number(card.rows[0], 0, "friction coefficient")
        if mu < 0.0:
            raise card.error(f"the coefficient {mu:g} is negative; it is >= 0", card.rows[0].where)
        stick = card.number(card.rows[0], 1, "stick slope", 0.0) or None
        if stick is not None and stick < 0.0:
            raise card.error(f"the stick slope {stick:g} is negative; it is > 0", card.rows[0].where)
        if len(card.rows) > 1:
            self.model.note("refused", card, "friction that depends on anything; give one coefficient")
        return mu, stick

    # --- ties and bodies ----------------------------------------------------------------------------
    def _tie(self, card: Card) -> None:
        if {"CYCLICSYMMETRY", "MULTISTAGE"} & set(card.parameters):
            self.model.note("refused", card, "CYCLIC SYMMETRY: model a sector between symmetry planes")
            return
        name = card.need("NAME")
        if not card.rows:
            raise card.error("it has no surfaces; name two in the next line")
        for row in card.rows:
            _, slave, master, alone = self._surfaces(card, row)
            self._tie_nodes(card, row, alone, Facets(self.mesh, master))
            if not slave:
                continue
            word = card.get("POSITIONTOLERANCE")
            reach = None if word is None else card.number(Row(card.where, [word]), 0, "POSITION TOLERANCE")
            if reach is None:
                apart = Facets(self.mesh, slave).distance(Facets(self.mesh, master))
                reach = max(apart.least, 0.0) + _REACH * apart.facet
            names = [w.upper() for w in row.words[:2]]
            first, second = self.faces.ask(names[0], slave), self.faces.ask(names[1], master)
            self._join(name, Perfect(), first, second, reach, card, row.where)

    def _tie_nodes(self, card: Card, row: Row, nodes: list[int], master: Facets) -> None:
        for node in nodes:
            below = over(self.mesh, master, node)
            if below is None:
                name = self.model.node_names[node]
                raise card.error(f"node {name} lies over no face of {row.words[1]!r}; take it out", row.where)
            self.links.tie(card, row.where, node, below.shares)

    def _rigid_body(self, card: Card) -> None:
        root, mesh = self.model.root, self.mesh
        node = root.one_node(card, card.need("REFNODE"), card.where)
        word = card.get("ROTNODE")
        turning = None if word is None else root.one_node(card, word, card.where)
        if card.get("NSET", "PINNSET", "TIENSET") is not None:
            word = card.need("NSET", "PINNSET", "TIENSET")
            self._follow(card, f"rigid {word}", root.node_rows(card, word, card.where), node, turning)
            return
        word = card.need("ELSET")
        members = set(root.element_rows(card, word, card.where))
        found = {p: [s for s in piece.exterior if s[0] in members] for p, piece in enumerate(mesh.pieces)}
        sides = {p: pairs for p, pairs in found.items() if pairs}
        self._body(card, f"rigid {word}", sides, node, turning, True)

    def _kinematic(self, card: Card) -> None:
        root = self.model.root
        node = root.one_node(card, card.need("REFNODE"), card.where)
        by_components: dict[tuple[int, int], list[int]] = {}
        for row in card.rows:
            first = card.whole(row, 1, "first component", default=1)
            last = card.whole(row, 2, "last component", default=first if "".join(row.words[1:]) else 6)
            by_components.setdefault((first, last), []).extend(root.node_rows(card, row.words[0], row.where))
        axes = self.links.orientation(root, card)
        for (first, last), nodes in by_components.items():
            name = f"coupling {card.need('REFNODE')}"
            self._follow(card, name, nodes, node, None, range(first, last + 1), axes)

    def _of_nodes(self, nodes: list[int]) -> Sides | None:
        """Faces of which all nodes are among some, if these have all of them."""
        wanted = set(nodes) - self.history.references
        found = {p: self.mesh.at_nodes(piece, wanted) for p, piece in enumerate(self.mesh.pieces)}
        sides = {p: pairs for p, pairs in found.items() if pairs}
        rest = wanted - {n for pairs in sides.values() for side in pairs for n in self.mesh.face(side)}
        return None if rest else sides or None

    def _follow(
        self, card: Card, name: str, nodes: list[int], reference: int, turning: int | None = None,
        components: Iterable[int] = (), axes: Axes | None = None,
    ) -> None:
        """Nodes that follow a reference node; whole faces in all components are a rigid body."""
        sides = self._of_nodes(nodes)
        wanted, dim = set(components), self.mesh.pieces[0].kind.dim
        single = {reference, turning} & (self.links.named() | set(self.model.transforms))
        if sides and not single and (not wanted or set(range(1, dim + 1)) <= wanted):
            self._body(card, name, sides, reference, turning, True)
        else:
            self.links.follow(card, nodes, reference, turning, wanted, axes)

    def _body(
        self, card: Card, name: str, sides: Sides, node: int, turning: int | None, rigid: bool
    ) -> None:
        if {node, turning} & (self.links.named() | set(self.model.transforms if rigid else ())):
            raise card.error(f"{name}: its node has equations, springs or *TRANSFORM; use *KINEMATIC")
        asked = self.faces.ask(name, sides)
        self.bodies.append(Body(name, asked, node, turning, rigid, (card.where, card.keyword)))

    def _coupling(self, card: Card) -> None:
        kind = card.get("_KIND")
        if kind is None:
            raise card.error("*KINEMATIC or *DISTRIBUTING has to follow; add it")
        word = card.need("SURFACE")
        node = self.model.root.one_node(card, card.need("REFNODE"), card.where)
        scope, surface = self.model.root.surface(card, word, card.where)
        name = f"coupling {card.get('CONSTRAINTNAME') or word}"
        if surface.nodal:
            nodes = [n for r in surface.card.rows for n in scope.node_rows(surface.card, r.words[0], r.where)]
            sides = self._of_nodes(nodes)
        else:
            sides = self.mesh.sides(self.model.root, card, word, card.where)
            count = len(self.model.x)
            on = (n for pairs in sides.values() for side in pairs for n in self.mesh.face(side) if n < count)
            nodes = list(dict.fromkeys(on))
        held: set[int] = set()
        for row in card.rows:
            first = card.whole(row, 0, "first component")
            held |= set(range(first, card.whole(row, 1, "last component", default=first) + 1))
        if kind == "KINEMATIC":
            self._follow(card, name, nodes, node, None, held, self.links.orientation(scope, card))
            return
        axes = self.links.orientation(scope, card)
        if axes is not None:
            self.model.transforms[node] = axes
            self.model.note("changed", card, "forces on its node are along the axes of its ORIENTATION")
        if sides is None:
            raise card.error("its nodes do not make up whole faces; name those of faces")
        self._body(card, name, sides, node, None, False)

    # --- into a scene ---------------------------------------------------------------------------------
    def put(self, scene: Scene) -> None:
        """Add the interfaces and rigid bodies to a scene that has the parts."""
        used: set[str] = set()
        for joint in self.joints:
            pairs = [
                (a, b) for a in self.faces.named(joint.first) for b in self.faces.named(joint.second)
            ]
            for (p, one, ours), (q, two, theirs) in pairs:
                facets = Facets(self.mesh, {p: ours}), Facets(self.mesh, {q: theirs})
                if len(pairs) > 1 and not self._near(joint, *facets):
                    continue
                with placed(*joint.card):
                    scene.interface(
                        unused(joint.name, used), self.faces.text(p, one), self.faces.text(q, two),
                        joint.law, **self._settings(joint, *facets),
                    )
        for body in self.bodies:
            with placed(*body.card):
                self._put_body(scene, body, used)

    @staticmethod
    def _settings(joint: Joint, ours: Facets, theirs: Facets) -> dict[str, Any]:
        if joint.matching or ours.meshed_as(theirs):
            return {}
        if joint.reach is None:
            return {"overlap": "partial"}
        share = 0.5 * joint.reach / float(max(ours.radii.max(), theirs.radii.max()))
        return {"overlap": "partial"} | ({"max_distance": 1.01 * share} if share > _REACH else {})

    def _near(self, joint: Joint, ours: Facets, theirs: Facets) -> bool:
        """Whether two faces of several can meet."""
        facet = 2.0 * float(max(ours.radii.max(), theirs.radii.max()))
        return ours.meets(theirs, max(joint.reach or 0.0, _REACH * facet))

    def _put_body(self, scene: Scene, body: Body, used: set[str]) -> None:
        curves, value = self.history.curves, self.history.value
        dim = self.mesh.pieces[0].kind.dim
        keys = {(body.reference, k): k for k in range(1, 7)}
        if body.turning is not None:
            keys |= {(body.turning, k): k + 3 for k in range(1, 4)}
        allowed = (1, 2, 6) if dim == 2 else range(1, 7)
        keys = {key: k for key, k in keys.items() if k in allowed}
        motions = {k: value(curves["u", *key]) for key, k in keys.items() if ("u", *key) in curves}
        acting: dict[int, list[tuple[float, Curve]]] = {}
        for key in [key for key in keys if ("f", *key) in curves]:
            for along, c in self.links.along(*key, 1.0).items():
                acting.setdefault(keys[along], []).append((c, curves["f", *key]))
        loads = {k: value(combined(terms)) for k, terms in acting.items()}
        faces = self.faces.named(body.faces)
        names = [self.faces.text(p, name) for p, name, _ in faces]
        x = tuple(listed(self.mesh.x[body.reference, :dim]))
        name = unused(body.name, used)
        if not body.rigid and (motions or len(names) > 1):
            raise SceneError("a distributing coupling takes forces on one part, no motions; use *KINEMATIC")
        if body.rigid:
            given = {("x", "y", "z", "rx", "ry", "rz")[k - 1]: v for k, v in motions.items()}
            scene.rigid(names, point=x, name=name, **given)
        force = tuple(loads.get(k, 0.0) for k in range(1, dim + 1))
        moment = loads.get(6) if dim == 2 else tuple(loads.get(k, 0.0) for k in range(4, 7))
        turned = any(k > 3 for k in loads)
        if loads:
            scene.force(names[0], force, moment if turned else None, x, f"force on {name}")
