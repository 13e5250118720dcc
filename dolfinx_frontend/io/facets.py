"""What acts on interfaces, over their facets."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, NamedTuple

import basix
import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.elements import tabulate
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.formats.vtk import CELLS, Grid, Values, vertices
from dolfinx_frontend.results.answer import Answer, check_answer, stepped
from dolfinx_frontend.results.contact import OPEN, SLIPS
from dolfinx_frontend.results.points import interface_fields
from dolfinx_frontend.scene.amplitudes import check_step

__all__ = ["InterfaceWriter", "corner_fields", "facet_fields", "vector_values"]


def vector_values(values: Array) -> Values:
    """Vectors (m, d) with three components."""
    out = np.zeros((len(values), 3))
    out[:, : values.shape[1]] = values
    return out, "XYZ"


def facet_fields(
    result: Answer, interface: str, step: int = -1
) -> tuple[npt.NDArray[np.int64], dict[str, Array]]:
    """What :func:`write_interfaces` writes on the facets of an interface, as arrays.

    Returns
    -------
    facets
        (k,), facets of the mesh of the side that carries the interface points, ascending.
    fields
        Name -> (k,) or (k, 3).

    Raises
    ------
    SceneError
        An interface that is unknown or whose force is not known, no such step.
    """
    check_answer("facet_fields", "result", result)
    check_known("interface with a known force", interface, result.known, "facet_fields")
    at = check_step(result.times, step, "facet_fields")
    described = result.problem.here(interface)
    side = described.sides[described.carrier]
    part = result.problem.substructures[side.substructure].part
    data = InterfaceWriter(result, interface).facets(at).cell_data
    numbers = np.sort(part.facet_tags.find(part.names[side.face])).astype(np.int64)
    return numbers[described.facets], {name: np.asarray(values) for name, (values, _) in data.items()}


def corner_fields(
    result: Answer, interface: str, step: int = -1
) -> tuple[npt.NDArray[np.int64], dict[str, Array]] | None:
    """The same at the vertices of the facets, where the interface has continuous fields (``"mortar"``).

    Returns
    -------
    facets
        (k,), as of :func:`facet_fields`.
    fields
        Name -> (k, vertices of a facet) or (k, vertices, d); ``"state"`` is that of the point of each vertex.
    """
    numbers, _ = facet_fields(result, interface, step)
    at = check_step(result.times, step, "corner_fields")
    vertices = result.problem.here(interface).vertices
    if vertices is None:
        return None
    out: dict[str, Array] = {}
    for name, values in interface_fields(result, interface).items():
        if name == "state":
            nearest = np.asarray(vertices.nodal.argmax(axis=1)).ravel()
            out[name] = values[at][nearest][vertices.corners]
        else:
            out[name] = (vertices.nodal @ values[at])[vertices.corners]
    return numbers, out


class _Surface(NamedTuple):
    """The covered facets of an interface, which are the same at all steps."""

    x: Array  # (nodes, 3), facet by facet
    cells: npt.NDArray[np.int64]  # (facets, nodes per facet)
    type: int  # of VTK
    trace: sp.csr_matrix  # (nodes, unknowns of a component of the displacement)
    mean: sp.csr_matrix  # (facets, points), by area
    area: Array  # (facets,)
    nodal: sp.csr_matrix | None  # (nodes, points): the field that is continuous, if there is one


class InterfaceWriter:
    """Grids of an interface of an answer: its points, and the facets of the side that they are on."""

    def __init__(self, answer: Answer, name: str) -> None:
        self._surface, self._fields = answer.surface(name), interface_fields(answer, name)
        self._interface = answer.problem.interfaces[name]
        self._side = side = self._interface.sides[self._interface.carrier]
        self._part = answer.problem.substructures[side.substructure]
        self._displacement: Array | None = None  # (T, n)
        if answer.without_displacements is None and side.shape is not None:
            self._displacement = stepped(answer.unknowns(side.substructure), answer.times)
        self._function: Callable[[Array], Any] = partial(answer.function, side.substructure, name="")

    def _data(self, step: int) -> dict[str, Values]:
        out: dict[str, Values] = {"area": (self._surface.weights, "")}
        for name, values in self._fields.items():
            now = values[step]
            if name == "state":
                out[name] = (now.astype(np.int64), "")
            else:
                out[name] = (now, "") if now.ndim == 1 else vector_values(now)
        return out

    def points(self, step: int) -> Grid:
        """The cloud of points."""
        data = self._data(step)
        if self._displacement is not None:
            nodal = self._displacement[step].reshape(-1, self._surface.dim)
            data["displacement"] = vector_values(self._side.shape @ nodal)
        return vertices(self._surface.points, data)

    @cached_property
    def _mesh(self) -> _Surface:
        part, interface = self._part, self._interface
        face = FacetMap(part.part, self._side.face, f"interface {interface.name!r}")
        covered = interface.facets
        cell, order = face.facet_cell.name, min(face.order, 2)
        nodes = _facet_nodes(cell, order)
        index, s = np.repeat(covered, len(nodes)), np.tile(nodes, (len(covered), 1))
        x = np.zeros((len(index), 3))
        x[:, : part.dim] = face.push_forward(index, s)[0]
        cells = np.arange(len(index), dtype=np.int64).reshape(-1, len(nodes))
        trace = face.trace(part.space, index, s, len(part.dof_coordinates))
        area = np.asarray(interface.areas.sum(axis=1)).ravel()
        mean = (sp.diags(1.0 / area) @ interface.areas).tocsr()
        nodal = None
        if interface.vertices is not None:
            element = basix.create_element(basix.ElementFamily.P, face.facet_cell, 1)
            values = tabulate(element, 0, nodes)[0]  # (nodes, vertices)
            of_facet = sp.kron(sp.identity(len(covered)), values, format="csr")
            corners = interface.vertices.corners.ravel()
            at = sp.csr_matrix(
                (np.ones(len(corners)), (np.arange(len(corners)), corners)),
                shape=(len(corners), interface.vertices.nodal.shape[0]),
            )
            nodal = (of_facet @ at @ interface.vertices.nodal).tocsr()
        return _Surface(x, cells, CELLS[cell, order], trace, mean, area, nodal)

    def facets(self, step: int) -> Grid:
        """The surface of the side that the points are on."""
        mesh = self._mesh
        point_data: dict[str, Values] = {}
        if mesh.nodal is not None:
            for name, (values, labels) in self._data(step).items():
                if name not in ("area", "state", "displacement"):
                    point_data[name] = (mesh.nodal @ values, labels)
        if self._displacement is not None:
            nodal = self._function(self._displacement[step]).x.array.reshape(-1, self._surface.dim)
            point_data["displacement"] = vector_values(mesh.trace @ nodal)
        return Grid(mesh.x, mesh.cells, mesh.type, point_data, self._on_facets(step))

    def _on_facets(self, step: int) -> dict[str, Values]:
        """Values of the facets: the means of their points; of one point what is there."""
        mean = self._mesh.mean
        single = mean.nnz == mean.shape[0] == mean.shape[1]
        out: dict[str, Values] = {"area": (self._mesh.area, "")}
        for name, (values, labels) in self._data(step).items():
            if name == "area":
                continue
            if single:
                out[name] = (values[mean.indices], labels)
            elif name == "state":
                out["open share"] = (mean @ (values == OPEN), "")
                out["slip share"] = (mean @ (values == SLIPS), "")
            else:
                out[name] = (mean @ values, labels)
        return out


def _facet_nodes(cell: str, order: int) -> Array:
    """Nodes of a facet in its reference coordinates, in VTK's order, (k, d - 1)."""
    corners = {
        "interval": [[0.0], [1.0]],
        "triangle": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
        "quadrilateral": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
    }[cell]
    nodes = np.array(corners)
    if order == 1:
        return nodes
    middles = 0.5 * (nodes + np.roll(nodes, -1, axis=0))
    if cell == "interval":
        return np.concatenate([nodes, middles[:1]])
    centre = nodes.mean(axis=0, keepdims=True)
    return np.concatenate([nodes, middles, centre] if cell == "quadrilateral" else [nodes, middles])
