"""The sections of a mesh file of gmsh that are read, once all that they count is known to be in them.

gmsh asks for memory by the counts of a file. What it gets has the mesh and its groups; fields, periodic nodes
and the rest, which nobody asks for, are left out.
"""

from __future__ import annotations

import io
import mmap
import re
import struct
from collections.abc import Callable, Iterator
from itertools import chain, cycle, islice
from pathlib import Path

from dolfinx_frontend.common.errors import SceneError

__all__ = ["checked_copy"]

_BEGIN = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2(?:\.[0-2])?|4(?:\.[01])?)[ \t]+([01])[ \t]+8\s")
_SECTION = re.compile(rb"^\$(?!End)(\w+)[ \t]*\r?\n", re.MULTILINE)
_NAME = re.compile(rb'\s*(\d+)\s+(\d+)\s+"(.*)"\s*')
_KEPT = (b"PhysicalNames", b"Entities", b"PartitionedEntities", b"Nodes", b"ParametricNodes", b"Elements")
_SIZES = {"i": 4, "Q": 8, "d": 8}
"""Bytes of tags, counts and coordinates in a binary file."""

NodesOf = Callable[[int], int]
"""Nodes of a type of elements."""


class _Numbers:
    """Numbers of a section, one after the other; `begin` is behind what was read."""

    def __init__(self, content: mmap.mmap, begin: int, order: str) -> None:
        self.content, self.begin, self._order = content, begin, order

    def take(self, kind: str, count: int = 1) -> list[int]:
        """So many tags ("i") or counts ("Q")."""
        begin = self.begin
        self.skip(kind, count)
        return list(struct.unpack_from(f"{self._order}{count}{kind}", self.content, begin))

    def skip(self, kinds: str, count: int) -> None:
        """So many times numbers of these kinds that say nothing of what follows."""
        self.begin += sum(_SIZES[kind] for kind in kinds) * count
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

    def skip(self, kinds: str, count: int) -> None:
        if count > self._left:
            raise ValueError
        # "1.5" for a tag would be two numbers for gmsh
        checks = cycle([_is_real if kind == "d" else bytes.isdigit for kind in kinds])
        words = islice(self._words, len(kinds) * count)
        if sum(check(word) for check, word in zip(checks, words, strict=False)) < len(kinds) * count:
            raise ValueError

    def line(self) -> int:
        return self.take("Q")[0]


def _is_real(word: bytes) -> bool:
    float(word)
    return True


def _entities(of: _Numbers, version: bytes, partitioned: bool) -> None:
    if partitioned:
        of.take("Q")
        of.skip("ii", *of.take("Q"))
    for dim, count in enumerate(of.take("Q", 4)):
        for _ in range(count):
            of.take("i", 3 if partitioned else 1)
            if partitioned:
                of.take("i", _length(of))
            of.skip("d", 3 if dim == 0 and version == b"4.1" else 6)
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


def _nodes(of: _Numbers, version: bytes) -> None:
    if version.startswith(b"2"):
        of.skip("iddd", of.line())
        return
    for dim, parametric, count in _blocks(of, version):
        place = "ddd" + "d" * (dim if parametric else 0)
        if version != b"4.1":
            of.skip("i" + place, count)
        else:
            of.skip("Q", count)
            of.skip(place, count)


def _parametric_nodes(of: _Numbers) -> None:
    """Of version 2: after its place each has an entity and parameters on it."""
    for _ in range(of.line()):
        of.skip("iddd", 1)
        dim, _ = of.take("i", 2)
        of.skip("d", dim if dim in (1, 2) else 0)


def _elements(of: _Numbers, version: bytes, nodes_of: NodesOf) -> None:
    if not version.startswith(b"2"):
        for _, kind, count in _blocks(of, version):
            of.skip("i" if version != b"4.1" else "Q", count * (1 + nodes_of(kind)))
        return
    left = of.line()
    text = isinstance(of, _Words)
    while left > 0:
        head = of.take("i", 3)
        kind, count, tags = (head[1], 1, head[2]) if text else head
        if not (0 < count <= left and 0 <= tags <= len(of.content)):
            raise ValueError
        if text:
            of.take("i", tags + nodes_of(kind))
        else:
            of.skip("i", count * (1 + tags + nodes_of(kind)))
        left -= count


def checked_copy(source: Path, target: Path, nodes_of: NodesOf) -> list[tuple[int, int, str]]:
    """Write the sections of a mesh file that are read to another file.

    Returns
    -------
    list
        (dimension, tag, name) of the physical groups that it names.

    Raises
    ------
    SceneError
        It does not begin as a mesh, or a section counts more than there is in it.
    """
    groups: list[tuple[int, int, str]] = []
    with source.open("rb") as file, target.open("xb") as copy:
        begin = _BEGIN.match(file.read(64))
        if begin is None:
            raise SceneError(
                "it does not begin as a mesh of gmsh ($MeshFormat, version 2.2 or 4.1); write it so"
            )
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            at = content.find(b"\n", begin.end() - 1) + 1
            order = ">" if content[at : at + 4] == b"\0\0\0\1" else "<"
            copy.write(b"$MeshFormat\n%s %s 8\n" % begin.groups())
            copy.write(struct.pack(f"{order}i", 1) * int(begin[2]) + b"\n$EndMeshFormat\n")
            for name, part in _sections(content, begin[1], order if begin[2] == b"1" else None, nodes_of):
                if name == b"PhysicalNames":
                    lines = [each for each in part.splitlines() if _NAME.fullmatch(each)]
                    found = (_NAME.fullmatch(each) for each in lines)
                    groups += [(int(m[1]), int(m[2]), m[3].decode(errors="replace")) for m in found if m]
                    part = b"\n".join([b"$PhysicalNames", b"%d" % len(lines), *lines])
                copy.write(part + b"\n$End" + name + b"\n")
    return groups


def _sections(
    content: mmap.mmap, version: bytes, order: str | None, nodes_of: NodesOf
) -> Iterator[tuple[bytes, bytes]]:
    """Name and bytes, without the end, of those that are kept; `order` of the bytes, None: it is text."""
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
                    _nodes(of, version)
                elif name == b"ParametricNodes":
                    _parametric_nodes(of)
                elif name == b"Elements":
                    _elements(of, version, nodes_of)
                else:
                    _entities(of, version, name != b"Entities")
                end = of.begin
                if not content[end : end + 64].lstrip().startswith(last[1:]):
                    raise ValueError
        except ValueError:
            raise SceneError(
                f"its section ${name.decode()} is damaged, or has not all that it counts; write it again"
            ) from None
        if name in _KEPT:
            yield name, content[head.start() : end]
        at = max(end, at)
