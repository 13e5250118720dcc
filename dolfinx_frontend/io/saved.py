"""A result in one HDF5 file, and what a fresh process reads from it: nothing is meshed or solved again.

The file is described in ``docs/results.md``. It holds forces and jumps of the interfaces, displacements at
the nodes, the numbers of the tables, the plan as text and, for a chaos, all that its evaluation needs.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import unknown_name
from dolfinx_frontend.io import chaos_file, hdf5
from dolfinx_frontend.io.chaos_file import ChaosFile
from dolfinx_frontend.io.hdf5 import ChaosFileError, Tree
from dolfinx_frontend.plan.plan import Plan
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.result import Result
from dolfinx_frontend.results.surfaces import ContactValues, contact_values
from dolfinx_frontend.scene.laws import Displacement
from dolfinx_frontend.solvers.chaos import ChaosResult
from dolfinx_frontend.solvers.sampling import SampleResult
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = ["ResultFileError", "SavedInterface", "SavedResult", "load", "save_result", "save_samples"]


FORMAT = "latin-result"
VERSION = 1
SUFFIXES = (".h5", ".hdf5")


class ResultFileError(ValueError):
    """A file that is no saved result, is damaged or of another version, or cannot be written."""


@dataclass(frozen=True, eq=False)
class SavedInterface:
    """An interface of a saved result.

    Attributes
    ----------
    law, description
        Name of its law, and the law with its values in words.
    sides
        ``"part:face"``, one or two.
    points, weights, frames
        (m, d) on side 1, length; (m,) areas; (m, d, d) local frames, row 0 the normal out of side 1.
    force, jump
        As the result gave them, in the local frame: ([N,] [T,] m, components); of a chaos the mean; None
        where they were no unknowns, or not saved.
    axes
        Global axes of the components of a prescribed displacement; of all others None: those of the frame.
    contact
        Of a contact its clearance, friction coefficient and threshold (T, m), of a deterministic answer.
    """

    name: str
    law: str
    description: str
    sides: tuple[str, ...]
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    frames: Array = field(repr=False)
    force: Array | None = field(repr=False)
    jump: Array | None = field(repr=False)
    axes: tuple[int, ...] | None = field(default=None, repr=False)
    contact: ContactValues | None = field(default=None, repr=False)

    @property
    def law_frames(self) -> Array:
        """(m, components, d): directions of the components of force and jump, global axes."""
        d = self.points.shape[1]
        if self.axes is not None:
            return np.tile(np.eye(d)[list(self.axes)], (len(self.points), 1, 1))
        return self.frames[:, : d if self.force is None else self.force.shape[-1]]

    @property
    def area(self) -> float:
        """Sum of the weights."""
        return float(self.weights.sum())


@dataclass(frozen=True, eq=False)
class SavedResult:
    """A result read from a file.

    Attributes
    ----------
    path
        Where it came from.
    kind
        ``"deterministic"``, ``"history"``, ``"chaos"`` or ``"samples"``.
    status, iterations, error
        How the run ended; of samples the worst status, the sum, the largest.
    plan, problem
        In words.
    software
        What wrote the file.
    times
        (T,) of a load history, or None.
    interfaces
        Name -> points, weights, force and jump.
    displacements
        Substructure -> ([T,] nodes, d), of a chaos the mean; empty if they were not saved.
    nodes
        Substructure -> (nodes, d) coordinates.
    germs, weights
        (N, L) points of samples, and their weights (N,) if they are a quadrature; otherwise None.
    chaos
        Of a chaos: germs, modes, coefficients; can be evaluated anywhere.
    """

    path: Path
    kind: str
    status: str
    iterations: int
    error: float
    plan: str
    problem: str
    software: str
    times: Array | None = field(repr=False)
    interfaces: dict[str, SavedInterface] = field(repr=False)
    displacements: dict[str, Array] = field(repr=False)
    nodes: dict[str, Array] = field(repr=False)
    germs: Array | None = field(repr=False)
    weights: Array | None = field(repr=False)
    chaos: ChaosFile | None = field(repr=False)
    _readings: tables.Readings = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached, in all samples."""
        return self.status == "converged"

    def _interface(self, name: str) -> SavedInterface:
        if name not in self.interfaces:
            raise unknown_name("interface", name, self.interfaces, str(self.path))
        return self.interfaces[name]

    def _stored(self, name: str, what: str) -> Array:
        found: Array | None = getattr(self._interface(name), what)
        if found is None:
            raise ResultFileError(
                f"{self.path}: interface {name!r} has no {what} here: it was eliminated, or "
                "saved without fields"
            )
        return found

    def force(self, interface: str) -> Array:
        """Force per area on side 1, ([N,] [T,] m, components), local frame; of a chaos the mean."""
        return self._stored(interface, "force")

    def jump(self, interface: str) -> Array:
        """Jump w2 - w1, ([N,] [T,] m, components), local frame; of a chaos the mean."""
        return self._stored(interface, "jump")

    def table(
        self,
        interfaces: Sequence[str] | str | None = None,
        step: int | None = -1,
        about: npt.ArrayLike | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
    ) -> tables.Table:
        """Resultants, pressures and areas of the interfaces, as the result itself gives them."""
        return tables.summarise(self._readings.select(interfaces), step, about, quantiles)

    def bolts(
        self,
        interfaces: Sequence[str] | str | None = None,
        quantiles: Sequence[float] = tables.QUANTILES,
    ) -> tables.Table:
        """Bolt forces before and after loading."""
        return tables.bolts(self._readings.select(interfaces), quantiles)

    def __repr__(self) -> str:
        return (
            f"<SavedResult {self.path}: {self.kind}, {self.status}, {self.iterations} iterations, "
            f"{len(self.interfaces)} interfaces, estimated error {self.error:.1e}>"
        )


# --- writing ---------------------------------------------------------------------------------------
def _described(law: object) -> str:
    with np.printoptions(threshold=8, precision=6):
        return repr(law)


def _readings_tree(readings: tables.Readings) -> dict[str, Tree]:
    return {
        name: {
            "bolt": -1 if each.bolt is None else each.bolt,
            "centre": each.centre,
            "measures": {column: np.asarray(v, dtype=np.float64) for column, v in each.values.items()},
        }
        for name, each in readings.interfaces.items()
    }


def _common(result: Result | SampleResult, plan: Plan, readings: tables.Readings) -> Tree:
    """What is stored of every result, without its fields."""
    problem = result.problem
    problem.on_one_rank("save")
    read = _readings_tree(readings)
    tree: Tree = {
        "software": chaos_file.software(),
        "plan": str(plan),
        "problem": repr(problem),
        "missing": json.dumps(readings.missing),
        "interfaces": {
            name: {
                "law": type(i.law).__name__,
                "description": _described(i.law),
                "sides": [f"{s.substructure}:{s.face}" for s in i.sides],
                "points": i.points,
                "weights": i.weights,
                "frames": i.frames,
                **({"axes": np.array(i.law.axes(i.dim))} if isinstance(i.law, Displacement) else {}),
                **read.get(name, {}),
            }
            for name, i in problem.interfaces.items()
        },
        "substructures": {
            name: {"nodes": s.dof_coordinates} for name, s in problem.substructures.items()
        },
    }
    if plan.times is not None:
        tree["times"] = np.asarray(plan.times, dtype=np.float64)
    return tree


def save_result(path: str | Path, result: Result, readings: tables.Readings, fields: bool = True) -> None:
    """Write a deterministic or chaos result, see :meth:`dolfinx_frontend.Result.save`."""
    target = _target(path)
    random = isinstance(result, ChaosResult)
    kind = "chaos" if random else "deterministic" if result.plan.times is None else "history"
    tree = _common(result, result.plan, readings)
    tree |= {"kind": kind, "status": result.status, "iterations": int(result.iterations)}
    tree["error"] = float(result.error)
    if fields:
        for name in tables.with_known_force(result):
            tree["interfaces"][name] |= {"force": result.force(name), "jump": result.jump(name)}
            if not random:
                tree["interfaces"][name] |= _contact_tree(result.problem.interfaces[name], result.plan)
        for name, s in result.problem.substructures.items():
            values = result.displacements[name]
            tree["substructures"][name]["displacement"] = values.reshape(*values.shape[:-1], -1, s.dim)
    if isinstance(result, ChaosResult):
        tree["sampling"] = readings.kind or "random"
        tree["chaos"] = _chaos_tree(result, fields)
    _write(target, tree)


def _contact_tree(interface: Interface, plan: Plan) -> Tree:
    values = contact_values(interface, plan.times)
    if values is None:
        return {}
    return {"contact": {name: v for name, v in vars(values).items() if v is not None}}


def _chaos_tree(result: ChaosResult, fields: bool) -> Tree:
    names = tuple(result.problem.substructures) if fields else ()
    return chaos_file.content(result.space, result.basis, *result.chaos_fields(names))


def save_samples(
    path: str | Path, result: SampleResult, readings: tables.Readings, fields: bool = True
) -> None:
    """Write samples, see :meth:`dolfinx_frontend.SampleResult.save`."""
    target = _target(path)
    tree = _common(result, result.plan, readings)
    tree |= {"kind": "samples", "status": result.status}
    tree |= {"iterations": int(result.iterations.sum()), "error": float(np.max(result.error))}
    tree |= {"sampling": result.kind, "germs": result.germs}
    if result.weights is not None:
        tree["weights"] = result.weights
    for name in result.plan.active if fields else ():
        tree["interfaces"][name] |= {"force": result.force(name), "jump": result.jump(name)}
    _write(target, tree)


def _target(path: str | Path) -> Path:
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ResultFileError(
            f"{target}: a result is saved as {' or '.join(SUFFIXES)}, not {target.suffix!r}"
        )
    return target


def _write(target: Path, tree: Tree) -> None:
    try:
        with hdf5.replaced(target) as temporary:
            hdf5.write_tree(temporary, {"format": FORMAT, "version": VERSION}, tree)
    except ChaosFileError as error:  # no h5py, or the file cannot be written
        raise ResultFileError(str(error)) from error


# --- reading ---------------------------------------------------------------------------------------
def load(path: str | Path) -> SavedResult:
    """Read a result that ``result.save(path)`` wrote, in any process.

    Raises
    ------
    ResultFileError
        The file does not exist, is no saved result, is of another version, truncated or damaged.
    """
    source = Path(path)
    if not source.is_file():
        raise ResultFileError(f"{source} does not exist or is no file: check the name")
    with source.open("rb") as file:
        first = file.read(len(chaos_file.FORMAT))
    if first == chaos_file.FORMAT.encode():
        raise ResultFileError(f"{source} is a chaos file: read it with io.load_chaos")
    try:
        tree = hdf5.read_tree(source, FORMAT)
        version = int(tree["version"])
    except hdf5.DAMAGE as error:
        raise ResultFileError(
            f"{source} cannot be read ({error}): it is truncated, damaged or no saved result; save it again"
        ) from error
    if version != VERSION:
        raise ResultFileError(
            f"{source} is a saved result of version {version}; this software reads version {VERSION}: use "
            f"the software that wrote it ({tree.get('software', 'unknown')}), or solve and save again"
        )
    try:
        return _read(source, tree)
    except hdf5.DAMAGE as error:
        raise ResultFileError(
            f"{source} is damaged ({type(error).__name__}: {error}); save it again"
        ) from error


def _numbers(node: Any, what: str, dimensions: int | None = None) -> Array:
    data = np.asarray(node, dtype=np.float64)
    if dimensions is not None and data.ndim != dimensions:
        raise ValueError(f"{what}: {data.ndim} axes instead of {dimensions}")
    return data


def _optional(node: Tree, name: str) -> Array | None:
    return _numbers(node[name], name) if name in node else None


def _contact(node: Tree) -> ContactValues:
    clearance = _numbers(node["clearance"], "clearance", 2)
    return ContactValues(clearance, _optional(node, "friction"), _optional(node, "threshold"))


def _read(path: Path, tree: Tree) -> SavedResult:
    kind = str(tree["kind"])
    if kind not in ("deterministic", "history", "chaos", "samples"):
        raise ValueError(f"kind {kind!r}")
    interfaces, measured = {}, {}
    for name, node in tree["interfaces"].items():
        points = _numbers(node["points"], f"{name}: points", 2)
        weights = _numbers(node["weights"], f"{name}: weights", 1)
        if len(points) != len(weights):
            raise ValueError(f"{name}: {len(points)} points and {len(weights)} weights")
        interfaces[name] = SavedInterface(
            name,
            str(node["law"]),
            str(node["description"]),
            tuple(map(str, node["sides"])),
            points,
            weights,
            _numbers(node["frames"], f"{name}: frames", 3),
            _optional(node, "force"),
            _optional(node, "jump"),
            tuple(int(a) for a in np.atleast_1d(node["axes"])) if "axes" in node else None,
            _contact(node["contact"]) if "contact" in node else None,
        )
        if "measures" in node:
            values = {column: _numbers(v, f"{name}: {column}") for column, v in node["measures"].items()}
            bolt = int(node["bolt"])
            centre = _numbers(node["centre"], f"{name}: centre", 1)
            measured[name] = tables.Measures(centre, values, str(node["law"]), None if bolt < 0 else bolt)
    sampling: Kind | None = tree.get("sampling")
    if sampling is not None and sampling not in get_args(Kind):
        raise ValueError(f"sampling {sampling!r}")
    times, weights_ = _optional(tree, "times"), _optional(tree, "weights")
    missing = {str(k): str(v) for k, v in json.loads(tree["missing"]).items()}
    readings = tables.Readings(measured, times, sampling, weights_, missing)
    parts = tree["substructures"]
    return SavedResult(
        path,
        kind,
        str(tree["status"]),
        int(tree["iterations"]),
        float(tree["error"]),
        str(tree["plan"]),
        str(tree["problem"]),
        str(tree["software"]),
        times,
        interfaces,
        {
            name: _numbers(node["displacement"], f"{name}: displacement")
            for name, node in parts.items()
            if "displacement" in node
        },
        {name: _numbers(node["nodes"], f"{name}: nodes", 2) for name, node in parts.items()},
        _optional(tree, "germs"),
        weights_,
        chaos_file.from_tree(path, tree["chaos"]) if "chaos" in tree else None,
        readings,
    )
