"""Answers to compare with: one direct solve of all parts, and stochastic finite elements."""

from dolfinx_frontend.reference.cholesky import Cholesky, solvers
from dolfinx_frontend.reference.direct import Monolithic, ReferenceSolution, monolithic
from dolfinx_frontend.reference.energy import energy_difference, energy_error
from dolfinx_frontend.reference.galerkin import SSFEMSolution, smallest_eigenvalue, ssfem

__all__ = [
    "Cholesky",
    "Monolithic",
    "ReferenceSolution",
    "SSFEMSolution",
    "energy_difference",
    "energy_error",
    "monolithic",
    "smallest_eigenvalue",
    "solvers",
    "ssfem",
]
