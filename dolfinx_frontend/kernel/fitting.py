"""A solver without a factor of the parts: the basis of its bodies grows until one run of its laws is
answered."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np
from latin_core import Laws, NumericalError, State

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.threads import alone
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.kernel.solver import Solver
from dolfinx_frontend.kernel.subspace import Bodies, Subspace
from dolfinx_frontend.plan.plan import Plan

__all__ = ["SHARE", "fitted"]

_log = logging.getLogger(__name__)

SHARE = 0.5
"""Of the tolerance for what the basis leaves; the iteration has the rest."""

ROUNDS = 200
"""Blocks of fields at most."""

IDLE = 20
"""Rounds that must halve the error, after as many."""

NEGLIGIBLE = 0.05
"""Share of the squared residual that one round may leave to later ones."""

FAINT = 1e-9
"""A fluctuation that is so small beside the mean is measured with it."""


@alone
def fitted(
    problem: Problem, plan: Plan, applied: Callable[[Laws], Laws], amplitudes: Array, means: int
) -> tuple[Solver, list[State]]:
    """A solver in whose basis a run is answered to a share of its tolerance, and the answer to start from.

    Parameters
    ----------
    plan
        With ``backend="multigrid"``.
    applied
        The laws of the run, of those of the plan.
    amplitudes
        (load patterns, columns).
    means
        Columns that are means; the others are fluctuations, with an error of their own.

    Raises
    ------
    SceneError
        A law is nonlinear, a stiffness of a part varies, or there are several ranks.
    NumericalError
        The cycles do not converge.
    """
    problem.on_one_rank("backend 'multigrid'")
    for name in plan.active:
        if not problem.interfaces[name].law.superposes:
            raise SceneError(
                f"interface {name!r}: its law is nonlinear, and backend 'multigrid' is for linear ones: use "
                "backend='cholmod'"
            )
    began = perf_counter()
    described = bridge.describe(problem, plan)
    bodies = Bodies(problem, described.bodies, described.interfaces)
    space = Subspace.of(bodies)
    text = "multigrid of %d unknowns (%s), %.2f s"
    _log.info(text, bodies.size, bodies.multigrid.kind, perf_counter() - began)
    goal, left, best = SHARE * plan.options.rtol, 0.1, np.inf
    measured = [1.0]
    start: list[State] = []
    for number in range(ROUNDS):
        solver = Solver(problem, plan, space=space, described=described)
        laws = applied(solver.laws)
        loose = plan.options.with_(rtol=float(np.clip(0.02 * left, 0.2 * goal, 0.01)))
        summary, state = solver.run(laws, loose, amplitudes, start, progress=False)
        residual, energies = solver.residual(laws, state, amplitudes)
        found, fields = _corrections(space, residual, energies, means)
        measured.append(found)
        left = found * _underestimated(measured)
        _log.info("multigrid round %d: %d fields, error %s", number, space.count, shown_error(left))
        solver.left, start = left, [state]
        if left <= goal:
            return solver, start
        if summary.status in ("interrupted", "diverged") or not np.isfinite(left):
            return solver, start
        best = min(best, left)
        if len(measured) > 2 * IDLE and min(measured[-IDLE:]) > 0.5 * min(measured[:-IDLE]):
            break
        space = space.with_fields(fields)
    raise NumericalError(
        f"backend 'multigrid' ended at an error of {best:.1e}, asked {goal:.1e}: use backend='cholmod', or "
        "other settings of PETSc with the prefix latin_body_"
    )


def _underestimated(measured: Sequence[float]) -> float:
    """How many times larger errors may be than one cycle says, of errors before every round.

    Where the eigenvalues of M^-1 A lie in [1 / kappa, 1], r^T A^-1 r <= kappa r^T M^-1 r, and conjugate
    gradients take the fraction (sqrt(kappa) - 1) / (sqrt(kappa) + 1) from the error in a step: the rounds
    tell kappa.
    """
    recent = np.array(measured[-_RECENT:])
    if not recent[-1] > 0.0:
        return 1.0
    rate = min((recent[-1] / recent[0]) ** (1.0 / (len(recent) - 1)), _SLOWEST)
    return float((1.0 + rate) / (1.0 - rate))


_RECENT = 6
"""Errors, with the rounds between them, that a rate is taken from."""
_SLOWEST = 0.99


def _corrections(space: Subspace, residual: Array, energies: Array, means: int) -> tuple[float, Array]:
    """The estimated relative error of an answer, and fields (n, few) that take most of it away."""
    bodies = space.bodies
    groups = [slice(0, means), slice(means, len(energies))]
    sizes = np.array([energies[group].sum() for group in groups])
    sizes = np.maximum(sizes, FAINT**2 * sizes.max())
    if not sizes.max() > 0.0:  # nothing acts
        sizes[:] = 1.0
    for group, size in zip(groups, sizes, strict=True):
        residual[:, group] /= np.sqrt(size)
    gram = bodies.multigrid.energies(residual)
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    rest = values.sum() - np.cumsum(values)
    count = 1 + int(np.argmax(rest <= NEGLIGIBLE * values.sum()))
    chosen = vectors[:, :count]
    forces = residual @ chosen
    fields = bodies.multigrid.cycle(forces)
    energy = chosen @ (forces.T @ fields) @ chosen.T
    squares = np.diag(energy) * (values.sum() / max(values[:count].sum(), np.finfo(float).tiny))
    return float(np.sqrt(max(abs(squares[group].sum()) for group in groups))), fields
