"""Sparse Cholesky factors by the libraries that PETSc has."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Cholesky", "solvers"]

PETSc: Any = _PETSc  # its stubs know no members


class Cholesky:
    """Sparse Cholesky factor of a symmetric positive definite matrix.

    Parameters
    ----------
    matrix
        SciPy matrix; explicit zeros are pruned.
    solver
        ``"cholmod"`` or ``"mumps"``; None: the first that PETSc has.

    Raises
    ------
    SceneError
        Solver not available, matrix not positive definite, or not enough memory for its factor.
    """

    def __init__(self, matrix: sp.csr_matrix, solver: str | None = None) -> None:
        available = solvers()
        self.solver = solver if solver is not None else available[0]
        if not (sp.issparse(matrix) or isinstance(matrix, np.ndarray)) or np.ndim(matrix) not in (0, 2):
            raise SceneError(f"Cholesky: matrix = {short(matrix)}; give a SciPy matrix")
        if not isinstance(self.solver, str) or self.solver not in available:
            raise SceneError(f"no solver {solver!r}; this PETSc has {', '.join(available)}")
        self.matrix = sp.csr_matrix(matrix, copy=True)
        self.matrix.eliminate_zeros()
        petsc = petsc_matrix(self.matrix)
        petsc.setOption(PETSc.Mat.Option.SPD, True)
        petsc.setOptionsPrefix(_PREFIX)  # the factor inherits it
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOptionsPrefix(_PREFIX)
        ksp.setOperators(petsc)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(self.solver)
        ksp.setFromOptions()
        options = PETSc.Options(_PREFIX)
        forced = self.solver == "cholmod" and not options.hasName(_SUPERNODAL)
        if forced:  # its simplicial L D L^T of small matrices would accept negative pivots
            options[_SUPERNODAL] = "SUPERNODAL"
        try:
            ksp.setUp()
        except PETSc.Error as err:
            raise SceneError(_reason(self.solver, self.matrix, str(err), err.ierr)) from err
        finally:
            if forced:
                options.delValue(_SUPERNODAL)
        if self.solver == "mumps":
            factor = pc.getFactorMatrix()
            if factor.getMumpsInfog(1) in _MUMPS_MEMORY:
                raise SceneError(_too_large(self.solver, self.matrix))
            # it goes on after negative pivots and only counts them
            if factor.getMumpsInfog(12) > 0:
                raise SceneError(_INDEFINITE)
        self._ksp = ksp
        self._x, self._b = petsc.createVecs()

    def _once(self, b: Array) -> Array:
        self._b.setArray(b)
        self._ksp.solve(self._b, self._x)
        return np.array(self._x.getArray())

    def solve(self, b: Array, refine: bool = True) -> Array:
        """Solution of A x = b, (n,), with one step of iterative refinement.

        Raises
        ------
        SceneError
            The factorisation failed: the matrix is singular or indefinite.
        """
        x = self._once(b)
        if refine and np.all(np.isfinite(x)):
            x += self._once(b - self.matrix @ x)
        if self._ksp.getConvergedReason() < 0 or not np.all(np.isfinite(x)):
            raise SceneError(_INDEFINITE)
        return x


_PREFIX = "latin_reference_"

_SUPERNODAL = "mat_cholmod_factor"

_INDEFINITE = (
    "the assembled stiffness is not positive definite: something is not held, or a stiffness is "
    "negative"
)

_MUMPS_MEMORY = (-7, -8, -9, -11, -13, -14, -15, -19, -20)
"""INFOG(1) of MUMPS where its workspace could not be had or did not do, section 8 of its manual."""

_PETSC_MEMORY = 55
_CHOLMOD_MEMORY, _CHOLMOD_TOO_LARGE = -2, -3


def _too_large(solver: str, matrix: sp.csr_matrix) -> str:
    size = matrix.shape[0]
    needed = 8e-9 * 15.0 * size ** (4.0 / 3.0)  # as the plan predicts it
    return (
        f"{solver} has not enough memory, or not enough digits in its indices, for the factor of {size} "
        "unknowns, "
        f"about {needed:.3g} GB of a part in 3D: use a coarser mesh, or Options(backend='multigrid')"
    )


def _reason(solver: str, matrix: sp.csr_matrix, text: str, code: int) -> str:
    """Why a factorisation failed, of what PETSc says."""
    found = re.search(r"(?:status|CHOLMOD error) (-?\d+)", text)
    status = int(found[1]) if found else 0
    memory = code == _PETSC_MEMORY or status in (_CHOLMOD_MEMORY, _CHOLMOD_TOO_LARGE)
    return _too_large(solver, matrix) if memory else _INDEFINITE


def solvers() -> tuple[str, ...]:
    """Sparse Cholesky packages that this PETSc has, the usually fastest first."""
    out = []
    for name in ("cholmod", "mumps"):
        probe = PETSc.Mat().createAIJ((1, 1), nnz=1, comm=PETSc.COMM_SELF)
        probe.setValue(0, 0, 1.0)
        probe.assemble()
        probe.setOption(PETSc.Mat.Option.SPD, True)
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setOperators(probe)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(name)
        try:
            pc.setUp()
        except PETSc.Error:
            continue
        out.append(name)
    if not out:
        raise SceneError("PETSc has neither CHOLMOD nor MUMPS; install one of them")
    return tuple(out)
