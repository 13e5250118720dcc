"""What is done with files by gmsh, in a process of its own (:mod:`worker`): read, compared, meshed.

OpenCASCADE and gmsh can end the process for a damaged file, or never come back. Nothing here uses dolfinx,
which would start MPI in that process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.loading import load
from dolfinx_frontend.geometry.med import med_mesh
from dolfinx_frontend.geometry.meshed import Meshed, meshed
from dolfinx_frontend.geometry.meshing import OPTIONS, generate
from dolfinx_frontend.geometry.msh import checked_copy
from dolfinx_frontend.geometry.session import gmsh_session
from dolfinx_frontend.geometry.sizes import SizeField
from dolfinx_frontend.geometry.solids import Cut, Loaded, Solid, nearest, solids_of
from dolfinx_frontend.geometry.touching import Touch, close_faces, touching

__all__ = ["TASKS", "Recipe", "Source", "Survey"]

Say = Callable[[str], None]
"""Told what is done next."""

GAP = 1e-4
"""Default gap up to which faces count as nearly touching, relative to the diagonal of the assembly."""


CLOSE = 0.5
"""Distance of faces that may have been meant to touch, mm."""


@dataclass(frozen=True)
class Source:
    """A STEP file and how it is read; see :func:`read_step`. `name` is that of the file for messages, `names`
    are those of its parts that were renamed: in the file -> now."""

    path: Path
    name: str
    cuts: tuple[Cut, ...]
    imprint: bool
    tolerance: float | None
    partial: bool
    names: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Survey:
    """What is in a STEP file.

    Attributes
    ----------
    solids, touches
        The parts by name, and where they touch.
    gap
        Up to which faces count as nearly touching, length.
    alone
        Sentences for the parts that touch nothing.
    lost
        Solids that could not be read, in words.
    outside
        Names of other files that the file refers to.
    close
        Plane faces that are up to `CLOSE` apart, but more than `gap`.
    """

    solids: dict[str, Solid]
    touches: list[Touch]
    gap: float
    alone: tuple[str, ...]
    lost: tuple[str, ...]
    outside: tuple[str, ...]
    close: tuple[Touch, ...] = ()


@dataclass(frozen=True)
class Recipe:
    """How the solids of a file are meshed.

    Attributes
    ----------
    solids
        As they were when the file was read first.
    faces
        ``"part:face"`` -> numbers of surfaces.
    sizes, local
        Largest cells of a part, and on surfaces: length.
    per_turn, order
        See :meth:`StepAssembly.mesh`.
    again
        One part that is meshed alone, with these sizes; None: all parts, with theirs.
    """

    solids: dict[str, Solid]
    faces: dict[str, tuple[int, ...]]
    sizes: dict[str, float]
    local: list[tuple[tuple[int, ...], float]]
    per_turn: int
    order: int
    again: tuple[str, SizeField] | None = None


def survey(say: Say, source: Source, gap: float | None) -> Survey:
    """Parts of a STEP file, and where they touch."""
    with gmsh_session("file", OPTIONS) as gmsh:
        loaded = _load(gmsh, say, source)
        say("measuring the faces")
        solids = solids_of(gmsh.model, loaded)
        low = np.min([s.low for s in solids.values()], axis=0)
        high = np.max([s.high for s in solids.values()], axis=0)
        reach = GAP * float(np.linalg.norm(high - low)) if gap is None else float(gap)
        say("comparing the faces")
        touches = touching(gmsh, loaded, solids, reach)
        used = {p for t in touches for p in t.parts}
        lonely = [n for n in solids if n not in used] if len(solids) > 1 else []
        alone = tuple(nearest(gmsh.model, loaded, solids, [n], reach, 1)[0] for n in lonely)
        close = close_faces(gmsh, loaded, solids, touches, CLOSE) if reach < CLOSE else []
        return Survey(solids, touches, reach, alone, loaded.lost, loaded.outside, tuple(close))


def mesh(say: Say, source: Source, recipe: Recipe) -> Meshed:
    """The meshes of the parts of a STEP file."""
    options = {**OPTIONS, "Mesh.MeshSizeFromCurvature": float(recipe.per_turn)}
    with gmsh_session("file", options) as gmsh:
        model = gmsh.model
        loaded = _load(gmsh, say, source)
        _check_same(model, loaded, source.name, recipe.solids)
        if recipe.again is not None:
            loaded = _only(gmsh, loaded, recipe.again[0])
        for name, tags in loaded.volumes.items():
            model.addPhysicalGroup(3, tags, name=name)
        for name, surfaces in recipe.faces.items():
            if name.partition(":")[0] in loaded.volumes:
                model.addPhysicalGroup(2, sorted(surfaces), name=name)
        if recipe.again is None:
            _set_sizes(model, loaded, recipe)
        else:
            recipe.again[1].set(gmsh)
        generate(gmsh, loaded, recipe.order, say)
        return meshed(model)


def _only(gmsh: Any, loaded: Loaded, name: str) -> Loaded:
    """The model with one part, so that nothing else is meshed."""
    model, tags = gmsh.model, loaded.volumes[name]
    model.setVisibility(model.getEntities(), 0)
    model.setVisibility([(3, tag) for tag in tags], 1, recursive=True)
    gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
    return replace(loaded, volumes={name: tags})


def mesh_file(say: Say, path: Path) -> Meshed:
    """The mesh in a file of gmsh, which takes what does not begin as a mesh for a script and executes it."""
    say("reading the mesh")
    with gmsh_session("file") as gmsh:
        width = cache(lambda kind: int(gmsh.model.mesh.getElementProperties(kind)[3]))
        own = path.with_name("checked.msh")
        named = checked_copy(path, own, width)
        gmsh.merge(str(own))
        found = gmsh.model.getPhysicalGroups()
        highest = max((dim for dim, _ in found), default=0)
        # gmsh forgets groups of which it finds nothing
        for dim, tag, name in named:
            if dim >= max(2, highest) and (dim, tag) not in found:
                raise SceneError(f"the part {name!r} has no cells; write the mesh again")
        return meshed(gmsh.model)


def _load(gmsh: Any, say: Say, source: Source) -> Loaded:
    """The CAD model, read again: nothing of gmsh is kept between calls."""
    parts = source.cuts, source.imprint, source.tolerance, source.partial
    loaded = load(gmsh, source.path, source.name, *parts, say)
    now = source.names
    threads = {(now.get(a, a), now.get(b, b)): depth for (a, b), depth in loaded.threads.items()}
    return replace(
        loaded, volumes={now.get(n, n): tags for n, tags in loaded.volumes.items()}, threads=threads
    )


def _check_same(model: Any, loaded: Loaded, file: str, solids: Mapping[str, Solid]) -> None:
    """Numbers of faces are those of the first reading, unless the file has changed."""
    for name, solid in solids.items():
        tags = loaded.volumes.get(name, [])
        same = bool(tags) and np.isclose(
            sum(model.occ.getMass(3, t) for t in tags), solid.volume, rtol=1e-9
        )
        found = {abs(t) for _, t in model.getBoundary([(3, t) for t in tags], oriented=False)}
        if not same or found != {s.tag for s in solid.surfaces}:
            raise SceneError(f"{file!r} has changed since it was read: read it again")


def _set_sizes(model: Any, loaded: Loaded, recipe: Recipe) -> None:
    """Cells of a part, and of an interface, are not larger than requested."""
    field = model.mesh.field
    fields = []

    def constant(key: str, tags: Sequence[int], size: float) -> None:
        number = field.add("Constant")
        field.setNumbers(number, key, tags)
        field.setNumber(number, "VIn", size)
        field.setNumber(number, "IncludeBoundary", 1)
        fields.append(number)

    for name, tags in loaded.volumes.items():
        constant("VolumesList", tags, recipe.sizes[name])
    for surfaces, size in recipe.local:
        constant("SurfacesList", surfaces, size)
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", fields)
    field.setAsBackgroundMesh(smallest)


def med_file(say: Say, path: Path) -> Meshed:
    """The mesh in a file of Salome: the HDF5 library never returns from some damaged ones."""
    say("reading the mesh")
    return med_mesh(path)


TASKS: dict[str, Callable[..., Any]] = {
    "survey": survey, "mesh": mesh, "mesh_file": mesh_file, "med_file": med_file,
}
"""What the other process can be asked for."""
