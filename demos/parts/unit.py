"""The unit of cost: one direct solve."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import scipy.sparse as sp

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.reference.cholesky import Cholesky, solvers
from dolfinx_frontend.reference.direct import Monolithic

__all__ = ["Unit", "measure_unit"]


@dataclass(frozen=True)
class Unit:
    """The unit of cost: one analysis, factorisation and solve of the assembled structure."""

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
    for _, A, b in systems:
        A = sp.csr_matrix(A)
        A.eliminate_zeros()
        matrices.append((A, b))

    def once(solver: str) -> float:
        begin = time.perf_counter()
        for A, b in matrices:
            Cholesky(A, solver).solve(b, refine=False)
        return time.perf_counter() - begin

    # the first run of a solver also pays for its initialisation
    warm = {solver: min(once(solver), once(solver)) for solver in solvers()}
    best = min(warm, key=lambda s: warm[s])
    seconds = statistics.median([once(best) for _ in range(max(1, repeats))])
    return Unit(
        best, seconds, sum(A.shape[0] for A, _ in matrices), sum(A.nnz for A, _ in matrices)
    )
