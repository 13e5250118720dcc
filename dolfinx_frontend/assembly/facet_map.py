"""Facets of a face: maps, shape functions and closest points."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import basix
import numpy as np

from dolfinx_frontend.assembly.elements import DIGITS, EPS, coordinate_element, quadrature, tabulate
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.specs import PartLike

__all__ = ["FaceCopy", "FacetMap", "copied_nodes", "face_copy"]


_KINK = 1e-6
"""Turns between facets that are rounding, rad."""


@dataclass(frozen=True)
class FaceCopy:
    """The cells along a face with their unknowns: what another rank needs to pair it. Plain data.

    Attributes
    ----------
    cell, order, variant
        Cell name, degree and variant of its coordinate map.
    nodes, local
        (facets, nodes per cell, d) coordinates, and (facets,) number of the facet within its cell.
    degree, lagrange
        Degree and variant of the displacements.
    dofs, coordinates
        (facets, unknowns per cell), which of the nodes (k, 3) they are: numbers of the copy's own.
    around
        Whether the part is axisymmetric: areas are those of rings.
    """

    cell: str
    order: int
    variant: int
    nodes: Array = field(repr=False)
    local: Ints = field(repr=False)
    degree: int
    lagrange: int
    dofs: Ints = field(repr=False)
    coordinates: Array = field(repr=False)
    around: bool = False

    @property
    def space(self) -> Any:
        """Stands for the function space in the pairing."""
        variant = basix.LagrangeVariant(self.lagrange)
        element = basix.create_element(basix.ElementFamily.P, basix.CellType[self.cell], self.degree, variant)
        return SimpleNamespace(
            element=SimpleNamespace(basix_element=element),
            dofmap=SimpleNamespace(
                list=self.dofs, index_map=SimpleNamespace(size_local=len(self.coordinates))
            ),
            tabulate_dof_coordinates=lambda: self.coordinates,
        )


def copied_nodes(facets: FacetMap, space: Any) -> Ints:
    """Nodes of a space that a copy of the facets has, in its order: ascending."""
    return np.unique(np.asarray(space.dofmap.list, dtype=np.int64)[facets.cells])


def face_copy(part: PartLike, face: str, space: Any, where: str) -> FaceCopy:
    """Copy of a face for another rank.

    Raises
    ------
    SceneError
        The face has no facets, or some inside the part.
    """
    facets = FacetMap(part, face, where)
    element = space.element.basix_element
    nodes = copied_nodes(facets, space)
    dofs = np.searchsorted(nodes, np.asarray(space.dofmap.list)[facets.cells])
    cmap = coordinate_map(part.mesh)
    return FaceCopy(
        cell=facets.cell.name,
        order=facets.order,
        variant=int(cmap.variant),
        nodes=facets.nodes,
        local=facets.local,
        degree=int(element.degree),
        lagrange=int(element.lagrange_variant),
        dofs=dofs.reshape(len(facets), -1),
        coordinates=space.tabulate_dof_coordinates()[nodes],
        around=facets.around,
    )


def _numbered(rows: Ints) -> Ints:
    """(n,): rows (n, d) that are equal have the same number, from 0."""
    order = np.lexsort(rows.T)
    fresh = np.any(np.diff(rows[order], axis=0, prepend=rows[order[:1]] - 1) != 0, axis=1)
    out = np.empty(len(rows), dtype=np.int64)
    out[order] = np.cumsum(fresh) - 1
    return out


def _turned(tangents: Array) -> Array:
    """(p, d): what is normal to tangents (p, d, d - 1), as long as the area they span."""
    t = tangents[:, :, 0]
    if tangents.shape[1] == 2:
        return np.stack([-t[:, 1], t[:, 0]], axis=1)
    u = tangents[:, :, 1]
    turns = ((1, 2), (2, 0), (0, 1))
    return np.stack([t[:, i] * u[:, j] - t[:, j] * u[:, i] for i, j in turns], axis=1)


def _least_squares(tangents: Array, residual: Array) -> Array:
    """(p, d - 1): the coefficients of tangents (p, d, d - 1) that come nearest to residual (p, d).

    Tangent by tangent, as a QR factorisation: the normal equations would lose thin facets.
    """
    tiny = np.finfo(np.float64).tiny
    t = tangents[:, :, 0]
    length = np.maximum(np.sqrt((t * t).sum(axis=1)), tiny)
    t = t / length[:, None]
    along = (t * residual).sum(axis=1)
    if tangents.shape[2] == 1:
        return np.asarray(along / length)[:, None]
    both = (t * tangents[:, :, 1]).sum(axis=1)
    u = tangents[:, :, 1] - both[:, None] * t
    square = np.maximum((u * u).sum(axis=1), tiny)
    second = (u * (residual - along[:, None] * t)).sum(axis=1) / square
    return np.stack([(along - both * second) / length, second], axis=1)


class FacetMap:
    """The facets of one face of a part, as images of the reference facet.

    Parameters
    ----------
    part
        The part.
    face
        Name of the face.
    where
        Prefix of error messages.

    Attributes
    ----------
    cells, local
        (facets,), cell of each facet and the facet's number within it.
    nodes
        (facets, nodes per cell, d), coordinates of the cells.
    """

    def __init__(self, part: PartLike | FaceCopy, face: str, where: str) -> None:
        if isinstance(part, FaceCopy):
            self._take(part)
        else:
            self._read(part, face, where)
        self._surfaces: dict[bytes, tuple[Array, Array]] = {}
        tdim = self.dim
        corners = np.asarray(basix.geometry(self.cell))
        vertices = np.array(basix.topology(self.cell)[tdim - 1])
        self.origin: Array = corners[vertices[:, 0]]
        # (facets of the cell, tdim, fdim): tangents of the reference facet
        self.tangents: Array = np.stack(
            [corners[vertices[:, k]] - self.origin for k in range(1, tdim)], axis=2
        )
        gram = np.swapaxes(self.tangents, 1, 2) @ self.tangents
        self.scale: Array = np.sqrt(np.linalg.det(gram))
        self.conormal: Array = np.asarray(basix.cell.facet_outward_normals(self.cell), dtype=np.float64)
        self.facet_cell: basix.CellType = {
            "triangle": basix.CellType.interval,
            "quadrilateral": basix.CellType.interval,
            "tetrahedron": basix.CellType.triangle,
            "hexahedron": basix.CellType.quadrilateral,
        }[self.cell.name]

    def _take(self, copy: FaceCopy) -> None:
        """The facets of a copy, whose cells are numbered by facet."""
        self.dim = int(copy.nodes.shape[2])
        self.cell = basix.CellType[copy.cell]
        self.cells: Ints = np.arange(len(copy.local))
        self.local: Ints = copy.local
        self.element = basix.create_element(
            basix.ElementFamily.P, self.cell, copy.order, basix.LagrangeVariant(copy.variant)
        )
        self.order = copy.order
        self.around = copy.around
        self.nodes: Array = copy.nodes

    def _read(self, part: PartLike, face: str, where: str) -> None:
        """The facets of a mesh."""
        self.around = bool(getattr(part, "around", False))
        mesh = part.mesh
        tdim = mesh.topology.dim
        self.dim = int(mesh.geometry.dim)
        self.cell = basix.CellType[mesh.topology.cell_name()]
        facets = np.sort(part.facet_tags.find(part.names[face]))
        if not facets.size:
            raise SceneError(f"{where}: face {face!r} has no facets; check the tags of the part")
        mesh.topology.create_connectivity(tdim - 1, tdim)
        mesh.topology.create_connectivity(tdim, tdim - 1)
        to_cell = mesh.topology.connectivity(tdim - 1, tdim)
        to_facet = mesh.topology.connectivity(tdim, tdim - 1).array.reshape(
            -1, len(basix.topology(self.cell)[tdim - 1])
        )
        count = np.diff(to_cell.offsets)[facets]
        if np.any(count != 1):
            raise SceneError(
                f"{where}: {np.count_nonzero(count != 1)} facets of face {face!r} are inside the "
                "part; a face consists of exterior facets"
            )
        self.cells = to_cell.array[to_cell.offsets[facets]].astype(np.int64)
        self.local = np.argmax(to_facet[self.cells] == facets[:, None], axis=1)
        cmap = coordinate_map(mesh)
        self.element = coordinate_element(mesh)
        self.order = int(cmap.degree)
        x = np.asarray(mesh.geometry.x, dtype=np.float64)
        self.nodes = x[cell_nodes(mesh)[self.cells]][:, :, : self.dim]

    def __len__(self) -> int:
        return len(self.cells)

    def reference(self, index: Ints, s: Array) -> Array:
        """(p, tdim): points of the reference cell, of facet coordinates s (p, fdim)."""
        local = self.local[index]
        x: Array = self.origin[local] + np.einsum("pij,pj->pi", self.tangents[local], s)
        return x

    def push_forward(self, index: Ints, s: Array) -> tuple[Array, Array]:
        """Points x (p, d) and Jacobians dx/dX (p, d, tdim) of the cell map."""
        tables = tabulate(self.element, 1, self.reference(index, s))
        nodes = self.nodes[index]
        both = tables.transpose(1, 0, 2) @ nodes  # (p, value and derivatives, d)
        return both[:, 0], both[:, 1:].swapaxes(1, 2)

    def _alike(self, s: Array) -> Array:
        """(facets, d, 2 + fdim, q) at the same facet coordinates s (q, fdim) of all facets: points, tangents,
        and an image of the outward normal of the reference cell."""
        out = np.empty((len(self), self.dim, 1 + self.dim, len(s)))
        for number in np.unique(self.local):
            table = tabulate(self.element, 1, self.origin[number] + s @ self.tangents[number].T)
            along = np.column_stack([self.tangents[number], self.conormal[number]])
            both = np.concatenate([table[:1], np.tensordot(along, table[1:], axes=([0], [0]))])
            here = np.flatnonzero(self.local == number)
            out[here] = np.tensordot(self.nodes[here], both, axes=([1], [2]))
        return out

    def alike(self, s: Array) -> Array:
        """(facets, q, d), points at the same facet coordinates s (q, fdim) of all facets."""
        return self._alike(s)[:, :, 0].swapaxes(1, 2)

    def alike_normals(self, s: Array) -> tuple[Array, Array]:
        """(facets, q, d) normals of the map (tangent turned by 90 degrees; t_0 x t_1), as long as the area
        per area of the reference facet, and (facets, q), 1, or -1 where they point into the part."""
        both = self._alike(s).transpose(1, 2, 0, 3)  # (d, tangents, facets, q)
        t, outward = both[:, 1:-1], both[:, -1]
        if self.dim == 2:
            parts = [-t[1, 0], t[0, 0]]
        else:
            turns = ((1, 2), (2, 0), (0, 1))
            parts = [t[i, 0] * t[j, 1] - t[j, 0] * t[i, 1] for i, j in turns]
        out = np.zeros(both.shape[2:])
        for normal, direction in zip(parts, outward, strict=True):
            out += normal * direction
        return np.stack(parts, axis=2), np.where(out < 0.0, -1.0, 1.0)

    def alike_surface(self, s: Array) -> tuple[Array, Array]:
        """Outward unit normals (facets, q, d), and area (of rings, if axisymmetric) per area of the reference
        facet (facets, q), at the same facet coordinates s (q, fdim) of all facets; to be read."""
        known = s.tobytes()  # the same rule is asked for several times
        if known not in self._surfaces:
            self._surfaces[known] = self._alike_surface(s)
        return self._surfaces[known]

    def _alike_surface(self, s: Array) -> tuple[Array, Array]:
        normals, sign = self.alike_normals(s)
        size = np.sqrt((normals * normals).sum(axis=2))
        unit = normals * (sign / np.where(size > 0.0, size, 1.0))[:, :, None]
        return unit, size * 2.0 * np.pi * self.alike(s)[:, :, 0] if self.around else size

    def closure_dofs(self, space: Any) -> Ints:
        """(facets, k): the nodes of a space on each facet, in the order of the cell's closure."""
        closure = np.array(space.element.basix_element.entity_closure_dofs[self.dim - 1])
        nodes = np.asarray(space.dofmap.list)[self.cells]
        return np.take_along_axis(nodes, closure[self.local], axis=1).astype(np.int64)

    def alike_shapes(self, space: Any, s: Array) -> Array:
        """(facets, q, k): shape functions of `closure_dofs` at the same facet coordinates of all facets."""
        element = space.element.basix_element
        closure = np.array(element.entity_closure_dofs[self.dim - 1])
        every = np.stack(
            [
                tabulate(element, 0, self.origin[number] + s @ self.tangents[number].T)[0][:, closure[number]]
                for number in range(len(closure))
            ]
        )
        return every[self.local]

    def surface(self, index: Ints, s: Array) -> tuple[Array, Array, Array]:
        """Points (p, d), outward unit normals (p, d), area per area of the reference facet (p,)."""
        x, jacobian = self.push_forward(index, s)
        local = self.local[index]
        normal = _turned(jacobian @ self.tangents[local])
        outward = (jacobian @ self.conormal[local][:, :, None])[:, :, 0]
        area: Array = np.sqrt((normal * normal).sum(axis=1))
        sign = np.where((normal * outward).sum(axis=1) < 0.0, -1.0, 1.0)
        normal = normal * (sign / np.where(area > 0.0, area, 1.0))[:, None]
        if self.around:
            area = area * 2.0 * np.pi * x[:, 0]
        return x, normal, area

    def rule(self, degree: int) -> tuple[Array, Array]:
        """Facet coordinates (q, fdim) and weights (q,) on the reference facet.

        Raises
        ------
        SceneError
            The rule of this degree has weights <= 0.
        """
        s, w = quadrature(self.facet_cell, degree)
        if w.min() <= 0.0:
            raise SceneError(
                f"quadrature_degree = {degree}: the rule of degree {degree} on a "
                f"{self.facet_cell.name} has weights <= 0; choose another degree"
            )
        return s, w

    def quadrature(self, degree: int) -> tuple[Ints, Array, Array]:
        """Facet indices, facet coordinates and reference weights of all points, facet by facet."""
        s, w = self.rule(degree)
        n = len(self)
        index = np.repeat(np.arange(n), len(w))
        return index, np.tile(s, (n, 1)), np.tile(w, n)

    def lattice(self) -> Array:
        """Coordinates of a few points that represent the reference facet, (k, fdim)."""
        points = np.asarray(basix.create_lattice(self.facet_cell, 2, basix.LatticeType.equispaced, True))
        if self.facet_cell == basix.CellType.triangle:
            points = np.vstack([points, np.full((1, 2), 1 / 3)])
        return points

    @cached_property
    def samples(self) -> Array:
        """(facets, k, d), the lattice on every facet."""
        return self.alike(self.lattice())

    @cached_property
    def sizes(self) -> Array:
        """(facets,), diagonal of the bounding box."""
        size: Array = np.linalg.norm(np.ptp(self.samples, axis=1), axis=1)
        return size

    def areas(self, weights: Array, where: str, name: str) -> Array:
        """(facets,), the sum of the weights on each; refuses facets that are nothing, or below the rounding.

        Parameters
        ----------
        weights
            (facets, q), areas or lengths.
        where, name
            For the message: the interface, and the face.

        Raises
        ------
        SceneError
            If there is one.
        """
        if not np.all(np.isfinite(weights)) or weights.min(initial=np.inf) <= 0.0:
            axis = ": a face on the axis of an axisymmetric part is none" if self.around else ""
            raise SceneError(f"{where}: facets of {name} have no area{axis}; fix the mesh")
        areas: Array = weights.sum(axis=1)
        width = float((areas / self.sizes ** (self.dim - 2)).min(initial=np.inf))
        far = float(np.abs(self.nodes).max(initial=0.0))
        if width < DIGITS * far:
            raise SceneError(
                f"{where}: facets of {name} are {width:.3g} wide, and coordinates of {far:.3g} are rounded "
                f"to {far * EPS:.2g}; move the mesh to the origin, or fix it"
            )
        return areas

    @cached_property
    def _turns(self) -> tuple[Array, Array]:
        """(facets,) each, angles between the normals of a facet and of its neighbours, and within it."""
        corners = np.asarray(basix.geometry(self.facet_cell))
        n, v = len(self), len(corners)
        normals = self.alike_surface(corners)[0].reshape(n * v, -1)
        if np.ptp(normals, axis=0).max() < EPS:
            return np.zeros(n), np.zeros(n)  # a plane
        x = self.alike(corners).reshape(n * v, -1)
        grid = np.round((x - x.min(axis=0)) / (1e-7 * self.sizes.max())).astype(np.int64)
        vertex = _numbered(grid)
        mean = np.zeros((vertex.max() + 1, self.dim))
        np.add.at(mean, vertex, normals)
        mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
        cosine = np.einsum("pi,pi->p", normals, mean[vertex])
        turn = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
        turn = np.where(turn > np.pi / 4, 0.0, turn).reshape(n, v).max(axis=1)
        own = normals.reshape(n, v, -1)
        middle = own.mean(axis=1, keepdims=True)
        middle /= np.linalg.norm(middle, axis=2, keepdims=True)
        inner = 2.0 * np.arccos(np.clip((own * middle).sum(axis=2), -1.0, 1.0)).max(axis=1)
        return turn, np.asarray(inner, dtype=np.float64)

    @cached_property
    def sags(self) -> Array:
        """(facets,), estimated distance of the facets from the smooth face that they stand for, length.

        A chord of length h with the turn phi to its neighbours is h phi / 8 from the arc; curved facets
        have kinks too, which are smaller by two orders. Turns above 45 degrees are edges.
        """
        return np.asarray(self.sizes * self._turns[0] / 8.0, dtype=np.float64)

    def _middles(self) -> tuple[Array, Array]:
        """(facets, edges, d) each: middles of edges from those of straight ones, and the straight ones."""
        corners = np.asarray(basix.geometry(self.facet_cell))
        pairs = np.array(basix.topology(self.facet_cell)[1])
        x = self.alike(corners)
        middle = self.alike(corners[pairs].mean(axis=1))
        return middle - x[:, pairs].mean(axis=2), x[:, pairs[:, 1]] - x[:, pairs[:, 0]]

    @cached_property
    def bend(self) -> float:
        """How far the middles of edges are from those of straight ones, relative to the size of facets."""
        off = np.linalg.norm(self._middles()[0], axis=2).max(axis=1)
        return float((off / self.sizes).max())

    @cached_property
    def uneven(self) -> Array:
        """(facets,), how far the middles of edges are off the middle along them, relative to their length."""
        if self.order == 1:
            return np.zeros(len(self))
        off, edge = self._middles()
        along = np.abs((off * edge).sum(axis=2)) / np.maximum((edge * edge).sum(axis=2), 1e-300)
        return np.asarray(along.max(axis=1), dtype=np.float64)

    @cached_property
    def edges_bend(self) -> Array:
        """(facets,), how far the middles of edges are beside straight ones, relative to these."""
        if self.order == 1:
            return np.zeros(len(self))
        off, edge = self._middles()
        squared = np.maximum((edge * edge).sum(axis=2, keepdims=True), 1e-300)
        beside = off - (off * edge).sum(axis=2, keepdims=True) / squared * edge
        out: Array = np.sqrt((beside * beside).sum(axis=2) / squared[:, :, 0]).max(axis=1)
        return out

    @property
    def plane(self) -> bool:
        """Whether all facets have one normal."""
        return max(float(turn.max(initial=0.0)) for turn in self._turns) < _KINK

    @cached_property
    def chords(self) -> Array:
        """(facets,), the same where facets are straight and the face is not; 0 elsewhere."""
        turn, inner = self._turns
        return np.where((turn > _KINK) & (turn > inner), self.sags, 0.0)

    def clamp(self, s: Array) -> Array:
        """The nearest point of the reference facet (in its own coordinates)."""
        out = np.clip(s, 0.0, 1.0)
        if self.facet_cell == basix.CellType.triangle:
            excess = np.maximum(s.sum(axis=1) - 1.0, 0.0)
            beyond = excess > 0.0
            # onto the hypotenuse, then onto its ends
            along = np.clip(0.5 * (1.0 + s[:, 0] - s[:, 1]), 0.0, 1.0)
            hypotenuse = np.stack([along, 1.0 - along], axis=1)
            out = np.where(beyond[:, None], hypotenuse, out)
        return out

    def closest(self, index: Ints, points: Array, along: Array | None = None) -> tuple[Array, Array, Array]:
        """Closest point of facet index[p] to points[p], or to a line through it.

        Parameters
        ----------
        index, points
            (p,), (p, d).
        along
            (p, d), unit directions of the lines; None: the closest point to points[p] itself.

        Returns
        -------
        s
            (p, fdim), coordinates of the closest point, within the reference facet.
        x
            (p, d), the closest point.
        outside
            (p,), how far the foot of the perpendicular is outside the reference facet.
        """
        s = np.full((len(index), self.dim - 1), 1 / 3 if self.dim == 3 else 0.5)
        active = np.arange(len(index))
        affine = self.order == 1 and self.facet_cell != basix.CellType.quadrilateral
        for _ in range(2 if affine else 30):  # one step does it; the second polishes
            x, jacobian = self.push_forward(index[active], s[active])
            tangents = jacobian @ self.tangents[self.local[index[active]]]
            residual = points[active] - x
            if along is not None:  # what is beside the line
                n = along[active]
                residual = residual - np.einsum("pi,pi->p", residual, n)[:, None] * n
                tangents = tangents - n[:, :, None] * np.einsum("pi,pij->pj", n, tangents)[:, None]
            updated = np.clip(s[active] + _least_squares(tangents, residual), -3.0, 4.0)
            change = np.abs(updated - s[active]).max(axis=1)
            s[active] = updated
            active = active[change > 1e-13]
            if not active.size:
                break
        inside = self.clamp(s)
        outside = np.abs(s - inside).max(axis=1)
        x, _ = self.push_forward(index, inside)
        return inside, x, outside

    def trace(self, space: Any, index: Ints, s: Array, columns: int) -> sp.csr_matrix:
        """Shape functions of a scalar component at points of the facets, (p, columns)."""
        element = space.element.basix_element
        closure = np.array(element.entity_closure_dofs[self.dim - 1])[self.local[index]]
        values = np.empty(closure.shape)
        for chunk in np.array_split(np.arange(len(index)), 1 + len(index) // 50_000):
            table = tabulate(element, 0, self.reference(index[chunk], s[chunk]))[0]
            values[chunk] = np.take_along_axis(table, closure[chunk], axis=1)
        nodes = np.asarray(space.dofmap.list)[self.cells[index]]
        dofs = np.take_along_axis(nodes, closure, axis=1)
        p, k = closure.shape
        matrix = sp.csr_matrix((values.ravel(), dofs.ravel(), np.arange(0, p * k + 1, k)), shape=(p, columns))
        matrix.sum_duplicates()
        return matrix

    def alike_trace(self, space: Any, s: Array, columns: int) -> sp.csr_matrix:
        """As :meth:`trace`, at the same facet coordinates s (q, fdim) of all facets, facet by facet."""
        values = self.alike_shapes(space, s)
        p, k = len(self) * len(s), values.shape[2]
        dofs = np.repeat(self.closure_dofs(space), len(s), axis=0)
        matrix = sp.csr_matrix((values.ravel(), dofs.ravel(), np.arange(0, p * k + 1, k)), shape=(p, columns))
        matrix.sum_duplicates()
        return matrix

    def face_nodes(self, space: Any) -> Ints:
        """Nodes of a space on the face, sorted."""
        return np.unique(self.closure_dofs(space))
