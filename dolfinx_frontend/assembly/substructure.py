"""A part, discretised: stiffness and loads without any boundary condition."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import basix
import dolfinx.fem as fem
import numpy as np
import ufl
from basix.ufl import element
from dolfinx import geometry, jit
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.assembly.elements import (
    DIGITS,
    EPS,
    check_unchanged,
    coordinate_element,
    csr,
    noted,
    petsc_matrix,
    quadrature,
    tabulate,
)
from dolfinx_frontend.assembly.ranks import PartSummary
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import is_real
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import OneProcess, locked, locked_matrix, read_only
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.specs import PartLike, SubstructureSpec

__all__ = ["Sources", "Substructure", "bilinear_of", "form_of", "load_form", "modulus_of", "ring"]


_REMEDY = "after it was assembled: put it back, or assemble the scene again"


@dataclass(frozen=True, repr=False)
class Sources:
    """What a part was assembled from and a user can write to, with what was in it then.

    Attributes
    ----------
    mesh, nodes
        The mesh, and a checksum of its coordinates.
    constants
        Constants of dolfinx in the material, and their values.
    functions
        Its functions, and checksums of their unknowns.
    what
        What they are of, for messages.
    """

    mesh: Any
    nodes: int
    constants: tuple[tuple[Any, Array], ...]
    functions: tuple[tuple[Any, int], ...]
    what: str

    @classmethod
    def of(cls, mesh: Any, form: Any = None, what: str = "its material") -> Sources:
        """Of a UFL form on a mesh; None: nothing but the mesh."""
        values = [] if form is None else [each for each in form.constants() if hasattr(each, "value")]
        fields = [] if form is None else [each for each in form.coefficients() if hasattr(each, "x")]
        return cls(
            mesh,
            _checksum(mesh.geometry.x),
            tuple((each, np.array(each.value)) for each in values),
            tuple((each, _checksum(each.x.array)) for each in fields),
            what,
        )

    def check_mesh(self, where: str) -> None:
        """Raise SceneError if the nodes of the mesh were moved."""
        if _checksum(self.mesh.geometry.x) != self.nodes:
            raise SceneError(f"{where}: the nodes of its mesh were moved {_REMEDY}")

    def check(self, where: str) -> None:
        """Raise SceneError if something was written to."""
        self.check_mesh(where)
        self.check_values(where)

    def check_values(self, where: str) -> None:
        """As :meth:`check`, of constants and functions only."""
        for constant, value in self.constants:
            if not np.array_equal(constant.value, value):
                now = short(np.asarray(constant.value).tolist())
                raise SceneError(
                    f"{where}: a Constant of {self.what} was changed from {short(value.tolist())} to {now} "
                    f"{_REMEDY}"
                )
        for function, known in self.functions:
            if _checksum(function.x.array) != known:
                what = f"the Function {function.name!r} of {self.what}"
                raise SceneError(f"{where}: {what} was changed {_REMEDY}")


def _checksum(values: Array) -> int:
    return zlib.crc32(np.ascontiguousarray(values).view(np.uint8).data) if values.size else 0


@dataclass(frozen=True, repr=False)
class Substructure(OneProcess):
    """A part, discretised; n = d * nodes unknowns, unknown d*node + component.

    Attributes
    ----------
    space
        Vector-valued Lagrange space (also as ``V``).
    stiffness
        K (n, n), petsc4py seqaij, force / length, symmetric, no boundary condition. To be read: a part whose
        matrix was written to is refused; ``dataclasses.replace(part, stiffness=K.copy())`` is another part.
    load
        F (n,), force: body forces that are constant in time.
    varying_loads
        Amplitude -> (n,), force: body forces that change in time.
    rigid_modes
        (n, r), r = 3 in 2D and 6 in 3D: translations, then rotations about the centre divided by
        `length`; no unit.
    modulus
        Estimate of Young's modulus from the energy of uniform shears, force / area, see
        :func:`modulus_of`.
    length
        volume^(1/d).
    volume, centre
        Volume (area in 2D) and centre of gravity.
    dof_coordinates
        (nodes, d).
    around
        Whether it is the section of a body of revolution: volumes and forces are those of the whole ring.
    material
        As the scene has it; None for a part that was not assembled from one.
    sources
        What it was assembled from, and what was in it then; None: not known.
    factor
        What its stiffness is multiplied with: 1, or a random number or field with the mean 1.
    """

    name: str
    part: PartLike = field(repr=False)
    space: Any = field(repr=False)
    stiffness: Any = field(repr=False)
    load: Array = field(repr=False)
    rigid_modes: Array = field(repr=False)
    modulus: float
    length: float
    volume: float
    centre: Array
    dof_coordinates: Array = field(repr=False)
    varying_loads: dict[Amplitude, Array] = field(default_factory=dict, repr=False)
    material: Any = field(default=None, repr=False)
    sources: Sources | None = field(default=None, repr=False)
    around: bool = False
    factor: Any = 1.0

    def __post_init__(self) -> None:
        locked(self)
        noted(self.stiffness)

    @property
    def _instead(self) -> str:
        return "its mesh and matrices live in this process; assemble its scene where it is needed"

    def check_sources(self) -> None:
        """Raise SceneError if the mesh or what the material depends on was changed since it was assembled.

        For what reads them again, stresses and files for example; a solution needs the matrices only.
        """
        if self.sources is not None:
            self.sources.check(f"substructure {self.name!r}")

    def check_mesh(self) -> None:
        """As :meth:`check_sources`, of the mesh only."""
        if self.sources is not None:
            self.sources.check_mesh(f"substructure {self.name!r}")

    def check_unchanged(self) -> None:
        """Raise SceneError if somebody has written to the stiffness."""
        check_unchanged(self.stiffness, f"substructure {self.name!r}: its stiffness")

    def __repr__(self) -> str:
        return (
            f"Substructure({self.name!r}, {self.size} unknowns, {self.dim}D, volume {self.volume:.6g}, "
            f"modulus {self.modulus:.6g}, length {self.length:.6g})"
        )

    def load_of(self, amplitude: Amplitude | None) -> Array:
        """The part of the body forces that one amplitude multiplies (None: the constant part), (n,)."""
        if amplitude is None:
            return self.load
        return self.varying_loads.get(amplitude, np.zeros(self.size))

    @property
    def V(self) -> Any:
        """The function space."""
        return self.space

    @property
    def integrand(self) -> Callable[[Any, Any], Any] | None:
        """The material as (u, v) -> UFL integrand or form of which `stiffness` is the matrix."""
        return None if self.material is None else _integrand(self.material)

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return int(self.dof_coordinates.shape[1])

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return len(self.load)

    @property
    def entries(self) -> int:
        """Entries of K that are stored."""
        return int(self.stiffness.getInfo()["nz_used"])

    @cached_property
    def surface(self) -> int:
        """Nodes on exterior facets; of a matrix all."""
        known = getattr(self.part, "surface", None)
        if known is not None:
            return int(known)
        mesh = self.part.mesh
        d = mesh.topology.dim
        mesh.topology.create_connectivity(d - 1, d)
        outer = dmesh.exterior_facet_indices(mesh.topology)
        return len(fem.locate_dofs_topological(self.space, d - 1, outer))

    @cached_property
    def boxes(self) -> tuple[Any, float]:
        """Tree of the boxes of its cells, and the size of its mesh: where points are looked for."""
        mesh = self.part.mesh
        size = float(np.ptp(np.asarray(mesh.geometry.x)[:, : self.dim], axis=0).max())
        return geometry.bb_tree(mesh, mesh.topology.dim, padding=NEAR * size), size

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """K as a SciPy matrix."""
        self.check_unchanged()
        return locked_matrix(csr(self.stiffness), own=True)

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of K, (n,)."""
        return read_only(np.asarray(self.matrix.diagonal(), dtype=np.float64))

    @cached_property
    def strainless(self) -> tuple[Array, Array]:
        """Rigid motions (n, r) that K does not resist, and the inverse (r, r) of their inner products."""
        modes, matrix = self.rigid_modes, self.matrix

        def free(motions: Array) -> Any:
            resisted = np.abs(matrix @ motions).max(axis=0)
            return resisted <= _STRAINLESS * (self.diagonal[:, None] * np.abs(motions)).max(axis=0)

        together = modes @ np.sqrt(1.0 + np.arange(modes.shape[1]))
        if not free(together[:, None])[0]:  # a material with a foundation, say
            modes = modes[:, free(modes)]
        inverse = np.asarray(np.linalg.inv(modes.T @ modes), dtype=np.float64)
        return read_only(modes), read_only(inverse)


NEAR = 1e-6
"""Distance from a part, relative to its size, within which a point is one of its points."""

_STRAINLESS = 1e-10
"""A motion that K resists less than so, relative to its diagonal, is one that strains nothing."""


_FLAT, _LOST = 1e-5, 1e-8
"""Height of a cell relative to its length. The condition number of its stiffness is the inverse square: six
digits are left of sixteen, or none."""


def _measure(mesh: dmesh.Mesh, where: str, around: bool = False) -> tuple[float, Array]:
    """Volume and centre of gravity of a mesh (of a body of revolution that of its section); rejects cells
    that are inside out, or flat to rounding."""
    cell = basix.CellType[mesh.topology.cell_name()]
    element = coordinate_element(mesh)
    d, order = int(mesh.geometry.dim), int(coordinate_map(mesh).degree)
    points, weights = quadrature(cell, d * order + (order > 1) + around)
    tables = tabulate(element, 1, points)
    volume, moment, bad = 0.0, np.zeros(d, dtype=np.float64), 0
    flat, worst, lowest, at = 0, np.inf, np.inf, np.zeros(d)
    dofmap, x = cell_nodes(mesh), np.asarray(mesh.geometry.x, dtype=np.float64)
    for cells in np.array_split(dofmap, 1 + len(dofmap) // 20_000):
        nodes = x[cells][:, :, :d]
        # one product of matrices
        by_point = nodes.transpose(0, 2, 1) @ tables[1:].reshape(-1, nodes.shape[1]).T
        jacobians = by_point.reshape(len(nodes), d, d, -1)  # (cells, d, derivatives, points)
        det = _determinant(jacobians)
        bad += np.count_nonzero(det.min(axis=1) * det.max(axis=1) <= 0.0)
        dx = np.abs(det) * weights
        if around:
            dx = dx * 2.0 * np.pi * (nodes[:, :, 0] @ tables[0].T)
        volume += float(dx.sum())
        moment += np.tensordot(dx @ tables[0], nodes, 2)
        # singular values of those cells only that a cheap bound does not clear
        length = np.sqrt(np.einsum("cijp,cijp->cp", jacobians, jacobians))
        low = np.minimum.reduce(np.abs(det) / length ** (d - 1), axis=1)
        thin = np.flatnonzero((low < _FLAT * length.max(axis=1)) | (low < DIGITS * np.abs(x).max()))
        if thin.size and not bad:
            values = np.linalg.svd(jacobians[thin].transpose(0, 3, 1, 2), compute_uv=False)
            ratios = (values[..., -1] / values[..., 0]).min(axis=1)
            flat += np.count_nonzero(ratios < _FLAT)
            lowest = min(lowest, float(values[..., -1].min()))
            if ratios.min() < worst:
                worst, at = float(ratios.min()), nodes[thin[ratios.argmin()]].mean(axis=0)
    if bad:
        raise SceneError(f"{where}: {bad} cells are degenerate or inside out; fix the mesh")
    far = float(np.abs(x).max())
    if lowest < DIGITS * far:
        raise SceneError(
            f"{where}: cells are {lowest:.3g} high, and coordinates of {far:.3g} are rounded to "
            f"{far * EPS:.2g}; move the mesh to the origin, or fix it"
        )
    if flat:
        place = ", ".join(f"{v:.4g}" for v in at)
        text = f"{where}: {flat} cells are nearly flat (height / length down to {worst:.2g}, at ({place}))"
        if worst < _LOST:
            raise SceneError(f"{text}: rounding leaves nothing of their stiffness; fix the mesh")
        text += ": rounding may be seen in the answer; mesh it again"
        warn(text, SceneWarning)
    return volume, np.asarray(moment / volume, dtype=np.float64)


def _determinant(a: Array) -> Array:
    """(cells, points): of matrices (cells, d, d, points)."""
    if a.shape[1] == 2:
        return np.asarray(a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0])
    turns = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    parts = (a[:, 0, i] * (a[:, 1, j] * a[:, 2, k] - a[:, 1, k] * a[:, 2, j]) for i, j, k in turns)
    return np.asarray(sum(parts))


def modulus_of(K: sp.csr_matrix, x: Array, volume: float, around: bool = False) -> float:
    """Young's modulus, estimated from the energies of uniform volume-preserving strains.

    u = x_i e_i - x_j e_j has the energy u^T K u = 4 mu volume in an isotropic body, whatever its
    bulk modulus; 0.65 times 4 mu is E for nu = 0.3 and within 30 % of it for 0 <= nu <= 1/2.
    Uniaxial strains would give lambda + 2 mu, which says nothing of E near incompressibility.
    """
    d = x.shape[1]
    if around:  # the strain (1, -2, 1) of r, z and hoop has 12 mu volume
        u = x * [1.0, -2.0]
        return 0.65 * float(u.ravel() @ (K @ u.ravel())) / (3.0 * volume)
    total, pairs = 0.0, 0
    for i in range(d):
        for j in range(i):
            u = np.zeros_like(x)
            u[:, i], u[:, j] = x[:, i], -x[:, j]
            total += float(u.ravel() @ (K @ u.ravel()))
            pairs += 1
    return 0.65 * total / (pairs * volume)


def _integrand(material: Any) -> Callable[[Any, Any], Any]:
    integrand: Callable[[Any, Any], Any] = getattr(material, "bilinear", material)
    return integrand


def ring(mesh: dmesh.Mesh) -> Any:
    """2 pi r, UFL: what an integral over the section of a body of revolution is multiplied with."""
    return 2.0 * np.pi * ufl.SpatialCoordinate(mesh)[0]


def bilinear_of(part: Substructure, space: Any) -> Any:
    """The bilinear form of an assembled part on another space."""
    degree = int(part.space.element.basix_element.degree)
    spec = SubstructureSpec(part.name, part.part, part.material, degree, None, axisymmetric=part.around)
    return _bilinear(spec, space)


_FLAGS = ("-O3", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-fno-math-errno")
"""Of the compiler, for sums over quadrature points in vectors. Nothing that needs the processor at hand (the
compiled forms are kept in a folder that machines may share), and NaN stays NaN."""


def _jit() -> dict[str, Any]:
    """Options of the form compiler: the user's, and flags that make the assembly of stiffnesses faster."""
    known = jit.get_options()["cffi_extra_compile_args"]
    return {"cffi_extra_compile_args": [*known, *_FLAGS]}


def _degree(spec: SubstructureSpec) -> int:
    """Degree of the quadrature of a stiffness.

    Full integration of the element, exact for straight cells; the estimate of UFL would sum up the degrees of
    the mapping and is far too high for hexahedra.
    """
    order = int(coordinate_map(spec.part.mesh).degree)
    simplex = spec.cell in ("triangle", "tetrahedron")
    constant = isinstance(spec.material, (LinearElastic, OrthotropicElastic))
    degree = 2 * (spec.degree - (simplex and constant and not spec.axisymmetric)) + 2 * (order - 1)
    return degree + spec.axisymmetric


def _integral(integrand: Any, domain: Any, degree: int, around: bool) -> Any:
    return (ring(domain) * integrand if around else integrand) * ufl.dx(domain=domain, degree=degree)


def _bilinear(spec: SubstructureSpec, space: Any) -> Any:
    """The bilinear form of a substructure."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    integrand = _integrand(spec.material)(u, v)
    if not isinstance(integrand, ufl.Form):
        if integrand is None or getattr(integrand, "ufl_shape", None) != ():
            raise SceneError(
                f"substructure {spec.name!r}: the material returned {type(integrand).__name__}; it "
                "returns a scalar UFL integrand or a form"
            )
        integrand = _integral(integrand, spec.part.mesh, _degree(spec), spec.axisymmetric)
    if len(integrand.arguments()) != 2:
        raise SceneError(f"substructure {spec.name!r}: what the material returned is not bilinear in (u, v)")
    return integrand


@cache
def _isotropic(
    cell: str,
    order: int,
    variant: int,
    degree: int,
    dim: int,
    plane: str,
    quadrature_degree: int,
    around: bool,
) -> tuple[Any, Any, Any]:
    """The compiled form of isotropic parts of one kind of element, and its E and nu."""
    lagrange = basix.LagrangeVariant(variant)
    domain = ufl.Mesh(element("Lagrange", cell, order, lagrange_variant=lagrange, shape=(dim,)))
    space = ufl.FunctionSpace(domain, element("Lagrange", cell, degree, shape=(dim,)))
    E, nu = ufl.Constant(domain), ufl.Constant(domain)
    integrand = LinearElastic(E, nu, plane).bilinear(ufl.TrialFunction(space), ufl.TestFunction(space))
    form = _integral(integrand, domain, quadrature_degree, around)
    return fem.compile_form(MPI.COMM_SELF, form, jit_options=_jit()), E, nu


def form_of(spec: SubstructureSpec, space: Any) -> tuple[Any, Sources]:
    """The form of the stiffness, for assembly, and what a user can write to."""
    material, mesh = spec.material, spec.part.mesh
    if type(material) is LinearElastic and is_real(material.E) and is_real(material.nu):
        material.check(spec.dim)
        cmap = coordinate_map(mesh)
        compiled, *names = _isotropic(
            spec.cell,
            int(cmap.degree),
            int(cmap.variant),
            spec.degree,
            spec.dim,
            material.plane,
            _degree(spec),
            spec.axisymmetric,
        )
        values = (fem.Constant(mesh, np.float64(value)) for value in (material.E, material.nu))
        constants = dict(zip(names, values, strict=True))
        return fem.create_form(compiled, [space, space], mesh, {}, {}, constants), Sources.of(mesh)
    bilinear = _bilinear(spec, space)
    return fem.form(bilinear, jit_options=_jit()), Sources.of(mesh, bilinear)


def load_form(spec: SubstructureSpec, space: Any, force: Any) -> Any:
    """The form of a body force, for assembly; None: there is none."""
    if force is None or (isinstance(force, (int, float)) and force == 0):
        return None
    if not hasattr(force, "ufl_shape"):
        vector = np.asarray(force, dtype=np.float64)
        if not np.all(np.isfinite(vector)):
            raise SceneError(f"substructure {spec.name!r}: body_force = {force!r} is not finite")
        force = fem.Constant(spec.part.mesh, vector)
    if force.ufl_shape != (spec.dim,):
        raise SceneError(
            f"substructure {spec.name!r}: body_force has shape {force.ufl_shape}, ({spec.dim},) is wanted"
        )
    v = ufl.TestFunction(space)
    around = ring(spec.part.mesh) if spec.axisymmetric else 1.0
    return fem.form(around * ufl.inner(force, v) * ufl.dx(domain=spec.part.mesh))


def _load(spec: SubstructureSpec, space: Any, force: Any) -> Array:
    """Nodal forces of a body force, (n,)."""
    form = load_form(spec, space, force)
    if form is None:
        return np.zeros(space.dofmap.index_map.size_local * space.dofmap.bs)
    return np.array(fem.assemble_vector(form).array, dtype=np.float64)


def discretise(spec: SubstructureSpec) -> Substructure:
    where = f"substructure {spec.name!r}"
    mesh = spec.part.mesh
    d = spec.dim
    space = fem.functionspace(mesh, ("Lagrange", spec.degree, (d,)))
    volume, centre = _measure(mesh, where, spec.axisymmetric)
    if spec.axisymmetric:
        centre = np.array([0.0, centre[1]])
    form, sources = form_of(spec, space)
    # in blocks of nodes: half the time of entries that are put into a PETSc matrix one by one
    K = fem.assemble_matrix(form).to_scipy().tocsr()
    matrix = petsc_matrix(K)
    if not np.all(np.isfinite(K.data)):
        count = np.count_nonzero(~np.isfinite(K.data))
        raise SceneError(
            f"{where}: {count} of {K.nnz} entries of its stiffness are NaN or infinite; check the "
            "material (coefficients that divide by zero?)"
        )
    x, y = np.random.default_rng(0).standard_normal((2, K.shape[0]))
    scale = float(np.linalg.norm(x) * np.linalg.norm(K @ y))
    if abs(x @ (K @ y) - y @ (K @ x)) > 1e-9 * scale:
        raise SceneError(f"{where}: its stiffness is not symmetric; check the material")
    coordinates = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, :d].copy()
    modulus = modulus_of(K, coordinates - centre, volume, spec.axisymmetric)
    if not modulus > 0.0:
        raise SceneError(
            f"{where}: a uniform shear has the energy {modulus * volume:g}; its stiffness must be "
            "positive, check the material"
        )
    length = volume ** (1.0 / (3 if spec.axisymmetric else d))
    loads: dict[Amplitude | None, Array] = {None: _load(spec, space, None)}
    varies = isinstance(spec.body_force, Varying)
    for amplitude, force in spec.body_force.terms if varies else ((None, spec.body_force),):
        loads[amplitude] = loads.get(amplitude, 0.0) + _load(spec, space, force)
    constant = loads.pop(None)
    return Substructure(
        name=spec.name,
        part=spec.part,
        space=space,
        stiffness=matrix,
        load=constant,
        rigid_modes=rigid_modes(coordinates, centre, length).reshape(K.shape[0], -1),
        modulus=modulus,
        length=length,
        volume=volume,
        centre=centre,
        dof_coordinates=coordinates,
        varying_loads={a: f for a, f in loads.items() if a is not None},
        material=spec.material,
        around=spec.axisymmetric,
        factor=spec.stiffness,
        sources=sources,
    )


def summary(s: Substructure) -> PartSummary:
    modulus: Any = getattr(s.material, "E", None)
    return PartSummary(
        s.dim,
        s.size,
        s.modulus,
        s.length,
        s.volume,
        s.centre,
        bool(np.any(s.load)),
        s.around,
        float(modulus) if is_real(modulus) else None,
        s.factor,
        held=getattr(s.part, "held", None),
    )
