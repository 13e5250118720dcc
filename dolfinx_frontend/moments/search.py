"""Moments to an accuracy: rules that agree with witnesses, pieces of a single germ, or calibrated samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_frontend.moments.model import Keep, Moments, PointModel
from dolfinx_frontend.moments.panels import by_panels
from dolfinx_frontend.moments.rules import by_rules
from dolfinx_frontend.moments.samples import by_samples
from dolfinx_frontend.moments.tails import Tail, beside_tails, heavy_tails
from dolfinx_frontend.moments.validation import Witnesses, few_witnesses
from dolfinx_frontend.uncertainty.statistics import FINEST, MeanStd, share_of, size_of, whole_of

__all__ = ["FEW_GERMS", "endless", "judges_of", "moments_to", "tails_of", "tolerance_of"]

FEW_GERMS = 3
"""Most germs that are integrated by tensor rules."""

TIGHT = 3e-3
"""Tolerance of single points, relative to the accuracy of the deviation: a force may be a small part of the
energy, and the last digits take Newton's method one iteration."""

LOOSEST, LOOSEST_LINEAR, LOOSEST_ALONE = 1e-8, 1e-6, 1e-4
"""Loosest tolerances of points, of nonlinear laws and of linear ones: a run that starts from a neighbour
whose contact is open can stay there for two iterations and look converged at 1e-6 (measured: 3 % of the
points of a chain of soft layers). One that starts from nothing does not: the loosest of these."""

OF_WITNESSES = 6e-3
"""Tolerance of the witnesses of a rule, relative to the root of the accuracy of the deviation, as squares of
what they say count; their errors can only be added to what a rule seems to lack."""

MOST_ENDLESS = 1024
"""Samples at most where there is no finite deviation."""

NOTICED = 0.1
"""Share of the accuracy that witnesses must be off the mean by so that their tails are looked at."""


def _spread(about: MeanStd, model: PointModel) -> float:
    """What counts of a number beside its mean, at most 1; `about`: what is known of its moments."""
    whole = max(about.std or 0.0, model.statistic.compared.least)
    return min(share_of(whole, about.mean), 1.0) or 1e-6


def tolerance_of(model: PointModel, target: float, about: MeanStd, loosest: float = LOOSEST) -> float:
    """Tolerance of single points: relative to the whole, of which a number may scatter by a share only."""
    if model.linear:
        loosest = LOOSEST_LINEAR
    return float(np.clip(TIGHT * target * _spread(about, model), FINEST, loosest))


def tails_of(
    model: PointModel, about: MeanStd, seen: Witnesses, target: float, rtol: float
) -> list[Tail]:
    """The tails that matter: to moments, not to quantiles. `rtol`: error of what is known of the moments."""
    if model.statistic.level is not None:
        return []
    size = size_of(about, model.statistic)
    least = min(size, whole_of(about, rtol, model.statistic) or size)
    if not float(np.max(np.abs(seen.values - about.mean))) > NOTICED * target * least:
        return []  # rounding beside what matters
    return heavy_tails(model, seen, about, target)


def endless(tails: Sequence[Tail]) -> bool:
    """Whether there may be no finite deviation."""
    return any(tail.power + tail.doubt >= 0.5 for tail in tails)


def judges_of(model: PointModel, about: MeanStd, target: float) -> Witnesses | None:
    """Witnesses of rules; None: there are too many germs for rules, or a quantile is asked for."""
    if not _ruled(model):
        return None
    alone = tolerance_of(model, target, about, LOOSEST_ALONE)
    loose = OF_WITNESSES * np.sqrt(target) * _spread(about, model)
    return few_witnesses(model, float(np.clip(loose, alone, LOOSEST_ALONE)), target)


def _ruled(model: PointModel) -> bool:
    return model.space.dimension <= FEW_GERMS and model.statistic.level is None


def moments_to(
    model: PointModel,
    about: MeanStd,
    accuracy: float,
    target: float,
    seen: Witnesses | None = None,
    judges: Witnesses | None = None,
    tails: Sequence[Tail] = (),
    keep: Keep = lambda found: None,
) -> tuple[Moments, tuple[str, ...]]:
    """Moments, or a quantile, to an accuracy, and notes of what could not be reached.

    Parameters
    ----------
    about
        What is known of the moments.
    accuracy, target
        Relative error at most: of all that is left, and of the points.
    seen, judges
        Witnesses of what stands for the number, if there are, and of rules.
    tails
        Those that matter.
    keep
        Takes what is known while more points are solved.
    """
    space, each = model.space, tolerance_of(model, target, about)
    if judges is not None and _ruled(model):
        found = None
        if not tails or (space.dimension > 1 and not endless(tails)):
            found = by_rules(model, target, tolerance_of(model, target, about, LOOSEST_ALONE), judges, keep)
            if found is not None and tails:
                found = beside_tails(found, tails, space, judges.points)
                found = found if found.total(model.statistic) <= accuracy else None
        if found is None and space.continuous == (True,) and not endless(tails):
            found = by_panels(model, target, each, judges, keep, tails)
        if found is not None:
            return found, ()
    return by_samples(model, target, each, seen, keep, MOST_ENDLESS if endless(tails) else 0, tails)
