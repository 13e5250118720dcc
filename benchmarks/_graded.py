"""Meshes that are graded by hand: small cells at the rims of interfaces, where stresses are singular."""

from __future__ import annotations

from dataclasses import replace

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from dolfinx_frontend.geometry.finer import OfModel, size_field
from dolfinx_frontend.geometry.parts import Part
from parts.vessel import BoltedVessel

Array = npt.NDArray[np.float64]

SLOPE = 0.6
"""Size of cells over their distance from a rim."""

TIMES = 2
"""Meshes one from the other: sizes are linear in the cells of the one before."""


def graded(shape: BoltedVessel, rims: float, largest: float) -> BoltedVessel:
    """The parts of a model with cells of the size `rims` at the rims of its interfaces, mm, and of at most
    `largest`."""
    for _ in range(TIMES):
        tree = cKDTree(np.concatenate([_rim(shape, name) for name in shape.parts]))
        sizes = {}
        for name, part in shape.parts.items():
            topology = part.mesh.topology
            cells = np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
            away, _ = tree.query(dmesh.compute_midpoints(part.mesh, topology.dim, cells))
            sizes[name] = size_field(part.mesh, np.clip(SLOPE * away, rims, largest))
        again = next(iter(shape.parts.values())).again
        assert isinstance(again, OfModel)
        shape = replace(shape, parts=again.model.parts(sizes))
    return shape


def _rim(shape: BoltedVessel, name: str) -> Array:
    """Points (n, 3) of a part at which a face of an interface between two parts ends, but not at a plane of
    symmetry."""
    part: Part = shape.parts[name]
    of_interfaces: set[str] = set()
    planes: set[str] = set()
    for each in shape.interfaces:
        faces = planes if each.kind in ("symmetry", "support") else of_interfaces
        pair = [face for face in (each.face1, each.face2) if face is not None]
        if len(pair) == 2 or faces is planes:
            faces.update(face.partition(":")[2] for face in pair if face.startswith(f"{name}:"))
    topology = part.mesh.topology
    d = topology.dim
    for one, other in ((d - 1, 0), (0, d), (d, 0)):
        topology.create_connectivity(one, other)
    vertices = topology.connectivity(d - 1, 0)
    number = {value: face for face, value in part.names.items()}
    beside: dict[int, set[str]] = {}
    for facet, value in zip(part.facet_tags.indices, part.facet_tags.values, strict=True):
        if number[int(value)] not in planes:
            for vertex in vertices.links(int(facet)):
                beside.setdefault(int(vertex), set()).add(number[int(value)])
    ends = [v for v, faces in beside.items() if len(faces) > 1 and faces & of_interfaces]
    nodes = dmesh.entities_to_geometry(part.mesh, 0, np.array(ends, dtype=np.int32)).ravel()
    return np.asarray(part.mesh.geometry.x[nodes])
