"""Matrices that other programs write: ``lf.read_matrix``.

All formats become rows with a label (a node and a component, 1 to 6) and the entries of a matrix; then
points are looked up by their labels.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_optional_kind, checked_numbers, checked_path
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.decks.fields import Where, real
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.nastran.bulk import BulkCard, bulk_cards, grids, text_lines
from dolfinx_frontend.scene.matrix import Matrix

__all__ = ["read_matrix"]

Line = tuple[Where, str]
_COUNT = re.compile(r"NODES\s*=\s*(\d+)", re.IGNORECASE)


class _Found(NamedTuple):
    """A matrix as a file has it.

    Attributes
    ----------
    labels
        Rows: (node, component); None: the file tells none.
    matrix
        Square, with both halves.
    places
        Node -> coordinates, as far as the file has them.
    """

    labels: list[tuple[int, int]] | None
    matrix: sp.csr_matrix
    places: dict[int, Array]


def read_matrix(
    path: str | Path,
    points: Mapping[int, Sequence[float]] | Any = None,
    *,
    name: str | None = None,
    faces: Mapping[str, Any] | None = None,
    loads: Mapping[str, Any] | None = None,
) -> Matrix:
    """A stiffness matrix that another program has reduced.

    Parameters
    ----------
    path
        ``.mtx``: of Abaqus (``*SUBSTRUCTURE MATRIX OUTPUT``, ``OUTPUT FILE=USER DEFINED``) or CalculiX.
        ``.pch``, ``.dmig``, ``.bdf``: DMIG cards of Nastran. ``.op4``: OUTPUT4 of Nastran, as text.
    points
        Node -> coordinates (2 or 3 numbers, length); or coordinates (m, 2) or (m, 3) in the order of the
        nodes in the file, of DMIG in the order of their numbers; None: the GRID cards of the file.
    name
        Of the matrix, where a file has several; None: the one whose name begins with K.
    faces
        Name -> nodes by their numbers in the file (by row from 0, where it has none); None: ``"points"``,
        all.
    loads
        As of :class:`Matrix`: forces by the rows of the file's matrix.

    Returns
    -------
    Matrix
        With the points in the order of the nodes in the file.

    Raises
    ------
    DeckError
        What cannot be read, with file and line.
    SceneError
        A matrix that is no stiffness.
    """
    where = Path(checked_path("read_matrix", path))
    check_optional_kind("read_matrix", "faces", faces, Mapping, "give {name: nodes}")
    read = _READERS.get(where.suffix.lower())
    if read is None:
        raise DeckError(
            f"{where.name}: an ending {where.suffix!r} is not known; matrices are read from "
            f"{', '.join(_READERS)}; of Ansys (.sub, .full) export it as text, *DMAT or *SMAT and *EXPORT "
            "with MMF, and give lf.Matrix(scipy.io.mmread(file), points)"
        )
    return _made(where.name, read(where, name), points, faces, loads)


def _made(
    file: str, found: _Found, points: Any, faces: Mapping[str, Any] | None, loads: Mapping[str, Any] | None
) -> Matrix:
    """The part, from the rows of a file."""
    if found.labels is None:
        given = checked_numbers("read_matrix", "points", points, "give coordinates (m, 2) or (m, 3)", 2)
        return Matrix(found.matrix, given, loads, faces)
    nodes = list(dict.fromkeys(node for node, _ in found.labels))
    x = _coordinates(file, nodes, points, found.places)
    d = x.shape[1]
    moves, turns = tuple(range(1, d + 1)), (4, 5, 6) if d == 3 else (6,)
    own: dict[int, list[int]] = {node: [] for node in nodes}
    for node, component in found.labels:
        own[node].append(component)
    turning = [k for k, node in enumerate(nodes) if set(own[node]) & set(turns)]
    rows: list[tuple[int, int]] = []
    for k, node in enumerate(nodes):
        wanted = moves + turns if k in set(turning) else moves
        if sorted(own[node]) != list(wanted):
            raise DeckError(
                f"{file}: node {node} has the components {', '.join(map(str, sorted(own[node])))}; a point "
                "has "
                f"{', '.join(map(str, moves))}, and all of its rotations {', '.join(map(str, turns))} or "
                "none: retain these when the part is reduced"
            )
        rows += [(node, component) for component in wanted]
    number = {label: k for k, label in enumerate(found.labels)}
    order = np.array([number[label] for label in rows])
    at = {node: k for k, node in enumerate(nodes)}

    def index(name: str, node: Any) -> int:
        if node not in at:
            raise DeckError(f"{file}: face {name!r}: node {short(node)} is none of the matrix")
        return at[node]

    named = None
    if faces is not None:
        named = {name: [index(name, n) for n in np.atleast_1d(some).tolist()] for name, some in faces.items()}
    forces = {}
    for name, each in (loads or {}).items():
        forces[name] = np.asarray(each)[order] if np.shape(each) == order.shape else each
    return Matrix(found.matrix[order][:, order], x, forces, named, rotations=turning or None)


def _coordinates(file: str, nodes: Sequence[int], points: Any, places: Mapping[int, Array]) -> Array:
    """(m, d)."""
    if points is None or isinstance(points, Mapping):
        known: Mapping[int, Any] = places if points is None else points
        missing = [node for node in nodes if node not in known]
        if missing:
            raise DeckError(
                f"{file}: no coordinates of node {missing[0]}, and of {len(missing) - 1} others; give points="
                "{node: (x, y, z)}"
            )
        points = [list(known[node]) for node in nodes]
    x = checked_numbers("read_matrix", "points", points, "give coordinates (m, 2) or (m, 3)", 2)
    if len(x) != len(nodes):
        raise DeckError(f"{file}: {len(x)} points are given, the matrix has {len(nodes)} nodes")
    return x


# --- Abaqus and CalculiX -----------------------------------------------------------------------------
def _read_mtx(path: Path, name: str | None) -> _Found:
    """A linear user element: its nodes in a comment, components by position, and one half of the matrix."""
    count, nodes, kind = 0, list[int](), ""
    components: dict[int, list[int]] = {}
    values: dict[str, list[float]] = {}
    expected, last = "", Where(path.name, 1)
    for where, line in text_lines(path):
        row = line.strip().upper()
        last = where
        if row.startswith("**"):
            words = row.lstrip("*").replace(",", " ").split()
            if words[:2] == ["ELEMENT", "NODES"]:
                expected, words = "nodes", words[2:]
            if expected == "nodes" and words and all(word.isdigit() for word in words):
                nodes += map(int, words)
        elif row.startswith("*USER ELEMENT"):
            of = _COUNT.search(row)
            if of is None or "UNSYMM" in row:
                raise DeckError(f"{where}: a user element without NODES=, or unsymmetric: {row[:40]!r}")
            count, expected = int(of[1]), "components"
        elif row.startswith("*MATRIX"):
            kind = row.partition("TYPE=")[2].partition(",")[0].strip()
            values[kind] = []
            expected = "values"
        elif row.startswith("*"):
            expected = ""
        elif expected == "values":
            values[kind] += _reals(where, row.replace(",", " ").split())
        elif expected and row:
            _components(where, row, components)
    if name is not None and name.upper() not in values:
        raise DeckError(f"{path.name}: no matrix {name!r}; it has {', '.join(values) or 'none'}")
    entries = values.get(name.upper() if name is not None else "STIFFNESS")
    if entries is None:
        raise DeckError(f"{last}: no *MATRIX, TYPE=STIFFNESS; write it with *SUBSTRUCTURE MATRIX OUTPUT")
    if len(nodes) != count or not components:
        raise DeckError(f"{path.name}: {count} nodes, of which {len(nodes)} are named under ** ELEMENT NODES")
    labels = []
    for k, node in enumerate(nodes):
        before = max((p for p in components if p <= k + 1), default=1)
        labels += [(node, c) for c in components.get(before, [])]
    n = len(labels)
    if len(entries) != n * (n + 1) // 2:
        raise DeckError(
            f"{path.name}: {len(entries)} entries, and one half of a matrix with {n} rows has "
            f"{n * (n + 1) // 2}"
        )
    if len(set(labels)) < n:
        raise DeckError(f"{path.name}: a component of a node is there twice")
    full = np.zeros((n, n))
    full[np.tril_indices(n)] = entries
    return _Found(labels, sp.csr_matrix(full + np.tril(full, -1).T), {})


def _components(where: Where, row: str, components: dict[int, list[int]]) -> None:
    """``1, 2, 3``: of the first node and those after it; ``5, 1, 2``: from the fifth on."""
    words = [word.strip() for word in row.split(",") if word.strip()]
    if not all(word.isdigit() for word in words):
        raise DeckError(f"{where}: components of a node are whole numbers, not {row[:40]!r}")
    numbers = [int(word) for word in words]
    position, own = (1, numbers) if not components else (numbers[0], numbers[1:])
    components[position] = own


def _reals(where: Where, words: Iterable[str], what: str = "number") -> list[float]:
    out = []
    for word in words:
        value = real(word)
        if value is None:
            raise DeckError(f"{where}: {word[:40]!r} is no {what}")
        out.append(value)
    return out


# --- Nastran -----------------------------------------------------------------------------------------
@dataclass
class _Dmig:
    """A matrix as its cards come."""

    header: BulkCard
    form: int
    rows: list[tuple[int, int]]
    columns: list[tuple[int, int]]
    values: list[float]


def _read_dmig(path: Path, name: str | None) -> _Found:
    """DMIG cards, and GRID cards beside them."""
    lines = list(text_lines(path))
    begin = next((k for k, (_, line) in enumerate(lines) if line.strip().upper().startswith("BEGIN")), -1)
    cards = list(bulk_cards(lines[begin + 1 :]))
    found: dict[str, _Dmig] = {}
    for card in cards:
        if card.name == "DMIG":
            _add_dmig(card, found)
    chosen = found[_chosen(path.name, {n: d.form in (1, 6) for n, d in found.items()}, name)]
    labels = sorted({*chosen.rows, *chosen.columns})
    at = {label: k for k, label in enumerate(labels)}
    i, j = (np.array([at[label] for label in side], dtype=np.int64) for side in (chosen.rows, chosen.columns))
    matrix = sp.csr_matrix((np.array(chosen.values), (i, j)), shape=(len(labels),) * 2)
    return _Found(labels, _whole(matrix) if chosen.form == 6 else matrix, grids(cards))


def _add_dmig(card: BulkCard, found: dict[str, _Dmig]) -> None:
    name = card.text(0).upper()
    if card.text(1) == "0":
        kind = card.whole(3, "TIN")
        if kind not in (1, 2):
            raise card.error(f"{name}: TIN = {kind} is complex; a stiffness is real")
        if name in found:
            raise card.error(f"{name} is there twice")
        found[name] = _Dmig(card, card.whole(2, "IFO"), [], [], [])
        return
    if name not in found:
        raise card.error(f"{name} has no header, DMIG, {name}, 0, ...")
    column = _label(card, 1)
    for k in range(4, len(card.fields), 4):
        if card.text(k):
            found[name].rows.append(_label(card, k))
            found[name].columns.append(column)
            found[name].values.append(card.real(k + 2, "an entry"))


def _label(card: BulkCard, k: int) -> tuple[int, int]:
    node, component = card.whole(k, "a node"), card.whole(k + 1, "a component", 0, 0)
    if not 1 <= component <= 6:
        raise card.error(
            f"the row of {node} is that of a scalar point; a part is reduced to displacements (and "
            "rotations) of grid points alone, without modes"
        )
    return node, component


def _chosen(file: str, square: Mapping[str, bool], name: str | None) -> str:
    """The name of the matrix that is meant."""
    known = [each for each, is_square in square.items() if is_square]
    if name is not None:
        if name.upper() in known:
            return name.upper()
        raise DeckError(f"{file}: no square matrix {name!r}; it has {', '.join(known) or 'none'}")
    stiff = [each for each in known if each.startswith("K")] or known
    if len(stiff) != 1:
        raise DeckError(f"{file}: it has the square matrices {', '.join(known) or 'none'}; give name=")
    return stiff[0]


def _whole(matrix: sp.csr_matrix) -> sp.csr_matrix:
    """A symmetric matrix of which one of two entries may be left out."""
    other = matrix.T.tocsr()
    return (matrix + other - other.multiply(matrix != 0)).tocsr()


def _read_op4(path: Path, name: str | None) -> _Found:
    """OUTPUT4 as text: columns of numbers, dense or in strings."""
    lines = iter([(w, line) for w, line in text_lines(path) if line.strip()])
    found: dict[str, sp.csr_matrix] = {}
    square: dict[str, bool] = {}
    for where, line in lines:
        header = _header(where, line)
        found[header.name] = _columns(header, lines)
        square[header.name] = header.rows == header.columns
    matrix = found[_chosen(path.name, square, name)]
    return _Found(None, _whole(matrix), {})


class _Header(NamedTuple):
    where: Where
    name: str
    rows: int
    columns: int
    width: int


def _header(where: Where, line: str) -> _Header:
    words = [line[8 * k : 8 * (k + 1)].strip() for k in range(4)]
    width = re.search(r"E(\d+)\.", line[40:].upper())
    try:
        columns, rows, kind = int(words[0]), abs(int(words[1])), int(words[3])
    except ValueError:
        raise DeckError(f"{where}: this is no header of OUTPUT4 as text: {line[:40]!r}") from None
    if kind not in (1, 2):
        raise DeckError(f"{where}: its type is {kind}, complex; a stiffness is real")
    return _Header(where, line[32:40].strip().upper(), rows, columns, int(width[1]) if width else 16)


def _columns(header: _Header, lines: Iterator[Line]) -> sp.csr_matrix:
    """The columns after a header, up to the one that ends them."""
    row = column = 0
    i: list[int] = []
    j: list[int] = []
    values: list[float] = []
    for where, line in lines:
        if "." in line:
            words = [line[k : k + header.width].strip() for k in range(0, len(line.rstrip()), header.width)]
            i += range(row, row + len(words))
            j += [column] * len(words)
            values += _reals(where, words, f"number of {header.width} characters")
            row += len(words)
            continue
        try:
            numbers = [int(word) for word in line.split()]
        except ValueError:
            raise DeckError(f"{where}: {line[:40]!r} is neither a column nor a string of OUTPUT4") from None
        if len(numbers) >= 3:
            column, row = numbers[0] - 1, numbers[1] - 1
            if column >= header.columns:
                next(lines, None)  # what ends the matrix has one number
                break
        else:  # the head of a string: length and row, or both in one number
            row = (numbers[1] if len(numbers) == 2 else numbers[0] % 65536) - 1
    inside = all(0 <= k < header.rows for k in i) and all(0 <= k < header.columns for k in j)
    if not inside:
        raise DeckError(f"{header.where}: {header.name} has entries outside of its {header.rows} rows")
    return sp.csr_matrix((values, (i, j)), shape=(header.rows, header.columns))


_READERS: dict[str, Callable[[Path, str | None], _Found]] = {
    ".mtx": _read_mtx,
    ".pch": _read_dmig,
    ".dmig": _read_dmig,
    ".bdf": _read_dmig,
    ".op4": _read_op4,
}
