"""Recovered gradients: what a finite element solution would say of its own error.

Around each vertex a polynomial is fitted to the gradients of the cells nearby, at the points where they are
best (superconvergent patch recovery, Zienkiewicz and Zhu 1992). The fits are blended to a continuous field
of the element's degree, which in the limit of fine meshes is closer to the truth than the gradient itself.
Each part by itself: nothing is smoothed over interfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property, lru_cache, reduce
from itertools import product
from typing import Any, NamedTuple

import basix
import dolfinx.fem as fem
import numpy as np
import ufl
from basix.ufl import element
from mpi4py import MPI
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from dolfinx_frontend.assembly.elements import coordinate_element, quadrature, tabulate
from dolfinx_frontend.assembly.substructure import Substructure, ring
from dolfinx_frontend.common.arrays import Array, Flags, Ints
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.kept import kept
from dolfinx_frontend.scene.materials import LinearElastic

__all__ = ["Doubts", "Recovery", "recovery"]


FEW, SINGULAR = 0.06, 1.5
"""Share of the cells of which it is asked how much of all errors they have, and how much more there is if
they have all: no polynomial follows a stress that is singular, and on simplices of degree 2 and 3 fits see
half of its energy and less (see the measured ratios in the documentation)."""
UNSIGNED, ASTRAY = 0.5, 0.1
"""See `Doubts`."""

SIMPLICES = ("triangle", "tetrahedron")
POINTS_A_TERM = 1.5
"""Points that a fit needs for each term of its polynomial."""
AXIS = 1e-9
"""Radius relative to that of the cell's other end below which a corner is on the axis."""
CHUNK = 2_000_000
"""Numbers in the fits that are computed at once."""


@lru_cache
def _exponents(dim: int, degree: int, simplex: bool) -> Ints:
    """Exponents (terms, d) of the polynomials of a fit, those of the element."""
    every = np.array(list(product(range(degree + 1), repeat=dim)), dtype=np.int64)
    return every[every.sum(axis=1) <= degree] if simplex else every


def _powers(x: Array, exponents: Ints) -> Array:
    """Monomials (..., terms) at points (..., d)."""
    out = np.empty((*x.shape[:-1], len(exponents)))
    powers: list[list[Array]] = []
    for axis in range(x.shape[-1]):
        powers.append([np.ones(x.shape[:-1]), np.ascontiguousarray(x[..., axis])])
        for _ in range(1, int(exponents.max())):
            powers[-1].append(powers[-1][-1] * powers[-1][1])
    for k in range(len(exponents)):
        factors = [each[power] for each, power in zip(powers, exponents[k], strict=True) if power > 0]
        out[..., k] = reduce(np.multiply, factors) if factors else 1.0
    return out


def _pruned(matrix: sp.spmatrix) -> sp.csr_matrix:
    out = sp.csr_matrix(matrix)
    out.eliminate_zeros()
    return out


def _of_cells(integrand: Any, mesh: Any, order: int, degree: int, constants: Any, around: bool) -> Any:
    """The integrand or form of a material over each cell of an order, UFL."""
    if not isinstance(integrand, ufl.Form):
        if around:
            integrand = ring(mesh) * integrand
        integrand = integrand * ufl.dx(domain=mesh, degree=2 * (degree + order - 1) + around)
    one = ufl.TestFunction(constants)
    of_cells = ufl.Form(
        [
            integral.reconstruct(integrand=one * integral.integrand())
            for integral in integrand.integrals()
            if integral.integral_type() == "cell"
        ]
    )
    return apply_derivatives(apply_algebra_lowering(of_cells))


@cache
def _isotropic(
    cell: str, order: int, variant: int, degree: int, dim: int, plane: str
) -> tuple[Any, tuple[Any, ...], tuple[Any, Any]]:
    """The compiled form of errors in isotropic parts of one kind of element, its fields, its E and nu."""
    lagrange = basix.LagrangeVariant(variant)
    domain = ufl.Mesh(element("Lagrange", cell, order, lagrange_variant=lagrange, shape=(dim,)))
    space = ufl.FunctionSpace(domain, element("Lagrange", cell, degree, shape=(dim,)))
    tensors = ufl.FunctionSpace(domain, element("Lagrange", cell, degree, shape=(dim, dim)))
    constants = ufl.FunctionSpace(domain, element("DG", cell, 0))
    g, w, h, v = (ufl.Coefficient(each) for each in (tensors, space, tensors, space))
    E, nu = ufl.Constant(domain), ufl.Constant(domain)
    lowered = _of_cells(LinearElastic(E, nu, plane).bilinear(w, v), domain, order, degree, constants, False)
    swap = {ufl.grad(w): g - ufl.grad(w), ufl.grad(v): h - ufl.grad(v)}
    form = ufl.replace(lowered, swap)
    return fem.compile_form(MPI.COMM_SELF, form), (g, w, h, v), (E, nu)


def _share_of_few(sizes: Array) -> float:
    """What the `FEW` cells with the largest sizes (cells,) have of the sum."""
    count = max(1, round(FEW * len(sizes)))
    total = float(sizes.sum())
    return float(np.partition(sizes, -count)[-count:].sum()) / total if total > 0.0 else 0.0


class Doubts(NamedTuple):
    """What recovered gradients do not tell, by the cells of a part.

    Attributes
    ----------
    blind
        Simplices of degree 2 and 3: fits see too little of what is singular.
    least
        Share of the sum without signs that an error of a quantity is taken for at least: on tetrahedra of
        degree 2 and 3 the signs of products beside singular edges are those of chance.
    astray
        Share of what cancels that is added to what is left of the sum with signs: on linear hexahedra
        products beside clamped edges are known to so much only.
    """

    blind: bool
    least: float
    astray: float

    def missed(self, sizes: Array) -> float:
        """How much larger sums of `energies` are, whose sizes by cell (cells,) are given, for what fits do
        not see."""
        return 1.0 + SINGULAR * _share_of_few(sizes) if self.blind else 1.0


def recovery(part: Substructure) -> Recovery:
    """The recovery of a part, made when first asked for."""
    return kept(part, "_recovery", lambda: Recovery(part))


class Recovery:
    """Recovered gradients of one substructure, and the energy of their difference to the element's.

    Parameters
    ----------
    part
        An assembled substructure.

    Raises
    ------
    SceneError
        The material of the part is not known.
    """

    def __init__(self, part: Substructure) -> None:
        self.part = part
        mesh, space = part.part.mesh, part.space
        self.element = space.element.basix_element
        self.degree = int(self.element.degree)
        self.dim = part.dim
        self.cell = str(mesh.topology.cell_name())
        self.simplex = self.cell in SIMPLICES
        self.terms = _exponents(self.dim, self.degree, self.simplex)
        self.dofs = np.asarray(space.dofmap.list)
        self.nodes = np.asarray(cell_nodes(mesh))
        self.x = np.asarray(mesh.geometry.x, dtype=np.float64)[:, : self.dim]
        kind = basix.CellType[self.cell]
        # reduced integration: the gradient is best there
        points, _ = quadrature(kind, 2 * (self.degree - 1) + (0 if self.simplex else 1))
        geometry = tabulate(coordinate_element(mesh), 1, points)
        self.samples = np.einsum("qk,cki->cqi", geometry[0], self.x[self.nodes])
        jacobian = np.einsum("mqk,cki->cqim", geometry[1:], self.x[self.nodes])
        self.inverse = np.linalg.inv(jacobian)  # (c, q, m, i)
        self.slopes = tabulate(self.element, 1, points)[1:]
        # the first nodes of a cell of any order are its corners
        corners = len(np.asarray(basix.geometry(kind)))
        self.vertices, local = np.unique(self.nodes[:, :corners], return_inverse=True)
        self.corner = local.reshape(-1, corners)
        self._fit()

    def _on_boundary(self) -> Flags:
        """Which vertices lie on an exterior facet, (vertices,)."""
        topology = self.part.part.mesh.topology
        d = topology.dim
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        outer = np.diff(topology.connectivity(d - 1, d).offsets) == 1
        facets = np.asarray(topology.connectivity(d, d - 1).array).reshape(len(self.corner), -1)
        out = np.zeros(len(self.vertices), dtype=bool)
        for k, corners in enumerate(basix.topology(basix.CellType[self.cell])[d - 1]):
            out[self.corner[outer[facets[:, k]]][:, list(corners)].ravel()] = True
        return out

    def _patches(self) -> sp.csr_matrix:
        """(vertices, cells): the cells of the fit around each vertex.

        A vertex takes the cells around it. One on the boundary for which these are too few takes those around
        its interior neighbours as well; where it has none, those around all of its neighbours.
        """
        cells, corners = self.corner.shape
        one = np.ones(cells * corners)
        own = sp.csr_matrix(
            (one, (self.corner.ravel(), np.repeat(np.arange(cells), corners))),
            shape=(len(self.vertices), cells),
        )
        enough = POINTS_A_TERM * len(self.terms) / self.samples.shape[1]
        near = own @ own.T  # vertices that share a cell

        def choose(patches: sp.csr_matrix, where: Flags) -> sp.csr_matrix:
            return sp.diags(where.astype(np.float64)) @ patches

        boundary = self._on_boundary()
        wide = boundary & (np.diff(own.indptr) < enough)
        inner = choose(own, ~boundary)
        alone = wide & (np.asarray((near @ inner).sum(axis=1)).ravel() == 0.0)
        patches = choose(own, ~alone) + choose(near @ inner, wide & ~alone) + choose(near @ own, alone)
        few = np.diff(_pruned(patches).indptr) < enough
        if few.any():
            patches = choose(patches, ~few) + choose(near @ patches, few)
        return _pruned(patches)

    def _fit(self) -> None:
        """Operators of the least-squares fits: for each vertex (terms, points of the patch)."""
        patches = self._patches()
        q = self.samples.shape[1]
        sizes = np.diff(patches.indptr)
        centres = self.x[self.vertices]
        self.radius = np.zeros(len(sizes))
        self.groups: list[tuple[Ints, Ints, Array]] = []
        order = np.argsort(sizes, kind="stable")
        begin = 0
        while begin < len(order):
            # vertices with patches of nearly one size go together; a missing cell has weight 0
            size = int(sizes[order[begin]])
            most = max(1, CHUNK // max(1, size * q * len(self.terms)))
            end = min(begin + most, int(np.searchsorted(sizes[order], 1.15 * size, side="right")))
            who = order[begin:end]
            widest = int(sizes[who].max())
            place = patches.indptr[who][:, None] + np.arange(widest)
            there = np.arange(widest) < sizes[who][:, None]
            cells = np.where(there, patches.indices[np.minimum(place, patches.nnz - 1)], 0)
            offset = self.samples[cells] - centres[who][:, None, None]
            offset *= there[:, :, None, None]
            radius = np.sqrt(np.einsum("vcqi,vcqi->vcq", offset, offset).max(axis=(1, 2)))
            self.radius[who] = radius
            P = _powers(offset / radius[:, None, None, None], self.terms) * there[:, :, None, None]
            P = P.reshape(len(who), widest * q, -1)
            A = P.transpose(0, 2, 1) @ P
            # coefficients that the points do not determine are 0, about the mean: constants are recovered
            fit = np.linalg.pinv(A, rcond=1e-8, hermitian=True) @ P.transpose(0, 2, 1)
            mean = np.repeat(there, q, axis=1) / (sizes[who] * q)[:, None]
            excess = -(fit @ np.repeat(there, q, axis=1)[:, :, None].astype(np.float64))
            excess[:, int(np.flatnonzero(self.terms.sum(axis=1) == 0)[0])] += 1.0
            fit += excess * mean[:, None, :]
            self.groups.append((who, cells, fit))
            begin = end

    def gradient(self, u: Array) -> Array:
        """Gradients du_i/dx_j of unknowns (n,) at the sampling points, (cells, q, d, d)."""
        values = np.asarray(u).reshape(-1, self.dim)[self.dofs]
        slopes = np.einsum("cki,mqk->cqim", values, self.slopes, optimize=True)
        return np.asarray(np.einsum("cqim,cqmj->cqij", slopes, self.inverse))

    def recovered(self, fields: Sequence[Array], space: Any) -> Array:
        """Recovered gradients of unknowns (n,): (fields, unknowns) of a Lagrange space of shape (d, d)."""
        d, count = self.dim, len(fields)
        gradients = [self.gradient(u).reshape(len(self.dofs), -1, d * d) for u in fields]
        gradient = np.concatenate(gradients, axis=2)
        fits = np.empty((len(self.vertices), len(self.terms), count * d * d))
        for who, cells, fit in self.groups:
            fits[who] = fit @ gradient[cells].reshape(len(who), -1, count * d * d)
        # blend: the fits of a cell's corners, weighted by its (multi)linear shape functions
        element = basix.create_element(
            basix.ElementFamily.P,
            basix.CellType[self.cell],
            1,
            basix.LagrangeVariant.equispaced,
        )
        at = np.asarray(self.element.points)
        hats = tabulate(element, 0, at)[0]
        shape = tabulate(coordinate_element(self.part.part.mesh), 0, at)[0]
        index_map = space.dofmap.index_map
        out = np.zeros((count, index_map.size_local + index_map.num_ghosts, d * d))
        dofs = np.asarray(space.dofmap.list)
        for some in np.array_split(np.arange(len(dofs)), 1 + len(dofs) * len(at) // 50_000):
            x = np.einsum("nk,cki->cni", shape, self.x[self.nodes[some]])
            value = np.zeros((len(some), len(at), count * d * d))
            for k in range(self.corner.shape[1]):
                v = self.corner[some, k]
                offset = (x - self.x[self.vertices[v]][:, None]) / self.radius[v][:, None, None]
                value += hats[:, k, None] * (_powers(offset, self.terms) @ fits[v])
            for own, each in zip(out, np.split(value, count, axis=2), strict=True):
                own[dofs[some]] = each
        return out.reshape(count, -1)

    def gradient_field(self, u: Array) -> fem.Function:
        """Recovered gradient of unknowns (n,), of the element's degree, (d, d)."""
        target = fem.Function(self._form[1][0].function_space)
        target.x.array[:] = self.recovered([u], target.function_space)[0]
        return target

    def energies(self, fields: Sequence[Array]) -> Array:
        """a(e_i, e_j): energy products of the estimated errors of solutions (n,), force * length.

        Returns
        -------
        Array
            (fields, fields, cells): the sum over the cells is the product, on the diagonal the square of the
            estimated error in the energy norm.
        """
        form, (g, w, h, v), place = self._form
        gradients = self.recovered(fields, g.function_space)
        out = np.zeros((len(fields), len(fields), len(self.dofs)))
        for i, u in enumerate(fields):
            w.x.array[:], g.x.array[:] = u, gradients[i]
            for j, z in enumerate(fields):
                v.x.array[:], h.x.array[:] = z, gradients[j]
                out[i, j] = fem.assemble_vector(form).array[place] if j >= i else out[j, i]
        return out

    @property
    def doubts(self) -> Doubts:
        """What is not seen in cells of this kind."""
        solid = self.dim == 3
        blind = self.simplex and self.degree > 1
        linear = self.cell == "hexahedron" and self.degree == 1
        return Doubts(blind, UNSIGNED if blind and solid else 0.0, ASTRAY if linear else 0.0)

    def products(self, u: Array, z: Array) -> Array:
        """(cells,) a(u, z) of solutions (n,) themselves, force * length."""
        form, (_, w, _, v), place = self._whole if self.part.around else self._form
        w.x.array[:], v.x.array[:] = u, z
        for each in self._form[1][::2]:
            each.x.array[:] = 0.0
        return np.asarray(fem.assemble_vector(form).array[place])

    def volumes(self) -> Array:
        """(cells,) volumes, or areas in 2D, of straight cells."""
        kind = basix.CellType[self.cell]
        whole = float(quadrature(kind, 1)[1].sum())
        return np.asarray(whole / np.abs(np.linalg.det(self.inverse)).mean(axis=1))

    @cached_property
    def _form(self) -> tuple[Any, tuple[Any, Any, Any, Any], Ints]:
        """The material's form of the errors of two gradients, its coefficients, the entry of each cell."""
        part, mesh, d = self.part, self.part.part.mesh, self.dim
        if part.integrand is None:
            raise SceneError(
                f"substructure {part.name!r}: its material is not known, and with it the energy of an error; "
                "assemble it from a scene"
            )
        tensors = fem.functionspace(mesh, ("Lagrange", self.degree, (d, d)))
        g, h = fem.Function(tensors), fem.Function(tensors)
        w, v = fem.Function(part.space), fem.Function(part.space)
        constants = fem.functionspace(mesh, ("DG", 0))
        place = np.asarray(constants.dofmap.list, dtype=np.int64).ravel()
        material = part.material
        if type(material) is LinearElastic and is_real(material.E) and is_real(material.nu):
            if not part.around:
                cmap = coordinate_map(mesh)
                kind = (self.cell, int(cmap.degree), int(cmap.variant), self.degree, d, material.plane)
                compiled, names, numbers = _isotropic(*kind)
                known = dict(zip(names, (g, w, h, v), strict=True))
                values = (fem.Constant(mesh, np.float64(value)) for value in (material.E, material.nu))
                form = fem.create_form(
                    compiled, [constants], mesh, {}, known, dict(zip(numbers, values, strict=True))
                )
                return form, (g, w, h, v), place
        return fem.form(self._errors(part.integrand, (g, w, h, v), constants)), (g, w, h, v), place

    def _errors(self, integrand: Any, fields: tuple[Any, Any, Any, Any], constants: Any) -> Any:
        """The form of the errors of recovered gradients g and h of w and v, cell by cell."""
        g, w, h, v = fields
        mesh = self.part.part.mesh
        order = int(coordinate_map(mesh).degree)
        self._lowered = _of_cells(integrand(w, v), mesh, order, self.degree, constants, self.part.around)
        errors = (g - ufl.grad(w), h - ufl.grad(v))
        # terms with values instead of gradients are of higher order
        swap = {ufl.grad(w): errors[0], ufl.grad(v): errors[1]}
        swap |= {w: self._value(errors[0]), v: self._value(errors[1])}
        return ufl.replace(self._lowered, swap)

    @cached_property
    def _whole(self) -> tuple[Any, tuple[Any, Any, Any, Any], Ints]:
        """The same of solutions themselves, with the hoop strain."""
        _, fields, place = self._form
        return fem.form(self._lowered), fields, place

    def _value(self, error: Any) -> Any:
        """The error of a displacement, UFL (d,), where terms with values count: in cells on the axis of a
        body of revolution, where u_r / r is another slope."""
        if not self.part.around:
            return ufl.zero(self.dim)
        mesh = self.part.part.mesh
        r = ufl.SpatialCoordinate(mesh)[0]
        on_axis = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        corners = self.x[self.nodes][:, : self.corner.shape[1], 0]
        reach = corners.max(axis=1)
        on_axis.x.array[:] = corners.min(axis=1) <= AXIS * reach
        return ufl.as_vector((on_axis * r * error[0, 0], 0.0))
