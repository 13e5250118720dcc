"""A meshed gmsh model as arrays, to be handed from one process to another. Without dolfinx."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Meshed", "checked", "meshed"]


@dataclass(frozen=True)
class Meshed:
    """Cells and facets of the physical groups of a model.

    Attributes
    ----------
    dim
        Dimension of the parts.
    x
        (nodes, 3), coordinates.
    cells
        Part -> gmsh element type -> nodes of its elements, rows of `x`, (elements, nodes).
    facets
        Face -> the same for the elements one dimension lower.
    kinds
        gmsh element type -> its name.
    """

    dim: int
    x: Array
    cells: dict[str, dict[int, Ints]]
    facets: dict[str, dict[int, Ints]]
    kinds: dict[int, str]


def meshed(model: Any) -> Meshed:
    """The physical groups of ``gmsh.model``, see :func:`from_gmsh`.

    Raises
    ------
    SceneError
        No group of volumes or surfaces, groups without a name or of the same name, a face without its part,
        elements with nodes that do not exist or come twice, coordinates that are not finite.
    """
    groups = model.getPhysicalGroups()
    dim = max((d for d, _ in groups), default=-1)
    if dim < 2:
        raise SceneError(
            "the gmsh model has no physical group of volumes or, in 2D, of surfaces; name every "
            "part with addPhysicalGroup(dim, tags, name=...)"
        )
    entities: dict[int, dict[str, Sequence[int]]] = {dim: {}, dim - 1: {}}
    for d, tag in groups:
        if d < dim - 1:
            continue
        name = model.getPhysicalName(d, tag)
        if not name or name in entities[d]:
            raise SceneError(
                f"physical group {tag} of dimension {d} has the name {name!r}; every group needs "
                "a name of its own: addPhysicalGroup(dim, tags, name=...)"
            )
        entities[d][name] = model.getEntitiesForPhysicalGroup(d, tag)
    cells, facets = entities[dim], entities[dim - 1]
    for name in facets:
        if ":" in name and name.partition(":")[0] not in cells:
            raise SceneError(
                f"the face {name!r} belongs to no part; the parts are: {', '.join(cells)}"
            )
    tags, x, _ = model.mesh.getNodes()
    order = np.argsort(tags)
    ordered = tags[order]

    def row(nodes: Any) -> Ints:
        """Row in `x` of each node, -1 for what is none; numbers of nodes may have gaps, and be large."""
        at = np.minimum(np.searchsorted(ordered, nodes), tags.size - 1)
        found: Ints = np.where(ordered[at] == nodes, order[at], -1) if tags.size else np.full(nodes.shape, -1)
        return found

    x = np.array(x, dtype=np.float64).reshape(-1, 3)
    kinds: dict[int, str] = {}

    def found(d: int, groups: dict[str, Sequence[int]]) -> dict[str, dict[int, Ints]]:
        return {name: _elements(model, d, tags, row, kinds) for name, tags in groups.items()}

    return checked(Meshed(dim, x, found(dim, cells), found(dim - 1, facets), kinds))


def checked(out: Meshed) -> Meshed:
    """The same; what makes no mesh is refused."""
    for what, groups in (("part", out.cells), ("face", out.facets)):
        for name, blocks in groups.items():
            for nodes in blocks.values():
                _check(nodes, out.x, f"the {what} {name!r}")
    for name, blocks in out.cells.items():
        for kind, nodes in blocks.items():
            if count := len(nodes) - len(np.unique(_keys(nodes))):  # dolfinx may end the process for them
                raise SceneError(f"the part {name!r}: {count} cells have the nodes of others; mesh it again")
            if kind in _FACETS and (count := _crowded(nodes, _FACETS[kind])):
                raise SceneError(
                    f"the part {name!r}: {count} facets belong to more than two cells; mesh it again"
                )
            if kind in _MIDDLES and (count := _torn(nodes, _MIDDLES[kind])):
                raise SceneError(
                    f"the part {name!r}: {count} nodes on edges are not those of the cells beside; mesh it "
                    "again"
                )
    return out


def _elements(
    model: Any,
    dim: int,
    entities: Sequence[int],
    row: Callable[[Any], Ints],
    kinds: dict[int, str],
) -> dict[int, Ints]:
    """gmsh element type -> nodes of its elements on these entities, (elements, nodes)."""
    found: dict[int, list[Ints]] = {}
    for entity in entities:
        types, _, nodes = model.mesh.getElements(dim, entity)
        for kind, tags in zip(types, nodes, strict=True):
            kinds[int(kind)], _, _, width, _, _ = model.mesh.getElementProperties(kind)
            found.setdefault(int(kind), []).append(row(tags).reshape(-1, width))
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_QUADRILATERAL = ((0, 1), (1, 2), (2, 3), (3, 0))
_TETRAHEDRON = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
_HEXAHEDRON = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_FACETS = {
    2: _TRIANGLE,
    9: _TRIANGLE,
    3: _QUADRILATERAL,
    10: _QUADRILATERAL,
    4: _TETRAHEDRON,
    11: _TETRAHEDRON,
    5: _HEXAHEDRON,
    12: _HEXAHEDRON,
}
"""gmsh element type -> corners of its facets."""


_MIDDLES: dict[int, tuple[tuple[int, ...], ...]] = {
    9: _TRIANGLE,
    10: (*_QUADRILATERAL, (0, 1, 2, 3)),
    11: ((0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)),
    12: (
        *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
        (0, 1, 2, 3, 4, 5, 6, 7),
    ),
}
"""gmsh element type of second order -> corners that each of its other nodes is in the middle of."""


def _keys(corners: Ints) -> Ints:
    """One number per row, whatever the order in it.

    Random numbers of the nodes are added, modulo 2^64: rows of other nodes have the same sum by chance only.
    """
    names = np.random.default_rng(0).integers(-(2**62), 2**62, size=int(corners.max(initial=0)) + 1)
    keys: Ints = names[corners].sum(axis=1)
    return keys


def _crowded(cells: Ints, facets: Sequence[Sequence[int]]) -> int:
    """Number of facets of more than two cells."""
    _, counts = np.unique(_keys(cells[:, facets].reshape(-1, len(facets[0]))), return_counts=True)
    return int(np.count_nonzero(counts > 2))


def _torn(cells: Ints, middles: Sequence[tuple[int, ...]]) -> int:
    """Number of nodes of second order in the middle of two edges or faces, or sharing the middle of one."""
    first = cells.shape[1] - len(middles)
    keys = np.concatenate([_keys(cells[:, list(corners)]) for corners in middles])
    nodes = cells[:, first:].T.reshape(-1)
    pairs = np.unique(np.column_stack([keys, nodes]), axis=0)
    several = len(pairs) - len(np.unique(pairs[:, 0])) + len(pairs) - len(np.unique(pairs[:, 1]))
    return int(several + np.intersect1d(nodes, cells[:, :first]).size)


def _check(rows: Ints, x: Array, where: str) -> None:
    """Refuse elements that are none: dolfinx may end the process for them."""
    if rows.size and rows.min() < 0:
        count = np.count_nonzero(rows.min(axis=1) < 0)
        raise SceneError(f"{where} has {count} cells with nodes that the mesh does not have; mesh it again")
    ordered = np.sort(rows, axis=1)
    if twice := np.count_nonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1)):
        raise SceneError(f"{where} has {twice} cells with the same node twice; mesh it again")
    if not np.isfinite(x[rows]).all():
        raise SceneError(f"{where} has nodes with coordinates that are not finite; mesh it again")
