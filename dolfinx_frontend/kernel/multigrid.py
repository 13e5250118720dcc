"""Multigrid for the bodies of a plan: an approximate inverse that needs no factor of their matrix.

Two levels where the shape functions are of a higher degree: the linear ones on the same mesh, an eighth of
the unknowns of quadratic ones in 3D, are factorised, and the rest is left to Chebyshev polynomials of the
matrix.  Where they are linear already, or where their factor does not fit into the memory, PETSc's GAMG is
told the rigid motions; the lower level is then solved by conjugate gradients, as one cycle leaves most of its
error.

The matrix of the bodies is on the ranks that have them, and only springs are between ranks. What is
factorised, or given to PETSc as a whole, is one matrix of all ranks.

PETSc options with the prefix ``latin_body_`` replace any of it (``-latin_body_pc_type gamg``,
``-latin_body_mg_levels_ksp_max_it 2``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import csr, petsc_matrix
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import swap
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.assembly.vertices import in_thin_cells, vertices_of
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.deferred import sp, spla
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.kernel.rows import Rows, placed

__all__ = [
    "GLUE",
    "PREFIX",
    "Coarse",
    "Multigrid",
    "Spring",
    "jumps",
    "linear_shapes",
    "multiplied",
    "rigid_motions",
]

PETSc: Any = _PETSc  # its stubs know no members

PREFIX = "latin_body_"

GLUE = 1e6
"""Stiffness of glue that stays active, over its search direction. The fields of a basis have to be joined, as
the law lets nothing else pass: with 1e3 they are not (errors stay above 1e-5), with 1e5 to 1e7 they are."""

_STEPS = 3
"""Of the smoother, before and after the coarse level."""

_SMOOTHER: dict[str, Any] = {"ksp_type": "chebyshev", "ksp_max_it": _STEPS, "pc_type": "jacobi"}
_GAMG: dict[str, Any] = {"pc_type": "gamg", "pc_gamg_threshold": 0.01}
_ITERATED: dict[str, Any] = {"ksp_type": "cg", "ksp_rtol": 0.1}
"""Of a lower level without a factor: with a tenth of its residual left rounds converge as with a factor."""


def _of_packages(**packages: str) -> list[str]:
    """Those solvers whose packages PETSc has been built with."""
    return [name for package, name in packages.items() if PETSc.Sys.hasExternalPackage(package)]


_THERE = _of_packages(suitesparse="cholmod", mumps="mumps")
_FACTORISED: dict[str, Any] = {
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": (_THERE or ["petsc"])[0],
}
_FACTORISED_BY_ALL: dict[str, Any] = (
    {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
    if "mumps" in _THERE
    else {"pc_type": "redundant", "redundant_pc_type": "cholesky"}  # every rank has all of it
)


class Coarse(NamedTuple):
    """A coarse level.

    Attributes
    ----------
    prolongation
        (n, c) from its unknowns.
    owners
        (c,) the unknown that each of them is on the fine level.
    """

    prolongation: sp.csr_matrix
    owners: Ints


class Spring(NamedTuple):
    """Springs that pull at jumps of the unknowns.

    Attributes
    ----------
    jump
        (rows, n).
    stiffness
        (rows,)
    other
        Rank whose unknowns are in the jumps as well; None: there is none.
    glue
        Whether they stand for glue, which has no energy of its own.
    """

    jump: sp.csr_matrix
    stiffness: Array
    other: int | None = None
    glue: bool = False

    def of_body(self, own: slice) -> Spring:
        """What holds a body, some of the unknowns, when all others rest; glue no stiffer than a body, whose
        digits it would take."""
        stiffness = np.asarray(self.stiffness / (GLUE if self.glue else 1.0), dtype=np.float64)
        return Spring(self.jump[:, own], stiffness)

    @property
    def counted(self) -> float:
        """Share of the energy that is counted on this rank: the other one counts it, too."""
        return 0.0 if self.glue else 1.0 if self.other is None else 0.5

    def pull(self, jump: Array) -> Array:
        """Forces (n, c) of jumps (rows, c)."""
        return np.asarray(self.jump.T @ (self.stiffness[:, None] * jump))

    def forces(self, block: Array) -> Array:
        """(n, c) of displacements (n, c) of this rank alone."""
        return self.pull(self.jump @ block)

    def matrix(self, jump: sp.csr_matrix) -> sp.csr_matrix:
        """Forces (n, m) of jumps (rows, m) that some unknowns make."""
        return (self.jump.T @ sp.diags(self.stiffness) @ jump).tocsr()

    def seen_from(self, fields: sp.csr_matrix) -> Spring:
        """The same springs in other unknowns, of which these are `fields` (n, c)."""
        return self._replace(jump=(self.jump @ fields).tocsr())


def jumps(springs: Sequence[Spring], own: Sequence[Array], rows: Rows) -> list[Array]:
    """Jumps (rows, c) of springs, of what the unknowns of this rank make of them."""
    return rows.completed(own, [each.other for each in springs])


class Multigrid:
    """One cycle for a symmetric positive definite matrix with springs.

    Parameters
    ----------
    matrix
        PETSc AIJ matrix (n, n) of this rank.
    coarse
        The linear shape functions; None: there are no others.
    rigid
        (n, r) rigid motions.
    springs
        Added to the matrix. The two levels apply them one after the other: beside soft parts, sums would take
        the digits of the matrix.
    rows
        Of this rank among those of all.
    factorised
        Whether a factor of the coarse level fits into the memory; the same on all ranks.
    """

    def __init__(
        self,
        matrix: Any,
        coarse: Coarse | None,
        rigid: Array,
        springs: Sequence[Spring] = (),
        rows: Rows | None = None,
        factorised: bool = True,
    ) -> None:
        self.matrix, self.springs, self.rows = matrix, springs, rows or Rows()
        diagonal = np.array(matrix.getDiagonal().getArray())
        for spring in springs:
            diagonal += spring.jump.multiply(spring.jump).T @ spring.stiffness
        self.diagonal = diagonal
        self._levels: _Levels | None = None
        if coarse is None:
            self.kind = "aggregation"
            matrix = self._summed()
            _tell_rigid_motions(matrix, rigid, self.rows)
            self.pc = PETSc.PC().create(self.rows.petsc)
            self.pc.setOptionsPrefix(PREFIX)
            self.pc.setOperators(matrix)
            _set_up(self.pc, PREFIX, _GAMG | {f"mg_levels_{key}": value for key, value in _SMOOTHER.items()})
        else:
            matrix = self._two_levels(coarse, rigid, factorised)
        self._left, self._right = matrix.createVecs()

    def _two_levels(self, coarse: Coarse, rigid: Array, factorised: bool) -> Any:
        """The linear shape functions below; PETSc's own cycle where the user gave options for it.

        Returns the matrix that a cycle is for.
        """
        coarse, rows = _with_touched(coarse, self.springs), self.rows
        prolongation = petsc_matrix(coarse.prolongation)
        below = _with_springs(
            self.matrix.PtAP(prolongation),
            [each.seen_from(coarse.prolongation) for each in self.springs],
            rows,
        )
        below.setOption(PETSc.Mat.Option.SPD, True)
        defaults: dict[str, Any] = {"ksp_type": "preonly"}
        if factorised:
            self.kind = "linear shape functions, factorised"
            defaults |= _FACTORISED if rows.comm is None else _FACTORISED_BY_ALL
        else:
            self.kind = "linear shape functions, aggregation"
            _tell_rigid_motions(below, rigid[coarse.owners], rows)
            defaults = _ITERATED | _GAMG | {f"mg_levels_{key}": value for key, value in _SMOOTHER.items()}
        self.pc = None
        if not _asked():
            ksp = PETSc.KSP().create(rows.petsc)
            ksp.setOptionsPrefix(f"{PREFIX}mg_coarse_")
            ksp.setOperators(below)
            rows.meet()
            _set_up(ksp, f"{PREFIX}mg_coarse_", defaults)
            self._levels = _Levels(self, prolongation, ksp)
            return self.matrix
        whole = self._summed()
        self.pc = PETSc.PC().create(rows.petsc)
        self.pc.setOptionsPrefix(PREFIX)
        self.pc.setOperators(whole)
        self.pc.setType(PETSc.PC.Type.MG)
        self.pc.setMGLevels(2)
        self.pc.setMGInterpolation(1, _with_springs(prolongation, [], rows))
        self.pc.getMGCoarseSolve().setOperators(below)
        of_levels = {f"mg_coarse_{key}": value for key, value in defaults.items()}
        rows.meet()
        _set_up(self.pc, PREFIX, of_levels | {f"mg_levels_{key}": value for key, value in _SMOOTHER.items()})
        return whole

    def _summed(self) -> Any:
        """The matrix of all ranks with the springs."""
        return _with_springs(self.matrix, self.springs, self.rows)

    def product(self, block: Array) -> Array:
        """The matrix with the springs times a block (n, c)."""
        out = multiplied(self.matrix, block)
        own = [spring.jump @ block for spring in self.springs]
        for spring, jump in zip(self.springs, jumps(self.springs, own, self.rows), strict=True):
            out += spring.pull(jump)
        return out

    def energies(self, block: Array) -> Array:
        """About b^T A^-1 b (c, c) of a block of forces (n, c), which costs less than a cycle on all of
        them."""
        if self._levels is None:
            return self.rows.dot(block, self.cycle(block))
        return self._levels.energies(block)

    def cycle(self, block: Array) -> Array:
        """Approximate solutions (n, c) of a block of right-hand sides (n, c)."""
        if self._levels is not None:
            return self._levels.cycle(block)
        assert self.pc is not None
        out = np.empty(block.shape, order="F")
        self.rows.meet()
        for column in range(block.shape[1]):
            self._right.setArray(block[:, column])
            self.pc.apply(self._right, self._left)
            out[:, column] = self._left.getArray()
        return out


def _asked() -> bool:
    """Whether the user gave PETSc options for this multigrid."""
    return any(name.startswith(PREFIX) for name in PETSc.Options().getAll())


class _Levels:
    """The two levels on blocks of columns: a matrix is read once for all of them.

    PETSc's own cycle takes one column after the other; this one makes the same steps: Chebyshev polynomials
    of the Jacobi iteration on the upper nine tenths of its spectrum.
    """

    def __init__(self, whole: Multigrid, prolongation: Any, below: Any) -> None:
        self.product, self.below, self.rows = whole.product, below, whole.rows
        self.up, self.down = prolongation, prolongation.transpose(PETSc.Mat())
        self.inverse = 1.0 / whole.diagonal[:, None]
        largest = 1.1 * self._largest()
        least = largest / 11.0
        self.middle, self.half = 0.5 * (largest + least), 0.5 * (largest - least)
        self.coarse_x, self.coarse_b = below.getOperators()[0].createVecs()
        pc = below.getPC()
        self.factor = pc.getFactorMatrix() if pc.getType() == PETSc.PC.Type.CHOLESKY else None

    def _largest(self) -> float:
        """Largest eigenvalue of D^-1 A, by a few steps of Lanczos' method."""
        root: Array = np.sqrt(self.inverse)
        q: Array = np.random.default_rng(self.rows.rank).standard_normal((len(root), 1))
        q /= self.rows.norm(q)
        before: Array = np.zeros_like(q)
        beta = 0.0
        alphas, betas = [], []
        for _ in range(12):
            z = root * self.product(np.asfortranarray(root * q)) - beta * before
            alphas.append(float(self.rows.sum(q[:, 0] @ z[:, 0])))
            z -= alphas[-1] * q
            beta = self.rows.norm(z)
            if beta <= 1e-12:
                break
            betas.append(beta)
            before = q
            q = np.asarray(z / beta, dtype=np.float64)
        off = betas[: len(alphas) - 1]
        return float(np.linalg.eigvalsh(np.diag(alphas) + np.diag(off, 1) + np.diag(off, -1))[-1])

    def _smooth(self, x: Array | None, left: Array, last: bool) -> tuple[Array, Array]:
        """Three steps from x (None: 0) with the residual `left`, which is overwritten and right unless
        `last`."""
        sigma = self.middle / self.half
        rho = 1.0 / sigma
        step = np.asfortranarray(self.inverse * left / self.middle)
        x = step.copy(order="F") if x is None else x + step
        for number in range(1, _STEPS + 1):
            if number == _STEPS and last:
                break
            left -= self.product(step)
            if number == _STEPS:
                break
            again = 1.0 / (2.0 * sigma - rho)
            step *= again * rho
            step += (2.0 * again / self.half) * (self.inverse * left)
            x += step
            rho = again
        return x, left

    def _solved_below(self, block: Array) -> Array:
        """Solutions (n_c, c) on the coarse level."""
        out = np.empty(block.shape, order="F")
        self.rows.meet()
        if self.factor is not None:
            left, right = self.rows.dense(out), self.rows.dense(block)
            self.factor.matSolve(right, left)
            left.destroy()
            right.destroy()
            return out
        for column in range(block.shape[1]):
            self.coarse_b.setArray(block[:, column])
            self.below.solve(self.coarse_b, self.coarse_x)
            out[:, column] = self.coarse_x.getArray()
        return out

    def energies(self, block: Array) -> Array:
        """As :meth:`Multigrid.energies`, of the two levels side by side."""
        below = multiplied(self.down, block)
        return self.rows.sum(below.T @ self._solved_below(below) + block.T @ (self.inverse * block))

    def cycle(self, block: Array) -> Array:
        """As :meth:`Multigrid.cycle`."""
        x, left = self._smooth(None, np.array(block, order="F"), last=False)
        change = multiplied(self.up, self._solved_below(multiplied(self.down, left)))
        left -= self.product(change)
        return self._smooth(x + change, left, last=True)[0]


def _with_springs(matrix: Any, springs: Sequence[Spring], rows: Rows) -> Any:
    """A PETSc matrix of all ranks, with those of the ranks on its diagonal and springs added to it; without
    springs, and on one rank, the matrix itself."""
    if rows.comm is None and not springs:
        return matrix
    total = csr(matrix)
    for spring in springs:
        total = total + spring.matrix(spring.jump)
    if rows.comm is None:
        return petsc_matrix(total)
    starts = rows.starts(total.shape[1])
    outgoing: dict[int, dict[Any, sp.csr_matrix]] = {}
    for k, spring in enumerate(springs):
        if spring.other is not None:
            own = outgoing.setdefault(spring.other, {})
            own[rows.rank, len(own)] = spring.jump
    total = placed(total, starts[rows.rank], starts[-1])
    rows.meet()
    arrived = swap(rows.comm, outgoing)
    seen = dict.fromkeys(outgoing, 0)
    for spring in springs:
        if spring.other is not None:
            jump = arrived[spring.other, seen[spring.other]]
            seen[spring.other] += 1
            total = total + spring.matrix(placed(jump, starts[spring.other], starts[-1]))
    return rows.matrix(total, matrix.getSize()[1])


def multiplied(matrix: Any, block: Array) -> Array:
    """A PETSc matrix (m, n) of this rank times a block of columns (n, c)."""
    out = np.empty((matrix.getSize()[0], block.shape[1]), order="F")
    left, right = Rows().dense(out), Rows().dense(np.asfortranarray(block))
    matrix.matMult(right, left)
    left.destroy()
    right.destroy()
    return out


def _tell_rigid_motions(matrix: Any, rigid: Array, rows: Rows) -> None:
    basis = rows.orthonormal(rigid)
    vectors = [PETSc.Vec().createWithArray(np.array(column), comm=rows.petsc) for column in basis.T]
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=rows.petsc))


def _set_up(solver: Any, prefix: str, defaults: dict[str, Any]) -> None:
    """Set a PETSc solver up with defaults that options of the user go before."""
    options = PETSc.Options()
    own = [prefix + key for key in defaults if not options.hasName(prefix + key)]
    for key in own:
        options[key] = defaults[key.removeprefix(prefix)]
    try:
        solver.setFromOptions()
        solver.setUp()
    except PETSc.Error as err:
        raise SceneError(
            f"backend 'multigrid': PETSc could not set up what -{prefix}... says: {err}"
        ) from err
    finally:
        for key in own:
            options.delValue(key)


def _with_touched(coarse: Coarse, springs: Sequence[Spring]) -> Coarse:
    """The coarse level and all unknowns that springs touch: however stiff they are, it knows them."""
    touched = np.zeros(coarse.prolongation.shape[0], dtype=bool)
    for spring in springs:
        touched[spring.jump.indices[spring.jump.data != 0.0]] = True
    return _with_more(coarse, touched)


def _with_more(coarse: Coarse, wanted: Flags) -> Coarse:
    """The coarse level and some of the unknowns (n,)."""
    size = len(wanted)
    missing = wanted.copy()
    missing[coarse.owners] = False
    more = np.flatnonzero(missing)
    ones = sp.csr_matrix((np.ones(len(more)), (more, np.arange(len(more)))), shape=(size, len(more)))
    return Coarse(
        sp.hstack([coarse.prolongation, ones], "csr"), np.concatenate([coarse.owners, more])
    )


def _averaged(prolongations: Mapping[str, sp.csr_matrix], sums: sp.csr_matrix) -> sp.csr_matrix:
    """(Z^T Z)^-1 b: unknowns of fields from sums over the nodes that were glued into them."""
    if not prolongations:
        return sums
    norms = sum(Z.T @ Z for Z in prolongations.values()).tocsr()
    norms.eliminate_zeros()
    if norms.nnz == norms.shape[0]:
        return (sp.diags(1.0 / norms.diagonal()) @ sums).tocsr()
    solve = spla.factorized(norms.tocsc())  # nodes that are tied to each other share their unknowns
    columns = sums.tocsc()
    found = (solve(columns[:, [k]].toarray()) for k in range(columns.shape[1]))
    return sp.hstack([sp.csc_matrix(each) for each in found], "csr")


def rigid_motions(
    problem: Problem, prolongations: Mapping[str, sp.csr_matrix], size: int, rows: Rows | None = None
) -> Array:
    """Rigid motions (n, r) of parts together, those of all ranks, in their unknowns.

    Parameters
    ----------
    prolongations
        Part of this rank -> Z (n_e, n) from the unknowns.
    size
        n.
    rows
        Of this rank among those of all.
    """
    parts = [problem.substructures[name] for name in prolongations]
    every = (rows or Rows()).every([(part.centre, part.length) for part in parts])
    centres, lengths = zip(*(each for own in every for each in own), strict=True)
    centre, length = np.mean(centres, axis=0), max(lengths)
    total: Any = np.zeros((size, rigid_modes(np.zeros((0, problem.dim)), centre, length).shape[2]))
    for part, Z in zip(parts, prolongations.values(), strict=True):
        motions = rigid_modes(part.dof_coordinates, centre, length)
        total = total + Z.T @ motions.reshape(-1, motions.shape[2])
    return np.asarray(_averaged(prolongations, sp.csr_matrix(total)).toarray())


def linear_shapes(
    problem: Problem, prolongations: Mapping[str, sp.csr_matrix], size: int
) -> Coarse | None:
    """The linear shape functions of parts in their unknowns, and all unknowns of thin cells; None: a part has
    no others. Arguments as for :func:`rigid_motions`."""
    at_vertex = np.zeros(size, dtype=bool)
    thin = np.zeros(size, dtype=bool)
    found = []
    for name, Z in prolongations.items():
        part = problem.substructures[name]
        vertices = vertices_of(part)
        if vertices is None:
            return None
        thin[Z[np.repeat(in_thin_cells(part), part.dim)].indices] = True
        at = (part.dim * vertices.nodes[:, None] + np.arange(part.dim)).ravel()
        on_vertices = Z[at]
        at_vertex[on_vertices.indices] = True
        found.append((Z, sp.kron(vertices.weights, sp.eye(part.dim), format="csr"), on_vertices))
    owners = np.flatnonzero(at_vertex)
    total = sp.csr_matrix((size, len(owners)))
    for Z, weights, on_vertices in found:
        total = total + Z.T @ (weights @ on_vertices[:, owners])
    prolongation = _averaged(prolongations, total)
    prolongation.data[np.abs(prolongation.data) < 1e-12] = 0.0
    prolongation.eliminate_zeros()
    return _with_more(Coarse(prolongation, owners), thin)
