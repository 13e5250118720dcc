r"""A chaos in a file, to be evaluated anywhere.

A file holds all that its evaluation needs: the three-term recurrences of the germs, the multi-indices and
the coefficients; and the maps between germs and physical parameters.  :class:`ChaosFile` evaluates it with
NumPy alone; ``docs/chaos_file.md`` shows how other programs do.

L is the number of independent random variables (germs), P + 1 the number of modes, n - 1 the greatest
degree of a germ. Numbers are float64, indices int64; arrays are row-major; all values are finite.

``format``
    text; ``latin-chaos``
``version``
    integer; 1; a reader refuses versions that it does not know
``checksum``
    text; SHA-256 of the content, see below
``meta``
    text; a JSON object: ``order`` (greatest total degree), ``software``, and what the writer added
``germs/names``
    L texts; names of the germs
``germs/families``
    L texts; for information: ``hermite`` (standard normal), ``legendre`` (uniform on [-1, 1]),
    ``laguerre(a)`` (gamma with shape a, scale 1), ``jacobi(a, b)`` (beta(a, b) stretched to [-1, 1]), or
    a description of any other distribution
``germs/alpha``, ``germs/beta``
    (L, n); recurrence of the orthonormal polynomials of each germ
``indices``
    (P + 1, L); degree of each germ in each mode; row 0 is zero and belongs to the mean
``groups/NAME``
    integers; germs of each independent random source, for Sobol indices
``parameters/NAME``
    group; a physical parameter or random field, see below
``fields/NAME/coefficients``
    (rows, P + 1); chaos coefficients
``fields/NAME/shape``
    integers; shape of one realisation; its product is ``rows``
``fields/NAME/unit``, ``description``
    text

In HDF5 texts and integers are attributes, arrays and lists contiguous datasets, everything else groups;
in link names ``%`` is ``%25``, ``/`` is ``%2F``, and in a name of dots only ``.`` is ``%2E``. The 512
bytes before the HDF5 part begin with ``latin-chaos sha256 HEX``, the checksum of everything after them.
In JSON the tree is nested objects.

**Physical parameters**

``parameters/NAME`` describes how a parameter is computed from the germs:

``germs``
    (r) numbers of the germs on which it depends
``offset``, ``matrix``
    (rows), (rows, r): a = offset + matrix x, x the values of these germs
``map``
    ``affine``: the value is a; ``exponential``: exp(a); ``table``: linear interpolation
``argument``, ``value``
    (s) for a table only: ascending; the map is constant beyond the ends
``mean``
    (rows) expectation

A parameter has one row; a random field one per point of its interface. All maps can be inverted:
``load_chaos(path).germ_points({"k": 90.0, "K": 5.2e4})``. A table has 4 097 rows, for normal scores from
-8 to 8.

**Checksum**

SHA-256 over all leaves of the tree but ``format``, ``version`` and ``checksum``, depth first with sorted
keys. An array adds ``PATH TYPE SHAPE LENGTH\n`` and its little-endian bytes (TYPE ``<i8`` or ``<f8``,
SHAPE as Python prints a tuple, LENGTH in bytes), a text or a list of texts ``PATH LENGTH\n`` and its JSON
form in ASCII. PATH is ``/key/key``, percent-encoded as UTF-8 except for letters, digits and ``_.-~/``. A
reader may skip this check.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
from latin_core.stochastic import ChaosBasis

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    check_optional_kind,
    checked_numbers,
    checked_path,
    checked_reals,
)
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import OBJECTS, opened, replaced, shown
from dolfinx_frontend.common.frozen import frozen, locked
from dolfinx_frontend.formats.hdf5 import (
    DAMAGE,
    ChaosFileError,
    Tree,
    LayoutError,
    h5py_module,
    inside,
    placed,
    read_tree,
    write_tree,
)
from dolfinx_frontend.uncertainty.checks import common_length
from dolfinx_frontend.uncertainty.parameters import RandomParameter
from dolfinx_frontend.uncertainty.space import RandomSpace, Sobol

__all__ = ["ChaosFile", "Field", "ParameterMap", "load_chaos", "save_chaos"]

Map = Literal["affine", "exponential", "table"]

FORMAT = "latin-chaos"

VERSION = 1


@dataclass(frozen=True, eq=False)
class Field:
    """A field with one column a chaos mode.

    Attributes
    ----------
    coefficients
        (rows, P + 1).
    unit, description
        For the reader.
    shape
        Of one realisation of the field, row-major, with `rows` entries; default (rows,).
    """

    coefficients: Array
    unit: str = ""
    shape: tuple[int, ...] | None = None
    description: str = ""

    def __post_init__(self) -> None:
        checked_reals("Field", "coefficients", self.coefficients, "give numbers (rows, P + 1)")
        object.__setattr__(self, "coefficients", frozen(np.asarray(self.coefficients)))


@dataclass(frozen=True, eq=False)
class ParameterMap:
    """How a physical parameter (one row) or random field (one row per point) follows from its germs.

    With a = offset + matrix @ germs: ``"affine"``: the value is a; ``"exponential"``: exp(a);
    ``"table"``: linear interpolation of `value` over `argument`, both ascending.
    """

    map: Map
    germs: tuple[int, ...]
    offset: Array  # (rows,)
    matrix: Array  # (rows, len(germs))
    mean: Array  # (rows,)
    argument: Array | None = None  # (n,)
    value: Array | None = None  # (n,)

    def __post_init__(self) -> None:
        for name in ("offset", "matrix", "mean", "argument", "value"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def at(self, germ_points: Array) -> Array:
        """Values (rows, N) at points (N, L)."""
        a: Array = self.offset[:, None] + self.matrix @ germ_points[:, list(self.germs)].T
        if self.map == "exponential":
            a = np.asarray(np.exp(a))
        elif self.argument is not None and self.value is not None:
            a = np.asarray(np.interp(a, self.argument, self.value))
        return a

    def score(self, values: Array) -> Array:
        """matrix @ germs for values (N,) of a parameter with one row; NaN if out of range."""
        argument = values
        if self.map == "exponential":
            with np.errstate(invalid="ignore", divide="ignore"):
                argument = np.log(values)
        elif self.argument is not None and self.value is not None:
            argument = np.asarray(
                np.interp(values, self.value, self.argument, left=np.nan, right=np.nan)
            )
        score: Array = argument - self.offset[0]
        return score


# ---------------------------------------------------------------------------------------------
# What is in the file
# ---------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False, repr=False)
class ChaosFile:
    """A chaos read from a file.

    Attributes
    ----------
    path
        Where it came from.
    germ_names, germ_families
        (L,) what the germs are called, and their polynomials in words.
    alpha, beta
        (L, n) recurrence x psi_k = beta_k+1 psi_k+1 + alpha_k psi_k + beta_k psi_k-1 of each germ.
    indices
        (P + 1, L) degrees of the modes; row 0 is the mean.
    groups
        Independent random source -> its germs.
    parameters
        Physical parameters and random fields.
    fields
        Fields by name.
    meta
        What was said on saving, with ``order`` and ``software``.
    """

    path: Path
    germ_names: tuple[str, ...]
    germ_families: tuple[str, ...]
    alpha: Array
    beta: Array
    indices: npt.NDArray[np.int64]
    groups: dict[str, tuple[int, ...]]
    parameters: dict[str, ParameterMap]
    fields: dict[str, Field]
    meta: dict[str, Any]

    def __post_init__(self) -> None:
        locked(self)

    @property
    def dimension(self) -> int:
        """L, the number of germs."""
        return len(self.germ_names)

    def __repr__(self) -> str:
        return (
            f"<ChaosFile {self.path}: {len(self.fields)} fields on {len(self.indices)} modes of "
            f"{', '.join(self.germ_names)}>"
        )

    def _field(self, name: str) -> tuple[Array, tuple[int, ...]]:
        check_known("field", name, self.fields, str(self.path))
        found = self.fields[name]
        rows = len(found.coefficients)
        return found.coefficients, (rows,) if found.shape is None else found.shape

    def _checked_points(self, germ_points: npt.ArrayLike) -> Array:
        """Points (N, L) of the germs."""
        wanted = "give points of finite numbers, one row each"
        xi = np.atleast_2d(checked_numbers(str(self.path), "germ_points", germ_points, wanted))
        if xi.ndim != 2 or xi.shape[1] != self.dimension:
            raise SceneError(
                f"{self.path}: points have {xi.shape[-1]} coordinates, the chaos has "
                f"{self.dimension} germs: {', '.join(self.germ_names)}"
            )
        return xi

    def modes(self, germ_points: npt.ArrayLike) -> Array:
        """All modes at points (N, L): (N, P + 1)."""
        xi = self._checked_points(germ_points)
        psi = np.ones((len(xi), len(self.indices)))
        for germ in range(self.dimension):
            degrees = self.indices[:, germ]
            x, a, b = xi[:, germ], self.alpha[germ], self.beta[germ]
            line = np.ones((len(xi), int(degrees.max()) + 1))
            for k in range(line.shape[1] - 1):
                line[:, k + 1] = (x - a[k]) * line[:, k]
                if k:
                    line[:, k + 1] -= b[k] * line[:, k - 1]
                line[:, k + 1] /= b[k + 1]
            psi *= line[:, degrees]
        return psi

    def evaluate(self, name: str, germ_points: npt.ArrayLike) -> Array:
        """A field at points (N, L) of the germs: (N, *shape)."""
        coefficients, shape = self._field(name)
        psi = self.modes(germ_points)
        return np.reshape(psi @ coefficients.T, (len(psi), *shape))

    def mean(self, name: str) -> Array:
        """Expectation of a field, its shape."""
        coefficients, shape = self._field(name)
        return coefficients[:, 0].reshape(shape)

    def std(self, name: str) -> Array:
        """Standard deviation of a field, its shape."""
        coefficients, shape = self._field(name)
        deviation: Array = np.sqrt(np.sum(coefficients[:, 1:] ** 2, axis=1))
        return deviation.reshape(shape)

    def sobol(self, name: str) -> dict[str, Sobol]:
        """Sobol indices of a field, its shape, by source; NaN where there is no variance."""
        coefficients, shape = self._field(name)
        squares = coefficients[:, 1:] ** 2
        present = self.indices[1:] > 0
        variance = squares.sum(axis=1)
        result = {}
        for source, columns in self.groups.items():
            inside = present[:, list(columns)].any(axis=1)
            alone = inside & ~np.delete(present, list(columns), axis=1).any(axis=1)
            with np.errstate(invalid="ignore", divide="ignore"):
                first, total = (squares[:, m].sum(axis=1) / variance for m in (alone, inside))
            result[source] = Sobol(first.reshape(shape), total.reshape(shape))
        return result

    def parameter(self, name: str, germ_points: npt.ArrayLike) -> Array:
        """A physical parameter (N,), or random field (N, points), at points (N, L) of the germs."""
        check_known("parameter", name, self.parameters, str(self.path))
        found = self.parameters[name]
        values = found.at(self._checked_points(germ_points)).T
        return values[:, 0] if len(found.offset) == 1 else values

    def germ_points(self, values: Mapping[str, npt.ArrayLike]) -> Array:
        """Points (N, L) for values of parameters, (N,) or one for all; the others at their mean.

        The germs of random fields are 0.

        Raises
        ------
        SceneError
            An unknown name, a random field, different lengths, or a value that the parameter
            cannot take.
        """
        numbers = {n: p for n, p in self.parameters.items() if len(p.offset) == 1}
        given = {}
        check_kind(str(self.path), "values", values, Mapping, "give {parameter: values}")
        for name, value in values.items():
            check_known("parameter", name, numbers, str(self.path))
            where = f"{self.path}: parameter {name!r}"
            given[name] = np.atleast_1d(checked_numbers(where, "value", value, "give one number per point"))
        count = common_length(given, f"{self.path}: ")
        points = np.zeros((count, self.dimension))
        matrix = np.zeros((len(numbers), self.dimension))
        scores = np.empty((len(numbers), count))
        for row, (name, found) in enumerate(numbers.items()):
            matrix[row, list(found.germs)] = found.matrix[0]
            scores[row] = found.score(given.get(name, found.mean))
            if not np.isfinite(scores[row]).all():
                raise SceneError(f"{self.path}: parameter {name!r} cannot take the values given")
        used = np.flatnonzero(matrix.any(axis=0))
        # square, and triangular in each correlated group
        points[:, used] = np.linalg.solve(matrix[:, used], scores).T
        return points


# ---------------------------------------------------------------------------------------------
# The tree that both formats hold
# ---------------------------------------------------------------------------------------------
def _parameter_maps(space: RandomSpace) -> Iterator[tuple[str, Tree]]:
    for block in space._blocks:
        columns = np.array(block.columns, dtype=np.int64)
        if block.field is not None:
            r = len(columns)
            ends = np.asarray(block.field.value(np.vstack([np.zeros(r), np.eye(r)])))
            kind: Map = "affine" if block.field.affine else "exponential"
            argument = ends if block.field.affine else np.log(ends)
            yield block.name, {
                "map": kind,
                "germs": columns,
                "offset": argument[:, 0],
                "matrix": argument[:, 1:] - argument[:, :1],
                "mean": np.full(len(ends), block.field.mean),
            }
            continue
        for position, member in enumerate(block.members):
            shape = one_dimensional(member)
            scale = float(shape.pop("scale"))
            yield member.name, {
                **shape,
                "germs": columns,
                "matrix": scale * block.mixing[position : position + 1],
                "mean": np.array([member.mean]),
            }


def one_dimensional(parameter: RandomParameter) -> Tree:
    """map, offset, scale (and table) of a parameter over its germ or normal score."""
    unit = parameter.value(np.array([0.0, 1.0]))
    if parameter.affine:
        return {"map": "affine", "offset": unit[:1], "scale": unit[1] - unit[0]}
    # the others are monotone functions of a normal score
    score = np.linspace(-8.0, 8.0, 4097)
    value = parameter.value(score)
    straight = unit[0] + (unit[1] - unit[0]) * score
    if np.allclose(value, straight, rtol=0.0, atol=1e-13 * np.abs(value).max()):
        return {"map": "affine", "offset": unit[:1], "scale": unit[1] - unit[0]}
    if value[0] > 0.0:
        logs = np.log(unit)
        straight = logs[0] + (logs[1] - logs[0]) * score
        if np.allclose(np.log(value), straight, rtol=0.0, atol=1e-11):
            return {"map": "exponential", "offset": logs[:1], "scale": logs[1] - logs[0]}
    keep = np.isfinite(value)
    return {
        "map": "table",
        "offset": np.zeros(1),
        "scale": 1.0,
        "argument": score[keep],
        "value": value[keep],
    }


def software() -> str:
    """What writes a file."""
    try:
        return f"latin-core {metadata.version('latin-core')}"
    except metadata.PackageNotFoundError:
        return "latin-core"


def _stored_fields(fields: Mapping[str, Field], modes: int) -> Tree:
    """Fields whose coefficients (rows, modes) fit and are finite, as they are stored."""
    stored = {}
    for name, given in fields.items():
        block = np.asarray(given.coefficients, dtype=np.float64)
        where = f"field {name!r}"
        if not isinstance(name, str) or not name:
            raise ChaosFileError(f"{where}: a field needs a name in words")
        if block.ndim != 2 or block.shape[1] != modes or len(block) == 0:
            raise ChaosFileError(
                f"{where}: coefficients of shape {block.shape}; wanted (rows, {modes}), one "
                "column per mode"
            )
        shape = (len(block),) if given.shape is None else tuple(int(s) for s in given.shape)
        if math.prod(shape) != len(block) or min(shape, default=1) < 0:
            raise ChaosFileError(f"{where}: shape {shape} does not have {len(block)} entries")
        if not np.isfinite(block).all():
            raise ChaosFileError(f"{where}: some coefficients are not finite; leave them out")
        stored[name] = {
            "unit": str(given.unit),
            "description": str(given.description),
            "shape": np.array(shape, dtype=np.int64),
            "coefficients": block,
        }
    return stored


def _tree(
    space: RandomSpace, basis: ChaosBasis, fields: Mapping[str, Field], meta: Mapping[str, Any]
) -> Tree:
    table = basis.indices.table.astype(np.int64)
    if table.shape[1] != space.dimension:
        raise ChaosFileError(
            f"the basis has {table.shape[1]} germs, the random space has {space.dimension}"
        )
    length = int(table.max(initial=0)) + 1
    alpha, beta = np.zeros((2, len(space.germs), length))
    for row, germ in enumerate(space.germs):
        # a germ of low degree may have no more polynomials than those
        own = int(table[:, row].max()) + 1
        alpha[row, :own], beta[row, :own] = germ.recurrence(own)
        beta[row, own:] = 1.0
    described = {"order": int(table.sum(axis=1).max()), "software": software(), **meta}
    try:
        text = json.dumps(described, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError) as error:
        raise ChaosFileError(f"meta must be made of words, numbers and lists: {error}") from error
    return {
        "meta": text,
        "germs": {
            "names": list(space.germ_names),
            "families": [str(germ) for germ in space.germs],
            "alpha": alpha,
            "beta": beta,
        },
        "groups": {n: np.array(c, dtype=np.int64) for n, c in space.groups.items()},
        "parameters": dict(_parameter_maps(space)),
        "indices": table,
        "fields": _stored_fields(fields, len(table)),
    }


def _checksum(tree: Tree) -> str:
    """SHA-256 over the content, the same for both formats."""
    digest = hashlib.sha256()

    def feed(path: str, node: Any) -> None:
        if isinstance(node, dict):
            for key in sorted(node):
                feed(f"{path}/{quote(key)}", node[key])
            return
        if isinstance(node, np.ndarray):
            kind = "<i8" if node.dtype.kind == "i" else "<f8"
            content = np.ascontiguousarray(node, dtype=kind).tobytes()
            head = f"{path} {kind} {node.shape}"
        else:
            content = json.dumps(node).encode()
            head = path
        digest.update(f"{head} {len(content)}\n".encode())
        digest.update(content)

    feed("", tree)
    return digest.hexdigest()


# ---------------------------------------------------------------------------------------------
# The two formats
# ---------------------------------------------------------------------------------------------
def _plain(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: _plain(value) for key, value in node.items()}
    return node.tolist() if isinstance(node, np.ndarray) else node


def _write_json(path: Path, tree: Tree, checksum: str) -> None:
    head = {"format": FORMAT, "version": VERSION, "checksum": checksum}
    with path.open("w", encoding="utf-8") as file:
        json.dump({**head, **_plain(tree)}, file, allow_nan=False)


def _read_json(path: Path) -> Tree:
    with opened(path, OBJECTS, ChaosFileError) as file:
        content = json.load(file)
    if not isinstance(content, dict):
        raise ValueError("no chaos file")
    tree: Tree = placed(content)
    return tree


def _write_hdf5(path: Path, tree: Tree, checksum: str) -> None:
    write_tree(path, {"format": FORMAT, "version": VERSION, "checksum": checksum}, tree)


def _read_hdf5(path: Path) -> Tree:
    return read_tree(path, FORMAT, ChaosFileError)


_WRITERS: dict[str, Callable[[Path, Tree, str], None]] = {
    ".json": _write_json,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
}

_READERS: dict[str, Callable[[Path], Tree]] = {
    ".json": _read_json,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
}


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise ChaosFileError(
            f"{shown(path)}: the suffix tells the format: {', '.join(_WRITERS)}; not {path.suffix!r}"
        )
    return suffix


def content(
    space: RandomSpace, basis: ChaosBasis, fields: Mapping[str, Field], meta: Mapping[str, Any]
) -> Tree:
    """All of a chaos file as nested dicts, to be part of another file."""
    tree = _tree(space, basis, fields, meta)
    return {"format": FORMAT, "version": VERSION, "checksum": _checksum(tree), **tree}


def with_fields(tree: Tree, fields: Mapping[str, Field]) -> Tree:
    """What :func:`content` made, with other fields; their coefficients fit its modes."""
    plain = {key: each for key, each in tree.items() if key not in ("format", "version", "checksum")}
    plain["fields"] = _stored_fields(fields, len(plain["indices"]))
    return {"format": FORMAT, "version": VERSION, "checksum": _checksum(plain), **plain}


def from_tree(path: Path, tree: Tree) -> ChaosFile:
    """A chaos from what :func:`content` made.

    Raises
    ------
    LayoutError
        It is damaged or of another version.
    """
    with inside("chaos"):
        if tree["format"] != FORMAT or int(tree["version"]) != VERSION:
            raise ValueError(f"it has version {tree['version']}, known is {VERSION}")
        return _read(path, tree)


def save_chaos(
    path: str | Path,
    space: RandomSpace,
    basis: ChaosBasis,
    fields: Mapping[str, Field],
    meta: Mapping[str, Any] | None = None,
) -> None:
    """Write a chaos; a file of that name is replaced when the new one is complete on the disk.

    Parameters
    ----------
    path
        ``.h5`` or ``.hdf5`` (needs h5py), or ``.json``.
    space, basis
        Germs and modes of the coefficients.
    fields
        Fields by name.
    meta
        What else should be known: words, numbers, lists.

    Raises
    ------
    ChaosFileError
        Another suffix, fields that do not fit the basis or are not finite, a folder that does not
        exist or cannot be written to.  An existing file is then as it was.
    """
    target = checked_path("save_chaos", path)
    check_kind("save_chaos", "space", space, RandomSpace, "give the germs, e.g. result.space")
    check_kind("save_chaos", "basis", basis, ChaosBasis, "give the modes, e.g. result.basis")
    check_kind("save_chaos", "fields", fields, Mapping, "give {name: Field}")
    for name, field_ in fields.items():
        check_kind("save_chaos", f"fields[{name!r}]", field_, Field, "give a Field")
    check_optional_kind("save_chaos", "meta", meta, Mapping, "give {name: words, numbers or lists}")
    suffix = _suffix(target)
    tree = _tree(space, basis, fields, meta or {})
    with replaced(target, ChaosFileError) as temporary:
        _WRITERS[suffix](temporary, tree, _checksum(tree))


# ---------------------------------------------------------------------------------------------
# Reading
# ---------------------------------------------------------------------------------------------
def _numbers(node: Any, what: str, *shape: int | None) -> Array:
    """Finite numbers of a shape; None: any length."""
    try:
        array = np.array(node, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: wanted numbers") from error
    if array.size == 0 and None not in shape and 0 in shape:
        array = array.reshape([s or 0 for s in shape])
    fits = array.ndim == len(shape) and all(
        wanted is None or wanted == size for wanted, size in zip(shape, array.shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        raise ValueError(f"{what}: shape {array.shape}, or not finite")
    return array


def _integers(node: Any, what: str, *shape: int | None, below: int = 2**31) -> Any:
    array = _numbers(node, what, *shape)
    if (array != np.floor(array)).any() or (array < 0).any() or (array >= below).any():
        raise ValueError(f"{what}: wanted whole numbers from 0 to {below - 1}")
    return array.astype(np.int64)


def _words(node: Any, what: str, length: int | None = None) -> list[str]:
    if not isinstance(node, list) or not all(isinstance(word, str) for word in node):
        raise ValueError(f"{what}: wanted a list of words")
    if length is not None and len(node) != length:
        raise ValueError(f"{what}: {len(node)} instead of {length}")
    return node


def _read_parameter(node: Tree, name: str, dimension: int) -> ParameterMap:
    if node["map"] not in get_args(Map):
        raise ValueError(f"parameter {name!r}: unknown map {node['map']!r}")
    germs = _integers(node["germs"], f"{name}: germs", None, below=dimension)
    offset = _numbers(node["offset"], f"{name}: offset", None)
    rows = len(offset)
    argument = value = None
    if node["map"] == "table":
        argument = _numbers(node["argument"], f"{name}: argument", None)
        value = _numbers(node["value"], f"{name}: value", len(argument))
        if len(value) < 2 or (np.diff(argument) <= 0.0).any() or (np.diff(value) < 0.0).any():
            raise ValueError(f"parameter {name!r}: the table does not ascend")
    return ParameterMap(
        node["map"],
        tuple(germs.tolist()),
        offset,
        _numbers(node["matrix"], f"{name}: matrix", rows, len(germs)),
        _numbers(node["mean"], f"{name}: mean", rows),
        argument,
        value,
    )


def _read(path: Path, node: Tree) -> ChaosFile:
    germs = node["germs"]
    names = _words(germs["names"], "germ names")
    dimension = len(names)
    families = _words(germs["families"], "germ families", dimension)
    indices = _integers(node["indices"], "indices", None, dimension)
    if len(indices) == 0 or indices[0].any():
        raise ValueError("indices: the first mode is not the mean")
    length = int(indices.max(initial=0)) + 1
    alpha = _numbers(germs["alpha"], "alpha", dimension, length)
    beta = _numbers(germs["beta"], "beta", dimension, length)
    if (beta[:, 1:] <= 0.0).any():
        raise ValueError("beta: not positive")
    fields = {}
    for name, part in node["fields"].items():
        coefficients = _numbers(part["coefficients"], f"field {name!r}", None, len(indices))
        shape = tuple(_integers(part["shape"], f"{name}: shape", None).tolist())
        if math.prod(shape) != len(coefficients):
            raise ValueError(f"field {name!r}: shape {shape} for {len(coefficients)} rows")
        unit, description = _words([part["unit"], part["description"]], f"field {name!r}")
        fields[name] = Field(coefficients, unit, shape, description)
    groups = {
        name: tuple(_integers(columns, f"group {name!r}", None, below=dimension).tolist())
        for name, columns in node["groups"].items()
    }
    parameters = {n: _read_parameter(p, n, dimension) for n, p in node["parameters"].items()}
    meta = json.loads(node["meta"])
    if not isinstance(meta, dict):
        raise ValueError("meta: not a table")
    result = ChaosFile(
        path, tuple(names), tuple(families), alpha, beta, indices, groups, parameters, fields, meta
    )
    if _checksum(_content(node["meta"], result)) != node["checksum"]:
        raise ValueError("the checksum is another one: some number changed")
    return result


def _content(meta: str, file: ChaosFile) -> Tree:
    """The tree of a file, for its checksum."""

    def parameter(p: ParameterMap) -> Tree:
        tree: Tree = {
            "map": p.map,
            "germs": np.array(p.germs, dtype=np.int64),
            "offset": p.offset,
            "matrix": p.matrix,
            "mean": p.mean,
        }
        if p.map == "table":
            tree |= {"argument": p.argument, "value": p.value}
        return tree

    return {
        "meta": meta,
        "germs": {
            "names": list(file.germ_names),
            "families": list(file.germ_families),
            "alpha": file.alpha,
            "beta": file.beta,
        },
        "groups": {n: np.array(c, dtype=np.int64) for n, c in file.groups.items()},
        "parameters": {n: parameter(p) for n, p in file.parameters.items()},
        "indices": file.indices,
        "fields": {
            n: {
                "unit": f.unit,
                "description": f.description,
                "shape": np.array(f.shape, dtype=np.int64),
                "coefficients": f.coefficients,
            }
            for n, f in file.fields.items()
        },
    }


def load_chaos(path: str | Path) -> ChaosFile:
    """Read a chaos file and check all of it.

    Raises
    ------
    ChaosFileError
        The file does not exist, is no chaos file, is of a newer version, truncated or damaged.
    """
    source = checked_path("load_chaos", path)
    suffix = _suffix(source)
    name = shown(source)
    if suffix != ".json":
        h5py_module()
    try:
        node = _READERS[suffix](source)
        marked = node.get("format") == FORMAT
        version = int(node["version"]) if marked else 0
    except ChaosFileError:
        raise
    except DAMAGE as error:
        raise ChaosFileError(
            f"{name} cannot be read ({error}): it is truncated, damaged or no chaos file; save "
            "it again"
        ) from error
    if not marked:
        raise ChaosFileError(f"{name} is no chaos file: give a file written by save_chaos")
    if version != VERSION:
        raise ChaosFileError(
            f"{name} is a chaos file of version {version}; this software reads version "
            f"{VERSION}: use the software that wrote it, or a newer one"
        )
    try:
        return _read(source, node)
    except LayoutError as error:
        raise ChaosFileError(f"{name} is damaged or was edited: {error}; save it again") from error
    except DAMAGE as error:
        raise ChaosFileError(
            f"{name} is damaged ({type(error).__name__}: {error}); save it again"
        ) from error
