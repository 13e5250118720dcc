"""The interface space ``facets``: one value per facet of side 1, constant on it (P0).

Interface point = centroid, weight = area, trace row = mean of the shape functions:

    T_1 = 1/A int N_1 dA,   T_2 = 1/A int N_2 dA   over the facet of side 1,

so that T_2^T W 1 = int N_2 dA: a constant pressure goes through meshes that do not match without
an error, and both traces have the same mean of a linear field (the patch test).  The integrals of
side 2 are taken piece by piece over the intersections with its facets.

Intersections are those of flat convex polygons (intervals in 2D), in the plane of the facet of
side 1: exact for plane faces.  A facet with a map of order g > 1 is cut into g^(d-1) polygons
first, and the points of a piece are put back onto both curved facets: by its map on side 1, along
the normal of the plane on side 2 (where there is a gap, the closest point may be on another facet
than the piece).  An error remains where an edge is not where its chord is.  Measured on a
cylinder, the means of the coordinates differ by O(h^2) with straight facets (the distance of the
chords) and by O(h^4) with quadratic ones.

On triangles of degree 1 there are two facets per node: laws that prescribe jumps lock there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import basix
import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.clipping import flatten, measure, rule_on, simplices_of
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.specs import Overlap

__all__ = ["Averages", "Polygons", "average", "means", "polygons"]


UNCOVERED = 0.01
"""Largest fraction of side 1 that may be left uncovered without ``overlap="partial"``.

Not zero: the edges of a round face are chords, and two meshes have different ones."""

OPPOSED = -0.5
"""Two facets face each other if the product of their unit normals is below this."""

_WHOLE = 1e-9
"""A facet is covered if a smaller fraction of it is not."""

_DIGITS, _REGION, _MOST = 11.0, 1.3, 20
"""On quadrilaterals that are no parallelograms shape functions are analytic, not polynomial, in the
plane coordinates: each degree beyond 2 p gains log10(_REGION / twist) of the _DIGITS that lack
(measured: errors of 1e-15 up to twist = 0.2, 1e-12 at 0.4, with at most _MOST degrees)."""

_CURVED = 2
"""Degrees added on curved facets: the error is that of the flat polygons."""


@dataclass(frozen=True)
class Polygons:
    """Flat polygons that stand for the facets of a face.

    Attributes
    ----------
    corners
        (k, v, d), in the order of the rim; v = 2 in 2D, 3 or 4 in 3D.
    reference
        (k, v, d - 1), the same in the coordinates of the reference facet.
    parent
        (k,), facet.
    parts
        Polygons along an edge of a facet: 1 if it is straight.
    normals
        (k, d), unit, out of the face, of the facet's map in the middle of the polygon.
    """

    corners: Array
    reference: Array
    parent: Ints
    parts: int
    normals: Array


@dataclass(frozen=True)
class Averages:
    """Facet averages of two sides, or of one.

    Attributes
    ----------
    facets
        (m,), facets of side 1 that are covered, numbered as in its FacetMap.
    points, normals
        (m, d), centroid and unit mean normal out of side 1 of the covered part.
    weights
        (m,), its area.
    shapes
        One or two (m, nodes), means of the shape functions of a scalar component.
    gap
        (m,), mean distance from side 1 to side 2 along the normal, length.
    covered
        Covered fraction of the area of side 1.
    """

    facets: Ints
    points: Array
    normals: Array
    weights: Array
    shapes: tuple[sp.csr_matrix, ...] = field(repr=False)
    gap: Array = field(repr=False)
    covered: float


def _reference_polygons(cell: Any, parts: int) -> Array:
    """(k, v, fdim): the reference facet, cut into polygons along a lattice."""
    ends = np.arange(parts + 1) / parts
    if cell == basix.CellType.interval:
        return np.asarray(np.stack([ends[:-1], ends[1:]], axis=1)[:, :, None])
    i, j = (a.ravel() for a in np.meshgrid(np.arange(parts), np.arange(parts)))
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    if cell == basix.CellType.quadrilateral:
        return np.asarray((np.stack([i, j], axis=1)[:, None, :] + steps) / parts)
    lower, upper = i + j < parts, i + j < parts - 1
    corner = np.stack([i, j], axis=1)[:, None, :]
    up, down = corner[lower] + steps[[0, 1, 3]], corner[upper] + steps[[1, 2, 3]]
    return np.asarray(np.concatenate([up, down]) / parts)


def polygons(facets: FacetMap) -> Polygons:
    """The polygons of a face; those of a straight facet are the facet."""
    own = _reference_polygons(facets.facet_cell, facets.order)
    k, v, fdim = own.shape
    n = len(facets)
    parent = np.repeat(np.arange(n), k)
    reference = np.tile(own, (n, 1, 1))
    corners, _ = facets.push_forward(np.repeat(parent, v), reference.reshape(-1, fdim))
    _, normals, _ = facets.surface(parent, reference.mean(axis=1))
    return Polygons(
        corners.reshape(n * k, v, facets.dim), reference, parent, facets.order, normals
    )


def _plane_normals(p: Polygons) -> Array:
    """(k, d), unit normals of the planes that flatten projects onto."""
    if p.corners.shape[2] == 2:
        along = p.corners[:, 1] - p.corners[:, 0]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    else:
        arms = p.corners - p.corners.mean(axis=1, keepdims=True)
        normal = np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1)
    return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def _plane_areas(own: Polygons, facets: int) -> Array:
    """(facets,): area of the polygons of every facet, each in its own plane."""
    v, fdim = own.corners.shape[1], own.corners.shape[2] - 1
    flat, _ = flatten(own.corners, own.corners)
    fan = [flat[:, [0, *range(k, k + fdim)]] for k in range(1, v - fdim + 1)]
    out = np.zeros(facets)
    np.add.at(out, own.parent, sum(measure(f) for f in fan))
    return out


def _shape(sigma: Array, corners: int) -> tuple[Array, Array]:
    """Vertex functions (p, v) and their derivatives (p, v, fdim) at points of a unit polygon."""
    a = sigma[:, 0]
    one, zero = np.ones_like(a), np.zeros_like(a)
    if corners == 2:
        return np.stack([1 - a, a], axis=1), np.stack([-one, one], axis=1)[:, :, None]
    b = sigma[:, 1]
    if corners == 3:
        values = np.stack([1 - a - b, a, b], axis=1)
        gradient = [np.stack([-one, one, zero], axis=1), np.stack([-one, zero, one], axis=1)]
    else:
        values = np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=1)
        gradient = [
            np.stack([b - 1, 1 - b, b, -b], axis=1),
            np.stack([a - 1, -a, a, 1 - a], axis=1),
        ]
    return values, np.stack(gradient, axis=2)


def _invert(flat: Array, y: Array) -> Array:
    """(p, fdim): coordinates of y (p, fdim) in the unit polygons of flat polygons (p, v, fdim)."""
    p, v, fdim = flat.shape
    if fdim == 1:
        return np.asarray((y - flat[:, 0]) / (flat[:, 1] - flat[:, 0]))
    sigma: Array = np.full((p, fdim), 1 / 3 if v == 3 else 0.5)
    for _ in range(2 if v == 3 else 20):
        values, gradient = _shape(sigma, v)
        r = y - np.einsum("pv,pvi->pi", values, flat)
        a, b = (np.einsum("pv,pvi->pi", gradient[:, :, k], flat) for k in range(2))
        det = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        step = np.stack(
            [r[:, 0] * b[:, 1] - r[:, 1] * b[:, 0], a[:, 0] * r[:, 1] - a[:, 1] * r[:, 0]], axis=1
        )
        step /= det[:, None]
        sigma = np.clip(sigma + step, -0.5, 1.5)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return sigma


def _stretch(gradient: Array, corners: Array) -> Array:
    """(p,): area per area of the unit polygon, of polygons (p, v, any dimension)."""
    tangents = np.einsum("pvk,pvi->pki", gradient, corners)
    gram = np.einsum("pki,pli->pkl", tangents, tangents)
    if gram.shape[1] == 1:
        return np.asarray(np.sqrt(gram[:, 0, 0]))
    # Lagrange's identity loses thin facets: orthogonalise first
    a, b = tangents[:, 0], tangents[:, 1]
    b = b - (gram[:, 0, 1] / gram[:, 0, 0])[:, None] * a
    return np.asarray(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))


def _piece_degree(facets: FacetMap, degree: int) -> int:
    """Degree on pieces, in plane coordinates, for shape functions of a degree on a face."""
    c = polygons(facets).corners
    square = facets.facet_cell == basix.CellType.quadrilateral
    if facets.order > 1:
        return 2 * degree + _CURVED
    size = np.ptp(c, axis=1).max(axis=1)
    if not square:
        return degree
    # the inverse of a bilinear map is analytic in a region that grows like 1 / twist
    twist = float((np.abs(c[:, 0] - c[:, 1] + c[:, 2] - c[:, 3]).max(axis=1) / size).max())
    if twist < 1e-13:
        return 2 * degree
    gain = np.log10(max(_REGION / twist, 1.5))
    return 2 * degree + min(int(np.ceil(_DIGITS / gain)), _MOST)


def _pairs(p1: Polygons, p2: Polygons, reach1: Array, reach2: Array) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of polygons whose bounding boxes are within reach and whose normals oppose.

    The second polygons are sorted into trees by size, so that one large facet does not make every
    search wide.
    """
    c1, c2 = p1.corners.mean(axis=1), p2.corners.mean(axis=1)
    r1 = np.linalg.norm(p1.corners - c1[:, None], axis=2).max(axis=1)
    r2 = np.linalg.norm(p2.corners - c2[:, None], axis=2).max(axis=1)
    low1, high1 = p1.corners.min(axis=1), p1.corners.max(axis=1)
    low2, high2 = p2.corners.min(axis=1), p2.corners.max(axis=1)
    octave = np.floor(np.log2(r2)).astype(np.int64)
    for level in np.unique(octave):
        members = np.flatnonzero(octave == level)
        tree = cKDTree(c2[members])
        widest = r2[members].max() + np.maximum(reach1, reach2[members].max()) + r1
        for chunk in np.array_split(np.arange(len(c1)), 1 + len(c1) // 20_000):
            found = tree.query_ball_point(c1[chunk], widest[chunk], return_sorted=False)
            count = np.array([len(f) for f in found])
            if not count.any():
                continue
            a = np.repeat(chunk, count)
            b = members[np.concatenate([np.asarray(f, dtype=np.int64) for f in found if f])]
            reach = np.maximum(reach1[a], reach2[b])
            apart = np.maximum(low1[a] - high2[b], low2[b] - high1[a]).max(axis=1)
            facing = np.einsum("ki,ki->k", p1.normals[a], p2.normals[b]) < OPPOSED
            good = (apart <= reach) & facing
            yield a[good], b[good]


class _Pieces(NamedTuple):
    """Quadrature points of the intersections: on facet1 at s1, x1, and on facet2 at s2, x2."""

    facet1: Ints
    s1: Array
    x1: Array
    weights: Array
    facet2: Ints
    s2: Array
    x2: Array

    def some(self, chosen: Flags) -> _Pieces:
        """The chosen points only."""
        return _Pieces._make(each[chosen] for each in self)


def _intersect(
    first: FacetMap, second: FacetMap, degree: int, limit: float
) -> tuple[_Pieces, Array, sp.csr_matrix, float]:
    """Pieces, plane area of the facets of side 1 (n1,), of the intersections (n1, n2), and the
    largest distance of pieces that were too far apart to count."""
    p1, p2 = polygons(first), polygons(second)
    sizes1, sizes2 = first.sizes[p1.parent], second.sizes[p2.parent]
    fdim = first.dim - 1
    whole = _plane_areas(p1, len(first))
    normals1 = _plane_normals(p1)

    collected: list[_Pieces] = []
    entries: list[tuple[Ints, Ints, Array]] = []
    farthest = 0.0
    for a, b in _pairs(p1, p2, limit * sizes1, limit * sizes2):
        for part in np.array_split(np.arange(len(a)), 1 + len(a) // 2_000):
            if not part.size:
                continue
            i, j = a[part], b[part]
            window, subject = flatten(p1.corners[i], p2.corners[j])
            pair, simplices = simplices_of(window, subject)
            area = measure(simplices)
            solid = area > 1e-15 * whole[p1.parent[i[pair]]]
            pair, simplices, area = pair[solid], simplices[solid], area[solid]
            if not pair.size:
                continue
            y, w = rule_on(simplices, degree)
            q = y.shape[1]
            at = np.repeat(pair, q)
            y = y.reshape(-1, fdim)
            f1, f2 = p1.parent[i[at]], p2.parent[j[at]]
            s1, x1, scale = _on_first(first, p1, i[at], window[at], y)
            if second.order == 1:
                values, _ = _shape(_invert(subject[at], y), subject.shape[1])
                s2 = np.einsum("pv,pvi->pi", values, p2.reference[j[at]])
                x2 = np.einsum("pv,pvi->pi", values, p2.corners[j[at]])
            else:
                s2, x2, _ = second.closest(f2, x1, normals1[i[at]])
            distance = np.linalg.norm(x2 - x1, axis=1)
            far = distance > limit * np.maximum(first.sizes[f1], second.sizes[f2])
            out = np.zeros(len(i), dtype=bool)
            out[at[far]] = True
            if far.any():
                farthest = max(farthest, float(distance[far].max()))
            weight = w.ravel() * scale
            keep, solid = ~out[at], ~out[pair]
            collected.append(
                _Pieces(f1, s1, x1, weight, f2, s2, x2).some(keep)
            )
            entries.append(
                (p1.parent[i[pair]][solid], p2.parent[j[pair]][solid], area[solid])
            )
    shape = (len(first), len(second))
    if not collected:
        none = np.zeros(0, dtype=np.int64)
        s, x = np.zeros((0, fdim)), np.zeros((0, first.dim))
        nothing = _Pieces(none, s, x, np.zeros(0), none, s, x)
        return nothing, whole, sp.csr_matrix(shape), farthest
    pieces = _Pieces._make(np.concatenate(each) for each in zip(*collected, strict=True))
    row, column, value = (np.concatenate(e) for e in zip(*entries, strict=True))
    return pieces, whole, sp.csr_matrix((value, (row, column)), shape=shape), farthest


def _on_first(
    first: FacetMap, of_first: Polygons, which: Ints, window: Array, y: Array
) -> tuple[Array, Array, Array]:
    """Places s1 on the facets of side 1 and x1 in space of points y in the planes of polygons, and their
    areas relative to those in the planes."""
    fdim = first.dim - 1
    values, gradient = _shape(_invert(window, y), of_first.corners.shape[1])
    s1 = np.einsum("pv,pvi->pi", values, of_first.reference[which])
    scale = 1.0 / _stretch(gradient, window)
    if first.order == 1:  # the polygon is the facet, unless it is warped
        corners = of_first.corners[which]
        x1 = np.einsum("pv,pvi->pi", values, corners)
        return s1, x1, scale * _stretch(gradient, corners)
    x1, _, jacobian = first.surface(of_first.parent[which], s1)
    return s1, x1, scale * jacobian / of_first.parts**fdim


def _check_cover(
    where: str,
    names: tuple[str, str],
    share: Array,
    areas: Array,
    overlap: Overlap,
    farthest: float,
    size: float,
    apart: float,
) -> None:
    """Raise unless side 2 covers side 1 once; `apart`: smallest distance of their nodes."""
    uncovered = float(areas @ np.clip(1.0 - share, 0.0, 1.0) / areas.sum())
    reason = f"largest distance {farthest:.4g}, facet size {size:.4g}" if farthest else ""
    if share.max(initial=0.0) > 1.0 + UNCOVERED:
        raise SceneError(
            f"{where}: {names[1]} covers {np.count_nonzero(share > 1.0 + UNCOVERED)} facets of "
            f"{names[0]} more than once (up to {share.max():.3g} times): it is folded or finely "
            "curved there; refine, split the face, or lower max_distance"
        )
    if uncovered > 1.0 - 1e-6:
        raise SceneError(
            f"{where}: the facets do not face each other: no facet of {names[0]} overlaps one of "
            f"{names[1]} ({reason or f'the faces are {apart:.4g} apart, facet size {size:.4g}'}); check the "
            "faces and the positions of the parts, or raise max_distance"
        )
    if overlap == "full" and uncovered > UNCOVERED:
        raise SceneError(
            f"{where}: {100 * uncovered:.3g} % of the area of {names[0]} is not covered by "
            f"{names[1]} ({np.count_nonzero(share < 1.0 - _WHOLE)} of {len(share)} facets"
            f"{f'; {reason}' if reason else ''}); give the smaller face first, raise "
            'max_distance, or let them overlap partly with overlap="partial"'
        )


def means(rows: Ints, weights: Array, n: int) -> sp.csr_matrix:
    """(n, points): weighted mean of the points of each row (points,); rows without points are 0."""
    total = np.bincount(rows, weights, minlength=n)
    order = np.argsort(rows, kind="stable")
    pointer = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return sp.csr_matrix(
        (weights[order] / total[rows[order]], order, pointer), shape=(n, len(rows))
    )


def average(
    first: FacetMap,
    second: FacetMap | None,
    spaces: tuple[Any, ...],
    where: str,
    names: tuple[str, ...],
    limit: float,
    overlap: Overlap = "full",
    quadrature_degree: int | None = None,
) -> Averages:
    """Averages of the shape functions of both sides over the facets of side 1.

    Parameters
    ----------
    first, second
        Facets of the sides; None: one side.
    spaces
        Lagrange space of each side.
    where, names
        The interface and its sides, for messages.
    limit
        Largest distance of the sides, as a fraction of the facet size.
    overlap
        ``"full"``: side 2 covers side 1 up to 1 % of its area (the chords of round rims differ).
        ``"partial"``: facets without any partner are left out.  A facet that is covered in part
        counts with this part in either case.
    quadrature_degree
        Degree on facets and pieces; None: exact for straight simplices and parallelograms, to
        rounding for other quadrilaterals.

    Raises
    ------
    SceneError
        Facets without area, faces that do not overlap, or cover each other partly or twice.
    """
    highest = max(s.element.basix_element.degree for s in spaces)
    rule = _rule(first, quadrature_degree or 2 * highest + first.order - 1, where, names[0])
    areas = first.areas(rule.weights, rule.facet, where, names[0])
    columns = [v.dofmap.index_map.size_local for v in spaces]
    if second is None:
        return _of_one_side(first, spaces[0], rule, areas, columns[0])

    degrees = [
        _piece_degree(side, v.element.basix_element.degree)
        for side, v in zip((first, second), spaces, strict=True)
    ]
    cut = max(degrees) if quadrature_degree is None else quadrature_degree
    pieces, whole, common, farthest = _intersect(first, second, cut, limit)
    covered = np.asarray(common.sum(axis=1)).ravel() / whole
    size = float(max(first.sizes.max(), second.sizes.max()))
    d = first.dim
    nearest, _ = cKDTree(second.samples.reshape(-1, d)).query(first.samples.reshape(-1, d))
    apart = float(nearest.min())
    _check_cover(where, (names[0], names[1]), covered, areas, overlap, farthest, size, apart)
    pieces = _joined(rule, second, pieces, whole, common)

    kept = np.flatnonzero(covered > 1e-8)
    row = np.full(len(first), -1)
    row[kept] = np.arange(len(kept))
    pieces = pieces.some(row[pieces.facet1] >= 0)
    mean = means(row[pieces.facet1], pieces.weights, len(kept))
    shape2 = (mean @ second.trace(spaces[1], pieces.facet2, pieces.s2, columns[1])).tocsr()
    # side 1: the rule of the facet where it is covered, the pieces where it is in part
    complete = covered > 1.0 - _WHOLE
    full, rest = complete[rule.facet], ~complete[pieces.facet1]
    f = np.concatenate([rule.facet[full], pieces.facet1[rest]])
    at = np.concatenate([rule.s[full], pieces.s1[rest]])
    weights1 = np.concatenate([rule.weights[full], pieces.weights[rest]])
    mean1 = means(row[f], weights1, len(kept))
    shape1 = (mean1 @ first.trace(spaces[0], f, at, columns[0])).tocsr()
    x_own, normal_own, _ = first.surface(f, at)
    normal = mean1 @ normal_own
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    area: Array = np.bincount(row[f], weights1, minlength=len(kept)).astype(np.float64)
    gap = np.einsum("pi,pi->p", mean @ (pieces.x2 - pieces.x1), normal)
    return Averages(
        kept,
        mean1 @ x_own,
        normal,
        area,
        (shape1, shape2),
        gap,
        float(min(area.sum() / areas.sum(), 1.0)),
    )


class _Rule(NamedTuple):
    """Quadrature on the facets of side 1: facet, place in it, weight, place in space, and normal."""

    facet: Ints
    s: Array
    weights: Array
    x: Array
    normals: Array


def _rule(first: FacetMap, degree: int, where: str, name: str) -> _Rule:
    """Quadrature of this degree on the facets of side 1."""
    index, s, w = first.quadrature(degree)
    x, normals, scale = first.surface(index, s)
    w = w * scale
    if not np.all(np.isfinite(w)) or w.min() <= 0.0:
        raise SceneError(f"{where}: facets of {name} have no area; fix the mesh")
    return _Rule(index, s, w, x, normals)


def _of_one_side(first: FacetMap, space: Any, rule: _Rule, areas: Array, columns: int) -> Averages:
    """Averages over the facets of an interface with one side."""
    n = len(first)
    mean = means(rule.facet, rule.weights, n)
    shape = mean @ first.trace(space, rule.facet, rule.s, columns)
    normal = mean @ rule.normals
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Averages(np.arange(n), mean @ rule.x, normal, areas, (shape.tocsr(),), np.zeros(n), 1.0)


def _joined(
    rule: _Rule, second: FacetMap, pieces: _Pieces, whole: Array, common: sp.csr_matrix
) -> _Pieces:
    """Points common to both sides: those of whole facets of side 1 where they can be, else of pieces.

    Facets within one facet of side 2 (all of them if the meshes match) need no pieces: the rule of the facet
    itself serves both sides, so that equal facets have equal rows.
    """
    largest = np.asarray(common.max(axis=1).todense()).ravel()
    host = np.asarray(common.argmax(axis=1)).ravel().astype(np.int64)
    within = largest > (1.0 - _WHOLE) * whole
    if second.order == 1 and second.facet_cell == basix.CellType.quadrilateral:
        # a part of a quadrilateral that is no parallelogram sees no polynomials: it takes the pieces' rule
        within &= np.abs(_plane_areas(polygons(second), len(second))[host] / whole - 1.0) < 1e-6
    own = within[rule.facet]
    facet1, x1 = rule.facet[own], rule.x[own]
    s2, x2, _ = second.closest(host[facet1], x1, rule.normals[own])
    whole_facets = _Pieces(facet1, rule.s[own], x1, rule.weights[own], host[facet1], s2, x2)
    cut = pieces.some(~within[pieces.facet1])
    return _Pieces._make(np.concatenate(pair) for pair in zip(whole_facets, cut, strict=True))
