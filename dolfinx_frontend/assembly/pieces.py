"""A part whose mesh is spread over the ranks, condensed piece by piece: primal substructuring, exact.

Every rank takes the matrix of its own cells, K_r with K = sum K_r, and eliminates what no other rank and no
face has: S_r is its Schur complement on the unknowns it shares with others, c, and those on the faces, b.
These are dense, and summed. c is eliminated by all ranks, each of which has some columns:

    S = S_bb - S_bc S_cc^-1 S_cb.
"""

from __future__ import annotations

from typing import Any

import dolfinx.fem as fem
import dolfinx.la as la
import numpy as np
from mpi4py import MPI

from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import linalg, sp
from dolfinx_frontend.common.errors import SceneError
from latin_core import Elimination, InputError, NumericalError

__all__ = ["Nodes", "Pieces", "memory_of_pieces"]

BLOCK = 128
"""Columns that are worked on at once."""

_FEWEST, _MOST_SENT = 64, 1024
"""Columns that are sent at once."""

_IN_PLACE = MPI.IN_PLACE

_FILL = 28.0
"""Numbers in the factor of a cube of n unknowns over n^(4/3), as in the cost of a plan."""

_SINGULAR = 1e-13
"""Pivots below this fraction of the diagonal are rounding, as in the kernel."""


class Nodes:
    """Nodes of the cells of this rank: those on faces, those that it shares, and all others.

    Attributes
    ----------
    inner, shared, on_face
        Numbers on this rank, ghosts included.
    of_shared, of_face
        Their places among all shared nodes, and among all on faces.
    count_shared, count_face
        How many there are of all ranks.
    """

    def __init__(self, space: Any, places: Ints) -> None:
        mesh, imap = space.mesh, space.dofmap.index_map
        comm = mesh.comm
        cells = mesh.topology.index_map(mesh.topology.dim).size_local
        count = imap.size_local + imap.num_ghosts
        touched = np.zeros(count, dtype=bool)
        touched[np.unique(np.asarray(space.dofmap.list)[:cells])] = True
        ranks = la.vector(imap, 1)
        ranks.array[:] = touched
        ranks.scatter_reverse(la.InsertMode.add)
        ranks.scatter_forward()
        number = imap.local_to_global(np.arange(count, dtype=np.int32))
        is_face = touched & np.isin(number, places)
        is_shared = touched & ~is_face & (np.asarray(ranks.array) > 1.5)
        self.inner = np.flatnonzero(touched & ~is_face & ~is_shared)
        self.shared, self.on_face = np.flatnonzero(is_shared), np.flatnonzero(is_face)
        every = np.unique(np.concatenate(comm.allgather(number[self.shared])))
        self.of_shared = np.searchsorted(every, number[self.shared])
        self.of_face = np.searchsorted(places, number[self.on_face])
        self.count_shared, self.count_face = len(every), len(places)
        self.dim, self.comm = int(space.dofmap.bs), comm

    def unknowns(self, nodes: Ints) -> Ints:
        """Of some nodes, component by component."""
        return np.asarray((self.dim * nodes[:, None] + np.arange(self.dim)).ravel(), dtype=np.int64)


def memory_of_pieces(nodes: Nodes) -> float:
    """Bytes that this rank will need beside its matrix, before anything is factorised."""
    d = nodes.dim
    own, kept = d * len(nodes.inner), d * (len(nodes.shared) + len(nodes.on_face))
    c, b = d * nodes.count_shared, d * nodes.count_face
    factor = _FILL * float(own + kept) ** (4.0 / 3.0) if d == 3 else 6.0 * own * np.log2(own + 2.0)
    factor += 0.5 * float(kept) ** 2
    return 8.0 * float(factor + 2.0 * float(kept) ** 2 + float(c) ** 2 + float(c) * b + 3.0 * float(b) ** 2)


class Pieces:
    """The pieces of a part, factorised; collective.

    Parameters
    ----------
    form
        Its stiffness, compiled.
    nodes
        Of this rank.
    where
        The part, for messages.
    """

    def __init__(self, form: Any, nodes: Nodes, where: str) -> None:
        self._nodes, self._where = nodes, where
        self._order = nodes.unknowns(np.concatenate([nodes.inner, nodes.shared, nodes.on_face]))
        matrix = fem.assemble_matrix(form)  # not summed over ranks: of the own cells
        rows = sp.csr_matrix(matrix.to_scipy(ghosted=True))
        # there may be more columns, for what other ranks would send
        self.stiffness = rows[:, : rows.shape[0]].tocsr()
        own = self.stiffness[self._order][:, self._order].tocsr()
        self._shared, self._face = nodes.unknowns(nodes.of_shared), nodes.unknowns(nodes.of_face)
        self._kept = len(self._shared) + len(self._face)
        self._lower: Array = np.zeros((0, 0))
        with agreement(nodes.comm):
            try:
                lower = sp.tril(own, format="csr")
                self._own = Elimination(stiffness=lower, kept=self._kept, name=where)
            except (InputError, NumericalError) as error:
                rank = f"rank {nodes.comm.rank}"
                raise SceneError(f"{where}: {rank} could not eliminate its cells: {error}") from None

    @property
    def faces(self) -> int:
        """Unknowns on faces."""
        return self._nodes.dim * self._nodes.count_face

    def condensed(self, owner: int) -> Array | None:
        """S on the owner, None elsewhere; once."""
        comm, d = self._nodes.comm, self._nodes.dim
        c, b = d * self._nodes.count_shared, d * self._nodes.count_face
        own = self._own.take_schur()
        for start in range(0, len(own), BLOCK):  # only its lower triangle is there
            end = start + BLOCK
            lower = np.tril(own[start:end, start:end])
            own[start:end, start:end] = lower + np.tril(lower, -1).T
            own[start:end, end:] = own[end:, start:end].T
        split = len(self._shared)
        total = np.zeros((c, c))
        total[np.ix_(self._shared, self._shared)] = own[:split, :split]
        comm.Allreduce(_IN_PLACE, total)
        self._lower = self._factorised(total)
        # a few for each rank: their triangles differ, and every message is one more time to wait for others
        wide = min(max(b // (4 * comm.size), _FEWEST), _MOST_SENT)
        starts = range(0, b, wide)
        half = self._halves(own[:split, split:], starts)
        mine = {
            start: half[:, start : start + wide].T @ half[:, start:]
            for k, start in enumerate(starts)
            if k % comm.size == comm.rank
        }
        del half
        found = np.zeros((b, b)) if comm.rank == owner else None
        on_faces = own[split:, split:]
        for start in starts:
            some = np.flatnonzero((self._face >= start) & (self._face < start + wide))
            below = np.flatnonzero(self._face >= start)
            block = np.zeros((min(wide, b - start), b - start))
            block[np.ix_(self._face[some] - start, self._face[below] - start)] = on_faces[np.ix_(some, below)]
            if start in mine:
                block -= mine.pop(start)
            whole: Array | None = np.empty_like(block) if found is not None else None
            comm.Reduce(block, whole, root=owner)
            if found is not None and whole is not None:
                found[start : start + wide, start:] = whole
                found[start:, start : start + wide] = whole.T
        return found

    def reduced(self, load: Array) -> Array:
        """A load as forces on all unknowns on faces, when it was condensed; all ranks have them.

        Parameters
        ----------
        load
            Nodal forces at all unknowns that this rank knows, those of its own cells.
        """
        _, moved = self.displacement(np.zeros(self._nodes.dim * self._nodes.count_face), load)
        every = np.zeros(self.stiffness.shape[0])
        every[self._order] = moved
        forces = np.zeros(self._nodes.dim * self._nodes.count_face)
        left = (load - self.stiffness @ every)[self._order]
        forces[self._face] = left[len(left) - len(self._face) :]
        self._nodes.comm.Allreduce(_IN_PLACE, forces)
        return forces

    def displacement(self, on_faces: Array, load: Array) -> tuple[Ints, Array]:
        """Unknowns of the own cells, with their displacements (n,).

        Parameters
        ----------
        on_faces
            Displacements of all unknowns on faces.
        load
            As for :meth:`reduced`.
        """
        split = len(self._shared)
        kept = np.zeros(self._kept)
        kept[split:] = on_faces[self._face]
        _, partial = self._own.reduce(load[self._order])
        found = self._own.expand(kept, partial)[:, 0]
        moved = np.zeros(self.stiffness.shape[0])
        moved[self._order] = found
        left = np.zeros(len(self._lower))
        shared = self._order[len(self._order) - self._kept :][:split]
        left[self._shared] = (load - self.stiffness @ moved)[shared]
        self._nodes.comm.Allreduce(_IN_PLACE, left)
        if len(left):
            kept[:split] = linalg.cho_solve((self._lower, True), left)[self._shared]
            found = self._own.expand(kept, partial)[:, 0]
        return self._order, np.asarray(found)

    def _factorised(self, total: Array) -> Array:
        """L of S_cc; the same on all ranks."""
        if not len(total):
            return total
        diagonal = np.diag(total).copy()
        try:
            lower: Array = linalg.cholesky(total, lower=True, overwrite_a=True)
        except (np.linalg.LinAlgError, ValueError):
            lower = np.zeros_like(total)
        if not np.all(np.diag(lower) ** 2 >= _SINGULAR * diagonal):
            raise SceneError(
                f"{self._where}: its stiffness between the ranks is not positive definite: a piece of the "
                "mesh is not joined to the faces that the scene uses, or its material is not stable"
            )
        return lower

    def _solved_half(self, right: Array) -> Array:
        if not len(self._lower) or not right.shape[1]:
            return right
        return np.asarray(linalg.solve_triangular(self._lower, right, lower=True))

    def _halves(self, own: Array, starts: range) -> Array:
        """L^-1 S_cb: each rank makes some of the columns, and all have all of them."""
        comm, c = self._nodes.comm, len(self._lower)
        width = self._nodes.dim * self._nodes.count_face
        half = np.zeros((c, width), order="F")
        if not c:
            return half
        for k, start in enumerate(starts):
            some = np.flatnonzero((self._face >= start) & (self._face < start + starts.step))
            block = np.zeros((min(starts.step, width - start), c))  # transposed: messages are by rows
            block[np.ix_(self._face[some] - start, self._shared)] = own[:, some].T
            whole = np.empty_like(block) if k % comm.size == comm.rank else None
            comm.Reduce(block, whole, root=k % comm.size)
            if whole is not None:
                half[:, start : start + starts.step] = self._solved_half(whole.T)
        for k, start in enumerate(starts):
            comm.Bcast(half.T[start : start + starts.step], root=k % comm.size)
        return half
