"""Numbers of all samples summed up, with the errors beside each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.mesh_error import discretisation_error
from dolfinx_frontend.results.accuracy import largest_of
from dolfinx_frontend.results.answer import Answer
from dolfinx_frontend.results.errors import Errors
from dolfinx_frontend.results.resultant import Interest
from dolfinx_frontend.uncertainty.quantities import Estimate, Kind, Quantity

__all__ = ["Known", "below", "errors_known", "label", "statistics_of", "tightened"]

TIGHTER, FINEST = 0.1, 1e-12


def label(q: float) -> str:
    """Name of a quantile."""
    return f"{100.0 * q:g} %"


def statistics_of(
    values: Array, kind: Kind, weights: Array | None, quantiles: Sequence[float]
) -> dict[str, float]:
    """Value; lowest and highest of a sweep; or mean, deviation and quantiles of samples (N,)."""
    if kind == "value":
        return {"value": float(values[0])}
    if kind == "grid":
        return {"lowest": float(values.min()), "highest": float(values.max())}
    if not np.all(np.isfinite(values)):  # a safety without a load
        found = {"mean": float("nan"), "std": float("nan")}
        if weights is None:
            found |= {label(q): float(np.quantile(values, q, method="inverted_cdf")) for q in quantiles}
        return found
    quantity = Quantity("number", values=values, weights=weights, kind=kind)
    found = {"mean": quantity.mean().value, "std": float("nan")}
    try:
        found["std"] = quantity.std().value
    except SceneError:  # one sample, or a rule that is too coarse
        pass
    if weights is None:
        found |= {label(q): quantity.quantile(q).value for q in quantiles}
    return found


def below(values: Array, kind: Kind, limit: float) -> Estimate | None:
    """Probability that a number is at a limit or below it; None: it has none."""
    if kind not in ("random", "qmc") or not np.all(np.isfinite(values)):
        return None
    quantity = Quantity("number", values=values, kind=kind)
    return quantity.probability(below=float(np.nextafter(limit, np.inf)))


@dataclass(frozen=True)
class Known:
    """What is known of the errors of an answer.

    Attributes
    ----------
    algebra, mesh
        Relative, in the energy norm; NaN: not known.
    algebra_how, mesh_how
        How, or why not.
    """

    algebra: float
    algebra_how: str
    mesh: float
    mesh_how: str


def errors_known(answer: Answer, given: Any) -> Known:
    """The errors of an answer.

    Parameters
    ----------
    given
        True: the error of the meshes is estimated where that is possible; False: nothing is computed; or
        :class:`Errors` that were measured before, e.g. those of a solve at the means.
    """
    every: Any = answer
    algebra = largest_of(np.atleast_1d(np.asarray(every.error, dtype=np.float64)))
    how = "estimate of the iteration"
    if isinstance(given, Errors):
        mesh = given.discretisation
        if mesh is None or not np.isfinite(given.relative("discretisation")):
            return Known(algebra, how, float("nan"), "not in the errors that were given")
        return Known(algebra, how, given.relative("discretisation"), f"given: {mesh.how}")
    if not isinstance(given, (bool, np.bool_)):
        raise SceneError("report: errors: give True, False, or what errors(...) of a result returned")
    if not given:
        return Known(algebra, how, float("nan"), "not asked for")
    whole: Interest = None
    try:
        found = discretisation_error(answer, whole)  # type: ignore[arg-type]
    except SceneError as error:
        return Known(algebra, how, float("nan"), str(error).partition("\n")[0])
    return Known(algebra, how, found.energy, "recovered stresses, energy norm")


def tightened(answer: Answer) -> Any:
    """The answer with its iteration carried on to a tenth of its error; None: it is not to be had."""
    if answer.status != "converged" or not hasattr(answer, "tightened") or not answer.plan.active:
        return None
    error = min(float(answer.plan.options.rtol), float(answer.error))  # type: ignore[attr-defined]
    try:
        found = answer.tightened(max(TIGHTER * error, FINEST))
    except SceneError:
        return None
    return found if found.status == "converged" else None
