"""Trees of values in HDF5 files, sealed by a checksum."""

from __future__ import annotations

import hashlib
import importlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np

from dolfinx_frontend.common.files import FileError

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


def _digest(path: Path, form: str) -> bytes:
    """What the user block of an HDF5 file says: the SHA-256 of everything after it."""
    with path.open("rb") as file:
        file.seek(_USER_BLOCK)
        found = hashlib.file_digest(file, "sha256").hexdigest()
    return f"{form} sha256 {found}\n".encode()


def seal(path: Path, form: str) -> None:
    line = _digest(path, form)
    with path.open("r+b") as file:
        file.write(line)


def _check_seal(path: Path, form: str) -> None:
    """Before the HDF5 library sees the file: on some damaged ones it never returns."""
    wanted = _digest(path, form)
    with path.open("rb") as file:
        found = file.read(len(wanted))
    if found != wanted:
        raise ValueError("its first line is not the checksum of the rest")


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


def read_tree(path: Path, form: str) -> Tree:
    """What :func:`write_tree` wrote.

    Raises
    ------
    ValueError
        The file is of another kind, was damaged, or holds what does not belong there.

    Returns
    -------
    Tree
        What is asked for and is not there raises :class:`LayoutError` with its place.
    """
    h5py = h5py_module()
    plain = (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT)

    def text(value: Any) -> Any:
        return value.decode() if isinstance(value, bytes) else value

    def get(group: Any, depth: int = 0) -> Tree:
        node: Tree = {key: text(value) for key, value in group.attrs.items()}
        for key in group:
            name = unquote(key)
            if depth > 3 or not isinstance(group.get(key, getlink=True), h5py.HardLink):
                raise ValueError(f"a link that does not belong there: {key!r}")
            child = group[key]
            if isinstance(child, h5py.Group):
                node[name] = get(child, depth + 1)
                continue
            stored = child.id.get_create_plist()
            if stored.get_layout() not in plain or stored.get_external_count():
                raise ValueError(f"{key!r} is not stored in one piece in this file")
            if child.nbytes > most:
                raise ValueError(f"{key!r} is larger than the file")
            if h5py.check_string_dtype(child.dtype) is not None:
                node[name] = child.asstr()[()].tolist()
            else:
                value = child[()]
                if isinstance(value, np.ndarray):
                    value.flags.writeable = False  # what is read is handed out
                node[name] = value
        return node

    _check_seal(path, form)
    most = path.stat().st_size
    with h5py.File(path, "r") as file:
        tree: Tree = placed(get(file))
    return tree
