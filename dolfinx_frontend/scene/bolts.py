"""Stiffness of a bolt from cylinders, as VDI 2230 takes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from dolfinx_frontend.common.checks import checked_number
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.values import is_uncertain

__all__ = ["BoltStiffness"]


@dataclass(frozen=True)
class BoltStiffness:
    """Stiffness of a bolt as a beam between head and nut.

    Attributes
    ----------
    axial
        Force / length.
    bending, torsion
        E I / L and G J / L, force * length. All three may be random.
    length
        Clamped, to be compared with how far the faces of a beam are apart; None: it is not.
    """

    axial: Any
    bending: Any
    torsion: Any
    length: float | None = None

    def __post_init__(self) -> None:
        if self.length is not None:
            checked_number("BoltStiffness", "length", self.length, least=0.0)
        for name, value in (("axial", self.axial), ("bending", self.bending), ("torsion", self.torsion)):
            if not is_uncertain(value):
                checked_number("BoltStiffness", name, value, above=0.0)

    @classmethod
    def of_cylinders(
        cls, cylinders: Sequence[tuple[float, float]], E: float, nu: float = 0.3
    ) -> BoltStiffness:
        """Of cylinders one after the other, each a (length, diameter)."""
        checked_number("BoltStiffness", "E", E, above=0.0)
        checked_number("BoltStiffness", "nu", nu, above=-1.0, most=0.5)
        if not cylinders:
            raise SceneError("BoltStiffness: cylinders = []: give (length, diameter) of one at least")
        area, inertia = 0.0, 0.0
        for each in cylinders:
            if len(each) != 2:
                raise SceneError(f"BoltStiffness: cylinder {short(each)}; give (length, diameter)")
            length = checked_number("BoltStiffness", "length", each[0], least=0.0)
            d = checked_number("BoltStiffness", "diameter", each[1], above=0.0)
            area += length / (0.25 * math.pi * d**2)
            inertia += length / (math.pi * d**4 / 64.0)
        if area == 0.0:
            raise SceneError("BoltStiffness: its cylinders have no length; give one that is > 0")
        return cls(E / area, E / inertia, E / (1.0 + nu) / inertia)

    @classmethod
    def vdi2230(
        cls, d: float, pitch: float, shank: float, thread: float, E: float, nu: float = 0.3, nut: bool = True
    ) -> BoltStiffness:
        """A bolt with a hexagon head by VDI 2230: shank and free thread, with what head, engaged thread and
        nut yield: 0.5 d at the nominal diameter, 0.5 d at the minor one, 0.4 d (a tapped hole: 0.33 d) at the
        nominal one.

        Parameters
        ----------
        d, pitch
            Nominal diameter and pitch; the minor diameter is d - 1.22687 pitch.
        shank, thread
            Clamped lengths without and with thread.
        """
        checked_number("BoltStiffness", "d", d, above=0.0)
        checked_number("BoltStiffness", "pitch", pitch, least=0.0, below=d / 1.22687)
        minor = d - 1.22687 * pitch
        end = 0.4 * d if nut else 0.33 * d
        cylinders = [(0.5 * d, d), (shank, d), (thread, minor), (0.5 * d, minor), (end, d)]
        return replace(cls.of_cylinders(cylinders, E, nu), length=shank + thread)
