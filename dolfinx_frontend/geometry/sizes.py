"""Cell sizes that a mesh is to have. Without dolfinx: also for the process in which gmsh meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked

__all__ = ["SizeField"]

SAME = 1e-9
"""Distance of vertices at one place, relative to the extent of all."""

_KINDS = {(2, 3): "ST", (2, 4): "SQ", (3, 4): "SS", (3, 8): "SH"}
"""(dimension, corners of a cell) -> what gmsh calls a list of such cells with numbers at their corners."""

_AROUND = {4: (0, 1, 3, 2), 8: (0, 1, 3, 2, 4, 5, 7, 6)}
"""Corners of quadrilaterals and hexahedra as gmsh counts them, around; those here go row by row."""


@dataclass(frozen=True, eq=False, repr=False)
class SizeField:
    """Cell sizes, linear in the cells of a mesh that was there before.

    Attributes
    ----------
    x
        (vertices, d), length.
    cells
        (n, corners), vertices of the cells.
    sizes
        (vertices,), wanted length of edges, > 0.
    """

    x: Array
    cells: Ints
    sizes: Array

    def __post_init__(self) -> None:
        locked(self)

    def __repr__(self) -> str:
        return f"SizeField({len(self.sizes)} points, {self.sizes.min():.3g} to {self.sizes.max():.3g})"

    def __call__(self, x: Array) -> Array:
        """Sizes (n,) at points (n, d): those of the nearest vertices."""
        _, near = spatial.cKDTree(self.x).query(np.atleast_2d(x)[:, : self.x.shape[1]])
        return np.asarray(self.sizes[near], dtype=np.float64)

    @classmethod
    def joined(cls, fields: Iterable[SizeField]) -> SizeField:
        """One field of those of parts with cells of one kind; where these meet, the smaller size holds."""
        every = list(fields)
        if not every or len({each.cells.shape[1] for each in every}) > 1:
            raise SceneError("SizeField.joined: give the fields of one or more parts with cells of one kind")
        x = np.concatenate([each.x for each in every])
        begin = np.cumsum([0, *(len(each.x) for each in every)])
        cells = np.concatenate([each.cells + b for each, b in zip(every, begin, strict=False)])
        sizes = np.concatenate([each.sizes for each in every])
        # vertices of meshes that match are at one place up to rounding
        near = spatial.cKDTree(x).query_pairs(SAME * float(np.ptp(x, axis=0).max()), output_type="ndarray")
        if len(near):
            least = np.minimum(sizes[near[:, 0]], sizes[near[:, 1]])
            for side in (0, 1):
                np.minimum.at(sizes, near[:, side], least)
        return cls(x, cells, sizes)

    def set(self, gmsh: Any, *others: int) -> None:
        """Make it the sizes of the current model of gmsh, instead of those that it has from points.

        Parameters
        ----------
        gmsh
            The module.
        others
            Numbers of size fields of the model: the smallest size holds.
        """
        d, corners = self.x.shape[1], self.cells.shape[1]
        cells = self.cells
        simplex = corners == d + 1
        if not simplex:
            cells = cells[:, list(_AROUND[corners])]
        x = np.zeros((len(cells), 3, corners))
        x[:, :d] = self.x[cells].transpose(0, 2, 1)
        data = np.concatenate([x.reshape(len(cells), -1), self.sizes[cells]], axis=1)
        view = gmsh.view.add("sizes")
        gmsh.view.addListData(view, _KINDS[d, corners], len(cells), data.ravel())
        field = gmsh.model.mesh.field
        number = field.add("PostView")
        field.setNumber(number, "ViewTag", view)
        if others:
            least = field.add("Min")
            field.setNumbers(least, "FieldsList", [number, *others])
            number = least
        field.setAsBackgroundMesh(number)
        for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.{option}", 0.0)
