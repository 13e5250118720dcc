"""The unit of cost: one direct solve."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import scipy.sparse as sp

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.reference.cholesky import Cholesky, solvers
from dolfinx_frontend.reference.direct import Monolithic
from dolfinx_frontend.reference.multigrid import Aggregation

__all__ = ["Unit", "measure_unit"]

ITERATIVE = 100_000
"""Unknowns from which conjugate gradients with GAMG are tried, too."""


@dataclass(frozen=True)
class Unit:
    """The unit of cost: one analysis, factorisation and solve of the assembled structure, or as many
    conjugate gradients with GAMG as lead to a residual of 1e-6."""

    solver: str
    seconds: float
    dof: int
    nnz: int


def measure_unit(problem: Problem, repeats: int = 3) -> Unit:
    """Median time of a direct solve, with the faster of the available solvers.

    Parameters
    ----------
    problem
        Assembled scene.
    repeats
        Solves that the median is taken of; the slower solver is left out after the second.
    """
    systems = Monolithic(problem).systems(problem.laws())
    matrices = []
    for body, A, b in systems:
        A = sp.csr_matrix(A)
        A.eliminate_zeros()
        matrices.append((body, A, b))

    def once(solver: str) -> float:
        begin = time.perf_counter()
        for body, A, b in matrices:
            if solver == "gamg":
                Aggregation(problem, body, A).solve(b)
            else:
                Cholesky(A, solver).solve(b, refine=False)
        return time.perf_counter() - begin

    size = sum(A.shape[0] for _, A, _ in matrices)
    tried = (*solvers(), "gamg") if size >= ITERATIVE else solvers()
    # the first run of a solver also pays for its initialisation
    warm = {solver: min(once(solver), once(solver)) for solver in tried}
    best = min(warm, key=lambda s: warm[s])
    seconds = statistics.median([once(best) for _ in range(max(1, repeats))])
    return Unit(
        best, seconds, size, sum(A.nnz for _, A, _ in matrices)
    )
