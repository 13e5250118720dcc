"""Displacements, stresses and what acts on the interfaces, as files that ParaView, VisIt and pyvista read.

The format is VTK's XML: a multi-block index (``.vtm``) of unstructured grids (``.vtu``, which meshio reads
as well), and for all times of a load history a collection (``.pvd``) of such. Nothing is projected: the
cells of a part are Lagrange cells of the displacement's degree, so curved parts and quadratic fields are
kept as they are, and every cell has nodes of its own, so stresses may jump between cells, as they do;
values of interfaces are at the points where they are computed, beside their means over the facets.

>>> fields.write(result, "out")                      # out/parts.vtm, out/interfaces.vtm; .pvd of a history
>>> fields.write_fields(result, "out/parts.pvd")     # or one of the two, by name
>>> fields.write_interfaces(result, "out/joint.vtm", interfaces="joint", step=3)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem, plot

from dolfinx_frontend.assembly.averages import means
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError, unknown_name
from dolfinx_frontend.io.saved import SavedResult
from dolfinx_frontend.io.vtk import CELLS, Blocks, Grid, Values, check_target, vertices, write_blocks
from dolfinx_frontend.results import surfaces
from dolfinx_frontend.results.tables import with_known_force
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers.chaos import ChaosResult
from dolfinx_frontend.solvers.sampling import SampleResult
from dolfinx_frontend.solvers.solve import Result

__all__ = ["facet_fields", "stress_function", "von_mises", "write", "write_fields", "write_interfaces"]

Materials = Mapping[str, Material | Callable[[Any, Any], Any]]
AnyResult: TypeAlias = Result | SampleResult | SavedResult

_SYMMETRIC = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Components of a symmetric tensor in VTK's order."""


def _broken(function: fem.Function, shape: tuple[int, ...], degree: int) -> fem.FunctionSpace:
    """Discontinuous Lagrange space with equispaced nodes, which are those of VTK's cells."""
    mesh = function.function_space.mesh
    element = basix.ufl.element(
        "Lagrange",
        mesh.topology.cell_name(),
        degree,
        lagrange_variant=basix.LagrangeVariant.equispaced,
        discontinuous=True,
        shape=shape,
    )
    return fem.functionspace(mesh, element)


def stress_function(
    displacement: fem.Function, material: Material, degree: int | None = None
) -> fem.Function:
    """Stress of a displacement, force / area, interpolated cell by cell.

    Parameters
    ----------
    displacement
        Vector-valued Lagrange function.
    material
        With a method ``stress(u)``, as the materials of this package have.
    degree
        Of the discontinuous Lagrange space; None: the displacement's.

    Returns
    -------
    dolfinx.fem.Function
        (d, d), symmetric; in 2D the components in the plane.

    Raises
    ------
    SceneError
        The material gives a bilinear form only.
    """
    if getattr(material, "stress", None) is None:
        raise SceneError(
            f"material {material!r} gives no stress: it needs a method stress(u) that returns a "
            "UFL expression of shape (d, d)"
        )
    if degree is None:
        degree = int(displacement.function_space.element.basix_element.degree)
    return _stress_of(displacement, material, degree)()


def _stress_of(
    displacement: fem.Function, material: Material, degree: int
) -> Callable[[], fem.Function]:
    """The stress of what a function holds when it is called: compiled once."""
    d = int(displacement.function_space.mesh.geometry.dim)
    function = fem.Function(_broken(displacement, (d, d), degree), name="stress")
    points = function.function_space.element.basix_element.points
    expression = fem.Expression(material.stress(displacement), points)  # type: ignore[attr-defined]

    def stress() -> fem.Function:
        function.interpolate(expression)
        return function

    return stress


def von_mises(stress: Array) -> Array:
    """Von Mises stress (points,) of stresses (points, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    equivalent: Array = np.sqrt(1.5 * np.einsum("pij,pij->p", deviator, deviator))
    return equivalent


def write(result: AnyResult, folder: str | Path, modes: Sequence[int] = ()) -> tuple[Path, Path]:
    """Write parts and interfaces of a result into a folder, of a load history at all times.

    Parameters
    ----------
    folder
        Made if it is not there.
    modes
        Chaos modes of the displacement that are written as well.

    Returns
    -------
    tuple
        The files to open: ``parts`` and ``interfaces``, ``.vtm`` or, of a history, ``.pvd``.
    """
    ending = "vtm" if _times(result) is None else "pvd"
    parts = write_fields(result, Path(folder) / f"parts.{ending}", modes=modes)
    return parts, write_interfaces(result, Path(folder) / f"interfaces.{ending}")


def _times(result: AnyResult) -> Array | None:
    return result.times if isinstance(result, SavedResult) else result.plan.times


# --- parts -----------------------------------------------------------------------------------------
def write_fields(
    fields: AnyResult | Mapping[str, fem.Function],
    path: str | Path,
    materials: Scene | Materials | None = None,
    *,
    step: int = -1,
    modes: Sequence[int] = (),
) -> Path:
    """Write displacements, and stresses where the materials are known.

    The grid of each part has the point data ``displacement`` (length; 3 components), and, with a material
    that has a method ``stress``, ``stress`` (force / area; XX, YY, ZZ, XY, YZ, XZ, in 2D XX, YY, XY) and in
    3D ``von Mises``. Their units are those of the scene. Of a random answer ``displacement`` and ``stress``
    are means, ``displacement std`` and ``stress std`` the standard deviations of every component (of
    samples that of the displacement), ``von Mises`` is that of the mean stress, and ``displacement u3`` is
    the chaos coefficient of mode 3. A saved result knows no cells: its parts are clouds of nodes with
    ``displacement``.

    Parameters
    ----------
    fields
        Result of a solve or of a sampling (with ``keep_states=True``), a loaded result, or part ->
        displacement, a vector-valued Lagrange function. On several ranks each writes the grids of its parts.
    path
        Index file, ending in ``.vtm``, or in ``.pvd`` for all times of a load history; the grids go to a
        folder of the same name beside it.
    materials
        The scene, or part -> material; None: those that the result was solved with. Parts without one, or
        with a UFL form as material, get no stress.
    step
        Of a load history in a ``.vtm`` file; the last by default.
    modes
        Chaos modes of the displacement that are written as well.

    Returns
    -------
    Path
        The index file: open this one.

    Raises
    ------
    ValueError
        Another ending of the file name, or there is nothing to write.
    SceneError
        No such step or mode; samples whose states were not kept.
    """
    times = None if isinstance(fields, Mapping) else _times(fields)
    target = check_target(path, times is not None)
    step = check_step(times, step, "write_fields")
    if isinstance(materials, Scene):
        materials = {name: spec.material for name, spec in materials.substructures.items()}
    names, rank = _parts(fields)
    if not names:
        raise ValueError("there are no displacements to write")
    if modes and not isinstance(fields, ChaosResult):
        raise SceneError(f"fields: modes = {list(modes)}: only the result of a chaos has modes")
    for mode in modes:
        if isinstance(fields, ChaosResult) and not 0 <= mode < fields.modes:
            raise SceneError(f"fields: there is no mode {mode}, the chaos has {fields.modes}")
    made = dict(_part_grids(fields, materials, modes))

    def blocks(at: int) -> Blocks:
        return {name: partial(made[name], at) if name in made else None for name in names}

    return write_blocks(target, times, step, blocks, rank)


def _parts(fields: AnyResult | Mapping[str, fem.Function]) -> tuple[list[str], int]:
    """Names of all parts, and this rank."""
    if isinstance(fields, Mapping):
        return list(fields), 0
    if isinstance(fields, SavedResult):
        return list(fields.displacements), 0
    return list(fields.problem.parts), fields.problem.rank


def _part_grids(
    fields: AnyResult | Mapping[str, fem.Function], materials: Materials | None, modes: Sequence[int]
) -> Iterator[tuple[str, Callable[[int], Grid]]]:
    """Part -> its grid at a step."""
    if isinstance(fields, SavedResult):
        for name, values in fields.displacements.items():
            block = values if fields.times is not None else values[None]
            yield name, partial(_cloud, fields.nodes[name], block)
        return
    if isinstance(fields, Mapping):
        for name, function in fields.items():
            part = _PartWriter(function.function_space, (materials or {}).get(name))
            yield name, partial(part.grid, function.x.array[None], [], {})
        return
    history = fields.plan.times is not None
    for name, s in fields.problem.substructures.items():
        part = _PartWriter(s.V, s.material if materials is None else materials.get(name))
        if isinstance(fields, ChaosResult):
            block = fields.coefficients(name)
            spread = [block[..., k] for k in range(1, fields.modes)]
            extra = {f"u{k}": block[..., k] for k in modes}
            mean = block[..., 0]
        elif isinstance(fields, SampleResult):
            mean, deviation = fields.field_moments(name)
            spread, extra = [], {"std": deviation}
        else:
            mean, spread, extra = fields.displacements[name], [], {}
        if not history:
            mean, extra = mean[None], {k: v[None] for k, v in extra.items()}
            spread = [u[None] for u in spread]
        yield name, partial(part.grid, mean, spread, extra)


def _cloud(nodes: Array, displacement: Array, step: int) -> Grid:
    return vertices(nodes, {"displacement": _vector(displacement[step])})


def _vector(values: Array) -> Values:
    """Vectors (m, d) with three components."""
    out = np.zeros((len(values), 3))
    out[:, : values.shape[1]] = values
    return out, "XYZ"


class _PartWriter:
    """Grid of a part, and displacements and stresses at its nodes from unknowns."""

    def __init__(self, space: fem.FunctionSpace, material: Any) -> None:
        self._u = fem.Function(space)
        self._d = int(space.mesh.geometry.dim)
        degree = int(space.element.basix_element.degree)
        self._nodal = fem.Function(_broken(self._u, (self._d,), degree))
        topology, types, self._x = plot.vtk_mesh(self._nodal.function_space)
        self._cells = topology.reshape(len(types), -1)[:, 1:].astype(np.int64)
        self._type = int(types[0])
        self._stress: Callable[[], fem.Function] | None = None
        if hasattr(material, "stress"):
            self._stress = _stress_of(self._u, material, degree)

    def _at(self, unknowns: Array) -> tuple[Array, Array | None]:
        """Displacement (nodes, d), and stress (nodes, d, d) if it is known."""
        self._u.x.array[:] = unknowns
        self._nodal.interpolate(self._u)
        moved = self._nodal.x.array.reshape(-1, self._d).copy()
        if self._stress is None:
            return moved, None
        return moved, self._stress().x.array.reshape(-1, self._d, self._d).copy()

    def grid(
        self, mean: Array, spread: Sequence[Array], extra: Mapping[str, Array], step: int
    ) -> Grid:
        """The grid at a step.

        Parameters
        ----------
        mean, extra
            Unknowns (T, n), the latter by what is added to the name.
        spread
            Deviations (T, n) from the mean, whose squares add up to the variance.
        """
        u, stress = self._at(mean[step])
        data: dict[str, Values] = {"displacement": _vector(u)}
        for name, values in extra.items():
            data[f"displacement {name}"] = _vector(self._at(values[step])[0])
        square, stress_square = np.zeros_like(u), 0.0 if stress is None else np.zeros_like(stress)
        for away in spread:
            moved, strained = self._at(away[step])
            square += moved**2
            if strained is not None:
                stress_square += strained**2
        if spread:
            data["displacement std"] = _vector(np.sqrt(square))
        if stress is not None:
            data["stress"] = self._symmetric(stress)
            if self._d == 3:
                data["von Mises"] = (von_mises(stress), "")
            if spread:
                data["stress std"] = self._symmetric(np.sqrt(stress_square))
        return Grid(self._x, self._cells, self._type, data)

    def _symmetric(self, tensor: Array) -> Values:
        which = _SYMMETRIC[self._d]
        values = np.stack([tensor[:, i, j] for i, j in which], axis=1)
        return values, " ".join("XYZ"[i] + "XYZ"[j] for i, j in which)


# --- interfaces ------------------------------------------------------------------------------------
def write_interfaces(
    result: AnyResult,
    path: str | Path,
    *,
    interfaces: Sequence[str] | str | None = None,
    step: int = -1,
) -> Path:
    """Write what acts on the interfaces.

    There are two groups of blocks, with a block an interface each. ``points`` are the points at which the law
    is evaluated: a cloud (with ``space="points"`` the quadrature points of the facets). ``facets`` is the
    surface of side 1, facet by facet, with constant cell data: of interfaces with ``space="facets"`` what is
    computed there, of others the means, by area, of the points of each facet. Both have

    ========================  ====================================================================
    ``pressure``              -f_n, force / area, positive where the sides press
    ``shear``                 tangential force per area on side 1, global axes
    ``opening``, ``slip``     normal and tangential part of the jump w2 - w1, length; slip in global axes
    ``gap``                   of contacts: their distance, length
    ``state``                 of contacts: 0 open, 1 closed (stick, with friction), 2 slip; on facets
                              with several points the shares of its area, ``open share``, ``slip share``
    ``area``                  that a point or facet stands for
    ========================  ====================================================================

    and the point data ``displacement`` of side 1, by which ParaView's filter "warp by vector" deforms them.
    What a law does not have is left out. Of a random answer (chaos, samples) all are means, the standard
    deviation is beside them (``pressure std``), and of contacts, instead of the state, ``open probability``
    and ``slip probability``; on facets with several points the means of these. Of a loaded result there are
    ``points`` only, and of a loaded random one no gaps and probabilities.

    Parameters
    ----------
    result
        Of a solve, a sampling, or loaded. On several ranks each writes the interfaces whose first side it
        has.
    path
        Index file, ending in ``.vtm``, or in ``.pvd`` for all times of a load history; the grids go to a
        folder of the same name beside it.
    interfaces
        Names; None: all whose force is known. (Glue and supports that the plan eliminated are not among
        them: ``active=[...]`` keeps them; nor, of random answers, other interfaces that are not active.)
    step
        Of a load history in a ``.vtm`` file; the last by default.

    Returns
    -------
    Path
        The index file: open this one.

    Raises
    ------
    ValueError
        Another ending of the file name, or there is nothing to write.
    SceneError
        An interface that is unknown or whose force is not known, no such step.
    """
    times = _times(result)
    target = check_target(path, times is not None)
    step = check_step(times, step, "write_interfaces")
    chosen = _with_known_force(result, interfaces, "write_interfaces")
    if not chosen:
        raise ValueError("there are no interfaces whose force is known: solve with active=[...] to have some")
    rank = 0
    writers: dict[str, _InterfaceWriter] = {}
    if isinstance(result, SavedResult):
        writers = {name: _InterfaceWriter.of_saved(result, name) for name in chosen}
    else:
        rank = result.problem.rank
        own = [name for name in chosen if result.problem.speaks_for(name)]
        writers = {name: _InterfaceWriter.of(result, name) for name in own}
    groups = ["points"] if isinstance(result, SavedResult) else ["facets", "points"]

    def blocks(at: int) -> Blocks:
        return {
            group: {
                name: partial(getattr(writers[name], group), at) if name in writers else None
                for name in chosen
            }
            for group in groups
        }

    return write_blocks(target, times, step, blocks, rank)


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
    _with_known_force(result, interface, "facet_fields")
    at = check_step(_times(result), step, "facet_fields")
    side = result.problem.here(interface).sides[0]
    part = result.problem.substructures[side.substructure].part
    data = _InterfaceWriter.of(result, interface).facets(at).cell_data
    numbers = np.sort(part.facet_tags.find(part.names[side.face])).astype(np.int64)
    covered = np.unique(result.problem.interfaces[interface].facets)
    return numbers[covered], {name: np.asarray(values) for name, (values, _) in data.items()}


def _with_known_force(
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


class _InterfaceWriter:
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
    def of(cls, result: Result | SampleResult, name: str) -> _InterfaceWriter:
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
    def of_saved(cls, result: SavedResult, name: str) -> _InterfaceWriter:
        each = result.interfaces[name]
        return cls(each.points, each.weights, surfaces.of_saved(result, name))

    def _data(self, step: int) -> dict[str, Values]:
        out: dict[str, Values] = {"area": (self._weights, "")}
        for name, values in self._fields.items():
            now = values[step]
            if name == "state":
                out[name] = (now.astype(np.int64), "")
            else:
                out[name] = (now, "") if now.ndim == 1 else _vector(now)
        return out

    def points(self, step: int) -> Grid:
        """The cloud of points."""
        data = self._data(step)
        if self._side is not None and self._displacement is not None:
            part, interface = self._side
            nodal = self._displacement[step].reshape(-1, part.dim)
            data["displacement"] = _vector(interface.sides[0].shape @ nodal)
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
            point_data["displacement"] = _vector(surface.trace @ nodal)
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
