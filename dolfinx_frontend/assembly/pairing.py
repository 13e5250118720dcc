"""Interface points, mass-free trace operators, and the geometric pairing of two sides.

Points are the quadrature points of the facets of side 1, pushed forward through the coordinate map
(straight or curved).  Side 2 is sampled at the closest points of its own facets, found with a
nearest neighbour search and Gauss-Newton inversion of the facet map.  Matching meshes are a special
case and not another path.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import basix
import numpy as np
import scipy.sparse as sp
from dolfinx import mesh as dmesh
from petsc4py import PETSc as _PETSc
from scipy.spatial import cKDTree

from dolfinx_frontend.assembly.averages import OPPOSED, Averages, average
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.scene.laws import Elastic, Law
from dolfinx_frontend.scene.scene import Overlap, PartLike, Space

__all__ = [
    "FaceCopy",
    "FacetMap",
    "Interface",
    "Side",
    "coordinate_element",
    "csr",
    "face_copy",
    "frames",
    "make_interface",
    "nodal_normals",
    "petsc_matrix",
    "quadrature",
    "tabulate",
]

PETSc: Any = _PETSc  # its stubs know no members


MAX_DISTANCE = 0.25
"""Default of the largest distance between the sides, as a fraction of the facet size."""


def petsc_matrix(matrix: sp.csr_matrix) -> Any:
    """Sequential PETSc AIJ matrix of a SciPy one (copied)."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    data = (
        matrix.indptr.astype(PETSc.IntType),
        matrix.indices.astype(PETSc.IntType),
        matrix.data.astype(np.float64),
    )
    out = PETSc.Mat().createAIJ(matrix.shape, csr=data, comm=PETSc.COMM_SELF)
    out.assemble()
    return out


def csr(matrix: Any) -> sp.csr_matrix:
    """SciPy copy of a sequential PETSc AIJ matrix."""
    indptr, indices, values = matrix.getValuesCSR()
    return sp.csr_matrix((values, indices, indptr), shape=matrix.getSize())


def coordinate_element(mesh: dmesh.Mesh) -> Any:
    """Scalar basix element of the coordinate map."""
    cmap = coordinate_map(mesh)
    return basix.create_element(
        basix.ElementFamily.P,
        basix.CellType[mesh.topology.cell_name()],
        cmap.degree,
        basix.LagrangeVariant(int(cmap.variant)),
    )


def tabulate(element: Any, derivatives: int, x: Array) -> Array:
    """Scalar shape functions, (1 [+ tdim], points, functions): values, then first derivatives."""
    if not len(x):  # basix ends the process
        return np.zeros((1 + derivatives * x.shape[1], 0, element.dim))
    return np.asarray(element.tabulate(derivatives, x))[:, :, :, 0]


def quadrature(cell: Any, degree: int) -> tuple[Array, Array]:
    """Points (q, tdim) and weights (q,) of a rule on a reference cell."""
    x, w = basix.make_quadrature(cell, degree)
    return np.asarray(x), np.asarray(w)


@dataclass(frozen=True, repr=False)
class Side:
    """One side of an interface.

    Attributes
    ----------
    substructure, face
        Names.
    trace
        T (d*m, n), petsc4py seqaij, no unit: w = T u in global components, row d*point + component,
        column d*node + component.
    shape
        The same for one component, (m, nodes of the substructure), SciPy.
    nodes
        Nodes (blocks of unknowns) on the face, sorted.
    node_normals
        (len(nodes), d), area-weighted unit normals out of this side at those nodes.
    flatness
        Largest difference between a facet normal and their mean; 0 for a plane face.
    normal
        (d,), area-weighted mean unit normal out of this side (0 if the face is closed).
    area
        Area of the whole face.
    """

    substructure: str
    face: str
    trace: Any = field(repr=False)
    shape: sp.csr_matrix = field(repr=False)
    nodes: Ints = field(repr=False)
    node_normals: Array = field(repr=False)
    flatness: float
    normal: Array
    area: float

    def __repr__(self) -> str:
        return f"Side({self.substructure}:{self.face}, area {self.area:.6g}, {len(self.nodes)} nodes)"


@dataclass(frozen=True, repr=False)
class Interface:
    """One or two sides with a law, discretised.

    Attributes
    ----------
    points
        (m, d), on side 1, length.
    weights
        (m,), areas > 0; their sum is the area of side 1.
    frames
        (m, d, d), rows n (out of side 1), t1[, t2]; right-handed.
    gap
        (m,), distance from side 1 to side 2 along n as meshed, length; zeros for one side.
    sag
        (m,), how far the meshed faces may be from the smooth ones, length: an estimate from the kinks
        between facets, see :meth:`FacetMap.sags`.
    matching
        None, or (nn, 2) nodes of side 1 and 2 at the same place, if the traces agree columnwise.
    tangent_axis
        Global axis whose projection is t1 (3D).
    space
        ``"points"``: values at quadrature points; ``"facets"``: means over the facets of side 1.
    facets
        (m,), the facet of side 1 that a point is on, numbered as in its :class:`FacetMap`.
    """

    name: str
    law: Law
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    frames: Array = field(repr=False)
    gap: Array = field(repr=False)
    sides: tuple[Side, ...]
    matching: Ints | None = field(repr=False)
    tangent_axis: int = field(repr=False)
    space: Space = "points"
    sag: Array = field(default_factory=lambda: np.zeros(1), repr=False)
    facets: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)

    def __repr__(self) -> str:
        sides = " | ".join(f"{s.substructure}:{s.face}" for s in self.sides)
        return (
            f"Interface({self.name!r}, {sides}, {self.law!r}, {self.num_points} {self.space}, "
            f"area {self.area:.6g})"
        )

    @property
    def clearance(self) -> Array:
        """The gap without interpenetration that is only that of chords, (m,), length.

        Two meshes of one round face have different chords, which cross.
        """
        crossing = (self.gap < 0.0) & (self.gap >= -self.sag)
        return np.where(crossing, 0.0, self.gap)

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.points.shape[1])

    @property
    def num_points(self) -> int:
        """Number of interface points m."""
        return len(self.weights)

    @property
    def area(self) -> float:
        """Area of side 1, of its covered part if the sides overlap partly."""
        return float(self.weights.sum())

    @property
    def normals(self) -> Array:
        """(m, d), unit normals out of side 1."""
        return self.frames[:, 0, :]

    def local_trace(self, side: int) -> sp.csr_matrix:
        """T of side 0 or 1 in the local frame of side 1, (d*m, n)."""
        d = self.dim
        shape = self.sides[side].shape.tocsr()
        point = np.repeat(np.arange(shape.shape[0]), np.diff(shape.indptr))
        blocks = shape.data[:, None, None] * self.frames[point]
        size = (d * shape.shape[0], d * shape.shape[1])
        return sp.bsr_matrix((blocks, shape.indices, shape.indptr), shape=size).tocsr()


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

    @property
    def space(self) -> Any:
        """Stands for the function space in the pairing."""
        variant = basix.LagrangeVariant(self.lagrange)
        element = basix.create_element(
            basix.ElementFamily.P, basix.CellType[self.cell], self.degree, variant
        )
        return SimpleNamespace(
            element=SimpleNamespace(basix_element=element),
            dofmap=SimpleNamespace(
                list=self.dofs, index_map=SimpleNamespace(size_local=len(self.coordinates))
            ),
            tabulate_dof_coordinates=lambda: self.coordinates,
        )


def face_copy(part: PartLike, face: str, space: Any, where: str) -> FaceCopy:
    """Copy of a face for another rank.

    Raises
    ------
    SceneError
        The face has no facets, or some inside the part.
    """
    facets = FacetMap(part, face, where)
    element = space.element.basix_element
    nodes, dofs = np.unique(np.asarray(space.dofmap.list)[facets.cells], return_inverse=True)
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
    )


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
        self.conormal: Array = np.asarray(
            basix.cell.facet_outward_normals(self.cell), dtype=np.float64
        )
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
        self.nodes: Array = copy.nodes

    def _read(self, part: PartLike, face: str, where: str) -> None:
        """The facets of a mesh."""
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
        x = np.einsum("pk,pki->pi", tables[0], nodes)
        jacobian = np.einsum("jpk,pki->pij", tables[1:], nodes)
        return x, jacobian

    def surface(self, index: Ints, s: Array) -> tuple[Array, Array, Array]:
        """Points (p, d), outward unit normals (p, d), area per area of the reference facet (p,)."""
        x, jacobian = self.push_forward(index, s)
        local = self.local[index]
        conormal = np.linalg.solve(
            np.swapaxes(jacobian, 1, 2), self.conormal[local][:, :, None]
        )[:, :, 0]
        length = np.linalg.norm(conormal, axis=1)
        area = np.abs(np.linalg.det(jacobian)) * length * self.scale[local]
        return x, conormal / length[:, None], area

    def quadrature(self, degree: int) -> tuple[Ints, Array, Array]:
        """Facet indices, facet coordinates and reference weights of all points, facet by facet."""
        s, w = quadrature(self.facet_cell, degree)
        if w.min() <= 0.0:
            raise SceneError(
                f"quadrature_degree = {degree}: the rule of degree {degree} on a "
                f"{self.facet_cell.name} has weights <= 0; choose another degree"
            )
        n = len(self)
        index = np.repeat(np.arange(n), len(w))
        return index, np.tile(s, (n, 1)), np.tile(w, n)

    def lattice(self) -> Array:
        """Coordinates of a few points that represent the reference facet, (k, fdim)."""
        points = np.asarray(
            basix.create_lattice(self.facet_cell, 2, basix.LatticeType.equispaced, True)
        )
        if self.facet_cell == basix.CellType.triangle:
            points = np.vstack([points, np.full((1, 2), 1 / 3)])
        return points

    @cached_property
    def samples(self) -> Array:
        """(facets, k, d), the lattice on every facet."""
        lattice = self.lattice()
        n, k = len(self), len(lattice)
        x, _ = self.push_forward(np.repeat(np.arange(n), k), np.tile(lattice, (n, 1)))
        return x.reshape(n, k, self.dim)

    @cached_property
    def sizes(self) -> Array:
        """(facets,), diagonal of the bounding box."""
        size: Array = np.linalg.norm(np.ptp(self.samples, axis=1), axis=1)
        return size

    @cached_property
    def sags(self) -> Array:
        """(facets,), estimated distance of the facets from the smooth face that they stand for, length.

        A chord of length h with the turn phi to its neighbours is h phi / 8 from the arc; curved facets
        have kinks too, which are smaller by two orders. Turns above 45 degrees are edges.
        """
        corners = np.asarray(basix.geometry(self.facet_cell))
        n, v = len(self), len(corners)
        index = np.repeat(np.arange(n), v)
        x, normals, _ = self.surface(index, np.tile(corners, (n, 1)))
        grid = np.round((x - x.min(axis=0)) / (1e-7 * self.sizes.max())).astype(np.int64)
        _, vertex = np.unique(grid, axis=0, return_inverse=True)
        vertex = vertex.ravel()
        mean = np.zeros((vertex.max() + 1, self.dim))
        np.add.at(mean, vertex, normals)
        mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
        cosine = np.einsum("pi,pi->p", normals, mean[vertex])
        turn = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
        turn = np.where(turn > np.pi / 4, 0.0, turn).reshape(n, v).max(axis=1)
        sag: Array = self.sizes * turn / 8.0
        return sag

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

    def closest(
        self, index: Ints, points: Array, along: Array | None = None
    ) -> tuple[Array, Array, Array]:
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
            # least squares by QR: the normal equations would lose thin facets
            q, r = np.linalg.qr(tangents)
            step = np.linalg.solve(r, np.swapaxes(q, 1, 2) @ residual[:, :, None])[:, :, 0]
            updated = np.clip(s[active] + step, -3.0, 4.0)
            change = np.abs(updated - s[active]).max(axis=1)
            s[active] = updated
            active = active[change > 1e-13]
            if not active.size:
                break
        inside = self.clamp(s)
        outside = np.abs(s - inside).max(axis=1)
        x, _ = self.push_forward(index, inside)
        return inside, x, outside

    def trace(
        self, space: Any, index: Ints, s: Array, columns: int
    ) -> sp.csr_matrix:
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
        matrix = sp.csr_matrix(
            (values.ravel(), dofs.ravel(), np.arange(0, p * k + 1, k)), shape=(p, columns)
        )
        matrix.sum_duplicates()
        return matrix

    def face_nodes(self, space: Any) -> Ints:
        """Nodes of a space on the face, sorted."""
        closure = np.array(space.element.basix_element.entity_closure_dofs[self.dim - 1])
        nodes = np.asarray(space.dofmap.list)[self.cells]
        out: Ints = np.unique(np.take_along_axis(nodes, closure[self.local], axis=1))
        return out.astype(np.int64)


def frames(normals: Array, axis: int | None = None) -> tuple[Array, int]:
    """Orthonormal frames, rows n, t1[, t2].

    In 2D t1 is n turned by +90 degrees.  In 3D t1 is the projection of one global axis, the same
    for all points: the one that stays farthest from the normals, so that frames vary smoothly on
    planes, cylinders and cones.  Where the normal comes close to that axis (spheres) the next one
    is used.

    Parameters
    ----------
    normals
        (m, d), unit.
    axis
        Global axis for t1; None: chosen.

    Returns
    -------
    frames, axis
        (m, d, d), and the axis that was used.
    """
    m, d = normals.shape
    out = np.empty((m, d, d))
    out[:, 0] = normals
    if d == 2:
        out[:, 1] = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        return out, 0
    if axis is None:
        axis = int(np.argmin(np.round(np.abs(normals).max(axis=0), 6)))
    use = np.full(m, axis)
    use[np.abs(normals[:, axis]) > 0.99] = (axis + 1) % 3
    e = np.eye(3)[use]
    t = e - np.einsum("pi,pi->p", e, normals)[:, None] * normals
    out[:, 1] = t / np.linalg.norm(t, axis=1)[:, None]
    out[:, 2] = np.cross(normals, out[:, 1])
    return out, axis


def nodal_normals(shape: sp.csr_matrix, weights: Array, normals: Array, nodes: Ints) -> Array:
    """Area-weighted unit normals at nodes.

    Parameters
    ----------
    shape
        (m, all nodes), shape functions at the points.
    weights, normals
        (m,), (m, d) at the points.
    nodes
        Nodes wanted.

    Returns
    -------
    Array
        (len(nodes), d).
    """
    share = abs(shape[:, nodes])  # |N|: quadratic vertex functions have zero mean on triangles
    mean = share.T @ (weights[:, None] * normals)
    length = np.linalg.norm(mean, axis=1)
    out: Array = mean / np.where(length > 0.0, length, 1.0)[:, None]
    return out


def _snap(normal: Array) -> Array:
    """A mean normal, made exact if it is a coordinate axis up to rounding."""
    rounded = np.round(normal)
    return rounded if np.abs(normal - rounded).max() < 1e-9 else normal


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
        normal=_snap(mean / length) if length > 1e-9 else np.zeros(facets.dim),
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
    if not np.all(np.isfinite(weights)) or weights.min() <= 0.0:
        raise SceneError(f"{where}: facets of {names[0]} have no area; mend the mesh")
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
        ratio = sides[1].area / sides[0].area
        if abs(ratio - 1.0) > 0.01 and overlap == "full":
            warnings.warn(
                f"{where}: the areas of {names[0]} ({sides[0].area:.6g}) and {names[1]} "
                f"({sides[1].area:.6g}) differ by more than 1 %; only the first one is joined",
                SceneWarning,
                stacklevel=4,
            )
        coordinates = tuple(
            v.tabulate_dof_coordinates()[: v.dofmap.index_map.size_local] for v in spaces
        )
        size = float(min(first.sizes.min(), second.sizes.min()))
        matching = _match(size, (sides[0], sides[1]), (coordinates[0], coordinates[1]))
        m, n = len(sampled.weights), len(sides[0].nodes)
        if space == "facets" and matching is None and m >= n and not isinstance(law, Elastic):
            warnings.warn(
                f"{where}: {m} facets but {n} nodes on {names[0]}: a law that prescribes the jump "
                "locks there and converges slowly; give the substructures degree=2",
                SceneWarning,
                stacklevel=4,
            )
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
