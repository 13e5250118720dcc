"""What is prescribed more than once: displacements and jumps that contradict each other are refused."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable
from functools import partial

import numpy as np

from dolfinx_frontend.assembly.gathered import by_first, over_ranks, prescribing
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.meeting import Differing, Off, refuse, supports_that_meet
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import linalg
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.plan.reduction import differ, disagree, members_of_bodies
from dolfinx_frontend.plan.ties import given_at
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.laws import Elimination, Rigid

__all__ = ["check_prescribed", "moments_of", "spanning"]

_SPANNED = 1e-10
"""Points whose values are combinations of those of others, to this relative to the largest, are spanned."""


def _at_points(
    problem: Problem, x: Array, one: Interface, other: Interface, amplitude: Amplitude | None
) -> Differing:
    """What supports and given motions of two faces prescribe differently at points (m, d)."""
    both = []
    for i in (one, other):
        if isinstance(i.law, Rigid):
            both.append(given_at(problem, i, amplitude, x))
        else:
            directions, values = i.law.pattern(amplitude).constraint(i.name, i.sides[0], x)
            both.append((directions, values, float(np.abs(values).max(initial=0.0))))
    rows, target = np.concatenate([r for r, _, _ in both]), np.concatenate([v for _, v, _ in both], axis=1)
    off = target @ np.linalg.pinv(rows, rcond=1e-6).T @ rows.T - target
    said = partial(differ, f"{one.name!r} and {other.name!r}", "points")
    return {"points": Off(off, max(moved for _, _, moved in both), said)}


def moments_of(problem: Problem, times: Array | None) -> set[float]:
    """Times at which what is prescribed has to agree: those of the steps, and breakpoints of amplitudes."""
    return {*([0.0] if times is None else times)}.union(*(a.times for a in problem.amplitudes))


def check_prescribed(problem: Problem, eliminated: Container[str], moments: Collection[float]) -> None:
    """Refuse displacements and jumps that contradict each other at common nodes, where interfaces are kept,
    supports that contradict motions of rigid faces, and what supports and given motions of two parts
    prescribe where they meet at a glued joint; collective.

    A kept interface prescribes what an eliminated one does: no field has both values, and forces that enforce
    them grow without limit as an iteration goes on. Different amplitudes may agree at all moments. What glue
    joins over several ranks the first one checks, as it would alone.

    Raises
    ------
    SceneError
        Names the interfaces and the difference, as :func:`reduce` does.
    """
    over = over_ranks(problem)
    if over:
        refused = by_first(
            problem, prescribing(problem, over), lambda whole: _refused(whole, eliminated, moments)
        )
        if refused:
            raise SceneError(refused)
    with agreement(problem.comm):
        _check(problem.own, eliminated, moments)
    for time in moments:
        found = ((name, i.law.prescribed(time)) for name, i in problem.interfaces.items())
        passing = {name: law for name, law in found if law is not None}
        if passing:
            check_prescribed(problem.with_laws(passing), eliminated, [time])


def _refused(problem: Problem, eliminated: Container[str], moments: Iterable[float]) -> str:
    """Why it is refused; empty: it is not."""
    try:
        _check(problem, eliminated, moments)
    except SceneError as failure:
        return str(failure)
    return ""


def _check(problem: Problem, eliminated: Container[str], moments: Iterable[float]) -> None:
    """As :func:`check_prescribed`, of parts that are here."""
    given = {
        name: i
        for name, i in problem.interfaces.items()
        if problem.substructures.keys() >= {*(side.substructure for side in i.sides), *i.law.partners}
        and (i.law.elimination is Elimination.GLUED) == (i.matching is not None)
        and i.law.prescribes == "jump"
    }
    amplitudes = (None, *problem.amplitudes)
    for one, other, x in supports_that_meet(problem.interfaces, problem.substructures):
        refuse({a: _at_points(problem, x, one, other, a) for a in amplitudes}, moments)
    if all(name in eliminated for name in given):
        return  # `reduce` sees them all
    ties = {n for n, i in given.items() if i.law.elimination is Elimination.TIED}
    kept = {n for n, i in given.items() if i.matching is not None and n not in eliminated}
    for chosen in (given.keys() - ties, given.keys() - kept)[: 2 if ties else 1]:
        for members in members_of_bodies(problem, chosen):
            inside = [i for n, i in given.items() if n in chosen and i.sides[0].substructure in members]
            off: dict[Amplitude | None, Differing] = {a: {} for a in amplitudes}
            for amplitude, found in off.items():
                laws = {i.name: i.law.pattern(amplitude) for i in inside}
                disagree(problem, members, inside, laws, found)
            refuse(off, moments)


def spanning(values: Array) -> list[int]:
    """Points of which the values (k, N) of all N are affine combinations: what is prescribed differently is
    affine in them, and where these points have none of it no point has."""
    size = max(float(np.abs(values).max()), 1e-300)
    upper, order = linalg.qr(np.vstack([np.full(values.shape[1], size), values]), mode="r", pivoting=True)
    rank = np.count_nonzero(np.abs(np.diag(upper)) > _SPANNED * abs(upper[0, 0]))
    return [int(k) for k in order[:rank]]
