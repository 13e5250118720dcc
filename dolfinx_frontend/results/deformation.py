"""Displacement, strain and rotation of a part where they are largest, from its unknowns: nothing is compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import basix
import numpy as np

from dolfinx_frontend.assembly.elements import coordinate_element, tabulate
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.compat import cell_nodes
from dolfinx_frontend.common.model_limits import LIMITS

__all__ = ["Deformation", "Largest", "deformations"]

SHARE = 1e-3
"""Of the volume of a part: a corner or a line load, where strains have no limit, takes less of it."""


@dataclass(frozen=True)
class Largest:
    """A number where it is largest: at a step, at a place (d,)."""

    value: float
    step: int
    place: Array = field(repr=False)


@dataclass(frozen=True)
class Deformation:
    """Of a part over its steps: length; largest principal strain, and radians, at the centres of cells. Those
    beyond the limits are the ones that cells of `SHARE` of its volume exceed."""

    displacement: Largest
    strain: Largest
    rotation: Largest


def deformations(part: Substructure, unknowns: Array, known: Flags) -> Deformation:
    """Where a part moves, strains and turns most.

    Parameters
    ----------
    unknowns
        (T, n), length.
    known
        (T,), the steps that are looked at.
    """
    steps = np.flatnonzero(known)
    d, mesh = len(part.centre), part.part.mesh
    u = np.asarray(unknowns)[steps].reshape(len(steps), -1, d)
    moved = np.linalg.norm(u, axis=-1)
    step, node = np.unravel_index(np.argmax(moved), moved.shape)
    displacement = Largest(float(moved[step, node]), int(steps[step]), part.dof_coordinates[node])
    element, cells = part.space.element.basix_element, np.asarray(part.space.dofmap.list)
    nodes = np.asarray(cell_nodes(mesh))[: len(cells)]
    corners: Array = np.asarray(mesh.geometry.x, dtype=np.float64)[nodes, :d]
    of_map = coordinate_element(mesh)
    centre: Array = np.asarray(basix.geometry(of_map.cell_type), dtype=np.float64).mean(axis=0)[None]
    shape = tabulate(of_map, 1, centre)[:, 0]
    by_cells, places = shape[1:] @ corners, shape[0] @ corners  # (cells, reference, d), (cells, d)
    to_cells = _inverses(by_cells)
    values, *by_reference = tabulate(element, 1, centre)[:, 0]
    strain, rotation = Largest(0.0, 0, displacement.place), Largest(0.0, 0, displacement.place)
    for k, u_k in zip(steps, u, strict=True):
        size, turned = _sizes(to_cells @ (np.array(by_reference) @ u_k[cells]))
        if part.around:  # around the axis
            radius = np.maximum(places[:, 0], 1e-300)
            size = np.maximum(size, np.abs(u_k[cells][:, :, 0] @ values) / radius)
        strain = _larger(strain, size, LIMITS.strain, by_cells, int(k), places)
        rotation = _larger(rotation, turned, np.radians(LIMITS.rotation), by_cells, int(k), places)
    return Deformation(displacement, strain, rotation)


def _inverses(matrices: Array) -> Array:
    """Of matrices (cells, d, d); in space by the products of their rows, a tenth of the time of LAPACK."""
    if matrices.shape[-1] < 3:
        return np.asarray(np.linalg.inv(matrices))
    a, b, c = np.moveaxis(matrices, 1, 0)
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
    return np.asarray(columns / np.einsum("cd,cd->c", a, columns[:, :, 0])[:, None, None])


def _sizes(gradient: Array) -> tuple[Array, Array]:
    """Largest principal strains, and rotations in radians, (cells,) each, of gradients (cells, d, d).

    Where their norm is below the limit, it is taken for them.
    """
    other = np.swapaxes(gradient, 1, 2)
    squares, crossed = np.sum(gradient**2, axis=(1, 2)), np.sum(gradient * other, axis=(1, 2))
    strains = np.sqrt(np.maximum(squares + crossed, 0.0) / 2.0)
    large = strains > LIMITS.strain
    strains[large] = np.abs(np.linalg.eigvalsh(0.5 * (gradient + other)[large])).max(axis=1, initial=0.0)
    return strains, np.sqrt(np.maximum(squares - crossed, 0.0) / 4.0)


def _larger(
    known: Largest, sizes: Array, limit: float, by_cells: Array, step: int, places: Array
) -> Largest:
    cell = int(np.argmax(sizes))
    if sizes[cell] > limit:
        falling = np.argsort(-sizes)
        beyond = np.cumsum(np.abs(np.linalg.det(by_cells))[falling])
        cell = int(falling[np.searchsorted(beyond, SHARE * beyond[-1])])
    return known if sizes[cell] <= known.value else Largest(float(sizes[cell]), step, places[cell])
