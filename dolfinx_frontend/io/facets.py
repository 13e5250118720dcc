"""What acts on interfaces, over their facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from dolfinx_frontend.assembly.averages import means
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import unknown_name
from dolfinx_frontend.io.saved import SavedResult
from dolfinx_frontend.io.vtk import CELLS, Grid, Values, vertices
from dolfinx_frontend.results import surfaces
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.tables import with_known_force
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.solvers.chaos import ChaosResult
from dolfinx_frontend.solvers.sampling import SampleResult

__all__ = ["facet_fields"]

AnyResult: TypeAlias = Result | SampleResult | SavedResult


def times_of(result: AnyResult) -> Array | None:
    return result.times if isinstance(result, SavedResult) else result.plan.times


def vector_values(values: Array) -> Values:
    """Vectors (m, d) with three components."""
    out = np.zeros((len(values), 3))
    out[:, : values.shape[1]] = values
    return out, "XYZ"


def facet_fields(
    result: Result | SampleResult, interface: str, step: int = -1
) -> tuple[npt.NDArray[np.int64], dict[str, Array]]:
    """What :func:`write_interfaces` writes on the facets of an interface, as arrays.

    Returns
    -------
    facets
        (k,), facets of the mesh of side 1, ascending.
    fields
        Name -> (k,) or (k, 3).

    Raises
    ------
    SceneError
        An interface that is unknown or whose force is not known, no such step.
    """
    with_given_force(result, interface, "facet_fields")
    at = check_step(times_of(result), step, "facet_fields")
    side = result.problem.here(interface).sides[0]
    part = result.problem.substructures[side.substructure].part
    data = InterfaceWriter.of(result, interface).facets(at).cell_data
    numbers = np.sort(part.facet_tags.find(part.names[side.face])).astype(np.int64)
    covered = np.unique(result.problem.interfaces[interface].facets)
    return numbers[covered], {name: np.asarray(values) for name, (values, _) in data.items()}


def with_given_force(
    result: AnyResult, wanted: Sequence[str] | str | None, where: str
) -> list[str]:
    """The wanted interfaces (None: all), whose force is known."""
    if isinstance(result, SavedResult):
        known = [name for name, each in result.interfaces.items() if each.force is not None]
    else:
        known = with_known_force(result)
    if wanted is None:
        return known
    chosen = [wanted] if isinstance(wanted, str) else list(wanted)
    for name in chosen:
        if name not in known:
            raise unknown_name("interface with a known force", name, known, where)
    return chosen


class _Surface(NamedTuple):
    """The covered facets of side 1 of an interface, which are the same at all steps."""

    x: Array  # (nodes, 3), facet by facet
    cells: npt.NDArray[np.int64]  # (facets, nodes a facet)
    type: int  # of VTK
    trace: sp.csr_matrix  # (nodes, unknowns of a component of the displacement)
    mean: sp.csr_matrix  # (facets, points), by area
    area: Array  # (facets,)


class InterfaceWriter:
    """Grids of an interface from its fields, (T, m) or (T, m, d) each."""

    def __init__(
        self,
        points: Array,
        weights: Array,
        fields: Mapping[str, Array],
        side: tuple[Substructure, Interface] | None = None,
        displacement: Array | None = None,
    ) -> None:
        self._points, self._weights, self._fields = points, weights, fields
        self._side, self._displacement = side, displacement

    @classmethod
    def of(cls, result: Result | SampleResult, name: str) -> InterfaceWriter:
        interface = result.problem.interfaces[name]
        part = result.problem.substructures[interface.sides[0].substructure]
        displacement: Array | None
        if isinstance(result, ChaosResult):
            fields = surfaces.of_chaos(result, name)
            displacement = result.field_moments(part.name)[0]
        elif isinstance(result, SampleResult):
            fields = surfaces.of_samples(result, name)
            kept = result.points.states is not None
            displacement = result.field_moments(part.name)[0] if kept else None
        else:
            fields = surfaces.of_result(result, name)
            displacement = result.displacements[part.name]
        if displacement is not None:
            displacement = np.atleast_2d(displacement)
        return cls(interface.points, interface.weights, fields, (part, interface), displacement)

    @classmethod
    def of_saved(cls, result: SavedResult, name: str) -> InterfaceWriter:
        each = result.interfaces[name]
        return cls(each.points, each.weights, surfaces.of_saved(result, name))

    def _data(self, step: int) -> dict[str, Values]:
        out: dict[str, Values] = {"area": (self._weights, "")}
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
        if self._side is not None and self._displacement is not None:
            part, interface = self._side
            nodal = self._displacement[step].reshape(-1, part.dim)
            data["displacement"] = vector_values(interface.sides[0].shape @ nodal)
        return vertices(self._points, data)

    @cached_property
    def _surface(self) -> _Surface:
        assert self._side is not None  # a loaded result has no surfaces
        part, interface = self._side
        face = FacetMap(part.part, interface.sides[0].face, f"interface {interface.name!r}")
        covered, row = np.unique(interface.facets, return_inverse=True)
        cell, order = face.facet_cell.name, min(face.order, 2)
        nodes = _facet_nodes(cell, order)
        index, s = np.repeat(covered, len(nodes)), np.tile(nodes, (len(covered), 1))
        x = np.zeros((len(index), 3))
        x[:, : part.dim] = face.push_forward(index, s)[0]
        cells = np.arange(len(index), dtype=np.int64).reshape(-1, len(nodes))
        trace = face.trace(part.space, index, s, len(part.dof_coordinates))
        mean = means(row, self._weights, len(covered))
        area: Array = np.bincount(row, self._weights).astype(np.float64)
        return _Surface(x, cells, CELLS[cell, order], trace, mean, area)

    def facets(self, step: int) -> Grid:
        """The surface of side 1."""
        surface = self._surface
        point_data: dict[str, Values] = {}
        if self._side is not None and self._displacement is not None:
            nodal = self._displacement[step].reshape(-1, self._side[0].dim)
            point_data["displacement"] = vector_values(surface.trace @ nodal)
        return Grid(surface.x, surface.cells, surface.type, point_data, self._on_facets(step))

    def _on_facets(self, step: int) -> dict[str, Values]:
        """Values of the facets: the means of their points; of one point what is there."""
        mean = self._surface.mean
        single = mean.shape[0] == mean.shape[1]
        out: dict[str, Values] = {"area": (self._surface.area, "")}
        for name, (values, labels) in self._data(step).items():
            if name == "state" and not single:
                out["open share"] = (mean @ (values == surfaces.OPEN), "")
                out["slip share"] = (mean @ (values == surfaces.SLIPS), "")
            elif name == "state":
                out[name] = ((mean @ values).astype(np.int64), "")
            elif name != "area":
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
