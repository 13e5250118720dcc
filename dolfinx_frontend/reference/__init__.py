"""Answers to compare with: one direct solve of all parts, and stochastic finite elements."""

from dolfinx_frontend.reference.monolithic import (
    Cholesky,
    Monolithic,
    ReferenceSolution,
    Unit,
    energy_difference,
    energy_error,
    monolithic,
    solvers,
    unit,
)

__all__ = [
    "Cholesky",
    "Monolithic",
    "ReferenceSolution",
    "Unit",
    "energy_difference",
    "energy_error",
    "monolithic",
    "solvers",
    "unit",
]
