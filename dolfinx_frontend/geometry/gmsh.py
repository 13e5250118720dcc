"""Parts from gmsh: sessions, models and .msh files."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_path, checked_whole
from dolfinx_frontend.common.compat import create_mesh, gmsh_cell_permutation, vertex_nodes
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import NO_FACETS, Assembly, Part, exterior_facets, tagged

__all__ = ["from_gmsh", "gmsh_session", "read_msh"]

_log = logging.getLogger(__name__)


@contextmanager
def gmsh_session(
    name: str = "assembly", options: Mapping[str, float] | None = None
) -> Iterator[Any]:
    """A gmsh model of its own, without output, removed at the end.

    A session that is already open stays open, with its current model and its options restored.

    Parameters
    ----------
    name
        Name of the model.
    options
        gmsh options, for example ``{"Mesh.Algorithm3D": 1}``.

    Yields
    ------
    The ``gmsh`` module.
    """
    import gmsh

    began = perf_counter()
    ours = not gmsh.isInitialized()
    if ours:
        # no configuration files: the same mesh for everyone; not interruptible: Ctrl-C is Python's
        gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    previous = "" if ours else gmsh.model.getCurrent()
    wanted = {"General.Terminal": 0.0, "General.NumThreads": 1.0} | dict(options or {})
    before = {key: gmsh.option.getNumber(key) for key in wanted}
    try:
        for key, value in wanted.items():
            gmsh.option.setNumber(key, value)
        gmsh.model.add(name)
        try:
            yield gmsh
        finally:
            gmsh.model.setCurrent(name)
            gmsh.model.remove()
    finally:
        for key, value in before.items():
            gmsh.option.setNumber(key, value)
        if ours:
            gmsh.finalize()
        elif previous in gmsh.model.list():
            gmsh.model.setCurrent(previous)
        _log.info("gmsh: %s, %.2f s", name, perf_counter() - began)


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


def _elements(model: Any, dim: int, entities: Sequence[int]) -> dict[int, npt.NDArray[np.int64]]:
    """gmsh element type -> node tags of its elements on these entities, (elements, nodes)."""
    found: dict[int, list[npt.NDArray[np.int64]]] = {}
    for entity in entities:
        types, _, nodes = model.mesh.getElements(dim, entity)
        for kind, tags in zip(types, nodes):
            width = model.mesh.getElementProperties(kind)[3]
            found.setdefault(int(kind), []).append(tags.astype(np.int64).reshape(-1, width))
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def from_gmsh(model: Any, gdim: int | None = None) -> Assembly:
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

    Raises
    ------
    SceneError
        No mesh, no part, a group without a name, a face without its part or without facets on it,
        a facet in two faces of a part or inside a part, mixed or unsupported cells.
    """
    if not hasattr(model, "getPhysicalGroups"):
        raise SceneError(f"from_gmsh: model = {short(model)} is no gmsh model; give gmsh.model")
    if gdim is not None:
        checked_whole("from_gmsh", "gdim", gdim, 2, 3)
    groups = model.getPhysicalGroups()
    dim = max((d for d, _ in groups), default=-1)
    if dim < 2:
        raise SceneError(
            "the gmsh model has no physical group of volumes or, in 2D, of surfaces; name every "
            "part with addPhysicalGroup(dim, tags, name=...)"
        )
    entities: dict[int, dict[str, Sequence[int]]] = {dim: {}, dim - 1: {}}
    for d, tag in groups:
        if d < dim - 1:
            continue
        name = model.getPhysicalName(d, tag)
        if not name or name in entities[d]:
            raise SceneError(
                f"physical group {tag} of dimension {d} has the name {name!r}; every group needs "
                "a name of its own: addPhysicalGroup(dim, tags, name=...)"
            )
        entities[d][name] = model.getEntitiesForPhysicalGroup(d, tag)
    cells, facets = entities[dim], entities[dim - 1]
    for name in facets:
        if ":" in name and name.partition(":")[0] not in cells:
            raise SceneError(
                f"the face {name!r} belongs to no part; the parts are: {', '.join(cells)}"
            )

    node_tags, coordinates, _ = model.mesh.getNodes()
    row = np.full(int(node_tags.max(initial=0)) + 1, -1, dtype=np.int64)
    row[node_tags.astype(np.int64)] = np.arange(node_tags.size)
    x = coordinates.reshape(-1, 3)[:, : gdim or dim]
    rows = {
        name: [row[nodes] for nodes in _elements(model, dim - 1, tags).values()]
        for name, tags in facets.items()
    }

    parts: dict[str, Part] = {}
    used: set[str] = set()
    for name, tags in cells.items():
        mesh, node_of_vertex = _gmsh_mesh(model, name, _elements(model, dim, tags), row, x)
        faces: dict[str, npt.NDArray[np.int32]] = {}
        index = _FacetIndex(mesh, node_of_vertex)
        for group, blocks in rows.items():
            owner, colon, face = group.partition(":")
            if colon and owner != name:
                continue
            found = np.concatenate([NO_FACETS, *(index.find(block) for block in blocks)])
            if found.size:
                used.add(group)
                faces[face if colon else group] = found
        _check_faces(name, mesh, faces)
        parts[name] = tagged(mesh, faces)
    if unused := [group for group in facets if group not in used]:
        raise SceneError(
            f"no facet of a part lies on the face {unused[0]!r}; check the entities of its "
            "physical group"
        )
    _log.info("meshes: %d cells in %d parts", sum(part.num_cells for part in parts.values()), len(parts))
    return Assembly(parts)


def _gmsh_mesh(
    model: Any,
    name: str,
    blocks: dict[int, npt.NDArray[np.int64]],
    row: npt.NDArray[np.int64],
    x: Array,
) -> tuple[dmesh.Mesh, npt.NDArray[np.int64]]:
    """Mesh of one part, and the row in ``x`` of each of its vertices."""
    if not blocks:
        raise SceneError(f"the part {name!r} has no cells; call gmsh.model.mesh.generate first")
    described = ", ".join(model.mesh.getElementProperties(kind)[0] for kind in blocks)
    if len(blocks) > 1:
        raise SceneError(f"the part {name!r} mixes cells ({described}); mesh it with one type")
    ((kind, nodes),) = blocks.items()
    if kind not in _GMSH_CELLS:
        raise SceneError(
            f"the part {name!r} has cells {described!r}; use triangles, quadrilaterals, "
            "tetrahedra or hexahedra of order 1 or 2 (with Mesh.SecondOrderIncomplete = 0)"
        )
    cell, order = _GMSH_CELLS[kind]
    permuted = row[nodes[:, gmsh_cell_permutation(cell, nodes.shape[1])]]
    kept, local = np.unique(permuted, return_inverse=True)
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


def read_msh(path: str | Path, gdim: int | None = None) -> Assembly:
    """The parts of a gmsh file with physical groups, see :func:`from_gmsh`."""
    if not checked_path("read_msh", path).is_file():
        raise SceneError(f"there is no mesh file {str(path)!r}")
    with gmsh_session("file") as gmsh:
        try:
            gmsh.merge(str(path))
        except Exception as error:  # gmsh has no class of its own
            raise SceneError(f"the mesh file {str(path)!r} cannot be read: {error}") from error
        return from_gmsh(gmsh.model, gdim)


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
    mesh = model.mesh

    def worst() -> float:
        return min(
            float(mesh.getElementQualities(tags, "minSJ").min()) for tags in mesh.getElements(3)[1]
        )

    mesh.setOrder(2)
    if worst() < 0.3:  # on fine meshes this costs more than the mesh itself and is not needed
        for method in ("HighOrderElastic", "HighOrder"):
            mesh.optimize(method)
    if (quality := worst()) <= 0:
        raise SceneError(
            f"curved cells are folded (scaled Jacobian {quality:.2g}); reduce size or use "
            "geometry_order=1"
        )
