"""Polynomial chaos: germs, bases, Galerkin matrices, column transforms, quadrature, Sobol indices.

Typed face of the kernel's layer ``latin::stochastic``, whose headers hold the equations. L is the
number of germs, P + 1 the number of modes, N a number of points in germ space; everything is
float64. All polynomials are orthonormal, so the mean of a chaos is its coefficient 0 and its
variance the sum of the squares of the others. Wrong input raises ``InputError``, a ``ValueError``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from latin_core import _core

__all__ = [
    "Array",
    "ChaosBasis",
    "ColumnTransform",
    "Coupling",
    "GalerkinOperator",
    "Germ",
    "IndexSet",
    "IndexTable",
    "MultiIndexSet",
    "Rule",
    "critical_cov",
    "galerkin_matrix",
    "galerkin_transform",
    "galerkin_transforms",
    "mean",
    "quadrature_transform",
    "smallest_eigenvalue",
    "smolyak",
    "sobol_closed",
    "tensor_gauss",
    "variance",
]

Array: TypeAlias = npt.NDArray[np.float64]
IndexTable: TypeAlias = npt.NDArray[np.int32]
IndexSet: TypeAlias = Literal["total", "tensor", "hyperbolic"]
Sparse: TypeAlias = Any
"""scipy.sparse.csc_matrix, float64, symmetric."""

_native: Any = _core.stochastic


def _vector(values: npt.ArrayLike) -> Array:
    return np.atleast_1d(np.asarray(values, dtype=np.float64))


def _block(values: npt.ArrayLike, what: str) -> Array:
    """A 2D block in the order of the kernel."""
    block = np.asarray(values, dtype=np.float64, order="F")
    if block.ndim != 2:
        raise ValueError(f"{what}: a two-dimensional array is wanted; got shape {block.shape}")
    return block


class Rule(NamedTuple):
    """Quadrature of an expectation, E[g] ~ sum of weights * g(points)."""

    points: Array  # (q, L), germ space
    weights: Array  # (q,), sum 1; some are negative in a sparse rule


class Germ:
    """One independent random variable, known by its orthonormal polynomials.

    Made by the class methods; ``str(germ)`` tells the family.
    """

    def __init__(self, native: Any, made: tuple[str, tuple[Any, ...]]) -> None:
        self._native = native
        self._made = made  # class method and its arguments: the native object cannot leave the process

    def __reduce__(self) -> tuple[Any, ...]:
        name, arguments = self._made
        return getattr(Germ, name), arguments

    @classmethod
    def hermite(cls) -> Germ:
        """Standard normal."""
        return cls(_native.Germ.family("hermite", []), ("hermite", ()))

    @classmethod
    def legendre(cls) -> Germ:
        """Uniform on [-1, 1]."""
        return cls(_native.Germ.family("legendre", []), ("legendre", ()))

    @classmethod
    def laguerre(cls, shape: float) -> Germ:
        """Gamma on [0, inf) with this shape > 0 and scale 1."""
        return cls(_native.Germ.family("laguerre", [shape]), ("laguerre", (shape,)))

    @classmethod
    def jacobi(cls, a: float, b: float) -> Germ:
        """beta(a, b) stretched to [-1, 1]; a > 0 belongs to the end -1, b > 0 to +1."""
        return cls(_native.Germ.family("jacobi", [a, b]), ("jacobi", (a, b)))

    @classmethod
    def from_measure(cls, nodes: npt.ArrayLike, weights: npt.ArrayLike) -> Germ:
        """Atoms at `nodes` (N,) with `weights` (N,) >= 0, which are scaled to the sum 1."""
        measure = np.array(_vector(nodes)), np.array(_vector(weights))
        return cls(_native.Germ.from_measure(*measure), ("from_measure", measure))

    @classmethod
    def from_recurrence(cls, alpha: npt.ArrayLike, beta: npt.ArrayLike) -> Germ:
        """Coefficients (n,) of x psi_k = beta_k+1 psi_k+1 + alpha_k psi_k + beta_k psi_k-1."""
        steps = np.array(_vector(alpha)), np.array(_vector(beta))
        return cls(_native.Germ.from_recurrence(*steps), ("from_recurrence", steps))

    @property
    def capacity(self) -> int | None:
        """Number of polynomials that exist or are known; None: no limit."""
        capacity: int | None = self._native.capacity
        return capacity

    def recurrence(self, length: int) -> tuple[Array, Array]:
        """alpha (length,) and beta (length,); beta[0] = 1 is not used."""
        alpha, beta = self._native.recurrence(length)
        return alpha, beta

    def gauss(self, count: int) -> Rule:
        """Gauss rule of `count` points (count, 1)."""
        return Rule(*self._native.gauss(count))

    def evaluate(self, points: npt.ArrayLike, degree: int) -> Array:
        """psi_0 .. psi_degree at the points (N,): (N, degree + 1)."""
        values: Array = self._native.evaluate(_vector(points), degree)
        return values

    def __str__(self) -> str:
        return str(self._native.name)

    def __repr__(self) -> str:
        return f"<Germ {self}>"


class MultiIndexSet:
    """Multi-indices of a chaos in graded order; row 0 is the mean.

    Parameters
    ----------
    shape
        ``"total"``: sum of w_l i_l <= p; ``"tensor"``: max of w_l i_l <= p; ``"hyperbolic"``:
        q-norm of w_l i_l <= p.
    dimension
        L.
    order
        p >= 0.
    q
        0 < q <= 1, of the hyperbolic set.
    weights
        (L,) > 0, or empty for 1: a larger weight means lower degrees.
    interaction
        Greatest number of variables in one index; 0: no limit.
    caps
        (L,) greatest degree of each variable, or empty.
    bytes_per_index
        What a mode costs its user beside the storage of the index.
    memory_limit
        Bytes that may be needed in all; 0: no limit. The size is known before anything is
        allocated.
    """

    def __init__(
        self,
        shape: IndexSet,
        dimension: int,
        order: int,
        *,
        q: float = 0.75,
        weights: Sequence[float] = (),
        interaction: int = 0,
        caps: Sequence[int] = (),
        bytes_per_index: float = 0.0,
        memory_limit: float = 0.0,
    ) -> None:
        self._native = _native.MultiIndexSet(
            shape=shape,
            dimension=dimension,
            order=order,
            q=q,
            weights=list(weights),
            interaction=interaction,
            caps=list(caps),
            bytes_per_index=bytes_per_index,
            memory_limit=memory_limit,
        )

    def __repr__(self) -> str:
        count, dimension = self.table.shape
        return f"MultiIndexSet({count} indices of {dimension} variables)"

    def __reduce__(self) -> tuple[Any, ...]:
        return MultiIndexSet.from_table, (np.array(self.table),)

    @classmethod
    def from_table(cls, rows: npt.ArrayLike) -> MultiIndexSet:
        """A set given by its rows (P + 1, L), in any order; the zero row must be among them."""
        return cls._wrap(_native.MultiIndexSet(np.ascontiguousarray(rows, dtype=np.int32)))

    @classmethod
    def _wrap(cls, native: Any) -> MultiIndexSet:
        made = cls.__new__(cls)
        made._native = native
        return made

    @property
    def table(self) -> IndexTable:
        """(P + 1, L) degrees; a copy."""
        table: IndexTable = self._native.table
        return table

    @property
    def dimension(self) -> int:
        """L."""
        return int(self._native.dimension)

    def __len__(self) -> int:
        return len(self._native)

    def find(self, index: Sequence[int]) -> int | None:
        """Row of a multi-index, None if it is not in the set."""
        row: int | None = self._native.find(list(index))
        return row


class ChaosBasis:
    """Orthonormal polynomial chaos: products of the polynomials of the germs, one an index."""

    def __init__(self, germs: Sequence[Germ], indices: MultiIndexSet) -> None:
        self.germs = tuple(germs)
        self.indices = indices
        self._native = _native.ChaosBasis([germ._native for germ in germs], indices._native)
        self._made = (tuple(germs), indices)

    def __reduce__(self) -> tuple[Any, ...]:
        return ChaosBasis, self._made

    @property
    def dimension(self) -> int:
        """L."""
        return len(self.germs)

    def __len__(self) -> int:
        """P + 1."""
        return len(self._native)

    def __repr__(self) -> str:
        return f"ChaosBasis({len(self)} modes in {self.dimension} germs)"

    def evaluate(self, points: npt.ArrayLike) -> Array:
        """All modes at `points` (N, L): (N, P + 1)."""
        values: Array = self._native.evaluate(_block(points, "points in germ space"))
        return values

    def evaluate_fields(self, coefficients: npt.ArrayLike, points: npt.ArrayLike) -> Array:
        """Fields of `coefficients` (rows, P + 1) at `points` (N, L): (rows, N)."""
        values: Array = self._native.evaluate_fields(
            _block(coefficients, "chaos coefficients"), _block(points, "points in germ space")
        )
        return values


class ColumnTransform(NamedTuple):
    """Between modes and columns in which a law is deterministic.

    A block of modes u (rows, c) is taken as ``u @ forward`` (rows, q) to the law, whose answer
    returns as ``answer @ backward`` (rows, c).
    """

    forward: Array  # (c, q)
    backward: Array  # (q, c)
    values: Array  # (q,) of the random parameter; empty if it is evaluated at the points
    points: Array  # (q, L) germ space; empty for an exact Galerkin transform
    weights: Array  # (q,) probabilities; empty for an exact Galerkin transform


def _transform(native: Any) -> ColumnTransform:
    return ColumnTransform(
        native.forward, native.backward, native.values, native.points, native.weights
    )


def galerkin_matrix(
    basis: ChaosBasis, coefficients: npt.ArrayLike, indices: MultiIndexSet
) -> Sparse:
    """A_jk = sum_i a_i E[Psi_i Psi_j Psi_k] for a scalar with `coefficients` on its own `indices`.

    Exact Galerkin coupling needs all degrees up to twice those of the basis.
    """
    return _native.galerkin_matrix(basis._native, _vector(coefficients), indices._native)


class Coupling:
    """The product with a random scalar a, projected on the modes: v_k = sum_j A_kj u_j at every point.

    The Galerkin matrices A of all points share one pattern; what vanishes by degree or symmetry is not
    stored.

    Parameters
    ----------
    basis
        Modes j, k.
    coefficients
        (1, I) of a parameter, (m, I) of a field at m points, on `indices`.
    indices
        Multi-indices of a, in the same germs.
    """

    def __init__(
        self, basis: ChaosBasis, coefficients: npt.ArrayLike, indices: MultiIndexSet
    ) -> None:
        given = _block(coefficients, "coefficients of a random property")
        self._native = _native.Coupling(basis._native, given, indices._native)

    @property
    def points(self) -> int:
        """m, or 1 of a parameter."""
        return int(self._native.points)

    @property
    def entries(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]:
        """Modes j and k of the entries, sorted by k, and their values (points, entries)."""
        first = np.array(self._native.first, dtype=np.int64)
        return first, np.array(self._native.second, dtype=np.int64), self._native.values.T

    def matrix(self, point: int) -> Array:
        """A (P + 1, P + 1) at one point."""
        values: Array = self._native.matrix(point)
        return values

    def apply(self, fields: npt.ArrayLike, components: int = 1) -> Array:
        """Fields (m * components, P + 1) times a."""
        values: Array = self._native.apply(np.asarray(fields, dtype=np.float64), components)
        return values

    def bounds(self) -> Array:
        """Lower bounds (points,) of the eigenvalues, by Gershgorin."""
        values: Array = self._native.bounds()
        return values

    def smallest(self) -> float:
        """The smallest eigenvalue over all points."""
        return float(self._native.smallest())


class GalerkinOperator:
    """Operator of monolithic stochastic finite elements: (A u)_k = K u_k + sum B^T W sum_j A_kj B u_j.

    It is applied and never formed; blocks are (n, P + 1).

    Parameters
    ----------
    fixed
        K (n, n), scipy.sparse, symmetric, force / length.
    terms
        Of each random stiffness: B (m * components, n) from unknowns to jumps, areas W (m,), its coupling.
    modes
        P + 1.
    """

    def __init__(
        self, fixed: Sparse, terms: Sequence[tuple[Sparse, npt.ArrayLike, Coupling]], modes: int
    ) -> None:
        given = [(jump.tocsr(), _vector(weights), each._native) for jump, weights, each in terms]
        self._native = _native.GalerkinOperator(fixed.tocsr(), given, modes)

    def apply(self, block: npt.ArrayLike) -> Array:
        """A u of a block (n, P + 1)."""
        values: Array = self._native.apply(np.asarray(block, dtype=np.float64))
        return values

    def matrix(self) -> Any:
        """A PETSc shell matrix (n (P + 1), n (P + 1)), modes fastest, that applies the operator."""
        return self._native.matrix()


def smallest_eigenvalue(matrix: Sparse) -> float:
    """Smallest eigenvalue of a Galerkin matrix; a stiffness needs it positive."""
    return float(_native.smallest_eigenvalue(matrix))


def critical_cov(germ: Germ, order: int) -> float:
    """Coefficient of variation from which mean (1 + cov zeta) is indefinite, zeta = standard germ.

    For the normal germ the inverse of the greatest root of He_order+1; infinite at order 0.
    """
    return float(_native.critical_cov(germ._native, order))


def galerkin_transform(matrix: Sparse) -> ColumnTransform:
    """Exact Galerkin: the eigenvectors of the matrix and its eigenvalues as parameter values."""
    return _transform(_native.galerkin_transform(matrix))


def galerkin_transforms(
    basis: ChaosBasis, coefficients: npt.ArrayLike, indices: MultiIndexSet
) -> tuple[list[Array], Array]:
    """:func:`galerkin_transform` of :func:`galerkin_matrix` at every point of a field.

    Parameters
    ----------
    coefficients
        (m, I), on `indices`.

    Returns
    -------
    forward
        Of every point V (P + 1, P + 1); back it is the transpose.
    values
        (m, P + 1), eigenvalues.
    """
    given = _block(coefficients, "coefficients of a random property")
    forward, values = _native.galerkin_transforms(basis._native, given, indices._native)
    return forward, values


def quadrature_transform(basis: ChaosBasis, rule: Rule) -> ColumnTransform:
    """Evaluation of the modes at the points of a rule, and projection with its weights."""
    return _transform(
        _native.quadrature_transform(
            basis._native, _block(rule.points, "points of the rule"), _vector(rule.weights)
        )
    )


def tensor_gauss(
    germs: Sequence[Germ], counts: Sequence[int], memory_limit: float = 0.0
) -> Rule:
    """Product of Gauss rules with counts[l] points; the last germ varies fastest."""
    return Rule(*_native.tensor_gauss([g._native for g in germs], list(counts), memory_limit))


def smolyak(germs: Sequence[Germ], level: int, memory_limit: float = 0.0) -> Rule:
    """Sparse rule from Gauss rules of 1 .. level + 1 points, exact for total degree 2 level + 1."""
    return Rule(*_native.smolyak([g._native for g in germs], level, memory_limit))


def mean(coefficients: npt.ArrayLike) -> Array:
    """(rows,) expectation of fields with `coefficients` (rows, P + 1)."""
    return _block(coefficients, "chaos coefficients")[:, 0].copy()


def variance(coefficients: npt.ArrayLike) -> Array:
    """(rows,) variance of fields with `coefficients` (rows, P + 1)."""
    values: Array = _native.variance(_block(coefficients, "chaos coefficients"))
    return values


def sobol_closed(
    coefficients: npt.ArrayLike, indices: MultiIndexSet, group: Sequence[int]
) -> Array:
    """(rows,) part of the variance due to the germs of a group alone; NaN without variance."""
    values: Array = _native.sobol_closed(
        _block(coefficients, "chaos coefficients"), indices._native, list(group)
    )
    return values
