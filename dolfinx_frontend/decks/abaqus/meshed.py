"""A part as a deck has it: nodes, elements, faces of elements, and forces on the nodes of these elements."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import basix
import numpy as np

from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.elements import CORNERS, EDGES, FACES, KINDS

__all__ = ["Meshed"]

_CORNERS = {
    "triangle": (0, 1, 2), "quadrilateral": (0, 1, 3, 2), "tetrahedron": (0, 1, 2, 3),
    "hexahedron": (0, 1, 3, 2, 4, 5, 7, 6),
}
"""Corners of an element among the vertices of a cell, which count along the axes."""

_MIRRORED = {
    "triangle": (0, 2, 1), "quadrilateral": (0, 3, 2, 1), "tetrahedron": (0, 2, 1, 3),
    "hexahedron": (4, 5, 6, 7, 0, 1, 2, 3),
}
"""Corners of an element that is inside out, the right way round."""

_AXES = {"triangle": (1, 2), "quadrilateral": (1, 3), "tetrahedron": (1, 2, 3), "hexahedron": (1, 3, 4)}
"""Corners whose edges from the first one make a right-handed frame."""


@dataclass(frozen=True)
class Meshed:
    """A part as a deck has it.

    Attributes
    ----------
    kind
        Element type.
    x
        (n, 3), nodes, those of the space of the part; of cells of 27 nodes not all belong to elements.
    elements
        (cells, nodes of an element).
    restriction
        (n, n), takes what is linear in a test function of the space, at its nodes, to those of the elements.
    """

    part: Substructure
    kind: str
    x: Array
    elements: Ints
    restriction: sp.csr_matrix
    _faces: dict[str, list[tuple[int, int]]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, part: Substructure, plane: str) -> Meshed:
        """Of an assembled part.

        Raises
        ------
        SceneError
            There is no element like its cells.
        """
        where = f"write_inp: substructure {part.name!r}"
        if not hasattr(part.part, "mesh"):
            raise SceneError(f"{where} is a matrix, which a deck of CalculiX cannot hold: leave it out")
        cell, degree = str(part.part.mesh.topology.cell_name()), int(part.space.element.basix_element.degree)
        wanted = (cell, degree, plane, "")
        kind = next((k for k, e in KINDS.items() if (e.cell, e.degree, e.plane) == wanted[:3]
                     and e.order == degree), None)
        if kind is None:
            raise SceneError(f"{where}: degree = {degree}: elements of a deck have degree 1 or 2")
        cells = np.asarray(part.space.dofmap.list, dtype=np.int64)
        x = np.zeros((len(part.dof_coordinates), 3))
        x[:, : part.dim] = part.dof_coordinates
        upright = _places(part.space, cell, degree, range(CORNERS[cell]))
        edges = x[cells[:, [upright[k] for k in _AXES[cell]]]] - x[cells[:, upright[0]]][:, None]
        elements = cells[:, upright]
        inside_out = np.linalg.det(edges[:, :, : part.dim]) < 0.0
        elements[inside_out] = cells[inside_out][:, _places(part.space, cell, degree, _MIRRORED[cell])]
        return cls(part, kind, x, elements, _restriction(part.space, cell, degree, cells, len(x)))

    def faces(self, face: str) -> list[tuple[int, int]]:
        """Element and number of its side, counted from 1, of each facet of a named face."""
        return self._faces[face] if face in self._faces else self._faces.setdefault(face, self._found(face))

    def size(self, face: str) -> float:
        """Length of the edges of the facets of a face: the median."""
        cell = str(self.part.part.mesh.topology.cell_name())
        ends = [self.elements[e][list(FACES[cell][side - 1][:2])] for e, side in self.faces(face)]
        edges = np.diff(self.x[np.array(ends)], axis=1)[:, 0]
        return float(np.median(np.linalg.norm(edges, axis=1)))

    def _found(self, face: str) -> list[tuple[int, int]]:
        mesh, tags = self.part.part.mesh, self.part.part.facet_tags
        top = mesh.topology
        d = top.dim
        for pair in ((d - 1, d), (d - 1, 0), (d, 0)):
            top.create_connectivity(*pair)
        to_cell, to_vertex, of_cell = (top.connectivity(*p) for p in ((d - 1, d), (d - 1, 0), (d, 0)))
        cell = str(top.cell_name())
        kept, space = len(_CORNERS[cell]), self.part.space
        at_vertex = _at_entities(space, 0)
        found = []
        for facet in tags.find(self.part.part.names[face]):
            owner = int(to_cell.links(facet)[0])
            vertices = list(of_cell.links(owner))
            of_space = space.dofmap.cell_dofs(owner)
            nodes = {int(of_space[at_vertex[vertices.index(v)]]) for v in to_vertex.links(facet)}
            corners = [int(n) for n in self.elements[owner, :kept]]
            sides = [{corners[k] for k in side} for side in FACES[cell]]
            found.append((owner, sides.index(nodes) + 1))
        return found


def _at_entities(space: Any, dim: int) -> list[int]:
    """Places of the nodes on the vertices, or in the middle of edges, of a cell."""
    return [int(each[0]) for each in space.element.basix_element.entity_dofs[dim]]


def _places(space: Any, cell: str, degree: int, corners: Any) -> list[int]:
    """Places of the nodes of an element among those of a cell; `corners` in the order of the element."""
    vertices = [_CORNERS[cell][k] for k in corners]
    of_vertex = _at_entities(space, 0)
    places = [of_vertex[v] for v in vertices]
    if degree == 2:
        edges = [set(each) for each in basix.topology(basix.CellType[cell])[1]]
        middle = _at_entities(space, 1)
        places += [middle[edges.index({vertices[a], vertices[b]})] for a, b in EDGES[cell]]
    return places


def _restriction(space: Any, cell: str, degree: int, cells: Ints, count: int) -> sp.csr_matrix:
    """Of nodes at the middle of faces and cells, which elements of 8 and 20 nodes lack, to the others."""
    if degree == 1 or cell in ("triangle", "tetrahedron"):
        return sp.identity(count, format="csr")
    topology = basix.topology(basix.CellType[cell])
    edges = [set(each) for each in topology[1]]
    at, middle = _at_entities(space, 0), _at_entities(space, 1)
    rows, columns, weights, lacking = [], [], [], np.zeros(count, dtype=bool)
    for dim in range(2, len(topology)):
        for own, vertices in zip(_at_entities(space, dim), topology[dim], strict=True):
            inside = [middle[k] for k, edge in enumerate(edges) if edge <= set(vertices)]
            nodes, first = np.unique(cells[:, own], return_index=True)
            new = ~lacking[nodes]  # of a face the cell on its other side may have come before
            nodes, first = nodes[new], first[new]
            lacking[nodes] = True
            for parents, weight in (([at[v] for v in vertices], -0.25), (inside, 0.5 if dim == 2 else 0.25)):
                rows += [cells[first][:, p] for p in parents]
                columns += [nodes] * len(parents)
                weights += [np.full(len(nodes), weight)] * len(parents)
    kept = np.flatnonzero(~lacking)
    places = np.concatenate([kept, *rows]), np.concatenate([kept, *columns])
    return sp.csr_matrix((np.concatenate([np.ones(len(kept)), *weights]), places), (count, count))
