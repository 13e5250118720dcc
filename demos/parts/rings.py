"""Rings and parts of rings, in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.common.compat import create_mesh
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import (
    Assembly,
    Connection,
    Marker,
    Part,
    cell_type,
    check_divisions,
    check_order,
    check_positive,
    located,
)

__all__ = ["annulus", "two_rings"]


def annulus(
    inner: float,
    outer: float,
    angle: float = math.pi / 2,
    divisions: Sequence[int] = (8, 16),
    cell: str = "quadrilateral",
    geometry_order: int = 2,
) -> Part:
    """Sector of a ring between the polar angles 0 and ``angle``, centred at the origin.

    Parameters
    ----------
    inner, outer
        Radii.
    angle
        Opening in radians; ``2 * pi`` gives the whole ring.
    divisions
        Cells along the radius and along the arc.
    cell
        ``"quadrilateral"`` or ``"triangle"``.
    geometry_order
        1: chords, area in error by the square of the cell angle; 2: parabolic arcs, in error by
        its fourth power.

    Returns
    -------
    Part
        Faces ``inner``, ``outer`` and, unless the ring is whole, ``theta0``, ``theta1``.
    """
    check_positive(inner=inner, outer=outer, angle=angle)
    if outer <= inner:
        raise SceneError(f"outer = {outer} must exceed inner = {inner}")
    whole = math.isclose(angle, 2 * math.pi, rel_tol=1e-12)
    if angle > 2 * math.pi and not whole:
        raise SceneError(f"angle = {angle} must not exceed 2 pi")
    n_r, n_t = check_divisions(divisions, 2)
    if whole and n_t < 3:
        raise SceneError(f"divisions = {tuple(divisions)}: a whole ring needs 3 cells along it")
    order = check_order(geometry_order)
    flat = dmesh.create_rectangle(
        MPI.COMM_SELF, [np.zeros(2), np.ones(2)], [n_r, n_t], cell_type=cell_type(cell, 2)
    )
    # the nodes of a Lagrange space on the unit square are the nodes of the curved mesh
    space = fem.functionspace(flat, ("Lagrange", order))
    lattice = np.rint(
        space.tabulate_dof_coordinates()[:, :2] * (order * n_r, order * n_t)
    ).astype(np.int64)
    if whole:
        lattice[:, 1] %= order * n_t
    nodes, place = np.unique(lattice, axis=0, return_inverse=True)
    radius = inner + (outer - inner) * nodes[:, 0] / (order * n_r)
    theta = angle * nodes[:, 1] / (order * n_t)
    x = np.column_stack([radius * np.cos(theta), radius * np.sin(theta)])
    cells = place.reshape(-1)[space.dofmap.list].astype(np.int64)
    mesh = create_mesh(cells, x, cell, order)

    small = 1e-3 * min((outer - inner) / n_r, inner * angle / n_t)

    def arc(value: float) -> Marker:
        return lambda x: np.abs(np.hypot(x[0], x[1]) - value) < small

    def ray(value: float) -> Marker:
        cos, sin = math.cos(value), math.sin(value)
        return lambda x: (np.abs(cos * x[1] - sin * x[0]) < small) & (cos * x[0] + sin * x[1] > 0)

    markers = {"inner": arc(inner), "outer": arc(outer)}
    if not whole:
        markers |= {"theta0": ray(0.0), "theta1": ray(angle)}
    return located(mesh, markers)


def two_rings(
    a: float,
    c: float,
    b: float,
    angle: float = math.pi / 2,
    divisions: Sequence[int] = (6, 16),
    outer_divisions: Sequence[int] | None = None,
    cell: str = "quadrilateral",
    geometry_order: int = 2,
) -> Assembly:
    """Two concentric rings, ``inner`` between the radii a and c, ``outer`` between c and b.

    ``outer_divisions`` differs from ``divisions`` when the meshes shall not match.  The interfaces
    are the joint at r = c, the pressure at r = a and the symmetry planes; see :func:`annulus` for
    the other arguments.
    """
    outer_divisions = divisions if outer_divisions is None else outer_divisions
    parts = {
        "inner": annulus(a, c, angle, divisions, cell, geometry_order),
        "outer": annulus(c, b, angle, outer_divisions, cell, geometry_order),
    }
    links = [
        Connection("joint", "elastic", "inner:outer", "outer:inner"),
        Connection("pressure", "pressure", "inner:inner"),
    ]
    links += [
        Connection(f"symmetry {name} {face}", "symmetry", f"{name}:{face}")
        for name in parts
        for face in ("theta0", "theta1")
        if face in parts[name].names
    ]
    parameters = MappingProxyType({"a": a, "c": c, "b": b, "angle": angle})
    return Assembly(parts, tuple(links), parameters)
