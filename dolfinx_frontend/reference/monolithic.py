"""Monolithic direct solution: the oracle of the tests and the unit of cost.

All interfaces are eliminated; what remains is factorised by a sparse Cholesky of PETSc (CHOLMOD or
MUMPS with MAT_SPD, explicit zeros pruned), with the options prefix ``latin_reference_``.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import petsc_matrix
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.reduction import Body, body_load, body_matrix, displacements, reduce, spring_jump
from dolfinx_frontend.scene.laws import Law

__all__ = [
    "Cholesky",
    "Monolithic",
    "ReferenceSolution",
    "Unit",
    "energy_error",
    "monolithic",
    "solvers",
    "unit",
]

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
        Solver not available, or matrix not positive definite.
    """

    def __init__(self, matrix: sp.csr_matrix, solver: str | None = None) -> None:
        available = solvers()
        self.solver = solver if solver is not None else available[0]
        if self.solver not in available:
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
            raise SceneError(_INDEFINITE) from err
        finally:
            if forced:
                options.delValue(_SUPERNODAL)
        # MUMPS goes on after negative pivots and only counts them
        if self.solver == "mumps" and pc.getFactorMatrix().getMumpsInfog(12) > 0:
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


@dataclass(frozen=True)
class ReferenceSolution:
    """Solution of the assembled structure.

    Attributes
    ----------
    u
        Substructure -> displacements (n_e,), length.
    traces
        Interface -> displacement w of each side, (m, d) in the local frame.
    forces
        Elastic, Pressure and Traction interface -> f_1 (m, d) in the local frame, force / area.
        The forces of the other interfaces are nodal reactions, which no point values belong to.
    energy
        Strain energy of the parts and of the springs, force * length.
    residual
        |A q - b| / |b| of the body with the largest one.
    """

    u: dict[str, Array] = field(repr=False)
    traces: dict[str, tuple[Array, ...]] = field(repr=False)
    forces: dict[str, Array] = field(repr=False)
    energy: float
    residual: float


class Monolithic:
    """Monolithic solver that keeps what does not depend on the stiffness of springs and on loads.

    Parameters
    ----------
    problem
        Assembled scene.
    solver
        As in :class:`Cholesky`.
    """

    def __init__(self, problem: Problem, solver: str | None = None) -> None:
        problem.on_one_rank("a monolithic solve")
        self.problem = problem
        self.solver = solver
        self._key: Any = None
        self._bodies: list[Body] = []
        self._bases: list[sp.csr_matrix] = []

    def _prepare(self, laws: Mapping[str, Law]) -> list[Body]:
        """Bodies under these laws; kept as long as only elastic interfaces change."""
        key = [(n, law) for n, law in laws.items() if not law.springs]
        same = self._key is not None and len(key) == len(self._key) and all(
            a == b and law is other for (a, law), (b, other) in zip(key, self._key, strict=True)
        )
        if not same:
            self._bodies = reduce(self.problem, laws, laws)
            self._bases = [_without_springs(self.problem, b) for b in self._bodies]
            self._key = key
        return self._bodies

    def systems(
        self, laws: Mapping[str, Law]
    ) -> list[tuple[Body, sp.csr_matrix, Array]]:
        """Body, matrix and right-hand side of all bodies."""
        out = []
        for body, base in zip(self._prepare(laws), self._bases, strict=True):
            A = base + _springs(self.problem, body, laws)
            out.append((body, A, body_load(self.problem, body, laws)))
        return out

    def solve(
        self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None
    ) -> ReferenceSolution:
        """Solve, with laws or single parameters replaced; see :meth:`assembly.Problem.laws`."""
        current = self.problem.laws(laws, values)
        u: dict[str, Array] = {}
        residual = 0.0
        for body, A, b in self.systems(current):
            q = Cholesky(A, self.solver).solve(b)
            size = np.linalg.norm(b)
            if size > 0.0:
                residual = max(residual, float(np.linalg.norm(A @ q - b) / size))
            u |= displacements(body, q)
        return _solution(self.problem, current, u, residual)


def _without_springs(problem: Problem, body: Body) -> sp.csr_matrix:
    bare = Body(body.members, body.n, body.Z, body.offset, body.load, ())
    return body_matrix(problem, bare)


def _springs(problem: Problem, body: Body, laws: Mapping[str, Law]) -> sp.csr_matrix:
    only = Body((), body.n, body.Z, body.offset, body.load, body.springs)
    return body_matrix(problem, only, laws)


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
    """Solve the assembled structure directly; parameters with a mean take it.

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


def energy_error(
    problem: Problem,
    u: Mapping[str, Array],
    reference: ReferenceSolution,
    values: dict[str, Any] | None = None,
    springs: bool = True,
) -> float:
    """Relative error in the energy norm.

    sqrt( a(u - ur) / a(ur) ) with a(v) = sum v^T K v, plus, with `springs`, sum j^T W kappa_c j
    over the elastic interfaces: j is the jump of u - ur above, the stretch j - Delta of ur below.
    kappa_c is kappa in series with the stiffness E / L of the softer neighbour.  Without that cap a
    rounding error of the jump of a very stiff interface would count as an error of the structure;
    without the springs a rigid motion would count as none.

    Parameters
    ----------
    problem
        Assembled scene.
    u
        Substructure -> displacements (n_e,).
    reference
        What to compare with.
    values
        The parameters with which the reference was solved.
    """
    laws = problem.laws(None, values)
    above = below = 0.0
    for name, s in problem.substructures.items():
        e = np.asarray(u[name]) - reference.u[name]
        above += float(e @ (s.matrix @ e))
        below += float(reference.u[name] @ (s.matrix @ reference.u[name]))
    error = {name: np.asarray(u[name]) - reference.u[name] for name in problem.substructures}
    for name, i in problem.interfaces.items():
        law = laws[name]
        if not springs or not law.springs:
            continue
        parts = [problem.substructures[s.substructure] for s in i.sides]
        cap = min(p.modulus / p.length for p in parts)
        kappa = law.stiffnesses(i)
        k = i.weights[:, None] * kappa * cap / (kappa + cap)
        above += float(np.sum(k * spring_jump(problem, name, error) ** 2))
        stretch = spring_jump(problem, name, reference.u) - law.jumps(i)
        below += float(np.sum(k * stretch**2))
    if below == 0.0:
        return 0.0 if above == 0.0 else float("inf")
    return float(np.sqrt(max(above, 0.0) / below))


def energy_difference(problem: Problem, one: Any, other: Any) -> float:
    """Relative difference of two results in the strain energy of all bodies, over all times.

    Parameters
    ----------
    problem
        Assembled scene of both.
    one, other
        Results, with ``displacements`` of (n_e,) or (T, n_e); `other` is the reference.
    """
    above = below = 0.0
    for name, part in problem.substructures.items():
        exact = np.atleast_2d(other.displacements[name]).T
        error = np.atleast_2d(one.displacements[name]).T - exact
        above += float(np.sum(error * (part.matrix @ error)))
        below += float(np.sum(exact * (part.matrix @ exact)))
    return float(np.sqrt(abs(above) / below))


@dataclass(frozen=True)
class Unit:
    """The unit of cost: one analysis, factorisation and solve of the assembled structure."""

    solver: str
    seconds: float
    dof: int
    nnz: int


def unit(problem: Problem, repeats: int = 3) -> Unit:
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
