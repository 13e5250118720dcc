"""A problem as a folder that ``latin_run`` solves without Python: all that the kernel is given, by value.

The folder has ``problem.h5``, a sealed HDF5 file, and ``matrices/*.petsc``, PETSc binary matrices;
``latin_core/program/folder.cpp`` describes both.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from latin_core import Options, SweptParameter, snake_order
from petsc4py import PETSc as _PETSc

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.gathered import gathered
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import Files, replaced
from dolfinx_frontend.evaluate import sweep
from dolfinx_frontend.formats import chaos_file, hdf5
from dolfinx_frontend.formats.hdf5 import Tree
from dolfinx_frontend.kernel import bridge
from dolfinx_frontend.plan.plan import Direction, Method, Plan, check_problem, check_settings, make_plan
from dolfinx_frontend.plan.random_laws import warn_of_free_parts
from dolfinx_frontend.results.answer import SAMPLES
from dolfinx_frontend.results.chaos import amplitudes_of
from dolfinx_frontend.results.runs import NOT_KEPT
from dolfinx_frontend.results.surfaces import law_contact, surface_of
from dolfinx_frontend.results.writing import interface_tree, shape_tree
from dolfinx_frontend.scene.amplitudes import check_times
from dolfinx_frontend.solvers import galerkin
from dolfinx_frontend.uncertainty.chaos import Chaos

__all__ = ["FORMAT", "VERSION", "export"]

PETSc: Any = _PETSc  # its stubs know no members

FORMAT = "latin-problem"
VERSION = 1
_FILE_CLASSID = 1211216
"""With which PETSc's binary files of matrices begin."""

_Values = dict[str, dict[str, Array]]


class _Matrices:
    """PETSc matrices in files of their own; one that is given twice is written once."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._known = folder, dict[int, int]()
        found = [int(each.stem) for each in (folder / "matrices").glob("*.petsc") if each.stem.isdecimal()]
        self._first = max(found, default=-1) + 1  # those of an older problem stay until this one is whole
        self._kept: list[Any] = []  # so that no other object gets its identity
        self.files: list[str] = []
        self.checksums: list[str] = []

    def add(self, matrix: Any) -> int:
        """The number of a PETSc or scipy matrix."""
        if id(matrix) not in self._known:
            self._kept.append(matrix)
            self._known[id(matrix)] = len(self.files)
            self._write(matrix)
        return self._known[id(matrix)]

    def _write(self, matrix: Any) -> None:
        # not PETSc's viewer: it swaps the bytes of the matrix itself, and leaves them so on a full disk
        name = f"matrices/{self._first + len(self.files):04d}.petsc"
        rows = matrix.tocsr() if sp.issparse(matrix) else csr(matrix)
        head = (_FILE_CLASSID, *rows.shape, rows.nnz)
        digest = hashlib.sha256()
        with replaced(self._folder / name) as temporary, temporary.open("wb") as file:
            for integers in (head, np.diff(rows.indptr), rows.indices):
                block = np.asarray(integers, dtype=np.dtype(PETSc.IntType).newbyteorder(">")).tobytes()
                digest.update(block)
                file.write(block)
            block = rows.data.astype(">f8").tobytes()
            digest.update(block)
            file.write(block)
        self.checksums.append(digest.hexdigest())
        self.files.append(name)


@together("export")
def export(
    problem: Problem,
    folder: str | Path,
    method: Method = "auto",
    *,
    chaos: Chaos | int | None = None,
    grid: Mapping[Any, Sequence[float]] | None = None,
    times: npt.ArrayLike | None = None,
    active: Sequence[str] | Literal["all"] | None = None,
    direction: Direction | float | None = None,
    options: Options | None = None,
    plan: Plan | None = None,
    indefinite: Literal["refuse", "prove"] = "refuse",
) -> Path:
    """Write what the kernel is given of a problem, for the program ``latin_run``.

    ``latin_run FOLDER`` then does what :func:`dolfinx_frontend.solve` (or, with a grid,
    :func:`dolfinx_frontend.sweep`) would do with the same arguments, on any number of ranks, and
    :func:`dolfinx_frontend.load` reads its file. Of a direct plan it makes no corrections of rounding, and of
    a chaos no deterministic solves to check it. Where the parts are on several ranks all of them make the
    call, and the first one, which is given the matrices of all, writes the folder that one rank would write.

    Parameters
    ----------
    folder
        Made if it is not there; an exported problem in it is replaced once this one is complete.
    grid
        ``"interface.parameter"`` -> values: a sweep.
    method, chaos, times, active, direction, options, plan, indefinite
        As for :func:`dolfinx_frontend.solve`.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    SceneError
        The law of an interface is a user's (functions or a compiled module), both chaos and grid are given,
        or as for ``solve``.
    FileError
        The folder cannot be written.
    """
    settings: dict[str, Any] = {"times": times, "active": active, "direction": direction, "options": options}
    check_problem("export", problem, plan)
    check_settings("export", plan, method, **settings)
    target = checked_path("export", folder)
    if chaos is not None and grid is not None:
        raise SceneError("export: chaos and grid are two computations: export each into its own folder")
    asked = {"method": method, "chaos": chaos, "grid": grid, "plan": plan is None, "indefinite": indefinite}
    problem.check_alike("export", laws=True, folder=str(target), **asked, **settings)
    moments = plan.times if plan is not None else None if times is None else check_times(times)
    shown = _shown(problem, moments)
    whole = gathered(problem)
    with agreement(problem.comm):
        if whole is not None:
            _export(whole, shown, target, method, settings, chaos, grid, plan, indefinite)
    return target


def _export(
    problem: Problem,
    shown: Shown,
    target: Path,
    method: Method,
    settings: dict[str, Any],
    chaos: Chaos | int | None,
    grid: Mapping[Any, Sequence[float]] | None,
    plan: Plan | None,
    indefinite: Literal["refuse", "prove"],
) -> None:
    """As :func:`export`, of a problem that is on this rank but for what is shown of it."""
    more: Tree = {}
    steps, modes, values, columns = None, 1, {}, {}
    if chaos is not None:
        wanted = galerkin.planned(problem, chaos, method, **settings, plan=plan, indefinite=indefinite)
        warn_of_free_parts("export", wanted.random)
        ready = galerkin.prepared(problem, wanted, indefinite)
        plan, changes = ready.plan, ready.changes
        steps, modes, values, columns = changes.steps, changes.modes, changes.parameters, changes.columns
        more["face"] = _chaos_face(wanted, ready)
    elif grid is not None:
        plan, axes, swept = sweep.planned(problem, grid, method, plan, settings)
        more["sweep"] = _sweep_tree(axes, swept)
        more["face"] = {
            "about": {"kind": "sweep", "statistics": "grid", "no_displacements": NOT_KEPT},
            "axes": {", ".join(key): each for key, each in axes.items()},
        }
    else:
        plan = plan or make_plan(problem, method, vary=(), **settings)
        kind = "deterministic" if plan.times is None else "history"
        more["face"] = {"about": {"kind": kind, "statistics": "value"}}
    _check_laws(problem, plan)
    if plan.varied:
        raise SceneError(
            f"export: the stiffness of {', '.join(map(repr, plan.varied))} varies, which latin_run does not "
            "take: solve it here"
        )
    if chaos is not None:
        amplitudes = amplitudes_of(plan, wanted.random, wanted.basis)
    else:
        amplitudes = plan.amplitudes
    described = bridge.describe(problem, plan)
    base = {name: fields.parameters for name, fields in described.fields.items()}
    tree = more | {
        "options": _options_tree(plan.options),
        "laws": _laws_tree(steps or plan.steps, modes, _merged(base, values), columns, plan.measured_in_time),
        "amplitudes": amplitudes,
    }
    tree["face"] = _face(problem, shown, plan, more["face"])
    _write(target, described, tree)


def _check_laws(problem: Problem, plan: Plan) -> None:
    for name in plan.active:
        law = problem.interfaces[name].law.functions
        if law is not None:
            given = "is a compiled module" if law.compiled is not None else "is written in Python"
            raise SceneError(
                f"export: interface {name!r}: its law {law.label!r} {given}, which latin_run does not have: "
                "give it one of the built-in laws, or write a program with the C++ law (docs/kernel.md)"
            )


def _merged(base: Mapping[str, Mapping[str, Array]], changes: _Values) -> _Values:
    return {name: {**values, **changes.get(name, {})} for name, values in base.items()}


def _block(values: npt.ArrayLike) -> Array:
    data = np.asarray(values, dtype=np.float64)
    return data[:, None] if data.ndim == 1 else np.atleast_2d(data)


def _numbered(nodes: Sequence[Tree]) -> Tree:
    return {str(number): node for number, node in enumerate(nodes)}


def _options_tree(options: Options) -> Tree:
    plain = {name: each for name, each in asdict(options).items() if name not in ("macro", "directions")}
    if np.isinf(options.max_seconds):
        del plain["max_seconds"]  # none is not said
    return {name: int(each) if isinstance(each, bool) else each for name, each in plain.items()}


def _laws_tree(
    steps: int,
    modes: int,
    values: _Values,
    columns: Mapping[str, Sequence[Mapping[str, Any]]],
    in_time: Array | None,
) -> Tree:
    parameters = [
        {"interface": name, "parameter": parameter, "values": _block(each)}
        for name, of_interface in values.items()
        for parameter, each in of_interface.items()
    ]
    transformed = [
        {"interface": name, "groups": _numbered([_group_tree(each) for each in groups])}
        for name, groups in columns.items()
    ]
    tree: Tree = {
        "steps": steps,
        "modes": modes,
        "parameters": _numbered(parameters),
        "columns": _numbered(transformed),
    }
    if in_time is not None:
        tree["in_time"] = in_time
    return tree


def _group_tree(group: Mapping[str, Any]) -> Tree:
    given = group["parameters"].items()
    parameters = [{"name": name, "values": _block(values)} for name, values in given]
    tree: Tree = {"begin": group["begin"], "end": group["end"], "parameters": _numbered(parameters)}
    for way in ("forward", "backward"):
        if len(group.get(way, ())):
            tree[way] = np.stack(group[way])
    return tree


def _sweep_tree(axes: Mapping[Any, Array], swept: Sequence[SweptParameter]) -> Tree:
    parameters: list[Tree] = [
        {
            "interface": each.interface,
            "parameter": each.parameter,
            "columns": each.columns,
            "pattern": each.pattern,
            "values": each.values,
        }
        for each in swept
    ]
    order = np.array(snake_order([len(values) for values in axes.values()]), dtype=np.int64)
    return {"order": order, "parameters": _numbered(parameters)}


def _member_tree(member: Mapping[str, Any], matrices: _Matrices) -> Tree:
    tree = {
        "name": member["name"],
        "stiffness": matrices.add(member["stiffness"]),
        "prolongation": matrices.add(member["prolongation"]),
        "load": member["load"],
    }
    return tree if member["offset"] is None else tree | {"offset": member["offset"]}


def _body_tree(body: Mapping[str, Any], matrices: _Matrices) -> Tree:
    springs = [
        {
            **spring,
            "members": np.array(spring["members"], dtype=np.int64),
            "traces": np.array([matrices.add(trace) for trace in spring["traces"]], dtype=np.int64),
        }
        for spring in body["springs"]
    ]
    return {
        "name": body["name"],
        "size": int(body["size"]),
        "members": _numbered([_member_tree(member, matrices) for member in body["members"]]),
        "springs": _numbered(springs),
    }


def _interface_tree(interface: Mapping[str, Any], law: str, matrices: _Matrices) -> Tree:
    sides = [
        {k: v for k, v in side.items() if v is not None}
        | {"trace": matrices.add(side["trace"]), "scale": float(side["scale"]), "lever": float(side["lever"])}
        for side in interface["sides"]
    ]
    tree = {
        "name": interface["name"],
        "law": law,
        "weights": interface["weights"],
        "frames": interface["frames"],
        "paired": int(interface["paired"]),
        "sides": _numbered(sides),
    }
    return tree if interface["basis"] is None else tree | {"basis": interface["basis"]}


def _chaos_face(wanted: galerkin.Planned, ready: galerkin.Prepared) -> Tree:
    """Germs and modes, to which the reader adds the coefficients."""
    space = wanted.random.space
    return {
        "about": {"kind": "chaos", "statistics": "random"},
        "chaos": chaos_file.content(space, wanted.basis, {}, {"order": int(wanted.chaos.order)}),
        "nonlinear": list(ready.collocations),
        "germs": space.sample(SAMPLES, 0),
    }


class Shown(NamedTuple):
    """What a reader sees of interfaces and parts, by name: what is made from their meshes."""

    interfaces: dict[str, Tree]
    parts: dict[str, Tree]


def _shown(problem: Problem, times: Array | None) -> Shown:
    """That of all ranks; collective."""
    own = Shown({}, {})
    with agreement(problem.comm):
        for name, interface in problem.interfaces.items():
            if interface.sides[interface.carrier].substructure in problem.substructures:
                surface = surface_of(interface, times)
                own.interfaces[name] = interface_tree(problem, name, surface)
                own.interfaces[name]["bolt"] = -1 if surface.bolt is None else surface.bolt
        for name, part in problem.substructures.items():
            own.parts[name] = {"nodes": part.dof_coordinates} | shape_tree(part, part.material)
    if problem.comm is None:
        return own
    every = problem.comm.gather(own, root=0) or []
    interfaces = {name: each for found in every for name, each in found.interfaces.items()}
    parts = {name: each for found in every for name, each in found.parts.items()}
    return Shown(interfaces, {name: parts[name] for name in problem.parts if name in parts})


def _face(problem: Problem, shown: Shown, plan: Plan, more: Tree) -> Tree:
    """What :func:`dolfinx_frontend.load` needs beside the numbers of the run."""
    about = {
        "software": chaos_file.software(),
        "plan": str(plan),
        "problem": repr(problem),
        **more["about"],
    }
    kind = about["kind"]
    interfaces = {}
    for name in problem.interfaces:
        node = shown.interfaces[name]
        contact = law_contact(problem, plan, name) if kind in ("deterministic", "history") else None
        if contact is not None:
            known = {key: getattr(contact, key) for key in ("clearance", "friction", "threshold")}
            node["contact"] = {key: values for key, values in known.items() if values is not None}
        interfaces[name] = node
    tree = {"active": list(plan.active), "interfaces": interfaces, "substructures": shown.parts}
    if plan.times is not None:
        tree["times"] = np.asarray(plan.times, dtype=np.float64)
        if plan.history != "steps":
            tree["in_time"] = np.moveaxis(plan.in_time(np.eye(len(plan.patterns))), 0, -1)
    return {**tree, **more, "about": about}


def _write(folder: Path, described: bridge.Description, tree: Tree) -> None:
    """All or nothing: an older problem stays until this one is complete."""
    with Files() as files:
        files.folder(folder / "matrices")
        kept = set((folder / "matrices").glob("*.petsc"))
        matrices = _Matrices(folder)
        try:
            bodies = [_body_tree(body, matrices) for body in described.bodies]
            interfaces = [
                _interface_tree(each, described.fields[each["name"]].kind, matrices)
                for each in described.interfaces
            ]
            tree = tree | {
                "bodies": _numbered(bodies),
                "interfaces": _numbered(interfaces),
                "matrices": {"files": matrices.files, "sha256": matrices.checksums},
            }
            with replaced(folder / "problem.h5") as temporary:
                hdf5.write_tree(temporary, {"format": FORMAT, "version": VERSION}, tree)
            kept = {folder / name for name in matrices.files}
        finally:
            for stale in set((folder / "matrices").glob("*.petsc")) - kept:
                with contextlib.suppress(OSError):  # nobody reads it
                    stale.unlink()
