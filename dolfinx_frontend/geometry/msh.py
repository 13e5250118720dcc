"""The sections of a mesh file of gmsh that are read, once all that they count is known to be in them.

gmsh asks for memory by the counts of a file. What it gets has the mesh and its groups; fields, periodic nodes
and the rest, which nobody asks for, are left out.
"""

from __future__ import annotations

import io
import mmap
import re
import struct
from array import array
from collections.abc import Callable, Iterator
from itertools import chain, islice
from pathlib import Path

import numpy as np

from dolfinx_frontend.common.arrays import Ints
from dolfinx_frontend.common.errors import SceneError

__all__ = ["check_begin", "checked_copy"]

_BEGIN = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2(?:\.[0-2])?|4(?:\.[01])?)[ \t]+([01])[ \t]+8\s")
_SECTION = re.compile(rb"^\$(?!End)(\w+)[ \t]*\r?\n", re.MULTILINE)
_NAME = re.compile(rb'\s*(\d+)\s+(\d+)\s+"(.*)"\s*')
_KEPT = (b"PhysicalNames", b"Entities", b"PartitionedEntities", b"Nodes", b"ParametricNodes", b"Elements")
_SIZES = {"i": 4, "Q": 8}
"""Bytes of tags and counts in a binary file."""
_TYPES = {"i": "i4", "Q": "u8", "d": "f8"}
_CHUNK = 100_000
"""Rows of a text that are in memory as words at once."""

NodesOf = Callable[[int], int]
"""Nodes of a type of elements."""


class _Numbers:
    """Numbers of a section, one after the other; `begin` is behind what was read."""

    def __init__(self, content: mmap.mmap, begin: int, order: str) -> None:
        self.content, self.begin, self._order = content, begin, order

    def take(self, kind: str, count: int = 1) -> list[int]:
        """So many tags ("i") or counts ("Q")."""
        begin = self.begin
        self._pass(_SIZES[kind] * count)
        return list(struct.unpack_from(f"{self._order}{count}{kind}", self.content, begin))

    def rows(self, kinds: str, count: int) -> Ints:
        """So many times numbers of these kinds: the whole ones, (count, tags and counts of a row)."""
        row = np.dtype([(f"{k}", self._order + _TYPES[kind]) for k, kind in enumerate(kinds)])
        begin = self.begin
        self._pass(row.itemsize * count)
        whole = [k for k, kind in enumerate(kinds) if kind != "d"]
        found = np.empty((count, len(whole)), dtype=np.int64)
        values = np.frombuffer(self.content[begin : self.begin], row)
        for column, k in enumerate(whole):
            found[:, column] = values[f"{k}"]
        return found

    def _pass(self, size: int) -> None:
        self.begin += size
        if self.begin > len(self.content):
            raise ValueError

    def line(self) -> int:
        """A count that is text in a binary file of version 2, too."""
        end = self.content.find(b"\n", self.begin, self.begin + 32) + 1
        (found,) = _Words(self.content, self.begin, end).take("Q")
        self.begin = end
        return found


class _Words(_Numbers):
    """The same in a file of text: to the end of the section."""

    def __init__(self, content: mmap.mmap, begin: int, end: int) -> None:
        super().__init__(content, end, "")
        text = content[begin:end]
        if b"$" in text:  # what gmsh might take for another section
            raise ValueError
        self._left = len(text)
        self._words: Iterator[bytes] = chain.from_iterable(map(bytes.split, io.BytesIO(text)))

    def take(self, kind: str, count: int = 1) -> list[int]:
        words = list(islice(self._words, count))
        digits = [each.removeprefix(b"-") if kind == "i" else each for each in words]
        if len(words) < count or not all(map(bytes.isdigit, digits)):
            raise ValueError
        return [int(each) for each in words]

    def rows(self, kinds: str, count: int) -> Ints:
        if len(kinds) * count > self._left:
            raise ValueError
        whole = [k for k, kind in enumerate(kinds) if kind != "d"]
        found = np.empty((count, len(whole)), dtype=np.int64)
        for begin in range(0, count, _CHUNK):
            end = min(begin + _CHUNK, count)
            words = list(islice(self._words, len(kinds) * (end - begin)))
            if len(words) < len(kinds) * (end - begin):
                raise ValueError
            for column, k in enumerate(whole):
                numbers = words[k :: len(kinds)]
                if not all(map(bytes.isdigit, numbers)):  # "1.5" for a tag would be two numbers for gmsh
                    raise ValueError
                found[begin:end, column] = list(map(int, numbers))
            for k in range(len(kinds)):
                if k not in whole:
                    list(map(float, words[k :: len(kinds)]))
        return found

    def line(self) -> int:
        return self.take("Q")[0]


def _entities(of: _Numbers, version: bytes, partitioned: bool) -> None:
    if partitioned:
        of.take("Q")
        of.rows("ii", *of.take("Q"))
    for dim, count in enumerate(of.take("Q", 4)):
        for _ in range(count):
            of.take("i", 3 if partitioned else 1)
            if partitioned:
                of.take("i", _length(of))
            of.rows("d", 3 if dim == 0 and version == b"4.1" else 6)
            for _ in range(2 if dim else 1):  # groups and boundary
                of.take("i", _length(of))


def _length(of: _Numbers) -> int:
    """Of a list that follows."""
    (count,) = of.take("Q")
    if count > len(of.content):
        raise ValueError
    return count


def _blocks(of: _Numbers, version: bytes) -> Iterator[tuple[int, int, int]]:
    """Dimension, kind and length of the blocks of a section of version 4."""
    blocks, total = of.take("Q", 2)
    if total > len(of.content):
        raise ValueError
    if version == b"4.1":
        of.take("Q", 2)
    for _ in range(blocks):
        first, second, kind = of.take("i", 3)
        yield second if version != b"4.1" else first, kind, _length(of)


def _nodes(of: _Numbers, version: bytes) -> list[Ints]:
    """Numbers of the nodes."""
    if version.startswith(b"2"):
        return [of.rows("iddd", of.line())]
    found = []
    for dim, parametric, count in _blocks(of, version):
        place = "ddd" + "d" * (dim if parametric else 0)
        if version != b"4.1":
            found.append(of.rows("i" + place, count))
        else:
            found.append(of.rows("Q", count))
            of.rows(place, count)
    return found


def _parametric_nodes(of: _Numbers) -> list[Ints]:
    """Of version 2: after its place each has an entity and parameters on it."""
    found = []
    for _ in range(of.line()):
        found.append(of.rows("iddd", 1))
        dim, _ = of.take("i", 2)
        of.rows("d", dim if dim in (1, 2) else 0)
    return found


def _elements(of: _Numbers, version: bytes, nodes_of: NodesOf) -> list[Ints]:
    """Number and nodes of the elements, (elements of a kind, 1 + nodes)."""
    if not version.startswith(b"2"):
        found = []
        for _, kind, count in _blocks(of, version):
            width = 1 + nodes_of(kind)
            found.append(of.rows(("i" if version != b"4.1" else "Q") * width, count))
        return found
    left = of.line()
    text = isinstance(of, _Words)
    several: dict[int, array[int]] = {}
    while left > 0:
        head = of.take("i", 3)
        kind, count, tags = (head[1], 1, head[2]) if text else head
        if not (0 < count <= left and 0 <= tags <= len(of.content)):
            raise ValueError
        width = 1 + nodes_of(kind)
        of_kind = several.setdefault(width, array("q"))
        if text:
            of.take("i", tags)
            of_kind.append(head[0])
            of_kind.extend(of.take("i", width - 1))
        else:
            rows = of.rows("i" * (width + tags), count)
            of_kind.extend(np.delete(rows, slice(1, 1 + tags), axis=1).ravel())
        left -= count
    return [np.array(each, dtype=np.int64).reshape(-1, width) for width, each in several.items()]


def _check_numbers(nodes: list[Ints], elements: list[Ints]) -> None:
    """gmsh takes the last of what has one number, and leaves out what is of nodes that there are not."""
    known = np.sort(np.concatenate([np.empty(0, dtype=np.int64), *(each.ravel() for each in nodes)]))
    if (twice := known[1:][known[1:] == known[:-1]]).size:
        raise SceneError(f"its section $Nodes has node {twice[0]} twice; write it again")
    for each in elements:
        at = np.minimum(np.searchsorted(known, each[:, 1:]), known.size - 1)
        lost = known[at] != each[:, 1:] if known.size else np.ones(each[:, 1:].shape, dtype=bool)
        if lost.any():
            row, column = np.argwhere(lost)[0]
            raise SceneError(
                f"its element {each[row, 0]} has node {each[row, 1 + column]}, which is not in its section "
                "$Nodes; write it again"
            )
    numbers = np.sort(np.concatenate([np.empty(0, dtype=np.int64), *(each[:, 0] for each in elements)]))
    if (twice := numbers[1:][numbers[1:] == numbers[:-1]]).size:
        raise SceneError(f"its section $Elements has element {twice[0]} twice; write it again")


def check_begin(name: str, first: bytes) -> re.Match[bytes]:
    """Version and kind of a mesh, by its first bytes.

    Raises
    ------
    SceneError
        It does not begin as one.
    """
    begin = _BEGIN.match(first)
    if begin is None:
        raise SceneError(
            f"{name!r}: it does not begin as a mesh of gmsh ($MeshFormat, version 2.2 or 4.1); write it so"
        )
    return begin


def checked_copy(source: Path, target: Path, nodes_of: NodesOf) -> list[tuple[int, int, str]]:
    """Write the sections of a mesh file that are read to another file.

    Returns
    -------
    list
        (dimension, tag, name) of the physical groups that it names.

    Raises
    ------
    SceneError
        It does not begin as a mesh, a section counts more than there is in it, or nodes or elements have the
        same number, or elements nodes that there are not.
    """
    groups: list[tuple[int, int, str]] = []
    with source.open("rb") as file, target.open("xb") as copy:
        begin = check_begin(source.name, file.read(64))
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            at = content.find(b"\n", begin.end() - 1) + 1
            order = ">" if content[at : at + 4] == b"\0\0\0\1" else "<"
            copy.write(b"$MeshFormat\n%s %s 8\n" % begin.groups())
            copy.write(struct.pack(f"{order}i", 1) * int(begin[2]) + b"\n$EndMeshFormat\n")
            form = order if begin[2] == b"1" else None
            nodes, elements = list[Ints](), list[Ints]()
            for name, part in _sections(content, begin[1], form, nodes_of, nodes, elements):
                if name == b"PhysicalNames":
                    lines = [each for each in part.splitlines() if _NAME.fullmatch(each)]
                    found = (_NAME.fullmatch(each) for each in lines)
                    groups += [(int(m[1]), int(m[2]), m[3].decode(errors="replace")) for m in found if m]
                    part = b"\n".join([b"$PhysicalNames", b"%d" % len(lines), *lines])
                copy.write(part + b"\n$End" + name + b"\n")
            _check_numbers(nodes, elements)
    return groups


def _sections(
    content: mmap.mmap,
    version: bytes,
    order: str | None,
    nodes_of: NodesOf,
    nodes: list[Ints],
    elements: list[Ints],
) -> Iterator[tuple[bytes, bytes]]:
    """Name and bytes, without the end, of those that are kept; `order` of the bytes, None: it is text.

    Numbers of `nodes` and `elements`, and the nodes of these, are added to the lists.
    """
    at = 0
    while (head := _SECTION.search(content, at)) is not None:
        name, at = head[1], head.end()
        last = b"\n$End" + name
        end = content.find(last, at - 1)
        try:
            if end < 0:
                raise ValueError
            if name in _KEPT[1:]:
                of = _Words(content, at, end) if order is None else _Numbers(content, at, order)
                if name == b"Nodes":
                    nodes += _nodes(of, version)
                elif name == b"ParametricNodes":
                    nodes += _parametric_nodes(of)
                elif name == b"Elements":
                    elements += _elements(of, version, nodes_of)
                else:
                    _entities(of, version, name != b"Entities")
                end = of.begin
                if not content[end : end + 64].lstrip().startswith(last[1:]):
                    raise ValueError
        except (ValueError, OverflowError):
            raise SceneError(
                f"its section ${name.decode()} is damaged, or has not all that it counts; write it again"
            ) from None
        if name in _KEPT:
            yield name, content[head.start() : end]
        at = max(end, at)
