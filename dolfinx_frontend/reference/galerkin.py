"""Monolithic stochastic finite elements (SSFEM): oracle of LATIN-PCE and its strong baseline.

All interfaces are assembled across and the displacement is a chaos, u = sum_j u_j Psi_j (Blanze,
Champaney, Boucard, ECCOMAS 2004, equations 14 to 19).  With random spring stiffnesses
a = sum_i a_i Psi_i and jumps j_k = B u_k of the springs,

    K_0 u_k + B^T W sum_j A_kj (B u_j - Delta_j) = F_k,    A_kj = sum_i a_i E[Psi_i Psi_j Psi_k],

for all modes k: one system of n (P + 1) unknowns.  K_0 holds the parts and the fixed springs; A is
one matrix for a uniform parameter and one per point for a random field.  Delta_j and F_j are the
coefficients of imposed jumps and loads on the basis, so a random stiffness times a random jump is
A(a) times the projection of the jump: the same definition as in LATIN-PCE.

The operator is applied and never formed, and conjugate gradients are preconditioned by the factor
of its mean block, which solves for all modes at once.  Only ``solver="direct"``, for small cases,
forms and factorises it.  PETSc options: prefix ``latin_ssfem_`` for the Krylov solver,
``latin_reference_`` for the factors.

Of a problem whose parts are on several ranks the first one is given all matrices, and solves.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
from latin_core import stochastic as core
from latin_core.stochastic import ChaosBasis
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.gathered import by_first, gathered
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem, check_is_problem
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_callable,
    checked_number,
    checked_whole,
)
from dolfinx_frontend.common.deferred import sp, spla
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.random_laws import RandomLaws, warn_of_free_parts
from dolfinx_frontend.plan.reduction import Body, body_matrix, reduce, spring_jump, spring_operator
from dolfinx_frontend.reference.cholesky import Cholesky
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.expressions import Expression
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.parameters import RandomParameter
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["SSFEMSolution", "smallest_eigenvalue", "ssfem"]

PETSc: Any = _PETSc  # its stubs know no members
Source = RandomParameter | DiscretisedField | Expression

_PREFIX = "latin_ssfem_"


class _BlockCholesky(Cholesky):
    """Factor with a solve for many right-hand sides at once."""

    def solve_block(self, B: Array) -> Array:
        """Solutions (n, c) of A X = B."""
        b = np.array(B, dtype=np.float64, order="F")
        x = np.empty_like(b)
        left, right = (
            PETSc.Mat().createDense(a.shape, array=a, comm=PETSc.COMM_SELF) for a in (x, b)
        )
        self._ksp.getPC().getFactorMatrix().matSolve(right, left)
        left.destroy()
        right.destroy()
        return x


class _Coupling:
    """The product with a random stiffness a, projected on the basis: v_k = sum_j A_kj u_j.

    Attributes
    ----------
    kernel
        Applies it: of a parameter one matrix A, of a field on m points one per point; force / length^3.
    """

    def __init__(self, space: RandomSpace, source: Source, basis: ChaosBasis, scale: float) -> None:
        coefficients, indices = space.expansion(source, basis)
        self.kernel = core.Coupling(basis, scale * coefficients, indices)

    @property
    def entries(self) -> tuple[Ints, Ints, Array]:
        """Modes j and k of the entries of A that are stored, and their values (1 or m, entries)."""
        return self.kernel.entries

    def matrix(self, row: int) -> Array:
        """A (P + 1, P + 1) at one point."""
        return self.kernel.matrix(row)

    def __call__(self, u: Array) -> Array:
        """Fields (m, components, P + 1) at the points times a."""
        found = self.kernel.apply(u.reshape(-1, u.shape[2]), u.shape[1])
        return found.reshape(u.shape)

    @property
    def smallest(self) -> float:
        """Smallest eigenvalue over all points."""
        return self.kernel.smallest()

    @property
    def definite(self) -> bool:
        """Whether the matrices of all points are positive definite."""
        return bool(self.kernel.bounds().min() > 0.0) or self.smallest > 0.0


@dataclass(frozen=True)
class _Spring:
    """An elastic interface with chaos modes."""

    interface: Interface
    fixed: Array  # (m, d) stiffness that is not random, 0 elsewhere
    mean: Array  # (m, d)
    random: tuple[tuple[str, slice, _Coupling], ...]  # parameter, components, product
    imposed: Array  # (m, d, P + 1) coefficients of Delta

    def force(self, jump: Array) -> Array:
        """f_1 (m, d, P + 1) of jumps of this shape."""
        stretch = jump - self.imposed
        out: Array = self.fixed[:, :, None] * stretch
        for _, components, product in self.random:
            out[:, components] = product(stretch[:, components])
        return out


class _System:
    """The stochastic Galerkin system of a problem, never formed.

    Unknowns are (n, P + 1) blocks in C order, n of all bodies one after the other.
    """

    def __init__(self, problem: Problem, chaos: Chaos) -> None:
        self.problem = problem
        self.random = RandomLaws.of(problem)
        # Krylov vectors, products and a right-hand side for each mode
        self.basis = self.random.space.basis(chaos, rows=10 * problem.size)
        self.columns = len(self.basis)
        self.bodies = reduce(problem, problem.interfaces)
        starts = np.cumsum([0] + [b.n for b in self.bodies])
        self.slices = [slice(int(a), int(b)) for a, b in zip(starts, starts[1:], strict=False)]
        self.size = int(starts[-1])
        self.springs = {
            name: self._spring(i)
            for name, i in problem.interfaces.items()
            if i.law.springs
        }
        self.offsets = self._offsets()
        self.fixed: list[sp.csr_matrix] = []
        self.mean: list[sp.csr_matrix] = []
        self.products: list[list[tuple[sp.csr_matrix, Array, _Coupling]]] = []
        self.fields = self._fields()
        for body in self.bodies:
            self._assemble(body)
        self.scaled = [self._scaled(body) for body in self.bodies]
        self.load = np.concatenate([self._load(body) for body in self.bodies])

    # -- pieces --------------------------------------------------------------------------------
    def _modes(self, name: str, parameter: str) -> Array:
        """Coefficients (1 or m, P + 1) of a random value."""
        source = self.random.source(name, parameter)
        assert source is not None
        out: Array = self.random.space.coefficients(source, self.basis)
        return out

    def _spring(self, i: Interface) -> _Spring:
        law = i.law
        mean = law.stiffnesses(i)
        fixed, random = mean.copy(), []
        for parameter, components in law.spans.items():
            source = self.random.source(i.name, parameter)
            if source is not None:
                scale = self.random.area_factor(i.name, parameter)
                product = _Coupling(self.random.space, source, self.basis, scale)
                random.append((parameter, components, product))
                fixed[:, components] = 0.0
        imposed = np.zeros((i.num_points, i.dim, self.columns))
        if self.random.source(i.name, "jump") is not None:
            imposed[:, 0] = self._modes(i.name, "jump")
        else:
            imposed[:, :, 0] = law.jumps(i)
        return _Spring(i, fixed, mean, tuple(random), imposed)

    def _offsets(self) -> dict[str, Array]:
        """Substructure -> prescribed part (n_e, P + 1) of the displacement."""
        parts = self.problem.substructures
        out: dict[str, Array] = {n: np.zeros((s.size, self.columns)) for n, s in parts.items()}

        def add(laws: Mapping[str, Law], modes: Array) -> None:
            again = reduce(self.problem, self.problem.interfaces, laws) if laws else self.bodies
            for body in again:
                for m in body.members:
                    out[m] += body.offset[m][:, None] * modes

        values = {
            name: parameter
            for name, i in self.problem.interfaces.items()
            if i.law.prescribes == "jump"
            for parameter in i.law.parameters()
        }
        sources: dict[str, list[str]] = {}
        for name, parameter in values.items():
            source = self.random.source(name, parameter)
            if isinstance(source, DiscretisedField):
                raise SceneError(
                    f"interface {name!r}: the random field {source.name!r} cannot be prescribed, "
                    f"{parameter} is needed at nodes; use a random parameter"
                )
            if source is not None:
                sources.setdefault(source.name, []).append(name)
        # linear in the values: the sum of what each random parameter alone and the fixed ones do
        laws = {n: self.problem.interfaces[n].law.with_(**{p: 0.0}) for n, p in values.items()}
        random = {n: laws[n] for names in sources.values() for n in names}
        add(random, np.eye(1, self.columns)[0])
        for names in sources.values():
            unit = {n: laws[n].with_(**{values[n]: 1.0}) for n in names}
            add(laws | unit, self._modes(names[0], values[names[0]])[0])
        return out

    def _assemble(self, body: Body) -> None:
        """Matrix of the fixed part and of the mean, products of the random springs."""
        fixed = body_matrix(self.problem, dataclasses.replace(body, springs=()))
        mean = fixed
        products: list[tuple[sp.csr_matrix, Array, _Coupling]] = []
        for m in body.members:
            if m in self.fields:
                stretch = self.problem.stretch(m)
                B = (stretch.matrix @ body.Z[m]).tocsr()
                fixed = fixed - B.T @ B
                products.append((B, np.ones(len(stretch.weights)), self.fields[m]))
        for name in body.springs:
            s = self.springs[name]
            i = s.interface
            B = spring_operator(self.problem, body, name, i.law)[0]
            w = i.weights[:, None]
            fixed = fixed + B.T @ sp.diags((w * s.fixed).ravel()) @ B
            mean = mean + B.T @ sp.diags((w * s.mean).ravel()) @ B
            for _, components, product in s.random:
                rows = np.arange(B.shape[0]).reshape(i.num_points, i.dim)[:, components]
                products.append((B[rows.ravel()].tocsr(), i.weights, product))
        self.fixed.append(fixed.tocsr())
        self.mean.append(mean.tocsr())
        self.products.append(products)

    def _fields(self) -> dict[str, _Coupling]:
        """Parts -> the product with the random field of their stiffness, relative to the mean."""
        space = self.random.space
        return {part: _Coupling(space, s, self.basis, 1.0) for part, s in self.random.fields.items()}

    def _factor(self, part: str) -> Array:
        """Galerkin matrix (P + 1, P + 1) of the random factor of a part's stiffness."""
        matrix = self.random.space.galerkin_matrix(self.random.parts[part], self.basis)
        return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix)

    def _scaled(self, body: Body) -> list[tuple[sp.csr_matrix, Array]]:
        """Z^T K Z of parts with a random factor, and its Galerkin matrix less that of the mean."""
        found = []
        for m in body.members:
            if m in self.random.scaled:
                Z = body.Z[m]
                K = (Z.T @ self.problem.substructures[m].matrix @ Z).tocsr()
                found.append((K, self._factor(m) - np.eye(self.columns)))
        return found

    def _load(self, body: Body) -> Array:
        """Right-hand side (n, P + 1)."""
        f = np.zeros((body.n, self.columns))
        for m in body.members:
            offset, load = self.offsets[m], np.zeros_like(self.offsets[m])
            load[:, 0] = body.load[m]
            if m in self.fields:
                self._stretched(m, load)
            if m in self.random.scaled:
                self._loads_of_stiffness(m, load)
            for term in self.random.loads:
                nodal = self.problem.loads[term.load].on(m, term.parameter)
                if m in self.random.parts and term.parameter in self.problem.loads[term.load].stresses:
                    continue
                if nodal is not None:  # the mean is in the load of the body
                    load[:, 1:] += np.outer(nodal, self.random.load_coefficients(term, self.basis)[1:])
            if np.any(offset):
                moved = self.problem.substructures[m].matrix @ offset
                load -= moved @ self._factor(m) if m in self.random.scaled else moved
            for i in self.problem.interfaces.values():
                if i.sides[0].substructure == m and i.law.prescribes == "force":
                    self._random_force(i, load)
            f += body.Z[m].T @ load
        for name in body.springs:
            s = self.springs[name]
            i = s.interface
            B = spring_operator(self.problem, body, name, i.law)[0]
            force = s.force(spring_jump(self.problem, name, self.offsets))
            f -= B.T @ (i.weights[:, None, None] * force).reshape(-1, self.columns)
        return f

    def _stretched(self, part: str, load: Array) -> None:
        """Replace the forces of initial strains by these times the field, and add what it adds to those of
        prescribed displacements."""
        stretch, s = self.problem.stretch(part), self.problem.substructures[part]
        initial = np.zeros((stretch.matrix.shape[0], self.columns))
        for each in self.problem.loads.values():
            for term in each.keys():
                if each.load.part == part and term.parameter in each.stresses:
                    own = stretch.initial(s, each.stresses[term.parameter])
                    initial += np.outer(own, self.random.load_coefficients(term, self.basis))
                    mean = each.mean(term.parameter, term.amplitude)
                    load[:, 0] -= mean * each.columns[term.parameter][part]
        load += stretch.matrix.T @ self._times_field(part, initial)
        moved = stretch.matrix @ self.offsets[part]
        load -= stretch.matrix.T @ (self._times_field(part, moved) - moved)

    def _times_field(self, part: str, stretches: Array) -> Array:
        shaped = np.ascontiguousarray(stretches.reshape(-1, 1, self.columns))
        components = self.problem.stretch(part).components
        found = self.fields[part](shaped.reshape(-1, components, self.columns))
        return found.reshape(stretches.shape)

    def _loads_of_stiffness(self, part: str, load: Array) -> None:
        """Replace the means of initial strains by these times the random factor of the stiffness."""
        factor = self._factor(part)
        for each in self.problem.loads.values():
            for term in each.keys():
                nodal = each.on(part, term.parameter)
                if nodal is not None and term.parameter in each.stresses:
                    modes = self.random.load_coefficients(term, self.basis)
                    load[:, 0] -= each.mean(term.parameter, term.amplitude) * nodal
                    load += np.outer(nodal, factor @ modes)

    def _random_force(self, i: Interface, load: Array) -> None:
        """Modes of a random pressure or traction, without the mean, which the body has already."""
        for parameter in i.law.parameters():
            if self.random.source(i.name, parameter) is None:
                continue
            modes = self._modes(i.name, parameter)
            for k in np.flatnonzero(np.any(modes != 0.0, axis=0)):
                if k == 0:
                    continue
                value = float(modes[0, k]) if len(modes) == 1 else modes[:, k]
                given = i.law.with_(**{parameter: value}).load(i)
                assert given is not None  # it prescribes a force
                f = (i.weights[:, None] * given).ravel()
                load[:, k] += i.local_trace(0).T @ f

    # -- operators -----------------------------------------------------------------------------
    @cached_property
    def operator(self) -> core.GalerkinOperator:
        """The kernel's operator of all bodies."""
        terms = []
        for part, products in zip(self.slices, self.products, strict=True):
            for B, weights, product in products:
                rows = B.tocoo()
                where = (rows.row, rows.col + part.start)
                wide = sp.csr_matrix((rows.data, where), shape=(B.shape[0], self.size))
                terms.append((wide, weights, product.kernel))
        return core.GalerkinOperator(sp.block_diag(self.fixed, format="csr"), terms, self.columns)

    def apply(self, q: Array) -> Array:
        """The operator on (n, P + 1)."""
        found = self.operator.apply(q)
        for part, terms in zip(self.slices, self.scaled, strict=True):
            for K, factor in terms:
                found[part] += K @ q[part] @ factor
        return found

    def apply_mean(self, q: Array) -> Array:
        """The mean block on each mode of (n, P + 1)."""
        return np.concatenate([A @ q[s] for A, s in zip(self.mean, self.slices, strict=True)])

    def factor(self) -> Callable[[Array], Array]:
        """Solution with the mean block for each mode of (n, P + 1)."""
        factors = [_BlockCholesky(A) for A in self.mean]
        return lambda q: np.concatenate(
            [f.solve_block(q[s]) for f, s in zip(factors, self.slices, strict=True)]
        )

    def matrices(self) -> list[sp.csr_matrix]:
        """The operator of each body, formed: (n (P + 1), n (P + 1)), mode fastest."""
        c = self.columns
        out: list[sp.csr_matrix] = []
        for fixed, products in zip(self.fixed, self.products, strict=True):
            A = sp.kron(fixed, sp.identity(c), "csr")
            for B, weights, product in products:
                rows = B.shape[0]
                first, second, values = product.entries
                values = np.broadcast_to(values, (len(weights), len(first)))
                values = np.repeat(weights[:, None] * values, rows // len(weights), axis=0)
                start = c * np.arange(rows)[:, None]
                where = (start + first).ravel(), (start + second).ravel()
                law = sp.coo_matrix((values.ravel(), where), shape=(rows * c, rows * c)).tocsr()
                trace = sp.kron(B, sp.identity(c), "csr")
                A = A + trace.T @ law @ trace
            for K, factor in self.scaled[len(out)]:
                A = A + sp.kron(K, sp.csr_matrix(factor), "csr")
            out.append(A)
        return out

    def indefinite(self) -> SceneError:
        """Which stiffness is to blame."""
        bad = []
        for name, s in self.springs.items():
            for parameter, _, product in s.random:
                source = self.random.source(name, parameter)
                if source is not None and not product.definite:
                    bad.append(
                        f"interface {name!r}, {parameter} stiffness {source.name!r}: smallest "
                        f"eigenvalue {product.smallest:.4g} of its Galerkin matrix"
                    )
        for part, product in self.fields.items():
            if self.random.fields[part].affine and product.smallest <= 0.0:
                bad.append(
                    f"substructure {part!r}: smallest eigenvalue {product.smallest:.4g} of its random field"
                )
        for part in self.random.scaled:
            smallest = float(np.linalg.eigvalsh(self._factor(part))[0])
            if smallest <= 0.0:
                bad.append(f"substructure {part!r}: smallest eigenvalue {smallest:.4g} of its factor")
        return SceneError(
            "the stochastic Galerkin operator is not positive definite ("
            + ("; ".join(bad) or "something is not held")
            + "); take a positive law such as LogNormal, Gamma or TruncatedNormal, or a lower order"
        )


class _Applied:
    """The operator of a system for PETSc, where the kernel's does not have all of it."""

    def __init__(self, system: _System) -> None:
        self.system = system

    def mult(self, _: Any, x: Any, y: Any) -> None:
        y.setArray(self.system.apply(x.getArray(readonly=True).reshape(self.system.load.shape)).ravel())


@dataclass(frozen=True)
class SSFEMSolution:
    """Chaos of the monolithic solution; coefficient 0 is the mean.

    Attributes
    ----------
    problem, random, basis
        What was solved, with what randomness, on which modes.
    coefficients
        Substructure (of this rank) -> displacement modes (n_e, P + 1), length.
    unknowns
        n (P + 1) of the system that was solved.
    converged
        Whether the tolerance was reached (always, by the direct solver).
    iterations
        Of conjugate gradients; 0 if direct.
    residuals
        (iterations + 1,) norm of the residual in the inverse of the mean block, relative to the
        first: the energy error up to the square root of the condition number of `spectrum`.
    residual
        True |F - A u| / |F|, Euclidean norm.
    spectrum
        Smallest and largest Ritz value of the operator relative to its mean block; nan if direct.
    seconds
        ``assembly``, ``factor``, ``iterations`` -> wall time.
    jumps
        Interface -> see :meth:`jump_coefficients`.
    forces
        Elastic interface -> see :meth:`force_coefficients`.
    """

    problem: Problem = field(repr=False)
    random: RandomLaws = field(repr=False)
    basis: ChaosBasis = field(repr=False)
    coefficients: dict[str, Array] = field(repr=False)
    unknowns: int
    converged: bool
    iterations: int
    residuals: Array = field(repr=False)
    residual: float
    spectrum: tuple[float, float]
    seconds: dict[str, float]
    jumps: dict[str, Array] = field(repr=False)
    forces: dict[str, Array] = field(repr=False)

    @property
    def space(self) -> RandomSpace:
        """The germs."""
        return self.random.space

    def _modes(self, substructure: str) -> Array:
        self.problem.check_here(substructure)
        check_known("substructure", substructure, self.coefficients, "solution")
        return self.coefficients[substructure]

    def mean(self, substructure: str) -> Array:
        """Expectation (n_e,) of the displacement."""
        return core.mean(self._modes(substructure))

    def std(self, substructure: str) -> Array:
        """Standard deviation (n_e,) of the displacement."""
        return np.sqrt(core.variance(self._modes(substructure)))

    def jump_coefficients(self, interface: str) -> Array:
        """Modes (m, d, P + 1) of the jump w_2 - w_1 in the local frame, length."""
        check_known("interface", interface, self.problem.interfaces, "solution")
        return self.jumps[interface]

    def force_coefficients(self, interface: str) -> Array:
        """Modes (m, d, P + 1) of f_1 = kappa (j - Delta) in the local frame, force / area.

        Raises
        ------
        SceneError
            The interface is not elastic: its force is a reaction at nodes.
        """
        check_known("interface", interface, self.problem.interfaces, "solution")
        if interface not in self.forces:
            law = self.problem.interfaces[interface].law.title
            raise SceneError(
                f"interface {interface!r} is {law}; only elastic interfaces have a force at points"
            )
        return self.forces[interface]


def ssfem(
    problem: Problem,
    chaos: Chaos,
    solver: Literal["cg", "direct"] = "cg",
    rtol: float = 1e-12,
    max_iterations: int = 1000,
    callback: Callable[[int, float], None] | None = None,
) -> SSFEMSolution:
    """Solve the stochastic Galerkin equations of the assembled structure. Collective on several ranks, of
    which the first one solves, and each gets the modes of its parts.

    Parameters
    ----------
    problem
        Assembled scene, with random values in its laws.
    chaos
        The basis.
    solver
        ``"cg"``: conjugate gradients with the mean block as preconditioner; ``"direct"``: Cholesky
        of the operator, for small cases: its memory grows faster than the number of modes squared.
    rtol
        Of the residual norm in the inverse of the mean block, which estimates the energy error.
    max_iterations
        Of conjugate gradients; nothing is raised when they do not suffice.
    callback
        Called with the iteration and the relative residual norm, on the rank that solves; it may raise to end
        the run.

    Where one stiffness is indefinite but the whole operator is not, the solution is given.

    Raises
    ------
    SceneError
        An interface that cannot be eliminated, see :func:`reduction.reduce`; a basis that needs
        more memory than there is; a random field that is prescribed at nodes; an operator that is
        not positive definite.
    """
    check_known("solver", solver, ("cg", "direct"), "ssfem")
    _check_request("ssfem", problem, chaos, rtol)
    checked_whole("ssfem", "max_iterations", max_iterations, 1)
    if callback is not None:
        checked_callable("ssfem", "callback", callback, "give a function of iteration and residual", 2)
    given = {"chaos": chaos, "solver": solver, "rtol": rtol, "max_iterations": max_iterations}
    problem.check_alike("ssfem", laws=True, **given)
    random = RandomLaws.of(problem)
    warn_of_free_parts("ssfem", random)

    def solved(whole: Problem) -> _Solved:
        return _solved(whole, chaos, solver, rtol, max_iterations, callback)

    found = by_first(problem, gathered(problem), solved)
    coefficients = {name: found.coefficients[name] for name in problem.substructures}
    return SSFEMSolution(
        problem, random, random.space.basis(chaos), **{**found._asdict(), "coefficients": coefficients}
    )


class _Solved(NamedTuple):
    """What the rank that solves tells the others: attributes of :class:`SSFEMSolution`."""

    coefficients: dict[str, Array]
    unknowns: int
    converged: bool
    iterations: int
    residuals: Array
    residual: float
    spectrum: tuple[float, float]
    seconds: dict[str, float]
    jumps: dict[str, Array]
    forces: dict[str, Array]


def _solved(
    problem: Problem,
    chaos: Chaos,
    solver: str,
    rtol: float,
    max_iterations: int,
    callback: Callable[[int, float], None] | None,
) -> _Solved:
    began = perf_counter()
    system = _System(problem, chaos)
    matrices = system.matrices() if solver == "direct" else []
    seconds = {"assembly": perf_counter() - began}
    began = perf_counter()
    if solver == "direct":
        q = _direct(system, matrices, seconds)
        converged, spectrum = True, (float("nan"), float("nan"))
        residuals: Array = np.zeros(1)
    else:
        precondition = system.factor()
        # a right-hand side may hide an indefinite operator from conjugate gradients
        products = [p for s in system.springs.values() for _, _, p in s.random]
        factors = [np.eye(system.columns) + f for terms in system.scaled for _, f in terms]
        least = min((float(np.linalg.eigvalsh(f)[0]) for f in factors), default=1.0)
        if least <= 0.0:
            raise system.indefinite()
        products += [p for part, p in system.fields.items() if system.random.fields[part].affine]
        if not all(p.definite for p in products):
            if _smallest(system, precondition, 1e-3) <= 0.0:
                raise system.indefinite()
        seconds["factor"] = perf_counter() - began
        began = perf_counter()
        q, converged, residuals, spectrum = _conjugate_gradients(
            system, precondition, rtol, max_iterations, callback
        )
        seconds["iterations"] = perf_counter() - began
    size = np.linalg.norm(system.load)
    residual = float(np.linalg.norm(system.load - system.apply(q)) / size) if size > 0.0 else 0.0
    coefficients = {
        m: body.Z[m] @ q[part] + system.offsets[m]
        for body, part in zip(system.bodies, system.slices, strict=True)
        for m in body.members
    }
    jumps = {name: spring_jump(problem, name, coefficients) for name in problem.interfaces}
    return _Solved(
        {name: coefficients[name] for name in problem.substructures},
        q.size,
        converged,
        len(residuals) - 1,
        residuals,
        residual,
        spectrum,
        seconds,
        jumps,
        {name: spring.force(jumps[name]) for name, spring in system.springs.items()},
    )


def _direct(system: _System, matrices: Sequence[sp.csr_matrix], seconds: dict[str, float]) -> Array:
    """The solution (n, P + 1) by Cholesky factors of the operator's blocks."""
    q: Array = np.empty_like(system.load)
    began = perf_counter()
    try:
        factors = [Cholesky(A) for A in matrices]
        seconds["factor"] = perf_counter() - began
        began = perf_counter()
        for part, factor in zip(system.slices, factors, strict=True):
            q[part] = factor.solve(system.load[part].ravel()).reshape(-1, system.columns)
    except SceneError as error:
        raise system.indefinite() from error
    seconds["iterations"] = perf_counter() - began
    return q


def _conjugate_gradients(
    system: _System,
    precondition: Callable[[Array], Array],
    rtol: float,
    max_iterations: int,
    callback: Callable[[int, float], None] | None,
) -> tuple[Array, bool, Array, tuple[float, float]]:
    """Solution (n, P + 1), whether converged, residual history, extreme Ritz values."""
    shape = system.load.shape
    norms: list[float] = []

    class MeanBlock:
        def apply(self, _: Any, x: Any, y: Any) -> None:
            y.setArray(precondition(x.getArray(readonly=True).reshape(shape)).ravel())

    def monitor(_: Any, iteration: int, norm: float) -> None:
        norms.append(norm)
        if callback is not None:
            callback(iteration, norm / norms[0] if norms[0] > 0.0 else 0.0)

    A = system.operator.matrix()
    if any(system.scaled):
        sizes = (system.load.size, system.load.size)
        A = PETSc.Mat().createPython(sizes, _Applied(system), comm=PETSc.COMM_SELF)
        A.setUp()
    x, b = A.createVecs()
    b.setArray(system.load.ravel())
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOptionsPrefix(_PREFIX)
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.setNormType(PETSc.KSP.NormType.NATURAL)
    ksp.setTolerances(rtol=rtol, atol=0.0, max_it=max_iterations)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(MeanBlock())
    ksp.setComputeEigenvalues(True)
    ksp.setMonitor(monitor)
    ksp.setFromOptions()
    try:
        ksp.solve(b, x)
    except PETSc.Error as error:
        if error.__cause__ is not None:  # what the callback raised
            raise error.__cause__ from None
        raise
    reason = ksp.getConvergedReason()
    spectrum = (float("nan"), float("nan"))
    if ksp.getIterationNumber() > 0 and ksp.getType() == PETSc.KSP.Type.CG:
        ritz = np.real(ksp.computeEigenvalues())
        spectrum = (float(ritz.min()), float(ritz.max()))
    R = PETSc.KSP.ConvergedReason
    if reason in (R.DIVERGED_INDEFINITE_MAT, R.DIVERGED_INDEFINITE_PC) or spectrum[0] <= 0.0:
        raise system.indefinite()
    residuals = np.array(norms) / norms[0] if norms[0] > 0.0 else np.zeros(1)
    q = np.array(x.getArray()).reshape(shape)
    for petsc in (ksp, A, x, b):
        petsc.destroy()
    return q, reason > 0, residuals, spectrum


def smallest_eigenvalue(problem: Problem, chaos: Chaos, rtol: float = 1e-8) -> float:
    """Smallest eigenvalue of the monolithic operator relative to its mean block, no unit.

    A x = lambda (K_mean (x) I) x by Lanczos with the factor of the mean block, without shifts.  The
    operator is positive definite if and only if it is positive.  1 without randomness; for one
    normal stiffness 1 - cov * root * share, with the greatest root of He_p+1 and the greatest share
    of the mean strain energy that a displacement can have in the springs. Collective on several ranks, of
    which the first one computes it.
    """
    _check_request("smallest_eigenvalue", problem, chaos, rtol)
    problem.check_alike("smallest_eigenvalue", laws=True, chaos=chaos, rtol=rtol)

    def smallest(whole: Problem) -> float:
        system = _System(whole, chaos)
        return _smallest(system, system.factor(), rtol)

    return by_first(problem, gathered(problem), smallest)


def _check_request(where: str, problem: object, chaos: object, rtol: object) -> None:
    """Refuse what is no problem, no request of a chaos, or no tolerance."""
    check_is_problem(where, problem)
    check_kind(where, "chaos", chaos, Chaos, "give Chaos(order)")
    checked_number(where, "rtol", rtol, above=0.0, below=1.0)


def _smallest(system: _System, solve: Callable[[Array], Array], rtol: float) -> float:
    size = system.load.size
    if not any(system.products) and not any(system.scaled):
        return 1.0

    def operator(function: Callable[[Array], Array]) -> Any:
        def multiply(v: Array) -> Array:
            return function(v.reshape(system.load.shape)).ravel()

        return spla.LinearOperator((size, size), matvec=multiply, dtype=np.float64)

    values = spla.eigsh(
        operator(system.apply),
        k=1,
        M=operator(system.apply_mean),
        Minv=operator(solve),
        which="SA",
        v0=np.random.default_rng(0).standard_normal(size),
        tol=rtol,
        return_eigenvectors=False,
    )
    return float(values[0])
