"""What every rank knows of the meshes of all parts, so that all decide alike where they become finer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import compute_midpoints as midpoints

from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.geometry.finer import cell_sizes

__all__ = ["Cells", "cells_of"]


class Cells(NamedTuple):
    """Cells of a part."""

    sizes: Array  # (cells,) mean lengths of their edges
    straight: bool
    again: bool  # whether the part can be meshed again
    faces: Mapping[str, tuple[Ints, Array]]
    """Face of an interface -> cells (k,) beside its facets, and the middles (k, d) of these."""


def cells_of(problem: Problem) -> dict[str, Cells]:
    """Part -> its cells, on all ranks; collective."""
    with agreement(problem.comm):
        faces: dict[str, list[str]] = {}
        for interface in problem.own.interfaces.values():
            for side in interface.sides:
                faces.setdefault(side.substructure, []).append(side.face)
        own = {
            name: Cells(
                cell_sizes(part.part.mesh),
                int(coordinate_map(part.part.mesh).degree) == 1,
                bool(getattr(part.part, "again", None)),
                {face: _beside(part, face) for face in faces.get(name, []) if face in part.part.names},
            )
            for name, part in problem.own.substructures.items()
        }
    return problem.gather(own, parts=True)


def _beside(part: Substructure, face: str) -> tuple[Ints, Array]:
    mesh = part.part.mesh
    facets = np.asarray(part.part.facet_tags.find(part.part.names[face]), dtype=np.int32)
    d = mesh.topology.dim
    mesh.topology.create_connectivity(d - 1, d)
    links = mesh.topology.connectivity(d - 1, d)
    cells = np.array([links.links(int(facet))[0] for facet in facets], dtype=np.int64)
    return cells, np.asarray(midpoints(mesh, d - 1, facets))[:, : mesh.geometry.dim]
