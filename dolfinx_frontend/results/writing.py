"""An answer into one HDF5 file.

The file is HDF5. Texts and integers are attributes, everything else is stored as contiguous datasets. The
512 bytes of the user block begin with ``latin-result sha256 HEX``, the checksum of the rest: ``load``
refuses a damaged file before HDF5 opens it. A file of another version is refused with a message that
states its version. Any HDF5 reader (``h5py``, ``h5dump``) can read the file.

``format``, ``version``
    ``latin-result``, 3 (files of versions 1, which have no meshes, and 2 are read)
``kind``
    ``deterministic``, ``history``, ``chaos``, ``samples``, ``sweep``
``statistics``
    ``value``, ``random``, ``qmc``, ``quadrature``, ``grid``
``status``, ``iterations``, ``error``, ``place``
    how the run ended, and where the error is largest
``statuses``
    of every time step
``points/status``, ``iterations``, ``error``
    of every point of samples and sweeps
``plan``, ``problem``, ``software``, ``active``
    in words
``times``
    (T) of a history
``germs``, ``weights``
    (N, L) samples, of a chaos those of its tables; (N) of a quadrature
``axes/NAME``
    of a sweep: the values of a swept parameter
``interfaces/NAME/points``, ``weights``, ``frames``
    (m, d), (m), (m, d, d) with n in row 0
``interfaces/NAME/directions``
    (m, components, d) of the components of force and jump
``interfaces/NAME/force``, ``jump``
    ([N,] [T,] m, components), of a sweep (grid..., ...); of a chaos the mean
``interfaces/NAME/measures/COLUMN``
    ([N,] [T]) numbers of the tables
``interfaces/NAME/law``, ``description``, ``sides``
    in words
``interfaces/NAME/facets``, ``carrier``
    (k, 2) cell and facet, of the side (0 or 1) that has the points
``interfaces/NAME/trace``, ``areas``, ``vertices``
    sparse matrices by rows: nodes to points; points to facets; a continuous field
``interfaces/NAME/contact/clearance``, ``friction``, ``threshold``
    ([N or 1], [T or 1], m), not of a chaos
``substructures/NAME/nodes``, ``displacement``, ``deviation``
    (nodes, d), ([T,] nodes, d), of a sweep ([N,] ...)
``substructures/NAME/mesh``
    cells, coordinates, nodes of the displacement, faces, elasticity
``substructures/NAME/points``, ``turning``
    of a part that is a matrix, in place of the mesh: how many of its nodes are the points, and which of
    these turn
``no_displacements``
    why there are none
``chaos``, ``nonlinear``
    the tree of the chaos file; interfaces whose law is nonlinear

N: samples, T: time steps, m: points of an interface, d: dimension.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.matrix_part import frames_of
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, one_call
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array, Ints, largest_of
from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.files import FileError, replaced
from dolfinx_frontend.formats import chaos_file, hdf5
from dolfinx_frontend.formats.hdf5 import ChaosFileError, Tree
from dolfinx_frontend.formats.meshes import facet_cells, part_arrays
from dolfinx_frontend.results.answer import Surface
from dolfinx_frontend.results.readings import Readings

__all__ = ["FORMAT", "VERSION", "ResultFileError", "interface_tree", "save", "shape_tree", "write"]

FORMAT = "latin-result"
VERSION = 3
SUFFIXES = (".h5", ".hdf5")
NO_FIELDS = "the file was saved without fields: save it with fields=True"


class ResultFileError(FileError):
    """A file that is no saved result, is damaged or of another version, or cannot be written."""


def save(answer: Any, path: str | Path, fields: bool, samples: int | None, seed: int) -> None:
    """Write an answer, see :meth:`dolfinx_frontend.results.face.Face.save`."""
    target = _target(path)
    comm = answer.problem.comm
    with one_call(comm, "save"):
        answer.problem.check_sources()
        readings = answer.readings(None, samples, seed)
        parts = answer.problem.substructures if comm is None else answer.problem.parts
        extra = answer.extra_content(tuple(parts) if fields else (), samples, seed)
        with agreement(comm, "save"):
            tree = _tree(answer, readings, extra, fields)
        trees = [tree] if comm is None else comm.gather(tree, root=0)
        with agreement(comm, "save"):
            if trees is not None:
                write(target, tree if comm is None else _united(answer, trees))


def _united(answer: Any, trees: Sequence[Tree]) -> Tree:
    """The trees of all ranks as one: each has its own parts, and what it knows of interfaces."""
    tree = dict(trees[0])
    for key, names in (("interfaces", answer.problem.interfaces), ("substructures", answer.problem.parts)):
        of_ranks = [each[key] for each in trees]
        tree[key] = {
            name: {what: value for each in reversed(of_ranks) for what, value in each.get(name, {}).items()}
            for name in names
        }
    return tree


def write(path: str | Path, tree: Tree) -> None:
    """Write the tree of a result; an existing file is replaced when the new one is complete.

    Raises
    ------
    ResultFileError
        The file cannot be written.
    """
    target = _target(path)
    try:
        with replaced(target, ResultFileError) as temporary:
            hdf5.write_tree(temporary, {"format": FORMAT, "version": VERSION}, tree)
    except ChaosFileError as error:  # no h5py
        raise ResultFileError(str(error)) from error


def _target(path: str | Path) -> Path:
    target = checked_path("save", path)
    if target.suffix.lower() not in SUFFIXES:
        raise ResultFileError(
            f"{target}: a result is saved as {' or '.join(SUFFIXES)}, not {target.suffix!r}"
        )
    return target


def _described(law: object) -> str:
    with np.printoptions(threshold=8, precision=6):
        return repr(law)


def _tree(answer: Any, readings: Readings, extra: Tree, fields: bool) -> Tree:
    """What this rank knows of an answer; of interfaces only where it has a side, or their tables."""
    problem, plan = answer.problem, answer.plan
    here = [name for name in problem.interfaces if problem.comm is None or name in problem.own.interfaces]
    reached = np.atleast_1d(answer.iterations) >= 0
    tree: Tree = {
        "kind": answer.kind,
        "status": answer.status,
        "iterations": int(np.atleast_1d(answer.iterations)[reached].sum()),
        "error": largest_of(np.atleast_1d(answer.error)[reached]),
        "place": answer.place,
        "software": chaos_file.software(),
        "plan": str(plan),
        "problem": repr(problem),
        "active": list(plan.active),
        "statistics": answer.statistics,
        "missing": json.dumps(readings.missing),
        "interfaces": {
            name: interface_tree(problem, name, answer.surface(name)) if _carries(problem, name) else {}
            for name in problem.interfaces
        },
        "substructures": {name: {"nodes": s.dof_coordinates} for name, s in problem.substructures.items()},
    }
    for name, each in readings.interfaces.items():
        tree["interfaces"][name] |= {
            "bolt": -1 if each.bolt is None else each.bolt,
            "centre": each.centre,
            "measures": {column: np.asarray(v, dtype=np.float64) for column, v in each.values.items()},
        }
    if plan.times is not None:
        tree["times"] = np.asarray(plan.times, dtype=np.float64)
    tree |= extra
    if "points" not in tree:
        tree["statuses"] = [str(each) for each in np.ravel(answer.statuses)]
    why = answer.without_displacements if fields else NO_FIELDS
    if why is not None:
        tree["no_displacements"] = why
    if fields:
        for name in answer.known:
            if name in here:
                tree["interfaces"][name] |= _fields_tree(answer, name)
    if why is None:
        for name in problem.substructures:
            tree["substructures"][name] |= _part_tree(answer, name)
    return tree


def _carries(problem: Any, name: str) -> bool:
    """Whether the part on whose mesh an interface is drawn is on this rank."""
    interface = problem.interfaces[name]
    return interface.sides[interface.carrier].substructure in problem.substructures


def interface_tree(problem: Any, name: str, surface: Surface) -> Tree:
    """What a file has of an interface, whatever the answer."""
    interface = problem.interfaces[name]
    side = interface.sides[interface.carrier]
    tree: Tree = {
        "law": surface.law,
        "description": _described(interface.law),
        "is_contact": int(surface.contact),
        "sides": [f"{s.substructure}:{s.face}" for s in interface.sides],
        "points": interface.points,
        "weights": interface.weights,
        "frames": interface.frames,
        "directions": surface.frames,
        "normal": np.asarray(interface.sides[0].normal, dtype=np.float64),
        "carrier": interface.carrier,
        "facets": _facets(problem, interface),
        "areas": _sparse(interface.areas, "points"),
        "trace": _sparse(side.shape, "nodes"),
    }
    for key in ("wrench", "places", "mean_normals"):
        if (values := getattr(surface, key)) is not None:
            tree[key] = values
    if interface.vertices is not None:
        nodal = _sparse(interface.vertices.nodal, "points")
        tree["vertices"] = {"corners": interface.vertices.corners.astype(np.int64)} | nodal
    return tree


def _facets(problem: Problem, interface: Interface) -> Ints:
    """(k, 2): cells and numbers of its facets in them; a node, and points of a matrix, have none."""
    side = interface.sides[interface.carrier]
    s = problem.substructures[side.substructure]
    if frames_of(s) is not None or side.face not in s.part.names:
        return np.zeros((0, 2), dtype=np.int64)
    tag = s.part.names.get(side.face, -1)  # nodes have no face
    facets = np.sort(s.part.facet_tags.find(tag))[interface.facets]
    return facet_cells(s.part, facets)


def shape_tree(s: Substructure, material: Any) -> Tree:
    """What a file has of a part but for numbers: its mesh, or how many of its nodes are the points of a
    matrix."""
    frames = frames_of(s)
    if frames is not None:
        return {"points": len(frames.given.points), "turning": frames.given.turning}
    return {"mesh": part_arrays(s.part, s.V, material)}


def _sparse(matrix: sp.csr_matrix, columns: str) -> Tree:
    rows = matrix.tocsr()
    return {
        "values": rows.data,
        columns: rows.indices.astype(np.int64),
        "starts": rows.indptr.astype(np.int64),
    }


def _fields_tree(answer: Any, name: str) -> Tree:
    tree: Tree = {"force": np.asarray(answer.force(name)), "jump": np.asarray(answer.jump(name))}
    contacts = [] if answer.kind == "chaos" else [block.contact(name) for block in answer.blocks()]
    if contacts and contacts[0] is not None:
        tree["contact"] = {
            key: _joined([getattr(each, key) for each in contacts])
            for key in ("clearance", "friction", "threshold")
            if getattr(contacts[0], key) is not None
        }
    return tree


def _joined(values: list[Array]) -> Array:
    """Values of all samples, or of one if they are the same in all."""
    return np.concatenate(values) if len(values[0]) > 1 or len(values) == 1 else _alike(values)


def _alike(values: list[Array]) -> Array:
    same = all(np.array_equal(each, values[0]) for each in values)
    return values[0] if same else np.concatenate(values)


def _beside(answer: Any, name: str) -> bool:
    """Whether the stress of a part depends on more than its displacement and its material."""
    of_load = bool(answer.problem.initial_stresses(name)) or name in answer.plan.varied
    return of_load or name in getattr(answer.problem, "spread", ())


def _part_tree(answer: Any, name: str) -> Tree:
    part = answer.problem.substructures[name]
    values = answer.unknowns(name)
    if answer.kind == "sweep":  # no mean: all points
        values = np.concatenate([block.displacement(name) for block in answer.blocks()])
    tree: Tree = {
        "displacement": values.reshape(*values.shape[:-1], -1, part.dim),
    }
    # a file has no initial stresses or factors, without which a stress from its material would be wrong
    tree |= shape_tree(part, None if _beside(answer, name) else part.material)
    deviation = answer.deviation(name)
    if deviation is not None and answer.kind != "chaos":  # of a chaos it follows from the modes
        tree["deviation"] = deviation.reshape(*deviation.shape[:-1], -1, part.dim)
    return tree
