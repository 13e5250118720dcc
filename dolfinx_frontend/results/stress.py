"""Stresses of displacements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import basix
import basix.ufl
import numpy as np
from dolfinx import fem

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.errors import SceneError

__all__ = ["broken_space", "stress_function", "stress_of", "von_mises"]


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


def von_mises(stress: Array) -> Array:
    """Von Mises stress (points,) of stresses (points, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    equivalent: Array = np.sqrt(1.5 * np.einsum("pij,pij->p", deviator, deviator))
    return equivalent
