"""Stresses of displacements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError

__all__ = ["Shared", "broken_space", "principal", "stress_function", "stress_of", "von_mises"]


def broken_space(function: fem.Function, shape: tuple[int, ...], degree: int) -> fem.FunctionSpace:
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
    displacement: fem.Function,
    material: Any,
    degree: int | None = None,
    initial: Sequence[tuple[Any, float]] = (),
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
    initial
        Stresses of initial strains (UFL), and the numbers that they are multiplied with: they are taken away.

    Returns
    -------
    dolfinx.fem.Function
        (d, d), symmetric; in 2D the components in the plane.

    Raises
    ------
    SceneError
        The material gives a bilinear form only.
    """
    if getattr(material, "stress", None) is None:
        raise SceneError(
            f"material {material!r} gives no stress: it needs a method stress(u) that returns a "
            "UFL expression of shape (d, d)"
        )
    if degree is None:
        degree = int(displacement.function_space.element.basix_element.degree)
    stresses, numbers = [each for each, _ in initial], [number for _, number in initial]
    return stress_of(displacement, material, degree, stresses)(numbers)


def stress_of(
    displacement: fem.Function, material: Any, degree: int, initial: Sequence[Any] = ()
) -> Callable[[Sequence[float]], fem.Function]:
    """The stress of what a function holds when it is called with the numbers of initial stresses: compiled
    once."""
    mesh = displacement.function_space.mesh
    numbers = [fem.Constant(mesh, np.float64(0.0)) for _ in initial]
    total = material.stress(displacement)
    for number, each in zip(numbers, initial, strict=True):
        total = total - number * each
    function = fem.Function(broken_space(displacement, tuple(total.ufl_shape), degree), name="stress")
    points = function.function_space.element.basix_element.points
    expression = fem.Expression(total, points)

    def stress(given: Sequence[float] = ()) -> fem.Function:
        for number, value in zip(numbers, given, strict=True):
            number.value = value
        function.interpolate(expression)
        return function

    return stress


class Shared:
    """Nodes that cells share, of a function of :func:`broken_space`."""

    def __init__(self, function: fem.Function) -> None:
        broken = function.function_space
        self._element = broken.element.basix_element
        self._mesh, self._shape = broken.mesh, tuple(broken.value_shape)
        self.space = self._space(self._shape)
        self._nodes, self._own = self.space.dofmap.list, broken.dofmap.list
        volumes = _cell_volumes(broken.mesh)[: len(self._nodes)]
        count = int(self._nodes.max(initial=-1)) + 1
        ones = np.repeat(volumes, self._nodes.shape[1])
        places = (self._nodes.ravel(), self._own.ravel())
        sums = sp.csr_matrix((ones, places), shape=(count, int(self._own.max(initial=-1)) + 1))
        total = np.asarray(sums.sum(axis=1)).ravel()
        self._mean = sp.diags(1.0 / np.maximum(total, 1e-300)) @ sums

    def _space(self, shape: tuple[int, ...]) -> fem.FunctionSpace:
        element = basix.ufl.element(
            "Lagrange",
            self._mesh.topology.cell_name(),
            int(self._element.degree),
            lagrange_variant=basix.LagrangeVariant.equispaced,
            shape=shape,
        )
        return fem.functionspace(self._mesh, element)

    def mean(self, values: Array) -> Array:
        """Values (nodes of all cells, k) at the nodes, (nodes, k): the means over the cells there."""
        return np.asarray(self._mean @ values)

    def function(self, broken: fem.Function) -> fem.Function:
        """The continuous function with these values."""
        shape = tuple(broken.function_space.value_shape)
        out = fem.Function(self.space if shape == self._shape else self._space(shape), name=broken.name)
        size = broken.function_space.dofmap.bs
        out.x.array[:] = self.mean(broken.x.array.reshape(-1, size)).ravel()
        return out


def _cell_volumes(mesh: Any) -> Array:
    """(cells,), of the cells on this rank."""
    space = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
    form = fem.form(ufl.TestFunction(space) * ufl.dx)
    return np.asarray(fem.assemble_vector(form).array)


def principal(stress: Array) -> Array:
    """Principal stresses (points, 3), the largest first, of stresses (points, 3, 3)."""
    rising = np.linalg.eigvalsh(0.5 * (stress + np.swapaxes(stress, 1, 2)))
    return np.asarray(rising[:, ::-1], dtype=np.float64)


def von_mises(stress: Array) -> Array:
    """Von Mises stress (points,) of stresses (points, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    equivalent: Array = np.sqrt(1.5 * np.einsum("pij,pij->p", deviator, deviator))
    return equivalent
