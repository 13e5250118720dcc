"""Parts from gmsh: sessions, models and .msh files."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_path, checked_whole
from dolfinx_frontend.common.compat import (
    cell_nodes,
    coordinate_map,
    create_mesh,
    gmsh_cell_permutation,
    vertex_nodes,
)
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import write_text
from dolfinx_frontend.common.recorded import Call, mark
from dolfinx_frontend.geometry import med
from dolfinx_frontend.geometry.away import TIMEOUT, alone, away
from dolfinx_frontend.geometry.meshed import Meshed, meshed
from dolfinx_frontend.geometry.msh import check_begin
from dolfinx_frontend.geometry.parts import FREE, NO_FACETS, Assembly, Part, exterior_facets, tagged
from dolfinx_frontend.geometry.session import gmsh_session

__all__ = ["from_gmsh", "gmsh_session", "read_msh", "write_msh"]

_log = logging.getLogger(__name__)


_GMSH_CELLS = {
    2: ("triangle", 1),
    3: ("quadrilateral", 1),
    4: ("tetrahedron", 1),
    5: ("hexahedron", 1),
    9: ("triangle", 2),
    10: ("quadrilateral", 2),
    11: ("tetrahedron", 2),
    12: ("hexahedron", 2),
}
_FACETS = {(2, 2): 1, (3, 3): 2, (3, 4): 3}
"""Type of gmsh of a facet, by the dimension of its part and its corners."""


def from_gmsh(model: Any, gdim: int | None = None, *, order: int | None = None) -> Assembly:
    """Split a meshed gmsh model into parts.

    Physical groups say what is what:

    * every group of the highest dimension is a part and gives it its name;
    * a group one dimension lower named ``"part:face"`` is a face of that part;
    * a group named without a colon is a face of that name of *every* part it touches, for example
      ``"theta0"`` for a symmetry plane through several parts.

    The surface between two parts usually belongs to two groups, ``"lower:top"`` and
    ``"upper:bottom"``.  When the volumes share it in gmsh (after ``occ.fragment``) the two meshes
    match node for node.

    Parameters
    ----------
    model
        ``gmsh.model``, its mesh generated, of order 1 or 2; straight or curved simplices,
        quadrilaterals or hexahedra, one cell type per part.
    gdim
        Number of coordinates; the dimension of the parts if not given.
    order
        1 or 2: straight cells, or cells that are curved along the model's geometry; changes the mesh of the
        model. None: as it is meshed.

    Raises
    ------
    SceneError
        Cells that curving folds, no mesh, no part, a group without a name, a face without its part or
        without facets on it,
        a facet in two faces of a part or inside a part, mixed or unsupported cells.
    """
    if not hasattr(model, "getPhysicalGroups"):
        raise SceneError(f"from_gmsh: model = {short(model)} is no gmsh model; give gmsh.model")
    if gdim is not None:
        checked_whole("from_gmsh", "gdim", gdim, 2, 3)
    if order is not None:
        checked_whole("from_gmsh", "order", order, 1, 2)
        if order == 2:
            curve_elements(model)
        else:
            model.mesh.setOrder(1)
    return assembled(meshed(model), gdim)


def assembled(model: Meshed, gdim: int | None = None) -> Assembly:
    """The parts of a model whose groups are arrays, see :func:`from_gmsh`."""
    x = model.x[:, : gdim or model.dim]
    parts: dict[str, Part] = {}
    used: set[str] = set()
    for name, blocks in model.cells.items():
        mesh, node_of_vertex = _gmsh_mesh(model, name, blocks, x)
        faces: dict[str, npt.NDArray[np.int32]] = {}
        index = _FacetIndex(mesh, node_of_vertex)
        for group, rows in model.facets.items():
            owner, colon, face = group.partition(":")
            if colon and owner != name:
                continue
            found = np.concatenate([NO_FACETS, *(index.find(block) for block in rows.values())])
            if found.size:
                used.add(group)
                faces[face if colon else group] = found
        _check_faces(name, mesh, faces)
        parts[name] = tagged(mesh, faces)
    if unused := [group for group in model.facets if group not in used]:
        raise SceneError(
            f"no facet of a part lies on the face {unused[0]!r}; check the entities of its "
            "physical group"
        )
    _log.info("meshes: %d cells in %d parts", sum(part.num_cells for part in parts.values()), len(parts))
    return Assembly(parts)


def _gmsh_mesh(
    model: Meshed,
    name: str,
    blocks: Mapping[int, npt.NDArray[np.int64]],
    x: Array,
) -> tuple[dmesh.Mesh, npt.NDArray[np.int64]]:
    """Mesh of one part, and the row in ``x`` of each of its vertices."""
    if not blocks:
        raise SceneError(f"the part {name!r} has no cells; call gmsh.model.mesh.generate first")
    described = ", ".join(model.kinds[kind] for kind in blocks)
    if len(blocks) > 1:
        raise SceneError(f"the part {name!r} mixes cells ({described}); mesh it with one type")
    ((kind, nodes),) = blocks.items()
    if kind not in _GMSH_CELLS:
        raise SceneError(
            f"the part {name!r} has cells {described!r}; use triangles, quadrilaterals, "
            "tetrahedra or hexahedra of order 1 or 2 (with Mesh.SecondOrderIncomplete = 0)"
        )
    cell, order = _GMSH_CELLS[kind]
    permuted = nodes[:, gmsh_cell_permutation(cell, nodes.shape[1])]
    kept, local = np.unique(permuted, return_inverse=True)
    left_out, size = np.ptp(model.x[kept][:, x.shape[1] :], axis=0), np.ptp(model.x[kept], axis=0).max()
    if (left_out > 1e-6 * size).any():
        raise SceneError(
            f"the part {name!r} is not in a plane of constant z (its z has a range of {left_out[0]:.3g}); "
            "turn the mesh into the plane of x and y"
        )
    mesh = create_mesh(local.reshape(permuted.shape), x[kept], cell, order)
    rows = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)  # of the input coordinates
    return mesh, kept[rows[vertex_nodes(mesh)]]


class _FacetIndex:
    """Finds the facets of a mesh from their vertices."""

    def __init__(self, mesh: dmesh.Mesh, node_of_vertex: npt.NDArray[np.int64]) -> None:
        topology = mesh.topology
        topology.create_connectivity(topology.dim - 1, 0)
        links = topology.connectivity(topology.dim - 1, 0)
        self._width = links.links(0).size
        self._keys = self._key(node_of_vertex[links.array].reshape(-1, self._width))

    def _key(self, nodes: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        """One comparable value per row, whatever the order of its vertices."""
        rows = np.ascontiguousarray(np.sort(nodes[:, : self._width], axis=1))
        return rows.view([("", np.int64)] * self._width).reshape(-1)

    def find(self, nodes: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
        """Those of the given facets (rows of nodes, vertices first) that the mesh has."""
        _, found, _ = np.intersect1d(self._keys, self._key(nodes), return_indices=True)
        return np.sort(found).astype(np.int32)


def _check_faces(
    part: str, mesh: dmesh.Mesh, faces: Mapping[str, npt.NDArray[np.int32]]
) -> None:
    exterior = exterior_facets(mesh)
    claimed: npt.NDArray[np.int32] = NO_FACETS
    for face, facets in faces.items():
        if np.setdiff1d(facets, exterior).size:
            raise SceneError(
                f"the face {part}:{face} runs inside the part; a face is made of exterior facets"
            )
        if np.intersect1d(facets, claimed).size:
            other = next(f for f in faces if np.intersect1d(faces[f], facets).size)
            raise SceneError(
                f"the faces {part}:{other} and {part}:{face} share facets; "
                "give every surface one face name per part"
            )
        claimed = np.concatenate([claimed, facets])


def read_msh(path: str | Path, gdim: int | None = None, *, timeout: float | None = TIMEOUT) -> Assembly:
    """The parts of a file of gmsh with physical groups, see :func:`from_gmsh`, or of Salome with groups.

    MSH 2.2 and 4.1, text or binary; ``.med`` by meshio, whose groups are as physical groups. A copy of the
    file is read in a process of its own: a damaged one may end it, and gmsh executes what is no mesh, or has
    a certain name beside one.

    Parameters
    ----------
    path
        The file.
    gdim
        Number of coordinates; the dimension of the parts if not given.
    timeout
        Seconds after which reading is given up; None: never.

    Raises
    ------
    SceneError
        With the name of the file: it is not there, cannot be read, or holds what :func:`from_gmsh` refuses.
    """
    file = checked_path("read_msh", path)
    salome = file.suffix.lower() == ".med"
    task, check = ("med_file", med.check_begin) if salome else ("mesh_file", check_begin)
    with alone(file, f"file{'.med' if salome else '.msh'}", check) as copy:
        model: Meshed = away(task, file, "cannot be read as a mesh", "write it again", timeout, path=copy)
    try:
        assembly = assembled(model, gdim)
        for name, part in assembly.parts.items():
            given = {"path": file, "part": name} | ({} if gdim is None else {"gdim": gdim})
            mark(part, Call("msh", given))
        return assembly
    except SceneError as error:
        raise SceneError(f"{file.name!r}: {error}") from error
    except RuntimeError as error:  # of dolfinx, for cells that do not make a mesh
        raise SceneError(f"{file.name!r}: its cells make no mesh ({error}); mesh it again") from error


def write_msh(path: str | Path, parts: Mapping[str, Part]) -> None:
    """Write parts with their faces as a file of gmsh (MSH 2.2, text), which :func:`read_msh` and meshio read.

    Every number is there to the last bit, for which gmsh itself writes a digit too few. Parts become physical
    groups ``"part"``, faces ``"part:face"``, of the corners of their facets; what has no name stays without a
    group.

    Parameters
    ----------
    path
        The file.
    parts
        Name -> part, such as ``assembly.parts``; all of one dimension.

    Raises
    ------
    SceneError
        A name with a quote or a line break, or with a colon; cells of degree 3 or more.
    FileError
        The file cannot be written.
    """
    names: list[str] = []
    nodes: list[str] = []
    elements: list[str] = []

    def add(dim: int, name: str, kind: int, rows: npt.NDArray[Any]) -> None:
        if any(letter in name for letter in '"\r\n'):
            raise SceneError(f"write_msh: {name!r} has a quote or a line break; rename the part or its face")
        names.append(f'{dim} {len(names) + 1} "{name}"')
        begin, first = f"{kind} 2 {len(names)} {len(names)}", len(elements) + 1
        numbered = enumerate(rows.tolist(), start=first)
        elements.extend(f"{k} {begin} {' '.join(map(str, row))}" for k, row in numbered)

    for name, part in parts.items():
        if ":" in name:
            raise SceneError(f"write_msh: the part {name!r} has a colon in its name; rename it")
        mesh, cells = part.mesh, cell_nodes(part.mesh)
        dim, first = mesh.topology.dim, len(nodes) + 1
        x = np.zeros((len(mesh.geometry.x), 3))
        x[:, : mesh.geometry.dim] = mesh.geometry.x[:, : mesh.geometry.dim]
        nodes.extend(f"{first + k} {a!r} {b!r} {c!r}" for k, (a, b, c) in enumerate(x.tolist()))
        cell = part.cell, coordinate_map(mesh).degree
        kind = next((k for k, each in _GMSH_CELLS.items() if each == cell), 0)
        if not kind:
            raise SceneError(f"write_msh: {name!r} has {cell[0]} cells of degree {cell[1]}; give 1 or 2")
        order = np.argsort(gmsh_cell_permutation(part.cell, cells.shape[1]))
        add(dim, name, kind, first + cells[:, order])
        corners = _facet_corners(mesh)
        for face, tag in part.names.items():
            rows = first + corners[part.facet_tags.find(tag)]
            if face != FREE and len(rows):
                add(dim - 1, f"{name}:{face}", _FACETS[dim, rows.shape[1]], rows)
    sections = {"MeshFormat": ["2.2 0 8"], "PhysicalNames": [str(len(names)), *names],
                "Nodes": [str(len(nodes)), *nodes], "Elements": [str(len(elements)), *elements]}
    text = "".join(f"${key}\n{chr(10).join(lines)}\n$End{key}\n" for key, lines in sections.items())
    write_text(checked_path("write_msh", path), text)


def _facet_corners(mesh: dmesh.Mesh) -> npt.NDArray[Any]:
    """Rows of ``mesh.geometry.x`` of the corners of each facet, around it."""
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, 0)
    links = mesh.topology.connectivity(dim - 1, 0)
    corners: npt.NDArray[Any] = vertex_nodes(mesh)[links.array].reshape(-1, links.links(0).size)
    return corners[:, [0, 1, 3, 2]] if corners.shape[1] == 4 else corners


def refine_around(
    model: Any, axes: Sequence[float], radius: float, size: float, smallest: float, reach: float
) -> None:
    """Set the mesh size of a gmsh model, with a smaller size on the curves around bolts parallel to z.

    Parameters
    ----------
    axes
        x of the axes, at y = 0.
    radius
        Curves within this distance of an axis belong to the bolt.
    size, smallest
        Mesh size, and that on these curves.
    reach
        Distance over which one changes to the other.
    """
    curves = []
    for _, curve in model.getEntities(1):
        x0, y0, _, x1, y1, _ = model.getBoundingBox(1, curve)
        if any(max(axis - x0, x1 - axis, y1, -y0) < 1.001 * radius for axis in axes):
            curves.append(curve)
    field = model.mesh.field
    distance, threshold = field.add("Distance"), field.add("Threshold")
    field.setNumbers(distance, "CurvesList", curves)
    field.setNumber(distance, "Sampling", 20)
    field.setNumber(threshold, "InField", distance)
    field.setNumber(threshold, "SizeMin", smallest)
    field.setNumber(threshold, "SizeMax", size)
    field.setNumber(threshold, "DistMin", 0.0)
    field.setNumber(threshold, "DistMax", reach)
    field.setAsBackgroundMesh(threshold)


def curve_elements(model: Any) -> None:
    """Raise the mesh to second order and repair the cells that this folds."""
    mesh, dim = model.mesh, model.getDimension()

    def worst() -> float:
        return min(
            (float(mesh.getElementQualities(tags, "minSJ").min()) for tags in mesh.getElements(dim)[1]),
            default=1.0,
        )

    mesh.setOrder(2)
    if worst() < 0.3:  # on fine meshes this costs more than the mesh itself and is not needed
        for method in ("HighOrderElastic", "HighOrder"):
            mesh.optimize(method)
    if (quality := worst()) <= 0:
        raise SceneError(
            f"curved cells are folded (scaled Jacobian {quality:.2g}); reduce their size or use straight "
            "ones (order=1, geometry_order=1)"
        )
