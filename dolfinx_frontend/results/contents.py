"""What the file of a result must hold: checked once when it is read, before anything is made of it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.formats.hdf5 import LayoutError, Tree
from dolfinx_frontend.formats.layout import Group
from dolfinx_frontend.results.answer import AnswerKind
from dolfinx_frontend.results.writing import NO_FIELDS
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = ["check_contents"]

MANY = 2**31
Shape = tuple[int | None, ...]


def check_contents(tree: Tree, meshes: bool) -> None:
    """Check that all is there, of the kind and shape it must have.

    Parameters
    ----------
    tree
        Of a file in the form of today.
    meshes
        Whether files of its version have meshes.

    Raises
    ------
    LayoutError
        With the place of what is missing or malformed.
    """
    _Contents(Group(tree), meshes).check()


class _Contents:
    def __init__(self, file: Group, meshes: bool) -> None:
        self.file, self.meshes = file, meshes
        self.kind = file.text("kind", get_args(AnswerKind))
        times = len(file.numbers("times", None, finite=True)) if "times" in file else None
        if times is None and self.kind == "history" or times == 0:
            raise LayoutError("times is missing or empty, a history has some")
        self.steps: Shape = () if times is None else (times,)
        self.samples: Shape = ()
        self.grid: Shape = ()
        if "germs" in file or (self.kind == "samples"):
            self.samples = (len(file.numbers("germs", None, None, finite=True)),)
        if self.kind == "sweep":
            axes = file.group("axes")
            lengths = [len(axes.numbers(name, None, finite=True)) for name in axes]
            self.grid, self.samples = tuple(lengths), (math.prod(lengths),)
            if not self.grid:
                raise LayoutError("axes is empty, a sweep has some")
        elif self.kind == "samples":
            self.grid = self.samples
        elif self.kind == "chaos" and not self.samples:
            self.samples = (None,)  # of the first version, which did not keep them
        self.without = file.text("no_displacements") if "no_displacements" in file else None
        self.parts = file.groups("substructures")
        parts = self.parts.items()
        self.nodes = {name: node.numbers("nodes", None, None, finite=True) for name, node in parts}
        self.faces: Mapping[str, list[str] | None] = {
            name: node.group("mesh").texts("faces") if "mesh" in node else None
            for name, node in self.parts.items()
        }
        self.interfaces = file.groups("interfaces")

    def check(self) -> None:
        """All of it."""
        self._check_run()
        for name, node in self.parts.items():
            self._check_part(name, node)
        for node in self.interfaces.values():
            self._check_interface(node)
        self._check_missing()
        if self.kind == "chaos":
            self._check_chaos()

    def _check_run(self) -> None:
        file, count = self.file, self.samples[0] if self.samples else None
        for name in ("status", "software", "plan", "problem"):
            file.text(name)
        file.whole("iterations", -1, 2**62)
        file.number("error")
        file.text("statistics", get_args(Kind))
        active = file.texts("active", among=tuple(self.interfaces))
        if "place" in file:
            file.text("place")
        if "weights" in file:
            file.numbers("weights", count, finite=True)
        if "points" in file or (self.grid and self.meshes):
            points = file.group("points")
            points.texts("status", count)
            points.numbers("error", count)
            points.numbers("iterations", count, finite=True)
        elif "statuses" in file or self.meshes:
            file.texts("statuses", int(self.steps[0] or 1) if self.steps else 1)
        if self.without != NO_FIELDS:
            for name in active:
                self.interfaces[name].entry("force")

    # --- parts ---------------------------------------------------------------------------------
    def _check_part(self, name: str, node: Group) -> None:
        nodes = self.nodes[name]
        dim = nodes.shape[1]
        if nodes.shape[1] not in (2, 3) or not len(nodes):
            raise LayoutError(f"{node.place('nodes')} has shape {nodes.shape}, (nodes, 2 or 3) is wanted")
        field = (*self.steps, *nodes.shape)
        if self.without is None:
            self._check_displacement(node, field)
            if self.kind == "samples":
                node.entry("deviation")
            if self.meshes and "points" not in node:
                node.entry("mesh")
        if "deviation" in node:
            node.numbers("deviation", *field)
        if "points" in node:
            points = node.whole("points", 1, len(nodes))
            node.wholes("turning", (len(nodes) - points) // (dim - 1), below=points)
        if "mesh" in node:
            self._check_mesh(node.group("mesh"), len(nodes), nodes.shape[1])

    def _check_displacement(self, node: Group, field: Shape) -> None:
        """Finite where the run has arrived."""
        lead = self.samples if self.kind == "sweep" else ()
        found = node.numbers("displacement", *lead, *field)
        converged = self.file.text("status") == "converged"
        if lead and "points" in self.file:
            found = found[np.array(self.file.group("points").texts("status")) == "converged"]
        elif not converged:
            return
        if not np.isfinite(found).all():
            raise LayoutError(f"{node.place('displacement')} has numbers that are not finite")

    def _check_mesh(self, mesh: Group, nodes: int, dim: int) -> None:
        known = [name for name, cell in CELLS.items() if cell.dim == dim]
        cell = CELLS[mesh.text("cell", known)]
        mesh.whole("lagrange", 0, 3)  # the others of basix are discontinuous
        vertices = len(mesh.numbers("x", None, dim, finite=True))
        cells = len(mesh.wholes("cells", None, cell.nodes(mesh.whole("order", 1, 30)), below=vertices))
        mesh.wholes("dofs", cells, cell.nodes(mesh.whole("degree", 1, 30)), below=nodes)
        facets = mesh.wholes("facets", None, 3, below=MANY)
        _check_facets(mesh, facets, cells, cell.facets)
        faces = mesh.texts("faces")
        tags = mesh.wholes("tags", len(faces), below=MANY)
        if len(set(map(int, tags))) != len(faces) or len(set(faces)) != len(faces):
            raise LayoutError(f"{mesh.place('tags')}: two faces have one name or one tag")
        if "elasticity" in mesh:
            size = 3 if dim == 2 else 6
            mesh.numbers("elasticity", size, size, finite=True)

    # --- interfaces ----------------------------------------------------------------------------
    def _check_interface(self, node: Group) -> None:
        for name in ("law", "description"):
            node.text(name)
        count, dim = node.numbers("points", None, None, finite=True).shape
        node.numbers("weights", count, finite=True)
        node.numbers("frames", count, dim, dim, finite=True)
        components = node.numbers("directions", count, None, dim, finite=True).shape[1]
        node.whole("is_contact", 0, 1)
        for name in ("places", "mean_normals"):
            if name in node:
                node.numbers(name, count, dim, finite=True)
        if "bolt" in node:
            node.whole("bolt", -1, (self.steps[0] or 1) - 1 if self.steps else -1)
        self._check_sides(node, count, dim)
        if ("force" in node) != ("jump" in node):
            node.entry("force"), node.entry("jump")
        for name in ("force", "jump"):
            if name in node:
                node.numbers(name, *self.grid, *self.steps, count, components)
        if "contact" in node:
            contact = node.group("contact")
            contact.entry("clearance")
            for name in ("clearance", "friction", "threshold"):
                if name in contact:
                    self._check_law(contact, name, count)
        if "measures" in node:
            self._check_measures(node, dim)

    def _check_law(self, contact: Group, name: str, count: int) -> None:
        found = contact.numbers(name, None, None, count)
        samples, steps = (self.grid and self.samples or (1,))[0], (self.steps or (1,))[0]
        if found.shape[0] not in (1, samples) or found.shape[1] not in (1, steps):
            raise LayoutError(
                f"{contact.place(name)} has shape {found.shape}, (1 or {samples}, 1 or {steps}, {count}) is "
                "wanted"
            )

    def _check_measures(self, node: Group, dim: int) -> None:
        node.numbers("centre", dim, finite=True)
        node.entry("bolt")
        measures = node.group("measures")
        shape = (*self.samples, *self.steps)
        axes, moments = "xyz"[:dim], "xyz" if dim == 3 else "z"
        for name in (*(f"force_{a}" for a in axes), *(f"moment_{a}" for a in moments), *COLUMNS):
            measures.entry(name)
        for name in measures:
            measures.numbers(name, *shape)

    def _check_sides(self, node: Group, count: int, dim: int) -> None:
        sides = node.texts("sides")
        if len(sides) not in (1, 2):
            raise LayoutError(f"{node.place('sides')} has {len(sides)} texts, 1 or 2 are wanted")
        for side in sides:
            part, _, face = side.partition(":")
            known = self.faces.get(part)
            nodes = face.startswith("(") and face.endswith(")")
            if part not in self.parts or (known is not None and face not in known and not nodes):
                raise LayoutError(f"{node.place('sides')} names {side!r}, which is not in the file")
            if self.nodes[part].shape[1] != dim:
                raise LayoutError(f"{node.place('points')} have {dim} coordinates, its parts have others")
        if not self.meshes:
            return
        carrier = sides[node.whole("carrier", 0, len(sides) - 1)].partition(":")[0]
        node.numbers("normal", dim, finite=True)
        node.sparse("trace", count, len(self.nodes[carrier]), "nodes")
        facets = node.wholes("facets", None, 2, below=MANY)
        for side in sides:
            self._check_face(node, side, facets if side == sides[node.whole("carrier", 0, 1)] else facets[:0])
        node.sparse("areas", len(facets), count, "points")
        if "vertices" in node:
            vertices = node.group("vertices")
            wanted = None
            if "mesh" in self.parts[carrier]:
                wanted = CELLS[self.parts[carrier].group("mesh").text("cell", tuple(CELLS))].corners
            corners = vertices.wholes("corners", len(facets), wanted, below=MANY)
            if not corners.size:
                raise vertices.wrong("corners", "an array of whole numbers")
            vertices.rows(int(corners.max()) + 1, count, "points")

    def _check_face(self, node: Group, side: str, facets: Ints) -> None:
        """The facets of an interface are some of those of its face."""
        part, _, face = side.partition(":")
        if "mesh" not in self.parts[part]:
            return
        mesh = self.parts[part].group("mesh")
        if face not in mesh.texts("faces"):  # nodes
            if len(facets):
                raise LayoutError(f"{node.place('facets')} has facets of {side}, which is no face")
            return
        tag = mesh.wholes("tags", None, below=MANY)[mesh.texts("faces").index(face)]
        tagged = mesh.wholes("facets", None, 3, below=MANY)
        own = {(int(cell), int(facet)) for cell, facet, of in tagged if of == tag}
        if not own:
            raise LayoutError(f"{mesh.place('facets')} has none of the face {face!r}")
        if not own.issuperset((int(cell), int(facet)) for cell, facet in facets):
            raise LayoutError(f"{node.place('facets')} has a facet that is none of {side}")

    # --- what belongs together -----------------------------------------------------------------
    def _check_missing(self) -> None:
        text = self.file.text("missing")
        try:
            missing = json.loads(text)
        except ValueError as error:
            raise LayoutError(f"missing is no table in JSON: {error}") from error
        if not isinstance(missing, dict) or not set(missing) <= set(self.interfaces):
            raise LayoutError("missing is no table of interfaces")
        # latin_run writes fields only, of which tables are made anew
        tables = any("measures" in node for node in self.interfaces.values())
        for name, node in self.interfaces.items():
            if tables and name not in missing:
                node.entry("measures")

    def _check_chaos(self) -> None:
        chaos = self.file.group("chaos")
        if self.meshes:
            self.file.texts("nonlinear", among=tuple(self.interfaces))
        if "germs" in self.file:
            count = len(chaos.group("germs").texts("names"))
            self.file.numbers("germs", None, count, finite=True)
        fields = chaos.group("fields")
        wanted: dict[str, tuple[int, ...]] = {}
        for name, node in self.interfaces.items():
            for what in ("force", "jump"):
                if what in node:
                    wanted[f"{what}:{name}"] = node.numbers(what, *[None] * (2 + len(self.steps))).shape
        for name, nodes in self.nodes.items():
            if self.without is None:
                wanted[f"displacement:{name}"] = (*(int(each or 0) for each in self.steps), nodes.size)
        for name, shape in wanted.items():
            found = tuple(map(int, fields.group(name).wholes("shape", None, below=MANY)))
            if found != shape:
                raise LayoutError(f"{fields.place(name)}/shape is {found}, {shape} is wanted")


@dataclass(frozen=True)
class _Cell:
    """Facets of a cell and corners of a facet, and nodes of its Lagrange element by degree."""

    dim: int
    facets: int
    corners: int
    nodes: Callable[[int], int]


CELLS = {
    "triangle": _Cell(2, 3, 2, lambda p: (p + 1) * (p + 2) // 2),
    "quadrilateral": _Cell(2, 4, 2, lambda p: (p + 1) ** 2),
    "tetrahedron": _Cell(3, 4, 3, lambda p: (p + 1) * (p + 2) * (p + 3) // 6),
    "hexahedron": _Cell(3, 6, 4, lambda p: (p + 1) ** 3),
}
COLUMNS = (
    "area", "normal", "shear", "pressure_min", "pressure_mean", "pressure_max", "shear_max", "open_area",
    "slip_area",
)  # fmt: skip
"""What tables have of an interface beside the components of force and moment."""


def _check_facets(node: Group, facets: Ints, cells: int, of_cell: int) -> None:
    if facets.size and (facets[:, 0].max() >= cells or facets[:, 1].max() >= of_cell):
        raise LayoutError(
            f"{node.place('facets')} has a cell or a facet of it that there is not ({cells} cells of "
            f"{of_cell} facets)"
        )
