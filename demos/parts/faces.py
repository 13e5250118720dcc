"""Names for the faces of parts that gmsh has meshed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.geometry.parts import FREE

__all__ = ["name_faces"]


def name_faces(
    model: Any, volumes: Mapping[str, Sequence[int]], face_of: Callable[[str, Array], str]
) -> None:
    """Physical groups ``part:face`` for the surfaces, told apart by where their nodes are.

    Parameters
    ----------
    model
        Of gmsh, meshed.
    volumes
        Part -> tags of its volumes.
    face_of
        Part and nodes (n, 3) of one of its surfaces -> name of the face, or ``FREE``.
    """
    faces: dict[str, list[int]] = {}
    for part, tags in volumes.items():
        for _, surface in model.getBoundary([(3, tag) for tag in tags], oriented=False):
            _, nodes, _ = model.mesh.getNodes(2, surface, True, False)
            face = face_of(part, nodes.reshape(-1, 3))
            if face != FREE:
                faces.setdefault(f"{part}:{face}", []).append(surface)
    for name, surfaces in faces.items():
        model.addPhysicalGroup(2, surfaces, name=name)
