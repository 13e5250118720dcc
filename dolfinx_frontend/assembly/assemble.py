"""From a scene to matrices: the last step that knows dolfinx.

The result is frozen: stiffness and load of every substructure without any boundary condition, and
the traces, weights and frames of every interface.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Any, TypeVar

import basix
import dolfinx.fem as fem
import dolfinx.fem.petsc as fem_petsc
import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.assembly.pairing import (
    FaceCopy,
    Interface,
    Side,
    coordinate_element,
    csr,
    face_copy,
    make_interface,
    quadrature,
    tabulate,
)
from dolfinx_frontend.assembly.ranks import (
    Distribution,
    PartSummary,
    agreement,
    bound_threads,
    end_all_on_errors,
    place,
    swap,
)
from dolfinx_frontend.assembly.rigid import Resistance, check_resistances, resistance, rigid_modes
from dolfinx_frontend.common.arrays import Array, Flags
from dolfinx_frontend.common.compat import cell_nodes, coordinate_map
from dolfinx_frontend.common.errors import SceneError, SceneWarning, unknown_name
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying, amplitudes_of
from dolfinx_frontend.scene.laws import Displacement, Elastic, Law, Perfect, Pressure, Traction, evaluate
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic
from dolfinx_frontend.scene.scene import PartLike, Scene, SubstructureSpec, check_face

__all__ = [
    "Interface",
    "Problem",
    "Side",
    "Substructure",
    "assemble",
    "forces",
    "held",
    "jumps",
    "resolve",
    "stiffnesses",
]

_log = logging.getLogger(__name__)
T = TypeVar("T")


@dataclass(frozen=True, repr=False)
class Substructure:
    """A part, discretised; n = d * nodes unknowns, unknown d*node + component.

    Attributes
    ----------
    space
        Vector-valued Lagrange space (also as ``V``).
    stiffness
        K (n, n), petsc4py seqaij, force / length, symmetric, no boundary condition.
    load
        F (n,), force: body forces that are constant in time.
    varying_loads
        Amplitude -> (n,), force: body forces that change in time.
    rigid_modes
        (n, r), r = 3 in 2D and 6 in 3D: translations, then rotations about the centre divided by
        `length`; no unit.
    modulus
        Estimate of Young's modulus from the energy of uniform shears, force / area, see
        :func:`_modulus`.
    length
        volume^(1/d).
    volume, centre
        Volume (area in 2D) and centre of gravity.
    dof_coordinates
        (nodes, d).
    material
        As the scene has it; None for a part that was not assembled from one.
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

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """K as a SciPy matrix."""
        return csr(self.stiffness)


@dataclass(frozen=True)
class Problem:
    """An assembled scene.

    On several ranks `substructures` has those of this rank, and `interfaces` all of the scene, of
    which those that touch no part of this rank have no traces here.
    """

    substructures: dict[str, Substructure]
    interfaces: dict[str, Interface]
    distribution: Distribution | None = field(default=None, repr=False)

    @cached_property
    def parts(self) -> Mapping[str, PartSummary]:
        """What every rank knows of all parts."""
        if self.distribution is not None:
            return self.distribution.parts
        return {name: _summary(s) for name, s in self.substructures.items()}

    @cached_property
    def own(self) -> Problem:
        """What of the problem is on this rank, without the rest."""
        if self.distribution is None:
            return self
        here = {
            name: i
            for name, i in self.interfaces.items()
            if any(side.substructure in self.substructures for side in i.sides)
        }
        return Problem(self.substructures, here, self.distribution)

    @property
    def comm(self) -> Any:
        """mpi4py communicator of the ranks that share the problem; None: there is one."""
        return None if self.distribution is None else self.distribution.comm

    def speaks_for(self, name: str) -> bool:
        """Whether this rank has the first side of an interface: one rank has."""
        return self.interfaces[name].sides[0].substructure in self.substructures

    @property
    def rank(self) -> int:
        """This rank; 0 where there is one."""
        return 0 if self.distribution is None else self.distribution.rank

    def gather(self, own: Mapping[str, T]) -> dict[str, T]:
        """What the ranks know of interfaces, put together, in the scene's order; collective."""
        known = dict(own)
        if self.comm is not None:
            known = {n: each for found in self.comm.allgather(known) for n, each in found.items()}
        return {name: known[name] for name in self.interfaces if name in known}

    def everywhere(self, name: str, read: Callable[[], T]) -> T:
        """What the rank of an interface's first side reads, on all ranks; collective."""
        if self.distribution is None or name not in self.interfaces:
            return read()
        comm = self.distribution.comm
        first = self.distribution.owner[self.interfaces[name].sides[0].substructure]
        found: list[T] = []
        with agreement(comm):
            if self.rank == first:
                found.append(read())
        shared: list[T] = comm.bcast(found, root=first)
        return shared[0]

    def here(self, name: str) -> Interface:
        """An interface that touches this rank.

        Raises
        ------
        SceneError
            It touches other ranks only.
        """
        interface = self.interfaces[name]
        if self.distribution is not None and name not in self.own.interfaces:
            ranks = self.distribution.ranks([side.substructure for side in interface.sides])
            raise SceneError(
                f"interface {name!r} is on rank {' and '.join(map(str, ranks))}, this is rank "
                f"{self.distribution.rank}: ask there, or all ranks together for gathered(...)"
            )
        return interface

    @cached_property
    def cuts(self) -> tuple[str, ...]:
        """Interfaces whose sides lie on two ranks."""
        if self.distribution is None:
            return ()
        return tuple(
            name
            for name, i in self.interfaces.items()
            if len(self.distribution.ranks([s.substructure for s in i.sides])) == 2
        )

    def on_one_rank(self, what: str) -> None:
        """Raise SceneError unless everything is on this rank, which `what` needs."""
        if self.distribution is not None:
            raise SceneError(
                f"{what} works on one rank only, this problem is spread over "
                f"{self.distribution.comm.size}: assemble it without comm"
            )

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return next(iter(self.parts.values())).dim

    @property
    def size(self) -> int:
        """Number of unknowns of all substructures."""
        return sum(s.size for s in self.parts.values())

    @property
    def load_amplitudes(self) -> tuple[Amplitude, ...]:
        """Amplitudes of all body forces."""
        if self.distribution is not None:
            return self.distribution.load_amplitudes
        return tuple(a for s in self.substructures.values() for a in s.varying_loads)

    @property
    def amplitudes(self) -> tuple[Amplitude, ...]:
        """The different amplitudes of all values that change in time."""
        varying = [v for i in self.interfaces.values() for v in i.law.varying.values()]
        bodies = [Varying(((a, 0.0),)) for a in self.load_amplitudes]
        return tuple(amplitudes_of([*varying, *bodies]))

    def at(self, time: float) -> Problem:
        """The problem at one time of a load history: nothing in it changes any more."""
        if not self.amplitudes:
            return self
        return Problem(
            {
                name: replace(
                    s,
                    load=s.load + sum(a(time) * f for a, f in s.varying_loads.items()),
                    varying_loads={},
                )
                for name, s in self.substructures.items()
            },
            {name: replace(i, law=i.law.at(time)) for name, i in self.interfaces.items()},
            self.distribution,
        )

    @property
    def interface_points(self) -> dict[str, Array]:
        """Interface name -> points (m, d)."""
        return {name: i.points for name, i in self.interfaces.items()}

    @property
    def law_parameters(self) -> dict[str, Any]:
        """Parameters of all laws, ``"joint.normal"`` -> value."""
        return {
            f"{name}.{key}": value
            for name, i in self.interfaces.items()
            for key, value in i.law.parameters().items()
        }

    def laws(
        self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None
    ) -> dict[str, Law]:
        """The laws of all interfaces with some of them replaced.

        Parameters
        ----------
        laws
            Interface name -> law.
        values
            Parameter name -> value, e.g. ``{"joint.normal": 120.0}``.

        Raises
        ------
        SceneError
            Unknown interface or parameter.
        """
        out = {name: i.law for name, i in self.interfaces.items()}
        for name, law in (laws or {}).items():
            if name not in out:
                raise unknown_name("interface", name, out)
            out[name] = law
        for key, value in (values or {}).items():
            name, _, parameter = key.rpartition(".")
            if name not in out or parameter not in out[name].parameters():
                raise unknown_name("parameter", key, self.law_parameters)
            out[name] = out[name].with_(**{parameter: value})
        return out

    def with_laws(
        self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None
    ) -> Problem:
        """The same parts and interfaces with some laws replaced; nothing is assembled again.

        Parameters
        ----------
        laws, values
            As for :meth:`laws`.
        """
        new = self.laws(laws, values)
        interfaces = {name: replace(i, law=new[name]) for name, i in self.interfaces.items()}
        return replace(self, interfaces=interfaces)

    def __repr__(self) -> str:
        lines = [
            f"Problem: {self.size} unknowns in {len(self.parts)} substructures, "
            f"{len(self.interfaces)} interfaces, {self.dim}D",
            f"  {'substructure':<18}{'unknowns':>10}{'volume':>12}{'modulus':>12}{'length':>11}",
        ]
        for name, s in self.parts.items():
            lines.append(
                f"  {name:<18}{s.size:>10}{s.volume:>12.4g}{s.modulus:>12.4g}{s.length:>11.4g}"
            )
        lines.append(f"  {'interface':<26}{'law':<14}{'points':>8}{'area':>12}  sides")
        for i in self.interfaces.values():
            sides = " | ".join(f"{s.substructure}:{s.face}" for s in i.sides)
            if len(i.sides) == 2:
                sides += " (matching)" if i.matching is not None else " (non-matching)"
            lines.append(
                f"  {i.name:<26}{type(i.law).__name__:<14}{i.num_points:>8}{i.area:>12.4g}  {sides}"
            )
        return "\n".join(lines)


def resolve(
    value: Any, interface: Interface, components: int, scalar: str = "all", name: str = "value"
) -> Array:
    """Values of a law parameter at the interface points.

    Parameters
    ----------
    value
        Number, array, callable of the points, or parameter with a mean (which is taken).
    interface
        The interface.
    components
        Components wanted at each point.
    scalar
        Meaning of one number per point if ``components > 1``, see :func:`laws.evaluate`.
    name
        Name of the parameter, for messages.

    Returns
    -------
    Array
        (m, components).

    Raises
    ------
    SceneError
        Wrong shape or type, NaN; the message names the interface.
    """
    what = f"interface {interface.name!r}, parameter {name!r}"
    return evaluate(value, interface.points, components, what, scalar)


def stiffnesses(interface: Interface, law: Elastic) -> Array:
    """kappa (m, d) in the local frame, force / length^3; free directions are 0.

    Raises
    ------
    SceneError
        Negative values or wrong shapes.
    """
    d = interface.dim
    out = np.zeros((interface.num_points, d))
    for name, value, where in (
        ("normal", law.normal, slice(0, 1)),
        ("tangential", law.tangential, slice(1, d)),
    ):
        if value is None:
            continue
        kappa = resolve(value, interface, 1, name=name)
        if kappa.min() < 0.0:
            raise SceneError(
                f"interface {interface.name!r}: {name} stiffness {kappa.min():g} is negative; "
                "stiffness is >= 0"
            )
        out[:, where] = kappa / interface.area if law.total else kappa
    return out


def jumps(interface: Interface, law: Elastic | Perfect) -> Array:
    """Imposed jump Delta (m, d) in the local frame, length."""
    return resolve(law.jump, interface, interface.dim, "first", "jump")


def forces(interface: Interface, law: Pressure | Traction) -> Array:
    """Prescribed force per area f_1 (m, d) in the local frame."""
    d = interface.dim
    if isinstance(law, Pressure):
        out = np.zeros((interface.num_points, d))
        out[:, :1] = -resolve(law.p, interface, 1, name="p")
        return out
    vector = resolve(law.t, interface, d, "zero", "t")
    local: Array = np.einsum("pij,pj->pi", interface.frames, vector)
    return local


def _measure(mesh: dmesh.Mesh, where: str) -> tuple[float, Array]:
    """Volume and centre of gravity of a mesh; rejects cells that are inside out."""
    cell = basix.CellType[mesh.topology.cell_name()]
    element = coordinate_element(mesh)
    d, order = int(mesh.geometry.dim), int(coordinate_map(mesh).degree)
    points, weights = quadrature(cell, d * order + (order > 1))
    tables = tabulate(element, 1, points)
    volume, moment, bad = 0.0, np.zeros(d, dtype=np.float64), 0
    dofmap, x = cell_nodes(mesh), np.asarray(mesh.geometry.x, dtype=np.float64)
    for cells in np.array_split(dofmap, 1 + len(dofmap) // 20_000):
        nodes = x[cells][:, :, :d]
        det = np.linalg.det(np.einsum("jqk,cki->cqij", tables[1:], nodes))
        bad += np.count_nonzero(det.min(axis=1) * det.max(axis=1) <= 0.0)
        dx = np.abs(det) * weights
        volume += float(dx.sum())
        moment += np.einsum("cq,qk,cki->i", dx, tables[0], nodes)
    if bad:
        raise SceneError(f"{where}: {bad} cells are degenerate or inside out; mend the mesh")
    return volume, np.asarray(moment / volume, dtype=np.float64)


def _modulus(K: sp.csr_matrix, x: Array, volume: float) -> float:
    """Young's modulus, estimated from the energies of uniform volume-preserving strains.

    u = x_i e_i - x_j e_j has the energy u^T K u = 4 mu volume in an isotropic body, whatever its
    bulk modulus; 0.65 times 4 mu is E for nu = 0.3 and within 30 % of it for 0 <= nu <= 1/2.
    Uniaxial strains would give lambda + 2 mu, which says nothing of E near incompressibility.
    """
    d = x.shape[1]
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


def _bilinear(spec: SubstructureSpec, space: Any) -> Any:
    """The compiled bilinear form of a substructure."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    material = spec.material
    integrand = _integrand(material)(u, v)
    if not isinstance(integrand, ufl.Form):
        if integrand is None or getattr(integrand, "ufl_shape", None) != ():
            raise SceneError(
                f"substructure {spec.name!r}: the material returned {type(integrand).__name__}; it "
                "returns a scalar UFL integrand or a form"
            )
        # Full integration of the element, exact for straight cells; the estimate of UFL would
        # sum up the degrees of the mapping and is far too high for hexahedra.
        order = int(coordinate_map(spec.part.mesh).degree)
        simplex = spec.cell in ("triangle", "tetrahedron")
        constant = isinstance(material, (LinearElastic, OrthotropicElastic))
        degree = 2 * (spec.degree - (simplex and constant)) + 2 * (order - 1)
        integrand = integrand * ufl.dx(domain=spec.part.mesh, degree=degree)
    if len(integrand.arguments()) != 2:
        raise SceneError(
            f"substructure {spec.name!r}: what the material returned is not bilinear in (u, v)"
        )
    return fem.form(integrand)


def _load(spec: SubstructureSpec, space: Any, force: Any) -> Array:
    """Nodal forces of a body force, (n,)."""
    n = space.dofmap.index_map.size_local * space.dofmap.bs
    if force is None or (isinstance(force, (int, float)) and force == 0):
        return np.zeros(n)
    if not hasattr(force, "ufl_shape"):
        vector = np.asarray(force, dtype=np.float64)
        if not np.all(np.isfinite(vector)):
            raise SceneError(f"substructure {spec.name!r}: body_force = {force!r} is not finite")
        force = fem.Constant(spec.part.mesh, vector)
    if force.ufl_shape != (spec.dim,):
        raise SceneError(
            f"substructure {spec.name!r}: body_force has shape {force.ufl_shape}, "
            f"({spec.dim},) is wanted"
        )
    v = ufl.TestFunction(space)
    nodal = fem.assemble_vector(fem.form(ufl.inner(force, v) * ufl.dx(domain=spec.part.mesh)))
    return np.array(nodal.array, dtype=np.float64)


def _substructure(spec: SubstructureSpec) -> Substructure:
    where = f"substructure {spec.name!r}"
    mesh = spec.part.mesh
    d = spec.dim
    space = fem.functionspace(mesh, ("Lagrange", spec.degree, (d,)))
    volume, centre = _measure(mesh, where)
    matrix = fem_petsc.assemble_matrix(_bilinear(spec, space))
    matrix.assemble()
    K = csr(matrix)
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
    modulus = _modulus(K, coordinates - centre, volume)
    if not modulus > 0.0:
        raise SceneError(
            f"{where}: a uniform shear has the energy {modulus * volume:g}; its stiffness must be "
            "positive, check the material"
        )
    length = volume ** (1.0 / d)
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
    )


def _check_law(interface: Interface) -> None:
    """Evaluate the values of a law once, so that mistakes are reported here."""
    law = interface.law.nominal
    if isinstance(law, Elastic):
        stiffnesses(interface, law)
    if isinstance(law, (Elastic, Perfect)):
        jumps(interface, law)
    elif isinstance(law, (Pressure, Traction)):
        forces(interface, law)
    elif isinstance(law, Displacement):
        resolve(law.value, interface, interface.dim, "all", "value")


def assemble(
    scene: Scene, progress: Callable[[str], None] | None = None, *, comm: Any = None
) -> Problem:
    """Assemble a scene.

    Parameters
    ----------
    scene
        The scene; the same on all ranks.
    progress
        Called with a line before each substructure and interface; None: a progress bar if on a terminal.
    comm
        mpi4py communicator over which the parts are spread; collective. None: this process alone,
        with a warning if it is one of several.

    Returns
    -------
    Problem
        Frozen.

    Raises
    ------
    SceneError
        Everything that is wrong with meshes, materials, faces, laws, and parts that can move
        without resistance. If one rank fails, all raise.
    """
    if not scene.substructures:
        raise SceneError("the scene is empty; add substructures")
    began = perf_counter()
    count = len(scene.substructures) + len(scene.interfaces)
    first = comm is None or comm.rank == 0
    with Bar(count, "assemble", "item", progress is None and first) as bar:

        def say(line: str) -> None:
            bar.step()
            _log.debug("%s", line)
            if progress is not None:
                progress(line)

        problem = _assemble(scene, say, comm)
    if first:
        _log.info(
            "assembled %d unknowns in %d substructures, %d interfaces, %.2f s",
            problem.size,
            len(problem.parts),
            len(problem.interfaces),
            perf_counter() - began,
        )
    return problem


def _assemble(scene: Scene, say: Callable[[str], None], comm: Any) -> Problem:
    if comm is None and MPI.COMM_WORLD.size > 1:
        warnings.warn(
            f"{MPI.COMM_WORLD.size} ranks are running, and each assembles all of the scene: pass "
            "comm=MPI.COMM_WORLD to spread it over them, comm=MPI.COMM_SELF if this is meant",
            SceneWarning,
            stacklevel=3,
        )
    comm = None if comm is None or comm.size == 1 else comm
    owner = place(scene.substructures, 1 if comm is None else comm.size)
    rank = 0 if comm is None else comm.rank
    if comm is not None:
        end_all_on_errors(comm)
        bound_threads(comm.py2f())

    substructures = {}
    copies: dict[int, dict[tuple[str, int], FaceCopy]] = {}  # other rank -> (interface, side) -> face
    with agreement(comm):
        specs = {}
        for name, spec in scene.substructures.items():
            if owner[name] == rank:
                say(f"substructure {name}")
                specs[name] = spec.made()
                substructures[name] = _substructure(specs[name])
        for name, joint in scene.interfaces.items():
            ranks = [owner[face.substructure] for face in joint.faces]
            for number, face in enumerate(joint.faces):
                if ranks[number] != rank:
                    continue
                where = f"interface {name!r}"
                check_face(specs[face.substructure], face, where)
                other = ranks[1 - number] if len(ranks) == 2 else rank
                if other != rank:
                    s = substructures[face.substructure]
                    copies.setdefault(other, {})[name, number] = face_copy(
                        s.part, face.face, s.space, where
                    )
    elsewhere = swap(comm, copies)

    interfaces = {}
    with agreement(comm):
        for name, joint in scene.interfaces.items():
            ranks = [owner[face.substructure] for face in joint.faces]
            if rank not in ranks:
                continue
            say(f"interface {name}")
            members = [
                substructures[face.substructure] if r == rank else elsewhere[name, number]
                for number, (face, r) in enumerate(zip(joint.faces, ranks, strict=True))
            ]
            interface = make_interface(
                name,
                joint.law,
                tuple(s.part if isinstance(s, Substructure) else s for s in members),
                tuple((f.substructure, f.face) for f in joint.faces),
                tuple(s.space for s in members),
                joint.quadrature_degree,
                joint.max_distance,
                joint.space,
                joint.overlap,
            )
            _check_law(interface)
            interfaces[name] = interface
    summaries = {name: _summary(s) for name, s in substructures.items()}
    resistances = {
        name: _resistance(i, substructures[i.sides[0].substructure].length)
        for name, i in interfaces.items()
        if owner[i.sides[0].substructure] == rank
    }
    if comm is not None:
        bare = {name: _bare(interfaces[name]) for name in resistances}
        for known, its in ((summaries, summaries), (resistances, resistances), (interfaces, bare)):
            for each in comm.allgather(its):
                known.update({n: value for n, value in each.items() if n not in known})
        interfaces = {
            name: replace(interfaces[name], law=joint.law) for name, joint in scene.interfaces.items()
        }
    parts = {name: summaries[name] for name in scene.substructures}
    if len({part.dim for part in parts.values()}) > 1:
        raise SceneError("the parts have different dimensions; a scene has one dimension")
    check_resistances(
        {name: (part.centre, part.length) for name, part in parts.items()},
        [resistances[name] for name in scene.interfaces],
    )
    if comm is None:
        return Problem(substructures, interfaces)
    forces = [spec.body_force for spec in scene.substructures.values()]
    amplitudes = amplitudes_of([f for f in forces if isinstance(f, Varying)])
    return Problem(substructures, interfaces, Distribution(comm, owner, parts, tuple(amplitudes)))


def _summary(s: Substructure) -> PartSummary:
    return PartSummary(
        s.dim, s.size, s.modulus, s.length, s.volume, s.centre, bool(np.any(s.load))
    )


def _bare(interface: Interface) -> Interface:
    """What other ranks must be told of an interface: no law, which they have, and no traces."""
    nothing, none = sp.csr_matrix((0, 0)), np.zeros(0, dtype=np.int64)
    return replace(
        interface,
        law=Perfect(),
        matching=None if interface.matching is None else np.zeros((0, 2), dtype=np.int64),
        sides=tuple(
            replace(side, trace=None, shape=nothing, nodes=none, node_normals=side.node_normals[:0])
            for side in interface.sides
        ),
    )


def held(problem: Problem, interface: Interface, where: Flags | None = None) -> Resistance:
    """Rigid motions that an interface with points on this rank resists, at the points `where` (m,) only."""
    length = problem.parts[interface.sides[0].substructure].length
    return _resistance(interface, length, where)


def _resistance(interface: Interface, length: float, where: Flags | None = None) -> Resistance:
    rows = _held_rows(interface)
    if where is not None:
        rows = rows * where[:, None, None]
    sides = tuple(side.substructure for side in interface.sides)
    return resistance(sides, interface.points, interface.weights, rows, length)


def _held_rows(interface: Interface) -> Array:
    """(m, r, d): directions in which the interface holds at each point, in global components."""
    law, d = interface.law.nominal, interface.dim
    m = interface.num_points
    if isinstance(law, Displacement):
        return np.tile(np.eye(d)[list(law.axes(d))], (m, 1, 1))
    rows = interface.frames[:, list(np.flatnonzero(law.holds(d))), :].copy()
    if isinstance(law, Elastic):
        kappa = stiffnesses(interface, law)[:, list(np.flatnonzero(law.holds(d)))]
        rows *= kappa[:, :, None] > 0.0
    return rows
