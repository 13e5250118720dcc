"""Groups of things that are connected in pairs."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.common.deferred import sp

__all__ = ["distances", "group_labels", "grouped"]

T = TypeVar("T", bound=Hashable)


def group_labels(count: int, pairs: npt.ArrayLike) -> Ints:
    """Group of each of `count` things.

    Parameters
    ----------
    pairs
        (n, 2) numbers of two things that are connected.

    Returns
    -------
    NDArray
        (count,); groups are numbered 0, 1, ... in the order of their first members.
    """
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    first, second = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
    graph = sp.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    _, found = sp.csgraph.connected_components(graph, directed=False)
    _, at = np.unique(found, return_index=True)
    order = np.argsort(np.argsort(at))  # scipy does not promise an order
    return np.asarray(order[found], dtype=np.int64)


def grouped(things: Sequence[T], pairs: Iterable[tuple[T, T]]) -> list[list[T]]:
    """Things by group: groups in the order of their first members, members in the order given."""
    number = {thing: k for k, thing in enumerate(things)}
    label = group_labels(len(number), [(number[a], number[b]) for a, b in pairs])
    groups: list[list[T]] = [[] for _ in range(int(label.max(initial=-1)) + 1)]
    for thing, k in number.items():
        groups[label[k]].append(thing)
    return groups


def distances(pairs: Iterable[tuple[T, T]], start: T) -> dict[T, int]:
    """Thing -> number of pairs between it and the first one, of those that are connected with it."""
    links = list(pairs)
    found, border = {start: 0}, [start]
    while border:
        here = border.pop(0)
        for pair in links:
            for a, b in (pair, pair[::-1]):
                if a == here and b not in found:
                    found[b] = found[here] + 1
                    border.append(b)
    return found
