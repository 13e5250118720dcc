"""Numbers of bolts and of the joints that they clamp, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import Answer, Block, Surface, chunks, stepped
from dolfinx_frontend.results.contact import contact_states
from dolfinx_frontend.results.saved import ResultFileError
from dolfinx_frontend.sheets.clamping import Bolt

__all__ = ["Numbers", "margins_in", "numbers_of", "steps_of"]

NOTHING = 1e-6
"""A shear or clamping force below this share of the largest is none."""
ROUND = 0.15
"""What the second moments of a section may differ from those of a circle: cells have straight edges."""
AT_LIMIT = 1e-3
"""All friction of a point but this share is used up: it slips. A joint slides where one point sticks at most,
around which it may turn."""
LITTLE = 0.01
"""An axial load below this share of the bolt force has no load factor."""


@dataclass(frozen=True)
class Numbers:
    """Numbers of bolts.

    Attributes
    ----------
    values
        Bolt -> key of :data:`dolfinx_frontend.sheets.names.BOLT` -> (N,); what cannot be given is not there.
    forces
        Bolt -> (N, T), bolt force over the steps.
    joint
        Bolt -> the joint that decides on its margins.
    why
        What cannot be given -> why, for all bolts that it is true of.
    """

    values: dict[str, dict[str, Array]]
    forces: dict[str, Array]
    joint: dict[str, str]
    why: dict[str, list[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Joint:
    """Of the points of a joint that belong to a bolt, (N, T) each."""

    clamping: Array
    shear: Array
    friction: Array
    slides: Flags
    open: Array


def steps_of(answer: Answer, bolts: Sequence[Bolt]) -> tuple[int, dict[str, int]] | None:
    """The step at which the last bolt is tightened, and that of each; None: there is no history."""
    if answer.times is None:
        return None
    own = {b.name: step for b in bolts if (step := answer.surface(b.interface).bolt) is not None}
    return max(own.values(), default=0), own


def numbers_of(
    answer: Answer,
    bolts: Sequence[Bolt],
    friction: Mapping[str, float],
    areas: Mapping[str, float],
    samples: int | None,
    seed: int,
) -> Numbers:
    """Numbers of the bolts of an answer.

    Parameters
    ----------
    friction
        Joint -> coefficient, where its law has none.
    areas
        Bolt -> stress area, where it is not that of the section as modelled.
    """
    found = Numbers({}, {}, {})
    steps = steps_of(answer, bolts)
    try:
        joints = _joints(answer, bolts, friction, samples, seed)
    except ResultFileError as error:
        joints = {}
        found.why[f"joints: {error}"] = [b.name for b in bolts]
    for bolt in bolts:
        try:
            read = answer.readings(bolt.interface, samples, seed)  # type: ignore[attr-defined]
        except SceneError as error:
            found.why.setdefault(f"bolt force: {error}", []).append(bolt.name)
            continue
        normal = read.interfaces[bolt.interface].values["normal"]
        force: Array = np.atleast_1d(normal) if answer.statistics != "value" else np.asarray(normal)[None]
        force = force if answer.times is not None else force[:, None]
        found.forces[bolt.name] = force
        area = areas.get(bolt.name, bolt.area)
        own = _of_force(force, steps, bolt.name, area)
        if "sigma_a" in own:
            surface = answer.surface(bolt.interface)
            if _is_round(surface, bolt.axis):
                moments = read.interfaces[bolt.interface].values
                own["sigma_ab"] = _bending(moments, bolt.axis, force.shape, steps, area)
            else:
                why = (
                    "σ_ab: the moment of a bolt is known where its section is modelled as a full circle; σ_a "
                    "has no bending"
                )
                found.why.setdefault(why, []).append(bolt.name)
        _of_joint(own, found, bolt, joints.get(bolt.name, {}), force, steps)
        found.values[bolt.name] = own
    return found


def _of_force(
    force: Array, steps: tuple[int, dict[str, int]] | None, name: str, area: float
) -> dict[str, Array]:
    """Numbers (N,) of a bolt alone, from its force (N, T)."""
    found: dict[str, Array] = {"F_S": force[:, -1]}
    if steps is None:
        return found
    last, own = steps
    if name in own:
        found["F_M"] = force[:, own[name]]
    found["F_V"] = force[:, last]
    if name in own and own[name] < last and np.all(found["F_M"] != 0.0):
        found["kept"] = found["F_V"] / found["F_M"]
    after = force[:, last:]
    if after.shape[1] > 1:
        found["F_S min"], found["F_S max"] = after.min(axis=1), after.max(axis=1)
        change = after - after[:, :1]
        found["F_SA"] = _at(change, np.abs(change).argmax(axis=1))
        if np.isfinite(area):
            found["sigma_a"] = np.asarray((found["F_S max"] - found["F_S min"]) / (2.0 * area))
    return found


def _is_round(surface: Surface, axis: Array) -> bool:
    """Whether a section has the second moments of a circle of its area: no half, no ring, and no beam."""
    if surface.wrench is not None or surface.dim != 3 or len(surface.points) < 3:
        return False
    away = surface.points - surface.centre
    away = away - np.outer(away @ axis, axis)
    moments = np.linalg.eigvalsh(away.T @ (surface.weights[:, None] * away))[1:]
    circle = surface.area**2 / (4.0 * np.pi)
    return bool(np.all(np.abs(moments / circle - 1.0) < ROUND))


def _bending(
    values: Mapping[str, Array],
    axis: Array,
    shape: tuple[int, ...],
    steps: tuple[int, dict[str, int]] | None,
    area: float,
) -> Array:
    """Stress amplitude (N,) of the bending moment about the centroid of a section, of a round bar."""
    moment = np.stack([np.reshape(values[f"moment_{a}"], shape) for a in "xyz"], axis=-1)
    moment = moment - (moment @ axis)[..., None] * axis
    after = moment[:, (0 if steps is None else steps[0]) :]
    # the largest distance of two steps: the stress of one fibre goes from one end to the other
    apart = np.zeros(len(after))
    for k in range(after.shape[1]):
        away = np.linalg.norm(after[:, k + 1 :] - after[:, [k]], axis=2)
        apart = np.maximum(apart, away.max(axis=1, initial=0.0))
    modulus = area**1.5 / (4.0 * np.sqrt(np.pi))  # pi d^3 / 32 with area = pi d^2 / 4
    return np.asarray(0.5 * apart / modulus)


def _of_joint(
    own: dict[str, Array],
    found: Numbers,
    bolt: Bolt,
    joints: Mapping[str, _Joint],
    force: Array,
    steps: tuple[int, dict[str, int]] | None,
) -> None:
    """Add the numbers of the joint that decides."""
    if not joints:
        if bolt.why:
            found.why.setdefault(bolt.why, []).append(bolt.name)
        return
    last = None if steps is None else steps[0]
    margins = {name: _margins(each, last) for name, each in joints.items()}
    least = {name: min(float(np.mean(v)) for v in m.values()) for name, m in margins.items() if m}
    lowest = {name: float(np.mean(each.clamping.min(axis=1))) for name, each in joints.items()}
    decides = min(least, key=lambda n: least[n]) if least else min(lowest, key=lambda n: lowest[n])
    found.joint[bolt.name] = decides
    for key in ("m_K", "m_G"):
        every = [m[key] for m in margins.values() if key in m]
        if every:
            own[key] = np.min(every, axis=0)
    if {"m_K", "m_G"} & set(own):
        own["margin"] = np.min([own[k] for k in ("m_K", "m_G") if k in own], axis=0)
    each = joints[decides]
    since = slice(0 if last is None else last, None)
    own["F_KR"], own["F_Q"] = each.clamping[:, since].min(axis=1), each.shear[:, since].max(axis=1)
    if np.isfinite(each.friction).all():
        with np.errstate(divide="ignore", invalid="ignore"):
            safety = np.where(each.shear > 0.0, each.friction / each.shear, np.inf)[:, since]
        safety = np.where(_slides(each, last), np.minimum(safety, 1.0), safety)
        own["S_G"] = safety.min(axis=1)
    if np.isfinite(each.open).all():
        own["open"] = each.open[:, since].max(axis=1)
    if last is None:
        return
    own["F_KV"] = each.clamping[:, last]
    after = force[:, last:]
    if after.shape[1] < 2:
        return
    # parallel ways of the load: of several joints the one that is unloaded most is where it comes in
    loads = [
        (after - after[:, :1]) + (j.clamping[:, last, None] - j.clamping[:, since]) for j in joints.values()
    ]
    load = max(loads, key=lambda each: float(np.abs(each).max()))
    at = np.abs(load).argmax(axis=1)
    own["F_A"] = _at(load, at)
    gains = _at(after - after[:, :1], at)
    why = ""
    if np.any(np.abs(own["F_A"]) <= LITTLE * np.abs(after).max()):
        why = "Φ: no axial load of 1 % of the bolt force acts on bolt and joint after tightening"
    elif np.any(np.abs(gains) > (1.0 + LITTLE) * np.abs(own["F_A"])):
        why = "Φ: the bolt force changes by more than the axial load: by heat or bending, not by a load"
    if why:
        found.why.setdefault(why, []).append(bolt.name)
    else:
        own["Phi"] = gains / own["F_A"]


def _at(values: Array, step: Ints) -> Array:
    """(N,) of values (N, T) at a step (N,) of each sample."""
    return np.asarray(np.take_along_axis(values, step[:, None], axis=1)[:, 0])


def _margins(joint: _Joint, last: int | None) -> dict[str, Array]:
    """Margins (N,) of a joint against opening and slip."""
    found = {}
    if last is not None:
        whole, rest = joint.clamping[:, last], joint.clamping[:, last:].min(axis=1)
        size = NOTHING * np.abs(joint.clamping).max(initial=1e-300)
        found["m_K"] = np.where(whole > size, rest / np.where(whole > size, whole, 1.0), 0.0)
    if np.isfinite(joint.friction).all() and (joint.shear.any() or joint.slides.any()):
        since = slice(0 if last is None else last, None)
        friction, shear = joint.friction[:, since], joint.shear[:, since]
        whole = friction[:, :1] if last is not None else friction
        whole = np.where(whole > 0.0, whole, np.maximum(friction, shear))
        left = (friction - shear) / np.where(whole > 0.0, whole, 1.0)
        left = np.where(_slides(joint, last), np.minimum(left, 0.0), left)
        found["m_G"] = left.min(axis=1)
    return found


def _slides(joint: _Joint, last: int | None) -> Flags:
    """Whether all points are at their limit (N, steps since all is tightened).

    Forces of a joint that turns cancel as vectors. What tightening alone brings to its limit, by widening, is
    no slip.
    """
    return joint.slides if last is None else joint.slides[:, last:] & ~joint.slides[:, last, None]


def _joints(
    answer: Answer, bolts: Sequence[Bolt], friction: Mapping[str, float], samples: int | None, seed: int
) -> dict[str, dict[str, _Joint]]:
    """Bolt -> joint -> what is known of it at all samples."""
    found: dict[str, dict[str, list[_Joint]]] = {b.name: {j: [] for j in b.joints} for b in bolts}
    if not any(found.values()):
        return {}
    for block in answer.blocks(samples, seed):
        for bolt, joint, part in _read(answer, block, bolts, friction):
            found[bolt][joint].append(part)
    return {
        bolt: {
            joint: _Joint(*(np.concatenate([getattr(p, n) for p in parts]) for n in _Joint.__annotations__))
            for joint, parts in each.items()
        }
        for bolt, each in found.items()
    }


def _read(
    answer: Answer, block: Block, bolts: Sequence[Bolt], friction: Mapping[str, float]
) -> Iterator[tuple[str, str, _Joint]]:
    """Bolt, joint and what is known of it at some of the samples of a block."""
    for joint in dict.fromkeys(j for bolt in bolts for j in bolt.joints):
        surface = answer.surface(joint)
        force, contact = stepped(block.force(joint), answer.times, 1), block.contact(joint)
        for part in chunks(len(force), force[0].size):
            limits = None if contact is None else contact[part].limits
            vectors = surface.vectors(force[part])  # (n, T, m, d)
            normal = np.einsum("ntpd,pd->ntp", vectors, surface.normals)
            shear = vectors - normal[..., None] * surface.normals
            bears = np.maximum(-normal, 0.0)
            size = np.linalg.norm(shear, axis=-1)
            mu = friction.get(joint)
            if mu is not None:
                holds = mu * bears
            elif limits is not None:
                holds = np.broadcast_to(limits[0] * bears + limits[1] * (bears > 0.0), bears.shape)
            else:
                holds = np.full(bears.shape, np.nan)
            if surface.contact:
                is_open = contact_states(normal, size, None)[0].astype(float)
            else:
                is_open = np.full(bears.shape, np.nan)
            for bolt in bolts:
                if joint not in bolt.joints:
                    continue
                weights = surface.weights * bolt.joints[joint]
                clamping = -normal @ weights
                total = np.linalg.norm(np.einsum("ntpd,p->ntd", shear, weights), axis=-1)
                total[total <= NOTHING * np.abs(clamping).max()] = 0.0  # rounding
                whole = holds @ weights
                slides = np.zeros(whole.shape, dtype=bool)
                if mu is None and limits is not None:  # of another law the shear knows no limit
                    sticks = (weights > 0.0) & (size < (1.0 - AT_LIMIT) * holds)
                    slides = (whole > 0.0) & (sticks.sum(axis=-1) < 2)
                yield bolt.name, joint, _Joint(
                    clamping,
                    total,
                    whole,
                    slides,
                    is_open @ weights / weights.sum(),
                )


def margins_in(
    answer: Answer, block: Block, bolts: Sequence[Bolt], friction: Mapping[str, float]
) -> Array:
    """The least margin (n,) of all bolts in the samples of a block."""
    steps = steps_of(answer, bolts)
    last = None if steps is None else steps[0]
    by_joint: dict[tuple[str, str], list[_Joint]] = {}
    for bolt, joint, part in _read(answer, block, bolts, friction):
        by_joint.setdefault((bolt, joint), []).append(part)
    found = []
    for parts in by_joint.values():
        each = [_margins(part, last) for part in parts]
        least = [np.min(list(m.values()), axis=0) for m in each if m]
        if len(least) == len(each):
            found.append(np.concatenate(least))
    return np.asarray(np.min(found, axis=0))
