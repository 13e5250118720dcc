"""Numbers of all samples summed up, with the errors beside each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array, largest_of
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.mesh_error import discretisation_error
from dolfinx_frontend.results.answer import Answer
from dolfinx_frontend.results.errors import Errors
from dolfinx_frontend.results.resultant import Interest, Resultant
from dolfinx_frontend.sheets.clamping import Bolt
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
    goals
        Bolt -> error of its force at the end by the meshes, absolute, of bolts of which it was estimated for
        the force itself (dual weighted residuals).
    """

    algebra: float
    algebra_how: str
    mesh: float
    mesh_how: str
    goals: Mapping[str, float] = field(default_factory=dict)


def errors_known(answer: Answer, given: Any, bolts: Sequence[Bolt]) -> Known:
    """The errors of an answer.

    Parameters
    ----------
    given
        True: the error of the meshes is estimated where that is possible; False: nothing is computed; or
        :class:`Errors` that were measured before, e.g. those of a solve at the means; or ``"goal"``: as True,
        and that of each bolt force by a dual problem of its own.
    """
    every: Any = answer
    algebra = largest_of(np.atleast_1d(np.asarray(every.error, dtype=np.float64)))
    how = "estimate of the iteration"
    if isinstance(given, Errors):
        mesh = given.discretisation
        if mesh is None or not np.isfinite(given.relative("discretisation")):
            return Known(algebra, how, float("nan"), "not in the errors that were given")
        return Known(algebra, how, given.relative("discretisation"), f"given: {mesh.how}")
    goal = isinstance(given, str) and given == "goal"
    if not goal and not isinstance(given, (bool, np.bool_)):
        raise SceneError("report: errors: give True, False, 'goal', or what errors(...) of a result returned")
    if not given:
        return Known(algebra, how, float("nan"), "not asked for")
    whole: Interest = None
    try:
        found = discretisation_error(answer, whole)  # type: ignore[arg-type]
    except SceneError as error:
        return Known(algebra, how, float("nan"), str(error).partition("\n")[0])
    how_of_meshes = "recovered stresses, energy norm"
    goals, why = _goals(answer, bolts) if goal else ({}, "")
    return Known(algebra, how, found.energy, how_of_meshes + why, goals)


def _goals(answer: Answer, bolts: Sequence[Bolt]) -> tuple[dict[str, float], str]:
    """Errors of the forces of bolts at the end, and why those of others are not known.

    A preload has no dual problem: where a bolt has a joint for itself, it is that of the joint, from which
    its own force differs by the load, which has no error.
    """
    found: dict[str, float] = {}
    why = ""
    for bolt in bolts:
        own = [name for name, share in bolt.joints.items() if np.all(share == 1.0)]
        several = [bolt.interface, *(own if len(own) == len(bolt.joints) == 1 else [])]
        for interface in several:
            try:
                one = discretisation_error(answer, Resultant(interface))  # type: ignore[arg-type]
            except SceneError as error:
                why = f"; of {bolt.name} alone: {str(error).partition(chr(10))[0]}"
                continue
            assert one.quantity is not None  # one was asked for
            found[bolt.name] = one.quantity + one.unseen
            break
    return found, why if len(found) < len(bolts) else ""


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
