"""Integrals over what is common to two faces whose facets do not match.

Typed face of the kernel's layer ``latin::mortar``. Facets are images of a reference facet (the interval
[0, 1], the triangle of the unit vectors, the unit square); every function on them is a polynomial, given by
the coefficients of the monomials s_0^a s_1^b: a + b <= degree on triangles and a, b <= degree otherwise, the
power of s_1 varying faster. Wrong input raises ``InputError``, a ``ValueError``.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from latin_core import _core

__all__ = ["Array", "Face", "Functions", "Ints", "Overlap", "Shape", "integrate", "monomials", "sum_of"]

Array: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]
Shape: TypeAlias = Literal["interval", "triangle", "quadrilateral"]

_native: Any = _core.mortar


class Functions(NamedTuple):
    """Polynomials on facets.

    Attributes
    ----------
    degree
        Of the monomials.
    coefficients
        (variants, functions, monomials): one set for each number of a facet within its cell.
    """

    degree: int
    coefficients: Array


class Overlap(NamedTuple):
    """Integrals over the overlap, by facets of side 1; chi are the multiplier functions.

    Attributes
    ----------
    whole, covered
        (n1,), area of the flat polygons of each facet, and how much of it side 2 covers.
    mean, mass, own
        (n1, chi) int chi; (n1, chi, chi) int chi chi; (n1, chi, N_1) int chi N_1.
    own_normal
        (n1, chi, N_1, 3), int chi N_1 n_1, with the unit normal out of side 1; (0, ...) if side 1 is plane.
    place, normal, offset
        (n1, chi, 3): int chi x_1, int chi n_1, int chi (x_2 - x_1).
    gap
        (n1, chi), int chi (x_2 - x_1) . n_1.
    first, second
        (pairs,), facets that have a part in common; each pair comes once.
    area, distance
        (pairs,), area of that part, and the largest distance within it.
    other, other_normal
        (pairs, chi, N_2) int chi N_2; (pairs, chi, N_2, 3) int chi N_2 n_1, (0, ...) if side 1 is plane.
    farthest
        Largest distance of pairs that lie opposite but too far apart; 0: there are none.
    """

    whole: Array
    covered: Array
    mean: Array
    mass: Array
    own: Array
    own_normal: Array
    place: Array
    normal: Array
    offset: Array
    gap: Array
    first: Ints
    second: Ints
    area: Array
    distance: Array
    other: Array
    other_normal: Array
    farthest: float


class Face:
    """Facets of one face of a part.

    Parameters
    ----------
    shape
        Of the reference facet.
    parts
        Pieces along an edge that are flat enough to be cut as polygons: the degree of the map.
    nodes
        (facets, nodes of a facet, 2 or 3), coordinates, length.
    variants
        (facets,), number of each within its cell.
    orientation
        (facets,), 1, or -1 where the normal of the map (tangent turned by 90 degrees; t_0 x t_1) points
        into the part.
    geometry, shapes
        Shape functions of the nodes and of the displacement.
    """

    def __init__(
        self,
        shape: Shape,
        parts: int,
        nodes: Array,
        variants: Ints,
        orientation: Array,
        geometry: Functions,
        shapes: Functions,
    ) -> None:
        self.native = _native.Face(
            shape=shape,
            parts=parts,
            nodes=np.asarray(nodes, dtype=np.float64).reshape(-1, nodes.shape[-1]),
            variants=variants.tolist(),
            orientation=orientation.tolist(),
            map_degree=geometry.degree,
            map=list(geometry.coefficients),
            shape_degree=shapes.degree,
            shapes=list(shapes.coefficients),
        )


def monomials(shape: Shape, degree: int, s: Array) -> Array:
    """(points, monomials): values at points s (points, 1 or 2) of the reference facet."""
    powers = [
        (a, b)
        for a in range(degree + 1)
        for b in range({"interval": 0, "triangle": degree - a, "quadrilateral": degree}[shape] + 1)
    ]
    a, b = np.array(powers).T
    second = s[:, 1:2] if s.shape[1] > 1 else np.ones((len(s), 1))
    out: Array = s[:, :1] ** a * second**b
    return out


def integrate(
    first: Face,
    second: Face,
    multipliers: Functions,
    rule: tuple[Array, Array],
    near: tuple[Array, Array],
    opposed: float,
    around: bool = False,
) -> Overlap:
    """Integrate over the intersections of the facets of two faces.

    Facets meet in the planes of those of side 1. Exact for plane faces if the rule is.

    Parameters
    ----------
    first, second
        The faces.
    multipliers
        chi, of one variant, on the facets of side 1.
    rule
        Points (q, 1 or 2) and weights (q,) on the reference interval or triangle.
    near
        (n1,) and (n2,), length: largest distance from each facet; of a pair the larger one holds.
    opposed
        Two facets face each other if the product of their unit normals is below this.
    around
        The faces are turned about the axis x = 0: integrals over 2 pi x ds.
    """
    found = _native.integrate(
        first.native,
        second.native,
        degree=multipliers.degree,
        multipliers=multipliers.coefficients[0],
        points=rule[0],
        weights=rule[1],
        near_first=near[0],
        near_second=near[1],
        opposed=opposed,
        around=around,
    )
    return Overlap(**found)


def sum_of(
    values: Array, rows: Ints, columns: Ints, shape: tuple[int, int]
) -> tuple[Ints, Ints, Array]:
    """The sparse sum of dense blocks (count, height, width) at rows (count, height), columns (count, width).

    Entries below 1e-15 of the largest one are left out: integrals that are zero.

    Returns
    -------
    indptr, indices, data
        Compressed rows of a matrix of a shape, columns ascending.
    """
    out: tuple[Ints, Ints, Array] = _native.sum_of(values, rows, columns, *shape)
    return out
