"""Where interfaces, ties and supports of one part meet: what else holds the nodes of its faces.

Of interfaces that meet at an edge or a cross point, each vertex may have one multiplier.  Supports, and ties
whose meshes match, come first, because their nodes are eliminated; then the interfaces in the order in which
they were added.  Where several parts meet one face, a vertex belongs to the interface that covers most of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap
from dolfinx_frontend.assembly.held_nodes import Held, held_by, joined_holds
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.matrix_part import frames_of
from dolfinx_frontend.assembly.overlap import common, constant, shape_of
from dolfinx_frontend.assembly.pairing import coincide, near_facets
from dolfinx_frontend.assembly.substructure import NEAR, Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Elimination
from dolfinx_frontend.scene.scene import Scene

__all__ = ["Differing", "Off", "held_nodes", "refuse", "supports_that_meet"]

_Where = tuple[str, int]

_HALF = 0.5
_EVEN = 1e-6
"""Fractions of facets that differ from 1/2 by less are 1/2."""

_TOUCHED = 1e-9
"""A facet is not covered if a smaller fraction of it is."""


class _Faces:
    """The faces of this rank's interfaces, each made once."""

    def __init__(
        self,
        scene: Scene,
        substructures: Mapping[str, Substructure],
        elsewhere: Mapping[_Where, FaceCopy],
    ) -> None:
        self.scene, self.substructures, self.elsewhere = scene, substructures, elsewhere
        self._maps: dict[_Where, FacetMap] = {}

    def space(self, where: _Where) -> Any:
        if where in self.elsewhere:
            return self.elsewhere[where].space
        return self.substructures[self.scene.interfaces[where[0]].faces[where[1]].substructure].space

    def facets(self, where: _Where) -> FacetMap:
        if where not in self._maps:
            face = self.scene.interfaces[where[0]].faces[where[1]]
            part = self.elsewhere.get(where) or self.substructures[face.substructure].part
            self._maps[where] = FacetMap(part, face.face, f"interface {where[0]!r}")
        return self._maps[where]

    def glued(self, name: str) -> bool:
        """Whether the nodes of both sides are glued: they are at the same places, and the law says so."""
        joint = self.scene.interfaces[name]
        if len(joint.faces) == 1 or joint.law.elimination is not Elimination.GLUED:
            return False
        both = [(name, 0), (name, 1)]
        return coincide([self.facets(w) for w in both], [self.space(w) for w in both])

    def covered(self, where: _Where) -> Any:
        """Nodes of a face on facets that the other side covers, at least in part."""
        other = (where[0], 1 - where[1])
        faces, spaces = (self.facets(where), self.facets(other)), (self.space(where), self.space(other))
        near = near_facets(faces, self.scene.interfaces[where[0]].max_distance)
        found = common(faces, spaces, constant(shape_of(faces[0])), (near[0], near[1]), 1)
        touched = found.covered > _TOUCHED * found.whole
        return np.unique(faces[0].closure_dofs(spaces[0])[touched])


def held_nodes(
    scene: Scene, substructures: Mapping[str, Substructure], elsewhere: Mapping[_Where, FaceCopy]
) -> dict[_Where, Held]:
    """By interface and side, what holds the nodes of the faces of this rank beside the interface itself.

    Parameters
    ----------
    scene
        All parts and interfaces.
    substructures
        Those of this rank.
    elsewhere
        Faces opposite to theirs that are on other ranks, and faces of matrices.
    """
    faces = _Faces(scene, substructures, elsewhere)
    members: dict[str, list[_Where]] = {name: [] for name in substructures}
    for name, joint in scene.interfaces.items():
        for number, face in enumerate(joint.faces):
            part = substructures.get(face.substructure)
            if len(joint.faces) == 1 and frames_of(part) is not None:
                continue  # points without facets
            holds = joint.law.rigid and joint.law.released is joint.law  # at all times
            if face.substructure in members and holds and joint.remote is None:
                members[face.substructure].append((name, number))
    out: dict[_Where, Held] = {}
    for several in members.values():
        out.update(_of_one_part(faces, several))
    return out


def _of_one_part(faces: _Faces, members: list[_Where]) -> dict[_Where, Held]:
    """What holds the nodes of each of the faces of a part, in the order of the interfaces."""
    scene = faces.scene

    @cache
    def held(where: _Where) -> Held:
        joint = scene.interfaces[where[0]]
        face = joint.faces[where[1]]
        label = (face.substructure, face.face)
        return held_by(where[0], joint.law, label, len(joint.faces), faces.facets(where), faces.space(where))

    glued = cache(faces.glued)
    covered = cache(faces.covered)
    out: dict[_Where, Held] = {}
    for at, where in enumerate(members):
        joint = scene.interfaces[where[0]]
        if joint.space in ("points", "facets") or (len(joint.faces) == 1 and not joint.law.unilateral):
            continue
        own, space = faces.facets(where), faces.space(where)
        nodes = own.face_nodes(space)
        found = []
        for before, other in enumerate(members):
            theirs = scene.interfaces[other[0]]
            beside = faces.facets(other)
            if other == where or not np.isin(nodes, beside.face_nodes(space)).any():
                continue
            support = len(theirs.faces) == 1 and theirs.law.prescribes == "jump"
            first = before < at or glued(other[0])
            if support:
                found.append(held(other))
            elif not np.isin(beside.cells * 8 + beside.local, own.cells * 8 + own.local).any():
                if first:
                    found.append(held(other))
            elif len(theirs.faces) == 2:
                found.append(_shared(held(other), covered(other), first))
        together = joined_holds(found)
        if together is not None:
            some = np.isin(together.nodes, nodes)
            out[where] = Held(together.nodes[some], together.directions[some], together.least[some])
    return out


def _shared(held: Held, covered: Any, first: bool) -> Held:
    """What another interface of the same face holds, which is that of the two that covers more of a node."""
    some = np.isin(held.nodes, covered)
    least = np.full(int(some.sum()), _HALF + (_EVEN if first else -_EVEN))
    return replace(held, nodes=held.nodes[some], directions=held.directions[some], least=least)


def supports_that_meet(
    interfaces: Mapping[str, Interface], substructures: Mapping[str, Substructure]
) -> Iterator[tuple[Interface, Interface, Array]]:
    """Supports and rigid or plane faces of two parts that meet at a glued joint, and points (m, d) where; two
    supports only where the meshes do not match, for others have common nodes."""
    prescribing: dict[str, list[Interface]] = {}
    for i in interfaces.values():
        if i.law.elimination in (Elimination.REMOVED, Elimination.TIED):
            prescribing.setdefault(i.sides[0].substructure, []).append(i)
    for joint in interfaces.values():
        parts = [side.substructure for side in joint.sides]
        if not substructures.keys() >= {*parts} or joint.law.eliminated(True) is not Elimination.GLUED:
            continue  # on another rank, no glue, or with a jump
        for one, other in product(*(prescribing.get(part, []) for part in parts)):
            tied = Elimination.TIED in (one.law.elimination, other.law.elimination)
            x, y = (
                substructures[part].dof_coordinates[np.intersect1d(i.sides[0].nodes, side.nodes)]
                for part, i, side in zip(parts, (one, other), joint.sides, strict=True)
            )
            if not (len(x) and len(y)) or (joint.matching is not None and not tied):
                continue
            least = NEAR * min(substructures[part].length for part in parts)
            found = np.concatenate([x[_away(x, y) < least], y[_away(y, x) < least]])
            if len(found):
                yield one, other, np.unique(found, axis=0)


def _away(x: Array, line: Array) -> Array:
    """(m,): distance of points (m, d) from what lies between neighbouring nodes (n, d) of a line."""
    near = spatial.cKDTree(line).query(x, [1, 2, 3][: len(line)])[1]  # it is between two of these
    first, along = line[near][:, :, None], line[near][:, None] - line[near][:, :, None]
    beside = x[:, None, None] - first
    squared = np.maximum(np.sum(along**2, axis=3), np.finfo(float).tiny)
    at = np.clip(np.sum(beside * along, axis=3) / squared, 0.0, 1.0)
    return np.asarray(np.linalg.norm(beside - at[..., None] * along, axis=3).min(axis=(1, 2)))


class Off(NamedTuple):
    """What is prescribed differently: (n, k) at common nodes, the largest value, and how to say it."""

    values: Array
    scale: float
    said: Callable[[Array], str]


Differing = dict[str, Off]


def refuse(off: Mapping[Amplitude | None, Differing], moments: Iterable[float]) -> None:
    """Raise where the sums of load patterns are off at a moment: their functions of time differ."""
    for place in dict.fromkeys(place for each in off.values() for place in each):
        found = {a: each[place] for a, each in off.items() if place in each}
        values = np.array([one.values for one in found.values()])
        factors = np.array([[1.0 if a is None else a(t) for a in found] for t in moments])
        least = 1e-9 * float((np.abs(factors) * [one.scale for one in found.values()]).max())
        rows = np.any(np.abs(values) > 0.0, axis=(0, 2))
        at = np.abs(np.tensordot(factors, values[:, rows], 1))
        worst = np.zeros_like(values[0])
        worst[rows] = at[np.argmax(at.max(axis=(1, 2), initial=0.0))]
        if worst.max(initial=0.0) > least:
            worst[worst <= least] = 0.0
            raise SceneError(next(iter(found.values())).said(worst))
