"""What ``latin_run`` has written, the fields in the kernel's columns, as the tree of a saved result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.formats.chaos_file import Field, with_fields
from dolfinx_frontend.formats.hdf5 import Tree

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
    ValueError, LookupError, TypeError
        The arrays do not fit each other.
    """
    if "about" not in tree:
        raise ValueError(UNDESCRIBED)
    run, about = tree.pop("run"), tree.pop("about")
    timed = _timed(tree)
    tree |= about | {
        "status": run["status"],
        "iterations": run["iterations"],
        "error": run["error"],
        "place": "",
        "missing": "{}",
    }
    if "axes" in run:  # of the command line
        values = run["axes"]
        tree["axes"] = {name: values[str(n)]["values"] for n, name in enumerate(values.pop("names"))}
        tree |= {"kind": "sweep", "statistics": "grid"}
        tree["no_displacements"] = NOT_KEPT
    if "points" in run:
        tree["points"] = run["points"]
        _add_points(tree, run, timed)
        return tree
    tree["statuses"] = [str(run["status"])] * (len(tree["times"]) if "times" in tree else 1)
    add = _add_modes if tree["kind"] == "chaos" else _add_columns
    add(tree, run, timed)
    return tree


def _timed(tree: Tree) -> Callable[[Array], Array]:
    """Fields (..., columns of a history) as ([T,] ...)."""
    in_time = tree.pop("in_time", None)
    if "times" not in tree:
        return lambda block: block[..., 0]
    return lambda block: np.moveaxis(block if in_time is None else block @ in_time, -1, 0)


def _fields(run: Tree, where: str) -> dict[str, Tree]:
    return {str(node["name"]): node for node in run.get(where, {}).values()}


def _points(tree: Tree, name: str) -> int:
    return len(tree["interfaces"][name]["points"])


def _dim(tree: Tree, part: str) -> int:
    return int(tree["substructures"][part]["nodes"].shape[1])


def _add_columns(tree: Tree, run: Tree, timed: Callable[[Array], Array]) -> None:
    """Fields of one answer, or of a history."""
    for name, node in _fields(run, "interfaces").items():
        for what in ("force", "jump"):
            block = node[what].reshape(_points(tree, name), -1, node[what].shape[-1])
            tree["interfaces"][name][what] = timed(block)
    for name, node in _fields(run, "parts").items():
        u = timed(node["displacement"])
        tree["substructures"][name]["displacement"] = u.reshape(*u.shape[:-1], -1, _dim(tree, name))


def _add_modes(tree: Tree, run: Tree, timed: Callable[[Array], Array]) -> None:
    """Fields of a chaos, modes x steps, the steps fastest; beside its coefficients the mean."""
    modes = len(tree["chaos"]["indices"])
    fields: dict[str, Field] = {}

    def add(name: str, unit: str, block: Array) -> Array:
        fields[name] = Field(block.reshape(-1, modes), unit, block.shape[:-1], "")
        mean: Array = block[..., 0]
        return mean

    for name, node in _fields(run, "interfaces").items():
        for what, unit in (("force", "force / area"), ("jump", "length")):
            block = timed(node[what].reshape(_points(tree, name), -1, modes, _steps(node[what], modes)))
            tree["interfaces"][name][what] = add(f"{what}:{name}", unit, block)
    for name, node in _fields(run, "parts").items():
        values = node["displacement"]
        block = timed(values.reshape(len(values), modes, _steps(values, modes)))
        mean = add(f"displacement:{name}", "length", block)
        tree["substructures"][name]["displacement"] = mean.reshape(*mean.shape[:-1], -1, _dim(tree, name))
    tree["chaos"] = with_fields(tree["chaos"], fields)


def _steps(block: Array, modes: int) -> int:
    steps, rest = divmod(block.shape[-1], modes)
    if rest:
        raise ValueError(f"{block.shape[-1]} columns of {modes} modes")
    return int(steps)


def _add_points(tree: Tree, run: Tree, timed: Callable[[Array], Array]) -> None:
    """Force and jump (points, columns, rows) of a sweep, and displacements if they were kept."""
    shape = tuple(len(values) for values in tree["axes"].values())
    for name, node in _fields(run, "interfaces").items():
        for what in ("force", "jump"):
            block: Any = np.swapaxes(node[what], 1, 2)
            block = timed(block.reshape(len(block), _points(tree, name), -1, block.shape[2]))
            if "times" in tree:
                block = np.moveaxis(block, 0, 1)
            tree["interfaces"][name][what] = block.reshape(*shape, *block.shape[1:])
    if "parts" not in run:
        return
    tree.pop("no_displacements", None)
    for name, node in _fields(run, "parts").items():
        u: Any = timed(np.swapaxes(node["displacement"], 1, 2))
        if "times" in tree:
            u = np.moveaxis(u, 0, 1)
        tree["substructures"][name]["displacement"] = u.reshape(*u.shape[:-1], -1, _dim(tree, name))
