"""Interface points, mass-free trace operators, and the geometric pairing of two sides.

Points are the quadrature points of the facets of side 1, pushed forward through the coordinate map
(straight or curved).  Side 2 is sampled at the closest points of its own facets, found with a
nearest neighbour search and Gauss-Newton inversion of the facet map.  Matching meshes are a special
case and not another path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import basix
import numpy as np
from latin_core import mortar as kernel

from dolfinx_frontend.assembly.averages import average
from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.facet_map import FaceCopy, FacetMap
from dolfinx_frontend.assembly.held_nodes import ANYWAY, Held
from dolfinx_frontend.assembly.interface import Interface, Side, Vertices, frames
from dolfinx_frontend.assembly.mortar import multipliers, vertex_nodes
from dolfinx_frontend.assembly.overlap import (
    OPPOSED,
    check_cover,
    common,
    constant,
    filled,
    hats,
    of_one_side,
    shape_of,
)
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp, spatial
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.vectors import unit, unit_rows
from dolfinx_frontend.scene.laws import Elimination, Law
from dolfinx_frontend.scene.specs import Overlap, PartLike, Space

__all__ = ["coincide", "make_interface", "near_facets"]


MAX_DISTANCE = 0.25
"""Default of the largest distance between the sides, as a fraction of the facet size."""

_STRAIGHT = 1e-9
"""Edges whose middle is beside a straight one by less, relative to their length, are straight."""

_OFF_THE_MIDDLE = 0.05
"""Distance of the middle of curved edges from where it should be, relative to the edge, that is told.

Measured (rings, pressures, relative): 0.01 to 0.03 with 0.05, 0.07 to 0.18 with 0.15, on coarse meshes;
edges that are curved in a plane face: 1e-4 and 3e-3."""

ROUNDING = 32.0 * float(np.finfo(np.float64).eps)
"""Distances below this, relative to the coordinates, are none."""

FAR = 0.05
"""The same as a fraction of the extent of the smaller face, which refinement does not change."""

_ALIKE = 1e-6
"""Areas, and places relative to sizes of facets, that differ by less are the same: what turning leaves."""


def _side(
    label: str,
    face: str,
    space: Any,
    facets: FacetMap,
    shape: sp.csr_matrix,
    degree: int,
    along: tuple[sp.csr_matrix, Array] | None = None,
) -> Side:
    """A side with its trace.

    `degree`: of the rule for its area and normals; `along`: the trace along the normals of the places, and
    the normals of the points.
    """
    s, w = facets.rule(degree)
    normals, area = facets.alike_surface(s)
    weights = w * area
    nodes, node_normals = _nodal_normals(facets, space, s, weights, normals)
    total = float(weights.sum())
    mean = np.einsum("fq,fqi->i", weights, normals) / total
    flatness = float(np.linalg.norm(normals - mean, axis=2).max())
    length = np.linalg.norm(mean)
    return Side(
        substructure=label,
        face=face,
        trace=petsc_matrix(_trace(shape, facets.dim, along)),
        shape=shape,
        nodes=nodes,
        node_normals=node_normals,
        flatness=flatness,
        normal=unit(mean) if length > 1e-9 else np.zeros(facets.dim),
        area=total,
    )


def _nodal_normals(
    facets: FacetMap, space: Any, s: Array, weights: Array, normals: Array
) -> tuple[Ints, Array]:
    """The nodes on a face, sorted, and area-weighted unit normals there, from those at a rule's points s."""
    nodes, at = np.unique(facets.closure_dofs(space), return_inverse=True)
    # |N|: quadratic vertex functions have zero mean on triangles
    share = np.abs(facets.alike_shapes(space, s))
    parts = np.swapaxes(share, 1, 2) @ (weights[:, :, None] * normals)
    flat = parts.reshape(-1, facets.dim)
    several = [np.bincount(at.ravel(), flat[:, k]) for k in range(facets.dim)]
    total = np.stack(several, axis=1).astype(np.float64)
    return nodes, unit_rows(total)


def _repeated(shape: sp.csr_matrix, d: int) -> sp.csr_matrix:
    """(d * m, d * nodes): the same for every component; sp.kron, without its detours."""
    start = shape.indptr[:-1].astype(np.int64)
    count = np.diff(shape.indptr)
    indptr = np.concatenate([[0], np.cumsum(np.repeat(count, d))])
    entry = np.arange(indptr[-1]) + np.repeat(np.repeat(start, d) - indptr[:-1], np.repeat(count, d))
    component = np.repeat(np.tile(np.arange(d), len(start)), np.repeat(count, d))
    return sp.csr_matrix(
        (shape.data[entry], d * shape.indices[entry] + component, indptr),
        shape=(d * shape.shape[0], d * shape.shape[1]),
    )


def _trace(shape: sp.csr_matrix, d: int, along: tuple[sp.csr_matrix, Array] | None) -> sp.csr_matrix:
    """(d * m, d * nodes): the trace in global components."""
    alike = _repeated(shape, d)
    if along is None:
        return alike
    m = shape.shape[0]
    starts = np.arange(0, d * m + 1, d)
    normals = sp.csr_matrix((along[1].ravel(), np.arange(d * m), starts), shape=(m, d * m))
    more = (along[0] - normals @ alike).tocsr()
    more.data[np.abs(more.data) < 1e-14] = 0.0  # plane faces: there is none
    more.eliminate_zeros()
    return (alike + normals.T @ more).tocsr() if more.nnz else alike


def _nearest(facets: FacetMap, points: Array) -> Ints:
    """(points, k): owners of the nearest sample points, ascending."""
    n, k, d = facets.samples.shape
    tree = spatial.cKDTree(facets.samples.reshape(n * k, d))
    near = min(12, n * k)
    _, found = tree.query(points, k=near)
    return np.sort(found.reshape(len(points), near) // k, axis=1)


def _likeliest(owner: Ints) -> Ints:
    """(points,): of ascending rows the number that is there most often."""
    best, most = owner[:, 0].copy(), np.ones(len(owner), dtype=np.int64)
    run = most.copy()
    for k in range(1, owner.shape[1]):
        run[:] = np.where(owner[:, k] == owner[:, k - 1], run + 1, 1)
        better = run > most
        best[better], most[better] = owner[better, k], run[better]
    return best


def _distinct(owner: Ints) -> tuple[Ints, Ints]:
    """Pairs (row, number) of ascending rows."""
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

    def consider(who: Ints, which: Ints, within: float) -> None:
        """Take the nearest of facets `which` for points `who`; `within` of the size of a facet is enough."""
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
        near = distance[chosen] < within * facets.sizes[which[chosen]]
        settled[target] = near & (outside[chosen] < 1e-8) & ~away[chosen]

    owner = _nearest(facets, points)
    consider(np.arange(m), _likeliest(owner), 1e-9)  # matching meshes: no facet can be nearer
    rest = np.flatnonzero(~settled)
    best[rest] = np.inf
    who, which = _distinct(owner[rest])
    consider(rest[who], which, 0.1)
    rest = np.flatnonzero(~settled)
    if rest.size:
        who, which = _box_candidates(facets, points[rest], best[rest])
        for part in np.array_split(np.arange(len(who)), 1 + len(who) // 200_000):
            consider(rest[who[part]], which[part], 0.1)
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
            f"{where}: the facets do not face each other at {np.count_nonzero(bad)} of {len(points)} points "
            f"of {names[0]} ({100 * share:.3g} % of its area has no partner on {names[1]}; {reason}); give "
            "the smaller face first, split the larger one, or raise max_distance"
        )
    along = np.einsum("pi,pi->p", offset, n2)[:, None] * n2
    beside = np.linalg.norm(offset - along, axis=1) > 0.02 * sizes
    if weights[beside].sum() > 0.01 * total:
        warn(
            f"{where}: {100 * weights[beside].sum() / total:.3g} % of {names[0]} lies beside "
            f"{names[1]}; it is joined to the edge of it",
            SceneWarning,
        )


def _sag(faces: Sequence[FacetMap], points: Array) -> tuple[Array, Array]:
    """(m,) each, length: the larger sag of both sides at the interface points, with a fifth for safety, and
    that of straight facets of round faces."""
    sag, chords = np.zeros(len(points)), np.zeros(len(points))
    for facets in faces:
        if not facets.sags.any():
            continue
        _, nearest = spatial.cKDTree(facets.samples.mean(axis=1)).query(points)
        sag = np.maximum(sag, 1.2 * facets.sags[nearest])
        chords = np.maximum(chords, 1.2 * facets.chords[nearest])
    return sag, chords


_SAME_AREA = 1e-4
"""Relative difference of the areas of two meshes of one face with curved facets, at most."""

_SOME = 100
"""Facets whose vertices are looked at, of each side."""

_TELLING = 0.05
"""Distance of vertices, relative to the sag, that is one: others are those of two meshes of one face."""


_PLACED = 1e-7
"""How exactly vertices are on faces from CAD, relative to the size of these."""


def _apart(pair: _Pair) -> float:
    """How far curved faces are apart, length (below 0: inside each other), that are so within their sag.

    Vertices are on the faces for which facets stand, and facets are beside these, on one side. Of two meshes
    of one face, therefore, the vertices of each see the facets of the other one in opposite directions:
    where most see them in the same one, the faces are apart. 0: they are not, or too little to be told.
    """
    corners = np.asarray(basix.geometry(pair.faces[0].facet_cell))
    points, gaps = [], []
    for one, other in zip(pair.faces, pair.faces[::-1], strict=True):
        some = slice(None, None, 1 + len(one) // _SOME)
        fields = one.alike(corners), one.alike_surface(corners)[0]
        x, normals = (v[some].reshape(-1, pair.dim) for v in fields)
        _, _, foot, n = _project(other, x, normals)
        off = x - foot
        along = np.einsum("pi,pi->p", off, n)
        beside = np.linalg.norm(off - along[:, None] * n, axis=1)
        over = beside < 1e-3 * one.sizes.min()
        points.append(x[over])
        gaps.append(along[over])
    if not len(points[0]) or not len(points[1]):
        return 0.0
    _, near = spatial.cKDTree(points[1]).query(points[0])
    both = np.stack([gaps[0], gaps[1][near]])
    least = np.abs(both).min(axis=0)
    size = float(np.sqrt(min(area.sum() for area in pair.areas)))
    sag = max(float(np.median(face.sags)) for face in pair.faces)
    tell = (both[0] * both[1] > 0.0) & (least > max(_TELLING * sag, _PLACED * size))
    side = np.where(tell, np.sign(both[0]), 0.0)
    if abs(side.mean()) <= 0.5:
        return 0.0
    return float(np.median(both.mean(axis=0)[side * side.sum() > 0.0]))


def _match(size: float, sides: tuple[Side, Side], coordinates: tuple[Array, Array]) -> Ints | None:
    """Pairs of nodes at the same place, if there the traces agree too."""
    first, second = sides
    if len(first.nodes) != len(second.nodes):
        return None
    x1, x2 = coordinates[0][first.nodes], coordinates[1][second.nodes]
    distance, partner = spatial.cKDTree(x2).query(x1)
    if distance.max() > _ALIKE * size or len(np.unique(partner)) < len(partner):
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
    areas: sp.csr_matrix
    vertices: Vertices | None = None
    along: tuple[sp.csr_matrix, ...] = ()
    bulge: Array | float = 0.0
    covered: float = 1.0


def _without_rounding(gap: Array, faces: Sequence[FacetMap]) -> Array:
    """Distances that are more than rounding of the coordinates: faces that meet have none."""
    far = max(float(np.abs(face.nodes).max(initial=0.0)) for face in faces)
    return np.where(np.abs(gap) <= ROUNDING * far, 0.0, gap)


@dataclass(frozen=True)
class _Pair:
    """The faces of an interface, and how they are to be joined."""

    where: str
    names: tuple[str, ...]
    faces: tuple[FacetMap, ...]
    spaces: tuple[Any, ...]
    law: Law
    held: tuple[Held | None, ...]
    near: tuple[Array, ...]
    areas: tuple[Array, ...]
    degree: int | None
    overlap: Overlap
    centres: Sequence[Array] = ()

    @property
    def dim(self) -> int:
        return self.faces[0].dim

    def swapped(self) -> _Pair:
        """The same seen from side 2."""
        both = {k: getattr(self, k)[::-1] for k in ("names", "faces", "spaces", "held", "near", "areas")}
        return replace(self, **both)


def _rule_degree(pair: _Pair) -> int:
    """Of the quadrature points of side 1: the mass matrix of a straight simplex is exact."""
    if pair.degree is not None:
        return pair.degree
    highest = max(int(s.element.basix_element.degree) for s in pair.spaces)
    return 2 * highest + pair.faces[0].order - 1


def _sample_points(pair: _Pair, limit: float) -> _Samples:
    """The space ``points``: quadrature points of side 1 and their closest points on side 2."""
    first, spaces = pair.faces[0], pair.spaces
    rule, w = first.rule(_rule_degree(pair))
    index = np.repeat(np.arange(len(first)), len(w))
    points = first.alike(rule).reshape(len(index), -1)
    outward, area = first.alike_surface(rule)
    first.areas(w * area, pair.where, pair.names[0])
    normals, weights = outward.reshape(points.shape), (w * area).ravel()
    columns = [v.dofmap.index_map.size_local for v in spaces]
    shapes = [first.alike_trace(spaces[0], rule, columns[0])]
    gap = np.zeros(len(points))
    if len(pair.faces) == 2:
        second = pair.faces[1]
        index2, s2, x2, n2 = _project(second, points, normals)
        sizes = np.maximum(first.sizes[index], second.sizes[index2])
        names = (pair.names[0], pair.names[1])
        _check_pairing(pair.where, names, points, normals, weights, sizes, x2, n2, limit)
        gap = np.einsum("pi,pi->p", x2 - points, normals)
        shapes.append(second.trace(spaces[1], index2, s2, columns[1]))
    facets = np.arange(len(first))
    areas = sp.csr_matrix((weights, (index, np.arange(len(index)))), shape=(len(first), len(index)))
    return _Samples(points, normals, weights, tuple(shapes), gap, facets, areas)


def _integrals(pair: _Pair, linear: bool) -> kernel.Overlap:
    """Of the functions of the vertices of side 1, or of the function 1, over what is common."""
    cell = shape_of(pair.faces[0])
    chi = hats(cell) if linear else constant(cell)
    if len(pair.faces) == 1:
        return of_one_side(pair.faces[0], pair.spaces[0], chi, pair.degree)
    return common(_two(pair.faces), _two(pair.spaces), chi, _two(pair.near), pair.degree)


def _two(both: tuple[Any, ...]) -> tuple[Any, Any]:
    return both[0], both[1]


def _check_cover(pair: _Pair, found: kernel.Overlap | None = None) -> float:
    """The fraction of side 1 that side 2 covers; raises unless it covers it as it should."""
    if len(pair.faces) == 2:
        if found is None:
            one = constant(shape_of(pair.faces[0]))
            found = common(_two(pair.faces), _two(pair.spaces), one, _two(pair.near), 1)
        return check_cover(pair.where, _two(pair.names), _two(pair.faces), found, pair.overlap)
    return 1.0


def _sample_facets(pair: _Pair) -> _Samples:
    """The space ``facets``: means over those of side 1."""
    found = _integrals(pair, False)
    covered = _check_cover(pair, found)
    if pair.overlap == "full":
        found, covered = _filled(found)
    means = average(pair.faces[0], pair.faces[1] if len(pair.faces) == 2 else None, pair.spaces, found)
    gap = np.einsum("pi,pi->p", means.offset, means.normals)
    areas = sp.diags(means.weights, format="csr")
    return _Samples(
        means.points, means.normals, means.weights, means.shapes, gap, means.facets, areas, covered=covered
    )


def _sample_vertices(pair: _Pair, carrier: int) -> _Samples:
    """The space ``mortar``: multipliers at the vertices of the carrying side."""
    seen = pair.swapped() if carrier == 1 else pair
    found = _integrals(seen, True)
    covered = _check_cover(pair, found if carrier == 0 else None)
    if pair.overlap == "full" and (carrier == 0 or _alike(pair.areas)):
        found, covered = _filled(found)
    other = seen.faces[1] if len(seen.faces) == 2 else None
    m = multipliers(seen.faces[0], other, seen.spaces, found, pair.law, seen.held[0])
    normals, shapes, along = m.normals, m.shapes, m.along
    if carrier == 1:
        normals, shapes, along = -normals, shapes[::-1], tuple(-each for each in along[::-1])
    vertices = Vertices(m.corners, m.nodal)
    return _Samples(
        m.points, normals, m.weights, shapes, m.gap, m.facets, m.areas, vertices, along, m.bulge, covered
    )


def _filled(found: kernel.Overlap) -> tuple[kernel.Overlap, float]:
    """The integrals without slivers along rims, and the fraction that is covered then."""
    found = filled(found)
    return found, float(np.minimum(found.covered, found.whole).sum() / found.whole.sum())


def _alike(areas: tuple[Array, ...]) -> bool:
    """Whether two faces are equally large but for the curves of their rims; a little larger is not."""
    first, second = (float(each.sum()) for each in areas)
    return abs(second - first) < _SAME_AREA * first


def near_facets(faces: Sequence[FacetMap], max_distance: float | None) -> tuple[Array, ...]:
    """Largest distance of the other side from every facet, length."""
    if max_distance is not None:
        return tuple(np.full(len(face), max_distance * face.sizes.max()) for face in faces)
    extent = min(float(np.linalg.norm(np.ptp(f.samples.reshape(-1, f.dim), axis=0))) for f in faces)
    return tuple(np.maximum(MAX_DISTANCE * face.sizes, FAR * extent) for face in faces)


def _carrier(pair: _Pair) -> tuple[int, str]:
    """The side that carries the multipliers of a mortar interface, and why; whichever is given first."""
    if len(pair.faces) == 1:
        return 0, f"at the vertices of {pair.names[0]}"
    twice, free = [], []
    for face, space, held in zip(pair.faces, pair.spaces, pair.held, strict=True):
        nodes = np.unique(vertex_nodes(face, space))
        twice.append(0.0)
        free.append(True)
        if held is not None:
            both = np.isin(held.nodes, nodes) & (held.least >= ANYWAY)
            whole = np.linalg.matrix_rank(held.directions[both]) == pair.dim
            free[-1] = bool(whole.sum() < len(nodes))
            twice[-1] = float((np.trace(held.directions[both], axis1=1, axis2=2) > 0.5).sum() / len(nodes))
    if free[0] != free[1]:
        side = 0 if free[0] else 1
        return side, f"at the vertices of {pair.names[side]}: the other side is held altogether"
    sizes = []
    for face, other, area in zip(pair.faces, pair.faces[::-1], pair.areas, strict=True):
        x = other.samples.reshape(-1, pair.dim)
        margin = max(float(near.max()) for near in pair.near)
        middle = face.samples.mean(axis=1)
        close = np.all((middle >= x.min(axis=0) - margin) & (middle <= x.max(axis=0) + margin), axis=1)
        close = close if close.any() else np.ones(len(face), dtype=bool)
        sizes.append(float(area[close].mean() ** (1.0 / (pair.dim - 1))))
    if abs(sizes[0] - sizes[1]) > 0.05 * max(sizes):
        side = int(sizes[1] < sizes[0])
        return side, f"at the vertices of {pair.names[side]}, the finer side"
    if twice[0] != twice[1]:
        side = int(twice[1] < twice[0])
        return side, f"at the vertices of {pair.names[side]}, which less else holds"
    squares = [float(np.sum(area**2)) for area in pair.areas]
    if abs(squares[0] - squares[1]) > _ALIKE * max(squares):
        side = int(squares[1] < squares[0])
        return side, f"at the vertices of {pair.names[side]}, the finer side by little"
    side = _away(pair)
    return side, f"at the vertices of {pair.names[side]}; the sides are alike but for where they are"


def _away(pair: _Pair) -> int:
    """The side that is turned away from the first of the centres of the scene that is not between the sides.

    A face of side 1 has the flux sum a n . (c - x) of a centre c, which is > 0 where that is in front of it.
    Neither the names of parts nor their order enter, nor turning or reflecting the scene. A scene that is
    symmetric in all of its centres is told by its axes.
    """
    face, area = pair.faces[0], pair.areas[0]
    normals, _ = face.alike_surface(face.rule(2 * int(pair.spaces[0].element.basix_element.degree))[0])
    turned = area[:, None] * normals.mean(axis=1)
    middle = face.samples.mean(axis=1)
    for centre in pair.centres:
        flux = float(np.sum(turned * (centre - middle)))
        if abs(flux) > _ALIKE * float(np.sum(np.linalg.norm(turned, axis=1) * face.sizes)):
            return int(flux < 0.0)
    along = turned.sum(axis=0)
    largest = along[np.abs(along) > _ALIKE * area.sum()]
    return int(len(largest) > 0 and largest[0] < 0.0)


def coincide(faces: Sequence[FacetMap], spaces: Sequence[Any]) -> bool:
    """Whether the nodes of both sides are at the same places."""
    if len(faces) == 1:
        return False
    x = [
        np.asarray(v.tabulate_dof_coordinates())[face.face_nodes(v)]
        for face, v in zip(faces, spaces, strict=True)
    ]
    if len(x[0]) != len(x[1]):
        return False
    size = float(min(face.sizes.min() for face in faces))
    distance, _ = spatial.cKDTree(x[1]).query(x[0])
    return bool(distance.max() <= _ALIKE * size)


def _same_facets(faces: Sequence[FacetMap], spaces: Sequence[Any]) -> bool:
    """Whether faces whose nodes coincide have the same facets and functions, too: not other diagonals."""
    degrees = [v.element.basix_element.degree for v in spaces]
    kinds = {(len(f), f.facet_cell, degree) for f, degree in zip(faces, degrees, strict=True)}
    if len(kinds) > 1:
        return False
    distance, _ = spatial.cKDTree(faces[1].samples.mean(axis=1)).query(faces[0].samples.mean(axis=1))
    return bool(distance.max() <= _ALIKE * min(face.sizes.min() for face in faces))


def make_interface(
    name: str,
    law: Law,
    parts: tuple[PartLike | FaceCopy, ...],
    labels: tuple[tuple[str, str], ...],
    spaces: tuple[Any, ...],
    quadrature_degree: int | None = None,
    max_distance: float | None = None,
    space: Space = "auto",
    overlap: Overlap = "full",
    held: tuple[Held | None, ...] | None = None,
    centres: Sequence[Array] = (),
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
        Largest distance of the sides, as a fraction of the facet size (except for ``"points"`` of the largest
        facet, so that none is lost where a face is refined); None: 1/4 of that, or 1/20 of the extent of the
        smaller face if that is more.
    space
        ``"points"``, ``"facets"`` (:mod:`dolfinx_frontend.assembly.averages`), ``"mortar"``
        (:mod:`dolfinx_frontend.assembly.mortar`), or ``"auto"``: what is right for the meshes and the law.
    overlap
        With ``"facets"`` or ``"mortar"``: whether side 2 covers all of side 1 (``"full"``) or may cover a
        part (``"partial"``).
    held
        By side, what else holds its nodes; None: nothing does.
    centres
        Points (d,) of the scene from which sides are told whose meshes are alike.

    Raises
    ------
    SceneError
        Facets that do not face each other or overlap, faces that are empty or inside a part, a rigid law
        in the space ``"facets"`` that would lock.

    Warns
    -----
    SceneWarning
        Areas that differ by more than 1 %; contact in the space ``"points"`` on meshes that do not match.
    """
    where = f"interface {name!r}"
    names = tuple(":".join(label) for label in labels)
    limit = MAX_DISTANCE if max_distance is None else max_distance
    faces = tuple(FacetMap(p, face, where) for p, (_, face) in zip(parts, labels, strict=True))
    areas, degrees = [], []
    for face, v, each in zip(faces, spaces, names, strict=True):
        degrees.append(2 * int(v.element.basix_element.degree))
        rule, w = face.rule(degrees[-1])
        areas.append(face.areas(w * face.alike_surface(rule)[1], where, each))
    pair = _Pair(
        where, names, faces, spaces, law, held or (None,) * len(faces), near_facets(faces, max_distance),
        tuple(areas), quadrature_degree, overlap, centres,
    )
    two = len(faces) == 2
    alike = coincide(faces, spaces)
    why = ""
    if alike and law.elimination is Elimination.GLUED and _same_facets(faces, spaces):
        # glued nodes and means would be two discretisations of one scene
        space, why = "points", "its meshes match: a perfect connection ties node by node"
    elif space == "auto":
        space, why = _choice(pair, alike)
    carrier = 0
    if two and not alike and space != "points":
        _warn_of_uneven_edges(pair)
    if space == "mortar":
        carrier, reason = _carrier(pair)
        why = f"{why}: {reason}" if why else reason
        sampled = _sample_vertices(pair, carrier)
    elif space == "facets":
        sampled = _sample_facets(pair)
    else:
        sampled = _sample_points(pair, limit)
    local, axis = frames(sampled.normals)
    if space == "points":
        degrees[0] = _rule_degree(pair)
    along: list[tuple[sp.csr_matrix, Array] | None] = [(each, sampled.normals) for each in sampled.along]
    along = along or [None] * len(faces)
    sides = [_side(*labels[0], spaces[0], faces[0], sampled.shapes[0], degrees[0], along[0])]
    matching = None
    if two:
        sides.append(_side(*labels[1], spaces[1], faces[1], sampled.shapes[1], degrees[1], along[1]))
        if overlap == "full":
            _warn_of_areas(where, names, sides)
        if alike:
            coordinates = tuple(v.tabulate_dof_coordinates()[: v.dofmap.index_map.size_local] for v in spaces)
            size = float(min(face.sizes.min() for face in faces))
            matching = _match(size, (sides[0], sides[1]), (coordinates[0], coordinates[1]))
        if matching is None:
            _check_space(pair, space, len(sampled.weights), (sides[0], sides[1]))
    sag, chords = _sag(faces, sampled.points)
    places, mean_normals = None, None
    if space == "mortar":
        x = np.asarray(spaces[carrier].tabulate_dof_coordinates())[:, : faces[0].dim]
        places = np.asarray(sampled.shapes[carrier] @ x[: sampled.shapes[carrier].shape[1]])
        mean_normals = sampled.normals
        if sampled.along:
            d = faces[0].dim
            parts_of = [sampled.along[carrier][:, k::d].sum(axis=1) for k in range(d)]
            mean_normals = np.asarray(np.hstack(parts_of))
    interface = Interface(
        name=name,
        law=law,
        points=sampled.points,
        weights=sampled.weights,
        frames=local,
        gap=_without_rounding(sampled.gap, faces),
        sides=tuple(sides),
        matching=matching,
        tangent_axis=axis,
        space=space,
        sag=np.maximum(sag, sampled.bulge),
        chords=chords,
        why=why,
        carrier=carrier,
        facets=sampled.facets,
        areas=sampled.areas,
        vertices=sampled.vertices,
        covered=sampled.covered,
        places=places,
        mean_normals=mean_normals,
    )
    if two and law.unilateral and interface.fits and interface.gap.any():
        return replace(interface, apart=_apart(pair))
    return interface


def _choice(pair: _Pair, alike: bool) -> tuple[Space, str]:
    """The space that is right for these meshes and this law, and why."""
    if len(pair.faces) == 1:
        if pair.law.unilateral:
            return "mortar", "a law that opens and closes"
        return "points", "one side"
    if not alike or pair.overlap == "partial":
        return "mortar", "its meshes do not match"
    if pair.law.unilateral:
        return "mortar", "a law that opens and closes"
    return "points", "its meshes match"


def _opposite(pair: _Pair, sides: tuple[Side, Side]) -> bool:
    """Whether the meshes match but for a distance between them."""
    x = [np.asarray(v.tabulate_dof_coordinates()) for v in pair.spaces]
    return _match(np.inf, sides, (x[0], x[1])) is not None


def _check_space(pair: _Pair, space: Space, points: int, sides: tuple[Side, Side]) -> None:
    """Refuse what locks, warn of what is wrong, on meshes that do not match.

    Raises
    ------
    SceneError
        More facets than nodes with a law that prescribes jumps.
    """
    law, nodes = pair.law, len(sides[0].nodes)
    if space == "facets" and law.rigid and points >= nodes:
        raise SceneError(
            f"{pair.where}: {points} facets but {nodes} nodes on {pair.names[0]}: a law that prescribes the "
            "jump locks there; use space='mortar', or give the substructures degree=2"
        )
    if space == "points" and law.unilateral and not _opposite(pair, sides):
        warn(
            f"{pair.where}: contact in the space 'points' on meshes that do not match: its pressures are "
            "wrong by tens of percent and do not converge; use space='mortar'",
            SceneWarning,
        )


def _warn_of_uneven_edges(pair: _Pair) -> None:
    """Nodes off the middle of edges that are curved: facets are cut where these nodes are."""
    for face, name in zip(pair.faces, pair.names, strict=True):
        off = float(face.uneven[face.edges_bend > _STRAIGHT].max(initial=0.0))
        if off > _OFF_THE_MIDDLE:
            wrong = 15.0 * off * off if face.plane else 100.0 * off
            warn(
                f"{pair.where}: middle nodes of edges of {name} that are not straight are up to "
                f"{100.0 * off:.2g} % of the edge off its middle: pressures may be wrong by {wrong:.1g} %; "
                "put these nodes in the middle",
                SceneWarning,
            )


def _warn_of_areas(where: str, names: Sequence[str], sides: Sequence[Side]) -> None:
    ratio = sides[1].area / sides[0].area
    if abs(ratio - 1.0) > 0.01:
        warn(
            f"{where}: the areas of {names[0]} ({sides[0].area:.6g}) and {names[1]} "
            f"({sides[1].area:.6g}) differ by more than 1 %; only the first one is joined",
            SceneWarning,
        )
