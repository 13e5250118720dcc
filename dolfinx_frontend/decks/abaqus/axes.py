"""Local axes of a deck, of *ORIENTATION, *TRANSFORM and *SYSTEM: rectangular, or along a cylinder."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.cards import Card

__all__ = ["Axes", "axes_of", "turning"]

_PARALLEL = 1e-9
"""Sine of an angle between vectors that are one direction."""


def turning(axis: Array, degrees: float) -> Array:
    """(3, 3), turns vectors about a unit axis."""
    a, b, c = axis
    cross: Array = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    angle = math.radians(degrees)
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


class Axes(NamedTuple):
    """Rows (3, 3) of the axes 1, 2, 3; round a cylinder those at `origin`, if 1 pointed along the first row;
    `extra` turns them about themselves."""

    rows: Array
    origin: Array
    round: bool
    extra: Array

    def at(self, x: Array) -> Array:
        """Rows at a point: radial, tangential and axial of a cylinder."""
        rows = self.rows
        if self.round:
            arm = x - self.origin
            radial = arm - (arm @ rows[2]) * rows[2]
            size = float(np.linalg.norm(radial))
            if size > _PARALLEL * max(float(np.linalg.norm(arm)), 1e-300):
                rows = np.array([radial / size, np.cross(rows[2], radial / size), rows[2]])
        return self.extra @ rows


def axes_of(card: Card, turn: Array | None = None, shift: Array | None = None) -> Axes:
    """Axes of a card, of an instance that is turned and shifted."""
    kind = (card.get("SYSTEM", "TYPE") or "R").removesuffix("ECTANGULAR").removesuffix("YLINDRICAL")
    if kind not in ("R", "C"):
        raise card.error(f"axes of the kind {kind!r} are not read; give RECTANGULAR or CYLINDRICAL")
    if not card.rows:
        raise card.error("its points are missing; give two in the next line")
    row, extra = card.rows[0], np.eye(3)
    count = 9 if kind == "R" and len(row.words) > 6 else 6
    points: Array = np.array(card.numbers(row, count, "coordinate")).reshape(-1, 3)
    if len(card.rows) > 1:
        about = card.whole(card.rows[1], 0, "axis", default=1)
        if about > 3:
            raise card.error(f"axis {about}; give 1, 2 or 3", card.rows[1].where)
        extra = turning(np.eye(3)[about - 1], card.number(card.rows[1], 1, "angle", 0.0)).T
    if turn is not None and shift is not None:
        # rectangular axes without an origin are directions
        points = points @ turn.T + (shift if kind == "C" or count > 6 else 0.0)
    if kind == "C":
        third = points[1] - points[0]
        helper = np.eye(3)[int(np.argmin(np.abs(third)))]
        origin, one, two = points[0], np.cross(helper, third), np.cross(third, np.cross(helper, third))
    else:
        origin = points[2] if len(points) > 2 else np.zeros(3)
        one = points[0] - origin
        third = np.cross(one, points[1] - origin)
        two = np.cross(third, one)
        if np.linalg.norm(third) <= _PARALLEL * np.linalg.norm(one) * np.linalg.norm(points[1] - origin):
            raise card.error("its points lie on one line with the origin; give others", row.where)
    rows: Array = np.array([one, two, third])
    sizes = np.linalg.norm(rows, axis=1)
    if not sizes.min() > 0.0:
        raise card.error("its axis has no length; give two points", row.where)
    return Axes(rows / sizes[:, None], origin, kind == "C", extra)
