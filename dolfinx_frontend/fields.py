"""Displacements and stresses as files that ParaView, VisIt, pyvista and meshio read.

The format is VTK's XML: a multi-block index (``.vtm``) and one unstructured grid (``.vtu``) per
part.  The cells are Lagrange cells of the displacement's degree, so curved parts and quadratic
fields are kept as they are; every cell has nodes of its own, so stresses may jump between cells,
as they do.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem, plot

from dolfinx_frontend.errors import SceneError
from dolfinx_frontend.materials import Material
from dolfinx_frontend.scene import Scene

if TYPE_CHECKING:
    from dolfinx_frontend.solve import Result

__all__ = ["stress_function", "von_mises", "write_fields"]

Array = npt.NDArray[np.float64]
Materials = Mapping[str, Material | Callable[[Any, Any], Any]]

_SYMMETRIC = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Components of a symmetric tensor in VTK's order."""


def _broken(function: fem.Function, shape: tuple[int, ...], degree: int) -> fem.FunctionSpace:
    """Discontinuous Lagrange space with equispaced nodes, which are those of VTK's cells."""
    mesh = function.function_space.mesh
    element = basix.ufl.element(
        "Lagrange",
        mesh.topology.cell_name(),
        degree,
        lagrange_variant=basix.LagrangeVariant.equispaced,
        discontinuous=True,
        shape=shape,
    )
    return fem.functionspace(mesh, element)


def stress_function(
    displacement: fem.Function, material: Material, degree: int | None = None
) -> fem.Function:
    """Stress of a displacement, force / area, interpolated cell by cell.

    Parameters
    ----------
    displacement
        Vector-valued Lagrange function.
    material
        With a method ``stress(u)``, as the materials of this package have.
    degree
        Of the discontinuous Lagrange space; None: the displacement's.

    Returns
    -------
    dolfinx.fem.Function
        (d, d), symmetric; in 2D the components in the plane.

    Raises
    ------
    SceneError
        The material gives a bilinear form only.
    """
    stress = getattr(material, "stress", None)
    if stress is None:
        raise SceneError(
            f"material {material!r} gives no stress: it needs a method stress(u) that returns a "
            "UFL expression of shape (d, d)"
        )
    d = int(displacement.function_space.mesh.geometry.dim)
    if degree is None:
        degree = int(displacement.function_space.element.basix_element.degree)
    function = fem.Function(_broken(displacement, (d, d), degree), name="stress")
    points = function.function_space.element.basix_element.points
    function.interpolate(fem.Expression(stress(displacement), points))
    return function


def von_mises(stress: Array) -> Array:
    """Von Mises stress (points,) of stresses (points, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    equivalent: Array = np.sqrt(1.5 * np.einsum("pij,pij->p", deviator, deviator))
    return equivalent


def write_fields(
    fields: Result | Mapping[str, fem.Function],
    path: str | Path,
    materials: Scene | Materials | None = None,
) -> Path:
    """Write displacements, and stresses where the materials are known.

    The grid of each part has the point data ``displacement`` (length; 3 components), and, with a
    material that has a method ``stress``, ``stress`` (force / area; XX, YY, ZZ, XY, YZ, XZ, in 2D
    XX, YY, XY) and in 3D ``von Mises``.  Their units are those of the scene.

    Parameters
    ----------
    fields
        Result of a solve, or part -> displacement, a vector-valued Lagrange function. On several ranks
        each writes the grids of its parts.
    path
        Index file, ending in ``.vtm``; the grids go to a folder of the same name beside it.
    materials
        The scene, or part -> material; parts without one, or with a UFL form as material, get no
        stress. None: displacements only.

    Returns
    -------
    Path
        The index file: open this one.

    Raises
    ------
    ValueError
        The file name does not end in ``.vtm``, or there is nothing to write.
    """
    target = Path(path)
    if target.suffix != ".vtm":
        raise ValueError(f"{target.name}: the name of the index file ends in .vtm")
    if isinstance(fields, Mapping):
        functions = dict(fields)
        names, rank = list(functions), 0
    else:
        functions = {name: fields.displacement(name) for name in fields.problem.substructures}
        names, rank = list(fields.problem.parts), fields.problem.rank
    if not names:
        raise ValueError("there are no displacements to write")
    if isinstance(materials, Scene):
        materials = {name: spec.material for name, spec in materials.substructures.items()}
    folder = target.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    blocks = []
    for number, name in enumerate(names):
        file = folder / f"{number}_{re.sub(r'[^A-Za-z0-9_-]+', '_', name)}.vtu"
        if name in functions:
            _write_grid(file, functions[name], (materials or {}).get(name))
        blocks.append(
            f'    <DataSet index="{number}" name={quoteattr(name)} '
            f'file="{folder.name}/{file.name}"/>'
        )
    if rank > 0:  # the first rank names the grids of all
        return target
    target.write_text(
        '<?xml version="1.0"?>\n'
        '<VTKFile type="vtkMultiBlockDataSet" version="1.0">\n  <vtkMultiBlockDataSet>\n'
        + "\n".join(blocks)
        + "\n  </vtkMultiBlockDataSet>\n</VTKFile>\n",
        encoding="utf-8",
    )
    return target


def _write_grid(path: Path, displacement: fem.Function, material: Any) -> None:
    """One part as an unstructured grid."""
    space = displacement.function_space
    d = int(space.mesh.geometry.dim)
    u = fem.Function(_broken(displacement, (d,), int(space.element.basix_element.degree)))
    u.interpolate(displacement)
    topology, types, x = plot.vtk_mesh(u.function_space)
    cells = topology.reshape(len(types), -1)[:, 1:]
    vectors = np.zeros((len(x), 3))
    vectors[:, :d] = u.x.array.reshape(-1, d)
    point_data: dict[str, tuple[Array, str]] = {"displacement": (vectors, "XYZ")}
    if hasattr(material, "stress"):
        sigma = stress_function(displacement, material).x.array.reshape(-1, d, d)
        which = _SYMMETRIC[d]
        values = np.stack([sigma[:, i, j] for i, j in which], axis=1)
        point_data["stress"] = (values, " ".join("XYZ"[i] + "XYZ"[j] for i, j in which))
        if d == 3:
            point_data["von Mises"] = (von_mises(sigma), "")
    offsets = cells.shape[1] * np.arange(1, len(types) + 1, dtype=np.int64)
    _write_vtu(path, x, cells.astype(np.int64), offsets, types.astype(np.uint8), point_data)


_TYPES = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


def _write_vtu(
    path: Path,
    x: Array,
    cells: npt.NDArray[np.int64],
    offsets: npt.NDArray[np.int64],
    types: npt.NDArray[np.uint8],
    point_data: Mapping[str, tuple[Array, str]],
) -> None:
    """VTK's XML with its numbers appended in binary."""
    appended: list[bytes] = []
    size = 0

    def array(values: npt.NDArray[Any], name: str, components: str = "") -> str:
        nonlocal size
        data = np.ascontiguousarray(values).tobytes()
        labels = components.split() if " " in components else list(components)
        text = "".join(
            f" ComponentName{i}={quoteattr(label)}" for i, label in enumerate(labels)
        )
        count = 1 if values.ndim == 1 else values.shape[1]
        entry = (
            f'        <DataArray type="{_TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} '
            f'NumberOfComponents="{count}"{text} format="appended" offset="{size}"/>\n'
        )
        appended.append(len(data).to_bytes(8, sys.byteorder))
        appended.append(data)
        size += 8 + len(data)
        return entry

    header = (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="2.2" '
        f'byte_order="{sys.byteorder.capitalize()}Endian" header_type="UInt64">\n'
        "  <UnstructuredGrid>\n"
        f'    <Piece NumberOfPoints="{len(x)}" NumberOfCells="{len(types)}">\n'
        f"      <Points>\n{array(x, 'Points')}      </Points>\n"
        f"      <Cells>\n{array(cells.ravel(), 'connectivity')}{array(offsets, 'offsets')}"
        f"{array(types, 'types')}      </Cells>\n      <PointData>\n"
        + "".join(array(values, name, labels) for name, (values, labels) in point_data.items())
        + "      </PointData>\n    </Piece>\n  </UnstructuredGrid>\n"
        '  <AppendedData encoding="raw">\n_'
    )
    with path.open("wb") as file:
        file.write(header.encode())
        file.writelines(appended)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
