"""Where surfaces of a deck are, and how far from each other: facets as planes between their corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.decks.abaqus.elements import FACES
from dolfinx_frontend.decks.abaqus.faces import Sides
from dolfinx_frontend.decks.abaqus.pieces import Mesh

__all__ = ["Distance", "Facets"]

_WITHIN = 1e-6
"""Of a facet, that is its rim."""


class Distance(NamedTuple):
    """Of two surfaces: smallest and largest (negative: overlap), size of the largest facet, and extent."""

    least: float
    most: float
    facet: float
    extent: float


class Facets:
    """The facets of a surface.

    Attributes
    ----------
    nodes
        All of its nodes.
    pairs
        Element and face of each.
    corners, centres, normals, radii
        (k, c, 3), the last corner of smaller facets twice; (k, 3), (k, 3) out of the part, and (k,).
    """

    def __init__(self, mesh: Mesh, sides: Sides) -> None:
        pairs = [side for own in sides.values() for side in own]
        self.mesh, self.dim, self.pairs = mesh, mesh.kind(pairs[0][0]).dim, pairs
        self.nodes: Ints = np.unique([n for side in pairs for n in mesh.face(side)])
        own = [mesh.x[mesh.face(side)[: len(FACES[mesh.kind(side[0]).cell][side[1]])]] for side in pairs]
        most = max(map(len, own))
        self.corners: Array = np.array([[*x, *[x[-1]] * (most - len(x))] for x in own])
        self.centres: Array = np.array([x.mean(axis=0) for x in own])
        inside = np.array([mesh.x[list(mesh.model.elements[e].nodes)].mean(axis=0) for e, _ in pairs])
        first, last = self.corners[:, 1] - self.corners[:, 0], self.corners[:, -1] - self.corners[:, 0]
        normals = np.cross(first, [0.0, 0.0, 1.0] if self.dim == 2 else last)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        out = np.einsum("kd,kd->k", normals, self.centres - inside) > 0.0
        self.normals: Array = np.where(out[:, None], normals, -normals)
        self.radii: Array = np.linalg.norm(self.corners - self.centres[:, None], axis=2).max(axis=1)

    @property
    def area(self) -> float:
        """Of all facets, in the plane their length."""
        if self.dim == 2:
            return float(np.linalg.norm(self.corners[:, 1] - self.corners[:, 0], axis=1).sum())
        arms = self.corners - self.corners[:, :1]
        double = np.linalg.norm(np.cross(arms[:, 1:-1], arms[:, 2:]).sum(axis=1), axis=1)
        return 0.5 * float(double.sum())

    def meshed_as(self, other: Facets) -> bool:
        """Whether the nodes of two surfaces are at the same places."""
        if len(self.nodes) != len(other.nodes) or len(self.radii) != len(other.radii):
            return False
        away = cKDTree(self.mesh.x[self.nodes]).query(self.mesh.x[other.nodes])[0]
        return float(away.max()) < _WITHIN * float(self.radii.min())

    def under(self, points: Array) -> tuple[Array, Ints, Array]:
        """Facets near points (n, 3): distances along their normals (n, m), their numbers, and distances
        beside their centres."""
        away, near = cKDTree(self.centres).query(points, k=[*range(1, min(4, len(self.centres)) + 1)])
        gaps = np.einsum("nkd,nkd->nk", points[:, None] - self.centres[near], self.normals[near])
        return gaps, np.asarray(near), np.sqrt(np.maximum(away**2 - gaps**2, 0.0))

    def gaps(self, other: Facets) -> Array:
        """Of the nodes from the nearest facets of another surface that they lie over; NaN: over none."""
        gaps, near, beside = other.under(self.mesh.x[self.nodes])
        closest = np.where(beside <= 1.05 * other.radii[near], np.abs(gaps), np.inf).argmin(axis=1)[:, None]
        found, aside = (np.take_along_axis(each, closest, axis=1)[:, 0] for each in (gaps, beside))
        return np.where(aside <= 1.05 * other.radii[near[np.arange(len(near)), closest[:, 0]]], found, np.nan)

    def distance(self, other: Facets) -> Distance:
        """Of the nodes from the facets of another surface that they lie over."""
        gaps, x = self.gaps(other), self.mesh.x[self.nodes]
        facet = 2.0 * float(max(self.radii.max(), other.radii.max()))
        extent = float(np.ptp(x, axis=0).max())
        if np.isnan(gaps).all():
            away = float(cKDTree(other.centres).query(x)[0].min())
            least = max(away - float(other.radii.max()), 0.0)
            return Distance(least, least, facet, extent)
        return Distance(float(np.nanmin(gaps)), float(np.nanmax(gaps)), facet, extent)

    def adjusted(self, other: Facets, wanted: set[int] | None, tolerance: float) -> Callable[[Array], Array]:
        """Gap at points, that of the nearest node; of nodes that are wanted, or that are no farther away than
        that, it is 0."""
        gaps = self.gaps(other)
        touching = gaps <= tolerance if wanted is None else np.array([int(n) in wanted for n in self.nodes])
        known = ~np.isnan(gaps)
        tree = cKDTree(self.mesh.x[self.nodes[known]][:, : self.dim])
        values = np.where(touching, 0.0, gaps)[known]
        return lambda x: np.asarray(values[tree.query(x)[1]])

    def inside(self, other: Facets) -> bool:
        """Whether those that lie over another surface all face the way that it does, as where two solids are
        in the same place."""
        _, near, beside = other.under(self.centres)
        alike = np.einsum("kd,kmd->km", self.normals, other.normals[near])[beside <= other.radii[near]]
        return bool(alike.size and alike.min() > 0.0)

    def meets(self, other: Facets, reach: float) -> bool:
        """Whether a facet of one lies over one of the other, nearer than that."""
        return self._over(other, reach) or other._over(self, reach)

    def _over(self, other: Facets, reach: float) -> bool:
        inner = 0.5 * (self.corners + self.centres[:, None])
        points = np.concatenate([self.centres, inner.reshape(-1, 3)])
        gaps, near, beside = other.under(points)
        n, m = np.nonzero((np.abs(gaps) <= reach) & (beside <= other.radii[near]))
        x, facet = points[n], near[n, m]
        corners, normals = other.corners[facet], other.normals[facet]
        edges = np.roll(corners, -1, axis=1) - corners
        if self.dim == 2:
            along = np.einsum("kd,kd->k", x - corners[:, 0], edges[:, 0]) / (edges[:, 0] ** 2).sum(axis=1)
            return bool(np.any((along > _WITHIN) & (along < 1.0 - _WITHIN)))
        beside_edge = np.einsum("ked,kd->ke", np.cross(edges, x[:, None] - corners), normals)
        real = np.linalg.norm(edges, axis=2) > 0.0
        least = _WITHIN * other.radii[facet][:, None] ** 2
        ways = [np.all((sign * beside_edge > least) | ~real, axis=1) for sign in (1.0, -1.0)]
        return bool(np.any(ways[0] | ways[1]))
