"""What two faces have in common, integrated by the kernel, and whether one covers the other.

Intersections are those of flat convex polygons (intervals in 2D), in the plane of the facet of side 1: exact
for plane faces.  A facet with a map of order g > 1 is cut into g^(d-1) polygons first, and the points of a
piece are put back onto both curved facets: by its map on side 1, along the normal of the plane on side 2
(where there is a gap, the closest point may be on another facet than the piece).  An error remains where an
edge is not where its chord is.  Measured on a cylinder, means of the coordinates differ by O(h^2) with
straight facets (the distance of the chords) and by O(h^4) with quadratic ones.
"""

from __future__ import annotations

from typing import Any, cast

import basix
import numpy as np
from latin_core import mortar

from dolfinx_frontend.assembly.elements import quadrature, tabulate
from dolfinx_frontend.assembly.facet_map import FacetMap
from dolfinx_frontend.common.arrays import Array, Ints
from dolfinx_frontend.common.deferred import spatial
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.specs import Overlap

__all__ = [
    "OPPOSED",
    "UNCOVERED",
    "check_cover",
    "closure_nodes",
    "common",
    "constant",
    "filled",
    "hats",
    "linear_means",
    "of_one_side",
    "shape_of",
]


UNCOVERED = 0.01
"""Largest fraction of side 1 that may be left uncovered without ``overlap="partial"``.

Not zero: the edges of a round face are chords, and two meshes have different ones."""

OPPOSED = -0.5
"""Two facets face each other if the product of their unit normals is below this."""

_WHOLE = 1e-9
"""A facet is covered if a smaller fraction of it is not."""

_DIGITS, _REGION, _MOST = 11.0, 1.3, 20
"""On quadrilaterals that are no parallelograms shape functions are analytic, not polynomial, in the
plane coordinates: each degree beyond 2 p gains log10(_REGION / twist) of the _DIGITS that lack
(measured: errors of 1e-15 up to twist = 0.2, 1e-12 at 0.4, with at most _MOST degrees)."""

_SLIVER = 0.8
"""What is missing of a facet of which more is covered, on a face that is covered altogether, lies between two
meshes of its rim."""

_RIM = 0.01
"""Middles of edges that are beside straight ones by more, relative to the edge, have pieces half as long."""

_EVEN = 1e-6
"""Middles of edges that are off by less, relative to the edge, are in the middle."""

_CURVED = 2
"""Degrees added on curved facets: the error is that of the flat polygons."""


_NEARLY_STRAIGHT = ((0.003, 2), (0.01, 3))
"""Of curved triangles with this bend at most, degrees beyond p: with 2 what is polynomial is exact, and the
error of the other side's functions falls with the bend (measured: 1e-13 at 0.0014; 3e-11 with 3 at 0.02)."""


def shape_of(facets: FacetMap) -> mortar.Shape:
    """Of its reference facet."""
    return cast(mortar.Shape, facets.facet_cell.name)


def constant(shape: mortar.Shape) -> mortar.Functions:
    """The function 1."""
    return mortar.Functions(0, np.ones((1, 1, mortar.monomials(shape, 0, np.zeros((1, 2))).shape[1])))


def hats(shape: mortar.Shape) -> mortar.Functions:
    """The linear (bilinear) functions of the vertices of a facet."""
    element = basix.create_element(basix.ElementFamily.P, basix.CellType[shape], 1)
    return _functions(shape, 1, [element], [lambda s: s], [np.arange(element.dim)])


def _functions(shape: mortar.Shape, degree: int, elements: Any, places: Any, chosen: Any) -> mortar.Functions:
    """Coefficients of nodal bases on facets: of elements at the places of facet coordinates, chosen ones."""
    s = np.asarray(basix.create_lattice(basix.CellType[shape], max(degree, 1), basix.LatticeType.gll, True))
    table = mortar.monomials(shape, degree, s)
    values = [
        tabulate(e, 0, np.ascontiguousarray(place(s)))[0][:, keep]
        for e, place, keep in zip(elements, places, chosen, strict=True)
    ]
    solved = [np.linalg.lstsq(table, v, rcond=None)[0].T for v in values]
    return mortar.Functions(degree, np.stack(solved))


def _on_facets(facets: FacetMap, element: Any) -> mortar.Functions:
    """The basis of an element of the cells on their facets."""
    closure = element.entity_closure_dofs[facets.dim - 1]
    count = len(closure)

    def places(number: int) -> Any:
        return lambda s: facets.origin[number] + s @ facets.tangents[number].T

    return _functions(
        shape_of(facets),
        int(element.degree),
        [element] * count,
        [places(k) for k in range(count)],
        [np.asarray(c) for c in closure],
    )


def _face(facets: FacetMap, space: Any) -> mortar.Face:
    """The facets as the kernel takes them."""
    closure = np.array(facets.element.entity_closure_dofs[facets.dim - 1])[facets.local]
    nodes = np.take_along_axis(facets.nodes, closure[:, :, None], axis=1)
    middle = np.asarray(basix.geometry(facets.facet_cell)).mean(axis=0)
    _, orientation = facets.alike_normals(middle[None])
    # chords of a round rim on one side are not those on the other where its facets are smaller
    parts = facets.order
    if facets.dim == 3 and parts > 1 and facets.edges_bend.max(initial=0.0) > _RIM:
        parts *= 2
    return mortar.Face(
        shape_of(facets),
        parts,
        nodes,
        facets.local.astype(np.int64),
        orientation[:, 0],
        _on_facets(facets, facets.element),
        _on_facets(facets, space.element.basix_element),
    )


def piece_degree(facets: FacetMap, degree: int) -> int:
    """Degree on pieces, in plane coordinates, for functions of a degree on a face."""
    quadrilateral = facets.facet_cell == basix.CellType.quadrilateral
    least = degree
    if facets.order > 1:
        bend = facets.bend if facets.facet_cell == basix.CellType.triangle and facets.order == 2 else 1.0
        more = next((more for most, more in _NEARLY_STRAIGHT if bend <= most), degree + _CURVED)
        least = degree + more
        # the inverse of a map whose middle is off by u is analytic in a region that grows like 1 / 2 u
        uneven = float(facets.uneven.max())
        if uneven > _EVEN and facets.plane:
            least = max(least, 2 * degree + _more(0.5 / uneven))
    if quadrilateral and (facets.order == 1 or facets.plane):
        # the inverse of a bilinear map is analytic in a region that grows like 1 / twist
        c = facets.alike(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
        size = np.ptp(c, axis=1).max(axis=1)
        twist = float((np.abs(c[:, 0] - c[:, 1] + c[:, 2] - c[:, 3]).max(axis=1) / size).max())
        least = max(least, 2 * degree + (_more(_REGION / twist) if twist >= 1e-13 else 0))
    return least


def _more(region: float) -> int:
    """Degrees for what is analytic in a region of such a size, not polynomial."""
    return min(int(np.ceil(_DIGITS / np.log10(max(region, 1.5)))), _MOST)


def common(
    faces: tuple[FacetMap, FacetMap],
    spaces: tuple[Any, Any],
    multipliers: mortar.Functions,
    near: tuple[Array, Array],
    degree: int | None = None,
) -> mortar.Overlap:
    """Integrals over what the faces have in common, by facets of the first one.

    Parameters
    ----------
    faces, spaces
        The sides and their Lagrange spaces.
    multipliers
        On the facets of the first one.
    near
        Largest distance from the facets of each, length.
    degree
        On the pieces; None: exact for straight simplices and parallelograms, to rounding for other
        quadrilaterals.
    """
    if degree is None:
        degree = max(
            piece_degree(face, v.element.basix_element.degree + multipliers.degree)
            for face, v in zip(faces, spaces, strict=True)
        )
    cell = basix.CellType.interval if faces[0].dim == 2 else basix.CellType.triangle
    first, second = (_face(face, v) for face, v in zip(faces, spaces, strict=True))
    around = faces[0].around
    rule = quadrature(cell, degree + around)
    return mortar.integrate(first, second, multipliers, rule, near, OPPOSED, around)


def of_one_side(facets: FacetMap, space: Any, chi: mortar.Functions, degree: int | None) -> mortar.Overlap:
    """The integrals over a face that has no opposite."""
    element, d = space.element.basix_element, facets.dim
    if degree is None:
        degree = element.degree + chi.degree + 2 * (facets.order - 1) + d - 2 + facets.around
    s, w = facets.rule(max(degree, 1))
    x, (normals, area) = facets.alike(s), facets.alike_surface(s)
    n = len(facets)
    w = w * area
    values = mortar.monomials(shape_of(facets), chi.degree, s) @ chi.coefficients[0].T
    weighed = w[:, :, None] * values
    shape = facets.alike_shapes(space, s)
    x, normals = (np.pad(v, ((0, 0), (0, 0), (0, 3 - d))) for v in (x, normals))
    along = shape[:, :, :, None] * normals[:, :, None, :]

    def over(fields: Array) -> Array:
        return np.swapaxes(weighed, 1, 2) @ fields

    areas = w.sum(axis=1)
    none, chis = np.zeros(0, dtype=np.int64), values.shape[1]
    return mortar.Overlap(
        whole=areas,
        covered=areas,
        mean=weighed.sum(axis=1),
        mass=over(values[None]),
        own=over(shape),
        own_normal=over(along.reshape(*w.shape, -1)).reshape(n, values.shape[1], -1, 3),
        place=over(x),
        normal=over(normals),
        offset=np.zeros((n, chis, 3)),
        gap=np.zeros((n, chis)),
        first=none,
        second=none,
        area=np.zeros(0),
        distance=np.zeros(0),
        other=np.zeros((0, chis, 0)),
        other_normal=np.zeros((0, chis, 0, 3)),
        farthest=0.0,
    )


def linear_means(facets: FacetMap) -> Array:
    """(facets, vertices): integrals of the functions of the vertices over whole facets, of rings too."""
    chi = hats(shape_of(facets))
    s, w = facets.rule(chi.degree + 2 * (facets.order - 1) + facets.dim - 2 + facets.around)
    values = mortar.monomials(shape_of(facets), chi.degree, s) @ chi.coefficients[0].T
    return np.asarray((w * facets.alike_surface(s)[1]) @ values, dtype=np.float64)


def filled(found: mortar.Overlap) -> mortar.Overlap:
    """The integrals over whole facets where a face is covered altogether but for slivers along its rim.

    Both sides get the same factor, so that their forces stay opposite.
    """
    share = found.covered / found.whole
    slivers = (share > _SLIVER) & (share < 1.0 - _WHOLE)
    if not slivers.any():
        return found
    factor = np.where(slivers, 1.0 / share, 1.0)
    of_pairs = factor[found.first]

    def scaled(values: Array, by: Array) -> Array:
        if len(values) != len(by):  # fields with normals, of plane faces
            return values
        return np.asarray(values * by.reshape(-1, *(1,) * (np.ndim(values) - 1)), dtype=np.float64)

    own = ("mean", "mass", "own", "own_normal", "place", "normal", "offset", "gap")
    return mortar.Overlap(
        whole=found.whole,
        covered=np.where(slivers, found.whole, found.covered),
        first=found.first,
        second=found.second,
        area=scaled(found.area, of_pairs),
        distance=found.distance,
        other=scaled(found.other, of_pairs),
        other_normal=scaled(found.other_normal, of_pairs),
        farthest=found.farthest,
        **{name: scaled(getattr(found, name), factor) for name in own},
    )


def closure_nodes(facets: FacetMap, space: Any) -> Ints:
    """(facets, functions): nodes of a space on each facet, in the order of the integrals."""
    return facets.closure_dofs(space)


def check_cover(
    where: str,
    names: tuple[str, str],
    faces: tuple[FacetMap, FacetMap],
    found: mortar.Overlap,
    overlap: Overlap,
) -> float:
    """The covered fraction of side 1; raises unless side 2 covers it once.

    Raises
    ------
    SceneError
        Faces that do not overlap, or cover each other partly or twice.
    """
    first, second = faces
    share = found.covered / found.whole
    areas = found.whole
    size = float(max(first.sizes.max(), second.sizes.max()))
    uncovered = float(areas @ np.clip(1.0 - share, 0.0, 1.0) / areas.sum())
    reason = f"largest distance {found.farthest:.4g}, facet size {size:.4g}" if found.farthest else ""
    if share.max(initial=0.0) > 1.0 + UNCOVERED:
        raise SceneError(
            f"{where}: {names[1]} covers {np.count_nonzero(share > 1.0 + UNCOVERED)} facets of "
            f"{names[0]} more than once (up to {share.max():.3g} times): it is folded or finely "
            "curved there; refine, split the face, or lower max_distance"
        )
    if uncovered > 1.0 - 1e-6:
        if not reason:
            d = first.dim
            nearest, _ = spatial.cKDTree(second.samples.reshape(-1, d)).query(first.samples.reshape(-1, d))
            reason = f"the faces are {nearest.min():.4g} apart, facet size {size:.4g}"
        raise SceneError(
            f"{where}: the facets do not face each other: no facet of {names[0]} overlaps one of "
            f"{names[1]} ({reason}); check the faces and the positions of the parts, or raise max_distance"
        )
    if overlap == "full" and uncovered > UNCOVERED:
        raise SceneError(
            f"{where}: {100 * uncovered:.3g} % of the area of {names[0]} is not covered by "
            f"{names[1]} ({np.count_nonzero(share < 1.0 - _WHOLE)} of {len(share)} facets"
            f"{f'; {reason}' if reason else ''}); give the smaller face first, raise "
            'max_distance, or let them overlap partly with overlap="partial"'
        )
    return 1.0 - uncovered
