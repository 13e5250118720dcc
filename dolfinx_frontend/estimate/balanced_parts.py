"""Parts as the kernel takes them for stresses in balance: cells with ascending vertices, and tractions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import basix
import numpy as np
from latin_core import Equilibration

from dolfinx_frontend.assembly.elements import quadrature, tabulate
from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.balanced_cells import FACET_OF, Tables, cut, simplex_shapes
from dolfinx_frontend.scene.materials import VOIGT

__all__ = [
    "SETTINGS",
    "Body",
    "Facets",
    "Inputs",
    "Settings",
    "between_cells",
    "correct",
    "lifted",
    "refused",
    "strain_of",
    "tensor_of",
]


@dataclass(frozen=True)
class Settings:
    """Numbers that decide.

    Attributes
    ----------
    sweeps, enough
        Over the stars of facets at most, and the share of the energy below which what a sweep takes is not
        worth its time: a sixth of the factors' of stars, in which smooth answers have all but a tenth.
    rounding
        Relative: a balance or a polynomial that is off by less is exact.
    share
        Of the rounding: forces that an answer, or what makes up for them, may leave.
    loose
        Relative residual of displacements that part faces inside each other.
    rounds
        Of Newton's method for a pressure that never pulls, which takes as many as its zone changes.
    looked_at
        Cells of a part from which a direction is chosen along which cells are cut.
    """

    sweeps: int = 20
    enough: float = 0.15
    rounding: float = 1e-8
    share: float = 0.3
    loose: float = 1e-2
    rounds: int = 30
    looked_at: int = 100


SETTINGS = Settings()

_MOST = 20_000_000
"""Numbers that are worked on at once."""


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
        if self.cell not in FACET_OF or self.degree > 2:
            raise refused(
                f"{where} has {self.cell} cells of degree {self.degree}; stresses in balance there are on "
                f"{', '.join(FACET_OF)} of degree 1 and 2"
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
        self.x = part.dof_coordinates[self.vertices]  # (cells, vertices, d)
        self.corners = np.asarray(basix.geometry(basix.CellType[self.cell]))
        units = [int(np.argmin(np.abs(self.corners - axis).sum(axis=1))) for axis in np.eye(d)]
        self.edges = np.swapaxes(self.x[:, units] - self.x[:, :1], 1, 2)  # (cells, d, d) of the map
        affine = self.x[:, :1] + np.einsum("vm,ckm->cvk", self.corners, self.edges)
        off = np.abs(affine - self.x).max(axis=(1, 2))
        self.askew = off > SETTINGS.rounding * self._sizes  # no image of the reference cell
        if d == 3 and np.any(self.askew):
            raise refused(f"{where} has hexahedra that are no parallelepipeds")
        self.edges[self.askew] = self._sizes[self.askew, None, None] * np.eye(d)  # see _reference
        self.facet_nodes = np.array(element.entity_closure_dofs[d - 1])
        middles = 0.5 * (self.corners[:, None] + self.corners)
        points = np.asarray(element.points)
        self.between = np.argmin(np.abs(middles[:, :, None] - points).sum(axis=3), axis=2)
        self.force = np.zeros((len(dofs), d))
        self.acting = np.zeros_like(self.u)  # nodal forces of all loads and joints
        self.held = np.zeros((len(self.u), part.dim, part.dim))  # what supports take
        self.change = np.zeros_like(self.u)  # what these do
        self.lifted = np.zeros_like(self.u)  # to a displacement that is admissible
        self.facets: list[Facets] = []
        self.initial = np.zeros((*self.x.shape[:2], len(matrix)))

    def number(self, numbers: Ints) -> None:
        """Cut the cells along numbers (nodes,) of the nodes, that grow along like edges of like cells."""
        self.numbers = numbers
        self.order = numbers[self.vertices]
        self.local = cut(self.cell, self.order)  # (cells, simplices, d + 1)

    def nodes_of(self, cells: Ints, local: Ints) -> Ints:
        """(cells, simplices, nodes) at vertices (cells, simplices, k), then in the middles of edges."""
        found = [self.at_vertex[local]]
        if self.degree > 1:
            pairs = combinations(range(local.shape[2]), 2)
            found.append(np.stack([self.between[local[..., i], local[..., j]] for i, j in pairs], axis=2))
        inside = np.concatenate(found, axis=2)
        return np.asarray(self.dofs[cells[:, None, None], inside])

    @property
    def is_cut(self) -> bool:
        """Whether its cells are no simplices."""
        return len(self.corners) > self.part.dim + 1

    @property
    def _sizes(self) -> Array:
        return np.asarray(np.ptp(self.x, axis=1).max(axis=1))

    @property
    def volumes(self) -> Array:
        """(cells,) per volume of the reference cell."""
        return np.asarray(np.abs(np.linalg.det(self.edges)))

    def spread(self, force: Array) -> Array:
        """Nodal forces (nodes, d) of a force (d,) per volume."""
        x, w = quadrature(self.element.cell_type, (self.degree + 1) * self.part.dim)
        slopes = tabulate(_linear(self.cell), 1, x)[1:]
        sizes = np.abs(np.linalg.det(np.einsum("iqv,cvk->cqik", slopes, self.x)))
        each = (sizes * w) @ tabulate(self.element, 0, x)[0]
        share = np.bincount(self.dofs.ravel(), each.ravel(), len(self.u))
        return np.asarray(np.outer(share, force))

    def straight(self) -> bool:
        """Whether nodes of edges are in their middles."""
        if int(coordinate_map(self.part.part.mesh).degree) == 1:
            return True
        shape = tabulate(_linear(self.cell), 0, np.asarray(self.element.points))[0]
        places = np.einsum("nk,cki->cni", shape, self.x)
        off = np.abs(places - self.part.dof_coordinates[self.dofs]).max(axis=(1, 2))
        return bool(np.all(off <= SETTINGS.rounding * self._sizes))

    def energy(self, u: Array) -> float:
        """Twice the strain energy of displacements (nodes, d)."""
        flat = u.ravel()
        return max(float(flat @ (self.part.matrix @ flat)), 0.0) if u.any() else 0.0

    def energy_of_change(self) -> float:
        """Of the distance between what is in balance on the mesh and what is admissible."""
        return self.energy(self.lifted - self.change)

    @cached_property
    def ways(self) -> list[tuple[Tables, Ints]]:
        """Ways to cut cells, and the cells that are cut so."""
        nodes = self.nodes_of(np.arange(len(self.dofs)), self.local)
        inside = np.argmax(self.dofs[:, None, None, :] == nodes[..., None], axis=3)
        alone = np.where(self.askew, np.arange(len(self.dofs)), -1)
        keys = np.column_stack([alone, self.local.reshape(len(self.local), -1)])
        _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        alike = [np.flatnonzero(which.ravel() == way) for way in range(len(first))]
        return [
            (Tables.of(self.element, self._reference(k), self.local[k], inside[k]), cells)
            for k, cells in zip(first, alike, strict=True)
        ]

    def _reference(self, cell: int) -> Array:
        """Vertices of which it is an affine image."""
        return self.x[cell] / self._sizes[cell] if self.askew[cell] else self.corners

    def divided(self, more: Array) -> _Divided:
        """What balances on the mesh, and what tractions have to make up (cells, nodes, d) besides."""
        d, components = self.part.dim, len(self.elasticity)
        cells, simplices, corners = self.local.shape
        each = simplex_shapes(d, self.degree, 0, np.zeros((1, d))).shape[2]
        beyond = components * max(tables.beyond for tables, _ in self.ways)
        out = _Divided(
            np.zeros((cells, simplices, corners, components)), np.zeros((cells, simplices, each, d)),
            np.zeros((cells, simplices, beyond)), np.zeros(cells),
        )  # fmt: skip
        for tables, alike in self.ways:
            size = d * d * tables.slopes[0, 0].size
            for some in np.array_split(alike, 1 + len(alike) * size // _MOST):
                self._divide(out, tables, some, more)
        return out

    def _divide(self, out: _Divided, tables: Tables, cells: Ints, more: Array) -> None:
        """The same of cells that are cut in one way."""
        d, slopes = self.part.dim, tables.slopes
        u, volume = (self.u + self.change)[self.dofs[cells]], self.volumes[cells]
        inverse = np.linalg.inv(self.edges[cells])
        gradient = np.einsum("cik,misx,cmj->csxkj", u, slopes, inverse, optimize=True)
        strain = strain_of(gradient)  # (cells, simplices, columns, components)
        stress = strain @ self.elasticity.T
        beyond = d + 1 + tables.beyond
        out.orthogonal[cells] = volume * np.einsum(
            "s,csxa,csxa->c", tables.sizes, strain[:, :, beyond:], stress[:, :, beyond:]
        )
        initial = self.initial[cells[:, None, None], self.local[cells]]
        stress[:, :, : d + 1] -= np.einsum("csva,vx->csxa", initial, np.linalg.inv(tables.linear))
        out.stress[cells] = np.einsum("csxa,xv->csva", stress[:, :, : d + 1], tables.linear)
        if tables.beyond:
            known = np.swapaxes(stress[:, :, d + 1 : beyond], 2, 3)
            out.beyond[cells] = known.reshape(*known.shape[:2], -1)
        less = slopes.copy()
        less[..., : d + 1] -= tables.own
        less *= tables.sizes[:, None]
        forces = np.einsum("csxkl,cml,misx->cik", tensor_of(stress), inverse, less, optimize=True)
        forces -= tables.excess[:, None] * self.force[cells][:, None]
        forces = volume[:, None, None] * forces + more[cells]
        local = np.einsum("cmk,cik->cim", inverse, forces)
        edges = self.edges[cells]
        out.shift[cells] = np.einsum("ckm,samjn,cjn->csak", edges, tables.share, local, optimize=True)

    def excess_on_facets(self) -> Array:
        """(cells, facets, nodes, d) of the stress's own tractions: see ``OnFace.excess``."""
        out = np.zeros((len(self.dofs), *self.facet_nodes.shape, self.part.dim))
        for tables, cells in self.ways:
            u, inverse = (self.u + self.change)[self.dofs[cells]], np.linalg.inv(self.edges[cells])
            gradient = np.einsum("cik,mifx,cmj->cfxkj", u, tables.traces, inverse, optimize=True)
            stress = strain_of(gradient) @ self.elasticity.T
            stress -= tables.excess_on[:, :, None] * self.initial[cells].mean(axis=1)[:, None, None]
            normals = np.einsum("fm,cml,c->cfl", tables.normals, inverse, self.volumes[cells])
            out[cells] = np.einsum("cfxkl,cfl->cfxk", tensor_of(stress), normals)
        return out


def _linear(cell: str) -> Any:
    """The element of the coordinates of straight cells."""
    kind = basix.CellType[cell]
    return basix.create_element(basix.ElementFamily.P, kind, 1, basix.LagrangeVariant.equispaced)


def strain_of(gradient: Array) -> Array:
    """Engineering strains (..., components) of gradients (..., d, d)."""
    return np.stack(
        [
            gradient[..., i, j] if i == j else gradient[..., i, j] + gradient[..., j, i]
            for i, j in VOIGT[gradient.shape[-1]]
        ],
        axis=-1,
    )


def tensor_of(stress: Array) -> Array:
    """(..., d, d) of components (..., components)."""
    d = {3: 2, 6: 3}[stress.shape[-1]]
    out = np.zeros((*stress.shape[:-1], d, d))
    for a, (i, j) in enumerate(VOIGT[d]):
        out[..., i, j] = out[..., j, i] = stress[..., a]
    return out


@dataclass(frozen=True)
class _Divided:
    """The stress of a part on its simplices.

    Linear (cells, simplices, corners, components); what tractions are to make up besides (cells, simplices,
    nodes, d); the stress beyond (cells, simplices, n); energies (cells,) of what no stress in balance has.
    """

    stress: Array
    shift: Array
    beyond: Array
    orthogonal: Array


class Facets(NamedTuple):
    """Tractions on facets of simplices.

    Their vertices (n, d), cells (n,), moments (n, nodes, d) and projectors (n, d, d); moments with functions
    of the simplices less those of the cell (n, nodes of the cell, d), and whether these are of what a support
    takes (n,).
    """

    vertices: Ints
    cells: Ints
    moments: Array
    held: Array
    excess: Array
    taken: Flags


def correct(bodies: Sequence[Body], count: int, motions: Array) -> None:
    """What the forces that an answer leaves do to its parts, which stay glued and held (`Body.change`); but
    those that drive free motions (count * d, r), which are the iteration's error."""
    d = bodies[0].part.dim
    held, right, largest = np.zeros((count, d, d)), np.zeros((count, d)), 0.0
    for body in bodies:
        inner = (body.part.matrix @ body.u.ravel()).reshape(body.u.shape)
        largest = max(largest, np.abs(inner).max(initial=0.0), np.abs(body.acting).max(initial=0.0))
        np.add.at(right, body.numbers, body.acting - inner)
        np.add.at(held, body.numbers, body.held)
    free = _free(held)
    right = np.einsum("nij,nj->ni", free, right)
    enough = SETTINGS.share * SETTINGS.rounding * largest
    if np.abs(right).max(initial=0.0) <= enough:
        return
    project = _by_node(free)
    matrix = sp.csr_matrix(project.shape)
    for body in bodies:
        places = (d * body.numbers[:, None] + np.arange(d)).ravel()
        entries = np.ones(len(places)), (places, np.arange(len(places)))
        spread = sp.csr_matrix(entries, shape=(count * d, len(places)))
        matrix = matrix + spread @ body.part.matrix @ spread.T
    driven = right.ravel() - motions @ (motions.T @ right.ravel())
    found = solved_by_cg(project @ matrix @ project, driven, enough).reshape(-1, d)
    for body in bodies:
        body.change[:] = found[body.numbers]


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


def between_cells(bodies: Sequence[Body]) -> list[Array]:
    """By how much more tractions make up at nodes of cells (cells, nodes, d) of each body.

    Tested with functions of simplices instead of those of cells, what is continuous asks for nothing in the
    sum of both sides: so an exact stress needs no change.
    """
    out = [np.zeros((*body.dofs.shape, body.part.dim)) for body in bodies]
    keys, nodes, own = [], [], []
    solid = [k for k, body in enumerate(bodies) if body.cell == "hexahedron"]
    for body in (bodies[k] for k in solid):
        every = np.arange(len(body.dofs))[:, None, None]
        numbers = body.numbers[body.dofs[every, body.facet_nodes]]  # (cells, facets, nodes)
        order = np.argsort(numbers, axis=2)
        keys.append(np.take_along_axis(numbers, order, axis=2))
        nodes.append(np.take_along_axis(body.facet_nodes[None], order, axis=2))
        own.append(np.take_along_axis(body.excess_on_facets(), order[..., None], axis=2))
    if solid:
        flat = np.concatenate([each.reshape(-1, each.shape[2]) for each in keys])
        _, facet, sides = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
        sums = np.zeros((len(sides), *own[0].shape[2:]))
        np.add.at(sums, facet.ravel(), np.concatenate([each.reshape(-1, *each.shape[2:]) for each in own]))
        mean = (sums / sides[:, None, None])[facet.ravel()]  # outward ones: half of the jump, or the only one
        for k, at, each in zip(solid, nodes, own, strict=True):
            mine, mean = mean[: each.shape[0] * each.shape[1]], mean[each.shape[0] * each.shape[1] :]
            np.add.at(out[k], (np.arange(len(at))[:, None, None], at), each - mine.reshape(each.shape))
    return out


class Inputs:
    """Cells of all parts, as the kernel takes them."""

    def __init__(self, dim: int) -> None:
        self.dim = dim
        self.vertices: list[tuple[Ints, Array]] = []
        self.blocks: dict[str, list[Any]] = {
            k: [] for k in "corners stress force compliance material beyond shift facets moments held".split()
        }
        self.degrees: set[int] = set()
        self.initial = 0.0  # the largest one
        self.rests: list[Array] = []  # of each part (cells,), and simplices of a cell
        self.simplices: list[int] = []

    def add(self, body: Body, more: Array) -> None:
        """A part; `more` (cells, nodes, d) is asked of tractions besides what its stress lacks."""
        add, (cells, simplices, corners) = self.blocks, body.local.shape
        self.degrees.add(body.degree)
        self.vertices.append((body.order.ravel(), body.x.reshape(-1, self.dim)))
        for key, value in self._merged(body, more).items():
            add[key].append(value)
        divided = body.divided(more)
        numbers = np.take_along_axis(body.order, body.local.reshape(cells, -1), axis=1)
        self.initial = max(self.initial, float(np.abs(body.initial).max()))
        add["corners"].append(numbers.reshape(-1, corners))
        add["stress"].append(divided.stress.reshape(cells * simplices * corners, -1))
        add["force"].append(np.repeat(body.force, simplices, axis=0))
        add["material"].append(np.full(cells * simplices, len(add["compliance"])))
        add["compliance"].append(np.linalg.inv(body.elasticity))
        add["beyond"].append(divided.beyond.reshape(cells * simplices, -1))
        add["shift"].append(divided.shift.reshape(-1, self.dim))
        self.rests.append(divided.orthogonal)
        self.simplices.append(simplices)

    def _merged(self, body: Body, more: Array) -> dict[str, Array]:
        """What acts on facets, each once; `more` gets what simplices have of it beyond cells."""
        if not body.facets:
            return {}
        every = [np.concatenate(each) for each in zip(*body.facets, strict=True)]
        vertices, cells, moments, held, excess, taken = every
        once, inverse = np.unique(vertices, axis=0, return_inverse=True)
        inverse = inverse.ravel()
        sums, holds = np.zeros((len(once), *moments.shape[1:])), np.zeros((len(once), *held.shape[1:]))
        np.add.at(sums, inverse, moments)
        np.add.at(holds, inverse, held)
        values, axes = np.linalg.eigh(holds)
        holds = np.einsum("nik,nk,njk->nij", axes, (values > 0.5).astype(np.float64), axes)
        left = np.where(taken[:, None, None], 0.0, holds[inverse])
        np.add.at(more, cells, excess - np.einsum("nij,nkj->nki", left, excess))
        return {
            "facets": once,
            "moments": sums.reshape(len(once), -1),
            "held": holds.reshape(len(once), -1),
        }

    def made(self, count: int) -> Equilibration:
        """The stress in balance."""
        if len(self.degrees) > 1:
            raise refused("its parts have displacements of different degrees")
        d = self.dim
        x = np.zeros((count, d))
        for numbers, places in self.vertices:
            x[numbers] = places
        most = max(each.shape[1] for each in self.blocks["beyond"])
        self.blocks["beyond"] = [
            each if each.shape[1] == most else np.zeros((len(each), most)) for each in self.blocks["beyond"]
        ]
        size = d * simplex_shapes(d - 1, self.degrees.pop(), 0, np.zeros((1, d - 1))).shape[2]
        empty = {"facets": np.zeros((0, d)), "moments": np.zeros((0, size)), "held": np.zeros((0, d * d))}
        together = {
            k: np.concatenate(v) if v else empty[k] for k, v in self.blocks.items() if k != "compliance"
        }
        shift = together["shift"]
        return Equilibration(
            vertices=x.T,
            corners=together["corners"].ravel(),
            stress=together["stress"].T,
            force=together["force"].T,
            compliance=self.blocks["compliance"],
            material=together["material"],
            rest=together["beyond"].T,
            shift=shift.T if max(self.simplices) > 1 else np.zeros((d, 0)),
            facets=together["facets"].ravel().astype(np.int64),
            moments=together["moments"].T,
            held=together["held"].T,
        )

    def left(self) -> float:
        """What is left of initial stresses when parts have grown: rounding is relative to these."""
        stress = max(float(np.abs(each).max()) for each in self.blocks["stress"])
        return stress / max(stress, self.initial, 1e-300)

    def by_cells(self, energies: Array) -> list[Array]:
        """From those of all simplices: of the cells of each part, with what no stress in balance has."""
        out = []
        for rest, each in zip(self.rests, self.simplices, strict=True):
            own, energies = energies[: len(rest) * each], energies[len(rest) * each :]
            out.append(own.reshape(-1, each).sum(axis=1) + rest)
        return out
