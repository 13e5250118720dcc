"""The polynomial chaos that is requested."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from latin_core.stochastic import IndexSet

from dolfinx_frontend.common.checks import check_known, checked_number, checked_whole, is_list, is_whole
from dolfinx_frontend.common.describe import record, short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import frozen

__all__ = ["Chaos"]


@dataclass(frozen=True, repr=False)
class Chaos:
    """The polynomial chaos that is requested.

    Parameters
    ----------
    order
        p >= 0.
    index_set
        ``"total"``: total degree <= p; ``"tensor"``: degree <= p in each germ; ``"hyperbolic"``:
        q-norm of the degrees <= p, which thins out interactions.
    q
        Exponent of the hyperbolic set, in (0, 1].
    weights
        Anisotropy: one positive number per germ, or by name of the parameters (1 for the others);
        degree i of a germ counts as weight * i.
    max_interaction
        Greatest number of germs in one mode; None: no limit.
    quadrature
        Points in each germ (by name of the parameter, or one number for all) of the tensor Gauss rule at
        which nonlinear laws are evaluated. None: 2 (p + 1), and 16 at least in one or two germs,
        if that gives few enough points (:data:`dolfinx_frontend.solvers.collocation.MOST_TENSOR`),
        Sobol points otherwise.
    sobol_points
        Use this many scrambled Sobol points instead, a power of two.
    check_points
        Deterministic solves with which the truncation of a nonlinear scene is checked; 0: none.
    tolerance
        Relative error of mean and standard deviation of an interface force up to which such an answer is
        trusted.
    indices
        Your own set of multi-indices (one degree per germ, including the zero index), within `order`;
        `index_set`, `q`, `weights` and `max_interaction` do not apply. ``solve(accuracy=...)`` makes
        such sets.
    """

    order: int
    index_set: IndexSet = "total"
    q: float = 0.75
    weights: Sequence[float] | Mapping[str, float] | None = None
    max_interaction: int | None = None
    quadrature: int | Mapping[str, int] | None = None
    sobol_points: int | None = None
    check_points: int = 32
    tolerance: float = 0.01
    indices: tuple[tuple[int, ...], ...] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return record(self)

    def __post_init__(self) -> None:
        checked_whole("Chaos", "order", self.order, 0)
        check_known("index set", self.index_set, ("total", "tensor", "hyperbolic"), "Chaos")
        checked_number("Chaos", "q", self.q, above=0.0, most=1.0)
        if self.max_interaction is not None:
            checked_whole("Chaos", "max_interaction", self.max_interaction, 1)
        self._check_points()
        if self.weights is not None:
            named = isinstance(self.weights, Mapping)
            if not named and not isinstance(self.weights, Sequence) and not is_list(self.weights):
                raise SceneError(f"Chaos: weights = {self.weights!r}: give one per germ, or by name")
            values = self.weights.values() if isinstance(self.weights, Mapping) else self.weights
            for value in values:
                checked_number("Chaos", "weights", value, above=0.0)
            if not named:
                object.__setattr__(self, "weights", tuple(self.weights))
        if self.indices is not None:
            self._check_indices()
        for name in ("weights", "quadrature", "indices"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def _check_indices(self) -> None:
        rows = self.indices.tolist() if isinstance(self.indices, np.ndarray) else self.indices
        kinds = (list, tuple, np.ndarray)
        whole = isinstance(rows, (list, tuple)) and all(
            isinstance(row, kinds) and all(is_whole(i) and i >= 0 for i in row) for row in rows
        )
        if not whole or not rows or len({len(row) for row in rows}) > 1:
            raise SceneError(
                f"Chaos: indices = {short(rows)}: give rows of whole numbers >= 0, one degree per germ"
            )

    def _check_points(self) -> None:
        checked_number("Chaos", "tolerance", self.tolerance, above=0.0)
        wanted = self.quadrature
        for count in wanted.values() if isinstance(wanted, Mapping) else (wanted,):
            if count is not None and (not is_whole(count) or count < 1):
                raise SceneError(
                    f"Chaos: quadrature = {wanted!r}: give a whole number of points >= 1 in each germ"
                )
        sobol = self.sobol_points
        if sobol is not None and (not is_whole(sobol) or sobol < 1 or sobol & (sobol - 1)):
            raise SceneError(f"Chaos: sobol_points = {sobol!r} must be a power of two")
        if sobol is not None and wanted is not None:
            raise SceneError("Chaos: quadrature and sobol_points are two rules: give one")
        if not is_whole(self.check_points) or self.check_points < 0 or self.check_points == 1:
            raise SceneError(
                f"Chaos: check_points = {self.check_points!r}: give 0 (no check) or a number >= 2"
            )
