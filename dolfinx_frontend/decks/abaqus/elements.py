"""Element types of decks: cells, order, faces, and the nodes in the order in which parts are assembled.

Elements of 8 nodes in the plane and of 20 in space get the nodes at the middle of their faces and cells that
Lagrange cells have, where their own shape functions put them: the geometry is the same.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp

__all__ = [
    "CORNERS", "EDGES", "FACES", "KINDS", "REFERENCE_NODES", "RODS", "Kind", "face_nodes", "listed",
    "middles",
]


class Kind(NamedTuple):
    """An element type: cell, nodes, degree of the displacements, plane, what is changed."""

    cell: str
    nodes: int
    degree: int
    plane: str = ""
    changed: str = ""

    @property
    def order(self) -> int:
        """Of the geometry."""
        return 1 if self.nodes == CORNERS[self.cell] else 2

    @property
    def dim(self) -> int:
        """Space dimension."""
        return 2 if self.plane else 3

    @property
    def gmsh(self) -> int:
        """The type under which its nodes are handed on."""
        return _GMSH[self.cell][self.order - 1]


CORNERS = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
_GMSH = {"triangle": (2, 9), "quadrilateral": (3, 10), "tetrahedron": (4, 11), "hexahedron": (5, 12)}

_REDUCED = "integrated fully"
_BENDS = "integrated fully, with quadratic displacements in place of incompatible modes or hourglass control"
_LAGRANGE = "its displacements have the nodes at the middle of faces and cells, too"


def _kinds() -> dict[str, Kind]:
    found = {
        "C3D4": Kind("tetrahedron", 4, 1),
        "C3D10": Kind("tetrahedron", 10, 2),
        "C3D10M": Kind("tetrahedron", 10, 2, changed="read as C3D10"),
        "C3D8": Kind("hexahedron", 8, 1),
        "C3D8R": Kind("hexahedron", 8, 2, changed=_BENDS),
        "C3D8I": Kind("hexahedron", 8, 2, changed=_BENDS),
        "C3D20": Kind("hexahedron", 20, 2, changed=_LAGRANGE),
        "C3D20R": Kind("hexahedron", 20, 2, changed=f"{_REDUCED}; {_LAGRANGE}"),
    }
    for name, plane in (("CPS", "stress"), ("CPE", "strain"), ("CAX", "axisymmetric")):
        found |= {
            f"{name}3": Kind("triangle", 3, 1, plane),
            f"{name}6": Kind("triangle", 6, 2, plane),
            f"{name}4": Kind("quadrilateral", 4, 1, plane),
            f"{name}4R": Kind("quadrilateral", 4, 2, plane, _BENDS),
            f"{name}4I": Kind("quadrilateral", 4, 2, plane, _BENDS),
            f"{name}8": Kind("quadrilateral", 8, 2, plane, _LAGRANGE),
            f"{name}8R": Kind("quadrilateral", 8, 2, plane, f"{_REDUCED}; {_LAGRANGE}"),
        }
    return found


KINDS = _kinds()
RODS = ("T3D2", "B31")
REFERENCE_NODES = {"DCOUP3D": 1, "MASS": 1, "SPRING1": 1} | dict.fromkeys(
    ("SPRINGA", "SPRING2", "GAPUNI", *RODS), 2
)
"""Nodes of elements that are no solids: of couplings, springs, gaps, rods of pre-tension sections."""

FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)
    ),
}
"""Corners of the faces S1, S2, ... of a cell."""

EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)
    ),
}
"""Ends of the edges whose middles follow the corners."""

_HANDED_ON = {
    "tetrahedron": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hexahedron": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14, 20, 22, 25, 23, 24, 21, 26],
}
"""Order in which the nodes of cells of order 2 are handed on; middles of faces are as in `FACES`."""


def listed(values: Ints | Array) -> Any:
    """An array as lists of plain numbers."""
    return values.tolist()


@cache
def face_nodes(kind: Kind) -> list[list[int]]:
    """Places of the nodes on each face, corners first."""
    if kind.order == 1:
        return [list(face) for face in FACES[kind.cell]]
    first = CORNERS[kind.cell]
    edges = EDGES[kind.cell]
    return [
        [*face, *(first + k for k, ends in enumerate(edges) if set(ends) <= set(face))]
        for face in FACES[kind.cell]
    ]


def middles(
    blocks: list[tuple[Kind, Ints]], count: int
) -> tuple[list[Ints], sp.csr_matrix, dict[tuple[int, ...], int]]:
    """Nodes of all elements as they are handed on, with those that are added.

    Parameters
    ----------
    blocks
        Kind, and rows of nodes (elements, nodes).
    count
        Nodes that there are.

    Returns
    -------
    tuple
        Rows of nodes of each block; a matrix (added, count) that takes what is linear in the nodes to those
        that are added; corners of a face, sorted -> the node at its middle.
    """
    out: list[Ints] = []
    parents: list[Ints] = []
    weights: list[Array] = []
    centres: dict[tuple[int, ...], int] = {}
    total = count
    for kind, rows in blocks:
        if kind.order == 1 or kind.cell in ("triangle", "tetrahedron"):
            order = _HANDED_ON.get(kind.cell) if kind.order == 2 else None
            out.append(rows if order is None else rows[:, order])
            continue
        columns = [rows]
        if kind.cell == "hexahedron":
            faces = face_nodes(kind)
            of_faces = np.empty((len(rows), 6), dtype=np.int64)
            for e, nodes in enumerate(listed(rows)):
                for f, places in enumerate(faces):
                    key = tuple(sorted(nodes[p] for p in places[:4]))
                    if key not in centres:
                        centres[key] = total
                        total += 1
                        parents.append(rows[e, places])
                        weights.append(np.repeat([-0.25, 0.5], 4))
                    of_faces[e, f] = centres[key]
            columns.append(of_faces)
        inside = CORNERS[kind.cell]
        columns.append(np.arange(total, total + len(rows))[:, None])
        total += len(rows)
        parents += list(rows)
        weights += [np.where(np.arange(kind.nodes) < inside, -0.25, 0.25 if inside == 8 else 0.5)] * len(rows)
        whole = np.concatenate(columns, axis=1)
        out.append(whole[:, _HANDED_ON[kind.cell]] if kind.cell in _HANDED_ON else whole)
    lengths = [len(p) for p in parents]
    row = np.repeat(np.arange(len(parents)), lengths)
    entries = (np.concatenate([np.zeros(0), *weights]), (row, np.concatenate([np.zeros(0, int), *parents])))
    return out, sp.csr_matrix(entries, shape=(total - count, count)), centres
