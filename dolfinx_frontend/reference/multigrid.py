"""Conjugate gradients with algebraic multigrid on the assembled structure: what beats a factor of many
unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.kernel.multigrid import Multigrid, rigid_motions
from dolfinx_frontend.plan.reduction import Body

__all__ = ["Aggregation"]

PETSc: Any = _PETSc  # its stubs know no members


class Aggregation:
    """PETSc's GAMG (threshold 0.01, three Chebyshev/Jacobi steps) that is told the rigid motions of a body.

    Parameters
    ----------
    problem, body
        What the matrix is of.
    matrix
        SciPy matrix (n, n).
    """

    def __init__(self, problem: Problem, body: Body, matrix: sp.csr_matrix) -> None:
        petsc = petsc_matrix(matrix)
        petsc.setOption(PETSc.Mat.Option.SPD, True)
        self._cycle = Multigrid(petsc, None, rigid_motions(problem, body.Z, body.n))
        self._x, self._b = petsc.createVecs()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.setOperators(petsc)
        ksp.setPC(self._cycle.pc)
        self._ksp = ksp

    def solve(self, b: Array, rtol: float = 1e-6) -> Array:
        """Solution (n,) of A x = b to a relative residual, in the norm of the preconditioner.

        Raises
        ------
        SceneError
            It did not converge.
        """
        self._ksp.setTolerances(rtol=rtol, max_it=1000)
        self._b.setArray(b)
        self._ksp.solve(self._b, self._x)
        if self._ksp.getConvergedReason() <= 0:
            raise SceneError("conjugate gradients with GAMG did not converge: is something not held?")
        return np.array(self._x.getArray())
