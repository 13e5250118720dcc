"""Pretension section of a bolt."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_number, is_real
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.laws.base import Fields, Law, Points, resolve, settled
from dolfinx_frontend.scene.laws.intervals import after, checked_intervals, missed, within
from dolfinx_frontend.scene.laws.perfect import Perfect
from dolfinx_frontend.scene.values import Parameter, evaluate, is_plain

__all__ = ["Preload", "Seated"]


@dataclass(frozen=True, repr=False)
class Preload(Law):
    """Pretension section of a bolt: tightened, then fixed at its length; tied in the tangential directions.

    In the time steps up to `until` the normal force is the given one; afterwards the normal jump of every
    point stays what it was, and the force follows from the structure. Without `until` the force is
    given throughout. With `during` it is given in some intervals only, as where bolts are tightened one after
    another, and again: before the first one the section carries nothing along its normal. On one face it
    pulls this along its outward normal, as on the cut shank of half a bolt: not on the face under a nut.

    It is tightened by a force, by a torque, which is a force by the friction of thread and head (VDI 2230,
    F = M / (P / 2 pi + mu_thread d2 / (2 cos 30) + mu_head D / 2) with d2 = d - 0.6495 P), or by a
    shortening or the angle of a nut (P angle / 360), which are given throughout. Where both are given, the
    section is shortened further from the length that the force or the torque left it with: a torque to snug,
    then an angle.

    Parameters
    ----------
    force
        Force on the whole section as it is modelled (half of it on half a bolt), > 0 in tension.
    torque, mu_thread, mu_head, d, pitch, bearing
        Tightening torque (force * length) of the whole bolt, friction coefficients, nominal diameter and
        pitch of the thread, mean diameter D of the bearing of the head (None: 1.3 d), length. Torque and
        friction may be random or swept.
    shortening, angle
        Length, or degrees on a thread of this pitch; numbers, random, swept, or an Amplitude times one.
    embedding
        Length that the joint loses after tightening (VDI 2230: f_Z), >= 0; as `shortening`.
    stiffness
        Of what of the bolt is not modelled, in series with the section, force / length; None: nothing is.
    until
        Last time of force control; None: all times.
    total
        False: `force` is per area.
    during
        Intervals (start, end] of force control, in order; instead of `until`. Before the first one it carries
        nothing.
    """

    force: Any = None
    until: float | None = None
    total: bool = True
    during: tuple[tuple[float, float], ...] | None = None
    torque: Any = None
    mu_thread: Any = None
    mu_head: Any = None
    d: float | None = None
    pitch: float | None = None
    bearing: float | None = None
    shortening: Any = None
    angle: Any = None
    embedding: Any = None
    stiffness: float | None = None
    drawn: ClassVar[str] = "preload"
    not_negative: ClassVar[tuple[str, ...]] = ("torque", "mu_thread", "mu_head", "embedding")
    frictions: ClassVar[tuple[str, ...]] = ("mu_thread", "mu_head")

    def validate(self) -> None:
        self._validate_tightening()
        if self.until is not None:
            checked_number("Preload", "until", self.until)
        if self.during is None:
            return
        if self.until is not None:
            raise SceneError("Preload: until and during are given: give one")
        object.__setattr__(self, "during", checked_intervals("Preload", self.during))

    def _validate_tightening(self) -> None:
        given = self.given("force", "torque", "shortening", "angle")
        if not given:
            raise SceneError(
                "Preload: it is not said how it is tightened: give force, torque, shortening or angle"
            )
        for pair in (("force", "torque"), ("shortening", "angle")):
            if set(pair) <= set(given):
                raise SceneError(f"Preload: {' and '.join(pair)} are given: give one")
        for name, value in self.parameters().items():
            self.check_value(name, value, 0.0 if name in self.not_negative else None, f"{name} is >= 0")
        if self.stiffness is not None:
            checked_number("Preload", "stiffness", self.stiffness, above=0.0)
        by_force = bool({"force", "torque"} & set(given))
        if not by_force and (self.until is not None or self.during is not None):
            raise SceneError(
                "Preload: until and during are for force and torque; a shortening is given throughout"
            )
        slack = self.given("shortening", "angle", "embedding")
        if by_force and slack and self.until is None and self.during is None:
            raise SceneError(
                f"Preload: {', '.join(slack)} beside a force that is given throughout changes nothing: say "
                "until when it is given (until=, during=)"
            )
        random = [k for k, v in slack.items() if not is_plain(v) and isinstance(v, Parameter)]
        varying = [k for k, v in slack.items() if isinstance(v, Varying)]
        if random and varying:
            raise SceneError(
                f"Preload: {random[0]} is random and {varying[0]} changes in time; one of them can, not both"
            )
        if self.angle is not None:
            if self.pitch is None:
                raise SceneError(
                    f"Preload: angle = {short(self.angle)} without the pitch of the thread; give pitch="
                )
            checked_number("Preload", "pitch", self.pitch, above=0.0)
        if self.torque is not None:
            self._validate_thread()

    def _validate_thread(self) -> None:
        missing = [n for n in ("mu_thread", "mu_head", "d", "pitch") if getattr(self, n) is None]
        if missing:
            raise SceneError(
                f"Preload: torque = {short(self.torque)} needs {', '.join(missing)}: friction of thread and "
                "head, nominal diameter and pitch"
            )
        for name in ("mu_thread", "mu_head"):
            value = getattr(self, name)
            if isinstance(value, Varying) or not (is_real(value) or isinstance(value, Parameter)):
                raise SceneError(f"Preload: {name} = {short(value)}; give a number or a random number")
        known = is_real(self.torque) or isinstance(self.torque, Parameter)
        if isinstance(self.torque, Varying) or not known:
            raise SceneError(
                f"Preload: torque = {short(self.torque)}; give a number or a random number, and the times at "
                "which it acts by until= or during="
            )
        checked_number("Preload", "d", self.d, above=0.0)
        # the minor diameter of the thread is d - 1.22687 pitch
        checked_number("Preload", "pitch", self.pitch, least=0.0, below=float(self.d or 0.0) / 1.22687)
        if self.bearing is not None:
            checked_number("Preload", "bearing", self.bearing, above=0.0)
        if self._lever(self._nominal("mu_thread"), self._nominal("mu_head")) <= 0.0:
            raise SceneError(
                f"Preload: torque = {short(self.torque)} with mu_thread = {short(self.mu_thread)}, mu_head = "
                f"{short(self.mu_head)} and pitch = {self.pitch:g}: nothing takes the torque, the force "
                "would be infinite; give a pitch or friction > 0"
            )

    def _nominal(self, name: str) -> float:
        value = getattr(self, name)
        return float(value) if is_real(value) else float(value.mean)

    def _lever(self, mu_thread: Any, mu_head: Any) -> Any:
        """Torque by force, length."""
        assert self.d is not None and self.pitch is not None
        bearing = 1.3 * self.d if self.bearing is None else self.bearing
        flank = 0.5 * (self.d - 0.6495 * self.pitch) / math.cos(math.radians(30.0))
        return self.pitch / (2.0 * math.pi) + flank * mu_thread + 0.5 * bearing * mu_head

    def _force_of(self, values: Mapping[str, Array]) -> Array:
        """Force (N,) for values (N,) of torque and friction, those that are not given at their own."""
        torque, mu_thread, mu_head = (
            values[n] if n in values else self._nominal(n) for n in ("torque", "mu_thread", "mu_head")
        )
        lever = np.asarray(self._lever(mu_thread, mu_head), dtype=np.float64)
        if not lever.min() > 0.0:
            raise SceneError(
                f"Preload: torque with mu_thread = {short(self.mu_thread)}, mu_head = "
                f"{short(self.mu_head)} and pitch = {self.pitch:g}: where the friction is negative nothing "
                "takes the torque, and the force would be infinite; use a distribution that is positive "
                "(LogNormal, Gamma) or a smaller spread"
            )
        return np.asarray(torque / lever, dtype=np.float64)

    def given_force(self) -> float | None:
        """Force to which it is tightened, random values at their means; None: by a length, or in time."""
        if self.torque is not None:
            return float(self._force_of({}))
        known = is_real(self.force) or isinstance(self.force, Parameter)
        return self._nominal("force") if known else None

    def _slack_of(self, values: Mapping[str, Array]) -> Array:
        """Length (N,) that the section gains after tightening."""
        total: Any = 0.0
        turn = 0.0 if self.pitch is None else self.pitch / 360.0
        for name, unit in (("shortening", -1.0), ("angle", -turn), ("embedding", 1.0)):
            if name in values:
                total = total + unit * values[name]
            elif getattr(self, name) is not None:
                value = getattr(self, name)
                total = total + unit * (float(evaluate(value, np.zeros((1, 1)), 1, f"Preload, {name}")[0, 0]))
        return np.asarray(total, dtype=np.float64)

    def shortened(self) -> float:
        """Length by which it is shortened; random values at their means."""
        return -float(self._slack_of({}))

    def derived(self) -> dict[str, tuple[tuple[str, ...], Callable[[Mapping[str, Array]], Array]]]:
        found: dict[str, tuple[tuple[str, ...], Callable[[Mapping[str, Array]], Array]]] = {}
        if self.torque is not None:
            found["force"] = (("torque", "mu_thread", "mu_head"), self._force_of)
        slack = tuple(self.given("shortening", "angle", "embedding"))
        if slack:
            found["slack"] = (slack, self._slack_of)
        return found

    def with_(self, **changes: Any) -> Preload:
        if self.torque is not None and changes.get("force") is not None:
            changes = {**changes, "torque": None, "mu_thread": None, "mu_head": None}
        if "slack" in changes:  # of a sample: all that makes it
            slack = float(np.asarray(changes["slack"]))
            changes = {k: v for k, v in changes.items() if k != "slack"}
            changes |= {"shortening": -slack, "angle": None, "embedding": None}
        return super().with_(**changes)

    def controlled(self, time: float | None) -> bool:
        if self.force is None and self.torque is None:
            return False
        if time is None:
            return True
        if self.during is not None:
            return self.waits(time) or within(time, self.during)
        return self.until is None or not after(time, self.until)

    def waits(self, time: float | None) -> bool:
        """Whether it has not been tightened yet at a time, and carries nothing."""
        return time is not None and self.during is not None and not after(time, self.during[0][0])

    def skipped(self, times: Array) -> str:
        spans = self.during or (((-math.inf, self.until),) if self.timed and self.until is not None else ())
        lost = missed(times, spans)
        if lost is None:
            return ""
        since = "" if lost[0] == -math.inf else f"after {lost[0]:g} and "
        return f"it is tightened {since}not later than {lost[1]:g}, and no step is there"

    @property
    def history(self) -> bool:
        return self.until is not None or self.during is not None

    @property
    def timed(self) -> bool:
        slack = self.given("shortening", "angle", "embedding")
        return self.during is not None or bool(self.until is not None and slack)

    @property
    def bolt(self) -> bool:
        return True

    @property
    def may_loosen(self) -> bool:
        return self.embedding is not None or self.history

    @property
    def doubt(self) -> str:
        given = self.given("force", "shortening", "angle")
        below = [name for name, value in given.items() if is_real(value) and value < 0.0]
        if not below:
            return super().doubt
        return f"Preload: {below[0]} = {short(given[below[0]])} pushes its sides apart; tension is > 0"

    @property
    def rigid(self) -> bool:
        return True

    def parameters(self) -> dict[str, Any]:
        return self.given("force", "torque", "mu_thread", "mu_head", "shortening", "angle", "embedding")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        locked = -1.0 if self.waits(time) else float(not self.controlled(time))
        parameters = {
            "force": self._normal_force(points),
            "locked": np.full((points.num_points, 1), locked),
        }
        if self.given("shortening", "angle", "embedding"):
            parameters["slack"] = np.full((points.num_points, 1), float(self._slack_of({})))
        if self.stiffness is not None:
            area = points.area if self.total else 1.0
            parameters["compliance"] = np.full((points.num_points, 1), area / self.stiffness)
        return Fields("preload", points.dim, self.rows(points), parameters)

    def _normal_force(self, points: Points) -> Array:
        """f_n (m, 1), force / area; 0 where it is tightened by a length."""
        if self.force is None and self.torque is None:
            return np.zeros((points.num_points, 1))
        if self.torque is not None:
            area = points.area if self.total else 1.0
            return np.full((points.num_points, 1), float(self._force_of({})) / area)
        area = points.area if self.total else 1.0
        return np.divide(resolve(self.force, points, 1, name="force"), area)

    def load(self, points: Points, time: float | None = None) -> Array | None:
        if not self.controlled(time):
            return None
        out = np.zeros((points.num_points, points.dim))
        if not self.waits(time):
            out[:, :1] = self._normal_force(points)
        return out

    def kernel_name(self, parameter: str) -> str:
        if parameter in ("torque", "mu_thread", "mu_head"):
            return "force"
        return "slack" if parameter in ("shortening", "angle", "embedding") else parameter

    def kernel_unit(self, points: Points, parameter: str) -> tuple[str, Array]:
        if parameter == "slack":
            return "slack", np.ones((points.num_points, 1))
        if parameter == "force":
            return "force", np.full((points.num_points, 1), 1.0 / points.area if self.total else 1.0)
        if parameter in self.parameters():
            raise SceneError(
                f"interface {points.name!r}: the {parameter} of a preload does not enter its law linearly"
            )
        return super().kernel_unit(points, parameter)

    def kernel_values(self, points: Points, parameter: str, values: Array) -> tuple[str, Array, Array]:
        name = self.kernel_name(parameter)
        if name == parameter or parameter not in self.parameters():
            return super().kernel_values(points, parameter, values)
        others = [p for p in self.varying if self.kernel_name(p) == name]
        if others:
            raise SceneError(
                f"interface {points.name!r}: {parameter} is swept where {others[0]} changes in time; sweep "
                "the "
                "force, or give numbers"
            )
        of = self._force_of if name == "force" else self._slack_of
        return *self.kernel_unit(points, name), of({parameter: values})

    def holds(self, dim: int) -> tuple[bool, ...]:
        if self.force is None and self.torque is None:
            return (True,) * dim
        # while it is tightened, something else must hold the two ends
        return (False,) + (True,) * (dim - 1)

    @property
    def locked(self) -> Law:
        return Perfect()

    def tightened(self, points: Points, times: Array) -> int | None:
        if self.force is None and self.torque is None:
            return settled([self.at(t)._slack_of({}) for t in times])
        if self.until is None and self.during is None:
            return settled([self.at(t)._normal_force(points) for t in times])
        given = (k for k, t in enumerate(times) if self.controlled(t) and not self.waits(t))
        return max(given, default=0)


@dataclass(frozen=True, repr=False)
class Seated(Preload):
    """A spring that carries nothing until a bolt is tightened, and resists what changes afterwards."""

    def parameters(self) -> dict[str, Any]:
        return {}

    @property
    def may_loosen(self) -> bool:
        return False  # it has no side that is loose

    def tightened(self, points: Points, times: Array) -> int | None:
        return None
