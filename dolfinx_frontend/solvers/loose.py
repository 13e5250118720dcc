"""Bolts that have lost more length than tightening has stretched them by."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.results.result import Result

__all__ = ["check_bolts"]


def check_bolts(result: Result) -> None:
    """Warn of bolts that push at the end of a run: a preload holds its length, a real bolt is loose.

    Warns
    -----
    SceneWarning
        The embedding is larger than what tightening has stretched bolt and joint by.
    """
    problem = result.problem
    for name, interface in problem.own.interfaces.items():
        if not interface.law.may_loosen or not problem.speaks_for(name):
            continue
        force = np.asarray(result.force(name)[..., 0] @ interface.weights)
        last = float(force[-1] if force.ndim else force)
        if last < 0.0:
            warn(
                f"interface {name!r}: the bolt pushes with {-last:.4g} at the end: its embedding is larger "
                "than what tightening has stretched bolt and joint by, a real bolt is loose: tighten it "
                "more, or take a smaller embedding",
                SceneWarning,
            )
