"""Faces that have slid, or parts that have moved, further than the linear kinematics of the scene go."""

from __future__ import annotations

import numpy as np

from dolfinx_frontend.common.errors import SceneWarning, warn
from dolfinx_frontend.common.model_limits import LIMITS
from dolfinx_frontend.common.statuses import NO_EQUILIBRIUM, SLIDES, STOPPED, UNDECIDED
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.sweep import PointResults

__all__ = ["check_sliding"]


def check_sliding(answer: Result | PointResults, what: str = "") -> None:
    """Warn of contacts that slide by a facet or 5 % of their face, or move by more than a part is large.

    Parameters
    ----------
    what
        One of several points in a message.

    Warns
    -----
    SceneWarning
        Contact is between points that were opposite each other in the beginning, and rotations are small.
    """
    problem, times = answer.problem, answer.plan.times
    steps = 1 if times is None else len(times)
    known = ~np.isin(np.ravel(answer.statuses), (NO_EQUILIBRIUM, SLIDES, UNDECIDED, *STOPPED))
    of_points = isinstance(answer, PointResults)
    if isinstance(answer, PointResults) and not answer.reached.any():
        return
    known = known.reshape((-1, 1) if of_points else (1, -1)) & np.ones((1, steps), dtype=bool)
    for name, interface in problem.own.interfaces.items():
        law = interface.law
        if not law.unilateral or interface.one_point or not problem.speaks_for(name):
            continue
        shape = (len(known), steps, interface.num_points, law.count(interface.dim))
        jump = np.where(known[..., None, None], np.reshape(answer.jump(name), shape), 0.0)
        presses = np.reshape(answer.force(name), shape)[..., 0] < 0.0
        slip = np.linalg.norm(jump[..., 1:], axis=-1) * presses
        limit = interface.reach
        length = min(problem.parts[side.substructure].length for side in interface.sides)
        far = np.linalg.norm(jump, axis=-1) / length
        slid = slip / limit
        if not max(slid.max(initial=0.0), far.max(initial=0.0)) > 1.0:
            continue
        point, step, place = np.unravel_index(np.argmax(np.maximum(slid, far)), slid.shape)
        when = "" if times is None else f" at t = {times[step]:g}"
        when += f" at {what} {point}" if what else ""
        where = ", ".join(f"{x:.4g}" for x in interface.points[place])
        by = float(np.linalg.norm(jump[point, step, place]))
        slides = slid[point, step, place] >= far[point, step, place]
        if slides:
            text = f"its faces slide by {slip[point, step, place]:.3g}{when} at ({where}), further than "
            text += f"{limit[place]:.3g}, a facet or {LIMITS.sliding:.0%} of the face: pressures stay where "
            text += "it was"
        else:
            text = f"its faces move by {by:.3g}{when} at ({where}) from each other, further than a part is "
            text += "large: contacts and rotations are those of small motions"
        text += "; place the parts where they come to lie, or hold what moves"
        warn(f"interface {name!r}: {text}", SceneWarning, f"{name} slides" if slides else "displacement")
