"""Trees of values in HDF5 files, sealed by a checksum."""

from __future__ import annotations

import hashlib
import importlib
import io
import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np

from dolfinx_frontend.common.files import FileError, opened

__all__ = ["ChaosFileError"]

Tree: TypeAlias = dict[str, Any]

# what a damaged file may raise while it is read, whatever is damaged
DAMAGE = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)

_USER_BLOCK = 512  # bytes before an HDF5 file, which the library leaves alone
MEMORY = 3.0
"""That reading takes, in multiples of the size of the file: what is read, and what is made of it."""
_DEEPEST = 3
"""Levels of groups below the first, of what this package writes."""
_TEXT = struct.Struct("<IQI")
"""What a data set has of a text: its length, the address of its heap, and its number there."""


class LayoutError(ValueError):
    """A file whose seal is right lacks something, or has it in another form."""


class Node(dict[str, Any]):
    """A group of a file that was read; what is asked for and is not there is said with its place."""

    def __init__(self, entries: Tree, where: str = "") -> None:
        super().__init__(entries)
        self._where = where

    def __missing__(self, name: str) -> Any:
        raise LayoutError(f"{self._where}/{name} is missing" if self._where else f"{name} is missing")


def placed(tree: Any, where: str = "") -> Any:
    """A tree whose groups know their places."""
    if not isinstance(tree, dict):
        return tree
    return Node({key: placed(each, f"{where}/{key}" if where else key) for key, each in tree.items()}, where)


@contextmanager
def inside(where: str) -> Iterator[None]:
    """Whatever a damaged group raises is said with its place."""
    try:
        yield
    except LayoutError:
        raise
    except DAMAGE as error:
        raise LayoutError(f"{where}: {error or type(error).__name__}") from error


class ChaosFileError(FileError):
    """A file that is no chaos file, is damaged or of another version, or cannot be written."""


def h5py_module() -> Any:
    try:
        return importlib.import_module("h5py")
    except ImportError as error:
        raise ChaosFileError(
            "HDF5 files need h5py, which is not installed: install it, or use a .json file"
        ) from error


def _key(name: str) -> str:
    """A name as a link of HDF5, which knows no slash and no "."; :func:`unquote` is the inverse."""
    name = name.replace("%", "%25").replace("/", "%2F")
    return name.replace(".", "%2E") if name.strip(".") == "" else name


def _seal(file: io.BufferedReader | io.BufferedRandom, form: str) -> bytes:
    """What the user block of an HDF5 file says: the SHA-256 of everything after it."""
    file.seek(_USER_BLOCK)
    found = hashlib.file_digest(file, "sha256").hexdigest()
    file.seek(0)
    return f"{form} sha256 {found}\n".encode()


def seal(path: Path, form: str) -> None:
    with path.open("r+b") as file:
        file.write(_seal(file, form))


def write_tree(path: Path, head: Tree, tree: Tree) -> None:
    """Write nested dicts, sealed: texts and integers as attributes, arrays and lists of texts as datasets.

    Parameters
    ----------
    head
        The attributes of the file; ``format`` names its kind.
    """
    h5py = h5py_module()

    def put(group: Any, node: Tree) -> None:
        for key, value in node.items():
            if isinstance(value, dict):
                put(group.create_group(_key(key), track_order=True), value)
            elif isinstance(value, np.ndarray):
                group.create_dataset(_key(key), data=value)
            elif isinstance(value, list):
                group.create_dataset(_key(key), data=value, dtype=h5py.string_dtype())
            else:
                group.attrs[key] = value

    # the layout of HDF5 1.8 has room for long attributes
    layout: Tree = {"libver": ("v108", "v108"), "userblock_size": _USER_BLOCK}
    # in memory: the library ends the process later if the disk is full while it writes
    whole = io.BytesIO()
    with h5py.File(whole, "w", track_order=True, **layout) as file:
        file.attrs.update(head)
        put(file, tree)
    with path.open("wb") as target:
        target.write(whole.getbuffer())
    seal(path, head["format"])


def read_tree(path: Path, form: str, kind: type[FileError]) -> Tree:
    """What :func:`write_tree` wrote.

    Raises
    ------
    FileError
        It is no file, or too large; of the given kind.
    ValueError
        The file is of another kind, was damaged, or holds what does not belong there.

    Returns
    -------
    Tree
        What is asked for and is not there raises :class:`LayoutError` with its place.
    """
    with opened(path, MEMORY, kind) as file:
        h5py = h5py_module()
        # before the HDF5 library sees the file: on some damaged ones it never returns
        if file.read(len(form) + 1) != f"{form} ".encode():
            raise ValueError(f"it is no {form} file")
        wanted = _seal(file, form)
        if file.read(len(wanted)) != wanted:
            raise ValueError("its first line is not the checksum of the rest")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content, h5py.File(path, "r") as root:
            tree: Tree = placed(_Reading(h5py, content).group(root))
    return tree


class _Reading:
    """What is read of a file, which is a tree whose contents take no more room than the file.

    Links that lead to one object twice, and data sets and texts that share bytes, would make much of a small
    file: each object is read once, and the bytes of all are counted before there is memory for them.
    """

    def __init__(self, h5py: Any, content: mmap.mmap) -> None:
        self._h5py, self._content, self._size, self._left = h5py, content, len(content), len(content)
        self._heaps: dict[int, dict[int, int]] = {}
        self._in_heaps = 0
        self._met: set[tuple[int, ...]] = set()
        self._plain = (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT)

    def group(self, group: Any, depth: int = 0) -> Tree:
        """Attributes, and what is in the group."""
        self._meet(group)
        node: Tree = {key: self._attribute(group, key) for key in group.attrs}
        for key in group:
            if depth > _DEEPEST or not isinstance(group.get(key, getlink=True), self._h5py.HardLink):
                raise ValueError(f"a link that does not belong there: {key!r}")
            child = group[key]
            if isinstance(child, self._h5py.Group):
                node[unquote(key)] = self.group(child, depth + 1)
            elif isinstance(child, self._h5py.Dataset):
                self._meet(child)
                node[unquote(key)] = self._values(key, child)
            else:
                raise ValueError(f"{key!r} is neither numbers nor texts")
        return node

    def _meet(self, item: Any) -> None:
        info = self._h5py.h5o.get_info(item.id)
        if info.addr in self._met:
            raise ValueError(f"two links lead to {item.name!r}")
        self._met.add(info.addr)

    def _take(self, count: int, what: str) -> None:
        self._left -= count
        if self._left < 0:
            raise ValueError(f"with {what!r} it is larger than the file, of {self._size} bytes")

    def _attribute(self, group: Any, key: str) -> Any:
        if group.attrs.get_id(key).shape != ():
            raise ValueError(f"{key!r} is no single text or number")
        value = group.attrs[key]
        if isinstance(value, bytes):
            value = value.decode()
        self._take(len(value) if isinstance(value, str) else 8, key)
        return value

    def _values(self, key: str, data: Any) -> Any:
        stored = data.id.get_create_plist()
        if stored.get_layout() not in self._plain or stored.get_external_count():
            raise ValueError(f"{key!r} is not stored in one piece in this file")
        self._take(data.nbytes, key)
        if self._h5py.check_string_dtype(data.dtype) is None:
            begin = data.id.get_offset() or 0
            if data.dtype.kind not in "biuf" or not begin + data.id.get_storage_size() <= self._size:
                raise ValueError(f"{key!r} is no array of numbers in this file")
            value = data[()]
            if isinstance(value, np.ndarray):
                value.flags.writeable = False  # what is read is handed out
            return value
        if self._h5py.check_string_dtype(data.dtype).length is None and data.size:
            self._check_texts(key, data)
        return data.asstr()[()].tolist()

    def _check_texts(self, key: str, data: Any) -> None:
        """HDF5 believes what a data set says of the lengths of its texts, beyond what they have."""
        begin = data.id.get_offset()
        if begin is None or begin + _TEXT.size * data.size > self._size:
            raise ValueError(f"{key!r} is no list of texts in this file")
        for length, heap, index in _TEXT.iter_unpack(self._content[begin : begin + _TEXT.size * data.size]):
            if length and self._heap(heap).get(index) != length:
                raise ValueError(f"{key!r} has texts of other lengths than it says")
            self._take(length, key)

    def _heap(self, address: int) -> dict[int, int]:
        """Lengths of the objects of a heap of the file, by their numbers (HDF5 file format, III.E)."""
        if address not in self._heaps:
            found: dict[int, int] = {}
            begin = address + _USER_BLOCK
            head = self._content[begin : begin + 16]
            end = min(begin + int.from_bytes(head[8:], "little"), self._size) if head[:4] == b"GCOL" else 0
            self._in_heaps += max(end - begin, 0)
            if self._in_heaps > self._size:
                raise ValueError("its heaps lie over each other")
            at = begin + 16
            while at + 16 <= end and (index := int.from_bytes(self._content[at : at + 2], "little")):
                found[index] = int.from_bytes(self._content[at + 8 : at + 16], "little")
                at += 16 + (found[index] + 7) // 8 * 8
            self._heaps[address] = found
        return self._heaps[address]
