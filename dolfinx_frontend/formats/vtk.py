"""VTK's XML files: unstructured grids (``.vtu``), an index of several (``.vtm``), a series (``.pvd``).

ParaView, VisIt and pyvista read all three, meshio the grids, which is why numbers are compressed in place
(it does not read what is appended).
"""

from __future__ import annotations

import base64
import re
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.files import Files

__all__ = ["CELLS", "Blocks", "Grid", "check_target", "vertices", "write_blocks"]

Values: TypeAlias = tuple[npt.NDArray[np.float64] | npt.NDArray[np.int64], str]
"""Numbers (rows,) or (rows, components), and the labels of the components: "XYZ" or "XX YY XY"."""

CELLS = {
    ("vertex", 1): 1,
    ("interval", 1): 3,
    ("interval", 2): 21,
    ("triangle", 1): 5,
    ("triangle", 2): 22,
    ("quadrilateral", 1): 9,
    ("quadrilateral", 2): 28,
}
"""VTK's number of a cell by its name and degree."""

_LAGRANGE_HEXAHEDRON = 72
_FAST = 1  # of zlib
_TYPES = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


def _encoded(values: npt.NDArray[np.generic]) -> str:
    """Numbers as one compressed block in base64, its sizes in front."""
    data = np.ascontiguousarray(values).tobytes()
    block = zlib.compress(data, _FAST)
    sizes = [1, len(data), len(data), len(block)] if data else [0, 0, 0]
    head = np.array(sizes, dtype=np.uint64).tobytes()
    return base64.b64encode(head).decode() + base64.b64encode(block if data else b"").decode()


def _version(cell: int) -> str:
    """Of the format: Lagrange hexahedra have another order of nodes since 2.1, which meshio does not know."""
    return "2.2" if cell == _LAGRANGE_HEXAHEDRON else "1.0"


@dataclass(frozen=True)
class Grid:
    """One unstructured grid with cells of one type.

    Attributes
    ----------
    x
        (n, 3).
    cells
        (k, nodes per cell), in VTK's order.
    type
        VTK's number of the cell.
    point_data, cell_data
        Name -> values.
    """

    x: Array
    cells: Ints
    type: int
    point_data: Mapping[str, Values] = field(default_factory=dict)
    cell_data: Mapping[str, Values] = field(default_factory=dict)

    def text(self) -> str:
        """A ``.vtu`` file."""
        def array(values: npt.NDArray[np.generic], name: str, components: str = "") -> str:
            labels = components.split() if " " in components else list(components)
            text = "".join(f" ComponentName{i}={_quoted(label)}" for i, label in enumerate(labels))
            if values.ndim > 1:
                text = f' NumberOfComponents="{values.shape[1]}"{text}'
            return (
                f'        <DataArray type="{_TYPES[values.dtype.str[1:]]}" Name={_quoted(name)}{text} '
                f'format="binary">{_encoded(values)}</DataArray>\n'
            )

        def arrays(data: Mapping[str, Values]) -> str:
            return "".join(array(values, name, labels) for name, (values, labels) in data.items())

        count, width = self.cells.shape
        offsets = width * np.arange(1, count + 1, dtype=np.int64)
        types = np.full(count, self.type, dtype=np.uint8)
        return (
            '<?xml version="1.0"?>\n'
            f'<VTKFile type="UnstructuredGrid" version="{_version(self.type)}" '
            f'byte_order="{sys.byteorder.capitalize()}Endian" header_type="UInt64" '
            'compressor="vtkZLibDataCompressor">\n  <UnstructuredGrid>\n'
            f'    <Piece NumberOfPoints="{len(self.x)}" NumberOfCells="{count}">\n'
            f"      <Points>\n{array(self.x, 'Points')}      </Points>\n"
            f"      <Cells>\n{array(self.cells.ravel(), 'connectivity')}{array(offsets, 'offsets')}"
            f"{array(types, 'types')}      </Cells>\n"
            f"      <PointData>\n{arrays(self.point_data)}      </PointData>\n"
            f"      <CellData>\n{arrays(self.cell_data)}      </CellData>\n"
            "    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n"
        )


def vertices(points: Array, point_data: Mapping[str, Values]) -> Grid:
    """A cloud of points (m, d): every one is a cell."""
    x = np.zeros((len(points), 3))
    x[:, : points.shape[1]] = points
    return Grid(x, np.arange(len(x), dtype=np.int64)[:, None], CELLS["vertex", 1], point_data)


Blocks: TypeAlias = Mapping[str, "Callable[[], Grid] | None | Blocks"]
"""Name -> how its grid is made (None: another rank writes it), or blocks again."""


def check_target(path: str | Path, series: bool) -> Path:
    """The path of an index file; a series in time ends in ``.pvd``, one state in ``.vtm``.

    Raises
    ------
    ValueError
        Another ending, or a series of what has no times.
    """
    target = checked_path("ParaView file", path, new=True)
    if target.suffix not in (".vtm", ".pvd"):
        raise ValueError(
            f"{target.name}: the name of the index file ends in .vtm, or in .pvd for all times of a history"
        )
    if target.suffix == ".pvd" and not series:
        raise ValueError(f"{target.name}: there is no load history; give a name that ends in .vtm")
    return target


def _file_name(number: int, name: str) -> str:
    """A name for a file, without what folders do not like."""
    return f"{number}_{re.sub(r'[^A-Za-z0-9_-]+', '_', name)}.vtu"


def _quoted(text: str) -> str:
    """A text as the value of an attribute."""
    from xml.sax.saxutils import quoteattr  # loads urllib and ssl

    return quoteattr(text)


def _write_index(files: Files, target: Path, blocks: Blocks, rank: int) -> None:
    """Grids in a folder beside their index, a ``.vtm`` file, which the first rank writes."""
    folder = files.folder(target.with_suffix(""))
    grids: list[tuple[Path, Callable[[], Grid]]] = []
    number = 0

    def lines(of: Blocks, indent: str) -> list[str]:
        nonlocal number
        out = []
        for index, (name, block) in enumerate(of.items()):
            head = f'index="{index}" name={_quoted(name)}'
            if isinstance(block, Mapping):
                inside = lines(block, indent + "  ")
                out += [f"{indent}<Block {head}>", *inside, f"{indent}</Block>"]
                continue
            file = folder / _file_name(number, name)
            number += 1
            if block is not None:
                grids.append((file, block))
            out.append(f'{indent}<DataSet {head} file="{folder.name}/{file.name}"/>')
        return out

    text = ['<?xml version="1.0"?>', '<VTKFile type="vtkMultiBlockDataSet" version="1.0">']
    inside = ["  <vtkMultiBlockDataSet>", *lines(blocks, "    "), "  </vtkMultiBlockDataSet>"]
    if rank == 0:
        files.write(target, "\n".join([*text, *inside, "</VTKFile>", ""]))
    for file, block in grids:
        files.write(file, block().text())


def write_blocks(
    target: Path, times: Array | None, step: int, blocks: Callable[[int], Blocks], rank: int = 0
) -> Path:
    """What the ending of a checked target asks for: all times of a history, or one step."""
    with Files() as files:
        if target.suffix == ".pvd" and times is not None:
            _write_series(files, target, times, blocks, rank)
        else:
            _write_index(files, target, blocks(step), rank)
    return target


def _write_series(
    files: Files, target: Path, times: Sequence[float] | Array, blocks: Callable[[int], Blocks], rank: int
) -> None:
    """One index a time step in a folder beside the collection, a ``.pvd`` file."""
    folder = files.folder(target.with_suffix(""))
    indices = [folder / f"step_{step:04d}.vtm" for step in range(len(times))]
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    for index, time in zip(indices, times, strict=True):
        lines.append(f'    <DataSet timestep="{float(time)!r}" file="{folder.name}/{index.name}"/>')
    lines += ["  </Collection>", "</VTKFile>", ""]
    if rank == 0:
        files.write(target, "\n".join(lines))
    for step, index in enumerate(indices):
        _write_index(files, index, blocks(step), rank)
