"""Nodes and elements that a deck generates, and places in coordinates that are not Cartesian."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.decks.abaqus.cards import Card, Row

__all__ = ["copies", "count", "filled", "place_of", "system_of"]

_MOST = 50_000_000
"""Members that GENERATE and the like may make; more is a slip."""


def count(card: Card, row: Row, first: int, last: int, step: int) -> int:
    """Members of an arithmetic series."""
    if last < first:
        raise card.error(f"the last, {last}, is below the first, {first}; exchange them", row.where)
    found = (last - first) // step + 1
    _check(card, row, found)
    return found


def _check(card: Card, row: Row, found: int) -> None:
    if found > _MOST:
        raise card.error(f"{found} members; give no more than {_MOST}", row.where)


def filled(
    card: Card, row: Row, ends: list[tuple[int, list[float], list[float]]]
) -> Iterator[tuple[int, list[float]]]:
    """Numbers and places between ends: number of the first, its place, and that of the second."""
    intervals, step = card.whole(row, 2, "number of intervals"), card.whole(row, 3, "increment", default=1)
    _check(card, row, intervals * max(len(ends), 1))
    for number, a, b in ends:
        for k in range(1, intervals):
            x = np.array(a) + (np.array(b) - a) * (k / intervals)
            yield number + k * step, [float(v) for v in x]


def copies(card: Card, row: Row) -> Iterator[tuple[int, int]]:
    """What is added to the numbers of an element and of its nodes, of all copies but the element itself."""
    ranges = []
    for k in range(1, max(len(row.words), 4), 3):
        number = card.whole(row, k, "number of elements", default=1)
        nodes = card.whole(row, k + 1, "increment of nodes", default=1)
        ranges.append((number, nodes, card.whole(row, k + 2, "increment of elements", default=1)))
    if len(ranges) > 3:
        raise card.error("a row, a layer and a block at most; take the rest out", row.where)
    _check(card, row, math.prod(number for number, _, _ in ranges))
    for index in np.ndindex(*(number for number, _, _ in ranges)):
        if any(index):
            yield (
                sum(i * element for i, (_, _, element) in zip(index, ranges)),
                sum(i * node for i, (_, node, _) in zip(index, ranges)),
            )


def place_of(x: list[float], kind: str) -> list[float]:
    """Cartesian coordinates of radius, angle (degrees) and height, or of radius and two angles."""
    if kind == "R":
        return x
    around = math.radians(x[1])
    radius, height = x[0], x[2]
    if kind == "S":
        up = math.radians(x[2])
        radius, height = x[0] * math.cos(up), x[0] * math.sin(up)
    return [radius * math.cos(around), radius * math.sin(around), height]


def system_of(card: Card) -> tuple[Array, Array] | None:
    """Rows (3, 3) of the axes and origin (3,) in which nodes are given from here on; None: global."""
    if not card.rows:
        return None
    row = card.rows[0]
    origin, one = (np.array(card.numbers(row, 3, "coordinate", start)) for start in (0, 3))
    two = np.array(card.numbers(card.rows[1], 3, "coordinate")) - origin if len(card.rows) > 1 else None
    if not one.any() and two is None:
        return np.eye(3), origin
    first = one - origin
    if two is None:
        two = np.cross([0.0, 0.0, 1.0], first)
    rows: Array = np.array([first, np.cross(np.cross(first, two), first), np.cross(first, two)])
    sizes = np.linalg.norm(rows, axis=1)
    if not sizes.min() > 1e-9 * sizes.max():
        raise card.error("its points lie on one line; give others", row.where)
    return rows / sizes[:, None], origin
