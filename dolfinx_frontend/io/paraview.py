"""Displacements, stresses and what acts on the interfaces, as files that ParaView, VisIt and pyvista read.

The format is VTK's XML: a multi-block index (``.vtm``) of unstructured grids (``.vtu``, which meshio reads
as well), and for all times of a load history a collection (``.pvd``) of such. Nothing is projected: the
cells of a part are Lagrange cells of the displacement's degree, so curved parts and quadratic fields are
kept as they are, and every cell has nodes of its own, so stresses may jump between cells, as they do;
values of interfaces are at the points where they are computed, beside their means over the facets.

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

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.estimate.stress import broken_space, stress_of, von_mises
from dolfinx_frontend.io.facets import AnyResult, InterfaceWriter, times_of, vector_values, with_given_force
from dolfinx_frontend.io.saved import SavedResult
from dolfinx_frontend.io.vtk import Blocks, Grid, Values, check_target, vertices, write_blocks
from dolfinx_frontend.scene.amplitudes import check_step
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers.chaos import ChaosResult
from dolfinx_frontend.solvers.sampling import SampleResult

__all__ = ["write", "write_fields", "write_interfaces"]

Materials = Mapping[str, Material | Callable[[Any, Any], Any]]

_SYMMETRIC = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Components of a symmetric tensor in VTK's order."""


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
    ending = "vtm" if times_of(result) is None else "pvd"
    parts = write_fields(result, Path(folder) / f"parts.{ending}", modes=modes)
    return parts, write_interfaces(result, Path(folder) / f"interfaces.{ending}")


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
    times = None if isinstance(fields, Mapping) else times_of(fields)
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
    return vertices(nodes, {"displacement": vector_values(displacement[step])})


class _PartWriter:
    """Grid of a part, and displacements and stresses at its nodes from unknowns."""

    def __init__(self, space: fem.FunctionSpace, material: Any) -> None:
        self._u = fem.Function(space)
        self._d = int(space.mesh.geometry.dim)
        degree = int(space.element.basix_element.degree)
        self._nodal = fem.Function(broken_space(self._u, (self._d,), degree))
        topology, types, self._x = plot.vtk_mesh(self._nodal.function_space)
        self._cells = topology.reshape(len(types), -1)[:, 1:].astype(np.int64)
        self._type = int(types[0])
        self._stress: Callable[[], fem.Function] | None = None
        if hasattr(material, "stress"):
            self._stress = stress_of(self._u, material, degree)

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
        data: dict[str, Values] = {"displacement": vector_values(u)}
        for name, values in extra.items():
            data[f"displacement {name}"] = vector_values(self._at(values[step])[0])
        square, stress_square = np.zeros_like(u), 0.0 if stress is None else np.zeros_like(stress)
        for away in spread:
            moved, strained = self._at(away[step])
            square += moved**2
            if strained is not None:
                stress_square += strained**2
        if spread:
            data["displacement std"] = vector_values(np.sqrt(square))
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
    times = times_of(result)
    target = check_target(path, times is not None)
    step = check_step(times, step, "write_interfaces")
    chosen = with_given_force(result, interfaces, "write_interfaces")
    if not chosen:
        raise ValueError("there are no interfaces whose force is known: solve with active=[...] to have some")
    rank = 0
    writers: dict[str, InterfaceWriter] = {}
    if isinstance(result, SavedResult):
        writers = {name: InterfaceWriter.of_saved(result, name) for name in chosen}
    else:
        rank = result.problem.rank
        own = [name for name in chosen if result.problem.speaks_for(name)]
        writers = {name: InterfaceWriter.of(result, name) for name in own}
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
