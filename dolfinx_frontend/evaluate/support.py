"""Parts that lose their support: loads that no forces of the interfaces can balance, parts left free.

Interfaces in contact push and rub but do not pull. Take the rigid motions u that all other interfaces
leave free (none, if contact is not needed to hold a part: then there is nothing to check), g and v the
opening and the slip that u makes at an interface point, F the loads. Three questions:

**No equilibrium.** Normal forces p >= 0 and |t| <= mu p + tau balance the loads unless some u has

    g >= mu |v| at every point,   F u > sum w tau |v|

(Farkas' lemma: no admissible force does enough work against u to balance that of the loads). Such a u
proves that the discretised scene has no solution, whatever an iteration says: this is an error.

**Slipping.** Friction is only as strong as the normal forces are: with the bounds b = mu |f_n| + tau of
the forces that were reached there is no balance if some u has

    g >= 0 at every point,   F u > sum w b |v|.

These forces may be wrong in a run that has not converged: this is a warning only.

**Undetermined.** A converged answer in which a part touches nothing that holds it and carries no load is
one of many: a warning.

Displacements are small: points stay where they are meshed, a contact that would be met later does not
count unless it is an interface of the scene.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from latin_core import SweepPoints, SweptParameter

from dolfinx_frontend.assembly.held import check_held, held, own_resistances
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, exchanged
from dolfinx_frontend.assembly.rigid import FreeMotions, Resistance, free_motions, quoted
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.deferred import optimize
from dolfinx_frontend.common.errors import BalanceError, SceneError, SceneWarning, warn
from dolfinx_frontend.common.progress import Lines
from dolfinx_frontend.common.statuses import NO_EQUILIBRIUM, SLIDES, UNDECIDED, UNDETERMINED
from dolfinx_frontend.plan.prescribed import check_prescribed, moments_of, spanning
from dolfinx_frontend.results.accuracy import stronger
from dolfinx_frontend.results.contact import contact_states
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.surfaces import law_contact
from dolfinx_frontend.results.sweep import PointResults
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.laws.contact import CURVED

__all__ = ["Support", "acts", "check_support", "named_without_equilibrium"]

_CERTAIN = 1e-6
"""Fraction of the loads that must be out of balance for an error: more than rounding can cause."""

_DOUBTFUL = 2e-3
"""The same for a warning, which is based on the forces of an iteration."""

_ROUNDS = 300
"""Most rounds of the search for the motion that the loads drive."""

_CONVEX = 100.0
"""Weight of the condition that the fractions of bounded forces sum up to 1."""

_CLIMB = 1.5
"""A motion that opens no point by more than this, relative to friction times the largest slip, is a slip."""

_KNOWN = 1e-3
"""Share of a step to which the time of the last loads that are balanced is known."""

_JAMMED = 1e-6
"""Cosine below which a force counts as perpendicular to a motion."""

_CANCELLED = 1e-9
"""Work of pressures, relative to that of the loads, below which it is what rounding has left of nothing."""

_FLOATS = 10.0
"""A part whose rigid motion is so much larger than its other displacements floats."""

_TURNS = 1e-2
"""Rotations that move the points of a part by less than this, relative to its translations, are not named."""

_TOUCHING = 1e-6
"""Opening, relative to the face's size, below which two faces touch."""


_log = logging.getLogger(__name__)
T = TypeVar("T")


@dataclass(frozen=True)
class _Grip:
    """What an interface in contact can carry at its points, and how they move.

    Attributes
    ----------
    weights
        (m,), areas of the points.
    opening, slip
        (m, q), (m, d - 1, q): relative motion made by each of the free motions.
    friction, threshold
        (m,): the tangential force per area is at most friction * pressure + threshold.
    """

    weights: Array
    opening: Array
    slip: Array
    friction: Array
    threshold: Array

    def with_bounds(self, bounds: Array) -> _Grip:
        """The same with given bounds of the tangential force."""
        return _Grip(self.weights, self.opening, self.slip, np.zeros_like(bounds), bounds)


@dataclass(frozen=True)
class _Balance:
    """What is known of a time step before it is solved: grips, work of the loads, sum of their sizes."""

    grips: dict[str, _Grip]
    work: Array
    size: float


@dataclass(frozen=True)
class _Check:
    """What is free at a time step, what holds the rest, and the loads."""

    motions: FreeMotions
    resistances: dict[str, Resistance]
    balance: _Balance


@dataclass(frozen=True)
class _Reached:
    """An interface in contact in the answer, at one time step.

    Attributes
    ----------
    force
        (m, components), force per area.
    holds
        What it resists where it presses (of a history: where it touches; of a run that did not converge
        everywhere: what is open may close yet).
    sticks
        The same without friction along the slip of points where it is used up.
    closed
        Whether it presses (touches) anywhere.
    """

    force: Array
    holds: Resistance
    sticks: Resistance
    closed: bool


def _decide(problem: Problem, work: Callable[[], T]) -> T:
    """Work of the first rank, whose outcome all get: rounding must not divide them."""
    spread = problem.distribution
    if spread is None:
        return work()
    outcome: list[T] = []
    with agreement(spread.comm):
        if spread.rank == 0:
            outcome.append(work())
    shared: list[T] = spread.comm.bcast(outcome)
    return shared[0]


def _free(problem: Problem, resistances: Mapping[str, Resistance]) -> FreeMotions:
    parts = {name: (part.centre, part.length) for name, part in problem.parts.items()}
    motions = free_motions(parts, [*resistances.values(), *own_resistances(problem.parts)])
    if not len(motions):
        return motions
    groups, r, q = motions.basis.shape
    basis = np.linalg.qr(motions.basis.reshape(groups * r, q))[0]
    return FreeMotions(motions.groups, motions.origins, basis.reshape(groups, r, -1))


def _relative(problem: Problem, names: list[str], motions: FreeMotions) -> dict[str, Array]:
    """Jumps (m, d, q) that the motions make, in the local frame, at interfaces with a side here."""
    shares: dict[tuple[str, int], Array] = {}
    for name in names:
        interface = problem.interfaces[name]
        for k, (side, sign) in enumerate(zip(interface.sides, (-1.0, 1.0), strict=False)):
            if side.substructure not in problem.substructures:
                continue
            nodes = problem.substructures[side.substructure].dof_coordinates
            moved = motions.at(side.substructure, nodes).reshape(nodes.size, -1)
            share = sign * (interface.local_trace(k) @ moved)
            shares[name, k] = share.reshape(interface.num_points, interface.dim, -1)
    if problem.distribution is not None:
        cuts = {key: share for key, share in shares.items() if key[0] in problem.cuts}
        for found in exchanged(problem.distribution.comm, cuts):
            shares.update(found)
    return {
        name: sum(
            (shares[name, k] for k in range(len(problem.interfaces[name].sides))),
            start=np.zeros(()),
        )
        for name in names
        if name in problem.own.interfaces
    }


def _loads(problem: Problem, motions: FreeMotions, time: float | None) -> tuple[Array, float]:
    """Work (q,) of the loads in the motions, and the sum of their sizes."""
    nodal = {name: problem.load_on(name).reshape(-1, s.dim) for name, s in problem.substructures.items()}
    for name, interface in problem.own.interfaces.items():
        load = interface.law.load(interface, time)
        if load is None:
            continue
        if interface.wrench is not None:
            for k, (side, sign) in enumerate(zip(interface.sides, (1.0, -1.0), strict=False)):
                if side.substructure in nodal:
                    row = interface.local_trace(k)[0].toarray().ravel()
                    nodal[side.substructure] += sign * (load[0, 0] * row).reshape(-1, interface.dim)
            continue
        vectors = np.einsum("pij,pi->pj", interface.frames, load * interface.weights[:, None])
        for side, sign in zip(interface.sides, (1.0, -1.0), strict=False):
            if side.substructure in nodal:
                nodal[side.substructure] += sign * (side.shape.T @ vectors)
    work, size = np.zeros(len(motions)), 0.0
    for name, f in nodal.items():
        size += float(np.linalg.norm(f, axis=1).sum())
        loaded = np.flatnonzero(np.any(f != 0.0, axis=1))
        at = motions.at(name, problem.substructures[name].dof_coordinates[loaded])
        work += np.einsum("nd,ndq->q", f[loaded], at)
    if problem.distribution is not None:
        every = exchanged(problem.distribution.comm, (work, size))
        work = np.sum([each for each, _ in every], axis=0)
        size = sum(each for _, each in every)
    return work, size


def _grips(problem: Problem, jumps: Mapping[str, Array]) -> dict[str, _Grip]:
    out = {}
    for name, jump in jumps.items():
        interface = problem.interfaces[name]
        if not problem.speaks_for(name):
            continue
        given = interface.law.fields(interface).parameters
        nothing = np.zeros((interface.num_points, 1))
        bounds = (given.get(key, nothing)[:, 0] for key in ("friction", "threshold"))
        out[name] = _Grip(interface.weights, jump[:, 0], jump[:, 1:], *bounds)
    return problem.gather(out)


def _shares(forces: Array, target: Array) -> Array:
    """Shares >= 0 of columns whose sum is nearest to a target."""
    # not scipy.optimize.nnls: that of version 1.15 misses the minimum in one case of a hundred
    most = 20 * forces.shape[1]
    fitted = optimize.lsq_linear(forces, target, (0.0, np.inf), "bvls", tol=1e-14, max_iter=most)
    return np.asarray(fitted.x)


def _capped(vectors: Array, limits: Array) -> Array:
    """Vectors (m, k) shortened to limits (m,)."""
    size = np.linalg.norm(vectors, axis=1)
    return np.asarray(vectors * np.minimum(1.0, limits / np.where(size > 0.0, size, 1.0))[:, None])


def _carried(grips: Mapping[str, _Grip], forces: Mapping[str, Array]) -> tuple[Array, Array]:
    """Work (q,) of forces (m, components) that were reached, as far as they are admissible: of pressures with
    their friction, and of what is bounded."""
    of_cone, of_discs = [], []
    for name, grip in grips.items():
        pressure = np.maximum(-forces[name][:, 0], 0.0)
        rubs = forces[name][:, 1 : 1 + grip.slip.shape[1]]
        if rubs.shape[1] < grip.slip.shape[1]:
            rubs = np.zeros((len(rubs), grip.slip.shape[1]))
        held_by_pressure = _capped(rubs, grip.friction * pressure)
        rest = _capped(rubs - held_by_pressure, grip.threshold)
        of_cone.append(
            np.einsum("p,pi,piq->q", grip.weights, held_by_pressure, grip.slip)
            - (grip.weights * pressure) @ grip.opening
        )
        of_discs.append(np.einsum("p,pi,piq->q", grip.weights, rest, grip.slip))
    return np.sum(of_cone, axis=0), np.sum(of_discs, axis=0)


def _driven(
    work: Array, grips: Mapping[str, _Grip], least: float, reached: Mapping[str, Array] | None = None
) -> Array | None:
    """The motion (q,) in which the loads push hardest against what the interfaces can bear; None if that
    is less than `least` per unit of motion.

    It is what remains of the loads when the nearest admissible forces are taken away: a cone of pressures
    with their friction and a sum of discs of bounded friction, from which the forces that do most against
    the motion are added one by one (P. Wolfe, Finding the nearest point in a polytope, Math. Programming
    11 (1976) 128-149). What is returned has been verified point by point. Forces that an iteration has
    reached, (m, components), are the first of them: mostly they leave nothing.
    """
    points = [g for g in grips.values() if len(g.weights)]
    scale = float(np.linalg.norm(work))
    if scale <= least or not points:
        return None if scale <= least else np.asarray(work / scale, dtype=np.float64)
    opening = np.concatenate([g.opening for g in points])
    slip = np.concatenate([g.slip for g in points])
    friction = np.concatenate([g.friction for g in points])
    bounds = np.concatenate([g.threshold * g.weights for g in points])
    place = np.cumsum([0, *(len(g.opening) for g in points)])
    sizes = np.sqrt(np.sum(opening**2, axis=1) + np.sum(slip**2, axis=(1, 2)))
    sizes = np.where(sizes > 0.0, sizes, 1.0) * np.hypot(1.0, friction)
    target = np.append(work / scale, _CONVEX)
    rays: Array = np.zeros((len(work) + 1, 0))
    discs: Array = np.zeros((len(work) + 1, 1))
    discs[-1] = _CONVEX
    motion: Array = target[:-1]
    if reached is not None and all(np.all(np.isfinite(reached[name])) for name in grips):
        of_cone, of_discs = _carried(grips, reached)
        size = float(np.linalg.norm(of_cone))
        if size > _CANCELLED * scale:
            rays = np.append(of_cone / size, 0.0)[:, None]
        discs = np.hstack([discs, np.append(of_discs / scale, _CONVEX)[:, None]])
        share = _shares(np.hstack([rays, discs]), target)
        motion = (target - np.hstack([rays, discs]) @ share)[:-1]
        if np.linalg.norm(motion) * scale <= least:
            return None
    for _ in range(_ROUNDS):
        slipped = slip @ motion
        speed = np.linalg.norm(slipped, axis=1)
        push = (friction * speed - opening @ motion) / sizes
        length = float(np.linalg.norm(motion))
        gain = float(motion @ work - bounds @ speed) / length
        if push.max() <= _JAMMED * length and gain >= 0.999 * length * scale:
            if gain > least and reached is not None:  # a good motion, but not the purest one
                return _driven(work, grips, least)
            found = np.asarray(motion / length, dtype=np.float64)
            return found if gain > least else None
        along = slipped / np.where(speed > 0.0, speed, 1.0)[:, None]
        hardest = np.unique(
            np.concatenate(
                [a + np.argsort(push[a:b])[-8:] for a, b in zip(place[:-1], place[1:], strict=True)]
            )
        )
        hardest = hardest[push[hardest] > _JAMMED * length]
        ray = friction[hardest, None] * np.einsum("pi,piq->pq", along[hardest], slip[hardest])
        ray = (ray - opening[hardest]) / sizes[hardest, None]
        rays = np.hstack([rays, np.vstack([ray.T, np.zeros((1, len(ray)))])])
        disc = np.einsum("p,pi,piq->q", bounds, along, slip) / scale
        discs = np.hstack([discs, np.append(disc, _CONVEX)[:, None]])
        forces_now = np.hstack([rays, discs])
        share = _shares(forces_now, target)
        motion = (target - forces_now @ share)[:-1]
        if np.linalg.norm(motion) * scale <= least:
            return None
        if len(share) > 50 + 20 * len(work):
            # entries that carry nothing are dropped; they are found again if they are needed
            used = share > 0.0
            used[rays.shape[1]] = True
            rays, discs = rays[:, used[: rays.shape[1]]], discs[:, used[rays.shape[1] :]]
    return None


def _events(grips: Mapping[str, _Grip], motion: Array) -> list[str]:
    """What the interfaces do in a motion."""
    out = []
    for name, grip in grips.items():
        g, v = grip.opening @ motion, np.linalg.norm(grip.slip @ motion, axis=1)
        size = max(float(np.abs(g).max()), float(v.max()))
        if size < 1e-6:
            continue
        slips = v > 1e-3 * size
        # with friction the motion of the proof opens the contact a little: that is slip, not opening
        opens = g > 1e-3 * size + 1.01 * grip.friction * v
        if opens.all():
            out.append(f"{name!r} opens everywhere")
        elif opens.any():
            share = 100.0 * grip.weights[opens].sum() / grip.weights.sum()
            out.append(f"{name!r} opens on {share:.0f} % of its area")
        elif slips.any():
            rubs = bool(np.any(grip.friction > 0.0) or np.any(grip.threshold > 0.0))
            out.append(f"{name!r} slips" + ("" if rubs else " (no friction holds it)"))
    return out


def _without_climb(grips: Mapping[str, _Grip], motion: Array) -> Array:
    """The motion less the opening of the points that slip, where something is left of it."""
    rows = []
    for grip in grips.values():
        g, v = grip.opening @ motion, np.linalg.norm(grip.slip @ motion, axis=1)
        climb = grip.friction * v
        # a rigid motion that climbs enough where it slips most rises a little more elsewhere
        limit = _CLIMB * climb.max(initial=0.0)
        climbs = (g > 0.0) & (g <= (limit if g.max(initial=0.0) <= limit else 1.01 * climb))
        rows.append(grip.opening[climbs])
    G = np.concatenate(rows) if rows else np.zeros((0, len(motion)))
    if not len(G):
        return motion
    left = motion - np.linalg.pinv(G, rcond=1e-6) @ (G @ motion)
    return left if np.linalg.norm(left) > 0.3 * np.linalg.norm(motion) else motion


def _names(motions: FreeMotions, motion: Array) -> tuple[str, str]:
    """Who moves in a motion (q,) or several (q, k), and how."""
    moving = motions.describe(_rounded(motion, motions)[:, None] if motion.ndim == 1 else motion)
    who = "; ".join(quoted(names) for names, _ in moving[:4])
    how = "; ".join(dict.fromkeys(", ".join(words) for _, words in moving[:4]))
    return who, how


_MEND = (
    "hold it in that direction (scene.fix, scene.symmetry, Perfect or Elastic between parts), or change the "
    "loads"
)


def _why_lost(
    motions: FreeMotions,
    balance: _Balance,
    when: str,
    reached: Mapping[str, Array] | None = None,
) -> str:
    """What nothing can balance the loads of, in words, or nothing."""
    grips = balance.grips
    motion = _driven(balance.work, grips, _CERTAIN * balance.size, reached)
    if motion is None:
        return ""
    shown = _without_climb(grips, motion)
    who, how = _names(motions, shown)
    events = "; ".join(_events(grips, shown)) or "no interface holds it"
    return (
        f"no equilibrium{when}: {who} has lost its support: the loads move it by {how}, and no forces of "
        f"its interfaces balance them: {events}; {_MEND}"
    )


def _check_slip(
    motions: FreeMotions,
    grips: Mapping[str, _Grip],
    work: Array,
    size: float,
    reached: Mapping[str, Array],
    when: str,
    advice: str,
) -> bool:
    """Warn if friction, with the normal forces reached, does not balance the loads."""
    bounded = {}
    for name, grip in grips.items():
        pressure = np.maximum(-reached[name][:, 0], 0.0)
        bounded[name] = grip.with_bounds(grip.friction * pressure + grip.threshold)
    motion = _driven(work, bounded, _DOUBTFUL * size, reached)
    if motion is None:
        return False
    who, how = _names(motions, motion)
    events = "; ".join(_events(bounded, motion)) or "no interface holds it"
    warn(
        f"{who} has lost its support{when}: with the normal forces that the iteration has reached, "
        f"friction does not balance the loads, which move it by {how}: {events}; "
        f"{advice}or {_MEND}",
        SceneWarning,
    )
    return True


def _touching(interface: Interface, jump: Array) -> Flags:
    """(m,): whether the faces touch, with or without force."""
    given = interface.law.fields(interface).parameters
    opening = jump[:, 0] - given["jump"].reshape(len(jump), -1)[:, 0] + given["gap"][:, 0]
    return np.asarray(opening <= _TOUCHING * np.sqrt(interface.area))


def _check_undetermined(
    problem: Problem,
    always: Mapping[str, Resistance],
    reached: Mapping[str, _Reached],
    when: str,
) -> bool:
    """Warn of parts that nothing holds in the answer, or only friction that cannot take more."""

    def left_free(by_contacts: Mapping[str, Resistance]) -> tuple[str, str] | None:
        """Who moves, and how."""
        resistances = {**always, **by_contacts}
        motions = _free(problem, {name: resistances[name] for name in problem.interfaces})
        return _names(motions, np.eye(len(motions))) if len(motions) else None

    found = left_free({name: each.holds for name, each in reached.items()})
    if found is None:
        found = left_free({name: each.sticks for name, each in reached.items()})
        if found is None:
            return False
        who, how = found
        warn(
            f"{who} slips{when} wherever only friction holds it, and friction is used up there: its place in "
            f"the answer is one of many ({how}); hold it, or let some of it stick",
            SceneWarning,
        )
        return True
    who, how = found
    open_ones = [name for name, each in reached.items() if not each.closed]
    where = f": {quoted(open_ones)} is open everywhere" if open_ones else ""
    warn(
        f"{who} has lost its support{when}{where}; no load acts on it, so that its place in the answer is "
        f"one of many ({how}); hold it if that is not meant",
        SceneWarning,
    )
    return True


_Step = tuple[str, float | None, Problem]
"""When it is in words, the time (None: there is no history), and the problem then."""


class Support:
    """What contacts have to hold, step by step; nothing is made before it is asked for.

    Parameters
    ----------
    problem
        With or without contacts.
    times
        Of its history; None: static.
    """

    def __init__(self, problem: Problem, times: Array | None) -> None:
        self.problem = problem
        self.times = times
        self.contacts = [name for name, i in problem.interfaces.items() if i.law.unilateral]
        self.released = [name for name, i in problem.interfaces.items() if i.law.released is not i.law]
        self._why: dict[int, str] = {}

    @cached_property
    def steps(self) -> Sequence[_Step]:
        """The times, and the problem then."""
        return _steps(self.problem, self.times)

    @cached_property
    def checks(self) -> Mapping[int, _Check]:
        """Steps at which parts are free but for contacts -> what balances their loads; collective."""
        return _checks(self.problem, self.contacts, self.steps) if self.contacts or self.released else {}

    def balances(self, step: int) -> bool:
        """Whether admissible forces of the interfaces balance the loads of a step; collective."""
        return not self.why_lost(step)

    def balances_all(self) -> bool:
        """The same of all steps."""
        return all(self.balances(step) for step in self.checks)

    def why_lost(self, step: int, reached: Mapping[str, Array] | None = None) -> str:
        """Why nothing balances the loads of a step, or nothing; collective.

        Forces reached at its interfaces, (m, components), make that quick where they balance them.
        """
        each = self.checks.get(step)
        if each is None:
            return ""
        if step not in self._why:
            work = partial(_why_lost, each.motions, each.balance, self.steps[step][0], reached)
            self._why[step] = _decide(self.problem, work)
        return self._why[step]

    def check(self, reached: Mapping[int, Mapping[str, Array]]) -> None:
        """Raise :class:`BalanceError` of the first step with loads that nothing balances; collective."""
        for step in sorted(self.checks):
            why = self.why_lost(step, reached[step])
            if why:
                failure = BalanceError(f"{why}; {self._until(step)}" if step else why)
                failure.step = step
                raise failure

    def _until(self, lost: int) -> str:
        """Between the step before and that one: when the loads are the last that something balances."""
        known, beyond = (float(time) for _, time, _ in self.steps[lost - 1 : lost + 1] if time is not None)
        last = _KNOWN * (beyond - known)
        while beyond - known > last:
            time = 0.5 * (known + beyond)
            balanced = Support(self.problem, np.array([time])).balances_all()
            known, beyond = (time, beyond) if balanced else (known, time)
        return f"the last loads that they balance are those at t = {known:.4g}"


def check_support(result: Result, support: Support) -> bool:
    """Look for parts that have lost their support; call it once a run has ended, whatever its status.

    Parameters
    ----------
    result
        Of a deterministic solve; of a load history the first step that has something to say is named.
    support
        Of its problem and times.

    Returns
    -------
    bool
        Whether friction, with the normal forces that were reached, does not balance the loads of some step.

    Raises
    ------
    BalanceError
        No admissible forces of the interfaces balance the loads of a step.

    Warns
    -----
    SceneWarning
        Friction does not balance the loads with the normal forces of a run that did not converge; or it
        converged, and a part without loads touches nothing (of a static answer: presses on nothing); or it
        converged or is undecided, and a part slips wherever only friction holds it.
    """
    problem, contacts, steps, checks = support.problem, support.contacts, support.steps, support.checks
    if not checks:
        return False
    if not result.converged:
        _tell_motion(result, checks)
        _tell_corners(result, contacts)
    answers = problem.gather(
        {
            name: _answers(result, problem.interfaces[name], [now for _, _, now in steps])
            for name in contacts
            if name in problem.own.interfaces and problem.speaks_for(name)
        },
    )
    support.check({k: {name: found[k].force for name, found in answers.items()} for k in checks})
    if not all(np.all(np.isfinite(each.force)) for found in answers.values() for each in found):
        return False

    def parts_slip() -> bool:
        for k, each in sorted(checks.items()):
            when, balance = steps[k][0], each.balance
            reached = {name: found[k] for name, found in answers.items()}
            pushed = {name: one.force for name, one in reached.items()}
            advice = stronger(each.law for each in problem.interfaces.values())
            if _check_slip(each.motions, balance.grips, balance.work, balance.size, pushed, when, advice):
                return True
            loads = balance.size > 0.0 or any(np.any(force) for force in pushed.values())
            loaded = loads or bool(support.released)
            if not (loaded and (result.converged or result.status in (UNDECIDED, SLIDES, NO_EQUILIBRIUM))):
                continue
            if _check_undetermined(problem, each.resistances, reached, when):
                return False
        return False

    return _decide(problem, parts_slip)


def _steps(problem: Problem, times: Array | None) -> list[_Step]:
    if times is None:
        return [("", None, problem)]
    numbered = [(k, float(t)) for k, t in enumerate(times)]
    return [(f" at step {k}, t = {t:g}", t, problem.at(t)) for k, t in numbered]


def _checks(problem: Problem, contacts: list[str], steps: Sequence[_Step]) -> dict[int, _Check]:
    """Steps at which parts are free but for contacts -> their motions and what balances the loads."""
    # what is free depends on the preloads that are locked, and on no other time
    alike: dict[frozenset[str], list[int]] = {}
    for k, (_, time, _) in enumerate(steps):
        given = frozenset(n for n, i in problem.interfaces.items() if i.law.controlled(time))
        alike.setdefault(given, []).append(k)
    checks: dict[int, _Check] = {}
    for given, members in alike.items():
        own = {
            name: held(problem, replace(i, law=i.law.released if name in given else i.law.locked))
            for name, i in problem.own.interfaces.items()
            if name not in contacts and problem.speaks_for(name)
        }
        resistances = problem.gather(own)
        motions = _decide(problem, partial(_free, problem, resistances))
        if not len(motions):
            continue
        jumps = _relative(problem, contacts, motions)
        for k in members:
            _, time, now = steps[k]
            balance = _Balance(_grips(now, jumps), *_loads(now, motions, time))
            checks[k] = _Check(motions, resistances, balance)
    return checks


def acts(problem: Problem, interfaces: Collection[str], loads: Collection[object] = ()) -> bool:
    """Whether laws of some interfaces, or given loads, push on the parts: the rest holds or follows."""
    laws = [problem.interfaces[name].law.nominal for name in interfaces if name in problem.interfaces]
    load_laws = any(type(law).load is not Law.load for law in laws)
    return load_laws or bool(loads) or any(name in problem.loads for name in interfaces)


def named_without_equilibrium(
    what: str,
    answer: PointResults,
    parameters: Sequence[SweptParameter],
    at: Callable[[int], Problem],
    acting: bool,
    known: bool = True,
) -> SweepPoints:
    """The points of an answer; those have the status ``"no_equilibrium"`` at which no admissible forces of
    interfaces balance the loads, or prescribed displacements contradict each other, or ``"undetermined"`` at
    which parts are free and not loaded; collective.

    An iteration that is asked for little may call such a point converged: what slides away has not gone far.

    Parameters
    ----------
    what
        A point in a message.
    parameters
        What differs from point to point, as the kernel has it.
    at
        The problem at a point.
    acting
        Whether what pushes on the parts differs from point to point.
    known
        Whether the forces were kept.
    """
    points = answer.points
    lost = _contradicting(answer, parameters, at)
    if known:
        lost |= _unbalanced(answer, at if acting else None)
    status = np.array(points.status, dtype="<U16")
    lines = Lines(_log, answer.problem.rank)
    for k, why in sorted({**lost, **_free_points(parameters, at)}.items()):
        if answer.reached[k]:
            status[k] = NO_EQUILIBRIUM if k in lost else _of_free(at(k), answer.plan.times)
            lines.add(f"{what}s that nothing balances or holds", f"{what} {k}: {why}")
    lines.rest()
    return replace(points, status=status)


def _free_points(parameters: Sequence[SweptParameter], at: Callable[[int], Problem]) -> dict[int, str]:
    """Points at which parameters of laws are 0, so that parts can move freely -> why; collective."""
    zeros = [_is_zero(each.pattern, each.values) for each in parameters if each.interface]
    if not any(each.any() for each in zeros):
        return {}
    found: dict[int, str] = {}
    rows = np.array(zeros).T
    for row in np.unique(rows[rows.any(axis=1)], axis=0):
        which = [int(point) for point in np.flatnonzero((rows == row).all(axis=1))]
        now = at(which[0])
        if now.loosened:
            try:
                check_held(now)
            except SceneError as failure:
                found |= dict.fromkeys(which, str(failure))
    return found


def _contradicting(
    answer: PointResults, parameters: Sequence[SweptParameter], at: Callable[[int], Problem]
) -> dict[int, str]:
    """Points at which displacements or jumps that differ from point to point contradict others -> why;
    collective."""
    interfaces, plan = answer.problem.interfaces, answer.plan
    jumps = [p for p in parameters if p.interface in interfaces and p.parameter == "jump"]
    given = [p for p in jumps if interfaces[p.interface].law.prescribes == "jump"]
    numbers = [each.values for each in given if len(each.values) == 1]
    if not numbers:
        return {}
    fields = {p.interface: interfaces[p.interface].law for p in given if len(p.values) > 1}
    rows, which = np.unique(np.concatenate(numbers).T, axis=0, return_inverse=True)

    def why(row: int) -> str:
        now = at(int(np.argmax(which.ravel() == row))).with_laws(fields)
        try:
            check_prescribed(now, plan.eliminated, moments_of(now, plan.times))
        except SceneError as failure:
            return str(failure)
        return ""

    if not any([why(row) for row in spanning(rows.T)]):
        return {}
    found = {row: text for row in range(len(rows)) if (text := why(row))}
    return {k: found[row] for k, row in enumerate(which.ravel().tolist()) if row in found}


def _of_free(problem: Problem, times: Array | None) -> str:
    """Status of an answer whose laws leave parts free, by whether loads drive their motions."""
    own = {name: held(problem, i) for name, i in problem.own.interfaces.items() if problem.speaks_for(name)}
    motions = _decide(problem, partial(_free, problem, problem.gather(own)))
    loads = [_loads(now, motions, time) for _, time, now in _steps(problem, times)]
    driven = any(np.linalg.norm(work) > _CERTAIN * size for work, size in loads)
    return NO_EQUILIBRIUM if driven else UNDETERMINED


def _is_zero(pattern: Array, values: Array) -> Flags:
    """(N,): whether a parameter pattern (rows, k) @ values (k, N) is 0 at all points of its interface."""
    zero: Flags = ~np.any(pattern[:1] @ values, axis=0)
    zero[zero] = ~np.any(pattern @ values[:, zero], axis=0)
    return zero


def _unbalanced(answer: PointResults, at: Callable[[int], Problem] | None) -> dict[int, str]:
    """Points that were reached at which no admissible forces of the interfaces balance the loads -> why;
    collective.

    Parameters
    ----------
    at
        The problem at a point, where what acts differs from point to point; None: it does not.
    """
    problem, times = answer.problem, answer.plan.times
    contacts = [name for name, i in problem.interfaces.items() if i.law.unilateral]
    asked = [int(k) for k in np.flatnonzero(answer.reached)]
    checks = _checks(problem, contacts, _steps(problem, times)) if contacts and asked else {}
    if not checks:
        return {}
    count = len(answer.points.status)
    own_forces, own_limits = {}, {}
    for name in contacts:
        if name in problem.own.interfaces and problem.speaks_for(name):
            force = answer.force(name)
            own_forces[name] = force.reshape(count, -1, *force.shape[-2:])
            contact = answer.contact_at(name)
            nothing = np.zeros((1, 1, force.shape[-2]))
            limits = None if contact is None else contact.limits
            own_limits[name] = (nothing, nothing) if limits is None else limits
    forces, bounds = problem.gather(own_forces), problem.gather(own_limits)
    loads: dict[int, dict[int, tuple[Array, float]]] = {}
    if at is not None:
        for point in asked:
            now = _steps(at(point), times)
            loads[point] = {k: _loads(now[k][2], each.motions, now[k][1]) for k, each in checks.items()}

    def check(point: int) -> str:
        for k, each in sorted(checks.items()):
            grips = {}
            for name, grip in each.balance.grips.items():
                friction, threshold = (
                    of[min(point, len(of) - 1), min(k, of.shape[1] - 1)] for of in bounds[name]
                )
                grips[name] = replace(grip, friction=friction, threshold=threshold)
            work, size = loads[point][k] if loads else (each.balance.work, each.balance.size)
            when = "" if times is None else f" at t = {times[k]:g}"
            reached = {name: of[point, k] for name, of in forces.items()}
            why = _why_lost(each.motions, _Balance(grips, work, size), when, reached)
            if why:
                return why
        return ""

    return _decide(problem, lambda: {k: why for k in asked if (why := check(k))})


def _tell_motion(result: Result, checks: Mapping[int, _Check]) -> None:
    """Log the rigid motion in which the last iterate of a run without an answer floats, if it does."""
    if result.problem.distribution is not None:
        return  # a fit to the displacements of all parts
    step, each = max(checks.items())
    motions, parts = each.motions, result.problem.substructures
    members = [name for names in motions.groups for name in names]
    fields = {name: result.unknowns(name) for name in members}
    moved = {n: (u if result.times is None else u[step]).reshape(-1, parts[n].dim) for n, u in fields.items()}
    size = max(float(np.abs(u).max()) for u in moved.values())
    if not (np.isfinite(size) and size > 0.0):
        return
    at = {name: motions.at(name, parts[name].dof_coordinates).reshape(-1, len(motions)) for name in members}
    stacked = np.concatenate(list(at.values()))
    field = np.concatenate([moved[name].ravel() for name in members]) / size
    motion = np.linalg.lstsq(stacked, field, rcond=None)[0]
    floating = float(np.abs(stacked @ motion).max())
    left = float(np.abs(field - stacked @ motion).max())
    if floating < _FLOATS * left:
        return
    who, how = _names(motions, motion)
    when = "" if result.times is None else f" at step {step}"
    _log.warning(
        "the last iterate has moved %s by %s, as far as %.2g%s, and strains it by %.2g: only contact and "
        "friction hold it; %s",
        who,
        how,
        floating * size,
        when,
        left * size,
        _MEND,
    )


def _tell_corners(result: Result, contacts: Sequence[str]) -> None:
    """Log that parts that only contact holds rest on a few corners of straight facets: they may roll."""
    if result.problem.distribution is not None:
        return
    for name in contacts:
        i = result.problem.interfaces[name]
        closed = result.force(name).reshape(-1, i.num_points, i.law.count(i.dim))[-1, :, 0] < 0.0
        count = int(closed.sum())
        if 0 < count <= i.dim and np.any(i.chords[closed]):
            _log.warning(
                "interface %r: at the end %d of %d points touch, corners of straight facets that stand for "
                "round faces: on so few a part can roll, which the round faces do not let it; %s",
                name,
                count,
                i.num_points,
                CURVED,
            )


def _rounded(motion: Array, motions: FreeMotions) -> Array:
    """The motion without the rotations that move less than a percent of what its translations do."""
    groups, r, _ = motions.basis.shape
    d = 2 if r == 3 else 3
    parted = (motions.basis @ motion).reshape(groups, r)
    turned = np.abs(parted[:, d:]).max(initial=0.0)
    if turned >= _TURNS * np.abs(parted[:, :d]).max(initial=0.0):
        return motion
    rotations = motions.basis[:, d:].reshape(-1, len(motions))
    straight = motion - np.linalg.pinv(rotations, rcond=1e-6) @ (rotations @ motion)
    return straight if np.linalg.norm(straight) > 0.9 * np.linalg.norm(motion) else motion


def _answers(result: Result, interface: Interface, steps: list[Problem]) -> list[_Reached]:
    """What an interface has reached at every step."""
    force, jump = (
        each.reshape(len(steps), interface.num_points, -1)
        for each in (result.force(interface.name), result.jump(interface.name))
    )
    found = []
    contact = law_contact(result.problem, result.plan, interface.name)
    limits = None if contact is None else contact.limits
    for k, now in enumerate(steps):
        closed = force[k, :, 0] < 0.0
        if result.plan.times is not None:  # a part that is loaded later may lie there unloaded at first
            closed |= _touching(now.interfaces[interface.name], jump[k])
        holds = sticks = held(result.problem, now.interfaces[interface.name], closed | (not result.converged))
        if limits is not None:
            at = tuple(each[0, min(k, each.shape[1] - 1)] for each in limits)
            shear = np.linalg.norm(force[k, :, 1:], axis=1)
            slips = contact_states(force[k, :, 0], shear, (at[0], at[1]))[1]
            # a point that slips resists what would turn its slip
            along = force[k, :, 1:] / np.maximum(shear, np.finfo(float).tiny)[:, None]
            rows = interface.law.nominal.held_rows(interface).shape[1]
            holding = np.tile(np.eye(rows), (len(closed), 1, 1)) * closed[:, None, None]
            holding[slips, 1:, 1:] -= np.einsum("pi,pj->pij", along[slips], along[slips])
            sticks = held(result.problem, interface, holding)
        found.append(_Reached(force[k], holds, sticks, bool(closed.any())))
    return found
