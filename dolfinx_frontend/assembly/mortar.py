"""The interface space ``mortar``: one value at each vertex of the side that carries the multipliers.

The force per area is f = sum_i f_i psi_i; the law holds for f_i and the jump in the mean that psi_i weighs:

    w_i = int psi_i dA,   w_i jump_i = int psi_i (u_2 - u_1) dA,   T_k = 1/w_i int psi_i N_k dA,

over the part of the carrying side that the other one covers.  sum_i psi_i = 1: a constant pressure goes
through meshes that do not match without an error, and both traces have the same means of a linear field (the
patch test).  With L_i, the linear (bilinear) functions of the vertices,

degree 1
    psi is biorthogonal to L: int psi_i L_j = delta_ij int L_i on every facet, over its covered part
    (Wohlmuth 2000).  f_i is the mean of the pressure with the weight L_i, T_1 is diagonal.
degree 2
    psi_i = L_i.  They contain the linear functions, which biorthogonal ones do not, and pressures are >= 0
    everywhere if the f_i are.  T_1 is not diagonal; no law asks for that, since each sees its own f_i and
    jump_i only.  No change of the quadratic basis is needed for weights > 0.  Where a face of contact ends
    they span the same with forces that act at its end: a part that turns on its corner is pressed there, not
    a third of a facet inside.

Normal jumps are w_i jump_n = int psi_i (u_2 - u_1) . n with the normal n of the place: with a mean one, slip
on a curved face would open gaps of the order h^2, which differ from vertex to vertex and make pressures of
the order h; and forces would act along the wrong lines by h^2.

The weights are int L_i in either case.  Measured (benchmarks/measured/interfaces.md): both pass the patch
test and need as many iterations; forces are the more accurate ones in each case.

Where vertices are held by another interface, a multiplier of their own would hold linear displacements twice.
It is merged into those of its neighbours, psi_j + c psi_i with sum c = 1 (cross points and edges: Bernardi,
Maday, Patera 1994).  Where one face meets several parts, a vertex belongs to the interface that covers most
of its facets.  Quadratic displacements have nodes enough: linear multipliers at held vertices are stable, and
more accurate.  Vertices outside of what is common are merged in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import basix
import numpy as np
from latin_core import mortar as kernel

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.held_nodes import Held, held_across, held_twice
from dolfinx_frontend.assembly.overlap import closure_nodes, linear_means
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.vectors import unit_rows
from dolfinx_frontend.scene.laws import Law

__all__ = ["Multipliers", "multipliers", "vertex_nodes"]

_NOTHING = 1e-9
"""A facet is not covered if a smaller fraction of it is."""

_PLANE = 1e-12
"""Normals of a face that differ by less are the same."""

_OUTSIDE = 0.5
"""A vertex of which a smaller fraction is covered than this times the largest has no multiplier of its own:
it is outside of what is common, and its force would be extrapolated (to nine times the pressure there)."""

_LITTLE = 0.1
"""On a facet of which a smaller fraction is covered psi = L: the mass matrix of a sliver has no inverse."""


@dataclass(frozen=True)
class Multipliers:
    """Interface points at vertices, with the traces of the sides, for one component.

    Attributes
    ----------
    points, normals, weights
        (m, d) and (m,): vertices, unit normals out of the carrying side, areas.
    shapes
        (m, nodes) of the carrying side, and of the other one.
    along
        (m, d * nodes) for each side: the trace along the normal of the place; empty if all are the same.
    gap
        (m,), mean distance of the sides along the normal, length.
    bulge
        (m,), how far it may be below 0 for a distance >= 0 that is not linear, because psi is not >= 0.
    facets
        (k,), facets of the carrying side that are covered.
    areas
        (k, m), area of each facet that belongs to each point.
    corners, nodal
        (k, vertices of a facet), numbers of vertices, and (vertices, m): values at vertices from those of
        the points.
    """

    points: Array
    normals: Array
    weights: Array
    shapes: tuple[sp.csr_matrix, ...] = field(repr=False)
    along: tuple[sp.csr_matrix, ...] = field(repr=False)
    gap: Array
    bulge: Array
    facets: Ints
    areas: sp.csr_matrix = field(repr=False)
    corners: Ints
    nodal: sp.csr_matrix = field(repr=False)


def vertex_nodes(facets: FacetMap, space: Any) -> Ints:
    """(facets, vertices): nodes of a space at the vertices of each facet."""
    element = space.element.basix_element
    of_facet = np.array(basix.topology(facets.cell)[facets.dim - 1])
    of_vertex = np.array([d[0] for d in element.entity_dofs[0]])
    nodes = np.asarray(space.dofmap.list)[facets.cells]
    return np.take_along_axis(nodes, of_vertex[of_facet[facets.local]], axis=1).astype(np.int64)


def multipliers(
    carrier: FacetMap,
    other: FacetMap | None,
    spaces: tuple[Any, ...],
    found: kernel.Overlap,
    law: Law,
    held: Held | None = None,
) -> Multipliers:
    """Multipliers at the vertices of a face.

    Parameters
    ----------
    carrier, other, spaces
        The side that carries them, the other one, and their Lagrange spaces.
    found
        Integrals of the linear functions of the carrier's facets over what is common.
    law
        Whether it holds a vertex that is held already is what it says.
    held
        What else holds the nodes of the carrier.
    """
    d = carrier.dim
    share = found.covered / found.whole
    facets = np.flatnonzero(share > _NOTHING)
    vertices, corners = np.unique(vertex_nodes(carrier, spaces[0])[facets], return_inverse=True)
    corners = corners.reshape(len(facets), -1)
    m = len(vertices)
    x = np.asarray(spaces[0].tabulate_dof_coordinates())[vertices, :d]
    row = np.full(len(carrier), -1)
    row[facets] = np.arange(len(facets))
    pairs = np.flatnonzero(row[found.first] >= 0)
    here = corners[row[found.first[pairs]]]

    weights: Array = np.asarray(np.bincount(corners.ravel(), found.mean[facets].ravel(), minlength=m), float)
    of_facets = linear_means(carrier)[facets]
    whole = np.bincount(corners.ravel(), of_facets.ravel(), minlength=m)
    normals = np.zeros((m, 3))
    np.add.at(normals, corners, found.normal[facets])
    # where sheets meet back to back, the mean has no direction: that of one of them
    lost = np.linalg.norm(normals, axis=1) < 0.1 * weights
    some = lost[corners]
    normals[corners[some]] = found.normal[facets][some]
    linear = spaces[0].element.basix_element.degree == 1
    alone = weights / whole > _OUTSIDE * (weights / whole).max()
    if held is not None and linear and law.rigid:
        everywhere = vertex_nodes(carrier, spaces[0])
        around = np.bincount(everywhere.ravel(), np.repeat(found.whole, corners.shape[1]))[vertices]
        covered = corners.shape[1] * weights / around
        sides = 1 if other is None else 2
        alone &= ~held_twice(held, law, vertices, x, unit_rows(normals[:, :d]), covered, sides)
    merging = _merging(corners, alone)  # (points, vertices)

    dual = _dual(found.mean[facets], found.mass[facets], (share[facets] > _LITTLE) & linear)
    of_pairs = dual[row[found.first[pairs]]]
    distance, gap = np.zeros(m), np.zeros(m)
    np.add.at(distance, corners, found.gap[facets])
    np.add.at(gap, corners, (dual @ found.gap[facets][:, :, None])[:, :, 0])
    bulge = np.abs(merging @ (gap - distance)) / (merging @ weights)
    if law.unilateral and not linear:
        rim = _rim(corners)
        rim[corners[share[facets] < 1.0 - _NOTHING]] = False
        tied = held_across(held, vertices) if held is not None else np.zeros((m, d, d))
        ending = _at_rim(corners, found.mass[facets], x, unit_rows(normals[:, :d]), rim, tied)
        merging = merging @ ending
    weights = merging @ weights
    inverse = (sp.diags(1.0 / weights) @ merging).tocsr()
    mean = found.mean[facets][:, :, None]
    plane = not len(found.own_normal) or bool(
        np.ptp(found.normal[facets] / np.where(mean > 0.0, mean, 1.0), axis=(0, 1)).max() < _PLANE
    )
    shapes, along = [], []
    seen = [(carrier, dual, facets, facets, corners, found.own, found.own_normal)]
    if other is not None:
        seen.append((other, of_pairs, pairs, found.second[pairs], here, found.other, found.other_normal))
    for (face, psi, taken, which, rows, few, several), v in zip(seen, spaces, strict=True):
        nodes, count = closure_nodes(face, v)[which], v.dofmap.index_map.size_local
        shapes.append(_product(inverse, _assembled(psi @ few[taken], rows, nodes, m, count)))
        if plane:
            continue
        several = several[taken, :, :, :d]
        several = psi @ several.reshape(*several.shape[:2], -1)
        unknowns = (d * nodes[:, :, None] + np.arange(d)).reshape(len(nodes), -1)
        along.append(_product(inverse, _assembled(several, rows, unknowns, m, d * count)))
    areas = sp.csr_matrix(
        (
            found.mean[facets].ravel(),
            (np.repeat(np.arange(len(facets)), corners.shape[1]), corners.ravel()),
        ),
        shape=(len(facets), m),
    )
    keep = np.flatnonzero(alone) if alone.any() else np.zeros(1, dtype=np.int64)
    return Multipliers(
        points=x[keep],
        normals=_normals_at_vertices(carrier, facets, corners, found.mean[facets])[keep]
        if law.prescribes == "jump"
        else unit_rows((merging @ normals)[:, :d]),
        weights=weights,
        shapes=tuple(shapes),
        along=tuple(along),
        gap=inverse @ gap,
        bulge=bulge,
        facets=facets,
        areas=(areas @ merging.T).tocsr(),
        corners=corners,
        nodal=merging.T.tocsr(),
    )


def _at_rim(
    corners: Ints, mass: Array, x: Array, normals: Array, rim: Flags, tied: Array
) -> sp.csr_matrix:
    """(vertices, vertices): functions of the same span and sum whose forces act where the face ends.

    psi_i = L_i - sum_j c_ij L_j and psi_j + c_ij L_j of its neighbours j, with c_ij = a_ij (x_j - x_i) . t_i
    and the t_i along the face for which the moments of psi_i about vertex i vanish.

    Parameters
    ----------
    corners, mass, x, normals
        Vertices of each facet, integrals of L_i L_j, coordinates and normals of vertices.
    rim, tied
        Where the face ends, and projectors (vertices, d, d) onto directions in which vertices are held: where
        that is the one across the end, as on a plane of symmetry, the contact goes on beyond it.
    """
    m, d = x.shape
    rows, columns = (np.broadcast_to(each, mass.shape) for each in (corners[:, :, None], corners[:, None, :]))
    product = sp.csr_matrix((mass.ravel(), (rows.ravel(), columns.ravel())), shape=(m, m))
    weight, first = np.asarray(product.sum(axis=1)).ravel(), np.asarray(product @ x)
    own = first - weight[:, None] * x  # moments of L_i about vertex i
    across = np.einsum("id,ide,ie->i", own, tied, own) > 0.5 * np.einsum("id,id->i", own, own)
    rim = rim & ~across
    ends = np.flatnonzero(rim)
    if not ends.size:
        return sp.identity(m, format="csr")
    number = np.cumsum(rim) - 1
    # (ends, d, d - 1): directions along the face
    along = np.linalg.svd(normals[ends, None, :])[2][:, 1:].transpose(0, 2, 1)
    pairs = (product - sp.diags(product.diagonal())).tocsr()[ends].tocoo()
    i, j = ends[pairs.row], pairs.col
    towards = pairs.data[:, None] * np.einsum("pd,pdr->pr", x[j] - x[i], along[pairs.row])
    about = np.einsum("pd,pdr->pr", first[j] - weight[j, None] * x[i], along[pairs.row])
    both = rim[j]  # what such a neighbour gives away is taken by i
    given = np.einsum("pd,pdr->pr", own[j[both]], along[number[j[both]]])
    row = np.concatenate([pairs.row, number[j[both]]])[:, None, None]
    column = np.concatenate([pairs.row, pairs.row[both]])[:, None, None]
    of_pairs = np.concatenate([towards, towards[both]])
    blocks = np.einsum("pr,ps->prs", np.concatenate([about, -given]), of_pairs)
    r = np.arange(d - 1)
    rows = np.broadcast_to((d - 1) * row + r[:, None], blocks.shape)
    columns = np.broadcast_to((d - 1) * column + r, blocks.shape)
    size = (d - 1) * len(ends)
    system = sp.csc_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    right = np.einsum("id,idr->ir", own[ends], along).ravel()
    t = sp.linalg.spsolve(system, right).reshape(-1, d - 1)
    taken = sp.csr_matrix((np.einsum("pr,pr->p", towards, t[pairs.row]), (i, j)), shape=(m, m))
    return (sp.identity(m) - taken + sp.diags(np.asarray(taken.sum(axis=0)).ravel())).tocsr()


def _rim(corners: Ints) -> Flags:
    """(vertices,): whether a vertex lies where the face ends."""
    around: dict[int, list[list[int]]] = {
        2: [[0], [1]],
        3: [[0, 1], [1, 2], [2, 0]],
        4: [[0, 1], [1, 3], [3, 2], [2, 0]],
    }
    sides = np.concatenate([corners[:, side] for side in around[corners.shape[1]]])
    side, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    rim = np.zeros(corners.max() + 1, dtype=bool)
    rim[side[count == 1]] = True
    return rim


def _dual(mean: Array, mass: Array, good: Flags) -> Array:
    """(k, vertices, vertices): the biorthogonal functions of facets from the linear ones."""
    out = np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1))
    out[good] = mean[good][:, :, None] * np.linalg.inv(mass[good])
    return out


def _normals_at_vertices(face: FacetMap, facets: Ints, corners: Ints, weights: Array) -> Array:
    """(vertices, d), unit: the means of those of the facets there.

    For laws that hold all directions alike, whose forces are best told in the frame of the place. Laws that
    tell the normal direction from the others take the mean over psi, along which rigid motions slide freely.
    """
    normal, _ = face.alike_surface(np.asarray(basix.geometry(face.facet_cell)))
    out = np.zeros((corners.max() + 1, face.dim))
    np.add.at(out, corners, weights[:, :, None] * normal[facets])
    return unit_rows(out)


def _assembled(blocks: Array, rows: Ints, columns: Ints, m: int, n: int) -> sp.csr_matrix:
    """(m, n): the sum of blocks (b, r, c) at rows (b, r) and columns (b, c)."""
    starts, indices, data = kernel.sum_of(blocks, rows, columns, (m, n))
    return sp.csr_matrix((data, indices, starts), shape=(m, n))


def _product(left: sp.csr_matrix, right: sp.csr_matrix) -> sp.csr_matrix:
    """left @ right; where left is diagonal, the columns of right stay in their order."""
    m = left.shape[0]
    if left.shape[1] == m == left.nnz and np.array_equal(left.indices, np.arange(m)):
        data = right.data * np.repeat(left.data, np.diff(right.indptr))
        return sp.csr_matrix((data, right.indices, right.indptr), shape=right.shape)
    return (left @ right).tocsr()


def _merging(corners: Ints, alone: Flags) -> sp.csr_matrix:
    """(points, vertices): what of each vertex function belongs to each multiplier; columns have the sum 1."""
    m = len(alone)
    if not alone.any():
        return sp.csr_matrix(np.ones((1, m)))
    member = sp.csr_matrix(
        (np.ones(corners.size), (np.repeat(np.arange(len(corners)), corners.shape[1]), corners.ravel())),
        shape=(len(corners), m),
    )
    beside = (member.T @ member).tocsr()
    beside.data[:] = 1.0
    share = sp.identity(m, format="csr")[:, np.flatnonzero(alone)]  # (vertices, points)
    settled = alone.copy()
    while not settled.all():
        towards = sp.diags(~settled * 1.0) @ beside @ sp.diags(settled * 1.0)
        count = np.asarray(towards.sum(axis=1)).ravel()
        if not count.any():  # an island without a vertex of its own: to any other
            lost = np.flatnonzero(~settled)
            any_other = np.full(len(lost), np.argmax(alone))
            towards = sp.csr_matrix((np.ones(len(lost)), (lost, any_other)), (m, m))
            count = np.asarray(towards.sum(axis=1)).ravel()
        fresh = count > 0
        mean = sp.diags(np.where(fresh, 1.0 / np.maximum(count, 1.0), 0.0)) @ towards
        share = (share + mean @ share).tocsr()
        settled |= fresh
    return share.T.tocsr()
