"""Nodes of a deck that meet a face: where they are over it, and how much of the surface belongs to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.elements import FACES, listed
from dolfinx_frontend.decks.abaqus.facets import Facets
from dolfinx_frontend.decks.abaqus.pieces import Mesh

__all__ = ["Over", "areas_at", "over"]

_BESIDE = 1e-6
"""Beside a facet, in its own coordinates from -1 to 1, that is still over it."""

_ROUNDS, _CLOSE = 20, 1e-14
"""Newton's steps to the coordinates of a point on a quadrilateral, and when they are known."""


class Over(NamedTuple):
    """A node over a face: shares of the nodes of the face in the displacement below it, normal (3,) out of
    the face, and distance along it, negative inside."""

    shares: dict[int, float]
    normal: Array
    distance: float


def over(mesh: Mesh, faces: Facets, node: int) -> Over | None:
    """What is below a node; None: it lies over no facet."""
    gaps, near, _ = faces.under(mesh.x[[node]])
    for k in np.argsort(np.abs(gaps[0])):
        side, normal = faces.pairs[int(near[0, k])], faces.normals[near[0, k]]
        count = len(FACES[mesh.kind(side[0]).cell][side[1]])
        own = [*mesh.face(side), *(n for n in mesh.between(side) if n not in mesh.face(side))]
        flat = _plane(mesh.x[own[:count]], normal)
        corners, nodes, point = (x @ flat for x in (mesh.x[own[:count]], mesh.x[own], mesh.x[[node]]))
        at = _own(corners, np.concatenate([nodes, point]))
        if np.all(at[-1] >= (0.0 if count == 3 else -1.0) - _BESIDE) and (
            at[-1].sum() <= 1.0 + _BESIDE if count == 3 else np.all(at[-1] <= 1.0 + _BESIDE)
        ):
            terms = _monomials(at, len(own), count)
            shares = np.linalg.solve(terms[:-1].T, terms[-1])
            return Over(dict(zip(own, listed(shares))), normal, float(gaps[0, k]))
    return None


def areas_at(mesh: Mesh, nodes: Iterable[int]) -> dict[int, float]:
    """Of the outer faces at nodes, what belongs to each: a face is divided evenly between its nodes."""
    found = dict.fromkeys(nodes, 0.0)
    for p, piece in enumerate(mesh.pieces):
        for side in piece.exterior:
            own = mesh.face(side)
            for node in found.keys() & set(own):
                found[node] += Facets(mesh, {p: [side]}).area / len(own)
    return found


def _plane(corners: Array, normal: Array) -> Array:
    """Axes (3, k) of the plane of a face, or along it."""
    first = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
    axes = [first] if len(corners) == 2 else [first, np.cross(normal, first)]
    return np.transpose(axes)


def _own(corners: Array, x: Array) -> Array:
    """Coordinates of points (n, k) on a face: 0 to 1 on a triangle, else -1 to 1."""
    if len(corners) == 3:
        return np.asarray(np.linalg.solve(np.transpose(corners[1:] - corners[0]), (x - corners[0]).T).T)
    if len(corners) == 2:
        return np.asarray(2.0 * (x - corners[0]) / (corners[1] - corners[0]) - 1.0)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    at = np.zeros_like(x)
    for _ in range(_ROUNDS):
        one, two = (1.0 + signs[None, :, k] * at[:, None, k] for k in (0, 1))
        off = x - 0.25 * (one * two) @ corners
        slopes = 0.25 * np.stack([(signs[:, 0] * two) @ corners, (signs[:, 1] * one) @ corners], axis=2)
        step = np.linalg.solve(slopes, off[:, :, None])[:, :, 0]
        at += step
        if np.abs(step).max() < _CLOSE:
            break
    return at


def _monomials(at: Array, nodes: int, corners: int) -> Array:
    """Values (n, nodes) at points of the monomials that the displacements of a face are made of."""
    if corners == 2:
        return np.asarray(at ** np.arange(nodes))
    if corners == 3:
        powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)][:nodes]
    else:
        most = 2 if nodes == 4 else 3
        powers = [(i, j) for i in range(most) for j in range(most)]
    return np.stack([at[:, 0] ** i * at[:, 1] ** j for i, j in powers], axis=1)
