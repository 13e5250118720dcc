"""How large cells should be, and how many there will be, before anything is meshed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.geometry.solids import POINTS_OF_EDGES, Solid

__all__ = ["SETTINGS", "faces_and_bulk", "forecast"]


@dataclass(frozen=True)
class Settings:
    """Numbers that meshes of gmsh have, of parts of assemblies with 8 cells around circles."""

    triangle: float = math.sqrt(3.0) / 4.0
    """Area of a triangle over the square of its edges."""
    bulk: float = 6.0
    """Tetrahedra inside, times the cube of the size over the volume."""
    skin: float = 2.0
    """Tetrahedra at a triangle of a face."""


SETTINGS = Settings()


def faces_and_bulk(solid: Solid, size: float, local: Mapping[int, float], per_turn: int) -> tuple[float, float]:
    """Triangles on the faces of a part, and its volume over the cube of the size of its cells.

    Parameters
    ----------
    size, local
        Largest cells of the part, and by number of faces: length.
    per_turn
        Cells around a full circle.
    """
    count = 0.0
    for surface in solid.surfaces:
        own = min(size, local.get(surface.tag, size))
        turn = 2.0 * math.pi * (surface.radius or math.inf) / per_turn
        rim = sum(_segments(curve, own, per_turn) for curve in surface.rim.reshape(-1, POINTS_OF_EDGES, 3))
        count += max(rim, surface.area / (SETTINGS.triangle * min(own, turn) * own))
    return count, solid.volume / size**3


def _segments(curve: Array, size: float, per_turn: int) -> int:
    """Into how many an edge is divided, by its length and by how far it turns."""
    chords = np.diff(curve, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    if not lengths.all():
        return 0
    cosines = np.einsum("ki,ki->k", chords[1:], chords[:-1]) / (lengths[1:] * lengths[:-1])
    turn = float(np.arccos(np.clip(cosines, -1.0, 1.0)).mean()) * len(lengths)
    return max(1, math.ceil(max(lengths.sum() / size, per_turn * turn / (2.0 * math.pi)) - 0.05))


def forecast(
    solid: Solid, size: float, local: Mapping[int, float], per_turn: int = 8, degree: int = 2
) -> tuple[int, int]:
    """Cells and unknowns of a part, as :func:`faces_and_bulk`."""
    triangles, bulk = faces_and_bulk(solid, size, local, per_turn)
    cells = SETTINGS.bulk * bulk + SETTINGS.skin * triangles
    return round(cells), 0
