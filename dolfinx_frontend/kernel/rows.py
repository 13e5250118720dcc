"""Blocks of columns whose rows are spread over the ranks of a problem, every rank with those of its bodies.

What a method on such blocks has to tell the other ranks: sums over all rows, jumps between bodies of two
ranks, decisions. On one rank all of it is the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.ranks import exchanged, waited
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp

__all__ = ["Rows", "placed"]

PETSc: Any = _PETSc  # its stubs know no members

T = TypeVar("T")


class Rows:
    """The rows of a rank among those of all.

    All members are collective, and begin with a meeting of the ranks, in which one that has failed says so
    (:func:`dolfinx_frontend.assembly.ranks.meeting_often`).

    Parameters
    ----------
    comm
        mpi4py communicator; None: this rank has all rows.
    """

    def __init__(self, comm: Any = None) -> None:
        self.comm = comm
        self.rank = 0 if comm is None else int(comm.rank)

    @property
    def petsc(self) -> Any:
        """The communicator of PETSc objects that have all rows."""
        return PETSc.COMM_SELF if self.comm is None else self.comm

    def every(self, content: T) -> list[T]:
        """What every rank says, in their order."""
        return [content] if self.comm is None else exchanged(self.comm, content)

    def meet(self) -> None:
        """Before what PETSc does on all ranks: one that has failed says so here."""
        self.every(None)

    def told(self, value: T) -> T:
        """What the first rank says: decisions of numbers that may differ by rounding."""
        return self.every(value if self.rank == 0 else None)[0]  # type: ignore[return-value]

    def any(self, holds: bool) -> bool:
        """Whether something holds on one of the ranks."""
        return any(self.every(bool(holds)))

    def sum(self, block: Array) -> Array:
        """The sum of the blocks of all ranks, the same bit by bit on all of them."""
        if self.comm is None:
            return block
        found: Array = np.sum(self.every(np.asarray(block)), axis=0)
        return found

    def dot(self, one: Array, other: Array) -> Array:
        """(c, d) products of the columns of two blocks."""
        return self.sum(one.T @ other)

    def norm(self, block: Array) -> float:
        """Root of the sum of all squares."""
        own = float(np.linalg.norm(block))
        return own if self.comm is None else float(np.linalg.norm(self.every(own)))

    def triangle(self, block: Array) -> Array:
        """A block with the singular values, and vectors on the right, of the rows of all ranks."""
        if self.comm is None:
            return block
        return np.vstack(self.every(np.linalg.qr(block, mode="r")))

    def orthonormal(self, block: Array) -> Array:
        """An orthonormal basis (n, c) of the columns of a block."""
        own, triangle = np.linalg.qr(block)
        if self.comm is None:
            return own
        every = self.every(triangle)
        first = sum(len(each) for each in every[: self.rank])
        return np.asarray(own @ np.linalg.qr(np.vstack(every))[0][first : first + len(triangle)])

    def completed(self, blocks: Sequence[Array], others: Sequence[int | None]) -> list[Array]:
        """Blocks, to each of which the rank that has the rest of it is given; None: it is whole."""
        found = list(blocks)
        if self.comm is None:
            return found
        self.meet()
        requests, arrived = [], {}
        for other in sorted({each for each in others if each is not None}):
            own = np.concatenate([b.ravel() for b, each in zip(blocks, others, strict=True) if each == other])
            arrived[other] = np.empty_like(own)
            requests.append(self.comm.Irecv(arrived[other], source=other, tag=_TAG))
            requests.append(self.comm.Isend(own, dest=other, tag=_TAG))
        for request in requests:
            waited(request)
        for k, rank in enumerate(others):
            if rank is not None:
                rest, arrived[rank] = np.split(arrived[rank], [found[k].size])
                found[k] = found[k] + rest.reshape(found[k].shape)
        return found

    def starts(self, count: int) -> list[int]:
        """First row of every rank, and the number of all, where every rank has `count` of its own."""
        return [0, *np.cumsum(self.every(count)).tolist()]

    def matrix(self, own: sp.csr_matrix, columns: int) -> Any:
        """PETSc AIJ matrix of rows (n, N) of this rank, which has some of the N columns; copied."""
        if self.comm is None:
            return petsc_matrix(own)
        sizes = ((own.shape[0], PETSc.DECIDE), (columns, own.shape[1]))
        self.meet()
        return petsc_matrix(own, sizes, self.comm)

    def dense(self, block: Array) -> Any:
        """PETSc matrix on the memory of a block (n, c) in Fortran's order."""
        if self.comm is None:
            return PETSc.Mat().createDense(block.shape, array=block, comm=PETSc.COMM_SELF)
        sizes = ((block.shape[0], PETSc.DECIDE), (PETSc.DECIDE, block.shape[1]))
        return PETSc.Mat().createDense(sizes, array=block, comm=self.comm)

    def tidy(self) -> None:
        """Free PETSc objects that all ranks have dropped: what Python drops, ranks do at different times."""
        if self.comm is not None:
            self.meet()
            PETSc.garbage_cleanup(self.comm)


_TAG = 20042


def placed(matrix: sp.csr_matrix, first: int, size: int) -> sp.csr_matrix:
    """A matrix whose columns are some of `size`, from a first one on."""
    matrix = matrix.tocsr()
    return sp.csr_matrix((matrix.data, matrix.indices + first, matrix.indptr), shape=(matrix.shape[0], size))
