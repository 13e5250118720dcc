"""What a file has to hold, asked for by name, kind and shape; what is not there is said with its place.

A seal tells that a file was not damaged, not that all is in it: files are edited by hand and sealed again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import is_real, is_whole
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.formats.hdf5 import LayoutError, Tree

__all__ = ["Group"]


class Group:
    """A group of a file with its place in it.

    Parameters
    ----------
    tree
        What was read.
    where
        Its place, ``"interfaces/joint"``; empty: the whole file.

    Raises
    ------
    LayoutError
        From all methods: an entry is missing or malformed.
    """

    def __init__(self, tree: Any, where: str = "") -> None:
        self._where = where
        if not isinstance(tree, dict):
            raise LayoutError(f"{where or 'the file'} is {_kind(tree)}, a group is wanted")
        self.tree: Tree = tree

    def place(self, name: str) -> str:
        """Where an entry is, for messages."""
        return f"{self._where}/{name}" if self._where else name

    def wrong(self, name: str, wanted: str) -> LayoutError:
        """The error of an entry."""
        return LayoutError(f"{self.place(name)} is {_kind(self.tree.get(name))}, {wanted} is wanted")

    def __contains__(self, name: str) -> bool:
        return name in self.tree

    def __iter__(self) -> Iterator[str]:
        return iter(self.tree)

    def entry(self, name: str) -> Any:
        """Anything by its name."""
        if name not in self.tree:
            raise LayoutError(f"{self.place(name)} is missing")
        return self.tree[name]

    def group(self, name: str) -> Group:
        """A group in this one."""
        return Group(self.entry(name), self.place(name))

    def groups(self, name: str) -> dict[str, Group]:
        """The groups that are in a group."""
        node = self.group(name)
        return {each: node.group(each) for each in node}

    def text(self, name: str, among: Sequence[str] | None = None) -> str:
        """A text; one of some."""
        found = self.entry(name)
        if not isinstance(found, str):
            raise self.wrong(name, "a text")
        if among is not None and found not in among:
            raise self.wrong(name, f"one of {', '.join(map(repr, among))}")
        return found

    def texts(self, name: str, count: int | None = None, among: Sequence[str] | None = None) -> list[str]:
        """A list of texts, as many as there must be, each one of some."""
        found = self.entry(name)
        if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
            raise self.wrong(name, "a list of texts")
        if count is not None and len(found) != count:
            raise LayoutError(f"{self.place(name)} has {len(found)} texts, {count} are wanted")
        unknown = [each for each in found if among is not None and each not in among]
        if unknown:
            raise LayoutError(f"{self.place(name)} names {unknown[0]!r}, which is not in the file")
        return found

    def whole(self, name: str, low: int, high: int) -> int:
        """A whole number of a range, its ends included."""
        found = self.entry(name)
        if not is_whole(found) or not low <= found <= high:
            raise self.wrong(name, f"a whole number from {low} to {high}")
        return int(found)

    def number(self, name: str) -> float:
        """A real number; NaN is not known."""
        found = self.entry(name)
        if not is_real(found):
            raise self.wrong(name, "a number")
        return float(found)

    def numbers(self, name: str, *shape: int | None, finite: bool = False) -> Array:
        """Real numbers of a shape; None: any length."""
        found = np.asarray(self.entry(name)) if not isinstance(self.entry(name), (dict, list)) else None
        if found is None or found.dtype.kind not in "iuf":
            raise self.wrong(name, "an array of numbers")
        self._check_shape(name, found, shape)
        if finite and not np.isfinite(found).all():
            raise LayoutError(f"{self.place(name)} has numbers that are not finite")
        return found.astype(np.float64)

    def wholes(self, name: str, *shape: int | None, below: int) -> Ints:
        """Whole numbers from 0 on of a shape; None: any length."""
        found = self.numbers(name, *shape)
        if np.asarray(self.tree[name]).dtype.kind == "f":
            raise LayoutError(f"{self.place(name)} has fractions, whole numbers are wanted")
        if found.size and (found.min() < 0 or found.max() >= below):
            raise LayoutError(
                f"{self.place(name)} has numbers from {found.min():g} to {found.max():g}, 0 to {below - 1} "
                "are wanted"
            )
        return found.astype(np.int64)

    def sparse(self, name: str, rows: int, columns: int, of: str) -> None:
        """A sparse matrix by rows, whose column numbers are called `of`; see `results.writing`."""
        node = self.group(name)
        node.rows(rows, columns, of)

    def rows(self, rows: int, columns: int, of: str) -> None:
        """This group is a sparse matrix by rows."""
        count = len(self.numbers("values", None, finite=True))
        self.wholes(of, count, below=columns)
        starts = self.wholes("starts", rows + 1, below=count + 1)
        if starts[0] != 0 or starts[-1] != count or (np.diff(starts) < 0).any():
            raise LayoutError(f"{self.place('starts')} does not ascend from 0 to {count}")

    def _check_shape(self, name: str, found: Array, shape: Sequence[int | None]) -> None:
        fits = found.ndim == len(shape) and all(
            wanted is None or wanted == size for wanted, size in zip(shape, found.shape, strict=True)
        )
        if not fits:
            text = ", ".join("any" if wanted is None else str(wanted) for wanted in shape)
            wanted = f"shape ({text})" if shape else "one number"
            raise LayoutError(f"{self.place(name)} has shape {found.shape}, {wanted} is wanted")


def _kind(value: Any) -> str:
    if isinstance(value, dict):
        return "a group"
    if isinstance(value, list):
        return "a list of texts"
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}, {value.shape}"
    return short(value)
