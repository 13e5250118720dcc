"""Interface points, mass-free trace operators, and the geometric pairing of two sides.

Points are the quadrature points of the facets of side 1, pushed forward through the coordinate map
(straight or curved).  Side 2 is sampled at the closest points of its own facets, found with a
nearest neighbour search and Gauss-Newton inversion of the facet map.  Matching meshes are a special
case and not another path.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.averages import OPPOSED, Averages, average
from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap
from dolfinx_frontend.assembly.interface import Interface, Side, frames, nodal_normals
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.common.vectors import unit
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.specs import Overlap, PartLike, Space

__all__ = ["make_interface"]


MAX_DISTANCE = 0.25
"""Default of the largest distance between the sides, as a fraction of the facet size."""


def _side(
    label: str,
    face: str,
    space: Any,
    facets: FacetMap,
    shape: sp.csr_matrix,
    own: tuple[sp.csr_matrix, Array, Array] | None = None,
) -> Side:
    """A side with its trace; `own`: shape functions, weights, normals at points of its own."""
    nodes = facets.face_nodes(space)
    columns = space.dofmap.index_map.size_local
    if own is None:
        degree = 2 * space.element.basix_element.degree
        own_index, own_s, w = facets.quadrature(degree)
        _, normals, area = facets.surface(own_index, own_s)
        own = (facets.trace(space, own_index, own_s, columns), w * area, normals)
    own_shape, weights, normals = own
    total = float(weights.sum())
    mean = (weights[:, None] * normals).sum(axis=0) / total
    flatness = float(np.linalg.norm(normals - mean, axis=1).max())
    length = np.linalg.norm(mean)
    return Side(
        substructure=label,
        face=face,
        trace=petsc_matrix(sp.kron(shape, sp.identity(facets.dim), format="csr")),
        shape=shape,
        nodes=nodes,
        node_normals=nodal_normals(own_shape, weights, normals, nodes),
        flatness=flatness,
        normal=unit(mean) if length > 1e-9 else np.zeros(facets.dim),
        area=total,
    )


def _candidates(facets: FacetMap, points: Array) -> tuple[Ints, Ints]:
    """Pairs (point, facet) worth a look: owners of the nearest sample points."""
    n, k, d = facets.samples.shape
    tree = cKDTree(facets.samples.reshape(n * k, d))
    near = min(12, n * k)
    _, found = tree.query(points, k=near)
    owner = np.sort(found.reshape(len(points), near) // k, axis=1)
    fresh = np.ones(owner.shape, dtype=bool)
    fresh[:, 1:] = owner[:, 1:] != owner[:, :-1]
    who, which = np.nonzero(fresh)
    return who, owner[who, which]


def _box_candidates(facets: FacetMap, points: Array, reach: Array) -> tuple[Ints, Ints]:
    """Pairs (point, facet) whose bounding box is within reach of the point."""
    low, high = facets.samples.min(axis=1), facets.samples.max(axis=1)
    if facets.order > 1:  # a curved facet may leave the box of its samples, by 1/8 if quadratic
        pad = 0.25 * (high - low)
        low, high = low - pad, high + pad
    keep = min(512, len(facets))
    # where nothing is near, the nearest few boxes will do: the point ends in a message anyhow
    most = np.where(reach > facets.sizes.max(), 16, keep)
    who, which = [], []
    for chunk in np.array_split(np.arange(len(points)), 1 + len(points) * len(low) // 2_000_000):
        p = points[chunk][:, None, :]
        gap = np.linalg.norm(np.maximum(np.maximum(low - p, p - high), 0.0), axis=2)
        nearest = np.argpartition(gap, keep - 1, axis=1)[:, :keep]
        gap = np.take_along_axis(gap, nearest, axis=1)
        order = np.argsort(gap, axis=1)
        nearest, gap = (np.take_along_axis(a, order, axis=1) for a in (nearest, gap))
        good = (gap <= reach[chunk][:, None]) & (np.arange(keep) < most[chunk][:, None])
        a, b = np.nonzero(good)
        who.append(chunk[a])
        which.append(nearest[a, b])
    return np.concatenate(who), np.concatenate(which)


def _project(facets: FacetMap, points: Array, normals: Array) -> tuple[Ints, Array, Array, Array]:
    """Closest points of a face: facet, facet coordinates, point, outward normal there."""
    m = len(points)
    best = np.full(m, np.inf)
    index = np.zeros(m, dtype=np.int64)
    s = np.zeros((m, facets.dim - 1))
    settled = np.zeros(m, dtype=bool)

    def consider(who: Ints, which: Ints) -> None:
        if not who.size:
            return
        inner, x, outside = facets.closest(which, points[who])
        _, n2, _ = facets.surface(which, inner)
        distance = np.linalg.norm(points[who] - x, axis=1)
        # a sheet that looks away is no partner as long as another one is there
        away = np.einsum("pi,pi->p", normals[who], n2) > OPPOSED
        score = distance + np.where(away, 1e3 * facets.sizes.max(), 0.0)
        order = np.lexsort((score, who))
        first = np.ones(len(order), dtype=bool)
        first[1:] = who[order][1:] != who[order][:-1]
        chosen = order[first]
        chosen = chosen[score[chosen] < best[who[chosen]]]
        target = who[chosen]
        best[target] = score[chosen]
        index[target] = which[chosen]
        s[target] = inner[chosen]
        near = distance[chosen] < 0.1 * facets.sizes[which[chosen]]
        settled[target] = near & (outside[chosen] < 1e-8) & ~away[chosen]

    consider(*_candidates(facets, points))
    rest = np.flatnonzero(~settled)
    if rest.size:
        who, which = _box_candidates(facets, points[rest], best[rest])
        for part in np.array_split(np.arange(len(who)), 1 + len(who) // 200_000):
            consider(rest[who[part]], which[part])
    x, n2, _ = facets.surface(index, s)
    return index, s, x, n2


def _check_pairing(
    where: str,
    names: tuple[str, str],
    points: Array,
    normals: Array,
    weights: Array,
    sizes: Array,
    x2: Array,
    n2: Array,
    limit: float,
) -> None:
    """Raise unless every point of side 1 has a partner that faces it."""
    offset = x2 - points
    distance = np.linalg.norm(offset, axis=1)
    away = np.einsum("pi,pi->p", normals, n2) > OPPOSED
    far = distance > limit * sizes
    bad = away | far
    total = weights.sum()
    if np.any(bad):
        share = weights[bad].sum() / total
        reason = f"largest distance {distance[bad].max():.4g}, facet size {sizes.max():.4g}"
        if np.any(away):
            reason += f", {np.count_nonzero(away)} points with normals that do not oppose"
        if share > 0.999:
            raise SceneError(
                f"{where}: the facets do not face each other: none of the {len(points)} points of "
                f"{names[0]} has a partner on {names[1]} ({reason}); check the faces and the "
                "positions of the parts, or raise max_distance"
            )
        raise SceneError(
            f"{where}: the facets do not face each other at {np.count_nonzero(bad)} of "
            f"{len(points)} points of {names[0]} ({100 * share:.3g} % of its area has no partner "
            f"on {names[1]}; {reason}); give the smaller face first, split the larger one, or "
            "raise max_distance"
        )
    along = np.einsum("pi,pi->p", offset, n2)[:, None] * n2
    beside = np.linalg.norm(offset - along, axis=1) > 0.02 * sizes
    if weights[beside].sum() > 0.01 * total:
        warnings.warn(
            f"{where}: {100 * weights[beside].sum() / total:.3g} % of {names[0]} lies beside "
            f"{names[1]}; it is joined to the edge of it",
            SceneWarning,
            stacklevel=6,
        )


def _sag(first: FacetMap, second: FacetMap | None, points: Array) -> Array:
    """The larger sag of both sides at the interface points, (m,), length, with a fifth for safety."""
    out = np.zeros(len(points))
    for facets in (first,) if second is None else (first, second):
        _, nearest = cKDTree(facets.samples.mean(axis=1)).query(points)
        out = np.maximum(out, 1.2 * facets.sags[nearest])
    return out


def _match(
    size: float, sides: tuple[Side, Side], coordinates: tuple[Array, Array]
) -> Ints | None:
    """Pairs of nodes at the same place, if there the traces agree too."""
    first, second = sides
    if len(first.nodes) != len(second.nodes):
        return None
    x1, x2 = coordinates[0][first.nodes], coordinates[1][second.nodes]
    distance, partner = cKDTree(x2).query(x1)
    if distance.max() > 1e-6 * size or len(np.unique(partner)) < len(partner):
        return None
    nodes2 = second.nodes[partner]
    difference = first.shape[:, first.nodes] - second.shape[:, nodes2]
    if difference.nnz and np.abs(difference.data).max() > 1e-10:
        return None
    return np.stack([first.nodes, nodes2], axis=1)


@dataclass(frozen=True)
class _Samples:
    """Interface points with the traces of both sides, for one component."""

    points: Array
    normals: Array
    weights: Array
    shapes: tuple[sp.csr_matrix, ...]
    gap: Array
    facets: Ints


def _sample_points(
    first: FacetMap,
    second: FacetMap | None,
    spaces: tuple[Any, ...],
    where: str,
    names: tuple[str, ...],
    limit: float,
    quadrature_degree: int | None,
) -> _Samples:
    """The space ``points``: quadrature points of side 1 and their closest points on side 2."""
    degree = quadrature_degree
    if degree is None:
        highest = max(s.element.basix_element.degree for s in spaces)
        degree = 2 * highest + first.order - 1
    index, s, w = first.quadrature(degree)
    points, normals, area = first.surface(index, s)
    weights = w * area
    first.areas(weights, index, where, names[0])
    columns = [v.dofmap.index_map.size_local for v in spaces]
    shape = first.trace(spaces[0], index, s, columns[0])
    if second is None:
        return _Samples(points, normals, weights, (shape,), np.zeros(len(points)), index)
    index2, s2, x2, n2 = _project(second, points, normals)
    sizes = np.maximum(first.sizes[index], second.sizes[index2])
    _check_pairing(
        where, (names[0], names[1]), points, normals, weights, sizes, x2, n2, limit
    )
    gap = np.einsum("pi,pi->p", x2 - points, normals)
    shape2 = second.trace(spaces[1], index2, s2, columns[1])
    return _Samples(points, normals, weights, (shape, shape2), gap, index)


def make_interface(
    name: str,
    law: Law,
    parts: tuple[PartLike | FaceCopy, ...],
    labels: tuple[tuple[str, str], ...],
    spaces: tuple[Any, ...],
    quadrature_degree: int | None = None,
    max_distance: float | None = None,
    space: Space = "points",
    overlap: Overlap = "full",
) -> Interface:
    """Interface points, traces and pairing.

    Parameters
    ----------
    name, law
        Name and law.
    parts, labels, spaces
        One or two parts, their (substructure, face) names and vector-valued Lagrange spaces; of a part
        on another rank a copy of the face, with its space.
    quadrature_degree
        Degree of the facet rule; None: 2 degree + geometry order - 1, so that the mass matrix of a
        straight simplex is exact.
    max_distance
        Largest distance of the sides, as a fraction of the facet size; None: 1/4.
    space
        ``"points"`` or ``"facets"``, see :mod:`dolfinx_frontend.assembly.averages`.
    overlap
        With ``"facets"``: whether side 2 covers all of side 1 (``"full"``) or may cover a part.

    Raises
    ------
    SceneError
        Facets that do not face each other or overlap, faces that are empty or inside a part.

    Warns
    -----
    SceneWarning
        Areas that differ by more than 1 %; no more nodes than facets (linear triangles).
    """
    where = f"interface {name!r}"
    names = tuple(":".join(label) for label in labels)
    limit = MAX_DISTANCE if max_distance is None else max_distance
    faces = [FacetMap(p, face, where) for p, (_, face) in zip(parts, labels, strict=True)]
    first, second = faces[0], faces[1] if len(faces) == 2 else None
    sampled: Averages | _Samples
    own = None
    if space == "facets":
        sampled = average(
            first, second, spaces, where, names, limit, overlap, quadrature_degree
        )
    else:
        sampled = _sample_points(first, second, spaces, where, names, limit, quadrature_degree)
        own = (sampled.shapes[0], sampled.weights, sampled.normals)
    local, axis = frames(sampled.normals)
    sides = [_side(*labels[0], spaces[0], first, sampled.shapes[0], own)]
    matching = None
    if second is not None:
        sides.append(_side(*labels[1], spaces[1], second, sampled.shapes[1]))
        if overlap == "full":
            _warn_of_areas(where, names, sides)
        coordinates = tuple(
            v.tabulate_dof_coordinates()[: v.dofmap.index_map.size_local] for v in spaces
        )
        size = float(min(first.sizes.min(), second.sizes.min()))
        matching = _match(size, (sides[0], sides[1]), (coordinates[0], coordinates[1]))
        if space == "facets" and matching is None and not law.springs:
            _warn_of_locking(where, names[0], len(sampled.weights), len(sides[0].nodes))
    return Interface(
        name=name,
        law=law,
        points=sampled.points,
        weights=sampled.weights,
        frames=local,
        gap=sampled.gap,
        sides=tuple(sides),
        matching=matching,
        tangent_axis=axis,
        space=space,
        sag=_sag(first, second, sampled.points),
        facets=sampled.facets,
    )


def _warn_of_areas(where: str, names: Sequence[str], sides: Sequence[Side]) -> None:
    ratio = sides[1].area / sides[0].area
    if abs(ratio - 1.0) > 0.01:
        warnings.warn(
            f"{where}: the areas of {names[0]} ({sides[0].area:.6g}) and {names[1]} "
            f"({sides[1].area:.6g}) differ by more than 1 %; only the first one is joined",
            SceneWarning,
            stacklevel=5,
        )


def _warn_of_locking(where: str, face: str, facets: int, nodes: int) -> None:
    if facets >= nodes:
        warnings.warn(
            f"{where}: {facets} facets but {nodes} nodes on {face}: a law that prescribes the jump "
            "locks there and converges slowly; give the substructures degree=2",
            SceneWarning,
            stacklevel=5,
        )
