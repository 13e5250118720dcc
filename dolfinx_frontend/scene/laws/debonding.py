"""A bond that softens and comes apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws.base import Fields, Law, Points, positive, resolve

__all__ = ["Debonding"]


SOFTENING = 2.0
"""Search direction of a law that softens, as a multiple of the smallest one with a unique answer."""


@dataclass(frozen=True, repr=False)
class Debonding(Law):
    """Elastic with a limit: a bond that softens linearly and comes apart; contact stays elastic.

    Up to its strength the bond is elastic. Then its damage D grows with the largest opening so far,
    f_n = (1 - D) kappa_n j_n in traction, f_t = (1 - D) kappa_t j_t, until nothing holds; it never heals.
    In compression f_n = kappa_n j_n always. The jumps count as
    lambda^2 = <j_n>^2 + (tangential / normal) |j_t|^2, so that the energy of separation is the same in every
    mode, and the strength in shear is sqrt(tangential / normal) times that in traction (Alfano and
    Crisfield 2001; the equations are in ``latin_core/src/interface/debonding.hpp``).

    The law softens: the search direction must be larger than strength / (opening - strength / normal), twice
    that with two sides. The plan's is raised where it is not. Where the structure is softer than that slope,
    the bond snaps: its path leads through loads that fall, which a warning says.

    Parameters
    ----------
    normal, tangential
        Stiffness per area of the sound bond, force / length^3; normal > 0, tangential >= 0. None for the
        tangential one: no tangential forces.
    strength
        Largest traction, force / area, > 0.
    opening
        Normal jump at which nothing holds any more, length, > strength / normal; or
    energy
        fracture energy, force / length: opening = 2 energy / strength. Give one of the two.
    jump
        Delta, length: a number is the component along n, d components are in the local frame.
    """

    normal: Any
    tangential: Any = None
    strength: Any = None
    opening: Any = None
    energy: Any = None
    jump: Any = 0.0
    not_negative: ClassVar[tuple[str, ...]] = ("normal", "tangential", "strength", "opening", "energy")

    def validate(self) -> None:
        if self.normal is None:
            raise SceneError("Debonding: normal = None: a bond has a normal stiffness > 0, force / length^3")
        if self.strength is None or (self.opening is None) == (self.energy is None):
            raise SceneError("Debonding: give its strength, and its final opening or its energy")
        for name in ("normal", "tangential", "strength", "opening", "energy"):
            value = getattr(self, name)
            if value is not None:
                self.check_value(name, value, 0.0, f"{name} is >= 0 and finite")
        self.check_value("jump", self.jump)

    @property
    def history(self) -> bool:
        return True

    def parameters(self) -> dict[str, Any]:
        return self.given("normal", "tangential", "strength", "opening", "energy", "jump")

    def count(self, dim: int) -> int:
        return 1 if self.tangential is None else dim

    def jumps(self, points: Points) -> Array:
        return resolve(self.jump, points, points.dim, "first", "jump")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        parameters = {
            name: positive(points, value, name)
            for name, value in self.given("normal", "strength", "opening", "energy").items()
        }
        tangential: Array = np.zeros((points.num_points, 1))
        if self.tangential is not None:
            tangential = resolve(self.tangential, points, 1, name="tangential")
            if tangential.min() < 0.0:
                raise SceneError(
                    f"interface {points.name!r}: tangential stiffness {tangential.min():g} is negative"
                )
        parameters["tangential"] = tangential
        softest = self._softest(points, parameters)
        parameters["jump"] = self.imposed(points)
        return Fields("debonding", self.count(points.dim), self.rows(points), parameters, softest)

    def _softest(self, points: Points, values: dict[str, Array]) -> Array:
        """Smallest search direction (m, components) with one answer; refuses values that do not fit."""
        first = values["strength"] / values["normal"]
        last = values.get("opening")
        if last is None:
            last = 2.0 * values["energy"] / values["strength"]
        if np.any(last <= first):
            worst = int(np.argmin(last - first))
            raise SceneError(
                f"interface {points.name!r}: the bond ends at an opening of {last[worst, 0]:.4g}, before its "
                f"strength is reached at strength / normal = {first[worst, 0]:.4g}: give a larger opening or "
                "energy, or a stiffer bond"
            )
        # flexibility 1/k1 + 1/k2 below (lambda_f - lambda_0) / strength in the metric of the law
        slope = len(points.sides) * values["strength"] / (last - first)
        softest: Array = np.repeat(SOFTENING * slope, self.count(points.dim), axis=1)
        softest[:, 1:] *= values["tangential"] / values["normal"]
        return softest

    @property
    def softens(self) -> bool:
        return True

    def damage(self, points: Points, jump: Array) -> Array:
        normal, strength = (resolve(value, points, 1) for value in (self.normal, self.strength))
        opening = jump - self.jumps(points)[:, : jump.shape[1]]
        opening[:, 0] = np.maximum(opening[:, 0], 0.0)  # contact stays elastic
        if self.tangential is not None:
            opening[:, 1:] *= np.sqrt(resolve(self.tangential, points, 1) / normal)
        first = (strength / normal)[:, 0]
        last = 2.0 * self._energies(points) / strength[:, 0]
        largest = np.maximum(np.linalg.norm(opening, axis=1), first)
        return np.asarray(np.minimum(last * (1.0 - first / largest) / (last - first), 1.0))

    def process_zone(self, points: Points, modulus: Array) -> Array:
        """E G / strength^2 (A. Turon et al., Eng. Fract. Mech. 74 (2007) 1665, with M = 1)."""
        strength = resolve(self.strength, points, 1)[:, 0]
        return np.asarray(modulus * self._energies(points) / strength**2)

    def _energies(self, points: Points) -> Array:
        """(m,), of separation, force / length."""
        if self.energy is not None:
            return resolve(self.energy, points, 1)[:, 0]
        both = resolve(self.strength, points, 1) * resolve(self.opening, points, 1)
        return np.asarray(0.5 * both[:, 0])

    def _unit(self, points: Points, parameter: str) -> Array:
        if parameter == "jump":
            return super()._unit(points, parameter)
        # not from a law with the value 1: the values of a bond must fit each other
        return np.ones((points.num_points, 1))

    def holds(self, dim: int) -> tuple[bool, ...]:
        return (True,) + (self.tangential is not None,) * (dim - 1)
