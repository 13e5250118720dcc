"""A part whose mesh is spread over the ranks, condensed to its faces by all of them.

The unknowns on the faces that the scene joins or holds, b, are kept, all others, i, are eliminated:

    S = K_bb - K_bi K_ii^-1 K_ib,     f = f_b - K_bi K_ii^-1 f_i.

Every rank eliminates the inside of its own cells (:mod:`pieces`). Where that does not fit into memory, where
the kernel has no CHOLMOD, or where there are options of PETSc with the prefix ``latin_part_``, one factor of
K_ii is made on the mesh's communicator (MUMPS, or what these options say).

The rank that owns the part gets S with the mesh of the cells along these faces. From there on it is a part as
any other. Of these cells the nodes off the faces follow those on them: springs hold each where the rigid
motion that is nearest to that of its cell's nodes on the face would take it. They carry no load, so the
springs have no force, and S is what is left when such nodes are eliminated; their displacements are not those
of the part, which :meth:`Condensed.displacement` tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import dolfinx.fem as fem
import dolfinx.fem.petsc as fem_petsc
import dolfinx.la as la
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.pieces import BLOCK, Nodes, Pieces, memory_of_pieces
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.assembly.substructure import Substructure, form_of, load_form, modulus_of
from dolfinx_frontend.assembly.taken import Cells, Surroundings, cells_along, joined, meshed, numbers_in
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.memory import available_memory
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.specs import SubstructureSpec
from dolfinx_frontend.scene.values import is_random_field
from latin_core import available_backends

__all__ = ["Condensed", "SpreadPart", "condensed"]

PETSc: Any = _PETSc  # its stubs know no members

PREFIX = "latin_part_"

_TOGETHER = 27
"""MUMPS' ICNTL for that number."""

_OF_MUMPS = 90.0
"""Numbers in its memory, over n^(4/3), of all ranks."""

MOST = 16_000
"""Unknowns that are kept, at most: their matrix is dense (2 GB)."""


@dataclass(frozen=True, eq=False, repr=False)
class Condensed:
    """What all ranks keep of a part that is spread over them.

    Attributes
    ----------
    space
        Displacements on the whole mesh.
    part, material
        As the scene has them.
    load, varying
        Body forces of the cells of this rank, at all unknowns that it knows: the constant part, and what each
        amplitude multiplies.
    rows
        (kept,) unknowns of the part on the owner, in the order of the kept; None elsewhere.
    loads
        Load of the scene and its parameter -> nodal forces of the number 1, as `load`.
    stresses
        The same -> initial stress (UFL on the whole mesh).
    ratio
        What the stiffness was multiplied with since it was factorised: `material`, `stresses` and `loads` of
        initial strains are those of the new one.
    """

    name: str
    owner: int
    space: Any
    part: Any
    material: Any
    load: Array
    varying: dict[Any, Array]
    rows: Ints | None
    _way: Any = field(repr=False)
    loads: dict[tuple[str, str], Array] = field(default_factory=dict)
    stresses: dict[tuple[str, str], Any] = field(default_factory=dict)
    ratio: float = 1.0

    @property
    def dim(self) -> int:
        """Space dimension."""
        return int(self.space.dofmap.bs)

    @property
    def size(self) -> int:
        """Unknowns that this rank knows."""
        return len(self.load)

    @property
    def unknowns(self) -> int:
        """Of all ranks."""
        return int(self.space.dofmap.index_map.size_global) * self.dim

    around = False
    """It is no section of a body of revolution."""

    @property
    def loaded(self) -> bool:
        """Whether something acts inside of it; collective."""
        every = [self.load, *self.varying.values(), *self.loads.values()]
        return bool(self.space.mesh.comm.allreduce(any(np.any(each) for each in every), op=MPI.LOR))

    def reduced(self, load: Array, size: int) -> Array | None:
        """A load of this part as forces on the unknowns (size,) that its owner has, None elsewhere;
        collective."""
        own = self._way.reduced(load)
        if self.rows is None:
            return None
        forces = np.zeros(size)
        forces[self.rows] = own
        return forces

    def displacement(
        self,
        unknowns: Array | None,
        numbers: Mapping[tuple[str, str], float] | None = None,
        time: float | None = None,
    ) -> Any:
        """The displacement on the whole mesh, a dolfinx function. Collective.

        The stiffness is the one that was assembled: where another factor is solved with, and something acts
        inside the part, this is not its displacement.

        Parameters
        ----------
        unknowns
            (n,) of the part as the result has them; on its owner, None elsewhere.
        numbers
            What `loads` are multiplied with; on the owner. None: nothing.
        time
            At which body forces are taken that change in time.
        """
        load = self.load + sum(a(0.0 if time is None else time) * f for a, f in self.varying.items())
        return self._moved(unknowns, numbers, load)

    def answer(self, unknowns: Array | None, numbers: Mapping[tuple[str, str], float] | None = None) -> Any:
        """As :meth:`displacement`, without body forces."""
        return self._moved(unknowns, numbers, np.zeros_like(self.load))

    def _moved(
        self, unknowns: Array | None, numbers: Mapping[tuple[str, str], float] | None, load: Array
    ) -> Any:
        comm = self.space.mesh.comm
        values: Any = None
        with agreement(comm):
            if self.rows is not None:
                values = np.asarray(unknowns, dtype=np.float64)[self.rows], dict(numbers or {})
        on_faces, factors = comm.bcast(values, root=self.owner)
        return self._field(on_faces, load + sum(factors.get(key, 0.0) * f for key, f in self.loads.items()))

    def held(self, load: Array) -> Any:
        """The displacement by forces inside the part, as `load`, with the kept unknowns at 0; collective."""
        return self._field(np.zeros(int(self._way.faces)), load)

    @cached_property
    def surroundings(self) -> Surroundings:
        """The cells of this rank with those that fits over neighbours need; collective when first asked for.

        A vertex on the boundary takes the fit of cells around interior ones beside it, and where these are
        few of those around their neighbours: three layers.
        """
        return Surroundings(self.part, self.space, 3)

    def at(self, time: float) -> Condensed:
        """The same at a time of a history: its body forces no longer change."""
        total = self.load + sum(a(time) * f for a, f in self.varying.items())
        return replace(self, load=total, varying={})

    def stretched(self, material: Any, ratio: float) -> Condensed:
        """The same with a stiffness that is this times what it was."""
        return replace(
            self,
            material=material,
            ratio=ratio * self.ratio,
            loads={key: f if key not in self.stresses else ratio * f for key, f in self.loads.items()},
            stresses={key: ratio * stress for key, stress in self.stresses.items()},
        )

    def _field(self, on_faces: Array, load: Array) -> Any:
        """The displacement with kept unknowns (kept,) and a load inside, a dolfinx function."""
        found = fem.Function(self.space, name=self.name)
        at, own = self._way.displacement(on_faces, load / self.ratio)
        found.x.array[at] = own
        found.x.scatter_forward()
        return found


class _Inverse:
    """K_ii^-1 on the columns that the ranks have rows of."""

    def __init__(self, matrix: Any, where: str) -> None:
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


class _Together:
    """All ranks have one factor of the inner unknowns, and solve for every kept one; as :class:`Pieces`."""

    def __init__(self, form: Any, space: Any, places: Ints, where: str) -> None:
        matrix = fem_petsc.assemble_matrix(form)
        matrix.assemble()
        self.stiffness = _Rows(matrix)
        self._space = space
        d = int(space.dofmap.bs)
        begin, end = matrix.getOwnershipRange()
        wanted = (d * places[:, None] + np.arange(d)).ravel()
        here = wanted[(wanted >= begin) & (wanted < end)]
        self._at = np.searchsorted(wanted, here)
        self._kept: Ints = (here - begin).astype(np.int64)
        self._inner: Ints = np.setdiff1d(np.arange(end - begin), self._kept).astype(np.int64)
        comm = matrix.getComm()
        is_b = PETSc.IS().createGeneral(here.astype(PETSc.IntType), comm=comm)
        is_i = PETSc.IS().createGeneral((begin + self._inner).astype(PETSc.IntType), comm=comm)
        self._inverse = _Inverse(matrix.createSubMatrix(is_i, is_i), where)
        blocks = []
        for rows in (is_i, is_b):
            block = matrix.createSubMatrix(rows, is_b)
            indptr, indices, values = block.getValuesCSR()
            blocks.append(sp.csr_matrix((values, indices, indptr), shape=(len(indptr) - 1, len(wanted))))
        full = sp.lil_matrix((len(wanted), len(wanted)))
        full[self._at] = blocks[1]
        self._coupling, self._of_kept = blocks[0], full.tocsc()

    @property
    def faces(self) -> int:
        """See :attr:`Pieces.faces`."""
        return int(self._of_kept.shape[0])

    def condensed(self, owner: int) -> Array | None:
        """See :meth:`Pieces.condensed`."""
        comm, count = self._space.mesh.comm, self._of_kept.shape[0]
        total = np.zeros((count, count)) if comm.rank == owner else None
        for some, own in self._columns(count):
            found = np.zeros_like(own) if comm.rank == owner else None
            comm.Reduce(own, found, root=owner)
            if total is not None:
                total[:, some] = found
        return total if total is None else 0.5 * (total + total.T)

    def reduced(self, load: Array) -> Array:
        """See :meth:`Pieces.reduced`."""
        f, own = self._summed(load), np.zeros(self._of_kept.shape[0])
        own[self._at] = f[self._kept]
        own -= self._coupling.T @ self._inverse(f[self._inner][:, None])[:, 0]
        return np.asarray(self._space.mesh.comm.allreduce(own))

    def displacement(self, on_faces: Array, load: Array) -> tuple[Ints, Array]:
        """See :meth:`Pieces.displacement`."""
        right = self._summed(load)[self._inner] - self._coupling @ on_faces
        inner = self._inverse(right[:, None])[:, 0]
        return np.concatenate([self._inner, self._kept]), np.concatenate([inner, on_faces[self._at]])

    def _columns(self, count: int) -> Iterator[tuple[slice, Array]]:
        """What this rank has of the columns of S, some at a time."""
        transposed, by_column = self._coupling.T.tocsr(), self._coupling.tocsc()
        for begin in range(0, count, BLOCK):
            some = slice(begin, min(begin + BLOCK, count))
            solved = self._inverse(by_column[:, some].toarray())
            yield some, self._of_kept[:, some].toarray() - transposed @ solved

    def _summed(self, load: Array) -> Array:
        """Nodal forces of all ranks, at the unknowns of this one."""
        function = fem.Function(self._space)
        function.x.array[:] = load
        function.x.scatter_reverse(la.InsertMode.add)
        imap = self._space.dofmap.index_map
        return np.array(function.x.array[: imap.size_local * int(self._space.dofmap.bs)])


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
        self.shape = (self._x.getLocalSize(), matrix.getSize()[1])

    def __matmul__(self, own: Array) -> Array:
        self._x.array[:] = own
        self._matrix.mult(self._x, self._y)
        return np.array(self._y.array)


def _check(spec: SubstructureSpec, comm: Any, relieved: bool, faces: Sequence[str]) -> None:
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
        (relieved, "inertia relief"),
    ):
        if wrong:
            raise SceneError(
                f"{where}: its mesh is spread over processes, which {what} cannot have: make it on COMM_SELF"
            )


def condensed(
    spec: SubstructureSpec, comm: Any, owner: int, faces: Sequence[str], relieved: bool
) -> SpreadPart:
    """Assemble, factorise and condense a part on the communicator of its mesh; collective.

    Parameters
    ----------
    owner
        The rank that is given the condensed part.
    faces
        Those that the scene uses.
    relieved
        Whether inertia balances the loads of the scene.

    Raises
    ------
    SceneError
        On all ranks: another communicator, something that such a part cannot have, or too many unknowns along
        its faces.
    """
    where = f"substructure {spec.name!r}"
    with agreement(comm):
        _check(spec, comm, relieved, faces)
        mesh, d = spec.part.mesh, spec.dim
        space = fem.functionspace(mesh, ("Lagrange", spec.degree, (d,)))
        form, _ = form_of(spec, space)
        own = cells_along(spec.part, space, faces)
    skins = comm.gather(own, root=owner)
    face: _Face | None = None
    with agreement(comm):
        if comm.rank == owner:
            face = _on_face(spec, joined(skins))
    places = comm.bcast(None if face is None else face.places, root=owner)
    if not 0 < d * len(places) <= MOST:
        raise SceneError(
            f"{where}: its mesh is spread over processes, and {d * len(places)} of its unknowns are on the "
            f"faces {', '.join(faces)}: 1 to {MOST} can be kept; cut the part there, or join smaller faces"
        )
    way = _way(form, space, places, where)
    loads: dict[Any, Array] = {}
    varies = isinstance(spec.body_force, Varying)
    for amplitude, force in spec.body_force.terms if varies else ((None, spec.body_force),):
        loads[amplitude] = loads.get(amplitude, 0.0) + _load(spec, space, force)
    with_load = {a: f for a, f in loads.items() if comm.allreduce(float(np.abs(f).max(initial=0.0))) > 0.0}
    total = way.condensed(owner)
    forces = {amplitude: way.reduced(load) for amplitude, load in with_load.items()}
    volume, centre = _size(comm, mesh, d)
    x = space.tabulate_dof_coordinates()[: way.stiffness.shape[0] // d, :d]
    modulus = comm.allreduce(modulus_of(way.stiffness, x - centre, volume))
    rows, part = None, None
    with agreement(comm):
        if face is not None:
            assert total is not None
            rows = (d * face.kept[:, None] + np.arange(d)).ravel()
            part = _part(face, rows, total, forces, volume, centre, modulus)
    load = loads.pop(None, None)
    constant = _load(spec, space, None) if load is None else load
    of_all = Condensed(spec.name, owner, space, spec.part, spec.material, constant, loads, rows, way)
    return SpreadPart(of_all, None if face is None else face.spec, part)


def _way(form: Any, space: Any, places: Ints, where: str) -> Pieces | _Together:
    """How the part is condensed; says so if what is left of the memory will not do."""
    comm, d = space.mesh.comm, int(space.dofmap.bs)
    nodes = Nodes(space, places)
    given = any(name.startswith(PREFIX) for name in PETSc.Options().getAll())
    if given or "cholmod" not in available_backends():
        return _Together(form, space, places, where)
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    free = comm.allreduce(available_memory() / here.size, op=MPI.MIN)
    here.Free()
    pieces = comm.allreduce(memory_of_pieces(nodes), op=MPI.MAX)
    kept = float(d * len(places))
    count = float(space.dofmap.index_map.size_global * d)
    together = 8.0 * (_OF_MUMPS * count ** (4.0 / 3.0) / comm.size + 3.0 * kept**2)
    least = min(pieces, together)
    if least > free and comm.rank == 0:
        warn(
            f"{where}: its {count:.0f} unknowns, {kept:.0f} of them on faces, need about "
            f"{1e-9 * least:.3g} GB on each of {comm.size} ranks, and {1e-9 * free:.3g} GB are free: take "
            "more ranks or machines, or a coarser mesh",
            SceneWarning,
        )
    if pieces > free and together < pieces:
        return _Together(form, space, places, where)
    return Pieces(form, nodes, where)


class _Face(NamedTuple):
    """On the owner: the cells along the faces as a part with its space, the nodes that are kept, their global
    numbers (ascending), and how others follow them."""

    spec: SubstructureSpec
    space: Any
    kept: Ints
    places: Ints
    follows: sp.csr_matrix


def _on_face(spec: SubstructureSpec, skin: Cells) -> _Face:
    """The nodes on the faces, and how the others of their cells follow them."""
    made = replace(spec, source=meshed(spec.part, skin))
    d = spec.dim
    space = fem.functionspace(made.part.mesh, ("Lagrange", spec.degree, (d,)))
    numbers = numbers_in(space, skin)
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


def _load(spec: SubstructureSpec, space: Any, force: Any) -> Array:
    """Nodal forces of a body force on the cells of this rank, at all unknowns that it knows."""
    form = load_form(spec, space, force)
    imap = space.dofmap.index_map
    if form is None:
        return np.zeros((imap.size_local + imap.num_ghosts) * space.dofmap.bs)
    return np.array(fem.assemble_vector(form).array, dtype=np.float64)


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
    forces: dict[Any, Array],
    volume: float,
    centre: Array,
    modulus: float,
) -> Substructure:
    """The condensed part on its owner."""
    spec, d = face.spec, face.spec.dim
    coordinates = face.space.tabulate_dof_coordinates()[:, :d].copy()
    count = coordinates.size
    ascending = np.argsort(rows)
    total[:] = total[np.ix_(ascending, ascending)]  # in its place: it is large
    starts = np.zeros(count + 1, dtype=np.int32)
    starts[rows + 1] = len(rows)
    columns = np.tile(rows[ascending].astype(np.int32), len(rows))
    stiffness = sp.csr_matrix((total.ravel(), columns, np.cumsum(starts)), shape=(count, count))
    del columns
    off = np.ones(count)
    off[rows] = 0.0
    springs = sp.diags(off * float(np.mean(np.diag(total))))
    tied = sp.diags(off) - face.follows
    stiffness = (stiffness + tied.T @ springs @ tied).tocsr()
    loads: dict[Any, Array] = {}
    for amplitude, own in forces.items():
        loads[amplitude] = np.zeros(count)
        loads[amplitude][rows] = own
    length = volume ** (1.0 / d)
    return Substructure(
        name=spec.name,
        part=spec.part,
        space=face.space,
        stiffness=petsc_matrix(stiffness),
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
