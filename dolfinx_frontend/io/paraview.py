"""Displacements, stresses and what acts on the interfaces, as files that ParaView, VisIt and pyvista read.

The format is VTK's XML: a multi-block index (``.vtm``) of unstructured grids (``.vtu``, which meshio reads
as well), and for all times of a load history a collection (``.pvd``) of such. The cells of a part are
Lagrange cells of the displacement's degree, so curved parts and quadratic fields are kept as they are. Cells
share their nodes, so that filters find the surface of the part; a stress at a node is the mean of the cells
around it, by volume. With ``shared=False`` every cell has nodes of its own, and stresses jump between cells
as computed. Values of interfaces are at the points where they are computed, beside their means over the
facets.

>>> io.write(result, "out")                      # out/parts.vtm, out/interfaces.vtm; .pvd of a history
>>> io.write_fields(result, "out/parts.pvd")     # or one of the two, by name
>>> io.write_interfaces(result, "out/joint.vtm", interfaces="joint", step=3)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem, plot

from dolfinx_frontend.assembly.matrix_part import Motion, has_mesh
from dolfinx_frontend.assembly.ranks import agreement, exchanged, together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_optional_kind,
    checked_flag,
    checked_path,
    checked_whole,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.formats.vtk import Blocks, Grid, Values, check_target, vertices, write_blocks
from dolfinx_frontend.io.facets import InterfaceWriter, vector_values
from dolfinx_frontend.results.answer import Answer, check_answer, stepped
from dolfinx_frontend.results.readings import known_interfaces
from dolfinx_frontend.results.stress import Shared, broken_space, principal, stress_of, von_mises
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.scene import Scene

__all__ = ["write", "write_fields", "write_interfaces"]

Materials = Mapping[str, Material | Callable[[Any, Any], Any]]

_SYMMETRIC = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Components of a symmetric tensor in VTK's order."""


@together("write")
def write(
    result: Answer, folder: str | Path, modes: Sequence[int] = (), shared: bool = True
) -> tuple[Path, Path]:
    """Write parts and interfaces of a result into a folder, of a load history at all times.

    Parameters
    ----------
    folder
        Made if it is not there.
    modes
        Chaos modes of the displacement that are written as well.
    shared
        Whether cells share nodes, see :func:`write_fields`.

    Returns
    -------
    tuple
        The files to open: ``parts`` and ``interfaces``, ``.vtm`` or, of a history, ``.pvd``.
    """
    check_answer("write", "result", result)
    where = checked_path("write", folder, "folder", new=True)
    result.problem.check_alike("write", folder=str(where), modes=modes, shared=shared)
    ending = "vtm" if result.times is None else "pvd"
    parts = write_fields(result, where / f"parts.{ending}", modes=modes, shared=shared)
    return parts, write_interfaces(result, where / f"interfaces.{ending}")


# --- parts -----------------------------------------------------------------------------------------
@together("write_fields")
def write_fields(
    fields: Answer | Mapping[str, fem.Function],
    path: str | Path,
    materials: Scene | Materials | None = None,
    *,
    step: int = -1,
    modes: Sequence[int] = (),
    shared: bool = True,
) -> Path:
    """Write displacements, and stresses where the materials are known.

    The grid of each part has the point data ``displacement`` (length; 3 components), and, with a material
    that has a method ``stress``, ``stress`` (force / area; XX, YY, ZZ, XY, YZ, XZ, in 2D XX, YY, XY) and in
    3D ``von Mises`` and ``principal stress`` (the largest first). Their units are those of the scene. Of a
    random answer ``displacement`` and ``stress`` are means, ``displacement std`` and ``stress std`` the
    standard deviations of every component (of samples that of the displacement), ``von Mises`` and
    ``principal stress`` are those of the mean stress (``result.stress(part, of="von Mises")`` has its mean),
    and ``displacement u3`` is the chaos coefficient of mode 3.

    Parameters
    ----------
    fields
        Any answer (sweeps and samples with ``keep_states=True``), also a loaded one, or part ->
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
    shared
        Cells share nodes, where a stress is the mean of the cells around, by volume. False: every cell has
        its own nodes and its own stress.

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
    if not isinstance(fields, Mapping):
        check_answer("write_fields", "fields", fields)
    times = None if isinstance(fields, Mapping) else fields.times
    target = check_target(path, times is not None)
    step = check_step(times, step, "write_fields")
    wanted = "give the scene, or {part: material}"
    check_optional_kind("write_fields", "materials", materials, (Scene, Mapping), wanted)
    wanted = "give the numbers of chaos modes"
    check_kind("write_fields", "modes", modes, (list, tuple, range), wanted)
    checked_flag("write_fields", "shared", shared)
    if isinstance(materials, Scene):
        of_scene = {name: spec.material for name, spec in materials.substructures.items()}
        materials = {name: material for name, material in of_scene.items() if material is not None}
    if isinstance(fields, Mapping):
        names, rank, comm = list(fields), 0, None
        made = dict(_function_grids(fields, materials or {}, shared))
    else:
        given = {"path": str(target), "step": step, "modes": modes, "materials": materials is None}
        given["shared"] = shared
        fields.problem.check_alike("write_fields", **given)
        names, rank, comm = list(fields.problem.parts), fields.problem.rank, fields.problem.comm
        with agreement(comm):
            fields.problem.check_sources()
            made = dict(_part_grids(fields, materials, modes, shared))
    if not names:
        raise ValueError("there are no displacements to write")

    def blocks(at: int) -> Blocks:
        return {name: partial(made[name], at) if name in made else None for name in names}

    with agreement(comm):
        return write_blocks(target, times, step, blocks, rank)


def _function_grids(
    functions: Mapping[str, fem.Function], materials: Materials, shared: bool
) -> Iterator[tuple[str, Callable[[int], Grid]]]:
    """Part -> its grid from a function."""
    for name, function in functions.items():
        part = _PartWriter(function, materials.get(name), shared)
        yield name, partial(part.grid, function.x.array[None].copy(), [], {}, [], [])


def _part_grids(
    answer: Answer, materials: Materials | None, modes: Sequence[int], shared: bool
) -> Iterator[tuple[str, Callable[[int], Grid]]]:
    """Part -> its grid at a step."""
    if modes and answer.kind != "chaos":
        raise SceneError(f"fields: modes = {list(modes)}: only the result of a chaos has modes")
    for name, s in answer.problem.substructures.items():
        mean = answer.unknowns(name)
        spread = answer.spread(name)
        extra = {}
        for mode in modes:
            if not 0 <= checked_whole("fields", "mode", mode) <= len(spread):
                raise SceneError(f"fields: there is no mode {mode}, the chaos has {len(spread) + 1}")
            extra[f"u{mode}"] = spread[mode - 1] if mode else mean
        deviation = answer.deviation(name) if not spread else None
        if deviation is not None:
            extra["std"] = deviation

        def put(unknowns: Array, name: str = name) -> Array:
            return np.asarray(answer.function(name, unknowns, "").x.array)

        function = answer.function(name, stepped(mean, answer.times)[0], "")
        in_time = partial(stepped, times=answer.times)
        beside = {key: in_time(values) for key, values in extra.items()}
        if isinstance(function, Motion):
            points = _PointsWriter(function.points)
            yield name, partial(points.grid, in_time(mean), [*map(in_time, spread)], beside, [], [])
            continue
        loads = answer.problem.initial_stresses(name)
        initial = [stress for _, _, stress in loads]
        material = s.material if materials is None else materials.get(name)
        if name in getattr(answer.plan, "scaled", ()):
            material = None  # its stress is no function of the mean displacement
        part = _PartWriter(function, material, shared, put, initial)
        numbers = [in_time(answer.load_number(load, parameter)) for load, parameter, _ in loads]
        of_spread = [
            [in_time(each) for each in answer.load_spread(load, parameter)] for load, parameter, _ in loads
        ]
        yield name, partial(part.grid, in_time(mean), [*map(in_time, spread)], beside, numbers, of_spread)


class _PartWriter:
    """Grid of a part, and displacements and stresses at its nodes from unknowns."""

    def __init__(
        self,
        function: fem.Function,
        material: Any,
        shared: bool,
        put: Callable[[Array], Array] | None = None,
        initial: Sequence[Any] = (),
    ) -> None:
        space = function.function_space
        self._u, self._put = fem.Function(space), put
        self._d = int(space.mesh.geometry.dim)
        degree = int(space.element.basix_element.degree)
        self._nodal = fem.Function(broken_space(self._u, (self._d,), degree))
        # of cells that share nodes: those of each cell, and how values are brought there
        self._shared = Shared(self._nodal) if shared else None
        nodes = self._nodal.function_space if self._shared is None else self._shared.space
        topology, types, self._x = plot.vtk_mesh(nodes)
        self._cells = topology.reshape(len(types), -1)[:, 1:].astype(np.int64)
        self._type = int(types[0])
        self._stress: Callable[[Sequence[float]], fem.Function] | None = None
        self._nothing = [0.0] * len(initial)
        if hasattr(material, "stress"):
            self._stress = stress_of(self._u, material, degree, initial)

    def _at(self, unknowns: Array, numbers: Sequence[float] | None = None) -> tuple[Array, Array | None]:
        """Displacement (nodes, d), and stress (nodes, d, d) if it is known."""
        self._u.x.array[:] = unknowns if self._put is None else self._put(unknowns)
        self._nodal.interpolate(self._u)
        moved = self._at_nodes(self._nodal.x.array.reshape(-1, self._d))
        if self._stress is None:
            return moved, None
        stress = self._stress(self._nothing if numbers is None else numbers)
        n = int(stress.function_space.value_shape[0])
        return moved, self._at_nodes(stress.x.array.reshape(-1, n * n)).reshape(-1, n, n)

    def _at_nodes(self, values: Array) -> Array:
        """Values (nodes of the cells, k) at the nodes of the grid."""
        return values.copy() if self._shared is None else self._shared.mean(values)

    def grid(
        self,
        mean: Array,
        spread: Sequence[Array],
        extra: Mapping[str, Array],
        numbers: Sequence[Array],
        of_spread: Sequence[Sequence[Array]],
        step: int,
    ) -> Grid:
        """The grid at a step.

        Parameters
        ----------
        mean, extra
            Unknowns (T, n), the latter by what is added to the name.
        spread
            Deviations (T, n) from the mean, whose squares add up to the variance.
        numbers, of_spread
            Of initial stresses: (T,) each, and those of every deviation.
        """
        u, stress = self._at(mean[step], [each[step] for each in numbers])
        data: dict[str, Values] = {"displacement": vector_values(u)}
        for name, values in extra.items():
            data[f"displacement {name}"] = vector_values(self._at(values[step])[0])
        square, stress_square = np.zeros_like(u), 0.0 if stress is None else np.zeros_like(stress)
        for k, away in enumerate(spread):
            moved, strained = self._at(away[step], [each[k][step] for each in of_spread])
            square += moved**2
            if strained is not None:
                stress_square += strained**2
        if spread:
            data["displacement std"] = vector_values(np.sqrt(square))
        if stress is not None:
            data["stress"] = self._symmetric(stress)
            if stress.shape[1] == 3:
                data["von Mises"] = (von_mises(stress), "")
                data["principal stress"] = (principal(stress), "123")
            if spread:
                data["stress std"] = self._symmetric(np.sqrt(stress_square))
        return Grid(self._x, self._cells, self._type, data)

    def _symmetric(self, tensor: Array) -> Values:
        which = _SYMMETRIC[int(tensor.shape[1])]
        values = np.stack([tensor[:, i, j] for i, j in which], axis=1)
        return values, " ".join("XYZ"[i] + "XYZ"[j] for i, j in which)


class _PointsWriter(_PartWriter):
    """The same of a part that is a matrix: its points."""

    def __init__(self, points: Array) -> None:
        self._d, count = points.shape[1], len(points)
        cloud = vertices(points, {})
        self._x, self._cells, self._type, self._nothing = cloud.x, cloud.cells, cloud.type, []
        self._count = count

    def _at(self, unknowns: Array, numbers: Sequence[float] | None = None) -> tuple[Array, None]:
        """Displacement (points, d), and no stress."""
        return np.asarray(unknowns).reshape(-1, self._d)[: self._count], None


# --- interfaces ------------------------------------------------------------------------------------
@together("write_interfaces")
def write_interfaces(
    result: Answer,
    path: str | Path,
    *,
    interfaces: Sequence[str] | str | None = None,
    step: int = -1,
) -> Path:
    """Write what acts on the interfaces.

    There are two groups of blocks, one block per interface in each. ``points`` are the points at which the
    law is evaluated: a cloud (with ``space="points"`` the quadrature points of the facets). ``facets`` is the
    surface of side 1, facet by facet, with constant cell data: of interfaces with ``space="facets"`` what is
    computed there, of others the means, by area, of the points of each facet. Both have

    ========================  ====================================================================
    ``pressure``              -f_n, force / area, positive where the sides press
    ``shear``                 tangential force per area on side 1, global axes
    ``opening``, ``slip``     normal and tangential part of the jump w2 - w1, length; slip in global axes
    ``gap``                   of contacts: their distance, length
    ``state``                 of contacts: 0 open, 1 closed (stick, with friction), 2 slip; on facets
                              with several points the fractions of its area, ``open share``, ``slip share``
    ``slip use``              of friction: size of f_t over mu p + tau, 0 where it is open, 1 where it slips
    ``area``                  that a point or facet stands for
    ========================  ====================================================================

    and the point data ``displacement`` of side 1, by which ParaView's filter "warp by vector" deforms them.
    What a law does not have is left out. Of a random answer (chaos, samples) all are means, the standard
    deviation is beside them (``pressure std``), and of contacts, instead of the state, ``open probability``
    and ``slip probability``; on facets with several points the means of these. Of a loaded chaos they are
    from its coefficients, without gaps and probabilities. Of a sweep they are those of its last point;
    ``point(...)`` has those of any other.

    Parameters
    ----------
    result
        Of a solve, a sampling, or loaded. On several ranks each writes the interfaces whose points are on a
        part that it has.
    path
        Index file, ending in ``.vtm``, or in ``.pvd`` for all times of a load history; the grids go to a
        folder of the same name beside it.
    interfaces
        Names; None: all whose force is known. (Glue and supports that the plan eliminated are not among
        them: ``active=[...]`` keeps them; nor, of samples without their states, what is not active.)
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
    check_answer("write_interfaces", "result", result)
    times = result.times
    target = check_target(path, times is not None)
    step = check_step(times, step, "write_interfaces")
    given = {"path": str(target), "step": step, "interfaces": interfaces}
    result.problem.check_alike("write_interfaces", **given)
    chosen = known_interfaces(result, interfaces, "write_interfaces")
    if not chosen:
        raise ValueError("there are no interfaces whose force is known: solve with active=[...] to have some")
    problem = result.problem
    with agreement(problem.comm):
        problem.check_sources()
        # the points may be on the second side, which another rank may have
        carriers = {n: problem.interfaces[n].sides[problem.interfaces[n].carrier] for n in chosen}
        here = [name for name, side in carriers.items() if side.substructure in problem.substructures]
        writers = {name: InterfaceWriter(result, name) for name in here}
        of_points = [
            n
            for n in here
            if carriers[n].face.startswith("(")  # of nodes
            or not has_mesh(problem.substructures[carriers[n].substructure])
        ]
    if problem.comm is not None:
        of_points = [name for each in exchanged(problem.comm, of_points) for name in each]
    # files of older versions know the points only
    meshed = all(i.sides[i.carrier].shape is not None for i in map(problem.interfaces.__getitem__, chosen))
    groups = ["facets", "points"] if meshed else ["points"]

    def blocks(at: int) -> Blocks:
        return {
            group: {
                name: partial(getattr(writers[name], group), at) if name in writers else None
                for name in chosen
                if group == "points" or name not in of_points
            }
            for group in groups
        }

    with agreement(problem.comm):
        return write_blocks(target, times, step, blocks, problem.rank)
