"""Interface laws at points, for the reference: resolvents with their derivatives, nothing of the kernel's.

Fields are (points, components); component 0 is normal. With the jump j (less what is imposed) and the force f
on side 1 a law is asked: which f fits z = j + c f, and how does it change with z? ``c`` is the reference's
own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import numpy.typing as npt

import dolfinx_frontend as lf

Array = npt.NDArray[np.float64]


def at_points(value: Any, points: Array) -> Array:
    """A number or a function of the points, (m,)."""
    found = value(points) if callable(value) else value
    return np.broadcast_to(np.asarray(found, dtype=np.float64), len(points)).copy()


def vector(value: Any, points: Array, components: int, scalar: str) -> Array:
    """A vector at points, (m, components); a number stands for the first component or for all of them."""
    found = np.asarray(value(points) if callable(value) else value, dtype=np.float64)
    out = np.zeros((len(points), components))
    if found.ndim == 0 and scalar == "first":
        out[:, 0] = found
    else:
        out[:] = found
    return out


class PointLaw(ABC):
    """A law at the points of one interface at one time."""

    components: int
    convex = True
    """Whether the force is the slope of a convex energy of the jump."""
    frozen: Array | None = None
    """What makes a law convex while it is held fixed (a friction bound, a damage); None: nothing is."""

    @abstractmethod
    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        """f (m, k) and df/dz (m, k, k) for z (m, k) and c (m, k)."""

    def remember(self, jump: Array, force: Array) -> Any:
        """What the next time step must know of this one."""
        return None

    def freeze(self, jump: Array, force: Array, last: Array | None) -> None:
        """Hold fixed what makes the law not convex, as a jump and a force have it; `last`: as it was held."""


def _diagonal(values: Array) -> Array:
    m, k = values.shape
    out = np.zeros((m, k, k))
    out[:, range(k), range(k)] = values
    return out


class Springs(PointLaw):
    """f = kappa (j - delta), kappa (m, k)."""

    def __init__(self, kappa: Array, delta: Array) -> None:
        self.kappa, self.delta = kappa, delta
        self.components = kappa.shape[1]

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        slope = self.kappa / (1.0 + self.kappa * c)
        return slope * (z - self.delta), _diagonal(slope)


class Friction(PointLaw):
    """Unilateral contact, with or without friction."""

    def __init__(
        self,
        components: int,
        gap: Array,
        compliance: Array,
        mu: Array,
        tau: Array,
        delta: Array,
        before: Array | None,
    ) -> None:
        self.components, self.gap, self.compliance, self.mu, self.tau = components, gap, compliance, mu, tau
        self.delta = delta
        self.before = np.zeros((len(gap), components - 1)) if before is None else before
        self.convex = components == 1 or not np.any(mu)

    def bound(self, force: Array) -> Array:
        """Largest tangential force for a force, (m,)."""
        pressure = np.maximum(0.0, -force[:, 0])
        return np.where(pressure > 0.0, self.mu * pressure + self.tau, 0.0)

    def freeze(self, jump: Array, force: Array, last: Array | None) -> None:
        bound = self.bound(force)
        self.frozen = bound if last is None else 0.5 * (bound + last)

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        m, k = z.shape
        z = z - self.delta
        slope = np.zeros((m, k, k))
        stiff = 1.0 / (c[:, 0] + self.compliance)
        closed = z[:, 0] + self.gap < 0.0
        force = np.zeros((m, k))
        force[:, 0] = np.where(closed, (z[:, 0] + self.gap) * stiff, 0.0)
        slope[:, 0, 0] = np.where(closed, stiff, 0.0)
        if k == 1:
            return force, slope
        trial = (z[:, 1:] - self.before) / c[:, 1:]
        size = np.linalg.norm(trial, axis=1)
        if self.frozen is None:
            bound = np.where(closed, self.mu * -force[:, 0] + self.tau, 0.0)
        else:
            bound = self.frozen
        slips = size > bound
        share = np.where(slips, bound / np.where(size > 0.0, size, 1.0), 1.0)
        force[:, 1:] = share[:, None] * trial
        along = trial / np.where(size > 0.0, size, 1.0)[:, None]
        eye = np.eye(k - 1)
        inner = share[:, None, None] * (
            eye - np.where(slips, 1.0, 0.0)[:, None, None] * along[:, :, None] * along[:, None, :]
        )
        slope[:, 1:, 1:] = inner / c[:, 1:2, None]
        if self.frozen is None:
            moves = np.where(slips & closed, -self.mu * stiff, 0.0)
            slope[:, 1:, 0] = moves[:, None] * along
        return force, slope

    def remember(self, jump: Array, force: Array) -> Any:
        return (jump - self.delta)[:, 1:].copy()


class Bond(PointLaw):
    """Debonding: bilinear, damage from the largest mixed opening; c is such that one share serves all."""

    convex = False

    def __init__(
        self, normal: Array, tangential: Array | None, strength: Array, last: Array, delta: Array, worst: Any
    ) -> None:
        self.normal, self.strength, self.last, self.delta = normal, strength, last, delta
        self.components = delta.shape[1]
        self.tangential = np.zeros_like(normal) if tangential is None else tangential
        self.first = strength / normal
        self.worst = np.zeros_like(normal) if worst is None else worst
        kappa = np.repeat(self.tangential[:, None], self.components, axis=1)
        kappa[:, 0] = normal
        self.kappa = kappa

    def flexibility(self, c: Array) -> Array:
        """c below what makes the resolvent unique, the same in the metric of the law."""
        limit = 0.2 * (self.last - self.first) / self.strength
        normal = np.minimum(c[:, 0], limit)
        out = np.repeat(normal[:, None], self.components, axis=1)
        ratio = self.normal / np.where(self.tangential > 0.0, self.tangential, self.normal)
        out[:, 1:] *= ratio[:, None]
        return out

    def _mixed(self, jump: Array) -> Array:
        square = np.maximum(jump[:, 0], 0.0) ** 2
        return np.sqrt(square + self.tangential / self.normal * np.sum(jump[:, 1:] ** 2, axis=1))

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        z = z - self.delta
        m, k = z.shape
        product = c[:, 0] * self.normal
        a = self.first / (self.last - self.first)
        whole = self._mixed(z)
        worst = np.maximum(self.worst, self.first)

        def share_of(reached: Array) -> Array:
            left = np.clip(a * (self.last - reached) / np.maximum(reached, 1e-300), 0.0, 1.0)
            return np.where(reached <= self.first, 1.0, left)

        old = share_of(self.worst if self.frozen is None else np.maximum(self.frozen, self.worst))
        grows = whole / (1.0 + product * old) > worst
        if self.frozen is not None:
            grows = np.zeros(m, dtype=bool)
        reached = np.where(
            whole >= self.last, whole, (whole - product * a * self.last) / (1.0 - product * a)
        )
        share = np.where(grows, np.where(whole >= self.last, 0.0, share_of(reached)), old)
        each = np.repeat(share[:, None], k, axis=1)
        each[:, 0] = np.where(z[:, 0] > 0.0, share, 1.0)
        base = self.kappa / (1.0 + each * c * self.kappa)
        force = each * base * z
        slope = _diagonal(each * base)
        softens = grows & (whole < self.last)
        if np.any(softens):
            turn = np.zeros((m, k))  # d(whole)/dz
            turn[:, 0] = np.maximum(z[:, 0], 0.0)
            turn[:, 1:] = (self.tangential / self.normal)[:, None] * z[:, 1:]
            turn /= np.where(whole > 0.0, whole, 1.0)[:, None]
            fall = np.where(softens, -a * self.last / reached**2 / (1.0 - product * a), 0.0)
            gain = self.kappa * z / (1.0 + each * c * self.kappa) ** 2
            gain[:, 0] = np.where(z[:, 0] > 0.0, gain[:, 0], 0.0)
            slope += gain[:, :, None] * (fall[:, None] * turn)[:, None, :]
        return force, slope

    def remember(self, jump: Array, force: Array) -> Any:
        return np.maximum(self.worst, self._mixed(jump - self.delta))

    def damage(self, worst: Array) -> Array:
        """0 (whole) to 1 (torn), (m,)."""
        return np.clip((worst - self.first) / (self.last - self.first), 0.0, 1.0)

    def freeze(self, jump: Array, force: Array, last: Array | None) -> None:
        self.frozen = self._mixed(jump - self.delta)


class Bolt(PointLaw):
    """Preload: the force is given, or the length is kept; tied in the tangential directions."""

    def __init__(self, components: int, force: Array, locked: bool, length: Array | None) -> None:
        self.components, self.force, self.locked = components, force, locked
        self.length = np.zeros_like(force) if length is None else length

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        force, slope = z / c, _diagonal(1.0 / c)
        if self.locked:
            force[:, 0] = (z[:, 0] - self.length) / c[:, 0]
        else:
            force[:, 0] = self.force
            slope[:, 0, 0] = 0.0
        return force, slope

    def remember(self, jump: Array, force: Array) -> Any:
        return self.length if self.locked else jump[:, 0].copy()


class Rubber(PointLaw):
    """f = (k + h |j|^2) j; c must be the same in all components."""

    def __init__(self, components: int, stiffness: Array, hardening: Array) -> None:
        self.components, self.stiffness, self.hardening = components, stiffness, hardening

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        size = np.linalg.norm(z, axis=1)
        one, cubic = 1.0 + c[:, 0] * self.stiffness, c[:, 0] * self.hardening
        rho = np.minimum(size / one, np.cbrt(size / np.maximum(cubic, 1e-300)))
        for _ in range(60):
            step = (one * rho + cubic * rho**3 - size) / (one + 3.0 * cubic * rho**2)
            rho = rho - step
            if np.all(np.abs(step) <= 1e-16 * (size + 1e-300)):
                break
        stiffness = self.stiffness + self.hardening * rho**2
        share = 1.0 / (one + cubic * rho**2)
        jump = share[:, None] * z
        along = z / np.where(size > 0.0, size, 1.0)[:, None]
        lost = 2.0 * cubic * rho**2 / (one + 3.0 * cubic * rho**2)
        turn = np.eye(z.shape[1]) - lost[:, None, None] * along[:, :, None] * along[:, None, :]
        turn = share[:, None, None] * turn
        # d f/d j times d j/d z, which has no difference of close numbers
        curve = stiffness[:, None, None] * np.eye(z.shape[1])
        curve = curve + 2.0 * (self.hardening * rho**2)[:, None, None] * along[:, :, None] * along[:, None, :]
        return stiffness[:, None] * jump, curve @ turn


class Wire(PointLaw):
    """f_n = max(0, k (j_n - slack))."""

    components = 1

    def __init__(self, stiffness: Array, slack: Array) -> None:
        self.stiffness, self.slack = stiffness, slack

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        slope = 1.0 / (c + 1.0 / self.stiffness[:, None])
        pulls = z > self.slack[:, None]
        force = np.where(pulls, slope * (z - self.slack[:, None]), 0.0)
        return force, _diagonal(np.where(pulls, slope, 0.0))


class Yield(PointLaw):
    """An elastic pad with |f_n| <= limit and a plastic jump that stays."""

    components = 1

    def __init__(self, stiffness: Array, limit: Array, plastic: Array | None) -> None:
        self.stiffness, self.limit = stiffness, limit
        self.plastic = np.zeros_like(limit) if plastic is None else plastic

    def resolve(self, z: Array, c: Array) -> tuple[Array, Array]:
        slope = 1.0 / (c + 1.0 / self.stiffness[:, None])
        trial = slope * (z - self.plastic[:, None])
        limit = self.limit[:, None]
        return np.clip(trial, -limit, limit), _diagonal(np.where(np.abs(trial) < limit, slope, 0.0))

    def remember(self, jump: Array, force: Array) -> Any:
        trial = self.stiffness * (jump[:, 0] - self.plastic)
        yields = np.abs(trial) > self.limit
        return np.where(yields, jump[:, 0] - np.sign(trial) * self.limit / self.stiffness, self.plastic)


def point_law(interface: Any, law: Any, time: float | None, memory: Any) -> PointLaw:
    """A scene's law, with numbers for values, at the points of its interface.

    Parameters
    ----------
    interface
        Of the assembled problem.
    law
        Elastic, Contact, Debonding, Preload or one of the campaign's own user laws.
    time
        Of a load history; None: there is none.
    memory
        What :meth:`PointLaw.remember` gave at the step before; None at the first.
    """
    x, d, m = interface.points, interface.dim, interface.num_points
    if isinstance(law, lf.Elastic):
        kappa = spring_rows(interface, law)
        return Springs(kappa, vector(law.jump, x, d, "first")[:, : kappa.shape[1]])
    if isinstance(law, lf.Contact):
        components = 1 if law.friction is None and law.threshold is None else d
        gap = interface.clearance if law.gap is None else at_points(law.gap, x)
        soft = np.zeros(m) if law.stiffness is None else 1.0 / at_points(law.stiffness, x)
        mu, tau = (np.zeros(m) if v is None else at_points(v, x) for v in (law.friction, law.threshold))
        delta = vector(law.jump, x, d, "first")[:, :components]
        return Friction(components, gap, soft, mu, tau, delta, memory)
    if isinstance(law, lf.Debonding):
        tangential = None if law.tangential is None else at_points(law.tangential, x)
        strength = at_points(law.strength, x)
        last = 2.0 * at_points(law.energy, x) / strength if law.opening is None else at_points(law.opening, x)
        components = 1 if law.tangential is None else d
        delta = vector(law.jump, x, d, "first")[:, :components]
        return Bond(at_points(law.normal, x), tangential, strength, last, delta, memory)
    if isinstance(law, lf.Preload):
        force = at_points(law.force, x) / (interface.area if law.total else 1.0)
        locked = law.until is not None and time is not None and time > law.until * (1.0 + 1e-9)
        return Bolt(d, force, locked, memory)
    values = {name: at_points(value, x) for name, value in law.values.items()}
    if law.name == "rubber":
        return Rubber(d, **values)
    if law.name == "wire":
        return Wire(**values)
    if law.name == "yield":
        return Yield(plastic=memory, **values)
    raise ValueError(f"the campaign has no point law for {law!r}")


def spring_rows(interface: Any, law: Any) -> Array:
    """Stiffness per area of springs, (m, 1) without a tangential one, otherwise (m, d)."""
    x, d = interface.points, interface.dim
    share = interface.area if law.total else 1.0
    columns = [np.zeros(len(x)) if law.normal is None else at_points(law.normal, x) / share]
    if law.tangential is not None:
        columns += [at_points(law.tangential, x) / share] * (d - 1)
    return np.stack(columns, axis=1)
