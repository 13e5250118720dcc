"""Bolts that have lost more length than tightening has stretched them by."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.common.model_limits import beyond
from dolfinx_frontend.common.statuses import NO_EQUILIBRIUM, SLIDES
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.sweep import PointResults

__all__ = ["check_bolts"]

LOOSE = 1e-3
"""Compression, relative to the largest force of the bolt, that is no answer's own error any more."""


def check_bolts(answer: Result | PointResults, what: str = "") -> None:
    """Warn of bolts that push once they hold their length: a preload does, a real bolt is loose then; and of
    points at which they are tightened by a negative force.

    Parameters
    ----------
    what
        One of several points in a message: of these it is said how many push, and which one the most.

    Warns
    -----
    SceneWarning
        The joint has lost more length than what tightening has stretched bolt and joint by: by embedding, or
        by what was tightened or loaded afterwards. Or a distribution of its force reaches below 0.
    """
    problem, times = answer.problem, answer.plan.times
    if isinstance(answer, PointResults) and not answer.reached.any():
        return
    for name, interface in problem.own.interfaces.items():
        law = interface.law
        if not law.may_loosen or not problem.speaks_for(name):
            continue
        held = [times is None or not law.controlled(t) for t in (times if times is not None else [None])]
        force = np.reshape(answer.force(name)[..., 0] @ interface.weights, (-1, len(held)))
        pushes = force < -LOOSE * np.abs(force).max(axis=1, keepdims=True)
        if isinstance(answer, PointResults):  # without equilibrium a force means nothing
            pushes &= ~np.isin(answer.statuses.ravel(), (NO_EQUILIBRIUM, SLIDES))[:, None]
            given = np.where(held, 0.0, np.nan_to_num(force))  # known whatever comes of it
            tightened = given < -LOOSE * np.abs(given).max(initial=0.0)
            if tightened.any():
                count, least = tightened.any(axis=1).sum(), given.min()
                beyond(
                    f"interface {name!r}: {count} of {len(force)} {what}s tighten the bolt with a negative "
                    f"force (the least {least:.4g}): its distribution reaches below 0; a smaller cov, or "
                    "LogNormal or TruncatedNormal",
                    f"{name} negative",
                )
                pushes &= ~tightened.any(axis=1, keepdims=True)
        pushes &= np.array(held)
        if not pushes.any():
            continue
        point, step = np.unravel_index(np.argmin(np.where(pushes, force, 0.0)), force.shape)
        when = "" if times is None else f" at t = {times[step]:g}"
        if what:
            when += f" at {what} {point}, the most of {pushes.any(axis=1).sum()} of {len(force)} {what}s"
        warn(
            f"interface {name!r}: the bolt pushes with {-force[point, step]:.4g}{when}: the joint has lost "
            "more length than what tightening has stretched bolt and joint by; a real bolt is loose: tighten "
            "it more or again, or take a smaller embedding",
            SceneWarning,
            f"{name} pushes",
        )
