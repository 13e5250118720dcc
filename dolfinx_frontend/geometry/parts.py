"""Meshes of the parts of an assembly, with named faces.

Every part is a mesh of its own on ``MPI.COMM_SELF``, because a substructure belongs to one process.
Parts that touch have coinciding nodes on the faces they share (unless asked otherwise), but share
no degree of freedom: what connects them is an interface of the scene.

=====================  ===========================================================================
:func:`box`            one block in two or three dimensions
:func:`block_chain`    blocks end to end
:func:`annulus`        sector of a ring, or a whole ring, in two dimensions
:func:`two_rings`      two concentric rings
:func:`bolted_vessel`  pressurised cylinder closed by a screwed cover
:func:`from_gmsh`      any gmsh model with physical groups
:func:`read_msh`       the same from a file
=====================  ===========================================================================

Lengths are in the unit of the coordinates; the defaults of :func:`bolted_vessel` are millimetres.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map, create_mesh, gmsh_cell_permutation
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = [
    "FREE",
    "Assembly",
    "BoltedVessel",
    "Connection",
    "Part",
    "VesselShape",
    "annulus",
    "block_chain",
    "bolted_vessel",
    "box",
    "from_gmsh",
    "gmsh_session",
    "read_msh",
    "two_rings",
]

_log = logging.getLogger(__name__)

Marker = Callable[[Array], npt.NDArray[np.bool_]]

FREE = "free"
"""Name of the exterior facets of a part that no other face claims."""

_NONE = np.empty(0, dtype=np.int32)
_CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


# ---------------------------------------------------------------------------------------------
# Records
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False, repr=False)
class Part:
    """One mesh with named faces.

    Attributes
    ----------
    mesh
        The cells of this part only, on ``MPI.COMM_SELF``.
    facet_tags
        One tag for every exterior facet.
    names
        Face name -> tag.  Facets without a name of their own are in the face :data:`FREE`.
    """

    mesh: dmesh.Mesh
    facet_tags: dmesh.MeshTags
    names: dict[str, int]

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of the faces."""
        return tuple(self.names)

    @property
    def cell(self) -> str:
        """Cell name, for example ``"tetrahedron"``."""
        return str(self.mesh.topology.cell_name())

    @property
    def order(self) -> int:
        """Order of the geometry: 1 for straight cells, 2 for curved ones."""
        return int(coordinate_map(self.mesh).degree)

    @property
    def num_cells(self) -> int:
        """Number of cells."""
        return int(self.mesh.topology.index_map(self.mesh.topology.dim).size_local)

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Facet indices of a face, sorted.

        Raises
        ------
        SceneError
            The part has no such face.
        """
        if name not in self.names:
            raise unknown_name("face", name, self.names)
        return np.asarray(self.facet_tags.find(self.names[name]), dtype=np.int32)

    def volume(self) -> float:
        """Volume, or area in two dimensions."""
        one = fem.Constant(self.mesh, np.float64(1))
        return float(fem.assemble_scalar(fem.form(one * ufl.Measure("dx", domain=self.mesh))))

    def face_area(self, name: str) -> float:
        """Area of a face, or its length in two dimensions."""
        facets = self.facets(name)
        # a tag of its own, always 1: the same compiled form serves every face
        tags = dmesh.meshtags(
            self.mesh, self.mesh.topology.dim - 1, facets, np.ones(facets.size, dtype=np.int32)
        )
        one = fem.Constant(self.mesh, np.float64(1))
        area = one * ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        return float(fem.assemble_scalar(fem.form(area)))

    def __repr__(self) -> str:
        faces = ", ".join(f"{name}: {self.facets(name).size}" for name in self.names)
        return f"Part({self.num_cells} cells {self.cell}, order {self.order}; facets {faces})"


class Connection(NamedTuple):
    """An interface that a geometry suggests; the scene gives it a law.

    ``kind`` is ``"perfect"``, ``"elastic"``, ``"symmetry"``, ``"pressure"`` or ``"support"``;
    faces are written ``"part:face"``; ``face2`` is ``None`` on the boundary.
    """

    name: str
    kind: str
    face1: str
    face2: str | None = None


@dataclass(frozen=True, eq=False)
class Assembly:
    """Parts by name, with the interfaces and the parameters of the geometry they come from."""

    parts: dict[str, Part]
    interfaces: tuple[Connection, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def __repr__(self) -> str:
        lines = [f"{type(self).__name__}: {len(self.parts)} parts"]
        lines += [f"  {name}: {part!r}" for name, part in self.parts.items()]
        if self.interfaces:
            kinds = [c.kind for c in self.interfaces]
            counts = ", ".join(f"{kinds.count(k)} {k}" for k in dict.fromkeys(kinds))
            lines.append(f"  {len(self.interfaces)} interfaces: {counts}")
        return "\n".join(lines)

    def face(self, name: str) -> tuple[Part, str]:
        """The part and the face name of ``"part:face"``."""
        part, _, face = name.partition(":")
        if part not in self.parts:
            raise unknown_name("part", part, self.parts, f"face {name!r}")
        self.parts[part].facets(face)
        return self.parts[part], face


@dataclass(frozen=True, eq=False, repr=False)
class BoltedVessel(Assembly):
    """Sector of a pressurised vessel with half a screw, see :func:`bolted_vessel`."""

    @property
    def screw_area(self) -> float:
        """Cross-section of a whole screw; the sector holds half of it."""
        return math.pi * float(self.parameters["screw_radius"]) ** 2

    @property
    def pressure_force(self) -> float:
        """Axial force of a unit pressure on the cover, per whole screw."""
        p = self.parameters
        return math.pi * float(p["bore_radius"]) ** 2 / int(p["n_screws"])


# ---------------------------------------------------------------------------------------------
# Checks and tags
# ---------------------------------------------------------------------------------------------
def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise SceneError(f"{name} = {value} must be positive and finite")


def _divisions(divisions: Sequence[int], dimension: int) -> list[int]:
    numbers = [int(n) for n in divisions]
    if len(numbers) != dimension or any(n < 1 or n != m for n, m in zip(numbers, divisions)):
        raise SceneError(
            f"divisions = {tuple(divisions)} must be {dimension} whole numbers of at least 1"
        )
    return numbers


def _cell(cell: str, dimension: int) -> dmesh.CellType:
    if _CELLS.get(cell) != dimension:
        allowed = [name for name, dim in _CELLS.items() if dim == dimension]
        raise SceneError(
            f"cell = {cell!r} does not fit {dimension} dimensions; use one of {allowed}"
        )
    return dmesh.to_type(cell)


def _order(geometry_order: int) -> int:
    if geometry_order not in (1, 2):
        raise SceneError(f"geometry_order = {geometry_order} must be 1 (straight) or 2 (curved)")
    return geometry_order


def _exterior(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    topology = mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    return np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)


def _tagged(mesh: dmesh.Mesh, faces: Mapping[str, npt.NDArray[np.int32]]) -> Part:
    """A part from the facets of its faces; exterior facets without a face become free."""
    exterior = _exterior(mesh)
    rest = np.setdiff1d(exterior, np.concatenate([_NONE, *faces.values()]))
    named = dict(faces) | ({FREE: rest} if rest.size else {})
    names = {name: tag for tag, name in enumerate(named, start=1)}
    facets = np.concatenate(list(named.values())).astype(np.int32)
    tags = np.repeat(list(names.values()), [f.size for f in named.values()]).astype(np.int32)
    order = np.argsort(facets)
    meshtags = dmesh.meshtags(mesh, mesh.topology.dim - 1, facets[order], tags[order])
    return Part(mesh, meshtags, names)


def _located(mesh: dmesh.Mesh, markers: Mapping[str, Marker]) -> Part:
    """A part whose faces are the boundary facets with all vertices where a marker holds."""
    dim = mesh.topology.dim - 1
    return _tagged(
        mesh,
        {
            name: np.asarray(dmesh.locate_entities_boundary(mesh, dim, marker), dtype=np.int32)
            for name, marker in markers.items()
        },
    )


# ---------------------------------------------------------------------------------------------
# Blocks
# ---------------------------------------------------------------------------------------------
def box(
    lengths: Sequence[float],
    divisions: Sequence[int],
    origin: Sequence[float] | None = None,
    cell: str | None = None,
) -> Part:
    """A block with faces ``x0``, ``x1``, ``y0``, ``y1`` and, in three dimensions, ``z0``, ``z1``.

    Parameters
    ----------
    lengths
        Two or three edge lengths.
    divisions
        Cells along each edge.
    origin
        The corner with the lowest coordinates; the origin if not given.
    cell
        ``"triangle"`` or ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``; the
        quadrilateral and the hexahedron if not given.

    Raises
    ------
    SceneError
        A length that is not positive, a cell of another dimension, divisions that do not fit.
    """
    dim = len(lengths)
    if dim not in (2, 3):
        raise SceneError(f"lengths = {tuple(lengths)} must hold 2 or 3 edge lengths")
    _positive(**{f"lengths[{i}]": float(v) for i, v in enumerate(lengths)})
    numbers = _divisions(divisions, dim)
    low = np.zeros(dim) if origin is None else np.asarray(origin, dtype=np.float64)
    if low.shape != (dim,):
        raise SceneError(f"origin = {origin} must have {dim} coordinates, like the lengths")
    high = low + np.asarray(lengths, dtype=np.float64)
    cell_type = _cell(cell or ("quadrilateral", "hexahedron")[dim - 2], dim)
    build = dmesh.create_rectangle if dim == 2 else dmesh.create_box
    mesh = build(MPI.COMM_SELF, [low, high], numbers, cell_type=cell_type)

    def plane(axis: int, value: float) -> Marker:
        tolerance = 1e-3 * float(lengths[axis]) / numbers[axis]
        return lambda x: np.abs(x[axis] - value) < tolerance

    return _located(
        mesh,
        {
            f"{'xyz'[axis]}{end}": plane(axis, float((low, high)[end][axis]))
            for axis in range(dim)
            for end in (0, 1)
        },
    )


def block_chain(
    n: int,
    lengths: Sequence[float] = (1.0, 1.0, 1.0),
    divisions: Sequence[int] | Sequence[Sequence[int]] = (2, 2, 2),
    axis: int = 0,
    cell: str | None = None,
) -> Assembly:
    """Blocks end to end: parts ``block0``, ``block1``, ... along an axis.

    Parameters
    ----------
    n
        Number of blocks.
    lengths
        Edge lengths of each block.
    divisions
        Cells along each edge, for all blocks alike (meshes match) or one triple or pair per block.
    axis
        Direction of the chain.
    cell
        As in :func:`box`.

    Returns
    -------
    Assembly
        With the interfaces ``link1`` (between ``block0`` and ``block1``), ``link2``, ...
    """
    dim = len(lengths)
    if n < 1:
        raise SceneError(f"n = {n} must be at least 1")
    if axis not in range(dim):
        raise SceneError(f"axis = {axis} must be between 0 and {dim - 1}")
    each = np.asarray(divisions, dtype=int)
    if each.shape not in ((dim,), (n, dim)):
        raise SceneError(f"divisions = {divisions} must be {dim} numbers, or {n} rows of {dim}")
    each = np.broadcast_to(each, (n, dim))
    step = np.eye(dim)[axis] * float(lengths[axis])
    parts = {
        f"block{i}": box(lengths, row.tolist(), (i * step).tolist(), cell)
        for i, row in enumerate(each)
    }
    end = "xyz"[axis]
    links = tuple(
        Connection(f"link{i}", "perfect", f"block{i - 1}:{end}1", f"block{i}:{end}0")
        for i in range(1, n)
    )
    return Assembly(parts, links, MappingProxyType({"n": n, "lengths": tuple(lengths)}))


# ---------------------------------------------------------------------------------------------
# Rings
# ---------------------------------------------------------------------------------------------
def annulus(
    inner: float,
    outer: float,
    angle: float = math.pi / 2,
    divisions: Sequence[int] = (8, 16),
    cell: str = "quadrilateral",
    geometry_order: int = 2,
) -> Part:
    """Sector of a ring between the polar angles 0 and ``angle``, centred at the origin.

    Parameters
    ----------
    inner, outer
        Radii.
    angle
        Opening in radians; ``2 * pi`` gives the whole ring.
    divisions
        Cells along the radius and along the arc.
    cell
        ``"quadrilateral"`` or ``"triangle"``.
    geometry_order
        1: chords, area in error by the square of the cell angle; 2: parabolic arcs, in error by
        its fourth power.

    Returns
    -------
    Part
        Faces ``inner``, ``outer`` and, unless the ring is whole, ``theta0``, ``theta1``.
    """
    _positive(inner=inner, outer=outer, angle=angle)
    if outer <= inner:
        raise SceneError(f"outer = {outer} must exceed inner = {inner}")
    whole = math.isclose(angle, 2 * math.pi, rel_tol=1e-12)
    if angle > 2 * math.pi and not whole:
        raise SceneError(f"angle = {angle} must not exceed 2 pi")
    n_r, n_t = _divisions(divisions, 2)
    if whole and n_t < 3:
        raise SceneError(f"divisions = {tuple(divisions)}: a whole ring needs 3 cells along it")
    order = _order(geometry_order)
    flat = dmesh.create_rectangle(
        MPI.COMM_SELF, [np.zeros(2), np.ones(2)], [n_r, n_t], cell_type=_cell(cell, 2)
    )
    # the nodes of a Lagrange space on the unit square are the nodes of the curved mesh
    space = fem.functionspace(flat, ("Lagrange", order))
    lattice = np.rint(
        space.tabulate_dof_coordinates()[:, :2] * (order * n_r, order * n_t)
    ).astype(np.int64)
    if whole:
        lattice[:, 1] %= order * n_t
    nodes, place = np.unique(lattice, axis=0, return_inverse=True)
    radius = inner + (outer - inner) * nodes[:, 0] / (order * n_r)
    theta = angle * nodes[:, 1] / (order * n_t)
    x = np.column_stack([radius * np.cos(theta), radius * np.sin(theta)])
    cells = place.reshape(-1)[space.dofmap.list].astype(np.int64)
    mesh = create_mesh(cells, x, cell, order)

    small = 1e-3 * min((outer - inner) / n_r, inner * angle / n_t)

    def arc(value: float) -> Marker:
        return lambda x: np.abs(np.hypot(x[0], x[1]) - value) < small

    def ray(value: float) -> Marker:
        cos, sin = math.cos(value), math.sin(value)
        return lambda x: (np.abs(cos * x[1] - sin * x[0]) < small) & (cos * x[0] + sin * x[1] > 0)

    markers = {"inner": arc(inner), "outer": arc(outer)}
    if not whole:
        markers |= {"theta0": ray(0.0), "theta1": ray(angle)}
    return _located(mesh, markers)


def two_rings(
    a: float,
    c: float,
    b: float,
    angle: float = math.pi / 2,
    divisions: Sequence[int] = (6, 16),
    outer_divisions: Sequence[int] | None = None,
    cell: str = "quadrilateral",
    geometry_order: int = 2,
) -> Assembly:
    """Two concentric rings, ``inner`` between the radii a and c, ``outer`` between c and b.

    ``outer_divisions`` differs from ``divisions`` when the meshes shall not match.  The interfaces
    are the joint at r = c, the pressure at r = a and the symmetry planes; see :func:`annulus` for
    the other arguments.
    """
    outer_divisions = divisions if outer_divisions is None else outer_divisions
    parts = {
        "inner": annulus(a, c, angle, divisions, cell, geometry_order),
        "outer": annulus(c, b, angle, outer_divisions, cell, geometry_order),
    }
    links = [
        Connection("joint", "elastic", "inner:outer", "outer:inner"),
        Connection("pressure", "pressure", "inner:inner"),
    ]
    links += [
        Connection(f"symmetry {name} {face}", "symmetry", f"{name}:{face}")
        for name in parts
        for face in ("theta0", "theta1")
        if face in parts[name].names
    ]
    parameters = MappingProxyType({"a": a, "c": c, "b": b, "angle": angle})
    return Assembly(parts, tuple(links), parameters)


# ---------------------------------------------------------------------------------------------
# gmsh
# ---------------------------------------------------------------------------------------------
@contextmanager
def gmsh_session(
    name: str = "assembly", options: Mapping[str, float] | None = None
) -> Iterator[Any]:
    """A gmsh model of its own, silent, gone at the end.

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


def _vertex_nodes(mesh: dmesh.Mesh) -> npt.NDArray[np.int64]:
    """Row in the input coordinates of every vertex of a mesh on one process, (vertices,)."""
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim, 0)
    vertices = mesh.topology.connectivity(dim, 0)
    width = vertices.links(0).size
    geometry = np.empty(mesh.topology.index_map(0).size_local, dtype=np.int64)
    # vertices come first among the geometry nodes of a cell
    geometry[vertices.array] = cell_nodes(mesh)[:, :width].reshape(-1)
    return np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)[geometry]


def from_gmsh(model: Any, gdim: int | None = None) -> Assembly:
    """Split a meshed gmsh model into parts.

    Physical groups say what is what:

    * every group of the highest dimension is a part and gives it its name;
    * a group one dimension lower named ``"part:face"`` is a face of that part;
    * one named without a colon is a face of that name of *every* part it touches, as suits
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
            found = np.concatenate([_NONE, *(index.find(block) for block in blocks)])
            if found.size:
                used.add(group)
                faces[face if colon else group] = found
        _check_faces(name, mesh, faces)
        parts[name] = _tagged(mesh, faces)
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
    return mesh, kept[_vertex_nodes(mesh)]


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
    exterior = _exterior(mesh)
    claimed: npt.NDArray[np.int32] = _NONE
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
    if not Path(path).is_file():
        raise SceneError(f"there is no mesh file {str(path)!r}")
    with gmsh_session("file") as gmsh:
        gmsh.merge(str(path))
        return from_gmsh(gmsh.model, gdim)


# ---------------------------------------------------------------------------------------------
# The bolted vessel
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class VesselShape:
    """Dimensions of :func:`bolted_vessel`, in mm.

    Attributes
    ----------
    n_screws
        Number of screws; the sector modelled opens by pi / n_screws.
    bore_radius, wall_thickness, height
        The cylinder, from its cut (z = 0) to the seat of the joint ring (z = height).
    flange_thickness, flange_radius
        The flange around the upper end of the cylinder, its top flush with it; the cover has the
        same outer radius.
    ring_thickness
        The joint ring, as wide as the wall.
    cover_thickness
        The cover, a full disc.
    bolt_circle, screw_radius, hole_radius, head_radius, head_height
        Radius of the circle of the screw axes, the shank, the clearance hole in the cover, the
        head.

    Raises
    ------
    SceneError
        A dimension that is not positive, or two that contradict each other.
    """

    n_screws: int = 8
    bore_radius: float = 90.0
    wall_thickness: float = 20.0
    height: float = 100.0
    flange_thickness: float = 30.0
    flange_radius: float = 160.0
    ring_thickness: float = 6.0
    cover_thickness: float = 30.0
    bolt_circle: float = 135.0
    screw_radius: float = 9.0
    hole_radius: float = 11.0
    head_radius: float = 16.0
    head_height: float = 14.0

    def __post_init__(self) -> None:
        _positive(**asdict(self))
        if self.n_screws != int(self.n_screws) or self.n_screws < 3:
            raise SceneError(f"n_screws = {self.n_screws} must be a whole number of at least 3")
        hole_inside = self.bolt_circle - self.hole_radius
        head_outside = self.bolt_circle + self.head_radius
        to_plane = self.bolt_circle * math.sin(self.angle)
        for rule, low, high in (
            ("flange_thickness < height", self.flange_thickness, self.height),
            ("screw_radius < hole_radius", self.screw_radius, self.hole_radius),
            ("hole_radius < head_radius", self.hole_radius, self.head_radius),
            ("bore_radius + wall_thickness < bolt_circle - hole_radius", self.wall, hole_inside),
            ("bolt_circle + head_radius < flange_radius", head_outside, self.flange_radius),
            ("head_radius < bolt_circle sin(pi / n_screws)", self.head_radius, to_plane),
        ):
            if not low < high:
                raise SceneError(f"the vessel needs {rule}, but {low:g} >= {high:g}")

    @property
    def angle(self) -> float:
        """Opening of the sector in radians."""
        return math.pi / self.n_screws

    @property
    def wall(self) -> float:
        """Outer radius of the cylinder."""
        return self.bore_radius + self.wall_thickness

    @property
    def levels(self) -> tuple[float, float, float, float, float]:
        """z of the flange's bottom, ring's bottom, ring's top, cover's top and head's top."""
        cover = self.height + self.ring_thickness
        seat = cover + self.cover_thickness
        low = self.height - self.flange_thickness
        return low, self.height, cover, seat, seat + self.head_height


_VESSEL_SIZES = {"coarse": 28.0, "paper": 9.6}  # mm, for a flange radius of 160 mm
_VESSEL_INTERFACES = (
    Connection("weld", "perfect", "cylinder:weld", "flange:weld"),
    Connection("ring seat", "perfect", "cylinder:top", "ring:bottom"),
    Connection("thread", "perfect", "flange:thread", "shank:thread"),
    Connection("head seat", "perfect", "cover:seat", "head:seat"),
    Connection("joint", "elastic", "ring:top", "cover:joint"),
    Connection("screw", "elastic", "shank:top", "head:shank"),
    *(Connection(f"pressure {p}", "pressure", f"{p}:inner") for p in ("cylinder", "ring", "cover")),
    *(
        Connection(f"symmetry {p} {face}", "symmetry", f"{p}:{face}")
        for p in ("cylinder", "flange", "ring", "cover", "shank", "head")
        for face in (("theta0",) if p in ("shank", "head") else ("theta0", "theta1"))
    ),
    Connection("support", "support", "cylinder:bottom"),
)


def bolted_vessel(
    size: str | float = "coarse", *, geometry_order: int = 2, **dimensions: float
) -> BoltedVessel:
    """A pressurised cylinder closed by a screwed cover: the sector that holds half a screw.

    The example of Blanze, Champaney and Boucard (ECCOMAS 2004, section 5) in six parts and twenty
    interfaces.  The axis of the vessel is z, the axis of the screw lies in the symmetry plane
    theta = 0, the other symmetry plane is theta = pi / n_screws.

    ==========  ===========================  ============================================
    part        what it is                   faces besides ``theta0``, ``theta1``, ``free``
    ==========  ===========================  ============================================
    cylinder    the wall, up to the joint    bottom, inner, top, weld
    flange      welded around its end        weld, thread
    ring        seat of the joint            bottom, inner, top
    cover       full disc, clearance hole    inner, joint, seat
    shank       half the screw's body        thread, top
    head        half the screw's head        shank, seat
    ==========  ===========================  ============================================

    The interfaces are in ``vessel.interfaces``:

    * perfect (4): cylinder:weld - flange:weld, cylinder:top - ring:bottom,
      flange:thread - shank:thread, cover:seat - head:seat;
    * elastic (2): the joint ring:top - cover:joint and the screw shank:top - head:shank;
    * pressure (3): cylinder:inner, ring:inner, cover:inner;
    * symmetry (10): theta0 of every part, theta1 of every part but shank and head;
    * support (1): cylinder:bottom, held along z.

    The meshes are tetrahedra and match node for node across every pair of faces.  The sector
    carries half a screw: a whole-screw stiffness K is K / ``vessel.screw_area`` per unit area.

    Parameters
    ----------
    size
        ``"coarse"``, ``"paper"`` or the cell size in the unit of the dimensions; cells on the
        screw are smaller.  The two names scale with the flange radius.  Degrees of freedom of
        quadratic displacements, all parts together, default dimensions (the paper has 23 760):

        =========  =======  =======  =======  ========  ========
        size       coarse   paper    6        5         3
        h (mm)     28       9.6      6        5         3
        dof        5 800    24 400   67 000   105 000   403 000
        =========  =======  =======  =======  ========  ========
    geometry_order
        2: cells follow the cylinders (default); 1: straight cells, whose polygons lose a few
        percent of the screw's section on a coarse mesh.
    **dimensions
        Any attribute of :class:`VesselShape`.

    Notes
    -----
    The dimensions of the paper are in a figure that is not legible, so the defaults are a choice:
    with E = 200 GPa, nu = 0.3, 1.6 MPa inside, screws of 5e4 N/mm shortened by 0.2 mm and a joint
    of 100 N/mm^3 in all directions, the joint is in compression everywhere (-2.25 to -0.54 MPa),
    least at the bore between two screws.  With independent standard normal germs, coefficients of
    variation 0.1 (screw) and 0.2 (joint), it is in traction somewhere with a probability of about
    4 %.

    Raises
    ------
    SceneError
        Unknown names, dimensions that contradict each other, a size too coarse to mesh.
    """
    order = _order(geometry_order)
    known = [f.name for f in fields(VesselShape)]
    for name in dimensions:
        if name not in known:
            raise unknown_name("dimension", name, known, "bolted_vessel")
    shape = VesselShape(**dimensions)  # type: ignore[arg-type]
    if isinstance(size, str):
        if size not in _VESSEL_SIZES:
            raise unknown_name("size", size, _VESSEL_SIZES, "bolted_vessel")
        size = _VESSEL_SIZES[size] * shape.flange_radius / 160.0
    _positive(size=size)
    options = {
        "Mesh.MeshSizeFromPoints": 0.0,
        "Mesh.MeshSizeFromCurvature": 0.0,
        "Mesh.MeshSizeExtendFromBoundary": 0.0,
        "Mesh.Algorithm": 6.0,
        "Mesh.Algorithm3D": 1.0,
        "Mesh.SecondOrderIncomplete": 0.0,
    }
    with gmsh_session("bolted_vessel", options) as gmsh:
        volumes = _vessel_volumes(gmsh.model, shape)
        refine_around(
            gmsh.model,
            [shape.bolt_circle],
            shape.head_radius,
            size,
            # at least three cells along a half circle, or curved cells fold
            smallest=min(0.6 * size, 1.05 * shape.screw_radius),
            reach=2 * shape.head_radius,
        )
        try:
            gmsh.model.mesh.generate(3)
        except Exception as failure:  # gmsh raises nothing more specific
            raise SceneError(
                f"gmsh cannot mesh the vessel with size = {size:g} ({failure}); reduce size"
            ) from failure
        if order == 2:
            _curve(gmsh.model)
        _name_faces(gmsh.model, shape, volumes)
        parts = from_gmsh(gmsh.model).parts
    parameters = asdict(shape) | {"mesh_size": size, "geometry_order": order}
    return BoltedVessel(parts, _VESSEL_INTERFACES, MappingProxyType(parameters))


def _vessel_volumes(model: Any, shape: VesselShape) -> dict[str, list[int]]:
    """Build the solids with shared surfaces; part name -> volume tags, also as groups."""
    occ = model.occ
    flange, ring, cover, seat, end = shape.levels
    bore, wall, outer = shape.bore_radius, shape.wall, shape.flange_radius
    solid = tuple[int, int]

    def disc(radius: float, low: float, high: float) -> solid:
        return 3, occ.addCylinder(0, 0, low, 0, 0, high - low, radius, angle=shape.angle)

    def pin(radius: float, low: float, high: float) -> solid:
        x = shape.bolt_circle
        return 3, occ.addCylinder(x, 0, low, 0, 0, high - low, radius, angle=math.pi)

    def cut(body: solid, *tools: solid) -> solid:
        dimension, tag = occ.cut([body], list(tools))[0][0]
        return dimension, tag

    bodies = {
        "cylinder": cut(disc(wall, 0, ring), disc(bore, 0, ring)),
        "flange": cut(
            disc(outer, flange, ring),
            disc(wall, flange, ring),
            pin(shape.screw_radius, flange, ring),
        ),
        "ring": cut(disc(wall, ring, cover), disc(bore, ring, cover)),
        "cover": cut(disc(outer, cover, seat), pin(shape.hole_radius, cover, seat)),
        "shank": pin(shape.screw_radius, flange, seat),
        "head": pin(shape.head_radius, seat, end),
    }
    first, *others = bodies.values()
    _, pieces = occ.fragment([first], others)
    occ.synchronize()
    volumes = {name: [tag for _, tag in piece] for name, piece in zip(bodies, pieces)}
    for name, tags in volumes.items():
        model.addPhysicalGroup(3, tags, name=name)
    return volumes


def refine_around(
    model: Any, axes: Sequence[float], radius: float, size: float, smallest: float, reach: float
) -> None:
    """Set the mesh size of a gmsh model: smaller on the curves around bolts whose axes are parallel to z.

    Parameters
    ----------
    axes
        x of the axes, at y = 0.
    radius
        Curves that lie within it of an axis are the bolt's.
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


def _curve(model: Any) -> None:
    """Raise the mesh to second order and unfold the cells that this deforms too much."""
    mesh = model.mesh

    def worst() -> float:
        return min(
            float(mesh.getElementQualities(tags, "minSJ").min()) for tags in mesh.getElements(3)[1]
        )

    mesh.setOrder(2)
    if worst() < 0.3:  # costs more than the mesh itself on fine meshes, which do not need it
        for method in ("HighOrderElastic", "HighOrder"):
            mesh.optimize(method)
    if (quality := worst()) <= 0:
        raise SceneError(
            f"curved cells are folded (scaled Jacobian {quality:.2g}); reduce size or use "
            "geometry_order=1"
        )


def _name_faces(model: Any, shape: VesselShape, volumes: Mapping[str, Sequence[int]]) -> None:
    """Physical groups ``part:face`` for the surfaces, told apart by where their nodes are."""
    faces: dict[str, list[int]] = {}
    for part, tags in volumes.items():
        for _, surface in model.getBoundary([(3, tag) for tag in tags], oriented=False):
            _, nodes, _ = model.mesh.getNodes(2, surface, True, False)
            face = _vessel_face(part, shape, nodes.reshape(-1, 3))
            if face != FREE:
                faces.setdefault(f"{part}:{face}", []).append(surface)
    for name, surfaces in faces.items():
        model.addPhysicalGroup(2, surfaces, name=name)


def _vessel_face(part: str, shape: VesselShape, x: Array) -> str:
    """Face of the part that a surface with the nodes x, (nodes, 3), belongs to."""
    flange, ring, cover, seat, _ = shape.levels
    cos, sin = math.cos(shape.angle), math.sin(shape.angle)
    small = 1e-6 * shape.flange_radius
    z = x[:, 2]
    r = np.hypot(x[:, 0], x[:, 1])  # from the axis of the vessel
    d = np.hypot(x[:, 0] - shape.bolt_circle, x[:, 1])  # from the axis of the screw

    def at(value: Array, target: float) -> bool:
        return bool(np.all(np.abs(value - target) < small))

    def below(value: Array, limit: float) -> bool:
        return bool(value.max() < limit + small)

    def above(value: Array, limit: float) -> bool:
        return bool(value.min() > limit - small)

    if at(x[:, 1], 0.0):
        return "theta0"
    if at(cos * x[:, 1] - sin * x[:, 0], 0.0):
        return "theta1"
    tests = {
        "cylinder": {
            "bottom": at(z, 0.0),
            "inner": at(r, shape.bore_radius),
            "top": at(z, ring),
            "weld": at(r, shape.wall) and above(z, flange),
        },
        "flange": {"weld": at(r, shape.wall), "thread": at(d, shape.screw_radius)},
        "ring": {"bottom": at(z, ring), "inner": at(r, shape.bore_radius), "top": at(z, cover)},
        "cover": {
            "inner": at(z, cover) and below(r, shape.bore_radius),
            "joint": at(z, cover) and above(r, shape.bore_radius) and below(r, shape.wall),
            "seat": at(z, seat) and below(d, shape.head_radius),
        },
        "shank": {"thread": at(d, shape.screw_radius) and below(z, ring), "top": at(z, seat)},
        "head": {
            "shank": at(z, seat) and below(d, shape.screw_radius),
            "seat": at(z, seat) and above(d, shape.hole_radius),
        },
    }
    return next((face for face, holds in tests[part].items() if holds), FREE)
