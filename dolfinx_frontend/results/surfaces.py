"""What acts at the points of an interface, in global axes: the numbers behind tables and ParaView files.

Signs: the pressure is -f_n, positive where the sides press on each other; shear is the tangential force per
area on side 1; opening and slip are the normal and the tangential part of the jump w2 - w1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.plan.random_laws import RandomLaws, sampled_parameters
from dolfinx_frontend.scene.laws import Contact, Law

if TYPE_CHECKING:
    from dolfinx_frontend.io.saved import SavedResult
    from dolfinx_frontend.results.result import Result
    from dolfinx_frontend.solvers.chaos import ChaosResult
    from dolfinx_frontend.solvers.sampling import SampleResult

__all__ = [
    "CLOSED",
    "OPEN",
    "SLIPS",
    "ContactValues",
    "Moments",
    "chunks",
    "contact_states",
    "contact_values",
    "law_frames",
    "of_chaos",
    "of_result",
    "of_samples",
    "of_saved",
    "point_fields",
    "sampled_contact_values",
    "vectors",
]


OPEN, CLOSED, SLIPS = 0.0, 1.0, 2.0
"""States of a contact; closed with friction is stick."""
NOTHING = 1e-9
"""A pressure below this share of the largest is none: the point is open."""
AT_LIMIT = 1e-6
"""A friction force within this share of its limit slips."""
BYTES = 1e8
"""Fields of a random answer that are evaluated at once."""
ALONG = 1e-12
"""A row of a frame within this of the normal is the normal."""


@dataclass(frozen=True)
class ContactValues:
    """Values of a contact law, each broadcast to (..., m).

    Attributes
    ----------
    clearance
        g0 - Delta_n, length: the gap is the opening plus this.
    friction, threshold
        Coefficient, and force / area; None: no friction.
    """

    clearance: Array
    friction: Array | None = None
    threshold: Array | None = None

    @property
    def limits(self) -> tuple[Array, Array] | None:
        """Friction coefficient and threshold; None: no friction."""
        if self.friction is None or self.threshold is None:
            return None
        return self.friction, self.threshold


def law_frames(interface: Interface) -> Array:
    """(m, components, d): the directions of an interface's force and jump components, global axes."""
    rows = bridge.law_fields(interface, interface.law.nominal).frames
    frames: Array = rows.reshape(interface.num_points, -1, interface.dim)
    return frames


def vectors(frames: Array, values: Array) -> Array:
    """Values (..., m, components) in frames (m, components, d) as vectors (..., m, d) in global axes."""
    out: Array = np.einsum("...pc,pcd->...pd", values, frames)
    return out


def contact_states(
    normal: Array, shear: Array, limits: tuple[Array, Array] | None
) -> tuple[Flags, Flags]:
    """Where a contact is open, and where it slips (nowhere without friction).

    Parameters
    ----------
    normal, shear
        (..., m): f_n and the size of f_t, force / area.
    limits
        Friction coefficient and threshold, each broadcast to (..., m); None: no friction.
    """
    largest = np.abs(normal).max(axis=-1, keepdims=True)
    is_open: Flags = normal >= -NOTHING * largest
    if limits is None:
        return is_open, np.zeros_like(is_open)
    friction, threshold = limits
    limit = friction * np.abs(normal) + threshold
    return is_open, ~is_open & (shear >= (1.0 - AT_LIMIT) * limit)


def _contact(interface: Interface, law: Law, time: float | None) -> ContactValues:
    parameters = bridge.law_fields(interface, law, time).parameters
    m = interface.num_points
    clearance = parameters["gap"][:, 0] - parameters["jump"].reshape(m, -1)[:, 0]
    if "friction" not in parameters:
        return ContactValues(clearance)
    return ContactValues(clearance, parameters["friction"][:, 0], parameters["threshold"][:, 0])


def contact_values(interface: Interface, times: Array | None) -> ContactValues | None:
    """Values of a contact at all times, (T, m) each, T = 1 without a history; None: it is no contact."""
    law = interface.law
    if not isinstance(law, Contact):
        return None
    if times is None:
        each = [_contact(interface, law, None)]
    else:
        each = [_contact(interface, law.at(t), float(t)) for t in times]
    clearance = np.array([one.clearance for one in each])
    limits = [one.limits for one in each]
    known = [pair for pair in limits if pair is not None]
    if len(known) < len(limits):
        return ContactValues(clearance)
    return ContactValues(clearance, np.array([f for f, _ in known]), np.array([t for _, t in known]))


def sampled_contact_values(
    random: RandomLaws, plan: Plan, name: str, germs: Array
) -> ContactValues | None:
    """Values of a contact at points of the germs: what broadcasts to (N, T, m); None: it is no contact."""
    interface = random.problem.interfaces[name]
    if not isinstance(interface.law, Contact):
        return None
    found = sampled_parameters(
        random, name, germs, bridge.active_fields(interface, plan), plan.steps
    )

    def shaped(block: Array) -> Array:
        first = block.reshape(interface.num_points, -1, block.shape[1])[:, 0]
        if first.shape[1] == 1:
            return first.T[None]
        return np.moveaxis(first.reshape(len(first), len(germs), -1), 0, -1)

    clearance = shaped(found["gap"]) - shaped(found["jump"])
    if "friction" not in found:
        return ContactValues(clearance)
    return ContactValues(clearance, shaped(found["friction"]), shaped(found["threshold"]))


# --- fields ----------------------------------------------------------------------------------------
def point_fields(
    normals: Array, frames: Array, force: Array, jump: Array, contact: ContactValues | None
) -> dict[str, Array]:
    """Fields at the points by name, what a law does not have left out.

    ``pressure``, ``opening``, ``gap`` (contacts), ``state`` (contacts: 0 open, 1 closed or stick, 2 slip):
    (..., m); ``shear``, ``slip``: (..., m, d), global axes.

    Parameters
    ----------
    normals, frames
        (m, d) out of side 1; (m, components, d) directions of the components.
    force, jump
        (..., m, components).
    """

    def split(values: Array) -> tuple[Array, Array]:
        vector = vectors(frames, values)
        normal = np.einsum("...pd,pd->...p", vector, normals)
        return normal, vector - normal[..., None] * normals

    normal, shear = split(force)
    fields = {"pressure": -normal, "shear": shear}
    count, d = frames.shape[1:]
    # of a jump, what has no component is not known
    if count == d or (count == 1 and np.abs(frames[:, 0] - normals).max(initial=0.0) < ALONG):
        opening, slip = split(jump)
        fields["opening"] = opening
        if contact is not None:
            fields["gap"] = opening + contact.clearance
        if count == d:
            fields["slip"] = slip
    if contact is not None:
        is_open, slips = contact_states(normal, np.linalg.norm(shear, axis=-1), contact.limits)
        fields["state"] = np.where(is_open, OPEN, np.where(slips, SLIPS, CLOSED))
    return fields


def _steps(values: Array, times: Array | None, leading: int = 0) -> Array:
    """Fields with an axis of time steps after so many others, with or without a history."""
    return values if times is not None else np.expand_dims(values, leading)


def of_result(result: Result, name: str) -> dict[str, Array]:
    """Fields of an interface of a deterministic answer, (T, m) or (T, m, d); T = 1 without a history."""
    interface, times = result.problem.interfaces[name], result.plan.times
    force, jump = (_steps(values, times) for values in (result.force(name), result.jump(name)))
    contact = contact_values(interface, times)
    return point_fields(interface.normals, law_frames(interface), force, jump, contact)


class Moments:
    """Mean and standard deviation of samples that come some at a time, about the first of them."""

    def __init__(self) -> None:
        self._origin: dict[str, Array] = {}
        self._sums: dict[str, tuple[Array, Array]] = {}
        self._total = 0.0
        self._lost = 0.0

    def add(self, fields: Mapping[str, Array], weights: Array | None) -> None:
        """Fields (n, ...) by name, with weights (n,); None: of a random sample, with an unbiased variance."""
        if weights is None:
            weights = np.ones(len(next(iter(fields.values()))))
            self._lost = 1.0
        self._total += float(weights.sum())
        for name, values in fields.items():
            origin = self._origin.setdefault(name, values[0].copy())
            away = values - origin
            first, second = (np.tensordot(weights, power, 1) for power in (away, away**2))
            before = self._sums.get(name, (0.0, 0.0))
            self._sums[name] = (before[0] + first, before[1] + second)

    def found(self) -> dict[str, tuple[Array, Array]]:
        """Name -> mean and standard deviation, (...) each."""
        out = {}
        free = max(self._total - self._lost, 0.5 * self._total)  # of one sample the deviation is 0
        for name, (first, second) in self._sums.items():
            mean = first / self._total
            variance = (second - self._total * mean**2) / free
            out[name] = (self._origin[name] + mean, np.sqrt(np.maximum(variance, 0.0)))
        return out


def _of_modes(fields: dict[str, Array]) -> dict[str, Array]:
    """Mean and deviation of linear fields (P + 1, ...) of the chaos modes."""
    out = {}
    for name, modes in fields.items():
        out[name] = modes[0]
        out[f"{name} std"] = np.sqrt(np.sum(modes[1:] ** 2, axis=0))
    return out


def chunks(count: int, numbers: int) -> Iterable[slice]:
    """Slices of `count` samples of so many numbers each, whose fields fit into memory."""
    chunk = max(1, int(BYTES / (32.0 * max(numbers, 1))))
    return (slice(k, min(k + chunk, count)) for k in range(0, count, chunk))


def _of_sampled(
    normals: Array,
    frames: Array,
    times: Array | None,
    count: int,
    weights: Array | None,
    at: Callable[[slice], tuple[Array, Array, ContactValues | None]],
) -> dict[str, Array]:
    """Mean and standard deviation over `count` samples (see :class:`Moments`), of states the probabilities.

    `at` gives force and jump (n, [T,] m, components) of a part of the samples, and the values of a contact.
    """
    moments = Moments()
    for part in chunks(count, frames.size * (1 if times is None else len(times))):
        force, jump, contact = at(part)
        fields = point_fields(normals, frames, _steps(force, times, 1), _steps(jump, times, 1), contact)
        state = fields.pop("state", None)
        if state is not None:
            fields["open probability"] = (state == OPEN).astype(np.float64)
            fields["slip probability"] = (state == SLIPS).astype(np.float64)
        moments.add(fields, None if weights is None else weights[part])
    out = {}
    for name, (mean, deviation) in moments.found().items():
        out[name] = mean
        if not name.endswith("probability"):
            out[f"{name} std"] = deviation
    return out


def of_chaos(result: ChaosResult, name: str) -> dict[str, Array]:
    """Mean and standard deviation of the fields of an active interface.

    From the coefficients; where the law is not linear, from the samples of :meth:`ChaosResult.force_moments`,
    at each of which it is evaluated anew.
    """
    interface, times = result.problem.interfaces[name], result.plan.times
    frames = law_frames(interface)
    if name not in result.collocations:
        blocks = (result.force_coefficients(name), result.jump_coefficients(name))
        force, jump = (np.moveaxis(_steps(block, times), -1, 0) for block in blocks)
        return _of_modes(point_fields(interface.normals, frames, force, jump, None))
    germs = result.moment_germs()

    def at(part: slice) -> tuple[Array, Array, ContactValues | None]:
        contact = sampled_contact_values(result.random, result.plan, name, germs[part])
        return *result.at(germs[part]).both(name), contact

    return _of_sampled(interface.normals, frames, times, len(germs), np.ones(len(germs)), at)


def of_samples(result: SampleResult, name: str) -> dict[str, Array]:
    """Mean and standard deviation of the fields of an active interface over the samples."""
    result.check_complete()
    interface = result.problem.interfaces[name]
    force, jump = result.force(name), result.jump(name)

    def at(part: slice) -> tuple[Array, Array, ContactValues | None]:
        contact = sampled_contact_values(result.random, result.plan, name, result.germs[part])
        return force[part], jump[part], contact

    frames = law_frames(interface)
    times, count = result.plan.times, len(result.germs)
    return _of_sampled(interface.normals, frames, times, count, result.weights, at)


def of_saved(result: SavedResult, name: str) -> dict[str, Array]:
    """Fields of an interface read from a file.

    Of samples and chaos mean and standard deviation (of a law that is not linear those of its modes), without
    states and gaps.
    """
    interface, force, jump = result.interfaces[name], result.force(name), result.jump(name)
    normals, frames = interface.frames[:, 0], interface.law_frames
    if result.kind == "samples":
        times, weights = result.times, result.weights
        return _of_sampled(
            normals, frames, times, len(force), weights, lambda part: (force[part], jump[part], None)
        )
    if result.chaos is not None:
        chaos = result.chaos
        modes = []
        for what, values in (("force", force), ("jump", jump)):
            block = chaos.fields[f"{what}:{name}"].coefficients.T
            modes.append(_steps(block.reshape(len(block), *values.shape), result.times, 1))
        return _of_modes(point_fields(normals, frames, modes[0], modes[1], None))
    force, jump = _steps(force, result.times), _steps(jump, result.times)
    return point_fields(normals, frames, force, jump, interface.contact)
