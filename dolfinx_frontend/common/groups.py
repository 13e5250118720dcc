"""Groups of things that are connected in pairs."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.common.deferred import sp

__all__ = ["group_labels", "grouped", "on_shortest_ways"]

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


def on_shortest_ways(
    things: Sequence[T],
    joints: Mapping[str, Sequence[T]],
    glue: Iterable[Sequence[T]],
    ends: Sequence[T],
) -> tuple[dict[str, tuple[int, int]], tuple[int, int]]:
    """Joints on the shortest ways from one thing to another, where what is glued is one.

    Returns
    -------
    ways, ends
        Joint -> numbers of the groups on its sides; those of the ends.
    """
    groups = grouped(things, [(a, b) for a, b in glue])
    label = {thing: k for k, members in enumerate(groups) for thing in members}
    links = {name: (label[a], label[b]) for name, (a, b) in joints.items()}
    first, last = label[ends[0]], label[ends[1]]
    near, far = (_distances(list(links.values()), each) for each in (first, last))
    whole = near.get(last, 0)

    def through(a: int, b: int) -> bool:
        return near.get(a, np.inf) + far.get(b, np.inf) + 1 == whole

    return {name: (a, b) for name, (a, b) in links.items() if through(a, b) or through(b, a)}, (first, last)


def _distances(links: Sequence[tuple[int, int]], start: int) -> dict[int, int]:
    """Group -> number of links between it and the first one."""
    found, border = {start: 0}, [start]
    while border:
        here = border.pop(0)
        for pair in links:
            for a, b in (pair, pair[::-1]):
                if a == here and b not in found:
                    found[b] = found[here] + 1
                    border.append(b)
    return found
