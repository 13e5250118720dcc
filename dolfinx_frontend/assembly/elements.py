"""Elements of the meshes, tabulated, and sparse matrices between SciPy and PETSc."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
from dolfinx import mesh as dmesh
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError

__all__ = [
    "DIGITS",
    "EPS",
    "check_unchanged",
    "coordinate_element",
    "csr",
    "noted",
    "petsc_matrix",
    "quadrature",
    "tabulate",
]

PETSc: Any = _PETSc  # its stubs know no members

EPS = float(np.finfo(np.float64).eps)
DIGITS = 1e3 * EPS
"""Rounding, and the size relative to coordinates below which a length has fewer than three digits."""


def petsc_matrix(matrix: sp.csr_matrix, sizes: Any = None, comm: Any = PETSc.COMM_SELF) -> Any:
    """PETSc AIJ matrix of a SciPy one (copied): sequential, or of all ranks, which each give their rows; then
    with the sizes that PETSc takes."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    data = (  # PETSc copies
        matrix.indptr.astype(PETSc.IntType, copy=False),
        matrix.indices.astype(PETSc.IntType, copy=False),
        matrix.data.astype(np.float64, copy=False),
    )
    out = PETSc.Mat().createAIJ(sizes or matrix.shape, csr=data, comm=comm)
    out.assemble()
    return out


def csr(matrix: Any) -> sp.csr_matrix:
    """SciPy copy of a sequential PETSc AIJ matrix."""
    indptr, indices, values = matrix.getValuesCSR()
    return sp.csr_matrix((values, indices, indptr), shape=matrix.getSize())


_STATE = "latin_state"


def noted(matrix: Any) -> None:
    """Note the state of a PETSc matrix that is handed out: PETSc counts whatever writes to it."""
    if matrix is not None and matrix.handle and matrix.getAttr(_STATE) is None:
        matrix.setAttr(_STATE, matrix.stateGet())


def check_unchanged(matrix: Any, what: str) -> None:
    """Refuse a PETSc matrix that was written to since it was :func:`noted`.

    PETSc has no lock for matrices as it has for vectors, and a copy for everybody who looks at one costs its
    memory again.

    Raises
    ------
    SceneError
        It was, or it was destroyed.
    """
    if matrix is not None and not matrix.handle:  # PETSc would end the process
        raise SceneError(f"{what} was destroyed after it was assembled: assemble the scene again")
    if matrix is not None and matrix.getAttr(_STATE) != matrix.stateGet():
        raise SceneError(
            f"{what} was changed after it was assembled: change a copy, .copy(), or assemble the scene again"
        )


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
