"""What a scene consists of: parts, faces and interfaces as they are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import FunctionType, MethodType
from typing import Any, Literal, Protocol, cast, get_args

import numpy as np
from dolfinx import mesh as dmesh

from dolfinx_frontend.common.checks import check_known, checked_numbers, is_real
from dolfinx_frontend.common.compat import coordinate_map
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import SceneError, SceneWarning, warn
from dolfinx_frontend.common.frozen import frozen
from dolfinx_frontend.common.straight import straight_mesh
from dolfinx_frontend.scene.amplitudes import Varying
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.materials import Material
from dolfinx_frontend.scene.matrix import Matrix
from dolfinx_frontend.scene.values import Parameter, is_random_field, is_plain, is_uncertain

__all__ = [
    "CELLS",
    "OVERLAPS",
    "SPACES",
    "Face",
    "InterfaceSpec",
    "Overlap",
    "PartLike",
    "Remote",
    "Space",
    "SubstructureSpec",
    "check_face",
]

Overlap = Literal["full", "partial"]
"""Whether the second face covers the first one."""

Space = Literal["auto", "points", "facets", "mortar"]
"""Where the law of an interface holds; ``"auto"``: where it is right for the meshes and the law."""

OVERLAPS: tuple[Overlap, ...] = get_args(Overlap)
SPACES: tuple[Space, ...] = get_args(Space)
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
"""Cells that a part may have."""


class PartLike(Protocol):
    """One mesh with named faces (geometry.Part, or anything alike)."""

    @property
    def mesh(self) -> dmesh.Mesh:
        """Cells of this part only, on one process."""

    @property
    def facet_tags(self) -> Any:
        """Tags of the exterior facets (dolfinx MeshTags)."""

    @property
    def names(self) -> dict[str, int]:
        """Face name -> tag."""


@dataclass(frozen=True)
class Straight:
    """A part with straight cells instead of its curved ones; what is not here is its part's, methods of these
    cells."""

    part: PartLike
    mesh: dmesh.Mesh
    facet_tags: Any

    def __getattr__(self, name: str) -> Any:
        if name == "part":
            raise AttributeError(name)
        method = getattr(type(self.part), name, None)
        return MethodType(method, self) if isinstance(method, FunctionType) else getattr(self.part, name)


@dataclass(frozen=True)
class Revolved:
    """A part whose mesh is the section (r, z) of a body of revolution about r = 0; what is not here is its
    part's."""

    part: PartLike
    around: bool = True

    def __getattr__(self, name: str) -> Any:
        if name == "part":
            raise AttributeError(name)
        return getattr(self.part, name)


@dataclass(frozen=True)
class SubstructureSpec:
    """A part with its material; see :meth:`Scene.substructure`."""

    name: str
    source: PartLike | Matrix | Callable[[], PartLike | Matrix]
    material: Material | Callable[[Any, Any], Any] | None
    degree: int
    body_force: Any
    rank: int | None = None
    axisymmetric: bool = False
    stiffness: Any = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "body_force", frozen(self.body_force))

    @property
    def lazy(self) -> bool:
        """Whether the part is still to be made."""
        return callable(self.source)

    @property
    def spread(self) -> bool:
        """Whether its mesh is spread over the ranks."""
        return not self.lazy and self.matrix is None and int(self.part.mesh.comm.size) > 1

    @property
    def matrix(self) -> Matrix | None:
        """The matrix that the part is; None: it has a mesh, or is not made yet."""
        return self.source if isinstance(self.source, Matrix) else None

    @property
    def part(self) -> PartLike:
        """The part, once it is made."""
        assert not self.lazy
        return cast(PartLike, self.source)

    @property
    def dim(self) -> int:
        """Space dimension."""
        return int(self.part.mesh.geometry.dim) if self.matrix is None else self.matrix.dim

    @property
    def cell(self) -> str:
        """Cell name."""
        return str(self.part.mesh.topology.cell_name())

    def with_mean_stiffness(self) -> SubstructureSpec:
        """The same with a random modulus of the material as a factor of the stiffness.

        Raises
        ------
        SceneError
            The factor is random, too.
        """
        factor = getattr(self.material, "factor", 1.0)
        if not (is_uncertain(factor) or is_random_field(factor)):
            return self
        if is_uncertain(self.stiffness) or is_random_field(self.stiffness):
            raise SceneError(
                f"substructure {self.name!r}: E and stiffness = {short(self.stiffness)} are both random: "
                "give one, their product as an expression"
            )
        return replace(self, material=getattr(self.material, "nominal", self.material), stiffness=factor)

    def made_elsewhere(self) -> SubstructureSpec:
        """What :meth:`made` makes of it on another rank, but for the mesh."""
        spec = self.with_mean_stiffness()
        if not spec.axisymmetric:
            return spec
        return replace(spec, material=getattr(spec.material, "revolved", spec.material))

    def _straightened(self, where: str) -> SubstructureSpec:
        """The same with straight cells where its displacements are linear: on curved ones these lack the
        rotations, which then strain the part and carry torque."""
        if self.degree > 1 or int(coordinate_map(self.part.mesh).degree) == 1:
            return self
        if self.spread:
            raise SceneError(
                f"{where}: degree=1 on curved cells: a rotation would strain them; give degree=2, or a mesh "
                "with straight cells"
            )
        warn(
            f"{where}: degree=1 on curved cells: they are made straight, as a rotation would strain them; "
            "give degree=2 to keep the curves",
            SceneWarning,
        )
        return replace(self, source=Straight(self.part, *straight_mesh(self.part)))

    def _checked_matrix(self, where: str) -> SubstructureSpec:
        """The same, of a part that is a matrix: it has all of its stiffness."""
        if self.material is not None or self.body_force is not None:
            raise SceneError(
                f"{where}: {'a material' if self.material is not None else 'body_force'} beside a Matrix, "
                "which "
                "is the whole stiffness and has loads of its own: leave it out, or give it as "
                "loads={name: forces}"
            )
        if self.axisymmetric:
            raise SceneError(f"{where}: a Matrix in an axisymmetric scene; model it in 3D")
        if is_random_field(self.stiffness):
            raise SceneError(
                f"{where}: stiffness = {short(self.stiffness)}, and a Matrix has no cells; give a random "
                "number"
            )
        return self

    def made(self) -> SubstructureSpec:
        """The same with its part made, and checked.

        Raises
        ------
        SceneError
            What is no part, or does not fit the material.
        """
        spec = replace(self, source=self.source()) if callable(self.source) else self
        where, part = f"substructure {self.name!r}", spec.source
        if isinstance(part, Matrix):
            return spec._checked_matrix(where)
        if spec.material is None:
            raise SceneError(f"{where}: None is not a material; give one, e.g. LinearElastic(E, nu)")
        for attribute in ("mesh", "facet_tags", "names"):
            if not hasattr(part, attribute):
                raise SceneError(
                    f"{where}: {type(part).__name__} is not a part (it has no {attribute!r}); pass "
                    "one of the parts that a geometry function returns"
                )
        if spec.cell not in CELLS:
            raise SceneError(
                f"{where}: cells of type {spec.cell!r} are not supported; use {', '.join(CELLS)}"
            )
        if int(spec.part.mesh.topology.dim) != spec.dim:
            raise SceneError(
                f"{where}: {spec.cell} cells in {spec.dim} dimensions (a shell); use solid cells"
            )
        if spec.spread and callable(self.source):
            raise SceneError(
                f"{where}: its mesh is spread over processes: give the mesh, which all of them have, and no "
                "function; or make it on COMM_SELF"
            )
        spec = spec._straightened(where).with_mean_stiffness()
        plane = getattr(spec.material, "plane", "")
        if spec.axisymmetric and not isinstance(spec.source, Revolved):
            if spec.dim != 2:
                raise SceneError(
                    f"{where}: {spec.dim} dimensions in an axisymmetric scene; mesh its section (r, z)"
                )
            lowest = float(np.asarray(spec.part.mesh.geometry.x)[:, 0].min())
            size = float(np.ptp(np.asarray(spec.part.mesh.geometry.x), axis=0).max())
            if lowest < -1e-9 * size:
                raise SceneError(
                    f"{where}: its section has radii down to {lowest:.4g}; x is the radius: mesh one half, x "
                    ">= 0"
                )
            if plane == "stress":
                raise SceneError(f"{where}: plane = 'stress' in an axisymmetric scene; leave plane out")
            material = getattr(spec.material, "revolved", spec.material)
            spec = replace(spec, material=material, source=Revolved(spec.part))
        elif plane == "axisymmetric" and not spec.axisymmetric:
            raise SceneError(f"{where}: plane = 'axisymmetric' is for Scene(axisymmetric=True)")
        check = getattr(spec.material, "check", None)
        if check is not None:
            try:
                check(spec.dim)
            except SceneError as err:
                raise SceneError(f"{where}: {err}") from None
        locks = getattr(spec.material, "locks", None)
        if spec.degree == 1 and locks is not None and locks(spec.dim):
            warn(
                f"{where}: nu = {getattr(spec.material, 'nu', None):g} with degree=1: linear elements lock "
                "near nu = 1/2 (too stiff by any factor unless the stress is uniform); give degree=2",
                SceneWarning,
            )
        varies = isinstance(spec.body_force, Varying)
        for force in [v for _, v in spec.body_force.terms] if varies else [spec.body_force]:
            if isinstance(force, Parameter) and not is_plain(force):
                raise SceneError(
                    f"{where}: body_force = {force!r} is random: give it by scene.body_force(part, force), "
                    "which takes random components"
                )
            if force is None or hasattr(force, "ufl_shape") or (is_real(force) and force == 0):
                continue
            wanted = f"give {spec.dim} numbers"
            if checked_numbers(where, "body_force", force, wanted).shape != (spec.dim,):
                raise SceneError(f"{where}: body_force = {force!r}; {wanted}")
        return spec


@dataclass(frozen=True)
class Face:
    """A named face of a substructure, written ``"substructure:face"``."""

    substructure: str
    face: str

    def __str__(self) -> str:
        return f"{self.substructure}:{self.face}"


@dataclass(frozen=True)
class Remote:
    """What an interface with one point joins in place of the points of its faces.

    Attributes
    ----------
    node
        A point of the part at which there is a node; None: the mean rigid motion of each face, or `sums`.
    nearest
        Whether the node that is nearest to this point is taken, if it is no farther than its cells are large.
    sums
        By side: points at which there are nodes, each with the vector (d,) by which its displacement is
        multiplied.
    points
        By side: the point (d,) of which the displacement is taken; None: the centroid of the face.
    forces, moments
        By side: the displacement of the interface is force . displacement + moment . rotation (d and 3
        numbers, in 2D one).
    beam
        Of a beam between two faces: which of its deformations; forces and moments follow from their
        centroids.
    clamped
        Its length as its stiffness has it; None: that does not say.
    """

    node: tuple[float, ...] | None = None
    sums: tuple[tuple[tuple[tuple[float, ...], tuple[float, ...]], ...], ...] = ()
    points: tuple[tuple[float, ...] | None, ...] = ()
    forces: tuple[tuple[float, ...], ...] = ()
    moments: tuple[tuple[float, ...], ...] = ()
    beam: str = ""
    nearest: bool = False
    clamped: float | None = None

    @property
    def nodes(self) -> tuple[tuple[float, ...], ...]:
        """Points of the nodes of side 1 that it joins; none: it joins faces."""
        if self.node is not None:
            return (self.node,)
        return tuple(x for x, _ in self.sums[0]) if self.sums else ()


@dataclass(frozen=True)
class InterfaceSpec:
    """One or two faces with a law; see :meth:`Scene.interface`."""

    name: str
    faces: tuple[Face, ...]
    law: Law
    quadrature_degree: int | None
    max_distance: float | None
    space: Space = "auto"
    overlap: Overlap = "full"
    remote: Remote | None = None


def check_face(spec: SubstructureSpec, face: Face, where: str) -> None:
    """Raise SceneError unless the part has the face."""
    names = spec.part.names
    check_known("face", face.face, names, f"{where}, substructure {spec.name!r}")
