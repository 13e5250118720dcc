"""The interface space ``facets``: one value per facet of side 1, constant on it (P0).

Interface point = centroid, weight = area, trace row = mean of the shape functions:

    T_1 = 1/A int N_1 dA,   T_2 = 1/A int N_2 dA   over the facet of side 1,

so that T_2^T W 1 = int N_2 dA: a constant pressure goes through meshes that do not match without
an error, and both traces have the same mean of a linear field (the patch test).  The integrals of
side 2 are taken piece by piece over the intersections with its facets.

On triangles of degree 1 there are two facets per node: laws that prescribe jumps lock there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from latin_core import mortar

from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.overlap import closure_nodes
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.vectors import unit_rows

__all__ = ["Averages", "average"]

_LEAST = 1e-8
"""A facet of which a smaller fraction is covered is left out."""


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
    offset
        (m, d), mean of x_2 - x_1, length.
    """

    facets: Ints
    points: Array
    normals: Array
    weights: Array
    shapes: tuple[sp.csr_matrix, ...] = field(repr=False)
    offset: Array


def average(
    first: FacetMap, second: FacetMap | None, spaces: tuple[Any, ...], found: mortar.Overlap
) -> Averages:
    """Averages of the shape functions of both sides over the facets of side 1.

    Parameters
    ----------
    first, second
        Facets of the sides; None: one side.
    spaces
        Lagrange space of each side.
    found
        Integrals of the function 1 over what is common.
    """
    d = first.dim
    kept = np.flatnonzero(found.covered > _LEAST * found.whole)
    row = np.full(len(first), -1)
    row[kept] = np.arange(len(kept))
    weights = found.mean[kept, 0]

    def means(rows: Ints, columns: Ints, values: Array, nodes: int) -> sp.csr_matrix:
        at = np.repeat(rows, columns.shape[1])
        data = values.ravel() / weights[at]
        matrix = sp.csr_matrix((data, (at, columns.ravel())), shape=(len(kept), nodes))
        matrix.data[np.abs(matrix.data) < 1e-15] = 0.0  # such integrals are zero but for rounding
        matrix.eliminate_zeros()
        return matrix

    sizes = [v.dofmap.index_map.size_local for v in spaces]
    shapes = [means(np.arange(len(kept)), closure_nodes(first, spaces[0])[kept], found.own[kept], sizes[0])]
    if second is not None:
        pairs = np.flatnonzero(row[found.first] >= 0)
        nodes = closure_nodes(second, spaces[1])[found.second[pairs]]
        shapes.append(means(row[found.first[pairs]], nodes, found.other[pairs], sizes[1]))
    return Averages(
        facets=kept,
        points=found.place[kept, 0, :d] / weights[:, None],
        normals=unit_rows(found.normal[kept, 0, :d]),
        weights=weights,
        shapes=tuple(shapes),
        offset=found.offset[kept, 0, :d] / weights[:, None],
    )
