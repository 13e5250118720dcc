"""What ``latin_run`` has written, the fields in the kernel's columns, as the tree of a saved result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, get_args

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.formats.chaos_file import Field, with_fields
from dolfinx_frontend.formats.hdf5 import LayoutError, Tree, inside, placed
from dolfinx_frontend.formats.layout import Group
from dolfinx_frontend.results.answer import AnswerKind

__all__ = ["NOT_KEPT", "RUN_FORMAT", "RUN_VERSION", "from_run"]

RUN_FORMAT = "latin-run"
RUN_VERSION = 1
UNDESCRIBED = "it was solved from a folder of another program: nothing says what its numbers are of"
"""A folder that another program has written has nothing for this reader."""
NOT_KEPT = "latin_run keeps the displacements at the points of a sweep if it is run with --displacements"


def from_run(tree: Tree) -> Tree:
    """The tree of a file of ``latin_run`` as that of a saved result.

    Raises
    ------
    LayoutError
        Something is missing or malformed.
    """
    file = Group(tree)
    if "about" not in file:
        raise LayoutError(f"about is missing: {UNDESCRIBED}")
    about, reader = file.group("about"), _Reader(file)
    out = {name: each for name, each in tree.items() if name not in ("run", "about", "in_time")}
    out["interfaces"] = {name: dict(node.tree) for name, node in file.groups("interfaces").items()}
    out["substructures"] = {name: dict(node.tree) for name, node in file.groups("substructures").items()}
    out |= about.tree
    run = reader.run
    out |= {name: run.entry(name) for name in ("status", "iterations", "error")}
    out |= {"place": "", "missing": "{}"}
    if "axes" in run:  # of the command line
        axes = run.group("axes")
        names = axes.texts("names")
        out["axes"] = {name: axes.group(str(n)).numbers("values", None) for n, name in enumerate(names)}
        out |= {"kind": "sweep", "statistics": "grid"}
        out["no_displacements"] = NOT_KEPT
    kind = Group(out).text("kind", get_args(AnswerKind))
    if kind == "sweep":
        out["points"] = run.group("points").tree
        reader.add_points(out)
        return out
    out["statuses"] = [run.text("status")] * (len(reader.times) if reader.times is not None else 1)
    (reader.add_modes if kind == "chaos" else reader.add_columns)(out)
    return out


class _Reader:
    """The fields of a run; what does not fit is said with its place.

    Attributes
    ----------
    run
        The group.
    times
        Of a history, else None.
    columns
        Of one mode.
    """

    def __init__(self, file: Group) -> None:
        self.run = file.group("run")
        self.times = file.numbers("times", None, finite=True) if "times" in file else None
        self.in_time = None
        if "in_time" in file:
            self.in_time = file.numbers("in_time", None, None if self.times is None else len(self.times))
        history = self.times if self.in_time is None else self.in_time
        self.columns = 1 if history is None else len(history)
        interfaces, parts = file.groups("interfaces").items(), file.groups("substructures").items()
        self.points = {name: len(node.numbers("points", None, None)) for name, node in interfaces}
        self.nodes = {name: node.numbers("nodes", None, None).shape for name, node in parts}

    def add_columns(self, out: Tree) -> None:
        """Fields of one answer, or of a history."""
        for name, node in self._fields("interfaces", self.points):
            for what in ("force", "jump"):
                block = self._rows(node, what, name, self.columns)
                out["interfaces"][name][what] = self._timed(self._by_point(block, name))
        for name, node in self._fields("parts", self.nodes):
            u = self._timed(self._unknowns(node, name, self.columns))
            out["substructures"][name]["displacement"] = u.reshape(*u.shape[:-1], *self.nodes[name])

    def add_modes(self, out: Tree) -> None:
        """Fields of a chaos, modes x steps, the steps fastest; beside its coefficients the mean."""
        chaos = Group(out).group("chaos")
        germs = len(chaos.group("germs").texts("names"))
        modes = len(chaos.numbers("indices", None, germs, finite=True))
        fields: dict[str, Field] = {}

        def add(name: str, unit: str, block: Array) -> Array:
            fields[name] = Field(block.reshape(-1, modes), unit, block.shape[:-1], "")
            mean: Array = block[..., 0]
            return mean

        columns = modes * self.columns

        def split(block: Array) -> Array:
            """(rows, modes, steps)."""
            return block.reshape(len(block), modes, self.columns)

        for name, node in self._fields("interfaces", self.points):
            for what, unit in (("force", "force / area"), ("jump", "length")):
                block = self._timed(self._by_point(split(self._rows(node, what, name, columns)), name))
                out["interfaces"][name][what] = add(f"{what}:{name}", unit, block)
        for name, node in self._fields("parts", self.nodes):
            block = self._timed(split(self._unknowns(node, name, columns)))
            mean = add(f"displacement:{name}", "length", block)
            out["substructures"][name]["displacement"] = mean.reshape(*mean.shape[:-1], *self.nodes[name])
        with inside("chaos"):
            out["chaos"] = placed(with_fields(chaos.tree, fields), "chaos")

    def add_points(self, out: Tree) -> None:
        """Force and jump (points, columns, rows) of a sweep, and displacements if they were kept."""
        axes = Group(out).group("axes")
        shape = tuple(len(axes.numbers(name, None)) for name in axes)
        many = math.prod(shape)

        def by_point(node: Group, what: str, rows: int | None) -> Array:
            """(rows, points, columns)."""
            return node.numbers(what, many, self.columns, rows).transpose(2, 0, 1)

        for name, node in self._fields("interfaces", self.points):
            for what in ("force", "jump"):
                block = by_point(node, what, None)
                self._check_rows(node, what, len(block), name)
                block = np.moveaxis(self._by_point(block, name), 2, 0)  # (points, m, components, columns)
                block = self._timed(block)
                if self.times is not None:
                    block = np.moveaxis(block, 0, 1)
                out["interfaces"][name][what] = block.reshape(*shape, *block.shape[1:])
        if "parts" not in self.run:
            return
        out.pop("no_displacements", None)
        for name, node in self._fields("parts", self.nodes):
            u = self._timed(by_point(node, "displacement", math.prod(self.nodes[name])).swapaxes(0, 1))
            if self.times is not None:
                u = np.moveaxis(u, 0, 1)
            out["substructures"][name]["displacement"] = u.reshape(*u.shape[:-1], *self.nodes[name])

    def _fields(self, where: str, known: Mapping[str, Any]) -> Iterator[tuple[str, Group]]:
        """Names and groups of the interfaces or parts of the run."""
        for node in self.run.groups(where).values() if where in self.run else ():
            name = node.text("name")
            if name not in known:
                raise LayoutError(f"{node.place('name')} names {name!r}, which is not in the file")
            yield name, node

    def _rows(self, node: Group, what: str, interface: str, columns: int) -> Array:
        """(rows, columns) of an interface."""
        block = node.numbers(what, None, columns)
        self._check_rows(node, what, len(block), interface)
        return block

    def _check_rows(self, node: Group, what: str, rows: int, interface: str) -> None:
        count = self.points[interface]
        if not rows or not count or rows % count:
            raise LayoutError(f"{node.place(what)} has {rows} rows, of {count} points")

    def _by_point(self, block: Array, interface: str) -> Array:
        """(points, components, ...) of rows (rows, ...)."""
        count = self.points[interface]
        return block.reshape(count, len(block) // count, *block.shape[1:])

    def _unknowns(self, node: Group, part: str, columns: int) -> Array:
        """(unknowns, columns) of a part."""
        return node.numbers("displacement", math.prod(self.nodes[part]), columns)

    def _timed(self, block: Array) -> Array:
        """Fields (..., columns of a history) as ([T,] ...)."""
        if self.times is None:
            return block[..., 0]
        return np.moveaxis(block if self.in_time is None else block @ self.in_time, -1, 0)
