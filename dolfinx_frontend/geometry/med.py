"""Meshes of Salome and Code_Aster (MED) with their groups, read by meshio. Without dolfinx."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.meshed import Meshed, checked

__all__ = ["check_begin", "med_mesh"]

_BEGIN = b"\x89HDF\r\n\x1a\n"

_KINDS = {
    "line": (1, 1), "line3": (1, 8), "triangle": (2, 2), "triangle6": (2, 9), "quad": (2, 3),
    "quad8": (2, 16), "tetra": (3, 4), "tetra10": (3, 11), "hexahedron": (3, 5), "hexahedron20": (3, 17),
    "wedge": (3, 6), "wedge15": (3, 18), "pyramid": (3, 7), "pyramid13": (3, 19),
}
"""Name of a cell -> its dimension and its number in gmsh."""

_HANDED_ON = {"tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]}
"""Order in which the nodes of a cell are handed on."""


def check_begin(name: str, first: bytes) -> None:
    """Raise SceneError unless a file begins as a MED file does."""
    if not first.startswith(_BEGIN):
        raise SceneError(f"{name!r} is no MED file (it does not begin as HDF5); export the mesh as MED")


def med_mesh(path: Path) -> Meshed:
    """The groups of a file: those of the highest dimension are parts, those of the next one faces.

    Raises
    ------
    SceneError
        meshio is not there or cannot read it, there are no groups of cells, elements that are none.
    """
    try:
        import meshio
    except ImportError as error:
        raise SceneError("MED files need meshio and h5py: install them (Debian: python3-meshio)") from error
    try:
        mesh = meshio.med.read(str(path))
        tags, names = mesh.cell_data.get("cell_tags", []), dict(mesh.cell_tags)
    except (KeyError, ValueError, OSError, TypeError, AttributeError, meshio.ReadError) as error:
        raise SceneError(f"it cannot be read ({error}); export one mesh, with its groups, as MED") from error
    if len(tags) != len(mesh.cells):
        raise SceneError("some of its cells have no family; export the mesh with its groups")
    dim = max((_KINDS[block.type][0] for block in mesh.cells if block.type in _KINDS), default=0)
    if dim < 2:
        raise SceneError("it has no cells of dimension 2 or 3; mesh its solids")
    x = np.zeros((len(mesh.points), 3))
    x[:, : mesh.points.shape[1]] = mesh.points
    found: dict[int, dict[str, dict[int, Ints]]] = {dim: {}, dim - 1: {}}
    kinds: dict[int, str] = {}
    for block, own in zip(mesh.cells, tags, strict=True):
        of, kind = _KINDS.get(block.type, (0, 0))
        if of not in found:
            continue
        kinds[kind] = block.type
        rows = np.asarray(block.data, dtype=np.int64)
        rows = rows[:, _HANDED_ON[block.type]] if block.type in _HANDED_ON else rows
        for group in dict.fromkeys(name for each in names.values() for name in each):
            members = np.isin(own, [tag for tag, each in names.items() if group in each])
            if members.any():
                found[of].setdefault(group, {})[kind] = rows[members]
    if not found[dim]:
        raise SceneError("no group has its cells; give each part a group of volumes (in 2D: of faces)")
    return checked(Meshed(dim, x, found[dim], found[dim - 1], kinds))
