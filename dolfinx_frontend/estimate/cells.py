"""What every rank knows of the meshes of all parts, so that all decide alike where they become finer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from dolfinx.mesh import compute_midpoints as midpoints

from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.geometry.finer import cell_sizes

__all__ = ["Cells", "cells_of"]


class Cells(NamedTuple):
    """Cells of a part; of a mesh that is spread over the ranks, of all of them, the first one's first."""

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
            name: (_cells if has_mesh(part) else _none)(part.part, faces.get(name, []))
            for name, part in problem.own.substructures.items()
            if name not in problem.spread
        }
        pieces = {n: _cells(whole.part, _faces_on(problem, n)) for n, whole in problem.spread.items()}
    for name, piece in pieces.items():
        own[name] = _joined(problem.spread[name].part.mesh.comm.allgather(piece))
    return problem.gather(own, parts=True)


def _faces_on(problem: Problem, part: str) -> list[str]:
    sides = [side for interface in problem.interfaces.values() for side in interface.sides]
    return [side.face for side in sides if side.substructure == part]


def _cells(part: Any, faces: Sequence[str]) -> Cells:
    """Of a part, or of what this rank has of it."""
    count = int(part.mesh.topology.index_map(part.mesh.topology.dim).size_local)
    return Cells(
        cell_sizes(part.mesh)[:count],
        int(coordinate_map(part.mesh).degree) == 1,
        bool(getattr(part, "again", None)),
        {face: _beside(part, face, count) for face in faces if face in part.names},
    )


def _none(part: Any, faces: Sequence[str]) -> Cells:
    """Of a part that is a matrix."""
    nothing = np.zeros(0, dtype=np.int64), np.zeros((0, part.given.dim))
    return Cells(np.zeros(0), True, False, dict.fromkeys(faces, nothing))


def _joined(pieces: Sequence[Cells]) -> Cells:
    """The cells of all ranks, those of the first one first."""
    starts = np.cumsum([0, *(len(each.sizes) for each in pieces)])
    faces = {}
    for face in pieces[0].faces:
        beside = [each.faces[face] for each in pieces]
        cells = [start + of for start, (of, _) in zip(starts, beside, strict=False)]
        faces[face] = np.concatenate(cells), np.concatenate([at for _, at in beside])
    return pieces[0]._replace(sizes=np.concatenate([each.sizes for each in pieces]), faces=faces)


def _beside(part: Any, face: str, count: int) -> tuple[Ints, Array]:
    """Of the first `count` cells: which are beside a face, and the middles of their facets."""
    mesh = part.mesh
    facets = np.asarray(part.facet_tags.find(part.names[face]), dtype=np.int32)
    d = mesh.topology.dim
    mesh.topology.create_connectivity(d - 1, d)
    links = mesh.topology.connectivity(d - 1, d)
    cells = np.array([links.links(int(facet))[0] for facet in facets], dtype=np.int64)
    own = cells < count
    middles = np.asarray(midpoints(mesh, d - 1, facets[own]))[:, : mesh.geometry.dim]
    return cells[own], middles.reshape(-1, mesh.geometry.dim)
