"""Bolts that have lost more length than tightening has stretched them by."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.results.result import Result

__all__ = ["check_bolts"]

LOOSE = 1e-3
"""Compression, relative to the largest force of the bolt, that is no answer's own error any more."""


def check_bolts(result: Result) -> None:
    """Warn of bolts that push once they hold their length: a preload does, a real bolt is loose then.

    Warns
    -----
    SceneWarning
        The joint has lost more length than what tightening has stretched bolt and joint by: by embedding, or
        by what was tightened or loaded afterwards.
    """
    problem, times = result.problem, result.times
    for name, interface in problem.own.interfaces.items():
        law = interface.law
        if not law.may_loosen or not problem.speaks_for(name):
            continue
        force = np.atleast_1d(result.force(name)[..., 0] @ interface.weights)
        held = [times is None or not law.controlled(t) for t in (times if times is not None else [None])]
        pushes = np.flatnonzero((force < -LOOSE * np.abs(force).max()) & held)
        if not pushes.size:
            continue
        step = int(pushes[np.argmin(force[pushes])])
        when = "" if times is None else f" at t = {times[step]:g}"
        warn(
            f"interface {name!r}: the bolt pushes with {-force[step]:.4g}{when}: the joint has lost more "
            "length than what tightening has stretched bolt and joint by; a real bolt is loose: tighten it "
            "more or again, or take a smaller embedding",
            SceneWarning,
        )
