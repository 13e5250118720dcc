"""What holds the nodes of a face besides the interface on it: supports, ties, contacts that meet it at edges.

A multiplier at a node that is held already would hold it twice: the traces of the other side would have to
follow what nothing asks of them (locking near edges), and its force would have no meaning.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.interface import PointFrames, frames
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.vectors import unit
from dolfinx_frontend.scene.laws import Law

__all__ = ["ANYWAY", "Held", "held_across", "held_by", "held_twice", "joined_holds"]

_SAME = 0.5
"""cos^2 of the angle below which two directions are the same one: 45 degrees."""


ANYWAY = 2.0
"""Of :attr:`Held.least`: no interface covers that much."""


@dataclass(frozen=True)
class Held:
    """Directions in which nodes are held.

    Attributes
    ----------
    nodes
        (k,), ascending.
    directions
        (k, d, d), projectors onto them.
    least
        (k,): an interface must cover more than this fraction of the facets at a node to hold it as well;
        :data:`ANYWAY`: never.
    """

    nodes: Ints
    directions: Array
    least: Array


@dataclass(frozen=True)
class _Probe(PointFrames):
    """Points of a face, without an interface, as a law wants to see them."""

    name: str
    points: Array
    weights: Array
    frames: Array
    sides: tuple[Any, ...]
    law: Law = field(repr=False)

    @property
    def gap(self) -> Array:
        return np.zeros(len(self.weights))

    @property
    def clearance(self) -> Array:
        return self.gap


class _Side:
    """Of a probe."""

    def __init__(self, substructure: str, face: str, normal: Array, flatness: float) -> None:
        self.substructure, self.face, self.normal, self.flatness = substructure, face, normal, flatness


def _rows(law: Law, probe: _Probe) -> Array:
    """(m, r, d), unit or zero."""
    rows = law.nominal.held_rows(probe)
    length = np.linalg.norm(rows, axis=2, keepdims=True)
    out: Array = rows / np.where(length > 0.0, length, 1.0)
    return out


def _projectors(gram: Array, least: float) -> Array:
    """(k, d, d): onto the eigenvectors whose eigenvalues are above a least one."""
    values, vectors = np.linalg.eigh(gram)
    kept = vectors * (values > least)[:, None, :]
    out: Array = kept @ np.swapaxes(vectors, 1, 2)
    return out


def held_by(name: str, law: Law, label: tuple[str, str], sides: int, facets: FacetMap, space: Any) -> Held:
    """What a law holds at the nodes of one of its faces."""
    s, w = facets.rule(2 * int(space.element.basix_element.degree))
    points, (normals, area) = facets.alike(s), facets.alike_surface(s)
    share = np.abs(facets.alike_shapes(space, s)) * (w * area)[:, :, None]
    d = facets.dim
    points, normals, weights = points.reshape(-1, d), normals.reshape(-1, d), (w * area).ravel()
    mean = weights @ normals / weights.sum()
    flatness = float(np.linalg.norm(normals - mean, axis=1).max())
    length = float(np.linalg.norm(mean))
    side = _Side(*label, unit(mean) if length > 1e-9 else np.zeros(d), flatness)
    probe = _Probe(name, points, weights, frames(normals)[0], (side,) * sides, law)
    rows = _rows(law, probe)
    both = np.einsum("mri,mrj->mij", rows, rows).reshape(len(facets), -1, d * d)
    nodes, at = np.unique(facets.closure_dofs(space), return_inverse=True)
    parts = (np.swapaxes(share, 1, 2) @ both).reshape(-1, d * d)
    several = [np.bincount(at.ravel(), parts[:, k]) for k in range(d * d)]
    weight = np.maximum(np.bincount(at.ravel(), share.sum(axis=1).ravel()), 1e-300)
    gram = np.asarray(np.stack(several, axis=1) / weight[:, None], dtype=np.float64)
    return Held(nodes, _projectors(gram.reshape(-1, d, d), 0.3), np.full(len(nodes), ANYWAY))


def joined_holds(several: list[Held]) -> Held | None:
    """All that holds; None: nothing does."""
    if not several:
        return None
    nodes = np.unique(np.concatenate([h.nodes for h in several]))
    total = np.zeros((len(nodes), *several[0].directions.shape[1:]))
    least = np.zeros(len(nodes))
    for h in several:
        at = np.searchsorted(nodes, h.nodes)
        total[at] += h.directions
        least[at] = np.maximum(least[at], h.least)
    return Held(nodes, _projectors(total, 0.3), least)


def held_across(held: Held, nodes: Ints) -> Array:
    """(nodes, d, d): projectors onto the directions in which nodes are held."""
    out = np.zeros((len(nodes), *held.directions.shape[1:]))
    known = np.isin(nodes, held.nodes)
    out[known] = held.directions[np.searchsorted(held.nodes, nodes[known])]
    return out


def held_twice(
    held: Held, law: Law, nodes: Ints, x: Array, normals: Array, covered: Array, sides: int
) -> Flags:
    """Whether a law would hold nodes (ascending), at which it covers a fraction of the facets, in a direction
    in which they are held, and should not."""
    side = _Side("", "", np.zeros(x.shape[1]), 1.0)
    probe = _Probe("", x, np.ones(len(x)), frames(normals)[0], (side,) * sides, law)
    at = np.searchsorted(held.nodes, nodes)
    known = at < len(held.nodes)
    known[known] = held.nodes[at[known]] == nodes[known]
    out = np.zeros(len(nodes), dtype=bool)
    rows = _rows(law, probe)[known]
    both = rows @ held.directions[at[known]] @ np.swapaxes(rows, 1, 2)
    out[known] = (np.linalg.eigvalsh(both)[:, -1] > _SAME) & (covered[known] <= held.least[at[known]])
    return out
