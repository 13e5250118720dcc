"""Where a contact is open, sticks or slips, how far a bond is damaged, and what of laws decides it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array, Flags

__all__ = [
    "CLOSED",
    "DAMAGED",
    "OPEN",
    "SLIPS",
    "BondValues",
    "ContactValues",
    "bond_values",
    "contact_states",
    "contact_values",
    "slip_use",
]

OPEN, CLOSED, SLIPS = 0.0, 1.0, 2.0
"""States of a contact; closed with friction is stick."""
NOTHING = 1e-9
"""A pressure below this fraction of the largest is none: the point is open."""
AT_LIMIT = 1e-6
"""A friction force within this fraction of its limit slips."""
DAMAGED = 1e-3
"""Damage that rounding and tolerances do not make; within it of 1 a bond is broken."""


@dataclass(frozen=True)
class ContactValues:
    """Values of a contact law, each broadcast to (samples, steps, m).

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

    def __getitem__(self, part: slice) -> ContactValues:
        """The values of some of the samples."""

        def of(values: Array | None) -> Array | None:
            return values if values is None or len(values) == 1 else values[part]

        clearance = of(self.clearance)
        assert clearance is not None
        return ContactValues(clearance, of(self.friction), of(self.threshold))


@dataclass(frozen=True)
class BondValues:
    """Values of a bond, each broadcast to (samples, steps, m, components).

    Attributes
    ----------
    stiffness
        Of the sound bond, force / length^3.
    jump
        Imposed, length.
    """

    stiffness: Array
    jump: Array

    def __getitem__(self, part: slice) -> BondValues:
        """The values of some of the samples."""
        return BondValues(*(v if len(v) == 1 else v[part] for v in (self.stiffness, self.jump)))

    def damage(self, force: Array, jump: Array) -> Array:
        """Share of the stiffness that is lost, (n, T, m), by the fields (n, T, m, components); of a sound
        bond 0, not its rounding, for which probabilities would take it."""
        sound = self.stiffness * (jump - self.jump)
        tension = np.maximum(sound[..., 0], 0.0)  # contact stays elastic
        carries = np.hypot.reduce([np.maximum(force[..., 0], 0.0), *np.moveaxis(force[..., 1:], -1, 0)])
        would = np.hypot.reduce([tension, *np.moveaxis(sound[..., 1:], -1, 0)])
        loaded = would > NOTHING * would.max(initial=0.0)
        left = np.divide(carries, would, out=np.ones_like(would), where=loaded)
        lost = np.maximum.accumulate(np.clip(1.0 - left, 0.0, 1.0), axis=1)
        return np.asarray(np.where(lost > DAMAGED, lost, 0.0))


def _by_point(block: Array, points: int, samples: int) -> Array:
    """Rows (points * components, 1 or samples * steps) as (1 or samples, 1 or steps, m, components)."""
    rows = block.reshape(points, -1, samples if block.shape[1] > 1 else 1, max(block.shape[1] // samples, 1))
    return np.moveaxis(rows, (2, 3), (0, 1))


def bond_values(parameters: Mapping[str, Array], points: int, samples: int, components: int) -> BondValues:
    """Values of a bond from its parameters, as :func:`contact_values`."""
    normal, tangential, jump = (
        _by_point(parameters[name], points, samples) for name in ("normal", "tangential", "jump")
    )
    shape = np.broadcast_shapes(normal.shape[:3], tangential.shape[:3])
    along = np.broadcast_to(tangential[..., -1:], (*shape, components - 1))
    stiffness = np.concatenate([np.broadcast_to(normal[..., :1], (*shape, 1)), along], axis=-1)
    return BondValues(stiffness, jump[..., :components])


def contact_values(parameters: Mapping[str, Array], points: int, samples: int) -> ContactValues:
    """Values of a contact from its parameters in the kernel's terms.

    Parameters
    ----------
    parameters
        Name -> (rows, 1) or (rows, samples * steps), steps fastest; the normal row of a point comes first.
    points, samples
        Their numbers.
    """

    def shaped(name: str) -> Array:
        block = parameters[name]
        first = block.reshape(points, -1, block.shape[1])[:, 0]
        if first.shape[1] == 1:
            return first.T[None]
        return np.moveaxis(first.reshape(points, samples, -1), 0, -1)

    clearance = shaped("gap") - shaped("jump")
    if "friction" not in parameters:
        return ContactValues(clearance)
    return ContactValues(clearance, shaped("friction"), shaped("threshold"))


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


def slip_use(normal: Array, shear: Array, limits: tuple[Array, Array]) -> Array:
    """How much of the friction limit is used, |f_t| / (mu p + tau), (..., m): 1 slips, 0 where it is open.

    Parameters
    ----------
    normal, shear, limits
        As of :func:`contact_states`.
    """
    friction, threshold = limits
    limit = friction * np.abs(normal) + threshold
    closed = ~contact_states(normal, shear, None)[0]
    out: Array = np.divide(shear, limit, out=np.zeros_like(shear), where=closed & (limit > 0.0))
    return out
