"""Parts as the kernel takes them for stresses in balance: cells with ascending vertices, and tractions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
from latin_core import Equilibration

from dolfinx_frontend.assembly.elements import tabulate
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.materials import VOIGT

__all__ = [
    "MORE",
    "SETTINGS",
    "Body",
    "Inputs",
    "OnFace",
    "Settings",
    "correct",
    "lifted",
    "refused",
]


@dataclass(frozen=True)
class Settings:
    """Numbers that decide.

    Attributes
    ----------
    sweeps, enough
        Over the stars of facets at most, and the share of the energy below which what a sweep takes is not
        worth its time: half of the cells' own on tetrahedra.
    rounding
        Relative: a balance or a polynomial that is off by less is exact.
    share
        Of the rounding: forces that an answer, or what makes up for them, may leave.
    loose
        Relative residual of displacements that part faces inside each other.
    rounds
        Of Newton's method for a pressure that never pulls, which takes as many as its zone changes.
    """

    sweeps: int = 10
    enough: float = 0.25
    rounding: float = 1e-8
    share: float = 0.3
    loose: float = 1e-2
    rounds: int = 30


SETTINGS = Settings()

MORE = 2
"""Degree beyond products of shape functions to which tractions are integrated: those that are none show."""

_CELLS = ("triangle", "tetrahedron")


def refused(why: str) -> SceneError:
    return SceneError(f"errors(kind='bound'): {why}")


class Body:
    """A part: its cells with ascending vertices, and what acts on it."""

    def __init__(self, part: Substructure, unknowns: Array) -> None:
        where = f"substructure {part.name!r}"
        if not has_mesh(part):
            raise refused(f"{where} is a matrix, of which no stress is known")
        mesh, element = part.part.mesh, part.space.element.basix_element
        self.cell, self.degree = str(mesh.topology.cell_name()), int(element.degree)
        if self.cell not in _CELLS or self.degree > 2:
            raise refused(
                f"{where} has {self.cell} cells of degree {self.degree}; triangles and tetrahedra of degree "
                "1 and 2 have stresses in balance"
            )
        if part.around:
            raise refused(f"{where} is the section of a body of revolution")
        matrix = getattr(part.material, "elasticity", lambda dim: None)(part.dim)
        if matrix is None or not is_real(part.factor):
            raise refused(f"{where}: its material is no elasticity with the same numbers everywhere")
        self.part, self.u = part, unknowns.reshape(-1, part.dim)
        self.elasticity = np.asarray(matrix, dtype=np.float64) * float(part.factor)
        self.element, d = element, part.dim
        dofs = np.asarray(part.space.dofmap.list, dtype=np.int64)
        at_vertex = np.array([each[0] for each in element.entity_dofs[0]])
        self.vertices = dofs[:, at_vertex]
        self.dofs, self.at_vertex = dofs, at_vertex
        self.x = part.dof_coordinates[self.vertices]  # (cells, d + 1, d)
        self.force = np.zeros((len(dofs), d))
        self.acting = np.zeros_like(self.u)  # nodal forces of all loads and joints
        self.held = np.zeros((len(self.u), part.dim, part.dim))  # what supports take
        self.change = np.zeros_like(self.u)  # what these do
        self.lifted = np.zeros_like(self.u)  # to a displacement that is admissible
        self.facets: list[tuple[Ints, Ints, Array, Array]] = []
        self.initial = np.zeros((len(dofs), d + 1, len(matrix)))

    @property
    def volumes(self) -> Array:
        """(cells,)."""
        edges = self.x[:, 1:] - self.x[:, :1]
        return np.asarray(np.abs(np.linalg.det(edges)) / (2.0 if self.part.dim == 2 else 6.0))

    def corners(self, numbers: Ints) -> tuple[Ints, Ints]:
        """Vertices (cells, d + 1) by their numbers, ascending, and nodes (cells, nodes), of edges last."""
        own = numbers[self.vertices]
        self.order = np.argsort(own, axis=1)
        nodes = [np.take_along_axis(self.vertices, self.order, axis=1)]
        if self.degree > 1:
            edges = basix.topology(basix.CellType[self.cell])[1]
            of_edge = np.zeros((len(self.at_vertex),) * 2, dtype=np.int64)
            for (i, j), found in zip(edges, self.element.entity_dofs[1], strict=True):
                of_edge[i, j] = of_edge[j, i] = found[0]
            pairs = [(i, j) for i in range(len(of_edge)) for j in range(i + 1, len(of_edge))]
            local = np.stack([of_edge[self.order[:, i], self.order[:, j]] for i, j in pairs], axis=1)
            nodes.append(np.take_along_axis(self.dofs, local, axis=1))
        return np.take_along_axis(own, self.order, axis=1), np.concatenate(nodes, axis=1)

    def straight(self) -> bool:
        """Whether nodes of edges are in their middles."""
        if int(coordinate_map(self.part.part.mesh).degree) == 1:
            return True
        shape = tabulate(
            basix.create_element(
                basix.ElementFamily.P, basix.CellType[self.cell], 1, basix.LagrangeVariant.equispaced
            ),
            0,
            np.asarray(self.element.points),
        )[0]
        places = np.einsum("nk,cki->cni", shape, self.x)
        off = np.abs(places - self.part.dof_coordinates[self.dofs]).max(axis=(1, 2))
        return bool(np.all(off <= SETTINGS.rounding * np.ptp(self.x, axis=1).max(axis=1)))

    def energy(self, u: Array) -> float:
        """Twice the strain energy of displacements (nodes, d)."""
        flat = u.ravel()
        return max(float(flat @ (self.part.matrix @ flat)), 0.0) if u.any() else 0.0

    def energy_of_change(self) -> float:
        """Of the distance between what is in balance on the mesh and what is admissible."""
        return self.energy(self.lifted - self.change)

    def stress(self) -> Array:
        """(cells, d + 1, components) of what balances on the mesh, at the vertices in their own order."""
        d = self.part.dim
        reference = np.asarray(basix.geometry(basix.CellType[self.cell]))
        slopes = tabulate(self.element, 1, reference)[1:]
        inverse = np.linalg.inv(np.swapaxes(self.x[:, 1:] - self.x[:, :1], 1, 2))
        u = (self.u + self.change)[self.dofs]
        gradient = np.einsum("cki,mvk,cmj->cvij", u, slopes, inverse, optimize=True)
        strain = np.stack(
            [
                gradient[..., i, j] if i == j else gradient[..., i, j] + gradient[..., j, i]
                for i, j in VOIGT[d]
            ],
            axis=-1,
        )
        return np.asarray(strain @ self.elasticity.T) - self.initial

    def on_face(self, facets: FacetMap, moments: Array, held: Array) -> None:
        """Moments (facets, nodes, d) of tractions with functions of facets, and a projector (facets, d, d)
        onto what a support takes."""
        self.facets.append((facets.cells.astype(np.int64), facets.local.astype(np.int64), moments, held))


class OnFace:
    """A face of a part for tractions at points of a rule."""

    def __init__(self, body: Body, face: str, where: str) -> None:
        self.map = FacetMap(body.part.part, face, where)
        at, weights = self.map.rule(2 * body.degree + MORE)
        index = np.repeat(np.arange(len(self.map)), len(weights))
        self.x, self.normals, area = self.map.surface(index, np.tile(at, (len(self.map), 1)))
        self.weights = np.tile(weights, len(self.map)) * area
        space = body.part.space
        self.shapes = self.map.alike_shapes(space, at)  # (facets, q, nodes of a facet)
        self.dofs = self.map.closure_dofs(space)
        self.corners, self.places = body.part.dim, body.part.dof_coordinates

    def _by_facet(self, values: Array) -> Array:
        return values.reshape(*self.shapes.shape[:2], -1)

    def moments(self, traction: Array) -> Array:
        """(facets, nodes of a facet, d) of tractions (m, d) at the points, in the order of `closure_dofs`."""
        weighted = self._by_facet(self.weights[:, None] * traction)
        return np.asarray(np.einsum("fqk,fqd->fkd", self.shapes, weighted))

    @property
    def _mass(self) -> Array:
        weights = self.weights.reshape(self.shapes.shape[:2])
        return np.asarray(np.einsum("fqk,fq,fql->fkl", self.shapes, weights, self.shapes))

    def nodal(self, moments: Array) -> Array:
        """Forces (nodes, d) at all nodes of the part, of moments."""
        out = np.zeros((len(self.places), moments.shape[2]))
        np.add.at(out, self.dofs, moments)
        return out

    def misfit(self, traction: Array) -> float:
        """How far tractions (m, d) are from polynomials of the facets, relative."""
        nearest = np.linalg.solve(self._mass, self.moments(traction))
        off = np.einsum("fqk,fkd->fqd", self.shapes, nearest) - self._by_facet(traction)
        return float(np.abs(off).max() / max(np.abs(traction).max(), 1e-300))

    def values(self, nodal: Array) -> Array:
        """A field (m, d) at the points by its values (nodes, d) at nodes."""
        return np.asarray(np.einsum("fqk,fkd->fqd", self.shapes, nodal[self.dofs])).reshape(len(self.x), -1)

    def to_bernstein(self, nodal: Array) -> Array:
        """Coefficients (nodes,) of a field of the face's degree with values (nodes,): it is in their hull."""
        out = nodal.copy()
        for edge, i, j in self._edges:
            out[edge] = 2.0 * nodal[edge] - 0.5 * (nodal[i] + nodal[j])
        return out

    def to_nodes(self, coefficients: Array) -> Array:
        """Values (nodes,) at the nodes by coefficients."""
        out = coefficients.copy()
        for edge, i, j in self._edges:
            out[edge] = 0.5 * coefficients[edge] + 0.25 * (coefficients[i] + coefficients[j])
        return out

    @property
    def _edges(self) -> list[tuple[Ints, Ints, Ints]]:
        """Nodes of edges and of their ends, for each edge of a facet."""
        if self.dofs.shape[1] == self.corners:
            return []
        ends = [(0, 1)] if self.corners == 2 else [(1, 2), (0, 2), (0, 1)]
        nodes = self.dofs.T
        return [(nodes[self.corners + k], nodes[i], nodes[j]) for k, (i, j) in enumerate(ends)]

    @property
    def flat(self) -> bool:
        """Whether all facets have one normal."""
        return bool(np.abs(self.normals - self.normals[0]).max() <= SETTINGS.rounding)

    def linear(self, x: Array) -> Array:
        """1 and the coordinates along a flat face, about its middle, of places (..., d): (..., d)."""
        middle = self.weights @ self.x / self.weights.sum()
        tangents = np.linalg.svd(self.normals[:1])[2][1:]
        size = np.abs(self.x - middle).max()
        return np.concatenate([np.ones((*x.shape[:-1], 1)), (x - middle) @ tangents.T / size], axis=-1)

    def integrals(self, nodes: Ints) -> Array:
        """(d, k) of the functions of coefficients times :meth:`linear`, at nodes (k,)."""
        along = (self.weights[:, None] * self.linear(self.x)).T.reshape(self.corners, *self.shapes.shape[:2])
        out = np.zeros((self.corners, len(self.places)))
        for row, of in enumerate(along):
            np.add.at(out[row], self.dofs, np.einsum("fq,fqk->fk", of, self.shapes))
            mine = out[row].copy()
            for edge, i, j in self._edges:
                once, which = np.unique(edge, return_index=True)
                np.add.at(out[row], i[which], 0.25 * mine[once])
                np.add.at(out[row], j[which], 0.25 * mine[once])
                out[row][once] = 0.5 * mine[once]
        return out[:, nodes]

    def traction(self, nodal: Array) -> Array:
        """Values (nodes, d) of the continuous traction of the face's degree that exerts forces (nodes, d)."""
        nodes, local = np.unique(self.dofs, return_inverse=True)
        local, k = local.reshape(self.dofs.shape), self.dofs.shape[1]
        rows, columns = np.repeat(local, k, axis=1).ravel(), np.tile(local, (1, k)).ravel()
        mass = sp.csc_matrix((self._mass.ravel(), (rows, columns)), shape=(len(nodes),) * 2)
        found = np.zeros_like(nodal)
        found[nodes] = sp.linalg.splu(mass).solve(np.ascontiguousarray(nodal[nodes]))
        return found


def correct(bodies: Mapping[str, Body], numbers: Mapping[str, Ints], count: int, motions: Array) -> None:
    """What the forces that an answer leaves do to its parts, which stay glued and held (`Body.change`); but
    those that drive free motions (count * d, r), which are the iteration's error."""
    d = next(iter(bodies.values())).part.dim
    held, right, largest = np.zeros((count, d, d)), np.zeros((count, d)), 0.0
    for name, body in bodies.items():
        inner = (body.part.matrix @ body.u.ravel()).reshape(body.u.shape)
        largest = max(largest, np.abs(inner).max(initial=0.0), np.abs(body.acting).max(initial=0.0))
        np.add.at(right, numbers[name], body.acting - inner)
        np.add.at(held, numbers[name], body.held)
    free = _free(held)
    right = np.einsum("nij,nj->ni", free, right)
    enough = SETTINGS.share * SETTINGS.rounding * largest
    if np.abs(right).max(initial=0.0) <= enough:
        return
    project = _by_node(free)
    matrix = sp.csr_matrix(project.shape)
    for name, body in bodies.items():
        places = (d * numbers[name][:, None] + np.arange(d)).ravel()
        entries = np.ones(len(places)), (places, np.arange(len(places)))
        spread = sp.csr_matrix(entries, shape=(count * d, len(places)))
        matrix = matrix + spread @ body.part.matrix @ spread.T
    driven = right.ravel() - motions @ (motions.T @ right.ravel())
    found = solved_by_cg(project @ matrix @ project, driven, enough).reshape(-1, d)
    for name, body in bodies.items():
        body.change[:] = found[numbers[name]]


def lifted(body: Body, nodes: Ints, moved: Array, normal: Array, fixed: Flags) -> Array:
    """The displacement (nodes, d) of least energy that moves nodes (k,) by a length (k,) along a normal, and
    neither what supports hold nor fixed nodes."""
    d = body.part.dim
    given = np.zeros_like(body.u)
    given[nodes] = np.outer(moved, normal)
    held = body.held.copy()
    held[nodes] += np.outer(normal, normal)
    held[fixed] += np.eye(d)
    free = _free(held)
    project = _by_node(free)
    right = -(project @ (body.part.matrix @ given.ravel()))
    enough = SETTINGS.loose * float(np.linalg.norm(right))  # what is found is admissible in any case
    return given + solved_by_cg(project @ body.part.matrix @ project, right, enough).reshape(given.shape)


def _free(held: Array) -> Array:
    """Projectors (n, d, d) onto what sums of projectors (n, d, d) leave."""
    values, axes = np.linalg.eigh(held)
    left = (values < SETTINGS.rounding).astype(np.float64)
    return np.asarray(np.einsum("nik,nk,njk->nij", axes, left, axes))


def _by_node(blocks: Array) -> Any:
    """The matrix of blocks (n, d, d) on its diagonal."""
    n, d, _ = blocks.shape
    return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(n * d, n * d)).tocsr()


def solved_by_cg(matrix: Any, right: Array, enough: float) -> Array:
    """The solution of a symmetric system that may be singular, with forces that balance, to a residual."""
    diagonal = matrix.diagonal()
    moves = diagonal > SETTINGS.rounding * diagonal.max(initial=0.0)
    scale = np.where(moves, 1.0 / np.where(moves, diagonal, 1.0), 0.0)
    inverse = sp.linalg.LinearOperator(matrix.shape, matvec=lambda r: scale * r)
    return np.asarray(sp.linalg.cg(matrix, right, rtol=0.0, atol=enough, M=inverse)[0])


class Inputs:
    """Cells of all parts, as the kernel takes them."""

    def __init__(self, dim: int) -> None:
        self.dim = dim
        self.counts: list[int] = []
        self.vertices: list[tuple[Ints, Array]] = []
        self.blocks: dict[str, list[Any]] = {
            k: []
            for k in "corners stress force compliance material cells facets moments held".split()
        }
        self.degrees: set[int] = set()

    def add(self, body: Body, numbers: Ints) -> None:
        corners, nodes = body.corners(numbers)
        first, add = sum(self.counts), self.blocks
        self.degrees.add(body.degree)
        self.vertices.append((numbers[body.vertices.ravel()], body.x.reshape(-1, self.dim)))
        stress = np.take_along_axis(body.stress(), body.order[:, :, None], axis=1)
        add["corners"].append(corners)
        add["stress"].append(stress.reshape(-1, stress.shape[2]))
        add["force"].append(body.force)
        add["material"].append(np.full(len(corners), len(add["compliance"])))
        add["compliance"].append(np.linalg.inv(body.elasticity))
        for cells, local, moments, held in self._merged(body, nodes):
            add["cells"].append(cells + first)
            add["facets"].append(local)
            add["moments"].append(moments)
            add["held"].append(held)
        self.counts.append(len(corners))

    def _merged(self, body: Body, nodes: Ints) -> list[tuple[Ints, Ints, Array, Array]]:
        """What acts on facets, each once: moments in the order of the ascending vertices."""
        d, k = self.dim, 0
        vertices = basix.topology(basix.CellType[body.cell])[d - 1]
        across = np.array([next(v for v in range(d + 1) if v not in facet) for facet in vertices])
        place = np.argsort(body.order, axis=1)
        on = _on_facets(d, body.degree)
        found: list[Any] = []
        for cells, local, moments, held in body.facets:
            number = place[cells, across[local]]
            wanted = nodes[cells[:, None], on[number]]  # (facets, nodes)
            dofs = closure_of(body, cells, local)
            order = np.argmax(dofs[:, None, :] == wanted[:, :, None], axis=2)
            found.append((cells, number, np.take_along_axis(moments, order[:, :, None], axis=1), held))
            k = moments.shape[1]
        if not found:
            return []
        keys = np.concatenate([cells * (d + 1) + number for cells, number, _, _ in found])
        once, inverse = np.unique(keys, return_inverse=True)
        sums = np.zeros((len(once), k, d))
        np.add.at(sums, inverse, np.concatenate([each[2] for each in found]))
        held = np.zeros((len(once), d, d))
        np.add.at(held, inverse, np.concatenate([each[3] for each in found]))
        values, axes = np.linalg.eigh(held)
        held = np.einsum("nik,nk,njk->nij", axes, (values > 0.5).astype(np.float64), axes)
        return [(once // (d + 1), once % (d + 1), sums.reshape(len(once), -1), held.reshape(len(once), -1))]

    def made(self, count: int) -> Equilibration:
        """The stress in balance."""
        if len(self.degrees) > 1:
            raise refused("its parts have displacements of different degrees")
        d, degree = self.dim, self.degrees.pop()
        x = np.zeros((count, d))
        for numbers, places in self.vertices:
            x[numbers] = places
        together = {
            k: np.concatenate(v) if v else np.zeros((0,)) for k, v in self.blocks.items() if k != "compliance"
        }
        size = d * len(_on_facets(d, degree)[0])
        return Equilibration(
            vertices=x.T,
            corners=together["corners"].ravel(),
            stress=together["stress"].T,
            force=together["force"].T,
            compliance=self.blocks["compliance"],
            material=together["material"],
            cells=together["cells"].astype(np.int64),
            facets=together["facets"].astype(np.int64),
            moments=together["moments"].reshape(-1, size).T,
            held=together["held"].reshape(-1, d * d).T,
        )


def _on_facets(d: int, degree: int) -> Ints:
    """(d + 1, nodes): of the facet across each vertex, its vertices and then its edges."""
    rows = []
    for across in range(d + 1):
        own = [v for v in range(d + 1) if v != across]
        pairs: Sequence[tuple[int, int]] = [(i, j) for i in range(d + 1) for j in range(i + 1, d + 1)]
        edges = [d + 1 + k for k, pair in enumerate(pairs) if across not in pair]
        rows.append(own + (edges if degree > 1 else []))
    return np.array(rows, dtype=np.int64)


def closure_of(body: Body, cells: Ints, local: Ints) -> Ints:
    """(facets, nodes) in the order of :meth:`FacetMap.closure_dofs`."""
    closure = np.array(body.element.entity_closure_dofs[body.part.dim - 1])[local]
    return np.take_along_axis(body.dofs[cells], closure, axis=1)
