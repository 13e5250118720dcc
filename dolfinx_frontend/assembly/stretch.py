"""A stiffness cell by cell: what a random field inside a part is multiplied with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import basix
import basix.ufl
import dolfinx.fem as fem
import dolfinx.fem.petsc as fem_petsc
import numpy as np
import ufl

from dolfinx_frontend.assembly.elements import csr
from dolfinx_frontend.assembly.ranks import PartSummary, agreement, exchanged
from dolfinx_frontend.assembly.substructure import Substructure, bilinear_of, ring
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import locked
from dolfinx_frontend.scene.values import is_random_field

__all__ = ["Stretch", "check_alone", "stretch_of", "with_cells"]

_STRAINED = 1e-11
"""Eigenvalues of a cell's stiffness below this fraction of its largest are those of rigid motions."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """B with B^T B = K, whose rows belong to cells: with a factor a in each cell, K is B^T a B.

    Attributes
    ----------
    points, weights
        (m, d) midpoints and (m,) volumes of the cells; areas or lengths where there is one layer or one row
        of cells.
    dimension
        3, 2 or 1 accordingly.
    matrix
        B (m * components, n), the components of a cell one after the other, force^1/2 / length^1/2.
    components
        Rows of a cell.
    """

    points: Array
    weights: Array
    dimension: int
    matrix: sp.csr_matrix = field(repr=False)
    components: int
    _roots: Array = field(repr=False)  # (m, components, unknowns of a cell) B of the cells
    _inverse: Array = field(repr=False)  # the same with the inverse roots of the eigenvalues
    _space: Any = field(repr=False)  # discontinuous
    _cells: Array = field(repr=False)  # (m, unknowns of a cell) of this space

    def __post_init__(self) -> None:
        locked(self)

    def initial(self, part: Substructure, stress: Any) -> Array:
        """g (m * components,) of an initial stress (UFL): its nodal forces are B^T g. Of a part of another
        rank the rank has made it, and it is given in place of the stress."""
        if isinstance(stress, np.ndarray):
            return stress
        strained = getattr(part.material, "strain", None)
        v = ufl.TestFunction(self._space)
        strain = ufl.sym(ufl.grad(v)) if strained is None else strained(v)
        integrand = ufl.inner(stress, strain)
        if part.around:
            integrand = ring(part.part.mesh) * integrand
        nodal = np.asarray(fem.assemble_vector(fem.form(integrand * ufl.dx)).array)[self._cells]
        found: Array = np.einsum("mcn,mn->mc", self._inverse, nodal).ravel()
        return found

    def forces(self, factors: Array, unknowns: Array, initial: Array | None = None) -> Array:
        """Nodal forces (N, n) of unknowns (N, n) under factors (N, m), less those of stretches (N, rows)."""
        moved = (self.matrix @ unknowns.T).T
        if initial is not None:
            moved = moved - initial
        stressed = (np.repeat(factors, self.components, axis=1) * moved).T
        out: Array = (self.matrix.T @ stressed).T
        return out


def _volumes(s: Substructure) -> Array:
    mesh = s.part.mesh
    v = ufl.TestFunction(fem.functionspace(mesh, ("DG", 0)))
    around = ring(mesh) if s.around else 1.0
    nodal = fem.assemble_vector(fem.form(around * v * ufl.dx(domain=mesh)))
    return np.array(nodal.array, dtype=np.float64)


def _across(s: Substructure, points: Array) -> tuple[float, int]:
    """Thickness (or section) of a part with one layer (or row) of cells; number of the other axes."""
    extent = np.ptp(np.asarray(s.part.mesh.geometry.x)[:, : s.dim], axis=0)
    single = np.ptp(points, axis=0) <= 1e-9 * extent
    if single.all():
        single[0] = False  # one cell
    return float(np.prod(extent[single])), int(np.count_nonzero(~single))


def _midpoints(s: Substructure) -> Array:
    mesh = s.part.mesh
    space = fem.functionspace(mesh, ("DG", 0))
    return np.array(space.tabulate_dof_coordinates()[:, : s.dim], dtype=np.float64)


def stretch_of(s: Substructure) -> Stretch:
    """Of a part with a random field of stiffness.

    Raises
    ------
    SceneError
        Elements of degree 3, or a material whose stiffness is no sum over cells.
    """
    where = f"substructure {s.name!r}: its stiffness is a random field"
    mesh, d = s.part.mesh, s.dim
    degree = int(s.space.element.basix_element.degree)
    if degree > 2:
        raise SceneError(f"{where}, which works with degree 1 and 2; it has {degree}")
    element = basix.ufl.element(
        "Lagrange",
        mesh.topology.cell_name(),
        degree,
        lagrange_variant=s.space.element.basix_element.lagrange_variant,
        discontinuous=True,
        shape=(d,),
    )
    space = fem.functionspace(mesh, element)
    matrix = fem_petsc.assemble_matrix(fem.form(bilinear_of(s, space)))
    matrix.assemble()
    cells = _unknowns_of_cells(space, d)
    blocks = _blocks(csr(matrix), cells)
    values, vectors = (np.asarray(each, dtype=np.float64) for each in np.linalg.eigh(blocks))
    kept = values > _STRAINED * values[:, -1:]
    components = int(kept.sum(axis=1).max())
    values, kept = values[:, -components:], kept[:, -components:]
    roots = np.sqrt(np.where(kept, values, 0.0))
    inverse = np.where(kept, 1.0 / np.where(kept, roots, 1.0), 0.0)
    rows = np.swapaxes(vectors[:, :, -components:], 1, 2)
    of_cells = roots[:, :, None] * rows
    shared = _unknowns_of_cells(s.space, d)
    count = len(shared)
    where_to = np.repeat(shared, components, axis=0).ravel()
    starts = np.arange(count * components + 1) * shared.shape[1]
    B = sp.csr_matrix((of_cells.ravel(), where_to, starts), shape=(count * components, s.size))
    B.sort_indices()
    x = np.random.default_rng(0).standard_normal(s.size)
    expected = s.matrix @ x
    if np.linalg.norm(B.T @ (B @ x) - expected) > 1e-9 * np.linalg.norm(expected):
        raise SceneError(f"{where}, but it is no sum over its cells (facet terms?): give stiffness= a number")
    points = _midpoints(s)
    thickness, dimension = _across(s, points)
    return Stretch(
        points,
        np.asarray(_volumes(s) / thickness, dtype=np.float64),
        dimension,
        B,
        components,
        of_cells,
        inverse[:, :, None] * rows,
        space,
        cells,
    )


def _unknowns_of_cells(space: Any, d: int) -> Any:
    nodes = np.asarray(space.dofmap.list, dtype=np.int64)
    return (d * nodes[:, :, None] + np.arange(d)).reshape(len(nodes), -1)


def _blocks(matrix: sp.csr_matrix, cells: Any) -> Array:
    """Diagonal blocks (m, k, k) of a matrix of cells that share nothing."""
    m, k = cells.shape
    local = np.empty(m * k, dtype=np.int64)
    cell = np.empty(m * k, dtype=np.int64)
    local[cells.ravel()] = np.tile(np.arange(k), m)
    cell[cells.ravel()] = np.repeat(np.arange(m), k)
    entries = matrix.tocoo()
    blocks = np.zeros((m, k, k))
    np.add.at(blocks, (cell[entries.row], local[entries.row], local[entries.col]), entries.data)
    return blocks


def check_alone(fields: Sequence[tuple[str, Any]]) -> None:
    """Refuse one field in two parts.

    Raises
    ------
    SceneError
        One field, or two of one name.
    """
    seen: dict[str, str] = {}
    for part, each in fields:
        if each.name in seen:
            raise SceneError(
                f"substructure {part!r}: the random field {each.name!r} is that of {seen[each.name]!r}, too: "
                "a field lives in one part; give each part a field with a name of its own"
            )
        seen[each.name] = part


def with_cells(
    comm: Any, parts: Mapping[str, PartSummary], own: Mapping[str, Substructure]
) -> dict[str, PartSummary]:
    """What every rank knows of parts, with the cells of those with a random field; collective where one is
    new.

    Parameters
    ----------
    own
        Parts of this rank.
    """
    new = [name for name, part in parts.items() if part.cells is None and is_random_field(part.factor)]
    if not new:
        return dict(parts)
    cells: dict[str, tuple[Array, Array, int]] = {}
    with agreement(comm):
        for name in (n for n in new if n in own):
            stretch = stretch_of(own[name])
            cells[name] = (stretch.points, stretch.weights, stretch.dimension)
    for each in exchanged(comm, cells):
        cells.update(each)
    return {name: replace(part, cells=cells.get(name, part.cells)) for name, part in parts.items()}
