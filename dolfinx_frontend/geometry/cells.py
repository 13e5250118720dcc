"""How large cells should be, and how many there will be, before anything is meshed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.geometry.solids import POINTS_OF_EDGES, Solid

__all__ = ["fineness", "forecast", "layer", "ring_width"]


@dataclass(frozen=True)
class Settings:
    """Of meshes that gmsh makes of parts, with 0.35 to 1 of their thickness as size of cells."""

    triangle: float = math.sqrt(3.0) / 4.0
    """Area of a triangle over the square of its edges."""
    bulk: float = 2.2
    """Tetrahedra inside, times the cube of their size over the volume."""
    skin: float = 1.7
    """Tetrahedra at a triangle of a face."""
    nodes: tuple[float, float] = (1.28, 1.8)
    """Nodes of degree 2 for a tetrahedron, and for a triangle of a face."""
    accuracy: float = 0.05
    """Relative error of joints where cells are as large as their part is thick: the use of friction of the
    bracket's foot is 3 % off that with 0.6 of the size, the force of its bolts .1 %."""
    order: float = 2.0
    """Power of the size of cells with which such an error falls, of degree 2 beside edges of contact."""
    layer: float = 6.0
    """Size of the cells of a thin layer over its thickness: its stress hardly changes along it."""
    sizes: tuple[float, float] = (0.15, 2.0)
    """Least and greatest size of cells over the thickness: below, `solve(accuracy=)` refines where it
    matters; above, cells of walls are flat."""


SETTINGS = Settings()

ROUND = 0.05
"""Fraction of a piece by which an edge may be longer than its pieces: chords of an arc are shorter."""


def fineness(accuracy: float) -> float:
    """Size of cells over thickness for a relative accuracy of forces in the joints."""
    least, most = SETTINGS.sizes
    return min(most, max(least, math.pow(accuracy / SETTINGS.accuracy, 1.0 / SETTINGS.order)))


def layer(thickness: float) -> float:
    """Size of the cells of a thin flat part."""
    return SETTINGS.layer * thickness


def ring_width(solid: Solid, tags: Sequence[int]) -> float:
    """Width of the ring that faces of a part make up; of a face without a hole half of its width."""
    faces = [s for s in solid.surfaces if s.tag in tags]
    centre = sum(s.area * s.centre for s in faces) / sum(s.area for s in faces)
    reach = np.linalg.norm(np.concatenate([s.rim for s in faces]) - centre, axis=1)
    within = max(reach.max() ** 2 - sum(s.area for s in faces) / math.pi, 0.0)
    return float(reach.max() - math.sqrt(within))


def forecast(
    solid: Solid, size: float, local: Mapping[int, float], degree: int = 2, per_turn: int = 8
) -> tuple[float, float]:
    """Cells and unknowns that a mesh of a part will have, within a half of it.

    Parameters
    ----------
    size, local
        Largest cells of the part, and by number of faces: length.
    degree
        Of the displacement.
    per_turn
        Cells around a full circle.
    """
    triangles = 0.0
    for surface in solid.surfaces:
        own = min(size, local.get(surface.tag, size))
        turn = 2.0 * math.pi * (surface.radius or math.inf) / per_turn
        rim = sum(_segments(curve, own, per_turn) for curve in surface.rim.reshape(-1, POINTS_OF_EDGES, 3))
        triangles += max(rim, surface.area / (SETTINGS.triangle * min(own, turn) * own))
    cells = SETTINGS.bulk * solid.volume / size**3 + SETTINGS.skin * triangles
    nodes = SETTINGS.nodes[0] * cells + SETTINGS.nodes[1] * triangles
    return cells, 3.0 * nodes * (0.5 * degree) ** 3


def _segments(curve: Array, size: float, per_turn: int) -> int:
    """Into how many an edge is divided, by its length and by how far it turns."""
    chords = np.diff(curve, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    if not lengths.all():
        return 0
    cosines = np.einsum("ki,ki->k", chords[1:], chords[:-1]) / (lengths[1:] * lengths[:-1])
    turn = float(np.arccos(np.clip(cosines, -1.0, 1.0)).mean()) * len(lengths)
    return max(1, math.ceil(max(float(lengths.sum()) / size, per_turn * turn / (2.0 * math.pi)) - ROUND))
