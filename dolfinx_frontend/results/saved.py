"""What a fresh process reads from the file of a result: an answer like any other; nothing is solved again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from dolfinx_frontend.assembly.interface import PointFrames, Vertices
from dolfinx_frontend.assembly.matrix_part import Motion, motion_of
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import (
    check_known,
    checked_flag,
    checked_numbers,
    checked_path,
    checked_whole,
)
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.describe import shown_error
from dolfinx_frontend.common.files import opened, shown
from dolfinx_frontend.common.frozen import ReadOnlyDict, locked, locked_matrix, read_only
from dolfinx_frontend.common.statuses import RENAMED
from dolfinx_frontend.formats import chaos_file, hdf5
from dolfinx_frontend.formats.chaos_file import ChaosFile
from dolfinx_frontend.formats.hdf5 import Tree
from dolfinx_frontend.formats.layout import Group
from dolfinx_frontend.formats.meshes import StoredPart
from dolfinx_frontend.results.accuracy import unsolved
from dolfinx_frontend.results.answer import AnswerKind, Block, Surface, chunks
from dolfinx_frontend.results.contact import ContactValues
from dolfinx_frontend.results.contents import check_contents
from dolfinx_frontend.results.face import Face
from dolfinx_frontend.results.point import OnePoint, point_number
from dolfinx_frontend.results.readings import Measures, Readings, read
from dolfinx_frontend.results.runs import RUN_FORMAT, RUN_VERSION, from_run
from dolfinx_frontend.results.writing import FORMAT, NO_FIELDS, VERSION, ResultFileError, write
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.uncertainty.quantities import Kind

__all__ = [
    "ResultFileError",
    "SavedInterface",
    "SavedPlan",
    "SavedProblem",
    "SavedResult",
    "SavedSide",
    "load",
]

T = TypeVar("T")
OLDEST = 1
"""The first version of a file that is read."""


# --- what a result was solved for, as far as it is in a file ---------------------------------------
@dataclass(frozen=True, eq=False)
class SavedSide:
    """One side of an interface; the first has its normal, the one with the points its shape functions there.

    Attributes
    ----------
    normal
        (d,), mean unit normal out of this side (0 if the face is closed).
    shape
        (m, nodes of the part): value at a point from those at the nodes.
    """

    substructure: str
    face: str
    normal: Array | None = field(default=None, repr=False)
    shape: sp.csr_matrix | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        locked(self)

    def __str__(self) -> str:
        return f"{self.substructure}:{self.face}"


@dataclass(frozen=True, eq=False, repr=False)
class _Surface:
    """The covered facets of an interface in the order of the file, and what of them belongs to its points."""

    rows: Callable[[], Ints]
    areas: sp.csr_matrix
    corners: Ints | None
    nodal: sp.csr_matrix | None


@dataclass(frozen=True, eq=False)
class SavedInterface(PointFrames):
    """An interface of a saved result.

    Attributes
    ----------
    law, description
        Name of its law (of :meth:`SavedResult.with_laws` the law itself), and the law with its values in
        words.
    sides
        One or two; ``str(side)`` is ``"part:face"``.
    points, weights, frames
        (m, d) on side 1, length; (m,) areas; (m, d, d) local frames, row 0 the normal out of side 1.
    directions
        (m, components, d): those of the components of force and jump, global axes.
    force, jump
        As the result gave them, in the local frame: ([N,] [T,] m, components); of a chaos the mean; None
        where they were no unknowns, or not saved.
    is_contact, contact
        Whether it can open; its clearance, friction coefficient and threshold, where they are known.
    bolt
        The step that ends its tightening if it is a bolt in a load history, else None.
    wrench
        Force (d,) and moment of a force 1, of an interface between mean motions of faces; None: it has
        points.
    places, mean_normals
        (m, d), of which resultants are made; None: the points, and their normals.
    """

    name: str
    law: str | Law
    description: str
    sides: tuple[SavedSide, ...]
    points: Array = field(repr=False)
    weights: Array = field(repr=False)
    frames: Array = field(repr=False)
    directions: Array = field(repr=False)
    force: Array | None = field(repr=False)
    jump: Array | None = field(repr=False)
    is_contact: bool = field(default=False, repr=False)
    contact: ContactValues | None = field(default=None, repr=False)
    bolt: int | None = field(default=None, repr=False)
    carrier: int = 0
    wrench: Array | None = field(default=None, repr=False)
    places: Array | None = field(default=None, repr=False)
    mean_normals: Array | None = field(default=None, repr=False)
    _surface: _Surface | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        locked(self)

    @cached_property
    def _own(self) -> tuple[Ints, sp.csr_matrix, Vertices | None]:
        if self._surface is None:
            raise ResultFileError(f"interface {self.name!r}: there is no mesh in the file: {NO_FIELDS}")
        rows = self._surface.rows()
        order = np.argsort(rows)
        corners = self._surface.corners
        vertices = None if corners is None else Vertices(corners[order], self._surface.nodal)
        return read_only(rows[order]), locked_matrix(self._surface.areas[order], own=True), vertices

    @property
    def facets(self) -> Ints:
        """(k,), facets of the side `carrier` that are covered, among those of its face."""
        return self._own[0]

    @property
    def areas(self) -> sp.csr_matrix:
        """(k, m), area of each facet that belongs to each point."""
        return self._own[1]

    @property
    def vertices(self) -> Vertices | None:
        """The field of the points as one that is continuous; None: there is none."""
        return self._own[2]


@dataclass(frozen=True, eq=False, repr=False)
class SavedProblem:
    """Parts and interfaces of a saved result; printed, the problem as it was."""

    text: str
    substructures: dict[str, Any]
    interfaces: dict[str, SavedInterface]
    rank = 0
    distribution = None

    def __post_init__(self) -> None:
        locked(self)

    @property
    def parts(self) -> dict[str, Any]:
        """The parts by name."""
        return self.substructures

    def here(self, name: str) -> SavedInterface:
        """An interface."""
        return self.interfaces[name]

    def speaks_for(self, name: str) -> bool:
        """All is on one rank."""
        return True

    def everywhere(self, name: str, read: Callable[[], T]) -> T:
        """All is on one rank."""
        return read()

    def check_alike(self, call: str, **given: object) -> None:
        """All is on one rank."""

    def initial_stresses(self, part: str) -> list[tuple[str, str, Any]]:
        """A file has none: parts that have some were saved without their material."""
        return []

    def check_here(self, part: str) -> None:
        """All is on one rank."""

    def check_sources(self, part: str | None = None) -> None:
        """Nobody has its meshes."""

    def check_mesh(self, part: str | None = None) -> None:
        """Nobody has its meshes."""

    @property
    def comm(self) -> None:
        """None: all is on one rank."""

    def __repr__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False, repr=False)
class SavedPlan:
    """Times and active interfaces of a saved result; printed, the plan as it was."""

    text: str
    times: Array | None
    active: tuple[str, ...]

    def __repr__(self) -> str:
        return self.text


class _Nodes:
    """A part without a mesh."""

    material = None

    def __init__(self, name: str, nodes: Array, why: str) -> None:
        self.name, self.dof_coordinates, self._why = name, nodes, why

    @property
    def dim(self) -> int:
        return int(self.dof_coordinates.shape[1])

    def __getattr__(self, name: str) -> Any:
        if name in ("part", "V", "space", "function"):
            raise ResultFileError(f"part {self.name!r} has no mesh here: {self._why}")
        raise AttributeError(name)


class _Points(_Nodes):
    """A part that is a matrix: its points come first."""

    meshed = False

    def __init__(self, name: str, nodes: Array, points: int, turning: Ints) -> None:
        super().__init__(name, nodes, "it is a matrix, of which only displacements are known")
        self._points, self._turning = points, turning

    def function(self, unknowns: Array, name: str) -> Motion:
        """Unknowns (n,) at the points."""
        linear = name == "displacement"
        return motion_of(self.dof_coordinates, self._points, self._turning, unknowns, linear)


# --- the result ------------------------------------------------------------------------------------
class SavedResult(Face):
    """A result read from a file, with all that the result itself offered.

    Attributes
    ----------
    path
        Where it came from.
    kind
        ``"deterministic"``, ``"history"``, ``"chaos"``, ``"samples"`` or ``"sweep"``.
    status, iterations, error, place
        How the run ended and where the error is largest; of samples and sweeps the worst status, the sum, the
        largest. NaN: the error is not known.
    statuses
        Status of every time step; of samples and sweeps of every point.
    plan, problem
        Printed, as they were; times, active interfaces, parts and interfaces.
    software
        What wrote the file.
    statistics
        How the samples are to be read.
    germs, weights
        (N, L) points of samples, of a chaos those of its tables, and their weights (N,) if they are a
        quadrature; otherwise None.
    axes
        Of a sweep: swept parameter -> its values.
    chaos
        Of a chaos: germs, modes, coefficients; can be evaluated anywhere.
    """

    def __init__(
        self,
        path: Path,
        tree: Tree,
        plan: SavedPlan,
        problem: SavedProblem,
        chaos: ChaosFile | None,
        measured: Mapping[str, Measures],
    ) -> None:
        self.path, self.plan, self.problem, self.chaos = path, plan, problem, chaos
        self.iterations, self.error = int(tree["iterations"]), float(tree["error"])
        self.place = str(tree.get("place", ""))
        statuses = tree["points"]["status"] if "points" in tree else tree.get("statuses", ())
        self.statuses = tuple(_status(each) or "interrupted" for each in statuses)
        self.software = str(tree["software"])
        self.germs, self.weights = _optional(tree, "germs"), _optional(tree, "weights")
        axes = tree.get("axes", {})
        self.axes = ReadOnlyDict({name: _numbers(v, name, 1) for name, v in axes.items()})
        self.seconds = ReadOnlyDict()
        self._tree = tree
        missing = {str(k): str(v) for k, v in json.loads(tree["missing"]).items()}
        self._measured = bool(measured)  # latin_run writes fields only
        self._readings = Readings(
            dict(measured), self.statistics, plan.times, self.weights, self.coordinates, missing
        )

    def with_laws(self, laws: Mapping[str, Law]) -> SavedResult:
        """The same in the process that has saved it, which knows the laws of its interfaces."""
        own = {name: replace(each, law=laws[name]) for name, each in self.problem.interfaces.items()}
        again = copy(self)
        again.problem = replace(self.problem, interfaces=own)
        return again

    @property
    def kind(self) -> AnswerKind:
        """What was saved."""
        kind: AnswerKind = self._tree["kind"]
        return kind

    @property
    def unsolved(self) -> tuple[str, ...]:
        """How many points of samples and sweeps ended otherwise than converged, and which."""
        if self.kind in ("samples", "sweep"):
            return unsolved(self.statuses)
        return () if self.converged else (f"NOT CONVERGED: {self.status}",)

    @property
    def status(self) -> str:
        """How the run ended."""
        return _status(self._tree["status"])

    @property
    def statistics(self) -> Kind:
        """How the samples are to be read."""
        statistics: Kind = self._tree["statistics"]
        return statistics

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached, in all samples."""
        return self.status == "converged"

    @property
    def interfaces(self) -> dict[str, SavedInterface]:
        """Name -> points, weights, force and jump."""
        interfaces: dict[str, SavedInterface] = self.problem.interfaces
        return interfaces

    @property
    def nodes(self) -> dict[str, Array]:
        """Part -> (nodes, d) coordinates, in the order of the unknowns."""
        return {name: part.dof_coordinates for name, part in self.problem.substructures.items()}

    @property
    def coordinates(self) -> Mapping[str, Array]:
        """Of a sweep: swept parameters -> their values at all points, (n,)."""
        mesh = np.meshgrid(*self.axes.values(), indexing="ij")
        return {name: values.ravel() for name, values in zip(self.axes, mesh, strict=True)}

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a sweep that of its grid, of samples (N,), otherwise ()."""
        if self.kind == "samples" and self.germs is not None:
            return (len(self.germs),)
        return tuple(len(values) for values in self.axes.values())

    @property
    def known(self) -> tuple[str, ...]:
        """Interfaces whose force is in the file at their points."""
        return tuple(name for name, each in self.interfaces.items() if each.force is not None)

    @property
    def without_displacements(self) -> str | None:
        """Why there are no displacements, and how to get them; None: there are."""
        why: str | None = self._tree.get("no_displacements")
        return why

    def surface(self, interface: str) -> Surface:
        """An interface as tables and figures see it."""
        self._check_interface(interface)
        each = self.interfaces[interface]
        return Surface(
            each.name,
            each.law if isinstance(each.law, str) else each.law.title,
            each.points,
            each.weights,
            each.normals,
            each.directions,
            each.is_contact,
            each.bolt,
            each.wrench,
            each.places,
            each.mean_normals,
        )

    def load(self, interface: str) -> Array | None:
        """None: the file has the forces of loads as all others."""
        return None

    def why_unknown(self, interface: str) -> str | None:
        """Why an interface without force has no row."""
        return "eliminated, or saved without fields: the file has the numbers of its own samples only"

    def function(self, part: str, unknowns: Array, name: str) -> Any:
        """Unknowns (n,) as a dolfinx function; the mesh is made when it is first needed."""
        return self.problem.substructures[part].function(unknowns, name)

    def _stored(self, name: str, what: str) -> Array:
        check_known("interface", name, self.interfaces, str(self.path))
        found: Array | None = getattr(self.interfaces[name], what)
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

    def _numbers(self, part: str, what: str) -> Array | None:
        values: Array | None = self._tree["substructures"][part].get(what)
        return None if values is None else values.reshape(*values.shape[:-2], -1)

    def unknowns(self, part: str) -> Array:
        """Unknowns ([T,] n) of a part, length: of a random answer the mean, of a sweep the last point."""
        self._check_part(part)
        values = self._numbers(part, "displacement")
        assert values is not None  # was asked before
        return values[-1] if self.kind == "sweep" else values

    def deviation(self, part: str) -> Array | None:
        """Standard deviation ([T,] n) of the unknowns; None: nothing is random."""
        if self.chaos is not None:
            deviation: Array = np.sqrt(sum(each**2 for each in self.spread(part)))
            return deviation
        self._check_part(part)
        return self._numbers(part, "deviation")

    def _coefficients(self, field: str) -> Array:
        """(P + 1, ...) of a field of the chaos."""
        assert self.chaos is not None
        found = self.chaos.fields[field]
        block = found.coefficients.T
        return block.reshape(len(block), *(found.shape or (-1,)))

    def spread(self, part: str) -> Sequence[Array]:
        """Of a chaos: unknowns ([T,] n) of the modes beside the mean."""
        self._check_part(part)
        return list(self._coefficients(f"displacement:{part}")[1:]) if self.chaos is not None else ()

    def modes_of(self, interface: str) -> tuple[Array, Array] | None:
        """Of a chaos: coefficients (P + 1, [T,] m, components) of force and jump."""
        if self.chaos is None:
            return None
        self._stored(interface, "force")
        return self._coefficients(f"force:{interface}"), self._coefficients(f"jump:{interface}")

    # --- samples -------------------------------------------------------------------------------
    @property
    def draws(self) -> int | None:
        """Of a chaos: all samples that are in the file."""
        return None

    def blocks(self, samples: int | None = None, seed: int = 0) -> Iterator[Block]:
        """The samples of the file, some at a time; of a chaos the first of those that its tables use."""
        self._check_samples(samples)
        if self.kind == "chaos":
            germs = self.germs
            if germs is None or (samples or 0) > len(germs):
                raise ResultFileError(
                    f"{self.path}: {samples or 'no'} samples are not in the file, it has "
                    f"{0 if germs is None else len(germs)}: save the chaos with samples=..."
                )
            chosen = germs[: samples or len(germs)]
            return map(self.at, (chosen[part] for part in self._in_parts(len(chosen))))
        if self.kind in ("samples", "sweep"):
            return map(self._block, self._in_parts(int(np.prod(self.shape))))
        return iter([self._block(slice(0, 1))])

    def _check_samples(self, samples: int | None) -> None:
        if samples is not None:
            checked_whole(str(self.path), "samples", samples, 1)

    def _in_parts(self, count: int) -> Iterator[slice]:
        steps = 1 if self.times is None else len(self.times)
        most = max(each.points.size for each in self.interfaces.values())
        return (part for part in chunks(count, steps * most))

    def shown(self) -> Block:
        """The one sample that fields are of where there are no moments: of a sweep its last point."""
        count = int(np.prod(self.shape))
        return self._block(slice(count - 1, count))

    def _block(self, part: slice) -> Block:
        lead = len(self.shape)

        def flat(values: Array) -> Array:
            every = values.reshape(-1, *values.shape[lead:]) if lead else values[None]
            return every[part]

        def both(name: str) -> tuple[Array, Array]:
            return flat(self.force(name)), flat(self.jump(name))

        def displacement(name: str, unknowns: Ints | None) -> Array:
            self._check_part(name)
            if self.kind == "samples":
                raise ResultFileError(
                    f"{self.path}: displacements of {name!r} at single samples are not in the file, only "
                    "their mean and deviation"
                )
            values = self._numbers(name, "displacement")
            assert values is not None  # was asked before
            u = (values if self.kind == "sweep" else values[None])[part]
            return u if unknowns is None else u[..., unknowns]

        def contact(name: str) -> ContactValues | None:
            values = self.interfaces[name].contact
            return None if values is None else values[part]

        count = len(range(*part.indices(int(np.prod(self.shape)))))
        weights = None if self.weights is None else self.weights[part]
        germs = None if self.germs is None else self.germs[part]
        return Block(count, both, displacement, contact, germs, weights)

    def at(self, germs: Array) -> Block:
        """Of a chaos: fields at points (N, L) of the germs."""
        chaos = self.chaos
        if chaos is None:
            raise ResultFileError(f"{self.path}: only a chaos can be evaluated at points of the germs")
        wanted = "give points of finite numbers, one row each"
        points = np.atleast_2d(checked_numbers(str(self.path), "germ_points", germs, wanted))
        psi = chaos.modes(points)

        def both(name: str) -> tuple[Array, Array]:
            self._stored(name, "force")
            if name in self._tree.get("nonlinear", ()):
                raise ResultFileError(
                    f"{self.path}: interface {name!r}: its law is nonlinear and not in the file, so its "
                    "force at a sample is not known: ask the result before it is saved, or save samples of "
                    "it (result.monte_carlo(1000).save(...))"
                )
            modes = self._coefficients(f"force:{name}"), self._coefficients(f"jump:{name}")
            force, jump = (np.asarray(np.tensordot(psi, each, 1), dtype=np.float64) for each in modes)
            return force, jump

        def displacement(name: str, unknowns: Ints | None) -> Array:
            self._check_part(name)
            block = self._coefficients(f"displacement:{name}")
            wanted = block if unknowns is None else block[..., unknowns]
            return np.asarray(np.tensordot(psi, wanted, 1), dtype=np.float64)

        return Block(len(points), both, displacement, germs=points)

    def point(self, *index: int) -> OnePoint:
        """Of samples and sweeps: the answer at one of the points, as a deterministic one."""
        number = point_number(index, self.shape)
        points = self._tree["points"]
        return OnePoint(
            self,
            partial(self._block, slice(number, number + 1)),
            _status(points["status"][number]),
            int(points["iterations"][number]),
            float(points["error"][number]),
        )

    # --- numbers -------------------------------------------------------------------------------
    def readings(
        self, interfaces: Sequence[str] | str | None = None, samples: int | None = None, seed: int = 0
    ) -> Readings:
        """The numbers of the file; of a chaos those of the first `samples` samples."""
        self._check_samples(samples)
        other = samples is not None and self.germs is not None and samples != len(self.germs)
        if not self._measured or (self.kind == "chaos" and other):
            return read(self, interfaces, samples, seed)
        return self._readings.select(interfaces)

    def save(
        self, path: str | Path, fields: bool = True, samples: int | None = None, seed: int = 0
    ) -> None:
        """Write what was read to another file, with or without fields."""
        checked_flag("save", "fields", fields)
        write(path, self._tree if fields else _without_fields(self._tree))

    def __repr__(self) -> str:
        where = f" in {self.place}" if self.place and not self.converged else ""
        return (
            f"<SavedResult {self.path}: {self.kind}, {self.status}, {self.iterations} iterations, "
            f"{len(self.interfaces)} interfaces, estimated error {shown_error(self.error)}{where}>"
        )


def _status(word: object) -> str:
    return RENAMED.get(str(word), str(word))


def _without_fields(tree: Tree) -> Tree:
    out = dict(tree) | {"no_displacements": NO_FIELDS}
    away = ("force", "jump", "contact")
    out["interfaces"] = {
        name: {key: v for key, v in node.items() if key not in away}
        for name, node in tree["interfaces"].items()
    }
    out["substructures"] = {name: {"nodes": node["nodes"]} for name, node in tree["substructures"].items()}
    return out


# --- reading ---------------------------------------------------------------------------------------
def load(path: str | Path) -> SavedResult:
    """Read a result that ``result.save(path)`` or the program ``latin_run`` wrote, in any process.

    Raises
    ------
    ResultFileError
        The file does not exist, is no saved result, is of another version, truncated or damaged.
    """
    source = checked_path("load", path)
    name = shown(source)
    with opened(source, hdf5.MEMORY, ResultFileError) as file:
        first = file.read(len(chaos_file.FORMAT))
    if first == chaos_file.FORMAT.encode():
        raise ResultFileError(f"{name} is a chaos file: read it with chaos_file.load_chaos")
    of_run = first.startswith(RUN_FORMAT.encode())
    form, oldest, newest = (RUN_FORMAT, RUN_VERSION, RUN_VERSION) if of_run else (FORMAT, OLDEST, VERSION)
    try:
        tree = hdf5.read_tree(source, form, ResultFileError)
        version = Group(tree).whole("version", 0, 2**62)
        del tree["version"]
    except hdf5.DAMAGE as error:
        raise ResultFileError(
            f"{name} cannot be read ({error}): it is truncated, damaged or no saved result; save it again"
        ) from error
    if not oldest <= version <= newest:
        raise ResultFileError(
            f"{name} is a saved result of version {version}; this software reads versions {oldest} to "
            f"{newest}: use the software that wrote it ({tree.get('software', 'unknown')}), or solve and "
            "save again"
        )
    try:
        older = ((RUN_VERSION, from_run),) if of_run else ((1, _from_first), (2, _from_second))
        for each, convert in older:
            if version <= each:
                tree = convert(tree)
        check_contents(tree, meshes=of_run or version > 1)
        return _read(source, tree)
    except hdf5.LayoutError as error:
        raise ResultFileError(f"{name} is damaged or was edited: {error}; save it again") from error
    except hdf5.DAMAGE as error:
        raise ResultFileError(
            f"{name} is damaged ({type(error).__name__}: {error}); save it again"
        ) from error


def _from_first(tree: Tree) -> Tree:
    """A file of version 1, which had no meshes and no samples of a chaos, as one of today."""
    kind = str(tree["kind"])
    tree["statistics"] = tree.pop("sampling", "value")
    tree["active"] = []
    for name, node in tree["interfaces"].items():
        frames = _numbers(node["frames"], f"{name}: frames", 3)
        d = frames.shape[2]
        axes = np.atleast_1d(node.pop("axes")) if "axes" in node else None
        count = np.shape(node["force"])[-1] if "force" in node else d
        directions = frames[:, :count]
        if axes is not None:
            directions = np.tile(np.eye(d)[[int(a) for a in axes]], (len(frames), 1, 1))
        node["directions"], node["is_contact"] = directions, int(node["law"] == "Contact")
        if "contact" in node:
            node["contact"] = {key: np.asarray(values)[None] for key, values in node["contact"].items()}
    if kind == "samples" or not any("displacement" in node for node in tree["substructures"].values()):
        tree["no_displacements"] = NO_FIELDS
    return tree


def _from_second(tree: Tree) -> Tree:
    """A file of version 2, whose points were on one facet of side 1 each, as one of today."""
    for node in tree["interfaces"].values():
        node["carrier"] = 0
        if "facets" in node:
            cells, row = np.unique(np.asarray(node["facets"]), axis=0, return_inverse=True)
            order = np.argsort(row.ravel(), kind="stable")
            starts = np.concatenate([[0], np.cumsum(np.bincount(row.ravel(), minlength=len(cells)))])
            weights = np.asarray(node["weights"], dtype=np.float64)
            node["facets"] = cells
            node["areas"] = {"values": weights[order], "points": order, "starts": starts}
    return tree


def _numbers(node: Any, what: str, dimensions: int | None = None) -> Array:
    data = np.asarray(node, dtype=np.float64)
    if dimensions is not None and data.ndim != dimensions:
        raise ValueError(f"{what}: {data.ndim} axes instead of {dimensions}")
    return data


def _optional(node: Tree, name: str) -> Array | None:
    return _numbers(node[name], name) if name in node else None


def _contact(node: Tree) -> ContactValues:
    clearance = _numbers(node["clearance"], "clearance", 3)
    return ContactValues(clearance, _optional(node, "friction"), _optional(node, "threshold"))


def _read_sides(node: Tree, points: Array, parts: Mapping[str, Any]) -> tuple[SavedSide, ...]:
    sides = []
    for text in node["sides"]:
        part, _, face = str(text).partition(":")
        sides.append(SavedSide(part, face))
    if "trace" in node:
        carrier = int(node["carrier"])
        columns = len(parts[sides[carrier].substructure].dof_coordinates)
        shape = _sparse(node["trace"], "nodes", len(points), columns)
        sides[carrier] = replace(sides[carrier], shape=shape)
        sides[0] = replace(sides[0], normal=_numbers(node["normal"], "normal", 1))
    return tuple(sides)


def _sparse(node: Tree, name: str, rows: int, columns: int) -> sp.csr_matrix:
    numbers = (_numbers(node["values"], "values", 1), node[name], node["starts"])
    matrix = sp.csr_matrix(numbers, shape=(rows, columns))
    matrix.check_format()
    return matrix


def _read_surface(node: Tree, side: SavedSide, points: int, parts: Mapping[str, Any]) -> _Surface | None:
    part = parts[side.substructure]
    if "facets" not in node or not hasattr(type(part), "facet_rows"):
        return None
    cells = np.array(node["facets"], dtype=np.int64)
    corners = nodal = None
    if "vertices" in node:
        corners = np.array(node["vertices"]["corners"], dtype=np.int64)
        nodal = _sparse(node["vertices"], "points", int(corners.max()) + 1, points)
    areas = _sparse(node["areas"], "points", len(cells), points)
    return _Surface(partial(part.facet_rows, side.face, cells), areas, corners, nodal)


def _read_interface(name: str, node: Tree, parts: Mapping[str, Any]) -> SavedInterface:
    points = _numbers(node["points"], f"{name}: points", 2)
    weights = _numbers(node["weights"], f"{name}: weights", 1)
    if len(points) != len(weights):
        raise ValueError(f"{name}: {len(points)} points and {len(weights)} weights")
    sides = _read_sides(node, points, parts)
    carrier = int(node.get("carrier", 0))
    bolt = int(node.get("bolt", -1))
    return SavedInterface(
        name,
        str(node["law"]),
        str(node["description"]),
        sides,
        points,
        weights,
        _numbers(node["frames"], f"{name}: frames", 3),
        _numbers(node["directions"], f"{name}: directions", 3),
        _optional(node, "force"),
        _optional(node, "jump"),
        bool(node["is_contact"]),
        _contact(node["contact"]) if "contact" in node else None,
        None if bolt < 0 else bolt,
        carrier,
        _optional(node, "wrench"),
        _optional(node, "places"),
        _optional(node, "mean_normals"),
        _read_surface(node, sides[carrier], len(points), parts),
    )


def _read_part(name: str, node: Tree, why: str) -> StoredPart | _Nodes:
    nodes = _numbers(node["nodes"], f"{name}: nodes", 2)
    for what in ("displacement", "deviation"):
        if what in node and _numbers(node[what], f"{name}: {what}").shape[-2:] != nodes.shape:
            raise ValueError(f"{name}: {what} of another shape than the nodes")
    if "points" in node:
        return _Points(name, nodes, int(node["points"]), np.array(node["turning"], dtype=np.int64))
    return StoredPart(name, node["mesh"], nodes) if "mesh" in node else _Nodes(name, nodes, why)


def _read(path: Path, tree: Tree) -> SavedResult:
    kind, statistics = str(tree["kind"]), str(tree["statistics"])
    if kind not in get_args(AnswerKind):
        raise ValueError(f"kind {kind!r}")
    if statistics not in get_args(Kind):
        raise ValueError(f"statistics {statistics!r}")
    why = str(tree.get("no_displacements", "it was saved by an older software: solve and save again"))
    parts = {name: _read_part(name, node, why) for name, node in tree["substructures"].items()}
    interfaces = {name: _read_interface(name, node, parts) for name, node in tree["interfaces"].items()}
    measured = {}
    for name, node in tree["interfaces"].items():
        if "measures" in node:
            values = {column: _numbers(v, f"{name}: {column}") for column, v in node["measures"].items()}
            centre = _numbers(node["centre"], f"{name}: centre", 1)
            measured[name] = Measures(centre, values, str(node["law"]), interfaces[name].bolt)
    plan = SavedPlan(str(tree["plan"]), _optional(tree, "times"), tuple(map(str, tree["active"])))
    problem = SavedProblem(str(tree["problem"]), parts, interfaces)
    chaos = chaos_file.from_tree(path, tree["chaos"]) if "chaos" in tree else None
    return SavedResult(path, tree, plan, problem, chaos, measured)
