"""Monolithic direct solution: the oracle of the tests and the unit of cost.

All interfaces are eliminated; what remains is factorised by a sparse Cholesky of PETSc (CHOLMOD or
MUMPS with MAT_SPD, explicit zeros pruned), with the options prefix ``latin_reference_``. Of a problem whose
parts are on several ranks the first one is given all matrices, and solves; all ranks call what is here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.gathered import by_first, gathered
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.plan.reduction import Body, body_load, body_matrix, displacements, reduce, spring_jump
from dolfinx_frontend.reference.cholesky import Cholesky, solvers
from dolfinx_frontend.scene.laws import Law

__all__ = ["Monolithic", "ReferenceSolution", "monolithic"]


@dataclass(frozen=True)
class ReferenceSolution:
    """Solution of the assembled structure.

    Attributes
    ----------
    u
        Substructure (of this rank) -> displacements (n_e,), length.
    traces
        Interface -> displacement w of each side, (m, d) in the local frame.
    forces
        Elastic, Pressure and Traction interface -> f_1 (m, d) in the local frame, force / area.
        The forces of the other interfaces are nodal reactions, which no point values belong to.
    energy
        Strain energy of the parts and of the springs, force * length; of a part whose mesh is spread over the
        ranks without what loads inside of it do while its faces are at rest.
    residual
        |A q - b| / |b| of the body with the largest one.
    """

    u: dict[str, Array] = field(repr=False)
    traces: dict[str, tuple[Array, ...]] = field(repr=False)
    forces: dict[str, Array] = field(repr=False)
    energy: float
    residual: float


class Monolithic:
    """Monolithic solver that keeps what does not depend on the stiffness of springs and on loads; collective.

    Parameters
    ----------
    problem
        Assembled scene.
    solver
        As in :class:`Cholesky`.
    """

    def __init__(self, problem: Problem, solver: str | None = None) -> None:
        check_is_problem("monolithic", problem)
        problem.check_alike("monolithic", laws=True, solver=solver)
        if solver is not None:
            check_known("solver", solver, solvers(), "monolithic")
        self.problem = problem
        self._whole = gathered(problem)
        self.solver = solver
        self._key: Any = None
        self._bodies: list[Body] = []
        self._bases: list[sp.csr_matrix] = []

    def _prepare(self, whole: Problem, laws: Mapping[str, Law]) -> list[Body]:
        """Bodies under these laws; kept as long as only elastic interfaces change."""
        key = [(n, law) for n, law in laws.items() if not law.springs]
        same = self._key is not None and len(key) == len(self._key) and all(
            a == b and law is other for (a, law), (b, other) in zip(key, self._key, strict=True)
        )
        if not same:
            self._bodies = reduce(whole, laws, laws)
            self._bases = [_without_springs(whole, b) for b in self._bodies]
            self._key = key
        return self._bodies

    def systems(
        self, laws: Mapping[str, Law]
    ) -> list[tuple[Body, sp.csr_matrix, Array]]:
        """Body, matrix and right-hand side of all bodies, on the first rank; none on others."""
        return [] if self._whole is None else self._systems(self._whole, laws)

    def _systems(
        self, whole: Problem, laws: Mapping[str, Law]
    ) -> list[tuple[Body, sp.csr_matrix, Array]]:
        out = []
        for body, base in zip(self._prepare(whole, laws), self._bases, strict=True):
            A = base + _springs(whole, body, laws)
            out.append((body, A, body_load(whole, body, laws)))
        return out

    def solve(
        self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None
    ) -> ReferenceSolution:
        """Solve, with laws or single parameters replaced; see :meth:`assembly.Problem.laws`."""
        self.problem.check_alike("monolithic", laws=True, values=values, **{"the laws given": laws})

        def solved(whole: Problem) -> ReferenceSolution:
            return self._solved(whole, whole.laws(laws, values))

        found = by_first(self.problem, self._whole, solved)
        return replace(found, u={name: found.u[name] for name in self.problem.substructures})

    def _solved(self, whole: Problem, current: Mapping[str, Law]) -> ReferenceSolution:
        u: dict[str, Array] = {}
        residual = 0.0
        for body, A, b in self._systems(whole, current):
            q = Cholesky(A, self.solver).solve(b)
            size = np.linalg.norm(b)
            if size > 0.0:
                residual = max(residual, float(np.linalg.norm(A @ q - b) / size))
            u |= displacements(body, q)
        return _solution(whole, current, u, residual)


def _without_springs(problem: Problem, body: Body) -> sp.csr_matrix:
    return body_matrix(problem, replace(body, springs=()))


def _springs(problem: Problem, body: Body, laws: Mapping[str, Law]) -> sp.csr_matrix:
    return body_matrix(problem, replace(body, members=()), laws)


def _solution(
    problem: Problem, laws: Mapping[str, Law], u: dict[str, Array], residual: float
) -> ReferenceSolution:
    energy = 0.5 * sum(
        float(u[n] @ (s.matrix @ u[n])) for n, s in problem.substructures.items()
    )
    traces, force = {}, {}
    for name, i in problem.interfaces.items():
        law = laws[name]
        traces[name] = tuple(
            (i.local_trace(k) @ u[s.substructure]).reshape(i.num_points, i.dim)
            for k, s in enumerate(i.sides)
        )
        if law.springs:
            stretch = spring_jump(problem, name, u) - law.jumps(i)
            force[name] = law.stiffnesses(i) * stretch
            energy += 0.5 * float(i.weights @ np.sum(force[name] * stretch, axis=1))
        elif (load := law.load(i)) is not None:
            force[name] = load
    return ReferenceSolution(u, traces, force, energy, residual)


def monolithic(
    problem: Problem,
    laws: dict[str, Law] | None = None,
    solver: str | None = None,
    values: dict[str, Any] | None = None,
) -> ReferenceSolution:
    """Solve the assembled structure directly; parameters with a mean take it. Collective on several ranks, of
    which the first one solves, and each gets the displacements of its parts.

    Parameters
    ----------
    problem
        Assembled scene.
    laws, values
        Laws, or single parameters such as ``{"joint.normal": 120.0}``, to use instead.
    solver
        ``"cholmod"`` or ``"mumps"``; None: the first that PETSc has.

    Raises
    ------
    SceneError
        An interface that cannot be eliminated, see :func:`reduction.reduce`; a singular matrix.
    """
    return Monolithic(problem, solver).solve(laws, values)
