"""Faces of parts for tractions: polynomials of the cells' degree on the facets of their simplices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import basix
import numpy as np

from dolfinx_frontend.assembly.elements import quadrature, tabulate
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.part_loads import FaceOf
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.estimate.balanced_cells import FACET_OF, cut, simplex_shapes
from dolfinx_frontend.estimate.balanced_parts import SETTINGS, Body, Facets, strain_of, tensor_of

__all__ = ["OnFace"]

_SQUARE = ((0, 1), (0, 2), (1, 3), (2, 3))
"""Edges of a square, as basix has them."""

MORE = 2
"""Degree beyond products of shape functions to which tractions are integrated: those that are none show."""


@dataclass(frozen=True)
class _Hull:
    """A field by its values at nodes (elements, k), and by Bernstein coefficients, in whose hull it is."""

    nodes: Ints
    matrix: Array

    def coefficients(self, nodal: Array) -> Array:
        """(nodes,) of values (nodes,)."""
        return self._mapped(self.matrix, nodal)

    def values(self, coefficients: Array) -> Array:
        """(nodes,) of coefficients."""
        return self._mapped(np.asarray(np.linalg.inv(self.matrix)), coefficients)

    def _mapped(self, matrix: Array, given: Array) -> Array:
        out = given.copy()
        out[self.nodes] = given[self.nodes] @ matrix.T
        return out


def _bernstein(corners: int, degree: int) -> Array:
    """Coefficients by values at vertices and edges (0, 1), (0, 2), ...; of a square (corners = 4), and its
    centre."""
    if degree == 1:
        return np.eye(corners)
    edges = _SQUARE if corners == 4 else list(combinations(range(corners), 2))
    out = np.eye(corners + len(edges) + (corners == 4))
    for row, ends in enumerate(edges, start=corners):
        out[row, row], out[row, list(ends)] = 2.0, -0.5
    if corners == 4:
        out[-1] = [0.25] * 4 + [-1.0] * 4 + [4.0]
    return out


class OnFace(FaceOf):
    """A face of a part for tractions: continuous, polynomials of the cells' degree on facets of simplices."""

    def __init__(self, body: Body, face: str, where: str) -> None:
        self.body = body
        super().__init__(body.part, face, where)  # calls _points
        self.weights_of = self.weights.reshape(len(self.nodes), -1)
        k, q = self.nodes.shape[1], self.weights_of.shape[1]
        rows = np.repeat(np.arange(len(self.weights)), k)
        values = np.tile(self.functions.ravel(), len(self.nodes))
        shape = (len(self.weights), len(body.u))
        self.pull = sp.csr_matrix((values, (rows, np.repeat(self.nodes, q, axis=0).ravel())), shape=shape)
        self.places = body.part.dof_coordinates

    def _points(self, facets: FacetMap, degree: int) -> tuple[Ints, Array, Array]:
        body, d = self.body, self.body.part.dim
        self.cells = np.asarray(facets.cells)
        vertices = np.array(basix.topology(self.body.element.cell_type)[d - 1])[facets.local]
        inner = cut(FACET_OF[body.cell], np.take_along_axis(body.order[self.cells], vertices, axis=1))
        local = np.take_along_axis(vertices, inner.reshape(len(inner), -1), axis=1).reshape(inner.shape)
        nodes = body.nodes_of(self.cells, local)
        self.nodes = nodes.reshape(-1, nodes.shape[2])  # (facets of simplices, nodes), vertices ascending
        self.hull = _Hull(self.nodes, _bernstein(d, degree))
        self.hull_of_jumps = self.hull
        self.square = vertices.shape[1] == 4
        if self.square:
            of_square = [body.at_vertex[vertices]]
            if degree > 1:
                ends = vertices[:, [*_SQUARE, (0, 3)]]
                of_square.append(body.between[ends[..., 0], ends[..., 1]])
            found = np.take_along_axis(body.dofs[self.cells], np.concatenate(of_square, axis=1), axis=1)
            self.hull_of_jumps = _Hull(found, _bernstein(4, degree))
        highest = degree * (d - 1) if self.square else degree
        x, w = quadrature(basix.CellType[("interval", "triangle")[d - 2]], 2 * highest + MORE)
        self.functions = simplex_shapes(d - 1, degree, 0, x)[0]  # (q, nodes)
        places = np.einsum("qv,nfvi->nfqi", simplex_shapes(d - 1, 1, 0, x)[0], body.corners[local])
        places -= facets.origin[facets.local][:, None, None]
        at = np.einsum("nij,nfqj->nfqi", np.linalg.pinv(facets.tangents)[facets.local], places)
        index = np.repeat(np.arange(len(local)), local.shape[1] * len(w))
        self.cell_of, self.inside = self.cells[index], facets.reference(index, at.reshape(-1, d - 1))
        return index, at.reshape(-1, d - 1), np.tile(w, len(self.nodes))

    def moments(self, traction: Array) -> Array:
        """(facets, nodes, d) of tractions (m, d) at the points, with the functions of facets of simplices."""
        weighted = self.weights_of[:, :, None] * traction.reshape(*self.weights_of.shape, -1)
        return np.asarray(np.einsum("qk,fqd->fkd", self.functions, weighted))

    def exert(self, traction: Array, held: Array | None = None) -> None:
        """Tractions (m, d) at the points on the part, or a projector (d, d) onto what a support takes."""
        body, d = self.body, self.body.part.dim
        moments, count = self.moments(traction), len(self.nodes)
        taken = self.square and held is not None
        support = np.zeros((d, d)) if held is None else held
        body.facets.append(
            Facets(
                body.numbers[self.nodes[:, :d]],
                np.repeat(self.cells, count // len(self.cells)),
                moments,
                np.tile(support, (count, 1, 1)),
                self.excess(self._own_traction() @ support if taken else traction),
                np.full(count, taken),
            )
        )

    def _own_traction(self) -> Array:
        """(m, d) of the stress of the answer at the points."""
        body, cells = self.body, self.cell_of
        slopes = tabulate(body.element, 1, self.inside)[1:]
        inverse = np.linalg.inv(body.edges[cells])
        gradient = np.einsum("pik,mpi,pmj->pkj", body.u[body.dofs[cells]], slopes, inverse)
        stress = strain_of(gradient) @ body.elasticity.T - body.initial[cells].mean(axis=1)
        return np.asarray(np.einsum("pkl,pl->pk", tensor_of(stress), self.normals))

    def forces(self, traction: Array) -> Array:
        """Forces (nodes, d) of tractions (m, d) at the points."""
        return np.asarray(self.shape.T @ (self.weights[:, None] * traction))

    def excess(self, traction: Array) -> Array:
        """(facets, nodes of the cell, d): moments with functions of the simplices less those of the cell."""
        out = np.zeros((len(self.nodes), self.body.dofs.shape[1], traction.shape[1]))
        if self.square and traction.any():
            off = (self.pull - self.shape).tocoo()
            facet = off.row // self.weights_of.shape[1]
            cell = self.cell_of[off.row]
            node = np.argmax(self.body.dofs[cell] == off.col[:, None], axis=1)
            np.add.at(out, (facet, node), (off.data * self.weights[off.row])[:, None] * traction[off.row])
        return out

    def misfit(self, traction: Array) -> float:
        """How far tractions (m, d) are from polynomials of the facets, relative."""
        mass = np.einsum("qk,fq,ql->fkl", self.functions, self.weights_of, self.functions)
        nearest = np.einsum("qk,fkd->fqd", self.functions, np.linalg.solve(mass, self.moments(traction)))
        off = np.abs(nearest.reshape(traction.shape) - traction).max()
        return float(off / max(np.abs(traction).max(), 1e-300))

    @property
    def flat(self) -> bool:
        """Whether all facets have one normal."""
        return bool(np.abs(self.normals - self.normals[0]).max() <= SETTINGS.rounding)

    def linear(self, x: Array) -> Array:
        """1 and the coordinates along a flat face, about its middle, of places (..., d): (..., d)."""
        tangents = np.linalg.svd(self.normals[:1])[2][1:]
        size = np.abs(self.arms).max()
        along = (x - self.centre) @ tangents.T / size
        return np.concatenate([np.ones((*x.shape[:-1], 1)), along], axis=-1)

    def integrals(self, nodes: Ints) -> Array:
        """(d, k) of the functions of coefficients of tractions times :meth:`linear`, at nodes (k,)."""
        of_nodes = self.moments(self.linear(self.x))  # (facets, nodes, d)
        by = np.einsum("fkd,kl->dfl", of_nodes, np.linalg.inv(self.hull.matrix))
        out = np.zeros((len(by), len(self.places)))
        for row, each in zip(out, by, strict=True):
            np.add.at(row, self.nodes, each)
        return out[:, nodes]

    def traction(self, nodal: Array) -> Array:
        """Values (nodes, d) of the traction that exerts forces (nodes, d)."""
        nodes = np.unique(self.nodes)
        mass = self.shape[:, nodes].T @ sp.diags(self.weights) @ self.pull[:, nodes]
        found = np.zeros_like(nodal)
        found[nodes] = sp.linalg.splu(mass.tocsc()).solve(np.ascontiguousarray(nodal[nodes]))
        return found
