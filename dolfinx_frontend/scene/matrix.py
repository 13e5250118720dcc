"""A part that is given as a stiffness matrix on points: a frame or a housing that another program reduced."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import check_optional_kind, checked_name, checked_number, checked_numbers
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import ReadOnlyDict, locked_matrix, read_only

__all__ = ["Matrix"]

_RIGID = 1e-8
"""A rigid motion of which the forces are less, relative to the largest stiffness, is free."""

_DIGITS = 1e-6
"""Forces of a rigid motion below this, relative to the largest stiffness, are digits that a file has cut
off."""

_SYMMETRIC = 1e-8
"""Largest difference from the transposed matrix, relative to the largest entry."""

_INDEFINITE = 1e-8
"""Eigenvalues are negative from here on, relative to the largest stiffness; the same: zero."""

_DENSE = 2000
"""Unknowns up to which all eigenvalues are computed, about a second."""

_AXES = ("x", "y", "z", "rx", "ry", "rz")


class Matrix:
    """A part as a stiffness matrix: what remains of it on some points after static condensation.

    Parameters
    ----------
    K
        (n, n), symmetric, positive semidefinite, force / length: a dense array, a SciPy or a sequential PETSc
        matrix. Unknowns are those of the points one after the other: ``x``, ``y``[, ``z``], or with rotations
        also ``rx``, ``ry``, ``rz`` (radians; in 2D ``rz``). Free as it is, or grounded.
    points
        (m, d), length.
    loads
        Name -> (n,), forces [and moments] at the points; they act where ``scene.load(part, name)`` says so.
    faces
        Name -> indices of its points, or one index; None: ``"points"``, all of them.
    rotations
        Indices of the points that have rotations; None: all or none, as K is large.
    length
        Size of the part; None: that of the points.

    Raises
    ------
    SceneError
        Shapes that do not fit, numbers that are not finite, a matrix that is not symmetric, is indefinite or
        has a mechanism beside its rigid motions.

    Warns
    -----
    SceneWarning
        Rigid motions that meet a little resistance: digits are missing, or points are not where they were.

    Examples
    --------
    >>> frame = Matrix(K, points, loads={"weight": f}, faces={"foot": [0, 1, 2, 3]})
    >>> scene.substructure("frame", frame)
    """

    def __init__(
        self,
        K: Any,
        points: Any,
        loads: Mapping[str, Any] | None = None,
        faces: Mapping[str, Any] | None = None,
        rotations: Any = None,
        length: float | None = None,
    ) -> None:
        where = "Matrix"
        self.points: Array = read_only(
            checked_numbers(where, "points", points, "give coordinates (m, 2) or (m, 3)", 2)
        )
        m, d = self.points.shape
        if d not in (2, 3) or not m:
            raise SceneError(f"{where}: points of shape {self.points.shape}; give (m, 2) or (m, 3)")
        given = _csr(K)
        self.turning: Ints = read_only(self._turning(given.shape, rotations))
        has = np.zeros((m, d + (2 * d - 3 if len(self.turning) else 0)), dtype=bool)
        has[:, :d] = True
        has[self.turning] = True
        self.unknowns: Ints = read_only(np.argwhere(has))
        self.length = self._size(length)
        self.stiffness: sp.csr_matrix = locked_matrix(self._symmetric(given), own=True)
        self.faces: Mapping[str, Ints] = ReadOnlyDict(self._faces(faces))
        self.loads: Mapping[str, Array] = ReadOnlyDict(self._loads(loads))
        self.held: Array = read_only(self._check_motions())
        self._check_definite()

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.points.shape[1])

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return int(self.stiffness.shape[0])

    @property
    def components(self) -> int:
        """Numbers of a point at most: d, or with rotations 6 (in 2D 3)."""
        return int(self.unknowns[:, 1].max()) + 1

    def rows(self, values: Array) -> Array:
        """Of numbers (m, components, ...) those of the unknowns, (n, ...)."""
        return np.asarray(values[self.unknowns[:, 0], self.unknowns[:, 1]])

    @property
    def centre(self) -> Array:
        """Mean of the points, (d,)."""
        return np.asarray(self.points.mean(axis=0), dtype=np.float64)

    @property
    def free_motions(self) -> int:
        """Number of rigid motions that meet no resistance: 6 (in 2D 3), fewer if it is grounded."""
        return len(self.held) - int(np.linalg.matrix_rank(self.held, tol=_RIGID * len(self.points)))

    @property
    def names(self) -> dict[str, int]:
        """Face -> its number, as a part with a mesh has it."""
        return {name: number for number, name in enumerate(self.faces)}

    def __repr__(self) -> str:
        kind = "displacements"
        if len(self.turning):
            every = len(self.turning) == len(self.points)
            kind += " and rotations" if every else f" (and {len(self.turning)} rotations)"
        return (
            f"Matrix({self.size} unknowns, {kind} of {len(self.points)} points, {self.free_motions} free "
            f"rigid motions, faces {', '.join(self.faces)})"
        )

    @property
    def mesh(self) -> NoReturn:
        """There is none.

        Raises
        ------
        SceneError
            Always: what needs a mesh is not there for a part that is a matrix.
        """
        raise SceneError(
            "a part that is given as a Matrix has no mesh: its displacements at its points are all that is "
            "known of it"
        )

    facet_tags = mesh

    @property
    def scale(self) -> Array:
        """(n,): 1 of a displacement, the length of a rotation: what makes stiffnesses comparable."""
        return np.where(self.unknowns[:, 1] < self.dim, 1.0, self.length)

    def motions(self, centre: Array | None = None) -> Array:
        """(m, components, r): rigid motions at the points: translations, then rotations of 1 / length about a
        centre (None: :attr:`centre`)."""
        d = self.dim
        r = (self.points - (self.centre if centre is None else centre)) / self.length
        out = np.zeros((len(r), self.components, 3 if d == 2 else 6))
        out[:, :d, :d] = np.eye(d)
        if d == 2:
            out[:, 0, 2], out[:, 1, 2] = -r[:, 1], r[:, 0]
        else:
            out[:, :3, 3:] = np.cross(np.eye(3)[None], r[:, None]).swapaxes(1, 2)
        if len(self.turning):
            out[self.turning, d:, d:] = np.eye(self.components - d) / self.length
        return out

    def modulus(self) -> float:
        """Young's modulus of a body of its size that resists uniform shears as it does, force / area."""
        d, total, pairs = self.dim, 0.0, 0
        x = self.points - self.centre
        for i in range(d):
            for j in range(i):
                u = np.zeros((len(x), self.components))
                u[:, i], u[:, j] = x[:, i], -x[:, j]
                total += float(self.rows(u) @ (self.stiffness @ self.rows(u)))
                pairs += 1
        found = 0.65 * total / (pairs * self.length**d)
        springs = self.springs * self.length ** (2 - d)
        return found if found > _RIGID * springs else springs  # one point, say

    @property
    def springs(self) -> float:
        """Mean stiffness of a displacement, force / length."""
        return float(self.stiffness.diagonal()[self.unknowns[:, 1] < self.dim].mean())

    def _turning(self, shape: tuple[int, int], given: Any) -> Ints:
        """The points that have rotations."""
        m, d = self.points.shape
        more = 2 * d - 3
        if given is not None:
            some = _indices("Matrix: rotations", given, m)
        else:
            some = np.arange(m if shape[0] == (d + more) * m else 0)
        n = d * m + more * len(some)
        if shape != (n, n):
            wanted = f"({n}, {n})" if given is not None else f"({n}, {n}) or ({n + more * m}, {n + more * m})"
            raise SceneError(
                f"Matrix: K is {shape} with {m} points in {d} dimensions; give {wanted}: displacements of "
                "each point one after the other, each followed by the rotations of the point if it has any"
            )
        return some

    def _size(self, given: float | None) -> float:
        if given is not None:
            return checked_number("Matrix", "length", given, above=0.0)
        size = float(np.linalg.norm(np.ptp(self.points, axis=0)) / np.sqrt(self.dim))
        if size == 0.0:
            raise SceneError("Matrix: its points are at one place, which has no size; give length=")
        return size

    def _named(self, unknown: int) -> str:
        point, component = self.unknowns[unknown]
        axes = _AXES if self.dim == 3 else ("x", "y", "rz")
        return f"{axes[component]} of point {point}"

    def _symmetric(self, given: sp.csr_matrix) -> sp.csr_matrix:
        """The symmetric part, once it is known that there is no other."""
        if not np.all(np.isfinite(given.data)):
            rows = np.repeat(np.arange(given.shape[0]), np.diff(given.indptr))
            at = rows[np.flatnonzero(~np.isfinite(given.data))[0]]
            raise SceneError(f"Matrix: K has entries that are NaN or infinite, at {self._named(at)}")
        largest = float(np.abs(given.data).max(initial=0.0))
        if largest == 0.0:
            raise SceneError("Matrix: K is zero")
        off = (given - given.T).tocoo()
        if off.nnz and np.abs(off.data).max() > _SYMMETRIC * largest:
            k = int(np.argmax(np.abs(off.data)))
            i, j = int(off.row[k]), int(off.col[k])
            one = 0 in (sp.triu(given, 1).nnz, sp.tril(given, -1).nnz)
            half = ": give both halves of it" if one else ""
            raise SceneError(
                f"Matrix: K is not symmetric: {given[i, j]:.9g} between {self._named(i)} and "
                f"{self._named(j)}, {given[j, i]:.9g} the other way{half}"
            )
        return (0.5 * (given + given.T)).tocsr()

    def _faces(self, given: Mapping[str, Any] | None) -> dict[str, Ints]:
        check_optional_kind("Matrix", "faces", given, Mapping, "give {name: indices of points}")
        m = len(self.points)
        if given is None:
            return {"points": read_only(np.arange(m))}
        found = {}
        for name, indices in given.items():
            what = f"Matrix: face {checked_name('face', name, colon=False)!r}"
            found[name] = read_only(_indices(what, indices, m))
        return found

    def _loads(self, given: Mapping[str, Any] | None) -> dict[str, Array]:
        check_optional_kind("Matrix", "loads", given, Mapping, "give {name: forces at the points}")
        found: dict[str, Array] = {}
        for name, forces in (given or {}).items():
            where = f"Matrix: load {checked_name('load', name)!r}"
            wanted = f"give ({self.size},), as the rows of K are"
            values = checked_numbers(where, "forces", forces, wanted)
            if values.size != self.size:
                raise SceneError(f"{where} has {values.size} numbers, K {self.size} rows; {wanted}")
            found[name] = read_only(values.ravel())
        return found

    def _check_motions(self) -> Array:
        """(r, r): Gram matrix of what it resists of its rigid motions, relative to the largest stiffness."""
        scale = self.scale
        left, sizes, right = np.linalg.svd(self.rows(self.motions()) * scale[:, None], full_matrices=False)
        if sizes[-1] < _RIGID * sizes[0]:
            raise SceneError(
                "Matrix: its points are on a line, and without rotations it cannot turn about it: give K "
                "with the rotations of the points, or more points"
            )
        forces = (self.stiffness @ (left / scale[:, None])) / scale[:, None]
        _, values, rows = np.linalg.svd(forces / float((self.stiffness.diagonal() / scale**2).max()))
        doubtful = (values > _RIGID) & (values < _DIGITS)
        if doubtful.any():
            warn(
                f"Matrix: {doubtful.sum()} rigid motions meet a resistance of {values[doubtful].max():.2g} "
                "of the largest stiffness: too much for rounding, too little for a support: give K with all "
                "of its digits, and the points where they were when it was reduced",
                SceneWarning,
            )
        along = (rows * (values > _RIGID)[:, None]) @ (sizes[:, None] * right)
        return np.asarray(along.T @ along, dtype=np.float64)

    def _check_definite(self) -> None:
        """Refuse what would move without an end, or by itself."""
        scale = sp.diags(1.0 / self.scale)
        scaled = (scale @ self.stiffness @ scale).tocsr()
        largest = float(scaled.diagonal().max())
        empty = np.flatnonzero(scaled.diagonal() <= 0.0)
        if len(empty):
            others = f", and at {len(empty) - 1} others" if len(empty) > 1 else ""
            raise SceneError(
                f"Matrix: the diagonal of K is {self.stiffness.diagonal()[empty[0]]:.4g} at "
                f"{self._named(empty[0])}{others}; every displacement and rotation needs a stiffness > 0: "
                "leave rotations out if the points have none"
            )
        if self.size > _DENSE:
            return
        values, vectors = np.linalg.eigh(scaled.toarray())
        if values[0] < -_INDEFINITE * largest:
            at = int(np.argmax(np.abs(vectors[:, 0])))
            raise SceneError(
                f"Matrix: K is indefinite: it has the eigenvalue {values[0] / largest:.3g} of the largest "
                f"stiffness, most of all at {self._named(at)}; a stiffness is positive semidefinite"
            )
        rigid = np.linalg.qr(self.rows(self.motions()) * self.scale[:, None])[0]
        soft = vectors[:, values < _INDEFINITE * largest]
        beside = soft - rigid @ (rigid.T @ soft)
        if beside.size and np.linalg.norm(beside, 2) > 0.01:
            worst = np.linalg.svd(beside)[0][:, 0]
            raise SceneError(
                f"Matrix: K has a motion without stiffness that is not rigid, most of all at "
                f"{self._named(int(np.argmax(np.abs(worst))))}; a mechanism has no answer: leave such "
                "unknowns out, or check that the points are those that K belongs to"
            )


def _indices(what: str, given: Any, count: int) -> Ints:
    """Some of the points, each once, ascending."""
    which = np.atleast_1d(np.asarray(given))
    if which.ndim != 1 or which.dtype.kind not in "iu" or not len(which):
        raise SceneError(f"{what} = {short(given)}; give indices of points, or one")
    if which.min() < 0 or which.max() >= count:
        raise SceneError(f"{what} has the point {which.max()}; there are {count}, from 0")
    if len(np.unique(which)) < len(which):
        raise SceneError(f"{what} = {short(given)} names a point twice")
    return np.sort(which).astype(np.int64)


def _csr(K: Any) -> sp.csr_matrix:
    """A copy as a SciPy matrix."""
    if hasattr(K, "getValuesCSR"):
        if K.getComm().size > 1:
            raise SceneError("Matrix: K is spread over MPI ranks; give a sequential one on the part's rank")
        indptr, indices, values = K.getValuesCSR()
        return sp.csr_matrix((values, indices, indptr), shape=K.getSize())
    if sp.issparse(K):
        return sp.csr_matrix(K, dtype=np.float64, copy=True)
    values = np.asarray(K)
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        raise SceneError(
            f"Matrix: K = {short(K)}; give a dense array (n, n), or a SciPy or PETSc matrix of real numbers"
        )
    return sp.csr_matrix(values.astype(np.float64))
