"""Linear elastic materials as UFL integrands.

A material of a scene is an object with ``bilinear(u, v)``, or any callable (u, v) that returns a
UFL integrand or a whole form.  Constants become ``fem.Constant``: parts that differ only in numbers
share one compiled form.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import dolfinx.fem as fem
import numpy as np
import numpy.typing as npt
import ufl
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.domain import extract_unique_domain

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    checked_axes,
    checked_number,
    checked_numbers,
    checked_reals,
    is_real,
)
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen
from dolfinx_frontend.scene.amplitudes import Amplitude, Combination, Varying
from dolfinx_frontend.scene.values import Parameter, is_random_field, is_plain, is_uncertain

__all__ = [
    "VOIGT",
    "LinearElastic",
    "Material",
    "OrthotropicElastic",
    "matrix_stress",
    "revolved_strain",
    "strain",
]


@runtime_checkable
class Material(Protocol):
    """What a scene needs to know of a material."""

    def bilinear(self, u: Any, v: Any) -> Any:
        """UFL integrand sigma(u) : eps(v)."""


def strain(u: Any) -> Any:
    """Linearised strain, UFL (d, d)."""
    return ufl.sym(ufl.grad(u))


def revolved_strain(u: Any) -> Any:
    """Linearised strain of an axisymmetric displacement (u_r, u_z) at (r, z): UFL (3, 3), r, z, hoop."""
    g = strain(u)
    r = ufl.SpatialCoordinate(extract_unique_domain(u))[0]
    hoop = ufl.conditional(ufl.gt(r, 0.0), u[0] / r, g[0, 0])  # on the axis the limit
    return ufl.as_matrix([[g[0, 0], g[0, 1], 0.0], [g[0, 1], g[1, 1], 0.0], [0.0, 0.0, hoop]])


def _constant(u: Any, value: npt.ArrayLike) -> Any:
    return fem.Constant(extract_unique_domain(u), np.asarray(value, dtype=np.float64))


def _dim(u: Any) -> int:
    return int(u.ufl_shape[0])


def _check_plane(name: str, plane: str) -> None:
    if not isinstance(plane, str) or plane not in ("strain", "stress", "axisymmetric"):
        raise SceneError(f"{name}: plane = {plane!r}; admissible: 'strain', 'stress', 'axisymmetric'")


def _check_known(name: str, constant: str, value: Any) -> None:
    """Refuse what only laws and loads can be: random, swept, or a function of time."""
    if is_plain(value) or not isinstance(value, (Parameter, Amplitude, Combination, Varying)):
        return
    raise SceneError(
        f"{name}: {constant} = {value!r}; only the E of LinearElastic may be random, and nothing of a "
        "material changes in time: give a number or a UFL expression, a random factor of the whole part by "
        "scene.substructure(..., stiffness=), or let a law carry it"
    )


_LOCKS = 0.45
"""Poisson's ratio from which on a bent part of linear elements is more than a third too stiff."""


def checked_expansion(where: str, alpha: Any) -> Any:
    """Coefficients of expansion: a number, one per axis, or a symmetric matrix.

    Raises
    ------
    SceneError
        Anything else.
    """
    wanted = "give a number, one per axis, or a symmetric matrix (3, 3)"
    numbers = checked_numbers(where, "alpha", alpha, wanted)
    if numbers.ndim > 2 or (numbers.ndim == 2 and not np.array_equal(numbers, numbers.T)):
        raise SceneError(f"{where}: alpha = {short(alpha)}: {wanted}")
    return frozen(alpha)


@dataclass(frozen=True)
class LinearElastic:
    """Isotropic linear elasticity: sigma = lambda tr(eps) I + 2 mu eps.

    Parameters
    ----------
    E
        Young's modulus, force / area: a number > 0, a UFL expression, or a random number or field: then the
        stiffness of the part is random, see ``stiffness`` of :meth:`Scene.substructure`.
    nu
        Poisson's ratio: a number in (-1, 1/2) or a UFL expression.
    plane
        ``"strain"`` or ``"stress"``, in 2D; 3D parts take ``"strain"`` (the default) only. In an axisymmetric
        scene it is ``"axisymmetric"`` by itself.
    alpha
        Coefficient of thermal expansion, 1 / temperature, that :meth:`Scene.temperature` takes; None: none.
    yield_stress
        Force / area, > 0: answers whose von Mises stress is above it say so, but of plane parts; None: nobody
        looks.
    """

    E: Any
    nu: Any
    plane: str = "strain"
    alpha: Any = None
    yield_stress: float | None = None

    def __post_init__(self) -> None:
        _check_plane("LinearElastic", self.plane)
        varies = is_uncertain(self.E) or is_random_field(self.E)
        if varies:
            if not self.E.mean > 0.0:
                raise SceneError(
                    f"LinearElastic: E = {short(self.E)} has the mean {self.E.mean:g}; Young's modulus is "
                    "positive"
                )
        for name in ("nu",) if varies else ("E", "nu"):
            _check_known("LinearElastic", name, getattr(self, name))
            if not is_real(getattr(self, name)) and not isinstance(getattr(self, name), ufl.core.expr.Expr):
                raise SceneError(
                    f"LinearElastic: {name} = {short(getattr(self, name))} is neither a number nor a UFL "
                    "expression; give one"
                )
        if self.alpha is not None:
            _check_known("LinearElastic", "alpha", self.alpha)
            if not isinstance(self.alpha, ufl.core.expr.Expr):
                object.__setattr__(self, "alpha", checked_expansion("LinearElastic", self.alpha))
        if self.yield_stress is not None:
            checked_number("LinearElastic", "yield_stress", self.yield_stress, above=0.0)
        shown = short(self.E) if isinstance(self.E, int) else repr(self.E)
        if is_real(self.E) and not 0.0 < self.E <= sys.float_info.max:
            raise SceneError(f"LinearElastic: E = {shown}; Young's modulus is positive, finite")
        if is_real(self.nu) and not -1.0 < self.nu < 0.5:
            raise SceneError(f"LinearElastic: nu = {self.nu!r}; admissible: -1 < nu < 0.5")

    @property
    def factor(self) -> Any:
        """What the stiffness with E at its mean is multiplied with: 1, or random."""
        if is_random_field(self.E):
            return self.E.relative
        return self.E / self.E.mean if is_uncertain(self.E) else 1.0

    @property
    def nominal(self) -> LinearElastic:
        """The material with E at its mean."""
        return replace(self, E=self.E.mean) if is_uncertain(self.E) or is_random_field(self.E) else self

    def check(self, dim: int) -> None:
        """Whether the material fits a part of `dim` dimensions.

        Raises
        ------
        SceneError
            Plane stress in 3D.
        """
        if dim == 3 and self.plane != "strain":
            raise SceneError(f"LinearElastic: plane={self.plane!r} in 3D; it is for 2D parts only")

    def locks(self, dim: int) -> bool:
        """Whether linear elements are too stiff for it: nu > 0.45, lambda > 9 mu, and volume is kept."""
        known = isinstance(self.nu, (int, float, np.number))
        return known and float(self.nu) > _LOCKS and not (dim == 2 and self.plane == "stress")

    def stress(self, u: Any) -> Any:
        """Stress, UFL (d, d), force / area (in-plane components in 2D)."""
        self.check(_dim(u))
        lmbda, mu2 = self._lame(extract_unique_domain(u))
        eps = self.strain(u)
        return lmbda * ufl.tr(eps) * ufl.Identity(eps.ufl_shape[0]) + mu2 * eps

    def strain(self, u: Any) -> Any:
        """Strain that the stress works on, UFL (d, d), of an axisymmetric part (3, 3)."""
        return revolved_strain(u) if self.plane == "axisymmetric" else strain(u)

    @property
    def revolved(self) -> LinearElastic:
        """The material of an axisymmetric part."""
        return replace(self, plane="axisymmetric")

    def _lame(self, domain: Any) -> tuple[Any, Any]:
        """lambda (of plane stress, too) and 2 mu as constants of a mesh."""
        E, nu = (
            fem.Constant(domain, np.asarray(c, dtype=np.float64)) if is_real(c) else c
            for c in (self.E, self.nu)
        )
        if self.plane == "stress":
            return E * nu / (1 - nu**2), E / (1 + nu)
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (1 + nu)

    def stress_of(self, eps: Any, mesh: Any) -> Any:
        """Stress, UFL (d, d), of a strain (3, 3) of a part: what an initial strain takes away."""
        d = 3 if self.plane == "axisymmetric" else int(mesh.geometry.dim)
        lmbda, mu2 = self._lame(mesh)
        # in plane stress the strain across the plane is free
        trace = eps[0, 0] + eps[1, 1] if self.plane == "stress" else ufl.tr(eps)
        inside = ufl.as_matrix([[eps[i, j] for j in range(d)] for i in range(d)])
        return lmbda * trace * ufl.Identity(d) + mu2 * inside

    def elasticity(self, dim: int) -> npt.NDArray[np.float64] | None:
        """The matrix of :func:`matrix_stress`, force / area; None: E or nu is no number."""
        self.check(dim)
        known = all(isinstance(c, (int, float, np.number)) for c in (self.E, self.nu))
        if not known or self.plane == "axisymmetric":
            return None
        E, nu = float(self.E), float(self.nu)
        lmbda = E * nu / (1 - nu**2) if self.plane == "stress" else E * nu / ((1 + nu) * (1 - 2 * nu))
        mu, shears = 0.5 * E / (1 + nu), 1 if dim == 2 else 3
        matrix = np.diag([2.0 * mu] * dim + [mu] * shears)
        matrix[:dim, :dim] += lmbda
        return matrix

    def bilinear(self, u: Any, v: Any) -> Any:
        """UFL integrand sigma(u) : eps(v)."""
        return ufl.inner(self.stress(u), self.strain(v))


VOIGT = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}
"""Components of symmetric tensors in their order, by dimension."""


def matrix_stress(matrix: npt.NDArray[np.float64], u: Any) -> Any:
    """Stress, UFL (d, d), from engineering strains by a matrix, force / area.

    The matrix is (6, 6) for 11, 22, 33, 23, 13, 12, or (3, 3) for 11, 22, 12 in 2D.
    """
    C, eps = _constant(u, matrix), strain(u)
    if _dim(u) == 2:
        s = ufl.dot(C, ufl.as_vector([eps[0, 0], eps[1, 1], 2 * eps[0, 1]]))
        return ufl.as_matrix([[s[0], s[2]], [s[2], s[1]]])
    s = ufl.dot(C, ufl.as_vector([(1 if i == j else 2) * eps[i, j] for i, j in VOIGT[3]]))
    return ufl.as_matrix([[s[0], s[5], s[4]], [s[5], s[1], s[3]], [s[4], s[3], s[2]]])


def modulus_along(matrix: Array, normals: Array) -> Array:
    """Young's modulus (m,), force / area, along unit vectors (m, d), from :func:`matrix_stress`."""
    pairs = VOIGT[3 if len(matrix) == 6 else 2]
    stress = np.array([normals[:, i] * normals[:, j] for i, j in pairs])
    return 1.0 / np.asarray((stress * np.linalg.solve(matrix, stress)).sum(axis=0))


def _strain_rotation(axes: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(6, 6): global engineering strains -> engineering strains along the rows of `axes`."""
    out = np.zeros((6, 6))
    for a, (i, j) in enumerate(VOIGT[3]):
        for b, (k, l) in enumerate(VOIGT[3]):
            sym = 0.5 * (axes[i, k] * axes[j, l] + axes[i, l] * axes[j, k])
            # a shear strain of the column enters twice as a tensor component of half its value
            out[a, b] = sym * (2.0 if i != j else 1.0)
    return out


@dataclass(frozen=True)
class OrthotropicElastic:
    """Orthotropic linear elasticity, from the compliance in the material axes 1, 2, 3.

    eps_11 = s_11/E1 - nu12 s_22/E1 - nu13 s_33/E1, ..., 2 eps_12 = s_12/G12.

    Parameters
    ----------
    E
        (E1, E2, E3), force / area; (E1, E2) suffices for plane stress.
    nu
        (nu12, nu13, nu23); nu12 alone suffices for plane stress.  nu_ij / E_i = nu_ji / E_j.
    G
        (G12, G13, G23), force / area; G12 alone suffices in 2D.
    axes
        Rows are the material axes in global components, (3, 3) in 3D, (2, 2) in 2D; None: global. In 3D also
        a function of points (m, 3) -> (m, 3, 3): a cell has the axes of its centre.
    plane
        ``"strain"`` or ``"stress"``, in 2D.
    """

    E: tuple[float, ...]
    nu: tuple[float, ...] | float
    G: tuple[float, ...] | float
    axes: Any = None
    plane: str = "strain"

    def __post_init__(self) -> None:
        _check_plane("OrthotropicElastic", self.plane)
        for name in ("E", "nu", "G"):
            for entry in np.asarray(getattr(self, name), dtype=object).flat:
                _check_known("OrthotropicElastic", name, entry)
            given = getattr(self, name)
            value = np.atleast_1d(checked_reals("OrthotropicElastic", name, given, "give numbers"))
            if value.ndim != 1 or not 1 <= len(value) <= 3:
                raise SceneError(f"OrthotropicElastic: {name} = {value.tolist()}; give 3 (2D: 1 or 2)")
            if not np.all(np.isfinite(value)):
                raise SceneError(f"OrthotropicElastic: {name} = {value.tolist()} is not finite")
            if name != "nu" and value.min() <= 0.0:
                raise SceneError(f"OrthotropicElastic: {name} = {value.tolist()}; give values > 0")
            object.__setattr__(self, name, tuple(float(v) for v in value))
        if len(self.E) not in (2, 3):
            raise SceneError(f"OrthotropicElastic: E has {len(self.E)} values; give 3 (2D: 2 or 3)")
        if self.axes is not None and not callable(self.axes):
            checked_axes("OrthotropicElastic", "axes", self.axes)
            object.__setattr__(self, "axes", frozen(self.axes))
        for dim in (2, 3) if self._is_full() else (2,):
            if dim == 2 or self.plane == "strain":
                self._elasticity(dim)

    def _is_full(self) -> bool:
        nu, G = np.atleast_1d(self.nu), np.atleast_1d(self.G)
        return len(self.E) == 3 and len(nu) == 3 and len(G) == 3

    def check(self, dim: int) -> None:
        """Whether the material fits a part of `dim` dimensions.

        Raises
        ------
        SceneError
            Plane stress or too few constants in 3D, axes of another dimension.
        """
        if dim == 3 and self.plane != "strain":
            raise SceneError(f"OrthotropicElastic: plane={self.plane!r} in 3D; it is for 2D parts")
        if dim == 3 and not self._is_full():
            raise SceneError("OrthotropicElastic: 3D needs three values each of E, nu and G")
        if self.axes is not None and (3 if callable(self.axes) else len(np.asarray(self.axes))) != dim:
            raise SceneError(f"OrthotropicElastic: axes are not ({dim}, {dim})")

    def _elasticity(self, dim: int) -> npt.NDArray[np.float64]:
        """Stiffness in the material axes: (6, 6), or (3, 3) for 11, 22, 12 in 2D."""
        E = np.asarray(self.E)
        nu, G = np.atleast_1d(self.nu), np.atleast_1d(self.G)
        if dim == 2 and self.plane == "stress":
            s12 = -nu[0] / E[0]
            S = np.array([[1 / E[0], s12, 0.0], [s12, 1 / E[1], 0.0], [0.0, 0.0, 1 / G[0]]])
        else:
            if len(E) < 3 or len(nu) < 3:
                raise SceneError("OrthotropicElastic: plane strain needs three values of E and nu")
            S = np.zeros((6, 6))
            S[0, 1], S[0, 2], S[1, 2] = -nu[0] / E[0], -nu[1] / E[0], -nu[2] / E[1]
            S += S.T
            shear = [G[2], G[1], G[0]] if len(G) == 3 else [G[0]] * 3
            S += np.diag(np.concatenate([1 / E, 1 / np.asarray(shear)]))
        scale = 1 / np.sqrt(np.diag(S))
        if np.linalg.eigvalsh(scale[:, None] * S * scale).min() <= 1e-12:
            raise SceneError(
                f"OrthotropicElastic: nu = {self.nu!r} with E = {self.E!r} is not positive "
                "definite; |nu_ij| < sqrt(E_i / E_j) is necessary"
            )
        return np.linalg.inv(S)

    def _global_elasticity(self, dim: int) -> npt.NDArray[np.float64]:
        """Stiffness in global axes: (3, 3) in 2D, otherwise (6, 6)."""
        C = self._full(dim)
        return C[np.ix_([0, 1, 5], [0, 1, 5])] if dim == 2 and len(C) == 6 else C

    def _full(self, dim: int) -> npt.NDArray[np.float64]:
        """Stiffness in global axes: (3, 3) in plane stress, otherwise (6, 6)."""
        C = self._elasticity(dim)
        if self.axes is None or callable(self.axes):
            return C
        axes = np.eye(3)
        axes[:dim, :dim] = np.asarray(self.axes, dtype=np.float64)
        R = _strain_rotation(axes)
        if len(C) == 3:
            R = R[np.ix_([0, 1, 5], [0, 1, 5])]
        out: npt.NDArray[np.float64] = R.T @ C @ R
        return out

    def stress_of(self, eps: Any, mesh: Any) -> Any:
        """Stress, UFL (d, d), of a strain (3, 3) of a part: what an initial strain takes away."""
        revolved = self.plane == "axisymmetric"
        d = 3 if revolved else int(mesh.geometry.dim)
        C = self._full(2 if revolved else d)
        turn = self._rows(mesh) if callable(self.axes) else None
        if turn is not None:
            eps = turn * eps * turn.T
        pairs = VOIGT[3 if len(C) == 6 else 2]
        voigt = ufl.as_vector([(1 if i == j else 2) * eps[i, j] for i, j in pairs])
        s = ufl.dot(fem.Constant(mesh, C), voigt)
        of = {pair: s[k] for k, pair in enumerate(pairs)}
        stress = ufl.as_matrix([[of[min(i, j), max(i, j)] for j in range(d)] for i in range(d)])
        return stress if turn is None else turn.T * stress * turn

    def _rows(self, mesh: Any) -> Any:
        """Axes that vary, by cell."""
        space = fem.functionspace(mesh, ("DG", 0, (3, 3)))
        centres = space.tabulate_dof_coordinates()
        rows = checked_axes("OrthotropicElastic", "axes", self.axes(centres), 3)
        if rows.shape != (len(centres), 3, 3):
            raise SceneError(f"OrthotropicElastic: axes returned {rows.shape}; return rows (m, 3, 3)")
        found = fem.Function(space)
        found.x.array[:] = rows.ravel()
        return found

    @property
    def revolved(self) -> OrthotropicElastic:
        """The material of an axisymmetric part: axes r, z, hoop."""
        return replace(self, plane="axisymmetric")

    def strain(self, u: Any) -> Any:
        """Strain that the stress works on, UFL (d, d), of an axisymmetric part (3, 3)."""
        return revolved_strain(u) if self.plane == "axisymmetric" else strain(u)

    def stress(self, u: Any) -> Any:
        """Stress, UFL (d, d), force / area (in-plane components in 2D; of an axisymmetric part (3, 3))."""
        dim = _dim(u)
        self.check(dim)
        if self.plane == "axisymmetric":
            return self.stress_of(revolved_strain(u), extract_unique_domain(u))
        if callable(self.axes):
            known = (*extract_arguments(u), *extract_coefficients(u))
            return self.stress_of(strain(u), known[0].ufl_function_space().mesh)
        return matrix_stress(self._global_elasticity(dim), u)

    def elasticity(self, dim: int) -> npt.NDArray[np.float64] | None:
        """The matrix of :func:`matrix_stress`, force / area; None: of an axisymmetric part, or it varies."""
        self.check(dim)
        if self.plane == "axisymmetric" or callable(self.axes):
            return None
        return self._global_elasticity(dim)

    def bilinear(self, u: Any, v: Any) -> Any:
        """UFL integrand sigma(u) : eps(v)."""
        return ufl.inner(self.stress(u), self.strain(v))
