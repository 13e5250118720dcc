"""Cells cut into simplices, whose functions and stresses the kernel knows.

The functions of a quadrilateral or hexahedron are no polynomials of the degree of its simplices, the
tractions on these are. What such functions ask of tractions at a node is distributed among the simplices
around it, with force and moment of each in balance; the stress is divided into what is linear on each
simplex, its projection onto what stresses in balance are made of, and the rest, which is orthogonal to
these. Nothing is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any

import basix
import numpy as np
from latin_core import Equilibration

from dolfinx_frontend.assembly.elements import quadrature, tabulate
from dolfinx_frontend.common.arrays import Array, Ints

__all__ = ["FACET_OF", "Tables", "cut", "simplex_shapes"]

FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
_SIMPLICES = ("interval", "triangle", "tetrahedron")
_NOTHING = 1e-12
"""Of gradients on the reference cell: less is rounding."""
_ROUNDS = 12
"""Of Newton's method for a point of a quadrilateral, which squares what is left in each."""


def cut(cell: str, order: Ints) -> Ints:
    """(n, simplices, corners): vertices of simplices in each cell, ascending in an order (n, vertices).

    They go from the lowest vertex to the facets without it, which are cut alike: so both cells of a facet cut
    it in the same way.
    """
    if cell in _SIMPLICES:
        return np.argsort(order, axis=1)[:, None]
    facets = np.array(basix.topology(basix.CellType[cell])[-2])
    without = np.all(facets != np.argmin(order, axis=1)[:, None, None], axis=2)
    across = facets[np.nonzero(without)[1]].reshape(len(order), -1)
    under = np.take_along_axis(order, across, axis=1).reshape(-1, facets.shape[1])
    inner = cut(FACET_OF[cell], under)  # (n * facets without it, simplices, corners - 1)
    found = np.take_along_axis(across.reshape(under.shape), inner.reshape(len(under), -1), axis=1)
    found = found.reshape(len(order), -1, inner.shape[2])
    lowest = np.broadcast_to(np.argmin(order, axis=1)[:, None, None], (*found.shape[:2], 1))
    return np.concatenate([lowest, found], axis=2)


@cache
def _simplex(dim: int, degree: int) -> tuple[Any, Ints]:
    kind = basix.CellType[_SIMPLICES[dim - 1]]
    element = basix.create_element(basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.equispaced)
    corners = np.vstack([np.zeros(dim), np.eye(dim)])
    middles = [0.5 * (corners[i] + corners[j]) for i, j in combinations(range(dim + 1), 2)]
    nodes = np.vstack([corners, *(middles if degree > 1 else [])])
    return element, np.argmin(np.abs(element.points - nodes[:, None]).sum(axis=2), axis=1)


def simplex_shapes(dim: int, degree: int, derivatives: int, x: Array) -> Array:
    """(1 [+ dim], points, functions) on the unit simplex: of vertices, then of edges (0, 1), (0, 2), ..."""
    element, order = _simplex(dim, degree)
    return tabulate(element, derivatives, x)[:, :, order]


def _rule(dim: int, degree: int) -> tuple[Array, Array]:
    """Points (pieces, q, dim) and weights (pieces, q) of the pieces into which its centroid cuts the unit
    simplex."""
    x, w = quadrature(basix.CellType[_SIMPLICES[dim - 1]], degree)
    corners = np.vstack([np.zeros(dim), np.eye(dim)])
    points, weights = [], []
    for piece in range(dim + 1):
        own = corners.copy()
        own[piece] = corners.mean(axis=0)
        points.append(own[0] + x @ (own[1:] - own[0]))
        weights.append(w * abs(np.linalg.det(own[1:] - own[0])))
    return np.array(points), np.array(weights)


@dataclass(frozen=True)
class _Unit:
    """Points of the unit simplex (m, d) with weights (pieces, q); orthonormal linear functions there
    (m, d + 1) and at the vertices, the kernel's of each piece (q, terms), displacements (1 + d, m, nodes)."""

    x: Array
    weights: Array
    first: Array
    linear: Array
    pieces: list[Array]
    shapes: Array

    @staticmethod
    @cache
    def of(dim: int, degree: int, highest: int) -> _Unit:
        """For stresses of one degree less than the highest."""
        y, w = _rule(dim, 2 * highest)
        x = y.reshape(-1, dim)
        lambdas = simplex_shapes(dim, 1, 0, x)[0]
        linear = np.linalg.inv(np.linalg.cholesky(lambdas.T @ (w.reshape(-1, 1) * lambdas)))
        pieces = [Equilibration.functions(dim, degree, p, y[p].T).T for p in range(len(y))]
        return _Unit(x, w, lambdas @ linear.T, linear, pieces, simplex_shapes(dim, degree, 1, x))

    def divided(self, functions: Array) -> tuple[Array, Array, Array]:
        """Coefficients (..., columns) of functions (..., m): linear, of pieces beyond, and of the rest."""
        shape = functions.shape[:-1]
        along = functions @ (self.weights.reshape(-1, 1) * self.first)
        left = (functions - along @ self.first.T).reshape(*shape, *self.weights.shape)
        more = []
        for p, each in enumerate(self.pieces):
            more.append(left[..., p, :] @ (self.weights[p][:, None] * each))
            left[..., p, :] -= more[-1] @ each.T
        left = (left * np.sqrt(self.weights)).reshape(int(np.prod(shape)), -1)
        u, s, _ = np.linalg.svd(left, full_matrices=False)
        return along, np.concatenate(more, axis=-1), (u * s).reshape(*shape, -1)


@dataclass(frozen=True)
class Tables:
    """What a way to cut a cell makes of its functions, on the reference cell, or one that is no image of it.

    Attributes
    ----------
    slopes
        (d, nodes, simplices, columns), coefficients of gradients in functions that are orthonormal on the
        unit simplex: linear ones, those of the kernel's pieces beyond, and what is orthogonal to both.
    own
        (d, nodes, simplices, d + 1), the same of the functions of the simplices, for the nodes of the cell.
    sizes
        (simplices,), determinants of the edges.
    excess
        (nodes,), integral of the functions of the cell less those of its simplices.
    share
        (simplices, nodes of a simplex, d, nodes, d): least forces on the simplices, each in balance, whose
        sums are forces at nodes that are in balance.
    linear
        (d + 1, d + 1), the linear functions at the vertices.
    beyond
        How many of the columns are of the kernel's pieces.
    traces, excess_on
        Integrals over facets of the gradients (d, nodes, facets, nodes of a facet) and of 1 (facets, nodes of
        a facet), times the functions of the simplices less those of the cell.
    normals
        (facets, d), outward.
    """

    slopes: Array
    own: Array
    sizes: Array
    excess: Array
    share: Array
    linear: Array
    beyond: int
    traces: Array
    excess_on: Array
    normals: Array

    @classmethod
    def of(cls, element: Any, vertices: Array, corners: Ints, nodes: Ints) -> Tables:
        """Of an element and the vertices (n, d) of a straight cell, cut into simplices of its vertices
        (simplices, d + 1) and nodes (simplices, nodes), in the kernel's order."""
        d, degree = corners.shape[1] - 1, int(element.degree)
        unit = _Unit.of(d, degree, degree if len(vertices) == d + 1 else d * degree)
        w = unit.weights
        tables, owns, sizes = [], [], []
        excess = np.zeros(element.dim)
        for at, here in zip(corners, nodes, strict=True):
            x: Array = vertices[at]
            edges = x[1:] - x[0]
            table = _tabulated(element, vertices, x[0] + unit.x @ edges)
            sizes.append(abs(np.linalg.det(edges)))
            excess += w.ravel() @ table[0] * sizes[-1]
            excess[here] -= w.ravel() @ unit.shapes[0] * sizes[-1]
            tables.append(unit.divided(table[1:].transpose(0, 2, 1)))
            owns.append(np.zeros((d, element.dim, d + 1)))
            slopes = np.einsum("im,mqk->ikq", np.linalg.inv(edges), unit.shapes[1:])
            owns[-1][:, here] = slopes @ (w.reshape(-1, 1) * unit.first)
        along, more, rest = (np.stack(part, axis=2) for part in zip(*tables, strict=True))
        kept = np.abs(rest).max(axis=(0, 1, 2)) > _NOTHING
        beyond = more.shape[3] if np.abs(more).max() > _NOTHING else 0
        return cls(
            np.concatenate([along, more[..., :beyond], rest[..., kept]], axis=3),
            np.stack(owns, axis=2),
            np.array(sizes),
            excess,
            _shares(vertices, element.dim, corners, nodes),
            unit.linear,
            beyond,
            *_traces(vertices, element, corners, nodes),
        )


def _tabulated(element: Any, vertices: Array, x: Array) -> Array:
    """(1 + d, points, functions) and their derivatives at places (m, d) of a straight cell."""
    kind = element.cell_type
    if np.array_equal(vertices, basix.geometry(kind)):
        return tabulate(element, 1, x)
    shape = basix.create_element(basix.ElementFamily.P, kind, 1, basix.LagrangeVariant.equispaced)
    at = np.full_like(x, 0.5)
    for _ in range(_ROUNDS):
        table = tabulate(shape, 1, at)
        slopes = np.einsum("imv,vk->mik", table[1:], vertices)
        step = np.linalg.solve(np.swapaxes(slopes, 1, 2), (x - table[0] @ vertices)[..., None])[..., 0]
        at = at + step
        if np.abs(step).max() < _NOTHING:
            break
    table = tabulate(element, 1, at)
    table[1:] = np.linalg.solve(slopes, table[1:].transpose(1, 0, 2)).transpose(1, 0, 2)
    return table


def _shares(vertices: Array, functions: int, corners: Ints, nodes: Ints) -> Array:
    """See :class:`Tables`."""
    count, each = nodes.shape
    d = corners.shape[1] - 1
    turns = list(combinations(range(d), 2))
    sums = np.zeros((functions, d, count, each, d))
    balance = np.zeros((count, d + len(turns), count, each, d))
    for s in range(count):
        x = vertices[corners[s]]
        points = np.vstack([x, [0.5 * (x[i] + x[j]) for i, j in combinations(range(d + 1), 2)]])
        for a, node in enumerate(nodes[s]):
            sums[node, :, s, a] = np.eye(d)
            balance[s, :d, s, a] = np.eye(d)
            for row, (i, j) in enumerate(turns, start=d):
                balance[s, row, s, a, i], balance[s, row, s, a, j] = -points[a, j], points[a, i]
    rows = np.vstack([sums.reshape(functions * d, -1), balance.reshape(count * (d + len(turns)), -1)])
    inverse = np.linalg.pinv(rows, rcond=1e-10)[:, : functions * d]
    return np.asarray(inverse.reshape(count, each, d, functions, d))


def _traces(vertices: Array, element: Any, corners: Ints, nodes: Ints) -> tuple[Array, Array, Array]:
    """See :class:`Tables`: in 2D, and on triangles, the functions are the same."""
    d, degree = corners.shape[1] - 1, int(element.degree)
    facets = np.array(basix.topology(element.cell_type)[-2])
    closure = np.array(element.entity_closure_dofs[d - 1])
    traces, excess = np.zeros((d, element.dim, *closure.shape)), np.zeros(closure.shape)
    normals = np.asarray(basix.cell.facet_outward_normals(element.cell_type))
    x, w = quadrature(basix.CellType.triangle, 2 * d * degree)
    for s, a in np.ndindex(corners.shape if facets.shape[1] > d else (0, 0)):
        own = np.delete(corners[s], a)
        on = np.flatnonzero(np.all(np.any(facets[:, :, None] == own, axis=1), axis=1))
        for facet in on:
            edges = vertices[own[1:]] - vertices[own[0]]
            table = tabulate(element, 1, vertices[own[0]] + x @ edges)
            unit = np.delete(np.vstack([np.zeros(d), np.eye(d)]), a, axis=0)
            inside = unit[0] + x @ (unit[1:] - unit[0])
            shapes = -table[0]
            shapes[:, nodes[s]] += simplex_shapes(d, degree, 0, inside)[0]
            weighted = np.linalg.norm(np.cross(*edges)) * w[:, None] * shapes[:, closure[facet]]
            excess[facet] += weighted.sum(axis=0)
            traces[:, :, facet] += table[1:].transpose(0, 2, 1) @ weighted
    return traces, excess, normals
