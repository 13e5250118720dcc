"""Unilateral contact, with or without friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.scene.laws.base import Fields, Law, Points, positive, resolve
from dolfinx_frontend.scene.values import is_zero

__all__ = ["Contact"]


TOUCHING = 1e-6
"""Interpenetration, relative to the face's size, that is rounding of the mesh."""

CURVED = "use curved cells (order=2; of a gmsh model geometry.from_gmsh(model, order=2))"

UNCERTAIN, USELESS = 0.1, 0.4
"""Distance of facets from the round face, relative to an interference as meshed, from which on there is a
warning, and an error: the true interference may be smaller and larger by that distance."""


@dataclass(frozen=True, repr=False)
class Contact(Law):
    """Unilateral contact, with or without dry friction; one-sided: against rigid ground.

    With the opening g = j_n - Delta_n + g0: f_n <= 0, g >= 0, f_n g = 0. With friction the tangential
    force is bounded, |f_t| <= mu |f_n| + tau, and slips along its own direction at the bound; below it what
    sticks moves by the elastic slip f_t / k_t, which comes back when it is unloaded.

    Parameters
    ----------
    gap
        g0, length; negative: interference. None: the distance of the two faces as they are meshed.
    friction
        mu >= 0. None: no friction, and no tangential unknowns.
    threshold
        tau >= 0, force / area (Tresca's law where mu is 0); of points that touch, open ones carry no shear.
        None: none.
    stiffness
        Normal stiffness per area in compression, force / length^3. None: rigid.
    tangential_stiffness
        k_t per area of what sticks (stick slope), force / length^3, with friction. None: rigid.
    jump
        Delta, length: a number is the component along n, d components are in the local frame. A bolt
        that was shortened by 0.2 mm has jump = -0.2.
    interference
        Accept faces that are meshed inside each other as an interference; otherwise that is an error.
    """

    gap: Any = None
    friction: Any = None
    threshold: Any = None
    stiffness: Any = None
    tangential_stiffness: Any = None
    jump: Any = 0.0
    interference: bool = False
    unilateral: ClassVar[bool] = True
    kernel_names: ClassVar[Mapping[str, str]] = ReadOnlyDict(
        {"stiffness": "compliance", "tangential_stiffness": "tangential_compliance"}
    )
    inverse: ClassVar[tuple[str, ...]] = ("stiffness", "tangential_stiffness")
    not_negative: ClassVar[tuple[str, ...]] = ("friction", "threshold", *inverse)
    frictions: ClassVar[tuple[str, ...]] = ("friction",)
    search_direction: ClassVar[Literal["parts", "patch", "springs"]] = "patch"
    drawn: ClassVar[str] = "contact"

    def validate(self) -> None:
        if self.gap is not None:
            self.check_value("gap", self.gap)
        for name, value in self.given(*self.not_negative).items():
            self.check_value(name, value, 0.0, f"{name} is >= 0 and finite")
        if self.tangential_stiffness is not None and not self.given("friction", "threshold"):
            raise SceneError(
                f"Contact: tangential_stiffness = {short(self.tangential_stiffness)} without friction holds "
                "nothing; give friction="
            )
        self.check_value("jump", self.jump)

    @property
    def rubs(self) -> bool:
        """Whether there are tangential forces."""
        return not (is_zero(self.friction) and is_zero(self.threshold))

    @property
    def history(self) -> bool:
        return self.rubs

    @property
    def bolt(self) -> bool:
        return not is_zero(self.jump)

    def parameters(self) -> dict[str, Any]:
        return self.given("gap", "friction", "threshold", "stiffness", "tangential_stiffness", "jump")

    def matters(self, parameter: str) -> bool:
        return parameter != "tangential_stiffness" or self.rubs

    def count(self, dim: int) -> int:
        return dim if self.rubs else 1

    def jumps(self, points: Points) -> Array:
        return resolve(self.jump, points, points.dim, "first", "jump")

    def fields(self, points: Points, time: float | None = None) -> Fields:
        nothing = np.zeros((points.num_points, 1))
        parameters = {"gap": self._gap(points), "compliance": nothing}
        for name, value in self.given(*self.inverse).items():
            if self.matters(name):
                kappa = positive(points, value, f"contact {name}")
                parameters[self.kernel_name(name)] = np.reciprocal(kappa)
        for name in ("friction", "threshold") if self.rubs else ():
            value = getattr(self, name)
            values = nothing if value is None else resolve(value, points, 1, name=name)
            if values.min() < 0.0:
                raise SceneError(f"interface {points.name!r}: {name} {values.min():g} is negative")
            parameters[name] = values
        parameters["jump"] = self.imposed(points)
        kind = "coulomb" if self.rubs else "contact"
        return Fields(kind, self.count(points.dim), self.rows(points), parameters)

    def _gap(self, points: Points) -> Array:
        """g0 (m, 1)."""
        if self.gap is not None:
            return resolve(self.gap, points, 1, name="gap")
        gap = (points.gap if self.interference else points.clearance)[:, None]
        depth = -float(gap.min())
        if not self.interference and depth > TOUCHING * np.sqrt(points.area):
            raise SceneError(
                f"interface {points.name!r}: the faces are meshed inside each other, by up to {depth:.4g}: "
                "fix the geometry, give the gap, or pass interference=True if that is meant"
            )
        return gap

    def check_faces(self, points: Points, sag: Array, chords: Array, apart: float = 0.0) -> None:
        if self.gap is not None or len(points.sides) == 1:
            return
        if not self.interference:
            self._check_gap(points, chords)
            if apart:
                how = "apart by" if apart > 0.0 else "inside each other by"
                warn(
                    f"interface {points.name!r}: the faces are meshed {how} about {abs(apart):.3g}, which is "
                    "less than half of what curved facets may be beside the round faces that they stand for "
                    f"({sag.max():.3g}): they are taken as touching; state it, gap={apart:.3g} (gap=0.0 for "
                    "faces that fit), or use smaller cells, which tell it",
                    SceneWarning,
                )
            return
        deepest = int(np.argmin(points.gap))
        depth, beside = -float(points.gap[deepest]), float(sag[points.gap < 0.0].max(initial=0.0))
        if depth <= 0.0 or beside <= UNCERTAIN * depth:
            return
        what = (
            f"interface {points.name!r}: the faces are meshed inside each other by up to {depth:.4g}, and "
            f"the cells' facets are up to {beside:.4g} beside the round faces that they stand for"
        )
        remedy = f"{CURVED}, or smaller ones, or state the interference, gap=-..."
        if beside > USELESS * depth:
            raise SceneError(f"{what}: the mesh cannot tell the interference; {remedy}")
        warn(
            f"{what}: the interference is uncertain by {100.0 * beside / depth:.2g} %; {remedy}",
            SceneWarning,
        )

    def _check_gap(self, points: Points, chords: Array) -> None:
        """Refuse distances of round faces of which all that is meshed may be that of chords."""
        size = float(np.abs(points.gap).max())
        if np.all(np.abs(points.gap) <= chords) and size > TOUCHING * np.sqrt(points.area):
            raise SceneError(
                f"interface {points.name!r}: the distance of the faces as meshed, {points.gap.min():.3g} to "
                f"{points.gap.max():.3g}, is not more than the distance of straight facets from the round "
                f"faces that they stand for, up to {chords.max():.3g}: the mesh cannot tell a gap or an "
                f"interference from a fit; state it, gap=0.0 for faces that fit, or {CURVED}"
            )

    def holds(self, dim: int) -> tuple[bool, ...]:
        # as long as it is closed; whether it is, only the solution tells
        return (True,) + (self.rubs,) * (dim - 1)

    def held_rows(self, points: Points) -> Array:
        rows = super().held_rows(points)
        if self.rubs:
            bounds = [resolve(v, points, 1, name=n) for n, v in self.given("friction", "threshold").items()]
            rows[:, 1:] *= np.any(bounds, axis=0)[:, :, None]
        return rows
