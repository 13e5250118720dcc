"""Parts and assemblies of parts: meshes with named faces."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import basix
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    checked_callable,
    checked_name,
    is_list,
    is_real,
    is_whole,
)
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import OneProcess, ReadOnlyDict

__all__ = ["FREE", "Assembly", "Connection", "Part"]

Marker = Callable[[Array], npt.NDArray[np.bool_]]

FREE = "free"
"""Name of the exterior facets of a part that no other face claims."""

NO_FACETS = np.empty(0, dtype=np.int32)

_ENOUGH = 0.5
"""Share of what a face is meant to be that whole facets cover: with less it is another one."""

_CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


@dataclass(frozen=True, eq=False, repr=False)
class Part(OneProcess):
    """One mesh with named faces.

    Attributes
    ----------
    mesh
        The cells of this part only, on ``MPI.COMM_SELF``.
    facet_tags
        One tag for every exterior facet.
    names
        Face name -> tag.  Facets without a name of their own are in the face :data:`FREE`.
    again
        Meshes the same geometry with other sizes (:class:`SizeField`), with the same faces; None: only the
        cells that there are can be cut, see :func:`remeshable`.
    """

    mesh: dmesh.Mesh
    facet_tags: dmesh.MeshTags
    names: dict[str, int]
    again: Callable[[Any], Part] | None = None

    @property
    def _instead(self) -> str:
        return "its mesh lives in this process; make it in the process that needs it"

    def __post_init__(self) -> None:
        check_kind("Part", "mesh", self.mesh, dmesh.Mesh, "give a dolfinx mesh")
        check_kind("Part", "facet_tags", self.facet_tags, dmesh.MeshTags, "give the tags of its facets")
        check_kind("Part", "names", self.names, Mapping, "give {face: tag}")
        object.__setattr__(self, "names", ReadOnlyDict(self.names))

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
        check_known("face", name, self.names)
        return np.asarray(self.facet_tags.find(self.names[name]), dtype=np.int32)

    def with_face(self, name: str, where: Marker, of: str | None = None) -> Part:
        """The same mesh with one more face, which takes its facets from the others: under a head, say.

        Parameters
        ----------
        where
            Of coordinates (3, n): where (n,) they are on it, as of ``dolfinx.mesh.locate_entities_boundary``;
            a facet is on it with all its corners.
        of
            Face that it is cut out of; None: any.

        Raises
        ------
        SceneError
            A name that is in use, a face that there is not, or no facet there.

        Warns
        -----
        SceneWarning
            Cells are so large that whole facets cover less than half of it.
        """
        if checked_name("with_face", name, colon=False) in self.names:
            known = ", ".join(self.names)
            raise SceneError(f"with_face: face {name!r}: the name is in use; there are {known}")
        within = exterior_facets(self.mesh) if of is None else self.facets(of)
        checked_callable("with_face", "where", where, "give a function of coordinates (3, n)")
        dim = self.mesh.topology.dim - 1
        facets = np.intersect1d(dmesh.locate_entities_boundary(self.mesh, dim, where), within)
        there = "of the boundary" if of is None else f"of face {of!r}"
        meant = self._area(within, where)
        if not facets.size:
            raise SceneError(
                f"with_face: face {name!r}: no facet {there} has all its corners where the function holds "
                f"(about {meant:.3g} of {self._area(within):.4g} in {within.size} facets): smaller cells, or "
                "a larger face"
            )
        covered = self._area(facets)
        if covered < _ENOUGH * meant:
            warn(
                f"with_face: face {name!r}: facets {there} that have all their corners where the function "
                f"holds cover {covered:.3g} of about {meant:.3g}: smaller cells, or a mesh with its edge",
                SceneWarning,
            )
        rest = {each: np.setdiff1d(self.facets(each), facets) for each in self.names if each != FREE}
        return tagged(self.mesh, {**{n: own for n, own in rest.items() if own.size}, name: facets})

    def _area(self, facets: npt.NDArray[np.int32], where: Marker | None = None) -> float:
        """Area of facets (n > 0,), straight, or about of where a function holds on them."""
        dim = self.mesh.topology.dim - 1
        x: Array = np.asarray(self.mesh.geometry.x, dtype=np.float64)
        corners = x[dmesh.entities_to_geometry(self.mesh, dim, facets)]
        if corners.shape[1] > dim + 1:
            corners = np.concatenate([corners[:, :3], corners[:, 1:]])  # in the order of basix
        edges = corners[:, 1:] - corners[:, :1]
        size = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        kind = (basix.CellType.interval, basix.CellType.triangle)[dim - 1]
        inside, weights = map(np.asarray, basix.make_quadrature(kind, 8))
        points = corners[:, :1] + inside @ edges
        holds = np.ones(points.shape[:2]) if where is None else where(points.reshape(-1, 3).T)
        return float(size @ (np.reshape(holds, points.shape[:2]) @ weights))

    def volume(self) -> float:
        """Volume, or area in two dimensions."""
        one = fem.Constant(self.mesh, np.float64(1))
        return float(fem.assemble_scalar(fem.form(one * ufl.Measure("dx", domain=self.mesh))))

    def face_area(self, name: str) -> float:
        """Area of a face, or its length in two dimensions."""
        facets = self.facets(name)
        # always the tag 1, so that one compiled form serves all faces
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
    """An interface that the geometry proposes; the scene gives it a law.

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

    def __post_init__(self) -> None:
        check_kind("Assembly", "parts", self.parts, Mapping, "give {name: part}")
        for name, part in self.parts.items():
            check_kind("Assembly", f"parts[{name!r}]", part, Part, "give a Part")
        object.__setattr__(self, "parts", ReadOnlyDict(self.parts))

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
        if not isinstance(name, str):
            raise SceneError(f"face {name!r}: write 'part:face'")
        part, _, face = name.partition(":")
        check_known("part", part, self.parts, f"face {name!r}")
        self.parts[part].facets(face)
        return self.parts[part], face


def check_positive(**values: float) -> None:
    for name, value in values.items():
        if not is_real(value):
            raise SceneError(f"{name} = {short(value)} is not a number")
        if not (math.isfinite(value) and value > 0):
            raise SceneError(f"{name} = {value} must be positive and finite")


def check_divisions(divisions: Sequence[int], dimension: int) -> list[int]:
    several = is_list(divisions)
    if not several or len(divisions) != dimension or not all(is_whole(n) and n >= 1 for n in divisions):
        raise SceneError(
            f"divisions = {short(divisions)} must be {dimension} whole numbers of at least 1"
        )
    return [int(n) for n in divisions]


def cell_type(cell: str, dimension: int) -> dmesh.CellType:
    if not isinstance(cell, str) or _CELLS.get(cell) != dimension:
        allowed = [name for name, dim in _CELLS.items() if dim == dimension]
        raise SceneError(
            f"cell = {cell!r} does not fit {dimension} dimensions; use one of {allowed}"
        )
    return dmesh.to_type(cell)


def check_order(geometry_order: int) -> int:
    if not is_whole(geometry_order) or geometry_order not in (1, 2):
        raise SceneError(f"geometry_order = {geometry_order} must be 1 (straight) or 2 (curved)")
    return geometry_order


def exterior_facets(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    topology = mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    return np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)


def tagged(mesh: dmesh.Mesh, faces: Mapping[str, npt.NDArray[np.int32]]) -> Part:
    """A part from the facets of its faces; exterior facets without a face become free."""
    exterior = exterior_facets(mesh)
    rest = np.setdiff1d(exterior, np.concatenate([NO_FACETS, *faces.values()]))
    named = dict(faces) | ({FREE: rest} if rest.size else {})
    names = {name: tag for tag, name in enumerate(named, start=1)}
    facets = np.concatenate(list(named.values())).astype(np.int32)
    tags = np.repeat(list(names.values()), [f.size for f in named.values()]).astype(np.int32)
    order = np.argsort(facets)
    meshtags = dmesh.meshtags(mesh, mesh.topology.dim - 1, facets[order], tags[order])
    return Part(mesh, meshtags, names)


def located(mesh: dmesh.Mesh, markers: Mapping[str, Marker]) -> Part:
    """A part whose faces are the boundary facets with all vertices where a marker holds."""
    dim = mesh.topology.dim - 1
    return tagged(
        mesh,
        {
            name: np.asarray(dmesh.locate_entities_boundary(mesh, dim, marker), dtype=np.int32)
            for name, marker in markers.items()
        },
    )
