"""Several parameters joined by a Gaussian copula (Nataf).

They share their germs, which are standard normal variables.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from latin_core.stochastic import Germ

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_known, checked_numbers
from dolfinx_frontend.common.deferred import linalg, optimize
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.common.recorded import Call, mark
from dolfinx_frontend.uncertainty.parameters import RandomParameter

__all__ = ["Correlated", "CorrelatedParameter"]


class CorrelatedParameter(RandomParameter):
    """One parameter of a :class:`Correlated` group: its own distribution, the germs of the group."""

    def __init__(self, group: Correlated, position: int) -> None:
        self.marginal = group.marginals[position]
        super().__init__(
            "CorrelatedParameter",
            self.marginal.name,
            (group._definition, position),
            "",
            self.marginal._law,
        )
        self._shown = f"<{self.marginal!r} correlated with {len(group.marginals) - 1} others>"
        self.group = group
        self.position = position
        self.mean, self.std = self.marginal.mean, self.marginal.std
        self.germ = Germ.hermite()
        self.affine = False

    def value(self, germ: npt.ArrayLike) -> Array:
        """The parameter at its normal scores (N,), which are combinations of the germs."""
        return self.marginal.from_normal(germ)

    def to_germ(self, value: npt.ArrayLike) -> Array:
        return self.marginal.to_normal(value)

    def from_normal(self, score: npt.ArrayLike) -> Array:
        return self.marginal.from_normal(score)

    def to_normal(self, value: npt.ArrayLike) -> Array:
        return self.marginal.to_normal(value)

    def coefficients(self, degree: int) -> Array:
        return self.marginal.hermite_coefficients(degree)

    def hermite_coefficients(self, degree: int) -> Array:
        return self.marginal.hermite_coefficients(degree)


class Correlated(Sequence[CorrelatedParameter]):
    """Random parameters with a Gaussian copula (Nataf's model).

    Used as ``k, K = Correlated([Normal("k", ...), LogNormal("K", ...)], matrix)``: the members go
    into laws like any other parameter.

    Parameters
    ----------
    parameters
        Independent parameters, with different names; their distributions are kept.
    matrix
        (n, n) correlation matrix: symmetric, positive definite, diagonal 1.
    space
        ``"physical"``: `matrix` holds the correlation coefficients of the parameters themselves,
        from which those of the normal scores are solved for.  ``"normal"``: `matrix` is that of the
        normal scores.

    Attributes
    ----------
    marginals
        The parameters as they were given.
    normal_correlation
        (n, n) correlation matrix of the normal scores.

    Raises
    ------
    SceneError
        The matrix has the wrong shape, is not symmetric or not positive definite (with its smallest
        eigenvalue), or a correlation is out of reach of the two distributions (with the range).
    """

    def __init__(
        self,
        parameters: Sequence[RandomParameter],
        matrix: npt.ArrayLike,
        space: Literal["physical", "normal"] = "physical",
    ) -> None:
        check_kind("Correlated", "parameters", parameters, (list, tuple), "give a list of random parameters")
        self.marginals = tuple(parameters)
        names = [str(getattr(p, "name", repr(p))) for p in self.marginals]
        where = f"Correlated [{', '.join(names)}]"
        for parameter in self.marginals:
            if not isinstance(parameter, RandomParameter) or isinstance(
                parameter, CorrelatedParameter
            ):
                raise SceneError(f"{where}: {parameter!r} is not an independent random parameter")
        if len(set(names)) < len(names) or not names:
            raise SceneError(f"{where}: give one parameter or more, all with different names")
        check_known("space", space, ("physical", "normal"), where)
        given = checked_numbers(where, "matrix", matrix, "give finite correlations, one row per parameter")
        n = len(names)
        if given.shape != (n, n):
            raise SceneError(f"{where}: the matrix has shape {given.shape}; wanted ({n}, {n})")
        if not np.allclose(given, given.T, rtol=0.0, atol=1e-12):
            raise SceneError(f"{where}: the correlation matrix is not symmetric and finite")
        if not np.allclose(np.diag(given), 1.0, rtol=0.0, atol=1e-12):
            raise SceneError(
                f"{where}: the diagonal of the correlation matrix is {np.diag(given)}; it must be 1"
            )
        self._check_definite(where, "the correlation matrix", given)
        normal = given
        if space == "physical":
            normal = np.eye(n)
            hermite = [p.hermite_coefficients(40) for p in self.marginals]
            for i in range(n):
                for j in range(i):
                    normal[i, j] = normal[j, i] = self._score_correlation(
                        where, i, j, given[i, j], hermite[i], hermite[j]
                    )
            self._check_definite(where, "the correlation matrix of the normal scores", normal)
        self.normal_correlation = normal
        self._definition = (
            tuple(p._definition for p in self.marginals),
            given.tobytes(),
            space,
        )
        self._members = tuple(CorrelatedParameter(self, i) for i in range(n))
        mark(self, Call("Correlated", {"parameters": names, "matrix": given, "space": space}))

    @staticmethod
    def _check_definite(where: str, what: str, matrix: Array) -> None:
        smallest = float(linalg.eigvalsh(matrix)[0])
        if smallest <= 1e-12:
            raise SceneError(
                f"{where}: {what} is not positive definite: its smallest eigenvalue is "
                f"{smallest:.6g}; lower the correlations"
            )

    def _score_correlation(
        self, where: str, i: int, j: int, target: float, a: Array, b: Array
    ) -> float:
        """Correlation of two normal scores for a given one of the parameters (Mehler's series)."""
        if target == 0.0:
            return 0.0
        first, second = self.marginals[i], self.marginals[j]
        series = a * b / (first.std * second.std)
        series[0] = 0.0
        normal_pair = np.abs(series[2:]).max() < 1e-12 and abs(series[1] - 1.0) < 1e-12
        if normal_pair:
            return target
        polynomial = np.polynomial.Polynomial(series)
        lowest, highest = float(polynomial(-1.0)), float(polynomial(1.0))
        if not lowest < target < highest:
            raise SceneError(
                f"{where}: {first.name!r} and {second.name!r} cannot have the correlation "
                f"{target:g}; with their distributions it lies between {lowest:.4g} and {highest:.4g}"
            )
        found = optimize.brentq(lambda r: float(polynomial(r)) - target, -1.0, 1.0, xtol=1e-15)
        return float(found)

    def __len__(self) -> int:
        return len(self._members)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            for member in self._members:
                if member.name == key:
                    return member
            raise unknown_name("parameter", key, [m.name for m in self._members], "Correlated")
        return self._members[key]

    def __iter__(self) -> Iterator[CorrelatedParameter]:
        return iter(self._members)

    def __repr__(self) -> str:
        return f"Correlated({list(self.marginals)!r})"
