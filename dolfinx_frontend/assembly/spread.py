"""A part whose mesh is spread over the ranks: one factor of all of them, condensed to its faces.

The unknowns on the faces that the scene joins or holds, b, are kept, all others, i, are eliminated by PETSc
(MUMPS, or what options with the prefix ``latin_part_`` say) on the mesh's communicator:

    S = K_bb - K_bi K_ii^-1 K_ib,     f = f_b - K_bi K_ii^-1 f_i.

The rank that owns the part gets S with the mesh of the cells along these faces. From there on it is a part as
any other. Of these cells the nodes off the faces follow those on them: springs hold each where the rigid
motion that is nearest to that of its cell's nodes on the face would take it. They carry no load, so the
springs have no force, and S is what is left when such nodes are eliminated; their displacements are not those
of the part, which :meth:`Condensed.displacement` tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import dolfinx.fem as fem
import dolfinx.fem.petsc as fem_petsc
import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import mesh as dmesh
from mpi4py import MPI
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.assembly.substructure import Substructure, form_of, load_form, modulus_of
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map, create_mesh
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.specs import SubstructureSpec
from dolfinx_frontend.scene.values import is_random_field

__all__ = ["Condensed", "SpreadPart", "condensed"]

PETSc: Any = _PETSc  # its stubs know no members

PREFIX = "latin_part_"
BLOCK = 128
"""Columns that are solved for at once."""

_TOGETHER = 27
"""MUMPS' ICNTL for that number."""

MOST = 16_000
"""Unknowns that are kept, at most: their matrix is dense (2 GB)."""


class _Skin(NamedTuple):
    """Cells along faces: geometry nodes and nodes of unknowns by their global numbers, facets as (cell,
    number in it, tag)."""

    cells: Ints
    nodes: Ints
    x: Array
    dofs: Ints
    places: Ints
    coordinates: Array
    facets: Ints


def _along(part: Any, space: Any, faces: Sequence[str]) -> _Skin:
    """The cells of this rank along some faces."""
    mesh, d = part.mesh, int(part.mesh.geometry.dim)
    topology, tdim = mesh.topology, mesh.topology.dim
    topology.create_connectivity(tdim - 1, tdim)
    topology.create_connectivity(tdim, tdim - 1)
    tags = part.facet_tags
    wanted = [part.names[face] for face in faces]
    at = np.flatnonzero(np.isin(tags.values, wanted))
    facets, values = np.asarray(tags.indices)[at], np.asarray(tags.values)[at]
    to_cell = topology.connectivity(tdim - 1, tdim)
    cells = to_cell.array[to_cell.offsets[facets]] if len(facets) else np.zeros(0, dtype=np.int32)
    own = cells < topology.index_map(tdim).size_local  # a facet is told by the rank of its cell
    facets, values, cells = facets[own], values[own], cells[own]
    kept, of_kept = np.unique(cells, return_inverse=True)
    to_facet = topology.connectivity(tdim, tdim - 1)
    a_cell = len(to_facet.links(0))
    number = np.argmax(to_facet.array.reshape(-1, a_cell)[cells] == facets[:, None], axis=1)
    geometry, unknowns = cell_nodes(mesh)[kept], np.asarray(space.dofmap.list)[kept]
    local_nodes, local_dofs = np.unique(geometry), np.unique(unknowns)
    global_nodes = mesh.geometry.index_map().local_to_global(local_nodes.astype(np.int32))
    global_dofs = space.dofmap.index_map.local_to_global(local_dofs.astype(np.int32))
    return _Skin(
        global_nodes[np.searchsorted(local_nodes, geometry)],
        global_nodes,
        np.asarray(mesh.geometry.x)[local_nodes][:, :d],
        global_dofs[np.searchsorted(local_dofs, unknowns)],
        global_dofs,
        space.tabulate_dof_coordinates()[local_dofs][:, :d],
        np.column_stack([of_kept, number, values]).astype(np.int64),
    )


def _joined(skins: Sequence[_Skin]) -> _Skin:
    """The cells of all ranks; nodes and unknowns are numbered from 0 in the order of their global numbers."""
    nodes, first = np.unique(np.concatenate([s.nodes for s in skins]), return_index=True)
    places, at = np.unique(np.concatenate([s.places for s in skins]), return_index=True)
    starts = np.cumsum([0, *(len(s.cells) for s in skins)])
    shift = [np.array([start, 0, 0]) for start in starts]
    cells = [s.cells for s in skins if len(s.cells)]
    dofs = [s.dofs for s in skins if len(s.cells)]
    return _Skin(
        np.searchsorted(nodes, np.concatenate(cells)),
        nodes,
        np.concatenate([s.x for s in skins])[first],
        np.searchsorted(places, np.concatenate(dofs)),
        places,
        np.concatenate([s.coordinates for s in skins])[at],
        np.concatenate([s.facets + move for s, move in zip(skins, shift, strict=False)]),
    )


def _meshed(part: Any, skin: _Skin) -> Part:
    """The cells as a mesh of this rank, with the names of the faces."""
    mesh = create_mesh(skin.cells, skin.x, str(part.mesh.topology.cell_name()), _order(part))
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    mesh.topology.create_connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    new_cells = np.argsort(np.asarray(mesh.topology.original_cell_index))
    by_cell = to_facet.array.reshape(-1, len(to_facet.links(0)))
    facets = by_cell[new_cells[skin.facets[:, 0]], skin.facets[:, 1]]
    order = np.argsort(facets)
    values = skin.facets[order, 2].astype(np.int32)
    return Part(mesh, dmesh.meshtags(mesh, tdim - 1, facets[order], values), dict(part.names))


def _order(part: Any) -> int:
    return int(coordinate_map(part.mesh).degree)


def _numbers(space: Any, skin: _Skin) -> Ints:
    """Node of the space -> node of the skin. The nodes of a cell may come in another order."""
    mine = space.dofmap.list
    theirs = skin.dofs[np.asarray(space.mesh.topology.original_cell_index)]
    x = space.tabulate_dof_coordinates()[:, : skin.x.shape[1]]
    away = np.linalg.norm(x[mine][:, :, None] - skin.coordinates[theirs][:, None], axis=3)
    out = np.zeros(len(x), dtype=np.int64)
    out[mine] = np.take_along_axis(theirs, np.argmin(away, axis=2), axis=1)
    return out


@dataclass(frozen=True, eq=False, repr=False)
class Condensed:
    """What all ranks keep of a part that is spread over them.

    Attributes
    ----------
    space
        Displacements on the whole mesh.
    loads
        Constant body forces at the inner unknowns of this rank.
    inner, kept
        Unknowns of this rank, numbered on it, that are eliminated and kept.
    coupling
        K_ib (inner of this rank, all kept).
    rows
        (kept,) unknowns of the part on the owner, in the order of the kept; None elsewhere.
    """

    name: str
    owner: int
    space: Any
    loads: Array
    inner: Ints
    kept: Ints
    coupling: sp.csr_matrix
    rows: Ints | None
    _solver: Any = field(repr=False)

    def displacement(self, unknowns: Array | None) -> Any:
        """The displacement on the whole mesh, a dolfinx function. Collective.

        Parameters
        ----------
        unknowns
            (n,) of the part as the result has them; on its owner, None elsewhere.
        """
        comm, d = self.space.mesh.comm, int(self.space.dofmap.bs)
        values: Any = None
        with agreement(comm):
            if self.rows is not None:
                values = np.asarray(unknowns, dtype=np.float64)[self.rows]
        values = comm.bcast(values, root=self.owner)
        found = fem.Function(self.space, name=self.name)
        right = self.loads - self.coupling @ values
        found.x.array[self.inner] = self._solver(right[:, None])[:, 0]
        first = self.space.dofmap.index_map.local_range[0] * d
        found.x.array[self.kept] = values[np.searchsorted(self._solver.places, first + self.kept)]
        found.x.scatter_forward()
        return found


class _Inverse:
    """K_ii^-1 on the columns that the ranks have rows of."""

    def __init__(self, matrix: Any, places: Ints, where: str) -> None:
        self.places = places
        self._pc = PETSc.PC().create(matrix.getComm())
        self._pc.setOptionsPrefix(PREFIX)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc.setOperators(matrix)
        self._pc.setType(PETSc.PC.Type.CHOLESKY)
        self._pc.setFactorSolverType("mumps")
        self._pc.setFromOptions()
        self._pc.setFactorSetUpSolverType()
        if self._pc.getFactorSolverType() == "mumps":
            self._pc.getFactorMatrix().setMumpsIcntl(_TOGETHER, BLOCK)
        try:
            self._pc.setUp()
        except PETSc.Error as error:
            raise SceneError(f"{where}: PETSc could not factorise it on its ranks: {error}") from None
        self._matrix = matrix

    def __call__(self, right: Array) -> Array:
        rows, columns = right.shape
        sizes = ((rows, self._matrix.getSize()[0]), (PETSc.DECIDE, columns))
        b = PETSc.Mat().createDense(sizes, comm=self._matrix.getComm())
        b.setUp()
        b.getDenseArray()[:] = right
        b.assemble()
        x = b.duplicate()
        self._pc.getFactorMatrix().matSolve(b, x)
        found: Array = np.array(x.getDenseArray())
        b.destroy()
        x.destroy()
        return found


class SpreadPart(NamedTuple):
    """A condensed part: what all ranks keep, and on its owner the part and its description."""

    condensed: Condensed
    spec: SubstructureSpec | None
    part: Substructure | None


class _Rows:
    """The rows of this rank of a matrix, applied to what it has of a vector; every rank does."""

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix
        self._x, self._y = matrix.createVecs()

    def __matmul__(self, own: Array) -> Array:
        self._x.array[:] = own
        self._matrix.mult(self._x, self._y)
        return np.array(self._y.array)


def _check(spec: SubstructureSpec, comm: Any, loaded: bool, faces: Sequence[str]) -> None:
    where = f"substructure {spec.name!r}"
    if comm is None or MPI.Comm.Compare(spec.part.mesh.comm, comm) not in (MPI.IDENT, MPI.CONGRUENT):
        raise SceneError(
            f"{where}: its mesh is spread over processes: assemble(scene, comm=...) with the communicator of "
            "the mesh, or make it on COMM_SELF"
        )
    if not faces:
        raise SceneError(f"{where}: its mesh is spread over processes, and nothing joins or holds it")
    unknown = [face for face in faces if face not in spec.part.names]
    if unknown:
        raise SceneError(f"{where}: it has no face {unknown[0]!r}; there are {', '.join(spec.part.names)}")
    for wrong, what in (
        (spec.axisymmetric, "an axisymmetric scene"),
        (is_random_field(spec.stiffness), "a random field of its stiffness"),
        (loaded, "temperatures, strains and other loads of parts"),
    ):
        if wrong:
            raise SceneError(
                f"{where}: its mesh is spread over processes, which {what} cannot have: make it on COMM_SELF"
            )


def condensed(
    spec: SubstructureSpec, comm: Any, owner: int, faces: Sequence[str], loaded: bool
) -> SpreadPart:
    """Assemble, factorise and condense a part on the communicator of its mesh; collective.

    Parameters
    ----------
    owner
        The rank that is given the condensed part.
    faces
        Those that the scene uses.
    loaded
        Whether the scene has loads of this part beside its body force.

    Raises
    ------
    SceneError
        On all ranks: another communicator, something that such a part cannot have, or too many unknowns along
        its faces.
    """
    where = f"substructure {spec.name!r}"
    with agreement(comm):
        _check(spec, comm, loaded, faces)
        mesh, d = spec.part.mesh, spec.dim
        space = fem.functionspace(mesh, ("Lagrange", spec.degree, (d,)))
        form, _ = form_of(spec, space)
        own = _along(spec.part, space, faces)
    skins = comm.gather(own, root=owner)
    face: _Face | None = None
    with agreement(comm):
        if comm.rank == owner:
            face = _on_face(spec, _joined(skins))
    places = comm.bcast(None if face is None else face.places, root=owner)
    if not 0 < d * len(places) <= MOST:
        raise SceneError(
            f"{where}: its mesh is spread over processes, and {d * len(places)} of its unknowns are on the "
            f"faces {', '.join(faces)}: 1 to {MOST} can be kept; cut the part there, or join smaller faces"
        )
    matrix = fem_petsc.assemble_matrix(form)
    matrix.assemble()
    inverse, blocks, kept, inner = _eliminated(matrix, d, places, where)
    first = space.dofmap.index_map.local_range[0]
    loads: dict[Any, Array] = {}
    varies = isinstance(spec.body_force, Varying)
    for amplitude, force in spec.body_force.terms if varies else ((None, spec.body_force),):
        loads[amplitude] = loads.get(amplitude, 0.0) + _load(spec, space, force)
    with_load = {a: f for a, f in loads.items() if comm.allreduce(float(np.abs(f).max(initial=0.0))) > 0.0}
    coupling, of_kept = blocks
    total = _summed(comm, owner, _columns(inverse, coupling, of_kept, d * len(places)), d * len(places))
    forces: dict[Any, Array | None] = {}
    for amplitude, f in with_load.items():
        own_b = np.zeros(d * len(places))
        own_b[np.searchsorted(inverse.places, d * first + kept)] = f[kept]
        own_b -= coupling.T @ inverse(f[inner][:, None])[:, 0]
        forces[amplitude] = comm.reduce(own_b, root=owner)
    volume, centre = _size(comm, mesh, d)
    x = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, :d]
    modulus = comm.allreduce(modulus_of(_Rows(matrix), x - centre, volume))
    rows, part = None, None
    with agreement(comm):
        if face is not None:
            assert total is not None
            rows = (d * face.kept[:, None] + np.arange(d)).ravel()
            part = _part(face, rows, total, forces, volume, centre, modulus)
    constant = loads.get(None, np.zeros(len(x) * d))
    of_all = Condensed(spec.name, owner, space, constant[inner], inner, kept, coupling, rows, inverse)
    return SpreadPart(of_all, None if face is None else face.spec, part)


class _Face(NamedTuple):
    """On the owner: the cells along the faces as a part with its space, the nodes that are kept, their global
    numbers (ascending), and how others follow them."""

    spec: SubstructureSpec
    space: Any
    kept: Ints
    places: Ints
    follows: sp.csr_matrix


def _on_face(spec: SubstructureSpec, skin: _Skin) -> _Face:
    """The nodes on the faces, and how the others of their cells follow them."""
    made = replace(spec, source=_meshed(spec.part, skin))
    d = spec.dim
    space = fem.functionspace(made.part.mesh, ("Lagrange", spec.degree, (d,)))
    numbers = _numbers(space, skin)
    on = fem.locate_dofs_topological(space, made.part.mesh.topology.dim - 1, made.part.facet_tags.indices)
    on = on[np.argsort(numbers[on])].astype(np.int64)
    return _Face(made, space, on, skin.places[numbers[on]], _followers(space, on, d))


def _followers(space: Any, on: Ints, d: int) -> sp.csr_matrix:
    """B (n, n): rows of nodes off the faces, columns of those on them: where a rigid motion takes them."""
    x = space.tabulate_dof_coordinates()[:, :d]
    is_on = np.zeros(len(x), dtype=bool)
    is_on[on] = True
    done = is_on.copy()
    entries: list[tuple[Array, Ints, Ints]] = []
    for nodes in np.asarray(space.dofmap.list, dtype=np.int64):
        leaders, rest = nodes[is_on[nodes]], nodes[~done[nodes]]
        done[rest] = True
        if not len(rest):
            continue
        centre = x[leaders].mean(axis=0)
        size = float(np.linalg.norm(np.ptp(x[nodes], axis=0)))
        motions = [rigid_modes(x[some], centre, size).reshape(d * len(some), -1) for some in (rest, leaders)]
        block = motions[0] @ np.linalg.pinv(motions[1])
        at = [(d * some[:, None] + np.arange(d)).ravel() for some in (rest, leaders)]
        entries.append((block.ravel(), np.repeat(at[0], len(at[1])), np.tile(at[1], len(at[0]))))
    if not entries:
        return sp.csr_matrix((d * len(x), d * len(x)))
    values, rows, columns = (np.concatenate(each) for each in zip(*entries, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=(d * len(x), d * len(x)))


def _eliminated(matrix: Any, d: int, places: Ints, where: str) -> tuple[_Inverse, Any, Ints, Ints]:
    """The factor of the inner unknowns, K_ib and K_bb of this rank, and its kept and inner unknowns."""
    begin, end = matrix.getOwnershipRange()
    wanted = (d * places[:, None] + np.arange(d)).ravel()
    here = wanted[(wanted >= begin) & (wanted < end)]
    kept = here - begin
    inner = np.setdiff1d(np.arange(end - begin), kept)
    comm = matrix.getComm()
    is_b = PETSc.IS().createGeneral(here.astype(PETSc.IntType), comm=comm)
    is_i = PETSc.IS().createGeneral((begin + inner).astype(PETSc.IntType), comm=comm)
    inverse = _Inverse(matrix.createSubMatrix(is_i, is_i), wanted, where)
    blocks = []
    for rows in (is_i, is_b):
        block = matrix.createSubMatrix(rows, is_b)
        indptr, indices, values = block.getValuesCSR()
        blocks.append(sp.csr_matrix((values, indices, indptr), shape=(len(indptr) - 1, len(wanted))))
    full = sp.lil_matrix((len(wanted), len(wanted)))
    full[np.searchsorted(wanted, here)] = blocks[1]
    return inverse, (blocks[0], full.tocsr()), kept.astype(np.int64), inner.astype(np.int64)


def _columns(
    inverse: _Inverse, coupling: sp.csr_matrix, of_kept: sp.csr_matrix, count: int
) -> Iterator[tuple[slice, Array]]:
    """What this rank has of the columns of S, some at a time."""
    transposed, by_column, own = coupling.T.tocsr(), coupling.tocsc(), of_kept.tocsc()
    for begin in range(0, count, BLOCK):
        some = slice(begin, min(begin + BLOCK, count))
        solved = inverse(by_column[:, some].toarray())
        yield some, own[:, some].toarray() - transposed @ solved


def _summed(comm: Any, owner: int, columns: Iterator[tuple[slice, Array]], count: int) -> Array | None:
    """S on the owner."""
    total = np.zeros((count, count)) if comm.rank == owner else None
    for some, own in columns:
        found = np.zeros_like(own) if comm.rank == owner else None
        comm.Reduce(own, found, root=owner)
        if total is not None:
            total[:, some] = found
    return total


def _load(spec: SubstructureSpec, space: Any, force: Any) -> Array:
    """Nodal forces of a body force at the unknowns of this rank."""
    form = load_form(spec, space, force)
    count = space.dofmap.index_map.size_local * space.dofmap.bs
    if form is None:
        return np.zeros(count)
    vector = fem_petsc.assemble_vector(form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return np.array(vector.array[:count], dtype=np.float64)


def _size(comm: Any, mesh: Any, d: int) -> tuple[float, Array]:
    """Volume and centre."""
    x = ufl.SpatialCoordinate(mesh)
    one = fem.Constant(mesh, np.float64(1.0))
    forms = [fem.form(f * ufl.dx) for f in (one, *(one * x[k] for k in range(d)))]
    moments = [float(comm.allreduce(fem.assemble_scalar(form))) for form in forms]
    return moments[0], np.array(moments[1:]) / moments[0]


def _part(
    face: _Face,
    rows: Ints,
    total: Array,
    forces: dict[Any, Array | None],
    volume: float,
    centre: Array,
    modulus: float,
) -> Substructure:
    """The condensed part on its owner."""
    spec, d = face.spec, face.spec.dim
    coordinates = face.space.tabulate_dof_coordinates()[:, :d].copy()
    count = coordinates.size
    ascending = np.argsort(rows)
    dense = total[np.ix_(ascending, ascending)]
    dense = 0.5 * (dense + dense.T)
    starts = np.zeros(count + 1, dtype=np.int32)
    starts[rows + 1] = len(rows)
    columns = np.tile(rows[ascending].astype(np.int32), len(rows))
    kept = sp.csr_matrix((dense.ravel(), columns, np.cumsum(starts)), shape=(count, count))
    off = np.ones(count)
    off[rows] = 0.0
    springs = sp.diags(off * float(np.mean(np.diag(dense))))
    tied = sp.diags(off) - face.follows
    loads: dict[Any, Array] = {}
    for amplitude, own in forces.items():
        loads[amplitude] = np.zeros(count)
        loads[amplitude][rows] = own
    length = volume ** (1.0 / d)
    return Substructure(
        name=spec.name,
        part=spec.part,
        space=face.space,
        stiffness=petsc_matrix((kept + tied.T @ springs @ tied).tocsr()),
        load=loads.pop(None, np.zeros(count)),
        rigid_modes=rigid_modes(coordinates, centre, length).reshape(count, -1),
        modulus=modulus,
        length=length,
        volume=volume,
        centre=centre,
        dof_coordinates=coordinates,
        varying_loads=loads,
        material=spec.material,
        factor=spec.stiffness,
    )
