"""Pieces of a deck: connected elements of one kind and section, which become the parts of a scene.

Elements are connected by common faces. Pieces that share faces are glued to each other there; the faces of a
pre-tension section are cut instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components, dijkstra

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.cards import Card
from dolfinx_frontend.decks.abaqus.elements import FACES, KINDS, Kind, face_nodes, listed, middles
from dolfinx_frontend.decks.abaqus.model import Model, Scope, Section
from dolfinx_frontend.decks.fields import Where
from dolfinx_frontend.geometry.gmsh import assembled
from dolfinx_frontend.geometry.meshed import Meshed
from dolfinx_frontend.geometry.parts import Part

__all__ = ["Mesh", "Pairs", "Piece"]

Pairs = list[tuple[int, int]]
"""Element and number of its face, from 0."""


class Piece(NamedTuple):
    """Its name, kind, section, elements, nodes (rows with those added) and exterior faces."""

    name: str
    kind: Kind
    section: Section
    elements: Ints
    nodes: Ints
    exterior: Pairs


@dataclass
class Mesh:
    """The elements of a deck in pieces.

    Attributes
    ----------
    x
        (nodes, 3), with the nodes that are added at the middle of faces and cells.
    of_element
        Piece of each element; -1: it is none of a solid.
    neighbours
        Element and face -> the same of the other side.
    """

    model: Model
    pieces: list[Piece] = field(default_factory=list)
    x: Array = field(default_factory=lambda: np.zeros((0, 3)))
    of_element: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    neighbours: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    pieces_of_node: dict[int, list[int]] = field(default_factory=dict)
    _rows: dict[int, Ints] = field(default_factory=dict)
    _centres: dict[tuple[int, ...], int] = field(default_factory=dict)
    _completed: set[int] = field(default_factory=set)
    _added: sp.csr_matrix | None = None
    _keys: dict[tuple[int, ...], tuple[int, int]] = field(default_factory=dict)

    # --- making it ----------------------------------------------------------------------------------
    def build(self, cuts: Iterable[Pairs]) -> None:
        """Divide the elements, cut at some faces."""
        model = self.model
        kinds = [KINDS.get(e.kind) for e in model.elements]
        solid = [e for e, kind in enumerate(kinds) if kind is not None]
        if not solid:
            raise model.elements[0].error("the deck has no solids; add elements as C3D8 or C3D10")
        if len({kinds[e].dim for e in solid}) > 1:  # type: ignore[union-attr]
            raise model.elements[0].error("solids in the plane and in space in one deck; give one of them")
        if len({kinds[e].plane == "axisymmetric" for e in solid}) > 1:  # type: ignore[union-attr]
            raise model.elements[0].error("axisymmetric and plane solids in one deck; give one of them")
        self._neighbours(solid)
        section = self._sections(solid)
        cuts = list(cuts)
        cut = {side for pairs in cuts for side in pairs}
        cut |= {self.neighbours[side] for side in cut if side in self.neighbours}
        links = [
            (a[0], b[0]) for a, b in self.neighbours.items()
            if a < b and a not in cut and section[a[0]] == section[b[0]] and kinds[a[0]] == kinds[b[0]]
        ]
        n = len(model.elements)
        i, j = np.array(links, dtype=np.int64).reshape(-1, 2).T
        graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
        _, labels = connected_components(graph, directed=False)
        for pairs in cuts:
            self._parted(pairs, graph, labels)
        groups: dict[int, list[int]] = {}
        for e in solid:
            groups.setdefault(int(labels[e]), []).append(e)
        self._complete(solid)
        self.of_element = np.full(n, -1, dtype=np.int64)
        used: dict[str, int] = {}
        for members in groups.values():
            self._piece(members, section[members[0]], used)
        for p, piece in enumerate(self.pieces):
            for node in listed(piece.nodes):
                self.pieces_of_node.setdefault(node, []).append(p)

    def _parted(self, pairs: Pairs, graph: sp.csr_matrix, labels: Ints) -> None:
        """Divide what hangs together around a cut: elements belong to the side of it that is fewer elements
        away."""
        ours = np.array([e for e, _ in pairs], dtype=np.int64)
        sides = [self.neighbours[side] for side in pairs if side in self.neighbours]
        theirs = np.array([e for e, _ in sides], dtype=np.int64)
        if not np.isin(labels[ours], labels[theirs]).any():
            return
        near, far = (
            dijkstra(graph, directed=False, indices=own, unweighted=True, min_only=True)
            for own in (ours, theirs)
        )
        labels[np.isin(labels, labels[ours]) & (near < far)] = labels.max() + 1

    def _neighbours(self, solid: list[int]) -> None:
        """Sides that share the corners of a face."""
        for e in solid:
            element = self.model.elements[e]
            for f, places in enumerate(FACES[KINDS[element.kind].cell]):
                key = tuple(sorted(element.nodes[p] for p in places))
                other = self._keys.setdefault(key, (e, f))
                if other == (e, f):
                    continue
                if other in self.neighbours:
                    raise element.error(f"face S{f + 1} is shared by three elements: two lie on each other, "
                                        "take one out")
                self.neighbours[other], self.neighbours[e, f] = (e, f), other

    def _sections(self, solid: list[int]) -> dict[int, int]:
        """Section of each element; the last one counts."""
        found: dict[int, int] = {}
        for s, section in enumerate(self.model.sections):
            for e in section.scope.element_rows(section.card, section.elset, section.card.where):
                found[e] = s
        for e in solid:
            if e not in found:
                raise self.model.elements[e].error("it has no *SOLID SECTION; give its set one")
        return found

    def _complete(self, solid: list[int]) -> None:
        by_kind: dict[Kind, list[int]] = {}
        for e in solid:
            by_kind.setdefault(KINDS[self.model.elements[e].kind], []).append(e)
        blocks = [
            (kind, np.array([self.model.elements[e].nodes for e in members], dtype=np.int64))
            for kind, members in by_kind.items()
        ]
        x = self.model.points()
        rows, self._added, self._centres = middles(blocks, len(x))
        self.x = np.concatenate([x, self._added @ x])
        for members, block in zip(by_kind.values(), rows, strict=True):
            self._rows.update(zip(members, block, strict=True))

    def _piece(self, members: list[int], section: int, used: dict[str, int]) -> None:
        of = self.model.sections[section]
        base = f"{of.scope.name}.{of.elset}" if of.scope.name else of.elset
        base = "".join(c if c.isalnum() or c in "._- " else "_" for c in base)
        used[base] = used.get(base, 0) + 1
        name = base if used[base] == 1 else f"{base}#{used[base]}"
        kind = KINDS[self.model.elements[members[0]].kind]
        own = len(self.pieces)
        self.of_element[members] = own
        inside = set(members)
        exterior = [
            (e, f) for e in members for f in range(len(FACES[kind.cell]))
            if self.neighbours.get((e, f), (-1, 0))[0] not in inside
        ]
        nodes = np.unique(np.concatenate([self._rows[e] for e in members]))
        self.pieces.append(Piece(name, kind, of, np.array(members), nodes, exterior))

    # --- what it knows --------------------------------------------------------------------------
    def kind(self, e: int) -> Kind:
        """The kind of a solid element."""
        return KINDS[self.model.elements[e].kind]

    def face(self, side: tuple[int, int]) -> list[int]:
        """Nodes of a face, corners first, with the one that is added at its middle."""
        e, f = side
        kind, nodes = self.kind(e), self.model.elements[e].nodes
        found = [nodes[p] for p in face_nodes(kind)[f]]
        if kind.cell == "hexahedron" and kind.order == 2:
            found.append(self._centres[tuple(sorted(found[:4]))])
        return found

    def between(self, side: tuple[int, int]) -> dict[int, dict[int, float]]:
        """Nodes that displacements have on a face beside those of the deck -> nodes of the deck that they lie
        between, and the shares of these in the displacement that the elements of the deck have there."""
        p = int(self.of_element[side[0]])
        kind = self.pieces[p].kind
        if kind.dim == 3 and kind.cell == "hexahedron" and kind.order == 2:
            *nodes, middle = self.face(side)
            return {middle: dict(zip(nodes, [-0.25] * 4 + [0.5] * 4))}
        if kind.degree == kind.order:
            return {}
        if p not in self._completed:
            self._completed.add(p)
            keys = {tuple(sorted(own)) for each in self.pieces[p].exterior for own in self._groups(each)}
            new = [key for key in sorted(keys) if key not in self._centres]
            self._centres.update(zip(new, range(len(self.x), len(self.x) + len(new))))
            self.x = np.concatenate([self.x, *(self.x[list(key)].mean(axis=0, keepdims=True) for key in new)])
            for key in keys:
                self.pieces_of_node.setdefault(self._centres[key], []).append(p)
        return {
            self._centres[tuple(sorted(own))]: dict.fromkeys(own, 1.0 / len(own))
            for own in self._groups(side)
        }

    def _groups(self, side: tuple[int, int]) -> list[list[int]]:
        """Nodes of a face, and of its edges in space."""
        nodes = self.face(side)
        edges = [[a, b] for a, b in zip(nodes, [*nodes[1:], nodes[0]])]
        return [nodes, *edges] if len(nodes) > 2 else [nodes]

    def extended(self, values: Array) -> Array:
        """Values at all nodes (nodes, ...) of those at the nodes of the deck."""
        assert self._added is not None
        return np.concatenate([values, self._added @ values])

    def outside(self, side: tuple[int, int]) -> bool:
        """Whether a face is on the surface of its piece."""
        other = self.neighbours.get(side)
        return other is None or self.of_element[other[0]] != self.of_element[side[0]]

    def at_nodes(self, piece: Piece, wanted: set[int]) -> Pairs:
        """Exterior faces of a piece of which all nodes of the deck are among some."""
        count = len(self.model.x)
        return [
            side for side in piece.exterior
            if all(node in wanted for node in self.face(side) if node < count)
        ]

    def sides(self, scope: Scope, card: Card, word: str, where: Where) -> dict[int, Pairs]:
        """Faces of a surface by piece: of faces, or those of which all nodes are in a surface of nodes."""
        found, _ = self.surface(scope, card, word, where)
        if not found:
            raise card.error(f"the surface {word!r} has no face of an element; give faces", where)
        return found

    def surface(
        self, scope: Scope, card: Card, word: str, where: Where
    ) -> tuple[dict[int, Pairs], list[int]]:
        """The same, which may be none, and the nodes of a surface of nodes that are on none of them."""
        model = self.model
        scope, surface = scope.surface(card, word, where)
        pairs: Pairs = []
        wanted: set[int] = set()
        for row in surface.card.rows:
            if surface.nodal:
                wanted.update(scope.node_rows(surface.card, row.words[0], row.where))
            elif len(row.words) > 1 and row.words[1]:
                label = row.words[1].upper()
                pairs += model.face_rows(scope, surface.card, row.words[0], label, row.where)
            else:
                members = scope.element_rows(surface.card, row.words[0], row.where)
                pairs += [
                    (e, f) for e in members for f in range(len(FACES[self.kind(e).cell]))
                    if self.outside((e, f))
                ]
        pairs += [side for piece in self.pieces for side in self.at_nodes(piece, wanted)]
        out: dict[int, Pairs] = {}
        for side in dict.fromkeys(pairs):
            if not self.outside(side):
                raise surface.card.error(f"the surface {surface.name!r} runs inside a part; give outer faces")
            out.setdefault(int(self.of_element[side[0]]), []).append(side)
        return out, sorted(wanted.difference(*map(self.face, pairs)))

    def parts(self, faces: Mapping[int, Mapping[str, Pairs]]) -> dict[str, Part]:
        """The meshes, with named faces by piece.

        Raises
        ------
        DeckError
            Cells that make no mesh.
        """
        dim = self.pieces[0].kind.dim
        out: dict[str, Part] = {}
        for p, piece in enumerate(self.pieces):
            kind = piece.kind
            local = {int(node): k for k, node in enumerate(piece.nodes)}
            rows = np.array([[local[n] for n in listed(self._rows[e])] for e in listed(piece.elements)])
            facets = {
                f"{piece.name}:{name}": {
                    0: np.array([[local[n] for n in self.face(side)] for side in pairs], dtype=np.int64)
                }
                for name, pairs in faces.get(p, {}).items()
            }
            x = self.x[piece.nodes]
            self._check(piece, x, rows)
            cells = {piece.name: {kind.gmsh: rows.astype(np.int64)}}
            try:
                out |= assembled(Meshed(dim, x, cells, facets, {kind.gmsh: kind.cell}), dim).parts
            except (SceneError, RuntimeError) as error:
                element = self.model.elements[int(piece.elements[0])]
                raise element.error(f"the part {piece.name!r} makes no mesh: {error}") from error
        return out

    def _check(self, piece: Piece, x: Array, rows: Ints) -> None:
        """Refuse cells that are turned inside out or have no volume at their corners."""
        dim = piece.kind.dim
        corner = rows[:, : {2: 4, 3: 8}[dim]] if piece.kind.cell in ("quadrilateral", "hexahedron") else rows
        triples = _CORNERS[piece.kind.cell]
        points = x[corner][..., :dim]
        size = np.ptp(points, axis=1).max(axis=1)
        worst = np.full(len(rows), np.inf)
        with np.errstate(all="ignore"):
            for first, *others in triples:
                edges = points[:, others] - points[:, [first]]
                worst = np.fmin(worst, np.nan_to_num(np.linalg.det(edges) / size**dim, nan=-np.inf))
        bad = np.flatnonzero(~(worst > 1e-12))
        if bad.size:
            raise self.model.elements[int(piece.elements[bad[0]])].error(
                "it is turned inside out or flat at a corner; check its nodes, and their order"
            )


_CORNERS: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1, 2),),
    "quadrilateral": ((0, 1, 3), (1, 2, 0), (2, 3, 1), (3, 0, 2)),
    "tetrahedron": ((0, 1, 2, 3),),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7),
        (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
}
"""Corners, each with the ends of its edges in right-handed order."""
